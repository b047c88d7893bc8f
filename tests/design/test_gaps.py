"""The least gap between walls of a design: its derivatives, and as a limit where walls do not press on each other."""

from __future__ import annotations

import numpy as np
import pytest

import softmodels as sm
from softmodels.case.case import Case
from softmodels.design.extremes import SHARPNESS, LeastGap
from softmodels.design.problem import DesignProblem
from softmodels.runs import state_values as surface

TAYLOR = "Taylor's remainder of every quantity by every length, before and past a limit point"
FOLDS = sm.Bellows(convolutions=2, cell_size=0.004, through=1.0)
FINGER = """
case.geometry = {device = "PneuNet", chambers = 2, cell_size = "5 mm"}
case.material = {silicone = "dragon-skin-30"}
case.load = {pressure = "0:12 kPa"}
case.walls = {faces = "none"}
parameters = {gap = {from = "0.5 mm", to = "1.6 mm"}}
keep = [{quantity = "least_gap", at = "12 kPa", at_least = "0 mm"}]
maximise = {quantity = "figure", of = "bend_angle_deg", at = "12 kPa"}
"""


@pytest.mark.parametrize("name", ["outer_radius", "wall"])
def test_derivatives(designed, second_order, comm, name):
    """At two states of folds that open, and on a section's other half."""
    model = designed(FOLDS, ("outer_radius", "wall"), (LeastGap(at=60.0), LeastGap(at=200.0)), comm)
    second_order(model, name, TAYLOR, "gap of a bellows", 0.005)


def test_it_lies_below_the_least_gap_by_little(designed, comm):
    """As the state of an ordinary run has it, whose walls are far from pressing on each other."""
    model = designed(FOLDS, ("outer_radius", "wall"), (LeastGap(at=60.0), LeastGap(at=200.0)), comm)
    here = model.evaluate(model.start)
    run = sm.run(Case("folds", FOLDS, model.case.material, pressures_cm=(0.0, 200.0 / 95.12405), water_density=970.0))
    end = run.last
    walls = surface.FacingWalls(end.points, end.cells, end.cell_name)
    found = walls.least(end.displacement, 0.006)
    assert found is not None and not walls.cross(end.displacement) and walls.cross(-3 * end.displacement)
    least, smooth = found.value, here.values[LeastGap(at=200.0).key]
    assert run.pressure[-1] == pytest.approx(200.0, rel=1e-4)
    assert least - 10 * FOLDS.wall / SHARPNESS < smooth < least
    assert any(f"the smallest gap is {1e3 * least:.3g}"[:-1] in note for note in here.notes)


def test_a_finger_whose_chambers_overlap_is_no_design(tmp_path):
    """It was accepted. Its limit is passed at the start, and the search leads to chambers that stand farther apart."""
    lines = []
    problem = DesignProblem.from_toml(FINGER)
    found = sm.optimise(problem, tmp_path / "out", progress=lines.append)
    first, gap = found.first.values["least gap at 12 kPa"], found.confirmed["least gap at 12 kPa"]
    assert first < -0.5e-3 and any("VIOLATED: least gap at 12 kPa -0." in line for line in lines)
    assert found.feasible and gap >= -1e-6 and found.device.gap > 1.5 * problem.case.actuator.gap
    # What the user wrote is in the file, by the silicone's name and in the user's unit.
    text = (tmp_path / "out" / "design.toml").read_text()
    assert 'silicone = "dragon-skin-30"' in text and 'pressure = "0:12 kPa"' in text
    assert Case.from_file(tmp_path / "out" / "design.toml") == found.case
    assert "at 12 kPa" in found.headline


def test_a_finger_whose_chambers_cannot_come_apart_says_so(tmp_path):
    text = FINGER.replace('gap = {from = "0.5 mm", to = "1.6 mm"}', 'base = {from = "2.9 mm", to = "3.1 mm"}')
    found = sm.optimise(DesignProblem.from_toml(text), evaluations=3, confirm=False)
    assert not found.feasible and np.isfinite(found.values["least gap at 12 kPa"])
    assert any("but must be at least 0 mm: walls overlap" in sentence for sentence in found.missed)
