"""Air supply in time: flows against their formulas, a rigid cavity and devices against ordinary differential equations."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq, minimize_scalar

from geometries import HollowDisk
from softmodels.case.load import steps_of
from softmodels.common.units import Column
from softmodels.materials.laws import NeoHookean, Yeoh
from softmodels.materials.specimens import sphere_pressure
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System
from softmodels.path import schedule
from softmodels.path.schedule import Filling, Settings, source_at, supply
from softmodels.path.stability import PathEnd
from softmodels.path.steps import STRESS_TOLERANCE, last_number, time_at
from softmodels.path.supply import Gas, InSeries, Orifice, Reservoir, Tube, end_weight
from tests.support import bodies
from tests.support.campaigns import sampled

FILLING = "ordinary differential equation of a gas in a rigid cavity"
BALLOON = "ordinary differential equation of a sphere's closed form and the gas in it"
SEALED = "ordinary differential equation of a device's own pressure-volume curve and the gas in it"
CM, ML = 95.1, 1e-6
C = 1e-8  # 1 l/(s bar)
RIGID = bodies.Sphere(through=1, along=3)


# -- flows ------------------------------------------------------------------------------------------------------------


def test_flows_are_those_of_their_formulas():
    """Poiseuille's law with the mean density, and ISO 6358: choked below the critical ratio, none at equal pressures."""
    tube, orifice = Tube(2.0, 1e-3), Orifice(C, 0.3)
    p1, p2 = 130e3, 101e3
    volume = np.pi * (0.5e-3) ** 4 * (p1 - p2) / (8 * 1.81e-5 * 2.0)
    assert tube.flow(p1, p2)[0] == pytest.approx(volume * (p1 + p2) / 2)
    assert orifice.flow(500e3, 101e3)[0] == pytest.approx(C * 500e3 * 100e3)
    assert orifice.flow(p1, p2)[0] == pytest.approx(C * p1 * 100e3 * np.sqrt(1 - ((p2 / p1 - 0.3) / 0.7) ** 2))
    assert orifice.flow(p1, p1)[0] == 0.0
    for one in (tube, orifice, InSeries(orifice, tube)):
        assert one.flow(p2, p1)[0] < 0 < one.flow(p1, p2)[0]
    both = InSeries(orifice, tube).flow(p1, p2)[0]
    between = np.sqrt(p2**2 + both / tube.factor)
    assert orifice.flow(p1, between)[0] == pytest.approx(both)


@pytest.mark.parametrize("one", [Tube(2.0, 1e-3), Orifice(C, 0.3), InSeries(Orifice(C, 0.3), Tube(2.0, 1e-3))], ids=repr)
@pytest.mark.parametrize("pressures", [*itertools.permutations((101325.0, 101360.0, 120e3, 600e3), 2)], ids=repr)
def test_flows_have_their_derivatives(one, pressures):
    p1, p2 = pressures
    _, upstream, downstream = one.flow(p1, p2)
    h = 0.01
    assert (one.flow(p1 + h, p2)[0] - one.flow(p1 - h, p2)[0]) / (2 * h) == pytest.approx(upstream, rel=1e-4, abs=1e-12)
    assert (one.flow(p1, p2 + h)[0] - one.flow(p1, p2 - h)[0]) / (2 * h) == pytest.approx(downstream, rel=1e-4, abs=1e-12)


def test_the_weight_of_a_steps_end_makes_a_decay_exact():
    for z in (1e-5, 9e-4, 1.1e-3, 0.3, 5.0, 80.0):
        theta = end_weight(z)
        assert 0.5 <= theta < 1.0
        assert (1 - (1 - theta) * z) / (1 + theta * z) == pytest.approx(np.exp(-z), abs=1e-9)
    assert end_weight(-3.0) == 0.5


# -- devices ----------------------------------------------------------------------------------------------------------


@pytest.fixture
def filled(body_of):
    """Return a function that follows a device: times in s, pressures in Pa, volumes in m3 and the gas in m3 at ambient
    pressure, of every state; the end; and the gas that has come, by every state but the first."""

    def follow(device, law, reservoir, tables, tolerance=STRESS_TOLERANCE):
        solver = Solver(System(body_of(device), law))
        system, rows, come, end = solver.system, [], [], None
        gas, program = (
            Gas(reservoir, system.stress_unit, system.volume_unit),
            steps_of(water_density=CM / Column(1.0).pascal, **tables),
        )
        with pytest.MonkeyPatch.context() as patch:
            kept = Filling.check

            def check(self, point, first):
                kept(self, point, first)
                come.append(self.curve.delivered(point.state) * system.volume_unit)

            patch.setattr(schedule.Filling, "check", check)
            try:
                for place, point in supply(solver, program, gas, Settings(tolerance=tolerance)):
                    state = point.state
                    amount = gas.value(state.V, state.P) * system.volume_unit
                    rows.append((time_at(program, place), state.P * system.stress_unit, state.V * system.volume_unit, amount))
            except PathEnd as met:
                end = met
        return np.array(rows).T, end, np.array(come)

    return follow


def ode(reservoir, tables, pressure_of, amounts, times):
    """Pressures in Pa of a gas in a cavity whose pressure follows from the gas in m3 at ambient pressure, at times in s."""
    program = steps_of(water_density=CM / Column(1.0).pascal, **tables)
    ends = [time_at(program, float(k)) for k in range(last_number(program) + 1)]
    ends = list(dict.fromkeys(ends))
    corners = [t for t in ends if t <= times[-1]]
    steps = np.arange(last_number(program) + 1)
    known = np.array([time_at(program, float(k)) for k in steps])

    def slope(t, X, low, high):
        last = np.flatnonzero(known <= low + 1e-12)[-1]
        share = (t - known[last]) / (known[last + 1] - known[last])
        source, P = source_at(program, last + share), pressure_of(X[0])
        return [(reservoir.supplied(source, P)[0] - reservoir.lost(P)[0]) / reservoir.ambient]

    X, found = np.array([amounts[0]]), [pressure_of(amounts[0])] * int(times[0] == 0.0)
    distinct, places = np.unique(times, return_inverse=True)
    for low, high in itertools.pairwise(corners):
        inside = distinct[(distinct > low) & (distinct <= high)]
        piece = solve_ivp(slope, (low, high), X, "LSODA", inside, args=(low, high), rtol=1e-10, atol=1e-18)
        X = piece.y[:, -1]
        found += [pressure_of(x) for x in piece.y[0]]
    return np.array(found)[places]


TUBE = Reservoir(tube_length=2.0, tube_bore=0.5e-3, dead_volume=2 * ML)
ORIFICE = Reservoir(tube_length=0.0, conductance=0.002 * C, dead_volume=2 * ML)
RISE_AND_FALL = {"source_pressure_cm": [0.0, 60.0, 60.0, 0.0, 0.0], "time_s": [0.0, 0.02, 1.0, 1.02, 2.0]}
JUMP = {"source_pressure_cm": [60.0, 60.0], "time_s": [0.0, 0.5]}
CHOKED = {"source_pressure_cm": [5000.0, 5000.0, 0.0, 0.0], "time_s": [0.0, 1.0, 1.0, 3.0]}
VALVE = {"source_pressure_cm": [60.0] * 6, "valve": [1, 1, 0, 0, 1, 1], "time_s": [0, 0.1, 0.1, 0.5, 0.6, 1.2]}
PUMP = {"flow_ml_per_min": [6.0, 6.0, 0.0, 0.0], "time_s": [0.0, 2.0, 2.0, 6.0]}
RIGID_CASES = {
    "tube": (TUBE, JUMP),
    "tube, up and down": (TUBE, RISE_AND_FALL),
    "tube, adiabatic": (dataclasses.replace(TUBE, gas="adiabatic"), JUMP),
    "orifice": (ORIFICE, RISE_AND_FALL),
    "orifice, choked": (ORIFICE, CHOKED),
    "tube and orifice": (dataclasses.replace(TUBE, conductance=0.003 * C), VALVE),
    "maximum flow": (dataclasses.replace(TUBE, max_flow=0.1 * ML), JUMP),
    "laminar leak": (dataclasses.replace(TUBE, leak_length=5e-3, leak_bore=0.1e-3), VALVE),
    "orifice as leak": (dataclasses.replace(TUBE, leak_conductance=0.001 * C), VALVE),
    "pump with a leak": (dataclasses.replace(TUBE, leak_conductance=0.0001 * C), PUMP),
}


@pytest.mark.parametrize("case", sampled(RIGID_CASES))
def test_a_rigid_cavity(case, filled, figure):
    reservoir, tables = RIGID_CASES[case]
    (times, pressures, volumes, amounts), end, come = filled(RIGID, NeoHookean(1e9, 0.5), reservoir, tables)
    assert end is None and len(times) < 150
    room = volumes[0] + reservoir.dead
    n = {"isothermal": 1.0, "adiabatic": 1.4}[reservoir.gas]
    wanted = ode(reservoir, tables, lambda X: reservoir.ambient * ((X / room) ** n - 1), amounts, times)
    figure(FILLING, f"{case}: pressure in time over the largest", (pressures - wanted) / wanted.max(), 1e-3)
    moved = np.diff(amounts)[np.diff(times) > 0.0]
    figure("balance of the gas", f"{case}: gas in a rigid cavity", (moved - come) / amounts.max(), 1e-6)


def test_a_tube_fills_a_rigid_cavity_as_its_closed_form(filled, figure):
    """dp/dt = k (ps^2 - p^2) / volume: p = ps tanh."""
    (times, pressures, volumes, _), *_ = filled(RIGID, NeoHookean(1e9, 0.5), TUBE, JUMP)
    room, ps, p0 = volumes[0] + TUBE.dead, 60.0 * CM + TUBE.ambient, TUBE.ambient
    exact = ps * np.tanh(np.arctanh(p0 / ps) + TUBE.tube.factor * ps * times / room) - p0
    figure("closed form of a gas through a tube", "pressure of a rigid cavity", (pressures - exact) / exact.max(), 1e-3)


LAW = Yeoh(15e3, 0.0, 20.0, 0.5)
THIN = bodies.Sphere(inner=0.010, outer=0.0104, through=1, along=24)


def of_sphere(volume):
    return float(sphere_pressure(LAW, THIN.inner, THIN.outer, (volume / THIN.cavity_volume) ** (1 / 3)))


def gas_in_sphere(reservoir):
    """Return functions from the gas to the volume, and to the pressure."""
    volumes = THIN.cavity_volume * np.linspace(0.999, 5.0, 800) ** 3
    pressures = np.array([of_sphere(volume) for volume in volumes])
    amounts = (pressures + reservoir.ambient) / reservoir.ambient * (volumes + reservoir.dead)
    assert (np.diff(amounts) > 0).all()
    return CubicSpline(amounts, volumes), CubicSpline(amounts, pressures)


@pytest.fixture(scope="module")
def limit():
    """Pressure in Pa of the balloon's limit point."""
    return -minimize_scalar(lambda a: -of_sphere(a**3 * THIN.cavity_volume), bounds=(1.1, 2.0), method="bounded").fun


@pytest.mark.campaign
def test_a_balloon_is_carried_past_its_limit_point(limit, filled, figure):
    """A source above the limit pressure: the flow of the tube carries the balloon through, and it ends at the stable state of
    that pressure; with the valve closed on the way, at the state of the gas that has come."""
    reservoir = Reservoir(tube_length=1.0, tube_bore=0.7e-3, dead_volume=2 * ML)
    source = 1.15 * limit / CM
    volume_of, pressure_of = gas_in_sphere(reservoir)
    for name, tables in (
        ("open", {"source_pressure_cm": [source, source], "time_s": [0.0, 3000.0]}),
        (
            "closed on the way",
            {"source_pressure_cm": [source] * 4, "valve": [1, 1, 0, 0], "time_s": [0.0, 50.0, 50.0, 60.0]},
        ),
    ):
        (times, pressures, volumes, amounts), end, come = filled(THIN, LAW, reservoir, tables)
        assert end is None
        most = pressures[volumes < 4 * volumes[0]].max()
        assert pressures.max() <= source * CM * (1 + 1e-9)
        figure("closed form of a sphere", f"limit pressure that is passed, valve {name}", most / limit - 1, 2e-3)
        wanted = ode(reservoir, tables, pressure_of, amounts, times)
        figure(BALLOON, f"pressure in time, valve {name}", (pressures - wanted) / limit, 2e-3)
        moved = np.diff(amounts)[np.diff(times) > 0.0]
        figure("balance of the gas", f"gas in a balloon, valve {name}", (moved - come) / amounts.max(), 1e-6)
        if name == "open":
            large = brentq(lambda a: of_sphere(a**3 * THIN.cavity_volume) - source * CM, 2.0, 4.9)
            assert volumes[-1] > 5 * volumes[0]
            figure(
                "closed form of a sphere",
                "volume under the source's pressure",
                volumes[-1] / (large**3 * volumes[0]) - 1,
                1e-3,
            )
        else:
            assert pressures[-1] < limit
            figure(
                "closed form of a sphere",
                "volume with the gas that has come",
                volumes[-1] / volume_of(amounts[-1]) - 1,
                1e-3,
            )


def test_a_balloon_with_much_gas_snaps_at_once(limit, filled):
    source = 1.15 * limit / CM
    reservoir = Reservoir(tube_length=1.0, tube_bore=3e-3, dead_volume=20000 * ML)
    tables = {"source_pressure_cm": [source, source], "time_s": [0.0, 400.0]}
    (times, pressures, *_), end, _ = filled(THIN, LAW, reservoir, tables)
    assert isinstance(end, schedule.SnapInTime) and end.physical and "smaller dead volume" in str(end)
    assert pressures[-1] == pytest.approx(limit, rel=0.05) and times[-1] < 400.0


@pytest.mark.campaign
def test_a_sealed_device_loses_its_pressure_through_a_leak(filled, equilibrium, solved, figure):
    law, disk = (
        NeoHookean(20e3, 0.495),
        HollowDisk.variant("shadow", section="axisymmetric", support="base", cell_size=0.003),
    )
    reservoir = Reservoir(tube_length=0.3, tube_bore=1e-3, leak_length=20e-3, leak_bore=0.15e-3)
    tables = {"source_pressure_cm": [24.0] * 4, "valve": [1, 1, 0, 0], "time_s": [0.0, 20.0, 20.0, 150.0]}
    (times, pressures, _, amounts), end, _ = filled(disk, law, reservoir, tables)
    assert end is None and pressures[-1] < 0.5 * pressures.max()
    solver = equilibrium(disk, law)
    system = solver.system
    _, points, _ = solved(solver, [24.5 * CM / system.stress_unit], largest_step=0.4 * CM / system.stress_unit)
    P, V = np.array([(p.state.P * system.stress_unit, p.state.V * system.volume_unit) for p in points]).T
    curve = CubicSpline((P + reservoir.ambient) / reservoir.ambient * (V + reservoir.dead), P)
    wanted = ode(reservoir, tables, lambda X: float(curve(X)), amounts, times)
    figure(SEALED, "pressure of a disk that leaks, over the largest", (pressures - wanted) / wanted.max(), 5e-3)
