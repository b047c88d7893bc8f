"""The grid found without a click, against the photographer's truth; and pictures in which none may be found."""

from __future__ import annotations

import dataclasses
import functools

import cv2
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.special import ndtr

from measurement.camera import Camera
from measurement.photographer import Scene, dome, lens_of, photograph, truth_of
from measurement.screen.calibration import find_charuco, find_chessboard
from measurement.screen.grid import GridError, find_grid
from measurement.screen.look import LineShape
from measurement.screen.setup import Plane, PlaneError, Setup
from measurement.series.measuring import outline_of, trace_image, zero_of
from tests.support.campaigns import sampled
from tests.support.photographs.bench import Bench
from tests.support.photographs.verdict import across

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


@pytest.mark.parametrize("condition", sampled(CONDITIONS, list(CONDITIONS)[2:]))
@pytest.mark.parametrize("view", sampled(VIEWS))
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


@pytest.mark.campaign
def test_origin_is_the_crossing_nearest_to_the_middle_or_to_the_pixel_given():
    image, truth, camera = shot("tilted", "clean")
    grid = find_grid(image, camera)
    assert np.abs(truth.to_screen(grid.px) - grid.indices * 0.009).max() < 1e-4
    right = truth.to_pixels([[0.009, 0.009]])[0]
    moved = find_grid(image, camera, origin=(right[0] + 20.0, right[1] - 20.0))
    assert np.array_equal(moved.indices, grid.indices - 1)


@pytest.mark.parametrize(
    ("pitch", "line", "pixel"), sampled([(0.009, 0.0009, 40e-6), (0.002, 0.0002, 40e-6), (0.001, 1e-4, 40e-6)])
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
REPEATED_REASONS = {noise, shadow_only, too_blurred, too_few}
"""Refused with the sentence of another one: in campaigns."""


@pytest.mark.parametrize("picture", sampled(UNUSABLE, UNUSABLE.keys() - REPEATED_REASONS), ids=lambda picture: picture.__name__)
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


# -- Lines out of focus: their shape from a measured profile, and what their blur does to an edge that they cross ----


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


@pytest.mark.campaign
@pytest.mark.parametrize("blur", sampled([4.0, 9.2]))
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


# -- The screen's homography and whether its stated errors are true --------------------------------------------------


TRUTH = truth_of(Scene(tilt=35.0, pan=-15.0, width=2400, height=1600, target=(0.002, 0.004)))
NODES = np.stack(np.meshgrid(np.arange(-3, 4), np.arange(-2, 3)), axis=-1).reshape(-1, 2) * 0.009
SEEN = TRUTH.to_pixels(NODES)
PLACES = np.random.default_rng(1).uniform([100, 100], [2300, 1500], (40, 2))


def test_points_without_error_are_fitted_exactly_there_and_back():
    plane = Plane.fit(SEEN, NODES)
    assert plane.residual < 1e-12
    assert np.abs(plane.to_metres(PLACES) - TRUTH.to_screen(PLACES)).max() < 1e-12
    assert np.abs(plane.to_pixels(plane.to_metres(PLACES)) - PLACES).max() < 1e-7
    assert np.linalg.norm(plane.homography) == pytest.approx(1.0)


def test_jacobian_against_differences():
    plane, step = Plane.fit(SEEN, NODES), 1e-3
    slope = plane.jacobian(PLACES)
    for axis in (0, 1):
        aside = step * np.eye(2)[axis]
        difference = (plane.to_metres(PLACES + aside) - plane.to_metres(PLACES - aside)) / (2 * step)
        assert np.abs(slope[:, :, axis] - difference).max() < 1e-6 * np.abs(slope).max()


@pytest.mark.parametrize("sigma", [0.05, None], ids=["error given", "error from the fit"])
def test_stated_errors_are_true(sigma):
    rng = np.random.default_rng(7)
    lengths = []
    for _ in range(50):
        plane = Plane.fit(SEEN + rng.normal(0.0, 0.05, SEEN.shape), NODES, sigma)
        missed = plane.to_metres(PLACES) - TRUTH.to_screen(PLACES)
        spread = plane.covariances(PLACES)
        lengths.append(np.einsum("ni,nij,nj->n", missed, np.linalg.inv(spread), missed) / 2.0)
    # Mean of 50 squared standardised residuals (two axes, strongly correlated over the places): 1 within 0.2.
    assert np.mean(lengths) == pytest.approx(1.0, abs=0.25)


def test_each_point_may_have_its_own_error():
    rng = np.random.default_rng(8)
    sigma = rng.uniform(0.02, 0.5, len(SEEN))
    lengths, flat = [], []
    for _ in range(50):
        noisy = SEEN + rng.normal(0.0, 1.0, SEEN.shape) * sigma[:, None]
        plane = Plane.fit(noisy, NODES, sigma)
        missed = plane.to_metres(PLACES) - TRUTH.to_screen(PLACES)
        lengths.append(np.einsum("ni,nij,nj->n", missed, np.linalg.inv(plane.covariances(PLACES)), missed) / 2.0)
        flat.append(np.sum((Plane.fit(noisy, NODES).to_metres(PLACES) - TRUTH.to_screen(PLACES)) ** 2) / np.sum(missed**2))
    assert np.mean(lengths) == pytest.approx(1.0, abs=0.25)
    assert np.median(flat) > 1.5  # weighing pays


def test_refused():
    line = np.column_stack([np.linspace(0, 1000, 8), np.linspace(0, 500, 8)])
    with pytest.raises(PlaneError, match="on a line"):
        Plane.fit(line, line * 1e-5)
    with pytest.raises(PlaneError, match="on a line"):
        Plane.fit(np.vstack([line, [500.0, 900.0]]), np.vstack([line, [500.0, 900.0]]) * 1e-5)
    with pytest.raises(PlaneError, match="give at least 5"):
        Plane.fit(SEEN[:4], NODES[:4])
    with pytest.raises(PlaneError, match="same point"):
        Plane.fit(np.ones((6, 2)), NODES[:6])
    with pytest.raises(PlaneError, match="35 points in the photograph but 34"):
        Plane.fit(SEEN, NODES[1:])
    with pytest.raises(PlaneError, match="finite"):
        Plane.fit(np.where(SEEN[0] == SEEN, np.nan, SEEN), NODES)
    with pytest.raises(PlaneError, match="must be positive"):
        Plane.fit(SEEN, NODES, 0.0)
    corners = np.array([0, 6, 28, 34])
    assert Plane.fit(SEEN[corners], NODES[corners], 0.1).residual < 1e-12


def test_focal_length_does_not_matter():
    """Lengths on the screen are the same whatever pinhole matrix an undistorted photograph is given."""
    first, second = Camera.ideal(2400, 1600), Camera.ideal(2400, 1600, 9000.0)
    a, b = (Plane.fit(camera.undistort(SEEN), NODES).to_metres(camera.undistort(PLACES)) for camera in (first, second))
    assert np.array_equal(a, b)


def test_what_neighbours_miss_in_common_is_no_noise():
    rng = np.random.default_rng(3)
    x, y = np.meshgrid(np.arange(9.0), np.arange(7.0))
    targets = np.column_stack([x.ravel(), y.ravel()]) * 5e-3
    px = targets * 2e4 + 300.0
    noisy = Plane.fit(px + rng.normal(0.0, 0.2, px.shape), targets)
    assert noisy.systematic < 0.3 * noisy.residual
    offset = px - px.mean(axis=0)
    bent = px + 0.3 * offset * (np.linalg.norm(offset, axis=1, keepdims=True) / 300.0) ** 2
    wrong = Plane.fit(bent, targets)
    assert wrong.systematic > 0.4 * wrong.residual
