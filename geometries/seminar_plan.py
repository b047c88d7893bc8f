"""The seminar actuator seen from above: outline, centre lines of the channels, and distances between them.

Everything here is plain geometry in the plane (x, y), in m, without Gmsh: the checks, the shape and the cell sizes share it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from geometries.seminar import SeminarActuator

Place = tuple[float, float]


class Channel(NamedTuple):
    """A straight channel on a ray from the base's middle: a cone, and a round cap that continues it without a corner.

    Attributes:
        angle: Of the ray against the x axis, in radians.
        start: Distance at which the channel begins, on the manifold's centre line.
        bore: Its radius there.
        slope: Growth of its radius per length.
        end: Distance at which the cone ends and the cap begins.
        centre: Distance of the cap's centre.
        cap: Radius of the cap.
    """

    angle: float
    start: float
    bore: float
    slope: float
    end: float
    centre: float
    cap: float

    def radius(self, along: float) -> float:
        """Radius of the section at a distance along the ray; that of the cone's end from there on."""
        return self.bore + self.slope * (min(along, self.end) - self.start)


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


def angles(slab: SeminarActuator) -> list[float]:
    """Directions of the channels in radians, rising, symmetric about 0."""
    if slab.channels == 1:
        return [0.0]
    half = 0.5 * math.radians(slab.spread)
    return [half * (2 * k - slab.channels + 1) / (slab.channels - 1) for k in range(slab.channels)]


def channel(slab: SeminarActuator, angle: float) -> Channel | None:
    """The channel along a direction, as long as the sides leave room; None if there is none."""
    c, s = math.cos(angle), math.sin(angle)
    start = slab.manifold_radius
    low, high = start, slab.length
    need = slab.edge + slab.end_bore
    if edge_distance(slab, low * c, low * s) <= need:
        return None
    for _ in range(60):  # the distance falls along the ray only near its end: the slab is convex, so one crossing
        middle = 0.5 * (low + high)
        low, high = (middle, high) if edge_distance(slab, middle * c, middle * s) > need else (low, middle)
    slope = (slab.end_bore - slab.channel_bore) / (low - start)
    cosine = 1.0 / math.hypot(1.0, slope)
    cap = slab.end_bore * cosine  # the sphere around the centre that touches the cone
    return Channel(angle, start, slab.channel_bore, slope, low - cap * slope * cosine, low, cap)
