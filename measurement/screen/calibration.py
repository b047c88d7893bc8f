"""A camera calibrated from photographs of a chessboard (Zhang 2000, doi 10.1109/34.888718; the solver is OpenCV's).

The corners are measured again in the lens that they gave (`calibration.corners`), until both agree.
"""

from __future__ import annotations

import dataclasses
import hashlib
import itertools
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.polynomial.polynomial import polyvander, polyvander2d
from numpy.typing import ArrayLike, NDArray
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from measurement import film, pictures
from measurement.camera import Camera, CameraError, Points
from measurement.screen import setup
from measurement.screen.grid import MIN_LINES, GridError, GridPoints, checked, find_grid, gray_bytes
from measurement.screen.setup import Setup
from softmodels.common import files, processes


@dataclasses.dataclass(frozen=True, eq=False)
class Calibration:
    """A calibrated camera and what it rests on.

    Attributes:
        camera: Its errors come from the covariance of the fit or from leaving out one photograph at a time, whichever are
            larger.
        residual_px: Root mean square distance in px of the corners from where the camera sees them.
        per_image: The same for each used photograph, by path.
        coverage: How far the boards' corners reach from the frame's middle towards its corners, from 0 to 1.
        refused: Why other photographs were not used, by path.
    """

    camera: Camera
    residual_px: float
    per_image: dict[str, float]
    coverage: float
    refused: dict[str, str]


MIN_VIEWS = 3
"""Views of the board that fix the camera's matrix and its lens."""

MAX_REPROJECTION_ERROR = 1.0
"""Largest root mean square distance in px between corners found and corners predicted."""

MIN_LENS_ERROR = 0.5
"""Least standard error in px of the lens from three photographs, of which none can be spared to see what it changes."""

REMEASURING_ROUNDS = 2
"""Times that corners are measured again in the lens found: the second moves them by less than a thousandth of a pixel."""

STEPS_PER_PHOTOGRAPH = 1 + REMEASURING_ROUNDS
"""Steps of a calibration for each photograph: the search of its board, and its corners measured again."""

LENS_COEFFICIENTS = 5
"""Coefficients of the lens: k1, k2, p1, p2, k3 in OpenCV's order."""

MIN_K3_ERRORS = 2.0
"""Standard errors by which k3 must differ from 0 to be used: one that is not seen only bends what lies beyond the boards."""

ERROR_RINGS = 11
"""Distances from the frame's middle at which the lens' error is stated."""


def calibrate(
    paths: Sequence[Path | str],
    pattern: tuple[int, int] = (9, 6),
    pitch: float = 0.025,
    each: Callable[[], object] = lambda: None,
) -> Calibration:
    """Calibrate a camera from at least three photographs of a chessboard, held at different angles.

    Args:
        paths: The photographs; those without the board are refused by name and the rest is used.
        pattern: Inner corners of the board in a row and in a column.
        pitch: Side of a square in m.
        each: Called at each of the `STEPS_PER_PHOTOGRAPH` for every photograph, to show how far it is.

    Raises:
        CameraError: Too few usable photographs, or corners that fit no camera.
    """
    views, refused = seen_boards(map(str, paths), pattern, each)
    if len(views) < MIN_VIEWS:
        reasons = "; ".join(f"{path}: {reason}" for path, reason in refused.items())
        raise CameraError(
            f"a calibration needs {MIN_VIEWS} or more usable photographs of the board, but has {len(views)} ({reasons})"
        )
    board, size = _board(pattern, pitch), views[0].size
    corners = [view.corners for view in views]
    solution = _solve(corners, board, size)
    if not solution.residual < MAX_REPROJECTION_ERROR:
        raise CameraError(
            f"the reprojection error of the best camera is {solution.residual:.2g} px; check the pattern and that the boards "
            "are flat"
        )
    for _ in range(REMEASURING_ROUNDS):
        grays, camera = [view.gray for view in views], itertools.repeat(solution.camera(size, ""))
        with ThreadPoolExecutor(processes.cores()) as pool:
            straight = pool.map(straightened_corners, grays, corners, camera, map(corner_reach, corners))
            corners = [(each(), photo_corners)[1] for photo_corners in straight]
        solution = _solve(corners, board, size)
    return Calibration(
        camera=calibrated_from(corners, board, size),
        residual_px=solution.residual,
        per_image=dict(zip((view.path for view in views), map(float, solution.each), strict=True)),
        coverage=float(reached(corners, size).max()),
        refused=refused,
    )


def calibrated_from(views: list[Points], board: Points, size: tuple[int, int]) -> Camera:
    """Return the camera and its errors from a board's corners: (n, 2) in px of each of three photographs or more of one
    size (width, height), and (n, 3) on the board in m, the last coordinate 0."""
    solution = _solve(views, board, size)
    covariance = _covariance(solution, views, board)
    use_k3 = bool(abs(solution.distortion[4]) > MIN_K3_ERRORS * np.sqrt(covariance[-1, -1]))
    # A k3 that is left out may yet be there, so that it stays in the error.
    camera = (solution if use_k3 else _solve(views, board, size, use_k3)).camera(size, f"{len(views)} chessboards")
    far = reached(views, size)
    errors = _errors(camera, covariance, views, board, use_k3, float(far.max()))
    known = float(np.sqrt(np.mean(np.interp(far, np.linspace(0.0, 1.0, ERROR_RINGS), errors) ** 2)))
    return dataclasses.replace(camera, error_px=known, errors_px=errors)


def reached(views: list[Points], size: tuple[int, int]) -> Points:
    """Return the distances (n,) of all corners from the frame's middle, as shares of the way to its corners."""
    middle = (np.array(size) - 1.0) / 2.0
    return np.asarray(np.linalg.norm(np.vstack(views) - middle, axis=1) / np.linalg.norm(middle))


@dataclasses.dataclass(frozen=True, eq=False)
class _Solution:
    """Return OpenCV's results: residual (px), matrix (3, 3), coefficients (5,), poses (n, 3) each, residuals (n,)."""

    residual: float
    matrix: Points
    distortion: Points
    turns: list[Points]
    shifts: list[Points]
    each: Points

    def camera(self, size: tuple[int, int], source: str) -> Camera:
        return Camera(self.matrix, self.distortion, *size, source, 0.0)


def _board(pattern: tuple[int, int], pitch: float) -> Points:
    columns, rows = np.meshgrid(np.arange(pattern[0]), np.arange(pattern[1]))
    return np.asarray(np.column_stack([columns.ravel(), rows.ravel(), 0 * rows.ravel()]) * pitch, dtype=np.float64)


def _solve(views: list[Points], board: Points, size: tuple[int, int], use_k3: bool = True) -> _Solution:
    residual, matrix, distortion, turns, shifts, _, _, each = cv2.calibrateCameraExtended(
        [board.astype(np.float32)] * len(views),
        [view.astype(np.float32).reshape(-1, 1, 2) for view in views],
        size,
        np.eye(3),
        np.zeros(LENS_COEFFICIENTS),
        # Pixels of photographic sensors are square; one focal length is better known than two.
        flags=cv2.CALIB_FIX_ASPECT_RATIO | (0 if use_k3 else cv2.CALIB_FIX_K3),
    )
    lens, residuals = distortion.ravel()[:LENS_COEFFICIENTS], np.ravel(each).astype(float)
    return _Solution(float(residual), matrix, lens, list(turns), list(shifts), residuals)


def _covariance(solution: _Solution, views: list[Points], board: Points) -> Points:
    """Return the covariance of one focal length, the principal point and the lens' coefficients, from what the fit leaves."""
    own = 3 + LENS_COEFFICIENTS
    information: Points = np.zeros((own, own))
    squares = 0.0
    for turn, shift, view in zip(solution.turns, solution.shifts, views, strict=True):
        seen, slope = cv2.projectPoints(board, turn, shift, solution.matrix, solution.distortion)
        squares += float(np.sum((seen.reshape(-1, 2) - view) ** 2))
        pose, lens = slope[:, :6], slope[:, 6 : 10 + LENS_COEFFICIENTS]
        lens = np.column_stack([lens[:, 0] + lens[:, 1], lens[:, 2:]])
        # Changes that the board's pose can absorb do not depend on the camera.
        lens = lens - pose @ np.linalg.lstsq(pose, lens, rcond=None)[0]
        information = information + lens.T @ lens
    spare = 2 * len(views) * len(board) - own - 6 * len(views)
    scale = 1.0 / np.sqrt(np.diag(information))
    covariance = np.linalg.inv(information * np.outer(scale, scale)) * np.outer(scale, scale) * squares / spare
    return np.asarray(covariance, dtype=np.float64)


def _errors(camera: Camera, covariance: Points, views: list[Points], board: Points, use_k3: bool, coverage: float) -> Points:
    """Return the standard error in px of an undistorted point per axis, (RINGS,) at equal steps from the frame's middle to
    a corner. The covariance does not know that corners in one photograph share their board's bends and blur; leaving out
    one photograph at a time (the jackknife) does, but is itself uncertain with few of them. The larger one counts."""
    values = np.concatenate([[camera.matrix[0, 0], *camera.matrix[:2, 2]], camera.distortion])
    slopes = []
    for number, step in enumerate(0.01 * np.sqrt(np.diag(covariance))):
        f, cx, cy, *lens = values + step * np.eye(len(values))[number]
        other = dataclasses.replace(camera, matrix=np.array([[f, 0, cx], [0, f, cy], [0, 0, 1]]), distortion=np.array(lens))
        slopes.append(_ring_distances(camera, other, coverage) / step)
    variance = np.einsum("irk,ij,jrk->rk", slopes, covariance, slopes)
    count = len(views)
    spread = np.full(variance.shape, MIN_LENS_ERROR**2)
    if count > MIN_VIEWS:
        rest = (views[:left_out] + views[left_out + 1 :] for left_out in range(count))
        moved = [
            _ring_distances(camera, _solve(some, board, camera.size, use_k3).camera(camera.size, ""), coverage) for some in rest
        ]
        spread = (count - 1) / count * np.sum(np.square(moved), axis=0)
    return np.sqrt(np.maximum(variance.mean(axis=1), spread.mean(axis=1)))


def _ring_distances(camera: Camera, other: Camera, coverage: float) -> Points:
    """Return how far another camera puts points on rings about the middle (RINGS, k) in px, all axes and places laid end
    to end. A homography, which the screen's grid determines anyway, has taken its share where boards were seen."""
    middle = (np.array(camera.size) - 1.0) / 2.0
    # Along the diagonals every distance up to the corners lies in the frame, and so it does halfway to the sides.
    arms = np.array([[x, y] for x in (-1.0, 1.0) for y in (-1.0, 1.0)]) * middle
    rings = middle + np.linspace(0.0, 1.0, ERROR_RINGS)[:, None, None] * arms
    sides = np.array([[-1.0, 0.0], [1.0, 0.0], [0.0, -1.0], [0.0, 1.0]])
    reach = np.minimum(np.linspace(0.0, 1.0, ERROR_RINGS)[:, None, None] * np.linalg.norm(middle), middle)
    rings = np.concatenate([rings, middle + reach * sides], axis=1)
    here, there = (lens.undistort(rings.reshape(-1, 2)) for lens in (camera, other))
    known = np.isfinite(here).all(axis=1) & np.isfinite(there).all(axis=1)
    near = known & (np.linalg.norm(rings.reshape(-1, 2) - middle, axis=1) <= coverage * np.linalg.norm(middle))
    homography, _ = cv2.findHomography(there[near], here[near], 0)
    moved = cv2.perspectiveTransform(there.reshape(-1, 1, 2), homography).reshape(-1, 2) - here
    return np.where(known[:, None], moved, 0.0).reshape(ERROR_RINGS, -1)


# ----------------------------------------------------------------------------------------------------------------------
# Corners of a board measured again once the lens is known, so that its bending does not move them.
#
# Around a corner every edge points at it (Förstner and Gülch 1987), and cv2.cornerSubPix finds the point that the edges of
# a window agree on. A lens bends the edges, the more the wider the window, and with them the corner: by a hundredth of a
# pixel and more, alike in all photographs, which is enough to bend the calibration. Here the same equations are solved in
# ideal pixels, where edges are straight (the idea of Datta, Kim and Kanade 2009, doi 10.1109/ICCVW.2009.5457474, but with
# the gradients carried through the lens instead of a warped picture).


WINDOW_DEGREE = 4
"""Degree of the polynomial that stands for the lens within a window."""

WINDOW_NODES = 7
"""Places along each side of a window at which the lens is asked."""

CORNER_TOLERANCE_PX = 1e-3
"""Step in px below which corners are where they belong."""


def straightened_corners(gray: NDArray[np.uint8], corners: Points, camera: Camera, reach: int) -> Points:
    """Return the corners (n, 2) in px of a photograph (h, w), given right to a pixel, measured along edges that the lens does
    not bend; ``reach`` is half the width of the window around each, which the camera is known well enough to straighten."""
    # Only the part of the picture that the windows can come to.
    first = np.clip(np.floor(corners.min(axis=0)).astype(int) - 2 * reach - 2, 0, None)
    last = np.ceil(corners.max(axis=0)).astype(int) + 2 * reach + 3
    light = gray[first[1] : last[1], first[0] : last[0]].astype(np.float32)
    slopes = [cv2.Scharr(light, cv2.CV_32F, *order) / 32.0 for order in ((1, 0), (0, 1))]
    places = np.linspace(-1.0, 1.0, WINDOW_NODES)
    nodes = np.stack(np.meshgrid(places, places), axis=-1).reshape(-1, 2)
    # A lens is so smooth that a polynomial over a window stands for it, and spares sending every pixel through it.
    fit = np.linalg.pinv(polyvander2d(nodes[:, 0], nodes[:, 1], [WINDOW_DEGREE, WINDOW_DEGREE]))
    seen = corners.copy()
    for _ in range(10):
        # The window moves by whole pixels, so that nothing is taken between them; its weights move with the corner.
        middles = np.rint(seen).astype(int)
        ideal = camera.undistort((middles[:, None] + reach * nodes).reshape(-1, 2)).reshape(len(seen), -1, 2)
        starts, steps = camera.undistort(seen), np.zeros_like(seen)
        for number, (middle, lens) in enumerate(zip(middles, fit @ ideal, strict=True)):
            steps[number] = _corner_step(slopes, middle - first, seen[number] - first, starts[number], lens, reach)
        corrected = camera.distort(starts + steps)
        corrected = np.where(np.isfinite(corrected), corrected, seen)
        # A corner that runs away stays where it was: its window holds no corner.
        corrected = np.where(np.linalg.norm(corrected - corners, axis=1)[:, None] < 0.5 * reach, corrected, seen)
        moved = float(np.abs(corrected - seen).max())
        seen = corrected
        if moved < CORNER_TOLERANCE_PX:
            break
    return seen


def _corner_step(
    slopes: list[Points], middle: NDArray[np.int64], seen: Points, start: Points, lens: Points, reach: int
) -> Points:
    """Return the way (2,) in ideal px from a corner to the point that the edges of its window run through.

    The light's slopes (h, w) are along x and y; the corner is ``seen`` in the photograph at ``start`` in ideal px, near the
    pixel in the middle of the window; ``lens`` are the coefficients ((DEGREE + 1)^2, 2) of the ideal place over that in it.
    """
    span = [
        np.arange(max(at - reach, 1), min(at + reach, size - 2) + 1)
        for at, size in zip(middle, slopes[0].shape[::-1], strict=True)
    ]
    if not all(map(len, span)):
        return np.zeros(2)
    powers, rises, weights = [], [], []
    for pixels, at, exact in zip(span, middle, seen, strict=True):
        power = polyvander((pixels - at) / reach, WINDOW_DEGREE)
        powers.append(power)
        rises.append(np.pad(power[:, :-1] * np.arange(1, WINDOW_DEGREE + 1), ((0, 0), (1, 0))) / reach)
        weights.append(np.exp(-2.0 * (pixels - exact) ** 2 / reach**2))
    weight = weights[1][:, None] * weights[0]
    gx, gy = (slope[span[1][0] : span[1][-1] + 1, span[0][0] : span[0][-1] + 1].astype(float) for slope in slopes)
    table = lens.reshape(WINDOW_DEGREE + 1, WINDOW_DEGREE + 1, 2)
    (x, y), (x_x, y_x), (x_y, y_y) = (
        # Not by matrix products: BLAS would start threads for each of them.
        [np.einsum("yj,xj->yx", down, np.einsum("xi,ij->xj", across, table[..., axis])) for axis in (0, 1)]
        for across, down in ((powers[0], powers[1]), (rises[0], powers[1]), (powers[0], rises[1]))
    )
    # The light's gradient carried into ideal pixels.
    size = x_x * y_y - y_x * x_y
    cx, cy = (gx * y_y - gy * y_x) / size, (gy * x_x - gx * x_y) / size
    along = weight * (cx * (x - start[0]) + cy * (y - start[1]))
    mixed = np.sum(weight * cx * cy)
    normal = np.array([[np.sum(weight * cx**2), mixed], [mixed, np.sum(weight * cy**2)]])
    try:
        return np.linalg.solve(normal, np.array([np.sum(along * cx), np.sum(along * cy)]))
    except np.linalg.LinAlgError:  # a window without any edge
        return np.zeros(2)


# ----------------------------------------------------------------------------------------------------------------------
# Chessboards and ChArUco boards as known points, found by OpenCV.


CORNER_ERROR = 0.1
"""Standard error in px of a corner of a sharp board, for boards without enough corners to tell."""

TAG_CORNER_ERROR = 0.2
"""Standard error in px of a tag's corner per axis; four corners cannot show their own."""

TAG_WINDOW_SHARE = 0.05
"""Half width of the window in which a tag's corner is measured, as a share of its side."""

WINDOW_SHARE = 0.4
"""Half width of the window that fixes a corner, as a share of the way to the closest one: wider ones see its edges too."""

SEARCH_SIDES_PX = (900, 1800)
"""Longer sides in px of the reduced pictures that a board is searched in, before the whole one."""
LEAST_REDUCTION = 1.5
"""Factor below which a reduced picture is not searched."""
MIN_WINDOW_PX = 4
"""Half width in px of a corner's window in a reduced picture from which its corners are taken."""


def find_chessboard(image: ArrayLike, pattern: tuple[int, int] = (9, 6), camera: Camera | None = None) -> GridPoints:
    """Find the inner corners, a pattern of so many in a row and in a column, in a photograph (h, w) or (h, w, 3): in rows
    from the board's first corner; the second index counts down the board.

    The camera's lens is taken out before the residual is judged; without it the residual is not. Raises `GridError` for no
    such board.
    """
    columns, rows = pattern
    gray = gray_bytes(image)
    if min(pattern) < 3:
        raise GridError(f"a chessboard of {columns} x {rows} inner corners is too small; give at least 3 x 3")
    corners = _board_corners(gray, pattern)
    if corners is None:
        raise GridError(f"no chessboard with {columns} x {rows} inner corners was found; check the pattern and the picture")
    reach = corner_reach(corners)
    stop = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-5)
    corners = cv2.cornerSubPix(gray, corners.astype(np.float32).reshape(-1, 1, 2), (reach, reach), (-1, -1), stop)
    across, down = np.meshgrid(np.arange(columns), np.arange(rows))
    indices = np.column_stack([across.ravel(), down.ravel()])
    px = corners.reshape(-1, 2).astype(float)
    return _points(px if camera is None else straightened_corners(gray, px, camera, reach), indices, camera)


def _board_corners(gray: NDArray[np.uint8], pattern: tuple[int, int]) -> NDArray[np.float64] | None:
    """Return the corners (n, 2) of the board in px, right to about a pixel; None if it is not there. The search begins
    with reduced pictures: its time grows faster than their pixels."""
    longest = max(gray.shape)
    for side in (*SEARCH_SIDES_PX, longest):
        if side < longest / LEAST_REDUCTION or side == longest:
            scale = longest / side
            size = (round(gray.shape[1] / scale), round(gray.shape[0] / scale))
            small = gray if side == longest else cv2.resize(gray, size, interpolation=cv2.INTER_AREA)
            # Without CALIB_CB_ACCURACY, which searches four times the pixels for a precision that comes later here.
            is_whole, corners = cv2.findChessboardCornersSB(small, pattern, flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
            if is_whole and (small is gray or corner_reach(corners.reshape(-1, 2)) >= MIN_WINDOW_PX):
                scales = np.array(gray.shape[::-1]) / small.shape[::-1]
                return np.asarray((corners.reshape(-1, 2).astype(float) + 0.5) * scales - 0.5)
    known = cv2.CALIB_CB_ADAPTIVE_THRESH + cv2.CALIB_CB_NORMALIZE_IMAGE + cv2.CALIB_CB_FAST_CHECK
    is_whole, corners = cv2.findChessboardCorners(gray, pattern, flags=known)
    return corners.reshape(-1, 2).astype(float) if is_whole else None


def find_charuco(
    image: ArrayLike, squares: tuple[int, int], marker_share: float = 0.75, dictionary: str = "DICT_4X4_50",
    camera: Camera | None = None,
) -> GridPoints:  # fmt: skip
    """Find the inner corners of a ChArUco board of so many squares in a row and in a column, of which a part may be
    covered; its markers are of OpenCV's predefined dictionary. The rest is as in `find_chessboard`."""
    try:
        markers = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
        board = cv2.aruco.CharucoBoard(squares, 1.0, marker_share, markers)
    except (AttributeError, cv2.error):
        raise GridError(f"no ChArUco board of {squares} squares with the dictionary {dictionary} exists") from None
    corners, names, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(gray_bytes(image))
    if corners is None or names is None or len(names) < MIN_LINES:
        count = 0 if names is None else len(names)
        raise GridError(f"{count} corners of the ChArUco board were found; at least {MIN_LINES} are needed")
    flat = np.ravel(names)
    indices = np.column_stack([flat % (squares[0] - 1), flat // (squares[0] - 1)])
    return _points(corners.reshape(-1, 2).astype(float), indices, camera)


def tag_plane(image: ArrayLike, camera: Camera, side: float) -> setup.Plane:
    """Return the plane of the largest AprilTag of the family 36h11 in a photograph (h, w) or (h, w, 3), its black square of a
    side in m; X and Z count from its lower left corner. Raises `GridError` for none."""
    tags = find_tags(image)
    if not tags:
        raise GridError(
            "no AprilTag of the family 36h11 was found; photograph it sharply, whole and with its white rim, or give --scale"
        )
    corners = max((corners for _, corners in tags), key=lambda corners: cv2.contourArea(corners.astype(np.float32)))
    places = np.array([[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]]) * side
    return setup.Plane.fit(camera.undistort(corners), places, TAG_CORNER_ERROR)


def find_tags(image: ArrayLike) -> list[tuple[int, NDArray[np.float64]]]:
    """Return number and corners (4, 2) in px, from the upper left one on, of each AprilTag of the family 36h11 in a photograph
    (h, w) or (h, w, 3)."""
    gray = gray_bytes(image)
    finder = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11))
    tags, names, _ = finder.detectMarkers(gray)
    stop = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-4)
    refined = []
    for tag, name in zip(tags, np.ravel(names) if len(tags) else (), strict=True):
        corners = tag.reshape(4, 1, 2).astype(np.float32)
        reach = max(2, int(TAG_WINDOW_SHARE * np.linalg.norm(corners[1] - corners[0])))
        refined.append((int(name), cv2.cornerSubPix(gray, corners, (reach, reach), (-1, -1), stop)[:, 0].astype(float)))
    return refined


def corner_reach(corners: NDArray[np.float64]) -> int:
    """Return half width in px of the window in which a corner of the board at these places (n, 2) is measured."""
    gaps = np.linalg.norm(corners[:, None] - corners[None], axis=2)
    return max(2, int(WINDOW_SHARE * float(np.min(gaps[gaps > 0.0]))))


def _points(px: NDArray[np.float64], indices: NDArray[np.int64], camera: Camera | None) -> GridPoints:
    if camera is None:
        return GridPoints(px, indices, np.full(len(px), CORNER_ERROR), float("nan"))
    try:
        plane = setup.Plane.fit(camera.undistort(px), indices.astype(float))
    except setup.PlaneError as error:
        raise GridError(f"the board's corners do not determine a plane: {error}") from None
    return checked(px, indices, np.full(len(px), CORNER_ERROR), plane)


# ----------------------------------------------------------------------------------------------------------------------
# Which of several photographs show a chessboard that a camera can be calibrated from.


@dataclasses.dataclass(frozen=True, eq=False)
class BoardView:
    """A photograph of a board: its gray values (h, w), and the board's inner corners (n, 2) in px."""

    path: str
    gray: NDArray[np.uint8]
    corners: Points

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in px."""
        return self.gray.shape[1], self.gray.shape[0]


def seen_boards(
    paths: Iterable[str], pattern: tuple[int, int], each: Callable[[], object] = lambda: None
) -> tuple[list[BoardView], dict[str, str]]:
    """Return the photographs that show the board, all of one size, and why the others do not count, by path; ``each`` is
    called after each photograph."""
    views: list[BoardView] = []
    refused: dict[str, str] = {}
    first: dict[bytes, str] = {}
    searches: list[tuple[str, NDArray[np.uint8], Future[GridPoints]]] = []
    with ThreadPoolExecutor(processes.cores()) as pool:  # OpenCV lets other threads run
        for path in paths:
            try:
                gray = np.asarray(cv2.cvtColor(pictures.read_pixels(Path(path)), cv2.COLOR_RGB2GRAY), dtype=np.uint8)
                # One view that counts twice looks like a camera that is known better.
                same = first.setdefault(hashlib.sha256(gray.tobytes()).digest(), path)
                if same != path or any(path == other for other, _, _ in searches):
                    raise pictures.Unmeasurable(
                        f"it is the same picture as {same}, so it counts once; photograph the board from another place"
                    )
            except pictures.Unmeasurable as error:
                refused[path] = str(error)
                each()
            else:
                searches.append((path, gray, pool.submit(find_chessboard, gray, pattern)))
        for path, gray, search in searches:
            if views and gray.shape != views[0].gray.shape:
                width, height = views[0].size
                refused[path] = f"it has {gray.shape[1]} x {gray.shape[0]} pixels, but the others {width} x {height}"
                search.cancel()
            else:
                try:
                    views.append(BoardView(path, gray, search.result().px))
                except GridError as error:
                    refused[path] = str(error)
            each()
    return views, refused


# ----------------------------------------------------------------------------------------------------------------------
# A setup from a photograph of the screen's grid, as one call.
#
# A photograph with the grid drawn over it as the setup sees it.


DRAWN_SIDE_PX = 2000
"""Pixels of the drawn picture's longer side."""

LINE_COLOUR, POINT_COLOUR = (220, 40, 40), (20, 90, 230)


def read_picture(path: Path | str) -> NDArray[np.uint8]:
    """Return a photograph (h, w, 3) in the sensor's own orientation, or the first frame of a film; `CameraError` if it is not
    there or no picture."""
    try:
        return film.first_frame(Path(path)) if film.is_film(Path(path)) else pictures.read_pixels(Path(path))
    except (film.FilmError, pictures.Unmeasurable) as error:
        raise CameraError(f"{path} cannot be read as a photograph: {error}") from None


def draw_points(path: Path, picture: NDArray[np.uint8], camera: Camera, plane: setup.Plane) -> None:
    """Write the photograph (h, w, 3) with the plane's known points and its lines through them."""
    scale = min(1.0, DRAWN_SIDE_PX / max(picture.shape[:2]))
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
            cv2.polylines(canvas, [shown], False, LINE_COLOUR, thick, cv2.LINE_AA, shift=4)
    for (x, y), target in zip(placed(camera.distort(plane.points)), plane.targets, strict=True):
        radius = 5 * thick * (2 if np.allclose(target, 0.0) else 1)  # the origin is the large one
        cv2.circle(canvas, (int(x), int(y)), radius * 16, POINT_COLOUR, thick, cv2.LINE_AA, shift=4)
    texts = PngInfo()
    texts.add_text("Software", files.FILE_MARK)  # by which a later setup knows that it may replace the picture
    more: dict[str, Any] = {"pnginfo": texts} if path.suffix.lower() == ".png" else {}
    with files.replaced_whole(path) as aside:
        Image.fromarray(canvas).save(aside, **more)


def setup_from_grid(
    photograph: str | Path,
    pitch: float = 9e-3,
    camera: Camera | None = None,
    magnification: tuple[float, float] = (1.0, 0.0),
    zero: ArrayLike | None = None,
    pitch_error: float = setup.PITCH_ERROR,
) -> Setup:
    """Find the screen's plane in a photograph of its grid.

    Args:
        photograph: The picture.
        pitch: Distance of the grid's lines in m.
        camera: Its lens, as `measurement.calibrate` and `measurement.camera.lens_profile` give it; None for one without
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
