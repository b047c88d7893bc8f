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

from geometries import actuator, registry, revolved
from geometries.actuator import Hold, Vector
from geometries.revolved import Revolved
from softmodels.common import schema


@registry.register_device
@dataclasses.dataclass(frozen=True, kw_only=True)
class SuctionCup(Revolved):
    """A suction cup on a stem, as an axisymmetric profile or a wedge.

    Lengths are in m, angles in degrees. Physical groups: solid "solid", faces "cavity" (roof and skirt), "lip" (the ring that
    stands on the plane, z = 0, on which it slides), "outer" and "top" (of the stem).
    """

    radius: float = schema.length_field(0.015, "inner radius of the lip, within which the cup seals")
    lip: float = schema.length_field(0.004, "width of the lip")
    depth: float = schema.length_field(0.005, "height of the cavity above the lip")
    ceiling: float = schema.length_field(0.009, "radius of the cavity's flat ceiling")
    roof: float = schema.length_field(0.004, "thickness of the roof")
    stem_radius: float = schema.length_field(0.005, "radius of the stem")
    stem_height: float = schema.length_field(0.008, "height of the stem above the roof")
    cell_size: float = schema.length_field(
        0.001, "edge length of the cells along the wall; smaller where it is thin", shape=False
    )
    through: float = revolved.through_field(3.0)
    section: str = revolved.section_field()
    angle: float = revolved.wedge_field()

    stem: ClassVar = "cup"
    pressures: ClassVar = "0:-10"
    stiffer: ClassVar = "a thicker roof (--roof), a smaller cup (--radius)"
    examples: ClassVar = ("--radius 10mm --ceiling 6mm --depth 4mm --stem-radius 3mm",)
    faces: ClassVar = ("top", "outer")
    standing: ClassVar = "lip"
    unbonded: ClassVar = ()
    seen: ClassVar = ("top", "outer")

    def check(self) -> None:
        self.check_most("ceiling", 1.0, "radius", "the skirt opens towards the lip, so that it must be at most {}")
        self.check_below("stem_radius", "ceiling")
        self.check_least("roof lip", 5e-3, "radius")
        if self.radius - self.ceiling > 4.0 * self.depth:
            self.reject("depth", "the skirt is flatter than 4 to 1 then, a plate; enlarge it, or ceiling")
        self.check_size("stem_height", self.height, self.outer_radius)
        self.check_cells("ceiling")

    @property
    def panels(self) -> tuple[revolved.Panel, ...]:
        through, level, top = self.rows, self.depth + self.roof, self.height
        stem, ceiling = self.along(self.stem_radius), self.along(self.ceiling - self.stem_radius)
        skirt, rise = self.along(math.hypot(self.radius - self.ceiling, self.depth)), self.along(self.stem_height)
        s, c, h = self.stem_radius, self.ceiling, self.depth
        inner, outer = (self.radius, 0.0), (self.outer_radius, 0.0)
        return (
            revolved.rectangle((0.0, level), (s, top), (stem, rise), ("", "outer", "top", "axis")),
            revolved.rectangle((0.0, h), (s, level), (stem, through), ("cavity", "", "", "axis")),
            revolved.rectangle((s, h), (c, level), (ceiling, through), ("cavity", "", "outer", "")),
            revolved.Panel("solid", (revolved.Side(inner, outer, through, "lip"), revolved.Side(outer, (c, level),
            skirt, "outer"),
                            revolved.Side((c, level), (c, h), through), revolved.Side((c, h), inner, skirt, "cavity"))),
        )  # fmt: skip

    @property
    def sharp_edges(self) -> tuple[revolved.Place, ...]:
        # Where the lip stands, the cup and its mirror image below the plane make a notch.
        return ((self.radius, 0.0),)

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
    def recipe(self) -> actuator.Recipe:
        cup = actuator.Pour(name="cup", up=self.lift, level=0.0, gate=self.height, vented=self.depth + self.roof)
        return actuator.Recipe(
            pours=(cup,),
            why="The lip lies on the lid, which is smooth, and it is poured through the stem: no mark is on the sealing face.",
        )

    @property
    def probes(self) -> Mapping[str, Vector]:
        return {"ceiling": (0.0, 0.0, self.depth), "rim": (self.radius, 0.0, 0.0), "top": (0.0, 0.0, self.height)}

    figure_texts: ClassVar = {"sealed": ("mm", "sealed diameter", "inner diameter of the lip, deformed")}

    def device_figures(self, places: Mapping[str, Vector]) -> dict[str, float]:
        x, y, _ = places["rim"]
        return {"sealed": 2.0 * math.hypot(x, y)}
