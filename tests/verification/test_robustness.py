"""Twelve of the random cases of ``tests/benchmarks/robustness.py``, sections alone."""

from __future__ import annotations

from tests.benchmarks import robustness

COUNT = 12


def test_random_cases_end_in_their_curve_or_in_a_limit(comm):
    found = [robustness.examine(trial, comm) for trial in robustness.trials(COUNT)]
    assert [one.fault for one in found if one.fault] == []
    assert {one.ended for one in found} == {"reached", "limit"}
