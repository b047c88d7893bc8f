"""The states of a run on one mesh: for pictures, for what is solved from them, and their values along lines.

A line is drawn in the undeformed body and moves with it. It may leave the modelled section or slice: its points are found in
what is modelled, and their vectors and tensors are turned back from there.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from geometries import Actuator, actuator
from geometries.actuator import Vector
from softmodels.case import materials
from softmodels.case.case import Case
from softmodels.case.entries import CaseError
from softmodels.common import commands, files, units
from softmodels.common.arrays import Array
from softmodels.common.lazy import pyvista
from softmodels.runs import columns, fields, formats, grid, labels, state_values, store, table
from softmodels.runs.budget import Budget

MAX_STILLS = 4
"""Maximum number of states shown side by side."""

type NodalGrid = tuple[Array, npt.NDArray[np.int64], str]
"""Undeformed nodes in m, shape (n, 3); cells in VTK's order, shape (c, 6 or 10); XDMF's name of the cells."""


class StoredStates:
    """States on one mesh, for pictures, tables and what is solved from them. ``read`` returns a nodal field of a state by its
    number and the field's name; KeyError where there is none.

    Attributes:
        points: Undeformed nodes in device coordinates, m, shape (n, 3).
        cells, cell_name: Node numbers in VTK's order, shape (c, 10 or 6), and XDMF's name of them.
        rows: The table of the states.
        others: Tables of the silicone's other sources by name; empty where they were not asked for.
        meshes: Tables of the path on other meshes; empty where the mesh error was not asked for.
        branch: That of the branch followed from the first bifurcation; empty if none was.
        mesh_notes: Warnings about the mesh, as sentences.
        made: Where they come from.
    """

    def __init__(self, case: Case, rows: Iterable[table.Row], grid: NodalGrid, read: Callable[[int, str], Array]):
        self.case, self.rows, self._read = case, table.PathTable(rows), read
        self.points, self.cells, self.cell_name = grid
        self.others: columns.SourceTables = {}
        self.meshes: columns.MeshTables = {}
        self.branch = table.PathTable()
        self.mesh_notes: Sequence[str] = ()
        self.made = commands.Provenance()

    @property
    def name(self) -> str:
        return self.case.name

    def fields(self, step: int, names: Sequence[str] | None = None) -> Mapping[str, Array]:
        """Return nodal fields of a state by name, all of them for None."""
        raise NotImplementedError

    def restart(self, step: int) -> formats.Restart:
        """Return the numbers that a restart needs beside the fields."""
        raise NotImplementedError

    def mesh(self) -> bytes:
        """Return the device's mesh as a Gmsh file."""
        raise NotImplementedError

    @property
    def actuator(self) -> Actuator:
        return self.case.actuator

    @functools.cached_property
    def words(self) -> labels.StateLabels:
        """Labels of its states."""
        return labels.state_labels(self.case)

    @functools.cached_property
    def skin(self) -> grid.Surface:
        """The surface of the mesh."""
        return grid.surface_of(self.points, self.cells, self.cell_name, self.actuator)

    @property
    def bifurcation(self) -> int | None:
        """The first bifurcation of the path; None if there is none."""
        return next(iter(np.flatnonzero(self.rows.get("bifurcation")).tolist()), None)

    @functools.cached_property
    def sources(self) -> dict[str, table.PathTable]:
        """Tables of each source of the silicone, the run's own among them; none where no others were solved."""
        return columns.in_order(self.case, self.rows, self.others)

    @functools.cached_property
    def budget(self) -> Budget:
        """What is known of the errors of their numbers."""
        return Budget(self.case, self.rows, self.meshes, self.sources)

    def field(self, step: float, name: str) -> Array:
        """Return a nodal field of a state, shape (n,) or (n, 3), SI units; of step 2.5 the mean of steps 2 and 3."""
        begin, share = int(step), step - int(step)
        if not share:
            return np.asarray(self._read(begin, name))
        return (1 - share) * np.asarray(self._read(begin, name)) + share * np.asarray(self._read(begin + 1, name))

    def moved(self, step: float) -> Array:
        """Return the deformed nodes of a state in m, shape (n, 3)."""
        return self.points + self.field(step, "displacement")

    def row(self, step: float) -> table.Row:
        """Return the row of a state; see `row_at`."""
        return row_at(self.rows, step)

    @functools.cached_property
    def loaded(self) -> list[int]:
        """Steps that are not at rest."""
        return [k for k, row in enumerate(self.rows) if self.words.loaded(row)]

    @functools.cached_property
    def main(self) -> int:
        """The last requested state under load behind that in which the path begins, or the last of all if there is none."""
        asked = [k for k in self.loaded if k and self.rows[k]["requested"]]
        return asked[-1] if asked else len(self.rows) - 1

    @functools.cached_property
    def along(self) -> Array:
        """Position of each step along the path, from 0 to 1, shape (steps,): of a program by its steps, else by the pressure
        where it only rises; past a limit point by the arc length of pressure and volume."""
        if self.case.program:
            steps = self.rows["load_step"]
            return steps / (steps[-1] or 1.0)
        # Of a dead load its magnitude stands for the pressure, and what it moves for the volume.
        raised, moved = self.words.along
        pressure = self.rows[raised]
        if len(pressure) == 1:
            return np.zeros(1)
        if (np.diff(pressure) > 0).all():
            return np.asarray((pressure - pressure[0]) / (pressure[-1] - pressure[0]))
        path = np.column_stack([pressure, self.rows[moved]])
        size = np.ptp(path, axis=0)
        lengths = np.linalg.norm(np.diff(path, axis=0) / np.where(size > 0, size, 1.0), axis=1)
        along = np.concatenate([[0.0], np.cumsum(lengths)])
        return np.asarray(along / (along[-1] or 1.0))

    def shown(self, most: int = MAX_STILLS) -> list[float]:
        """Return the steps of the states to show: the requested ones under load, or some spread over the path, at most so
        many, the last included. A round pressure between two steps is a fraction: the state there is interpolated."""
        asked = [k for k in self.loaded if self.rows[k]["requested"]]
        if len(asked) > most:
            asked = [asked[round(k)] for k in np.linspace(0, len(asked) - 1, most + 1)[1:]]
        if len(asked) >= 2:
            return list[float](asked)
        if not self.loaded:
            return [len(self.rows) - 1]
        if even := [] if self.case.program else round_steps(self.rows[: self.main + 1], self.case.variable, most):
            return even
        wanted = np.linspace(0.0, 1.0, most + 1)[1:]
        places = self.along[self.loaded]
        shown = {self.loaded[int(np.argmin(np.abs(places - value)))] for value in wanted}
        return list[float](sorted(shown | set(asked))[-most:])


class FolderStates(StoredStates):
    """The states of a folder of results, with its ``case.toml``, of the stem ``name`` or the case's own; the mesh is at
    ``home`` or in the same folder.

    Raises:
        ResultsError: No results, or none that can be read.
        CaseError: No case file, or a wrong one.
    """

    def __init__(self, folder: Path, name: str | None = None, home: Path | None = None):
        try:
            folder = folder.absolute()  # the caller may change the working directory
        except OSError:
            raise store.ResultsError(
                f"{folder} is relative to the working directory, which no longer exists; change the working "
                f"directory, or give an absolute path"
            ) from None
        case = Case.from_file(folder / "case.toml")
        self.folder, self.results = folder, store.Results(folder, name or case.name, cm=case.column.pascal)
        if not self.results.heavy.exists():
            raise store.ResultsError(f"{folder} holds no {self.results.heavy.name}, so there is nothing to draw")
        self.results.load()
        if not self.results.stored:
            raise store.ResultsError(f"the results in {folder} hold no step yet, so there is nothing to draw")
        with formats.opened(self.results.heavy) as file:
            points, cells = (np.asarray(formats.read_values(file, f"mesh/{name}")) for name in ("points", "cells"))
            grid = points, cells, str(file["mesh"].attrs["cell_name"])
        read = functools.lru_cache(maxsize=24)(lambda step, field: self.fields(step, (field,))[field])
        super().__init__(case, self.results.rows, grid, read)
        self._mesh = (home or folder) / f"{case.name}.msh"
        self.others = columns.read_sources(folder, case.column.pascal) if isinstance(case.band, materials.SourceBand) else {}
        self.meshes = self.results.meshes(case)
        self.branch, self.mesh_notes = self.results.branch_rows, self.results.mesh_notes
        self.made = commands.Provenance.from_table(self.results.own.about.get("made"))

    def branch_states(self) -> FolderStates | None:
        """Return the states of the followed branch; None if there is none."""
        return FolderStates(self.results.branch().folder, None, self.folder) if self.branch else None

    def fields(self, step: int, names: Sequence[str] | None = None) -> Mapping[str, Array]:
        there = self.results.stored[step].shapes
        if missing := [name for name in names or () if name not in there]:
            if self.results.format != store.FORMAT_NUMBER:
                raise self.results.other_format(missing[0])
            raise store.ResultsError(f"the states in {self.folder} hold no {missing[0]}; {store.RERUN_ADVICE}")
        with self._readable():
            fields = self.results.fields(step, tuple(there if names is None else names))
        return {name: values.astype(float) for name, values in fields.items()}

    def restart(self, step: int) -> formats.Restart:
        return self.results.stored[step].restart

    def mesh(self) -> bytes:
        with self._readable():
            return self._mesh.read_bytes()

    @contextlib.contextmanager
    def _readable(self) -> Iterator[None]:
        """Raise `ResultsError` if the folder has changed since it was loaded."""
        try:
            yield
        except (OSError, KeyError, store.ResultsError) as error:
            reason = error.strerror if isinstance(error, OSError) and error.strerror else files.hdf5_reason(error)
            raise store.ResultsError(
                f"the states in {self.folder} can no longer be read ({reason}); restore the folder, or "
                f"load it from its new place"
            ) from None


def row_at(rows: table.PathTable, step: float) -> table.Row:
    """Return the row of a state, of step 2.5 the mean of the numbers of steps 2 and 3."""
    begin, share = int(step), step - int(step)
    if not share:
        return rows[begin]
    pairs = [(name, value, rows[begin + 1].cells.get(name)) for name, value in rows[begin].cells.items()]
    both = [(name, a, b) for name, a, b in pairs if isinstance(a, int | float) and isinstance(b, int | float)]
    return table.Row(((name, (1 - share) * a + share * b) for name, a, b in both), rows[begin].cm)


def round_steps(rows: table.PathTable, variable: str, most: int) -> list[float]:
    """Return where a variable has round values in the unit in which it is shown, at most ``most``, and the last step; empty
    unless it only rises, or only falls from 0. Fractions are between two steps, where it is taken as straight."""
    values = rows.shown(variable)
    values = values * np.sign(values[-1])
    if len(values) < 2 or not values[-1] or not (np.diff(values) > 0).all():
        return []
    wide = values[-1] / most
    unit = 10.0 ** np.floor(np.log10(wide))
    wide = next(unit * k for k in (1.0, 2.0, 2.5, 5.0, 10.0) if unit * k >= wide * (1 - 1e-9))
    wanted = wide * np.arange(1, most + 1)
    places = np.interp(wanted[wanted < values[-1] - 0.35 * wide], values, np.arange(len(values)))
    near = places.round()
    return [*np.where(np.abs(places - near) < 1e-6, near, places).tolist(), len(rows) - 1]


# ----------------------------------------------------------------------------------------------------------------------
# Section of a device's outer surface by a plane: the undeformed line and its deformed shape.


CUT_OFFSET = 1e-7
"""Offset of the cut from the plane, relative to the device's size, so that vertices in the plane do no harm."""


def cut_line(skin: grid.Surface, points: Array, displacement: Array, normal: Vector, at: float, size: float) -> Array:
    """Return the pieces of the deformed section of the outer surface, in device coordinates (m), shape (k, 2, 3): undeformed
    nodes and displacements in m, shape (n, 3), cut by a plane of unit normal, ``at`` m from the origin, of a device as large
    as ``size`` m."""
    rest, moved = (skin.device(skin.points(nodal)) for nodal in (points, points + displacement))
    triangles = skin.device_triangles(skin.part == grid.OUTSIDE_LABEL)
    height = rest @ np.asarray(normal) - at - CUT_OFFSET * size
    above = height[triangles] > 0.0
    hit = triangles[above.any(axis=1) & ~above.all(axis=1)]
    pieces = np.empty((len(hit), 2, 3))
    count = np.zeros(len(hit), dtype=int)
    for a, b in ((0, 1), (1, 2), (2, 0)):
        start, end = hit[:, a], hit[:, b]
        rows = np.flatnonzero((height[start] > 0.0) != (height[end] > 0.0))
        start, end = start[rows], end[rows]
        share = (height[start] / (height[start] - height[end]))[:, None]
        pieces[rows, count[rows]] = moved[start] + share * (moved[end] - moved[start])
        count[rows] += 1
    return pieces


def axes_of(normal: Vector, lift: Vector) -> Array:
    """Return two unit vectors in a plane, shape (2, 3): to the right, mostly along x or y, and upwards along the lift or y."""
    n = np.asarray(normal)
    for up in (np.asarray(lift), np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])):
        across = up - (up @ n) * n
        if np.linalg.norm(across) > 0.1:
            break
    across = across / np.linalg.norm(across)
    right = np.cross(across, n)
    return np.array([right if right[np.argmax(np.abs(right))] > 0.0 else -right, across])


# ----------------------------------------------------------------------------------------------------------------------
# Values along a line through the body: from place to place, or from a point of the surface straight through its wall.


LINE_POINTS = 201
"""Default number of points of a line."""
BODY_TOLERANCE = 5e-4
"""Distance from the body within which a point counts as in it, over the device's size."""
COMPONENT_NAMES = {"displacement": "xyz", "principal_stresses": "123", "principal_stretches": "123"}
"""Names of a vector's components in columns."""


@dataclasses.dataclass(frozen=True, eq=False)
class Line:
    """Values of a state along a straight line of the undeformed device, SI units, nan outside the silicone.

    ``line["cauchy_stress"]`` is a field's values there.

    Attributes:
        points: Undeformed places in device coordinates, m, shape (k, 3).
        fields: Values by the field's name, shape (k,), (k, 3) or (k, 3, 3), in device coordinates.
    """

    points: Array
    fields: Mapping[str, Array]

    def __getitem__(self, name: str) -> Array:
        return self.fields[name]

    @property
    def distance(self) -> Array:
        """Distance from the line's beginning in the undeformed device, m, shape (k,)."""
        return np.asarray(np.linalg.norm(self.points - self.points[0], axis=1))

    @property
    def places(self) -> Array:
        """Deformed places, m, shape (k, 3)."""
        return self.points + self.fields["displacement"]

    @property
    def inside(self) -> npt.NDArray[np.bool_]:
        """Whether a point is in the silicone, shape (k,)."""
        return np.isfinite(self.fields["displacement"][:, 0])

    @property
    def normal_stress(self) -> Array:
        """Normal stress along the deformed line in Pa, shape (k,): minus the pressure where the line leaves a pressed wall at
        right angles."""
        along = self.fields["deformation_gradient"] @ (self.points[-1] - self.points[0])
        along /= np.linalg.norm(along, axis=1)[:, None]
        return np.einsum("ki,kij,kj->k", along, self.fields["cauchy_stress"], along)

    @property
    def columns(self) -> dict[str, Array]:
        """All values within the silicone by the name of a CSV column, in mm, kPa or pure numbers."""
        inside = self.inside
        columns = {"distance_mm": self.distance * 1e3}
        for what, places in (("", self.points), ("_moved", self.places)):
            columns |= {f"{axis}{what}_mm": places[:, k] * 1e3 for k, axis in enumerate("xyz")}
        columns["normal_stress_kPa"] = self.normal_stress / 1e3
        for name, values in self.fields.items():
            known = fields.OUTPUTS.get(name)
            unit = known.unit if isinstance(known, fields.OutputField) else ""
            ending, factor = {"Pa": ("_kPa", 1e-3), "m": ("_mm", 1e3)}.get(unit, ("", 1.0))
            axes = COMPONENT_NAMES.get(name, "123" if name.startswith("principal") else "xyz")
            parts = [""] if values.ndim == 1 else [f"_{i}" for i in axes] if values.ndim == 2 else [
                f"_{i}{j}" for i in axes for j in "xyz"
            ]  # fmt: skip
            flat = values.reshape(len(values), -1)
            columns |= {f"{name}{part}{ending}": flat[:, k] * factor for k, part in enumerate(parts)}
        return {name: values[inside] for name, values in columns.items()}


@dataclasses.dataclass(frozen=True, eq=False)
class Probe:
    """Takes values at places of the whole device from the undeformed nodes and cells of what is modelled."""

    device: Actuator
    mesh: NodalGrid

    @functools.cached_property
    def _grid(self) -> pyvista.UnstructuredGrid:
        points, cells, name = self.mesh
        return pyvista.UnstructuredGrid({formats.CELL_TYPES[name]: cells.copy()}, points.copy())

    def modelled(self, points: Array) -> tuple[Array, Array]:
        """Return where points of the device, shape (k, 3), lie in the modelled part, and the rotations or reflections that take
        its vectors to them, shape (k, 3, 3)."""
        turns = np.broadcast_to(np.eye(3), (len(points), 3, 3)).copy()
        if self.device.dimension == 2:
            radius = np.hypot(points[:, 0], points[:, 1])
            with np.errstate(invalid="ignore"):
                cos, sin = np.where(radius > 0.0, points[:, :2].T / radius, [[1.0], [0.0]])
            turns[:, 0, 0], turns[:, 0, 1], turns[:, 1, 0], turns[:, 1, 1] = cos, -sin, sin, cos
            points = np.column_stack([radius, np.zeros(len(points)), points[:, 2]])
        normals = np.array([plane.normal for plane in self.device.cut_planes]).reshape(-1, 3)
        images = actuator.reflected(normals)
        back = np.einsum("mij,ki->kmj", images, points)  # the transposed images take a point to the slice
        beyond = (back @ normals.T).max(axis=2) if len(normals) else np.zeros(back.shape[:2])
        chosen = np.argmin(np.maximum(beyond, 0.0), axis=1)
        return back[np.arange(len(points)), chosen], turns @ images[chosen]

    def at(self, points: Array, fields: Mapping[str, Array], beside: float = BODY_TOLERANCE) -> dict[str, Array]:
        """Return nodal scalars, vectors and tensors at places of the undeformed device, shape (k, 3), interpolated within the
        cells; nan farther outside than ``beside`` times the device's size."""
        places, turns = self.modelled(points)
        grid = self._grid
        grid.clear_data()
        for name, values in fields.items():
            grid.point_data[name] = values.reshape(len(values), -1)
        sampled = pyvista.PolyData(places).sample(grid, tolerance=beside * self.device.size)
        outside = ~sampled["vtkValidPointMask"].astype(bool)
        result = {}
        for name, values in fields.items():
            here = np.asarray(sampled[name]).reshape(len(points), *values.shape[1:]).astype(float)
            here[outside] = np.nan
            if values.ndim == 2:
                here = np.einsum("kij,kj->ki", turns, here)
            elif values.ndim == 3:
                here = turns @ here @ np.swapaxes(turns, -1, -2)
            result[name] = here
        return result

    def line(self, ends: tuple[Array, Array], fields: Mapping[str, Array], count: int = LINE_POINTS) -> Line:
        """Return the values along a line; `CaseError` if it has no length, or does not meet the silicone."""
        begin, end = ends
        if not np.linalg.norm(end - begin) > 0.0:
            raise CaseError(f"the line begins and ends at {told(begin)}; give two different places")
        if not isinstance(count, int) or isinstance(count, bool) or count < 2:
            raise CaseError(f"points is {units.brief(count)}; give a whole number, 2 or more")
        points = begin + np.linspace(0.0, 1.0, count)[:, None] * (end - begin)
        smooth = {name: values for name, values in fields.items() if not name.startswith("principal")}
        sampled = self.at(points, smooth)
        inside = np.isfinite(sampled["displacement"][:, 0])
        if not inside.any():
            raise CaseError(
                f"the line from {told(begin)} to {told(end)} does not meet the silicone of {type(self.device).__name__}; "
                "places are in device coordinates of the undeformed body"
            )
        # Principal values change their order between nodes, so they are those of the interpolated tensors.
        F = sampled["deformation_gradient"]
        tensors = {"stresses": sampled["cauchy_stress"], "stretches": np.swapaxes(F, -1, -2) @ F}
        for name, tensor in tensors.items():
            values = np.full((count, 3), np.nan)
            values[inside] = state_values.principal(tensor[inside])[0]
            sampled[f"principal_{name}"] = values if name == "stresses" else np.sqrt(values)
        return Line(points, sampled)

    def through(self, point: Array) -> tuple[Array, Array]:
        """Return both ends of the way straight through the wall at the surface point nearest to a place.

        The surface is that of the modelled part, cut planes excluded.
        """
        [place], [turn] = self.modelled(point[None])
        planes = [plane.normal for plane in self.device.cut_planes]
        walls = state_values.FacingWalls(*self.mesh, planes)
        begin, inwards, thickness = walls.into(place)
        low, high = 0.0, 1.5 * thickness
        nodes = {"inside": np.ones(len(self.mesh[0]))}
        for _ in range(3):  # each finds the end of the way a hundred times closer
            way = np.linspace(low, high, 201)[1:]
            outside = np.isnan(self.at(begin + way[:, None] * inwards, nodes, 1e-7)["inside"])
            last = int(np.argmax(outside)) if outside.any() else len(way) - 1
            low, high = (way[last - 1] if last else low), way[last]
        return _round(turn @ begin), _round(turn @ (begin + low * inwards))


def _round(place: Array) -> Array:
    return np.asarray(place.round(12) + 0.0)


def told(place: Array) -> str:
    """Return a place as text, in mm."""
    return f"({', '.join(f'{1e3 * value:.4g}' for value in place)}) mm"
