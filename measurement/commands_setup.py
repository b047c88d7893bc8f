"""The commands ``calibrate`` and ``setup``: a camera from chessboards, a setup from a photograph of the grid."""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path
from typing import Any, NoReturn

import click
import numpy as np
import tomli_w

from measurement.calibration import calibrate as calibrated
from measurement.camera import Camera, CameraError
from measurement.grid import GridError, GridPoints, find_grid
from measurement.lens import Exif, lens_profile, read_exif
from measurement.overlay import draw_points, read_picture
from measurement.plane import Plane, PlaneError
from measurement.setup import Setup, SetupError, magnification
from measurement.units import UnitError, quantity

UNUSABLE, UNMEASURED = 2, 1
"""Exit statuses: the input cannot be used; it can, but nothing could be measured in it."""


@click.command()
@click.argument("photographs", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--pattern", default="9x6", show_default=True, help="Inner corners of the board in a row and a column.")
@click.option("--pitch", default="25mm", show_default=True, help="Side of a square.")
@click.option("-o", "--output", type=click.Path(path_type=Path), default=Path("camera.toml"), show_default=True)
def calibrate(photographs: tuple[Path, ...], pattern: str, pitch: str, output: Path) -> None:
    """Calibrate the camera from PHOTOGRAPHS of a chessboard."""
    try:
        made = calibrated(photographs, _pattern(pattern), _length(pitch))
    except (UnitError, SetupError) as error:
        _stop(str(error), UNUSABLE)
    except CameraError as error:
        _stop(str(error), UNMEASURED)
    camera = made.camera
    _write(
        output, "# A camera; made by python -m measurement calibrate.\n" + tomli_w.dumps({"camera": camera.as_table()})
    )
    for path, rms in made.per_image.items():
        click.echo(f"{path}: {rms:.2f} px")
    for path, reason in made.refused.items():
        click.echo(f"{path}: refused, {reason}", err=True)
    click.echo(
        f"Focal length {camera.matrix[0, 0]:.1f} px, middle {camera.matrix[0, 2]:.1f}, {camera.matrix[1, 2]:.1f} px; "
        f"corners miss by {made.residual_px:.2f} px rms; the lens is known to {camera.error_px:.2g} px; written to {output}"
    )
    sys.exit(UNMEASURED if made.refused else 0)


@click.command()
@click.argument("photograph", type=click.Path(path_type=Path))
@click.option("--grid-pitch", default="9mm", show_default=True, help="Distance of the grid's lines.")
@click.option("--lens", default="auto", show_default=True, metavar="auto|none|NAME|CAMERA.toml|PROFILE.xml",
              help="Lens: from EXIF, not corrected, by name, calibrated, or from a lensfun file.")  # fmt: skip
@click.option("--camera", "body", help="Name of the camera where EXIF does not tell it, such as 'Canon EOS 550D'.")
@click.option("--focal", help="Focal length where EXIF does not tell it, such as 35mm.")
@click.option("--point", "points", multiple=True, metavar="x,y=X,Z",
              help="A known point: pixel and place with unit (100,200=9mm,18mm); several, in place of the grid.")  # fmt: skip
@click.option("--origin", metavar="x,y", help="Pixel near the crossing that becomes X = Z = 0.  [default: the middle]")
@click.option(
    "--lamp-distance", help="From the lamp to the object, if the light is not parallel; 2m+-5cm gives an error."
)
@click.option("--screen-distance", help="From the object to the screen; 3cm+-1mm gives an error.")
@click.option("--roi", metavar="x0,y0,x1,y1", help="Region of interest in px.")
@click.option("--zero", metavar="x,y=x,y", help="Two pixels on the undeformed surface.")
@click.option("-o", "--output", type=click.Path(path_type=Path), default=Path("setup.toml"), show_default=True)
@click.option("--overlay", type=click.Path(path_type=Path), help="Picture of the grid found.  [default: OUTPUT.png]")
def setup(photograph: Path, output: Path, overlay: Path | None, **given: Any) -> None:
    """Find the screen's plane in the PHOTOGRAPH of the grid (or of known points)."""
    try:
        picture = read_picture(photograph)
        height, width = picture.shape[:2]
        camera = _camera(given["lens"], photograph, width, height, given["body"], given["focal"])
        pitch = _length(given["grid_pitch"])
        size = _magnification(given["lamp_distance"], given["screen_distance"])
        grid: GridPoints | None = None
        if given["points"]:
            pairs = [_known_point(text) for text in given["points"]]
            plane = Plane.fit(camera.undistort([px for px, _ in pairs]), [metres for _, metres in pairs])
        else:
            origin = None if given["origin"] is None else _numbers(given["origin"], 2, "--origin")
            grid = find_grid(picture, camera, pitch, (origin[0], origin[1]) if origin else None)
            plane = grid.plane(camera)
        roi = None if given["roi"] is None else _numbers(given["roi"], 4, "--roi")
        made = Setup(camera, plane, *size, roi=roi, grid_pitch=None if grid is None else pitch)  # type: ignore[arg-type]
        if given["zero"] is not None:
            ends = [_numbers(part, 2, "--zero") for part in given["zero"].split("=")]
            made = Setup(camera, plane, *size, zero=made.to_metres(ends), roi=made.roi, grid_pitch=made.grid_pitch)
    except GridError as error:
        _stop(f"{photograph}: {error}", UNMEASURED)
    except (CameraError, PlaneError, SetupError, UnitError) as error:
        _stop(str(error), UNUSABLE)
    _write(output, made.to_toml())
    shown = overlay if overlay is not None else output.with_suffix(".png")
    try:
        draw_points(shown, picture, camera, plane)
    except (OSError, ValueError) as error:
        _stop(f"the picture of the grid cannot be written: {error}", UNUSABLE)
    _report(made, grid, output, shown)


def _report(made: Setup, grid: GridPoints | None, output: Path, shown: Path) -> None:
    camera, plane = made.camera, made.plane
    middle = plane.points.mean(axis=0)
    span = float(np.sqrt(abs(np.linalg.det(plane.jacobian(middle)[0]))))
    click.echo(f"Lens: {camera.source}, known to {camera.error_px:.2g} px; focal length {camera.matrix[0, 0]:.0f} px")
    click.echo(f"One pixel spans {span * 1e6:.2f} um; magnification {made.magnification:.4f}")
    count = f"{len(plane.points)} {'known points' if grid is None else 'crossings'}"
    click.echo(
        f"{count} miss the plane by {plane.residual * 1e6:.2f} um rms; the plane is known to "
        f"{float(plane.error(middle)[0]) * 1e6:.2f} um in their middle; written to {output} and {shown}"
    )


def _camera(lens: str, photograph: Path, width: int, height: int, body: str | None, focal: str | None) -> Camera:
    length = None if focal is None else _length(focal) * 1e3
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
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise CameraError(f"the camera {path} cannot be read: {error}") from None
    if not isinstance(table.get("camera"), dict):
        raise CameraError(f"{path} holds no camera; make it with python -m measurement calibrate")
    return Camera.from_table(table["camera"])


def _magnification(lamp: str | None, screen: str | None) -> tuple[float, float]:
    if lamp is None and screen is None:
        return 1.0, 0.0
    if lamp is None or screen is None:
        raise SetupError("give both --lamp-distance and --screen-distance, or none of them")
    (far, far_error), (near, near_error) = (_with_error(text) for text in (lamp, screen))
    return magnification(far, near, far_error, near_error)


def _with_error(text: str) -> tuple[float, float]:
    value, _, error = text.replace("±", "+-").partition("+-")
    return _length(value), _length(error) if error else 0.0


def _known_point(text: str) -> tuple[tuple[float, ...], tuple[float, ...]]:
    pixel, _, place = text.partition("=")
    parts = place.split(",")
    if len(parts) != 2:
        raise SetupError(f"{text!r} is no known point; write it like 100,200=9mm,18mm")
    return _numbers(pixel, 2, "--point"), tuple(_length(part) for part in parts)


def _numbers(text: str, count: int, option: str) -> tuple[float, ...]:
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    if len(values) != count or not all(abs(value) < 1e9 for value in values):
        raise SetupError(f"{option} needs {count} numbers between commas, not {text!r}")
    return values


def _pattern(text: str) -> tuple[int, int]:
    found = re.fullmatch(r"(\d+)x(\d+)", text.strip())
    if not found:
        raise SetupError(f"{text!r} is no pattern; write the inner corners like 9x6")
    return int(found[1]), int(found[2])


def _length(text: str) -> float:
    return quantity(text, "m")


def _write(path: Path, text: str) -> None:
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        _stop(f"{path} cannot be written: {error}", UNUSABLE)


def _stop(sentence: str, status: int) -> NoReturn:
    click.echo(f"Error: {sentence}", err=True)
    sys.exit(status)
