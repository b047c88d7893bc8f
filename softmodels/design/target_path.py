"""The path that a probe is to follow, from a table: pressures and places."""

from __future__ import annotations

import csv
import math
from pathlib import Path

from measurement.reasons import reason
from measurement.units import UnitError, number
from softmodels.design.errors import DesignError

Rows = tuple[tuple[float, float, float, float], ...]
AXES = ("x", "y", "z")
LENGTHS = {"mm": 1e-3, "m": 1.0}


def read_target(file: Path, of: str, cm: float) -> Rows:
    """Rows of pressure in Pa and place in m; nan where the table does not have a coordinate.

    Args:
        file: A CSV file with a column ``pressure_cm``, ``pressure_kPa`` or ``pressure_Pa`` and places in the device's axes such
            as ``x_mm`` or, as in ``path.csv``, ``tip_x_mm``. Of a run's table the requested states are taken; rows at rest are
            left out.
        of: The probe.
        cm: Pa in one cm of the column.

    Raises:
        DesignError: It cannot be read, or has no such columns.
    """
    try:
        with file.open(newline="", encoding="utf-8-sig") as stream:
            rows = list(csv.DictReader(stream))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise DesignError(
            f"the path {file} cannot be read ({reason(error) if isinstance(error, OSError) else error})"
        ) from None
    heads = list(rows[0]) if rows else []
    units = {"pressure_cm": cm, "pressure_kPa": 1e3, "pressure_Pa": 1.0}
    pressure = next((head for head in units if head in heads), None)
    found = {
        axis: (head, size)
        for axis in AXES
        for unit, size in LENGTHS.items()
        for head in (f"{axis}_{unit}", f"{of}_{axis}_{unit}")
        if head in heads
    }
    if pressure is None or not found:
        raise DesignError(f"the path {file} has no columns pressure_cm and x_mm, y_mm or z_mm (or {of}_x_mm and so on)")
    asked = [row for row in rows if row.get("requested") == "1"] or rows
    target = []
    try:
        for row in asked:
            here = number(row[pressure]) * units[pressure]
            if here > 0.0:
                x, y, z = (number(row[found[axis][0]]) * found[axis][1] if axis in found else math.nan for axis in AXES)
                target.append((here, x, y, z))
    except UnitError as error:
        raise DesignError(f"the path {file}: {error}") from None
    if not target:
        raise DesignError(f"the path {file} has no row under pressure")
    return tuple(target)
