"""The measurement from Python: the numbers of the command line, and nothing printed."""

from __future__ import annotations

import subprocess
import sys

import pytest

import measurement
from measurement import photographer
from measurement.series.photo_list import DENSITY_ERROR
from softmodels.common.units import quantity
from tests.support.photographs.scenes import COARSE


@pytest.fixture(scope="module")
def photographs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("photographs")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(photographer, "HEIGHTS", photographer.HEIGHTS[[0, -1]])  # at rest, and the highest
        patch.setattr(photographer, "SCENE", COARSE)
        photographer.make_photographs(folder)
    return folder


def _command(*words):
    subprocess.run([sys.executable, "-m", "measurement", *map(str, words)], check=True, capture_output=True)


@pytest.mark.campaign
def test_the_numbers_are_those_of_the_command_line(photographs, tmp_path, capfd):
    setup = measurement.setup_from_grid(photographs / "IMG_0100.JPG", pitch=quantity("9mm", "m"))
    column = measurement.Column(density_error=float(f"{DENSITY_ERROR:.2g}"))  # as the option's default is shown
    found = measurement.outlines(photographs / "photos.csv", setup, column)
    found.write(tmp_path)
    assert capfd.readouterr() == ("", "")
    assert not found.refused
    assert len(found.outlines) == len(found.results) == 2
    assert found.outlines[1].height > 1e-3

    file, listing = tmp_path / "setup.toml", photographs / "photos.csv"
    _command("setup", photographs / "IMG_0100.JPG", "--grid-pitch", "9mm", "--lens", "none", "-o", file)
    assert file.read_text() == setup.to_toml()
    _command("photos", listing, "--setup", file, "--jobs", "1", "--no-pictures", "-o", tmp_path / "outlines")
    for name in ("heights.csv", *(f"{result.name}.csv" for result in found.results)):
        assert (tmp_path / name).read_text() == (tmp_path / "outlines" / name).read_text()


def test_errors_are_the_command_lines_sentences(photographs, tmp_path):
    with pytest.raises(measurement.SetupError, match=r"nowhere\.toml"):
        measurement.outlines(photographs / "photos.csv", tmp_path / "nowhere.toml")
    with pytest.raises(measurement.PhotoListError, match=r"nowhere\.csv"):
        measurement.outlines(tmp_path / "nowhere.csv", tmp_path / "nowhere.toml")


def test_every_public_name_is_there_and_typed():
    for name in measurement.__all__:
        assert getattr(measurement, name) is not None
