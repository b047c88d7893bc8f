"""The hollow disk in Gmsh: one outline, meshed flat or turned around the axis."""

from __future__ import annotations

import math
from collections import defaultdict
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from geometries.disk_cells import size_function
from geometries.errors import MeshingError

if TYPE_CHECKING:
    from geometries.disk import HollowDisk

Place = tuple[float, float]

WIDEST_PIECE = 90.0
"""Largest angle in degrees turned at once: the CAD kernel leaves a seam in a full turn, and no vertex at its centre."""


class Edge(NamedTuple):
    """An edge of the half profile from ``start`` to ``end`` in (radius, height), round about ``centre`` if given."""

    role: str
    start: Place
    end: Place
    centre: Place | None = None


def outline(disk: HollowDisk) -> list[Edge]:
    """Return the closed half profile in m, counted against the clock from the bottom centre."""
    inner, outer, fillet, lower = disk.cavity_radius, disk.outer_radius, disk.fillet, disk.base_fillet
    floor, ceiling, top = disk.base, disk.ceiling, disk.height
    arc = [Edge("cavity", (inner - fillet, ceiling), (inner, ceiling - fillet), (inner - fillet, ceiling - fillet))]
    foot = [Edge("cavity", (inner, floor + lower), (inner - lower, floor), (inner - lower, floor + lower))]
    return [
        Edge("support" if disk.support == "base" else "outer", (0.0, 0.0), (outer, 0.0)),
        Edge("outer", (outer, 0.0), (outer, top)),
        Edge("top", (outer, top), (0.0, top)),
        Edge("axis", (0.0, top), (0.0, ceiling)),
        Edge("cavity", (0.0, ceiling), (inner - fillet, ceiling)),
        *(arc if fillet > 0.0 else []),
        Edge("cavity", (inner, ceiling - fillet), (inner, floor + lower)),
        *(foot if lower > 0.0 else []),
        Edge("cavity", (inner - lower, floor), (0.0, floor)),
        Edge("axis", (0.0, floor), (0.0, 0.0)),
    ]


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


def _face(
    disk: HollowDisk, right: tuple[float, float, float], up: tuple[float, float, float]
) -> tuple[int, dict[str, list[int]], dict[Place, int]]:
    """Add the half profile in the plane of two unit vectors; return its tag, its curves by role and its corners."""
    import gmsh

    occ = gmsh.model.occ
    points: dict[Place, int] = {}

    def corner(place: Place) -> int:
        if place not in points:
            points[place] = occ.addPoint(*(place[0] * a + place[1] * b for a, b in zip(right, up, strict=True)))
        return points[place]

    curves: dict[str, list[int]] = defaultdict(list)
    loop = []
    for edge in outline(disk):
        if edge.centre is None:
            curve = occ.addLine(corner(edge.start), corner(edge.end))
        else:
            curve = occ.addCircleArc(corner(edge.start), corner(edge.centre), corner(edge.end))
        curves[edge.role].append(curve)
        loop.append(curve)
    face = occ.addPlaneSurface([occ.addCurveLoop(loop)])
    # The centre of the fillet would otherwise stay as a lone node of the mesh.
    occ.remove([(0, points[edge.centre]) for edge in outline(disk) if edge.centre is not None])
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
    heights, radii = corners[:, 2], np.hypot(corners[:, 0], corners[:, 1])
    if np.abs(heights).max() < near:
        return "support" if disk.support == "base" else "outer"
    if np.abs(heights - disk.height).max() < near:
        return "top"
    return "outer" if np.abs(radii - disk.outer_radius).max() < near else "cavity"


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
