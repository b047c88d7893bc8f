"""All ways to a setup, from photograph to file through the command: the map's mean error over the frame, and the stated one."""

from __future__ import annotations

import re

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from measurement.__main__ import main
from measurement.camera import Exif, frame_points, lens_profile
from measurement.photographer import Scene, chessboard, dome, photograph, save, truth_of
from measurement.screen.setup import Setup
from tests.support.campaigns import sampled
from tests.support.photographs.boards import charuco

DOME = dome(0.005, floor=-0.003)
THESIS = {"maker": "Canon", "camera": "Canon EOS 550D", "lens": "EF-S18-55mm f/3.5-5.6 IS", "focal_mm": 35.0}


def run(*arguments):
    done = CliRunner().invoke(main, [str(argument) for argument in arguments])
    assert not isinstance(done.exception, Exception), done.exception
    return done


def misses(setup, truth):
    """Distances (n,) in um over the frame on the screen, up to whole crossings, and standardised ones."""
    frame = frame_points(setup.camera.width, setup.camera.height)
    found, true = setup.to_metres(frame) * setup.magnification, truth.to_screen(frame)
    step = setup.grid_pitch or 1.0
    off = found - true
    off -= np.rint(np.median(off, axis=0) / step) * step
    far = np.linalg.norm(off, axis=1)
    return far * 1e6, far / np.sqrt(2.0) / (setup.error(frame, 0.0) * setup.magnification)


def made(path, tmp_path, *options):
    done = run("setup", path, *options, "-o", tmp_path / "setup.toml")
    assert done.exit_code == 0, done.output
    assert re.search(r"(crossings|corners|known points), residual to the plane [\d.]+ um .rms", done.stdout)
    return Setup.from_file(tmp_path / "setup.toml")


VIEWS = {
    "straight": ({}, 1.0),
    "tilted": ({"tilt": 20.0}, 1.0),
    "oblique": ({"tilt": 40.0}, 2.0),
    "oblique from the side and rolled": ({"pan": 40.0, "roll": 15.0}, 2.0),
    "rolled": ({"roll": -15.0}, 1.0),
    "small frame": ({"width": 1024, "height": 683, "focal_px": 2000.0}, 2.0),
    "close": ({"width": 2592, "height": 1728, "pixel_size": 20e-6, "focal_px": 6000.0, "blur": 1.6}, 0.5),
}


@pytest.mark.parametrize("view", sampled(VIEWS, ("straight",)))
def test_grid(view, tmp_path):
    options, mean = VIEWS[view]
    # In a small frame a shadow would leave too few lines.
    image, truth = photograph(Scene(**options), None if view == "small frame" else DOME)
    setup = made(save(tmp_path / "grid.jpg", image), tmp_path, "--lens", "none")
    far, standardised = misses(setup, truth)
    assert far.mean() < mean  # um
    assert np.sqrt(np.mean(standardised**2)) < 2.0


@pytest.mark.campaign
def test_grid_in_a_whole_frame_of_18_megapixels(tmp_path):
    scene = Scene(width=5184, height=3456, pixel_size=10e-6, focal_px=12000.0, blur=3.0, tilt=15.0, jpeg_quality=None)
    image, truth = photograph(scene, DOME)
    far, standardised = misses(made(save(tmp_path / "grid.jpg", image), tmp_path, "--lens", "none"), truth)
    assert far.mean() < 1.0  # um
    assert np.sqrt(np.mean(standardised**2)) < 2.0


@pytest.mark.parametrize("target", sampled(["chessboard", "charuco"]))
@pytest.mark.parametrize("tilt", sampled([30.0, 0.0]))
def test_boards(target, tilt, tmp_path):
    scene = Scene(pixel_size=80e-6, tilt=tilt, pan=10.0, focal_px=2000.0)
    path = save(tmp_path / "board.png", {"chessboard": chessboard, "charuco": charuco}[target](scene))
    setup = made(path, tmp_path, "--lens", "none", "--target", target, "--pattern", "9x6", "--grid-pitch", "8mm")
    assert setup.grid_pitch is None  # there is no grid to look for behind the shadows
    frame = frame_points(1200, 800)
    off = setup.to_metres(frame) - truth_of(scene).to_screen(frame)
    off -= np.rint(np.median(off, axis=0) / 0.004) * 0.004
    assert np.linalg.norm(off, axis=1).mean() < 3e-6
    assert np.sqrt(np.mean(np.sum(off**2, axis=1) / 2.0 / setup.error(frame, 0.0) ** 2)) < 2.5


def test_known_points(tmp_path):
    """Six points picked to half a pixel, as in the thesis; the stated error holds over pickings."""
    image, truth = photograph(Scene(tilt=25.0), DOME)
    path, rng, ratios = save(tmp_path / "grid.jpg", image), np.random.default_rng(0), []
    for _ in range(5):
        options = []
        for x, z in [(-18, -9), (0, -9), (18, -9), (-18, 9), (0, 9), (18, 9)]:
            u, v = truth.to_pixels([[x / 1e3, z / 1e3]])[0] + rng.normal(0.0, 0.5, 2)
            options += ["--point", f"{u:.3f},{v:.3f}={x}mm,{z}mm"]
        far, standardised = misses(made(path, tmp_path, "--lens", "none", *options), truth)
        ratios.append(np.mean(standardised**2))
        assert far.mean() < 60.0  # um, 1.5 px
    assert 0.4 < np.sqrt(np.median(ratios)) < 2.0
    four = [options[number] for number in (0, 1, 4, 5, 6, 7, 10, 11)]
    assert misses(made(path, tmp_path, "--lens", "none", *four), truth)[0].mean() < 80.0


def test_scale_and_lamp(tmp_path):
    path = save(tmp_path / "any.png", np.full((300, 400, 3), 200, np.uint8))
    done = run("setup", path, "--lens", "none", "--scale", "25px/mm +- 0.05px/mm", "--origin", "100,200",
               "--lamp-distance", "2m+-5cm", "--screen-distance", "4cm+-1mm", "-o", tmp_path / "s.toml")  # fmt: skip
    assert done.exit_code == 0, done.output
    assert "magnification 1.0200 +- 0.0007" in done.stdout
    setup = Setup.from_file(tmp_path / "s.toml")
    assert np.allclose(setup.to_metres([[100.0, 200.0], [125.0, 150.0]]) * 1.02, [[0.0, 0.0], [1e-3, 2e-3]])
    error = setup.error([[350.0, 200.0]], 0.0, [1.0, 0.0])[0]
    assert error == pytest.approx(0.01 / 1.02 * np.hypot(0.05 / 25, setup.magnification_error / 1.02), rel=1e-6)


@pytest.mark.campaign
@pytest.mark.parametrize("focal", sampled([18.0, 35.0]))
def test_lens_from_exif_through_the_command(focal, tmp_path):
    """A photograph bent by lensfun's own map for what its EXIF names, against its truth with and without the lens."""
    scene = Scene(width=1500, height=1000, focal_px=4000.0, pixel_size=40e-6, tilt=10.0)
    image, truth = photograph(scene, DOME)
    lens = lens_profile(Exif(THESIS["maker"], THESIS["camera"], THESIS["lens"], focal), 1500, 1000)
    y, x = np.indices((1000, 1500)).astype(float)
    ideal = lens.undistort(np.column_stack([x.ravel(), y.ravel()])).reshape(1000, 1500, 2).astype(np.float32)
    bent = cv2.remap(image, ideal, None, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    path = save(tmp_path / "IMG_0001.JPG", bent, {**THESIS, "focal_mm": focal}, quality=97)
    setup = made(path, tmp_path, "--lens", "auto")
    assert setup.camera.source.endswith(f"at {focal:g} mm")
    raw = frame_points(1500, 1000)
    straight = lens.undistort(raw)
    kept = np.isfinite(straight).all(axis=1)
    off = setup.to_metres(raw[kept]) - truth.to_screen(straight[kept])
    far = np.linalg.norm(off - np.rint(np.median(off, axis=0) / 0.009) * 0.009, axis=1)
    assert far.mean() < 2e-6
    if focal == 18.0:  # strong barrel: left out, the grid itself tells
        assert "crossings to a regular grid" in run("setup", path, "--lens", "none", "-o", tmp_path / "no.toml").stderr
        assert not (tmp_path / "no.toml").exists()
