"""One state's values at integration points, at vertices and over the nodes: what output fields are computed from."""

from __future__ import annotations

import functools

import numpy as np
import numpy.typing as npt

from softmodels.mechanics.compiling import JIT
from softmodels.mechanics.face_load import face_load
from softmodels.mechanics.section_axes import in_space
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import State, System
from softmodels.results.grid import Grid, displacement_maps
from softmodels.results.stresses import principal_stretches, shape_stresses, von_mises
from softmodels.results.volume_ratio import VolumeRatio, barycentric

Array = npt.NDArray[np.float64]


class Sampling:
    """Where values are taken on a mesh, and how they come to the nodes; the same for every state.

    Args:
        solver: The device.
        grid: The nodes that results are written on.

    Attributes:
        skew, pressures: Where a state's entries sit on the grid, see `displacement_maps`.
    """

    def __init__(self, solver: Solver, grid: Grid):
        from dolfinx import fem, la

        self.solver, self.system, self.grid = solver, solver.system, grid
        system = self.system
        self.skew, self.pressures = displacement_maps(system, grid)
        space = grid.space
        F = system.body.deformation_gradient(system.potential.displacement, at_axis=True)
        self.to_nodes = _linear_fit(system.points, space.element.interpolation_points)
        self.between = barycentric(space.element.interpolation_points)
        self._gradients = fem.Expression(F, system.points, jit_options=JIT)
        self._dofs = space.dofmap.list[: len(system.cells)]
        self._sum = la.vector(space.dofmap.index_map, 1)
        self._share = self._added(np.ones(self._dofs.shape))
        self.ratio = VolumeRatio(system.body, space, [region.cells for region in system.potential.regions])

    @functools.cached_property
    def push(self) -> Array:
        """A unit load along the lift, spread over the device's `Actuator.pushed` face, as dofs."""
        actuator = self.system.body.actuator
        assert actuator.pushed is not None
        return face_load(self.system, actuator.pushed, actuator.lift)

    def gradients(self) -> Array:
        """Deformation gradients of the state that is loaded, shape (cells, points, 3, 3)."""
        eq = self.system
        return self._gradients.eval(eq.body.mesh, eq.cells).reshape(len(eq.cells), -1, 3, 3)

    def average(self, values: Array) -> Array:
        """Means over the cells of each owned node, of values at the cells' nodes, shape (cells, nodes)."""
        return self._added(values) / self._share

    def _added(self, values: Array) -> Array:
        """Sum of cell-node values over the cells of each node, owned nodes."""
        from dolfinx import la

        self._sum.array[:] = 0.0
        np.add.at(self._sum.array, self._dofs, values)
        self._sum.scatter_reverse(la.InsertMode.add)
        return self._sum.array[: self.grid.owned].copy()

    def displacement(self, w: Array) -> Array:
        """Displacement of dofs in m in device coordinates at owned nodes, shape (owned, 3)."""
        eq = self.system
        return in_space(w[self.skew[: self.grid.owned]] @ eq.body.skew_inverse.T * eq.length_unit)

    def pressure(self, w: Array) -> Array | None:
        """The dimensionless unknown p at owned nodes, linear between its vertices; None without one."""
        if self.pressures is None:
            return None
        corners = np.array(self.system.space.sub(1).dofmap.list)[: len(self.system.cells)]
        return self.average(w[corners] @ self.between.T)


class StateValues:
    """A state's values, on all ranks. It is made while the state is loaded into the equations.

    Stresses and stretches at a node are the mean of what the adjoining cells have there by a linear fit through their
    integration points: between those points, and at nodes above all, the strains of a coarse cell are no good, and where
    it nearly folds they are beyond all bounds. The volume ratio is linear between the vertices, where `VolumeRatio` tells it.

    Attributes:
        F: Deformation gradients at the integration points, shape (cells, points, 3, 3).
    """

    def __init__(self, sampling: Sampling, state: State):
        self.sampling, self.state = sampling, state
        self.F = sampling.gradients()

    @property
    def system(self) -> System:
        return self.sampling.system

    @functools.cached_property
    def stretches(self) -> Array:
        """Principal stretches at the integration points, rising, shape (cells, points, 3)."""
        return principal_stretches(self.F)

    @functools.cached_property
    def von_mises(self) -> Array:
        """Von Mises stress at the integration points in Pa, shape (cells, points)."""
        found = np.empty(self.stretches.shape[:2])
        for region in self.system.potential.regions:
            found[region.cells] = von_mises(shape_stresses(region.material, self.stretches[region.cells]))
        return found

    @functools.cached_property
    def J(self) -> Array:
        """Volume ratio at the corners of the cells, shape (cells, corners)."""
        return self.sampling.ratio.at_corners(np.linalg.det(self.F))

    @functools.cached_property
    def displacement(self) -> Array:
        """Displacement in m in device coordinates at owned nodes, shape (owned, 3)."""
        return self.sampling.displacement(self.state.w)

    @functools.cached_property
    def p(self) -> Array:
        """The pressure-like unknown in Pa at owned nodes, shape (owned,): J - 1 times the bulk modulus."""
        eq = self.system
        p = self.sampling.pressure(self.state.w)
        if p is None:
            change = self.J - 1.0
            for region in eq.potential.regions:
                change[region.cells] *= float(region.bulk.value)
            p = self.sampling.average(change @ self.sampling.between.T)
        return p * eq.stress_unit

    def at_nodes(self, values: Array, positive: bool = False) -> Array:
        """Values at integration points, shape (cells, points), brought to owned nodes, shape (owned,).

        Args:
            values: At the integration points.
            positive: Whether there are none below zero, so that the linear fit may have none either.
        """
        fitted = values @ self.sampling.to_nodes.T
        return self.sampling.average(np.maximum(fitted, 0.0) if positive else fitted)

    def from_corners(self, values: Array) -> Array:
        """Values at the corners of the cells, shape (cells, corners), brought to owned nodes, shape (owned,)."""
        return self.sampling.average(values @ self.sampling.between.T)


def _linear_fit(points: npt.NDArray[np.float64], places: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Matrix that takes values at points of the reference cell to the least-squares linear function's at places."""
    at_points, at_places = (np.column_stack([np.ones(len(x)), x]) for x in (points, places))
    return at_places @ np.linalg.pinv(at_points)
