"""The photographer against calculations of other kinds: light along a line, and pixels through OpenCV's own lens."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from PIL import Image
from scipy.optimize import brentq, curve_fit
from scipy.special import erf

from measurement.camera import read_exif
from measurement.photographer import Outline, Scene, SceneError, Truth, dome, dome_height, photograph, save, truth_of

CLEAN = {"noise": 0.0, "jpeg_quality": None, "unevenness": 0.0, "line_grey": 0.0}
LENS = (-0.2, 0.05, 1e-3, -1e-3, 0.01)


def opencv_pixels(truth: Truth, metres):
    """Pixels of places on the screen by OpenCV's projection: pose from the homography, lens from its definition."""
    pose = np.linalg.inv(truth.matrix) @ np.linalg.inv(truth.homography)
    places = np.column_stack([metres, np.ones(len(metres))]) @ pose.T
    return cv2.projectPoints(places, np.zeros(3), np.zeros(3), truth.matrix, truth.distortion)[0].reshape(-1, 2)


def test_truth_agrees_with_opencv():
    truth = truth_of(Scene(tilt=30.0, pan=-20.0, roll=4.0, distortion=LENS, target=(0.003, -0.002)))
    places = np.random.default_rng(0).uniform(-0.012, 0.012, (200, 2))
    seen = opencv_pixels(truth, places)
    assert np.abs(truth.to_pixels(places) - seen).max() < 1e-8
    assert np.abs(truth.to_screen(seen) - places).max() < 1e-12
    assert np.abs(truth.to_pixels([truth.scene.target]) - [599.5, 399.5]).max() < 1e-9


def test_camera_stands_where_the_scene_says():
    """Tilt looks from above (the upper part is nearer, so larger), pan from the right, roll turns clockwise."""

    def span(a, b, **pose):
        ends = truth_of(Scene(**pose)).to_pixels([a, b])
        return float(np.linalg.norm(ends[1] - ends[0]))

    assert span((-0.005, 0.005), (0.005, 0.005), tilt=30.0) > span((-0.005, -0.005), (0.005, -0.005), tilt=30.0)
    assert span((0.005, -0.005), (0.005, 0.005), pan=30.0) > span((-0.005, -0.005), (-0.005, 0.005), pan=30.0)
    turned = truth_of(Scene(roll=10.0)).to_pixels([[0.0, 0.0], [0.01, 0.0]])
    assert turned[1, 1] > turned[0, 1]
    assert span((0.0, 0.0), (0.001, 0.0)) == pytest.approx(0.001 / 40e-6)


@pytest.mark.parametrize(
    "pose", [{}, {"tilt": 40.0}, {"tilt": -20.0, "pan": 30.0, "distortion": LENS}], ids=["0", "40", "lens"]
)
def test_edge_lies_where_it_should(pose):
    """An error function fitted to pixels of columns crosses half light where OpenCV's projection has the outline."""
    scene = Scene(penumbra=120e-6, blur=1.0, magnification=1.02, **CLEAN, **pose)
    image, truth = photograph(scene, dome(0.006, radius=0.012))
    missed = []
    for column in range(200, 1001, 50):
        light = image[:, column, 1].astype(float)
        row = brentq(lambda y, x=column: height_over(truth, x, y), 0.0, 799.0)
        near = np.arange(max(0, int(row) - 18), min(800, int(row) + 19))
        fit, _ = curve_fit(edge, near, light[near], p0=(light[near].min(), light[near].max(), row + 0.3, 4.0))
        missed.append(fit[2] - row)
    assert np.abs(missed).max() < 0.1  # the outline's curvature moves single ones
    assert abs(np.mean(missed)) < 0.02


def test_straight_edge_to_a_fiftieth_of_a_pixel():
    for seed, (tilt, pan) in enumerate([(0.0, 0.0), (40.0, 0.0), (25.0, -30.0)]):
        height = 0.0011 + 1e-4 * seed
        floor = np.array([[-0.05, height], [0.05, height + 0.004], [0.05, -0.05], [-0.05, -0.05]])
        # A little noise, or rounding to whole values would shift every column alike.
        image, truth = photograph(Scene(penumbra=100e-6, tilt=tilt, pan=pan, **{**CLEAN, "noise": 1.0}), floor, seed)
        ends = opencv_pixels(truth, floor[:2] * 0.4 + (floor[0] + floor[1]) * 0.3)
        missed = []
        for column in range(250, 951, 5):
            row = np.interp(column, ends[:, 0], ends[:, 1])  # without distortion lines stay straight
            near = np.arange(int(row) - 15, int(row) + 16)
            fit, _ = curve_fit(edge, near, image[near, column, 1].astype(float), p0=(30.0, 200.0, row + 0.2, 3.0))
            missed.append(fit[2] - row)
        assert abs(np.mean(missed)) < 0.01
        assert np.std(missed) < 0.04  # the noise


def edge(y, dark, light, place, width):
    return dark + (light - dark) * 0.5 * (1.0 - erf((y - place) / width / np.sqrt(2.0)))


def height_over(truth, x, y):
    """Height of a pixel's place over the dome, by a search on OpenCV's forward projection (the truth only starts it)."""
    place = truth.to_screen([[x, y]])[0]
    assert np.abs(opencv_pixels(truth, place[None])[0] - [x, y]).max() < 1e-6
    place = place / truth.scene.magnification
    return place[1] - dome_height(place[0], 0.006, 0.012)


def test_grid_lines_lie_and_weigh_as_they_should():
    scene = Scene(**{**CLEAN, "line_grey": 0.4}, blur=0.0, line_width=0.0004)
    image, truth = photograph(scene)
    dark = 1.0 - image[150, :, 1] / image[150, 100, 1].astype(float)  # a row between two lines
    column = truth.to_pixels([[0.009, 0.0]])[0, 0]
    near = np.arange(int(column) - 12, int(column) + 13)
    assert dark[near].sum() == pytest.approx(0.4 * 0.0004 / 40e-6, rel=0.02)
    assert (dark[near] @ near) / dark[near].sum() == pytest.approx(column, abs=0.02)


def test_signed_distance_of_a_polygon():
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    places = np.array([[0.5, 0.5], [0.5, 1.2], [1.3, 1.4], [0.9, 0.5], [-0.1, -0.1], [1.001, 0.999], [0.999, 0.999]])
    wanted = [-0.5, 0.2, 0.5, -0.1, np.sqrt(0.02), 0.001, -0.001]
    for polygon in (square, square[::-1], np.vstack([square, square[:1]])):
        assert np.allclose(Outline(polygon, 0.03).distance(places), wanted)
    notch = np.array([[0, 0], [2, 0], [2, 2], [1, 0.5], [0, 2]])
    assert Outline(notch, 0.05).distance(np.array([[1.0, 0.6], [1.0, 0.4]])) == pytest.approx([0.0555, -0.1], abs=2e-3)


def test_noise_dust_and_seeds():
    plain = photograph(Scene(**CLEAN))[0]
    noisy, again, other = (photograph(Scene(**{**CLEAN, "noise": 5.0}), seed=seed)[0] for seed in (1, 1, 2))
    assert np.array_equal(noisy, again)
    assert not np.array_equal(noisy, other)
    assert np.std(noisy.astype(float) - plain) == pytest.approx(5.0, rel=0.02)
    assert photograph(Scene(**CLEAN, dust=20))[0].min() < plain.min() - 20


def test_saved_with_exif(tmp_path):
    image, _ = photograph(Scene(width=300, height=200))
    path = save(tmp_path / "a.jpg", image, {"camera": "Canon EOS 550D", "maker": "Canon", "lens": "L", "focal_mm": 35.0})
    assert read_exif(path).focal_mm == 35.0
    assert np.abs(np.asarray(Image.open(path)).astype(int) - image).mean() < 2.0
    assert np.array_equal(np.asarray(Image.open(save(tmp_path / "a.png", image))), image)
    with pytest.raises(SceneError, match="no field 'colour'"):
        save(tmp_path / "b.jpg", image, {"colour": 1})


def test_scenes_that_cannot_be():
    with pytest.raises(SceneError, match="horizon"):
        photograph(Scene(tilt=85.0))
    with pytest.raises(SceneError, match="bends so much"):
        photograph(Scene(distortion=(-9.0,)))
    with pytest.raises(SceneError, match="penumbra must be positive"):
        Scene(penumbra=0.0)
    with pytest.raises(SceneError, match="five coefficients"):
        Scene(distortion=(0.0,) * 6)
    with pytest.raises(SceneError, match="polygon"):
        photograph(Scene(), [[0.0, 0.0], [1.0, 1.0]])


@pytest.mark.campaign
def test_eighteen_megapixels():
    image, _ = photograph(Scene(width=5184, height=3456, focal_px=12000.0, pixel_size=10e-6, tilt=30.0), dome(0.006))
    assert image.shape == (3456, 5184, 3)
    assert 20 < image.mean() < 235 and np.ptp(image) > 100  # screen and shadow, neither black nor white alone
