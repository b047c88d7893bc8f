"""What holds a design back: the multipliers of its limits in plain words.

At the end of a search the objective's slope is a sum of the slopes of the limits that are met, each times a multiplier that
is not negative (Karush, Kuhn and Tucker). They are found by non-negative least squares from the gradients there, whatever
the search was.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from scipy.optimize import nnls

from softmodels.design.asked import in_words, label, shown_factor
from softmodels.design.formulation import INSIDE, Formulation, Row
from softmodels.design.trials import Trial
from softmodels.design.units import factor, shown_unit, text

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
    row: Row | None = None


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


def _limit_sentence(form: Formulation, row: Row, multiplier: float) -> str:
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
