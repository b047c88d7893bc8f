"""Which samples of walls may press on each other, and which of these are near."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from softmodels.mechanics.walls.surface import Array, Numbers, Surface

REACH = 1.2
"""Radius of the kernel in edges of the facets: two and a half times the distance of samples, at rest."""
OPPOSED = -0.2
"""Largest product of normals at rest of neighbours on one wall that may come to press on each other."""
NEIGHBOURS = 3.0
"""Distance at rest, in radii, up to which samples are neighbours on one wall."""
BEHIND = 1e-6
"""Sine of the angle under which a chord has to enter the solid at both ends, to run through silicone."""


@dataclasses.dataclass(frozen=True, eq=False)
class Pairs:
    """The search for pairs of samples.

    Attributes:
        surface: All walls.
        meets: Whether a wall may press on another, or on itself, shape (walls, walls), symmetric.
    """

    surface: Surface
    meets: npt.NDArray[np.bool_]

    @functools.cached_property
    def radius(self) -> Array:
        """Radius of each sample's kernel, shape (s,): that of its own facet, but none smaller than the mean."""
        edges, measure = self.surface.edges, self.surface.measure
        return REACH * np.maximum(edges, float(edges @ measure / measure.sum()))

    @functools.cached_property
    def normals(self) -> Array:
        """Unit normals at rest, shape (s, d)."""
        areas = self.surface.rest[1]
        return np.asarray(areas / np.linalg.norm(areas, axis=1)[:, None])

    def allowed(self, i: Numbers, j: Numbers) -> npt.NDArray[np.bool_]:
        """Whether samples i may press on samples j.

        It depends on the undeformed shape alone, so that the energy is a function of the displacement. Left out are
        neighbours on one wall that do not face each other, and two sides of a wall, between which there is silicone.
        """
        owner, walls = self.surface.owner, self.surface.walls
        may = self.meets[walls[owner[i]], walls[owner[j]]]
        i, j = i[may], j[may]
        X, N = self.surface.rest[0], self.normals
        chord = X[j] - X[i]
        length = np.linalg.norm(chord, axis=1)
        out, back = np.einsum("pi,pi->p", chord, N[i]), -np.einsum("pi,pi->p", chord, N[j])
        through = (out < -BEHIND * length) & (back < -BEHIND * length)
        beside = (length < NEIGHBOURS * self.radius[j]) & (np.einsum("pi,pi->p", N[i], N[j]) > OPPOSED)
        may[may] = ~(through | beside)
        return may

    def near(self, places: Array, reach: float = 1.0) -> tuple[Numbers, Numbers]:
        """Pairs that may press on each other and are nearer than ``reach`` radii, each both ways, sorted by the first.

        Args:
            places: Of the samples, shape (s, d).
            reach: In radii of the second sample's kernel.
        """
        both = cKDTree(places).query_pairs(reach * float(self.radius.max()), output_type="ndarray").astype(np.int64)
        i, j = np.concatenate([both, both[:, ::-1]]).T
        close = np.linalg.norm(places[i] - places[j], axis=1) < reach * self.radius[j]
        i, j = i[close], j[close]
        may = self.allowed(i, j)
        i, j = i[may], j[may]
        order = np.lexsort((j, i))
        return i[order], j[order]
