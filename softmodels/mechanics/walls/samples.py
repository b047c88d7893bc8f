"""A device's faces in one shape, pressed on at each of their samples by something whose places do not matter to them."""

from __future__ import annotations

import abc
import functools
from typing import TYPE_CHECKING

import numpy as np

from softmodels.mechanics.walls.energy import components_of, scattered, together
from softmodels.mechanics.walls.surface import Array, Numbers, Surface

if TYPE_CHECKING:
    import scipy


class PressedSamples(abc.ABC):
    """Sums over samples; a kind says what each sample's energy is.

    Args:
        surface: The faces.
        nodes: Places of the faces' nodes, shape (n, d).

    Attributes:
        gaps: Of the samples, below zero where they are pressed on, shape (s,).
        touching: Where that is so.
    """

    gaps: Array
    touching: np.ndarray

    def __init__(self, surface: Surface, nodes: Array):
        self.surface, self.nodes = surface, nodes

    @property
    @abc.abstractmethod
    def energy(self) -> float:
        """Of all samples."""

    @abc.abstractmethod
    def slopes(self) -> Array:
        """Derivative of the energy by the samples' places, shape (s, d)."""

    @abc.abstractmethod
    def curvatures(self) -> Array:
        """Second derivative by the place of each sample that touches, shape (t, d, d)."""

    @abc.abstractmethod
    def soon(self, share: float) -> np.ndarray:
        """Samples that touch or soon may, a mask of shape (s,); ``share`` is of what the kind calls near."""

    @property
    def depth(self) -> float:
        """How deep a sample has sunk in at most; below zero where none has."""
        return -float(self.gaps.min(initial=np.inf))

    @functools.cached_property
    def forces(self) -> Array:
        """Derivative of the energy by the nodes' places, shape (n, d)."""
        found = np.zeros_like(self.nodes)
        at_nodes = np.einsum("sa,si->sai", self.surface.shapes, self.slopes())
        np.add.at(found, self.surface.facets[self.surface.owner], at_nodes)
        return found

    @functools.cached_property
    def stiffness(self) -> scipy.sparse.csr_array:
        """Second derivative of the energy, shape (n d, n d); nodes' components follow each other."""
        import scipy

        found = self.scattered(self.curvatures())
        return scipy.sparse.csr_array((found + found.T) / 2)

    def scattered(self, curvatures: Array) -> scipy.sparse.csr_array:
        """The matrix, shape (n d, n d), of what is by the place of each sample that touches, shape (t, d, d)."""
        import scipy

        n, d = self.nodes.shape
        touching = np.flatnonzero(self.touching)
        if not len(touching):
            return scipy.sparse.csr_array((n * d, n * d))
        shapes = self.surface.shapes[touching]
        dofs = components_of(self.surface.facets[self.surface.owner[touching]], d)
        blocks = np.einsum("sa,sb,sij->saibj", shapes, shapes, curvatures)
        return scattered(blocks.reshape(len(touching), dofs.shape[1], -1), dofs, dofs, n * d, n * d)

    def near_facets(self, share: float) -> Numbers:
        """Nodes of the facets with a sample that touches or soon may, shape (f, k)."""
        return self.surface.facets[np.unique(self.surface.owner[self.soon(share)])]

    def coupled(self, share: float) -> scipy.sparse.csr_array:
        """Nodes that share such a facet, true for each two, shape (n, n)."""
        facets = self.near_facets(share)
        return together(np.arange(len(facets)), facets, (len(facets), len(self.nodes)))
