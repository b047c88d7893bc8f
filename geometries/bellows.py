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
from collections.abc import Mapping
from typing import ClassVar

from geometries.actuator import Hold, Vector
from geometries.bellows_checks import check_bellows
from geometries.bellows_panels import NEAR, bellows_panels, lines
from geometries.fields import choice_field, length_field
from geometries.held_tip import HeldTip, tip_field
from geometries.panels import Panel
from geometries.registry import register
from geometries.revolved import Revolved, section_field, through_field, wedge_field


@register
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
        """Of the whole device in m."""
        return self.convolutions * self.pitch + 2.0 * self.cap

    @property
    def bend(self) -> float:
        """Radius in m of roots and crests, in the middle of the wall."""
        return self.rounding or 0.25 * self.pitch

    @property
    def holds(self) -> tuple[Hold, ...]:
        return (*super().holds, *self.axis_holds)

    @property
    def movable(self) -> tuple[str, ...]:
        """All lengths but those with which a line between two arcs would come, where they meet: no mesh follows that."""
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
