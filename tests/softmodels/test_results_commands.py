"""``softmodels open`` and ``softmodels compare``: the right file, the right numbers, a sentence where there are no results."""

from __future__ import annotations

import csv
import dataclasses
import json
import re
import shutil

import pytest

import softmodels as sm
from softmodels.__main__ import softmodels
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
    monkeypatch.setattr("softmodels.pictures.draw.can_render", lambda: False)  # pictures of the solid cost seconds
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
    assert cells.values[1] < cells.values[0] and cells.changes[0] == pytest.approx(
        cells.values[1] / cells.values[0] - 1
    )
    assert re.search(
        rf"cells +{cells.values[0]:.5g} +{cells.values[1]:.5g} \({100 * cells.changes[0]:+.3g} %\)", str(found)
    )
    line = "<Comparison of half0 and thinner0: 2 fields of the cases differ; rise at 120 cm: 3.2 mm; 3.2 mm (+0 %)>"
    card = found._repr_html_()
    assert repr(found) == line and "geometry.membrane: 6 mm; 5 mm" in card and 'src="data:image/webp;base64,' in card
    assert len(found.plot().axes[0].lines) >= 4 and len(found.outlines().axes[0].lines) == 4


def test_between_stored_states_figures_are_interpolated_and_said_to_be(half_section, thinner):
    """The second one ends at 50 cm; without the first one's state there, the value between its neighbours counts."""
    from softmodels.pictures.comparison import Compared, compared

    one, other = Compared.from_folder(half_section), Compared.from_folder(thinner)
    rows = [row for row in one.rows if row["pressure_cm"] != 50.0]
    short = [row for row in other.rows if row["pressure_cm"] <= 50.0]
    found = compared([dataclasses.replace(one, rows=rows), dataclasses.replace(other, rows=short)])
    rise = found.figures[0]
    assert rise.what == "rise at 50 cm, interpolated" and found.outlines() is None
    assert rise.values[0] == pytest.approx(4 / 3, rel=0.02) and rise.values[1] == pytest.approx(
        1.6
    )  # 0.8 at 25, 2.4 at 100
    assert "interpolated" in found.html()


def test_a_vacuum_is_compared_by_its_size(half_section, thinner):
    from softmodels.pictures.comparison import Compared, compared
    from softmodels.runs.fields import Row

    def emptied(folder):
        one = Compared.from_folder(folder)
        return dataclasses.replace(
            one, rows=[Row({**row.cells, "pressure_cm": -row["pressure_cm"]}) for row in one.rows]
        )

    found = compared([emptied(half_section), emptied(thinner)])
    assert found.common == -120.0 and found.figures[0].what == "rise at -120 cm"
    assert found.figures[0].values == sm.compare(half_section, thinner).figures[0].values
    assert compared([emptied(half_section), Compared.from_folder(thinner)]).common is None


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
