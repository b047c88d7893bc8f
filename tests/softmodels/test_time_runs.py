"""Loads in time, from the case file to the table: what is read, what is rejected, and what a resumed run remembers."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import softmodels as sm
from softmodels.api.calls import case_of
from softmodels.case.case import Case, CaseError
from softmodels.case.load import steps_of
from softmodels.case.materials import MaterialErrors
from softmodels.common.units import HALF_WIDTH_95
from softmodels.materials.laws import FORM, MaterialError
from softmodels.mechanics.sensitivity import InTime, Sensitivity
from softmodels.path import schedule
from softmodels.path.steps import Prescribed, Step, courses, times_of
from softmodels.runs.simulation import Model, meshed
from tests.support import runs

THINNING = {"share": 0.1, "time": "30 s", "onset": 0.05, "least": 0.01, "growth": 2, "spring": [[0.8, 1], [0.2, -2]]}
LAW = sm.Yeoh(14e3, 60.0).with_memory(branches=[(0.2, "1 s"), THINNING], softening=(1.6, "2 kPa", 0.1, "8 h"))
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
[material.memory]
branches = [[0.2, "1 s"], {share = 0.1, time = "30 s", onset = 0.05, least = 0.01, growth = 2, spring = [[0.8, 1], [0.2, -2]]}]
softening = [1.6, "2 kPa", 0.1]
[load]
"""


@pytest.fixture
def run(tmp_path):
    def run(load, *options):
        (tmp_path / "disk.toml").write_text(CASE + load)
        words = ("-m", "softmodels", "run", tmp_path / "disk.toml", "--output", tmp_path / "out", "--pictures", "none")
        return runs.run(*words, *options)

    return run


def test_a_case_in_time_is_read_back_from_its_own_file():
    case = Case("disk", DISK, LAW, steps=steps_of(pressure_cm=(10.0, 25.0), rate="5cm/s", hold="10 s", cycles=2))
    assert case.timed and case.remembers and case.program
    again = Case.from_toml(case.to_toml())
    assert again == case and again.material.memory == LAW.memory
    (series,) = courses(case.steps)
    assert [value.number for value in series.values] == [0, 10, 25, 25, 0, 10, 25, 25, 0]
    assert times_of(case.steps) == pytest.approx((0, 2, 5, 15, 20, 22, 25, 35, 40), rel=1e-14)


@pytest.mark.parametrize(("rate", "speed"), [("1kPa/s", 1000 / 95.12), ("5 cm/s", 5.0), ("6 kPa/min", 100 / 95.12)])
def test_rates_have_units(rate, speed):
    case = Case("disk", DISK, LAW, steps=steps_of(pressure_cm=(20.0,), rate=rate))
    assert times_of(case.steps)[-1] == pytest.approx(20.0 / speed, rel=1e-3)


WRONG = {
    "branches = [[0.2, '-1 s']]": "relaxation time of a branch is -1 s; it must be above 0",
    "branches = [[14e3, '1 s']]": "share of a branch is 14000",
    "branches = [[0.2]]": "is no pair of share and time",
    "branches = [{share = 0.2, tau = 3}]": "branch has an unknown entry 'tau'",
    "branches = [{share = 0.2}]": "branch has no time; write {share = 0.2, time = '1 s'}",
    "branches = [{share = 0.2, time = '1 s', onset = 0}]": "onset of a branch is 0",
    "branches = [{share = 0.2, time = '1 s', least = 2}]": "least of a branch is 2",
    "branches = [{share = 0.2, time = '1 s', growth = -1}]": "growth of a branch is -1; it must not be negative",
    "branches = [{share = 0.2, time = '1 s', spring = 3}]": "spring 3 of a branch is none of pairs",
    "branches = [{share = 0.2, time = '1 s', spring = [[1, -2]]}]": "one above 0, such as",
    "branches = 3": "are no pairs of share and time",
    f"branches = {[[0.001, '1 s']] * 1000}": "the memory has 1000 branches; at most 20 are supported",
    "softening = [0.9, '2 kPa', 0.1]": "softening r is 0.9; it must be above 1",
    "softening = [1.6, '-2 kPa', 0.1]": "neither may be negative",
    "softening = [1.6]": "is not r, m, beta",
    "tau = 3": "memory has an unknown entry 'tau'",
    "": "the memory has neither branches nor softening",
}


@pytest.mark.parametrize(("memory", "sentence"), WRONG.items())
def test_a_wrong_memory_is_told_before_anything_is_solved(memory, sentence):
    text = Case("disk", DISK, sm.Yeoh(14e3), steps=steps_of(pressure_cm=(10.0,))).to_toml()
    text = text.replace("[load]", f"[material.memory]\n{memory}\n[load]")
    with pytest.raises(CaseError, match="yeoh: ") as told:
        Case.from_toml(text)
    assert sentence in str(told.value)


@pytest.mark.parametrize("tolerance", [1e-30, 0.0, 1.0])
def test_a_tolerance_that_no_step_meets_is_told_before_anything_is_solved(tolerance):
    with pytest.raises(CaseError, match=r"time_tolerance is .*; it must be 1e-08 or more and below 1"):
        Case("disk", DISK, LAW, steps=steps_of(pressure_cm=(10.0,)), time_tolerance=tolerance)


@pytest.mark.campaign
def test_a_long_hold_spends_what_a_short_one_does():
    """The silicone comes to rest within minutes; a step of the hold's twelfth would pass over all of it."""
    law = sm.Yeoh(14e3, 60.0).with_memory(branches=[(0.3, 1.0), (0.2, 100.0)])
    spent = [
        sm.inflate(DISK, law, "0,50 cm", hold=hold).path["dissipated_energy_mJ"][-1] for hold in ("1e4 s", "1e7 s", "1e10 s")
    ]
    assert spent[0] > 0.1
    assert spent[1:] == pytest.approx([spent[0]] * 2, rel=1e-3)


LOADS = {
    "pressure_cm = '0:25'\nrate = '5 mm'": "rate '5 mm' is none; write it like 1kPa/s or 5cm/s",
    "pressure_cm = '0:25'\nrate = '-5 cm/s'": "must be above 0",
    "pressure_cm = '0:25'\ncycles = 2": "--cycles needs the rate",
    "pressure_cm = '0:25'\nrate = '5cm/s'\ncycles = 2.5": "whole number",
    "pressure_cm = '0:25'\nhold = '-3 s'": "hold is -3 s; it must be 0 or more",
    "pressure_cm = '0:25'\nhold = '3 mm'": "hold",
    "cavity1.pressure_cm = [0, 10, 20]\ntime_s = [0, 5, 3]": "runs backwards",
    "cavity1.pressure_cm = [0, 10, 20]\ntime_s = [0, 5]": "2 values but",
    "cavity1.pressure_cm = [0, 10, 10]\ntime_s = [0, 5, 5]": "changes nothing",
    "time_s = [0, 5]": "needs a series",
}


@pytest.mark.parametrize(("load", "sentence"), LOADS.items())
def test_a_wrong_time_ends_with_status_2(load, sentence, run, tmp_path):
    done = run(load + "\n")
    assert done.status == 2 and sentence in done.err.replace("\n", " ") and "Traceback" not in done.err
    assert not (tmp_path / "out").exists()


def test_a_linear_branch_is_a_pair_and_weights_add_up_to_1():
    pair = sm.Yeoh(14e3).with_memory(branches=[{"share": 0.2, "time": 1}]).memory
    assert pair == sm.Yeoh(14e3).with_memory(branches=[(0.2, "1 s")]).memory
    assert pair.to_table()["branches"] == [[0.2, "1 s"]] and pair.branches[0].linear
    (spring,) = (one.spring for one in LAW.memory.branches if one.spring)
    kilopascals = [[8, 1], [2, -2]]
    assert sm.Yeoh(14e3).with_memory([{**THINNING, "spring": kilopascals}]).memory.branches[0].spring == spring
    assert LAW.with_memory(LAW.memory.branches, LAW.memory.softening).memory == LAW.memory


def test_wrong_calls_are_told():
    with pytest.raises(CaseError, match="2 values but 3 times"):
        sm.inflate(DISK, LAW, pressures=["1 kPa", "2 kPa"], times=[1, 2, 3])
    with pytest.raises(CaseError, match="one of these"):
        sm.inflate(DISK, LAW, times=[1, 2, 3])
    with pytest.raises(MaterialError, match="no pairs"):
        sm.Yeoh(14e3).with_memory(branches="1 s")
    with pytest.raises(MaterialError, match="with_memory"):
        dataclasses.replace(sm.Yeoh(14e3), memory=((0.2, 1.0),))


@pytest.mark.campaign
def test_a_cycle_creeps_softens_and_keeps_a_rest(run, tmp_path):
    done = run("pressure_cm = '0:25'\nrate = '5cm/s'\nhold = '10 s'\ncycles = 2\n")
    assert done.status == 0, done.err
    assert "  20 s" in done.err
    table = {name: np.array([row[name] for row in runs.rows(tmp_path / "out")]) for name in runs.rows(tmp_path / "out")[0]}
    time, rise, lost = table["time_s"], table["apex_mm"], table["dissipated_energy_mJ"]
    assert (np.diff(time) > 0).all() and time[-1] == 40.0 and (np.diff(lost) > 0).all()
    held = rise[(time >= 5) & (time <= 15)]
    assert (np.diff(held) > 0).all() and 0.02 < held[-1] / held[0] - 1 < 0.2
    asked = {t: rise[np.isclose(time, t)][0] for t in (5.0, 20.0, 25.0)}
    assert asked[25.0] > 1.02 * asked[5.0]  # softer than in the first cycle
    assert 0.02 < asked[20.0] / asked[5.0] < 0.2  # what is left after venting
    P, V = table["pressure_Pa"], table["added_volume_ml"] * 1e-3
    work = np.concatenate([[0.0], np.cumsum((P[1:] + P[:-1]) / 2 * np.diff(V))])
    assert table["stored_energy_mJ"] + lost == pytest.approx(work, abs=6e-3 * work.max())


def test_without_times_a_memory_does_not_act(run, tmp_path):
    """The path is that of the law alone, and a sentence says so."""
    done = run("pressure_cm = '0:25'\n")
    assert done.status == 0 and "the load has no times" in done.err.replace("\n", " ")
    elastic = sm.inflate(DISK, LAW.relaxed, pressures="0:25 cm")
    assert runs.rows(tmp_path / "out")[-1]["apex_mm"] == pytest.approx(elastic.path["apex_mm"][-1], rel=1e-12)


@pytest.mark.campaign
def test_a_resumed_run_remembers(run, tmp_path):
    """A program that is continued by another step: the states of one that was never interrupted."""
    pressures, times = [0, 25, 25, 5], [0, 5, 8, 9]
    load = "cavity1.pressure_cm = {}\ntime_s = {}\n".format
    assert run(load(pressures, times)).status == 0
    whole = runs.rows(tmp_path / "out")
    for file in sorted((tmp_path / "out").iterdir()):
        file.unlink()
    assert run(load(pressures[:3], times[:3])).status == 0
    assert run(load(pressures, times), "--resume").status == 0
    parts = runs.rows(tmp_path / "out")
    assert len(parts) == len(whole)
    for name in ("apex_mm", "time_s", "dissipated_energy_mJ", "max_von_mises_kPa"):
        there, here = ([row[name] for row in rows] for rows in (whole, parts))
        assert here == pytest.approx(there, rel=1e-6, abs=1e-9)


@pytest.mark.campaign
def test_a_held_pressure_is_lost_at_a_time(tmp_path):
    law, balloon = sm.NeoHookean(30e3, 0.5), sm.Balloon(neck_radius=0.0)
    limit = sm.limit(balloon, law).pressure
    creeping = law.with_memory(branches=[(0.5, "10 s")])
    run = sm.inflate(balloon, creeping, pressures=[1.1 * limit], hold="5 min", folder=tmp_path / "out")
    assert run.path["time_s"][-1] == pytest.approx(49.0, rel=0.02)
    assert "crept so far that the device has no equilibrium" in run.limit.why


@pytest.mark.campaign
def test_the_pressure_that_is_borne_for_a_time(figure):
    """A thin sphere with a branch of half its modulus: 1.1 and 1.2 times the relaxed limit for 4.9 and 2.162 times tau."""
    law, balloon = sm.NeoHookean(30e3, 0.5), sm.Balloon(neck_radius=0.0, wall="0.2 mm")
    creeping = law.with_memory(branches=[(0.5, "10 s")])
    relaxed = sm.limit(balloon, creeping)
    assert relaxed.pressure == sm.limit(balloon, law).pressure and not relaxed.held
    for seconds, over in ((49.0, 1.1), (21.62, 1.2)):
        found = sm.limit(balloon, creeping, hold=seconds)
        assert found.kind == "limit" and found.held == seconds and found.stretch > relaxed.stretch
        off = found.pressure / relaxed.pressure / over - 1
        figure("a thin sphere that creeps", f"pressure borne for {seconds:g} s", off, 3e-3)
    with pytest.raises(CaseError, match="has no memory"):
        sm.limit(balloon, law, hold=3)
    with pytest.raises(CaseError, match="0 or more"):
        sm.limit(balloon, creeping, hold="-3 s")


THIN = sm.Balloon(neck_radius=0.0, wall="0.2 mm")


def creeping(share=0.5, instant=10.0):
    return sm.Yeoh(15e3, 50.0, 0.0, 0.5).with_memory(branches=[(share, instant)])


def test_a_pressure_that_is_borne_for_a_time_has_a_budget():
    """A thin sphere bears in proportion to its wall and to all its moduli."""
    errors = MaterialErrors(("c1", "c2", FORM), ((300.0**2, 300.0, 0.0), (300.0, 1.0, 0.0), (0.0, 0.0, 0.01)))
    limit = sm.limit(THIN, creeping(), hold=21.6, band=errors, tolerance={"wall": "0.02 mm", "gauge": "1 %"})
    shares = {part.name: part.half / limit.pressure for part in limit.errors}
    assert list(shares) == ["law_form", "wall", "material", "gauge"]
    assert shares["wall"] == pytest.approx(0.1, rel=0.02) and shares["gauge"] == pytest.approx(0.01)
    assert shares["material"] == pytest.approx(HALF_WIDTH_95 * 0.02, rel=1e-6)  # both moduli by 2 %, as one


@pytest.mark.campaign
@pytest.mark.parametrize(("name", "own", "step"), [("share", "share1", 0.05), ("instant", "time1", 1.0)])
def test_the_budget_of_a_pressure_that_is_borne_by_differences(name, own, step):
    (part,) = sm.limit(THIN, creeping(), hold=21.6, band=MaterialErrors((own,), ((1.0,),))).errors
    value = {"share": 0.5, "instant": 10.0}[name]
    high, low = (sm.limit(THIN, creeping(**{name: value + way * step}), hold=21.6).pressure for way in (1.0, -1.0))
    assert part.half / HALF_WIDTH_95 == pytest.approx((high - low) / (2 * step), rel=0.05)


PULLED = sm.Balloon(wall="0.5 mm", cell_size="2 mm")


def test_what_silicone_remembers_changes_with_a_load(comm):
    """A balloon under a force, held at a pressure: the rate of its volume by the force left out what its branch remembers."""
    body, times = meshed(PULLED, comm), (Step((Prescribed("pressure", (100.0,)),), 20.0),)

    def held(newtons, of=()):
        pulled = case_of(PULLED, creeping(), components=[sm.Force("outer", "z", newtons)], pressures="0,1 kPa")
        model = Model.of(dataclasses.replace(pulled, steps=times), body)
        rest, preload = model.system.rest(), model.preload()
        model.solver.carried = in_time = InTime(Sensitivity(model.solver, aside=1e-6), of) if of else None
        model.system.potential.commit(rest.w, reset=True)
        applied = (Prescribed("pressure", (1000.0,), "cavity1"),)
        *_, (_, last) = schedule.follow(model.solver, (Step(applied, 0.0), Step(applied, 20.0)), preload=preload)
        volume, rates = last.state.V * model.system.volume_unit, in_time.last if in_time else {}
        model.release()
        return volume, rates

    by_force = held(0.3, ("force.amount",))[1]["force.amount"].V
    assert by_force == pytest.approx((held(0.31)[0] - held(0.29)[0]) / 0.02, rel=5e-3)


@pytest.mark.campaign
def test_the_budget_of_a_pressure_that_is_borne_under_a_force():
    """Moduli, pressures and forces change a state by their ratios only."""

    def borne(newtons, **how):
        return sm.limit(PULLED, creeping(), hold=21.6, components=[sm.Force("outer", "z", newtons)], **how)

    covariance = ((300.0**2, 300.0), (300.0, 1.0))
    limit = borne(0.3, band=MaterialErrors(("c1", "c2"), covariance))
    by_force = (borne(0.4).pressure - borne(0.2).pressure) / 0.2
    (part,) = limit.errors
    assert 0.3 * by_force < -0.03 * limit.pressure
    assert part.half / (HALF_WIDTH_95 * 0.02) == pytest.approx(limit.pressure - 0.3 * by_force, rel=0.01)


def test_the_command_tells_what_is_borne(tmp_path):
    (tmp_path / "memory.toml").write_text(
        '[material]\nlaw = "neo-hookean"\nshear_modulus = "30 kPa"\npoisson = 0.5\n'
        '[material.memory]\nbranches = [[0.5, "10 s"]]\n'
    )
    device = ("-m", "softmodels", "limit", "--device", "Balloon")
    words = (*device, "--cell-size", "8mm", "--material", tmp_path / "memory.toml", "--hold", "60s")
    done = runs.run(*words, "--output", tmp_path / "out")
    assert done.status == 0 and "is held for 60 s, and then" in done.out
    assert runs.run(*words, "--vary", "wall=2mm+-0.1mm").status == 2
    assert runs.run(*device, "--hold", "60s").status == 2
