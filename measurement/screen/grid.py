"""The screen's grid of lines, found in a photograph without a click.

Long dark lines are sought in a reduced picture (`grid_lines`), sorted into two pencils with counted lines
(`grid_lattice`), and their crossings measured in the photograph itself (`grid_crossings`). The pitch only scales the
result: a grid with another pitch looks the same from another distance, so a wrong pitch cannot be noticed here.
"""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from measurement.camera.camera import Camera, Points
from measurement.screen.grid_crossings import measure_crossings
from measurement.screen.grid_error import FEWEST, GridError
from measurement.screen.grid_lattice import count_lines
from measurement.screen.grid_lines import find_lines
from measurement.screen.plane import Plane, PlaneError

WORST_SHARE = 0.005
"""Largest residual as a share of the pitch (45 um of 9 mm); below `WORST_PX` a residual is always small enough."""

WORST_PX = 0.3

FLOOR = 0.02
"""Smallest standard error in px that a crossing is given when crossings are weighed against each other."""

SKEWED = 1.7
"""Largest ratio of the spacings of both families of lines on the screen, as the camera's matrix tells it."""


@dataclasses.dataclass(frozen=True, eq=False)
class GridPoints:
    """Crossings of a regular grid in a photograph.

    Attributes:
        px: Crossings (n, 2) in px of the photograph itself, lens distortion and all.
        indices: Whole numbers (n, 2): lines counted to the right and upwards from the origin's crossing.
        sigma_px: Standard error (n,) of each crossing per axis in px.
        residual_px: Root mean square distance in px of the crossings from the grid that fits them best.
        pitch: Distance of the lines in m; None where it was not given.
    """

    px: Points
    indices: NDArray[np.int64]
    sigma_px: Points
    residual_px: float
    pitch: float | None = None

    def plane(self, camera: Camera, pitch: float | None = None) -> Plane:
        """The screen's plane through these points, its error taken from what the fit leaves.

        Args:
            camera: The camera that saw the points.
            pitch: Distance of the lines in m, if the points do not know it.
        """
        size = pitch if pitch is not None else self.pitch
        if size is None or not size > 0.0:
            raise GridError("the pitch of the grid must be a positive length")
        return weighted_plane(
            camera.undistort(self.px), np.asarray(self.indices * size, dtype=np.float64), self.sigma_px
        )


def weighted_plane(ideal: Points, targets: Points, sigma: Points) -> Plane:
    """Fit a plane in which sharp crossings weigh more than faint ones and the errors are those that the fit shows.

    Args:
        ideal: Crossings (n, 2) in ideal px.
        targets: The same (n, 2) on the screen.
        sigma: Their own standard errors (n,) in px, right up to a common factor and a floor.
    """
    # What all crossings share (the print, the lens, the sensor) keeps one of them from ruling the fit.
    relative = np.hypot(sigma, max(float(np.median(sigma)), FLOOR))
    trial = Plane.fit(ideal, targets, relative)
    missed = (trial.to_pixels(targets) - ideal) / relative[:, None]
    factor = float(np.sqrt(np.sum(missed**2) / max(1, 2 * len(ideal) - 8)))
    return Plane.fit(ideal, targets, relative * max(factor, 1e-6))


def find_grid(
    image: ArrayLike, camera: Camera | None = None, pitch: float = 0.009, origin: tuple[float, float] | None = None
) -> GridPoints:
    """Find a regular grid of dark lines on a lighter screen.

    Args:
        image: Photograph (h, w) or (h, w, 3).
        camera: The camera; one without distortion unless given.
        pitch: Distance of the lines in m.
        origin: Pixel (x, y) near the crossing that becomes the origin; the middle of the picture unless given.

    Raises:
        GridError: No grid, too few crossings, a residual too large, or more than one way to read the lines.
    """
    if not pitch > 0.0:
        raise GridError("the pitch of the grid must be a positive length")
    gray = gray_bytes(image)
    height, width = gray.shape
    seen_by = Camera.ideal(width, height) if camera is None else camera
    if (seen_by.width, seen_by.height) != (width, height):
        raise GridError(
            f"the picture has {width} x {height} pixels but the camera {seen_by.width} x {seen_by.height}; "
            "photograph both with the same settings and do not crop"
        )
    if np.ptp(np.percentile(gray, (0.5, 99.5))) < 4.0:
        raise GridError("the picture is blank; no grid can be seen in it")
    lattice = count_lines(find_lines(gray, seen_by), seen_by)
    px, indices, sigma = measure_crossings(gray, seen_by, lattice)
    px, indices, sigma, plane = _without_outliers(px, indices, sigma, seen_by)
    found = checked(px, indices, sigma, plane)
    _check_square(plane, seen_by)
    return counted_from(found, seen_by, pitch, origin)


def counted_from(
    found: GridPoints, camera: Camera, pitch: float, origin: tuple[float, float] | None = None
) -> GridPoints:
    """The same points counted from the crossing nearest to a pixel, the picture's middle unless given."""
    middle = ((camera.width - 1) / 2, (camera.height - 1) / 2) if origin is None else origin
    # The origin need not be measured itself: dust on it must not move it to its neighbour.
    first = np.rint(found.plane(camera, 1.0).to_metres(camera.undistort(middle))[0]).astype(int)
    return dataclasses.replace(found, indices=found.indices - first, pitch=pitch)


def gray_bytes(image: ArrayLike) -> NDArray[np.uint8]:
    """A photograph (h, w) or (h, w, 3) as 8-bit gray values (h, w).

    Raises:
        GridError: It is no picture.
    """
    picture = np.asarray(image)
    if picture.ndim == 3 and picture.shape[2] == 3 and picture.dtype == np.uint8:
        return cv2.cvtColor(np.ascontiguousarray(picture), cv2.COLOR_RGB2GRAY)
    if picture.ndim != 2 or min(picture.shape) < 32:
        raise GridError("a picture of at least 32 x 32 gray or 8-bit colour pixels is needed to find a grid")
    if picture.dtype == np.uint8:
        return np.ascontiguousarray(picture)
    low, high = float(np.min(picture)), float(np.max(picture))
    if not np.isfinite([low, high]).all():
        raise GridError("the picture holds values that are not finite numbers")
    return np.clip((picture - low) * (255.0 / max(high - low, 1e-12)), 0.0, 255.0).astype(np.uint8)


def checked(px: Points, indices: NDArray[np.int64], sigma: Points, plane: Plane) -> GridPoints:
    """Points turned so that the first index counts to the right and the second upwards, once their fit is good enough.

    Args:
        px: Points (n, 2) in raw px.
        indices: Their whole numbers (n, 2) in any orientation.
        sigma: Standard error (n,) in px.
        plane: The plane fitted to the ideal pixels and the indices.

    Raises:
        GridError: Too few points, a residual too large, or a grid turned by about 45 degrees.
    """
    if len(px) < FEWEST:
        raise GridError(f"only {len(px)} crossings of the grid can be measured; at least {FEWEST} are needed")
    missed = plane.to_pixels(indices.astype(float)) - plane.points
    residual = float(np.sqrt(np.mean(np.sum(missed**2, axis=1))))
    axes = np.linalg.inv(plane.jacobian(plane.points.mean(axis=0))[0])  # px per index; columns are the grid's axes
    spacing = float(np.sqrt(abs(np.linalg.det(axes))))
    if residual > max(WORST_PX, WORST_SHARE * spacing):
        raise GridError(
            f"the crossings miss a regular grid by {residual:.2g} px ({residual / spacing:.2%} of the pitch); "
            "correct the lens, or flatten the screen"
        )
    units = axes / np.linalg.norm(axes, axis=0)
    level = np.abs(units[0])
    if abs(level[0] - level[1]) < 0.15:
        raise GridError(
            "the grid is turned by about 45 degrees; turn the camera so that its lines lie level or upright"
        )
    right, up = (0, 1) if level[0] > level[1] else (1, 0)
    signs = (int(np.sign(units[0, right])), -int(np.sign(units[1, up])))  # y counts downwards in a picture
    turned = np.column_stack([indices[:, right] * signs[0], indices[:, up] * signs[1]])
    return GridPoints(px, turned, sigma, residual)


def _without_outliers(
    px: Points, indices: NDArray[np.int64], sigma: Points, camera: Camera
) -> tuple[Points, NDArray[np.int64], Points, Plane]:
    ideal = camera.undistort(px)
    keep = np.isfinite(ideal).all(axis=1)
    total = len(px)
    while True:
        if keep.sum() < FEWEST or any(np.ptp(indices[keep], axis=0) < 1):
            raise GridError(
                f"only {int(keep.sum())} crossings of the grid can be measured; at least {FEWEST} are needed"
            )
        try:
            plane = weighted_plane(ideal[keep], indices[keep].astype(float), sigma[keep])
        except PlaneError as error:
            raise GridError(f"the grid's crossings fix no plane: {error}") from None
        missed = np.linalg.norm(plane.to_pixels(indices.astype(float)) - ideal, axis=1)
        # Judged by its own error; but less than a tenth of a pixel is never an outlier.
        relative = np.hypot(sigma, FLOOR)
        limit = 5.0 * float(np.median((missed / relative)[keep])) * relative
        wanted = keep & (missed < np.maximum(limit, 0.1))
        if np.array_equal(wanted, keep):
            break
        keep = wanted
    if keep.sum() < 0.7 * total:
        raise GridError(f"{total - int(keep.sum())} of {total} crossings do not fit one regular grid; check the lens")
    return px[keep], indices[keep], sigma[keep], plane


def _check_square(plane: Plane, camera: Camera) -> None:
    """Both families must be equally spaced, or one of them was miscounted. The focal length need not be exact for that."""
    pose = np.linalg.inv(camera.matrix) @ np.linalg.inv(plane.homography)
    across, up = np.linalg.norm(pose[:, :2], axis=0)
    ratio = max(across / up, up / across)
    if ratio > SKEWED:
        raise GridError(
            f"the lines are {ratio:.1f} times as far apart in one direction as in the other, so that they can be counted in "
            "more than one way; show more of the grid"
        )
