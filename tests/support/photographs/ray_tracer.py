"""Photographs traced ray by ray: an independent model of lamp, body, camera and sensor for tests of `measurement`.

Nothing here is shared with `measurement` or its synthetic photographer. A lamp is a set of points on a disc, a square or a
ribbon; from each of them the body's shadow on the screen is a perspective projection of the body in three dimensions, and a
place on the screen is lit by the points whose shadow it does not lie in. No penumbra is assumed. The camera is a pinhole;
each pixel is averaged over its area, then blurred, given shot noise, a tone curve, sharpening, and stored with 8 bits.

X runs to the right and Z upwards on the screen, Y along the light; the body stands about Y = 0, the screen at
``screen_distance`` behind it and the lamp at ``lamp_distance`` before it. Lengths are in m, angles in degrees.
"""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np

SUPER = 2
"""Places per side of a pixel at which light is computed where the shadow or a line is near."""


@dataclasses.dataclass(frozen=True)
class Lamp:
    """A lamp.

    Attributes:
        kind: ``disc``, ``square`` or ``gaussian`` (a frosted bulb).
        size: Diameter of the disc, side of the square, or standard deviation.
        turned: Angle by which a square is turned in its plane.
        raised: Angle by which the lamp stands above the level of the body.
        points: Points on it.
    """

    kind: str = "disc"
    size: float = 12e-3
    turned: float = 0.0
    raised: float = 0.0
    points: int = 400

    def places(self, seed: int) -> np.ndarray:
        """Points (n, 2) on the lamp about its centre; each has one opposite of it."""
        half = self.points // 2
        if self.kind == "square":
            side = round(np.sqrt(self.points))
            at = (np.arange(side) + 0.5) / side - 0.5
            spots = self.size * np.column_stack([part.ravel() for part in np.meshgrid(at, at)])
        else:
            # A spiral covers the disc evenly (Vogel 1979); its mirror image keeps it symmetric.
            k = np.arange(half) + 0.5
            share = k / half
            radius = 0.5 * self.size * np.sqrt(share)
            if self.kind == "gaussian":
                radius = self.size * np.sqrt(-2.0 * np.log(1.0 - share * (1.0 - 1e-4)))
            angle = k * np.pi * (3.0 - np.sqrt(5.0)) + seed
            first = radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
            spots = np.vstack([first, -first])
        c, s = np.cos(np.radians(self.turned)), np.sin(np.radians(self.turned))
        return spots @ np.array([[c, s], [-s, c]])


@dataclasses.dataclass(frozen=True)
class Body:
    """An inflated disk: a flat top with a dome on it, round or as a block, perhaps on a table.

    Attributes:
        height: Height of the dome.
        dome: Radius of the dome.
        width: Half width of the body.
        depth: Half depth along the light: its half width for a round body, 0 for a sheet.
        round: Whether it is round seen from above; a block otherwise.
        floor: Z of its undeformed top.
        lean: Angle by which it leans towards the screen.
        pitch: Exponent of the dome's shape, (1 - r^2)^pitch.
        table: Depth of the table below the top; None for no table in the picture.
    """

    height: float = 5e-3
    dome: float = 11e-3
    width: float = 0.2
    depth: float = 0.0
    round: bool = True
    floor: float = -5.5e-3
    lean: float = 0.0
    pitch: float = 3.0
    table: float | None = None

    def rise(self, x: np.ndarray, y: np.ndarray | float = 0.0) -> np.ndarray:
        """Height of the surface above the undeformed top."""
        share = np.clip((x * x + y * y) / self.dome**2, 0.0, 1.0)
        return self.height * (1.0 - share) ** self.pitch

    def slices(self) -> np.ndarray:
        """Places along the light at which the body is looked at."""
        return np.array([0.0]) if self.depth == 0.0 else np.linspace(-self.depth, self.depth, 61)


@dataclasses.dataclass(frozen=True)
class Bench:
    """Lamp, screen and camera.

    Attributes:
        lamp: The lamp.
        lamp_distance: From the lamp to the body.
        screen_distance: From the body to the screen.
        size: Width and height of the picture in px.
        pixel: Length on the screen that a pixel spans in the middle.
        focal: Focal length in px.
        aside, above, turned: Angles by which the camera stands beside and above the screen's normal, and is rolled.
        looks_at: X, Z of the screen in the picture's middle.
        pitch: True pitch of the printed grid.
        line, ink: Width of a line and the share of light that it takes.
        ambient: Share of light in the shadow.
        falloff: Share of light missing in the picture's corners.
    """

    lamp: Lamp = dataclasses.field(default_factory=Lamp)
    lamp_distance: float = 2.0
    screen_distance: float = 30e-3
    size: tuple[int, int] = (1000, 640)
    pixel: float = 28e-6
    focal: float = 3000.0
    aside: float = 15.0
    above: float = 8.0
    turned: float = 0.5
    looks_at: tuple[float, float] = (0.0, 0.5e-3)
    pitch: float = 4.5e-3
    line: float = 0.4e-3
    ink: float = 0.3
    ambient: float = 0.12
    falloff: float = 0.15

    @property
    def magnification(self) -> float:
        """Size of the shadow over that of the body."""
        return (self.lamp_distance + self.screen_distance) / self.lamp_distance

    @property
    def matrix(self) -> np.ndarray:
        """Homography (3, 3) from the screen (X, Z, 1) to pixels."""
        b, a, c = (np.radians(value) for value in (self.aside, self.above, self.turned))
        # The camera stands before the screen at the distance at which a pixel has its length, and looks at `looks_at`.
        back = np.array([np.sin(b) * np.cos(a), -np.cos(b) * np.cos(a), np.sin(a)])
        right = np.cross(-back, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        down = np.cross(-back, right)
        right, down = np.cos(c) * right + np.sin(c) * down, np.cos(c) * down - np.sin(c) * right
        eye = np.array([self.looks_at[0], 0.0, self.looks_at[1]]) + back * self.pixel * self.focal
        view = np.array([right, down, -back])
        columns = np.column_stack([view[:, 0], view[:, 2], -view @ eye])
        middle = (np.array(self.size) - 1.0) / 2.0
        return np.array([[self.focal, 0, middle[0]], [0, self.focal, middle[1]], [0, 0, 1]]) @ columns

    def on_screen(self, px: np.ndarray) -> np.ndarray:
        """X, Z (..., 2) on the screen of pixels (..., 2)."""
        rays = np.concatenate([px, np.ones((*px.shape[:-1], 1))], axis=-1) @ np.linalg.inv(self.matrix).T
        return rays[..., :2] / rays[..., 2:]

    def pixels(self, places: np.ndarray) -> np.ndarray:
        """Pixels (..., 2) of places X, Z (..., 2) on the screen."""
        rays = np.concatenate([places, np.ones((*places.shape[:-1], 1))], axis=-1) @ self.matrix.T
        return rays[..., :2] / rays[..., 2:]


@dataclasses.dataclass(frozen=True)
class Sensor:
    """Lens, sensor and what the camera makes of the light.

    Attributes:
        blur: Standard deviation of the lens' blur in px.
        exposure: Light of the lit screen, of what the sensor can record.
        noise: Standard deviation of the noise at full light, as a share of it; shot noise.
        tone: ``srgb`` or ``linear``.
        s_curve: Strength of the S curve that the camera adds to sRGB's.
        sharpening, radius: Amount and radius in px of an unsharp mask on the stored numbers.
        quality: Of the JPEG; None for none.
    """

    blur: float = 0.9
    exposure: float = 0.6
    noise: float = 0.008
    tone: str = "srgb"
    s_curve: float = 0.0
    sharpening: float = 0.0
    radius: float = 1.2
    quality: int | None = 94

    def stored(self, light: np.ndarray, seed: int) -> np.ndarray:
        """The picture (h, w, 3) of light (h, w) from 0 to 1."""
        rng = np.random.default_rng(seed)
        light = cv2.GaussianBlur(light, (0, 0), self.blur) * self.exposure
        channels = []
        for warm in (1.0, 0.97, 0.9):
            own = light * warm
            own = own + self.noise * np.sqrt(np.maximum(own, 1e-4) + 0.02) * rng.standard_normal(own.shape)
            own = np.clip(own, 0.0, 1.0)
            if self.tone == "srgb":
                own = np.where(own <= 0.0031308, 12.92 * own, 1.055 * own ** (1 / 2.4) - 0.055)
            channels.append((1.0 - self.s_curve) * own + self.s_curve * own**2 * (3.0 - 2.0 * own))
        picture = np.stack(channels, axis=-1).astype(np.float32)
        if self.sharpening:
            luma = picture @ np.float32([0.299, 0.587, 0.114])
            picture += self.sharpening * (luma - cv2.GaussianBlur(luma, (0, 0), self.radius))[..., None]
        picture = np.clip(np.rint(255.0 * picture), 0, 255).astype(np.uint8)
        if self.quality is None:
            return picture
        packed = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, self.quality])[1]
        return np.ascontiguousarray(cv2.imdecode(packed, cv2.IMREAD_COLOR)[..., ::-1])


def photograph(bench: Bench, sensor: Sensor, body: Body | None, seed: int = 0) -> np.ndarray:
    """The picture (h, w, 3) of a body's shadow; of the grid alone without a body."""
    width, height = bench.size
    columns, rows = np.meshgrid(np.arange(width, dtype=float), np.arange(height, dtype=float))
    light = _printed(bench, columns, rows)
    if body is not None:
        light *= _lit(bench, body, columns, rows, seed)
    u, v = columns / width - 0.45, rows / height - 0.4
    light *= 1.0 - bench.falloff * (u * u + v * v) / 0.6
    return sensor.stored(light.astype(np.float32), seed + 1)


def _printed(bench: Bench, columns: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Share of light (h, w) that the screen throws back: each line covers its part of every pixel."""
    place = bench.on_screen(np.stack([columns, rows], axis=-1))
    step = [bench.on_screen(np.stack([columns + a, rows + b], axis=-1)) - place for a, b in ((1, 0), (0, 1))]
    bare = np.ones(columns.shape)
    for axis in (0, 1):
        at = place[..., axis] - bench.pitch * np.rint(place[..., axis] / bench.pitch)
        reach = np.abs(step[0][..., axis]) + np.abs(step[1][..., axis])
        low, high = np.maximum(at - reach / 2, -bench.line / 2), np.minimum(at + reach / 2, bench.line / 2)
        bare *= 1.0 - np.maximum(high - low, 0.0) / reach
    return 1.0 - bench.ink * (1.0 - bare)


def _lit(bench: Bench, body: Body, columns: np.ndarray, rows: np.ndarray, seed: int) -> np.ndarray:
    """Share of light (h, w) that is not in the body's shadow: the lamp's seen part, and what is ambient."""
    middle = bench.on_screen(np.stack([columns, rows], axis=-1))
    shadows = [
        _Shadow(bench, body, spot, float(middle[..., 0].min()), float(middle[..., 0].max()))
        for spot in bench.lamp.places(seed)
    ]
    # Between the deepest and the highest of all shadows' edges, and beside the body's sides, a pixel is looked at closely.
    some = np.array([shadow.level for shadow in shadows])
    at = shadows[0].x
    margin = 3.0 * bench.pixel
    spread = np.max([some.max(axis=0), np.r_[some.max(axis=0)[1:], some.max()]], axis=0)
    x, z = middle[..., 0], middle[..., 1]
    top = np.maximum(np.interp(x - margin, at, spread), np.interp(x + margin, at, some.max(axis=0)))
    low = np.minimum(np.interp(x - margin, at, some.min(axis=0)), np.interp(x + margin, at, some.min(axis=0)))
    tables = np.array([shadow.table for shadow in shadows])
    for side in (-1.0, 1.0):
        edges = np.array([shadow.side(side) for shadow in shadows])
        beyond, near = (side * x > side * edges.mean()), (x > edges.min() - margin) & (x < edges.max() + margin)
        low, top = np.where(beyond, tables.min(), low), np.where(beyond, tables.max(), top)
        low, top = np.where(near, -np.inf, low), np.where(near, np.inf, top)
    lit = np.where(z > top + margin, 1.0, 0.0)
    rest = (z > low - margin) & (z <= top + margin)
    y, c = np.nonzero(rest)
    parts = (np.arange(SUPER) + 0.5) / SUPER - 0.5
    total = np.zeros(len(y))
    for a in parts:
        for b in parts:
            place = bench.on_screen(np.column_stack([c + a, y + b]))
            for shadow in shadows:
                total += shadow.misses(place[:, 0], place[:, 1])
    lit[y, c] = total / (SUPER**2 * len(shadows))
    return bench.ambient + (1.0 - bench.ambient) * lit


class _Shadow:
    """The shadow that one point of the lamp throws: what lies below a curve over X on the screen."""

    def __init__(self, bench: Bench, body: Body, spot: np.ndarray, low: float, high: float) -> None:
        self.body, distance = body, bench.lamp_distance
        level = body.floor + distance * np.tan(np.radians(bench.lamp.raised))
        self.lamp = np.array([spot[0], level + spot[1]])
        self.x = np.arange(low - 1e-3, high + 1e-3, 15e-6)
        self.level = np.full(len(self.x), -np.inf)
        tilt = np.tan(np.radians(body.lean))
        for y in body.slices():
            share = (bench.screen_distance - y) / (distance + bench.screen_distance)
            at = self.x + (self.lamp[0] - self.x) * share
            inside = np.abs(at) <= body.width
            if body.depth > 0.0 and body.round:
                inside = at**2 + (y * body.width / body.depth) ** 2 <= body.width**2
            top = body.floor + body.rise(at, y) + tilt * y
            z = (top - self.lamp[1] * share) / (1.0 - share)
            self.level = np.maximum(self.level, np.where(inside, z, -np.inf))
        self.share = bench.screen_distance / (distance + bench.screen_distance)
        self.table = -1.0
        if body.table is not None:
            self.table = (body.floor - body.table - self.lamp[1] * self.share) / (1.0 - self.share)
        # The curve over X is continued beyond the sides, which are looked at by themselves.
        known = np.isfinite(self.level) & (np.abs(self._within(self.x)) <= body.width)
        self.level = np.interp(self.x, self.x[known], self.level[known])

    def _within(self, x: np.ndarray) -> np.ndarray:
        return x + (self.lamp[0] - x) * self.share

    def side(self, sign: float) -> float:
        """X on the screen of a side's shadow."""
        return float((sign * self.body.width - self.lamp[0] * self.share) / (1.0 - self.share))

    def misses(self, x: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Whether light from this point reaches places on the screen."""
        at = (x - self.x[0]) / (self.x[1] - self.x[0])
        cell = np.clip(at.astype(np.int64), 0, len(self.x) - 2)
        level = self.level[cell] + (at - cell) * (self.level[cell + 1] - self.level[cell])
        beside = np.abs(self._within(x)) > self.body.width
        return z > np.where(beside, self.table, level)
