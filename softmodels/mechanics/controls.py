"""A control is a curve in the plane of cavity pressure and volume, most often a line.

The pressure P is an unknown of every solve. Its equation is ``a V + b P = target``: pressure control,
volume control and arc length are three pairs of numbers, and pass limit points through one and the same solver. A gas law
(`softmodels.path.syringe`) is a function of V and P instead, of which Newton's method takes the tangent.
All figures are dimensionless (P in shear moduli, V in cubed sizes of the device).
"""

from __future__ import annotations

import dataclasses
from typing import Protocol


class Curve(Protocol):
    """What a control offers: its left side, that side's slopes, and the tangent line that they make."""

    @property
    def target(self) -> float: ...
    @property
    def needs_volume(self) -> bool: ...
    @property
    def weight(self) -> float: ...
    def value(self, V: float, P: float) -> float: ...
    def slopes(self, V: float, P: float) -> tuple[float, float]: ...
    def line(self, V: float, P: float) -> Control: ...
    def at(self, target: float) -> Curve: ...


@dataclasses.dataclass(frozen=True)
class Control:
    """The line ``a V + b P = target``."""

    volume_coefficient: float
    pressure_coefficient: float
    target: float

    def value(self, V: float, P: float) -> float:
        """Left side of the line's equation at a state."""
        return self.volume_coefficient * V + self.pressure_coefficient * P

    @property
    def weight(self) -> float:
        """Factor of the equation's error in Newton's method."""
        return 1.0

    @property
    def needs_volume(self) -> bool:
        return self.volume_coefficient != 0.0

    def slopes(self, V: float, P: float) -> tuple[float, float]:
        """Slopes of the left side to V and P, the same everywhere."""
        return self.volume_coefficient, self.pressure_coefficient

    def line(self, V: float, P: float) -> Control:
        """The tangent: the line itself."""
        return self

    def at(self, target: float) -> Control:
        """The parallel line with another target."""
        return dataclasses.replace(self, target=target)


def pressure_control(P: float) -> Control:
    return Control(0.0, 1.0, P)


def volume_control(V: float) -> Control:
    return Control(1.0, 0.0, V)


def arc_length(V: float, P: float, dV: float, dP: float, step: float, V_scale: float, P_scale: float) -> Control:
    """The line square to the path's tangent (dV, dP), ``step`` away from the state (V, P).

    Lengths in the plane are measured in ``V_scale`` and ``P_scale``.
    """
    a, b = dV / V_scale, dP / P_scale
    norm = (a * a + b * b) ** 0.5
    line = Control(a / norm / V_scale, b / norm / P_scale, 0.0)
    return line.at(line.value(V, P) + step)
