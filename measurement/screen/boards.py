"""Chessboards and ChArUco boards as known points, found by OpenCV."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from measurement.camera.camera import Camera
from measurement.camera.corners import straightened_corners
from measurement.screen.grid import GridPoints, checked, gray_bytes
from measurement.screen.grid_error import FEWEST, GridError
from measurement.screen.plane import Plane, PlaneError

CORNER_ERROR = 0.1
"""Standard error in px of a corner of a sharp board, for boards without enough corners to tell."""

REACH = 0.4
"""Half width of the window that fixes a corner, as a share of the way to the closest one: wider ones see its edges too."""

SEARCHED = (900, 1800)
"""Longer sides in px of the reduced pictures that a board is searched in, before the whole one."""
LEAST_REDUCTION = 1.5
"""Factor below which a reduced picture is not searched."""
ENOUGH = 4
"""Half width in px of a corner's window in a reduced picture from which its corners are taken."""


def find_chessboard(image: ArrayLike, pattern: tuple[int, int] = (9, 6), camera: Camera | None = None) -> GridPoints:
    """Find the inner corners of a chessboard.

    Args:
        image: Photograph (h, w) or (h, w, 3).
        pattern: Inner corners in a row and in a column.
        camera: The camera, whose lens is taken out before the residual is judged; without it the residual is not.

    Returns:
        Corners in rows from the board's first corner; the second index counts down the board.

    Raises:
        GridError: No such board in the picture.
    """
    columns, rows = pattern
    gray = gray_bytes(image)
    if min(pattern) < 3:
        raise GridError(f"a chessboard of {columns} x {rows} inner corners is too small; give at least 3 x 3")
    corners = _searched(gray, pattern)
    if corners is None:
        raise GridError(
            f"no chessboard with {columns} x {rows} inner corners was found; check the pattern and the picture"
        )
    reach = corner_reach(corners)
    stop = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-5)
    corners = cv2.cornerSubPix(gray, corners.astype(np.float32).reshape(-1, 1, 2), (reach, reach), (-1, -1), stop)
    across, down = np.meshgrid(np.arange(columns), np.arange(rows))
    indices = np.column_stack([across.ravel(), down.ravel()])
    px = corners.reshape(-1, 2).astype(float)
    return _points(px if camera is None else straightened_corners(gray, px, camera, reach), indices, camera)


def _searched(gray: NDArray[np.uint8], pattern: tuple[int, int]) -> NDArray[np.float64] | None:
    """Corners (n, 2) of the board in px, right to about a pixel; None if it is not there.

    The search begins with reduced pictures: its time grows faster than their pixels.
    """
    longest = max(gray.shape)
    for side in (*SEARCHED, longest):
        if side < longest / LEAST_REDUCTION or side == longest:
            scale = longest / side
            size = (round(gray.shape[1] / scale), round(gray.shape[0] / scale))
            small = gray if side == longest else cv2.resize(gray, size, interpolation=cv2.INTER_AREA)
            found, corners = cv2.findChessboardCornersSB(
                small, pattern, flags=cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_NORMALIZE_IMAGE
            )
            if found and (small is gray or corner_reach(corners.reshape(-1, 2)) >= ENOUGH):
                scales = np.array(gray.shape[::-1]) / small.shape[::-1]
                return np.asarray((corners.reshape(-1, 2).astype(float) + 0.5) * scales - 0.5)
    known = cv2.CALIB_CB_ADAPTIVE_THRESH + cv2.CALIB_CB_NORMALIZE_IMAGE + cv2.CALIB_CB_FAST_CHECK
    found, corners = cv2.findChessboardCorners(gray, pattern, flags=known)
    return corners.reshape(-1, 2).astype(float) if found else None


def find_charuco(
    image: ArrayLike, squares: tuple[int, int], marker_share: float = 0.75, dictionary: str = "DICT_4X4_50",
    camera: Camera | None = None,
) -> GridPoints:  # fmt: skip
    """Find the inner corners of a ChArUco board, of which a part may be covered.

    Args:
        image: Photograph (h, w) or (h, w, 3).
        squares: Squares in a row and in a column.
        marker_share: Side of a marker as a share of a square's side.
        dictionary: Name of OpenCV's predefined dictionary.
        camera: As in `find_chessboard`.

    Raises:
        GridError: Unknown dictionary, or too few corners of this board in the picture.
    """
    try:
        markers = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
        board = cv2.aruco.CharucoBoard(squares, 1.0, marker_share, markers)
    except (AttributeError, cv2.error):
        raise GridError(f"no ChArUco board of {squares} squares with the dictionary {dictionary} exists") from None
    corners, names, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(gray_bytes(image))
    if corners is None or names is None or len(names) < FEWEST:
        count = 0 if names is None else len(names)
        raise GridError(f"{count} corners of the ChArUco board were found; at least {FEWEST} are needed")
    flat = np.ravel(names)
    indices = np.column_stack([flat % (squares[0] - 1), flat // (squares[0] - 1)])
    return _points(corners.reshape(-1, 2).astype(float), indices, camera)


def corner_reach(corners: NDArray[np.float64]) -> int:
    """Half width in px of the window in which a corner of the board at these places (n, 2) is measured."""
    gaps = np.linalg.norm(corners[:, None] - corners[None], axis=2)
    return max(2, int(REACH * float(np.min(gaps[gaps > 0.0]))))


def _points(px: NDArray[np.float64], indices: NDArray[np.int64], camera: Camera | None) -> GridPoints:
    if camera is None:
        return GridPoints(px, indices, np.full(len(px), CORNER_ERROR), float("nan"))
    try:
        plane = Plane.fit(camera.undistort(px), indices.astype(float))
    except PlaneError as error:
        raise GridError(f"the board's corners fix no plane: {error}") from None
    return checked(px, indices, np.full(len(px), CORNER_ERROR), plane)
