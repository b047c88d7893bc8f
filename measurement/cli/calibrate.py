"""The command ``calibrate``: a camera from photographs of a chessboard."""

from __future__ import annotations

import sys
from pathlib import Path

import click
import tomli_w

from measurement.camera.camera import CameraError
from measurement.cli import shared as texts
from measurement.cli.shared import DONE, SOME_REFUSED, bar, check_place, stop, write_text
from measurement.screen.calibration import STEPS, Calibration, calibrate as calibrated
from measurement.screen.setup import SetupError
from softmodels.common.commands import FAILED
from softmodels.common.folders import OwnFolderError, check_output_file, has_table
from softmodels.common.processes import say
from softmodels.common.units import UnitError

REACHED = 0.9
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
    check_place(output)
    try:
        check_output_file(output, photographs, lambda file: has_table("camera")(file) and not has_table("plane")(file),
                          "the camera file", "-o")  # fmt: skip
        board, side = texts.pattern(pattern), texts.length(pitch)
        with bar("looking for boards", STEPS * len(photographs), quiet) as advance:
            made = calibrated(photographs, board, side, advance)
    except (OwnFolderError, UnitError, SetupError) as error:
        stop(str(error))
    except CameraError as error:
        stop(str(error), FAILED)
    table = tomli_w.dumps({"camera": made.camera.as_table()})
    write_text(output, f"# A camera; made by python -m measurement calibrate.\n{table}")
    for path, why in made.refused.items():
        say(f"{path}: refused, {why}", err=True)
    if not quiet:
        _report(made, output)
    sys.exit(SOME_REFUSED if made.refused else DONE)


def _report(made: Calibration, output: Path) -> None:
    camera = made.camera
    for path, rms in made.per_image.items():
        say(f"{path}: {rms:.2f} px")
    say(
        f"Focal length fx {camera.matrix[0, 0]:.1f} px, principal point {camera.matrix[0, 2]:.1f}, "
        f"{camera.matrix[1, 2]:.1f} px; {len(made.per_image)} photographs used, reprojection "
        f"error {made.residual_px:.2f} px (rms)"
    )
    say(
        f"Standard error of the lens: {camera.error_px:.2g} px in the region of the boards, {camera.errors_px[-1]:.2g} "
        f"px in the picture's corners; written to {output}"
    )
    if made.coverage < REACHED:
        say(
            f"Boards cover {made.coverage:.0%} of the distance from the middle to the corners; add photographs "
            f"with the board near the corners",
            err=True,
        )
