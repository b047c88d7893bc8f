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
from collections.abc import Mapping, Sequence
from typing import ClassVar, NamedTuple

import numpy as np

from geometries import actuator, meshing, network, plates, registry
from geometries.actuator import Vector
from geometries.network import Network, Place
from softmodels.common import schema
from softmodels.common.errors import GeometryError


@registry.register_device
@dataclasses.dataclass(frozen=True, kw_only=True)
class SeminarActuator(actuator.MirroredHalf, actuator.HeldTip, plates.NetworkPlate):
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
    around: float = schema.number_field(8.0, "cells around the narrowest channel's section", shape=False)
    order: int = schema.choice_field(2, (1, 2), "order of the cells' geometry: 1 straight, 2 curved edges")
    part: str = actuator.part_field("slab")
    tip: str = actuator.tip_field(held="its rounding")

    stem: ClassVar = "seminar"
    alike: ClassVar = ("channels", "part", "tip", "order")
    rounded: ClassVar = ("tip_radius", "fillet")
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
    def movable(self) -> tuple[str, ...]:
        # A corner has no rounding's faces, and a slab symmetric about z = 0 stays so.
        fixed = {name for name in ("tip_radius", "fillet", "offset") if getattr(self, name) == 0.0}
        fixed |= {"angles[1]"} if self.channels % 2 else set()
        return tuple(name for name in actuator.parameter_names(self) if name not in fixed)

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

    @property
    def drawn(self) -> Network:
        return _drawn(self)

    @property
    def normals(self) -> tuple[Vector, ...]:
        above = ((0.0, 0.0, -1.0),) if self.level else ()
        return ((0.0, -1.0, 0.0), *above)

    def side_roles(self, corners: Sequence[Place]) -> list[str]:
        return ["outer", *["tip"] * (len(corners) - 3), "outer", "support"]


# ----------------------------------------------------------------------------------------------------------------------
# The seminar actuator seen from above: outline, centre lines of the channels, and distances between them.
#
# Everything here is plain geometry in the plane (x, y), in m, without Gmsh: the checks and the shape share it.


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


@functools.lru_cache(maxsize=64)
def _drawn(slab: SeminarActuator) -> Network:
    """Return the network and the outline of a slab, each with as many corners whatever its lengths."""
    turns = 0.5 * spread(slab) * np.linspace(-1.0, 1.0, ARC_PIECES + 1)
    arc = slab.manifold_radius * np.column_stack([np.cos(turns), np.sin(turns)])
    channels = [network.Channel.along("the manifold", arc, slab.offset, (slab.manifold_bore,) * 2)]
    for number, line in enumerate((line for line in fan(slab) if line), 1):
        # Balls whose hull has the cone's wall are smaller than its sections there.
        cosines = [1.0 / math.hypot(1.0, cone.slope) for cone in line.cones]
        stops = [(line.start, line.bore * cosines[0]), (line.centre, line.cap)]
        if len(line.cones) > 1:
            stops.insert(1, (line.cones[0].end, line.cones[1].bore * float(np.mean(cosines))))
        c, s = math.cos(line.angle), math.sin(line.angle)
        places, radii = tuple((c * along, s * along, slab.offset) for along, _ in stops), tuple(radius for _, radius in stops)
        channels.append(network.Channel(f"channel {number}", places, radii))
    half, tip = 0.5 * slab.base_width, [(slab.length, 0.0)]
    if slab.tip_radius:
        middle, (normal, _) = slab.length - slab.tip_radius, side(slab)
        turns = math.atan2(normal[1], normal[0]) * np.linspace(-1.0, 1.0, ARC_PIECES + 1)
        tip = [(middle + slab.tip_radius * math.cos(turn), slab.tip_radius * math.sin(turn)) for turn in turns.tolist()]
        tip[ARC_PIECES // 2] = (slab.length, 0.0)
    return Network(tuple(channels), (((0.0, -half), *tip, (0.0, half)),))


ARC_PIECES = 24
"""Straight pieces of the manifold's centre line, and sides of the rounding at the tip; even, for a corner in the middle."""


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
    slab.check_around()
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
