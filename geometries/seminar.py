"""The seminar actuator: a triangular slab of silicone with a fan of air channels that bends it out of its plane.

Seen from above, x from the clamped base to the tip, the mirror plane y = 0 in the middle::

    y
    |\\___
    |    \\___  channels, widening
    |  \\  /  \\___  towards the sides
    |   )-----     \\___
    |   )-----------   ) tip
    |   )-----      ___/
    |  /  \\  ___/
    |    ___/
    |___/  the manifold is the arc
    0________________________ x

The manifold is an arc around the base's centre; from it the channels run straight out. All lie in one plane, off the
middle of the thickness by `offset`: pressure pulls the slab long off its middle, so it bends away from the channels' side, the
thin one. The fan is symmetric about y = 0; with the lists (`bores` and the like) every channel has values of its own. The
supply hose is not modelled: the cavity is closed.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from collections import defaultdict
from collections.abc import Callable, Mapping
from typing import ClassVar, NamedTuple, Self

import numpy as np
import scipy
from numpy.typing import NDArray

from geometries import actuator, meshing, registry, revolved
from geometries.actuator import Vector
from softmodels.common import schema
from softmodels.common.arrays import Array
from softmodels.common.errors import GeometryError, MeshingError
from softmodels.common.lazy import gmsh


@registry.register_device
@dataclasses.dataclass(frozen=True, kw_only=True)
class SeminarActuator(actuator.MirroredHalf, actuator.HeldTip):
    """A triangular slab with a network of air channels that bends out of its plane.

    Lengths are in m, angles in degrees. The slab lies between z = -thickness/2 and thickness/2. Physical groups: volume
    "solid"; surfaces "cavity" (all channel walls), "support" (the base, x = 0, clamped), "top" and "bottom" (the faces
    at z = +- thickness/2), "tip" (the rounding, if there is one), "outer" (the sides) and, of a half, "plane0" (y = 0).
    """

    length: float = schema.length_field(0.070, "length from the clamped base to the tip")
    base_width: float = schema.length_field(0.060, "width at the base")
    thickness: float = schema.length_field(0.008, "thickness of the slab")
    tip_radius: float = schema.length_field(0.004, "radius of the rounding at the tip, seen from above; 0 for none", zero=True)
    channels: int = schema.choice_field(5, tuple(range(1, 31)), "number of channels")
    spread: float = schema.angle_field(
        100.0, "angle between the outermost channels, which is that of the manifold's arc", instead="angles"
    )
    manifold_radius: float = schema.length_field(0.012, "radius of the manifold's arc around the middle of the base")
    manifold_bore: float = schema.length_field(0.0009, "radius of the manifold's round section")
    channel_bore: float = schema.length_field(0.0007, "radius of a channel's section at the manifold", instead="bores")
    end_bore: float = schema.length_field(
        0.0010, "radius of a channel's section at its end, which is round", instead="end_bores"
    )
    fillet: float = schema.length_field(
        0.0004, "radius of the rounding where a channel leaves the manifold; 0 for a sharp crease", zero=True
    )
    offset: float = schema.length_field(
        -0.001, "height of the channels' plane above the middle of the thickness", zero=True, signed=True
    )
    edge: float = schema.length_field(0.004, "solid between the channels' ends and the slab's sides", instead="reaches")
    bores: tuple[float, ...] = schema.lengths_field(
        "each channel's own channel_bore, from the middle outwards: one value for two channels alike on both sides"
    )
    middle_bores: tuple[float, ...] = schema.lengths_field(
        "radius of each channel half way between its two ends, from the middle outwards; straight from end to end if none"
    )
    end_bores: tuple[float, ...] = schema.lengths_field("each channel's own end_bore, from the middle outwards")
    angles: tuple[float, ...] = schema.angles_field(
        "each channel's direction from the middle, rising; 0 deg first for an odd number; instead of spread"
    )
    reaches: tuple[float, ...] = schema.lengths_field(
        "how far from the middle of the base each channel ends, from the middle outwards; instead of edge"
    )
    least_wall: float = schema.length_field(
        0.0005, "minimum solid between channels and faces, and between channels", shape=False
    )
    cell_size: float = schema.length_field(0.005, "edge length of the cells far from the channels", shape=False)
    around: float = schema.number_field(10.0, "cells around a channel's section", shape=False)
    order: int = schema.choice_field(2, (1, 2), "order of the cells' geometry: 1 straight, 2 curved edges")
    part: str = actuator.part_field("slab")
    tip: str = actuator.tip_field(held="its rounding")

    stem: ClassVar = "seminar"
    pressures: ClassVar = "0:177"
    silicone: ClassVar = "ecoflex-00-30"
    faces: ClassVar = ("top", "bottom")
    unbonded: ClassVar = ("outer", "tip")
    stiffer: ClassVar = "narrower channels (--end-bore, --manifold-bore), a thicker slab (--thickness)"
    examples: ClassVar = (
        "--channels 7 --spread 120deg",
        "--offset=-1.2mm --end-bore 1mm",
        "--angles 0deg,20deg,50deg --end-bores 1.3mm,1mm,0.8mm",
        "--part full --cell-size 4mm",
    )

    def check(self) -> None:
        check_seminar(self)

    @property
    def expected_cells(self) -> float:
        share, total = 1.0 / self.copies, 0.5 * self.base_width * self.length * self.thickness / self.cell_size**3
        tubes = [(self.manifold_radius * spread(self), self.manifold_bore)]
        for line in fan(self):
            cones = line.cones if line else ()
            tubes += [(cone.end - cone.start, max(cone.bore, line.radius(cone.end))) for cone in cones if line]
        for length, radius in tubes:
            h = wall_size(self, radius)
            # Rings of cells that grow with distance r from the wall: int 2 pi (radius + r) / (h + g r)^3 dr.
            total += length * 2.0 * math.pi * (0.5 * radius / (CELL_SIZE_GROWTH * h**2) + 0.5 / (CELL_SIZE_GROWTH**2 * h))
        return share * total / revolved.TETRAHEDRON_VOLUME

    @property
    def size(self) -> float:
        return self.thickness

    @property
    def level(self) -> bool:
        """Whether the channels lie in the middle of the thickness, so that the slab is symmetric about z = 0."""
        return self.offset == 0.0

    @property
    def mirrors(self) -> tuple[meshing.Mirror, ...]:
        # Mirrored cells, not only shapes: nothing of the mesh then bends what symmetry keeps straight.
        level = (meshing.Mirror("middle", 2, {"top": "bottom"}),) if self.level else ()
        return (*level, *super().mirrors)

    @property
    def probes(self) -> dict[str, Vector]:
        half = 0.5 * self.thickness
        return {"tip": (self.length, 0.0, half), "tip_below": (self.length, 0.0, -half)}

    @property
    def pushed(self) -> str | None:
        return super().pushed if self.tip_radius > 0.0 else None

    figure_texts: ClassVar[Mapping[str, tuple[str, str, str]]] = {
        "tip_x": ("mm", "tip place x", "x of the middle of the tip's edge, deformed, from the clamped base"),
        "tip_z": (
            "mm",
            "tip place z",
            "z of the middle of the tip's edge, deformed, from the middle of the thickness; the rise is of its upper edge",
        ),
        "lift_angle": ("deg", "lift angle", "of the line from the middle of the clamped base to the middle of the tip's edge"),
        "curvature": ("per_m", "curvature", "of the circle that leaves the base along x and passes through the tip"),
    }

    def device_figures(self, places: Mapping[str, Vector]) -> dict[str, float]:
        """Return how the slab is bent, from where its tip is; see `Actuator.device_figures`.

        The tip is the middle of its edge. ``lift_angle`` is the angle of the line from the base's middle to it,
        ``curvature`` that of the circle through it which leaves the base along x.
        """
        x, _, z = 0.5 * (np.asarray(places["tip"]) + np.asarray(places["tip_below"]))
        return {"tip_x": x, "tip_z": z, "lift_angle": math.atan2(z, x), "curvature": 2.0 * z / (x * x + z * z)}

    @property
    def cavity_volume(self) -> float:
        return 2.0 * outline_area(self) * self.thickness - self.solid_volume

    @property
    def solid_volume(self) -> float:
        """Volume in m3 of the whole slab without its channels, measured by the CAD kernel."""

        return 2.0 * measured_volume(self)

    @property
    def movable(self) -> tuple[str, ...]:
        # A corner has no rounding's faces, and a slab symmetric about z = 0 stays so.
        fixed = {name for name in ("tip_radius", "fillet", "offset") if getattr(self, name) == 0.0}
        fixed |= {"angles[1]"} if self.channels % 2 else set()
        return tuple(name for name in actuator.parameter_names(self) if name not in fixed)

    def carried(self, other: Self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return where points on the boundary lie on another slab, to rounding on all of it; see `Actuator.carried`.

        Roundings of the network's creases are followed too, and the two slabs may give their channels by lists or in common.
        """

        return carried(self, other, points)

    @property
    def clearances(self) -> dict[str, float]:
        return clearances(self)

    @property
    def recipe(self) -> actuator.Recipe:
        return actuator.in_halves(
            self.lift, self.offset,
            "Every channel's section is round about this plane, so that each layer has open grooves that hold nothing back.",
            ((0.0, 0.0, self.offset), (self.manifold_radius, 0.0, self.offset)),
        )  # fmt: skip

    def build_whole(self) -> None:
        """Fill the current Gmsh model (mm) with the whole slab, one solid.

        Both halves are drawn: the CAD kernel mirrors planes and cones into splines, which it is slow with and less exact.
        """
        lines = [line for line in fan(self) if line is not None]
        begin = -0.5 * spread(self)
        air = _rounded_network(self, [*_manifold(self, begin), _cap(self, begin), *(_air(self, line) for line in lines)])
        cut_out(_whole_prism(self), air)
        gmsh.model.occ.synchronize()

    def build(self) -> None:
        """Fill the current Gmsh model (mm) with the slab, its roles and its cell sizes."""
        solids = half_slab(self)
        gmsh.model.occ.synchronize()
        _name_roles(self, solids)
        meshing.set_sizes(size_function(self))


# ----------------------------------------------------------------------------------------------------------------------
# The seminar actuator seen from above: outline, centre lines of the channels, and distances between them.
#
# Everything here is plain geometry in the plane (x, y), in m, without Gmsh: the checks, the shape and the cell sizes share it.


Place = tuple[float, float]


class Cone(NamedTuple):
    """A part of a channel between two distances along the ray: its radius where it begins, and the growth of this per
    length."""

    start: float
    bore: float
    slope: float
    end: float


class Channel(NamedTuple):
    """A straight channel on a ray from the base's middle, at an angle in radians against the x axis: one cone or two from the
    manifold's centre line on, and a round cap, of a radius ``cap`` about a centre at a distance, that continues it without a
    corner."""

    angle: float
    cones: tuple[Cone, ...]
    centre: float
    cap: float

    @property
    def start(self) -> float:
        """Distance at which the channel begins, on the manifold's centre line."""
        return self.cones[0].start

    @property
    def bore(self) -> float:
        """Radius there."""
        return self.cones[0].bore

    @property
    def end(self) -> float:
        """Distance at which the last cone ends and the cap begins."""
        return self.cones[-1].end

    def radius(self, along: float) -> float:
        """Return the radius of the section at a distance along the ray; that of the last cone's end from there on."""
        cone = next((part for part in self.cones if along < part.end), self.cones[-1])
        return cone.bore + cone.slope * (min(along, self.end) - cone.start)


def side(slab: SeminarActuator) -> tuple[Place, Place]:
    """Return the straight side at y > 0: its outward unit normal, and where it meets the tip's rounding."""
    # The side is the tangent from the base's corner to the circle of the rounding.
    half, middle, radius = 0.5 * slab.base_width, slab.length - slab.tip_radius, slab.tip_radius
    reach = math.hypot(middle, half)
    angle = math.atan2(half, middle)  # of the line from the rounding's centre to the corner, against -x
    turn = angle + math.acos(radius / reach)
    normal = (-math.cos(turn), math.sin(turn))
    return normal, (middle + radius * normal[0], radius * normal[1])


def outline_area(slab: SeminarActuator) -> float:
    """Return the area of half the slab (y > 0) seen from above, in m2."""
    normal, (x, y) = side(slab)
    middle = slab.length - slab.tip_radius
    straight = 0.5 * (0.5 * slab.base_width * x + y * middle)  # corners (0, 0), (middle, 0), (x, y), (0, half width)
    return straight + 0.5 * slab.tip_radius**2 * math.atan2(normal[1], normal[0])


def edge_distance(slab: SeminarActuator, x: float, y: float) -> float:
    """Return the distance of a point inside from the slab's two sides and tip, the base not counted; negative outside."""
    normal, (tx, ty) = side(slab)
    y = abs(y)
    straight = (tx - x) * normal[0] + (ty - y) * normal[1]
    middle = slab.length - slab.tip_radius
    # Beyond the end of the straight side, the rounding is what is near.
    along = (x - tx) * normal[1] - (y - ty) * normal[0]
    return slab.tip_radius - math.hypot(x - middle, y) if along > 0.0 else straight


def half_count(slab: SeminarActuator) -> int:
    """Return how many channels have y >= 0: as many entries as a list of channels has."""
    return (slab.channels + 1) // 2


def spread(slab: SeminarActuator) -> float:
    """Return the angle of the manifold's arc in radians, which is that between the outermost channels."""
    return math.radians(2.0 * slab.angles[-1] if slab.angles else slab.spread)


def half_angles(slab: SeminarActuator) -> list[float]:
    """Return the directions in radians of the channels with y >= 0, from the middle outwards."""
    if slab.angles:
        return [math.radians(angle) for angle in slab.angles]
    if slab.channels == 1:
        return [0.0]
    half = 0.5 * math.radians(slab.spread)
    return [half * (2 * k - slab.channels + 1) / (slab.channels - 1) for k in range(slab.channels // 2, slab.channels)]


def own(slab: SeminarActuator, several: str, common: str, number: int) -> tuple[float, str]:
    """Return the value of a channel, numbered from 1 in the middle outwards, and the name it was given by: an entry of the
    list ``several``, or the parameter ``common`` to all where that is empty."""
    values = getattr(slab, several)
    return (values[number - 1], f"{several}[{number}]") if values else (getattr(slab, common), common)


def half_fan(slab: SeminarActuator) -> list[Channel | None]:
    """Return the channels with y >= 0, from the middle outwards; None instead of one for which there is no room."""
    return [_channel(slab, number, angle) for number, angle in enumerate(half_angles(slab), 1)]


def fan(slab: SeminarActuator) -> list[Channel | None]:
    """Return all channels from the one at the smallest y to that at the largest; None instead of one without room."""
    half = half_fan(slab)
    mirrored = [line and line._replace(angle=-line.angle) for line in half[slab.channels % 2 :]]
    return [*reversed(mirrored), *half]


def pairs(lines: list[Channel]) -> list[tuple[int, int, Channel, Channel, float]]:
    """Return the neighbouring channels with their numbers and the angle between them; the first of an even number with its
    image."""
    middle = [(1, 1, lines[0], lines[0], 2.0 * lines[0].angle)] if lines[0].angle > 0.0 else []
    couples = enumerate(itertools.pairwise(lines), 1)
    return middle + [(k, k + 1, line, other, other.angle - line.angle) for k, (line, other) in couples]


def _channel(slab: SeminarActuator, number: int, angle: float) -> Channel | None:
    """Return the channel along a direction, None if there is none: with the length from its list, or else the largest that the
    sides allow."""
    bore, end_bore = own(slab, "bores", "channel_bore", number)[0], own(slab, "end_bores", "end_bore", number)[0]
    start = slab.manifold_radius
    if slab.reaches:
        before, share = (slab.middle_bores[number - 1], 0.5) if slab.middle_bores else (bore, 1.0)
        centre = _centre(slab.reaches[number - 1], start, end_bore, (end_bore - before) / share)
    else:
        centre = _farthest(slab, angle, slab.edge + end_bore)
    if centre <= start:
        return None
    cones = []
    if slab.middle_bores:
        half = 0.5 * (centre - start)
        cones.append(Cone(start, bore, (slab.middle_bores[number - 1] - bore) / half, start + half))
        start, bore = start + half, slab.middle_bores[number - 1]
    slope = (end_bore - bore) / (centre - start)
    cosine = 1.0 / math.hypot(1.0, slope)
    cap = end_bore * cosine  # the sphere around the centre that touches the cone
    cones.append(Cone(start, bore, slope, centre - cap * slope * cosine))
    return Channel(angle, tuple(cones), centre, cap)


def _farthest(slab: SeminarActuator, angle: float, need: float) -> float:
    """Return the distance along a ray at which the sides are as near as ``need``; 0 if they are nearer at the manifold."""
    c, s = math.cos(angle), math.sin(angle)
    low, high = slab.manifold_radius, slab.length
    if edge_distance(slab, low * c, low * s) <= need:
        return 0.0
    for _ in range(60):  # the distance falls along the ray only near its end: the slab is convex, so one crossing
        middle = 0.5 * (low + high)
        low, high = (middle, high) if edge_distance(slab, middle * c, middle * s) > need else (low, middle)
    return low


def _centre(reach: float, start: float, end_bore: float, growth: float) -> float:
    """Return the distance of the centre of a cap that ends at a distance ``reach``, of a channel from ``start`` on; 0 if
    there is no room for one. ``end_bore`` is the radius that the last cone would have there, ``growth`` its slope times the
    channel's length."""
    centre = reach - end_bore
    for _ in range(40):  # the cap is a little smaller than the end's bore; the slope hardly changes
        if centre <= start:
            return 0.0
        centre = reach - end_bore / math.hypot(1.0, growth / (centre - start))
    return centre


# ----------------------------------------------------------------------------------------------------------------------
# How large the cells of a seminar actuator are, and how many of them to expect.
#
# On a channel's wall the size follows its curvature (`around` cells on the section) and the solid between it and the nearest
# face (`CELLS_THROUGH_WALL` cells); away from the wall it grows linearly with distance up to the slab's cell size.


CELLS_THROUGH_WALL = 1.5
"""Cells between a channel and the nearest face."""

CREASE_CELL_RATIO = 1.5
"""Size of the cells on a rounded crease over that on a channel with the crease's radius."""

CELL_SIZE_GROWTH = 0.55


def wall_size(slab: SeminarActuator, radius: float) -> float:
    """Cell size in m on the wall of a channel of a radius in m."""
    thin = 0.5 * slab.thickness - abs(slab.offset) - radius
    return min(slab.cell_size, 2.0 * math.pi * radius / slab.around, thin / CELLS_THROUGH_WALL)


def size_function(slab: SeminarActuator) -> Callable[[float, float, float], float]:
    """Return the cell size in m as a function of the place in m."""
    half, arc, bore = 0.5 * spread(slab), slab.manifold_radius, slab.manifold_bore
    on_arc, far, level = wall_size(slab, bore), slab.cell_size, slab.offset
    # The creases, or their roundings, are rings around the rays, near the manifold's outer wall.
    crease, fillet = min(CREASE_CELL_RATIO * 2.0 * math.pi * slab.fillet / slab.around or far, on_arc), slab.fillet
    ring = arc + 0.85 * bore
    around, middle = 2.0 * math.pi / slab.around, 0.5 * slab.thickness - abs(slab.offset)
    ends = [(arc * math.cos(end), arc * math.sin(end)) for end in (-half, half)]
    rays = []
    for line in fan(slab):
        if line is None or (slab.part == "half" and line.angle < -1e-9):
            continue
        for number, cone in enumerate(line.cones, 1):
            end = cone.end if number < len(line.cones) else line.centre
            rays.append((math.cos(line.angle), math.sin(line.angle), cone.start, end, cone.bore, cone.slope, line.bore))

    # Gmsh asks a million times: plain arithmetic, nothing looked up twice.
    def size(x: float, y: float, z: float) -> float:
        z -= level
        if abs(math.atan2(y, x)) <= half:
            away = math.hypot(math.hypot(x, y) - arc, z)
        else:
            ex, ey = ends[y > 0.0]
            away = math.hypot(x - ex, y - ey, z)
        best = min(far, on_arc + CELL_SIZE_GROWTH * max(0.0, away - bore))
        for c, s, start, end, first, slope, mouth in rays:
            along = min(max(c * x + s * y, start), end)
            radius = first + slope * (along - start)
            away = math.hypot(x - c * along, y - s * along, z) - radius
            wall = min(around * radius, (middle - radius) / CELLS_THROUGH_WALL)
            best = min(best, wall + CELL_SIZE_GROWTH * away if away > 0.0 else wall)
            apart = math.hypot(c * x + s * y - ring, math.hypot(s * x - c * y, z) - mouth) - fillet
            best = min(best, crease + CELL_SIZE_GROWTH * apart if apart > 0.0 else crease)
        return best

    return size


# ----------------------------------------------------------------------------------------------------------------------
# Seminar actuators that cannot be: channels that break through a face or each other, found before the mesher starts.


MAX_SPREAD, MIN_SPREAD = 160.0, 10.0
"""Largest and smallest spread in degrees; beyond 160 the outermost channels run along the clamp."""

LARGEST_BORE_RATIO = 0.9
"""Largest bore of a channel in bores of the manifold: nearly equal ones meet at tangents, which no mesh survives."""

WALL_SAMPLES = 40

LISTS = ("bores", "middle_bores", "end_bores", "angles", "reaches")
"""Parameters with one value for every channel."""


def check_seminar(slab: SeminarActuator) -> None:
    """Check a slab's parameters against each other: GeometryError for the first found impossible, with its value and the
    limit."""
    _check_slab(slab)
    _check_lists(slab)
    # Solid above and below every part of the network.
    for bore, name in ((slab.manifold_bore, "manifold_bore"), *_bores(slab)):
        left = 0.5 * slab.thickness - abs(slab.offset) - bore
        given = f"{name} is {_mm(bore)}; with offset {_mm(slab.offset)} in thickness {_mm(slab.thickness)} it"
        _check_wall(slab, left, given, f"the {'top' if slab.offset > 0.0 else 'bottom'} face")
    _check_manifold(slab)
    channels = [_check_channel(slab, number, line) for number, line in enumerate(half_fan(slab), 1)]
    _check_sides(slab, channels)
    _check_neighbours(slab, channels)
    _check_fillet(slab, channels)
    if not 3.0 <= slab.around <= 64.0:
        slab.reject("around", "it must be between 3 and 64 cells around a channel")
    slab.check_most("cell_size", 1.0, "thickness")
    slab.check_count(f" with around {slab.around:g}")


def _mm(value: float) -> str:
    return schema.shown(value, "m")


def _degrees(value: float) -> str:
    return schema.shown(value, "degree")


def _spread_text(slab: SeminarActuator) -> str:
    """Return how wide the fan is, by the name it was given, and where it is."""
    several = f"angles[{half_count(slab)}] {_degrees(slab.angles[-1])}" if slab.angles else ""
    return f"manifold_radius {_mm(slab.manifold_radius)} and {several or f'spread {_degrees(slab.spread)}'}"


def _check_wall(slab: SeminarActuator, left: float, given: str, face: str) -> None:
    """Reject less solid than the least wall between the network and a face; ``given`` begins the sentence."""
    if left < slab.least_wall * (1 - 1e-9):
        how = f"breaks through {face}" if left <= 0.0 else f"leaves {_mm(left)} to {face}"
        raise GeometryError(f"{given} {how}, but least_wall requires {_mm(slab.least_wall)}")


def _check_slab(slab: SeminarActuator) -> None:
    shorter = min(slab.length, slab.base_width)
    if max(slab.length, slab.base_width) > 0.1 * schema.MAX_LENGTH:
        wide = f"with base_width {_mm(slab.base_width)}, above {0.1 * schema.MAX_LENGTH:g} m this suggests a wrong unit"
        slab.reject("length", wide)
    if slab.thickness > 0.5 * shorter:
        slab.reject("thickness", f"a slab is at most half as thick as it is long and wide ({_mm(0.5 * shorter)})")
    if slab.tip_radius > 0.4 * shorter:
        slab.reject("tip_radius", f"this slab takes at most {_mm(0.4 * shorter)}")
    if slab.tip == "held" and slab.tip_radius == 0.0:
        raise GeometryError("tip is 'held' and tip_radius 0; the rounding is the support, so it needs a radius")


def _check_lists(slab: SeminarActuator) -> None:
    """Lists have one entry for every channel with y >= 0, and directions rise from the middle outwards."""
    count = half_count(slab)
    for name in LISTS:
        entries = len(getattr(slab, name))
        if entries not in (0, count):
            raise GeometryError(
                f"{name} has {entries} {'entry' if entries == 1 else 'entries'}; {slab.channels} channels, alike on both sides "
                f"of the middle, take {count}, from the middle outwards"
            )
    if slab.angles and slab.channels == 1:
        raise GeometryError("angles is given for one channel, which runs in the middle; leave it out")
    if slab.angles and slab.channels % 2 and slab.angles[0] != 0.0:
        raise GeometryError(
            f"angles[1] is {_degrees(slab.angles[0])}; of {slab.channels} channels the first runs in the middle, at 0 deg"
        )
    for number, angle in enumerate(slab.angles, 1):
        least = slab.angles[number - 2] if number > 1 else 0.0
        if angle <= least and (number > 1 or slab.channels % 2 == 0):
            raise GeometryError(
                f"angles[{number}] is {_degrees(angle)}; it must be larger than {_degrees(least)}: channels are given from "
                "the middle outwards"
            )
    arc = math.degrees(spread(slab))
    if not MIN_SPREAD * (1 - 1e-9) <= arc <= MAX_SPREAD * (1 + 1e-9):
        given, share = (f"angles[{count}]", 0.5) if slab.angles else ("spread", 1.0)
        limits = f"it must be between {share * MIN_SPREAD:g} and {share * MAX_SPREAD:g} deg"
        raise GeometryError(f"{given} is {_degrees(share * arc)}; {limits}")


def _bores(slab: SeminarActuator) -> list[tuple[float, str]]:
    """Return every radius of the channels that was given, and the name it was given by."""
    pairs = (("bores", "channel_bore"), ("end_bores", "end_bore"))
    bores = {
        name: bore for number in range(half_count(slab), 0, -1) for bore, name in (own(slab, *pair, number) for pair in pairs)
    }
    bores |= {f"middle_bores[{number}]": bore for number, bore in enumerate(slab.middle_bores, 1)}
    return [(bore, name) for name, bore in bores.items()]


def _check_manifold(slab: SeminarActuator) -> None:
    bore, radius = slab.manifold_bore, slab.manifold_radius
    for number in range(1, half_count(slab) + 1):
        mouth, name = own(slab, "bores", "channel_bore", number)
        if mouth > LARGEST_BORE_RATIO * bore:
            limit = f"it must be at most {LARGEST_BORE_RATIO:g} times manifold_bore, {_mm(bore)}"
            raise GeometryError(f"{name} is {_mm(mouth)}; {limit}")
    if radius < 2.0 * bore:
        slab.reject("manifold_radius", f"it must be at least twice manifold_bore, {_mm(bore)}, for an arc")
    gap = radius * math.cos(0.5 * spread(slab)) - bore
    _check_wall(slab, gap, f"manifold_bore is {_mm(bore)}; with {_spread_text(slab)} the manifold", "the base")


def _check_channel(slab: SeminarActuator, number: int, channel: Channel | None) -> Channel:
    """Return the channel, unless it is so short that nothing of it is left outside the manifold."""
    end_bore, name = own(slab, "end_bores", "end_bore", number)
    if channel is None or channel.end - channel.start < slab.manifold_bore + end_bore:
        far = f"reaches[{number}] {_mm(slab.reaches[number - 1])}" if slab.reaches else f"edge {_mm(slab.edge)}"
        at = math.degrees(half_angles(slab)[number - 1])
        slab.reject(
            "manifold_radius", f"with {far} and {name} {_mm(end_bore)} no length is left for channel {number}, at {at:.3g} deg"
        )
    return channel


def _check_sides(slab: SeminarActuator, channels: list[Channel]) -> None:
    """Solid between the network and the slab's sides, along every centre line."""
    if slab.edge < slab.least_wall:
        raise GeometryError(f"edge is {_mm(slab.edge)}; least_wall requires {_mm(slab.least_wall)}")
    arc, bore = [0.5 * spread(slab) * k / WALL_SAMPLES for k in range(WALL_SAMPLES + 1)], slab.manifold_bore
    given = f"manifold_bore is {_mm(bore)}; with {_spread_text(slab)} it"
    _check_wall(slab, min(_wall(slab, slab.manifold_radius, angle, bore) for angle in arc), given, "the slab's side")
    for number, line in enumerate(channels, 1):
        end_bore, name = own(slab, "end_bores", "end_bore", number)
        given = f"{name} is {_mm(end_bore)}; with {_spread_text(slab)} channel {number}"
        if slab.reaches:
            reach = _mm(slab.reaches[number - 1])
            given = f"reaches[{number}] is {reach}; with {name} {_mm(end_bore)} channel {number}"
        walls = [_wall(slab, line.centre, line.angle, line.cap)]
        for k in range(WALL_SAMPLES + 1):
            along = line.start + (line.end - line.start) * k / WALL_SAMPLES
            radius = line.radius(along)
            walls += [_wall(slab, along, line.angle, radius), along * math.cos(line.angle) - radius]
        _check_wall(slab, min(walls), given, "the slab's side")


def _wall(slab: SeminarActuator, along: float, angle: float, radius: float) -> float:
    """Return the solid in m between the slab's side and a ball of a radius on a ray."""
    return edge_distance(slab, along * math.cos(angle), along * math.sin(angle)) - radius


def _check_neighbours(slab: SeminarActuator, channels: list[Channel]) -> None:
    """Solid between neighbouring channels, outside of the manifold that joins them."""
    begin = slab.manifold_radius + slab.manifold_bore
    for first, second, channel, other, pitch in pairs(channels):
        end = min(channel.end, other.end)
        for k in range(WALL_SAMPLES + 1):
            along = begin + (end - begin) * k / WALL_SAMPLES
            left = 2.0 * along * math.sin(0.5 * pitch) - channel.radius(along) - other.radius(along)
            if left < slab.least_wall * (1 - 1e-9):
                mouth, name = own(slab, "bores", "channel_bore", second)
                how = "break into each other" if left <= 0.0 else f"are {_mm(left)} apart"
                raise GeometryError(
                    f"channels is {slab.channels}; with {_spread_text(slab)} and {name} {_mm(mouth)} neighbours (channels "
                    f"{first} and {second}) {how}, but least_wall requires {_mm(slab.least_wall)}"
                )


def _check_fillet(slab: SeminarActuator, channels: list[Channel]) -> None:
    """The rounding must fit on the bores, and two of them between neighbouring channels."""
    limits = [(line.bore, number) for number, line in enumerate(channels, 1)]
    for _, second, channel, other, pitch in pairs(channels):
        # Two roundings side by side on the manifold's wall, with a fifth of one to spare.
        room = slab.manifold_radius * math.sin(0.5 * pitch) - 0.5 * (channel.bore + other.bore)
        limits.append((room / 1.1, second))
    limit, number = min(limits)
    if slab.fillet > limit:
        mouth, name = own(slab, "bores", "channel_bore", number)
        most = f"this slab takes at most {_mm(max(limit, 0.0))}"
        slab.reject("fillet", f"with {name} {_mm(mouth)} and {slab.channels} channels {most}")


# ----------------------------------------------------------------------------------------------------------------------
# The dimensions of a seminar actuator that have a least value: walls, widths of channels, and room that its parts need.
#
# Walls and widths are what a workshop puts a least value to. Room that only the shape needs may come down to nothing; it is
# counted on top of least_wall, so that one least value suits all. Each is a smooth function of the parameters: where a wall's
# thickness changes linearly along it, both ends stand for it.


PLACES = {
    "at the manifold": ("bores", "channel_bore"),
    "half way": ("middle_bores", ""),
    "at the end": ("end_bores", "end_bore"),
}
"""Where a channel's radius is given, the list that gives it and what is common to all without it."""


def clearances(slab: SeminarActuator) -> dict[str, float]:
    """Return the dimensions in m that have a least value; see `geometries.Actuator.clearances`.

    Where all are least_wall or more, the slab can be made.
    """
    lines = [line for line in half_fan(slab) if line is not None]
    return {
        **_sections(slab, len(lines)),
        **_sides(slab, lines),
        **_neighbours(slab, lines),
        **{f"least_wall and {name}": slab.least_wall + room for name, room in _wall_excesses(slab, lines).items()},
    }


def _sections(slab: SeminarActuator, count: int) -> dict[str, float]:
    """Return the widths of the manifold and the channels, and the solid above and below them."""
    bores = {"the manifold": slab.manifold_bore}
    for place, (several, common) in PLACES.items():
        if getattr(slab, several):
            bores |= {f"channel {k} {place}": own(slab, several, common, k)[0] for k in range(1, count + 1)}
        elif common:
            bores[f"the channels {place}"] = getattr(slab, common)
    sections = {f"width of {name}": 2.0 * bore for name, bore in bores.items()}
    for face, sign in (("top", 1.0), ("bottom", -1.0)):
        sections |= {
            f"solid between {name} and the {face}": 0.5 * slab.thickness - sign * slab.offset - bore
            for name, bore in bores.items()
        }
    return sections


def _sides(slab: SeminarActuator, lines: list[Channel]) -> dict[str, float]:
    """Return the solid between the network and the slab's base, sides and tip."""
    radius, bore, half, last = slab.manifold_radius, slab.manifold_bore, 0.5 * spread(slab), lines[-1]
    normal, _ = side(slab)
    nearest = min(math.atan2(normal[1], normal[0]), half)  # there the arc's distance is flat, so this is smooth
    sides = {
        "solid between the manifold and the base": radius * math.cos(half) - bore,
        "solid between the manifold and the side": _wall(slab, radius, nearest, bore),
        f"solid between the end of channel {len(lines)} and the base": last.centre * math.cos(half) - last.cap,
    }
    if not slab.reaches:
        sides["solid between the channels' ends and the side"] = slab.edge
    for number, line in enumerate(lines, 1):
        if slab.reaches:
            wall = _wall(slab, line.centre, line.angle, line.cap)
            sides[f"solid between the end of channel {number} and the side"] = wall
        if slab.middle_bores:
            middle = line.cones[0].end
            wall = _wall(slab, middle, line.angle, line.radius(middle))
            sides[f"solid between the middle of channel {number} and the side"] = wall
    return sides


def _neighbours(slab: SeminarActuator, lines: list[Channel]) -> dict[str, float]:
    """Return the solid between neighbouring channels, at the manifold and wherever a cone of either ends."""
    neighbours = {}
    for first, second, first_line, other, pitch in pairs(lines):
        places = {"at the manifold": (slab.manifold_radius + slab.manifold_bore, 0)}
        for number, line in {first: first_line, second: other}.items():
            places |= {
                f"{'at the end' if k == len(line.cones) - 1 else 'half way'} of channel {number}": (cone.end, k)
                for k, cone in enumerate(line.cones)
            }
        for place, (along, k) in places.items():
            radii = [cone.bore + cone.slope * (along - cone.start) for cone in (first_line.cones[k], other.cones[k])]
            apart = 2.0 * along * math.sin(0.5 * pitch)
            neighbours[f"solid between channels {first} and {second} {place}"] = apart - sum(radii)
    return neighbours


def _wall_excesses(slab: SeminarActuator, lines: list[Channel]) -> dict[str, float]:
    """Return what the shape needs beyond walls: 0 is enough."""
    radius, bore, fillet = slab.manifold_radius, slab.manifold_bore, slab.fillet
    half, shorter = 0.5 * spread(slab), {"length": slab.length, "width": slab.base_width}
    wall_excesses = {f"room for the thickness in the {name}": 0.5 * size - slab.thickness for name, size in shorter.items()}
    wall_excesses |= {
        "room for a cell in the thickness": slab.thickness - slab.cell_size,
        "room for the manifold's bore in its radius": radius - 2.0 * bore,
        "room for a wider fan": radius * (math.radians(0.5 * MAX_SPREAD) - half),
        "room for a narrower fan": radius * (half - math.radians(0.5 * MIN_SPREAD)),
    }
    if slab.tip_radius:
        wall_excesses |= {f"room for tip_radius in the {name}": 0.4 * size - slab.tip_radius for name, size in shorter.items()}
    for number, line in enumerate(lines, 1):
        end_bore = own(slab, "end_bores", "end_bore", number)[0]
        wall_excesses[f"straight length of channel {number}"] = line.end - line.start - bore - end_bore
    for number, line in enumerate(lines if slab.bores else lines[:1], 1):
        name = f"channel {number}" if slab.bores else "the channels"
        wall_excesses[f"room for {name} in the manifold's bore"] = LARGEST_BORE_RATIO * bore - line.bore
        if fillet:
            wall_excesses[f"room for the fillet in {name}"] = line.bore - fillet
    for first, second, first_line, other, pitch in pairs(lines) if fillet else ():
        room = 2.0 * radius * math.sin(0.5 * pitch) - first_line.bore - other.bore
        wall_excesses[f"room for two fillets between channels {first} and {second}"] = room - 2.2 * fillet
    return wall_excesses


# ----------------------------------------------------------------------------------------------------------------------
# The seminar actuator in Gmsh: half a slab, or its upper half where it is symmetric, with the channels cut out of it.
#
# The model is in mm and the mesh is written in m: the CAD kernel rounds edges with fixed tolerances that suit mm.


MIN_CREASE_ANGLE = math.radians(5.0)
"""Angle between the normals of two walls of the air above which they meet in a crease."""


@functools.lru_cache(maxsize=64)
def measured_volume(slab: SeminarActuator) -> float:
    """Return the volume in m3 of half the slab without its channels, by the CAD kernel."""
    with meshing.private_model():
        volume = float(sum(gmsh.model.occ.getMass(*entity) for entity in half_slab(slab)))
    return volume / meshing.MM_PER_M**3 * (2.0 if slab.level else 1.0)


def cut_out(prism: meshing.Entity, air: list[meshing.Entity]) -> list[meshing.Entity]:
    """Return a slab with the channels cut out of it, in one piece; MeshingError if the CAD kernel made something else than
    one solid."""
    solids, _ = gmsh.model.occ.cut([prism], air)
    if [dimension for dimension, _ in solids] != [3]:
        raise MeshingError(
            f"the CAD kernel made {len(solids)} solids of one slab; change manifold_bore or channel_bore slightly"
        )
    return list(solids)


def _swept_solid(curves: list[int], height: float) -> meshing.Entity:
    """Return what a closed line at the bottom sweeps over a height, in mm."""
    occ = gmsh.model.occ
    swept = occ.extrude([(2, occ.addPlaneSurface([occ.addCurveLoop(curves)]))], 0, 0, height)
    return next(entity for entity in swept if entity[0] == 3)


def _whole_prism(slab: SeminarActuator) -> meshing.Entity:
    """Return the whole slab without channels."""
    occ = gmsh.model.occ
    length = meshing.MM_PER_M * slab.length
    half = 0.5 * meshing.MM_PER_M * slab.base_width
    radius = meshing.MM_PER_M * slab.tip_radius
    bottom = -0.5 * meshing.MM_PER_M * slab.thickness
    x, y = (meshing.MM_PER_M * at for at in side(slab)[1])
    right, left = occ.addPoint(0, -half, bottom), occ.addPoint(0, half, bottom)
    if radius > 0.0:
        ends = [occ.addPoint(x, -y, bottom), occ.addPoint(x, y, bottom)]
        centre = occ.addPoint(length - radius, 0, bottom)
        front = [occ.addCircleArc(ends[0], centre, ends[1])]
        occ.remove([(0, centre)])
    else:
        ends, front = [occ.addPoint(length, 0, bottom)], []
    sides = [occ.addLine(right, ends[0]), *front, occ.addLine(ends[-1], left), occ.addLine(left, right)]
    return _swept_solid(sides, meshing.MM_PER_M * slab.thickness)


def half_slab(slab: SeminarActuator) -> list[meshing.Entity]:
    """Add the half at y > 0 with the channels cut out, of a `SeminarActuator.level` slab what is above the middle.

    Nothing is synchronised but the channels.
    """
    # The network may reach over the mirror plane: only what lies in the half is cut away.
    return cut_out(_prism(slab), _network(slab))


def _prism(slab: SeminarActuator) -> meshing.Entity:
    """Return half the slab without channels."""
    occ = gmsh.model.occ
    bottom, height = (
        (0.0, 0.5 * meshing.MM_PER_M * slab.thickness)
        if slab.level
        else (-0.5 * meshing.MM_PER_M * slab.thickness, meshing.MM_PER_M * slab.thickness)
    )
    length = meshing.MM_PER_M * slab.length
    half = 0.5 * meshing.MM_PER_M * slab.base_width
    radius = meshing.MM_PER_M * slab.tip_radius
    x, y = (meshing.MM_PER_M * at for at in side(slab)[1])
    base, corner = occ.addPoint(0, 0, bottom), occ.addPoint(0, half, bottom)
    tip = occ.addPoint(length, 0, bottom)
    if radius > 0.0:
        turn, centre = occ.addPoint(x, y, bottom), occ.addPoint(length - radius, 0, bottom)
        flank = [occ.addCircleArc(tip, centre, turn), occ.addLine(turn, corner)]
        occ.remove([(0, centre)])  # a point on its own would become a node of no cell
    else:
        flank = [occ.addLine(tip, corner)]
    return _swept_solid([occ.addLine(base, tip), *flank, occ.addLine(corner, base)], height)


def _network(slab: SeminarActuator) -> list[meshing.Entity]:
    """Return the air of all channels that reach into the half at y > 0, in one piece, its creases rounded."""
    lines = [line for line in half_fan(slab) if line is not None]
    # Across the mirror plane, past the middle channel and its rounding, so that the cut there is clean.
    begin = -2.0 * (lines[0].bore + 2.0 * slab.fillet) / slab.manifold_radius
    return _rounded_network(slab, [*_manifold(slab, begin), *(_air(slab, line) for line in lines)])


def _rounded_network(slab: SeminarActuator, parts: list[meshing.Entity]) -> list[meshing.Entity]:
    """Return the manifold and channels in one piece, its creases rounded."""
    occ = gmsh.model.occ
    air = list(occ.fuse(parts[:1], parts[1:])[0])
    if slab.fillet == 0.0:
        return air
    occ.synchronize()
    edges = _creases(slab, air)
    try:
        return list(occ.fillet([tag for _, tag in air], edges, [meshing.MM_PER_M * slab.fillet]))
    except Exception:  # bare
        raise MeshingError(
            f"the CAD kernel could not round {len(edges)} creases with fillet {meshing.MM_PER_M * slab.fillet:g} "
            f"mm; use a smaller one, or --fillet 0mm for sharp creases"
        ) from None


def _creases(slab: SeminarActuator, air: list[meshing.Entity]) -> list[int]:
    """Return the curves on the manifold where two curved walls of the air meet at an angle."""
    model = gmsh.model
    half, radius = 0.5 * spread(slab), meshing.MM_PER_M * slab.manifold_radius
    walls = [tag for _, tag in model.getBoundary(air, oriented=False) if model.getType(2, tag) != "Plane"]
    owners: dict[int, list[int]] = defaultdict(list)
    for wall in walls:
        for _, curve in model.getBoundary([(2, wall)], combined=False, oriented=False):
            owners[curve].append(wall)
    creases = []
    for curve, pair in owners.items():
        if len(set(pair)) != 2:
            continue  # a seam of one wall, or the rim of the cut
        low, high = (bound[0] for bound in model.getParametrizationBounds(1, curve))
        at = model.getValue(1, curve, [0.5 * (low + high)])
        normal, other = (np.array(model.getNormal(wall, model.getParametrization(2, wall, at))) for wall in pair)
        turn = max(-half, min(math.atan2(at[1], at[0]), half))
        away = math.dist(at, (radius * math.cos(turn), radius * math.sin(turn), meshing.MM_PER_M * slab.offset))
        # Two cones of one channel meet at an angle too, which stays.
        if (
            away < 1.001 * meshing.MM_PER_M * slab.manifold_bore
            and math.acos(min(1.0, abs(float(normal @ other)))) > MIN_CREASE_ANGLE
        ):
            creases.append(curve)
    return sorted(creases)


def _manifold(slab: SeminarActuator, begin: float) -> list[meshing.Entity]:
    """Return the arc from an angle (rad) to its end at y > 0, and the round cap there."""
    occ = gmsh.model.occ
    half = 0.5 * spread(slab)
    radius = meshing.MM_PER_M * slab.manifold_radius
    bore = meshing.MM_PER_M * slab.manifold_bore
    level = meshing.MM_PER_M * slab.offset
    c, s = math.cos(begin), math.sin(begin)
    # The section's seam is on the inside, where no channel leaves.
    section = occ.addDisk(radius * c, radius * s, level, bore, bore, zAxis=[-s, c, 0], xAxis=[-c, -s, 0])
    arc = occ.revolve([(2, section)], 0, 0, 0, 0, 0, 1, half - begin)
    return [next(entity for entity in arc if entity[0] == 3), _cap(slab, half)]


def _cap(slab: SeminarActuator, angle: float) -> meshing.Entity:
    """Return the round cap where the manifold ends at an angle in radians."""
    radius = meshing.MM_PER_M * slab.manifold_radius
    x, y = radius * math.cos(angle), radius * math.sin(angle)
    return (3, int(gmsh.model.occ.addSphere(x, y, meshing.MM_PER_M * slab.offset, meshing.MM_PER_M * slab.manifold_bore)))


def _air(slab: SeminarActuator, line: Channel) -> meshing.Entity:
    """Return a channel: its half profile turned around its ray."""
    occ = gmsh.model.occ
    c, s = math.cos(line.angle), math.sin(line.angle)

    def corner(along: float, up: float) -> int:
        return int(
            occ.addPoint(meshing.MM_PER_M * along * c, meshing.MM_PER_M * along * s, meshing.MM_PER_M * (slab.offset + up))
        )

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
    turned = occ.revolve([(2, face)], 0, 0, meshing.MM_PER_M * slab.offset, c, s, 0, 2.0 * math.pi)
    occ.remove([(2, face)], recursive=True)
    return next(entity for entity in turned if entity[0] == 3)


def _name_roles(slab: SeminarActuator, solids: list[meshing.Entity]) -> None:
    """Give every face on the boundary of the solid one role; "middle" is where a level slab is mirrored."""
    meshing.name_group(3, [tag for _, tag in solids], "solid")
    roles: dict[str, list[int]] = defaultdict(list)
    for _, tag in gmsh.model.getBoundary(solids, combined=True, oriented=False):
        roles[_role(slab, tag)].append(tag)
    wanted = {"cavity", "support", "top", "outer", "plane0", "middle" if slab.level else "bottom"}
    for role in sorted(wanted - roles.keys()):
        raise MeshingError(f"The shape has no place for {role!r}; please report this with the parameters")
    meshing.name_groups(2, roles)


def _role(slab: SeminarActuator, tag: int) -> str:
    """Return the role of a face from points on it."""
    low, high = (np.array(bound) for bound in gmsh.model.getParametrizationBounds(2, tag))
    # Points of the face's surface, which may lie beside the face itself: enough to know which surface it is.
    grid = np.array([low + (high - low) * (a, b) for a in (0.1, 0.45, 0.8) for b in (0.15, 0.5, 0.9)])
    x, y, z = np.array(gmsh.model.getValue(2, tag, grid.ravel())).reshape(-1, 3).T / meshing.MM_PER_M
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


# ----------------------------------------------------------------------------------------------------------------------
# Angles along the manifold of a seminar actuator and where they lie on another's.
#
# Around a channel the arc moves with it, stretched as the channel's mouth is; between two channels a cubic joins both motions.


MAX_MOUTH_SHARE = 0.6
"""Largest part of the way to the middle between two channels that moves with either."""

ARC_SAMPLES = np.linspace(0.0, 1.0, 9)

MIN_ARC_STRETCH = 0.02
"""Least stretch of an arc between two channels that is followed."""


def arc_map(slab: SeminarActuator, other: SeminarActuator, lines: list[tuple[Channel, Channel]]) -> Callable[[Array], Array]:
    """Return a smooth, rising function from angles along one slab's arc to those along another's, in radians, by the channels
    with y >= 0 from the middle outwards, on both. GeometryError if the solid between two channels shrinks to next to
    nothing."""
    angles, wide, slopes, goals = (np.array(values) for values in zip(*_knots(slab, other, lines), strict=True))
    mouths = np.minimum(wide, MAX_MOUTH_SHARE * _gaps(angles).min(axis=0))
    starts, ends = angles[:-1] + mouths[:-1], angles[1:] - mouths[1:]
    low, high = goals[:-1] + slopes[:-1] * mouths[:-1], goals[1:] - slopes[1:] * mouths[1:]
    rise, span = high - low, ends - starts
    first, last = slopes[:-1] * span, slopes[1:] * span
    for share in ARC_SAMPLES:
        rates = (
            6.0 * share * (1.0 - share) * rise
            + (1.0 - share) * (1.0 - 3.0 * share) * first
            + share * (3.0 * share - 2.0) * last
        )
        if (rates < MIN_ARC_STRETCH * span).any():
            raise GeometryError(
                "the channels' mouths on the manifold come so much closer or grow so much that the mesh between them cannot "
                "follow; make a new mesh"
            )

    def carry(turn: Array) -> Array:
        piece = np.clip(np.searchsorted(0.5 * (angles[:-1] + angles[1:]), turn), 0, len(angles) - 1)
        angles_on_other = goals[piece] + slopes[piece] * (turn - angles[piece])
        gap = np.clip(np.searchsorted(angles, turn, side="right") - 1, 0, len(angles) - 2)
        share = (turn - starts[gap]) / span[gap]
        between = (share > 0.0) & (share < 1.0)
        s = np.clip(share, 0.0, 1.0)
        cubic = low[gap] + rise[gap] * s**2 * (3.0 - 2.0 * s) + first[gap] * s * (1.0 - s) ** 2 - last[gap] * s**2 * (1.0 - s)
        return np.where(between, cubic, angles_on_other)

    return carry


def _gaps(angles: Array) -> Array:
    """Return half the angle to the knots before and after each, shape (2, n)."""
    half = 0.5 * np.diff(angles)
    return np.array([np.append(np.inf, half), np.append(half, np.inf)])


def _knots(
    slab: SeminarActuator, other: SeminarActuator, lines: list[tuple[Channel, Channel]]
) -> list[tuple[float, float, float, float]]:
    """Return the channels, and the arc's ends where there are none: angle, half the mouth's, its stretch, and angle on the
    other."""
    half = []
    for line, its_line in lines:
        wide, its_wide = (
            (part.bore + device.fillet) / device.manifold_radius for part, device in ((line, slab), (its_line, other))
        )
        half.append((line.angle, wide, its_wide / wide, its_line.angle))
    if len(half) == 1 and half[0][0] == 0.0:
        end, its_end = 0.5 * spread(slab), 0.5 * spread(other)
        half.append((end, 0.0, its_end / end, its_end))
    mirrored = [(-angle, wide, stretch, -goal) for angle, wide, stretch, goal in half if angle > 0.0]
    return [*reversed(mirrored), *half]


# ----------------------------------------------------------------------------------------------------------------------
# Where a channel of the seminar actuator leaves its manifold: levels of the two walls, and the rounding between them.
#
# A level is a distance to a wall, positive in the solid. The rounding is what a ball of the fillet's radius leaves that rolls
# in the solid along both walls; its centres form the curve `Junction.rim`, which is the crease itself where there is no
# fillet. A device has mirror images at y < 0; everything here is for y >= 0.


@dataclasses.dataclass(frozen=True)
class Junction:
    """The manifold and the first cone of one channel."""

    slab: SeminarActuator
    line: Channel

    @functools.cached_property
    def axes(self) -> Array:
        """Unit vectors along the channel, across it in its plane, and up; rows, shape (3, 3)."""
        c, s = math.cos(self.line.angle), math.sin(self.line.angle)
        return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])

    def local(self, points: Array) -> tuple[Array, Array, Array]:
        """Return the distance along the ray and from it, shape (n,), and the unit direction from it across and up, shape (n,
        2)."""
        turned = (points - [0.0, 0.0, self.slab.offset]) @ self.axes.T
        direction, radius = unit(turned[:, 1:])
        return turned[:, 0], radius, direction

    def place(self, along: Array, radius: Array, direction: Array) -> Array:
        """Return the inverse of `local`."""
        return np.column_stack([along, radius[:, None] * direction]) @ self.axes + [0.0, 0.0, self.slab.offset]

    def cone_level(self, points: Array) -> tuple[Array, Array]:
        """Return the level of the first cone, prolonged at both ends, shape (n,), and its gradient, shape (n, 3)."""
        cone = self.line.cones[0]
        along, radius, direction = self.local(points)
        cosine = 1.0 / math.hypot(1.0, cone.slope)
        level = cosine * (radius - cone.bore - cone.slope * (along - cone.start))
        normal = cosine * np.column_stack([np.full(len(along), -cone.slope), direction]) @ self.axes
        return level, normal

    def rim(self, direction: Array, start: Array | None = None) -> tuple[Array, Array]:
        """Return the centres of the ball that rolls along both walls, shape (n, 3), and their distance along the ray, shape
        (n,), by their direction from the ray, across and up, shape (n, 2); ``start`` are distances close to theirs."""
        cone, fillet = self.line.cones[0], self.slab.fillet
        out = fillet * math.hypot(1.0, cone.slope)
        step = np.column_stack([np.ones(len(direction)), cone.slope * direction]) @ self.axes
        along = self._guess(direction) if start is None else start
        for _ in range(MAX_NEWTON_STEPS):
            points = self.place(along, cone.bore + cone.slope * (along - cone.start) + out, direction)
            level, normal = tube_level(self.slab, points)
            change = (level - fillet) / dot(normal, step)
            along = along - change
            if np.abs(change).max(initial=0.0) < NEWTON_TOLERANCE * cone.start:
                break
        return self.place(along, cone.bore + cone.slope * (along - cone.start) + out, direction), along

    def _guess(self, direction: Array) -> Array:
        """Return where along the ray the centres lie if the channel were a cylinder."""
        slab, line = self.slab, self.line
        across, up = (line.bore + slab.fillet) * direction.T
        out = slab.manifold_bore + slab.fillet
        ring = slab.manifold_radius + np.sqrt(out**2 - up**2)
        beyond = (line.angle > 0.5 * spread(slab) - 1e-9) & (across > 0.0)
        ball = slab.manifold_radius + np.sqrt(out**2 - up**2 - across**2)
        return np.where(beyond, ball, np.sqrt(ring**2 - across**2))

    def _lever(self, points: Array, turn: Array, start: Array) -> tuple[Array, Array, Array]:
        """Return how the distance of points, shape (n, 3), to the rim falls with the polar angle of centres on it: half the
        derivative of the squared distance, its sign changed; the square of how far the centre moves per radian; and where
        along the ray it is; shapes (n,). ``start`` is as of `rim`."""
        direction = np.column_stack([np.cos(turn), np.sin(turn)])
        centre, along = self.rim(direction, start)
        cone = self.line.cones[0]
        step = np.column_stack([np.ones(len(turn)), cone.slope * direction]) @ self.axes
        _, radius, _ = self.local(centre)
        around = self.place(np.zeros(len(turn)), radius, np.column_stack([-direction[:, 1], direction[:, 0]]))
        around = around - [0.0, 0.0, self.slab.offset]
        _, normal = tube_level(self.slab, centre)
        tangent = around - step * (dot(normal, around) / dot(normal, step))[:, None]
        return dot(points - centre, tangent), dot(tangent, tangent), along

    def nearest(self, points: Array) -> Array:
        """Return the centres on the rim closest to points near the rounding, shape (n, 3).

        Newton's method on the squared distance, with a least curvature and a largest step: about where the rim's centres of
        curvature lie several of its centres are equally near.
        """
        _, _, direction = self.local(points)
        turn = np.arctan2(direction[:, 1], direction[:, 0])
        _, along = self.rim(direction)
        left = np.arange(len(points))
        for _ in range(MAX_SEARCH_STEPS):
            here, at, start = points[left], turn[left], along[left]
            more, less = (self._lever(here, at + by, start)[0] for by in (TURN_STEP, -TURN_STEP))
            now, size, along[left] = self._lever(here, at, start)
            change = now / np.maximum((less - more) / (2.0 * TURN_STEP), MIN_CURVATURE_RATIO * size)
            change = np.clip(change, -MAX_TURN, MAX_TURN)
            turn[left] += change
            left = left[np.abs(change) >= 1e-9]  # the next would be its square
            if not len(left):
                break
        direction = np.column_stack([np.cos(turn), np.sin(turn)])
        return self.rim(direction, along)[0]

    def level(self, points: Array) -> tuple[Array, Array]:
        """Return the level of the wall with its rounding, shape (n,), and its gradient, shape (n, 3)."""
        first, level_one = tube_level(self.slab, points)
        second, other = self.cone_level(points)
        along, _, direction = self.local(points)
        # Behind the arc's centre line the prolonged cone is no wall.
        nearer = (first < second) | (along < self.line.start)
        level, normal = np.where(nearer, first, second), np.where(nearer[:, None], level_one, other)
        fillet = self.slab.fillet
        if fillet == 0.0:
            return level, normal
        close = np.flatnonzero(np.sqrt(((points - self.rim(direction)[0]) ** 2).sum(axis=1)) < ROUNDING_SEARCH_RADIUS * fillet)
        if not len(close):
            return level, normal
        centre = self.nearest(points[close])
        by_tube, by_cone = self.shares(centre, points[close] - centre)[:, :2].T
        first, second, level_one, other = first[close], second[close], level_one[close], other[close]
        inwards, away = unit(centre - points[close])
        # Beyond a touching line the wall itself is nearest, beyond both the nearer one.
        on_tube = (by_cone < 0.0) & ((by_tube >= 0.0) | (first < second))
        on_cone = (by_tube < 0.0) & ~on_tube
        level[close] = np.where(on_tube, first, np.where(on_cone, second, fillet - away))
        normal[close] = np.where(on_tube[:, None], level_one, np.where(on_cone[:, None], other, inwards))
        return level, normal

    def frame(self, centre: Array) -> Array:
        """Return the outward from the solid at both walls' gradients and along the rim: columns, shape (n, 3, 3)."""
        _, level_one = tube_level(self.slab, centre)
        _, other = self.cone_level(centre)
        return np.stack([-level_one, -other, unit(np.cross(level_one, other))[0]], axis=2)

    def shares(self, centre: Array, vectors: Array) -> Array:
        """Return the components of vectors in the `frame` at places on the rim, shape (n, 3)."""
        return np.linalg.solve(self.frame(centre), vectors[:, :, None])[:, :, 0]


ROUNDING_SEARCH_RADIUS = 1.5
"""Distance from the ball's centre, in its radii, up to which a place may belong to the rounding."""

MAX_NEWTON_STEPS, NEWTON_TOLERANCE = 8, 1e-9
"""Most of Newton's steps, and the share of the manifold's radius below which the last was: the next would be its square."""

TURN_STEP, MAX_TURN = 1e-4, 0.3
"""Step in radians of the differences with which the nearest centre is found, and the largest by which it is looked for."""

MAX_SEARCH_STEPS, MIN_CURVATURE_RATIO = 40, 0.1
"""Most steps of that search, and the least curvature it takes the squared distance to have, in that of a straight rim's."""


def dot(left: Array, other: Array) -> Array:
    """Return the products of rows, shape (n,)."""
    return np.asarray((left * other).sum(axis=1))


def unit(vectors: Array) -> tuple[Array, Array]:
    """Return the rows of length 1, shape (n, 3), and the lengths, shape (n,); the first axis where the length is 0."""
    lengths = np.sqrt(dot(vectors, vectors))
    if lengths.all():
        return vectors / lengths[:, None], lengths
    none = lengths == 0.0
    units = vectors / np.where(none, 1.0, lengths)[:, None]
    units[none, 0] = 1.0
    return units, lengths


def tube_level(slab: SeminarActuator, points: Array) -> tuple[Array, Array]:
    """Return the level of the manifold's wall with its round ends, shape (n,), and its gradient, shape (n, 3)."""
    half = 0.5 * spread(slab)
    turn = np.clip(np.arctan2(points[:, 1], points[:, 0]), -half, half)
    foot = np.column_stack(
        [slab.manifold_radius * np.cos(turn), slab.manifold_radius * np.sin(turn), np.full(len(turn), slab.offset)]
    )
    normal, away = unit(points - foot)
    return away - slab.manifold_bore, normal


# ----------------------------------------------------------------------------------------------------------------------
# Where the walls of a seminar actuator's air lie on another one: each wall by its own coordinates.
#
# The manifold, the channels and their round ends have coordinates of their own, which carry each wall to the other's. Between a
# channel and the manifold, at the crease or its rounding, a frame that rolls along it carries both; what that leaves is taken
# away along the wall's gradient.


CREASE_BLEND_LENGTH = 1.5
"""Bores of the manifold over which the crease's motion passes into that of the walls."""


def smooth(share: Array) -> Array:
    """From 0 to 1 as a share does, with two derivatives that vanish at both ends."""
    share = np.clip(share, 0.0, 1.0)
    return share**3 * (10.0 + share * (6.0 * share - 15.0))


@dataclasses.dataclass(frozen=True)
class _Pair:
    """One channel on the slab that is carried and on the other, and the distances from the crease within which all moves with
    its junction, and from which on nothing does."""

    source: Junction
    target: Junction
    inner: float
    outer: float


def _pairs(slab: SeminarActuator, other: SeminarActuator) -> list[_Pair]:
    lines, its_lines = half_fan(slab), half_fan(other)
    pairs: list[_Pair] = []
    for number, (line, its_line) in enumerate(zip(lines, its_lines, strict=True)):
        assert line is not None and its_line is not None  # checked by the constructor
        gaps = [
            0.5 * (slab.manifold_radius * abs(line.angle - next_angle) - line.bore - bore)
            for next_angle, bore in _adjacent_walls(lines, number)
        ]
        room = line.cones[0].end - slab.manifold_radius - slab.manifold_bore - slab.fillet
        gap = min([*gaps, math.inf])
        inner = min(1.05 * slab.fillet or 0.3 * line.bore, 0.4 * gap, max(0.5 * room, 0.1 * line.bore))
        outer = inner + min(CREASE_BLEND_LENGTH * slab.manifold_bore, 0.95 * gap - inner, max(0.5 * room, 0.1 * line.bore))
        pairs.append(_Pair(Junction(slab, line), Junction(other, its_line), inner, outer))
    return pairs


def _adjacent_walls(lines: list[Channel | None], number: int) -> list[tuple[float, float]]:
    """Return the angles and bores of the channels beside one, the image of the first included."""
    known = [line for line in lines if line is not None]
    beside = [(line.angle, line.bore) for line in (known[number - 1 : number] + known[number + 1 : number + 2])]
    return [*beside, (-known[0].angle, known[0].bore)] if number == 0 and known[0].angle > 0.0 else beside


def carry_network(slab: SeminarActuator, other: SeminarActuator, points: Array) -> tuple[Array, Array]:
    """Return the distance of points from the air, shape (n,), and where the network's motion takes them, shape (n, 3)."""
    pairs = _pairs(slab, other)
    first, _ = tube_level(slab, points)
    tube = _tube_map(slab, other, [(pair.source.line, pair.target.line) for pair in pairs])(points)
    levels = np.array([_channel_level(pair.source, points) for pair in pairs])
    nearest = levels.argmin(axis=0)
    near, moved_points = np.minimum(first, levels.min(axis=0)), tube.copy()
    for number, pair in enumerate(pairs):
        mine = np.flatnonzero(nearest == number)
        if len(mine):
            moved_points[mine], near[mine] = _nearest_places(pair, points[mine], tube[mine], first[mine], levels[number, mine])
    return near, moved_points


def _nearest_places(pair: _Pair, points: Array, tube: Array, first: Array, second: Array) -> tuple[Array, Array]:
    """Return where points nearest to one channel go, and their distance from the air. ``points`` and ``tube``, where the
    manifold's motion takes them, are in m, shape (n, 3); ``first`` and ``second`` levels of the manifold and of the channel,
    shape (n,)."""
    slab = pair.source.slab
    square, two = np.maximum(first, 0.0) ** 2, np.maximum(second, 0.0) ** 2
    by_tube = np.where(square + two > 0.0, two / np.maximum(square + two, 1e-300), 0.5)[:, None]
    # Inside one's air the other's wall is the boundary.
    by_tube = np.where((first < 0.0)[:, None] & (first < second)[:, None], 1.0, by_tube)
    by_tube = np.where((second < 0.0)[:, None] & (second <= first)[:, None], 0.0, by_tube)
    moved_points = by_tube * tube + (1.0 - by_tube) * _channel_map(pair, points)
    near = np.minimum(first, second)
    along, _, _ = pair.source.local(points)
    crease = np.hypot(np.maximum(first, 0.0), np.maximum(second, 0.0))
    # The channel's wall, prolonged, leaves the manifold at its back too, where there is no crease.
    front = smooth((along - slab.manifold_radius + 0.5 * slab.manifold_bore) / (0.8 * slab.manifold_bore))
    weight = front * (1.0 - smooth((crease - pair.inner) / (pair.outer - pair.inner)))
    zone = np.flatnonzero(weight > 0.0)
    if len(zone):
        some = points[zone]
        moved = weight[zone, None] * _crease_map(pair, some) + (1.0 - weight[zone, None]) * moved_points[zone]
        target, _ = pair.source.level(some)
        if slab.fillet == 0.0:
            moved = _onto_wall(pair, moved, first[zone], second[zone])
        else:
            fade = 1.0 - smooth(1.5 * np.abs(target) / slab.manifold_bore - 0.5)
            moved += fade[:, None] * (_onto_rounding(pair, moved, target) - moved)
        if (pair.target.local(moved)[0] > pair.target.line.cones[0].end).any():
            raise GeometryError(
                f"the channel at {math.degrees(pair.target.line.angle):.3g} deg becomes so short that its end meets the crease "
                "at the manifold, where the mesh cannot follow; make a new mesh"
            )
        moved_points[zone], near[zone] = moved, target
    return moved_points, near


def _onto_rounding(pair: _Pair, points: Array, target: Array) -> Array:
    """Return the points moved along the gradient until the rounded wall's level is what it was."""
    for _ in range(3):  # levels are distances: one step does nearly all
        level, normal = pair.target.level(points)
        gap = level - target
        points = points - gap[:, None] * normal
        if np.abs(gap).max(initial=0.0) < 1e-7 * pair.target.slab.manifold_bore:
            break  # the next would be its square
    return points


def _onto_wall(pair: _Pair, points: Array, first: Array, second: Array) -> Array:
    """Return the points moved until the level of the nearer of two walls that meet in a sharp crease is what it was."""
    nearer = first < second
    for _ in range(4):
        (level_one, normal), (two, its_normal) = tube_level(pair.target.slab, points), pair.target.cone_level(points)
        gap = np.where(nearer, level_one - first, two - second)
        points = points - gap[:, None] * np.where(nearer[:, None], normal, its_normal)
    return points


def _crease_map(pair: _Pair, points: Array) -> Array:
    """Return the motion with the crease: components in the frame that rolls along both walls stay, in radii of the rounding."""
    _, _, direction = pair.source.local(points)
    centre, its_centre = pair.source.rim(direction)[0], pair.target.rim(direction)[0]
    size = pair.target.slab.fillet / pair.source.slab.fillet if pair.source.slab.fillet else 1.0
    shares = size * pair.source.shares(centre, points - centre)
    return its_centre + np.einsum("nij,nj->ni", pair.target.frame(its_centre), shares)


def _channel_level(junction: Junction, points: Array) -> Array:
    """Return the level of a whole channel, a ball of its bore at the beginning and its cap included."""
    line = junction.line
    along, radius, _ = junction.local(points)
    level = np.hypot(along - line.start, radius) - line.bore
    for cone in line.cones:
        wall = (radius - cone.bore - cone.slope * (along - cone.start)) / math.hypot(1.0, cone.slope)
        level = np.where(along > cone.start, wall, level)
    return np.where(along > line.end, np.hypot(along - line.centre, radius) - line.cap, level)


def _stretched_places(along: Array, length: Array, its_length: Array, *, rigid: bool) -> Array:
    """Return the places along a length on another length, which rise; with slope 1 at the beginning if that is rigid.

    A rational function of second degree (Gregory and Delbourgo, IMA J. Numer. Anal. 2, 1982, doi:10.1093/imanum/2.2.123).
    """
    share, ratio = along / length, its_length / length
    first = 1.0 if rigid else ratio
    inner = np.where((share > 0.0) & (share < 1.0), share * (1.0 - share), 0.0)
    moved = its_length * (ratio * share**2 + first * inner) / (ratio + (first - ratio) * inner)
    moved = np.where(share < 0.0, first * along, moved)
    return np.where(share > 1.0, its_length + ratio * (along - length), moved)


def _channel_map(pair: _Pair, points: Array) -> Array:
    """Return a channel onto the other's: shares of each cone's length from the crease on, angles and heights over the wall."""
    line, its_line = pair.source.line, pair.target.line
    along, radius, direction = pair.source.local(points)
    begin, its_begin = pair.source.rim(direction)[1], pair.target.rim(direction)[1]
    to = np.zeros_like(along)
    height = np.zeros_like(along)
    for number, (cone, its_cone) in enumerate(zip(line.cones, its_line.cones, strict=True)):
        mine = along >= cone.start if number else np.full(len(along), True)
        start, its_start = (np.array(cone.start), np.array(its_cone.start)) if number else (begin, its_begin)
        at = its_start + _stretched_places(along - start, cone.end - start, its_cone.end - its_start, rigid=not number)
        wall, its_wall = (part.bore + part.slope * (s - part.start) for part, s in ((cone, along), (its_cone, at)))
        to, height = np.where(mine, at, to), np.where(mine, its_wall + radius - wall, height)
    # The cap, by the angle from its pole.
    turn, its_turn = (0.5 * math.pi + math.atan(part.cones[-1].slope) for part in (line, its_line))
    angle = np.arctan2(radius, along - line.centre) * (its_turn / turn)
    size = its_line.cap + np.hypot(along - line.centre, radius) - line.cap
    cap = along > line.end
    to, height = np.where(cap, its_line.centre + size * np.cos(angle), to), np.where(cap, size * np.sin(angle), height)
    return pair.target.place(to, height, direction)


def _tube_map(slab: SeminarActuator, other: SeminarActuator, lines: list[tuple[Channel, Channel]]) -> Callable[[Array], Array]:
    """Return the manifold onto the other's: by angle along the arc, angle around it and height over its wall."""
    turn_map = arc_map(slab, other, lines)
    half, its_half = 0.5 * spread(slab), 0.5 * spread(other)

    def carry(points: Array) -> Array:
        turn = np.clip(np.arctan2(points[:, 1], points[:, 0]), -half, half)
        its_turn = np.clip(turn_map(turn), -its_half, its_half)
        c, s, its_c, its_s = np.cos(turn), np.sin(turn), np.cos(its_turn), np.sin(its_turn)
        x, y = points[:, 0] - slab.manifold_radius * c, points[:, 1] - slab.manifold_radius * s
        z = points[:, 2] - slab.offset
        out, across = c * x + s * y, -s * x + c * y
        away = np.sqrt(x**2 + y**2 + z**2)
        # From the middle of the tube on, heights over the wall stay; inside, nothing lies.
        size = (other.manifold_bore + away - slab.manifold_bore) / np.maximum(away, 1e-3 * slab.manifold_bore)
        out, across, z = size * out + other.manifold_radius, size * across, size * z
        return np.column_stack([its_c * out - its_s * across, its_s * out + its_c * across, z + other.offset])

    return carry


# ----------------------------------------------------------------------------------------------------------------------
# Where the boundary of a seminar actuator lies on another one.
#
# The outer faces follow the outline, from corner to corner and from tangent point to tangent point, the walls of the air go
# their own way (below). On the mirror plane, what lies between the air and the faces follows both, more the nearer one.


FOLLOWED_LENGTH_SHARE = 0.95
"""Part of a channel's length whose motion the faces above and below follow."""


def carried(slab: SeminarActuator, other: SeminarActuator, points: Array) -> Array:
    """Return where points on the boundary of a slab lie on another; see `Actuator.carried`."""
    revolved.check_alike(slab, other, ("channels", "part", "tip", "order"), ("tip_radius", "fillet"))
    if bool(slab.middle_bores) != bool(other.middle_bores):
        raise GeometryError("only one of two slabs has middle_bores; a mesh cannot follow that, make a new one")
    points = np.asarray(points, dtype=float)
    if other == slab:
        return points.copy()
    folded = np.column_stack([points[:, 0], np.abs(points[:, 1]), points[:, 2]])
    near, result = carry_network(slab, other, folded)
    outer = _prism_outline(slab, other, folded)
    away = _to_faces(slab, folded)
    near = np.maximum(near, 0.0)
    # On a face nothing of the network's motion is left, on a wall nothing of the faces'.
    share = near / np.maximum(near + away, 1e-300)
    share = (share**2 * (3.0 - 2.0 * share))[:, None]
    moved = (1.0 - share) * result + share * outer
    moved[:, 1] = np.where(np.abs(points[:, 1]) < 1e-10 * slab.length, 0.0, np.copysign(moved[:, 1], points[:, 1]))
    return moved


def _lengths(slab: SeminarActuator, other: SeminarActuator) -> Callable[[Array], Array]:
    """Return a smooth, rising function from places along one slab's straight sides to those along the other's.

    The faces move along with the network below them: with the manifold and with the end of the channel that reaches farthest.
    """
    knots = []
    for device in (slab, other):
        far = max((line.centre + line.cap) * math.cos(line.angle) for line in half_fan(device) if line)
        start = device.manifold_radius
        knots.append([0.0, start, start + FOLLOWED_LENGTH_SHARE * (far - start), side(device)[1][0]])
    if knots[0][2] > FOLLOWED_LENGTH_SHARE * knots[0][3]:  # the channels reach into the tip
        knots = [[low, start, end] for low, start, _, end in knots]
    if min(np.diff(knots[1])) <= 0.0:
        raise GeometryError("the channels reach so much farther into the tip that the mesh cannot follow; make a new mesh")
    carry = scipy.interpolate.PchipInterpolator(*knots)
    return lambda x: np.asarray(carry(np.clip(x, 0.0, knots[0][-1])))


def _prism_outline(slab: SeminarActuator, other: SeminarActuator, points: Array) -> Array:
    """Return the slab without channels onto the other's."""
    x, y, z = points.T
    (_, (corner, edge)), (_, (its_corner, its_edge)) = side(slab), side(other)
    wide, its_wide = 0.5 * slab.base_width, 0.5 * other.base_width
    to = _lengths(slab, other)(x)
    width, its_width = wide + (edge - wide) * (x / corner), its_wide + (its_edge - its_wide) * (to / its_corner)
    prism_outline = np.column_stack([to, y * its_width / np.maximum(width, 1e-300), z * (other.thickness / slab.thickness)])
    if slab.tip_radius:
        middle, its_middle = slab.length - slab.tip_radius, other.length - other.tip_radius
        bend = math.atan2(its_edge, its_corner - its_middle) / math.atan2(edge, corner - middle)
        turn = np.arccos(np.clip((x - middle) / slab.tip_radius, -1.0, 1.0))
        growth = other.tip_radius / slab.tip_radius
        ratio = growth * np.where(turn > 1e-7, np.sin(bend * turn) / np.sin(np.maximum(turn, 1e-7)), bend)
        round_ = (x > corner)[:, None]
        prism_outline = np.where(
            round_,
            np.column_stack([its_middle + other.tip_radius * np.cos(bend * turn), y * ratio, prism_outline[:, 2]]),
            prism_outline,
        )
    return prism_outline


def _to_faces(slab: SeminarActuator, points: Array) -> Array:
    """Return a smooth distance from all outer faces: 0 on each, below the least of the distances inside."""
    x, y, z = points.T
    normal, (corner, edge) = side(slab)
    middle = slab.length - slab.tip_radius
    straight = (corner - x) * normal[0] + (edge - y) * normal[1]
    along = (x - corner) * normal[1] - (y - edge) * normal[0]
    flank = np.where(along > 0.0, slab.tip_radius - np.hypot(x - middle, y), straight)
    half, least = 0.5 * slab.thickness, 1e-9 * slab.thickness  # nearer is on it: the flank's distance is rounded
    gaps = [np.where(gap > least, gap, 1e-30) for gap in (half - z, half + z, x, flank)]
    return 1.0 / np.sum([1.0 / gap for gap in gaps], axis=0)
