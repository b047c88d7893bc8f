"""Several specimens of one silicone: their law is the mean, and the scatter between them makes its intervals and its band.

A specimen's parameters scatter about the silicone's with one variance, its readings about its curve with another. Only the
first is left in the mean of several curves of many readings, so it is estimated from the specimens as a whole: by leaving each
out in turn (jackknife; Tukey 1958, Bell & McCaffrey 2002), with Student's quantile for so few.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Sequence

import numpy as np
from scipy.special import stdtr, stdtrit

from softmodels.common import names, units
from softmodels.common.arrays import Array
from softmodels.fitting import least_squares
from softmodels.fitting.curves.curve import TensileCurve
from softmodels.fitting.curves.residuals import ORIGIN, TensileResiduals

MIN_SPECIMENS = 3
"""Least number of curves of each kind of test that are a sample: two show no scatter to rely on."""
LEAST_SCATTER, SIGNIFICANCE_LEVEL = 0.01, 0.05
"""Least scatter between specimens, as a share of the stress, by which one of them is found to differ; and the share of samples
of like specimens in which one is named nevertheless."""


def is_sample(curves: Sequence[TensileCurve]) -> bool:
    """Return whether there are several specimens in each kind of test."""
    modes = [curve.mode for curve in curves]
    return bool(modes) and min(map(modes.count, modes)) >= MIN_SPECIMENS


@dataclasses.dataclass(frozen=True, eq=False)
class SampleFit(least_squares.LeastSquaresFit):
    """A joint fit of specimens, which is the mean of theirs, with error bars from the scatter between them."""

    @classmethod
    def of(cls, fit: least_squares.LeastSquaresFit, load_cell: float) -> SampleFit:
        """Return a fit of whose curves each is a specimen; all were measured by a load cell with this relative error."""
        values = {field.name: getattr(fit, field.name) for field in dataclasses.fields(fit)}
        sources: Sequence[TensileResiduals] = fit.problem.sources  # type: ignore[assignment]
        measured = np.concatenate([source.curve.stress / source.errors for source in sources])
        shared = load_cell * (fit.residuals[: fit.count] + measured)[:, None] if load_cell else None
        made = cls(**{**values, "shared": shared})
        others = (trouble for trouble in fit.troubles if trouble not in fit.misfits)
        return dataclasses.replace(made, troubles=(*others, *made.misfits))

    @property
    def unexplained(self) -> Array:
        """Residuals about the law times each specimen's own factor; see the base class."""
        sources: Sequence[TensileResiduals] = self.problem.sources  # type: ignore[assignment]
        law = self.residuals[: self.count] + np.concatenate([source.curve.stress / source.errors for source in sources])
        parts, labels = self.residuals[: self.count].copy(), np.array(self.rows.groups)
        for label in self.runs:
            own = labels == label
            parts[own] -= law[own] * float(law[own] @ parts[own]) / float(law[own] @ law[own])
        return parts

    @property
    def specimens(self) -> int:
        return len(self.runs)

    @property
    def freedom(self) -> int:
        """Degrees of freedom of the scatter: the specimens, but for a mean in each kind of test."""
        sources: Sequence[TensileResiduals] = self.problem.sources  # type: ignore[assignment]
        return self.specimens - len({source.curve.mode for source in sources})

    @property
    def quantile(self) -> float:
        return float(stdtrit(self.freedom, (1 + least_squares.CONFIDENCE_LEVEL) / 2))

    @functools.cached_property
    def between(self) -> Array:
        """Covariance of the mean by the scatter between the specimens, shape (m, m); nan for parameters at a bound. What a
        specimen has of its own, its slack and the load cell's zero, is uncertain by its own readings."""
        inside, n = [i for i in self.inside if not self.free[i].name.startswith(ORIGIN)], self.specimens
        private = [i for i in self.inside if i not in inside]
        full = np.full((len(self.free), len(self.free)), np.nan)
        if private:
            full[np.ix_(private, private)] = self._sandwich(self.jacobian[:, self.inside])[
                np.ix_(*2 * [[self.inside.index(i) for i in private]])
            ]
            full[np.ix_(private, inside)] = full[np.ix_(inside, private)] = 0.0
        if not inside:
            return full
        psi, slope = self.influence
        J = self.jacobian[:, inside]
        if private:  # Frisch & Waugh 1933
            Q = np.linalg.qr(self.jacobian[:, private])[0]
            J = J - Q @ (Q.T @ J)
        size = np.linalg.norm(J, axis=0)
        size[size == 0.0] = 1.0
        J, labels = J / size, np.array(self.rows.groups)
        whole = slope * J[: self.count].T @ J[: self.count] + J[self.count :].T @ J[self.count :]
        moves = []
        for label in self.runs:
            own = J[: self.count][labels == label]
            rest = np.linalg.pinv(whole - slope * own.T @ own, rcond=least_squares.MIN_SINGULAR_VALUE**2, hermitian=True)
            moves.append(rest @ (own.T @ psi[labels == label]))
        off = np.array(moves) - np.mean(moves, axis=0)
        full[np.ix_(inside, inside)] = (n - 1) / n * off.T @ off / np.outer(size, size)
        return full

    @functools.cached_property
    def covariance(self) -> Array:
        """Covariance of the mean; see the base class."""
        return names.read_only(self.between + self.considered)

    @functools.cached_property
    def band_covariance(self) -> Array:
        """Covariance of the parameters of a further specimen about the fit, so that 1.96 standard errors hold 95 % of them."""
        widened = (self.quantile / units.HALF_WIDTH_95) ** 2
        return names.read_only((self.specimens + 1) * widened * self.between + self.considered)


def weighted_alike(fit: least_squares.LeastSquaresFit) -> list[TensileResiduals]:
    """Return the sources of a fit with errors by the mean specimen's stress: by its own, a soft one would count more."""
    sources: Sequence[TensileResiduals] = fit.problem.sources  # type: ignore[assignment]
    return [
        dataclasses.replace(source, errors=source.errors / factor) for source, factor in zip(sources, factors(fit), strict=True)
    ]


def factors(fit: least_squares.LeastSquaresFit) -> list[float]:
    """Return how many times as large as the law's the stress of each specimen is."""
    ends = np.cumsum([len(source.curve.stretch) for source in fit.problem.sources])  # type: ignore[attr-defined]
    parts = np.split(fit.residuals[: ends[-1]], ends[:-1])
    made = []
    for source, part in zip(fit.problem.sources, parts, strict=True):
        measured = source.curve.stress / source.errors  # type: ignore[attr-defined]
        law = part + measured
        made.append(max(float(law @ measured) / float(law @ law), 0.1))
    return made


def sentences(fit: SampleFit, curves: Sequence[TensileCurve]) -> list[str]:
    """Return what the scatter of a sample is, and which specimen differs from the others by more than chance."""
    made = []
    for mode in dict.fromkeys(curve.mode for curve in curves):
        group = [(curve.name, factor) for curve, factor in zip(curves, factors(fit), strict=True) if curve.mode == mode]
        logs, n = np.log([factor for _, factor in group]), len(group)
        made.append(
            f"{n} {mode} specimens are a sample: the law is their mean, their stress scatters by "
            f"{100 * float(np.std(logs, ddof=1)):.2g} %, and intervals and band follow from that scatter (Student's t, "
            f"{fit.freedom} degrees of freedom; the band holds 95 % of further specimens): "
            + ", ".join(f"{name} {factor:.3f} times the mean" for name, factor in group)
        )
        worst = int(np.argmax(np.abs(logs - np.median(logs))))
        rest = np.delete(logs, worst)
        spread = max(float(np.std(rest, ddof=1)), LEAST_SCATTER)
        t = abs(float(logs[worst] - rest.mean())) / (spread * math.sqrt(1 + 1 / len(rest)))
        if 2 * n * (1 - stdtr(n - 2, t)) < SIGNIFICANCE_LEVEL:
            made.append(
                f"{group[worst][0]} differs from the other specimens: its stress is {math.exp(logs[worst] - rest.mean()):.3g} "
                f"times theirs, which scatter by {100 * float(np.std(rest, ddof=1)):.2g} %; check its sizes, or leave it out"
            )
    return made
