"""Inertia from the case file to the table: what is read, what is rejected, columns, notes and resumption."""

from __future__ import annotations

import json

import numpy as np
import pytest

import softmodels as sm
from softmodels.case.case import Case, CaseError
from softmodels.case.load import steps_of
from softmodels.cli.examples import CASES
from tests.support import runs

LAW = sm.NeoHookean(30e3, 0.5)
BALLOON = sm.Balloon(neck_radius=0.0, cell_size=5e-3, through=1)
CASE = """
name = "disk"
[geometry]
device = "Balloon"
neck_radius = "0 mm"
cell_size = "5 mm"
through = 1
[material]
law = "neo-hookean"
shear_modulus = "30 kPa"
poisson = 0.5
[load]
{load}
[solver]
time_tolerance = 1e-3
"""
LOAD = "cavity1.pressure_cm = [{}]\ntime_s = [{}]\n{}".format
WHOLE = LOAD("5, 5, 2, 2", "0, 0.004, 0.004, 0.008", "inertia = true")


@pytest.fixture
def run(tmp_path):
    def run(load, *options, case=CASE):
        (tmp_path / "disk.toml").write_text(case.format(load=load))
        words = ("-m", "softmodels", "run", tmp_path / "disk.toml", "--output", tmp_path / "out", "--pictures", "none")
        return runs.run(*words, *options)

    return run


def table(folder):
    rows = runs.rows(folder)
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def test_a_case_is_read_back_from_its_own_file():
    case = Case.from_toml(CASE.format(load=WHOLE))
    assert case.inertia and case.spectral_radius == 0.9 and Case.from_toml(case.to_toml()) == case
    case = Case("ball", BALLOON, LAW, steps=steps_of(pressure_cm=(5.0,), hold="10 ms"), inertia=True, spectral_radius=0.5)
    assert Case.from_toml(case.to_toml()) == case
    jump = Case.from_toml(CASES["jump.toml"])
    assert jump.inertia and jump.supply is not None and jump.remembers


@pytest.mark.campaign
def test_a_jump_of_the_pressure_and_a_resumed_run(run, tmp_path):
    """The pressure jumps to 5 cm and at 4 ms to 2 cm, where the balloon is; a run resumed at 4 ms gives the same numbers."""
    done = run(WHOLE)
    assert done.status == 0, done.err
    whole = table(tmp_path / "out")
    notes = " ".join(json.loads((tmp_path / "out" / "summary.json").read_text())["notes"])
    assert "1070 kg/m^3" in notes and "numerical damping" in notes and "they change nothing" not in notes
    assert "stable_under_pressure" not in whole and "lowest_eigenvalue_Pa_per_mm2" not in whole
    time, pressure, volume = (whole[name] for name in ("time_s", "pressure_cm", "added_volume_ml"))
    first = np.flatnonzero(time == 0.0)
    assert pressure[first] == pytest.approx([0.0, 5.0]) and not volume[first].any()
    second = np.flatnonzero(time == 0.004)
    assert pressure[second] == pytest.approx([5.0, 2.0]) and volume[second][0] == volume[second][1] > 0.0
    gained = whole["stored_energy_mJ"] + whole["kinetic_energy_mJ"]
    work = np.concatenate([[0.0], np.cumsum((whole["pressure_Pa"][1:] + whole["pressure_Pa"][:-1]) / 2 * np.diff(volume))])
    assert gained == pytest.approx(work * 1e-3, abs=2e-2 * whole["kinetic_energy_mJ"].max())
    for file in sorted((tmp_path / "out").iterdir()):
        file.unlink()
    assert run(LOAD("5, 5, 2", "0, 0.004, 0.004", "inertia = true")).status == 0
    done = run(WHOLE, "--resume")
    assert done.status == 0, done.err
    parts = table(tmp_path / "out")
    for name in ("time_s", "added_volume_ml", "kinetic_energy_mJ", "stored_energy_mJ"):
        assert parts[name] == pytest.approx(whole[name], rel=1e-6, abs=1e-8 * np.abs(whole[name]).max())


WRONG = {
    "pressure_cm = '0:5'\ninertia = true": "--inertia needs a load in time",
    "volume_ml = '0:5'\nrate = '1ml/s'\ninertia = true": "would need an infinite pressure",
    LOAD("5, 5", "0, 1", "inertia = 'maybe'"): "inertia",
}


@pytest.mark.parametrize(("load", "sentence"), WRONG.items())
def test_wrong_input_ends_with_status_2(load, sentence, run, tmp_path):
    done = run(load)
    assert done.status == 2 and sentence in done.err and "Traceback" not in done.err, done.err
    assert not (tmp_path / "out").exists()


def test_wrong_calls_are_told():
    load = {"pressures": ["1 kPa"] * 2, "times": [0, 1], "inertia": True}
    with pytest.raises(CaseError, match=r"spectral_radius is 1\.5; it must be from 0 to"):
        sm.inflate(BALLOON, LAW, spectral_radius=1.5, **load)
    with pytest.raises(CaseError, match="density is 0"):
        sm.inflate(BALLOON, LAW, components=sm.Gravity("-z", density=0.0), **load)
    with pytest.raises(CaseError, match="needs a load in time"):
        sm.inflate(BALLOON, LAW, pressures=["1 kPa"], inertia=True)
