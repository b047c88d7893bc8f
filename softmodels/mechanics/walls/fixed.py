"""A wall that stands still, such as the surface of a rigid body: its samples do not move, and what comes near is pressed on."""

from __future__ import annotations

import dataclasses
import functools
from typing import TYPE_CHECKING

import numpy as np

from softmodels.mechanics.walls.gap import (
    Near,
    Penalty,
    PointEnergies,
    gaps_of,
    kernels,
    pair_curvatures,
    pair_rates,
    sum_rates,
)
from softmodels.mechanics.walls.samples import PressedSamples
from softmodels.mechanics.walls.surface import Array, Numbers, Surface

if TYPE_CHECKING:
    import scipy

FINE = 0.5
"""Longest edge, in radii of the kernel, of the pieces that triangles are cut into; each has one sample."""
MOST_SAMPLES = 1_000_000


class TooFineError(ValueError):
    """A wall of too many samples."""


@dataclasses.dataclass(frozen=True, eq=False)
class FixedWall:
    """Samples of a closed surface.

    Attributes:
        places: Shape (s, 3).
        areas: Area vectors out of the body, shape (s, 3).
        radius: Of the kernel of all samples.
    """

    places: Array
    areas: Array
    radius: float

    @classmethod
    def of(cls, points: Array, triangles: Numbers, radius: float) -> FixedWall:
        """The samples of triangles, in the middles of pieces that are small against the radius.

        Args:
            points: Corners, shape (n, 3).
            triangles: Their numbers, counter-clockwise as seen from outside, shape (t, 3).
            radius: Of the kernel.

        Raises:
            TooFineError: There would be more than `MOST_SAMPLES`.
        """
        corners = _cut(np.asarray(points[triangles], dtype=float), FINE * radius)
        areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
        return cls(corners.mean(axis=1), areas, radius)

    @functools.cached_property
    def tree(self) -> scipy.spatial.cKDTree:
        import scipy

        return scipy.spatial.cKDTree(self.places)

    def near(self, places: Array) -> Near:
        """Pairs of points, shape (n, 3), and samples nearer than the radius."""
        import scipy

        found = scipy.spatial.cKDTree(places).sparse_distance_matrix(self.tree, self.radius, output_type="ndarray")
        order = np.lexsort((found["j"], found["i"]))
        i, j = found["i"][order].astype(np.int64), found["j"][order].astype(np.int64)
        r = places[i] - self.places[j]
        return Near(i, j, np.zeros_like(i), r, self.areas[j], kernels(r, self.radius))

    def gaps(self, places: Array) -> Array:
        """Smooth distance of points, shape (n, 3), from the wall, below zero behind it; infinite where none is near."""
        return gaps_of(*self.near(places).sums(len(places)))


def _cut(corners: Array, longest: float) -> Array:
    """Triangles, shape (t, 3, 3), halved through their longest edges until none is longer."""
    done: list[Array] = []
    count = 0
    while len(corners):
        edges = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
        short = edges.max(axis=1) <= longest
        done.append(corners[short])
        count += int(short.sum())
        corners, edges = corners[~short], edges[~short]
        if count + 2 * len(corners) > MOST_SAMPLES:
            raise TooFineError
        first = edges.argmax(axis=1)[:, None]  # from the first corner of the longest edge on
        a, b, c = (np.take_along_axis(corners, ((first + k) % 3)[:, :, None], axis=1)[:, 0] for k in range(3))
        middle = (a + b) / 2
        corners = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
    return np.concatenate(done) if done else np.empty((0, 3, 3))


class PressedOn(PressedSamples):
    """A device's faces in one shape, pressed on by a fixed wall.

    Args:
        surface: The faces.
        wall: The wall.
        penalty: phi.
        nodes: Places of the faces' nodes, shape (n, 3).
    """

    def __init__(self, surface: Surface, wall: FixedWall, penalty: Penalty, nodes: Array):
        super().__init__(surface, nodes)
        self.wall, self.penalty = wall, penalty
        places = surface.places(nodes)
        near = wall.near(places)
        self.N, self.S = near.sums(len(places))
        self.gaps = gaps_of(self.N, self.S)
        self.touching = self.gaps < 0.0
        self.near = near.of_points(self.touching)

    @functools.cached_property
    def _energies(self) -> PointEnergies:
        """Of the points that touch; zero of all others."""
        return PointEnergies.of_touching(self.touching, self.N, self.S, self.surface.measure, self.penalty)

    @property
    def energy(self) -> float:
        return float(self._energies.value.sum())

    def slopes(self) -> Array:
        count, d = self.S.shape
        by_r, _ = pair_rates(self.near, self._energies.first)
        return np.column_stack([np.bincount(self.near.i, by_r[:, c], count) for c in range(d)])

    def curvatures(self) -> Array:
        d, touching, near = self.S.shape[1], np.flatnonzero(self.touching), self.near
        points = (np.cumsum(self.touching) - 1)[near.i]
        own, rates = np.zeros((len(touching), d, d)), np.zeros((len(touching), 1 + d, d))
        np.add.at(own, points, pair_curvatures(near, self._energies.first)[:, :d, :d])
        np.add.at(rates, points, sum_rates(near)[:, :, :d])
        return np.asarray(own + np.einsum("sai,sab,sbj->sij", rates, self._energies.second[touching], rates))

    def soon(self, share: float) -> np.ndarray:
        """Samples nearer than ``share`` radii of the kernel."""
        return np.asarray(self.gaps < share * self.wall.radius)
