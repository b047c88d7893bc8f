"""From synthetic photographs to heights through the command line, and photographs that must not be measured as good."""

from __future__ import annotations

import csv
import dataclasses

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from measurement import photographer
from measurement.__main__ import main
from measurement.outline.outline import Outline
from measurement.photographer import dome, dome_height, photograph, save

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


def spoiled(kind, folder):
    """A photograph that cannot be measured."""
    path = folder / "IMG_0200.JPG"
    scene, shape = photographer.SCENE, dome(4e-3, photographer.RADIUS, floor=photographer.FLOOR)
    if kind == "not a picture":
        path.write_bytes(b"this is no JPEG")
    elif kind == "black":
        Image.new("RGB", (scene.width, scene.height)).save(path)
    elif kind == "white":
        Image.new("RGB", (scene.width, scene.height), "white").save(path)
    elif kind == "missing":
        pass
    else:
        changes = {
            "another size": {"width": 1600, "height": 1200},
            "moved camera": {"pan": scene.pan + 2.0},
            "blurred": {"blur": 25.0},
            "no shadow": {},
        }[kind]
        outline = None if kind == "no shadow" else shape
        save(path, photograph(dataclasses.replace(scene, **changes), outline, seed=200)[0])
    return path


@pytest.mark.parametrize(
    "kind", ["not a picture", "black", "white", "missing", "another size", "moved camera", "blurred", "no shadow"]
)
def test_unusable_photographs_are_refused_and_the_others_go_on(bench, tmp_path, kind):
    spoiled(kind, tmp_path)
    zero = bench / "IMG_0101.JPG"
    (tmp_path / "photos.csv").write_text(f"file,pressure\n{zero},0 cm\nIMG_0200.JPG,5 cm\n")
    done, rows = measured(bench, tmp_path / "photos.csv", tmp_path / "out")
    assert done.exit_code == 3, done.output
    assert not (tmp_path / "out" / "IMG_0200.csv").exists()
    row = next(row for name, row in rows.items() if name.endswith("IMG_0200.JPG"))
    assert row["trusted"] == "refused" and row["remarks"]
