"""Parts from STEP files, with texts that assign roles to faces."""

from __future__ import annotations

import dataclasses
import functools
import re
from collections import defaultdict
from typing import ClassVar

import numpy as np

from geometries.actuator import Recipe, Vector, check_slice, in_halves
from geometries.imported import (
    AXES,
    MAIN,
    ImportedPart,
    Reading,
    cavity_role,
    chosen,
    faces,
    only_inner_shell,
    point,
    region_name,
    solid_names,
    surface_points,
)
from geometries.meshing import apart, private_model
from geometries.registry import register_device
from geometries.revolved import TRIANGLE
from softmodels.common.errors import GeometryError, MeshingError
from softmodels.common.names import lazy_module
from softmodels.common.schema import choice_field, length_field, number_field, shown

gmsh = lazy_module("gmsh")

# ----------------------------------------------------------------------------------------------------------------------
# How many triangles the mesh of a STEP part's faces takes, from their areas and curvature, before any is made.


MOST_TRIANGLES = 1_000_000

SAMPLES = 5
"""Places in each direction of a face's parameters where its curvature is looked at."""


def expected_triangles(faces: list[int], cell_size: float, curvature: float) -> float:
    """Return the number of triangles on faces of the current Gmsh model, or fewer: fine edges make the faces beside them finer.

    Args:
        faces: Their tags.
        cell_size: Longest edge in m.
        curvature: Cells around a full circle.
    """
    total = 0.0
    for face in faces:
        around = 2.0 * np.pi / (curvature * np.maximum(_curvatures(face), 1e-30))
        sizes = np.minimum(cell_size, around)
        total += float(gmsh.model.occ.getMass(2, face)) * float(np.mean(sizes**-2.0))
    return total / TRIANGLE


def _curvatures(face: int) -> np.ndarray:
    """Return the largest curvature (1/m) at places all over a face."""
    low, high = gmsh.model.getParametrizationBounds(2, face)
    share = (np.arange(SAMPLES) + 0.5) / SAMPLES
    u, v = (low[i] + share * (high[i] - low[i]) for i in range(2))
    places = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1)
    largest, smallest = gmsh.model.getPrincipalCurvatures(face, list(places))[:2]
    return np.maximum(np.abs(largest), np.abs(smallest))


# ----------------------------------------------------------------------------------------------------------------------
# The solids of a STEP file: one, or several that are glued where they touch, each a region with its own name.
#
# A solid's name is that of its body in the file, else that of its part. Bodies' names do not come through Gmsh; they travel as
# colours, as faces' names do (`geometries.imported`).


NAMELESS = re.compile(r"Open CASCADE STEP translator.*|SOLID|COMPOUND|")


@dataclasses.dataclass(frozen=True)
class Solids:
    """Solids of the current Gmsh model.

    Attributes:
        regions: Volumes by region.
        pieces: For each of the file's surfaces, in their order, those that gluing made of it; empty if nothing was glued.
    """

    regions: dict[str, list[int]]
    pieces: tuple[tuple[int, ...], ...] = ()

    @property
    def tags(self) -> list[int]:
        return [tag for tags in self.regions.values() for tag in tags]

    @property
    def boundary(self) -> list[int]:
        """Surfaces that bound the union of the solids, without those between two of them."""
        volumes = [(3, tag) for tag in self.tags]
        return [abs(tag) for _, tag in gmsh.model.getBoundary(volumes, combined=len(volumes) > 1, oriented=False)]

    @property
    def volume(self) -> float:
        """Volume in m3."""
        return sum(float(gmsh.model.occ.getMass(3, tag)) for tag in self.tags)

    @property
    def centre(self) -> np.ndarray:
        """Centre of mass in m, shape (3,)."""
        masses = [gmsh.model.occ.getMass(3, tag) for tag in self.tags]
        return np.average([gmsh.model.occ.getCenterOfMass(3, tag) for tag in self.tags], axis=0, weights=masses)

    def holds(self, place: list[float]) -> bool:
        """Return whether a point (m) lies in the solid."""
        return any(gmsh.model.isInside(3, tag, place) for tag in self.tags)


def glued(part: ImportedActuator) -> Solids:
    """Return the solids of the current Gmsh model, read from a part's file, glued where they touch.

    Raises:
        GeometryError: There is none; they overlap; or one touches no other.
    """
    volumes = gmsh.model.getEntities(3)
    if len(volumes) == 1:
        return Solids({MAIN: [volumes[0][1]]})
    if not volumes:
        raise GeometryError(f"file {part.file} holds no solid, but {len(gmsh.model.getEntities(2))} faces")
    names = _names(part.file, volumes)
    surfaces = gmsh.model.getEntities(2)
    _, made = gmsh.model.occ.fragment(volumes, surfaces)
    gmsh.model.occ.synchronize()
    regions: dict[str, list[int]] = defaultdict(list)
    owner: dict[int, str] = {}
    for name, found in zip(names, made, strict=False):
        for _, tag in found:
            if tag in owner:
                raise GeometryError(
                    f"file {part.file}: the solids {owner[tag]} and {name} overlap; cut one by the other"
                )
            owner[tag] = name
            regions[name].append(tag)
    pieces = tuple(tuple(tag for _, tag in found) for found in made[len(volumes) :])
    solids = Solids(dict(regions), pieces)
    _check_touching(part, solids, owner)
    return solids


def _names(file: str, volumes: list[tuple[int, int]]) -> list[str]:
    """Return the names of the regions of a file's solids, in the order of the volumes."""
    found = []
    for number, (own, volume) in enumerate(zip(solid_names(file), volumes, strict=True), 1):
        label = str(gmsh.model.getEntityName(*volume)).rpartition("/")[2]
        text = next((text for text in (own, label) if not NAMELESS.fullmatch(text)), f"solid {number}")
        found.append(region_name(text))
    return found


def _check_touching(part: ImportedActuator, solids: Solids, owner: dict[int, str]) -> None:
    """Reject a solid that shares no face with those that the first one is connected with."""
    beside = defaultdict(set)
    for tag in solids.tags:
        for _, face in gmsh.model.getBoundary([(3, tag)], oriented=False):
            beside[face].add(tag)
    reached, left = {solids.tags[0]}, set(solids.tags[1:])
    while new := {tag for both in beside.values() if both & reached for tag in both & left}:
        reached |= new
        left -= new
    if left:
        names = ", ".join(sorted({owner[tag] for tag in left}))
        raise GeometryError(
            f"file {part.file}: {names} shares no face with {owner[solids.tags[0]]}; the solids of a part are bonded, so they "
            "have to touch"
        )


# ----------------------------------------------------------------------------------------------------------------------
# What each face of a STEP part does: cut plane, wall of a cavity, support, or just its outside.
#
# A cavity is found from a point in its air or from faces of its wall. Take away the faces on the cut planes: the walls that
# hang together by their edges are then the outside or one cavity each, and the wall nearest to the point is that of its own
# cavity, since the straight way there crosses no other. So a cavity is open only on cut planes; one with an inlet is connected
# with the outside.


def extent() -> float:
    """Return the diagonal of the current Gmsh model's box in m."""
    low, high = np.array(gmsh.model.getBoundingBox(-1, -1)).reshape(2, 3)
    return float(np.linalg.norm(high - low))


def _near() -> float:
    """Return what counts as the same place in m: Gmsh's boxes are wider by its tolerance."""
    return 1e-5 * extent()


def find_roles(part: ImportedActuator, solids: Solids) -> dict[str, list[int]]:
    """Return the surfaces of the current Gmsh model by role; every surface has one.

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
    for i, text in enumerate(part.cavities[: part.cavity_count]):
        by_point = re.match(r"\s*at\b", text)
        wall = _around(pieces, solids, text) if by_point else _with_faces(pieces, part, text, left, solids)
        if set(outside) & set(wall):
            raise GeometryError(
                f"cavities has {text!r}; that is outside the part, or its cavity is open to the outside"
            )
        if not set(wall) <= set(left):
            raise GeometryError(f"cavities has {text!r}; that cavity is already selected")
        roles[cavity_role(i)] = wall
        left = [tag for tag in left if tag not in wall]
    patches = [(name, "surfaces", text) for name, text in part.patches.items()]
    for role, field, text in (("support", "support", part.support), *patches):
        if text:
            roles[role] = _some(part, field, f"{field} is {text!r}", text, left, solids)
            left = [tag for tag in left if tag not in roles[role]]
    return {name: tags for name, tags in {**roles, "outer": left}.items() if tags}


def _some(part: ImportedActuator, field: str, what: str, text: str, left: list[int], solids: Solids) -> list[int]:
    """Return the faces among ``left`` that a text picks; there must be some."""
    found = chosen(field, faces(field, text), left, _near(), part.file, solids.pieces)
    if not found:
        low, high = np.array(gmsh.model.getBoundingBox(-1, -1)).reshape(2, 3) * 1e3
        spans = ", ".join(f"{name} {a:.4g} to {b:.4g}" for name, a, b in zip(AXES, low, high, strict=True))
        raise GeometryError(
            f"{what}; the part has no such face, or it already belongs to a cut plane or a cavity (it spans {spans} mm)"
        )
    return found


def _in_cut_plane(part: ImportedActuator, text: str, left: list[int], solids: Solids) -> list[int]:
    """Return all faces in the plane of those that a text picks, which must go through the origin."""
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
    """Return the unit normal of the plane nearest to some surfaces."""
    points = np.concatenate([surface_points(tag) for tag in tags])
    normal: np.ndarray = np.linalg.svd(points - points.mean(axis=0))[2][2]
    return np.round(normal, 12) + 0.0  # square to an axis means so, without -0


def outward(part: ImportedActuator, solids: Solids, roles: dict[str, list[int]]) -> tuple[Vector, ...]:
    """Return the unit normals of the cut planes, away from the solid; the surfaces of the current Gmsh model are meshed.

    Raises:
        GeometryError: A plane that does not bound the part, or planes between which its images do not fill the whole.
    """
    centre = solids.centre
    points = gmsh.model.mesh.getNodes()[1].reshape(-1, 3)
    normals = []
    for i, text in enumerate(part.planes):
        normal = _fitted_normal(roles[f"plane{i}"])
        normal = np.where(normal @ centre > 0, -normal, normal) + 0.0
        if (points @ normal).max() > _near():
            raise GeometryError(f"planes has {text!r}; the part extends to both sides of it, so it is not cut there")
        x, y, z = (float(value) for value in normal)
        normals.append((x, y, z))
    check_slice(normals, part.planes)
    return tuple(normals)


def _pieces(tags: list[int]) -> list[list[int]]:
    """Return the faces that are connected by their edges."""
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
    """Return the piece of wall nearest to a point in the air."""
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
    """Return the piece of wall that the picked faces belong to, or several if they do."""
    picked = _some(part, "cavities", f"cavities has {text!r}", text, left, solids)
    return [tag for piece in pieces if set(piece) & set(picked) for tag in piece]


def _size(piece: list[int]) -> float:
    return float(np.linalg.norm(np.ptp(_box(piece), axis=0)))


def _box(piece: list[int]) -> np.ndarray:
    """Return the lowest and highest corner of some faces' box in m, shape (2, 3)."""
    boxes = np.array([gmsh.model.occ.getBoundingBox(2, tag) for tag in piece])
    return np.array([boxes[:, :3].min(axis=0), boxes[:, 3:].max(axis=0)])


# ----------------------------------------------------------------------------------------------------------------------
# A STEP file in Gmsh: its unit, its volumes, its mesh.


FINE = 40
"""Cells around a circle in the mesh of walls that the cavities' volumes are measured on."""


@functools.lru_cache(maxsize=32)
def read_part(part: ImportedActuator, digest: str) -> Reading:
    """Open the file, in a process of its own, and check every choice against it.

    Args:
        part: The part.
        digest: Hash of the file's bytes: another content is another reading.

    Raises:
        GeometryError: A file or a choice that makes no device.
    """
    try:
        return apart(_read_step, part)
    except MeshingError as error:
        raise GeometryError(f"file {part.file} cannot be read: {error}") from None


def _read_step(part: ImportedActuator) -> Reading:
    with private_model():
        solids = open_part(part)
        roles = find_roles(part, solids)
        expected = expected_triangles(solids.boundary, part.cell_size, max(part.curvature, FINE))
        if expected > MOST_TRIANGLES:
            raise GeometryError(
                f"cell_size is {shown(part.cell_size, 'm')} with curvature {part.curvature:g}; about {expected:.2g} triangles "
                f"are expected on the part's faces and {MOST_TRIANGLES:,} are allowed"
            )
        gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", FINE)
        gmsh.option.setNumber("Mesh.MeshSizeMax", part.cell_size)
        gmsh.model.mesh.generate(2)
        gmsh.model.mesh.setOrder(2)
        volumes = tuple(_enclosed(solids, roles[cavity_role(i)]) for i in range(part.cavity_count))
        return Reading(
            outward(part, solids, roles),
            _gauge(part, roles.get("support", [])),
            solids.volume,
            volumes,
            tuple(solids.regions) if len(solids.regions) > 1 else (),
        )


def build_part(part: ImportedActuator) -> None:
    """Fill the current Gmsh model with the part, its roles and its cell sizes (m)."""
    solids = open_part(part)
    for name, tags in solids.regions.items():
        gmsh.model.addPhysicalGroup(3, tags, name=name)
    for role, tags in find_roles(part, solids).items():
        gmsh.model.addPhysicalGroup(2, tags, name=role)
    gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", part.curvature)
    gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 1)
    gmsh.model.mesh.setSizeCallback(lambda dim, tag, x, y, z, other: min(other, part.cell_size))


def open_part(part: ImportedActuator, unit: str = "M") -> Solids:
    """Read the file in metres, or another of the CAD kernel's units, whatever its own; its solids are glued."""
    gmsh.option.setString("Geometry.OCCTargetUnit", unit)
    gmsh.option.setNumber("Geometry.OCCImportLabels", 1)
    try:
        gmsh.model.occ.importShapes(part.file, format="step")
        gmsh.model.occ.synchronize()
    except Exception as error:  # Gmsh raises bare Exception
        raise GeometryError(
            f"file {part.file} cannot be read as STEP ({str(error).strip() or 'no reason given'})"
        ) from None
    return glued(part)


def _enclosed(solids: Solids, tags: list[int]) -> float:
    """Volume within a wall by the divergence theorem on its mesh, -1/3 int x . n: cut planes through the origin add nothing."""
    total = 0.0
    for tag in tags:
        for kind in gmsh.model.mesh.getElementTypes(2, tag):
            local, weights = gmsh.model.mesh.getIntegrationPoints(kind, "Gauss4")
            jacobians, determinants, places = gmsh.model.mesh.getJacobians(kind, local, tag)
            normals, at = jacobians.reshape(-1, 3, 3)[:, 2], places.reshape(-1, 3)
            # A face's mesh may be turned either way; the solid lies behind its outward normal.
            turned = 1.0 if solids.holds(list(at[0] - 1e-4 * extent() * normals[0])) else -1.0
            along = np.einsum("ij,ij->i", at, normals) * determinants
            total -= turned * float((along.reshape(-1, len(weights)) @ weights).sum()) / 3.0
    return total


def _gauge(part: ImportedActuator, support: list[int]) -> Vector:
    """Return the corner nearest to the wanted point, or the one farthest from the held faces, or from the origin."""
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
        held = np.mean([gmsh.model.occ.getCenterOfMass(2, tag) for tag in support] or [np.zeros(3)], axis=0)
        x, y, z = corners[np.linalg.norm(corners - held, axis=1).argmax()]
    return float(x), float(y), float(z)


@register_device
@dataclasses.dataclass(frozen=True, kw_only=True)
class ImportedActuator(ImportedPart):
    """A part from a STEP file, whose own unit counts; see `ImportedPart`.

    Several solids that touch are glued, and each is a region of its own name.
    """

    cell_size: float = length_field(0.003, "longest edge of the cells", shape=False)
    curvature: float = number_field(10.0, "cells around a full circle", shape=False)
    order: int = choice_field(2, (1, 2), "order of the cells' geometry: 1 straight, 2 curved edges")

    kind: ClassVar[str] = "STEP file (--file part.step)"

    def check_cells(self) -> None:
        if not 4.0 <= self.curvature <= 100.0:
            raise GeometryError(f"curvature is {self.curvature:g}; it must be between 4 and 100 cells around a circle")

    @property
    def reading(self) -> Reading:
        return read_part(self, self.digest())

    @property
    def regions(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names of the file's solids, if there are several."""
        return self.reading.regions

    @property
    def mesh_order(self) -> int:
        return self.order

    def cast_along(self, pull: Vector | None, level: float | None) -> Recipe:
        if pull is None:
            raise GeometryError("the mould of this part needs its opening direction, such as --pull '0, 0, 1'")
        return in_halves(pull, level, f"The mould opens along {', '.join(f'{x:g}' for x in pull)}.")

    def build_whole(self) -> None:
        if self.planes:
            raise GeometryError(
                f"file {self.file} draws one of {self.copies} equal pieces, cut on its planes; draw the whole part"
            )
        if len(open_part(self, "MM").tags) > 1:
            raise GeometryError(f"file {self.file} has several solids; a mould needs a part of a single solid")

    def build(self) -> None:
        build_part(self)
