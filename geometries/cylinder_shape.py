"""The closed tube in Gmsh: one profile of two faces, meshed flat or turned around the axis."""

from __future__ import annotations

import itertools
import math
from collections import defaultdict
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from geometries.cylinder_checks import azimuths, cell_sizes
from geometries.errors import MeshingError

if TYPE_CHECKING:
    from geometries.cylinder import Cylinder

GROWTH = 0.5
"""Growth of the cell size per distance from the fillet and the cap."""

Edges = list[tuple[int, str]]


def build_section(device: Cylinder) -> None:
    """Fill the current Gmsh model with the axisymmetric profile: x is the radius, y the height (m)."""
    import gmsh  # type: ignore[import-untyped]

    (wall, cap), edges = _profile(device, lambda r, z: (r, z, 0.0))
    gmsh.model.occ.synchronize()
    roles: dict[str, list[int]] = defaultdict(list)
    for tag, role in edges:
        roles[role].append(tag)
    _name(2, {"wall": [wall], "cap": [cap]})
    _name(1, roles)
    size = _size(device)
    gmsh.model.mesh.setSizeCallback(lambda dim, tag, x, y, z, other: size(x, y))


def build_solid(device: Cylinder) -> None:
    """Fill the current Gmsh model with half of the tube (y > 0) or all of it (m)."""
    import gmsh

    occ = gmsh.model.occ
    (wall, cap), _ = _profile(device, lambda r, z: (r, 0.0, z))
    volumes = []
    # The strip's edges cut the wall alone: wedges of the cap would have needles for cells along the axis.
    for face, cuts in ((wall, azimuths(device, device.stripped)), (cap, azimuths(device, False))):
        for start, stop in itertools.pairwise(cuts):
            copy = occ.copy([(2, face)])
            occ.rotate(copy, 0, 0, 0, 0, 0, 1, math.radians(start))
            turned = occ.revolve(copy, 0, 0, 0, 0, 0, 1, math.radians(stop - start))
            volumes += [entity for entity in turned if entity[0] == 3]
    occ.fragment(volumes[:1], volumes[1:])
    occ.remove([(2, wall), (2, cap)], recursive=True)
    occ.synchronize()
    _name_solids(device)
    _name_faces(device)
    for role, place in device.anchors.items():
        near = 1e-7 * device.outer_radius
        found = [tag for _, tag in gmsh.model.getEntities(0) if np.abs(_place(tag) - place).max() < near]
        _name(0, {role: found})
    size = _size(device)
    gmsh.model.mesh.setSizeCallback(lambda dim, tag, x, y, z, other: size(math.hypot(x, y), z))


def _profile(
    device: Cylinder, at: Callable[[float, float], tuple[float, float, float]]
) -> tuple[tuple[int, int], Edges]:
    """Add the wall's and the cap's face; return their tags, and the edges on the boundary with their roles.

    Args:
        device: The tube.
        at: Makes a point in space of radius and height.
    """
    import gmsh

    occ = gmsh.model.occ
    inner, outer, fillet = device.inner_radius, device.outer_radius, device.fillet
    straight, length, height = device.straight, device.length, device.height

    def point(r: float, z: float) -> int:
        return int(occ.addPoint(*at(r, z)))

    foot, toe, middle = point(inner, 0.0), point(outer, 0.0), point(outer, 0.5 * length)
    shoulder, root = point(outer, straight), point(inner, straight)
    rim, apex, ceiling = point(outer, height), point(0.0, height), point(0.0, length)
    joint = occ.addLine(shoulder, root)
    edges: Edges = [
        (occ.addLine(foot, toe), "support"),
        (occ.addLine(toe, middle), "outer"),
        (occ.addLine(middle, shoulder), "outer"),
        (occ.addLine(root, foot), "cavity"),
    ]
    wall = occ.addPlaneSurface([occ.addCurveLoop([*(tag for tag, _ in edges[:3]), joint, edges[3][0]])])
    upper: Edges = [
        (occ.addLine(shoulder, rim), "side"),
        (occ.addLine(rim, apex), "end"),
        (occ.addLine(apex, ceiling), "axis"),
    ]
    corner = root
    if fillet:
        corner, centre = point(inner - fillet, length), point(inner - fillet, straight)
        arc = [(occ.addCircleArc(corner, centre, root), "cavity")]
        occ.remove([(0, centre)])
    else:
        arc = []
    upper += [(occ.addLine(ceiling, corner), "cavity"), *arc]
    cap = occ.addPlaneSurface([occ.addCurveLoop([-joint, *(tag for tag, _ in upper)])])
    return (wall, cap), [*edges, *upper]


def _size(device: Cylinder) -> Callable[[float, float], float]:
    """Return the cell size in m as a function of radius and height in m."""
    wall, cap, arc = cell_sizes(device)
    ring = (device.inner_radius - 0.3 * device.fillet, device.length - 0.3 * device.fillet)

    def size(r: float, z: float) -> float:
        above = max(0.0, z - device.straight)
        return min(
            wall + GROWTH * above,
            cap + GROWTH * max(0.0, device.length - z),
            arc + GROWTH * max(0.0, math.hypot(r - ring[0], z - ring[1]) - device.fillet),
        )

    return size


def _name_solids(device: Cylinder) -> None:
    import gmsh

    regions: dict[str, list[int]] = defaultdict(list)
    for _, tag in gmsh.model.getEntities(3):
        above = gmsh.model.occ.getCenterOfMass(3, tag)[2] > device.straight
        regions["cap" if above else "wall"].append(tag)
    _name(3, regions)


def _name_faces(device: Cylinder) -> None:
    """Give every face on the boundary of the solid one role; faces between pieces get none."""
    import gmsh

    roles: dict[str, list[int]] = defaultdict(list)
    for _, tag in gmsh.model.getEntities(2):
        if len(gmsh.model.getAdjacencies(2, tag)[0]) == 1:
            roles[_role(device, tag)].append(tag)
    _name(2, roles)


def _role(device: Cylinder, tag: int) -> str:
    """Return the role of a face from where its corners and its centre of mass are."""
    import gmsh

    near = 1e-7 * device.outer_radius
    corners = gmsh.model.getBoundary([(2, tag)], combined=False, oriented=False, recursive=True)
    x, y, z = np.array([_place(point) for _, point in corners]).T
    centre = np.array(gmsh.model.occ.getCenterOfMass(2, tag))
    if device.section == "half" and max(np.abs(y).max(), abs(centre[1])) < near:
        return "plane0"
    for role, height in (("support", 0.0), ("end", device.height)):
        if np.abs(z - height).max() < near:
            return role
    if np.abs(np.hypot(x, y) - device.outer_radius).max() > near:
        return "cavity"
    if centre[2] > device.straight:
        return "side"
    azimuth = math.degrees(math.atan2(centre[1], centre[0]))
    return "strip" if device.stripped and abs(azimuth) < 0.5 * device.strip else "outer"


def _place(tag: int) -> np.ndarray:
    import gmsh

    return np.array(gmsh.model.getValue(0, tag, []))


def _name(dimension: int, roles: dict[str, list[int]]) -> None:
    import gmsh

    for role, tags in roles.items():
        if not tags:
            raise MeshingError(f"The shape has no place for {role!r}; please report this with the parameters")
        gmsh.model.addPhysicalGroup(dimension, tags, name=role)
