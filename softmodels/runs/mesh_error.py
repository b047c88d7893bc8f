"""The mesh error of a run's numbers, estimated from the same path solved again with smaller cells.

A number f of a mesh with cells of size h is wrong by C h^p. Its order p is 1 or more: twice the exponent of the strain's
singularity, which is at least 1/2 at the edge of a clamp or a re-entrant corner, and 3 or 4 where the solution is smooth and
the cells are quadratic. With cells r times smaller in all places

    |f(h) - f| = |f(h) - f(h / r)| / (1 - r^-p)  <=  |f(h) - f(h / r)| / (1 - 1 / r).

That bound is the stated half width. It is the grid convergence index of Roache (1994, 10.1115/1.2910291) with the least order
in place of an observed one, which is noisy on unstructured meshes. In a solid numbers do not go to their limit evenly, and two
meshes may agree by chance: a third one, of larger cells, gives the least half width, the error that is left at second order,

    |f(h r) - f(h)| / (r^2 - 1).

Both hold for what converges: the largest stretch and stress at a sharp corner have no limit (see `PEAKS`).
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterator, Mapping
from time import process_time

import numpy as np

from geometries import Actuator, GeometryError, actuator, meshing
from softmodels.case.case import Case
from softmodels.case.entries import CaseError
from softmodels.common import units
from softmodels.common.arrays import Array
from softmodels.runs import columns, labels, table

FINER: Mapping[int, float] = {2: 2.0, 3: 1.5}
"""How many times smaller the cells of the other path are, by dimension: twice the cost of a section, four times a solid's."""
PEAKS = ("max_stretch", "max_von_mises")
"""Peaks of the fields at integration points: at a sharp corner they grow with every refinement, so that they have no error."""
LARGE_ERROR = 0.02
"""Mesh error relative to the number above which the user is warned."""
LARGE_GROWTH = 0.05
"""Growth of a peak by smaller cells, relative to it, above which the user is warned."""
LEAST_RISE = 1e-3
"""Rise relative to the device's size below which an error relative to it means nothing."""


def half_width[Value: (float, Array)](value: Value, finer: Value, times: float, coarser: Value | None = None) -> Value:
    """Return half the 95 % interval of a number; ``finer`` is the number with cells so many times smaller, ``coarser`` that
    with as many times larger ones."""
    half = abs(value - finer) / (1.0 - 1.0 / times)
    return half if coarser is None else np.maximum(half, abs(coarser - value) / (times**2 - 1.0))


@dataclasses.dataclass(frozen=True)
class MeshErrors:
    """Mesh errors of the states of a path, from its table and those on other meshes; of a section larger cells count for
    nothing.

    Attributes:
        case: What was solved.
        rows: Its table.
        meshes: The others.
    """

    case: Case
    rows: table.PathTable
    meshes: columns.MeshTables

    @property
    def times(self) -> float:
        """How many times smaller the other cells are."""
        return FINER[self.case.actuator.dimension] if self.case.mesh_error else FINER[2]

    def paired(self, row: table.Row, mesh: str = columns.FINER) -> table.Row | None:
        """Return the state on another mesh that corresponds to a requested state or a limit point; None if there is none."""
        others = self.meshes.get(mesh, table.PathTable())
        if row.get("limit"):
            marked = others.where("limit")
            number = len(self.rows.where(lambda before: before["limit"] and before["step"] < row["step"]))
            return marked[number] if number < len(marked) else None
        if not row["requested"]:
            return None
        if "load_step" in row:
            same = others.where(lambda other: bool(np.isclose(other["load_step"], row["load_step"], rtol=1e-9)))
        else:
            same = others.where(lambda other: columns.stands_at(other, self.case, row[self.case.variable]))
        return same[0] if same else None

    @functools.cached_property
    def _by_step(self) -> dict[float, dict[str, float]]:
        return {}

    def of(self, row: table.Row) -> dict[str, float]:
        """Return half widths in SI by variable of a requested state of the path or a limit point; empty if unknown."""
        if row["step"] not in self._by_step:  # asked for variable by variable
            known, other, solid = dict[str, float](), self.paired(row), self.case.actuator.dimension == 3
            larger = self.paired(row, columns.COARSER) if solid else None
            if other is not None:
                for name in (name for name in _told(self.case, row) if name in other):
                    coarser = larger[name] if larger is not None and name in larger else None
                    known[name] = half_width(row[name], other[name], self.times, coarser)
            self._by_step[row["step"]] = known
        return self._by_step[row["step"]]

    @property
    def last(self) -> tuple[table.Row | None, dict[str, float]]:
        """The last requested state of which errors are known, and these; None and none without one."""
        known = ((row, self.of(row)) for row in reversed(self.rows) if row["requested"])
        return next((pair for pair in known if pair[1]), (None, {}))

    def text(self) -> str:
        """Return a sentence with the mesh errors of the last requested state that both meshes have, for a report."""
        row, widths = self.last
        if row is None:
            return "The mesh error was not estimated: run the case with --mesh-error."
        words = labels.state_labels(self.case)
        figures = ", ".join(
            f"{columns.term(row.column(name), self.case.actuator).name} "
            + units.with_error(row.shown(name), in_unit(row, name, half), row.unit(name))
            for name, half in widths.items()
        )
        files = columns.MESH_FILES
        larger = f" and larger ({files[columns.COARSER]})" if columns.COARSER in self.meshes else ""
        return (
            f"Mesh error at {words.place(row)}, from the same path {described(self.case)} "
            f"({files[columns.FINER]}){larger}, as half a 95 % interval: {figures}."
        )

    def shares(self) -> dict[str, float]:
        """Return the half widths relative to the numbers, by their names: the main rise and the added volume of the last
        requested state of which they are known, and limit pressures."""
        device, (last, _), shares = self.case.actuator, self.last, dict[str, float]()
        if last is None:
            return shares
        for row in [last, *self.rows.where("limit")]:
            widths = self.of(row)
            for name in ("pressure",) if row.get("limit") else (device.gauge, "added_volume"):
                scale = max(abs(row[name]), LEAST_RISE * device.size if name == device.gauge else 0.0)
                if name in widths and scale > 0.0:
                    what = "limit pressure" if row.get("limit") else columns.term(row.column(name), device).name
                    shares[what] = max(widths[name] / scale, shares.get(what, 0.0))
        return shares

    def doubts(self) -> Iterator[str]:
        """Yield sentences on numbers that the mesh does not resolve, and how to improve them."""
        device, (last, _) = self.case.actuator, self.last
        if self.case.mesh_error and self.rows and (last is None or not last[self.case.variable]):
            yield "the mesh error is unknown: with smaller cells the path ends before a state under load that both meshes have"
        if last is None:
            return
        for what, share in self.shares().items():
            if share > LARGE_ERROR:
                yield f"the mesh error of the {what} is {share:.1%}; use smaller cells (--finer 2, or --accuracy 2%)"
        other = self.paired(last)
        for name in PEAKS if self.case.mesh_error else ():
            if other is not None and name in last and other[name] > (1.0 + LARGE_GROWTH) * last[name]:
                what = columns.term(last.column(name), device).name
                yield (
                    f"the {what} is {last.told(name)}, and {other.told(name)} with cells {self.times:g} times smaller: it "
                    "grows without bound at a sharp corner, and is underestimated at a rounded one; compare it only on equal "
                    "meshes, or use smaller cells at a rounded corner"
                )


def in_unit(row: table.Row, name: str, half: float) -> float:
    """Return a half width in SI in the unit in which its variable is shown."""
    return table.parsed(row.column(name))[1].written(half, row.cm)


def _told(case: Case, row: table.Row) -> list[str]:
    """Return the variables whose error is stated: rises, figures and named points of the device, volume, pressure, forces."""
    device: Actuator = case.actuator
    named = [*device.probes, *(table.split(column)[0] for column in device.figure_columns.values()), *case.gauges.variables]
    loads = [name for name in ("pressure", "added_volume", "stroke") if name != case.variable or row.get("limit")]
    forces = [name for name in row if name.endswith("_force")]
    return [name for name in dict.fromkeys([*named, *loads, *forces]) if name in row]


# ----------------------------------------------------------------------------------------------------------------------
# The other path: on which cells it is solved, and whether unasked.


UNASKED_SHARE, UNASKED_SECONDS = 0.5, 1.0
"""Time of a core in which the mesh error is estimated unasked: this share of what the run has taken so far, or as many s."""
SECONDS_PER_CELL = 0.3
"""Time for a cell of the companion over that for a cell of the run: it takes a third to two thirds of the steps."""


def companion(case: Case, unasked: bool) -> Case | None:
    """Return the case with whose path the mesh error is estimated: with smaller cells where it asks for that; else, if
    ``unasked``, the axisymmetric section with smaller cells, which costs a fraction of a solid; None if there is none."""
    device = case.actuator
    if case.mesh_error:
        return dataclasses.replace(case, actuator=device.refined(FINER[device.dimension]))
    if not unasked or not device.refinable or not (device.dimension == 2 or isinstance(device, actuator.Sectioned)):
        return None
    try:
        section = device if device.dimension == 2 else device.replaced(section="axisymmetric")
        return dataclasses.replace(case, actuator=section.refined(FINER[2]))
    except (CaseError, GeometryError):
        return None  # such as a load that is not axisymmetric


def coarser_companion(case: Case) -> Case | None:
    """Return the case of a solid with larger cells, if it asks for the mesh error: a third of the cost of its own path; None of
    a section, whose numbers converge evenly, and where there is none."""
    device = case.actuator
    if not case.mesh_error or device.dimension == 2:
        return None
    try:
        return dataclasses.replace(case, actuator=device.refined(1.0 / FINER[device.dimension]))
    except GeometryError:
        return None


def expected_seconds(case: Case, other: Case, seconds: float) -> float:
    """Return the time of a core for a `companion`, from that for the path of the case itself."""
    return SECONDS_PER_CELL * seconds * meshing.expected_cells(other.actuator) / meshing.expected_cells(case.actuator)


def affordable(seconds: float) -> bool:
    """Whether a companion that takes so long is solved unasked."""
    return seconds <= max(UNASKED_SHARE * process_time(), UNASKED_SECONDS)


def described(case: Case) -> str:
    """Return on which cells the other path of `companion` is, in words."""
    sectioned = not case.mesh_error and case.actuator.dimension == 3
    times = FINER[case.actuator.dimension] if case.mesh_error else FINER[2]
    return f"{'as an axisymmetric section ' if sectioned else ''}with cells {times:g} times smaller"
