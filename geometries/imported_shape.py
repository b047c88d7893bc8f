"""A STEP file in Gmsh: its unit, its cavities, its roles.

A cavity is found from a point in its air. Take away the faces on the cut planes: the walls that hang together by their edges
are then the outside or one cavity each, and the wall nearest to the point is that of its own cavity, since the straight way
there crosses no other. So a cavity is open on cut planes alone; one with an inlet hangs together with the outside.
"""

from __future__ import annotations

import dataclasses
import functools
from collections import defaultdict
from typing import TYPE_CHECKING

import numpy as np

from geometries.actuator import Vector
from geometries.errors import GeometryError
from geometries.selections import AXES, chosen, faces, point

if TYPE_CHECKING:
    from geometries.imported import ImportedActuator

FINE = 40
"""Cells around a circle in the mesh of walls that the cavities' volumes are measured on."""


@dataclasses.dataclass(frozen=True)
class Reading:
    """What a file holds, in m and m3, of the part as drawn.

    Attributes:
        normals: Outward unit normals of the cut planes.
        gauge: The corner whose motion is told.
        solid_volume: Of the solid.
        cavity_volumes: Of each cavity.
    """

    normals: tuple[Vector, ...]
    gauge: Vector
    solid_volume: float
    cavity_volumes: tuple[float, ...]


@functools.lru_cache(maxsize=32)
def read_part(part: ImportedActuator, digest: str) -> Reading:
    """Open the file and check every choice against it.

    Args:
        part: The part.
        digest: Hash of the file's bytes: another content is another reading.

    Raises:
        GeometryError: A file or a choice that makes no device.
    """
    import gmsh  # type: ignore[import-untyped]

    from geometries.meshing import private_model

    with private_model():
        solid = _open(part)
        roles = _roles(part, solid)
        gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", FINE)
        gmsh.option.setNumber("Mesh.MeshSizeMax", part.cell_size)
        gmsh.model.mesh.generate(2)
        gmsh.model.mesh.setOrder(2)
        volumes = tuple(_enclosed(solid, roles[_cavity(i)]) for i in range(len(part.cavities)))
        return Reading(
            tuple(_normal(solid, part, i) for i in range(len(part.planes))),
            _gauge(part, roles["support"]),
            float(gmsh.model.occ.getMass(3, solid)),
            volumes,
        )


def build_part(part: ImportedActuator) -> None:
    """Fill the current Gmsh model with the part, its roles and its cell sizes (m)."""
    import gmsh

    solid = _open(part)
    gmsh.model.addPhysicalGroup(3, [solid], name="solid")
    for role, tags in _roles(part, solid).items():
        gmsh.model.addPhysicalGroup(2, tags, name=role)
    gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", part.curvature)
    gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 1)
    gmsh.model.mesh.setSizeCallback(lambda dim, tag, x, y, z, other: min(other, part.cell_size))


def _open(part: ImportedActuator) -> int:
    """Read the file in metres, whatever its unit; return its one solid."""
    import gmsh

    gmsh.option.setString("Geometry.OCCTargetUnit", "M")
    gmsh.option.setNumber("Geometry.OCCImportLabels", 1)
    try:
        gmsh.model.occ.importShapes(part.file, format="step")
        gmsh.model.occ.synchronize()
    except Exception as error:  # Gmsh raises bare Exception
        raise GeometryError(
            f"file {part.file} cannot be read as STEP ({str(error).strip() or 'no reason given'})"
        ) from None
    solids = gmsh.model.getEntities(3)
    if len(solids) != 1:
        raise GeometryError(
            f"file {part.file} holds {len(solids)} solids; a part is one solid with its cavities cut out"
        )
    return int(solids[0][1])


def _cavity(number: int) -> str:
    return "cavity" if number == 0 else f"cavity{number + 1}"


def _near() -> float:
    """What counts as the same place in m: Gmsh's boxes are wider by its tolerance."""
    import gmsh

    low, high = np.array(gmsh.model.getBoundingBox(-1, -1)).reshape(2, 3)
    return float(1e-5 * np.linalg.norm(high - low))


def _roles(part: ImportedActuator, solid: int) -> dict[str, list[int]]:
    """Every face's role."""
    import gmsh

    left = [tag for _, tag in gmsh.model.getBoundary([(3, solid)], oriented=False)]
    roles: dict[str, list[int]] = {}
    for i, text in enumerate(part.planes):
        choice = faces("planes", text)
        if choice.axis is None or choice.at != 0.0:
            raise GeometryError(
                f"planes has {text!r}; cut planes go through the origin, such as 'y = 0 mm': move the part"
            )
        roles[f"plane{i}"] = chosen(choice, left, _near())
        left = _without(left, roles[f"plane{i}"], f"planes has {text!r}")
    pieces = _pieces(left)
    for i, text in enumerate(part.cavities):
        piece = _around(pieces, solid, text)
        if not set(piece) <= set(left):
            raise GeometryError(f"cavities has {text!r}; that cavity has another point already")
        roles[_cavity(i)] = piece
        left = [tag for tag in left if tag not in piece]
    roles["support"] = chosen(faces("support", part.support), left, _near())
    roles["outer"] = _without(left, roles["support"], f"support is {part.support!r}")
    return {name: tags for name, tags in roles.items() if tags}


def _without(left: list[int], taken: list[int], what: str) -> list[int]:
    import gmsh

    if not taken:
        low, high = np.array(gmsh.model.getBoundingBox(-1, -1)).reshape(2, 3) * 1e3
        extent = ", ".join(f"{name} {a:.4g} to {b:.4g}" for name, a, b in zip(AXES, low, high, strict=True))
        raise GeometryError(f"{what}; the part has no such face on its outside (it spans {extent} mm)")
    return [tag for tag in left if tag not in taken]


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


def _around(pieces: list[list[int]], solid: int, text: str) -> list[int]:
    """The piece of wall nearest to a point in the air."""
    import gmsh

    place = point("cavities", text)
    if gmsh.model.isInside(3, solid, list(place)):
        raise GeometryError(f"cavities has {text!r}; that point lies in the solid, not in a cavity's air")
    probe = gmsh.model.occ.addPoint(*place)

    def distance(piece: list[int]) -> float:
        return min(gmsh.model.occ.getDistance(0, probe, 2, tag)[0] for tag in piece)

    nearest = min(pieces, key=distance)
    gmsh.model.occ.remove([(0, probe)])
    outside = max(pieces, key=_extent)
    if nearest is outside:
        raise GeometryError(
            f"cavities has {text!r}; that point is outside the part, or its cavity is open to the outside"
        )
    return nearest


def _extent(piece: list[int]) -> float:
    import gmsh

    boxes = np.array([gmsh.model.occ.getBoundingBox(2, tag) for tag in piece])
    return float(np.linalg.norm(boxes[:, 3:].max(axis=0) - boxes[:, :3].min(axis=0)))


def _enclosed(solid: int, tags: list[int]) -> float:
    """Volume within a wall by the divergence theorem on its mesh, -1/3 int x . n: cut planes through the origin add nothing."""
    import gmsh

    total = 0.0
    for tag in tags:
        for kind in gmsh.model.mesh.getElementTypes(2, tag):
            local, weights = gmsh.model.mesh.getIntegrationPoints(kind, "Gauss4")
            jacobians, determinants, places = gmsh.model.mesh.getJacobians(kind, local, tag)
            normals, at = jacobians.reshape(-1, 3, 3)[:, 2], places.reshape(-1, 3)
            # A face's mesh may be turned either way; the solid lies behind its outward normal.
            turned = 1.0 if gmsh.model.isInside(3, solid, list(at[0] - 10 * _near() * normals[0])) else -1.0
            along = np.einsum("ij,ij->i", at, normals) * determinants
            total -= turned * float((along.reshape(-1, len(weights)) @ weights).sum()) / 3.0
    return total


def _normal(solid: int, part: ImportedActuator, number: int) -> Vector:
    """Outward normal of a cut plane: away from the solid."""
    import gmsh

    axis = faces("planes", part.planes[number]).axis
    assert axis is not None
    low, high = np.array(gmsh.model.occ.getBoundingBox(3, solid)).reshape(2, 3)
    if min(abs(low[axis]), abs(high[axis])) > _near():
        raise GeometryError(
            f"planes has {part.planes[number]!r}; the part reaches to both sides of it, so it is not cut there"
        )
    values = [0.0, 0.0, 0.0]
    values[axis] = -1.0 if abs(low[axis]) <= _near() else 1.0
    return (values[0], values[1], values[2])


def _gauge(part: ImportedActuator, support: list[int]) -> Vector:
    """The corner nearest to the wanted point, or the one farthest from the held faces."""
    import gmsh

    corners = np.array([gmsh.model.getValue(0, tag, []) for _, tag in gmsh.model.getEntities(0)])
    if not len(corners):
        raise GeometryError(f"file {part.file} has no corner to follow; split an edge where the motion matters")
    if part.gauge_point:
        away = np.linalg.norm(corners - point("gauge_point", part.gauge_point), axis=1)
        if away.min() > 1e-4:
            near = ", ".join(f"{value * 1e3:.6g}" for value in corners[away.argmin()])
            raise GeometryError(
                f"gauge_point is {part.gauge_point!r}; it must be a corner, the nearest is at {near} mm"
            )
        x, y, z = corners[away.argmin()]
    else:
        held = np.mean([gmsh.model.occ.getCenterOfMass(2, tag) for tag in support], axis=0)
        x, y, z = corners[np.linalg.norm(corners - held, axis=1).argmax()]
    return float(x), float(y), float(z)
