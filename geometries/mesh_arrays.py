"""A device's mesh file as arrays, for programs that are not DOLFINx: nodes, cells by region, faces and nodes by role."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from geometries.errors import MeshFileError
from geometries.mesh_files import load_mesh
from geometries.meshing import private_model
from geometries.tetrahedra import MIDDLES, SIDES, TO_GMSH, Ints

KINDS = {4: 4, 11: 10}
"""Gmsh's tetrahedra of first and second order, with their number of nodes."""


@dataclasses.dataclass(frozen=True, eq=False)
class MeshArrays:
    """A mesh; nodes and cells count from 0.

    Attributes:
        points: Nodes in m, shape (n, 3).
        cells: Nodes of the tetrahedra in the order of VTK and Abaqus, shape (m, 4) or (m, 10).
        regions: Cells by region.
        faces: Of each role on faces: the cell behind each, and which of its `geometries.tetrahedra.SIDES` it is, shape (k, 2).
        nodes: Nodes by role, of faces, lines and points.
    """

    points: NDArray[np.float64]
    cells: Ints
    regions: Mapping[str, Ints]
    faces: Mapping[str, Ints]
    nodes: Mapping[str, Ints]

    def triangles(self, role: str) -> Ints:
        """Nodes of a role's faces, normals out of the solid, shape (k, 3) or (k, 6)."""
        cell, side = self.faces[role].T
        order = SIDES if self.cells.shape[1] == 4 else np.hstack([SIDES, MIDDLES])
        return np.asarray(np.take_along_axis(self.cells[cell], order[side], axis=1))


def read_arrays(path: Path) -> MeshArrays:
    """Read the Gmsh file that `Actuator.write` made of a solid device.

    Raises:
        FileNotFoundError: No such file.
        MeshFileError: Not a mesh of tetrahedra as `Actuator.write` makes them.
    """
    import gmsh  # type: ignore[import-untyped]

    with private_model():
        load_mesh(path, 3)
        tags, places, _ = gmsh.model.mesh.getNodes()
        number = np.full(int(tags.max()) + 1, -1)
        number[tags.astype(int)] = np.arange(len(tags))
        # A list: a face and the region behind it may bear one name.
        groups = [(gmsh.model.getPhysicalName(*group), group) for group in gmsh.model.getPhysicalGroups()]
        cells, regions, count = [], {}, 0
        for name, (dimension, tag) in groups:
            if dimension == 3:
                found = number[_cells_of(tag)]
                regions[name] = np.arange(count, count + len(found))
                cells.append(found)
                count += len(found)
        if not cells or len({part.shape[1] for part in cells}) > 1:
            raise MeshFileError(f"{path} is not a mesh of tetrahedra of one kind")
        nodes = {
            name: number[gmsh.model.mesh.getNodesForPhysicalGroup(*group)[0].astype(int)]
            for name, group in groups
            if group[0] < 3
        }
        corners = {name: number[_corners_of(tag)] for name, (dimension, tag) in groups if dimension == 2}
    whole = np.concatenate(cells)
    return MeshArrays(places.reshape(-1, 3), whole, regions, _owned(whole, corners), nodes)


def _cells_of(group: int) -> Ints:
    """Node tags of a volume group's tetrahedra, in VTK's order."""
    import gmsh

    parts = []
    for entity in gmsh.model.getEntitiesForPhysicalGroup(3, group):
        for kind, _, nodes in zip(*gmsh.model.mesh.getElements(3, entity), strict=True):
            width = KINDS.get(int(kind), 0)
            if not width:
                raise MeshFileError("the mesh has cells that are no tetrahedra")
            parts.append(nodes.astype(np.int64).reshape(-1, width)[:, TO_GMSH[:width]])
    return np.concatenate(parts)


def _corners_of(group: int) -> Ints:
    """Node tags of the corners of a surface group's triangles."""
    import gmsh

    parts = [np.empty((0, 3), dtype=np.int64)]
    for entity in gmsh.model.getEntitiesForPhysicalGroup(2, group):
        for kind, _, nodes in zip(*gmsh.model.mesh.getElements(2, entity), strict=True):
            width = {2: 3, 9: 6}[int(kind)]
            parts.append(nodes.astype(np.int64).reshape(-1, width)[:, :3])
    return np.concatenate(parts)


def _owned(cells: Ints, corners: Mapping[str, Ints]) -> dict[str, Ints]:
    """Cell and side of the faces of each role, by their corners."""
    sides = np.sort(cells[:, SIDES].reshape(-1, 3), axis=1)
    keys = {tuple(side): place for place, side in enumerate(sides.tolist())}
    found = {}
    for name, triangles in corners.items():
        places = np.array([keys[tuple(one)] for one in np.sort(triangles, axis=1).tolist()], dtype=np.int64)
        found[name] = np.column_stack([places // 4, places % 4])
    return found
