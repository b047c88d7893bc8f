"""Which pixels are shadow, and the light across its edge."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Sequence

import cv2
import numpy as np
import numpy.typing as npt
from scipy.ndimage import correlate1d
from scipy.optimize import OptimizeResult, least_squares
from scipy.special import betainc, chdtr, gammaincinv, ndtr
from skimage.filters import threshold_otsu

from measurement import pictures
from measurement.robust import deviation, deviations
from measurement.screen.look import GridLook
from measurement.screen.setup import Setup
from softmodels.common.arrays import Array, Mask


@dataclasses.dataclass(frozen=True, eq=False)
class Profiles:
    """Light across an edge at n stations along it, k samples each.

    Attributes:
        place: The stations in px, shape (n, 2).
        normal: Unit vectors from shadow to light, along which the samples lie, shape (n, 2).
        offsets: Distances of the samples from the stations in px, shape (k,).
        value: Light, averaged along the edge, shape (n, k).
        weight: 1 where all samples are clear of ink and inside of the picture, shape (n, k).
        points: Pixels that stand for the station's length, shape (n, m, k, 2).
    """

    place: Array
    normal: Array
    offsets: Array
    value: Array
    weight: Array
    points: Array

    @classmethod
    def across(cls, shading: Shading, path: Array, spacing: float, reach: float) -> Profiles:
        """Return the profiles from ``reach`` px in the shadow to ``reach`` px in the light, every ``spacing`` px of a path (m,
        2)."""
        place, normal = stations(path, spacing)
        offsets = np.linspace(-reach, reach, 2 * HALF_PROFILE_SAMPLES + 1)
        tangent = np.column_stack([-normal[:, 1], normal[:, 0]])
        count = max(1, round(min(spacing, LONGEST_STATION)))
        beside = np.arange(count) - (count - 1) / 2.0
        points = (
            place[:, None, None, :]
            + beside[None, :, None, None] * tangent[:, None, None, :]
            + offsets[None, None, :, None] * normal[:, None, None, :]
        )
        value = shading.level(points)
        weight = np.isfinite(value).astype(float)
        if shading.through is not None:
            ink = shading.through(points)
            value = value / ink
            weight *= 1.0 / (1.0 + ((1.0 - ink) * INK_TRUST / 0.01) ** 2)
        value = np.where(weight > 0.0, value, 0.0)
        total = weight.sum(axis=1)
        mean = (weight * value).sum(axis=1) / np.maximum(total, 1e-9)
        return cls(place, normal, offsets, mean, total / count, points[:, :: max(1, (count - 1) // 2)])

    @property
    def depth(self) -> float:
        """Share of the light that is missing at their dark ends, if it hardly changes at both ends any more; else 0."""
        light = np.median(self.value, axis=0)
        dark, next_dark, _, next_lit, lit = (float(np.median(part)) for part in np.split(light, np.array(END_SAMPLES)))
        flat = max(next_dark - dark, lit - next_lit) < FLATNESS_TOLERANCE * (lit - dark)
        return 1.0 - dark / lit if flat else 0.0

    def drawn(self, drawn: InkModel, z: Array, width: Array) -> Array:
        """Return what ink leaves in the profiles (n, k), averaged over the stations' lengths; see `InkModel`."""
        parts = range(self.points.shape[1])
        return np.asarray(np.mean([drawn(self.points[:, part], z, width) for part in parts], axis=0))


def stations(path: Array, spacing: float) -> tuple[Array, Array]:
    """Return the places (n, 2) at equal distances along a path, and its unit normals (n, 2): to the left of the way along
    it. Raises `Unmeasurable` for a path that is too short."""
    step = np.linalg.norm(np.diff(path, axis=0), axis=1)
    keep = np.r_[True, step > 1e-9]
    path, arc = path[keep], np.r_[0.0, np.cumsum(step[step > 1e-9])]
    if len(path) < 5 or arc[-1] < 5.0 * spacing:
        raise pictures.Unmeasurable("the shadow is too small to be measured; move the camera closer")
    s = np.arange(0.5 * spacing, arc[-1], spacing)

    def at(along: Array) -> Array:
        return np.column_stack([np.interp(along, arc, path[:, axis]) for axis in (0, 1)])

    # Directions come from a chord of several stations: a single step of a coarse contour turns with every pixel.
    chord = 3.0 * spacing
    tangent = at(np.minimum(s + chord, arc[-1])) - at(np.maximum(s - chord, 0.0))
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1), 1e-9)[:, None]
    return at(s), np.column_stack([tangent[:, 1], -tangent[:, 0]])


# ----------------------------------------------------------------------------------------------------------------------
# Which pixels are shadow: the Mahalanobis distance to the shadow's colour.
#
# The thesis marked a piece of shadow manually and took as shadow what lay within a Mahalanobis distance of 90 in the units of
# its own code: a number that changes with camera and light. The square of the distance of shadow pixels follows chi-square
# with as many degrees of freedom as there are channels, so `chi_square_limit` needs no tuning to say "this is the shadow's
# colour". It is no place for an edge, though: in a penumbra the colour leaves the shadow's scatter long before half of the
# lamp is out, and ever earlier the less noise there is. So the edge is taken on `ShadowColour.share`, the same distance with
# a sign, measured along the way to the lit screen and divided by the distance of the lit screen: 0 in the shadow, 1 on the
# lit screen, and 1/2 where half of the light arrives. It is linear in the light, so blur moves a straight edge nowhere, and
# of all mixtures of the channels it is the one with the least noise (Fisher's discriminant).
#
# Sources: P. J. Rousseeuw, K. Van Driessen, Technometrics 41 (1999) 212, doi 10.1080/00401706.1999.10485670 (the robust
# covariance); N. Otsu, IEEE Trans. Syst. Man Cybern. 9 (1979) 62, doi 10.1109/TSMC.1979.4310076.


SHADOW_CONFIDENCE = 0.999
"""Share of the shadow's own pixels within `chi_square_limit`."""

MOST_PIXELS = 4000
"""Pixels that a colour is learnt from; more do not change it."""

LIGHT_FLOOR = 1e-3
"""Least standard deviation of a channel's light: a stored number is an integer, so nothing is known more finely."""

SMALLEST_CONTRAST = 0.3
"""Least share of the screen's light that the shadow must take away."""


def chi_square_limit() -> float:
    """Return the squared Mahalanobis distance (three channels) below which `SHADOW_CONFIDENCE` of the shadow's pixels stay."""
    return float(2.0 * gammaincinv(1.5, SHADOW_CONFIDENCE))


@dataclasses.dataclass(frozen=True, eq=False)
class ShadowColour:
    """Mean light from 0 to 1 of the shadow and the lit screen, shape (3,), and the robust covariance of the shadow's
    pixels, shape (3, 3)."""

    shadow: Array
    lit: Array
    covariance: Array

    @property
    def direction(self) -> Array:
        """Weights of the channels that give `share`, shape (3,)."""
        way = self.lit - self.shadow
        weights = np.linalg.solve(self.covariance, way)
        return weights / (weights @ way)

    @property
    def contrast(self) -> float:
        """Share of the screen's light that the shadow takes away."""
        return float(1.0 - self.shadow.sum() / self.lit.sum())

    @property
    def depth(self) -> float:
        """The same share of the light in the mixture of the channels that `share` takes."""
        return float(1.0 / (self.direction @ self.lit))

    def distance(self, light: Array) -> Array:
        """Return Mahalanobis distance to the shadow's colour of light (..., 3)."""
        return mahalanobis(light - self.shadow, self.covariance)

    def share(self, light: Array) -> Array:
        """Return 0 for the shadow's colour, 1 for the lit screen's, of light (..., 3)."""
        return (light - self.shadow) @ self.direction


def learn_colour(shadow: Array, lit: Array) -> ShadowColour:
    """Return the colours from samples of the shadow and of the lit screen in light, shapes (n, 3) and (m, 3);
    `Unmeasurable` if the lit screen's colour lies within the shadow's scatter."""
    centre, covariance = robust_covariance(_thinned_samples(shadow))
    # Channels share most of their noise; a direction in which they happen not to scatter would rule the weights.
    covariance = covariance + np.eye(3) * max(LIGHT_FLOOR**2, 0.1 * float(np.trace(covariance)) / 3.0)
    colour = ShadowColour(centre, np.median(_thinned_samples(lit), axis=0), covariance)
    if colour.contrast < SMALLEST_CONTRAST:
        raise pictures.Unmeasurable(
            f"the contrast is too low: the shadow takes away {max(0.0, colour.contrast):.0%} of the screen's light, "
            f"but at least {SMALLEST_CONTRAST:.0%} is needed: darken the room, or move the body closer to the screen"
        )
    if (colour.distance(colour.lit) / 2.0) ** 2 < chi_square_limit():
        raise pictures.Unmeasurable(
            "shadow and lit screen differ by no more than the shadow's own scatter; darken the room, and photograph it "
            "again with more light from the lamp"
        )
    return colour


def mahalanobis(offset: Array, covariance: Array) -> Array:
    """Return the Mahalanobis distance of light (..., 3) from a colour, by its offset from that."""
    return np.sqrt(np.einsum("...i,ij,...j->...", offset, np.linalg.inv(covariance), offset))


def robust_covariance(samples: Array, kept: float = 0.75) -> tuple[Array, Array]:
    """Return the mean and covariance (3,), (3, 3) of the densest share of samples (n, 3), by concentration steps. Grid
    lines and dust in the shadow are a small part of it, so starting from median and MAD suffices; the covariance is scaled
    to be right for normally distributed samples."""
    centre = np.median(samples, axis=0)
    spread = np.maximum(deviations(samples - centre, 0), LIGHT_FLOOR)
    covariance = np.diag(spread**2)
    count = max(4, int(kept * len(samples)))
    for _ in range(10):
        offset = samples - centre
        distance2 = np.einsum("ni,ij,nj->n", offset, np.linalg.inv(covariance), offset)
        inner = samples[np.argpartition(distance2, min(count, len(samples)) - 1)[:count]]
        centre = inner.mean(axis=0)
        covariance = np.cov(inner.T) + np.eye(3) * 1e-10
    # E. g. R. A. Maronna, D. Martin, V. Yohai, Robust Statistics (2006), section 6.7: trace of a truncated normal.
    limit = 2.0 * gammaincinv(1.5, kept)  # of chi-square with three degrees of freedom
    return centre, covariance * kept / chdtr(5, limit)


@dataclasses.dataclass(frozen=True, eq=False)
class CoarseShadow:
    """The shadow in a small version of the photograph: by pixel, shape (h, w), the mask of the one shadow, all that is
    ``dark`` (specks and other shadows too), `ShadowColour.share` without grid lines, and the smooth light of the lit
    screen over its median."""

    colour: ShadowColour
    mask: Mask
    dark: Mask
    share: Array
    even: Array


def find_shadow(
    light: npt.NDArray[np.float32], line_px: float = 0.0, known: Array | None = None, masked: Mask | None = None
) -> CoarseShadow:
    """Find the shadow in the light (h, w, 3) of a photograph at most about a thousand pixels wide; `Unmeasurable` for no
    contrast, no shadow, or several.

    Dark things thinner than ``line_px``, the greatest width of a grid line, are closed over. ``known`` is the light (3,) of a
    sample of the shadow; ``masked`` (h, w) is where something else covers the screen: of dark things that lie mostly there,
    what lies there is no shadow.
    """
    plain = _close_lines(light, line_px)
    brightness = plain.mean(axis=2).astype(np.float64)
    even = np.ones(brightness.shape)
    if known is None:
        lit = np.ones(brightness.shape, dtype=bool)
        for _ in range(3):  # the unevenness is learnt from the lit screen, which is known only after a first division
            stored = np.sqrt(np.clip(brightness / even, 0.0, 1.0))  # the noise of light is alike on this scale
            lit = stored > threshold_otsu(stored)
            even = _smooth_light(brightness, lit)
        dark = ~lit
    else:
        lit = brightness > 0.5 * (float(known.mean()) + np.percentile(brightness, 95))
        even = _smooth_light(brightness, lit)
        dark = ~lit & (np.abs(plain - known).max(axis=2) < 0.25 * np.percentile(brightness, 95))
    inner = cv2.erode(dark.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    if inner.sum() < 30 or lit.sum() < 30:
        raise pictures.Unmeasurable(
            "there is no shadow on the screen, or nothing but shadow; photograph the body in the lamp's light with the "
            "lit screen around it"
        )
    levelled = (plain / even[..., None]).astype(np.float64)
    colour = learn_colour(levelled[inner], levelled[cv2.erode(lit.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0])
    share = colour.share(levelled)
    dark = share < 0.5
    if masked is not None and masked.any():
        _, labels = cv2.connectedComponents(dark.astype(np.uint8))
        mostly = (np.bincount(labels.ravel(), masked.ravel()) > 0.5 * np.bincount(labels.ravel()))[labels]
        # What merges with a larger thing under a mask (a ruler beside the body) may be the body.
        dark &= ~(mostly & masked)
    return CoarseShadow(colour, _only_shadow(dark), dark, share, even)


def _only_shadow(dark: Mask) -> Mask:
    count, labels, stats, _ = cv2.connectedComponentsWithStats(dark.astype(np.uint8))
    areas = stats[1:, cv2.CC_STAT_AREA]
    if count < 2 or areas.max() < 100:
        raise pictures.Unmeasurable("there is no shadow on the screen; photograph the body in the lamp's light")
    order = np.argsort(areas)[::-1]
    if len(order) > 1 and areas[order[1]] > max(0.04 * areas[order[0]], 60):
        raise pictures.Unmeasurable(
            f"there are several shadows: the second one has {areas[order[1]] / areas[order[0]]:.0%} of the first one's area; "
            "take away what throws it, cover it with setup --mask, or select the right one with setup --roi"
        )
    mask = labels == order[0] + 1
    outside = cv2.connectedComponents(np.pad(~mask, 1, constant_values=True).astype(np.uint8), connectivity=4)[1]
    return outside[1:-1, 1:-1] != outside[0, 0]  # a bright reflection inside the shadow is no edge of it


def _close_lines(light: npt.NDArray[np.float32], line_px: float) -> npt.NDArray[np.float32]:
    if line_px <= 0.0:
        return cv2.medianBlur(light, 3)
    size = closing_size(line_px)
    # Light all round, or a line that runs along the picture's rim would stay, and be shadow that touches the frame.
    plain = cv2.medianBlur(light, 3)
    framed = cv2.copyMakeBorder(plain, size, size, size, size, cv2.BORDER_CONSTANT, value=(1.0, 1.0, 1.0))
    return cv2.morphologyEx(framed, cv2.MORPH_CLOSE, np.ones((size, size), np.uint8))[size:-size, size:-size]


def closing_size(line_px: float) -> int:
    """Return the side in px of the square that `find_shadow` closes dark lines with."""
    return 2 * int(np.ceil(0.5 * line_px)) + 3


def _smooth_light(brightness: Array, lit: Mask) -> Array:
    """Return a quadratic surface through the logarithm of the lit screen's light, relative to its median."""
    v, u = (2.0 * np.arange(count) / count - 1.0 for count in lit.shape)
    step = max(1, int(np.sqrt(lit.sum() / MOST_PIXELS)))
    row, column = (step * at for at in np.nonzero(lit[::step, ::step]))
    terms = np.column_stack([np.ones(len(row)), u[column], v[row], u[column] ** 2, u[column] * v[row], v[row] ** 2])
    value = np.log(np.maximum(brightness[row, column], 1e-4))
    near = np.ones(len(row), dtype=bool)
    for _ in range(3):  # dust and what lies beside the screen must not tilt it
        kept = terms * near[:, None]
        coefficients = np.linalg.lstsq(kept.T @ terms, kept.T @ value, rcond=None)[0]
        residual = value - terms @ coefficients
        near = np.abs(residual) < 2.5 * max(deviation(residual), 0.01)
    a, b, c, d, e, f = coefficients
    surface = (a + c * v + f * v**2)[:, None] + (b * u + d * u**2)[None, :] + (e * v)[:, None] * u[None, :]
    return np.exp(np.clip(surface - np.median(surface[lit]), -2.0, 1.0))


def _thinned_samples(samples: Array) -> Array:
    return samples[:: max(1, len(samples) // MOST_PIXELS)]


# ----------------------------------------------------------------------------------------------------------------------
# Thin dark things that touch the shadow: hairs, threads, tubes.
#
# The coarse shadow is closed over the grid's lines, and over everything else that is as thin. Such a thing bends the edge it
# touches, or hides it, so it must not go unnoticed.


DARK_INK = 0.6
"""Share of light through the grid's ink below which a dark place may be ink as well as a thing in the light."""

MIN_OBJECT_LENGTH, MIN_OBJECT_PX = 0.45e-3, 5.0
"""Length in m, and in px of the small version, that a thing must stand out of the shadow to be distinguished from dust."""

SQUARE = np.ones((3, 3), np.uint8)


def touched_by_thread(
    light: npt.NDArray[np.float32], coarse: CoarseShadow, ink: npt.NDArray[np.float64], line_px: float, scale: float
) -> bool:
    """Return whether something thin and dark stands out of the shadow found in the light (h, w, 3) of a small version, of
    which a pixel is ``scale`` m long and a grid line at most ``line_px`` wide; ``ink`` (h, w) is the share of light that
    the grid lets through."""
    plain = cv2.medianBlur(light, 3) / np.maximum(ink, 0.1)[..., None] / coarse.even[..., None]
    dark = (coarse.colour.share(plain.astype(np.float64)) < 0.5) & (ink > DARK_INK)
    # Along the frame the closing shaves the shadow's own wedge off; what stays thick beyond the frame is no thread.
    size = closing_size(line_px)
    padded = np.pad(dark | coarse.mask, size, mode="edge").astype(np.uint8)
    thick = cv2.morphologyEx(padded, cv2.MORPH_OPEN, np.ones((size, size), np.uint8))[size:-size, size:-size]
    body = cv2.dilate(thick | coarse.mask.astype(np.uint8), SQUARE)
    things = dark.astype(np.uint8) & ~body & 1
    far = cv2.distanceTransform(1 - (body & 1), cv2.DIST_L2, 5)
    labels = cv2.connectedComponents(things)[1]
    reach = max(MIN_OBJECT_LENGTH / scale, MIN_OBJECT_PX)
    touching, long = (np.unique(labels[(things > 0) & chosen]) for chosen in (far < 3.0, far > reach))
    return bool(np.intersect1d(touching, long).size)


# ----------------------------------------------------------------------------------------------------------------------
# Light profiles across an edge, at stations along a path near it.
#
# The grid's ink under the profiles across an edge: the light it takes, and how far it draws a blurred edge to itself.


TABLE_CELLS = 64
"""Cells per side of the table of places on the screen; a photograph is straight within each to a hundredth of a pixel."""

INK_REACH = 4.0
"""Blurs, beyond half of its width, from a line's middle up to which it draws an edge."""

Transmission = Callable[[Array], Array]
"""Share of light that the ink lets through at pixels (..., 2)."""

InkModel = Callable[[Array, Array, Array], Array]
"""What ink leaves in profiles: of pixels (n, k, 2), their distances (n, k) from the edge in its widths and these (n,) in px."""


@dataclasses.dataclass(frozen=True, eq=False)
class Ink:
    """The ink at pixels of a region x0, y0, x1, y1 of a photograph, by the places on the screen in m at the nodes of a
    lattice over it, shape (65, 65, 2)."""

    look: GridLook
    roi: tuple[int, int, int, int]
    table: Array

    @classmethod
    def of(cls, look: GridLook, setup: Setup, roi: tuple[int, int, int, int]) -> Ink:
        """Return the ink of a photograph; the map to the screen is taken straight within each cell of a table."""
        x0, y0, x1, y1 = roi
        columns, rows = np.linspace(x0, x1 - 1, TABLE_CELLS + 1), np.linspace(y0, y1 - 1, TABLE_CELLS + 1)
        lattice = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
        places = setup.to_metres(lattice).reshape(TABLE_CELLS + 1, TABLE_CELLS + 1, 2) * setup.magnification
        return cls(look, roi, np.ascontiguousarray(np.nan_to_num(places, nan=1.0), dtype=np.float64))

    def __call__(self, points: Array) -> Array:
        """Share of light (...) that the ink lets through at pixels (..., 2) on straight lines."""
        lines = points.reshape(-1, *points.shape[-2:])
        through = np.ones(lines.shape[:-1])
        # Most profiles have no ink near them, as the places of three of their pixels show.
        first, middle, last = np.moveaxis(self.places(lines[:, [0, lines.shape[1] // 2, -1]]), 1, 0)
        length = np.maximum(np.abs(first - middle), np.abs(last - middle))
        inked = np.zeros(len(lines), dtype=bool)
        for axis in (0, 1):
            inked |= np.abs(self.look.off_line(middle[:, axis], axis)) < self.look.ink_reach + 1.2 * length[:, axis]
        through[inked] = self.look.transmission(self.places(lines[inked]))
        return through.reshape(points.shape[:-1])

    def places(self, points: Array) -> Array:
        """Return the places (..., 2) on the screen in m that pixels (..., 2) show."""
        x0, y0, x1, y1 = self.roi
        cells = ((points - [x0, y0]) / [x1 - 1 - x0, y1 - 1 - y0] * float(TABLE_CELLS)).reshape(-1, 2).T[::-1]
        row, column = np.clip(cells, 0.0, float(TABLE_CELLS))
        top, left = (np.minimum(at.astype(np.intp), TABLE_CELLS - 1) for at in (row, column))
        low_share, right_share = (row - top)[:, None], (column - left)[:, None]
        nodes, first = self.table.reshape(-1, 2), top * (TABLE_CELLS + 1) + left
        upper, lower = (
            (1.0 - right_share) * nodes.take(first + below, axis=0) + right_share * nodes.take(first + below + 1, axis=0)
            for below in (0, TABLE_CELLS + 1)
        )
        return np.asarray(upper + low_share * (lower - upper)).reshape(points.shape)

    def drawn(self, points: Array, z: Array, width: Array) -> Array:
        """Return the rest (n, k), as a share of the edge's rise, that the ink leaves in n profiles across an edge after
        the light was divided by what it lets through; arguments are as of `InkModel`."""
        places, rest = self.places(points), np.zeros(z.shape)
        length = np.linalg.norm(points[:, -1] - points[:, 0], axis=1)
        along = (points[:, -1] - points[:, 0]) / length[:, None]
        # Directions across the edge and along it, in m per pixel.
        ahead = (places[:, -1] - places[:, 0]) / length[:, None]
        middle = points[:, z.shape[1] // 2]
        turned = np.column_stack([-along[:, 1], along[:, 0]])
        beside = 0.5 * (self.places(middle + turned) - self.places(middle - turned))
        for axis, line in enumerate(self.look.lines):
            if line is None:
                continue
            off = self.look.off_line(places[..., axis], axis)
            near = (np.abs(off) < 0.5 * line.width + INK_REACH * line.blur).any(axis=1)
            if not near.any():
                continue
            slope = np.hypot(ahead[near, axis], beside[near, axis])
            correlation = line.blur * ahead[near, axis] / (slope**2 * width[near])
            rest[near] += line.covariance(off[near], z[near], correlation[:, None])
        inked = rest.any(axis=1)
        rest[inked] /= self(points[inked])
        return rest


HALF_PROFILE_SAMPLES = 30
"""Samples of a profile on each side of its middle."""

END_SAMPLES, FLATNESS_TOLERANCE = (5, 15, -15, -5), 0.04
"""Samples between which a profile's ends and what is next to them lie, and the change of light between these, as a share of
all, up to which it is flat."""

LONGEST_STATION = 8.0
"""Length in px along the edge over which a profile is averaged at most."""

INK_TRUST = 0.05
"""Share by which the correction for the grid's ink may be wrong; samples on ink weigh less accordingly."""


@dataclasses.dataclass(frozen=True, eq=False)
class Shading:
    """Visible share of the lamp at each place of a photograph (h, w, 3), corrected for what the grid's ink lets through
    and for what it draws because it is blurred together with the edge; None leaves either out."""

    image: pictures.Pixels
    colour: ShadowColour
    through: Transmission | None = None
    drawn: InkModel | None = None
    light: npt.NDArray[np.float32] = dataclasses.field(default_factory=lambda: pictures.LIGHT_OF_SRGB)

    def level(self, points: Array) -> Array:
        """Return the light (...) at pixels (..., 2), its channels mixed as the shadow's colour asks for; NaN outside of the
        picture."""
        return pictures.sample_light(self.image, points, self.light, self.colour.direction)


# ----------------------------------------------------------------------------------------------------------------------
# The shape that all light profiles across an edge have in common, and where in it half of the lamp is visible.
#
# A lamp's penumbra is symmetric about the place where half of the lamp is visible: the integral over the chords of a disc, a
# ramp or trapezoid of a square, an error function of a frosted bulb, each blurred by the lens. What the camera does to the
# numbers is not: a tone curve other than the assumed one, and sharpening of the stored numbers, draw the half light to one
# side. The mean of hundreds of profiles shows all of it, so one model is fitted to it: a lamp under a Gaussian blur, x + e x
# (1 - x) in place of the light x between shadow and screen, and an unsharp mask of the stored numbers. The lamp's shape moves
# the edge nowhere; e and the mask do, and by how much is known as well as they are.
#
# The lamp's light over the distance t from its middle is (1 - t^2/R^2)^m: m = 1/2 is a uniform disc (the length of its
# chords), m = 0 a square along its side, m = 3/2 stands for a turned square and for softer lamps, m = -1/2 is a thin ring.
#
# The penumbra of a level surface with the half depth r along the light, at the distance b from the screen, is not symmetric.
# Light from the lamp's upper half passes the rim near the screen, that from its lower half the rim near the lamp: the penumbra
# is 1 + q times as wide above the surface's plane and 1 - q times below, with q = r / b. The lens' blur then draws the half
# light up from the plane, and a photograph of the raised body, whose profiles get a symmetric step, has the surface higher
# still. Neither r nor b is known here, but q shows in the profile once another photograph has told what the camera does: the
# edge of the raised body, a dome, is tangent to the light in one place and has a symmetric penumbra.


SHAPE_STEP, MAX_SHAPE_DISTANCE = 0.05, 9.0
"""Distance of the nodes of a tabulated shape, and the distance of the outermost from the edge, in its widths."""

BULB_EXPONENT, RING_EXPONENT = 6.0, -0.5
"""Exponents m of a frosted bulb, whose outer light is not like blur in a deep penumbra, and of a ring, which is rare."""
LAMP_EXPONENTS = (0.5, 0.0, 1.5, RING_EXPONENT)
"""Those of the lamps that are tried."""

PROFILE_BINS, PROFILE_REACH, MIN_SAMPLES_PER_BIN, CORRELATED_SAMPLES = 40, 4.0, 20, 4.0
"""Bins of the mean profile, the widths to which they reach on either side, the least number of samples in one, and how many
samples err together."""

SHAPE_PARAMETERS = 6
"""Parameters of the shape that have no prior of their own, or one that is wider than what the profile shows."""

ERROR_FLOOR, INKED_ERROR_FLOOR = 6e-4, 3e-3
"""Errors of the mean profile, as a share of the edge's rise, that no number of samples takes away: by the picture's compression
(JPEG files bend profiles that much), and by the ink that is divided out, where every profile has some."""

TONE_DEVIATION, SHARPENING_DEVIATION, MASK_RADIUS_PX, MASK_RADIUS_DEVIATION = 0.03, 0.5, 1.3, 0.6
"""Usual sizes of e and of the mask's amount, and its radius in px with the usual deviation from that.

An S curve that adds a fifth of the smooth step 3 v^2 - 2 v^3 to sRGB's has e = 0.04.
"""

UNKNOWN_SHAPE_ERROR = 0.03
"""Error of the half light's place in widths where the profiles do not show the edge's shape."""

MIN_PLACE_ERROR = 0.004
"""Error of the half light's place in widths beyond a photograph's noise: edges of one camera differ by that much."""

DECISIVE_CHI_SQUARE = 12.0
"""Difference of chi-squares from which a profile shows which of two models is right; a chance of 1 in 400 that it errs."""

CAMERA_DEVIATIONS = (0.015, 0.1, 0.2)
"""Standard errors by which e, the mask's amount and its radius in px differ between two photographs of one camera."""

DEPTH_CORRECTION_ERROR, LAMP_MISFIT_FACTOR = 0.3, 2.0
"""Error of the correction for a surface that is deep along the light, as a share of it: q is one for all of the edge here; and
the factor by which the misfits of lamps differ more than what is known of them: neighbouring bins err together."""

CAMERA_MODEL_ERROR, CAMERA_TONE_ERROR = 0.012, 0.4
"""Error of the half light's place in widths that remains because the model is not the camera's, and its growth with e."""

LARGEST_MISFIT = 3.5
"""Misfit of an edge's shape from which no tone is known to be right, and the light does not fall as behind one lamp."""


@dataclasses.dataclass(frozen=True, eq=False)
class EdgeShape:
    """A symmetric or distorted step from 0 to 1 over the distance in widths from the place where half of the lamp is visible.

    Attributes:
        values: The step at the nodes of `nodes`.
        shift_error: Standard error of the half light's place in it, in widths, by the noise of this photograph.
        model_error: The same by the model, which all photographs with one lamp and camera have in common.
        tone: e, by which the light differs from what the assumed tone curve gives.
        misfit: Root mean square of the mean profile's distance from it in its standard error, with the priors'.
        mask: Amount and radius in px of the unsharp mask.
        lift: Distance in widths above a level surface that is deep along the light at which the raised body's shape finds it;
            0 where nothing shows that depth.
        hidden: Standard error in widths by a depth that the profile would not show; 0 where the camera is not known.
        profile: What it was fitted to; None for an error function.
    """

    values: Array
    shift_error: float = 0.0
    model_error: float = 0.0
    tone: float = 0.0
    misfit: float = np.nan
    mask: tuple[float, float] = (0.0, MASK_RADIUS_PX)
    lift: float = 0.0
    hidden: float = 0.0
    profile: MeanProfile | None = None

    @property
    def chi_square(self) -> float:
        """Sum of the squares of which ``misfit`` is the mean; infinite where no shape was fitted."""
        return float("inf") if np.isnan(self.misfit) else (PROFILE_BINS - SHAPE_PARAMETERS) * self.misfit**2

    def chi_square_by(self, light: npt.NDArray[np.float32]) -> float:
        """Return about what `chi_square` would be if the stored numbers stood for this light (256,) instead; infinite where no
        shape was fitted."""
        if self.profile is None:
            return float("inf")
        profile = self.profile.stored_as(light)
        best = min(fit.cost for _, fit in profile.fits(LAMP_EXPONENTS))
        return float((PROFILE_BINS - SHAPE_PARAMETERS) * 2.0 * best / (len(profile.place) - SHAPE_PARAMETERS))

    def with_slope(self, z: Array) -> tuple[Array, Array]:
        """Return the step at distances z (...) in widths, and its derivative there."""
        at = np.clip((z + MAX_SHAPE_DISTANCE) / SHAPE_STEP, 0.0, len(self.values) - 1.0)
        left = np.minimum(at.astype(np.intp), len(self.values) - 2)
        share = at - left
        values, slopes = (own.take(left) + share * rise.take(left) for own, rise in self._table)
        return values, slopes

    @functools.cached_property
    def _table(self) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """Values and slopes at the nodes, each with its rise to the next node."""
        slopes = np.gradient(self.values, SHAPE_STEP)
        return (self.values, np.diff(self.values)), (slopes, np.diff(slopes))


@functools.cache
def nodes() -> Array:
    """Return the distances from the edge in widths at which shapes are tabulated."""
    return np.arange(-MAX_SHAPE_DISTANCE, MAX_SHAPE_DISTANCE + 0.5 * SHAPE_STEP, SHAPE_STEP)


def gaussian(shift_error: float = 0.0) -> EdgeShape:
    """Return an error function."""
    return EdgeShape(ndtr(nodes()), shift_error, CAMERA_MODEL_ERROR)


@dataclasses.dataclass(frozen=True, eq=False)
class StoredLight:
    """Light (256,) of every stored number by the assumed tone curve, and at an edge that of the shadow, of the lit screen,
    and the edge's width in px."""

    light: Array
    low: float
    high: float
    width: float

    def seen(self, share: Array, amount: float, radius: float) -> Array:
        """Return the light (n,) over light and shadow that a share (n,) of the lamp at `nodes` is taken for after
        sharpening."""
        numbers = _numbers(len(self.light))
        stored = np.interp(self.low + (self.high - self.low) * share, self.light, numbers)
        sharp = stored + amount * (stored - _blurred_values(stored, radius / self.width))
        # Beyond the last number the curve goes on, as a channel mixed of several does.
        back = np.interp(sharp, numbers, self.light)
        back += np.maximum(sharp - 1.0, 0.0) * (self.light[-1] - self.light[-2]) * (len(numbers) - 1.0)
        return np.asarray((back - self.low) / (self.high - self.low))


@functools.cache
def _numbers(count: int) -> Array:
    """Return the stored numbers (count,) over the largest."""
    return np.linspace(0.0, 1.0, count)


LEAST_STEEPNESS = 0.1
"""Least growth of one tone's light with another's, over light and shadow, by which an error grows."""


@dataclasses.dataclass(frozen=True, eq=False)
class MeanProfile:
    """What the profiles across an edge have in common: light over light and shadow, ``value``, at places in widths, and its
    standard error by their scatter and by the least that it may have, ``spread``, shape (m,); and how it was stored."""

    place: Array
    value: Array
    spread: Array
    stored: StoredLight

    def stored_as(self, light: npt.NDArray[np.float32]) -> MeanProfile:
        """Return the profile if the numbers stood for this light (256,)."""
        other = light.astype(np.float64)
        # Of all channels the mean goes from one curve to the other, which is right but for their differences.
        old = self.stored
        low, high = (float(np.interp(own, old.light, other)) for own in (old.low, old.high))
        value = (np.interp(old.low + (old.high - old.low) * self.value, old.light, other) - low) / (high - low)
        spread = self.spread * np.maximum(np.gradient(value, self.value), LEAST_STEEPNESS)
        return MeanProfile(self.place, value, spread, StoredLight(other, low, high, old.width))

    def fits(
        self, lamps: Sequence[float], camera: EdgeShape | None = None, deep: bool = False
    ) -> list[tuple[float, OptimizeResult]]:
        """Return each lamp's exponent with its best fit, of a surface that is deep along the light where asked for; the first
        lamp's are where those of the others begin."""
        starts, fits = None, []
        for lamp in lamps:
            tried = _fitted_profile(self, lamp, camera, starts, deep)
            # A share of 0 or 1 tells nothing of a lamp of another shape.
            starts = starts or [np.r_[fit.x[:2], np.clip(fit.x[2], 0.1, 0.9), fit.x[3:]] for fit in tried]
            fits.append((lamp, min(tried, key=lambda fit: float(fit.cost))))
        return fits


def common_shape(z: Array, residual: Array, clean: Mask, stored: StoredLight, camera: EdgeShape | None = None) -> EdgeShape:
    """Return the shape that n profiles have in common, from what error functions leave of them over their rise:
    ``residual`` at the distances ``z`` from their middles in widths, where it is clean of ink, shapes (n, k). ``camera``
    is as of `edge.refine_edge`."""
    sides = (np.abs(z + 1.5) < 1.0, np.abs(z - 1.5) < 1.0)
    # An edge that runs along a grid line, or just beside it, has hardly a sample off the ink on one side.
    on_ink = any(clean[side].mean() < 0.5 for side in sides if side.any())
    place, value, error = _mean_profile(z, residual, np.ones_like(clean) if on_ink else clean)
    if len(place) < PROFILE_BINS // 2:
        return gaussian(UNKNOWN_SHAPE_ERROR)
    # An edge far out of focus has a grid line in nearly all of its profiles, which leaves more there than e does.
    inked = 1.0 - float(clean.all(axis=1).mean())
    profile = MeanProfile(place, value, np.hypot(error, np.hypot(ERROR_FLOOR, INKED_ERROR_FLOOR * inked)), stored)
    lamp, best = min(profile.fits(LAMP_EXPONENTS), key=lambda pair: float(pair[1].cost))
    lift, moved, unsure, hidden, freedom = 0.0, 0.0, 0.0, 0.0, len(place) - SHAPE_PARAMETERS
    if camera is not None:
        lamps = (*LAMP_EXPONENTS, BULB_EXPONENT)
        fits = profile.fits(lamps, camera, deep=True)
        (bent, deep), moved, unsure = _likely_lamp(fits, freedom)
        lift = _centre_by(camera, _shape(deep.x, bent, stored), float(np.median(z[:, -1])))
        if 2.0 * (best.cost - deep.cost) >= DECISIVE_CHI_SQUARE * max(1.0, 2.0 * deep.cost / freedom):
            lamp, best, lift = bent, deep, max(0.0, lift - moved)
        else:
            lift, moved, unsure, hidden = 0.0, 0.0, 0.0, float(np.hypot(lift, _place_error(deep.jac)))
            flat, known = min(profile.fits(lamps, camera), key=lambda pair: float(pair[1].cost))
            # A wrong idea of the camera moves both photographs' edges alike, and no height.
            if 2.0 * (known.cost - best.cost) < DECISIVE_CHI_SQUARE * max(1.0, 2.0 * best.cost / freedom):
                lamp, best = flat, known
    misfit = float(np.sqrt(2.0 * best.cost / freedom))
    # Neighbouring bins err together to an unknown extent; how far the profile lies off the shape shows how far each errs.
    share = float(np.sqrt(np.sum(best.fun[: len(place)] ** 2) / freedom))
    own = _place_error(np.vstack([best.jac[: len(place)] / share, best.jac[len(place) :]]))
    # An asymmetry that is no camera's may be the penumbra's own, as of a level surface that no other photograph explains.
    departure = abs(float(best.x[3]))
    strange = 0.6 * max(0.0, departure - 3.0 * TONE_DEVIATION)
    model = float(np.hypot(CAMERA_MODEL_ERROR, CAMERA_TONE_ERROR * departure))
    return EdgeShape(
        np.interp(nodes() + moved, nodes(), _shape(best.x, lamp, stored)),
        float(np.linalg.norm([own, MIN_PLACE_ERROR, strange, unsure, DEPTH_CORRECTION_ERROR * lift])),
        model,
        float(best.x[3]),
        misfit,
        (float(best.x[4]), float(best.x[5])),
        lift,
        hidden,
        profile,
    )


def _likely_lamp(fits: list[tuple[float, OptimizeResult]], freedom: int) -> tuple[tuple[float, OptimizeResult], float, float]:
    """Return the best fit of a deep surface with its lamp, a ring only where that is decisive; and how far in widths the mean
    of all lamps, weighed by their fits, has the surface from there, with their scatter: the depth seems the larger, and the
    surface the lower, the more of the lamp's light comes from its rim."""
    best = min(fits, key=lambda pair: float(pair[1].cost))
    usual = [pair for pair in fits if pair[0] != RING_EXPONENT]
    other = min(usual, key=lambda pair: float(pair[1].cost))
    excess = max(1.0, 2.0 * best[1].cost / freedom)
    if 2.0 * (other[1].cost - best[1].cost) < DECISIVE_CHI_SQUARE * excess:
        fits, best = usual, other
    places, costs = np.array([(fit.x[0], fit.cost) for _, fit in fits]).T
    weights = np.exp((best[1].cost - costs) / (LAMP_MISFIT_FACTOR * excess))
    mean = float(np.average(places, weights=weights))
    return best, mean - float(best[1].x[0]), float(np.sqrt(np.average((places - mean) ** 2, weights=weights)))


def _centre_by(shape: EdgeShape, values: Array, reach: float) -> float:
    """Return in widths where the fit of a shape finds the middle of another step, given at `nodes`, in profiles of a reach."""
    near = np.abs(nodes()) < reach
    return float(fit_profiles(nodes()[near], values[None, near], np.ones((1, int(near.sum()))), shape).centre[0])


def _place_error(terms: Array) -> float:
    """Return the standard error of the first parameter of a fit from the derivatives of its residuals."""
    return float(np.sqrt(np.linalg.pinv(terms.T @ terms)[0, 0]))


def _mean_profile(z: Array, residual: Array, clean: Mask) -> tuple[Array, Array, Array]:
    """Return the places (m,) in widths, the median profile there and its standard error."""
    bins = np.floor((z + PROFILE_REACH) / (2.0 * PROFILE_REACH) * PROFILE_BINS).astype(np.int64)
    mean_bins = []
    for number in range(PROFILE_BINS):
        chosen = clean & (bins == number)
        if chosen.sum() < MIN_SAMPLES_PER_BIN:
            chosen = bins == number
        if chosen.sum() < MIN_SAMPLES_PER_BIN:
            continue
        own = residual[chosen]
        middle, at = float(np.median(own)), float(z[chosen].mean())
        # The median of n normal values errs by 1.25 sigma / sqrt(n).
        mean_bins.append((at, ndtr(at) + middle, 1.25 * deviation(own - middle) / np.sqrt(len(own) / CORRELATED_SAMPLES)))
    return tuple(np.array(mean_bins).reshape(-1, 3).T)  # type: ignore[return-value]


DEPTH_PARAMETER = 9
"""Number of the parameter q of `_fitted_profile`."""
DIFFERENCE_STEP, MIN_DIFFERENCE_STEP = 1e-4, 1.5e-8
"""Step of its derivatives by differences over the parameter, and the step from 0."""


def _fitted_profile(
    profile: MeanProfile, lamp: float, camera: EdgeShape | None, starts: list[Array] | None, deep: bool
) -> list[OptimizeResult]:
    """Return a fit from each start, or from the usual ones.

    Parameters: place of the half light, logarithm of the width, the lamp's share of the variance, e, the mask's amount and
    radius, and what the profiles' own levels and fall of light have taken; of a deep surface also q.
    """
    place, value, spread, stored = profile.place, profile.value, profile.spread, profile.stored
    usual, errors = (0.0, 0.0, MASK_RADIUS_PX), (TONE_DEVIATION, SHARPENING_DEVIATION, MASK_RADIUS_DEVIATION)
    if camera is not None:
        usual, errors = (camera.tone, *camera.mask), CAMERA_DEVIATIONS

    level_errors = (0.05, 0.05, 0.02)

    def missed(p: Array) -> Array:
        model = p[6] + (1.0 + p[7] + p[8] * place) * np.interp(place - p[0], nodes(), _shape(p, lamp, stored))
        return np.concatenate([(model - value) / spread, (p[3:6] - usual) / errors, p[6:9] / level_errors])

    def slopes(p: Array) -> Array:
        penumbra, terms = _penumbra(p, lamp), np.zeros((len(place) + 6, len(p)))
        shape, of_model = _seen(penumbra, p, stored), terms[: len(place)]
        step, rise = np.interp(place - p[0], nodes(), shape), 1.0 + p[7] + p[8] * place
        for number in (*range(6), *range(DEPTH_PARAMETER, len(p))):
            moved = p.copy()
            moved[number] += DIFFERENCE_STEP * p[number] or MIN_DIFFERENCE_STEP
            if not low[number] < moved[number] < high[number]:
                moved[number] = 2.0 * p[number] - moved[number]
            if number:
                own = penumbra if number in (3, 4, 5) else _penumbra(moved, lamp)
                changed = np.interp(place - p[0], nodes(), _seen(own, moved, stored))
            else:
                changed = np.interp(place - moved[0], nodes(), shape)
            of_model[:, number] = rise * (changed - step) / (moved[number] - p[number])
        of_model[:, 6], of_model[:, 7], of_model[:, 8] = 1.0, step, step * place
        of_model /= spread[:, None]
        terms[len(place) :, 3:9] = np.diag(1.0 / np.array([*errors, *level_errors]))
        return terms

    start = np.array([0.0, 0.0, 0.5, 0.0, 0.05, MASK_RADIUS_PX, 0.0, 0.0, 0.0])
    low = [-1.0, -1.0, 0.0, -1.0, 0.0, 0.4, -1.0, -1.0, -1.0]
    high = [1.0, 1.0, 0.98, 1.0, 3.0, 4.0, 1.0, 1.0, 1.0]
    scale = [0.01, 0.1, 0.3, 0.1, 0.3, 0.5, 0.01, 0.01, 0.01]
    begin = [start]
    if camera is not None:
        start[3:6] = np.clip(usual, [-0.99, 0.01, 0.41], [0.99, 2.99, 3.99])
    if deep:
        low, high, scale = [*low, 0.0], [*high, 0.99], [*scale, 0.2]
        begin = [np.r_[start, q] for q in (0.1, 0.7)]
    return [
        least_squares(missed, start, slopes, bounds=(low, high), x_scale=scale, ftol=1e-4, max_nfev=40)
        for start in starts or begin
    ]


def _shape(p: Array, lamp: float, stored: StoredLight) -> Array:
    """Return the step at `nodes` for parameters of `_fitted_profile`, half of the lamp visible at 0."""
    return _seen(_penumbra(p, lamp), p, stored)


def _seen(penumbra: Array, p: Array, stored: StoredLight) -> Array:
    """Return the same from the penumbra as the camera receives it."""
    return stored.seen(penumbra + p[3] * penumbra * (1.0 - penumbra), float(p[4]), float(p[5]))


def _penumbra(p: Array, lamp: float) -> Array:
    """Return the blurred penumbra at `nodes` as the camera receives it."""
    width, share = float(np.exp(p[1])), float(p[2])
    wider = np.where(nodes() > 0.0, 1.0 + p[DEPTH_PARAMETER], 1.0 - p[DEPTH_PARAMETER]) if len(p) > DEPTH_PARAMETER else 1.0
    bare = np.interp(nodes() / (width * np.sqrt(share) * wider + 1e-3), *_lamp(lamp))
    return _blurred_values(bare, width * np.sqrt(1.0 - share))


@functools.cache
def _lamp(exponent: float) -> tuple[Array, Array]:
    """Return the nodes and the share of a lamp of unit variance that lies beyond them."""
    at = np.linspace(-1.0, 1.0, 801)
    return at * np.sqrt(2.0 * exponent + 3.0), betainc(exponent + 1.0, exponent + 1.0, 0.5 * (1.0 + at))


def _blurred_values(values: Array, width: float) -> Array:
    """Return the values at `nodes` under a Gaussian blur of a standard deviation in widths."""
    if width < 0.2 * SHAPE_STEP:
        return values
    reach = min(int(np.ceil(4.5 * width / SHAPE_STEP)), len(values) - 1)
    # Each tap holds the bell's integral over its step, so that narrow bells keep their weight.
    bell = np.diff(ndtr((np.arange(-reach, reach + 2) - 0.5) * SHAPE_STEP / width))
    return np.asarray(correlate1d(values, bell / bell.sum(), mode="nearest"))


# ----------------------------------------------------------------------------------------------------------------------
# Steps of one shape through light profiles, by weighted least squares on all profiles at once.


MAX_STEPS, SETTLED = (5, 4, 5), 1e-5
"""Gauss-Newton steps with equal weights and after each of two times that samples far off their curve are given less weight,
and the step in px, or relative to light, below which a profile's end."""

LEAST_WIDTH = 0.15
"""Least width of an edge in px."""


@dataclasses.dataclass(frozen=True, eq=False)
class ProfileFit:
    """Curves low + (rise + slope u) S((u - centre) / width) over the offset u in px, one for each of n profiles of k samples.

    Attributes:
        low, rise, slope, centre, width: The parameters, shape (n,).
        z: Distance of the samples from the middle in widths, shape (n, k).
        top: Rise at each sample, shape (n, k).
        residual: What the curves leave of the profiles, shape (n, k).
        weight: Weights of the samples, shape (n, k).
        terms: Derivatives of the curves by the five parameters (the width's logarithm), times the weights, shape (n, 5, k).
        matrix: Normal matrices, shape (n, 5, 5).
    """

    low: Array
    rise: Array
    slope: Array
    centre: Array
    width: Array
    z: Array
    top: Array
    residual: Array
    weight: Array
    terms: Array
    matrix: Array

    @property
    def variance(self) -> Array:
        """Variance of each profile's samples about its curve, shape (n,)."""
        freedom = np.maximum(self.weight.sum(axis=1) - 5.0, 1.0)
        return (self.weight * self.residual**2).sum(axis=1) / freedom

    def at(self, chosen: Mask) -> ProfileFit:
        """Return the chosen (n,) of the fits."""
        return ProfileFit(*(getattr(self, field.name)[chosen] for field in dataclasses.fields(self)))

    def replaced(self, chosen: Mask, other: ProfileFit) -> ProfileFit:
        """Return the fits with others in place of the chosen (n,)."""
        values = {field.name: getattr(self, field.name).copy() for field in dataclasses.fields(self)}
        for name, value in values.items():
            value[chosen] = getattr(other, name)
        return ProfileFit(**values)

    def centre_error(self, variance: Array) -> Array:
        """Return the standard errors (n,) of the middles in px for samples of these variances (n,)."""
        return np.sqrt(np.maximum(np.linalg.inv(self.matrix)[:, 3, 3], 0.0) * variance)

    def centre_shift(self, added: Array) -> Array:
        """Return how far in px light (n, k) that is added to the profiles moves their middles, to first order, shape (n,)."""
        pull = np.einsum("nik,nk->ni", self.terms, added)
        return np.linalg.solve(self.matrix, pull[..., None])[:, 3, 0]


def fit_profiles(
    offsets: Array, profile: Array, weight: Array, shape: EdgeShape | None = None, before: ProfileFit | None = None
) -> ProfileFit:
    """Fit a step, an error function unless given, to each profile (n, k) with weights at offsets (k,) in px, rising and
    symmetric about 0, by Gauss-Newton steps; from a fit ``before`` to profiles that hardly differ."""
    shape = gaussian() if shape is None else shape
    reach, every = offsets[-1], np.arange(len(profile))
    parameters = np.array(_first_guess(offsets, profile))
    if before is not None:
        inner = (np.abs(before.centre) < reach) & (before.width > LEAST_WIDTH) & (before.width < reach)
        parameters[:, inner] = [getattr(before, name)[inner] for name in ("low", "rise", "slope", "centre", "width")]
    used = weight
    for turn, steps in enumerate(MAX_STEPS):
        moving = every
        if turn:
            left = np.abs(profile - _curves(offsets, parameters, shape)[0])
            scatter = np.maximum(deviations(left, 1), 1e-4)
            used = weight * np.minimum(1.0, 2.5 * scatter[:, None] / np.maximum(left, 1e-12))
        for _ in range(steps):
            fit = _fit_at(offsets, profile[moving], used[moving], parameters[:, moving], shape)
            step = np.linalg.solve(fit.matrix, fit.terms @ fit.residual[..., None])[..., 0]
            step = np.where(np.isfinite(step), step, 0.0)
            parameters[:, moving] = _stepped_parameters(parameters[:, moving], step, reach)
            moving = moving[np.abs(step).max(axis=1) >= SETTLED]
            if not len(moving):
                break
    return _fit_at(offsets, profile, used, parameters, shape)


def _curves(offsets: Array, parameters: Array, shape: EdgeShape) -> tuple[Array, ...]:
    """Return the curves of these parameters (5, n), the steps in them and their derivatives, the places in widths, and the
    rises there, shape (n, k) each."""
    low, rise, slope, centre, width = parameters[..., None]
    z = (offsets - centre) / width
    phi, bell = shape.with_slope(z)
    top = rise + slope * offsets
    return low + top * phi, phi, bell, z, top


def _fit_at(offsets: Array, profile: Array, weight: Array, parameters: Array, shape: EdgeShape) -> ProfileFit:
    """Return the curves of these parameters (5, n) as a fit to the profiles (n, k)."""
    low, rise, slope, centre, width = parameters
    value, phi, bell, z, top = _curves(offsets, parameters, shape)
    fall = top * bell
    terms = np.stack([np.ones_like(phi), phi, offsets * phi, fall / -width[:, None], -fall * z], axis=1)
    weighted = terms * weight[:, None]
    matrix = weighted @ terms.transpose(0, 2, 1)
    matrix += 1e-9 * np.trace(matrix, axis1=1, axis2=2)[:, None, None] * np.eye(5)
    return ProfileFit(low, rise, slope, centre, width, z, top, profile - value, weight, weighted, matrix)


def _first_guess(offsets: Array, profile: Array) -> tuple[Array, ...]:
    """Low, rise, slope, centre and width (n,) each: the levels at both ends, and the step between them of the same area."""
    side, reach = len(offsets) // 5, offsets[-1]
    low, high = profile[:, :side].mean(axis=1), profile[:, -side:].mean(axis=1)
    above = (profile > 0.5 * (low + high)[:, None]).astype(float)
    centre = reach - above.sum(axis=1) * (offsets[1] - offsets[0])
    return low, high - low, np.zeros(len(profile)), centre, np.full(len(profile), 0.25 * reach)


def _stepped_parameters(parameters: Array, step: Array, reach: float) -> tuple[Array, ...]:
    """Return the parameters (5, n) after a step (n, 5), which is cut where it would leave the profile."""
    low, rise, slope, centre, width = parameters
    return (
        low + step[:, 0],
        rise + step[:, 1],
        slope + step[:, 2],
        np.clip(centre + np.clip(step[:, 3], -0.3 * reach, 0.3 * reach), -reach, reach),
        np.clip(width * np.exp(np.clip(step[:, 4], -0.5, 0.5)), LEAST_WIDTH, reach),
    )
