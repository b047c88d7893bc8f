"""The hollow disk: a round membrane over a flat cylindrical cavity, cast in one piece.

The half profile, with the axis of symmetry z on the left::

    z
    |______________________   top = base + cavity height + membrane
    |      membrane        |
    |_____________         |
    |   cavity    |  wall  |
    |_____________|        |
    |        base          |
    |______________________|__ r
    0       cavity radius   outer radius = cavity radius + wall

The fillet rounds the membrane's root, the cavity's upper outer corner, and the base fillet the lower one: the stress at a
sharp corner is unbounded, and a finer mesh then only ever shows more of it.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from geometries.actuator import CutPlane, Hold, Vector
from geometries.disk_cells import expected_cells
from geometries.disk_checks import check_disk, clearances
from geometries.disk_outline import carried
from geometries.fields import angle_field, choice_field, length_field, list_field, number_field
from geometries.membrane_profile import MembraneTop
from geometries.parameters import parameter_names
from geometries.parting import Parting
from geometries.registry import register
from geometries.sectioned import Wedged


@register
@dataclasses.dataclass(frozen=True, kw_only=True)
class HollowDisk(Wedged):
    """A hollow disk, as a wedge of any angle that divides the circle or as an axisymmetric profile.

    Lengths are in m, angles in degrees. Physical groups of a wedge: volume "solid"; surfaces "cavity", "top", "outer" and,
    below 360 degrees, "plane0" (at the azimuth) and "plane1" (at azimuth + angle). With ``support="base"`` the bottom
    is the surface "support"; with ``support="rim"`` it belongs to "outer", and its outer edge is the curve "support".
    Half and full disks on a rim add the points "anchor0" (bottom centre) and "anchor1" (full disk: on the rim, at the
    azimuth). The axisymmetric profile has the surface "solid", the curves "cavity", "top", "outer", "axis" and the curve
    (base) or point (rim) "support"; angle and azimuth mean nothing to it.
    """

    cavity_radius: float = length_field(0.010, "radius of the cavity")
    membrane: float = length_field(0.006, "thickness of the membrane above the cavity")
    base: float = length_field(0.006, "thickness of the solid below the cavity")
    wall: float = length_field(0.010, "thickness of the solid around the cavity")
    cavity_height: float = length_field(0.004, "height of the cavity")
    fillet: float = length_field(0.001, "radius of the rounding at the membrane's root; 0 for none", zero=True)
    base_fillet: float = length_field(
        0.001, "radius of the rounding at the edge of the cavity's floor; 0 for none", zero=True
    )
    profile: tuple[float, ...] = list_field(
        (),
        "thickness of the membrane at equally spaced radii from the axis to the cavity's edge, in shares of membrane; a smooth "
        "top face passes through them, the ceiling stays flat; uniform if not given",
        numbers=True,
    )
    cell_size: float = length_field(0.003, "edge length of the cells far from the membrane's root", shape=False)
    refinement: float = number_field(2.0, "how many times smaller the cells at the membrane's root are", shape=False)
    order: int = choice_field(2, (1, 2), "order of the cells' geometry: 1 straight, 2 curved edges")
    section: str = choice_field("wedge", ("wedge", "axisymmetric"), "solid slice, or profile in radius and height")
    angle: float = angle_field(
        45.0,
        "angle of the wedge; divides 360 deg evenly (180 half, 360 full disk)",
        unless=("section", "axisymmetric"),
        shape=False,
    )
    azimuth: float = angle_field(
        0.0, "where the wedge begins, counted from the x axis", unless=("section", "axisymmetric"), shape=False
    )
    support: str = choice_field("rim", ("rim", "base"), "bottom outer edge held along z, or whole bottom held")

    stem: ClassVar = "disk"
    pressures: ClassVar = "0:177"
    axial: ClassVar = True
    faces: ClassVar = ("top",)
    unbonded: ClassVar = ("outer",)
    stiffer: ClassVar = "a thicker membrane (--membrane), a smaller cavity (--cavity-radius)"
    examples: ClassVar = (
        "--variant shadow",
        "--membrane 4mm --cell-size 2mm",
        "--angle 360deg --support base",
        "--section axisymmetric",
    )
    variants: ClassVar = {
        "default": {},
        "shadow": {
            "cavity_radius": 0.020,
            "membrane": 0.002,
            "base": 0.005,
            "wall": 0.005,
            "cavity_height": 0.005,
            "cell_size": 0.002,
        },
    }

    def check(self) -> None:
        check_disk(self)

    @property
    def mesh_order(self) -> int:
        return self.order

    @property
    def expected_cells(self) -> float:
        return expected_cells(self)

    @property
    def size(self) -> float:
        return self.cavity_radius

    @property
    def outer_radius(self) -> float:
        """Radius of the whole disk in m."""
        return self.cavity_radius + self.wall

    @property
    def ceiling(self) -> float:
        """Height of the cavity's ceiling in m, which is the membrane's lower face."""
        return self.base + self.cavity_height

    @property
    def height(self) -> float:
        """Height of the disk in m at its rim; the membrane's top is elsewhere only with a `profile`."""
        return self.ceiling + self.membrane * (self.profile[-1] if self.profile else 1.0)

    @property
    def membrane_top(self) -> MembraneTop:
        """The membrane's top face as height over radius."""
        return MembraneTop(self.cavity_radius, self.ceiling, self.membrane, self.profile or (1.0,))

    @property
    def radial(self) -> Vector:
        """Horizontal unit vector from the axis along the beginning of the slice."""
        return _radial(self.azimuth if self.dimension == 3 else 0.0)

    @property
    def cut_planes(self) -> tuple[CutPlane, ...]:
        if self.dimension == 2 or self.copies == 1:
            return ()
        x0, y0, _ = self.radial
        x1, y1, _ = _radial(self.azimuth + self.angle)
        return (CutPlane("plane0", (y0, -x0, 0.0)), CutPlane("plane1", (-y1, x1, 0.0)))

    @property
    def holds(self) -> tuple[Hold, ...]:
        rim = self.support == "rim"
        support = Hold("support", self.lift, point=self.dimension == 2) if rim else Hold("support", None)
        if self.dimension == 2:
            return (support, *self.axis_holds)
        if not rim or self.copies > 2:
            return (support,)
        # A rim leaves the slide along the one plane of a half disk, and every horizontal motion of a full one.
        x, y, _ = self.radial
        if self.copies == 2:
            return (support, Hold("anchor0", (x, y, 0.0), point=True))
        return (
            support,
            Hold("anchor0", (1.0, 0.0, 0.0), point=True),
            Hold("anchor0", (0.0, 1.0, 0.0), point=True),
            Hold("anchor1", (-y, x, 0.0), point=True),
        )

    @property
    def probes(self) -> dict[str, Vector]:
        apex = self.ceiling + self.membrane * (self.profile[0] if self.profile else 1.0)
        return {"apex": (0.0, 0.0, apex), "ceiling": (0.0, 0.0, self.ceiling)}

    @property
    def cavity_volume(self) -> float:
        rounded = _rounding(self.cavity_radius, self.fillet) + _rounding(self.cavity_radius, self.base_fillet)
        return math.pi * (self.cavity_radius**2 * self.cavity_height - rounded)

    @property
    def solid_volume(self) -> float:
        uniform = math.pi * self.outer_radius**2 * self.height - self.cavity_volume
        if not self.profile:
            return uniform
        edge = self.height - self.ceiling
        return uniform + self.membrane_top.volume - math.pi * self.cavity_radius**2 * edge

    def on_profile(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Tell which points lie on the top face's line from the axis along the slice's beginning.

        The line runs over the membrane and the wall to the outer radius; see `Actuator.on_profile`.
        """
        points = np.asarray(points, dtype=float)
        x, y, _ = self.radial
        near = 1e-9 * self.outer_radius
        along = points[:, 0] * x + points[:, 1] * y
        across = points[:, 1] * x - points[:, 0] * y
        top = self.membrane_top.height(along) if self.profile else self.height
        return (np.abs(points[:, 2] - top) < near) & (np.abs(across) < near) & (along > -near)

    deviations: ClassVar = {
        "offset": "how far the cavity sits too high in a part of the same height: the membrane loses what the base gains"
    }

    def made(self, values: Mapping[str, float]) -> HollowDisk:
        device = super().made({name: value for name, value in values.items() if name != "offset"})
        assert isinstance(device, HollowDisk)
        high = values.get("offset", 0.0)
        left = device.membrane - high
        # The top stays where it is, so every thickness loses the same.
        shares = tuple((share * device.membrane - high) / left for share in device.profile) if left else device.profile
        return dataclasses.replace(device, base=device.base + high, membrane=left, profile=shares)

    @property
    def movable(self) -> tuple[str, ...]:
        return tuple(name for name in parameter_names(self) if getattr(self, name, None) != 0.0)

    def carried(self, other: Self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points of the boundary at the same share of the same edge of the other's outline; see `Actuator.carried`."""
        return carried(self, other, points)

    @property
    def clearances(self) -> dict[str, float]:
        return clearances(self)

    variable: ClassVar[tuple[str, ...]] = ("membrane",)

    def velocity(self, name: str, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Motion of points with the membrane's thickness: all that lies above the cavity's ceiling is stretched upwards."""
        if name not in self.variable:
            return super().velocity(name, points)
        points = np.asarray(points, dtype=float)
        share = np.clip((points[:, 2] - self.ceiling) / self.membrane, 0.0, None)
        return np.column_stack([np.zeros_like(share), np.zeros_like(share), share])

    @property
    def parting(self) -> Parting:
        # As low as the cavity's wall is upright, so that neither half holds its core.
        level = self.base + self.base_fillet
        return Parting(
            self.lift, level, ((0.0, 0.0, 0.0), (0.0, 0.0, self.base)),
            "The bond is at the cavity's floor, far from the membrane's root, where the silicone is stretched most.",
        )  # fmt: skip

    def build_whole(self) -> None:
        from geometries.disk_shape import build_full_turn

        build_full_turn(self)

    def build(self) -> None:
        from geometries.disk_shape import build_profile, build_wedge

        build_profile(self) if self.dimension == 2 else build_wedge(self)


def _rounding(radius: float, fillet: float) -> float:
    """Volume over pi of the solid of revolution between a sharp corner at this radius and the fillet's arc."""
    inner = radius - fillet
    return fillet * (radius**2 - inner**2 - 0.5 * math.pi * fillet * inner - 2.0 / 3.0 * fillet**2)


def _radial(degrees: float) -> Vector:
    """Return the horizontal unit vector at an angle, free of rounding at multiples of 90 degrees."""
    quarters, rest = divmod(degrees, 90.0)
    x, y = math.cos(math.radians(rest)), math.sin(math.radians(rest))
    for _ in range(int(quarters) % 4):
        x, y = -y, x
    return (x + 0.0, y + 0.0, 0.0)
