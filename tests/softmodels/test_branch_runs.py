"""``--branch`` on a disk with two equal membranes, of which one balloons in the end; as a section, in seconds."""

from __future__ import annotations

import itertools
import json

import pytest

from geometries import HollowDisk, SeminarActuator
from softmodels.runs.columns import StateLabels
from softmodels.runs.notes import stability_text, unlocated, unseen
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
    rows = [dict(zip(keys, values, strict=True)) for values in table]
    assert (
        unlocated(rows[:3], WORDS) == "" and unlocated([*rows[:3], {**rows[2], "bifurcation": 1}, rows[3]], WORDS) == ""
    )
    assert "between 34 and 33 cm could not be located" in stability_text(rows, SeminarActuator(part="full"), WORDS)


def test_a_syringe_that_cannot_hold_a_state_is_told():
    row = {"negative_eigenvalues": 1, "stable_under_pressure": 0, "stable_under_volume": 1, "pressure_cm": 33.0,
           "stroke_ml": 12.0, "stable_under_supply": 0}  # fmt: skip
    text = stability_text(
        [{**row, "stable_under_supply": 1, "stroke_ml": 11.0}, row], SeminarActuator(part="full"), WORDS
    )
    assert "at 12 ml of stroke (33 cm)" in text and "skipping 1 of the states" in text
