"""The balloon: a hollow sphere or spheroid on a neck, optionally with a rod through it.

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
made of, or that it is rigid, is set in the case.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import ClassVar, NamedTuple

from geometries import actuator, registry, revolved
from geometries.actuator import Hold, Vector
from geometries.revolved import Revolved
from softmodels.common import schema
from softmodels.common.errors import GeometryError
from softmodels.common.lazy import scipy


@registry.register_device
@dataclasses.dataclass(frozen=True, kw_only=True)
class Balloon(Revolved):
    """A hollow sphere or spheroid with or without a neck, as an axisymmetric profile or a wedge.

    Lengths are in m, angles in degrees. Inner and outer surface are spheroids of one centre, as far apart at the pole as at
    the equator. Physical groups: solid "solid", and "rod" if there is one; faces "cavity", "outer", "neck" (its outside),
    "support" (the neck's end, z = 0) and "rod_end". Without a neck the point "support" is its lower pole, held along z.
    """

    radius: float = schema.length_field(0.015, "inner radius at the equator")
    polar_radius: float = schema.length_field(0.0, "inner radius along the axis; 0 makes a sphere", zero=True)
    wall: float = schema.length_field(0.001, "thickness of the wall")
    neck_radius: float = schema.length_field(0.004, "inner radius of the neck; 0 for a closed balloon without one", zero=True)
    neck_length: float = schema.length_field(0.005, "length of the neck below the balloon", unless=("neck_radius", 0.0))
    neck_wall: float = schema.length_field(
        0.0, "thickness of the neck's wall; 0 for that of the balloon", zero=True, unless=("neck_radius", 0.0)
    )
    fillet: float = schema.length_field(
        0.001, "radius of the rounding outside between neck and balloon; 0 for none", zero=True, unless=("neck_radius", 0.0)
    )
    held: str = schema.choice_field("end", ("end", "outside"), "the neck's end is held, or also its outside, as tied to a tube")
    rod_radius: float = schema.length_field(
        0.0, "radius of a rod along the axis, bonded to the far pole; 0 for none", zero=True, unless=("neck_radius", 0.0)
    )
    cell_size: float = schema.length_field(
        0.001, "edge length of the cells along the wall; smaller where it is thin", shape=False
    )
    through: float = revolved.through_field()
    section: str = revolved.section_field()
    angle: float = revolved.wedge_field()

    stem: ClassVar = "balloon"
    variable: ClassVar = ("wall",)
    loose: ClassVar = ("rod",)
    unbonded: ClassVar = ()
    pressures: ClassVar = "0:20"
    stiffer: ClassVar = "a thicker wall (--wall), a smaller balloon (--radius)"
    examples: ClassVar = ("--radius 20mm --polar-radius 30mm --wall 1.5mm", "--neck-radius 0mm", "--rod-radius 2mm")

    def check(self) -> None:
        polar = self.polar_radius or self.radius
        if not MIN_RADIUS_RATIO <= polar / self.radius <= 1.0 / MIN_RADIUS_RATIO:
            self.reject(
                "polar_radius",
                f"it must be between {MIN_RADIUS_RATIO:g} and {1 / MIN_RADIUS_RATIO:g} times {self.told('radius')}",
            )
        self.check_size("radius", max(self.radius, polar) + self.wall, given="with its wall ")
        self.check_most("wall neck_wall", 1.0, "radius")
        self.check_least("wall neck_wall", 2e-3, "radius")
        if self.neck_radius:
            self._check_neck()
        else:
            self._check_closed()
        self.check_cells("radius", "polar_radius")

    def _check_neck(self) -> None:
        inside, outside = MAX_NECK_RATIO * self.radius, MAX_NECK_RATIO * (self.radius + self.wall)
        if self.neck_radius + (self.neck_wall or self.wall) > outside or self.neck_radius > inside:
            self.reject(
                "neck_radius",
                f"with its wall it must be at most {MAX_NECK_RATIO:g} of the balloon's, {schema.shown(inside, 'm')} inside and "
                f"{schema.shown(outside, 'm')} outside",
            )
        self.check_most("neck_length", 20.0, "radius", "more than {}, suggests a wrong unit")
        if self.meridian.joint[1] <= 0.1 * self.neck_length:
            wall = schema.shown(self.neck_wall or self.wall, "m")
            raise GeometryError(f"neck_wall is {wall}; so thick a wall leaves no {self.told('neck_length')}, inside")
        if self.fillet:
            self._check_fillet()
        self.check_most("rod_radius", 0.95, "neck_radius", "air has to pass between it and the neck: at most {}")

    def _check_fillet(self) -> None:
        self.check_most("fillet", 1.0, "radius")
        level, joint = self.meridian.rounding(self.fillet).foot[1], self.meridian.joint[1]
        least = 0.1 * self.neck_length
        if level < least or level > joint - 1e-3 * self.wall:
            begin = f"{schema.shown(abs(level), 'm')}{' below the end' if level < 0 else ''}"
            self.reject(
                "fillet",
                f"with {self.given('neck_length')} it begins at the height {begin}: it must leave {schema.shown(least, 'm')} "
                f"of the neck and begin below where the neck opens inside, {schema.shown(joint, 'm')}",
            )

    def _check_closed(self) -> None:
        if self.rod_radius:
            self.reject("rod_radius", "a rod needs a neck, but neck_radius is 0")
        if self.held == "outside":
            raise GeometryError("held is 'outside', which needs a neck, but neck_radius is 0")
        if self.dimension == 3 and self.angle > 120.0:
            self.reject("angle", "without a neck the balloon could slide away sideways: use 120 deg or less")

    @property
    def meridian(self) -> Meridian:
        """Its dimensions and the corners of its half section."""
        return Meridian.of(self)

    @property
    def panels(self) -> tuple[revolved.Panel, ...]:
        maker = _Maker(self)
        return (*maker.neck(), *maker.shell(), *maker.rod())

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
    def recipe(self) -> actuator.Recipe:
        shells = actuator.in_halves(
            self.lift, self.meridian.height,
            "The halves meet at the equator, where each is as wide as it gets, so that neither holds its core.",
        )  # fmt: skip
        pours = tuple(dataclasses.replace(pour, squeezed=True) for pour in shells.pours)
        rod = "Bond the rod to the pole of the upper half before the halves are bonded."
        whole = actuator.Recipe(
            pours=(actuator.Pour(name="balloon", up=self.lift, level=0.0, sideways=(0.0, 1.0, 0.0), squeezed=True),),
            why="The outside opens in two halves; the core stands on the lid by the neck and leaves through it once molten or "
            "dissolved.",
        )
        return dataclasses.replace(
            shells,
            pours=pours,
            steps=(rod,) if self.rod_radius else (),
            seamless=whole if self.neck_radius and not self.rod_radius else None,
        )

    @property
    def anchors(self) -> Mapping[str, revolved.Place]:
        return {} if self.neck_radius else {"support": (0.0, 0.0)}

    @property
    def probes(self) -> Mapping[str, Vector]:
        meridian = self.meridian
        c, (A, C), z = meridian.inner[1], meridian.outer, meridian.height
        return {"apex": (0.0, 0.0, z + C), "ceiling": (0.0, 0.0, z + c), "equator": (A, 0.0, z)}

    figure_texts: ClassVar = {"width": ("mm", "width", "diameter of the outer surface at the undeformed equator, deformed")}

    def device_figures(self, places: Mapping[str, Vector]) -> dict[str, float]:
        x, y, _ = places["equator"]
        return {"width": 2.0 * float((x * x + y * y) ** 0.5)}


# ----------------------------------------------------------------------------------------------------------------------
# The half section of a balloon: corners where neck, rounding, shell and rod meet, and the panels between them.


class Rounding(NamedTuple):
    """The arc that rounds the corner between neck and balloon: its centre, where it leaves the neck, its middle, where it
    meets the balloon, and the angle of the outer spheroid there, from the equator upwards in rad."""

    centre: revolved.Place
    foot: revolved.Place
    middle: revolved.Place
    head: revolved.Place
    angle: float


MIN_RADIUS_RATIO = 0.2
"""Smallest ratio of the polar to the equatorial radius, and of that to this."""
MAX_NECK_RATIO = 0.8
"""Largest outer radius of the neck in outer radii of the balloon."""


@dataclasses.dataclass(frozen=True)
class Meridian:
    """Dimensions of a balloon that follow from its parameters, in m: half axes of the spheroids along radius and height, the
    height of their centre above z = 0, and inner and outer radius of the neck, zeros without one."""

    inner: revolved.Place
    outer: revolved.Place
    height: float
    neck: revolved.Place

    @classmethod
    def of(cls, balloon: Balloon) -> Meridian:
        """Of a balloon whose neck is narrower than itself."""
        a, c, t = balloon.radius, balloon.polar_radius or balloon.radius, balloon.wall
        if not balloon.neck_radius:
            return cls((a, c), (a + t, c + t), c + t, (0.0, 0.0))
        neck = (balloon.neck_radius, balloon.neck_radius + (balloon.neck_wall or t))
        below = (c + t) * math.sqrt(1.0 - (neck[1] / (a + t)) ** 2)
        return cls((a, c), (a + t, c + t), balloon.neck_length + below, neck)

    def at(self, axes: revolved.Place, angle: float) -> revolved.Place:
        """Return the place on a spheroid at an angle from the equator upwards; exactly on the axis at the poles."""
        if abs(abs(angle) - 0.5 * math.pi) < 1e-12:
            return (0.0, self.height + math.copysign(axes[1], angle))
        return (axes[0] * math.cos(angle), self.height + axes[1] * math.sin(angle))

    @property
    def joint(self) -> revolved.Place:
        """Point at which the neck's inside meets the inner spheroid."""
        return (self.neck[0], self.at(self.inner, self.joint_angle)[1])

    @property
    def joint_angle(self) -> float:
        """Angle of the inner spheroid there."""
        return -math.acos(self.neck[0] / self.inner[0])

    def rounding(self, fillet: float) -> Rounding:
        """Return the arc of a radius that touches the neck's outside and the outer spheroid."""
        A, C = self.outer

        def centre(angle: float) -> revolved.Place:
            r, z = self.at(self.outer, angle)
            across = math.hypot(math.cos(angle) / A, math.sin(angle) / C)
            return (r + fillet * math.cos(angle) / A / across, z + fillet * math.sin(angle) / C / across)

        wanted = self.neck[1] + fillet
        angle = float(scipy.optimize.brentq(lambda x: centre(x)[0] - wanted, -math.acos(self.neck[1] / A), 0.0, xtol=1e-14))
        z = centre(angle)[1]
        head = self.at(self.outer, angle)
        turn = math.atan2(head[1] - z, wanted - head[0])
        middle = (wanted - fillet * math.cos(0.5 * turn), z + fillet * math.sin(0.5 * turn))
        return Rounding((wanted, z), (self.neck[1], z), middle, head, angle)


class _Maker:
    """Panels of one balloon, from the neck's end to the far pole."""

    def __init__(self, balloon: Balloon):
        self.balloon, self.meridian = balloon, balloon.meridian
        self.through = balloon.rows
        self.inner_angle = self.outer_angle = -0.5 * math.pi
        self.begin: tuple[revolved.Place, revolved.Place] = (self.meridian.at(self.meridian.inner, self.inner_angle),
                                           self.meridian.at(self.meridian.outer, self.outer_angle))  # fmt: skip

    def _panel(self, left: revolved.Side, right: revolved.Side, ends: tuple[str, str] = ("", "")) -> revolved.Panel:
        """Between a side on the air's side and one outside, both upwards; roles of the sides across it, lower and upper."""
        low = revolved.Side(left.start, right.start, self.through, ends[0])
        high = revolved.Side(right.end, left.end, self.through, ends[1])
        return revolved.Panel("solid", (low, right, high, left.reversed))

    def neck(self) -> list[revolved.Panel]:
        """From z = 0 to the shell; nothing without a neck."""
        balloon, meridian = self.balloon, self.meridian
        if not balloon.neck_radius:
            return []
        (inside, outside), joint = meridian.neck, meridian.joint
        self.inner_angle, self.outer_angle = meridian.joint_angle, -math.acos(outside / meridian.outer[0])
        if not balloon.fillet:
            corner = (outside, balloon.neck_length)
            cells = self.balloon.along(balloon.neck_length)
            self.begin = (joint, corner)
            return [self._panel(revolved.Side((inside, 0.0), joint, cells, "cavity"), revolved.Side((outside, 0.0),
            corner, cells, "neck"),
                                ("support", ""))]  # fmt: skip
        arc = meridian.rounding(balloon.fillet)
        cells, level = self.balloon.along(arc.foot[1]), (inside, arc.foot[1])
        self.outer_angle = arc.angle
        self.inner_angle = max(arc.angle, meridian.joint_angle + 0.5 * balloon.fillet / meridian.inner[0])
        self.begin = (meridian.at(meridian.inner, self.inner_angle), arc.head)
        axes, few = (balloon.fillet, balloon.fillet), max(2, self.balloon.along(balloon.fillet))
        return [
            self._panel(revolved.Side((inside, 0.0), level, cells, "cavity"), revolved.Side((outside, 0.0), arc.foot,
            cells, "neck"),
                        ("support", "")),
            self._panel(revolved.Side(level, joint, few, "cavity"), revolved.Side(arc.foot, arc.middle, few, "outer",
            arc.centre, axes)),
            self._panel(self._arc(joint, self.begin[0], few, "cavity"),
                        revolved.Side(arc.middle, arc.head, few, "outer", arc.centre, axes)),
        ]  # fmt: skip

    def _arc(self, start: revolved.Place, end: revolved.Place, cells: int, role: str, outer: bool = False) -> revolved.Side:
        axes = self.meridian.outer if outer else self.meridian.inner
        return revolved.Side(start, end, cells, role, (0.0, self.meridian.height), axes)

    def shell(self) -> list[revolved.Panel]:
        """From the neck, or the lower pole, to the far pole."""
        meridian, shell = self.meridian, []
        stops = [0.0, *([self.rod_angle] if self.balloon.rod_radius else []), 0.5 * math.pi]
        first = "axis" if not self.balloon.neck_radius else ""
        angle, inside, outside = self.outer_angle, *self.begin
        for stop in stops:
            to = (meridian.at(meridian.inner, stop), meridian.at(meridian.outer, stop))
            if self.balloon.rod_radius and stop == self.rod_angle:
                to = (self.rod_top, to[1])
            bonded = self.balloon.rod_radius and stop > self.rod_angle
            cells = self.rod_cells if bonded else self.balloon.along(abs(stop - angle) * max(meridian.outer))
            last = "axis" if stop == stops[-1] else ""
            left = self._arc(inside, to[0], cells, "" if bonded else "cavity")
            right = self._arc(outside, to[1], cells, "outer", True)
            shell.append(self._panel(left, right, (first, last)))
            first, angle, (inside, outside) = "", stop, to
        return shell

    @property
    def rod_angle(self) -> float:
        """Angle of the inner spheroid at the rod's edge."""
        return math.acos(self.balloon.rod_radius / self.meridian.inner[0])

    @property
    def rod_top(self) -> revolved.Place:
        """Point at which the rod's side meets the shell."""
        return (self.balloon.rod_radius, self.meridian.at(self.meridian.inner, self.rod_angle)[1])

    @property
    def rod_cells(self) -> int:
        """Cells from the axis to the rod's side."""
        return max(2, self.balloon.along(self.balloon.rod_radius))

    def rod(self) -> list[revolved.Panel]:
        """Along the axis, from z = 0 to the shell; nothing without one."""
        if not self.balloon.rod_radius:
            return []
        radius, top = self.balloon.rod_radius, self.rod_top
        pole = self.meridian.at(self.meridian.inner, 0.5 * math.pi)
        along = self.balloon.along(top[1])
        return [revolved.Panel("rod", (
            revolved.Side((0.0, 0.0), (radius, 0.0), self.rod_cells, "rod_end"), revolved.Side((radius, 0.0), top,
            along, "cavity"),
            self._arc(top, pole, self.rod_cells, ""), revolved.Side(pole, (0.0, 0.0), along, "axis"),
        ))]  # fmt: skip
