"""The table of a run: arrays in SI by the name of a variable, and the columns of ``path.csv`` that they are read from.

A column is named after its variable and its unit: ``apex_mm`` holds the variable ``apex``, which is in metres everywhere but
where it is written. What a variable is, and how it is computed, is registered in `softmodels.runs.columns`.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from softmodels.common import files, units
from softmodels.common.arrays import Array

if TYPE_CHECKING:
    from softmodels.case.case import Case
    from softmodels.mechanics.system import State
    from softmodels.runs.state_values import Sampling


class Row(Mapping[str, float]):
    """A state: numbers in SI by the name of the variable, in the order of the file; ``row["apex"]`` in m. A number that is not
    known is NaN, a word as it is. Use `get` or ``in`` for variables that only some runs have.

    Attributes:
        cells: The state as ``path.csv`` has it.
        cm: Pa in one cm of the case's column.
    """

    __slots__ = ("_places", "_shown", "cells", "cm")

    def __init__(self, cells: Mapping[str, Cell] | Iterable[tuple[str, Cell]], cm: float | None = None):
        self.cells: dict[str, Cell] = dict(cells)
        self.cm = units.COLUMN.pascal if cm is None else cm
        self._places, self._shown = _places(tuple(self.cells), self.cm)

    @classmethod
    def of(cls, values: Iterable[tuple[Variable, Cell | Mapping[str, Cell]]], cm: float) -> Row:
        """Return a row of variables with their values in SI."""
        return cls((item for variable, value in values for item in variable.cells(value, cm).items()), cm)

    def __reduce__(self) -> tuple[type[Row], tuple[dict[str, Cell], float]]:
        return Row, (self.cells, self.cm)

    def __getitem__(self, name: str) -> float:
        column, _, size = self._places[name]
        return self.cell(column) * size if size else self.cell(column)

    def get(self, name: str, default: float = 0.0) -> float:  # type: ignore[override]
        """Return a variable, or another number where this run has none of this name."""
        return self[name] if name in self._places else default

    def __contains__(self, name: object) -> bool:
        return name in self._places

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Row) and self.cells == other.cells

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return f"Row({self.cells!r})"

    def column(self, name: str) -> str:
        """Return the column of ``path.csv`` in which a variable is shown."""
        return self._shown[name]

    def unit(self, name: str) -> str:
        """Return the symbol of the unit in which a variable is shown."""
        return split(self._shown[name])[1]

    def cell(self, column: str) -> float:
        """Return the number in a column of ``path.csv``, NaN if it is not known."""
        value = self.cells[column]
        return math.nan if value is None else value  # type: ignore[return-value]

    @property
    def written(self) -> dict[str, float]:
        """The state by the columns of ``path.csv``, in their units; NaN where a number is not known."""
        return {column: self.cell(column) for column in self.cells}

    def shown(self, name: str) -> float:
        """Return a variable in the unit in which it is shown, NaN if it is not known; a pressure in cm of the column."""
        return self.cell(self._shown[name])

    def told(self, name: str, form: str = ".4g") -> str:
        """Return a variable with its unit, such as ``"12.34 mm"``."""
        return f"{self.shown(name):{form}} {self.unit(name)}".rstrip()

    def told_with_error(self, name: str) -> str:
        """Return the same with half its 95 % interval where the row has its band: ``"12.34 ± 0.21 mm (95 %)"``."""
        if not math.isfinite(self.get(band := band_of(name), math.nan)):
            return self.told(name)
        return units.with_error(self.shown(name), self.shown(band), self.unit(name), "±") + " (95 %)"


class PathTable(Sequence[Row]):
    """The states of a path: ``table["apex"]`` is an array in SI over them, ``table[-1]`` a state, ``table[2:5]`` a part."""

    def __init__(self, rows: Iterable[Row] = ()):
        self._rows = list(rows)

    @classmethod
    def read(cls, cells: Iterable[Mapping[str, Cell]], cm: float | None = None) -> PathTable:
        """Return the table of rows as ``path.csv`` has them; ``cm`` is Pa in one cm of the case's column."""
        return cls(Row(own, cm) for own in cells)

    @overload
    def __getitem__(self, key: str) -> Array: ...

    @overload
    def __getitem__(self, key: int) -> Row: ...

    @overload
    def __getitem__(self, key: slice) -> PathTable: ...

    def __getitem__(self, key: str | int | slice) -> Array | Row | PathTable:
        if isinstance(key, str):
            return np.array([row[key] for row in self._rows])
        return PathTable(self._rows[key]) if isinstance(key, slice) else self._rows[key]

    def __len__(self) -> int:
        return len(self._rows)

    def __iter__(self) -> Iterator[Row]:
        return iter(self._rows)

    def __contains__(self, key: object) -> bool:
        return key in (self._rows[0] if isinstance(key, str) and self._rows else self._rows)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, PathTable) and self._rows == other._rows

    __hash__ = None  # type: ignore[assignment]

    def append(self, row: Row) -> None:
        """Add a state."""
        self._rows.append(row)

    @property
    def names(self) -> list[str]:
        """The variables, in the order of the file; none without a state."""
        return list(self._rows[0]) if self._rows else []

    @property
    def columns(self) -> list[str]:
        """The columns of ``path.csv``."""
        return list(self._rows[0].cells) if self._rows else []

    def csv(self) -> str:
        """Return the file ``path.csv``."""
        return files.csv_text(self.columns, (map(row.cells.get, self.columns) for row in self._rows))

    def get(self, name: str, default: float = 0.0) -> Array:
        """Return a variable over the states, or another number where a state has none of this name."""
        return np.array([row.get(name, default) for row in self._rows])

    def shown(self, name: str) -> Array:
        """Return a variable over the states in the unit in which it is shown."""
        return np.array([row.shown(name) for row in self._rows])

    def where(self, holds: Callable[[Row], object] | str) -> PathTable:
        """Return the states for which something holds, or of which a variable that some runs have is not 0."""
        test = (lambda row: row.get(holds)) if isinstance(holds, str) else holds
        return PathTable(row for row in self._rows if test(row))


Cell = float | str | None
"""Cell of ``path.csv``: a number in the unit of its column, a word, or None if unknown."""


# ----------------------------------------------------------------------------------------------------------------------
# Variables, units of the files, and their SI values.


@dataclasses.dataclass(frozen=True)
class Unit:
    """A unit of files: its symbol there, that of SI, and one of it in SI; nan for the centimetre of a case's column."""

    symbol: str
    si: str
    size: float = 1.0

    def written(self, value: float, cm: float = math.nan) -> float:
        """Return a value in SI in this unit, its own number if it was written in it; ``cm`` is Pa in one cm of the column."""
        if self.si == "rad":
            return math.degrees(value)
        if isinstance(value, units.Amount) and value.unit == self.symbol:
            return value.number
        size = cm if math.isnan(self.size) else self.size
        return value * round(1 / size) if size < 1.0 else value / size if size != 1.0 else value


UNITS: Mapping[str, Unit] = MappingProxyType({
    "N_per_m": Unit("N/m", "N/m"), "Pa_per_mm2": Unit("Pa/mm²", "Pa/m²", 1e6), "ml_per_min": Unit("ml/min", "m³/s", 1 / 60e6),
    "per_m": Unit("1/m", "1/m"), "cm": Unit("cm", "Pa", math.nan), "mm": Unit("mm", "m", 1e-3), "ml": Unit("ml", "m³", 1e-6),
    "Pa": Unit("Pa", "Pa"), "kPa": Unit("kPa", "Pa", 1e3), "mJ": Unit("mJ", "J", 1e-3), "Nmm": Unit("N mm", "N m", 1e-3),
    "N": Unit("N", "N"), "deg": Unit("°", "rad", math.pi / 180), "mm2": Unit("mm²", "m²", 1e-6), "s": Unit("s", "s"),
})  # fmt: skip
"""By the ending of a column's name, longer endings first."""
NUMBER = Unit("", "")


def column_of(name: str, unit: str) -> str:
    """Return the column of a variable: ``apex_mm`` of ``apex`` in ``mm``; of a number its name."""
    return f"{name}_{unit}" if unit else name


@functools.cache
def parsed(column: str) -> tuple[str, Unit]:
    """Return the variable of a column, and the column's unit."""
    for ending, unit in UNITS.items():
        if column.endswith(f"_{ending}"):
            return column.removesuffix(f"_{ending}"), unit
    return column, NUMBER


def split(column: str) -> tuple[str, str]:
    """Return a column's name without its unit, and the unit's symbol: ``apex_mm`` is ("apex", "mm")."""
    name, unit = parsed(column)
    return name, unit.symbol


@dataclasses.dataclass(frozen=True, eq=False)
class Output:
    """A named field, column or figure of every state, the library's own or a user's, added by `register_output`."""

    name: str

    def __post_init__(self) -> None:
        for function in filter(callable, list(vars(self).values())[::-1]):
            object.__setattr__(self, "__module__", function.__module__)  # where another process finds it

    @property
    def key(self) -> str:
        """What it is called in the registry."""
        return self.name


@dataclasses.dataclass(frozen=True, eq=False)
class Variable(Output):
    """A variable of the run's table; or several of one unit, whose names depend on device and case.

    Attributes:
        name: Its name; of several a pattern of `re`.
        unit: The ending of its column in ``path.csv`` that is its unit, "" for a number.
        title, text: A short name, and a sentence without its stop; ``{0}`` is the pattern's first group.
        value: Its value in SI of a `softmodels.runs.columns.Solved`, on rank 0, None if that is not known; of several by name.
        present: Whether a case has it; None for all cases.
        measured: Instead of ``value``, the same of the state that is loaded, computed on all ranks.
    """

    unit: str
    title: str
    text: str
    value: Callable[[Any], Cell | Mapping[str, Cell]] | None = None
    present: Callable[[Case], bool] | None = None
    measured: Callable[[Sampling, State], float | Mapping[str, float]] | None = None

    @property
    def key(self) -> str:
        """Its column of ``path.csv``."""
        return column_of(self.name, self.unit)

    def cells[C: (float, Cell)](self, values: C | Mapping[str, C], cm: float = math.nan) -> dict[str, C]:
        """Return its columns with values in SI in their units; ``cm`` is Pa in one cm of the case's column."""
        unit = UNITS.get(self.unit, NUMBER)
        return {
            column_of(name, self.unit): unit.written(value, cm) if isinstance(value, int | float) else value
            for name, value in (values.items() if isinstance(values, Mapping) else [(self.name, values)])
        }

    def described(self, column: str) -> ColumnText | None:
        """Return what a column is, None if it is not one of this."""
        if (match := re.fullmatch(self.key, column)) is None:
            return None
        title, text = (words.format(*match.groups()) if match.groups() else words for words in (self.title, self.text))
        return described(column, (title, text))


@dataclasses.dataclass(frozen=True)
class ColumnText:
    """A column: its short name, its unit ("" for a number) and its meaning, a sentence without full stop."""

    name: str
    unit: str
    text: str

    def named_after(self, supply: str) -> ColumnText:
        """Return a copy with the name of the air supply instead of ``{supply}``."""
        return ColumnText(self.name.replace("{supply}", supply), self.unit, self.text.replace("{supply}", supply))

    def __str__(self) -> str:
        return f"{self.name} ({self.unit})" if self.unit else self.name


def described(column: str, texts: tuple[str, str]) -> ColumnText:
    """Return the term of a column from its short name and its meaning."""
    return ColumnText(texts[0], split(column)[1], texts[1])


def at_rise(gauge: str) -> str:
    """Return the variable of the pressure's 95 % band at the same rise of a device's gauge."""
    return f"pressure_at_{gauge}_ci95"


def band_of(name: str) -> str:
    """Return the variable of the 95 % band of another."""
    return f"{name}_ci95"


def part_of(name: str, cause: str) -> str:
    """Return the variable of one cause's share in the 95 % band of another."""
    return f"{band_of(name)}_{cause}"


# ----------------------------------------------------------------------------------------------------------------------
# Where each variable stands among the columns of a file.


Place = tuple[str, Unit, float]
"""A variable's column, the column's unit, and the SI value of one in it; 0 where it is taken as it is."""


@functools.lru_cache(maxsize=256)
def _places(columns: tuple[str, ...], cm: float) -> tuple[Mapping[str, Place], Mapping[str, str]]:
    """Return the place of each variable in a file's columns, and the column in which each is shown, the first one."""
    places: dict[str, Place] = {}
    shown: dict[str, str] = {}
    for column in columns:
        name, unit = parsed(column)
        if name in places and "cm" not in (unit.symbol, places[name][1].symbol):
            name, unit = column, NUMBER  # a point and an angle may have the same name
        size = cm if unit.symbol == "cm" else unit.size
        shown.setdefault(name, column)
        if name not in places or unit.symbol != "cm":  # pascals rather than their height of column
            places[name] = column, unit, 0.0 if size == 1.0 else size
    return MappingProxyType(places), MappingProxyType(shown)
