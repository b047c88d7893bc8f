"""The outline as what a design is to follow: its value, its derivatives, and what it refuses."""

from __future__ import annotations

import math

import numpy as np
import openpyxl
import pytest

from geometries import HollowDisk
from measurement.outline.outline import Outline as Measured
from softmodels.design.problem import DesignProblem
from softmodels.design.targets import Outline, TipPath, _middle
from softmodels.design.trials import DesignError, EvaluatedLoad
from tests.support.campaigns import sampled

TAYLOR = "Taylor's remainder of the distance from an outline, by every length"
AT = 2000.0
DOME = tuple((x, 6e-3 - 12.0 * x * x) for x in np.linspace(-0.02, 0.02, 41))
NAMES = ("membrane", "cavity_radius", "wall", "base", "profile[1]", "profile[2]", "profile[3]")


@pytest.mark.parametrize("name", sampled(NAMES, 2))
def test_of_a_section(designed, thin_disk, second_order, comm, name):
    second_order(designed(thin_disk, NAMES, (Outline(points=DOME, at=AT),), comm), name, TAYLOR, "section")


@pytest.mark.campaign
def test_of_a_wedge(designed, second_order, comm):
    wedge = HollowDisk.variant("shadow", fillet=0.0, base_fillet=0.0, angle=15.0, azimuth=20.0, cell_size=0.006)
    names = ("membrane", "cavity_radius")
    model = designed(wedge, names, (Outline(points=DOME, at=AT),), comm)
    for name in names:
        second_order(model, name, TAYLOR, "wedge")


@pytest.mark.parametrize("at", [AT, EvaluatedLoad("volume", 40e-6)], ids=["pressure", "volume"])
def test_each_distance_has_its_derivatives(designed, thin_disk, comm, at):
    """Of the distances one by one, by the rates of the state, against the adjoint of their root mean square."""
    asked = Outline(points=DOME, at=at)
    model = designed(thin_disk, NAMES, (asked,), comm)
    found = model.evaluate(model.start)
    squares, value = found.squares[asked.key], found.values[asked.key]
    assert squares.residuals @ squares.residuals == pytest.approx(len(DOME) * value**2, rel=1e-12)
    gradient = squares.jacobian.T @ squares.residuals / (len(DOME) * value)
    assert gradient == pytest.approx(found.gradients[asked.key], rel=1e-6, abs=1e-7 * np.abs(gradient).max())


def test_of_its_own_outline_it_is_none(designed, thin_disk, comm):
    """Points taken off the curve lie on it; raised by a tenth of a millimetre the flat part is that far away."""
    model = designed(thin_disk, NAMES, (Outline(points=DOME, at=AT),), comm)
    model.evaluate(model.start)
    (measure,), (state,) = model.meshed.measures.values(), model.meshed.states.states.values()
    measure.silhouette.follow()
    curve = measure.silhouette.curve(state)
    piece = np.arange(len(curve.nodes) // 2)
    on_it = curve.at(piece, np.full(len(piece), 0.3))[0]
    for shift, distance in ((0.0, 0.0), (1e-4, 1e-4)):
        measure.points = on_it + np.array([0.0, shift])
        assert measure.slopes(state).value == pytest.approx(distance, rel=0.1, abs=1e-9)
    measure.points = np.abs(np.array(DOME))


def test_files_are_read_as_the_measurement_writes_them(tmp_path):
    x = np.linspace(-0.03, 0.03, 1201)
    z = np.maximum(6e-3 - 12.0 * x * x, 0.0)
    noise = np.random.default_rng(3).normal(0.0, 20e-6, len(x))
    file = tmp_path / "dome.csv"
    Measured(x + 0.1, z + noise, np.full(len(x), 2e-5), AT, 5.0, "dome.jpg").to_csv(file)
    asked = Outline(file=str(file), at=AT, sigma="20 um")
    points = np.array(asked.points)
    assert asked.key == "distance from the outline dome at 2 kPa"
    assert 0.5 < points[:, 1].max() / 6e-3 < 1.1 and points[:, 1].min() > -1e-4
    assert _middle(points) == pytest.approx(0.1, abs=1e-4)
    assert _middle(points[points[:, 0] >= 0.1] - np.array([0.1, 0.0])) == 0.0
    assert asked.sigma == pytest.approx(20e-6) and 1.0 <= asked.run < 2.0


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({}, "either a file of points or the points"),
        ({"points": ((0.0, 1e-3),)}, "at least 3 points"),
        ({"points": ((0.0,), (1.0, 2.0), (1.0, 2.0))}, "are pairs"),
        ({"points": DOME, "sigma": -1.0}, "above zero"),
        ({"file": "nowhere.csv"}, "nowhere.csv cannot be read"),
    ],
)
def test_refused(values, words):
    with pytest.raises(ValueError, match=words):
        Outline(at=AT, **values)


def test_a_curved_top_is_refused_where_heights_were_measured(designed, thin_disk, tmp_path, comm):
    x = np.linspace(-0.03, 0.03, 121)
    file = tmp_path / "dome.csv"
    Measured(x, np.maximum(6e-3 - 12 * x * x, 0), np.full(121, 2e-5), AT, 5.0, "dome.jpg").to_csv(file)
    curved = HollowDisk.variant("shadow", section="axisymmetric", cell_size=0.004, profile=(1.2, 0.8))
    with pytest.raises(ValueError, match="mm from flat"):
        designed(curved, ("membrane",), (Outline(file=str(file), at=AT),), comm).evaluate(np.array([curved.membrane]))


# -- Tip paths from tables: a run's own, and what people type --------------------------------------------------------


RUN = """step,pressure_cm,pressure_Pa,added_volume_ml,tip_mm,tip_below_mm,tip_x_mm,tip_z_mm,max_stretch_x_mm,requested
0,0.0,0.0,0.0,0.0,0.0,70.0,0.0,1.0,1
1,10,951,0.01,0.1,0.1,70.01,0.11,1.0,1
2,15,1426,0.02,0.2,0.2,70.02,0.22,1.0,0
3,20,1902,0.03,0.3,0.3,70.03,0.33,1.0,1
4,30,2853,0.04,0.4,0.4,70.04,0.44,1.0,1
5,29,2758,0.05,0.5,0.5,70.05,0.55,1.0,1
"""


def table(tmp_path, text):
    file = tmp_path / "path.csv"
    file.write_text(text, encoding="utf-8")
    return str(file)


def test_a_runs_own_table(tmp_path):
    """At the pressures that it was asked at, up to the highest; the point is the only one with places."""
    asked = TipPath(file=table(tmp_path, RUN))
    assert asked.of == "tip"
    assert [row[0] for row in asked.target] == [951, 1902, 2853]
    np.testing.assert_allclose([row[1] for row in asked.target], [70.01e-3, 70.03e-3, 70.04e-3])
    np.testing.assert_allclose([row[3] for row in asked.target], [0.11e-3, 0.33e-3, 0.44e-3])
    assert all(math.isnan(row[2]) for row in asked.target)
    assert len(asked.parts) == 6


def test_as_people_type_it(tmp_path):
    """Units in brackets, semicolons; cm of the case's column."""
    asked = TipPath(file=table(tmp_path, "pressure [kPa];z [mm]\n1.5;2.25\n3;4\n"), of="tip")
    assert asked.target[0][0] == pytest.approx(1500.0) and asked.target[0][3] == pytest.approx(2.25e-3)
    asked = TipPath(file=table(tmp_path, "pressure_cm,tip_z_mm\n10,2\n"), cm=98.0)
    assert asked.target[0][0] == pytest.approx(980.0)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "has no rows"),
        ("p,x_mm\n1,2\n", "no column of pressures with its unit"),
        ("pressure_cm,x_mm\n1,2\n", "unknown liquid"),
        ("pressure_kPa,apex_mm\n1,2\n", "no columns of positions"),
        ("pressure_kPa,a_x_mm,b_x_mm\n1,2,3\n", "positions of a, b; choose one"),
        ("pressure_kPa,x_mm\n1,two\n", "line 2"),
        ("pressure_kPa,x_mm\n1,2\n2\n", "line 3"),
        ("pressure_kPa,x_mm\n0,2\n", "no row at a pressure above zero"),
        ("pressure_furlong,x_mm\n1,2\n", "furlong"),
    ],
)
def test_tables_of_a_tip_path_that_are_refused(tmp_path, text, words):
    with pytest.raises(ValueError, match=words):
        TipPath(file=table(tmp_path, text))


def problem(tmp_path, follow, pressures="[40]"):
    return DesignProblem.from_toml(
        f"[case.geometry]\ndevice = 'SeminarActuator'\n[case.material]\nsilicone = 'ecoflex-00-30'\n"
        f"[case.load]\npressure_cm = {pressures}\n"
        f"[parameters]\nthickness = {{ from = '7 mm', to = '9 mm' }}\n[follow]\n{follow}\n",
        tmp_path,
    )


def test_in_a_problem_file(tmp_path):
    table(tmp_path, RUN)
    found = problem(tmp_path, "quantity = 'tip_path'\nfile = 'path.csv'\nsigma = '50 um'")
    (term,) = found.terms
    assert term.quantity.sigma == pytest.approx(50e-6) and len(term.quantity.target) == 3
    assert found.working == 2853
    with pytest.raises(DesignError, match="above the case's last pressure"):
        problem(tmp_path, "quantity = 'tip_path'\nfile = 'path.csv'", "[20]")
    with pytest.raises(DesignError, match=r"nowhere.csv cannot be read"):
        problem(tmp_path, "quantity = 'tip_path'\nfile = 'nowhere.csv'")
    with pytest.raises(DesignError, match="file or a target"):
        problem(tmp_path, "quantity = 'tip_path'")
    with pytest.raises(DesignError, match="file of points or the points"):
        problem(tmp_path, "quantity = 'outline'\nat = '20 cm'")


def test_a_workbook_with_units_below_the_names(tmp_path):
    """The same path as the text of one with units in the names; sheets without a path are passed over."""
    book = openpyxl.Workbook()
    book.active.append(["by", "me"])
    page = book.create_sheet("Path")
    for row in (["pressure", "z"], ["kPa", "[mm]"], [1.5, 2.25], [3, 4]):
        page.append(row)
    book.save(tmp_path / "path.xlsx")
    typed = TipPath(file=table(tmp_path, "pressure [kPa];z [mm]\n1.5;2.25\n3;4\n"), of="tip")
    np.testing.assert_array_equal(TipPath(file=str(tmp_path / "path.xlsx"), of="tip").target, typed.target)
    for cell, words in (("two", "'two' is not a number"), ("=B3*2", r"'=B3\*2' is a formula, not a number")):
        page["B4"] = cell
        book.save(tmp_path / "path.xlsx")
        with pytest.raises(ValueError, match=rf"path.xlsx, row 4 of the sheet 'Path': {words}"):
            TipPath(file=str(tmp_path / "path.xlsx"), of="tip")
