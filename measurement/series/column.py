"""The water column: readings in cm become pressures in Pa with a standard error.

Two upright tubes, joined below, hold water of a known density; one is open, the other joined to the actuator. The gauge
pressure inside is density x gravity x difference of the two levels.
"""

from __future__ import annotations

import dataclasses
import math

from measurement.units import STANDARD_GRAVITY, WATER_DENSITY, UnitError, brief, number_and_unit, quantity

READING_ERROR = 0.5e-3
"""Standard error in m of reading one level against a millimetre scale."""

DENSITY_ERROR = 10.0 / math.sqrt(12.0)
"""Standard error in kg/m3 of a density given as 0.97 g/ml: even chances over the last digit."""

WATER_UNITS = {"mmh2o": 9.80665, "cmh2o": 98.0665, "mmws": 9.80665, "cmws": 98.0665}
"""Conventional columns of water in Pa (1000 kg/m3, standard gravity): a gauge's unit, not a length read off a tube."""

FORMS = "write a column like 12.5 cm or a pressure like 1.2 kPa"

GAUGE_ERROR = 0.01
"""Relative standard error assumed of a pressure given in Pa without one, as of a simple gauge."""


class ColumnError(ValueError):
    """A reading that is no pressure; the message is a sentence for the user."""


@dataclasses.dataclass(frozen=True)
class Column:
    """A water column.

    Attributes:
        density: Density of its liquid in kg/m3.
        density_error: Its standard error in kg/m3.
        reading_error: Standard error of reading one level in m.
    """

    density: float = WATER_DENSITY
    density_error: float = DENSITY_ERROR
    reading_error: float = READING_ERROR

    def __post_init__(self) -> None:
        if not (math.isfinite(self.density) and self.density > 0.0):
            raise ColumnError(f"the density of the water column is {self.density:g} kg/m3; it must be positive")
        for name in ("density_error", "reading_error"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ColumnError(f"{name} of the water column is {value:g}; it must not be negative")

    def pressure(self, difference: float) -> tuple[float, float]:
        """Pressure and standard error in Pa of a difference of two levels in m; each level was read once."""
        levels = self.density * STANDARD_GRAVITY * self.reading_error * math.sqrt(2.0)
        share = STANDARD_GRAVITY * difference * self.density_error
        return self.density * STANDARD_GRAVITY * difference, math.hypot(levels, share)

    def read(self, text: str, error: str = "") -> tuple[float, float]:
        """Read a pressure written as a person does.

        Args:
            text: A difference of levels such as ``"12.5 cm"`` (at this column's density), or a pressure such as
                ``"1.2 kPa"`` or ``"35 mmH2O"``.
            error: Its standard error with a unit, a length or a pressure; empty for the default: two readings of the
                column, or 1 % of a pressure.

        Returns:
            Pressure and standard error in Pa.

        Raises:
            ColumnError: Not a number with such a unit, or a negative error.
        """
        value, is_length = _length_or_pressure(text)
        pressure, default = self.pressure(value) if is_length else (value, GAUGE_ERROR * abs(value))
        if not error.strip():
            return pressure, default
        given, is_length = _length_or_pressure(error)
        if given < 0.0:
            raise ColumnError(f"the error {error!r} is negative")
        if is_length:
            given = math.hypot(self.density * STANDARD_GRAVITY * given, self.density_error / self.density * pressure)
        return pressure, given

    def read_tubes(self, left: str, right: str, error: str = "") -> tuple[float, float]:
        """Read the levels of both tubes, such as ``"31.2 cm"`` and ``"18.7 cm"``; the higher one is the open tube.

        Returns:
            Pressure and standard error in Pa; the pressure is left minus right.

        Raises:
            ColumnError: A level that is not a length.
        """
        levels = [_level(text) for text in (left, right)]
        return self.read(f"{levels[0] - levels[1]!r} m", error)


def _level(text: str) -> float:
    value, is_length = _length_or_pressure(text)
    if not is_length and value != 0.0:
        raise ColumnError(f"{text!r} is not the level of a tube; write it like 31.2 cm")
    return value


def _length_or_pressure(text: str) -> tuple[float, bool]:
    """Value in m or Pa, and whether it is a length; a plain 0 is a length."""
    if not any(letter.isdigit() for letter in text):
        raise ColumnError(f"{brief(text.strip())} is no column of water and no pressure; {FORMS}")
    try:
        value, unit = number_and_unit(text)
    except UnitError as error:
        raise ColumnError(f"{error}; {FORMS}") from None
    pascal = WATER_UNITS.get(unit.lower().replace(" ", "").replace("_", ""))
    if pascal is not None:
        return value * pascal, False
    if not unit and value != 0.0:
        raise ColumnError(f"{brief(text.strip())} has no unit; {FORMS}")
    try:
        return quantity(text, "m"), True
    except UnitError:
        try:
            return quantity(text, "Pa"), False
        except UnitError:
            raise ColumnError(f"{brief(text.strip())} is no column of water and no pressure; {FORMS}") from None
