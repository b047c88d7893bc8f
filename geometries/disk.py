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
import functools
import math
from collections.abc import Callable, Mapping
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from geometries import actuator, meshing, registry, revolved
from geometries.actuator import CutPlane, Hold, Vector
from softmodels.common import schema
from softmodels.common.arrays import Array
from softmodels.common.errors import GeometryError
from softmodels.common.lazy import gmsh, scipy


@registry.register_device
@dataclasses.dataclass(frozen=True, kw_only=True)
class HollowDisk(actuator.Wedged):
    """A hollow disk, as a wedge of any angle that divides the circle or as an axisymmetric profile.

    Lengths are in m, angles in degrees. Physical groups of a wedge: volume "solid"; surfaces "cavity", "top", "outer" and,
    below 360 degrees, "plane0" (at the azimuth) and "plane1" (at azimuth + angle). With ``support="base"`` the bottom
    is the surface "support"; with ``support="rim"`` it belongs to "outer", and its outer edge is the curve "support".
    Half and full disks on a rim add the points "anchor0" (bottom centre) and "anchor1" (full disk: on the rim, at the
    azimuth). The axisymmetric profile has the surface "solid", the curves "cavity", "top", "outer", "axis" and the curve
    (base) or point (rim) "support"; angle and azimuth have no effect on it.
    """

    cavity_radius: float = schema.length_field(0.010, "radius of the cavity")
    membrane: float = schema.length_field(0.006, "thickness of the membrane above the cavity")
    base: float = schema.length_field(0.006, "thickness of the solid below the cavity")
    wall: float = schema.length_field(0.010, "thickness of the solid around the cavity")
    cavity_height: float = schema.length_field(0.004, "height of the cavity")
    fillet: float = schema.length_field(0.001, "radius of the rounding at the membrane's root; 0 for none", zero=True)
    base_fillet: float = schema.length_field(
        0.001, "radius of the rounding at the edge of the cavity's floor; 0 for none", zero=True
    )
    profile: tuple[float, ...] = schema.list_field(
        (),
        "thickness of the membrane at equally spaced radii from the axis to the cavity's edge, in shares of membrane; a smooth "
        "top face passes through them, the ceiling stays flat; uniform if not given",
        numbers=True,
    )
    cell_size: float = schema.length_field(0.003, "edge length of the cells far from the membrane's root", shape=False)
    refinement: float = schema.number_field(2.0, "how many times smaller the cells at the membrane's root are", shape=False)
    order: int = schema.choice_field(2, (1, 2), "order of the cells' geometry: 1 straight, 2 curved edges")
    section: str = schema.choice_field("wedge", ("wedge", "axisymmetric"), "solid slice, or profile in radius and height")
    angle: float = schema.angle_field(
        45.0,
        "angle of the wedge; divides 360 deg evenly (180 half, 360 full disk)",
        unless=("section", "axisymmetric"),
        shape=False,
    )
    azimuth: float = schema.angle_field(
        0.0, "where the wedge begins, counted from the x axis", unless=("section", "axisymmetric"), shape=False
    )
    support: str = schema.choice_field("rim", ("rim", "base"), "bottom outer edge held along z, or whole bottom held")

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

    most_cells: ClassVar = 5_000_000

    def check(self) -> None:
        self._check_profile()
        for fillet in ("fillet", "base_fillet"):
            self.check_below(fillet, "cavity_height")
            self.check_below(fillet, "cavity_radius")
        if self.fillet + self.base_fillet >= self.cavity_height:
            self.reject("fillet", f"with {self.given('base_fillet')} it leaves nothing of {self.told('cavity_height')}")
        thinnest, thickest = self.membrane_top.extremes
        for part, length in {"membrane": thickest, "base": self.base, "cavity_height": self.cavity_height}.items():
            if length > 5.0 * self.outer_radius:
                raise GeometryError(
                    f"{part} is {schema.shown(length, 'm')}; more than 5 times the disk's radius, "
                    f"{schema.shown(self.outer_radius, 'm')}, is not a disk and suggests a wrong unit"
                )
        self.check_size("wall", self.outer_radius, given=f"with {self.given('cavity_radius')} ")
        self.check_angle()
        if self.dimension == 3 and abs(self.azimuth) > 360.0:
            self.reject("azimuth", "it must be between -360 and 360 deg")
        if self.refinement < 1.0:
            self.reject("refinement", "it must be 1 (none) or more")
        self.check_most("cell_size", 1.0, "cavity_radius")
        for part, length in {"membrane": thinnest, "base": self.base, "wall": self.wall}.items():
            if self.cell_size > actuator.MAX_CELL_SIZE_RATIO * length:
                self.reject(
                    "cell_size",
                    f"it must be at most {actuator.MAX_CELL_SIZE_RATIO:g} times {part}, {schema.shown(length, 'm')}",
                )
        self.check_count(f" with refinement {self.refinement:g} and {self.given('fillet')}")

    def _check_profile(self) -> None:
        if self.profile and not MIN_PROFILE_ENTRIES <= len(self.profile) <= MAX_PROFILE_ENTRIES:
            raise GeometryError(
                f"profile has {len(self.profile)} {'entry' if len(self.profile) == 1 else 'entries'}; it takes "
                f"{MIN_PROFILE_ENTRIES} to {MAX_PROFILE_ENTRIES} from the axis to the cavity's edge, or none: a uniform one"
            )
        for k, share in enumerate(self.profile, 1):
            if not LEAST_SHARE * (1 - schema.BOUND_TOLERANCE) <= share <= LARGEST_SHARE * (1 + schema.BOUND_TOLERANCE):
                limits = f"it must be between {LEAST_SHARE:g} and {LARGEST_SHARE:g} times membrane"
                raise GeometryError(f"profile[{k}] is {share:g}; {limits}")
        thinnest, _ = self.membrane_top.extremes
        if thinnest < schema.MIN_LENGTH * (1 - schema.BOUND_TOLERANCE):
            listed = ", ".join(f"{share:g}" for share in self.profile)
            raise GeometryError(
                f"profile is {listed}; the smooth line through them leaves a membrane of "
                f"{schema.shown(max(thinnest, 0.0), 'm')} at "
                f"its thinnest; the minimum is {schema.shown(schema.MIN_LENGTH, 'm')}, so let neighbours differ less"
            )

    @property
    def expected_cells(self) -> float:
        radius, outer, solid, far = self.cavity_radius, self.outer_radius, self.dimension == 3, self.cell_size
        if self.profile:
            radii, sizes = membrane_sizes(self)
            around = 2.0 * math.pi * radii if solid else 1.0
            membrane = float(np.trapezoid(around * self.membrane_top.thickness(radii) / sizes**self.dimension, radii))
        else:
            space = math.pi * radius**2 if solid else radius
            membrane = space * self.membrane / part_size(self, "membrane") ** self.dimension
        upper = self.height - self.base
        parts = {"base": math.pi * outer**2 * self.base, "wall": math.pi * (outer**2 - radius**2) * upper}
        parts = parts if solid else {"base": outer * self.base, "wall": self.wall * upper}
        bulk = membrane + sum(size / part_size(self, part) ** self.dimension for part, size in parts.items())
        # Three quarters of a disk around each root, then rings of growing cells.
        if not solid:
            rings = (
                0.5 * (core / cell) ** 2 + math.log(max(far / cell, 1.0)) / CELL_SIZE_GROWTH**2 for _, cell, core in roots(self)
            )
            return (1.5 * math.pi * sum(rings) + bulk) / revolved.TRIANGLE_AREA
        rings = (0.5 * core**2 / cell**3 + 0.5 / (CELL_SIZE_GROWTH**2 * cell) for _, cell, core in roots(self))
        return self.angle / 360.0 * (bulk + 2.0 * math.pi * radius * 1.5 * math.pi * sum(rings)) / revolved.TETRAHEDRON_VOLUME

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
        """Height of the disk in m at its rim; only with a `profile` does the membrane's top differ."""
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
        rounded = sum(revolved.rounded_off(self.cavity_radius, fillet) for fillet in (self.fillet, self.base_fillet))
        return math.pi * (self.cavity_radius**2 * self.cavity_height - rounded)

    @property
    def solid_volume(self) -> float:
        uniform = math.pi * self.outer_radius**2 * self.height - self.cavity_volume
        if not self.profile:
            return uniform
        edge = self.height - self.ceiling
        return uniform + self.membrane_top.volume - math.pi * self.cavity_radius**2 * edge

    def on_profile(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Report which points lie on the top face's line from the axis along the slice's beginning.

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

    def carried(self, other: Self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the points of the boundary at the same share of the same edge of the other's outline; see
        `Actuator.carried`."""
        flat = self.dimension == 2
        revolved.check_alike(
            self, other, ("section", *(() if flat else ("angle", "azimuth")), "support"), ("fillet", "base_fillet")
        )
        if len(self.profile) != len(other.profile):
            raise GeometryError(
                f"profile has {len(self.profile)} and {len(other.profile)} entries; points can only be mapped between equal "
                "numbers"
            )
        return revolved.carried_along(outline(self), outline(other), points, self.outer_radius)

    @property
    def clearances(self) -> dict[str, float]:
        """See `Actuator.clearances`.

        A membrane with a profile has one at each entry and three between neighbours, where the smooth line may dip. Where they
        are a fifth of the membrane or more, none of thousands of random profiles dipped to zero anywhere.
        """
        return {
            "base": self.base, "wall": self.wall, "height of the cavity": self.cavity_height,
            **self._membrane_clearances,
            "straight part of the cavity's side": self.cavity_height - self.fillet - self.base_fillet,
            "flat part of the cavity's ceiling": self.cavity_radius - self.fillet,
            "flat part of the cavity's floor": self.cavity_radius - self.base_fillet,
        }  # fmt: skip

    @property
    def _membrane_clearances(self) -> dict[str, float]:
        if not self.profile:
            return {"membrane": self.membrane}
        gaps = len(self.profile) - 1
        thickness = self.membrane_top.thickness(self.cavity_radius * np.linspace(0.0, 1.0, len(ENTRY_PLACES) * gaps + 1))
        at = {f"membrane at entry {k} of profile": len(ENTRY_PLACES) * (k - 1) for k in range(1, gaps + 2)}
        at |= {
            f"membrane {part} from entry {k} to entry {k + 1} of profile": len(ENTRY_PLACES) * (k - 1) + place
            for k in range(1, gaps + 1)
            for place, part in enumerate(ENTRY_PLACES[1:], 1)
        }
        return {name: float(thickness[place]) for name, place in at.items()}

    variable: ClassVar[tuple[str, ...]] = ("membrane",)

    @property
    def recipe(self) -> actuator.Recipe:
        # As low as the cavity's wall is upright, so that neither half holds its core.
        level = self.base + self.base_fillet
        return actuator.in_halves(
            self.lift, level,
            "The bond is at the cavity's floor, far from the membrane's root, where the silicone is stretched most.",
            ((0.0, 0.0, 0.0), (0.0, 0.0, self.base)),
        )  # fmt: skip

    def build_whole(self) -> None:
        revolved.turn_fully(_drawing(self, (meshing.MM_PER_M, 0.0, 0.0), (0.0, 0.0, meshing.MM_PER_M))[1])

    def build(self) -> None:
        build_profile(self) if self.dimension == 2 else build_wedge(self)


def _radial(degrees: float) -> Vector:
    """Return the horizontal unit vector at an angle, free of rounding at multiples of 90 degrees."""
    quarters, rest = divmod(degrees, 90.0)
    x, y = math.cos(math.radians(rest)), math.sin(math.radians(rest))
    for _ in range(int(quarters) % 4):
        x, y = -y, x
    return (x + 0.0, y + 0.0, 0.0)


# ----------------------------------------------------------------------------------------------------------------------
# How large the cells of a hollow disk are, and how many of them to expect.
#
# Three rules give the size at a point: never above the disk's cell size; two cells or more through the membrane, the base
# and the wall, however large the cell size; smaller at the membrane's root and along fillets, where the stress
# peaks. Away from a thin part or a root the size grows linearly with distance, so neighbours stay alike.


CELLS_THROUGH_WALL = 2

CELL_SIZE_GROWTH = 0.5

ALONG_ARC = 2
"""Cells along the fillet's quarter circle; two curved ones follow it within a thousandth of its radius."""

MAX_TURN_PER_CELL = 1.0
"""Angle in radians by which a curved top may turn along a cell's edge, or `MAX_CELLS_PER_ENTRY`."""

MAX_CELLS_PER_ENTRY = 3
"""Most edges between two entries of a profile that the top's curvature asks for."""

SIZE_SAMPLES = 257
"""Radii at which the size in a membrane of varying thickness is known; straight lines between them."""


def part_size(disk: HollowDisk, part: str) -> float:
    """Return the cell size in m inside "membrane" (at its root), "base" or "wall"."""
    thickness: float = disk.height - disk.ceiling if part == "membrane" and disk.profile else getattr(disk, part)
    return min(disk.cell_size, thickness / CELLS_THROUGH_WALL)


def membrane_sizes(disk: HollowDisk) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return radii from the axis to the cavity's edge and the cell size in the membrane there, in m.

    There are `CELLS_THROUGH_WALL` cells through it, none longer than the distance of profile entries or turning by more than
    `MAX_TURN_PER_CELL`, and the size grows no faster than `CELL_SIZE_GROWTH` along the radius.
    """
    radii = np.linspace(0.0, disk.cavity_radius, SIZE_SAMPLES)
    apart = disk.cavity_radius / max(len(disk.profile) - 1, 1)
    longest = min(disk.cell_size, apart)
    top = disk.membrane_top
    turning = np.clip(
        MAX_TURN_PER_CELL / np.maximum(top.curvature(radii), MAX_TURN_PER_CELL / longest),
        min(apart / MAX_CELLS_PER_ENTRY, longest),
        None,
    )
    sizes = np.minimum(turning, top.thickness(radii) / CELLS_THROUGH_WALL)
    return radii, (sizes + CELL_SIZE_GROWTH * np.abs(radii[:, None] - radii)).min(axis=1)


def roots(disk: HollowDisk) -> list[tuple[float, float, float]]:
    """Return the places with small cells as (height, cell size, distance within which cells have that size), in m.

    They are rings at the cavity's radius: the membrane's root, and the edge of the floor if it is rounded.
    """
    size = min(disk.cell_size / disk.refinement, part_size(disk, "membrane"), part_size(disk, "wall"))
    upper = min(size, _arc_size(disk.fillet)) if disk.fillet > 0.0 else size
    roots = [(disk.ceiling, upper, disk.fillet + upper)]
    if disk.base_fillet > 0.0:
        lower = min(disk.cell_size, part_size(disk, "wall"), _arc_size(disk.base_fillet))
        roots.append((disk.base, lower, disk.base_fillet + lower))
    return roots


def _arc_size(fillet: float) -> float:
    return 0.5 * math.pi * fillet / ALONG_ARC


def size_function(disk: HollowDisk) -> Callable[[float, float], float]:
    """Return the cell size in m as a function of radius and height in m."""
    radius, floor, ceiling, far = disk.cavity_radius, disk.base, disk.ceiling, disk.cell_size
    root, base, wall = (part_size(disk, part) for part in ("membrane", "base", "wall"))
    rings = roots(disk)
    radii, sizes = membrane_sizes(disk)

    def size(r: float, z: float) -> float:
        membrane = float(np.interp(r, radii, sizes)) if disk.profile else root
        return min(
            far,
            membrane + CELL_SIZE_GROWTH * max(0.0, ceiling - z, r - radius),
            base + CELL_SIZE_GROWTH * max(0.0, z - floor),
            wall + CELL_SIZE_GROWTH * max(0.0, radius - r, floor - z),
            *(cell + CELL_SIZE_GROWTH * max(0.0, math.hypot(r - radius, z - height) - core) for height, cell, core in rings),
        )

    return size


# ----------------------------------------------------------------------------------------------------------------------
# A membrane whose thickness varies along the radius: one cubic spline from the axis to the cavity's edge.
#
# Its values are given at equally spaced radii, in shares of the disk's `membrane`; its slope is zero on the axis, where the top
# would have a tip, and at the cavity's edge, beyond which the thickness stays. The spline is linear in its values.


@functools.lru_cache(maxsize=256)
def _spline(shares: tuple[float, ...]) -> scipy.interpolate.PPoly:
    """Return the shares of the thickness over shares of the radius, from 0 to 1."""
    return scipy.interpolate.CubicSpline(np.linspace(0.0, 1.0, len(shares)), shares, bc_type="clamped")


@dataclasses.dataclass(frozen=True)
class MembraneTop:
    """The top face of a membrane over a flat ceiling, as height over radius in m, up to the cavity's radius, where the spline
    ends. The shares of the membrane's thickness are at equally spaced radii from the axis to there; one for a flat top."""

    radius: float
    ceiling: float
    membrane: float
    shares: tuple[float, ...]

    def thickness(self, radii: ArrayLike) -> Array:
        """Return the thickness in m at radii in m; beyond the cavity's edge that of the edge."""
        within = np.clip(np.abs(radii) / self.radius, 0.0, 1.0)
        if len(self.shares) == 1:
            return np.full_like(within, self.membrane * self.shares[0])
        return np.asarray(self.membrane * _spline(self.shares)(within))

    def height(self, radii: ArrayLike) -> Array:
        """Return the height of the top face in m at radii in m."""
        return self.ceiling + self.thickness(radii)

    def curvature(self, radii: ArrayLike) -> Array:
        """Return the curvature in 1/m of the top's line at radii in m up to the cavity's edge, either way counted positive."""
        within = np.asarray(radii) / self.radius
        if len(self.shares) == 1:
            return np.zeros_like(within)
        slope, bend = (self.membrane * _spline(self.shares)(within, k) / self.radius**k for k in (1, 2))
        return np.asarray(np.abs(bend) / (1.0 + slope**2) ** 1.5)

    @property
    def extremes(self) -> tuple[float, float]:
        """Smallest and largest thickness in m, between the given radii too."""
        if len(self.shares) == 1:
            return self.membrane * self.shares[0], self.membrane * self.shares[0]
        turns = _spline(self.shares).derivative().roots(extrapolate=False)
        values = [*self.shares, *_spline(self.shares)(turns[np.isfinite(turns)])]
        return self.membrane * float(min(values)), self.membrane * float(max(values))

    @property
    def volume(self) -> float:
        """Volume in m3 of the membrane above the cavity, turned around the axis: 2 pi times the integral of t r dr."""
        if len(self.shares) == 1:
            return math.pi * self.radius**2 * self.membrane * self.shares[0]
        spline = _spline(self.shares)
        total = 0.0
        for start, width, cubic in zip(spline.x[:-1], np.diff(spline.x), spline.c.T, strict=True):
            # cubic[k] belongs to (s - start)^(3 - k).
            powers = 3 - np.arange(4)
            total += float(np.sum(cubic * width ** (powers + 1) * (start / (powers + 1) + width / (powers + 2))))
        return 2.0 * math.pi * self.radius**2 * self.membrane * total

    def pieces(self) -> list[Array]:
        """Return the same curve as cubic Bezier pieces between the given radii, from the cavity's edge to the axis: control
        points (radius, height) in m of each, shape (4, 2), whose radii are equally spaced. Pieces, because the CAD kernel
        integrates over one polynomial exactly and over a spline of several it does not (0.1 %)."""
        spline = _spline(self.shares)
        shares = scipy.interpolate.BPoly.from_power_basis(scipy.interpolate.PPoly(spline.c, spline.x)).c
        shares[0], shares[-1] = self.shares[:-1], self.shares[1:]  # to the last bit, for neighbours to meet
        radii = self.radius * np.linspace(spline.x[:-1], spline.x[1:], 4)
        points = np.stack([radii, self.ceiling + self.membrane * shares], axis=-1)
        return [points[::-1, k] for k in reversed(range(points.shape[1]))]


# ----------------------------------------------------------------------------------------------------------------------
# The hollow disk's half profile: a closed outline of lines, arcs and the membrane's top.


MIN_PROFILE_ENTRIES, MAX_PROFILE_ENTRIES = 2, 12

LEAST_SHARE, LARGEST_SHARE = 0.1, 10.0
"""Smallest and largest entry of a membrane's profile."""

ENTRY_PLACES = ("", "a quarter of the way", "half way", "three quarters of the way")
"""Of the way from an entry of a membrane's profile to the next, where its thickness is a clearance."""


def outline(disk: HollowDisk) -> list[revolved.Side]:
    """Return the closed half profile in m, counted against the clock from the bottom centre."""
    inner, outer, fillet, lower = disk.cavity_radius, disk.outer_radius, disk.fillet, disk.base_fillet
    floor, ceiling, top, apex = disk.base, disk.ceiling, disk.height, disk.probes["apex"][2]

    def rounded(start: revolved.Place, end: revolved.Place, centre: revolved.Place, radius: float) -> list[revolved.Side]:
        return [revolved.Side(start, end, 1, "cavity", centre, (radius, radius))] if radius else []

    arch = [revolved.Side((outer, top), (inner, top), 1, "top")]
    for points in disk.membrane_top.pieces() if disk.profile else ():
        start, first, second, end = ((float(r), float(z)) for r, z in points)
        arch.append(revolved.Side(start, end, 1, "top", inner=(first, second)))
    return [
        revolved.Side((0.0, 0.0), (outer, 0.0), 1, "support" if disk.support == "base" else "outer"),
        revolved.Side((outer, 0.0), (outer, top), 1, "outer"),
        *(arch if disk.profile else [revolved.Side((outer, top), (0.0, top), 1, "top")]),
        revolved.Side((0.0, apex), (0.0, ceiling), 1, "axis"),
        revolved.Side((0.0, ceiling), (inner - fillet, ceiling), 1, "cavity"),
        *rounded((inner - fillet, ceiling), (inner, ceiling - fillet), (inner - fillet, ceiling - fillet), fillet),
        revolved.Side((inner, ceiling - fillet), (inner, floor + lower), 1, "cavity"),
        *rounded((inner, floor + lower), (inner - lower, floor), (inner - lower, floor + lower), lower),
        revolved.Side((inner - lower, floor), (0.0, floor), 1, "cavity"),
        revolved.Side((0.0, floor), (0.0, 0.0), 1, "axis"),
    ]


# ----------------------------------------------------------------------------------------------------------------------
# The hollow disk in Gmsh: one outline, meshed flat or turned around the axis.


def build_profile(disk: HollowDisk) -> None:
    """Fill the current Gmsh model with the axisymmetric profile: x is the radius, y the height (m)."""
    drawing, face = _drawing(disk, (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    gmsh.model.occ.synchronize()
    meshing.name_group(2, [face], "solid")
    meshing.name_groups(1, drawing.roles)
    if disk.support == "rim":
        meshing.name_group(0, [drawing.points[disk.outer_radius, 0.0]], "support")
    size = size_function(disk)
    gmsh.model.mesh.setSizeCallback(lambda dim, tag, x, y, z, other: size(x, y))


def build_wedge(disk: HollowDisk) -> None:
    """Fill the current Gmsh model with the slice from the azimuth to azimuth + angle (m)."""
    occ = gmsh.model.occ
    _, face = _drawing(disk, disk.radial, disk.lift)
    pieces = math.ceil(disk.angle / revolved.WIDEST_PIECE - 1e-9)
    volumes = []
    for _ in range(pieces):
        turned = occ.revolve([(2, face)], 0, 0, 0, 0, 0, 1, math.radians(disk.angle / pieces))
        face = turned[0][1]
        volumes += [entity for entity in turned if entity[0] == 3]
    if pieces > 1:
        volumes = [entity for entity in occ.fragment(volumes[:1], volumes[1:])[0] if entity[0] == 3]
    occ.synchronize()
    meshing.name_group(3, [tag for _, tag in volumes], "solid")
    edges = outline(disk)
    meshing.name_boundary(lambda tag: revolved.surface_role(disk, tag, edges))
    if disk.support == "rim":
        _name_rim(disk)
    size = size_function(disk)
    gmsh.model.mesh.setSizeCallback(lambda dim, tag, x, y, z, other: size(math.hypot(x, y), z))


def _drawing(disk: HollowDisk, right: Vector, up: Vector) -> tuple[revolved.Drawing, int]:
    """Draw the half profile by vectors of a metre of the radius and of the height; return the drawing and the face's tag."""
    drawing = revolved.Drawing([revolved.Panel("solid", outline(disk))], right, up, circles=True)
    return drawing, drawing.faces["solid"][0]


def _name_rim(disk: HollowDisk) -> None:
    """Name the bottom's outer edge and, where rigid motions remain, the anchors."""
    near = 1e-8 * disk.outer_radius
    rim = []
    for _, tag in gmsh.model.getEntities(1):
        corners = meshing.corners_of(tag, 1)
        radii = np.hypot(corners[:, 0], corners[:, 1])
        if np.abs(corners[:, 2]).max() < near and np.abs(radii - disk.outer_radius).max() < near:
            rim.append(tag)
    meshing.name_group(1, rim, "support")
    places = {"anchor0": np.zeros(3), "anchor1": disk.outer_radius * np.array(disk.radial)}
    for role in {hold.role for hold in disk.holds if hold.point}:
        meshing.name_group(0, meshing.points_at(places[role], near), role)
