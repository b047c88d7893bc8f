"""Inertia against ordinary differential equations, natural frequencies and balances of energy.

A sphere of an incompressible silicone moves with one unknown, its inner radius a: the point at R is at r^3 = R^3 + a^3 - A^3.
With the pressure that its wall bears and the density rho

    P - P_wall = rho ((2 a a'^2 + a^2 a'') (1/a - 1/b) - a^4 a'^2/2 (1/a^4 - 1/b^4))
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import curve_fit

import softmodels as sm
from geometries import Beam
from softmodels.case.load import steps_of
from softmodels.common.units import Column
from softmodels.materials.laws import Gent, NeoHookean
from softmodels.mechanics.assembly import Inertia
from softmodels.mechanics.controls import pressure_control
from softmodels.mechanics.memory import Motion
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System
from softmodels.path.schedule import Settings, follow, supply
from softmodels.path.stability import Mode, PathEnd, Stability
from softmodels.path.steps import time_at
from softmodels.path.supply import Gas, Reservoir
from tests.support import bodies
from tests.support.campaigns import sampled

SPHERE = "ordinary differential equation of a sphere with mass"
MODE = "natural frequency"
ENERGY = "work of the air"
MU, DENSITY, CM = 30e3, 1070.0, 100.0
LAW = NeoHookean(MU, 0.5)
BRANCHES = ((0.5, 2e-3),)
THICK = bodies.Sphere(through=3, along=9)
COARSE = bodies.Sphere(through=1, along=4)
PERIOD = 4.64e-3
"""Of the thick sphere under a pressure of 4 kPa that is applied at once, in s."""


def system_of(body, law, radius=0.9, formulation="mixed", inertia=None, **more):
    """The equations of a body that has mass, and its motion."""
    system = System(body, law, formulation, creeping=True, **more)
    motion = Motion(system, inertia or Inertia((1.0,)), DENSITY, radius)
    system.potential.motion = motion
    return system, motion


def row_of(system, motion, time, state):
    """Time in s, pressure in Pa, volume in m3, energies that are stored, dissipated and kinetic in J."""
    system.load(state)
    potential, unit = system.potential, system.stress_unit * system.volume_unit
    pressure = system.pressures_at(state)[0] * system.stress_unit if system.volumes().size else 0.0
    energies = (system.stored_energy(), potential.dissipated, motion.kinetic)
    return time, pressure, state.V * system.volume_unit, *(energy * unit for energy in energies)


def followed(body, law, tables, tolerance=5e-5, radius=0.9):
    """Rows of a load in time."""
    system, motion = system_of(body, law, radius)
    program, rows = steps_of(water_density=CM / Column(1.0).pascal, **tables), []
    for come, point in follow(Solver(system), program, Settings(tolerance=tolerance)):
        rows.append(row_of(system, motion, time_at(program, come), point.state))
    return np.array(rows).T


def stepped(system, motion, pressure, steps, shape=None):
    """Rows and dofs of steps of given lengths at a pressure in Pa, from rest, or from a shape that is let go."""
    solver, potential = Solver(system), system.potential
    rest = system.rest()
    w = rest.w if shape is None else shape
    potential.commit(w, reset=True)
    rows, P, time = [], pressure / system.stress_unit, 0.0
    for step in steps:
        potential.pass_time(step)
        solver.lagged.exhausted = True
        state = solver.solve(pressure_control(P), motion.predicted(w), P)
        potential.commit(state.w)
        w, time = state.w, time + step
        rows.append((*row_of(system, motion, time, state), w))
    return rows


def equal(count, step):
    """A first step that finds the acceleration, and equal ones."""
    return [1e-2 * step, *[step] * count]


def radius_of_ode(sphere, pressure, branches, times):
    """Inner radius in m of a sphere at rest to which a pressure in Pa is applied at once."""
    points, weights = np.polynomial.legendre.leggauss(24)
    A, B = sphere.inner, sphere.outer
    R, weights = (A + B) / 2 + (B - A) / 2 * points, (B - A) / 2 * weights

    def rate(time, y):
        a, speed = y[:2]
        b, stretch = (B**3 + a**3 - A**3) ** (1 / 3), ((R**3 + a**3 - A**3) ** (1 / 3)) / R
        radial, hoop = stretch**-4, stretch**2
        difference, creep = MU * (hoop - radial), []
        for (share, tau), Cv in zip(branches, y[2:].reshape(len(branches), len(R)), strict=True):
            difference = difference + share * MU * (hoop * np.sqrt(Cv) - radial / Cv)
            creep.append((radial - (radial / Cv + 2 * hoop * np.sqrt(Cv)) / 3 * Cv) / tau)
        wall = np.sum(weights * 2 * difference / (R * stretch**3))
        drive = (pressure - wall) / DENSITY + a**4 * speed**2 / 2 * (a**-4 - b**-4)
        acceleration = (drive / (1 / a - 1 / b) - 2 * a * speed**2) / a**2
        return np.concatenate([[speed, acceleration], *creep])

    start = np.concatenate([[A, 0.0], np.ones(len(R) * len(branches))])
    distinct, places = np.unique(times, return_inverse=True)
    return solve_ivp(rate, (0.0, times[-1]), start, "LSODA", distinct, rtol=1e-9, atol=1e-13).y[0][places]


def at_once(cm, seconds):
    """A pressure that is applied at once and held."""
    return {"cavity1": {"pressure_cm": [cm, cm]}, "time_s": [0.0, seconds]}


# -- the scheme -------------------------------------------------------------------------------------------------------


@pytest.mark.campaign
@pytest.mark.parametrize("radius", sampled([1.0, 0.9, 0.5, 0.0], (0.9,)))
def test_the_order_is_two(radius, body_of, figure):
    """Volume after 0.3 periods in 12, 24 and 48 steps, elastic and with a branch."""
    for law, name in ((LAW, "elastic"), (LAW.with_memory(branches=BRANCHES), "with a branch")):
        found = []
        for count in (12, 24, 48):
            rows = stepped(*system_of(body_of(COARSE), law, radius), 4e3, equal(count, 0.3 * PERIOD / count))
            found.append(rows[-1][2])
        first, second = np.diff(found)
        figure("order 2 of the step", f"{name}, spectral radius {radius:g}", math.log2(first / second) - 2, 0.5)


@pytest.mark.parametrize("branches", sampled([(), BRANCHES], whole=True), ids=["elastic", "with a branch"])
def test_a_sphere_to_which_a_pressure_is_applied_at_once(branches, body_of, figure):
    law = LAW.with_memory(branches=branches) if branches else LAW
    times, _, volumes, stored, lost, kinetic = followed(body_of(THICK), law, at_once(40.0, 3 * PERIOD))
    exact = radius_of_ode(THICK, 4e3, branches, times) ** 3 * 2 / 3 * math.pi
    name = "with a branch" if branches else "elastic"
    swing = exact.max() - exact[0]
    figure(SPHERE, f"volume in three periods over its swing, {name}", (volumes - exact) / swing, 0.01)
    work = 4e3 * (volumes - volumes[0])
    figure(ENERGY, f"energies of a sphere, {name}", (stored + lost + kinetic - work) / kinetic.max(), 1e-3)
    assert (lost[-1] > 0.1 * work.max()) == bool(branches)


@pytest.mark.campaign
def test_energy_stays_over_a_hundred_periods(body_of, figure):
    """With the default spectral radius and tolerance, a swing of 11 % of the radius."""
    _, _, volumes, stored, _, kinetic = followed(body_of(COARSE), LAW, at_once(40.0, 100 * PERIOD))
    off = (stored + kinetic - 4e3 * (volumes - volumes[0])) / kinetic.max()
    figure("energy at the start", "energy over 100 periods, over the kinetic one", off, 5e-4)
    last = kinetic[-len(kinetic) // 50 :].max()
    figure("energy at the start", "kinetic energy in the last two of 100 periods", last / kinetic.max() - 1, 5e-4)


# -- natural frequencies ----------------------------------------------------------------------------------------------


def periods(times, values):
    """Mean period in s of a swing, by its rising zeros."""
    up = np.flatnonzero((values[:-1] < 0.0) & (values[1:] >= 0.0))
    zeros = [times[k] - values[k] * (times[k + 1] - times[k]) / (values[k + 1] - values[k]) for k in up]
    return (zeros[-1] - zeros[0]) / (len(zeros) - 1)


def swing(model, inertia, components=(), steps=120, count=3):
    """Frequencies in Hz of a model's first mode, and of the device that is let go in its shape, for so many periods."""
    system = model.system
    motion = Motion(system, inertia, DENSITY)
    system.potential.motion = motion
    stability = Stability(model.solver, inertia)
    (value, shape), *_ = stability.eigenpairs(system.rest(), 1)
    wanted = math.sqrt(value / motion.unit) / (2 * math.pi)
    start = 1e-4 * shape
    measure = Mode(stability.mass, shape)
    rows = stepped(system, motion, 0.0, equal(count * steps, 1.0 / wanted / steps), start)
    times, amounts = np.array([row[0] for row in rows]), np.array([measure.share(row[-1]) for row in rows])
    return wanted, 1.0 / periods(times, amounts), rows


BEAM = Beam(length=0.05, width=0.005, thickness=0.005, clamp="slip", cell_size=0.005)


@pytest.mark.parametrize("what", sampled(["alone", "mass", "rigid plate"]))
def test_a_beam_swings_at_its_natural_frequency(what, figure):
    own = 0.5 * DENSITY * BEAM.solid_volume
    parts = {"alone": (), "mass": (sm.Mass("tip", own),), "rigid plate": (sm.Rigid("tip", mass=own),)}[what]
    still = (sm.Gravity("-z", magnitude=1e-9),) if parts else ()
    model = sm.Model(BEAM, sm.NeoHookean(MU, 0.0), (*still, *parts), "displacement")
    unit = DENSITY * model.system.volume_unit
    wanted, found, _ = swing(model, Inertia((1.0,), (("tip", own / unit),) if parts else ()))
    figure(MODE, f"of a beam that is let go, {what}", found / wanted - 1, 5e-4)


@pytest.mark.campaign
@pytest.mark.parametrize(("share", "time"), [(0.2, 0.05), (0.6, 0.01)])
def test_a_beam_with_a_memory_rings_as_its_mode_says(share, time, figure):
    """Let go in its relaxed first mode: a decaying swing is fitted to its motion, and the creep that it leaves."""
    law = NeoHookean(MU, 0.49).with_memory(branches=[(share, time)])
    mode = sm.Model(BEAM, law, (), "displacement").modes(count=1)[0]
    shape = sm.Model(BEAM, law.relaxed, (), "displacement")
    system, motion = system_of(shape.body, law, 1.0, "displacement")
    (_, start), *_ = Stability(shape.solver).eigenpairs(shape.system.rest(), 1)
    measure = Mode(Stability.of(shape.solver).mass, start)
    rows = stepped(system, motion, 0.0, equal(4 * 60, 1.0 / mode.frequency / 60), 1e-4 * start)
    times, amounts = np.array([row[0] for row in rows]), np.array([measure.share(row[-1]) for row in rows])

    def rings(t, rate, turn, cosine, sine, creep, slow):
        return np.exp(-rate * t) * (cosine * np.cos(turn * t) + sine * np.sin(turn * t)) + creep * np.exp(-slow * t)

    turn, amount = 2 * math.pi * mode.frequency, amounts[0]
    guess = [mode.damping * turn, turn, amount, 0.0, 0.0, 1.0 / time]
    rate, turn, *_ = curve_fit(rings, times, amounts, guess)[0]
    figure(MODE, f"beam with a branch of {share} and {time} s", turn / (2 * math.pi) / mode.frequency - 1, 2e-3)
    ratio = rate / math.hypot(rate, turn)
    figure("damping ratio of a mode", f"beam with a branch of {share} and {time} s", ratio / mode.damping - 1, 1e-2)


@pytest.mark.campaign
def test_a_sphere_swings_at_its_natural_frequency(body_of, figure):
    """A small pressure is applied at once."""
    times, _, volumes, *_ = followed(body_of(COARSE), LAW, at_once(0.1, 4 * PERIOD), 1e-7)
    system, motion = system_of(body_of(COARSE), LAW)
    solver = Solver(system)
    pairs = Stability(solver).eigenpairs(system.rest(), 6)
    grown = [abs(float(solver.system.pressure_loads()[0] @ shape[: system.n])) for _, shape in pairs]
    value = pairs[int(np.argmax(grown))][0]
    wanted = math.sqrt(value / motion.unit) / (2 * math.pi)
    found = 1.0 / periods(times, volumes - volumes.mean())
    figure(MODE, "of a sphere that breathes", found / wanted - 1, 1e-3)


@pytest.mark.campaign
def test_a_plate_that_turns_keeps_the_energy(figure):
    """A beam with a heavy rigid plate is pushed into its first mode."""
    own = 0.5 * DENSITY * BEAM.solid_volume
    model = sm.Model(BEAM, sm.NeoHookean(MU, 0.3), (sm.Gravity("-z", magnitude=1e-9), sm.Rigid("tip", mass=own)))
    system = model.system
    motion = Motion(system, Inertia((1.0,), (("tip", own / (DENSITY * system.volume_unit)),)), DENSITY, 1.0)
    solver = model.solver
    (value, shape), *_ = Stability(solver, Inertia((1.0,))).eigenpairs(system.rest(), 1)
    system.potential.motion = motion
    period = 2 * math.pi * math.sqrt(motion.unit / value)
    potential, rest = system.potential, system.rest()
    potential.commit(rest.w, reset=True)
    motion._v = 0.15 * shape[: system.n] * math.sqrt(value / motion.unit)
    w, energies = rest.w, []
    for step in equal(200, 2 * period / 100):
        potential.pass_time(step)
        solver.lagged.exhausted = True
        state = solver.solve(pressure_control(0.0), motion.predicted(w), 0.0)
        potential.commit(state.w)
        w = state.w
        system.load(state)
        energies.append((motion.kinetic, system.stored_energy()))
    kinetic, stored = np.array(energies).T
    assert stored.max() > 0.5 * kinetic.max()
    figure("energy at the start", "beam with a plate that turns", (kinetic + stored) / kinetic[0] - 1, 1e-5)


# -- jumps ------------------------------------------------------------------------------------------------------------

BALLOON = bodies.Sphere(inner=0.010, outer=0.011, through=1, along=6)
RUBBER = Gent(MU, 25.0, 0.5)
RESERVOIR = Reservoir(tube_length=0.1, tube_bore=8e-3, dead_volume="5 l")


def filled(body, law, tables, moves=True):
    """Rows of a device with an air supply, amounts of its gas in m3 at ambient pressure; and why the path ended."""
    system = System(body, law, creeping=True)
    motion = Motion(system, Inertia((1.0,)), DENSITY)
    if moves:
        system.potential.motion = motion
    program, gas = (
        steps_of(water_density=CM / Column(1.0).pascal, **tables),
        Gas(RESERVOIR, system.stress_unit, system.volume_unit),
    )
    rows, end = [], None
    try:
        for come, point in supply(Solver(system), program, gas):
            amount = gas.value(point.state.V, point.state.P) * system.volume_unit
            rows.append((*row_of(system, motion, time_at(program, come), point.state), amount))
    except PathEnd as met:
        end = met
    return np.array(rows).T, end


@pytest.mark.campaign
def test_a_balloon_jumps_on_its_air_supply_and_comes_to_rest(body_of, equilibrium, solved, figure):
    """The gas of a large dead volume expands faster than any flow: without mass the path ends there. With it the balloon comes
    to rest where the quasi-static jump leads, at the source's pressure on the stiff side."""
    solver = equilibrium(BALLOON, RUBBER)
    unit = solver.system.stress_unit
    _, points, _ = solved(solver, [6.0 * solver.system.rest().V], quantity="volume")
    source = 1.05 * next(point.state.P for point in points if point.limit)
    law = RUBBER.with_memory(branches=[(1.0, 5e-3)])
    cm = source * unit / CM
    tables = {"source_pressure_cm": [cm, cm], "time_s": [0.0, 0.3]}
    (times, *_), end = filled(body_of(BALLOON), RUBBER, tables, moves=False)
    assert end is not None and "snaps through with the gas" in str(end) and times[-1] < 0.1
    (times, P, V, stored, lost, kinetic, _), end = filled(body_of(BALLOON), law, tables)
    assert end is None and times[-1] == 0.3
    grown = (V[-1] - V[0]) / solver.system.volume_unit
    _, points, _ = solved(solver, [0.99 * grown, grown, 1.01 * grown], quantity="volume")
    asked = [point.state for point in points if point.requested]
    assert asked[0].P < source < asked[-1].P  # the stiff side
    after = np.interp(source, [one.P for one in asked], [one.V for one in asked]) * solver.system.volume_unit
    rest = "equilibrium after the quasi-static jump"
    figure(rest, "pressure of a balloon at rest", P[-1] / (source * unit) - 1, 2e-8)
    figure(rest, "volume of a balloon at rest", V[-1] / after - 1, 5e-6)
    assert kinetic[-1] < 1e-6 * kinetic.max()
    work = np.concatenate([[0.0], np.cumsum((P[1:] + P[:-1]) / 2 * np.diff(V))])
    figure(ENERGY, "energies of a balloon that jumps", (stored + lost + kinetic - work) / work.max(), 4e-5)
    assert V[-1] > 10 * V[0] and np.argmax(kinetic) < len(times) - 10
