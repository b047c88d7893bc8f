"""One start: a search, and again where values on a fresh mesh are others than those that it went by."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from softmodels.design.errors import DesignStopped
from softmodels.design.evaluating import EnoughError, Evaluating
from softmodels.design.formulation import Formulation, Scaled
from softmodels.design.result import StartEnd
from softmodels.design.search import search
from softmodels.design.trials import Trial

Array = npt.NDArray[np.float64]
PASSES = 4
"""Of a robust search: standard deviations are fixed while it goes on, and taken anew where it ended."""
SETTLED = 1e-3
"""Change of what they take, in shares of a limit, from which on a robust search has ended."""
CORRECTIONS = 3
"""Times that a search goes on from its end on a fresh mesh."""
KEPT, FAR_INSIDE, SAME = 1e-3, 0.05, 5e-3
"""Shares of a limit: passed by at most this it is kept; further inside than this it does not matter; the fresh mesh's values
are those of the search within this."""


def follow(under_way: Evaluating, theta: Array) -> StartEnd:
    """Search from a design, and confirm the end.

    Args:
        under_way: What evaluates designs; a design was judged before.
        theta: Where to begin, values of the problem's `names`.
    """
    form = under_way.form
    assert form is not None
    seen: list[Trial] = []
    confirmed, trouble = dict[str, float](), ""
    best: Trial | None = None
    why = ""
    try:
        why = _searched(under_way, form, theta, seen)
        best = form.best(seen)
        if best is None or not under_way.how.get("confirm", True):
            return StartEnd(under_way.start, best, form, why=why)
        confirmed, trouble = under_way.confirmed(best)
        for _ in range(CORRECTIONS):
            if trouble or not form.feasible(best) or _as_confirmed(form, best, confirmed):
                break
            under_way.tell("on a fresh mesh limits are passed otherwise than in the search: it goes on from there")
            under_way.fresh_mesh()
            again = under_way.trial(np.array(best.theta))
            if again.failed:
                return StartEnd(under_way.start, best, form, confirmed, again.failure)
            form, seen = under_way.form.corrected(again, confirmed), [again]  # type: ignore[union-attr]
            why = _searched(under_way, form, np.array(again.theta), seen)
            best = form.best(seen) or again
            confirmed, trouble = under_way.confirmed(best)
    except DesignStopped:
        if not best or (seen and form.best(seen) is not None):
            best, confirmed = form.best(seen), {}
        return StartEnd(under_way.start, best, form, confirmed, "", StartEnd.STOPPED)
    return StartEnd(under_way.start, best, form, confirmed, trouble, why)


def _as_confirmed(form: Formulation, best: Trial, confirmed: Mapping[str, float]) -> bool:
    """Whether limits are kept on the fresh mesh, and those that matter as nearly as in the search."""
    if not form.rows:
        return True
    allowances = form.allowances(best)
    fresh, searched = form.passed(confirmed, allowances), form.violations(best)
    matter = np.maximum(fresh, searched) > -FAR_INSIDE
    return bool(fresh.max() <= KEPT and np.abs(fresh - searched)[matter].max(initial=0.0) <= SAME)


def _searched(under_way: Evaluating, form: Formulation, theta: Array, seen: list[Trial]) -> str:
    """Search, again with new standard deviations as long as those change; why it ended early.

    Args:
        under_way: What evaluates designs.
        form: The problem in scaled numbers.
        theta: Where to begin.
        seen: Gets every trial.
    """
    start = form.x(theta)

    def judged(point: Array) -> Trial:
        # The start itself is hit to the last bit, or it would be evaluated twice.
        seen.append(under_way.trial(theta if np.array_equal(point, start) else form.theta(point)))
        return seen[-1]

    end = start
    try:
        for _ in range(PASSES if form.spread.any else 1):
            allowances = form.allowances(judged(end))

            def evaluate(point: Array, allowances: Array = allowances) -> Scaled | None:
                before = set(under_way.visited)
                trial = judged(point)
                other_mesh = trial.remeshed and trial.number not in before
                return None if trial.failed else form.scaled(trial, allowances, other_mesh)

            end = search(evaluate, end)
            change = np.abs(form.allowances(judged(end)) - allowances) / np.array([row.scale for row in form.rows])
            if change.max(initial=0.0) <= SETTLED:
                break
    except EnoughError:
        return f"after {len(under_way.visited)} evaluations"
    return ""
