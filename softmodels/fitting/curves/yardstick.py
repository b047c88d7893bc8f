"""What laws are compared by: the same stretches and the same errors for every curve, however it was sampled and fitted."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from softmodels.fitting.curves.curve import TensileCurve
from softmodels.fitting.curves.curve_residuals import TensileResiduals
from softmodels.fitting.curves.stress_error import noise
from softmodels.fitting.curves.thinning import averaged
from softmodels.fitting.least_squares import fit_parameters
from softmodels.fitting.result import LeastSquaresFit

Array = npt.NDArray[np.float64]

STEPS = 25
"""Equal steps of stretch that every curve with enough points is judged on."""
TELLS, RESOLVES = 0.01, 0.005
"""What a tensile test can tell of a law: this share of the stress, and this share of the largest stress."""


def on_yardstick(fitted: LeastSquaresFit, sources: Sequence[TensileResiduals]) -> LeastSquaresFit:
    """A law fitted anew on the curves of `evened`, with what a tensile test can tell as its errors.

    Laws are compared by these fits, so that the choice of errors does not choose the law. Nor does the sampling: 37,512, 375
    and 93 readings of one pull give nearly the same values at the same stretches, and what one reading cannot tell counts as
    not told, however many readings there are. Bounds, priors and fixed values stay.
    """
    even = [dataclasses.replace(s, curve=(curve := evened(s.curve)), errors=_told(curve)) for s in sources]
    loss, label = fitted.loss, fitted.label
    return fit_parameters(even, fitted.parameters, loss=loss, starts=[fitted.values], errors="stated", label=label)


def evened(curve: TensileCurve) -> TensileCurve:
    """A curve as `STEPS` averages over equal steps of stretch; of fewer than two points a step, the curve as it is.

    Every stretch counts the same then, also where a machine wrote more readings near the start. Each average stands at the
    middle of its step: the mean of its few readings lies beside that, which would judge a sparse curve elsewhere than a dense
    one, most of all at the ends, where laws miss most. The noise that averaging takes away is kept in the curve's ``noise``
    and ``readings``.
    """
    if len(curve.stretch) < 2 * STEPS:
        return curve
    means, stress = averaged(curve, STEPS)
    edges = np.linspace(curve.stretch[0], curve.stretch[-1], STEPS + 1)
    middles = (edges[1:] + edges[:-1]) / 2
    stretch = middles[np.clip(np.searchsorted(edges, means, "right") - 1, 0, STEPS - 1)]
    stress = stress + np.gradient(stress, means) * (stretch - means)
    readings = curve.readings * len(curve.stretch) / len(stretch)
    return dataclasses.replace(curve, stretch=stretch, stress=stress, noise=noise(curve), readings=readings)


def _told(curve: TensileCurve) -> Array:
    """What a test can tell in Pa at each point of a curve, shape (n,)."""
    least = max(RESOLVES * float(np.abs(curve.stress).max()), noise(curve))
    return np.hypot(TELLS * curve.stress, least)
