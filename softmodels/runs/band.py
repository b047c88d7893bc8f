"""The first-order 95 % band of a path due to the errors of a fitted material.

A state moves with the material's parameters by the derivatives of its equilibrium (`mechanics.sensitivity`). The width of a
band depends on the quantity that stays fixed:

- At the same pressure (or other requested value) rises and volumes have a band: the state slides along the path by
  the change of pressure. It grows without bound near a limit point.
- At the same added volume the pressure has a band. It stays regular at a limit point, where it is the band of the limit.
- At the same rise the pressure has another band: the horizontal distance between the curves of rise over pressure. Pressures
measured
  at a given height compare with it. A stiffer silicone also needs another volume for the same height.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from softmodels.case.case import Case
from softmodels.case.materials import MaterialErrors, SourceBand
from softmodels.common.arrays import Array
from softmodels.common.files import replace
from softmodels.materials.silicones import named, silicone_called, source_names
from softmodels.mechanics.controls import volume_control
from softmodels.mechanics.newton import NoConvergence
from softmodels.path.points import AddedVolume, DeadForce, Point, Pressure
from softmodels.runs.columns import state_labels
from softmodels.runs.fields import Fields
from softmodels.runs.row import Cell, Row, at_rise, split

DEVIATIONS = 1.959964
"""Half width of a 95 % interval in standard deviations."""
TOLERANCE = 1e-6
"""Tolerance of the linear solver."""
SMALL = 1e-3
"""Finite-difference step for the device's own figures, in standard deviations."""


class Band:
    """Bands of a device's states.

    Args:
        fields: The device.
        errors: Of its material.
        pascal_per_cm: Pa in one cm of the column.
        kept: What is requested, at the same value of which rises are told: ``"pressure"``, ``"volume"``, or the ``"force"`` of
            dead loads, such as shares of the weight.
    """

    def __init__(self, fields: Fields, errors: MaterialErrors, pascal_per_cm: float, kept: str = Pressure.name):
        self.fields, self.errors, self.cm, self.kept = fields, errors, pascal_per_cm, kept
        from softmodels.mechanics.sensitivity import Sensitivity

        self._sensitivity = Sensitivity(fields.solver)

    def cells(self, point: Point) -> dict[str, float | None]:
        """Half widths of the 95 % intervals at a point of the path, by column of ``path.csv``; None if undefined.

        Called by all ranks.
        """
        try:
            moves = [] if point.bifurcation else [self._move(point, root) for root in self.errors.roots.T]
        except NoConvergence:
            moves = []
        if not moves:
            return dict.fromkeys(self._columns())
        found = {name: np.array([move[name] for move in moves]) for name in moves[0]}
        at_rest = point.state.P == 0.0 and self.fields.rest_volume == point.state.V
        widths = {
            name: 0.0 if at_rest else DEVIATIONS * float(np.linalg.norm(values)) for name, values in found.items()
        }
        return {name: width if math.isfinite(width) else None for name, width in widths.items()}

    def _columns(self) -> list[str]:
        actuator = self.fields.system.body.actuator
        figures = actuator.device_figures(actuator.probes)
        rises = [*(_named(f"{probe}_mm") for probe in actuator.probes), *map(_named, figures)]
        if self.kept == DeadForce.name:
            return rises
        return ["pressure_ci95_cm", at_rise(actuator.gauge), "added_volume_ci95_ml", *rises]

    def _move(self, point: Point, root: Array) -> dict[str, float]:
        """Return the changes by column if the parameters change by ``root`` (SI units)."""
        eq, fields, state = self.fields.system, self.fields, point.state
        eq.load(state)
        force, dmu = np.zeros(eq.n), 0.0
        for name, change in zip(self.errors.names, root, strict=True):
            own, slope = self._sensitivity.material_force(name)
            force += change * own
            dmu += change * slope
        mu, forced = eq.stress_unit, self.kept == DeadForce.name
        if forced:  # P is a dead load, already fixed in newtons; the cavities' pressures are fixed too
            cavities = len(eq.volumes())
            force += dmu / mu * eq.pressures[:cavities] @ eq.pressure_loads()[:cavities]
        moved = fields.solver.aside(state, volume_control(state.V), -force, TOLERANCE)
        dP, w, dV = moved.P * mu + (0.0 if forced else state.P * dmu), moved.w, 0.0
        sideways = math.nan if forced else dP - self._slope(point) * self._gauge_rise(moved.w)
        if self.kept != AddedVolume.name:
            slide = -dP / (mu * point.tangent.P) if point.tangent.P else math.inf
            w = w + slide * point.tangent.w
            dV = slide * point.tangent.V * eq.volume_unit
        if forced:
            return self._rises(state.w, w)
        gauge = fields.system.body.actuator.gauge
        pressures = {"pressure_ci95_cm": dP / self.cm, at_rise(gauge): sideways / self.cm}
        return {**pressures, "added_volume_ci95_ml": 1e6 * dV, **self._rises(state.w, w)}

    def _slope(self, point: Point) -> float:
        """Return Return the pressure in Pa by which the pressure rises along the path for each m of the gauge's rise."""
        rise = self._gauge_rise(point.tangent.w)
        return point.tangent.P * self.fields.system.stress_unit / rise if rise else math.inf

    def _gauge_rise(self, change: Array) -> float:
        """Return the gauge's rise in m for a change of the dofs."""
        actuator = self.fields.system.body.actuator
        return float(self.fields.probes_moved(change)[actuator.gauge] @ np.asarray(actuator.lift))

    def _rises(self, w: Array, change: Array) -> dict[str, float]:
        """Return the changes of the probes' rises in mm and of the device's own figures for a change of the dofs."""
        fields, actuator = self.fields, self.fields.system.body.actuator
        shifts = fields.probes_moved(change)
        found = {_named(f"{name}_mm"): 1e3 * float(shift @ np.asarray(actuator.lift)) for name, shift in shifts.items()}
        if not all(np.isfinite(shift).all() for shift in shifts.values()):
            return found | {_named(name): math.inf for name in actuator.device_figures(actuator.probes)}
        now = fields.probes_moved(w)
        ends = []
        for sign in (1.0, -1.0):
            places = {
                name: np.asarray(actuator.probes[name]) + now[name] + sign * SMALL * shifts[name] for name in shifts
            }
            ends.append(actuator.device_figures({name: (p[0], p[1], p[2]) for name, p in places.items()}))
        return found | {_named(name): (ends[0][name] - ends[1][name]) / (2 * SMALL) for name in ends[0]}


def _named(column: str) -> str:
    """Return the column of another column's band: ``apex_ci95_mm`` of ``apex_mm``."""
    name = split(column)[0]
    return f"{name}_ci95{column.removeprefix(name)}"


# ----------------------------------------------------------------------------------------------------------------------
# The paths of a device for every source of its silicone: the file ``sources.csv`` and a summary.


type SourceRows = Mapping[str, Sequence[Row]]
"""Rows of ``path.csv`` of each source by its name, from the softest to the stiffest."""

FILE = "sources.csv"
WORDS = ("control",)
"""Columns of words."""


def write_sources(folder: Path, sources: SourceRows) -> None:
    """Write the table: the source, then the columns of ``path.csv`` without those of an error's band."""
    rows = [(name, row) for name, many in sources.items() for row in many]
    columns = list(dict.fromkeys(column for _, row in rows for column in row))
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, ["source", *columns], lineterminator="\n")
    writer.writeheader()
    writer.writerows({"source": name, **row.cells} for name, row in rows)
    replace(folder / FILE, lambda path: path.write_text(text.getvalue(), encoding="utf-8"))


def read_sources(folder: Path) -> dict[str, list[Row]]:
    """Return the table's rows by source; empty where there is none, or none that can be read."""
    found: dict[str, list[Row]] = {}
    try:
        with (folder / FILE).open(newline="", encoding="utf-8") as file:
            for cells in csv.DictReader(file):
                found.setdefault(cells.pop("source"), []).append(Row({k: _cell(k, v) for k, v in cells.items()}))
    except (OSError, ValueError, KeyError):
        return {}
    return found


def _cell(column: str, text: str) -> Cell:
    return text if column in WORDS else float(text) if text else None


def in_order(case: Case, rows: Sequence[Row], others: SourceRows) -> dict[str, Sequence[Row]]:
    """Return all sources from the softest to the stiffest, the run's own path among them; empty where there are no others."""
    own = named(case.material)
    if own is None or not others:
        return {}
    every = {own: rows, **others}
    return {name: every[name] for name in source_names(own) if name in every}


def span_sentence(case: Case, sources: SourceRows) -> str:
    """Return the range over the sources of a silicone at the last value that all reach, and at their limits."""
    words, own = state_labels(case), named(case.material)
    common = _common(case, sources)
    parts = []
    if common:
        rows = {name: many[common[name]] for name, many in sources.items()}
        gauge = f"{words.gauge}_mm"
        here = rows[own or ""]
        place = words.place(here) if case.column == "pressure_cm" else f"{here[case.column]:.4g} {case.unit}"
        parts.append(f"at {place} the {words.gauge} rises {_ends(rows, gauge, 'mm')}")
        if words.volume and case.column != "added_volume_ml":
            parts.append(f"the cavity takes {_ends(rows, 'added_volume_ml', 'ml')}")
        if words.pressure and case.column != "pressure_cm":
            parts.append(f"the pressure is {_ends(rows, 'pressure_cm', 'cm')}")
    limits = {name: row for name, many in sources.items() if (row := next((r for r in many if r["limit"]), None))}
    if limits:
        none = [key_of(name) for name in sources if name not in limits]
        met = f" (none met with {', '.join(none)})" if none else ""
        parts.append(f"the limit point lies at {_ends(limits, 'pressure_cm', 'cm')}{met}")
    band = case.band.product if isinstance(case.band, SourceBand) else own
    return f"over the {len(sources)} sources of {band}, {'; '.join(parts)}" if parts else ""


def _common(case: Case, sources: SourceRows) -> dict[str, int]:
    """Return the row of each source at the last requested value that all of them reach; empty if they share none under load."""
    for value in sorted(case.values, key=abs, reverse=True):
        found: dict[str, int] = {}
        for name, rows in sources.items():
            there = [k for k, row in enumerate(rows) if math.isclose(row[case.column], value, rel_tol=1e-6)]
            if there:
                found[name] = there[0]
        if value and len(found) == len(sources):
            return found
    return {}


def _ends(rows: Mapping[str, Row], column: str, unit: str) -> str:
    ordered = sorted(rows, key=lambda name: rows[name][column])
    low, high = (f"{rows[name][column]:.4g} {unit} ({key_of(name)})" for name in (ordered[0], ordered[-1]))
    return low if len(rows) == 1 else f"{low} to {high}"


def key_of(name: str) -> str:
    """Return the short name of a source, of a product's plain name too."""
    found = silicone_called(name)
    return found.origin.key if found else name
