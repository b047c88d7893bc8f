"""Quantities composed of others at several states: the distance from a target path."""

from __future__ import annotations

import abc
import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from softmodels.common.arrays import Array
from softmodels.design.loads import JudgedLoad
from softmodels.design.quantities.base import DesignQuantity, Measure, length, register_quantity
from softmodels.design.quantities.places import AXES, Place
from softmodels.design.quantities.tip_path import read_tip_path
from softmodels.design.trials import Squares

if TYPE_CHECKING:
    from softmodels.design.body import DesignedBody


@dataclasses.dataclass(frozen=True, kw_only=True)
class CompositeQuantity(DesignQuantity):
    """A function of other quantities."""

    of_state: ClassVar = False

    @property
    @abc.abstractmethod
    def parts(self) -> tuple[DesignQuantity, ...]:
        """The component quantities."""

    @abc.abstractmethod
    def combined(self, values: Array) -> tuple[float, Array]:
        """Return the value of the function of the parts' values, and its slopes by them."""

    def squares(self, values: Array, slopes: Array) -> Squares | None:
        """Return the residuals of a target, from the parts' values (k,) and their gradients (k, m)."""
        return None

    def measure(self, design: DesignedBody) -> Measure:
        raise TypeError("a composite quantity is evaluated from its parts")


@register_quantity
@dataclasses.dataclass(frozen=True, kw_only=True)
class TipPath(CompositeQuantity):
    """Root mean square distance of a probe from a target path.

    Attributes:
        of: The probe; the device's first one if empty.
        target: Rows of pressure in Pa and the place's coordinates in m; nan where a coordinate is not asked for.
        file: Or a table with columns such as ``pressure_kPa``, ``x_mm``, ``z_mm``, or a run's ``path.csv``; see
            `softmodels.design.quantities.tip_path`.
        sigma: Standard error of a coordinate in m, or a text with a unit; 0 to estimate it from what is left.
        cm: Pa of one centimetre of the case's column, for a file whose pressures are in cm; 0 if it is not known.
    """

    name: ClassVar = "tip_path"
    unit: ClassVar = "m"
    help: ClassVar = "root mean square distance of a probe from a target path"

    of: str = ""
    target: tuple[tuple[float, float, float, float], ...] = ()
    file: str = ""
    sigma: float = 0.0
    cm: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if bool(self.file) == (len(self.target) > 0):
            raise ValueError("a tip path needs either a file or a target, rows of pressure and place")
        object.__setattr__(self, "sigma", length("sigma", self.sigma))
        if self.file:
            rows, of = read_tip_path(Path(self.file), self.of, self.cm)
            object.__setattr__(self, "of", of)
        else:
            try:
                rows = tuple((float(p), float(x), float(y), float(z)) for p, x, y, z in self.target)
            except (TypeError, ValueError):
                raise ValueError("the target of a tip path has rows of pressure in Pa and x, y, z in m") from None
        object.__setattr__(self, "target", rows)

    @property
    def title(self) -> str:
        return f"distance of {self.of or 'the tip'} from its path"

    @property
    def _wanted(self) -> list[tuple[Place, float]]:
        return [
            (Place(at=JudgedLoad.of(row[0]), of=self.of, axis=axis), row[1 + i])
            for row in self.target
            for i, axis in enumerate(AXES)
            if not np.isnan(row[1 + i])
        ]

    @property
    def parts(self) -> tuple[DesignQuantity, ...]:
        return tuple(place for place, _ in self._wanted)

    def residuals(self, values: Array) -> Array:
        """Return the distances of the coordinates from the path's, m."""
        return values - np.array([there for _, there in self._wanted])

    def combined(self, values: Array) -> tuple[float, Array]:
        left = self.residuals(values)
        value = float(np.sqrt(left @ left / len(self.target)))
        return value, left / (len(self.target) * value) if value else np.zeros_like(left)

    def squares(self, values: Array, slopes: Array) -> Squares:
        return Squares.of(self.residuals(values), slopes, 1.0, self.sigma)
