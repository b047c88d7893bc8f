"""Two cavities under proportional pressures: one unknown P, and a sum of volumes that P works on."""

from __future__ import annotations

import dataclasses
import shutil

import numpy as np
import pytest

from geometries import ImportedActuator
from softmodels.case.case import Case
from softmodels.materials.laws import NeoHookean
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System
from softmodels.runs.fields import Fields

RATIOS = "ratios (0.5, 1) at P, by (1, 2) at P/2"
LAW = NeoHookean(30e3, 0.49)
GOAL = 6e3


@pytest.fixture(scope="module")
def part(two_cavities):
    return ImportedActuator(
        file=str(two_cavities), cavities=("at 11, 0, 2 mm", "at 11, 0, -2 mm"), support="x = 0 mm", cell_size=0.005
    )


@pytest.fixture(scope="module")
def inflated(part, body_of, solved):
    """Return a function that inflates the part under a pair of ratios: points, equations and last figures."""
    known = {}

    def inflate(ratios, goal=GOAL):
        if (ratios, goal) not in known:
            equations = Solver(System(body_of(dataclasses.replace(part, pressure_ratios=ratios)), LAW))
            _, points, end = solved(equations, [goal / equations.system.stress_unit])
            assert end is None
            known[ratios, goal] = points, equations, Fields(equations).figures(points[-1].state)
        return known[ratios, goal]

    return inflate


@pytest.mark.campaign
def test_the_inflated_one_bends_the_part_away(inflated):
    upper, lower, both = (inflated(ratios)[2].rises["tip"] for ratios in ((1.0, 0.0), (0.0, 1.0), (1.0, 1.0)))
    assert upper < 0 < lower and upper < both < lower


def test_only_the_products_count(inflated, figure):
    """Ratios (1, 2) at P are (0.5, 1) at 2 P."""
    one, other = inflated((1.0, 2.0), GOAL / 2)[2], inflated((0.5, 1.0), GOAL)[2]
    figure(RATIOS, "tip's rise", one.rises["tip"] / other.rises["tip"] - 1, 1e-12)
    figure(RATIOS, "stored energy", one.stored_energy / other.stored_energy - 1, 1e-12)
    figure(RATIOS, "twice the added volume", one.added_volume / (2 * other.added_volume) - 1, 1e-12)


def test_work_of_both_is_what_is_stored(inflated, figure):
    points, equations, _ = inflated((0.5, 1.0))
    V, P = np.array([(point.state.V, point.state.P) for point in points]).T
    slopes = np.array([point.tangent.P / point.tangent.V for point in points])
    h = np.diff(V)
    work = np.sum(h * (P[1:] + P[:-1]) / 2 - h**2 * np.diff(slopes) / 12)  # trapezia with their end slopes
    equations.system.load(points[-1].state)
    figure("work of the pressure in two cavities", "stored energy", equations.system.stored_energy() / work - 1, 6e-5)


def test_case_file_names_the_part_beside_it(part, tmp_path):
    """A case file and its part go together; the case that a run stores finds the part from anywhere."""
    (tmp_path / "bench").mkdir()
    shutil.copy(part.file, tmp_path / "bench" / "my.step")
    text = """
    name = "bellows"
    [geometry]
    device = "ImportedActuator"
    file = "my.step"
    cavities = ["at 11, 0, 2 mm", "at 11, 0, -2 mm"]
    support = "x = 0 mm"
    pressure_ratios = [1, 0.5]
    [load]
    pressure_cm = "0:60"
    """
    (tmp_path / "bench" / "bellows.toml").write_text(text)
    case = Case.from_file(tmp_path / "bench" / "bellows.toml")
    assert case.actuator.file == str(tmp_path / "bench" / "my.step") and case.actuator.ratios == (1.0, 0.5)
    assert Case.from_toml(case.to_toml()) == case
    assert case.actuator.key == dataclasses.replace(case.actuator, file=part.file).key


def test_a_stiffness_with_a_volume_held(part, body_of, figure):
    """Its error is the square of the linear solver's tolerance."""
    from softmodels.mechanics.controls import Coupling, pressure_control
    from softmodels.mechanics.system import face_load

    equations = Solver(System(body_of(part), LAW))
    eq = equations.system
    rest = eq.rest()
    coupling = Coupling.by_pressure(np.zeros(2), np.array([1.0, 0.0]), (1,), eq.volumes())
    start = equations.couple(coupling, rest, np.zeros(2))
    load = face_load(eq, "outer", part.lift)
    found, states, w = [], [], start.w
    for pressure in (0.2, 0.4, 0.6):
        states.append(equations.solve(pressure_control(pressure * GOAL / eq.stress_unit), w, 0.0))
        w = states[-1].w
    equations.factorise(states[0])
    for state in states:
        found.append(equations.dead_load_compliance(state, load))
    free = eq.by_unknowns(load).copy()
    exact = [float(free @ equations.aside(one, pressure_control(one.P), free, 1e-11).w[: eq.n]) for one in states]
    figure("a stiffness with a volume held", "solved to 1e-11", np.array(found) / exact - 1, 1e-8)
