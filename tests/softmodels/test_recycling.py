"""What linear solves leave for those that follow at the same state."""

from __future__ import annotations

import numpy as np
import pytest

N = 40


@pytest.fixture
def found():
    """A matrix and what is recycled of it: products with a few directions, one of them twice and one almost."""
    from mpi4py import MPI

    from softmodels.mechanics.recycling import Recycled

    generator = np.random.default_rng(5)
    A = generator.standard_normal((N, N)) + 8.0 * np.eye(N)
    recycled = Recycled(MPI.COMM_SELF)
    directions = generator.standard_normal((6, N))
    directions[4], directions[5] = directions[1], 3.0 * directions[2] + 1e-9 * directions[5]
    for direction in directions:
        recycled.note(direction, A @ direction)
    return A, directions, recycled


def test_what_was_found_is_answered_and_taken_out(found):
    A, directions, recycled = found
    recycled.take_up()
    answer = directions[:4].T @ [1.0, -2.0, 0.5, 3.0]
    left, known = recycled.take_out(A @ answer)
    np.testing.assert_allclose(known, answer, atol=1e-6)
    assert np.linalg.norm(left) < 1e-9 * np.linalg.norm(A @ answer)


def test_the_rest_is_left_alone(found):
    A, directions, recycled = found
    recycled.take_up()
    answers = np.array([A @ direction for direction in directions[:4]])
    r = np.random.default_rng(6).standard_normal(N)
    left, known = recycled.take_out(r)
    assert np.abs(answers @ left).max() < 1e-10 * np.linalg.norm(answers)
    np.testing.assert_allclose(left + A @ known, r, atol=1e-9)


def test_nothing_counts_before_it_is_taken_up_or_at_another_state(found):
    _, _, recycled = found
    r = np.ones(N)
    assert recycled.take_out(r)[1] is None
    recycled.take_up()
    here = np.zeros(3)
    recycled.state = here
    recycled.belong_to(here)
    assert recycled.take_out(r)[1] is not None
    recycled.belong_to(here.copy())
    assert recycled.take_out(r)[1] is None
