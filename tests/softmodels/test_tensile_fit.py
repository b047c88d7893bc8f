"""Fits of laws to curves: exact slopes, the truth found again, and intervals that cover it."""

from __future__ import annotations

import numpy as np
import pytest

from geometries import HollowDisk
from softmodels.case.case import Case
from softmodels.case.load import steps_of
from softmodels.case.materials import material_from
from softmodels.fitting.comparison import write_materials
from softmodels.fitting.curves.curve import TensileCurve, TensileError
from softmodels.fitting.curves.fit import fit_curves, fit_law_to_curves, prepared
from softmodels.fitting.curves.residuals import StressError, largest_strain, residuals_of
from softmodels.fitting.least_squares import fit_parameters, profile, unseen
from softmodels.fitting.problem import Extra, FitError, FitOptions, LawChoice, Parameter, Prior, all_laws
from softmodels.fitting.scoring import score
from softmodels.materials.laws import LAWS, NeoHookean
from softmodels.materials.specimens import MODE_NAMES, respond
from softmodels.runs.notes import stretch_notes
from softmodels.runs.table import PathTable
from tests.support.campaigns import sampled

TRUTH = {
    "neo-hookean": {"shear_modulus": 20e3},
    "mooney-rivlin": {"c10": 8e3, "c01": 1.5e3},
    "yeoh": {"c1": 8e3, "c2": 90.0, "c3": 0.5},
    "ogden1": {"mu1": 12e3, "alpha1": 2.5},
    "ogden2": {"mu1": 15e3, "alpha1": 1.4, "mu2": 30.0, "alpha2": 5.5},
    "ogden3": {"mu1": 15e3, "alpha1": 1.4, "mu2": 30.0, "alpha2": 5.5, "mu3": -400.0, "alpha3": -2.0},
    "carroll": {"a": 7e3, "b": 0.01, "c": 6e3},
    "gent": {"shear_modulus": 20e3, "limit": 60.0},
    "polynomial": {"c10": 8e3, "c01": 1.5e3, "c20": 60.0, "c11": -10.0, "c02": 4.0},
    "fung-demiray": {"shear_modulus": 20e3, "stiffening": 0.05},
}
laws = pytest.mark.parametrize("name", TRUTH)
ABSOLUTE = 50.0


def curves_of(name, noise=0.0, seed=0, top=5.0, modes=MODE_NAMES, count=60):
    """Synthetic curves with noise in Pa."""
    rng = np.random.default_rng(seed)
    material = LawChoice.from_text(name).material(TRUTH[name])
    made = []
    for mode in modes:
        stretch = np.linspace(1.02, {"uniaxial": 1.0, "planar": 0.9, "equibiaxial": 0.7}[mode] * top, count)
        stress = respond(material, stretch, mode).stress + rng.normal(0.0, noise, count) if noise else None
        made.append(TensileCurve(mode, mode, stretch, respond(material, stretch, mode).stress if stress is None else stress))
    return made


def fitted(name, curves, error="50Pa", gauge=0.0, **more):
    choice, stated = LawChoice.from_text(name), StressError.from_text(error)
    sources, gauges = residuals_of(curves, choice, stated, gauge)
    return fit_law_to_curves(choice, sources, gauges, errors="stated" if stated.stated else "unknown", **more)


def test_every_law_is_here():
    assert set(TRUTH) >= set(all_laws()) and {LawChoice.from_text(name).law for name in TRUTH} == set(LAWS.values())


@laws
def test_slopes_follow_taylor(name):
    """Of the residuals by every parameter, the test's own factor among them."""
    choice = LawChoice.from_text(name)
    (source, *_), _ = residuals_of(curves_of(name, 100.0), choice, StressError(0.0, ABSOLUTE, True), 0.02)
    values = {**TRUTH[name], "gauge1": 1.1}
    here, J, groups = source.evaluate(values, True)
    assert J.shape == (60, len(source.parameters)) and set(groups) == {source.label}
    for column, parameter in zip(J.T, source.parameters, strict=True):
        left = []
        for size in (2e-3, 1e-3):
            step = size * values[parameter]
            there = source.evaluate({**values, parameter: values[parameter] + step}, False)[0]
            left.append(np.abs(there - here - step * column).max() / np.abs(here).max())
        if parameter.startswith(("alpha", "limit", "stiffening")):
            assert np.log2(left[0] / left[1]) == pytest.approx(2.0, abs=0.05), (parameter, left)
        else:  # the stress is linear in all others
            assert left[1] < 1e-11, (parameter, left)


@pytest.mark.quick
@laws
def test_the_truth_is_found_again(name):
    found = fitted(name, curves_of(name))
    assert found.converged and found.deviance < 1e-8
    pairs = {k: v for k, v in found.values.items() if k.startswith("alpha")}
    if name == "ogden3":  # its terms may come in another order
        assert sorted(pairs.values()) == pytest.approx([-2.0, 1.4, 5.5], rel=1e-4)
        assert sorted(v for k, v in found.values.items() if k.startswith("mu")) == pytest.approx([-400.0, 30.0, 15e3], rel=1e-3)
    else:
        assert found.values == pytest.approx(TRUTH[name], rel=1e-4)


@pytest.mark.campaign
@laws
def test_noisy_fits_end_well(name):
    found = fitted(name, curves_of(name, ABSOLUTE, 5))
    assert found.converged
    assert found.scatter == pytest.approx(1.0, abs=0.2)
    assert all(run < 2.0 for run in found.runs.values())


@pytest.mark.campaign
@pytest.mark.parametrize(
    ("name", "error"),
    sampled([("yeoh", "50Pa"), ("yeoh", "constant"), ("yeoh", "auto"), ("gent", "auto"), ("mooney-rivlin", "50Pa")]),
)
def test_intervals_cover_the_truth(name, error):
    """250 noisy repeats of one uniaxial test: the 95 % intervals of every parameter hold the truth in 90 to 99 %.

    The noise is constant, so that "auto", which takes it to grow with the stress, is a mistaken weighting.
    """
    hits = np.zeros(len(TRUTH[name]))
    for seed in range(250):
        choice, stated = LawChoice.from_text(name), StressError.from_text(error)
        sources, _ = residuals_of(curves_of(name, ABSOLUTE, seed, modes=("uniaxial",), count=40), choice, stated)
        found = fit_parameters(sources, choice.parameters(TRUTH[name]), errors="stated" if stated.stated else "unknown")
        for i, (parameter, truth) in enumerate(TRUTH[name].items()):
            low, high = found.interval(parameter)
            hits[i] += low <= truth <= high
    shares = dict(zip(TRUTH[name], hits / 250, strict=True))
    assert all(0.90 <= share <= 0.99 for share in shares.values()), shares


def test_a_wrong_law_has_wide_intervals_and_long_runs():
    """A hundred points on a curve that a law misses are not a hundred independent witnesses."""
    curve = curves_of("yeoh", 20.0, 1, modes=("uniaxial",), count=200)
    wrong, right = fitted("neo-hookean", curve, "constant"), fitted("yeoh", curve, "constant")
    assert wrong.runs["uniaxial (uniaxial)"] > 20 > 2 > right.runs["uniaxial (uniaxial)"]
    naive = wrong.scatter / np.sqrt(np.sum(wrong.jacobian**2))
    assert wrong.error("shear_modulus") > 4 * naive


def test_gauge_error_widens_the_modulus_and_nothing_else():
    """With 3 % on the cross-section, no fit knows the modulus of one test better than 3 %."""
    curves = curves_of("yeoh", 20.0, 2, modes=("uniaxial",))
    plain, gauged = fitted("yeoh", curves, "20Pa"), fitted("yeoh", curves, "20Pa", 0.03)
    assert plain.error("c1") / 8e3 < 0.005
    assert gauged.error("c1") / 8e3 == pytest.approx(0.03, rel=0.1)
    assert gauged.values["c1"] == pytest.approx(plain.values["c1"], rel=1e-3)
    assert unseen(gauged)[0] == "gauge1 depends on its prior: without it, its interval would be wider"
    assert not any("do not determine" in text for text in unseen(gauged))


def test_profile_ends_where_the_law_does():
    """Gent's limit cannot lie below the largest I1 - 3 measured, whatever the data say of its upper end."""
    curve = curves_of("gent", 2000.0, 3, top=3.0, modes=("uniaxial",))
    likelihood = profile(fitted("gent", curve, "2kPa"), "limit")
    assert likelihood.interval[0] >= largest_strain(curve) > 5.0
    assert likelihood.interval[1] > 60.0


def test_uniaxial_data_do_not_see_the_limit_of_soft_chains():
    """Below stretch 1.3 a Gent law's taut chains are out of sight, and the fit says so."""
    found = fitted("gent", curves_of("gent", ABSOLUTE, 3, top=1.3, modes=("uniaxial",)))
    assert any("limit" in text for text in (*unseen(found), *found.troubles))


def test_changes():
    curves = curves_of("yeoh", ABSOLUTE, 4)
    fixed = fitted("yeoh", curves, changes={"c3": {"start": 0.0, "fixed": True}})
    assert fixed.values["c3"] == 0.0 and [p.name for p in fixed.free] == ["c1", "c2"] and fixed.error("c3") == 0.0
    bound = fitted("yeoh", curves, changes={"c2": {"upper": 50.0}})
    assert bound.values["c2"] == pytest.approx(50.0) and "c2 ended at its bound 50 Pa" in bound.troubles
    prior = fitted("yeoh", curves, changes={"c1": {"prior": Prior(9e3, 0.1)}})
    assert prior.values["c1"] == pytest.approx(9e3, rel=1e-2)
    with pytest.raises(FitError, match="yeoh has no parameter 'mu'"):
        fitted("yeoh", curves, changes={"mu": {"fixed": True}})


def test_a_fit_says_where_it_hangs_on_poisson_s_ratio():
    """A rubber fitted with 0.49: the note has what a fit with 0.5, the default, finds."""
    (curve,) = curves_of("yeoh", 5.0, 7, top=3.0, modes=("uniaxial",))
    given, rubber = (fit_curves(curve, "yeoh", FitOptions(profiles=False, poisson=nu)).chosen for nu in (0.49, 0.5))
    assert fit_curves(curve, "yeoh", FitOptions(profiles=False)).chosen.material == rubber.material
    (note,) = given.judgement.notes
    assert "given as 0.49" in note and "--poisson 0.5" in note and not rubber.judgement.notes
    value, unit = note.partition("c2 about ")[2].split()[:2]
    about = float(value) * {"Pa": 1.0, "kPa": 1e3}[unit]
    assert about == pytest.approx(rubber.fit.values["c2"], rel=0.03)
    assert abs(given.fit.values["c2"] / about - 1) > 0.2


def test_other_sources_join():
    """A source that is no curve shares the law's parameters and brings its own."""

    class Scale:
        label, parameters, unit, errors = "balance", ("shear_modulus", "offset"), "Pa", 10.0

        def evaluate(self, values, derivatives):
            r = np.array([values["shear_modulus"] + values["offset"] - 20.5e3, values["offset"] - 500.0]) / 10.0
            return r, np.array([[0.1, 0.1], [0.0, 0.1]]), ["balance", "balance"]

    choice = LawChoice.from_text("neo-hookean")
    offset = Parameter("offset", "Pa", 0.0, -1e4, 1e4)
    sources, _ = residuals_of(curves_of("neo-hookean"), choice, StressError(0.0, ABSOLUTE, True))
    joint = fit_law_to_curves(choice, sources, Extra([Scale()], [offset]), errors="stated")
    assert joint.values == pytest.approx({"shear_modulus": 20e3, "offset": 500.0})
    assert set(joint.summaries) == {"balance", *(source.label for source in sources)}
    alone = fit_law_to_curves(choice, [], Extra([Scale()], [offset]), errors="stated")
    assert alone.values["shear_modulus"] == pytest.approx(20e3)


def test_robust_fit_leaves_a_slipping_grip_out():
    (curve,) = curves_of("yeoh", 30.0, 6, modes=("uniaxial",), count=80)
    stress = curve.stress.copy()
    stress[40:45] -= 20e3
    slipped = TensileCurve("slip", "uniaxial", curve.stretch, stress)
    plain, robust = (fitted("yeoh", [slipped], "constant", loss=loss) for loss in ("linear", "soft_l1"))
    assert abs(robust.values["c1"] - 8e3) < 100.0 < abs(plain.values["c1"] - 8e3)


@pytest.mark.parametrize("text", ["rubber", "ogden5", "ogden0", "yeoh0", "ogden-00", "yeoh2", ""])
def test_unknown_laws(text):
    with pytest.raises(FitError, match=r"known are|at most 4 terms"):
        LawChoice.from_text(text)


def test_a_fitted_material_warns_beyond_the_stretch_it_was_fitted_to(tmp_path):
    """As a named silicone does; by the report, and by the file that goes into a simulation."""
    (curve,) = curves_of("yeoh", noise=20.0, top=3.0, modes=("uniaxial",))
    report = fit_curves(curve, "yeoh", FitOptions(profiles=False))
    assert report.material.fitted_stretch == (curve.stretch[0], 3.0)
    narrow = fit_curves(curve, "yeoh", FitOptions(profiles=False), stretch=(1.02, 2.0))
    assert narrow.material.fitted_stretch == (curve.stretch[0], curve.stretch[curve.stretch <= 2.0][-1])
    write_materials(report, tmp_path)
    read = material_from(str(tmp_path / "fitted.toml"), {})
    assert read.fitted_stretch == pytest.approx(report.material.fitted_stretch, rel=1e-12)
    for material in (report.material, read, Case.from_toml(case_of(read).to_toml()).material):
        (note,) = stretch_notes(case_of(material), PathTable.read([{"max_stretch": 1.0}, {"max_stretch": 4.18}]))
        assert "the largest stretch, 4.18, exceeds 3, the end of the fitted range of this yeoh law" in note
        assert not list(stretch_notes(case_of(material), PathTable.read([{"max_stretch": 2.9}])))


def case_of(material):
    return Case("disk", HollowDisk(), material, steps=steps_of(pressure_cm=(10.0,)))


GOOD, FINE = np.linspace(1.0, 3.0, 21), np.linspace(1.02, 3.0, 21)
WRONG = {
    "a stretch in percent": (
        100 * GOOD,
        25e3 * (GOOD - GOOD**-2),
        "a stretch of 300 is more than .* percent, divide them by 100",
    ),
    "a strain in percent": (100 * (GOOD - 1), 25e3 * (GOOD - GOOD**-2), "a stretch of 200 is more than"),
    "a strain": (GOOD - 1, 25e3 * (GOOD - GOOD**-2), "not above zero; values starting at 0 are strains"),
    "a strain from 2 % on": (FINE - 1, 25e3 * (FINE - FINE**-2), "these seem to be strains; add 1"),
    "stress in MPa": (GOOD, 0.025 * (GOOD - GOOD**-2), "a factor 1000"),
    "an offset": (GOOD, 25e3 * (GOOD - GOOD**-2 + 9), "subtract the load cell's offset"),
    "unequal": (GOOD, GOOD[1:], "21 stretches but 20 stresses"),
    "nothing": ([], [], "the curve is empty"),
    "a hole": (GOOD, [*GOOD[1:], float("nan")], "must be a finite number"),
    "words": (["a"] * 4, [1.0] * 4, "not a number"),
    "unsorted": (GOOD[[0, 2, 1, 3, 4, 5]], GOOD[:6] - 1, "does not rise"),
}


@pytest.mark.parametrize("what", WRONG)
@pytest.mark.parametrize("door", [fit_curves, prepared, lambda curve: score(NeoHookean(25e3, 0.5), curve)])
def test_every_door_refuses_what_the_command_refuses(door, what):
    """A stretch in percent was fitted with 451 Pa for 25 kPa, sound."""
    stretch, stress, words = WRONG[what]
    with pytest.raises(TensileError, match=words):
        door(TensileCurve("pull", "uniaxial", stretch, stress))
    assert prepared(TensileCurve("pull", "uniaxial", list(GOOD), list(25e3 * (GOOD - GOOD**-2))))
