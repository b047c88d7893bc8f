"""The slice of a drawn plate that its mirror images fill up: the mirrors of a network, and the walls of its air cut on them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geometries import mesh_arrays, meshing, network
from geometries.actuator import NARROWEST_WEDGE, Vector
from geometries.network import Channel, Distance, Network, Place, Samples
from softmodels.common import arrays
from softmodels.common.arrays import Array
from softmodels.common.lazy import scipy

SYMMETRY_TOLERANCE = 1e-5
"""How far a drawing may be from its mirror image, over the extent of its outline."""
SNAPPED_ANGLE, SAME_ANGLE = math.radians(0.25), 1e-6
"""An angle (rad) within the second of a multiple of the first is that multiple."""
SNAP_SHARE = 0.3
"""Corners of a wall that are nearer to a mirror than this share of an edge are moved onto it; other edges are divided."""
ON_MIRROR = 1e-6
"""How near to a mirror a corner is on it, in lengths of an edge."""
MAX_ALTERNATIONS = 30
"""Most moves in turn onto a wall and onto the mirrors through a point."""


def mirrors(drawn: Network, held: Sequence[Place]) -> list[float]:
    """Return the angles (rad, from 0, below pi, rising) of the lines through the origin, in the plane, on which a network, its
    outline and the corners that are held are their own mirror images; channels with those of their own cavity."""
    corners = np.array([place for path in drawn.outline for place in path])
    middles = np.concatenate([0.5 * (np.array(path) + np.roll(path, 1, axis=0)) for path in drawn.outline])
    extent = float(np.ptp(corners, axis=0).max())
    near = SYMMETRY_TOLERANCE * extent
    kinds = [np.array(places).reshape(-1, 2) for places in (corners, middles, held)]
    places, kind = np.concatenate(kinds), np.repeat(10.0 * extent * np.arange(3), [len(each) for each in kinds])
    tree = scipy.spatial.cKDTree(np.column_stack([places, kind]))
    air = []
    for cavity in drawn.cavities:
        own = drawn.channels_of(cavity)
        samples = Samples.of(own)
        order = np.argsort(
            -np.linalg.norm(samples.places, axis=1), kind="stable"
        )  # those that few lines map onto channels first
        air.append((Distance(own, 0.0), samples.places[order], samples.radii[order]))

    def same(angle: float) -> bool:
        """Whether images of corners are corners, of sides sides, and balls on the lines of channels lie in channels."""
        flip = np.diag([1.0, 1.0, 1.0])
        flip[:2, :2] = [[math.cos(2.0 * angle), math.sin(2.0 * angle)], [math.sin(2.0 * angle), -math.cos(2.0 * angle)]]
        if tree.query(np.column_stack([places @ flip[:2, :2], kind]))[0].max() > near:
            return False
        return all(
            (distance.distances(at[some] @ flip) + radii[some]).max() < near
            for some in (slice(2), slice(None))
            for distance, at, radii in air
        )

    # The farthest corner's image is a corner as far away: half way between them is the mirror.
    away = np.linalg.norm(corners, axis=1)
    far = np.arctan2(*corners[np.abs(away - away.max()) < near].T[::-1])
    return sorted({angle for angle in (_snapped(0.5 * (far[0] + other)) for other in far.tolist()) if same(angle)})


def _snapped(angle: float) -> float:
    """Return an angle (rad) from 0 and below pi, without the rounding of drawings."""
    steps = round(angle / SNAPPED_ANGLE)
    if abs(angle - steps * SNAPPED_ANGLE) < SAME_ANGLE:
        return steps % round(math.pi / SNAPPED_ANGLE) * SNAPPED_ANGLE
    return round(angle % math.pi, 9)


def outward_normals(angles: Sequence[float], inside: Place) -> tuple[Vector, ...]:
    """Return the outward unit normals of the narrowest slice between mirrors at some angles (rad) that holds a place (m): one
    of a half, two of a wedge of at least `NARROWEST_WEDGE`, none without a mirror."""
    if not angles:
        return ()
    count = len(angles)
    parts = max(n for n in range(1, count + 1) if count % n == 0 and (n == 1 or 180.0 / n >= NARROWEST_WEDGE))
    slices = []
    for k in range(2 * parts):
        a, b = (angles[0] + n * math.pi / parts for n in (k, k + 1))
        both = np.array([(math.sin(a), -math.cos(a), 0.0), (-math.sin(b), math.cos(b), 0.0)])
        slices.append(np.round(both[: 1 if parts == 1 else 2], 15) + 0.0)
    chosen = min(slices, key=lambda normals: round(float((normals[:, :2] @ inside).max()), 9))
    return tuple(arrays.triple(normal) for normal in chosen)


# ----------------------------------------------------------------------------------------------------------------------
# Walls that end on mirrors.


def air_surface(channels: Sequence[Channel], fillet: float, edge: float, normals: Array) -> tuple[Array, mesh_arrays.Ints]:
    """Return corners and triangles of the walls as `network.air_surface`, those behind planes through the origin with outward
    unit normals, shape (k, 3)."""
    points, triangles = network.air_surface(channels, fillet, edge)
    if not len(normals):
        return points, triangles

    def behind() -> dict[str, NDArray[Any]]:
        distance = Distance(channels, fillet)
        corners, parts = cut(distance, points, triangles, normals, edge)
        on = on_mirrors(corners, normals, ON_MIRROR * edge)
        return {"points": network.evened(corners, parts, lambda at: projected(distance, at, normals, on)), "triangles": parts}

    kept = meshing.cached_arrays(("slice 1", tuple(channels), fillet, edge, normals.tolist()), behind)
    return kept["points"], kept["triangles"]


def on_mirrors(points: Array, normals: Array, near: float) -> NDArray[np.bool_]:
    """Return which points (m, shape (n, 3)) lie within a distance (m) of which planes through the origin, shape (n, k)."""
    return np.asarray(np.abs(points @ normals.T) < near)


def projected(distance: Distance, points: Array, normals: Array, on: NDArray[np.bool_]) -> Array:
    """Return points near the walls moved onto them, those that lie on some planes (shape (n, k)) within these."""
    moved = distance.projected(points)
    rows = np.flatnonzero(on.any(axis=1))
    at = moved[rows]
    for _ in range(MAX_ALTERNATIONS if len(rows) else 0):
        before = at
        at = distance.projected(_in_planes(at, normals, on[rows]))
        if np.abs(at - before).max() < 1e-9 * distance.radius.min():
            break
    moved[rows] = _in_planes(at, normals, on[rows])
    return moved


def _in_planes(points: Array, normals: Array, on: NDArray[np.bool_]) -> Array:
    """Return points moved straight into the planes that each lies on, one or two."""
    moved = points.copy()
    for k, normal in enumerate(normals):
        moved[on[:, k]] -= np.outer(moved[on[:, k]] @ normal, normal)
    both = on.sum(axis=1) > 1
    if both.any():
        moved[both] = _on_line(moved[both], normals)
    return moved


def _on_line(points: Array, normals: Array) -> Array:
    """Return points moved onto the line in which two planes meet."""
    line = np.cross(*normals)
    line /= np.linalg.norm(line)
    return np.outer(points @ line, line)


def cut(
    distance: Distance, points: Array, triangles: mesh_arrays.Ints, normals: Array, edge: float
) -> tuple[Array, mesh_arrays.Ints]:
    """Return corners and triangles of the part of closed walls that lies behind planes through the origin, with these outward
    normals: corners near a plane are moved onto it, then edges that cross it, of about a length (m), are divided there."""
    on = np.zeros((len(points), len(normals)), dtype=bool)
    for k, normal in enumerate(normals):
        away = np.abs(points @ normal)
        if k:
            away = np.where(on.any(axis=1), np.linalg.norm(points - _on_line(points, normals), axis=1), away)
        on[:, k] = away < SNAP_SHARE * edge
        points = projected(distance, points, normals, on)
        # Two neighbours that are both moved onto the axis become one.
        places = np.round(points / (ON_MIRROR * edge)).astype(np.int64)
        _, first, number_of = np.unique(places, axis=0, return_index=True, return_inverse=True)
        triangles = first[number_of.ravel()][triangles]
        triangles = triangles[(triangles != np.roll(triangles, 1, axis=1)).all(axis=1)]
        height = np.where(on[:, k], 0.0, -(points @ normal))
        ends = np.unique(np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
        ends = ends[height[ends].prod(axis=1) < 0.0]
        share = (height[ends[:, 0]] / (height[ends[:, 0]] - height[ends[:, 1]]))[:, None]
        middles = points[ends[:, 0]] + share * (points[ends[:, 1]] - points[ends[:, 0]])
        middle_on = on[ends].all(axis=1)
        middle_on[:, k] = True
        number = {(a, b): len(points) + n for n, (a, b) in enumerate(ends.tolist())}
        kept = [part for corners in triangles.tolist() for part in _behind(corners, height, number)]
        points = np.concatenate([points, projected(distance, middles, normals, middle_on)])
        on = np.concatenate([on, middle_on])
        table = np.array(kept, dtype=np.int64)
        used, triangles = np.unique(table[~on[table][..., k].all(axis=1)], return_inverse=True)
        points, on, triangles = points[used], on[used], triangles.reshape(-1, 3)
    return points, triangles


def _behind(corners: list[int], height: Array, number: dict[tuple[int, int], int]) -> list[tuple[int, ...]]:
    """Return the triangles of what is left of one with some heights of its corners, below 0 in front of the plane; by its ends,
    an edge that is divided has the number of its middle."""
    ring: list[int] = []
    for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
        if height[a] >= 0.0:
            ring.append(a)
        if middle := number.get((min(a, b), max(a, b))):
            ring.append(middle)
    return [(ring[0], ring[n], ring[n + 1]) for n in range(1, len(ring) - 1)]
