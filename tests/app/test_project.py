"""What lies in a project's folder stays what command line and Python read; the simulated outline is the device's own."""

from __future__ import annotations

import asyncio
import dataclasses
import re

import numpy as np
import pytest

pytest.importorskip("nicegui")

import softmodels as sm
from measurement.series.photo_list import ColumnError, read_photos
from softmodels.app import answers
from softmodels.app.bench import PHOTOGRAPH, Photographs, Project
from softmodels.app.forms import page_words
from softmodels.app.photographs import pasted_pressures
from softmodels.case.case import Case
from softmodels.case.load import steps_of
from softmodels.common.errors import FieldError
from tests.app.conftest import TOP

LISTS = {
    "times and errors": "file,pressure,error,hold,rise\n"
    "{0},0 cm,,0 s,0 s\n{1},20 cm,2 mm,10 s,1 s\n{2},1.9 kPa,1 Pa,100 s,1 s\n",
    "two tubes": "file;left;right\n{0};100.00 cm;100.01 cm\n{1};110.02 cm;89.95 cm\n{2};119.83 cm;80.19 cm\n",
}


@pytest.mark.parametrize("text", LISTS.values(), ids=LISTS)
def test_a_list_keeps_what_the_page_does_not_show(text, tmp_path):
    names = ["b.jpg", "a.jpg", "c.jpg"]  # in the order taken
    project = Project(tmp_path / "project")
    for name in names:
        (project / "photographs" / name).write_bytes(b"")
    listing = project / "photos.csv"
    listing.write_text(text.format(*(f"photographs/{name}" for name in names)))
    before = read_photos(listing)
    photographs = Photographs(project, None)
    assert [one.file.name for one in photographs.shadows] == names and not photographs.error
    photographs.write_list()
    after = read_photos(listing)
    assert [one.file for one in after] == [one.file for one in before]
    for one, other in zip(after, before, strict=True):
        assert (one.pressure, one.pressure_error) == pytest.approx((other.pressure, other.pressure_error), rel=1e-6)
        assert np.array(one.history) == pytest.approx(np.array(other.history))


def test_the_liquid_of_the_column_is_the_cases(tmp_path):
    """Heights beside photographs, and those of another list, are of the liquid that stands beside the device's pressures."""
    project = Project(tmp_path / "project")
    (project / "photographs" / "a.jpg").write_bytes(b"")
    (project / "photos.csv").write_text("file,left,right\nphotographs/a.jpg,110 cm,90 cm\n")
    water = 9.80665 * 998.0 * 0.2
    project.change(water_density="998 kg/m^3")
    photographs = Photographs(project, None)
    (one,) = photographs.shadows
    assert photographs.pressure_of(one) == pytest.approx(water, rel=1e-6)
    assert one.pressure == "20 cm" and 'water_density = "998 kg/m^3"' in (project / "case.toml").read_text()


def test_a_list_that_cannot_be_read_is_reported_and_stays(tmp_path):
    project = Project(tmp_path / "project")
    (project / "photos.csv").write_text("file,presure\na.jpg,1 cm\n")
    assert "column 'presure' is unknown" in Photographs(project, None).error
    assert (project / "photos.csv").read_text().startswith("file,presure")


@pytest.mark.parametrize(
    ("text", "pressures"),
    [
        ("0 cm\n10\n20.5\n", ["0 cm", "10 cm", "20.5 cm"]),
        ("file\tpressure\r\na.jpg\t0\r\nb.jpg\t1.2kPa\r\n\r\nc.jpg\t2e0\r\n", ["0", "1.2 kPa", "2e0 kPa"]),
    ],
)  # fmt: skip
def test_lines_of_a_spreadsheet_are_pressures(text, pressures, tmp_path):
    assert pasted_pressures(text) == pressures
    names = ("a.jpg", "b.jpg", "c.jpg")
    project = Project(tmp_path / "project")
    for name in names:
        (project / "photographs" / name).write_bytes(b"")
    photographs = Photographs(project, None)
    asyncio.run(photographs.change(dict(zip(names, ({"pressure": value} for value in pressures), strict=True))))
    before = (project / "photos.csv").read_text()
    assert [photo.row["pressure"] for photo in read_photos(project / "photos.csv")] == pressures
    with pytest.raises(ColumnError):
        asyncio.run(photographs.change({"a.jpg": {"pressure": "5 cm"}, "b.jpg": {"pressure": "5 kg"}}))
    photographs.write_list()
    assert (project / "photos.csv").read_text() == before


NAMES = ("../../x.jpg", "..\\x.jpg", "/etc/x.jpg", '<b>&".jpg', "x" * 300 + ".jpg", "a\n.jpg")


@pytest.mark.parametrize("name", NAMES)
def test_a_users_file_lands_in_the_project_whatever_its_name(name, tmp_path):
    project = Project(tmp_path / "project")
    kept = {project.keep("photographs", name, b"1", PHOTOGRAPH) for _ in range(2)}
    assert len(kept) == 2 and {file.parent for file in kept} == {project / "photographs"}


@pytest.mark.parametrize("name", ["a.exe", ".jpg", "jpg", ""])
def test_another_kind_of_file_is_refused(name, tmp_path):
    with pytest.raises(FieldError, match="photographs are JPEG, PNG, TIFF or HEIC"):
        Project(tmp_path / "project").keep("photographs", name, b"1", PHOTOGRAPH)


@pytest.mark.campaign
def test_the_linear_answer_of_a_stored_run_has_its_exact_derivatives(tmp_path):
    disk, material, length, step = sm.HollowDisk(section="axisymmetric"), sm.Yeoh(14e3, 60.0), "membrane", 0.2e-3
    stored = sm.run(Case("disk", disk, material, steps=steps_of(pressure_cm=(0.0, 60.0))), folder=tmp_path / "run")
    pressure = float(stored.pressure[-1])
    found = answers.linear(str(tmp_path / "run"), pressure)
    assert Case.from_toml(found.case) == stored.case
    for name, value in found.values.items():
        assert value == pytest.approx(stored.last.row[name], rel=1e-9)
    near = [sm.inflate(disk, material, [pressure + change]).last.row for change in (-20.0, 20.0)]
    other = [
        sm.inflate(dataclasses.replace(disk, membrane=disk.membrane + change), material, [pressure]).last.row
        for change in (-step, step)
    ]
    for name, slope in found.by_pressure.items():
        assert slope == pytest.approx((near[1][name] - near[0][name]) / 40.0, rel=1e-3)
        assert found.by_length[length][name] == pytest.approx((other[1][name] - other[0][name]) / (2 * step), rel=0.02)
        assert found.at(pressure + 10.0, {length: 1e-4})[name] == pytest.approx(
            found.values[name] + 10.0 * slope + 1e-4 * found.by_length[length][name]
        )
    between = answers.outline("", 0.7 * pressure, str(tmp_path / "run"))
    assert between == pytest.approx(answers.outline(stored.case.to_toml(), 0.7 * pressure), abs=1e-9)


@pytest.mark.parametrize("pressure", [0.0, 3e3])
def test_the_simulated_outline_begins_at_the_apex(pressure):
    disk = sm.HollowDisk(section="axisymmetric")
    case = Case("disk", disk, sm.Yeoh(14e3, 60.0), steps=steps_of(pressure_cm=(1.0,)))
    curve = answers.outline(case.to_toml(), pressure)
    apex = sm.inflate(disk, case.material, [pressure]).apex[-1] if pressure else 0.0
    assert curve[0] == pytest.approx([0.0, apex], abs=1e-9)
    assert np.ptp(curve[:, 0]) > 0.9 * disk.outer_radius


@pytest.mark.parametrize("module", ["series/checks", "outline/edge", "outline/profiles", "outline/zero", "series/measuring"])
def test_doubts_name_the_pages_controls(module):
    source = re.sub(r'"\s*\n\s*f?"', "", (TOP / "measurement" / f"{module}.py").read_text())  # sentences in one piece
    text = page_words(source)
    assert not re.findall(r"--(?:roi|mask|zero|tone|lens)\b", text)


def test_a_photographs_use_is_kept_in_its_list(tmp_path):
    project = Project(tmp_path / "project")
    (project / "photographs" / "a.jpg").write_bytes(b"")
    (project / "photos.csv").write_text("file,pressure,use\nphotographs/a.jpg,1 cm,Anyway\n")
    photographs = Photographs(project, None)
    assert photographs.listed["a.jpg"].anyway
    photographs.write_list()
    assert [photo.anyway for photo in read_photos(project / "photos.csv")] == [True]
