"""Loads at which a design is evaluated: a pressure, or an added volume where pressures are ambiguous."""

from __future__ import annotations

import dataclasses
import functools

from softmodels.common.units import UnitError, brief, quantity, readable

PRESSURE, VOLUME = "pressure", "volume"


@dataclasses.dataclass(frozen=True, order=True)
class JudgedLoad:
    """A state of a device by its load.

    Attributes:
        kind: "pressure" (the first state at that pressure) or "volume" (added to the cavity of the whole device).
        value: Pa or m3.
        text: How the user wrote it, such as "30 kPa" or "177 cm"; empty where it was a number.
    """

    kind: str
    value: float
    text: str = dataclasses.field(default="", compare=False)

    def __post_init__(self) -> None:
        if self.kind not in (PRESSURE, VOLUME):
            raise ValueError(f"load {self.kind!r} is not one of {PRESSURE}, {VOLUME}")

    @classmethod
    def of(cls, value: float | JudgedLoad) -> JudgedLoad:
        """Return a load unchanged; a number is a pressure in Pa."""
        return value if isinstance(value, JudgedLoad) else cls(PRESSURE, float(value))

    def __str__(self) -> str:
        return (
            readable(self.value, "Pa" if self.kind == PRESSURE else "ml")
            if self.kind == PRESSURE
            else f"{self.value * 1e6:.6g} ml"
        )


# ----------------------------------------------------------------------------------------------------------------------
# Errors of a design before anything is solved, and stops by the user.


class DesignError(ValueError):
    """Invalid input, detected before anything is solved; the message is for the user."""


class DesignStopped(Exception):
    """The user stopped the search; all evaluations are kept."""


# ----------------------------------------------------------------------------------------------------------------------
# Units of quantities: reading limits and showing values.


SPELLED = {"1": "", "m2": "m^2", "m3": "m^3", "deg": "degree", "kg/m3": "kg/m^3"}
"""Units in Pint's spelling, where it differs."""


def spelled(unit: str) -> str:
    """Return a unit as `softmodels.common.units.quantity` takes it."""
    return SPELLED.get(unit, unit)


def read(what: str, value: object, unit: str, bare: bool = True) -> float:
    """Return a value in SI units from a text with a unit, or from a number.

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
    """Return the SI value of a display unit: 0.001 for mm and m."""
    return quantity(f"1 {spelled(shown)}", spelled(unit)) if spelled(shown) else 1.0


def text(value: float, shown: str, unit: str, digits: int = 4) -> str:
    """Return a value as text, such as ``"12.3 mm"``."""
    return f"{value / factor(shown, unit):.{digits}g} {'' if shown == '1' else shown}".strip()


def shown_unit(unit: str) -> str:
    """Return the display unit of a parameter or quantity."""
    return {"m": "mm", "Pa": "kPa", "m3": "ml", "m^3": "ml", "degree": "deg", "kg": "g", "J": "mJ"}.get(unit, unit)
