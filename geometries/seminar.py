"""The seminar actuator: a triangular slab of silicone with a fan of air channels that bends it out of its plane.

Seen from above, x from the clamped base to the tip, the mirror plane y = 0 in the middle::

    y
    |\\___
    |    \\___  channels, widening
    |  \\  /  \\___  towards the sides
    |   )-----     \\___
    |   )-----------   ) tip
    |   )-----      ___/
    |  /  \\  ___/
    |    ___/
    |___/  the manifold is the arc
    0________________________ x

The manifold is an arc around the base's centre; from it the channels run straight out. All lie in one plane, off the
middle of the thickness by `offset`: pressure pulls the slab long off its middle, so it bends away from the channels' side, the
thin one. The fan is symmetric about y = 0; with the lists (`bores` and the like) every channel has values of its own. The
supply hose is not modelled: the cavity is closed.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from geometries.actuator import Vector
from geometries.fields import angle_field, angles_field, choice_field, length_field, lengths_field, number_field
from geometries.halved import MirroredHalf, part_field
from geometries.held_tip import HeldTip, tip_field
from geometries.mirroring import Mirror
from geometries.parting import Parting
from geometries.registry import register
from geometries.seminar_cells import expected_cells
from geometries.seminar_checks import check_seminar
from geometries.seminar_plan import outline_area


@register
@dataclasses.dataclass(frozen=True, kw_only=True)
class SeminarActuator(MirroredHalf, HeldTip):
    """A triangular slab with a network of air channels that bends out of its plane.

    Lengths are in m, angles in degrees. The slab lies between z = -thickness/2 and thickness/2. Physical groups: volume
    "solid"; surfaces "cavity" (all channel walls), "support" (the base, x = 0, clamped), "top" and "bottom" (the faces
    at z = +- thickness/2), "tip" (the rounding, if there is one), "outer" (the sides) and, of a half, "plane0" (y = 0).
    """

    length: float = length_field(0.070, "length from the clamped base to the tip")
    base_width: float = length_field(0.060, "width at the base")
    thickness: float = length_field(0.008, "thickness of the slab")
    tip_radius: float = length_field(0.004, "radius of the rounding at the tip, seen from above; 0 for none", zero=True)
    channels: int = choice_field(5, tuple(range(1, 31)), "number of channels")
    spread: float = angle_field(
        100.0, "angle between the outermost channels, which is that of the manifold's arc", instead="angles"
    )
    manifold_radius: float = length_field(0.012, "radius of the manifold's arc around the middle of the base")
    manifold_bore: float = length_field(0.0009, "radius of the manifold's round section")
    channel_bore: float = length_field(0.0007, "radius of a channel's section at the manifold", instead="bores")
    end_bore: float = length_field(
        0.0010, "radius of a channel's section at its end, which is round", instead="end_bores"
    )
    fillet: float = length_field(
        0.0004, "radius of the rounding where a channel leaves the manifold; 0 for a sharp crease", zero=True
    )
    offset: float = length_field(
        -0.001, "height of the channels' plane above the middle of the thickness", zero=True, signed=True
    )
    edge: float = length_field(0.004, "solid between the channels' ends and the slab's sides", instead="reaches")
    bores: tuple[float, ...] = lengths_field(
        "each channel's own channel_bore, from the middle outwards: one value for two channels alike on both sides"
    )
    middle_bores: tuple[float, ...] = lengths_field(
        "radius of each channel half way between its two ends, from the middle outwards; straight from end to end if none"
    )
    end_bores: tuple[float, ...] = lengths_field("each channel's own end_bore, from the middle outwards")
    angles: tuple[float, ...] = angles_field(
        "each channel's direction from the middle, rising; 0 deg first for an odd number; in place of spread"
    )
    reaches: tuple[float, ...] = lengths_field(
        "how far from the middle of the base each channel ends, from the middle outwards; in place of edge"
    )
    least_wall: float = length_field(
        0.0005, "thinnest solid allowed between channels and faces, and between channels", shape=False
    )
    cell_size: float = length_field(0.005, "edge length of the cells far from the channels", shape=False)
    around: float = number_field(10.0, "cells around a channel's section", shape=False)
    order: int = choice_field(2, (1, 2), "order of the cells' geometry: 1 straight, 2 curved edges")
    part: str = part_field("slab")
    tip: str = tip_field(held="its rounding")

    stem: ClassVar = "seminar"
    pressures: ClassVar = "0:177"
    silicone: ClassVar = "ecoflex-00-30"
    faces: ClassVar = ("top", "bottom")
    unbonded: ClassVar = ("outer", "tip")
    stiffer: ClassVar = "narrower channels (--end-bore, --manifold-bore), a thicker slab (--thickness)"
    examples: ClassVar = (
        "--channels 7 --spread 120deg",
        "--offset=-1.2mm --end-bore 1mm",
        "--angles 0deg,20deg,50deg --end-bores 1.3mm,1mm,0.8mm",
        "--part full --cell-size 4mm",
    )

    def check(self) -> None:
        check_seminar(self)

    @property
    def mesh_order(self) -> int:
        return self.order

    @property
    def expected_cells(self) -> float:
        return expected_cells(self)

    @property
    def size(self) -> float:
        return self.thickness

    @property
    def level(self) -> bool:
        """Whether the channels lie in the middle of the thickness, so that the slab is symmetric about z = 0."""
        return self.offset == 0.0

    @property
    def mirrors(self) -> tuple[Mirror, ...]:
        # Mirrored cells, not only shapes: nothing of the mesh then bends what symmetry keeps straight.
        level = (Mirror("middle", 2, {"top": "bottom"}),) if self.level else ()
        return (*level, *super().mirrors)

    @property
    def probes(self) -> dict[str, Vector]:
        half = 0.5 * self.thickness
        return {"tip": (self.length, 0.0, half), "tip_below": (self.length, 0.0, -half)}

    @property
    def pushed(self) -> str | None:
        return super().pushed if self.tip_radius > 0.0 else None

    figure_texts: ClassVar[Mapping[str, tuple[str, str]]] = {
        "tip_x_mm": ("tip place x", "x of the middle of the tip's edge, deformed, from the clamped base"),
        "tip_z_mm": (
            "tip place z",
            "z of the middle of the tip's edge, deformed, from the middle of the thickness; the rise is of its upper edge",
        ),
        "lift_angle_deg": (
            "lift angle", "of the line from the middle of the clamped base to the middle of the tip's edge",
        ),
        "curvature_per_m": (
            "curvature", "of the circle that leaves the base along x and passes through the tip",
        ),
    }  # fmt: skip

    def device_figures(self, places: Mapping[str, Vector]) -> dict[str, float]:
        """How the slab is bent, from where its tip is; see `Actuator.device_figures`.

        The tip is the middle of its edge. ``lift_angle_deg`` is the angle of the line from the base's middle to it,
        ``curvature_per_m`` (1/m) that of the circle through it which leaves the base along x.
        """
        x, _, z = 0.5 * (np.asarray(places["tip"]) + np.asarray(places["tip_below"]))
        return {
            "tip_x_mm": x * 1e3,
            "tip_z_mm": z * 1e3,
            "lift_angle_deg": math.degrees(math.atan2(z, x)),
            "curvature_per_m": 2.0 * z / (x * x + z * z),
        }

    @property
    def cavity_volume(self) -> float:
        return 2.0 * outline_area(self) * self.thickness - self.solid_volume

    @property
    def solid_volume(self) -> float:
        """Volume in m3 of the whole slab without its channels, measured by the CAD kernel."""
        from geometries.seminar_shape import measured_volume

        return 2.0 * measured_volume(self)

    @property
    def movable(self) -> tuple[str, ...]:
        from geometries.seminar_carry import movable

        return movable(self)

    def carried(self, other: Self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Where points on the boundary lie on another slab, to rounding on all of it; see `Actuator.carried`.

        Roundings of the network's creases are followed too, and the two slabs may give their channels by lists or in common.
        """
        from geometries.seminar_carry import carried

        return carried(self, other, points)

    @property
    def clearances(self) -> dict[str, float]:
        from geometries.seminar_clearances import clearances

        return clearances(self)

    def on_profile(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Tell which points lie on the top face's line in the mirror plane, from the base to the tip."""
        points = np.asarray(points, dtype=float)
        near = 1e-9 * self.length
        return (np.abs(points[:, 2] - 0.5 * self.thickness) < near) & (np.abs(points[:, 1]) < near)

    @property
    def parting(self) -> Parting:
        return Parting(
            self.lift, self.offset, ((0.0, 0.0, self.offset), (self.manifold_radius, 0.0, self.offset)),
            "Every channel's section is round about this plane, so that each layer has open grooves that hold nothing back.",
        )  # fmt: skip

    def build_whole(self) -> None:
        from geometries.seminar_shape import build_both_halves

        build_both_halves(self)

    def build(self) -> None:
        from geometries.seminar_shape import build_slab

        build_slab(self)
