"""Photographs whose truth is known: how far the outlines lie off, and whether their stated errors are true."""

from __future__ import annotations

import csv

import numpy as np
import pytest
from click.testing import CliRunner

from measurement import photographer
from measurement.__main__ import main
from measurement.camera import Camera
from measurement.outline.outline import Outline
from measurement.photographer import Scene, dome, dome_height, photograph, truth_of
from measurement.screen.grid import find_grid
from measurement.screen.setup import Setup
from measurement.series.measuring import outline_of, trace_image, zero_of

SEEDS = 0, 3, 9, 15
TRUTH = "4 seeded benches, 10 um per pixel: oblique, noise, blur, dust, uneven light, lens, JPEG"
RADIUS = 10e-3
LENS = (-0.12, 0.05, 4e-4, -3e-4, 0.0)


def bench(seed):
    """Scene, height and floor of a bench: 10 um per pixel, up to 40 degrees oblique, light and camera as they come."""
    rng = np.random.default_rng(seed)
    oblique = np.radians(rng.uniform(0.0, 40.0))
    towards = rng.uniform(0.0, 2.0 * np.pi)
    scene = Scene(
        width=2600, height=1700, focal_px=8000.0, pixel_size=10e-6, distortion=LENS if seed % 2 else (),
        # Two angles whose screen normal stands `oblique` away from the optical axis.
        tilt=np.degrees(np.arcsin(np.sin(oblique) * np.sin(towards))),
        pan=np.degrees(np.arctan(np.tan(oblique) * np.cos(towards))),
        roll=rng.uniform(-5.0, 5.0), target=(rng.uniform(-1e-3, 1e-3), rng.uniform(0.0, 2e-3)),
        grid_pitch=float(rng.choice([3e-3, 4.5e-3])), line_width=rng.uniform(0.25e-3, 0.5e-3),
        line_grey=rng.uniform(0.15, 0.45), brightness=rng.uniform(150.0, 235.0), unevenness=rng.uniform(0.0, 0.3),
        ambient=rng.uniform(0.05, 0.25), penumbra=rng.uniform(30e-6, 90e-6), blur=rng.uniform(0.8, 2.0),
        noise=rng.uniform(1.0, 4.0), dust=int(rng.integers(0, 15)), jpeg_quality=int(rng.integers(85, 98)),
        srgb=bool(rng.integers(0, 2)),
    )  # fmt: skip
    return scene, rng.uniform(1e-3, 9e-3), rng.uniform(-5.0e-3, -3.8e-3)


def measured(seed):
    """The outline of one bench, and its true heights at the same places."""
    scene, height, floor = bench(seed)
    truth = truth_of(scene)
    camera = Camera(truth.matrix, scene.distortion, scene.width, scene.height, "known", 0.0) if scene.distortion else (
        Camera.ideal(scene.width, scene.height, scene.focal_px)
    )  # fmt: skip
    found = find_grid(photograph(scene, None, 3 * seed)[0], camera, scene.grid_pitch)
    setup = Setup(camera, found.plane(camera), grid_pitch=scene.grid_pitch)
    flat = photograph(scene, dome(0.0, RADIUS, floor=floor), 3 * seed + 1)[0]
    raised = photograph(scene, dome(height, RADIUS, floor=floor), 3 * seed + 2)[0]
    traced = trace_image(raised, setup)
    zero = zero_of(trace_image(flat, setup, likely=traced.tone))
    outline = outline_of(traced, zero, 1000.0, 10.0, f"seed {seed}")
    # The grid that was found counts from a crossing of its own.
    origin = truth.to_metres(setup.to_pixels([[0.0, 0.0]]))[0]
    crossing = np.rint(origin / scene.grid_pitch) * scene.grid_pitch
    assert np.abs(origin - crossing).max() < 20e-6
    x = outline.x + crossing[0]
    return outline, height, dome_height(x, height, RADIUS), np.gradient(dome_height(x, height, RADIUS), x)


@pytest.fixture(scope="module")
def benches():
    return [measured(seed) for seed in SEEDS]


def across(outline, truth, slope):
    """Distances from the true outline, square to it, in m."""
    return (outline.z - truth) / np.sqrt(1.0 + slope**2)


@pytest.mark.campaign
def test_outlines_are_trusted_and_right(benches, figure):
    for outline, _, truth, slope in benches:
        assert outline.trusted, outline.reasons
        rms = np.sqrt(np.mean(across(outline, truth, slope) ** 2))
        figure(TRUTH, "outlines, rms", rms * 1e6, 4.0, unit="um")


@pytest.mark.campaign
def test_apexes_are_right(benches, figure):
    for outline, height, _, _ in benches:
        figure(TRUTH, "apexes", (outline.height - height) * 1e6, 3.5, unit="um")


@pytest.mark.campaign
def test_stated_errors_are_true(benches, figure):
    standardised = [across(outline, truth, slope) / outline.error for outline, _, truth, slope in benches]
    variance = np.mean([np.mean(values**2) for values in standardised])
    # Not 1: the stated errors allow for lamps and cameras whose edges differ more from one photograph to the next than those
    # of this photographer's Gaussian lamp do, and three benches state the height of a ripple that dust leaves.
    figure(TRUTH, "mean squared standardised residual", variance, 1.3)
    figure(TRUTH, "mean squared standardised residual, at least", variance, at_least=0.2)
    apex = np.array([(outline.height - height) / outline.height_error for outline, height, _, _ in benches])
    figure(TRUTH, "mean squared standardised error of the apexes", np.mean(apex**2), 1.8)
    figure(TRUTH, "largest standardised error of an apex", apex, 4.0)


def _print_figures():
    """The table of all benches, for ``python tests/measurement/test_accuracy.py``."""
    for number in SEEDS:
        outline, height, truth, slope = measured(number)
        rest = across(outline, truth, slope)
        print(
            f"{number:2d} {1e3 * height:5.2f} mm  rms {1e6 * np.sqrt(np.mean(rest**2)):5.2f} um  apex "
            f"{1e6 * (outline.height - height):+6.2f} +- {1e6 * outline.height_error:4.2f} um  standardised "
            f"{np.mean((rest / outline.error) ** 2):5.2f}  {'; '.join(outline.reasons)}",
            flush=True,
        )


if __name__ == "__main__":
    _print_figures()


# -- From synthetic photographs to heights and outlines through the command line -------------------------------------


DEMO = "the demonstration's photographs, 22 um per pixel, 28 degrees oblique"
HEIGHTS = (0.0, 1e-3, 4e-3, 9e-3)


@pytest.fixture(scope="module")
def photographs(tmp_path_factory):
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


def heights_of(folder, listing, output):
    """Exit status and the rows of heights.csv by file."""
    done = run("photos", listing, "--setup", folder / "setup.toml", "-o", output, "--jobs", "1", "--no-pictures", "--quiet")
    table = output / "heights.csv"
    rows = list(csv.DictReader(table.read_text().splitlines())) if table.exists() else []
    return done, {row["file"]: row for row in rows}


@pytest.mark.campaign
def test_heights_and_outlines_are_found_without_a_click(photographs, tmp_path, figure):
    done, rows = heights_of(photographs, photographs / "photos.csv", tmp_path)
    assert done.exit_code == 0, done.output
    assert len(rows) == len(HEIGHTS)
    for (name, row), height in zip(sorted(rows.items()), HEIGHTS, strict=True):
        figure(DEMO, "heights", (float(row["height_m"]) - height) * 1e6, 1.7, unit="um")
        outline = Outline.from_csv(tmp_path / f"{name.removesuffix('.JPG')}.csv")
        if height:
            # The outline counts x along the surface from a place of its own; the dome's summit tells where that is.
            summit = outline.x[np.argmax(outline.z)]
            inside = np.abs(outline.x - summit) < photographer.DISK_RADIUS
            shift = min(
                (
                    np.sqrt(
                        np.mean(
                            (outline.z - dome_height(outline.x - summit - s, height, photographer.DISK_RADIUS))[inside] ** 2
                        )
                    )
                )
                for s in np.linspace(-5e-4, 5e-4, 201)
            )
            figure(DEMO, "outlines, rms", shift * 1e6, 5.0, unit="um")
