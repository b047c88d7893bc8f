"""What a report tells beside its pictures: the run's warnings, its contact, its mode, and what every column is."""

from __future__ import annotations

import csv
import html
import json
import re

import pytest
from PIL import Image

from geometries import HollowDisk, SeminarActuator
from softmodels.case.load import steps_of
from softmodels.pictures import report
from softmodels.pictures.offscreen import look
from softmodels.runs.columns import term
from softmodels.runs.states import FolderStates
from tests.support import runs

SOFT = ("--variant", "shadow", "--material", "ecoflex-00-30", "--volume-ml", "0:120:60", "--quiet")
"""Stretches the silicone beyond what it was fitted over."""


def page(folder):
    """The report of a folder, written anew without pictures."""
    return report.Report(look(FolderStates(folder, "disk")), folder, "disk").write().read_text()


@pytest.fixture(scope="module")
def stretched(tmp_path_factory):
    folder = tmp_path_factory.mktemp("stretched") / "disk"
    assert runs.disk(folder, *SOFT).status == 0
    return folder


@pytest.fixture(scope="module")
def pressed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pressed") / "disk"
    plate = ("--support", "base", "--contact", "top", "--contact-plane", "z = 17mm", "--quiet")
    assert runs.disk(folder, "--pressure-cm", "0:177:59", *plate).status == 0
    return folder


def test_the_runs_warnings_stand_at_the_top_of_its_report(stretched):
    notes = json.loads((stretched / "summary.json").read_text())["notes"]
    assert any("the end of the fitted range of ecoflex-00-30" in note for note in notes)
    text = page(stretched)
    warned = text.split('<section class="warn" role="alert">')[1].split("</section>")[0]
    assert warned.count("<li>") == len(notes) and "extrapolation" in warned
    assert text.index("extrapolation") < text.index("3-D view")


@pytest.mark.campaign
def test_warnings_are_there_without_a_summary_too(stretched, tmp_path):
    """A run that was killed has none; the states alone tell."""
    text = (stretched / "summary.json").read_text()
    (stretched / "summary.json").unlink()
    try:
        assert "extrapolation" in page(stretched) and "was interrupted" in page(stretched)
    finally:
        (stretched / "summary.json").write_text(text)


def test_the_answer_comes_first_with_the_numbers_of_the_path(stretched):
    """Rise, limit and largest stretch as in path.csv, the stretch as a warning, above everything else."""
    with (stretched / "path.csv").open() as file:
        rows = list(csv.DictReader(file))
    most = max(float(row["max_stretch"]) for row in rows)
    text = page(stretched)
    answer = text.split('<dl class="facts">')[1].split("</dl>")[0]
    assert text.index('<dl class="facts">') < text.index('role="alert"') < text.index("3-D view")
    assert f"<b>{float(rows[-1]['apex_mm']):.4g} mm</b>" in answer
    highest = max(float(row["pressure_cm"]) for row in rows)
    assert f"<b>none up to {highest:.1f} cm, 0.97 g/ml" in answer
    assert f'<div class="alarm"><dt>Largest stretch</dt><dd><b>{most:.4g}</b><span>Warning: fitted up to 3.01' in answer


def test_the_margin_to_the_limit_point_that_was_met(wedge):
    facts = {fact.label: fact for fact in report.facts(FolderStates(wedge, "disk"), {})}
    limit = facts["Limit point of the pressure"]
    assert limit.value.startswith("120 cm, 0.97 g/ml") and limit.note == "1.2 times the last requested pressure"
    beyond = report.facts(FolderStates(wedge, "disk"), {"status": 3})[1]
    assert beyond.alarm and "no equilibrium" in beyond.note


def test_a_report_tells_where_its_numbers_come_from(stretched):
    record = json.loads((stretched / ".softmodels.json").read_text())["about"]["made"]
    text = page(stretched).split("<footer>")[1]
    for word in ("date", "version", "command"):
        assert record[word] and html.escape(record[word]) in text
    assert record["libraries"].keys() == {"DOLFINx", "PETSc"} and f"PETSc {record['libraries']['PETSc']}" in text
    assert record["seconds"] > 0.0 and f"{record['seconds']:.1f} s" in text
    assert "doi 10.5254/1.3538343" in text and "doi 10.1016/j.ijmecsci.2021.106624" in text  # Yeoh's law, Liao's silicone
    assert "residual below 1e-09" in page(stretched) and "The mesh error was not estimated" in page(stretched)


def test_a_quiet_run_has_no_warnings(pressed):
    assert 'role="alert"' not in page(pressed)


def test_a_contact_runs_report_tells_plane_and_force(pressed):
    with (pressed / "path.csv").open() as file:
        force = float(list(csv.DictReader(file))[-1]["contact_force_N"])
    text = page(pressed)
    assert "The rigid plane z = 17mm is in frictionless contact with top" in text
    assert f"{force:.4g} N" in text
    assert "<!-- contact force in N -->" in text, "no curve of the force"
    assert "contact of walls are not modelled" not in text and "stops only top" in text


def test_the_plane_is_in_the_pictures_and_a_cut_plane_is_not(pressed):
    shown = look(FolderStates(pressed, "disk"))
    assert shown.plate is not None and shown.plate[:, 2] == pytest.approx(0.017)
    assert len(shown.plate_layers(0)) == 2


def test_the_mode_is_in_the_report(pressed):
    Image.new("RGB", (1600, 400), "red").save(pressed / "mode.png")
    try:
        assert "The buckling mode at the first bifurcation" in page(pressed)
    finally:
        (pressed / "mode.png").unlink()


def test_every_column_is_explained_with_its_unit(pressed, stretched):
    for folder, device in ((pressed, HollowDisk()), (stretched, HollowDisk())):
        header = (folder / "path.csv").read_text().splitlines()[0].split(",")
        for column in header:
            meaning = term(column, device)
            assert meaning.text, column
            endings = "cm|mm|ml|Pa|kPa|mJ|N|deg|per_m|per_mm2|mm2|per_min|s"
            assert bool(meaning.unit) == bool(re.search(rf"_({endings})$", column)), column
        text = page(folder)
        assert all(f"<code>{column}</code>" in text for column in header)
    slab = SeminarActuator()
    for column in slab.figure_columns.values():
        assert term(column, slab).text, column


def test_a_curled_edge_is_not_called_a_soft_contact():
    """A stiffer contact is advised where faces sink in as a whole, not where an edge does under next to no force."""
    import dataclasses

    from geometries import HollowDisk
    from softmodels.case.case import Case
    from softmodels.case.materials import DEFAULT
    from softmodels.components.contact import Obstacle
    from softmodels.runs.notes import depth_notes
    from softmodels.runs.table import PathTable

    case = Case("disk", HollowDisk(), DEFAULT, steps_of(pressure_cm=(10.0,)), components=[Obstacle("top", "z = 20 mm")])
    row = {"contact_depth_mm": 0.3}
    (edge,) = depth_notes(case, PathTable.read([{**row, "contact_force_N": 0.05}]))
    (face,) = depth_notes(case, PathTable.read([{**row, "contact_force_N": 12.0}]))
    assert "an edge" in edge and "use a --contact-stiffness above" not in edge
    assert "use a --contact-stiffness above 300" in face
    assert not list(depth_notes(dataclasses.replace(case, components=()), PathTable.read([row])))
