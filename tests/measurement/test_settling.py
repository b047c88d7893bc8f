"""A soft body's own sinking beside its bulge, told from a body that was moved."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from measurement.outline.outline import Outline
from measurement.outline.zero import Displacement, Sides, ZeroLine
from measurement.series.checks import Evidence, moved, settling
from measurement.series.witness import Run

HEIGHTS = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 7.0, 9.0]) * 1e-3
X = np.linspace(-0.02, 0.02, 201)


def own(height):
    """Sinking of a thick disk beside its bulge in m: an eighth of the height, a little more as it rises."""
    return 0.11 * height + 5.0 * height**2


def outline(height, sunk):
    return Outline(X, height * (1 - (X / 0.02) ** 2) ** 3, np.full(len(X), 1e-6), 1e3, 1.0, "test", sunk=sunk)


def settling_doubts(outlines):
    run = Run(dict(enumerate(outlines)))
    found = [next(settling(Evidence(run=run, number=k)), None) for k in range(len(outlines))]
    return [doubt and str(doubt) for doubt in found]


def run(heights=HEIGHTS, moved=0.0, at=None, moved_at=0.0):
    """Outlines of a run in which the body was moved after the zero photograph, or for one photograph."""
    raised = heights > 0.0
    sunk = np.where(raised, own(heights) + moved, 0.0)
    if at is not None:
        sunk[at] += moved_at
    return settling_doubts([outline(height, max(0.0, depth)) for height, depth in zip(heights, sunk, strict=True)])


def test_a_soft_body_is_trusted():
    assert run() == [None] * len(HEIGHTS)
    assert run(HEIGHTS[:5]) == [None] * 5


def test_a_stiff_body_is_trusted_however_few_the_photographs():
    assert settling_doubts([outline(4e-3, 30e-6)]) == [None]


@pytest.mark.parametrize("heights", [HEIGHTS, HEIGHTS[:6], HEIGHTS[1:5]], ids=len)
def test_a_body_moved_after_the_zero_photograph_is_not(heights):
    found = run(heights, moved=0.2e-3)
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
    found = run(at=at, moved_at=by)
    assert "moved for this one" in found[at] and ("more" if by > 0.0 else "less") in found[at]
    assert [doubt for number, doubt in enumerate(found) if number != at] == [None] * (len(found) - 1)


def test_few_photographs_tell_nothing():
    found = run(HEIGHTS[:4])
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
