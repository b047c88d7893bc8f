"""How a command of the measurement ends: its exit statuses, and one sentence where it failed."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import NoReturn

from measurement.ending import FAILED, bounded
from measurement.output_place import UNUSABLE, status_of, trouble
from measurement.own_files import replaced_whole
from measurement.reasons import reason
from measurement.terminal import say

DONE, SOME_REFUSED = 0, 3
"""Beside `FAILED` (nothing could be measured) and `UNUSABLE` (bad input): some photographs are left out."""

__all__ = ["DONE", "FAILED", "SOME_REFUSED", "UNUSABLE", "check_place", "stop", "write_text"]


def stop(sentence: str, status: int = UNUSABLE) -> NoReturn:
    """End the program with a sentence on standard error."""
    say(f"Error: {bounded(sentence)}", err=True)
    sys.exit(status)


def check_place(path: Path) -> None:
    """Stop before the work begins if a file cannot be written there."""
    if why := trouble(path.parent):
        stop(f"{path} cannot be written: {why}")


def write_text(path: Path, text: str) -> None:
    """Write all of a file or nothing, whatever happens in between; stop where it cannot be written."""
    try:
        with replaced_whole(path) as aside:
            aside.write_text(text, encoding="utf-8")
    except OSError as error:
        stop(f"{path} cannot be written: {reason(error)}", status_of(error))
