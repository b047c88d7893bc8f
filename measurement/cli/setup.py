"""The commands ``calibrate`` and ``setup``: a camera from a chessboard; camera, screen and light of a run."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path
from typing import Any

import click
import numpy as np
import tomli_w
from numpy.typing import NDArray

from measurement import cli as texts
from measurement.camera import Camera, CameraError, Exif, frame_points, lens_profile, read_exif
from measurement.screen import calibration, grid
from measurement.screen.calibration import Calibration
from measurement.screen.grid import GridError
from measurement.screen.setup import PITCH_ERROR, Plane, PlaneError, Setup, SetupError, plane_of_points, plane_of_scale
from softmodels.common import commands, errors, files, processes, tables, units
from softmodels.common.folders import OwnFolderError


@click.command()
@click.argument("photograph", type=click.Path(path_type=Path))
@click.option("--target", type=commands.Choice(["grid", "chessboard", "charuco", "tag"]), default="grid", show_default=True,
              help="Object in the screen's plane; a tag is an AprilTag of the family 36h11.")  # fmt: skip
@click.option("--grid-pitch", default="9mm", show_default=True, metavar="LENGTH",
              help="Distance of the grid's lines, side of a board's square or of a tag; 9mm+-0.01mm gives its error; default "
              "0.2 %.")  # fmt: skip
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
              help="Instead of the grid: a known point, pixel and place (100,200=9mm,18mm); four or more.")  # fmt: skip
@click.option("--scale", metavar="N px/m",
              help="Instead of the grid: pixels per length of a camera that looks straight on; 75px/mm+-1px/mm.")  # fmt: skip
@click.option("--lens", default="auto", show_default=True, metavar="auto|none|NAME|CAMERA.toml|PROFILE.xml",
              help="Lens correction: lensfun's for what EXIF names, none, lensfun's for a name, the file of calibrate, or a "
              "file in lensfun's format.")  # fmt: skip
@click.option("--camera", "body", help="Name of the camera if missing in EXIF, such as 'Canon EOS 550D'.")
@click.option("--focal", metavar="LENGTH", help="Focal length if missing in EXIF, such as 35mm.")
@click.option("--origin", metavar="x,y", help="Pixel near the crossing that becomes X = Z = 0.  [default: the middle]")
@click.option("--lamp-distance", metavar="LENGTH",
              help="From the lamp to the object, if the light is not parallel; 2m+-5cm gives an error.")  # fmt: skip
@click.option("--screen-distance", metavar="LENGTH", help="From the object to the screen; 3cm+-1mm gives an error.")
@click.option("--roi", metavar="x0,y0,x1,y1", help="Region of interest in px; the shadow is searched only there.")
@click.option("--mask", "masks", multiple=True, metavar="x0,y0,x1,y1",
              help="Region in px in which no edge is looked for, such as a label's; may be repeated.")  # fmt: skip
@click.option("--zero", metavar="x,y=x,y", help="Two pixels on the undeformed surface.")
@click.option("-o", "--output", type=click.Path(path_type=Path), default=Path("setup.toml"), show_default=True,
              help="Setup file to write, for photos --setup.")  # fmt: skip
@click.option("--overlay", type=click.Path(path_type=Path),
              help="Picture of the result.  [default: OUTPUT with the ending .png, or -overlay.png where that "
              "is taken]")  # fmt: skip
def setup(photograph: Path, output: Path, overlay: Path | None, **given: Any) -> None:
    """Find the screen's plane in a PHOTOGRAPH.

    Pixels (x, y) count from the upper left; on the screen X counts to the right and Z upwards.

    \b
    Exit status: 0 done; 2 the input cannot be used, as where no grid is found; 1 failed.
    """
    for place in (output, overlay or output):
        texts.check_place(place)
    try:
        _check_given(given)
        shown = _places(photograph, output, overlay, given["lens"])
        picture = calibration.read_picture(photograph)
        pitch, pitch_error = _pitch(given["grid_pitch"])
        camera = lens_camera(photograph, picture.shape[1::-1], given["lens"], given["body"], given["focal"])
        plane = _plane(given, picture, camera, pitch)
        printed = not given["points"] and given["scale"] is None
        made = _setup(given, camera, plane, pitch if printed and given["target"] == "grid" else None)
        made = dataclasses.replace(made, pitch_error=pitch_error if printed else 0.0)
    except GridError as error:
        texts.stop(f"{photograph}: {error}")
    except (CameraError, OwnFolderError, PlaneError, SetupError, units.UnitError) as error:
        texts.stop(str(error))
    try:
        calibration.draw_points(shown, picture, camera, plane)
    except (OSError, ValueError) as error:
        status = commands.status_of(error) if isinstance(error, OSError) else commands.EXIT_BAD_INPUT
        texts.stop(f"the picture of the plane {shown} cannot be written: {errors.reason(error)}", status)
    texts.write_text(output, made.to_toml())
    _report(made, given, f"written to {output} and {shown}")


def _setup(given: dict[str, Any], camera: Camera, plane: Plane, grid_pitch: float | None) -> Setup:
    """Return the setup with what the options say of light, regions and the undeformed surface; the pitch is in m. Raises
    `SetupError` or `UnitError` for a text that is not what it should be."""
    size = texts.magnification(given["lamp_distance"], given["screen_distance"])
    roi = None if given["roi"] is None else texts.numbers(given["roi"], 4, "--roi")
    masks = tuple(texts.numbers(mask, 4, "--mask") for mask in given["masks"])
    made = Setup(camera, plane, *size, roi=roi, masks=masks, grid_pitch=grid_pitch)  # type: ignore[arg-type]
    if given["zero"] is None:
        return made
    ends = [texts.numbers(part, 2, "--zero") for part in given["zero"].split("=")]
    return dataclasses.replace(made, zero=made.to_metres(ends))


def _check_given(given: dict[str, Any]) -> None:
    """Raise `SetupError` for the first option that something else given makes meaningless."""
    source = click.get_current_context().get_parameter_source
    told = {name for name in given if source(name) is click.core.ParameterSource.COMMANDLINE}
    board = ("pattern", "dictionary", "marker_share")
    target, lens = given["target"], given["lens"]
    meaningless: list[tuple[str, tuple[str, ...]]] = []
    if given["points"] or given["scale"] is not None:
        way = "--point" if given["points"] else "--scale"
        meaningless.append((way, ("target", "grid_pitch", *board, *(("origin",) if given["points"] else ()))))
    elif target != "charuco":
        meaningless.append(
            (
                f"--target {target}",
                (*board, *(("origin",) if target == "tag" else ())) if target in ("grid", "tag") else board[1:],
            )
        )
    if lens == "none" or lens.endswith(".toml"):
        meaningless.append((f"--lens {lens}", ("body", "focal")))
    for cause, names in meaningless:
        for name in names:
            if name in told:
                flag = {"body": "camera"}.get(name, name.replace("_", "-"))
                raise SetupError(f"--{flag} has no effect with {cause}; leave one of them out")


def _places(photograph: Path, output: Path, overlay: Path | None, lens: str) -> Path:
    """Return where the overlay goes: beside the setup, under another name where that is the photograph's or somebody
    else's. Raises `OwnFolderError` where either would replace what is not the program's."""
    inputs = (photograph, Path(lens))
    commands.check_output_file(output, inputs, files.has_table("plane"), "the setup", "-o")
    if overlay is None:
        overlay = output.with_suffix(".png")
        if any(files.is_same(overlay, file) for file in inputs) or (overlay.is_file() and not files.is_drawn(overlay)):
            overlay = output.with_name(f"{output.stem}-overlay.png")
    commands.check_output_file(overlay, (*inputs, output), files.is_drawn, "the picture of what was found", "--overlay")
    if overlay == output:
        raise OwnFolderError(f"{output} cannot be both the setup and its picture; give another --overlay")
    return overlay


def _report(made: Setup, given: dict[str, Any], written: str) -> None:
    camera, plane = made.camera, made.plane
    raw = frame_points(camera.width, camera.height)
    raw = raw[np.isfinite(made.to_metres(raw)).all(axis=1)]
    span = float(np.sqrt(abs(np.linalg.det(made.jacobian([[camera.width / 2, camera.height / 2]])[0]))))
    error = float(np.sqrt(np.mean(made.error(raw, 0.0) ** 2)))
    processes.say(f"Lens: {camera.source}, standard error {camera.error_px:.2g} px; focal length {camera.matrix[0, 0]:.0f} px")
    size = f"{made.magnification:.4f}" + (f" +- {made.magnification_error:.1g}" if made.magnification_error else "")
    processes.say(f"In the picture's middle one pixel spans {span * 1e6:.2f} um of the object; magnification {size}")
    if made.pitch_error:
        processes.say(
            f"The pitch, and so all lengths, have an assumed error of {made.pitch_error:.2%}; give another with --grid-pitch"
        )
    if given["scale"] is not None:
        processes.say("The plane follows from the given scale and a perpendicular view; the picture does not verify it")
    else:
        kind = "known points" if given["points"] else "crossings" if given["target"] == "grid" else "corners"
        processes.say(f"{len(plane.points)} {kind}, residual to the plane {plane.residual * 1e6:.2f} um (rms)")
    processes.say(f"Standard error of positions in the picture: {error * 1e6:.2g} um (rms); {written}")


# ----------------------------------------------------------------------------------------------------------------------
# The command ``calibrate``: a camera from photographs of a chessboard.


MIN_BOARD_REACH = 0.9
"""Share of the way to the frame's corners that the boards of a good calibration reach."""


@click.command()
@click.argument("photographs", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--pattern", default="9x6", show_default=True, metavar="NxM",
              help="Inner corners of the board (where four squares meet) in a row and in a column.")  # fmt: skip
@click.option("--pitch", default="25mm", show_default=True, metavar="LENGTH", help="Side of a square.")
@click.option("-o", "--output", type=click.Path(path_type=Path), default=Path("camera.toml"), show_default=True,
              help="Camera file to write, for setup --lens.")  # fmt: skip
@click.option("--quiet", is_flag=True, help="Print only errors.")
def calibrate(photographs: tuple[Path, ...], pattern: str, pitch: str, output: Path, quiet: bool) -> None:
    """Calibrate the camera from PHOTOGRAPHS of a flat chessboard.

    Take about ten photographs with the focus and zoom of the measurement, each with a different tilt of the board,
    which together cover the picture up to its corners. Photographs without the board are skipped and listed.

    \b
    Exit status: 0 done; 3 some photographs refused; 2 the input cannot be used; 1 nothing measured.
    """
    texts.check_place(output)
    try:
        commands.check_output_file(output, photographs,
        lambda file: files.has_table("camera")(file) and not files.has_table("plane")(file),
                          "the camera file", "-o")  # fmt: skip
        board, side = texts.pattern(pattern), texts.length(pitch)
        with texts.bar("looking for boards", calibration.STEPS_PER_PHOTOGRAPH * len(photographs), quiet) as advance:
            made = calibration.calibrate(photographs, board, side, advance)
    except (OwnFolderError, units.UnitError, SetupError) as error:
        texts.stop(str(error))
    except CameraError as error:
        texts.stop(str(error), commands.EXIT_FAILED)
    table = tomli_w.dumps({"camera": made.camera.as_table()})
    texts.write_text(output, f"# A camera; made by softmodels measure calibrate.\n{table}")
    for path, why in made.refused.items():
        processes.say(f"{path}: refused, {why}", err=True)
    if not quiet:
        _report_camera(made, output)
    sys.exit(texts.EXIT_SOME_REJECTED if made.refused else commands.EXIT_DONE)


def _report_camera(made: Calibration, output: Path) -> None:
    camera = made.camera
    for path, rms in made.per_image.items():
        processes.say(f"{path}: {rms:.2f} px")
    processes.say(
        f"Focal length fx {camera.matrix[0, 0]:.1f} px, principal point {camera.matrix[0, 2]:.1f}, {camera.matrix[1, 2]:.1f} "
        f"px; {len(made.per_image)} photographs used, reprojection error {made.residual_px:.2f} px (rms)"
    )
    processes.say(
        f"Standard error of the lens: {camera.error_px:.2g} px in the region of the boards, {camera.errors_px[-1]:.2g} "
        f"px in the picture's corners; written to {output}"
    )
    if made.coverage < MIN_BOARD_REACH:
        processes.say(
            f"Boards cover {made.coverage:.0%} of the distance from the middle to the corners; add photographs "
            f"with the board near the corners",
            err=True,
        )


# ----------------------------------------------------------------------------------------------------------------------
# The command ``setup``: camera, screen and light from one photograph of the grid, of a board, or of known points.
#
# The camera that the options ``--lens``, ``--camera`` and ``--focal`` of the setup command mean.


def lens_camera(photograph: Path, size: tuple[int, int], lens: str, body: str | None, focal: str | None) -> Camera:
    """Return the camera of a photograph of a size (width, height) in px by the texts of ``--lens``, ``--camera`` and
    ``--focal``; `CameraError` or `UnitError` if there is none such."""
    length = None if focal is None else texts.length(focal) * 1e3
    if lens == "none":
        return Camera.ideal(*size)
    if lens.endswith(".toml"):
        camera = _camera_file(Path(lens))
        if camera.size != size:
            raise CameraError(
                f"{lens} is for pictures of {camera.width} x {camera.height} px, {photograph} has {size[0]} x {size[1]}; "
                "calibrate with the same settings"
            )
        return camera
    try:
        names = read_exif(photograph)
    except CameraError as error:
        if body is None:
            raise CameraError(f"{error}, or use --lens none") from None
        names = Exif("", body, "")
    if body is not None:
        names = dataclasses.replace(names, maker="", camera=body)
    if lens.endswith(".xml"):
        return lens_profile(names, *size, focal_mm=length, database=Path(lens))
    return lens_profile(names, *size, lens=None if lens == "auto" else lens, focal_mm=length)


def _camera_file(path: Path) -> Camera:
    try:
        table = tables.read_toml(path)
    except tables.TomlError as error:
        raise CameraError(f"the camera {path} {error}") from None
    if not isinstance(table.get("camera"), dict):
        raise CameraError(f"{path} contains no camera; create it with softmodels measure calibrate")
    return Camera.from_table(table["camera"])


# ----------------------------------------------------------------------------------------------------------------------
# The screen's plane as the options of the setup command ask for it: by the grid, a board, known points or a scale.


MAX_PITCH = 0.5
"""Largest pitch in m of a printed grid or board; beyond it somebody wrote m for mm."""


def _pitch(text: str) -> tuple[float, float]:
    """Return the pitch in m and its standard error as a share of it, `PITCH_ERROR` where none is given."""
    pitch, error = texts.with_error(text, texts.length)
    if not pitch > 0.0:
        raise SetupError(f"--grid-pitch must be a positive length, not {text}")
    if pitch > MAX_PITCH:
        raise SetupError(f"--grid-pitch {text} is not a plausible grid pitch; write mm for millimetres")
    if not 0.0 <= error < pitch:
        raise SetupError(f"the error in --grid-pitch {text} must not be negative, and below the pitch")
    return pitch, error / pitch if "+-" in text.replace("±", "+-") else PITCH_ERROR


def _plane(given: dict[str, Any], picture: NDArray[np.uint8], camera: Camera, pitch: float) -> Plane:
    """Return the plane in a photograph (h, w, 3) that the options ask for; errors of grids, planes, setups and units."""
    place = None if given["origin"] is None else texts.numbers(given["origin"], 2, "--origin")
    origin = (place[0], place[1]) if place else None
    if given["scale"] is not None:
        if given["points"]:
            raise SetupError("give --point or --scale, not both")
        return plane_of_scale(camera, *texts.with_error(given["scale"], texts.per_metre), origin)
    if given["points"]:
        px, metres = zip(*map(texts.known_point, given["points"]), strict=True)
        return plane_of_points(camera, np.array(px), np.array(metres))
    if given["target"] == "grid":
        return grid.find_grid(picture, camera, pitch, origin).plane(camera)
    if given["target"] == "tag":
        return calibration.tag_plane(picture, camera, pitch)
    columns, rows = texts.pattern(given["pattern"])
    if given["target"] == "chessboard":
        board = calibration.find_chessboard(picture, (columns, rows), camera)
    else:
        squares = (columns + 1, rows + 1)
        board = calibration.find_charuco(picture, squares, units.number(given["marker_share"]), given["dictionary"], camera)
    return grid.counted_from(board, camera, pitch, origin).plane(camera)
