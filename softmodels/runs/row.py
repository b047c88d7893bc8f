"""A state's row of ``path.csv``: numbers by column name, which ends in the unit."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import ItemsView, Iterable, Iterator, KeysView, Mapping
from typing import Literal, overload

Cell = float | str | None
"""Cell of a row: a number, a word, or None if unknown."""
Words = Literal["control"]
"""Columns that hold a word."""


class Row:
    """A row with the columns of its run; use `get` or ``in`` for columns that only some runs have.

    Args:
        cells: Values by column, in the order of the file; None for a number that is not known, which reads as NaN.
    """

    __slots__ = ("_cells",)

    def __init__(self, cells: Mapping[str, Cell] | Iterable[tuple[str, Cell]]):
        self._cells: dict[str, Cell] = dict(cells)

    @overload
    def __getitem__(self, column: Words) -> str: ...  # type: ignore[overload-overlap]

    @overload
    def __getitem__(self, column: str) -> float: ...

    def __getitem__(self, column: str) -> float | str:
        value = self._cells[column]
        return math.nan if value is None else value

    def get(self, column: str, default: float = 0.0) -> float:
        """Return the number in a column, or another one where this run has no such column."""
        return self[column] if column in self._cells else default

    def __contains__(self, column: object) -> bool:
        return column in self._cells

    def __iter__(self) -> Iterator[str]:
        return iter(self._cells)

    def __len__(self) -> int:
        return len(self._cells)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Row) and self._cells == other._cells

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return f"Row({self._cells!r})"

    def keys(self) -> KeysView[str]:
        """Return the names of the columns, in the order of the file."""
        return self._cells.keys()

    def items(self) -> ItemsView[str, Cell]:
        """Return the columns and what the file holds in them."""
        return self._cells.items()

    @property
    def cells(self) -> dict[str, Cell]:
        """Contents of the file: a dict for JSON and CSV."""
        return dict(self._cells)


# ----------------------------------------------------------------------------------------------------------------------
# Descriptions of the columns of ``path.csv``: unit, short name and meaning.


UNITS = {
    "N_per_m": "N/m", "Pa_per_mm2": "Pa/mm²", "per_m": "1/m", "cm": "cm", "mm": "mm", "ml": "ml", "Pa": "Pa", "kPa": "kPa",
    "mJ": "mJ", "Nmm": "N mm", "N": "N", "deg": "°",
}  # fmt: skip
"""Unit by the ending of a column's name, longer endings first."""


@dataclasses.dataclass(frozen=True)
class ColumnText:
    """A column: its short name, its unit ("" for a number) and its meaning, a sentence without full stop."""

    name: str
    unit: str
    text: str

    def told_of(self, supply: str) -> ColumnText:
        """Return a copy with the name of the air supply instead of ``{supply}``."""
        return ColumnText(self.name.replace("{supply}", supply), self.unit, self.text.replace("{supply}", supply))

    def __str__(self) -> str:
        return f"{self.name} ({self.unit})" if self.unit else self.name


AT_POINTS = "over all integration points of the whole device, not only those shown in a picture"
"""Where the largest stretch and stress are taken, for every table, picture and message."""


def split(column: str) -> tuple[str, str]:
    """Return a column's name without its unit, and the unit: ``apex_mm`` is ("apex", "mm")."""
    for ending, unit in UNITS.items():
        if column.endswith(f"_{ending}"):
            return column.removesuffix(f"_{ending}"), unit
    return column, ""


def described(column: str, texts: tuple[str, str]) -> ColumnText:
    """Return the term of a column from its short name and its meaning."""
    return ColumnText(texts[0], split(column)[1], texts[1])


def at_rise(gauge: str) -> str:
    """Return the column of the pressure's 95 % band at the same rise of a device's gauge."""
    return f"pressure_at_{gauge}_ci95_cm"
