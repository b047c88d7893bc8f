"""A state's values at integration points, vertices and nodes, from which output fields are computed; gaps between walls; and
the grid of nodes on which they are written."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from geometries import actuator
from softmodels.common.arrays import Array
from softmodels.common.lazy import MPI, basix, fem, la, plot, ufl
from softmodels.components import creases
from softmodels.materials.laws import Material
from softmodels.mechanics import compiling, mpi, system
from softmodels.mechanics.body import QUADRATURE_DEGREE, Body, in_space
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import State, System
from softmodels.runs import grid


class StateValues:
    """A state's values, on all ranks; made while the state is loaded into the equations.

    Stresses and stretches at a node are the mean of what the adjoining cells have there by a linear fit through their
    integration points: between those points, and at nodes above all, the strains of a coarse cell are no good, and where it
    nearly folds they are beyond all bounds. The volume ratio is linear between the vertices, as evaluated by `VolumeRatio`.
    Deformation gradients ``F`` are at the integration points, shape (cells, points, 3, 3).
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
        stresses = np.empty(self.stretches.shape[:2])
        potential = self.system.potential
        remembered = {history.region.name: history for history in potential.histories}
        for region in potential.regions:
            if region.name in remembered:
                stress = remembered[region.name].stress() * self.system.stress_unit
                stresses[region.cells] = von_mises(np.linalg.eigvalsh(stress))
            else:
                stresses[region.cells] = von_mises(shape_stresses(region.material, self.stretches[region.cells]))
        return stresses

    @functools.cached_property
    def cauchy(self) -> Array:
        """Cauchy stress of the silicone at the integration points in Pa, device coordinates, shape (cells, points, 3, 3).

        The stress of fibres that share its place is not in it.
        """
        potential, unit = self.system.potential, self.system.stress_unit
        squares, axes = np.linalg.eigh(self.F @ np.swapaxes(self.F, -1, -2))
        stretches, stresses = np.sqrt(np.maximum(squares, 0.0)), np.empty(self.F.shape)
        remembered = {history.region.name: history for history in potential.histories}
        for number, region in enumerate(potential.regions):
            if region.name in remembered:
                stresses[region.cells] = remembered[region.name].stress() * unit
            else:
                values = shape_stresses(region.material, stretches[region.cells])
                stresses[region.cells] = (axes[region.cells] * values[..., None, :]) @ np.swapaxes(axes[region.cells], -1, -2)
            if potential.mixed:
                p = self.state.w[potential.pressure_dofs[region.cells, :, number]] @ barycentric(self.system.points).T
            else:
                p = float(region.bulk.value) * (np.linalg.det(self.F[region.cells]) - 1.0)
            stresses[region.cells] += (p * unit)[..., None, None] * np.eye(3)
        return stresses

    @functools.cached_property
    def cauchy_at_nodes(self) -> Array:
        """Cauchy stress at owned nodes, shape (owned, 3, 3)."""
        return self.tensors_at_nodes(self.cauchy)

    @functools.cached_property
    def gradient_at_nodes(self) -> Array:
        """Deformation gradient at owned nodes, shape (owned, 3, 3)."""
        return self.tensors_at_nodes(self.F)

    @functools.cached_property
    def principal_stresses(self) -> tuple[Array, Array]:
        """Principal Cauchy stresses at owned nodes, the largest first, shape (owned, 3), and in rows their unit directions,
        shape (owned, 3, 3)."""
        return principal(self.cauchy_at_nodes)

    @functools.cached_property
    def principal_stretches(self) -> tuple[Array, Array]:
        """The same of the stretches, whose directions are those of the undeformed lines that are stretched so."""
        squares, axes = principal(np.swapaxes(self.gradient_at_nodes, -1, -2) @ self.gradient_at_nodes)
        return np.sqrt(np.maximum(squares, 0.0)), axes

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
        """Return the values at integration points, shape (cells, points), mapped to owned nodes, shape (owned,); of
        ``positive`` ones the linear fit has none below zero either."""
        fitted = values @ self.sampling.to_nodes.T
        return self.sampling.average(np.maximum(fitted, 0.0) if positive else fitted)

    def tensors_at_nodes(self, values: Array) -> Array:
        """Return the tensors at integration points, shape (cells, points, 3, 3), mapped to owned nodes, shape (owned, 3, 3)."""
        flat = np.moveaxis(values.reshape(*values.shape[:2], 9), -1, 0)
        return np.stack([self.at_nodes(component) for component in flat], axis=-1).reshape(-1, 3, 3)

    def from_corners(self, values: Array) -> Array:
        """Return the values at the corners of the cells, shape (cells, corners), mapped to owned nodes, shape (owned,)."""
        return self.sampling.average(values @ self.sampling.between.T)


def _linear_fit(points: npt.NDArray[np.float64], places: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return the matrix that takes values at points of the reference cell to the least-squares linear function's at places."""
    at_points, at_places = (np.column_stack([np.ones(len(x)), x]) for x in (points, places))
    return at_places @ np.linalg.pinv(at_points)


# ----------------------------------------------------------------------------------------------------------------------
# Stresses and stretches of deformation gradients.
#
# Stresses of an isotropic law need only the principal stretches; see `Material.derivative`.


def principal_stretches(F: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return the principal stretches of deformation gradients, shape (..., 3, 3) to (..., 3), rising."""
    return np.sqrt(np.maximum(np.linalg.eigvalsh(np.swapaxes(F, -1, -2) @ F), 0.0))


def principal(tensors: npt.NDArray[np.float64]) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return the principal values of symmetric tensors, shape (n, 3, 3) to (n, 3), the largest first, and in rows their unit
    directions, shape (n, 3, 3)."""
    values, axes = np.linalg.eigh(tensors)
    return values[:, ::-1], np.swapaxes(axes, -1, -2)[:, ::-1]


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
    """Weighted means over the cells around each vertex, of values at the integration points. Vertices are counted among the
    nodes of a scalar second-order space; the owned cells are by regions, since p may jump between them, and with it these
    means."""

    def __init__(self, body: Body, space: fem.FunctionSpace, regions: Sequence[npt.NDArray[np.int32]]):
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
        sums = np.empty(self._vertices.shape)
        for cells in self._regions:
            self._sum.array[:] = 0.0
            weighted = np.einsum("cqv,cq->cv", self._shares[cells], values[cells])
            np.add.at(self._sum.array, self._vertices[cells], weighted)
            self._sum.scatter_reverse(la.InsertMode.add)
            self._sum.scatter_forward()
            sums[cells] = self._sum.array[self._vertices[cells]]
        return sums

    def at_corners(self, J: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return the means at the corners of each local cell, shape (cells, corners), of J at its points, shape (cells,
        points)."""
        return self._weighted(J) / self._whole


def barycentric(points: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return the linear shape functions of a simplex at points of the reference cell, shape (n, d) to (n, d + 1)."""
    return np.column_stack([1 - points.sum(axis=1), points])


EDGES = {1: ((0, 1),), 2: ((0, 1), (1, 2), (0, 2)), 3: ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))}
"""Corners of the edges of a simplex, in VTK's order of the nodes on them, by its dimension."""


def quadratic(shares: Array, edges: Sequence[tuple[int, int]] | None = None) -> tuple[Array, Array]:
    """Return the second-order shape functions of a simplex at barycentric coordinates, shape (m, c): of its corners, then of
    the nodes on its edges, those of `EDGES` unless others are given, shape (m, n); and their slopes by each coordinate as if
    it were independent, shape (m, n, c)."""
    corners = shares.shape[1]
    first, other = np.array(EDGES[corners - 1] if edges is None else edges).T
    values = np.concatenate([shares * (2 * shares - 1), 4 * shares[:, first] * shares[:, other]], axis=1)
    slopes, on_edges = np.zeros((*values.shape, corners)), corners + np.arange(len(first))
    slopes[:, range(corners), range(corners)] = 4 * shares - 1
    slopes[:, on_edges, first], slopes[:, on_edges, other] = 4 * shares[:, other], 4 * shares[:, first]
    return values, slopes


class Sampling:
    """Sampling points of a mesh and the mapping to the nodes that results are written on, the same for every state; see
    `displacement_maps`."""

    def __init__(self, solver: Solver, grid: Grid):
        self.solver, self.system, self.grid = solver, solver.system, grid
        system = self.system
        self.skew, self.pressures = displacement_maps(system, grid)
        space = grid.space
        F = system.body.deformation_gradient(system.potential.displacement, at_axis=True)
        self.to_nodes = _linear_fit(system.points, space.element.interpolation_points)
        self.between = barycentric(space.element.interpolation_points)
        self._gradients = fem.Expression(F, system.points, jit_options=compiling.JIT)
        self._dofs = space.dofmap.list[: len(system.cells)]
        self._sum = la.vector(space.dofmap.index_map, 1)
        self._share = self._added(np.ones(self._dofs.shape))
        self.ratio = VolumeRatio(system.body, space, [region.cells for region in system.potential.regions])

    @functools.cached_property
    def push(self) -> Array:
        """A unit load along the lift, spread over the device's `Actuator.pushed` face, as dofs."""
        actuator = self.system.body.actuator
        assert actuator.pushed is not None
        return system.face_load(self.system, actuator.pushed, actuator.lift)

    def gradients(self) -> Array:
        """Return the deformation gradients of the state that is loaded, shape (cells, points, 3, 3)."""
        eq = self.system
        return self._gradients.eval(eq.body.mesh, eq.cells).reshape(len(eq.cells), -1, 3, 3)

    def average(self, values: Array) -> Array:
        """Return the means over the cells of each owned node, of values at the cells' nodes, shape (cells, nodes)."""
        return self._added(values) / self._share

    def _added(self, values: Array) -> Array:
        """Return the sum of cell-node values over the cells of each node, owned nodes."""
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
        return self.average(w[self._pressure_corners] @ self.between.T)

    @functools.cached_property
    def _pressure_corners(self) -> npt.NDArray[np.int32]:
        """Dofs of p at the corners of this rank's own cells, shape (cells, corners)."""
        return np.array(self.system.space.sub(1).dofmap.list)[: len(self.system.cells)]


# ----------------------------------------------------------------------------------------------------------------------
# Mesh-independent peak of a field: its mean over the 0.5 % of the volume where it is largest.
#
# The largest value at a point does not converge where a mesh has a sharp corner or a clamped edge: it grows with every
# refinement, and differs at random between meshes of the same size. The mean over a volume fraction converges, because the
# singularity is integrable. It is the conditional value at risk of Rockafellar and Uryasev 2000 (doi 10.21314/JOR.2000.038),
#
#     min over q of  q + 1/(share V) int max(v - q, 0) dV,
#
# whose derivative by the field is taken at fixed q. The kink of max(x, 0) is rounded within `ROUNDING_HALF_WIDTH` of q, which
# raises the peak by less than that share, so that the derivative is continuous. A stretch is measured from 1, so that it is 1
# at rest.


PEAK_VOLUME_SHARE = 0.005
"""Volume fraction of the mean."""
ROUNDING_HALF_WIDTH = 2e-3
"""Half width of the rounding of max(x, 0), x = v/q - 1."""
MAX_BISECTIONS = 45
"""Bisections of the interval for q, down to 6e-14 of the field's largest value."""
WORDS = f"mean over the {100 * PEAK_VOLUME_SHARE:g} % of the volume where it is largest"


def excess(x: Array) -> tuple[Array, Array]:
    """Return max(x, 0), rounded, and its slope."""
    inner = np.clip((x + ROUNDING_HALF_WIDTH) / (2 * ROUNDING_HALF_WIDTH), 0.0, 1.0)
    return np.where(x > ROUNDING_HALF_WIDTH, x, ROUNDING_HALF_WIDTH * inner**2), inner


def volume_peak(comm: MPI.Comm, values: Array, volumes: Array, rest: float = 0.0) -> tuple[float, float]:
    """Return the peak of a field and its threshold q, equal on all ranks; ``rest`` twice of a field that is nowhere above.

    Values at this rank's integration points and the volumes of these have the same shape; they are measured above the value at
    rest: q is rounded relative to what is above.
    """
    values = values - rest
    top = mpi.largest(comm, float(values.max()) if values.size else 0.0)
    whole = PEAK_VOLUME_SHARE * mpi.total(comm, float(volumes.sum()))
    if top <= 0.0:
        return rest, rest

    def slope(q: float) -> float:
        x = values / q - 1.0
        above, rate = excess(x)
        return 1.0 + mpi.total(comm, float((volumes * (above - (x + 1.0) * rate)).sum())) / whole

    low, high = 1e-3 * top, 2.0 * top
    for _ in range(MAX_BISECTIONS):  # the slope rises with q; importing SciPy's root finders would take longer than this loop
        q = 0.5 * (low + high)
        low, high = (low, q) if slope(q) > 0.0 else (q, high)
        counts = values > low * (1.0 - ROUNDING_HALF_WIDTH)  # nothing else exceeds any q to come
        values, volumes = values[counts], volumes[counts]
    above, _ = excess(values / q - 1.0)
    return rest + q * (1.0 + mpi.total(comm, float((volumes * above).sum())) / whole), rest + q


# ----------------------------------------------------------------------------------------------------------------------
# The gap between facing walls of a deformed device; negative where they overlap.
#
# A place x on the surface with outward normal n faces a facet if air lies between the two at rest and the facet's normal m is
# opposed to n once deformed. Its gap is the signed distance to the closest point y of the deformed facet, which is a quadratic
# patch, as the solution is:
#
#     gap = (x - y) . m        d gap = m . (du(x) - du(y)),
#
# the latter because m is square to the facet at y and x - y is along m. So the gap depends only on the deformed surface,
# not on the mesh. It is taken at a lattice of places on each facet; the least of them is the gap of the device. It is
# differentiable by the displacement, and alike by the shape at rest (it depends on their sum), while the closest place stays
# the same. A wall that meets its mirror image in a cut plane has a gap of twice its distance from the plane.


MAX_OPPOSED_PRODUCT = -0.3
"""Largest product of the normals of a place and a facet that face each other."""
MIN_AIR_SINE = 1e-6
"""Sine of the angle under which a chord has to leave into air at both ends."""
PIECES_PER_EDGE = 4
"""Parts of a facet's edge between the places that the gap is taken at."""
FACET_TOLERANCE = 1e-3
"""Tolerance in a facet's own coordinates within which a closest point counts as on it."""
CURVATURE_REACH = 0.3
"""Search range of a closest point beside the plane triangle of a facet's corners, and off it in edge lengths."""
GAP_REACH, OVERLAP_REACH = 0.02, 0.3
"""Search distances in mesh sizes, for gaps and, once walls overlap, for overlaps."""
MAX_PROJECTIONS = 5
"""Iterations for a closest point; each gains digits if the distance is small against the radius of curvature."""
MAX_OVERLAP_SHARE = 0.01
"""Overlap, relative to the wall thickness, above which walls count as overlapping."""
PLACES_AT_ONCE = 200_000
FIRST_PAIRS, PAIRS_GROWTH = 500, 4
"""Number of pairs of facets, those least apart, whose gaps bound the least gap first, and its growth from one bound to the
next."""
BENT_FACET_COSINE = 0.85
"""Cosine of the angle between normals of a facet above which all of it faces what its middle faces."""
HULL_TOLERANCE = 0.01
"""Part of a facet's radius by which a closest point may lie outside the facet."""


@dataclasses.dataclass(frozen=True, eq=False)
class Gap:
    """The least gap of a state.

    Attributes:
        value, place: In m, below zero where walls overlap; where, deformed, in m, shape (3,).
        nodes: Nodes of the mesh whose displacement it depends on, shape (k,); one may be there twice.
        rates: Derivative of the value by the displacement of each, or by its place at rest, shape (k, 3).
        share: Largest overlap of the state over the thickness of the wall there at rest; 0 where none overlaps. It may be
            of another place than the least gap, where walls differ in thickness.
    """

    value: float
    place: Array
    nodes: npt.NDArray[np.int64]
    rates: Array
    share: float

    @property
    def overlaps(self) -> bool:
        """Whether walls overlap by more than `MAX_OVERLAP_SHARE` of their thickness."""
        return self.share > MAX_OVERLAP_SHARE


@dataclasses.dataclass(frozen=True, eq=False)
class Gaps:
    """Gaps of the points near another wall, each to the closest facing facet.

    Attributes:
        values, places: In m, shape (p,), and deformed, in m, shape (p, 3).
        thickness: In m at rest, the smaller one of the two walls', shape (p,).
        facets, points: Facet of each place, and which one of its places it is, shape (p,).
        others: The facet that it faces, or -1 less the number of the cut plane, shape (p,).
        weights: Of the other facet's nodes at the closest point, zero of a plane, shape (p, k).
        normals: Out of the other wall at the closest point, shape (p, 3).
    """

    values: Array
    places: Array
    thickness: Array
    facets: npt.NDArray[np.int64]
    points: npt.NDArray[np.int64]
    others: npt.NDArray[np.int64]
    weights: Array
    normals: Array

    @property
    def share(self) -> float:
        """Largest overlap over the thickness of the wall there; 0 where none overlaps."""
        return float(np.maximum(-self.values / self.thickness, 0.0).max(initial=0.0))


class FacingWalls:
    """The surface of a mesh without its cut planes, which pass through the origin, with unit normals out of the slice, shape
    (3,) each. Nodes are in m, shape (n, 3), of a section radius and height in the first and last column; cells are
    second-order ``"Triangle_6"`` or ``"Tetrahedron_10"``, shape (c, 6) or (c, 10).

    Attributes:
        facets: Nodes of each facet, corners first, shape (f, 3 or 6).
        reach: Distance in m up to which walls are near each other: a fiftieth of the mesh's size, or half a facet.
        thickness: From the middle of each facet straight through the solid to its other side, in m at rest, shape (f,).
    """

    def __init__(self, points: Array, cells: grid.Cells, cell_name: str, planes: Sequence[npt.ArrayLike] = ()):
        self.points, self.flat = points, cell_name == "Triangle_6"
        parts = grid.EDGES if self.flat else np.array(grid.FACES[cell_name])
        corners, count = parts.shape[1] // 2 + self.flat, len(cells)
        every = cells[:, parts].reshape(-1, parts.shape[1])
        owner = np.repeat(np.arange(count), len(parts))
        _, first, number, shared = np.unique(
            np.sort(every[:, :corners], axis=1), axis=0, return_index=True, return_inverse=True, return_counts=True
        )
        size = self.size = float(np.ptp(points, axis=0).max())
        self.planes = [np.asarray(normal, dtype=float) for normal in planes]
        if self.flat:
            self.planes = [*self.planes, np.array([-1.0, 0.0, 0.0])]  # a section meets its other half at the axis
        on_plane = [np.abs(points @ plane) < 1e-7 * size for plane in self.planes]
        cut = np.any([on[every].all(axis=1) for on in on_plane], axis=0) if on_plane else np.zeros(len(every), bool)
        surface = np.zeros(len(every), bool)
        surface[first[shared == 1]] = True
        chosen = np.flatnonzero(surface & ~cut)
        self.facets = every[chosen]
        self._at_plane = [on[self.facets].any(axis=1) for on in on_plane]
        inside = points[cells[owner[chosen], : 3 if self.flat else 4]].mean(axis=1)
        self._lattice, self._middle = _lattice(self.flat)
        self._weights = quadratic(barycentric(self._lattice))[0]
        self._turn = np.ones(len(self.facets))
        middle, normal = self._middles(points)
        self._turn = np.where(np.einsum("fi,fi->f", middle - inside, normal) > 0.0, 1.0, -1.0)
        self._rest = self._middles(points)
        # The closed surface of each facet, around the device or in a cavity: a place that has gone through a wall into a cavity
        # still faces that wall's outside, and not the cavity's other side, which may be nearer.
        self._air = actuator.joined_by(self.facets)
        corner = points[self.facets[:, :2]]
        edge = float(np.median(np.linalg.norm(corner[:, 1] - corner[:, 0], axis=1))) if len(corner) else 0.0
        self.reach = max(GAP_REACH * size, 0.5 * edge)
        beyond = _neighbours(number.ravel(), len(parts), surface)
        self.thickness = _through(points, cells, parts[:, :corners], beyond, owner[chosen], self._rest)

    def _middles(self, at: Array) -> tuple[Array, Array]:
        """Return the middles and outward unit normals of the facets of a shape, (f, 3) each."""
        nodes = at[self.facets]
        place, tangents = _patch(nodes, np.tile(self._middle, (len(nodes), 1)))
        return place, self._normal(tangents, np.arange(len(nodes)))

    def into(self, point: Array) -> tuple[Array, Array, float]:
        """Return the place of the undeformed surface that is nearest to a point, the unit normal into the solid there, and the
        thickness in m of the solid behind the facet's middle."""
        nodes = self.points[self.facets]
        every = np.einsum("sk,fki->fsi", self._weights, nodes)
        distance = np.linalg.norm(every - point, axis=2)
        facet, at = np.unravel_index(int(np.argmin(distance)), distance.shape)
        number, own = np.array([facet]), self._lattice[[at]]
        for _ in range(MAX_PROJECTIONS):
            place, tangents = _patch(nodes[number], own)
            own = own + np.linalg.pinv(tangents[0].T) @ (point - place[0])
            own = np.maximum(own, 0.0)
            own = own / max(1.0, float(own.sum()))
        place, tangents = _patch(nodes[number], own)
        return place[0], -self._normal(tangents, number)[0], float(self.thickness[facet])

    def _normal(self, tangents: Array, facets: npt.NDArray[np.int64]) -> Array:
        across = (
            np.stack([tangents[:, 0, 2], np.zeros(len(tangents)), -tangents[:, 0, 0]], axis=1)
            if self.flat
            else np.cross(tangents[:, 0], tangents[:, 1])
        )
        length = np.maximum(np.linalg.norm(across, axis=1), 1e-300)
        return np.asarray(across / length[:, None] * self._turn[facets, None])

    def least(self, displacement: Array, reach: float | None = None) -> Gap | None:
        """Return the smallest gap, in m, for displacements of the nodes in m, shape (n, 3); None if no walls are near each
        other. See `gaps`."""
        gaps = self.gaps(displacement, reach, all_places=False)
        if not len(gaps.values):
            return None
        at = int(np.argmin(gaps.values))
        facet, other, normal = gaps.facets[at], gaps.others[at], gaps.normals[at]
        own = self._weights[gaps.points[at]]
        if other < 0:
            nodes, rates = self.facets[facet], 2.0 * own[:, None] * normal
        else:
            nodes = np.concatenate([self.facets[facet], self.facets[other]])
            rates = np.concatenate([own, -gaps.weights[at]])[:, None] * normal
        return Gap(float(gaps.values[at]), gaps.places[at], nodes, rates, gaps.share)

    def gaps(self, displacement: Array, reach: float | None = None, all_places: bool = True) -> Gaps:
        """Return the gaps of the places near other walls, up to ``reach`` in m (None for `reach`), for displacements of the
        nodes in m, shape (n, 3); where some overlap, all that overlap. With ``all_places`` false only the least gap and all
        overlaps are certain to be among them."""
        at, before = self.points + displacement, np.inf
        reach = self.reach if reach is None else reach
        while True:
            seen = self._within(at, reach, None if all_places else reach)
            least = float(np.min(seen.values, initial=np.inf))
            # A deep overlap is as far from the wall it has passed through.
            if least >= 0.0 or least >= before or reach >= OVERLAP_REACH * self.size:
                return seen
            before, reach = least, 2.0 * reach

    def cross(self, displacement: Array) -> bool:
        """Return whether walls pass through each other anywhere; quicker than `least`, which looks for the deepest place."""
        return bool((self._within(self.points + displacement, self.reach, 0.0).values < 0.0).any())

    def folded(self, displacement: Array) -> bool:
        """Return whether a facet is folded onto itself, in a crease that the cells do not resolve: it turns by more than
        `CLOSED_FOLD_ANGLE`, and its middle is compressed until it creases (`softmodels.components.creases.find_crease`)."""
        at = self.points + displacement
        now = self._tangents(at, self._middle)
        squares = np.linalg.eigvals(self._compliances @ np.einsum("fai,fbi->fab", now, now)).real
        if self.flat:
            hoop = self._middles(at)[0][:, :1] / self._rest[0][:, :1]
            squares = np.concatenate([squares, hoop**2], axis=1)
        creased = np.flatnonzero(squares.min(axis=1) * np.sqrt(squares.max(axis=1)) < creases.CREASE_LIMIT)
        if not len(creased):
            return False
        near = self._middle + creases.CORNER_SHARE * (self._lattice - self._middle)
        n = np.stack([self._normal(self._tangents(at, own, creased), creased) for own in near], axis=1)
        return bool((np.einsum("fpi,fqi->fpq", n, n) < math.cos(creases.CLOSED_FOLD_ANGLE)).any())

    @functools.cached_property
    def _compliances(self) -> Array:
        """Inverse metric of each undeformed facet at its middle, shape (f, d, d)."""
        rest = self._tangents(self.points, self._middle)
        return np.linalg.inv(np.einsum("fai,fbi->fab", rest, rest))

    def _tangents(self, at: Array, own: Array, facets: npt.NDArray[np.int64] | None = None) -> Array:
        """Return the tangents of a shape's facets, of all or some, at one place of each in its own coordinates, (f, d, 3)."""
        nodes = at[self.facets if facets is None else self.facets[facets]]
        return _patch(nodes, np.tile(own, (len(nodes), 1)))[1]

    def shapes(self, points: npt.NDArray[np.int64]) -> Array:
        """Return the shape functions of a facet's nodes at some of the places that gaps are taken at, shape (p, 3 or 6)."""
        return self._weights[points]

    def _within(self, at: Array, reach: float, bound: float | None) -> Gaps:
        """Return the gaps up to a distance; with a ``bound`` only the least one, if it is not above that, and all overlaps."""
        hits = [self._of_plane(at, number, reach) for number in range(len(self.planes))]
        if bound is not None:
            bound = max(min([bound, *(float(hit[0].min(initial=np.inf)) for hit in hits)]), 0.0)
        hits += self._of_facets(at, reach, bound)
        values, facets, points, others, weights, normals = (np.concatenate(side) for side in zip(*hits, strict=True))
        far = np.where((others < 0) & (values < 0.0), 0.0, np.abs(values))  # a cut plane has only one side
        order = np.lexsort((far, points, facets))
        place = facets[order] * len(self._lattice) + points[order]
        order = order[np.flatnonzero(np.diff(place, prepend=-1))]  # of each place the closest one
        facets, points, others = facets[order], points[order], others[order]
        thickness = np.where(others < 0, self.thickness[facets], np.minimum(self.thickness[facets], self.thickness[others]))
        shapes = self._weights[points]
        places = np.einsum("pk,pki->pi", shapes, at[self.facets[facets]])
        return Gaps(values[order], places, thickness, facets, points, others, weights[order], normals[order])

    def _of_plane(self, at: Array, number: int, reach: float) -> tuple[Array, ...]:
        """Return the places that face a cut plane."""
        plane, k = self.planes[number], self.facets.shape[1]
        nodes = np.flatnonzero(~self._at_plane[number])
        corners = at[self.facets[nodes]]
        nodes = nodes[(corners @ plane).max(axis=1, initial=-np.inf) > -reach]
        facet, point = (grid.ravel() for grid in np.meshgrid(nodes, np.arange(len(self._lattice)), indexing="ij"))
        place, tangents = _patch(at[self.facets[facet]], self._lattice[point])
        beyond = place @ plane
        # In front of the plane a point has to face it; behind it every point counts.
        faces = ((self._normal(tangents, facet) @ plane > -MAX_OPPOSED_PRODUCT) & (beyond > -reach / 2)) | (beyond > 0.0)
        facet, point, beyond = facet[faces], point[faces], beyond[faces]
        normals = np.tile(-plane, (len(facet), 1))
        return -2.0 * beyond, facet, point, np.full(len(facet), -1 - number), np.zeros((len(facet), k)), normals

    def _of_facets(self, at: Array, reach: float, bound: float | None) -> list[tuple[np.ndarray, ...]]:
        """Return the places that face a facet; see `_within`."""
        middle, normal = self._middles(at)
        corners = at[self.facets]
        radius = np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1)
        i, j = _near(middle, radius + reach / 2)
        near = self._air[i] == self._air[j]
        i, j = i[near], j[near]
        opposed = np.einsum("pi,pi->p", normal[i], normal[j]) < -MAX_OPPOSED_PRODUCT
        i, j = i[opposed], j[opposed]
        X, N = self._rest
        chord = X[j] - X[i]
        least = MIN_AIR_SINE * np.linalg.norm(chord, axis=1)
        air = (np.einsum("pi,pi->p", chord, N[i]) > least) & (np.einsum("pi,pi->p", chord, N[j]) < -least)
        i, j = i[air], j[air]
        # A closest point lies on the facet, straight in front of the place.
        between = normal[i] - normal[j]
        between /= np.linalg.norm(between, axis=1)[:, None]
        way = middle[j] - middle[i]
        far = np.einsum("pi,pi->p", way, between)
        aside = np.linalg.norm(way - far[:, None] * between, axis=1)
        wide = radius[i] + radius[j]
        straight = (aside < (1 + CURVATURE_REACH) * wide + CURVATURE_REACH * np.abs(far)) & (
            np.abs(far) < reach + CURVATURE_REACH * wide
        )
        i, j, between = i[straight], j[straight], between[straight]
        corner = self.facets[:, : 2 if self.flat else 3].T
        apart = np.all([a[i] != b[j] for a in corner for b in corner], axis=0)
        i, j, between = i[apart], j[apart], between[apart]
        i, j, room = np.concatenate([i, j]), np.concatenate([j, i]), np.tile(self._room(at, i, j, between, radius), 2)
        places = np.einsum("sk,fki->fsi", self._weights, corners)

        def hits(chosen: npt.NDArray[np.int64]) -> list[tuple[np.ndarray, ...]]:
            faced, number = np.unique(j[chosen], return_inverse=True)
            planes, step = self._planes_of(corners[faced]), PLACES_AT_ONCE // len(self._lattice)
            return [
                self._projected(corners, places, i[part], j[part], [each[of] for each in planes], reach)
                for part, of in ((chosen[a : a + step], number[a : a + step]) for a in range(0, max(len(chosen), 1), step))
            ]

        if bound is None:
            return hits(np.arange(len(i)))
        # Facets farther apart than the least gap so far are in front of each other; those least apart come first.
        left, seen, count = np.argsort(room, kind="stable"), hits(np.arange(0)), FIRST_PAIRS
        while count := min(count, int(np.searchsorted(room[left], bound, side="right"))):
            new = hits(left[:count])
            bound = max(min([bound, *(float(hit[0].min(initial=np.inf)) for hit in new)]), 0.0)
            seen, left, count = [*seen, *new], left[count:], PAIRS_GROWTH * count
        # Of a place that overlaps the closest facet counts.
        overlaps = np.unique(np.concatenate([hit[1][hit[0] < 0.0] for hit in seen]))
        return [*seen, *hits(left[np.isin(i[left], overlaps)])] if len(overlaps) else seen

    def _room(self, at: Array, i: npt.NDArray[np.int64], j: npt.NDArray[np.int64], between: Array, radius: Array) -> Array:
        """Return a lower bound of the distance of pairs of facets along unit vectors from the first to the second, (p, 3):
        a quadratic patch is in the convex hull of its Bernstein points. It is minus infinity for facets that bend so much that
        a place in front of the whole may be behind a part."""
        hull, sides = at[self.facets], np.array([[0, 1]] if self.flat else [[0, 1], [1, 2], [2, 0]])
        hull[:, -len(sides) :] = 2 * hull[:, -len(sides) :] - hull[:, sides].mean(axis=2)
        every = np.arange(len(hull))
        normal = self._normal(self._tangents(at, self._middle), every)
        bent = np.zeros(len(hull), dtype=bool)
        for corner in np.vstack([np.zeros(len(self._middle)), np.eye(len(self._middle))]):
            bent |= np.einsum("fi,fi->f", self._normal(self._tangents(at, corner), every), normal) < BENT_FACET_COSINE
        low = functools.reduce(np.minimum, (np.einsum("pi,pi->p", point[j], between) for point in np.swapaxes(hull, 0, 1)))
        high = functools.reduce(np.maximum, (np.einsum("pi,pi->p", point[i], between) for point in np.swapaxes(hull, 0, 1)))
        far = low - high - HULL_TOLERANCE * (radius[i] + radius[j])
        far[bent[i] | bent[j]] = -np.inf
        return np.asarray(far)

    def _planes_of(self, nodes: Array) -> list[Array]:
        """Return of facets with nodes (p, k, 3) the tangents of the plane through their corners as columns, their
        pseudoinverses, and how far off the plane a closest point may be."""
        d = 1 if self.flat else 2
        sides = np.swapaxes(nodes[:, 1 : d + 1] - nodes[:, :1], 1, 2)
        edges = np.linalg.norm(np.diff(nodes[:, [0, *range(1, d + 1), 0]], axis=1), axis=2)
        return [sides, np.linalg.pinv(sides), edges.max(axis=1, initial=0.0) * CURVATURE_REACH]

    def _projected(
        self,
        nodes: Array,
        places: Array,
        i: npt.NDArray[np.int64],
        j: npt.NDArray[np.int64],
        planes: Sequence[Array],
        reach: float,
    ) -> tuple[np.ndarray, ...]:
        """Return the places of facets ``i`` on facets ``j``, shape (p,), those that have a closest point there, no farther
        than ``reach``; ``nodes`` are places of each facet's nodes, shape (f, k, 3), ``places`` its lattice, shape (f, s, 3),
        and ``planes`` those of ``j``, see `_planes_of`."""
        sides, flat, bent = planes
        d = sides.shape[2]
        way = places[i] - nodes[j, :1]
        start = way @ np.swapaxes(flat, 1, 2)
        rest = way - start @ np.swapaxes(sides, 1, 2)
        near = np.minimum(start.min(axis=2), 1.0 - start.sum(axis=2)) > -CURVATURE_REACH
        near &= (rest * rest).sum(axis=2) < (reach + bent[:, None]) ** 2
        pair, point = np.nonzero(near)
        start, x, i, j = start[pair, point], places[i[pair], point], i[pair], j[pair]
        for _ in range(MAX_PROJECTIONS):
            y, tangents = _patch(nodes[j], start)
            gram = np.einsum("pai,pbi->pab", tangents, tangents)
            gram += 1e-14 * np.einsum("paa->p", gram)[:, None, None] * np.eye(d)
            step = np.linalg.solve(gram, np.einsum("pai,pi->pa", tangents, x - y)[:, :, None])[:, :, 0]
            start = start + np.clip(step, -0.5, 0.5)
        y, tangents = _patch(nodes[j], start)
        m = self._normal(tangents, j)
        _, own = _patch(nodes[i], self._lattice[point])
        gap = np.einsum("pi,pi->p", x - y, m)
        kept = np.minimum(start.min(axis=1), 1.0 - start.sum(axis=1)) > -FACET_TOLERANCE
        kept &= (np.abs(gap) < reach) & (np.einsum("pi,pi->p", self._normal(own, i), m) < MAX_OPPOSED_PRODUCT)
        return gap[kept], i[kept], point[kept], j[kept], quadratic(barycentric(start[kept]))[0], m[kept]


def _lattice(flat: bool) -> tuple[Array, Array]:
    """Return the places on a facet in its own coordinates, shape (s, d), and its middle."""
    if flat:
        return np.linspace(0.0, 1.0, 2 * PIECES_PER_EDGE + 1)[:, None], np.array([0.5])
    places = [
        (a / PIECES_PER_EDGE, b / PIECES_PER_EDGE) for a in range(PIECES_PER_EDGE + 1) for b in range(PIECES_PER_EDGE + 1 - a)
    ]
    return np.array(places), np.array([1 / 3, 1 / 3])


def _patch(nodes: Array, at: Array) -> tuple[Array, Array]:
    """Return places and tangents of facets with nodes (p, k, 3) at one place of each (p, d): shapes (p, 3) and (p, d,
    3)."""
    values, slopes = quadratic(barycentric(at))
    by_place = slopes[..., 1:] - slopes[..., :1]
    return np.einsum("pk,pki->pi", values, nodes), np.einsum("pkd,pki->pdi", by_place, nodes)


def _neighbours(number: npt.NDArray[np.intp], parts: int, surface: npt.NDArray[np.bool_]) -> npt.NDArray[np.int64]:
    """Return the cell behind each face of each cell, shape (c, parts); -1 where there is none."""
    order = np.argsort(number, kind="stable")
    twice = np.flatnonzero(number[order][1:] == number[order][:-1])
    beyond = np.full(len(number), -1)
    a, b = order[twice], order[twice + 1]
    beyond[a], beyond[b] = b // parts, a // parts
    return beyond.reshape(-1, parts)


def _through(
    points: Array,
    cells: grid.Cells,
    parts: npt.NDArray[np.int64],
    beyond: npt.NDArray[np.int64],
    owner: npt.NDArray[np.int64],
    facets: tuple[Array, Array],
) -> Array:
    """Return the length in m of the way from the middle of each facet straight into the solid to where it leaves it, shape
    (f,)."""
    start, normal = facets
    faces = points[cells[:, parts]]  # (c, parts, corners, 3)
    along = faces[:, :, 1] - faces[:, :, 0]
    if parts.shape[1] == 2:
        across = np.stack([along[..., 2], np.zeros(along.shape[:2]), -along[..., 0]], axis=-1)
    else:
        across = np.cross(along, faces[:, :, 2] - faces[:, :, 0])
    middle = points[cells[:, : len(parts)]].mean(axis=1)
    out = np.einsum("cfi,cfi->cf", faces[:, :, 0] - middle[:, None], across)
    across *= np.where(out > 0.0, 1.0, -1.0)[..., None]
    distances, cell, active = np.zeros(len(start)), owner.copy(), np.arange(len(start))
    for _ in range(len(cells)):
        c, o, way = cell[active], start[active], -normal[active]
        rate = np.einsum("pfi,pi->pf", across[c], way)
        to = np.einsum("pfi,pfi->pf", faces[c][:, :, 0] - o[:, None], across[c])
        with np.errstate(divide="ignore", invalid="ignore"):
            t = np.where(rate > 1e-12 * np.linalg.norm(across[c], axis=2), to / rate, np.inf)
        last = np.argmin(t, axis=1)
        distances[active] = np.maximum(distances[active], t[np.arange(len(c)), last])
        cell[active] = beyond[c, last]
        active = active[cell[active] >= 0]
        if not len(active):
            break
    return distances


def _near(places: Array, radii: Array) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Return the pairs of balls around places, shape (n, 3), that overlap, each pair once: those of a class of radii with each
    other and with all smaller ones, by boxes as wide as its largest ball. SciPy's tree takes longer to load than a wedge's path
    needs for a state."""
    order = np.argsort(-radii, kind="stable")
    pairs, done = [(order[:0], order[:0])], 0
    while done < len(order):
        left = order[done:]
        count = int(np.searchsorted(-radii[left], -radii[left[0]] / 2, side="right"))
        i, j = _overlapping(places[left], radii[left], count)
        pairs.append((left[i], left[j]))
        done += count
    i, j = (np.concatenate(side) for side in zip(*pairs, strict=True))
    return i, j


def _overlapping(places: Array, radii: Array, count: int) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Return the pairs of overlapping balls, the largest first, of which the first is among the first ``count``."""
    box = np.floor((places - places.min(axis=0)) / (2 * radii[0])).astype(np.int64) + 1
    strides = np.append(np.cumprod((box.max(axis=0) + 2)[:0:-1])[::-1], 1)
    key = box @ strides
    order = np.argsort(key, kind="stable")
    ordered, sizes, coordinates = key[order], radii[order], np.ascontiguousarray(places[order].T)
    first, pairs = np.flatnonzero(order < count), []
    for step in np.stack(np.meshgrid(*[(-1, 0, 1)] * 2, indexing="ij"), axis=-1).reshape(-1, 2) @ strides[:2]:
        start = np.searchsorted(ordered, ordered[first] + step - 1, side="left")  # three boxes in a row
        many = np.searchsorted(ordered, ordered[first] + step + 1, side="right") - start
        i = np.repeat(first, many)
        j = np.arange(len(i)) - np.repeat(np.cumsum(many) - many - start, many)
        far = np.sum([(np.take(x, i) - np.take(x, j)) ** 2 for x in coordinates], axis=0)
        near = np.flatnonzero(far < (np.take(sizes, i) + np.take(sizes, j)) ** 2)
        i, j = order[i[near]], order[j[near]]
        pairs.append((i[j > i], j[j > i]))
    i, j = (np.concatenate(side) for side in zip(*pairs, strict=True))
    return i, j


# ----------------------------------------------------------------------------------------------------------------------
# The second-order grid on which results are written, whole on rank 0.
#
# Nodes are sorted by position and cells by their number in the mesh file, so that files do not depend on the number of ranks.


CELL_NAMES = {2: "Triangle_6", 3: "Tetrahedron_10"}


class Grid:
    """Nodes in device coordinates in m, shape (n, 3), and cells in VTK's order, shape (c, 6 or 10), of an equilibrium's
    displacement, on rank 0 and elsewhere empty, with XDMF's name of the cells."""

    def __init__(self, system: System):
        body = system.body
        self.comm, self.mixed = system.comm, system.mixed
        self.dimension = body.actuator.dimension
        self.cell_name = CELL_NAMES[self.dimension]
        self.space = fem.functionspace(body.mesh, ("P", 2))
        index_map = self.space.dofmap.index_map
        self.owned = index_map.size_local
        here = self.space.tabulate_dof_coordinates()[: self.owned] * system.length_unit
        everywhere = mpi.gathered(self.comm, body.actuator.device_points(here))
        local_cells = plot.vtk_mesh(self.space)[0].reshape(len(system.cells), -1)[:, 1:]
        cells = mpi.gathered(
            self.comm, index_map.local_to_global(local_cells.ravel().astype(np.int32)).reshape(local_cells.shape)
        )
        numbers = mpi.gathered(self.comm, body.mesh.topology.original_cell_index[: len(system.cells)])
        if everywhere is None or cells is None or numbers is None:
            self.points, self.cells, self.order = (
                np.empty((0, 3)),
                np.empty((0, 0), dtype=np.int64),
                np.empty(0, dtype=int),
            )
            return
        # Rounded so that the last digits of two ranks cannot swap neighbours; shifted off the round numbers common in meshes.
        rounded = np.floor(everywhere / system.length_unit * 1e8 + 0.4142)
        self.order = np.lexsort(rounded.T[::-1])
        self.points = everywhere[self.order]
        rank_of = np.empty(len(self.order), dtype=np.int64)
        rank_of[self.order] = np.arange(len(self.order))
        self.cells = rank_of[cells][np.argsort(numbers)]

    def collect(self, values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64] | None:
        """Return the nodal values of owned nodes, shape (owned, ...), as one array in the grid's order on rank 0; None
        elsewhere."""
        everywhere = mpi.gathered(self.comm, values)
        return None if everywhere is None else everywhere[self.order]

    def distribute(self, values: npt.NDArray[np.float64] | None) -> npt.NDArray[np.float64]:
        """Return the reverse of `collect`: owned nodes' values from the whole array on rank 0."""
        back = None
        if values is not None:
            back = np.empty_like(values)
            back[self.order] = values
        return mpi.scattered(self.comm, back, self.owned)


def displacement_maps(system: System, grid: Grid) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32] | None]:
    """Return the grid positions of a state's entries: indices into ``State.w`` of the skew components at each local node,
    shape (local nodes, d); and of p, one for each region, -1 where p has no dof (mid-edge nodes, and vertices that a region
    does not reach), shape (local nodes, regions), or None in the displacement formulation."""
    d = grid.dimension
    space = system.space
    if not system.mixed:
        nodes = _matched(grid, space)
        dofs = np.empty((len(nodes), d), dtype=np.int32)
        dofs[nodes] = d * np.arange(len(nodes))[:, None] + np.arange(d)
        return dofs, None
    columns = []
    for component in range(d):
        sub, blocks = space.sub(0).sub(component).collapse()
        parents = np.concatenate(blocks)
        column = np.empty(len(parents), dtype=np.int32)
        column[_matched(grid, sub)] = parents
        columns.append(column)
    corners = system.potential.pressure_dofs
    pressures = np.full((len(columns[0]), corners.shape[2]), -1, dtype=np.int32)
    pressures[np.array(grid.space.dofmap.list)[:, : corners.shape[1]]] = corners  # vertices come first in a cell
    return np.column_stack(columns), pressures


def _matched(grid: Grid, space: fem.FunctionSpace) -> npt.NDArray[np.int64]:
    """For each node of a space of the grid's degree, the local node of the grid at the same place: cells number both alike."""
    places = space.tabulate_dof_coordinates()
    nodes = np.empty(len(places), dtype=np.int64)
    nodes[np.ravel(space.dofmap.list)] = np.ravel(grid.space.dofmap.list)
    distance = np.abs(grid.space.tabulate_dof_coordinates()[nodes] - places)
    if distance.max(initial=0.0) > 1e-9:
        raise RuntimeError("the results' nodes are not where the unknowns are")
    return nodes
