"""Devices that may be modelled by an axisymmetric section in place of a solid, and those whose solid is a wedge."""

from __future__ import annotations

from geometries.actuator import Actuator, Hold


class Sectioned(Actuator):
    """A device of which an axisymmetric section may be modelled; a device is a dataclass of it with the field below."""

    section: str

    @property
    def dimension(self) -> int:
        return 2 if self.section == "axisymmetric" else 3

    @property
    def axis_holds(self) -> tuple[Hold, ...]:
        """Among `holds`: the axis of a section, from which nothing can move away; empty for a solid."""
        return (Hold("axis", (1.0, 0.0, 0.0)),) if self.dimension == 2 else ()


class Wedged(Sectioned):
    """A device whose solid is a wedge; a device is a dataclass of it with ``section`` and ``angle``, in degrees."""

    angle: float

    @property
    def copies(self) -> int:
        return 1 if self.dimension == 2 else round(360.0 / self.angle)

    @property
    def fuller(self) -> str:
        return "--section wedge --angle 360deg" if self.dimension == 2 else "--angle 360deg"
