"""Bounded robust least squares over any sources of standardised residuals.

A source turns parameter values into residuals (model - measured) / error with exact derivatives. It may be a tensile
curve or a simulated outline. All decisions depend only on numbers from the sources, so processes
that share a source stay synchronised.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.optimize import OptimizeResult

from softmodels.common.arrays import Array
from softmodels.common.names import keep_arrays
from softmodels.fitting.problem import CannotEvaluate, FitError, Parameter, Problem, Residuals, loss_of
from softmodels.fitting.result import LeastSquaresFit, StartResult

LOSSES = ("linear", "soft_l1")
ERRORS = ("stated", "unknown")
SAME_DEVIANCE = 1e-4
"""Starts whose deviances differ by less than this (plus the same fraction) ended in the same minimum."""
TOLERANCE = 1e-10
"""At which a start ends: relative, on the sum of squares, on the parameters and on the gradient."""
FAR = 0.1
"""Newton step in standard errors above which a fit has not converged."""


def fit_parameters(
    sources: Sequence[Residuals],
    parameters: Sequence[Parameter],
    *,
    loss: str = "linear",
    starts: int | Sequence[Mapping[str, float]] = 1,
    errors: str = "stated",
    label: str = "",
    evaluations: int = 300,
) -> LeastSquaresFit:
    """Find the parameters that best fit all sources jointly.

    Args:
        sources: What was measured.
        parameters: Every parameter the sources name.
        loss: ``"linear"`` (least squares) or ``"soft_l1"``, in which residuals far above 1 count by their size and not by
            its square.
        starts: How many starting points: the parameters' own, then quasi-random ones around it (always the same). Or the
            starting values themselves; what they leave out, or have outside the bounds, starts at its parameter's own start.
        errors: ``"stated"``: the sources' errors are believed unless the scatter is larger. ``"unknown"``: only their
            ratios are; their size follows from the scatter.
        label: What is fitted, for reports.
        evaluations: Per start at most.

    Raises:
        FitError: The task is impossible, or no start could be evaluated.
    """
    _check(sources, parameters, loss, errors)
    problem = Problem(sources, parameters, loss)
    runs: list[StartResult] = []
    best: OptimizeResult | None = None
    for x in _starting_points(problem.free, starts):
        try:
            first = problem.residuals(x)
            if not np.isfinite(first).all():
                raise CannotEvaluate("the model has no finite value there")
            found = problem.solve(x, TOLERANCE, evaluations)
        except CannotEvaluate as error:
            runs.append(StartResult(problem.values(x), math.inf, str(error)))
            continue
        runs.append(
            StartResult(problem.values(found.x), 2 * float(found.cost), "" if found.status > 0 else found.message)
        )
        if best is None or found.cost < best.cost:
            best = found
    if best is None:
        raise FitError(f"the fit cannot start: {runs[0].trouble if runs else 'no starting values are given'}")
    try:
        return _judge(problem, best, runs, errors, label)
    except CannotEvaluate as error:
        raise FitError(f"the fit ended where its model cannot be evaluated: {error}") from None


def settled(fit: LeastSquaresFit) -> LeastSquaresFit:
    """Return a fit whose parameters that ended at zero are zero, not a rounding away from it."""
    ends = {name: bound for name, bound in fit.at_bounds.items() if bound == 0.0}
    return dataclasses.replace(fit, values={**fit.values, **ends}) if ends else fit


def _judge(
    problem: Problem, found: OptimizeResult, runs: list[StartResult], errors: str, label: str
) -> LeastSquaresFit:
    """Return the result with all warnings."""
    values = problem.values(found.x)
    residuals = problem.residuals(found.x)
    J, rows = problem.slopes(values)
    if len(residuals) < len(problem.free):
        few = f"{len(residuals)} numbers cannot determine {len(problem.free)} parameters"
        raise FitError(f"{few}; fix some parameters or add measurements")
    result = LeastSquaresFit(
        label=label or ", ".join(source.label for source in problem.sources), parameters=problem.parameters,
        values=values, residuals=residuals, jacobian=J, rows=rows,
        deviance=2 * float(found.cost), loss=problem.loss, errors=errors, evaluations=problem.evaluations,
        starts=tuple(runs), problem=problem, troubles=(),
    )  # fmt: skip
    troubles = []
    if found.status <= 0:
        troubles.append(f"the fit did not converge within {found.nfev} evaluations; do not use its values")
    elif (step := result.newton_step) > FAR:
        troubles.append(
            f"the fit stopped where a further step would still move it by {step:.2g} standard "
            "errors; do not use its values"
        )
    ends = [(p, result.at_bounds[p.name]) for p in result.free if p.name in result.at_bounds]
    troubles += [f"{p.words} ended at its bound {bound:.4g} {p.unit}".rstrip() for p, bound in ends]
    troubles += _disagreement(runs, result)
    return dataclasses.replace(result, troubles=tuple(troubles))


def _disagreement(runs: list[StartResult], result: LeastSquaresFit) -> list[str]:
    """Return warnings on starts that ended in a different, nearly as good minimum, and on failed starts."""
    room = SAME_DEVIANCE * (1 + result.deviance)
    likely = 3.84 * result.dispersion
    said = []
    rivals = [
        run
        for run in runs
        if math.isfinite(run.deviance) and run.deviance - result.deviance <= likely and _apart(run, result)
    ]
    if rivals:
        other = ", ".join(f"{p.name} {rivals[0].values[p.name]:.4g}" for p in result.free if not p.hidden)
        said.append(
            f"{len(rivals)} of {len(runs)} starts ended in another minimum that fits nearly as well ({other}): "
            "the data do not distinguish them"
        )
    ended = [run for run in runs if math.isfinite(run.deviance)]
    if len(ended) > 1 and sum(run.deviance - result.deviance <= room for run in ended) == 1:
        said.append(f"only one of {len(ended)} starts reached this minimum; there may be a better one")
    return said


def _apart(run: StartResult, result: LeastSquaresFit) -> bool:
    """Return whether a start ended further from the result than the result's own intervals reach.

    Terms that have changed places (Ogden's) are the same result.
    """
    here, there = (sorted(values[p.name] for p in result.free) for values in (result.values, run.values))
    if np.allclose(here, there, rtol=1e-3):
        return False
    for p in result.free:
        low, high = result.interval(p.name)
        reach = 1e-6 * abs(result.values[p.name])
        if p.name not in result.at_bounds and not low - reach <= run.values[p.name] <= high + reach:
            return True
    return False


def _starting_points(free: Sequence[Parameter], starts: int | Sequence[Mapping[str, float]]) -> list[Array]:
    """Return the starting coordinates: the given ones; or the parameters' own, then Halton points within a factor e^1.5, or one
    size, around them."""
    origin = np.array([p.inward(p.start) for p in free], dtype=float)
    if not isinstance(starts, int):
        chosen = [[start.get(p.name, p.start) for p in free] for start in starts]
        held = [[v if p.lower <= v <= p.upper else p.start for p, v in zip(free, one, strict=True)] for one in chosen]
        return [np.array([p.inward(v) for p, v in zip(free, one, strict=True)], dtype=float) for one in held]
    points = [origin]
    if starts > 1:
        from scipy.stats import qmc  # takes a second to load, and most fits do not need it

        spread = np.array([1.5 if p.logarithmic else 1.0 for p in free])
        bounds = np.sort([[p.inward(p.lower), p.inward(p.upper)] for p in free])
        for unit in qmc.Halton(len(free), scramble=False).random(starts)[1:]:
            points.append(np.clip(origin + spread * (2 * unit - 1), bounds[:, 0], bounds[:, 1]))
    return points


def _check(sources: Sequence[Residuals], parameters: Sequence[Parameter], loss: str, errors: str) -> None:
    names = [p.name for p in parameters]
    used = {name for source in sources for name in source.parameters}
    if not sources:
        raise FitError("there is nothing to fit to; give a tensile curve or outlines")
    if loss not in LOSSES:
        raise FitError(f"loss {loss!r} is not one of {', '.join(LOSSES)}")
    if errors not in ERRORS:
        raise FitError(f"errors {errors!r} is not one of {', '.join(ERRORS)}")
    if len(set(names)) < len(names):
        raise FitError(f"a parameter is given twice among {', '.join(names)}")
    if missing := used - set(names):
        raise FitError(f"no starting value for {', '.join(sorted(missing))}")
    if idle := [p.name for p in parameters if not p.fixed and p.name not in used and p.prior is None]:
        raise FitError(f"nothing measured depends on {', '.join(idle)}; fix it")
    if all(p.fixed for p in parameters):
        raise FitError("every parameter is fixed; free at least one")


# ----------------------------------------------------------------------------------------------------------------------
# Profile likelihoods: the rise of the deviance with one parameter fixed away from its best value.


REACH = 1.6
"""Initial range of a profile, in half widths of the expected interval."""
DOUBLINGS = 6
CLOSER, STEEP = 8, 1.5
"""Maximum refinements of the interval's end, and the relative rise above which they are needed."""
RESTART_TOLERANCE = 1e-9


@dataclasses.dataclass(frozen=True, eq=False)
class Profile:
    """A profile likelihood.

    Attributes:
        name: The parameter.
        unit: Its unit.
        values: Where it was held, rising, in its unit.
        rises: Rise of the deviance over the best one there, divided by what one independent residual is worth.
        limit: The rise at the ends of the 95 % interval.
        interval: Ends of the 95 % interval; infinite where the rise never reaches the limit, or the parameter's bound.
        trouble: A sentence if the profile found a better fit than the fit itself, else empty.
    """

    name: str
    unit: str
    values: Array
    rises: Array
    limit: float
    interval: tuple[float, float]
    trouble: str

    def __post_init__(self) -> None:
        keep_arrays(self)


def profile(result: LeastSquaresFit, name: str, n: int = 15) -> Profile:
    """Fix a parameter at values on both sides of its best one and refit the others.

    The interval is where the deviance rises by less than the square of Student's (or the normal) quantile times the
    residuals' dispersion and run: it bends with the model where the covariance's interval cannot (Venzon & Moolgavkar
    1988, doi 10.2307/2347496).

    Args:
        result: The fit.
        name: A free parameter.
        n: Values to hold it at, about; more where the interval's end is far.
    """
    p = next(q for q in result.free if q.name == name)
    worth = _worth(result, name)
    limit = result.quantile**2
    best = result.values[name]
    points = [(best, 0.0)]
    for sign in (-1.0, 1.0):
        points += _side(result, p, sign, max(n // 2, 3), worth, limit)
    points.sort()
    values, rises = np.array(points).T
    ends = tuple(_end(values, rises, best, limit, sign) for sign in (-1.0, 1.0))
    interval = (ends[0] if ends[0] is not None else p.lower, ends[1] if ends[1] is not None else p.upper)
    better = float(rises.min())
    trouble = (
        f"fixing {name} at {values[rises.argmin()]:.4g} gave a better fit than the original one"
        if better < -0.05
        else ""
    )
    return Profile(name, p.unit, values, rises, limit, interval, trouble)


def _worth(result: LeastSquaresFit, name: str) -> float:
    """Return the rise of the deviance equivalent to 1: its curvature along the profile times the parameter's variance."""
    names = [p.name for p in result.free]
    slope = result.influence[1]
    error = result.reach(name) / result.quantile
    if not (math.isfinite(error) and error > 0.0):
        return result.dispersion * slope * result.count / result.independent
    inside = [i for i, q in enumerate(result.free) if q.name not in result.at_bounds]
    J = result.jacobian[:, inside]
    size = np.linalg.norm(J, axis=0)
    bread, _ = result.information(J / size)
    place = inside.index(names.index(name))
    return error**2 * size[place] ** 2 / float(np.linalg.pinv(bread, rcond=1e-16, hermitian=True)[place, place])


def _side(
    result: LeastSquaresFit, p: Parameter, sign: float, count: int, worth: float, limit: float
) -> list[tuple[float, float]]:
    """Return the values and rises outward from the best value, until the limit is passed or a bound is reached."""
    best = result.values[p.name]
    bound = p.upper if sign > 0 else p.lower
    if best == bound:
        return []
    whole = result.reach(p.name)
    reach = REACH * whole if math.isfinite(whole) and whole > 0.0 else 0.5 * (abs(best) or p.scale)
    warm = dict(result.values)
    found: list[tuple[float, float]] = []
    held, step = best, reach / count
    for i in range(count + 3 * DOUBLINGS):
        if i >= count:
            step *= 1.5
        held = best + sign * step if not found else held + sign * step
        ended = (held - bound) * sign >= 0.0
        held = bound if ended else held
        solved = _held(result, p.name, held, warm)
        if solved is None:  # the model cannot be evaluated there: the profile ends
            found.append((held, math.inf))
            break
        rise = (solved[0] - result.deviance) / worth
        warm = solved[1]
        found.append((held, rise))
        if ended or (rise > limit and (i + 1 >= count or rise > 4 * limit)):
            break
    return found + _closer(result, p.name, [(best, 0.0), *found], worth, limit)


def _closer(
    result: LeastSquaresFit, name: str, outward: list[tuple[float, float]], worth: float, limit: float
) -> list[tuple[float, float]]:
    """Add points near the crossing of the limit if the steps are too large for linear interpolation."""
    more: list[tuple[float, float]] = []
    crossing = next((i for i in range(1, len(outward)) if outward[i][1] >= limit), None)
    if crossing is None:
        return more
    inner, outer = outward[crossing - 1], outward[crossing]
    for _ in range(CLOSER):
        if outer[1] < STEEP * limit:
            break
        middle = (inner[0] + outer[0]) / 2
        solved = _held(result, name, middle, dict(result.values))
        point = (middle, (solved[0] - result.deviance) / worth if solved else math.inf)
        more.append(point)
        inner, outer = (inner, point) if point[1] >= limit else (point, outer)
    return more


def _held(
    result: LeastSquaresFit, name: str, value: float, warm: dict[str, float]
) -> tuple[float, dict[str, float]] | None:
    """Return the deviance and values with one parameter fixed; None if not available."""
    parameters = [
        dataclasses.replace(p, start=value, fixed=True)
        if p.name == name
        else p
        if p.fixed
        else dataclasses.replace(p, start=min(max(warm[p.name], p.lower), p.upper))
        for p in result.parameters
    ]
    problem = Problem(result.problem.sources, parameters, result.loss)
    prior = next((p.prior for p in result.parameters if p.name == name), None)
    extra = ((value - prior.mean) / prior.error) ** 2 if prior else 0.0
    try:
        x = np.array([p.inward(p.start) for p in problem.free], dtype=float)
        rows = problem.residuals(x)
        if not np.isfinite(rows).all():
            return None
        if not problem.free:
            return float(loss_of(result.loss, rows**2, 0)[0].sum()) + extra, problem.values(x)
        found = problem.solve(x, RESTART_TOLERANCE, 100)
    except CannotEvaluate:
        return None
    return 2 * float(found.cost) + extra, problem.values(found.x)


def _end(values: Array, rises: Array, best: float, limit: float, sign: float) -> float | None:
    """Return where the signed root of the rise, nearly straight in the parameter, crosses the limit."""
    outward = [(v, r) for v, r in zip(values, rises, strict=True) if (v - best) * sign >= 0.0]
    outward.sort(key=lambda point: abs(point[0] - best))
    for (v0, r0), (v1, r1) in itertools.pairwise(outward):
        if r1 >= limit > r0:
            a, b, goal = math.sqrt(max(r0, 0.0)), math.sqrt(r1), math.sqrt(limit)
            return float(v0 + (v1 - v0) * (goal - a) / (b - a))
    return None
