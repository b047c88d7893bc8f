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

from geometries import actuator, registry, revolved
from geometries.actuator import Hold, Vector
from geometries.revolved import Revolved
from softmodels.common import schema
from softmodels.common.errors import GeometryError


@registry.register_device
@dataclasses.dataclass(frozen=True, kw_only=True)
class Bellows(actuator.HeldTip, Revolved):
    """A round bellows between two plates, as an axisymmetric profile or a wedge.

    Lengths are in m, angles in degrees. Physical groups: solid "solid", faces "cavity", "outer" (the wall's outside),
    "support" (the lower plate's underside, z = 0, held) and "tip" (the upper plate's top).
    """

    convolutions: int = schema.choice_field(3, tuple(range(1, 31)), "number of convolutions")
    inner_radius: float = schema.length_field(0.008, "inner radius at the roots")
    outer_radius: float = schema.length_field(0.016, "outer radius at the crests")
    wall: float = schema.length_field(0.0015, "thickness of the wall")
    pitch: float = schema.length_field(0.008, "height of a convolution")
    rounding: float = schema.length_field(
        0.002, "radius of the roots' and crests' rounding, in the middle of the wall; 0 for half circles", zero=True
    )
    cap: float = schema.length_field(0.004, "thickness of the plates at both ends")
    tip: str = actuator.tip_field("upper plate", "its top")
    cell_size: float = schema.length_field(
        0.0008, "edge length of the cells along the wall; smaller ones where it is thin", shape=False
    )
    through: float = revolved.through_field()
    section: str = revolved.section_field()
    angle: float = revolved.wedge_field()

    stem: ClassVar = "bellows"
    variable: ClassVar = ("wall",)
    pressures: ClassVar = "0:30"
    stiffer: ClassVar = "a thicker wall (--wall), narrower flanks (--outer-radius)"
    examples: ClassVar = ("--convolutions 6 --pitch 6mm --rounding 1.5mm --wall 1mm", "--tip held")
    faces: ClassVar = ("outer", "tip")
    unbonded: ClassVar = ()
    seen: ClassVar = ("tip", "outer")
    meeting: ClassVar = ("outer", "cavity")

    def check(self) -> None:
        self._check_wall()
        self._check_rounding()
        self.check_size("pitch", self.height, self.outer_radius, given=f"with {self.convolutions} convolutions ")
        self.check_cells("inner_radius")

    def _check_wall(self) -> None:
        if self.outer_radius <= self.inner_radius:
            self.reject("outer_radius", f"it must be larger than {self.told('inner_radius')}")
        self.check_least("wall", 2e-3, "outer_radius")
        apart = "the flanks are half a pitch apart, and {} is the most that leaves air between them"
        self.check_most("wall", 0.45, "pitch", apart)
        self.check_most("cap", 10.0, "outer_radius", "more than {}, suggests a wrong unit")

    def _check_rounding(self) -> None:
        def reject(why: str) -> None:
            raise GeometryError(f"rounding is {schema.shown(self.bend, 'm')}; {why}")

        least, quarter = 0.5 * self.wall + schema.MIN_LENGTH, 0.25 * self.pitch
        if self.bend < least * (1 - schema.BOUND_TOLERANCE):
            reject(f"in the middle of a wall of {schema.shown(self.wall, 'm')} it must be at least {schema.shown(least, 'm')}")
        if self.bend > quarter * (1 + schema.BOUND_TOLERANCE):
            reject(f"it must be at most a quarter of pitch, {schema.shown(quarter, 'm')}, with which its ends are half circles")
        if 2.0 * self.bend > self.depth * (1 + schema.BOUND_TOLERANCE):
            reject(
                f"root and crest together need {schema.shown(2 * self.bend, 'm')} between inner_radius and outer_radius, less "
                f"the wall, and {schema.shown(max(self.depth, 0.0), 'm')} are there"
            )

    @property
    def depth(self) -> float:
        """From a root to a crest in m, in the middle of the wall."""
        return self.outer_radius - self.inner_radius - self.wall

    @property
    def cuts(self) -> list[Cut]:
        """The wall's cross-sections from the lower plate to the upper one, where lines and arcs meet and in the crests'
        middle."""
        half, turn, bend = 0.5 * self.wall, 0.25 * self.pitch, self.bend
        root, crest = self.inner_radius + half, self.outer_radius - half
        cuts: list[Cut] = []

        def add(r: float, z: float, across: revolved.Place, centre: revolved.Place | None = None) -> None:
            """A cross-section around (r, z); ``across`` is the unit vector from the air outwards."""
            (x, y) = across
            cut = Cut((r - half * x, z - half * y), (r + half * x, z + half * y), centre)
            if not cuts or math.dist(cut.inside, cuts[-1].inside) > ZERO_LENGTH_TOLERANCE * self.pitch:
                cuts.append(cut)

        out, up, down = (1.0, 0.0), (0.0, 1.0), (0.0, -1.0)
        for k in range(self.convolutions):
            low = self.cap + k * self.pitch
            first, second, high = low + turn, low + 3.0 * turn, low + 4.0 * turn
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
        return cuts

    @property
    def panels(self) -> tuple[revolved.Panel, ...]:
        through, wall, panels = self.rows, self.cuts, []
        longest = min(self.cell_size, CELL_LENGTH_RATIO * math.sqrt(self.bend * self.wall))
        for a, b in itertools.pairwise(wall):
            length = 0.5 * math.pi * self.bend if b.centre else math.dist(a.inside, b.inside)
            count = max(3 if b.centre else 1, math.ceil(length / longest - schema.BOUND_TOLERANCE))
            low, high = revolved.Side(a.inside, a.outside, through), revolved.Side(b.outside, b.inside, through)
            right, left = (
                revolved.Side(
                    start, end, count, role, b.centre, (radius := math.dist(start, b.centre) if b.centre else 1.0, radius)
                )
                for start, end, role in ((a.outside, b.outside, "outer"), (b.inside, a.inside, "cavity"))
            )
            panels.append(revolved.Panel("solid", (low, right, high, left)))
        return (*self._plate(wall[0], 0.0), *panels, *self._plate(wall[-1], self.height))

    def _plate(self, cut: Cut, level: float) -> Iterator[revolved.Panel]:
        """Yield a plate between a height outside and the wall's end: within the wall, and below or above it."""
        (inner, floor), (outer, _) = cut.inside, cut.outside
        upper, low, high = level > floor, min(level, floor), max(level, floor)
        across, up, through = self.along(inner), max(self.rows, self.along(high - low)), self.rows
        face = "tip" if upper else "support"
        for left, right, count, inside, ends in (
            (0.0, inner, across, "cavity", ("axis", "")), (inner, outer, through, "", ("", "outer")),
        ):  # fmt: skip
            below, above = (inside, face) if upper else (face, inside)
            yield revolved.rectangle((left, low), (right, high), (count, up), (below, ends[1], above, ends[0]))

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
    def recipe(self) -> actuator.Recipe:
        wall = actuator.Pour(name="wall", up=self.lift, level=self.cap, sideways=(0.0, 1.0, 0.0), lost=True, gate=self.height)
        plate = actuator.Pour(name="plate", up=(0.0, 0.0, -1.0), level=-self.cap, lid=False)
        return actuator.Recipe(
            pours=(wall, plate),
            why="The outside opens in two halves. The core is wider than the end it would leave by, so that it is dissolved or "
            "melted out; then the lower plate is bonded on.",
            inlets=(((0.0, 0.0, 0.0), (0.0, 0.0, self.cap)),),
        )

    @property
    def holds(self) -> tuple[Hold, ...]:
        return (*super().holds, *self.axis_holds)

    @property
    def movable(self) -> tuple[str, ...]:
        """All lengths except those that would insert a line between two arcs where they meet: no mesh can follow that."""
        bend = "rounding" if self.rounding else "pitch"
        lines: dict[tuple[str, ...], float] = {("outer_radius", "inner_radius", "wall", bend): self.depth - 2.0 * self.bend}
        lines |= {("pitch", "rounding"): 0.25 * self.pitch - self.rounding} if self.rounding else {}
        met = {name for names, line in lines.items() if line < ZERO_LENGTH_TOLERANCE * self.pitch for name in names}
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

    figure_texts: ClassVar = {"width": ("mm", "width", "diameter of the outside at a crest in the middle, deformed")}

    def device_figures(self, places: Mapping[str, Vector]) -> dict[str, float]:
        x, y, _ = places["crest"]
        return {"width": 2.0 * float((x * x + y * y) ** 0.5)}


# ----------------------------------------------------------------------------------------------------------------------
# The half section of a bellows: cross-sections of the wall one after the other, and panels between neighbours.


ZERO_LENGTH_TOLERANCE = 1e-9
"""Share of the pitch up to which a line has no length."""

CELL_LENGTH_RATIO = 0.55
"""Length of the wall's longest cells over the root of its thickness times its radius, within which a thin wall bends."""


class Cut(NamedTuple):
    """A cross-section of the wall, from the air to outside, and the centre of the arcs that lead to it from the one before;
    None where lines do."""

    inside: revolved.Place
    outside: revolved.Place
    centre: revolved.Place | None
