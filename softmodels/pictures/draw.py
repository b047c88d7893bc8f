"""``python -m softmodels.pictures.draw results/disk``: pictures, film and report of a folder of results.

A separate program, because VTK and DOLFINx each bring an HDF5, which conflict in one process. The curves come first
and need no rendering, so machines that cannot render still get them, and the report with its 3-D view.
"""

from __future__ import annotations

import contextlib
import functools
import json
import multiprocessing
import os
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, ProcessPoolExecutor
from pathlib import Path
from typing import Any

import click
import matplotlib
import numpy as np

from softmodels.case import materials
from softmodels.case.case import Case
from softmodels.case.entries import CaseError
from softmodels.common import commands, errors, files, folders, processes
from softmodels.common.arrays import Array
from softmodels.components import contact
from softmodels.pictures import curves, offscreen, report, solid, style
from softmodels.runs import store
from softmodels.runs.states import FolderStates, StoredStates, axes_of, cut_line


def draw(
    folder: Path,
    name: str,
    say: Callable[[str], object] = print,
    *,
    wanted: commands.DrawingOptions = commands.ALL_PICTURES,
    at_rest: solid.AtRest | None = None,
    each: Callable[[Path], object] = lambda path: None,
    beside: Executor | None = None,
) -> list[Path]:
    """Draw the wanted pictures and the report of a results folder with its ``case.toml`` into it, replacing earlier ones;
    return the files. ``say`` gets a sentence if something had to be left out, ``each`` is called with each file once it is
    drawn; ``at_rest`` are pictures of the undeformed device, if they may have been drawn already. What needs no rendering is
    drawn by ``beside``, if that is given; see `second_process`.

    ResultsError or CaseError if the folder has no results or case that can be read; OwnFolderError if somebody else's file has
    the name of a picture; InUseError if another program has been drawing them for too long; OSError if it cannot be written.
    """
    if not (folder / f"{name}.h5").exists():
        raise store.ResultsError(f"{folder} holds no {name}.h5, so there is nothing to draw")
    own = store.picture_folder(folder)
    own.take(folders.DRAWING_TIMEOUT)
    try:
        states = FolderStates(folder, name)
        # Check all files before removing any, so that a foreign file does not cost the earlier pictures.
        own.check_names(store.picture_files(states.actuator.gauge))
        own.remove(own.files)
        own.claim(store.picture_files(states.actuator.gauge))
        with style.PictureFolder(folder, each) as out, matplotlib.rc_context(style.STYLE):
            apart = None
            with contextlib.suppress(BrokenExecutor):  # its process was killed before this folder's turn
                apart = beside and beside.submit(_draw_charts, folder, name, wanted.colormap, each)
            shown = offscreen.look(states, wanted.colormap)
            charts = None if apart else _charts(shown, folder, each)
            _draw(shown, out, wanted, at_rest or solid.AtRest(), say)
            try:
                written, page = charts or apart.result()  # type: ignore[union-attr]
            except BrokenExecutor:
                written, page = _charts(shown, folder, each)
            out.wait()
            out.written[:0] = written
            out.drew(page.write())
        own.forget_unwritten()
        return out.written
    finally:
        own.leave()


def orders() -> Iterator[list[Any]]:
    """Yield the orders from standard input, each a JSON list on a line; of several pending ones only the last."""
    left = b""
    while data := os.read(0, 1 << 16):
        *whole, left = (left + data).split(b"\n")
        if whole:
            yield json.loads(whole[-1])


NO_RENDERING = "this machine cannot render: pictures of the solid and the film are skipped"


def _draw(
    shown: offscreen.Look,
    out: style.PictureFolder,
    wanted: commands.DrawingOptions,
    at_rest: solid.AtRest,
    say: Callable[[str], object],
) -> None:
    """Draw what is wanted; ``say`` gets a sentence if something had to be left out."""
    states = shown.states
    if not wanted.few:
        for stem, picture in at_rest.pictures(shown).items():
            out.add(stem, picture)
    if states.actuator.dimension == 2:
        _sections(shown, out, wanted.few)
    elif offscreen.can_render():
        _solids(shown, out, wanted.few)
    if (states.actuator.dimension == 3 or wanted.film) and not offscreen.can_render():
        say(NO_RENDERING)
    elif wanted.film:
        written, left_out = solid.make_film(shown, out.path)
        for path in written:
            out.drew(path)
        if left_out:
            say(left_out)


@contextlib.contextmanager
def second_process() -> Iterator[Executor | None]:
    """Provide a process that draws beside this one; None on a single core. It is forked from this one before VTK has started
    threads here, and loads at once what its first picture needs."""
    if sys.platform != "linux" or processes.cores() < 2:
        yield None
        return
    with ProcessPoolExecutor(1, multiprocessing.get_context("fork"), processes.end_with_parent) as beside:
        beside.submit(_warm_up)
        yield beside


def _warm_up() -> None:
    files.compile_templates("softmodels.pictures", "web_view.html")
    with matplotlib.rc_context(style.STYLE):
        figure, axes = style.chart(4.0)
        axes.plot([0.0, 1.0], [0.0, 1.0], label="rise")
        axes.set(xlabel="pressure", ylabel="rise", title="")
        axes.legend()
        style.png(figure)


def _draw_charts(folder: Path, name: str, colormap: str, each: Callable[[Path], object]) -> tuple[list[Path], report.Report]:
    """Draw the charts of a folder's results; see `_charts`."""
    materials.import_own_modules()
    with matplotlib.rc_context(style.STYLE):
        return _charts(offscreen.look(FolderStates(folder, name), colormap), folder, each)


def _charts(shown: offscreen.Look, folder: Path, each: Callable[[Path], object]) -> tuple[list[Path], report.Report]:
    """Draw what needs no rendering; return the files, and the report without its pictures."""
    with style.PictureFolder(folder, each) as out:
        _curves(shown.states, out)
        page = report.Report(shown, folder, shown.states.name)
    return out.written, page


def _curves(states: StoredStates, out: style.PictureFolder) -> None:
    actuator, path = states.actuator, (states.rows, states.words)
    if states.case.program:
        out.save(actuator.gauge, curves.steps(*path))
        if states.case.timed and curves.notes.cycles(states.rows):
            out.save("loop", curves.loop(*path))
    else:
        out.save(actuator.gauge, curves.rise_of(states))
    on_profile = bool(actuator.on_profile(states.points).any())
    if not states.case.gauges.plane and not on_profile:
        return
    cut, steps = states.case.gauges.cut, curves.profile_steps(*path)

    def line(displacement: Array) -> Array:
        if cut is None:
            return curves.profile(states.points, displacement, actuator)
        return cut_line(states.skin, states.points, displacement, *cut, actuator.size)

    rest, lines = line(np.zeros_like(states.points)), {k: line(states.field(k, "displacement")) for k in steps}
    if cut is None:
        out.save("profile", curves.profiles(lines, rest, path, actuator.axial, _plate(states)))
    else:
        plane = states.case.gauges.plane
        out.save("profile", curves.cut_profiles(lines, rest, path, axes_of(cut[0], actuator.lift), plane))


def _plate(states: StoredStates) -> float | None:
    """Return the height in m of a rigid plane across the lift that stops the device; None without one."""
    obstacle = contact.obstacle_of(states.case.components)
    if obstacle is None or obstacle.on_cut:
        return None
    point, normal = obstacle.place(states.actuator)
    return point[2] if abs(normal[2]) > 1 - 1e-12 else None


def _sections(shown: offscreen.Look, out: style.PictureFolder, few: bool) -> None:
    """Draw the pictures of an axisymmetric section, without its mesh."""
    states = shown.states
    stress = solid.section_stress(shown, states.main, _plate(states))
    offscreen.draw_outlines(stress.axes[0], states, states.main)
    out.save("slice", stress)
    out.save("stress", solid.section_sheet(shown))
    if few:
        return
    if (at := states.bifurcation) is not None:
        out.save("mode", solid.section_mode(shown, at))
    out.save("hot-spots", solid.section_hot(shown))


def _solids(shown: offscreen.Look, out: style.PictureFolder, few: bool) -> None:
    """Draw the rendered pictures of the deformed solid."""
    states, scale = shown.states, shown.scales["von_mises"]
    images, camera = solid.stress(shown)
    texts = {"Camera": camera.text, "Scale": f"{scale.low:g} to {scale.top:.9g} {scale.unit}"}
    for k, (step, image) in enumerate(images, 1):
        caption = shown.caption(step, camera, scale)
        again = "cut" if k == len(images) and shown.opened and not few else ""
        out.save(
            f"stress-{k}",
            style.page(image, caption, scale),
            {**texts, "Title": caption.title, "Largest": caption.largest},
            again,
        )
    out.save("stress", solid.sheet(images, shown, camera), texts)
    if few:
        return
    if not shown.opened:
        out.save("cut", solid.cut(shown))
    if len(states.skin.planes):
        out.save("slice", solid.slice_stress(shown))
    out.save("hot-spots", solid.hot_spots(shown))
    if states.bifurcation is not None:
        out.save("mode", solid.mode(shown, states.bifurcation))


@contextlib.contextmanager
def reported(folder: Path) -> Iterator[None]:
    """End a command that draws into a folder with a sentence for an error, and status 2."""
    try:
        materials.import_own_modules()
        yield
    except (store.ResultsError, CaseError, folders.OwnFolderError, materials.OwnModuleError, folders.InUseError) as error:
        sentence = str(error)
    except OSError as error:
        sentence = f"the pictures cannot be written into {folder} ({error.strerror or error})"
    else:
        return
    processes.say(f"softmodels: {sentence}", err=True)
    sys.exit(2)


def draw_folder(
    folder: Path,
    name: str | None = None,
    wanted: commands.DrawingOptions = commands.ALL_PICTURES,
    at_rest: solid.AtRest | None = None,
    beside: Executor | None = None,
) -> None:
    """Draw a folder's pictures and report for a command, see `draw`; print the files as they come, or the error and exit with
    status 2. Without a name the results have the case's own."""
    with reported(folder):
        if name is None:
            if not (folder / "case.toml").exists():
                raise store.ResultsError(f"{folder} holds no results ({errors.no_case(folder)})")
            name = Case.from_file(folder / "case.toml").name

        def left_out(text: str) -> None:
            processes.say(f"softmodels: {text}", err=True)

        shown = functools.partial(print, flush=True)
        draw(folder, name, left_out, wanted=wanted, at_rest=at_rest, each=shown, beside=beside)


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("folder", type=click.Path(path_type=Path), required=False)
@click.option("--name", help="Stem of the result files.  [default: the case's name]")
@commands.options(commands.DrawingOptions, "wanted")
def main(folder: Path | None, name: str | None, wanted: commands.DrawingOptions) -> None:
    """Draw the pictures and the report of the results in FOLDER.

    Without FOLDER: get ready, then read orders from standard input, each a list in JSON on a line: a folder, the results'
    name, and whether they are complete. Before that, what the first state shows is drawn aside. Nothing is drawn if the
    input ends first. A run starts it so beside itself.

    Exit status: 0 drawn, 2 the folder holds no results that can be drawn.
    """
    at_rest = solid.AtRest()
    with commands.unswept(), second_process() as beside:
        if folder is not None:
            draw_folder(folder, name, wanted, beside=beside)
            return
        files.compile_templates("softmodels.common", "page.html", "parts.html")
        for place, stem, complete in orders():
            if complete:
                draw_folder(Path(place), stem, wanted, at_rest, beside)
                return
            at_rest.draw_early(Path(place), stem)


if __name__ == "__main__":
    main()
