"""What an optimisation found, and how it is put into sentences."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from geometries import Actuator
from geometries.parameters import changed
from softmodels.case.case import Case
from softmodels.design.asked import in_words, label
from softmodels.design.formulation import Formulation
from softmodels.design.multipliers import Holding
from softmodels.design.problem import DesignProblem
from softmodels.design.tolerances import SURE
from softmodels.design.trials import Trial

SAME_VALUE, SAME_PLACE = 0.01, 0.05
"""Starts agree if their ends differ by less than these shares: of the objective, or of each parameter's bounds' width."""
FRESH = 0.02
"""Share by which a value on the fresh mesh may differ before it is warned of."""


@dataclasses.dataclass(frozen=True)
class StartEnd:
    """Where one start ended: its number, its best trial, and why it has none."""

    start: int
    best: Trial | None
    why: str = ""


@dataclasses.dataclass(frozen=True, eq=False)
class DesignResult:
    """The outcome of an optimisation.

    Attributes:
        problem: What was asked.
        form: The problem in scaled numbers.
        trials: All designs that were evaluated.
        ends: Where each start ended.
        best: The best design: within all limits, or else with the least violation.
        holding: What holds it back.
        confirmed: Values of the best design on a fresh mesh; empty where that was not asked for.
        finer: How much finer that mesh was.
        stopped: Whether the user stopped it.
        trouble: Why the design could not be confirmed; empty for none.
        folder: Where it is kept; None for nowhere.
    """

    problem: DesignProblem
    form: Formulation
    trials: tuple[Trial, ...]
    ends: tuple[StartEnd, ...]
    best: Trial
    holding: Holding
    confirmed: Mapping[str, float]
    finer: float = 1.0
    stopped: bool = False
    trouble: str = ""
    folder: Path | None = None

    @property
    def first(self) -> Trial:
        """The device as given."""
        return self.trials[0]

    @property
    def feasible(self) -> bool:
        """Whether the best design keeps all limits."""
        return self.form.feasible(self.best)

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
        return self.confirmed or self.best.values

    # -- in words -----------------------------------------------------------------------------------------------------

    @property
    def headline(self) -> str:
        """What was found, in a sentence."""
        cm, failed = self.problem.case.cm, sum(trial.failed for trial in self.trials)
        words = "; ".join(
            f"{label(term.quantity, cm)} {in_words(term.quantity, self.first.values[term.quantity.key])} at the start, "
            f"{in_words(term.quantity, self.best.values[term.quantity.key])} in the design"
            for term in self.problem.terms
        )
        count = f"{len(self.trials)} designs evaluated" + (f", {failed} of them without a state" if failed else "")
        limits = "all limits kept" if self.feasible else "not all limits can be kept"
        return f"{'stopped by the user; so far: ' if self.stopped else ''}{words}; {limits}; {count}"

    @property
    def missed(self) -> list[str]:
        """The limits that the best design does not keep, and by how much."""
        violations = self.form.violations(self.best)
        return [
            f"{row.words} is {in_words(row.keep.quantity, self.best.values[row.key])}, and has to be "
            f"{'at most' if row.sign > 0 else 'at least'} {in_words(row.keep.quantity, row.limit)}"
            for row, violation in zip(self.form.rows, violations, strict=True)
            if violation > 1e-9
        ]

    @property
    def reasons(self) -> list[str]:
        """What holds the design back."""
        holders = self.holding.holders
        if self.feasible:
            if not holders and self.holding.balanced:
                return ["no limit holds it back: no small change is better"]
            return [one.sentence for one in holders]
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
        same = [one for one in judged if one.best is not None and self._same(one.best)]
        if len(same) == len(judged):
            return f"the {len(judged)} starts agree"
        values = ", ".join(
            in_words(self.problem.terms[0].quantity, self.form.objective(one.best))
            + ("" if self.form.feasible(one.best) else " (limits not kept)")
            for one in judged if one.best is not None
        )  # fmt: skip
        return f"{len(same)} of {len(judged)} starts agree with the best; they ended at {values}"

    def _same(self, trial: Trial) -> bool:
        if self.form.feasible(trial) != self.feasible:
            return False
        apart = abs(self.form.objective(trial) - self.form.objective(self.best))
        if apart <= SAME_VALUE * abs(self.form.objective(self.best)):
            return True
        steps = np.abs(self.form.x(np.array(trial.theta)) - self.form.x(np.array(self.best.theta)))
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
    def margins(self) -> list[str]:
        """What tolerances and the material's errors take of each limit; nothing where there are none."""
        if not self.form.spread.any:
            return []
        allowances = self.form.allowances(self.best)
        told = []
        for row, taken in zip(self.form.rows, allowances, strict=True):
            asked, value = row.keep.quantity, self.best.values[row.key]
            told.append(
                f"{row.text}: {in_words(asked, value)} +- {in_words(asked, taken / SURE, 2)} (one standard deviation), so with "
                f"95 % {'below' if row.sign > 0 else 'above'} {in_words(asked, value + row.sign * taken)}"
            )
        return told


def case_of(problem: DesignProblem, trial: Trial) -> Case:
    """The case of a trial's device.

    Raises:
        GeometryError: It is none.
    """
    values = dict(zip((one.name for one in problem.free), trial.theta, strict=False))
    return dataclasses.replace(problem.case, name=problem.name, actuator=changed(problem.case.actuator, values))
