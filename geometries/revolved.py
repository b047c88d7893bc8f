"""Bodies of revolution: a half section of panels, meshed flat or turned into a wedge around the axis."""

from __future__ import annotations

import functools
import math
from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from geometries.actuator import CutPlane
from geometries.carrying import carried_along
from geometries.cell_count import check_cell_count
from geometries.errors import GeometryError
from geometries.fields import angle_field, choice_field, number_field, shown
from geometries.panels import Panel, Place, Side, chained, enclosed_volume, outline, turned_volume
from geometries.parameters import parameter, parameter_names
from geometries.revolved_outline import whole_edges
from geometries.sectioned import Wedged

NARROWEST = 5.0
"""Smallest angle in degrees; a thinner wedge has needles for cells along the axis."""

MOST_THROUGH = 20
"""Most cells through a wall: no result needs them."""

MOST_CELLS = 2_000_000
"""Meshes expected to be larger are refused: they are typing mistakes far more often than wishes."""

TETRAHEDRON = 0.12
"""Volume of a regular tetrahedron with edges of length 1."""

NEAR = 1e-7
"""Share of the device's size that counts as no distance."""


def section_field() -> Any:
    """Return a dataclass field: how much of a body of revolution is modelled."""
    return choice_field("axisymmetric", ("axisymmetric", "wedge"), "profile in radius and height, or solid slice")


def wedge_field() -> Any:
    """Return a dataclass field for the wedge's angle."""
    return angle_field(
        30.0, "angle of the wedge; divides 360 deg evenly", unless=("section", "axisymmetric"), shape=False
    )


def through_field(default: float = 2.0, more: str = "") -> Any:
    """Return a dataclass field for the cells through a wall; ``more`` ends its help."""
    return number_field(default, f"how many cells there are through the wall{more}", shape=False)


class Revolved(Wedged):
    """A body of revolution around z; a device is a dataclass of it with the fields below and its `panels`.

    Fields that a device declares: ``cell_size`` (edge length along its walls), ``through`` (`through_field`), ``section``
    (`section_field`) and ``angle`` (`wedge_field`). A wedge lies between the azimuths 0 and ``angle``, with "plane0" and
    "plane1"; a section has the curve "axis".
    """

    cell_size: float
    through: float

    axial: ClassVar = True
    mesh_order: ClassVar = 2

    seen: ClassVar[tuple[str, ...]] = ("outer",)
    """Roles of the sides that a camera sees from the side, from the axis at the top outwards."""

    @property
    @abstractmethod
    def panels(self) -> tuple[Panel, ...]:
        """The half section, its dimensions known to make one."""

    @property
    @abstractmethod
    def thinnest(self) -> float:
        """Thickness in m of its thinnest wall, through which a wedge has `rows` cells."""

    @property
    def rows(self) -> int:
        """How many cells there are through a wall."""
        return round(self.through)

    @functools.cached_property
    def sides(self) -> list[Side]:
        """The sides of its outline."""
        return outline(self.panels)

    @functools.cached_property
    def profile(self) -> list[Side]:
        """The sides that a camera sees, from the axis at the top outwards."""
        return chained(side for side in self.sides if side.role in self.seen)

    @functools.cached_property
    def edges(self) -> list[Side]:
        """Its outline between corners, however its cells cut it."""
        probes = [(float(np.hypot(x, y)), float(z)) for x, y, z in self.probes.values()]
        return whole_edges(self.sides, probes)

    @property
    def movable(self) -> tuple[str, ...]:
        return tuple(name for name in parameter_names(self) if parameter(self, name) != 0.0)

    def carried(self, other: Self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points of the boundary at the same share of the same edge of the other's outline; see `Actuator.carried`."""
        if type(other) is not type(self) or [one.role for one in self.edges] != [one.role for one in other.edges]:
            raise GeometryError(
                f"points are carried between devices whose outlines have the same edges; this {type(self).__name__} has "
                f"{len(self.edges)} and the other {type(other).__name__} {len(other.edges)}, or others"
            )
        if self.dimension != other.dimension or (self.dimension == 3 and self.angle != other.angle):
            raise GeometryError("points are carried between devices of the same section and angle")
        return carried_along(self.edges, other.edges, points, self.size)

    @property
    def anchors(self) -> Mapping[str, Place]:
        """Where single vertices that hold it are, as (radius, height) in m by role."""
        return {}

    @property
    def cut_planes(self) -> tuple[CutPlane, ...]:
        if self.dimension == 2 or self.copies == 1:
            return ()
        turn = math.radians(self.angle)
        return (CutPlane("plane0", (0.0, -1.0, 0.0)), CutPlane("plane1", (-math.sin(turn), math.cos(turn), 0.0)))

    @property
    def wedge_size(self) -> float:
        """Edge length in m of a wedge's cells."""
        return min(self.cell_size, self.thinnest / self.rows)

    @property
    def expected_cells(self) -> float:
        if self.dimension == 3:
            return self.solid_volume / self.copies / (TETRAHEDRON * self.wedge_size**3)
        return sum(2.0 * panel.sides[0].cells * panel.sides[1].cells for panel in self.panels)

    @property
    def cavity_volume(self) -> float:
        return enclosed_volume(side for side in self.sides if side.role == "cavity")

    @property
    def solid_volume(self) -> float:
        return turned_volume(self.panels)

    def on_profile(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        points = np.asarray(points, dtype=float)
        flat, near = np.column_stack([np.hypot(points[:, 0], points[:, 1]), points[:, 2]]), NEAR * self.size
        here = (np.abs(points[:, 1]) < near) & (points[:, 0] > -near)
        missed = [side.missed(flat) for side in self.profile]
        return here & (np.min(missed, axis=0) < near)

    def along_profile(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        points = np.asarray(points, dtype=float)
        flat = np.column_stack([np.hypot(points[:, 0], points[:, 1]), points[:, 2]])
        missed = np.array([side.missed(flat) for side in self.profile])
        places = np.array([place + side.shares(flat) for place, side in enumerate(self.profile)])
        return np.asarray(np.take_along_axis(places, missed.argmin(axis=0)[None], axis=0)[0])

    def check_cells(self) -> None:
        """Check what every body of revolution has; called at the end of a device's `check`.

        Raises:
            GeometryError: The first parameter found impossible, with its value and the limit.
        """
        if not 1 <= self.rows <= MOST_THROUGH or self.through != round(self.through):
            raise GeometryError(f"through is {self.through:g}; it must be a whole number from 1 to {MOST_THROUGH}")
        if self.dimension == 3:
            if not NARROWEST <= self.angle <= 360.0:
                raise GeometryError(
                    f"angle is {shown(self.angle, 'degree')}; it must lie between {NARROWEST:g} and 360 deg"
                )
            turns = 360.0 / self.angle
            if abs(turns - round(turns)) > 1e-9 * turns:
                raise GeometryError(
                    f"angle is {shown(self.angle, 'degree')}; it must divide 360 deg evenly, such as 30, 45, 90 or 360 deg"
                )
        more = f" with {self.rows} cells through {shown(self.thinnest, 'm')}"
        check_cell_count(self.cell_size, self.expected_cells, MOST_CELLS, more)

    def build(self) -> None:
        from geometries.revolved_shape import build_section, build_wedge

        build_section(self) if self.dimension == 2 else build_wedge(self)
