"""The variables of the table: name, unit of its column, description, and computation, each in one place.

Add a `softmodels.runs.table.Variable` by `register_output`, or an output field with its extremes. What they make is a
`softmodels.runs.table.PathTable`.
"""

from __future__ import annotations

import csv
import dataclasses
import functools
import itertools
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from geometries import Actuator
from softmodels.case import load
from softmodels.case.case import Case
from softmodels.common import files, units
from softmodels.materials import silicones
from softmodels.mechanics import component, mpi
from softmodels.path import schedule, stability, steps, supply
from softmodels.path.supply import Reservoir
from softmodels.runs import formats, state_values, table
from softmodels.runs.fields import OUTPUTS, Fields, Figures, OutputField, outputs, register_output

# ----------------------------------------------------------------------------------------------------------------------
# Variables of the table: name, description, and how each is computed from a state.


@dataclasses.dataclass(frozen=True, eq=False)
class Solved:
    """A state of a path with all data of its row, on rank 0.

    Attributes:
        nodal: Its nodal fields by name, SI units.
        number: How many rows come before.
        load_step: How many steps a program has come.
        band: Half widths of 95 % intervals by column, where errors are known; see `softmodels.runs.budget.Band`.
    """

    case: Case
    fields: Fields
    point: stability.Point
    figures: Figures
    nodal: Mapping[str, npt.NDArray[np.float64]]
    number: int
    load_step: float
    band: Mapping[str, table.Cell] = dataclasses.field(default_factory=dict)

    @property
    def pressure(self) -> float:
        """Pressure in Pa; for a program the one farthest from ambient."""
        return max(self.figures.cavity_pressures, default=0.0, key=abs) if self.case.program else self.figures.pressure

    @functools.cached_property
    def gap(self) -> state_values.Gap | None:
        """The least gap between the device's walls."""
        return self.fields.walls.least(self.nodal["displacement"])

    @property
    def overlaps(self) -> bool:
        """Whether walls pass through each other, or a facet of the surface is folded onto itself."""
        return (self.gap is not None and self.gap.overlaps) or self.fields.walls.folded(self.nodal["displacement"])


def record_of(
    case: Case, fields: Fields, point: stability.Point, number: int, reached: float, band: Mapping[str, table.Cell]
) -> formats.StateRecord:
    """Return what is stored of a point of the path; ``reached`` is the number of program steps taken, ``band`` has half widths
    by column. All ranks call it."""
    values = fields.values(point.state)
    figures, nodal = fields.figures(point.state, values), fields.nodal(point.state, values) or {}  # on rank 0 only
    mode = None if point.mode is None else fields.shape(point.mode)
    if mode is not None:
        nodal["mode"] = mode / np.abs(mode).max()
    solved = Solved(case, fields, point, figures, nodal, number, reached, band)

    def row() -> table.Row:
        present = (variable for variable in every_variable() if variable.present is None or variable.present(case))
        return table.Row.of(((variable, variable.value(solved)) for variable in present if variable.value), case.column.pascal)

    return formats.StateRecord(mpi.on_root(fields.system.comm, row), nodal, formats.restart_of(point))


def every_variable() -> list[table.Variable]:
    """Return all that are registered, then the extremes of other output fields."""
    extremes = [extreme for field in outputs(OutputField) for extreme in field.extremes if extreme.key not in OUTPUTS]
    return [*outputs(table.Variable), *extremes]


def term(column: str, device: Actuator | None = None, supply: str = "supply") -> table.ColumnText:
    """Return the description of a column of ``path.csv``; an unknown column is described by its own name. ``supply`` is in a
    word what drives the air."""
    # A column that is known by its whole name is not described by a pattern that fits it too, such as that of named gaps.
    exact = [variable for variable in every_variable() if variable.key == column]
    known = (
        exact[0].described(column)
        if exact
        else _figure_term(column, device) or _rise_term(column, device) or _band_term(column, device) or _named_term(column)
    )
    return (known or table.described(column, (table.split(column)[0].replace("_", " "), ""))).named_after(supply)


def of_cavities(row: table.Row, what: str) -> list[str]:
    """Return a variable of each cavity, such as ``pressure_1`` and ``pressure_2``; of a single cavity ``pressure``."""
    numbered = (f"{what}_{k}" for k in itertools.count(1))
    return list(itertools.takewhile(row.__contains__, numbered)) or [what]


def _height(solved: Solved) -> float:
    """Return the pressure in Pa, with its text if it is a requested height of the column."""
    requested = solved.point.state.P
    if isinstance(requested, units.Amount) and requested.unit == load.CM:
        return units.Amount(solved.pressure, requested.number, requested.unit)
    return solved.pressure


def _stroke(solved: Solved) -> float:
    """Return the stroke of the supply in m3."""
    V, P, curve = _on_supply(solved)
    return float(curve.value(V, P) * solved.fields.system.volume_unit)


def _on_supply(solved: Solved) -> tuple[float, float, stability.Supply]:
    """Return the dimensionless volume and pressure of a state, and the supply's curves."""
    eq, supply = solved.fields.system, solved.case.supply
    assert supply is not None
    cavity = solved.fields.rest_volume * eq.volume_unit
    curve = supply.control(cavity, eq.stress_unit, eq.volume_unit)
    return (cavity + solved.figures.added_volume) / eq.volume_unit, solved.figures.pressure / eq.stress_unit, curve


def _gas_energy(solved: Solved) -> float:
    supply, figures = solved.case.supply, solved.figures
    assert supply is not None
    cavity = solved.fields.rest_volume * solved.fields.system.volume_unit
    return supply.gas_energy(_stroke(solved), figures.added_volume, figures.pressure, cavity)


def _held(solved: Solved) -> int:
    V, P, curve = _on_supply(solved)
    return int(solved.point.stable_under(curve.line(V, P)))


def _of_each(name: str, values: Sequence[float]) -> dict[str, table.Cell]:
    """Return a variable of each cavity by name, where there are several."""
    return {f"{name}_{i}": value for i, value in enumerate(values, 1)} if len(values) > 1 else {}


def _rise_term(column: str, device: Actuator | None) -> table.ColumnText | None:
    probe, unit = table.split(column)
    if device is None or unit != "mm" or probe not in device.probes:
        return None
    return table.described(
        column, (f"rise of the {probe.replace('_', ' ')}", "displacement of that point along the device's lift")
    )


def _figure_term(column: str, device: Actuator | None) -> table.ColumnText | None:
    """Return the description of a figure of the device or a part, or of one of several variables."""
    if device is not None and column in device.figure_columns.values():
        name = next(name for name, own in device.figure_columns.items() if own == column)
        return table.described(column, device.figure_texts[name][1:])
    texts = [kind.figure_texts for kind in component.COMPONENTS.values()]
    if exact := next((known[column] for known in texts if column in known), None):
        return table.described(column, exact)
    parts = [table.Variable(pattern, "", *text) for known in texts for pattern, text in known.items()]
    terms = (variable.described(column) for variable in (*outputs(table.Variable), *parts) if variable.title)
    return next((term for term in terms if term is not None), None)


def _named_term(column: str) -> table.ColumnText | None:
    """Return the description of a point, an angle or a rigid part named by the user."""
    name, unit = table.split(column)
    if unit == "mm" and (match := re.fullmatch(r"(\w+)_([xyz])", name)):
        text = "for a named point its position in this state, for a rigid part the displacement of its centre"
        return table.described(column, (f"{match[1].replace('_', ' ')}, {match[2]}", text))
    if unit == "mm" and name.endswith("_off"):
        text = "distance of the tracked surface point from the named point, undeformed"
        return table.described(column, (f"{name.removesuffix('_off').replace('_', ' ')}, off the surface", text))
    if unit == "°":
        return table.described(
            column,
            (name.replace("_", " "), "named angle: the rotation of its line, or the angle between its two lines"),
        )
    return None


CAUSES = "half the 95 % confidence interval from the errors of material, lengths and readings"


def _band_term(column: str, device: Actuator | None) -> table.ColumnText | None:
    name, unit = table.split(column)
    whole, _, cause = name.partition("_ci95_")
    if cause and unit:
        own = term(f"{whole}{column.removeprefix(name)}", device)
        text = f"the share of the {cause.replace('_', ' ')} in half the 95 % interval"
        return table.described(column, (f"{cause.replace('_', ' ')} in the band of the {own.name}", text))
    if not name.endswith("_ci95") or not unit:
        return None
    if device is not None and name == table.at_rise(device.gauge):
        text = f"{CAUSES}, at the same rise of the {device.gauge}"
        return table.described(column, ("band of the pressure at equal rise", text))
    own = term(f"{name.removesuffix('_ci95')}{column.removeprefix(name)}", device)
    kept = "at the same added volume" if name == "pressure_ci95" else "at the same requested value"
    return table.described(column, (f"band of the {own.name}", f"{CAUSES}, {kept}"))


def _extremes(name: str) -> Sequence[table.Variable]:
    """Return the variables of an output field's least and largest values."""
    return next(field.extremes for field in outputs(OutputField) if field.name == name)


def _place_of_largest(axis: str) -> table.Variable:
    i = "xyz".index(axis)
    return table.Variable(
        f"max_stretch_{axis}", "mm", f"place of the largest stretch, {axis}", "in the undeformed device",
        lambda s: s.figures.max_stretch_at[i],
    )  # fmt: skip


def _break_margin(solved: Solved) -> float | None:
    limit = silicones.stretch_at_break(solved.case.material)
    return None if limit is None else limit / solved.figures.max_stretch


def _eigenvalue(solved: Solved) -> float | None:
    """Return the lowest eigenvalue in Pa/m2, with its number in Pa/mm2; None if it did not converge."""
    eq, lowest = solved.fields.system, solved.point.signature.lowest
    number = float(lowest * eq.stress_unit / (eq.length_unit * 1e3) ** 2)
    return None if math.isnan(lowest) else units.Amount(1e6 * number, number, table.UNITS["Pa_per_mm2"].symbol)


def _at_rest(case: Case) -> bool:
    """Return whether the states are equilibria."""
    return not case.inertia


def _by_strokes(case: Case) -> bool:
    return case.supply is not None and not case.supply.in_time


def _in_time(case: Case) -> bool:
    return case.supply is not None and case.supply.in_time


def _source(solved: Solved) -> supply.Source:
    """Return what the source of the supply does."""
    return schedule.source_at(solved.case.steps, solved.load_step)


def _source_pressure(solved: Solved) -> float | None:
    source = _source(solved)
    return None if source.flow is not None else source.pressure


def _flow(solved: Solved) -> float:
    """Return the flow from the source in m3/s at ambient pressure."""
    supply = solved.case.supply
    assert isinstance(supply, Reservoir)
    return supply.supplied(_source(solved), solved.figures.pressure)[0] / supply.ambient


_VARIABLES: tuple[table.Variable, ...] = (
    table.Variable("step", "", "step", "number of the state along the path, from rest", lambda s: s.number),
    table.Variable("pressure", "cm", "pressure",
           "of the air in the cavity, as the height of the column that balances it, of the load's water_density", _height),
    table.Variable("pressure", "Pa", "pressure", "the same in pascal, above ambient pressure", lambda s: s.pressure),
    table.Variable("added_volume", "ml", "added volume",
           "volume of the whole device's cavities minus that at rest; with pressure ratios, the work-conjugate of the "
           "common pressure", lambda s: s.figures.added_volume),
    table.Variable("stroke", "ml", "stroke", "volume that the {supply} has displaced or let in",
           _stroke, _by_strokes),
    table.Variable("source_pressure", "cm", "source pressure",
           "of the {supply}, as the height of the column that balances it", _source_pressure, _in_time),
    table.Variable("flow", "ml_per_min", "flow", "from the source towards the device, as volume at ambient pressure", _flow,
           _in_time),
    table.Variable("gas", "ml", "gas", "amount of gas in tubes, fittings and cavity, as its volume at ambient pressure",
           _stroke, _in_time),
    table.Variable("gas_energy", "mJ", "gas energy", "work stored in the gas of {supply}, tubes and cavity", _gas_energy,
           lambda case: case.supply is not None and case.supply.stores_energy),
    table.Variable("stroke_limit", "", "stroke limit",
           "1 where the stroke has a limit point: beyond it the device snaps through",
           lambda s: int(s.point.turn), _by_strokes),
    table.Variable("stable_under_supply", "", "stable under the {supply}",
           "1 if this state is stable with the gas of the supply, 0 if the device snaps through", _held,
           lambda case: case.supply is not None and _at_rest(case)),
    table.Variable("load_step", "", "load step", "number of the step in a program of several cavities",
           lambda s: s.load_step, lambda case: case.program),
    table.Variable("time", "s", "time", "since the load began", lambda s: steps.time_at(s.case.steps, s.load_step),
           lambda case: case.timed),
    table.Variable(r"pressure_(\d+)", "cm", "pressure of cavity{0}", "of the device's cavity{0} only",
             lambda s: _of_each("pressure", s.figures.cavity_pressures)),
    table.Variable(r"added_volume_(\d+)", "ml", "added volume of cavity{0}", "of the device's cavity{0} only",
             lambda s: _of_each("added_volume", s.figures.cavity_volumes)),
    table.Variable("rises", "mm", "", "", lambda s: s.figures.rises),
    table.Variable("figures", "", "", "", lambda s: s.figures.device),
    table.Variable("max_displacement", "mm", "largest displacement", "longest displacement of any node",
           lambda s: s.figures.max_displacement),
    *_extremes("largest_stretch"),
    table.Variable("break_margin", "", "break margin",
           "least published stretch at break of the silicone in tension over the largest stretch; below 1 it may tear",
           _break_margin, lambda case: silicones.stretch_at_break(case.material) is not None),
    *(_place_of_largest(axis) for axis in "xyz"),
    *_extremes("von_mises"),
    *_extremes("J"),
    table.Variable("newton_iterations", "", "Newton iterations", "that this state took to converge",
           lambda s: s.point.state.iterations),
    table.Variable("stored_energy", "mJ", "stored energy", "elastic energy of the whole device",
           lambda s: s.figures.stored_energy),
    table.Variable("dissipated_energy", "mJ", "dissipated energy",
           "work that the silicone of the whole device has lost to creep and softening",
           lambda s: s.figures.dissipated_energy, lambda case: case.timed and case.remembers),
    table.Variable("kinetic_energy", "mJ", "kinetic energy", "of the whole device and the masses bonded to it",
           lambda s: s.figures.kinetic_energy, lambda case: case.inertia),
    table.Variable("least_gap", "mm", "least gap",
           "smallest distance between facing walls, negative if they overlap; empty if no walls are near",
           lambda s: None if s.gap is None else s.gap.value),
    table.Variable("walls_touch", "", "walls overlap",
           f"1 where walls overlap by more than {state_values.MAX_OVERLAP_SHARE:.0%} of their thickness, or where the "
           "surface is folded onto itself "
           "within a cell: the state is invalid", lambda s: int(s.overlaps)),
    table.Variable("requested", "", "requested", "1 for a requested state", lambda s: int(s.point.requested)),
    table.Variable("limit", "", "limit point",
           "1 at a limit point of the pressure: under pressure control the device snaps through",
           lambda s: int(s.point.limit)),
    table.Variable("jump", "", "jump", "1 for the equilibrium after a snap-through", lambda s: int(s.point.jump)),
    table.Variable("bifurcation", "", "bifurcation", "1 at a bifurcation, where another branch of equilibria starts",
           lambda s: int(s.point.bifurcation)),
    table.Variable("stable_under_pressure", "", "stable under a pressure", "1 if the state is stable at constant pressure",
           lambda s: int(s.point.stable_under_pressure), _at_rest),
    table.Variable("stable_under_volume", "", "stable under a volume",
           "1 if the state is stable at constant cavity volume",
           lambda s: int(s.point.stable_under_volume), _at_rest),
    table.Variable("negative_eigenvalues", "", "negative eigenvalues",
           "number of independent directions in which the energy falls at this pressure; 0 is stable",
           lambda s: s.point.signature.negative_eigenvalues, _at_rest),
    table.Variable("lowest_eigenvalue", "Pa_per_mm2", "lowest eigenvalue",
           "of the tangent at this pressure; zero where stability is lost", _eigenvalue, _at_rest),
    table.Variable("control", "", "control", "control of the step: pressure, volume, a supply's line or the arc length",
           lambda s: s.point.line),
    table.Variable("bands", "", "", "", lambda s: s.band),
)  # fmt: skip


for _variable in _VARIABLES:
    register_output(_variable)


# ----------------------------------------------------------------------------------------------------------------------
# The paths of a device for every source of its silicone: the file ``sources.csv`` and a summary.


type SourceTables = Mapping[str, table.PathTable]
"""PathTable of each source by its name, from the softest to the stiffest."""

type MeshTables = Mapping[str, table.PathTable]
"""PathTable of the same path with smaller cells, `FINER`, and with larger ones, `COARSER`: those that were solved."""

FINER, COARSER = "finer", "coarser"
FILE, MESH_FILES = "sources.csv", {name: f"{name}.csv" for name in (FINER, COARSER)}
WORDS = ("control", "source")
"""Columns of words."""


def write_sources(folder: Path, sources: SourceTables) -> None:
    """Write the table: the source, then the columns of ``path.csv`` without those of an error's band."""
    rows = [(name, row) for name, many in sources.items() for row in many]
    columns = list(dict.fromkeys(column for _, row in rows for column in row.cells))
    cells = ([name, *(row.cells.get(column, "") for column in columns)] for name, row in rows)
    files.write_text(folder / FILE, files.csv_text(["source", *columns], cells))


def read_sources(folder: Path, cm: float) -> dict[str, table.PathTable]:
    """Return the table of each source, ``cm`` being Pa in one cm of the case's column; empty where there is none, or none that
    can be read."""
    sources: dict[str, table.PathTable] = {}
    for cells in _read(folder / FILE):
        sources.setdefault(str(cells.pop("source", "")), table.PathTable()).append(table.Row(cells, cm))
    return sources


def read_meshes(folder: Path, cm: float) -> dict[str, table.PathTable]:
    """Return the tables of the path on other meshes; as `read_sources`."""
    tables = {name: table.PathTable.read(_read(folder / file), cm) for name, file in MESH_FILES.items()}
    return {name: rows for name, rows in tables.items() if rows}


def _read(file: Path) -> list[dict[str, table.Cell]]:
    try:
        with file.open(newline="", encoding="utf-8") as stream:
            return [{column: _cell(column, text) for column, text in cells.items()} for cells in csv.DictReader(stream)]
    except (OSError, ValueError):
        return []


def _cell(column: str, text: str) -> table.Cell:
    return text if column in WORDS else float(text) if text else None


def in_order(case: Case, rows: table.PathTable, others: SourceTables) -> dict[str, table.PathTable]:
    """Return all sources from the softest to the stiffest, the run's own path among them; empty where there are no others."""
    own = silicones.named(case.material)
    if own is None or not others:
        return {}
    every = {own: rows, **others}
    return {name: every[name] for name in silicones.source_names(own) if name in every}


def stands_at(row: table.Row, case: Case, value: float) -> bool:
    """Return whether a state is at a requested value of its case, SI."""
    return math.isclose(row[case.variable], value, rel_tol=1e-6)


def key_of(name: str) -> str:
    """Return the short name of a source, of a product's plain name too."""
    silicone = silicones.silicone_called(name)
    return silicone.origin.key if silicone else name
