"""Which of several laws the data prefer."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from softmodels.fitting.law_parameters import all_laws
from softmodels.fitting.problem import loss_of
from softmodels.fitting.result import LeastSquaresFit

UNDECIDED = 2.0
"""Laws whose criteria differ by less than this are equally good (Burnham & Anderson 2002, section 2.6)."""
CURVE_VALUES = 10.0
"""Independent values that one measured curve is worth, however many points it has: what a pull gets wrong (cross-section,
grips, crosshead strain) keeps together over about a tenth of it."""
EQUAL = 1.3
"""Misfits on the yardstick are equal within the error where one mean square is less than 1.7 times the other."""
MOST_RATIO = 2.5
"""A law whose root mean square misfit is this many times another's is not preferred, however simple it is."""
SAME = 1e-3
"""Misfits below this share of the yardstick are equally good: nothing measured tells them apart."""


@dataclasses.dataclass(frozen=True)
class Ranked:
    """A fit with its criteria relative to the best one's, which are 0.

    Attributes:
        fit: The fit.
        aicc: Akaike's corrected criterion.
        bic: Schwarz's.
        ratio: Root mean square misfit over that of the closest law.
        near: Whether the law follows the data nearly as closely as the closest does.
    """

    fit: LeastSquaresFit
    aicc: float
    bic: float
    ratio: float = 1.0
    near: bool = True


@dataclasses.dataclass(frozen=True)
class Comparison:
    """Fits of the same data, best first, and what that means.

    Attributes:
        ranked: Best first.
        preferred: The fit to take: the best, or the simplest of those that the data do not tell from it; of equally simple
            ones the first in the order of `softmodels.fitting.law_parameters.all_laws`.
        sentence: Why.
    """

    ranked: tuple[Ranked, ...]
    preferred: LeastSquaresFit
    sentence: str


def compare(fits: Sequence[LeastSquaresFit], judged: Sequence[LeastSquaresFit] | None = None) -> Comparison:
    """Rank fits of the same measurements by the quasi-likelihood form of Akaike's corrected criterion.

    QAICc divides the misfit by the variance that remains in the closest fit (Burnham & Anderson 2002, Model Selection and
    Multimodel Inference, section 2.5). What the misfit is counted in decides, so measured curves are judged on one yardstick,
    whatever errors they are fitted with: `yardstick.on_yardstick` fits each law again at the same stretches for every
    sampling, with what a test can tell, a share of the stress, as its error. Each curve counts as `CURVE_VALUES` values,
    however densely it is sampled. A further parameter then pays where it takes a tenth off the mean square misfit, or off
    what a test can tell where the misfit is below that. A simpler law is preferred only where its misfit on that yardstick is
    less than `EQUAL` times the closest law's.

    Which of two indistinguishable laws is ahead may change with the noise of a few readings. So it does not count: the one
    with fewer parameters is preferred, and of two with the same number the one that comes first in a fixed order.

    Other fits count as many values as they have independent residuals, their runs of like sign taken together.

    A law whose root mean square misfit is `MOST_RATIO` times another's is never preferred. The BIC is formed likewise.

    Args:
        fits: At least one, all of the same sources with the same loss.
        judged: The same laws, fitted to curves on the common yardstick, in the same order.

    Raises:
        ValueError: They are not of the same measurements.
    """
    _check(fits)
    misfits, values = _on_curves(judged) if judged else _on_residuals(fits)
    ratios = _ratios(fits)
    even = _equal(judged) if judged else [True] * len(fits)
    made = []
    for fit, misfit, ratio, equal in zip(fits, misfits, ratios, even, strict=True):
        m = len(fit.free) + 1
        aicc = misfit + 2 * m + 2 * m * (m + 1) / max(fit.count - m - 1, 1)
        made.append(Ranked(fit, aicc, misfit + m * math.log(max(values, 1.0)), ratio, equal and ratio <= MOST_RATIO))
    # A fit that did not converge, or that another leaves far behind, has no criterion worth ranking by.
    made.sort(key=lambda one: (not one.fit.converged, not one.near, one.aicc))
    least, lowest = made[0].aicc, min(one.bic for one in made)
    ranked = tuple(dataclasses.replace(one, aicc=one.aicc - least, bic=one.bic - lowest) for one in made)
    return Comparison(ranked, *_judgement(ranked))


def _check(fits: Sequence[LeastSquaresFit]) -> None:
    first = fits[0]
    for other in fits[1:]:
        alike = (other.loss, other.errors, other.rows.groups) == (first.loss, first.errors, first.rows.groups)
        if not alike or not np.allclose(other.rows.sizes, first.rows.sizes, rtol=1e-12):
            raise ValueError("only fits of the same measurements, with the same loss and errors, can be compared")


def _on_curves(judged: Sequence[LeastSquaresFit]) -> tuple[list[float], float]:
    """Misfit of each law in what remains of the closest one's, and how many values there are."""
    sums = _mean_squares(judged)
    values = CURVE_VALUES * len(judged[0].summaries)
    worth = max(min(sums), 1.0)
    return [values * one / worth for one in sums], values


def _equal(judged: Sequence[LeastSquaresFit]) -> list[bool]:
    """Whether each law's misfit on the yardstick equals the closest one's within the error."""
    sums = _mean_squares(judged)
    return [one <= EQUAL**2 * max(min(sums), SAME**2) for one in sums]


def _mean_squares(judged: Sequence[LeastSquaresFit]) -> list[float]:
    """Mean square misfit of each law in units of the yardstick, every curve counting the same."""
    return [sum(_means(fit).values()) / len(fit.summaries) for fit in judged]


def _means(fit: LeastSquaresFit) -> dict[str, float]:
    """Mean over each curve of the loss of its squared residuals; the priors' share goes to the first.

    The noise that averaging took from a curve counts as if it were there, so that each sampling has the same misfit.
    """
    labels = np.array(fit.rows.groups)
    squares = fit.residuals**2
    losses = loss_of(fit.loss, squares, len(squares) - fit.count)[0]
    means = {str(name): float(losses[: fit.count][labels == name].mean()) for name in dict.fromkeys(fit.rows.groups)}
    for source in fit.problem.sources:
        if hidden := float(getattr(source, "averaged_away", 0.0)):
            means[source.label] += hidden**2 * float(np.mean(np.array(fit.rows.sizes)[labels == source.label] ** -2.0))
    means[fit.rows.groups[0]] += float(losses[fit.count :].sum()) / CURVE_VALUES
    return means


def _on_residuals(fits: Sequence[LeastSquaresFit]) -> tuple[list[float], float]:
    """The same for fits whose residuals have errors of their own."""
    closest = min(fits, key=lambda fit: fit.deviance)
    worth = max(closest.dispersion * closest.count / closest.independent, 1e-300)
    if closest.loss != "linear":
        worth *= closest.influence[1]
    return [fit.deviance / worth for fit in fits], closest.independent


def _ratios(fits: Sequence[LeastSquaresFit]) -> list[float]:
    """Root mean square misfit of each law over that of the closest one, every curve or photograph counting the same."""
    labels, sizes = np.array(fits[0].rows.groups), np.array(fits[0].rows.sizes)
    hidden = {source.label: float(getattr(source, "averaged_away", 0.0)) for source in fits[0].problem.sources}
    misfits = [{k: math.hypot(v.rms, hidden.get(k, 0.0)) for k, v in fit.summaries.items()} for fit in fits]
    least = {
        name: max(min(one[name] for one in misfits), SAME * float(sizes[labels == name].mean()))
        for name in fits[0].summaries
    }
    sums = [sum((one[name] / least[name]) ** 2 for name in least) for one in misfits]
    smallest = max(min(sums), len(least))
    return [math.sqrt(max(one / smallest, 1.0)) for one in sums]


def _simplicity(fit: LeastSquaresFit) -> tuple[int, int, str]:
    """Fewest free parameters first, then the order of `all_laws`: nothing that the noise of a few readings can turn."""
    order = all_laws()
    return len(fit.free), order.index(fit.label) if fit.label in order else len(order), fit.label


def _judgement(ranked: tuple[Ranked, ...]) -> tuple[LeastSquaresFit, str]:
    best = ranked[0].fit
    first = best.label
    if len(ranked) == 1:
        return best, f"{first} is the only law fitted, so nothing says whether another would do better"
    rivals = [one for one in ranked[1:] if one.aicc < UNDECIDED and one.fit.converged and one.near]
    if rivals:
        simplest, *more = sorted((ranked[0].fit, *(one.fit for one in rivals)), key=_simplicity)
        others = ", ".join(one.fit.label for one in rivals)
        alike = [one.label for one in more if len(one.free) == len(simplest.free)]
        why = f", as simple as {' and '.join(alike)} and before it in the order of laws" if alike else ", the simplest"
        return simplest, f"{first} and {others} cannot be told apart by these data; take {simplest.label}{why}"
    second = ranked[1]
    times = f"a misfit {second.ratio / ranked[0].ratio:.3g} times as large"
    if not second.near or second.aicc < UNDECIDED:
        return best, f"the data prefer {first}: the next, {second.fit.label}, leaves {times}"
    joint = "and leaves" if second.ratio >= ranked[0].ratio else "although it leaves"
    said = f"the next, {second.fit.label}, is {second.aicc:.3g} behind in AICc (over 2 tells) {joint} {times}"
    return best, f"the data prefer {first}: {said}"
