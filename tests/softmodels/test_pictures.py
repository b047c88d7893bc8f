"""Pictures of made-up results: a mesh from the geometries and a displacement in closed form, no solver."""

from __future__ import annotations

import dataclasses
import io
import os
import shutil
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from PIL import Image

from geometries import HollowDisk
from softmodels.common import units
from softmodels.common.schema import about
from softmodels.path.supply import Syringe
from softmodels.pictures import curves as curves_module, draw as pictures, offscreen, solid
from softmodels.pictures.offscreen import look
from softmodels.pictures.solid import cut_open
from softmodels.pictures.style import Caption, Scale, page as page_of, png
from softmodels.runs import grid
from softmodels.runs.grid import CUT_LABEL
from softmodels.runs.labels import StateLabels
from softmodels.runs.states import FolderStates, StoredStates, round_steps
from softmodels.runs.store import Results, ResultsError
from softmodels.runs.table import PathTable
from tests.support import made_up as drawings

RISE, SPREAD, STEPS = 4e-3, 0.05, 6
"""Of the made-up results; see the fixtures."""


def loaded(folder: Path) -> tuple[StoredStates, HollowDisk]:
    states = FolderStates(folder, "disk")
    return states, states.actuator


@pytest.mark.campaign
@pytest.mark.parametrize("kind", ["wedge", "half_slab"])
def test_every_picture_is_drawn_and_shows_something(kind, drawn):
    folder, done = drawn(kind)
    assert (done.returncode, done.stderr) == (0, "")
    gauge = "tip" if kind == "half_slab" else "apex"
    names = {f"{name}.png" for name in ("undeformed", "mesh", "slice", "cut", "hot-spots", "profile", gauge, "stress")}
    names |= {"stress-1.png", "stress-2.png"}  # two pressures were requested
    film = {"film.gif", "film.webp"} if kind == "wedge" else set()  # asked for
    assert {Path(line).name for line in done.stdout.split()} - {"film.mp4"} == {*names, *film, "report.html"}
    for name in names:
        image = matplotlib.image.imread(folder / name)[:, :, :3]
        assert image.shape[1] == offscreen.WIDTH_PX and 200 < image.shape[0] < 1600, name
        assert image.std() > 0.04, f"{name} is nearly blank"
        # A white rim: nothing is cut off.
        rim = np.concatenate([image[:3].reshape(-1, 3), image[-3:].reshape(-1, 3), image[:, :3].reshape(-1, 3)])
        assert (rim == 1.0).all(), name


@pytest.mark.campaign
@pytest.mark.parametrize("kind", ["wedge", "half_slab"])
def test_stress_has_one_camera_and_one_scale(kind, drawn):
    folder, _ = drawn(kind)
    pages = [Image.open(folder / f"{name}.png") for name in ("stress-1", "stress-2", "stress")]
    for key in ("Camera", "Scale"):
        assert len({page.text[key] for page in pages}) == 1, key
    assert pages[0].size == pages[1].size and pages[0].text["Title"] != pages[1].text["Title"]
    low, high = pages[0].text["Scale"].split(" to ")
    states = FolderStates(folder, "disk" if kind != "half_slab" else "slab")
    stresses = np.concatenate([states.field(step, "von_mises") for step in range(STEPS)])  # the film shows all
    assert float(low) == 0.0 and 0.3 * stresses.max() < float(high.split()[0]) * 1e3 <= 1.2 * stresses.max()


def test_without_rendering_the_curves_are_drawn_and_one_sentence_said(wedge, tmp_path, monkeypatch):
    monkeypatch.setattr(offscreen, "can_render", lambda: False)
    said: list[str] = []
    names = [path.name for path in pictures.draw(plain(wedge, tmp_path), "disk", said.append)]
    assert names == ["apex.png", "profile.png", "report.html"]
    assert said == [pictures.NO_RENDERING]


def test_the_flat_sections_need_no_rendering(half_section, tmp_path, monkeypatch):
    monkeypatch.setattr(offscreen, "can_render", lambda: False)
    said: list[str] = []
    names = [path.name for path in pictures.draw(plain(half_section, tmp_path), "disk", said.append)]
    assert names == ["apex.png", "profile.png", "mesh.png", "slice.png", "stress.png", "hot-spots.png", "report.html"]
    assert said == []


def test_a_crash_of_the_renderer_is_no_crash_of_the_program(monkeypatch):
    monkeypatch.setattr(offscreen, "PROBE", "import os, signal; os.kill(os.getpid(), signal.SIGKILL)")
    monkeypatch.delenv("VTK_DEFAULT_OPENGL_WINDOW", raising=False)
    assert offscreen.can_render.__wrapped__() is False
    assert "VTK_DEFAULT_OPENGL_WINDOW" not in os.environ


def test_an_empty_folder_gives_exit_code_2_and_a_sentence(tmp_path):
    done = drawings.command(tmp_path)
    assert done.returncode == 2
    assert done.stdout == "" and done.stderr.count("\n") == 1 and "holds no results" in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_a_wrong_name_gives_exit_code_2_and_a_sentence(wedge, capsys):
    with pytest.raises(SystemExit) as stop:
        pictures.draw_folder(wedge, "bellows")
    assert stop.value.code == 2
    assert "holds no bellows.h5" in capsys.readouterr().err


def test_results_without_a_step_are_refused(wedge, tmp_path):
    results = Results(tmp_path, "disk")
    shutil.copy(wedge / "case.toml", tmp_path)
    results.begin(np.zeros((6, 3)), np.arange(6)[None], "Triangle_6")
    with pytest.raises(ResultsError, match="no step yet"):
        pictures.draw(tmp_path, "disk")


@pytest.mark.parametrize("kind", ["wedge", "half_section"])
def test_the_profile_follows_the_displacement(kind, request):
    states, disk = loaded(request.getfixturevalue(kind))
    u = states.field(STEPS - 1, "displacement")
    radius = curves_module.profile(states.points, np.zeros_like(u), disk)[:, 0]
    line = curves_module.profile(states.points, u, disk)
    assert radius[0] == 0.0 and radius[-1] == pytest.approx(disk.outer_radius) and (np.diff(radius) > 0).all()
    assert line[:, 0] == pytest.approx((1 + SPREAD) * radius)
    assert line[:, 1] == pytest.approx(disk.height + RISE * (1 - (radius / disk.outer_radius) ** 2))


def test_the_profile_of_a_turned_slice_is_the_same(tmp_path):
    disk = HollowDisk(cell_size=0.006, refinement=1.0, azimuth=100.0)
    points, _, _ = drawings.grid_of(disk, tmp_path)
    line = curves_module.profile(points, drawings.displacement(disk, points, 1.0), disk)
    assert line[-1] == pytest.approx(((1 + SPREAD) * disk.outer_radius, disk.height))


def plain(folder: Path, into: Path) -> Path:
    """A copy of results without what was drawn."""
    for name in ("disk.h5", "disk.xdmf", "case.toml"):
        shutil.copy(folder / name, into / name)
    return into


def rows(pressures: list[float], requested: set[float], limit: float | None = None) -> PathTable:
    return PathTable.read(
        {
            "pressure_cm": p,
            "pressure_Pa": 95.0 * p,
            "added_volume_ml": float(k),
            "apex_mm": 0.5 * k,
            "requested": int(p in requested),
            "limit": int(p == limit),
        }
        for k, p in enumerate(pressures)
    )


def test_which_steps_the_profile_shows():
    pressures = [float(p) for p in range(0, 170, 10)]
    many = curves_module.profile_steps(rows(pressures, {0.0, 30.0, 60.0, 90.0}), StateLabels("apex"))
    assert many == [3, 6, 9, 16]  # the requested ones under load, and the last
    few = curves_module.profile_steps(rows(pressures, {0.0, 160.0}), StateLabels("apex"))
    assert few == [2, 4, 6, 8, 10, 12, 14, 16]
    assert curves_module.profile_steps(rows([0.0], {0.0}), StateLabels("apex")) == []


def test_limit_points_are_marked_with_their_value():
    path = rows([0.0, 20.0, 34.75, 30.0], {20.0}, limit=34.75)
    (axes,) = curves_module.rise(path, StateLabels("apex"), units.COLUMN).axes
    (marked,) = [line for line in axes.lines if str(line.get_label()).startswith("limit point")]
    assert marked.get_label() == "limit point: 34.75 cm (3.301 kPa), 1 mm"
    assert (marked.get_xdata(), marked.get_ydata()) == ([34.75], [1.0])
    (asked,) = [line for line in axes.lines if line.get_label() == "requested"]
    assert asked.get_xydata().tolist() == [[20.0, 0.5]]
    below = curves_module.rise(path[:2], StateLabels("apex"), units.COLUMN).axes[0].lines
    assert not [line for line in below if "limit" in str(line.get_label())]


def test_a_path_is_dashed_where_the_silicone_was_not_fitted():
    held = {"requested": 1, "jump": 0, "limit": 0}
    path = PathTable.read(
        {"pressure_cm": x, "pressure_Pa": 95.0 * x, "apex_mm": x, "max_stretch": 1 + x / 10, **held} for x in range(9)
    )
    (axes,) = curves_module.rise(path, StateLabels("apex", fitted=1.45), units.COLUMN).axes
    lines = {str(line.get_label()): line for line in axes.lines}
    dashed = lines["beyond the fitted stretch, 1.45"]
    inside, outside = (np.array(line.get_xydata()) for line in (lines["simulated path"], dashed))
    inside, outside = (points[np.isfinite(points[:, 1])] for points in (inside, outside))
    assert inside[:, 0].max() == pytest.approx(4.5, abs=0.05) and outside[:, 0].min() == pytest.approx(4.5, abs=0.05)
    assert dashed.get_linestyle() == "--"
    (axes,) = curves_module.rise(path, StateLabels("apex"), units.COLUMN).axes
    assert not [line for line in axes.lines if "fitted" in str(line.get_label())]


def test_curves_show_jumps_bifurcations_branches_and_what_a_syringe_skips():
    keys = ("pressure_cm", "apex_mm", "jump", "bifurcation", "stable_under_supply")
    table = ((0, 0, 0, 0, 1), (20, 5, 0, 1, 1), (20, 30, 1, 0, 1), (15, 28, 0, 0, 0), (18, 32, 0, 0, 1))
    path = [dict(zip(keys, row, strict=True), pressure_Pa=95 * row[0], requested=0, limit=0) for row in table]
    branch = [{**path[0], "pressure_cm": 19, "apex_mm": 7}, {**path[0], "pressure_cm": 18, "apex_mm": 9}]
    (axes,) = curves_module.rise(PathTable.read(path), StateLabels("apex"), units.COLUMN, PathTable.read(branch)).axes
    shown = {line.get_label(): np.array(line.get_xydata()) for line in axes.lines}
    assert shown["jump"] == pytest.approx(np.array([[20, 5], [20, 30]]))
    assert shown["steps skipped by snap-through"] == pytest.approx(np.array([[15, 28]]))
    assert next(xy for label, xy in shown.items() if label.startswith("bifurcation: 20 cm")) == pytest.approx(
        np.array([[20, 5]])
    )
    assert shown["branch"][[0, -1]] == pytest.approx(np.array([[20, 5], [18, 9]]))
    drawn = [xy for label, xy in shown.items() if label == "simulated path" or label.startswith("_child")]
    assert not any(((xy[:, 1] > 6) & (xy[:, 1] < 27)).any() for xy in drawn)  # no curve along the jump


def test_a_syringe_has_its_pressure_over_the_stroke():
    keys = ("stroke_ml", "pressure_cm", "apex_mm", "added_volume_ml", "requested", "stable_under_supply")
    path = [
        dict(zip(keys, row, strict=True), limit=0) for row in ((0, 0, 0, 0, 1, 1), (5, 7, 6, 4, 0, 1), (20, 47, 15, 18, 1, 1))
    ]
    figures = curves_module.curves(PathTable.read(path), StateLabels("apex", driver="bottle"))
    first, *others = (figure.axes[0] for figure in figures)
    assert (first.get_xlabel(), first.get_ylabel()) == ("stroke of the bottle in ml", "pressure in cm, 0.97 g/ml")
    (asked,) = [line for line in first.lines if line.get_label() == "requested"]
    assert asked.get_xydata().tolist() == [[0, 0], [20, 47]]
    assert [axes.get_xlabel() for axes in others] == ["pressure in cm, 0.97 g/ml"] * 2
    direct = [{key: value for key, value in row.items() if key != "stroke_ml"} for row in path]
    assert len(curves_module.curves(PathTable.read(direct), StateLabels("apex"))) == 2


def test_every_entry_of_a_syringe_is_explained():
    texts = [field.help for field in about(Syringe()).values()]
    assert len(texts) == len(dataclasses.fields(Syringe)) == len(set(texts)) and all(texts)


def test_the_smooth_curve_keeps_points_and_turning_points():
    path = np.array([[0.0, 0.0], [10.0, 5.0], [20.0, 8.0], [25.0, 15.0], [25.0, 15.0], [22.0, 20.0]])
    curve = curves_module.smooth(path, 4001)
    assert curve[:, 0].max() == pytest.approx(25.0, abs=1e-4) and (np.diff(curve[:, 1]) >= 0).all()
    assert all(np.linalg.norm(curve - point, axis=1).min() < 0.02 for point in path)
    assert curves_module.smooth(path[:2]) == pytest.approx(path[:2])


def test_the_state_shown_is_the_last_requested_one(wedge):
    states, _ = loaded(wedge)
    assert states.rows[states.main].shown("pressure") == 100.0
    assert states.field(states.main, "displacement")[:, 2].max() == pytest.approx(0.6 * RISE)
    assert [states.rows[k].shown("pressure") for k in states.shown()] == [50.0, 100.0]
    # The pressure turns at 120 cm: the path is measured along its arc there.
    assert (np.diff(states.along) > 0).all() and states.along[[0, -1]].tolist() == [0.0, 1.0]
    half = states.field(2.5, "displacement")
    assert half == pytest.approx((states.field(2, "displacement") + states.field(3, "displacement")) / 2)
    assert states.row(2.5).shown("pressure") == 75.0


def test_few_requested_values_are_filled_up_with_round_ones():
    """Between two steps where the path has none there, and none right before the last; not where the pressure turns."""
    path = PathTable.read({"pressure_cm": 177.0 * k / 13} for k in range(14))
    found = round_steps(path, "pressure", 4)
    assert found == pytest.approx([50 * 13 / 177, 100 * 13 / 177, 150 * 13 / 177, 13])
    assert round_steps(PathTable.read({"pressure_cm": 10.0 * k} for k in range(17)), "pressure", 4) == [5, 10, 16]
    assert round_steps(PathTable.read({"pressure_cm": p} for p in (0.0, 20.0, 10.0)), "pressure", 4) == []


def test_fine_triangles_keep_area_and_bend():
    # A quarter disk's worth of one curved triangle: the edge 1-2 bulges outwards.
    corner = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.5, 0.0], [0.6, 0.6], [0.0, 0.5]])
    fine, small = grid.fine_triangles(corner, np.arange(6)[None], 16)
    a, b, c = (fine[small[:, k]] for k in range(3))
    areas = ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2
    assert areas.min() > 0
    # Straight triangle, and two thirds of the bulge's chord times its height.
    assert areas.sum() == pytest.approx(0.5 + 2 / 3 * np.sqrt(2) * 0.1 * np.sqrt(2), rel=2e-3)
    curves = grid.edge_curves(corner, np.arange(6)[None], 2)
    assert any(np.allclose(curve[1], (0.6, 0.6)) for curve in curves)


@pytest.mark.parametrize("kind", ["wedge", "half_section"])
def test_a_bifurcation_is_drawn_with_its_mode(kind, request, monkeypatch):
    """The made-up results have no mode; their displacement stands in for one."""
    if kind == "wedge" and not offscreen.can_render():
        pytest.skip("nothing can render here")
    states, _ = loaded(request.getfixturevalue(kind))
    step, field = STEPS - 1, StoredStates.field
    monkeypatch.setattr(
        StoredStates,
        "field",
        lambda self, k, name: field(self, k, "displacement") / 5e-3 if name == "mode" else field(self, k, name),
    )
    figure = (solid.mode if kind == "wedge" else solid.section_mode)(look(states), step)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    assert np.asarray(canvas.buffer_rgba())[..., :3].std() > 10.0


@pytest.mark.parametrize(("kind", "name", "slices"), [("half_slab", "slab", 1), ("wedge", "disk", 2)])
def test_a_cut_in_a_symmetry_plane_has_no_cracks(kind, name, slices, request):
    """The faces of cells lie in it; what is seen of the device is what bounds its slices there, and closed lines around it."""
    states = FolderStates(request.getfixturevalue(kind), name)
    skin = states.skin
    plane = (skin.planes[0], np.zeros(3))
    layers = cut_open(states, 0, plane, plane[0], Scale(states.field(0, "von_mises")))
    face, rim = (data for data, _ in layers[1:3])
    corners = skin.points(states.points)[skin.triangles[skin.part == CUT_LABEL]]
    corners = corners[np.abs(corners @ plane[0]).max(axis=1) < 1e-9]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2
    assert face.area == pytest.approx(slices * area, rel=1e-3)
    ends = rim.lines.reshape(-1, 3)[:, 1:].ravel()
    assert set(np.bincount(ends)) == {0, 2}


def test_a_rendered_image_stands_on_its_page_as_it_is():
    image = np.random.default_rng(5).integers(0, 256, (200, offscreen.WIDTH_PX, 3), dtype=np.uint8)
    drawn = png(page_of(image, Caption("a title", note="and a note")), {"Title": "a title"})
    with Image.open(io.BytesIO(drawn)) as page:
        found = np.asarray(page)
        assert page.mode == "RGB" and page.text["Title"] == "a title" and found.shape[1] == offscreen.WIDTH_PX
    assert (found[-200:] == image).all() and not (found[:-200] == 255).all()


@pytest.mark.skipif(not offscreen.can_render(), reason="this machine cannot render")
def test_a_picture_is_soft_at_its_edges(wedge):
    shown = look(FolderStates(wedge, "disk"))
    with offscreen.studio(shown.camera([0], width=320)) as shoot:
        found = shoot(shown.coloured(0, shown.scales["von_mises"])).astype(float)
    between = (found > 60).all(axis=2) & (found < 245).all(axis=2) & (np.ptp(found, axis=2) < 40)
    assert between.sum() > 50  # the mean of a dark line and of white, all around
