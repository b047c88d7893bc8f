"""Clamped membranes against the membrane equations, solved by shooting (`membrane_shooting`).

The equations know no bending. A wall of thickness t bends within about t of its clamp, as if the membrane were so much
smaller: the pressure at a volume is higher by a share that goes with t, and vanishes as t does. Of a membrane of 0.005 radii it
is a percent or less once the membrane has risen by half its radius or more.
"""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from geometries import Membrane
from softmodels.materials.laws import NeoHookean, Yeoh
from softmodels.runs.fields import Fields
from tests.support import membrane_shooting as shooting
from tests.support.campaigns import sampled

RADIUS = 0.020
THIN, THICK = 0.005, 0.03
HEIGHTS = np.linspace(0.1, 1.35, 26) * RADIUS
LAWS = {
    "neo-hookean": (NeoHookean(30e3, 0.5), (15e3,)),
    "yeoh": (Yeoh(15e3, 300.0, 20.0, 0.5), (15e3, 300.0, 20.0)),
}
EQUATIONS = "the membrane equations by shooting, thickness over radius 0.005 and 0.03"


@functools.cache
def unit_path(numbers):
    """The states at `HEIGHTS` of a membrane one metre thick: pressure and energy are proportional to the thickness."""
    return shooting.CircularMembrane(RADIUS, 1.0, shooting.Yeoh(*numbers)).path(HEIGHTS)


def exact_path(thickness, numbers):
    return [
        dataclasses.replace(state, pressure=thickness * state.pressure, energy=thickness * state.energy)
        for state in unit_path(numbers)
    ]


@pytest.fixture(scope="module", params=sampled(LAWS.values(), whole=True), ids=LAWS)
def apart(request, equilibrium, solved):
    """Shares by which pressure and height differ at four volumes, by thickness over radius, shape (4, 2); and the paths."""
    law, numbers = request.param
    shares, paths = {}, {}
    for ratio in (THIN, THICK):
        membrane = Membrane(radius=RADIUS, thickness=ratio * RADIUS, through=2)
        exact = exact_path(membrane.thickness, numbers)
        equations = equilibrium(membrane, law)
        goals = np.interp(np.array([0.3, 0.6, 0.9, 1.2]) * RADIUS, HEIGHTS, [state.volume for state in exact])
        _, points, end = solved(equations, goals / equations.system.volume_unit, "volume", "volume")
        assert end is None
        fields = Fields(equations)
        known = [fields.figures(point.state) for point in points if point.requested and point.state.P]
        found = np.array([(one.pressure, sum(one.rises.values()) / 2) for one in known])
        table = CubicSpline([state.volume for state in exact], [(s.pressure, s.height) for s in exact])(goals)
        shares[ratio], paths[ratio] = found / table - 1, (points, equations, exact)
    return shares, paths


@pytest.mark.campaign
def test_the_equations_balance_their_energy(figure):
    """What is stored is the work of the pressure and of the weight on a plate: shooting against itself."""
    for plate, weight in ((0.0, 0.0), (0.008, 0.1)):
        membrane = shooting.CircularMembrane(RADIUS, 1e-3, shooting.Yeoh(15e3, 300.0), plate, weight)
        path = membrane.path(np.linspace(5e-3, 20e-3, 31))
        V, P, h, W = (np.array([getattr(state, name) for state in path]) for name in ("volume", "pressure", "height", "energy"))
        work = CubicSpline(V, P).integrate(V[0], V[-1]) - weight * (h[-1] - h[0])
        figure("work of pressure and weight", "energy stored by shooting", work / (W[-1] - W[0]) - 1, 1e-5)


def test_it_follows_the_membrane_equations(apart, figure):
    """At heights of 0.6, 0.9 and 1.2 radii of a thin one within a percent; a thick one's clamped edge takes 2 % at 1.2."""
    shares, _ = apart
    figure(EQUATIONS, "pressure at a volume, 0.005, from heights of 0.6 radii on", shares[THIN][1:, 0], 0.01)
    figure(EQUATIONS, "height at a volume, 0.005, from heights of 0.6 radii on", shares[THIN][1:, 1], 0.01)
    figure(EQUATIONS, "pressure at a volume, 0.03, at a height of 1.2 radii", shares[THICK][3:, 0], 0.04)


def test_what_is_left_is_the_clamps_bending(apart, figure):
    """The difference goes with the thickness: in proportion taken down to none, nothing is left."""
    shares, _ = apart
    left = shares[THIN] - (shares[THICK] - shares[THIN]) * THIN / (THICK - THIN)
    figure(EQUATIONS, "pressure at a volume, taken to no thickness", left[:, 0], 1e-3)
    figure(EQUATIONS, "height at a volume, taken to no thickness", left[:, 1], 2e-3)


def test_its_stored_energy_is_the_work_of_the_air(apart, figure):
    _, paths = apart
    points, equations, _ = paths[THICK]
    V, P = np.array([(point.state.V, point.state.P) for point in points]).T
    equations.system.load(points[-1].state)
    stored = equations.system.stored_energy()
    figure(
        "work of the pressure on a membrane",
        "stored energy",
        CubicSpline(V, P).integrate(V[0], V[-1]) / stored - 1,
        1e-3,
    )


def test_its_limit_is_that_of_the_equations(equilibrium, solved, figure):
    thickness = 0.01 * RADIUS
    height, pressure = shooting.limit(exact_path(thickness, LAWS["neo-hookean"][1]))
    equations = equilibrium(Membrane(radius=RADIUS, thickness=thickness, through=2), NeoHookean(30e3, 0.5))
    _, _, end = solved(equations, [2 * pressure / equations.system.stress_unit])
    found = Fields(equations).figures(end.limit.state)
    figure(EQUATIONS, "limit pressure, 0.01", found.pressure / pressure - 1, 0.01)
    figure(EQUATIONS, "height at the limit, 0.01", found.rises["apex"] / height - 1, 0.03)
