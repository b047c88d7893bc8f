"""A supply in time, from the case file to the table: what is read, what is rejected, columns, notes and resumption."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

import softmodels as sm
from softmodels.case.case import Case, CaseError
from softmodels.case.load import steps_of
from softmodels.path.steps import StepError, courses, times_of
from softmodels.path.supply import SupplyError
from tests.support import runs

LAW = sm.Yeoh(14e3, 60.0)
DISK = sm.HollowDisk(section="axisymmetric")
CASE = """
name = "disk"
[geometry]
device = "HollowDisk"
section = "axisymmetric"
[material]
law = "yeoh"
c1 = "14 kPa"
c2 = "60 Pa"
[supply]
kind = "{kind}"
{supply}
[load]
{load}
"""
SUPPLY = "tube_length = '2 m'\ntube_bore = '0.7 mm'\nleak_conductance = '2e-5 l/(s*bar)'"
LOAD = "source_pressure_cm = [{}]\nvalve = [{}]\ntime_s = [{}]".format
WHOLE = ("25, 25, 25, 25", "1, 1, 0, 0", "0, 8, 8, 40")


@pytest.fixture
def run(tmp_path):
    def run(load, *options, supply=SUPPLY, kind="reservoir"):
        (tmp_path / "disk.toml").write_text(CASE.format(load=load, supply=supply, kind=kind))
        words = ("-m", "softmodels", "run", tmp_path / "disk.toml", "--output", tmp_path / "out", "--pictures", "none")
        return runs.run(*words, *options)

    return run


def table(folder):
    rows = runs.rows(folder)
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def test_a_case_is_read_back_from_its_own_file():
    case = Case(
        "disk",
        DISK,
        LAW,
        steps=steps_of(pressure_cm=(25.0,), rate="5cm/s", hold="10 s"),
        supply=sm.Reservoir(conductance=1e-9 / 3),
    )
    (source,) = courses(case.steps)
    assert source.quantity == "source_pressure" and [value.number for value in source.values] == [0, 25, 25]
    assert times_of(case.steps) == pytest.approx((0, 5, 15), rel=1e-14)
    assert Case.from_toml(case.to_toml()) == case
    text = CASE.format(load=LOAD(*WHOLE), supply=SUPPLY, kind="reservoir")
    case = Case.from_toml(text)
    assert Case.from_toml(case.to_toml()) == case
    assert case.supply.leak_conductance == pytest.approx(2e-13) and [one.name for one in courses(case.steps)] == [
        "source",
        "valve",
    ]
    pump = Case.from_toml(CASE.format(load="flow_ml_per_min = [6, 6, 0]\ntime_s = [0, 2, 3]", supply="", kind="reservoir"))
    assert Case.from_toml(pump.to_toml()) == pump


def test_a_device_is_filled_and_leaks(run, tmp_path):
    done = run(LOAD(*WHOLE))
    assert done.status == 0, done.err
    told = " ".join(json.loads((tmp_path / "out" / "summary.json").read_text())["notes"])
    assert "s to 90% of the source's 25 cm" in told and "with the valve closed the leak takes" in told
    path = table(tmp_path / "out")
    time, pressure, flow, gas = (path[name] for name in ("time_s", "pressure_cm", "flow_ml_per_min", "gas_ml"))
    filling, leaking = path["load_step"] <= 2.0, path["load_step"] >= 3.0
    assert (path["source_pressure_cm"] == 25.0).all() and (path["stable_under_supply"] == 1).all()
    assert (np.diff(pressure[filling]) > 0).all() and (np.diff(pressure[leaking]) < 0).all()
    assert pressure[filling][-1] > 0.98 * 25 and pressure[-1] < 0.7 * 25
    assert (np.diff(time) >= 0).all()
    assert (flow[filling] > 0).all() and (flow[leaking] == 0).all() and time[-1] == 40.0
    dead = 1.0 + np.pi / 4 * 0.07**2 * 200
    V = gas[0] - dead + path["added_volume_ml"]
    assert (path["pressure_Pa"] / 101325 + 1) * (V + dead) == pytest.approx(gas, rel=1e-9)
    assert "stroke_ml" not in path


@pytest.mark.campaign
def test_a_resumed_run_goes_on_with_the_same_gas(run, tmp_path):
    assert run(LOAD(*WHOLE)).status == 0
    whole = table(tmp_path / "out")
    for file in sorted((tmp_path / "out").iterdir()):
        file.unlink()
    assert run(LOAD("25, 25", "1, 1", "0, 8")).status == 0
    done = run(LOAD(*WHOLE), "--resume")
    assert done.status == 0, done.err
    parts = table(tmp_path / "out")
    for name in ("time_s", "pressure_cm", "gas_ml", "apex_mm"):
        assert parts[name] == pytest.approx(whole[name], rel=1e-6, abs=1e-9)


WRONG_SUPPLY = {
    "tube_length = '0 m'": "nothing resists the flow",
    "tube_bore = '-1 mm'": "tube_bore",
    "conductance = '1 mm'": "conductance",
    "conductance = '-1e-9 m^3/(s*Pa)'": "the conductance is -1e-09; it must be at least zero",
    "critical_ratio = 1.2": "critical pressure ratio is 1.2; it must be from 0 to 0.9",
    "leak_conductance = '1e-12 m^3/(s*Pa)'\nleak_length = '1 mm'": "describe the leak twice",
    "gas = 'liquid'": "gas is 'liquid'",
    "bore = '1 mm'": "'bore'",
    "ambient = '0 Pa'": "the ambient pressure is 0",
}
WRONG_LOAD = {
    "pressure_cm = '0:25'": "a reservoir needs its source in time",
    "source_pressure_cm = [0, 25]": "needs the times of its values",
    "source_pressure_cm = [0, -2000]\ntime_s = [0, 1]": "below absolute vacuum",
    "source_pressure_cm = ['x', 25]\ntime_s = [0, 1]": "is not a list of numbers",
    "source_pressure_cm = [0, 25]\ntime_s = [1, 0]": "runs backwards",
    "source_pressure_cm = [0, 25]\nvalve = [1, 2]\ntime_s = [0, 1]": "must be between 0 (closed) and 1 (open)",
    "valve = [1, 1]\ntime_s = [0, 1]": "needs one of source_pressure_cm",
    "flow_ml_per_min = [1, 1]\nvalve = [1, 1]\ntime_s = [0, 1]": "a valve belongs to a source of pressure",
    "source_pressure_cm = [0, 25]\ncavity1.pressure_cm = [0, 1]\ntime_s = [0, 1]": "leave out cavity1",
    "volume_ml = '0:2'\nrate = '1ml/s'": "supplies pressures, not added volumes",
    "stroke_ml = '0:2'": "a reservoir needs its source in time",
}


@pytest.mark.parametrize(("supply", "sentence"), WRONG_SUPPLY.items())
def test_a_wrong_supply_is_told(supply, sentence):
    with pytest.raises(CaseError) as told:
        Case.from_toml(CASE.format(load="source_pressure_cm = [0, 25]\ntime_s = [0, 1]", supply=supply, kind="reservoir"))
    assert sentence in str(told.value)


@pytest.mark.parametrize(("load", "sentence"), WRONG_LOAD.items())
def test_a_wrong_load_is_told(load, sentence):
    with pytest.raises(CaseError) as told:
        Case.from_toml(CASE.format(load=load, supply="", kind="reservoir"))
    assert sentence in str(told.value)


def test_wrong_input_ends_with_status_2(run, tmp_path):
    for load, options in (("pressure_cm = '0:25'", {}), (LOAD(*WHOLE), {"supply": "", "kind": "syringe"}),
                          (LOAD(*WHOLE), {"supply": "tube_length = '0 m'"})):  # fmt: skip
        done = run(load, **options)
        assert done.status == 2 and "Traceback" not in done.err, done.err
    assert not (tmp_path / "out").exists()


def test_wrong_calls_are_told():
    with pytest.raises(CaseError, match="valve belongs to a supply in time"):
        sm.inflate(DISK, LAW, pressures=["1 kPa", "1 kPa"], times=[0, 1], valve=[1, 0])
    with pytest.raises(CaseError, match="give times too"):
        sm.inflate(DISK, LAW, pressures=["1 kPa"], valve=[1], supply=sm.Reservoir())
    with pytest.raises(StepError, match="2 values but"):
        sm.inflate(DISK, LAW, pressures=["1 kPa"] * 2, times=[0, 1], valve=[1, 1, 1], supply=sm.Reservoir())
    with pytest.raises(SupplyError, match="nothing resists"):
        sm.Reservoir(tube_length=0.0)


def test_a_pump_delivers_its_rate():
    tight = sm.Reservoir(dead_volume="2 ml")
    steps = Case.from_toml(CASE.format(load="flow_ml_per_min = [3, 3]\ntime_s = [0, 6]", supply="", kind="reservoir")).steps
    path = sm.inflate(DISK, LAW, steps=steps, supply=tight).path
    assert path["gas_ml"] - path["gas_ml"][0] == pytest.approx(3.0 / 60 * path["time_s"], rel=1e-7)


@pytest.mark.campaign
def test_a_supply_and_a_memory_act_together():
    """Behind a tube that resists nothing the device creeps as under its source's pressure."""
    creeping = dataclasses.replace(LAW, c2=0.0).with_memory(branches=[(0.3, "2 s")])
    load = {"pressures": ["20 cm"] * 2, "times": [0.2, 6.0]}
    wide = sm.Reservoir(tube_length=0.1, tube_bore=3e-3)
    free, fed = (sm.inflate(DISK, creeping, supply=supply, **load).path for supply in (None, wide))
    wanted = np.interp(fed["time_s"], free["time_s"], free["apex_mm"])
    assert fed["apex_mm"] == pytest.approx(wanted, abs=5e-3 * wanted.max())
