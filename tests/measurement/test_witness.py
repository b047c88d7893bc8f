"""A run's photographs as each other's witnesses: single wrong rows are named, and good runs of every kind keep their trust."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from measurement.camera import Camera
from measurement.outline.outline import Outline
from measurement.outline.zero import Displacement, Sides, ZeroLine, sides_of, with_known_body
from measurement.screen.setup import Plane, Setup, SetupError
from measurement.series.checks import RunEvidence, moved, scaling, settling
from measurement.series.drawing import draw_heights
from measurement.series.witness import Course, Run, course_of
from tests.support.campaigns import sampled
from tests.support.photographs.courses import COURSES, DAMAGES, Rows, damaged, run

STEPS = np.linspace(0.0, 1.0, 9)


def rows(pressures, heights, height_error=3e-6):
    count = len(heights)
    return Rows(np.asarray(heights, float), np.asarray(pressures, float), np.full(count, height_error), np.full(count, 7.0))


def softening(count=9):
    """A run of a softening part: 8 mm at 1500 Pa."""
    steps = np.linspace(0.0, 1.0, count)
    return rows(1500.0 * (1.6 * steps - 0.6 * steps**2), 8e-3 * steps)


def told(made):
    return Run(dict(enumerate(made.outlines()))).contradictions


@pytest.mark.parametrize("kind", sampled(COURSES, 2))
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
        assert bad.at and not (np.array_equal(bad.heights, good.heights) and np.array_equal(bad.pressures, good.pressures))


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
    assert "its pressure is outside the range" in told(rows([*softening().pressures[:-1], 15e3], softening().heights))[8]
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


# -- A soft body's own sinking beside its bulge, told from a body that was moved -------------------------------------


HEIGHTS = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 7.0, 9.0]) * 1e-3
X = np.linspace(-0.02, 0.02, 201)


def own(height):
    """Sinking of a thick disk beside its bulge in m: an eighth of the height, a little more as it rises."""
    return 0.11 * height + 5.0 * height**2


def outline(height, sunk):
    return Outline(X, height * (1 - (X / 0.02) ** 2) ** 3, np.full(len(X), 1e-6), 1e3, 1.0, "test", sunk=sunk)


def settling_doubts(outlines):
    sunk_run = Run(dict(enumerate(outlines)))
    found = [next(settling(RunEvidence(sunk_run, k)), None) for k in range(len(outlines))]
    return [doubt and str(doubt) for doubt in found]


def sunk_run(heights=HEIGHTS, moved=0.0, at=None, moved_at=0.0):
    """Outlines of a run in which the body was moved after the zero photograph, or for one photograph."""
    raised = heights > 0.0
    sunk = np.where(raised, own(heights) + moved, 0.0)
    if at is not None:
        sunk[at] += moved_at
    return settling_doubts([outline(height, max(0.0, depth)) for height, depth in zip(heights, sunk, strict=True)])


def test_a_soft_body_is_trusted():
    assert sunk_run() == [None] * len(HEIGHTS)
    assert sunk_run(HEIGHTS[:5]) == [None] * 5


def test_a_stiff_body_is_trusted_however_few_the_photographs():
    assert settling_doubts([outline(4e-3, 30e-6)]) == [None]


@pytest.mark.parametrize("heights", [HEIGHTS, HEIGHTS[:6], HEIGHTS[1:5]], ids=len)
def test_a_body_moved_after_the_zero_photograph_is_not(heights):
    found = sunk_run(heights, moved=0.2e-3)
    assert all("without any pressure" in doubt for doubt, height in zip(found, heights, strict=True) if height)


def test_a_lifted_body_that_sinks_back_as_it_rises_is_not_trusted():
    raised = HEIGHTS > 0.0
    sunk = np.where(raised, 0.03 * HEIGHTS - 0.155e-3, 0.0)
    found = settling_doubts([outline(height, depth) for height, depth in zip(HEIGHTS, sunk, strict=True)])
    assert found[0] is None
    assert all("above the plane without any pressure" in doubt for doubt in found[1:])
    assert "above the zero plane" in found[1] and "below the zero plane" in found[-1]


@pytest.mark.parametrize("at", [2, 4, 6])
@pytest.mark.parametrize("by", [0.3e-3, -0.3e-3])
def test_a_body_moved_for_one_photograph_is_not_trusted_there(at, by):
    found = sunk_run(at=at, moved_at=by)
    assert "moved for this one" in found[at] and ("more" if by > 0.0 else "less") in found[at]
    assert [doubt for number, doubt in enumerate(found) if number != at] == [None] * (len(found) - 1)


def test_few_photographs_tell_nothing():
    found = sunk_run(HEIGHTS[:4])
    assert found[0] is None and all("fewer than four" in doubt for doubt in found[1:])


@pytest.mark.parametrize(("degrees", "seen"), [(0.0, True), (0.15, True), (-0.15, True), (0.6, True), (0.15, False)])
def test_a_body_whose_sides_sink_by_different_depths_was_tilted(degrees, seen):
    """By how much its middle was lifted nothing tells, where it sinks by a depth of its own: no more than its ends."""
    rng, half, height = np.random.default_rng(3), 14e-3, 7e-3
    x = np.linspace(-half, half, 500)
    share = np.abs(x) / half
    z = height * np.clip(1.0 - (x / 10e-3) ** 2, 0.0, 1.0) ** 3 - 0.9e-3 * share**2 * (3.0 - 2.0 * share)
    turned = z + np.tan(np.radians(degrees)) * (x - 8e-3) + 2e-6 * rng.normal(size=500)
    keep = ~((x > -13e-3) & (x < -12.5e-3))  # a speck beside one of them makes it no lower
    upwards = 1.0 / np.sqrt(1.0 + np.gradient(z, x) ** 2)
    sides = Sides(-3e-3, 2.0 * half, 0.0, 1e-6) if seen else None
    zero = ZeroLine(np.zeros(2), np.array([1.0, 0.0]), extent=(-half, half), sides=sides)
    placed = np.column_stack([x, turned])[keep]
    found = Displacement.of(placed, upwards[keep], np.full(keep.sum(), 2e-6), zero)
    assert found.sunk > 0.8e-3
    assert found.error == pytest.approx(abs(np.tan(np.radians(degrees))) * 13e-3 * seen, rel=0.08, abs=1e-9)
    doubt = next(moved(SimpleNamespace(above=np.ones(400), standing=True, displaced=found)), None)
    assert (doubt is not None) == (degrees == 0.6)


# -- The body's width as the scale of photographs: its measurement, and what it says of a run ------------------------


MEASURED_HEIGHTS = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0]) * 1e-3
RIGHT = ZeroLine.through(np.array([[0.0, 0.0], [1.0, 0.0]]))


def body(width=30e-3, lean=0.0, noise=2e-6, bottom=-4e-3):
    """Edge of a body: left side, surface, right side; and the cosines of its normals to the surface's."""
    rng = np.random.default_rng(0)
    z = np.arange(bottom, 0.0, 60e-6)
    x = 0.5 * width + 0.5 * lean * z
    flat = np.arange(-0.5 * width, 0.5 * width, 60e-6)
    edge = np.vstack([np.column_stack([-x, z]), np.column_stack([flat, 0.0 * flat]), np.column_stack([x, z])[::-1]])
    upwards = np.r_[0.0 * z, np.ones(len(flat)), 0.0 * z]
    return edge + rng.normal(0.0, noise, edge.shape), upwards, np.full(len(edge), noise)


def test_the_width_is_that_of_the_sides():
    sides = sides_of(*body(lean=0.02))
    assert sides.width_at(0.0) == pytest.approx(30e-3, abs=5e-6)
    assert 0.0 < sides.error < 3e-6
    assert sides_of(*body(bottom=-0.5e-3)) is None


def scaled_run(larger, heights=MEASURED_HEIGHTS):
    x = np.linspace(-1e-2, 1e-2, 41)
    return [
        Outline(x, height * (1 - (x / 1e-2) ** 2), np.full(41, 1e-6), 1e5 * height, 1.0, f"{height}", scale=1.0 + by)
        for height, by in zip(heights, np.broadcast_to(larger, len(heights)), strict=True)
    ]


def scaling_doubts(outlines):
    scaled_run = Run(dict(enumerate(outlines)))
    found = [next(scaling(RunEvidence(scaled_run, k)), None) for k in range(len(outlines))]
    return [doubt and str(doubt) for doubt in found]


def test_a_body_that_stood_still_is_trusted_and_so_is_one_whose_sides_give_way():
    assert scaling_doubts(scaled_run(0.0)) == [None] * 6
    assert scaling_doubts(scaled_run(1e-4 * np.array([0, 1, -1, 1, -1, 0]))) == [None] * 6
    assert scaling_doubts(scaled_run(4.0 * MEASURED_HEIGHTS)) == [None] * 6


def test_a_body_that_was_moved_after_the_zero_is_trusted_nowhere():
    found = scaling_doubts(scaled_run(np.r_[0.0, np.full(5, 0.005)]))
    assert found[0] is None
    assert all("0.50% farther apart" in doubt and "along the light since the zero" in doubt for doubt in found[1:])


def test_a_body_that_was_moved_once_is_not_trusted_there():
    found = scaling_doubts(scaled_run(np.array([0.0, 0.0, 0.0, -0.008, 0.0, 0.0])))
    assert [doubt is None for doubt in found] == [True, True, True, False, True, True]
    assert "0.80% nearer" in found[3]
    assert "for this one" in found[3]


def test_two_photographs_cannot_tell_a_soft_side_from_a_moved_body():
    assert "or its sides deform" in scaling_doubts(scaled_run(0.01, np.array([0.0, 3e-3])))[1]


def test_a_known_width_gives_the_magnification():
    corners = np.array([[0, 0], [100, 0], [100, 100], [0, 100], [50, 50]], dtype=float)
    setup = Setup(Camera.ideal(200, 200), Plane.fit(corners, corners * 1e-4, 0.01), grid_pitch=9e-3)
    zero = dataclasses.replace(RIGHT, sides=sides_of(*body(width=30.6e-3)))
    known = with_known_body(setup, zero, 30e-3, 15e-6)
    assert known.magnification == pytest.approx(1.02, abs=1e-4)
    assert known.magnification_error == pytest.approx(1.02 * 15e-6 / 30e-3, rel=0.1)
    with pytest.raises(SetupError, match="another body or another unit"):
        with_known_body(setup, zero, 30e-6)
    with pytest.raises(SetupError, match="does not show both sides"):
        with_known_body(setup, RIGHT, 30e-3)


def test_a_width_that_contradicts_pitch_and_distances_is_refused():
    zero = ZeroLine.through(np.array([[-0.01, 0.0], [0.01, 0.0]]))
    zero = dataclasses.replace(zero, sides=Sides(-1e-3, 30.6e-3, 0.0, 2e-6))
    corners = np.array([[0, 0], [100, 0], [100, 100], [0, 100], [50, 50]], dtype=float)
    setup = Setup(Camera.ideal(200, 200), Plane.fit(corners, corners * 1e-4, 0.01), grid_pitch=9e-3)
    known = dataclasses.replace(setup, magnification=1.02, magnification_error=0.001, pitch_error=0.002)
    with pytest.raises(SetupError, match=r"differ by \+2.00%.*measure the pitch"):
        with_known_body(known, zero, 30e-3)
    # With no distance given nothing contradicts it, and the width is the unit of length.
    free = with_known_body(dataclasses.replace(known, magnification=1.0, magnification_error=0.0), zero, 30e-3)
    assert (free.magnification, free.pitch_error) == (pytest.approx(1.02), 0.0)


def test_a_surface_above_the_zero_plane_is_in_its_own_error_only():
    """Before: what an outline of a short run had in its error already was added a second time."""
    run = Run({0: outline(5e-3, 0.2e-3), 1: outline(6e-3, -0.1e-3)})
    assert run.unknown == {0: 0.2e-3}
