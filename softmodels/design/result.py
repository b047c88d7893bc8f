"""What an optimisation found, and how it is put into sentences."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

import numpy as np

from geometries import Actuator
from geometries.parameters import changed
from softmodels.case.case import Case
from softmodels.design.asked import in_words, label
from softmodels.design.cases import case_of
from softmodels.design.formulation import Formulation, Row
from softmodels.design.intervals import Told, recovered
from softmodels.design.multipliers import Holding
from softmodels.design.problem import DesignProblem
from softmodels.design.quantities.gaps import LeastGap
from softmodels.design.tolerances import SURE
from softmodels.design.trials import Trial

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


def _overlaps(row: Row, values: Mapping[str, float]) -> bool:
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
