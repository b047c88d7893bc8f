"""The commands of ``softmodels measure``: how they end, texts of their options as numbers, the progress bar.

- `setup`: the commands ``calibrate`` and ``setup``. `photos`: ``photos`` and ``demo``. `views`: the command ``view``. `space`:
  ``join``.
"""

from __future__ import annotations

import contextlib
import dataclasses
import re
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NoReturn

from measurement.screen.setup import SetupError, magnification as factor_of
from softmodels.common import commands, errors, files, processes, units
from softmodels.common.lazy import consoles, progress

EXIT_SOME_REJECTED = 3
"""Beside `commands.EXIT_FAILED` (nothing could be measured) and `EXIT_BAD_INPUT` (bad input): some photographs are left out."""


def stop(sentence: str, status: int = commands.EXIT_BAD_INPUT) -> NoReturn:
    """End the program with a sentence on standard error."""
    commands.tell(sentence)
    sys.exit(status)


def check_place(path: Path) -> None:
    """Stop before the work begins if a file cannot be written there."""
    if why := commands.trouble(path.parent):
        stop(f"{path} cannot be written: {why}")


def write_text(path: Path, text: str) -> None:
    """Write all of a file or nothing, whatever happens in between; stop where it cannot be written."""
    try:
        with files.replaced_whole(path) as aside:
            aside.write_text(text, encoding="utf-8")
    except OSError as error:
        stop(f"{path} cannot be written: {errors.reason(error)}", commands.status_of(error))


# ----------------------------------------------------------------------------------------------------------------------
# Texts of the commands' options as numbers.
#
# Each function raises `SetupError` or `UnitError` for a text that is none.


def magnification(lamp: str | None, screen: str | None) -> tuple[float, float]:
    """Return the magnification of the shadow and its standard error, from the texts of both distances."""
    if lamp is None and screen is None:
        return 1.0, 0.0
    if lamp is None or screen is None:
        raise SetupError("give both --lamp-distance and --screen-distance, or neither")
    (far, far_error), (near, near_error) = (with_error(text, length) for text in (lamp, screen))
    return factor_of(far, near, far_error, near_error)


def with_error(text: str, read: Callable[[str], float]) -> tuple[float, float]:
    """Return a value and its standard error from a text like "2m+-5cm", each read by itself; the error is 0 where none is
    given."""
    value, _, error = text.replace("±", "+-").partition("+-")
    return read(value), read(error) if error else 0.0


def known_point(text: str) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return a pixel and its place in m, from "100,200=9mm,18mm"."""
    pixel, _, place = text.partition("=")
    parts = place.split(",")
    if len(parts) != 2:
        more = "; separate numbers by commas, and write decimals with a point" if len(parts) > 2 else ""
        raise SetupError(f"{units.brief(text)} is not a known point; write it like 100,200=9mm,18mm{more}")
    return numbers(pixel, 2, "--point"), tuple(length(part) for part in parts)


def numbers(text: str, count: int, option: str) -> tuple[float, ...]:
    """So many plain numbers between commas."""
    try:
        values = tuple(units.number(part) for part in text.split(","))
    except units.UnitError:
        values = ()
    if len(values) != count or not all(abs(value) < 1e9 for value in values):
        more = "; write decimals with a point" if len(values) > count else ""
        raise SetupError(f"{option} needs {count} numbers between commas, not {units.brief(text)}{more}")
    return values


def pattern(text: str) -> tuple[int, int]:
    """Return the inner corners in a row and in a column, from "9x6"."""
    match = re.fullmatch(r"([0-9]{1,4})x([0-9]{1,4})", text.strip())
    if not match:
        raise SetupError(f"{units.brief(text)} is not a pattern; write the inner corners like 9x6")
    return int(match[1]), int(match[2])


def length(text: str) -> float:
    """Return a length in m."""
    return units.quantity(text, "m")


def per_metre(text: str) -> float:
    """Return the pixels per metre from "75px/mm"."""
    # A pixel is a count here; Pint's own pixel is a unit of its own.
    text_match = len(text) <= units.MAX_CHARACTERS and re.fullmatch(r"\s*([^a-z]+?)\s*(?:px|pixels?)?\s*/\s*(\w+)\s*", text)
    try:
        return units.quantity(f"{text_match[1]} {text_match[2]}^-1" if text_match else text, "1/m")
    except units.UnitError as error:
        why = f" ({error})" if isinstance(error, units.DecimalCommaError) else ""
        raise SetupError(
            f"{units.brief(text.strip())} is not a scale{why}; write pixels per length like 75px/mm or 75000px/m"
        ) from None


# ----------------------------------------------------------------------------------------------------------------------
# The bar that commands of the measurement show on a terminal while they work, or lines in a log.


@contextlib.contextmanager
def bar(words: str, total: int, quiet: bool) -> Iterator[Callable[[], None]]:
    """Show a bar with the time taken and left, in a log a line every `LOG_SECONDS`; yields a function to call at each of the
    steps."""
    console = consoles.Console(stderr=True, quiet=quiet)
    parts = (
        progress.TextColumn("{task.description}"), progress.BarColumn(), progress.MofNCompleteColumn(),
        progress.TimeElapsedColumn(), progress.TextColumn("left"), progress.TimeRemainingColumn(),
    )  # fmt: skip
    if not quiet and not console.is_terminal:
        yield _Lines(words, total).advance
        return
    with progress.Progress(*parts, console=console, disable=quiet, transient=True) as shown:
        task = shown.add_task(words, total=total)
        yield lambda: shown.advance(task)


LOG_SECONDS = 1.0


@dataclasses.dataclass
class _Lines:
    words: str
    total: int
    done: int = 0
    first: float = 0.0
    told: float = 0.0

    def advance(self) -> None:
        now, self.done = time.monotonic(), self.done + 1
        if self.done == 1:
            self.first = self.told = now  # the time of the start does not predict that of the steps
        elif now - self.told >= LOG_SECONDS:
            self.told = now
            left = (now - self.first) / (self.done - 1) * (self.total - self.done)
            processes.say(f"{self.words}: {self.done} of {self.total}{processes.time_left(left)}", err=True)
