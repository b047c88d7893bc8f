"""What each face of a STEP part does: cut plane, wall of a cavity, support, or just its outside.

A cavity is found from a point in its air or from faces of its wall. Take away the faces on the cut planes: the walls that hang
together by their edges are then the outside or one cavity each, and the wall nearest to the point is that of its own cavity,
since the straight way there crosses no other. So a cavity is open on cut planes alone; one with an inlet hangs together with
the outside.
"""

from __future__ import annotations

import re
from collections import defaultdict
from typing import TYPE_CHECKING

import numpy as np

from geometries.actuator import Vector
from geometries.errors import GeometryError
from geometries.imported_part import BONDED, cavity_role, only_inner_shell
from geometries.imported_solids import Solids
from geometries.selections import AXES, chosen, faces, point, surface_points
from geometries.symmetry import check_slice

if TYPE_CHECKING:
    from geometries.imported import ImportedActuator


def extent() -> float:
    """Diagonal of the current Gmsh model's box in m."""
    import gmsh  # type: ignore[import-untyped]

    low, high = np.array(gmsh.model.getBoundingBox(-1, -1)).reshape(2, 3)
    return float(np.linalg.norm(high - low))


def _near() -> float:
    """What counts as the same place in m: Gmsh's boxes are wider by its tolerance."""
    return 1e-5 * extent()


def find_roles(part: ImportedActuator, solids: Solids) -> dict[str, list[int]]:
    """Surfaces of the current Gmsh model by role; every surface has one.

    Raises:
        GeometryError: A choice that picks nothing, or something that cannot have this role.
    """
    left = solids.boundary
    roles: dict[str, list[int]] = {}
    for i, text in enumerate(part.planes):
        roles[f"plane{i}"] = _in_cut_plane(part, text, left, solids)
        left = [tag for tag in left if tag not in roles[f"plane{i}"]]
    pieces = _pieces(left)
    outside = max(pieces, key=_size) if pieces else []
    if not part.cavities:
        inner = [piece for piece in pieces if piece is not outside]
        roles[cavity_role(0)] = only_inner_shell(part.file, inner, lambda piece: _box(piece).mean(axis=0))
        left = [tag for tag in left if tag not in roles[cavity_role(0)]]
    for i, text in enumerate(part.cavities):
        by_point = re.match(r"\s*at\b", text)
        wall = _around(pieces, solids, text) if by_point else _with_faces(pieces, part, text, left, solids)
        if set(outside) & set(wall):
            raise GeometryError(
                f"cavities has {text!r}; that is outside the part, or its cavity is open to the outside"
            )
        if not set(wall) <= set(left):
            raise GeometryError(f"cavities has {text!r}; that cavity is chosen already")
        roles[cavity_role(i)] = wall
        left = [tag for tag in left if tag not in wall]
    for role, field, text in (("support", "support", part.support), (BONDED, "bonded", part.bonded)):
        if text:
            roles[role] = _some(part, field, f"{field} is {text!r}", text, left, solids)
            left = [tag for tag in left if tag not in roles[role]]
    return {name: tags for name, tags in {**roles, "outer": left}.items() if tags}


def _some(part: ImportedActuator, field: str, what: str, text: str, left: list[int], solids: Solids) -> list[int]:
    """The faces among ``left`` that a text picks; there must be some."""
    import gmsh

    found = chosen(field, faces(field, text), left, _near(), part.file, solids.pieces)
    if not found:
        low, high = np.array(gmsh.model.getBoundingBox(-1, -1)).reshape(2, 3) * 1e3
        spans = ", ".join(f"{name} {a:.4g} to {b:.4g}" for name, a, b in zip(AXES, low, high, strict=True))
        raise GeometryError(
            f"{what}; the part has no such face, or it is a cut plane's or a cavity's already (it spans {spans} mm)"
        )
    return found


def _in_cut_plane(part: ImportedActuator, text: str, left: list[int], solids: Solids) -> list[int]:
    """All faces in the plane of those that a text picks, which must go through the origin."""
    what = f"planes has {text!r}"
    picked = _some(part, "planes", what, text, left, solids)
    points = np.concatenate([surface_points(tag) for tag in picked])
    normal = _fitted_normal(picked)
    distances = points @ normal
    if np.ptp(distances) > 2 * _near():
        raise GeometryError(f"{what}; these faces do not lie in one plane")
    if abs(distances.mean()) > _near():
        shift = ", ".join(f"{value:.6g}" for value in -1e3 * distances.mean() * normal + 0.0)
        raise GeometryError(f"{what}; cut planes go through the origin: move the part by {shift} mm in its CAD program")
    return [tag for tag in left if np.abs(surface_points(tag) @ normal).max() < _near()]


def _fitted_normal(tags: list[int]) -> np.ndarray:
    """Unit normal of the plane nearest to some surfaces."""
    points = np.concatenate([surface_points(tag) for tag in tags])
    normal: np.ndarray = np.linalg.svd(points - points.mean(axis=0))[2][2]
    return np.round(normal, 12) + 0.0  # square to an axis means so, without -0


def outward(part: ImportedActuator, solids: Solids, roles: dict[str, list[int]]) -> tuple[Vector, ...]:
    """Unit normals of the cut planes, away from the solid; the surfaces of the current Gmsh model are meshed.

    Raises:
        GeometryError: A plane that does not bound the part, or planes between which its images do not fill the whole.
    """
    import gmsh

    centre = solids.centre
    points = gmsh.model.mesh.getNodes()[1].reshape(-1, 3)
    normals = []
    for i, text in enumerate(part.planes):
        normal = _fitted_normal(roles[f"plane{i}"])
        normal = np.where(normal @ centre > 0, -normal, normal) + 0.0
        if (points @ normal).max() > _near():
            raise GeometryError(f"planes has {text!r}; the part reaches to both sides of it, so it is not cut there")
        x, y, z = (float(value) for value in normal)
        normals.append((x, y, z))
    check_slice(normals, part.planes)
    return tuple(normals)


def _pieces(tags: list[int]) -> list[list[int]]:
    """Faces that hang together by their edges."""
    import gmsh

    by_edge = defaultdict(list)
    for tag in tags:
        for _, edge in gmsh.model.getBoundary([(2, tag)], oriented=False):
            by_edge[edge].append(tag)
    group = {tag: {tag} for tag in tags}
    for together in by_edge.values():
        merged = set().union(*(group[tag] for tag in together))
        for tag in merged:
            group[tag] = merged
    return [list(piece) for piece in {tuple(sorted(piece)) for piece in group.values()}]


def _around(pieces: list[list[int]], solids: Solids, text: str) -> list[int]:
    """The piece of wall nearest to a point in the air."""
    import gmsh

    place = point("cavities", text)
    if solids.holds(list(place)):
        raise GeometryError(f"cavities has {text!r}; that point lies in the solid, not in a cavity's air")
    probe = gmsh.model.occ.addPoint(*place)

    def distance(piece: list[int]) -> float:
        return min(gmsh.model.occ.getDistance(0, probe, 2, tag)[0] for tag in piece)

    nearest = min(pieces, key=distance)
    gmsh.model.occ.remove([(0, probe)])
    return nearest


def _with_faces(
    pieces: list[list[int]], part: ImportedActuator, text: str, left: list[int], solids: Solids
) -> list[int]:
    """The piece of wall that the picked faces belong to, or several if they do."""
    picked = _some(part, "cavities", f"cavities has {text!r}", text, left, solids)
    return [tag for piece in pieces if set(piece) & set(picked) for tag in piece]


def _size(piece: list[int]) -> float:
    return float(np.linalg.norm(np.ptp(_box(piece), axis=0)))


def _box(piece: list[int]) -> np.ndarray:
    """Lowest and highest corner of some faces' box in m, shape (2, 3)."""
    import gmsh

    boxes = np.array([gmsh.model.occ.getBoundingBox(2, tag) for tag in piece])
    return np.array([boxes[:, :3].min(axis=0), boxes[:, 3:].max(axis=0)])
