"""A screen that bulges in one place: told from noise and dust, and counted for the edge beside it."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from measurement.screen.look import GridLook, flatness
from measurement.series.checks import flat

PITCH, NOISE = 9e-3, 4e-6
EDGE = np.column_stack([np.linspace(-0.01, 0.01, 50), np.full(50, 1e-3)])


def look(bulge=0.0, dust=0, noise=NOISE, seed=0):
    """Places along the lines of a screen 54 mm wide, moved as a whole, and by a bulge about (2 mm, 3 mm)."""
    rng = np.random.default_rng(seed)
    along = np.arange(-27e-3, 27e-3, 0.75e-3)
    lines = np.arange(-2, 3) * PITCH
    place = np.array([[(line, at), (at, line)] for line in lines for at in along]).reshape(-1, 2)
    axis = np.tile([0, 1], len(lines) * len(along))
    far = np.linalg.norm(place - [2e-3, 3e-3], axis=1)
    shift = 5e-6 + 4e-5 * place[:, 0] + bulge * np.exp(-0.5 * (far / 4e-3) ** 2) + rng.normal(0.0, noise, len(axis))
    shift[rng.integers(0, len(axis), dust)] += 200e-6
    bare = np.ones((2, 3))
    return GridLook(PITCH, 1.0, place, shift, axis, bare, np.linspace(0.0, 1.0, 3), ({}, {}))


def found(looks, points):
    seen = flatness(looks, points)
    return seen.error, next(flat(SimpleNamespace(traced=SimpleNamespace(flatness=seen))), None)


@pytest.mark.parametrize("seed", range(5))
def test_a_flat_screen_and_dust_are_no_bulge(seed):
    error, doubt = found([look(dust=6, seed=seed)], EDGE)
    assert doubt is None
    assert np.median(error) < 3e-6


@pytest.mark.parametrize("seed", range(5))
def test_a_bulge_beside_the_edge_is_stated_and_doubted(seed):
    error, doubt = found([look(bulge=100e-6, seed=seed)], EDGE)
    assert "the screen bulges" in doubt.verdict
    assert error.max() > 25e-6
    assert np.argmax(error) == pytest.approx(30, abs=10)


def test_a_bulge_far_from_the_edge_is_not_its_matter():
    error, doubt = found([look(bulge=100e-6)], EDGE - np.array([0.0, 30e-3]))
    assert doubt is None
    assert error.max() < 10e-6


def test_faint_lines_in_the_shadow_have_an_error_of_their_own():
    looks = [look(), look(noise=30e-6, seed=1)]
    noise = flatness(looks, EDGE).noise
    assert noise.max() > 5.0 * noise.min()
    assert found(looks, EDGE)[1] is None
