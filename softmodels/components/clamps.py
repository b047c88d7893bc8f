"""Clamps: faces, edges or regions that are held, or held so that they slip in one direction.

They are added to the device's own supports. A clamp on one of the device's own supports replaces it:
``[hold.bench]`` with ``face = "support"`` and ``along = "z"`` lets a glued disk slide on its bench.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import numpy.typing as npt

from geometries import Actuator, Hold
from geometries.actuator import Vector
from softmodels.common.errors import known_are
from softmodels.common.schema import Words, field_of
from softmodels.mechanics.component import ComponentError, bases, direction, faces_of, names_in, register_component

if TYPE_CHECKING:
    pass


from softmodels.mechanics.holds import HoldingPart


@register_component
@dataclasses.dataclass(frozen=True)
class Clamp(HoldingPart):
    """A support of faces, edges or regions.

    Attributes:
        face: Roles of faces, edges or points, or names of regions, with commas between: ``"clamp, clamp_top"``.
        along: Direction along which they are held, such as ``"z"``; all directions if empty.
        slip: The only direction in which they slip; none if empty.
    """

    face: str = field_of(Words(), "faces, edges or regions that are held, such as top")
    along: str = field_of(Words(), "direction along which they are held, such as z: they slip across it", "")
    slip: str = field_of(Words(), "direction in which they slip, such as x: they are held across it", "")

    table: ClassVar[str] = "hold"
    needs: ClassVar[str] = "[hold] needs a face, such as face = 'top'"

    def check(self) -> None:
        if not self.roles:
            raise ComponentError(self.needs)
        if self.along and self.slip:
            raise ComponentError(f"{self.where} has both along and slip; give either the held or the free direction")
        for text in filter(None, (self.along, self.slip)):
            direction(text, self.where)

    @property
    def roles(self) -> list[str]:
        return names_in(self.face)

    def check_on(self, actuator: Actuator) -> None:
        """Raise `ComponentError` if a device has no such face, or its mesh no such direction."""
        known = list(dict.fromkeys([*faces_of(actuator), *actuator.regions, *(hold.role for hold in actuator.holds)]))
        for role in bases(self.where, self.roles, actuator):
            if role not in known:
                raise ComponentError(
                    f"{self.where}: {type(actuator).__name__} has no {role!r}; {known_are(role, known)}"
                )
        self.holds(actuator)

    def undesigned(self, actuator: Actuator) -> str:
        return ""

    def inside(self, actuator: Actuator) -> tuple[str, ...]:
        return tuple(role for role in self.roles if role in actuator.regions)

    def holds(self, actuator: Actuator) -> list[Hold]:
        """Return what it holds on a device.

        Raises:
            ComponentError: A direction that an axisymmetric section does not have.
        """
        points = {hold.role for hold in actuator.holds if hold.point}
        return [Hold(role, way, role in points) for role in self.roles for way in self._ways(actuator)]

    def _ways(self, actuator: Actuator) -> list[Vector | None]:
        text = self.along or self.slip
        if not text:
            return [None]
        way = direction(text, self.where)
        if actuator.dimension == 2 and max(abs(way[0]), abs(way[2])) < 1 - 1e-12:
            raise ComponentError(
                f"{self.where}: a section has only the directions x (away from its axis) and z, not {text!r}"
            )
        if self.along:
            return [way]
        return _across(way, actuator)

    @property
    def label(self) -> str:
        """Label with its kind, because a region or a load may have the same name."""
        return f"hold_{self.name}" if self.name else self.table


def _across(way: Vector, actuator: Actuator) -> list[Vector | None]:
    """Return the unit vectors perpendicular to a direction and to each other, those of the device's own planes and holds
    first."""
    known = [plane.normal for plane in actuator.cut_planes]
    known += [hold.direction for hold in actuator.holds if hold.direction is not None]
    axes = np.eye(3)[[0, 2]] if actuator.dimension == 2 else np.eye(3)
    found: list[npt.NDArray[np.float64]] = []
    for candidate in [*np.array(known).reshape(-1, 3), *axes]:
        if abs(candidate @ np.array(way)) < 1e-9 and all(abs(candidate @ one) < 1e-9 for one in found):
            found.append(candidate / np.linalg.norm(candidate))
    if actuator.dimension == 3 and len(found) < 2:
        first = found[0] if found else np.linalg.svd(np.array([way]))[2][1]
        found = [first, np.cross(way, first)]
    return [(float(x), float(y), float(z)) for x, y, z in found]
