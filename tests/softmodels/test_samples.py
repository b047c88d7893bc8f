"""Several specimens of one silicone: the law is their mean, intervals and band come from the scatter between them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import t as student

from softmodels.common import units
from softmodels.fitting.curves.curve import TensileCurve
from softmodels.fitting.curves.fit import fit_curves
from softmodels.fitting.problem import FitOptions
from softmodels.materials import specimens

TRUE = np.array([60e3, 25e3])  # Pa
STRETCH = np.linspace(1.0, 2.5, 41)


def stress(c, stretch):
    """Nominal stress in Pa of an incompressible Mooney-Rivlin solid, closed form."""
    return 2 * (stretch - stretch**-2) * (c[0] + c[1] / stretch)


def curve(name, c, stretch=STRETCH, noise=0.0):
    return TensileCurve(name, "uniaxial", stretch, stress(c, stretch) + noise)


def test_interval_and_band_are_students_of_the_specimens():
    factors = np.array([0.95, 1.0, 1.07, 0.98])
    curves = [curve(f"s{i}", factor * TRUE) for i, factor in enumerate(factors)]
    law = fit_curves(curves, "mooney-rivlin", FitOptions(gauge_error=0.0)).chosen
    mean, error = factors.mean(), factors.std(ddof=1)
    half = student.ppf(0.975, 3) * error / 2
    assert law.fit.values["c10"] == pytest.approx(mean * TRUE[0], rel=2e-3)
    assert law.interval("c10") == pytest.approx(TRUE[0] * (mean + np.array([-half, half])), rel=3e-3)
    response = specimens.respond(law.material, np.array([2.0]), parameters=law.errors.names)
    band = units.HALF_WIDTH_95 * np.linalg.norm(response.slopes @ law.errors.roots, axis=1)[0]
    expected = student.ppf(0.975, 3) * error * np.sqrt(1 + 1 / 4) * stress(TRUE, 2.0)
    assert band == pytest.approx(expected, rel=0.02)


def test_the_load_cell_is_common_to_all():
    """Its error does not fall with the number of specimens."""
    curves = [curve(f"s{i}", factor * TRUE) for i, factor in enumerate([0.9999, 1.0, 1.0001] * 4)]
    law = fit_curves(curves, "mooney-rivlin").chosen
    low, high = law.interval("c10")
    assert (high - low) / 2 / TRUE[0] == pytest.approx(1.96 * 0.01, rel=0.02)


def test_a_specimen_is_followed_by_its_own_factor():
    """Scatter between specimens is no misfit of the law, another shape of a curve is."""
    curves = [curve(f"s{i}", factor * TRUE) for i, factor in enumerate([0.9, 1.0, 1.1])]
    assert not fit_curves(curves, "mooney-rivlin").chosen.fit.excess
    curves.append(TensileCurve("s3", "uniaxial", STRETCH, stress(TRUE, STRETCH) * (0.6 + 0.4 * (STRETCH - 1))))
    fit = fit_curves(curves, "mooney-rivlin").chosen.fit
    assert list(fit.excess) == ["s3 (uniaxial)"] and any("does not follow s3" in trouble for trouble in fit.troubles)


def test_a_specimen_that_differs_is_named():
    factors = [1.0, 1.02, 0.99, 1.01, 1.3]
    curves = [curve(f"strip {i}", factor * TRUE) for i, factor in enumerate(factors)]
    said = "; ".join(fit_curves(curves, "mooney-rivlin").notes)
    assert "strip 4 differs from the other specimens: its stress is 1.29 times theirs" in said
    assert "differs" not in "; ".join(fit_curves(curves[:4], "mooney-rivlin").notes)


def test_a_slack_specimen_is_one_of_the_sample():
    """Its slack is its own: the interval of the law stays what the scatter makes it."""
    factors = [0.95, 0.98, 1.07, 1.0]
    curves = [curve(f"s{i}", factor * TRUE) for i, factor in enumerate(factors)]
    slack = np.r_[np.linspace(1.0, 1.05, 12), STRETCH[1:] + 0.05]
    loose = TensileCurve("s3", "uniaxial", slack, np.r_[np.zeros(12), stress(factors[3] * TRUE, STRETCH[1:])])
    tight, with_slack = (fit_curves([*curves[:3], last], "mooney-rivlin").chosen for last in (curves[3], loose))
    assert with_slack.sound and with_slack.fit.values["slack4"] == pytest.approx(0.05, abs=3e-3)
    assert with_slack.interval("c10") == pytest.approx(tight.interval("c10"), rel=0.05)


def test_a_robust_sample_and_a_set_factor():
    random = np.random.default_rng(3)
    curves = [curve(f"s{i}", factor * TRUE, noise=random.normal(0.0, 300.0, 41)) for i, factor in enumerate([0.97, 1.0, 1.03])]
    curves[0] = TensileCurve("s0", "uniaxial", STRETCH, curves[0].stress + 40e3 * (np.arange(41) == 20))
    plain, robust = (fit_curves(curves, "mooney-rivlin", FitOptions(robust=r)).chosen.fit for r in (False, True))
    assert robust.loss == "soft_l1" and plain.loss == "linear" and robust.values != plain.values
    fixed = fit_curves(curves, "mooney-rivlin", FitOptions(changes={"gauge1": {"start": 1.0, "fixed": True}}))
    assert "gauge2" in fixed.chosen.fit.values


def test_two_specimens_are_no_sample():
    report = fit_curves([curve("a", TRUE), curve("b", 1.02 * TRUE)], "mooney-rivlin")
    assert not report.notes and "gauge2" in report.chosen.fit.values


@pytest.mark.campaign
def test_intervals_hold_the_mean_and_bands_a_new_specimen():
    """200 samples of 3 to 6 specimens with 5 % scatter between them, a load cell with 1 %, and noise."""
    random = np.random.default_rng(5)

    def drawn():
        return TRUE * (1 + 0.05 * random.normal()) * (1 + np.array([0.01, 0.03]) * random.normal(size=2))

    means, bands = [], []
    for k in range(200):
        cell = 1 + 0.01 * random.normal()
        curves = []
        for i in range(3 + k % 4):
            stretch = np.linspace(1.0, random.uniform(2.2, 2.6), 41)
            curves.append(curve(f"s{i}", cell * drawn(), stretch, random.normal(0.0, 300.0, 41)))
        law = fit_curves(curves, "mooney-rivlin").chosen
        for name, true in zip(("c10", "c01"), TRUE, strict=True):
            low, high = law.interval(name)
            means.append(low <= true <= high)
        for stretch in (1.2, 2.0):
            response = specimens.respond(law.material, np.array([stretch]), parameters=law.errors.names)
            half = units.HALF_WIDTH_95 * np.linalg.norm(response.slopes @ law.errors.roots, axis=1)[0]
            bands.append(abs(response.stress[0] - stress(drawn(), stretch)) <= half)
    assert 0.93 <= np.mean(means) <= 0.98 and 0.92 <= np.mean(bands) <= 0.98, (np.mean(means), np.mean(bands))
