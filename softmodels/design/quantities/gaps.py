"""Smallest gap between facing walls; negative if they overlap.

The gap at a place of the surface is that of `softmodels.runs.self_contact`: the signed distance to the closest place of a
wall that it faces. The minimum of several values is not differentiable where two are equal. The quantity is therefore the
smooth minimum of Kreisselmeier and Steinhauser (1979, doi 10.1016/S1474-6670(17)65584-8),

    -ln(sum over places exp(-rho gap)) / rho,    rho = `SHARPNESS` / t,

with the thickness t of the thinnest of these walls on the initial mesh. It never exceeds the smallest gap, and is below
it by ln(k)/rho for k equally close places, so a design that keeps it positive has no overlapping walls. The smallest gap
itself is reported too.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import numpy.typing as npt

from softmodels.common.arrays import Array
from softmodels.design.quantities.base import DesignQuantity, Measure, Slopes, register_quantity
from softmodels.mechanics.body import in_space
from softmodels.mechanics.mpi import is_root, on_root
from softmodels.runs.grid import Grid, displacement_maps
from softmodels.runs.self_contact import LAST_REACH, REACH, FacingWalls, Gaps

if TYPE_CHECKING:
    import scipy.sparse

    from softmodels.design.body import DesignedBody
    from softmodels.mechanics.system import State


SHARPNESS = 50.0
"""rho times the thickness of the thinnest wall: ten places that are equally close take 5 % of that thickness off the gap."""


class GapMeasure(Measure):
    """The smooth least gap of a meshed design.

    Args:
        design: The device, its mesh as it was made.
    """

    def __init__(self, design: DesignedBody):
        self.design, self.system = design, design.system
        self._grid = Grid(self.system)
        skew, _ = displacement_maps(self.system, self._grid)
        self._skew = skew[: self._grid.owned]
        self._from_nodes = _interpolation(self._grid, design)
        self._made = self._places()
        self._walls: FacingWalls | None = None  # on rank 0
        self._rho = 0.0

    def slopes(self, state: State | None) -> Slopes:
        system, grid, motion = self.system, self._grid, self.design.motion
        assert state is not None
        moved = in_space(system.w.x.array[self._skew] @ system.body.skew_inverse.T * system.length_unit)
        shift = grid.collect(self._places() - self._made + moved)
        value, least, rates = on_root(system.comm, lambda: self._smooth(shift))
        mesh = grid.distribute(rates if is_root(system.comm) else None) * system.length_unit  # by dimensionless places
        mesh = mesh if motion.dimension == 3 else mesh[:, [0, 2]]
        by_w = np.zeros(system.n)
        by_w[self._skew] = mesh @ system.body.skew_inverse
        note = f"the smallest gap is {1e3 * least:.4g} mm" if np.isfinite(least) else "no walls are near each other"
        return Slopes(value, system.by_unknowns(by_w).copy(), 0.0, self._by_nodes(mesh), note)

    def _places(self) -> Array:
        """Return the owned nodes of the grid on the current mesh, device coordinates in m, shape (n, 3)."""
        system = self.system
        here = self._grid.space.tabulate_dof_coordinates()[: self._grid.owned] * system.length_unit
        return system.body.actuator.device_points(here)

    def _by_nodes(self, rates: Array) -> Array:
        """Return the derivatives by the grid's owned nodes, shape (n, d), as those by the mesh's own nodes; see `Slopes.X`."""
        from dolfinx import fem, la

        b = fem.Function(self.design.motion.space).x
        b.array[:] = (self._from_nodes.T @ rates).ravel()
        b.scatter_reverse(la.InsertMode.add)
        return np.array(b.array)

    def _smooth(self, shift: Array | None) -> tuple[float, float, Array | None]:
        """Return the smooth and true least gap in m, and the smooth one's derivative by the places of the grid's nodes; on rank
        0."""
        assert shift is not None
        grid = self._grid
        if self._walls is None:
            planes = [plane.normal for plane in self.system.body.actuator.cut_planes]
            self._walls = FacingWalls(grid.points, grid.cells, grid.cell_name, planes)
        gaps, rates = self._near(self._walls, shift), np.zeros_like(shift)
        if not len(gaps.values):  # within the search distance
            return LAST_REACH * self._walls.size, np.inf, rates
        if not self._rho:
            self._rho = SHARPNESS / float(gaps.thickness.min())
        least = float(gaps.values.min())
        weights = np.exp(-self._rho * (gaps.values - least))
        near = weights > 1e-16
        value = least - float(np.log(weights.sum())) / self._rho
        _add_rates(rates, self._walls, gaps, near, weights[near] / weights.sum())
        return value, least, rates

    @staticmethod
    def _near(walls: FacingWalls, shift: Array) -> Gaps:
        """Return the gaps up to twice the least one, or as far as they are looked for."""
        reach = REACH * walls.size
        while True:
            gaps = walls.gaps(shift, reach)
            if np.min(gaps.values, initial=np.inf) < reach / 2 or reach >= LAST_REACH * walls.size:
                return gaps
            reach *= 2.0


def _add_rates(rates: Array, walls: FacingWalls, gaps: Gaps, chosen: npt.NDArray[np.bool_], shares: Array) -> None:
    """Add the derivatives of chosen gaps by the nodes' places, times a share of each."""
    facets, others, normals = gaps.facets[chosen], gaps.others[chosen], gaps.normals[chosen]
    own, other = walls.shapes(gaps.points[chosen]), gaps.weights[chosen]
    plane = others < 0
    along = shares[:, None] * normals
    # The image in a cut plane moves against the place itself.
    np.add.at(rates, walls.facets[facets], np.where(plane, 2.0, 1.0)[:, None, None] * own[:, :, None] * along[:, None])
    np.add.at(rates, walls.facets[others[~plane]], -other[~plane][:, :, None] * along[~plane][:, None])


def _interpolation(grid: Grid, design: DesignedBody) -> scipy.sparse.csr_matrix:
    """Return the places of the grid's owned nodes from those of the mesh's own local nodes, shape (owned, nodes of
    `MeshMotion.space`)."""
    import basix.ufl
    from scipy.sparse import csr_matrix

    mesh, space = grid.space.mesh, design.motion.space
    element = basix.ufl.element("P", mesh.basix_cell(), mesh.geometry.cmaps[0].degree)
    shapes = element.tabulate(0, grid.space.element.interpolation_points)[
        0
    ]  # (grid's nodes of a cell, mesh's nodes of it)
    nodes, own = np.asarray(grid.space.dofmap.list), np.asarray(space.dofmap.list)
    owned, first = np.unique(nodes.ravel(), return_index=True)
    cell, local = np.divmod(first[owned < grid.owned], nodes.shape[1])
    rows = np.repeat(np.arange(grid.owned), own.shape[1])
    size = (grid.owned, len(space.tabulate_dof_coordinates()))
    return csr_matrix((shapes[local].ravel(), (rows, own[cell].ravel())), shape=size)


@register_quantity
@dataclasses.dataclass(frozen=True, kw_only=True)
class LeastGap(DesignQuantity):
    """Smallest gap between facing walls, as a smooth minimum; negative if they overlap."""

    name: ClassVar = "least_gap"
    unit: ClassVar = "m"
    help: ClassVar = "smallest gap between facing walls (smooth minimum); negative if they overlap"

    def measure(self, design: DesignedBody) -> Measure:
        return GapMeasure(design)
