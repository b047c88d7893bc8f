"""The commands ``open`` and ``compare``: look at results, and hold them against each other."""

from __future__ import annotations

import contextlib
import sys
import webbrowser
from collections.abc import Sequence
from pathlib import Path

import click

from softmodels.case.components import OwnModuleError, import_own_modules
from softmodels.case.entries import INPUT_ERRORS
from softmodels.cli.options import fail
from softmodels.common.commands import status_of
from softmodels.common.errors import reason
from softmodels.common.files import check_file, read_file
from softmodels.common.folders import OwnFolderError, check_output_file
from softmodels.common.processes import say
from softmodels.runs.store import ResultsError

PAGES = ("report.html", "overview.html", "sheet.html")
"""Reports by the names they have in folders of results."""
TABLES = (
    "fitted.toml",
    "unsound.toml",
    "design.toml",
    "limit.csv",
    "modes.csv",
    "scores.csv",
    "path.csv",
    "mould.toml",
)
"""What is opened where there is no report, the best first."""
MARK = b'<meta name="generator" content="softmodels">'


@click.command("open")
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--no-browser", is_flag=True, help="Only print the address.")
def open_command(folder: Path, no_browser: bool) -> None:
    """Open the report of the results in FOLDER in the browser.

    The missing report of a run or a design is made first, from what is stored in the folder. Where none can be made, the best
    other file is opened.

    \b
    Exit status: 0 opened; 2 the folder holds no results.
    """
    try:
        file = report_of(folder)
    except OSError as error:
        fail(f"{folder} cannot be read ({reason(error)})")
    address = file.resolve().as_uri()
    say(address)
    if not no_browser:
        webbrowser.open(address)


def report_of(folder: Path) -> Path:
    """Return the report of a folder of results, made if need be; exit with a sentence where there are none."""
    if not folder.is_dir():
        fail(f"{folder} is not a folder; give a folder of results, such as results/disk")
    for attempt in (False, True):
        if attempt and not _made(folder):
            break
        if found := next((folder / name for name in PAGES if (folder / name).is_file()), None):
            return found
    if found := next((folder / name for name in TABLES if (folder / name).is_file()), None):
        say(f"softmodels: {folder} has no report, and its results are not enough to make one", err=True)
        return found
    inside = sorted(
        path for path in folder.iterdir() if path.is_dir() and any((path / name).exists() for name in (*PAGES, *TABLES))
    )
    near = (
        f"open one of those in it: {', '.join(map(str, inside[:5]))}"
        if inside
        else "give another, such as results/disk"
    )
    fail(f"{folder} holds no results; {near}")


def _made(folder: Path) -> bool:
    """Make the report of a run or a design; return whether there was something to make it from."""
    if (folder / "design.json").is_file() and (folder / "before" / "case.toml").is_file():
        from softmodels.pictures.draw_design import draw

        import_own_modules()
        try:
            draw(folder)
        except (ResultsError, OwnModuleError, *INPUT_ERRORS) as error:
            fail(str(error))
        return True
    if (folder / "case.toml").is_file() and any(folder.glob("*.h5")):
        from softmodels.pictures.draw import Wanted, draw_folder

        say(f"softmodels: making the report of {folder} (softmodels draw makes all pictures)", err=True)
        with contextlib.redirect_stdout(sys.stderr):  # the names of the files it draws
            draw_folder(folder, wanted=Wanted(few=True))
        return True
    return False


@click.command("compare")
@click.argument("folders", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Write a report as HTML to this file.")
@click.option("--quiet", is_flag=True, help="Print only errors.")
def compare_command(folders: Sequence[Path], output: Path | None, quiet: bool) -> None:
    """Compare the results in FOLDERS with those in the first: their cases, main figures, paths and outlines.

    Figures are compared at the highest load that all reach, and at the loads that all were asked for. Where a run has no state
    at such a load, its figures are interpolated between neighbouring states.

    \b
    Examples:
      softmodels compare results/disk results/disk-2
      softmodels compare results/coarse results/fine -o compared.html

    \b
    Exit status: 0 compared; 2 a folder holds no results, or they cannot be compared.
    """
    from softmodels.pictures.comparison import Compared, ComparisonError, compared

    try:
        import_own_modules()
        if output is not None:
            check_output_file(output, folders, _is_page, "a report", "--output")
        found = compared([Compared.from_folder(folder) for folder in folders])
        if output is not None:
            found.save(output)
    except (ComparisonError, OwnFolderError, OwnModuleError, ResultsError, *INPUT_ERRORS) as error:
        fail(str(error))
    except OSError as error:
        fail(f"{output or folders[0]} cannot be read or written ({reason(error)})", status_of(error))
    if not quiet:
        say(str(found))
        if output is not None:
            say(f"report in {output}")


def _is_page(path: Path) -> bool:
    """Return whether a file is a report of this program."""
    try:
        check_file(path)
        return MARK in read_file(path)[:1000]
    except OSError:
        return False
