"""The outline of a body of revolution in whole edges: sides of panels that go on in one line or one arc are put together.

How many panels there are depends on the cells; the edges between corners do not, so points of one device are carried to another
along them.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Sequence

import numpy as np

from geometries.panels import Place, Side, chained

AXIS = "axis"
STRAIGHT = 1e-9
"""Largest sine between two lines that are one, and largest distance of centres and half axes of one arc, in half axes, and of
places that are one, in their coordinates."""
HALF_TURN = math.pi * (1.0 - 1e-6)
"""Arcs are put together up to this angle: a share of half a turn would not tell which way it goes."""


def whole_edges(sides: Iterable[Side], corners: Sequence[Place]) -> list[Side]:
    """Sides put together, in order and direction: from the axis at the top outwards, and back along the axis.

    Args:
        sides: Of an outline, in any order and either way round.
        corners: Places where edges end even if they go on: those that are points of the device's own.
    """
    found, count = list(sides), math.inf
    while len(found) < count:  # a side may join two that were found apart
        count, left, found = len(found), found, []
        for side in left:
            joined = ((at, _joined(one, side, corners)) for at, one in enumerate(found) if one.role == side.role)
            place, whole = next(((at, whole) for at, whole in joined if whole), (len(found), side))
            found[place : place + 1] = [whole]
    return chained(sorted(found, key=lambda side: side.role == AXIS))


def _joined(first: Side, second: Side, corners: Sequence[Place]) -> Side | None:
    """The first of two sides with the other put to one of its ends; None if they do not go on in each other."""
    for other in (second, second.reversed):
        if first.end == other.start and not _is_corner(first.end, corners) and _in_one(first, other):
            return dataclasses.replace(first, end=other.end)
        if other.end == first.start and not _is_corner(first.start, corners) and _in_one(other, first):
            return dataclasses.replace(first, start=other.start)
    return None


def _is_corner(place: Place, corners: Sequence[Place]) -> bool:
    """Whether a place is one of the corners, which may have been computed in another way, to rounding."""
    return any(math.dist(place, corner) <= STRAIGHT * max(map(abs, corner)) for corner in corners)


def _in_one(one: Side, two: Side) -> bool:
    """Whether a side that begins where the other ends goes on along the same line or arc."""
    if one.centre is not None and two.centre is not None:
        apart = np.abs(np.subtract((*one.centre, *one.axes), (*two.centre, *two.axes))).max()
        same = apart < STRAIGHT * max(one.axes)
        return bool(same and abs(one.turn + two.turn) < HALF_TURN and one.turn * two.turn > 0.0)
    if one.centre is not None or two.centre is not None:
        return False
    a, b = np.subtract(one.end, one.start), np.subtract(two.end, two.start)
    size = float(np.linalg.norm(a) * np.linalg.norm(b))
    return bool(abs(a[0] * b[1] - a[1] * b[0]) < STRAIGHT * size and a @ b > 0.0)
