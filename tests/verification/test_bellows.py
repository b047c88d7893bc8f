"""Bellows: energy, the force on what holds its plate, and the mesh."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from geometries import Balloon, Bellows
from softmodels.materials.laws import NeoHookean
from softmodels.materials.specimens import sphere_pressure
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


@pytest.mark.campaign
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


# -- Balloons against the closed integral of a thick incompressible sphere, and with a neck and a rod ----------------


STRETCHES = np.array([1.1, 1.3, 1.6, 2.0])
SPHERE = "closed integral of a thick incompressible sphere, wall over radius 1/15"


def pressures(equilibrium, solved, balloon):
    """Pressure in Pa where the inner stretch, of a sphere of the cavity's volume, is one of the stretches."""
    equations = equilibrium(balloon, LAW)
    volume = 4 / 3 * math.pi * balloon.radius**3 / equations.system.volume_unit
    _, points, end = solved(equations, volume * (STRETCHES**3 - 1), "volume", "volume")
    assert end is None
    return np.array([point.state.P for point in points if point.requested and point.state.P]) * LAW.shear_modulus


def test_a_closed_balloon_is_the_sphere(equilibrium, solved, figure):
    balloon = Balloon(neck_radius=0.0)
    exact = sphere_pressure(LAW, balloon.radius, balloon.radius + balloon.wall, STRETCHES)
    found = pressures(equilibrium, solved, balloon)
    figure(SPHERE, "pressure of a closed balloon", found / exact - 1, 5e-6)


def test_a_small_neck_hardly_matters(equilibrium, solved, figure):
    """A neck of a tenth of the radius: its hole and its stiffness are some thousandths of the sphere."""
    balloon = Balloon(neck_radius=0.0015, neck_length=0.003, fillet=0.0005)
    exact = sphere_pressure(LAW, balloon.radius, balloon.radius + balloon.wall, STRETCHES)
    found = pressures(equilibrium, solved, balloon)
    figure(SPHERE, "pressure of a balloon on a neck of a tenth of its radius", found / exact - 1, 0.02)


@pytest.mark.campaign
def test_a_neck_keeps_its_energy_balance_and_has_a_limit(equilibrium, solved, figure):
    equations = equilibrium(Balloon(), LAW)
    _, points, end = solved(equations, [0.5])
    V, P = np.array([(point.state.V, point.state.P) for point in points]).T
    equations.system.load(points[-1].state)
    work = CubicSpline(V, P).integrate(V[0], V[-1])
    figure("work of the pressure on a balloon", "stored energy", work / equations.system.stored_energy() - 1, 3e-3)
    balloon = Balloon()
    stretches = np.linspace(1.05, 2.0, 2001)
    most = sphere_pressure(LAW, balloon.radius, balloon.radius + balloon.wall, stretches).max()
    found = Fields(equations).figures(end.limit.state)
    assert found.device["width_mm"] == pytest.approx(2.7 * (balloon.radius + balloon.wall) * 1e3, rel=0.1)
    figure(SPHERE, "limit pressure of the default, on a neck of a quarter of its radius", found.pressure / most - 1, 0.05)


def test_a_rod_lets_the_far_pole_rise_less(equilibrium, solved):
    rises = []
    for rod in (0.0, 0.002):
        equations = equilibrium(Balloon(rod_radius=rod), LAW)
        _, points, end = solved(equations, [0.06])
        assert end is None
        rises.append(Fields(equations).figures(points[-1].state).rises["apex"])
    assert 0.0 < rises[1] < 0.7 * rises[0], rises
