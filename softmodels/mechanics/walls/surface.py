"""The surfaces of walls: quadratic facets, sampled at the points of a rule, with what their places and areas derive from.

A facet is a line of three nodes or a triangle of six. A sample has a place y, which is linear in the nodes' places, and an area
vector m, normal times deformed area, out of the solid, which is linear in a line's nodes and bilinear in a triangle's.
"""

from __future__ import annotations

import dataclasses
import functools
import math

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]

DEGREE = 4
"""Of the rule: three points on a line, six on a triangle."""


def _lines(points: Array) -> tuple[Array, Array]:
    """Shape functions, shape (q, 3), and their slopes, shape (q, 3, 1), of corner, corner and middle."""
    s = points[:, 0]
    values = np.column_stack([(1 - s) * (1 - 2 * s), s * (2 * s - 1), 4 * s * (1 - s)])
    slopes = np.column_stack([4 * s - 3, 4 * s - 1, 4 - 8 * s])
    return values, slopes[:, :, None]


def _triangles(points: Array) -> tuple[Array, Array]:
    """The same of a triangle, shapes (q, 6) and (q, 6, 2): corners, then middles opposite to them."""
    r, s = points.T
    a = np.column_stack([1 - r - s, r, s])
    da = np.array([[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]])
    others = ((1, 2), (2, 0), (0, 1))
    values = np.column_stack(
        [*(a[:, i] * (2 * a[:, i] - 1) for i in range(3)), *(4 * a[:, i] * a[:, j] for i, j in others)]
    )
    slopes = [(4 * a[:, i] - 1)[:, None] * da[i] for i in range(3)]
    slopes += [4 * (a[:, i][:, None] * da[j] + a[:, j][:, None] * da[i]) for i, j in others]
    return values, np.stack(slopes, axis=1)


@dataclasses.dataclass(frozen=True, eq=False)
class Surface:
    """Walls at rest.

    Attributes:
        nodes: Places at rest, shape (n, d).
        facets: Nodes of each facet: corners, then middles, shape (f, 3 or 6); of triangles each middle opposite to its corner.
        walls: Number of the wall that each facet belongs to, shape (f,).
        inside: A point of the solid behind each facet, shape (f, d).
        axisymmetric: Whether the areas are those of rings around the second axis.
    """

    nodes: Array
    facets: Numbers
    walls: Numbers
    inside: Array
    axisymmetric: bool = False

    @functools.cached_property
    def dimension(self) -> int:
        return int(self.nodes.shape[1])

    @functools.cached_property
    def rule(self) -> tuple[Array, Array, Array]:
        """Shape functions (q, k), their slopes (q, k, d - 1) and weights (q,) at the points of the rule."""
        import basix

        cell = basix.CellType.interval if self.dimension == 2 else basix.CellType.triangle
        points, weights = basix.make_quadrature(cell, DEGREE)
        return (*(_lines if self.dimension == 2 else _triangles)(points), weights)

    @functools.cached_property
    def turn(self) -> Array:
        """1 or -1 for each facet, so that area vectors point out of the solid, shape (f,)."""
        corners = self.nodes[self.facets[:, : self.dimension]]
        along = np.diff(corners, axis=1)
        normal = _crossed(along[:, 0], along[:, -1])
        out = np.einsum("fi,fi->f", normal, corners.mean(axis=1) - self.inside)
        return np.where(out > 0.0, 1.0, -1.0)

    @functools.cached_property
    def owner(self) -> Numbers:
        """The facet of each sample, shape (s,)."""
        return np.repeat(np.arange(len(self.facets)), len(self.rule[2]))

    @functools.cached_property
    def shapes(self) -> Array:
        """Shape functions at each sample, shape (s, k)."""
        return np.tile(self.rule[0], (len(self.facets), 1))

    @functools.cached_property
    def rest(self) -> tuple[Array, Array]:
        """Places and area vectors of the samples at rest, shape (s, d) each."""
        return self.places(self.nodes), self.areas(self.nodes)

    @functools.cached_property
    def measure(self) -> Array:
        """Undeformed area of each sample, of the ring in an axisymmetric section, shape (s,)."""
        places, areas = self.rest
        size = np.linalg.norm(areas, axis=1)
        return size * 2 * math.pi * places[:, 0] if self.axisymmetric else size

    @functools.cached_property
    def edges(self) -> Array:
        """Length of a facet's edge at each sample: of a line, or of the equal-sided triangle of the same area; shape (s,)."""
        sizes = np.linalg.norm(self.rest[1], axis=1).reshape(len(self.facets), -1).sum(axis=1)
        return np.asarray((sizes if self.dimension == 2 else np.sqrt(4 / math.sqrt(3) * sizes))[self.owner])

    def places(self, nodes: Array) -> Array:
        """Places of the samples, shape (s, d), where the nodes are at ``nodes``, shape (n, d)."""
        return np.einsum("qa,fai->fqi", self.rule[0], nodes[self.facets]).reshape(-1, self.dimension)

    def _along(self, nodes: Array) -> Array:
        """Tangents at the samples, shape (f, q, d - 1, d)."""
        return np.asarray(np.einsum("qat,fai->fqti", self.rule[1], nodes[self.facets]))

    def _factor(self) -> Array:
        return np.asarray(self.turn[:, None] * self.rule[2])

    def areas(self, nodes: Array) -> Array:
        """Area vectors of the samples, shape (s, d)."""
        along = self._along(nodes)
        return (_crossed(along[:, :, 0], along[:, :, -1]) * self._factor()[..., None]).reshape(-1, self.dimension)

    def area_rates(self, nodes: Array) -> Array:
        """Derivative of each sample's area vector by its facet's nodes, shape (s, d, k, d)."""
        slopes, factor, d = self.rule[1], self._factor(), self.dimension
        if d == 2:
            turned = np.array([[0.0, 1.0], [-1.0, 0.0]])
            rates = np.einsum("fq,qa,ij->fqiaj", factor, slopes[:, :, 0], turned)
            return rates.reshape(-1, 2, self.facets.shape[1], 2)
        along = self._along(nodes)
        first, second = _cross_matrix(along[:, :, 0]), _cross_matrix(along[:, :, 1])
        # m = t1 x t2: dm = t1 x dt2 - t2 x dt1
        rates = np.einsum("fq,qa,fqij->fqiaj", factor, slopes[:, :, 1], first)
        rates -= np.einsum("fq,qa,fqij->fqiaj", factor, slopes[:, :, 0], second)
        return rates.reshape(-1, 3, self.facets.shape[1], 3)

    def area_curvatures(self, along: Array, samples: Numbers) -> Array:
        """Second derivative of ``along . m`` by the nodes of a sample's facet, shape (p, k, d, k, d); of triangles alone.

        Args:
            along: Shape (p, 3).
            samples: Their numbers, shape (p,).
        """
        slopes, count = self.rule[1], len(self.rule[2])
        q = samples % count
        first, second = slopes[q, :, 0], slopes[q, :, 1]
        pairs = np.einsum("pa,pb->pab", first, second)
        pairs = (pairs - pairs.transpose(0, 2, 1)) * self._factor().ravel()[samples, None, None]
        # along . (e x f) = e . (f x along) = -e . (along x f)
        return np.asarray(np.einsum("pab,pij->paibj", pairs, -_cross_matrix(along)))


def _crossed(first: Array, second: Array) -> Array:
    """Product of two tangents, shape (..., d); in the plane the one tangent turned by a right angle."""
    if first.shape[-1] == 3:
        return np.asarray(np.cross(first, second))
    return np.stack([first[..., 1], -first[..., 0]], axis=-1)


def _cross_matrix(vectors: Array) -> Array:
    """Matrices that stand for the cross product with vectors from the left, shape (..., 3, 3)."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    o = np.zeros_like(x)
    return np.stack([np.stack(row, axis=-1) for row in ((o, -z, y), (z, o, -x), (-y, x, o))], axis=-2)
