"""What the warm solver answers: a section's path, states between, its limit. Imported in that process only."""

from __future__ import annotations

import dataclasses

import numpy as np

from softmodels.api.calls import limit as limit_of, run
from softmodels.api.run import Run, SolvedState
from softmodels.app.drawing import Section
from softmodels.case.case import Case
from softmodels.case.materials import SourceBand
from softmodels.common.arrays import Array
from softmodels.fitting.outlines.silhouette import Silhouette
from softmodels.fitting.outlines.simulated import half_outline
from softmodels.materials.silicones import named, product_of, spanning, stretch_at_break
from softmodels.runs.columns import span_sentence
from softmodels.runs.model import Model


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
    """

    states: list[StateAnswer]
    end: str
    notes: list[str]
    breaks_at: float | None


_runs: dict[str, Run] = {}
"""The last run, by the text of its case."""


def path(case: str) -> PathAnswer:
    """Return the path of a case, given as the text of its file."""
    if case not in _runs:
        found = run(Case.from_toml(case))
        _runs.clear()
        _runs[case] = found
    found = _runs[case]
    end = found.limit.why if found.limit else ""
    states, breaks_at = [_state(one) for one in found], stretch_at_break(found.case.material)
    return PathAnswer(states, end, found.notes, breaks_at)


def state(case: str, pressure: str) -> StateAnswer:
    """Return the state of a case at a pressure, such as ``"31 cm"``."""
    if case not in _runs:
        path(case)
    return _state(_runs[case].at(pressure))


def _state(one: SolvedState) -> StateAnswer:
    return StateAnswer(dict(one.row), Section.of(one.points, one.displacement, one.cells, one.von_mises / 1e3))


def limit(case: str) -> str:
    """Return what the largest pressure of a case's device is, as a sentence with the margin to its last requested one."""
    asked = Case.from_toml(case)
    found = limit_of(
        asked.actuator, asked.material, formulation=asked.formulation, components=asked.components, solver=asked.solver
    )
    pressure = f"{found.pressure / asked.cm:.4g} cm ({found.pressure / 1e3:.4g} kPa)"
    if not found.found:
        return f"no limit point up to {pressure}, where the largest stretch is {found.stretch:.3g}"
    what = "limit point" if found.kind == "limit" else "bifurcation"
    highest = max(asked.pressures_cm, default=0.0) * asked.cm
    margin = f", {found.pressure / highest:.3g} times the highest pressure" if highest else ""
    return f"{what} at {pressure}{margin}; largest stretch there {found.stretch:.3g}"


def spread(case: str) -> str:
    """Return how far the sources of a named silicone spread the answer, as a sentence; empty where there is one source."""
    asked = Case.from_toml(case)
    name = named(asked.material)
    if name is None or not spanning(product_of(name)) or asked.program:
        return ""
    banded = dataclasses.replace(asked, band=SourceBand(product_of(name)))
    return span_sentence(banded, run(banded).sources)


SPACING = 1e-4
"""Distance in m of the points of an outline."""


def outline(case: str, pressure: float) -> Array:
    """Return the outer outline of a device at a pressure in Pa: distance from the axis and height above the undeformed apex in
    m, from the axis on, shape (k, 2)."""
    asked = Case.from_toml(case)
    model = Model(asked.actuator, asked.material, asked.components, asked.formulation, solver=asked.solver)
    try:
        # To this very pressure: a photograph may have been taken beyond those of the case.
        state = model.solve(pressure if pressure > 0.0 else None).state
        return half_outline(Silhouette(model.system).curve(state), SPACING, -np.inf)[0]
    finally:
        model.release()
