"""What a report tells beside its pictures: the run's warnings, its contact, its mode, and what every column is."""

from __future__ import annotations

import csv
import json
import re
from importlib import resources

import pytest
from PIL import Image

from geometries import HollowDisk, SeminarActuator
from softmodels.common.files import render
from softmodels.pictures import report
from softmodels.pictures.offscreen import look
from softmodels.runs.columns import term
from softmodels.runs.store import States
from tests.support import runs

SOFT = ("--variant", "shadow", "--material", "ecoflex-00-30", "--volume-ml", "0:120:60", "--quiet")
"""Stretches the silicone beyond what it was fitted over."""


def page(folder):
    """The report of a folder, written anew without pictures."""
    return report.Report(look(States(folder, "disk")), folder, "disk").write({}).read_text()


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
    warned = text.split('<section class="warn">')[1].split("</section>")[0]
    assert warned.count("<li>") == len(notes) and "extrapolation" in warned
    assert text.index("extrapolation") < text.index("3-D view")


def test_warnings_are_there_without_a_summary_too(stretched, tmp_path):
    """A run that was killed has none; the states alone tell."""
    text = (stretched / "summary.json").read_text()
    (stretched / "summary.json").unlink()
    try:
        assert "extrapolation" in page(stretched) and "was interrupted" in page(stretched)
    finally:
        (stretched / "summary.json").write_text(text)


def test_a_quiet_run_has_no_warnings(pressed):
    assert 'class="warn"' not in page(pressed)


def test_a_contact_runs_report_tells_plane_and_force(pressed):
    with (pressed / "path.csv").open() as file:
        force = float(list(csv.DictReader(file))[-1]["contact_force_N"])
    text = page(pressed)
    assert "The rigid plane z = 17mm is in frictionless contact with top" in text
    assert f"{force:.4g} N" in text
    assert "<!-- contact force in N -->" in text, "no curve of the force"
    assert "contact of walls are not modelled" not in text and "stops only top" in text


def test_the_plane_is_in_the_pictures_and_a_cut_plane_is_not(pressed):
    shown = look(States(pressed, "disk"))
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
            assert bool(meaning.unit) == bool(re.search(r"_(cm|mm|ml|Pa|kPa|mJ|N|deg|per_m|per_mm2)$", column)), column
        text = page(folder)
        assert all(f"<code>{column}</code>" in text for column in header)
    slab = SeminarActuator()
    for column in slab.device_figures(slab.probes):
        assert term(column, slab).text, column


ROW = ("kind", "name", "pressure", "height", "points", "remark")


def test_pages_of_fits_and_photographs_fit_a_phone_and_paper():
    photographs = render("overview.html", title="", summary="", rows=[], pictures=[], photos=[("<b>", "data:,")])
    assert 'alt="&lt;b&gt;"' in photographs
    fit = (resources.files("softmodels.pictures") / "templates" / "fit.html").read_text()
    assert '{% extends "base.html" %}' in fit and "{{ table(" in fit and "<table" not in fit
    table = render("overview.html", title="", summary="", rows=[dict.fromkeys(ROW, "")], pictures=[], photos=[])
    for text in (photographs, table):
        assert 'name="viewport" content="width=device-width' in text and "@media print" in text
        assert re.search(r"img\{max-width:100%", text) and re.search(r"\.wide\{[^}]*overflow-x:auto", text)
        assert all(text[: found.start()].endswith('<div class="wide">') for found in re.finditer(r"<table", text))


def test_the_page_fits_a_phone_and_paper(pressed):
    text = page(pressed)
    assert 'name="viewport" content="width=device-width' in text
    style = resources.files("softmodels.pictures").joinpath("templates/report.css").read_text()
    assert style in text
    for rule in (
        r"img\{max-width:100%",
        r"svg\{max-width:100%",
        r"\.wide\{[^}]*overflow-x:auto",
        r"@media print",
        r"@media \(max-width",
    ):
        assert re.search(rule, style), rule
    # No table and no text of fixed width stands outside of what scrolls by itself.
    assert all(text[: found.start()].endswith('<div class="wide">') for found in re.finditer(r"<table", text))


def test_a_curled_edge_is_not_called_a_soft_contact():
    """A stiffer contact is advised where faces sink in as a whole, not where an edge does under next to no force."""
    import dataclasses

    from geometries import HollowDisk
    from softmodels.case.case import Case
    from softmodels.case.materials import DEFAULT
    from softmodels.components.contact import Obstacle
    from softmodels.runs.notes import depth_notes

    case = Case("disk", HollowDisk(), DEFAULT, (10.0,), components=[Obstacle("top", "z = 20 mm")])
    row = {"contact_depth_mm": 0.3}
    (edge,) = depth_notes(case, [{**row, "contact_force_N": 0.05}])
    (face,) = depth_notes(case, [{**row, "contact_force_N": 12.0}])
    assert "an edge" in edge and "use a --contact-stiffness above" not in edge
    assert "use a --contact-stiffness above 300" in face
    assert depth_notes(dataclasses.replace(case, components=()), [row]) == []
