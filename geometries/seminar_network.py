"""Where the walls of a seminar actuator's air lie on another one: each wall by its own coordinates.

The manifold, the channels and their round ends have coordinates of their own, which carry each wall to the other's. Between a
channel and the manifold, at the crease or its rounding, a frame that rolls along it carries both; what that leaves is taken
away along the wall's gradient.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from geometries.errors import GeometryError
from geometries.seminar_arc import arc_map
from geometries.seminar_junction import Array, Junction, tube_level
from geometries.seminar_plan import Channel, half_fan, spread

if TYPE_CHECKING:
    from geometries.seminar import SeminarActuator

REACH = 1.5
"""Bores of the manifold over which the crease's motion passes into that of the walls."""


def smooth(share: Array) -> Array:
    """From 0 to 1 as a share does, with two derivatives that vanish at both ends."""
    share = np.clip(share, 0.0, 1.0)
    return share**3 * (10.0 + share * (6.0 * share - 15.0))


@dataclasses.dataclass(frozen=True)
class _Pair:
    """One channel on both devices, and how far its junction's motion reaches.

    Attributes:
        one: On the slab that is carried.
        two: On the other.
        inner: Distance from the crease within which all moves with it.
        outer: Distance from the crease from which on nothing does.
    """

    one: Junction
    two: Junction
    inner: float
    outer: float


def _pairs(slab: SeminarActuator, other: SeminarActuator) -> list[_Pair]:
    lines, its_lines = half_fan(slab), half_fan(other)
    found: list[_Pair] = []
    for number, (line, its_line) in enumerate(zip(lines, its_lines, strict=True)):
        assert line is not None and its_line is not None  # the constructor has refused it
        gaps = [
            0.5 * (slab.manifold_radius * abs(line.angle - next_angle) - line.bore - bore)
            for next_angle, bore in _neighbours(lines, number)
        ]
        room = line.cones[0].end - slab.manifold_radius - slab.manifold_bore - slab.fillet
        gap = min([*gaps, math.inf])
        inner = min(1.05 * slab.fillet or 0.3 * line.bore, 0.4 * gap, max(0.5 * room, 0.1 * line.bore))
        outer = inner + min(REACH * slab.manifold_bore, 0.95 * gap - inner, max(0.5 * room, 0.1 * line.bore))
        found.append(_Pair(Junction(slab, line), Junction(other, its_line), inner, outer))
    return found


def _neighbours(lines: list[Channel | None], number: int) -> list[tuple[float, float]]:
    """Angles and bores of the channels beside one, the image of the first included."""
    known = [line for line in lines if line is not None]
    beside = [(line.angle, line.bore) for line in (known[number - 1 : number] + known[number + 1 : number + 2])]
    return [*beside, (-known[0].angle, known[0].bore)] if number == 0 and known[0].angle > 0.0 else beside


def carry_network(slab: SeminarActuator, other: SeminarActuator, points: Array) -> tuple[Array, Array]:
    """Distance of points from the air, shape (n,), and where the network's motion takes them, shape (n, 3)."""
    pairs = _pairs(slab, other)
    first, _ = tube_level(slab, points)
    tube = _tube_map(slab, other, [(pair.one.line, pair.two.line) for pair in pairs])(points)
    levels = np.array([_channel_level(pair.one, points) for pair in pairs])
    nearest = levels.argmin(axis=0)
    near, found = np.minimum(first, levels.min(axis=0)), tube.copy()
    for number, pair in enumerate(pairs):
        mine = np.flatnonzero(nearest == number)
        if len(mine):
            found[mine], near[mine] = _beside(pair, points[mine], tube[mine], first[mine], levels[number, mine])
    return near, found


def _beside(pair: _Pair, points: Array, tube: Array, first: Array, second: Array) -> tuple[Array, Array]:
    """Where points nearest to one channel go, and their distance from the air.

    Args:
        pair: The channel.
        points: Places in m, shape (n, 3).
        tube: Where the manifold's motion takes them, shape (n, 3).
        first: Levels of the manifold, shape (n,).
        second: Levels of the channel, shape (n,).
    """
    slab = pair.one.slab
    one, two = np.maximum(first, 0.0) ** 2, np.maximum(second, 0.0) ** 2
    by_tube = np.where(one + two > 0.0, two / np.maximum(one + two, 1e-300), 0.5)[:, None]
    # Inside one's air the other's wall is the boundary.
    by_tube = np.where((first < 0.0)[:, None] & (first < second)[:, None], 1.0, by_tube)
    by_tube = np.where((second < 0.0)[:, None] & (second <= first)[:, None], 0.0, by_tube)
    found = by_tube * tube + (1.0 - by_tube) * _channel_map(pair, points)
    near = np.minimum(first, second)
    along, _, _ = pair.one.local(points)
    crease = np.hypot(np.maximum(first, 0.0), np.maximum(second, 0.0))
    # The channel's wall, prolonged, leaves the manifold at its back too, where there is no crease.
    front = smooth((along - slab.manifold_radius + 0.5 * slab.manifold_bore) / (0.8 * slab.manifold_bore))
    weight = front * (1.0 - smooth((crease - pair.inner) / (pair.outer - pair.inner)))
    zone = np.flatnonzero(weight > 0.0)
    if len(zone):
        some = points[zone]
        moved = weight[zone, None] * _crease_map(pair, some) + (1.0 - weight[zone, None]) * found[zone]
        target, _ = pair.one.level(some)
        if slab.fillet == 0.0:
            moved = _onto_wall(pair, moved, first[zone], second[zone])
        else:
            fade = 1.0 - smooth(1.5 * np.abs(target) / slab.manifold_bore - 0.5)
            moved += fade[:, None] * (_onto_rounding(pair, moved, target) - moved)
        if (pair.two.local(moved)[0] > pair.two.line.cones[0].end).any():
            raise GeometryError(
                f"the channel at {math.degrees(pair.two.line.angle):.3g} deg becomes so short that its end meets the crease at "
                "the manifold, where the mesh cannot follow; make a new mesh"
            )
        found[zone], near[zone] = moved, target
    return found, near


def _onto_rounding(pair: _Pair, points: Array, target: Array) -> Array:
    """Points moved along the gradient until the rounded wall's level is what it was."""
    for _ in range(3):  # levels are distances: one step does nearly all
        level, normal = pair.two.level(points)
        gap = level - target
        points = points - gap[:, None] * normal
        if np.abs(gap).max(initial=0.0) < 1e-7 * pair.two.slab.manifold_bore:
            break  # the next would be its square
    return points


def _onto_wall(pair: _Pair, points: Array, first: Array, second: Array) -> Array:
    """Points moved until the level of the nearer of two walls that meet in a sharp crease is what it was."""
    nearer = first < second
    for _ in range(4):
        (one, normal), (two, its_normal) = tube_level(pair.two.slab, points), pair.two.cone_level(points)
        gap = np.where(nearer, one - first, two - second)
        points = points - gap[:, None] * np.where(nearer[:, None], normal, its_normal)
    return points


def _crease_map(pair: _Pair, points: Array) -> Array:
    """Motion with the crease: components in the frame that rolls along both walls stay, in radii of the rounding."""
    _, _, direction = pair.one.local(points)
    centre, its_centre = pair.one.rim(direction)[0], pair.two.rim(direction)[0]
    size = pair.two.slab.fillet / pair.one.slab.fillet if pair.one.slab.fillet else 1.0
    shares = size * pair.one.shares(centre, points - centre)
    return its_centre + np.einsum("nij,nj->ni", pair.two.frame(its_centre), shares)


def _channel_level(junction: Junction, points: Array) -> Array:
    """Level of a whole channel, a ball of its bore at the beginning and its cap included."""
    line = junction.line
    along, radius, _ = junction.local(points)
    level = np.hypot(along - line.start, radius) - line.bore
    for cone in line.cones:
        wall = (radius - cone.bore - cone.slope * (along - cone.start)) / math.hypot(1.0, cone.slope)
        level = np.where(along > cone.start, wall, level)
    return np.where(along > line.end, np.hypot(along - line.centre, radius) - line.cap, level)


def _stretched(along: Array, length: Array, its_length: Array, *, rigid: bool) -> Array:
    """Places along a length on another length, which rise; with slope 1 at the beginning if that is rigid.

    A rational function of second degree (Gregory and Delbourgo, IMA J. Numer. Anal. 2, 1982, doi:10.1093/imanum/2.2.123).
    """
    share, ratio = along / length, its_length / length
    first = 1.0 if rigid else ratio
    inner = np.where((share > 0.0) & (share < 1.0), share * (1.0 - share), 0.0)
    found = its_length * (ratio * share**2 + first * inner) / (ratio + (first - ratio) * inner)
    found = np.where(share < 0.0, first * along, found)
    return np.where(share > 1.0, its_length + ratio * (along - length), found)


def _channel_map(pair: _Pair, points: Array) -> Array:
    """A channel onto the other's: shares of each cone's length from the crease on, angles and heights over the wall."""
    line, its_line = pair.one.line, pair.two.line
    along, radius, direction = pair.one.local(points)
    begin, its_begin = pair.one.rim(direction)[1], pair.two.rim(direction)[1]
    to = np.zeros_like(along)
    height = np.zeros_like(along)
    for number, (cone, its_cone) in enumerate(zip(line.cones, its_line.cones, strict=True)):
        mine = along >= cone.start if number else np.full(len(along), True)
        start, its_start = (np.array(cone.start), np.array(its_cone.start)) if number else (begin, its_begin)
        at = its_start + _stretched(along - start, cone.end - start, its_cone.end - its_start, rigid=not number)
        wall, its_wall = (part.bore + part.slope * (s - part.start) for part, s in ((cone, along), (its_cone, at)))
        to, height = np.where(mine, at, to), np.where(mine, its_wall + radius - wall, height)
    # The cap, by the angle from its pole.
    turn, its_turn = (0.5 * math.pi + math.atan(part.cones[-1].slope) for part in (line, its_line))
    angle = np.arctan2(radius, along - line.centre) * (its_turn / turn)
    size = its_line.cap + np.hypot(along - line.centre, radius) - line.cap
    cap = along > line.end
    to, height = np.where(cap, its_line.centre + size * np.cos(angle), to), np.where(cap, size * np.sin(angle), height)
    return pair.two.place(to, height, direction)


def _tube_map(
    slab: SeminarActuator, other: SeminarActuator, lines: list[tuple[Channel, Channel]]
) -> Callable[[Array], Array]:
    """The manifold onto the other's: by angle along the arc, angle around it and height over its wall."""
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
