"""Surfaces, sections and curves of the second-order grid, to draw and to measure."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
import numpy.typing as npt

from geometries import Actuator
from geometries.actuator import joined, reflected
from softmodels.common.arrays import Array
from softmodels.common.lazy import scipy

# ----------------------------------------------------------------------------------------------------------------------
# The surface of a device in small triangles: the modelled slice and its mirror images.
#
# The mesh's roles are not used: boundary on a symmetry plane is a cut; the largest connected remainder
# is the outside, the others are cavity walls. It is made once per mesh; a state only moves its vertices.


SECTOR_DEGREES = 6.0
"""Angle in degrees of the wedge that an axisymmetric section is drawn as; divides the circle."""


@dataclasses.dataclass(frozen=True)
class Surface:
    """Surface of a slice.

    Attributes:
        nodes: Grid node of each vertex, shape (v,); nodes on sharp edges have several vertices.
        turned: Vertices that are turned by `SECTOR_DEGREES` around z after they have moved, shape (v,).
        triangles, part: Vertices, outwards by the right hand, shape (t, 3), and what each belongs to, shape (t,).
        edges, rims: Vertices along sharp edges, shape (e, 2), and along the edges of the cuts, shape (r, 2).
        planes: Unit normals of the slice's symmetry planes, shape (k, 3).
        on_plane: Vertices that lie in each plane and are not of a cut, shape (k, v).
        images: Matrices that take the slice to its places in the device, shape (m, 3, 3); the first is the identity.
    """

    nodes: Cells
    turned: npt.NDArray[np.bool_]
    triangles: Cells
    part: Cells
    edges: Cells
    rims: Cells
    planes: Array
    on_plane: npt.NDArray[np.bool_]
    images: Array

    @property
    def cavities(self) -> int:
        """Number of cavities."""
        return int(self.part.max(initial=0))

    def points(self, nodal: Array) -> Array:
        """Return the vectors at the vertices, shape (v, 3), from vectors at the nodes, shape (n, 3)."""
        points = nodal[self.nodes]
        points[self.turned] = points[self.turned] @ turn(SECTOR_DEGREES).T
        return points

    def normals(self, points: Array) -> Array:
        """Return the unit normals at the vertices of a state, shapes (v, 3); smooth over symmetry planes too."""
        a, b, c = (points[self.triangles[:, k]] for k in range(3))
        faces = np.cross(b - a, c - a)
        corners = self.triangles.T.ravel()
        normals = np.column_stack([np.bincount(corners, np.tile(faces[:, i], 3), len(points)) for i in range(3)])
        which = 2 ** np.arange(len(self.planes)) @ self.on_plane
        for these in np.unique(which[which > 0]):  # an edge between two planes that are not perpendicular lies in both
            here = which == these
            across = self.planes[self.on_plane[:, np.argmax(here)]]
            normals[here] -= normals[here] @ np.linalg.pinv(across) @ across
        return normals / np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]

    def device(self, vectors: Array, kept: npt.NDArray[np.intp] | None = None) -> Array:
        """Return the vectors at the vertices of the images, one image after the other: (v, 3) to (m v, 3)."""
        images = self.images if kept is None else self.images[kept]
        return np.einsum("mij,vj->mvi", images, vectors).reshape(-1, 3)

    def device_triangles(self, chosen: npt.NDArray[np.bool_] | None = None, kept: npt.NDArray[np.intp] | None = None) -> Cells:
        """Return the triangles over the vertices of `device`; those of mirrored images turned over, so that all point
        outwards."""
        images = self.images if kept is None else self.images[kept]
        triangles = self.triangles if chosen is None else self.triangles[chosen]
        mirrored = np.linalg.det(images) < 0
        sides = np.where(mirrored[:, None, None], triangles[:, ::-1], triangles)
        return (sides + len(self.nodes) * np.arange(len(images))[:, None, None]).reshape(-1, 3)

    def device_lines(self, lines: Cells, kept: npt.NDArray[np.intp] | None = None) -> Cells:
        """Return the lines, shape (e, 2), over the vertices of `device`."""
        count = len(self.images if kept is None else kept)
        return (lines + len(self.nodes) * np.arange(count)[:, None, None]).reshape(-1, 2)


MIN_EDGE_DEGREES = 40.0
"""Dihedral angle in degrees above which a bend of the surface is an edge."""
CUT_LABEL, OUTSIDE_LABEL = -1, 0
"""Labels of triangles, besides 1, 2, ... for cavity walls."""
QUARTERS = np.array([(0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)])
"""A six-node triangle as four flat ones."""


def turn(degrees: float) -> Array:
    """Return the matrix of a turn around z."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def surface_of(points: Array, cells: Cells, cell_name: str, actuator: Actuator) -> Surface:
    """Return the surface of a device's mesh, cut by its symmetry, from undeformed nodes in device coordinates, m, shape (n,
    3), and cells in VTK's order, shape (c, 10), or (c, 6) of an axisymmetric section."""
    near_zero = 1e-7 * actuator.size
    if cell_name.startswith("Tri"):
        planes = np.array([(0.0, -1.0, 0.0), turn(SECTOR_DEGREES) @ (0.0, 1.0, 0.0)])
        shell, part, cut = _swept(points, cells)
        count = round(360.0 / SECTOR_DEGREES)
    else:
        planes = np.array([plane.normal for plane in actuator.cut_planes]).reshape(-1, 3)
        faces = outer_faces(cells, cell_name)
        near = np.abs(points[faces] @ planes.T) < near_zero
        sliced = near.all(axis=1).any(axis=1)
        whole = faces[~sliced]
        part = np.repeat(_parts(points, whole[:, :3], cells), len(QUARTERS))
        shell, cut = (facets[:, QUARTERS].reshape(-1, 3) for facets in (whole, faces[sliced]))
        count = actuator.copies
    both = np.concatenate([points, points @ turn(SECTOR_DEGREES).T])  # the numbering that `_swept` uses
    nodes, triangles, edges = _creased(both, shell)
    cut_nodes, cut_triangles, rims = _creased(both, cut, border_only=True)
    every = np.concatenate([nodes, cut_nodes])
    on_plane = np.abs(planes @ both[every].T) < near_zero
    on_plane[:, len(nodes) :] = False
    return Surface(
        nodes=every % len(points),
        turned=every >= len(points),
        triangles=np.concatenate([triangles, cut_triangles + len(nodes)]),
        part=np.concatenate([part, np.full(len(cut), CUT_LABEL)]),
        edges=edges,
        rims=rims + len(nodes),
        planes=planes,
        on_plane=on_plane,
        images=reflected(planes, count),
    )


def _parts(points: Array, corners: Cells, cells: Cells) -> Cells:
    """Return `OUTSIDE_LABEL` or the number of the cavity for each face, by connectivity; shape (f, corners) to (f,). The
    largest piece of each body is its outside."""
    label, body = (
        joined(np.concatenate([nodes[:, [0, k]] for k in range(1, nodes.shape[1])]), len(points))[corners[:, 0]]
        for nodes in (corners, cells)
    )
    names, first = np.unique(label, return_index=True)
    size = [np.linalg.norm(np.ptp(points[corners[label == name].ravel()], axis=0)) for name in names]
    numbers, bodies = dict[int, int](), set[int]()
    for k in np.argsort(size)[::-1]:
        inner = int(body[first[k]]) in bodies
        bodies.add(int(body[first[k]]))
        numbers[int(names[k])] = 1 + max(numbers.values(), default=OUTSIDE_LABEL) if inner else OUTSIDE_LABEL
    return np.array([numbers[int(name)] for name in label], dtype=np.int64)


def _swept(points: Array, cells: Cells) -> tuple[Cells, Cells, Cells]:
    """Return the triangles of the wedge that a half section sweeps, what they belong to, and its two cuts.

    Node k of the section is k where the wedge begins and n + k where it ends.
    """
    cells = _turned_alike(points, cells)
    n, edges = len(points), border(cells)
    edges = edges[points[edges[:, :2], 0].max(axis=1) > 1e-9 * points[:, 0].max()]  # edges on the axis sweep no area
    part = np.repeat(_parts(points, edges[:, :2], cells), 4)
    # The silicone lies left of its border, y pointing away.
    begin, end = np.stack([edges[:, [0, 2]], edges[:, [2, 1]]], axis=1).reshape(-1, 2).T
    walls = np.stack([[begin, begin + n, end], [end, begin + n, end + n]], axis=0).transpose(2, 0, 1).reshape(-1, 3)
    shape = np.concatenate([points, points @ turn(SECTOR_DEGREES).T])[walls]
    area = np.linalg.norm(np.cross(shape[:, 1] - shape[:, 0], shape[:, 2] - shape[:, 0]), axis=1)
    solid = area > 1e-12 * points[:, 0].max() ** 2
    section = cells[:, QUARTERS].reshape(-1, 3)
    return walls[solid], part[solid], np.concatenate([section, section[:, ::-1] + n])


def _turned_alike(points: Array, cells: Cells) -> Cells:
    """Return the six-node triangles of a section, all in one sense: those of a part that is bonded on may be in the other."""
    a, b, c = points[cells[:, :3]].transpose(1, 0, 2)
    against = np.cross(b - a, c - a)[:, 1] > 0.0
    return np.where(against[:, None], cells[:, [0, 2, 1, 5, 4, 3]], cells)


def _creased(points: Array, triangles: Cells, border_only: bool = False) -> tuple[Cells, Cells, Cells]:
    """Return the surface's vertices, shared where it is smooth and doubled along its sharp edges: the node of each, shape
    (v,), the triangles', shape (t, 3), and those along the edges, shape (e, 2): the sharp ones inside, or only the border."""
    if not len(triangles):
        return np.empty(0, dtype=np.int64), np.empty((0, 3), dtype=np.int64), np.empty((0, 2), dtype=np.int64)
    corner = np.arange(triangles.size).reshape(-1, 3)
    ends = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1).reshape(-1, 2)
    corners = np.stack([corner, np.roll(corner, -1, axis=1)], axis=-1).reshape(-1, 2)
    swapped = ends[:, 0] > ends[:, 1]
    ends[swapped], corners[swapped] = ends[swapped, ::-1], corners[swapped, ::-1]
    order = np.lexsort(ends.T)
    same = (ends[order[1:]] == ends[order[:-1]]).all(axis=1)
    edge, other = order[:-1][same], order[1:][same]
    a, b, c = (points[triangles[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]
    smooth = (normals[edge // 3] * normals[other // 3]).sum(axis=1) > np.cos(np.radians(MIN_EDGE_DEGREES))
    pairs = np.concatenate([np.column_stack([corners[edge[smooth], k], corners[other[smooth], k]]) for k in (0, 1)])
    vertex = joined(pairs, triangles.size)
    nodes = np.empty(vertex.max() + 1, dtype=np.int64)
    nodes[vertex] = triangles.ravel()
    alone = np.ones(len(ends), dtype=bool)
    alone[edge] = alone[other] = False
    lines = corners[alone] if border_only else corners[edge[~smooth]]
    return nodes, vertex[corner], vertex[lines].reshape(-1, 2)


# ----------------------------------------------------------------------------------------------------------------------
# Split second-order triangles and tetrahedron faces into curves and small flat triangles to draw.


Cells = npt.NDArray[np.int64]

EDGES = np.array([(0, 1, 3), (1, 2, 4), (2, 0, 5)])
"""Edges of a six-node triangle: both ends and the node between them."""

FACES = {
    "Triangle_6": ((0, 1, 2, 3, 4, 5),),
    "Tetrahedron_10": ((0, 1, 3, 4, 8, 7), (1, 2, 3, 5, 9, 8), (2, 0, 3, 6, 7, 9), (0, 2, 1, 6, 5, 4)),
}
"""Faces of a cell, in VTK's order of nodes, as triangles of six nodes."""


def outer_faces(cells: Cells, cell_name: str) -> Cells:
    """Return the faces that belong to a single cell, shape (f, 6); of a flat mesh, all its triangles."""
    faces = cells[:, np.array(FACES[cell_name])].reshape(-1, 6)
    _, first, count = np.unique(np.sort(faces[:, :3], axis=1), axis=0, return_index=True, return_counts=True)
    return faces[np.sort(first[count == 1])]


def edge_curves(points: Array, faces: Cells, parts: int = 8) -> Array:
    """Return the curves along the edges of six-node triangles, each once, in straight pieces, shape (edges, parts + 1, d);
    points have shape (n, d), faces (f, 6)."""
    edges = faces[:, EDGES].reshape(-1, 3)
    edges = edges[np.unique(edges[:, 2], return_index=True)[1]]
    return parabolas(points[edges], parts)


def parabolas(nodes: Array, parts: int) -> Array:
    """Return the parabolas through (begin, end, middle) nodes, shape (n, 3, d) to (n, parts + 1, d)."""
    s = np.linspace(0.0, 1.0, parts + 1)
    weights = np.column_stack([(1 - s) * (1 - 2 * s), s * (2 * s - 1), 4 * s * (1 - s)])
    return np.einsum("sk,nkd->nsd", weights, nodes)


def small_triangles(parts: int) -> tuple[Array, Cells]:
    """Return the subdivision of a six-node triangle into small flat ones: weights of the six nodes at their corners, shape (m,
    6), and the triangles, shape (parts^2, 3)."""
    places = [(i, j) for j in range(parts + 1) for i in range(parts + 1 - j)]
    number_of = {place: n for n, place in enumerate(places)}
    r, s = np.array(places).T / parts
    t = 1 - r - s
    weights = np.column_stack([t * (2 * t - 1), r * (2 * r - 1), s * (2 * s - 1), 4 * t * r, 4 * r * s, 4 * s * t])
    small = [[number_of[i, j], number_of[i + 1, j], number_of[i, j + 1]] for i, j in places if i + j < parts]
    small += [[number_of[i, j], number_of[i - 1, j], number_of[i, j - 1]] for i, j in places if i > 0 and j > 0]
    return weights, np.array(small)


def fine_triangles(values: Array, faces: Cells, parts: int = 4) -> tuple[Array, Cells]:
    """Return six-node triangles, shape (f, 6), as small flat ones: nodal values, such as points, at their corners, shape (m,
    k), and the triangles, shape (f parts^2, 3)."""
    weights, small = small_triangles(parts)
    fine = np.einsum("pk,fkd->fpd", weights, values[faces]).reshape(-1, values.shape[1])
    return fine, (np.arange(len(faces))[:, None, None] * len(weights) + small).reshape(-1, 3)


def outline(points: Array, cells: Cells) -> Array:
    """Return the curves along the edges that belong to a single triangle, shape (n, d) to (edges, 9, d)."""
    return parabolas(points[border(cells)], 8)


def border(cells: Cells) -> Cells:
    """Return the edges that belong to a single triangle, turned as in it: begin, end and middle nodes, shape (edges, 3)."""
    edges = cells[:, EDGES].reshape(-1, 3)
    _, first, count = np.unique(edges[:, 2], return_index=True, return_counts=True)
    return edges[first[count == 1]]


# ----------------------------------------------------------------------------------------------------------------------
# Signed distance of points from a curve of quadratic pieces, as on the edges of second-order elements.
#
# The closest point of a piece is found by Newton's method on the piece itself, so that the distance is that of the curve and
# not of a polygon. Its derivative needs no derivative of the closest point: the distance moves with the curve along the line
# between the two (envelope theorem).


Indices = npt.NDArray[np.int64]

SAMPLES_PER_PIECE = 9  # samples per piece from which the closest point is searched
PIECES_TRIED = 8  # samples whose pieces are tried for each point
MAX_ITERATIONS = 30


@dataclasses.dataclass(frozen=True, eq=False)
class Closest:
    """For each of k points its closest one on the curve: the distance, positive on the left of the curve's direction, the
    piece, the shape functions of its three nodes there, shape (k, 3), and the unit vector along which the distance grows,
    shape (k, 2)."""

    distance: Array
    piece: Indices
    weights: Array
    normal: Array

    def moved(self, rate: Array) -> Array:
        """Return the derivative of the distance, shape (k,), as the curve's nodes move at a rate, shape (n, 3, 2)."""
        return -np.einsum("ka,kai,ki->k", self.weights, rate[self.piece], self.normal)


@dataclasses.dataclass(frozen=True, eq=False)
class QuadraticCurve:
    """Pieces in order, each from its first node to its second, over its third at the middle of the parameter; shape (n, 3,
    2)."""

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
    def _samples(self) -> tuple[scipy.spatial.KDTree, Indices, Array]:
        s = np.linspace(-1.0, 1.0, SAMPLES_PER_PIECE)
        piece = np.repeat(np.arange(len(self.nodes)), SAMPLES_PER_PIECE)
        at = np.tile(s, len(self.nodes))
        return scipy.spatial.KDTree(self.at(piece, at)[0]), piece, at

    def closest(self, points: Array) -> Closest:
        """Return the closest point of the curve to each of the points, shape (k, 2)."""
        tree, pieces, places = self._samples
        points = np.asarray(points, dtype=float)
        _, near = tree.query(points, k=min(PIECES_TRIED, len(pieces)))
        near = near.reshape(len(points), -1)
        target, pieces, s = np.repeat(points, near.shape[1], axis=0), pieces[near].ravel(), places[near].ravel()
        left = np.arange(len(s))
        for _ in range(MAX_ITERATIONS):
            place, slope, bend = self.at(pieces[left], s[left])
            gap = place - target[left]
            square = (slope * slope).sum(-1)
            curvature = square + (gap * bend).sum(-1)
            # Without a minimum nearby, the step of a straight piece still leads towards it.
            step = -(gap * slope).sum(-1) / np.where(curvature > 0.1 * square, curvature, square)
            moved = np.clip(s[left] + step, -1.0, 1.0)
            moves = np.abs(moved - s[left]) >= 1e-15
            s[left] = moved
            left = left[moves]
            if not len(left):
                break
        place, slope, _ = self.at(pieces, s)
        best = np.argmin(((place - target) ** 2).sum(-1).reshape(near.shape), axis=1)
        pick = np.ravel_multi_index((np.arange(len(points)), best), near.shape)
        return self._signed(points, pieces[pick], s[pick], place[pick], slope[pick])

    def _signed(self, points: Array, piece: Indices, s: Array, place: Array, slope: Array) -> Closest:
        slope = slope / np.linalg.norm(slope, axis=1)[:, None]
        left = np.column_stack([-slope[:, 1], slope[:, 0]])
        gap = points - place
        inside = np.abs(s) < 1.0
        along = (gap * left).sum(-1)
        # At a joint the nearest line is not normal to the piece; use the side of both pieces' mean direction.
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
    """Return the shape functions of a piece's nodes at parameters s, shape (..., 3)."""
    s = np.asarray(s, dtype=float)
    return np.stack([s * (s - 1) / 2, s * (s + 1) / 2, 1 - s * s], axis=-1)
