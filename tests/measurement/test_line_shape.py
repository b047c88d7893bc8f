"""Lines out of focus: their shape from a measured profile, and what their blur does to an edge that they cross."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.special import ndtr

from measurement.camera import Camera
from measurement.photographer import lens_of, photograph, truth_of
from measurement.screen.grid import find_grid
from measurement.screen.look import LineShape
from measurement.screen.setup import Setup
from measurement.series.measuring import outline_of, trace_image, zero_of
from tests.support.photographs.bench import Bench
from tests.support.photographs.verdict import across

STEP = 0.005


@pytest.mark.parametrize(("width", "blur", "penumbra", "off"), [(2.0, 1.5, 1.0, 0.7), (4.0, 1.0, 2.0, -1.0)])
def test_the_blurred_product_is_the_product_of_the_blurred_and_their_covariance(width, blur, penumbra, off):
    x = np.arange(-20.0, 20.0, STEP)
    shadow, ink = ndtr(x / penumbra), 1.0 - 0.4 * (np.abs(x - off) < 0.5 * width)
    together, apart, line = (gaussian_filter1d(value, blur / STEP) for value in (shadow * ink, shadow, ink))
    edge, shape = np.hypot(blur, penumbra), LineShape(width, 0.4, blur)
    assert shape.through(x - off) == pytest.approx(line, abs=1e-3)
    rest = shape.covariance(x - off, x / edge, np.full_like(x, blur / edge))
    assert np.abs(together - apart * line).max() > 0.02
    assert rest == pytest.approx(together - apart * line, abs=5e-4)


def test_lines_square_to_the_edge_leave_it_where_it_is():
    off = np.linspace(-3.0, 3.0, 50)
    assert LineShape(2.0, 0.4, 1.0).covariance(off, off, np.zeros(50)) == pytest.approx(0.0, abs=1e-15)


def profiles(*lines, end=0.9):
    """Distances and profiles as they are measured: relative to their ends, and without the faintest ink."""
    distance = np.linspace(0.0, end, 81)
    inks = np.array([line.through(distance) for line in lines])
    inks /= inks[:, distance > end * 2 / 3].mean(axis=1, keepdims=True)
    return distance, np.minimum(np.where(1.0 - inks > 0.01, inks, 1.0), 1.0)


@pytest.mark.parametrize("blur", [0.02, 0.08, 0.15])
def test_the_shape_of_lines_is_found(blur):
    lines = LineShape(0.4, 0.35, blur), LineShape(0.5, 0.35, blur)
    for found, line in zip(LineShape.fitted(*profiles(*lines)), lines, strict=True):
        assert found.blur == pytest.approx(blur, rel=0.05)
        assert found.depth == pytest.approx(0.35, rel=0.1)
        assert found.width == pytest.approx(line.width, rel=0.1)


def test_lines_much_narrower_than_their_blur_still_tell_the_blur():
    found, _ = LineShape.fitted(*profiles(LineShape(0.3, 0.3, 0.27), LineShape(0.3, 0.3, 0.27)))
    assert found.blur == pytest.approx(0.27, rel=0.1)


def test_no_lines_have_no_shape():
    distance = np.linspace(0.0, 1.0, 81)
    assert LineShape.fitted(distance, np.ones((2, 81))) == (None, None)
    inks = np.array([LineShape(0.3, 0.3, 0.05).through(distance), np.ones(81)])
    assert [line is None for line in LineShape.fitted(distance, inks)] == [False, True]


@pytest.mark.parametrize("blur", [4.0, 9.2])
def test_grid_lines_do_not_move_an_edge_that_is_out_of_focus(blur):
    bench, height = Bench.random(28), 1.8e-3
    truth, scene = truth_of(bench.scene), bench.scene
    camera = Camera(truth.matrix, lens_of(scene.distortion), scene.width, scene.height, "known", 0.0)
    plane = find_grid(photograph(scene, None, 1)[0], camera, scene.grid_pitch).plane(camera)
    setup = Setup(camera, plane, grid_pitch=scene.grid_pitch)
    blurred = dataclasses.replace(scene, blur=blur)
    raised = trace_image(photograph(blurred, bench.polygon(height), 2)[0], setup)
    zero = zero_of(trace_image(photograph(scene, bench.polygon(0.0), 3)[0], setup, likely=raised.tone))
    rest = across(bench, truth, setup, outline_of(raised, zero, 1e3, 5.0, "blurred"), height)
    # 37 um where the ink is only divided out; 16 and 7 um where what it draws is taken for the shape.
    assert np.abs(rest).max() < 14e-6
    assert np.sqrt(np.mean(rest**2)) < 5e-6
