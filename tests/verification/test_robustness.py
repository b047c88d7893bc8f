"""Twelve of the random cases of ``tests/benchmarks/robustness.py``, sections alone."""

from __future__ import annotations

import pytest

from tests.benchmarks import robustness
from tests.support.campaigns import sampled

COUNT = 12


@pytest.mark.campaign
@pytest.mark.parametrize("count", sampled([3, COUNT]))
def test_random_cases_end_in_their_curve_or_in_a_limit(count, comm):
    found = [robustness.examine(trial, comm) for trial in robustness.trials(count)]
    assert len(found) == count and [one.fault for one in found if one.fault] == []
    ends = {one.ended for one in found}
    assert ends <= {"reached", "limit"} and (len(ends) == 2 or count < COUNT)
