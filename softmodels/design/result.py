"""The result of an optimisation, and its description in sentences."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import math
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import TypedDict

import numpy as np
import tomli_w

from geometries import Actuator
from softmodels.case import case, entries
from softmodels.case.case import Case
from softmodels.common import cards, commands, names, units
from softmodels.common.arrays import Array
from softmodels.common.lazy import scipy
from softmodels.design import extremes, trials
from softmodels.design.problem import (
    ONE_SIDED_95,
    SAFETY_MARGIN,
    ConstraintRow,
    DesignProblem,
    Formulation,
    Free,
    in_words,
    label,
    shown,
    shown_factor,
)
from softmodels.design.trials import Trial


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class DesignResult(cards.ResultCard):
    """The outcome of an optimisation: the best end of all starts and what holds it back, all trials, where each start ended,
    how much finer the fresh mesh was, the folder if there is one, and with each choice of whole numbers a sentence."""

    problem: DesignProblem
    end: StartEnd
    trials: tuple[Trial, ...]
    ends: tuple[StartEnd, ...]
    holding: ActiveLimits
    finer: float = 1.0
    stopped: bool = False
    folder: Path | None = None
    variants: tuple[str, ...] = ()

    @property
    def best(self) -> Trial:
        """The best design: within all limits, or else with the smallest violation."""
        assert self.end.best is not None
        return self.end.best

    @property
    def form(self) -> Formulation:
        """The problem in scaled numbers."""
        return self.end.form

    @property
    def confirmed(self) -> Mapping[str, float]:
        """Values of the best design on a fresh mesh; empty if there are none."""
        return self.end.confirmed

    @property
    def trouble(self) -> str:
        """Why the design could not be confirmed; empty for none."""
        return self.end.trouble

    @property
    def first(self) -> Trial:
        """The given device."""
        return self.trials[0]

    @property
    def feasible(self) -> bool:
        """Whether the best design satisfies all limits."""
        return self.end.feasible

    @property
    def parameters(self) -> dict[str, float]:
        """Free parameters of the best design, SI units."""
        return {free.name: value for free, value in zip(self.problem.free, self.best.theta, strict=False)}

    @property
    def device(self) -> Actuator:
        """The best device."""
        return self.case.actuator

    @property
    def given(self) -> Case:
        """The case of the device as given."""
        return dataclasses.replace(self.problem.case, name=self.problem.name)

    @property
    def case(self) -> Case:
        """The case of the best device."""
        return case_of(self.problem, self.best)

    @property
    def values(self) -> Mapping[str, float]:
        """Reported values of the best design: on the fresh mesh, or on the search's if there is none."""
        return self.end.values

    # -- in words -----------------------------------------------------------------------------------------------------

    def _line(self) -> str:
        return f"of {self.problem.name}: {self.headline}"

    def _figures(self) -> cards.Table:
        return [
            (record["name"], f"{record['before']:.4g} to {record['after']:.4g} {record['unit']}".strip())
            for record in parameters_told(self)
        ]

    def _remarks(self) -> list[str]:
        return [*self.missed, *self.reasons, *filter(None, [self.trouble])]

    @property
    def headline(self) -> str:
        """The result in a sentence."""
        case, failed = self.problem.case, sum(trial.failed for trial in self.trials)
        words = "; ".join(
            f"{label(term.quantity, case)} {in_words(term.quantity, self.first.values[term.quantity.key])} at the start, "
            f"{in_words(term.quantity, self.values[term.quantity.key])} in the design"
            for term in self.problem.terms
        )
        count = f"{len(self.trials)} designs evaluated" + (f", {failed} of them without a state" if failed else "")
        limits = "all limits satisfied" if self.feasible else "not all limits can be satisfied"
        chosen = "".join(f"{name} {value}: " for name, value in self.problem.fixed.items())
        return f"{'stopped by the user; so far: ' if self.stopped else ''}{chosen}{words}; {limits}; {count}"

    @property
    def missed(self) -> list[str]:
        """The limits violated by the best design, with their values."""
        violations = self.form.passed(self.values, self.form.allowances(self.best))
        return [
            f"{row.words} is {in_words(row.keep.quantity, self.values[row.key])}, but must "
            f"be {'at most' if row.sign > 0 else 'at least'} {in_words(row.keep.quantity, row.limit)}"
            + (": walls overlap, so the other values are invalid" if _overlaps(row, self.values) else "")
            for row, violation in zip(self.form.rows, violations, strict=True)
            if violation > FRESH_LIMIT
        ]

    @property
    def reasons(self) -> list[str]:
        """The active limits of the design, in sentences."""
        holders = self.holding.holders
        if not self.feasible and self.form.feasible(self.best):
            passed = (
                f"limits satisfied in the search are violated by up to {self.end.passed:.2%} on "
                f"the fresh mesh, within the mesh error; use smaller cells, or set stricter limits"
            )
            return [passed, *(holder.sentence for holder in holders)]
        if self.feasible:
            if not holders and self.holding.balanced:
                return ["no limit is active: this is a local optimum"]
            return [holder.sentence for holder in holders]
        if self.end.why:
            return [f"no design so far satisfies all limits (the search ended {self.end.why}); continue with more evaluations"]
        held = [holder.words for holder in holders]
        what = (
            f"{' and '.join(held)} are incompatible"
            if len(held) > 1
            else f"{' '.join(held) or 'its limits'} cannot be satisfied"
        )
        told = [f"the problem is infeasible, and this is the closest design: {what}"]
        failed = sum(trial.failed for trial in self.trials)
        if failed and not self.holding.balanced:
            told.append(f"{failed} neighbouring designs have no state at the requested pressures, which also limits the result")
        return told + [holder.sentence for holder in holders if holder.sentence and holder.sentence != holder.words]

    @property
    def agreement(self) -> str:
        """Whether the starts agree; empty for a single one."""
        judged = [end for end in self.ends if end.best is not None]
        if len(self.ends) < 2:
            return ""
        if len(judged) < 2:
            return f"only one of {len(self.ends)} starts succeeded"
        same = sum(self._same(judged_end) for judged_end in judged)
        if same == len(judged):
            return f"the {len(judged)} starts agree"
        values = ", ".join(
            in_words(self.problem.terms[0].quantity, judged_end.objective)
            + ("" if judged_end.feasible else " (limits violated)")
            for judged_end in judged
        )
        return f"{same} of {len(judged)} starts agree with the best; they ended at {values}"

    def _same(self, other: StartEnd) -> bool:
        assert other.best is not None
        if other.feasible != self.feasible:
            return False
        if abs(other.objective - self.end.objective) <= SAME_VALUE * abs(self.end.objective):
            return True
        steps = np.abs(self.form.x(np.array(other.best.theta)) - self.form.x(np.array(self.best.theta)))
        return bool(steps.max() <= SAME_PLACE)

    @property
    def confirmation(self) -> list[str]:
        """The values on the search's mesh compared with those on the fresh one."""
        told = []
        for asked in self.problem.quantities:
            for key in [key for key in self.confirmed if key == asked.key or key.startswith(f"{asked.key.removesuffix('s')}:")]:
                if key not in self.best.values:
                    continue
                in_search, fresh = self.best.values[key], self.confirmed[key]
                share = abs(fresh - in_search) / max(abs(fresh), 1e-300)
                if share < 1e-9:  # depends only on the geometry
                    continue
                words = label(asked, self.problem.case) if key == asked.key else key
                told.append(
                    f"{words}: {in_words(asked, fresh, 5)} on the fresh mesh, {in_words(asked, in_search, 5)} in the search "
                    f"({share:.2%} apart{', more than ' + format(MESH_TOLERANCE, '.0%') if share > MESH_TOLERANCE else ''})"
                )
        return told

    @property
    def recovered(self) -> ParameterIntervals | None:
        """The parameters determined by a target; None without a target or errors."""
        return recovered(self.form, self.best)

    @property
    def margins(self) -> list[str]:
        """The allowances of each limit for tolerances and the material's errors, in sentences."""
        if not self.form.spread.any:
            return []
        allowances = self.form.allowances(self.best)
        told = []
        for row, taken in zip(self.form.rows, allowances, strict=True):
            asked, value = row.keep.quantity, self.values[row.key]
            half, end = taken / ONE_SIDED_95 * units.HALF_WIDTH_95, in_words(asked, value + row.sign * taken)
            told.append(
                f"{row.text}: {in_words(asked, value)} +- {in_words(asked, half, 2)} (95 %), so with 95 % "
                f"{'below' if row.sign > 0 else 'above'} {end}"
            )
        return told


@dataclasses.dataclass(frozen=True, eq=False)
class Variant:
    """One choice of the whole numbers, in words as in ``chambers 4``, or one stage of a network: the problem in which only
    continuous parameters are free, and its result, or the trouble why there is none."""

    words: str
    problem: DesignProblem
    result: DesignResult | None
    trouble: str = ""

    @property
    def order(self) -> tuple[float, ...]:
        """Sorts the best first."""
        if self.result is None:
            return True, True, 0.0
        end = self.result.end
        return (False, *end.order()) if end.best is not None else (True, True, 0.0)

    @property
    def sentence(self) -> str:
        """What was found, in a sentence."""
        if self.result is None:
            return f"{self.words}: {self.trouble}"
        asked = self.problem.terms[0].quantity
        limits = "" if self.result.feasible else " (limits violated)"
        value = in_words(asked, self.result.end.objective, 5)
        return f"{self.words}: {label(asked, self.problem.case)} {value}{limits}, {len(self.result.trials)} designs"


# ----------------------------------------------------------------------------------------------------------------------
# Identifiability of parameters from a target: standard errors, intervals, and weakly determined combinations.
#
# With the residuals' Jacobian J at the end and their variance s^2 the parameters' covariance is s^2 (J^T J)^-1, as long as the
# residuals are nearly linear over it (Gauss and Newton; Seber and Wild 2003, Nonlinear regression, chapter 2). If residuals
# are correlated over a run of neighbours, only every run-th of them counts. A parameter at a bound is fixed there: the
# errors of the others assume it known.


AT_BOUND = 1e-6
"""Tolerance relative to the range within which a parameter is at a bound."""
WEAK_INTERVAL = 0.5
"""Half width of a 95 % interval, relative to the range, above which a combination is weakly determined."""
MIN_NAMED_COMPONENT = 0.1
"""Minimum component, relative to the largest, for naming a parameter in a combination."""
SHOWN_CHANGE = 0.1
"""Change of the largest component of a combination in its description, relative to its range."""


@dataclasses.dataclass(frozen=True)
class Interval:
    """A parameter determined by a target, SI units: its value, its standard error (inf where the target does not tell it, 0
    at a bound), and the ends of the 95 % interval."""

    parameter: Free
    value: float
    error: float
    low: float
    high: float
    at_bound: bool = False

    @property
    def sentence(self) -> str:
        """The interval in words."""
        free = self.parameter
        if self.at_bound:
            return f"{free.name} {free.text(self.value)}: at its bound, so the target does not determine it further"
        if not math.isfinite(self.error):
            return f"{free.name} {free.text(self.value)}: not determined by the target"
        return (
            f"{free.name} {free.text(self.value, 5)} +- {free.text(self.error, 2)} (one standard error), with 95 % between "
            f"{free.text(self.low, 5)} and {free.text(self.high, 5)}"
        )


@dataclasses.dataclass(frozen=True, eq=False)
class ParameterIntervals:
    """Device parameters determined by a target: the interval of each, the covariance of those that are not at a bound in SI
    units, the weakest combination (a sentence, empty with fewer than two parameters), and a clause on the source of the
    residuals' standard error."""

    intervals: tuple[Interval, ...]
    covariance: Array
    weakest: str
    source: str

    def __post_init__(self) -> None:
        names.keep_arrays(self)

    @property
    def sentences(self) -> list[str]:
        """All intervals in words."""
        return [*(interval.sentence for interval in self.intervals), *filter(None, [self.weakest]), self.source]


def recovered(form: Formulation, trial: Trial) -> ParameterIntervals | None:
    """Return the parameters determined by a problem's targets at a trial; None without a target or errors."""
    problem = form.problem
    terms = [(term.quantity, trial.squares.get(term.quantity.key)) for term in problem.terms]
    if problem.objective != "follow" or any(squares is None for _, squares in terms):
        return None
    count = len(problem.free)
    theta = np.array(trial.theta[:count])
    x = form.x(np.array(trial.theta))
    inside = (x > AT_BOUND) & (x < 1.0 - AT_BOUND)
    parts = [squares for _, squares in terms if squares is not None]
    counted = sum(squares.count / squares.run for squares in parts)
    freedom = counted - int(inside.sum())
    known = all(squares.sigma > 0.0 for squares in parts)
    left = sum(float(squares.residuals @ squares.residuals) / squares.run for squares in parts)
    if not known and freedom < 1.0:
        return None
    variance = 0.0 if known else left / freedom
    J = np.vstack([
        squares.jacobian[:, :count][:, inside] * form.width[inside]
        / math.sqrt(squares.run * (squares.sigma**2 if known else max(variance, 1e-300)))
        for squares in parts
    ])  # fmt: skip
    _, values, vectors = np.linalg.svd(J)
    values = np.pad(values, (0, len(vectors) - len(values)))
    told_at_all = values > 1e-12 * values.max(initial=0.0)
    inverse = np.where(told_at_all, 1.0 / np.where(told_at_all, values, 1.0), np.inf)
    scaled = _covariance(vectors, inverse)
    # Student's: the variance is estimated from few residuals.
    quantile = float(scipy.stats.t.ppf(0.975, math.inf if known else freedom))
    errors = np.zeros(count)
    errors[inside] = np.sqrt(np.diag(scaled)) * form.width[inside]
    intervals = tuple(
        Interval(parameter, value, error, value - quantile * error, value + quantile * error, not free)
        for parameter, value, error, free in zip(problem.free, theta.tolist(), errors.tolist(), inside.tolist(), strict=True)
    )
    asked = problem.terms[0].quantity
    if known:
        source = "errors from the given standard errors"
    else:
        source = f"errors from the final residuals, {in_words(asked, math.sqrt(variance), 3)} per value"
    source += f"; {counted:.0f} independent values"
    free = [parameter for parameter, is_free in zip(problem.free, inside, strict=True) if is_free]
    weakest = _weakest_combination(form, trial, free, vectors[-1], quantile * inverse[-1]) if len(free) > 1 else ""
    return ParameterIntervals(intervals, scaled * np.outer(form.width[inside], form.width[inside]), weakest, source)


def _covariance(vectors: Array, inverse: Array) -> Array:
    """From right singular vectors, in rows, and one over the singular values, of which some may be infinite."""
    finite = np.isfinite(inverse)
    covariance = (vectors[finite].T * inverse[finite] ** 2) @ vectors[finite]
    for vector in vectors[~finite]:
        blind = np.abs(vector) > 1e-6
        covariance[blind, blind] = np.inf
    return np.asarray(covariance)


def _weakest_combination(form: Formulation, trial: Trial, free: list[Free], vector: Array, half: float) -> str:
    """Return the least determined combination, in words."""
    vector = vector / vector[np.argmax(np.abs(vector))]
    parts = []
    changes = {}
    for parameter, share in zip(free, vector, strict=True):
        step = SHOWN_CHANGE * share * parameter.width
        changes[parameter.name] = step
        if abs(share) >= MIN_NAMED_COMPONENT:
            unit = trials.shown_unit(parameter.unit) or "1"
            shown = step / trials.factor(unit, parameter.unit or "1")
            parts.append(f"{parameter.name} {shown:+.2g}{'' if unit == '1' else ' ' + unit}")
    asked = form.problem.terms[0].quantity
    steps = np.array([changes.get(parameter.name, 0.0) for parameter in form.problem.free])
    moved = 0.0
    for term in form.problem.terms:
        squares = trial.squares[term.quantity.key]
        change = squares.jacobian[:, : len(steps)] @ steps
        moved += term.weight * float(change @ change) / squares.count
    together = "together " if len(parts) > 1 else ""
    words = f"{', '.join(parts)} {together}would move the device by {in_words(asked, math.sqrt(moved), 2)} from the target"
    if half > WEAK_INTERVAL:
        return f"one combination of the parameters is weakly determined: {words}"
    return f"least determined: {words}"


# ----------------------------------------------------------------------------------------------------------------------
# Active limits of a design: Lagrange multipliers in plain words.
#
# At an optimum the objective's gradient is a sum of the active limits' gradients, each times a non-negative multiplier (Karush,
# Kuhn and Tucker). They are found by non-negative least squares from the gradients, independent of the search.


ACTIVE_TOLERANCE = 5e-3
"""Fraction of a limit above which it is active."""
MIN_MULTIPLIER = 1e-3
"""Multipliers below this fraction of the largest count as zero."""
MAX_GRADIENT_REMAINDER = 0.2
"""Maximum relative remainder of the objective's gradient at an optimum."""


@dataclasses.dataclass(frozen=True)
class ActiveLimit:
    """An active limit (``row``) or bound in words, and in a sentence what it costs. The multiplier is the gain in scaled
    objectives per scaled limit; of a request that cannot be met, its share in what excludes each other."""

    words: str
    multiplier: float
    sentence: str
    row: ConstraintRow | None = None


@dataclasses.dataclass(frozen=True)
class ActiveLimits:
    """Active limits and bounds of a design, the largest multiplier first. Where they are balanced, they explain the
    objective's slope, and the design is an optimum."""

    holders: tuple[ActiveLimit, ...]
    balanced: bool


def holding(form: Formulation, trial: Trial) -> ActiveLimits:
    """Return the active limits and bounds of a design, from its gradients."""
    scaled = form.scaled(trial, form.allowances(trial))
    violations = scaled.c - SAFETY_MARGIN
    infeasible = bool(violations.max(initial=-1.0) > 1e-9)
    met = violations.max() - ACTIVE_TOLERANCE if infeasible else -ACTIVE_TOLERANCE
    rows = [k for k in range(len(form.rows)) if violations[k] >= met]
    x = form.x(np.array(trial.theta))
    bounds = [(k, -1.0) for k in range(len(x)) if x[k] <= AT_BOUND] + [(k, 1.0) for k in range(len(x)) if x[k] >= 1 - AT_BOUND]
    columns = [scaled.dc[k] for k in rows] + [sign * np.eye(len(x))[k] for k, sign in bounds]
    if not columns:
        return ActiveLimits((), not scaled.df.any())
    A, wanted = np.array(columns).T, -scaled.df
    if infeasible:  # sum of slopes zero, shares of the limits one
        share = np.array([1.0] * len(rows) + [0.0] * len(bounds))
        A, wanted = np.vstack([A, share]), np.append(np.zeros(len(x)), 1.0)
    multipliers, rest = scipy.optimize.nnls(A, wanted)
    size = float(np.linalg.norm(wanted)) or 1.0
    limits = []
    for place in np.argsort(-multipliers):
        if multipliers[place] <= MIN_MULTIPLIER * multipliers.max():
            continue
        if place < len(rows):
            row = form.rows[rows[place]]
            sentence = "" if infeasible else _limit_sentence(form, row, float(multipliers[place]))
            limits.append(ActiveLimit(row.text, float(multipliers[place]), sentence, row))
        else:
            limits.append(_bound(form, bounds[place - len(rows)], float(multipliers[place]), infeasible))
    if infeasible:
        limits = _trades(limits)
    return ActiveLimits(tuple(limits), rest <= MAX_GRADIENT_REMAINDER * size)


def _round(value: float) -> float:
    """Return 1, 2 or 5 times a power of ten near a value."""
    if value <= 0.0 or not math.isfinite(value):
        return 1.0
    power = 10.0 ** math.floor(math.log10(value))
    return float(min((1.0, 2.0, 5.0, 10.0), key=lambda digit: abs(math.log(value / (digit * power)))) * power)


def _gain(form: Formulation, amount: float) -> str:
    """Return a gain of the objective in words."""
    asked = form.problem.terms[0].quantity
    words = label(asked, form.problem.case) if len(form.problem.terms) == 1 else asked.title
    return f"{in_words(asked, amount, 2)} {'more' if form.problem.sign < 0 else 'less'} {words}"


def _limit_sentence(form: Formulation, row: ConstraintRow, multiplier: float) -> str:
    asked, per_unit = row.keep.quantity, form.size * multiplier / row.scale
    step = _round(0.05 * row.scale / shown_factor(asked)) * shown_factor(asked)
    objective = form.problem.terms[0].quantity
    change = _round(0.05 * form.size / shown_factor(objective)) * shown_factor(objective)
    return (
        f"{row.text}: relaxing this limit by {in_words(asked, step)} gains "
        f"{_gain(form, per_unit * step)}; {_gain(form, change)} costs about {in_words(asked, change / per_unit, 2)} of it"
    )


def _bound(form: Formulation, bound: tuple[int, float], multiplier: float, infeasible: bool) -> ActiveLimit:
    parameter, sign = form.problem.free[bound[0]], bound[1]
    end = parameter.text(parameter.high if sign > 0 else parameter.low)
    if infeasible:
        return ActiveLimit(f"{parameter.name} {'at most' if sign > 0 else 'at least'} {end} (its bound)", multiplier, "")
    words = f"{parameter.name} is at its {'upper' if sign > 0 else 'lower'} bound, {end}"
    shown, unit = trials.shown_unit(parameter.unit) or "1", parameter.unit or "1"
    step = _round(0.1 * parameter.width / trials.factor(shown, unit)) * trials.factor(shown, unit)
    gain = _gain(form, form.size * multiplier * step / parameter.width)
    more = "more" if sign > 0 else "less"
    return ActiveLimit(words, multiplier, f"{words}: {trials.text(step, shown, unit)} {more} gains about {gain}")


def _trades(holders: list[ActiveLimit]) -> list[ActiveLimit]:
    """Yield, for conflicting limits, the cost of the first in terms of each other one."""
    limits = [holder for holder in holders if holder.row is not None]
    if not limits:
        return holders
    first = limits[0]
    assert first.row is not None
    asked = first.row.keep.quantity
    step = _round(0.05 * first.row.scale / shown_factor(asked)) * shown_factor(asked)
    traded = []
    for holder in holders:
        if holder.row is None or holder is first:
            traded.append(holder)
            continue
        other = holder.row.keep.quantity
        cost = step * (first.multiplier / first.row.scale) / (holder.multiplier / holder.row.scale)
        sentence = (
            f"{in_words(asked, step)} {'less' if first.row.sign > 0 else 'more'} {first.row.words} costs about "
            f"{in_words(other, cost, 2)} of {holder.row.words}"
        )
        traded.append(dataclasses.replace(holder, sentence=sentence))
    return traded


# ----------------------------------------------------------------------------------------------------------------------
# Cases of evaluated designs.


KEPT_TABLES = ("material", "load")
"""Tables that a design does not change, written as by the user."""


def case_of(problem: DesignProblem, trial: Trial) -> Case:
    """Return the case of a trial's device; GeometryError or CaseError if it is none."""
    values = dict(zip((free.name for free in problem.free), trial.theta, strict=False))
    return dataclasses.replace(case.varied(problem.case, values), name=problem.name)


def case_text(problem: DesignProblem, case: Case) -> str:
    """Return a case of this problem as file text, with silicone and loads as written by the user, such as ``pressure = "0:30
    kPa"``.

    What would not be read as the same case elsewhere, such as a material's file, is written in numbers.
    """
    exact = case.to_toml()
    changed = {free.name.partition(".")[0] for free in problem.free if "." in free.name}
    own = {name: problem.written[name] for name in KEPT_TABLES if name in problem.written and name not in changed}
    text = tomli_w.dumps({**tomllib.loads(exact), **own})
    with contextlib.suppress(*entries.INPUT_ERRORS):
        if Case.from_toml(text) == case:
            return text
    return exact


SAME_VALUE, SAME_PLACE = 0.01, 0.05
"""Starts agree if their results differ by less than these fractions of the objective, or of each parameter's range."""
FRESH_LIMIT = 2e-3
"""Relative violation of a limit allowed on the fresh mesh; the search itself keeps a margin."""
MESH_TOLERANCE = 0.02
"""Relative difference of a value on the fresh mesh above which a warning is given."""


@dataclasses.dataclass(frozen=True, eq=False)
class StartEnd:
    """The result of one start: its best trial, if one could be judged; the problem in scaled numbers, with what is known of
    the difference to a fresh mesh; the values confirmed on it, or the trouble why there are none; and why it ended before an
    optimum, if it did; ``stopped`` if the user stopped it."""

    start: int
    best: Trial | None
    form: Formulation
    confirmed: Mapping[str, float] = dataclasses.field(default_factory=dict)
    trouble: str = ""
    why: str = ""
    stopped: bool = False

    @property
    def values(self) -> Mapping[str, float]:
        """Reported values: on the fresh mesh, or on the search's if there is none."""
        return self.confirmed or ({} if self.best is None else self.best.values)

    @property
    def objective(self) -> float:
        return sum(term.weight * self.values[term.quantity.key] for term in self.form.problem.terms)

    @property
    def passed(self) -> float:
        """Largest relative violation of a limit; negative if all are satisfied."""
        assert self.best is not None
        if not self.confirmed:
            return self.form.worst(self.best)[0]
        return float(self.form.passed(self.confirmed, self.form.allowances(self.best)).max(initial=-1.0))

    @property
    def feasible(self) -> bool:
        """Whether its best trial satisfies all limits: in the search, and on the fresh mesh within tolerance."""
        return self.best is not None and self.form.feasible(self.best) and self.passed <= FRESH_LIMIT

    def order(self) -> tuple[bool, bool, float]:
        """Return the sorting key of results, smallest for the best: no failure, all limits satisfied, the objective; or else
        the violation."""
        if self.feasible:
            return bool(self.trouble), False, self.form.problem.sign * self.objective
        return bool(self.trouble), True, self.passed


def _overlaps(row: ConstraintRow, values: Mapping[str, float]) -> bool:
    """Return whether a limit's value means that walls overlap."""
    return isinstance(row.keep.quantity, extremes.LeastGap) and values[row.key] < 0.0


# ----------------------------------------------------------------------------------------------------------------------
# Summary of a result as plain numbers and sentences in ``design.json``, for pictures and report.


DESIGN_FILE = "design.json"


class ParameterRecord(TypedDict):
    """A free parameter: its bounds and values, in its display unit."""

    name: str
    unit: str
    low: float
    high: float
    before: float
    after: float


class ObjectiveRecord(TypedDict):
    """The objective over all trials, in its display unit; None for failed trials."""

    words: str
    unit: str
    sense: str
    values: list[float | None]


class LimitRecord(TypedDict):
    """A limit, and its relative violation by each trial; None for failed trials."""

    words: str
    passed: list[float | None]


class TrialRecord(TypedDict):
    """A trial."""

    number: int
    start: int
    mesh: int
    failure: str
    newton: int
    seconds: float


class DesignRecord(TypedDict):
    """Content of ``design.json``."""

    name: str
    headline: str
    feasible: bool
    stopped: bool
    best: int
    missed: list[str]
    reasons: list[str]
    agreement: str
    confirmation: list[str]
    finer: float
    trouble: str
    margins: list[str]
    recovered: list[str]
    notes: list[str]
    parameters: list[ParameterRecord]
    objective: ObjectiveRecord
    limits: list[LimitRecord]
    trials: list[TrialRecord]
    made: dict[str, object]


def summary(result: DesignResult) -> str:
    """Return the text of ``design.json``."""
    intervals = result.recovered
    told = {
        "name": result.problem.name, "best": result.best.number, "recovered": intervals.sentences if intervals else [],
        "notes": notes(result), "parameters": parameters_told(result), "objective": _objective(result),
        "limits": _limits(result), "made": commands.Provenance.now().table(),
        "trials": [{name: getattr(trial, name) for name in TrialRecord.__annotations__} for trial in result.trials],
    }  # fmt: skip
    names = DesignRecord.__annotations__
    return json.dumps({name: told[name] if name in told else getattr(result, name) for name in names}, indent=1)


def notes(result: DesignResult) -> list[str]:
    """Return the remarks on the result."""
    told = [*result.variants, *result.problem.notes, *result.best.notes]
    told += [f"start {end.start} ended {end.why}" for end in result.ends if end.why and not end.stopped]
    unfinished = result.feasible and not result.holding.balanced and not result.stopped
    if unfinished and result.problem.objective != "follow":  # the distance from a target that is met has no slope
        told.append("the search ended before it converged; more evaluations (--evaluations) may find a better design")
    errors = result.problem.errors
    if errors is not None:
        told.append(f"errors of the material: {errors.how}")
        if not any(trial.material_gradients for trial in result.trials):
            told.append("derivatives by the material are not available, so its errors are not included in the margins")
    return told


def parameters_told(result: DesignResult) -> list[ParameterRecord]:
    """Return the free parameters with their bounds, before and after."""
    told = []
    for k, parameter in enumerate(result.problem.free):
        unit = trials.shown_unit(parameter.unit)
        per = trials.factor(unit or "1", parameter.unit or "1")
        told.append(
            ParameterRecord(
                name=parameter.name, unit=unit, low=parameter.low / per, high=parameter.high / per,
                before=parameter.start / per, after=result.best.theta[k] / per,
            )
        )  # fmt: skip
    return told


def _objective(result: DesignResult) -> ObjectiveRecord:
    """Return the objective over all trials; None for failed trials."""
    form, asked = result.form, result.problem.terms[0].quantity
    words = label(asked, result.problem.case) if len(result.problem.terms) == 1 else f"mean {asked.title}"
    return {
        "words": words, "unit": "" if shown(asked) == "1" else shown(asked), "sense": result.problem.objective,
        "values": [None if trial.failed else form.objective(trial) / shown_factor(asked) for trial in result.trials],
    }  # fmt: skip


def _limits(result: DesignResult) -> list[LimitRecord]:
    """Return each limit with its relative violation over all trials."""
    form = result.form
    violations = [None if trial.failed else form.violations(trial) for trial in result.trials]
    return [
        {"words": row.text, "passed": [None if violation is None else float(violation[k]) for violation in violations]}
        for k, row in enumerate(form.rows)
    ]


# ----------------------------------------------------------------------------------------------------------------------
# File names of a design's pictures.


CAPTIONS = {
    "shapes.png": "The given and the optimised device at the largest pressure: same camera, same colour scale",
    "sections.png": "Half sections at rest and at the largest pressure",
    "paths.png": "Both paths",
    "parameters.png": "The free parameters within their bounds",
    "history.png": "The designs in the order of their evaluation",
}
"""Pictures in the order of the report, with their captions."""
REPORT = "report.html"
FILES = (*CAPTIONS, REPORT)
