"""Where a channel of the seminar actuator leaves its manifold: levels of the two walls, and the rounding between them.

A level is a distance to a wall, positive in the solid. The rounding is what a ball of the fillet's radius leaves that rolls in
the solid along both walls; its centres form the curve `Junction.rim`, which is the crease itself where there is no fillet. A
device has mirror images at y < 0; everything here is for y >= 0.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from geometries.seminar_plan import Channel, spread

if TYPE_CHECKING:
    from geometries.seminar import SeminarActuator

Array = NDArray[np.float64]

NEAR = 1.5
"""Distance from the ball's centre, in its radii, up to which a place may belong to the rounding."""

STEPS, CLOSE = 8, 1e-9
"""Most of Newton's steps, and the share of the manifold's radius below which the last was: the next would be its square."""

TURN, LARGEST_TURN = 1e-4, 0.3
"""Step in radians of the differences with which the nearest centre is found, and the largest by which it is looked for."""

SEARCH, FLATTEST = 40, 0.1
"""Most steps of that search, and the least curvature it takes the squared distance to have, in that of a straight rim's."""


def dot(one: Array, other: Array) -> Array:
    """Products of rows, shape (n,)."""
    return np.asarray((one * other).sum(axis=1))


def unit(vectors: Array) -> tuple[Array, Array]:
    """Rows of length 1, shape (n, 3), and the lengths, shape (n,); the first axis where the length is 0."""
    lengths = np.sqrt(dot(vectors, vectors))
    if lengths.all():
        return vectors / lengths[:, None], lengths
    none = lengths == 0.0
    found = vectors / np.where(none, 1.0, lengths)[:, None]
    found[none, 0] = 1.0
    return found, lengths


def tube_level(slab: SeminarActuator, points: Array) -> tuple[Array, Array]:
    """Level of the manifold's wall with its round ends, shape (n,), and its gradient, shape (n, 3)."""
    half = 0.5 * spread(slab)
    turn = np.clip(np.arctan2(points[:, 1], points[:, 0]), -half, half)
    foot = np.column_stack(
        [slab.manifold_radius * np.cos(turn), slab.manifold_radius * np.sin(turn), np.full(len(turn), slab.offset)]
    )
    normal, away = unit(points - foot)
    return away - slab.manifold_bore, normal


@dataclasses.dataclass(frozen=True)
class Junction:
    """The manifold and the first cone of one channel.

    Attributes:
        slab: The device.
        line: The channel.
    """

    slab: SeminarActuator
    line: Channel

    @functools.cached_property
    def axes(self) -> Array:
        """Unit vectors along the channel, across it in its plane, and up; rows, shape (3, 3)."""
        c, s = math.cos(self.line.angle), math.sin(self.line.angle)
        return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])

    def local(self, points: Array) -> tuple[Array, Array, Array]:
        """Distance along the ray and from it, shape (n,), and the unit direction from it across and up, shape (n, 2)."""
        turned = (points - [0.0, 0.0, self.slab.offset]) @ self.axes.T
        direction, radius = unit(turned[:, 1:])
        return turned[:, 0], radius, direction

    def place(self, along: Array, radius: Array, direction: Array) -> Array:
        """Inverse of `local`."""
        return np.column_stack([along, radius[:, None] * direction]) @ self.axes + [0.0, 0.0, self.slab.offset]

    def cone_level(self, points: Array) -> tuple[Array, Array]:
        """Level of the first cone, prolonged at both ends, shape (n,), and its gradient, shape (n, 3)."""
        cone = self.line.cones[0]
        along, radius, direction = self.local(points)
        cosine = 1.0 / math.hypot(1.0, cone.slope)
        level = cosine * (radius - cone.bore - cone.slope * (along - cone.start))
        normal = cosine * np.column_stack([np.full(len(along), -cone.slope), direction]) @ self.axes
        return level, normal

    def rim(self, direction: Array, start: Array | None = None) -> tuple[Array, Array]:
        """Centres of the ball that rolls along both walls.

        Args:
            direction: From the ray, across and up, shape (n, 2).
            start: Distances along the ray close to the centres', shape (n,).

        Returns:
            The centres, shape (n, 3), and their distance along the ray, shape (n,).
        """
        cone, fillet = self.line.cones[0], self.slab.fillet
        out = fillet * math.hypot(1.0, cone.slope)
        step = np.column_stack([np.ones(len(direction)), cone.slope * direction]) @ self.axes
        along = self._guess(direction) if start is None else start
        for _ in range(STEPS):
            points = self.place(along, cone.bore + cone.slope * (along - cone.start) + out, direction)
            level, normal = tube_level(self.slab, points)
            change = (level - fillet) / dot(normal, step)
            along = along - change
            if np.abs(change).max(initial=0.0) < CLOSE * cone.start:
                break
        return self.place(along, cone.bore + cone.slope * (along - cone.start) + out, direction), along

    def _guess(self, direction: Array) -> Array:
        """Where along the ray the centres lie if the channel were a cylinder."""
        slab, line = self.slab, self.line
        across, up = (line.bore + slab.fillet) * direction.T
        out = slab.manifold_bore + slab.fillet
        ring = slab.manifold_radius + np.sqrt(out**2 - up**2)
        beyond = (line.angle > 0.5 * spread(slab) - 1e-9) & (across > 0.0)
        ball = slab.manifold_radius + np.sqrt(out**2 - up**2 - across**2)
        return np.where(beyond, ball, np.sqrt(ring**2 - across**2))

    def _lever(self, points: Array, turn: Array, start: Array) -> tuple[Array, Array, Array]:
        """How the distance to the rim falls with its polar angle.

        Args:
            points: Places, shape (n, 3).
            turn: Polar angles of centres on the rim, shape (n,).
            start: See `rim`.

        Returns:
            Half the derivative of the squared distance, its sign changed; the square of how far the centre moves per radian;
            and where along the ray it is; shapes (n,).
        """
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
        """Centres on the rim closest to points near the rounding, shape (n, 3).

        Newton's method on the squared distance, with a least curvature and a largest step: about where the rim's centres of
        curvature lie several of its centres are equally near.
        """
        _, _, direction = self.local(points)
        turn = np.arctan2(direction[:, 1], direction[:, 0])
        _, along = self.rim(direction)
        left = np.arange(len(points))
        for _ in range(SEARCH):
            here, at, start = points[left], turn[left], along[left]
            more, less = (self._lever(here, at + by, start)[0] for by in (TURN, -TURN))
            now, size, along[left] = self._lever(here, at, start)
            change = now / np.maximum((less - more) / (2.0 * TURN), FLATTEST * size)
            change = np.clip(change, -LARGEST_TURN, LARGEST_TURN)
            turn[left] += change
            left = left[np.abs(change) >= 1e-9]  # the next would be its square
            if not len(left):
                break
        direction = np.column_stack([np.cos(turn), np.sin(turn)])
        return self.rim(direction, along)[0]

    def level(self, points: Array) -> tuple[Array, Array]:
        """Level of the wall with its rounding, shape (n,), and its gradient, shape (n, 3)."""
        first, one = tube_level(self.slab, points)
        second, other = self.cone_level(points)
        along, _, direction = self.local(points)
        # Behind the arc's centre line the prolonged cone is no wall.
        nearer = (first < second) | (along < self.line.start)
        level, normal = np.where(nearer, first, second), np.where(nearer[:, None], one, other)
        fillet = self.slab.fillet
        if fillet == 0.0:
            return level, normal
        close = np.flatnonzero(np.sqrt(((points - self.rim(direction)[0]) ** 2).sum(axis=1)) < NEAR * fillet)
        if not len(close):
            return level, normal
        centre = self.nearest(points[close])
        by_tube, by_cone = self.shares(centre, points[close] - centre)[:, :2].T
        first, second, one, other = first[close], second[close], one[close], other[close]
        inwards, away = unit(centre - points[close])
        # Beyond a touching line the wall itself is nearest, beyond both the nearer one.
        on_tube = (by_cone < 0.0) & ((by_tube >= 0.0) | (first < second))
        on_cone = (by_tube < 0.0) & ~on_tube
        level[close] = np.where(on_tube, first, np.where(on_cone, second, fillet - away))
        normal[close] = np.where(on_tube[:, None], one, np.where(on_cone[:, None], other, inwards))
        return level, normal

    def frame(self, centre: Array) -> Array:
        """Outward from the solid at both walls' gradients and along the rim: columns, shape (n, 3, 3)."""
        _, one = tube_level(self.slab, centre)
        _, other = self.cone_level(centre)
        return np.stack([-one, -other, unit(np.cross(one, other))[0]], axis=2)

    def shares(self, centre: Array, vectors: Array) -> Array:
        """Components of vectors in the `frame` at places on the rim, shape (n, 3)."""
        return np.linalg.solve(self.frame(centre), vectors[:, :, None])[:, :, 0]
