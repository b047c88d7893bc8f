"""The surface of a device in small triangles: the modelled slice once, and the images of it that make the whole.

Nothing is known of the mesh's roles: what bounds the slice on a symmetry plane is a cut; the largest of the connected rest
is the outside, and the others are the walls of cavities. Made once for a mesh; a state only moves its vertices.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

from geometries import Actuator
from geometries.joined import joined
from geometries.symmetry import reflected
from softmodels.results.triangles import Array, Cells, border, outer_faces

SHARP = 40.0
"""Angle in degrees from which on a bend of the surface is an edge."""
SECTOR = 6.0
"""Angle in degrees of the wedge that an axisymmetric section is drawn as; divides the circle."""
CUT, OUTSIDE = -1, 0
"""What a triangle belongs to, beside 1, 2, ... for the walls of cavities."""
QUARTERS = np.array([(0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)])
"""A six-node triangle as four flat ones."""


@dataclasses.dataclass(frozen=True)
class Skin:
    """Surface of a slice.

    Attributes:
        nodes: Grid node of each vertex, shape (v,); nodes on sharp edges have several vertices.
        turned: Vertices that are turned by `SECTOR` around z after they have moved, shape (v,).
        triangles: Vertices, outwards from the silicone by the right hand, shape (t, 3).
        part: What each triangle belongs to, shape (t,).
        edges: Vertices along sharp edges, shape (e, 2).
        rims: Vertices along the edges of the cuts, shape (r, 2).
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
        """How many cavities were found."""
        return int(self.part.max(initial=0))

    def points(self, nodal: Array) -> Array:
        """Vectors at the vertices, shape (v, 3), from vectors at the nodes, shape (n, 3)."""
        found = nodal[self.nodes]
        found[self.turned] = found[self.turned] @ turn(SECTOR).T
        return found

    def normals(self, points: Array) -> Array:
        """Unit normals at the vertices of a state, shapes (v, 3); smooth over symmetry planes too."""
        a, b, c = (points[self.triangles[:, k]] for k in range(3))
        faces = np.cross(b - a, c - a)
        corners = self.triangles.T.ravel()
        found = np.column_stack([np.bincount(corners, np.tile(faces[:, i], 3), len(points)) for i in range(3)])
        which = 2 ** np.arange(len(self.planes)) @ self.on_plane
        for these in np.unique(which[which > 0]):  # an edge between two planes that are not square lies in both at once
            here = which == these
            across = self.planes[self.on_plane[:, np.argmax(here)]]
            found[here] -= found[here] @ np.linalg.pinv(across) @ across
        return found / np.maximum(np.linalg.norm(found, axis=1), 1e-300)[:, None]

    def device(self, vectors: Array, kept: npt.NDArray[np.intp] | None = None) -> Array:
        """Vectors at the vertices of the images, one image after the other: (v, 3) to (m v, 3)."""
        images = self.images if kept is None else self.images[kept]
        return np.einsum("mij,vj->mvi", images, vectors).reshape(-1, 3)

    def device_triangles(
        self, chosen: npt.NDArray[np.bool_] | None = None, kept: npt.NDArray[np.intp] | None = None
    ) -> Cells:
        """Triangles over the vertices of `device`; those of mirrored images turned over, so that all point outwards."""
        images = self.images if kept is None else self.images[kept]
        triangles = self.triangles if chosen is None else self.triangles[chosen]
        mirrored = np.linalg.det(images) < 0
        sides = np.where(mirrored[:, None, None], triangles[:, ::-1], triangles)
        return (sides + len(self.nodes) * np.arange(len(images))[:, None, None]).reshape(-1, 3)

    def device_lines(self, lines: Cells, kept: npt.NDArray[np.intp] | None = None) -> Cells:
        """Lines, shape (e, 2), over the vertices of `device`."""
        count = len(self.images if kept is None else kept)
        return (lines + len(self.nodes) * np.arange(count)[:, None, None]).reshape(-1, 2)


def turn(degrees: float) -> Array:
    """Matrix of a turn around z."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def skin_of(points: Array, cells: Cells, cell_name: str, actuator: Actuator) -> Skin:
    """The surface of a mesh.

    Args:
        points: Undeformed nodes in device coordinates, m, shape (n, 3).
        cells: Node numbers in VTK's order, shape (c, 10), or (c, 6) of an axisymmetric section.
        cell_name: XDMF's name of the cells.
        actuator: The device, for its symmetry.
    """
    near_zero = 1e-7 * actuator.size
    if cell_name.startswith("Tri"):
        planes = np.array([(0.0, -1.0, 0.0), turn(SECTOR) @ (0.0, 1.0, 0.0)])
        shell, part, cut = _swept(points, cells)
        count = round(360.0 / SECTOR)
    else:
        planes = np.array([plane.normal for plane in actuator.cut_planes]).reshape(-1, 3)
        faces = outer_faces(cells, cell_name)
        near = np.abs(points[faces] @ planes.T) < near_zero
        sliced = near.all(axis=1).any(axis=1)
        whole = faces[~sliced]
        part = np.repeat(_parts(points, whole[:, :3]), len(QUARTERS))
        shell, cut = (found[:, QUARTERS].reshape(-1, 3) for found in (whole, faces[sliced]))
        count = actuator.copies
    both = np.concatenate([points, points @ turn(SECTOR).T])  # the numbers that `_swept` counts with
    nodes, triangles, edges = _creased(both, shell)
    cut_nodes, cut_triangles, rims = _creased(both, cut, border_only=True)
    every = np.concatenate([nodes, cut_nodes])
    on_plane = np.abs(planes @ both[every].T) < near_zero
    on_plane[:, len(nodes) :] = False
    return Skin(
        nodes=every % len(points),
        turned=every >= len(points),
        triangles=np.concatenate([triangles, cut_triangles + len(nodes)]),
        part=np.concatenate([part, np.full(len(cut), CUT)]),
        edges=edges,
        rims=rims + len(nodes),
        planes=planes,
        on_plane=on_plane,
        images=reflected(planes, count),
    )


def _parts(points: Array, corners: Cells) -> Cells:
    """`OUTSIDE` or the number of the cavity for each face, from what hangs together; shape (f, corners) to (f,)."""
    pairs = np.concatenate([corners[:, [0, k]] for k in range(1, corners.shape[1])])
    label = joined(pairs, len(points))[corners[:, 0]]
    names = np.unique(label)
    size = [np.linalg.norm(np.ptp(points[corners[label == name].ravel()], axis=0)) for name in names]
    numbers = {name: number for number, name in enumerate(names[np.argsort(size)[::-1]])}
    return np.array([numbers[name] for name in label], dtype=np.int64)


def _swept(points: Array, cells: Cells) -> tuple[Cells, Cells, Cells]:
    """Triangles of the wedge that a half section sweeps, what they belong to, and its two cuts.

    Node k of the section is k where the wedge begins and n + k where it ends.
    """
    cells = _turned_alike(points, cells)
    n, edges = len(points), border(cells)
    edges = edges[points[edges[:, :2], 0].max(axis=1) > 1e-9 * points[:, 0].max()]  # those on the axis sweep nothing
    part = np.repeat(_parts(points, edges[:, :2]), 4)
    # The silicone lies left of its border, y pointing away.
    begin, end = np.stack([edges[:, [0, 2]], edges[:, [2, 1]]], axis=1).reshape(-1, 2).T
    walls = np.stack([[begin, begin + n, end], [end, begin + n, end + n]], axis=0).transpose(2, 0, 1).reshape(-1, 3)
    shape = np.concatenate([points, points @ turn(SECTOR).T])[walls]
    area = np.linalg.norm(np.cross(shape[:, 1] - shape[:, 0], shape[:, 2] - shape[:, 0]), axis=1)
    solid = area > 1e-12 * points[:, 0].max() ** 2
    section = cells[:, QUARTERS].reshape(-1, 3)
    return walls[solid], part[solid], np.concatenate([section, section[:, ::-1] + n])


def _turned_alike(points: Array, cells: Cells) -> Cells:
    """The six-node triangles of a section, all in one sense: those of a part that is bonded on may be in the other."""
    a, b, c = points[cells[:, :3]].transpose(1, 0, 2)
    against = np.cross(b - a, c - a)[:, 1] > 0.0
    return np.where(against[:, None], cells[:, [0, 2, 1, 5, 4, 3]], cells)


def _creased(points: Array, triangles: Cells, border_only: bool = False) -> tuple[Cells, Cells, Cells]:
    """Vertices that are shared where the surface is smooth and doubled along its sharp edges.

    Args:
        points: Shape (n, 3).
        triangles: Nodes, shape (t, 3).
        border_only: Give the surface's border as its edges, in place of the sharp ones inside.

    Returns:
        The node of each vertex, shape (v,); the triangles' vertices, shape (t, 3); vertices along the edges, shape (e, 2).
    """
    if not len(triangles):
        return np.empty(0, dtype=np.int64), np.empty((0, 3), dtype=np.int64), np.empty((0, 2), dtype=np.int64)
    corner = np.arange(triangles.size).reshape(-1, 3)
    ends = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1).reshape(-1, 2)
    corners = np.stack([corner, np.roll(corner, -1, axis=1)], axis=-1).reshape(-1, 2)
    swapped = ends[:, 0] > ends[:, 1]
    ends[swapped], corners[swapped] = ends[swapped, ::-1], corners[swapped, ::-1]
    order = np.lexsort(ends.T)
    same = (ends[order[1:]] == ends[order[:-1]]).all(axis=1)
    one, other = order[:-1][same], order[1:][same]
    a, b, c = (points[triangles[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]
    smooth = (normals[one // 3] * normals[other // 3]).sum(axis=1) > np.cos(np.radians(SHARP))
    pairs = np.concatenate([np.column_stack([corners[one[smooth], k], corners[other[smooth], k]]) for k in (0, 1)])
    vertex = joined(pairs, triangles.size)
    nodes = np.empty(vertex.max() + 1, dtype=np.int64)
    nodes[vertex] = triangles.ravel()
    alone = np.ones(len(ends), dtype=bool)
    alone[one] = alone[other] = False
    lines = corners[alone] if border_only else corners[one[~smooth]]
    return nodes, vertex[corner], vertex[lines].reshape(-1, 2)
