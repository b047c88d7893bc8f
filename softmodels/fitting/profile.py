"""Profile likelihoods: how much worse the fit becomes as one parameter is held away from its best value."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import numpy.typing as npt

from measurement.read_only import keep_arrays
from softmodels.fitting.problem import CannotEvaluate, Parameter, Problem, loss_of
from softmodels.fitting.result import LeastSquaresFit

Array = npt.NDArray[np.float64]
REACH = 1.6
"""How far beyond the expected interval a profile looks at first, in half widths."""
DOUBLINGS = 6
CLOSER, STEEP = 8, 1.5
"""How often the interval's end is looked for more closely, and above which rise, in limits, that is needed."""
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
    """Hold a parameter at values on both sides of its best one and fit the others anew.

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
    trouble = f"holding {name} at {values[rises.argmin()]:.4g} gave a better fit than the fit" if better < -0.05 else ""
    return Profile(name, p.unit, values, rises, limit, interval, trouble)


def _worth(result: LeastSquaresFit, name: str) -> float:
    """Rise of the deviance that counts as 1: its curvature along the profile times the parameter's variance."""
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
    """Values and rises outward from the best value, until the limit is passed or a bound is reached."""
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
        if solved is None:  # the law has no answer there: the likelihood ends
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
    """More points about the crossing of the limit, where the profile leaps over it too far for a straight line."""
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
    """Deviance and values with one parameter held; None where there is no answer."""
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
    """Where the signed root of the rise, nearly straight in the parameter, crosses the limit."""
    outward = [(v, r) for v, r in zip(values, rises, strict=True) if (v - best) * sign >= 0.0]
    outward.sort(key=lambda point: abs(point[0] - best))
    for (v0, r0), (v1, r1) in itertools.pairwise(outward):
        if r1 >= limit > r0:
            a, b, goal = math.sqrt(max(r0, 0.0)), math.sqrt(r1), math.sqrt(limit)
            return float(v0 + (v1 - v0) * (goal - a) / (b - a))
    return None
