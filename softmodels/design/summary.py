"""A result as plain numbers and sentences, for ``design.json``, from which pictures and report are made."""

from __future__ import annotations

import json
from typing import TypedDict

from softmodels.design.asked import label, shown, shown_factor
from softmodels.design.result import DesignResult
from softmodels.design.units import factor, shown_unit

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
