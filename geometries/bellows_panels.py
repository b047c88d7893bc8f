"""The half section of a bellows: cross-sections of the wall one after the other, and panels between neighbours."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, NamedTuple

from geometries.panels import Panel, Place, Side

if TYPE_CHECKING:
    from geometries.bellows import Bellows


NEAR = 1e-9
"""Share of the pitch up to which a line has no length."""


class Cut(NamedTuple):
    """A cross-section of the wall.

    Attributes:
        inside: Its end at the air.
        outside: Its end outside.
        centre: Of the arcs that lead to it from the one before; None where lines do.
    """

    inside: Place
    outside: Place
    centre: Place | None


def lines(bellows: Bellows) -> dict[tuple[str, ...], float]:
    """Lengths in m of the lines between arcs, upright at roots and crests and across in the flanks, by what they hang on."""
    bend = "rounding" if bellows.rounding else "pitch"
    depth = bellows.outer_radius - bellows.inner_radius - bellows.wall
    found = {("outer_radius", "inner_radius", "wall", bend): depth - 2.0 * bellows.bend}
    return found | ({("pitch", "rounding"): 0.25 * bellows.pitch - bellows.rounding} if bellows.rounding else {})


def cuts(bellows: Bellows) -> list[Cut]:
    """The wall's cross-sections from the lower plate to the upper one, where lines and arcs meet and in the crests' middle."""
    half, turn, bend = 0.5 * bellows.wall, 0.25 * bellows.pitch, bellows.bend
    root, crest = bellows.inner_radius + half, bellows.outer_radius - half
    found: list[Cut] = []

    def add(r: float, z: float, across: Place, centre: Place | None = None) -> None:
        """A cross-section around (r, z); ``across`` is the unit vector from the air outwards."""
        (x, y) = across
        cut = Cut((r - half * x, z - half * y), (r + half * x, z + half * y), centre)
        if not found or math.dist(cut.inside, found[-1].inside) > NEAR * bellows.pitch:
            found.append(cut)

    for k in range(bellows.convolutions):
        low = bellows.cap + k * bellows.pitch
        first, second, high = low + turn, low + 3.0 * turn, low + 4.0 * turn
        out, up, down = (1.0, 0.0), (0.0, 1.0), (0.0, -1.0)
        add(root, low, out)
        add(root, first - bend, out)
        add(root + bend, first, down, (root + bend, first - bend))
        add(crest - bend, first, down)
        add(crest, first + bend, out, (crest - bend, first + bend))
        add(crest, 0.5 * (first + second), out)
        add(crest, second - bend, out)
        add(crest - bend, second, up, (crest - bend, second - bend))
        add(root + bend, second, up)
        add(root, second + bend, out, (root + bend, second + bend))
        add(root, high, out)
    return found


def bellows_panels(bellows: Bellows) -> tuple[Panel, ...]:
    """The half section; see `Bellows`."""
    through = bellows.rows

    def cells(length: float) -> int:
        return max(1, math.ceil(length / bellows.cell_size - 1e-9))

    def side(start: Place, end: Place, centre: Place | None, count: int, role: str) -> Side:
        radius = math.dist(start, centre) if centre else 1.0
        return Side(start, end, count, role, centre, (radius, radius))

    wall = cuts(bellows)
    panels = []
    for a, b in itertools.pairwise(wall):
        quarter = 0.5 * math.pi * bellows.bend if b.centre else 0.0
        count = max(3, cells(quarter)) if b.centre else cells(math.dist(a.inside, b.inside))
        low, high = Side(a.inside, a.outside, through), Side(b.outside, b.inside, through)
        right, left = (side(*pair, b.centre, count, role) for pair, role in
                       (((a.outside, b.outside), "outer"), ((b.inside, a.inside), "cavity")))  # fmt: skip
        panels.append(Panel("solid", (low, right, high, left)))
    return (*_plate(bellows, wall[0], 0.0, cells), *panels, *_plate(bellows, wall[-1], bellows.height, cells))


def _plate(bellows: Bellows, cut: Cut, level: float, cells: Callable[[float], int]) -> Iterator[Panel]:
    """A plate between a height outside and the wall's end: within the wall, and below or above it."""
    (inner, floor), (outer, _) = cut.inside, cut.outside
    upper = level > floor
    low, high = min(level, floor), max(level, floor)
    across, up, through = cells(inner), max(bellows.rows, cells(high - low)), bellows.rows
    face, bonded = ("tip" if upper else "support"), ""
    for left, right, count, inside, ends in (
        (0.0, inner, across, "cavity", ("axis", "")),
        (inner, outer, through, bonded, ("", "outer")),
    ):
        below, above = (inside, face) if upper else (face, inside)
        a, b, c, d = (left, low), (right, low), (right, high), (left, high)
        yield Panel("solid", (Side(a, b, count, below), Side(b, c, up, ends[1]), Side(c, d, count, above),
                              Side(d, a, up, ends[0])))  # fmt: skip
