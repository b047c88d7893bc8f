"""Values for reading: in the unit that suits their size, with the digits that suit their error."""

from __future__ import annotations

import math


def with_prefix(value: float, unit: str, error: float = math.nan) -> tuple[str, str]:
    """A value and its unit as texts: Pa as Pa, kPa or MPa by size, m as mm; digits that suit the standard error."""
    factor, name = 1.0, unit
    if unit == "Pa":
        size = abs(value)
        factor, name = (1e-6, "MPa") if size >= 1e6 else (1e-3, "kPa") if size >= 10.0 else (1.0, "Pa")
    if unit == "m":
        factor, name = 1e3, "mm"
    digits = 4
    if math.isfinite(error) and 0.0 < error < abs(value):
        digits = min(max(math.ceil(math.log10(abs(value) / error)) + 2, 2), 9)
    return f"{value * factor:.{digits}g}", name
