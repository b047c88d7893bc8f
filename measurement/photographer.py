"""The photographer: photographs of a shadow on a gridded screen, whose truth is known.

Every pixel is followed through lens and pinhole to the screen, where light is a formula: grid, shadow with penumbra and
lamp. Nothing here is shared with the modules that measure; a camera is the same numbers in both (OpenCV's definition of
the matrix and of k1, k2, p1, p2, k3), each with code of its own.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import ExifTags, Image as Files
from scipy.interpolate import RectBivariateSpline
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from scipy.special import erf, ndtr

from softmodels.common import errors
from softmodels.common.arrays import Array


@dataclasses.dataclass(frozen=True)
class Scene:
    """Camera, screen, lamp and sensor; lengths in m, angles in degrees.

    Attributes:
        distortion: k1, k2, p1, p2, k3 of OpenCV's lens model; fewer are filled up with 0.
        pixel_size: Length on the screen that a pixel spans where the optical axis meets it, seen straight on.
        tilt: Angle by which the camera stands above the screen's normal.
        pan: Angle by which it stands to the right of it.
        roll: Angle by which the picture is turned clockwise.
        target: Point (X, Z) of the screen that the optical axis meets; the grid has a crossing at (0, 0).
        grid_pitch: Distance of the grid's lines.
        line_grey: Share of light that a line takes.
        brightness: Value of the lit screen in the middle, of 255.
        unevenness: Share of light missing in the picture's corners.
        ambient: Share of light that reaches the shadow.
        penumbra: Standard deviation of the shadow's edge on the screen.
        lamp: Shape of the lamp: ``gaussian`` (a frosted bulb), ``disc`` or ``square`` (with its sides along the edge).
        blur: Standard deviation of the lens' blur in px.
        noise: Standard deviation of the sensor's noise, of 255.
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
        for name in ("width", "height", "focal_px", "pixel_size", "grid_pitch", "line_width", "penumbra", "magnification"):
            if not getattr(self, name) > 0:
                raise SceneError(f"{name} must be positive, not {getattr(self, name)}")
        if self.lamp not in LAMPS:
            raise SceneError(f"lamp must be one of {', '.join(LAMPS)}, not {self.lamp!r}")
        if len(self.distortion) > 5:
            raise SceneError("a scene's lens has at most the five coefficients k1, k2, p1, p2, k3")


Image = NDArray[np.float32]


def bent(u: Array, v: Array, k: Array) -> tuple[Array, Array]:
    """Return where a lens with k1, k2, p1, p2, k3 shows the direction (u, v): Brown's model as OpenCV's manual writes it."""
    r2 = u * u + v * v
    radial = 1.0 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]))
    return (
        u * radial + 2.0 * k[2] * u * v + k[3] * (r2 + 2.0 * u * u),
        v * radial + k[2] * (r2 + 2.0 * v * v) + 2.0 * k[3] * u * v,
    )


def straightened(u: Array, v: Array, k: Array) -> tuple[Array, Array]:
    """Return the inverse of `bent`: each round moves the guess by what it misses."""
    a, b = u.copy(), v.copy()
    with np.errstate(over="ignore", invalid="ignore"):  # beyond a lens' reach there is no answer
        for _ in range(100):
            c, d = bent(a, b, k)
            a, b = a + (u - c), b + (v - d)
            if max(np.abs(u - c).max(initial=0.0), np.abs(v - d).max(initial=0.0)) < 1e-12:
                break
    return a, b


def screen(matrix: Array, k: Array, homography: Array, x: Array, y: Array) -> tuple[Array, Array]:
    """Return the places (X, Z) on the screen in m that pixels (x, y) of the photograph show."""
    u, v = straightened((x - matrix[0, 2]) / matrix[0, 0], (y - matrix[1, 2]) / matrix[1, 1], k)
    ideal = np.stack([u * matrix[0, 0] + matrix[0, 2], v * matrix[1, 1] + matrix[1, 2], np.ones_like(u)])
    place = np.tensordot(homography, ideal, axes=1)
    return place[0] / place[2], place[1] / place[2]


def _seen_of_disc(z: Array) -> Array:
    # What a chord at the distance t from a disc's middle cuts off; its standard deviation is half of its radius.
    t = np.clip(0.5 * z, -1.0, 1.0)
    return np.asarray(0.5 + (t * np.sqrt(1.0 - t * t) + np.arcsin(t)) / np.pi)


LAMPS: dict[str, Callable[[Array], Array]] = {
    "gaussian": ndtr, "disc": _seen_of_disc, "square": lambda z: np.clip(0.5 + z / np.sqrt(12.0), 0.0, 1.0),
}  # fmt: skip
"""Share of a lamp visible at distances from the shadow's edge in standard deviations of its penumbra."""


class SceneError(ValueError):
    """A scene that cannot be photographed; the message is for the user."""


@dataclasses.dataclass(frozen=True, eq=False)
class Truth:
    """True contents of a photograph: the scene, the camera's matrix (3, 3) in px, k1, k2, p1, p2, k3 of its lens, and the
    homography (3, 3) from ideal px to the screen in m."""

    scene: Scene
    matrix: Array
    distortion: Array
    homography: Array

    def to_metres(self, px: ArrayLike) -> Array:
        """Return the points (n, 2) of the outline's plane in m, magnification taken out, for pixels (n, 2) of the
        photograph."""
        return self.to_screen(px) / self.scene.magnification

    def to_screen(self, px: ArrayLike) -> Array:
        """Return the points (n, 2) on the screen in m for pixels (n, 2) of the photograph."""
        points = np.asarray(px, dtype=float).reshape(-1, 2)
        return np.column_stack(screen(self.matrix, self.distortion, self.homography, points[:, 0], points[:, 1]))

    def to_pixels(self, metres: ArrayLike) -> Array:
        """Return the pixels (n, 2) of the photograph for points (n, 2) of the outline's plane in m."""
        screen = np.asarray(metres, dtype=float).reshape(-1, 2) * self.scene.magnification
        ray = np.column_stack([screen, np.ones(len(screen))]) @ np.linalg.inv(self.homography).T
        x, y = ray[:, 0] / ray[:, 2], ray[:, 1] / ray[:, 2]
        fx, fy, cx, cy = self.matrix[0, 0], self.matrix[1, 1], self.matrix[0, 2], self.matrix[1, 2]
        u, v = bent((x - cx) / fx, (y - cy) / fy, self.distortion)
        return np.column_stack([fx * u + cx, fy * v + cy])


Fault = Callable[[Image, Truth], Image]
"""Light (h, w) before the lens' blur and its truth in, changed light out."""


def truth_of(scene: Scene) -> Truth:
    """Return the camera and the screen's homography of a scene."""
    cx, cy = (scene.width - 1) / 2, (scene.height - 1) / 2
    matrix = np.array([[scene.focal_px, 0, cx], [0, scene.focal_px, cy], [0, 0, 1]])
    turn = Rotation.from_euler("ZXY", [scene.roll, scene.tilt, scene.pan], degrees=True).as_matrix()
    # Seen straight on, the camera's y runs down the screen's Z.
    across, up = turn[:, 0], -turn[:, 1]
    away = np.array([0.0, 0.0, scene.pixel_size * scene.focal_px])
    pose = np.column_stack([across, up, away - across * scene.target[0] - up * scene.target[1]])
    return Truth(scene, matrix, lens_of(scene.distortion), np.linalg.inv(matrix @ pose))


def lens_of(given: Sequence[float]) -> Array:
    """Return the five coefficients of OpenCV's lens model, those that are not given 0."""
    return np.array([*given, *[0.0] * (5 - len(given))])


_SCREEN = (
    "width", "height", "focal_px", "pixel_size", "tilt", "pan", "roll", "grid_pitch", "line_width", "line_grey", "unevenness",
    "distortion", "target",
)  # fmt: skip
"""What the bare screen's light depends on."""


@functools.lru_cache(maxsize=1)
def _light_of(scene: Scene) -> tuple[Rays, Image]:
    truth = truth_of(scene)
    rays = Rays(truth.matrix, truth.distortion, truth.homography, scene.width, scene.height)
    light = gridded(rays, scene.grid_pitch, scene.line_width, scene.line_grey)
    light *= lamp(scene.width, scene.height, scene.unevenness)
    return rays, light


def photograph(
    scene: Scene, outline: ArrayLike | None = None, seed: int = 0, things: Sequence[ArrayLike] = (), fault: Fault | None = None
) -> tuple[NDArray[np.uint8], Truth]:
    """Return the photograph (h, w, 3) of a shadow, and the truth about it. The inside of the outline, a polygon (k, 2) in m,
    and of ``things`` in the lamp's light is dark; ``fault`` changes the light on its way to the sensor.

    Raises `SceneError` where the screen's horizon is in the picture, or an outline is no polygon.
    """
    truth = truth_of(scene)
    rng = np.random.default_rng(seed)
    _check(truth)
    known = {name: getattr(scene, name) for name in _SCREEN}
    known |= {name: tuple(map(float, known[name])) for name in ("distortion", "target")}
    rays, bare = _light_of(Scene(**known))
    light = bare.copy()
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
        (rim[:, 0] - truth.matrix[0, 2]) / scene.focal_px, (rim[:, 1] - truth.matrix[1, 2]) / scene.focal_px, truth.distortion
    )
    with np.errstate(over="ignore", invalid="ignore"):
        back = bent(u, v, truth.distortion)
    if not np.allclose(back[0] * scene.focal_px + truth.matrix[0, 2], rim[:, 0], atol=1e-3):
        raise SceneError("the lens bends so much that it shows nothing in the picture's corners; lower its coefficients")
    # Beyond the horizon the homography's denominator has the other sign than in the middle of the picture.
    below = np.column_stack([u, v, np.ones(len(u))]) @ truth.matrix.T @ truth.homography[2]
    if not np.all(below * below[len(below) // 2] > 0.0):
        raise SceneError("the screen's horizon is in the picture; lower tilt or pan, or take a longer focal length")


BODY_BASE = -0.2
"""Z in m of the underside of a body: below the picture."""


def dome(height: float, radius: float = 0.015, centre: float = 0.0, floor: float = 0.0, half_width: float = 0.2) -> Array:
    """Return the polygon (k, 2) in m of an inflated disk seen from the side: a bump above the floor, as wide as twice
    ``radius``, on a solid body, which reaches beyond the picture unless ``half_width`` is given."""
    inner = np.linspace(-radius, radius, 1001)
    surface = np.column_stack([centre + inner, floor + dome_height(inner, height, radius)])
    right, left = centre + half_width, centre - half_width
    return np.vstack([surface, [[right, floor], [right, BODY_BASE], [left, BODY_BASE], [left, floor]]])


def dome_height(x: ArrayLike, height: float, radius: float = 0.015) -> Array:
    """Return the height in m above the flat surface at the distance ``x`` from the bump's axis: smooth to the second
    derivative."""
    share = np.clip(np.abs(np.asarray(x, dtype=float)) / radius, 0.0, 1.0)
    return height * (1.0 - share**2) ** 3


def save(
    path: Path | str, image: NDArray[np.uint8], exif: dict[str, object] | None = None, quality: int = 95, subsampling: int = 0
) -> Path:
    """Write a photograph (h, w, 3) in the format of the path's ending; ``exif`` has any of maker, camera, lens, focal_mm.
    ``quality`` and ``subsampling`` are those of JPEG, as Pillow has them: 0 keeps all colours, 2 a quarter of their pixels."""
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
            raise SceneError(f"a photograph has no field {name!r}; {errors.known_are(name, places)}")
        table, tag = places[name]
        table[tag] = value
    options: dict[str, Any] = (
        {"quality": quality, "subsampling": subsampling} if Path(path).suffix.lower() in (".jpg", ".jpeg") else {}
    )
    Files.fromarray(image).save(path, exif=tags, **options)
    return Path(path)


# ----------------------------------------------------------------------------------------------------------------------
# How much light each pixel of a synthetic photograph gets; formulas in the screen's plane, no picture is ever warped.


RAY_SPACING_PX = 16
"""Pixels between the rays that are followed exactly; between them a spline is right to a thousandth of a pixel."""

PENUMBRA_REACH = 5.0
"""Standard deviations of the penumbra beyond which light is full or none to a part in a million."""


class Rays:
    """The screen's place for every pixel, by splines through rays that were followed exactly."""

    def __init__(self, matrix: Array, k: Array, homography: Array, width: int, height: int) -> None:
        """Follow a ray every `RAY_SPACING_PX` pixels."""
        # The rays go a little beyond the frame, so that no pixel lies at the splines' ends.
        self.columns = np.arange(-RAY_SPACING_PX, width + 2 * RAY_SPACING_PX, RAY_SPACING_PX, dtype=float)
        self.rows = np.arange(-RAY_SPACING_PX, height + 2 * RAY_SPACING_PX, RAY_SPACING_PX, dtype=float)
        x, y = np.meshgrid(self.columns, self.rows)
        self.size = (height, width)
        self.splines = tuple(
            RectBivariateSpline(self.rows, self.columns, place) for place in screen(matrix, k, homography, x, y)
        )

    def strip(self, first: int, last: int) -> tuple[Array, Array]:
        """Return X and Z (last - first, width) in m of whole rows."""
        rows, columns = np.arange(first, last, dtype=float), np.arange(self.size[1], dtype=float)
        return self.splines[0](rows, columns), self.splines[1](rows, columns)

    def footprints(self, row: float) -> tuple[Array, Array]:
        """Return the extent in m of the pixels (width,) of a row along X and along Z."""
        columns = np.arange(self.size[1], dtype=float)
        extents = [np.hypot(spline(row, columns, dx=1)[0], spline(row, columns, dy=1)[0]) for spline in self.splines]
        return extents[0], extents[1]

    def at(self, rows: Array, columns: Array) -> Array:
        """Return the places (n, 2) in m of single pixels."""
        return np.column_stack([spline(rows, columns, grid=False) for spline in self.splines])


def gridded(rays: Rays, pitch: float, line_width: float, grey: float) -> Image:
    """Return the share of light (h, w) that the screen with its grid throws back, each pixel the mean over its own extent."""
    height, width = rays.size
    light = np.empty((height, width), dtype=np.float32)
    for first in range(0, height, 64):
        last = min(first + 64, height)
        bare = np.ones((last - first, width))
        places, extents = rays.strip(first, last), rays.footprints((first + last - 1) / 2)
        for place, extent in zip(places, extents, strict=True):
            off = place - pitch * np.rint(place / pitch)
            half = line_width / 2
            covered = (np.clip(off + extent / 2, -half, half) - np.clip(off - extent / 2, -half, half)) / extent
            bare = bare * (1.0 - covered)
        light[first:last] = 1.0 - grey * (1.0 - bare)
    return light


def lamp(width: int, height: int, unevenness: float) -> Image:
    """Return the light (h, w) of a lamp that is brightest a little off the middle; the frame's far corner does not have the
    share given."""
    x = (np.arange(width, dtype=np.float32) / width - 0.45) / 0.55
    y = (np.arange(height, dtype=np.float32) / height - 0.45) / 0.55
    return (1.0 - 0.5 * unevenness * (x[None, :] ** 2 + y[:, None] ** 2)).astype(np.float32)


def shadowed(rays: Rays, polygon: Array, penumbra: float, ambient: float, lamp: str = "gaussian") -> Image:
    """Return the share of light (h, w) beside and in the shadow of a polygon (k, 2) on the screen in m; the lamp is one of
    `LAMPS`."""
    height, width = rays.size
    outline = Outline(polygon, spacing=penumbra / 2)
    rows, columns = np.meshgrid(
        np.arange(RAY_SPACING_PX / 2, height + RAY_SPACING_PX, RAY_SPACING_PX),
        np.arange(RAY_SPACING_PX / 2, width + RAY_SPACING_PX, RAY_SPACING_PX),
        indexing="ij",
    )
    middle = rays.at(np.minimum(rows, height).ravel(), np.minimum(columns, width).ravel()).reshape(*rows.shape, 2)
    radius = RAY_SPACING_PX * max(float(extent.max()) for row in (0, height - 1) for extent in rays.footprints(row)) * 0.75
    coarse = outline.distance(middle.reshape(-1, 2)).reshape(rows.shape)
    share = np.repeat(np.repeat((coarse > 0.0).astype(np.float32), RAY_SPACING_PX, axis=0), RAY_SPACING_PX, axis=1)[
        :height, :width
    ]
    near = np.repeat(
        np.repeat(np.abs(coarse) < PENUMBRA_REACH * penumbra + radius, RAY_SPACING_PX, axis=0), RAY_SPACING_PX, axis=1
    )[:height, :width]
    y, x = np.nonzero(near)
    curvature = outline.curvature(penumbra)
    for part in range(0, len(y), 500_000):
        piece = slice(part, part + 500_000)
        places = rays.at(y[piece].astype(float), x[piece].astype(float))
        # The lamp's image blurs the silhouette: on a curved edge, half of the light shifts towards the centre of curvature.
        nearest = outline.nearest(places)
        shift = 0.5 * penumbra**2 * curvature[nearest]
        share[y[piece], x[piece]] = LAMPS[lamp]((outline.distance(places, nearest) + shift) / penumbra)
    return np.float32(ambient) + np.float32(1.0 - ambient) * share


def speck(light: Image, rng: np.random.Generator) -> None:
    """Darken one soft round spot of dust, somewhere."""
    height, width = light.shape
    radius, depth = rng.uniform(1.5, 6.0), rng.uniform(0.2, 0.7)
    x, y = rng.uniform(0, width), rng.uniform(0, height)
    reach = int(2 * radius) + 2
    rows = slice(max(0, int(y) - reach), int(y) + reach)
    columns = slice(max(0, int(x) - reach), int(x) + reach)
    far = np.hypot(np.arange(height)[rows][:, None] - y, np.arange(width)[columns][None] - x)
    light[rows, columns] *= 1.0 - depth * ndtr((radius - far) / 0.7)


class Outline:
    """Signed distance from a closed polygon, exact, by the densely placed points on its sides."""

    def __init__(self, polygon: Array, spacing: float) -> None:
        """Lay points on the polygon's sides, no farther apart than ``spacing`` in m."""
        corners = polygon if not np.allclose(polygon[0], polygon[-1]) else polygon[:-1]
        ends = np.roll(corners, -1, axis=0)
        counts = np.maximum(1, np.ceil(np.linalg.norm(ends - corners, axis=1) / spacing)).astype(int)
        shares = np.concatenate([np.arange(count) / count for count in counts])[:, None]
        self.points = np.repeat(corners, counts, axis=0) * (1 - shares) + np.repeat(ends, counts, axis=0) * shares
        self.sides = np.roll(self.points, -1, axis=0) - self.points
        keep = np.linalg.norm(self.sides, axis=1) > 0.0
        self.points, self.sides = self.points[keep], self.sides[keep]
        area = np.sum(corners[:, 0] * ends[:, 1] - corners[:, 1] * ends[:, 0])
        normals = np.column_stack([self.sides[:, 1], -self.sides[:, 0]]) * np.sign(area)
        self.normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        self.tree = cKDTree(self.points)

    def nearest(self, places: Array) -> NDArray[np.intp]:
        """Return the numbers (n,) of the points of the outline that lie nearest to places (n, 2)."""
        return np.asarray(self.tree.query(places, workers=-1)[1])

    def distance(self, places: Array, nearest: NDArray[np.intp] | None = None) -> Array:
        """Return the distance (n,) in m of places (n, 2) from the outline, negative inside; ``nearest`` is optional."""
        nearest = self.nearest(places) if nearest is None else nearest
        best = np.full(len(places), np.inf)
        signed = np.empty(len(places))
        # At a corner neither side by itself distinguishes inside from outside, but the sum of their normals does
        # (Baerentzen and Aanaes 2005, doi 10.1109/TVCG.2005.49).
        for side in (nearest - 1, nearest):
            start, along = self.points[side], self.sides[side]
            share = np.sum((places - start) * along, axis=1) / np.sum(along**2, axis=1)
            off = places - start - np.clip(share, 0.0, 1.0)[:, None] * along
            far = np.linalg.norm(off, axis=1)
            corner = self.normals[nearest - 1] + self.normals[nearest]
            within = ((share > 0.0) & (share < 1.0))[:, None]
            outwards = np.sum(off * np.where(within, self.normals[side], corner), axis=1)
            closer = far < best
            best = np.where(closer, far, best)
            signed = np.where(closer, np.copysign(far, outwards), signed)
        return signed

    def curvature(self, width: float) -> Array:
        """Return the curvature (k,) in 1/m at the outline's points, positive where convex; 0 within ``width`` in m of a corner.

        A circle's penumbra is no corner's; those have their own, for which the distance is accurate enough.
        """
        # Twice the area over the product of a triangle's sides, over some widths of the penumbra.
        step = max(2, round(3.0 * width / float(np.median(np.linalg.norm(self.sides, axis=1)))))
        if len(self.points) < 4 * step:
            return np.zeros(len(self.points))
        here = self.points
        back, ahead = np.roll(here, step, axis=0) - here, np.roll(here, -step, axis=0) - here
        lengths = np.linalg.norm(back, axis=1) * np.linalg.norm(ahead, axis=1) * np.linalg.norm(ahead - back, axis=1)
        middle = self.normals + np.roll(self.normals, 1, axis=0)
        area = np.abs(back[:, 0] * ahead[:, 1] - back[:, 1] * ahead[:, 0])
        bend = -np.sign(np.sum((back + ahead) * middle, axis=1)) * 2.0 * area / np.maximum(lengths, 1e-30)
        corner = np.abs(bend) * width > 0.2
        near = np.convolve(np.r_[corner[-step:], corner, corner[:step]], np.ones(2 * step + 1), "valid") > 0.0
        return np.where(near, 0.0, bend)


# ----------------------------------------------------------------------------------------------------------------------
# A bench's worth of synthetic photographs: the grid, and a disk that rises from 0 to 9 mm.


SCENE = Scene(
    width=2400, height=1600, focal_px=4200.0, pixel_size=20e-6, tilt=12.0, pan=-28.0, roll=1.0, target=(0.0, 0.001),
    ambient=0.12, penumbra=70e-6, dust=12, jpeg_quality=93, srgb=True,
)  # fmt: skip
"""A camera that looks at the screen obliquely, as on the bench."""

HEIGHTS = np.arange(10) * 1e-3
"""Heights of the disk in m."""

DISK_RADIUS, SURFACE_HEIGHT = 0.0145, -0.0067
"""Radius of the disk and Z of its undeformed surface in m: no grid line lies along it."""


def column(height: float) -> float:
    """Return the height in cm of the demo's water column for a rise in m: stiff at first, then softer, as a membrane is."""
    return 16.0 * (1.0 - np.exp(-height / 0.006)) + 250.0 * height


def make_photographs(folder: Path) -> None:
    """Write ``IMG_0100.JPG`` (the grid), one photograph per height from ``IMG_0101.JPG`` on, and ``photos.csv``."""
    folder.mkdir(parents=True, exist_ok=True)
    save(folder / "IMG_0100.JPG", photograph(SCENE, None, seed=100)[0])
    rows = ["# levels of both tubes of the water column, read to half a millimetre", "file,left,right"]
    for number, height in enumerate(HEIGHTS, 101):
        picture = photograph(SCENE, dome(float(height), DISK_RADIUS, floor=SURFACE_HEIGHT), seed=number)[0]
        save(folder / f"IMG_{number:04d}.JPG", picture)
        half = column(float(height)) / 2.0
        rows.append(f"IMG_{number:04d}.JPG,{25.0 + half:.1f} cm,{25.0 - half:.1f} cm")
    (folder / "photos.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")


# ----------------------------------------------------------------------------------------------------------------------
# A chessboard that the photographer sees instead of the screen.


Picture = NDArray[np.uint8]

Light = NDArray[np.floating]


def _board(light: Callable[[Scene, tuple[int, int], float, float], Light]) -> Callable[..., Picture]:
    """Return a photographer of one kind of board, from the light (h, w) that reaches the pixels."""

    @functools.wraps(light)
    def photograph(
        scene: Scene,
        squares: tuple[int, int] = (10, 7),
        side: float = 0.008,
        blur: float = 0.8,
        noise: float = 1.0,
        seed: int = 0,
    ) -> Picture:
        clean = light(scene, squares, side, blur)
        noisy = clean + noise * np.random.default_rng(seed).normal(size=clean.shape)
        return np.repeat(np.clip(np.rint(noisy), 0, 255).astype(np.uint8)[..., None], 3, axis=2)

    return photograph


def _pixels(scene: Scene) -> NDArray[np.float64]:
    """Return all pixels (h w, 2) of a scene's photograph, row by row."""
    y, x = np.indices((scene.height, scene.width)).astype(float)
    return np.column_stack([x.ravel(), y.ravel()])


@_board
def chessboard(scene: Scene, squares: tuple[int, int], side: float, blur: float) -> Light:
    """Return a photograph (h, w, 3) of a chessboard about (0, 0).

    The edges are error functions of the distance in pixels: sampling a drawing, even at 16 places in a pixel, moves the
    corners by some hundredths of a pixel, which is more than they are measured to.
    """
    truth, px = truth_of(scene), _pixels(scene)
    place = truth.to_screen(px) / side
    beside = [truth.to_screen(px + step) / side - place for step in np.eye(2)]
    waves, inside = [], np.ones(len(px))
    for axis in (0, 1):
        at = place[:, axis] + squares[axis] / 2
        width = np.hypot(beside[0][:, axis], beside[1][:, axis]) * np.hypot(blur, 12**-0.5) * np.sqrt(2)
        line = np.rint(at)
        waves.append(erf((at - line) / width) * (1 - 2 * (line % 2)))
        inside = inside * 0.5 * (erf(at / width) - erf((at - squares[axis]) / width))
    light = 220.0 - inside * 90.0 * (1.0 + waves[0] * waves[1])
    return np.asarray(light.reshape(scene.height, scene.width))
