"""Components on a piece that some ranks have nothing of: two and three ranks find what one does, or end with its sentence."""

from __future__ import annotations

import numpy as np
import pytest

from tests.support import on_ranks
from tests.support.campaigns import sampled
from tests.support.on_ranks.pieces import CASES
from tests.support.ranks import figures_on

LONGEST = 1500.0
"""Seconds after which a launch counts as hanging; the last case that its errors name is the one."""


FLOOR = 1e-3
"""Largest number of a column below which its differences are rounding."""
LOOSER = {"lowest_eigenvalue_Pa_per_mm2": 1e-6}


def program_of(request, test=""):
    """The program of the cases that this run asks for, or that one of its tests does."""
    items = [item for item in request.session.items if item.path == request.path and test in ("", item.originalname)]
    asked = {item.callspec.params["name"] for item in items}
    return "pieces-" + ";".join(name for name in CASES if name in asked)


@pytest.fixture(scope="module")
def alone(request, comm, tmp_path_factory):
    return on_ranks.found_by(program_of(request), comm, tmp_path_factory.mktemp("one"))


@pytest.fixture(scope="module")
def on_two(request, tmp_path_factory):
    program = program_of(request, "test_a_piece_may_be_missing_on_a_rank")
    return figures_on(2, tmp_path_factory.mktemp("two"), program, timeout=LONGEST)[program]


@pytest.fixture(scope="module")
def on_three(request, tmp_path_factory):
    program = program_of(request, "test_a_piece_may_be_missing_on_two_ranks")
    return figures_on(3, tmp_path_factory.mktemp("three"), program, timeout=LONGEST)[program]


@pytest.mark.parametrize("name", sampled(CASES, ("region", "rigid parts", "no such piece")))
def test_a_piece_may_be_missing_on_a_rank(name, alone, on_two):
    check(name, alone, on_two)


@pytest.mark.campaign
@pytest.mark.parametrize("name", [*CASES][::3])
def test_a_piece_may_be_missing_on_two_ranks(name, alone, on_three):
    """Of three; a third of the cases."""
    check(name, alone, on_three)


def check(name, alone, several):
    """Compare the columns of a case on several ranks with those on one."""
    if name == "no such piece":
        assert alone[name] == several[name] and "selects nothing" in alone[name]
        return
    one, found = alone[name], several[name]
    assert one.keys() == found.keys()
    for column, values in one.items():
        size = max(np.abs(np.nan_to_num(values)).max(), FLOOR)
        bound = LOOSER.get(column, 1e-8)
        np.testing.assert_allclose(found[column], values, rtol=0.0, atol=bound * size, err_msg=column, equal_nan=True)
