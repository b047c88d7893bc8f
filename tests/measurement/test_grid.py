"""The grid found without a click, against the photographer's truth; and pictures in which none may be found."""

from __future__ import annotations

import functools

import cv2
import numpy as np
import pytest

from measurement.camera import Camera
from measurement.photographer import Scene, dome, photograph
from measurement.screen.calibration import find_charuco, find_chessboard
from measurement.screen.grid import GridError, find_grid

DOME = dome(0.006, floor=-0.002)
VIEWS = {
    "straight": {},
    "tilted": {"tilt": 20.0, "pan": 10.0},
    "oblique": {"tilt": 40.0},
    "oblique the other way": {"pan": -40.0, "roll": 8.0},
    "bent by the lens": {"tilt": -25.0, "pan": 25.0, "distortion": (-0.25, 0.08, 1e-3, -1e-3)},
}
CONDITIONS = {
    "clean": {},
    "shadow": {"outline": DOME},
    "shadow, noise, blur, dust, uneven light": {
        "outline": DOME, "noise": 8.0, "blur": 2.0, "dust": 30, "unevenness": 0.5, "jpeg_quality": 80,
    },
}  # fmt: skip


@functools.cache
def shot(view, condition, seed=0):
    options = {**VIEWS[view], **CONDITIONS[condition]}
    outline = options.pop("outline", None)
    image, truth = photograph(Scene(**options), outline, seed)
    camera = Camera(truth.matrix, truth.distortion, truth.scene.width, truth.scene.height, "truth", 0.0)
    return image, truth, camera


@pytest.mark.parametrize("condition", CONDITIONS)
@pytest.mark.parametrize("view", VIEWS)
def test_grid_is_found_and_its_residual_is_its_error(view, condition):
    image, truth, camera = shot(view, condition)
    grid = find_grid(image, camera, 0.009)
    plane = grid.plane(camera)
    assert len(grid.px) >= 8
    # The grid's own count must be the screen's, up to which crossing is called the origin.
    numbers = truth.to_screen(grid.px) / 0.009
    shift = np.rint(numbers - grid.indices)
    assert np.ptp(shift, axis=0).max() == 0
    error = (truth.to_screen(grid.px) - (grid.indices + shift) * 0.009) * 1e6
    rms = np.sqrt(np.mean(np.sum(error**2, axis=1)))
    assert rms < (12.0 if "noise" in condition else 4.0)
    assert 0.4 * rms - 0.2 < plane.residual * 1e6 < 2.0 * rms + 0.2
    # In the middle of the grid, the screen itself is known to a micrometre or so.
    middle = camera.distort(plane.points.mean(axis=0))
    missed = plane.to_metres(camera.undistort(middle)) + shift[0] * 0.009 - truth.to_screen(middle)
    assert np.abs(missed).max() < 3e-6


def test_origin_is_the_crossing_nearest_to_the_middle_or_to_the_pixel_given():
    image, truth, camera = shot("tilted", "clean")
    grid = find_grid(image, camera)
    assert np.abs(truth.to_screen(grid.px) - grid.indices * 0.009).max() < 1e-4
    right = truth.to_pixels([[0.009, 0.009]])[0]
    moved = find_grid(image, camera, origin=(right[0] + 20.0, right[1] - 20.0))
    assert np.array_equal(moved.indices, grid.indices - 1)


@pytest.mark.parametrize(
    ("pitch", "line", "pixel"), [(0.009, 0.0009, 40e-6), (0.002, 0.0002, 40e-6), (0.001, 1e-4, 40e-6)]
)
def test_wide_and_narrow_grids(pitch, line, pixel):
    image, truth = photograph(Scene(grid_pitch=pitch, line_width=line, pixel_size=pixel, tilt=15.0), None)
    camera = Camera(truth.matrix, truth.distortion, 1200, 800, "truth", 0.0)
    grid = find_grid(image, camera, pitch)
    assert np.abs(truth.to_screen(grid.px) - grid.indices * pitch).max() < 0.01 * pitch


def test_residual_tells_of_a_lens_left_out():
    image, _, _ = shot("bent by the lens", "clean")
    with pytest.raises(GridError, match="residual of the crossings to a regular grid"):
        find_grid(image, Camera.ideal(1200, 800))


def blank():
    return np.full((600, 900), 200, np.uint8)


def noise():
    return np.random.default_rng(0).normal(150, 30, (600, 900)).clip(0, 255).astype(np.uint8)


def stripes():
    image = blank()
    image[:, ::90] = image[:, 1::90] = image[:, 2::90] = 120
    return image


def shadow_only():
    return photograph(Scene(line_grey=0.0), DOME)[0]


def too_blurred():
    return photograph(Scene(blur=80.0), None)[0]


def too_few():
    return photograph(Scene(pixel_size=20e-6), None)[0]


def one_crossing():
    return photograph(Scene(pixel_size=12e-6), None)[0]


def chessboard():
    squares = (np.indices((600, 900)) // 60).sum(axis=0) % 2
    return cv2.GaussianBlur(np.uint8(40 + 180 * squares), (0, 0), 1.0)


def random_lines():
    image, rng = blank(), np.random.default_rng(3)
    for _ in range(25):
        (x0, x1), (y0, y1) = rng.integers(0, 900, 2), rng.integers(0, 600, 2)
        cv2.line(image, (int(x0), int(y0)), (int(x1), int(y1)), 120, 3, cv2.LINE_AA)
    return image


def rings():
    far = np.hypot(*(np.indices((600, 900)) - np.array([300, 450])[:, None, None]))
    return np.where(far % 60 < 4, 120, 200).astype(np.uint8)


def uneven_spacing():
    image = blank()
    for x in (50, 130, 320, 371, 600, 655, 860):
        image[:, x : x + 4] = 120
    for y in (40, 100, 290, 345, 560):
        image[y : y + 4] = 120
    return image


def diagonal():
    return photograph(Scene(roll=45.0), None)[0]


def tiny():
    return np.zeros((8, 8), np.uint8)


UNUSABLE = {
    blank: "blank", noise: "no grid", stripes: "no grid", shadow_only: "no grid", too_blurred: "no grid|blank|blurred",
    too_few: "fewest|crossings", one_crossing: "fewest|crossings|no grid", chessboard: "fewest", random_lines: "too few places",
    rings: "too faint or too blurred", uneven_spacing: "only 0 crossings", diagonal: "45 degrees", tiny: "32 x 32",
}  # fmt: skip


@pytest.mark.parametrize("picture", UNUSABLE, ids=lambda picture: picture.__name__)
def test_refused_with_the_reason(picture):
    with pytest.raises(GridError, match=UNUSABLE[picture]):
        find_grid(picture())


def test_picture_of_another_camera_is_refused():
    with pytest.raises(GridError, match="do not crop"):
        find_grid(blank(), Camera.ideal(640, 480))
    with pytest.raises(GridError, match="positive"):
        find_grid(blank(), pitch=0.0)


def test_boards():
    squares = cv2.copyMakeBorder(
        np.uint8(40 + 180 * ((np.indices((420, 600)) // 60).sum(axis=0) % 2)), *[60] * 4, 0, value=[230]
    )
    board = find_chessboard(cv2.GaussianBlur(squares, (0, 0), 1.0), (9, 6), Camera.ideal(720, 540))
    assert len(board.px) == 54
    assert board.residual_px < 0.1
    # The first index counts to the right and the second upwards, 60 px each.
    steps = np.linalg.lstsq(np.column_stack([board.indices, np.ones(54)]), board.px)[0][:2]
    assert np.allclose(steps, [[60.0, 0.0], [0.0, -60.0]], atol=0.1)
    with pytest.raises(GridError, match="no chessboard"):
        find_chessboard(blank())
    print_ = cv2.aruco.CharucoBoard((7, 5), 1.0, 0.75, cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50))
    picture = print_.generateImage((840, 600), marginSize=20)
    picture[:200, :200] = 90  # a part may be covered
    found = find_charuco(picture, (7, 5), camera=Camera.ideal(840, 600))
    assert 12 <= len(found.px) < 24
    assert found.residual_px < 0.2
    with pytest.raises(GridError, match="0 corners"):
        find_charuco(blank(), (7, 5))
    with pytest.raises(GridError, match="dictionary"):
        find_charuco(blank(), (7, 5), dictionary="NO_SUCH")
