"""Parse texts with units into plain numbers in SI units.

Everything inside the project is SI; units live only where text is read or written. A bare number where a unit belongs is
refused, because a silent guess (metres? millimetres?) looks like a solver that diverges. So is all that is not one number
and one unit: Pint by itself drops commas (1,5mm would be 15 mm), multiplies numbers that stand side by side and evaluates
powers of any size. It gets only the unit, and that only where the unit is not a common one.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import re
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from softmodels.common import errors

if TYPE_CHECKING:
    import pint


class UnitError(ValueError):
    """A text that is not a number with a fitting unit; the message is for the user."""


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
        "psi": 6894.7572931683635,
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

STANDARD_GRAVITY = 9.80665
"""Standard acceleration of gravity in m/s2 (CGPM 1901)."""

WATER_DENSITY = 970.0
"""Density in kg/m3 of the water in the thesis' column (section 4.1: 0.97 g/ml measured)."""

MAX_CHARACTERS = 100
"""Characters of the longest quantity; the most precise float has 24."""

_NUMBER = r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"
_SPACES = r"[\s_'\u2019]"
_DECIMAL_COMMA = re.compile(rf"[+-]?[0-9]*,[0-9]+(?![0-9.,]|{_SPACES}[0-9])")
_NAME = r"(?:[^\W\d_]|[%°])\w*"
"""A unit's name, such as mm, % or cmH2O."""
_FACTOR = rf"\(*\s*{_NAME}(?:\s*(?:\^|\*\*)\s*-?[0-9]|[⁻]?[¹²³⁴])?\s*\)*(?:\s*(?:\^|\*\*)\s*-?[0-9])?"
_UNIT = re.compile(rf"{_FACTOR}(?:\s*[*/·⋅\s]\s*{_FACTOR})*")
_ANGLES = {"degree", "radian", "milliradian", "arcminute", "arcsecond", "turn", "gradian"}


class DecimalCommaError(UnitError):
    """A number with a comma in the place of its decimal point; the message is for the user."""


@functools.cache
def _registry() -> pint.UnitRegistry:
    import pint

    return pint.UnitRegistry(cache_folder=None)


def brief(value: object) -> str:
    """Return a value as a message shows it: its repr, cut where it is long; what it is, where it is no scalar."""
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, list | tuple) and len(value) > 8:
        return f"a list of {len(value)} entries"
    if isinstance(value, type):
        return f"the class {value.__name__}"
    try:
        text = repr(value)
    except Exception:  # integers of thousands of digits, lists in lists in lists, objects of anybody's
        return f"a value of the class {type(value).__name__} that cannot be shown"
    count = len(value) if isinstance(value, str) else len(text)
    text = text if isinstance(value, str) else " ".join(text.split())  # arrays have lines
    return text if count <= 80 else f"{text[:60]}… ({count} characters)"


def plain(value: Any) -> Any:
    """Return NumPy's numbers and arrays, and the columns of tables, as Python's numbers and lists, all else as it is;
    `UnitError` for masked values, which are none."""
    array = value.to_numpy() if hasattr(value, "to_numpy") else value
    if not hasattr(array, "tolist"):
        return value
    mask = getattr(array, "mask", None)
    if mask is not None and mask.any():
        raise UnitError(f"{brief(value)} has masked values, which are no numbers; leave them out, as .compressed() does")
    return array.tolist()


def number(value: Any) -> float:
    """Return a finite number from its text, or from a number, NumPy's too; `UnitError` for all else, such as a comma, spaces
    between digits, or a list."""
    value = plain(value)
    if isinstance(value, str):
        read, unit = _split(value, "a number")
        if unit:
            raise UnitError(f"{brief(value.strip())} is not a number")
        return read
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise UnitError(f"{brief(value)} is not a number")
    try:
        read = float(value)
    except OverflowError:
        read = math.inf
    if not math.isfinite(read):
        raise UnitError(f"{brief(value)} is not a finite number")
    return read


def numbers(parts: Iterable[Any]) -> list[float]:
    """Return the numbers or their texts as finite floats; `UnitError` if one is none. True is none either, though Python would
    take it for 1."""
    return [number(part) for part in parts]


FORMULA = "is a formula, not a number; save the workbook in a spreadsheet program to store its value"
"""What to say of a text that begins with ``=``."""


def number_and_unit(text: str) -> tuple[float, str]:
    """Return a quantity's number and the text of its unit, which may be empty and is not looked up; `UnitError` as
    `quantity`."""
    return _split(text, "a number with a unit")


def quantity(text: str | float, unit: str) -> float:
    """Read a quantity such as ``"20 mm"`` and return its value in ``unit``, in Pint's spelling, ``""`` for a pure number. A
    bare number is taken only as one, or where it is 0.

    Raises:
        UnitError: No number, a decimal comma, several numbers, no unit where one is needed, an unknown unit or one of
            another kind, or a value that is not finite.
    """
    hint = f"; write it like {example(unit)}" if unit else ""
    if isinstance(text, str):
        read, written = _split(text, "a number with a unit" if unit else "a number", hint)
    else:
        read, written = number(text), ""
    shown = brief(str(text).strip())
    if not written:
        if unit and read != 0.0:
            raise UnitError(f"{shown} has no unit{hint}")
        return read
    factor = FACTORS.get(unit, {}).get(written)
    value = read * factor if factor is not None else _converted_by_pint(read, written, unit, shown, hint)
    if not math.isfinite(value):
        raise UnitError(f"{shown} is not a finite number")
    return value


class Amount(float):
    """A value that remembers the number and the unit it was written with, such as 9512.45 Pa of ``"100 cm"``; a float to all
    that computes, whose results are plain floats."""

    number: float
    unit: str

    def __new__(cls, value: float, number: float, unit: str) -> Amount:
        made = super().__new__(cls, value)
        made.number, made.unit = number, unit
        return made

    def __getnewargs__(self) -> tuple[float, float, str]:  # type: ignore[override]
        return float(self), self.number, self.unit

    @property
    def text(self) -> str:
        """Its number and unit, to the last digit."""
        return f"{_plain(self.number)} {self.unit}".strip()


def as_amount(value: float) -> Amount:
    """Return a value with its text, that of a pure number where it has none."""
    return value if isinstance(value, Amount) else Amount(value, value, "")


def written(value: float) -> str:
    """Return a value for people as it was written, number and unit, six digits at most."""
    amount = as_amount(value)
    return f"{amount.number:g} {amount.unit}".strip()


def example(unit: str) -> str:
    """Return a quantity of a unit, as a message shows it."""
    return {"m": "20mm", "Pa": "20kPa", "degree": "45deg", "kg/m^3": "970kg/m^3", "m^3": "20ml", "N/m": "50kN/m",
            "m^2": "18mm^2", "kg": "20g"}.get(unit, f"1 {unit}".strip())  # fmt: skip


def _converted_by_pint(read: float, written: str, unit: str, shown: str, hint: str) -> float:
    """Return a number in one unit as one in another, by Pint; `UnitError` if the unit is unknown, or of another kind."""
    import pint

    known = _unit(written)
    if known is None:
        raise UnitError(f"{shown} has an unknown unit, {brief(written)}{hint}{errors.meant(written, FACTORS.get(unit, ()))}")
    try:
        if bool(_ANGLES & set(known._units)) != (unit == "degree"):  # to Pint an angle is a pure number
            raise pint.DimensionalityError(known, unit)
        return float(_registry().Quantity(read, known).to(unit or "dimensionless").magnitude)
    except (pint.PintError, ArithmeticError, TypeError, ValueError):
        raise UnitError(f"{shown} cannot be read in {unit or 'pure numbers'}{hint}") from None


def _split(text: str, what: str, hint: str = "") -> tuple[float, str]:
    shown = text.strip()
    if len(shown) > MAX_CHARACTERS:
        raise UnitError(f"{brief(shown)} is not {what}{hint}")
    match = re.fullmatch(rf"({_NUMBER})\s*(.*)", shown, re.DOTALL)
    if match is None or (match[2] and not _UNIT.fullmatch(match[2])):
        kind = DecimalCommaError if _DECIMAL_COMMA.match(shown) else UnitError
        raise kind(_reason(shown, what, hint))
    read = float(match[1])
    if not math.isfinite(read):
        raise UnitError(f"{brief(shown)} is not a finite number")
    return read, match[2]


def _reason(shown: str, what: str, hint: str) -> str:
    """Return why a text is no quantity."""
    if shown.startswith("="):
        return f"{brief(shown)} {FORMULA}"
    if _DECIMAL_COMMA.match(shown):
        more = f" (or {shown.replace(',', '')}, if it separates thousands)" if re.search(r",[0-9]{3}(?![0-9])", shown) else ""
        return f"{brief(shown)} has a decimal comma; write {shown.replace(',', '.')}{more}"
    if re.match(r"[+-]?[0-9][0-9.,]*,[0-9]", shown):
        return f"{brief(shown)} has commas between its digits; write the number without them, with a decimal point"
    if re.match(rf"[+-]?[0-9][0-9.]*{_SPACES}+[0-9]", shown):
        return (
            f"{brief(shown)} has a space or the like between its digits; write one number, such as "
            f"{re.sub(rf'(?<=[0-9]){_SPACES}+(?=[0-9])', '', shown)}"
        )
    if re.match(r"[+-]?(nan|inf)", shown, re.IGNORECASE):
        return f"{brief(shown)} is not a finite number"
    return f"{brief(shown)} is not {what}{hint}"


@functools.lru_cache(maxsize=256)
def _unit(text: str) -> Any:
    """Return Pint's unit of a text, or None if there is none."""
    try:
        return _registry().parse_units(text)
    except Exception:  # Pint's parser raises what Python's tokenizer does, and more
        return None


@dataclasses.dataclass(frozen=True)
class Column:
    """The column of liquid, of a density in kg/m3, whose heights are pressures for people."""

    density: float = WATER_DENSITY

    @property
    def pascal(self) -> float:
        """Pa in one of its unit."""
        return 0.01 * self.density * STANDARD_GRAVITY

    @property
    def unit(self) -> str:
        """The unit of its heights with its liquid: ``"cm, 0.97 g/ml"``."""
        return f"cm, {self.density / 1e3:.4g} g/ml"

    def text(self, pressure: float, form: str = ".4g") -> str:
        """Return the height of a pressure in Pa, such as ``"20 cm"``."""
        return f"{pressure / self.pascal:{form}} cm"

    def full(self, pressure: float, form: str = ".4g") -> str:
        """Return the same with the liquid, such as ``"20 cm, 0.97 g/ml"``."""
        return f"{pressure / self.pascal:{form}} {self.unit}"


COLUMN = Column()
"""The usual one."""


DENSITY_NOTE = "3 % less than water at 20 degC"
"""What the usual density of a column's liquid is, `WATER_DENSITY`, for texts that ask for another."""


HALF_WIDTH_95 = 1.959964
"""Half width of a 95 % interval in standard deviations."""


def with_error(value: float, half: float, unit: str, sign: str = "+-") -> str:
    """Return a value with half its interval, both in a unit, which stands once: ``"3.9132 +- 0.0057 mm"``."""
    return f" {sign} ".join(rounded(value, half)) + f" {unit}".rstrip()


def rounded(value: float, half: float) -> tuple[str, str]:
    """Return a value and half its interval to two digits of the latter (GUM, 7.2.6); zero has no sign."""
    digits = decimals(half)
    return f"{value:z.{digits}f}", f"{half:.{digits}f}"


def decimals(half: float) -> int:
    """Return the decimals that show two digits of half an interval; 4 if it is 0 or not finite."""
    return max(0, 1 - math.floor(math.log10(half))) if 0.0 < half < math.inf else 4


_FRIENDLY = {"m": ("mm", 1e3), "Pa": ("kPa", 1e-3), "degree": ("deg", 1.0), "m^3": ("ml", 1e6)}


def readable(value: float, unit: str) -> str:
    """Return a value in ``unit`` for people: "0.9 mm", "14 kPa", six digits at most (lengths of a metre and more stay in
    metres); for files that machines read back it is `exact_text`."""
    name, factor = _FRIENDLY.get(unit, (unit, 1.0))
    if unit == "m" and abs(value) >= 1.0:
        name, factor = unit, 1.0
    return f"{value * factor:.6g} {name}".strip()


def _plain(value: float) -> str:
    """Return the shortest text that reads back as the float: 0.7 and not 0.69999999999999996."""
    return repr(value).removesuffix(".0")


def exact_text(value: float, unit: str) -> str:
    """Return the shortest friendly text ("20 mm", "30 kPa") that `quantity` reads back as exactly this value."""
    name, factor = _FRIENDLY.get(unit, (unit, 1.0))
    for digits in range(1, 18):
        rounded = float(f"{value * factor:.{digits}g}")  # "2e+01" becomes 20.0, which prints as a person writes it
        text = f"{_plain(rounded)} {name}".strip()
        if quantity(text, unit) == value:
            return text
    # Not every float has a text in the friendlier unit that survives the conversion; those stay in their own.
    return f"{value!r} {unit}".strip()


# ----------------------------------------------------------------------------------------------------------------------
# Format values: unit prefix by size, digits by standard error.


def with_prefix(value: float, unit: str, error: float = math.nan) -> tuple[str, str]:
    """Return a value and its unit as texts: Pa as Pa, kPa or MPa by size, m as mm; digits by the standard error."""
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
