"""Which samples of walls may press on each other, and which of these are near."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
import numpy.typing as npt

from softmodels.mechanics.walls.surface import Array, Numbers, Surface

REACH = 0.9
"""Radius of the kernel in edges of the facets: twice to three times the distance of samples at rest."""
OPPOSED = -0.2
"""Largest product of normals at rest of neighbours on one wall that may come to press on each other."""
NEIGHBOURS = 3.0
"""Distance at rest, in radii, up to which samples are neighbours on one wall."""
MOST_IMAGES = 100
"""Images of a slice that are taken; a wedge of 15 degrees has 24."""
SKIN = 0.4
"""How much farther than needed pairs are looked for, so that they serve for several shapes."""
FACING = 0.5
"""Sine of the angle under which a chord leaves walls that face each other, at least."""
BEHIND = 1e-6
"""Sine of the angle under which a chord has to enter the solid at both ends, to run through silicone."""


@dataclasses.dataclass(frozen=True, eq=False)
class Pairs:
    """The search for pairs: of samples that are points with samples of walls, of the walls' mirror images too.

    Sample j of image g has the number g s + j, where there are s samples.

    Attributes:
        surface: All walls.
        meets: Whether a wall may press on another, or on itself, shape (walls, walls), symmetric.
        images: Orthogonal matrices of the images, the identity first, shape (g, d, d).
    """

    surface: Surface
    meets: npt.NDArray[np.bool_]
    images: Array
    _found: tuple[Array, float, Numbers, Numbers] | None = dataclasses.field(default=None, init=False, repr=False)

    @functools.cached_property
    def radius(self) -> Array:
        """Radius of each sample's kernel, shape (s,): that of its own facet, but none smaller than the mean."""
        edges, measure = self.surface.edges, self.surface.measure
        return REACH * np.maximum(edges, float(edges @ measure / measure.sum()))

    def of_all(self, vectors: Array) -> Array:
        """Vectors of all samples of all images, shape (s, d) to (g s, d)."""
        return np.asarray(np.einsum("gij,sj->gsi", self.images, vectors).reshape(-1, vectors.shape[1]))

    @functools.cached_property
    def _rest(self) -> tuple[Array, Array]:
        """Places and unit normals at rest of all samples of all images, shape (g s, d) each."""
        places, areas = self.surface.rest
        return self.of_all(places), self.of_all(areas / np.linalg.norm(areas, axis=1)[:, None])

    def allowed(self, i: Numbers, j: Numbers) -> npt.NDArray[np.bool_]:
        """Whether samples i may press on samples j of any image.

        It depends on the undeformed shape alone, so that the energy is a function of the displacement. Left out are
        neighbours on one wall that do not face each other, and two sides of a wall, between which there is silicone.
        """
        owner, walls, count = self.surface.owner, self.surface.walls, len(self.surface.owner)
        may = self.meets[walls[owner[i]], walls[owner[j % count]]]
        i, j = i[may], j[may]
        X, N = self._rest
        chord = X[j] - X[i]
        length = np.linalg.norm(chord, axis=1)
        out, back = np.einsum("pi,pi->p", chord, N[i]), -np.einsum("pi,pi->p", chord, N[j])
        through = (out < -BEHIND * length) & (back < -BEHIND * length)
        close = length < NEIGHBOURS * self.radius[j % count]
        may[may] = ~(through | (close & (np.einsum("pi,pi->p", N[i], N[j]) > OPPOSED)))
        return may

    def within(self, places: Array, reach: float) -> tuple[Numbers, Numbers]:
        """Pairs that may press on each other and are nearer than ``reach``, sorted by the first; more may be among them.

        They are looked for a little farther, and again only once samples have moved by as much.

        Args:
            places: Of the samples, shape (s, d).
            reach: Distance.
        """
        if self._found is not None:
            before, far, i, j = self._found
            moved = float(np.sqrt(np.einsum("si,si->s", places - before, places - before).max(initial=0.0)))
            if reach + 2 * moved <= far:
                return i, j
        import scipy

        far = max(reach, float(self.radius.max())) * (1 + SKIN)
        found = scipy.spatial.cKDTree(places).sparse_distance_matrix(
            scipy.spatial.cKDTree(self.of_all(places)), far, output_type="ndarray"
        )
        i, j = found["i"].astype(np.int64), found["j"].astype(np.int64)
        may = self.allowed(i, j)
        i, j = i[may], j[may]
        order = np.lexsort((j, i))
        i, j = i[order], j[order]
        object.__setattr__(self, "_found", (places.copy(), far, i, j))
        return i, j

    def near(self, places: Array) -> tuple[Numbers, Numbers]:
        """Pairs that may press on each other and are nearer than the second one's radius, sorted by the first.

        Args:
            places: Of the samples, shape (s, d).
        """
        i, j = self.within(places, float(self.radius.max()))
        way = places[i] - self.of_all(places)[j]
        close = np.einsum("pi,pi->p", way, way) < self.radius[j % len(places)] ** 2
        return i[close], j[close]


def facing(surface: Surface, images: Array, reach: float) -> npt.NDArray[np.bool_]:
    """Which facets at rest face another one, or an image of one, across air, shape (f,).

    Args:
        surface: The walls.
        images: Orthogonal matrices of the images, the identity first, shape (g, d, d).
        reach: Largest distance between their middles.
    """
    import scipy

    count, d = len(surface.facets), surface.dimension
    places, areas = (values.reshape(count, -1, d) for values in surface.rest)
    middle, normal = places.mean(axis=1), areas.sum(axis=1)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    others, across = (np.einsum("gij,fj->gfi", images, one).reshape(-1, d) for one in (middle, normal))
    found = scipy.spatial.cKDTree(middle).sparse_distance_matrix(
        scipy.spatial.cKDTree(others), reach, output_type="ndarray"
    )
    i, j = found["i"], found["j"]
    chord = others[j] - middle[i]
    least = FACING * np.linalg.norm(chord, axis=1)
    faces = np.einsum("pi,pi->p", chord, normal[i]) > least
    faces &= np.einsum("pi,pi->p", chord, across[j]) < -least
    faces &= np.einsum("pi,pi->p", normal[i], across[j]) < OPPOSED
    mask = np.zeros(count, dtype=np.bool_)
    mask[i[faces]] = True
    mask[j[faces] % count] = True
    return mask
