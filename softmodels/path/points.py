"""Points of a load path, and where it ends."""

from __future__ import annotations

import abc
import dataclasses
import math
from typing import ClassVar

from softmodels.common.arrays import Array
from softmodels.mechanics.component import PathFailure
from softmodels.mechanics.controls import Control, Curve, Tangent, pressure_control, volume_control
from softmodels.mechanics.system import State
from softmodels.path.stability import Signature


@dataclasses.dataclass(frozen=True, eq=False)
class Point:
    """One state of a path.

    Attributes:
        state: The state (dimensionless).
        tangent: Direction of the path there.
        requested: Whether this is one of the requested values.
        limit: Whether this is a limit point of the pressure.
        step: Length of the next step in units of ``line``.
        line: The control at this point: pressure, volume or arc-length.
        stiffest: Least |dV/dP| on the path so far.
        signature: Number of negative eigenvalues and the lowest eigenvalue.
        mode: At a bifurcation the shape in which the device leaves the path: local dofs, largest entry 1 or -1; else None.
        jump: Whether the device has jumped here: from the state before, or from the last turn of a supply's stroke.
        turn: Whether this is a limit point of a supply's stroke.
    """

    state: State
    tangent: Tangent
    requested: bool
    limit: bool
    step: float
    line: str
    stiffest: float
    signature: Signature = dataclasses.field(default_factory=Signature)
    mode: Array | None = None
    jump: bool = False
    turn: bool = False

    @property
    def bifurcation(self) -> bool:
        return self.mode is not None

    @property
    def stable_under_pressure(self) -> bool:
        return self.signature.negative_eigenvalues == 0

    @property
    def stable_under_volume(self) -> bool:
        """Whether the state is stable under a given cavity volume."""
        return self.stable_under(volume_control(self.state.V))

    def stable_under(self, control: Control) -> bool:
        """Return whether the state is stable if pressure and volume are tied by a line a V + b P = d, neither a nor b
        negative; of a gas law its tangent at this state.

        What drives the air then gives way by dP = -k dV, k = a/b, and adds k q q^T to K. That takes one of the negative
        eigenvalues away where 1 + k q.K^-1 q = 1 + k dV/dP is negative, and else changes nothing (Sylvester's law again).
        """
        t = self.tangent
        rate = control.volume_coefficient * t.V + control.pressure_coefficient * t.P
        return self.signature.negative_eigenvalues == int(rate * t.P < 0)


class PathEnd(Exception):
    """The path cannot reach the requested value: ``why`` is a clause, ``limit`` the limit point met, ``cause`` what happens
    there where that is an end of the device's own and no limit point of what drives it."""

    def __init__(self, why: str, limit: Point | None = None, cause: PathFailure | None = None):
        super().__init__(why)
        self.limit, self.cause = limit, cause

    @property
    def physical(self) -> bool:
        """Whether no equilibrium exists beyond it, as opposed to a failure of the method."""
        return self.limit is not None or (self.cause is not None and not self.cause.of_mesh)


# ----------------------------------------------------------------------------------------------------------------------
# Requested quantities and controls of a path: functions of cavity volume and pressure with prescribed values.
#
# A path does not distinguish pressures, volumes and strokes. A `PathQuantity` provides its value at a state, the
# curve of constant value in the volume-pressure plane, its rate along a tangent and a first step. A new supply is one
# subclass of `Supply` with a name, a value and two slopes. All figures are dimensionless, as in `softmodels.mechanics`.


FIRST_STEP = 0.1
"""First step of a path, in the device's scales of volume and pressure."""
LOCKED_BELOW = 1e-12
"""dV/dP, in volumes per shear modulus, below which the device counts as rigid: the stiffest parts leave 1e-8, rounding
1e-18."""
LARGEST_VOLUME_STEP = 0.2
"""First step in volume after a switch to volume control, in cavity volumes."""


@dataclasses.dataclass(frozen=True)
class ArcLengthMetric:
    """The volume-pressure plane, with the scales of arc lengths."""

    V_scale: float
    P_scale: float

    @classmethod
    def of(cls, V_scale: float, compliance: float) -> ArcLengthMetric:
        """Return the plane scaled by the device's compliance dV/dP."""
        return cls(V_scale, V_scale / max(abs(compliance), LOCKED_BELOW * V_scale))

    def felt(self, compliance: float) -> float:
        """Return |dV/dP|, but at least the value below which only rounding is left."""
        return max(abs(compliance), LOCKED_BELOW * self.V_scale)

    def locked(self, compliance: float) -> bool:
        """Return whether a dV/dP means that nothing moves."""
        return abs(compliance) <= LOCKED_BELOW * self.V_scale

    def stiffened(self, compliance: float) -> ArcLengthMetric:
        """Return the plane scaled at the stiffest state, by the smallest dV/dP on the path: for a flat membrane the scale at
        rest soon becomes meaningless."""
        return dataclasses.replace(self, P_scale=max(self.P_scale, self.V_scale / compliance))

    def product(self, a: tuple[float, float], b: tuple[float, float]) -> float:
        """Return the inner product of two changes (dV, dP)."""
        return a[0] * b[0] / self.V_scale**2 + a[1] * b[1] / self.P_scale**2

    def square_to(self, tangent: Tangent, state: State, step: float = 0.0) -> Control:
        """Return the line perpendicular to a tangent, ``step`` away from a state."""
        a, b = tangent.V / self.V_scale, tangent.P / self.P_scale
        norm = (a * a + b * b) ** 0.5
        line = Control(a / norm / self.V_scale, b / norm / self.P_scale, 0.0)
        return line.at(line.value(state.V, state.P) + step)


class PathQuantity(abc.ABC):
    """A function of volume and pressure whose values can be requested of a path.

    Attributes:
        name: As in the column ``control`` of ``path.csv``.
        ends_at_pressure_limit: Whether there is no state with a higher value beyond a limit point of the pressure.
        has_limits: Whether it can have limit points of its own beside the pressure's.
    """

    name: ClassVar[str]
    ends_at_pressure_limit: ClassVar[bool] = False
    has_limits: ClassVar[bool] = False

    @abc.abstractmethod
    def value(self, V: float, P: float) -> float:
        """Return its value."""

    @abc.abstractmethod
    def slopes(self, V: float, P: float) -> tuple[float, float]:
        """Return its derivatives by volume and by pressure."""

    @abc.abstractmethod
    def curve(self, value: float) -> Curve:
        """Return the curve on which it has a value."""

    def counted(self, start: float, undeformed: float) -> PathQuantity:
        """Return the same for a path that starts at the volume ``start`` instead of the undeformed one."""
        return self

    def starts_forward(self, state: State, tangent: Tangent) -> bool:
        """Return whether a tangent at a path's first state leads to higher values."""
        return not self.rate(state, tangent) < 0.0

    def exactly(self, state: State, value: float) -> State:
        """Return a state solved at a value, with exactly that value if it is part of
        the state."""
        return state

    def limit_met(self, of_pressure: Point | None, own: Point | None) -> Point | None:
        """Return the limit point that prevented a value from being reached."""
        return None

    def ahead(self, state: State, tangent: Tangent, step: float) -> Curve:
        """Return the curve ``step`` ahead of a state."""
        return self.curve(self.value(state.V, state.P) + step)

    def rate(self, state: State, tangent: Tangent) -> float:
        """Return the change along a tangent."""
        a, b = self.slopes(state.V, state.P)
        return a * tangent.V + b * tangent.P

    def slope(self, point: Point) -> float:
        """Return the derivative by the volume along the path."""
        a, b = self.slopes(point.state.V, point.state.P)
        return a + b * point.tangent.P / point.tangent.V

    def first_step(self, plane: ArcLengthMetric, V0: float) -> float:
        """Return the length of a path's first step from the volume V0."""
        a, b = self.slopes(V0, 0.0)
        return FIRST_STEP * (a * plane.V_scale + b * plane.P_scale)

    def largest_step(self, state: State, plane: ArcLengthMetric) -> float:
        """Return the longest first step after a switch to this control."""
        return math.inf


class Pressure(PathQuantity):
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
class AddedVolume(PathQuantity):
    """The cavity's volume minus that of the undeformed device, ``V0``; a path puts in its own."""

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

    def largest_step(self, state: State, plane: ArcLengthMetric) -> float:
        return LARGEST_VOLUME_STEP * max(state.V, plane.V_scale)


@dataclasses.dataclass(frozen=True)
class VolumeGain(AddedVolume):
    """The cavity's volume minus that at the path's first state."""

    def counted(self, start: float, undeformed: float) -> VolumeGain:
        return dataclasses.replace(self, V0=start)


class DeadForce(Pressure):
    """A dead load's magnitude, if that is P."""

    name = "force"


@dataclasses.dataclass(frozen=True)
class LoadDisplacement(VolumeGain):
    """Travel of a dead load since the path's first state, if that is V."""

    name: ClassVar[str] = "travel"


DIRECT: dict[str, PathQuantity] = {
    one.name: one for one in (Pressure(), AddedVolume(), DeadForce(), LoadDisplacement())
}
"""Quantities without a supply, by name."""


class Supply(PathQuantity):
    """An air supply driven by a prescribed value, such as a stroke, instead of a pressure or volume.

    With its value kept, the supply's pressure falls as the cavity takes volume, so that it holds some states past the
    pressure's limit point. Where its value has a limit point of its own along the path, the device jumps. ``weight`` brings an
    error of the value to the size of a pressure's or volume's, for Newton's method.
    """

    has_limits = True

    @property
    def weight(self) -> float:
        return 1.0

    def curve(self, value: float) -> SupplyCurve:
        return SupplyCurve(self, value)

    def line(self, V: float, P: float) -> Control:
        """Return the tangent of the curve through (V, P), as a direction, in units of `weight`."""
        a, b = self.slopes(V, P)
        return Control(self.weight * a, self.weight * b, 0.0)

    def limit_met(self, of_pressure: Point | None, own: Point | None) -> Point | None:
        return own


@dataclasses.dataclass(frozen=True)
class SupplyCurve:
    """The curve of constant value of a supply: a `controls.Curve`."""

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

    def at(self, target: float) -> SupplyCurve:
        return SupplyCurve(self.supply, target)


@dataclasses.dataclass(frozen=True)
class ArcLength:
    """The arc length in the volume-pressure plane: a control where neither pressure nor volume rise, never requested."""

    plane: ArcLengthMetric
    name: ClassVar[str] = "arc-length"

    def ahead(self, state: State, tangent: Tangent, step: float) -> Control:
        return self.plane.square_to(tangent, state, step)

    def rate(self, state: State, tangent: Tangent) -> float:
        along = (tangent.V, tangent.P)
        return self.plane.product(along, along) ** 0.5

    def first_step(self, plane: ArcLengthMetric, V0: float) -> float:
        return FIRST_STEP

    def largest_step(self, state: State, plane: ArcLengthMetric) -> float:
        return math.inf


type ContinuationParameter = PathQuantity | ArcLength
"""A control of a path."""
