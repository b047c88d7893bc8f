"""The smooth course of pressure over height through a run's photographs, and what it expects of each from all the others.

A bulge's pressure is one smooth function of its height even where it has a greatest value (a limit point), where a volume is
driven and the pressure falls, and on both sides of a snap: its height is none of its pressure there. So the course is
p(h), and a photograph is compared with what the others predict at its height.

The course is a Gaussian process: a straight line and the integrals of white noise, twice (the cubic smoothing spline) or
three times, whose size, and a scatter beyond the readings' errors (creep, a leak, friction), are not fitted but averaged
over with the weight that the other photographs give them. C. E. Rasmussen, C. K. I. Williams, Gaussian Processes for Machine
Learning (2006), sections 5.4.2 (leaving one out) and 6.3 (splines).
"""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt
from scipy.stats import norm

Array = npt.NDArray[np.float64]

ROUGHNESS = np.geomspace(0.1, 40.0, 7)
"""Sizes of the white noise, for pressure and height in units of their greatest values."""

USUAL, SPREAD = 2.0, 1.2
"""Roughness that is likeliest beforehand, and how far in natural logarithms it may well be from that."""

SCATTER = np.array([0.0, 0.0025, 0.005, 0.01, 0.03])
"""Scatter of the pressures beyond their errors in units of the greatest one."""

LIKELY = np.array([0.3, 0.2, 0.2, 0.2, 0.1])
"""How likely each scatter is beforehand."""

ANYWHERE = 10.0
"""Standard deviation of the line's height and slope beforehand: nothing is known of them."""

BENT, BEFORE = 3.0, 0.2
"""Standard deviation of the parabola's coefficient beforehand, and how far before the lowest point the noise begins."""

TIMES = (2, 3)
"""Times that the white noise is integrated."""


@dataclasses.dataclass(frozen=True, eq=False)
class Course:
    """The course through some points.

    Attributes:
        heights: Their heights in m, shape (n,).
        pressures: Their pressures in Pa, shape (n,).
        errors: Standard errors of the pressures in Pa, those of the heights taken along, shape (n,).
    """

    heights: Array
    pressures: Array
    errors: Array

    @classmethod
    def through(cls, heights: Array, pressures: Array, height_errors: Array, pressure_errors: Array) -> Course:
        """The course through points with errors in both directions, shapes (n,), in m and Pa."""
        plain = cls(heights, pressures, np.hypot(pressure_errors, 1e-4 * np.abs(pressures).max()))
        slope = plain.slope(heights)
        return dataclasses.replace(plain, errors=np.hypot(plain.errors, slope * height_errors))

    @property
    def scale(self) -> tuple[float, float]:
        """Greatest height in m and pressure in Pa, in which the course is told."""
        return max(float(np.ptp(self.heights)), 1e-9), max(float(np.abs(self.pressures).max()), 1e-9)

    def left_out(self) -> tuple[Array, Array, Array]:
        """What all the others expect of each point.

        Returns:
            Expected pressure in Pa, its standard error (the course's, the scatter's and the reading's own), and the
            probability that a good point is as far off; shapes (n,).
        """
        u, q, noise = self._scaled()
        root, evidence, _ = _models(u, q, noise)
        precision = np.einsum("mji,mji->mi", root, root)
        pull = np.einsum("mji,mj->mi", root, root @ q)
        mean, deviation = q - pull / precision, 1.0 / np.sqrt(precision)
        alone = norm.logpdf(q, mean, deviation)
        weight = _weights(evidence[:, None] - alone)
        expected = np.sum(weight * mean, axis=0)
        spread = np.sqrt(np.sum(weight * (deviation**2 + (mean - expected) ** 2), axis=0))
        tail = np.sum(weight * 2.0 * norm.sf(np.abs(q - mean) / deviation), axis=0)
        pressure = self.scale[1]
        return expected * pressure, spread * pressure, tail

    def at(self, heights: Array, errors: Array | float = 0.0) -> tuple[Array, Array, Array]:
        """Expected pressure of further points, as `left_out` for theirs; ``errors`` are their readings' in Pa.

        Returns:
            Expected pressure and its standard error in Pa, shapes (k,), and the tails' table for `tail`.
        """
        u, q, noise = self._scaled()
        length, pressure = self.scale
        v = (np.asarray(heights) - self.heights.min()) / length
        root, evidence, scatter = _models(u, q, noise)
        weight = _weights(evidence)
        cross, own = _prior(v, u), _prior(v, v, diagonal=True)
        pulled = cross @ root.transpose(0, 2, 1)
        mean = np.einsum("mkn,mn->mk", pulled, root @ q)
        variance = own - np.einsum("mkn,mkn->mk", pulled, pulled) + scatter[:, None] ** 2
        variance = np.maximum(variance, 1e-12) + (np.asarray(errors) / pressure) ** 2
        expected = np.einsum("m,mk->k", weight, mean)
        spread = np.sqrt(np.einsum("m,mk->k", weight, variance + (mean - expected) ** 2))
        table = np.stack([np.broadcast_to(weight[:, None], mean.shape), mean, np.sqrt(variance)])
        return expected * pressure, spread * pressure, table

    def tail(self, table: Array, pressures: Array) -> Array:
        """Probability that a good point is as far off as these pressures (k,) in Pa, by the table of `at`."""
        weight, mean, deviation = table
        return np.asarray(np.sum(weight * 2.0 * norm.sf(np.abs(pressures / self.scale[1] - mean) / deviation), axis=0))

    def height(self, pressure: float, near: float) -> tuple[float, float] | None:
        """Height in m, the nearest to ``near``, at which the course has a pressure, and its standard error; None if nowhere."""
        low, high = float(self.heights.min()), float(self.heights.max())
        reach = np.linspace(low - 0.1 * (high - low), high + 0.1 * (high - low), 400)
        expected, spread, _ = self.at(reach)
        off = expected - pressure
        crossing = np.nonzero(off[1:] * off[:-1] <= 0.0)[0]
        if not len(crossing):
            return None
        k = min(crossing, key=lambda k: abs(reach[k] - near))
        slope = (expected[k + 1] - expected[k]) / (reach[k + 1] - reach[k])
        if slope == 0.0:
            return None
        return float(reach[k] - off[k] / slope), float(spread[k] / abs(slope))

    def _scaled(self) -> tuple[Array, Array, Array]:
        length, pressure = self.scale
        return (self.heights - self.heights.min()) / length, self.pressures / pressure, self.errors / pressure

    def slope(self, heights: Array) -> Array:
        """Slope of the course in Pa/m at heights (k,)."""
        step = 1e-3 * self.scale[0]
        above, below = self.at(heights + step)[0], self.at(heights - step)[0]
        return np.abs(above - below) / (2.0 * step)


def _models(u: Array, q: Array, noise: Array) -> tuple[Array, Array, Array]:
    """Inverse roots L^-1 of the covariances L L^T (m, n, n), logarithms of the evidence (m,), and scatters (m,).

    Roots, because the line's wide prior leaves inverses of the covariances themselves with few digits.
    """
    prior = _prior(u, u)
    scatter = np.tile(SCATTER, len(prior) // len(SCATTER))
    matrix = prior + (scatter[:, None] ** 2 + noise**2)[:, :, None] * np.eye(len(u))
    lower = np.linalg.cholesky(matrix)
    root = np.linalg.solve(lower, np.broadcast_to(np.eye(len(u)), matrix.shape))
    size = 2.0 * np.log(np.einsum("mii->mi", lower)).sum(axis=1)
    fit = np.sum((root @ q) ** 2, axis=1)
    before = [
        np.log(likely) - 0.5 * (np.log(rough / USUAL) / SPREAD) ** 2
        for _ in TIMES for rough in ROUGHNESS for likely in LIKELY
    ]  # fmt: skip
    return root, -0.5 * (fit + size) + np.array(before), scatter


def _prior(v: Array, u: Array, diagonal: bool = False) -> Array:
    """Covariances (m, k, n) of the course at v (k,) and u (n,), or its variances (m, k) at v; one per model."""
    product = v * v if diagonal else v[:, None] * u
    first, second = (v, v) if diagonal else (v[:, None], u[None, :])
    found = []
    for times in TIMES:
        # Noise that is integrated three times leaves a parabola open, not only a line.
        known = ANYWHERE**2 * (1.0 + product) + (BENT**2 * product**2 if times > 2 else 0.0)
        kernel = _integrated(first, second, times)
        found += [known + rough**2 * kernel for rough in ROUGHNESS for _ in SCATTER]
    return np.stack(found)


def _integrated(v: Array, u: Array, times: int) -> Array:
    """Covariance of white noise integrated two or three times from a place before all points."""
    v, u = np.maximum(v + BEFORE, 0.0), np.maximum(u + BEFORE, 0.0)
    least, apart = np.minimum(v, u), np.abs(v - u)
    if times == 2:
        return np.asarray(least**3 / 3.0 + apart * least**2 / 2.0)
    return np.asarray(least**5 / 20.0 + apart * least**4 / 8.0 + apart**2 * least**3 / 12.0)


def _weights(logarithms: Array) -> Array:
    weight = np.exp(logarithms - logarithms.max(axis=0))
    return np.asarray(weight / weight.sum(axis=0))
