"""Sheets far stiffer than the silicone: no step fails on the way, and the states have a limit."""

from __future__ import annotations

import numpy as np
import pytest

from geometries import HollowDisk, SeminarActuator
from softmodels.case.case import Case
from softmodels.components.fibres import Sheet
from softmodels.materials.laws import NeoHookean
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import State, System
from softmodels.path.continuation import Continuation, trace
from softmodels.runs.notes import advice

COARSE = {"cell_size": 0.01, "refinement": 1.0, "fillet": 0.0, "base_fillet": 0.0}
DISK = HollowDisk.variant("shadow", section="axisymmetric", **COARSE)
STIFFNESSES = (50e3, 400e3, 4e6)
PRESSURE = 9.8e3  # Pa: 1 m of water, where the disk without a sheet rises by 24 mm and the stiffest leaves 1 mm


@pytest.fixture(scope="module")
def sheeted(body_of):
    """Return a function that gives a disk with a sheet of a stiffness in N/m on its top."""
    return lambda stiffness: Solver(System(body_of(DISK), NeoHookean(30e3, 0.49), components=[Sheet("top", stiffness)]))


@pytest.fixture(scope="module")
def paths(sheeted):
    """By stiffness: cavity volume at `PRESSURE`, and what the path reported."""
    found = {}
    for stiffness in STIFFNESSES:
        equations, reports = sheeted(stiffness), []
        path = Continuation(equations)
        path.report = reports.append
        points = list(trace(path, [PRESSURE / equations.system.stress_unit]))
        found[stiffness] = points[-1].state.V, reports
    return found


def test_the_states_have_a_limit(paths):
    """Each stiffer sheet leaves less volume, and changes less than the one before."""
    change = np.diff([paths[stiffness][0] for stiffness in STIFFNESSES])
    assert (change < 0.0).all() and abs(change[1]) < abs(change[0])


@pytest.mark.parametrize("stiffness", STIFFNESSES)
def test_no_step_fails(paths, stiffness):
    """With the iterate's own stress alone, one at 4 MN/m does."""
    _, reports = paths[stiffness]
    assert not any("failed" in report for report in reports)


def test_the_matrix_of_a_state_is_the_derivative_of_its_forces(sheeted, figure):
    """Newton's iterates may have a predicted stress in theirs; the tangent, stability and modes of a state must not."""
    equations = sheeted(4e6)
    rng = np.random.default_rng(3)
    w, x = 1e-4 * rng.standard_normal(equations.system.dofs), rng.standard_normal(equations.system.dofs)
    for bc in equations.system.bcs:
        bc.set(x, alpha=0.0)
        bc.set(w, alpha=0.0)

    def force(step):
        equations.system.load(State(w + step * x, 0.0, 1.0))
        return equations.system.internal_forces().copy()

    h = 1e-7
    slope = (force(h) - force(-h)) / (2 * h)
    equations.system.load(State(w, 0.0, 1.0))
    product = np.zeros(equations.system.n)
    equations.system.tangent_product(x[: equations.system.n], product)
    for bc in equations.system.bcs:
        product[bc.dof_indices()[0]] = 0.0
    against = "differences of the forces, a sheet of 4 MN/m"
    figure(against, "tangent", (product - slope) / np.abs(slope).max(), 9e-10)


@pytest.mark.parametrize(
    ("actuator", "stiffness", "locks"),
    [(SeminarActuator(), 400e3, True), (SeminarActuator(), 100.0, False), (DISK, 400e3, False)],
)
def test_a_lost_path_names_the_sheet_and_whether_it_locks(actuator, stiffness, locks):
    sheet = Sheet(actuator.faces[0], stiffness)
    case = Case("device", actuator, NeoHookean(30e3, 0.49), pressures_cm=(10.0,), components=[sheet])
    text = advice(case, {"max_stretch": 1.1, "J_min": 0.99})
    assert f"{stiffness / 1e3:g} kN/m" in text and "--sheet-stiffness" in text and "pressed together" not in text
    assert ("50 kN/m is nearly inextensible" in text) == ("a stiffer one locks" in text) == locks
