"""Series of requested values, as they are typed."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from typing import Any


class SeriesError(ValueError):
    """A text that is no series of values; the message is a sentence for the user."""


def floats(parts: Iterable[Any]) -> list[float]:
    """Numbers or their texts as floats.

    Raises:
        TypeError, ValueError: One is none. True is none either, though Python would take it for 1.
    """
    found = list(parts)
    if any(isinstance(part, bool) for part in found):
        raise TypeError("true is no number here")
    return [float(part) for part in found]


def series(text: Any, what: str) -> tuple[float, ...]:
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
        parts: list[Any] = [part.strip() for part in text.split(separator)]
    elif isinstance(text, list | tuple):
        separator, parts = ",", list(text)
    else:
        separator, parts = ",", [text]
    try:
        numbers = floats(parts)
    except (TypeError, ValueError):
        raise SeriesError(f"{what} {text!r} is not numbers; write 0:177, 0:177:10 or 0,70,130,177") from None
    if not all(math.isfinite(number) for number in numbers):
        raise SeriesError(f"{what} {text!r} holds a value that is not finite")
    if separator == ":":
        numbers = _range(numbers, str(text), what)
    for before, after in itertools.pairwise(numbers):
        if after == before:
            raise SeriesError(f"{what} {after:g} is requested twice")
        if after < before:
            raise SeriesError(f"{what} falls from {before:g} to {after:g}; give the values from low to high")
    if numbers and numbers[0] < 0:
        raise SeriesError(f"{what} {numbers[0]:g} is below zero; positive values inflate, and suction is not modelled")
    if numbers and numbers[-1] == 0:
        raise SeriesError(f"the only {what} requested is 0, where nothing happens")
    return tuple(numbers)


def _range(numbers: list[float], text: str, what: str) -> list[float]:
    if len(numbers) not in (2, 3):
        raise SeriesError(f"{what} {text!r}: a range is from:to or from:to:step")
    start, stop = numbers[:2]
    if len(numbers) == 2 or stop <= start:
        return [start, stop]
    step = numbers[2]
    if step <= 0:
        raise SeriesError(f"{what} {text!r}: the step must be above zero")
    count = (stop - start) / step
    if count > 10000:
        raise SeriesError(f"{what} {text!r} asks for {count:.0f} values; use a larger step")
    inner = [start + step * i for i in range(math.floor(count * (1 - 1e-12)) + 1)]
    return [*(value for value in inner if value < stop), stop]
