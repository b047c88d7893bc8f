"""A check of one's own, in one file: asked of every photograph, in every process, with its verdict and its remedy."""

from __future__ import annotations

import inspect
import os
import signal
from pathlib import Path

import pytest

import measurement
from measurement import photographer
from measurement.series.checks import CHECKS, OutlineEvidence, RunEvidence
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
    measurement.register_check(RunEvidence)(alone)
    yield
    del CHECKS[OutlineEvidence]["low"], CHECKS[RunEvidence]["alone"]


def deadly(e):
    """Does memory suffice? A system out of it kills the process: once for one of some height, always for a higher one."""
    height, marker = e.placed[e.kept, 1].max(), Path(os.environ["MARKER"])
    if height > 6e-3 or (height > 3e-3 and not marker.exists()):
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    yield from ()


@pytest.fixture(scope="module")
def taken(tmp_path_factory):
    """Four photographs, the last two of bodies of 4 and 9 mm, and their setup."""
    folder = tmp_path_factory.mktemp("taken")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(photographer, "HEIGHTS", photographer.HEIGHTS[[0, 2, 4, 9]])
        patch.setattr(photographer, "SCENE", COARSE)
        photographer.make_photographs(folder)
    return folder / "photos.csv", measurement.setup_from_grid(folder / "IMG_0100.JPG", pitch=9e-3)


@pytest.mark.campaign
def test_a_killed_process_is_replaced_and_the_others_are_measured(taken, tmp_path, monkeypatch):
    monkeypatch.setenv("MARKER", str(tmp_path / "marker"))
    del CHECKS[OutlineEvidence]["low"], CHECKS[RunEvidence]["alone"]
    measurement.register_check()(deadly)
    try:
        found, seen = None, []
        found = measurement.outlines(*taken, jobs=2, done=seen.append)
    finally:
        del CHECKS[OutlineEvidence]["deadly"]
        measurement.register_check()(low)
        measurement.register_check(RunEvidence)(alone)
    heights = [1e3 * outline.height for outline in found.outlines]
    assert heights == pytest.approx([0.0, 2.0, 4.0], abs=0.01) and len(seen) == 4
    assert [(name, words.partition(",")[0]) for name, words in found.refused.items()] == [
        ("IMG_0104.JPG", "the process that computes ended")
    ]


@pytest.mark.campaign
def test_a_check_of_a_script_is_asked_in_its_own_process(taken):
    asked = []

    def local(e):
        """Is it asked here?"""
        asked.append(os.getpid())
        yield from ()

    measurement.register_check()(local)
    try:
        assert len(measurement.outlines(*taken, jobs=2).outlines) == 3
    finally:
        del CHECKS[OutlineEvidence]["local"]
    assert set(asked) == {os.getpid()}


@pytest.mark.campaign
def test_it_is_asked_in_every_process(taken):
    found = measurement.outlines(*taken, jobs=2)
    assert [outline.reasons for outline in found.outlines] == [
        (), (), ("it rises to 4.0 mm; lower the pressure", "it is the highest one")
    ]  # fmt: skip
    assert list(found.refused.values()) == ["it rises to 9.0 mm; lower the pressure"]


def test_every_check_asks_a_question_at_a_known_stage():
    for checks in CHECKS.values():
        for name, check in checks.items():
            assert inspect.getdoc(check).partition("\n")[0].endswith("?"), name
    assert sum(map(len, CHECKS.values())) > 20
    assert (list(CHECKS[OutlineEvidence])[-1], list(CHECKS[RunEvidence])[-1]) == ("low", "alone")
