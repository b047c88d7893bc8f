"""Copies of photographs, saved anew or changed, are found by their noise; honest repeats are not taken for copies."""

from __future__ import annotations

import dataclasses
import functools
import io

import cv2
import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from measurement import photographer
from measurement.__main__ import main
from measurement.outline.outline import Outline
from measurement.photographer import dome, dome_height, photograph, save
from measurement.series.photo_list import MIN_COPY_CORRELATION, copies, cut_out, likeness, prepared
from tests.support.campaigns import sampled

SCENE = dataclasses.replace(photographer.SCENE, width=1000, height=640, focal_px=1750.0, pixel_size=48e-6, dust=3)
HEIGHTS = (0.0, 3.0, 4.0, 5.0, 6.0)
COPIED_HEIGHT = 5.0


@functools.cache
def shown(height, seed, grain=0.0, nudged=0.0, **scene):
    """A photograph of the dome, in mm; a screen with grain, nudged by some pixels."""
    texture = cv2.GaussianBlur(np.random.default_rng(3).standard_normal((640, 1000)).astype(np.float32), (0, 0), 1.0)
    moved = cv2.warpAffine(texture, np.float32([[1, 0, nudged], [0, 1, nudged]]), (1000, 640), borderMode=cv2.BORDER_REFLECT)
    return photograph(
        dataclasses.replace(SCENE, **scene), dome(height * 1e-3, photographer.DISK_RADIUS, floor=photographer.SURFACE_HEIGHT),
        seed, fault=lambda light, truth: light * (1.0 + grain / texture.std() * moved),
    )[0]  # fmt: skip


def jpeg(picture, quality, subsampling=2):
    data = io.BytesIO()
    Image.fromarray(picture).save(data, "JPEG", quality=quality, subsampling=subsampling)
    return np.asarray(Image.open(data).convert("RGB"))


def brighter(picture, factor):
    return np.uint8(np.clip(np.rint(picture * float(factor)), 0, 255))


def curved(picture, gamma):
    return np.uint8(np.rint(255.0 * (picture / 255.0) ** gamma))


def resized(picture, factor):
    height, width = picture.shape[:2]
    small = cv2.resize(picture, (round(width * factor), round(height * factor)), interpolation=cv2.INTER_AREA)
    return cv2.resize(small, (width, height), interpolation=cv2.INTER_CUBIC)


CHANGES = {
    "quality 85": lambda picture: jpeg(picture, 85),
    "quality 70": lambda picture: jpeg(picture, 70),
    "10 % brighter, quality 70": lambda picture: jpeg(brighter(picture, 1.1), 70),
    "gamma 0.9": lambda picture: jpeg(curved(picture, 0.9), 80),
    "resized by 0.6": lambda picture: jpeg(resized(picture, 0.6), 80),
}
BENCHES = {
    "plain": {},
    "fine camera, grainy screen": {"noise": 1.0, "jpeg_quality": 90, "grain": 0.02},
}


def outline(height, pressure, source="test"):
    x = np.linspace(-0.02, 0.02, 201)
    return Outline(x, dome_height(x, height * 1e-3), np.full(201, 1e-6), pressure, 5.0, source)


def judged(pictures, heights, pressures):
    outlines = [outline(h, p, f"{k}.jpg") for k, (h, p) in enumerate(zip(heights, pressures, strict=True))]
    return copies(dict(enumerate(outlines)), {k: cut_out(picture) for k, picture in enumerate(pictures)})


@pytest.mark.parametrize("bench", sampled(BENCHES))
def test_changed_copies_at_another_pressure_are_found(bench):
    """Only copies byte for byte were found."""
    pictures = [shown(height, k, **BENCHES[bench]) for k, height in enumerate(HEIGHTS)]
    samples = [prepared(cut_out(picture)) for picture in pictures]
    others = [samples[k] for k in (2, 4, 1, 0)]
    for name, change in CHANGES.items():
        copy = prepared(cut_out(change(pictures[3])))
        assert likeness(samples[3], copy, others) > 1.2 * MIN_COPY_CORRELATION, name
        assert likeness(samples[3], copy, others[:2]) > MIN_COPY_CORRELATION, name


@pytest.mark.parametrize("nudged", sampled([0.0, 0.15]))
@pytest.mark.parametrize("bench", sampled(BENCHES))
def test_honest_repeats_are_no_copies(bench, nudged):
    """Three exposures of one state at nearly equal pressures, between others; the camera may have moved a little."""
    heights = (0.0, 3.0, 5.0, 5.0, 5.01, 6.0)
    pictures = [shown(height, 10 + k, nudged=nudged * (k % 3 - 1), **BENCHES[bench]) for k, height in enumerate(heights)]
    assert judged(pictures, heights, [0.0, 300.0, 500.0, 500.0, 502.0, 600.0]) == {}
    samples = [prepared(cut_out(picture)) for picture in pictures]
    others = [samples[k] for k in (1, 5, 4, 0)]
    assert likeness(samples[2], samples[3], others) < MIN_COPY_CORRELATION / 3.0


def test_both_pressures_of_a_copy_are_doubted_and_a_repeated_file_counts_once():
    pictures = [shown(height, k) for k, height in enumerate(HEIGHTS)]
    copy = jpeg(brighter(pictures[3], 1.05), 85)
    found = judged([*pictures, copy], [*HEIGHTS, 5.02], [0.0, 300.0, 400.0, 500.0, 600.0, 550.0])
    assert sorted(found) == [3, 5]
    assert "it and 5.jpg are copies of one photograph" in found[3] and "different pressures" in found[5]
    once = judged([*pictures, copy], [*HEIGHTS, 5.02], [0.0, 300.0, 400.0, 500.0, 600.0, 500.0])
    assert list(once) == [5] and "copy of 3.jpg" in once[5] and "counts once" in once[5]


def test_few_photographs_tell_a_plain_copy():
    """With one other photograph the bar is higher, and with none nothing is said."""
    pictures = [shown(height, k) for k, height in enumerate(HEIGHTS)]
    copy = jpeg(pictures[3], 90)
    assert sorted(judged([pictures[0], pictures[3], copy], (0.0, 5.0, 5.0), (0.0, 500.0, 550.0))) == [1, 2]
    assert judged([pictures[0], pictures[3], shown(5.0, 30)], (0.0, 5.0, 5.0), (0.0, 500.0, 550.0)) == {}
    assert judged([pictures[3], copy], (5.0, 5.0), (500.0, 550.0)) == {}


@pytest.mark.campaign
def test_the_command_refuses_a_copy_saved_anew_with_its_reason(tmp_path):
    save(tmp_path / "grid.jpg", photograph(SCENE, None, seed=1)[0])
    for k, height in enumerate(HEIGHTS):
        save(tmp_path / f"{k}.jpg", shown(height, k))
    save(tmp_path / "5.jpg", brighter(np.asarray(Image.open(tmp_path / "3.jpg")), 1.03), quality=85)
    rows = [f"{k}.jpg,{cm} cm" for k, cm in enumerate((0, 6.8, 8.8, 10.3, 11.7, 11))]
    (tmp_path / "photos.csv").write_text("\n".join(["file,pressure", *rows]) + "\n")
    words = ["setup", tmp_path / "grid.jpg", "--lens", "none", "-o", tmp_path / "setup.toml"]
    assert CliRunner().invoke(main, list(map(str, words))).exit_code == 0
    words = [
        "photos",
        tmp_path / "photos.csv",
        "--setup",
        tmp_path / "setup.toml",
        "-o",
        tmp_path / "out",
        "--jobs",
        "1",
    ]
    done = CliRunner().invoke(main, [*map(str, words), "--no-pictures"])
    assert done.exit_code == 3, done.output
    table = (tmp_path / "out" / "heights.csv").read_text().splitlines()[1:]
    assert [row.split(",")[0] for row in table if "copies of one photograph" in row] == ["3.jpg", "5.jpg"]
    assert sum(",refused," in row for row in table) == 2
    assert not (tmp_path / "out" / "3.csv").exists()
