"""Energy, forces and stiffness of walls in contact, by their nodes' places."""

from __future__ import annotations

import dataclasses
import functools
from typing import TYPE_CHECKING

import numpy as np

from softmodels.mechanics.walls.gap import Near, Penalty, PointEnergies, gaps_of, pair_curvatures, pair_rates, sum_rates
from softmodels.mechanics.walls.pairs import Pairs
from softmodels.mechanics.walls.surface import Array, Numbers

if TYPE_CHECKING:
    import scipy

FACET_PAIRS = 500
"""Pairs of facets whose blocks are in memory at a time."""


@dataclasses.dataclass(eq=False)
class Pressed:
    """Walls in one shape. Every pair of walls is counted from both sides, with half the energy each.

    Args:
        pairs: The walls and their search.
        penalty: phi.
        nodes: Places of the nodes, shape (n, d).
    """

    pairs: Pairs
    penalty: Penalty
    nodes: Array

    def __post_init__(self) -> None:
        surface = self.pairs.surface
        self.surface = surface
        self.places, self.areas = surface.places(self.nodes), surface.areas(self.nodes)
        near = Near.of(self.pairs, self.places, self.areas)
        self.N, self.S = near.sums(len(self.places))
        self.gaps = gaps_of(self.N, self.S)
        self.touching = self.gaps < self.penalty.ahead
        self._all_near, self.near = near, near.of_points(self.touching)

    @functools.cached_property
    def points(self) -> PointEnergies:
        """Energies of the points that touch; zero of all others."""
        return PointEnergies.of_touching(self.touching, self.N, self.S, self.surface.measure / 2, self.penalty)

    @property
    def energy(self) -> float:
        return float(self.points.value.sum())

    @property
    def depth(self) -> float:
        """Deepest penetration; below zero where nothing touches."""
        return -float(self.gaps.min(initial=np.inf))

    @property
    def pressed_force(self) -> float:
        """Sum of the sizes of the forces between points and walls; a pair of walls counts once."""
        return float(-self.points.first[:, 0] @ np.linalg.norm(self.S, axis=1))

    def coupled(self, soon: float) -> scipy.sparse.csr_array:
        """Nodes of all that a point touches or is near to, ``soon`` radii, true for each two, shape (n, n)."""
        surface, near = self.surface, self._all_near
        close = self.gaps < soon * self.pairs.radius
        near = near.of_points(close)
        facets = surface.facets[surface.owner]
        i, nodes = np.concatenate([near.i, near.i]), np.concatenate([facets[near.i], facets[near.j]])
        return together(i, nodes, (len(self.gaps), len(self.nodes)))

    def _by_samples(self) -> tuple[Array, Array]:
        """Derivatives of the energy by the samples' places and by their area vectors, shape (s, d) each."""
        by_r, by_m = pair_rates(self.near, self.points.first)
        count, d = self.S.shape
        i, j, back = self.near.i, self.near.j, self.pairs.images[self.near.image]
        at_wall, by_m = np.einsum("pji,pj->pi", back, by_r), np.einsum("pji,pj->pi", back, by_m)
        places = [np.bincount(i, by_r[:, c], count) - np.bincount(j, at_wall[:, c], count) for c in range(d)]
        return np.column_stack(places), np.column_stack([np.bincount(j, by_m[:, c], count) for c in range(d)])

    @functools.cached_property
    def forces(self) -> Array:
        """Derivative of the energy by the nodes' places, shape (n, d)."""
        found = np.zeros_like(self.nodes)
        if self.touching.any():
            by_places, by_areas = self._by_samples()
            at_nodes = np.einsum("sa,si->sai", self.surface.shapes, by_places)
            at_nodes += np.einsum("si,siaj->saj", by_areas, self.surface.area_rates(self.nodes))
            np.add.at(found, self.surface.facets[self.surface.owner], at_nodes)
        return found

    @functools.cached_property
    def stiffness(self) -> scipy.sparse.csr_array:
        """Second derivative of the energy, shape (n d, n d); nodes' components follow each other."""
        import scipy

        n, d = self.nodes.shape
        if not self.touching.any():
            return scipy.sparse.csr_array((n * d, n * d))
        found = self._through_pairs()
        if d == 3:
            facets = self.surface.facets[self.surface.owner]
            pressed = np.unique(self.near.j)
            bent = self.surface.area_curvatures(self._by_samples()[1][pressed], pressed)
            dofs = components_of(facets[pressed], d)
            found = found + scattered(bent.reshape(len(pressed), dofs.shape[1], -1), dofs, dofs, n * d, n * d)
        return scipy.sparse.csr_array((found + found.T) / 2)

    def _pair_places(self, near: Near, rates: Array) -> Array:
        """Derivative of (r, m) of pairs by the places of the nodes of both facets, shape (p, 2d, 2kd)."""
        shapes, (d, k) = self.surface.shapes, rates.shape[1:3]
        turn = self.pairs.images[near.image]
        Z = np.zeros((len(near.i), 2 * d, 2 * k, d))
        for c in range(d):
            Z[:, c, :k, c] = shapes[near.i]
        Z[:, :d, k:] = -shapes[near.j][:, None, :, None] * turn[:, :, None, :]
        Z[:, d:, k:] = (turn @ rates[near.j].reshape(len(near.i), d, k * d)).reshape(-1, d, k, d)
        return Z.reshape(len(near.i), 2 * d, 2 * k * d)

    def _through_pairs(self) -> scipy.sparse.csr_array:
        """The second derivative but for that of the area vectors. Pairs of the same two facets are added up first."""
        import scipy

        n, d = self.nodes.shape
        surface, near, first = self.surface, self.near, self.points.first
        owner, rates = surface.owner, surface.area_rates(self.nodes)
        order = np.argsort(owner[near.i] * len(surface.facets) + owner[near.j], kind="stable")
        near = near.taken(order)
        key = owner[near.i] * len(surface.facets) + owner[near.j]
        starts = np.flatnonzero(np.diff(key, prepend=-1))
        dofs = components_of(
            np.concatenate([surface.facets[owner[near.i[starts]]], surface.facets[owner[near.j[starts]]]], axis=1), d
        )
        touching = np.flatnonzero(self.touching)
        number = np.empty(len(self.touching), dtype=np.int64)
        number[touching] = np.arange(len(touching))
        size, chunks = (1 + d) * len(touching), range(0, len(starts), FACET_PAIRS)
        K, U = scipy.sparse.csr_array((n * d, n * d)), scipy.sparse.csr_array((size, n * d))
        for chunk in chunks:
            chosen = starts[chunk : chunk + FACET_PAIRS]
            end = starts[chunk + FACET_PAIRS] if chunk + FACET_PAIRS < len(starts) else len(key)
            part = near.taken(slice(chosen[0], end))
            Z = self._pair_places(part, rates)
            blocks = np.add.reduceat(
                Z.transpose(0, 2, 1) @ pair_curvatures(part, first) @ Z, chosen - chosen[0], axis=0
            )
            at = dofs[chunk : chunk + FACET_PAIRS]
            K = K + scattered(blocks, at, at, n * d, n * d)
            rows = (1 + d) * number[part.i][:, None] + np.arange(1 + d)
            columns = np.repeat(at, np.diff(chosen, append=end), axis=0)
            U = U + scattered(sum_rates(part) @ Z, rows, columns, size, n * d)
        own = (1 + d) * np.arange(len(touching))[:, None] + np.arange(1 + d)
        C = scattered(self.points.second[touching], own, own, size, size)
        return scipy.sparse.csr_array(K + U.T @ C @ U)


def components_of(nodes: Numbers, d: int) -> Numbers:
    """Numbers of the components of nodes, shape (p, a) to (p, a d)."""
    return np.asarray((d * nodes[:, :, None] + np.arange(d)).reshape(len(nodes), -1))


def together(groups: Numbers, nodes: Numbers, shape: tuple[int, int]) -> scipy.sparse.csr_array:
    """Whether two nodes are in a common group, for each two.

    Args:
        groups: The group of each row of ``nodes``, shape (p,).
        nodes: Shape (p, a).
        shape: Groups and nodes in all.
    """
    import scipy

    at = (np.repeat(groups, nodes.shape[1]), nodes.ravel())
    held = scipy.sparse.csr_array(scipy.sparse.coo_array((np.ones(nodes.size, dtype=np.int32), at), shape=shape))
    return scipy.sparse.csr_array((held.T @ held) > 0)


def scattered(blocks: Array, rows: Numbers, columns: Numbers, height: int, width: int) -> scipy.sparse.csr_array:
    """Sum of small dense blocks, shape (p, a, b), in a sparse matrix; ``rows`` (p, a) and ``columns`` (p, b) are theirs."""
    import scipy

    _, a, b = blocks.shape
    at = (np.repeat(rows, b, axis=1).ravel(), np.tile(columns, (1, a)).ravel())
    return scipy.sparse.csr_array(scipy.sparse.coo_array((blocks.ravel(), at), shape=(height, width)))
