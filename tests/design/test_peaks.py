"""The peak stretch of a design: the same on coarse and fine meshes, in ``path.csv``, and where a design is confirmed."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import softmodels as sm
from softmodels.design.extremes import PeakStretch, PeakVonMises
from softmodels.design.model import DesignModel
from softmodels.design.problem import DesignProblem
from softmodels.runs.state_values import SHARE, volume_peak

WOUND = (sm.Fibres(on="outer", angle=75.0, helices=2, stiffness=10e3),)
SILICONE = sm.NeoHookean(30e3, 0.49)
PRESSURE_CM = 90.0


def wound(**lengths):
    """A tube wound with thread, whose ring is clamped: its stretch has no largest value there."""
    tube = sm.Cylinder(**lengths)
    return sm.Case("tube", tube, SILICONE, pressures_cm=(0.0, PRESSURE_CM), components=WOUND)


def test_the_mean_of_the_largest_values(comm):
    """Of a field that is spread evenly from 0 to 1 over the volume the mean of the last share is known; so is a constant's."""
    values = (np.arange(200_000) + 0.5) / 200_000
    found, q = volume_peak(comm, values, np.full_like(values, 3.0))
    assert found == pytest.approx(1.0 - SHARE / 2, abs=3e-4) and q == pytest.approx(1.0 - SHARE, abs=3e-4)
    assert volume_peak(comm, np.full(10, 1.7), np.ones(10))[0] == pytest.approx(1.7, rel=3e-3)
    assert volume_peak(comm, np.zeros(10), np.ones(10)) == (0.0, 0.0)
    assert volume_peak(comm, np.ones(10), np.ones(10), rest=1.0) == (1.0, 1.0)


def test_coarse_and_fine_meshes_agree(comm, figure):
    """The largest value at a point does not: it grows with the mesh's fineness at the clamped ring."""
    tube = wound(inner_radius=0.0064, wall=0.001)
    quantities = (PeakStretch(at=tube.goals[-1]), PeakVonMises(at=tube.goals[-1]))
    coarse, fine = (
        DesignModel(
            dataclasses.replace(tube, actuator=dataclasses.replace(tube.actuator, cell_size=size)), (), quantities, comm
        ).confirm(np.zeros(0))
        for size in (0.002, 0.0006)
    )
    for asked in quantities:
        name = f"{asked.title}, cells of 2 mm and of 0.6 mm"
        figure("a finer mesh", name, coarse.values[asked.key] / fine.values[asked.key] - 1, 5e-3)


def test_the_path_has_the_same_peak(comm):
    """And it lies below the largest value at a point, which the design names beside it."""
    tube = wound()
    run = sm.run(tube)
    quantities = (PeakStretch(at=tube.goals[-1]), PeakVonMises(at=tube.goals[-1]))
    here = DesignModel(tube, ("wall",), quantities, comm).evaluate(np.array([tube.actuator.wall]))
    stretch, stress = (here.values[asked.key] for asked in quantities)
    assert run.path["peak_stretch"][-1] == pytest.approx(stretch, rel=1e-6)
    assert run.path["peak_stretch"][0] == 1.0 and run.path["peak_von_mises_kPa"][0] == 0.0
    assert 1e3 * run.path["peak_von_mises_kPa"][-1] == pytest.approx(stress, rel=1e-6)
    assert run.path["max_stretch"][-1] > 1.02 * stretch
    assert any(f"largest point value is {run.path['max_stretch'][-1]:.4g} on this mesh" in note for note in here.notes)


def test_a_limit_is_kept_on_the_fresh_mesh_too():
    """Limits on the largest value at a point were kept in the search and passed on the fresh mesh, in turn and for ever."""
    problem = DesignProblem(
        wound(),
        {"inner_radius": ("4 mm", "8 mm"), "wall": ("1 mm", "3 mm")},
        maximise={"quantity": "figure", "of": "elongation_percent", "at": f"{PRESSURE_CM} cm"},
        keep=[{"quantity": "peak_stretch", "at": f"{PRESSURE_CM} cm", "at_most": 1.5}],
    )
    found = sm.optimise(problem)
    elongation, stretch = (found.confirmed[asked.key] for asked in problem.quantities)
    assert found.feasible and len(found.trials) < 25 and elongation > 29.0
    assert 1.49 < stretch <= 1.5 * (1 + 2e-3)
    assert stretch == pytest.approx(found.best.values[problem.quantities[1].key], rel=5e-3)
