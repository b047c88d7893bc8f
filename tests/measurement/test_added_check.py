"""A check of one's own, in one file: asked of every photograph, in every process, with its verdict and its remedy."""

from __future__ import annotations

import inspect

import pytest

import measurement
from measurement import photographer
from measurement.series.checks import CHECKS, COURSE, EDGE, LIST, OUTLINE, RUN, TONE, ZERO
from tests.support.photographs.scenes import COARSE


def low(e):
    """Does the body stay below its frame?"""
    height = e.placed[e.kept, 1].max()
    if height >= 3e-3:
        yield measurement.Doubt(f"it rises to {height * 1e3:.1f} mm", "lower the pressure", rejects=height > 6e-3)
        yield measurement.Doubt("only the first doubt counts")


def alone(e):
    """Is it not the highest one?"""
    heights = [outline.height for outline in e.run.outlines.values()]
    if len(heights) > 1 and e.run.outlines[e.number].height == max(heights):
        yield measurement.Doubt("it is the highest one")


@pytest.fixture(autouse=True)
def registered():
    measurement.register_check()(low)  # as the decorator does
    measurement.register_check("run")(alone)
    yield
    del CHECKS[OUTLINE]["low"], CHECKS[RUN]["alone"]


def test_it_is_asked_in_every_process(tmp_path):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(photographer, "HEIGHTS", photographer.HEIGHTS[[0, 2, 4, 9]])
        patch.setattr(photographer, "SCENE", COARSE)
        photographer.make_photographs(tmp_path)
    setup = measurement.setup_from_grid(tmp_path / "IMG_0100.JPG", pitch=9e-3)
    found = measurement.outlines(tmp_path / "photos.csv", setup, jobs=2)
    assert [outline.reasons for outline in found.outlines] == [
        (), (), ("it rises to 4.0 mm; lower the pressure", "it is the highest one")
    ]  # fmt: skip
    assert list(found.refused.values()) == ["it rises to 9.0 mm; lower the pressure"]


def test_every_check_asks_a_question_at_a_known_stage():
    assert list(CHECKS) == [LIST, EDGE, TONE, ZERO, OUTLINE, RUN, COURSE]
    for checks in CHECKS.values():
        for name, check in checks.items():
            assert inspect.getdoc(check).partition("\n")[0].endswith("?"), name
    assert (
        sum(map(len, CHECKS.values())) > 20 and list(CHECKS[OUTLINE])[-1] == "low" and list(CHECKS[RUN])[-1] == "alone"
    )
