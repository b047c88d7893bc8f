"""Pictures of made-up results: a mesh from the geometries and a displacement in closed form, no solver."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

from geometries import HollowDisk
from geometries.meshing import private_model
from softmodels import pictures, plots
from softmodels.case import Case
from softmodels.material_table import DEFAULT
from softmodels.results import Results, ResultsError

RISE, SPREAD = 4e-3, 0.05
"""Of the made-up displacement at full load: rise of the apex in m, and radial strain."""
STEPS = 6


def grid_of(disk: HollowDisk, folder: Path) -> tuple[np.ndarray, np.ndarray, str]:
    """Points in device coordinates and cells in VTK's order of nodes."""
    import gmsh

    gmsh_type, count, order, name = {
        2: (9, 6, [0, 1, 2, 3, 4, 5], "Triangle_6"),
        3: (11, 10, [0, 1, 2, 3, 4, 5, 6, 7, 9, 8], "Tetrahedron_10"),
    }[disk.dimension]
    file = disk.write(folder / "made-up.msh")
    with private_model():
        gmsh.merge(str(file))
        tags, coordinates, _ = gmsh.model.mesh.getNodes()
        _, nodes = gmsh.model.mesh.getElementsByType(gmsh_type)
    number_of = np.zeros(int(tags.max()) + 1, dtype=int)
    number_of[tags.astype(int)] = np.arange(len(tags))
    cells = number_of[nodes.astype(int)].reshape(-1, count)[:, order]
    return disk.device_points(coordinates.reshape(-1, 3)), cells, name


def displacement(disk: HollowDisk, points: np.ndarray, share: float) -> np.ndarray:
    """A dome that also spreads, at a share of the full load."""
    u = np.zeros_like(points)
    u[:, :2] = share * SPREAD * points[:, :2]
    radius = np.hypot(points[:, 0], points[:, 1]) / disk.outer_radius
    u[:, 2] = share * RISE * (1 - radius**2) * points[:, 2] / disk.height
    return u


def made_up(folder: Path, disk: HollowDisk) -> Path:
    """Results with a limit point before the last step; 50 cm and 100 cm were requested."""
    results = Results(folder, "disk")
    results.clear()
    points, cells, name = grid_of(disk, folder)
    results.begin(points, cells, name)
    (folder / "case.toml").write_text(Case("disk", disk, DEFAULT, (50.0, 100.0, 150.0)).to_toml())
    for k, pressure in enumerate((0.0, 25.0, 50.0, 100.0, 120.0, 110.0)):
        share = k / (STEPS - 1)
        stress = share * 1e4 * (1 + np.hypot(points[:, 0], points[:, 1]) / disk.outer_radius)
        row = {
            "step": k,
            "pressure_cm": pressure,
            "pressure_Pa": 95.0 * pressure,
            "added_volume_ml": share,
            "apex_mm": share * RISE * 1e3,
            "requested": int(pressure in (50.0, 100.0)),
            "limit": int(pressure == 120.0),
        }
        fields = {"displacement": displacement(disk, points, share), "von_mises_stress": stress}
        results.add(row, {**fields, "p": stress, "largest_stretch": 1 + stress, "J": 1 + stress}, {})
    results.finish()
    return folder


@pytest.fixture(scope="module")
def wedge(tmp_path_factory) -> Path:
    return made_up(tmp_path_factory.mktemp("wedge"), HollowDisk(cell_size=0.006, refinement=1.0))


@pytest.fixture(scope="module")
def half_section(tmp_path_factory) -> Path:
    return made_up(tmp_path_factory.mktemp("half"), HollowDisk(section="axisymmetric", cell_size=0.006, refinement=1.0))


def command(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """The program in a process of its own, as it is meant to run, and without a display."""
    environment = {key: value for key, value in os.environ.items() if key != "DISPLAY"}
    line = [sys.executable, "-m", "softmodels.pictures", *map(str, arguments)]
    return subprocess.run(line, capture_output=True, text=True, env=environment, timeout=120, check=False)


def loaded(folder: Path) -> tuple[Results, pictures.Body, HollowDisk]:
    results = Results(folder, "disk")
    results.load()
    return results, pictures._chosen(results)[1], Case.from_file(folder / "case.toml").actuator


@pytest.mark.parametrize("kind", ["wedge", "half_section"])
def test_all_five_pictures_are_drawn_and_show_something(kind, request):
    if not pictures.can_render():
        pytest.skip("this machine cannot render")
    folder = request.getfixturevalue(kind)
    done = command(folder)
    assert (done.returncode, done.stderr) == (0, "")
    names = {"mesh.png", "slice.png", "disk.png", "apex.png", "profile.png"}
    assert {Path(line).name for line in done.stdout.split()} == names
    for name in names:
        image = matplotlib.image.imread(folder / name)[:, :, :3]
        assert image.shape[1] == 1600 and 400 < image.shape[0] < 1800, name
        assert image.std() > 0.08, f"{name} is nearly blank"
        # A white rim: nothing is cut off.
        rim = np.concatenate([image[:3].reshape(-1, 3), image[-3:].reshape(-1, 3), image[:, :3].reshape(-1, 3)])
        assert (rim == 1.0).all(), name


def test_without_rendering_the_curves_are_drawn_and_one_sentence_said(wedge, monkeypatch):
    monkeypatch.setattr(pictures, "can_render", lambda: False)
    said: list[str] = []
    assert [path.name for path in pictures.draw(wedge, "disk", said.append)] == ["apex.png", "profile.png"]
    assert said == [pictures.NO_RENDERING]


def test_the_flat_sections_need_no_rendering(half_section, monkeypatch):
    monkeypatch.setattr(pictures, "can_render", lambda: False)
    names = [path.name for path in pictures.draw(half_section, "disk", lambda text: None)]
    assert names == ["apex.png", "profile.png", "mesh.png", "slice.png"]


def test_a_crash_of_the_renderer_is_no_crash_of_the_program(monkeypatch):
    monkeypatch.setattr(pictures, "PROBE", "import os, signal; os.kill(os.getpid(), signal.SIGKILL)")
    monkeypatch.delenv("VTK_DEFAULT_OPENGL_WINDOW", raising=False)
    assert pictures.can_render.__wrapped__() is False
    assert "VTK_DEFAULT_OPENGL_WINDOW" not in os.environ


def test_an_empty_folder_gives_exit_code_2_and_a_sentence(tmp_path):
    done = command(tmp_path)
    assert done.returncode == 2
    assert done.stdout == "" and done.stderr.count("\n") == 1 and "holds no results" in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_a_wrong_name_gives_exit_code_2_and_a_sentence(wedge, capsys):
    with pytest.raises(SystemExit) as stop:
        pictures.draw_folder(wedge, "bellows")
    assert stop.value.code == 2
    assert "holds no bellows.h5" in capsys.readouterr().err


def test_results_without_a_step_are_refused(tmp_path):
    results = Results(tmp_path, "disk")
    results.begin(np.zeros((6, 3)), np.arange(6)[None], "Triangle_6")
    with pytest.raises(ResultsError, match="no step yet"):
        pictures.draw(tmp_path, "disk")


@pytest.mark.parametrize("kind", ["wedge", "half_section"])
def test_the_profile_follows_the_displacement(kind, request):
    results, body, disk = loaded(request.getfixturevalue(kind))
    u = results.fields(STEPS - 1, ("displacement",))["displacement"]
    radius = plots.profile(body.points, np.zeros_like(u), disk)[:, 0]
    line = plots.profile(body.points, u, disk)
    assert radius[0] == 0.0 and radius[-1] == pytest.approx(disk.outer_radius) and (np.diff(radius) > 0).all()
    assert line[:, 0] == pytest.approx((1 + SPREAD) * radius)
    assert line[:, 1] == pytest.approx(disk.height + RISE * (1 - (radius / disk.outer_radius) ** 2))


def test_the_profile_of_a_turned_slice_is_the_same(tmp_path):
    disk = HollowDisk(cell_size=0.006, refinement=1.0, azimuth=100.0)
    points, _, _ = grid_of(disk, tmp_path)
    line = plots.profile(points, displacement(disk, points, 1.0), disk)
    assert line[-1] == pytest.approx(((1 + SPREAD) * disk.outer_radius, disk.height))


def rows(pressures: list[float], requested: set[float], limit: float | None = None) -> list[dict[str, float]]:
    return [
        {
            "pressure_cm": p,
            "pressure_Pa": 95.0 * p,
            "added_volume_ml": float(k),
            "apex_mm": 0.5 * k,
            "requested": int(p in requested),
            "limit": int(p == limit),
        }
        for k, p in enumerate(pressures)
    ]


def test_which_steps_the_profile_shows():
    pressures = [float(p) for p in range(0, 170, 10)]
    many = plots.profile_steps(rows(pressures, {0.0, 30.0, 60.0, 90.0}), "apex")
    assert many == [3, 6, 9, 16]  # the requested ones under load, and the last
    few = plots.profile_steps(rows(pressures, {0.0, 160.0}), "apex")
    assert few == [2, 4, 6, 8, 10, 12, 14, 16]
    assert plots.profile_steps(rows([0.0], {0.0}), "apex") == []


def test_limit_points_are_marked_with_their_value():
    path = rows([0.0, 20.0, 34.75, 30.0], {20.0}, limit=34.75)
    (axes,) = plots.rise(path, "apex", 95.0).axes
    (marked,) = [line for line in axes.lines if str(line.get_label()).startswith("limit point")]
    assert marked.get_label() == "limit point: 34.75 cm (3.301 kPa), 1 mm"
    assert (marked.get_xdata(), marked.get_ydata()) == ([34.75], [1.0])
    (asked,) = [line for line in axes.lines if line.get_label() == "requested"]
    assert asked.get_xydata().tolist() == [[20.0, 0.5]]
    assert not [line for line in plots.rise(path[:2], "apex", 95.0).axes[0].lines if "limit" in str(line.get_label())]


def test_the_smooth_curve_keeps_points_and_turning_points():
    path = np.array([[0.0, 0.0], [10.0, 5.0], [20.0, 8.0], [25.0, 15.0], [25.0, 15.0], [22.0, 20.0]])
    curve = plots.smooth(path, 4001)
    assert curve[:, 0].max() == pytest.approx(25.0, abs=1e-4) and (np.diff(curve[:, 1]) >= 0).all()
    assert all(np.linalg.norm(curve - point, axis=1).min() < 0.02 for point in path)
    assert plots.smooth(path[:2]) == pytest.approx(path[:2])


def test_the_state_shown_is_the_last_requested_one(wedge):
    row, body = pictures._chosen(loaded(wedge)[0])
    assert row["pressure_cm"] == 100.0
    assert body.displacement[:, 2].max() == pytest.approx(0.6 * RISE)


@pytest.mark.parametrize(("angle", "azimuth"), [(45.0, 0.0), (120.0, 30.0), (180.0, 0.0), (360.0, 20.0)])
def test_the_device_put_together_has_no_seams(tmp_path, angle, azimuth):
    disk = HollowDisk(cell_size=0.009, refinement=1.0, fillet=0.0, base_fillet=0.0, angle=angle, azimuth=azimuth)
    points, cells, name = grid_of(disk, tmp_path)
    slice_ = pictures.Body(points, cells, name, displacement(disk, points, 1.0), np.hypot(points[:, 0], points[:, 1]))
    body, gap = pictures._assembled(slice_, disk)
    a, b, c, d = (body.points[body.cells[:, k]] for k in range(4))
    volumes = np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6
    share = 2 / 3 if angle == 120.0 else 3 / 4
    assert volumes.min() > 0 and volumes.sum() == pytest.approx(share * disk.solid_volume, rel=0.08)
    assert body.stress == pytest.approx(np.hypot(body.points[:, 0], body.points[:, 1]), abs=1e-12)
    assert body.displacement == pytest.approx(displacement(disk, body.points, 1.0), abs=1e-12)
    # Outer faces in planes through the axis are cuts; where two neighbours meet there must be none.
    corners = body.points[plots.outer_faces(body.cells, name)[:, :3]]
    around = (np.degrees(np.arctan2(corners[..., 1], corners[..., 0])) - gap) % 360.0
    around[np.hypot(corners[..., 0], corners[..., 1]) < 1e-9] = np.nan
    in_plane = np.nanmax(around, axis=1) - np.nanmin(around, axis=1) < 1e-6
    half = (1 - share) * 180.0
    assert np.unique(np.nanmean(around[in_plane], axis=1).round(6)) == pytest.approx([half, 360.0 - half])


def test_fine_triangles_keep_area_and_bend():
    # A quarter disk's worth of one curved triangle: the edge 1-2 bulges outwards.
    corner = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.5, 0.0], [0.6, 0.6], [0.0, 0.5]])
    fine, triangles = plots.fine_triangles(corner, np.arange(6)[None], 16)
    a, b, c = (fine[triangles[:, k]] for k in range(3))
    areas = ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2
    assert areas.min() > 0
    # Straight triangle, and two thirds of the bulge's chord times its height.
    assert areas.sum() == pytest.approx(0.5 + 2 / 3 * np.sqrt(2) * 0.1 * np.sqrt(2), rel=2e-3)
    curves = plots.edge_curves(corner, np.arange(6)[None], 2)
    assert any(np.allclose(curve[1], (0.6, 0.6)) for curve in curves)
