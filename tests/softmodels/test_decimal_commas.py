"""A comma, or a space between digits, in any text that becomes a number: refused by name, wherever it is written."""

from __future__ import annotations

import re

import openpyxl
import pytest
from click.testing import CliRunner

import softmodels as sm
from geometries import HollowDisk
from geometries.faces import faces, point
from measurement.__main__ import main as measure
from measurement.cli import per_metre
from measurement.screen.setup import SetupError
from softmodels.__main__ import softmodels
from softmodels.case.case import Case, case_of
from softmodels.case.entries import CaseError
from softmodels.common.errors import GeometryError
from softmodels.disk import command as disk
from softmodels.fitting.outlines.residuals import read_heights
from softmodels.fitting.outlines.shapes import OutlineFitError
from softmodels.runs.analyses import Tolerance
from softmodels.seminar import command as seminar

LOAD = "--pressure-cm=0:10"
OPTIONS = [
    (disk, [LOAD, "--membrane=1,5mm"], "write 1.5mm"),
    (disk, [LOAD, "--shear-modulus=20,5kPa"], "write 20.5kPa"),
    (disk, [LOAD, "--water-density=998,2 kg/m^3"], "write 998.2 kg/m^3"),
    (disk, [LOAD, "--poisson=0,49"], "write 0.49"),
    (disk, [LOAD, "--refinement=1,5"], "write 1.5"),
    (disk, [LOAD, "--sheet=top", "--sheet-stiffness=1,5kN/m"], "write 1.5kN/m"),
    (disk, [LOAD, "--sheet=top", "--sheet-stiffness=1500"], "has no unit"),
    (disk, [LOAD, "--contact=top", "--contact-plane=z = 9,5 mm"], "decimal comma"),
    (disk, [LOAD, "--contact=top", "--contact-plane=z = 9 mm", "--contact-stiffness=300,5"], "write 300.5"),
    (disk, ["--supply=syringe", "--stroke-ml=0:10", "--dead-volume=5,5ml"], "write 5.5ml"),
    (disk, ["--supply=syringe", "--stroke-ml=0:10", "--leak-per-ml=0,002"], "decimal comma"),
    (disk, ["--pressure-cm=0:10,5"], "decimal comma"),
    (disk, ["--pressure-cm=0:1 000"], "between its digits"),
    (disk, ["--pressure-cm=0:1_0"], "between its digits"),
    (disk, ["--pressure-cm=12,5"], "decimals with a point"),
    (seminar, [LOAD, "--thickness=8,5mm"], "write 8.5mm"),
    (softmodels, ["limit", "--vary", "membrane=2,0mm+-0,2mm"], "'2,0mm' has a decimal comma; write 2.0mm"),
    (softmodels, ["limit", "--vary", "membrane=2mm+-0,2mm"], "write 0.2mm"),
    (softmodels, ["limit", "--vary", "membrane=2mm+-7,5%"], "write 7.5"),
    (softmodels, ["limit", "--working-pressure=20,5"], "write 20.5"),
    (softmodels, ["fit", "--tensile=pull.csv", "--stretch=1,02:3"], "write 1.02"),
    (softmodels, ["fit", "--tensile=pull.csv", "--poisson=0,49"], "write 0.49"),
    (softmodels, ["fit", "--tensile=pull.csv", "--stress-error=2%+0,5kPa"], "write 0.5kPa"),
    (softmodels, ["fit", "--tensile=pull.csv", "--material=yeoh", "--fix=c1=8,5kPa"], "write 8.5kPa"),
    (softmodels, ["fit", "--tensile=pull.csv", "--material=yeoh", "--bounds=c1=1,5kPa:"], "write 1.5kPa"),
    (softmodels, ["fit", "--tensile=pull.csv", "--material=yeoh", "--prior=c1=8kPa+-0,5kPa"], "write 0.5kPa"),
    (measure, ["setup", "grid.png", "--lens=none", "--grid-pitch=9,0mm"], "write 9.0mm"),
    (measure, ["setup", "grid.png", "--lens=none", "--scale=75,5px/mm"], "decimal comma"),
    (measure, ["setup", "grid.png", "--lens=none", "--point=1,2=9,5mm,18mm"], "decimals with a point"),
    (measure, ["setup", "grid.png", "--lens=none", "--point=1,2=9 5mm,18mm"], "between its digits"),
    (measure, ["setup", "grid.png", "--lens=none", "--scale=75px/mm", "--roi=0,0,1,5,2"], "decimals with a point"),
    (measure, ["setup", "grid.png", "--lens=none", "--scale=75px/mm", "--lamp-distance=2,5m", "--screen-distance=3cm"],
     "write 2.5m"),
    (measure, ["calibrate", "grid.png", "--pitch=25,4mm"], "write 25.4mm"),
    (measure, ["photos", "photos.csv", "--reading-error=0,5mm"], "write 0.5mm"),
]  # fmt: skip


@pytest.mark.parametrize(("asked", "arguments", "words"), OPTIONS, ids=[" ".join(words[1]) for words in OPTIONS])
def test_options(asked, arguments, words, tmp_path, monkeypatch, capsys):
    import cv2
    import numpy as np

    from softmodels.cli.ending import main

    monkeypatch.chdir(tmp_path)
    cv2.imwrite("grid.png", np.full((40, 60, 3), 200, np.uint8))
    rows = "\n".join(f"{1 + k / 20},{k * 600}" for k in range(1, 30))
    (tmp_path / "pull.csv").write_text(f"stretch,stress (Pa)\n1,0\n{rows}\n")
    monkeypatch.setattr("sys.argv", ["softmodels", *arguments])
    if asked is measure:
        result = CliRunner().invoke(asked, arguments)
        status, told = result.exit_code, result.output
    else:
        with pytest.raises(SystemExit) as end:
            main(asked)
        status, told = end.value.code, capsys.readouterr().err
    assert status == 2 and words in told, told
    assert sorted(path.name for path in tmp_path.iterdir()) == ["grid.png", "pull.csv"]


CASE = '[geometry]\ndevice = "HollowDisk"\nmembrane = "{membrane}"\n[load]\n{load}\n{more}\n'
TABLES = [
    ({"membrane": "1,5 mm"}, "write 1.5 mm"),
    ({"load": 'pressure_cm = "0:20,5"'}, "write 20.5"),
    ({"load": 'pressure_cm = ["0", "20,5"]'}, "write 20.5"),
    ({"load": 'pressure_cm = 20\nwater_density = "998,2 kg/m^3"'}, "write 998.2 kg/m^3"),
    ({"load": 'cavity1.pressure_cm = ["0", "20,5"]'}, "write 20.5"),
    ({"more": '[material]\nlaw = "yeoh"\nc1 = "8,5 kPa"\nc2 = "90 Pa"'}, "write 8.5 kPa"),
    ({"more": '[material]\nlaw = "neo-hookean"\nshear_modulus = "20 kPa"\npoisson = "0,49"'}, "write 0.49"),
    ({"more": '[sheet]\nface = "top"\nstiffness = "1,5 kN/m"'}, "write 1.5 kN/m"),
    ({"more": '[sheet]\nface = "top"\nstiffness = 1500'}, "has no unit; write it like 50kN/m"),
    ({"more": '[contact]\nfaces = "top"\nplane = "z = 9,5 mm"'}, "write 9.5 mm"),
]


@pytest.mark.parametrize(("change", "words"), TABLES)
def test_case_files(change, words):
    whole = {"membrane": "6 mm", "load": "pressure_cm = 20", "more": "", **change}
    with pytest.raises(CaseError, match=re.escape(words)):
        Case.from_toml(CASE.format(**whole))


@pytest.mark.parametrize("text", ["2,8", "0,5", "1,25", "20,45", " 2,8 "])
def test_two_short_numbers_are_told_of(text):
    first, second = text.strip().split(",")
    for case, unit in (
        (Case.from_toml(CASE.format(membrane="6 mm", load=f'pressure_cm = "{text}"', more="")), ""),
        (Case.from_toml(CASE.format(membrane="6 mm", load=f'volume_ml = "{text}"', more="")), ""),
        (case_of(HollowDisk(), sm.NeoHookean(30e3), f"{text} kPa"), " kPa"),
    ):
        (note,) = case.load.doubts
        assert f"read as two values, {first} and {second}{unit}; decimals have a point" in note
        assert f"write '{first}.{second}{unit}' for" in note and f"'{first}:{second}{unit}' for both" in note
    both = Case.from_toml(CASE.format(membrane="6 mm", load=f'pressure_cm = "{first}:{second}"', more=""))
    assert [value / both.column.pascal for value in both.values] == pytest.approx([float(first), float(second)], rel=1e-12)


@pytest.mark.parametrize("load", ['"2, 8"', '"2:8"', '"0,40"', '"20,40"', '"2,8,9"', '"2,800"', '"2.0,8.0"', "[2, 8]"])
def test_nothing_is_said_of_series_that_are_no_decimals(load):
    assert not Case.from_toml(CASE.format(membrane="6 mm", load=f"pressure_cm = {load}", more="")).load.doubts


def test_texts_that_pick_faces_and_points():
    assert point("cavities", "at 10, 0, 2.5 mm") == pytest.approx((0.01, 0.0, 0.0025))
    assert point("cavities", "at 10,0,2.5mm") == pytest.approx((0.01, 0.0, 0.0025))
    assert faces("support", "in -1..31, -5..5, 0..2 mm").box == ((-0.001, -0.005, 0.0), (0.031, 0.005, 0.002))
    assert faces("support", "x = 0 mm").at == 0.0
    for read, text, words in (
        (point, "at 10,5, 0, 2 mm", "decimals with a point"),
        (point, "at 1.0.5, 0, 2 mm", "'1.0.5 mm' is not a number"),
        (faces, "x = 1,5 mm", "write 1.5 mm"),
        (faces, "normal 1, -1, 0 at 2,5 mm", "write 2.5 mm"),
        (faces, "normal 0,6, 0, 0,8 at 9 mm", "decimals with a point"),
        (faces, "in -1,5..31, -5..5, 0..2 mm", "decimals with a point"),
    ):
        with pytest.raises(GeometryError, match=re.escape(words)):
            read("support", text)


def test_heights_of_a_german_sheet(tmp_path):
    path = tmp_path / "heights.csv"
    path.write_text("file;pressure_Pa;height_m\na;100.5;0.001\n", encoding="utf-8-sig")
    assert (read_heights(path)[0].pressure, read_heights(path)[0].height) == (100.5, 0.001)
    path.write_text("file;pressure_Pa;height_m\na;100;0.001\nb;200,5;0,002\n")
    with pytest.raises(OutlineFitError, match=r"line 3: .*'200,5' has a decimal comma"):
        read_heights(path)


def test_heights_of_a_workbook(tmp_path):
    """The row is named as the spreadsheet numbers it."""
    book = openpyxl.Workbook()
    for row in (["# by me"], ["file", "pressure_Pa", "height_m"], [], ["a", 100.5, 0.001], ["b", 200, "0,002"]):
        book.active.append(row)
    book.save(tmp_path / "heights.xlsx")
    with pytest.raises(OutlineFitError, match=r"row 5 of the sheet 'Sheet': .*'0,002' has a decimal comma"):
        read_heights(tmp_path / "heights.xlsx")
    book.active["C5"] = 0.002
    book.save(tmp_path / "heights.xlsx")
    found = read_heights(tmp_path / "heights.xlsx")
    assert [(one.source, one.pressure, one.height) for one in found] == [("a", 100.5, 0.001), ("b", 200.0, 0.002)]


def test_texts_without_end_are_refused():
    """The patterns of these texts would take minutes over them."""
    with pytest.raises(SetupError, match=r"\(\d+ characters\)|is not a scale"):
        per_metre(" " * 3000 + "x")
    with pytest.raises(CaseError, match="3002 characters"):
        Tolerance.parse("a=" + " " * 3000, HollowDisk)
    for read in (faces, point):
        with pytest.raises(GeometryError, match="has 3002 characters"):
            read("support", "at" + " " * 3000)
