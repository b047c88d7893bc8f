"""Do walls that face each other across air meet? Where a case does not resist it, they pass through each other.

Walls that a case names in [walls] press on each other and on their images in the cut planes (`softmodels.mechanics.walls`):
they sink in by a little and do not pass, so that they are left out here.

Two facets of the surface face each other if air lies between them at rest and their normals are opposed. They have met once
one lies behind the other; a wall has met its mirror image once it lies behind the cut plane. Facets of one thin wall are
opposed too, but have silicone between them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from softmodels.results.triangles import EDGES, FACES, Array, Cells

OPPOSED = -0.3
"""Largest product of the normals of facets that face each other."""

BESIDE = 0.7
"""Largest distance along the wall, in sizes of the facets, of two that lie opposite each other."""

THROUGH = 5e-3
"""How far through a cut plane a wall has to be, in sizes of the mesh; walls that a plane stops sink in by less."""


class Walls:
    """The surface of a mesh but for its cut planes.

    Args:
        points: Nodes in m, shape (n, 3); of a section, radius and height in the first and last column.
        cells: Second-order triangles or tetrahedra, shape (c, 6) or (c, 10).
        cell_name: ``"Triangle_6"`` or ``"Tetrahedron_10"``.
        planes: Unit normals of the cut planes, which pass through the origin, shape (3,) each.
        resisted: Walls that press on each other, a set each: middles of their facets' corners at rest in m, shape (k, 3).
    """

    def __init__(
        self,
        points: Array,
        cells: Cells,
        cell_name: str,
        planes: Sequence[npt.ArrayLike] = (),
        resisted: Sequence[Array] = (),
    ):
        self.points, self.flat = points, cell_name == "Triangle_6"
        parts = EDGES[:, :2] if self.flat else np.array(FACES[cell_name])[:, :3]
        facets = cells[:, parts].reshape(-1, parts.shape[1])
        owner = np.repeat(np.arange(len(cells)), len(parts))
        _, first, count = np.unique(np.sort(facets, axis=1), axis=0, return_index=True, return_counts=True)
        facets, owner = facets[first[count == 1]], owner[first[count == 1]]
        size = self.size = float(np.ptp(points, axis=0).max())
        self.planes = [np.asarray(normal, dtype=float) for normal in planes]
        cut = np.zeros(len(facets), dtype=bool)
        for plane in self.planes:
            cut |= (np.abs(points[facets] @ plane) < 1e-7 * size).all(axis=1)
        if self.flat:
            cut |= (np.abs(points[facets][..., 0]) < 1e-7 * size).all(axis=1)
        self.facets = facets[~cut]
        inside = points[cells[owner[~cut], : 3 if self.flat else 4]].mean(axis=1)
        self.turn = np.ones(len(self.facets))
        middle, normal, _ = self._measured(points)
        self.turn = np.where(np.einsum("fi,fi->f", middle - inside, normal) > 0.0, 1.0, -1.0)
        self.rest = self._measured(points)
        near = [_at(middles, self.rest[0], 1e-7 * size) for middles in resisted]
        self.resisted = np.array(near, dtype=bool).reshape(len(near), len(self.facets))

    def _measured(self, at: Array) -> tuple[Array, Array, Array]:
        """Middles (f, 3), outward unit normals (f, 3) and sizes (f,) of the facets of a shape."""
        corners = at[self.facets]
        along = corners[:, 1] - corners[:, 0]
        if self.flat:
            across = np.column_stack([along[:, 2], np.zeros(len(along)), -along[:, 0]])
            size = np.linalg.norm(across, axis=1)
        else:
            across = np.cross(along, corners[:, 2] - corners[:, 0])
            size = np.sqrt(np.linalg.norm(across, axis=1))
        length = np.maximum(np.linalg.norm(across, axis=1), 1e-300)
        return corners.mean(axis=1), across / length[:, None] * self.turn[:, None], size

    def met(self, displacement: Array) -> Array | None:
        """Where in m, deformed, walls that nothing stops have passed through each other deepest, shape (3,); None if nowhere.

        Args:
            displacement: Of the nodes in m, shape (n, 3).
        """
        middle, normal, size = self._measured(self.points + displacement)
        free = ~self.resisted.any(axis=0)
        for plane in self.planes:
            beyond = np.where(free, middle @ plane, -np.inf)
            if beyond.max(initial=-np.inf) > THROUGH * self.size:
                return np.asarray(middle[int(np.argmax(beyond))])
        reach = 1.2 * float(np.percentile(size, 75))
        i, j = _near(middle, reach)
        near = np.einsum("pi,pi->p", normal[i], normal[j]) < OPPOSED
        near &= ~(self.resisted[:, i] & self.resisted[:, j]).any(axis=0)
        i, j = i[near], j[near]
        X, N, _ = self.rest
        air = (np.einsum("pi,pi->p", X[j] - X[i], N[i]) > 0.0) & (np.einsum("pi,pi->p", X[i] - X[j], N[j]) > 0.0)
        i, j = i[air], j[air]
        between = normal[i] - normal[j]
        between /= np.linalg.norm(between, axis=1)[:, None]
        way = middle[j] - middle[i]
        gap = np.einsum("pi,pi->p", way, between)
        aside = np.linalg.norm(way - gap[:, None] * between, axis=1)
        depth = np.where(aside < BESIDE * (size[i] + size[j]) / 2.0, -gap, -np.inf)
        if not len(depth) or depth.max() < 0.0:
            return None
        deepest = int(np.argmax(depth))
        return np.asarray((middle[i[deepest]] + middle[j[deepest]]) / 2.0)


def _at(places: Array, others: Array, reach: float) -> npt.NDArray[np.bool_]:
    """Which of the others, shape (n, 3), are not farther than ``reach`` from any of some places, shape (m, 3)."""
    import scipy

    return np.asarray(scipy.spatial.cKDTree(places).query(others)[0] < reach)


def _near(places: Array, reach: float) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Pairs of places, shape (n, 3), that are not farther apart than ``reach``, each pair once.

    Places are sorted into boxes as wide as the reach, and looked for in a box and in half of those around it. SciPy's tree does
    the same, but takes longer to load than a wedge's path needs for a state.
    """
    box = np.floor((places - places.min(axis=0)) / reach).astype(np.int64) + 1
    strides = np.append(np.cumprod((box.max(axis=0) + 2)[:0:-1])[::-1], 1)
    key = box @ strides
    order = np.argsort(key, kind="stable")
    ordered = key[order]
    around = np.stack(np.meshgrid(*[(-1, 0, 1)] * 3, indexing="ij"), axis=-1).reshape(-1, 3) @ strides
    pairs = []
    for step in np.unique(around[around >= 0]):
        first, last = (np.searchsorted(ordered, ordered + step, side=side) for side in ("left", "right"))
        first = np.arange(1, len(key) + 1) if step == 0 else first
        count = last - first
        i = np.repeat(np.arange(len(key)), count)
        j = np.arange(len(i)) - np.repeat(np.cumsum(count) - count - first, count)
        i, j = order[i], order[j]
        near = ((places[i] - places[j]) ** 2).sum(axis=1) <= reach**2
        pairs.append((i[near], j[near]))
    i, j = (np.concatenate(side) for side in zip(*pairs, strict=True))
    return i, j
