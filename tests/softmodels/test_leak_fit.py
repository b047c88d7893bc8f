"""A leak fitted to falling pressures: against a run in time, intervals over many repeats, and bad input."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import softmodels as sm
from softmodels.fitting.problem import FitError

SUPPLY = sm.Reservoir(tube_length="0.5 m", tube_bore="1 mm", leak_conductance=2e-13)
CAVITY = 20e-6
TIMES = np.linspace(0.0, 120.0, 9)


def falling(conductance=0.0, start=2.5e3, times=TIMES, gas="isothermal", **leak):
    """Pressures of a rigid cavity from the ordinary differential equation of its gas."""
    supply = dataclasses.replace(SUPPLY, leak_conductance=conductance, gas=gas, **leak)
    power = {"isothermal": 1.0, "adiabatic": 1 / 1.4}[gas]

    def slope(t, y):
        ratio = 1.0 + y[0] / supply.ambient
        by_pressure = power * ratio ** (power - 1.0) / supply.ambient * (CAVITY + supply.dead)
        return [-supply.lost(y[0])[0] / supply.ambient / by_pressure]

    return solve_ivp(slope, times[[0, -1]], [start], t_eval=times, rtol=1e-11, atol=1e-9).y[0]


@pytest.mark.campaign
def test_the_leak_of_a_run_in_time(figure):
    """A disk behind a valve that closes: its cavity shrinks as the pressure falls, and so the leak lasts longer."""
    disk, law = sm.HollowDisk(section="axisymmetric", cell_size=6e-3), sm.Yeoh(14e3, 60.0)
    supply = dataclasses.replace(SUPPLY)
    run = sm.inflate(
        disk, law, pressures=["25 cm"] * 4, valve=[1, 1, 0, 0], times=[0, 8, 8, 60], supply=supply, time_tolerance=1e-6
    )
    curve = sm.inflate(disk, law, pressures=[f"{cm} cm" for cm in range(0, 27, 2)])
    volumes = np.column_stack([curve.path["pressure_Pa"], 1e-6 * curve.path["added_volume_ml"] + disk.cavity_volume])
    time, pressure = run.path["time_s"], run.path["pressure_Pa"]
    closed = time > 8.001
    found = sm.fit_leak(time[closed], pressure[closed], volumes, supply)
    figure("a disk that leaks, step by step in time", "leak fitted to its pressures", found.conductance / 2e-13 - 1, 6e-5)
    assert found.interval[0] < found.conductance < found.interval[1]


@pytest.mark.parametrize("gas", ["isothermal", "adiabatic"])
def test_without_noise_the_leak_comes_back(gas, figure):
    pressures = falling(2e-13, gas=gas)
    found = sm.fit_leak(TIMES, pressures, CAVITY, dataclasses.replace(SUPPLY, gas=gas))
    figure("ordinary differential equation of a leaking rigid cavity", "fitted leak", found.conductance / 2e-13 - 1, 1e-7)
    flow = SUPPLY.lost(pressures[0])[0] / SUPPLY.ambient
    assert found.flow[0] == pytest.approx(flow, rel=1e-5)
    assert repr(found).startswith(f"<Leak of {found.flow[0] * 60e6:.4g} ml/min at ")
    assert found.kind == "orifice" and found.bore == 0.0 and "a laminar leak is" in found.sentence
    assert found.supply == dataclasses.replace(SUPPLY, gas=gas, leak_conductance=found.conductance)


TUBE = {"leak_length": 0.02, "leak_bore": 1e-4}
"""A laminar leak."""


def test_a_laminar_leak_is_told_from_an_orifice_and_comes_back(figure):
    supply = dataclasses.replace(SUPPLY, leak_conductance=0.0, **TUBE)
    pressures = falling(**TUBE)
    found = sm.fit_leak(TIMES, pressures, CAVITY, supply)
    assert found.kind == "laminar" and found.conductance == 0.0 and "an orifice is" in found.sentence
    figure(
        "ordinary differential equation of a rigid cavity with a laminar leak",
        "its bore",
        found.bore / 1e-4 - 1,
        1e-7,
    )
    assert found.supply == dataclasses.replace(supply, leak_bore=found.bore)
    assert repr(found).endswith("laminar, bore 0.1 mm over a length of 20 mm>")
    truth, rng, held = supply.lost(pressures[0])[0] / supply.ambient, np.random.default_rng(9), []
    for _ in range(12):
        found = sm.fit_leak(TIMES, pressures + 5.0 * rng.standard_normal(len(TIMES)), CAVITY, supply, 5.0)
        assert found.kind == "laminar"
        held.append((found.flow[1] <= truth <= found.flow[2], found.interval[0] <= 1e-4 <= found.interval[1]))
    assert np.mean(held) >= 0.75


def test_where_the_kinds_are_not_told_apart_the_flow_s_interval_contains_both():
    """A short look at a laminar leak: its flow is inside, whichever kind is a little ahead."""
    times, tube = np.linspace(0.0, 50.0, 6), TUBE | {"leak_bore": 5e-5}
    supply = dataclasses.replace(SUPPLY, leak_conductance=0.0, **tube)
    pressures, rng, kinds = falling(times=times, **tube), np.random.default_rng(3), set()
    truth = supply.lost(pressures[0])[0] / supply.ambient
    for _ in range(8):
        found = sm.fit_leak(times, pressures + 5.0 * rng.standard_normal(len(times)), CAVITY, supply, 5.0)
        kinds.add(found.kind)
        assert "do not tell" in found.sentence and found.flow[1] < truth < found.flow[2]
    assert kinds == {"orifice", "laminar"}


@pytest.mark.campaign
@pytest.mark.parametrize("error", [5.0, None])
def test_intervals_hold_the_truth(error):
    pressures, rng = falling(2e-13), np.random.default_rng(4)
    held = []
    for _ in range(60):
        found = sm.fit_leak(TIMES, pressures + 5.0 * rng.standard_normal(len(TIMES)), CAVITY, SUPPLY, error)
        held.append(found.interval[0] <= 2e-13 <= found.interval[1])
    assert np.mean(held) >= 0.88


def test_a_tight_device_has_an_interval_from_nothing():
    rng = np.random.default_rng(2)
    tight = [sm.fit_leak(TIMES, 2.5e3 + 5.0 * rng.standard_normal(len(TIMES)), CAVITY, SUPPLY, 5.0) for _ in range(6)]
    most = dataclasses.replace(SUPPLY, leak_conductance=1e-14).lost(2.5e3)[0] / SUPPLY.ambient
    assert all(0.0 <= one.flow[1] < most and 0.0 < one.flow[2] < most for one in tight)
    assert all(one.interval[0] == 0.0 for one in tight if one.kind == "orifice" and one.conductance == 0.0)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"times": TIMES[:2], "pressures": [3e3, 2e3]}, "three readings"),
        ({"times": TIMES[::-1]}, "must rise"),
        ({"pressures": np.linspace(1e3, -1.0, 9)}, "must be above 0"),
        ({"cavity": [(2.5e3, 1e-5), (0.0, 1e-5)]}, "rising pressure"),
        ({"cavity": [(0.0, 1e-5), (2e3, 1.1e-5)]}, "give volumes over the whole range"),
        ({"error": -1.0}, "must be above 0"),
    ],
)
def test_bad_input_is_one_sentence(changed, said):
    given = {"times": TIMES, "pressures": falling(2e-13), "cavity": CAVITY, "supply": SUPPLY} | changed
    with pytest.raises(FitError, match=said):
        sm.fit_leak(**given)
