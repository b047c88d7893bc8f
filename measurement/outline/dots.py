"""Markers on a device in a photograph: round dots of a named colour, and AprilTags.

A dot differs from the device, by the Mahalanobis distance in colour, and is an ellipse in the raw photograph. Its boundary is
fitted to the light, with an edge as soft as it is there and with light that changes evenly across it; only the boundary is
mapped to the device's plane, in which the middle of the area is the dot's own, whatever perspective and lens made of it.
"""

from __future__ import annotations

import colorsys
import dataclasses

import cv2
import numpy as np
from matplotlib import colors
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.special import chdtri, erfc

from measurement import pictures
from measurement.outline import profiles, silhouette
from measurement.screen import calibration
from measurement.screen.setup import SetupError
from softmodels.common.arrays import Array, Mask


@dataclasses.dataclass(frozen=True, eq=False)
class Mark:
    """A marker in a photograph.

    Attributes:
        boundary: Points (k, 2) in px around it; of a tag its four corners.
        error: Standard error in px of its middle along each axis.
        name: Number of a tag; empty for a dot.
        width: Standard deviation in px of a dot's edge; 0 of a tag.
        doubt: What speaks against it, in words.
    """

    boundary: Array
    error: float
    name: str = ""
    width: float = 0.0
    doubt: str = ""

    @property
    def middle(self) -> Array:
        """About its middle (2,) in px."""
        return np.asarray(self.boundary.mean(axis=0))


FAMILY = "tag36h11"

MIN_SATURATION, HUE_TOLERANCE, MAX_DARK, MIN_WHITE = 0.3, 35.0 / 360.0, 0.35, 0.6
"""Least saturation of a coloured dot, by how much of a turn its hue may differ from the named one, greatest value of a black
dot and least one of a white one."""

MIN_ANGLE = np.radians(4.0)
"""Angle between the colours of a coloured dot and of the device around it: a shadow or a glint has none."""

MIN_DOT_AREA, MAX_DOT_SHARE, MIN_ROUND, MIN_ASPECT = 12, 0.1, 0.8, 0.4
"""Least area of a dot in pixels of the reduced picture and largest share of the device, its least area over that of the ellipse
with its second moments, and the ellipse's least axis over its greatest."""

FAR_COLOUR = 1e-6
"""Probability with which a pixel of the device's colour is as far from it as one of a dot."""

FIT_RADIUS = 1.6
"""Radius around a dot, in its own, within which its light is fitted."""

FITTED_COUNT = 12
"""Parameters of that fit: six of the ellipse and the blur, six of the light within and around."""

MAX_PATCH = 0.12
"""Largest smoothed misfit of a dot's light over its contrast: something lies on it, or it is not round."""

MODEL_ERROR = 0.006
"""Standard error in px of a dot's middle that no noise shows: pixels of other sensitivity, an edge of another shape."""

JPEG_BLOCK = 8
"""Side in px of the blocks of a JPEG file."""

BOUNDARY_COUNT = 72


def checked_kind(text: str) -> str:
    """Return the kind of markers that a text names: a colour, or the family of tags; `SetupError` for neither."""
    kind = text.strip().lower()
    if kind != FAMILY and not colors.is_color_like(kind):
        raise SetupError(
            f"--markers {text} names no colour; give the colour of the dots, such as red or #2060c0, or {FAMILY} for AprilTags"
        )
    return kind


def find_marks(image: pictures.Pixels, seen: silhouette.Silhouette, kind: str) -> list[Mark]:
    """Return the markers of a kind inside a device's outline in a photograph (h, w, 3)."""
    outline = np.vstack([seen.base[:1], seen.edge.px, seen.base[1:]]).astype(np.float32)

    def is_inside(boundary: Array) -> bool:
        return all(
            cv2.pointPolygonTest(outline, point, True) > 1.5 for point in boundary[:: max(1, len(boundary) // 24)].tolist()
        )

    if kind == FAMILY:
        tags = calibration.find_tags(image)
        return [Mark(corners, 0.5 * calibration.TAG_CORNER_ERROR, str(name)) for name, corners in tags if is_inside(corners)]
    return [mark for mark in _dots(image, outline, seen.factor, kind) if is_inside(mark.boundary)]


def _dots(image: pictures.Pixels, outline: NDArray[np.float32], factor: float, kind: str) -> list[Mark]:
    """Return dots within the rectangle around the outline (n, 2) in px of the device."""
    x0, y0 = np.maximum(np.floor(outline.min(axis=0)).astype(int), 0).tolist()
    x1, y1 = (np.minimum(np.ceil(outline.max(axis=0)).astype(int) + 1, image.shape[1::-1])).tolist()
    part = image[y0:y1, x0:x1]
    size = max(1, round(part.shape[1] / factor)), max(1, round(part.shape[0] / factor))
    scale = np.array(part.shape[1::-1]) / size
    small = pictures.LIGHT_OF_SRGB[cv2.resize(part, size, interpolation=cv2.INTER_AREA)].astype(float)
    body = np.zeros(size[::-1], dtype=np.uint8)
    cv2.fillPoly(body, [np.rint((outline - [x0, y0]) / scale).astype(np.int32)], 1)
    body = cv2.erode(body, np.ones((5, 5), np.uint8))
    pixels = small[body > 0]
    if len(pixels) < silhouette.MIN_AREA:
        return []
    centre, covariance = profiles.robust_covariance(pixels[:: max(1, len(pixels) // profiles.MOST_PIXELS)])
    away = profiles.mahalanobis(small - centre, covariance + np.eye(3) * profiles.LIGHT_FLOOR**2)
    other = (away > np.sqrt(chdtri(3, FAR_COLOUR))) & (body > 0)
    other &= _has_colour(small, kind)
    count, labels, stats, middles = cv2.connectedComponentsWithStats(other.astype(np.uint8), connectivity=8)
    marks = []
    for label in range(1, count):
        inside, area = labels == label, stats[label, cv2.CC_STAT_AREA]
        if not MIN_DOT_AREA <= area <= MAX_DOT_SHARE * len(pixels):
            continue
        spread = np.cov(np.argwhere(inside)[:, ::-1].T) + np.eye(2) / 12.0
        axes = 2.0 * np.sqrt(np.linalg.eigvalsh(spread))
        if axes[0] < MIN_ASPECT * axes[1] or area < MIN_ROUND * np.pi * axes[0] * axes[1]:
            continue
        middle = (middles[label] + 0.5) * scale - 0.5 + [x0, y0]
        taken = cv2.dilate((other & ~inside).astype(np.uint8), np.ones((3, 3), np.uint8)) | (1 - body)
        mark = _fitted(image, middle, spread * np.outer(scale, scale), _Free(taken > 0, scale, np.array([x0, y0])), kind)
        if mark is not None:
            marks.append(mark)
    return marks


def _has_colour(light: Array, kind: str) -> Mask:
    """Return which light (..., 3) is of a named colour."""
    hue, saturation, value = colorsys.rgb_to_hsv(*colors.to_rgb(kind))
    seen = colors.rgb_to_hsv(np.clip(light, 0.0, 1.0) ** (1.0 / 2.2))
    if saturation < MIN_SATURATION:
        return np.asarray(
            seen[..., 2] < MAX_DARK if value < 0.5 else (seen[..., 2] > MIN_WHITE) & (seen[..., 1] < MIN_SATURATION)
        )
    off = np.abs((seen[..., 0] - hue + 0.5) % 1.0 - 0.5)
    return np.asarray((off < HUE_TOLERANCE) & (seen[..., 1] > MIN_SATURATION))


@dataclasses.dataclass(frozen=True, eq=False)
class _Free:
    """Pixels of the reduced picture that belong to other dots or to the background, the reduction, and its origin in px."""

    taken: Mask
    scale: Array
    origin: Array

    def __call__(self, px: Array) -> Mask:
        at = np.rint((px - self.origin + 0.5) / self.scale - 0.5).astype(int)
        inside = ((at >= 0) & (at < self.taken.shape[::-1])).all(axis=-1)
        column, row = np.moveaxis(np.clip(at, 0, np.array(self.taken.shape[::-1]) - 1), -1, 0)
        return np.asarray(inside & ~self.taken[row, column])


def _fitted(image: pictures.Pixels, middle: Array, spread: Array, free: _Free, kind: str) -> Mark | None:
    """Return the dot about a place (2,) in px with second moments (2, 2) in px^2; None where it is of another colour."""
    reach = FIT_RADIUS * 2.0 * np.sqrt(np.diag(spread)) + 3.0
    low = np.maximum(np.floor(middle - reach).astype(int), 0)
    high = np.minimum(np.ceil(middle + reach).astype(int) + 1, image.shape[1::-1])
    window = image[low[1] : high[1], low[0] : high[0]]
    light = pictures.LIGHT_OF_SRGB[window].astype(float)
    px = np.stack(np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1])), axis=-1).astype(float)
    radius = float(np.sqrt(2.0 * np.sqrt(np.linalg.det(2.0 * spread))))
    begin = np.linalg.inv(np.linalg.cholesky(4.0 * spread))
    away = np.linalg.norm((px - middle) @ begin.T, axis=-1)
    used = (away < FIT_RADIUS + 3.0 / radius) & (free(px) | (away < 1.0 + 2.0 / radius))
    core, ring = (used & (away < 0.75)), (used & (away > 1.0 + 2.5 / radius))
    if min(core.sum(), ring.sum()) < 12:
        return None
    inner, outer = np.median(light[core], axis=0), np.median(light[ring], axis=0)
    between = np.arccos(np.clip(inner @ outer / (np.linalg.norm(inner) * np.linalg.norm(outer) + 1e-12), -1.0, 1.0))
    coloured = colorsys.rgb_to_hsv(*colors.to_rgb(kind))[1] >= MIN_SATURATION
    if not _has_colour(inner, kind) or (coloured and between < MIN_ANGLE):
        return None
    noise = np.cov(np.vstack([light[core] - inner, light[ring] - outer]).T) + np.eye(3) * profiles.LIGHT_FLOOR**2
    way = np.linalg.solve(noise, inner - outer)
    share = (light - outer) @ way / ((inner - outer) @ way)
    return _ellipse(px[used], share[used], middle, begin, radius)


def _ellipse(px: Array, share: Array, middle: Array, begin: Array, radius: float) -> Mark:
    """Return the dot whose light, 0 of the device to 1 inside, at pixels (n, 2) is given, near an ellipse: ``begin`` is the
    matrix (2, 2) that makes it the unit circle."""
    across = (px - middle) / radius
    flat = np.column_stack([np.ones(len(px)), across])

    def drawn(p: Array) -> Array:
        turn = np.array([[p[2], 0.0], [p[3], p[4]]])
        offset = (px - middle - p[:2] * radius) @ turn.T
        far = np.maximum(np.linalg.norm(offset, axis=1), 1e-9)
        steep = np.maximum(np.linalg.norm(offset @ turn, axis=1) / far, 1e-9)
        inside = 0.5 * erfc((far - 1.0) / steep / (np.sqrt(2.0) * np.exp(p[5])))
        return np.hstack([flat, inside[:, None] * flat])

    def missed(p: Array) -> Array:
        terms = drawn(p)
        return np.asarray(share - terms @ np.linalg.solve(terms.T @ terms, terms.T @ share))

    first = np.r_[0.0, 0.0, begin[0, 0], begin[1, 0], begin[1, 1], np.log(0.8)]
    low, high = np.r_[-1.0, -1.0, 0.1 / radius, -np.inf, 0.1 / radius, np.log(0.25)], np.full(6, np.inf)
    low[3], high[3], high[5] = -10.0 / radius, 10.0 / radius, np.log(max(1.0, radius))
    fit = least_squares(missed, np.clip(first, low + 1e-9, high - 1e-9), bounds=(low, high), x_scale="jac", max_nfev=60)
    turn = np.linalg.inv(np.array([[fit.x[2], 0.0], [fit.x[3], fit.x[4]]]))
    angle = np.linspace(0.0, 2.0 * np.pi, BOUNDARY_COUNT, endpoint=False)
    boundary = middle + fit.x[:2] * radius + np.column_stack([np.cos(angle), np.sin(angle)]) @ turn.T
    # Pixels next to each other are blurred together, and those of a block of a JPEG file are stored together: what they miss
    # is not independent (covariance robust to clusters, Liang & Zeger 1986); a small dot lies in fewer blocks than the fit has
    # parameters.
    low_px = px.min(axis=0)
    image, known = (np.zeros(np.ptp(px, axis=0).astype(int)[::-1] + 1, np.float32) for _ in range(2))
    row, column = (px - low_px).astype(int).T[::-1]
    image[row, column], known[row, column] = fit.fun, 1.0
    mean, count = (cv2.blur(part, (3, 3), borderType=cv2.BORDER_CONSTANT) * 9.0 for part in (image, known))
    whole = count > 8.5
    variance = float(np.sum(fit.fun**2)) / max(1, len(px) - FITTED_COUNT)
    correlated = float(np.clip(np.mean(mean[whole] ** 2) / 9.0 / variance, 1.0, 9.0)) if whole.sum() > 20 else 1.0
    inverse = np.linalg.pinv(fit.jac.T @ fit.jac)
    blocks, block = np.unique(px // JPEG_BLOCK, axis=0, return_inverse=True)
    score = np.zeros((len(blocks), 6))
    np.add.at(score, np.ravel(block), fit.jac * fit.fun[:, None])
    clustered = inverse @ (score.T @ score) @ inverse * (len(blocks) + FITTED_COUNT) / max(1, len(blocks) - 1)
    both = [float(np.trace(covariance[:2, :2])) for covariance in (inverse * variance * correlated, clustered)]
    error = float(np.hypot(np.sqrt(max(both) / 2.0) * radius, MODEL_ERROR))
    patch = float(np.abs(mean[whole] / 9.0).max()) if whole.any() else 1.0
    doubt = (
        f"its light differs by {patch:.0%} from a round dot's: something lies on it, or it shines" if patch > MAX_PATCH else ""
    )
    return Mark(boundary, error, width=float(np.exp(fit.x[5])), doubt=doubt)
