"""What an optimisation found, and how it is put into sentences."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import math
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar, TypedDict

import numpy as np
import tomli_w
from scipy.optimize import nnls

from geometries import Actuator
from geometries.actuator import changed
from softmodels.case.case import Case
from softmodels.case.entries import INPUT_ERRORS
from softmodels.common.arrays import Array
from softmodels.common.calls import keep_arrays
from softmodels.design.formulation import INSIDE, ConstraintRow, Formulation
from softmodels.design.loads import factor, shown_unit, text
from softmodels.design.problem import (
    SURE,
    DesignProblem,
    Free,
    in_words,
    label,
    shown,
    shown_factor,
)
from softmodels.design.quantities.gaps import LeastGap
from softmodels.design.trials import Trial

# ----------------------------------------------------------------------------------------------------------------------
# How well a target tells the parameters of the device that follows it: standard errors, intervals, and what it hardly tells.
#
# With the residuals' Jacobian J at the end and their variance s^2 the parameters' covariance is s^2 (J^T J)^-1, as long as the
# residuals are nearly linear over it (Gauss and Newton; Seber and Wild 2003, Nonlinear regression, chapter 2). Where errors
# keep together over a run of neighbours, only every run-th of them counts. A parameter at a bound is held there: the errors
# of the others are as if it were known.


AT_BOUND = 1e-6
"""Share of the bounds' width within which a parameter is at one."""
WIDE = 0.5
"""Half a 95 % interval, in widths of the bounds, from which a target hardly tells a combination."""
SHARE = 0.1
"""Least share of the largest part of a combination with which a parameter is named in it."""
SHOWN = 0.1
"""Width of the bounds by which the largest part of a combination is moved where it is put into words."""


@dataclasses.dataclass(frozen=True)
class Interval:
    """A parameter as a target tells it, SI units.

    Attributes:
        parameter: The free parameter.
        value: Its value.
        error: Standard error; inf where the target does not tell it, 0 at a bound.
        low, high: Ends of the 95 % interval.
        at_bound: Whether it is at a bound.
    """

    parameter: Free
    value: float
    error: float
    low: float
    high: float
    at_bound: bool = False

    @property
    def sentence(self) -> str:
        """It in words."""
        one = self.parameter
        if self.at_bound:
            return f"{one.name} {one.text(self.value)}: at its bound, so the target says nothing more of it"
        if not math.isfinite(self.error):
            return f"{one.name} {one.text(self.value)}: the target does not tell it"
        return (
            f"{one.name} {one.text(self.value, 5)} +- {one.text(self.error, 2)} (one standard error), with 95 % between "
            f"{one.text(self.low, 5)} and {one.text(self.high, 5)}"
        )


@dataclasses.dataclass(frozen=True, eq=False)
class Told:
    """What a target tells of a device's parameters.

    Attributes:
        intervals: One for each free parameter.
        covariance: Of those that are not at a bound, SI units.
        weakest: What combination it tells least, a sentence; empty with fewer than two parameters.
        source: Where the residuals' standard error comes from, a clause.
    """

    intervals: tuple[Interval, ...]
    covariance: Array
    weakest: str
    source: str

    def __post_init__(self) -> None:
        keep_arrays(self)

    @property
    def sentences(self) -> list[str]:
        """All of it in words."""
        return [*(one.sentence for one in self.intervals), *filter(None, [self.weakest]), self.source]


def recovered(form: Formulation, trial: Trial) -> Told | None:
    """What a problem's targets tell of its parameters at a trial; None where none is followed, or no errors are known."""
    problem = form.problem
    found = [(term.quantity, trial.squares.get(term.quantity.key)) for term in problem.terms]
    if problem.objective != "follow" or any(squares is None for _, squares in found):
        return None
    count = len(problem.free)
    theta = np.array(trial.theta[:count])
    x = form.x(np.array(trial.theta))
    inside = (x > AT_BOUND) & (x < 1.0 - AT_BOUND)
    parts = [squares for _, squares in found if squares is not None]
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
    quantile = _quantile(math.inf if known else freedom)
    errors = np.zeros(count)
    errors[inside] = np.sqrt(np.diag(scaled)) * form.width[inside]
    intervals = tuple(
        Interval(one, value, error, value - quantile * error, value + quantile * error, not free)
        for one, value, error, free in zip(problem.free, theta.tolist(), errors.tolist(), inside.tolist(), strict=True)
    )
    asked = problem.terms[0].quantity
    if known:
        source = "errors from the standard error that was given (sigma)"
    else:
        source = f"errors from what is left at the end, {in_words(asked, math.sqrt(variance), 3)} for each value"
    source += f"; {counted:.0f} independent values"
    free = [one for one, is_free in zip(problem.free, inside, strict=True) if is_free]
    weakest = _weakest(form, trial, free, vectors[-1], quantile * inverse[-1]) if len(free) > 1 else ""
    return Told(intervals, scaled * np.outer(form.width[inside], form.width[inside]), weakest, source)


def _covariance(vectors: Array, inverse: Array) -> Array:
    """From right singular vectors, in rows, and one over the singular values, of which some may be infinite."""
    finite = np.isfinite(inverse)
    covariance = (vectors[finite].T * inverse[finite] ** 2) @ vectors[finite]
    for vector in vectors[~finite]:
        blind = np.abs(vector) > 1e-6
        covariance[blind, blind] = np.inf
    return np.asarray(covariance)


def _quantile(freedom: float) -> float:
    """Of 95 %: Student's, as the residuals' variance is estimated from few of them."""
    from scipy.stats import norm, t

    return float(norm.ppf(0.975) if math.isinf(freedom) else t.ppf(0.975, freedom))


def _weakest(form: Formulation, trial: Trial, free: list[Free], vector: Array, half: float) -> str:
    """The combination that the target tells least, in words."""
    vector = vector / vector[np.argmax(np.abs(vector))]
    parts = []
    changes = {}
    for one, share in zip(free, vector, strict=True):
        step = SHOWN * share * one.width
        changes[one.name] = step
        if abs(share) >= SHARE:
            unit = shown_unit(one.unit) or "1"
            shown = step / factor(unit, one.unit or "1")
            parts.append(f"{one.name} {shown:+.2g}{'' if unit == '1' else ' ' + unit}")
    asked = form.problem.terms[0].quantity
    steps = np.array([changes.get(one.name, 0.0) for one in form.problem.free])
    moved = 0.0
    for term in form.problem.terms:
        squares = trial.squares[term.quantity.key]
        change = squares.jacobian[:, : len(steps)] @ steps
        moved += term.weight * float(change @ change) / squares.count
    together = "together " if len(parts) > 1 else ""
    words = (
        f"{', '.join(parts)} {together}would move the device by {in_words(asked, math.sqrt(moved), 2)} from the target"
    )
    if half > WIDE:
        return f"the target hardly tells one combination of the parameters: {words}"
    return f"told least: {words}"


# ----------------------------------------------------------------------------------------------------------------------
# What holds a design back: the multipliers of its limits in plain words.
#
# At the end of a search the objective's slope is a sum of the slopes of the limits that are met, each times a multiplier that
# is not negative (Karush, Kuhn and Tucker). They are found by non-negative least squares from the gradients there, whatever
# the search was.


MET = 5e-3
"""A limit is met from this share of it on."""
EDGE = 1e-6
"""A parameter is at a bound within this share of the bounds' width."""
LEAST = 1e-3
"""Multipliers below this share of the largest are nothing."""
BALANCED = 0.2
"""Share of the objective's slope that may be left over where the end is an optimum."""


@dataclasses.dataclass(frozen=True)
class Holder:
    """A limit or bound that holds a design back.

    Attributes:
        words: Which, in words.
        multiplier: Gain in scaled objectives per scaled limit; of a request that cannot be met, its share in what excludes
            each other.
        sentence: What it costs.
        row: The limit; None for a bound of a parameter.
    """

    words: str
    multiplier: float
    sentence: str
    row: ConstraintRow | None = None


@dataclasses.dataclass(frozen=True)
class Holding:
    """What holds a design back.

    Attributes:
        holders: With the largest multiplier first.
        balanced: Whether the multipliers explain the objective's slope, so that the design is an optimum.
    """

    holders: tuple[Holder, ...]
    balanced: bool


def holding(form: Formulation, trial: Trial) -> Holding:
    """What holds a design back, from its gradients."""
    scaled = form.scaled(trial, form.allowances(trial))
    violations = scaled.c - INSIDE
    infeasible = bool(violations.max(initial=-1.0) > 1e-9)
    met = violations.max() - MET if infeasible else -MET
    rows = [k for k in range(len(form.rows)) if violations[k] >= met]
    x = form.x(np.array(trial.theta))
    bounds = [(k, -1.0) for k in range(len(x)) if x[k] <= EDGE] + [(k, 1.0) for k in range(len(x)) if x[k] >= 1 - EDGE]
    columns = [scaled.dc[k] for k in rows] + [sign * np.eye(len(x))[k] for k, sign in bounds]
    if not columns:
        return Holding((), not scaled.df.any())
    A, wanted = np.array(columns).T, -scaled.df
    if infeasible:  # sum of slopes zero, shares of the limits one
        share = np.array([1.0] * len(rows) + [0.0] * len(bounds))
        A, wanted = np.vstack([A, share]), np.append(np.zeros(len(x)), 1.0)
    multipliers, rest = nnls(A, wanted)
    size = float(np.linalg.norm(wanted)) or 1.0
    found = []
    for place in np.argsort(-multipliers):
        if multipliers[place] <= LEAST * multipliers.max():
            continue
        if place < len(rows):
            row = form.rows[rows[place]]
            sentence = "" if infeasible else _limit_sentence(form, row, float(multipliers[place]))
            found.append(Holder(row.text, float(multipliers[place]), sentence, row))
        else:
            found.append(_bound(form, bounds[place - len(rows)], float(multipliers[place]), infeasible))
    if infeasible:
        found = _trades(found)
    return Holding(tuple(found), rest <= BALANCED * size)


def _round(value: float) -> float:
    """1, 2 or 5 times a power of ten near a value."""
    if value <= 0.0 or not math.isfinite(value):
        return 1.0
    power = 10.0 ** math.floor(math.log10(value))
    return float(min((1.0, 2.0, 5.0, 10.0), key=lambda digit: abs(math.log(value / (digit * power)))) * power)


def _gain(form: Formulation, amount: float) -> str:
    """A gain of the objective in words."""
    asked = form.problem.terms[0].quantity
    words = label(asked, form.problem.case.cm) if len(form.problem.terms) == 1 else asked.title
    return f"{in_words(asked, amount, 2)} {'more' if form.problem.sign < 0 else 'less'} {words}"


def _limit_sentence(form: Formulation, row: ConstraintRow, multiplier: float) -> str:
    asked, per_unit = row.keep.quantity, form.size * multiplier / row.scale
    step = _round(0.05 * row.scale / shown_factor(asked)) * shown_factor(asked)
    objective = form.problem.terms[0].quantity
    one = _round(0.05 * form.size / shown_factor(objective)) * shown_factor(objective)
    return (
        f"{row.text}: allowing {in_words(asked, step)} {'more' if row.sign > 0 else 'less'} would give about "
        f"{_gain(form, per_unit * step)}; {_gain(form, one)} costs about {in_words(asked, one / per_unit, 2)} of it"
    )


def _bound(form: Formulation, bound: tuple[int, float], multiplier: float, infeasible: bool) -> Holder:
    one, sign = form.problem.free[bound[0]], bound[1]
    end = one.text(one.high if sign > 0 else one.low)
    if infeasible:
        return Holder(f"{one.name} {'at most' if sign > 0 else 'at least'} {end} (its bound)", multiplier, "")
    words = f"{one.name} is at its {'upper' if sign > 0 else 'lower'} bound, {end}"
    shown, unit = shown_unit(one.unit) or "1", one.unit or "1"
    step = _round(0.1 * one.width / factor(shown, unit)) * factor(shown, unit)
    gain = _gain(form, form.size * multiplier * step / one.width)
    more = "more" if sign > 0 else "less"
    return Holder(words, multiplier, f"{words}: {text(step, shown, unit)} {more} would give about {gain}")


def _trades(holders: list[Holder]) -> list[Holder]:
    """Of limits that exclude each other: what more of the first costs of each other one."""
    limits = [one for one in holders if one.row is not None]
    if not limits:
        return holders
    first = limits[0]
    assert first.row is not None
    asked = first.row.keep.quantity
    step = _round(0.05 * first.row.scale / shown_factor(asked)) * shown_factor(asked)
    traded = []
    for one in holders:
        if one.row is None or one is first:
            traded.append(one)
            continue
        other = one.row.keep.quantity
        cost = step * (first.multiplier / first.row.scale) / (one.multiplier / one.row.scale)
        sentence = (
            f"{in_words(asked, step)} {'less' if first.row.sign > 0 else 'more'} {first.row.words} costs about "
            f"{in_words(other, cost, 2)} of {one.row.words}"
        )
        traded.append(dataclasses.replace(one, sentence=sentence))
    return traded


# ----------------------------------------------------------------------------------------------------------------------
# The case of a design that was tried.


KEPT = ("material", "load")
"""Tables that a design does not change, which are written as the user wrote them."""


def case_of(problem: DesignProblem, trial: Trial) -> Case:
    """The case of a trial's device.

    Raises:
        GeometryError: It is none.
    """
    values = dict(zip((one.name for one in problem.free), trial.theta, strict=False))
    return dataclasses.replace(problem.case, name=problem.name, actuator=changed(problem.case.actuator, values))


def case_text(problem: DesignProblem, case: Case) -> str:
    """A case of this problem as a file: silicone and loads as the user named them, such as ``pressure = "0:30 kPa"``.

    What would not be read as the same case elsewhere, such as a material's file, is written in numbers.
    """
    exact = case.to_toml()
    own = {name: problem.written[name] for name in KEPT if name in problem.written}
    text = tomli_w.dumps({**tomllib.loads(exact), **own})
    with contextlib.suppress(*INPUT_ERRORS):
        if Case.from_toml(text) == case:
            return text
    return exact


SAME_VALUE, SAME_PLACE = 0.01, 0.05
"""Starts agree if their ends differ by less than these shares: of the objective, or of each parameter's bounds' width."""
FRESH_LIMIT = 2e-3
"""Share of a limit by which it may be passed on the fresh mesh: the search stays inside of it on its own."""
FRESH = 0.02
"""Share by which a value on the fresh mesh may differ before it is warned of."""


@dataclasses.dataclass(frozen=True, eq=False)
class StartEnd:
    """Where one start ended.

    Attributes:
        start: Its number.
        best: Its best trial; None if none could be judged.
        form: The problem in scaled numbers, with what is known of the difference to a fresh mesh.
        confirmed: Values of the best trial on a fresh mesh; empty where there are none.
        trouble: Why it could not be confirmed; empty for none.
        why: Why it ended before an optimum; empty for none.
    """

    STOPPED: ClassVar[str] = "as the user stopped it"

    start: int
    best: Trial | None
    form: Formulation
    confirmed: Mapping[str, float] = dataclasses.field(default_factory=dict)
    trouble: str = ""
    why: str = ""

    @property
    def stopped(self) -> bool:
        return self.why == self.STOPPED

    @property
    def values(self) -> Mapping[str, float]:
        """As reported: on the fresh mesh, or on the search's where there is none."""
        return self.confirmed or ({} if self.best is None else self.best.values)

    @property
    def objective(self) -> float:
        return sum(term.weight * self.values[term.quantity.key] for term in self.form.problem.terms)

    @property
    def passed(self) -> float:
        """Largest share by which a limit is passed; below zero where all are kept."""
        assert self.best is not None
        if not self.confirmed:
            return self.form.worst(self.best)[0]
        return float(self.form.passed(self.confirmed, self.form.allowances(self.best)).max(initial=-1.0))

    @property
    def feasible(self) -> bool:
        """Whether its best trial keeps all limits: in the search, and on the fresh mesh as nearly as makes no difference."""
        return self.best is not None and self.form.feasible(self.best) and self.passed <= FRESH_LIMIT

    def order(self) -> tuple[bool, bool, float]:
        """What is least of the best end: no trouble, all limits kept, the objective; or else the least violation."""
        if self.feasible:
            return bool(self.trouble), False, self.form.problem.sign * self.objective
        return bool(self.trouble), True, self.passed


def _overlaps(row: ConstraintRow, values: Mapping[str, float]) -> bool:
    """Whether a limit's value says that walls overlap."""
    return isinstance(row.keep.quantity, LeastGap) and values[row.key] < 0.0


@dataclasses.dataclass(frozen=True, eq=False)
class DesignResult:
    """The outcome of an optimisation.

    Attributes:
        problem: What was asked.
        end: The best end of all starts.
        trials: All designs that were evaluated.
        ends: Where each start ended.
        holding: What holds the best design back.
        finer: How much finer the fresh mesh was.
        stopped: Whether the user stopped it.
        folder: Where it is kept; None for nowhere.
    """

    problem: DesignProblem
    end: StartEnd
    trials: tuple[Trial, ...]
    ends: tuple[StartEnd, ...]
    holding: Holding
    finer: float = 1.0
    stopped: bool = False
    folder: Path | None = None

    @property
    def best(self) -> Trial:
        """The best design: within all limits, or else with the least violation."""
        assert self.end.best is not None
        return self.end.best

    @property
    def form(self) -> Formulation:
        """The problem in scaled numbers."""
        return self.end.form

    @property
    def confirmed(self) -> Mapping[str, float]:
        """Values of the best design on a fresh mesh; empty where there are none."""
        return self.end.confirmed

    @property
    def trouble(self) -> str:
        """Why the design could not be confirmed; empty for none."""
        return self.end.trouble

    @property
    def first(self) -> Trial:
        """The device as given."""
        return self.trials[0]

    @property
    def feasible(self) -> bool:
        """Whether the best design keeps all limits."""
        return self.end.feasible

    @property
    def parameters(self) -> dict[str, float]:
        """Free parameters of the best design, SI units."""
        return {one.name: value for one, value in zip(self.problem.free, self.best.theta, strict=False)}

    @property
    def device(self) -> Actuator:
        """The best device."""
        return changed(self.problem.case.actuator, self.parameters)

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
        """Values of the best design as reported: on the fresh mesh, or on the search's where there is none."""
        return self.end.values

    # -- in words -----------------------------------------------------------------------------------------------------

    @property
    def headline(self) -> str:
        """What was found, in a sentence."""
        cm, failed = self.problem.case.cm, sum(trial.failed for trial in self.trials)
        words = "; ".join(
            f"{label(term.quantity, cm)} {in_words(term.quantity, self.first.values[term.quantity.key])} at the start, "
            f"{in_words(term.quantity, self.values[term.quantity.key])} in the design"
            for term in self.problem.terms
        )
        count = f"{len(self.trials)} designs evaluated" + (f", {failed} of them without a state" if failed else "")
        limits = "all limits kept" if self.feasible else "not all limits can be kept"
        return f"{'stopped by the user; so far: ' if self.stopped else ''}{words}; {limits}; {count}"

    @property
    def missed(self) -> list[str]:
        """The limits that the best design does not keep, and by how much."""
        violations = self.form.passed(self.values, self.form.allowances(self.best))
        return [
            f"{row.words} is {in_words(row.keep.quantity, self.values[row.key])}, and has to be "
            f"{'at most' if row.sign > 0 else 'at least'} {in_words(row.keep.quantity, row.limit)}"
            + (
                ": walls pass through each other, so the other values are of no real device"
                if _overlaps(row, self.values)
                else ""
            )
            for row, violation in zip(self.form.rows, violations, strict=True)
            if violation > FRESH_LIMIT
        ]

    @property
    def reasons(self) -> list[str]:
        """What holds the design back."""
        holders = self.holding.holders
        if not self.feasible and self.form.feasible(self.best):
            passed = (
                f"limits that the search keeps are passed by up to {self.end.passed:.2%} of them on the fresh mesh: meshes of "
                "this size differ by so much; use smaller cells, or ask for a little more than is needed"
            )
            return [passed, *(one.sentence for one in holders)]
        if self.feasible:
            if not holders and self.holding.balanced:
                return ["no limit holds it back: no small change is better"]
            return [one.sentence for one in holders]
        if self.end.why:
            return [f"no design so far keeps all limits (the search ended {self.end.why}); go on with more evaluations"]
        held = [one.words for one in holders]
        what = (
            f"{' and '.join(held)} exclude each other"
            if len(held) > 1
            else f"{' '.join(held) or 'its limits'} cannot be kept"
        )
        told = [f"the request cannot be met, and this is the nearest design: {what}"]
        failed = sum(trial.failed for trial in self.trials)
        if failed and not self.holding.balanced:
            told.append(
                f"{failed} designs around it have no state at the pressures they are asked at, which holds it back too"
            )
        return told + [one.sentence for one in holders if one.sentence and one.sentence != one.words]

    @property
    def agreement(self) -> str:
        """Whether the starts agree; empty for a single one."""
        judged = [one for one in self.ends if one.best is not None]
        if len(self.ends) < 2:
            return ""
        if len(judged) < 2:
            return f"of {len(self.ends)} starts only one could be followed"
        same = sum(self._same(one) for one in judged)
        if same == len(judged):
            return f"the {len(judged)} starts agree"
        values = ", ".join(
            in_words(self.problem.terms[0].quantity, one.objective) + ("" if one.feasible else " (limits not kept)")
            for one in judged
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
        """The values on the search's mesh beside those on the fresh one."""
        told = []
        for asked in self.problem.quantities:
            for key in [
                key for key in self.confirmed if key == asked.key or key.startswith(f"{asked.key.removesuffix('s')}:")
            ]:
                if key not in self.best.values:
                    continue
                found, fresh = self.best.values[key], self.confirmed[key]
                share = abs(fresh - found) / max(abs(fresh), 1e-300)
                if share < 1e-9:  # of the geometry alone
                    continue
                words = label(asked, self.problem.case.cm) if key == asked.key else key
                told.append(
                    f"{words}: {in_words(asked, fresh, 5)} on the fresh mesh, {in_words(asked, found, 5)} in the search "
                    f"({share:.2%} apart{', more than ' + format(FRESH, '.0%') if share > FRESH else ''})"
                )
        return told

    @property
    def recovered(self) -> Told | None:
        """What a target that is followed tells of the parameters; None where none is, or its errors are not known."""
        return recovered(self.form, self.best)

    @property
    def margins(self) -> list[str]:
        """What tolerances and the material's errors take of each limit; nothing where there are none."""
        if not self.form.spread.any:
            return []
        allowances = self.form.allowances(self.best)
        told = []
        for row, taken in zip(self.form.rows, allowances, strict=True):
            asked, value = row.keep.quantity, self.values[row.key]
            told.append(
                f"{row.text}: {in_words(asked, value)} +- {in_words(asked, taken / SURE, 2)} (one standard deviation), so with "
                f"95 % {'below' if row.sign > 0 else 'above'} {in_words(asked, value + row.sign * taken)}"
            )
        return told


# ----------------------------------------------------------------------------------------------------------------------
# A result as plain numbers and sentences, for ``design.json``, from which pictures and report are made.


FILE = "design.json"


class ParameterTold(TypedDict):
    """A free parameter: its bounds and values, in its shown unit."""

    name: str
    unit: str
    low: float
    high: float
    before: float
    after: float


class ObjectiveTold(TypedDict):
    """What is made large or small, over all trials, in its shown unit; None where a trial failed."""

    words: str
    unit: str
    sense: str
    values: list[float | None]


class LimitTold(TypedDict):
    """A limit, and by what share of it each trial passes it; None where a trial failed."""

    words: str
    passed: list[float | None]


class TrialTold(TypedDict):
    """A trial."""

    number: int
    start: int
    mesh: int
    failure: str
    newton: int
    seconds: float


class DesignTold(TypedDict):
    """What ``design.json`` holds."""

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
    parameters: list[ParameterTold]
    objective: ObjectiveTold
    limits: list[LimitTold]
    trials: list[TrialTold]


def summary(result: DesignResult) -> str:
    """The text of ``design.json``."""
    found = result.recovered
    told: DesignTold = {
        "name": result.problem.name,
        "headline": result.headline,
        "feasible": result.feasible,
        "stopped": result.stopped,
        "best": result.best.number,
        "missed": result.missed,
        "reasons": result.reasons,
        "agreement": result.agreement,
        "confirmation": result.confirmation,
        "finer": result.finer,
        "trouble": result.trouble,
        "margins": result.margins,
        "recovered": found.sentences if found else [],
        "notes": notes(result),
        "parameters": _parameters(result),
        "objective": _objective(result),
        "limits": _limits(result),
        "trials": [
            {
                "number": trial.number,
                "start": trial.start,
                "mesh": trial.mesh,
                "failure": trial.failure,
                "newton": trial.newton,
                "seconds": trial.seconds,
            }
            for trial in result.trials
        ],
    }
    return json.dumps(told, indent=1)


def notes(result: DesignResult) -> list[str]:
    """What a reader has to know beside the numbers."""
    told = [*result.problem.notes, *result.best.notes]
    told += [f"start {one.start} ended {one.why}" for one in result.ends if one.why and not one.stopped]
    if result.feasible and not result.holding.balanced and not result.stopped:
        told.append("the search ended before an optimum: more evaluations (--evaluations) may find a better design")
    errors = result.problem.errors
    if errors is not None:
        told.append(f"errors of the material: {errors.how}")
        if not any(trial.material_gradients for trial in result.trials):
            told.append(
                "how the values change with the material is not known here, so its errors are left out of the margins"
            )
    return told


def _parameters(result: DesignResult) -> list[ParameterTold]:
    told = []
    for k, one in enumerate(result.problem.free):
        unit = shown_unit(one.unit)
        per = factor(unit or "1", one.unit or "1")
        told.append(
            ParameterTold(
                name=one.name, unit=unit, low=one.low / per, high=one.high / per, before=one.start / per,
                after=result.best.theta[k] / per,
            )
        )  # fmt: skip
    return told


def _objective(result: DesignResult) -> ObjectiveTold:
    """What is made large or small, over all trials; None where a trial failed."""
    form, asked = result.form, result.problem.terms[0].quantity
    words = label(asked, result.problem.case.cm) if len(result.problem.terms) == 1 else f"mean {asked.title}"
    return {
        "words": words, "unit": "" if shown(asked) == "1" else shown(asked), "sense": result.problem.objective,
        "values": [None if trial.failed else form.objective(trial) / shown_factor(asked) for trial in result.trials],
    }  # fmt: skip


def _limits(result: DesignResult) -> list[LimitTold]:
    """Each limit with how far it is passed over all trials, as a share of it."""
    form = result.form
    violations = [None if trial.failed else form.violations(trial) for trial in result.trials]
    return [
        {"words": row.text, "passed": [None if found is None else float(found[k]) for found in violations]}
        for k, row in enumerate(form.rows)
    ]
