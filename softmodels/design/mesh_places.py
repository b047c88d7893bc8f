"""Where points lie in a mesh of curved cells, and the interpolation there."""

from __future__ import annotations

import itertools

import numpy as np
import numpy.typing as npt
import scipy.spatial

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]

EDGES = {2: ((0, 1), (1, 2), (0, 2)), 3: ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))}
"""Corners of each mid-edge node, in VTK's order, by dimension."""
NEAREST = 24
"""Cells with the nearest middles that a point is looked for in."""
ITERATIONS = 6
"""Of Newton's method for the place in a curved cell."""
OUTSIDE = 0.1
"""Farthest that a point may lie outside of its cell, in barycentric coordinates: meshes of a curved wall differ."""


class Places:
    """Points in the cells of a mesh of order two.

    Args:
        nodes: Places of its nodes, shape (n, d).
        cells: Node numbers in VTK's order, shape (c, 6 or 10).
        points: Shape (m, d).

    Attributes:
        cell: The cell of each point, shape (m,).
        share: Its barycentric coordinates there, shape (m, d + 1).
    """

    def __init__(self, nodes: Array, cells: Numbers, points: Array):
        self.cells, d = cells, nodes.shape[1]
        self.edges = EDGES[d]
        corners = nodes[cells[:, : d + 1]]
        count = min(NEAREST, len(cells))
        _, near = scipy.spatial.cKDTree(corners.mean(axis=1)).query(points, count)
        near = near.reshape(len(points), count)
        frames = np.linalg.inv(np.swapaxes(corners[:, 1:] - corners[:, :1], 1, 2))
        inner = np.einsum("mkij,mkj->mki", frames[near], points[:, None] - corners[near, 0])
        shares = np.concatenate([1.0 - inner.sum(axis=2, keepdims=True), inner], axis=2)
        # Straight cells tell which ones are worth the curved ones' Newton steps.
        best = np.argsort(-shares.min(axis=2), axis=1)[:, :3]
        self.cell, self.share = near[:, 0], np.full((len(points), d + 1), -np.inf)
        for k in range(best.shape[1]):
            chosen = np.take_along_axis(near, best[:, k : k + 1], 1)[:, 0]
            straight = np.take_along_axis(shares, best[:, k, None, None], 1)[:, 0]
            share = self._curved(nodes[cells[chosen]], points, straight)
            better = share.min(axis=1) > self.share.min(axis=1)
            self.cell, self.share = np.where(better, chosen, self.cell), np.where(better[:, None], share, self.share)
        inside = np.maximum(self.share, -OUTSIDE)
        self.share = inside / inside.sum(axis=1, keepdims=True)

    def _curved(self, nodes: Array, points: Array, share: Array) -> Array:
        """Barycentric coordinates in curved cells, from those in straight ones; these where Newton's method leads astray."""
        found = np.clip(share, -0.5, 1.5)
        found = found / found.sum(axis=1, keepdims=True)
        start = found
        for _ in range(ITERATIONS):
            gap = points - np.einsum("mn,mni->mi", self._shapes(found), nodes)
            slopes = np.einsum("mnk,mni->mik", self._slopes(found), nodes)  # by each coordinate as if it were free
            jacobian = slopes[:, :, 1:] - slopes[:, :, :1]
            regular = np.abs(np.linalg.det(jacobian)) > 1e-12 * np.abs(jacobian).max(axis=(1, 2)) ** jacobian.shape[1]
            jacobian[~regular] = np.eye(jacobian.shape[1])
            step = np.clip(np.linalg.solve(jacobian, gap[..., None])[..., 0], -0.5, 0.5)
            found = found + np.concatenate([-step.sum(axis=1, keepdims=True), step], axis=1)
        astray = ~(np.abs(found - start).max(axis=1) < 1.0)
        return np.where(astray[:, None], start, found)

    def _shapes(self, share: Array) -> Array:
        """The nodes' shape functions, shape (m, nodes)."""
        edges = np.array(self.edges)
        return np.concatenate(
            [share * (2.0 * share - 1.0), 4.0 * share[:, edges[:, 0]] * share[:, edges[:, 1]]], axis=1
        )

    def _slopes(self, share: Array) -> Array:
        """Their slopes by the barycentric coordinates, shape (m, nodes, d + 1)."""
        corners = share.shape[1]
        found = np.zeros((len(share), corners + len(self.edges), corners))
        for k in range(corners):
            found[:, k, k] = 4.0 * share[:, k] - 1.0
        for number, (one, other) in zip(itertools.count(corners), self.edges, strict=False):
            found[:, number, one], found[:, number, other] = 4.0 * share[:, other], 4.0 * share[:, one]
        return found

    def interpolated(self, values: Array, linear: bool = False) -> Array:
        """Values at the points, shape (m, k), of those at the nodes, shape (n, k); ``linear`` takes the corners' alone."""
        weights = self.share if linear else self._shapes(self.share)
        return np.einsum("mn,mnk->mk", weights, values[self.cells[self.cell][:, : weights.shape[1]]])
