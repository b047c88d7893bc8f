"""The suction cup: a flat or conical cup on a stem, whose lip seals on a plane.

The half profile, with the axis of symmetry z on the left::

    z
    |_____  top
    |     |
    |stem |
    |     |____________
    |         roof     \\
    |___________        \\   outer
    |           \\        \\
    |  cavity    \\  skirt \\
    |             \\        \\
    |              \\________\\  lip, z = 0
    0      ceiling  radius   outer radius

The cavity is open below: the plane on which the lip stands closes it. By itself the lip is held down and slides there without
friction; on a plane of ``[contact]`` with ``seal`` it touches, rubs and lifts. What is asked of a cup are the force that it
holds at a vacuum, and where its seal opens.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import ClassVar

from geometries.actuator import Hold, Pour, Recipe, Vector
from geometries.registry import register_device
from geometries.revolved import Panel, Revolved, Side, rectangle, section_field, through_field, wedge_field
from softmodels.common.errors import GeometryError
from softmodels.common.schema import LONGEST, length_field, shown

THINNEST = 5e-3
"""Smallest thickness of roof and lip in radii of the cup."""
NEEDLE = 20.0
"""Largest ratio of a cell's length to its width through the wall."""
FLARED = 4.0
"""Largest change of the skirt's radius in depths: a flatter one is a plate."""


def check_cup(cup: SuctionCup) -> None:
    """Check a cup's parameters against each other.

    Raises:
        GeometryError: The first parameter found impossible, with its value and the limit.
    """

    def reject(name: str, why: str) -> None:
        raise GeometryError(f"{name} is {shown(getattr(cup, name), 'm')}; {why}")

    if cup.ceiling > cup.radius:
        reject(
            "ceiling", f"the skirt opens towards the lip, so that it must be at most radius, {shown(cup.radius, 'm')}"
        )
    if cup.stem_radius >= cup.ceiling:
        reject("stem_radius", f"it must be smaller than ceiling, {shown(cup.ceiling, 'm')}")
    for name in ("roof", "lip"):
        if getattr(cup, name) < THINNEST * cup.radius:
            reject(name, f"it must be at least {THINNEST:g} of radius, {shown(cup.radius, 'm')}")
    if cup.radius - cup.ceiling > FLARED * cup.depth:
        reject("depth", f"the skirt is flatter than {FLARED:g} to 1 then; enlarge it, or ceiling")
    if max(cup.height, cup.outer_radius) > LONGEST:
        reject("stem_height", f"the cup passes {LONGEST:g} m, which suggests a wrong unit")
    longest = min(NEEDLE * cup.thinnest / max(cup.through, 1.0), cup.ceiling)
    if cup.cell_size > longest:
        reject(
            "cell_size",
            f"it must be at most {shown(longest, 'm')}: {NEEDLE:g} times a cell's width through the wall, and ceiling",
        )
    cup.check_cells()


def cup_panels(cup: SuctionCup) -> tuple[Panel, ...]:
    """Return the half section; see `SuctionCup`."""
    through, level, top = cup.rows, cup.depth + cup.roof, cup.height
    stem, ceiling = cup.along(cup.stem_radius), cup.along(cup.ceiling - cup.stem_radius)
    skirt, rise = cup.along(math.hypot(cup.radius - cup.ceiling, cup.depth)), cup.along(cup.stem_height)
    s, c, h = cup.stem_radius, cup.ceiling, cup.depth
    inner, outer = (cup.radius, 0.0), (cup.outer_radius, 0.0)
    return (
        rectangle((0.0, level), (s, top), (stem, rise), ("", "outer", "top", "axis")),
        rectangle((0.0, h), (s, level), (stem, through), ("cavity", "", "", "axis")),
        rectangle((s, h), (c, level), (ceiling, through), ("cavity", "", "outer", "")),
        Panel("solid", (Side(inner, outer, through, "lip"), Side(outer, (c, level), skirt, "outer"),
                        Side((c, level), (c, h), through), Side((c, h), inner, skirt, "cavity"))),
    )  # fmt: skip


@register_device
@dataclasses.dataclass(frozen=True, kw_only=True)
class SuctionCup(Revolved):
    """A suction cup on a stem, as an axisymmetric profile or a wedge.

    Lengths are in m, angles in degrees. Physical groups: solid "solid", faces "cavity" (roof and skirt), "lip" (the ring that
    stands on the plane, z = 0, on which it slides), "outer" and "top" (of the stem).
    """

    radius: float = length_field(0.015, "inner radius of the lip, within which the cup seals")
    lip: float = length_field(0.004, "width of the lip")
    depth: float = length_field(0.005, "height of the cavity above the lip")
    ceiling: float = length_field(0.009, "radius of the cavity's flat ceiling")
    roof: float = length_field(0.004, "thickness of the roof")
    stem_radius: float = length_field(0.005, "radius of the stem")
    stem_height: float = length_field(0.008, "height of the stem above the roof")
    cell_size: float = length_field(0.001, "edge length of the cells along the wall", shape=False)
    through: float = through_field(3.0)
    section: str = section_field()
    angle: float = wedge_field()

    stem: ClassVar = "cup"
    pressures: ClassVar = "0:-10"
    stiffer: ClassVar = "a thicker roof (--roof), a smaller cup (--radius)"
    examples: ClassVar = ("--radius 10mm --ceiling 6mm --depth 4mm --stem-radius 3mm",)
    faces: ClassVar = ("top", "outer")
    standing: ClassVar = "lip"
    unbonded: ClassVar = ()
    seen: ClassVar = ("top", "outer")

    def check(self) -> None:
        check_cup(self)

    @property
    def panels(self) -> tuple[Panel, ...]:
        return cup_panels(self)

    @property
    def thinnest(self) -> float:
        return min(self.roof, self.lip)

    @property
    def size(self) -> float:
        return self.radius

    @property
    def outer_radius(self) -> float:
        """Outer radius of the lip in m."""
        return self.radius + self.lip

    @property
    def height(self) -> float:
        """Height of the whole device in m."""
        return self.depth + self.roof + self.stem_height

    @property
    def holds(self) -> tuple[Hold, ...]:
        return (Hold("lip", self.lift), *self.axis_holds)

    @property
    def pushed(self) -> str:
        return "top"

    @property
    def clearances(self) -> dict[str, float]:
        return {"roof": self.roof, "lip": self.lip, "cavity": self.depth, "stem": self.stem_radius}

    @property
    def recipe(self) -> Recipe:
        cup = Pour(name="cup", up=self.lift, level=0.0, gate=self.height, vented=self.depth + self.roof)
        return Recipe(
            pours=(cup,),
            why="The lip lies on the lid, which is smooth, and it is poured through the stem: no mark is on the sealing face.",
        )

    @property
    def probes(self) -> Mapping[str, Vector]:
        return {"ceiling": (0.0, 0.0, self.depth), "rim": (self.radius, 0.0, 0.0), "top": (0.0, 0.0, self.height)}

    figure_texts: ClassVar = {"sealed_mm": ("sealed diameter", "inner diameter of the lip, deformed")}

    def device_figures(self, places: Mapping[str, Vector]) -> dict[str, float]:
        x, y, _ = places["rim"]
        return {"sealed_mm": 2e3 * math.hypot(x, y)}
