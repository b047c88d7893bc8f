"""Robust loess: local quadratics with weights that ignore what lies far off, as MATLAB's ``smooth(…, 'rloess')`` does.

The regression is Cleveland's own (``skmisc.loess``), asked for what the thesis used: degree 2, symmetric family, a span
counted in points. Only the cutting into pieces is ours.

Sources: W. S. Cleveland, "Robust locally weighted regression and smoothing scatterplots", J. Am. Stat. Assoc. 74 (1979)
829, doi 10.1080/01621459.1979.10481038; W. S. Cleveland, S. J. Devlin, J. Am. Stat. Assoc. 83 (1988) 596,
doi 10.1080/01621459.1988.10478639.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt
from skmisc.loess import loess

Array = npt.NDArray[np.float64]

SPAN = 20
"""Points in one local fit; the thesis' value."""

CHUNK = 100
"""Points per call: the direct fit and its standard errors cost the square of the number of points."""

ITERATIONS = 5
"""Rounds of reweighting; MATLAB takes five as well."""


@dataclasses.dataclass(frozen=True)
class Smoothed:
    """A smoothed curve.

    Attributes:
        value: Fitted value at each place, shape (n,).
        error: Standard error of each fitted value from the scatter about the curve, shape (n,).
        scatter: Residual standard error of the points about the curve near each place, shape (n,).
    """

    value: Array
    error: Array
    scatter: Array


def robust_loess(place: Array, value: Array, span: int = SPAN) -> Smoothed:
    """Smooth values along a line by robust local quadratics.

    Args:
        place: Rising places, shape (n,); at least 4 different ones in every span.
        value: Measured values, shape (n,).
        span: Number of points in one local fit, at least 5; fewer points than that are one span.

    Returns:
        Fitted values with their standard errors. Each piece of the curve is fitted together with a whole span of its
        neighbours on both sides, so the pieces' ends are no ends.

    Raises:
        ValueError: Too few points, or arrays that do not fit.
    """
    place, value = np.asarray(place, dtype=np.float64), np.asarray(value, dtype=np.float64)
    if place.ndim != 1 or place.shape != value.shape:
        raise ValueError("smoothing needs as many values as places, in one row each")
    if span < 5 or len(place) < 5:
        raise ValueError("smoothing with local quadratics needs at least 5 points and a span of at least 5")
    if (np.diff(place) < 0.0).any():
        raise ValueError("smoothing needs its places in rising order")
    fitted, error, scatter = np.empty_like(value), np.empty_like(value), np.empty_like(value)
    for start in range(0, len(place), CHUNK):
        stop = min(start + CHUNK, len(place))
        first, last = max(0, start - span), min(len(place), stop + span)
        piece = _smooth_piece(place[first:last], value[first:last], span)
        inner = slice(start - first, stop - first)
        fitted[start:stop], error[start:stop] = piece.value[inner], piece.error[inner]
        scatter[start:stop] = piece.scatter[inner]
    return Smoothed(fitted, error, scatter)


def _smooth_piece(place: Array, value: Array, span: int) -> Smoothed:
    # Loess solves its local fits in the units it is given; metres squared would sit at the rounding limit.
    origin, width = place[0], (place[-1] - place[0]) or 1.0
    offset, scale = float(np.median(value)), float(np.ptp(value)) or 1.0
    at, target = (place - origin) / width, (value - offset) / scale
    for family in ("symmetric", "gaussian"):
        # Values that lie on a curve but for rounding leave robust weights nothing to tell apart; plain ones serve then.
        model = loess(
            at, target, span=min(1.0, span / len(place)), degree=2, family=family,
            surface="direct", statistics="exact", iterations=ITERATIONS,
        )  # fmt: skip
        try:
            model.fit()
            fitted = np.array(model.outputs.fitted_values)
            error = np.array(model.predict(at, stderror=True).stderr, dtype=np.float64)
        except ValueError:
            continue
        if np.isfinite(fitted).all() and np.isfinite(error).all():
            scatter = max(float(model.outputs.residual_scale) * scale, np.finfo(float).tiny)
            return Smoothed(fitted * scale + offset, error * scale, np.full(len(place), scatter))
    raise ValueError("the values cannot be smoothed: several of them lie at one place")
