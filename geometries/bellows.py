"""The bellows: a round wall in convolutions between two plates, which lengthens under pressure.

The half profile, with the axis of symmetry z on the left, of two convolutions::

    z
    |__________________  tip
    |      cap        |
    |_____________    |
    |             |   |__________
    |             \\__________    \\  crest
    |                 ______|    |
    |              __/  _________/
    |   air       |    /
    |             |    \\_________  root
    |             \\__________    \\
    |                 ______|    |  outer
    |              __/  _________/
    |_____________|   |
    |      cap        |
    |_________________|__________ r, z = 0, held
    0       inner_radius        outer_radius

The flanks are flat rings, a half pitch apart; roots and crests are rounded, wholly if the rounding is a quarter of the pitch.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterator, Mapping
from typing import ClassVar, NamedTuple

from geometries.actuator import HeldTip, Hold, Pour, Recipe, Vector, tip_field
from geometries.registry import register_device
from geometries.revolved import Panel, Place, Revolved, Side, rectangle, section_field, through_field, wedge_field
from softmodels.common.errors import GeometryError
from softmodels.common.schema import LONGEST, ROUNDING, SHORTEST, choice_field, length_field, shown

# ----------------------------------------------------------------------------------------------------------------------
# Bellows with invalid parameters, detected before meshing.


THINNEST = 5e-3
"""Smallest thickness of the wall in outer radii."""

NEEDLE = 20.0
"""Largest ratio of a cell's length to its width through the wall."""

THICKEST = 10.0
"""Largest thickness of a plate in outer radii."""


def check_bellows(bellows: Bellows) -> None:
    """Check a bellows' parameters against each other.

    Raises:
        GeometryError: The first parameter found impossible, with its value and the limit.
    """
    _check_wall(bellows)
    _check_rounding(bellows)
    _check_size(bellows)
    bellows.check_cells()


def _check_wall(bellows: Bellows) -> None:
    wall, pitch = bellows.wall, bellows.pitch
    if bellows.outer_radius <= bellows.inner_radius:
        raise GeometryError(
            f"outer_radius is {shown(bellows.outer_radius, 'm')}; it must be larger than inner_radius, "
            f"{shown(bellows.inner_radius, 'm')}"
        )
    if wall < THINNEST * bellows.outer_radius:
        raise GeometryError(
            f"wall is {shown(wall, 'm')}; it must be at least {THINNEST:g} of outer_radius, "
            f"{shown(bellows.outer_radius, 'm')}"
        )
    if wall > 0.45 * pitch:
        raise GeometryError(
            f"wall is {shown(wall, 'm')}; the flanks are half a pitch apart, and 0.45 times pitch, {shown(pitch, 'm')}, is the "
            "most that leaves air between them"
        )
    if bellows.cap > THICKEST * bellows.outer_radius:
        raise GeometryError(
            f"cap is {shown(bellows.cap, 'm')}; more than {THICKEST:g} times outer_radius, "
            f"{shown(bellows.outer_radius, 'm')}, suggests a wrong unit"
        )


def _check_rounding(bellows: Bellows) -> None:
    bend, quarter = bellows.bend, 0.25 * bellows.pitch
    least = 0.5 * bellows.wall + SHORTEST
    if bend < least * (1 - ROUNDING):
        raise GeometryError(
            f"rounding is {shown(bend, 'm')}; in the middle of a wall of {shown(bellows.wall, 'm')} it must be at least "
            f"{shown(least, 'm')}"
        )
    if bend > quarter * (1 + ROUNDING):
        raise GeometryError(
            f"rounding is {shown(bend, 'm')}; it must be at most a quarter of pitch, {shown(quarter, 'm')}, with which roots "
            "and crests are half circles"
        )
    depth = bellows.outer_radius - bellows.inner_radius - bellows.wall
    if 2.0 * bend > depth * (1 + ROUNDING):
        raise GeometryError(
            f"rounding is {shown(bend, 'm')}; root and crest together need {shown(2 * bend, 'm')} between inner_radius and "
            f"outer_radius, less the wall, and {shown(max(depth, 0.0), 'm')} are there"
        )


def _check_size(bellows: Bellows) -> None:
    if max(bellows.height, bellows.outer_radius) > LONGEST:
        raise GeometryError(
            f"pitch is {shown(bellows.pitch, 'm')}; with {bellows.convolutions} convolutions the bellows passes {LONGEST:g} m, "
            "which suggests a wrong unit"
        )
    longest = min(NEEDLE * bellows.wall / max(bellows.through, 1.0), bellows.inner_radius)
    if bellows.cell_size > longest:
        raise GeometryError(
            f"cell_size is {shown(bellows.cell_size, 'm')}; it must be at most {shown(longest, 'm')}: {NEEDLE:g} times a "
            f"cell's width through the wall, and inner_radius"
        )


# ----------------------------------------------------------------------------------------------------------------------
# The half section of a bellows: cross-sections of the wall one after the other, and panels between neighbours.


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
    """Return the lengths in m of the lines between arcs, upright at roots and crests and across in the flanks, by what they
    hang on."""
    bend = "rounding" if bellows.rounding else "pitch"
    depth = bellows.outer_radius - bellows.inner_radius - bellows.wall
    found = {("outer_radius", "inner_radius", "wall", bend): depth - 2.0 * bellows.bend}
    return found | ({("pitch", "rounding"): 0.25 * bellows.pitch - bellows.rounding} if bellows.rounding else {})


def cuts(bellows: Bellows) -> list[Cut]:
    """Return the wall's cross-sections from the lower plate to the upper one, where lines and arcs meet and in the crests'
    middle."""
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
    """Return the half section; see `Bellows`."""
    through = bellows.rows

    def side(start: Place, end: Place, centre: Place | None, count: int, role: str) -> Side:
        radius = math.dist(start, centre) if centre else 1.0
        return Side(start, end, count, role, centre, (radius, radius))

    wall = cuts(bellows)
    panels = []
    for a, b in itertools.pairwise(wall):
        quarter = 0.5 * math.pi * bellows.bend if b.centre else 0.0
        count = max(3, bellows.along(quarter)) if b.centre else bellows.along(math.dist(a.inside, b.inside))
        low, high = Side(a.inside, a.outside, through), Side(b.outside, b.inside, through)
        right, left = (side(*pair, b.centre, count, role) for pair, role in
                       (((a.outside, b.outside), "outer"), ((b.inside, a.inside), "cavity")))  # fmt: skip
        panels.append(Panel("solid", (low, right, high, left)))
    return (*_plate(bellows, wall[0], 0.0), *panels, *_plate(bellows, wall[-1], bellows.height))


def _plate(bellows: Bellows, cut: Cut, level: float) -> Iterator[Panel]:
    """Yield a plate between a height outside and the wall's end: within the wall, and below or above it."""
    (inner, floor), (outer, _) = cut.inside, cut.outside
    upper = level > floor
    low, high = min(level, floor), max(level, floor)
    across, up, through = bellows.along(inner), max(bellows.rows, bellows.along(high - low)), bellows.rows
    face, bonded = ("tip" if upper else "support"), ""
    for left, right, count, inside, ends in (
        (0.0, inner, across, "cavity", ("axis", "")),
        (inner, outer, through, bonded, ("", "outer")),
    ):
        below, above = (inside, face) if upper else (face, inside)
        yield rectangle((left, low), (right, high), (count, up), (below, ends[1], above, ends[0]))


@register_device
@dataclasses.dataclass(frozen=True, kw_only=True)
class Bellows(HeldTip, Revolved):
    """A round bellows between two plates, as an axisymmetric profile or a wedge.

    Lengths are in m, angles in degrees. Physical groups: solid "solid", faces "cavity", "outer" (the wall's outside),
    "support" (the lower plate's underside, z = 0, held) and "tip" (the upper plate's top).
    """

    convolutions: int = choice_field(3, tuple(range(1, 31)), "number of convolutions")
    inner_radius: float = length_field(0.008, "inner radius at the roots")
    outer_radius: float = length_field(0.016, "outer radius at the crests")
    wall: float = length_field(0.0015, "thickness of the wall")
    pitch: float = length_field(0.008, "height of a convolution")
    rounding: float = length_field(
        0.002, "radius of the roots' and crests' rounding, in the middle of the wall; 0 for half circles", zero=True
    )
    cap: float = length_field(0.004, "thickness of the plates at both ends")
    tip: str = tip_field("upper plate", "its top")
    cell_size: float = length_field(0.0008, "edge length of the cells along the wall", shape=False)
    through: float = through_field()
    section: str = section_field()
    angle: float = wedge_field()

    stem: ClassVar = "bellows"
    pressures: ClassVar = "0:30"
    stiffer: ClassVar = "a thicker wall (--wall), narrower flanks (--outer-radius)"
    examples: ClassVar = (
        "--convolutions 6 --pitch 6mm --rounding 1.5mm --wall 1mm",
        "--tip held",
    )
    faces: ClassVar = ("outer", "tip")
    unbonded: ClassVar = ()
    seen: ClassVar = ("tip", "outer")
    meeting: ClassVar = ("outer", "cavity")

    def check(self) -> None:
        check_bellows(self)

    @property
    def panels(self) -> tuple[Panel, ...]:
        return bellows_panels(self)

    @property
    def thinnest(self) -> float:
        return min(self.wall, self.cap)

    @property
    def size(self) -> float:
        return self.outer_radius

    @property
    def height(self) -> float:
        """Height of the whole device in m."""
        return self.convolutions * self.pitch + 2.0 * self.cap

    @property
    def bend(self) -> float:
        """Radius in m of roots and crests, in the middle of the wall."""
        return self.rounding or 0.25 * self.pitch

    @property
    def recipe(self) -> Recipe:
        wall = Pour(name="wall", up=self.lift, level=self.cap, sideways=(0.0, 1.0, 0.0), lost=True, gate=self.height)
        plate = Pour(name="plate", up=(0.0, 0.0, -1.0), level=-self.cap, lid=False)
        return Recipe(
            pours=(wall, plate),
            why="The outside opens in two halves. The core is wider than the end it would leave by, so that it is dissolved or "
            "melted out; then the lower plate is bonded on.",
            inlets=(((0.0, 0.0, 0.0), (0.0, 0.0, self.cap)),),
        )  # fmt: skip

    @property
    def holds(self) -> tuple[Hold, ...]:
        return (*super().holds, *self.axis_holds)

    @property
    def movable(self) -> tuple[str, ...]:
        """All lengths except those that would insert a line between two arcs where they meet: no mesh can follow that."""
        met = {name for names, line in lines(self).items() if line < NEAR * self.pitch for name in names}
        return tuple(name for name in super().movable if name not in met)

    @property
    def clearances(self) -> dict[str, float]:
        return {
            "wall": self.wall, "plates": self.cap, "air between flanks": 0.5 * self.pitch - self.wall,
            "air at the roots": self.inner_radius, "inside of the rounding": self.bend - 0.5 * self.wall,
        }  # fmt: skip

    @property
    def probes(self) -> Mapping[str, Vector]:
        crest = (self.outer_radius, 0.0, self.cap + (self.convolutions // 2 + 0.5) * self.pitch)
        return {"apex": (0.0, 0.0, self.height), "ceiling": (0.0, 0.0, self.height - self.cap), "crest": crest}

    figure_texts: ClassVar = {"width_mm": ("width", "diameter of the outside at a crest in the middle, deformed")}

    def device_figures(self, places: Mapping[str, Vector]) -> dict[str, float]:
        x, y, _ = places["crest"]
        return {"width_mm": 2e3 * float((x * x + y * y) ** 0.5)}
