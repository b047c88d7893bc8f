"""What is shown of a state: a device without air shows no pressure and no volume, in messages, titles, captions and reports."""

from __future__ import annotations

import re

import pytest

from softmodels.pictures import curves, offscreen, report
from softmodels.pictures.style import headline
from softmodels.runs.store import StoredStates
from tests.support import runs

AIR = re.compile(r"\d cm|cm of water| ml\b|added volume|cavity")
"""What tells of air."""
BEAM = ("--device", "Beam", "--part", "quarter", "--cell-size", "5mm", "--force", "tip", "--force-direction", "x",
        "--force-N", "0:0.2")  # fmt: skip
WEIGHED = ("--device", "Membrane", "--cell-size", "4mm", "--through", "1", "--gravity=-z", "--weight-share", "0:1")  # fmt: skip


@pytest.fixture(scope="module")
def beam(tmp_path_factory):
    folder = tmp_path_factory.mktemp("beam") / "beam"
    return folder, runs.run("-m", "softmodels", "run", *BEAM, "--no-pictures", "--output", folder)


@pytest.fixture(scope="module")
def weighed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("weighed") / "membrane"
    return folder, runs.run("-m", "softmodels", "run", *WEIGHED, "--no-pictures", "--output", folder)


def drawn(states):
    """All words that pictures and report make of a state's load."""
    row, words = states.rows[states.main], states.words
    labels = curves._labels(states.rows, words, range(len(states.rows)))
    return [
        headline(row, words), headline(states.row(0.5), words), offscreen.hot_spot(states, states.main).note, *labels.values(),
        report.ending(states, {}), *report._notes(states),
        *(line[0].text for line in report._lines(states.rows, states).rows),
    ]  # fmt: skip


def test_a_device_without_a_cavity_shows_no_air(beam):
    folder, done = beam
    assert done.status == 0, done.err
    states = StoredStates(folder, "beam")
    closing = done.out.splitlines()[0]
    assert closing.startswith("force 0.2 N: tip rise") and "added volume" not in done.out and "0.2 N" in done.err
    steps = [line for line in done.err.splitlines() if line.startswith("step ")]
    assert len(steps) == len(states.rows)
    texts = [closing, *steps, *drawn(states), *(note for note in done.out.splitlines()[1:] if "states in" not in note)]
    assert [text for text in texts if AIR.search(text)] == []
    assert headline(states.rows[-1], states.words).startswith("force 0.2 N, tip rise")
    assert "stable under load and under travel" in done.out
    # Its outline is drawn under each load, which took a pressure or a volume before.
    assert curves.profile_steps(states.rows, states.words)[-1] == len(states.rows) - 1


def test_a_membrane_under_its_weight_shows_its_volume_and_no_pressure(weighed):
    folder, done = weighed
    assert done.status == 0, done.err
    states = StoredStates(folder, "membrane")
    texts = [done.out, done.err, *drawn(states)]
    assert [text for text in texts if re.search(r"\d cm\b|cm of water|under pressure|a pressure,", text)] == []
    assert " ml" in done.out.splitlines()[0] and "the cavity has gained" in report.ending(states, {})


def test_a_disk_that_is_inflated_shows_both_at_rest_too(half_section):
    states = StoredStates(half_section, "disk")
    assert headline(states.rows[0], states.words) == "0 cm of water (0 kPa), apex rise 0.00 mm"
    assert "the cavity has gained" in report.ending(states, {})
