"""Groups of residuals, such as those of one curve or photograph: what they are, and how far neighbours keep together."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

SHORTEST = 8
"""Groups with fewer residuals than this tell nothing about the correlation along them."""


@dataclasses.dataclass(frozen=True)
class Rows:
    """What each measured residual belongs to: its group, and the size and unit of a residual of 1."""

    groups: list[str]
    sizes: list[float]
    units: list[str]


@dataclasses.dataclass(frozen=True)
class GroupSummary:
    """Residuals of one group, in ``unit``: root mean square, mean and largest (with its sign).

    Attributes:
        count: How many.
        run: Over how many neighbours they keep together; 1 for independent scatter.
    """

    unit: str
    count: int
    rms: float
    mean: float
    largest: float
    run: float


def autocorrelation_time(r: Array) -> float:
    """Sum of the autocorrelation over all lags, at least 1: how many neighbours are worth one independent value.

    The sum ends at the first lag whose correlation could be chance (2 / sqrt(n)).

    Args:
        r: Values in their order, shape (n,).
    """
    n = len(r)
    power = float(np.sum(r**2))
    if n < SHORTEST or power == 0.0:
        return 1.0
    total = 1.0
    for lag in range(1, n // 2):
        correlation = float(np.sum(r[lag:] * r[:-lag])) / power
        if correlation < 2 / math.sqrt(n):
            break
        total += 2 * correlation
    return min(total, n / 2)
