"""What ``softmodels limit`` reports: sentences, tables and the picture of the scatter."""

from __future__ import annotations

import csv
import dataclasses
import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from geometries.fields import shown
from softmodels.results.limits import LARGEST_STRETCH, Limit, Tolerance
from softmodels.results.writing import write_text

PERCENTILES = (5, 25, 50, 75, 95)

type Row = dict[str, str | float]
"""A row of ``limit.csv``."""
type Sampled = tuple[Mapping[str, float], Limit]
"""A device within the tolerances: its parameters and its limit."""


@dataclasses.dataclass(frozen=True)
class Column:
    """What pressures are counted in: Pa in one cm of the column, and the working pressure in cm, if there is one."""

    cm: float
    working: float | None


@dataclasses.dataclass(frozen=True)
class Scatter:
    """The devices within the tolerances."""

    tolerances: Sequence[Tolerance]
    sampled: Sequence[Sampled]

    @property
    def borne(self) -> tuple[str, list[Sampled]]:
        """What they bear: their limits; where none has one, the pressures of the largest stretch."""
        found = [one for one in self.sampled if one[1].found]
        stretched = [one for one in self.sampled if one[1].kind == "none"]
        if found or not stretched:
            return "limit pressure", found
        return f"pressure at a stretch of {LARGEST_STRETCH:g}", stretched


def row_of(name: str, found: Limit, column: Column) -> Row:
    """Row of a material's limit."""
    row: Row = {
        "material": name, "kind": found.kind, "limit_cm": found.pressure / column.cm, "limit_Pa": found.pressure,
        "added_volume_ml": found.added_volume * 1e6, **{f"{k}_mm": v * 1e3 for k, v in found.rises.items()},
        "max_stretch": found.stretch, **{f"{axis}_mm": x * 1e3 for axis, x in zip("xyz", found.place, strict=True)},
    }  # fmt: skip
    return row if column.working is None else {**row, "margin": found.pressure / column.cm / column.working}


def sentence(name: str, found: Limit, column: Column) -> str:
    """What a device bears in a material."""
    radius, height = float(np.hypot(found.place[0], found.place[1])) * 1e3, found.place[2] * 1e3
    place = f"largest stretch {found.stretch:.3g}, {radius:.3g} mm from the axis at height {height:.3g} mm"
    rises = ", ".join(f"{name} {rise * 1e3:+.4g} mm" for name, rise in found.rises.items())
    state = f"{rises}, {found.added_volume * 1e6:+.4g} ml; {place}"
    at = f"{found.pressure / column.cm:.4g} cm ({found.pressure / 1e3:.4g} kPa)"
    what = {
        "limit": f"limit pressure {at}: {state}",
        "bifurcation": f"leaves its shape (bifurcation) at {at}: {state}",
        "none": f"no limit up to a stretch of {LARGEST_STRETCH:g}, which it reaches at {at}: {state}",
        "lost": f"no limit up to {at}, where the path was lost ({found.why}): {state}",
    }[found.kind]
    text = f"{name}: {what}"
    if column.working is not None:
        margin = found.pressure / column.cm / column.working
        text += f"; {margin:.2f} times the working pressure, {'above' if margin > 1 else 'BELOW'} it"
    return text


def scatter_text(scatter: Scatter, column: Column) -> str:
    """How the limit scatters, and what moves it."""
    what, counted = scatter.borne
    count = len(scatter.sampled)
    if not counted:
        return f"none of the {count} devices within the tolerances has a limit"
    pressures = np.array([found.pressure / column.cm for _, found in counted])
    quantiles = np.percentile(pressures, PERCENTILES)
    text = f"{count} devices within the tolerances: {what} " + ", ".join(
        f"{q:.4g} cm ({p} %)" for p, q in zip(PERCENTILES, quantiles, strict=True)
    )
    text += f"; lowest {pressures.min():.4g} cm, highest {pressures.max():.4g} cm"
    if without := count - len(counted):
        text += f"; {without} have none or were not followed to it"
    if len(pressures) > len(scatter.tolerances) + 1:
        text += _effects(scatter.tolerances, counted, pressures, what)
    if column.working is not None:
        text += f"\n  {np.mean(pressures < column.working) * 100:.3g} % lie below the working pressure"
    return text


def _effects(
    tolerances: Sequence[Tolerance], counted: Sequence[Sampled], pressures: npt.NDArray[np.float64], what: str
) -> str:
    """Effect of each parameter, from all at once: one alone would take the others' scatter for its own."""
    values = [[_regressor(t, changes[t.name]) for t in tolerances] for changes, _ in counted]
    slopes = np.linalg.lstsq(values - np.mean(values, axis=0), np.log(pressures / pressures.mean()), rcond=None)[0]
    text = ""
    for t, slope in zip(tolerances, slopes, strict=True):
        more = shown(t.half, t.unit) if t.signed else "one percent"
        effect = 100 * np.expm1(slope) if t.signed else slope
        text += f"\n  {t.name.replace('_', ' ')}: {more} more changes the {what} by about {effect:+.2g} %"
    return text


def _regressor(tolerance: Tolerance, value: float) -> float:
    return (value - tolerance.middle) / tolerance.half if tolerance.signed else float(np.log(value))


def write(folder: Path, limits: Mapping[str, Limit], scatter: Scatter, column: Column) -> None:
    """Write ``limit.json`` and ``limit.csv``, and of a scatter its table and picture.

    Raises:
        OSError: The folder cannot be written.
    """
    table = [row_of(name, found, column) for name, found in limits.items()]
    write_text(folder / "limit.json", json.dumps(table, indent=2) + "\n")
    _csv(folder / "limit.csv", table)
    if not scatter.sampled:
        return
    _csv(folder / "scatter.csv", [{**changes, **row_of("", found, column)} for changes, found in scatter.sampled])
    what, counted = scatter.borne
    if counted:
        from softmodels.pictures.limit_pictures import scatter_figure

        pressures = [(changes, found.pressure / column.cm) for changes, found in counted]
        nominal = next(iter(limits.values())).pressure / column.cm
        figure = scatter_figure(pressures, scatter.tolerances, what, nominal, column.working)
        figure.savefig(folder / "scatter.png")


def _csv(path: Path, rows: Sequence[Row]) -> None:
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, fieldnames=list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_text(path, text.getvalue())
