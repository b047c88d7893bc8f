"""Guesses of a linear answer from those before."""

from __future__ import annotations

import numpy as np
import pytest

from softmodels.mechanics.solver import MOST, EarlierAnswers

LOAD = np.ones(5)
BEND = np.arange(1.0, 6.0)


def place(t):
    """A point of a curve."""
    return np.outer([1.0, t, t * t], BEND).sum(axis=0) * np.array([1.0, t, -1.0, 2.0, t * t])


def answer(t):
    """What belongs to it, smooth in the same parameter."""
    return np.array([np.sin(t), np.exp(t), 1.0 + t])


@pytest.fixture
def known(comm):
    return EarlierAnswers(comm)


def test_nothing_is_known_at_first(known):
    assert known.guess(LOAD, place(0.0)) is None


@pytest.mark.parametrize("count", range(1, MOST + 1))
def test_its_error_falls_with_the_step_to_the_power_of_the_answers_kept(known, count):
    errors = []
    for step in (0.02, 0.01, 0.005):
        known.guess(None, place(0.0))  # of another load: all is forgotten
        known.guess(LOAD, place(0.0))
        for k in range(count):
            known.keep(place(1.0 + k * step), answer(1.0 + k * step))
        guess = known.guess(LOAD, place(1.0 + count * step))
        errors.append(np.abs(guess - answer(1.0 + count * step)).max())
    assert np.log2(errors[:2]) - np.log2(errors[1:]) == pytest.approx([count] * 2, abs=0.25)


def test_what_lies_elsewhere_is_answered_by_the_last(known):
    known.guess(LOAD, place(1.0))
    known.keep(place(1.0), answer(1.0))
    known.keep(place(1.1), answer(1.1))
    aside = place(1.1) + np.array([0.0, 0.0, 0.0, 0.0, -50.0])
    assert np.array_equal(known.guess(LOAD, aside), answer(1.1))


def test_one_state_twice_is_one(known):
    known.guess(LOAD, place(1.0))
    for _ in range(2):
        known.keep(place(1.0), answer(1.0))
    assert known.guess(LOAD, place(1.01)) == pytest.approx(answer(1.0))


def test_more_than_that_are_forgotten(known):
    known.guess(LOAD, place(1.0))
    for t in (1.0, *np.linspace(2.0, 2.1, MOST)):
        known.keep(place(t), answer(t))
    assert len(known._known) == MOST
