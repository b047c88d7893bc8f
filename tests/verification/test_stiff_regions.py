"""A sheet ten thousand times stiffer than the silicone, as of paper in a finger: rounding ends no path and turns no sign."""

from __future__ import annotations

import numpy as np
import pytest

import softmodels as sm
from softmodels.case.case import Case
from softmodels.case.load import steps_of
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System, rounding_of_stress, spread

FINGER = sm.PneuNet(
    chambers=6, chamber_length=0.006, chamber_width=0.014, chamber_height=0.014, wall=0.0015, gap=0.0015, base=0.004,
    paper=0.0002, cell_size=0.005,
)  # fmt: skip
LAW = sm.Yeoh(7.7e3, 130.0, 0.0, 0.5)
PAPER = sm.Region(sm.NeoHookean(1e9 / 2.6, 0.3), name="paper")
BASE = sm.Region(sm.NeoHookean(180e3, 0.49), name="base")


@pytest.mark.campaign
def test_a_finger_with_paper_hangs_under_its_weight():
    """With a twentieth of it: before, no step from 0.0227 of it on, at a residual that rounding had left."""
    case = Case("finger", FINGER, LAW, components=(BASE, PAPER, sm.Gravity("-z")), steps=steps_of(share=(0.05,)))
    run = sm.run(case)
    assert run.limit is None and -3.0 < run.path["tip_mm"][-1] < -1.0
    assert not run.path["negative_eigenvalues"].any()
    lowest = run.path["lowest_eigenvalue_Pa_per_mm2"]
    assert lowest.min() > 0.0 and np.ptp(lowest) < 0.05 * lowest.max()  # stands still, as the finger nearly does


def test_what_rounding_leaves_of_a_stiff_sheet(body_of):
    system = System(body_of(FINGER), LAW, components=[BASE, PAPER])
    assert spread(system.matter) == pytest.approx(1e9 / 2.6 / 15.4e3)
    thinnest = 2.2e-16 * spread(system.matter) / rounding_of_stress(system) * FINGER.size
    assert 0.3 * FINGER.paper < thinnest < 1.01 * FINGER.paper
    assert not Solver(system).bordered.inverse.rounded
    assert rounding_of_stress(System(body_of(sm.Membrane()), LAW)) == 0.0
