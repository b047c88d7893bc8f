"""Units of quantities: how their limits are read and their values are shown."""

from __future__ import annotations

import functools

from measurement.units import UnitError, brief, quantity
from softmodels.design.errors import DesignError

SPELLED = {"1": "", "m2": "m^2", "m3": "m^3", "deg": "degree", "kg/m3": "kg/m^3"}
"""Units of quantities in Pint's spelling, where that is another one."""


def spelled(unit: str) -> str:
    """A unit as `measurement.units.quantity` takes it."""
    return SPELLED.get(unit, unit)


def read(what: str, value: object, unit: str, bare: bool = True) -> float:
    """A value in SI units from a text with a unit, or from a number.

    Args:
        what: What it is of, for the message.
        value: The text or number.
        unit: Its SI unit.
        bare: Whether a number is taken for SI; in files a unit is needed.

    Raises:
        DesignError: Not of this kind.
    """
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        raise DesignError(f"{what} is {brief(value)}; it must be a {'text with a unit' if spelled(unit) else 'number'}")
    try:
        return quantity(value, "" if bare and not isinstance(value, str) else spelled(unit))
    except UnitError as error:
        raise DesignError(f"{what}: {error}") from None


@functools.cache
def factor(shown: str, unit: str) -> float:
    """SI units in one shown unit: 0.001 for mm and m."""
    return quantity(f"1 {spelled(shown)}", spelled(unit)) if spelled(shown) else 1.0


def text(value: float, shown: str, unit: str, digits: int = 4) -> str:
    """A value for people, such as ``"12.3 mm"``."""
    return f"{value / factor(shown, unit):.{digits}g} {'' if shown == '1' else shown}".strip()


def shown_unit(unit: str) -> str:
    """The unit in which people read a parameter or quantity."""
    return {"m": "mm", "Pa": "kPa", "m3": "ml", "m^3": "ml", "degree": "deg", "kg": "g", "J": "mJ"}.get(unit, unit)
