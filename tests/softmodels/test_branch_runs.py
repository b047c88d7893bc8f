"""``--branch`` on a disk with two equal membranes, of which one balloons in the end; as a section, in seconds."""

from __future__ import annotations

import itertools
import json

import numpy as np
import pytest

from geometries import HollowDisk, SeminarActuator
from softmodels.case.case import Case
from softmodels.case.load import steps_of
from softmodels.materials.laws import NeoHookean
from softmodels.path.supply import Syringe
from softmodels.runs.labels import StateLabels
from softmodels.runs.notes import jumped_over, stability_text, unlocated, unseen
from softmodels.runs.store import Results
from softmodels.runs.table import PathTable
from tests.support import runs

WORDS = StateLabels("tip")
TWIN = (
    "--variant", "shadow", "--base", "2mm", "--wall", "15mm", "--cell-size", "3mm",
    "--material", "yeoh", "--c1", "10kPa", "--c2", "20Pa", "--c3", "3Pa", "--poisson", "0.495",
)  # fmt: skip


@pytest.fixture(scope="module")
def twin(tmp_path_factory):
    folder = tmp_path_factory.mktemp("twin") / "disk"
    return folder, runs.disk(folder, *TWIN, "--volume-ml", "0:90:30", "--branch")


def test_the_bifurcation_is_met_and_told(twin):
    folder, done = twin
    assert done.status == 0, done.err
    rows = runs.rows(folder)
    (at,) = (k for k, row in enumerate(rows) if row["bifurcation"])
    (limit,) = (k for k, row in enumerate(rows) if row["limit"])
    assert 0 < limit < at < len(rows) - 1
    assert all(row["stable_under_volume"] for row in rows[: at + 1])
    assert not any(row["stable_under_volume"] for row in rows[at + 1 :])
    assert [event["kind"] for event in json.loads((folder / "summary.json").read_text())["events"]] == [
        "limit",
        "bifurcation",
    ]
    assert f"bifurcation at {rows[at]['pressure_cm']:.4g} cm" in done.out and "branch/" in done.out
    assert "--section wedge --angle 360deg" in done.out


def test_one_membrane_grows_along_the_branch(twin):
    folder, done = twin
    rows, branch = runs.rows(folder), runs.rows(folder / "branch")
    left = next(row for row in rows if row["bifurcation"])
    assert all(row["stable_under_volume"] for row in branch)
    away = [row["apex_mm"] - left["apex_mm"] for row in branch]
    assert all(abs(after) > abs(before) for before, after in itertools.pairwise(away))
    # At the end as much air is in it as on the path, at a lower pressure, and less energy is stored: it is preferred.
    assert branch[-1]["added_volume_ml"] >= 90 and branch[-1]["pressure_cm"] < rows[-1]["pressure_cm"]
    late = min(branch, key=lambda row: abs(row["added_volume_ml"] - 90))
    work = 1e-3 * rows[-1]["pressure_Pa"] * (late["added_volume_ml"] - rows[-1]["added_volume_ml"])  # in mJ
    assert late["stored_energy_mJ"] - work < rows[-1]["stored_energy_mJ"]
    summary = json.loads((folder / "branch" / "summary.json").read_text())
    assert summary["status"] == 0 and summary["steps"] == len(branch) and f"{len(branch)} states" in done.out


def test_a_run_that_meets_no_bifurcation_says_so_and_takes_the_old_branch_away(twin):
    folder = twin[0]
    (folder / "branch" / "notes.txt").write_text("mine")
    done = runs.disk(folder, *TWIN, "--volume-ml", "5", "--branch")
    assert done.status == 0 and "no bifurcation on this path" in done.err and "--angle 360deg" in done.err
    assert [path.name for path in (folder / "branch").iterdir()] == ["notes.txt"]


@pytest.mark.parametrize(
    ("device", "words"),
    [
        (HollowDisk(section="axisymmetric"), ("around the axis", "--section wedge --angle 360deg")),
        (HollowDisk(angle=45), ("a 1/8 model", "--angle 360deg")),
        (SeminarActuator(), ("a 1/2 model", "--part full")),
        (HollowDisk(angle=360), ()),
        (SeminarActuator(part="full"), ()),
    ],
)
def test_a_slice_says_what_it_cannot_show(device, words):
    text = unseen(device)
    assert all(word in text for word in words) and bool(text) == bool(words)


def test_a_bifurcation_that_was_passed_unlocated_is_told():
    keys = ("pressure_cm", "limit", "stable_under_pressure", "stable_under_volume", "negative_eigenvalues")
    table = ((30.0, 0, 1, 1, 0), (34.2, 1, 1, 1, 0), (34.0, 0, 0, 1, 1), (33.0, 0, 0, 0, 2))
    cells = [dict(zip(keys, values, strict=True)) for values in table]
    rows = PathTable.read(cells)
    found = PathTable.read([*cells[:3], {**cells[2], "bifurcation": 1}, cells[3]])
    assert unlocated(rows[:3], WORDS) == "" and unlocated(found, WORDS) == ""
    assert "between 34 and 33 cm could not be located" in stability_text(rows, SeminarActuator(part="full"), WORDS)


def test_a_syringe_that_cannot_hold_a_state_is_told():
    row = {"negative_eigenvalues": 1, "stable_under_pressure": 0, "stable_under_volume": 1, "pressure_cm": 33.0,
           "stroke_ml": 12.0, "stable_under_supply": 0}  # fmt: skip
    rows = PathTable.read([{**row, "stable_under_supply": 1, "stroke_ml": 11.0}, row])
    text = stability_text(rows, SeminarActuator(part="full"), WORDS)
    assert "at 12 ml of stroke (33 cm)" in text and "skipping 1 of the states" in text


# -- Runs of a syringe and of a column raised and lowered, from the command line to the table ------------------------


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
        assert (row["pressure_Pa"] + 101325) * now == pytest.approx(101325 * gas, rel=1e-3)  # a mesh's cavity is not quite it
    again = runs.run("-m", "softmodels", "run", tmp_path / "a" / "case.toml", "--output", tmp_path / "b", "--quiet",
                     "--no-pictures")  # fmt: skip
    assert again.status == 0
    runs.same(runs.rows(tmp_path / "a"), runs.rows(tmp_path / "b"), runs.REPEATED)


@pytest.mark.campaign
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
    # Cut off after the first jump, and resumed: what was stored stays, and the rest is the same.
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
    case = Case("disk", HollowDisk(), NeoHookean(30e3), steps=steps_of(stroke_ml=(0.0, 10 / 3)), supply=syringe)
    assert Case.from_toml(case.to_toml()) == case
    cycle = Case("disk", HollowDisk(), NeoHookean(30e3), steps=steps_of(pressure_cm=(10.0,)), load_unload=True)
    assert Case.from_toml(cycle.to_toml()) == cycle


def test_states_that_a_syringe_jumps_over():
    """All between the stroke's limit point and the landing, held or not; with no landing all to the end."""
    told = [(1, 0, 0), (1, 1, 0), (0, 0, 0), (1, 0, 0), (1, 0, 1), (1, 0, 0)]
    rows = PathTable.read(dict(zip(("stable_under_supply", "stroke_limit", "jump"), row, strict=True)) for row in told)
    assert jumped_over(rows) == [2, 3]
    assert jumped_over(rows[:4]) == [2, 3] and jumped_over(rows[:2]) == []
    assert jumped_over(PathTable.read([{"jump": 0}, {"jump": 1}])) == []
