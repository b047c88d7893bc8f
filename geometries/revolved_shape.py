"""Bodies of revolution in Gmsh: panels meshed in rows, or turned around the axis and meshed freely."""

from __future__ import annotations

import math
from collections import defaultdict
from typing import TYPE_CHECKING

import numpy as np

from geometries.errors import MeshingError
from geometries.panels import Panel, Place, Side

if TYPE_CHECKING:
    from geometries.revolved import Revolved

WIDEST_PIECE = 90.0
"""Largest angle in degrees turned at once: the CAD kernel leaves a seam in a full turn."""

AXIS = "axis"


class Drawing:
    """The panels of a half section in the current Gmsh model.

    Args:
        panels: The half section.
        up: Unit vector of the height; the radius runs along x.

    Attributes:
        faces: Tags by region.
        curves: Tags by what a side joins.
        points: Tags by place.
    """

    def __init__(self, panels: tuple[Panel, ...], up: tuple[float, float, float]):
        import gmsh  # type: ignore[import-untyped]

        self.up, self.occ = up, gmsh.model.occ
        self.points: dict[Place, int] = {}
        self.curves: dict[frozenset[Place], int] = {}
        self.sides: dict[frozenset[Place], Side] = {}
        self.faces: dict[str, list[int]] = defaultdict(list)
        for panel in panels:
            loop = self.occ.addCurveLoop([self._curve(side) for side in panel.sides])
            self.faces[panel.region].append(self.occ.addPlaneSurface([loop]))

    def corner(self, place: Place) -> int:
        if place not in self.points:
            self.points[place] = self._point(place)
        return self.points[place]

    def _point(self, place: Place) -> int:
        r, z = place
        return int(self.occ.addPoint(r + z * self.up[0], z * self.up[1], z * self.up[2]))

    def _curve(self, side: Side) -> int:
        if side.key not in self.curves:
            self.sides[side.key] = side
            self.curves[side.key] = self._line(side) if side.centre is None else self._arc(side)
        elif side.role:
            self.sides[side.key] = side
        return self.curves[side.key]

    def _line(self, side: Side) -> int:
        return int(self.occ.addLine(self.corner(side.start), self.corner(side.end)))

    def _arc(self, side: Side) -> int:
        """A piece of an ellipse as what it is, a rational parabola: the kernel's own ellipses ask for their longer axis."""
        middle, weight = side.control
        helper = self._point(middle)
        points = [self.corner(side.start), helper, self.corner(side.end)]
        tag = self.occ.addBSpline(points, degree=2, weights=[1.0, weight, 1.0], knots=[0.0, 1.0], multiplicities=[3, 3])
        self.occ.remove([(0, helper)])
        return int(tag)


def build_section(device: Revolved) -> None:
    """Fill the current Gmsh model with the axisymmetric profile: x is the radius, y the height (m)."""
    import gmsh

    drawing = Drawing(device.panels, (0.0, 1.0, 0.0))
    gmsh.model.occ.synchronize()
    for region, faces in drawing.faces.items():
        _name(2, faces, region)
        for face in faces:
            gmsh.model.mesh.setTransfiniteSurface(face)
    roles: dict[str, list[int]] = defaultdict(list)
    for key, tag in drawing.curves.items():
        side = drawing.sides[key]
        gmsh.model.mesh.setTransfiniteCurve(tag, side.cells + 1, "Progression", side.growth)
        if side.role:
            roles[side.role].append(tag)
    for role, tags in roles.items():
        _name(1, tags, role)
    for role, place in device.anchors.items():
        _name(0, [drawing.points[place]], role)


def build_wedge(device: Revolved) -> None:
    """Fill the current Gmsh model with the slice from the azimuth 0 to the device's angle (m)."""
    import gmsh

    occ = gmsh.model.occ
    drawing = Drawing(device.panels, (0.0, 0.0, 1.0))
    regions = [region for region, faces in drawing.faces.items() for _ in faces]
    faces = [face for tags in drawing.faces.values() for face in tags]
    pieces = math.ceil(device.angle / WIDEST_PIECE - 1e-9)
    turn, solids = math.radians(device.angle / pieces), []
    owners: list[str] = []
    for piece in range(pieces):
        copies = occ.copy([(2, face) for face in faces]) if piece else [(2, face) for face in faces]
        if piece:
            occ.rotate(copies, 0, 0, 0, 0, 0, 1, piece * turn)
        for region, copy in zip(regions, copies, strict=True):
            solids += [entity for entity in occ.revolve([copy], 0, 0, 0, 0, 0, 1, turn) if entity[0] == 3]
            owners.append(region)
    _, parents = occ.fragment(solids, [])
    occ.synchronize()
    volumes: dict[str, list[int]] = defaultdict(list)
    for region, made in zip(owners, parents, strict=True):
        volumes[region] += [tag for dimension, tag in made if dimension == 3]
    for region, tags in volumes.items():
        _name(3, tags, region)
    _name_surfaces(device)
    for role, (r, z) in device.anchors.items():
        near = np.linalg.norm([_at(tag) - (r, 0.0, z) for _, tag in gmsh.model.getEntities(0)], axis=1)
        _name(0, [gmsh.model.getEntities(0)[int(near.argmin())][1]], role)
    size = device.wedge_size
    gmsh.model.mesh.setSizeCallback(lambda *_: size)


def _name_surfaces(device: Revolved) -> None:
    """Give every face on the boundary of the solid one role; faces between panels get none."""
    import gmsh

    roles: dict[str, list[int]] = defaultdict(list)
    for _, tag in gmsh.model.getEntities(2):
        if len(gmsh.model.getAdjacencies(2, tag)[0]) == 1:
            roles[_surface_role(device, tag)].append(tag)
    for role, tags in roles.items():
        _name(2, tags, role)


def _surface_role(device: Revolved, tag: int) -> str:
    """Role of a face: the cut plane in which it lies, or the side of which it is the turn."""
    import gmsh

    near = 1e-7 * device.size
    corners = _corners(tag)
    centre = np.array(gmsh.model.occ.getCenterOfMass(2, tag))
    for plane, outward in zip(device.cut_planes, (1.0, -1.0), strict=False):
        normal = np.array(plane.normal)
        # Half a device has both planes in one; the slice's planes are told apart by the side of the axis they lie on.
        along = outward * np.cross(device.lift, normal)
        if np.abs(corners @ normal).max() < near and abs(centre @ normal) < near and centre @ along > 0.0:
            return plane.name
    ends = np.unique(np.round(np.column_stack([np.hypot(corners[:, 0], corners[:, 1]), corners[:, 2]]) / near), axis=0)
    sides = [side for side in device.sides if side.role != AXIS]

    def apart(side: Side) -> float:
        """How far the face is from being the side turned: both have the same ends."""
        distances = np.linalg.norm(ends[:, None] * near - np.array([side.start, side.end]), axis=2)
        return float(max(distances.min(axis=0).max(), distances.min(axis=1).max()))

    return min(sides, key=apart).role


def _corners(tag: int) -> np.ndarray:
    """Corner points of a face, shape (n, 3)."""
    import gmsh

    found = gmsh.model.getBoundary([(2, tag)], combined=False, oriented=False, recursive=True)
    return np.array([_at(point) for _, point in found])


def _at(point: int) -> np.ndarray:
    import gmsh

    return np.array(gmsh.model.getValue(0, point, []))


def _name(dimension: int, tags: list[int], role: str) -> None:
    import gmsh

    if not tags:
        raise MeshingError(f"The shape has no place for {role!r}; please report this with the parameters")
    gmsh.model.addPhysicalGroup(dimension, tags, name=role)
