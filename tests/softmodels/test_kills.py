"""A few of the random kills of ``tests/benchmarks/kills.py``."""

from __future__ import annotations

from tests.benchmarks import kills


def test_runs_killed_at_random_end_in_the_numbers_of_those_left_alone(tmp_path):
    count, faults = kills.campaign(["section", "limit", "cycle"], 3, 11, tmp_path)
    assert count == 3 and faults == []


def test_the_comparison_sees_what_it_should(tmp_path):
    one, other = tmp_path / "one.csv", tmp_path / "other.csv"
    one.write_text("step,pressure_cm,control,newton_iterations\n0,0.0,volume,2\n1,100.0,volume,2\n")
    other.write_text(one.read_text().replace("100.0", "100.0000002").replace("volume,2\n1", "volume,3\n1"))
    assert kills.differences(one, one) == {}
    assert list(kills.differences(one, other)) == ["pressure_cm"]
    other.write_text(one.read_text().replace("volume", "pressure"))
    assert list(kills.differences(one, other)) == ["control"]
    other.write_text("\n".join(one.read_text().splitlines()[:2]) + "\n")
    assert list(kills.differences(one, other)) == ["rows (2 against 1)"]
