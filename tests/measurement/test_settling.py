"""A soft body's own sinking beside its bulge, told from a body that was moved."""

from __future__ import annotations

import numpy as np
import pytest

from measurement.outline.outline import Outline
from measurement.outline.settling import doubts

HEIGHTS = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 7.0, 9.0]) * 1e-3
X = np.linspace(-0.02, 0.02, 201)


def own(height):
    """Sinking of a thick disk beside its bulge in m: an eighth of the height, a little more as it rises."""
    return 0.11 * height + 5.0 * height**2


def outline(height, sunk):
    return Outline(X, height * (1 - (X / 0.02) ** 2) ** 3, np.full(len(X), 1e-6), 1e3, 1.0, "test", sunk=sunk)


def run(heights=HEIGHTS, moved=0.0, at=None, moved_at=0.0):
    """Outlines of a run in which the body was moved after the zero photograph, or for one photograph."""
    raised = heights > 0.0
    sunk = np.where(raised, own(heights) + moved, 0.0)
    if at is not None:
        sunk[at] += moved_at
    return doubts([outline(height, max(0.0, depth)) for height, depth in zip(heights, sunk, strict=True)])


def test_a_soft_body_is_trusted():
    assert run() == [None] * len(HEIGHTS)
    assert run(HEIGHTS[:5]) == [None] * 5


def test_a_stiff_body_is_trusted_however_few_the_photographs():
    assert doubts([outline(4e-3, 30e-6)]) == [None]


@pytest.mark.parametrize("heights", [HEIGHTS, HEIGHTS[:6], HEIGHTS[1:5]], ids=len)
def test_a_body_moved_after_the_zero_photograph_is_not(heights):
    found = run(heights, moved=0.2e-3)
    assert all("without any pressure" in doubt for doubt, height in zip(found, heights, strict=True) if height)


def test_a_lifted_body_that_sinks_back_as_it_rises_is_not_trusted():
    raised = HEIGHTS > 0.0
    sunk = np.where(raised, 0.03 * HEIGHTS - 0.155e-3, 0.0)
    found = doubts([outline(height, depth) for height, depth in zip(HEIGHTS, sunk, strict=True)])
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
