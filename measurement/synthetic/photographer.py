"""The photographer: photographs of a shadow on a gridded screen, whose truth is known.

Every pixel is followed through lens and pinhole to the screen, where light is a formula: grid, shadow with penumbra and
lamp. Nothing here is shared with the modules that measure; a camera is the same numbers in both (OpenCV's definition of
the matrix and of k1, k2, p1, p2, k3), each with code of its own.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import ExifTags
from PIL import Image as Files

from measurement.synthetic.light import (
    LAMPS,
    Array,
    Image,
    Rays,
    bent,
    gridded,
    lamp,
    screen,
    shadowed,
    speck,
    straightened,
)


class SceneError(ValueError):
    """A scene that cannot be photographed; the message is a sentence for the user."""


@dataclasses.dataclass(frozen=True)
class Scene:
    """Camera, screen, lamp and sensor; lengths in m, angles in degrees.

    Attributes:
        width: Pixels in a row.
        height: Rows.
        focal_px: Focal length in px.
        distortion: k1, k2, p1, p2, k3 of OpenCV's lens model; fewer are filled up with 0.
        pixel_size: Length on the screen that a pixel spans where the optical axis meets it, seen straight on.
        tilt: Angle by which the camera stands above the screen's normal.
        pan: Angle by which it stands to the right of it.
        roll: Angle by which the picture is turned clockwise.
        target: Point (X, Z) of the screen that the optical axis meets; the grid has a crossing at (0, 0).
        grid_pitch: Distance of the grid's lines.
        line_width: Width of a line.
        line_grey: Share of light that a line takes.
        brightness: Value of the lit screen in the middle, of 255.
        unevenness: Share of light missing in the picture's corners.
        ambient: Share of light that reaches the shadow.
        penumbra: Standard deviation of the shadow's edge on the screen.
        lamp: Shape of the lamp: ``gaussian`` (a frosted bulb), ``disc`` or ``square`` (with its sides along the edge).
        blur: Standard deviation of the lens' blur in px.
        noise: Standard deviation of the sensor's noise, of 255.
        dust: Number of dust specks.
        jpeg_quality: Quality from 1 to 100, None for no compression.
        magnification: Size of the shadow over that of the outline, about the screen's (0, 0).
        srgb: Whether light is stored with the tone curve of sRGB (IEC 61966-2-1), as cameras do in JPEG files; values
            are proportional to light otherwise.
        s_curve: Share of the smooth step 3 v^2 - 2 v^3 in what the camera stores for the number v, for more contrast.
        sharpening: Amount of an unsharp mask on the stored numbers, as phones apply it.
        sharpening_radius: Its standard deviation in px.
    """

    width: int = 1200
    height: int = 800
    focal_px: float = 3000.0
    distortion: tuple[float, ...] = ()
    pixel_size: float = 40e-6
    tilt: float = 0.0
    pan: float = 0.0
    roll: float = 0.0
    target: tuple[float, float] = (0.0, 0.0)
    grid_pitch: float = 0.009
    line_width: float = 0.0005
    line_grey: float = 0.3
    brightness: float = 215.0
    unevenness: float = 0.15
    ambient: float = 0.15
    penumbra: float = 60e-6
    blur: float = 0.8
    noise: float = 2.0
    dust: int = 0
    jpeg_quality: int | None = 95
    magnification: float = 1.0
    srgb: bool = False
    lamp: str = "gaussian"
    s_curve: float = 0.0
    sharpening: float = 0.0
    sharpening_radius: float = 1.5

    def __post_init__(self) -> None:
        positive = (
            "width",
            "height",
            "focal_px",
            "pixel_size",
            "grid_pitch",
            "line_width",
            "penumbra",
            "magnification",
        )
        for name in positive:
            if not getattr(self, name) > 0:
                raise SceneError(f"{name} must be positive, not {getattr(self, name)}")
        if self.lamp not in LAMPS:
            raise SceneError(f"lamp must be one of {', '.join(LAMPS)}, not {self.lamp!r}")
        if len(self.distortion) > 5:
            raise SceneError("a scene's lens has at most the five coefficients k1, k2, p1, p2, k3")


@dataclasses.dataclass(frozen=True, eq=False)
class Truth:
    """What a photograph really shows.

    Attributes:
        scene: The scene.
        matrix: The camera's matrix (3, 3) in px.
        distortion: k1, k2, p1, p2, k3.
        homography: Matrix (3, 3) from ideal px to the screen in m.
    """

    scene: Scene
    matrix: Array
    distortion: Array
    homography: Array

    def to_metres(self, px: ArrayLike) -> Array:
        """Points (n, 2) of the outline's plane in m, magnification taken out, for pixels (n, 2) of the photograph."""
        return self.to_screen(px) / self.scene.magnification

    def to_screen(self, px: ArrayLike) -> Array:
        """Points (n, 2) on the screen in m for pixels (n, 2) of the photograph."""
        points = np.asarray(px, dtype=float).reshape(-1, 2)
        return np.column_stack(screen(self.matrix, self.distortion, self.homography, points[:, 0], points[:, 1]))

    def to_pixels(self, metres: ArrayLike) -> Array:
        """Pixels (n, 2) of the photograph for points (n, 2) of the outline's plane in m."""
        screen = np.asarray(metres, dtype=float).reshape(-1, 2) * self.scene.magnification
        ray = np.column_stack([screen, np.ones(len(screen))]) @ np.linalg.inv(self.homography).T
        x, y = ray[:, 0] / ray[:, 2], ray[:, 1] / ray[:, 2]
        fx, fy, cx, cy = self.matrix[0, 0], self.matrix[1, 1], self.matrix[0, 2], self.matrix[1, 2]
        u, v = bent((x - cx) / fx, (y - cy) / fy, self.distortion)
        return np.column_stack([fx * u + cx, fy * v + cy])


Fault = Callable[[Image, Truth], Image]
"""Light (h, w) before the lens' blur and its truth in, changed light out."""


def truth_of(scene: Scene) -> Truth:
    """The camera and the screen's homography of a scene."""
    cx, cy = (scene.width - 1) / 2, (scene.height - 1) / 2
    matrix = np.array([[scene.focal_px, 0, cx], [0, scene.focal_px, cy], [0, 0, 1]])
    a, b, c = (math.radians(angle) for angle in (scene.tilt, scene.pan, scene.roll))
    tilt = np.array([[1, 0, 0], [0, math.cos(a), -math.sin(a)], [0, math.sin(a), math.cos(a)]])
    pan = np.array([[math.cos(b), 0, math.sin(b)], [0, 1, 0], [-math.sin(b), 0, math.cos(b)]])
    roll = np.array([[math.cos(c), -math.sin(c), 0], [math.sin(c), math.cos(c), 0], [0, 0, 1]])
    turn = roll @ tilt @ pan
    # Seen straight on, the camera's y runs down the screen's Z.
    across, up = turn[:, 0], -turn[:, 1]
    away = np.array([0.0, 0.0, scene.pixel_size * scene.focal_px])
    pose = np.column_stack([across, up, away - across * scene.target[0] - up * scene.target[1]])
    return Truth(scene, matrix, lens_of(scene.distortion), np.linalg.inv(matrix @ pose))


def lens_of(given: Sequence[float]) -> Array:
    """The five coefficients of OpenCV's lens model, those that are not given 0."""
    return np.array([*given, *[0.0] * (5 - len(given))])


def photograph(
    scene: Scene, outline: ArrayLike | None = None, seed: int = 0, things: Sequence[ArrayLike] = (), fault: Fault | None = None
) -> tuple[NDArray[np.uint8], Truth]:  # fmt: skip
    """Photograph the shadow of an outline.

    Args:
        scene: Camera, screen, lamp and sensor.
        outline: Polygon (k, 2) in m whose inside is in shadow, its last point joined to the first; None for no shadow.
        seed: Seed of noise and dust.
        things: Other polygons (k, 2) in m in the lamp's light, such as those of `faults`.
        fault: What else changes the light on its way to the sensor; None for nothing.

    Returns:
        Picture (h, w, 3), red, green, blue, and the truth about it.

    Raises:
        SceneError: The screen's horizon is in the picture, or the outline is no polygon.
    """
    truth = truth_of(scene)
    rng = np.random.default_rng(seed)
    _check(truth)
    rays = Rays(truth.matrix, truth.distortion, truth.homography, scene.width, scene.height)
    light = gridded(rays, scene.grid_pitch, scene.line_width, scene.line_grey)
    light *= lamp(scene.width, scene.height, scene.unevenness)
    shadows = [
        shadowed(rays, _polygon(shape) * scene.magnification, scene.penumbra, scene.ambient, scene.lamp)
        for shape in ([] if outline is None else [outline, *things])
    ]
    if shadows:
        light *= np.minimum.reduce(shadows)
    for _ in range(scene.dust):
        speck(light, rng)
    if fault is not None:
        light = np.asarray(fault(light, truth), dtype=np.float32)
    if scene.blur > 0.0:
        light = cv2.GaussianBlur(light, (0, 0), scene.blur)
    if scene.srgb:
        light = np.where(light <= 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 1e-9) ** (1 / 2.4) - 0.055)
    light = np.asarray(light, dtype=np.float32)
    if scene.s_curve > 0.0:
        number = np.clip(light * np.float32(scene.brightness / 255.0), 0.0, 1.0)
        step = number * number * (3.0 - 2.0 * number)
        light = light * (1.0 - scene.s_curve + scene.s_curve * step / np.maximum(number, 1e-6))
    if scene.sharpening > 0.0:
        light = light + scene.sharpening * (light - cv2.GaussianBlur(light, (0, 0), scene.sharpening_radius))
    picture = np.empty((scene.height, scene.width, 3), dtype=np.uint8)
    # A lamp's white is a little warm and what fills the shadow a little cold: colours differ, edges do not.
    for channel, (warm, cold) in enumerate(((1.0, -1.5), (0.98, 0.0), (0.93, 2.0))):
        value = light * np.float32(scene.brightness * warm) + np.float32(cold)
        if scene.noise > 0.0:
            value += np.float32(scene.noise) * rng.standard_normal(value.shape, dtype=np.float32)
        picture[..., channel] = np.clip(np.rint(value), 0, 255)
    if scene.jpeg_quality is not None:
        _, packed = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, scene.jpeg_quality])
        picture = np.ascontiguousarray(np.asarray(cv2.imdecode(packed, cv2.IMREAD_COLOR))[..., ::-1])
    return picture, truth


def _polygon(shape: ArrayLike) -> Array:
    polygon = np.asarray(shape, dtype=float)
    if polygon.ndim != 2 or polygon.shape[1] != 2 or len(polygon) < 3 or not np.isfinite(polygon).all():
        raise SceneError("an outline must be a polygon of at least three points (X, Z) in m")
    return polygon


def _check(truth: Truth) -> None:
    scene = truth.scene
    x, y = np.meshgrid(np.linspace(-1, 1, 9) * scene.width, np.linspace(-1, 1, 9) * scene.height)
    rim = np.column_stack([x.ravel() / 2 + scene.width / 2, y.ravel() / 2 + scene.height / 2])
    u, v = straightened(
        (rim[:, 0] - truth.matrix[0, 2]) / scene.focal_px,
        (rim[:, 1] - truth.matrix[1, 2]) / scene.focal_px,
        truth.distortion,
    )
    with np.errstate(over="ignore", invalid="ignore"):
        back = bent(u, v, truth.distortion)
    if not np.allclose(back[0] * scene.focal_px + truth.matrix[0, 2], rim[:, 0], atol=1e-3):
        raise SceneError(
            "the lens bends so much that it shows nothing in the picture's corners; lower its coefficients"
        )
    # Beyond the horizon the homography's denominator has the other sign than in the middle of the picture.
    below = np.column_stack([u, v, np.ones(len(u))]) @ truth.matrix.T @ truth.homography[2]
    if not np.all(below * below[len(below) // 2] > 0.0):
        raise SceneError("the screen's horizon is in the picture; lower tilt or pan, or take a longer focal length")


def dome(
    height: float, radius: float = 0.015, centre: float = 0.0, floor: float = 0.0, half_width: float = 0.2,
    base: float = -0.2,
) -> Array:  # fmt: skip
    """Polygon (k, 2) in m of an inflated disk seen from the side, with the solid body below its surface.

    Args:
        height: Height of the bump's top above the flat surface.
        radius: Where the bump goes over into the flat surface.
        centre: X of the top.
        floor: Z of the flat surface.
        half_width: Half width of the body; beyond the picture unless given.
        base: Z of the body's underside; below the picture unless given.
    """
    inner = np.linspace(-radius, radius, 1001)
    surface = np.column_stack([centre + inner, floor + dome_height(inner, height, radius)])
    sides = [
        [centre + half_width, floor],
        [centre + half_width, base],
        [centre - half_width, base],
        [centre - half_width, floor],
    ]
    return np.vstack([surface, sides])


def dome_height(x: ArrayLike, height: float, radius: float = 0.015) -> Array:
    """Height in m above the flat surface at the distance ``x`` from the bump's axis: smooth to the second derivative."""
    share = np.clip(np.abs(np.asarray(x, dtype=float)) / radius, 0.0, 1.0)
    return height * (1.0 - share**2) ** 3


def save(path: Path | str, image: NDArray[np.uint8], exif: dict[str, object] | None = None, quality: int = 95) -> Path:
    """Write a photograph (h, w, 3); the ending names the format.

    Args:
        path: File to write.
        image: Red, green, blue.
        exif: Any of ``maker``, ``camera``, ``lens``, ``focal_mm``.
        quality: Quality of a JPEG file.
    """
    tags = Files.Exif()
    body = tags.get_ifd(ExifTags.IFD.Exif)
    places = {
        "maker": (tags, ExifTags.Base.Make),
        "camera": (tags, ExifTags.Base.Model),
        "lens": (body, ExifTags.Base.LensModel),
        "focal_mm": (body, ExifTags.Base.FocalLength),
    }
    for name, value in (exif or {}).items():
        if name not in places:
            raise SceneError(f"a photograph has no field {name!r}; known are {', '.join(places)}")
        table, tag = places[name]
        table[tag] = value
    options: dict[str, Any] = (
        {"quality": quality, "subsampling": 0} if Path(path).suffix.lower() in (".jpg", ".jpeg") else {}
    )
    Files.fromarray(image).save(path, exif=tags, **options)
    return Path(path)
