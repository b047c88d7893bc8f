"""Bellows: energy, the force on what holds its plate, and the mesh."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from geometries import Bellows
from softmodels.materials.laws import NeoHookean
from softmodels.runs.fields import Fields

LAW = NeoHookean(30e3, 0.5)
SMALL = 1e-4
"""A pressure in shear moduli, small enough for a bellows to be linear."""


def last(solved, equations, pressure):
    """All points up to a pressure in shear moduli, in ten steps or more."""
    _, points, end = solved(equations, pressure * np.arange(1, 11) / 10)
    assert end is None
    return points


def test_its_stored_energy_is_the_work_of_the_air(equilibrium, solved, figure):
    equations = equilibrium(Bellows(), LAW)
    points = last(solved, equations, 0.1)
    V, P = np.array([(point.state.V, point.state.P) for point in points]).T
    equations.system.load(points[-1].state)
    work = CubicSpline(V, P).integrate(V[0], V[-1])
    figure("work of the pressure on a bellows", "stored energy", work / equations.system.stored_energy() - 1, 1e-4)


def test_its_blocked_force_is_its_stiffness_times_its_free_rise(equilibrium, solved, figure):
    """Betti: at small pressure a plate that is held bears P dV/dz, which lifts a free one by that over its stiffness."""
    free, held = (equilibrium(Bellows(tip=tip), LAW) for tip in ("free", "held"))
    state = last(solved, free, SMALL)[-1].state
    rows = Fields(free).figures(state)
    blocked = last(solved, held, SMALL)[-1].state
    held.system.load(blocked)
    force = Fields(held).figures(blocked).device["blocked_force_N"]
    stiffness = rows.device["tip_stiffness_N_per_m"]
    figure(
        "stiffness times the rise of a free bellows",
        "blocked force",
        force / (stiffness * rows.rises["apex"]) - 1,
        0.02,
    )


def test_its_mesh_has_converged(equilibrium, solved, figure):
    rises = []
    for cell_size, through in ((0.8e-3, 2), (0.4e-3, 4)):
        equations = equilibrium(Bellows(cell_size=cell_size, through=through), LAW)
        rises.append(Fields(equations).figures(last(solved, equations, 0.05)[-1].state).rises["apex"])
    figure("a bellows of cells half as large", "rise of the plate", rises[0] / rises[1] - 1, 5e-3)


def test_more_convolutions_rise_in_proportion(equilibrium, solved):
    """But for the ends, which are stiffer."""
    found = []
    for count in (2, 4):
        equations = equilibrium(Bellows(convolutions=count), LAW)
        found.append(Fields(equations).figures(last(solved, equations, 0.03)[-1].state).rises["apex"])
    assert found[1] / found[0] == pytest.approx(2.0, rel=0.1)
