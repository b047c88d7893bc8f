"""What is worth looking at in a state: stresses, stretches, volume ratios, the rise of named points.

Stresses of an isotropic law need only the principal stretches and the law's own energy in numpy, differentiated by a
complex step (exact to rounding); nothing is written twice and nothing compiled but F.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import numpy.typing as npt

from softmodels.equilibrium import Equilibrium, State
from softmodels.grid import Grid, displacement_maps
from softmodels.materials import Material
from softmodels.parallel import largest, total
from softmodels.strain import HomogeneousStrain


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

    Extremes of stretch and stress are over the integration points. Those of J are over the cells' means: elements that
    keep the volume do so in the mean, and their single points scatter around it by an error of the mesh.
    """

    pressure: float
    added_volume: float
    rises: dict[str, float]
    max_displacement: float
    max_stretch: float
    max_von_mises: float
    J_min: float
    J_max: float
    stored_energy: float


class Fields:
    """Nodal fields and key figures of an equilibrium's states.

    Stresses and stretches at a node are the mean of the adjoining cells' values there, the volume ratio that of the
    cells' own means.
    """

    def __init__(self, equilibrium: Equilibrium):
        from dolfinx import fem, la

        self.equilibrium, self.grid = equilibrium, Grid(equilibrium)
        self.skew, self.pressures = displacement_maps(equilibrium, self.grid)
        space = self.grid.space
        options = {"jit_options": {"cffi_extra_compile_args": ["-O2"]}}
        F = equilibrium.body.deformation_gradient(equilibrium.displacement, at_axis=True)
        self._at_nodes = fem.Expression(F, space.element.interpolation_points, **options)
        self._at_points = fem.Expression(F, equilibrium.points, **options)
        self._dofs = space.dofmap.list[: len(equilibrium.cells)]
        self._sum = la.vector(space.dofmap.index_map, 1)
        self._share = self._added(np.ones(self._dofs.shape))
        self.rest_volume = equilibrium.rest().V
        self._probes = {name: self._owner(point) for name, point in equilibrium.body.actuator.probes.items()}

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
        lift = np.asarray(eq.body.actuator.lift)
        F = self._gradients(self._at_points)
        stretches, J = principal_stretches(F), np.linalg.det(F).mean(axis=1)
        stress = von_mises(shape_stresses(eq.material, stretches))

        def most(values: npt.NDArray[np.float64]) -> float:
            return largest(eq.comm, float(values.max()) if values.size else -math.inf)

        return Figures(
            pressure=state.P * eq.stress_unit,
            added_volume=(state.V - self.rest_volume) * eq.volume_unit,
            rises={
                name: total(eq.comm, float(u[node] @ lift) if node >= 0 else 0.0) for name, node in self._probes.items()
            },
            max_displacement=most(np.linalg.norm(u, axis=1)),
            max_stretch=most(stretches),
            max_von_mises=most(stress),
            J_min=-most(-J),
            J_max=most(J),
            stored_energy=eq.stored_energy() * eq.stress_unit * eq.volume_unit,
        )

    def nodal(self, state: State) -> dict[str, npt.NDArray[np.float64]] | None:
        """Fields over the grid's nodes by name, SI units, on rank 0; None elsewhere.

        ``displacement`` (n, 3) m; ``p`` (n,) Pa, the pressure-like unknown (J - 1 times the bulk); ``von_mises_stress``
        (n,) Pa; ``largest_stretch`` (n,); ``J`` (n,).
        """
        eq = self.equilibrium
        eq.load(state)
        F = self._gradients(self._at_nodes)
        stretches = principal_stretches(F)
        stress = von_mises(shape_stresses(eq.material, stretches))
        means = np.linalg.det(self._gradients(self._at_points)).mean(axis=1)
        J = np.repeat(means[:, None], F.shape[1], axis=1)
        fields = {
            "displacement": self._displacement(state),
            "p": self._pressure(state, J) * eq.stress_unit,
            **{
                name: self._added(values) / self._share
                for name, values in (("von_mises_stress", stress), ("largest_stretch", stretches[..., -1]), ("J", J))
            },
        }
        whole = {name: self.grid.collect(values) for name, values in fields.items()}
        return None if any(values is None for values in whole.values()) else whole  # type: ignore[return-value]

    def _pressure(self, state: State, J: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Dimensionless p at owned nodes: the unknown, linear between its vertices; bulk (J - 1) without one."""
        if self.pressures is None:
            return self._added(J - 1.0) / self._share * float(self.equilibrium.bulk.value)
        values = np.where(self.pressures >= 0, state.w[self.pressures], 0.0)[self._dofs]
        vertices = self.grid.dimension + 1
        points = self.grid.space.element.interpolation_points
        barycentric = np.column_stack([1 - points.sum(axis=1), points])
        return self._added(values[:, :vertices] @ barycentric.T) / self._share

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
