"""Controls: curves in the plane of cavity pressure and volume, most often lines.

The pressure P is an unknown of every solve. Its equation is ``a V + b P = target``: pressure control,
volume control and arc length are three pairs of numbers, and pass limit points with the same solver. A gas law
(`softmodels.path.supply`) is a function of V and P instead, of which Newton's method takes the tangent.
All figures are dimensionless (P in shear moduli, V in cubed sizes of the device).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from softmodels.common.arrays import Array


class Curve(Protocol):
    """Interface of a control: its left side, slopes, and tangent line."""

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
        """Return the slopes of the left side to V and P, the same everywhere."""
        return self.volume_coefficient, self.pressure_coefficient

    def line(self, V: float, P: float) -> Control:
        """Return the tangent: the line itself."""
        return self

    def at(self, target: float) -> Control:
        """Return the parallel line with another target."""
        return dataclasses.replace(self, target=target)


def pressure_control(P: float) -> Control:
    return Control(0.0, 1.0, P)


def volume_control(V: float) -> Control:
    return Control(1.0, 0.0, V)


# ----------------------------------------------------------------------------------------------------------------------
# Coupling of several cavities' pressures and volumes to a single pair (P, V).
#
# Dead loads (`mechanics.dead_loads`) are drivers like cavities and follow them in the order: pressure and volume
# also mean a load's magnitude and its travel here.
#
# With cavity volumes V_i, the potential's load is
#
#     P s.V + p0.V + m.(C V - d)
#
# so each cavity's pressure is ``p = p0 + P s + C^T m``. P drives the cavities with shares s; its conjugate is V
# = s.V_i, so (P, V) is a work-conjugate pair as in a device of one cavity: same controls, same limit points. Pressures
# p0 are constant. A volume that is held, or tied to another, is a constraint: a row of C, with a Lagrange multiplier m that
# is an unknown of every solve.


@dataclasses.dataclass(frozen=True, eq=False)
class Coupling:
    """One coupling of k cavities, dimensionless.

    Attributes:
        shares: Share s of P in each cavity's pressure, shape (k,).
        fixed_pressures: Pressures p0 that do not change, shape (k,).
        constraints: Rows C of volumes' combinations that are held, shape (m, k).
        constrained_volumes: Their values d, shape (m,).
        multiplier_cavities: The cavities whose pressures the multipliers are, m of them.
    """

    shares: Array
    fixed_pressures: Array
    constraints: Array
    constrained_volumes: Array
    multiplier_cavities: tuple[int, ...] = ()

    @classmethod
    def proportional(cls, ratios: Sequence[float], dead: Array | Sequence[float] = ()) -> Coupling:
        """Couple every pressure as a multiple of P, followed by constant dead loads."""
        count = len(ratios) + len(dead)
        shares, fixed = (np.zeros(count) for _ in range(2))
        shares[: len(ratios)], fixed[len(ratios) :] = ratios, dead
        return cls(shares, fixed, np.zeros((0, count)), np.zeros(0))

    @classmethod
    def by_pressure(cls, pressures: Array, changes: Array, held: Sequence[int], volumes: Array) -> Coupling:
        """Couple the pressures so that P rises from 0 and they change from ``pressures`` in proportion to ``changes``, the
        largest by P; all of shape (k,). The cavities ``held`` stay at their ``volumes``, whatever their change."""
        count = len(pressures)
        free = np.ones(count)
        free[list(held)] = 0.0
        shares = np.asarray(changes) * free
        rows = np.eye(count)[list(held)].reshape(-1, count)
        return cls(shares / np.abs(shares).max(), pressures * free, rows, rows @ volumes, tuple(held))

    @classmethod
    def by_volume(cls, pressures: Array, changes: Array, held: Sequence[int], volumes: Array) -> Coupling:
        """Couple the volumes so that V is that of the cavity that changes most, and the other ``held`` ones change in
        proportion.

        Pressures, changes (0 for volumes that stay) and volumes are those at the start, shape (k,); cavities that are not held
        keep their pressures.
        """
        count = len(pressures)
        lead = max(held, key=lambda cavity: abs(changes[cavity]))
        shares = np.sign(changes[lead]) * np.eye(count)[lead]
        others = [cavity for cavity in held if cavity != lead]
        rows = np.array([np.eye(count)[c] - changes[c] / changes[lead] * np.eye(count)[lead] for c in others])
        rows = rows.reshape(-1, count)
        # P counts from 0: the lead's pressure at the start is a fixed one, and the multipliers are the others' own pressures.
        free = np.array(pressures, dtype=float)
        free[others] = 0.0
        free[lead] -= float((rows.T @ pressures[others])[lead])
        return cls(shares, free, rows, rows @ volumes, tuple(others))

    def pressures(self, P: float, m: Array) -> Array:
        """Return the cavities' pressures, shape (k,)."""
        return np.asarray(self.fixed_pressures + P * self.shares + self.constraints.T @ m)

    def multipliers(self, pressures: Array) -> Array:
        """Return the multipliers m that belong to pressures, shape (m,)."""
        return np.array([pressures[cavity] for cavity in self.multiplier_cavities])


# ----------------------------------------------------------------------------------------------------------------------
# The direction of a path at a state.


@dataclasses.dataclass(frozen=True, eq=False)
class Tangent:
    """Direction of the path at a state: changes of w (shape as `State.w`), P and V; P rises where V does and dP > 0.

    The compliance dV/dP is infinite at a limit point and negative past it.
    """

    w: Array
    P: float
    V: float

    @property
    def compliance(self) -> float:
        return self.V / self.P if self.P else math.inf

    def __neg__(self) -> Tangent:
        return Tangent(-self.w, -self.P, -self.V)
