"""TOML files of users: read with limits, so that a broken or giant one is a sentence and never a hang or a crash."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from softmodels.common.errors import reason
from softmodels.common.files import read_text
from softmodels.common.units import UnitError, brief, number

LARGEST = 2_000_000
"""Bytes: a setup with a thousand crossings of its grid has a hundred thousand."""
DEEPEST = 20
"""Tables and lists in each other; a case has three."""
LONGEST_LINE = 20_000
"""Characters in a line: a key of so many parts takes the parser minutes."""
MOST_PARTS = 100
"""Dots in a key, and so in what stands between commas and equals signs."""


class TomlError(ValueError):
    """An unusable file; the message continues the file's name: "is not valid TOML (...)"."""


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file; a byte order mark is left out.

    Raises:
        TomlError: It cannot be read, is no text, no TOML or larger than any file of ours.
    """
    try:
        text = read_text(path, LARGEST)
    except UnicodeDecodeError:
        raise TomlError("cannot be read (it is not UTF-8 text; save it in that encoding)") from None
    except (OSError, ValueError) as error:  # a name with a zero byte in it is a ValueError
        raise TomlError(f"cannot be read ({reason(error)})") from None
    return parse_toml(text)


def parse_toml(text: str) -> dict[str, Any]:
    """Parse TOML; whole numbers must fit into 64 bits, as TOML has it.

    Raises:
        TomlError: See `read_toml`.
    """
    for place, line in enumerate(text.splitlines(), 1):
        if len(line) > LONGEST_LINE:
            raise TomlError(
                f"is rejected: its line {place} has {len(line)} characters, but at most {LONGEST_LINE} are allowed"
            )
        if max(part.count(".") for part in re.split("[=,]", line)) > MOST_PARTS:
            raise TomlError(f"is rejected: a key in its line {place} has more than {MOST_PARTS} parts")
    try:
        tables = tomllib.loads(text.removeprefix("\ufeff"))
    except RecursionError:
        raise TomlError(f"is rejected: it nests more than {DEEPEST} lists or tables") from None
    except ValueError as error:  # TOMLDecodeError is one, and so is a whole number of 5,000 digits
        raise TomlError(f"is not valid TOML ({_first(error)})") from None
    _check(tables)
    return tables


def _first(error: ValueError) -> str:
    return "a whole number of thousands of digits" if "integer string" in str(error) else str(error)[:300]


def _check(tables: dict[str, Any]) -> None:
    """Look through all values, without recursion."""
    level: list[Any] = [tables]
    for _ in range(DEEPEST):
        level = [
            value
            for group in level
            for value in (group.values() if isinstance(group, dict) else group)
            if _plain(value) is None
        ]
        if not level:
            return
    raise TomlError(f"is rejected: it nests more than {DEEPEST} lists or tables")


def _plain(value: Any) -> Any:
    """Return a plain value; None for a list or a table."""
    if isinstance(value, dict | list):
        return None
    if isinstance(value, int) and not -(2**63) <= value < 2**63:
        raise TomlError(f"is not valid TOML (the whole number {brief(value)} does not fit into 64 bits)")
    return value


def numbers(value: Any) -> npt.NDArray[np.float64]:
    """Return a list of numbers, or of lists of them, as an array.

    Raises:
        UnitError: An entry is no number, but a text or true.
        ValueError: Its lists are of unlike lengths.
    """
    if not isinstance(value, list):
        raise ValueError(f"{brief(value)} is not a list of numbers")
    if value and all(isinstance(part, list) for part in value):
        return np.array([numbers(part) for part in value], dtype=np.float64)
    for part in value:
        if isinstance(part, str):
            raise UnitError(f"{brief(part)} is a text; it must be a number")
    return np.array([number(part) for part in value], dtype=np.float64)
