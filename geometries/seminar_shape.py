"""The seminar actuator in Gmsh: half a slab, or its upper half where it is symmetric, with the channels cut out of it.

The model is in mm and the mesh is written in m: the CAD kernel rounds edges with fixed tolerances that suit mm.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections import defaultdict
from typing import TYPE_CHECKING

import numpy as np

from geometries.errors import MeshingError
from geometries.seminar_cells import size_function
from geometries.seminar_plan import Channel, fan, half_fan, side, spread

if TYPE_CHECKING:
    from geometries.seminar import SeminarActuator

Entity = tuple[int, int]

MM = 1e3
"""Model lengths in one metre."""

SHARP = math.radians(5.0)
"""Angle between the normals of two walls of the air above which they meet in a crease."""


def build_slab(slab: SeminarActuator) -> None:
    """Fill the current Gmsh model (mm) with the slab, its roles and its cell sizes; the mesh is saved in m."""
    import gmsh  # type: ignore[import-untyped]

    solids = half_slab(slab)
    gmsh.model.occ.synchronize()
    _name_roles(slab, solids)
    size = size_function(slab)
    gmsh.option.setNumber("Mesh.ScalingFactor", 1.0 / MM)
    gmsh.model.mesh.setSizeCallback(lambda dim, tag, x, y, z, other: MM * size(x / MM, y / MM, z / MM))


@functools.lru_cache(maxsize=64)
def measured_volume(slab: SeminarActuator) -> float:
    """Volume in m3 of half the slab without its channels, by the CAD kernel."""
    import gmsh

    from geometries.meshing import private_model

    with private_model():
        volume = float(sum(gmsh.model.occ.getMass(*entity) for entity in half_slab(slab)))
    return volume / MM**3 * (2.0 if slab.level else 1.0)


def build_both_halves(slab: SeminarActuator) -> None:
    """Fill the current Gmsh model (mm) with the whole slab, one solid.

    Both halves are drawn: the CAD kernel mirrors planes and cones into splines, which it is slow with and less exact.
    """
    import gmsh

    occ = gmsh.model.occ
    lines = [line for line in fan(slab) if line is not None]
    begin = -0.5 * spread(slab)
    air = _rounded(slab, [*_manifold(slab, begin), _cap(slab, begin), *(_air(slab, line) for line in lines)])
    solids, _ = occ.cut([_whole_prism(slab)], air)
    if [dimension for dimension, _ in solids] != [3]:
        raise MeshingError(
            f"the CAD kernel made {len(solids)} solids of one slab; change manifold_bore or channel_bore a little"
        )
    occ.synchronize()


def _whole_prism(slab: SeminarActuator) -> Entity:
    """The whole slab without channels."""
    import gmsh

    occ = gmsh.model.occ
    length, half, radius = MM * slab.length, 0.5 * MM * slab.base_width, MM * slab.tip_radius
    bottom = -0.5 * MM * slab.thickness
    x, y = (MM * at for at in side(slab)[1])
    right, left = occ.addPoint(0, -half, bottom), occ.addPoint(0, half, bottom)
    if radius > 0.0:
        ends = [occ.addPoint(x, -y, bottom), occ.addPoint(x, y, bottom)]
        centre = occ.addPoint(length - radius, 0, bottom)
        front = [occ.addCircleArc(ends[0], centre, ends[1])]
        occ.remove([(0, centre)])
    else:
        ends, front = [occ.addPoint(length, 0, bottom)], []
    sides = [occ.addLine(right, ends[0]), *front, occ.addLine(ends[-1], left), occ.addLine(left, right)]
    swept = occ.extrude([(2, occ.addPlaneSurface([occ.addCurveLoop(sides)]))], 0, 0, MM * slab.thickness)
    return next(entity for entity in swept if entity[0] == 3)


def half_slab(slab: SeminarActuator) -> list[Entity]:
    """Add the half at y > 0 with the channels cut out, of a `SeminarActuator.level` slab what is above the middle.

    Nothing is synchronised but the channels.

    Raises:
        MeshingError: The CAD kernel made something else than one solid.
    """
    import gmsh

    occ = gmsh.model.occ
    # The network may reach over the mirror plane: only what lies in the half is cut away.
    solids, _ = occ.cut([_prism(slab)], _network(slab))
    if [dimension for dimension, _ in solids] != [3]:
        raise MeshingError(
            f"the CAD kernel made {len(solids)} solids of one slab; change manifold_bore or channel_bore a little"
        )
    return solids


def _prism(slab: SeminarActuator) -> Entity:
    """Half the slab without channels."""
    import gmsh

    occ = gmsh.model.occ
    bottom, height = (
        (0.0, 0.5 * MM * slab.thickness) if slab.level else (-0.5 * MM * slab.thickness, MM * slab.thickness)
    )
    length, half, radius = MM * slab.length, 0.5 * MM * slab.base_width, MM * slab.tip_radius
    x, y = (MM * at for at in side(slab)[1])
    base, corner = occ.addPoint(0, 0, bottom), occ.addPoint(0, half, bottom)
    tip = occ.addPoint(length, 0, bottom)
    if radius > 0.0:
        turn, centre = occ.addPoint(x, y, bottom), occ.addPoint(length - radius, 0, bottom)
        flank = [occ.addCircleArc(tip, centre, turn), occ.addLine(turn, corner)]
        occ.remove([(0, centre)])  # a point on its own would become a node of no cell
    else:
        flank = [occ.addLine(tip, corner)]
    loop = occ.addCurveLoop([occ.addLine(base, tip), *flank, occ.addLine(corner, base)])
    swept = occ.extrude([(2, occ.addPlaneSurface([loop]))], 0, 0, height)
    return next(entity for entity in swept if entity[0] == 3)


def _network(slab: SeminarActuator) -> list[Entity]:
    """The air of all channels that reach into the half at y > 0, in one piece, its creases rounded."""
    lines = [line for line in half_fan(slab) if line is not None]
    # Across the mirror plane, past the middle channel and its rounding, so that the cut there is clean.
    begin = -2.0 * (lines[0].bore + 2.0 * slab.fillet) / slab.manifold_radius
    return _rounded(slab, [*_manifold(slab, begin), *(_air(slab, line) for line in lines)])


def _rounded(slab: SeminarActuator, parts: list[Entity]) -> list[Entity]:
    """Manifold and channels in one piece, its creases rounded."""
    import gmsh

    occ = gmsh.model.occ
    air = list(occ.fuse(parts[:1], parts[1:])[0])
    if slab.fillet == 0.0:
        return air
    occ.synchronize()
    edges = _creases(slab, air)
    try:
        return list(occ.fillet([tag for _, tag in air], edges, [MM * slab.fillet]))
    except Exception:  # bare
        raise MeshingError(
            f"the CAD kernel could not round {len(edges)} creases with fillet {MM * slab.fillet:g} mm; "
            "take a smaller one, or --fillet 0mm for sharp creases"
        ) from None


def _creases(slab: SeminarActuator, air: list[Entity]) -> list[int]:
    """Curves on the manifold where two curved walls of the air meet at an angle."""
    import gmsh

    model = gmsh.model
    half, radius = 0.5 * spread(slab), MM * slab.manifold_radius
    walls = [tag for _, tag in model.getBoundary(air, oriented=False) if model.getType(2, tag) != "Plane"]
    owners: dict[int, list[int]] = defaultdict(list)
    for wall in walls:
        for _, curve in model.getBoundary([(2, wall)], combined=False, oriented=False):
            owners[curve].append(wall)
    found = []
    for curve, pair in owners.items():
        if len(set(pair)) != 2:
            continue  # a seam of one wall, or the rim of the cut
        low, high = (bound[0] for bound in model.getParametrizationBounds(1, curve))
        at = model.getValue(1, curve, [0.5 * (low + high)])
        one, other = (np.array(model.getNormal(wall, model.getParametrization(2, wall, at))) for wall in pair)
        turn = max(-half, min(math.atan2(at[1], at[0]), half))
        away = math.dist(at, (radius * math.cos(turn), radius * math.sin(turn), MM * slab.offset))
        # Two cones of one channel meet at an angle too, which stays.
        if away < 1.001 * MM * slab.manifold_bore and math.acos(min(1.0, abs(float(one @ other)))) > SHARP:
            found.append(curve)
    return sorted(found)


def _manifold(slab: SeminarActuator, begin: float) -> list[Entity]:
    """The arc from an angle (rad) to its end at y > 0, and the round cap there."""
    import gmsh

    occ = gmsh.model.occ
    half = 0.5 * spread(slab)
    radius, bore, level = MM * slab.manifold_radius, MM * slab.manifold_bore, MM * slab.offset
    c, s = math.cos(begin), math.sin(begin)
    # The section's seam is on the inside, where no channel leaves.
    section = occ.addDisk(radius * c, radius * s, level, bore, bore, zAxis=[-s, c, 0], xAxis=[-c, -s, 0])
    arc = occ.revolve([(2, section)], 0, 0, 0, 0, 0, 1, half - begin)
    return [next(entity for entity in arc if entity[0] == 3), _cap(slab, half)]


def _cap(slab: SeminarActuator, angle: float) -> Entity:
    """The round cap where the manifold ends at an angle in radians."""
    import gmsh

    radius = MM * slab.manifold_radius
    x, y = radius * math.cos(angle), radius * math.sin(angle)
    return (3, int(gmsh.model.occ.addSphere(x, y, MM * slab.offset, MM * slab.manifold_bore)))


def _air(slab: SeminarActuator, line: Channel) -> Entity:
    """A channel: its half profile turned around its ray."""
    import gmsh

    occ = gmsh.model.occ
    c, s = math.cos(line.angle), math.sin(line.angle)

    def corner(along: float, up: float) -> int:
        return int(occ.addPoint(MM * along * c, MM * along * s, MM * (slab.offset + up)))

    begin = corner(line.start, 0.0)
    rims = [corner(line.start, line.bore), *(corner(cone.end, line.radius(cone.end)) for cone in line.cones)]
    centre, end = corner(line.centre, 0.0), corner(line.centre + line.cap, 0.0)
    curves = [
        occ.addLine(begin, rims[0]),
        *(occ.addLine(*pair) for pair in itertools.pairwise(rims)),
        occ.addCircleArc(rims[-1], centre, end),
        occ.addLine(end, begin),
    ]
    occ.remove([(0, centre)])
    face = occ.addPlaneSurface([occ.addCurveLoop(curves)])
    turned = occ.revolve([(2, face)], 0, 0, MM * slab.offset, c, s, 0, 2.0 * math.pi)
    occ.remove([(2, face)], recursive=True)
    return next(entity for entity in turned if entity[0] == 3)


def _name_roles(slab: SeminarActuator, solids: list[Entity]) -> None:
    """Give every face on the boundary of the solid one role; "middle" is where a level slab is mirrored."""
    import gmsh

    gmsh.model.addPhysicalGroup(3, [tag for _, tag in solids], name="solid")
    roles: dict[str, list[int]] = defaultdict(list)
    for _, tag in gmsh.model.getBoundary(solids, combined=True, oriented=False):
        roles[_role(slab, tag)].append(tag)
    wanted = {"cavity", "support", "top", "outer", "plane0", "middle" if slab.level else "bottom"}
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
    x, y, z = np.array(gmsh.model.getValue(2, tag, grid.ravel())).reshape(-1, 3).T / MM
    near = 1e-6 * slab.thickness
    half = 0.5 * slab.thickness
    normal, (tx, ty) = side(slab)
    for role, gap in (
        ("support", x),
        ("plane0", y),
        ("top", z - half),
        ("bottom", z + half),
        ("middle", z if slab.level else z + 1.0),
        ("tip", np.hypot(x - slab.length + slab.tip_radius, y) - slab.tip_radius if slab.tip_radius else z + 1.0),
        ("outer", (x - tx) * normal[0] + (np.abs(y) - ty) * normal[1]),
    ):
        if np.abs(gap).max() < near:
            return role
    return "cavity"
