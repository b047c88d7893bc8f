"""From synthetic photographs to heights and outlines through the command line."""

from __future__ import annotations

import csv

import numpy as np
import pytest
from click.testing import CliRunner

from measurement import photographer
from measurement.__main__ import main
from measurement.outline.outline import Outline
from measurement.photographer import dome_height

DEMO = "the demonstration's photographs, 22 um per pixel, 28 degrees oblique"
HEIGHTS = (0.0, 1e-3, 4e-3, 9e-3)


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """A folder with the grid, a few heights and the setup made of them."""
    folder = tmp_path_factory.mktemp("bench")
    patch = pytest.MonkeyPatch()
    patch.setattr(photographer, "HEIGHTS", np.array(HEIGHTS))
    photographer.make_photographs(folder)
    patch.undo()
    done = run("setup", folder / "IMG_0100.JPG", "--grid-pitch", "9mm", "--lens", "none", "-o", folder / "setup.toml")
    assert done.exit_code == 0, done.output
    return folder


def run(*words):
    return CliRunner().invoke(main, [str(word) for word in words])


def measured(folder, listing, output):
    """Exit status and the rows of heights.csv by file."""
    done = run(
        "photos", listing, "--setup", folder / "setup.toml", "-o", output, "--jobs", "1", "--no-pictures", "--quiet"
    )
    table = output / "heights.csv"
    rows = list(csv.DictReader(table.read_text().splitlines())) if table.exists() else []
    return done, {row["file"]: row for row in rows}


def test_heights_and_outlines_are_found_without_a_click(bench, tmp_path, figure):
    done, rows = measured(bench, bench / "photos.csv", tmp_path)
    assert done.exit_code == 0, done.output
    assert len(rows) == len(HEIGHTS)
    for (name, row), height in zip(sorted(rows.items()), HEIGHTS, strict=True):
        figure(DEMO, "heights", (float(row["height_m"]) - height) * 1e6, 1.7, unit="um")
        outline = Outline.from_csv(tmp_path / f"{name.removesuffix('.JPG')}.csv")
        if height:
            # The outline counts x along the surface from a place of its own; the dome's summit tells where that is.
            summit = outline.x[np.argmax(outline.z)]
            inside = np.abs(outline.x - summit) < photographer.RADIUS
            shift = min(
                (
                    np.sqrt(
                        np.mean(
                            (outline.z - dome_height(outline.x - summit - s, height, photographer.RADIUS))[inside] ** 2
                        )
                    )
                )
                for s in np.linspace(-5e-4, 5e-4, 201)
            )
            figure(DEMO, "outlines, rms", shift * 1e6, 5.0, unit="um")
