"""``python -m softmodels.pictures results/disk``: the pictures of a folder of results.

A program of its own, because VTK and DOLFINx each bring an HDF5 and one process does not bear both. The curves come
first and need no rendering; a machine that cannot render still gets them.
"""

from __future__ import annotations

import dataclasses
import functools
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import matplotlib
import numpy as np
import numpy.typing as npt

from geometries import Actuator
from softmodels import plots
from softmodels.case import Case, CaseError
from softmodels.plots import DPI, EDGE, FAINT, INK, SOLID, STYLE, WIDTH, Stress
from softmodels.results import Results, ResultsError, replace

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = npt.NDArray[np.float64]
Cells = npt.NDArray[np.int64]

QUADRATIC_TETRA = 24
TURNED = (0, 2, 1, 3, 6, 5, 4, 7, 9, 8)
"""Nodes of a mirrored tetrahedron in the order that makes its volume positive again."""
SUBDIVISION = 2
SHARP = 40.0
"""Angle in degrees from which on a bend of the surface is drawn as an edge."""
NO_RENDERING = "this machine cannot render, so the pictures of the solid are left out; the curves are drawn"


@dataclasses.dataclass(frozen=True)
class Body:
    """What is drawn.

    Attributes:
        points: Undeformed nodes in m, shape (n, 3).
        cells: Node numbers in VTK's order, shape (c, 10 or 6).
        cell_name: XDMF's name of the cells.
        displacement: In m, shape (n, 3).
        stress: Von Mises stress in Pa, shape (n,).
    """

    points: Array
    cells: Cells
    cell_name: str
    displacement: Array
    stress: Array

    @property
    def moved(self) -> Array:
        return self.points + self.displacement


def draw(folder: Path, name: str, report: Callable[[str], Any] = print) -> list[Path]:
    """Draw all pictures of a folder of results into it.

    Args:
        folder: Results with their ``case.toml``.
        name: Stem of the result files.
        report: Gets a sentence if something had to be left out.

    Returns:
        The files written.

    Raises:
        ResultsError: No results, or none that can be read.
        CaseError: No case file, or a wrong one.
    """
    results = Results(folder, name)
    if not results.heavy.exists():
        raise ResultsError(f"{folder} holds no {results.heavy.name}, so there is nothing to draw")
    results.load()
    if not results.rows:
        raise ResultsError(f"the results in {folder} hold no step yet, so there is nothing to draw")
    case = Case.from_file(folder / "case.toml")
    row, body = _chosen(results)
    written = []

    def save(file: str, figure: Figure) -> None:
        replace(folder / file, lambda path: figure.savefig(path, format="png"))
        written.append(folder / file)

    with matplotlib.rc_context(STYLE):
        save("apex.png", plots.apex(results.rows, case.cm))
        save("profile.png", _profiles(results, body, case.actuator))
        if case.actuator.dimension == 2:
            save("mesh.png", plots.section_mesh(body.points, body.cells))
            save("slice.png", plots.section_stress(body.points, body.moved, body.cells, body.stress, row))
        found = next((k for k, row in enumerate(results.rows) if row.get("bifurcation")), None)
        if found is not None and case.actuator.dimension == 2:
            save("mode.png", _section_mode(results, body, found))
        if not can_render():
            report(NO_RENDERING)
            return written
        if case.actuator.dimension == 3:
            save("mesh.png", _mesh(body, case.actuator))
            save("slice.png", _slice(body, case.actuator, row))
            if found is not None:
                save("mode.png", _mode(results, body, case.actuator, found))
        save(f"{name}.png", _device(body, case.actuator, row))
    return written


def _chosen(results: Results) -> tuple[dict[str, Any], Body]:
    """The last requested state under load, or the last of all if there is none."""
    import h5py

    asked = [k for k, row in enumerate(results.rows) if row["requested"] and row["added_volume_ml"]]
    step = asked[-1] if asked else len(results.rows) - 1
    fields = results.fields(step, ("displacement", "von_mises_stress"))
    with h5py.File(results.heavy) as file:
        mesh = file["mesh"]
        grid = mesh["points"][:], mesh["cells"][:], str(mesh.attrs["cell_name"])
    return results.rows[step], Body(*grid, fields["displacement"], fields["von_mises_stress"])


def _profiles(results: Results, body: Body, actuator: Actuator) -> Figure:
    lines = {
        step: plots.profile(body.points, results.fields(step, ("displacement",))["displacement"], actuator)
        for step in plots.profile_steps(results.rows)
    }
    return plots.profiles(lines, plots.profile(body.points, np.zeros_like(body.points), actuator), results.rows)


def _section_mode(results: Results, body: Body, step: int) -> Figure:
    fields = results.fields(step, ("displacement", "mode"))
    moved = body.points + fields["displacement"]
    return plots.section_mode(body.points, moved, fields["mode"], body.cells, results.rows[step])


def _mode(results: Results, body: Body, actuator: Actuator, step: int) -> Figure:
    """The device at a bifurcation with some of the mode added."""
    fields = results.fields(step, ("displacement", "mode", "von_mises_stress"))
    size = 0.15 * np.ptp(body.points, axis=0).max()
    bent = dataclasses.replace(
        body, displacement=fields["displacement"] + size * fields["mode"], stress=fields["von_mises_stress"]
    )
    return _device(bent, actuator, results.rows[step])


# -- rendering --------------------------------------------------------------------------------------------------------

PROBE = """
import sys
import vtkmodules.vtkRenderingOpenGL2
from vtkmodules.vtkRenderingCore import vtkRenderer, vtkRenderWindow
window = vtkRenderWindow()
window.SetOffScreenRendering(1)
window.AddRenderer(vtkRenderer())
window.Render()
sys.exit(len(sys.argv) > 1 and window.GetClassName() != sys.argv[1])
"""


@functools.cache
def can_render() -> bool:
    """Whether VTK can draw here; on Linux this also settles in which kind of window, through VTK's own variable.

    Without a way to render, VTK does not raise but crashes, so that a process of its own has to try. The kind that
    needs no display comes first, because VTK prints warnings on its own way to it.
    """
    variable = "VTK_DEFAULT_OPENGL_WINDOW"
    if variable in os.environ or sys.platform != "linux":
        return _probe([])
    for window in ("vtkEGLRenderWindow", "vtkXOpenGLRenderWindow", "vtkOSOpenGLRenderWindow"):
        if window != "vtkXOpenGLRenderWindow" or os.environ.get("DISPLAY"):
            os.environ[variable] = window
            if _probe([window]):
                return True
    del os.environ[variable]
    return False


def _probe(arguments: list[str]) -> bool:
    try:
        done = subprocess.run([sys.executable, "-c", PROBE, *arguments], capture_output=True, timeout=60, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return False
    return done.returncode == 0


def _grid(body: Body, moved: bool = True) -> Any:
    """The solid as VTK's second-order tetrahedra, with its stress in kPa."""
    import pyvista

    grid = pyvista.UnstructuredGrid({QUADRATIC_TETRA: body.cells}, body.moved if moved else body.points)
    grid.point_data["stress"] = body.stress / 1e3
    return grid


def _surface(grid: Any) -> Any:
    """The outer surface of a grid; curved cells give several flat triangles each."""
    return grid.extract_surface(
        algorithm="dataset_surface", nonlinear_subdivision=SUBDIVISION, pass_pointid=False, pass_cellid=False
    )


def _outline(surface: Any) -> Any:
    return surface.extract_feature_edges(SHARP, non_manifold_edges=False)


def _mesh(body: Body, actuator: Actuator) -> Figure:
    """The undeformed slice with the edges of its cells."""
    import pyvista

    shown = body if actuator.cut_planes else _opened(body, _azimuth(body, actuator))
    faces = plots.outer_faces(shown.cells, shown.cell_name)
    curves = plots.edge_curves(shown.points, faces, 2**SUBDIVISION)
    count = curves.shape[1]
    lines = np.column_stack([np.full(len(curves), count), np.arange(curves.shape[0] * count).reshape(-1, count)])
    edges = pyvista.PolyData(curves.reshape(-1, 3), lines=lines.ravel())
    layers: list[Layer] = [
        (_surface(_grid(shown, moved=False)), {"color": SOLID}),
        (edges, {"color": EDGE, "line_width": 2.0}),
    ]
    what = f"{360 / actuator.copies:g}° slice" if actuator.cut_planes else "device, a quarter taken off"
    title = f"Undeformed {what}, {len(body.cells)} cells"
    return plots.page(_render(layers, _towards_slice(body, actuator)), title)


def _slice(body: Body, actuator: Actuator, row: dict[str, Any]) -> Figure:
    """The deformed slice coloured by stress, with the outline of the undeformed one."""
    shown = body if actuator.cut_planes else _opened(body, _azimuth(body, actuator))
    stress, surface = Stress(body.stress), _surface(_grid(shown))
    layers: list[Layer] = [
        (surface, _coloured(stress)),
        (_outline(surface), {"color": INK, "line_width": 2.0}),
        (_outline(_surface(_grid(shown, moved=False))), {"color": FAINT, "line_width": 1.5}),
    ]
    return plots.page(_render(layers, _towards_slice(body, actuator)), plots.headline(row), stress)


def _device(body: Body, actuator: Actuator, row: dict[str, Any]) -> Figure:
    """The whole device, cut open towards the viewer."""
    stress = Stress(body.stress)
    if actuator.dimension == 2:
        surface, gap = _revolved(body), 315.0
    else:
        assembled, gap = _assembled(body, actuator)
        surface = _surface(_grid(assembled))
    layers: list[Layer] = [(surface, _coloured(stress)), (_outline(surface), {"color": INK, "line_width": 2.0})]
    return plots.page(_render(layers, _direction(gap, 32.0)), plots.headline(row), stress)


def _assembled(body: Body, actuator: Actuator) -> tuple[Body, float]:
    """Copies of the slice around the axis without about a quarter, and the azimuth in degrees of the gap's middle.

    Every other copy is mirrored: neighbours then share their nodes, and their common faces are no surface any more.
    """
    angle, begin = 360.0 / actuator.copies, _azimuth(body, actuator)
    few = actuator.copies <= 2
    count = actuator.copies if few else actuator.copies - max(1, round(actuator.copies / 4))
    parts = [_copy(body, begin, angle, k) for k in range(count)]
    first, same = _merged(np.concatenate([part.points for part in parts]), actuator.size)
    whole = Body(
        np.concatenate([part.points for part in parts])[first],
        same[np.concatenate([part.cells + k * len(body.points) for k, part in enumerate(parts)])],
        body.cell_name,
        np.concatenate([part.displacement for part in parts])[first],
        np.tile(body.stress, count)[first],
    )
    if few:
        return _opened(whole, begin), begin + 315.0
    return whole, begin + (count * angle + 360.0) / 2


def _opened(body: Body, begin: float) -> Body:
    """A whole device without the cells of the quarter that ends at the azimuth ``begin`` in degrees."""
    x, y, _ = body.points[body.cells[:, :4]].mean(axis=1).T
    around = (np.degrees(np.arctan2(y, x)) - begin) % 360.0
    return dataclasses.replace(body, cells=body.cells[around < 270.0])


def _copy(body: Body, begin: float, angle: float, k: int) -> Body:
    """The k-th neighbour of a slice that begins at an azimuth and has an angle, both in degrees."""
    if k % 2:  # mirrored on the middle of the slice, then turned
        twice = np.radians(2 * begin + angle)
        mirror = np.array([[np.cos(twice), np.sin(twice)], [np.sin(twice), -np.cos(twice)]])
    else:
        mirror = np.eye(2)
    turn = np.radians(k * angle)
    plane = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ mirror
    matrix = np.eye(3)
    matrix[:2, :2] = plane
    cells = body.cells[:, TURNED] if k % 2 else body.cells
    return Body(body.points @ matrix.T, cells, body.cell_name, body.displacement @ matrix.T, body.stress)


def _merged(points: Array, size: float) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Which points to keep so that none is there twice, and for each given point the number of the one kept for it."""
    # Off the round numbers that meshes like, where the last digit would decide.
    rounded = np.floor(points / size * 1e6 + 0.4142).astype(np.int64)
    _, first, same = np.unique(rounded, axis=0, return_index=True, return_inverse=True)
    return first, same.reshape(-1)


def _revolved(body: Body) -> Any:
    """Surface of a half section turned through three quarters of a circle."""
    import pyvista

    values = np.column_stack([body.moved[:, ::2], body.stress / 1e3])
    curves = plots.outline(values, body.cells)
    curves = curves[curves[:, :, 0].max(axis=1) > 1e-9 * values[:, 0].max()]  # those on the axis sweep nothing
    angles = np.radians(np.linspace(0.0, 270.0, 136))
    swept = _turned(curves.reshape(-1, 3), angles)
    numbers = np.arange(len(swept)).reshape(len(angles), *curves.shape[:2])
    a, b, c, d = (numbers[i][:, :, j].ravel() for i in (slice(-1), slice(1, None)) for j in (slice(-1), slice(1, None)))
    cut, small = plots.fine_triangles(values, body.cells, 2**SUBDIVISION)
    ends = _turned(cut, angles[[0, -1]])
    points = np.concatenate([swept, ends])
    caps = [small + len(swept), small + len(swept) + len(cut)]
    faces = np.concatenate([np.column_stack([a, b, c]), np.column_stack([b, d, c]), *caps])
    first, same = _merged(points[:, :3], float(values[:, 0].max()))
    faces = same[faces]
    # On the axis, triangles shrink to lines, which would be drawn as edges.
    whole = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    surface = pyvista.PolyData.from_regular_faces(points[first, :3], faces[whole])
    surface.point_data["stress"] = points[first, 3]
    return surface


def _turned(values: Array, angles: Array) -> Array:
    """Points (radius, height, stress) at angles in radians, one angle after the other: (n, 3) to (angles n, 4)."""
    radius, rest = values[:, 0], np.tile(values[:, 1:], (len(angles), 1))
    return np.column_stack([np.outer(np.cos(angles), radius).ravel(), np.outer(np.sin(angles), radius).ravel(), rest])


def _coloured(stress: Stress) -> dict[str, Any]:
    return {
        "scalars": "stress",
        "cmap": stress.colours,
        "clim": (0.0, stress.top),
        "show_scalar_bar": False,
        "smooth_shading": True,
        "split_sharp_edges": True,
        "feature_angle": SHARP,
    }


def _azimuth(body: Body, actuator: Actuator) -> float:
    """Azimuth in degrees where the slice begins: the profile runs there."""
    x, y, _ = body.points[actuator.on_profile(body.points)].sum(axis=0)
    return float(np.degrees(np.arctan2(y, x)))


def _direction(azimuth: float, elevation: float) -> Array:
    """Unit vector at an azimuth and an elevation in degrees."""
    a, e = np.radians(azimuth), np.radians(elevation)
    return np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])


def _towards_slice(body: Body, actuator: Actuator) -> Array:
    """From where a slice is seen: across its first cut plane, a little from the rim and from above."""
    if not actuator.cut_planes:
        return _direction(_azimuth(body, actuator) - 45.0, 32.0)
    # A wide slice shows its second cut plane too, unless that is seen edge on.
    return _direction(_azimuth(body, actuator) - (62.0 if actuator.copies >= 4 else 78.0), 24.0)


Layer = tuple[Any, dict[str, Any]]


def _render(layers: list[Layer], direction: Array) -> npt.NDArray[np.uint8]:
    """Render surfaces and lines, in parallel projection, so that they fill the width of a page."""
    import pyvista

    points = np.concatenate([np.asarray(data.points) for data, _ in layers])
    right = np.cross((0.0, 0.0, 1.0), direction)
    right /= np.linalg.norm(right)
    axes = np.array([right, np.cross(direction, right), direction])
    low, high = (points @ axes.T).min(axis=0), (points @ axes.T).max(axis=0)
    wide, tall = ((high - low) * 1.06)[:2]
    width = round(WIDTH * DPI)
    height = int(np.clip(width * tall / wide, 0.3 * width, 0.62 * width))
    plotter = pyvista.Plotter(off_screen=True, window_size=(width, height), lighting="none")
    try:
        plotter.set_background("white")
        plotter.add_light(pyvista.Light(light_type="headlight", intensity=0.5))
        plotter.add_light(pyvista.Light(light_type="camera light", position=(-0.4, 1.0, 0.3), intensity=0.35))
        for data, style in layers:
            if data.n_lines:  # lifted off the surface towards the viewer; in parallel projection nothing shifts
                lifted = data.translate(2e-3 * np.linalg.norm(high - low) * direction)
                plotter.add_mesh(lifted, lighting=False, **style)
            else:
                plotter.add_mesh(data, ambient=0.5, **style)
        focus = (low + high) / 2 @ axes
        plotter.camera_position = [focus + 10 * np.linalg.norm(high - low) * direction, focus, (0.0, 0.0, 1.0)]
        plotter.camera.parallel_projection = True
        plotter.camera.parallel_scale = max(tall, wide * height / width) / 2
        plotter.renderer.ResetCameraClippingRange()
        plotter.enable_anti_aliasing("msaa", multi_samples=8)
        return np.asarray(plotter.screenshot(return_img=True))
    finally:
        plotter.close()


def draw_folder(folder: Path, name: str | None = None) -> None:
    """Draw a folder's pictures for a command: names the files, or says why not and exits with status 2.

    Args:
        folder: Results with their ``case.toml``.
        name: Stem of the result files; None for the case's own name.
    """
    try:
        if name is None:
            if not (folder / "case.toml").exists():
                raise ResultsError(f"{folder} holds no results (there is no case.toml in it)")
            name = Case.from_file(folder / "case.toml").name
        for path in draw(folder, name, lambda text: print(f"softmodels: {text}", file=sys.stderr)):
            print(path)
    except (ResultsError, CaseError) as error:
        print(f"softmodels: {error}", file=sys.stderr)
        sys.exit(2)


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--name", help="Stem of the result files.  [default: the case's name]")
def main(folder: Path, name: str | None) -> None:
    """Draw the pictures of the results in FOLDER.

    Exit status: 0 drawn, 2 the folder holds no results that can be drawn.
    """
    draw_folder(folder, name)


if __name__ == "__main__":
    main()
