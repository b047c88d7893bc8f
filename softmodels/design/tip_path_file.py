"""Tip paths from tables: places of a point over the pressure, as ``path.csv`` of a run has them or as typed by hand."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from measurement.reasons import reason
from measurement.units import UnitError, number, quantity
from measurement.user_file import read_text

Array = npt.NDArray[np.float64]
Row = tuple[float, float, float, float]

ENOUGH = 3
"""Rows at the pressures that a run was asked at that are enough; with fewer all of its rows are taken."""
PRESSURE = re.compile(r"pressure[_ ]*[\[(]?([A-Za-z]+)[\])]?")
PLACE = re.compile(r"(?:(?!max_stretch)(\w+?)[_ ])?([xyz])[_ ]*[\[(]?([a-z]+)[\])]?")


def read_tip_path(file: Path, of: str, cm: float = 0.0) -> tuple[tuple[Row, ...], str]:
    """Rows of pressure in Pa and place in m (nan where there is no such column), by rising pressure, and the point's name.

    Columns are named by what they have and its unit: ``pressure_kPa``, ``x_mm`` or ``tip_x_mm``. Rows at rest, and those
    from the highest pressure on, are left out: there a pressure has more than one place. Of a run's table those at the
    pressures that it was asked at are taken.

    Args:
        file: The table, with commas or semicolons.
        of: The point; empty for the only one in the table.
        cm: Pa of one centimetre of the case's column; 0 if it is not known.

    Raises:
        ValueError: No such table; a sentence.
    """
    rows = _rows(file)
    names = list(rows[0])
    pressure, unit = _pressure_column(file, names, cm)
    columns, of = _place_columns(file, names, of)
    table = []
    for line, row in enumerate(rows, 2):
        try:
            at = _value(row[pressure], unit, "Pa", cm)
            place = [
                _value(row[columns[axis][0]], columns[axis][1], "m", cm) if axis in columns else np.nan
                for axis in "xyz"
            ]
        except (UnitError, TypeError) as error:
            raise ValueError(f"{file}, line {line}: {error}") from None
        table.append([at, *place])
    kept = _rising(np.array(table), _asked(rows))
    if not len(kept):
        raise ValueError(f"{file} has no row at a pressure above zero, so there is no path to follow")
    return tuple((float(p), float(x), float(y), float(z)) for p, x, y, z in kept), of


def _rows(file: Path) -> list[dict[str, str]]:
    try:
        text = read_text(file)
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"{file} cannot be read: {reason(error)}") from None
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    separator = ";" if lines and ";" in lines[0] else ","
    rows = [
        {str(name).strip(): value for name, value in row.items()} for row in csv.DictReader(lines, delimiter=separator)
    ]
    if not rows:
        raise ValueError(
            f"{file} has no rows; a path has a column of pressures and columns of places, such as pressure_kPa, x_mm"
        )
    return rows


def _pressure_column(file: Path, names: Sequence[str], cm: float) -> tuple[str, str]:
    found = {match[1]: name for name in names if (match := PRESSURE.fullmatch(name))}
    for unit in ("Pa", *found):
        if unit in found and (unit != "cm" or cm):
            return found[unit], unit
    if "cm" in found:
        raise ValueError(
            f"{file} has its pressure in cm of a column whose liquid is not known; give pressure_Pa or pressure_kPa"
        )
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
            f"it has {', '.join(names)}"
            if not points
            else f"it has places of {', '.join(points)}; name one of them (of)"
        )
        raise ValueError(
            f"{file} has no columns of places{' of ' + of if of else ''}, such as {of or 'tip'}_x_mm or x_mm; {known}"
        )
    return points[chosen], chosen or of


def _value(text: str, unit: str, wanted: str, cm: float) -> float:
    if wanted == "Pa" and unit == "cm":
        return number(text) * cm
    return quantity(f"{number(text)!r} {unit}", wanted)


def _asked(rows: Sequence[Mapping[str, str]]) -> npt.NDArray[np.bool_]:
    """Rows at the pressures that a run was asked at; all of a table that does not say."""
    return np.array([row.get("requested", "1") not in ("0", "0.0", "False") for row in rows])


def _rising(table: Array, asked: npt.NDArray[np.bool_]) -> Array:
    """The rows above zero up to the highest pressure, each pressure once."""
    last = int(np.argmax(table[:, 0])) + 1
    kept = np.arange(len(table)) < last
    kept &= (table[:, 0] > 0.0) & (table[:, 0] > np.r_[0.0, np.maximum.accumulate(table[:, 0])[:-1]])
    return table[kept & asked] if (kept & asked).sum() >= ENOUGH else table[kept]
