"""What a path is asked for and what it follows: functions of cavity volume and pressure whose values are given.

A path has no notion of pressures, volumes or strokes. It asks a `Quantity` for its value at a state, for the curve in the
plane of volume and pressure on which it has a value, for its rate along a tangent and for a first step. A new supply is one
subclass of `Supply` with a name, a value and two slopes. All figures are dimensionless, as in `softmodels.mechanics`.
"""

from __future__ import annotations

import abc
import dataclasses
import math
from typing import TYPE_CHECKING, ClassVar, Protocol

from softmodels.mechanics.controls import Control, Curve, arc_length, pressure_control, volume_control

if TYPE_CHECKING:
    from softmodels.mechanics.system import State
    from softmodels.mechanics.tangent import Tangent
    from softmodels.path.points import Point

FIRST_STEP = 0.1
"""Of a path, in the device's own scales of volume and pressure."""
LOCKED_BELOW = 1e-12
"""dV/dP, in volumes per shear modulus, up to which nothing moves: the stiffest parts leave 1e-8, rounding makes 1e-18."""
LARGEST_VOLUME_STEP = 0.2
"""First step in volume where a path changes to it, in cavity volumes."""


@dataclasses.dataclass(frozen=True)
class Plane:
    """The plane of cavity volume and pressure, with the scales in which arc lengths are measured."""

    V_scale: float
    P_scale: float

    @classmethod
    def of(cls, V_scale: float, compliance: float) -> Plane:
        """Scaled by how far the device gives way, dV/dP."""
        return cls(V_scale, V_scale / max(abs(compliance), LOCKED_BELOW * V_scale))

    def felt(self, compliance: float) -> float:
        """The size of a dV/dP, but not less than that of a device in which nothing moves: below lies rounding."""
        return max(abs(compliance), LOCKED_BELOW * self.V_scale)

    def locked(self, compliance: float) -> bool:
        """Whether a dV/dP is of a device in which nothing moves."""
        return abs(compliance) <= LOCKED_BELOW * self.V_scale

    def stiffened(self, compliance: float) -> Plane:
        """The plane of a device as it is at its stiffest: of a flat membrane the scale of its rest says nothing any more.

        Args:
            compliance: Smallest dV/dP on the path.
        """
        return dataclasses.replace(self, P_scale=max(self.P_scale, self.V_scale / compliance))

    def product(self, a: tuple[float, float], b: tuple[float, float]) -> float:
        """Inner product of two changes (dV, dP)."""
        return a[0] * b[0] / self.V_scale**2 + a[1] * b[1] / self.P_scale**2

    def square_to(self, tangent: Tangent, state: State, step: float = 0.0) -> Control:
        """The line square to a tangent, ``step`` away from a state."""
        return arc_length(state.V, state.P, tangent.V, tangent.P, step, self.V_scale, self.P_scale)


class Followed(Protocol):
    """What a path can follow step by step.

    Attributes:
        name: As in the column ``following`` of ``path.csv``.
    """

    @property
    def name(self) -> str: ...
    def ahead(self, state: State, tangent: Tangent, step: float) -> Curve:
        """The curve that lies ``step`` ahead of a state."""

    def rate(self, state: State, tangent: Tangent) -> float:
        """Change along a tangent."""

    def first_step(self, plane: Plane, V0: float) -> float:
        """Length of a path's first step from the volume V0."""

    def largest_step(self, state: State, plane: Plane) -> float:
        """Length of the longest first step where a path changes to this."""


class Quantity(abc.ABC):
    """A function of volume and pressure whose values can be requested of a path.

    Attributes:
        name: As in the column ``following`` of ``path.csv``.
        ends_at_pressure_limit: Whether there is no state with a higher value beyond a limit point of the pressure.
        has_limits: Whether it can have limit points of its own beside the pressure's.
    """

    name: ClassVar[str]
    ends_at_pressure_limit: ClassVar[bool] = False
    has_limits: ClassVar[bool] = False

    @abc.abstractmethod
    def value(self, V: float, P: float) -> float:
        """Its value."""

    @abc.abstractmethod
    def slopes(self, V: float, P: float) -> tuple[float, float]:
        """Its derivatives by volume and by pressure."""

    @abc.abstractmethod
    def curve(self, value: float) -> Curve:
        """The curve on which it has a value."""

    def counted(self, start: float, undeformed: float) -> Quantity:
        """The same for a path that begins at the volume ``start``, of a device that has another one undeformed."""
        return self

    def starts_forward(self, state: State, tangent: Tangent) -> bool:
        """Whether a tangent at a path's first state leads to higher values."""
        return not self.rate(state, tangent) < 0.0

    def exactly(self, state: State, value: float) -> State:
        """A state that was solved for at a value, with that value to the last digit where it is a number of the state."""
        return state

    def limit_met(self, of_pressure: Point | None, own: Point | None) -> Point | None:
        """Which of the limit points on a path is the reason that a value was not met."""
        return None

    def ahead(self, state: State, tangent: Tangent, step: float) -> Curve:
        return self.curve(self.value(state.V, state.P) + step)

    def rate(self, state: State, tangent: Tangent) -> float:
        a, b = self.slopes(state.V, state.P)
        return a * tangent.V + b * tangent.P

    def slope(self, point: Point) -> float:
        """Derivative by the volume along the path."""
        a, b = self.slopes(point.state.V, point.state.P)
        return a + b * point.tangent.P / point.tangent.V

    def first_step(self, plane: Plane, V0: float) -> float:
        a, b = self.slopes(V0, 0.0)
        return FIRST_STEP * (a * plane.V_scale + b * plane.P_scale)

    def largest_step(self, state: State, plane: Plane) -> float:
        return math.inf


class Pressure(Quantity):
    """The cavity's pressure."""

    name = "pressure"
    ends_at_pressure_limit = True

    def value(self, V: float, P: float) -> float:
        return P

    def slopes(self, V: float, P: float) -> tuple[float, float]:
        return 0.0, 1.0

    def curve(self, value: float) -> Control:
        return pressure_control(value)

    def exactly(self, state: State, value: float) -> State:
        return dataclasses.replace(state, P=value)

    def limit_met(self, of_pressure: Point | None, own: Point | None) -> Point | None:
        return of_pressure


@dataclasses.dataclass(frozen=True)
class AddedVolume(Quantity):
    """The cavity's volume beyond that of the undeformed device, wherever a path begins.

    Attributes:
        V0: The volume from which it counts; a path puts in its own.
    """

    V0: float = 0.0
    name: ClassVar[str] = "volume"

    def counted(self, start: float, undeformed: float) -> AddedVolume:
        return dataclasses.replace(self, V0=undeformed)

    def value(self, V: float, P: float) -> float:
        return V - self.V0

    def slopes(self, V: float, P: float) -> tuple[float, float]:
        return 1.0, 0.0

    def curve(self, value: float) -> Control:
        return volume_control(value + self.V0)

    def ahead(self, state: State, tangent: Tangent, step: float) -> Control:
        return volume_control(state.V + step)

    def largest_step(self, state: State, plane: Plane) -> float:
        return LARGEST_VOLUME_STEP * max(state.V, plane.V_scale)


@dataclasses.dataclass(frozen=True)
class Gained(AddedVolume):
    """The cavity's volume beyond that at the path's first state."""

    def counted(self, start: float, undeformed: float) -> Gained:
        return dataclasses.replace(self, V0=start)


class DeadForce(Pressure):
    """A dead load's magnitude, where P is that."""

    name = "force"


@dataclasses.dataclass(frozen=True)
class Travel(Gained):
    """How far a dead load has moved what it acts on since the path's first state, where V is that."""

    name: ClassVar[str] = "travel"


DIRECT: dict[str, Quantity] = {one.name: one for one in (Pressure(), AddedVolume(), DeadForce(), Travel())}
"""What needs no supply, by name."""


class Supply(Quantity):
    """What drives the air where that is neither a pressure nor a volume alone: a value that is set, such as a stroke.

    With its value kept, the supply's pressure falls as the cavity takes volume, so that it holds some states past the
    pressure's limit point. Where its value has a limit point of its own along the path, the device jumps.

    Attributes:
        weight: Factor that brings an error of the value to the size of a pressure's or volume's, for Newton's method.
    """

    has_limits = True

    @property
    def weight(self) -> float:
        return 1.0

    def curve(self, value: float) -> Level:
        return Level(self, value)

    def line(self, V: float, P: float) -> Control:
        """Tangent of the curve through (V, P), as a direction, in units of `weight`."""
        a, b = self.slopes(V, P)
        return Control(self.weight * a, self.weight * b, 0.0)

    def limit_met(self, of_pressure: Point | None, own: Point | None) -> Point | None:
        return own


@dataclasses.dataclass(frozen=True)
class Level:
    """The curve on which a supply has one value: a `controls.Curve`."""

    supply: Supply
    target: float
    needs_volume: ClassVar[bool] = True

    @property
    def weight(self) -> float:
        return self.supply.weight

    def value(self, V: float, P: float) -> float:
        return self.supply.value(V, P)

    def slopes(self, V: float, P: float) -> tuple[float, float]:
        return self.supply.slopes(V, P)

    def line(self, V: float, P: float) -> Control:
        return self.supply.line(V, P)

    def at(self, target: float) -> Level:
        return Level(self.supply, target)


@dataclasses.dataclass(frozen=True)
class ArcLength:
    """The path's own length in its plane: followed where neither pressure nor volume rise, and never requested."""

    plane: Plane
    name: ClassVar[str] = "arc-length"

    def ahead(self, state: State, tangent: Tangent, step: float) -> Control:
        return self.plane.square_to(tangent, state, step)

    def rate(self, state: State, tangent: Tangent) -> float:
        along = (tangent.V, tangent.P)
        return self.plane.product(along, along) ** 0.5

    def first_step(self, plane: Plane, V0: float) -> float:
        return FIRST_STEP

    def largest_step(self, state: State, plane: Plane) -> float:
        return math.inf
