"""One state's row of ``path.csv``: numbers by their column's name, which ends in the unit."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import (
    ItemsView,
    Iterable,
    Iterator,
    KeysView,
    Mapping,
)
from typing import Literal, overload

Cell = float | str | None
"""What a row's file holds in a column: a number, a word, or nothing where the number is not known."""
Words = Literal["following"]
"""The columns of words."""


class Row:
    """A row. Columns are those of its run, so a column that only some runs have is asked for by `get` or ``in``.

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
        """The number in a column, or another one where this run has no such column."""
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
        """Names of the columns, in the order of the file."""
        return self._cells.keys()

    def items(self) -> ItemsView[str, Cell]:
        """Columns and what the file holds in them."""
        return self._cells.items()

    @property
    def cells(self) -> dict[str, Cell]:
        """What the file holds: a dict that JSON and CSV take."""
        return dict(self._cells)


# ----------------------------------------------------------------------------------------------------------------------
# What a column of ``path.csv`` is in words: unit, short name and meaning.


UNITS = {
    "N_per_m": "N/m", "Pa_per_mm2": "Pa/mm²", "per_m": "1/m", "cm": "cm", "mm": "mm", "ml": "ml", "Pa": "Pa", "kPa": "kPa",
    "mJ": "mJ", "Nmm": "N mm", "N": "N", "deg": "°",
}  # fmt: skip
"""How a column's name ends, the longer before the shorter, and the unit."""


@dataclasses.dataclass(frozen=True)
class ColumnText:
    """A column: its short name, its unit ("" for a number) and what it is, a sentence without its stop."""

    name: str
    unit: str
    text: str

    def told_of(self, supply: str) -> ColumnText:
        """The same with what drives the air in place of ``{supply}``."""
        return ColumnText(self.name.replace("{supply}", supply), self.unit, self.text.replace("{supply}", supply))

    def __str__(self) -> str:
        return f"{self.name} ({self.unit})" if self.unit else self.name


AT_POINTS = "over all integration points of the cells, of the whole device and not only of what a picture shows"
"""Where the largest stretch and stress are taken: the one definition that every table, picture and message uses."""


def split(column: str) -> tuple[str, str]:
    """A column's name without its unit, and the unit: ``apex_mm`` is ("apex", "mm")."""
    for ending, unit in UNITS.items():
        if column.endswith(f"_{ending}"):
            return column.removesuffix(f"_{ending}"), unit
    return column, ""


def described(column: str, texts: tuple[str, str]) -> ColumnText:
    """The term of a column from its short name and its meaning."""
    return ColumnText(texts[0], split(column)[1], texts[1])


def at_rise(gauge: str) -> str:
    """Column of the pressure's 95 % band at the same rise of a device's gauge."""
    return f"pressure_at_{gauge}_95_cm"
