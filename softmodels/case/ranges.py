"""Series of requested values, as they are typed."""

from __future__ import annotations

import itertools
import math

from measurement.units import UnitError, brief, numbers
from measurement.wording import Spoken


class SeriesError(Spoken, ValueError):
    """A text that is no series of values; the message is a sentence for the user."""


def series(text: object, what: str) -> tuple[float, ...]:
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
        raise SeriesError(
            f"{what} {brief(text)} is not numbers ({error}); write 0:177, 0:177:10 or 0,70,130,177"
        ) from None
    if separator == ":":
        values = _range(values, str(text), what)
    for before, after in itertools.pairwise(values):
        if after == before:
            raise SeriesError(f"{what} {after:g} is requested twice")
        if after < before:
            more = ", and decimals with a point" if isinstance(text, str) and "," in text else ""
            raise SeriesError(f"{what} falls from {before:g} to {after:g}; give the values from low to high{more}")
    if values and values[0] < 0:
        raise SeriesError(f"{what} {values[0]:g} is below zero; positive values inflate, and suction is not modelled")
    if values and values[-1] == 0:
        raise SeriesError(f"the only {what} requested is 0, where nothing happens")
    return tuple(values)


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
