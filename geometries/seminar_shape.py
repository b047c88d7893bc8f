"""The seminar actuator in Gmsh: half a slab, the channels cut out of it, mirrored if the full one is asked for."""

from __future__ import annotations

import functools
import math
from collections import defaultdict
from typing import TYPE_CHECKING

import numpy as np

from geometries.errors import MeshingError
from geometries.seminar_cells import size_function
from geometries.seminar_plan import Channel, angles, channel, side

if TYPE_CHECKING:
    from geometries.seminar import SeminarActuator

Entity = tuple[int, int]


def build_slab(slab: SeminarActuator) -> None:
    """Fill the current Gmsh model with the slab, its roles and its cell sizes (m)."""
    import gmsh  # type: ignore[import-untyped]

    occ = gmsh.model.occ
    solids = half_slab(slab)
    if slab.part == "full":
        mirrored = occ.copy(solids)
        occ.mirror(mirrored, 0.0, 1.0, 0.0, 0.0)
        solids = [entity for entity in occ.fragment(solids, mirrored)[0] if entity[0] == 3]
    occ.synchronize()
    _name_roles(slab, solids)
    size = size_function(slab)
    gmsh.model.mesh.setSizeCallback(lambda dim, tag, x, y, z, other: size(x, y, z))


@functools.lru_cache(maxsize=64)
def measured_volume(slab: SeminarActuator) -> float:
    """Volume in m3 of half the slab without its channels, by the CAD kernel."""
    import gmsh

    from geometries.meshing import private_model

    with private_model():
        return float(sum(gmsh.model.occ.getMass(*entity) for entity in half_slab(slab)))


def half_slab(slab: SeminarActuator) -> list[Entity]:
    """Add the half at y > 0 with the channels cut out; nothing is synchronised.

    Raises:
        MeshingError: The CAD kernel made something else than one solid.
    """
    import gmsh

    # The network may reach over the mirror plane: only what lies in the half is cut away.
    solids, _ = gmsh.model.occ.cut([_prism(slab)], _network(slab))
    if [dimension for dimension, _ in solids] != [3]:
        raise MeshingError(
            f"the CAD kernel made {len(solids)} solids of one slab; change manifold_bore or channel_bore a little"
        )
    return solids


def _prism(slab: SeminarActuator) -> Entity:
    """Half the slab without channels."""
    import gmsh

    occ = gmsh.model.occ
    bottom, radius = -0.5 * slab.thickness, slab.tip_radius
    _, (x, y) = side(slab)
    base, corner = occ.addPoint(0, 0, bottom), occ.addPoint(0, 0.5 * slab.base_width, bottom)
    tip = occ.addPoint(slab.length, 0, bottom)
    if radius > 0.0:
        turn, centre = occ.addPoint(x, y, bottom), occ.addPoint(slab.length - radius, 0, bottom)
        flank = [occ.addLine(turn, corner), occ.addCircleArc(tip, centre, turn)][::-1]
    else:
        flank = [occ.addLine(tip, corner)]
    loop = occ.addCurveLoop([occ.addLine(base, tip), *flank, occ.addLine(corner, base)])
    swept = occ.extrude([(2, occ.addPlaneSurface([loop]))], 0, 0, slab.thickness)
    return next(entity for entity in swept if entity[0] == 3)


def _network(slab: SeminarActuator) -> list[Entity]:
    """The air of all channels that reach into the half at y > 0, in one piece."""
    import gmsh

    lines = [channel(slab, angle) for angle in angles(slab) if angle > -1e-9]
    parts = [*_manifold(slab), *(_air(slab, line) for line in lines if line is not None)]
    return list(gmsh.model.occ.fuse(parts[:1], parts[1:])[0])


def _manifold(slab: SeminarActuator) -> list[Entity]:
    """The arc over the half's angle and a little more, and the round cap at its end."""
    import gmsh

    occ = gmsh.model.occ
    half = 0.5 * math.radians(slab.spread)
    begin = -0.1 * half  # across the mirror plane, so that the cut there is clean
    radius, bore, level = slab.manifold_radius, slab.manifold_bore, slab.offset
    c, s = math.cos(begin), math.sin(begin)
    section = occ.addDisk(radius * c, radius * s, level, bore, bore, zAxis=[-s, c, 0], xAxis=[c, s, 0])
    arc = occ.revolve([(2, section)], 0, 0, 0, 0, 0, 1, half - begin)
    c, s = math.cos(half), math.sin(half)
    cap = occ.addSphere(0, 0, 0, bore, angle1=0.0, angle2=0.5 * math.pi)
    # Its axis from z to the arc's direction at the end.
    occ.rotate([(3, cap)], 0, 0, 0, 1, 0, 0, -0.5 * math.pi)
    occ.rotate([(3, cap)], 0, 0, 0, 0, 0, 1, half)
    occ.translate([(3, cap)], radius * c, radius * s, level)
    return [next(entity for entity in arc if entity[0] == 3), (3, cap)]


def _air(slab: SeminarActuator, line: Channel) -> Entity:
    """A channel: its half profile turned around its ray."""
    import gmsh

    occ = gmsh.model.occ
    c, s = math.cos(line.angle), math.sin(line.angle)

    def corner(along: float, up: float) -> int:
        return int(occ.addPoint(along * c, along * s, slab.offset + up))

    begin, first = corner(line.start, 0.0), corner(line.start, line.bore)
    last, centre = corner(line.end, line.radius(line.end)), corner(line.centre, 0.0)
    end = corner(line.centre + line.cap, 0.0)
    curves = [
        occ.addLine(begin, first),
        occ.addLine(first, last),
        occ.addCircleArc(last, centre, end),
        occ.addLine(end, begin),
    ]
    face = occ.addPlaneSurface([occ.addCurveLoop(curves)])
    turned = occ.revolve([(2, face)], 0, 0, slab.offset, c, s, 0, 2.0 * math.pi)
    return next(entity for entity in turned if entity[0] == 3)


def _name_roles(slab: SeminarActuator, solids: list[Entity]) -> None:
    """Give every face on the boundary of the solid one role; the face between two halves gets none."""
    import gmsh

    gmsh.model.addPhysicalGroup(3, [tag for _, tag in solids], name="solid")
    roles: dict[str, list[int]] = defaultdict(list)
    for _, tag in gmsh.model.getBoundary(solids, combined=True, oriented=False):
        roles[_role(slab, tag)].append(tag)
    wanted = {"cavity", "support", "top", "bottom", "outer", *(plane.name for plane in slab.cut_planes)}
    for role in sorted(wanted - roles.keys()):
        raise MeshingError(f"The shape has no place for {role!r}; please report this with the parameters")
    for role, tags in roles.items():
        gmsh.model.addPhysicalGroup(2, tags, name=role)


def _role(slab: SeminarActuator, tag: int) -> str:
    """Return the role of a face from points on it."""
    import gmsh

    low, high = (np.array(bound) for bound in gmsh.model.getParametrizationBounds(2, tag))
    # Points of the face's surface, which may lie beside the face itself: enough to know which surface it is.
    grid = np.array([low + (high - low) * (a, b) for a in (0.1, 0.45, 0.8) for b in (0.15, 0.5, 0.9)])
    x, y, z = np.array(gmsh.model.getValue(2, tag, grid.ravel())).reshape(-1, 3).T
    near = 1e-6 * slab.thickness
    half = 0.5 * slab.thickness
    normal, (tx, ty) = side(slab)
    for role, gap in (
        ("support", x),
        ("plane0", y),
        ("top", z - half),
        ("bottom", z + half),
        ("tip", np.hypot(x - slab.length + slab.tip_radius, y) - slab.tip_radius if slab.tip_radius else z + 1.0),
        ("outer", (x - tx) * normal[0] + (np.abs(y) - ty) * normal[1]),
    ):
        if np.abs(gap).max() < near:
            return role
    return "cavity"
