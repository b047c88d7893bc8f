"""``python -m softmodels.pictures.draw results/disk``: pictures, film and report of a folder of results.

A separate program, because VTK and DOLFINx each bring an HDF5, which conflict in one process. The curves come first
and need no rendering, so machines that cannot render still get them, and the report with its 3-D view.
"""

from __future__ import annotations

import contextlib
import json
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import click
import matplotlib
import numpy as np

from softmodels.case.case import Case
from softmodels.case.components import OwnModuleError, import_own_modules
from softmodels.case.entries import CaseError
from softmodels.common.arrays import Array
from softmodels.common.commands import unswept
from softmodels.common.folders import PATIENCE, InUseError, OwnFolderError
from softmodels.common.processes import say
from softmodels.components.contact import obstacle_of
from softmodels.pictures import curves, offscreen, report, solid
from softmodels.pictures.film import Film
from softmodels.pictures.offscreen import Look, can_render, draw_outlines, look
from softmodels.pictures.solid import AtRest
from softmodels.pictures.style import STYLE, DrawnFolder, headline
from softmodels.runs.store import ResultsError, States, axes_of, cut_line, picture_files, picture_folder

if TYPE_CHECKING:
    from matplotlib.figure import Figure


# ----------------------------------------------------------------------------------------------------------------------
# Picture makers that can start before the run ends: the film's process, and the pictures at rest.


class Makers:
    """Picture makers, ready to start; as a context manager they end the film's process.

    Args:
        beside: Make the film in a process of its own, in a program that has not rendered.
        rendered: Whether this machine can render.
    """

    def __init__(self, beside: bool, rendered: bool):
        self.film, self.rest = Film(beside and rendered), AtRest(rendered)

    def __enter__(self) -> Makers:
        self.film.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.film.__exit__(kind, error, trace)

    def draw_early(self, folder: Path, name: str) -> None:
        """Draw what is possible once a run has stored its first state.

        Args:
            folder: Results with their ``case.toml``.
            name: Stem of the result files.
        """
        if self.rest.rendered:
            self.film.rehearse(folder, name)
        self.rest.draw_early(folder, name)


def orders() -> Iterator[list[Any]]:
    """Yield the orders from standard input, each a JSON list on a line; of several pending ones only the last."""
    left = b""
    while data := os.read(0, 1 << 16):
        *whole, left = (left + data).split(b"\n")
        if whole:
            yield json.loads(whole[-1])


def get_ready(beside: bool) -> Makers:
    """Load the renderer and check that it works, before there is anything to draw; ``beside`` as of `Makers`."""
    with unswept():  # VTK's clean-up at exit would take a tenth of the drawing time
        import pyvista.plotting  # noqa: F401

        with contextlib.suppress(OwnModuleError):  # reported when something is drawn
            import_own_modules()
    return Makers(beside, can_render())


NO_RENDERING = "this machine cannot render: pictures of the solid and the film are skipped"


def draw(
    folder: Path,
    name: str,
    say: Callable[[str], object] = print,
    *,
    beside: bool = False,
    makers: Makers | None = None,
    few: bool = False,
    each: Callable[[Path], object] = lambda path: None,
) -> list[Path]:
    """Draw the pictures, film and report of a results folder into it, replacing earlier ones.

    Args:
        folder: Results with their ``case.toml``.
        name: Stem of the result files.
        say: Gets a sentence if something had to be left out.
        beside: Make the film in a process beside this one, which must not have rendered anything yet.
        makers: What draws, if it has been made ready or has drawn something already.
        few: Draw only the curves, the stress and the report.
        each: Is called with each file once it is drawn.

    Returns:
        The files written.

    Raises:
        ResultsError: No results, or none that can be read.
        CaseError: No case file, or a wrong one.
        OwnFolderError: Somebody else's file has the name of a picture.
        InUseError: Another program has been drawing them for too long.
        OSError: The folder cannot be written.
    """
    if not (folder / f"{name}.h5").exists():
        raise ResultsError(f"{folder} holds no {name}.h5, so there is nothing to draw")
    own = picture_folder(folder)
    own.take(PATIENCE)
    try:
        states = States(folder, name)
        # Check all files before removing any, so that a foreign file does not cost the earlier pictures.
        own.check_names(picture_files(states.actuator.gauge))
        own.remove(own.files)
        own.claim(picture_files(states.actuator.gauge))
        with DrawnFolder(folder, report.shrunk, each) as out:
            if few:
                written = _draw_few(states, out, name, say)
            else:
                written = _draw(states, out, name, say, makers or Makers(beside, can_render()))
        own.forget_unwritten()
        return written
    finally:
        own.leave()


def _draw(states: States, out: DrawnFolder, name: str, say: Callable[[str], object], makers: Makers) -> list[Path]:
    """Draw everything."""
    rendered = makers.rest.rendered
    with makers, matplotlib.rc_context(STYLE):
        if rendered:
            makers.film.begin(out.path, name)
        shown = look(states)
        _curves(states, out)
        for stem, picture in makers.rest.pictures(shown).items():
            out.add(stem, picture)
        if states.actuator.dimension == 2:
            _sections(states, out)
        if rendered:
            _solids(shown, out)
            _stress(shown, out)
            out.save("cut", solid.cut(shown))
            page = report.Report(shown, out.path, name)  # while the film is being made
            written, left_out = makers.film.made()
            for path in written:
                out.drew(path)
            for text in left_out:
                say(text)
        else:
            page = report.Report(shown, out.path, name)
            say(NO_RENDERING)
        out.drew(page.write(out.pages()))
    return out.written


def _draw_few(states: States, out: DrawnFolder, name: str, say: Callable[[str], object]) -> list[Path]:
    """Draw only the most useful pictures."""
    shown = look(states)
    with matplotlib.rc_context(STYLE):
        _curves(states, out)
        if states.actuator.dimension == 2:
            _slice(states, out)
        if can_render():
            _stress(shown, out)
        else:
            say(NO_RENDERING)
        out.drew(report.Report(shown, out.path, name).write(out.pages()))
    return out.written


def _curves(states: States, out: DrawnFolder) -> None:
    actuator = states.actuator
    if states.case.program:
        out.save(actuator.gauge, curves.steps(states.rows, states.words))
        if states.case.timed and curves.cycles(states.rows):
            out.save("loop", curves.loop(states.rows, states.words))
    else:
        over = curves.over_of(states.case)
        figure = curves.rise(states.rows, actuator.gauge, states.case.cm, states.branch, over, states.sources)
        out.save(actuator.gauge, figure)
    if states.case.gauges.plane:
        out.save("profile", _cut_profile(states))
        return
    if not actuator.on_profile(states.points).any():
        return
    rest = curves.profile(states.points, np.zeros_like(states.points), actuator)
    lines = {
        step: curves.profile(states.points, states.field(step, "displacement"), actuator)
        for step in curves.profile_steps(states.rows, states.words)
    }
    out.save("profile", curves.profiles(lines, rest, (states.rows, states.words), actuator.axial, _plate(states)))


def _cut_profile(states: States) -> Figure:
    """Draw the section of the outer surface by the case's plane."""
    actuator, gauges = states.actuator, states.case.gauges
    assert gauges.cut is not None
    normal, at = gauges.cut

    def line(displacement: Array) -> Array:
        return cut_line(states.skin, states.points, displacement, normal, at, actuator.size)

    steps = curves.profile_steps(states.rows, states.words)
    lines = {step: line(states.field(step, "displacement")) for step in steps}
    rest = line(np.zeros_like(states.points))
    return curves.cut_profiles(lines, rest, (states.rows, states.words), axes_of(normal, actuator.lift), gauges.plane)


def _plate(states: States) -> float | None:
    """Return the height in m of a rigid plane across the lift that stops the device; None without one."""
    obstacle = obstacle_of(states.case.components)
    if obstacle is None or obstacle.on_cut:
        return None
    point, normal = obstacle.place(states.actuator)
    return point[2] if abs(normal[2]) > 1 - 1e-12 else None


def _sections(states: States, out: DrawnFolder) -> None:
    """Draw the pictures of an axisymmetric section, without its mesh."""
    step, words = states.main, states.words
    points, moved, cells = states.points, states.moved(step), states.cells
    _slice(states, out)
    if (at := states.bifurcation) is not None:
        out.save(
            "mode",
            solid.section_mode(points, states.moved(at), states.field(at, "mode"), cells, states.rows[at], words),
        )
    stretch, hot = states.field(step, "largest_stretch"), offscreen.hot_spots_of(states, step)
    out.save("hot-spots", solid.section_hot(moved, cells, stretch, hot, states.rows[step]))


def _slice(states: States, out: DrawnFolder) -> None:
    """Draw the stress in a section."""
    step, plate = states.main, _plate(states)
    points, moved, values = states.points, states.moved(step), states.field(step, "von_mises")
    stress = solid.section_stress(points, moved, states.cells, values, states.rows[step], states.words, plate)
    draw_outlines(stress.axes[0], states, step)
    out.save("slice", stress)


def _solids(shown: Look, out: DrawnFolder) -> None:
    """Draw the rendered pictures of the deformed solid, without the stress."""
    states = shown.states
    if states.actuator.dimension == 3:
        if len(states.skin.planes):
            out.save("slice", solid.slice_stress(shown))
        out.save("hot-spots", solid.hot_spots(shown))
        if states.bifurcation is not None:
            out.save("mode", solid.mode(shown, states.bifurcation))


def _stress(shown: Look, out: DrawnFolder) -> None:
    """Draw the solid with its stress at the requested values."""
    rows, words = shown.states.rows, shown.states.words
    images, camera, scale = solid.stress(shown)
    texts = {
        "Camera": camera.text,
        "Scale": f"{scale.low:g} to {scale.top:.9g} {scale.unit}",
        "Largest": f"{scale.largest:.4g} {scale.unit} {scale.defined}",
    }
    for k, (step, image) in enumerate(images, 1):
        title = headline(rows[step], words)
        out.save(f"stress-{k}", solid.page(image, title, scale), {**texts, "Title": title})
    out.save("stress", solid.sheet(images, rows, words, scale), texts)


def draw_folder(folder: Path, name: str | None = None, few: bool = False, makers: Makers | None = None) -> None:
    """Draw a folder's pictures, film and report for a command; print the files, or the error and exit with status 2.

    Args:
        folder: Results with their ``case.toml``.
        name: Stem of the result files; None for the case's own name.
        few: Draw only the curves, the stress and the report.
        makers: As of `draw`.
    """
    try:
        import_own_modules()
        if name is None:
            if not (folder / "case.toml").exists():
                raise ResultsError(f"{folder} holds no results (there is no case.toml in it)")
            name = Case.from_file(folder / "case.toml").name

        def left_out(text: str) -> None:
            say(f"softmodels: {text}", err=True)

        def each(path: Path) -> None:
            print(path, flush=True)  # a run prints them as they come

        draw(folder, name, left_out, beside=True, makers=makers, few=few, each=each)
    except (ResultsError, CaseError, OwnFolderError, OwnModuleError, InUseError) as error:
        say(f"softmodels: {error}", err=True)
        sys.exit(2)
    except OSError as error:
        say(f"softmodels: the pictures cannot be written into {folder} ({error.strerror or error})", err=True)
        sys.exit(2)


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("folder", type=click.Path(path_type=Path), required=False)
@click.option("--name", help="Stem of the result files.  [default: the case's name]")
@click.option("--pictures", type=click.Choice(("all", "few")), default="all", show_default=True,
              help="few: only the curves, the stress and the report.")  # fmt: skip
def main(folder: Path | None, name: str | None, pictures: str) -> None:
    """Draw the pictures, the film and the report of the results in FOLDER.

    Without FOLDER: get ready, then read orders from standard input, each a list in JSON on a line: a folder, the results'
    name, and whether they are complete. Before that, what the first state shows is drawn aside. Nothing is drawn if the
    input ends first. A run starts it so beside itself.

    Exit status: 0 drawn, 2 the folder holds no results that can be drawn.
    """
    few = pictures == "few"
    if folder is not None:
        draw_folder(folder, name, few)
        return
    with get_ready(not few) as makers:
        for place, stem, complete in orders():
            if complete:
                draw_folder(Path(place), stem, few, makers)
                return
            makers.draw_early(Path(place), stem)


if __name__ == "__main__":
    main()
