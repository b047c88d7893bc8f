"""The command ``demo``: a set of synthetic photographs, and the commands that measure it."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from measurement.cli.shared import stop
from softmodels.common.commands import FolderType, open_folder, open_place, status_of, stoppable
from softmodels.common.errors import reason
from softmodels.common.folders import OwnFolderError

WRITTEN = ("photographs/", "setup.toml", "setup.png", "outlines/")
"""What the demonstration writes into its folder."""


@click.command()
@click.option("-o", "--output", type=FolderType(), help="Folder for all files.  [default: demo; demo-2 and so on "
              "if that exists]")  # fmt: skip
@click.option("--jobs", type=click.IntRange(min=1), help="Processes at a time.  [default: one per core]")
@click.option("--quiet", is_flag=True, help="Print only errors.")
def demo(output: Path | None, jobs: int | None, quiet: bool) -> None:
    """Make a set of synthetic photographs, and measure them."""
    with stoppable("measurement"):
        from measurement.cli.photos import photos
        from measurement.cli.setup import setup
        from measurement.synthetic.photographer import make_photographs

    try:
        place = open_place(output, Path("demo"), "demonstration of the measurement", WRITTEN)
        photographs = open_folder(place / "photographs", place, "photographs", {})
        with photographs.writing() as folder:
            make_photographs(folder)
        photographs.leave()
    except OwnFolderError as error:
        stop(str(error))
    except OSError as error:
        stop(f"the photographs cannot be written: {reason(error)}", status_of(error))
    folder, setup_file, outlines = photographs.path, place / "setup.toml", place / "outlines"
    lines = {
        setup: ["setup", folder / "IMG_0100.JPG", "--grid-pitch", "9mm", "--lens", "none", "-o", setup_file],
        photos: ["photos", folder / "photos.csv", "--setup", setup_file, "-o", outlines],
    }
    more = (["--jobs", str(jobs)] if jobs else []) + (["--quiet"] if quiet else [])
    for command, line in lines.items():
        words = list(map(str, line))
        if not quiet:
            click.echo(f"$ python -m measurement {' '.join(words)}")
        status = _status(command, [*words[1:], *(more if command is photos else [])])
        if status != 0:
            sys.exit(status)
    if not quiet:
        click.echo(f"Look at {outlines / 'overview.html'}")


def _status(command: click.Command, words: list[str]) -> int:
    try:
        command.main(words, standalone_mode=False)
    except SystemExit as end:
        return int(end.code or 0)
    return 0
