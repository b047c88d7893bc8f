"""Series of requested values, as they are typed."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterable, Sequence

from measurement.common_units import FACTORS
from measurement.units import UnitError, brief, number, numbers, pascal_per_cm, quantity
from measurement.wording import Spoken, meant

ML = 1e-6
"""m3 in one ml."""
SHORT_PAIR = re.compile(r"(\d{1,2}),(\d{1,2})")
"""What may be two values, or one with a decimal comma."""


MAX_PRESSURE = 1e6
"""Pa; what is above is a mistake in the number or its unit, whatever silicone a device is of."""


class SeriesError(Spoken, ValueError):
    """A text that is no series of values; the message is a sentence for the user."""


class Typed(tuple[float, ...]):
    """Values as they were typed.

    Attributes:
        doubt: A sentence where the text may have meant something else; empty where it cannot, or nothing was typed.
    """

    doubt: str = ""


def _typed(values: Iterable[float], doubt: str) -> Typed:
    made = Typed(values)
    made.doubt = doubt
    return made


def series(text: object, what: str) -> Typed:
    """Requested values: ``"0:177"`` (from, to), ``"0:177:10"`` (from, to, step) or ``"0,70,130,177"``; or a list.

    Args:
        text: The text, or a sequence of numbers.
        what: ``"pressure"`` or ``"volume"``, for the messages.

    Returns:
        The values, rising; the end of a range is always among them.

    Raises:
        SeriesError: Not numbers, negative, not rising, or far too many.
    """
    if isinstance(text, str):
        separator = ":" if ":" in text else ","
        parts: list[object] = [part.strip() for part in text.split(separator)]
    elif isinstance(text, list | tuple):
        separator, parts = ",", list(text)
    else:
        separator, parts = ",", [text]
    try:
        values = numbers(parts)
    except UnitError as error:
        cure = _unit_at_the_end(separator, parts) or "write 0:177, 0:177:10 or 0,70,130,177"
        raise SeriesError(f"{what} {brief(text)} is not numbers ({error}); {cure}") from None
    if below := [value for value in (values[:2] if separator == ":" else values) if value < 0]:
        raise SeriesError(
            f"{what} {below[0]:g} is below zero; suction is not modelled, so give values from 0 upwards, such as 0,5,10"
        )
    if separator == ":":
        values = _range(values, str(text), what)
    for before, after in itertools.pairwise(values):
        if after == before:
            raise SeriesError(f"{what} {after:g} is requested twice")
        if after < before:
            more = ", and decimals with a point" if isinstance(text, str) and "," in text else ""
            raise SeriesError(f"{what} falls from {before:g} to {after:g}; give the values from low to high{more}")
    if values and values[-1] == 0:
        raise SeriesError(f"the only {what} requested is 0, where nothing happens")
    return _typed(values, _decimal_comma(text, what) if isinstance(text, str) else getattr(text, "doubt", ""))


def _decimal_comma(text: str, what: str) -> str:
    """A sentence on two short numbers with a comma between them, which may be one number; a leading zero alone is rest."""
    match = SHORT_PAIR.fullmatch(text.strip())
    if match is None or (match[1] == "0" and len(match[2]) > 1):
        return ""
    first, second = match.groups()
    return (
        f"{what} {text.strip()!r} is read as two values, {first} and {second}; decimals have a point, so write "
        f"{first}.{second} if that is meant, or {first}:{second} for both values without this note"
    )


def _unit_at_the_end(separator: str, parts: list[object]) -> str:
    """How values are written that have units of their own; empty where they have none."""
    pairs = [split_text(part) if isinstance(part, str) else ("", "") for part in parts]
    units = list(dict.fromkeys(unit for _, unit in pairs if unit))
    if not units or not all(value for value, _ in pairs):
        return ""
    if len(units) > 1:
        return f"give all values in one unit ({' or '.join(units)}), once, at the end"
    text = f"{separator.join(value for value, _ in pairs)} {units[0]}"
    pressure = factor_of(units[0], "Pa") is not None or units[0] == "cm"
    volume = factor_of(units[0], "m^3") is not None
    if not pressure and not volume:
        return ""
    if pressure:
        values = [value for value, _ in pairs]
        return _too_much(values, units[0]) or f"a unit stands once, at the end of a text: --pressure '{text}'"
    return f"a unit stands once, at the end of a text ('{text}'), and not behind volume_ml"


def _too_much(values: Sequence[str], unit: str) -> str:
    """The end of a sentence on pressures that no device of silicone takes; empty for others."""
    try:
        highest = max(map(number, values)) * (pascal_per_cm() if unit == "cm" else factor_of(unit, "Pa") or 0.0)
    except UnitError:
        return ""
    if highest <= MAX_PRESSURE:
        return ""
    return (
        f"and {highest / 1e3:.4g} kPa is too much: devices of silicone take 1 to 100 kPa, about 10 to 1000 cm of the column; "
        "write --pressure '0:30 kPa' or --pressure '0:300 cm'"
    )


def _range(numbers: list[float], text: str, what: str) -> list[float]:
    if len(numbers) not in (2, 3):
        raise SeriesError(f"{what} {brief(text)}: a range is from:to or from:to:step")
    start, stop = numbers[:2]
    if len(numbers) == 2 or stop <= start:
        return [start, stop]
    step = numbers[2]
    if step <= 0:
        raise SeriesError(f"{what} {brief(text)}: the step must be above zero")
    count = (stop - start) / step
    if count > 10000:
        raise SeriesError(f"{what} {brief(text)} asks for {count:.0f} values; use a larger step")
    inner = [start + step * i for i in range(math.floor(count * (1 - 1e-12)) + 1)]
    return [*(value for value in inner if value < stop), stop]


def of_text(unit: str, text: str, what: str, pascal_in_cm: float) -> Typed:
    """Requested values of a text with a unit behind it, such as ``"0:17 kPa"``, in cm of the column or in ml.

    Args:
        unit: ``"cm"`` or ``"ml"``.
        text: The text.
        what: ``"pressure"`` or ``"volume"``, for the messages.
        pascal_in_cm: Pa in one cm of the column.

    Raises:
        SeriesError: See `series`; a unit that is missing, unknown or of something else.
    """
    values, written = split_text(text)
    scale = _scale(unit, text, written, what, pascal_in_cm)
    read = series(values, what)
    return _typed((value * scale for value in read), read.doubt)


def one_of_text(unit: str, text: str, what: str, pascal_in_cm: float) -> float:
    """One value of a text with a unit behind it, as `of_text` has several."""
    value, written = split_text(text)
    scale = _scale(unit, text, written, what, pascal_in_cm)
    try:
        return quantity(value, "") * scale
    except UnitError as error:
        raise SeriesError(f"{what} {brief(text)}: {error}") from None


def _scale(unit: str, text: str, written: str, what: str, pascal_in_cm: float) -> float:
    if written == unit:
        return 1.0
    factor = factor_of(written, "Pa" if unit == "cm" else "m^3")
    if factor is None:
        examples = "0:177 cm or 0:17 kPa" if unit == "cm" else "0:60 ml"
        known = ["cm", *FACTORS["Pa"]] if unit == "cm" else FACTORS["m^3"]
        trouble = f"an unknown unit, {brief(written)}" if written else "no unit"
        raise SeriesError(
            f"{what} {brief(text)} has {trouble}; write it like {examples}, or give numbers in SI units{meant(written, known)}"
        )
    return factor / (pascal_in_cm if unit == "cm" else ML)


def split_text(text: str) -> tuple[str, str]:
    """The numbers of a text and the unit behind them; letters within a number are an exponent's."""
    match = re.fullmatch(r"\s*(.*?[\d.](?:[eE][+-]?\d+)?)?\s*([^\d\s.,:][^:,]*)?\s*", text)
    return (match[1] or "", (match[2] or "").strip()) if match else (text, "")


def factor_of(unit: str, si: str) -> float | None:
    """SI units in one of a unit; None if it is of another kind, or unknown."""
    try:
        return quantity(f"1 {unit}", si) if unit else None
    except UnitError:
        return None
