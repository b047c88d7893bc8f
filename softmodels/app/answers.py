"""What the warm solver answers: a section's path, states between, its limit; derivatives and outlines of solids that a job has
solved. Imported in that process only."""

from __future__ import annotations

import dataclasses
import functools
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.colors import to_hex

from geometries import actuator
from softmodels.api import calls
from softmodels.api.run import Run, SolvedState
from softmodels.app import replies
from softmodels.case import materials
from softmodels.case.case import Case
from softmodels.common.arrays import Array
from softmodels.design import quantities, states, trials
from softmodels.fitting.outlines import shapes
from softmodels.materials import silicones
from softmodels.mechanics import controls, mpi
from softmodels.mechanics.system import State, System
from softmodels.runs import labels, notes
from softmodels.runs.simulation import Model, Simulation
from softmodels.runs.states import FolderStates

COLOURS = [to_hex(colour) for colour in matplotlib.colormaps["viridis"](np.linspace(0.0, 1.0, 32))]
"""Of sections, from the lowest value up."""
_runs: dict[str, Run] = {}
"""The last run, by the text of its case."""


def path(case: str) -> replies.PathAnswer:
    """Return the path of a case, given as the text of its file."""
    if case not in _runs:
        path_run = calls.run(Case.from_toml(case))
        _runs.clear()
        _runs[case] = path_run
    path_run = _runs[case]
    end = path_run.limit.why if path_run.limit else ""
    states, material = [_state(solved) for solved in path_run], path_run.case.material
    return replies.PathAnswer(
        states, end, path_run.notes, COLOURS, silicones.stretch_at_break(material), silicones.break_words(material)
    )


def state(case: str, pressure: str) -> replies.StateAnswer:
    """Return the state of a case at a pressure, such as ``"31 cm"``."""
    if case not in _runs:
        path(case)
    return _state(_runs[case].at(pressure))


def _state(state: SolvedState) -> replies.StateAnswer:
    return replies.StateAnswer(
        state.variables, replies.Section.of(state.points, state.displacement, state.cells, state.von_mises / 1e3)
    )


def limit(case: str) -> tuple[str]:
    """Return what the largest pressure of a case's device is, as one sentence with the margin to its last requested one."""
    asked = Case.from_toml(case)
    limit = calls.limit(
        asked.actuator, asked.material, formulation=asked.formulation, components=asked.components, solver=asked.solver,
        band=asked.band if isinstance(asked.band, materials.MaterialErrors) else None, tolerance=asked.tolerance,
    )  # fmt: skip
    error = f" ± {limit.half_width / 1e3:.2g} kPa (95 %, mostly {limit.errors[0].text})" if limit.errors else ""
    pressure = f"{asked.column.full(limit.pressure)}, that is {limit.pressure / 1e3:.4g} kPa{error}"
    if not limit.exists:
        return (f"no limit point up to {pressure}, where the largest stretch is {limit.stretch:.3g}",)
    what = "limit point" if limit.kind == "limit" else "bifurcation"
    highest = max(asked.load.of(trials.PRESSURE), default=0.0)
    margin = f", {limit.pressure / highest:.3g} times the highest pressure" if highest else ""
    return (f"{what} at {pressure}{margin}; largest stretch there {limit.stretch:.3g}",)


def errors(case: str) -> tuple[str, str]:
    """Return the error of the gauge's rise at the last requested value with its causes, the largest first, and how far the
    sources of a named silicone spread the answer, as sentences; empty where nothing is known, or there is one source."""
    asked = Case.from_toml(case)
    if asked.program:
        return "", ""
    name, banded = silicones.named(asked.material), asked
    if asked.band is None and name is not None and silicones.spanning(product := silicones.product_of(name)):
        banded = dataclasses.replace(asked, band=materials.SourceBand(product))
    solved = calls.run(dataclasses.replace(banded, mesh_error=asked.actuator.refinable))
    lines, row = solved.budget.lines(), next(iter(solved.budget.stated), None)
    error = f"at {labels.load(row, labels.state_labels(asked))}: {lines[0].replace('+-', '±')}" if row and lines else ""
    return error, notes.span_sentence(banded, solved._source.sources) if solved.sources else ""


class _Solved:
    """A run that a job has stored, and its device's equations on the same mesh; ValueError if its states depend on how they
    were reached."""

    def __init__(self, folder: str):
        self.source, comm = FolderStates(Path(folder)), mpi.start()
        case = self.source.case
        if case.timed or case.program or case.load.driven is not None:
            raise ValueError("states that depend on time or on a program of loads have no linear answer")
        self.pressures = self.source.rows["pressure"]
        self.simulation = Simulation(case, comm)
        self.simulation.prepare_on(self.source.mesh)

    def state(self, pressure: float) -> State:
        """Return the state at a pressure in Pa, by Newton's method from the nearest stored one."""
        step = int(np.abs(self.pressures - pressure).argmin())
        fields, restart = self.source.fields(step, ("displacement", "p")), self.source.restart(step)
        near = self.simulation.fields.state(fields, restart["P"], restart["V"])
        solver = self.simulation.solver
        return solver.solve(controls.pressure_control(pressure / solver.system.stress_unit), near.w, near.P)

    @functools.cached_property
    def adjoint(self) -> tuple[quantities.DesignedBody, states.Adjoint]:
        """Derivatives on this mesh."""
        design = quantities.DesignedBody(self.simulation.solver)
        return design, states.Adjoint(design)


_solved: dict[tuple[str, float], _Solved] = {}
"""The last stored run, by its folder and the time at which it was written."""


def _solved_in(folder: str) -> _Solved:
    key = folder, (Path(folder) / "path.csv").stat().st_mtime
    if key not in _solved:
        for solved in _solved.values():
            solved.simulation.release()
        _solved.clear()
        _solved[key] = _Solved(folder)
    return _solved[key]


def linear(folder: str, pressure: float) -> replies.LinearAnswer:
    """Return the state of a stored run at a pressure in Pa with its derivatives by the pressure and by all lengths."""
    solved = _solved_in(folder)
    state = solved.state(pressure)
    design, adjoint = solved.adjoint
    adjoint.prepare(state)
    device = solved.source.case.actuator
    velocities = design.motion.boundary_velocities([name for name in device.movable if actuator.is_length(device, name)])
    asked: dict[str, tuple[quantities.DesignQuantity, float]] = {
        f"{probe}_mm": (quantities.Rise(at=pressure, of=probe), 1e3) for probe in device.probes
    }
    asked["added_volume_ml"] = quantities.AddedVolume(at=pressure), 1e6
    answer = replies.LinearAnswer(solved.source.case.to_toml(), pressure, {}, {}, {name: {} for name in velocities})
    for name, (quantity, unit) in asked.items():
        slopes = quantity.measure(design).slopes(state)
        answer.values[name] = unit * slopes.value
        answer.by_pressure[name] = unit * adjoint.multipliers(slopes, trials.PRESSURE)[1] / design.system.stress_unit
        for length, slope in adjoint.gradient(slopes, trials.PRESSURE, velocities)[0].items():
            answer.by_length[length][name] = unit * slope
    return answer


OUTLINE_SPACING = 1e-4


def outline(case: str, pressure: float, folder: str = "") -> Array:
    """Return the outer outline of a device at a pressure in Pa, which may be beyond those of the case: distance from the axis
    and height above the undeformed apex in m, from the axis on, shape (k, 2). Of a solid the stored run of this case is
    needed."""
    if folder:
        solved = _solved_in(folder)
        return _half_outline(solved.simulation.solver.system, solved.state(pressure))
    asked = Case.from_toml(case)
    model = Model(asked.actuator, asked.material, asked.components, asked.formulation, solver=asked.solver)
    try:
        return _half_outline(model.system, model.solve(pressure if pressure > 0.0 else None).state)
    finally:
        model.release()


def _half_outline(system: System, state: State) -> Array:
    return shapes.half_outline(shapes.Silhouette(system).curve(state), OUTLINE_SPACING, -np.inf)[0]
