"""Gaps in an edge: what was measured stays what it is, what was not is called so, and its error opens with the gap."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from measurement.outline.edge import Edge, smoothed
from measurement.outline.zero import ZeroLine, highest_ripple
from measurement.series.checks import membrane

RADIUS, SPACING, NOISE = 900.0, 3.0, 0.06


def arc(hidden=0.0, seed=0):
    """An edge on a circle of 900 px, ``hidden`` px of it missing in the middle."""
    rng = np.random.default_rng(seed)
    s = np.arange(-600.0, 600.0, SPACING)
    s = s[np.abs(s) > 0.5 * hidden]
    normal = np.column_stack([np.sin(s / RADIUS), np.cos(s / RADIUS)])
    px = normal * (RADIUS + rng.normal(0.0, NOISE, len(s)))[:, None]
    one = np.ones(len(s))
    return Edge(px, normal, NOISE * one, one, one, 0.0)


def off(line):
    return np.linalg.norm(line.px, axis=1) - RADIUS


def test_an_edge_without_a_gap_has_no_bridge():
    line = smoothed(arc(), 400.0)
    assert not line.bridged.any()
    assert 0.5 < np.mean((off(line) / line.error) ** 2) < 1.5


@pytest.mark.parametrize("seed", range(3))
def test_a_speck_that_takes_four_points_is_smoothed_over(seed):
    edge = arc(4.2 * SPACING, seed)
    line = smoothed(edge, 400.0)
    assert len(line.px) == len(edge.px) == 395
    assert not line.bridged.any()
    assert np.abs(off(line)).max() < 4.0 * NOISE


@pytest.mark.parametrize("hidden", [30.0, 100.0, 250.0])
def test_a_gap_is_bridged_by_points_that_say_so_and_the_others_stay(hidden):
    line = smoothed(arc(hidden), 400.0)
    assert line.bridged.sum() == pytest.approx(hidden / SPACING, abs=6)
    across = np.abs(line.px[:, 0]) < 0.5 * hidden - SPACING
    assert line.bridged[across].all()
    # Smoothing over the gap would draw the points beside it into it, by a good part of its sagitta.
    assert np.abs(off(line)[~line.bridged]).max() < 5 * NOISE
    assert np.all(np.abs(off(line)[line.bridged]) < 3.0 * line.error[line.bridged])
    assert np.linalg.norm(line.normal, axis=1) == pytest.approx(1.0)


def test_the_error_opens_with_the_square_of_the_gap():
    greatest = [smoothed(arc(hidden), 800.0).error.max() for hidden in (200.0, 400.0)]
    assert greatest[0] > 5.0 * NOISE
    assert greatest[1] > 3.0 * greatest[0]


def test_a_gap_that_is_too_long_stays_open():
    line = smoothed(arc(500.0), 400.0)
    assert not line.bridged.any()
    assert np.linalg.norm(np.diff(line.px, axis=0), axis=1).max() > 490.0


def outline(bump=0.0, length=6e-3, seed=0):
    """A dome 4 mm high, ``bump`` of which is a fibre that lies along its top."""
    x = np.arange(-13e-3, 13e-3, 60e-6)
    z = 4e-3 * np.clip(1.0 - (x / 12e-3) ** 2, 0.0, None) ** 3 + np.random.default_rng(seed).normal(0.0, 2e-6, len(x))
    return np.column_stack([x, z + bump * (np.abs(x) < 0.5 * length)])


def check_ripples(placed):
    flat = ZeroLine.through(np.array([[0.0, 0.0], [1.0, 0.0]]))
    error = np.full(len(placed), 2e-6)
    return next(
        membrane(SimpleNamespace(raw=placed, ripple=highest_ripple(placed), placed=placed, error=error, zero=flat)),
        None,
    )


@pytest.mark.parametrize("seed", range(5))
def test_a_step_of_a_fibre_is_no_membrane_and_a_dome_is_one(seed):
    assert check_ripples(outline(seed=seed)) is None
    assert "narrower than a membrane can bend" in str(check_ripples(outline(60e-6, seed=seed)))
    place, height, _ = highest_ripple(outline(60e-6, seed=seed)[::-1])
    assert abs(abs(outline()[::-1][place, 0]) - 3e-3) < 0.5e-3
    assert abs(height) > 12e-6
