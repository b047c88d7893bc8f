"""Read tip paths from tables: positions of a point over the pressure, from ``path.csv`` of a run or typed by hand."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from softmodels.common.arrays import Array
from softmodels.common.errors import reason
from softmodels.common.tables import Line, Worksheet, pick, read_sheets, records
from softmodels.common.units import UnitError, number, quantity

Row = tuple[float, float, float, float]

ENOUGH = 3
"""Minimum number of rows at requested pressures; with fewer, all rows are used."""
PRESSURE = re.compile(r"pressure[_ ]*[\[(]?([A-Za-z]+)[\])]?")
PLACE = re.compile(r"(?:(?!max_stretch)(\w+?)[_ ])?([xyz])[_ ]*[\[(]?([a-z]+)[\])]?")


def read_tip_path(file: Path, of: str, cm: float = 0.0) -> tuple[tuple[Row, ...], str]:
    """Return the rows of pressure in Pa and place in m (nan for missing columns), by rising pressure, and the point's
    name.

    Columns are named by what they have and its unit: ``pressure_kPa``, ``x_mm`` or ``tip_x_mm``; or the units stand in a row
    below the names. Rows at rest, and those
    from the highest pressure on, are left out: there a pressure has more than one place. Of a run's table those at the
    pressures that it was asked at are taken.

    Args:
        file: The table, a text or an Excel workbook.
        of: The point; empty for the only one in the table.
        cm: Pa of one centimetre of the case's column; 0 if it is not known.

    Raises:
        ValueError: No such table; a sentence.
    """
    sheet, rows = _rows(file)
    names = list(rows[0][1])
    pressure, unit = _pressure_column(file, names, cm)
    columns, of = _place_columns(file, names, of)
    table = []
    for line, row in rows:
        try:
            at = _value(row[pressure], unit, "Pa", cm)
            place = [
                _value(row[columns[axis][0]], columns[axis][1], "m", cm) if axis in columns else np.nan
                for axis in "xyz"
            ]
        except (UnitError, TypeError) as error:
            raise ValueError(f"{file}, {sheet.place(line)}: {error}") from None
        table.append([at, *place])
    kept = _rising(np.array(table), _asked([row for _, row in rows]))
    if not len(kept):
        raise ValueError(f"{file} has no row at a pressure above zero; a tip path needs at least one")
    return tuple((float(p), float(x), float(y), float(z)) for p, x, y, z in kept), of


def _rows(file: Path) -> tuple[Worksheet, list[tuple[int, dict[str, str]]]]:
    """Return the sheet, and its rows by their columns' names, with the units in a row below them if that has them."""
    try:
        sheets = read_sheets(file)
        chosen = pick(file, sheets, lambda sheet: _table(sheet.rows))
        if chosen is None:  # no sheet has a path: use the one with most columns for the message
            widest = max(sheets, key=lambda sheet: len(sheet.rows[0][1]) if sheet.rows else 0)
            chosen = widest, widest.rows
    except OSError as error:
        raise ValueError(f"{file} cannot be read: {reason(error)}") from None
    if len(chosen[1]) < 2:
        raise ValueError(
            f"{file} has no rows; a path needs a column of pressures and columns of positions, such as pressure_kPa, x_mm"
        )
    return chosen[0], records(chosen[1])


def _table(rows: Sequence[Line]) -> Sequence[Line] | None:
    """Return the names with their units and the rows below; None if there is no column of pressures or positions."""
    if not rows:
        return None
    ways = [rows]
    if len(rows) > 1:
        names = [f"{name} [{unit.strip(' []()')}]" for name, unit in zip(rows[0][1], rows[1][1], strict=False)]
        ways.append([(rows[0][0], names), *rows[2:]])
    for way in ways:
        names = [name.strip() for name in way[0][1]]
        if any(map(PRESSURE.fullmatch, names)) and any(map(PLACE.fullmatch, names)):
            return way
    return None


def _pressure_column(file: Path, names: Sequence[str], cm: float) -> tuple[str, str]:
    found = {match[1]: name for name in names if (match := PRESSURE.fullmatch(name))}
    for unit in ("Pa", *found):
        if unit in found and (unit != "cm" or cm):
            return found[unit], unit
    if "cm" in found:
        raise ValueError(f"{file} gives the pressure in cm of an unknown liquid; use pressure_Pa or pressure_kPa")
    raise ValueError(
        f"{file} has no column of pressures with its unit, such as pressure_kPa; it has {', '.join(names)}"
    )


def _place_columns(file: Path, names: Sequence[str], of: str) -> tuple[dict[str, tuple[str, str]], str]:
    """By axis the column and its unit, and the point's name."""
    points: dict[str, dict[str, tuple[str, str]]] = {}
    for name in names:
        if match := PLACE.fullmatch(name):
            points.setdefault(match[1] or "", {})[match[2]] = (name, match[3])
    chosen = of if of in points else "" if "" in points else next(iter(points)) if len(points) == 1 and not of else None
    if chosen is None:
        known = (
            f"it has {', '.join(names)}" if not points else f"it has positions of {', '.join(points)}; choose one (of)"
        )
        raise ValueError(
            f"{file} has no columns of positions{' of ' + of if of else ''}, such as {of or 'tip'}_x_mm or x_mm; {known}"
        )
    return points[chosen], chosen or of


def _value(text: str, unit: str, wanted: str, cm: float) -> float:
    if wanted == "Pa" and unit == "cm":
        return number(text) * cm
    return quantity(f"{number(text)!r} {unit}", wanted)


def _asked(rows: Sequence[Mapping[str, str]]) -> npt.NDArray[np.bool_]:
    """Return the rows at the requested pressures of a run; all rows of other tables."""
    return np.array([row.get("requested", "1") not in ("0", "0.0", "False") for row in rows])


def _rising(table: Array, asked: npt.NDArray[np.bool_]) -> Array:
    """Return the rows above zero up to the highest pressure, each pressure once."""
    last = int(np.argmax(table[:, 0])) + 1
    kept = np.arange(len(table)) < last
    kept &= (table[:, 0] > 0.0) & (table[:, 0] > np.r_[0.0, np.maximum.accumulate(table[:, 0])[:-1]])
    return table[kept & asked] if (kept & asked).sum() >= ENOUGH else table[kept]
