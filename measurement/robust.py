"""Fits and scatters that a few values far off do not move."""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

from softmodels.common.arrays import Array

DEVIATION_PER_MEDIAN = 1.4826
"""Standard deviation of normally distributed values over the median of their sizes."""

HUBER_DISTANCE = 2.0
"""Distance from the fit in its scatter from which a value counts less (Huber's weights)."""


def deviation(rest: Array) -> float:
    """Return the standard deviation of normally distributed values about zero, from the median of their sizes."""
    return float(deviations(rest, None))


def deviations(rest: npt.NDArray[np.floating], axis: int | tuple[int, ...] | None) -> Array:
    """Return the same along some axes of an array."""
    return np.asarray(DEVIATION_PER_MEDIAN * np.median(np.abs(rest), axis=axis))


@dataclasses.dataclass(frozen=True, eq=False)
class RobustFit:
    """A linear fit to n values by m terms: coefficients (m,), the fit at the values' places and their distances from it
    (n,), and the robust standard deviation of these."""

    coefficients: Array
    value: Array
    rest: Array
    scatter: float


def robust_fit(terms: Array, values: Array, rounds: int) -> RobustFit:
    """Return the least squares of values (n,) by terms (n, m), reweighted so many times."""
    weight = np.ones(len(values))
    for _ in range(rounds):
        coefficients = np.linalg.lstsq(terms * weight[:, None], values * weight, rcond=None)[0]
        value = terms @ coefficients
        rest = np.abs(values - value)
        scatter = deviation(rest) + 1e-9
        weight = np.sqrt(np.minimum(1.0, HUBER_DISTANCE * scatter / np.maximum(rest, 1e-15)))
    return RobustFit(coefficients, value, rest, scatter)
