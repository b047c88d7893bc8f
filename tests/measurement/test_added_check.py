"""A check of one's own, in one file: asked of every photograph, in every process, with its verdict and its remedy."""

from __future__ import annotations

import inspect

import pytest

import measurement
from measurement import photographer
from measurement.series.checks import CHECKS, COURSE, EDGE, LIST, OUTLINE, RUN, TONE, ZERO
from tests.support.photographs.scenes import COARSE


class Low(measurement.Check):
    """Does the body stay below its frame?"""

    def doubt(self, e):
        height = e.placed[e.kept, 1].max()
        if height < 3e-3:
            return None
        return measurement.Doubt(f"it rises to {height * 1e3:.1f} mm", "lower the pressure", rejects=height > 6e-3)


class Alone(measurement.Check, stage=RUN):
    """Is it not the highest one?"""

    def doubt(self, e):
        heights = [outline.height for outline in e.run.outlines.values()]
        highest = len(heights) > 1 and e.run.outlines[e.number].height == max(heights)
        return measurement.Doubt("it is the highest one") if highest else None


@pytest.fixture(autouse=True)
def registered():
    for check in (Low, Alone):  # as the decorator does
        measurement.register_check(check)
    yield
    del CHECKS["Low"], CHECKS["Alone"]


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
    for name, check in CHECKS.items():
        assert inspect.getdoc(check).partition("\n")[0].endswith("?"), name
        assert check.stage in (LIST, EDGE, TONE, ZERO, OUTLINE, RUN, COURSE)
    assert len(CHECKS) > 20 and list(CHECKS)[-2:] == ["Low", "Alone"]
