"""What each boundary triangle of a foreign mesh does: cut plane, wall of a cavity, support, or just its outside.

The rules are those of drawings (`geometries.imported_roles`): take away the cut planes; the triangles that hang together by
their edges are then the outside or one cavity each.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from geometries.actuator import Vector
from geometries.errors import GeometryError
from geometries.imported_part import BONDED, cavity_role, only_inner_shell
from geometries.selections import AXES, TILT, faces, listed, point
from geometries.symmetry import check_slice
from geometries.tetrahedra import Ints, Tetrahedra

if TYPE_CHECKING:
    from geometries.imported_mesh import ImportedMesh

NEAR = 1e-5
"""What counts as the same place, over the part's extent: files round to seven digits."""


def find_roles(part: ImportedMesh, mesh: Tetrahedra) -> dict[str, Ints]:
    """Boundary triangles by role; every triangle has one.

    Raises:
        GeometryError: A choice that picks nothing, or something that cannot have this role.
    """
    left = np.arange(len(mesh.triangles))
    roles: dict[str, Ints] = {}
    for i, text in enumerate(part.planes):
        roles[f"plane{i}"] = _in_cut_plane(part, mesh, text, left)
        left = np.setdiff1d(left, roles[f"plane{i}"])
    pieces = mesh.pieces(left)
    outside = max(pieces, key=lambda piece: _size(mesh, piece)) if pieces else left
    if not part.cavities:
        inner = [piece for piece in pieces if piece is not outside]
        roles[cavity_role(0)] = only_inner_shell(part.file, inner, lambda piece: _middle(mesh, piece))
        left = np.setdiff1d(left, roles[cavity_role(0)])
    for i, text in enumerate(part.cavities):
        by_point = re.match(r"\s*at\b", text)
        wall = _around(mesh, pieces, text) if by_point else _with_faces(part, mesh, pieces, text, left)
        if np.isin(outside, wall).any():
            raise GeometryError(
                f"cavities has {text!r}; that is outside the part, or its cavity is open to the outside"
            )
        if not np.isin(wall, left).all():
            raise GeometryError(f"cavities has {text!r}; that cavity is chosen already")
        roles[cavity_role(i)] = wall
        left = np.setdiff1d(left, wall)
    for role, field, text in (("support", "support", part.support), (BONDED, "bonded", part.bonded)):
        if text:
            roles[role] = _some(part, mesh, f"{field} is {text!r}", field, text, left)
            left = np.setdiff1d(left, roles[role])
    return {name: triangles for name, triangles in {**roles, "outer": left}.items() if len(triangles)}


def _some(part: ImportedMesh, mesh: Tetrahedra, what: str, field: str, text: str, left: Ints) -> Ints:
    """The triangles among ``left`` that a text picks; there must be some."""
    found = _chosen(mesh, field, text, left)
    if not len(found):
        spans = ", ".join(
            f"{name} {a:.4g} to {b:.4g}"
            for name, a, b in zip(AXES, 1e3 * mesh.points.min(axis=0), 1e3 * mesh.points.max(axis=0), strict=True)
        )
        raise GeometryError(
            f"{what}; the part has no such face, or it is a cut plane's or a cavity's already (it spans {spans} mm)"
        )
    return found


def _chosen(mesh: Tetrahedra, field: str, text: str, left: Ints) -> Ints:
    choice, near = faces(field, text), NEAR * mesh.extent
    if choice.colour is not None:
        raise GeometryError(f"{field} is {text!r}; a mesh has no colours: name faces, or pick them by their place")
    if choice.name is not None:
        if choice.name not in mesh.faces:
            raise GeometryError(f"{field} is {text!r}; {listed('name', sorted(mesh.faces))}")
        return np.intersect1d(left, mesh.named(choice.name))
    corners = mesh.corners[left]
    if choice.box is not None:
        low, high = (np.array(end) for end in choice.box)
        return left[((corners > low - near) & (corners < high + near)).all(axis=(1, 2))]
    assert choice.normal is not None
    normal = np.array(choice.normal)
    typed = 0.0 if np.abs(normal).max() == 1.0 else TILT * float(np.linalg.norm(corners, axis=2).max(initial=0.0))
    return left[(np.abs(corners @ normal - choice.at) < near + typed).all(axis=1)]


def _in_cut_plane(part: ImportedMesh, mesh: Tetrahedra, text: str, left: Ints) -> Ints:
    """All triangles in the plane of those that a text picks, which must go through the origin."""
    what, near = f"planes has {text!r}", NEAR * mesh.extent
    normal = _fitted_normal(mesh, _some(part, mesh, what, "planes", text, left))
    picked = mesh.corners[_some(part, mesh, what, "planes", text, left)].reshape(-1, 3) @ normal
    if np.ptp(picked) > 2 * near:
        raise GeometryError(f"{what}; these faces do not lie in one plane")
    if abs(picked.mean()) > near:
        shift = ", ".join(f"{value:.6g}" for value in -1e3 * picked.mean() * normal + 0.0)
        raise GeometryError(f"{what}; cut planes go through the origin: move the part by {shift} mm where it is meshed")
    return left[(np.abs(mesh.corners[left] @ normal) < near).all(axis=1)]


def _fitted_normal(mesh: Tetrahedra, triangles: Ints) -> np.ndarray:
    """Unit normal of the plane nearest to some triangles."""
    places = mesh.corners[triangles].reshape(-1, 3)
    normal: np.ndarray = np.linalg.svd(places - places.mean(axis=0), full_matrices=False)[2][2]
    return np.round(normal, 6) / np.linalg.norm(np.round(normal, 6)) + 0.0


def outward(part: ImportedMesh, mesh: Tetrahedra, roles: Mapping[str, Ints]) -> tuple[Vector, ...]:
    """Unit normals of the cut planes, away from the solid.

    Raises:
        GeometryError: A plane that does not bound the part, or planes between which its images do not fill the whole.
    """
    normals = []
    for i, text in enumerate(part.planes):
        normal = _fitted_normal(mesh, roles[f"plane{i}"])
        normal = np.where(mesh.normals[roles[f"plane{i}"][0]] @ normal < 0, -normal, normal) + 0.0
        if (mesh.points @ normal).max() > NEAR * mesh.extent:
            raise GeometryError(f"planes has {text!r}; the part reaches to both sides of it, so it is not cut there")
        x, y, z = (float(value) for value in normal)
        normals.append((x, y, z))
    check_slice(normals, part.planes)
    return tuple(normals)


def put_on_planes(mesh: Tetrahedra, roles: Mapping[str, Ints], normals: Sequence[Vector]) -> Tetrahedra:
    """The mesh with the nodes on its cut planes exactly there: files round."""
    points = mesh.points.copy()
    for _ in range(3):  # a node on two planes comes nearer to both
        for i, normal in enumerate(normals):
            nodes = np.unique(mesh.triangles[roles[f"plane{i}"]])
            points[nodes] -= np.outer(points[nodes] @ normal, normal)
    return dataclasses.replace(mesh, points=points)


def cavity_volumes(part: ImportedMesh, mesh: Tetrahedra, roles: Mapping[str, Ints]) -> tuple[float, ...]:
    """Volume in m3 of each cavity of the part as meshed.

    Raises:
        GeometryError: A wall that encloses nothing.
    """
    volumes = tuple(mesh.enclosed(roles[cavity_role(i)]) for i in range(part.cavity_count))
    for i, volume in enumerate(volumes):
        if not volume > 0.0:
            what = f"cavities has {part.cavities[i]!r}" if part.cavities else "the part has one closed inner shell"
            raise GeometryError(f"{what}; its wall encloses no air, so the mesh is no solid around it")
    return volumes


def gauge(part: ImportedMesh, mesh: Tetrahedra, roles: Mapping[str, Ints]) -> Vector:
    """The corner of the boundary nearest to the wanted point, or the one farthest from the held faces, or from the origin."""
    nodes = np.unique(mesh.triangles[:, :3])
    places = mesh.points[nodes]
    if part.gauge_point:
        at = places[np.linalg.norm(places - point("gauge_point", part.gauge_point), axis=1).argmin()]
    else:
        held = mesh.corners[roles["support"]].reshape(-1, 3).mean(axis=0) if "support" in roles else np.zeros(3)
        at = places[np.linalg.norm(places - held, axis=1).argmax()]
    return float(at[0]), float(at[1]), float(at[2])


def _around(mesh: Tetrahedra, pieces: list[Ints], text: str) -> Ints:
    """The piece of wall nearest to a point in the air."""
    place = point("cavities", text)
    if mesh.holds(place):
        raise GeometryError(f"cavities has {text!r}; that point lies in the solid, not in a cavity's air")
    away = mesh.distances(place)
    return min(pieces, key=lambda piece: float(away[piece].min()))


def _with_faces(part: ImportedMesh, mesh: Tetrahedra, pieces: list[Ints], text: str, left: Ints) -> Ints:
    """The piece of wall that the picked triangles belong to, or several if they do."""
    picked = _some(part, mesh, f"cavities has {text!r}", "cavities", text, left)
    return np.concatenate([piece for piece in pieces if np.isin(piece, picked).any()])


def _middle(mesh: Tetrahedra, piece: Ints) -> np.ndarray:
    places = mesh.corners[piece].reshape(-1, 3)
    middle: np.ndarray = (places.min(axis=0) + places.max(axis=0)) / 2
    return middle


def _size(mesh: Tetrahedra, piece: Ints) -> float:
    return float(np.linalg.norm(np.ptp(mesh.corners[piece].reshape(-1, 3), axis=0)))
