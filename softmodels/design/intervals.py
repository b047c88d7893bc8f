"""How well a target tells the parameters of the device that follows it: standard errors, intervals, and what it hardly tells.

With the residuals' Jacobian J at the end and their variance s^2 the parameters' covariance is s^2 (J^T J)^-1, as long as the
residuals are nearly linear over it (Gauss and Newton; Seber and Wild 2003, Nonlinear regression, chapter 2). Where errors
keep together over a run of neighbours, only every run-th of them counts. A parameter at a bound is held there: the errors
of the others are as if it were known.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import numpy.typing as npt

from measurement.read_only import keep_arrays
from softmodels.design.asked import in_words
from softmodels.design.formulation import Formulation
from softmodels.design.free import Free
from softmodels.design.trials import Trial
from softmodels.design.units import factor, shown_unit

Array = npt.NDArray[np.float64]

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
