"""A soft body whose sides are in the picture and whose rim sinks as the middle rises, as thick disks do."""

from __future__ import annotations

import csv
import functools
import re

import numpy as np
import pytest
from click.testing import CliRunner

from measurement.__main__ import main
from measurement.camera import Camera
from measurement.outline.outline import Outline
from measurement.photographer import Scene, dome_height, photograph, save
from measurement.screen.grid import find_grid
from measurement.screen.setup import Setup
from measurement.series.measuring import measure_all, zero_line
from measurement.series.photo_list import Photograph

SCENE = Scene(tilt=8.0, pan=-15.0, ambient=0.12, srgb=True, target=(0.0, 0.002))
FLOOR, HALF_WIDTH, RADIUS = -0.0067, 0.017, 0.014
HEIGHTS = (0.0, 0.5e-3, 1.5e-3, 2.5e-3, 3.5e-3)


def body(height, moved=0.0):
    """Polygon of the body: the rim sinks by an eighth of the height."""
    x = np.linspace(-HALF_WIDTH, HALF_WIDTH, 801)
    share = np.abs(x) / HALF_WIDTH
    z = dome_height(x, height, RADIUS) - 0.13 * height * share**2 * (3 - 2 * share)
    surface = np.column_stack([x, FLOOR + moved + z])
    return np.vstack([surface, [[HALF_WIDTH, -0.2], [-HALF_WIDTH, -0.2]]])


@functools.cache
def picture(number, height, moved):
    """Photograph of the body, with the noise of its number."""
    return photograph(SCENE, body(height, moved), 10 + number)[0]


@pytest.fixture(scope="module")
def setup():
    camera = Camera.ideal(SCENE.width, SCENE.height, SCENE.focal_px)
    return Setup(
        camera,
        find_grid(photograph(SCENE, None, 1)[0], camera, SCENE.grid_pitch).plane(camera),
        grid_pitch=SCENE.grid_pitch,
    )


def measured(setup, folder, moved):
    """Outlines of a run; ``moved`` is how far the body was moved before each photograph in m."""
    photographs = []
    for number, (height, by) in enumerate(zip(HEIGHTS, moved, strict=True)):
        file = save(folder / f"IMG_{number:04d}.JPG", picture(number, height, by))
        photographs.append(Photograph(file, 1000.0 * number, 5.0))
    zero = zero_line(photographs, setup)
    return [result.outcome for result in measure_all(photographs, setup, zero)]


@pytest.mark.campaign
def test_a_soft_body_is_measured_and_trusted(setup, tmp_path, figure):
    for outline, height in zip(measured(setup, tmp_path, (0.0,) * 5), HEIGHTS, strict=True):
        assert isinstance(outline, Outline) and outline.trusted, outline
        figure("a soft body whose rim sinks", "heights", (outline.height - height) * 1e6, 4.0, unit="um")
        # The corners between surface and sides are rounded by smoothing, and left out.
        assert np.abs(outline.x).max() < HALF_WIDTH + 1e-3
        if not height:
            assert np.abs(outline.z).max() < 10e-6


@pytest.mark.campaign
def test_a_soft_body_that_slips_for_one_photograph_is_not_trusted_there(setup, tmp_path):
    outlines = measured(setup, tmp_path, (0.0, 0.0, 0.0, -0.25e-3, 0.0))
    assert [outline.trusted for outline in outlines] == [True, True, True, False, True]
    assert "moved for this one" in outlines[3].reasons[-1]


@pytest.mark.campaign
def test_a_soft_body_that_slips_after_the_zero_is_not_trusted(setup, tmp_path):
    outlines = measured(setup, tmp_path, (0.0, -0.2e-3, -0.2e-3, -0.2e-3, -0.2e-3))
    for outline in outlines[1:]:
        assert not getattr(outline, "trusted", False)


@pytest.mark.campaign
def test_the_command_takes_the_body_s_width(setup, tmp_path):
    for number, height in enumerate((0.0, 3.5e-3)):
        save(tmp_path / f"IMG_{number:04d}.JPG", photograph(SCENE, 1.02 * body(height), 10 + number)[0])
    (tmp_path / "photos.csv").write_text("file,pressure\nIMG_0000.JPG,0 cm\nIMG_0001.JPG,9 cm\n")
    (tmp_path / "setup.toml").write_text(setup.to_toml())
    words = [
        "photos",
        str(tmp_path / "photos.csv"),
        "--setup",
        str(tmp_path / "setup.toml"),
        "-o",
        str(tmp_path / "out"),
    ]
    words += ["--jobs", "1", "--no-pictures", "--body-width"]
    done = CliRunner().invoke(main, [*words, "34mm+-10um"])
    assert done.exit_code == 0, done.output
    assert re.search(r"magnification of 1\.0(19|20)", done.output), done.output
    rows = list(csv.DictReader((tmp_path / "out" / "heights.csv").read_text().splitlines()))
    assert float(rows[1]["height_m"]) == pytest.approx(3.5e-3, abs=12e-6)
    assert CliRunner().invoke(main, [*words, "34um"]).exit_code == 2
