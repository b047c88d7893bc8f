"""The hollow disk in Gmsh: one outline, meshed flat or turned around the axis."""

from __future__ import annotations

import math
from collections import defaultdict
from typing import TYPE_CHECKING

import numpy as np

from geometries.disk_cells import size_function
from geometries.disk_outline import Edge, Place, outline
from geometries.errors import MeshingError

if TYPE_CHECKING:
    from geometries.disk import HollowDisk

WIDEST_PIECE = 90.0
"""Largest angle in degrees turned at once: the CAD kernel leaves a seam in a full turn, and no vertex at its centre."""


MM = 1e3
"""Millimetres in one metre."""


def build_profile(disk: HollowDisk) -> None:
    """Fill the current Gmsh model with the axisymmetric profile: x is the radius, y the height (m)."""
    import gmsh  # type: ignore[import-untyped]

    face, curves, points = _face(disk, (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    gmsh.model.occ.synchronize()
    _name(2, [face], "solid")
    for role, tags in curves.items():
        _name(1, tags, role)
    if disk.support == "rim":
        _name(0, [points[disk.outer_radius, 0.0]], "support")
    size = size_function(disk)
    gmsh.model.mesh.setSizeCallback(lambda dim, tag, x, y, z, other: size(x, y))


def build_wedge(disk: HollowDisk) -> None:
    """Fill the current Gmsh model with the slice from the azimuth to azimuth + angle (m)."""
    import gmsh

    occ = gmsh.model.occ
    face, _, _ = _face(disk, disk.radial, disk.lift)
    pieces = math.ceil(disk.angle / WIDEST_PIECE - 1e-9)
    volumes = []
    for _ in range(pieces):
        turned = occ.revolve([(2, face)], 0, 0, 0, 0, 0, 1, math.radians(disk.angle / pieces))
        face = turned[0][1]
        volumes += [entity for entity in turned if entity[0] == 3]
    if pieces > 1:
        volumes = [entity for entity in occ.fragment(volumes[:1], volumes[1:])[0] if entity[0] == 3]
    occ.synchronize()
    _name(3, [tag for _, tag in volumes], "solid")
    _name_surfaces(disk)
    if disk.support == "rim":
        _name_rim(disk)
    size = size_function(disk)
    gmsh.model.mesh.setSizeCallback(lambda dim, tag, x, y, z, other: size(math.hypot(x, y), z))


def build_full_turn(disk: HollowDisk) -> None:
    """Fill the current Gmsh model with the whole disk in mm, one solid."""
    import gmsh

    face, _, _ = _face(disk, (MM, 0.0, 0.0), (0.0, 0.0, MM))
    gmsh.model.occ.revolve([(2, face)], 0, 0, 0, 0, 0, 1, 2.0 * math.pi)
    gmsh.model.occ.remove([(2, face)], recursive=True)
    gmsh.model.occ.synchronize()


def _face(
    disk: HollowDisk, right: tuple[float, float, float], up: tuple[float, float, float]
) -> tuple[int, dict[str, list[int]], dict[Place, int]]:
    """Add the half profile in the plane of two vectors of a metre each; return its tag, curves by role and corners."""
    import gmsh

    occ = gmsh.model.occ
    points: dict[Place, int] = {}

    def corner(place: Place) -> int:
        if place not in points:
            points[place] = occ.addPoint(*(place[0] * a + place[1] * b for a, b in zip(right, up, strict=True)))
        return points[place]

    def curve(edge: Edge) -> int:
        if edge.inner is not None:
            helpers.extend(edge.inner)
            return int(occ.addBezier([corner(place) for place in (edge.start, *edge.inner, edge.end)]))
        if edge.centre is not None:
            helpers.append(edge.centre)
            return int(occ.addCircleArc(corner(edge.start), corner(edge.centre), corner(edge.end)))
        return int(occ.addLine(corner(edge.start), corner(edge.end)))

    curves: dict[str, list[int]] = defaultdict(list)
    helpers: list[Place] = []
    loop = []
    for edge in outline(disk):
        loop.append(curve(edge))
        curves[edge.role].append(loop[-1])
    face = occ.addPlaneSurface([occ.addCurveLoop(loop)])
    # Centres of fillets and the like would otherwise stay as lone nodes of the mesh.
    occ.remove([(0, points[place]) for place in helpers])
    return face, curves, points


def _name_surfaces(disk: HollowDisk) -> None:
    """Give every face on the boundary of the solid one role; faces between pieces get none."""
    import gmsh

    roles: dict[str, list[int]] = defaultdict(list)
    for _, tag in gmsh.model.getEntities(2):
        if len(gmsh.model.getAdjacencies(2, tag)[0]) == 1:
            roles[_surface_role(disk, tag)].append(tag)
    for role, tags in roles.items():
        _name(2, tags, role)


def _surface_role(disk: HollowDisk, tag: int) -> str:
    """Return the role of a face from where its corners and its centre of mass are."""
    import gmsh

    near = 1e-8 * disk.outer_radius
    centre = np.array(gmsh.model.occ.getCenterOfMass(2, tag))
    corners = _corners(2, tag)
    for plane, outward in zip(disk.cut_planes, (1.0, -1.0), strict=False):
        normal = np.array(plane.normal)
        # Half a disk has both planes in one; the slice's planes are told apart by the side of the axis they lie on.
        along = outward * np.cross(disk.lift, normal)
        if np.abs(corners @ normal).max() < near and abs(centre @ normal) < near and centre @ along > 0.0:
            return plane.name
    ends = np.column_stack([np.hypot(corners[:, 0], corners[:, 1]), corners[:, 2]])

    def apart(edge: Edge) -> float:
        """How far the face is from being the edge turned: both have the same ends."""
        distances = np.linalg.norm(ends[:, None] - np.array([edge.start, edge.end]), axis=2)
        return float(max(distances.min(axis=0).max(), distances.min(axis=1).max()))

    return min(outline(disk), key=apart).role


def _name_rim(disk: HollowDisk) -> None:
    """Name the bottom's outer edge and, where rigid motions remain, the anchors."""
    import gmsh

    near = 1e-8 * disk.outer_radius
    rim = []
    for _, tag in gmsh.model.getEntities(1):
        corners = _corners(1, tag)
        radii = np.hypot(corners[:, 0], corners[:, 1])
        if np.abs(corners[:, 2]).max() < near and np.abs(radii - disk.outer_radius).max() < near:
            rim.append(tag)
    _name(1, rim, "support")
    places = {"anchor0": np.zeros(3), "anchor1": disk.outer_radius * np.array(disk.radial)}
    for role in {hold.role for hold in disk.holds if hold.point}:
        found = [tag for _, tag in gmsh.model.getEntities(0) if np.abs(_place(tag) - places[role]).max() < near]
        _name(0, found, role)


def _place(tag: int) -> np.ndarray:
    import gmsh

    return np.array(gmsh.model.getValue(0, tag, []))


def _corners(dimension: int, tag: int) -> np.ndarray:
    """Return the corner points of a curve or a face, shape (n, 3)."""
    import gmsh

    found = gmsh.model.getBoundary([(dimension, tag)], combined=False, oriented=False, recursive=True)
    return np.array([_place(point) for _, point in found])


def _name(dimension: int, tags: list[int], role: str) -> None:
    import gmsh

    if not tags:
        raise MeshingError(f"The shape has no place for {role!r}; please report this with the parameters")
    gmsh.model.addPhysicalGroup(dimension, tags, name=role)
