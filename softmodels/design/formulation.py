"""Scaled design problem: parameters from 0 to 1, quantities relative to their limits, constraints c <= 0."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from softmodels.case.varied import value_of
from softmodels.common.arrays import Array
from softmodels.design.problem import SURE, DesignProblem, Keep, ToleranceSpread, in_words, label
from softmodels.design.quantities import DesignQuantity
from softmodels.design.trials import PRESSURE, JudgedLoad, Squares, Trial

ZERO = 0.01
"""Minimum scale of a length's violation, relative to the device's size, if its limit is 0."""
KEPT = 1e-9
"""Relative tolerance of a limit, for rounding."""
INSIDE = 2e-4
"""Relative safety margin to a limit in the search, so that its end satisfies the limit."""


@dataclasses.dataclass(frozen=True)
class ConstraintRow:
    """One limit on one value.

    Attributes:
        keep: The limit.
        key: Key of the value.
        sign: 1 for at most, -1 for at least.
        limit: SI unit.
        scale: What a violation is counted in, SI unit.
        words: What is limited, with its pressure.
    """

    keep: Keep
    key: str
    sign: float
    limit: float
    scale: float
    words: str

    @property
    def text(self) -> str:
        """The limit in words."""
        return f"{self.words} {'at most' if self.sign > 0 else 'at least'} {in_words(self.keep.quantity, self.limit)}"

    def compared(self, value: float, violation: float) -> str:
        """Return a value compared with the limit, such as ``limit margin 1.249 < 1.25``, with enough digits to distinguish
        them.

        Args:
            value: SI unit.
            violation: How far the limit is passed, in its scale; below zero where it is kept. It is judged with an allowance
                for tolerances and for other meshes, which is added where only the value would not show it.
        """
        asked = self.keep.quantity
        judged = self.limit + self.sign * violation * self.scale
        for digits in range(4, 10):
            limit, near = in_words(asked, self.limit, digits), in_words(asked, judged, digits)
            if limit != near or violation == 0.0:
                break
        above = judged > self.limit if limit != near else self.sign < 0
        sign = (">" if above else "<") if violation > 0.0 else (">=" if self.sign < 0 else "<=")
        told = in_words(asked, value, digits)
        if abs(judged - value) <= 1e-9 * self.scale or told == near:
            return f"{self.words} {near} {sign} {limit}"
        return f"{self.words} {told}, {near} with its allowance, {sign} {limit}"


@dataclasses.dataclass(frozen=True)
class Scaled:
    """A scaled design: objective f, constraints c <= 0, and their gradients by the scaled parameters."""

    f: float
    df: Array
    c: Array
    dc: Array
    fresh: bool = False
    """Whether its mesh differs from that of the designs before."""


class Formulation:
    """A problem, scaled.

    Args:
        problem: The problem.
        first: A trial that could be judged; its objective is the scale of all objectives.
    """

    def __init__(self, problem: DesignProblem, first: Trial):
        self.problem, self.first = problem, first
        self.corrections: dict[str, tuple[float, float]] = {}
        self.safety: Array | float = 0.0
        self.spread = ToleranceSpread(problem.names, problem.spreads, problem.errors)
        self.low = np.array([one.low for one in problem.free])
        self.width = np.array([one.width for one in problem.free])
        self.rest = np.array([value_of(problem.case, name) for name in problem.names[len(problem.free) :]])
        self.rows = [row for keep in problem.limits for row in self._rows(keep, first.values)]
        slopes = np.abs(self._slope(first)) * self.width
        self.size = max(abs(self.objective(first)), float(slopes.max(initial=0.0)), 1e-300)

    def _rows(self, keep: Keep, values: Mapping[str, float]) -> list[ConstraintRow]:
        rows = []
        floor = ZERO * self.problem.case.actuator.size if keep.quantity.unit == "m" else 0.0
        for key in keep.keys(values):
            words = label(keep.quantity, self.problem.case.cm) if key == keep.quantity.key else key
            for sign, limit in ((-1.0, keep.at_least), (1.0, keep.at_most)):
                if limit is not None:
                    scale = abs(limit) or max(abs(values[key]), floor) or 1.0
                    rows.append(ConstraintRow(keep, key, sign, limit, scale, words))
        return rows

    # -- between scaled and SI ------------------------------------------------------------------------------------------

    def theta(self, x: Array) -> Array:
        """Return the values of the problem's `names` in SI units of scaled parameters."""
        ends = np.where(x >= 1.0, self.low + self.width, self.low + x * self.width)
        return np.concatenate([np.where(x <= 0.0, self.low, ends), self.rest])

    def x(self, theta: Array) -> Array:
        """Return the reverse."""
        return np.asarray((theta[: len(self.low)] - self.low) / self.width)

    # -- objective and limits of a trial
    # --------------------------------------------------------------------------------------------

    def objective(self, trial: Trial) -> float:
        """Return the objective in its SI unit."""
        return sum(term.weight * trial.values[term.quantity.key] for term in self.problem.terms)

    def _slope(self, trial: Trial) -> Array:
        """Return its gradient by the free parameters."""
        parts = [term.weight * self._gradient(trial, term.quantity.key) for term in self.problem.terms]
        return np.asarray(np.sum(parts, axis=0))

    def _gradient(self, trial: Trial, key: str) -> Array:
        """Return a value's gradient by the free parameters; empty where only whole numbers are free."""
        return np.asarray(trial.gradients.get(key, ()), dtype=float)[: len(self.problem.free)]

    def allowances(self, trial: Trial) -> Array:
        """Return the 95 % allowances of each limit for tolerances and the material's errors, SI units, shape (rows,)."""
        return np.array([SURE * self.spread.sigma(trial, row.key) for row in self.rows])

    def violations(self, trial: Trial, allowances: Array | None = None) -> Array:
        """Return the violation of each limit, in its scale; negative if satisfied. Shape (rows,)."""
        taken = self.allowances(trial) if allowances is None else allowances
        values = {}
        for row in self.rows:
            factor, shift = self.corrections.get(row.key, (1.0, 0.0))
            values[row.key] = factor * trial.values[row.key] + shift
        return self.passed(values, taken) + self.safety

    def passed(self, values: Mapping[str, float], allowances: Array) -> Array:
        """Return the violation of each limit by given values, in its scale; shape (rows,)."""
        return np.array(
            [
                (row.sign * (values[row.key] - row.limit) + allowance) / row.scale
                for row, allowance in zip(self.rows, allowances, strict=True)
            ]
        )

    def corrected(self, trial: Trial, confirmed: Mapping[str, float], safety: Array) -> Formulation:
        """Return the same with limits corrected to a fresh mesh, by the ratio known for
        one design.

        Where the limit is 0, such as on a gap, they differ by the same amount, since a factor would leave it where it is.

        Args:
            trial: The design in the search.
            confirmed: Its values on the fresh mesh.
            safety: Further share by which each limit is to be kept, shape (rows,).
        """
        made = Formulation(self.problem, self.first)
        made.safety = safety
        for row in self.rows:
            here, there = trial.values[row.key], confirmed[row.key]
            if not row.limit:
                made.corrections[row.key] = 1.0, there - here
            elif here and there / here > 0.0:
                made.corrections[row.key] = there / here, 0.0
        return made

    def worst(self, trial: Trial) -> tuple[float, ConstraintRow | None]:
        """Return the largest violation and its limit."""
        if not self.rows:
            return 0.0, None
        found = self.violations(trial)
        k = int(np.argmax(found))
        return float(found[k]), self.rows[k]

    def feasible(self, trial: Trial) -> bool:
        """Return whether it was evaluated and satisfies every limit."""
        return not trial.failed and self.worst(trial)[0] <= KEPT

    def scaled(self, trial: Trial, allowances: Array, fresh: bool = False) -> Scaled:
        """Return the scaled design with fixed allowances, without the derivative of a standard deviation."""
        count = len(self.problem.free)
        slopes = [row.sign / row.scale * self._gradient(trial, row.key) * self.width for row in self.rows]
        sign = self.problem.sign / self.size
        return Scaled(
            sign * self.objective(trial), sign * self._slope(trial) * self.width,
            self.violations(trial, allowances) + INSIDE, np.array(slopes).reshape(len(self.rows), count),
            fresh,
        )  # fmt: skip

    def best(self, trials: Sequence[Trial]) -> Trial | None:
        """Return the best of some trials: a feasible one by the objective, else that with the smallest violation; None if none
        could be evaluated."""

        def order(trial: Trial) -> tuple[bool, float]:
            if self.feasible(trial):
                return False, self.problem.sign * self.objective(trial)
            return True, self.worst(trial)[0]

        return min((trial for trial in trials if not trial.failed), key=order, default=None)


# ----------------------------------------------------------------------------------------------------------------------
# Requested quantities of a design, and their values.


@dataclasses.dataclass(frozen=True)
class Judged:
    """A quantity of a design.

    Attributes:
        value: In its SI unit.
        gradient: By the parameters, shape (n,); empty if none was asked for.
        by_material: By the material's numbers.
    """

    value: float
    gradient: Array
    by_material: dict[str, float]
    squares: Squares | None = None
    """Residuals of a target."""

    def times(self, factor: float) -> Judged:
        """Return the quantity times a number."""
        by_material = {name: factor * rate for name, rate in self.by_material.items()}
        return Judged(factor * self.value, factor * self.gradient, by_material)


@dataclasses.dataclass(frozen=True)
class EvaluationRequest:
    """Quantities requested of a design.

    Attributes:
        names: The parameters that are free.
        parts: The quantities, each of one state at most.
        loads: Those of the states.
        highest: Pressure in Pa up to which a limit point is looked for; 0 for none.
        materials: Numbers of the material by which derivatives are wanted.
        shape: Those of ``names`` that decide the shape.
    """

    names: tuple[str, ...]
    parts: tuple[DesignQuantity, ...]
    loads: tuple[JudgedLoad, ...]
    highest: float
    materials: tuple[str, ...]
    shape: tuple[str, ...] = ()

    @property
    def working(self) -> float:
        """The pressure in Pa farthest from 0 at which the device is evaluated; 0 for none."""
        return max((load.value for load in self.loads if load.kind == PRESSURE), default=0.0, key=abs)
