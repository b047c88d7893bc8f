"""The search for the best design: sequential quadratic programming on an elastic problem that steps back from failures.

Chosen among SciPy's SLSQP and trust-constr and NLopt's MMA and CCSA (cyipopt has no wheel), on membranes with 3 to 20
parameters in closed form (tests/benchmarks/optimisers.py): evaluations to the end, and what happened.

| problem | SLSQP, elastic | SLSQP | MMA | CCSA | trust-constr |
|---|---|---|---|---|---|
| limits inactive at the start | 12, 11, 12 | 8, 9, 10 | 17, 21, 22 | 28, 27, 27 | 29, 18, 13 |
| trial points without a state | 8, 12, 14 | 10, 12, 16 | 17, 20, 22 | 34, 31, 32 | 43, 23, 19 |
| limits broken at the start | 10, 11, 12 | 5, 6, 7 | 6, 10, 81 | 9, 11, 11 | 25, 11, 11 |
| limits that exclude each other | 14, 25, 19 | 100, 100, 98 | 10, 13, 11 | 9, 41, 72 | 100, 100, 100 |

In the last row only the elastic form came near the least violation (0.200 of a limit; MMA ended at 0.250, SLSQP at 0.464).
Elastic means: one more variable t >= 0 by which all limits may be passed, at a price. So the quadratic problem of each step
has a solution, and a request that cannot be met ends where the largest violation is least.

The search begins with short steps of all parameters at once (`softmodels.design.search`), so that meshes and states follow,
and SLSQP goes on where those gain little any more. A trial that fails (no state there, no device) counts as if nothing had been
gained on the last point: SLSQP then halves its step. So does, without an evaluation, a step longer than the first part's last
ones or twice the last good one, and one that goes the way of a failure. Where the device had to be meshed anew the search
begins again from there, because values of two meshes differ by more than what the last steps gain.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator

import numpy as np
from scipy.optimize import least_squares, linprog, minimize
from scipy.stats import qmc

from geometries import GeometryError
from geometries.actuator import changed
from softmodels.common.arrays import Array
from softmodels.design.formulation import Formulation, Scaled
from softmodels.design.loads import DesignStopped
from softmodels.design.model import EnoughError, Evaluating
from softmodels.design.problem import CLEARANCES, DesignProblem
from softmodels.design.result import MET, StartEnd
from softmodels.design.trials import Trial

# ----------------------------------------------------------------------------------------------------------------------
# The first part of a search: linear programs within move limits that grow where a step was foreseen well.
#
# Sequential linear programming with a trust region (Fletcher and Sainz de la Maza 1989, doi 10.1007/BF01582299), in the elastic
# form of `softmodels.design.search`. Every parameter moves at once, and none by much, so that meshes and states follow; where
# such steps gain little any more, second derivatives matter and the search goes on with SLSQP.


FIRST_REACH = 0.1
"""Farthest that a parameter moves in the first step, in widths of its bounds."""
FARTHEST_REACH = 0.4
SHORTEST_REACH = 0.05
"""From which on SLSQP goes on."""
WORTH_IT = 0.05
"""Gain in objectives that is still to be expected of a step; SLSQP goes on where it is less."""
GOOD, POOR = 0.6, 0.1
"""Shares of the foreseen gain from which the move limits grow, and below which a step is not taken."""


def approached(evaluate: Callable[[Array], Scaled | None], start: Array, price: float) -> tuple[Array, float]:
    """The last design that linear steps have led to, and the move limits there.

    Args:
        evaluate: A design in scaled numbers by its scaled parameters; None if it fails.
        start: A design that does not fail, each value from 0 to 1.
        price: Of the largest violation.
    """
    x, reach = start, FIRST_REACH
    here = evaluate(x)
    assert here is not None
    while reach >= SHORTEST_REACH:
        step, foreseen = _step(here, x, reach, price)
        if foreseen < WORTH_IT:
            break
        trial = np.clip(x + step, 0.0, 1.0)
        there = evaluate(trial)
        gain = -np.inf if there is None else _merit(here, price) - _merit(there, price)
        if there is not None and (
            gain > POOR * foreseen or there.fresh
        ):  # values of another mesh are not to be compared
            x, here = trial, there
        if gain < POOR * foreseen:
            reach = min(reach, float(np.abs(step).max())) / 2
        elif gain > GOOD * foreseen:
            reach = min(2 * reach, FARTHEST_REACH)
    return x, reach


def _merit(found: Scaled, price: float) -> float:
    return found.f + price * float(found.c.max(initial=0.0))


def _step(here: Scaled, x: Array, reach: float, price: float) -> tuple[Array, float]:
    """The best step within the move limits as the slopes foresee it, and what it gains."""
    n, count = len(x), len(here.c)
    bounds = [(max(-reach, -value), min(reach, 1.0 - value)) for value in x] + [(0.0, None)]
    rows = np.column_stack([here.dc, -np.ones(count)]) if count else None
    found = linprog(np.append(here.df, price), rows, -here.c if count else None, bounds=bounds, method="highs")
    if found.x is None:  # HiGHS met numbers that it cannot deal with
        return np.zeros(n), 0.0
    return found.x[:n], price * float(here.c.max(initial=0.0)) - float(found.fun)


Evaluate = Callable[[Array], Scaled | None]
"""A design in scaled numbers by its scaled parameters; None if it fails."""

PRICES = (10.0, 100.0)
"""Of a violation of all of a limit, in objectives; the second if the first was too small."""
OBJECTIVE_TOLERANCE = 1e-4
"""The search ends where a step gains less than this share of the objective, or no step gains."""
SAME_DIRECTION = 0.98
"""Cosine of the angle within which two steps go the same way."""
MOST_MESHES = 8
"""Meshes of one pass."""
MOST_STEPS = 60
"""Steps of one pass; the number of evaluations ends it before."""


def search(evaluate: Evaluate, start: Array) -> Array:
    """The end of the search, in scaled parameters.

    Args:
        evaluate: A design in scaled numbers; every c at most zero is wanted. May raise to end the search.
        start: A design that does not fail, each value from 0 to 1.
    """
    x, reach = approached(evaluate, start, PRICES[0])
    for price in PRICES:
        x = _pass(evaluate, x, price, reach)
        if _violation(evaluate, x) <= OBJECTIVE_TOLERANCE:
            return x
        x = _pass(evaluate, x, 1.0, reach, objective=False)
        if _violation(evaluate, x) > OBJECTIVE_TOLERANCE:
            return x  # the least violation there is
    return x


def _violation(evaluate: Evaluate, x: Array) -> float:
    found = evaluate(x)
    assert found is not None  # a search ends where it has been
    return float(found.c.max(initial=0.0))


class _OtherMeshError(Exception):
    """A trial has a mesh of its own: values before and after are not to be compared to the last digit."""

    def __init__(self, x: Array):
        super().__init__()
        self.x = x


def _pass(evaluate: Evaluate, start: Array, price: float, reach: float, objective: bool = True) -> Array:
    """Runs of SLSQP over the parameters and t, each on one mesh."""
    for _ in range(MOST_MESHES):
        steps = _Steps(evaluate, start, price, reach, objective)
        bounds = [(0.0, 1.0)] * len(start) + [(0.0, None)]
        limits = [{"type": "ineq", "fun": steps.limits, "jac": steps.limit_slopes}] if steps.count else []
        try:
            minimize(
                steps.value, np.append(start, steps.elastic), jac=steps.slope, method="SLSQP", bounds=bounds,
                constraints=limits, options={"maxiter": MOST_STEPS, "ftol": OBJECTIVE_TOLERANCE},
            )  # fmt: skip
        except _OtherMeshError as other:
            start = other.x
        else:
            break
    return steps.best


class _Steps:
    """What SLSQP asks; it asks for slopes only at points that it goes on from."""

    def __init__(self, evaluate: Evaluate, start: Array, price: float, reach: float, objective: bool):
        self._evaluate, self.price, self.weight = evaluate, price, float(objective)
        found = evaluate(start)
        assert found is not None
        self.count = len(found.c)
        self.elastic = float(found.c.max(initial=0.0))
        self.at, self.reach, self.failed = start, reach, list[Array]()
        self.best, self._merit = start, self._worth(found)
        self.slope(np.append(start, self.elastic))

    def _worth(self, found: Scaled) -> float:
        return self.weight * found.f + self.price * float(found.c.max(initial=0.0))

    def _found(self, z: Array) -> Scaled | None:
        x = np.clip(z[:-1], 0.0, 1.0)
        step = float(np.abs(x - self.at).max())
        if step > self.reach * (1 + 1e-9) or self._behind_a_failure(x):
            return None
        found = self._evaluate(x)
        if found is None:
            self.failed.append(x)
            self.reach = step / 2
        elif found.fresh:
            raise _OtherMeshError(x)
        if found is not None and self._worth(found) < self._merit:
            self.best, self._merit = x, self._worth(found)
        return found

    def _behind_a_failure(self, x: Array) -> bool:
        """Whether a point lies about in the direction of one that failed, and as far away."""
        d = x - self.at
        length = float(np.linalg.norm(d))
        for known in self.failed:
            f = known - self.at
            far = float(np.linalg.norm(f))
            if length >= 0.9 * far and float(d @ f) >= SAME_DIRECTION * length * far:
                return True
        return False

    def value(self, z: Array) -> float:
        found = self._found(z)
        return self._base_value if found is None else self.weight * found.f + self.price * float(z[-1])

    def slope(self, z: Array) -> Array:
        before, self.at = self.at, np.clip(z[:-1], 0.0, 1.0)
        if not np.array_equal(before, self.at):
            self.reach = min(2 * self.reach, FARTHEST_REACH)
        found = self._evaluate(self.at)
        if found is None:  # SLSQP gave up where the last step failed
            return np.zeros(len(z))
        self._base_value = self.weight * found.f + self.price * float(z[-1])
        self._base_limits = z[-1] - found.c
        return np.append(self.weight * found.df, self.price)

    def limits(self, z: Array) -> Array:
        found = self._found(z)
        return self._base_limits if found is None else np.asarray(z[-1] - found.c)

    def limit_slopes(self, z: Array) -> Array:
        found = self._evaluate(np.clip(z[:-1], 0.0, 1.0))
        if found is None:
            return np.zeros((self.count, len(z)))
        return np.column_stack([-found.dc, np.ones(self.count)])


# ----------------------------------------------------------------------------------------------------------------------
# The search for the device that follows a target best: Gauss and Newton's method in a trust region, within the bounds.
#
# The distance from a target that can be met is no smooth function where it is met, and the searches for other objectives end
# early there. Its square is a sum of squares whose derivatives are known one by one, so that few evaluations are enough
# (SciPy's trust region reflective method: Branch, Coleman and Li 1999, doi 10.1137/S1064827595289108). A trial that fails is
# answered with no number, upon which it shrinks its region.


PARAMETER_TOLERANCE = 1e-6
"""Of the parameters, in widths of their bounds, at which the search ends."""
GAIN = 1e-10
"""Share of the sum of squares that a step has to gain."""
MESHES = 3
"""Meshes on which it begins again, for values of two meshes differ."""


def can_follow(form: Formulation, trial: Trial) -> bool:
    """Whether the problem is one of least squares: a target to follow, and no limits to keep beside the bounds."""
    keys = [term.quantity.key for term in form.problem.terms]
    return form.problem.objective == "follow" and not form.rows and all(key in trial.squares for key in keys)


def followed(judged: Callable[[Array], Trial], form: Formulation, start: Array) -> Array:
    """The end of the search in scaled parameters.

    Args:
        judged: A trial by its scaled parameters; may raise to end the search.
        form: The problem in scaled numbers.
        start: Where to begin; a design that does not fail.
    """
    x, known = start, dict[bytes, Trial]()

    def trial(point: Array) -> Trial:
        key = point.tobytes()
        if key not in known:
            known[key] = judged(point)
        return known[key]

    for _ in range(MESHES):
        known.clear()
        rows = len(distances(form, trial(x)))

        def residuals(point: Array, rows: int = rows) -> Array:
            found = trial(point)
            return np.full(rows, np.nan) if found.failed else distances(form, found)

        x = least_squares(
            residuals, x, lambda point: slopes(form, trial(point)), bounds=(0.0, 1.0), xtol=PARAMETER_TOLERANCE, ftol=GAIN,
            gtol=1e-15,
        ).x  # fmt: skip
        if not any(one.remeshed for one in list(known.values())[1:]):
            break
    return np.asarray(x)


def distances(form: Formulation, trial: Trial) -> Array:
    """Residuals of all targets of a trial, counted in the first trial's distance, those of a mean by their weights."""
    return _stacked(form, trial)[:, -1]


def slopes(form: Formulation, trial: Trial) -> Array:
    """Their derivatives by the scaled parameters."""
    return _stacked(form, trial)[:, : len(form.problem.free)] * form.width


def _stacked(form: Formulation, trial: Trial) -> Array:
    return np.vstack(
        [
            np.sqrt(term.weight / trial.squares[term.quantity.key].count) / form.size
            * trial.squares[term.quantity.key].triangle
            for term in form.problem.terms
        ]
    )  # fmt: skip


# ----------------------------------------------------------------------------------------------------------------------
# One start: a search, and again where values on a fresh mesh are others than those that it went by.


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


# ----------------------------------------------------------------------------------------------------------------------
# Where searches begin: the device as given, then points spread over the bounds.


DRAWN = 64
"""Points that are drawn in all; those that are no device, or have too thin a wall, are left out."""


def further_starts(problem: DesignProblem, seed: int) -> Iterator[Array]:
    """Scaled parameters of devices spread over the bounds: a Latin hypercube (McKay, Beckman and Conover 1979).

    Args:
        problem: The problem.
        seed: The same seed gives the same points.
    """
    for x in qmc.LatinHypercube(len(problem.free), rng=np.random.default_rng(seed)).random(DRAWN):
        if _is_device(problem, x):
            yield x


def _is_device(problem: DesignProblem, x: Array) -> bool:
    values = {one.name: one.low + share * one.width for one, share in zip(problem.free, x, strict=True)}
    try:
        device = changed(problem.case.actuator, values)
    except GeometryError:
        return False
    least = max([keep.at_least or 0.0 for keep in problem.limits if keep.quantity.name == CLEARANCES], default=0.0)
    return min(device.clearances.values(), default=least) >= least
