"""A network of round channels in a plate: its centre lines and bores, families of networks, walls between channels, the signed
distance from its air, and the surface of that.

A channel is a polyline with a radius at each corner: the union of balls on its lines, whose radius is linear in the length.
Channels that cross are joined there, and creases, also those within corners, are rounded. The distance alone says what is air,
so that any network is meshed in the same way: its level set is triangulated, and its corners are moved onto the exact surface.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
import re
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geometries import actuator, mesh_arrays, meshing
from geometries.actuator import Vector
from softmodels.common import schema, units
from softmodels.common.arrays import Array
from softmodels.common.errors import GeometryError
from softmodels.common.lazy import scipy

Place = tuple[float, float]


@dataclasses.dataclass(frozen=True)
class Channel:
    """A round channel: its name for messages, the corners of its centre line (m), a radius (m) at each, and the name of its
    cavity; channels of one cavity have one pressure."""

    name: str
    points: tuple[Vector, ...]
    radii: tuple[float, ...]
    cavity: str = ""

    def __post_init__(self) -> None:
        if not np.isfinite([*itertools.chain.from_iterable(self.points), *self.radii]).all():
            raise GeometryError(f"{self.name} has a place or a radius that is no number")
        if (least := min(self.radii)) < MIN_RADIUS:
            least_text = schema.shown(MIN_RADIUS, "m")
            raise GeometryError(f"{self.name} has a radius of {schema.shown(least, 'm')}; channels have at least {least_text}")

    @classmethod
    def along(cls, name: str, line: Array, offset: float, radii: tuple[float, float], cavity: str = "") -> Channel:
        """Return the channel along a polyline in the plane (m, shape (n, 2)) at a height, its radius linear in the length."""
        steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
        share = np.concatenate([[0.0], np.cumsum(steps)]) / steps.sum()
        points = tuple((float(x), float(y), offset) for x, y in line)
        return cls(name, points, tuple((radii[0] + share * (radii[1] - radii[0])).tolist()), cavity)

    @property
    def bore(self) -> float:
        """Its volume in m3, without the ends."""
        pieces = itertools.pairwise(zip(self.points, self.radii, strict=True))
        return sum(math.pi / 3.0 * math.dist(a, b) * (p * p + p * q + q * q) for (a, p), (b, q) in pieces)


MIN_RADIUS = 1e-5
"""Of a channel, in m."""


@dataclasses.dataclass(frozen=True)
class Network:
    """What is drawn of a plate: channels; closed paths of its outline, holes behind it (m, without the first corner again); and
    places where tubes enter."""

    channels: tuple[Channel, ...]
    outline: tuple[tuple[Place, ...], ...] = ()
    inlets: tuple[Place, ...] = ()
    remarks: tuple[str, ...] = ()

    @functools.cached_property
    def cavities(self) -> tuple[str, ...]:
        """Names of the cavities, in the order of their first channels."""
        return tuple(dict.fromkeys(channel.cavity for channel in self.channels))

    def channels_of(self, cavity: str) -> list[Channel]:
        """Return the channels of a cavity."""
        return [channel for channel in self.channels if channel.cavity == cavity]


@dataclasses.dataclass(frozen=True, eq=False)
class Nodes:
    """Places (m, shape (n, 3)) of the ends and corners of channels, those that lie together as one; and for each channel which
    of its points they are, and their numbers from 0."""

    places: Array
    points: tuple[mesh_arrays.Ints, ...]
    numbers: tuple[mesh_arrays.Ints, ...]

    @classmethod
    def of(cls, channels: Sequence[Channel]) -> Nodes:
        points, places, radii = [], [], []
        for each in channels:
            line = np.array(each.points)
            points.append(np.flatnonzero([True, *corners(line), True]))
            places.append(line[points[-1]])
            radii += [each.radii[number] for number in points[-1]]
        table = np.concatenate(places)
        pairs = scipy.spatial.cKDTree(table).query_pairs(COMMON_NODE_SHARE * min(radii), output_type="ndarray")
        number = actuator.joined(pairs, len(table))
        _, first = np.unique(number, return_index=True)
        ends = np.cumsum([len(own) for own in points])[:-1]
        return cls(table[first], tuple(points), tuple(np.split(number, ends)))

    def texts(self, channels: Sequence[Channel]) -> Iterator[str]:
        """Yield a line on each node: its number from 1, its place in mm and height, and its channels with their numbers."""
        for number, (x, y, z) in enumerate((1e3 * self.places).round(6).tolist()):
            own = [f"{k} ({each.name})" for k, each in enumerate(channels, 1) if number in self.numbers[k - 1]]
            yield f"node {number + 1} at ({x:.4g}, {y:.4g}) mm, offset {z:.4g} mm, of channel {', '.join(own)}"

    def moved(self, channels: Sequence[Channel], shifts: Array, ends: Array) -> tuple[Channel, ...]:
        """Return the channels with shifted nodes, and between them as they were, by shifts (m, shape (n, 3)) and what their
        radii at both ends grow by (m, shape (channels, 2))."""
        moved = []
        for each, points, numbers, growth in zip(channels, self.points, self.numbers, ends, strict=True):
            line = np.array(each.points)
            along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
            line += np.stack([np.interp(along, along[points], shifts[numbers, i]) for i in range(3)], axis=1)
            radii = np.array(each.radii) + growth[0] + along / along[-1] * (growth[1] - growth[0])
            places = tuple((float(x), float(y), float(z)) for x, y, z in line)
            moved.append(dataclasses.replace(each, points=places, radii=tuple(radii.tolist())))
        return tuple(moved)


def corners(line: Array) -> list[bool]:
    """Return which of the points between the ends of a line (m, shape (n, 3)) are corners of it."""
    along = np.diff(line, axis=0)
    along /= np.linalg.norm(along, axis=1)[:, None]
    turns: list[bool] = ((along[1:] * along[:-1]).sum(axis=1) < math.cos(MIN_CORNER_TURN)).tolist()
    return turns


MIN_CORNER_TURN = math.radians(15.0)
"""Turn between two pieces of a line above which their common end is a corner."""
COMMON_NODE_SHARE = 0.5
"""Two nodes that are nearer than this share of the least radius are one."""


def signed_area(path: Sequence[Place] | Array) -> float:
    """Return the area in m2 within a closed path of corners (m, shape (n, 2)), above 0 if it runs counterclockwise."""
    x, y = np.asarray(path).T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def depths(points: Array, paths: Sequence[Sequence[Place]]) -> Array:
    """Return how far points (m, shape (n, 2)) lie within the closed paths of an outline, holes behind it; below 0 outside."""
    inside = np.zeros(len(points), dtype=bool)
    away = np.full(len(points), np.inf)
    for path in paths:
        start = np.array(path)
        along = np.roll(start, -1, axis=0) - start
        off = points[:, None] - start
        share = np.clip((off * along).sum(axis=2) / (along**2).sum(axis=1), 0.0, 1.0)
        away = np.minimum(away, np.linalg.norm(off - share[..., None] * along, axis=2).min(axis=1))
        ends = start[:, 1] + along[:, 1]
        across = (start[:, 1] > points[:, 1:]) != (ends > points[:, 1:])
        with np.errstate(divide="ignore", invalid="ignore"):
            left = start[:, 0] + (points[:, 1:] - start[:, 1]) / along[:, 1] * along[:, 0]
        inside ^= (across & (points[:, :1] < left)).sum(axis=1) % 2 == 1
    return np.where(inside, away, -away)


def moved_with(points: Array, paths: Sequence[Sequence[Place]], others: Sequence[Sequence[Place]]) -> Array:
    """Return where points (m, shape (n, 2)) lie when the corners of closed paths move to those of others: straight sides stay
    straight, and what is within follows smoothly, by mean value coordinates (Hormann and Floater 2006,
    doi 10.1145/1183287.1183295)."""
    corners, goals = (np.concatenate([np.array(path) for path in each]) for each in (paths, others))
    if (parts := math.ceil(len(points) * len(corners) / MAX_PAIRS)) > 1:
        return np.concatenate([moved_with(part, paths, others) for part in np.array_split(points, parts)])
    total, weighted = np.zeros(len(points)), np.zeros_like(points)
    extent = float(np.ptp(paths[0], axis=0).max())
    for number, (path, goal) in enumerate(zip(paths, others, strict=True)):
        sense = math.copysign(1.0, signed_area(path)) * (-1.0 if number else 1.0)
        off = np.array(path) - points[:, None]
        away = np.maximum(np.linalg.norm(off, axis=2), ON_CORNER * extent)
        after, both = np.roll(off, -1, axis=1), away * np.roll(away, -1, axis=1)
        across, along = off[..., 0] * after[..., 1] - off[..., 1] * after[..., 0], (off * after).sum(axis=2)
        across = np.copysign(np.maximum(np.abs(across), ON_CORNER * both), across)
        half = np.where(along < 0.0, (both - along) / across, across / (both + np.maximum(along, 0.0)))
        weight = sense * (half + np.roll(half, 1, axis=1)) / away
        total += weight.sum(axis=1)
        weighted += weight @ np.array(goal)
    near, corner = scipy.spatial.cKDTree(corners).query(points)
    return np.where((near < ON_CORNER * extent)[:, None], goals[corner], weighted / total[:, None])


MAX_PAIRS = 1_000_000
"""Of places and corners at a time: 100 MB."""
ON_CORNER = 1e-12
"""How near a place is to a corner or a side, in the extent of an outline, to lie on it."""


def shown_at(x: float, y: float) -> str:
    """Return a place in the plane (m) for a message."""
    return f"near ({round(1e3 * x, 6) + 0.0:.4g}, {round(1e3 * y, 6) + 0.0:.4g}) mm"


# ----------------------------------------------------------------------------------------------------------------------
# Channels as texts: "0, 0 to 20, 5 to 30, 5 mm radius 0.8 to 0.5 mm offset -1 mm in left".


NUMBER = r"[-+]?[\d.]+(?:[eE][-+]?\d+)?"
PLACE = rf"{NUMBER}\s*,\s*{NUMBER}"
CHANNEL = re.compile(
    rf"\s*(?P<curve>curve\s+)?(?P<places>{PLACE}(?:\s*to\s*{PLACE})+)\s*(?P<unit>[a-z]+)"
    rf"(?:\s+radius\s+(?P<start>{NUMBER})(?:\s*to\s*(?P<end>{NUMBER}))?\s*(?P<radius_unit>[a-z]+))?"
    rf"(?:\s+offset\s+(?P<offset>{NUMBER}\s*[a-z]+))?(?:\s+in\s+(?P<cavity>[\w#]+))?\s*"
)
CURVE_PIECES = 12
"""Straight pieces between two points that a curve passes through."""


def channel(text: str, number: int, radius: float, offset: float) -> Channel:
    """Return the channel of a text; where it gives no radius or offset it has these (m)."""
    match = CHANNEL.fullmatch(text) if len(text) < 10_000 else None
    if not match:
        raise GeometryError(
            f"channels has {text[:200]!r}; write places, then what differs from the others, such as "
            "'0, 0 to 20, 5 to 30, 5 mm radius 0.8 to 0.5 mm offset -1 mm in left', or 'curve 0, 0 to 10, 5 to 20, 0 mm'"
        )

    def length(value: str) -> float:
        try:
            return units.quantity(value, "m")
        except units.UnitError as error:
            raise GeometryError(f"channels has {text!r}: {error}") from None

    line = np.array([[length(f"{x} {match['unit']}") for x in place.split(",")] for place in match["places"].split("to")])
    if (np.linalg.norm(np.diff(line, axis=0), axis=1) == 0.0).any():
        raise GeometryError(f"channels has {text!r}; two places in a row are the same")
    if match["curve"]:
        knots = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
        shares = np.linspace(0.0, 1.0, CURVE_PIECES, endpoint=False)
        at = np.append((knots[:-1, None] + shares * np.diff(knots)[:, None]).ravel(), knots[-1])
        line = scipy.interpolate.CubicSpline(knots, line)(at)
    start = length(f"{match['start']} {match['radius_unit']}") if match["start"] else radius
    end = length(f"{match['end']} {match['radius_unit']}") if match["end"] else start
    height = length(match["offset"]) if match["offset"] else offset
    return Channel.along(f"channel {number}", line, height, (start, end), match["cavity"] or "")


# ----------------------------------------------------------------------------------------------------------------------
# Families: polylines in a box between its lowest and highest corner.


CIRCLE_PIECES = 48


def _circle(centre: Array, radius: float, pieces: int = CIRCLE_PIECES, turn: float = math.tau) -> Array:
    angles = np.linspace(0.0, turn, pieces + 1)
    return centre + radius * np.column_stack([np.cos(angles), np.sin(angles)])


def parallel(count: int, low: Array, high: Array) -> list[Array]:
    """Return airways across x, side by side, and one along x that joins them."""
    places, middle = np.linspace(low[0], high[0], count), 0.5 * (low[1] + high[1])
    ways = [np.array([(x, low[1]), (x, high[1])]) for x in places]
    return [*ways, np.array([(low[0], middle), (high[0], middle)])] if count > 1 else ways


def fan(count: int, low: Array, high: Array) -> list[Array]:
    """Return rays over 100 degrees from an arc around the middle of the side at low x, to the box."""
    base, size = np.array([low[0], 0.5 * (low[1] + high[1])]), high - low
    angles = np.radians(np.linspace(-50.0, 50.0, count) if count > 1 else [0.0])
    arc = 0.2 * size[0]
    rays = []
    for angle in angles:
        along = np.array([math.cos(angle), math.sin(angle)])
        reach = min(size[0] / along[0], 0.5 * size[1] / max(abs(along[1]), 1e-9))
        rays.append(base + np.outer([arc, reach], along))
    manifold = np.linspace(angles[0], angles[-1], CIRCLE_PIECES // 4)
    return [*rays, base + arc * np.column_stack([np.cos(manifold), np.sin(manifold)])] if count > 1 else rays


def radial(count: int, low: Array, high: Array) -> list[Array]:
    """Return rays from the middle outwards; many begin on a ring, so that they do not merge."""
    centre, radius = 0.5 * (low + high), 0.5 * float(min(high - low))
    inner = 0.0 if count <= 8 else 0.02 * count * radius
    angles = math.tau * np.arange(count) / count
    rays = [centre + np.outer([inner, radius], (math.cos(angle), math.sin(angle))) for angle in angles]
    return [*rays, _circle(centre, inner)] if inner else rays


def rings(count: int, low: Array, high: Array) -> list[Array]:
    """Return circles around the middle, and a spoke that joins them."""
    centre, radius = 0.5 * (low + high), 0.5 * float(min(high - low))
    radii = radius * np.arange(1, count + 1) / count
    spoke = centre + np.outer([radii[0], radius], (1.0, 0.0))
    return [*(_circle(centre, r) for r in radii), *([spoke] if count > 1 else [])]


def spiral(count: int, low: Array, high: Array) -> list[Array]:
    """Return one airway that winds outwards in a number of turns."""
    centre, radius = 0.5 * (low + high), 0.5 * float(min(high - low))
    angles = np.linspace(0.0, math.tau * count, CIRCLE_PIECES * count)
    r = radius * (0.15 + 0.85 * angles / angles[-1])
    return [centre + r[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])]


def tree(count: int, low: Array, high: Array) -> list[Array]:
    """Return a trunk from the side at low x that forks a number of times, each branch in two."""
    size, lines = high - low, []
    step = size[0] / (count + 1)
    ends = [(low[0], 0.5 * (low[1] + high[1]))]
    for level in range(count + 1):
        number = 2**level
        places = low[1] + size[1] * (np.arange(number) + 0.5) / number
        starts = ends if level == 0 else [end for end in ends for _ in range(2)]
        ends = [(low[0] + step * (level + 1), float(y)) for y in places]
        lines += [np.array(pair) for pair in zip(starts, ends, strict=True)]
    return lines


def lattice(count: int, low: Array, high: Array) -> list[Array]:
    """Return a number of airways along x and across it, joined where they cross."""
    along = [np.array([(low[0], y), (high[0], y)]) for y in np.linspace(low[1], high[1], count)]
    return along + [np.array([(x, low[1]), (x, high[1])]) for x in np.linspace(low[0], high[0], count)]


FAMILIES: Mapping[str, Callable[[int, Array, Array], list[Array]]] = {
    function.__name__: function for function in (fan, parallel, radial, rings, spiral, tree, lattice)
}
MAX_FAMILY = {"tree": 6}
MAX_COUNT = 60


def family(text: str) -> tuple[str, int] | None:
    """Return name and number of a text such as "radial:8"; None if it names no family."""
    name, _, count = (part.strip() for part in text.partition(":"))
    if name not in FAMILIES:
        return None
    most = MAX_FAMILY.get(name, MAX_COUNT)
    if not count.isdigit() or not 1 <= int(count) <= most:
        raise GeometryError(f"network is {text!r}; write the number of a family's airways from 1 to {most}, such as '{name}:5'")
    return name, int(count)


# ----------------------------------------------------------------------------------------------------------------------
# The signed distance from the air of some channels.


class Distance:
    """Signed distance (m) from the walls of some channels, below zero in their air, with creases where joined channels meet,
    and within corners of one, rounded: a fillet of about that radius (m) at a right angle, none where one continues the other.
    """

    def __init__(self, channels: Sequence[Channel], fillet: float):
        pieces = [list(itertools.pairwise(zip(c.points, c.radii, strict=True))) for c in channels]
        ends = [((*a, p), (*b, q)) for channel_pieces in pieces for (a, p), (b, q) in channel_pieces]
        table = np.array(ends, dtype=float).reshape(-1, 2, 4)
        self.start, self.radius = table[:, 0, :3], table[:, 0, 3]
        self.along, self.growth = table[:, 1, :3] - self.start, table[:, 1, 3] - self.radius
        self.square = (self.along**2).sum(axis=1)
        # Each straight or smooth part of a channel, between its ends and corners, has a number.
        self.owner = np.cumsum([begins for c in channels for begins in (True, *corners(np.array(c.points)))]) - 1
        self.fillet = fillet

    def of(self, points: Array, among: mesh_arrays.Ints | None = None) -> tuple[Array, Array]:
        """Return the distances (n,) of points, shape (n, 3), and the steps (n, 3) that raise each by its unit, on roundings
        nearly; only some of the pieces (rising numbers) are looked at if given."""
        away, length, _, distance = self._cones(points, among)
        owner = self.owner if among is None else self.owner[among]
        nearest, every = distance.argmin(axis=1), np.arange(len(points))
        least = distance[every, nearest]
        steps = away[every, nearest] / np.maximum(length[every, nearest], 1e-30)[:, None]
        if self.fillet == 0.0 or owner[0] == owner[-1]:
            return least, steps
        # Several straight or smooth parts: the nearest piece of each.
        first = np.flatnonzero(np.diff(owner, prepend=-1))
        best = np.minimum.reduceat(distance, first, axis=1)
        rows = np.flatnonzero((best < least[:, None] + self.fillet).sum(axis=1) > 1)
        ends = [*first.tolist(), len(owner)]
        pieces = np.stack([k + distance[rows, k:end].argmin(axis=1) for k, end in itertools.pairwise(ends)], axis=1)
        ways = away[rows[:, None], pieces] / np.maximum(length[rows[:, None], pieces], 1e-30)[..., None]
        alike = np.exp(2.0 * (np.einsum("rgi,rhi->rgh", ways, ways) - 1.0))
        shares = blended((best[rows] - least[rows, None]) / self.fillet, alike)
        least[rows] = np.einsum("rg,rg->r", shares, best[rows])
        least[rows] -= 0.5 * self.fillet * (1.0 - np.einsum("rg,rgh,rh->r", shares, alike, shares))
        slope = np.einsum("rg,rgi->ri", shares, ways)
        steps[rows] = slope / np.maximum((slope**2).sum(axis=1), MIN_SLOPE)[:, None]
        return least, steps

    def _cones(self, points: Array, among: mesh_arrays.Ints | None) -> tuple[Array, Array, Array, Array]:
        """Return by points and pieces, the same as of `of`: the vectors from the centre lines (n, m, 3), their lengths, the
        shares of the way along the pieces, and the distances from their walls (n, m)."""
        start, along, square, radius, growth = (
            array if among is None else array[among]
            for array in (self.start, self.along, self.square, self.radius, self.growth)
        )
        away = points[:, None] - start
        share = np.einsum("nmi,mi->nm", away, along) / square
        # A piece is the union of the balls on its line. The nearest one lies towards the wide end from the foot of the point.
        beside = away - share[..., None] * along
        share += np.sqrt(np.einsum("nmi,nmi->nm", beside, beside)) * (
            growth / np.sqrt(square * np.maximum(square - growth**2, MIN_SQUARE))
        )
        share = np.clip(share, 0.0, 1.0)
        away -= share[..., None] * along
        length = np.sqrt(np.einsum("nmi,nmi->nm", away, away))
        return away, length, share, length - radius - share * growth

    def _blocks(self, points: Array, move: float, spread: float = 0.0) -> Iterator[tuple[mesh_arrays.Ints, mesh_arrays.Ints]]:
        """Yield numbers of points near each other, and of the pieces that can be nearest to one of them, or within the rounding
        of the nearest, also where either moves by a length (m); ``spread``: and those farther by a share of the distance."""
        size = 4.0 * float((self.radius + np.maximum(self.growth, 0.0)).max())
        order = np.lexsort(np.round(points / size).T)
        for block in np.array_split(order, math.ceil(len(points) / 200)) if len(points) else ():
            centre = points[block].mean(axis=0)
            wide = 2.0 * float(np.linalg.norm(points[block] - centre, axis=1).max()) + 2.0 * (self.fillet + move)
            *_, distance = self._cones(centre[None], None)
            wide += spread * max(float(distance.min()), 0.0)
            yield block, np.flatnonzero(distance[0] <= distance.min() + MAX_DISTANCE_SLOPE * wide)

    def distances(self, points: Array) -> Array:
        """Return the distances of many points, shape (n,)."""
        result = np.empty(len(points))
        for block, among in self._blocks(points, 0.0):
            result[block], _ = self.of(points[block], among)
        return result

    def projected(self, points: Array) -> Array:
        """Return points near the walls moved onto them along the normals of the nearest pieces, shape (n, 3)."""
        moved = points.copy()
        for block, among in self._blocks(points, float(self.radius.max())):
            at = moved[block]
            for _ in range(MAX_PROJECTIONS):
                distance, steps = self.of(at, among)
                at -= distance[:, None] * steps
                if np.abs(distance).max() < ON_WALL * self.radius.min():
                    break
            moved[block] = at
        return moved

    def carried(self, other: Distance, points: Array) -> Array:
        """Return where points, shape (n, 3), lie beside other channels with as many pieces: each moves with the pieces that it
        is near to, and near a wall then along their normals to where its distance is what it was."""
        changes = [getattr(other, name) - getattr(self, name) for name in ("start", "along", "radius", "growth")]
        moves, longer, wider, growth = changes
        if not (self.fillet - other.fillet or any(change.any() for change in changes)):
            return points.copy()
        far = float(np.linalg.norm(moves, axis=1).max() + np.linalg.norm(longer, axis=1).max() + np.abs(wider).max())
        reach = max(self.fillet, FOLLOWED_SHARE * float(self.radius.min()))
        moved = points.copy()
        for block, among in self._blocks(points, reach + far, 1.0):
            at = points[block]
            level, _ = self.of(at, among)
            away, length, share, distance = self._cones(at, among)
            least = distance.min(axis=1)[:, None]
            weight = np.clip(1.0 - (distance - least) / (reach + np.maximum(least, 0.0)), 0.0, None) ** 2
            weight /= weight.sum(axis=1)[:, None]
            shift = moves[among] + share[..., None] * longer[among]
            shift += ((wider[among] + share * growth[among]) / np.maximum(length, 1e-30))[..., None] * away
            at = at + np.einsum("nm,nmi->ni", weight, shift)
            fade = np.clip(1.0 - (level / reach) ** 2, 0.0, 1.0) ** 2
            for _ in range(CARRYING_STEPS):  # always as many, so that places are smooth in what the other is made of
                distance, steps = other.of(at, among)
                at -= (fade * (distance - level))[:, None] * steps
            moved[block] = at
        return moved


def blended(far: Array, alike: Array) -> Array:
    """Return the shares of walls in their smooth union, shape (n, g): they minimise ``far @ s - (1 - s @ alike @ s) / 2`` over
    s of sum 1 and none below 0, so that the least is continuously differentiable also where three walls meet or more.

    Args:
        far: How much farther than the nearest each wall is, over the width of the rounding, shape (n, g).
        alike: 1 for walls with the same normal, near 0 for such at a right angle or more, positive definite, shape (n, g, g).
    """
    every, walls = np.arange(len(far)), far.shape[1]
    shares = np.zeros_like(far)
    shares[every, far.argmin(axis=1)] = 1.0
    active = shares > 0.0
    # The active walls' least without bounds; on the way there the first that comes to 0 is left out, else the one that
    # lowers it most is taken in (Nocedal and Wright, Numerical Optimization, algorithm 16.3).
    while len(every):
        own, used = shares[every], active[every]
        matrix = np.zeros((len(every), walls + 1, walls + 1))
        matrix[:, :walls, :walls] = np.where(used[:, :, None] & used[:, None], alike[every], np.eye(walls))
        matrix[:, walls, :walls] = matrix[:, :walls, walls] = used
        right = np.concatenate([np.where(used, -far[every], 0.0), np.ones((len(every), 1))], axis=1)
        step = np.linalg.solve(matrix, right[..., None])[:, :walls, 0] - own
        with np.errstate(divide="ignore", invalid="ignore"):
            room = np.where(used & (own + step < 0.0), own / -step, np.inf)
        out, way = room.argmin(axis=1), np.minimum(room.min(axis=1), 1.0)
        blocked = way < 1.0
        own = np.maximum(own + way[:, None] * step, 0.0)
        rate = far[every] + np.einsum("ngh,nh->ng", alike[every], own)
        gain = np.where(used, 0.0, np.einsum("ng,ng->n", own, rate)[:, None] - rate)
        into = gain.argmax(axis=1)
        taken = ~blocked & (gain.max(axis=1) > MIN_GAIN)
        own[blocked, out[blocked]] = 0.0
        shares[every] = own
        active[every[blocked], out[blocked]] = False
        active[every[taken], into[taken]] = True
        every = every[blocked | taken]
    return shares


MIN_GAIN = 1e-12
"""Rate at which a wall that is taken in must lower the smooth union, over the width of the rounding."""
MAX_PROJECTIONS, ON_WALL = 30, 1e-9
"""Most steps onto a wall, and how near is on it, in the smallest radius: one step on a cylinder, several on a rounding."""
CARRYING_STEPS = 10
"""Steps onto another's wall: each leaves less than half of the distance on a rounding, next to nothing on a cone."""
FOLLOWED_SHARE = 0.3
"""Least width in radii over which the motion of one piece passes into that of the next."""
MIN_SQUARE = 1e-18
"""Of a piece's length less its growth, in m2: where one ball holds the other, it alone is left."""
MIN_SLOPE = 0.3
"""Least square of a rounding's slope, in that of a distance, by which a step is divided."""
MAX_DISTANCE_SLOPE = 1.5
"""Largest change of a distance from a cone per length that is counted on."""


# ----------------------------------------------------------------------------------------------------------------------
# The surface of the air, as triangles.


SMOOTHING_ROUNDS = 8
"""Rounds of smoothing: a level set's edges differ by 5, then by 3."""
FINER_SURFACES = (1.0, 0.85, 0.7, 0.5)
"""Shares of the edge's length that are tried in turn."""
EDGE_SHARE = 0.72
"""Median edge of a level set's triangles over the size that manifold3d is asked for."""


def air_surface(channels: Sequence[Channel], fillet: float, edge: float) -> tuple[Array, mesh_arrays.Ints]:
    """Return corners (m) on the walls of channels, and triangles turned out of the air, with edges of about a length (m). The
    triangles' shapes do not depend on those of the network."""
    key = ("network 4", tuple(channels), fillet, edge)
    kept = meshing.cached_arrays(key, lambda: _whole_air_surface(channels, fillet, edge))
    return kept["points"], kept["triangles"]


def _whole_air_surface(channels: Sequence[Channel], fillet: float, edge: float) -> dict[str, NDArray[Any]]:
    """Return the surface of `air_surface` with edges short enough that smoothing has shortened no channel."""
    distance = Distance(channels, fillet)
    ways = [(each.points[k], each.points[n], each.radii[k]) for each in channels for k, n in ((0, 1), (-1, -2))]
    poles = np.array([np.array(end) + r * np.subtract(end, near) / math.dist(end, near) for end, near, r in ways])
    poles = poles[np.abs(distance.distances(poles)) < ON_WALL * distance.radius.min()]  # of ends that lie in no other channel
    for shorter in FINER_SURFACES:
        surface = _air_surface(distance, shorter * edge)
        away, _ = scipy.spatial.cKDTree(surface["points"]).query(poles)
        if not len(away) or away.max() < edge:
            return surface
    raise GeometryError(
        f"the end of a channel {shown_at(*poles[away.argmax(), :2])} is lost with cells of {schema.shown(edge, 'm')}; use more "
        "cells around the channels (--around)"
    )


def _air_surface(distance: Distance, edge: float) -> dict[str, NDArray[Any]]:
    import manifold3d

    step = edge / EDGE_SHARE
    low = np.minimum(distance.start, distance.start + distance.along).min(axis=0)
    high = np.maximum(distance.start, distance.start + distance.along).max(axis=0)
    margin = float((distance.radius + np.maximum(distance.growth, 0.0)).max()) + distance.fillet + step
    low, high = low - margin, high + margin
    # Most places of the grid are far from any channel: pieces are known by blocks of it.
    size = 4.0 * step
    reach = distance.fillet + step
    pieces: dict[tuple[int, ...], list[int]] = defaultdict(list)
    for number, (start, along, r, grown) in enumerate(
        zip(distance.start, distance.along, distance.radius, distance.growth, strict=True)
    ):
        shares = np.linspace(0.0, 1.0, math.ceil(float(np.linalg.norm(along)) / size) + 1)
        wide = reach + max(r, r + grown) + 0.5 * size
        cells = set[tuple[int, ...]]()
        for place in start + shares[:, None] * along:
            first, last = (np.floor((place + side * wide - low) / size).astype(int).tolist() for side in (-1, 1))
            cells.update(itertools.product(*(range(a, b + 1) for a, b in zip(first, last, strict=True))))
        for cell in cells:
            pieces[cell].append(number)
    rows = [
        (*start, *along, 1.0 / square, radius, grown)
        for start, along, square, radius, grown in zip(
            distance.start.tolist(), distance.along.tolist(), distance.square.tolist(), distance.radius.tolist(),
            distance.growth.tolist(), strict=True,
        )
    ]  # fmt: skip
    known = {cell: [rows[number] for number in numbers] for cell, numbers in pieces.items()}
    x0, y0, z0 = low.tolist()

    # Asked a million times: plain arithmetic, cones in place of balls; those and roundings come when the corners are moved.
    def depth(x: float, y: float, z: float) -> float:
        least = reach
        block = int((x - x0) // size), int((y - y0) // size), int((z - z0) // size)
        for a, b, c, u, v, w, inverse, radius, grown in known.get(block, ()):
            x1, y1, z1 = x - a, y - b, z - c
            share = min(max((x1 * u + y1 * v + z1 * w) * inverse, 0.0), 1.0)
            x1, y1, z1 = x1 - share * u, y1 - share * v, z1 - share * w
            least = min(least, math.sqrt(x1 * x1 + y1 * y1 + z1 * z1) - radius - share * grown)
        return -least

    level = manifold3d.Manifold.level_set(depth, [*low.tolist(), *high.tolist()], step)
    points, triangles = mesh_arrays.surface_of(level)
    points = evened(distance.projected(points), triangles, distance.projected)
    return {"points": points, "triangles": triangles}


def evened(points: Array, triangles: mesh_arrays.Ints, onto: Callable[[Array], Array]) -> Array:
    """Return corners moved to the middles of the triangles around them, larger ones counting more, and back onto walls, so that
    edges become alike."""
    corner = triangles.ravel()
    for _ in range(SMOOTHING_ROUNDS):
        a, b, c = np.moveaxis(points[triangles], 1, 0)
        area = np.repeat(np.linalg.norm(np.cross(b - a, c - a), axis=1), 3)
        middle = np.repeat((a + b + c) / 3.0, 3, axis=0) * area[:, None]
        moved = np.stack([np.bincount(corner, middle[:, i]) for i in range(3)], axis=1) / np.bincount(corner, area)[:, None]
        points = onto(moved)
    return points


# ----------------------------------------------------------------------------------------------------------------------
# Walls: what lies between channels, and between channels and the plate.


JOINED_SHARE = 0.9
"""Two channels whose centre lines are nearer than this share of the larger radius are joined."""
MAX_DETOUR = 5.0
"""The way along channels over the straight one, above which a wall between them counts: an angle of 23 degrees at a joint."""


@dataclasses.dataclass(frozen=True, eq=False)
class Samples:
    """Places along the centre lines of channels (m, shape (n, 3)), their radii, and the numbers of their channels."""

    places: Array
    radii: Array
    owner: mesh_arrays.Ints

    @classmethod
    def of(cls, channels: Sequence[Channel]) -> Samples:
        """Return places that are half of the least radius apart."""
        spacing = 0.5 * min(min(each.radii) for each in channels)
        rows = []
        for number, each in enumerate(channels):
            for (a, p), (b, q) in itertools.pairwise(zip(each.points, each.radii, strict=True)):
                shares = np.linspace(0.0, 1.0, math.ceil(math.dist(a, b) / spacing) + 1)[:, None]
                rows.append(np.hstack([(1.0 - shares) * (*a, p) + shares * (*b, q), np.full((len(shares), 1), number)]))
        table = np.concatenate(rows)
        return cls(table[:, :3], table[:, 3], table[:, 4].astype(np.int64))


def parts(channels: Sequence[Channel]) -> int:
    """Return the number of networks of joined channels."""
    samples = Samples.of(channels)
    near = scipy.spatial.cKDTree(samples.places).query_pairs(JOINED_SHARE * samples.radii.max(), output_type="ndarray")
    away = np.linalg.norm(samples.places[near[:, 0]] - samples.places[near[:, 1]], axis=1)
    crossing = near[away < JOINED_SHARE * samples.radii[near].max(axis=1)]
    return 1 + int(actuator.joined(samples.owner[crossing], len(channels)).max())


def check_walls(channels: Sequence[Channel], samples: Samples, least: float) -> None:
    """Reject channels with less than a wall (m) between them that are not joined, and joined ones of several cavities."""
    places, radii, owner = samples.places, samples.radii, samples.owner
    tree = scipy.spatial.cKDTree(places)
    near = tree.query_pairs(2.0 * radii.max() + least, output_type="ndarray")
    away = np.linalg.norm(places[near[:, 0]] - places[near[:, 1]], axis=1)
    wall = away - radii[near].sum(axis=1)
    close = wall < least * (1.0 - schema.BOUND_TOLERANCE)
    near, away, wall = near[close], away[close], wall[close]
    follows = (near[:, 1] == near[:, 0] + 1) & (owner[near[:, 0]] == owner[near[:, 1]])
    crossing = away < JOINED_SHARE * radii[near].max(axis=1)
    for i, j in near[crossing][np.argsort(away[crossing], kind="stable")].tolist():
        first, second = channels[owner[i]], channels[owner[j]]
        if first.cavity != second.cavity:
            raise GeometryError(
                f"{first.name} of cavity {first.cavity!r} and {second.name} of cavity {second.cavity!r} cross "
                f"{shown_at(*places[i, :2])}; give both one cavity (a colour or layer), or lead one around the other"
            )
    # Steps along channels: from place to place, and across at joints; what is near by a short way is no wall.
    steps = np.concatenate([near[crossing], np.column_stack([np.arange(len(owner) - 1), np.arange(1, len(owner))])])
    steps = steps[(owner[steps[:, 0]] == owner[steps[:, 1]]) | (np.arange(len(steps)) < crossing.sum())]
    lengths = np.maximum(np.linalg.norm(places[steps[:, 0]] - places[steps[:, 1]], axis=1), 1e-12)
    graph = scipy.sparse.coo_array((lengths, steps.T), shape=(len(owner),) * 2).tocsr()
    others = near[~follows & ~crossing]
    away, wall = away[~follows & ~crossing], wall[~follows & ~crossing]
    limit = MAX_DETOUR * (2.0 * float(radii.max()) + least)
    worst: tuple[float, int, int] | None = None
    for block in np.array_split(np.unique(others[:, 0]), math.ceil(len(others) / 20_000) or 1):
        if not len(block):
            continue
        ways = scipy.sparse.csgraph.dijkstra(graph, directed=False, indices=block, limit=limit)
        mine = np.flatnonzero(np.isin(others[:, 0], block))
        way = ways[np.searchsorted(block, others[mine, 0]), others[mine, 1]]
        for place in mine[way > MAX_DETOUR * away[mine] + radii[others[mine]].sum(axis=1)].tolist():
            if worst is None or wall[place] < worst[0]:
                worst = (float(wall[place]), *others[place].tolist())
    if worst:
        gap, i, j = worst
        names = sorted({channels[owner[i]].name, channels[owner[j]].name})
        who = " and ".join(names) if len(names) > 1 else f"two parts of {names[0]}"
        wall_text = f"are {1e3 * gap:.2g} mm apart" if gap > 0.0 else "run into each other"
        raise GeometryError(
            f"{who} {wall_text} {shown_at(*places[[i, j], :2].mean(axis=0))}, and least_wall is {schema.shown(least, 'm')}; "
            "move them apart or cross them, make them narrower, or let them leave their joint at more than "
            f"{2.0 * math.degrees(math.asin(1.0 / MAX_DETOUR)):.0f} degrees"
        )


def check_plate(channels: Sequence[Channel], samples: Samples, thickness: float, least: float) -> None:
    """Reject channels that leave less than a wall (m) to the plate's faces, at heights of half its thickness (m)."""
    wall = 0.5 * thickness - np.abs(samples.places[:, 2]) - samples.radii
    if wall[at := int(wall.argmin())] < least * (1.0 - schema.BOUND_TOLERANCE):
        x, y, z = samples.places[at]
        face = "top" if z > 0.0 else "bottom"
        raise GeometryError(
            f"{channels[samples.owner[at]].name}, of radius {1e3 * samples.radii[at]:.3g} mm there, leaves "
            f"{_wall(wall[at])} to the {face} face {shown_at(x, y)}, and least_wall is {schema.shown(least, 'm')}; make the "
            "plate thicker, the channel narrower, or its offset smaller"
        )


def check_outline(channels: Sequence[Channel], samples: Samples, paths: Sequence[Sequence[Place]], least: float) -> None:
    """Reject channels that leave less than a wall (m) to the closed paths of a plate's outline, holes behind it."""
    points = samples.places[:, :2]
    deep = depths(points, paths)
    wall = deep - samples.radii
    if wall[at := int(wall.argmin())] < least * (1.0 - schema.BOUND_TOLERANCE):
        where = "lies outside of the outline" if deep[at] <= 0.0 else f"leaves {_wall(wall[at])} to the outline"
        raise GeometryError(
            f"{channels[samples.owner[at]].name} {where} {shown_at(*points[at])}, and least_wall is "
            f"{schema.shown(least, 'm')}; end it earlier, or make the plate wider"
        )


def _wall(value: float) -> str:
    return f"{1e3 * value:.2g} mm" if value > 0.0 else "no wall"
