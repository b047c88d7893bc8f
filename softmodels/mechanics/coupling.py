"""How the pressures and volumes of several cavities are coupled, so that one pair (P, V) is left to follow.

Dead loads (`mechanics.dead_loads`) are drivers like cavities and come behind them: what is said here of a pressure and its
volume is meant of a load's magnitude and what it works on, too.

With cavity volumes V_i, the potential's load is

    P s.V + p0.V + m.(C V - d)

so each cavity's pressure is ``p = p0 + P s + C^T m``. P drives the cavities with a share s, and what it works on is
V = s.V_i, which makes (P, V) a work-conjugate pair as in a device of one cavity: same controls, same limit points. Pressures
p0 stay as they are. A volume that is held, or tied to another, is a constraint: a row of C, with a Lagrange multiplier m that
is an unknown of every solve.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


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
        """Every pressure a multiple of P, behind them dead loads that stay as they are."""
        count = len(ratios) + len(dead)
        shares, fixed = (np.zeros(count) for _ in range(2))
        shares[: len(ratios)], fixed[len(ratios) :] = ratios, dead
        return cls(shares, fixed, np.zeros((0, count)), np.zeros(0))

    @classmethod
    def by_pressure(cls, pressures: Array, changes: Array, held: Sequence[int], volumes: Array) -> Coupling:
        """P rises from 0 and changes the pressures in proportion to ``changes``; the largest of these changes as P does.

        Args:
            pressures: Those at the start, shape (k,).
            changes: By how much each is to change; the entries of held cavities are ignored.
            held: The cavities whose volumes are held.
            volumes: The volumes they are held at, shape (k,).
        """
        count = len(pressures)
        free = np.ones(count)
        free[list(held)] = 0.0
        shares = np.asarray(changes) * free
        rows = np.eye(count)[list(held)].reshape(-1, count)
        return cls(shares / np.abs(shares).max(), pressures * free, rows, rows @ volumes, tuple(held))

    @classmethod
    def by_volume(cls, pressures: Array, changes: Array, held: Sequence[int], volumes: Array) -> Coupling:
        """V changes by one volume, that of the cavity that changes most; the other held ones change in proportion.

        Args:
            pressures: Those at the start, shape (k,).
            changes: By how much each volume is to change, 0 for those that stay; of cavities in ``held`` alone.
            held: The cavities whose volumes are given, the others keep their pressures.
            volumes: Those at the start, shape (k,).
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
        """The cavities' pressures, shape (k,)."""
        return np.asarray(self.fixed_pressures + P * self.shares + self.constraints.T @ m)

    def multipliers(self, pressures: Array) -> Array:
        """The multipliers m that belong to pressures, shape (m,)."""
        return np.array([pressures[cavity] for cavity in self.multiplier_cavities])
