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


BY_DEFAULT = ("region", "rigid parts", "no such piece")
RUNS = [*((2, name) for name in CASES), *((3, name) for name in [*CASES][::3])]
"""Ranks and case: of three ranks one or two have nothing of a piece, which a third of the cases shows."""


def program_of(request, ranks=None):
    """The program of the cases that this run asks for, on so many ranks."""
    params = [item.callspec.params for item in request.session.items if item.path == request.path]
    asked = {own["name"] for own in params if ranks in (None, own["several"])}
    return "pieces-" + ";".join(name for name in CASES if name in asked)


@pytest.fixture(scope="module")
def alone(request, comm, tmp_path_factory):
    return on_ranks.found_by(program_of(request), comm, tmp_path_factory.mktemp("one"))


@pytest.fixture(scope="module")
def several(request, alone, tmp_path_factory):
    program = program_of(request, request.param)
    return figures_on(request.param, tmp_path_factory.mktemp("several"), program, timeout=LONGEST)[program]


@pytest.mark.parametrize(("several", "name"), sampled(RUNS, [(2, name) for name in BY_DEFAULT]), indirect=["several"])
def test_a_piece_may_be_missing_on_a_rank(name, alone, several):
    if name == "no such piece":
        assert alone[name] == several[name] and "selects nothing" in alone[name]
        return
    one, found = alone[name], several[name]
    assert one.keys() == found.keys()
    for column, values in one.items():
        size = max(np.abs(np.nan_to_num(values)).max(), FLOOR)
        bound = LOOSER.get(column, 1e-8)
        np.testing.assert_allclose(found[column], values, rtol=0.0, atol=bound * size, err_msg=column, equal_nan=True)
