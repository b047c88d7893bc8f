"""Photographs traced ray by ray: an independent model of lamp, body, camera and sensor for tests of `measurement`.

Nothing here is shared with `measurement` or its synthetic photographer. A lamp is a set of points on a disc, a square, a
ring, an array of diodes or the sun; from each of them the body's shadow on the screen is a perspective projection of the body
in three dimensions, and a place on the screen is lit by the points whose shadow it does not lie in, nor in that of a second
thing. No penumbra is assumed. The camera is a pinhole, or a lens with a depth of field; each pixel is averaged over its area,
then blurred, given shot noise, a tone curve, sharpening, and stored with 8 bits.

X runs to the right and Z upwards on the screen, Y along the light; the body stands about Y = 0, the screen at
``screen_distance`` behind it and the lamp at ``lamp_distance`` before it. Lengths are in m, angles in degrees.
"""

from __future__ import annotations

import dataclasses
import itertools

import cv2
import numpy as np

SUPER, SMOOTH = 2, 8.0
"""Places per side of a pixel at which light is computed where the shadow is near, and the half width of a penumbra in px from
which one does."""


@dataclasses.dataclass(frozen=True)
class Lamp:
    """A lamp.

    Attributes:
        kind: ``disc``, ``square``, ``gaussian`` (a frosted bulb), ``ring``, ``diodes`` (a square array of chips) or ``sun``
            (a disc that is darker towards its rim).
        size: Diameter of the disc, the ring or the sun, side of the square or the array, or standard deviation.
        turned: Angle by which a square or an array is turned in its plane.
        raised: Angle by which the lamp stands above the level of the body.
        points: Points on it.
        hole: Inner diameter of a ring over its outer one.
        rows, chip: Diodes along each side of an array, and a chip's side over their distance.
    """

    kind: str = "disc"
    size: float = 12e-3
    turned: float = 0.0
    raised: float = 0.0
    points: int = 400
    hole: float = 0.75
    rows: int = 6
    chip: float = 0.5

    def places(self, seed: int) -> np.ndarray:
        """Points (n, 2) on the lamp about its centre; each has one opposite of it."""
        half = self.points // 2
        if self.kind in ("square", "diodes"):
            side = round(np.sqrt(self.points))
            at = (np.arange(side) + 0.5) / side - 0.5
            if self.kind == "diodes":
                each = max(1, side // self.rows)
                chip = self.chip * ((np.arange(each) + 0.5) / each - 0.5)
                at = ((np.arange(self.rows)[:, None] + 0.5 + chip) / self.rows - 0.5).ravel()
            spots = self.size * np.column_stack([part.ravel() for part in np.meshgrid(at, at)])
        else:
            # A spiral covers the disc evenly (Vogel 1979); its mirror image keeps it symmetric.
            k = np.arange(half) + 0.5
            share = k / half
            if self.kind == "ring":
                share = self.hole**2 + (1.0 - self.hole**2) * share
            if self.kind == "sun":
                # Light 0.4 + 0.6 cos(angle) over the disc, the angle between the way to us and the sun's surface.
                inner = np.linspace(0.0, 1.0, 1001)
                share = np.interp(share, (inner + 1.0 - (1.0 - inner) ** 1.5) / 2.0, inner)
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
        gives, gives_at, gives_over: How far each side bulges outwards, at which depth most, and over which half height; of a
            block or a sheet.
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
    gives: float = 0.0
    gives_at: float = 3e-3
    gives_over: float = 2e-3

    def half_width(self, z: np.ndarray) -> np.ndarray:
        """Half width at heights z of the body's plane."""
        off = (z - self.floor + self.gives_at) / self.gives_over
        return self.width + self.gives * np.maximum(1.0 - off * off, 0.0) ** 2

    def rise(self, x: np.ndarray, y: np.ndarray | float = 0.0) -> np.ndarray:
        """Height of the surface above the undeformed top."""
        share = np.clip((x * x + y * y) / self.dome**2, 0.0, 1.0)
        return self.height * (1.0 - share) ** self.pitch

    def slices(self, x: np.ndarray) -> np.ndarray:
        """Places (k, n) along the light at which the body is looked at beside each of x (n,): from rim to rim."""
        half = np.full(len(x), self.depth)
        if self.depth > 0.0 and self.round:
            half = self.depth * np.sqrt(np.maximum(1.0 - (x / self.width) ** 2, 0.0))
        return np.linspace(-1.0, 1.0, 25 if self.depth > 0.0 else 1)[:, None] * half


@dataclasses.dataclass(frozen=True)
class Thing:
    """A second thing in the light: all that is nearer to a path than a radius, in a plane square to the light.

    Attributes:
        kind: What it is, for the reader.
        path: Places X, Z on it (k, 2), joined by straight lines; a ball has one.
        radius: Half of its thickness.
        nearer: How much nearer to the lamp than the body's middle it stands.
    """

    kind: str
    path: tuple[tuple[float, float], ...]
    radius: float
    nearer: float = 0.0

    def outside(self, x: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Distances of places from it, negative inside."""
        corners = np.array(self.path, dtype=float)
        far = np.hypot(x - corners[0, 0], z - corners[0, 1])
        for (x0, z0), (x1, z1) in itertools.pairwise(corners):
            a, b = x1 - x0, z1 - z0
            share = np.clip(((x - x0) * a + (z - z0) * b) / (a * a + b * b), 0.0, 1.0)
            far = np.minimum(far, np.hypot(x - x0 - share * a, z - z0 - share * b))
        return far - self.radius


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
        opening: Diameter of the lens' opening; 0 for a pinhole, which has no depth of field.
        focus: How much farther than the screen in the picture's middle the camera is focused.
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
    opening: float = 0.0
    focus: float = 0.0

    @property
    def magnification(self) -> float:
        """Size of the shadow over that of the body."""
        return (self.lamp_distance + self.screen_distance) / self.lamp_distance

    def confusion(self, px: np.ndarray) -> np.ndarray:
        """Diameters (...) in px of the disc that a thin lens makes of a point of the screen seen at pixels (..., 2)."""
        # The pixels are a plane's perspective picture: 1 over a place's distance along the axis is linear in them.
        places = np.concatenate([self.on_screen(px), np.ones((*px.shape[:-1], 1))], axis=-1)
        away, at = places @ self.matrix[2], self.pixel * self.focal + self.focus
        return np.abs(self.opening * self.focal * (away - at) / (away * at))

    @property
    def matrix(self) -> np.ndarray:
        """Homography (3, 3) from the screen (X, Z, 1) to pixels; the third row gives the distance from the camera."""
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
        tone: ``srgb``, ``linear`` or a gamma such as ``2.2``.
        s_curve: Strength of the S curve that the camera adds to sRGB's.
        sharpening, radius: Amount and radius in px of an unsharp mask on the stored numbers.
        quality: Of the JPEG; None for none.
        motion, towards: Length in px of the way that the picture moves during the exposure, and its angle.
        denoised: Strength in standard deviations of the noise with which a phone smooths it away, edges left; 0 for none.
    """

    blur: float = 0.9
    exposure: float = 0.6
    noise: float = 0.008
    tone: str = "srgb"
    s_curve: float = 0.0
    sharpening: float = 0.0
    radius: float = 1.2
    quality: int | None = 94
    motion: float = 0.0
    towards: float = 0.0
    denoised: float = 0.0

    def stored(self, light: np.ndarray, seed: int) -> np.ndarray:
        """The picture (h, w, 3) of light (h, w) from 0 to 1."""
        rng = np.random.default_rng(seed)
        light = cv2.GaussianBlur(light, (0, 0), self.blur) * self.exposure
        if self.motion:
            light = cv2.filter2D(light, -1, _way(self.motion, self.towards), borderType=cv2.BORDER_REPLICATE)
        channels = []
        for warm in (1.0, 0.97, 0.9):
            own = light * warm
            own = own + self.noise * np.sqrt(np.maximum(own, 1e-4) + 0.02) * rng.standard_normal(own.shape)
            own = np.clip(own, 0.0, 1.0)
            if self.tone == "srgb":
                own = np.where(own <= 0.0031308, 12.92 * own, 1.055 * own ** (1 / 2.4) - 0.055)
            elif self.tone != "linear":
                own = own ** (1.0 / float(self.tone))
            channels.append((1.0 - self.s_curve) * own + self.s_curve * own**2 * (3.0 - 2.0 * own))
        picture = np.stack(channels, axis=-1).astype(np.float32)
        if self.sharpening:
            luma = picture @ np.float32([0.299, 0.587, 0.114])
            picture += self.sharpening * (luma - cv2.GaussianBlur(luma, (0, 0), self.radius))[..., None]
        picture = np.clip(np.rint(255.0 * picture), 0, 255).astype(np.uint8)
        if self.denoised:
            scatter = float(np.median(np.abs(np.diff(picture[..., 1].astype(float))))) / 0.954
            picture = cv2.fastNlMeansDenoising(picture, None, self.denoised * max(scatter, 1.0), 5, 15)
        if self.quality is None:
            return picture
        packed = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, self.quality])[1]
        return np.ascontiguousarray(cv2.imdecode(packed, cv2.IMREAD_COLOR)[..., ::-1])


def photograph(bench: Bench, sensor: Sensor, body: Body | None, seed: int = 0, things: tuple[Thing, ...] = ()) -> np.ndarray:
    """The picture (h, w, 3) of the shadow of a body and of second things; of the grid alone without a body."""
    width, height = bench.size
    columns, rows = np.meshgrid(np.arange(width, dtype=float), np.arange(height, dtype=float))
    light = _printed(bench, columns, rows)
    if body is not None:
        light *= _lit(bench, body, columns, rows, seed, things)
    u, v = columns / width - 0.45, rows / height - 0.4
    light *= 1.0 - bench.falloff * (u * u + v * v) / 0.6
    light = light.astype(np.float32)
    if bench.opening:
        light = _out_of_focus(light, bench.confusion(np.stack([columns, rows], axis=-1)))
    return sensor.stored(light, seed + 1)


def _way(length: float, angle: float) -> np.ndarray:
    """The share of a straight way about the middle in each pixel (n, n)."""
    half, at = int(np.ceil(0.5 * length)), np.linspace(-0.5, 0.5, 401) * length
    across, down = (at * part(np.radians(angle)) for part in (np.cos, np.sin))
    share = np.histogram2d(down, across, np.arange(2 * half + 2) - half - 0.5)[0]
    return (share / share.sum()).astype(np.float32)


FOCUS_STEP = 0.5
"""Diameters in px between which pictures out of focus are mixed."""


def _out_of_focus(light: np.ndarray, diameter: np.ndarray) -> np.ndarray:
    """Light (h, w) in which each place is a disc of a diameter (h, w) in px."""
    share = diameter / FOCUS_STEP
    result = np.zeros_like(light)
    for number in range(int(share.max()) + 2):
        weight = np.maximum(1.0 - np.abs(share - number), 0.0).astype(np.float32)
        if weight.any():
            result += weight * (cv2.filter2D(light, -1, _disc(number * FOCUS_STEP)) if number else light)
    return result


def _disc(diameter: float) -> np.ndarray:
    """The share of a disc in each pixel (n, n) about its middle."""
    half = int(np.ceil(0.5 * diameter))
    at = (np.arange((2 * half + 1) * 16) + 0.5) / 16 - half - 0.5
    inside = np.hypot(at[:, None], at) < 0.5 * diameter
    share = inside.reshape(2 * half + 1, 16, 2 * half + 1, 16).mean(axis=(1, 3))
    return (share / share.sum()).astype(np.float32)


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


def _lit(
    bench: Bench, body: Body, columns: np.ndarray, rows: np.ndarray, seed: int, things: tuple[Thing, ...] = ()
) -> np.ndarray:
    """Share of light (h, w) that is in no shadow: the lamp's seen part, and what is ambient."""
    middle = bench.on_screen(np.stack([columns, rows], axis=-1))
    ends = float(middle[..., 0].min()), float(middle[..., 0].max())
    shadows = [_Shadow(bench, body, spot, *ends) for spot in bench.lamp.places(seed)]
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
        edges = np.array([shadow.side(side, gives) for shadow in shadows for gives in (0.0, body.gives)])
        beyond, near = (side * x > side * edges.mean()), (x > edges.min() - margin) & (x < edges.max() + margin)
        low, top = np.where(beyond, tables.min(), low), np.where(beyond, tables.max(), top)
        low, top = np.where(near, -np.inf, low), np.where(near, np.inf, top)
    lit = np.where(z > top + margin, 1.0, 0.0)
    rest = (z > low - margin) & (z <= top + margin)
    for thing in things:
        reach = 2.0 * margin + max(float(np.hypot(*shadow.spot)) for shadow in shadows) * shadows[0].share_at(thing)
        off = thing.outside(*shadows[0].seen_past(thing, x, z, centre=True))
        rest = (rest | (np.abs(off) < reach)) & (off > -reach)
        lit = np.where(off <= -reach, 0.0, lit)
    y, c = np.nonzero(rest)
    penumbra = bench.magnification - 1.0
    penumbra *= max(float(np.hypot(*shadow.spot)) for shadow in shadows) / bench.pixel
    count = SUPER if penumbra < SMOOTH else 1
    parts = (np.arange(count) + 0.5) / count - 0.5
    total = np.zeros(len(y))
    for a in parts:
        for b in parts:
            place = bench.on_screen(np.column_stack([c + a, y + b]))
            for shadow in shadows:
                total += shadow.misses(place[:, 0], place[:, 1], things)
    lit[y, c] = total / (count**2 * len(shadows))
    return bench.ambient + (1.0 - bench.ambient) * lit


class _Shadow:
    """The shadow that one point of the lamp throws: what lies below a curve over X on the screen."""

    def __init__(self, bench: Bench, body: Body, spot: np.ndarray, low: float, high: float) -> None:
        self.bench, self.body, self.spot, distance = bench, body, spot, bench.lamp_distance
        level = body.floor + distance * np.tan(np.radians(bench.lamp.raised))
        self.lamp = np.array([spot[0], level + spot[1]])
        self.x = np.arange(low - 1e-3, high + 1e-3, 30e-6)
        self.share = bench.screen_distance / (distance + bench.screen_distance)
        self.level = np.full(len(self.x), -np.inf)
        tilt = np.tan(np.radians(body.lean))
        for y in body.slices(self._within(self.x)):
            share = (bench.screen_distance - y) / (distance + bench.screen_distance)
            at = self.x + (self.lamp[0] - self.x) * share
            top = body.floor + body.rise(at, y) + tilt * y
            self.level = np.maximum(self.level, (top - self.lamp[1] * share) / (1.0 - share))
        self.table = -1.0
        if body.table is not None:
            self.table = (body.floor - body.table - self.lamp[1] * self.share) / (1.0 - self.share)
        # The curve over X is continued beyond the sides, which are looked at by themselves.
        known = np.abs(self._within(self.x)) <= body.width
        self.level = np.interp(self.x, self.x[known], self.level[known])

    def _within(self, x: np.ndarray) -> np.ndarray:
        return x + (self.lamp[0] - x) * self.share

    def side(self, sign: float, gives: float = 0.0) -> float:
        """X on the screen of a side's shadow, where it bulges outwards so far."""
        return float((sign * (self.body.width + gives) - self.lamp[0] * self.share) / (1.0 - self.share))

    def share_at(self, thing: Thing) -> float:
        """Share of the way from the screen to the lamp at which a second thing stands."""
        bench = self.bench
        return (bench.screen_distance + thing.nearer) / (bench.lamp_distance + bench.screen_distance)

    def seen_past(self, thing: Thing, x: np.ndarray, z: np.ndarray, centre: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """Places in a thing's plane through which places on the screen see this point, or the lamp's centre."""
        lamp = self.lamp - self.spot if centre else self.lamp
        share = self.share_at(thing)
        return x + (lamp[0] - x) * share, z + (lamp[1] - z) * share

    def misses(self, x: np.ndarray, z: np.ndarray, things: tuple[Thing, ...] = ()) -> np.ndarray:
        """Whether light from this point reaches places on the screen."""
        at = (x - self.x[0]) / (self.x[1] - self.x[0])
        cell = np.clip(at.astype(np.int64), 0, len(self.x) - 2)
        level = self.level[cell] + (at - cell) * (self.level[cell + 1] - self.level[cell])
        width = self.body.width
        if self.body.gives:
            width = self.body.half_width(z + (self.lamp[1] - z) * self.share)
        beside = np.abs(self._within(x)) > width
        free = z > np.where(beside, self.table, level)
        for thing in things:
            free &= thing.outside(*self.seen_past(thing, x, z)) > 0.0
        return free
