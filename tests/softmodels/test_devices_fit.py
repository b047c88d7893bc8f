"""Fits of several devices of one cast: one material, each device its own bench, its own misfit and its own wrong rows."""

from __future__ import annotations

import dataclasses
import json
import tomllib

import numpy as np
import pytest
from click.testing import CliRunner

import softmodels as sm
from geometries import HollowDisk, Membrane
from softmodels.case.case import Case
from softmodels.case.load import steps_of
from softmodels.cli.material_commands import fit_material
from softmodels.fitting.outlines.device import MeasuredDevice
from softmodels.fitting.problem import LawChoice
from tests.support.simulated import SimulatedCamera, simulated_outlines

MODULUS = 20e3
CM = 98.0665
DEVICES = {
    "disk": HollowDisk(section="axisymmetric", cell_size=0.006, fillet=0.0, base_fillet=0.0),
    "membrane": Membrane(radius=0.02, thickness=1e-3, cell_size=0.002, section="axisymmetric", through=1),
}
READINGS = {"disk": (40, 80, 120), "membrane": (8, 12, 15, 18)}
AWAY = {
    "disk": {"leak": 0.03, "zero": 3e-5, "centre": 5e-4},
    "membrane": {"pressure_offset": 15.0, "scale": -0.004, "centre": -1e-3},
}
CASES = {
    name: Case(name, device, sm.NeoHookean(30e3, 0.5), steps=steps_of(pressure_cm=(1.0,))) for name, device in DEVICES.items()
}
QUICK = sm.FitOptions(profiles=False, silicone="any")


@pytest.fixture(scope="module")
def outlines(comm):
    """Return a function that gives simulated outlines of each device, with noise of a seed or without."""
    choice = LawChoice.from_text("neo-hookean", 0.5)
    models = {name: MeasuredDevice.of(device).model(choice, comm) for name, device in DEVICES.items()}

    def take(seed=None):
        rng = None if seed is None else np.random.default_rng(seed)
        return {
            name: simulated_outlines(
                models[name], {"shear_modulus": MODULUS}, np.array(READINGS[name]) * CM,
                SimulatedCamera(spacing=2e-4, bench=AWAY[name]), rng=rng,
            )
            for name in DEVICES
        }  # fmt: skip

    return take


def fit(taken, **how):
    pairs = [(CASES[name], own) for name, own in taken.items()]
    return sm.fit(pairs, material="neo-hookean", options=dataclasses.replace(QUICK, **how))


@pytest.mark.campaign
def test_one_material_and_the_bench_of_each_come_back(outlines):
    """Without noise and without priors, which pull towards a bench that does nothing wrong."""
    loose = {name: {"prior": None} for name in ("scale", "zero")}
    held = {name: {"start": value, "fixed": True} for name, value in (("pressure_scale", 0.0), ("membrane.leak", 0.0))}
    own = {"disk.leak": {"prior": None}, "membrane.pressure_offset": {"prior": None}}
    off = {"disk.pressure_offset": {"start": 0.0, "fixed": True}}
    found = fit(outlines(), changes={**loose, **held, **own, **off}).chosen
    assert found.fit.converged and not found.judgement.warnings
    assert found.fit.values["shear_modulus"] == pytest.approx(MODULUS, rel=1e-6)
    for device, bench in AWAY.items():
        for name in ("leak", "pressure_offset", "scale", "zero", "centre"):
            assert found.fit.values[f"{device}.{name}"] == pytest.approx(bench.get(name, 0.0), rel=1e-4, abs=1e-7), name


@pytest.mark.campaign
def test_each_device_has_its_misfit_and_narrows_the_interval(outlines):
    taken = outlines(3)
    both = fit(taken).chosen
    alone = [sm.fit(CASES[name], own, "neo-hookean", QUICK).chosen for name, own in taken.items()]
    assert [one.device for one in both.devices] == ["disk", "membrane"]
    priors = sum((both.fit.values[p.name] - p.prior.mean) ** 2 / p.prior.error**2 for p in both.fit.free if p.prior)
    assert sum(one.chi2 for one in both.devices) + priors == pytest.approx(both.fit.deviance, rel=1e-9)
    for mine, one in zip(both.devices, alone, strict=True):
        assert mine.count == one.devices[0].count and 0.8 * one.devices[0].chi2 < mine.chi2 < 2 * mine.count
        assert both.fit.error("shear_modulus") < one.fit.error("shear_modulus")
    low, high = both.interval("shear_modulus")
    assert low < MODULUS < high
    assert any(note.startswith("disk: corrected: the fit assumes the highest pressure") for note in both.judgement.notes)


@pytest.mark.campaign
def test_the_same_twice_is_worth_two(outlines):
    """Two parts with the same outlines: the values of one, the material's error smaller by the root of two."""
    own = outlines()["membrane"]
    one = sm.fit(CASES["membrane"], own, "neo-hookean", QUICK).chosen.fit
    two = sm.fit([(CASES["membrane"], own)] * 2, material="neo-hookean", options=QUICK).chosen.fit
    assert two.values["shear_modulus"] == pytest.approx(one.values["shear_modulus"], rel=1e-6)
    for device in ("membrane", "membrane-2"):
        assert two.values[f"{device}.zero"] == pytest.approx(one.values["zero"], rel=1e-3)
    assert one.dispersion == two.dispersion == 1.0
    assert two.error("shear_modulus") == pytest.approx(one.error("shear_modulus") / np.sqrt(2), rel=1e-3)


@pytest.mark.campaign
def test_a_wrong_row_of_one_device_is_named_with_it(outlines):
    taken = outlines(3)
    wrong = taken["membrane"]
    wrong[1] = dataclasses.replace(wrong[1], pressure=2 * wrong[1].pressure)
    found = fit(taken).chosen
    assert not found.sound
    assert "membrane/simulated 2 contradicts the others" in found.objections[0]
    assert "exclude them: --exclude membrane/simulated 2" in found.objections[0]
    assert fit(taken, exclude=("membrane/simulated 2",)).chosen.sound


def test_the_command_takes_cases_each_with_its_outlines(outlines, tmp_path):
    words = []
    for name, own in outlines(3).items():
        folder = tmp_path / name
        folder.mkdir()
        for number, one in enumerate(own):
            one.to_csv(folder / f"{number}.csv")
        file = tmp_path / f"{name}.toml"
        file.write_text(CASES[name].to_toml())
        words += [str(file), str(folder)]
    more = ["--material", "neo-hookean", "--no-profiles", "--silicone", "any", "--fix", "membrane.leak"]
    done = CliRunner().invoke(fit_material, [*words, *more, "-o", str(tmp_path / "fit")])
    assert done.exit_code == 0, done.output
    assert "disk: chi squared" in done.output and "membrane: chi squared" in done.output
    (law,) = json.loads((tmp_path / "fit" / "fit.json").read_text())["laws"]
    assert [one["name"] for one in law["devices"]] == ["disk", "membrane"]
    assert all(0.3 < one["chi2"] / one["values"] < 2.0 for one in law["devices"])
    fixed = {one["name"]: one["fixed"] for one in law["parameters"]}
    assert fixed["membrane.leak"] and not fixed["disk.leak"] and not fixed["membrane.zero"]
    fitted = tomllib.loads((tmp_path / "fit" / "fitted.toml").read_text())["fit"]
    low, high = fitted["intervals_95"]["shear_modulus"]
    assert low < MODULUS < high
    assert (tmp_path / "fit" / "photographs-neo-hookean.png").stat().st_size > 20_000
    refused = {
        "add its outlines": [*words, words[0]],
        "give the photograph's device too": [*words, "--exclude", "simulated 1"],
        "each of them also of one device": [*words, "--fix", "wedge.leak"],
        "fit either outlines or --heights": [*words, "--heights", "heights.csv"],
        "no bench or device parameter is called": [*words, "--free", "wall"],
    }
    for text, asked in refused.items():
        done = CliRunner().invoke(fit_material, [*asked, "-o", str(tmp_path / "none")])
        assert done.exit_code == 2 and text in done.output, done.output


@pytest.mark.parametrize(
    ("device", "outlines", "words"),
    [
        ([], (), "several devices are given as pairs"),
        ([DEVICES["disk"]], (), "several devices are given as pairs"),
        ([(DEVICES["disk"], "a"), (DEVICES["membrane"], "b")], "c", "leave out the argument outlines"),
        ([(DEVICES["disk"], "a"), ("membrane", "b")], (), "device is 'membrane'"),
    ],
)
def test_what_are_no_pairs(device, outlines, words):
    with pytest.raises((sm.FitError, TypeError, ValueError), match=words):
        sm.fit(device, outlines)
