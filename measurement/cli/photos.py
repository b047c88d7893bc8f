"""The commands ``photos`` and ``demo``: outlines from a list of photographs, and a set of photographs to try it on."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import NoReturn

import click
import numpy as np

from measurement.camera.pixels import TONES, Unmeasurable, read_photograph
from measurement.edge.tracing import AUTO
from measurement.ending import bounded
from measurement.outline.outline import Outline
from measurement.outline.zero import ZeroLine
from measurement.output_option import FolderType, open_folder, open_place
from measurement.output_place import status_of
from measurement.own_folder import OwnFolderError
from measurement.reasons import reason
from measurement.result_folder import ResultFolder
from measurement.screen.setup import Setup, SetupError
from measurement.series.column import DENSITY_ERROR, READING_ERROR, Column, ColumnError
from measurement.series.measurement import Measurement, with_zero
from measurement.series.measuring import NoZero, Result, measure_all
from measurement.series.photo import Refusal
from measurement.series.photo_list import Photograph, PhotoListError, read_photos
from measurement.units import WATER_DENSITY, UnitError, quantity

ALL_MEASURED, FAILED, UNUSABLE, SOME_REFUSED = 0, 1, 2, 3

DEMO = ("photographs/", "setup.toml", "setup.png", "outlines/")
"""What the demonstration writes into its folder."""


@click.command()
@click.argument("listing", metavar="PHOTOS.csv", type=click.Path(path_type=Path))
@click.option("--setup", "setup_file", default=Path("setup.toml"), show_default=True, type=click.Path(path_type=Path),
              help="Camera and screen, from python -m measurement setup.")  # fmt: skip
@click.option("-o", "--output", type=FolderType(), help="Folder for the results.  [default: outlines; outlines-2 and so on "
              "where that holds others]")  # fmt: skip
@click.option("--jobs", type=click.IntRange(min=1), help="Processes at a time.  [default: one per core]")
@click.option("--tone", type=click.Choice([AUTO, *TONES]), default=AUTO, show_default=True,
              help="How the files store light: as a camera's JPEG, or in proportion; auto looks at the edge.")  # fmt: skip
@click.option(
    "--water-density", default=f"{WATER_DENSITY:g}kg/m^3", show_default=True, help="Density of the column's liquid."
)
@click.option("--density-error", default=f"{DENSITY_ERROR:.2g}kg/m^3", show_default=True, help="Its standard error.")
@click.option("--reading-error", default=f"{READING_ERROR * 1e3:g}mm", show_default=True,
              help="Standard error of reading one level of the column.")  # fmt: skip
@click.option("--body-width", metavar="LENGTH",
              help="True width of the body, whose sides the photographs show: 34mm, or 34mm+-0.05mm. It tells the shadow's "
              "magnification.")  # fmt: skip
@click.option("--no-pictures", is_flag=True, help="Leave the pictures and the overview out.")
@click.option("--quiet", is_flag=True, help="Say nothing but errors.")
def photos(
    listing: Path, setup_file: Path, output: Path | None, jobs: int | None, tone: str, water_density: str, density_error: str,
    reading_error: str, body_width: str | None, no_pictures: bool, quiet: bool,
) -> None:  # fmt: skip
    """Measure the shadow's outline in every photograph of a list.

    The list is a CSV file with the columns file and pressure (12.5 cm of the column, or 1.2 kPa), or file, left and right
    (the levels of both tubes), and optionally error. Files are named relative to it, or by their camera's number.
    One photograph at zero pressure shows the surface from which heights are counted.

    \b
    Exit status: 0 all measured; 3 some refused, each with its reason; 2 the input cannot be used; 1 nothing measured.
    """
    try:
        column = Column(
            quantity(water_density, "kg/m^3"), quantity(density_error, "kg/m^3"), quantity(reading_error, "m")
        )
        listed = read_photos(listing, column)
        setup = Setup.from_file(setup_file)
        width = None if body_width is None else _width(body_width)
    except (ColumnError, PhotoListError, SetupError, UnitError) as error:
        _stop(str(error), UNUSABLE)
    # Of the photographs only the names: their contents are gigabytes. Whoever replaces one has another list to measure.
    photographs = [photo.file for photo in listed]
    asked = {"tone": tone, "column": column, "width": width, "photographs": [(f.name, *_stamp(f)) for f in photographs]}
    try:
        folder = open_folder(output, Path("outlines"), "outlines", asked, [listing, setup_file])
    except OwnFolderError as error:
        _stop(str(error), UNUSABLE)
    sys.exit(_run(listed, setup, folder, jobs or _cores(), tone, width, not no_pictures, quiet))


def _stamp(file: Path) -> tuple[int, int]:
    """Size and time of a photograph's file; zeros where there is none."""
    try:
        state = file.stat()
    except OSError:
        return 0, 0
    return state.st_size, state.st_mtime_ns


def _run(
    listed: list[Photograph], setup: Setup, folder: ResultFolder, jobs: int, tone: str,
    width: tuple[float, float] | None, draw: bool, quiet: bool,
) -> int:  # fmt: skip
    try:
        zeroed = with_zero(listed, setup, tone, width)
    except SetupError as error:
        _stop(str(error), UNUSABLE)
    except NoZero as error:
        _stop(str(error), UNUSABLE if not any(photo.is_zero for photo in listed) else FAILED)
    setup, zero = zeroed
    try:
        with folder.writing() as output:
            edges = output / "edges"
            if draw:
                edges.mkdir()
            results = _measure(listed, setup, zero, tone, jobs, edges if draw else None, quiet)
            Measurement(tuple(results), setup, zero).write(output)
            if draw:
                _draw(output, results, setup, tone)
    except OwnFolderError as error:
        _stop(str(error), UNUSABLE)
    except OSError as error:
        _stop(f"the results cannot be written: {reason(error)}", status_of(error))
    refused = [result for result in results if isinstance(result.outcome, Refusal)]
    if not quiet:
        for result in results:
            click.echo(_line(result))
        click.echo(_scale_words(setup, zero, width))
        weak = sum(isinstance(result.outcome, Outline) and not result.outcome.trusted for result in results)
        told = f", {weak} of them not trusted" if weak else ""
        click.echo(f"{len(results) - len(refused)} of {len(results)} measured{told}; written to {folder.path}")
        for result in results:
            if result.name != result.photograph.file.stem and isinstance(result.outcome, Outline):
                click.echo(
                    f"{result.photograph.file.name}: its outline is {result.name}.csv, for its own name is taken"
                )
    for result in refused:
        assert isinstance(result.outcome, Refusal)
        click.echo(f"{result.photograph.file.name}: refused, {result.outcome.reason}", err=True)
    return ALL_MEASURED if not refused else FAILED if len(refused) == len(results) else SOME_REFUSED


def _width(text: str) -> tuple[float, float]:
    value, _, error = text.replace("±", "+-").partition("+-")
    width, spread = quantity(value, "m"), quantity(error, "m") if error else 0.0
    if not (0.0 < width < np.inf and 0.0 <= spread < width):
        raise UnitError(f"--body-width must be a positive length, not {text}")
    return width, spread


def _scale_words(setup: Setup, zero: ZeroLine, width: tuple[float, float] | None) -> str:
    """What the lengths are held against."""
    seen = (
        "" if zero.sides is None else f"; the body's sides lie {zero.sides.width * 1e3:.3f} mm apart at zero pressure"
    )
    if width is not None or setup.magnification_error > 0.0:
        error = f" +- {setup.magnification_error:.2g}" if setup.magnification_error else ""
        return f"Lengths are the shadow's over its magnification of {setup.magnification:.5f}{error}{seen}"
    unknown = "--body-width" if zero.sides is not None else "setup --lamp-distance and --screen-distance"
    return (
        f"Lengths are the shadow's over a magnification of {setup.magnification:g} that nothing here checks and no error "
        f"counts; {unknown} would tell it{seen}"
    )


def _measure(
    listed: list[Photograph], setup: Setup, zero: ZeroLine, tone: str, jobs: int, edges: Path | None, quiet: bool
) -> list[Result]:
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True, quiet=quiet)
    with Progress(console=console, disable=quiet or not console.is_terminal, transient=True) as bar:
        task = bar.add_task("measuring", total=len(listed))
        return measure_all(listed, setup, zero, tone, jobs, edges, lambda result: bar.advance(task))


def _line(result: Result) -> str:
    outcome, pressure = result.outcome, result.photograph.pressure
    if isinstance(outcome, Refusal):
        return f"{result.photograph.file.name}  {pressure:9.1f} Pa  refused"
    remark = "" if outcome.trusted else f"  not trusted: {'; '.join(outcome.reasons)}"
    height = f"{outcome.height * 1e3:8.4f} mm +- {outcome.height_error * 1e6:.1f} um"
    return f"{result.photograph.file.name}  {pressure:9.1f} Pa  {height}{remark}"


def _draw(output: Path, results: list[Result], setup: Setup, tone: str) -> None:
    from measurement.edge.tracing import trace_image
    from measurement.series.overview import animate, draw_heights, draw_profiles, measured, write_overview
    from measurement.series.photo_pictures import draw_steps

    outlines = measured(results)
    if outlines:
        draw_profiles(output / "profiles.png", outlines)
        draw_heights(output / "heights.png", outlines)
        highest = max((r for r in results if isinstance(r.outcome, Outline)), key=lambda r: r.outcome.height)  # type: ignore[union-attr]
        try:
            image = read_photograph(highest.photograph.file)
            assert isinstance(highest.outcome, Outline)
            draw_steps(output / "steps.png", image, setup, trace_image(image, setup, tone), highest.outcome)
        except Unmeasurable as error:  # somebody changed the file meanwhile
            click.echo(f"{highest.photograph.file.name}: no picture of its steps, {error}", err=True)
        by_pressure = sorted(results, key=lambda result: result.photograph.pressure)
        shown = [output / "edges" / f"{r.name}.png" for r in by_pressure if isinstance(r.outcome, Outline)]
        animate(output / "animation.gif", [file for file in shown if file.is_file()])
    write_overview(output / "overview.html", results, output)


@click.command()
@click.option("-o", "--output", type=FolderType(), help="Folder for all of it.  [default: demo; demo-2 and so on where that "
              "is taken]")  # fmt: skip
@click.option("--jobs", type=click.IntRange(min=1), help="Processes at a time.  [default: one per core]")
@click.option("--quiet", is_flag=True, help="Say nothing but errors.")
def demo(output: Path | None, jobs: int | None, quiet: bool) -> None:
    """Make a set of synthetic photographs, measure them, and say where the pictures are."""
    from measurement.synthetic.demo import make_photographs

    try:
        place = open_place(output, Path("demo"), "demonstration of the measurement", DEMO)
        photographs = open_folder(place / "photographs", place, "photographs", {})
        with photographs.writing() as folder:
            make_photographs(folder)
        photographs.leave()
    except OwnFolderError as error:
        _stop(str(error), UNUSABLE)
    except OSError as error:
        _stop(f"the photographs cannot be written: {reason(error)}", status_of(error))
    folder, setup_file, outlines = photographs.path, place / "setup.toml", place / "outlines"
    words = [
        ["setup", folder / "IMG_0100.JPG", "--grid-pitch", "9mm", "--lens", "none", "-o", setup_file],
        ["photos", folder / "photos.csv", "--setup", setup_file, "-o", outlines],
    ]
    from measurement.cli.setup import setup

    for command, (name, *rest) in zip((setup, photos), [list(map(str, line)) for line in words], strict=True):
        if not quiet:
            click.echo(f"$ python -m measurement {name} {' '.join(rest)}")
        more = (["--jobs", str(jobs)] if jobs else []) + (["--quiet"] if quiet else []) if name == "photos" else []
        status = _status(command, rest + more)
        if status != 0:
            sys.exit(status)
    if not quiet:
        click.echo(f"Look at {outlines / 'overview.html'}")


def _status(command: click.Command, words: list[str]) -> int:
    try:
        command.main(words, standalone_mode=False)
    except SystemExit as stop:
        return int(stop.code or 0)
    return 0


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _stop(sentence: str, status: int) -> NoReturn:
    click.echo(f"Error: {bounded(sentence)}", err=True)
    sys.exit(status)
