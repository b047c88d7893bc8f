"""The commands ``open``, ``draw``, ``compare`` and ``line``: look at results, hold them against each other, take values."""

from __future__ import annotations

import contextlib
import sys
import webbrowser
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np

from softmodels.case import materials
from softmodels.cli import ending, options
from softmodels.common import commands, errors, files, processes
from softmodels.runs import states
from softmodels.runs.states import Line

if TYPE_CHECKING:
    from softmodels.api.run import SolvedState


PAGES = ("report.html", "overview.html", "sheet.html")
"""Reports by the names they have in folders of results."""
TABLES = ("fitted.toml", "unsound.toml", "design.toml", "limit.csv", "modes.csv", "scores.csv", "path.csv", "mould.toml")
"""What is opened where there is no report, the best first."""
MARK = b'<meta name="generator" content="softmodels">'


@options.command("open")
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--no-browser", is_flag=True, help="Only print the address.")
def open_command(folder: Path, no_browser: bool) -> None:
    """Open the report of the results in FOLDER in the browser.

    The missing report of a run or a design is made first, from what is stored in the folder. Where none can be made, the best
    other file is opened.

    \b
    Exit status: 0 opened; 2 the folder holds no results.
    """
    with ending.unwritable(folder, "cannot be read"):
        address = report_of(folder).resolve().as_uri()
    processes.say(address)
    if not no_browser:
        webbrowser.open(address)


def report_of(folder: Path) -> Path:
    """Return the report of a folder of results, made if need be; exit with a sentence where there are none."""
    if not folder.is_dir():
        near = "" if folder.exists() else errors.near_paths(folder)
        ending.fail(f"{folder} is not a folder{near or '; give a folder of results, such as results/disk'}")
    for attempt in (False, True):
        if attempt and not _made(folder):
            break
        if file := next((folder / name for name in PAGES if (folder / name).is_file()), None):
            return file
    if file := next((folder / name for name in TABLES if (folder / name).is_file()), None):
        processes.say(f"softmodels: {folder} has no report, and its results are not enough to make one", err=True)
        return file
    inside = sorted(
        path for path in folder.iterdir() if path.is_dir() and any((path / name).exists() for name in (*PAGES, *TABLES))
    )
    near = f"open one of those in it: {', '.join(map(str, inside[:5]))}" if inside else "give another, such as results/disk"
    ending.fail(f"{folder} holds no results; {near}")


def _made(folder: Path) -> bool:
    """Make the report of a run or a design; return whether there was something to make it from."""
    if (folder / "design.json").is_file() and (folder / "before" / "case.toml").is_file():
        from softmodels.pictures import draw_design

        materials.import_own_modules()
        draw_design.draw(folder)
        return True
    if (folder / "case.toml").is_file() and any(folder.glob("*.h5")):
        from softmodels.pictures import draw

        processes.say(f"softmodels: making the report of {folder} (softmodels draw makes all pictures)", err=True)
        with contextlib.redirect_stdout(sys.stderr):  # the names of the files it draws
            draw.draw_folder(folder, wanted=commands.DrawingOptions("few"))
        return True
    return False


@options.command("draw")
@click.argument("folder", type=click.Path(path_type=Path))
@commands.options(commands.DrawingOptions, "wanted")
def draw_command(folder: Path, wanted: commands.DrawingOptions) -> None:
    """Redraw the pictures and the report of the results in FOLDER."""
    with commands.unswept():
        from softmodels.pictures import draw

        with draw.second_process() as beside:
            draw.draw_folder(folder, wanted=wanted, beside=beside)


@options.command("compare")
@click.argument("folders", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Write a report as HTML to this file.")
@click.option("--quiet", is_flag=True, help="Print only errors.")
def compare_command(folders: Sequence[Path], output: Path | None, quiet: bool) -> None:
    """Compare results with those in the first of the FOLDERS.

    Their cases, main figures, paths and outlines are compared.

    Figures are compared at the highest load that all reach, and at the loads that all were asked for. Where a run has no state
    at such a load, its figures are interpolated between neighbouring states.

    \b
    Examples:
      softmodels compare results/disk results/disk-2
      softmodels compare results/coarse results/fine -o compared.html

    \b
    Exit status: 0 compared; 2 a folder holds no results, or they cannot be compared.
    """
    from softmodels.pictures import comparison

    with ending.unwritable(output or folders[0], "cannot be read or written"):
        materials.import_own_modules()
        if output is not None:
            commands.check_output_file(output, folders, _is_page, "a report", "--output")
        compared = comparison.compared([comparison.ComparedResult.from_folder(folder) for folder in folders])
        if output is not None:
            compared.save(output)
    if not quiet:
        processes.say(str(compared))
        if output is not None:
            processes.say(f"report in {output}")


@options.command("line")
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--from", "begin", metavar="PLACE", help="Where the line begins: a place such as '0, 0, 10 mm', or a probe.")
@click.option("--to", "end", metavar="PLACE", help="Where it ends, likewise.")
@click.option("--through", metavar="PLACE", help="Instead: straight through the wall at the surface point nearest to a place.")
@click.option("--at", "value", metavar="VALUE", help="State, by its load, such as 70cm, 7kPa or 40ml.  [default: the last]")
@click.option("--points", type=click.IntRange(2), default=states.LINE_POINTS, show_default=True, help="Number of points.")
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Write all values to this CSV file, and a PNG beside it.")
@click.option("--quiet", is_flag=True, help="Print only errors.")
def line_command(folder: Path, value: str | None, points: int, output: Path | None, quiet: bool, **places: str | None) -> None:
    """Take the values along a line through the body.

    FOLDER has the results; a line may show the stress through a wall.

    Places are in device coordinates of the undeformed body, with which the line moves. They may lie anywhere in the whole
    device, also where only a section or a slice of it is modelled.

    \b
    Examples:
      softmodels line results/disk --through apex --at 70cm -o wall.csv
      softmodels line results/disk --from '0, 0, 15 mm' --to '30, 0, 15 mm'

    \b
    Exit status: 0 done; 2 no results, no such state, or a line beside the body.
    """
    from softmodels.api import calls

    begin, end, through = (places[name] for name in ("begin", "end", "through"))
    if (begin is None, end is None, through is None) not in ((False, False, True), (True, True, False)):
        ending.fail("give the line's ends (--from and --to), or a place whose wall it goes through (--through)")
    with ending.unwritable(output or folder, "cannot be read or written"):
        materials.import_own_modules()
        if output is not None and output.suffix.lower() != ".csv":
            ending.fail(f"{output} ends in {output.suffix or 'nothing'}; values along a line are written as .csv (--output)")
        if output is not None:
            commands.check_output_file(output, [], _is_line, "a table of values along a line", "--output")
            commands.check_output_file(output.with_suffix(".png"), [], files.is_drawn, "a picture", "--output")
        run = calls.load(folder)
        state = run.last if value is None else run.at(value)
        line = state.through(through, points) if through is not None else state.along(begin or "", end or "", points)
        if output is not None:
            _write_line(output, line, state)
    if not quiet:
        processes.say(line_text(line))
        if output is not None:
            processes.say(f"values in {output}, picture in {output.with_suffix('.png')}")


def line_text(line: Line) -> str:
    """Return the main values along a line, as sentences."""
    inside = line.inside
    distance = line.distance[inside] * 1e3
    stress = line["von_mises"][inside] / 1e3
    normal = line.normal_stress[inside] / 1e3
    step = (distance[-1] - distance[0]) / max(len(distance) - 1, 1) if len(distance) > 1 else 0.0
    most = int(np.argmax(stress))
    gaps = "" if np.diff(distance).max(initial=0.0) < 1.5 * step else ", with gaps"
    return (
        f"silicone from {distance[0]:.4g} to {distance[-1]:.4g} mm of the line{gaps}\nlargest von Mises stress "
        f"{stress[most]:.4g} kPa, at {distance[most]:.4g} mm; at the ends {stress[0]:.4g} and {stress[-1]:.4g} kPa\nnormal "
        f"stress along the line {normal[0]:.4g} kPa where it begins, {normal[-1]:.4g} kPa where it ends\nlargest stretch "
        f"{np.nanmax(line['largest_stretch']):.4g}"
    )


def _write_line(output: Path, line: Line, state: SolvedState) -> None:
    """Write the values along a line as CSV, and their picture beside it."""
    import matplotlib

    from softmodels.api import run
    from softmodels.pictures import curves, style

    columns = line.columns
    with matplotlib.rc_context(style.STYLE):
        picture = style.encoded(
            style.drawn(curves.along_line(line, f"{state.case.name} at {run.headline(state.case, state.variables)}")), style.DPI
        )
    files.write_text(output, files.csv_text(columns, np.array([*columns.values()]).T.tolist()))
    files.write_bytes(output.with_suffix(".png"), picture)


def _is_line(path: Path) -> bool:
    try:
        return files.read_file(path).startswith(b"distance_mm,")
    except OSError:
        return False


def _is_page(path: Path) -> bool:
    try:
        files.check_file(path)
        return MARK in files.read_file(path)[:1000]
    except OSError:
        return False
