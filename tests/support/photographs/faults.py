"""What goes wrong with the light between lamp and sensor, at a random place and of a random size.

A damage is made for the body in one photograph (`Target`) and has an effect (`Change`). Lengths are in m on the screen,
pixels those of the photograph.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from measurement.photographer import Fault, Image, Rays, Truth, shadowed
from softmodels.common.arrays import Array

Shape = Callable[[Array], Array]
Stored = Callable[[NDArray[np.uint8]], NDArray[np.uint8]]


@dataclasses.dataclass(frozen=True)
class Target:
    """Target of a damage.

    Attributes:
        outline: Polygon (k, 2) in m of the body in the photograph to be damaged.
        surface: Only its upper side (n, 2), from left to right.
        scene: Camera and light as numbers of `photographer.Scene` that a damage may change.
    """

    outline: Array
    surface: Array
    scene: dict[str, Any]

    @property
    def apex(self) -> int:
        """Index of the surface's highest point."""
        return int(np.argmax(self.surface[:, 1]))

    def spot(self, rng: np.random.Generator, apex_share: float = 0.6) -> int:
        """Return the index of a place on the surface: about the apex in most cases, else anywhere on what rises."""
        if rng.random() < apex_share:
            near = np.abs(self.surface[:, 0] - self.surface[self.apex, 0]) < 0.5e-3
        else:
            near = self.surface[:, 1] > self.surface[0, 1] + 0.15 * np.ptp(self.surface[:, 1])
        return int(rng.choice(np.flatnonzero(near))) if near.any() else self.apex


@dataclasses.dataclass(frozen=True)
class Change:
    """Effect of a damage.

    Attributes:
        what: Kind, size and place in a few words.
        shape: Where the body's polygon goes; None for nowhere.
        height: What the height is multiplied with; a dent is negative.
        things: Other polygons in the light, shape (k, 2) each.
        fault: Change of the light before the lens' blur.
        scene: Numbers of the scene that are others.
        stored: Change of the stored picture.
        lens: Coefficients that the setup's camera is wrongly given; None for the true ones.
        pitch: Pitch that the setup is given over the true one.
    """

    what: str
    shape: Shape | None = None
    height: float = 1.0
    things: tuple[Array, ...] = ()
    fault: Fault | None = None
    scene: dict[str, Any] = dataclasses.field(default_factory=dict)
    stored: Stored | None = None
    lens: tuple[float, ...] | None = None
    pitch: float = 1.0


def glint(target: Target, rng: np.random.Generator) -> Change:
    """Return a reflection on the silicone along the edge and a little inside of it."""
    where, length, deep = target.spot(rng), rng.uniform(3e-3, 8e-3), rng.uniform(0.15e-3, 0.5e-3)
    thick, level = rng.uniform(0.2e-3, 0.8e-3), rng.uniform(0.6, 1.0)
    strip = band(target.surface, where, length, -deep - thick, -deep)

    def fault(light: Image, truth: Truth) -> Image:
        return np.maximum(light, np.float32(level) * _filled(light, truth, strip, 1.5))

    return Change(f"{length * 1e3:.1f} mm long, {deep * 1e3:.2f} mm inside, {place(target, where)}", fault=fault)


def water_drop(target: Target, rng: np.random.Generator) -> Change:
    """Return a drop of water on the lens: the image through it is blurred and displaced."""
    where, radius = target.spot(rng), rng.uniform(1.5e-3, 2.5e-3)
    middle = target.surface[where] + rng.normal(0.0, 0.4e-3, 2)
    strength, blur, prism = rng.uniform(-0.25, 0.4), rng.uniform(2.0, 12.0), rng.normal(0.0, 3.0, 2)

    def fault(light: Image, truth: Truth) -> Image:
        (x, y), far, size = _disk(light, truth, middle, radius)
        rows, columns = np.indices(light.shape, dtype=np.float32)
        inner = np.maximum(0.0, 1.0 - (far / size) ** 2)
        seen = _moved(light, inner * (strength * (columns - x) + prism[0]), inner * (strength * (rows - y) + prism[1]))
        share = np.clip((size - far) / 6.0, 0.0, 1.0).astype(np.float32)
        return light * (1.0 - share) + cv2.GaussianBlur(seen, (0, 0), blur) * share

    return Change(f"radius {radius * 1e3:.1f} mm, {place(target, where)}", fault=fault)


def smear(target: Target, rng: np.random.Generator) -> Change:
    """Fat on the lens: a patch is blurred, and some light spreads over it."""
    where, radius, blur = target.spot(rng), rng.uniform(1e-3, 5e-3), rng.uniform(2.0, 10.0)
    middle, haze = target.surface[where] + rng.normal(0.0, 0.5e-3, 2), rng.uniform(0.0, 0.15)

    def fault(light: Image, truth: Truth) -> Image:
        _, far, size = _disk(light, truth, middle, radius)
        share = np.clip((size - far) / (0.3 * size), 0.0, 1.0).astype(np.float32)
        return light * (1.0 - share) + (cv2.GaussianBlur(light, (0, 0), blur) * (1.0 - haze) + haze) * share

    return Change(f"radius {radius * 1e3:.1f} mm, {place(target, where)}", fault=fault)


def flare(target: Target, rng: np.random.Generator) -> Change:
    """Stray light that is added in a soft patch."""
    where, radius, level = target.spot(rng), rng.uniform(1e-3, 6e-3), rng.uniform(0.1, 0.6)
    middle = target.surface[where] + rng.normal(0.0, 2e-3, 2)

    def fault(light: Image, truth: Truth) -> Image:
        _, far, size = _disk(light, truth, middle, radius)
        return light + np.float32(level) * np.exp(-0.5 * (far / size) ** 2).astype(np.float32)

    return Change(f"radius {radius * 1e3:.1f} mm, {level:.2f} of white, {place(target, where)}", fault=fault)


def screen_bulge(target: Target, rng: np.random.Generator) -> Change:
    """Return the screen bulges or slides near the apex: the grid and the shadow on it are displaced."""
    where, size = target.spot(rng, 0.8), rng.uniform(90e-6, 220e-6) / target.scene["pixel_size"]
    # What is much smaller than the grid's cells lies between its lines, and nothing shows it.
    reach = rng.uniform(0.45, 0.9) * target.scene["grid_pitch"]
    middle, angle = target.surface[where] + rng.normal(0.0, 0.7e-3, 2), rng.uniform(0.0, 2.0 * np.pi)
    way, radial = size * np.array([np.cos(angle), np.sin(angle)]), rng.random() < 0.4

    def fault(light: Image, truth: Truth) -> Image:
        (x, y), far, wide = _disk(light, truth, middle, reach)
        bell = np.exp(-0.5 * (far / wide) ** 2)
        if not radial:
            return _moved(light, way[0] * bell, way[1] * bell)
        rows, columns = np.indices(light.shape, dtype=np.float32)
        return _moved(light, 1.6 * size * (columns - x) / wide * bell, 1.6 * size * (rows - y) / wide * bell)

    what = f"{size:.0f} px {'outwards' if radial else f'towards {np.degrees(angle):.0f} degrees'}"
    return Change(f"{what} over {reach * 1e3:.1f} mm, {place(target, where)}", fault=fault)


def shimmer(target: Target, rng: np.random.Generator) -> Change:
    """Hot air: the picture is bent by a smooth random field."""
    size, reach, seed = rng.uniform(20e-6, 60e-6), rng.uniform(1.5e-3, 8e-3), int(rng.integers(1 << 31))

    def fault(light: Image, truth: Truth) -> Image:
        per_px = truth.scene.pixel_size
        small = tuple(max(4, round(side * per_px / reach) + 3) for side in light.shape)
        fields = np.random.default_rng(seed).normal(0.0, size / per_px, (2, *small)).astype(np.float32)
        wide = [cv2.resize(field, light.shape[::-1], interpolation=cv2.INTER_CUBIC) for field in fields]
        return _moved(light, *(field * (size / per_px / field.std()) for field in wide))

    return Change(f"{size * 1e6:.0f} um over {reach * 1e3:.1f} mm", fault=fault)


def second_lamp(target: Target, rng: np.random.Generator) -> Change:
    """Return a second, weaker lamp beside the first."""
    share, aside = rng.uniform(0.1, 0.35), float(rng.choice([-1.0, 1.0])) * 10 ** rng.uniform(-4.0, -2.5)
    by = np.array([aside, rng.normal(0.0, 0.1) * aside])

    def fault(light: Image, truth: Truth) -> Image:
        scene = truth.scene
        rays = Rays(truth.matrix, truth.distortion, truth.homography, scene.width, scene.height)
        first, second = (
            shadowed(rays, shape * scene.magnification, scene.penumbra, scene.ambient, scene.lamp)
            for shape in (target.outline, target.outline + by)
        )
        return light * ((1.0 - share) * first + share * second) / first

    return Change(f"{share:.0%} from {aside * 1e3:+.2f} mm beside", fault=fault)


def shaken(target: Target, rng: np.random.Generator) -> Change:
    """Return the camera moves during the exposure."""
    length, angle = int(rng.integers(2, 26)), rng.uniform(0.0, np.pi)
    kernel = np.zeros((2 * length + 1, 2 * length + 1), np.float32)
    for part in np.linspace(-0.5, 0.5, 8 * length):
        spot = np.rint(length + part * length * np.array([np.sin(angle), np.cos(angle)])).astype(int)
        kernel[spot[0], spot[1]] += 1.0
    kernel /= kernel.sum()
    return Change(f"{length} px, {np.degrees(angle):.0f} degrees", fault=lambda light, truth: cv2.filter2D(light, -1, kernel))


def place(target: Target, where: int) -> str:
    return f"{(target.surface[where, 0] - target.surface[target.apex, 0]) * 1e3:+.1f} mm beside the apex"


def band(surface: Array, where: int, length: float, low: float, high: float) -> Array:
    """Return the polygon (k, 2) of a band along a surface (n, 2), ``low`` to ``high`` above it, ``length`` long about a
    place."""
    arc = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(surface, axis=0), axis=1))]
    at = np.linspace(arc[where] - 0.5 * length, arc[where] + 0.5 * length, 120)
    line = np.column_stack([np.interp(at, arc, surface[:, axis]) for axis in (0, 1)])
    along = np.gradient(line, axis=0)
    up = np.column_stack([-along[:, 1], along[:, 0]]) / np.maximum(np.linalg.norm(along, axis=1), 1e-12)[:, None]
    return np.vstack([line + low * up, (line + high * up)[::-1]])


def _filled(light: Image, truth: Truth, polygon: Array, blur: float) -> Image:
    """Return 1 within a polygon (k, 2) in m and 0 outside, softened by ``blur`` in px, shape (h, w)."""
    mask = np.zeros(light.shape, np.uint8)
    cv2.fillPoly(mask, [np.rint(truth.to_pixels(polygon) * 16).astype(np.int32)], 255, cv2.LINE_AA, shift=4)
    return cv2.GaussianBlur(mask.astype(np.float32) / 255.0, (0, 0), blur)


def _disk(light: Image, truth: Truth, middle: Array, radius: float) -> tuple[Array, Array, float]:
    """Return the middle (2,) in px of a disk on the screen, every pixel's distance (h, w) from it in px, and its radius in
    px."""
    spots = truth.to_pixels(middle + radius * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
    rows, columns = np.indices(light.shape)
    far = np.hypot(columns - spots[0, 0], rows - spots[0, 1])
    return spots[0], far, float(np.mean(np.linalg.norm(spots[1:] - spots[0], axis=1)))


def _moved(light: Image, right: Array, down: Array) -> Image:
    """Return the picture (h, w) with what is at each pixel brought from where it was, so far to the left and above."""
    rows, columns = np.indices(light.shape, dtype=np.float32)
    source = columns - np.asarray(right, np.float32), rows - np.asarray(down, np.float32)
    return np.asarray(cv2.remap(light, *source, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE))
