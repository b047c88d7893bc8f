"""The command ``score``: known answers on simulated measurements, tables, and bad input as one sentence with status 2."""

from __future__ import annotations

import csv

import numpy as np
import pytest

import softmodels as sm
from softmodels.__main__ import softmodels as whole_command
from softmodels.case.materials import MaterialErrors
from softmodels.fitting.curves.curve import TensileCurve, TensileError
from softmodels.fitting.curves.residuals import StressError
from softmodels.fitting.problem import LawChoice
from softmodels.fitting.scoring import score_curve, write_scores
from softmodels.materials.laws import Gent, NeoHookean, Ogden, Yeoh
from softmodels.materials.specimens import respond

LAW = Yeoh(8e3, 90.0, 0.5, 0.5)
ERROR = StressError.from_text("2%+0.2kPa")


def measured(law=LAW, seed=4, count=2000, mode="uniaxial"):
    """A simulated test whose error is what it is stated to be."""
    stretch = np.linspace(1.02, 3.0, count)
    stress = respond(law, stretch, mode).stress
    size = np.hypot(0.02 * stress, 200.0)
    return TensileCurve("pull.csv", mode, stretch, stress + np.random.default_rng(seed).normal(size=count) * size)


@pytest.mark.parametrize("law", [LAW, NeoHookean(20e3, 0.5), Ogden((15e3, 30.0), (1.4, 5.5), 0.5), Gent(20e3, 60.0, 0.5)])
@pytest.mark.parametrize("mode", ["uniaxial", "equibiaxial"])
def test_a_material_on_its_own_data(law, mode):
    """Chi squared per value is 1 and the 95 % band holds 95 %, within their scatter."""
    found = score_curve("it", law, measured(law, mode=mode), ERROR)
    assert found.chi2 == pytest.approx(1.0, abs=0.12)
    assert found.coverage == pytest.approx(0.95, abs=0.02)
    assert found.unit == "Pa" and found.count == 2000


def test_a_wrong_material_is_clearly_worse():
    curve = measured()
    right, wrong = (score_curve("it", law, curve, ERROR) for law in (LAW, Yeoh(9.6e3, 90.0, 0.5, 0.5)))
    assert wrong.chi2 > 20 * right.chi2 and wrong.coverage < 0.3 and wrong.rms > 4 * right.rms
    assert "kPa at stretch" in wrong.worst and "standard errors" in wrong.worst


def test_a_misfit_is_told_apart():
    """Laws drawn from their own covariance: their errors explain what the measurement's do not; a wrong law they do not."""
    curve, rng = measured(), np.random.default_rng(8)
    size = np.array([800.0, 9.0])
    errors = MaterialErrors(("c1", "c2"), ((size[0] ** 2, 0.0), (0.0, size[1] ** 2)))
    drawn = [Yeoh(*(np.array([LAW.c1, LAW.c2]) + size * rng.normal(size=2)), LAW.c3, 0.5) for _ in range(20)]
    scores = [score_curve("it", law, curve, ERROR, errors) for law in drawn]
    assert max(one.chi2 for one in scores) > 20
    left = np.array([one.chi2 - one.chi2_material for one in scores])
    assert np.sum(np.abs(left - 1.0) < 0.1) >= 17  # 95 % of them, within chance
    for one in scores:
        assert one.chi2_measurement == pytest.approx(min(one.chi2 - one.chi2_material, 1.0), rel=1e-12)
    exact = score_curve("it", LAW, curve, ERROR, errors)
    assert 0.0 <= exact.chi2_material < 0.01
    wrong = score_curve("it", NeoHookean(20e3, 0.5), curve, ERROR, MaterialErrors(("shear_modulus",), ((100.0,),)))
    assert wrong.chi2 > 20 and wrong.chi2_material < 0.2 * wrong.chi2 and wrong.chi2_measurement == 1.0
    unknown = score_curve("it", LAW, curve, ERROR)
    assert np.isnan(unknown.chi2_material) and unknown.chi2_measurement == min(unknown.chi2, 1.0)


def test_what_errors_explain_in_closed_form():
    """One number, stress in proportion to it: the least squares where the band reaches them, else the band's end."""
    curve, law, size = measured(NeoHookean(20e3, 0.5)), NeoHookean(21e3, 0.5), 1e3
    found = score_curve("it", law, curve, ERROR, MaterialErrors(("shear_modulus",), ((size**2,),)))
    stress, sigma = respond(law, curve.stretch, "uniaxial").stress, ERROR.of(curve)
    r, g = (stress - curve.stress) / sigma, stress / 21e3 * size / sigma
    assert abs(g @ r) / (g @ g) < 1.96
    assert found.chi2_material == pytest.approx((g @ r) ** 2 / (g @ g) / len(r), rel=1e-9)
    found = score_curve("it", law, curve, ERROR, MaterialErrors(("shear_modulus",), ((100.0**2,),)))
    moved = r - 1.959964 * g / 10  # the true one is 10 standard errors away: the band ends before it
    assert found.chi2_material == pytest.approx((r @ r - moved @ moved) / len(r), rel=1e-6)


def test_a_fitted_file_brings_its_errors(says, tmp_path):
    """From the command and from Python, of a fit to one curve scored against another cast's."""
    fit = "fit --tensile pull.csv --material yeoh --stress-error 2%+0.2kPa --gauge-error 5% --no-pictures -o fit"
    status, _, complaint = says(fit)
    assert status == 0, complaint
    other = measured(Yeoh(8.4e3, 95.0, 0.5, 0.5), seed=5, count=90)
    rows = [f"{a:.9g},{b:.9g}" for a, b in zip(other.stretch, other.stress, strict=True)]
    (tmp_path / "other.csv").write_text("\n".join(["stretch,stress (Pa)", *rows]) + "\n")
    asked = "score --tensile other.csv --stress-error 2%+0.2kPa --material ecoflex-00-30 --material fit/fitted.toml -o out"
    status, out, _ = says(asked)
    assert status == 0 and "of measurement" in out and "of material" in out and "unknown" in out
    with (tmp_path / "out" / "scores.csv").open() as file:
        rows = {row["material"]: row for row in csv.DictReader(file)}
    assert rows["ecoflex-00-30"]["chi2_material"] == ""
    with (tmp_path / "out" / "curves.csv").open() as file:
        readings = [row for row in csv.DictReader(file) if row["material"] == "fit/fitted.toml"]
    measured_Pa, predicted, low, high = (
        np.array([float(row[f"{name}_Pa"]) for row in readings])
        for name in ("measured", "predicted", "predicted_low", "predicted_high")
    )
    assert measured_Pa == pytest.approx(other.stress, rel=1e-6, abs=1e-3) and (low < predicted)[1:].all()
    assert np.sqrt(np.mean((predicted - measured_Pa) ** 2)) == pytest.approx(float(rows["fit/fitted.toml"]["rms"]), rel=1e-6)
    assert (high + low) / 2 == pytest.approx(predicted, rel=1e-7, abs=1e-3)
    fitted = {name: float(rows["fit/fitted.toml"][f"chi2_{name}"]) for name in ("per_value", "measurement", "material")}
    assert fitted["per_value"] > 2.0 and fitted["per_value"] - fitted["material"] < 1.3 and fitted["material"] > 0.5
    options = sm.FitOptions(stress_error="2%+0.2kPa", gauge_error=0.05)
    report = sm.fit_curves("pull.csv", "yeoh", options)
    for errors in (report.chosen.errors, "fit/fitted.toml"):
        given = {"it": report.material}
        (one,) = sm.score(given, "other.csv", stress_error="2%+0.2kPa", errors={"it": errors})
        assert one.chi2_material == pytest.approx(fitted["material"], rel=1e-3)
    with pytest.raises(sm.FitError, match="errors of 'that' are given, but it is not scored"):
        sm.score({"it": LAW}, "other.csv", errors={"that": report.chosen.errors})
    with pytest.raises(ValueError, match="another material"):
        sm.score({"it": LAW}, "other.csv", errors={"it": report.chosen.errors})


@pytest.mark.parametrize("law", [LAW, Ogden((15e3, 30.0), (1.4, 5.5), 0.5), Gent(20e3, 60.0, 0.49)])
def test_a_law_goes_through_its_numbers(law):
    assert LawChoice.of(law).material(law.parameters) == law


@pytest.fixture
def says(tmp_path, monkeypatch, ended):
    monkeypatch.chdir(tmp_path)
    curve = measured(count=90)
    rows = [f"{a:.9g},{b:.9g}" for a, b in zip(curve.stretch, curve.stress, strict=True)]
    (tmp_path / "pull.csv").write_text("\n".join(["stretch,stress (Pa)", *rows]) + "\n")
    return lambda text: ended(whole_command, *text.split())


def test_a_table_of_several_materials(says, tmp_path):
    right = "yeoh:c1=8kPa,c2=90Pa,c3=0.5Pa,poisson=0.5"
    names = f"--material ecoflex-00-30/liao-2021 --material {right}"
    status, out, _ = says(f"score --tensile pull.csv --stress-error 2%+0.2kPa {names} -o out")
    assert status == 0 and out.index(right) < out.index("liao-2021") and "95 % band" in out and "kPa" in out
    with (tmp_path / "out" / "scores.csv").open() as file:
        rows = {row["material"]: row for row in csv.DictReader(file)}
    assert float(rows[right]["chi2_per_value"]) == pytest.approx(1.0, abs=0.5)
    assert float(rows[right]["coverage_95"]) > 0.88 > float(rows["ecoflex-00-30/liao-2021"]["coverage_95"])
    assert rows[right]["unit"] == "Pa" and int(rows[right]["values"]) == 90


def test_from_python_the_scores_are_the_commands(says, tmp_path, capsys):
    right = "yeoh:c1=8kPa,c2=90Pa,c3=0.5Pa,poisson=0.5"
    names = f"--material ecoflex-00-30/liao-2021 --material {right}"
    assert says(f"score --tensile pull.csv --stress-error 2%+0.2kPa --stretch 1.02:3 {names} -o out")[0] == 0
    materials = {right: LAW, "ecoflex-00-30/liao-2021": sm.silicone("ecoflex-00-30/liao-2021")}
    found = sm.score(materials, "pull.csv", stress_error="2%+0.2kPa", stretch=(1.02, 3.0))
    assert [one.material for one in found] == [right, "ecoflex-00-30/liao-2021"]
    write_scores(tmp_path / "python.csv", sorted(found, key=lambda one: one.material))
    assert (tmp_path / "python.csv").read_text() == (tmp_path / "out" / "scores.csv").read_text()
    assert capsys.readouterr() == ("", "")


def test_from_python_materials_have_names_of_their_own():
    found = sm.score([Yeoh(9.6e3, 90.0, 0.5, 0.5), LAW, sm.silicone("ecoflex-00-30")], measured(count=90))
    assert sorted(one.material.split(" ")[0] for one in found) == ["ecoflex-00-30", "yeoh", "yeoh"]
    assert "c1 = 8 kPa" in found[0].material and found[0].chi2 < found[1].chi2 < found[2].chi2


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: sm.score(LAW), "there are no measurements"),
        (lambda: sm.score([], measured(count=90)), "there is no material"),
        (lambda: sm.score([LAW, LAW], measured(count=90)), "given twice"),
        (lambda: sm.score(LAW, device=sm.HollowDisk()), "vice versa"),
        (lambda: sm.score(LAW, measured(count=90), stress_error="constant"), "absolute errors"),
        (lambda: sm.score(Gent(20e3, 2.0, 0.5), measured(count=90)), r"limit the range with stretch$"),
    ],
)
def test_from_python_bad_input_is_an_exception(call, words):
    with pytest.raises((sm.FitError, TensileError), match=words):
        call()


M = "--material ecoflex-00-30"
REFUSED = {
    "score": ["--material"],
    f"score {M}": ["--tensile"],
    f"score {M} --tensile none.csv": ["none.csv"],
    f"score {M} {M} --tensile pull.csv": ["twice"],
    "score --material butter --tensile pull.csv": ["butter"],
    f"score {M} --tensile pull.csv --stress-error constant": ["absolute errors"],
    f"score {M} --tensile pull.csv --stress-error 2": ["no unit"],
    f"score {M} --tensile pull.csv --stretch 5:6": ["0 of its points"],
    f"score {M} case.toml": ["case.toml", "outlines"],
    f"score {M} case.toml outlines": ["case.toml"],
    "score --material gent:shear_modulus=20kPa,limit=2,poisson=0.5 --tensile pull.csv": ["no stress at stretch"],
}


@pytest.mark.parametrize("text", REFUSED)
def test_bad_input_is_one_sentence(text, says, tmp_path):
    status, out, complaint = says(text)
    assert status == 2 and out == "", complaint
    assert complaint.startswith("softmodels: ") and complaint.count("\n") == 1
    assert all(word in complaint for word in REFUSED[text]), complaint
    assert not (tmp_path / "results").exists()
