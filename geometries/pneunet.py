"""The PneuNet: a row of air chambers on a base, joined by a channel, that bends towards the base.

Seen from the side, x from the clamp to the tip, the mirror plane y = 0 cut open::

    z   root          gap          cap
    |  _______ _____   _____   _______
    |  |      |     | |     | |      |   top wall
    |  |    __|  _  | |  _  | |  __  |
    |  |    |   | | | | | | | | |  | |   chambers, their walls
    |  |    |   | | |_| | | |_| |  | |
    |  |    |   |  \\bridge/      |  | |
    |  |    |___________________|  | |   channel
    0--|-----------------------------|-- x
       |_____________________________|   base

Chambers grow long, the base does not: the finger bends down, towards its base, and the rise of its tip is negative. With a
thick bridge the gaps are slots, with no gap the chambers share their walls and are divided by ribs. Two sides have one base in
their middle and two cavities. The supply hose is not modelled: the cavity is closed.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from geometries import pneunet_plan as plan
from geometries.actuator import Vector
from geometries.bending import Bending
from geometries.fields import choice_field, length_field, number_field
from geometries.halved import MirroredHalf, part_field
from geometries.held_tip import HeldTip, tip_field
from geometries.mirroring import Mirror
from geometries.parting import Parting
from geometries.pneunet_checks import check_pneunet, walls
from geometries.registry import register


@register
@dataclasses.dataclass(frozen=True, kw_only=True)
class PneuNet(Bending, MirroredHalf, HeldTip):
    """A finger of air chambers on a base that bends towards the base.

    Lengths are in m. The middle of the base is z = 0, the clamp x = 0. Physical groups: volumes "solid", "base" (the base
    layer) and, if there is one, "paper" (a sheet in the middle of the base); surfaces "cavity" (all walls of the air; of two
    sides that above, "cavity2" below), "support" (the root's end, x = 0, clamped), "tip" (the other end), "top" (the chambers'
    outside), "bottom" (the base's outside, or the lower chambers'), "chamber_walls" (the walls in the gaps, which meet as the
    finger bends), "outer" (the sides, and the gaps' floors) and, of a half, "plane0" (y = 0).
    """

    chambers: int = choice_field(4, tuple(range(1, 31)), "number of chambers")
    sides: int = choice_field(1, (1, 2), "chambers above the base, or above and below it")
    chamber_length: float = length_field(0.005, "length of a chamber's air along the finger")
    chamber_width: float = length_field(0.012, "width of a chamber's air")
    chamber_height: float = length_field(0.012, "height of a chamber's air above the base")
    wall: float = length_field(0.001, "thickness of the walls between a chamber and a gap, or of a rib")
    side_wall: float = length_field(0.002, "thickness of the walls at the sides")
    top_wall: float = length_field(0.002, "thickness of the walls above the chambers")
    gap: float = length_field(0.0005, "gap between chambers; 0 for ribs, one wall between two chambers", zero=True)
    bridge: float = length_field(0.002, "solid between the channel and the floor of a gap", unless=("gap", 0.0))
    channel_width: float = length_field(0.004, "width of the channel that joins the chambers")
    channel_height: float = length_field(0.002, "height of the channel above the base")
    base: float = length_field(0.003, "thickness of the base layer, a region of its own")
    paper: float = length_field(
        0.0, "thickness of a sheet in the middle of the base, a region of its own; 0 for none", zero=True
    )
    root: float = length_field(0.004, "solid between the clamp and the first chamber's air")
    cap: float = length_field(0.002, "solid between the last chamber's air and the tip")
    opposite: float = number_field(
        0.0, "pressure in the chambers below the base over that above it", unless=("sides", 1)
    )
    least_wall: float = length_field(0.0003, "thinnest wall, gap and channel allowed", shape=False)
    cell_size: float = length_field(0.003, "edge length of the cells", shape=False)
    part: str = part_field("finger")
    tip: str = tip_field()

    variants: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "default": {},
        "slotted": {"wall": 0.0015, "bridge": 0.006},
        "ribbed": {"gap": 0.0, "wall": 0.002},
        "two-sided": {"sides": 2},
    }
    stem: ClassVar = "pneunet"
    pressures: ClassVar = "0:12"
    silicone: ClassVar = "ecoflex-00-30"
    faces: ClassVar = ("top", "bottom", "tip", "chamber_walls", "outer")
    unbonded: ClassVar = ()
    stiffer: ClassVar = "thicker walls (--wall, --side-wall, --top-wall), narrower chambers (--chamber-width)"
    examples: ClassVar = (
        "--chambers 6 --gap 1mm",
        "--variant slotted --bridge 5mm",
        "--variant ribbed --wall 2.5mm",
        "--base 2mm --paper 0.2mm --part full",
    )
    mesh_order: ClassVar = 2

    def check(self) -> None:
        check_pneunet(self)

    @property
    def regions(self) -> tuple[str, ...]:  # type: ignore[override]
        return ("base", "paper") if self.paper else ("base",)

    @property
    def meeting(self) -> tuple[str, ...]:
        return ("chamber_walls",) if self.gap else ()

    @property
    def expected_cells(self) -> float:
        return plan.expected_cells(self)

    @property
    def size(self) -> float:
        return self.chamber_height

    @property
    def mirrors(self) -> tuple[Mirror, ...]:
        from geometries.pneunet_shape import CENTRAL

        # Mirrored cells, not only shapes: nothing of the mesh then bends what symmetry keeps straight.
        below = (Mirror(CENTRAL, 2, {"top": "bottom", "cavity": "cavity2"}),) if self.sides == 2 else ()
        return (*below, *super().mirrors)

    @property
    def length(self) -> float:
        """From the clamp to the tip in m."""
        return plan.length(self)

    @property
    def height(self) -> float:
        """From the middle of the base to the chambers' outside in m."""
        return plan.top(self)

    @property
    def probes(self) -> dict[str, Vector]:
        low = -plan.top(self) if self.sides == 2 else -0.5 * self.base
        return {"tip": (self.length, 0.0, low), "tip_above": (self.length, 0.0, self.height)}

    @property
    def ratios(self) -> tuple[float, ...]:
        return (1.0,) if self.sides == 1 else (1.0, self.opposite)

    @property
    def cavity_volume(self) -> float:
        """Volume in m3 of the cavity; of two sides, the volume that the pressure works on: each times its ratio."""
        return plan.cavity_volume(self) * sum(self.ratios)

    @property
    def solid_volume(self) -> float:
        return plan.solid_volume(self)

    @property
    def movable(self) -> tuple[str, ...]:
        return tuple(name for name in (*walls(self), *(("paper",) if self.paper else ())))

    def carried(self, other: Self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        return plan.carried(self, other, points)

    @property
    def clearances(self) -> dict[str, float]:
        return {name.replace("_", " "): value for name, value in walls(self).items()}

    def on_profile(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Tell which points lie on the base's lower line in the mirror plane, from the clamp to the tip."""
        points, near = np.asarray(points, dtype=float), 1e-9 * self.length
        return (np.abs(points[:, 2] - self.probes["tip"][2]) < near) & (np.abs(points[:, 1]) < near)

    @property
    def parting(self) -> Parting | None:
        if self.sides == 2:
            return None
        middle = 0.5 * (self.base + self.channel_height)
        return Parting(
            self.lift, 0.5 * self.base, ((0.0, 0.0, middle), (self.root, 0.0, middle)),
            "The chambers and the channel are open towards the base, which is a flat layer bonded below them.",
        )  # fmt: skip

    def build_whole(self) -> None:
        from geometries.pneunet_shape import build_whole_finger

        build_whole_finger(self)

    def build(self) -> None:
        from geometries.pneunet_shape import build_finger

        build_finger(self)
