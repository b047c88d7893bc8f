"""Photographs, options and files that make no setup: each refused in one sentence, with exit status 2 and nothing written."""

from __future__ import annotations

import functools
import re

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from measurement.__main__ import main
from measurement.photographer import Scene, photograph, save
from measurement.screen.setup import Setup, SetupError
from tests.support.campaigns import sampled


def run(*arguments):
    done = CliRunner().invoke(main, [str(argument) for argument in arguments])
    assert not isinstance(done.exception, Exception), done.exception
    assert "Traceback" not in done.output
    return done


@functools.cache
def grid(**options):
    return photograph(Scene(**options), None)[0]


def none():
    return photograph(Scene(line_grey=0.0), None)[0]


def mostly_hidden():
    image = grid().copy()
    image[:, 250:] = 90
    return image


def two_grids():
    image = grid().copy()
    image[:, 600:] = grid(grid_pitch=0.0075)[:, 600:]
    return image


def bent():
    """A screen that bulges: its grid is seen up to 8 px aside."""
    y, x = np.indices((800, 1200)).astype(np.float32)
    return cv2.remap(grid(), x + 8 * np.cos((x - 600) / 350), y + 5 * np.sin(x / 300), cv2.INTER_LINEAR)


def blurred():
    return grid(blur=60.0)


def coarse():
    return grid(grid_pitch=0.03)


def unevenly_lit_nothing():
    return np.uint8(np.add.outer(np.linspace(40, 220, 800), np.zeros(1200)))[..., None].repeat(3, axis=2)


PICTURES = {
    none: "no grid was found",
    mostly_hidden: "fewest|at least 6|show more",
    two_grids: "regular grid|counted in more than one way|do not fit",
    bent: "regular grid|do not fit|flatten",
    blurred: "no grid was found|blank|blurred",
    coarse: "fewest|at least 6",
    unevenly_lit_nothing: "no grid was found",
}


@pytest.mark.parametrize(
    "picture", sampled(PICTURES, (bent, coarse, unevenly_lit_nothing)), ids=lambda picture: picture.__name__
)
def test_pictures(picture, tmp_path):
    path = save(tmp_path / "photo.png", picture())
    refused(PICTURES[picture], tmp_path, path, "--lens", "none")


OPTIONS = {
    "no unit": (("--grid-pitch", "9"), "has no unit"),
    "negative pitch": (("--grid-pitch", "-9mm"), "positive length"),
    "pitch of nothing": (("--grid-pitch", "0mm"), "positive length"),
    "pitch of 9 m": (("--grid-pitch", "9m"), "write mm for millimetres"),
    "no such target": (("--target", "carpet"), "carpet"),
    "no chessboard": (("--target", "chessboard"), "no chessboard with 9 x 6"),
    "no charuco": (("--target", "charuco"), "0 corners of the ChArUco board"),
    "no such markers": (("--target", "charuco", "--dictionary", "DICT_9"), "dictionary DICT_9"),
    "scale without unit": (("--scale", "75000"), "75px/mm"),
    "negative scale": (("--scale", "-75px/mm"), "positive number"),
    "scale and points": (("--scale", "75px/mm", "--point", "1,2=0mm,0mm"), "not both"),
    "three points": (("--point", "1,1=0mm,0mm") * 3, "at least 4"),
    "lamp in the object": (("--lamp-distance", "0m", "--screen-distance", "3cm"), "must be positive"),
}


@pytest.mark.parametrize("case", OPTIONS)
def test_options(case, tmp_path):
    path = tmp_path / "photo.png"
    save(path, grid())
    options, reason = OPTIONS[case]
    refused(reason, tmp_path, path, "--lens", "none", *options)


SQUARE = {(100, 100): (0, 60), (1100, 100): (100, 60), (100, 700): (0, 0), (1100, 700): (100, 0), (600, 400): (50, 30)}
POINTS = {
    "collinear": ({(x, x // 2): (x / 10, x / 20) for x in (100, 300, 500, 700, 900)}, "off a common line"),
    "all but one on a line": (
        {**{(x, 100): (x / 10, 60) for x in (100, 400, 700)}, (500, 600): (50, 10)},
        "off a common line",
    ),
    "given twice": ({**SQUARE, (100.2, 100): (0, 60)}, "the same point; give each once"),
    "two places for one": ({**SQUARE, (300, 300): (50, 30)}, "the same point; give each once"),
    "exchanged": ({**SQUARE, (100, 100): (100, 60), (1100, 100): (0, 60)}, "not fit a plane.* exchanged or mistyped"),
    "mistyped": ({**SQUARE, (350, 250): (25, 54)}, "not fit a plane.* exchanged or mistyped"),
    "mirrored": ({px: (x, -z) for px, (x, z) in SQUARE.items()}, "mirrored"),
    "X and Z exchanged": ({px: (z, x) for px, (x, z) in SQUARE.items()}, "mirrored"),
    "outside": ({**SQUARE, (1300, 300): (120, 40)}, "1300,300 is outside the picture"),
}  # fmt: skip


@pytest.mark.parametrize("case", POINTS)
def test_known_points(case, tmp_path):
    path = save(tmp_path / "photo.png", grid())
    points, reason = POINTS[case]
    options = [part for (x, y), (u, v) in points.items() for part in ("--point", f"{x},{y}={u}mm,{v}mm")]
    refused(reason, tmp_path, path, "--lens", "none", *options)


def test_lens_of_another_focal_length(tmp_path):
    """The profile at 18 mm bends lines that the lens in use left straight."""
    path = save(tmp_path / "photo.jpg", grid(width=1500, height=1000))
    names = ("--lens", "Canon EF-S 18-55mm f/3.5-5.6 IS", "--camera", "Canon EOS 550D")
    refused("residual of the crossings to a regular grid", tmp_path, path, *names, "--focal", "18mm")


def test_unreadable(tmp_path):
    broken = tmp_path / "broken.jpg"
    save(broken, grid())
    broken.write_bytes(broken.read_bytes()[:5000])
    for path in (broken, tmp_path / "missing.jpg", tmp_path):
        refused("cannot be read as a photograph", tmp_path, path, "--lens", "none")


@pytest.mark.campaign
def test_setup_is_kept_when_its_picture_or_itself_cannot_be_written(tmp_path):
    path, output = save(tmp_path / "photo.png", grid()), tmp_path / "setup.toml"
    earlier = 'plane = "earlier"'
    output.write_text(earlier)
    done = run("setup", path, "--lens", "none", "-o", output, "--overlay", tmp_path / "no" / "such.png")
    assert (done.exit_code, output.read_text()) == (2, earlier)
    assert "cannot be written" in done.stderr
    assert run("setup", path, "--lens", "none", "-o", tmp_path / "no" / "setup.toml").exit_code == 2


EDITS = {
    "version": (r"version = 1", "version = 2", "of version 2, this program reads version 1"),
    "no camera": (r"\[camera\][^\[]*", "", "unknown|no field|cannot be read|not valid TOML"),
    "no matrix": (r"matrix = ", "matrixx = ", "no field 'matrix'"),
    "not a number": (r"magnification = 1.0", "magnification = nan", "magnification must be positive"),
    "pitch is no number": (r"grid_pitch = [\d.]+", "grid_pitch = nan", "pitch must be a positive"),
    "negative pitch": (r"grid_pitch = [\d.]+", "grid_pitch = -0.009", "pitch must be a positive"),
    "error is no number": (r"magnification_error = 0.0", "magnification_error = nan", "error must not be negative"),
    "pitch in millimetres": (r"grid_pitch = [\d.]+", "grid_pitch = 9", "9000 mm does not match a picture that shows"),
    "pitch without end": (r"grid_pitch = [\d.]+", "grid_pitch = 3128061", "does not match a picture"),
    "pitch of a nanometre": (r"grid_pitch = [\d.]+", "grid_pitch = 1e-9", "does not match a picture"),
    "error beyond the size": (r"magnification_error = 0.0", "magnification_error = 12", "1 .- 12 is undetermined"),
    "residual is no number": (r"residual = .*", "residual = nan", "not finite"),
    "unknown": (r"version = 1", "version = 1\nmagnifcation = 2.0", "unknown field 'magnifcation'"),
    "text": (r"width = 1200", 'width = "wide"', "cannot be read"),
}


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    folder = tmp_path_factory.mktemp("good")
    path = save(folder / "photo.png", grid())
    assert run("setup", path, "--lens", "none", "-o", folder / "setup.toml").exit_code == 0
    return (folder / "setup.toml").read_text()


@pytest.mark.parametrize("edit", EDITS)
def test_edited_files(good, edit, tmp_path):
    old, new, reason = EDITS[edit]
    text, count = re.subn(old, new, good, count=1)
    assert count == 1
    path = tmp_path / "setup.toml"
    path.write_text(text)
    with pytest.raises(SetupError, match=reason) as error:
        Setup.from_file(path)
    assert str(error.value).startswith(str(path))


def refused(reason, folder, *arguments):
    output = folder / "setup.toml"
    done = run("setup", *arguments, "-o", output)
    assert done.exit_code == 2, done.output
    assert re.search(reason, done.stderr), done.stderr
    assert done.stdout == ""
    assert not output.exists()
    assert not list(folder.glob(".setup*"))
