"""The fields that every step is written with: each is listed here once, and files, columns and pictures follow.

A field of your own is one more entry, also from outside: ``FIELDS.append(OutputField(...))`` before the run.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from softmodels.results.peak import WORDS
from softmodels.results.terms import AT_POINTS

if TYPE_CHECKING:
    from softmodels.results.state_values import StateValues

Array = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Colours:
    """How pictures colour a field.

    Attributes:
        unit: Of the colour bar.
        factor: From SI to it.
        rest: Value at rest in it, where the colours begin.
        power: Colours follow this power of the value: stress by its square root, or all but a few corners and the last
            state would be dark.
    """

    unit: str
    factor: float
    rest: float
    power: float = 1.0


@dataclasses.dataclass(frozen=True)
class Extreme:
    """A column of ``path.csv`` with the least or the largest value of a field over the whole device.

    Attributes:
        column: Its name, which ends in the unit.
        title: Short name.
        text: What it is, a sentence without its stop.
        unit: SI value of the column's unit.
        least: Whether it is the least value, not the largest.
        peak: Whether it is the field's `softmodels.results.peak`, which no single point decides.
    """

    column: str
    title: str
    text: str
    unit: float = 1.0
    least: bool = False
    peak: bool = False


@dataclasses.dataclass(frozen=True)
class OutputField:
    """A field over the nodes, in HDF5, XDMF and VTKHDF.

    Attributes:
        name: In the files.
        unit: SI; "" for a number.
        title: In words.
        nodal: Its values at owned nodes, shape (owned,), or (owned, 3) of a vector; asked on all ranks.
        sampled: Its values where they are exact: at integration points or corners, shape (cells, k). `Figures.extremes` has
            the least and the largest of them over the whole device.
        extremes: Columns of ``path.csv`` with these.
        colours: How pictures show it; None if they do not.
    """

    name: str
    unit: str
    title: str
    nodal: Callable[[StateValues], Array]
    sampled: Callable[[StateValues], Array] | None = None
    extremes: tuple[Extreme, ...] = ()
    colours: Colours | None = None

    @property
    def largest(self) -> Extreme | None:
        """The column of its largest value, if it has one."""
        return next((one for one in self.extremes if not (one.least or one.peak)), None)


FIELDS: list[OutputField] = [
    OutputField("displacement", "m", "displacement", lambda at: at.displacement),
    OutputField("p", "Pa", "pressure-like unknown", lambda at: at.p),
    OutputField(
        "von_mises", "Pa", "von Mises stress", lambda at: at.at_nodes(at.von_mises, positive=True),
        lambda at: at.von_mises,
        (Extreme("max_von_mises_kPa", "largest von Mises stress", f"Cauchy stress that changes the shape; {AT_POINTS}", 1e3),
         Extreme("peak_von_mises_kPa", "peak von Mises stress", f"{WORDS}; what designs are judged by", 1e3, peak=True)),
        Colours("kPa", 1e-3, 0.0, 0.5),
    ),
    OutputField(
        "largest_stretch", "", "largest stretch", lambda at: at.at_nodes(at.stretches[..., -1], positive=True),
        lambda at: at.stretches[..., -1],
        (Extreme("max_stretch", "largest stretch",
                 f"length over length at rest, in the direction where it is most; {AT_POINTS}, so at sharp corners and clamped "
                 "edges it grows with every refinement of the mesh"),
         Extreme("peak_stretch", "peak stretch", f"of the largest stretch the {WORDS}, which does not depend on the mesh; what "
                 "designs are judged by", peak=True)),
        Colours("", 1.0, 1.0),
    ),
    OutputField(
        "J", "", "volume ratio", lambda at: at.from_corners(at.J), lambda at: at.J,
        (Extreme("J_min", "smallest J", "J is the silicone's own volume over that at rest; rubber keeps it at 1; over the "
                 "cells' vertices", least=True),
         Extreme("J_max", "largest J", "of the same, over the cells' vertices")),
    ),
]  # fmt: skip
"""In the order in which they are computed."""


def coloured() -> dict[str, tuple[OutputField, Colours]]:
    """The fields that pictures show, by name."""
    return {field.name: (field, field.colours) for field in FIELDS if field.colours is not None}
