"""A run's photographs as each other's witnesses: single wrong rows are named, and good runs of every kind keep their trust."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from PIL import Image

from measurement.series.drawing import draw_heights
from measurement.series.witness import Course, Run, course_of
from tests.support.photographs.courses import COURSES, DAMAGES, Rows, damaged, run

STEPS = np.linspace(0.0, 1.0, 9)


def rows(pressures, heights, height_error=3e-6):
    count = len(heights)
    return Rows(
        np.asarray(heights, float), np.asarray(pressures, float), np.full(count, height_error), np.full(count, 7.0)
    )


def softening(count=9):
    """A run of a softening part: 8 mm at 1500 Pa."""
    steps = np.linspace(0.0, 1.0, count)
    return rows(1500.0 * (1.6 * steps - 0.6 * steps**2), 8e-3 * steps)


def told(made):
    return Run(dict(enumerate(made.outlines()))).contradictions


@pytest.mark.parametrize("kind", COURSES)
def test_good_runs_keep_their_trust(kind):
    """Softening, hardening, past a limit point by volume, over it with a jump, and down again with a lag."""
    flagged = count = 0
    for seed in range(8):
        rng = np.random.default_rng([seed, list(COURSES).index(kind), 5])
        made = run(kind, rng, int(rng.integers(4, 21)))
        flagged, count = flagged + len(told(made)), count + len(made.heights)
    assert flagged <= 0.02 * count


CAUGHT = {"ten times": 6, "wrong sign": 8, "a second zero 0.3 to 1.5 mm high": 8, "height 0.4 to 2 mm off": 5}
"""Damages, and how many of eight runs must show them; a tenth of little, or a height on a plateau, does not stand out."""


@pytest.mark.parametrize("kind", CAUGHT)
def test_single_wrong_rows_are_found_and_the_others_are_not_blamed(kind):
    caught = blamed = 0
    for seed, course in enumerate(COURSES):
        rng = np.random.default_rng([seed, 9])
        bad = damaged(kind, run(course, rng, 12), rng)
        found = told(bad)
        caught += bool(set(bad.at) & set(found))
        blamed += len(set(found) - set(bad.at))
    assert caught >= CAUGHT[kind]
    assert blamed <= 1


def test_every_damage_can_be_made():
    rng = np.random.default_rng(1)
    good = run("softening", rng, 8)
    for kind in DAMAGES:
        bad = damaged(kind, good, rng)
        assert bad.at and not (
            np.array_equal(bad.heights, good.heights) and np.array_equal(bad.pressures, good.pressures)
        )


def test_a_height_that_is_off_is_named_with_the_one_expected():
    made = softening()
    made.heights[5] -= 408e-6
    found = told(made)
    assert list(found) == [5]
    assert "expected from the other photographs: 5.00 +- 0.0" in found[5]
    assert "mm at its pressure instead of 4.59 mm" in found[5]


def test_a_pressure_of_ten_times_and_two_swapped_rows_are_named():
    made = softening()
    made.pressures[2] *= 10.0
    found = told(made)
    assert list(found) == [2] and "the pressure in the list may be ten times what it was" in found[2]
    assert (
        "its pressure is outside the range" in told(rows([*softening().pressures[:-1], 15e3], softening().heights))[8]
    )
    made = softening()
    made.pressures[[3, 6]] = made.pressures[[6, 3]]
    found = told(made)
    assert sorted(found) == [3, 6]
    assert "its row and that of 6.jpg may be swapped" in found[3] and "that of 3.jpg may be swapped" in found[6]


def test_a_second_zero_that_is_not_flat_is_not_trusted_and_a_flat_one_is():
    heights, pressures = list(softening().heights), list(softening().pressures)
    assert told(rows([*pressures, 0.0], [*heights, 5e-6])) == {}
    found = told(rows([*pressures, 0.0], [*heights, 1.5e-3]))
    assert list(found) == [9] and "at zero pressure its outline rises 1.50 mm above the zero plane" in found[9]
    # A reading of zero within its error of 7 Pa lets a soft part rise a little.
    assert told(rows([*pressures, 5.0], [*heights, 30e-6])) == {}
    few = told(rows([0.0, 400.0, 0.0], [0.0, 2e-3, 1.5e-3]))
    assert list(few) == [2]


def test_pressures_below_zero_are_not_trusted():
    """Swapped tubes make all pressures negative; a gauge's zero that is off by less than its error is none."""
    made = softening()
    found = told(rows(-made.pressures, made.heights))
    assert sorted(found) == list(range(1, 9))
    assert "negative (-1500 Pa), and its outline rises by 8.00 mm: the sign is wrong, or the two tubes" in found[8]
    assert told(rows([*made.pressures, -12.0], [*made.heights, 0.0])) == {}
    assert "suction draws the surface in" in told(rows([*made.pressures, -300.0], [*made.heights, 0.0]))[9]


def test_a_run_that_does_not_rise_or_is_short_tells_nothing():
    assert told(rows([0.0, 300.0, 700.0, 1000.0, 1500.0], [0.0, 4e-6, -3e-6, 8e-6, 2e-6])) == {}
    assert told(rows([0.0, 500.0, 700.0], [0.0, 2e-3, 1e-3])) == {}
    assert course_of(rows([0.0, 500.0], [0.0, 2e-3]).outlines()) is None
    assert Run().contradictions == {}


def test_the_course_states_its_own_uncertainty():
    """Standardised residuals of points left out, and of new points between, over seeded runs."""
    off = []
    for seed in range(40):
        rng = np.random.default_rng([seed, 3])
        made = run(list(COURSES)[seed % 5], rng, int(rng.integers(6, 16)))
        course = Course.through(made.heights, made.pressures, made.height_errors, made.pressure_errors)
        expected, spread, tail = course.left_out()
        assert ((tail >= 0.0) & (tail <= 1.0)).all()
        off.append((made.pressures - expected) / spread)
    off = np.concatenate(off)
    assert np.mean(np.abs(off) < 1.0) > 0.3 and np.mean(np.abs(off) > 3.0) < 0.02


def test_the_picture_shows_the_course_and_names_the_stranger(tmp_path):
    made = softening()
    made.heights[5] += 1e-3
    outlines = made.outlines()
    odd = list(outlines)
    for k, doubt in told(made).items():
        odd[k] = dataclasses.replace(outlines[k], source="cost $5_a.jpg", trusted=False, reasons=(doubt,))
    draw_heights(tmp_path / "with.png", odd)
    draw_heights(tmp_path / "few.png", odd[:2])
    with Image.open(tmp_path / "with.png") as picture:
        shown = np.asarray(picture.convert("RGB")).reshape(-1, 3).astype(int)
    for colour, least in (((217, 226, 236), 500), ((192, 57, 43), 50), ((47, 111, 159), 200)):  # band, stranger, points
        assert np.sum(np.abs(shown - colour).max(axis=1) < 12) > least


def test_leaving_out_is_the_same_as_predicting_from_the_others():
    made = softening()
    course = Course.through(made.heights, made.pressures, made.height_errors, made.pressure_errors)
    expected, spread, tail = course.left_out()
    others = np.arange(9) != 4  # neither end, which sets the units
    alone = Course(course.heights[others], course.pressures[others], course.errors[others])
    again, wide, table = alone.at(course.heights[[4]], course.errors[4])
    assert again[0] == pytest.approx(expected[4], rel=1e-6)
    assert wide[0] == pytest.approx(spread[4], rel=1e-4)
    assert alone.tail(table, course.pressures[[4]])[0] == pytest.approx(tail[4], abs=1e-4)
    assert alone.height(float(course.pressures[4]), 4e-3)[0] == pytest.approx(4e-3, abs=20e-6)
    assert alone.height(9000.0, 4e-3) is None
