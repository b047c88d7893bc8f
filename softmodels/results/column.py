"""What a column of ``path.csv`` is made of: its name, its words, and how it is computed from a state."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from geometries import Actuator
from softmodels.case.case import Case
from softmodels.results.row import Cell
from softmodels.results.terms import Term, described

if TYPE_CHECKING:
    from softmodels.path.points import Point
    from softmodels.results.fields import Fields
    from softmodels.results.figures import Figures
    from softmodels.results.self_contact import Gap


@dataclasses.dataclass(frozen=True, eq=False)
class Solved:
    """A state of a path with all that its row is made of, on rank 0.

    Attributes:
        case: What is run.
        fields: The device's nodal fields and figures.
        point: The point of the path.
        figures: Its figures.
        nodal: Its nodal fields by name, SI units.
        number: How many rows come before.
        load_step: How many steps a program has come.
        band: Half widths of 95 % intervals by column, where the material's errors are known; see `results.band`.
    """

    case: Case
    fields: Fields
    point: Point
    figures: Figures
    nodal: Mapping[str, npt.NDArray[np.float64]]
    number: int
    load_step: float
    band: Mapping[str, Cell] = dataclasses.field(default_factory=dict)

    @property
    def pressure(self) -> float:
        """In Pa; of a program's pressures the highest stands for all."""
        return max(self.figures.cavity_pressures, default=0.0) if self.case.program else self.figures.pressure

    @functools.cached_property
    def gap(self) -> Gap | None:
        """The least gap between the device's walls."""
        return self.fields.walls.least(self.nodal["displacement"])


@dataclasses.dataclass(frozen=True, eq=False)
class Column:
    """One column.

    Attributes:
        name: In the file; its end is the unit, see `UNITS`.
        title: Short name.
        text: What it is, a sentence without its stop.
        value: Its value, in its unit; None if it is not known.
        present: Whether a case has it.
    """

    name: str
    title: str
    text: str
    value: Callable[[Solved], Cell]
    present: Callable[[Case], bool] = lambda case: True

    def cells(self, solved: Solved) -> dict[str, Cell]:
        return {self.name: self.value(solved)} if self.present(solved.case) else {}

    def term(self, column: str, device: Actuator | None) -> Term | None:
        return described(column, (self.title, self.text)) if column == self.name else None


@dataclasses.dataclass(frozen=True, eq=False)
class Columns:
    """Several columns whose names depend on the device or the case.

    Attributes:
        cells: Values by column.
        term: What a column is; None for one that is not of these.
    """

    cells: Callable[[Solved], Mapping[str, Cell]]
    term: Callable[[str, Actuator | None], Term | None]
