"""Which pixels are shadow: colours that are known, masks of drawn shadows, and pictures that hold none."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2

from measurement.outline.profiles import chi_square_limit, find_shadow, learn_colour, robust_covariance
from measurement.pictures import Unmeasurable
from measurement.series.checks import exposure

DARK, LIT = np.array([0.08, 0.09, 0.11]), np.array([0.7, 0.68, 0.6])
NOISE = np.array([[4.0, 1.0, 0.0], [1.0, 3.0, 1.0], [0.0, 1.0, 5.0]]) * 1e-5


def samples(mean, count=4000, seed=0):
    return np.random.default_rng(seed).multivariate_normal(mean, NOISE, count)


def picture(shadow, uneven=0.0, seed=0):
    rng = np.random.default_rng(seed)
    light = np.where(shadow[..., None], DARK, LIT) + rng.normal(0.0, 0.006, (*shadow.shape, 3))
    x = np.linspace(-1.0, 1.0, shadow.shape[1])
    return np.float32(np.clip(light * (1.0 - uneven * x**2)[None, :, None], 0.0, 1.0))


def hill(height=70):
    rows, columns = np.indices((200, 300))
    return rows > 170 - height * np.exp(-(((columns - 150) / 50.0) ** 2))


def test_robust_covariance_is_right_for_normal_samples_and_ignores_lines():
    data = samples(DARK, 20_000)
    data[::8] = [0.02, 0.02, 0.02]
    centre, covariance = robust_covariance(data)
    assert centre == pytest.approx(DARK, abs=5e-4)
    assert covariance == pytest.approx(NOISE, abs=1e-5)


def test_distance_follows_chi_square_and_share_is_linear_in_light():
    assert chi_square_limit() == pytest.approx(chi2.ppf(0.999, 3))
    colour = learn_colour(samples(DARK), samples(LIT, seed=1))
    for part in (0.0, 0.25, 0.5, 1.0):
        assert colour.share(DARK + part * (LIT - DARK)) == pytest.approx(part, abs=2e-3)
    assert colour.contrast == pytest.approx(1.0 - DARK.sum() / LIT.sum(), abs=1e-3)
    inside = colour.distance(samples(DARK, seed=2)) ** 2 < chi_square_limit()
    assert inside.mean() > 0.99
    assert colour.distance(LIT) > 30.0


@pytest.mark.parametrize("uneven", [0.0, 0.5])
def test_a_drawn_shadow_is_found(uneven):
    shadow = hill()
    found = find_shadow(picture(shadow, uneven))
    assert (found.mask != shadow).mean() < 2e-3
    known = find_shadow(picture(shadow), known=DARK)
    assert (known.mask != shadow).mean() < 2e-3


def test_grid_lines_specks_and_reflections_are_no_edges():
    shadow = hill()
    light = picture(shadow)
    light[:, 40:43] *= 0.4
    light[20:25, 200:205] *= 0.1
    light[180:188, 100:112] = LIT
    assert (find_shadow(light, line_px=4.0).mask != shadow).mean() < 3e-3


def test_pictures_without_one_shadow():
    two = hill()
    two[:60, 20:90] = True
    with pytest.raises(Unmeasurable, match="several shadows"):
        find_shadow(picture(two))
    for shadow in (np.zeros((200, 300), bool), np.ones((200, 300), bool)):
        with pytest.raises(Unmeasurable, match=r"no shadow|contrast|scatter"):
            find_shadow(picture(shadow))
    with pytest.raises(Unmeasurable, match="contrast is too low: the shadow takes away 20%"):
        learn_colour(samples(0.8 * LIT), samples(LIT))


def judged(light):
    return next(exposure(SimpleNamespace(traced=SimpleNamespace(small=light))), None)


def test_exposure():
    assert judged(picture(hill())) is None
    for light, reason in ((0.01 * picture(hill()), "underexposed"), (2.0 * picture(hill()), "overexposed")):
        doubt = judged(np.clip(light, 0.0, 1.0))
        assert doubt.rejects and reason in doubt.verdict
