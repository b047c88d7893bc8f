"""The body's width as the scale of photographs: its measurement, and what it says of a run."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from measurement.camera import Camera
from measurement.outline.outline import Outline
from measurement.outline.zero import Sides, ZeroLine, sides_of, with_known_body
from measurement.screen.setup import Plane, Setup, SetupError
from measurement.series.checks import Evidence, scaling
from measurement.series.witness import Run

HEIGHTS = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0]) * 1e-3
RIGHT = ZeroLine.through(np.array([[0.0, 0.0], [1.0, 0.0]]))


def body(width=30e-3, lean=0.0, noise=2e-6, bottom=-4e-3):
    """Edge of a body: left side, surface, right side; and the cosines of its normals to the surface's."""
    rng = np.random.default_rng(0)
    z = np.arange(bottom, 0.0, 60e-6)
    x = 0.5 * width + 0.5 * lean * z
    flat = np.arange(-0.5 * width, 0.5 * width, 60e-6)
    edge = np.vstack([np.column_stack([-x, z]), np.column_stack([flat, 0.0 * flat]), np.column_stack([x, z])[::-1]])
    upwards = np.r_[0.0 * z, np.ones(len(flat)), 0.0 * z]
    return edge + rng.normal(0.0, noise, edge.shape), upwards, np.full(len(edge), noise)


def test_the_width_is_that_of_the_sides():
    sides = sides_of(*body(lean=0.02))
    assert sides.width_at(0.0) == pytest.approx(30e-3, abs=5e-6)
    assert 0.0 < sides.error < 3e-6
    assert sides_of(*body(bottom=-0.5e-3)) is None


def run(larger, heights=HEIGHTS):
    x = np.linspace(-1e-2, 1e-2, 41)
    return [
        Outline(x, height * (1 - (x / 1e-2) ** 2), np.full(41, 1e-6), 1e5 * height, 1.0, f"{height}", scale=1.0 + by)
        for height, by in zip(heights, np.broadcast_to(larger, len(heights)), strict=True)
    ]


def scaling_doubts(outlines):
    run = Run(dict(enumerate(outlines)))
    found = [next(scaling(Evidence(run=run, number=k)), None) for k in range(len(outlines))]
    return [doubt and str(doubt) for doubt in found]


def test_a_body_that_stood_still_is_trusted_and_so_is_one_whose_sides_give_way():
    assert scaling_doubts(run(0.0)) == [None] * 6
    assert scaling_doubts(run(1e-4 * np.array([0, 1, -1, 1, -1, 0]))) == [None] * 6
    assert scaling_doubts(run(4.0 * HEIGHTS)) == [None] * 6


def test_a_body_that_was_moved_after_the_zero_is_trusted_nowhere():
    found = scaling_doubts(run(np.r_[0.0, np.full(5, 0.005)]))
    assert found[0] is None
    assert all("0.50% farther apart" in doubt and "along the light since the zero" in doubt for doubt in found[1:])


def test_a_body_that_was_moved_once_is_not_trusted_there():
    found = scaling_doubts(run(np.array([0.0, 0.0, 0.0, -0.008, 0.0, 0.0])))
    assert [doubt is None for doubt in found] == [True, True, True, False, True, True]
    assert "0.80% nearer" in found[3]
    assert "for this one" in found[3]


def test_two_photographs_cannot_tell_a_soft_side_from_a_moved_body():
    assert "or its sides deform" in scaling_doubts(run(0.01, np.array([0.0, 3e-3])))[1]


def test_a_known_width_gives_the_magnification():
    corners = np.array([[0, 0], [100, 0], [100, 100], [0, 100], [50, 50]], dtype=float)
    setup = Setup(Camera.ideal(200, 200), Plane.fit(corners, corners * 1e-4, 0.01), grid_pitch=9e-3)
    zero = dataclasses.replace(RIGHT, sides=sides_of(*body(width=30.6e-3)))
    known = with_known_body(setup, zero, 30e-3, 15e-6)
    assert known.magnification == pytest.approx(1.02, abs=1e-4)
    assert known.magnification_error == pytest.approx(1.02 * 15e-6 / 30e-3, rel=0.1)
    with pytest.raises(SetupError, match="another body or another unit"):
        with_known_body(setup, zero, 30e-6)
    with pytest.raises(SetupError, match="does not show both sides"):
        with_known_body(setup, RIGHT, 30e-3)


def test_a_width_that_contradicts_pitch_and_distances_is_refused():
    zero = ZeroLine.through(np.array([[-0.01, 0.0], [0.01, 0.0]]))
    zero = dataclasses.replace(zero, sides=Sides(-1e-3, 30.6e-3, 0.0, 2e-6))
    corners = np.array([[0, 0], [100, 0], [100, 100], [0, 100], [50, 50]], dtype=float)
    setup = Setup(Camera.ideal(200, 200), Plane.fit(corners, corners * 1e-4, 0.01), grid_pitch=9e-3)
    known = dataclasses.replace(setup, magnification=1.02, magnification_error=0.001, pitch_error=0.002)
    with pytest.raises(SetupError, match=r"differ by \+2.00%.*measure the pitch"):
        with_known_body(known, zero, 30e-3)
    # With no distance given nothing contradicts it, and the width is the unit of length.
    free = with_known_body(dataclasses.replace(known, magnification=1.0, magnification_error=0.0), zero, 30e-3)
    assert (free.magnification, free.pitch_error) == (pytest.approx(1.02), 0.0)
