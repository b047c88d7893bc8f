"""Damaged photographs of random benches: none is wrong and trusted, and good ones stay good."""

from __future__ import annotations

import os
import sys

import pytest

from measurement.screen.grid import GridError
from tests.benchmarks import damaged_photographs
from tests.support.photographs import damaged_run
from tests.support.photographs.bench import Bench
from tests.support.photographs.damaged_run import Run
from tests.support.photographs.verdict import Verdict

BENCHES = (4, 5)


@pytest.fixture(scope="module", autouse=True)
def few():
    """Four photographs of the raised body in a run, where the benchmark takes six."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(damaged_run, "SHARES", (0.0, 0.1, 0.4, 0.7, 1.0))
        yield


@pytest.fixture(scope="module")
def runs():
    return [Run(Bench.random(seed)) for seed in BENCHES]


@pytest.mark.campaign
def test_good_photographs_of_the_benches_are_right_and_trusted(runs):
    for run in runs:
        verdicts = list(run.good_ones())
        assert [one.outcome for one in verdicts] == ["right"] * len(verdicts), verdicts


@pytest.mark.campaign
@pytest.mark.parametrize(
    ("kind", "outcomes"),
    [
        ("glint", ["refused", "refused"]),
        ("water drop on the lens", ["untrusted", "untrusted"]),
        ("fibre along", ["untrusted", "untrusted"]),
        ("dent", ["refused", "refused"]),
        ("screen bulging", ["refused", "untrusted"]),
        ("heat shimmer", ["refused", "untrusted"]),
    ],
)
def test_what_is_wrong_is_not_trusted(runs, kind, outcomes):
    verdicts = [one for run in runs for one in run.damaged(kind, 0)]
    assert [one.outcome for one in verdicts] == outcomes, verdicts


@pytest.mark.campaign
@pytest.mark.parametrize(
    ("kind", "first"),
    [("body moved after the zero", "refused"), ("body along the light after the zero", "untrusted")],
)
def test_a_body_that_was_moved_is_noticed_in_every_photograph(runs, kind, first):
    verdicts = list(runs[1].damaged(kind, 0))
    assert [one.outcome for one in verdicts] == [first, *["untrusted"] * 3], verdicts


@pytest.mark.campaign
def test_a_known_width_takes_a_wrong_magnification_out(runs):
    verdicts = list(runs[1].damaged("body along the light before the zero", 0))
    assert [one.outcome for one in verdicts] == ["right"] * 5, verdicts


@pytest.fixture(scope="module")
def drawn_in():
    """A bench whose body sinks beside its bulge."""
    return Run(Bench.random(37))


@pytest.mark.campaign
def test_a_drop_that_moves_the_flank_smoothly_is_seen_by_its_blur(drawn_in):
    (one,) = drawn_in.damaged("water drop on the lens", 0)
    assert one.outcome == "untrusted" and "more blurred than the rest" in one.why, one


@pytest.mark.campaign
def test_a_lifted_body_is_noticed_where_its_own_sinking_has_made_up_for_it(drawn_in):
    verdicts = list(drawn_in.damaged("body moved after the zero", 0))
    assert [one.outcome for one in verdicts] == ["untrusted"] * 4, verdicts


def test_the_benchmark_goes_on_after_a_bench_whose_grid_cannot_be_found(monkeypatch, capsys):
    class Fake:
        def __init__(self, bench):
            if bench.seed == 702:
                raise GridError("only 5 crossings of the grid can be measured")
            self.seed = bench.seed

        def good_ones(self):
            return iter(())

        def damaged(self, kind, seed):
            yield Verdict(kind, "small", self.seed, 1e-3, "right", "", True)

    monkeypatch.setattr(damaged_photographs, "Run", Fake)
    monkeypatch.delattr(os, "sched_setaffinity", raising=False)
    monkeypatch.setattr(sys, "argv", ["damaged_photographs.py", "--seed", "702", "--count", "1", "--kind", "dust"])
    assert damaged_photographs.main() == 0
    shown = capsys.readouterr().out
    assert "bench 702" in shown and "only 5 crossings" in shown
    assert "| dust | 1 | 1 | 0 | 0 | 0 | 0 |" in shown and "2 benches, 1 of them without a setup" in shown
