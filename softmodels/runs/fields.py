"""Nodal fields and key figures of equilibrium states."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from geometries import actuator
from geometries.actuator import Vector
from softmodels.case import entries
from softmodels.common import errors, names, units
from softmodels.common.arrays import Array
from softmodels.common.lazy import fem, ufl
from softmodels.components import rigid
from softmodels.mechanics import body, compiling, mpi, regions, system
from softmodels.mechanics.component import ComponentError
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import State, System
from softmodels.runs import state_values, table


class Fields:
    """Nodal fields and key figures of an equilibrium's states: the requested ones of `requestable` beside those of every run.

    Attributes:
        grid: The nodes that results are written on.
        rest_volume: Of the cavity, dimensionless.
    """

    def __init__(self, solver: Solver, gauges: entries.Probes = entries.NO_PROBES, requested: Sequence[str] = ()):
        self.solver, self.system = solver, solver.system
        system = self.system
        self.grid = state_values.Grid(system)
        self.sampling = state_values.Sampling(solver, self.grid)
        self.rest_volume = system.rest().V
        self._rest_volumes = system.volumes()
        places = ufl.SpatialCoordinate(system.body.mesh)
        self._places = fem.Expression(places, system.points, jit_options=compiling.JIT)
        self._probes = {name: self._owner(point) for name, point in system.body.actuator.probes.items()}
        self._gauges, self._followed = gauges, tracked_points(system, self.grid, gauges)
        self._turning = turning_faces(system, self.grid, gauges)
        self._wanted = [field for field in outputs(OutputField) if not field.requested or field.name in requested]

    @functools.cached_property
    def walls(self) -> state_values.FacingWalls:
        """The device's surface, on rank 0."""
        planes = [plane.normal for plane in self.system.body.actuator.cut_planes]
        return state_values.FacingWalls(self.grid.points, self.grid.cells, self.grid.cell_name, planes)

    @property
    def followed(self) -> list[str]:
        """A sentence on each named point: where it is tracked."""
        return [entries.followed_text(name, point.away, point.place) for name, point in self._followed.items()]

    def values(self, state: State) -> state_values.StateValues:
        """Return a state's values; the state is loaded into the equations."""
        self.system.load(state)
        return state_values.StateValues(self.sampling, state)

    def shape(self, w: Array) -> Array | None:
        """Return the displacement of dofs such as a mode's over the grid's nodes in device coordinates, (n, 3) in m, on rank
        0."""
        return self.grid.collect(self.sampling.displacement(w))

    def nodal(self, state: State, values: state_values.StateValues | None = None) -> dict[str, Array] | None:
        """Return each wanted `OutputField` over the grid's nodes by name, SI units, shape (n,), (n, 3) or (n, 3, 3), on rank 0;
        None elsewhere. ``values`` are the state's, if they are known; see `values`."""
        values = values or self.values(state)
        collected = {field.name: self.grid.collect(field.nodal(values)) for field in self._wanted}
        whole = {name: field for name, field in collected.items() if field is not None}
        return whole if len(whole) == len(collected) else None

    def state(self, nodal: Mapping[str, Array] | None, P: float, V: float) -> State:
        """The state at a dimensionless cavity pressure and volume that `nodal` was made of, at least ``displacement`` and
        ``p`` on rank 0; where regions meet p is the mean of theirs, and so not quite the state's."""
        eq, grid, sampling = self.system, self.grid, self.sampling
        u = grid.distribute(None if nodal is None else nodal["displacement"]) / eq.length_unit
        p = grid.distribute(None if nodal is None else nodal["p"])[:, None] / eq.stress_unit
        u = u if grid.dimension == 3 else u[:, [0, 2]]
        function = fem.Function(eq.space)
        function.x.array[sampling.skew[: grid.owned]] = u @ eq.body.skew.T
        if sampling.pressures is not None:
            at = sampling.pressures[: grid.owned]
            function.x.array[at[at >= 0]] = np.broadcast_to(p, at.shape)[at >= 0]
        function.x.scatter_forward()
        return State(function.x.array.copy(), P, V)

    def figures(self, state: State, values: state_values.StateValues | None = None) -> Figures:
        """Return the key figures of a state, whose ``values`` may be known."""
        eq, values = self.system, values or self.values(state)
        actuator, u = eq.body.actuator, values.displacement
        lift = np.asarray(actuator.lift)
        moved = self.probes_moved(state.w)
        named = {name: self._moved(state, point) for name, point in self._followed.items()}
        places = {name: point.place for name, point in self._followed.items()}
        sampled = {field: field.sampled(values) for field in outputs(OutputField) if field.sampled is not None}
        extremes = {field.name: self._extremes(sample) for field, sample in sampled.items()}
        added = (eq.volumes() - self._rest_volumes) * eq.volume_unit
        pressures = eq.pressures_at(state) * eq.stress_unit
        device = together(
            device_columns(actuator, {name: _place(actuator.probes[name], moved[name]) for name in moved}),
            self._gauges.figures(places, named, actuator.lift, self._normals(state.w)),
            *(term.figures(eq) for term in eq.potential.terms.values()),
            eq.dead.figures(eq.drives_at(state)[len(actuator.ratios) :]),
            rigid_parts(self.sampling, state),
            *(v.cells(v.measured(self.sampling, state)) for v in outputs(table.Variable) if v.measured),
        )
        return Figures(
            pressure=next((p / ratio for p, ratio in zip(pressures, actuator.ratios, strict=True) if ratio), 0.0),
            added_volume=float(actuator.ratios @ added),
            cavity_pressures=tuple(pressures.tolist()),
            cavity_volumes=tuple(added.tolist()),
            rises={name: float(shift @ lift) for name, shift in moved.items()},
            device=device,
            max_displacement=self._extremes(np.linalg.norm(u, axis=1))[1],
            max_stretch_at=self._place_of(values.stretches[..., -1], extremes["largest_stretch"][1]),
            extremes=extremes,
            peaks={
                field.name: state_values.volume_peak(eq.comm, sample, eq.point_volumes(), field.rest)[0]
                for field, sample in sampled.items()
                if any(extreme.peak for extreme in field.extremes)
            },
            stored_energy=eq.stored_energy() * eq.stress_unit * eq.volume_unit,
            dissipated_energy=eq.potential.dissipated * eq.stress_unit * eq.volume_unit,
            kinetic_energy=eq.potential.kinetic * eq.stress_unit * eq.volume_unit,
        )

    def _extremes(self, values: Array) -> tuple[float, float]:
        """Return the least and the largest value over all ranks."""
        comm = self.system.comm
        least = -mpi.largest(comm, float((-values).max()) if values.size else -math.inf)
        return least, mpi.largest(comm, float(values.max()) if values.size else -math.inf)

    def _owner(self, point: Vector) -> int:
        """Return the local owned node at a device point, or -1 on the ranks that do not own it."""
        eq = self.system
        here = self.grid.space.tabulate_dof_coordinates()[: self.grid.owned] * eq.length_unit
        distance = np.linalg.norm(eq.body.actuator.device_points(here) - np.asarray(point), axis=1)
        node = int(np.argmin(distance)) if len(distance) else -1
        near = float(distance[node]) if node >= 0 else math.inf
        closest = -mpi.largest(eq.comm, -near)
        return node if near == closest and closest < 1e-6 * eq.length_unit else -1

    def probes_moved(self, w: Array) -> dict[str, Array]:
        """Return the displacement (3,) in m of each probe in device coordinates, of dofs or of a change of them, on all
        ranks."""
        u = self.sampling.displacement(w)
        return {name: self._at(u, node) for name, node in self._probes.items()}

    def _at(self, u: Array, node: int) -> Array:
        """Return the displacement (3,) of a node that one rank owns, on all ranks; ``node`` is -1 on the others."""
        return np.array([mpi.total(self.system.comm, float(u[node, i]) if node >= 0 else 0.0) for i in range(3)])

    def _normals(self, w: Array) -> dict[str, tuple[Array, Array]]:
        """Return the normals of the faces whose rotation is tracked, undeformed and rotated."""
        eq, skew = self.system, self.sampling.skew
        normals = {}
        for name, face in self._turning.items():
            moved = body.in_space(w[skew[face.nodes]] @ eq.body.skew_inverse.T * eq.length_unit)
            normals[name] = face.normal, face.turned(moved)
        return normals

    def _moved(self, state: State, point: TrackedPoint) -> Array:
        """Return the displacement (3,) in m of a tracked place, on all ranks."""
        eq = self.system
        u = point.weights @ state.w[self.sampling.skew[point.nodes]] @ eq.body.skew_inverse.T * eq.length_unit
        u = u if self.grid.dimension == 3 else np.array([u[0], 0.0, u[1]])
        return np.array([mpi.total(eq.comm, float(value)) for value in u])

    def _place_of(self, values: Array, peak: float) -> tuple[float, float, float]:
        """Return where a value at the integration points, shape (cells, points), reaches its peak over all ranks."""
        eq = self.system
        points = np.empty((0, 3))
        near = values >= peak * (1 - 1e-9)
        cells = np.flatnonzero(near.any(axis=1))
        if cells.size:
            places = self._places.eval(eq.body.mesh, eq.cells[cells])
            places = places.reshape(*near[cells].shape, -1)[near[cells]]
            flat = np.column_stack([places, np.zeros((len(places), 3 - places.shape[1]))]) * eq.length_unit
            points = eq.body.actuator.device_points(flat)
        # Among equal values, as at rest, the first in order of x, y, z, so that neither rounding nor the rank decides.
        place = []
        for axis in range(3):
            least = -mpi.largest(eq.comm, -float(points[:, axis].min()) if len(points) else -math.inf)
            points = points[points[:, axis] <= least + 1e-9 * eq.length_unit]
            place.append(least)
        return place[0], place[1], place[2]


def together(*groups: Mapping[str, float]) -> dict[str, float]:
    """Merge columns of ``path.csv``; `ComponentError` if two bear one name, as a rigid part ``tip`` and a device whose tip has
    a column."""
    figures: dict[str, float] = {}
    for group in groups:
        if twice := sorted(figures.keys() & group.keys()):
            raise ComponentError(
                f"two figures of this device and its parts share the column {twice[0]} of path.csv; "
                f"rename the part, point or angle in it"
            )
        figures |= group
    return figures


def device_columns(device: actuator.Actuator, places: Mapping[str, Vector]) -> dict[str, float]:
    """Return the device's own figures at places of its probes, by their columns of ``path.csv`` in their units."""
    columns = device.figure_columns
    return {
        columns[name]: table.UNITS.get(device.figure_texts[name][0], table.NUMBER).written(value)
        for name, value in device.device_figures(places).items()
    }


def _place(start: Vector, shift: Array) -> Vector:
    x, y, z = np.asarray(start) + shift
    return float(x), float(y), float(z)


AT_POINTS = "over all integration points of the whole device, not only those shown in a picture"
"""Where the largest stretch and stress are taken, for every table, picture and message."""


# ----------------------------------------------------------------------------------------------------------------------
# One state of a device in numbers.


@dataclasses.dataclass(frozen=True)
class Figures:
    """One state in numbers, of the whole device, SI units.

    Extremes of stretch and stress are over the integration points. Those of J are over the vertices, as `VolumeRatio` has
    it: that is where the elements keep the volume, and cells and points scatter around it by an error of the mesh.

    ``cavity_pressures`` and ``cavity_volumes`` (added ones) are of each cavity. ``added_volume`` is what a pressure common to
    all works on: their sum, or the sum of their products with the device's pressure ratios.
    ``rises`` are the probes' displacements along the lift, ``device`` is what `Actuator.device_figures` makes of their
    places, ``max_stretch_at`` the undeformed place of the largest stretch in device coordinates. ``extremes`` has the
    least and the largest value of every output field that is sampled, SI units, by name; ``peaks`` the `peak` of those that
    have one.
    """

    pressure: float
    added_volume: float
    cavity_pressures: tuple[float, ...]
    cavity_volumes: tuple[float, ...]
    rises: dict[str, float]
    device: dict[str, float]
    max_displacement: float
    max_stretch_at: tuple[float, float, float]
    extremes: Mapping[str, tuple[float, float]]
    peaks: Mapping[str, float]
    stored_energy: float
    dissipated_energy: float
    kinetic_energy: float

    @property
    def max_stretch(self) -> float:
        return self.extremes["largest_stretch"][1]


# ----------------------------------------------------------------------------------------------------------------------
# Tracked surface points and tracked face rotations, on any number of ranks.


Nodes = npt.NDArray[np.int64]


@dataclasses.dataclass(frozen=True, eq=False)
class TrackedPoint:
    """A place of the surface, in a facet.

    Attributes:
        nodes: Local nodes of the facet, ghosts too, shape (k,); empty on ranks that do not have it.
        weights: What their values count there, shape (k,), so that the sum over all ranks is the value.
        place, away: Undeformed, in device coordinates, m, and its distance in m from the point that was named.
    """

    nodes: Nodes
    weights: Array
    place: Vector
    away: float


def tracked_points(system: System, grid: state_values.Grid, gauges: entries.Probes) -> dict[str, TrackedPoint]:
    """Return the surface points, cavity walls included, nearest to the named points; `ProbeError` if one is farther than a
    cell is large."""
    if not gauges.points:
        return {}
    facets = _surface(system, grid)
    here = grid.space.tabulate_dof_coordinates()[facets.ravel()] * system.length_unit
    places = system.body.actuator.device_points(here) if len(here) else np.empty((0, 3))
    corners = places.reshape(*facets.shape, 3)
    return {name: _nearest(system, name, np.asarray(wanted), facets, corners) for name, wanted in gauges.places.items()}


class TurningFace:
    """A face whose mean rotation is tracked: the best-fitting rotation of its motion, facets weighted by area. It has the
    local nodes of its facets' corners on this rank, shape (m, 3), and their undeformed places in device coordinates, m, shape
    (m, 3, 3); its normal points away from ``middle``, that of the device's whole surface."""

    def __init__(self, system: System, nodes: Nodes, places: Array, middle: Array):
        self.nodes, self._comm = nodes, system.comm
        self._images = [
            np.asarray(image) for image in actuator.reflected([plane.normal for plane in system.body.actuator.cut_planes])
        ]
        sides = places[:, 1:] - places[:, :1]
        areas = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
        self._areas, self._places = np.repeat(areas, 3), places.reshape(-1, 3)
        self._area, self._centre, second = self._moments(self._places)
        self.normal: Array = np.linalg.eigh(second)[1][:, 0]
        if self.normal @ (self._centre - middle) < 0.0:
            self.normal = -self.normal

    def _moments(self, now: Array) -> tuple[float, Array, Array]:
        """Return the area of the face and its images, its centre at places ``now``, and the moments of these with the
        undeformed ones."""
        weighed = self._areas[:, None] * self._places
        sums = mpi.summed(
            self._comm,
            np.concatenate([[self._areas.sum()], weighed.sum(axis=0), self._areas @ now, (weighed.T @ now).ravel()]),
        )
        count = len(self._images)
        area, rest, there, both = count * sums[0], sums[1:4], sums[4:7], sums[7:].reshape(3, 3)
        rest, there = (np.sum([image @ side for image in self._images], axis=0) for side in (rest, there))
        both = np.sum([image @ both @ image.T for image in self._images], axis=0)
        return float(area), there / area, both / area - np.outer(rest, there) / area**2

    def turned(self, moved: Array) -> Array:
        """Return the normal turned by the mean rotation (Kabsch 1976, doi 10.1107/S0567739476001873), from displacements of
        the corners in device coordinates, shape (m, 3, 3)."""
        _, _, both = self._moments(self._places + moved.reshape(-1, 3))
        U, _, Vt = np.linalg.svd(both)
        U[:, 2] *= np.linalg.det(U)
        Vt[2] *= np.linalg.det(Vt)
        return np.asarray(Vt.T @ (U.T @ self.normal))


def turning_faces(system: System, grid: state_values.Grid, gauges: entries.Probes) -> dict[str, TurningFace]:
    """Return the faces whose mean rotation is an angle; `ProbeError` if the device has no such face."""
    if not gauges.faces:
        return {}
    facets = _surface(system, grid)[:, :3]
    here = grid.space.tabulate_dof_coordinates()[facets.ravel()] * system.length_unit
    places = system.body.actuator.device_points(here).reshape(-1, 3, 3) if len(here) else np.empty((0, 3, 3))
    sums = mpi.summed(system.comm, np.append(places.reshape(-1, 3).sum(axis=0), 3.0 * len(places)))
    near = 1e-5 * system.length_unit
    turning = {}
    for name, face in gauges.turning.items():
        if face.normal is not None:
            chosen = (np.abs(places @ np.asarray(face.normal) - face.at) < near).all(axis=1)
        else:
            low, high = (np.asarray(end) for end in face.box or ((), ()))
            chosen = ((places > low - near) & (places < high + near)).all(axis=(1, 2))
        if not mpi.total(system.comm, float(chosen.sum())):
            raise entries.ProbeError(f"angle {name}: the device has no face 'face {face.text}'")
        turning[name] = TurningFace(system, facets[chosen], places[chosen], sums[:3] / sums[3])
    return turning


def _surface(system: System, grid: state_values.Grid) -> Nodes:
    """Return the local nodes of the facets that bound the silicone, cut planes excluded, shape (m, 6), or (m, 3) of a section.

    The corners come first, then the middles of the edges, each opposite to its corner.
    """
    outer, topology = system.body.outer_facets, system.body.mesh.topology
    dim = topology.dim
    topology.create_connectivity(dim, dim - 1)
    cells_of, facets_of = topology.connectivity(dim - 1, dim), topology.connectivity(dim, dim - 1)
    layout = grid.space.dofmap.dof_layout
    surface = np.empty((len(outer), 3 * (dim - 1)), dtype=np.int64)
    for row, facet in enumerate(outer):
        cell = cells_of.links(facet)[0]
        number = int(np.flatnonzero(facets_of.links(cell) == facet)[0])
        surface[row] = grid.space.dofmap.cell_dofs(cell)[sorted(layout.entity_closure_dofs(dim - 1, number))]
    return surface


def _nearest(system: System, name: str, wanted: Array, facets: Nodes, places: Array) -> TrackedPoint:
    """Return the nearest place of facets whose nodes are at places (m, k, 3)."""
    comm, unit = system.comm, system.length_unit
    share = np.empty((0, 1))
    if len(places):  # facets have the nodes on their edges in the order of the corners opposite to them
        at = _barycentric(places, wanted)
        share = state_values.quadratic(at, ((1, 2), (0, 2), (0, 1)) if at.shape[1] == 3 else None)[0]
    closest = np.einsum("mk,mki->mi", share, places)
    distance = np.linalg.norm(closest - wanted, axis=1)
    away = -mpi.largest(comm, -float(distance.min()) if len(distance) else -math.inf)
    # Among equally near places the first in order of x, y, z, so that the rank does not decide.
    near = np.flatnonzero(distance <= away + body.LENGTH_TOLERANCE * unit)
    place = []
    for axis in range(3):
        least = -mpi.largest(comm, -float(closest[near, axis].min()) if len(near) else -math.inf)
        near = near[closest[near, axis] <= least + body.LENGTH_TOLERANCE * unit]
        place.append(least if abs(least) > body.LENGTH_TOLERANCE * unit else 0.0)
    holders = mpi.total(comm, float(bool(len(near))))  # several ranks know a place on an edge between them
    edge = places[near, 0] - places[near, 1] if len(near) else np.zeros((0, 3))
    size = mpi.largest(comm, float(np.linalg.norm(edge, axis=1).max()) if len(near) else -math.inf)
    if away > size:
        told = ", ".join(f"{1e3 * value:.5g}" for value in place)
        raise entries.ProbeError(
            f"point {name} is {away * 1e3:.4g} mm off the surface; the nearest surface point is {told} mm, "
            f"and the cell size there {size * 1e3:.3g} mm. Name a point on the surface of the modelled part"
        )
    first = near[:1]
    return TrackedPoint(facets[first].ravel(), share[first].ravel() / holders, (place[0], place[1], place[2]), away)


def _barycentric(places: Array, wanted: Array) -> Array:
    """Return the barycentric coordinates (m, c) of the places in straight facets, corners first, shape (m, 6, 3) or (m, 3, 3),
    that are nearest to a point, shape (3,)."""
    if places.shape[1] == 3:
        return _on_edge(places[:, 0], places[:, 1], wanted)
    a, b, c = (places[:, i] for i in range(3))
    E = np.stack([b - a, c - a], axis=2)
    inner = np.einsum("mij,mi->mj", np.linalg.pinv(E).transpose(0, 2, 1), wanted - a)
    shares = np.column_stack([1 - inner.sum(axis=1), inner])
    for i, (j, k) in enumerate(((1, 2), (0, 2), (0, 1))):
        outside = shares[:, i] < 0.0
        if outside.any():  # the nearest edge of all three is the nearest place
            edge = np.zeros((int(outside.sum()), 3))
            edge[:, [j, k]] = _on_edge(places[outside, j], places[outside, k], wanted)
            shares[outside] = np.where(_closer(places[outside], edge, shares[outside], wanted)[:, None], edge, shares[outside])
    return shares


def _closer(places: Array, first: Array, second: Array, wanted: Array) -> npt.NDArray[np.bool_]:
    """Return whether the first barycentric coordinates are inside and nearer than the second, or those are outside."""
    away = [np.linalg.norm(np.einsum("mi,mij->mj", at, places[:, :3]) - wanted, axis=1) for at in (first, second)]
    return (second.min(axis=1) < 0.0) | (away[0] < away[1])


def _on_edge(a: Array, b: Array, wanted: Array) -> Array:
    """Return the barycentric coordinates (m, 2) of the places on straight edges that are nearest to a point."""
    along = b - a
    t = np.clip(((wanted - a) * along).sum(axis=1) / (along**2).sum(axis=1), 0.0, 1.0)
    return np.column_stack([1 - t, t])


# ----------------------------------------------------------------------------------------------------------------------
# What a run writes of every state: files, columns and pictures are generated from this registry.


OUTPUTS: names.Registry[table.Output] = names.Registry("output", lambda output: output.key)
"""In the order in which they are computed and stand in ``path.csv``."""
register_output = OUTPUTS.register


def outputs[Kind: table.Output](kind: type[Kind]) -> list[Kind]:
    """Return the outputs of a kind, such as `OutputField`."""
    return [output for output in OUTPUTS.values() if isinstance(output, kind)]


@dataclasses.dataclass(frozen=True)
class Colours:
    """Colouring of a field in pictures: the unit of the colour bar, the factor from SI to it, the value at rest in it, where
    the colours begin, and the power of the value that they follow: stress by its square root, or all but the cavities' walls
    would be dark."""

    unit: str
    factor: float
    rest: float
    power: float = 1.0


@dataclasses.dataclass(frozen=True, eq=False)
class Extreme(table.Variable):
    """The least (``least``) or the largest value of a field over the whole device, or its ``peak``, which no single point
    decides: see `softmodels.runs.state_values.volume_peak`."""

    least: bool = False
    peak: bool = False

    def of_field(self, name: str) -> Extreme:
        """Return it with its value, of the field of this name."""
        return dataclasses.replace(
            self,
            value=lambda s: s.figures.peaks[name] if self.peak else s.figures.extremes[name][0 if self.least else 1],
        )


@dataclasses.dataclass(frozen=True, eq=False)
class OutputField(table.Output):
    """A field over the nodes, in HDF5, XDMF and VTKHDF.

    Attributes:
        unit: SI; "" for a number.
        title: In words.
        nodal: Its values at owned nodes, shape (owned,), (owned, 3) of a vector, or (owned, 3, 3) of a tensor; asked on all
            ranks.
        sampled: Its values where they are exact: at integration points or corners, shape (cells, k). `Figures.extremes` has
            the least and the largest of them over the whole device.
        extremes: Variables of the table with these.
        colours: How pictures show it; None if they do not.
        requested: Whether only runs that ask for it write it.
        axes: What its indices beside the node count, in datasets of xarray.
    """

    unit: str
    title: str
    nodal: Callable[[state_values.StateValues], Array]
    sampled: Callable[[state_values.StateValues], Array] | None = None
    extremes: tuple[Extreme, ...] = ()
    colours: Colours | None = None
    requested: bool = False
    axes: tuple[str, ...] = ("component", "component2")

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "extremes", tuple(extreme.of_field(self.name) for extreme in self.extremes))

    @property
    def rest(self) -> float:
        """Its value at rest, SI; 0 of one without colours."""
        return self.colours.rest / self.colours.factor if self.colours else 0.0

    @property
    def largest(self) -> Extreme | None:
        """The variable of its largest value, if it has one."""
        return next((extreme for extreme in self.extremes if not (extreme.least or extreme.peak)), None)


for _field in (
    OutputField("displacement", "m", "displacement", lambda at: at.displacement),
    OutputField("p", "Pa", "pressure-like unknown", lambda at: at.p),
    OutputField(
        "von_mises", "Pa", "von Mises stress", lambda at: at.at_nodes(at.von_mises, positive=True),
        lambda at: at.von_mises,
        (Extreme("max_von_mises", "kPa", "largest von Mises stress", f"von Mises norm of the deviatoric Cauchy stress; "
                                                                     f"{AT_POINTS}"),
         Extreme("peak_von_mises", "kPa", "peak von Mises stress", f"{state_values.WORDS}; used as the objective and limit of "
                                                                   f"designs", peak=True)),
        Colours("kPa", 1e-3, 0.0, 0.5),
    ),
    OutputField(
        "largest_stretch", "", "largest stretch", lambda at: at.at_nodes(at.stretches[..., -1], positive=True),
        lambda at: at.stretches[..., -1],
        (Extreme("max_stretch", "", "largest stretch",
                 f"largest principal stretch; {AT_POINTS}, so at sharp corners and clamped "
                 f"edges it grows with every refinement of the mesh"),
         Extreme("peak_stretch", "", "peak stretch",
         f"of the largest stretch the {state_values.WORDS}, which converges with the mesh; used "
                 "as the objective and limit of designs", peak=True)),
        Colours("", 1.0, 1.0),
    ),
    OutputField(
        "J", "", "volume ratio", lambda at: at.from_corners(at.J), lambda at: at.J,
        (Extreme("J_min", "", "smallest J", "J, the silicone's volume over that at rest, 1 for an incompressible rubber; over "
                 "the cells' vertices", least=True),
         Extreme("J_max", "", "largest J", "of the same, over the cells' vertices")),
    ),
    OutputField(
        "deformation_gradient", "", "deformation gradient", lambda at: at.gradient_at_nodes, requested=True,
    ),
    OutputField(
        "green_lagrange_strain", "", "Green-Lagrange strain",
        lambda at: at.tensors_at_nodes((np.swapaxes(at.F, -1, -2) @ at.F - np.eye(3)) / 2), requested=True,
    ),
    OutputField("cauchy_stress", "Pa", "Cauchy stress", lambda at: at.cauchy_at_nodes, requested=True),
    OutputField(
        "nominal_stress", "Pa", "first Piola-Kirchhoff stress, force per undeformed area",
        lambda at: at.tensors_at_nodes(
            np.linalg.det(at.F)[..., None, None] * at.cauchy @ np.swapaxes(np.linalg.inv(at.F), -1, -2)
        ), requested=True,
    ),
    OutputField(
        "principal_stresses", "Pa", "principal Cauchy stresses", lambda at: at.principal_stresses[0], requested=True,
        axes=("principal",),
    ),
    OutputField(
        "principal_stress_directions", "", "directions of the principal stresses", lambda at: at.principal_stresses[1],
        requested=True, axes=("principal", "component"),
    ),
    OutputField(
        "principal_stretches", "", "principal stretches", lambda at: at.principal_stretches[0], requested=True,
        axes=("principal",),
    ),
    OutputField(
        "principal_stretch_directions", "", "directions of the principal stretches, undeformed",
        lambda at: at.principal_stretches[1], requested=True, axes=("principal", "component"),
    ),
):  # fmt: skip
    register_output(_field)


def requestable() -> list[str]:
    """Return the names of the fields that only runs that ask for them write."""
    return [field.name for field in outputs(OutputField) if field.requested]


def check_requested(names: Sequence[str]) -> None:
    """Raise `CaseError` for a name that is none of `requestable`."""
    for name in names:
        if name not in requestable():
            raise entries.CaseError(f"fields has {units.brief(name)}; {errors.known_are(name, requestable())}")


def coloured() -> dict[str, tuple[OutputField, Colours]]:
    """Return the fields that pictures show, by name."""
    return {field.name: (field, field.colours) for field in outputs(OutputField) if field.colours is not None}


# ----------------------------------------------------------------------------------------------------------------------
# Figures of rigid parts: their motion, and the forces of the device on them.


def rigid_parts(sampling: state_values.Sampling, state: State) -> dict[str, float]:
    """Return the columns of the rigid parts in the state that is loaded, of the whole device, on all ranks."""
    eq = sampling.system
    moving = {part.label: eq.unknowns.moving[part.label] for part in eq.components if isinstance(part, regions.RigidPart)}
    if not moving:
        return {}
    surplus = eq.surplus()
    drives = eq.drives_at(state)[len(eq.body.actuator.ratios) :]
    figures: dict[str, float] = {}
    for name, motion in moving.items():
        # All forces on the part's nodes act on it, the silicone's weight there included, except its own loads.
        forces = -surplus - eq.dead.borne(motion.dofs.ravel(), drives)
        figures |= {f"{name}_{key}": value for key, value in _figures(eq, motion, forces)}
    return figures


def _figures(eq: System, motion: regions.RigidMotion, forces: Array) -> Iterator[tuple[str, float]]:
    """Yield the columns of one part, without its name, and their values."""
    actuator, free = eq.body.actuator, motion.freedom
    length, unit = eq.length_unit, eq.stress_unit * eq.length_unit**2 * actuator.copies
    directions, axes = rigid.symmetric_motions(actuator)
    for axis in _axes(body.in_space(free.directions)):
        yield f"{'xyz'[axis]}_mm", float(body.in_space(motion.translation)[axis]) * length * 1e3
    for axis in _axes(free.axes):
        yield f"turn_{'xyz'[axis]}_deg", float(np.degrees(regions.rotation_vector(motion.rotation)[axis]))
    force, moment = motion.wrench(forces)
    force = body.in_space(force @ directions.T @ directions) * unit  # the rest, the device's other slices push back
    along = free.directions[0] if len(free.directions) == 1 else None
    yield "force_N", float(force @ (np.asarray(actuator.lift) if along is None else body.in_space(along)))
    if len(directions) > 1:
        for axis in _axes(body.in_space(directions)):
            yield f"force_{'xyz'[axis]}_N", float(force[axis])
    for axis in _axes(axes):
        yield f"moment_{'xyz'[axis]}_Nmm", float((moment @ axes.T @ axes)[axis]) * unit * length * 1e3


def _axes(vectors: Array) -> list[int]:
    """Return the device's axes along which vectors have a component."""
    return [axis for axis in range(3) if np.abs(vectors[:, axis]).max(initial=0.0) > 1e-9]


# ----------------------------------------------------------------------------------------------------------------------
# Forces and stiffness of the whole device, computed on all ranks.


def _force_unit(eq: System) -> float:
    """Return N of the whole device for a dimensionless force on the modelled slice."""
    return eq.stress_unit * eq.length_unit**2 * eq.body.actuator.copies


def blocked_force(sampling: state_values.Sampling, state: State) -> dict[str, float]:
    """Return the blocked force in N of the whole device, if it is blocked."""
    role = sampling.system.body.actuator.blocked
    return {} if role is None else {"blocked_force": _held_along_lift(sampling.system, role)}


def standing_force(sampling: state_values.Sampling, state: State) -> dict[str, float]:
    """Return the force in N with which the whole device presses on what it stands on, if it stands."""
    body = sampling.system.body
    role = body.actuator.standing if not body.seal else ""
    return {f"{role}_force": -_held_along_lift(sampling.system, role)} if role else {}


def _held_along_lift(eq: System, role: str) -> float:
    """Return the force in N of the whole device along the lift on what holds a face."""
    # Held along the lift, so one row of the skew basis is the lift.
    along = body.in_section(eq.body.actuator.lift, eq.body.actuator.dimension)
    return system.held_force(eq, role, int(np.argmax(eq.body.skew @ along))) * _force_unit(eq)


def stiffness(sampling: state_values.Sampling, state: State) -> dict[str, float]:
    """Return the tangent stiffness in N/m of the whole device along the lift, if the device defines one.

    The load is spread over the `Actuator.pushed` face, and the motion is that face's mean; the pressure is kept.
    """
    eq = sampling.system
    actuator = eq.body.actuator
    if actuator.pushed is None or eq.potential.motion:  # a device that moves has none at its pressure
        return {}
    compliance = sampling.solver.dead_load_compliance(state, sampling.push)  # of a unit load on each slice
    unit = eq.stress_unit * eq.length_unit * actuator.copies
    return {f"{actuator.pushed}_stiffness": unit / compliance if compliance else np.inf}  # held


for _measure in (
    table.Variable(
        "blocked_force", "N", "blocked force", "blocked force of the whole device along its lift", measured=blocked_force
    ),
    table.Variable(
        "(lip)_force", "N", "force of the {0}",
        "force with which the {0} of the whole device presses on the plane; at 0 it lifts off", measured=standing_force,
    ),
    table.Variable(
        r"(\w+)_stiffness", "N_per_m", "{0} stiffness",
        "force along the lift, spread over the {0}, per rise of it at this pressure", measured=stiffness,
    ),
):  # fmt: skip
    register_output(_measure)
