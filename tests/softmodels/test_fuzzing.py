"""A hundred of the random inputs of ``tests/benchmarks/fuzz.py``: each ends in a result, or in a sentence and its status."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.benchmarks import fuzz
from tests.support.campaigns import sampled

COUNT, SEED = 100, 7


@pytest.mark.parametrize("count", sampled([20, COUNT]))
def test_random_inputs_end_in_a_result_or_in_a_sentence(count, tmp_path):
    found = fuzz.campaign(fuzz.Bench(tmp_path, measure=False), count, SEED)
    assert len(found) == count
    assert [(one.kind, one.attempt, one.fault) for one in found if one.fault] == []
    assert {one.status for one in found} >= {0, 2}


def test_faults_are_seen(tmp_path, monkeypatch):
    """What the campaign is there for: a traceback, a status without a sentence, a touched file."""
    bench = fuzz.Bench(tmp_path, measure=False)
    attempt = fuzz.inputs.Attempt("softmodels", ("run", "case.toml"), {"case.toml": b"x"})
    assert bench.tried("case", attempt).fault == "" and bench.tried("case", attempt).status == 2

    def faulty(error):
        def main(command):
            raise error

        monkeypatch.setattr("softmodels.cli.ending.main", main)
        return bench.tried("case", attempt).fault

    assert "ZeroDivisionError" in faulty(ZeroDivisionError())
    assert faulty(SystemExit(2)) == "status 2 without a sentence"
    assert faulty(SystemExit(120)) == "status 120"
    monkeypatch.setattr("softmodels.cli.ending.main", lambda command: Path("case.toml").write_text("y"))
    assert bench.tried("case", attempt).fault == "files of the user were touched"
