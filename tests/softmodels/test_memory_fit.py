"""Fits of a memory: tests with times, weights that hold the truth, softening beside relaxation, and what the command writes."""

from __future__ import annotations

import csv
import dataclasses
import functools
import json
import re
import tomllib

import matplotlib.image
import numpy as np
import pytest

from softmodels.__main__ import softmodels as whole_command
from softmodels.case.materials import material_from
from softmodels.cli import material_commands
from softmodels.fitting.curves import residuals as memory
from softmodels.fitting.curves.curve import EQUILIBRIUM_RATE, TensileCurve, TensileError, corners, loop, turns
from softmodels.fitting.curves.fit import fit_curves, fit_law_to_curves
from softmodels.fitting.curves.residuals import StressError, predicted, residuals_of, thinned
from softmodels.fitting.problem import FitError, FitOptions, LawChoice
from softmodels.materials.laws import Gent, Yeoh
from softmodels.materials.specimens import nominal_stress, stress_in_time
from tests.softmodels.test_specimens import by_equations
from tests.support.campaigns import sampled
from tests.support.tables import read_curve

LAW, SHARES, TAUS = Yeoh(8e3, 90.0, 0.5, 0.5), (0.3, 0.2, 0.15), (1.0, 10.0, 100.0)
PULL = (np.linspace(0.0, 40.0, 61), 1.0 + 1.5 * (1.0 - np.abs(np.linspace(-1.0, 1.0, 61))))
HOLD = (
    np.r_[np.linspace(0.0, 2.0, 9), 2.0 + np.geomspace(2.0, 150.0, 50)],
    np.r_[np.linspace(1.0, 2.5, 9), np.full(50, 2.5)],
)
TRUTH = {"c1": 8e3, "c2": 90.0, "c3": 0.5, "share_1s": 0.3, "share_10s": 0.2, "share_100s": 0.15}
SOFT = (2.0, 5e3, 0.1)
FAST = FitOptions(memory=True, profiles=False, gauge_error=0.0)


def zigzag(*corners, step=0.5):
    """Times and stretches through corners at one rate of 0.1 per s."""
    time = np.r_[0.0, np.cumsum(np.abs(np.diff(corners)) / 0.1)]
    fine = np.arange(0.0, time[-1] + step / 2, step)
    return fine, np.interp(fine, time, corners)


def curve(material, history, noise=0.0, seed=0, name="curve", mode="uniaxial"):
    time, stretch = history
    stress = stress_in_time(material, time, stretch, mode)[0]
    return TensileCurve(name, mode, stretch, stress + np.random.default_rng(seed).normal(0.0, noise, len(stretch)), time=time)


# ----------------------------------------------------------------------------------------------------------------------
# The truth.


@pytest.fixture(scope="module")
def exact():
    """A pull and return, and a hold, of the equations in time."""
    return [
        TensileCurve(name, "uniaxial", h[1], by_equations(LAW, SHARES, TAUS, *h, "uniaxial"), time=h[0])
        for name, h in (("pull", PULL), ("hold", HOLD))
    ]


@pytest.mark.campaign
@pytest.mark.parametrize("error", ["100Pa", "constant"])
def test_95_percent_intervals_hold_the_truth(exact, error):
    """200 repeats with noise of 100 Pa: of all intervals of law and weights 93 to 97 % hold it, of each one 90 to 99 %."""
    generator, choice, size = np.random.default_rng(1), LawChoice.from_text("yeoh"), StressError.from_text(error)
    spectrum = memory.spectrum(exact)
    assert {*choice.names, *spectrum.names} == set(TRUTH)
    held = []
    for _ in range(200):
        noisy = [dataclasses.replace(one, stress=one.stress + generator.normal(0.0, 100.0, len(one.stress))) for one in exact]
        sources, extra = residuals_of(noisy, choice, size, level=True, spectrum=spectrum)
        found = fit_law_to_curves(choice, sources, extra, errors="stated" if size.stated else "unknown")
        held.append([found.interval(name)[0] <= value <= found.interval(name)[1] for name, value in TRUTH.items()])
    shares = np.mean(held, axis=0)
    assert 0.93 <= shares.mean() <= 0.97 and shares.min() >= 0.9 and shares.max() <= 0.99


@pytest.mark.campaign
def test_a_rate_that_was_not_fitted_is_predicted():
    """Fitted to two rates and equilibrium, with relaxation times that the fit does not have (solve_ivp)."""

    def at(rate, name):
        time, stretch = np.linspace(0.0, 3.0 / rate, 81), PULL[1]
        stretch = 1.0 + 1.5 * (1.0 - np.abs(np.linspace(-1.0, 1.0, 81)))
        return TensileCurve(
            name, "uniaxial", stretch, by_equations(LAW, (0.4, 0.3), (2.5, 40.0), time, stretch, "uniaxial"), time=time
        )

    still = np.linspace(1.0, 2.5, 30)
    rest = TensileCurve("rest", "uniaxial", still, nominal_stress(LAW, still))
    report = fit_curves([at(0.2, "fast"), at(0.01, "slow"), rest], "yeoh", FAST)
    middle = at(0.05, "middle")
    off = predicted(report.material, middle) - middle.stress
    assert np.abs(off).max() < 0.02 * middle.stress.max()
    assert report.material.relaxed.shear_modulus_0 == pytest.approx(LAW.shear_modulus_0, rel=0.02)


def test_weights_that_are_not_there_are_zero_with_an_upper_end():
    report = fit_curves(
        [curve(LAW.with_memory([(0.3, 10.0)]), h, 100.0, k, f"c{k}") for k, h in enumerate((PULL, HOLD))], "yeoh", FAST
    )
    fitted = report.chosen
    assert report.chosen.sound and fitted.fit.values["share_10s"] == pytest.approx(0.3, abs=0.03)
    for name in ("share_1s", "share_100s"):
        low, high = fitted.interval(name)
        assert low <= 1e-9 and 0.0 < high < 0.05
    assert {branch.time for branch in fitted.material.memory.branches} <= {1.0, 10.0, 100.0}
    assert all(branch.share > 0.0 for branch in fitted.material.memory.branches)


@pytest.mark.parametrize("law", sampled(["gent", "ogden2", "neo-hookean"]))
@pytest.mark.parametrize("mode", sampled(["planar", "equibiaxial"]))
def test_any_law_and_test_returns_its_own_curves(law, mode):
    truth = {
        "gent": Gent(30e3, 60.0, 0.5),
        "ogden2": LawChoice.from_text("ogden2").material({"mu1": 20e3, "alpha1": 1.3, "mu2": 50.0, "alpha2": 5.0}),
        "neo-hookean": LawChoice.from_text("neo-hookean").material({"shear_modulus": 30e3}),
    }[law].with_memory([(0.3, 1.0), (0.2, 10.0)])
    report = fit_curves([curve(truth, PULL, name="pull", mode=mode), curve(truth, HOLD, name="hold", mode=mode)], law, FAST)
    for one in report.curves:
        assert np.abs(predicted(report.material, one) - one.stress).max() < 1e-3 * one.stress.max()


# ----------------------------------------------------------------------------------------------------------------------
# Softening.


SOFTENED = LAW.with_memory(list(zip(SHARES, TAUS, strict=True)), SOFT)
CYCLES = zigzag(1.0, 2.0, 1.0, 2.0, 1.0, 2.6, 1.0, 2.6, 1.0)


@pytest.mark.campaign
def test_softening_is_found_beside_relaxation():
    report = fit_curves([curve(SOFTENED, CYCLES, 50.0), curve(SOFTENED, HOLD, 50.0, 1, "hold")], "yeoh", FAST)
    found, fit = report.material.memory, report.chosen.fit
    for name, value in {"softening": 1 / SOFT[0], "softening_m": SOFT[1], "softening_beta": SOFT[2]}.items():
        low, high = fit.interval(name)
        middle, reach = (low + high) / 2, (high - low) / 2
        assert abs(value - middle) < 2 * reach and reach < 0.15 * value
    assert found.softening.r == pytest.approx(SOFT[0], rel=0.02)
    assert [branch.share for branch in found.branches] == pytest.approx(SHARES, abs=0.02)
    assert any("softens" in note for note in report.notes)


@pytest.mark.parametrize("seed", sampled(range(5), 2))
def test_relaxation_only_is_not_taken_for_softening(seed):
    relaxing = SOFTENED.relaxed.with_memory(SOFTENED.memory.branches)
    report = fit_curves([curve(relaxing, CYCLES, 100.0, seed)], "yeoh", FAST)
    assert report.material.memory.softening is None
    assert any("no softening" in note for note in report.notes)


def test_one_pull_and_return_cannot_show_softening():
    """Its loop is relaxation to the fit, which says so; a second loading or a hold on the way back could tell."""
    report = fit_curves([curve(SOFTENED, PULL, 20.0)], "yeoh", FAST)
    assert report.material.memory.softening is None
    assert any("only a second loading, or a hold after an unloading" in note for note in report.notes)

    def may(*histories):
        return memory.may_soften([TensileCurve("c", "uniaxial", h[1], h[1], time=h[0]) for h in histories])

    back = (np.arange(100.0), np.r_[np.linspace(1, 2, 31), np.linspace(2, 1.5, 20), np.full(49, 1.5)])
    assert not may(PULL, HOLD) and may(CYCLES) and may(PULL, back)
    assert not may((np.arange(110.0), np.r_[np.linspace(1, 2, 30), np.full(40, 2.0), np.linspace(2, 1, 40)]))


def test_pulls_at_one_rate_are_warned_of():
    up = (PULL[0][:31], PULL[1][:31])
    report = fit_curves([curve(LAW.with_memory([(0.3, 1.0)]), up, 50.0)], "yeoh", FAST)
    assert any("pulls at one rate" in text for text in report.chosen.warnings)
    faster = (up[0] / 3, up[1])
    rest = dataclasses.replace(curve(LAW, up), time=None)
    for more in (curve(LAW, faster), curve(LAW, HOLD), curve(LAW, PULL), rest):
        assert memory.separates([curve(LAW, up), more])
    assert not memory.separates([curve(LAW, up), curve(LAW, up)])


def test_growth_of_softening_needs_several_amplitudes():
    def several(history):
        return memory.several_amplitudes([TensileCurve("c", "uniaxial", history[1], history[1], time=history[0])])

    assert several(CYCLES) and not several(zigzag(1.0, 2.0, 1.0, 2.0, 1.0))


def test_slopes_of_the_residuals_by_taylors_rule():
    one = curve(SOFTENED, zigzag(1.0, 2.0, 1.0, 2.2))
    choice, spectrum = LawChoice.from_text("yeoh"), memory.spectrum([one])
    (source,), _ = residuals_of([one], choice, StressError.from_text("100Pa"), 0.03, spectrum=spectrum)
    source = dataclasses.replace(source, further=("softening", "softening_m", "softening_beta"))
    values = {**TRUTH, "gauge1": 1.02, "softening": 0.4, "softening_m": 4e3, "softening_beta": 0.2}
    values |= dict.fromkeys(set(source.parameters) - set(values), 0.1)
    base, slopes, _ = source.evaluate(values, True)
    for name, slope in zip(source.parameters, slopes.T, strict=True):
        rests = []
        for step in (2e-3, 1e-3):
            moved = source.evaluate({**values, name: (1 + step) * values[name]}, False)[0]
            rests.append(np.abs(moved - base - step * values[name] * slope).max())
        assert rests[0] < 1e-7 * np.abs(slope * values[name]).max() or rests[0] / rests[1] == pytest.approx(4.0, rel=0.05), name


# ----------------------------------------------------------------------------------------------------------------------
# Viscosity that depends on stress.


THINNING = LAW.with_memory([{"share": s, "time": t, "onset": 0.5, "exponent": 0.7} for s, t in ((0.5, 10), (0.3, 100))])


@pytest.mark.campaign
def test_viscosity_by_stress_is_fitted_where_it_is_asked_for():
    """Onset and exponent of pulls and a hold at two rates within their intervals; without them the misfit is far larger."""
    time, stretch = (values[::3] for values in PULL)
    histories = {"pull": (time, stretch), "slow": (10 * time, stretch), "hold": tuple(values[::2] for values in HOLD)}
    curves = [curve(THINNING, history, 50.0, k, name) for k, (name, history) in enumerate(histories.items())]
    asked = dataclasses.replace(FAST, changes={"share_1s": {"start": 0.0, "fixed": True}, "onset": {}})
    found, linear = (fit_curves(curves, "yeoh", options) for options in (asked, FAST))
    fit = found.chosen.fit
    for name, truth in {"onset": 0.5, "exponent": 0.7, "share_10s": 0.5, "share_100s": 0.3}.items():
        low, high = fit.interval(name)
        assert low <= truth <= high and high - low < 0.8 * truth, (name, low, high)
    assert {(one.onset, one.exponent) for one in found.material.memory.branches} == {
        (fit.values["onset"], fit.values["exponent"])
    }
    assert all(one.linear for one in linear.material.memory.branches)
    assert linear.chosen.fit.deviance > 3 * fit.deviance


def test_slopes_by_the_flow_are_those_of_the_stress():
    time, stretch = zigzag(1.0, 2.0, 1.2)
    names = ("onset", "exponent", "share1", "c1")
    _, slopes = stress_in_time(THINNING, time, stretch, parameters=names)

    def stress(**changes):
        branches = [dataclasses.replace(one, **changes) for one in THINNING.memory.branches]
        return stress_in_time(LAW.with_memory(branches), time, stretch)[0]

    for name, value, slope in zip(names, (0.5, 0.7), slopes.T, strict=False):
        coarse = (stress(**{name: 1.02 * value}) - stress(**{name: 0.98 * value})) / (0.04 * value)
        assert coarse == pytest.approx(slope, abs=2e-3 * np.abs(slope).max())


# ----------------------------------------------------------------------------------------------------------------------
# Reading tests with times.


def table(header, time, stretch, stress):
    rows = "".join(f"{t},{x:.9g},{y:.9g}\n" for t, x, y in zip(time, stretch, stress, strict=True))
    return f"{header}\n{rows}"


T, X = zigzag(1.0, 2.0, 1.0)
Y = 20e3 * (X - X**-2)


@pytest.mark.parametrize(
    ("header", "times"),
    [
        ("time (s),stretch,stress (Pa)", T),
        ("t,stretch,stress (Pa)", T),
        ("Test Time [min],stretch,stress (Pa)", T / 60),
        ("elapsed_time_ms,stretch,stress (Pa)", 1e3 * T),
        ("Time,stretch,stress (Pa)", [f"0:{int(t // 60):02d}:{t % 60:04.1f}" for t in T]),
        ("Time,stretch,stress\nms,-,Pa", 1e3 * T),
        (
            "Time,stretch,stress (Pa)",
            [f"2026-11-25 23:59:{t + 50:04.1f}" if t < 10 else f"2026-11-26 00:00:{t - 10:04.1f}" for t in T],
        ),
    ],
)
def test_a_column_of_times_is_recognised(tmp_path, header, times):
    (tmp_path / "c.csv").write_text(table(header, times, X, Y))
    found = read_curve(tmp_path / "c.csv", history=True)
    assert found.time == pytest.approx(T) and found.stretch == pytest.approx(X) and found.stress == pytest.approx(Y, rel=1e-6)
    ramp = read_curve(tmp_path / "c.csv")
    assert ramp.time is None and len(ramp.stretch) == 21 and "stretched at 0.1 /s" in "; ".join(ramp.remarks)


def test_the_total_time_goes_before_that_of_a_cycle(tmp_path):
    rows = "".join(f"{t % 3},{t},{x},{y}\n" for t, x, y in zip(T, X, Y, strict=True))
    (tmp_path / "c.csv").write_text(f"Cycle Time (s),Total Time (s),stretch,stress (Pa)\n{rows}")
    assert read_curve(tmp_path / "c.csv", history=True).time == pytest.approx(T)
    told = read_curve(tmp_path / "c.csv", columns="time=2[min],stretch=3,stress=4[Pa]", history=True)
    assert told.time == pytest.approx(60 * T)


@pytest.mark.parametrize(
    ("times", "why"),
    [
        (np.r_[T[:-1], 0.0], "the time falls to 0.0"),
        ([*T[:-1], "noon"], "'noon' in the column 'time (s)' is no time"),
        ([*T[:-1], "2026-13-45 10:00:00"], "is no time"),
    ],
)
def test_times_that_cannot_be_used_matter_only_to_a_memory(tmp_path, times, why):
    (tmp_path / "c.csv").write_text(table("time (s),stretch,stress (Pa)", times, X, Y))
    assert len(read_curve(tmp_path / "c.csv").stretch) == 21
    with pytest.raises(TensileError, match=re.escape(why)):
        read_curve(tmp_path / "c.csv", history=True)


def test_a_rate_stands_in_for_times(tmp_path):
    (tmp_path / "c.csv").write_text("stretch,stress (Pa)\n" + "".join(f"{x},{y}\n" for x, y in zip(X, Y, strict=True)))
    with pytest.raises(TensileError, match=r"no column of times.*c.csv:uniaxial:0.05/s.*equilibrium"):
        read_curve(tmp_path / "c.csv", history=True)
    assert read_curve(tmp_path / "c.csv", history=True, rate=0.1).time == pytest.approx(T)
    assert read_curve(tmp_path / "c.csv", history=True, rate=EQUILIBRIUM_RATE).time is None
    with pytest.raises(TensileError, match="a fit of the memory needs a test with times"):
        fit_curves([read_curve(tmp_path / "c.csv")], "yeoh", FAST)


def test_a_break_ends_a_history_and_a_relaxation_does_not(tmp_path):
    broken = np.where(np.arange(len(T)) > 15, 10.0, Y)
    (tmp_path / "b.csv").write_text(table("time (s),stretch,stress (Pa)", T[:21], X[:21], broken[:21]))
    found = read_curve(tmp_path / "b.csv", history=True)
    assert len(found.stretch) == 16 and "after the break" in found.remarks[-1]
    held = np.r_[Y[:21], np.linspace(Y[20], 0.1 * Y[20], 20)]
    (tmp_path / "h.csv").write_text(table("time (s),stretch,stress (Pa)", T, np.r_[X[:21], np.full(20, 2.0)], held))
    assert len(read_curve(tmp_path / "h.csv", history=True).stretch) == 41


def test_corners_turns_and_loops():
    time, stretch = zigzag(1.0, 2.0, 1.5, 2.5, 1.0, step=0.05)
    noisy = stretch + np.random.default_rng(0).normal(0.0, 1e-4, len(stretch))
    assert time[corners(time, noisy)] == pytest.approx([0.0, 10.0, 15.0, 25.0, 40.0], abs=0.11)
    assert time[turns(noisy)] == pytest.approx([0.0, 10.0, 15.0, 25.0, 40.0], abs=0.11)
    assert len(corners(time, stretch + np.random.default_rng(0).normal(0.0, 0.1, len(stretch)))) <= 401
    assert loop(X, Y) < 1e-9 and loop(X[:20], Y[:20]) == 0.0
    assert loop(X, np.r_[Y[:21], 0.7 * Y[21:]]) == pytest.approx(0.3, abs=0.02)


@pytest.mark.campaign
def test_ten_thousand_readings_give_the_weights_of_a_hundred():
    dense = (
        np.linspace(0.0, 150.0, 12001),
        np.interp(np.linspace(0.0, 150.0, 12001), [0, 15, 30, 31, 150], [1, 2.5, 1, 2, 2]),
    )
    material = LAW.with_memory(list(zip(SHARES, TAUS, strict=True)))
    whole = curve(material, dense, 100.0)
    few = thinned(whole)
    assert len(few.stretch) < 500 and "12001 readings" in few.remarks[-1]
    found = fit_curves([whole], "yeoh", FAST).chosen.fit.values
    for name, value in TRUTH.items():
        if name.startswith("share"):
            assert found[name] == pytest.approx(value, abs=0.01), name


@pytest.mark.campaign
def test_the_relaxation_times_are_what_the_data_can_show():
    slow = curve(LAW, (100.0 * PULL[0], PULL[1]))
    assert memory.spectrum([slow]).times == (100.0, 1000.0)
    assert memory.spectrum([slow, curve(LAW, PULL)]).times == (1.0, 10.0, 100.0, 1000.0)
    dense = curve(LAW, (np.linspace(0.0, 40.0, 4001), np.interp(np.linspace(0.0, 40.0, 4001), *PULL)))
    fine = memory.spectrum([dense])
    assert fine.times[0] >= 0.1 and "no test is fast enough" in fine.sentence and fine.times[-1] == 10.0
    few = np.linspace(1.0, 1.5, 10)
    crawling = TensileCurve("c", "uniaxial", few, nominal_stress(LAW, few), time=np.linspace(0.0, 2e7, 10))
    assert memory.spectrum([crawling]).times == (1e7,)


# ----------------------------------------------------------------------------------------------------------------------
# The command.


@pytest.fixture
def says(tmp_path, monkeypatch, ended):
    """Run a command beside a cyclic test and a curve at equilibrium."""
    one = curve(SOFTENED, CYCLES, 50.0)
    (tmp_path / "cycles.csv").write_text(table("time (s),stretch,stress (kPa)", one.time, one.stretch, one.stress / 1e3))
    still = np.linspace(1.0, 2.6, 30)
    rows = "".join(f"{x},{y}\n" for x, y in zip(still, nominal_stress(LAW, still), strict=True))
    (tmp_path / "rest.csv").write_text(f"stretch,stress (Pa)\n{rows}")
    pull = curve(SOFTENED, PULL)
    (tmp_path / "pull.csv").write_text(table("t,stretch,stress (Pa)", pull.time, pull.stretch, pull.stress))
    monkeypatch.chdir(tmp_path)
    return functools.partial(ended, whole_command)


def test_the_command_writes_a_material_with_its_memory(says, tmp_path):
    status, said, _ = says(
        "fit", "--tensile", "cycles.csv", "--tensile", "rest.csv:equilibrium", "--memory", "--no-profiles", "-o", "out"
    )
    assert (
        status == 0 and "share_1s" in said and "do not see the decades below" in said and "loop of the first unloading" in said
    )
    tables = tomllib.loads((tmp_path / "out" / "fitted.toml").read_text())
    assert tables["material"]["memory"]["branches"][0][1] == "1 s" and len(tables["material"]["memory"]["softening"]) == 3
    assert {"share_1s", "softening"} <= set(tables["fit"]["intervals_95"])
    material = material_from("out/fitted.toml", {})
    assert [branch.time for branch in material.memory.branches] == [1.0, 10.0, 100.0]
    with (tmp_path / "out" / "curves.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {row["time_s"] == "" for row in rows if row["curve"] == "rest.csv"} == {True}
    loops = [row for row in rows if row["curve"] == "cycles.csv"]
    assert float(loops[-1]["time_s"]) == pytest.approx(CYCLES[0][-1])
    off = np.array([float(row["yeoh_Pa"]) - float(row["measured_Pa"]) for row in loops])
    assert np.sqrt(np.mean(off**2)) < 1e3
    picture = matplotlib.image.imread(tmp_path / "out" / "curves.png")
    assert picture.shape[0] > 1000 and "relaxation times" in (tmp_path / "out" / "report.html").read_text()
    free = json.loads((tmp_path / "out" / "fit.json").read_text())["laws"][0]["free"]
    assert "share_10s" in free


def test_without_memory_a_loop_is_a_warning(says):
    status, said, _ = says("fit", "--tensile", "cycles.csv", "--no-profiles", "-o", "out")
    assert status == 0 and "stretched at 0.1 /s" in said
    assert re.search(r"warning: cycles.csv unloads below its loading: the loop is \d\d % of the work.*--memory", said)


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["--tensile", "rest.csv", "--memory"], "rest.csv:uniaxial:equilibrium"),
        (["--tensile", "rest.csv:uniaxial:50mm/min", "--memory"], "--gauge-length"),
        (["--tensile", "rest.csv:5kPa/s", "--memory"], "write 0.05/s"),
        (["--tensile", "rest.csv:0/s", "--memory"], "above zero"),
        (["--tensile", "rest.csv:-5mm/min", "--gauge-length", "10mm", "--memory"], "above zero"),
        (["--tensile", "cycles.csv", "--memory", "--stretch", "1:2"], "cannot be cut out of a test with times"),
        (["--tensile", "cycles.csv", "--memory", "--fix", "share_7s=0"], "share_1s, share_10s"),
        (["--tensile", "cycles.csv", "--fix", "share_1s=0"], "no parameter 'share_1s'"),
        (["--tensile", "pull.csv", "--memory", "--fix", "softening=0.5"], "no test has a second loading"),
        (["--tensile", "pull.csv", "--fix", "onset=0.5"], "no parameter 'onset'"),
    ],
)
def test_input_that_makes_no_memory_is_one_sentence(says, words, why):
    status, _, complaint = says("fit", *words, "--no-profiles", "--no-pictures")
    assert status == 2 and why in complaint and len(complaint.strip().splitlines()) <= 2


@pytest.mark.parametrize(
    ("text", "test", "rate"),
    [
        ("a.csv:0.05/s", "uniaxial", 0.05),
        ("a.csv:planar:5%/s", "planar", 0.05),
        ("a.csv:3/min", "uniaxial", 0.05),
        ("a.csv:ps:30mm/min", "ps", 0.05),
        ("a.csv:equilibrium:planar", "planar", EQUILIBRIUM_RATE),
        ("a.csv:balloon", "balloon", None),
        ("a.csv", "uniaxial", None),
    ],
)
def test_a_file_its_test_and_its_rate(text, test, rate):
    file, found, pace = material_commands.parts(text)
    assert (file.name, found) == ("a.csv", test)
    assert material_commands.rate_of(pace, 0.01) == (rate if rate is None else pytest.approx(rate))


def test_a_speed_and_a_fixed_weight_are_taken(says, tmp_path):
    words = ["--tensile", "cycles.csv:uniaxial:60mm/min", "--gauge-length", "10mm", "--memory", "--fix", "share_1s=0.3"]
    status, said, _ = says("fit", *words, "--no-profiles", "--no-pictures", "-o", "out")
    assert status == 0 and re.search(r"share_1s +0.3 +95 %: fixed", said)


def test_a_score_follows_a_memory_through_a_test_that_was_not_fitted(says, tmp_path):
    """With the true material the misfit is the noise; the law of equilibrium misses by its loop."""
    branches = ", ".join(f"[{share}, '{time} s']" for share, time in zip(SHARES, TAUS, strict=True))
    law = "law = 'yeoh'\nc1 = '8 kPa'\nc2 = '90 Pa'\nc3 = '0.5 Pa'\npoisson = 0.5\n"
    (tmp_path / "soft.toml").write_text(
        f"[material]\n{law}[material.memory]\nbranches = [{branches}]\nsoftening = [2, '5 kPa', 0.1]\n"
    )
    (tmp_path / "plain.toml").write_text(f"[material]\n{law}")
    words = ["--material", "soft.toml", "--material", "plain.toml", "--tensile", "cycles.csv", "--stress-error", "50Pa"]
    status, said, _ = says("score", *words, "-o", "scores")
    assert status == 0 and re.search(r"at stretch \S+, \S+ s", said)
    with (tmp_path / "scores" / "scores.csv").open() as file:
        chi2 = {row["material"]: float(row["chi2_per_value"]) for row in csv.DictReader(file)}
    assert chi2["soft.toml"] == pytest.approx(1.0, abs=0.2) and chi2["plain.toml"] > 1000.0
    assert says("score", *words[:2], "--tensile", "rest.csv")[0] == 2


def test_a_change_of_an_unknown_weight_is_refused():
    with pytest.raises(FitError, match="share_5s"):
        fit_curves([curve(LAW, PULL)], "yeoh", dataclasses.replace(FAST, changes={"share_5s": {"start": 0.0, "fixed": True}}))
