"""Robust loess against curves it must leave alone, points it must ignore, and its own definition written out."""

from __future__ import annotations

import numpy as np
import pytest

from measurement.outline.edge import robust_loess

X = np.linspace(0.0, 0.03, 260)


def local_quadratics(x, y, span):
    """MATLAB's 'loess': at each place a quadratic through the nearest ``span`` points with tricube weights."""
    out = np.empty_like(y)
    for i, place in enumerate(x):
        far = np.abs(x - place)
        near = np.argsort(far, kind="stable")[:span]
        weight = np.clip(1.0 - (far[near] / far[near].max()) ** 3, 0.0, None) ** 3
        out[i] = np.polyval(np.polyfit(x[near] - place, y[near], 2, w=np.sqrt(weight)), 0.0)
    return out


def test_a_quadratic_stays_what_it_is():
    y = 0.004 - 20.0 * (X - 0.012) ** 2
    assert np.abs(robust_loess(X, y).value - y).max() < 1e-12


def test_outliers_are_ignored():
    rng = np.random.default_rng(0)
    y = 0.004 - 20.0 * (X - 0.012) ** 2
    noisy = y + 2e-6 * rng.normal(size=len(X))
    noisy[[40, 41, 120, 200]] += 4e-4
    # The outliers are two hundred times the noise.
    assert np.abs(robust_loess(X, noisy).value - y).max() < 6e-6


def test_span_counts_points_as_matlab_does():
    """Without outliers the robust fit is the plain one but for weights near one; a wrong span would be far off."""
    rng = np.random.default_rng(1)
    y = 1e-4 * np.sin(X / 0.0006) + 1e-7 * rng.normal(size=len(X))
    inner = slice(25, -25)
    missed = {
        span: np.std((robust_loess(X, y, 21).value - local_quadratics(X, y, span))[inner]) for span in (15, 21, 27)
    }
    assert missed[21] < 0.5 * min(missed[15], missed[27])


def test_stated_errors_are_true():
    rng = np.random.default_rng(2)
    y = 0.004 - 20.0 * (X - 0.012) ** 2
    ratios = []
    for _ in range(10):
        smooth = robust_loess(X, y + 3e-6 * rng.normal(size=len(X)))
        ratios.append((smooth.value - y) / smooth.error)
        assert np.median(smooth.scatter) == pytest.approx(3e-6, rel=0.25)
    assert 0.7 < np.mean(np.square(ratios)) < 1.4


@pytest.mark.parametrize(
    ("x", "y", "span", "reason"),
    [
        (X, X[1:], 20, "as many values"),
        (X[:4], X[:4], 20, "at least 5"),
        (X, X, 4, "at least 5"),
        (X[::-1], X, 20, "rising"),
        (np.zeros(30), np.arange(30.0), 20, "at one place"),
    ],
)
def test_what_cannot_be_smoothed(x, y, span, reason):
    with pytest.raises(ValueError, match=reason):
        robust_loess(x, y, span)
