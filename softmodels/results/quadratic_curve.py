"""A curve of quadratic pieces, as second-order elements have on their edges: its signed distance from points.

The closest point of a piece is found by Newton's method on the piece itself, so that the distance is that of the curve and
not of a polygon. Its derivative needs no derivative of the closest point: the distance moves with the curve along the line
between the two (envelope theorem).
"""

from __future__ import annotations

import dataclasses
import functools
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from scipy.spatial import KDTree

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

SAMPLES = 9  # places per piece from which the closest point is looked for
NEAREST = 8  # samples whose pieces are tried for each point
ITERATIONS = 30


@dataclasses.dataclass(frozen=True, eq=False)
class Closest:
    """For each point its closest one on the curve.

    Attributes:
        distance: Signed distance, positive on the left of the curve's direction, shape (k,).
        piece: Index of the piece, shape (k,).
        weights: Shape functions of the piece's three nodes there, shape (k, 3).
        normal: Unit vector along which the distance grows as the point moves, shape (k, 2).
    """

    distance: Array
    piece: Indices
    weights: Array
    normal: Array

    def moved(self, rate: Array) -> Array:
        """Derivative of the distance as the curve's nodes move, shape (k,).

        Args:
            rate: Derivative of the nodes, shape (n, 3, 2).
        """
        return -np.einsum("ka,kai,ki->k", self.weights, rate[self.piece], self.normal)


@dataclasses.dataclass(frozen=True, eq=False)
class QuadraticCurve:
    """Pieces in order, each from its first node to its second, over its third at the middle of the parameter.

    Attributes:
        nodes: Shape (n, 3, 2).
    """

    nodes: Array

    def at(self, piece: Indices | int, s: Array | float) -> tuple[Array, Array, Array]:
        """Place, first and second derivative at the parameters s in -1...1 of pieces; shapes (..., 2)."""
        s = np.asarray(s, dtype=float)
        nodes = self.nodes[piece]
        place = np.einsum("...a,...ai->...i", shapes(s), nodes)
        slope = np.einsum("...a,...ai->...i", np.stack([s - 0.5, s + 0.5, -2 * s], axis=-1), nodes)
        bend = nodes[..., 0, :] + nodes[..., 1, :] - 2 * nodes[..., 2, :]
        return place, slope, bend

    @functools.cached_property
    def _samples(self) -> tuple[KDTree, Indices, Array]:
        from scipy.spatial import KDTree

        s = np.linspace(-1.0, 1.0, SAMPLES)
        piece = np.repeat(np.arange(len(self.nodes)), SAMPLES)
        at = np.tile(s, len(self.nodes))
        return KDTree(self.at(piece, at)[0]), piece, at

    def closest(self, points: Array) -> Closest:
        """The closest point of the curve to each of the points, shape (k, 2)."""
        tree, pieces, places = self._samples
        points = np.asarray(points, dtype=float)
        _, near = tree.query(points, k=min(NEAREST, len(pieces)))
        near = near.reshape(len(points), -1)
        piece, s, target = pieces[near], places[near], points[:, None, :]
        for _ in range(ITERATIONS):
            place, slope, bend = self.at(piece, s)
            gap = place - target
            square = (slope * slope).sum(-1)
            curvature = square + (gap * bend).sum(-1)
            # Where the distance has no minimum near, the step of a straight piece still leads towards it.
            step = -(gap * slope).sum(-1) / np.where(curvature > 0.1 * square, curvature, square)
            moved = np.clip(s + step, -1.0, 1.0)
            done = np.abs(moved - s).max() < 1e-15
            s = moved
            if done:
                break
        place, slope, _ = self.at(piece, s)
        best = np.argmin(((place - target) ** 2).sum(-1), axis=1)
        pick = np.arange(len(points)), best
        return self._signed(points, piece[pick], s[pick], place[pick], slope[pick])

    def _signed(self, points: Array, piece: Indices, s: Array, place: Array, slope: Array) -> Closest:
        slope = slope / np.linalg.norm(slope, axis=1)[:, None]
        left = np.column_stack([-slope[:, 1], slope[:, 0]])
        gap = points - place
        inside = np.abs(s) < 1.0
        along = (gap * left).sum(-1)
        # At a joint the nearest line is no normal of the piece; the side is that of both pieces' mean direction.
        size = np.linalg.norm(gap, axis=1)
        side = np.where(self._sides(piece, s, left, gap) < 0.0, -1.0, 1.0)
        joint = ~inside & (size > 1e-9 * np.linalg.norm(np.ptp(self.nodes.reshape(-1, 2), axis=0)))
        normal = left.copy()
        normal[joint] = side[joint, None] * gap[joint] / size[joint, None]
        return Closest(np.where(joint, side * size, along), np.asarray(piece), shapes(s), normal)

    def _sides(self, piece: Indices, s: Array, left: Array, gap: Array) -> Array:
        other = np.clip(piece + np.where(s >= 1.0, 1, np.where(s <= -1.0, -1, 0)), 0, len(self.nodes) - 1)
        slope = self.at(other, np.where(other == piece, s, -s))[1]
        slope = slope / np.linalg.norm(slope, axis=1)[:, None]
        both = left + np.column_stack([-slope[:, 1], slope[:, 0]])
        return (both * gap).sum(-1)


def shapes(s: Array | float) -> Array:
    """Shape functions of a piece's nodes at parameters s, shape (..., 3)."""
    s = np.asarray(s, dtype=float)
    return np.stack([s * (s - 1) / 2, s * (s + 1) / 2, 1 - s * s], axis=-1)
