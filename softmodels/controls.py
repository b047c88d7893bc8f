"""A control is a line in the plane of cavity pressure and volume.

The pressure P is an unknown of every solve. Its equation is ``volume * V + pressure * P = target``: pressure control,
volume control and arc length are three pairs of numbers, and pass limit points through one and the same solver.
All figures are dimensionless (P in shear moduli, V in cubed sizes of the device).
"""

from __future__ import annotations

import dataclasses


@dataclasses.dataclass(frozen=True)
class Control:
    """The line ``volume * V + pressure * P = target``."""

    volume: float
    pressure: float
    target: float

    def value(self, V: float, P: float) -> float:
        """Left side of the line's equation at a state."""
        return self.volume * V + self.pressure * P

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
