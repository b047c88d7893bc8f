"""The command ``view``: tip, angle and centre line of a device seen from the side, from a list of photographs or a film."""

from __future__ import annotations

import itertools
import math
import sys
import tempfile
from pathlib import Path
from typing import Any

import click
import numpy as np

from measurement import cli, film
from measurement.camera import CameraError
from measurement.outline import dots
from measurement.outline.outline import Outline
from measurement.screen.setup import Setup, SetupError
from measurement.series import drawing, markers, photo_list, revolved, views
from measurement.series.photo_list import ColumnError, PhotoListError
from measurement.series.witness import Refusal
from softmodels.common import commands, errors, processes, tables, units
from softmodels.common.arrays import Array
from softmodels.common.folders import OwnFolderError


@click.command()
@click.argument("listing", metavar="PHOTOS.csv | FILM", type=click.Path(path_type=Path))
@click.option("--setup", "setup_file", default=Path("setup.toml"), show_default=True, type=click.Path(path_type=Path),
              help="Camera and scale, from softmodels measure setup: a grid, board or tag beside the device.")  # fmt: skip
@click.option("--device", "case", metavar="CASE.toml", type=click.Path(path_type=Path),
              help="Case of the device, whose depth and length are taken.")  # fmt: skip
@click.option("--camera-distance", metavar="LENGTH", help="From the camera to the device's middle plane; 80cm+-1cm.")
@click.option("--depth", metavar="LENGTH", help="Size of the device along the line of sight; 0 for a round one.")
@click.option("--ahead", default="0+-1mm", show_default=True, metavar="LENGTH",
              help="How far the device's middle plane lies before the scale, towards the camera, and its error.")  # fmt: skip
@click.option("--base", metavar="x,y=x,y",
              help="Two pixels at the ends of the face at which the device begins; needed unless it leaves the frame "
              "there.")  # fmt: skip
@click.option("--revolved", is_flag=True, help="Measure the outline, which may overhang, of a body of revolution (balloon, "
              "bellows, drop) seen square to its axis.")  # fmt: skip
@click.option("--markers", metavar="COLOUR | tag36h11", help="Track the markers on the device's face towards the camera: round "
              "dots of a colour, such as red or #2060c0, or AprilTags.")  # fmt: skip
@click.option("--in-space", is_flag=True, help="The device leaves its plane: measure it for softmodels measure join, which "
              "needs a second view.")  # fmt: skip
@click.option("--length", metavar="LENGTH", help="The device's length without pressure, against which the scale is checked.")
@click.option("--pressures", metavar="LOG.csv | LIST",
              help="Of a film: log of time and pressure, or a pressure for each plateau, such as '0, 5, 10 kPa'.")  # fmt: skip
@click.option("--columns", metavar="TEXT", help="Columns of the log, such as time=1[s],pressure=2[kPa].")
@click.option("--pressure-error", metavar="PRESSURE", help="Standard error of a film's pressures.  [default: 1 %, of a log's "
              "largest one]")  # fmt: skip
@click.option(
    "--clock-offset", metavar="TIME", help="The log's time at which the film begins; 12s, or 12s+-1s to look near it."
)
@click.option(
    "--every", metavar="TIME", help="Measure a frame every so often, as a history in time, instead of one each plateau."
)
@click.option("-o", "--output", type=commands.FolderType(),
              help="Folder for the results.  [default: views; views-2 and so on if that holds others]")  # fmt: skip
@click.option("--no-pictures", is_flag=True, help="Skip the pictures.")
@click.option("--quiet", is_flag=True, help="Print only errors.")
def view(listing: Path, setup_file: Path, output: Path | None, **given: Any) -> None:
    """Measure how a device bends, in listed photographs or a film.

    The list is that of softmodels measure photos. A film with the pressures beside it becomes such a list in a folder of its
    own: a photograph at the end of each plateau. Each photograph shows the device from the side before a background of
    another colour. Places count from the middle of its base, x to the right and z upwards; rotations from the photograph at
    zero pressure.

    \b
    Exit status: 0 all measured; 3 some refused, each with its reason, or no markers; 2 the input cannot be used;
    1 nothing measured.
    """
    filmed = {name: given.pop(name) for name in FILM_OPTIONS}
    try:
        scene = _scene(Setup.from_file(setup_file), given)
        is_film = film.is_film(listing)
        if is_film:
            listing = _photographs_of(listing, output, filmed, given["quiet"])
        elif told := [f"--{name.replace('_', '-')}" for name, text in filmed.items() if text is not None]:
            cli.stop(f"{told[0]} is for a film; a list of photographs has its pressures and times in columns")
        listed = photo_list.read_photos(listing)
    except (
        CameraError,
        ColumnError,
        PhotoListError,
        SetupError,
        film.FilmError,
        units.UnitError,
        errors.GeometryError,
    ) as error:
        cli.stop(str(error))
    asked = {"photographs": [photo.file.name for photo in listed], **{k: v for k, v in given.items() if k != "quiet"}}
    try:
        folder = commands.open_folder(
            output, Path("views"), "side views", asked, [listing, setup_file, *([given["case"]] if given["case"] else [])]
        )
        with folder.writing() as place:
            edges = None if given["no_pictures"] else place / "edges"
            if edges is not None:
                edges.mkdir()
            with cli.bar("measuring", len(listed), given["quiet"]) as advance:
                made = (
                    revolved.outlines(listed, scene, edges, advance) if given["revolved"]
                    else views.views(listed, scene, edges, advance, given["markers"] or "")
                )  # fmt: skip
            made.write(place)
            if is_film and edges is not None:
                shown = sorted(edges.glob("*.png"))
                drawing.write_film(place / "film.mp4", shown, 1.0 / _seconds(filmed["every"] or "1 s", "--every"))
    except OwnFolderError as error:
        cli.stop(str(error))
    except OSError as error:
        cli.stop(f"the results cannot be written: {errors.reason(error)}", commands.status_of(error))
    sys.exit(_report(made, folder.path, given["quiet"], given["markers"]))


def _report(made: views.Views | revolved.Outlines, folder: Path, quiet: bool, kind: str | None) -> int:
    """Report what was measured, with markers of a kind, and return the command's exit status."""
    measured = [outcome for outcome in made.outcomes if not isinstance(outcome, Refusal)]
    if not quiet:
        for shown in measured:
            processes.say(_line(made, shown))
        weak = sum(outcome.trust != "yes" for outcome in measured)
        remark = f", {weak} of them untrusted" if weak else ""
        processes.say(f"{len(measured)} of {len(made.photographs)} measured{remark}; written to {folder}")
    for photo, outcome in zip(made.photographs, made.outcomes, strict=True):
        if isinstance(outcome, Refusal):
            processes.say(f"{photo.file.name}: refused, {outcome.reason}", err=True)
    if not measured:
        return commands.EXIT_FAILED
    is_whole = (kind is None or _report_markers(made, kind, quiet)) and len(measured) == len(made.outcomes)
    return commands.EXIT_DONE if is_whole else cli.EXIT_SOME_REJECTED


def _report_markers(made: views.Views | revolved.Outlines, kind: str, quiet: bool) -> bool:
    """Report how many markers of a kind the photographs show, and return whether there are any."""
    seen = [marker for view in made.outcomes if isinstance(view, views.View) for marker in view.markers]
    if not seen:
        processes.say(
            f"no marker ({kind}) is seen on the device; give the colour that the dots have in the photographs, and dots of "
            "20 pixels or more across",
            err=True,
        )
    elif not quiet:
        weak = sum(bool(marker.reasons) for marker in seen)
        remark = f"; {weak} places not trusted, with the reasons in {markers.TABLE}" if weak else ""
        processes.say(f"{len({marker.name for marker in seen})} markers on the device{remark}")
    return bool(seen)


FILM_OPTIONS = ("pressures", "columns", "pressure_error", "clock_offset", "every")


def _seconds(text: str, option: str) -> float:
    value = units.quantity(text, "s")
    if not (math.isfinite(value) and value > 0.0):
        raise SetupError(f"{option} is {units.brief(text)}; it must be a time above 0 s")
    return value


def _photographs_of(path: Path, output: Path | None, told: dict[str, str | None], quiet: bool) -> Path:
    """Return the list of photographs of a film, in a folder beside the results; those of the same film and options are not
    made again. Raises `FilmError`, `ColumnError`, `SetupError` or `UnitError`."""
    if told["pressures"] is None:
        raise film.FilmError(
            "give --pressures, the log of the film's pressures or one for each plateau, such as '0, 5, 10 kPa'"
        )
    table = Path(told["pressures"])
    by_log = table.is_file() or "," not in told["pressures"]
    if by_log and not table.is_file():
        raise film.FilmError(f"there is no log {table}; name a file, or the pressures of the plateaus, such as '0, 5, 10 kPa'")
    if not path.is_file():
        raise film.FilmError(f"there is no film {path}; check its name and folder")
    if not by_log and (wrong := next((name for name in ("columns", "clock_offset", "every") if told[name]), None)):
        raise film.FilmError(f"--{wrong.replace('_', '-')} needs a log of the pressures over time (--pressures LOG.csv)")
    column = photo_list.Column()
    error = None if told["pressure_error"] is None else column.read("0 Pa", told["pressure_error"])[1]
    every = None if told["every"] is None else _seconds(told["every"], "--every")
    near = (
        None if told["clock_offset"] is None else cli.with_error(told["clock_offset"], lambda text: units.quantity(text, "s"))
    )
    if by_log:
        log, typed = film.read_log(table, told["columns"] or ""), []
    else:
        log, typed = None, _typed(told["pressures"], column, told["pressure_error"] or "")
    base = path.with_name(f"{path.stem}-frames").name if output is None else f"{output.name}-frames"
    default = Path(base) if output is None else output.with_name(base)
    try:
        folder = commands.open_folder(
            None if output is None else default, default, "frames of a film", told, [path, *([table] if by_log else [])]
        )
        if folder.is_done:
            if not quiet:
                processes.say(f"frames of {path.name} taken from {folder.path}")
            return folder.path / film.LIST
        with cli.bar("reading the film", film.frame_count(path), quiet) as advance:
            motion = film.motion_of(path, advance)
        shots = _shots(motion, log, typed, near, every, error, quiet)
        with folder.writing() as place, cli.bar("writing frames", len(shots), quiet) as advance:
            film.write_shots(path, shots, place, advance)
    except OwnFolderError as problem:
        cli.stop(str(problem))
    except OSError as problem:
        cli.stop(f"the frames cannot be written: {errors.reason(problem)}", commands.status_of(problem))
    return folder.path / film.LIST


def _typed(text: str, column: photo_list.Column, error: str) -> list[tuple[float, float]]:
    """Return the pressures of plateaus and their errors in Pa; a unit counts for those before it that have none."""
    made, unit = [], ""
    for part in reversed(text.split(",")):
        own = units.number_and_unit(part)[1]
        unit = own or unit
        made.append(column.read(part if own else f"{part} {unit}", error))
    return made[::-1]


def _shots(
    motion: film.Motion, log: film.Log | None, typed: list[tuple[float, float]], near: tuple[float, float] | None,
    every: float | None, error: float | None, quiet: bool,
) -> list[film.Shot]:  # fmt: skip
    """Return the photographs to be made of a film; says how the clocks are aligned, and which plateaus there are."""
    if log is None:
        held = film.plateaus(motion, None)
        if len(held) != len(typed):
            seen = ", ".join(f"{plateau.begin:.1f}-{plateau.end:.1f} s" for plateau in held)
            raise film.FilmError(
                f"the film has {len(held)} plateaus ({seen}), but {len(typed)} pressures are given; give one for each of "
                "them, or a log"
            )
        return film.shots_of(motion, held, lambda number, first, last: typed[number])
    clocks = film.align(motion, log, near)
    film.check_clocks(clocks, near is not None and near[1] == 0.0)
    offset = clocks.offset
    if not quiet:
        processes.say(
            f"{log.source}; the film begins at {offset:.3f} s of the log (correlation of its changes with the picture's "
            f"{clocks.correlation:.2f})"
        )
    if every is not None:
        return film.history_of(motion, log, offset, every, error)
    held = film.plateaus(motion, log, offset)
    return film.shots_of(motion, held, lambda number, first, last: film.logged(log, first + offset, last + offset, error))


def _scene(setup: Setup, given: dict[str, Any]) -> views.Scene:
    """Return the scene that the options describe. Raises `SetupError` or `UnitError` for a text that is not what it should
    be, and for what is missing."""
    depths, sides, length = None, None, None
    if given["markers"]:
        given["markers"] = dots.checked_kind(given["markers"])
    if given["revolved"]:
        if told := [f"--{'device' if name == 'case' else name}" for name in ("case", "depth", "length") if given[name]]:
            raise SetupError(f"leave out {told[0]} with --revolved: the outline of a body of revolution shows how deep it is")
        if given["in_space"]:
            raise SetupError("leave out --in-space with --revolved: a body of revolution is seen from one side")
        if given["markers"]:
            raise SetupError("leave out --markers with --revolved: the face of a body of revolution is nowhere flat")
        depths = (0.0, 0.0)
    if given["in_space"] and given["markers"]:
        raise SetupError("leave out --markers with --in-space: how far before the plane they lie is not known")
    if given["case"] is not None:
        depths, length, sides = size_of(given["case"])
    if given["depth"] is not None:
        depths = (0.0 if given["depth"].strip() == "0" else cli.length(given["depth"]),) * 2
    if given["camera_distance"] is None:
        raise SetupError("give --camera-distance: how large its front and rear faces appear depends on it; such as 80cm+-1cm")
    if depths is None:
        raise SetupError(
            "give --depth: the outline is that of its front or rear face; 0 for a round device (or --device CASE.toml)"
        )
    if given["markers"] and max(depths) == 0.0:
        raise SetupError(
            "--markers needs to know how far before the device's middle plane they are: give --depth, twice that; or leave "
            "--markers out for a round device"
        )
    far, far_error = cli.with_error(given["camera_distance"], cli.length)
    ahead = cli.with_error(given["ahead"], lambda text: 0.0 if text.strip() == "0" else cli.length(text))
    stated = (length, 0.0) if length is not None else None
    if given["length"] is not None:
        stated = cli.with_error(given["length"], cli.length)
    base = None
    if given["base"] is not None:
        base = np.array([cli.numbers(part, 2, "--base") for part in given["base"].split("=")])
        if base.shape != (2, 2):
            raise SetupError("--base needs two pixels, such as 400,210=400,330")
    sides = sides if len(set(depths)) > 1 else None
    return views.Scene(setup, (far, far_error), depths, ahead, base, stated, sides, given["in_space"])


ROUND_SHARE = 0.5
"""Share of a device's width along the line of sight below which an edge of its outline is that of something round."""

LENGTH_SLICES = 12
"""Pieces between base and tip in which a device's outline is looked at."""


def size_of(case: Path) -> tuple[tuple[float, float], float, Array]:
    """Return the depths of a case's device along the line of sight at its two edges, 0 of a round one, its length from the face
    ``support`` to ``tip``, and at equal steps along it the distances (k, 2) of the edges from the support's middle, all in m.
    Raises `GeometryError` for no such device."""
    from geometries import actuator, mesh_arrays, registry

    try:
        tables_of_case = tables.read_toml(case)
    except tables.TomlError as error:
        raise errors.GeometryError(f"{case} {error}") from None
    table = tables_of_case.get("geometry", {})
    if isinstance(file := table.get("file"), str):
        table = {**table, "file": str(case.parent / file)}
    device = registry.from_table(table)
    if device.dimension != 3:
        raise errors.GeometryError(f"{case} has the section of a device; give --depth and --length instead")
    with tempfile.TemporaryDirectory() as folder:
        device.write(Path(folder) / "device.msh")
        mesh = mesh_arrays.read_arrays(Path(folder) / "device.msh")
    ends = ("support", next((role for role in actuator.ENDS if role in mesh.nodes), actuator.ENDS[0]))
    for role in ends:
        if role not in mesh.nodes:
            raise errors.GeometryError(f"the device of {case} has no face {role!r}; give --depth and --length instead")
    base, tip = (mesh.points[mesh.nodes[role]].mean(axis=0) for role in ends)
    cuts = device.cut_planes
    sight = np.array(cuts[0].normal) if len(cuts) == 1 else np.array([0.0, 1.0, 0.0])
    way = (tip - base) - sight * (sight @ (tip - base))
    length = float(np.linalg.norm(way))
    along, across, deep = (
        mesh.points @ axis for axis in (way / length, np.cross(sight, way / length), sight)
    )  # fmt: skip
    whole = 2.0 * float(np.abs(deep).max()) if cuts else float(np.ptp(deep))
    edges = np.linspace(along.min(), along.max(), LENGTH_SLICES + 1)
    held = across[mesh.nodes["support"]]
    middle = 0.5 * (held.min() + held.max())
    depths, sides = [], []
    for low, high in itertools.pairwise(edges):
        here = (along >= low) & (along <= high)
        if not here.any():
            continue
        outer = [deep[here][side > side.max() - 0.02 * np.ptp(across)] for side in (across[here], -across[here])]
        seen = [2.0 * float(np.abs(part).max()) if cuts else float(np.ptp(part)) for part in outer]
        depths.append([depth if depth > ROUND_SHARE * whole else 0.0 for depth in seen])
        sides.append([across[here].max() - middle, middle - across[here].min()])
    first, second = np.mean(depths, axis=0).tolist()
    return (first, second), length, np.array(sides)


def _line(made: views.Views | revolved.Outlines, view: views.View | Outline) -> str:
    head = f"{view.source}  {view.pressure:9.1f} Pa  "
    remark = "" if view.trust == "yes" else f"  not trusted: {'; '.join(view.reasons)}"
    if isinstance(view, Outline):
        return f"{head}{revolved.in_words(view)}{remark}"
    assert isinstance(made, views.Views)
    x, z = (view.shape.tip - made.origin) * 1e3
    turned, error = (math.degrees(value) for value in made.rotation(view))
    by = (
        f"turned by {turned:8.2f} +- {error:.2f} deg"
        if math.isfinite(turned)
        else f"at {math.degrees(view.shape.angle):8.2f} deg"
    )
    errors_mm = view.tip_error * 1e3
    return f"{head}tip x {x:8.3f} +- {errors_mm[0]:.3f} mm, z {z:8.3f} +- {errors_mm[1]:.3f} mm, {by}{remark}"
