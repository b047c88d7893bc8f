"""A device's mesh file as arrays, for programs that are not DOLFINx: nodes, cells by region, faces and nodes by role."""

from __future__ import annotations

import dataclasses
import functools
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from geometries import actuator, meshing
from softmodels.common.arrays import Array
from softmodels.common.errors import GeometryError, MeshFileError
from softmodels.common.lazy import gmsh

if TYPE_CHECKING:
    from manifold3d import Manifold


@dataclasses.dataclass(frozen=True, eq=False)
class MeshArrays:
    """A mesh, whose nodes and cells count from 0: nodes in m, shape (n, 3); nodes of the tetrahedra in the order of VTK and
    Abaqus, shape (m, 4) or (m, 10); cells by region, some perhaps in several; of each role on faces the cell behind each and
    which of its `SIDES` it is, shape (k, 2); nodes by role, of faces, lines and points."""

    points: NDArray[np.float64]
    cells: Ints
    regions: Mapping[str, Ints]
    faces: Mapping[str, Ints]
    nodes: Mapping[str, Ints]

    def parted(self, first: Sequence[str]) -> MeshArrays:
        """Return the mesh with each cell in only one region: the first ones keep all of theirs."""
        left, regions = np.ones(len(self.cells), dtype=bool), dict[str, Ints]()
        for name in sorted(self.regions, key=lambda name: name not in first):
            regions[name] = self.regions[name][left[self.regions[name]]]
            left[regions[name]] = False
        kept = {name: regions[name] for name in self.regions if len(regions[name])}
        return dataclasses.replace(self, regions=kept)

    def triangles(self, role: str) -> Ints:
        """Return the nodes of a role's faces, normals out of the solid, shape (k, 3) or (k, 6)."""
        cell, side = self.faces[role].T
        order = SIDES if self.cells.shape[1] == 4 else np.hstack([SIDES, MIDDLES])
        return np.asarray(np.take_along_axis(self.cells[cell], order[side], axis=1))


NODES_OF_GMSH_TYPE = {4: 4, 11: 10}
"""Gmsh's tetrahedra of first and second order, with their number of nodes."""


def read_arrays(path: Path) -> MeshArrays:
    """Read the Gmsh file that `Actuator.write` made of a solid device; FileNotFoundError or MeshFileError if it is none."""
    with meshing.private_model():
        groups = meshing.load_mesh(path, 3)
        tags, places, _ = gmsh.model.mesh.getNodes()
        number = np.full(int(tags.max()) + 1, -1)
        number[tags.astype(int)] = np.arange(len(tags))
        parts = {tag: number[_cells_of(tag)] for dimension, tag, _ in groups if dimension == 3}
        if not parts or len({part.shape[1] for part in parts.values()}) > 1:
            raise MeshFileError(f"{path} is not a mesh of tetrahedra of one kind")
        starts = dict(zip(parts, np.cumsum([0, *map(len, parts.values())]).tolist(), strict=False))
        regions, nodes, corners = (defaultdict[str, list[Ints]](list) for _ in range(3))
        for dimension, tag, name in groups:
            if dimension == 3:
                regions[name].append(starts[tag] + np.arange(len(parts[tag])))
            else:
                nodes[name].append(number[gmsh.model.mesh.getNodesForPhysicalGroup(dimension, tag)[0].astype(int)])
            if dimension == 2:
                corners[name].append(number[_corners_of(tag)])
    whole, faces = np.concatenate(list(parts.values())), {name: np.concatenate(each) for name, each in corners.items()}
    return MeshArrays(
        places.reshape(-1, 3),
        whole,
        {name: np.concatenate(each) for name, each in regions.items()},
        _cells_and_sides(whole, faces),
        {name: each[0] if len(each) == 1 else np.unique(np.concatenate(each)) for name, each in nodes.items()},
    )


def _cells_of(group: int) -> Ints:
    """Node tags of a volume group's tetrahedra, in VTK's order."""
    parts = []
    for entity in gmsh.model.getEntitiesForPhysicalGroup(3, group):
        for kind, _, nodes in zip(*gmsh.model.mesh.getElements(3, entity), strict=True):
            width = NODES_OF_GMSH_TYPE.get(int(kind), 0)
            if not width:
                raise MeshFileError("the mesh has cells that are no tetrahedra")
            parts.append(nodes.astype(np.int64).reshape(-1, width)[:, TO_GMSH[:width]])
    return np.concatenate(parts)


def _corners_of(group: int) -> Ints:
    """Node tags of the corners of a surface group's triangles."""
    parts = [np.empty((0, 3), dtype=np.int64)]
    for entity in gmsh.model.getEntitiesForPhysicalGroup(2, group):
        for kind, _, nodes in zip(*gmsh.model.mesh.getElements(2, entity), strict=True):
            width = {2: 3, 9: 6}[int(kind)]
            parts.append(nodes.astype(np.int64).reshape(-1, width)[:, :3])
    return np.concatenate(parts)


def _cells_and_sides(cells: Ints, corners: Mapping[str, Ints]) -> dict[str, Ints]:
    """Return the cell and side of the faces of each role, by their corners."""
    sides = np.sort(cells[:, SIDES].reshape(-1, 3), axis=1)
    keys = {tuple(side): place for place, side in enumerate(sides.tolist())}
    cells_and_sides = {}
    for name, triangles in corners.items():
        places = np.array([keys[tuple(corner_triple)] for corner_triple in np.sort(triangles, axis=1).tolist()], dtype=np.int64)
        cells_and_sides[name] = np.column_stack([places // 4, places % 4])
    return cells_and_sides


# ----------------------------------------------------------------------------------------------------------------------
# A mesh of tetrahedra as arrays: its boundary, which faces are connected, what they enclose.


Ints = NDArray[np.int64]
Vector = tuple[float, float, float]

SIDES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
"""Corners of a tetrahedron's sides, turned so that their normals point outward."""
MIDDLES = np.array([[6, 5, 4], [4, 8, 7], [5, 9, 8], [7, 9, 6]])
"""Nodes inside the edges of those sides, in the order of VTK and Abaqus."""
MIRRORED_NODE_ORDER = np.array([1, 0, 2, 3, 4, 6, 5, 8, 7, 9])
"""The nodes of a tetrahedron whose first two corners are exchanged."""

TO_GMSH = np.array([0, 1, 2, 3, 4, 5, 6, 7, 9, 8])
"""Gmsh has the last two edges of a tetrahedron the other way round."""

_A, _B = 0.445948490915965, 0.091576213509771
RULE = np.array([[1 - 2 * _A, _A, _A], [_A, 1 - 2 * _A, _A], [_A, _A, 1 - 2 * _A],
                 [1 - 2 * _B, _B, _B], [_B, 1 - 2 * _B, _B], [_B, _B, 1 - 2 * _B]])  # fmt: skip
WEIGHTS = np.repeat([0.223381589678011, 0.109951743655322], 3)
"""Integration over a triangle, exact to degree 4. Dunavant 1985, doi 10.1002/nme.1620210612."""


@dataclasses.dataclass(frozen=True, eq=False)
class Tetrahedra:
    """A mesh: nodes in m, shape (n, 3); nodes of the cells in the order of VTK, shape (m, 4) or (m, 10), every one turned the
    right way; by names of the file the corners of the triangles of each face, shape (t, 3), or only its nodes, shape (t,), and
    cells of regions."""

    points: Array
    cells: Ints
    faces: Mapping[str, Ints]
    regions: Mapping[str, Ints]

    @classmethod
    def made(cls, points: Array, cells: Ints, faces: Mapping[str, Ints], regions: Mapping[str, Ints]) -> Tetrahedra:
        """Return a mesh without the nodes that no cell has, its cells turned the right way; GeometryError for a flat cell."""
        used, compact = np.unique(cells, return_inverse=True)
        width = int(cells.shape[1])
        number = np.full(len(points), -1)
        number[used] = np.arange(len(used))
        points, cells = points[used], compact.reshape(cells.shape)
        heights = _volumes(points, cells)
        if flat_cell(points, cells):
            x, y, z = 1e3 * points[cells[np.abs(heights).argmin()]].mean(axis=0)
            raise GeometryError(f"the mesh has a cell without volume near {x:.4g}, {y:.4g}, {z:.4g} mm")
        order = MIRRORED_NODE_ORDER[:width]
        cells = np.where(heights[:, None] < 0, cells[:, order], cells)
        kept = {}
        for name, nodes in faces.items():
            cells_read = number[nodes]
            kept[name] = cells_read[(cells_read >= 0).reshape(len(cells_read), -1).all(axis=1)]
        return cls(points, cells, kept, regions)

    @functools.cached_property
    def triangles(self) -> Ints:
        """Nodes of the boundary's triangles, normals outward, shape (k, 3) or (k, 6); GeometryError if more than two cells
        meet in one."""
        sides = self.cells[:, SIDES].reshape(-1, 3)
        _, first, count = np.unique(np.sort(sides, axis=1), axis=0, return_index=True, return_counts=True)
        if count.max() > 2:
            x, y, z = 1e3 * self.points[sides[first[count.argmax()]]].mean(axis=0)
            raise GeometryError(
                f"three cells or more share a triangle near {x:.4g}, {y:.4g}, {z:.4g} mm; the mesh overlaps itself"
            )
        outer = np.sort(first[count == 1])
        if self.cells.shape[1] == 4:
            return sides[outer]
        return np.hstack([sides[outer], self.cells[:, MIDDLES].reshape(-1, 3)[outer]])

    @property
    def surface(self) -> tuple[Array, Ints]:
        """Places in m, shape (n, 3), and corners of the boundary's triangles, shape (t, 3): four for one with curved edges."""
        nodes = self.triangles
        if nodes.shape[1] == 6:
            nodes = nodes[:, [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]]].reshape(-1, 3)
        used, triangles = np.unique(nodes, return_inverse=True)
        return self.points[used], triangles.reshape(-1, 3)

    @functools.cached_property
    def corners(self) -> Array:
        """Places of the boundary triangles' corners in m, shape (k, 3, 3)."""
        return self.points[self.triangles[:, :3]]

    @functools.cached_property
    def normals(self) -> Array:
        """Outward unit normals of the boundary triangles, shape (k, 3)."""
        a, b, c = np.moveaxis(self.corners, 1, 0)
        n = np.cross(b - a, c - a)
        return np.asarray(n / np.linalg.norm(n, axis=1)[:, None])

    @property
    def extent(self) -> float:
        """Diagonal of the box around it in m."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0)))

    def pieces(self, among: Ints) -> list[Ints]:
        """Return which boundary triangles among some are connected by their edges."""
        edges = np.sort(self.triangles[among][:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        _, edge = np.unique(edges, axis=0, return_inverse=True)
        group = actuator.joined_by(edge.reshape(-1, 3))
        return [among[group == i] for i in range(group.max(initial=-1) + 1)]

    def named(self, name: str) -> Ints:
        """Return the boundary triangles with a name of the file, or all of whose corners have it."""
        corners, chosen = self.triangles[:, :3], self.faces[name]
        if chosen.ndim == 1:
            return np.flatnonzero(np.isin(corners, chosen).all(axis=1))
        _, kind = np.unique(np.sort(np.concatenate([corners, chosen]), axis=1), axis=0, return_inverse=True)
        return np.flatnonzero(np.isin(kind.ravel()[: len(corners)], kind.ravel()[len(corners) :]))

    @property
    def bodies(self) -> list[Ints]:
        """The cells of each body: cells that share a triangle are of one."""
        _, side = np.unique(np.sort(self.cells[:, SIDES].reshape(-1, 3), axis=1), axis=0, return_inverse=True)
        group = actuator.joined_by(side.reshape(-1, 4))
        return [np.flatnonzero(group == i) for i in range(group.max(initial=-1) + 1)]

    def holds(self, place: Vector) -> bool:
        """Return whether a point lies in a cell, edges taken as straight."""
        base = self.points[self.cells[:, :4]]
        matrix = np.moveaxis(base[:, 1:] - base[:, :1], 1, 2)
        inner = np.linalg.solve(matrix, (np.asarray(place) - base[:, 0])[..., None])[..., 0]
        return bool(((inner >= 0).all(axis=1) & (inner.sum(axis=1) <= 1)).any())

    def distances(self, place: Vector) -> Array:
        """Return how far a point is from each boundary triangle, about: from its corners, middles and centre; shape (k,)."""
        at = self.corners
        at = np.concatenate([at, (at + np.roll(at, 1, axis=1)) / 2, at.mean(axis=1, keepdims=True)], axis=1)
        return np.asarray(np.linalg.norm(at - np.asarray(place), axis=2).min(axis=1))

    def enclosed(self, wall: Ints, origin: Sequence[float] | Array = (0.0, 0.0, 0.0)) -> float:
        """Return the volume in m3 before a wall of boundary triangles by the divergence theorem, -1/3 int x . n; planes
        through the origin (m) add nothing."""
        nodes = self.triangles[wall]
        x, a, b = (np.einsum("qn,kni->kqi", table, self.points[nodes]) for table in triangle_tables(nodes.shape[1]))
        return -float(np.einsum("q,kqi,kqi->", WEIGHTS, x - np.asarray(origin), np.cross(a, b)) / 6)

    @property
    def volume(self) -> float:
        """Volume in m3 of the cells."""
        return -self.enclosed(np.arange(len(self.triangles)))


def triangle_tables(width: int) -> tuple[Array, Array, Array]:
    """Return the values and two slopes of the shape functions of a triangle of 3 nodes, or 6 with those inside the edges
    behind the corners, at the points of `RULE`, shape (q, width) each."""
    s, t, r = RULE[:, 1], RULE[:, 2], RULE[:, 0]
    o, ones = np.zeros_like(s), np.ones_like(s)
    if width == 3:
        return RULE, np.stack([-ones, ones, o], axis=1), np.stack([-ones, o, ones], axis=1)
    value = [r * (2 * r - 1), s * (2 * s - 1), t * (2 * t - 1), 4 * r * s, 4 * s * t, 4 * t * r]
    along = [1 - 4 * r, 4 * s - 1, o, 4 * (r - s), 4 * t, -4 * t]
    across = [1 - 4 * r, o, 4 * t - 1, -4 * s, 4 * s, 4 * (r - t)]
    return np.stack(value, axis=1), np.stack(along, axis=1), np.stack(across, axis=1)


EDGES = np.array([[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]])
"""Corners at the ends of a tetrahedron's edges, in the order of VTK and Abaqus."""


def manifold(points: Array, triangles: Ints) -> Manifold:
    """Return the polyhedron of a closed surface, corners (n, 3) and triangles (t, 3) turned outwards, for manifold3d."""
    import manifold3d

    # It takes no frozen arrays.
    return manifold3d.Manifold(manifold3d.Mesh64(np.array(points, dtype=float), np.array(triangles, dtype=np.uint64)))


def surface_of(solid: Manifold) -> tuple[Array, Ints]:
    """Return the corners (n, 3) and the triangles (t, 3) of a solid of manifold3d."""
    mesh = solid.to_mesh64()
    return np.asarray(mesh.vert_properties)[:, :3], np.asarray(mesh.tri_verts).astype(np.int64)


def shells(triangles: Ints, count: int) -> Ints:
    """Return the number of the connected piece of each triangle, shape (t,), of a surface with so many corners."""
    return actuator.joined(np.concatenate([triangles[:, :2], triangles[:, 1:]]), count)[triangles[:, 0]]


def enclosed_air(points: Array, triangles: Ints) -> Array:
    """Return the volume in each inner shell of a closed surface, corners (n, 3) and triangles (t, 3) turned outwards."""
    shell = shells(triangles, len(points))
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    volumes = np.bincount(shell, np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0)
    return np.asarray(-volumes[volumes < 0.0])


def flat_cell(points: Array, cells: Ints) -> bool:
    """Return whether a cell has no volume."""
    heights = np.abs(_volumes(points, cells))
    return not heights.min() > 1e-12 * heights.max()


def _volumes(points: Array, cells: Ints) -> Array:
    """Return six times the cells' volumes, edges taken as straight, below zero for those turned the wrong way; shape (m,)."""
    a, b, c, d = np.moveaxis(points[cells[:, :4]], 1, 0)
    return np.asarray(np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a))
