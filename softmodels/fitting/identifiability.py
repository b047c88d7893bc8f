"""What the data see of a fit's parameters, and what they do not."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import numpy.typing as npt

from softmodels.fitting.problem import Parameter
from softmodels.fitting.result import BLIND, LeastSquaresFit

Array = npt.NDArray[np.float64]

TOGETHER = 0.98
"""Parameters whose estimates correlate beyond this are seen only together."""


def singular_values(fit: LeastSquaresFit) -> tuple[Array, Array]:
    """Singular values (m,) of the data's Jacobian and its right vectors (m, m), in rows.

    The columns are scaled by what is a large change of each parameter: its prior's error, half the span of its bounds,
    or its own size. A value far below 1 is a combination that the data cannot tell from no change.
    """
    J = fit.jacobian[: fit.count] * np.array([_reach(fit, p) for p in fit.free]) / math.sqrt(fit.dispersion)
    _, values, vectors = np.linalg.svd(J, full_matrices=len(J) < J.shape[1])
    return np.pad(values, (0, len(fit.free) - len(values))), vectors


def _reach(fit: LeastSquaresFit, p: Parameter) -> float:
    if p.prior:
        return p.prior.error
    if math.isfinite(p.upper - p.lower) and not p.logarithmic:
        return (p.upper - p.lower) / 2
    return abs(fit.values[p.name]) or p.scale


def unseen(fit: LeastSquaresFit) -> tuple[str, ...]:
    """Sentences on parameters, or combinations of them, that the data do not determine."""
    said = []
    for p in fit.free:
        if p.name in fit.at_bounds:
            continue
        room, against = _allowed(p, fit.values[p.name])
        if not fit.quantile * _data_error(fit, p) < room:
            rests = f"{p.words} rests on its prior: without it, its interval would be wider"
            said.append(rests if p.prior else f"the data do not see {p.words}: its interval is wider than {against}")
    R = fit.correlations
    for i, a in enumerate(fit.free):
        for j in range(i):
            if abs(R[i, j]) > TOGETHER and not (a.hidden or fit.free[j].hidden):
                both = f"{fit.free[j].name} and {a.name}"
                said.append(f"the data see {both} only together (correlation {R[i, j]:.3f})")
    values, vectors = singular_values(fit)
    if np.isinf(np.diag(fit.covariance)).any() and values[-1] <= BLIND * max(values[0], 1e-300):
        mixed = [p.words for p, share in zip(fit.free, vectors[-1], strict=True) if abs(share) > 0.1]
        said.append(f"the data do not see one combination of {', '.join(mixed)} at all")
    return tuple(said)


def _data_error(fit: LeastSquaresFit, p: Parameter) -> float:
    """Standard error of a parameter as if there were no prior on it."""
    if not p.prior:
        return fit.error(p.name)
    own = fit.count + [q.name for q in fit.free if q.prior].index(p.name)
    without = dataclasses.replace(
        fit, residuals=np.delete(fit.residuals, own), jacobian=np.delete(fit.jacobian, own, axis=0)
    )
    return without.error(p.name)


def _allowed(p: Parameter, value: float) -> tuple[float, str]:
    """How wide an interval may be before the data say nothing: its half width, and what it is held against."""
    if p.prior:
        return 1.96 * p.prior.error, "its prior"
    if p.logarithmic or not math.isfinite(p.upper - p.lower):
        return (abs(value) or p.scale) * (1.0 if p.lower >= 0.0 else 10.0), "its own size"
    return (p.upper - p.lower) / 2, "its bounds"
