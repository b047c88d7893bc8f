"""Bumps narrower than a membrane can bend: doubted if they are high, in the stated error if they are low."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from measurement.outline.zero import ZeroLine, highest_ripple
from measurement.series.checks import membrane, unsure_of


def edge(bump=0.0, place=2e-3, noise=1.5e-6, seed=0):
    """A bulge of 20 mm width and 4 mm height, a point every 50 um, with a thing of 0.6 mm length and this height on it."""
    x = np.linspace(-14e-3, 14e-3, 561)
    rise = 4e-3 * np.clip(1.0 - (x / 10e-3) ** 2, 0.0, None) ** 3
    thing = bump * np.exp(-0.5 * ((x - place) / 0.25e-3) ** 2)
    return np.column_stack([x, rise + thing + np.random.default_rng(seed).normal(0.0, noise, len(x))])


def check_ripples(placed):
    flat = ZeroLine.through(np.array([[0.0, 0.0], [1.0, 0.0]]))
    error = np.full(len(placed), 2e-6)
    return next(
        membrane(SimpleNamespace(raw=placed, ripple=highest_ripple(placed), placed=placed, error=error, zero=flat)),
        None,
    )


def unsure(placed):
    return unsure_of(highest_ripple(placed))


@pytest.mark.parametrize("seed", range(10))
def test_a_smooth_edge_is_trusted_as_it_is(seed):
    placed = edge(seed=seed)
    assert check_ripples(placed) is None
    assert unsure(placed) == 0.0


@pytest.mark.parametrize("place", [-4e-3, 0.0, 2e-3])
@pytest.mark.parametrize("bump", [20e-6, -20e-6])
def test_a_low_bump_is_trusted_and_widens_the_stated_error(bump, place):
    placed = edge(bump, place)
    assert check_ripples(placed) is None
    # A polynomial over a few millimetres follows a part of it.
    assert 0.2 * abs(bump) < unsure(placed) < 0.6 * abs(bump)


@pytest.mark.parametrize(("bump", "name"), [(80e-6, "bump of"), (-80e-6, "hollow of")])
def test_a_high_one_is_doubted(bump, name):
    doubt = check_ripples(edge(bump))
    assert name in str(doubt)
    assert unsure(edge(bump)) > 20e-6


def test_a_flat_surface_a_little_below_the_zero_plane_is_no_second_thing():
    x = np.linspace(-14e-3, 14e-3, 561)
    assert check_ripples(np.column_stack([x, np.full(561, -20e-6)])) is None
