"""A wall that stands still, such as the surface of a rigid body: its samples do not move, and what comes near is pressed on."""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import TYPE_CHECKING

import numpy as np

from softmodels.mechanics.walls.energy import scattered
from softmodels.mechanics.walls.gap import LEAST, Near, Penalty, PointEnergies, pair_curvatures, pair_rates, sum_rates
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
        r, R = places[i] - self.places[j], self.radius
        t = np.maximum(1.0 - np.einsum("pi,pi->p", r, r) / R**2, 0.0)
        K = np.stack([t**3, -3 * t**2 / R**2, 6 * t / R**4]) / (math.pi / 4 * R**2)
        return Near(i, j, np.zeros_like(i), r, self.areas[j], K)

    def gaps(self, places: Array) -> Array:
        """Smooth distance of points, shape (n, 3), from the wall, below zero behind it; infinite where none is near."""
        return _gaps(*self.near(places).sums(len(places)))


def _gaps(N: Array, S: Array) -> Array:
    D = np.linalg.norm(S, axis=1)
    seen = D > LEAST
    return np.where(seen, N / np.where(seen, D, 1.0), np.inf)


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


@dataclasses.dataclass(eq=False)
class PressedOn:
    """A device's faces in one shape, pressed on by a fixed wall.

    Args:
        surface: The faces.
        wall: The wall.
        penalty: phi.
        nodes: Places of the faces' nodes, shape (n, 3).
    """

    surface: Surface
    wall: FixedWall
    penalty: Penalty
    nodes: Array

    def __post_init__(self) -> None:
        places = self.surface.places(self.nodes)
        near = self.wall.near(places)
        self.N, self.S = near.sums(len(places))
        self.gaps = _gaps(self.N, self.S)
        self.touching = self.gaps < 0.0
        self.near = near.of_points(self.touching)

    @functools.cached_property
    def _energies(self) -> PointEnergies:
        """Of the points that touch; zero of all others."""
        on, (count, d) = self.touching, self.S.shape
        value, first, second = np.zeros(count), np.zeros((count, 1 + d)), np.zeros((count, 1 + d, 1 + d))
        found = PointEnergies.of(self.N[on], self.S[on], self.surface.measure[on], self.penalty)
        value[on], first[on], second[on] = found.value, found.first, found.second
        return PointEnergies(value, first, second)

    @property
    def energy(self) -> float:
        return float(self._energies.value.sum())

    @functools.cached_property
    def forces(self) -> Array:
        """Derivative of the energy by the nodes' places, shape (n, 3)."""
        found, (count, d) = np.zeros_like(self.nodes), self.S.shape
        by_r, _ = pair_rates(self.near, self._energies.first)
        at_points = np.column_stack([np.bincount(self.near.i, by_r[:, c], count) for c in range(d)])
        at_nodes = np.einsum("sa,si->sai", self.surface.shapes, at_points)
        np.add.at(found, self.surface.facets[self.surface.owner], at_nodes)
        return found

    @functools.cached_property
    def stiffness(self) -> scipy.sparse.csr_array:
        """Second derivative of the energy, shape (3 n, 3 n); nodes' components follow each other."""
        import scipy

        n, d = self.nodes.shape
        touching = np.flatnonzero(self.touching)
        if not len(touching):
            return scipy.sparse.csr_array((n * d, n * d))
        number = np.cumsum(self.touching) - 1
        points, near = number[self.near.i], self.near
        own, rates = np.zeros((len(touching), d, d)), np.zeros((len(touching), 1 + d, d))
        np.add.at(own, points, pair_curvatures(near, self._energies.first)[:, :d, :d])
        np.add.at(rates, points, sum_rates(near)[:, :, :d])
        own += np.einsum("sai,sab,sbj->sij", rates, self._energies.second[touching], rates)
        shapes = self.surface.shapes[touching]
        nodes = self.surface.facets[self.surface.owner[touching]]
        dofs = (d * nodes[:, :, None] + np.arange(d)).reshape(len(touching), -1)
        blocks = np.einsum("sa,sb,sij->saibj", shapes, shapes, own).reshape(len(touching), dofs.shape[1], -1)
        found = scattered(blocks, dofs, dofs, n * d, n * d)
        return scipy.sparse.csr_array((found + found.T) / 2)

    def coupled(self, soon: float) -> scipy.sparse.csr_array:
        """Nodes of facets with a point nearer than ``soon`` radii, true for each two, shape (n, n)."""
        import scipy

        surface = self.surface
        facets = surface.facets[np.unique(surface.owner[self.gaps < soon * self.wall.radius])]
        shape = (len(facets), len(self.nodes))
        at = (np.repeat(np.arange(len(facets)), facets.shape[1]), facets.ravel())
        held = scipy.sparse.csr_array(scipy.sparse.coo_array((np.ones(facets.size, dtype=np.int32), at), shape=shape))
        return scipy.sparse.csr_array((held.T @ held) > 0)
