"""The commands ``calibrate`` and ``setup``: a camera from chessboards, a setup from a photograph of the grid."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import sys
from pathlib import Path
from typing import Any, NoReturn

import click
import numpy as np
import tomli_w
from numpy.typing import NDArray

from measurement.camera.camera import Camera, CameraError, frame_points
from measurement.camera.lens import Exif, lens_profile, read_exif
from measurement.cli import setup_texts as texts
from measurement.ending import bounded
from measurement.output_file import check_output_file, has_table, is_drawn
from measurement.output_place import status_of, trouble
from measurement.own_files import is_same
from measurement.own_folder import OwnFolderError
from measurement.reasons import reason
from measurement.screen.boards import find_charuco, find_chessboard
from measurement.screen.calibration import calibrate as calibrated
from measurement.screen.grid import GridPoints, counted_from, find_grid
from measurement.screen.grid_error import GridError
from measurement.screen.known_points import plane_of_points, plane_of_scale
from measurement.screen.overlay import draw_points, read_picture
from measurement.screen.plane import Plane, PlaneError
from measurement.screen.setup import Setup, SetupError
from measurement.toml_file import TomlError, read_toml
from measurement.units import UnitError, number

UNUSABLE, UNMEASURED, SOME_REFUSED = 2, 1, 3
"""Exit statuses: the input cannot be used; it can, but nothing could be measured in it; some photographs are left out."""

LARGEST = 0.5
"""Largest pitch in m of a printed grid or board; beyond it somebody wrote m for mm."""

REACHED = 0.9
"""Share of the way to the frame's corners that the boards of a good calibration reach."""


@click.command()
@click.argument("photographs", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--pattern", default="9x6", show_default=True, metavar="NxM",
              help="Inner corners of the board (where four squares meet) in a row and in a column.")  # fmt: skip
@click.option("--pitch", default="25mm", show_default=True, metavar="LENGTH", help="Side of a square.")
@click.option("-o", "--output", type=click.Path(path_type=Path), default=Path("camera.toml"), show_default=True,
              help="Camera file to write, for setup --lens.")  # fmt: skip
def calibrate(photographs: tuple[Path, ...], pattern: str, pitch: str, output: Path) -> None:
    """Calibrate the camera from PHOTOGRAPHS of a flat chessboard.

    Take ten or so with the focus and zoom of the measurement, the board tilted each time another way, and see to it that
    together they fill the picture up to its corners. Photographs without the board are left out and named.

    \b
    Exit status: 0 done; 3 some photographs refused; 2 the input cannot be used; 1 nothing measured.
    """
    _check_place(output)
    try:
        check_output_file(output, photographs, lambda file: has_table("camera")(file) and not has_table("plane")(file),
                          "the camera file", "-o")  # fmt: skip
        made = calibrated(photographs, texts.pattern(pattern), texts.length(pitch))
    except (OwnFolderError, UnitError, SetupError) as error:
        _stop(str(error), UNUSABLE)
    except CameraError as error:
        _stop(str(error), UNMEASURED)
    camera = made.camera
    _write(
        output, "# A camera; made by python -m measurement calibrate.\n" + tomli_w.dumps({"camera": camera.as_table()})
    )
    for path, rms in made.per_image.items():
        click.echo(f"{path}: {rms:.2f} px")
    for path, why in made.refused.items():
        click.echo(f"{path}: refused, {why}", err=True)
    click.echo(
        f"Focal length fx {camera.matrix[0, 0]:.1f} px, principal point {camera.matrix[0, 2]:.1f}, "
        f"{camera.matrix[1, 2]:.1f} px; {len(made.per_image)} photographs used, their corners miss by "
        f"{made.residual_px:.2f} px rms"
    )
    click.echo(
        f"The lens is known to {camera.error_px:.2g} px where boards were seen, {camera.errors_px[-1]:.2g} px in the "
        f"picture's corners; written to {output}"
    )
    if made.coverage < REACHED:
        click.echo(
            f"Boards reach {made.coverage:.0%} of the way from the middle to the corners; photographs with the board there "
            "would tell the lens beyond",
            err=True,
        )
    sys.exit(SOME_REFUSED if made.refused else 0)


@click.command()
@click.argument("photograph", type=click.Path(path_type=Path))
@click.option("--target", type=click.Choice(["grid", "chessboard", "charuco"]), default="grid", show_default=True,
              help="What lies in the screen's plane.")  # fmt: skip
@click.option("--grid-pitch", default="9mm", show_default=True, metavar="LENGTH",
              help="Distance of the grid's lines, or side of a board's square.")  # fmt: skip
@click.option("--pattern", default="9x6", show_default=True, metavar="NxM",
              help="Inner corners of the chessboard or ChArUco board in a row and in a column.")  # fmt: skip
@click.option("--dictionary", default="DICT_4X4_50", show_default=True, help="OpenCV's name of the ChArUco markers.")
@click.option(
    "--marker-share",
    default="0.75",
    show_default=True,
    metavar="NUMBER",
    help="Side of a ChArUco marker over that of a square.",
)
@click.option("--point", "points", multiple=True, metavar="x,y=X,Z",
              help="In place of the grid: a known point, pixel and place (100,200=9mm,18mm); four or more.")  # fmt: skip
@click.option("--scale", metavar="N px/m",
              help="In place of the grid: pixels per length of a camera that looks straight on; 75px/mm+-1px/mm.")  # fmt: skip
@click.option("--lens", default="auto", show_default=True, metavar="auto|none|NAME|CAMERA.toml|PROFILE.xml",
              help="Lens correction: lensfun's for what EXIF names, none, lensfun's for a name, the file of calibrate, or a "
              "file in lensfun's format.")  # fmt: skip
@click.option("--camera", "body", help="Name of the camera where EXIF does not tell it, such as 'Canon EOS 550D'.")
@click.option("--focal", metavar="LENGTH", help="Focal length where EXIF does not tell it, such as 35mm.")
@click.option("--origin", metavar="x,y", help="Pixel near the crossing that becomes X = Z = 0.  [default: the middle]")
@click.option("--lamp-distance", metavar="LENGTH",
              help="From the lamp to the object, if the light is not parallel; 2m+-5cm gives an error.")  # fmt: skip
@click.option("--screen-distance", metavar="LENGTH", help="From the object to the screen; 3cm+-1mm gives an error.")
@click.option("--roi", metavar="x0,y0,x1,y1", help="Region of interest in px; the shadow is sought in it alone.")
@click.option("--zero", metavar="x,y=x,y", help="Two pixels on the undeformed surface.")
@click.option("-o", "--output", type=click.Path(path_type=Path), default=Path("setup.toml"), show_default=True,
              help="Setup file to write, for photos --setup.")  # fmt: skip
@click.option("--overlay", type=click.Path(path_type=Path),
              help="Picture of what was found.  [default: OUTPUT with the ending .png, or -overlay.png where that "
              "is taken]")  # fmt: skip
def setup(photograph: Path, output: Path, overlay: Path | None, **given: Any) -> None:
    """Find the screen's plane in a PHOTOGRAPH of its grid, of a board, or of known points.

    Pixels (x, y) count from the upper left; on the screen X counts to the right and Z upwards.

    \b
    Exit status: 0 done; 2 the input cannot be used, as where no grid is found; 1 failed.
    """
    for place in (output, overlay or output):
        _check_place(place)
    try:
        _check_given(given)
        shown = _places(photograph, output, overlay, given["lens"])
        picture = read_picture(photograph)
        height, width = picture.shape[:2]
        pitch = texts.length(given["grid_pitch"])
        if not pitch > 0.0:
            raise SetupError(f"--grid-pitch must be a positive length, not {given['grid_pitch']}")
        if pitch > LARGEST:
            raise SetupError(f"--grid-pitch {given['grid_pitch']} is no grid of this kind; write mm for millimetres")
        camera = _camera(given["lens"], photograph, width, height, given["body"], given["focal"])
        plane, grid = _plane(picture, camera, pitch, given)
        size = texts.magnification(given["lamp_distance"], given["screen_distance"])
        roi = None if given["roi"] is None else texts.numbers(given["roi"], 4, "--roi")
        has_grid = grid is not None and given["target"] == "grid"
        made = Setup(camera, plane, *size, roi=roi, grid_pitch=pitch if has_grid else None)  # type: ignore[arg-type]
        if given["zero"] is not None:
            ends = [texts.numbers(part, 2, "--zero") for part in given["zero"].split("=")]
            made = dataclasses.replace(made, zero=made.to_metres(ends))
    except GridError as error:
        _stop(f"{photograph}: {error}", UNUSABLE)
    except (CameraError, OwnFolderError, PlaneError, SetupError, UnitError) as error:
        _stop(str(error), UNUSABLE)
    try:
        draw_points(shown, picture, camera, plane)
    except (OSError, ValueError) as error:
        status = status_of(error) if isinstance(error, OSError) else UNUSABLE
        _stop(f"the picture of the plane {shown} cannot be written: {reason(error)}", status)
    _write(output, made.to_toml())
    kind = "known points" if given["points"] else "crossings" if given["target"] == "grid" else "corners"
    _report(made, None if given["scale"] else kind, f"written to {output} and {shown}")


def _check_place(path: Path) -> None:
    """Stop before the work begins if a file cannot be written there."""
    if why := trouble(path.parent):
        _stop(f"{path} cannot be written: {why}", UNUSABLE)


def _check_given(given: dict[str, Any]) -> None:
    """Refuse options that something else given makes meaningless.

    Raises:
        SetupError: The first of them.
    """
    source = click.get_current_context().get_parameter_source
    told = {name for name in given if source(name) is click.core.ParameterSource.COMMANDLINE}
    board = ("pattern", "dictionary", "marker_share")
    target, lens = given["target"], given["lens"]
    meaningless: list[tuple[str, tuple[str, ...]]] = []
    if given["points"] or given["scale"] is not None:
        way = "--point" if given["points"] else "--scale"
        meaningless.append((way, ("target", "grid_pitch", *board, *(("origin",) if given["points"] else ()))))
    elif target != "charuco":
        meaningless.append((f"--target {target}", board if target == "grid" else ("dictionary", "marker_share")))
    if lens == "none" or lens.endswith(".toml"):
        meaningless.append((f"--lens {lens}", ("body", "focal")))
    for cause, names in meaningless:
        for name in names:
            if name in told:
                flag = {"body": "camera"}.get(name, name.replace("_", "-"))
                raise SetupError(f"--{flag} says nothing beside {cause}; leave one of them out")


def _places(photograph: Path, output: Path, overlay: Path | None, lens: str) -> Path:
    """Where the overlay goes: beside the setup, under another name where that is the photograph's or somebody else's.

    Raises:
        OwnFolderError: The setup or the overlay would replace what is not the program's.
    """
    inputs = (photograph, Path(lens))
    check_output_file(output, inputs, has_table("plane"), "the setup", "-o")
    if overlay is None:
        overlay = output.with_suffix(".png")
        if any(is_same(overlay, file) for file in inputs) or (overlay.is_file() and not is_drawn(overlay)):
            overlay = output.with_name(f"{output.stem}-overlay.png")
    check_output_file(overlay, (*inputs, output), is_drawn, "the picture of what was found", "--overlay")
    if overlay == output:
        raise OwnFolderError(f"{output} cannot be both the setup and its picture; give another --overlay")
    return overlay


def _plane(
    picture: NDArray[np.uint8], camera: Camera, pitch: float, given: dict[str, Any]
) -> tuple[Plane, GridPoints | None]:
    place = None if given["origin"] is None else texts.numbers(given["origin"], 2, "--origin")
    origin = (place[0], place[1]) if place else None
    if given["scale"] is not None and given["points"]:
        raise SetupError("give --point or --scale, not both")
    if given["scale"] is not None:
        scale, _, error = given["scale"].replace("±", "+-").partition("+-")
        return plane_of_scale(camera, texts.per_metre(scale), texts.per_metre(error) if error else 0.0, origin), None
    if given["points"]:
        pairs = [texts.known_point(text) for text in given["points"]]
        px, metres = (np.array(part, dtype=float) for part in zip(*pairs, strict=True))
        return plane_of_points(camera, px, metres), None
    if given["target"] == "grid":
        grid = find_grid(picture, camera, pitch, origin)
    else:
        columns, rows = texts.pattern(given["pattern"])
        if given["target"] == "chessboard":
            grid = find_chessboard(picture, (columns, rows), camera)
        else:
            squares = (columns + 1, rows + 1)
            grid = find_charuco(picture, squares, number(given["marker_share"]), given["dictionary"], camera)
        grid = counted_from(grid, camera, pitch, origin)
    return grid.plane(camera), grid


def _report(made: Setup, kind: str | None, written: str) -> None:
    camera, plane = made.camera, made.plane
    raw = frame_points(camera.width, camera.height)
    raw = raw[np.isfinite(made.to_metres(raw)).all(axis=1)]
    span = float(np.sqrt(abs(np.linalg.det(made.jacobian([[camera.width / 2, camera.height / 2]])[0]))))
    error = float(np.sqrt(np.mean(made.error(raw, 0.0) ** 2)))
    click.echo(f"Lens: {camera.source}, known to {camera.error_px:.2g} px; focal length {camera.matrix[0, 0]:.0f} px")
    size = f"{made.magnification:.4f}" + (f" +- {made.magnification_error:.1g}" if made.magnification_error else "")
    click.echo(f"In the picture's middle one pixel spans {span * 1e6:.2f} um of the object; magnification {size}")
    if kind is None:
        click.echo("The plane is the scale that was given, seen straight on; nothing in the picture checks it")
    else:
        click.echo(f"{len(plane.points)} {kind} miss the plane by {plane.residual * 1e6:.2f} um rms")
    click.echo(f"Places in the picture are known to {error * 1e6:.2g} um rms; {written}")


def _camera(lens: str, photograph: Path, width: int, height: int, body: str | None, focal: str | None) -> Camera:
    length = None if focal is None else texts.length(focal) * 1e3
    if lens == "none":
        return Camera.ideal(width, height)
    if lens.endswith(".toml"):
        camera = _camera_file(Path(lens))
        if (camera.width, camera.height) != (width, height):
            raise CameraError(
                f"{lens} is for pictures of {camera.width} x {camera.height} px, {photograph} has {width} x {height}; "
                "calibrate with the same settings"
            )
        return camera
    names = _names(photograph, body)
    if lens.endswith(".xml"):
        return lens_profile(names, width, height, focal_mm=length, database=Path(lens))
    return lens_profile(names, width, height, lens=None if lens == "auto" else lens, focal_mm=length)


def _names(photograph: Path, body: str | None) -> Exif:
    try:
        told = read_exif(photograph)
    except CameraError as error:
        if body is None:
            raise CameraError(f"{error}, or use --lens none") from None
        return Exif("", body, "")
    return told if body is None else Exif("", body, told.lens, told.focal_mm)


def _camera_file(path: Path) -> Camera:
    try:
        table = read_toml(path)
    except TomlError as error:
        raise CameraError(f"the camera {path} {error}") from None
    if not isinstance(table.get("camera"), dict):
        raise CameraError(f"{path} holds no camera; make it with python -m measurement calibrate")
    return Camera.from_table(table["camera"])


def _write(path: Path, text: str) -> None:
    """Write all of a file or nothing, whatever happens in between."""
    whole = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        whole.write_text(text, encoding="utf-8")
        whole.replace(path)
    except OSError as error:
        with contextlib.suppress(OSError):
            whole.unlink(missing_ok=True)
        _stop(f"{path} cannot be written: {reason(error)}", status_of(error))


def _stop(sentence: str, status: int) -> NoReturn:
    click.echo(f"Error: {bounded(sentence)}", err=True)
    sys.exit(status)
