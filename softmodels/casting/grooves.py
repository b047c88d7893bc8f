"""Grooves that hold the threads of a tube where its model has the fibres; they are ridges inside of the mould.

The outside opens in two halves along y. Seen along y, a helix on the tube is a curve over x in each half. So a groove whose
flanks are parallel to y is not undercut anywhere, whatever the angle; the curve is drawn in straight pieces. It has to hold all
that a groove square to the wall would, and all that its ridge sweeps as the half leaves. With phi from the parting plane, a
helix that climbs by c an angle of 1, and a groove from radius q to R, half as wide as h along the tube, that is between

    z = c phi(x/q) - h  and  z = c phi(x/R) + h,  phi = arccos,    on the side x > 0,

and with q and R exchanged on the other. It is wider where the halves part, by c arccos(q/R), and square to the wall between.
"""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np

from geometries import meshing
from softmodels.casting import settings
from softmodels.casting.settings import MouldError
from softmodels.common import schema
from softmodels.common.arrays import Array
from softmodels.common.lazy import gmsh

SMALLEST_ANGLE = 20.0
"""Smallest angle of a thread from the axis in degrees: below, grooves run together where the halves part."""
MIN_RING_ANGLE = 89.99
FLANK_DISTANCE = 0.01
"""Distance of the flanks from where they would touch the tube's cylinders, over its radius."""
HELIX_TOLERANCE = 0.1
"""Distance of a flank's plane pieces from the helix, over the thread's diameter."""


@dataclasses.dataclass(frozen=True)
class ThreadFamily:
    """A family of threads around a tube: signed angle from the axis in degrees, how many threads run side by side, advance of
    each per turn and distance of neighbours along the tube in m. Rings have no advance."""

    angle: float
    threads: int
    advance: float
    spacing: float

    def length(self, radius: float, height: float) -> float:
        """Return the length in m of all its threads, over a height of a tube."""
        return height / self.spacing * math.hypot(2.0 * math.pi * radius, self.advance)


@dataclasses.dataclass(frozen=True)
class Winding:
    """Threads on the cylinder of a tube, lengths in m: its radius, where the grooves begin and end along it, their width and
    depth, and the families."""

    radius: float
    begin: float
    end: float
    width: float
    depth: float
    lays: tuple[ThreadFamily, ...]


def winding(workshop: settings.Workshop, wound: tuple[float, float, float] | None) -> Winding | None:
    """Return the threads of a tube by its radius and the heights between which they lie, in m; None if none are asked for.

    Raises:
        MouldError: No tube, no angles, or grooves that would run together.
    """
    if not workshop.thread:
        return None
    if wound is None:
        raise MouldError(f"thread is {schema.shown(workshop.thread, 'm')}; grooves for it are made on tubes only; 0 omits them")
    radius, begin, end = wound
    width, depth = workshop.thread, 0.5 * workshop.thread
    if not workshop.angles:
        raise MouldError(
            f"thread is {schema.shown(width, 'm')}, but there are no fibres on the face outer; give the case [fibres] there, "
            "or the angles of the threads from the axis, such as lay = '75 deg, -75 deg'"
        )
    if width < workshop.least_wall or depth > 0.5 * radius:
        raise MouldError(
            f"thread is {schema.shown(width, 'm')}; ridges for it must be at least as wide as the printer's smallest wall, "
            f"{schema.shown(workshop.least_wall, 'm')} (least_wall), and at most as high as half of the radius, "
            f"{schema.shown(radius, 'm')}"
        )
    winding = Winding(
        radius, begin + width, end, width, depth, tuple(_thread_families(workshop, angle, radius) for angle in workshop.angles)
    )
    for lay in winding.lays:
        _check(winding, lay, workshop)
    return winding


def _thread_families(workshop: settings.Workshop, angle: float, radius: float) -> ThreadFamily:
    if not SMALLEST_ANGLE <= abs(angle) <= 90.0:
        raise MouldError(
            f"lay has {schema.shown(angle, 'degree')}; threads between {SMALLEST_ANGLE:g} and 90 deg from the axis leave the "
            "mould's halves, others run along where these part"
        )
    if abs(angle) > MIN_RING_ANGLE:
        return ThreadFamily(90.0, 0, 0.0, workshop.spacing)
    advance = 2.0 * math.pi * radius / math.tan(math.radians(abs(angle)))
    threads = max(1, round(advance / workshop.spacing))
    return ThreadFamily(angle, threads, advance, advance / threads)


def _check(winding: Winding, lay: ThreadFamily, workshop: settings.Workshop) -> None:
    """Check that there are grooves, and something is left between neighbours where they are widest."""
    if lay.spacing > (straight := winding.end - winding.begin) - winding.width:
        raise MouldError(
            f"threads at {schema.shown(lay.angle, 'degree')} lie {settings.length_text(lay.spacing)} apart along the tube, of "
            f"which only {settings.length_text(straight)} can be wound; choose a smaller spacing"
        )
    across = winding.width / math.sin(math.radians(abs(lay.angle))) + _widening(winding, lay)
    if lay.spacing - across < workshop.least_gap:
        raise MouldError(
            f"threads at {schema.shown(lay.angle, 'degree')} lie {settings.length_text(lay.spacing)} apart along the tube, but "
            f"their grooves are {settings.length_text(across)} wide where the halves part, so that these leave, and the "
            f"printer's smallest gap is {schema.shown(workshop.least_gap, 'm')}; choose a larger spacing, a thinner thread, or "
            "an angle nearer to 90 deg"
        )


def _widening(winding: Winding, lay: ThreadFamily) -> float:
    """Return by how much a groove is wider along the tube where the halves part, m."""
    return (
        lay.advance / (2.0 * math.pi) * math.acos(1.0 - winding.depth / winding.radius - FLANK_DISTANCE) if lay.advance else 0.0
    )


def groove_solids(winding: Winding, axis: int, scale: float) -> list[meshing.Entity]:
    """Add what is cut out of a tube around z, which is parted across x (0) or y (1), to the current Gmsh model; a length in m
    times the scale is one there. Beyond the tube they go on."""
    occ, solids = gmsh.model.occ, list[meshing.Entity]()
    unit, beyond = meshing.MM_PER_M * scale, 1.5 * winding.radius
    for side in (1.0, -1.0):
        faces = list[meshing.Entity]()
        for lay in winding.lays:
            climb = math.copysign(1.0, lay.angle) * side * (1.0 if axis == 1 else -1.0) * lay.advance / (2.0 * math.pi)
            reach = math.pi * abs(climb) + winding.width if climb else -0.5 * winding.width  # whole rings only
            first, last = ((height + way * reach) / lay.spacing for height, way in ((winding.begin, -1), (winding.end, 1)))
            half = 0.5 * winding.width / math.sin(math.radians(abs(lay.angle)))
            for k in range(math.ceil(first), math.floor(last) + 1):
                faces.append(_face(_outline(winding, climb, half), k * lay.spacing, axis, unit))
        faces = list(occ.fuse(faces[:1], faces[1:])[0]) if len(faces) > 1 else faces
        corners = np.array([[beyond, winding.begin], [-beyond, winding.begin], [-beyond, winding.end], [beyond, winding.end]])
        faces = list(occ.intersect(faces, [_face(corners, 0.0, axis, unit)])[0])
        grown = occ.extrude(faces, *(unit * side * beyond * np.eye(3)[axis]))
        solids += [solid for solid in grown if solid[0] == 3]
    low, high = (unit * height for height in (winding.begin, winding.end))
    inner = (3, occ.addCylinder(0, 0, low, 0, 0, high - low, unit * (winding.radius - winding.depth)))
    return list(occ.cut(solids, [inner])[0])


def _outline(winding: Winding, climb: float, half: float) -> Array:
    """Return the corners (x, z) of a groove seen along y, in m, shape (n, 2)."""
    outer, inner, far = winding.radius, winding.radius * (1.0 - FLANK_DISTANCE) - winding.depth, 1.5 * winding.radius
    c = abs(climb)
    if not c:
        return np.array([[far, -half], [-far, -half], [-far, half], [far, half]])
    touch = math.acos(1.0 - FLANK_DISTANCE)  # no flank touches the outer cylinder
    quarter = 0.5 * math.pi
    pieces = max(3, math.ceil(quarter / math.sqrt(8.0 * HELIX_TOLERANCE * winding.width / c)))

    def flank(first: float, last: float, way: float) -> Array:
        turn = np.linspace(first, last, 2 * pieces + 1)
        radius = np.where((turn < quarter) == (way < 0.0), inner, outer)
        return np.column_stack([radius * np.cos(turn), c * turn + way * half])

    below, above = flank(0.0, math.pi - touch, -1.0), flank(math.pi, touch, 1.0)
    ends = np.array([[far, below[0, 1]], [-far, below[-1, 1]], [-far, above[0, 1]], [far, above[-1, 1]]])
    return np.concatenate([ends[:1], below, ends[1:3], above, ends[3:]]) * (1.0, math.copysign(1.0, climb))


def _face(corners: Array, shift: float, axis: int, unit: float) -> meshing.Entity:
    """Add a plane face by its corners (x, z), shifted along z; lengths in m times the unit."""
    occ, places = gmsh.model.occ, np.zeros((len(corners), 3))
    places[:, 1 - axis], places[:, 2] = unit * corners[:, 0], unit * (corners[:, 1] + shift)
    points = [occ.addPoint(*place) for place in places]
    lines = [occ.addLine(a, b) for a, b in itertools.pairwise([*points, points[0]])]
    return (2, occ.addPlaneSurface([occ.addCurveLoop(lines)]))
