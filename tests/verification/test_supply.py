"""A syringe on the thin disk: the gas law between stroke, volume and pressure, its two extremes, and its energy."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline, CubicSpline

from geometries import HollowDisk
from softmodels.materials.laws import NeoHookean
from softmodels.materials.specimens import balloon_pressure
from softmodels.path.supply import Stroke, Syringe
from tests.support import bodies
from tests.support.campaigns import sampled

LAW = "law of the gas in a syringe"
THIN = HollowDisk.variant("shadow", section="axisymmetric", support="base", cell_size=0.003)
ML = 1e-6


@pytest.fixture(scope="module")
def disk(equilibrium):
    return equilibrium(THIN, NeoHookean(20e3, 0.495))


@pytest.fixture(scope="module")
def drive(disk, solved):
    """Return a function that drives the disk by a syringe: strokes in ml to strokes, volumes, pressures of all points."""

    def run(strokes, syringe, **options):
        disk.system.rest()
        supply = syringe.control(
            disk.system.rest().V * disk.system.volume_unit, disk.system.stress_unit, disk.system.volume_unit
        )
        goals = [stroke * ML / disk.system.volume_unit for stroke in strokes]
        path, points, end = solved(disk, goals, quantity=supply, **options)
        assert end is None
        return path, points

    return run


@pytest.mark.parametrize("gas", ["isothermal", "adiabatic"])
def test_stroke_pressure_and_volume_obey_the_gas_law(disk, drive, gas, figure):
    syringe = Syringe(syringe=60 * ML, gas=gas)
    path, points = drive([20, 45], syringe)
    power = {"isothermal": 1.0, "adiabatic": 1.4}[gas]
    asked = [point for point in points if point.requested]
    for point, stroke in zip(asked, (20, 45), strict=True):
        gas_now = 65 * ML - stroke * ML + point.state.V * disk.system.volume_unit
        gas_rest = 65 * ML + path.history.V0 * disk.system.volume_unit
        absolute = point.state.P * disk.system.stress_unit + syringe.ambient
        kept = absolute * gas_now**power / (syringe.ambient * gas_rest**power)
        figure(LAW, "P V^n over a stroke, isothermal and adiabatic", kept - 1, 1e-12)
    assert [point.limit for point in points].count(True) == 1  # driven past the limit, as a pressure could not


def test_a_liquid_is_volume_control(disk, drive, solved, figure):
    _, points = drive([10, 35], Syringe(syringe=60 * ML, gas="liquid"))
    _, expected, _ = solved(disk, [10 * ML / disk.system.volume_unit, 35 * ML / disk.system.volume_unit], quantity="volume")
    found, wanted = ([p.state.P for p in points if p.requested] for points in (points, expected))
    figure("volume control", "a syringe with a liquid, pressure", np.divide(found, wanted) - 1, 1e-12)


def test_an_endless_dead_volume_is_pressure_control(disk, drive, solved, figure):
    """With a litre of tubes to every micrometre of stroke, the stroke's share of the gas alone makes the pressure."""
    huge = Syringe(syringe=1e4, dead_volume=0.0)
    wanted = 0.8  # of the limit pressure, in about the disk's own units
    pressure = wanted * 3.2e3
    stroke = 1e4 * (1 - huge.ambient / (huge.ambient + pressure))
    _, points = drive([stroke / ML], huge)
    against = "pressure control"
    figure(against, "an endless dead volume, pressure", points[-1].state.P * disk.system.stress_unit / pressure - 1, 1.4e-7)
    _, expected, _ = solved(disk, [pressure / disk.system.stress_unit])
    figure(against, "an endless dead volume, volume", points[-1].state.V / expected[-1].state.V - 1, 1.4e-7)


@pytest.mark.parametrize("gas", sampled(["isothermal", "adiabatic"]))
def test_pistons_work_is_in_rubber_and_gas(disk, drive, gas, figure):
    syringe = Syringe(syringe=60 * ML, gas=gas)
    path, points = drive([45], syringe, largest_step=0.7 * ML / disk.system.volume_unit)
    S, P = np.array([(path.value(p.state), p.state.P) for p in points]).T
    slope = []
    for point in points:
        a, b = path.requested.slopes(point.state.V, point.state.P)
        slope.append(point.tangent.P / (a * point.tangent.V + b * point.tangent.P))
    work = CubicHermiteSpline(S, P, slope).integrate(0, S[-1]) * disk.system.stress_unit * disk.system.volume_unit
    disk.system.load(points[-1].state)
    rubber = disk.system.stored_energy() * disk.system.stress_unit * disk.system.volume_unit
    last, cavity = points[-1].state, path.history.V0 * disk.system.volume_unit
    gas_took = syringe.gas_energy(45 * ML, last.V * disk.system.volume_unit - cavity, last.P * disk.system.stress_unit, cavity)
    assert gas_took > 0.005 * rubber
    figure("work of a syringe's piston", "energy in rubber and gas", (rubber + gas_took) / work - 1, 4.5e-7)


def test_a_leak_lowers_the_pressure_by_the_mass_it_takes(disk, drive, figure):
    tight, leaking = Syringe(syringe=60 * ML), Syringe(syringe=60 * ML, leak=0.0005 / ML)
    _, points = drive([20], tight)
    path, lost = drive([20], leaking)
    assert lost[-1].state.P < points[-1].state.P and lost[-1].state.V < points[-1].state.V
    gas_now = (65 - 20) * ML + lost[-1].state.V * disk.system.volume_unit
    mass = (lost[-1].state.P * disk.system.stress_unit + leaking.ambient) * gas_now
    wanted = 0.99 * leaking.ambient * (65 * ML + path.history.V0 * disk.system.volume_unit)
    figure(LAW, "P V with a leak of 1 %", mass / wanted - 1, 1e-12)


def test_a_stroke_has_a_limit_point_where_the_gas_goes_on_by_itself(disk, solved, figure):
    """Twenty litres in the tubes: at the largest stroke of a path under volume the device jumps to where that comes again."""
    syringe = Syringe(syringe=2000 * ML, dead_volume=20000 * ML)
    supply = syringe.control(disk.system.rest().V * disk.system.volume_unit, disk.system.stress_unit, disk.system.volume_unit)
    path, points, end = solved(disk, [1000 * ML / disk.system.volume_unit], quantity=supply)
    assert end is not None and "grown 60-fold" in str(end)
    _, known, _ = solved(
        disk, [60 * ML / disk.system.volume_unit], "volume", "volume", largest_step=1 * ML / disk.system.volume_unit
    )
    V, P = np.array([(p.state.V * disk.system.volume_unit, p.state.P * disk.system.stress_unit) for p in known]).T
    gas = 22000 * ML + V[0]
    stroke = gas * (1 - syringe.ambient / (P + syringe.ambient)) + V - V[0]
    curve = CubicSpline(V, stroke)
    peak = max(curve(V) for V in curve.derivative().roots(extrapolate=False))
    against = "largest stroke of a path under volume"
    figure(against, "the stroke's limit point", path.value(end.limit.state) * disk.system.volume_unit / peak - 1, 2.5e-8)
    assert end.limit.tangent.P < 0  # the pressure's own limit lies before it
    landed = [point for point in points if point.jump]
    assert [path.value(point.state) * disk.system.volume_unit for point in landed] == pytest.approx([float(peak)], rel=1e-5)
    between = points[points.index(end.limit) + 1 : points.index(landed[0])]
    assert len(between) > 2 and landed[0].stable_under(supply.line(landed[0].state.V, landed[0].state.P))
    assert not any(point.stable_under(supply.line(point.state.V, point.state.P)) for point in between[:2])


# -- what a syringe holds: a thin balloon, half of which is meshed and stands for all --------------------------------

RUBBER, THICKNESS, RADIUS = NeoHookean(100e3, 0.5), 0.01, 0.010
"""Law, thickness over middle radius, and middle radius in m."""
MUCH_GAS = Syringe(syringe=200 * ML, dead_volume=8000 * ML)


@pytest.fixture(scope="module")
def balloon(equilibrium):
    inner, outer = RADIUS * (1 - THICKNESS / 2), RADIUS * (1 + THICKNESS / 2)
    return equilibrium(bodies.Sphere(inner=inner, outer=outer, through=1, along=16), RUBBER)


def supply_of(equations, syringe):
    cavity = equations.system.rest().V * equations.system.volume_unit
    return syringe.control(cavity, equations.system.stress_unit, equations.system.volume_unit)


def margin(syringe, stretch):
    """How much slower the thin balloon's pressure falls with its volume than the gas's does, over the gas's: > 0 holds."""
    h = 1e-5
    volume = 2 / 3 * np.pi * (stretch * RADIUS) ** 3
    rise = balloon_pressure(RUBBER, stretch + h, THICKNESS) - balloon_pressure(RUBBER, stretch - h, THICKNESS)
    rubber = rise / (2 * h) / (3 * volume / stretch)
    absolute = balloon_pressure(RUBBER, stretch, THICKNESS) + syringe.ambient
    gas = absolute**2 / (syringe.gas_at_rest(2 / 3 * np.pi * RADIUS**3) * syringe.ambient)  # -dP/dV at a fixed stroke
    return rubber / gas + 1


def test_a_syringe_holds_a_balloon_where_its_gas_is_stiff_enough(balloon, solved):
    """Past its limit point a balloon is held by little gas, and by much of it where its pressure falls slowly."""
    little, much = Syringe(syringe=200 * ML), MUCH_GAS
    V0 = balloon.system.rest().V
    _, points, end = solved(balloon, [40 * V0], quantity="volume", largest_step=V0)
    assert end is None
    held = {True: 0, False: 0}
    for point in points:
        V, P = point.state.V, point.state.P
        assert point.stable_under_volume and point.stable_under(supply_of(balloon, little).line(V, P))
        middle = (1 - THICKNESS / 2) ** -3  # what the wall's middle encloses at rest; the silicone between keeps its volume
        stretch = ((V / V0 - 1) / middle + 1) ** (1 / 3)
        if abs(expected := margin(much, stretch)) > 0.02:
            found = point.stable_under(supply_of(balloon, much).line(V, P))
            assert found == (expected > 0)
            held[found] += 1
    assert min(held.values()) > 5 and any(not p.stable_under_pressure for p in points)


def test_strokes_that_a_balloon_jumps_over_are_passed_and_told(balloon, solved):
    """Where the piston would have to go back, no state is held; every requested stroke is met before and after."""
    supply = supply_of(balloon, MUCH_GAS)
    strokes = [50 * ML / balloon.system.volume_unit, 180 * ML / balloon.system.volume_unit]
    path, points, end = solved(balloon, strokes, quantity=supply)
    assert end is None
    assert [path.value(p.state) for p in points if p.requested] == pytest.approx(strokes, rel=1e-9)
    for point in points:
        a, b = supply.slopes(point.state.V, point.state.P)
        forward = a * point.tangent.V + b * point.tangent.P > 0
        assert point.stable_under(supply.line(point.state.V, point.state.P)) == forward
    backward = np.diff([path.value(p.state) for p in points]) < 0
    assert backward.sum() > 2
    turn, landed = ([p for p in points if getattr(p, what)] for what in ("turn", "jump"))
    assert path.value(landed[0].state) == pytest.approx(path.value(turn[0].state), rel=1e-9)
    assert len(turn) == len(landed) == 1 and landed[0].state.V > 2 * turn[0].state.V


def test_slopes_are_those_of_the_stroke():
    curve = Stroke(rest=1.0, gas=5.0, ambient=3.0, power=1 / 1.4, leak=0.02)
    for V, P in ((1.0, 0.0), (2.0, 0.3), (3.0, -0.1)):
        a, b = curve.slopes(V, P)
        h = 1e-6
        assert a == pytest.approx((curve.value(V + h, P) - curve.value(V - h, P)) / (2 * h), rel=1e-8)
        assert b == pytest.approx((curve.value(V, P + h) - curve.value(V, P - h)) / (2 * h), rel=1e-8)
    assert curve.value(1.0, 0.0) == 0.0
    assert dataclasses.replace(curve, leak=0.0).curve(2.0).target == 2.0
