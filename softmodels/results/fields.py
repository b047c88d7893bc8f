"""Nodal fields and key figures of an equilibrium's states: what is worth looking at in them."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from geometries.actuator import Vector
from softmodels.case.gauges import NONE, Gauges, followed_text
from softmodels.mechanics.compiling import JIT
from softmodels.mechanics.mpi import largest, total
from softmodels.mechanics.parts import PartError
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import State
from softmodels.mechanics.tangent import Tangent
from softmodels.results.figures import Figures
from softmodels.results.followed import Followed, followed_points
from softmodels.results.forces import MEASURES
from softmodels.results.grid import Grid
from softmodels.results.output_fields import FIELDS
from softmodels.results.peak import volume_peak
from softmodels.results.self_contact import Walls
from softmodels.results.state_dofs import StateDofs
from softmodels.results.state_values import Sampling, StateValues

Array = npt.NDArray[np.float64]


class Fields:
    """Nodal fields and key figures of an equilibrium's states.

    Args:
        solver: The device.
        gauges: Points and angles that the user has named.

    Attributes:
        grid: The nodes that results are written on.
        rest_volume: Of the cavity, dimensionless.
    """

    def __init__(self, solver: Solver, gauges: Gauges = NONE):
        import ufl
        from dolfinx import fem

        self.solver, self.system = solver, solver.system
        system = self.system
        self.grid = Grid(system)
        self.sampling = Sampling(solver, self.grid)
        self._dofs = StateDofs(self.sampling)
        self.rest_volume = system.rest().V
        self._rest_volumes = system.volumes()
        places = ufl.SpatialCoordinate(system.body.mesh)
        self._places = fem.Expression(places, system.points, jit_options=JIT)
        self._probes = {name: self._owner(point) for name, point in system.body.actuator.probes.items()}
        self._gauges, self._followed = gauges, followed_points(system, self.grid, gauges)

    @functools.cached_property
    def walls(self) -> Walls:
        """The device's surface, on rank 0."""
        planes = [plane.normal for plane in self.system.body.actuator.cut_planes]
        return Walls(self.grid.points, self.grid.cells, self.grid.cell_name, planes)

    @property
    def followed(self) -> list[str]:
        """Where the named points are followed: a sentence on each."""
        return [followed_text(name, one.away, one.place) for name, one in self._followed.items()]

    def values(self, state: State) -> StateValues:
        """A state's values; the state is loaded into the equations."""
        self.system.load(state)
        return StateValues(self.sampling, state)

    def shape(self, w: Array) -> Array | None:
        """Displacement of dofs such as a mode's over the grid's nodes in device coordinates, (n, 3) in m, on rank 0."""
        return self.grid.collect(self.sampling.displacement(w))

    def nodal(self, state: State) -> dict[str, Array] | None:
        """All of `FIELDS` over the grid's nodes by name, SI units, shape (n,) or (n, 3), on rank 0; None elsewhere."""
        values = self.values(state)
        found = {field.name: self.grid.collect(field.nodal(values)) for field in FIELDS}
        whole = {name: field for name, field in found.items() if field is not None}
        return whole if len(whole) == len(found) else None

    def raw(self, state: State, tangent: Tangent) -> dict[str, Array] | None:
        """What a restart needs of a state and of the path's direction there; see `StateDofs.raw`."""
        return self._dofs.raw(state, tangent)

    def dofs(self, u: Array | None, p: Array | None) -> Array:
        """The dofs that `raw` took apart; see `StateDofs.dofs`."""
        return self._dofs.dofs(u, p)

    def state(self, nodal: Mapping[str, Array] | None, P: float, V: float) -> State:
        """The state that `nodal` was made of; see `StateDofs.state`."""
        return self._dofs.state(nodal, P, V)

    def figures(self, state: State) -> Figures:
        """Key figures of a state."""
        eq, values = self.system, self.values(state)
        actuator, u = eq.body.actuator, values.displacement
        lift = np.asarray(actuator.lift)
        moved = self.probes_moved(state.w)
        named = {name: self._moved(state, one) for name, one in self._followed.items()}
        places = {name: one.place for name, one in self._followed.items()}
        extremes = {field.name: self._extremes(field.sampled(values)) for field in FIELDS if field.sampled is not None}
        added = (eq.volumes() - self._rest_volumes) * eq.volume_unit
        pressures = eq.pressures_at(state) * eq.stress_unit
        device = together(
            actuator.device_figures({name: _place(actuator.probes[name], moved[name]) for name in moved}),
            self._gauges.figures(places, named, actuator.lift),
            *(measure.compute(self.sampling, state) for measure in MEASURES),
        )
        return Figures(
            pressure=state.P * eq.stress_unit if eq.drives_cavities else float(pressures.max(initial=0.0)),
            added_volume=float(actuator.ratios @ added),
            cavity_pressures=tuple(pressures.tolist()),
            cavity_volumes=tuple(added.tolist()),
            rises={name: float(shift @ lift) for name, shift in moved.items()},
            device=device,
            max_displacement=self._extremes(np.linalg.norm(u, axis=1))[1],
            max_stretch_at=self._place_of(values.stretches[..., -1], extremes["largest_stretch"][1]),
            extremes=extremes,
            peaks={
                field.name: volume_peak(eq.comm, field.sampled(values), eq.point_volumes())[0]
                for field in FIELDS
                if field.sampled is not None and any(one.peak for one in field.extremes)
            },
            stored_energy=eq.stored_energy() * eq.stress_unit * eq.volume_unit,
        )

    def _extremes(self, values: Array) -> tuple[float, float]:
        """The least and the largest value over all ranks."""
        comm = self.system.comm
        least = -largest(comm, float((-values).max()) if values.size else -math.inf)
        return least, largest(comm, float(values.max()) if values.size else -math.inf)

    def _owner(self, point: Vector) -> int:
        """Local owned node at a device point, or -1 on the ranks that do not own it."""
        eq = self.system
        here = self.grid.space.tabulate_dof_coordinates()[: self.grid.owned] * eq.length_unit
        distance = np.linalg.norm(eq.body.actuator.device_points(here) - np.asarray(point), axis=1)
        node = int(np.argmin(distance)) if len(distance) else -1
        near = float(distance[node]) if node >= 0 else math.inf
        closest = -largest(eq.comm, -near)
        return node if near == closest and closest < 1e-6 * eq.length_unit else -1

    def probes_moved(self, w: Array) -> dict[str, Array]:
        """Displacement (3,) in m of each probe in device coordinates, of dofs or of a change of them, on all ranks."""
        u = self.sampling.displacement(w)
        return {name: self._at(u, node) for name, node in self._probes.items()}

    def _at(self, u: Array, node: int) -> Array:
        """Displacement (3,) of a node that one rank owns, on all ranks; ``node`` is -1 on the others."""
        return np.array([total(self.system.comm, float(u[node, i]) if node >= 0 else 0.0) for i in range(3)])

    def _moved(self, state: State, one: Followed) -> Array:
        """Displacement (3,) in m of a followed place, on all ranks."""
        eq = self.system
        u = one.weights @ state.w[self.sampling.skew[one.nodes]] @ eq.body.skew_inverse.T * eq.length_unit
        u = u if self.grid.dimension == 3 else np.array([u[0], 0.0, u[1]])
        return np.array([total(eq.comm, float(value)) for value in u])

    def _place_of(self, values: Array, peak: float) -> tuple[float, float, float]:
        """Where a value at the integration points, shape (cells, points), reaches its peak over all ranks."""
        eq = self.system
        found = np.empty((0, 3))
        near = values >= peak * (1 - 1e-9)
        cells = np.flatnonzero(near.any(axis=1))
        if cells.size:
            places = self._places.eval(eq.body.mesh, eq.cells[cells])
            places = places.reshape(*near[cells].shape, -1)[near[cells]]
            flat = np.column_stack([places, np.zeros((len(places), 3 - places.shape[1]))]) * eq.length_unit
            found = eq.body.actuator.device_points(flat)
        # Of equal ones, as at rest, the first in order of x, y, z: no rounding and no rank decides.
        place = []
        for axis in range(3):
            least = -largest(eq.comm, -float(found[:, axis].min()) if len(found) else -math.inf)
            found = found[found[:, axis] <= least + 1e-9 * eq.length_unit]
            place.append(least)
        return place[0], place[1], place[2]


def together(*groups: Mapping[str, float]) -> dict[str, float]:
    """Columns of ``path.csv`` in one.

    Raises:
        PartError: Two of them bear one name, as a rigid part ``tip`` and a device whose tip has a column of its own.
    """
    found: dict[str, float] = {}
    for group in groups:
        if twice := sorted(found.keys() & group.keys()):
            raise PartError(
                f"two figures of this device and its parts would be the column {twice[0]} of path.csv; give the part, point or "
                "angle that is named in it another name"
            )
        found |= group
    return found


def _place(start: Vector, shift: Array) -> Vector:
    x, y, z = np.asarray(start) + shift
    return float(x), float(y), float(z)
