"""A camera calibrated from photographs of a chessboard (Zhang 2000, doi 10.1109/34.888718; the solver is OpenCV's)."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from measurement.boards import find_chessboard
from measurement.camera import Camera, CameraError, Points, beyond_projection
from measurement.grid import GridError

FEWEST = 3
"""Views of the board that fix the camera's matrix and its lens."""

WORST = 1.0
"""Largest root mean square distance in px between corners found and corners predicted."""

UNKNOWN = 0.5
"""Standard error in px of the lens where three photographs leave none to spare for an estimate."""


@dataclasses.dataclass(frozen=True, eq=False)
class Calibration:
    """A calibrated camera and what it rests on.

    Attributes:
        camera: The camera; its ``error_px`` is the jackknife's over the photographs.
        residual_px: Root mean square distance in px of the corners from where the camera sees them.
        per_image: The same for each used photograph, by path.
        refused: Why other photographs were not used, by path.
    """

    camera: Camera
    residual_px: float
    per_image: dict[str, float]
    refused: dict[str, str]


def calibrate(paths: Sequence[Path | str], pattern: tuple[int, int] = (9, 6), pitch: float = 0.025) -> Calibration:
    """Calibrate a camera from at least three photographs of a chessboard, held at different angles.

    Args:
        paths: The photographs; those without the board are refused by name and the rest is used.
        pattern: Inner corners of the board in a row and in a column.
        pitch: Side of a square in m.

    Raises:
        CameraError: Too few usable photographs, or corners that fit no camera.
    """
    corners: dict[str, Points] = {}
    refused: dict[str, str] = {}
    size: tuple[int, int] | None = None
    for path in map(str, paths):
        image = cv2.imread(path, cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION)
        if image is None:
            refused[path] = "it cannot be read as a picture"
            continue
        shape = (image.shape[1], image.shape[0])
        if size is not None and shape != size:
            refused[path] = f"it has {shape[0]} x {shape[1]} pixels, the others {size[0]} x {size[1]}"
            continue
        try:
            found = find_chessboard(image, pattern)
        except GridError as error:
            refused[path] = str(error)
            continue
        size, corners[path] = shape, found.px
    if len(corners) < FEWEST or size is None:
        reasons = "; ".join(f"{path}: {reason}" for path, reason in refused.items())
        raise CameraError(
            f"a calibration needs {FEWEST} or more photographs of the board, not {len(corners)} ({reasons})"
        )
    views = list(corners.values())
    residual, matrix, distortion, each = _solve(views, pattern, pitch, size)
    if not residual < WORST:
        raise CameraError(
            f"the boards' corners miss the best camera by {residual:.2g} px; check the pattern and that the boards are flat"
        )
    camera = Camera(matrix, distortion, *size, f"{len(views)} chessboards", 0.0)
    spread = _jackknife(views, pattern, pitch, size, camera)
    return Calibration(
        camera=dataclasses.replace(camera, error_px=spread),
        residual_px=residual,
        per_image=dict(zip(corners, map(float, each), strict=True)),
        refused=refused,
    )


def _solve(
    views: list[Points], pattern: tuple[int, int], pitch: float, size: tuple[int, int]
) -> tuple[float, Points, Points, Points]:
    columns, rows = np.meshgrid(np.arange(pattern[0]), np.arange(pattern[1]))
    board = np.column_stack([columns.ravel(), rows.ravel(), np.zeros(columns.size)]).astype(np.float32)
    residual, matrix, distortion, _, _, _, _, each = cv2.calibrateCameraExtended(
        [board * np.float32(pitch)] * len(views),
        [view.astype(np.float32).reshape(-1, 1, 2) for view in views],
        size,
        np.eye(3),
        np.zeros(5),
        # Pixels of photographic sensors are square; one focal length is better known than two.
        flags=cv2.CALIB_FIX_ASPECT_RATIO,
    )
    return float(residual), matrix, distortion.ravel()[:5], np.ravel(each)


def _jackknife(
    views: list[Points], pattern: tuple[int, int], pitch: float, size: tuple[int, int], camera: Camera
) -> float:
    """Standard error in px of an undistorted point where boards were seen, by leaving out one photograph at a time.

    Corners in one photograph share their board's bends and blur, which the solver's own standard errors do not know.
    """
    if len(views) <= FEWEST:
        return UNKNOWN
    seen = np.vstack(views)
    whole = camera.undistort(seen)
    moved = []
    for left_out in range(len(views)):
        _, matrix, distortion, _ = _solve(views[:left_out] + views[left_out + 1 :], pattern, pitch, size)
        other = dataclasses.replace(camera, matrix=matrix, distortion=distortion).undistort(seen)
        moved.append(beyond_projection(other, whole))
    count = len(views)
    variance = (count - 1) / count * np.sum(np.square(moved), axis=0)
    return float(np.sqrt(np.mean(variance)))
