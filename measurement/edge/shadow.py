"""Which pixels are shadow: the Mahalanobis distance to the shadow's colour.

The thesis marked a piece of shadow manually and took as shadow what lay within a Mahalanobis distance of 90 in the units of
its own code: a number that changes with camera and light. The square of the distance of shadow pixels follows chi-square
with as many degrees of freedom as there are channels, so `chi_square_limit` needs no tuning to say "this is the shadow's
colour". It is no place for an edge, though: in a penumbra the colour leaves the shadow's scatter long before half of the
lamp is out, and ever earlier the less noise there is. So the edge is taken on `ShadowColour.share`, the same distance with
a sign, measured along the way to the lit screen and divided by the distance of the lit screen: 0 in the shadow, 1 on the
lit screen, and 1/2 where half of the light arrives. It is linear in the light, so blur moves a straight edge nowhere, and
of all mixtures of the channels it is the one with the least noise (Fisher's discriminant).

Sources: P. J. Rousseeuw, K. Van Driessen, Technometrics 41 (1999) 212, doi 10.1080/00401706.1999.10485670 (the robust
covariance); N. Otsu, IEEE Trans. Syst. Man Cybern. 9 (1979) 62, doi 10.1109/TSMC.1979.4310076.
"""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import numpy.typing as npt
from scipy.stats import chi2
from skimage.filters import threshold_otsu

from measurement.camera.pictures import Unmeasurable
from measurement.robust import deviation, deviations
from softmodels.common.arrays import Array

Mask = npt.NDArray[np.bool_]

CONFIDENCE = 0.999
"""Share of the shadow's own pixels within `chi_square_limit`."""

MOST_PIXELS = 4000
"""Pixels that a colour is learnt from; more do not change it."""

FLOOR = 1e-3
"""Least standard deviation of a channel's light: a stored number is an integer, so nothing is known more finely."""

SMALLEST_CONTRAST = 0.3
"""Least share of the screen's light that the shadow must take away."""


def chi_square_limit() -> float:
    """Return the square of the Mahalanobis distance that `CONFIDENCE` of the shadow's pixels stay below, in three channels."""
    return float(chi2.ppf(CONFIDENCE, 3))


@dataclasses.dataclass(frozen=True, eq=False)
class ShadowColour:
    """Colours of the shadow and of the lit screen in light from 0 to 1.

    Attributes:
        shadow: Mean light of the shadow, shape (3,).
        lit: Mean light of the lit screen, shape (3,).
        covariance: Robust covariance of the shadow's pixels, shape (3, 3).
    """

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

    def distance(self, light: Array) -> Array:
        """Return Mahalanobis distance to the shadow's colour of light (..., 3)."""
        offset = light - self.shadow
        return np.sqrt(np.einsum("...i,ij,...j->...", offset, np.linalg.inv(self.covariance), offset))

    def share(self, light: Array) -> Array:
        """Return 0 for the shadow's colour, 1 for the lit screen's, of light (..., 3)."""
        return (light - self.shadow) @ self.direction


def learn_colour(shadow: Array, lit: Array) -> ShadowColour:
    """Return the colours from samples of the shadow and of the lit screen in light, shapes (n, 3) and (m, 3).

    Raises:
        Unmeasurable: The lit screen's colour lies within the shadow's scatter.
    """
    centre, covariance = robust_covariance(_thinned(shadow))
    # Channels share most of their noise; a direction in which they happen not to scatter would rule the weights.
    covariance = covariance + np.eye(3) * max(FLOOR**2, 0.1 * float(np.trace(covariance)) / 3.0)
    colour = ShadowColour(centre, np.median(_thinned(lit), axis=0), covariance)
    if colour.contrast < SMALLEST_CONTRAST:
        raise Unmeasurable(
            f"the contrast is too low: the shadow takes away {max(0.0, colour.contrast):.0%} of the screen's light, "
            f"but at least {SMALLEST_CONTRAST:.0%} is needed: darken the room, or move the body closer to the screen"
        )
    if (colour.distance(colour.lit) / 2.0) ** 2 < chi_square_limit():
        raise Unmeasurable(
            "shadow and lit screen differ by no more than the shadow's own scatter; darken the room, and photograph it "
            "again with more light from the lamp"
        )
    return colour


def robust_covariance(samples: Array, kept: float = 0.75) -> tuple[Array, Array]:
    """Return the mean and covariance (3,), (3, 3) of the densest share of samples (n, 3), by concentration steps.

    Grid lines and dust in the shadow are a small part of it, so starting from median and MAD suffices; the covariance is
    scaled to be right for normally distributed samples.
    """
    centre = np.median(samples, axis=0)
    spread = np.maximum(deviations(samples - centre, 0), FLOOR)
    covariance = np.diag(spread**2)
    count = max(4, int(kept * len(samples)))
    for _ in range(10):
        offset = samples - centre
        distance2 = np.einsum("ni,ij,nj->n", offset, np.linalg.inv(covariance), offset)
        inner = samples[np.argpartition(distance2, min(count, len(samples)) - 1)[:count]]
        centre = inner.mean(axis=0)
        covariance = np.cov(inner.T) + np.eye(3) * 1e-10
    # E. g. R. A. Maronna, D. Martin, V. Yohai, Robust Statistics (2006), section 6.7: trace of a truncated normal.
    limit = chi2.ppf(kept, 3)
    return centre, covariance * kept / chi2.cdf(limit, 5)


@dataclasses.dataclass(frozen=True, eq=False)
class CoarseShadow:
    """The shadow in a small version of the photograph.

    Attributes:
        colour: Colours of shadow and screen.
        mask: Pixels of the one shadow, shape (h, w).
        dark: All shadow-coloured pixels, specks and other shadows too, shape (h, w).
        share: `ShadowColour.share` without grid lines, shape (h, w).
        even: Light of the lit screen relative to its median, smooth, shape (h, w).
    """

    colour: ShadowColour
    mask: Mask
    dark: Mask
    share: Array
    even: Array


def find_shadow(light: npt.NDArray[np.float32], line_px: float = 0.0, known: Array | None = None) -> CoarseShadow:
    """Find the shadow in a small photograph.

    Args:
        light: Light of the photograph, shape (h, w, 3), at most about a thousand pixels wide.
        line_px: Greatest width of a grid line in these pixels; thinner dark things are closed over.
        known: Light of a sample of the shadow, shape (3,); None to find the shadow's colour.

    Raises:
        Unmeasurable: No contrast, no shadow, or several.
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
        raise Unmeasurable(
            "there is no shadow on the screen, or nothing but shadow; photograph the body in the lamp's light with the "
            "lit screen around it"
        )
    levelled = (plain / even[..., None]).astype(np.float64)
    colour = learn_colour(levelled[inner], levelled[cv2.erode(lit.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0])
    share = colour.share(levelled)
    dark = share < 0.5
    return CoarseShadow(colour, _only_shadow(dark), dark, share, even)


def _only_shadow(dark: Mask) -> Mask:
    count, labels, stats, _ = cv2.connectedComponentsWithStats(dark.astype(np.uint8))
    areas = stats[1:, cv2.CC_STAT_AREA]
    if count < 2 or areas.max() < 100:
        raise Unmeasurable("there is no shadow on the screen; photograph the body in the lamp's light")
    order = np.argsort(areas)[::-1]
    if len(order) > 1 and areas[order[1]] > max(0.04 * areas[order[0]], 60):
        raise Unmeasurable(
            f"there are several shadows: the second one has {areas[order[1]] / areas[order[0]]:.0%} of the first one's area; "
            "select the right one with setup --roi"
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
    rows, columns = np.mgrid[0 : lit.shape[0], 0 : lit.shape[1]]
    u, v = 2.0 * columns / lit.shape[1] - 1.0, 2.0 * rows / lit.shape[0] - 1.0
    terms = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=-1)
    step = max(1, int(np.sqrt(lit.sum() / MOST_PIXELS)))
    chosen = np.zeros_like(lit)
    chosen[::step, ::step] = lit[::step, ::step]
    value = np.log(np.maximum(brightness[chosen], 1e-4))
    coefficients = np.linalg.lstsq(terms[chosen], value, rcond=None)[0]
    for _ in range(2):  # dust and what lies beside the screen must not tilt it
        residual = value - terms[chosen] @ coefficients
        near = np.abs(residual) < 2.5 * max(deviation(residual), 0.01)
        coefficients = np.linalg.lstsq(terms[chosen][near], value[near], rcond=None)[0]
    surface = terms @ coefficients
    return np.exp(np.clip(surface - np.median(surface[lit]), -2.0, 1.0))


def _thinned(samples: Array) -> Array:
    return samples[:: max(1, len(samples) // MOST_PIXELS)]


# ----------------------------------------------------------------------------------------------------------------------
# Thin dark things that touch the shadow: hairs, threads, tubes.
#
# The coarse shadow is closed over the grid's lines, and over everything else that is as thin. Such a thing bends the edge it
# touches, or hides it, so it must not go unnoticed.


DARK_INK = 0.6
"""Share of light through the grid's ink below which a dark place may be ink as well as a thing in the light."""

THING, FEWEST_PX = 0.45e-3, 5.0
"""Length in m, and in px of the small version, that a thing must stand out of the shadow to be distinguished from dust."""

SQUARE = np.ones((3, 3), np.uint8)


def touched_by_thread(
    light: npt.NDArray[np.float32], coarse: CoarseShadow, ink: npt.NDArray[np.float64], line_px: float, scale: float
) -> bool:
    """Return whether something thin and dark stands out of the shadow.

    Args:
        light: Light of the small version, shape (h, w, 3).
        coarse: The shadow found in it.
        ink: Share of light that the grid's ink lets through there, shape (h, w).
        line_px: Greatest width of a grid line in these pixels, as `find_shadow` had it.
        scale: Length in m of one of these pixels.
    """
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
    reach = max(THING / scale, FEWEST_PX)
    touching, long = (np.unique(labels[(things > 0) & chosen]) for chosen in (far < 3.0, far > reach))
    return bool(np.intersect1d(touching, long).size)
