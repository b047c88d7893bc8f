"""What the warm solver answers: a section's path, states between, its limit. Imported in that process only."""

from __future__ import annotations

import dataclasses
import time

from softmodels.api.calls import run
from softmodels.api.run import Run, SolvedState
from softmodels.app.drawing import Section
from softmodels.case.case import Case
from softmodels.materials.silicones import stretch_at_break


@dataclasses.dataclass(frozen=True)
class StateAnswer:
    """A state: its row of ``path.csv`` and its section, coloured by von Mises stress in kPa."""

    row: dict[str, object]
    section: Section


@dataclasses.dataclass(frozen=True)
class PathAnswer:
    """A path, as ``sm.run(case)`` finds it.

    Attributes:
        states: From rest to its end.
        end: Why the path ends before the last requested value; empty if it does not.
        notes: Warnings.
        breaks_at: Stretch at which the silicone broke when it was pulled; None if unknown.
        seconds: That it took.
    """

    states: list[StateAnswer]
    end: str
    notes: list[str]
    breaks_at: float | None
    seconds: float


_runs: dict[str, Run] = {}
"""The last run, by the text of its case."""


def path(case: str) -> PathAnswer:
    """Return the path of a case, given as the text of its file."""
    began = time.perf_counter()
    if case not in _runs:
        found = run(Case.from_toml(case))
        _runs.clear()
        _runs[case] = found
    found = _runs[case]
    end = found.limit.why if found.limit else ""
    states, breaks_at = [_state(one) for one in found], stretch_at_break(found.case.material)
    return PathAnswer(states, end, found.notes, breaks_at, time.perf_counter() - began)


def state(case: str, pressure: str) -> StateAnswer:
    """Return the state of a case at a pressure, such as ``"31 cm"``."""
    if case not in _runs:
        path(case)
    return _state(_runs[case].at(pressure))


def _state(one: SolvedState) -> StateAnswer:
    return StateAnswer(dict(one.row), Section.of(one.points, one.displacement, one.cells, one.von_mises / 1e3))
