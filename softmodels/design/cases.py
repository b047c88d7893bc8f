"""The case of a design that was tried."""

from __future__ import annotations

import dataclasses

from geometries.parameters import changed
from softmodels.case.case import Case
from softmodels.design.problem import DesignProblem
from softmodels.design.trials import Trial


def case_of(problem: DesignProblem, trial: Trial) -> Case:
    """The case of a trial's device.

    Raises:
        GeometryError: It is none.
    """
    values = dict(zip((one.name for one in problem.free), trial.theta, strict=False))
    return dataclasses.replace(problem.case, name=problem.name, actuator=changed(problem.case.actuator, values))
