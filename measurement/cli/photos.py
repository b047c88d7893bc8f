"""The commands ``photos`` and ``demo``: outlines from a list of photographs; a synthetic set of them."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np

from measurement import cli, pictures
from measurement.outline import zero
from measurement.outline.outline import Outline
from measurement.screen.setup import Setup, SetupError
from measurement.series import drawing, measuring, photo_list
from measurement.series.measuring import Measurement, NoZero
from measurement.series.photo_list import Column, ColumnError, Photograph, PhotoListError
from measurement.series.witness import Refusal, Result
from softmodels.common import commands, errors, processes, units
from softmodels.common.folders import OwnFolderError


@click.command()
@click.argument("listing", metavar="PHOTOS.csv", type=click.Path(path_type=Path))
@click.option("--setup", "setup_file", default=Path("setup.toml"), show_default=True, type=click.Path(path_type=Path),
              help="Camera and screen, from softmodels measure setup.")  # fmt: skip
@click.option("-o", "--output", type=commands.FolderType(),
help="Folder for the results.  [default: outlines; outlines-2 and so "
              "on if that holds others]")  # fmt: skip
@click.option("--jobs", type=click.IntRange(min=1), help="Processes at a time.  [default: one per core]")
@click.option("--tone", type=commands.Choice([measuring.AUTO, *pictures.TONES]), default=measuring.AUTO, show_default=True,
              help="Tone curve of the files: srgb (camera JPEG) or linear; auto estimates it from the edge.")  # fmt: skip
@click.option(
    "--water-density", help=f"Density of the column's liquid.  [default: {units.WATER_DENSITY:g}kg/m^3, {units.DENSITY_NOTE}]"
)
@click.option("--density-error", default=f"{photo_list.DENSITY_ERROR:.2g}kg/m^3", show_default=True, help="Its standard error.")
@click.option("--reading-error", default=f"{photo_list.READING_ERROR * 1e3:g}mm", show_default=True,
              help="Standard error of reading one level of the column.")  # fmt: skip
@click.option("--body-width", metavar="LENGTH",
              help="True width of the body, if its sides are visible: 34mm, or 34mm+-0.05mm. It determines the "
              "shadow's magnification.")  # fmt: skip
@click.option("--no-pictures", is_flag=True, help="Skip the pictures and the overview.")
@click.option("--quiet", is_flag=True, help="Print only errors.")
def photos(listing: Path, setup_file: Path, output: Path | None, **given: Any) -> None:
    """Measure the shadow's outline in every photograph of a list.

    The list is a CSV file with the columns file and pressure (12.5 cm of the column, or 1.2 kPa), or file, left and right
    (the levels of both tubes), and optionally error. Files are named relative to it, or by their camera's number.
    The columns hold and rise (10 s, 5 min) say how long the pressure was held before the photograph and how long the change
    to it took, in the order in which they were taken: softmodels fit --memory then fits relaxation.
    A row with anyway in the column use is used in spite of doubts, which stay in the record.
    One photograph at zero pressure shows the surface from which heights are counted.

    \b
    Exit status: 0 all measured; 3 some refused, each with its reason; 2 the input cannot be used; 1 nothing measured.
    """
    try:
        column = Column(
            units.WATER_DENSITY if given["water_density"] is None else units.quantity(given["water_density"], "kg/m^3"),
            units.quantity(given["density_error"], "kg/m^3"),
            cli.length(given["reading_error"]),
        )
        tone, width = given["tone"], None if given["body_width"] is None else _width(given["body_width"])
        listed = photo_list.read_photos(listing, column)
        setup = Setup.from_file(setup_file)
    except (ColumnError, PhotoListError, SetupError, units.UnitError) as error:
        cli.stop(str(error))
    if given["water_density"] is None and not given["quiet"] and any(photo.by_length for photo in listed):
        processes.say(
            f"pressures are read in {units.COLUMN.unit}, {units.DENSITY_NOTE}; --water-density sets another liquid's density",
            err=True,
        )
    # Of the photographs only the names: their contents are gigabytes. Whoever replaces one has another list to measure.
    files = [(photo.file.name, *_stamp(photo.file)) for photo in listed]
    asked = {"tone": tone, "column": column, "width": width, "photographs": files}
    try:
        folder = commands.open_folder(output, Path("outlines"), "outlines", asked, [listing, setup_file])
    except OwnFolderError as error:
        cli.stop(str(error))
    try:
        setup, zero = measuring.with_zero(listed, setup, tone, width)
    except SetupError as error:
        cli.stop(str(error))
    except NoZero as error:
        cli.stop(str(error), commands.EXIT_FAILED if any(photo.is_zero for photo in listed) else commands.EXIT_BAD_INPUT)
    made = _measure_all(listed, setup, zero, folder, given)
    if not given["quiet"]:
        _report(made, folder.path, width)
    for result in made.results:
        if isinstance(result.outcome, Refusal):
            processes.say(f"{result.photograph.file.name}: refused, {result.outcome.reason}", err=True)
    sys.exit(commands.EXIT_DONE if not made.refused else cli.EXIT_SOME_REJECTED if made.outlines else commands.EXIT_FAILED)


def _stamp(file: Path) -> tuple[int, int]:
    """Return the size and time of a photograph's file; zeros where there is none."""
    try:
        state = file.stat()
    except OSError:
        return 0, 0
    return state.st_size, state.st_mtime_ns


def _measure_all(
    listed: Sequence[Photograph], setup: Setup, zero: zero.ZeroLine, folder: commands.ResultFolder, given: dict[str, Any]
) -> Measurement:
    """Measure all and write the results."""
    try:
        with folder.writing() as output:
            edges = None if given["no_pictures"] else output / "edges"
            if edges is not None:
                edges.mkdir()
            tone, jobs = given["tone"], given["jobs"] or processes.cores()
            with cli.bar("measuring", len(listed), given["quiet"]) as advance:
                results = measuring.measure_all(listed, setup, zero, tone, jobs, edges, lambda result: advance())
            made = Measurement(tuple(results), setup, zero)
            made.write(output)
            if edges is not None:
                _draw(output, made, tone)
    except OwnFolderError as error:
        cli.stop(str(error))
    except OSError as error:
        cli.stop(f"the results cannot be written: {errors.reason(error)}", commands.status_of(error))
    return made


def _report(made: Measurement, folder: Path, width: tuple[float, float] | None) -> None:
    for result in made.results:
        processes.say(_line(result))
    processes.say(_scale_words(made.setup, made.zero, width))
    weak = sum(not outline.trusted for outline in made.outlines)
    insisted = sum(outline.trust == "anyway" for outline in made.outlines)
    remark = f", {weak} of them untrusted" if weak else ""
    remark += f" ({insisted} to be used anyway)" if insisted else ""
    processes.say(f"{len(made.outlines)} of {len(made.results)} measured{remark}; written to {folder}")
    for result in made.results:
        file = result.photograph.file
        if result.name != file.stem and isinstance(result.outcome, Outline):
            processes.say(f"{file.name}: its outline is {result.name}.csv, because its own name is taken")


def _width(text: str) -> tuple[float, float]:
    width, error = cli.with_error(text, cli.length)
    if not (0.0 < width < np.inf and 0.0 <= error < width):
        raise units.UnitError(f"--body-width must be a positive length, not {text}")
    return width, error


def _scale_words(setup: Setup, zero: zero.ZeroLine, width: tuple[float, float] | None) -> str:
    """Return what the lengths are compared with."""
    seen = "" if zero.sides is None else f"; the body's sides lie {zero.sides.width * 1e3:.3f} mm apart at zero pressure"
    if width is not None or setup.magnification_error > 0.0:
        error = f" +- {setup.magnification_error:.2g}" if setup.magnification_error else ""
        return f"Lengths are those of the shadow divided by its magnification of {setup.magnification:.5f}{error}{seen}"
    unknown = "--body-width" if zero.sides is not None else "setup --lamp-distance and --screen-distance"
    return (
        f"Lengths are those of the shadow divided by a magnification of {setup.magnification:g} that is not verified and has "
        f"no error; give {unknown} to determine it{seen}"
    )


def _line(result: Result) -> str:
    outcome, pressure = result.outcome, result.photograph.pressure
    if isinstance(outcome, Refusal):
        return f"{result.photograph.file.name}  {pressure:9.1f} Pa  refused"
    words = {"no": "not trusted", "anyway": "not trusted, to be used anyway"}
    remark = "" if outcome.trusted else f"  {words[outcome.trust]}: {'; '.join(outcome.reasons)}"
    height = units.with_error(outcome.height * 1e3, outcome.height_error * 1e3, "mm")
    return f"{result.photograph.file.name}  {pressure:9.1f} Pa  {height:>19}{remark}"


def _draw(output: Path, made: Measurement, tone: str) -> None:
    outlines = sorted(made.outlines, key=lambda outline: outline.pressure)
    if outlines:
        drawing.draw_profiles(output / "profiles.png", outlines)
        drawing.draw_heights(output / "heights.png", outlines)
        files = {result.outcome: result.photograph.file for result in made.results}
        highest = max(made.outlines, key=lambda outline: outline.height)
        try:
            image = pictures.read_pixels(files[highest])
            drawing.draw_steps(output / "steps.png", image, measuring.trace_image(image, made.setup, tone), highest)
        except pictures.Unmeasurable as error:  # somebody changed the file meanwhile
            processes.say(f"{files[highest].name}: no picture of its steps: {error}", err=True)
        by_pressure = sorted(made.results, key=lambda result: result.photograph.pressure)
        shown = [output / "edges" / f"{r.name}.png" for r in by_pressure if isinstance(r.outcome, Outline)]
        drawing.animate(output / "animation.gif", [file for file in shown if file.is_file()])
    drawing.write_overview(output / "overview.html", made.results, output)


# ----------------------------------------------------------------------------------------------------------------------
# The command ``demo``: a set of synthetic photographs, and the commands that measure it.


WRITTEN_FILES = ("photographs/", "setup.toml", "setup.png", "outlines/")
"""What the demonstration writes into its folder."""


@click.command()
@click.option("-o", "--output", type=commands.FolderType(), help="Folder for all files.  [default: demo; demo-2 and so on "
              "if that exists]")  # fmt: skip
@click.option("--jobs", type=click.IntRange(min=1), help="Processes at a time.  [default: one per core]")
@click.option("--quiet", is_flag=True, help="Print only errors.")
def demo(output: Path | None, jobs: int | None, quiet: bool) -> None:
    """Make a set of synthetic photographs, and measure them."""
    with commands.stoppable("measurement"):
        from measurement import photographer
        from measurement.cli import setup

    try:
        place = commands.open_place(output, Path("demo"), "demonstration of the measurement", WRITTEN_FILES)
        photographs = commands.open_folder(place / "photographs", place, "photographs", {})
        with photographs.writing() as folder:
            photographer.make_photographs(folder)
        photographs.leave()
    except OwnFolderError as error:
        cli.stop(str(error))
    except OSError as error:
        cli.stop(f"the photographs cannot be written: {errors.reason(error)}", commands.status_of(error))
    folder, setup_file, outlines = photographs.path, place / "setup.toml", place / "outlines"
    lines = {
        setup.setup: ["setup", folder / "IMG_0100.JPG", "--grid-pitch", "9mm", "--lens", "none", "-o", setup_file],
        photos: ["photos", folder / "photos.csv", "--setup", setup_file, "-o", outlines],
    }
    more = (["--jobs", str(jobs)] if jobs else []) + (["--quiet"] if quiet else [])
    for command, line in lines.items():
        words = list(map(str, line))
        if not quiet:
            click.echo(f"$ softmodels measure {' '.join(words)}")
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
