"""Raw curves of test machines made smaller: readings averaged over equal steps of stretch, and what that costs.

A machine writes as many readings as its clock allows. Ten thousand of them on one pull are no more witnesses than a hundred,
for what a pull gets wrong (cross-section, grips, the specimen's own history) keeps together over much of the curve.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

from softmodels.fitting.curves.curve import TensileCurve
from softmodels.fitting.curves.stress_error import noise

Array = npt.NDArray[np.float64]

MOST_POINTS = 100
"""Curves with more points than this are averaged over steps of stretch."""
FINEST = 800
"""Most steps that are tried where a curve bends too sharply for fewer."""
KEPT = 0.002
"""The averaged curve follows the readings to this share of the largest stress, or more steps are taken."""


def thinned(curve: TensileCurve, most: int = MOST_POINTS) -> TensileCurve:
    """A curve of at most about ``most`` points, with a remark that says how many became how many, and by which rule.

    Stretch and stress are averaged over equal steps of stretch; a step without a reading gives no point. Where the averages,
    joined by straight lines, miss the curve's smoothed readings by more than `KEPT` of the largest stress, the steps are
    halved. A curve of few points stays as it is.
    """
    if len(curve.stretch) <= most:
        return curve
    steps = most
    while True:
        stretch, stress, _ = _averaged(curve, steps)
        missed = _missed(curve, stretch, stress, 2 * steps)
        if missed <= KEPT * float(np.abs(curve.stress).max()) or 2 * steps > min(FINEST, len(curve.stretch) // 2):
            break
        steps *= 2
    scatter = _scatter(curve, stretch, stress)
    remark = (
        f"{len(curve.stretch)} readings averaged over {steps} equal steps of stretch, {len(stretch)} points; the readings "
        f"scatter about them by {scatter / 1e3:.2g} kPa rms, and the averages miss the curve by {missed / 1e3:.2g} kPa at most"
    )
    remarks = (*curve.remarks, remark)
    return dataclasses.replace(
        curve,
        stretch=stretch,
        stress=stress,
        remarks=remarks,
        noise=noise(curve),
        readings=len(curve.stretch) / len(stretch),
    )


def averaged(curve: TensileCurve, steps: int) -> tuple[Array, Array]:
    """Mean stretch and mean stress in Pa of each of ``steps`` equal steps of stretch that has a reading."""
    stretch, stress, _ = _averaged(curve, steps)
    return stretch, stress


def _averaged(curve: TensileCurve, steps: int) -> tuple[Array, Array, npt.NDArray[np.int64]]:
    """Mean stretch, mean stress and number of readings of every step that has any."""
    edges = np.linspace(curve.stretch[0], curve.stretch[-1], steps + 1)
    place = np.clip(np.searchsorted(edges, curve.stretch, "right") - 1, 0, steps - 1)
    counts = np.bincount(place, minlength=steps)
    here = counts > 0
    means = [np.bincount(place, values, steps)[here] / counts[here] for values in (curve.stretch, curve.stress)]
    return means[0], means[1], counts[here]


def _missed(curve: TensileCurve, stretch: Array, stress: Array, halves: int) -> float:
    """Largest distance in Pa between the averages, joined by straight lines, and averages over halves of their steps."""
    finer, fine, counts = _averaged(curve, halves)
    # A half step with few readings tells its own noise and not the curve's bend.
    firm = (counts >= max(1, int(np.median(counts)) // 2)) & (finer >= stretch[0]) & (finer <= stretch[-1])
    off = np.abs(np.interp(finer, stretch, stress) - fine)[firm]
    chance = 4 * _scatter(curve, stretch, stress) / np.sqrt(counts[firm])
    return float(np.max(np.maximum(off - chance, 0.0), initial=0.0))


def _scatter(curve: TensileCurve, stretch: Array, stress: Array) -> float:
    """Root mean square distance in Pa of the readings from the averages, joined by straight lines."""
    return float(np.sqrt(np.mean((np.interp(curve.stretch, stretch, stress) - curve.stress) ** 2)))
