"""The wavy wall of a bending bellows: arcs that join smoothly, of the same thickness everywhere, and its volumes.

Along x the middle of the wall goes from a valley to a crest and back: an arc about a centre outside the valley, if the folds
are deep a straight flank across x, and an arc about a centre inside the crest.
"""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from geometries.bending_bellows import BendingBellows


@dataclasses.dataclass(frozen=True)
class Arc:
    """Half a fold's rounding, along x, from the bottom of a valley or up to the top of a crest.

    Attributes:
        centre: Its centre: x, and the radius from the bellows' axis, in m.
        radius: Of the arc in m.
        crest: Whether it bulges outwards.
        start: x of its first point in m.
        end: x of its last point in m.
    """

    centre: tuple[float, float]
    radius: float
    crest: bool
    start: float
    end: float

    def height(self, x: float) -> float:
        """Radius from the bellows' axis at x, in m."""
        up = math.sqrt(max(0.0, self.radius**2 - (x - self.centre[0]) ** 2))
        return self.centre[1] + (up if self.crest else -up)

    @property
    def square(self) -> float:
        """Integral along x of the squared distance from the axis, in m3."""
        a, c, sign = self.radius, self.centre[1], 1.0 if self.crest else -1.0

        def until(x: float) -> float:
            t = math.asin(max(-1.0, min(1.0, (x - self.centre[0]) / a)))
            first = c * c * a * math.sin(t)
            second = sign * c * a * a * (t + 0.5 * math.sin(2.0 * t))
            return first + second + a**3 * (math.sin(t) - math.sin(t) ** 3 / 3.0)

        return until(self.end) - until(self.start)


def half_angle(bellows: BendingBellows) -> float:
    """Angle in rad that the wall turns between the bottom of a valley and its flank: at most a right one."""
    return min(2.0 * math.atan(2.0 * bellows.depth / bellows.pitch), 0.5 * math.pi)


def fold_radius(bellows: BendingBellows) -> float:
    """Radius in m of the middle of the wall in crests and valleys."""
    return bellows.pitch / (4.0 * math.sin(half_angle(bellows)))


def length(bellows: BendingBellows) -> float:
    """From the clamp to the tip, in m."""
    return bellows.root + bellows.folds * bellows.pitch + bellows.cap


def crest(bellows: BendingBellows) -> float:
    """Outer radius of the crests and the end plates, in m."""
    return bellows.radius + bellows.depth + bellows.wall


def half_width(bellows: BendingBellows) -> float:
    """From the mirror plane to the side of the base, in m."""
    return crest(bellows) + bellows.rim


def profile(bellows: BendingBellows, outer: bool) -> list[Arc]:
    """The arcs of the wall's inner or outer face from the root to the cap, four a fold."""
    rho, turn, half = fold_radius(bellows), half_angle(bellows), 0.5 * bellows.wall
    side = half if outer else -half
    valley, top = bellows.radius + half, bellows.radius + half + bellows.depth  # of the middle
    low, high = rho - side, rho + side
    arcs = []
    for k in range(bellows.folds):
        begin = bellows.root + k * bellows.pitch
        middle, end = begin + 0.5 * bellows.pitch, begin + bellows.pitch
        reach, over = low * math.sin(turn), high * math.sin(turn)
        arcs += [
            Arc((begin, valley + rho), low, False, begin, begin + reach),
            Arc((middle, top - rho), high, True, middle - over, middle),
            Arc((middle, top - rho), high, True, middle, middle + over),
            Arc((end, valley + rho), low, False, end - reach, end),
        ]
    return arcs


def cavity_volume(bellows: BendingBellows) -> float:
    """Volume in m3 of the half-round air; flanks across x add nothing."""
    return 0.5 * math.pi * sum(arc.square for arc in profile(bellows, False))


def solid_volume(bellows: BendingBellows) -> float:
    """Volume in m3 of the whole solid: base, end plates and wavy wall."""
    outside = sum(arc.square for arc in profile(bellows, True))
    ends = (bellows.root + bellows.cap) * crest(bellows) ** 2
    base = 2.0 * half_width(bellows) * length(bellows) * bellows.base
    return base + 0.5 * math.pi * (outside + ends) - cavity_volume(bellows)


def wall_length(bellows: BendingBellows) -> float:
    """Length in m of the middle of the wall of one fold."""
    rho, turn = fold_radius(bellows), half_angle(bellows)
    straight = bellows.depth - 2.0 * rho * (1.0 - math.cos(turn))
    return 4.0 * rho * turn + 2.0 * max(0.0, straight)


def fold_size(bellows: BendingBellows) -> float:
    """Size of the cells in the folds in m: an arc has two of them or so."""
    return min(bellows.cell_size, 1.5 * fold_radius(bellows))


def expected_cells(bellows: BendingBellows) -> float:
    """Rough number of cells: thin walls have cells by their area, thick parts by their volume."""
    around = 0.5 * math.pi * (bellows.radius + 0.5 * bellows.depth)
    folds = 2.0 * bellows.folds * wall_length(bellows) * around / fold_size(bellows) ** 2
    base = (
        length(bellows) * half_width(bellows) * max(3.0, 1.2 * bellows.base / bellows.cell_size) / bellows.cell_size**2
    )
    return 9.0 * (folds + base) * 2.0 / bellows.copies
