"""The half section of a balloon: corners where neck, rounding, shell and rod meet, and the panels between them."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING, NamedTuple

from geometries.panels import Panel, Place, Side

if TYPE_CHECKING:
    from geometries.balloon import Balloon


class Rounding(NamedTuple):
    """The arc that rounds the corner between neck and balloon.

    Attributes:
        centre: Of the arc.
        foot: Where it leaves the neck.
        middle: Of the arc.
        head: Where it meets the balloon.
        angle: Of the outer spheroid there, from the equator upwards in rad.
    """

    centre: Place
    foot: Place
    middle: Place
    head: Place
    angle: float


@dataclasses.dataclass(frozen=True)
class Meridian:
    """Dimensions of a balloon that follow from its parameters.

    Attributes:
        inner: Half axes of the inner spheroid along radius and height, m.
        outer: Those of the outer one.
        height: Of the centre above z = 0, m.
        neck: Inner and outer radius of the neck, m; zeros without one.
    """

    inner: Place
    outer: Place
    height: float
    neck: Place

    @classmethod
    def of(cls, balloon: Balloon) -> Meridian:
        """Of a balloon whose neck is narrower than itself."""
        a, c, t = balloon.radius, balloon.polar_radius or balloon.radius, balloon.wall
        if not balloon.neck_radius:
            return cls((a, c), (a + t, c + t), c + t, (0.0, 0.0))
        neck = (balloon.neck_radius, balloon.neck_radius + (balloon.neck_wall or t))
        below = (c + t) * math.sqrt(1.0 - (neck[1] / (a + t)) ** 2)
        return cls((a, c), (a + t, c + t), balloon.neck_length + below, neck)

    def at(self, axes: Place, angle: float) -> Place:
        """The place on a spheroid at an angle from the equator upwards; exactly on the axis at the poles."""
        if abs(abs(angle) - 0.5 * math.pi) < 1e-12:
            return (0.0, self.height + math.copysign(axes[1], angle))
        return (axes[0] * math.cos(angle), self.height + axes[1] * math.sin(angle))

    @property
    def joint(self) -> Place:
        """Where the neck's inside meets the inner spheroid."""
        return (self.neck[0], self.at(self.inner, self.joint_angle)[1])

    @property
    def joint_angle(self) -> float:
        """Angle of the inner spheroid there."""
        return -math.acos(self.neck[0] / self.inner[0])

    def rounding(self, fillet: float) -> Rounding:
        """The arc of a radius that touches the neck's outside and the outer spheroid."""
        from scipy.optimize import brentq

        A, C = self.outer

        def centre(angle: float) -> Place:
            r, z = self.at(self.outer, angle)
            across = math.hypot(math.cos(angle) / A, math.sin(angle) / C)
            return (r + fillet * math.cos(angle) / A / across, z + fillet * math.sin(angle) / C / across)

        wanted = self.neck[1] + fillet
        angle = float(brentq(lambda x: centre(x)[0] - wanted, -math.acos(self.neck[1] / A), 0.0, xtol=1e-14))
        z = centre(angle)[1]
        head = self.at(self.outer, angle)
        turn = math.atan2(head[1] - z, wanted - head[0])
        middle = (wanted - fillet * math.cos(0.5 * turn), z + fillet * math.sin(0.5 * turn))
        return Rounding((wanted, z), (self.neck[1], z), middle, head, angle)


def balloon_panels(balloon: Balloon) -> tuple[Panel, ...]:
    """The half section; see `Balloon`."""
    maker = _Maker(balloon)
    return (*maker.neck(), *maker.shell(), *maker.rod())


class _Maker:
    """Panels of one balloon, from the neck's end to the far pole."""

    def __init__(self, balloon: Balloon):
        self.balloon, self.meridian = balloon, balloon.meridian
        self.through = balloon.rows
        self.inner_angle = self.outer_angle = -0.5 * math.pi
        self.begin: tuple[Place, Place] = (self.meridian.at(self.meridian.inner, self.inner_angle),
                                           self.meridian.at(self.meridian.outer, self.outer_angle))  # fmt: skip

    def _cells(self, length: float) -> int:
        return max(1, math.ceil(length / self.balloon.cell_size - 1e-9))

    def _panel(self, left: Side, right: Side, ends: tuple[str, str] = ("", "")) -> Panel:
        """Between a side on the air's side and one outside, both upwards; roles of the sides across it, lower and upper."""
        low = Side(left.start, right.start, self.through, ends[0])
        high = Side(right.end, left.end, self.through, ends[1])
        return Panel("solid", (low, right, high, left.reversed))

    def neck(self) -> list[Panel]:
        """From z = 0 to the shell; nothing without a neck."""
        balloon, meridian = self.balloon, self.meridian
        if not balloon.neck_radius:
            return []
        (inside, outside), joint = meridian.neck, meridian.joint
        self.inner_angle, self.outer_angle = meridian.joint_angle, -math.acos(outside / meridian.outer[0])
        if not balloon.fillet:
            corner = (outside, balloon.neck_length)
            cells = self._cells(balloon.neck_length)
            self.begin = (joint, corner)
            return [self._panel(Side((inside, 0.0), joint, cells, "cavity"), Side((outside, 0.0), corner, cells, "neck"),
                                ("support", ""))]  # fmt: skip
        arc = meridian.rounding(balloon.fillet)
        cells, level = self._cells(arc.foot[1]), (inside, arc.foot[1])
        self.outer_angle = arc.angle
        self.inner_angle = max(arc.angle, meridian.joint_angle + 0.5 * balloon.fillet / meridian.inner[0])
        self.begin = (meridian.at(meridian.inner, self.inner_angle), arc.head)
        axes, few = (balloon.fillet, balloon.fillet), max(2, self._cells(balloon.fillet))
        return [
            self._panel(Side((inside, 0.0), level, cells, "cavity"), Side((outside, 0.0), arc.foot, cells, "neck"),
                        ("support", "")),
            self._panel(Side(level, joint, few, "cavity"), Side(arc.foot, arc.middle, few, "outer", arc.centre, axes)),
            self._panel(self._arc(joint, self.begin[0], few, "cavity"),
                        Side(arc.middle, arc.head, few, "outer", arc.centre, axes)),
        ]  # fmt: skip

    def _arc(self, start: Place, end: Place, cells: int, role: str, outer: bool = False) -> Side:
        axes = self.meridian.outer if outer else self.meridian.inner
        return Side(start, end, cells, role, (0.0, self.meridian.height), axes)

    def shell(self) -> list[Panel]:
        """From the neck, or the lower pole, to the far pole."""
        meridian, found = self.meridian, []
        stops = [0.0, *([self.rod_angle] if self.balloon.rod_radius else []), 0.5 * math.pi]
        first = "axis" if not self.balloon.neck_radius else ""
        angle, inside, outside = self.outer_angle, *self.begin
        for stop in stops:
            to = (meridian.at(meridian.inner, stop), meridian.at(meridian.outer, stop))
            if self.balloon.rod_radius and stop == self.rod_angle:
                to = (self.rod_top, to[1])
            bonded = self.balloon.rod_radius and stop > self.rod_angle
            cells = self.rod_cells if bonded else self._cells(abs(stop - angle) * max(meridian.outer))
            last = "axis" if stop == stops[-1] else ""
            left = self._arc(inside, to[0], cells, "" if bonded else "cavity")
            right = self._arc(outside, to[1], cells, "outer", True)
            found.append(self._panel(left, right, (first, last)))
            first, angle, (inside, outside) = "", stop, to
        return found

    @property
    def rod_angle(self) -> float:
        """Angle of the inner spheroid at the rod's edge."""
        return math.acos(self.balloon.rod_radius / self.meridian.inner[0])

    @property
    def rod_top(self) -> Place:
        """Where the rod's side meets the shell."""
        return (self.balloon.rod_radius, self.meridian.at(self.meridian.inner, self.rod_angle)[1])

    @property
    def rod_cells(self) -> int:
        """Cells from the axis to the rod's side."""
        return max(2, self._cells(self.balloon.rod_radius))

    def rod(self) -> list[Panel]:
        """Along the axis, from z = 0 to the shell; nothing without one."""
        if not self.balloon.rod_radius:
            return []
        radius, top = self.balloon.rod_radius, self.rod_top
        pole = self.meridian.at(self.meridian.inner, 0.5 * math.pi)
        along = self._cells(top[1])
        return [Panel("rod", (
            Side((0.0, 0.0), (radius, 0.0), self.rod_cells, "rod_end"), Side((radius, 0.0), top, along, "cavity"),
            self._arc(top, pole, self.rod_cells, ""), Side(pole, (0.0, 0.0), along, "axis"),
        ))]  # fmt: skip
