"""How much light each pixel of a synthetic photograph gets; formulas in the screen's plane, no picture is ever warped."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RectBivariateSpline
from scipy.spatial import cKDTree
from scipy.special import ndtr

Array = NDArray[np.float64]
Image = NDArray[np.float32]

BLOCK = 16
"""Pixels between the rays that are followed exactly; between them a spline is right to a thousandth of a pixel."""

REACH = 5.0
"""Standard deviations of the penumbra beyond which light is full or none to a part in a million."""


def bent(u: Array, v: Array, k: Array) -> tuple[Array, Array]:
    """Where a lens with k1, k2, p1, p2, k3 shows the direction (u, v): Brown's model as OpenCV's manual writes it."""
    r2 = u * u + v * v
    radial = 1.0 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]))
    return (
        u * radial + 2.0 * k[2] * u * v + k[3] * (r2 + 2.0 * u * u),
        v * radial + k[2] * (r2 + 2.0 * v * v) + 2.0 * k[3] * u * v,
    )


def straightened(u: Array, v: Array, k: Array) -> tuple[Array, Array]:
    """The inverse of `bent`: each round moves the guess by what it misses."""
    a, b = u.copy(), v.copy()
    with np.errstate(over="ignore", invalid="ignore"):  # beyond a lens' reach there is no answer
        for _ in range(100):
            c, d = bent(a, b, k)
            a, b = a + (u - c), b + (v - d)
            if max(np.abs(u - c).max(initial=0.0), np.abs(v - d).max(initial=0.0)) < 1e-12:
                break
    return a, b


def screen(matrix: Array, k: Array, homography: Array, x: Array, y: Array) -> tuple[Array, Array]:
    """Places (X, Z) on the screen in m that pixels (x, y) of the photograph show."""
    u, v = straightened((x - matrix[0, 2]) / matrix[0, 0], (y - matrix[1, 2]) / matrix[1, 1], k)
    ideal = np.stack([u * matrix[0, 0] + matrix[0, 2], v * matrix[1, 1] + matrix[1, 2], np.ones_like(u)])
    place = np.tensordot(homography, ideal, axes=1)
    return place[0] / place[2], place[1] / place[2]


class Rays:
    """The screen's place for every pixel, by splines through rays that were followed exactly."""

    def __init__(self, matrix: Array, k: Array, homography: Array, width: int, height: int) -> None:
        """Follow a ray every `BLOCK` pixels."""
        # The rays go a little beyond the frame, so that no pixel lies at the splines' ends.
        self.columns = np.arange(-BLOCK, width + 2 * BLOCK, BLOCK, dtype=float)
        self.rows = np.arange(-BLOCK, height + 2 * BLOCK, BLOCK, dtype=float)
        x, y = np.meshgrid(self.columns, self.rows)
        self.size = (height, width)
        self.splines = tuple(
            RectBivariateSpline(self.rows, self.columns, place) for place in screen(matrix, k, homography, x, y)
        )

    def strip(self, first: int, last: int) -> tuple[Array, Array]:
        """X and Z (last - first, width) in m of whole rows."""
        rows, columns = np.arange(first, last, dtype=float), np.arange(self.size[1], dtype=float)
        return self.splines[0](rows, columns), self.splines[1](rows, columns)

    def footprints(self, row: float) -> tuple[Array, Array]:
        """Extent in m of the pixels (width,) of a row along X and along Z."""
        columns = np.arange(self.size[1], dtype=float)
        extents = [np.hypot(spline(row, columns, dx=1)[0], spline(row, columns, dy=1)[0]) for spline in self.splines]
        return extents[0], extents[1]

    def at(self, rows: Array, columns: Array) -> Array:
        """Places (n, 2) in m of single pixels."""
        return np.column_stack([spline(rows, columns, grid=False) for spline in self.splines])


def gridded(rays: Rays, pitch: float, line_width: float, grey: float) -> Image:
    """Share of light (h, w) that the screen with its grid throws back, each pixel the mean over its own extent."""
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
    """Light (h, w) of a lamp that is brightest a little off the middle; the frame's far corner lacks the share given."""
    x = (np.arange(width, dtype=np.float32) / width - 0.45) / 0.55
    y = (np.arange(height, dtype=np.float32) / height - 0.45) / 0.55
    return (1.0 - 0.5 * unevenness * (x[None, :] ** 2 + y[:, None] ** 2)).astype(np.float32)


def _seen_of_gaussian(z: Array) -> Array:
    return np.asarray(ndtr(z))


def _seen_of_disc(z: Array) -> Array:
    # What a chord at the distance t from a disc's middle cuts off; its standard deviation is half of its radius.
    t = np.clip(0.5 * z, -1.0, 1.0)
    return np.asarray(0.5 + (t * np.sqrt(1.0 - t * t) + np.arcsin(t)) / np.pi)


def _seen_of_square(z: Array) -> Array:
    return np.asarray(np.clip(0.5 + z / np.sqrt(12.0), 0.0, 1.0))


LAMPS = {"gaussian": _seen_of_gaussian, "disc": _seen_of_disc, "square": _seen_of_square}
"""Share of a lamp that is seen at distances from the shadow's edge in standard deviations of its penumbra."""


def shadowed(rays: Rays, polygon: Array, penumbra: float, ambient: float, lamp: str = "gaussian") -> Image:
    """Share of light (h, w) beside and in the shadow of a polygon (k, 2) on the screen in m; the lamp is one of `LAMPS`."""
    height, width = rays.size
    outline = Outline(polygon, spacing=penumbra / 2)
    rows, columns = np.meshgrid(
        np.arange(BLOCK / 2, height + BLOCK, BLOCK), np.arange(BLOCK / 2, width + BLOCK, BLOCK), indexing="ij"
    )
    middle = rays.at(np.minimum(rows, height).ravel(), np.minimum(columns, width).ravel()).reshape(*rows.shape, 2)
    radius = BLOCK * max(float(extent.max()) for row in (0, height - 1) for extent in rays.footprints(row)) * 1.5
    coarse = outline.distance(middle.reshape(-1, 2)).reshape(rows.shape)
    share = np.repeat(np.repeat((coarse > 0.0).astype(np.float32), BLOCK, axis=0), BLOCK, axis=1)[:height, :width]
    near = np.repeat(np.repeat(np.abs(coarse) < REACH * penumbra + radius, BLOCK, axis=0), BLOCK, axis=1)[
        :height, :width
    ]
    y, x = np.nonzero(near)
    for part in range(0, len(y), 500_000):
        piece = slice(part, part + 500_000)
        places = rays.at(y[piece].astype(float), x[piece].astype(float))
        # The lamp's image blurs the silhouette: on a curved edge, half of the light shifts towards the centre of curvature.
        shift = 0.5 * penumbra**2 * outline.curvature(places, penumbra)
        share[y[piece], x[piece]] = LAMPS[lamp]((outline.distance(places) + shift) / penumbra)
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
        self.sides, keep = self.sides, np.linalg.norm(self.sides, axis=1) > 0.0
        self.points, self.sides = self.points[keep], self.sides[keep]
        area = np.sum(corners[:, 0] * ends[:, 1] - corners[:, 1] * ends[:, 0])
        normals = np.column_stack([self.sides[:, 1], -self.sides[:, 0]]) * np.sign(area)
        self.normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        self.tree = cKDTree(self.points)

    def distance(self, places: Array) -> Array:
        """Distance (n,) in m from the outline, negative inside."""
        _, nearest = self.tree.query(places, workers=-1)
        best = np.full(len(places), np.inf)
        signed = np.empty(len(places))
        # At a corner neither side alone tells inside from outside, but the sum of their normals does
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

    def curvature(self, places: Array, width: float) -> Array:
        """Curvature (n,) in 1/m of the nearest edge, positive where it is convex; 0 near corners, over ``width`` in m or less.

        A circle's penumbra is no corner's; those have their own, which the distance alone gives well enough.
        """
        # Twice the area over the product of a triangle's sides, over some widths of the penumbra.
        step = max(2, round(3.0 * width / float(np.median(np.linalg.norm(self.sides, axis=1)))))
        if len(self.points) < 4 * step:
            return np.zeros(len(places))
        here = self.points
        back, ahead = np.roll(here, step, axis=0) - here, np.roll(here, -step, axis=0) - here
        lengths = np.linalg.norm(back, axis=1) * np.linalg.norm(ahead, axis=1) * np.linalg.norm(ahead - back, axis=1)
        middle = self.normals + np.roll(self.normals, 1, axis=0)
        area = np.abs(back[:, 0] * ahead[:, 1] - back[:, 1] * ahead[:, 0])
        bend = -np.sign(np.sum((back + ahead) * middle, axis=1)) * 2.0 * area / np.maximum(lengths, 1e-30)
        corner = np.abs(bend) * width > 0.2
        near = np.convolve(np.r_[corner[-step:], corner, corner[:step]], np.ones(2 * step + 1), "valid") > 0.0
        _, nearest = self.tree.query(places, workers=-1)
        return np.where(near, 0.0, bend)[nearest]
