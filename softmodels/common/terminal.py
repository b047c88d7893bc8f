"""Sentences on a terminal: wrapped between words at its width; in a file or a pipe each stays one line."""

from __future__ import annotations

import os
import shutil
import sys
import textwrap
from typing import TextIO

COLUMNS = {"stdout": "SOFTMODELS_TERMINAL_OUT", "stderr": "SOFTMODELS_TERMINAL"}
"""Environment variables: columns of the terminal that a command has which has started the ranks, by their streams."""
NARROWEST = 20


def columns(name: str) -> int | None:
    """Return the columns of the terminal that a stream (``"stdout"`` or ``"stderr"``) writes to; None if it is no terminal."""
    if (given := os.environ.get(COLUMNS[name], "")).isdigit():
        return max(int(given), NARROWEST)
    stream: TextIO | None = getattr(sys, name)
    if stream is None or not stream.isatty():
        return None
    try:
        width = os.get_terminal_size(stream.fileno()).columns
    except (OSError, ValueError):
        width = shutil.get_terminal_size().columns
    return max(width or shutil.get_terminal_size().columns, NARROWEST)


def wrapped(text: str, width: int | None) -> str:
    """Return a text whose lines are broken between words, their further lines indented by two more than the first; whole for
    None."""
    if width is None:
        return text
    lines = []
    for line in text.split("\n"):
        indent = " " * (len(line) - len(line.lstrip()))
        lines += textwrap.wrap(
            line, width, subsequent_indent=f"{indent}  ", break_long_words=False, break_on_hyphens=False,
            replace_whitespace=False, drop_whitespace=True,
        ) or [""]  # fmt: skip
    return "\n".join(lines)


def say(text: str, err: bool = False) -> None:
    """Print a sentence to standard output, or to standard error."""
    name = "stderr" if err else "stdout"
    print(wrapped(text, columns(name)), file=getattr(sys, name), flush=True)


# ----------------------------------------------------------------------------------------------------------------------
# Names of files in pictures, as they are: matplotlib takes dollars for formulas and leaves some labels out of legends.


def plain(text: str) -> str:
    """Return a text that matplotlib shows letter by letter; what cannot be shown, such as a line's end, is a space."""
    shown = "".join(letter if letter.isprintable() else " " for letter in text).replace("$", r"\$")
    return f" {shown}" if shown.startswith("_") else shown
