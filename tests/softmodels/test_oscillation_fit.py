"""Fits of a memory to moduli and tan delta over frequency: intervals that hold the truth, tables as they come, refusals."""

from __future__ import annotations

import csv
import math

import numpy as np
import pytest
import scipy.integrate

from geometries import HollowDisk
from softmodels.cli import material_commands
from softmodels.common import columns
from softmodels.fitting.curves import oscillation, residuals
from softmodels.fitting.curves.curve import TensileCurve, TensileError
from softmodels.fitting.curves.fit import fit_curves
from softmodels.fitting.outlines.fit import fit
from softmodels.fitting.problem import FitError, FitOptions, LawChoice
from softmodels.materials.laws import Yeoh
from softmodels.materials.specimens import nominal_stress
from softmodels.pictures.fits import draw_law

MODULUS, SHARES, TIMES = 30e3, (0.3, 0.2), (4e-3, 0.15)
TRUTH = {"shear_modulus": MODULUS, "share1": 0.3, "share2": 0.2, "time1": 4e-3, "time2": 0.15}
FREQUENCIES = np.geomspace(0.05, 100.0, 34)
HOW = FitOptions(memory=True, branches=2, profiles=False, gauge_error=0.0, stress_error="1%+10Pa")


def measured_moduli(frequency):
    """Storage and loss modulus of shear in Pa, of a strain sin(w t) that is imposed on springs and dashpots (solve_ivp): the
    sine and cosine of the stress over the tenth of ten periods, or of what is left of the slowest branch."""
    w = 2 * math.pi * frequency
    periods = math.ceil(max(10.0, 12 * max(TIMES) * frequency))

    def rates(t, flown):  # the strains of the dashpots
        return [(math.sin(w * t) - own) / time for own, time in zip(flown, TIMES, strict=True)]

    start = (periods - 1) / frequency
    at = np.linspace(start, periods / frequency, 201)
    flown = scipy.integrate.solve_ivp(rates, (0.0, at[-1]), [0.0, 0.0], "LSODA", at, rtol=1e-7, atol=1e-9).y
    stress = MODULUS * (np.sin(w * at) + np.array(SHARES) @ (np.sin(w * at) - flown))
    return [2 * frequency * np.trapezoid(stress * wave(w * at), at) for wave in (np.sin, np.cos)]


@pytest.fixture(scope="module")
def moduli():
    """Storage and loss over `FREQUENCIES`."""
    return np.array([measured_moduli(f) for f in FREQUENCIES]).T


def noisy(moduli, generator, size=0.01, kinds=("storage-modulus", "loss-modulus")):
    values = {"storage-modulus": moduli[0], "loss-modulus": moduli[1], "tan-delta": moduli[1] / moduli[0]}
    scattered = {kind: values[kind] * (1 + generator.normal(0.0, size, len(FREQUENCIES))) for kind in kinds}
    return oscillation.Oscillation("dma", True, FREQUENCIES, scattered)


def test_moduli_without_noise_return_branches_and_times(moduli):
    fit = fit_curves(noisy(moduli, np.random.default_rng(0), 0.0), "neo-hookean", HOW).chosen.fit
    for name, value in TRUTH.items():
        assert fit.values[name] == pytest.approx(value, rel=1e-3)


@pytest.mark.campaign
@pytest.mark.parametrize("kinds", [("storage-modulus", "loss-modulus"), ("storage-modulus", "tan-delta")])
def test_95_percent_intervals_hold_shares_and_times(moduli, kinds):
    generator, held = np.random.default_rng(3), []
    for _ in range(120):
        fit = fit_curves(noisy(moduli, generator, kinds=kinds), "neo-hookean", HOW).chosen.fit
        held.append([fit.interval(name)[0] <= value <= fit.interval(name)[1] for name, value in TRUTH.items()])
    shares = np.mean(held, axis=0)
    assert 0.92 <= shares.mean() <= 0.98 and shares.min() >= 0.88


def test_tan_delta_and_a_curve_at_equilibrium_share_the_work(moduli):
    """Tan delta has no modulus, and the curve no branches; the law is the curve's."""
    law = Yeoh(MODULUS / 2, 300.0, 0.0, 0.5)
    stretch = np.linspace(1.0, 2.5, 40)
    curve = TensileCurve("slow", "uniaxial", stretch, nominal_stress(law, stretch))
    test = noisy(moduli, np.random.default_rng(0), 0.0, ("tan-delta",))
    report = fit_curves([curve, test], "yeoh", FitOptions(memory=True, branches=2, profiles=False))
    values = report.chosen.fit.values
    assert report.chosen.sound and values["c1"] == pytest.approx(MODULUS / 2, rel=1e-3)
    for name in ("share1", "share2", "time1", "time2"):
        assert values[name] == pytest.approx(TRUTH[name], rel=5e-3)


@pytest.mark.parametrize("kind", list(oscillation.QUANTITIES))
@pytest.mark.parametrize("fitted", [True, False])
def test_slopes_by_taylors_rule(moduli, kind, fitted):
    choice = LawChoice.from_text("gent")
    spectrum = residuals.Spectrum((4e-3, 0.15), (1e-3, 1.0), ("", ""), fitted)
    test = noisy(moduli, np.random.default_rng(1), kinds=(kind,))
    extra = oscillation.residuals_of([test], choice, residuals.StressError.from_text("auto"), 0.03, spectrum)
    (source,), parameters = extra.sources, extra.parameters
    assert bool(parameters) == (kind != "tan-delta")
    values = {"shear_modulus": 31e3, "limit": 40.0, **TRUTH, "share_0.004s": 0.3, "share_0.15s": 0.2, "gauge1": 1.02}
    r, J, _ = source.evaluate(values, True)
    for name, slope in zip(source.parameters, J.T, strict=True):
        ends = [source.evaluate({**values, name: values[name] * (1 + step)}, False)[0] for step in (1e-5, -1e-5)]
        assert (ends[0] - ends[1]) / (2e-5 * values[name]) == pytest.approx(slope, rel=1e-5, abs=1e-7 * np.abs(r).max())


def test_slopes_by_the_times_of_a_curve():
    """Relaxation times are fitted to holds too."""
    time = np.r_[np.linspace(0.0, 1.0, 9), 1.0 + np.geomspace(0.1, 60.0, 30)]
    stretch = np.minimum(1.0 + 0.8 * time, 1.8)
    curve = TensileCurve("hold", "uniaxial", stretch, np.full(len(time), 1e4), time=time)
    spectrum = residuals.spectrum([curve], count=2)
    assert spectrum.all_names == ("share1", "share2", "time1", "time2")
    choice, error = LawChoice.from_text("yeoh"), residuals.StressError.from_text("100Pa")
    (source,), _ = residuals.residuals_of([curve], choice, error, spectrum=spectrum)
    values = {"c1": 15e3, "c2": 100.0, "c3": 1.0, "share1": 0.2, "share2": 0.3, "time1": 0.5, "time2": 9.0}
    _, J, _ = source.evaluate(values, True)
    for name in spectrum.all_names:
        ends = [source.evaluate({**values, name: values[name] * (1 + step)}, False)[0] for step in (1e-3, -1e-3)]
        slope = (ends[0] - ends[1]) / (2e-3 * values[name])
        assert np.abs(slope - J[:, source.parameters.index(name)]).max() < 2e-3 * np.abs(slope).max()


# ----------------------------------------------------------------------------------------------------------------------
# Tables.


def written(path, header, rows, above=()):
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([*above, header, *rows])
    return path


ROWS = [(0.1, 90.0, 9.0), (1.0, 100.0, 12.0), (10.0, 120.0, 20.0), (100.0, 150.0, 24.0), (200.0, 160.0, 24.0)]


@pytest.mark.parametrize(
    ("header", "test", "per_hertz", "factor"),
    [
        (["Frequency (Hz)", "E' (kPa)", 'E" (kPa)'], "oscillation", 1.0, 1e3),
        (["Angular Frequency [rad/s]", "Storage Modulus [kPa]", "Loss Modulus [kPa]"], "shear-oscillation", 2 * math.pi, 1e3),
        (["Frequency [rad/s]", "G' [MPa]", "G'' [MPa]"], "shear-oscillation", 2 * math.pi, 1e6),
        (["Ang. frequency (rad/s)", "G\u2032 (kPa)", "G\u2033 (kPa)"], "shear-oscillation", 2 * math.pi, 1e3),
        (["Frequenz in Hz", "Speichermodul (kPa)", "Verlustmodul (kPa)"], "oscillation", 1.0, 1e3),
        (["Kreisfrequenz [1/s]", "Speichermodul [kPa]", "Verlustmodul [kPa]"], "shear-oscillation", 2 * math.pi, 1e3),
        (["Freq / Hz", "Storage modulus / kPa", "Loss modulus / kPa"], "oscillation", 1.0, 1e3),
    ],
)
def test_headers_of_analysers_and_rheometers(tmp_path, header, test, per_hertz, factor):
    (read,) = oscillation.read(written(tmp_path / "dma.csv", header, ROWS), test)
    frequency, storage, loss = np.array(ROWS).T
    assert read.frequency == pytest.approx(frequency / per_hertz)
    assert read.measured["storage-modulus"] == pytest.approx(factor * storage)
    assert read.measured["loss-modulus"] == pytest.approx(factor * loss)
    assert read.shear == (test == "shear-oscillation") and "column 1" in read.source


@pytest.mark.parametrize(
    "name", ["tan delta", "Tan(delta)", "tan \u03b4", "Tan(\u03b4) (-)", "Loss factor", "Verlustfaktor [-]"]
)
def test_tan_delta_by_its_names(tmp_path, name):
    rows = [(f, loss / storage) for f, storage, loss in ROWS]
    (read,) = oscillation.read(written(tmp_path / "dma.csv", ["Frequency (Hz)", name], rows), "oscillation")
    assert list(read.measured) == ["tan-delta"] and read.measured["tan-delta"][0] == pytest.approx(0.1)


def test_units_in_a_row_of_their_own_and_a_quotient_that_is_left_out(tmp_path):
    header = ["Point No.", "Temperature", "Frequency", "Storage modulus", "Loss modulus", "Tan delta"]
    rows = [("", "\u00b0C", "Hz", "MPa", "MPa", ""), *((i, 23.1, f, a, b, b / a) for i, (f, a, b) in enumerate(ROWS))]
    (read,) = oscillation.read(written(tmp_path / "dma.csv", header, rows, [["Instrument", "DMA"]]), "oscillation")
    assert set(read.measured) == {"storage-modulus", "loss-modulus"} and read.measured["storage-modulus"][0] == 90e6
    assert "at 23.1 \u00b0C" in read.sentence


@pytest.mark.parametrize(
    "text",
    [
        "T=25;Mw=94.9;chem=PDMS\nFreq\tG'\tG\"\tTemp\tStrain\nrad/s\tkPa\tkPa\t\u00b0C\t%\n{:tab}",
        "Filename\ta.tri\n\n[step]\nAngular frequency\tStorage modulus\tLoss modulus\tTemperature\tTan(delta)\nrad/s\tkPa\tkPa"
        "\t\u00b0C\t\n{:tab}",
        "Project:\tsweep\n\nInterval data:\tPoint No.\tAngular Frequency\tStorage Modulus\tLoss Modulus\tTemperature\t"
        "Loss Factor\n\t\t[rad/s]\t[kPa]\t[kPa]\t[\u00b0C]\t[1]\n{:numbered}",
    ],
    ids=["osc", "TRIOS", "RheoCompass"],
)
def test_text_files_of_rheometers(tmp_path, text):
    rows = ["\t".join(f"{v:g}" for v in (f, a, b, 25.0, b / a)) for f, a, b in ROWS]
    numbered = "\n".join(f"\t{i}\t{row}" for i, row in enumerate(rows, 1))
    text = text.replace("{:tab}", "\n".join(rows)).replace("{:numbered}", numbered)
    (tmp_path / "sweep.txt").write_text(text + "\n", encoding="utf-8")
    (read,) = oscillation.read(tmp_path / "sweep.txt", "shear-oscillation")
    assert read.frequency == pytest.approx(np.array(ROWS)[:, 0] / (2 * math.pi))
    assert set(read.measured) == {"storage-modulus", "loss-modulus"} and "at 25 \u00b0C" in read.remarks
    assert read.measured["loss-modulus"] == pytest.approx(1e3 * np.array(ROWS)[:, 2])


def test_one_of_several_temperatures(tmp_path):
    rows = [(T, f, a * (50 - T) / 25, b) for T in (10.0, 25.0, 40.1) for f, a, b in ROWS]
    path = written(tmp_path / "sweep.csv", ["T (\u00b0C)", "Frequency (Hz)", "E' (kPa)", "E'' (kPa)"], rows)
    with pytest.raises(TensileError, match="no column of temperatures"):
        oscillation.read(path, "oscillation", temperature="25\u00b0C")
    path = written(tmp_path / "sweep.csv", ["Temp. (\u00b0C)", "Frequency (Hz)", "E' (kPa)", "E'' (kPa)"], rows)
    with pytest.raises(TensileError, match=r"several temperatures \(10, 25, 40 \u00b0C\).*sweep.csv:oscillation:25\u00b0C"):
        oscillation.read(path, "oscillation")
    for chosen in ("25\u00b0C", "298.15K", "25 degC"):
        (read,) = oscillation.read(path, "oscillation", temperature=chosen)
        assert read.measured["storage-modulus"] == pytest.approx(1e3 * np.array([a for _, a, _ in ROWS]))
    with pytest.raises(TensileError, match="no row within 1 K of 30"):
        oscillation.read(path, "oscillation", temperature="30\u00b0C")


@pytest.mark.parametrize(
    ("header", "test", "rows", "why"),
    [
        (["Frequency (Hz)", "G' (kPa)"], "oscillation", ROWS, "write :shear-oscillation"),
        (["Frequency (Hz)", "E' (kPa)"], "shear-oscillation", ROWS, "write :oscillation"),
        (["Frequency", "E' (kPa)"], "oscillation", ROWS, "'Frequency' has no unit"),
        (["Frequency (Hz)", "E' (Pa)"], "oscillation", ROWS, "below that of any silicone"),
        (["Frequency (Hz)", "E' (kPa)"], "oscillation", [(0.0, 9.0), (1.0, 9.0)], "every frequency must be above 0"),
        (["Strain (%)", "Stress (kPa)"], "oscillation", ROWS, "names a frequency and a modulus or tan delta"),
    ],
)
def test_tables_that_are_refused(tmp_path, header, test, rows, why):
    with pytest.raises(TensileError, match=why):
        oscillation.read(written(tmp_path / "dma.csv", header, rows), test)


def test_a_curve_with_a_frequency_is_still_a_curve():
    assert columns.recognise("Frequency (Hz)", 0) is None and columns.recognise("Storage modulus (MPa)", 0) is None


def test_moduli_have_no_fitted_range_of_stretch(moduli):
    report = fit_curves(noisy(moduli, np.random.default_rng(0), 0.0), "neo-hookean", HOW)
    (axes,) = draw_law(report).axes
    assert report.chosen.material.fitted_stretch is None
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["neo-hookean"]


# ----------------------------------------------------------------------------------------------------------------------
# The command.


def test_the_command_fits_moduli_beside_a_hold(ended, tmp_path, moduli):
    rows = zip(FREQUENCIES, 3 * moduli[0] / 1e6, 3 * moduli[1] / 1e6, strict=True)
    path = written(tmp_path / "dma.csv", ["Frequency (Hz)", "Storage modulus (MPa)", "Loss modulus (MPa)"], rows)
    out = tmp_path / "fit"
    status, _, complaints = ended(
        material_commands.fit_material, "--tensile", f"{path}:oscillation", "--memory", "--branches", "2", "--material",
        "neo-hookean", "-o", str(out),
    )  # fmt: skip
    assert status == 0, complaints
    text = (out / "fitted.toml").read_text(encoding="utf-8")
    assert "branches" in text and (out / "oscillations.png").exists()
    with (out / "oscillations.csv").open(encoding="utf-8") as file:
        table = list(csv.DictReader(file))
    assert len(table) == 2 * len(FREQUENCIES)
    assert all(float(row["neo-hookean"]) == pytest.approx(float(row["measured"]), rel=1e-2) for row in table)


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["dma.csv:oscillation"], "data of softmodels fit --memory only"),
        (["dma.csv", "--memory"], "add :oscillation"),
        (["dma.csv:dma", "--memory"], "write oscillation for moduli E'"),
    ],
)
def test_what_the_command_refuses(ended, tmp_path, monkeypatch, words, why):
    monkeypatch.chdir(tmp_path)
    written(tmp_path / "dma.csv", ["Frequency (Hz)", "Storage modulus (kPa)"], ROWS)
    status, _, complaints = ended(material_commands.fit_material, "--tensile", *words)
    assert status == 2 and why in complaints


def test_a_score_refuses_moduli(ended, tmp_path):
    path = written(tmp_path / "dma.csv", ["Frequency (Hz)", "Storage modulus (kPa)"], ROWS)
    status, _, complaints = ended(material_commands.score, "--material", "ecoflex-00-30", "--tensile", f"{path}:oscillation")
    assert status == 2 and "data of softmodels fit --memory only" in complaints


def test_relaxation_times_are_not_fitted_to_photographs():
    with pytest.raises(FitError, match="not fitted to photographs"):
        fit(HollowDisk(), [], options=FitOptions(memory=True, branches=2))


def test_branches_and_moduli_need_a_memory(moduli):
    with pytest.raises(FitError, match="show a memory"):
        fit_curves(noisy(moduli, np.random.default_rng(0)), "neo-hookean")
