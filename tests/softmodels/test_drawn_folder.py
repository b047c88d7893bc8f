"""Pictures that are encoded beside what draws the next one: all on disk at the end, and no failure lost."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image as Picture

from softmodels.pictures.style import DrawnFolder, png


def some(k):
    figure = Figure((2.0, 1.0), dpi=50)
    figure.text(0.1, 0.5, f"picture {k}")
    return figure


def test_all_are_on_disk_at_the_end(tmp_path):
    with DrawnFolder(tmp_path, shrink=lambda image: f"{image.width} x {image.height}") as out:
        for k in range(8):
            out.save(f"p{k}", some(k), {"Title": f"number {k}"})
        out.add("made", png(some(9)))
    assert [path.name for path in out.written] == [*(f"p{k}.png" for k in range(8)), "made.png"]
    assert out.pages() == dict.fromkeys((path.name for path in out.written), "100 x 50")
    for k in range(8):
        with Picture.open(tmp_path / f"p{k}.png") as image, Picture.open(tmp_path / "made.png") as other:
            assert image.text["Title"] == f"number {k}" and image.mode == "RGB"
            assert image.info["dpi"] == pytest.approx((50, 50), abs=0.1)
            assert not np.array_equal(np.asarray(image), np.asarray(other))


def test_a_picture_that_cannot_be_written_is_no_picture(tmp_path):
    out = DrawnFolder(tmp_path / "missing")
    with pytest.raises(FileNotFoundError), out:
        out.save("p", some(0))


def test_what_else_went_wrong_is_what_is_reported(tmp_path):
    with pytest.raises(ZeroDivisionError), DrawnFolder(tmp_path / "missing") as out:
        out.save("p", some(0))
        _ = 1 / 0
