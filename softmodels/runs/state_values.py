"""A state's values at integration points, vertices and nodes, from which output fields are computed."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from softmodels.common.arrays import Array
from softmodels.materials.laws import Material
from softmodels.mechanics.body import QUADRATURE_DEGREE, Body, in_space
from softmodels.mechanics.compiling import JIT
from softmodels.mechanics.mpi import largest, total
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import State, System, face_load
from softmodels.runs.grid import Grid, displacement_maps

if TYPE_CHECKING:
    from dolfinx import fem
    from mpi4py import MPI


# ----------------------------------------------------------------------------------------------------------------------
# Stresses and stretches of deformation gradients.
#
# Stresses of an isotropic law need only the principal stretches; see `Material.derivative`.


def principal_stretches(F: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return the principal stretches of deformation gradients, shape (..., 3, 3) to (..., 3), rising."""
    return np.sqrt(np.maximum(np.linalg.eigvalsh(np.swapaxes(F, -1, -2) @ F), 0.0))


def shape_stresses(material: Material, stretches: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return the principal Cauchy stresses in Pa of the law's shape part, lambda_i dW/dlambda_i / J; shapes (..., 3)."""
    sides = np.moveaxis(stretches, -1, 0)
    with np.errstate(invalid="ignore"):  # an energy beyond locking chains
        slopes = [material.derivative([*sides], [*axis]).slope for axis in np.eye(3)]
    return stretches * np.stack(slopes, axis=-1) / stretches.prod(axis=-1, keepdims=True)


def von_mises(stresses: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return the von Mises stress of principal stresses, shape (..., 3); a hydrostatic part changes nothing."""
    a, b, c = np.moveaxis(stresses, -1, 0)
    return np.sqrt(((a - b) ** 2 + (b - c) ** 2 + (c - a) ** 2) / 2)


# ----------------------------------------------------------------------------------------------------------------------
# Volume ratio J of the silicone at the vertices, each a weighted mean over the adjacent cells.
#
# The J of a single cell is not meaningful. In the mixed form of second-order displacements and a continuous linear p
# (Taylor & Hood 1973, doi 10.1016/0045-7930(73)90027-3) the volume is not kept cell by cell: what the equations say is
#
#     int q (J - 1 - p/bulk) dX = 0   for every linear shape function q,
#
# so that the means weighted by these functions are those of 1 + p/bulk, exactly, and cells scatter around them by an error of
# the mesh: at 177 cm those of the default seminar actuator by up to 0.14, where p/bulk stays below 0.06.


class VolumeRatio:
    """Weighted means over the cells around each vertex, of values at the integration points.

    Args:
        body: The mesh.
        space: Scalar second-order space whose nodes the vertices are counted among.
        regions: Owned cells of each region: p may jump between them, and with it these means.
    """

    def __init__(self, body: Body, space: fem.FunctionSpace, regions: Sequence[npt.NDArray[np.int32]]):
        import basix
        import ufl
        from dolfinx import fem, la

        points, weights = basix.make_quadrature(body.mesh.basix_cell(), QUADRATURE_DEGREE)
        cells = np.arange(body.mesh.topology.index_map(body.mesh.topology.dim).size_local, dtype=np.int32)
        density = fem.Expression(abs(ufl.JacobianDeterminant(body.mesh)) * body.hoop, points)
        volumes = weights * density.eval(body.mesh, cells).reshape(len(cells), -1)
        self._shares = volumes[:, :, None] * barycentric(points)
        # A second-order element counts its vertices first.
        self._vertices = space.dofmap.list[: len(cells), : points.shape[1] + 1]
        self._sum, self._regions = la.vector(space.dofmap.index_map, 1), regions
        self._whole = self._weighted(np.ones(volumes.shape))

    def _weighted(self, values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return the sums of weighted values, shape (cells, points), over a region's cells around each corner, shape (cells,
        corners)."""
        from dolfinx import la

        found = np.empty(self._vertices.shape)
        for cells in self._regions:
            self._sum.array[:] = 0.0
            weighted = np.einsum("cqv,cq->cv", self._shares[cells], values[cells])
            np.add.at(self._sum.array, self._vertices[cells], weighted)
            self._sum.scatter_reverse(la.InsertMode.add)
            self._sum.scatter_forward()
            found[cells] = self._sum.array[self._vertices[cells]]
        return found

    def at_corners(self, J: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return the means at the corners of each local cell, shape (cells, corners), of J at its points, shape (cells,
        points)."""
        return self._weighted(J) / self._whole


def barycentric(points: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return the linear shape functions of a simplex at points of the reference cell, shape (n, d) to (n, d + 1)."""
    return np.column_stack([1 - points.sum(axis=1), points])


class Sampling:
    """Sampling points of a mesh and the mapping to its nodes, the same for every state.

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
        """Return the deformation gradients of the state that is loaded, shape (cells, points, 3, 3)."""
        eq = self.system
        return self._gradients.eval(eq.body.mesh, eq.cells).reshape(len(eq.cells), -1, 3, 3)

    def average(self, values: Array) -> Array:
        """Return the means over the cells of each owned node, of values at the cells' nodes, shape (cells, nodes)."""
        return self._added(values) / self._share

    def _added(self, values: Array) -> Array:
        """Return the sum of cell-node values over the cells of each node, owned nodes."""
        from dolfinx import la

        self._sum.array[:] = 0.0
        np.add.at(self._sum.array, self._dofs, values)
        self._sum.scatter_reverse(la.InsertMode.add)
        return self._sum.array[: self.grid.owned].copy()

    def displacement(self, w: Array) -> Array:
        """Return the displacement of dofs in m in device coordinates at owned nodes, shape (owned, 3)."""
        eq = self.system
        return in_space(w[self.skew[: self.grid.owned]] @ eq.body.skew_inverse.T * eq.length_unit)

    def pressure(self, w: Array) -> Array | None:
        """Return the dimensionless unknown p at owned nodes, linear between its vertices; None without one."""
        if self.pressures is None:
            return None
        corners = np.array(self.system.space.sub(1).dofmap.list)[: len(self.system.cells)]
        return self.average(w[corners] @ self.between.T)


class StateValues:
    """A state's values, on all ranks; made while the state is loaded into the equations.

    Stresses and stretches at a node are the mean of what the adjoining cells have there by a linear fit through their
    integration points: between those points, and at nodes above all, the strains of a coarse cell are no good, and where
    it nearly folds they are beyond all bounds. The volume ratio is linear between the vertices, as evaluated by `VolumeRatio`.

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
        """Return the values at integration points, shape (cells, points), mapped to owned nodes, shape (owned,).

        Args:
            values: At the integration points.
            positive: Whether there are none below zero, so that the linear fit may have none either.
        """
        fitted = values @ self.sampling.to_nodes.T
        return self.sampling.average(np.maximum(fitted, 0.0) if positive else fitted)

    def from_corners(self, values: Array) -> Array:
        """Return the values at the corners of the cells, shape (cells, corners), mapped to owned nodes, shape (owned,)."""
        return self.sampling.average(values @ self.sampling.between.T)


def _linear_fit(points: npt.NDArray[np.float64], places: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return the matrix that takes values at points of the reference cell to the least-squares linear function's at places."""
    at_points, at_places = (np.column_stack([np.ones(len(x)), x]) for x in (points, places))
    return at_places @ np.linalg.pinv(at_points)


# ----------------------------------------------------------------------------------------------------------------------
# Mesh-independent peak of a field: its mean over the 0.5 % of the volume where it is largest.
#
# The largest value at a point does not converge where a mesh has a sharp corner or a clamped edge: it grows with every
# refinement, and differs at random between meshes of the same size. The mean over a volume fraction converges, because the
# singularity is integrable. It is the conditional value at risk of Rockafellar and Uryasev 2000 (doi 10.21314/JOR.2000.038),
#
#     min over q of  q + 1/(share V) int max(v - q, 0) dV,
#
# whose derivative by the field is taken at fixed q. The kink of max(x, 0) is rounded within `ROUNDED` of q, which raises the
# peak by less than that share, so that the derivative is continuous. A stretch is measured from 1, so that it is 1 at rest.


SHARE = 0.005
"""Volume fraction of the mean."""
ROUNDED = 2e-3
"""Half width of the rounding of max(x, 0), x = v/q - 1."""
BISECTIONS = 45
"""Bisections of the interval for q, down to 6e-14 of the field's largest value."""
WORDS = f"mean over the {100 * SHARE:g} % of the volume where it is largest"


def excess(x: Array) -> tuple[Array, Array]:
    """Return max(x, 0), rounded, and its slope."""
    inner = np.clip((x + ROUNDED) / (2 * ROUNDED), 0.0, 1.0)
    return np.where(x > ROUNDED, x, ROUNDED * inner**2), inner


def volume_peak(comm: MPI.Comm, values: Array, volumes: Array, rest: float = 0.0) -> tuple[float, float]:
    """Return the peak of a field, and its threshold q.

    Args:
        comm: MPI communicator; called on all ranks.
        values: The field at this rank's integration points.
        volumes: Volumes of the points, of the same shape.
        rest: The field's value at rest, above which it is measured: q is rounded relative to what is above.

    Returns:
        Peak and q, equal on all ranks; ``rest`` twice of a field that is nowhere above.
    """
    values = values - rest
    top = largest(comm, float(values.max()) if values.size else 0.0)
    whole = SHARE * total(comm, float(volumes.sum()))
    if top <= 0.0:
        return rest, rest

    def slope(q: float) -> float:
        x = values / q - 1.0
        above, rate = excess(x)
        return 1.0 + total(comm, float((volumes * (above - (x + 1.0) * rate)).sum())) / whole

    low, high = 1e-3 * top, 2.0 * top
    for _ in range(
        BISECTIONS
    ):  # the slope rises with q; importing SciPy's root finders would take longer than this loop
        q = 0.5 * (low + high)
        low, high = (low, q) if slope(q) > 0.0 else (q, high)
    above, _ = excess(values / q - 1.0)
    return rest + q * (1.0 + total(comm, float((volumes * above).sum())) / whole), rest + q
