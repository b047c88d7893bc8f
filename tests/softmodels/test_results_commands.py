"""``softmodels open`` and ``softmodels compare``: the right file, the right numbers, a sentence where there are no results."""

from __future__ import annotations

import csv
import dataclasses
import json
import re
import shutil

import h5py
import numpy as np
import pytest

import softmodels as sm
from softmodels.__main__ import softmodels
from softmodels.common.files import parse_json
from softmodels.pictures import draw_design
from softmodels.runs.store import FORMAT_NUMBER, ResultsError
from tests.support.made_up import made_up


@pytest.fixture(scope="module")
def thinner(tmp_path_factory):
    """The half section of `half_section`, with a thinner membrane and larger cells."""
    disk = sm.HollowDisk(section="axisymmetric", cell_size=0.007, refinement=1.0, membrane=0.005)
    return made_up(tmp_path_factory.mktemp("thinner"), disk)


@pytest.fixture
def opened(ended, monkeypatch):
    """Return a function that opens a folder by the command; addresses that the browser gets are in its list."""
    addresses = []
    monkeypatch.setattr("webbrowser.open", addresses.append)

    def run(*words):
        return *ended(softmodels, "open", *words), addresses

    return run


def test_the_report_is_opened_or_its_address_printed(opened, tmp_path):
    (tmp_path / "report.html").write_text("x")
    (tmp_path / "path.csv").write_text("x")
    address = (tmp_path / "report.html").as_uri()
    assert opened(tmp_path, "--no-browser") == (0, f"{address}\n", "", [])
    assert opened(tmp_path) == (0, f"{address}\n", "", [address])


@pytest.mark.parametrize("name", ["sheet.html", "overview.html", "limit.csv", "fitted.toml"])
def test_the_best_file_of_other_results(name, opened, tmp_path):
    (tmp_path / name).write_text("x")
    (tmp_path / "zzz.csv").write_text("x")
    status, out, err, _ = opened(tmp_path)
    assert status == 0 and out == f"{(tmp_path / name).as_uri()}\n" and ("no report" in err) == (".html" not in name)


def test_a_missing_report_is_made_of_what_is_stored(opened, half_section, tmp_path, monkeypatch):
    monkeypatch.setattr("softmodels.pictures.offscreen.can_render", lambda: False)  # pictures of the solid cost seconds
    folder = shutil.copytree(half_section, tmp_path / "disk", ignore=shutil.ignore_patterns("*.png", "report.html"))
    status, out, err, _ = opened(folder, "--no-browser")
    assert status == 0 and "making the report" in err and out == f"{(folder / 'report.html').as_uri()}\n"
    assert "Rise of the apex" in (folder / "report.html").read_text() and (folder / "apex.png").exists()


def test_a_folder_without_results_is_refused_and_those_in_it_are_named(opened, tmp_path):
    (tmp_path / "disk").mkdir()
    (tmp_path / "disk" / "path.csv").write_text("x")
    status, out, err, _ = opened(tmp_path)
    assert (status, out) == (2, "") and f"holds no results; open one of those in it: {tmp_path / 'disk'}" in err
    for nothing in (tmp_path / "missing", tmp_path / "disk" / "path.csv"):
        status, out, err, addresses = opened(nothing)
        assert (status, out, addresses) == (2, "", []) and "is not a folder" in err


def test_what_differs_and_by_how_much(half_section, thinner):
    found = sm.compare(half_section, str(thinner))
    assert {one.field: one.values for one in found.differences} == {
        "geometry.membrane": ("6 mm", "5 mm"), "geometry.cell_size": ("6 mm", "7 mm"),
    }  # fmt: skip
    rows = []
    for folder in (half_section, thinner):
        with (folder / "path.csv").open() as file:
            rows.append(list(csv.DictReader(file)))
    # Past the limit point at 120 cm the load falls, so that is the highest common one.
    assert found.common == 120.0
    figures = {one.what: one for one in found.figures}
    rises = figures["rise at 120 cm"]
    assert rises.values == tuple(float(many[4]["apex_mm"]) for many in rows) and rises.changes == (0.0,)
    assert figures["rise at 50 cm"].values[0] == float(rows[0][2]["apex_mm"])
    assert figures["limit point"].values == (120.0, 120.0) and figures["limit point"].unit == "cm"
    cells = figures["cells"]
    assert cells.values[1] < cells.values[0] and cells.changes[0] == pytest.approx(cells.values[1] / cells.values[0] - 1)
    assert re.search(rf"cells +{cells.values[0]:.5g} +{cells.values[1]:.5g} \({100 * cells.changes[0]:+.3g} %\)", str(found))
    line = "<Comparison of half0 and thinner0: 2 fields of the cases differ; rise at 120 cm: 3.2 mm; 3.2 mm (+0 %)>"
    card = found._repr_html_()
    assert repr(found) == line and "geometry.membrane: 6 mm; 5 mm" in card and 'src="data:image/webp;base64,' in card
    assert len(found.plot().axes[0].lines) >= 4 and len(found.outlines().axes[0].lines) == 4


def with_rows(one, rows):
    """Results with other states."""
    return dataclasses.replace(one, budget=dataclasses.replace(one.budget, rows=rows))


def test_between_stored_states_figures_are_interpolated_and_said_to_be(half_section, thinner):
    """The second one ends at 50 cm; without the first one's state there, the value between its neighbours counts."""
    from softmodels.pictures.comparison import ComparedResult, compared

    one, other = ComparedResult.from_folder(half_section), ComparedResult.from_folder(thinner)
    rows = one.rows.where(lambda row: row.shown("pressure") != 50.0)
    short = other.rows.where(lambda row: row.shown("pressure") <= 50.0)
    found = compared([with_rows(one, rows), with_rows(other, short)])
    rise = found.figures[0]
    assert rise.what == "rise at 50 cm, interpolated" and found.outlines() is None
    assert rise.values[0] == pytest.approx(4 / 3, rel=0.02) and rise.values[1] == pytest.approx(1.6)  # 0.8 at 25, 2.4 at 100
    assert "interpolated" in found.html()


def test_a_vacuum_is_compared_by_its_size(half_section, thinner):
    from softmodels.pictures.comparison import ComparedResult, compared
    from softmodels.runs.table import PathTable

    def emptied(folder):
        one = ComparedResult.from_folder(folder)
        cells = ({**row.cells, "pressure_cm": -row.shown("pressure")} for row in one.rows)
        return with_rows(one, PathTable.read(cells))

    found = compared([emptied(half_section), emptied(thinner)])
    assert found.common == -120.0 and found.figures[0].what == "rise at -120 cm"
    assert found.figures[0].values == sm.compare(half_section, thinner).figures[0].values
    assert compared([emptied(half_section), ComparedResult.from_folder(thinner)]).common is None


def test_the_command_prints_the_comparison_and_writes_a_report(ended, half_section, thinner, tmp_path):
    page = tmp_path / "compared.html"
    status, out, err = ended(softmodels, "compare", half_section, thinner, "-o", page)
    assert (status, err) == (0, "") and "geometry.membrane" in out and "limit point" in out and "120 cm" in out
    text = page.read_text()
    assert text.count("<svg") == 2 and "geometry.cell_size" in text and "rise at 120 cm" in text
    assert ended(softmodels, "compare", half_section, thinner, "-o", page, "--quiet") == (
        0,
        "",
        "",
    )  # its own is replaced
    page.write_text("mine")
    status, out, err = ended(softmodels, "compare", half_section, thinner, "-o", page)
    assert status == 2 and "is not a report of this program" in err and page.read_text() == "mine"


@pytest.fixture(scope="module")
def tensors(tmp_path_factory):
    """A short run that stores stresses."""
    disk = sm.HollowDisk(section="axisymmetric", cell_size=0.006, refinement=1.0)
    law, fields = sm.NeoHookean(28e3), ["cauchy_stress", "principal_stress_directions"]
    return sm.inflate(disk, law, pressures="0,40 cm", fields=fields, folder=tmp_path_factory.mktemp("tensors") / "disk")


def test_tensors_are_stored_as_asked_or_computed_from_what_is_stored(tensors):
    state = tensors.last
    stored = state.cauchy_stress
    assert stored.shape == (len(state.points), 3, 3) and "nominal_stress" not in state.fields
    again = dataclasses.replace(state, fields={name: state.fields[name] for name in ("displacement", "p")})
    assert np.allclose(again.cauchy_stress, stored, rtol=0, atol=1e-7 * np.abs(stored).max())
    F = again.deformation_gradient
    on_axis = np.abs(state.points[:, 0]) < 1e-9
    assert np.allclose(F[on_axis, 0, 0], F[on_axis, 1, 1], atol=0.02) and not F[:, :, 1][:, [0, 2]].any()  # x radial, y hoop
    nominal = np.linalg.det(F)[:, None, None] * stored @ np.swapaxes(np.linalg.inv(F), -1, -2)
    assert np.abs(state.nominal_stress - nominal).max() < 0.1 * np.abs(nominal).max()  # products of means, mean of products
    data = tensors.to_xarray("principal_stress_directions").principal_stress_directions
    assert data.dims == ("step", "node", "principal", "component")
    assert np.array_equal(data[-1], state.principal_stress_directions)
    with pytest.raises(sm.CaseError, match=r"no field 'nominal_stress'.*as by fields=\['nominal_stress'\]"):
        tensors.to_xarray("nominal_stress")
    with pytest.raises(sm.CaseError, match="fields has 'stress'; known are deformation_gradient"):
        sm.inflate(tensors.case.actuator, tensors.case.material, pressures="10 cm", fields=["stress"])


def test_values_along_a_line(ended, tensors, tmp_path):
    state = tensors.at("30 cm")
    line = state.along((0.0, 0.005, 0.003), "0, 5, 13 mm", points=41)  # beside the section, through the base and the membrane
    turned = state.along("5, 0, 3 mm", (0.005, 0.0, 0.013), points=41)
    assert line.inside.any() and not line.inside.all()  # air lies between
    swap = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    assert np.allclose(line["cauchy_stress"], swap @ turned["cauchy_stress"] @ swap.T, equal_nan=True)
    assert np.allclose(line.places, turned.places @ swap.T, equal_nan=True)
    wall = state.through("apex")
    assert wall.distance[-1] == pytest.approx(tensors.case.actuator.membrane, rel=1e-3)
    assert wall.normal_stress[-1] == pytest.approx(-state.pressure, rel=0.25)  # two cells through the membrane
    words = ("line", tensors._source.folder, "--at", "30cm")
    file = tmp_path / "wall.csv"
    status, out, err = ended(softmodels, *words, "--through", "apex", "-o", file)
    assert (status, err) == (0, "") and "silicone from 0 to 6 mm" in out and file.with_suffix(".png").stat().st_size > 20_000
    with file.open() as text:
        rows = list(csv.DictReader(text))
    assert len(rows) == 201 and float(rows[-1]["normal_stress_kPa"]) == pytest.approx(wall.normal_stress[-1] / 1e3, rel=1e-6)
    for given, sentence in {
        ("--from", "apex"): "give the line's ends",
        ("--from", "apex", "--to", "apex"): "begins and ends at (0, 0, 16) mm",
        ("--from", "apex", "--to", "0, 0, 20 mm", "--points", "9", "-o", tmp_path / "x.txt"): "written as .csv",
        ("--from", "0, 0, 18 mm", "--to", "0, 0, 20 mm"): "does not meet the silicone of HollowDisk",
        ("--through", "rim"): "no point 'rim'; known are apex, ceiling",
        ("--through", "1, 2"): "write a point as",
    }.items():
        status, _, err = ended(softmodels, *words, *given)
        assert status == 2 and sentence in err, err


def test_what_cannot_be_compared_is_refused_with_a_sentence(ended, half_section, tmp_path):
    for words, reason in (((half_section,), "nothing to compare"), ((half_section, tmp_path), "holds no results of a run"),
                          ((half_section, tmp_path / "missing"), "holds no results of a run")):  # fmt: skip
        status, out, err = ended(softmodels, "compare", *words)
        assert (status, out) == (2, "") and reason in err and "Traceback" not in err
    with pytest.raises(sm.ResultsError, match="holds no results of a run"):
        sm.compare(half_section, tmp_path)
    with pytest.raises(sm.ArgumentError):
        sm.compare(half_section, 3)


def test_a_folder_records_where_its_results_come_from(ended, tmp_path):
    """Of every command by one mechanism: here of scores."""
    pull = tmp_path / "pull.csv"
    pull.write_text("stretch,stress (kPa)\n" + "".join(f"{1 + k / 10},{3 * k}\n" for k in range(1, 9)))
    words = ("score", "--material", "ecoflex-00-30", "--tensile", f"{pull}", "-o", tmp_path / "out")
    status, _, err = ended(softmodels, *words)
    assert (status, err) == (0, "")
    made = json.loads((tmp_path / "out" / ".softmodels.json").read_text())["about"]["made"]
    assert made["command"].endswith(" ".join(map(str, words))) and made["version"] and made["seconds"] > 0.0
    text = (tmp_path / "out" / "report.html").read_text()
    assert "chi squared per value" in text and made["command"] in text and "doi 10.1016/j.ijmecsci.2021.106624" in text


def earlier(folder, version):
    """Make a folder's results those of another format, in which the stress has another name."""
    for file in folder.rglob("*.h5"):
        with h5py.File(file, "r+") as opened:
            if "mesh" in opened:
                opened.attrs["format"] = version
            for step in opened["steps"].values() if "steps" in opened else [opened]:
                if "von_mises" in step:
                    step.move("von_mises", "von_mises_stress")


@pytest.mark.parametrize("words", [("draw",), ("run", "case.toml", "--resume", "--no-pictures", "-o")], ids=" ".join)
@pytest.mark.parametrize(("version", "sentence"), [(3, "an earlier version"), (99, "a later version")])
def test_results_of_another_format_are_named_as_such(words, version, sentence, ended, half_section, tmp_path):
    """Before anything else: how a case is identified has changed since, too."""
    folder = tmp_path / "results"
    shutil.copytree(half_section, folder)
    earlier(folder, version)
    case = folder / "case.toml"
    words = [str(case) if word == "case.toml" else word for word in words]
    status, _, err = ended(softmodels, *words, folder)
    fix = "update softmodels" if version == 99 else "run its case.toml again into another folder (--output)"
    assert status == 2 and err.count("\n") == 1, err
    assert f"was written by {sentence} of softmodels (format {version}, not {FORMAT_NUMBER})" in err and fix in err


@pytest.mark.parametrize("text", ["[]", "3", '{"parameters": []}', "[" * 100_000])
def test_a_file_that_is_no_designs_is_named(text, tmp_path):
    (tmp_path / "design.json").write_text(text)
    with pytest.raises(ResultsError, match=r"holds no design \(design.json\)"):
        draw_design.draw(tmp_path)


DEEP = {"summary.json": "[" * 100_000, "fit.json": '{"laws":' * 100_000}


@pytest.mark.parametrize(("name", "text"), DEEP.items(), ids=DEEP)
def test_a_file_of_nested_brackets_is_no_more_than_a_missing_one(name, text, ended, half_section, tmp_path):
    folder = tmp_path / "results"
    shutil.copytree(half_section, folder)
    (folder / name).write_text(text)
    status, _, err = ended(softmodels, "draw", folder, "--pictures", "few")
    assert status == 0 and "Traceback" not in err, err
    assert sm.load(folder).apex == pytest.approx(sm.load(half_section).apex)
    with pytest.raises(ValueError, match="nests too many"):
        parse_json(text)
