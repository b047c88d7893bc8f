"""What is worth looking at in a state: stresses, stretches, volume ratios, the rise of named points.

Stresses of an isotropic law need only the principal stretches and the law's own energy in numpy, differentiated by a
complex step (exact to rounding); nothing is written twice and nothing compiled but F.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import Any

import numpy as np
import numpy.typing as npt

from geometries.actuator import Vector
from softmodels.case.gauges import NONE, Gauges, followed_text
from softmodels.materials.laws import Material
from softmodels.materials.strain import HomogeneousStrain
from softmodels.mechanics.mpi import largest, total
from softmodels.mechanics.solver import Equilibrium, Tangent
from softmodels.mechanics.system import State
from softmodels.results.followed import Followed, followed_points
from softmodels.results.grid import Grid, displacement_maps
from softmodels.results.self_contact import Walls
from softmodels.results.volume_ratio import VolumeRatio, barycentric


def principal_stretches(F: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Principal stretches of deformation gradients, shape (..., 3, 3) to (..., 3), rising."""
    return np.sqrt(np.maximum(np.linalg.eigvalsh(np.swapaxes(F, -1, -2) @ F), 0.0))


def shape_stresses(material: Material, stretches: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Principal Cauchy stresses in Pa of the law's shape part, lambda_i dW/dlambda_i / J; shapes (..., 3)."""
    h = 1e-30
    J = stretches.prod(axis=-1)
    result = np.empty_like(stretches)
    for i in range(3):
        moved = [stretches[..., k] + (1j * h if k == i else 0.0) for k in range(3)]
        slope = np.imag(material.shape(HomogeneousStrain((moved[0], moved[1], moved[2])), material)) / h
        result[..., i] = stretches[..., i] * slope / J
    return result


def von_mises(stresses: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Von Mises stress of principal stresses, shape (..., 3); a hydrostatic part changes nothing."""
    a, b, c = np.moveaxis(stresses, -1, 0)
    return np.sqrt(((a - b) ** 2 + (b - c) ** 2 + (c - a) ** 2) / 2)


@dataclasses.dataclass(frozen=True)
class Figures:
    """One state in numbers, of the whole device, SI units.

    Extremes of stretch and stress are over the integration points. Those of J are over the vertices, as `VolumeRatio` has
    it: that is where the elements keep the volume, and cells and points scatter around it by an error of the mesh.

    ``cavity_pressures`` and ``cavity_volumes`` (added ones) are of each cavity. ``added_volume`` is what a pressure common to
    all works on: their sum, or the sum of their products with the device's pressure ratios.
    ``rises`` are the probes' displacements along the lift, ``device`` is what `Actuator.device_figures` makes of their
    places, ``max_stretch_at`` the undeformed place of the largest stretch in device coordinates.
    """

    pressure: float
    added_volume: float
    cavity_pressures: tuple[float, ...]
    cavity_volumes: tuple[float, ...]
    rises: dict[str, float]
    device: dict[str, float]
    max_displacement: float
    max_stretch: float
    max_stretch_at: tuple[float, float, float]
    max_von_mises: float
    J_min: float
    J_max: float
    stored_energy: float


def _linear_fit(points: npt.NDArray[np.float64], places: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Matrix that takes values at points of the reference cell to the least-squares linear function's at places."""
    at_points, at_places = (np.column_stack([np.ones(len(x)), x]) for x in (points, places))
    return at_places @ np.linalg.pinv(at_points)


def _place(start: Vector, shift: npt.NDArray[np.float64]) -> Vector:
    x, y, z = np.asarray(start) + shift
    return float(x), float(y), float(z)


RAW = (("restart_state_u", "restart_state_p"), ("restart_rate_u", "restart_rate_p"))
"""Names of a state's dofs, and of the path's direction there, among a step's fields: dimensionless, for a restart alone."""


class Fields:
    """Nodal fields and key figures of an equilibrium's states.

    Stresses and stretches at a node are the mean of what the adjoining cells have there by a linear fit through their
    integration points: between those points, and at nodes above all, the strains of a coarse cell are no good, and where
    it nearly folds they are beyond all bounds. The volume ratio is linear between the vertices, where `VolumeRatio` tells it.
    """

    @functools.cached_property
    def walls(self) -> Walls:
        """The device's surface, on rank 0."""
        planes = [plane.normal for plane in self.equilibrium.body.actuator.cut_planes]
        return Walls(self.grid.points, self.grid.cells, self.grid.cell_name, planes)

    def __init__(self, equilibrium: Equilibrium, gauges: Gauges = NONE):
        import ufl
        from dolfinx import fem, la

        self.equilibrium, self.grid = equilibrium, Grid(equilibrium)
        self.skew, self.pressures = displacement_maps(equilibrium, self.grid)
        space = self.grid.space
        options = {"jit_options": {"cffi_extra_compile_args": ["-O2"]}}
        F = equilibrium.body.deformation_gradient(equilibrium.displacement, at_axis=True)
        self._to_nodes = _linear_fit(equilibrium.points, space.element.interpolation_points)
        self._between = barycentric(space.element.interpolation_points)
        self._at_points = fem.Expression(F, equilibrium.points, **options)
        self._dofs = space.dofmap.list[: len(equilibrium.cells)]
        self._sum = la.vector(space.dofmap.index_map, 1)
        self._share = self._added(np.ones(self._dofs.shape))
        self._ratio = VolumeRatio(equilibrium.body, space)
        self.rest_volume = equilibrium.rest().V
        self._rest_volumes = equilibrium.volumes()
        self._places = fem.Expression(ufl.SpatialCoordinate(equilibrium.body.mesh), equilibrium.points, **options)
        self._push: npt.NDArray[np.float64] | None = None
        self._probes = {name: self._owner(point) for name, point in equilibrium.body.actuator.probes.items()}
        self._gauges, self._followed = gauges, followed_points(equilibrium, self.grid, gauges)

    @property
    def followed(self) -> list[str]:
        """Where the named points are followed: a sentence on each."""
        return [followed_text(name, one.place, one.away) for name, one in self._followed.items()]

    def _added(self, values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Sum of cell-node values over the cells of each node, owned nodes."""
        from dolfinx import la

        self._sum.array[:] = 0.0
        np.add.at(self._sum.array, self._dofs, values)
        self._sum.scatter_reverse(la.InsertMode.add)
        return self._sum.array[: self.grid.owned].copy()

    def _owner(self, point: Any) -> int:
        """Local owned node at a device point, or -1 on the ranks that do not own it."""
        eq = self.equilibrium
        here = self.grid.space.tabulate_dof_coordinates()[: self.grid.owned] * eq.length_unit
        distance = np.linalg.norm(eq.body.actuator.device_points(here) - np.asarray(point), axis=1)
        node = int(np.argmin(distance)) if len(distance) else -1
        near = float(distance[node]) if node >= 0 else math.inf
        closest = -largest(eq.comm, -near)
        return node if near == closest and closest < 1e-6 * eq.length_unit else -1

    def _gradients(self, expression: Any) -> npt.NDArray[np.float64]:
        eq = self.equilibrium
        values = expression.eval(eq.body.mesh, eq.cells)
        return values.reshape(len(eq.cells), -1, 3, 3)

    def _displacement(self, state: State) -> npt.NDArray[np.float64]:
        """Displacement in m in device coordinates at owned nodes, shape (owned, 3)."""
        eq = self.equilibrium
        u = state.w[self.skew[: self.grid.owned]] @ eq.body.skew_inverse.T * eq.length_unit
        return u if self.grid.dimension == 3 else np.column_stack([u[:, 0], np.zeros(len(u)), u[:, 1]])

    def shape(self, w: npt.NDArray[np.float64]) -> npt.NDArray[np.float64] | None:
        """Displacement of dofs such as a mode's over the grid's nodes in device coordinates, (n, 3) in m, on rank 0."""
        return self.grid.collect(self._displacement(State(w, 0.0, 0.0)))  # type: ignore[no-any-return]

    def figures(self, state: State) -> Figures:
        """Key figures of a state."""
        eq = self.equilibrium
        eq.load(state)
        u = self._displacement(state)
        actuator = eq.body.actuator
        lift = np.asarray(actuator.lift)
        moved = {name: self._at(u, node) for name, node in self._probes.items()}
        named = {name: self._moved(state, one) for name, one in self._followed.items()}
        places = {name: one.place for name, one in self._followed.items()}
        F = self._gradients(self._at_points)
        stretches, J = principal_stretches(F), self._ratio.at_corners(np.linalg.det(F))
        stress = von_mises(shape_stresses(eq.material, stretches))

        def most(values: npt.NDArray[np.float64]) -> float:
            return largest(eq.comm, float(values.max()) if values.size else -math.inf)

        peak = most(stretches)
        added = (eq.volumes() - self._rest_volumes) * eq.volume_unit
        pressures = eq.pressures_at(state) * eq.stress_unit
        return Figures(
            pressure=state.P * eq.stress_unit,
            added_volume=float(actuator.ratios @ added),
            cavity_pressures=tuple(pressures.tolist()),
            cavity_volumes=tuple(added.tolist()),
            rises={name: float(shift @ lift) for name, shift in moved.items()},
            device={
                **actuator.device_figures({name: _place(actuator.probes[name], moved[name]) for name in moved}),
                **self._gauges.figures(places, named, actuator.lift),
                **self._blocked(),
                **self._pressed(state),
                **self._stiffness(state),
            },
            max_displacement=most(np.linalg.norm(u, axis=1)),
            max_stretch=peak,
            max_stretch_at=self._place_of(stretches[..., -1], peak),
            max_von_mises=most(stress),
            J_min=-most(-J),
            J_max=most(J),
            stored_energy=eq.stored_energy() * eq.stress_unit * eq.volume_unit,
        )

    def _at(self, u: npt.NDArray[np.float64], node: int) -> npt.NDArray[np.float64]:
        """Displacement (3,) of a node that one rank owns, on all ranks; ``node`` is -1 on the others."""
        return np.array([total(self.equilibrium.comm, float(u[node, i]) if node >= 0 else 0.0) for i in range(3)])

    def _moved(self, state: State, one: Followed) -> npt.NDArray[np.float64]:
        """Displacement (3,) in m of a followed place, on all ranks."""
        eq = self.equilibrium
        u = one.weights @ state.w[self.skew[one.nodes]] @ eq.body.skew_inverse.T * eq.length_unit
        u = u if self.grid.dimension == 3 else np.array([u[0], 0.0, u[1]])
        return np.array([total(eq.comm, float(value)) for value in u])

    def _blocked(self) -> dict[str, float]:
        """Force in N of the whole device on what blocks it, if something does."""
        eq = self.equilibrium
        role = eq.body.actuator.blocked
        if role is None:
            return {}
        # Held along the lift, so one row of the skew basis is the lift.
        component = int(np.argmax(eq.body.skew @ np.asarray(eq.body.actuator.lift)))
        unit = eq.stress_unit * eq.length_unit**2 * eq.body.actuator.copies
        return {"blocked_force_N": eq.force(role, component) * unit}

    def _pressed(self, state: State) -> dict[str, float]:
        """Force in N of the whole device on the plane that stops it, and how deep it has sunk in; nothing without one.

        Planes that a cut-out slice's copies bring along count with theirs.
        """
        from dolfinx import fem

        eq, contact = self.equilibrium, self.equilibrium.contact
        if contact is None:
            return {}
        nodes = fem.locate_dofs_topological(self.grid.space, eq.body.mesh.topology.dim - 1, contact.facets)
        nodes = nodes[nodes < self.grid.owned]
        d = self.grid.dimension
        places = self.grid.space.tabulate_dof_coordinates()[nodes, :d]
        gaps = contact.gaps(places + state.w[self.skew[nodes]] @ eq.body.skew_inverse.T)
        deepest = largest(eq.comm, float(-gaps.min()) if gaps.size else -math.inf)
        unit = eq.stress_unit * eq.length_unit**2 * eq.body.actuator.copies
        return {
            "contact_force_N": eq.contact_force() * unit,
            "contact_depth_mm": max(deepest, 0.0) * eq.length_unit * 1e3,
        }

    def _stiffness(self, state: State) -> dict[str, float]:
        """Stiffness in N/m of the whole device along the lift at a state, if it tells of one: a tangent, no difference.

        The load is spread over the `Actuator.pushed` face, and the motion is that face's mean; the pressure is kept.
        """
        eq = self.equilibrium
        actuator = eq.body.actuator
        if actuator.pushed is None:
            return {}
        if self._push is None:
            self._push = eq.face_load(actuator.pushed, actuator.lift)
        compliance = eq.dead_load_compliance(state, self._push)  # of a unit load on each slice
        unit = eq.stress_unit * eq.length_unit * actuator.copies
        return {f"{actuator.pushed}_stiffness_N_per_m": unit / compliance}

    def _place_of(self, values: npt.NDArray[np.float64], peak: float) -> tuple[float, float, float]:
        """Where a value at the integration points, shape (cells, points), reaches its peak over all ranks."""
        eq = self.equilibrium
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

    def nodal(self, state: State) -> dict[str, npt.NDArray[np.float64]] | None:
        """Fields over the grid's nodes by name, SI units, on rank 0; None elsewhere.

        ``displacement`` (n, 3) m; ``p`` (n,) Pa, the pressure-like unknown (J - 1 times the bulk); ``von_mises_stress``
        (n,) Pa; ``largest_stretch`` (n,); ``J`` (n,).
        """
        eq = self.equilibrium
        eq.load(state)
        F = self._gradients(self._at_points)
        stretches = principal_stretches(F)
        stress = np.maximum(von_mises(shape_stresses(eq.material, stretches)) @ self._to_nodes.T, 0.0)
        stretch = np.maximum(stretches[..., -1] @ self._to_nodes.T, 0.0)
        J = self._ratio.at_corners(np.linalg.det(F)) @ self._between.T
        fields = {
            "displacement": self._displacement(state),
            "p": self._pressure(state, J) * eq.stress_unit,
            **{
                name: self._added(values) / self._share
                for name, values in (("von_mises_stress", stress), ("largest_stretch", stretch), ("J", J))
            },
        }
        whole = {name: self.grid.collect(values) for name, values in fields.items()}
        return None if any(values is None for values in whole.values()) else whole  # type: ignore[return-value]

    def raw(self, state: State, tangent: Tangent) -> dict[str, npt.NDArray[np.float64]] | None:
        """Dofs of a state and of the path's direction there over the grid's nodes, to the last bit; on rank 0, None elsewhere.

        A path magnifies what its states differ by, three to five times in a step, as far as Newton's tolerance lets it: at a
        sharp corner a rounded last digit of a state would be 1e-6 of the largest stress after 15 steps.
        """
        found: dict[str, Any] = {}
        for (u, p), w in zip(RAW, (state.w, tangent.w), strict=True):
            found[u] = self.grid.collect(w[self.skew[: self.grid.owned]])
            found[p] = self.grid.collect(self._vertex_values(w))
        return None if any(values is None for values in found.values()) else found

    def dofs(self, u: npt.NDArray[np.float64] | None, p: npt.NDArray[np.float64] | None) -> npt.NDArray[np.float64]:
        """The dofs that `raw` took apart, from its two arrays on rank 0, None elsewhere."""
        from dolfinx import fem

        function = fem.Function(self.equilibrium.space)
        function.x.array[self.skew[: self.grid.owned]] = self.grid.distribute(u)
        if self.pressures is not None:
            at = self.pressures[: self.grid.owned]
            function.x.array[at[at >= 0]] = self.grid.distribute(p)[at >= 0]
        function.x.scatter_forward()
        return function.x.array.copy()

    def _vertex_values(self, w: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """The unknown p at owned nodes that have one, 0 elsewhere."""
        if self.pressures is None:
            return np.zeros(self.grid.owned)
        at = self.pressures[: self.grid.owned]
        return np.where(at >= 0, w[at], 0.0)

    def _pressure(self, state: State, J: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Dimensionless p at owned nodes: the unknown, linear between its vertices; bulk (J - 1) without one."""
        if self.pressures is None:
            return self._added(J - 1.0) / self._share * float(self.equilibrium.bulk.value)
        values = np.where(self.pressures >= 0, state.w[self.pressures], 0.0)[self._dofs]
        return self._added(values[:, : self._between.shape[1]] @ self._between.T) / self._share

    def state(self, nodal: dict[str, npt.NDArray[np.float64]] | None, P: float, V: float) -> State:
        """The state that `nodal` was made of.

        Args:
            nodal: At least ``displacement`` and ``p`` on rank 0; None elsewhere.
            P: Its cavity pressure, dimensionless.
            V: Its cavity volume, dimensionless.
        """
        from dolfinx import fem

        eq, grid = self.equilibrium, self.grid
        u = grid.distribute(None if nodal is None else nodal["displacement"]) / eq.length_unit
        p = grid.distribute(None if nodal is None else nodal["p"]) / eq.stress_unit
        u = u if grid.dimension == 3 else u[:, [0, 2]]
        function = fem.Function(eq.space)
        function.x.array[self.skew[: grid.owned]] = u @ eq.body.skew.T
        if self.pressures is not None:
            dofs = self.pressures[: grid.owned]
            function.x.array[dofs[dofs >= 0]] = p[dofs >= 0]
        function.x.scatter_forward()
        return State(function.x.array.copy(), P, V)
