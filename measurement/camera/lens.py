"""Lens profiles of the lensfun project, found by EXIF data or by name.

lensfun moves pixels with three radial models (ptlens, poly3, poly5). All are a polynomial in the radius, so its own map,
sampled over the frame, is repeated by five coefficients: nothing of lensfun's scaling by crop factor and aspect ratio has
to be copied here, and the residual of that fit shows whether it is valid.
"""

from __future__ import annotations

import dataclasses
import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import ExifTags

from measurement.camera.camera import Camera, CameraError, Points, beyond_projection, frame_points
from measurement.camera.pictures import PictureError, opened
from softmodels.common.errors import reason
from softmodels.common.files import read_text

if TYPE_CHECKING:
    import lensfunpy


DIAGONAL = math.hypot(36.0, 24.0)
"""Diagonal in mm of the frame that a crop factor of one means."""

FIT_LIMIT = 0.3
"""Largest difference in px between lensfun's map and ours."""

PROFILE_SHARE = 0.1
"""Standard error of a profile as a share of what it corrects.

A profile was measured on another copy of the lens, mostly at another focus distance; neighbouring entries of the database
for the same lens differ by about this much. A calibration from chessboards has no such guess.
"""

APERTURE, DISTANCE = 8.0, 1000.0
"""f-number and focus distance in m that lensfun asks for; its geometry depends on neither."""

ZOOM = 0.1
"""Share by which neighbouring focal lengths differ whose distortion tells a profile's error."""


@dataclasses.dataclass(frozen=True)
class Exif:
    """EXIF data of a photograph's camera.

    Attributes:
        maker: Maker of the camera, maybe empty.
        camera: Model of the camera.
        lens: Name of the lens, maybe empty.
        focal_mm: Focal length in mm, None where unknown.
    """

    maker: str
    camera: str
    lens: str
    focal_mm: float | None = None


def read_exif(path: Path | str) -> Exif:
    """Read camera, lens and focal length from a photograph.

    Raises:
        CameraError: The file is no picture, or it does not name its camera.
    """
    try:
        with opened(Path(path)) as image:
            head = image.getexif()
            body = head.get_ifd(ExifTags.IFD.Exif)
    except (PictureError, OSError, SyntaxError, ValueError) as error:
        raise CameraError(f"{path} cannot be read as a photograph: {reason(error)}") from None
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
    """Return the camera that lensfun's database describes.

    Args:
        names: A photograph whose EXIF names camera and lens, or these names.
        width: Pixels in a row of the photographs.
        height: Rows.
        lens: Name of the lens, over the one in ``names``.
        focal_mm: Focal length in mm, over the one in ``names``.
        database: An XML file in lensfun's format; the database that comes with lensfunpy unless given.

    Raises:
        CameraError: Names or focal length are missing, unknown, or the profile has no usable distortion.
    """
    known = names if isinstance(names, Exif) else read_exif(names)
    wanted, focal = lens or known.lens, focal_mm or known.focal_mm
    if not wanted:
        raise CameraError("the photograph does not name its lens; give the lens by name")
    if not focal:
        raise CameraError("the photograph has no focal length (EXIF); give it in mm")
    body, glass = _find(known.maker, known.camera, wanted, database)
    if not glass.min_focal * 0.99 <= focal <= glass.max_focal * 1.01:
        raise CameraError(
            f"the lens {glass.model} goes from {glass.min_focal:g} to {glass.max_focal:g} mm, not {focal:g} mm"
        )
    lensfunpy = _lensfun()
    if glass.type != lensfunpy.LensType.RECTILINEAR:
        raise CameraError(f"the lens {glass.model} is not a rectilinear lens; calibrate it from chessboards")
    calibration = glass.interpolate_distortion(focal)
    if calibration is None or calibration.model == lensfunpy.DistortionModel.NONE:
        raise CameraError(f"lensfun has the lens {glass.model} but not its distortion; calibrate it from chessboards")
    # A zoom's distortion changes sign somewhere; right there the profile names none, and its neighbours tell its error.
    near = np.clip(np.array([1.0, 1.0 - ZOOM, 1.0 + ZOOM]) * focal, glass.min_focal, glass.max_focal)
    cameras = [_at_focal(body, glass, float(length), width, height) for length in near]
    ideal = frame_points(width, height)
    bends = [np.sqrt(np.mean(beyond_projection(ideal, camera.distort(ideal)) ** 2)) for camera in cameras]
    return dataclasses.replace(cameras[0], error_px=PROFILE_SHARE * float(max(bends)))


def _at_focal(body: lensfunpy.Camera, glass: lensfunpy.Lens, focal: float, width: int, height: int) -> Camera:
    """Return the camera at one focal length in mm, without its error."""
    lensfun = _lensfun()
    modifier = lensfun.Modifier(glass, body.crop_factor, width, height)
    modifier.initialize(focal, APERTURE, DISTANCE, scale=1.0, flags=lensfun.ModifyFlags.DISTORTION)
    unit, size = 0.5 * math.hypot(width, height), min(width, height) - 1
    centre = np.array([(width - 1 + glass.center_x * size) / 2, (height - 1 + glass.center_y * size) / 2])
    ideal = frame_points(width, height)
    powers = _radial_fit(ideal, _sample(modifier, ideal), centre, unit)
    pixel = math.hypot(width, height) * body.crop_factor / DIAGONAL  # px per mm on the sensor
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
        found
        for found in known.find_lenses(bodies[0], None, lens)
        if set(_numbers(lens)) <= set(_numbers(found.model)) or set(_numbers(found.model)) == set(_numbers(lens))
    ]
    if not alike:
        raise CameraError(
            f"lensfun does not have the lens {lens} for the {bodies[0].model}; check its name or calibrate"
        )
    exact = [found for found in alike if _plain(found.model) == _plain(lens)]
    return bodies[0], (exact or alike)[0]


def _database_file(path: Path) -> lensfunpy.Database:
    try:
        text = read_text(path)
    except (OSError, UnicodeDecodeError) as error:
        raise CameraError(f"the lens profile {path} cannot be read: {reason(error)}") from None
    lensfunpy = _lensfun()
    # Files of lensfun's version 2 write the distortion models that version 1 knows in the same words.
    text = re.sub(r'(<lensdatabase[^>]*\bversion=")2"', r'\g<1>1"', text)
    try:
        return lensfunpy.Database(xml=text, load_common=False, load_bundled=False)
    except lensfunpy.LensfunError:
        raise CameraError(f"{path} is not a lens profile in lensfun's format") from None


def _sample(modifier: lensfunpy.Modifier, points: Points) -> Points:
    """Return lensfun's place in the photograph for each ideal pixel (n, 2)."""
    maps = [modifier.apply_geometry_distortion(x, y, 1, 1) for x, y in points]
    if maps[0] is None:
        raise CameraError(
            "lensfun gives no distortion for this lens at this focal length; calibrate it from chessboards"
        )
    return np.array([found[0, 0] for found in maps], dtype=float)


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
    return [float(found) for found in re.findall(r"\d+(?:\.\d+)?", name)]


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower().removeprefix("canon"))
