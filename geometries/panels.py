"""Half sections of bodies of revolution as panels: patches with four sides, meshed in rows, that meet side by side.

Places are (radius, height) in m. Rows of cells follow a thin wall where free triangles, all as long as they are wide, would
need a hundred times as many.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Place = tuple[float, float]

GROWTH = 1.3
"""Ratio of neighbouring cells' lengths where they grow."""

ROUNDING = 1e-9
"""Share of a length that is none."""

GAUSS = 24
"""Points of the rule that integrates over a side; arcs of up to half a circle come out to rounding."""


@dataclasses.dataclass(frozen=True)
class Side:
    """A side of a panel: a line, or a piece of an ellipse of less than half its turn.

    Attributes:
        start: Where it begins.
        end: Where it ends.
        cells: How many cells it is cut into.
        role: What it does; empty between two panels.
        centre: Of the ellipse; None of a line.
        axes: Half axes of the ellipse along the radius and the height; equal ones of a circle.
        growth: Length of a cell over that of the one before it, from start to end.
    """

    start: Place
    end: Place
    cells: int
    role: str = ""
    centre: Place | None = None
    axes: Place = (1.0, 1.0)
    growth: float = 1.0

    def places(self, shares: Array) -> Array:
        """Places (n, 2) at shares (n,) of a line's length or of an arc's angle."""
        start, end = np.array(self.start), np.array(self.end)
        if self.centre is None:
            return start + shares[:, None] * (end - start)
        angle = self._angle(self.start) + shares * self.turn
        return np.array(self.centre) + np.array(self.axes) * np.column_stack([np.cos(angle), np.sin(angle)])

    def shares(self, places: Array) -> Array:
        """Shares (n,) at which places (n, 2) on it are; those of places beyond an end are 0 or 1."""
        start, end = np.array(self.start), np.array(self.end)
        if self.centre is None:
            along = end - start
            return np.clip((places - start) @ along / (along @ along), 0.0, 1.0)
        x, y = ((places - self.centre) / self.axes).T
        return np.clip(_wrapped(np.arctan2(y, x) - self._angle(self.start)) / self.turn, 0.0, 1.0)

    def missed(self, places: Array) -> Array:
        """How far places (n, 2) are from it, in m; exact for those on it."""
        return np.asarray(np.linalg.norm(self.places(self.shares(places)) - places, axis=1))

    @property
    def volume(self) -> float:
        """Pi times the integral of the squared radius over the height: what it adds to the volume inside a closed outline."""
        nodes, weights = np.polynomial.legendre.leggauss(GAUSS)
        shares = 0.5 * (nodes + 1.0)
        if self.centre is None:
            slope = np.full(GAUSS, self.end[1] - self.start[1])
        else:
            slope = self.axes[1] * np.cos(self._angle(self.start) + shares * self.turn) * self.turn
        return float(0.5 * math.pi * (self.places(shares)[:, 0] ** 2 * slope) @ weights)

    @property
    def control(self) -> tuple[Place, float]:
        """Where the tangents of an arc's ends meet, and the weight with which it makes the arc a rational parabola."""
        assert self.centre is not None
        half = 0.5 * self.turn
        middle = self._angle(self.start) + half
        (r, z), (a, c), weight = self.centre, self.axes, math.cos(half)
        return (r + a * math.cos(middle) / weight, z + c * math.sin(middle) / weight), weight

    @property
    def key(self) -> frozenset[Place]:
        """What two sides have in common that are one: no two of a section join the same corners."""
        return frozenset((self.start, self.end))

    @property
    def reversed(self) -> Side:
        """The same from its end to its start."""
        return dataclasses.replace(self, start=self.end, end=self.start, growth=1.0 / self.growth)

    def _angle(self, place: Place) -> float:
        assert self.centre is not None
        return math.atan2((place[1] - self.centre[1]) / self.axes[1], (place[0] - self.centre[0]) / self.axes[0])

    @property
    def turn(self) -> float:
        """Angle of an arc in rad, against the clock."""
        return float(_wrapped(np.array(self._angle(self.end) - self._angle(self.start))))


def _wrapped(angles: Array) -> Array:
    """Angles between -pi and pi."""
    return (angles + np.pi) % (2.0 * np.pi) - np.pi


@dataclasses.dataclass(frozen=True)
class Panel:
    """A patch of a half section.

    Attributes:
        region: What it is a part of, such as ``"solid"``.
        sides: Four of them, each beginning where the one before ends; opposite ones have as many cells.
    """

    region: str
    sides: tuple[Side, Side, Side, Side]

    @property
    def corners(self) -> tuple[Place, ...]:
        return tuple(side.start for side in self.sides)


def outline(panels: Iterable[Panel]) -> list[Side]:
    """The sides of panels that have a role, each once."""
    return list({side.key: side for panel in panels for side in panel.sides if side.role}.values())


def chained(sides: Iterable[Side]) -> list[Side]:
    """Sides that make one line, in its order and direction: from the axis at the top outwards."""
    left = list(sides)
    at = max((place for side in left for place in (side.start, side.end)), key=lambda place: (-place[0], place[1]))
    found: list[Side] = []
    while left:
        met = [side for side in left if at in (side.start, side.end)]
        if not met:
            break
        left.remove(met[0])
        found.append(met[0] if met[0].start == at else met[0].reversed)
        at = found[-1].end
    return found


def turned_volume(panels: Iterable[Panel]) -> float:
    """Volume in m3 of the panels turned around the axis."""
    return sum(abs(sum(side.volume for side in panel.sides)) for panel in panels)


def enclosed_volume(sides: Iterable[Side]) -> float:
    """Volume in m3 between a wall turned around the axis and planes square to it through the wall's ends."""
    return abs(sum(side.volume for side in sides))


def graded(length: float, first: float, largest: float) -> list[tuple[float, int, float]]:
    """Cut a length into cells that are small at its beginning and grow.

    Args:
        length: In m.
        first: Length of the first cell at most, m.
        largest: Length of any cell at most, m.

    Returns:
        One or two pieces in order: length in m, cells, and length of a cell over that of the one before it.
    """
    growing = max(0, math.ceil(math.log(largest / first) / math.log(GROWTH)))
    sums = first * (GROWTH ** np.arange(1, growing + 1) - 1.0) / (GROWTH - 1.0)
    if growing and sums[-1] >= length * (1.0 - ROUNDING):
        return [(length, int(np.searchsorted(sums, length * (1.0 - ROUNDING))) + 1, GROWTH)]
    near = float(sums[-1]) if growing else 0.0
    pieces = [(near, growing, GROWTH)] if growing else []
    return [*pieces, (length - near, max(1, math.ceil((length - near) / largest - ROUNDING)), 1.0)]
