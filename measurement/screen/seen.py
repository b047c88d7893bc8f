"""A setup from a photograph of the screen's grid, as one call."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from numpy.typing import ArrayLike

from measurement.camera.camera import Camera
from measurement.screen.grid import find_grid
from measurement.screen.overlay import read_picture
from measurement.screen.setup import PITCH_ERROR, Setup


def setup_from_grid(
    photograph: str | Path,
    pitch: float = 9e-3,
    camera: Camera | None = None,
    magnification: tuple[float, float] = (1.0, 0.0),
    zero: ArrayLike | None = None,
    pitch_error: float = PITCH_ERROR,
) -> Setup:
    """Find the screen's plane in a photograph of its grid.

    Args:
        photograph: The picture.
        pitch: Distance of the grid's lines in m.
        camera: Its lens, as `measurement.calibrate` and `measurement.camera.lens.lens_profile` give it; None for one without
            distortion.
        magnification: The shadow's, and its standard error; see `measurement.screen.setup.magnification`.
        zero: Two pixels (2, 2) on the undeformed surface; None where a photograph at zero pressure shows it.
        pitch_error: Standard error of the pitch, as a share of it.

    Raises:
        GridError: No grid is found.
        CameraError: The picture cannot be read, or is of another size than the camera's.
        SetupError, PlaneError: What was found cannot be used.
    """
    picture = read_picture(Path(photograph))
    height, width = picture.shape[:2]
    seen = camera or Camera.ideal(width, height)
    grid = find_grid(picture, seen, pitch)
    made = Setup(seen, grid.plane(seen), *magnification, grid_pitch=pitch, pitch_error=pitch_error)
    return made if zero is None else dataclasses.replace(made, zero=made.to_metres(zero))
