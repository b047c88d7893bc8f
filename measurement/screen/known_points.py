"""The screen's plane from what a user knows of a photograph without a grid: places of some points, or the scale alone."""

from __future__ import annotations

import dataclasses

import numpy as np

from measurement.camera.camera import Camera, Points, as_points
from measurement.screen.plane import Plane, PlaneError

CLICKED = 1.0
"""Standard error in px of a point that a person picked, where four points leave nothing to tell it."""

WORST_PX, WORST_SHARE = 4.0, 0.005
"""Largest miss of a known point: in px, or as a share of the points' extent in the picture if that is more."""

FLATTEST = 0.03
"""Least height of a triangle over its longest side that some three points must make for them not to be on one line."""


def plane_of_points(camera: Camera, px: Points, metres: Points) -> Plane:
    """Fit the plane to four or more known points, none of them on a line with all but one of the others.

    Args:
        camera: The camera that saw the points.
        px: Points (n, 2) in px of the photograph.
        metres: The same (n, 2) on the screen in m, X to the right and Z up.

    Raises:
        PlaneError: Too few points, points given twice, on one line, mirrored, or exchanged with each other.
    """
    seen, known = as_points(px), as_points(metres)
    if len(seen) < 4:
        raise PlaneError(f"{len(seen)} known points fix no plane; give at least 4, and 6 to see how well they fit")
    outside = ~np.all((seen >= -0.5) & (seen <= [camera.width - 0.5, camera.height - 0.5]), axis=1)
    if outside.any():
        raise PlaneError(f"the known point at {_name(seen[outside][0])} lies outside of the picture")
    for first in range(len(seen)):
        for second in range(first):
            if np.linalg.norm(seen[first] - seen[second]) < 1.0 or np.allclose(known[first], known[second], atol=1e-9):
                raise PlaneError(
                    f"the known points at {_name(seen[second])} and {_name(seen[first])} are the same point; give each once"
                )
    _check_spread(seen)
    _check_spread(known)
    ideal = camera.undistort(seen)
    try:
        plane = Plane.fit(ideal, known, CLICKED if len(seen) == 4 else None)
    except PlaneError:  # they lie on no line, as was seen above
        raise PlaneError("the known points fit no plane; check for points that were exchanged or mistyped") from None
    below = np.column_stack([ideal, np.ones(len(ideal))]) @ plane.homography[2]
    missed = np.linalg.norm(plane.to_pixels(known) - ideal, axis=1)
    if np.ptp(np.sign(below)) > 0 or missed.max() > max(WORST_PX, WORST_SHARE * float(np.ptp(seen, axis=0).max())):
        worst = int(np.argmax(missed))
        raise PlaneError(
            f"the known points fit no plane: the one at {_name(seen[worst])} misses by {missed[worst]:.0f} px; check for "
            "points that were exchanged or mistyped"
        )
    if np.linalg.det(plane.jacobian(ideal.mean(axis=0))[0]) > 0.0:
        raise PlaneError(
            "the known points are mirrored; X counts to the right and Z upwards, y in the picture downwards"
        )
    return plane


def plane_of_scale(
    camera: Camera, scale: float, error: float = 0.0, origin: tuple[float, float] | None = None
) -> Plane:
    """The plane of a camera that looks straight at it.

    Args:
        camera: The camera.
        scale: Pixels per metre.
        error: Its standard error.
        origin: Pixel (x, y) of X = Z = 0; the middle of the picture unless given.

    Raises:
        PlaneError: No positive scale.
    """
    if not (0.0 < scale < np.inf and 0.0 <= error < scale):
        raise PlaneError("the scale must be a positive number of pixels per metre, larger than its error")
    width, height = camera.width, camera.height
    x, y = camera.undistort(((width - 1) / 2, (height - 1) / 2) if origin is None else origin)[0]
    # Times the scale, so that only the last entry knows it.
    matrix = np.array([[1.0, 0.0, -x], [0.0, -1.0, y], [0.0, 0.0, scale]])
    norm = np.linalg.norm(matrix)
    unit = matrix.ravel() / norm
    slope = (np.eye(9)[8] - unit * unit[8]) / norm
    px = np.array([[0.0, 0.0], [width - 1.0, 0.0], [0.0, height - 1.0], [width - 1.0, height - 1.0]])
    ideal = camera.undistort(px)
    plane = Plane(matrix / norm, np.outer(slope, slope) * error**2, 0.0, ideal, ideal)
    return dataclasses.replace(plane, targets=plane.to_metres(ideal))


def _check_spread(points: Points) -> None:
    """A homography needs four points of which no three lie on one line; so no line may hold all but one of them."""
    extent = float(np.linalg.norm(np.ptp(points, axis=0)))
    for first in range(len(points)):
        for second in range(first):
            along = points[first] - points[second]
            length = float(np.linalg.norm(along))
            offset = (points - points[second]) @ np.array([-along[1], along[0]]) / max(length, 1e-12)
            if np.sum(np.abs(offset) > FLATTEST * extent) < 2:
                raise PlaneError("the known points lie on one line, all or all but one; add points beside it")


def _name(pixel: Points) -> str:
    return f"{pixel[0]:g},{pixel[1]:g}"
