"""Which of several laws the data prefer."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from softmodels.fit_result import Fit

UNDECIDED = 2.0
"""Laws whose criteria differ by less than this are equally good (Burnham & Anderson 2002, section 2.6)."""


@dataclasses.dataclass(frozen=True)
class Ranked:
    """A fit with its criteria relative to the best one's, which are 0."""

    fit: Fit
    aicc: float
    bic: float


@dataclasses.dataclass(frozen=True)
class Comparison:
    """Fits of the same data, best first, and what that means.

    Attributes:
        ranked: Best first.
        preferred: The fit to take: the best, or the simplest of those that the data do not tell from it.
        sentence: Why.
    """

    ranked: tuple[Ranked, ...]
    preferred: Fit
    sentence: str


def compare(fits: Sequence[Fit]) -> Comparison:
    """Rank fits of the same measurements by the quasi-likelihood form of Akaike's corrected criterion.

    QAICc divides the deviance by the variance that remains in the closest fit, its runs of like sign counted, so that a
    thousand points on a curve that no law follows exactly do not pass for a thousand arguments (Burnham & Anderson 2002,
    Model Selection and Multimodel Inference, section 2.5). The BIC is formed likewise.

    Args:
        fits: At least one, all of the same sources with the same loss.

    Raises:
        ValueError: They are not of the same measurements.
    """
    first = fits[0]
    for other in fits[1:]:
        alike = (other.loss, other.errors, other.rows.groups) == (first.loss, first.errors, first.rows.groups)
        if not alike or not np.allclose(other.rows.sizes, first.rows.sizes, rtol=1e-12):
            raise ValueError("only fits of the same measurements, with the same loss and errors, can be compared")
    closest = min(fits, key=lambda fit: fit.deviance)
    worth = max(closest.dispersion * closest.count / closest.independent, 1e-300)
    if closest.loss != "linear":
        worth *= closest.influence[1]
    made = []
    for fit in fits:
        m = len(fit.free) + 1
        misfit = fit.deviance / worth
        aicc = misfit + 2 * m + 2 * m * (m + 1) / max(closest.independent - m - 1, 1.0)
        made.append(Ranked(fit, aicc, misfit + m * math.log(max(closest.independent, 1.0))))
    # A fit that did not converge has no criterion worth ranking by.
    made.sort(key=lambda one: (not one.fit.converged, one.aicc))
    least, lowest = made[0].aicc, min(one.bic for one in made)
    ranked = tuple(dataclasses.replace(one, aicc=one.aicc - least, bic=one.bic - lowest) for one in made)
    return Comparison(ranked, *_judgement(ranked))


def _judgement(ranked: tuple[Ranked, ...]) -> tuple[Fit, str]:
    best = ranked[0].fit
    first = best.label
    if len(ranked) == 1:
        return best, f"{first} is the only law fitted, so nothing says whether another would do better"
    rivals = [one.fit for one in ranked[1:] if one.aicc < UNDECIDED and one.fit.converged]
    if rivals:
        simplest = min([best, *rivals], key=lambda fit: len(fit.free))
        others = ", ".join(fit.label for fit in rivals)
        return simplest, f"the data do not decide between {first} and {others}; take {simplest.label}, the simplest"
    second = ranked[1]
    said = f"the data prefer {first}: the next, {second.fit.label}, is {second.aicc:.3g} behind in AICc (over 2 tells)"
    return best, said
