"""Optimise a design: from a problem to the best device, storing every trial."""

from __future__ import annotations

import csv
import dataclasses
import functools
import io
import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Unpack, cast

import numpy as np
from scipy.optimize import least_squares, linprog, minimize

from softmodels.case import case, entries
from softmodels.common import commands, files, names, units
from softmodels.common.arrays import Array
from softmodels.common.lazy import MPI, scipy
from softmodels.common.processes import one_at_a_time
from softmodels.design import grow, model, trials
from softmodels.design.problem import (
    CLEARANCES,
    MAX_EVALUATIONS,
    DesignEvaluator,
    DesignProblem,
    Formulation,
    Scaled,
    SearchOptions,
    in_words,
    label,
)
from softmodels.design.result import ACTIVE_TOLERANCE, DesignResult, StartEnd, Variant, case_text, holding
from softmodels.mechanics import mpi
from softmodels.runs.outcomes import RunError


@names.checked
@one_at_a_time
def optimise(
    problem: DesignProblem | str | Path,
    folder: str | Path | None = None,
    *,
    starts: int = 1,
    evaluations: int = MAX_EVALUATIONS,
    seed: int = 1,
    resume: bool = False,
    progress: Callable[[str], object] | None = None,
    stopped: Callable[[], bool] | None = None,
    confirm: bool = True,
    finer: float = 1.0,
    inputs: Sequence[Path] = (),
    model: Callable[[DesignProblem, MPI.Comm], DesignEvaluator] | None = None,
) -> DesignResult:
    """Optimise a design.

    The search takes linear programs in a trust region first, and then SciPy's SLSQP, with limits relaxed at a penalty, so that
    an infeasible problem ends at its least violation. A problem that only follows a target is solved by Gauss-Newton. A start
    ends where a step gains less than 1e-4 of the objective, at an optimum, or after ``evaluations`` designs. Then its end is
    confirmed on a fresh mesh; where limits are passed otherwise there, the search goes on from it on that mesh. No design is
    evaluated twice on one mesh.

    Args:
        problem: The problem, or its file.
        folder: Where every trial is kept as soon as it is known; None for nowhere.
        starts: How many; the first is the device as given, the others are spread over the bounds.
        evaluations: Most of one start.
        seed: Of the further starts.
        resume: Go on from the trials in the folder.
        progress: Gets a line for each design.
        stopped: Whether to stop, asked between evaluations.
        confirm: Solve the best design's whole path on a fresh mesh at the end.
        finer: How much finer that mesh is.
        inputs: Files that are read: they are never written.
        model: Makes what evaluates designs from a problem and a communicator; finite elements if None.

    Returns:
        The best design within all limits; where there is none the one with the least violation, and what holds it back.

    Raises:
        DesignError: Invalid input.
        RunError: The given device has no state at a requested pressure.
    """
    output = None if folder is None else names.place("folder", folder, "a folder")
    read = names.several("inputs", inputs, Path, "a file's Path")
    functions = {"progress": progress, "stopped": stopped, "model": model}
    how = _search_options(starts, evaluations, seed, finer, {"resume": resume, "confirm": confirm}, functions, read)
    whole = problem
    if not isinstance(whole, DesignProblem):
        whole = DesignProblem.from_file(names.place("problem", whole, "a problem file"))
    comm = mpi.start()
    kept = None if output is None else open_folder(whole, output, comm, how)
    try:
        return run_in(whole, kept, comm, **how)
    finally:
        if kept is not None:
            kept.leave()


MAX_START_TRIALS = 8
"""Maximum number of points tried for a further start until one has a state."""


def _search_options(
    starts: object,
    evaluations: object,
    seed: object,
    finer: object,
    flags: Mapping[str, object],
    functions: Mapping[str, object],
    inputs: Sequence[Path],
) -> SearchOptions:
    """Return the options of a call without those that are None; ArgumentError if one is something else."""
    for name, function in functions.items():
        names.callback(name, function)
    given = {name: function for name, function in functions.items() if function is not None}
    how = {
        "starts": names.whole("starts", starts, 1), "evaluations": names.whole("evaluations", evaluations, 1),
        "seed": names.whole("seed", seed, 0), "finer": _fresh_refinement(finer), "inputs": inputs,
        **{name: names.flag(name, value) for name, value in flags.items()}, **given,
    }  # fmt: skip
    return cast("SearchOptions", how)


def _fresh_refinement(value: object) -> float:
    """Return the refinement of the fresh mesh; raise `ArgumentError` if it is below 1."""
    try:
        finer = units.quantity(cast("float", value), "")
    except units.UnitError:
        finer = 0.0
    if isinstance(value, str) or not 1.0 <= finer <= 10.0:
        raise names.wrong("finer", value, "a number from 1 to 10")
    return finer


def open_folder(problem: DesignProblem, output: Path | None, comm: MPI.Comm, how: SearchOptions) -> model.DesignFolder | None:
    """Return the folder of an optimisation on rank 0, None elsewhere; DesignError, on all ranks, if it cannot be used."""
    return mpi.kept_on_root(comm, lambda: model.DesignFolder(problem, output, how.get("resume", False), how.get("inputs", ())))


def run_in(
    problem: DesignProblem, folder: model.DesignFolder | None, comm: MPI.Comm, **how: Unpack[SearchOptions]
) -> DesignResult:
    """Optimise into a folder that is already open, and stays open; see `open_folder`."""
    if problem.counts or problem.growth:
        return run_variants(problem, folder, comm, **how)
    under_way = model.Evaluator(problem, model.evaluator(problem, comm, how), folder, comm, how)
    try:
        return _run(under_way)
    finally:
        under_way.release()


def _run(under_way: model.Evaluator) -> DesignResult:
    """Search from every start, and return the best result."""
    problem, ends = under_way.problem, list[StartEnd]()
    try:
        for theta in _starts(under_way):
            ends.append(follow(under_way, theta))
            if ends[-1].stopped:
                break
        stopped = ends[-1].stopped
    except trials.DesignStopped:  # before the first design, or while searching for a start
        stopped = True
    judged = [end for end in ends if end.best is not None]
    if not judged:
        raise RunError("stopped by the user before any design was evaluated", commands.EXIT_STOPPED)
    end = min(judged, key=StartEnd.order)
    best, folder = end.best, under_way.folder
    assert best is not None
    where = mpi.on_root(under_way.comm, lambda: None if folder is None else folder.settle(best, under_way.trials.all))
    return DesignResult(
        problem, end, tuple(under_way.trials.all), tuple(ends), holding(end.form, best),
        under_way.how.get("finer", 1.0), stopped, where,
    )  # fmt: skip


def _starts(under_way: model.Evaluator) -> Iterator[Array]:
    """Yield the starting points of searches, each on its own mesh; after the first, those that have a state. RunError if the
    device as given has none where it is asked."""
    problem = under_way.problem
    theta = np.array([case.value_of(problem.case, name) for name in problem.names])
    trial = under_way.trial(theta)
    if trial.failed:
        raise RunError(
            f"the given device cannot be evaluated: {trial.failure}; start from one that reaches the requested "
            f"pressures, such as with thicker walls",
            commands.EXIT_NO_EQUILIBRIUM,
        )
    yield theta
    assert under_way.form is not None
    points = further_starts(problem, under_way.how.get("seed", 1))
    for number in range(2, under_way.how.get("starts", 1) + 1):
        under_way.start = number
        for x in itertools.islice(points, MAX_START_TRIALS):
            under_way.fresh_mesh()
            if not under_way.trial(under_way.form.theta(x)).failed:
                yield under_way.form.theta(x)
                break


# ----------------------------------------------------------------------------------------------------------------------
# Search for the best design: sequential quadratic programming on an elastic problem, robust to failed trials.
#
# Chosen among SciPy's SLSQP and trust-constr and NLopt's MMA and CCSA (cyipopt has no wheel), on membranes with 3 to 20
# parameters in closed form (tests/benchmarks/optimisers.py): evaluations to the end, and results.
#
# | problem | SLSQP, elastic | SLSQP | MMA | CCSA | trust-constr |
# |---|---|---|---|---|---|
# | limits inactive at the start | 12, 11, 12 | 8, 9, 10 | 17, 21, 22 | 28, 27, 27 | 29, 18, 13 |
# | trial points without a state | 8, 12, 14 | 10, 12, 16 | 17, 20, 22 | 34, 31, 32 | 43, 23, 19 |
# | limits broken at the start | 10, 11, 12 | 5, 6, 7 | 6, 10, 81 | 9, 11, 11 | 25, 11, 11 |
# | limits that exclude each other | 14, 25, 19 | 100, 100, 98 | 10, 13, 11 | 9, 41, 72 | 100, 100, 100 |
#
# In the last row only the elastic form came near the least violation (0.200 of a limit; MMA ended at 0.250, SLSQP at 0.464).
# Elastic means: one more variable t >= 0 relaxes all limits, at a penalty. So the quadratic problem of each step
# has a solution, and an infeasible problem ends at the smallest maximum violation.
#
# The search starts with short steps of all parameters at once, so that meshes and states
# follow; SLSQP takes over once those gain little. A failed trial (no state, or an invalid device) counts as no gain over
# the last point, so SLSQP halves its step. The same applies, without an evaluation, to a step longer than the first phase's
# last ones or twice the last good one, and to a step towards a failure. If the device had to be remeshed, the search
# restarts there, because values of two meshes differ by more than the gain of the last steps.
#
# First phase of a search: linear programs within move limits, which grow if a step was predicted well.
#
# Sequential linear programming with a trust region (Fletcher and Sainz de la Maza 1989, doi 10.1007/BF01582299), in the elastic
# form of the search. All parameters move at once by small amounts, so that meshes and states follow; once
# such steps gain little, second derivatives matter and the search continues with SLSQP.


class _Steps:
    """Callbacks of SLSQP, which requests gradients only at accepted points."""

    def __init__(self, evaluate: Evaluate, start: Array, price: float, reach: float, objective: bool):
        self._evaluate, self.price, self.weight = evaluate, price, float(objective)
        evaluated = evaluate(start)
        assert evaluated is not None
        self.count = len(evaluated.c)
        self.elastic = float(evaluated.c.max(initial=0.0))
        self.at, self.reach, self.failed = start, reach, list[Array]()
        self.best, self._merit = start, self._worth(evaluated)
        self.slope(np.append(start, self.elastic))

    def _worth(self, scaled: Scaled) -> float:
        return self.weight * scaled.f + self.price * float(scaled.c.max(initial=0.0))

    def _found(self, z: Array) -> Scaled | None:
        x = np.clip(z[:-1], 0.0, 1.0)
        step = float(np.abs(x - self.at).max())
        if step > self.reach * (1 + 1e-9) or self._behind_a_failure(x):
            return None
        evaluated = self._evaluate(x)
        if evaluated is None:
            self.failed.append(x)
            self.reach = step / 2
        elif evaluated.fresh:
            raise _OtherMeshError(x)
        if evaluated is not None and self._worth(evaluated) < self._merit:
            self.best, self._merit = x, self._worth(evaluated)
        return evaluated

    def _behind_a_failure(self, x: Array) -> bool:
        """Return whether a point is roughly in the direction of a failed one, and at least as far away."""
        d = x - self.at
        length = float(np.linalg.norm(d))
        for known in self.failed:
            f = known - self.at
            far = float(np.linalg.norm(f))
            if length >= 0.9 * far and float(d @ f) >= SAME_DIRECTION * length * far:
                return True
        return False

    def value(self, z: Array) -> float:
        evaluated = self._found(z)
        return self._base_value if evaluated is None else self.weight * evaluated.f + self.price * float(z[-1])

    def slope(self, z: Array) -> Array:
        before, self.at = self.at, np.clip(z[:-1], 0.0, 1.0)
        if not np.array_equal(before, self.at):
            self.reach = min(2 * self.reach, FARTHEST_REACH)
        evaluated = self._evaluate(self.at)
        if evaluated is None:  # SLSQP stopped because the last step failed
            return np.zeros(len(z))
        self._base_value = self.weight * evaluated.f + self.price * float(z[-1])
        self._base_limits = z[-1] - evaluated.c
        return np.append(self.weight * evaluated.df, self.price)

    def limits(self, z: Array) -> Array:
        evaluated = self._found(z)
        return self._base_limits if evaluated is None else np.asarray(z[-1] - evaluated.c)

    def limit_slopes(self, z: Array) -> Array:
        evaluated = self._evaluate(np.clip(z[:-1], 0.0, 1.0))
        if evaluated is None:
            return np.zeros((self.count, len(z)))
        return np.column_stack([-evaluated.dc, np.ones(self.count)])


FIRST_REACH = 0.1
"""Maximum change of a parameter in the first step, relative to its range."""
FARTHEST_REACH = 0.4
SHORTEST_REACH = 0.05
"""Move limit below which SLSQP takes over."""
WORTH_IT = 0.05
"""Expected relative gain of a step below which SLSQP takes over."""
GOOD_GAIN, MIN_GAIN = 0.6, 0.1
"""Fractions of the predicted gain above which the move limits grow, and below which a step is rejected."""


def approached(evaluate: Callable[[Array], Scaled | None], start: Array, price: float) -> tuple[Array, float]:
    """Return the last design of the linear steps from a start that does not fail, scaled from 0 to 1, and the move limits
    there. Designs are evaluated in scaled numbers, None for failures; the price is of the largest violation."""
    x, reach = start, FIRST_REACH
    here = evaluate(x)
    assert here is not None
    while reach >= SHORTEST_REACH:
        step, predicted = _step(here, x, reach, price)
        if predicted < WORTH_IT:
            break
        trial = np.clip(x + step, 0.0, 1.0)
        there = evaluate(trial)
        gain = -np.inf if there is None else _merit(here, price) - _merit(there, price)
        if there is not None and (gain > MIN_GAIN * predicted or there.fresh):  # values of different meshes are not comparable
            x, here = trial, there
        if gain < MIN_GAIN * predicted:
            reach = min(reach, float(np.abs(step).max())) / 2
        elif gain > GOOD_GAIN * predicted:
            reach = min(2 * reach, FARTHEST_REACH)
    return x, reach


def _merit(scaled: Scaled, price: float) -> float:
    return scaled.f + price * float(scaled.c.max(initial=0.0))


def _step(here: Scaled, x: Array, reach: float, price: float) -> tuple[Array, float]:
    """Return the best step within the move limits by the gradients, and its predicted gain."""
    n, count = len(x), len(here.c)
    bounds = [(max(-reach, -value), min(reach, 1.0 - value)) for value in x] + [(0.0, None)]
    rows = np.column_stack([here.dc, -np.ones(count)]) if count else None
    solution = linprog(np.append(here.df, price), rows, -here.c if count else None, bounds=bounds, method="highs")
    if solution.x is None:  # HiGHS failed numerically
        return np.zeros(n), 0.0
    return solution.x[:n], price * float(here.c.max(initial=0.0)) - float(solution.fun)


Evaluate = Callable[[Array], Scaled | None]
"""A scaled design by its scaled parameters; None if it fails."""

PENALTIES = (10.0, 100.0)
"""Penalties of a violation of 100 % of a limit, in objectives; the second if the first was too small."""
OBJECTIVE_TOLERANCE = 1e-4
"""The search ends if a step gains less than this fraction of the objective."""
SAME_DIRECTION = 0.98
"""Cosine of the angle within which two steps have the same direction."""
MOST_MESHES = 8
MOST_STEPS = 60
"""Maximum number of steps per pass; the number of evaluations ends it earlier."""


def search(evaluate: Evaluate, start: Array) -> Array:
    """Return the end of the search, in scaled parameters, from a start that does not fail. Every c at most zero is wanted; to
    evaluate a design may raise to end the search."""
    x, reach = approached(evaluate, start, PENALTIES[0])
    for price in PENALTIES:
        x = _pass(evaluate, x, price, reach)
        if _violation(evaluate, x) <= OBJECTIVE_TOLERANCE:
            return x
        x = _pass(evaluate, x, 1.0, reach, objective=False)
        if _violation(evaluate, x) > OBJECTIVE_TOLERANCE:
            return x  # the smallest possible violation
    return x


def _violation(evaluate: Evaluate, x: Array) -> float:
    evaluated = evaluate(x)
    assert evaluated is not None  # a search ends at a visited point
    return float(evaluated.c.max(initial=0.0))


class _OtherMeshError(Exception):
    """A trial was remeshed, so values before and after are not exactly comparable."""

    def __init__(self, x: Array):
        super().__init__()
        self.x = x


def _pass(evaluate: Evaluate, start: Array, price: float, reach: float, objective: bool = True) -> Array:
    """Return the runs of SLSQP over the parameters and t, each on one mesh."""
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


# ----------------------------------------------------------------------------------------------------------------------
# Least-squares search for the device closest to a target: Gauss-Newton in a trust region, within the bounds.
#
# The distance from a reachable target is not smooth where it is zero, and general searches stop early there. Its square is a
# sum of squares with known derivatives, so few evaluations are enough (SciPy's trust region reflective method: Branch, Coleman
# and Li 1999, doi 10.1137/S1064827595289108). A failed trial returns NaN, which makes the method shrink its region.


PARAMETER_TOLERANCE = 1e-6
"""Convergence tolerance of the parameters, relative to their ranges."""
MIN_RELATIVE_GAIN = 1e-10
"""Minimum relative decrease of the sum of squares per step."""
MAX_MESHES = 3
"""Maximum number of meshes; it restarts on each, because values of two meshes differ."""


def can_follow(form: Formulation, trial: trials.Trial) -> bool:
    """Return whether the problem is a least-squares one: a target, and no limits other than bounds."""
    keys = [term.quantity.key for term in form.problem.terms]
    return form.problem.objective == "follow" and not form.rows and all(key in trial.squares for key in keys)


def followed(judged: Callable[[Array], trials.Trial], form: Formulation, start: Array) -> Array:
    """Return the end of the search in scaled parameters, from a start that does not fail; to judge a trial may raise to end
    it."""
    x, known = start, dict[bytes, trials.Trial]()

    def trial(point: Array) -> trials.Trial:
        key = point.tobytes()
        if key not in known:
            known[key] = judged(point)
        return known[key]

    for _ in range(MAX_MESHES):
        known.clear()
        rows = len(distances(form, trial(x)))

        def residuals(point: Array, rows: int = rows) -> Array:
            evaluated = trial(point)
            return np.full(rows, np.nan) if evaluated.failed else distances(form, evaluated)

        x = least_squares(
            residuals, x, lambda point: slopes(form, trial(point)), bounds=(0.0, 1.0), xtol=PARAMETER_TOLERANCE,
            ftol=MIN_RELATIVE_GAIN, gtol=1e-15,
        ).x  # fmt: skip
        if not any(quantity.remeshed for quantity in list(known.values())[1:]):
            break
    return np.asarray(x)


def distances(form: Formulation, trial: trials.Trial) -> Array:
    """Return the residuals of all targets of a trial, relative to the first trial's distance, weighted in a mean."""
    return _stacked_rows(form, trial)[:, -1]


def slopes(form: Formulation, trial: trials.Trial) -> Array:
    """Return their derivatives by the scaled parameters."""
    return _stacked_rows(form, trial)[:, : len(form.problem.free)] * form.width


def _stacked_rows(form: Formulation, trial: trials.Trial) -> Array:
    return np.vstack(
        [
            np.sqrt(term.weight / trial.squares[term.quantity.key].count) / form.size
            * trial.squares[term.quantity.key].triangle
            for term in form.problem.terms
        ]
    )  # fmt: skip


# ----------------------------------------------------------------------------------------------------------------------
# One start: a search, repeated if values on a fresh mesh differ from those of the search.


MAX_PASSES = 4
"""Maximum passes of a robust search: standard deviations are fixed in a pass, and updated at its end."""
ALLOWANCE_TOLERANCE = 1e-3
"""Change of the allowances, relative to a limit, below which a robust search has converged."""
MAX_CORRECTIONS = 4
"""Maximum number of continuations on a fresh mesh."""
MAX_WASTED_SLACK = 0.02
"""Relative slack of a limit on the fresh mesh, active in the search, above which the search continues."""


def follow(under_way: model.Evaluator, theta: Array) -> StartEnd:
    """Search from a design, values of the problem's `names`, and confirm the result; a design was judged before."""
    form = under_way.form
    assert form is not None
    seen: list[trials.Trial] = []
    ends: list[StartEnd] = []
    try:
        why = _robust_search(under_way, form, theta, seen)
        best = form.best(seen)
        if best is None or not under_way.how.get("confirm", True):
            return StartEnd(under_way.start, best, form, why=why)
        ends.append(StartEnd(under_way.start, best, form, *under_way.confirmed(best), why))
        safety = np.zeros(len(form.rows))
        while len(ends) <= MAX_CORRECTIONS and _must_continue(ends[-1], len(ends)):
            under_way.tell("limits differ on a fresh mesh: continuing the search from there")
            if len(ends) > 1:  # meshes differ randomly too
                safety = np.maximum(safety, _fresh_violations(ends[-1]))
            under_way.fresh_mesh()
            again = under_way.trial(np.array(best.theta))
            if again.failed:
                break
            form, seen = under_way.form.corrected(again, ends[-1].confirmed, safety), [again]  # type: ignore[union-attr]
            why = _robust_search(under_way, form, np.array(again.theta), seen)
            best = form.best(seen) or again
            ends.append(StartEnd(under_way.start, best, form, *under_way.confirmed(best), why))
    except trials.DesignStopped:
        best_trial = form.best(seen)
        end = ends[-1] if ends and best_trial is None else StartEnd(under_way.start, best_trial, form)
        return dataclasses.replace(end, why="because the user stopped it", stopped=True)
    return min(ends, key=StartEnd.order)


def _fresh_violations(end: StartEnd) -> Array:
    """Return how much more each limit is violated on the fresh mesh than in the search, relative to the limit."""
    assert end.best is not None
    allowances = end.form.allowances(end.best)
    return end.form.passed(end.confirmed, allowances) - (end.form.violations(end.best) - end.form.safety)


def _must_continue(end: StartEnd, rounds: int) -> bool:
    """Return whether a search has to continue: limits are violated on the fresh mesh, or inactive there for the first time."""
    if end.trouble or end.best is None or not end.form.rows or not end.form.feasible(end.best):
        return False
    fresh = end.form.passed(end.confirmed, end.form.allowances(end.best))
    met = end.form.violations(end.best) > -ACTIVE_TOLERANCE
    unused = rounds <= 2 and bool(met.any()) and float(fresh[met].max()) < -MAX_WASTED_SLACK
    return unused or not end.feasible


def _robust_search(under_way: model.Evaluator, form: Formulation, theta: Array, seen: list[trials.Trial]) -> str:
    """Search repeatedly until the standard deviations converge; return why it ended early. ``seen`` gets every trial."""
    start = form.x(theta)

    def judged(point: Array) -> trials.Trial:
        # Reproduce the start exactly, so that it is not evaluated twice.
        seen.append(under_way.trial(theta if np.array_equal(point, start) else form.theta(point)))
        return seen[-1]

    end = start
    try:
        if not len(start):  # only whole numbers are free
            judged(start)
            return ""
        if can_follow(form, judged(start)):
            followed(judged, form, start)
            return ""
        for _ in range(MAX_PASSES if form.spread.any else 1):
            allowances = form.allowances(judged(end))

            def evaluate(point: Array, allowances: Array = allowances) -> Scaled | None:
                before = set(under_way.visited)
                trial = judged(point)
                other_mesh = trial.remeshed and trial.number not in before
                if other_mesh:
                    del seen[:-1]  # compare only values of one mesh
                return None if trial.failed else form.scaled(trial, allowances, other_mesh)

            end = search(evaluate, end)
            change = np.abs(form.allowances(judged(end)) - allowances) / np.array([row.scale for row in form.rows])
            if change.max(initial=0.0) <= ALLOWANCE_TOLERANCE:
                break
    except model.EnoughError:
        return f"after {len(under_way.visited)} evaluations"
    return ""


# ----------------------------------------------------------------------------------------------------------------------
# Starting points of searches: the given device, then points spread over the bounds.


MAX_DRAWN_POINTS = 64
"""Number of points drawn; invalid devices, or those with too thin a wall, are skipped."""


def further_starts(problem: DesignProblem, seed: int) -> Iterator[Array]:
    """Yield the scaled parameters of devices spread over the bounds: a Latin hypercube (McKay, Beckman and Conover 1979)."""
    for x in scipy.stats.qmc.LatinHypercube(len(problem.free), rng=np.random.default_rng(seed)).random(MAX_DRAWN_POINTS):
        if _is_device(problem, x):
            yield x


def _is_device(problem: DesignProblem, x: Array) -> bool:
    values = {free.name: free.low + share * free.width for free, share in zip(problem.free, x, strict=True)}
    try:
        device = case.varied(problem.case, values).actuator
    except entries.INPUT_ERRORS:
        return False
    least = max([keep.at_least or 0.0 for keep in problem.limits if keep.quantity.name == CLEARANCES], default=0.0)
    return min(device.clearances.values(), default=least) >= least


# ----------------------------------------------------------------------------------------------------------------------
# Whole numbers in a design, such as the number of chambers, and stages of a network that grows: each is searched by itself, and
# the best is reported.


VARIANTS = "variants.csv"


def run_variants(
    problem: DesignProblem, folder: model.DesignFolder | None, comm: MPI.Comm, **how: Unpack[SearchOptions]
) -> DesignResult:
    """Optimise for each choice of the whole numbers, or each stage of a network that grows, each in a folder of its own; return
    the result of the best, with all in its `DesignResult.variants`. RunError if none of them has a state where it is asked."""
    tell, variants = functools.partial(model.report, comm, how), list[Variant]()
    mpi.on_root(comm, lambda: _begin(problem, folder, how))
    choices = problem.variants()
    if problem.growth:
        choices = grow.stages(problem, variants, folder, comm, how.get("resume", False), tell)
    for words, choice in choices:
        tell(f"{words}:")
        own = mpi.kept_on_root(comm, functools.partial(_choice_folder, choice, words, folder, how))
        try:
            variants.append(Variant(words, choice, run_in(choice, own, comm, **how)))
        except RunError as error:
            if error.status == commands.EXIT_STOPPED:
                raise
            variants.append(Variant(words, choice, None, str(error)))
        finally:
            if own is not None:
                own.leave()
        result = variants[-1].result
        if result is not None and result.stopped:
            break
    best = min(variants, key=lambda variant: variant.order)
    if best.result is None:
        of = f"choice of {', '.join(problem.counts)}" if problem.counts else "stage"
        raise RunError(f"no {of} can be evaluated: {variants[0].sentence}")
    made = dataclasses.replace(best.result, variants=tuple(choice.sentence for choice in variants))
    place = mpi.on_root(comm, lambda: None if folder is None else _write_best(folder, best, variants))
    return dataclasses.replace(made, folder=place)


def _name(words: str) -> str:
    return words.replace(", ", "-").replace(" ", "-")


def _begin(problem: DesignProblem, folder: model.DesignFolder | None, how: SearchOptions) -> None:
    """Claim the folder's files, once those of an earlier run are gone."""
    if folder is None:
        return
    if not how.get("resume", False):
        folder.own.remove(folder.own.files)
    folder.own.claim([model.TABLE, model.DESIGN, model.START, VARIANTS], {"inputs": folder.identity})


def _choice_folder(
    problem: DesignProblem, words: str, folder: model.DesignFolder | None, how: SearchOptions
) -> model.DesignFolder | None:
    if folder is None:
        return None
    folder.own.claim([f"{_name(words)}/"])
    return model.DesignFolder(problem, folder.path / _name(words), how.get("resume", False))


def _write_best(folder: model.DesignFolder, best: Variant, variants: list[Variant]) -> Path:
    """Write the best design, the table of all choices, and that of all designs; return the folder."""
    assert best.result is not None
    files.write_text(folder.path / model.START, case_text(best.problem, best.result.given))
    files.write_text(folder.path / model.DESIGN, case_text(best.problem, best.result.case))
    out = io.StringIO()
    rows = csv.writer(out, lineterminator="\n")
    asked = best.problem.terms[0].quantity
    rows.writerow(["variant", label(asked, best.problem.case), "limits kept", "designs", "failure"])
    for variant in variants:
        told = ["", "", 0] if variant.result is None else [
            in_words(asked, variant.result.end.objective, 7), int(variant.result.feasible), len(variant.result.trials),
        ]  # fmt: skip
        rows.writerow([variant.words, *told, variant.trouble])
    files.write_text(folder.path / VARIANTS, out.getvalue())
    files.write_text(folder.path / model.TABLE, "".join(_all_designs(variants)))
    return folder.path


def _all_designs(variants: list[Variant]) -> Iterator[str]:
    """Yield the lines of the table of all designs, each with its choice in front."""
    for number, choice in enumerate(variant for variant in variants if variant.result is not None):
        assert choice.result is not None
        head, *lines = model.table(choice.problem, choice.result.trials, choice.result.form).splitlines(keepends=True)
        if not number:
            yield f"variant,{head}"
        yield from (f'"{choice.words}",{text}' for text in lines)
