"""A tube closed by a cap, as fibre-reinforced actuators and McKibben muscles are cast before they are wound.

The half profile, with the axis of symmetry z on the left::

    z
    |______________   height = length + cap
    |     cap      |
    |________      |  length
    |        |     |
    | cavity | wall|
    |        |     |
    |________|_____|__ r
    0  inner radius  outer radius = inner radius + wall

The cavity is open at the bottom, where a fitting closes it. The wall is a straight tube as far as its inner corner is not
rounded; what is above belongs to the cap.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from geometries.actuator import Hold, Vector
from geometries.carrying import carried_along
from geometries.cylinder_checks import check_cylinder, expected_cells
from geometries.cylinder_outline import check_alike, outline
from geometries.fields import angle_field, choice_field, length_field
from geometries.halved import Halved
from geometries.parameters import parameter, parameter_names
from geometries.registry import register
from geometries.sectioned import Sectioned


@register
@dataclasses.dataclass(frozen=True, kw_only=True)
class Cylinder(Sectioned, Halved):
    """A tube closed by a cap: straight as an axisymmetric section, bending as half of it, twisting as the whole.

    Lengths are in m, angles in degrees. Physical groups: cells "wall" (the straight tube) and "cap"; facets "cavity",
    "support" (the bottom ring), "outer" (around the wall), "strip" (the part of it that looks along x, if it has one), "side"
    (around the cap) and "end" (the cap's top); "plane0" (y = 0) in a half, the curve "axis" in a section. Where nothing else
    holds them, a half has the point "anchor0" (on y, at the bottom), the whole also "anchor1" (across) and "anchor2" (on x).
    """

    inner_radius: float = length_field(0.006, "radius of the cavity")
    wall: float = length_field(0.002, "thickness of the wall")
    length: float = length_field(0.060, "length of the cavity, from the base to the cap")
    cap: float = length_field(0.004, "thickness of the cap")
    fillet: float = length_field(0.001, "radius of the rounding where the wall meets the cap; 0 for none", zero=True)
    section: str = choice_field(
        "axisymmetric",
        ("axisymmetric", "half", "whole"),
        "profile in radius and height, solid half (y > 0), or all of it",
    )
    strip: float = angle_field(
        0.0,
        "angle around the axis of the strip along the wall, about the x axis, to which a sheet can be bonded; 0 for none",
        unless=("section", "axisymmetric"),
    )
    base: str = choice_field(
        "held", ("held", "sliding"), "bottom ring clamped, or held along z alone: half of a tube with two caps"
    )
    end: str = choice_field("free", ("free", "sliding", "held"), "cap's top free, held along z alone, or clamped")
    cell_size: float = length_field(0.002, "edge length of the cells", shape=False)
    order: int = choice_field(2, (1, 2), "order of the cells' geometry: 1 straight, 2 curved edges")

    stem: ClassVar = "cylinder"
    unbonded: ClassVar = ()
    axial: ClassVar = True
    regions: ClassVar = ("wall", "cap")
    pressures: ClassVar = "0:60"
    stiffer: ClassVar = "a thicker wall (--wall), a smaller cavity (--inner-radius)"
    examples: ClassVar = ("--wall 3mm --length 80mm", "--variant bending", "--section whole --base sliding")
    variants: ClassVar = {
        "default": {},
        "bending": {"section": "half", "strip": 120.0},
        "twisting": {"section": "whole", "length": 0.040, "cell_size": 0.004},
    }

    def check(self) -> None:
        check_cylinder(self)

    @property
    def faces(self) -> tuple[str, ...]:  # type: ignore[override]
        """See `Actuator.faces`; a sheet around a device without a strip is bonded to all of the wall."""
        return ("outer", "strip", "side", "end") if self.stripped else ("outer", "side", "end")

    @property
    def stripped(self) -> bool:
        """Whether part of the outside is a strip."""
        return self.dimension == 3 and self.strip > 0.0

    @property
    def mesh_order(self) -> int:
        return self.order

    @property
    def expected_cells(self) -> float:
        return expected_cells(self)

    @property
    def halved(self) -> bool:
        return self.section == "half"

    @property
    def fuller(self) -> str:
        return "--section whole"

    @property
    def size(self) -> float:
        return self.inner_radius

    @property
    def outer_radius(self) -> float:
        """Radius of the outside in m."""
        return self.inner_radius + self.wall

    @property
    def straight(self) -> float:
        """Height in m up to which the wall is a straight tube."""
        return self.length - self.fillet

    @property
    def height(self) -> float:
        """Height of the end in m."""
        return self.length + self.cap

    @property
    def holds(self) -> tuple[Hold, ...]:
        held = Hold("support", None if self.base == "held" else self.lift)
        ends = () if self.end == "free" else (Hold("end", None if self.end == "held" else self.lift),)
        if self.dimension == 2:
            return (held, *self.axis_holds, *ends)
        if self.base == "held" or self.end == "held":
            return (held, *ends)
        # What slides still moves as a whole along x, and in the whole tube along y and about z.
        x, y = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
        anchors = {"anchor0": x} if self.section == "half" else {"anchor0": x, "anchor1": x, "anchor2": y}
        return (held, *ends, *(Hold(name, along, point=True) for name, along in anchors.items()))

    @property
    def anchors(self) -> dict[str, Vector]:
        """Where the points of `holds` are, in m."""
        radius = self.outer_radius
        places = {"anchor0": (0.0, radius, 0.0), "anchor1": (0.0, -radius, 0.0), "anchor2": (radius, 0.0, 0.0)}
        return {hold.role: places[hold.role] for hold in self.holds if hold.point}

    @property
    def probes(self) -> dict[str, Vector]:
        radius, middle, height = self.outer_radius, 0.5 * self.length, self.height
        near = {"end": (0.0, 0.0, height), "rim": (radius, 0.0, height), "side": (radius, 0.0, middle)}
        if self.dimension == 2:
            return near
        return {**near, "far_rim": (-radius, 0.0, height), "far_side": (-radius, 0.0, middle)}

    @property
    def blocked(self) -> str | None:
        return None if self.end == "free" else "end"

    @property
    def pushed(self) -> str | None:
        return "end" if self.end == "free" else None

    figure_texts: ClassVar[Mapping[str, tuple[str, str]]] = {
        "elongation_percent": (
            "elongation", "rise of the end's rim over the device's height; the mean of two sides in a solid model",
        ),
        "diameter_mm": ("diameter", "of the outside half way up the cavity"),
        "bend_angle_deg": ("bend", "angle by which the end has turned towards x, in the plane y = 0"),
        "twist_deg": ("twist", "angle by which the end has turned about the axis"),
        "tip_x_mm": ("tip place x", "x of the middle of the end, from the axis as cast"),
    }  # fmt: skip

    def device_figures(self, places: Mapping[str, Vector]) -> dict[str, float]:
        """Elongation and diameter; bend of a half, twist of a whole tube; see `Actuator.device_figures`.

        Angles are known up to half a turn.
        """
        now = {name: np.asarray(place, dtype=float) for name, place in places.items()}
        if self.dimension == 2:
            rise, diameter = now["rim"][2] - self.height, 2.0 * now["side"][0]
            return {"elongation_percent": 100.0 * rise / self.height, "diameter_mm": diameter * 1e3}
        rise = 0.5 * (now["rim"][2] + now["far_rim"][2]) - self.height
        across = now["rim"] - now["far_rim"]
        figures = {
            "elongation_percent": 100.0 * rise / self.height,
            "diameter_mm": float(np.linalg.norm(now["side"] - now["far_side"])) * 1e3,
            "bend_angle_deg": math.degrees(math.atan2(-across[2], across[0])),
        }
        if self.section == "whole":
            figures["twist_deg"] = math.degrees(math.atan2(across[1], across[0]))
        return figures | {"tip_x_mm": now["end"][0] * 1e3}

    @property
    def movable(self) -> tuple[str, ...]:
        return tuple(name for name in parameter_names(self) if name != "strip" and parameter(self, name) != 0.0)

    def carried(self, other: Self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points of the boundary at the same share of the same edge of the other's outline; see `Actuator.carried`."""
        check_alike(self, other)
        return carried_along(outline(self), outline(other), points, self.outer_radius)

    @property
    def clearances(self) -> dict[str, float]:
        flat, upright = self.inner_radius - self.fillet, self.straight
        return {
            "wall": self.wall,
            "cap": self.cap,
            "flat part of the ceiling": flat,
            "straight part of the wall": upright,
        }

    @property
    def cavity_volume(self) -> float:
        # The rounding is the corner's square less a quarter circle, each turned around the axis.
        inner, fillet = self.inner_radius - self.fillet, self.fillet
        rounded = fillet * (self.inner_radius**2 - inner**2 - 0.5 * math.pi * fillet * inner - 2.0 / 3.0 * fillet**2)
        return math.pi * (self.inner_radius**2 * self.length - rounded)

    @property
    def solid_volume(self) -> float:
        return math.pi * self.outer_radius**2 * self.height - self.cavity_volume

    def on_profile(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Tell which points lie on the outline from the base up the side at +x and over the end to the axis."""
        points = np.asarray(points, dtype=float)
        near = 1e-9 * self.height
        x, y, z = points.T
        side, top = np.abs(x - self.outer_radius) < near, np.abs(z - self.height) < near
        return (np.abs(y) < near) & (side | (top & (x > -near)))

    def build(self) -> None:
        from geometries.cylinder_shape import build_section, build_solid

        build_section(self) if self.dimension == 2 else build_solid(self)
