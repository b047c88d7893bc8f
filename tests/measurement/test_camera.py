"""Lenses: OpenCV's and lensfun's models through points, EXIF, and real chessboards against their published calibration."""

from __future__ import annotations

from pathlib import Path

import cv2
import lensfunpy
import numpy as np
import pytest

from measurement.camera import Camera, CameraError, Exif, frame_points, lens_profile, read_exif
from measurement.photographer import Scene, save, truth_of
from measurement.screen.calibration import calibrate, find_chessboard

PUBLISHED_FOCAL = 535.91573396163199
"""From left_intrinsics.yml beside the boards (OpenCV's samples, 13 photographs)."""

THESIS = Exif("Canon", "Canon EOS 550D", "EF-S18-55mm f/3.5-5.6 IS", 35.0)
LENS = (-0.25, 0.08, 1e-3, -2e-3, 0.02)


@pytest.fixture(scope="module")
def boards(shared_data):
    return sorted(shared_data("chessboards").glob("left*.jpg"))


@pytest.fixture(scope="module")
def calibration(boards):
    return calibrate([*boards, __file__], (9, 6), 0.025)


def test_opencv_lens_there_and_back_and_as_the_photographer_bends_it():
    camera = Camera([[3000, 0, 1199.5], [0, 3000, 799.5], [0, 0, 1]], LENS, 2400, 1600, "test", 0.0)
    points = frame_points(2400, 1600)
    assert np.abs(camera.distort(camera.undistort(points)) - points).max() < 1e-6
    truth = truth_of(Scene(width=2400, height=1600, distortion=LENS, tilt=20.0))
    ideal = np.column_stack([truth.to_screen(points), np.ones(len(points))]) @ np.linalg.inv(truth.homography).T
    assert np.abs(camera.undistort(points) - ideal[:, :2] / ideal[:, 2:]).max() < 1e-5
    assert np.abs(camera.undistort(points) - points).max() > 5.0


def test_points_beyond_the_lens_are_not_numbers():
    camera = Camera([[500, 0, 320], [0, 500, 240], [0, 0, 1]], (-0.4, 0.0, 0.0, 0.0), 640, 480, "test", 0.0)
    found = camera.undistort([[320.0, 240.0], [2000.0, 240.0]])
    assert np.allclose(found[0], [320.0, 240.0])
    assert np.isnan(found[1]).all()


def test_ideal_camera_changes_nothing():
    points = frame_points(640, 480)
    assert np.array_equal(Camera.ideal(640, 480).undistort(points), points)
    assert np.array_equal(Camera.ideal(640, 480).distort(points), points)


@pytest.mark.parametrize("focal", [18.0, 26.0, 35.0, 55.0])
@pytest.mark.parametrize("size", [(5184, 3456), (3456, 5184), (1600, 1200)], ids=str)
def test_lensfun_is_repeated_through_points(focal, size, figure):
    width, height = size
    camera = lens_profile(THESIS, width, height, focal_mm=focal)
    database = lensfunpy.Database()
    body = database.find_cameras("Canon", "Canon EOS 550D")[0]
    lens = database.find_lenses(body, None, "Canon EF-S 18-55mm f/3.5-5.6 IS")[0]
    modifier = lensfunpy.Modifier(lens, body.crop_factor, width, height)
    modifier.initialize(focal, 8.0, 1000.0, scale=1.0, flags=lensfunpy.ModifyFlags.DISTORTION)
    rng = np.random.default_rng(0)
    points = np.vstack([rng.integers(0, [width, height], (300, 2)), [[0, 0], [width - 1, height - 1]]]).astype(float)
    wanted = np.array([modifier.apply_geometry_distortion(x, y, 1, 1)[0, 0] for x, y in points])
    against = "lensfun's own mapping, Canon EF-S 18-55 at 18 to 55 mm"
    figure(against, "there", camera.distort(points) - wanted, 0.0014, unit="px")
    figure(against, "and back", camera.undistort(wanted) - points, 0.0014, unit="px")
    assert camera.source == f"lensfun: Canon EOS 550D, Canon EF-S 18-55mm f/3.5-5.6 IS at {focal:g} mm"


def test_lens_profile_from_a_file_moves_pixels(shared_data):
    database = shared_data("lens") / "canon_efs_18-55_excerpt.xml"
    names = Exif("Canon", "Canon EOS 550D", "Canon EF-S 18-55mm f/3.5-5.6", 18.0)
    camera = lens_profile(names, 5184, 3456, database=database)
    moved = camera.undistort([[0.0, 0.0]])[0]
    assert np.hypot(*moved) > 20.0
    assert 0.0 < camera.error_px < 10.0


def test_camera_and_lens_from_exif(tmp_path):
    told = {
        "maker": "Canon",
        "camera": "Canon EOS 550D",
        "lens": "EF-S18-55mm f/3.5-5.6 IS",
        "focal_mm": 35.0,
    }
    path = save(tmp_path / "IMG_0001.JPG", np.full((40, 60, 3), 200, np.uint8), told)
    assert read_exif(path) == Exif("Canon", "Canon EOS 550D", "EF-S18-55mm f/3.5-5.6 IS", 35.0)
    assert lens_profile(path, 5184, 3456).as_table() == lens_profile(THESIS, 5184, 3456).as_table()


@pytest.mark.parametrize(
    ("names", "options", "reason"),
    [
        (Exif("Canon", "Canon EOS 550D", ""), {}, "does not name its lens"),
        (Exif("Canon", "Canon EOS 550D", THESIS.lens), {}, "has no focal length"),
        (Exif("Canon", "Canon EOS 9999X", THESIS.lens, 35.0), {}, "does not have the camera"),
        (Exif("Canon", "Canon EOS 550D", "EF-S 17-44mm f/9", 35.0), {}, "does not have the lens"),
        (THESIS, {"focal_mm": 100.0}, "from 18 to 55 mm, not 100 mm"),
        (THESIS, {"database": "/no/such.xml"}, "lens profile /no/such.xml cannot be read"),
        (Path("/no/such.jpg"), {}, "cannot be read as a photograph"),
    ],
)
def test_unknown_lenses_are_refused(names, options, reason):
    with pytest.raises(CameraError, match=reason):
        lens_profile(names, 5184, 3456, **options)


def test_photograph_without_exif_is_refused(tmp_path):
    with pytest.raises(CameraError, match="does not name its camera"):
        read_exif(save(tmp_path / "bare.jpg", np.full((40, 60, 3), 200, np.uint8)))


def test_broken_cameras_are_refused():
    good = Camera.ideal(640, 480).as_table()
    assert Camera.from_table(good).as_table() == good
    for change, reason in (
        ({"matrix": [[1, 0], [0, 1]]}, "3 x 3"),
        ({"model": "fish"}, "fish"),
        ({"distortion": [1.0, 2.0]}, "2 coefficients"),
        ({"error_px": -1.0}, "finite"),
        ({"width": 0}, "at least one pixel"),
        ({"matrix": "none"}, "cannot be read"),
        ({"source": None, "width": None}, "cannot be read"),
    ):
        with pytest.raises(CameraError, match=reason):
            Camera.from_table({**good, **change})
    with pytest.raises(CameraError, match="no field 'matrix'"):
        Camera.from_table({key: value for key, value in good.items() if key != "matrix"})


def test_real_chessboards_repeat_the_published_calibration(calibration):
    camera = calibration.camera
    assert camera.matrix[0, 0] == pytest.approx(PUBLISHED_FOCAL, rel=0.005)
    assert calibration.residual_px < 0.25
    assert len(calibration.per_image) == 7
    (why,) = calibration.refused.values()
    assert why.startswith("the file is not a readable picture")
    assert 0.0 < camera.error_px < 0.2


def test_rectified_boards(boards, calibration):
    """Mean distance of all corners from the board, fixed by its four outer corners, with and without the lens."""
    columns, rows = np.meshgrid(np.arange(9), np.arange(6))
    board = np.column_stack([columns.ravel(), rows.ravel()]) * 25.0
    outer = [0, 8, 45, 53]
    corrected, plain = [], []
    for path in boards:
        seen = find_chessboard(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)).px
        for points, errors in ((calibration.camera.undistort(seen), corrected), (seen, plain)):
            matrix = cv2.getPerspectiveTransform(np.float32(points[outer]), np.float32(board[outer]))
            mapped = cv2.perspectiveTransform(points.reshape(-1, 1, 2), matrix).reshape(-1, 2)
            errors.append(np.linalg.norm(mapped - board, axis=1).mean())
    assert max(corrected) < 0.45  # mm
    assert min(plain) > 0.9


def test_too_few_boards_are_refused(boards):
    with pytest.raises(CameraError, match="needs 3 or more usable photographs of the board, but has 2"):
        calibrate(boards[:2])
    with pytest.raises(CameraError, match="no chessboard with 7 x 5"):
        calibrate(boards[:3], (7, 5))
