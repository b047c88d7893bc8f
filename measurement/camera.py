"""A camera as a map between the pixels of a photograph and those of an ideal pinhole.

Pixels are (x, y) with the centre of the first pixel at (0, 0), as in OpenCV. Photographs are never warped: only points
travel through the lens, so that no resampling blurs an edge before it is measured.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import ExifTags

from measurement import pictures
from softmodels.common import errors, files, tables, units

if TYPE_CHECKING:
    import lensfunpy


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

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in px."""
        return self.width, self.height

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
        middle = (np.array(self.size) - 1.0) / 2.0
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
                matrix=tables.numbers(table["matrix"]),
                distortion=tables.numbers(table["distortion"]),
                width=_whole_number(table["width"]),
                height=_whole_number(table["height"]),
                source=str(table["source"]),
                error_px=units.number(table["error_px"]),
                model=str(table["model"]),
                errors_px=tables.numbers(table.get("errors_px", [])),
            )
        except KeyError as error:
            raise CameraError(f"the camera's table has no field {error}; recreate it with calibrate or setup") from None
        except CameraError:
            raise
        except (TypeError, ValueError) as error:
            raise CameraError(f"the camera's table cannot be read: {error}") from None


Points = NDArray[np.float64]

MODELS = {"opencv": (0, 4, 5, 8, 12, 14), "lensfun": (8,)}
"""Known lens models and the numbers of coefficients each may have."""

ROUND_TRIP = 0.01
"""Round-trip tolerance of distortion and undistortion in px."""


class CameraError(ValueError):
    """An unusable camera, lens or calibration; the message is for the user."""


def _whole_number(value: Any) -> int:
    read = units.number(value)
    if read != round(read):
        raise ValueError(f"{units.brief(value)} is not a whole number of pixels")
    return round(read)


def as_points(points: ArrayLike) -> Points:
    """Return the points as a float array (n, 2); one point may come as a pair."""
    return np.asarray(points, dtype=float).reshape(-1, 2)


def frame_points(width: int, height: int, count: int = 21) -> Points:
    """Return a regular lattice of ``count`` by ``count`` pixels over the whole frame, (count^2, 2)."""
    x, y = np.meshgrid(np.linspace(0.0, width - 1.0, count), np.linspace(0.0, height - 1.0, count))
    return np.column_stack([x.ravel(), y.ravel()])


def _polynomial(powers: Points, radius: Points) -> Points:
    return np.asarray(np.polynomial.polynomial.polyval(radius, powers), dtype=np.float64)


# ----------------------------------------------------------------------------------------------------------------------
# Lens profiles of the lensfun project, found by EXIF data or by name.
#
# lensfun moves pixels with three radial models (ptlens, poly3, poly5). All are a polynomial in the radius, so its own map,
# sampled over the frame, is repeated by five coefficients: nothing of lensfun's scaling by crop factor and aspect ratio has
# to be copied here, and the residual of that fit shows whether it is valid.


FULL_FRAME_DIAGONAL = math.hypot(36.0, 24.0)
"""Diagonal in mm of the frame that a crop factor of one means."""

FIT_LIMIT = 0.3
"""Largest difference in px between lensfun's map and ours."""

PROFILE_SHARE = 0.1
"""Standard error of a profile as a share of what it corrects.

A profile was measured on another copy of the lens, mostly at another focus distance; neighbouring entries of the database
for the same lens differ by about this much. A calibration from chessboards has no such guess.
"""

ASSUMED_APERTURE, ASSUMED_DISTANCE = 8.0, 1000.0
"""f-number and focus distance in m that lensfun asks for; its geometry depends on neither."""

ZOOM_STEP = 0.1
"""Share by which neighbouring focal lengths differ whose distortion tells a profile's error."""


@dataclasses.dataclass(frozen=True)
class Exif:
    """A photograph's camera by its EXIF data; texts may be empty, the focal length in mm None."""

    maker: str
    camera: str
    lens: str
    focal_mm: float | None = None


def read_exif(path: Path | str) -> Exif:
    """Read camera, lens and focal length; `CameraError` if the file is no picture or does not name its camera."""
    try:
        with pictures.opened(Path(path)) as image:
            head = image.getexif()
            body = head.get_ifd(ExifTags.IFD.Exif)
    except (OSError, SyntaxError, ValueError) as error:
        raise CameraError(f"{path} cannot be read as a photograph: {errors.reason(error)}") from None
    camera = _text(head.get(ExifTags.Base.Model))
    if not camera:
        raise CameraError(f"{path} does not name its camera (no EXIF); give the camera and the lens by name")
    return Exif(
        maker=_text(head.get(ExifTags.Base.Make)),
        camera=camera,
        lens=_text(body.get(ExifTags.Base.LensModel)),
        focal_mm=_number(body.get(ExifTags.Base.FocalLength)),
    )


def lens_profile(
    names: Exif | Path | str,
    width: int,
    height: int,
    *,
    lens: str | None = None,
    focal_mm: float | None = None,
    database: Path | str | None = None,
) -> Camera:
    """Return the camera that lensfun's database, or an XML file in its format, describes for photographs of a width and
    height in px.

    ``names`` is a photograph whose EXIF names camera, lens and focal length in mm, or these names; ``lens`` and ``focal_mm``
    count over it. Raises `CameraError` where one is missing or unknown, or the profile has no usable distortion.
    """
    known = names if isinstance(names, Exif) else read_exif(names)
    wanted, focal = lens or known.lens, focal_mm or known.focal_mm
    if not wanted:
        raise CameraError("the photograph does not name its lens; give the lens by name")
    if not focal:
        raise CameraError("the photograph has no focal length (EXIF); give it in mm")
    body, glass = _find(known.maker, known.camera, wanted, database)
    if not glass.min_focal * 0.99 <= focal <= glass.max_focal * 1.01:
        raise CameraError(f"the lens {glass.model} goes from {glass.min_focal:g} to {glass.max_focal:g} mm, not {focal:g} mm")
    lensfunpy = _lensfun()
    if glass.type != lensfunpy.LensType.RECTILINEAR:
        raise CameraError(f"the lens {glass.model} is not a rectilinear lens; calibrate it from chessboards")
    calibration = glass.interpolate_distortion(focal)
    if calibration is None or calibration.model == lensfunpy.DistortionModel.NONE:
        raise CameraError(f"lensfun has the lens {glass.model} but not its distortion; calibrate it from chessboards")
    # A zoom's distortion changes sign somewhere; right there the profile names none, and its neighbours tell its error.
    near = np.clip(np.array([1.0, 1.0 - ZOOM_STEP, 1.0 + ZOOM_STEP]) * focal, glass.min_focal, glass.max_focal)
    cameras = [_at_focal(body, glass, float(length), width, height) for length in near]
    ideal = frame_points(width, height)
    bends = []
    for camera in cameras:
        # A homography is fitted to the screen's grid anyway, so only what it leaves of the distortion matters.
        seen = camera.distort(ideal)
        left = cv2.perspectiveTransform(ideal.reshape(-1, 1, 2), cv2.findHomography(ideal, seen, 0)[0]).reshape(-1, 2) - seen
        bends.append(np.sqrt(np.mean(left**2)))
    return dataclasses.replace(cameras[0], error_px=PROFILE_SHARE * float(max(bends)))


def _at_focal(body: lensfunpy.Camera, glass: lensfunpy.Lens, focal: float, width: int, height: int) -> Camera:
    """Return the camera at one focal length in mm, without its error."""
    lensfun = _lensfun()
    modifier = lensfun.Modifier(glass, body.crop_factor, width, height)
    modifier.initialize(focal, ASSUMED_APERTURE, ASSUMED_DISTANCE, scale=1.0, flags=lensfun.ModifyFlags.DISTORTION)
    unit, size = 0.5 * math.hypot(width, height), min(width, height) - 1
    centre = np.array([(width - 1 + glass.center_x * size) / 2, (height - 1 + glass.center_y * size) / 2])
    ideal = frame_points(width, height)
    maps = [modifier.apply_geometry_distortion(x, y, 1, 1) for x, y in ideal]
    if maps[0] is None:
        raise CameraError("lensfun gives no distortion for this lens at this focal length; calibrate it from chessboards")
    powers = _radial_fit(ideal, np.array([nearest_entry[0, 0] for nearest_entry in maps], dtype=float), centre, unit)
    pixel = math.hypot(width, height) * body.crop_factor / FULL_FRAME_DIAGONAL  # px per mm on the sensor
    matrix = np.array([[focal * pixel, 0, (width - 1) / 2], [0, focal * pixel, (height - 1) / 2], [0, 0, 1]])
    coefficients = np.concatenate([[unit], centre, powers])
    source = f"lensfun: {body.model}, {glass.model} at {focal:g} mm"
    return Camera(matrix, coefficients, width, height, source, 0.0, "lensfun")


def _lensfun() -> Any:
    """Return the library, loaded where it is asked for: it links against GLib, which a bare machine does not have and nothing
    else needs."""
    try:
        import lensfunpy
    except ImportError as error:
        raise CameraError(
            f"lensfun's library cannot be loaded ({error}); install GLib (libglib2.0-0 on Debian), calibrate the lens "
            "from chessboards, or skip the correction with --lens none"
        ) from None
    return lensfunpy


def _find(maker: str, camera: str, lens: str, database: Path | str | None) -> tuple[lensfunpy.Camera, lensfunpy.Lens]:
    known = _lensfun().Database(load_common=False) if database is None else _database_file(Path(database))
    bodies = known.find_cameras(maker or None, camera) or known.find_cameras(None, camera)
    if not bodies:
        raise CameraError(f"lensfun does not have the camera {maker} {camera}; check its name or calibrate it")
    # The search is by likeness; a lens with other numbers in its name (focal lengths, stops) is another lens.
    alike = [
        known_lens
        for known_lens in known.find_lenses(bodies[0], None, lens)
        if set(_numbers(lens)) <= set(_numbers(known_lens.model)) or set(_numbers(known_lens.model)) == set(_numbers(lens))
    ]
    if not alike:
        raise CameraError(f"lensfun does not have the lens {lens} for the {bodies[0].model}; check its name or calibrate")
    exact = [known_lens for known_lens in alike if _plain(known_lens.model) == _plain(lens)]
    return bodies[0], (exact or alike)[0]


def _database_file(path: Path) -> lensfunpy.Database:
    try:
        text = files.read_text(path)
    except (OSError, UnicodeDecodeError) as error:
        raise CameraError(f"the lens profile {path} cannot be read: {errors.reason(error)}") from None
    lensfunpy = _lensfun()
    # Files of lensfun's version 2 write the distortion models that version 1 knows in the same words.
    text = re.sub(r'(<lensdatabase[^>]*\bversion=")2"', r'\g<1>1"', text)
    try:
        return lensfunpy.Database(xml=text, load_common=False, load_bundled=False)
    except lensfunpy.LensfunError:
        raise CameraError(f"{path} is not a lens profile in lensfun's format") from None


def _radial_fit(ideal: Points, seen: Points, centre: Points, unit: float) -> Points:
    offset = ideal - centre
    radius = np.linalg.norm(offset, axis=1) / unit
    inside = radius > 0.05  # the ratio below is ill-defined at the centre
    ratio = np.linalg.norm(seen - centre, axis=1)[inside] / unit / radius[inside]
    powers = np.linalg.lstsq(np.vander(radius[inside], 5, increasing=True), ratio)[0]
    fitted = centre + offset * np.polynomial.polynomial.polyval(radius, powers)[:, None]
    worst = float(np.abs(fitted - seen).max())
    if not worst < FIT_LIMIT:
        raise CameraError(f"lensfun's map is not radial: residual {worst:.2g} px; calibrate the lens from chessboards")
    return powers


def _text(value: object) -> str:
    return str(value or "").replace("\0", "").strip()


def _number(value: object) -> float | None:
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return number if math.isfinite(number) and number > 0.0 else None


def _numbers(name: str) -> list[float]:
    return [float(digits) for digits in re.findall(r"\d+(?:\.\d+)?", name)]


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower().removeprefix("canon"))
