"""Text with a unit in, a plain number in SI units out.

Everything inside the project is SI; units live only where text is read or written. A bare number where a unit belongs is
refused, because a silent guess (metres? millimetres?) looks like a solver that diverges.
"""

from __future__ import annotations

import functools
import math

import pint

STANDARD_GRAVITY = 9.80665
"""Standard acceleration of gravity in m/s2 (CGPM 1901)."""

WATER_DENSITY = 970.0
"""Density in kg/m3 of the water in the thesis' column (section 4.1: 0.97 g/ml measured)."""


class UnitError(ValueError):
    """A text that is not a number with a fitting unit; the message is a sentence for the user."""


@functools.cache
def _registry() -> pint.UnitRegistry:
    return pint.UnitRegistry(cache_folder=None)


def quantity(text: str | float, unit: str) -> float:
    """Read a quantity such as ``"20 mm"`` and return its value in ``unit``.

    Args:
        text: Number and unit. A bare number is taken only where ``unit`` is empty (a ratio) or where it is 0.
        unit: Unit of the result in Pint's spelling, for example ``"m"`` or ``"Pa"``; ``""`` for a pure number.

    Raises:
        UnitError: No number, no unit where one is needed, a unit of another kind, or a value that is not finite.
    """
    shown = str(text).strip()
    example = {"m": "20mm", "Pa": "20kPa", "degree": "45deg", "kg/m^3": "970kg/m^3", "m^3": "20ml"}.get(
        unit, f"1 {unit}".strip()
    )
    try:
        parsed = _registry().Quantity(shown)
        value = float(parsed.to(unit or "dimensionless").magnitude)
    except pint.DimensionalityError:
        if _is_number(shown):
            if float(shown) == 0.0:
                return 0.0
            raise UnitError(f"{shown!r} has no unit; write it like {example}") from None
        raise UnitError(f"{shown!r} cannot be read in {unit or 'pure numbers'}; write it like {example}") from None
    except pint.UndefinedUnitError as error:
        raise UnitError(f"{shown!r} has an unknown unit ({error}); write it like {example}") from None
    except Exception:
        raise UnitError(
            f"{shown!r} is not a number{' with a unit; write it like ' + example if unit else ''}"
        ) from None
    if not math.isfinite(value):
        raise UnitError(f"{shown!r} is not a finite number")
    return value


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def pascal_per_cm(density: float = WATER_DENSITY) -> float:
    """Pressure in Pa of one centimetre of a column of liquid with this density in kg/m3."""
    return 0.01 * density * STANDARD_GRAVITY


_FRIENDLY = {"m": ("mm", 1e3), "Pa": ("kPa", 1e-3), "degree": ("deg", 1.0)}


def exact_text(value: float, unit: str) -> str:
    """The shortest friendly text ("20 mm", "30 kPa") that `quantity` reads back as exactly this value.

    Args:
        value: Value in ``unit``.
        unit: As in `quantity`; pure numbers have ``""``.
    """
    name, factor = _FRIENDLY.get(unit, (unit, 1.0))
    for digits in range(1, 18):
        rounded = float(f"{value * factor:.{digits}g}")  # "2e+01" becomes 20.0, which prints as a person writes it
        text = f"{rounded:.17g} {name}".strip()
        if quantity(text, unit) == value:
            return text
    # Not every float has a text in the friendlier unit that survives the conversion; those stay in their own.
    return f"{value!r} {unit}".strip()
