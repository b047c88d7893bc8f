"""A mesh file as plain arrays, read through Gmsh."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from geometries import HollowDisk, meshing
from geometries.meshing import private_model


@pytest.fixture(autouse=True)
def _meshed_anew(monkeypatch, request):
    """These tests are about making meshes; none is taken from those kept, but where that is what is tested."""
    if "made" not in request.fixturenames:
        monkeypatch.setattr(meshing, "load_cached_mesh", lambda *_: False)


@dataclasses.dataclass
class Elements:
    """Elements of one physical group.

    Attributes:
        corners: Node tags of the vertices, shape (n, dimension + 1).
        nodes: All node tags of the group, unique.
        measure: Length, area or volume, curved edges included; 0 for points.
        flux: Integral of x . n, with n = first tangent x second tangent (surfaces only).
        turned: Integral of 2 pi x: the volume of a section turned around the axis (surfaces only).
    """

    corners: np.ndarray
    nodes: np.ndarray
    measure: float = 0.0
    flux: float = 0.0
    turned: float = 0.0


@dataclasses.dataclass
class Mesh:
    """A whole file: coordinates by node tag (row 0 unused) and groups by (dimension, role)."""

    points: np.ndarray
    groups: dict[tuple[int, str], Elements]
    orders: set[int]

    def at(self, dimension: int, role: str) -> np.ndarray:
        """Coordinates of a group's nodes, shape (n, 3)."""
        return self.points[self.groups[dimension, role].nodes]


def read_mesh(path: Path) -> Mesh:
    """Read every physical group of a mesh file."""
    import gmsh

    with private_model():
        gmsh.merge(str(path))
        tags, coordinates, _ = gmsh.model.mesh.getNodes()
        points = np.full((int(tags.max()) + 1, 3), np.nan)
        points[tags.astype(int)] = coordinates.reshape(-1, 3)
        mesh = Mesh(points, {}, set())
        for dimension, group in gmsh.model.getPhysicalGroups():
            parts = [_entity(dimension, tag, mesh) for tag in gmsh.model.getEntitiesForPhysicalGroup(dimension, group)]
            corners = np.concatenate([part.corners for part in parts])
            nodes = np.unique(np.concatenate([part.nodes for part in parts]))
            sums = (sum(getattr(part, name) for part in parts) for name in ("measure", "flux", "turned"))
            total = Elements(corners, nodes, *sums)
            mesh.groups[dimension, gmsh.model.getPhysicalName(dimension, group)] = total
    return mesh


def _entity(dimension: int, tag: int, mesh: Mesh) -> Elements:
    import gmsh

    (kind,), _, (nodes,) = gmsh.model.mesh.getElements(dimension, tag)
    _, _, order, count, _, vertices = gmsh.model.mesh.getElementProperties(kind)
    table = nodes.astype(int).reshape(-1, count)
    found = Elements(table[:, :vertices], np.unique(table))
    if dimension == 0:
        return found
    mesh.orders.add(order)
    local, weights = gmsh.model.mesh.getIntegrationPoints(kind, "Gauss6")
    jacobians, determinants, places = gmsh.model.mesh.getJacobians(kind, local, tag)
    found.measure = float((determinants.reshape(-1, len(weights)) @ weights).sum())
    if dimension == 2:
        tangents = jacobians.reshape(-1, len(weights), 3, 3)
        normals = np.cross(tangents[:, :, 0], tangents[:, :, 1])
        places = places.reshape(-1, len(weights), 3)
        found.turned = float(
            2 * np.pi * np.einsum("eq,eq,q->", determinants.reshape(-1, len(weights)), places[..., 0], weights)
        )
        found.flux = float(np.einsum("eqi,eqi,q->", normals, places, weights))
    return found


@pytest.fixture(scope="session")
def meshed(tmp_path_factory: pytest.TempPathFactory) -> Callable[[HollowDisk], Mesh]:
    """Return a function that gives a disk's mesh, made once for all tests."""
    folder = tmp_path_factory.mktemp("meshes")
    known: dict[str, Mesh] = {}

    def mesh_of(disk: HollowDisk) -> Mesh:
        if disk.key not in known:
            known[disk.key] = read_mesh(disk.write(folder / f"{disk.name}.msh"))
        return known[disk.key]

    return mesh_of
