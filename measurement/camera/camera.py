"""A camera as a map between the pixels of a photograph and those of an ideal pinhole.

Pixels are (x, y) with the centre of the first pixel at (0, 0), as in OpenCV. Photographs are never warped: only points
travel through the lens, so that no resampling blurs an edge before it is measured.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from softmodels.common.tables import numbers
from softmodels.common.units import brief, number

Points = NDArray[np.float64]

MODELS = {"opencv": (0, 4, 5, 8, 12, 14), "lensfun": (8,)}
"""Known lens models and the numbers of coefficients each may have."""

ROUND_TRIP = 0.01
"""Round-trip tolerance of distortion and undistortion in px."""


class CameraError(ValueError):
    """An unusable camera, lens or calibration; the message is for the user."""


@dataclasses.dataclass(frozen=True, eq=False)
class Camera:
    """Data of a camera at one focal length and focus.

    Attributes:
        matrix: Pinhole matrix (3, 3) in px: focal lengths and principal point.
        distortion: Coefficients of the lens; none for a perfect lens. Model ``opencv``: k1, k2, p1, p2, k3, ... in
            OpenCV's order. Model ``lensfun``: unit of radius (px), centre x and y (px), k0 to k4, where an ideal point at
            the distance r units from the centre appears at r (k0 + k1 r + k2 r^2 + k3 r^3 + k4 r^4); lensfun's models
            ptlens, poly3 and poly5 are all of this kind.
        width: Pixels in a row.
        height: Rows.
        source: Where the numbers come from, for people.
        error_px: Standard error in px of an undistorted point, per axis, after a homography has taken its share.
        model: ``opencv`` or ``lensfun``.
        errors_px: The same error by distance from the frame's middle, (k,) values at equal steps out to its corners; empty
            where it is not known so closely. A calibration is worth little where its boards did not reach.
    """

    matrix: Points
    distortion: Points
    width: int
    height: int
    source: str
    error_px: float
    model: str = "opencv"
    errors_px: Points = dataclasses.field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        matrix = np.array(self.matrix, dtype=float)
        distortion = np.array(self.distortion, dtype=float).ravel()
        if matrix.shape != (3, 3) or not np.isfinite(matrix).all() or min(matrix[0, 0], matrix[1, 1]) <= 0.0:
            raise CameraError("the camera's matrix must be 3 x 3 with positive focal lengths")
        if self.model not in MODELS or distortion.size not in MODELS[self.model]:
            raise CameraError(f"a lens of the model {self.model!r} cannot have {distortion.size} coefficients")
        if not np.isfinite(distortion).all() or not math.isfinite(self.error_px) or self.error_px < 0.0:
            raise CameraError("the lens' coefficients and its error must be finite numbers")
        if self.width < 1 or self.height < 1:
            raise CameraError("the camera's width and height must be at least one pixel")
        errors = np.array(self.errors_px, dtype=float).ravel()
        if not (np.isfinite(errors).all() and np.all(errors >= 0.0) and errors.size != 1):
            raise CameraError("the lens' errors by distance must be finite numbers, two or more of them")
        for name, value in (("matrix", matrix), ("distortion", distortion), ("errors_px", errors)):
            value.flags.writeable = False
            object.__setattr__(self, name, value)

    @classmethod
    def ideal(cls, width: int, height: int, focal_px: float | None = None) -> Camera:
        """Return a camera without distortion, the principal point in the middle of the picture.

        Args:
            width: Pixels in a row.
            height: Rows.
            focal_px: Focal length in px; unknown, it is taken as 1.2 times the longer side. A plane's homography absorbs
                it, so that lengths on the screen do not depend on it.
        """
        focal = 1.2 * max(width, height) if focal_px is None else focal_px
        matrix = np.array([[focal, 0.0, (width - 1) / 2], [0.0, focal, (height - 1) / 2], [0.0, 0.0, 1.0]])
        return cls(matrix, np.zeros(0), width, height, "no lens correction", 0.0)

    def distort(self, points: ArrayLike) -> Points:
        """Return where ideal pinhole pixels (n, 2) are seen in the photograph (n, 2), in px."""
        ideal = as_points(points)
        if self.distortion.size == 0 or ideal.size == 0:
            return ideal.copy()
        if self.model == "lensfun":
            unit, centre, powers = self.distortion[0], self.distortion[1:3], self.distortion[3:]
            offset = ideal - centre
            return centre + offset * _polynomial(powers, np.linalg.norm(offset, axis=1) / unit)[:, None]
        rays = np.column_stack([(ideal - self.matrix[:2, 2]) / np.diag(self.matrix)[:2], np.ones(len(ideal))])
        seen, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), self.matrix, self.distortion)
        return seen.reshape(-1, 2)

    def undistort(self, points: ArrayLike) -> Points:
        """Return the ideal pinhole pixels (n, 2) of points (n, 2) seen in the photograph, in px; the inverse of `distort`.

        Points that no ray reaches under the lens model, far outside the calibrated field, come back as NaN.
        """
        raw = as_points(points)
        if self.distortion.size == 0 or raw.size == 0:
            return raw.copy()
        if self.model == "lensfun":
            ideal = self._undistort_radially(raw)
        else:
            stop = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 200, 1e-12)
            ideal = cv2.undistortPoints(
                raw.reshape(-1, 1, 2), self.matrix, self.distortion, P=self.matrix, criteria=stop
            ).reshape(-1, 2)
        with np.errstate(invalid="ignore", over="ignore"):
            missed = np.linalg.norm(self.distort(ideal) - raw, axis=1)
        ideal[~(missed < ROUND_TRIP)] = np.nan
        return ideal

    def _undistort_radially(self, raw: Points) -> Points:
        unit, centre, powers = self.distortion[0], self.distortion[1:3], self.distortion[3:]
        offset = raw - centre
        seen = np.linalg.norm(offset, axis=1) / unit
        slopes = powers * np.arange(1, powers.size + 1)  # derivative of r times the polynomial
        radius = seen / powers[0]
        with np.errstate(all="ignore"):
            for _ in range(30):
                step = (radius * _polynomial(powers, radius) - seen) / _polynomial(slopes, radius)
                radius = radius - step
                if np.nanmax(np.abs(step), initial=0.0) < 1e-14:
                    break
            factor = np.where(seen > 1e-12, radius / seen, 1.0 / powers[0])
        return centre + offset * factor[:, None]

    def error(self, points: ArrayLike) -> Points:
        """Return the standard error (n,) in px of the undistorted places of points (n, 2) in the photograph, per axis."""
        raw = as_points(points)
        if self.errors_px.size == 0:
            return np.full(len(raw), self.error_px)
        middle = (np.array([self.width, self.height]) - 1.0) / 2.0
        far = np.linalg.norm(raw - middle, axis=1) / np.linalg.norm(middle)
        return np.interp(far, np.linspace(0.0, 1.0, self.errors_px.size), self.errors_px)

    def as_table(self) -> dict[str, Any]:
        """Plain numbers, lists and texts, as a TOML file holds them; `from_table` restores the camera exactly."""
        return {
            "model": self.model,
            "source": self.source,
            "width": self.width,
            "height": self.height,
            "error_px": float(self.error_px),
            "matrix": self.matrix.tolist(),
            "distortion": self.distortion.tolist(),
            **({"errors_px": self.errors_px.tolist()} if self.errors_px.size else {}),
        }

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> Camera:
        """Read what `as_table` wrote.

        Raises:
            CameraError: A field is missing or not what it should be.
        """
        try:
            return cls(
                matrix=numbers(table["matrix"]),
                distortion=numbers(table["distortion"]),
                width=_whole(table["width"]),
                height=_whole(table["height"]),
                source=str(table["source"]),
                error_px=number(table["error_px"]),
                model=str(table["model"]),
                errors_px=numbers(table.get("errors_px", [])),
            )
        except KeyError as error:
            raise CameraError(f"the camera's table has no field {error}; recreate it with calibrate or setup") from None
        except TypeError as error:
            raise CameraError(f"the camera's table cannot be read: {error}") from None
        except ValueError as error:
            if isinstance(error, CameraError):
                raise
            raise CameraError(f"the camera's table cannot be read: {error}") from None


def _whole(value: Any) -> int:
    read = number(value)
    if read != round(read):
        raise ValueError(f"{brief(value)} is not a whole number of pixels")
    return round(read)


def as_points(points: ArrayLike) -> Points:
    """Return the points as a float array (n, 2); one point may come as a pair."""
    return np.asarray(points, dtype=float).reshape(-1, 2)


def frame_points(width: int, height: int, count: int = 21) -> Points:
    """Return a regular lattice of ``count`` by ``count`` pixels over the whole frame, (count^2, 2)."""
    x, y = np.meshgrid(np.linspace(0.0, width - 1.0, count), np.linspace(0.0, height - 1.0, count))
    return np.column_stack([x.ravel(), y.ravel()])


def beyond_projection(start: Points, end: Points) -> Points:
    """Return what is left (n, 2) of the way from one set of points to another after the best homography, in px.

    Only this part of a lens' distortion matters here: a homography is fitted to the screen's grid anyway.
    """
    homography, _ = cv2.findHomography(start, end, 0)
    return cv2.perspectiveTransform(start.reshape(-1, 1, 2), homography).reshape(-1, 2) - end


def _polynomial(powers: Points, radius: Points) -> Points:
    return np.asarray(np.polynomial.polynomial.polyval(radius, powers), dtype=np.float64)
