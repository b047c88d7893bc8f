"""Cameras from boards: corners without the lens' bias, errors that are true, and what the command tells of real boards."""

from __future__ import annotations

import re

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from measurement.__main__ import main
from measurement.camera import Camera
from measurement.photographer import Scene, chessboard, truth_of
from measurement.screen import calibration
from measurement.screen.calibration import corner_reach, find_chessboard, straightened_corners
from tests.support.campaigns import sampled

POSES = [(20, 0), (-25, 10), (5, 30), (10, -30), (-15, -20), (0, 35), (30, 5), (-30, -10)]
LENSES = {"two terms": (-0.2, 0.04), "all terms": (-0.2, 0.04, 1e-3, -1e-3, 0.1)}


def scene(tilt, pan, lens, pixel_size):
    return Scene(width=900, height=600, focal_px=1000.0, pixel_size=pixel_size, tilt=tilt, pan=pan, distortion=lens)


def seen_camera(lens):
    truth = truth_of(scene(0, 0, lens, 1e-4))
    return Camera(truth.matrix, truth.distortion, 900, 600, "truth", 0.0)


@pytest.mark.campaign
def test_corners_are_where_they_are_whatever_the_lens_bends():
    """Measured: 0.016 px without, 0.001 px with straightened windows."""
    missed = {"bent": [], "straightened": []}
    for pose in POSES[:4]:
        view = scene(*pose, LENSES["two terms"], 1e-4)
        image, truth = chessboard(view, noise=0.0), truth_of(view)
        bent = find_chessboard(image, (9, 6)).px
        straight = straightened_corners(image[..., 0], bent, seen_camera(view.distortion), corner_reach(bent))
        for name, found in (("bent", bent), ("straightened", straight)):
            places = truth.to_screen(found) / 0.008
            corners = np.floor(places) + 0.5 if abs(places[0, 1] % 1 - 0.5) < 0.2 else np.rint(places)
            nearest = np.column_stack([np.rint(places[:, 0]), corners[:, 1]])
            missed[name].append(found - truth.to_pixels(nearest * 0.008))
    rms = {name: float(np.sqrt(np.mean(np.square(parts)))) for name, parts in missed.items()}
    assert rms["straightened"] < 0.003
    assert rms["bent"] > 4 * rms["straightened"]


@pytest.mark.parametrize("lens", sampled(LENSES))
@pytest.mark.parametrize(("poses", "pixel_size"), [(5, 1e-4), (8, 0.7e-4)], ids=["middle only", "to the corners"])
def test_stated_errors_are_true(monkeypatch, lens, poses, pixel_size):
    """Standardised misses of undistorted points are about 1 from the middle out to corners where no board was seen."""
    camera, rng = seen_camera(LENSES[lens]), np.random.default_rng(0)
    board = calibration._board((9, 6), 0.008)
    truths = [truth_of(scene(*pose, LENSES[lens], pixel_size)) for pose in POSES[:poses]]
    corners = [truth.to_pixels((board[:, :2] - [0.032, 0.02]) * [1, -1]) for truth in truths]
    lengths = []
    for _ in range(10):
        noisy = [view + rng.normal(0.0, 0.05, view.shape) for view in corners]
        made = calibration.calibrated_from(noisy, board, (900, 600))
        moved = calibration._ring_distances(made, camera, min(1.0, calibration.reached(noisy, (900, 600)).max()))
        lengths.append(moved / made.errors_px[:, None])
        assert 0.0 < made.error_px <= made.errors_px.max()
    assert 0.5 < np.sqrt(np.mean(np.square(lengths))) < 1.4
    assert 2.0 * made.errors_px[0] < made.errors_px[-1]


def test_errors_by_distance_are_kept_in_files():
    camera = Camera(np.eye(3) + np.diag([900, 900, 0]), np.zeros(5), 901, 601, "test", 0.1, errors_px=[0.1, 0.1, 0.9])
    again = Camera.from_table(camera.as_table())
    assert again.as_table() == camera.as_table()
    assert again.error([[450, 300], [0, 0], [450 + 0.75 * 450, 300 + 0.75 * 300]]) == pytest.approx([0.1, 0.9, 0.5])
    assert Camera.ideal(901, 601).error([[0, 0]]) == [0.0]


def test_command_tells_of_real_boards(tmp_path, shared_data, figure):
    calibration = sorted(shared_data("chessboards").glob("left*.jpg"))
    output = tmp_path / "camera.toml"
    done = CliRunner().invoke(main, ["calibrate", *map(str, calibration), __file__, "--pitch", "25mm", "-o", str(output)])
    assert done.exit_code == 3
    assert len(re.findall(r"left\d\d.jpg: 0\.\d\d px", done.stdout)) == 7
    assert f"{__file__}: refused, the file is not a readable picture" in done.stderr
    against = "OpenCV's chessboards and published lens"
    figure(against, "focal length", float(re.search(r"fx ([\d.]+) px", done.stdout)[1]) / 535.916 - 1, 0.0055)
    figure(
        against,
        "reprojection error",
        float(re.search(r"reprojection error ([\d.]+) px", done.stdout)[1]),
        0.25,
        unit="px",
    )
    assert f"written to {output}" in done.stdout
    assert "Boards cover 73% of the distance" in done.stderr
    assert output.exists()


def sheet(square, width=2400, height=1600):
    """A photograph of a board turned by 12 degrees, soft and noisy."""
    squares = (np.indices((7, 10)).sum(axis=0) % 2 * 180 + 40).astype(np.uint8)
    board = np.pad(np.kron(squares, np.ones((40, 40), np.uint8)), 40, constant_values=220)
    turn = cv2.getRotationMatrix2D((board.shape[1] / 2, board.shape[0] / 2), 12.0, square / 40)
    turn[:, 2] += np.array([width, height]) / 2 - np.array(board.shape[::-1]) / 2
    seen = cv2.GaussianBlur(cv2.warpAffine(board, turn, (width, height), borderValue=220), (0, 0), 1.2)
    noise = np.random.default_rng(0).normal(0.0, 2.0, seen.shape)
    return np.clip(np.rint(seen + noise), 0, 255).astype(np.uint8)


@pytest.mark.parametrize(("square", "sides"), sampled([(20.0, [900, 2400]), (140.0, [900])]), ids=["small", "large"])
def test_boards_are_searched_in_reduced_pictures_first(monkeypatch, square, sides):
    """And have the corners that the whole picture gives; one too small there is searched in the whole picture."""
    searched, search = [], cv2.findChessboardCornersSB

    def watched(gray, *args, **options):
        searched.append(max(gray.shape))
        return search(gray, *args, **options)

    monkeypatch.setattr(cv2, "findChessboardCornersSB", watched)
    monkeypatch.setattr(calibration, "SEARCH_SIDES_PX", (900,))
    image = sheet(square)
    found = find_chessboard(image)
    assert searched == sides
    monkeypatch.setattr(calibration, "SEARCH_SIDES_PX", ())
    assert found.px == pytest.approx(find_chessboard(image).px, abs=0.01)


def test_progress_is_counted_for_every_photograph(tmp_path, shared_data):
    files, steps = sorted(shared_data("chessboards").glob("left*.jpg"))[:4], []
    calibration.calibrate(files, each=lambda: steps.append(1))
    assert len(steps) == calibration.STEPS_PER_PHOTOGRAPH * len(files)
    words = ["calibrate", *map(str, files), "-o", str(tmp_path / "camera.toml"), "--quiet"]
    done = CliRunner().invoke(main, words)
    assert done.exit_code == 0 and done.output == "" and (tmp_path / "camera.toml").is_file()
