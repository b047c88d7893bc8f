"""What a run leaves: a table, fields that ParaView's reader takes, a case file that repeats it; and what it says."""

from __future__ import annotations

import itertools
import json
import sys
import time

import pytest

from softmodels.case.case import Case
from softmodels.runs.labels import StateLabels
from softmodels.runs.outcomes import Progress
from softmodels.runs.table import Row
from tests.support import runs
from tests.support.ranks import mpirun

COLUMNS = (
    "step", "pressure_cm", "pressure_Pa", "added_volume_ml", "apex_mm", "max_displacement_mm", "max_stretch",
    "max_von_mises_kPa", "J_min", "J_max", "newton_iterations",
)  # fmt: skip
FIELDS = {"displacement": 3, "p": 1, "von_mises": 1, "largest_stretch": 1, "J": 1}
READ = """
import json, sys
import pyvista
reader = pyvista.get_reader(sys.argv[1])
found = []
for time in map(float, sys.argv[2:]):
    reader.set_active_time_value(time)
    grid = reader.read()
    grid = grid[0] if isinstance(grid, pyvista.MultiBlock) and len(grid) == 1 else grid
    top = grid.find_closest_point((0.0, 0.0, 1.0))
    found.append({
        "times": list(reader.time_values), "kind": type(grid).__name__, "points": grid.n_points, "cells": grid.n_cells,
        "types": sorted(set(map(int, grid.celltypes))), "bounds": list(grid.bounds),
        "fields": {name: list(grid.point_data[name].shape) for name in grid.point_data},
        "top": [list(map(float, grid.points[top])), list(map(float, grid.point_data["displacement"][top]))],
        "stress": float(grid.point_data["von_mises"].max()),
    })
print(json.dumps(found))
"""


def read(folder, *times):
    """What PyVista finds in a folder's XDMF at some times, in a process of its own."""
    done = runs.run("-c", READ, folder / "disk.xdmf", *times)
    assert done.status == 0, done.err
    return json.loads(done.out)


def check(found, row, times):
    """One state as PyVista found it against its row of the table."""
    assert found["kind"] == "UnstructuredGrid" and found["types"] == [22] and found["times"] == pytest.approx(times)
    shapes = {name: [found["points"]] + [width] * (width > 1) for name, width in FIELDS.items()}
    assert found["fields"] == shapes
    assert found["bounds"] == pytest.approx([0, 0.020, 0, 0, 0, 0.016], abs=1e-9)
    (x, y, z), (u, v, w) = found["top"]
    assert (x, y, z) == pytest.approx((0, 0, 0.016), abs=1e-9) and (u, v) == pytest.approx((0, 0), abs=1e-9)
    assert 1e3 * w == pytest.approx(row["apex_mm"], rel=1e-7, abs=1e-12)
    # A mean over cells at the nodes against the largest at the integration points: near, never far above.
    assert 0.7 * row["max_von_mises_kPa"] <= found["stress"] / 1e3 <= 1.3 * row["max_von_mises_kPa"] + 1e-12


def test_table_has_its_columns_and_every_requested_pressure(whole):
    folder, done = whole
    assert done.status == 0
    rows = runs.rows(folder)
    assert set(COLUMNS) <= set(rows[0]) and [row["step"] for row in rows] == list(range(len(rows)))
    asked = [*(5.0 * i for i in range(36)), 177.0]
    assert [row["pressure_cm"] for row in rows if row["requested"]] == asked
    assert [row["pressure_Pa"] for row in rows] == pytest.approx([95.124505 * row["pressure_cm"] for row in rows], rel=1e-12)
    for name in (
        "pressure_cm",
        "added_volume_ml",
        "apex_mm",
        "max_displacement_mm",
        "max_stretch",
        "max_von_mises_kPa",
    ):
        column = [row[name] for row in rows]
        assert all(after > before for before, after in itertools.pairwise(column)), name
    assert all(row["J_min"] <= 1.0 <= row["J_max"] and row["limit"] == 0 for row in rows)
    assert rows[0]["apex_mm"] == rows[0]["newton_iterations"] == 0 and rows[-1]["newton_iterations"] > 0
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["status"] == 0 and summary["steps"] == len(rows) and summary["last"]["apex_mm"] == rows[-1]["apex_mm"]


def test_without_a_terminal_every_step_is_a_line(whole):
    folder, done = whole
    rows = runs.rows(folder)
    steps = [line for line in done.err.splitlines() if line.startswith("step ")]
    assert len(steps) == len(rows) and "\x1b" not in done.err
    assert all(f"{row['pressure_cm']:.3f} cm" in line for row, line in zip(rows, steps, strict=True))
    assert "177 cm" in done.out and f"{rows[-1]['apex_mm']:+.5g} mm" in done.out and str(folder) in done.out
    assert "path.csv, disk.vtkhdf for ParaView" in done.out and (folder / "disk.vtkhdf").exists()
    assert "pictures" not in done.out


def test_values_between_the_requested_ones_rise_too(tmp_path):
    done = runs.disk(tmp_path / "disk", "--volume-ml", "0,1.5,3", "--quiet")
    assert (done.status, done.out, done.err) == (0, "", "")
    rows = runs.rows(tmp_path / "disk")
    assert len(rows) > 10 and [row["added_volume_ml"] for row in rows if row["requested"]] == pytest.approx(
        [0, 1.5, 3], abs=1e-8
    )
    assert sorted(rows, key=lambda row: row["added_volume_ml"]) == rows


@pytest.mark.campaign
def test_paraviews_reader_finds_all_fields_on_one_grid_during_and_after(whole, tmp_path):
    folder = tmp_path / "disk"
    process = runs.start(*runs.DISK, "--output", folder, "--pressure-cm", "0:177:5", "--quiet")
    written = folder / "disk.xdmf"
    while process.poll() is None and not (written.exists() and written.read_text().count("<Time") >= 4):
        time.sleep(0.005)
    process.kill()
    process.communicate(timeout=60)
    steps = (folder / "disk.xdmf").read_text().count("<Time")
    rows = runs.rows(folder)
    asked = [5.0 * step for step in range(36)] + [177.0]
    for found, row in zip(read(folder, 5, 15), (rows[1], rows[3]), strict=True):
        check(found, row, asked[:steps])
    during, after = read(folder, 0)[0], read(whole[0], 0, 177)
    assert during["points"] == after[0]["points"] == after[1]["points"] > 500 and during["cells"] == after[0]["cells"] > 200
    rows = runs.rows(whole[0])
    for found, row in zip(after, (rows[0], rows[36]), strict=True):
        check(found, row, asked)
    assert sorted(path.name for path in whole[0].iterdir()) == [
        ".softmodels.json", "case.toml", "disk.h5", "disk.msh", "disk.vtkhdf", "disk.xdmf", "path.csv", "summary.json",
    ]  # fmt: skip


def test_a_case_file_repeats_its_run(whole, tmp_path):
    case = Case.from_file(whole[0] / "case.toml")
    assert case.values[-1].number == 177.0 and len(case.values) == 37 and case.actuator.section == "axisymmetric"
    done = runs.run(
        "-m", "softmodels", "run", whole[0] / "case.toml", "--output", tmp_path / "again", "--no-pictures", "--quiet"
    )
    assert (done.status, done.out, done.err) == (0, "", "")
    runs.same(runs.rows(tmp_path / "again"), runs.rows(whole[0]), runs.REPEATED)
    assert (tmp_path / "again" / "case.toml").read_bytes() == (whole[0] / "case.toml").read_bytes()


def test_a_second_run_replaces_the_first_and_nothing_else(whole_copy):
    (whole_copy / "notes.txt").write_text("mine")
    (whole_copy / "profile.png").write_text("mine")
    done = runs.disk(whole_copy, "--pressure-cm", "20", "--quiet")
    assert (done.status, done.out, done.err) == (0, "", "")
    rows = runs.rows(whole_copy)
    assert rows[-1]["pressure_cm"] == 20.0 and len(rows) < 20
    assert (whole_copy / "notes.txt").read_text() == (whole_copy / "profile.png").read_text() == "mine"
    assert (whole_copy / "disk.xdmf").read_text().count("<Time") == len(rows)


def test_a_run_goes_on_to_higher_pressures(whole, whole_copy):
    rows = runs.rows(whole_copy)
    done = runs.disk(whole_copy, "--pressure-cm", "0,177,190", "--quiet", "--resume")
    assert (done.status, done.err) == (0, "")
    longer = runs.rows(whole_copy)
    assert longer[: len(rows)] == rows and longer[-1]["pressure_cm"] == 190.0 and longer[-1]["requested"] == 1


@pytest.mark.campaign
def test_two_ranks_say_everything_once_and_find_the_same(whole, tmp_path):
    done = runs.disk(tmp_path / "disk", "--pressure-cm", "0:177:5", launcher=[mpirun(), "-n", "2"])
    assert done.status == 0, done.err
    runs.same(runs.rows(tmp_path / "disk"), runs.rows(whole[0]), 1e-8)
    said = done.err.splitlines()
    assert len(said) == len(set(said)) == len(whole[1].err.splitlines()) and "2 ranks" in done.err
    alone = done.out.replace(str(tmp_path / "disk"), str(whole[0])).replace("; solved on 2 ranks", "")
    assert alone == whole[1].out and done.out.endswith("solved on 2 ranks\n")


def test_a_run_outlives_the_reader_of_its_log(tmp_path):
    process = runs.start(*runs.DISK, "--output", tmp_path / "disk", "--pressure-cm", "0:177")
    process.stderr.readline()
    process.stderr.close()
    assert "177 cm" in process.stdout.read()
    assert process.wait(timeout=60) == 0 and runs.rows(tmp_path / "disk")[-1]["pressure_cm"] == 177.0
    process.stdout.close()


def test_a_terminal_shows_a_bar(monkeypatch, capsys):
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    row = {"step": 3, "pressure_cm": 88.5, "apex_mm": 2.0, "added_volume_ml": 1.0, "newton_iterations": 2}
    with Progress(StateLabels("apex"), False, "pressure", "177 cm") as progress:
        progress.step(Row(row), 0.5)
        bar = progress._bar.tasks[0]
        assert bar.completed == 0.5 and bar.total == 1.0 and bar.description == "88.5 cm of 177 cm"
    assert "step   3" in capsys.readouterr().err.rstrip("\n")
