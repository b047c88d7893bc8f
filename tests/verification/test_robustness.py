"""Twelve of the random cases of ``tests/benchmarks/robustness.py``, sections alone."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import pytest

PROGRAM = Path(__file__).parents[1] / "benchmarks" / "robustness.py"
COUNT = 12


@pytest.fixture(scope="module")
def program():
    spec = importlib.util.spec_from_file_location("robustness", PROGRAM)
    module = importlib.util.module_from_spec(spec)
    sys.modules["robustness"] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


def test_random_cases_end_in_their_curve_or_in_a_limit(program, comm):
    found = [program.examine(trial, comm) for trial in program.trials(COUNT)]
    assert [one.fault for one in found if one.fault] == []
    assert {one.ended for one in found} == {"reached", "limit"}
