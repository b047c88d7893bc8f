"""The seminar actuator seen from above: outline, centre lines of the channels, and distances between them.

Everything here is plain geometry in the plane (x, y), in m, without Gmsh: the checks, the shape and the cell sizes share it.
"""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from geometries.seminar import SeminarActuator

Place = tuple[float, float]


class Cone(NamedTuple):
    """A part of a channel.

    Attributes:
        start: Distance along the ray at which it begins.
        bore: Its radius there.
        slope: Growth of its radius per length.
        end: Distance at which it ends.
    """

    start: float
    bore: float
    slope: float
    end: float


class Channel(NamedTuple):
    """A straight channel on a ray from the base's middle: one cone or two, and a round cap that continues it without a corner.

    Attributes:
        angle: Of the ray against the x axis, in radians.
        cones: From the manifold's centre line to the cap.
        centre: Distance of the cap's centre.
        cap: Radius of the cap.
    """

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
        """Radius of the section at a distance along the ray; that of the last cone's end from there on."""
        cone = next((part for part in self.cones if along < part.end), self.cones[-1])
        return cone.bore + cone.slope * (min(along, self.end) - cone.start)


def side(slab: SeminarActuator) -> tuple[Place, Place]:
    """The straight side at y > 0: its outward unit normal, and where it meets the tip's rounding."""
    # The side is the tangent from the base's corner to the circle of the rounding.
    half, middle, radius = 0.5 * slab.base_width, slab.length - slab.tip_radius, slab.tip_radius
    reach = math.hypot(middle, half)
    angle = math.atan2(half, middle)  # of the line from the rounding's centre to the corner, against -x
    turn = angle + math.acos(radius / reach)
    normal = (-math.cos(turn), math.sin(turn))
    return normal, (middle + radius * normal[0], radius * normal[1])


def outline_area(slab: SeminarActuator) -> float:
    """Area of half the slab (y > 0) seen from above, in m2."""
    normal, (x, y) = side(slab)
    middle = slab.length - slab.tip_radius
    straight = 0.5 * (0.5 * slab.base_width * x + y * middle)  # corners (0, 0), (middle, 0), (x, y), (0, half width)
    return straight + 0.5 * slab.tip_radius**2 * math.atan2(normal[1], normal[0])


def edge_distance(slab: SeminarActuator, x: float, y: float) -> float:
    """Distance of a point inside from the slab's two sides and tip, the base not counted; negative outside."""
    normal, (tx, ty) = side(slab)
    y = abs(y)
    straight = (tx - x) * normal[0] + (ty - y) * normal[1]
    middle = slab.length - slab.tip_radius
    # Beyond the end of the straight side, the rounding is what is near.
    along = (x - tx) * normal[1] - (y - ty) * normal[0]
    return slab.tip_radius - math.hypot(x - middle, y) if along > 0.0 else straight


def half_count(slab: SeminarActuator) -> int:
    """How many channels have y >= 0: as many entries as a list of channels has."""
    return (slab.channels + 1) // 2


def spread(slab: SeminarActuator) -> float:
    """Angle of the manifold's arc in radians, which is that between the outermost channels."""
    return math.radians(2.0 * slab.angles[-1] if slab.angles else slab.spread)


def half_angles(slab: SeminarActuator) -> list[float]:
    """Directions in radians of the channels with y >= 0, from the middle outwards."""
    if slab.angles:
        return [math.radians(angle) for angle in slab.angles]
    if slab.channels == 1:
        return [0.0]
    half = 0.5 * math.radians(slab.spread)
    return [half * (2 * k - slab.channels + 1) / (slab.channels - 1) for k in range(slab.channels // 2, slab.channels)]


def own(slab: SeminarActuator, several: str, common: str, number: int) -> tuple[float, str]:
    """A channel's own value and the name it was given by: an entry of a list, or what is common to all.

    Args:
        slab: The device.
        several: Name of the list.
        common: Name of the parameter where the list is empty.
        number: Of the channel, from 1 in the middle outwards.
    """
    values = getattr(slab, several)
    return (values[number - 1], f"{several}[{number}]") if values else (getattr(slab, common), common)


def half_fan(slab: SeminarActuator) -> list[Channel | None]:
    """The channels with y >= 0, from the middle outwards; None in place of one for which there is no room."""
    return [_channel(slab, number, angle) for number, angle in enumerate(half_angles(slab), 1)]


def fan(slab: SeminarActuator) -> list[Channel | None]:
    """All channels from the one at the smallest y to that at the largest; None in place of one without room."""
    half = half_fan(slab)
    mirrored = [line and line._replace(angle=-line.angle) for line in half[slab.channels % 2 :]]
    return [*reversed(mirrored), *half]


def pairs(lines: list[Channel]) -> list[tuple[int, int, Channel, Channel, float]]:
    """Neighbouring channels with their numbers and the angle between them; the first of an even number with its image."""
    middle = [(1, 1, lines[0], lines[0], 2.0 * lines[0].angle)] if lines[0].angle > 0.0 else []
    couples = enumerate(itertools.pairwise(lines), 1)
    return middle + [(k, k + 1, one, other, other.angle - one.angle) for k, (one, other) in couples]


def _channel(slab: SeminarActuator, number: int, angle: float) -> Channel | None:
    """The channel along a direction: as long as its list says, or as the sides leave room; None if there is none."""
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
    """Distance along a ray at which the sides are as near as ``need``; 0 if they are nearer at the manifold."""
    c, s = math.cos(angle), math.sin(angle)
    low, high = slab.manifold_radius, slab.length
    if edge_distance(slab, low * c, low * s) <= need:
        return 0.0
    for _ in range(60):  # the distance falls along the ray only near its end: the slab is convex, so one crossing
        middle = 0.5 * (low + high)
        low, high = (middle, high) if edge_distance(slab, middle * c, middle * s) > need else (low, middle)
    return low


def _centre(reach: float, start: float, end_bore: float, growth: float) -> float:
    """Distance of the centre of a cap that ends at ``reach``; 0 if there is no room for one.

    Args:
        reach: Distance at which the cap ends.
        start: Distance at which the channel begins.
        end_bore: Radius that the last cone would have at the centre.
        growth: The last cone's slope times the channel's length.
    """
    centre = reach - end_bore
    for _ in range(40):  # the cap is a little smaller than the end's bore; the slope hardly changes
        if centre <= start:
            return 0.0
        centre = reach - end_bore / math.hypot(1.0, growth / (centre - start))
    return centre
