"""A setup from a photograph of the screen's grid, as one call."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from measurement.camera.camera import Camera, CameraError, Points
from measurement.camera.pictures import PictureError, read_pixels
from measurement.screen.grid import find_grid
from measurement.screen.plane import Plane
from measurement.screen.setup import PITCH_ERROR, Setup
from softmodels.common.files import replaced_whole
from softmodels.common.folders import MARK

# ----------------------------------------------------------------------------------------------------------------------
# A photograph with the grid drawn over it as the setup sees it.


LONGEST = 2000
"""Pixels of the drawn picture's longer side."""

LINE, POINT = (220, 40, 40), (20, 90, 230)


def read_picture(path: Path | str) -> NDArray[np.uint8]:
    """Return a photograph (h, w, 3), red, green, blue, in the sensor's own orientation.

    Raises:
        CameraError: The file is not there or no picture.
    """
    try:
        return read_pixels(Path(path))
    except PictureError as error:
        raise CameraError(f"{path} cannot be read as a photograph: {error}") from None


def draw_points(path: Path, picture: NDArray[np.uint8], camera: Camera, plane: Plane) -> None:
    """Write the photograph with the known points and the lines of the plane through them.

    Args:
        path: Picture to write.
        picture: Photograph (h, w, 3).
        camera: Its camera.
        plane: The screen.
    """
    scale = min(1.0, LONGEST / max(picture.shape[:2]))
    canvas = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    thick = max(1, round(max(canvas.shape) / 1000))

    def placed(raw: Points) -> NDArray[np.int32]:
        # Sixteenths of a pixel keep thin lines where they belong.
        return np.rint(((raw + 0.5) * scale - 0.5) * 16).astype(np.int32)

    for axis in (0, 1):
        for value in np.unique(plane.targets[:, axis]):
            on = plane.targets[plane.targets[:, axis] == value]
            other = np.linspace(on[:, 1 - axis].min(), on[:, 1 - axis].max(), 60)
            line = np.empty((60, 2))
            line[:, axis], line[:, 1 - axis] = value, other
            shown = placed(camera.distort(plane.to_pixels(line)))
            cv2.polylines(canvas, [shown], False, LINE, thick, cv2.LINE_AA, shift=4)
    for (x, y), target in zip(placed(camera.distort(plane.points)), plane.targets, strict=True):
        radius = 5 * thick * (2 if np.allclose(target, 0.0) else 1)  # the origin is the large one
        cv2.circle(canvas, (int(x), int(y)), radius * 16, POINT, thick, cv2.LINE_AA, shift=4)
    texts = PngInfo()
    texts.add_text("Software", MARK)  # by which a later setup knows that it may replace the picture
    more: dict[str, Any] = {"pnginfo": texts} if path.suffix.lower() == ".png" else {}
    with replaced_whole(path) as aside:
        Image.fromarray(canvas).save(aside, **more)


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
