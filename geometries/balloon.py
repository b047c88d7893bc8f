"""The balloon: a hollow sphere or spheroid on a neck, with a rod through it if wanted.

The half profile, with the axis of symmetry z on the left; what stands at z = 0 is held::

    z
    |____
    |    \\____
    |__       \\__  wall
    |  \\__       \\
    |     \\       |
    |  air |      |  outer
    |     /       |
    |  __/     __/
    |_/     __/ fillet
    | |   _/
    | |  |  neck
    |_|__|___________ r, z = 0
    0 neck_radius

A rod runs along the axis from z = 0 to the far pole, to which it is bonded; the air passes between it and the neck. What it is
made of, or that it is rigid, the case says.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import ClassVar

from geometries.actuator import Hold, Vector
from geometries.balloon_checks import check_balloon
from geometries.balloon_panels import Meridian, balloon_panels
from geometries.fields import choice_field, length_field
from geometries.panels import Panel, Place
from geometries.registry import register
from geometries.revolved import Revolved, section_field, through_field, wedge_field


@register
@dataclasses.dataclass(frozen=True, kw_only=True)
class Balloon(Revolved):
    """A hollow sphere or spheroid with or without a neck, as an axisymmetric profile or a wedge.

    Lengths are in m, angles in degrees. Inner and outer surface are spheroids of one centre, as far apart at the pole as at
    the equator. Physical groups: solid "solid", and "rod" if there is one; faces "cavity", "outer", "neck" (its outside),
    "support" (the neck's end, z = 0) and "rod_end". Without a neck the point "support" is its lower pole, held along z.
    """

    radius: float = length_field(0.015, "inner radius at the equator")
    polar_radius: float = length_field(0.0, "inner radius along the axis; 0 makes a sphere", zero=True)
    wall: float = length_field(0.001, "thickness of the wall")
    neck_radius: float = length_field(0.004, "inner radius of the neck; 0 for a closed balloon without one", zero=True)
    neck_length: float = length_field(0.005, "length of the neck below the balloon", unless=("neck_radius", 0.0))
    neck_wall: float = length_field(
        0.0, "thickness of the neck's wall; 0 for that of the balloon", zero=True, unless=("neck_radius", 0.0)
    )
    fillet: float = length_field(
        0.001, "radius of the rounding outside between neck and balloon; 0 for none", zero=True,
        unless=("neck_radius", 0.0),
    )  # fmt: skip
    held: str = choice_field("end", ("end", "outside"), "the neck's end is held, or its outside too, as tied to a tube")
    rod_radius: float = length_field(
        0.0,
        "radius of a rod along the axis, bonded to the far pole; 0 for none",
        zero=True,
        unless=("neck_radius", 0.0),
    )
    cell_size: float = length_field(0.001, "edge length of the cells along the wall", shape=False)
    through: float = through_field()
    section: str = section_field()
    angle: float = wedge_field()

    stem: ClassVar = "balloon"
    unbonded: ClassVar = ()
    pressures: ClassVar = "0:20"
    stiffer: ClassVar = "a thicker wall (--wall), a smaller balloon (--radius)"
    examples: ClassVar = (
        "--radius 20mm --polar-radius 30mm --wall 1.5mm",
        "--neck-radius 0mm",
        "--rod-radius 2mm",
    )

    def check(self) -> None:
        check_balloon(self)

    @property
    def meridian(self) -> Meridian:
        """Its dimensions and the corners of its half section."""
        return Meridian.of(self)

    @property
    def panels(self) -> tuple[Panel, ...]:
        return balloon_panels(self)

    @property
    def thinnest(self) -> float:
        return min(self.wall, self.neck_wall or self.wall)

    @property
    def size(self) -> float:
        return self.radius

    @property
    def clearances(self) -> dict[str, float]:
        if not self.neck_radius:
            return {"wall": self.wall}
        return {
            "wall": self.wall, "neck's wall": self.neck_wall or self.wall,
            "air in the neck": self.neck_radius - self.rod_radius, "neck's length": self.neck_length,
        }  # fmt: skip

    @property
    def faces(self) -> tuple[str, ...]:  # type: ignore[override]
        """Faces outside, from the top."""
        return ("outer", "neck") if self.neck_radius else ("outer",)

    @property
    def seen(self) -> tuple[str, ...]:  # type: ignore[override]
        return self.faces

    @property
    def holds(self) -> tuple[Hold, ...]:
        if not self.neck_radius:
            return (Hold("support", self.lift, point=True), *self.axis_holds)
        outside = (Hold("neck", None),) if self.held == "outside" else ()
        rod = (Hold("rod_end", None),) if self.rod_radius else ()
        return (Hold("support", None), *outside, *rod, *self.axis_holds)

    @property
    def anchors(self) -> Mapping[str, Place]:
        return {} if self.neck_radius else {"support": (0.0, 0.0)}

    @property
    def probes(self) -> Mapping[str, Vector]:
        meridian = self.meridian
        c, (A, C), z = meridian.inner[1], meridian.outer, meridian.height
        return {"apex": (0.0, 0.0, z + C), "ceiling": (0.0, 0.0, z + c), "equator": (A, 0.0, z)}

    figure_texts: ClassVar = {
        "width_mm": ("width", "diameter of the outer surface at the undeformed equator, deformed")
    }

    def device_figures(self, places: Mapping[str, Vector]) -> dict[str, float]:
        x, y, _ = places["equator"]
        return {"width_mm": 2e3 * float((x * x + y * y) ** 0.5)}
