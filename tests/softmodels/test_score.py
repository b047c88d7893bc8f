"""The command ``score``: known answers on simulated measurements, tables, and bad input as one sentence with status 2."""

from __future__ import annotations

import csv

import numpy as np
import pytest

import softmodels as sm
from softmodels.__main__ import softmodels as whole_command
from softmodels.fitting.curves.columns import TensileError
from softmodels.fitting.curves.curve import TensileCurve
from softmodels.fitting.curves.stress_error import StressError
from softmodels.fitting.law_parameters import LawChoice
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


@pytest.mark.parametrize(
    "law", [LAW, NeoHookean(20e3, 0.5), Ogden((15e3, 30.0), (1.4, 5.5), 0.5), Gent(20e3, 60.0, 0.5)]
)
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
        (lambda: sm.score(LAW), "nothing to score against"),
        (lambda: sm.score([], measured(count=90)), "nothing to score"),
        (lambda: sm.score([LAW, LAW], measured(count=90)), "given twice"),
        (lambda: sm.score(LAW, device=sm.HollowDisk()), "belong together"),
        (lambda: sm.score(LAW, measured(count=90), stress_error="constant"), "size of the error"),
        (lambda: sm.score(Gent(20e3, 2.0, 0.5), measured(count=90)), r"keep below it with stretch$"),
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
    f"score {M} --tensile pull.csv --stress-error constant": ["size of the error"],
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
