"""Fits of a memory to free vibrations: roots of recorded signals, exact derivatives, intervals that hold the truth."""

from __future__ import annotations

import csv
import math

import numpy as np
import pytest
import scipy.linalg

import softmodels as sm
from softmodels.case import load
from softmodels.case.case import Case
from softmodels.cli import material_commands
from softmodels.common.columns import TensileError
from softmodels.fitting import vibration
from softmodels.fitting.curves import oscillation, residuals
from softmodels.fitting.curves.curve import TensileCurve
from softmodels.fitting.curves.fit import fit_curves
from softmodels.fitting.problem import FitError, FitOptions, LawChoice
from softmodels.materials.specimens import nominal_stress

MODULUS, SHARES, TIMES = 30e3, (0.3, 0.2), (15e-3, 0.25)
TRUTH = {"shear_modulus": MODULUS, "share1": 0.3, "share2": 0.2, "time1": 15e-3, "time2": 0.25}


def written_case(path, length):
    beam = sm.Beam(length=length, width=0.005, thickness=0.005, cell_size=0.005, clamp="slip")
    case = Case("beam", beam, sm.NeoHookean(25e3, 0.5), load.steps_of(share="0:1"), components=(sm.Gravity("-z"),))
    path.write_text(case.to_toml(), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def stiffnesses(tmp_path_factory):
    """Stiffness matrices of beams of four lengths, see `vibration.stiffness_of`."""
    folder = tmp_path_factory.mktemp("beams")
    cases = [written_case(folder / f"beam{i}.toml", length) for i, length in enumerate((0.025, 0.05, 0.1, 0.2))]
    return [vibration.stiffness_of(Case.from_file(case), 0.5)[:2] for case in cases]


def released(relaxed, creeping, periods=8, count=320):
    """Times and displacements of a beam that is released from its relaxed first mode, with two branches as dashpots that creep
    after it: x'' + mu K x + mu C sum g (x - v) = 0 and tau v' = x - v, by exponentials of its matrix."""
    n, unit, zero = len(relaxed), np.eye(len(relaxed)), np.zeros_like(relaxed)
    pull = MODULUS * (relaxed + sum(SHARES) * creeping)
    rows = [[zero, unit, zero, zero], [-pull, zero, *(MODULUS * share * creeping for share in SHARES)]]
    rows += [[unit / time, zero, *(-unit / time if k == j else zero for j in range(2))] for k, time in enumerate(TIMES)]
    turn = math.sqrt(MODULUS * relaxed[0, 0] * 1.2)
    time = np.linspace(0.0, periods * 2 * math.pi / turn, count)
    step = scipy.linalg.expm(np.block(rows) * time[1])
    state = np.zeros(4 * n)
    state[[0, 2 * n, 3 * n]] = 1.0
    states = [state]
    for _ in time[1:]:
        states.append(step @ states[-1])
    return time, np.array(states)[:, 0]


@pytest.fixture(scope="module")
def signals(stiffnesses):
    return [released(*pair) for pair in stiffnesses]


def vibrations(stiffnesses, signals, noise=0.0, generator=None):
    made = []
    for i, ((relaxed, creeping), (time, values)) in enumerate(zip(stiffnesses, signals, strict=True)):
        scattered = values + (generator.normal(0.0, noise, len(values)) if generator else 0.0)
        made.append(vibration.Vibration(f"beam{i}", *vibration.root_of(time, scattered), relaxed, creeping))
    return made


def test_the_signals_have_the_roots_of_their_modes(stiffnesses, signals):
    for test in vibrations(stiffnesses, signals):
        wanted = test.root_of(MODULUS, SHARES, TIMES)
        assert abs(test.root - wanted) < 1e-4 * abs(wanted)
        assert test.predicted(sm.NeoHookean(MODULUS, 0.5).with_memory(branches=list(zip(SHARES, TIMES, strict=True))))[
            "frequency"
        ][0] == pytest.approx(wanted.imag / (2 * math.pi))


def test_the_modes_are_those_of_the_command(stiffnesses):
    """`Model.modes` of the same beam with the branches."""
    beam = sm.Beam(length=0.05, width=0.005, thickness=0.005, cell_size=0.005, clamp="slip")
    law = sm.NeoHookean(MODULUS, 0.5).with_memory(branches=list(zip(SHARES, TIMES, strict=True)))
    mode = sm.Model(beam, law).modes(count=1)[0]
    test = vibration.Vibration("beam", 1j, (1.0, 1.0), *stiffnesses[1])
    assert test.root_of(MODULUS, SHARES, TIMES) == pytest.approx(mode.root, rel=1e-6)


@pytest.mark.parametrize("fitted", [True, False])
def test_slopes_by_taylors_rule(stiffnesses, fitted):
    spectrum = residuals.Spectrum(TIMES, (1e-3, 1.0), ("", ""), fitted)
    test = vibration.Vibration("beam", -3.0 + 20j, (0.1, 0.2), *stiffnesses[1])
    error = residuals.StressError.from_text("auto")
    (source,) = oscillation.residuals_of([test], LawChoice.from_text("gent"), error, 0.03, spectrum).sources
    values = {"shear_modulus": 31e3, "limit": 40.0, **TRUTH, "share_0.015s": 0.3, "share_0.25s": 0.2, "gauge1": 1.02}
    _, J, _ = source.evaluate(values, True)
    for name, slope in zip(source.parameters, J.T, strict=True):
        ends = [source.evaluate({**values, name: values[name] * (1 + step)}, False)[0] for step in (1e-5, -1e-5)]
        assert (ends[0] - ends[1]) / (2e-5 * values[name]) == pytest.approx(slope, rel=1e-5, abs=1e-7)


@pytest.mark.campaign
def test_95_percent_intervals_hold_shares_and_times(stiffnesses, signals):
    """Four beams, each recorded once with noise of 1 % of its amplitude, and a strip at equilibrium."""
    generator, held, law = np.random.default_rng(5), [], sm.NeoHookean(MODULUS, 0.5)
    how = FitOptions(memory=True, branches=2, profiles=False, gauge_error=0.0, stress_error="100Pa")
    stretch = np.linspace(1.0, 1.8, 40)
    for _ in range(60):
        stress = nominal_stress(law, stretch) + generator.normal(0.0, 100.0, len(stretch))
        strip = TensileCurve("strip", "uniaxial", stretch, stress)
        fit = fit_curves([strip, *vibrations(stiffnesses, signals, 0.01, generator)], "neo-hookean", how).chosen.fit
        held.append([fit.interval(name)[0] <= value <= fit.interval(name)[1] for name, value in TRUTH.items()])
    shares = np.mean(held, axis=0)
    assert 0.92 <= shares.mean() <= 0.98 and shares.min() >= 0.88


# ----------------------------------------------------------------------------------------------------------------------
# Signals that do not ring, and the command.


def test_signals_that_are_refused():
    time = np.linspace(0.0, 1.0, 200)
    for values, why in (
        (np.exp(-3 * time), "no vibration of 3 periods"),
        (np.sin(2 * math.pi * 80 * time), "no vibration of 3 periods"),
        (np.sin(2 * math.pi * 8 * time), "does not decay"),
    ):
        with pytest.raises(TensileError, match=why):
            vibration.root_of(time, values)
    with pytest.raises(TensileError, match="times that rise"):
        vibration.root_of(time[::-1], time)


def test_a_decay_with_an_offset_and_noise_gives_its_root():
    time, generator = np.linspace(0.0, 4.0, 900), np.random.default_rng(2)
    values = 7.0 + np.exp(-0.8 * time) * np.cos(12.0 * time) + 0.1 * np.exp(-time) + generator.normal(0.0, 0.01, len(time))
    root, errors = vibration.root_of(time, values)
    assert abs(root.real + 0.8) < 3 * errors[0] < 0.1 and abs(root.imag - 12.0) < 3 * errors[1] < 0.1


def test_the_command_fits_a_decay_beside_a_strip(ended, tmp_path, signals):
    written_case(tmp_path / "beam.toml", 0.05)
    tables = {"decay.csv": ("Time (s)", "Acceleration (g)", signals[1]), "strip.csv": ("strain (%)", "stress (kPa)", None)}
    strain = np.linspace(0.0, 80.0, 40)
    stress = nominal_stress(sm.NeoHookean(MODULUS, 0.5), 1 + strain / 100) / 1e3
    for name, (x, y, columns) in tables.items():
        with (tmp_path / name).open("w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows([(x, y), *zip(*(columns or (strain, stress)), strict=True)])
    status, said, complaints = ended(
        material_commands.fit_material, "--tensile", f"{tmp_path}/strip.csv:uniaxial:equilibrium", "--tensile",
        f"{tmp_path}/decay.csv:vibration:{tmp_path}/beam.toml", "--memory", "--branches", "1", "--material", "neo-hookean",
        "--no-pictures", "-o", str(tmp_path / "fit"),
    )  # fmt: skip
    assert status == 0, complaints
    assert "first mode of beam" in said and "damping ratio" in said
    with (tmp_path / "fit/oscillations.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            assert float(row["neo-hookean"]) == pytest.approx(float(row["measured"]), rel=1e-2)
    status, _, complaints = ended(
        material_commands.fit_material, "--tensile", f"{tmp_path}/decay.csv:vibration", "--memory", "--material", "neo-hookean"
    )
    assert status == 2 and "decay.csv:vibration:beam.toml" in complaints


def test_vibrations_need_a_memory(stiffnesses):
    with pytest.raises(FitError, match="show a memory"):
        fit_curves(vibration.Vibration("beam", -1 + 9j, (0.1, 0.1), *stiffnesses[0]), "neo-hookean")
