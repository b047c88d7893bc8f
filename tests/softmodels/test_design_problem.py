"""Design problems that cannot be meant: one sentence each, before anything is solved."""

from __future__ import annotations

from pathlib import Path

import pytest

import softmodels as sm
from softmodels.__main__ import softmodels as whole_command
from softmodels.design.problem import DesignProblem
from tests.support import fake_design as fake


@pytest.fixture(autouse=True)
def in_closed_form(monkeypatch):
    fake.install(monkeypatch.setattr)


GOOD = f"""{fake.PROBLEM}[[keep]]
quantity = "clearances"
at_least = "3 mm"
"""
WRONG = {
    "no parameters": (
        '[parameters]\nmembrane = { from = "2 mm", to = "9 mm" }\ncavity_radius = { from = "6 mm", to = "14 mm" }\n',
        "",
        ["no parameter is free"],
    ),
    "no upper bound": (', to = "9 mm"', "", ["membrane", "no upper bound"]),
    "no bounds": ('{ from = "2 mm", to = "9 mm" }', '"4 mm"', ["membrane", "no bounds"]),
    "reversed": ('from = "2 mm", to = "9 mm"', 'from = "9 mm", to = "2 mm"', ["membrane", "reversed", "9 mm", "2 mm"]),
    "equal": ('from = "2 mm", to = "9 mm"', 'from = "6 mm", to = "6 mm"', ["membrane", "both bounds"]),
    "a third entry": ('to = "9 mm"', 'to = "9 mm", step = "1 mm"', ["membrane", "'step'"]),
    "no unit": ('from = "2 mm"', "from = 2", ["membrane from", "no unit"]),
    "wrong kind": ('from = "2 mm"', 'from = "2 kPa"', ["membrane from", "'2 kPa'", "20mm"]),
    "unknown parameter": ("membrane =", "membran =", ["'membran'", "did you mean membrane?"]),
    "no shape": ("membrane =", "cell_size =", ["cell_size", "does not affect the shape"]),
    "an entry of no list": ("membrane =", '"membrane[2]" =', ["membrane[2]", "not a list"]),
    "not of this section": (
        'membrane = { from = "2 mm", to = "9 mm" }',
        'azimuth = { from = "0deg", to = "9 deg" }',
        ["azimuth"],
    ),
    "cannot be followed": (
        'membrane = { from = "2 mm", to = "9 mm" }',
        'fillet = { from = "0.5 mm", to = "1.5 mm" }',
        ["cannot follow fillet", "membrane"],
    ),
    "start outside": ('from = "2 mm", to = "9 mm"', 'from = "2 mm", to = "5 mm"', ["membrane", "6 mm", "outside"]),
    "no device at a bound": (
        'from = "6 mm", to = "14 mm"',
        'from = "0.5 mm", to = "14 mm"',
        ["cavity_radius", "lower bound", "0.5 mm"],
    ),
    "unknown quantity": ('quantity = "rise"', 'quantity = "rises"', ["'rises'", "did you mean rise?"]),
    "no quantity": ('quantity = "rise"\n', "", ["maximise names no quantity"]),
    "unknown probe": ('of = "apex"', 'of = "apx"', ["'apx'", "did you mean apex?"]),
    "no pressure": ('of = "apex"\nat = "177 cm"', 'of = "apex"', ["maximise", "rise needs a pressure", "at ="]),
    "beyond the case": (
        'of = "apex"\nat = "177 cm"',
        'of = "apex"\nat = "200 cm"',
        ["200 cm", "last pressure", "177 cm"],
    ),
    "at of another kind": ('of = "apex"\nat = "177 cm"', 'of = "apex"\nat = "177 mm"', ["at", "177 mm"]),
    "at zero": ('of = "apex"\nat = "177 cm"', 'of = "apex"\nat = "0 cm"', ["'0 cm'", "above zero"]),
    "at for nothing": ('"limit_margin"\n', '"limit_margin"\nat = "100 cm"\n', ["limit_margin", "leave out at"]),
    "no limit": ("at_most = 1.18\n", "", ["keep 1", "no limit"]),
    "limits exchanged": ("at_most = 1.18", "at_most = 1.18\nat_least = 1.3", ["at least 1.3", "at most 1.18"]),
    "margin below one": ("at_least = 1.3", "at_least = 0.9", ["0.9 is below 1"]),
    "limit of another kind": ('at_least = "3 mm"', 'at_least = "3 kPa"', ["at_least of clearances", "3 kPa"]),
    "limit without unit": ('at_least = "3 mm"', "at_least = 3", ["at_least of clearances", "no unit"]),
    "workshop too coarse": ('at_least = "3 mm"', 'at_least = "7 mm"', ["smallest wall is 7 mm", "membrane is 6 mm"]),
    "no objective": ('[maximise]\nquantity = "rise"\nof = "apex"\nat = "177 cm"\n', "", ["has no objective"]),
    "two objectives": (
        '[[keep]]\nquantity = "max_stretch"',
        '[minimise]\nquantity = "mass"\n[[keep]]\nquantity = "max_stretch"',
        ["maximise and minimise"],
    ),
    "many values": (
        'quantity = "rise"\nof = "apex"\nat = "177 cm"',
        'quantity = "clearances"',
        ["clearances", "many values"],
    ),
    "weights": (
        'of = "apex"\nat = "177 cm"',
        'of = "apex"\nat = ["90 cm", "177 cm"]\nweights = [1]',
        ["1 weights for 2"],
    ),
    "unknown entry": ('of = "apex"', 'off = "apex"', ["'off'", "did you mean of?"]),
    "unknown table": (
        'name = "more-rise"',
        'name = "more-rise"\nmaximize = 3',
        ["'maximize'", "did you mean"],
    ),
    "no case": (GOOD[GOOD.index("[case.geo") : GOOD.index("[parameters]")], "", ["no case"]),
    "no case file": (GOOD[GOOD.index("[case.geo") : GOOD.index("[parameters]")], 'case = "none.toml"\n', ["none.toml"]),
    "a wrong case": ('shear_modulus = "30 kPa"', 'shear_modulus = "30 Pa"', ["shear modulus is 30 Pa"]),
    "volumes": ('pressure_cm = "0:177"', 'volume_ml = "0:10"', ["added volumes", "pressures"]),
    "cycle": ('pressure_cm = "0:177"', 'pressure_cm = "0:177"\nload_unload = true', ["load_unload"]),
    "tolerance": (
        'name = "more-rise"',
        'name = "more-rise"\ntolerance = { membrane = "0 mm" }',
        ["tolerance of membrane"],
    ),
    "unknown tolerance": ('name = "more-rise"', 'name = "more-rise"\ntolerance = { roof = "1 mm" }', ["'roof'"]),
    "unknown process": ('name = "more-rise"', 'name = "more-rise"\ntolerance = { process = "sand" }', ["resin, filament"]),
    "standard deviations": (
        'name = "more-rise"',
        'name = "more-rise"\ntolerances = { membrane = "1 mm" }',
        ["held standard deviations", "write [tolerance]", "1.96 times"],
    ),
    "no fit": ('name = "more-rise"', 'name = "more-rise"\nmaterial_errors = { file = "none.toml" }', ["none.toml"]),
    "a name for no file": ('name = "more-rise"', 'name = "more rise"', ["'more rise'", "is not a valid file name"]),
    "no TOML": ("[parameters]", "[parameters", ["not valid TOML"]),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_problem_that_cannot_be_meant_is_one_sentence(name, tmp_path, ended, monkeypatch):
    monkeypatch.chdir(tmp_path)
    old, new, words = WRONG[name]
    assert old in GOOD
    Path("wrong.toml").write_text(GOOD.replace(old, new, 1))
    status, out, err = ended(whole_command, "design", "wrong.toml")
    assert status == 2 and out == "" and err.count("\n") == 1 and "Traceback" not in err, err
    for word in words:
        assert word in err
    assert not Path("results").exists()


def test_the_good_problem_is_good(tmp_path):
    problem = DesignProblem.from_toml(GOOD)
    assert [one.name for one in problem.free] == ["cavity_radius", "membrane"]
    assert problem.terms[0].quantity.at.value == pytest.approx(177 * problem.case.column.pascal) and problem.sign == -1.0
    assert [keep.quantity.name for keep in problem.limits] == ["max_stretch", "limit_margin", "clearances"]
    assert problem.limits[2].at_least == 0.003 and problem.notes == ()


def test_bounds_that_cross_in_a_corner_are_warned_of():
    wall = 'wall = { from = "3.1 mm", to = "12 mm" }'
    text = GOOD.replace("[maximise]", f"{wall}\n[maximise]")
    assert DesignProblem.from_toml(text).notes == ()
    thin = text.replace('section = "axisymmetric"', 'section = "axisymmetric"\nleast_sum = "8 mm"')
    note = DesignProblem.from_toml(thin).notes[0]
    assert note.startswith("2 of 8 combinations of bounds give an invalid device") and "the search avoids them" in note


def test_from_python_numbers_are_si_and_texts_carry_units():
    case = DesignProblem.from_toml(GOOD).case
    keep = [sm.Keep(fake.FakeStretch(at=10e3), at_most=1.5), {"quantity": "mass", "at_most": "30 g"}]
    highest = 177 * case.column.pascal
    problem = sm.DesignProblem(case, {"membrane": (0.002, "9 mm")}, maximise=fake.FakeRise(at=highest), keep=keep)
    assert (
        problem.free[0].low == 0.002
        and problem.free[0].high == pytest.approx(0.009)
        and problem.limits[1].at_most == pytest.approx(0.03)
    )
    both = sm.DesignProblem(case, {"membrane": (0.002, "9 mm")}, keep=keep, follow=None,
                            maximise={"quantity": "rise", "at": ["100 cm", "16 kPa"], "weights": [1, 3]})  # fmt: skip
    assert [term.weight for term in both.terms] == [0.25, 0.75]


def test_several_pressures_make_several_limits():
    problem = DesignProblem.from_toml(GOOD.replace('at = "177 cm"\nat_most', 'at = ["100 cm", "177 cm"]\nat_most'))
    assert [keep.quantity.name for keep in problem.limits[:3]] == ["max_stretch", "max_stretch", "limit_margin"]
