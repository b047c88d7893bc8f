"""What is asked of a design, and what is answered."""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

from softmodels.design.loads import PRESSURE, Load
from softmodels.design.quantities.base import Quantity
from softmodels.design.squares import Squares

Array = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Judged:
    """A quantity of a design.

    Attributes:
        value: In its SI unit.
        gradient: By the parameters, shape (n,); empty if none was asked for.
        by_material: By the material's numbers.
    """

    value: float
    gradient: Array
    by_material: dict[str, float]
    squares: Squares | None = None
    """Of a target that is to be followed."""

    def times(self, factor: float) -> Judged:
        """The quantity times a number."""
        by_material = {name: factor * rate for name, rate in self.by_material.items()}
        return Judged(factor * self.value, factor * self.gradient, by_material)


@dataclasses.dataclass(frozen=True)
class Question:
    """What is asked of a design.

    Attributes:
        names: The parameters that are free.
        parts: The quantities, each of one state at most.
        loads: Those of the states.
        highest: Pressure in Pa up to which a limit point is looked for; 0 for none.
        materials: Numbers of the material by which derivatives are wanted.
    """

    names: tuple[str, ...]
    parts: tuple[Quantity, ...]
    loads: tuple[Load, ...]
    highest: float
    materials: tuple[str, ...]

    @property
    def working(self) -> float:
        """The highest pressure in Pa at which the device is judged; 0 for none."""
        return max((load.value for load in self.loads if load.kind == PRESSURE), default=0.0)
