"""Angles along the manifold of a seminar actuator and where they lie on another's.

Around a channel the arc moves with it, stretched as the channel's mouth is; between two channels a cubic joins both motions.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from geometries.errors import GeometryError
from geometries.seminar_plan import Channel, spread

if TYPE_CHECKING:
    from geometries.seminar import SeminarActuator

Array = NDArray[np.float64]

MOUTH = 0.6
"""Largest part of the way to the middle between two channels that moves with either."""

SAMPLES = np.linspace(0.0, 1.0, 9)

LEAST = 0.02
"""Least stretch of an arc between two channels that is followed."""


def arc_map(
    slab: SeminarActuator, other: SeminarActuator, lines: list[tuple[Channel, Channel]]
) -> Callable[[Array], Array]:
    """Return a smooth, rising function from angles along one arc to those along another, in radians.

    Args:
        slab: The device.
        other: Where its arc goes.
        lines: Channels with y >= 0 from the middle outwards, on both.

    Raises:
        GeometryError: The solid between two channels shrinks to next to nothing.
    """
    angles, wide, slopes, goals = (np.array(values) for values in zip(*_knots(slab, other, lines), strict=True))
    mouths = np.minimum(wide, MOUTH * _gaps(angles).min(axis=0))
    starts, ends = angles[:-1] + mouths[:-1], angles[1:] - mouths[1:]
    low, high = goals[:-1] + slopes[:-1] * mouths[:-1], goals[1:] - slopes[1:] * mouths[1:]
    rise, span = high - low, ends - starts
    first, last = slopes[:-1] * span, slopes[1:] * span
    for share in SAMPLES:
        rates = (
            6.0 * share * (1.0 - share) * rise
            + (1.0 - share) * (1.0 - 3.0 * share) * first
            + share * (3.0 * share - 2.0) * last
        )
        if (rates < LEAST * span).any():
            raise GeometryError(
                "the channels' mouths on the manifold come so much closer or grow so much that the mesh between them cannot "
                "follow; make a new mesh"
            )

    def carry(turn: Array) -> Array:
        piece = np.clip(np.searchsorted(0.5 * (angles[:-1] + angles[1:]), turn), 0, len(angles) - 1)
        found = goals[piece] + slopes[piece] * (turn - angles[piece])
        gap = np.clip(np.searchsorted(angles, turn, side="right") - 1, 0, len(angles) - 2)
        share = (turn - starts[gap]) / span[gap]
        between = (share > 0.0) & (share < 1.0)
        s = np.clip(share, 0.0, 1.0)
        cubic = (
            low[gap]
            + rise[gap] * s**2 * (3.0 - 2.0 * s)
            + first[gap] * s * (1.0 - s) ** 2
            - last[gap] * s**2 * (1.0 - s)
        )
        return np.where(between, cubic, found)

    return carry


def _gaps(angles: Array) -> Array:
    """Half the angle to the knots before and after each, shape (2, n)."""
    half = 0.5 * np.diff(angles)
    return np.array([np.append(np.inf, half), np.append(half, np.inf)])


def _knots(
    slab: SeminarActuator, other: SeminarActuator, lines: list[tuple[Channel, Channel]]
) -> list[tuple[float, float, float, float]]:
    """Channels, and the arc's ends where there are none: angle, half the mouth's, its stretch, and angle on the other."""
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
