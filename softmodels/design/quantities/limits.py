"""Limit and bifurcation pressures, and their margins to the working pressure."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, ClassVar

from softmodels.design.quantities.base import DesignQuantity, Measure, register_quantity

if TYPE_CHECKING:
    from softmodels.design.body import DesignedBody


@dataclasses.dataclass(frozen=True, kw_only=True)
class OfLimit(DesignQuantity):
    """A quantity of the limit point."""

    of_state: ClassVar = False
    margin: ClassVar = False
    """Whether it is relative to the highest working pressure."""

    def factor(self, working: float) -> float:
        """By which the limit pressure in Pa is multiplied; ``working`` is the highest working pressure."""
        return 1.0 / working if self.margin else 1.0

    def measure(self, design: DesignedBody) -> Measure:
        raise TypeError("a quantity of the limit point needs only that point")


@dataclasses.dataclass(frozen=True, kw_only=True)
class OfBifurcation(OfLimit):
    """A quantity of the first bifurcation."""


@register_quantity
@dataclasses.dataclass(frozen=True, kw_only=True)
class BifurcationPressure(OfBifurcation):
    """Pressure at the first bifurcation."""

    name: ClassVar = "bifurcation_pressure"
    unit: ClassVar = "Pa"
    help: ClassVar = "pressure at the first bifurcation, where the device buckles out of its symmetric shape"


@register_quantity
@dataclasses.dataclass(frozen=True, kw_only=True)
class BifurcationMargin(OfBifurcation):
    """Bifurcation pressure over the highest working pressure."""

    name: ClassVar = "bifurcation_margin"
    unit: ClassVar = "1"
    help: ClassVar = "pressure at the first bifurcation over the highest working pressure"
    margin: ClassVar = True


@register_quantity
@dataclasses.dataclass(frozen=True, kw_only=True)
class LimitPressure(OfLimit):
    """Pressure at the first limit point."""

    name: ClassVar = "limit_pressure"
    unit: ClassVar = "Pa"
    help: ClassVar = "pressure at the first limit point, where the device balloons"


@register_quantity
@dataclasses.dataclass(frozen=True, kw_only=True)
class LimitMargin(OfLimit):
    """Limit pressure over the highest working pressure."""

    name: ClassVar = "limit_margin"
    unit: ClassVar = "1"
    help: ClassVar = "limit pressure over the highest working pressure"
    margin: ClassVar = True
