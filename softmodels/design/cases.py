"""The case of a design that was tried."""

from __future__ import annotations

import contextlib
import dataclasses
import tomllib

import tomli_w

from geometries.parameters import changed
from softmodels.case.case import Case
from softmodels.case.errors import INPUT_ERRORS
from softmodels.design.problem import DesignProblem
from softmodels.design.trials import Trial

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
