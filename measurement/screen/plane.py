"""The screen's plane: a homography from ideal pinhole pixels to metres, with the covariance of its fit.

The known points are exact on the screen and uncertain in the photograph, so the fit minimises distances in pixels
(the "gold standard" of Hartley and Zisserman, Multiple View Geometry, 2nd ed., section 4.2, with errors in one image
only); the map from pixels to metres is the inverse of what is fitted.
"""

from __future__ import annotations

import dataclasses
import functools

import cv2
import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from measurement.camera.camera import Points, as_points

FEWEST = 4
"""Points that fix a homography; a fifth is the first that can contradict it."""

FEWEST_NEIGHBOURS = 12
"""Points from which what neighbours have in common can be told from chance."""


class PlaneError(ValueError):
    """Known points that fix no plane; the message is a sentence for the user."""


@dataclasses.dataclass(frozen=True, eq=False)
class Plane:
    """A map from ideal pixels to the screen's plane (X to the right, Z up, in metres).

    Attributes:
        homography: Matrix (3, 3) that takes (x, y, 1) in px to (X, Z, 1) times a factor; its Frobenius norm is 1.
        covariance: Covariance (9, 9) of the homography's entries, row by row.
        residual: Root mean square distance in m of the known points from their images on the plane.
        points: The known points (n, 2) in ideal px.
        targets: The same points (n, 2) in m.
    """

    homography: Points
    covariance: Points
    residual: float
    points: Points
    targets: Points

    @classmethod
    def fit(cls, px: ArrayLike, metres: ArrayLike, sigma_px: float | ArrayLike | None = None) -> Plane:
        """Fit the plane to known points.

        Args:
            px: Points (n, 2) in ideal pixels, n at least 4.
            metres: The same points (n, 2) on the screen in m.
            sigma_px: Standard error of ``px`` per axis in px, one for all or one per point (n,). Without it all points
                weigh the same and the error is taken from what the fit leaves, which needs a fifth point.

        Raises:
            PlaneError: Too few points, or points on a line.
        """
        seen, known = as_points(px), as_points(metres)
        _check(seen, known, sigma_px)
        # Centred and scaled coordinates keep the equations well conditioned (Hartley 1997, doi 10.1109/34.601246).
        from_metres, from_px = _scaling(known), _scaling(seen)
        start, end = _apply(from_metres, known), _apply(from_px, seen)
        sigma = 1.0 if sigma_px is None else np.asarray(sigma_px, dtype=float) * from_px[0, 0]
        weights = 1.0 / np.broadcast_to(sigma, (len(seen),))
        first, _ = cv2.findHomography(start, end, 0)
        if first is None or not np.isfinite(first).all() or abs(first[2, 2]) < 1e-9:
            raise PlaneError("the known points fix no plane; give points that do not lie on a line")
        inverse = first / first[2, 2]
        for _ in range(30):
            design, left = _linearised(inverse, start, end, weights)
            step, _, rank, singular = np.linalg.lstsq(design, left, rcond=None)
            if rank < 8 or singular[-1] < 1e-7 * singular[0]:
                raise PlaneError("the known points fix no plane; give points that do not lie on a line")
            inverse = inverse + np.append(step, 0.0).reshape(3, 3)
            if np.abs(step).max() < 1e-13:
                break
        design, left = _linearised(inverse, start, end, weights)
        covariance = np.linalg.inv(design.T @ design)
        if sigma_px is None:
            covariance *= left @ left / (2 * len(seen) - 8)
        homography, spread = _inverted(inverse, covariance, from_metres, from_px)
        missed = _apply(homography, seen) - known
        return cls(homography, spread, float(np.sqrt(np.mean(np.sum(missed**2, axis=1)))), seen, known)

    @functools.cached_property
    def systematic(self) -> float:
        """Standard error in m, per axis, of what neighbouring points miss in common: a wrong lens, a screen that is not flat.

        Noise differs from point to point, and many points take it out; this they do not. It is the root of the mean product
        of what each point misses with what its nearest neighbour misses, 0 where that is negative or the points are few.
        """
        if len(self.points) < FEWEST_NEIGHBOURS:
            return 0.0
        missed = self.to_metres(self.points) - self.targets
        nearest = cKDTree(self.targets).query(self.targets, k=2)[1][:, 1]
        return float(np.sqrt(max(0.0, np.mean(np.sum(missed * missed[nearest], axis=1)) / 2.0)))

    def to_metres(self, ideal_px: ArrayLike) -> Points:
        """Points (n, 2) on the screen in m for ideal pixels (n, 2)."""
        return _apply(self.homography, as_points(ideal_px))

    def to_pixels(self, metres: ArrayLike) -> Points:
        """Ideal pixels (n, 2) for points (n, 2) on the screen in m."""
        return _apply(np.linalg.inv(self.homography), as_points(metres))

    def jacobian(self, ideal_px: ArrayLike) -> Points:
        """Derivative (n, 2, 2) of `to_metres` in m per px; the last index is the pixel's."""
        px = as_points(ideal_px)
        below = _homogeneous(px) @ self.homography[2]
        metres = self.to_metres(px)
        top = self.homography[None, :2, :2] - metres[:, :, None] * self.homography[None, 2:, :2]
        return top / below[:, None, None]

    def covariances(self, ideal_px: ArrayLike) -> Points:
        """Covariance (n, 2, 2) in m2 that the fit's uncertainty gives a point at these pixels."""
        px = as_points(ideal_px)
        homogeneous = _homogeneous(px)
        ray = homogeneous / (homogeneous @ self.homography[2])[:, None]
        metres = self.to_metres(px)
        slope = np.zeros((len(px), 2, 9))
        slope[:, 0, 0:3] = slope[:, 1, 3:6] = ray
        slope[:, :, 6:9] = -metres[:, :, None] * ray[:, None, :]
        return slope @ self.covariance @ np.swapaxes(slope, 1, 2)


def _check(seen: Points, known: Points, sigma_px: float | ArrayLike | None) -> None:
    if len(seen) != len(known):
        raise PlaneError(f"there are {len(seen)} points in the photograph but {len(known)} on the screen")
    needed = FEWEST + (sigma_px is None)
    if len(seen) < needed:
        raise PlaneError(f"{len(seen)} known points do not fix a plane and its error; give at least {needed}")
    if not (np.isfinite(seen).all() and np.isfinite(known).all()):
        raise PlaneError("the known points must be finite numbers")
    if sigma_px is not None and not np.all(np.asarray(sigma_px, dtype=float) > 0.0):
        raise PlaneError("the standard error of the known points must be positive")


def _homogeneous(points: Points) -> Points:
    return np.column_stack([points, np.ones(len(points))])


def _apply(matrix: Points, points: Points) -> Points:
    mapped = _homogeneous(points) @ matrix.T
    return mapped[:, :2] / mapped[:, 2:]


def _scaling(points: Points) -> Points:
    """The similarity (3, 3) that brings the points' centre to 0 and their mean distance from it to about 1."""
    centre = points.mean(axis=0)
    spread = np.linalg.norm(points - centre, axis=1).mean()
    if not spread > 0.0:
        raise PlaneError("all known points are the same point; give points that do not lie on a line")
    return np.array([[1 / spread, 0, -centre[0] / spread], [0, 1 / spread, -centre[1] / spread], [0, 0, 1]])


def _linearised(matrix: Points, start: Points, end: Points, weights: Points) -> tuple[Points, Points]:
    """Weighted design (2n, 8) and what is left (2n,) for the first eight entries of a homography whose last is fixed."""
    homogeneous = _homogeneous(start)
    mapped = homogeneous @ matrix.T
    image = mapped[:, :2] / mapped[:, 2:]
    ray = homogeneous / mapped[:, 2:]
    design = np.zeros((len(start), 2, 9))
    design[:, 0, 0:3] = design[:, 1, 3:6] = ray
    design[:, :, 6:9] = -image[:, :, None] * ray[:, None, :]
    weighted = design[:, :, :8] * weights[:, None, None]
    return weighted.reshape(-1, 8), ((end - image) * weights[:, None]).ravel()


def _inverted(inverse: Points, covariance: Points, from_metres: Points, from_px: Points) -> tuple[Points, Points]:
    """The homography of norm 1 from px to m with its covariance (9, 9), from the scaled one the other way (8, 8)."""
    wide = np.zeros((9, 9))
    wide[:8, :8] = covariance
    forward = np.linalg.inv(inverse)
    back, ahead = np.linalg.inv(from_metres), from_px
    full = back @ forward @ ahead
    # d(A^-1) = -A^-1 dA A^-1, framed by the two scalings; kron works on rows laid end to end.
    slope = -np.kron(back @ forward, (forward @ ahead).T)
    norm = np.linalg.norm(full)
    unit = full.ravel() / norm
    project = (np.eye(9) - np.outer(unit, unit)) / norm
    return full / norm, project @ slope @ wide @ slope.T @ project.T
