"""What stays the same over a run of photographs, and the plane of the screen: pixels to metres."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import tomli_w
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from measurement.camera import Camera, CameraError, Points, as_points
from softmodels.common import errors, tables, units


@dataclasses.dataclass(frozen=True, eq=False)
class Setup:
    """Mapping from pixels to metres.

    Light that comes from a lamp at the distance a before the object throws a shadow (a + b) / a times as large as the
    object on a screen at the distance b behind it; lengths on the screen are divided by this magnification.

    Attributes:
        camera: The camera.
        plane: The screen.
        magnification: Size of the shadow over the size of the object.
        magnification_error: Its standard error.
        pitch_error: Standard error of the printed pitch, and so of all lengths on the screen, as a share of it.
        zero: Two points (2, 2) in m, as `to_metres` gives them, on the undeformed surface; None where unknown.
        roi: Region of interest as x0, y0, x1, y1 in px of the photograph; None for all of it.
        masks: Regions as ``roi`` in which no edge is looked for: a label, a hose, a stretch of edge that something covers.
        grid_pitch: Distance of the grid's lines in m; None where the screen's points were given.
        shadow_colour: Red, green, blue of the shadow, 0 to 255; None to find it in each photograph.
    """

    camera: Camera
    plane: Plane
    magnification: float = 1.0
    magnification_error: float = 0.0
    pitch_error: float = 0.0
    zero: Points | None = None
    roi: tuple[float, float, float, float] | None = None
    masks: tuple[tuple[float, float, float, float], ...] = ()
    grid_pitch: float | None = None
    shadow_colour: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        if not (0.0 < self.magnification < math.inf and 0.0 <= self.magnification_error < math.inf):
            raise SetupError("the magnification must be positive and its error must not be negative")
        if self.magnification_error >= self.magnification:
            raise SetupError(
                f"the magnification {self.magnification:g} +- {self.magnification_error:g} is undetermined; its error "
                "must be smaller than the value"
            )
        if not 0.0 <= self.pitch_error < 1.0:
            raise SetupError(f"the pitch's error must be a share from 0 to 1 of the pitch, not {self.pitch_error:g}")
        if self.grid_pitch is not None:
            self._check_pitch(self.grid_pitch)
        if self.zero is not None:
            zero = np.array(self.zero, dtype=float)
            if zero.shape != (2, 2) or not np.isfinite(zero).all() or np.allclose(zero[0], zero[1], atol=1e-12):
                raise SetupError("the zero line needs two different points in m")
            object.__setattr__(self, "zero", zero)
        if self.roi is not None:
            self._check_region("region of interest", self.roi)
        for mask in self.masks:
            self._check_region("mask", mask)

    def _check_region(self, what: str, region: tuple[float, float, float, float]) -> None:
        x0, y0, x1, y1 = region
        if not (0 <= x0 < x1 <= self.camera.width and 0 <= y0 < y1 <= self.camera.height):
            raise SetupError(
                f"the {what} {x0:g},{y0:g},{x1:g},{y1:g} is not x0,y0,x1,y1 inside of the picture of "
                f"{self.camera.width} x {self.camera.height} px"
            )

    def _check_pitch(self, pitch: float) -> None:
        """Reject a pitch whose lines the picture cannot show: looking for them would take all memory, or for ever."""
        if not 0.0 < pitch < math.inf:
            raise SetupError("the grid's pitch must be a positive length in m")
        width, height = self.camera.size
        columns, rows = np.meshgrid(np.linspace(0, width - 1, 9), np.linspace(0, height - 1, 9))
        places = self.plane.to_metres(self.camera.undistort(np.column_stack([columns.ravel(), rows.ravel()])))
        places = places[np.isfinite(places).all(axis=1)]
        if not len(places):
            raise SetupError("the lens correction or the screen's plane is defined nowhere in the picture")
        seen = float(np.ptp(places, axis=0).max())
        if not FINEST_PITCH * seen / max(width, height) <= pitch <= seen:
            raise SetupError(
                f"the grid's pitch of {pitch * 1e3:g} mm does not match a picture that shows {seen * 1e3:.3g} mm of the "
                f"screen in {max(width, height)} px; the setup is in m"
            )

    @property
    def scale_error(self) -> float:
        """Standard error of all lengths together, as a share of them: the magnification's and the pitch's."""
        return math.hypot(self.magnification_error / self.magnification, self.pitch_error)

    @property
    def exact_scale(self) -> Setup:
        """This setup with a scale that has no error, for errors of points against each other."""
        return dataclasses.replace(self, magnification_error=0.0, pitch_error=0.0)

    def to_metres(self, raw_px: ArrayLike) -> Points:
        """Return the points (n, 2) of the object's plane in m for pixels (n, 2) of the photograph."""
        return self.plane.to_metres(self.camera.undistort(raw_px)) / self.magnification

    def to_pixels(self, metres: ArrayLike) -> Points:
        """Return the pixels (n, 2) of the photograph for points (n, 2) of the object's plane in m."""
        return self.camera.distort(self.plane.to_pixels(as_points(metres) * self.magnification))

    def jacobian(self, raw_px: ArrayLike) -> Points:
        """Return the derivative (n, 2, 2) of `to_metres` in m per px; the last index is the pixel's."""
        raw, step = as_points(raw_px), 0.5
        lens = np.empty((len(raw), 2, 2))
        for axis in (0, 1):
            aside = step * np.eye(2)[axis]
            lens[:, :, axis] = (self.camera.undistort(raw + aside) - self.camera.undistort(raw - aside)) / (2 * step)
        return self.plane.jacobian(self.camera.undistort(raw)) @ lens / self.magnification

    def error(
        self, raw_px: ArrayLike, edge_sigma_px: ArrayLike, normal: ArrayLike | None = None, about: ArrayLike | None = None
    ) -> Points:
        """Return the standard error (n,) in m of points on an edge: edge, lens, grid fit and scale together.

        Args:
            raw_px: Points (n, 2) in px of the photograph.
            edge_sigma_px: Standard error of the edge's place across the edge in px, one for all or one per point (n,).
            normal: Directions (n, 2) or (2,) across the edge in the plane of X and Z, of any length. Without them the
                result is the root mean square over all directions.
            about: Point (2,) in m from which lengths are measured, where a wrong magnification does no harm; the middle
                of the zero line, or (0, 0), unless given.
        """
        raw = as_points(raw_px)
        slope = self.jacobian(raw)
        sigma = np.broadcast_to(np.asarray(edge_sigma_px, dtype=float), (len(raw),))
        # An error e across the edge in the photograph moves it by |J^T n| e across the edge on the screen, so that the
        # edge may be treated as if it were uncertain in all directions.
        pixel = (sigma**2 + self.camera.error(raw) ** 2)[:, None, None]
        spread = pixel * (slope @ np.swapaxes(slope, 1, 2))
        spread += self.plane.covariances(self.camera.undistort(raw)) / self.magnification**2
        spread += (self.plane.systematic / self.magnification) ** 2 * np.eye(2)
        if about is None:
            about = np.zeros(2) if self.zero is None else self.zero.mean(axis=0)
        arm = (self.to_metres(raw) - np.asarray(about, dtype=float)) * self.scale_error
        spread += arm[:, :, None] * arm[:, None, :]
        if normal is None:
            return np.sqrt(np.trace(spread, axis1=1, axis2=2) / 2.0)
        across = np.broadcast_to(np.asarray(normal, dtype=float), (len(raw), 2))
        across = across / np.linalg.norm(across, axis=1, keepdims=True)
        return np.sqrt(np.einsum("ni,nij,nj->n", across, spread, across))

    def to_toml(self) -> str:
        """Return the setup as TOML; `from_toml` gives exactly the same numbers back."""
        table: dict[str, Any] = {"version": FILE_VERSION}
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if value is not None and field.name not in ("camera", "plane") and np.size(value):
                table[field.name] = np.asarray(value, dtype=float).tolist()
        table["camera"] = self.camera.as_table()
        table["plane"] = {name: np.asarray(getattr(self.plane, name)).tolist() for name in _PLANE}
        return HEADER + tomli_w.dumps(table)

    @classmethod
    def from_toml(cls, text: str) -> Setup:
        """Read what `to_toml` wrote.

        Raises:
            SetupError: No TOML, or a field that is missing, unknown or not what it should be.
        """
        try:
            return cls._from_table(tables.parse_toml(text))
        except tables.TomlError as error:
            raise SetupError(f"the setup {error}") from None

    @classmethod
    def from_file(cls, path: Path | str) -> Setup:
        """Read a setup file.

        Raises:
            SetupError: The file cannot be read or holds no setup; the message names it.
        """
        try:
            return cls._from_table(tables.read_toml(Path(path)))
        except tables.TomlError as error:
            raise SetupError(f"{path} {error}") from None
        except SetupError as error:
            raise SetupError(f"{path}: {error}") from None

    @classmethod
    def _from_table(cls, table: Mapping[str, Any]) -> Setup:
        if table.get("version", FILE_VERSION) != FILE_VERSION:
            raise SetupError(
                f"the setup is of version {units.brief(table['version'])}, this program reads version {FILE_VERSION}; recreate "
                "it with softmodels measure setup"
            )
        known = {"version"} | {field.name for field in dataclasses.fields(cls)}
        for name in table:
            if name not in known:
                raise SetupError(f"the setup has an unknown field {name!r}; {errors.known_are(name, sorted(known))}")
        try:
            needed = {"camera": Camera.from_table(table["camera"]), "plane": _plane(table["plane"])}
            others = table.keys() - {"version", *needed}
            return cls(**needed, **{name: _READ.get(name, _float)(table[name]) for name in others})  # type: ignore[arg-type]
        except KeyError as error:
            raise SetupError(f"the setup has no field {error}; recreate it with softmodels measure setup") from None
        except CameraError as error:
            raise SetupError(f"the setup's camera cannot be used: {error}") from None
        except SetupError:
            raise
        except (TypeError, ValueError, AttributeError, IndexError) as error:
            raise SetupError(f"the setup cannot be read: {error}") from None


class SetupError(ValueError):
    """An unusable setup; the message is for the user."""


PITCH_ERROR = 0.002
"""Standard error of a pitch as a share of it where none is given: printers scale by some tenths of a percent."""


def _float(value: Any) -> float:
    """Return a number of any kind; whether it is finite is asked by its name."""
    return value if isinstance(value, float) else units.number(value)


def _region(values: Any) -> tuple[float, float, float, float]:
    if len(values) != 4:
        raise SetupError("the setup's roi needs four numbers, and so does each of its masks")
    x0, y0, x1, y1 = map(_float, values)
    return x0, y0, x1, y1


def _colour(values: Any) -> tuple[float, ...]:
    if len(values) != 3:
        raise SetupError("the setup's shadow_colour needs three numbers")
    return tuple(map(_float, values))


_READ: dict[str, Callable[[Any], Any]] = {
    "zero": tables.numbers, "roi": _region, "masks": lambda masks: tuple(map(_region, masks)), "shadow_colour": _colour,
}  # fmt: skip
"""How fields of a setup's file are read that are no single numbers."""
_PLANE = {"homography": (3, 3), "covariance": (9, 9), "residual": (), "points": (-1, 2), "targets": (-1, 2)}
"""Shapes of a plane's fields in the file."""


def _plane(table: Mapping[str, Any]) -> Plane:
    arrays = {name: tables.numbers(table[name]).reshape(shape) for name, shape in _PLANE.items() if shape}
    residual = _float(table["residual"])
    if not (all(np.isfinite(array).all() for array in arrays.values()) and math.isfinite(residual)):
        raise SetupError("the setup's plane holds numbers that are not finite")
    if abs(np.linalg.det(arrays["homography"] / np.abs(arrays["homography"]).max())) == 0.0:
        raise SetupError("the setup's homography cannot be inverted")
    return Plane(residual=residual, **arrays)


def magnification(lamp: float, screen: float, lamp_error: float = 0.0, screen_error: float = 0.0) -> tuple[float, float]:
    """Return the magnification of a shadow and its standard error, from the distances in m, with errors, from the lamp to
    the object and from the object to the screen."""
    if not (lamp > 0.0 and screen >= 0.0 and lamp_error >= 0.0 and screen_error >= 0.0):
        raise SetupError("the lamp's distance must be positive, the screen's and all errors must not be negative")
    return (lamp + screen) / lamp, math.hypot(screen_error / lamp, screen * lamp_error / lamp**2)


# ----------------------------------------------------------------------------------------------------------------------
# The screen's plane: a homography from ideal pinhole pixels to metres, with the covariance of its fit.
#
# The known points are exact on the screen and uncertain in the photograph, so the fit minimises distances in pixels
# (the "gold standard" of Hartley and Zisserman, Multiple View Geometry, 2nd ed., section 4.2, with errors in one image
# only); the map from pixels to metres is the inverse of what is fitted.


MIN_POINTS = 4
"""Points that fix a homography; a fifth is the first that can contradict it."""

FEWEST_NEIGHBOURS = 12
"""Points from which what neighbours have in common can be told from chance."""


class PlaneError(ValueError):
    """Known points that do not determine a plane; the message is for the user."""


@dataclasses.dataclass(frozen=True, eq=False)
class Plane:
    """A map from ideal pixels to the screen's plane (X to the right, Z up, in metres).

    Attributes:
        homography: Matrix (3, 3) that takes (x, y, 1) in px to (X, Z, 1) times a factor; its Frobenius norm is 1.
        covariance: Covariance (9, 9) of the homography's entries, row by row.
        residual: Root mean square distance in m of the known points from their images on the plane.
        points, targets: The known points (n, 2) in ideal px and in m.
    """

    homography: Points
    covariance: Points
    residual: float
    points: Points
    targets: Points

    @classmethod
    def fit(cls, px: ArrayLike, metres: ArrayLike, sigma_px: float | ArrayLike | None = None) -> Plane:
        """Fit the plane to four or more known points (n, 2) in ideal px and on the screen in m; `PlaneError` for too few, or
        points on a line.

        ``sigma_px`` is the standard error per axis in px, one for all or one per point (n,). Without it all points weigh the
        same and the error is taken from what the fit leaves, which needs a fifth point.
        """
        seen, known = as_points(px), as_points(metres)
        if len(seen) != len(known):
            raise PlaneError(f"there are {len(seen)} points in the photograph but {len(known)} on the screen")
        needed = MIN_POINTS + (sigma_px is None)
        if len(seen) < needed:
            raise PlaneError(f"{len(seen)} known points do not fix a plane and its error; give at least {needed}")
        if not (np.isfinite(seen).all() and np.isfinite(known).all()):
            raise PlaneError("the known points must be finite numbers")
        if sigma_px is not None and not np.all(np.asarray(sigma_px, dtype=float) > 0.0):
            raise PlaneError("the standard error of the known points must be positive")
        # Centred and scaled coordinates keep the equations well conditioned (Hartley 1997, doi 10.1109/34.601246).
        from_metres, from_px = _scaling(known), _scaling(seen)
        start, end = _apply(from_metres, known), _apply(from_px, seen)
        sigma = 1.0 if sigma_px is None else np.asarray(sigma_px, dtype=float) * from_px[0, 0]
        weights = 1.0 / np.broadcast_to(sigma, (len(seen),))
        first, _ = cv2.findHomography(start, end, 0)
        if first is None or not np.isfinite(first).all() or abs(first[2, 2]) < 1e-9:
            raise PlaneError("the known points do not determine a plane; give points that do not lie on a line")
        inverse = first / first[2, 2]
        for _ in range(30):
            design, left = _linearised_design(inverse, start, end, weights)
            step, _, rank, singular = np.linalg.lstsq(design, left, rcond=None)
            if rank < 8 or singular[-1] < 1e-7 * singular[0]:
                raise PlaneError("the known points do not determine a plane; give points that do not lie on a line")
            inverse = inverse + np.append(step, 0.0).reshape(3, 3)
            if np.abs(step).max() < 1e-13:
                break
        design, left = _linearised_design(inverse, start, end, weights)
        covariance = np.linalg.inv(design.T @ design)
        if sigma_px is None:
            covariance *= left @ left / (2 * len(seen) - 8)
        homography, spread = _inverted_homography(inverse, covariance, from_metres, from_px)
        missed = _apply(homography, seen) - known
        return cls(homography, spread, float(np.sqrt(np.mean(np.sum(missed**2, axis=1)))), seen, known)

    @functools.cached_property
    def systematic(self) -> float:
        """Standard error in m, per axis, of the error common to neighbouring points: a wrong lens, a screen that is not flat.

        Noise differs from point to point, and many points take it out; this they do not. It is the root of the mean product
        of what each point misses with what its nearest neighbour misses, 0 where that is negative or the points are few.
        """
        if len(self.points) < FEWEST_NEIGHBOURS:
            return 0.0
        missed = self.to_metres(self.points) - self.targets
        nearest = cKDTree(self.targets).query(self.targets, k=2)[1][:, 1]
        return float(np.sqrt(max(0.0, np.mean(np.sum(missed * missed[nearest], axis=1)) / 2.0)))

    def to_metres(self, ideal_px: ArrayLike) -> Points:
        """Return the points (n, 2) on the screen in m for ideal pixels (n, 2)."""
        return _apply(self.homography, as_points(ideal_px))

    def to_pixels(self, metres: ArrayLike) -> Points:
        """Return the ideal pixels (n, 2) for points (n, 2) on the screen in m."""
        return _apply(np.linalg.inv(self.homography), as_points(metres))

    def jacobian(self, ideal_px: ArrayLike) -> Points:
        """Return the derivative (n, 2, 2) of `to_metres` in m per px; the last index is the pixel's."""
        px = as_points(ideal_px)
        below = _homogeneous(px) @ self.homography[2]
        metres = self.to_metres(px)
        top = self.homography[None, :2, :2] - metres[:, :, None] * self.homography[None, 2:, :2]
        return top / below[:, None, None]

    def covariances(self, ideal_px: ArrayLike) -> Points:
        """Return the covariance (n, 2, 2) in m2 that the fit's uncertainty gives a point at these pixels."""
        px = as_points(ideal_px)
        homogeneous = _homogeneous(px)
        ray = homogeneous / (homogeneous @ self.homography[2])[:, None]
        metres = self.to_metres(px)
        slope = np.zeros((len(px), 2, 9))
        slope[:, 0, 0:3] = slope[:, 1, 3:6] = ray
        slope[:, :, 6:9] = -metres[:, :, None] * ray[:, None, :]
        variances, ways = np.linalg.eigh(self.covariance)
        spread = slope @ (ways * np.sqrt(np.maximum(variances, 0.0)))  # squared, so that no rounding makes it negative
        return np.asarray(spread @ np.swapaxes(spread, 1, 2))


def _homogeneous(points: Points) -> Points:
    return np.column_stack([points, np.ones(len(points))])


def _apply(matrix: Points, points: Points) -> Points:
    mapped = _homogeneous(points) @ matrix.T
    return mapped[:, :2] / mapped[:, 2:]


def _scaling(points: Points) -> Points:
    """Return the similarity (3, 3) that brings the points' centre to 0 and their mean distance from it to about 1."""
    centre = points.mean(axis=0)
    spread = np.linalg.norm(points - centre, axis=1).mean()
    if not spread > 0.0:
        raise PlaneError("all known points are the same point; give points that do not lie on a line")
    return np.array([[1 / spread, 0, -centre[0] / spread], [0, 1 / spread, -centre[1] / spread], [0, 0, 1]])


def _linearised_design(matrix: Points, start: Points, end: Points, weights: Points) -> tuple[Points, Points]:
    """Return the weighted design (2n, 8) and what is left (2n,) for the first eight entries of a homography whose last is
    fixed."""
    homogeneous = _homogeneous(start)
    mapped = homogeneous @ matrix.T
    image = mapped[:, :2] / mapped[:, 2:]
    ray = homogeneous / mapped[:, 2:]
    design = np.zeros((len(start), 2, 9))
    design[:, 0, 0:3] = design[:, 1, 3:6] = ray
    design[:, :, 6:9] = -image[:, :, None] * ray[:, None, :]
    weighted = design[:, :, :8] * weights[:, None, None]
    return weighted.reshape(-1, 8), ((end - image) * weights[:, None]).ravel()


def _inverted_homography(inverse: Points, covariance: Points, from_metres: Points, from_px: Points) -> tuple[Points, Points]:
    """Return the homography of norm 1 from px to m with its covariance (9, 9), from the scaled one the other way (8, 8)."""
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


# ----------------------------------------------------------------------------------------------------------------------
# The screen's plane from a user's data of a photograph without a grid: positions of some points, or only the scale.


CLICK_ERROR_PX = 1.0
"""Standard error in px of a point that a person picked, where four points leave nothing to tell it."""

WORST_PX, WORST_SHARE = 4.0, 0.005
"""Largest miss of a known point: in px, or as a share of the points' extent in the picture if that is more."""

MIN_TRIANGLE_HEIGHT = 0.03
"""Least height of a triangle over its longest side that some three points must make for them not to be on one line."""


def plane_of_points(camera: Camera, px: Points, metres: Points) -> Plane:
    """Fit the plane to four or more known points (n, 2) in px of the photograph and on the screen in m, X to the right and
    Z up. Raises `PlaneError` for too few, or points given twice, on one line, mirrored, or exchanged with each other."""
    seen, known = as_points(px), as_points(metres)
    if len(seen) < 4:
        raise PlaneError(f"{len(seen)} known points do not determine a plane; give at least 4, and 6 to see how well they fit")
    outside = ~np.all((seen >= -0.5) & (seen <= [camera.width - 0.5, camera.height - 0.5]), axis=1)
    if outside.any():
        raise PlaneError(f"the known point at {_name(seen[outside][0])} is outside the picture")
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
        plane = Plane.fit(ideal, known, CLICK_ERROR_PX if len(seen) == 4 else None)
    except PlaneError:  # they lie on no line, as was seen above
        raise PlaneError("the known points do not fit a plane; check for points that were exchanged or mistyped") from None
    below = np.column_stack([ideal, np.ones(len(ideal))]) @ plane.homography[2]
    missed = np.linalg.norm(plane.to_pixels(known) - ideal, axis=1)
    if np.ptp(np.sign(below)) > 0 or missed.max() > max(WORST_PX, WORST_SHARE * float(np.ptp(seen, axis=0).max())):
        worst = int(np.argmax(missed))
        raise PlaneError(
            f"the known points do not fit a plane: the one at {_name(seen[worst])} has a residual of {missed[worst]:.0f} px; "
            f"check for points that were exchanged or mistyped"
        )
    if np.linalg.det(plane.jacobian(ideal.mean(axis=0))[0]) > 0.0:
        raise PlaneError("the known points are mirrored; X counts to the right and Z upwards, y in the picture downwards")
    return plane


def plane_of_scale(camera: Camera, scale: float, error: float = 0.0, origin: tuple[float, float] | None = None) -> Plane:
    """Return the plane of a camera that looks straight at it, at a scale with its error in pixels per metre; the pixel
    ``origin``, the middle of the picture unless given, is X = Z = 0. Raises `PlaneError` for no positive scale."""
    if not (0.0 < scale < np.inf and 0.0 <= error < scale):
        raise PlaneError("the scale must be a positive number of pixels per metre, larger than its error")
    width, height = camera.size
    x, y = camera.undistort(((width - 1) / 2, (height - 1) / 2) if origin is None else origin)[0]
    # Times the scale, so that only the last entry depends on it.
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
            if np.sum(np.abs(offset) > MIN_TRIANGLE_HEIGHT * extent) < 2:
                raise PlaneError("at most one of the known points is off a common line; add points beside it")


def _name(pixel: Points) -> str:
    return f"{pixel[0]:g},{pixel[1]:g}"


# ----------------------------------------------------------------------------------------------------------------------
# What stays the same over a run of photographs: camera, screen, light, region and zero line; kept in one TOML file.


FILE_VERSION = 1
"""Version of the setup file; one that means something else by its numbers gets another."""

FINEST_PITCH = 4.0
"""Pixels between two lines that can be told apart."""

HEADER = "# Setup of a run of photographs, lengths in m and pixels as (x, y); made by softmodels measure setup.\n"
