"""A bellows that bends: half-round folds on a flat base, which pressure draws apart while the base keeps its length.

Seen from the side, x from the clamp to the tip, the mirror plane y = 0 cut open::

    z
    |  ____   _     _     _   ____
    |  |  |  / \\   / \\   / \\  |  |    folds: arcs of one wall
    |  |  |_/   \\_/   \\_/   \\_|  |
    |  |root        air       cap|
    |  |_________________________|    z = base / 2, the axis of the folds
    0--|-------------------------|--- x
       |_________________________|    base

Seen along x, wall and air are half rings and half disks on the base. The bellows bends down, towards its base: the rise of its
tip is negative. The supply hose is not modelled: the cavity is closed.
"""

from __future__ import annotations

import dataclasses
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from geometries import bending_bellows_plan as plan
from geometries.actuator import Vector
from geometries.bending import Bending
from geometries.bending_bellows_checks import check_bellows
from geometries.fields import choice_field, length_field
from geometries.halved import MirroredHalf, part_field
from geometries.held_tip import HeldTip, tip_field
from geometries.registry import register


@register
@dataclasses.dataclass(frozen=True, kw_only=True)
class BendingBellows(Bending, MirroredHalf, HeldTip):
    """Half-round folds on a flat base that bend towards the base.

    Lengths are in m. The middle of the base is z = 0, the clamp x = 0. Physical groups: volumes "solid" and "base" (the base
    layer); surfaces "cavity", "support" (the root's end, x = 0, clamped), "tip" (the other end), "folds" (the outside of the
    wavy wall), "bottom" (the base's outside), "outer" (the rest of the outside) and, of a half, "plane0" (y = 0).
    """

    folds: int = choice_field(4, tuple(range(1, 31)), "number of folds")
    pitch: float = length_field(0.008, "length of a fold along the bellows")
    radius: float = length_field(0.006, "radius of the air in the valleys")
    depth: float = length_field(0.0035, "how far the crests stand above the valleys")
    wall: float = length_field(0.0015, "thickness of the wavy wall")
    base: float = length_field(0.003, "thickness of the base layer, a region of its own")
    rim: float = length_field(0.0, "how far the base stands out beyond the crests on each side", zero=True)
    root: float = length_field(0.004, "solid between the clamp and the air")
    cap: float = length_field(0.003, "solid between the air and the tip")
    least_wall: float = length_field(0.0003, "thinnest wall, and thinnest air inside a fold", shape=False)
    cell_size: float = length_field(0.003, "edge length of the cells; smaller ones in narrow folds", shape=False)
    part: str = part_field("bellows")
    tip: str = tip_field()

    stem: ClassVar = "bending-bellows"
    pressures: ClassVar = "0:25"
    silicone: ClassVar = "ecoflex-00-30"
    faces: ClassVar = ("folds", "bottom", "tip", "outer")
    unbonded: ClassVar = ()
    regions: ClassVar = ("base",)
    meeting: ClassVar = ("folds",)
    stiffer: ClassVar = "a thicker wall (--wall), a smaller radius (--radius)"
    examples: ClassVar = ("--folds 6 --depth 4mm", "--radius 8mm --wall 2mm --rim 2mm", "--part full")
    mesh_order: ClassVar = 2

    def check(self) -> None:
        check_bellows(self)

    @property
    def expected_cells(self) -> float:
        return plan.expected_cells(self)

    @property
    def size(self) -> float:
        return self.radius

    @property
    def length(self) -> float:
        """From the clamp to the tip in m."""
        return plan.length(self)

    @property
    def probes(self) -> dict[str, Vector]:
        low, high = -0.5 * self.base, 0.5 * self.base + plan.crest(self)
        return {"tip": (self.length, 0.0, low), "tip_above": (self.length, 0.0, high)}

    @property
    def cavity_volume(self) -> float:
        return plan.cavity_volume(self)

    @property
    def solid_volume(self) -> float:
        return plan.solid_volume(self)

    def on_profile(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Tell which points lie on the base's lower line in the mirror plane, from the clamp to the tip."""
        points, near = np.asarray(points, dtype=float), 1e-9 * self.length
        return (np.abs(points[:, 2] + 0.5 * self.base) < near) & (np.abs(points[:, 1]) < near)

    def build_whole(self) -> None:
        from geometries.bending_bellows_shape import build_whole_bellows

        build_whole_bellows(self)

    def build(self) -> None:
        from geometries.bending_bellows_shape import build_bellows

        build_bellows(self)
