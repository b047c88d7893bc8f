"""One start: a search, and again where values on a fresh mesh are others than those that it went by."""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

from softmodels.design.errors import DesignStopped
from softmodels.design.evaluating import EnoughError, Evaluating
from softmodels.design.following import can_follow, followed
from softmodels.design.formulation import Formulation, Scaled
from softmodels.design.multipliers import MET
from softmodels.design.result import StartEnd
from softmodels.design.search import search
from softmodels.design.trials import Trial

Array = npt.NDArray[np.float64]
PASSES = 4
"""Of a robust search: standard deviations are fixed while it goes on, and taken anew where it ended."""
SETTLED = 1e-3
"""Change of what they take, in shares of a limit, from which on a robust search has ended."""
CORRECTIONS = 4
"""Times that a search goes on from its end on a fresh mesh."""
WASTED = 0.02
"""Share of a limit that may be left on the fresh mesh where the search has left none, before it goes on."""


def follow(under_way: Evaluating, theta: Array) -> StartEnd:
    """Search from a design, and confirm the end.

    Args:
        under_way: What evaluates designs; a design was judged before.
        theta: Where to begin, values of the problem's `names`.
    """
    form = under_way.form
    assert form is not None
    seen: list[Trial] = []
    ends: list[StartEnd] = []
    try:
        why = _searched(under_way, form, theta, seen)
        best = form.best(seen)
        if best is None or not under_way.how.get("confirm", True):
            return StartEnd(under_way.start, best, form, why=why)
        ends.append(StartEnd(under_way.start, best, form, *under_way.confirmed(best), why))
        safety = np.zeros(len(form.rows))
        while len(ends) <= CORRECTIONS and _differs(ends[-1], len(ends)):
            under_way.tell("on a fresh mesh limits are passed otherwise than in the search: it goes on from there")
            if len(ends) > 1:  # meshes differ by chance too
                safety = np.maximum(safety, _apart(ends[-1]))
            under_way.fresh_mesh()
            again = under_way.trial(np.array(best.theta))
            if again.failed:
                break
            form, seen = under_way.form.corrected(again, ends[-1].confirmed, safety), [again]  # type: ignore[union-attr]
            why = _searched(under_way, form, np.array(again.theta), seen)
            best = form.best(seen) or again
            ends.append(StartEnd(under_way.start, best, form, *under_way.confirmed(best), why))
    except DesignStopped:
        found = form.best(seen)
        if not ends or found is not None:
            return StartEnd(under_way.start, found, form, {}, "", StartEnd.STOPPED)
        return dataclasses.replace(ends[-1], why=StartEnd.STOPPED)
    return min(ends, key=StartEnd.order)


def _apart(end: StartEnd) -> Array:
    """By how much more each limit is passed on the fresh mesh than in the search, in shares of it."""
    assert end.best is not None
    allowances = end.form.allowances(end.best)
    return end.form.passed(end.confirmed, allowances) - (end.form.violations(end.best) - end.form.safety)


def _differs(end: StartEnd, rounds: int) -> bool:
    """Whether a search has to go on: limits are passed on the fresh mesh, or the first time left unused there."""
    if end.trouble or end.best is None or not end.form.rows or not end.form.feasible(end.best):
        return False
    fresh = end.form.passed(end.confirmed, end.form.allowances(end.best))
    met = end.form.violations(end.best) > -MET
    unused = rounds <= 2 and bool(met.any()) and float(fresh[met].max()) < -WASTED
    return unused or not end.feasible


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
        if can_follow(form, judged(start)):
            followed(judged, form, start)
            return ""
        for _ in range(PASSES if form.spread.any else 1):
            allowances = form.allowances(judged(end))

            def evaluate(point: Array, allowances: Array = allowances) -> Scaled | None:
                before = set(under_way.visited)
                trial = judged(point)
                other_mesh = trial.remeshed and trial.number not in before
                if other_mesh:
                    del seen[:-1]  # values of one mesh are compared alone
                return None if trial.failed else form.scaled(trial, allowances, other_mesh)

            end = search(evaluate, end)
            change = np.abs(form.allowances(judged(end)) - allowances) / np.array([row.scale for row in form.rows])
            if change.max(initial=0.0) <= SETTLED:
                break
    except EnoughError:
        return f"after {len(under_way.visited)} evaluations"
    return ""
