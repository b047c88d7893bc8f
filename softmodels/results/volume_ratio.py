"""How much the silicone's own volume changes: J at the vertices, each the mean over the cells around it.

A single cell's J is no figure of the material. In the mixed form of second-order displacements and a continuous linear p
(Taylor & Hood 1973, doi 10.1016/0045-7930(73)90027-3) the volume is not kept cell by cell: what the equations say is

    int q (J - 1 - p/bulk) dX = 0   for every linear shape function q,

so that the means weighted by these functions are those of 1 + p/bulk, exactly, and cells scatter around them by an error of
the mesh: at 177 cm those of the default seminar actuator by up to 0.14, where p/bulk stays below 0.06.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from softmodels.mechanics.body import QUADRATURE_DEGREE, Body

if TYPE_CHECKING:
    from dolfinx import fem


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
        """Sums of weighted values, shape (cells, points), over a region's cells around each corner, shape (cells, corners)."""
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
        """Means at the corners of each local cell, shape (cells, corners), of J at its points, shape (cells, points)."""
        return self._weighted(J) / self._whole


def barycentric(points: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Linear shape functions of a simplex at points of the reference cell, shape (n, d) to (n, d + 1)."""
    return np.column_stack([1 - points.sum(axis=1), points])
