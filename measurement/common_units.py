"""Factors of the units that people write most, so that reading ``20mm`` need not start Pint.

Pint takes as long to start as all the rest of a command's options. Every factor is Pint's own, to the last digit, and what
is not here is asked of Pint, which also words what is wrong. A test holds the table against it.
"""

from __future__ import annotations

_LITRE = 0.0010000000000000002
"""In m^3 as Pint has it: a decimetre cubed."""
FACTORS: dict[str, dict[str, float]] = {
    "m": {"um": 1e-6, "µm": 1e-6, "mm": 1e-3, "cm": 1e-2, "m": 1.0},
    "m^2": {"mm^2": 1e-6, "cm^2": 1e-4, "m^2": 1.0},
    "m^3": {
        "ul": 1.0000000000000003e-9, "ml": 1.0000000000000002e-6, "l": _LITRE, "mm^3": 1e-9, "cm^3": 1.0000000000000002e-6,
        "m^3": 1.0,
    },
    "Pa": {
        "Pa": 1.0, "hPa": 100.0, "kPa": 1e3, "MPa": 1e6, "GPa": 1e9, "mbar": 100.0, "bar": 1e5, "N/mm^2": 1e6, "N/m^2": 1.0,
    },
    "degree": {"deg": 1.0, "degree": 1.0, "°": 1.0},
    "N": {"mN": 1e-3, "N": 1.0},
    "N*m": {"N*mm": 1e-3, "mN*m": 1e-3, "N*m": 1.0},
    "N/m": {"N/m": 1.0, "N/mm": 1e3, "kN/m": 1e3},
    "Pa/m": {"Pa/m": 1.0, "kPa/m": 1e3, "Pa/mm": 1e3, "kPa/mm": 1e6, "MPa/m": 1e6, "MPa/mm": 1e9},
    "kg": {"mg": 1e-6, "g": 1e-3, "kg": 1.0},
    "kg/m^3": {"kg/m^3": 1.0, "g/cm^3": 999.9999999999999, "g/ml": 999.9999999999999},
    "m/s^2": {"m/s^2": 1.0},
    "": {"%": 0.01},
}  # fmt: skip
"""By the unit that is wanted: how much of it one of a unit is."""
