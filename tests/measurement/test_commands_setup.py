"""The commands calibrate and setup, as typed: what they print, write and refuse."""

from __future__ import annotations

import re

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from measurement import cli
from measurement.__main__ import main
from measurement.photographer import Scene, chessboard, dome, photograph, save
from measurement.screen.setup import Setup

EXIF = {"maker": "Canon", "camera": "Canon EOS 550D", "lens": "EF-S18-55mm f/3.5-5.6 IS", "focal_mm": 40.0}


@pytest.fixture(scope="module")
def grid(tmp_path_factory):
    image, truth = photograph(Scene(tilt=20.0), dome(0.005, floor=-0.003))
    return save(tmp_path_factory.mktemp("photos") / "grid.jpg", image, EXIF), truth


def run(*arguments):
    done = CliRunner().invoke(main, [str(argument) for argument in arguments])
    assert not isinstance(done.exception, Exception), done.exception
    assert "Traceback" not in done.output
    return done


def test_setup_from_the_grid(grid, tmp_path):
    path, truth = grid
    output = tmp_path / "setup.toml"
    done = run("setup", path, "--lens", "none", "--roi", "0,0,1200,700", "--zero", "10,500=1100,500",
               "--lamp-distance", "2m+-5cm", "--screen-distance", "4cm", "-o", output)  # fmt: skip
    assert done.exit_code == 0, done.output
    assert re.search(r"crossings, residual to the plane [\d.]+ um .rms", done.output)
    assert "no lens correction" in done.output
    setup = Setup.from_file(output)
    assert setup.magnification == pytest.approx(1.02)
    assert setup.magnification_error == pytest.approx(0.04 * 0.05 / 4)
    assert setup.roi == (0.0, 0.0, 1200.0, 700.0)
    places = np.array([[300.0, 300.0], [900.0, 500.0]])
    assert np.abs(setup.to_metres(places) * 1.02 - truth.to_screen(places)).max() < 1e-5
    assert Image.open(tmp_path / "setup.png").size == (1200, 800)


def test_setup_with_the_lens_of_exif_or_by_name(grid, tmp_path):
    path, _ = grid
    for options in (("--lens", "auto"), ("--lens", "Canon EF-S 18-55mm f/3.5-5.6 IS II", "--focal", "40mm")):
        done = run("setup", path, *options, "-o", tmp_path / "setup.toml")
        assert done.exit_code == 0, done.output
        assert "lensfun: Canon EOS 550D, Canon EF-S 18-55mm" in done.output
        assert Setup.from_file(tmp_path / "setup.toml").camera.model == "lensfun"


def test_setup_from_known_points(grid, tmp_path):
    path, truth = grid
    places = [(x * 9, z * 9) for x in (-1, 0, 1) for z in (0, 1)]
    options = []
    for x, z in places:
        u, v = truth.to_pixels([[x / 1e3, z / 1e3]])[0]
        options += ["--point", f"{u:.2f},{v:.2f}={x}mm,{z}mm"]
    done = run("setup", path, "--lens", "none", *options, "-o", tmp_path / "setup.toml")
    assert done.exit_code == 0, done.output
    assert "6 known points, residual to the plane" in done.output
    setup = Setup.from_file(tmp_path / "setup.toml")
    assert setup.grid_pitch is None
    assert np.abs(setup.to_metres([[600.0, 300.0]]) - truth.to_screen([[600.0, 300.0]])).max() < 2e-6


@pytest.mark.parametrize(
    ("options", "status", "reason"),
    [
        (("--grid-pitch", "9"), 2, "has no unit"),
        (("--lens", "none", "--grid-pitch", "-9mm"), 2, "must be a positive length"),
        (("--lens", "No Such 10-20mm"), 2, "does not have the lens"),
        (("--lens", "missing.toml"), 2, "camera missing.toml cannot be read"),
        (("--lens", "missing.xml"), 2, "lens profile missing.xml cannot be read"),
        (("--lens", "none", "--roi", "1,2,3"), 2, "--roi needs 4 numbers"),
        (("--lens", "none", "--roi", "0,0,5000,5000"), 2, "region of interest"),
        (("--lens", "none", "--zero", "1,2"), 2, "two different points"),
        (("--lens", "none", "--zero", "1,2=1,2"), 2, "two different points"),
        (("--lens", "none", "--lamp-distance", "2m"), 2, "both --lamp-distance and --screen-distance"),
        (("--lens", "none", "--point", "1,2=9mm,9mm"), 2, "give at least 4"),
        (("--lens", "none", "--point", "1,2=9mm"), 2, "not a known point"),
        (("--lens", "none", "--origin", "middle"), 2, "--origin needs 2 numbers"),
        (("--focal", "100mm"), 2, "from 18 to 55 mm"),
        (("--lens", "none", "-o", "/no/such/folder/setup.toml"), 2, "cannot be written"),
    ],
)
def test_setup_refuses(grid, tmp_path, monkeypatch, options, status, reason):
    monkeypatch.chdir(tmp_path)
    done = run("setup", grid[0], *options)
    assert (done.exit_code, done.stdout) == (status, "")
    assert re.search(reason, done.stderr)
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "setup.toml").exists()


def test_unusable_photographs(tmp_path):
    blank = save(tmp_path / "blank.png", np.full((400, 600, 3), 200, np.uint8))
    for name, status, reason in (
        (blank, 2, "blank"),
        (tmp_path / "none.jpg", 2, "cannot be read"),
        (__file__, 2, "cannot be read"),
    ):
        done = run("setup", name, "--lens", "none", "-o", tmp_path / "setup.toml")
        assert (done.exit_code, done.stdout) == (status, "")
        assert re.search(reason, done.stderr)
    assert "does not name its camera" in run("setup", blank, "-o", tmp_path / "setup.toml").stderr


@pytest.mark.campaign
def test_calibrate_then_setup(tmp_path):
    """Boards drawn through the photographer's truth, calibrated, and the camera file used for a setup."""
    lens = (-0.2, 0.04)
    paths = []
    for number, (tilt, pan) in enumerate([(20, 0), (-25, 10), (5, 30), (10, -30), (-15, -20)]):
        image = chessboard(
            Scene(width=900, height=600, focal_px=1000.0, pixel_size=1.0e-4, tilt=tilt, pan=pan, distortion=lens)
        )
        paths.append(save(tmp_path / f"board{number}.png", image))
    done = run("calibrate", *paths, "--pattern", "9x6", "--pitch", "8mm", "-o", tmp_path / "camera.toml")
    assert done.exit_code == 0, done.output
    assert float(re.search(r"fx ([\d.]+) px", done.output)[1]) == pytest.approx(1000.0, rel=0.01)
    image, _ = photograph(Scene(width=900, height=600, focal_px=1000.0, pixel_size=6e-5, distortion=lens))
    path = save(tmp_path / "grid.png", image)
    done = run("setup", path, "--lens", tmp_path / "camera.toml", "-o", tmp_path / "setup.toml")
    assert done.exit_code == 0, done.output
    assert float(re.search(r"residual to the plane ([\d.]+) um", done.output)[1]) < 6.0
    wrong = save(tmp_path / "small.png", image[:400])
    assert "900 x 600 px" in run("setup", wrong, "--lens", tmp_path / "camera.toml").stderr
    assert run("calibrate", *paths[:3], path, "--pitch", "8mm", "-o", tmp_path / "camera.toml").exit_code == 3


def test_calibrate_refuses(tmp_path):
    path = save(tmp_path / "blank.png", np.full((400, 600, 3), 200, np.uint8))
    assert "needs 3 or more" in run("calibrate", path, "-o", tmp_path / "camera.toml").stderr
    assert "not a pattern" in run("calibrate", path, "--pattern", "9", "-o", tmp_path / "camera.toml").stderr


def test_help_names_all_commands():
    done = run("--help")
    assert done.exit_code == 0
    assert "calibrate" in done.output
    assert "setup" in done.output


def test_a_log_gets_the_time_left(monkeypatch, capsys):
    """Of the steps, not of the start: here 50 s, then 2 s each."""
    clock = iter([50.0, 52.0, 54.0, 54.1])
    monkeypatch.setattr(cli.time, "monotonic", lambda: next(clock))
    with cli.bar("measuring", 10, quiet=False) as advance:
        for _ in range(4):
            advance()
    assert capsys.readouterr().err == "measuring: 2 of 10, about 16 s left\nmeasuring: 3 of 10, about 14 s left\n"
