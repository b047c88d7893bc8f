"""A camera calibrated from photographs of a chessboard (Zhang 2000, doi 10.1109/34.888718; the solver is OpenCV's).

The corners are measured again in the lens that they gave (`camera.corners`), until both agree.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np

from measurement.camera.camera import Camera, CameraError, Points
from measurement.camera.corners import straightened_corners
from measurement.cores import cores
from measurement.screen.board_views import BoardView, seen_boards
from measurement.screen.boards import corner_reach

FEWEST = 3
"""Views of the board that fix the camera's matrix and its lens."""

WORST = 1.0
"""Largest root mean square distance in px between corners found and corners predicted."""

UNKNOWN = 0.5
"""Least standard error in px of the lens from three photographs, of which none can be spared to see what it changes."""

ROUNDS = 2
"""Times that corners are measured again in the lens found: the second moves them by less than a thousandth of a pixel."""

STEPS = 1 + ROUNDS
"""Steps of a calibration for each photograph: the search of its board, and its corners measured again."""

COEFFICIENTS = 5
"""Coefficients of the lens: k1, k2, p1, p2, k3 in OpenCV's order."""

EVIDENCE = 2.0
"""Standard errors by which k3 must differ from 0 to be used: one that is not seen only bends what lies beyond the boards."""

RINGS = 11
"""Distances from the frame's middle at which the lens' error is stated."""


@dataclasses.dataclass(frozen=True, eq=False)
class Calibration:
    """A calibrated camera and what it rests on.

    Attributes:
        camera: The camera; its errors come from the covariance of the fit or from leaving out one photograph at a time,
            whichever are larger.
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
        each: Called at each of the `STEPS` for every photograph, to show how far it is.

    Raises:
        CameraError: Too few usable photographs, or corners that fit no camera.
    """
    views, refused = seen_boards(map(str, paths), pattern, each)
    if len(views) < FEWEST:
        reasons = "; ".join(f"{path}: {reason}" for path, reason in refused.items())
        raise CameraError(
            f"a calibration needs {FEWEST} or more photographs of the board, not {len(views)} ({reasons})"
        )
    board, size = _board(pattern, pitch), views[0].size
    corners = [view.corners for view in views]
    solution = _solve(corners, board, size)
    if not solution.residual < WORST:
        raise CameraError(
            f"the boards' corners miss the best camera by {solution.residual:.2g} px; check the pattern and that the boards "
            "are flat"
        )
    for _ in range(ROUNDS):
        camera = solution.camera(size, "")
        straight = functools.partial(_straightened, camera)
        with ThreadPoolExecutor(cores()) as pool:
            corners = [(each(), found)[1] for found in pool.map(straight, views, corners)]
        solution = _solve(corners, board, size)
    return Calibration(
        camera=calibrated_from(corners, board, size),
        residual_px=solution.residual,
        per_image=dict(zip((view.path for view in views), map(float, solution.each), strict=True)),
        coverage=float(reached(corners, size).max()),
        refused=refused,
    )


def _straightened(camera: Camera, view: BoardView, corners: Points) -> Points:
    return straightened_corners(view.gray, corners, camera, corner_reach(corners))


def calibrated_from(views: list[Points], board: Points, size: tuple[int, int]) -> Camera:
    """The camera and its errors from a board's corners.

    Args:
        views: The corners (n, 2) in px of each photograph, three photographs or more.
        board: The same corners (n, 3) on the board in m, the last coordinate 0.
        size: Width and height of the photographs in px.
    """
    solution = _solve(views, board, size)
    covariance = _covariance(solution, views, board)
    use_k3 = bool(abs(solution.distortion[4]) > EVIDENCE * np.sqrt(covariance[-1, -1]))
    # A k3 that is left out may yet be there, so that it stays in the error.
    camera = (solution if use_k3 else _solve(views, board, size, use_k3)).camera(size, f"{len(views)} chessboards")
    far = reached(views, size)
    errors = _errors(camera, covariance, views, board, use_k3, float(far.max()))
    known = float(np.sqrt(np.mean(np.interp(far, np.linspace(0.0, 1.0, RINGS), errors) ** 2)))
    return dataclasses.replace(camera, error_px=known, errors_px=errors)


def reached(views: list[Points], size: tuple[int, int]) -> Points:
    """Distances (n,) of all corners from the frame's middle, as shares of the way to its corners."""
    middle = (np.array(size) - 1.0) / 2.0
    return np.asarray(np.linalg.norm(np.vstack(views) - middle, axis=1) / np.linalg.norm(middle))


@dataclasses.dataclass(frozen=True, eq=False)
class _Solution:
    """What OpenCV's solver gives: residual (px), matrix (3, 3), coefficients (5,), poses (n, 3) each, residuals (n,)."""

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
        np.zeros(COEFFICIENTS),
        # Pixels of photographic sensors are square; one focal length is better known than two.
        flags=cv2.CALIB_FIX_ASPECT_RATIO | (0 if use_k3 else cv2.CALIB_FIX_K3),
    )
    return _Solution(
        float(residual),
        matrix,
        distortion.ravel()[:COEFFICIENTS],
        list(turns),
        list(shifts),
        np.ravel(each).astype(float),
    )


def _covariance(solution: _Solution, views: list[Points], board: Points) -> Points:
    """Covariance of one focal length, the principal point and the lens' coefficients, from what the fit leaves."""
    own = 3 + COEFFICIENTS
    information: Points = np.zeros((own, own))
    squares = 0.0
    for turn, shift, view in zip(solution.turns, solution.shifts, views, strict=True):
        seen, slope = cv2.projectPoints(board, turn, shift, solution.matrix, solution.distortion)
        squares += float(np.sum((seen.reshape(-1, 2) - view) ** 2))
        pose, lens = slope[:, :6], slope[:, 6 : 10 + COEFFICIENTS]
        lens = np.column_stack([lens[:, 0] + lens[:, 1], lens[:, 2:]])
        # What the board's own pose can take up says nothing about the camera.
        lens = lens - pose @ np.linalg.lstsq(pose, lens, rcond=None)[0]
        information = information + lens.T @ lens
    spare = 2 * len(views) * len(board) - own - 6 * len(views)
    scale = 1.0 / np.sqrt(np.diag(information))
    covariance = np.linalg.inv(information * np.outer(scale, scale)) * np.outer(scale, scale) * squares / spare
    return np.asarray(covariance, dtype=np.float64)


def _errors(
    camera: Camera, covariance: Points, views: list[Points], board: Points, use_k3: bool, coverage: float
) -> Points:
    """Standard error in px of an undistorted point per axis, (RINGS,) at equal steps from the frame's middle to a corner.

    The covariance does not know that corners in one photograph share their board's bends and blur; leaving out one
    photograph at a time (the jackknife) does, but is itself uncertain with few of them. The larger one counts.
    """
    size = (camera.width, camera.height)
    values = np.concatenate([[camera.matrix[0, 0], *camera.matrix[:2, 2]], camera.distortion])
    slopes = []
    for number, step in enumerate(0.01 * np.sqrt(np.diag(covariance))):
        f, cx, cy, *lens = values + step * np.eye(len(values))[number]
        other = dataclasses.replace(
            camera, matrix=np.array([[f, 0, cx], [0, f, cy], [0, 0, 1]]), distortion=np.array(lens)
        )
        slopes.append(_moved(camera, other, coverage) / step)
    variance = np.einsum("irk,ij,jrk->rk", slopes, covariance, slopes)
    count = len(views)
    spread = np.full(variance.shape, UNKNOWN**2)
    if count > FEWEST:
        rest = (views[:left_out] + views[left_out + 1 :] for left_out in range(count))
        moved = [_moved(camera, _solve(some, board, size, use_k3).camera(size, ""), coverage) for some in rest]
        spread = (count - 1) / count * np.sum(np.square(moved), axis=0)
    return np.sqrt(np.maximum(variance.mean(axis=1), spread.mean(axis=1)))


def _moved(camera: Camera, other: Camera, coverage: float) -> Points:
    """How far another camera puts points on rings about the middle (RINGS, k) in px, all axes and places laid end to end.

    A homography, which the screen's grid determines anyway, has taken its share where boards were seen.
    """
    middle = (np.array([camera.width, camera.height]) - 1.0) / 2.0
    # Along the diagonals every distance up to the corners lies in the frame, and so it does halfway to the sides.
    arms = np.array([[x, y] for x in (-1.0, 1.0) for y in (-1.0, 1.0)]) * middle
    rings = middle + np.linspace(0.0, 1.0, RINGS)[:, None, None] * arms
    sides = np.array([[-1.0, 0.0], [1.0, 0.0], [0.0, -1.0], [0.0, 1.0]])
    reach = np.minimum(np.linspace(0.0, 1.0, RINGS)[:, None, None] * np.linalg.norm(middle), middle)
    rings = np.concatenate([rings, middle + reach * sides], axis=1)
    here, there = (lens.undistort(rings.reshape(-1, 2)) for lens in (camera, other))
    known = np.isfinite(here).all(axis=1) & np.isfinite(there).all(axis=1)
    near = known & (np.linalg.norm(rings.reshape(-1, 2) - middle, axis=1) <= coverage * np.linalg.norm(middle))
    homography, _ = cv2.findHomography(there[near], here[near], 0)
    moved = cv2.perspectiveTransform(there.reshape(-1, 1, 2), homography).reshape(-1, 2) - here
    return np.where(known[:, None], moved, 0.0).reshape(RINGS, -1)
