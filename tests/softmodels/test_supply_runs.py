"""Runs of a syringe and of a column raised and lowered, from the command line to the table."""

from __future__ import annotations

import json

import numpy as np
import pytest

from geometries import HollowDisk
from softmodels.case.case import Case
from softmodels.materials.laws import NeoHookean
from softmodels.path.supply import Syringe
from softmodels.runs.notes import jumped_over
from softmodels.runs.store import Results
from tests.support import runs

SHADOW = ("--variant", "shadow", "--support", "base", "--quiet")


def test_a_syringe_run_repeats_itself_from_its_case_file(tmp_path):
    options = ("--supply", "syringe", "--stroke-ml", "0:20:10", "--dead-volume", "8ml", "--shear-modulus", "20kPa")
    done = runs.disk(tmp_path / "a", *SHADOW, *options)
    assert done.status == 0, done.err
    rows = runs.rows(tmp_path / "a")
    assert [row["stroke_ml"] for row in rows if row["requested"]] == pytest.approx([0, 10, 20])
    gas = 28.0 + HollowDisk.variant("shadow").cavity_volume * 1e6
    for row in rows:
        now = gas - row["stroke_ml"] + row["added_volume_ml"]
        assert (row["pressure_Pa"] + 101325) * now == pytest.approx(
            101325 * gas, rel=1e-3
        )  # a mesh's cavity is not quite it
    again = runs.run("-m", "softmodels", "run", tmp_path / "a" / "case.toml", "--output", tmp_path / "b", "--quiet",
                     "--no-pictures")  # fmt: skip
    assert again.status == 0
    runs.same(runs.rows(tmp_path / "a"), runs.rows(tmp_path / "b"), runs.REPEATED)


def test_a_cycle_comes_home_and_says_where_it_jumped(tmp_path):
    law = ("--material", "yeoh", "--c1", "10kPa", "--c2", "20Pa", "--c3", "3Pa", "--poisson", "0.495")
    done = runs.disk(tmp_path / "disk", *SHADOW, *law, "--load-unload", "--pressure-cm", "0,20,37")
    assert done.status == 0, done.err
    rows = runs.rows(tmp_path / "disk")
    asked = [row["pressure_cm"] for row in rows if row["requested"]]
    assert asked == pytest.approx([0, 20, 37, 37, 20, 0])
    jumps = [k for k, row in enumerate(rows) if row["jump"]]
    assert len(jumps) == 2
    for k in jumps:
        assert rows[k]["pressure_cm"] == pytest.approx(rows[k - 1]["pressure_cm"]) and rows[k - 1]["limit"]
    volumes = np.array([row["added_volume_ml"] for row in rows])
    assert volumes[jumps[0]] > 3 * volumes[jumps[0] - 1] and volumes[jumps[1]] < volumes[jumps[1] - 1] / 3
    events = json.loads((tmp_path / "disk" / "summary.json").read_text())["events"]
    assert [event["kind"] for event in events] == ["limit", "jump", "limit", "jump"]
    # Cut off after the first jump, and gone on with: what was stored stays, and the rest is the same.
    results = Results(tmp_path / "disk", "disk")
    results.load()
    results.stored = results.stored[: jumps[0] + 2]
    results.finish()
    other = runs.disk(tmp_path / "disk", *SHADOW, *law, "--load-unload", "--pressure-cm", "0,20,36", "--resume")
    assert other.status == 2 and "other pressures" in other.err
    again = runs.disk(tmp_path / "disk", *SHADOW, *law, "--load-unload", "--pressure-cm", "0,20,37", "--resume")
    assert again.status == 0 and runs.rows(tmp_path / "disk") == rows


def test_a_case_with_a_syringe_survives_its_file():
    syringe = Syringe(30e-6, 1e-6 / 3, 98765.4, "adiabatic", 1234.5)
    case = Case("disk", HollowDisk(), NeoHookean(30e3), strokes_ml=(0.0, 10 / 3), supply=syringe)
    assert Case.from_toml(case.to_toml()) == case
    cycle = Case("disk", HollowDisk(), NeoHookean(30e3), pressures_cm=(10.0,), load_unload=True)
    assert Case.from_toml(cycle.to_toml()) == cycle


def test_states_that_a_syringe_jumps_over():
    """All between the stroke's limit point and the landing, held or not; with no landing all to the end."""
    told = [(1, 0, 0), (1, 1, 0), (0, 0, 0), (1, 0, 0), (1, 0, 1), (1, 0, 0)]
    rows = [dict(zip(("stable_under_supply", "stroke_limit", "jump"), row, strict=True)) for row in told]
    assert jumped_over(rows) == [2, 3]
    assert jumped_over(rows[:4]) == [2, 3] and jumped_over(rows[:2]) == []
    assert jumped_over([{"jump": 0}, {"jump": 1}]) == []
