"""What results show of themselves: a line, a card, the device in space, the film, tables of pandas and xarray."""

from __future__ import annotations

import html
import re
import sys

import numpy as np
import pytest
from PIL import Image

import softmodels as sm
from softmodels.api import run as runs, views
from softmodels.common.cards import ResultCard
from softmodels.common.errors import GeometryError
from softmodels.pictures.offscreen import can_render, look
from softmodels.pictures.solid import render_frames

SMALL = 40_000
"""Most characters of a card, its picture included."""
NUMBER = r"[-+]?\d[\d.]*(?:e[-+]?\d+)?"


@pytest.fixture(scope="module")
def run():
    disk = sm.HollowDisk(section="axisymmetric", cell_size="6 mm", refinement=1.0)
    return sm.inflate(disk, sm.Yeoh(14e3, 60.0), "0:177 cm", progress=None)


@pytest.fixture(scope="module")
def loaded(run, tmp_path_factory):
    return sm.load(run.save(tmp_path_factory.mktemp("cards") / "disk"))


@pytest.fixture
def no_solve(monkeypatch):
    """Nothing is solved from here on."""

    def solves(*_):
        raise AssertionError("a card must not solve")

    monkeypatch.setattr(runs, "solve_between", solves)
    monkeypatch.setattr(runs, "Simulation", solves)


def rows_of(card):
    return dict(re.findall(r"<tr[^>]*><td[^>]*>(.*?)</td><td[^>]*>(.*?)</td></tr>", html.unescape(card)))


def check(result, *words):
    """The line and the card of a result: small, with a picture, and each number with its unit; return the table."""
    line, card = repr(result), result._repr_html_()
    assert "\n" not in line and all(word in line for word in words), line
    assert len(card) < SMALL and 'src="data:image/webp;base64,' in card and "not all can be shown" not in card
    table = rows_of(card)
    assert table
    for name, value in table.items():
        if re.fullmatch(NUMBER, value):
            assert name in ("states", "largest stretch", "Poisson's ratio"), (name, value)
    return table


@pytest.mark.campaign
def test_a_run_and_its_states(run, loaded, no_solve):
    table = check(run, "14 states to 16.84 kPa (177 cm, 0.97 g/ml)", "apex rise 4.23")
    assert table["rise of the apex"] == f"{run.apex[-1] * 1e3:.4g} mm"
    assert table["silicone"] == "yeoh, c1 14 kPa, c2 0.06 kPa, c3 0 kPa, poisson 0.5"
    assert table["device"].startswith("HollowDisk: cell_size 6 mm")
    assert loaded._repr_html_() == run._repr_html_()
    assert check(run[5], "SolvedState of disk at")["pressure"].startswith(f"{run.pressure[5] / 1e3:.4g} kPa (")


def test_a_limit_shows_the_way_to_it(run):
    limit = sm.limit(run.case.actuator, run.case.material)
    table = check(limit, f"at {limit.pressure / 1e3:.4g} kPa: limit point")
    assert table["added volume"] == f"{limit.added_volume * 1e6:.4g} ml"
    volumes, pressures = np.array(limit.path).T
    assert np.all(np.diff(volumes) > 0) and pressures[0] == 0.0 and np.argmax(pressures) == len(pressures) - 1
    assert (volumes[-1], pressures[-1]) == pytest.approx((limit.added_volume, limit.pressure), rel=1e-9)
    on_the_way = np.interp(run.added_volume[3], volumes, pressures)
    assert run.pressure[3] == pytest.approx(on_the_way, rel=2e-2)  # of another path, whose states lie elsewhere


def test_a_fit_and_names_that_are_no_html():
    stretch = np.linspace(1.05, 2.5, 12)
    curve = sm.TensileCurve("<b>pull & hold</b>", "uniaxial", stretch, 14e3 * (stretch - stretch**-2))
    report = sm.fit_curves(curve, "neo-hookean,yeoh", sm.FitOptions(profiles=False))
    table = check(report, "FitReport of neo-hookean: shear_modulus 14", "kPa")
    assert "kPa (95 %: " in table["shear_modulus"] and table["shear modulus"] == "14 kPa"
    assert repr(report.chosen).startswith("<FittedLaw of neo-hookean")
    (score,) = sm.score({"fitted": sm.NeoHookean(15e3)}, curve)
    assert rows_of(score._repr_html_())["rms"].endswith(" kPa of 12 values") and "not all" not in score._repr_html_()

    class Named(ResultCard):
        def _line(self):
            return f"of {curve.name}"

        def _figures(self):
            return [(curve.name, "<script>alert(1)</script>")]

    assert not re.search(r"<b>|<script", Named()._repr_html_())


class Broken(ResultCard):
    def _line(self):
        return "of something broken"

    def _figures(self):
        raise GeometryError("use --cell-size 1mm instead")


def test_a_card_that_cannot_be_drawn_is_a_sentence(run, monkeypatch):
    assert "not all can be shown: use cell_size=1mm instead" in Broken()._repr_html_()

    def fails(result):
        raise ValueError("no picture today")

    monkeypatch.setattr(views, "picture", fails)
    card = run._repr_html_()
    assert "not all can be shown: ValueError: no picture today" in card and rows_of(card) and "<img" not in card


def test_a_folder_that_is_gone_is_a_sentence(run, tmp_path):
    folder = run.save(tmp_path / "disk")
    again, table = sm.load(folder), rows_of(run._repr_html_())
    (folder / "disk.h5").unlink()
    assert rows_of(again._repr_html_()) == table
    with pytest.raises(sm.ResultsError, match="can no longer be read"):
        again.show()


# -- in space, and as a film -------------------------------------------------------------------------------------------


def coloured_share(picture):
    """Share of the pixels of a picture that are coloured."""
    pixels = np.asarray(Image.open(picture).convert("RGB")).astype(int)
    return np.mean(np.ptp(pixels, axis=2) > 40)


@pytest.mark.campaign
@pytest.mark.skipif(not can_render(), reason="this machine cannot render")
def test_without_a_display_a_device_in_space_is_a_picture(run, wedge, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    stress, stretch, rest = run.show(), run.last.show("largest_stretch"), run.show(0)
    assert all(0.2 < coloured_share(file) < 0.8 for file in (stress, stretch, rest, sm.load(wedge).show(-1)))
    assert len({file.read_bytes() for file in (stress, stretch, rest)}) == 3
    assert run.show("177 cm").read_bytes() == stress.read_bytes()
    with pytest.raises(sm.CaseError, match="known are von_mises, largest_stretch"):
        run.show(field="strain")


@pytest.mark.skipif(not can_render(), reason="this machine cannot render")
def test_the_film_in_each_format(run, tmp_path, monkeypatch):
    monkeypatch.setattr(views.solid, "render_frames", lambda shown: render_frames(look(run._states), 3))
    film = run.animate(tmp_path / "disk.gif")
    assert repr(film).startswith("<Animation of 3 frames, 960 x ") and 'src="data:image/webp;' in film._repr_html_()
    for file in (tmp_path / "disk.gif", film.save(tmp_path / "disk.webp")):
        with Image.open(file) as saved:
            assert saved.n_frames == 3 and saved.size == film.frames[0].shape[1::-1]
    with pytest.raises(sm.CaseError, match=r"ends in \.avi; a film is a \.gif, \.webp or \.mp4"):
        film.save(tmp_path / "disk.avi")


# -- tables of other libraries -----------------------------------------------------------------------------------------


def test_a_data_frame_has_the_units_of_the_file(run, loaded):
    pandas = pytest.importorskip("pandas")
    frame = run.to_dataframe()
    pandas.testing.assert_frame_equal(frame, pandas.read_csv(loaded._source.folder / "path.csv"), check_dtype=False)
    units, names = frame.attrs["units"], frame.attrs["long_name"]
    assert list(units) == list(frame.columns) == list(names)
    assert (units["apex_mm"], names["apex_mm"], units["max_stretch"]) == ("mm", "rise of the apex", "")


def test_a_dataset_has_fields_on_request(run, loaded):
    pytest.importorskip("xarray")
    path = run.to_xarray()
    assert set(path.dims) == {"step"} and path.sizes["step"] == len(run)
    assert np.array_equal(path.pressure, run.pressure) and path.pressure.units == "Pa"
    assert path.apex_mm.attrs == {"units": "mm", "long_name": "rise of the apex"}
    nodal = loaded.to_xarray(["displacement", "von_mises"])
    assert nodal.displacement.dims == ("step", "node", "component") and nodal.displacement.units == "m"
    assert np.array_equal(nodal.displacement.sel(step=3), run[3].displacement)
    assert np.array_equal(nodal.von_mises.isel(step=-1), run.last.von_mises)
    assert np.array_equal(nodal.z, run.last.points[:, 2]) and nodal.z.units == "m"
    with pytest.raises(sm.CaseError, match="no field 'stress'; known are J, displacement"):
        run.to_xarray("stress")


@pytest.mark.parametrize(("package", "call"), [("pandas", "to_dataframe"), ("xarray", "to_xarray")])
def test_a_missing_package_is_named(run, package, call, monkeypatch):
    monkeypatch.setitem(sys.modules, package, None)
    words = rf"{package} is not installed; it comes with the extra 'notebook': uv sync --inexact --extra notebook in a clone"
    with pytest.raises(ImportError, match=words):
        getattr(run, call)()
