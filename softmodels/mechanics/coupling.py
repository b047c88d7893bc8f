"""How the pressures and volumes of several cavities hang together, so that one pair (P, V) is left to follow.

With cavity volumes V_i, the potential's load is

    P along.V + apart.V + m.(held V - kept)

so each cavity's pressure is ``p = apart + P along + held^T m``. P drives the cavities with an entry in ``along``, and what it
works on is V = along.V_i, which makes (P, V) a pair as in a device of one cavity: same controls, same limit points. Some
pressures stay as they are, in ``apart``. A volume that is held, or tied to another, has a row in ``held`` and a multiplier m,
an unknown of every solve.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True, eq=False)
class Drive:
    """One way to drive k cavities, dimensionless.

    Attributes:
        along: Share of P in each cavity, shape (k,).
        apart: Pressures that do not change, shape (k,).
        held: Combinations of the volumes that are kept, shape (m, k).
        kept: Their values, shape (m,).
        whose: The cavities whose pressures the multipliers are, m of them.
    """

    along: Array
    apart: Array
    held: Array
    kept: Array
    whose: tuple[int, ...] = ()

    @classmethod
    def proportional(cls, ratios: Sequence[float]) -> Drive:
        """Every pressure a multiple of P."""
        return cls(np.array(ratios, dtype=float), np.zeros(len(ratios)), np.zeros((0, len(ratios))), np.zeros(0))

    @classmethod
    def by_pressure(cls, pressures: Array, changes: Array, held: Sequence[int], volumes: Array) -> Drive:
        """P rises from 0 and changes the pressures in proportion to ``changes``; the largest of these changes as P does.

        Args:
            pressures: Those at the start, shape (k,).
            changes: By how much each is to change; what is said of held cavities does not count.
            held: The cavities whose volumes are kept.
            volumes: What they are kept at, shape (k,).
        """
        count = len(pressures)
        free = np.ones(count)
        free[list(held)] = 0.0
        along = np.asarray(changes) * free
        rows = np.eye(count)[list(held)].reshape(-1, count)
        return cls(along / np.abs(along).max(), pressures * free, rows, rows @ volumes, tuple(held))

    @classmethod
    def by_volume(cls, pressures: Array, changes: Array, held: Sequence[int], volumes: Array) -> Drive:
        """V changes by one volume, that of the cavity that changes most; the other held ones change in proportion.

        Args:
            pressures: Those at the start, shape (k,).
            changes: By how much each volume is to change, 0 for those that stay; of cavities in ``held`` alone.
            held: The cavities whose volumes are given, the others keep their pressures.
            volumes: Those at the start, shape (k,).
        """
        count = len(pressures)
        lead = max(held, key=lambda cavity: abs(changes[cavity]))
        along = np.sign(changes[lead]) * np.eye(count)[lead]
        others = [cavity for cavity in held if cavity != lead]
        rows = np.array([np.eye(count)[c] - changes[c] / changes[lead] * np.eye(count)[lead] for c in others])
        rows = rows.reshape(-1, count)
        # P counts from 0: what the lead has at the start is apart, and the multipliers are the others' own pressures.
        free = np.array(pressures, dtype=float)
        free[others] = 0.0
        free[lead] -= float((rows.T @ pressures[others])[lead])
        return cls(along, free, rows, rows @ volumes, tuple(others))

    def pressures(self, P: float, m: Array) -> Array:
        """The cavities' pressures, shape (k,)."""
        return np.asarray(self.apart + P * self.along + self.held.T @ m)

    def multipliers(self, pressures: Array) -> Array:
        """The multipliers m that belong to pressures, shape (m,)."""
        return np.array([pressures[cavity] for cavity in self.whose])
