"""The silhouette of a device seen from the side: which pixels it covers, its edge as a curve, its centre line, tip and angle.

The background's colour is learnt along the rim of the region of interest; what lies far from it, by the Mahalanobis distance
in colour, is the device, darker or brighter. The edge between both is refined in the raw photograph as a shadow's is (`edge`),
and only its points are mapped to the plane of motion.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools

import cv2
import numpy as np
from scipy.interpolate import make_lsq_spline
from scipy.ndimage import gaussian_filter1d
from scipy.spatial import cKDTree
from scipy.special import chdtri
from skimage.filters import threshold_otsu
from skimage.graph import MCP_Geometric

from measurement import pictures, robust
from measurement.outline import edge, profiles
from measurement.screen.setup import Setup
from softmodels.common.arrays import Array, Mask


@dataclasses.dataclass(frozen=True, eq=False)
class Silhouette:
    """A device's outline in a photograph (h, w, 3).

    Attributes:
        edge: Its points in order, from the base around the tip back to the base, in px of the photograph.
        base: The ends of the base (2, 2) in px, beside the edge's first and its last point.
        factor: Pixels of the photograph per pixel of the reduced picture.
        longest_gap: Longest stretch without a clear edge over the length of the whole contour; there the contour of the
            reduced picture stands in.
        cut: Whether the frame or the region of interest cuts it in a second place.
        second: Area of the next largest thing that is not background, over the device's, and its place (x, y) in px.
        hidden: Share of the contour that lies beside what a mask or the scale's own target covers.
        soft: Share of the points whose edge is more than `SOFT_EDGE` times as wide as usual.
    """

    edge: edge.Edge
    base: Array
    factor: float
    longest_gap: float
    cut: bool
    second: tuple[float, float, float]
    hidden: float
    soft: float

    @functools.cached_property
    def folded(self) -> Mask:
        """Which of the edge's points lie in folds, gaps between chambers or roots of ribs, which the centre line passes."""
        return _folded(np.vstack([self.base[:1], self.edge.px, self.base[1:]]), self.factor)[1:-1]

    @functools.cached_property
    def guide(self) -> Array:
        """Rough centre line (k, 2) in px from the base to the tip."""
        return _guide(np.vstack([self.base[:1], self.edge.px[~self.folded], self.base[1:]]), self.factor)

    @functools.cached_property
    def corners(self) -> tuple[int, int] | None:
        """Numbers of the points out of folds at both ends of the tip's face; None for a round tip."""
        return _corners(self.edge.px[~self.folded], self.guide, float(np.linalg.norm(self.base[1] - self.base[0])))

    @functools.cached_property
    def notched(self) -> float:
        """Depth of the deepest notch at the tip's face over its width, as beside a bead or a drop, or where a piece is torn
        off; 0 where the outline nowhere turns inwards by `MIN_NOTCH`, and for a round tip."""
        if self.corners is None:
            return 0.0
        first, last = np.flatnonzero(~self.folded)[list(self.corners)]
        width = float(np.linalg.norm(self.edge.px[last] - self.edge.px[first]))
        arc, turned = _turned(self.edge.px, width, NOTCH_REACH)
        near = (arc > arc[first] - BESIDE_TIP * width) & (arc < arc[last] + BESIDE_TIP * width)
        if turned[near].min() > -MIN_NOTCH:
            return 0.0
        points = self.edge.px[near].astype(np.float32)
        band = cv2.convexHull(points)
        return max(cv2.pointPolygonTest(band, point, True) for point in points[2:-2].tolist()) / width

    @functools.cached_property
    def side(self) -> Array:
        """Shares (n,) that say on which side each point lies: 0 from the base's first end to the tip, 1 from there on."""
        count = len(self.edge.px)
        first, last = (0.45 * count, 0.55 * count) if self.corners is None else np.flatnonzero(~self.folded)[list(self.corners)]
        return np.interp(np.arange(count), [first, last], [0.0, 1.0])

    @property
    def softness(self) -> float:
        """Width in px of the edge where it is soft: of four fifths of its points it is less."""
        return float(np.percentile(self.edge.width, 80))


LARGEST_SMALL_PX = 1000
"""Longer side in px of the reduced picture in which the device is looked for."""

RIM_SHARE = 0.03
"""Width of the rim, as a share of the shorter side, whose colour is the background's."""

MIN_AREA = 150
"""Pixels of the reduced picture that a device covers."""

SOFT_EDGE = 2.5
"""Width of an edge over the usual one from which it is more likely a cast shadow's than the device's."""

NEAR_BASE = 0.6
"""Distance from the base's two pixels, in lengths between them, within which the outline crosses the line through them."""

RIM_OF_TAG, RIM_OF_BOARD = 0.25, 2.5
"""How far a tag goes beyond its corners, in sides, and a board beyond its own, in squares: towards the corners of both."""

BESIDE_COVERED = 4
"""Pixels of the reduced picture from a covered region within which it hides a part of the device."""


MIN_DIFFERENCE = 0.03
"""Difference of light from 0 to 1 between device and background in the channel that shows it best."""

NOTHING_SEEN = "no device stands out from the background; use a background of another colour, or light from behind"


def find_silhouette(image: pictures.Pixels, setup: Setup, base: Array | None = None) -> Silhouette:
    """Return the silhouette of the one device in a photograph (h, w, 3).

    ``base`` are two pixels (2, 2) at the ends of the face at which the device begins; None where it reaches out of the frame
    or out of the region of interest there. Raises `Unmeasurable` for no device, or an outline that does not begin and end at
    the base.
    """
    x0, y0, x1, y1 = map(round, setup.roi or (0, 0, *setup.camera.size))
    factor = max(1.0, max(x1 - x0, y1 - y0) / LARGEST_SMALL_PX)
    size = max(8, round((x1 - x0) / factor)), max(8, round((y1 - y0) / factor))
    small = cv2.resize(image[y0:y1, x0:x1], size, interpolation=cv2.INTER_AREA)
    light = pictures.LIGHT_OF_SRGB[cv2.medianBlur(small, 3)].astype(np.float64)
    covered = _covered(setup, size, factor, (x0, y0))
    body, (area, *middle) = _body(light, covered)
    second = (area, x0 + factor * middle[0], y0 + factor * middle[1])
    colour = _colours(light, body, covered)
    share = colour.share(light)
    mask = body if colour.depth > 0 and share[body].mean() < 0.5 else ~body
    contour = edge.coarse_contour(mask, share, factor, (x0, y0))
    is_open = float(np.linalg.norm(contour[0] - contour[-1])) > 2.0 * factor
    shading = profiles.Shading(image, colour)
    traced = edge.refine_edge(shading, contour, factor, symmetric=True)  # faces seen aslant bend the profiles
    traced, gap = _without_gaps(traced, contour, factor, shading)
    beside = cv2.dilate(covered.astype(np.uint8), np.ones((2 * BESIDE_COVERED + 1,) * 2, np.uint8)) > 0
    if base is None:
        if not is_open:
            raise pictures.Unmeasurable(
                "the outline is closed, so nothing shows where the device begins; give two pixels at the ends of its base "
                "(--base x,y=x,y)"
            )
        ends, cut = contour[[0, -1]], False
        if float(np.linalg.norm(traced.px[0] - ends[0])) > float(np.linalg.norm(traced.px[-1] - ends[0])):
            traced = _reversed(traced)
    else:
        traced, ends, cut = _from_base(traced, np.asarray(base, dtype=float), is_open)
    return Silhouette(
        traced, ends, factor, gap, cut, second, float(np.mean(_lies_in(traced.px, beside, factor, (x0, y0)))),
        float(np.mean(traced.width > SOFT_EDGE * np.median(traced.width))),
    )  # fmt: skip


def _covered(setup: Setup, size: tuple[int, int], factor: float, origin: tuple[int, int]) -> Mask:
    """Return which pixels of the reduced picture masks or the scale's own target cover, shape (h, w)."""
    shown = np.zeros(size[::-1], dtype=np.uint8)
    for left, top, right, bottom in setup.masks:
        corners = (np.array([[left, top], [right, bottom]]) - origin) / factor
        first, last = np.rint(corners).astype(int).tolist()
        cv2.rectangle(shown, first, last, 1, -1)
    seen = setup.camera.distort(setup.plane.points)
    hull = cv2.convexHull(seen.astype(np.float32))[:, 0].astype(float)
    # A board goes on by a square and a white rim beyond its corners, a tag by its rim.
    step = np.sqrt(cv2.contourArea(hull.astype(np.float32))) * (
        RIM_OF_TAG if len(seen) == 4 else RIM_OF_BOARD / np.sqrt(len(seen))
    )
    out = hull - hull.mean(axis=0)
    hull = hull + out * (step / np.maximum(np.linalg.norm(out, axis=1), 1e-9))[:, None]
    inside = (hull - origin) / factor
    if cv2.contourArea(inside.astype(np.float32)) < 0.4 * size[0] * size[1]:  # a larger one is the background
        cv2.fillPoly(shown, [np.rint(inside).astype(np.int32)], 1)
    return shown > 0


def _body(light: Array, covered: Mask) -> tuple[Mask, tuple[float, float, float]]:
    """Return where the device is in the light (h, w, 3), and the next thing's area over its and that's place (x, y)."""
    rim = np.ones(light.shape[:2], dtype=bool)
    width = max(3, round(RIM_SHARE * min(rim.shape)))
    rim[width:-width, width:-width] = False
    rim &= ~covered
    if rim.sum() < MIN_AREA:
        raise pictures.Unmeasurable("no rim of the picture shows the background; give setup --roi a larger region")
    background = rim
    for _ in range(3):  # uneven light is learnt from the background, which is known only after a first look
        levels = _surface(light, background)
        centre, covariance = profiles.robust_covariance(_thinned((light - levels)[background]))
        covariance = (
            covariance + np.eye(3) * max(profiles.LIGHT_FLOOR, _stored_step(centre + levels[background].mean(axis=0))) ** 2
        )
        distance = profiles.mahalanobis(light - levels - centre, covariance)
        limit = np.sqrt(chdtri(3, 1e-4))
        split = np.exp(threshold_otsu(np.log(np.maximum(distance[~covered], 0.1 * limit))))
        other = (distance > max(limit, split)) & ~covered
        background = ~cv2.dilate(other.astype(np.uint8), np.ones((5, 5), np.uint8)).astype(bool) & ~covered
        if background.sum() < MIN_AREA:
            raise pictures.Unmeasurable("nothing of the background can be told from the device; use a background that differs")
    opened = cv2.morphologyEx(other.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    count, labels, stats, _ = cv2.connectedComponentsWithStats(opened, connectivity=4)
    areas = stats[1:, cv2.CC_STAT_AREA]
    if count < 2 or areas.max() < MIN_AREA:
        raise pictures.Unmeasurable(NOTHING_SEEN)
    order = np.argsort(areas)[::-1]
    mask = labels == order[0] + 1
    outside = cv2.connectedComponents(np.pad(~mask, 1, constant_values=True).astype(np.uint8), connectivity=4)[1]
    body = outside[1:-1, 1:-1] != outside[0, 0]  # a reflection inside is no edge of it
    if len(order) < 2:
        return body, (0.0, 0.0, 0.0)
    row, column = np.argwhere(labels == order[1] + 1).mean(axis=0)
    return body, (float(areas[order[1]] / areas[order[0]]), float(column), float(row))


def _stored_step(light: Array) -> float:
    """Return by how much the light (3,) changes from one stored number to the next: compression moves whole blocks by one."""
    stored = np.clip(np.searchsorted(pictures.LIGHT_OF_SRGB, light.mean()), 1, 254)
    return float(pictures.LIGHT_OF_SRGB[stored + 1] - pictures.LIGHT_OF_SRGB[stored - 1]) / 2.0


def _surface(light: Array, background: Mask) -> Array:
    """Return quadratic surfaces (h, w, 3) through the background's light (h, w, 3)."""
    v, u = (2.0 * np.arange(count) / count - 1.0 for count in background.shape)
    row, column = (at[:: max(1, int(background.sum() / profiles.MOST_PIXELS))] for at in np.nonzero(background))

    def terms(x: Array, y: Array) -> Array:
        return np.stack([np.ones(np.broadcast(x, y).shape), *np.broadcast_arrays(x, y, x * x, x * y, y * y)], axis=-1)

    design, value = terms(u[column], v[row]), light[row, column]
    even = np.zeros((design.shape[1], 3))
    even[0] = np.median(value, axis=0)
    fits = []
    for fit in (np.linalg.lstsq(design, value, rcond=None)[0], even):
        for _ in range(4):  # what else is on the rim must not tilt it; much of it does, unless light is first taken as even
            missed = np.linalg.norm(value - design @ fit, axis=1)
            near = missed <= 3.0 * max(float(np.median(missed)), profiles.LIGHT_FLOOR)
            fit = np.linalg.lstsq(design[near], value[near], rcond=None)[0]
        fits.append((float(np.median(np.linalg.norm(value - design @ fit, axis=1))), fit))
    return np.asarray(terms(u[None, :], v[:, None]) @ min(fits, key=lambda pair: pair[0])[1])


def _thinned(samples: Array) -> Array:
    return samples[:: max(1, len(samples) // profiles.MOST_PIXELS)]


def _colours(light: Array, body: Mask, covered: Mask) -> profiles.ShadowColour:
    """Return the colours of device and background near its edge, the darker one as the shadow."""
    near = cv2.dilate(body.astype(np.uint8), np.ones((41, 41), np.uint8)) > 0
    beside = near & ~(cv2.dilate(body.astype(np.uint8), np.ones((7, 7), np.uint8)) > 0) & ~covered
    within = cv2.erode(body.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    if within.sum() < 30 or beside.sum() < 30:
        raise pictures.Unmeasurable("the device is too small in the picture to be measured; move the camera closer")
    parts = [profiles.robust_covariance(_thinned(light[part])) for part in (within, beside)]
    dark, lit = sorted(parts, key=lambda part: float(part[0].sum()))
    if np.abs(lit[0] - dark[0]).max() < MIN_DIFFERENCE:
        raise pictures.Unmeasurable(NOTHING_SEEN)
    pooled = 0.5 * (dark[1] + lit[1])
    pooled = pooled + np.eye(3) * max(profiles.LIGHT_FLOOR**2, 0.1 * float(np.trace(pooled)) / 3.0)
    return profiles.ShadowColour(dark[0], lit[0], pooled)


def _lies_in(px: Array, covered: Mask, factor: float, origin: tuple[int, int]) -> Mask:
    """Return which points (n, 2) in px lie on a covered pixel of the reduced picture."""
    at = np.rint((px - origin + 0.5) / factor - 0.5).astype(int)
    column, row = (np.clip(at[:, k], 0, covered.shape[1 - k] - 1) for k in (0, 1))
    return np.asarray(covered[row, column])


def _without_gaps(
    traced: edge.Edge, contour: Array, factor: float, shading: profiles.Shading
) -> tuple[edge.Edge, float]:  # fmt: skip
    """Return the edge with further points near the contour (n, 2) where it has gaps, and the longest stretch over the
    contour's length in which these have no clear edge either.

    A face in the shade that is seen aslant beside the edge makes a second step, which no single one fits: the steepest place
    of the outer step is the edge there.
    """
    way = np.gradient(contour, axis=0)
    arc = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(contour, axis=0), axis=1))]
    number = cKDTree(contour).query(traced.px)[1]
    at = arc[number]
    order = np.argsort(at, kind="stable")
    usual = float(np.median(np.diff(at[order])))
    far = cKDTree(at[:, None]).query(arc[:, None])[0]
    extra = np.flatnonzero(far > 2.0 * usual)[:: max(1, round(usual / max(arc[-1] / len(arc), 1e-9)))]
    if not len(extra):
        return traced[order], float(np.diff(np.r_[0.0, at[order], arc[-1]]).max() / arc[-1])
    normal = np.column_stack([way[:, 1], -way[:, 0]])
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-9)[:, None]
    normal = normal[extra] * np.sign(np.sum(normal[number] * traced.normal))
    nearest = cKDTree(traced.px).query(contour[extra])[1]
    shift, is_clear = _steepest(shading, contour[extra], normal, 2.0 * factor + 2.0)
    joined = dataclasses.replace(
        traced, px=np.vstack([traced.px, contour[extra] + shift[:, None] * normal]), normal=np.vstack([traced.normal, normal]),
        error=np.r_[traced.error, np.where(is_clear, STEEPEST_ERROR, 0.5 * factor)],
        width=np.r_[traced.width, traced.width[nearest]], contrast=np.r_[traced.contrast, traced.contrast[nearest]],
    )  # fmt: skip
    seen = np.sort(np.r_[0.0, at, arc[extra[is_clear]], arc[-1]])
    return joined[np.argsort(np.r_[at, arc[extra]], kind="stable")], float(np.diff(seen).max() / arc[-1])


STEEPEST_ERROR, STEEPEST_SHARE = 0.2, 0.3
"""Standard error in px of the steepest place of an edge, and the share of the whole step that rises within 2 px there."""


def _steepest(shading: profiles.Shading, px: Array, normal: Array, reach: float) -> tuple[Array, Mask]:
    """Return the offsets (n,) in px along normals (n, 2) at which the light rises most, within a reach of places (n, 2), and
    where that is a clear edge."""
    offsets = np.arange(-reach - 2.0, reach + 2.01, 0.5)
    value = shading.level(px[:, None, :] + offsets[None, :, None] * normal[:, None, :])
    rise = np.nan_to_num(gaussian_filter1d(value, 1.5, axis=1, order=1)[:, 4:-4], nan=0.0)
    best = np.clip(np.argmax(rise, axis=1), 1, rise.shape[1] - 2)
    before, most, after = (np.take_along_axis(rise, (best + k)[:, None], axis=1)[:, 0] for k in (-1, 0, 1))
    bend = np.minimum(before - 2.0 * most + after, -1e-12)
    place = offsets[4:-4][best] + 0.25 * np.clip((before - after) / bend, -1.0, 1.0)
    is_clear = 4.0 * most > STEEPEST_SHARE  # half a pixel between samples
    return np.where(is_clear, place, 0.0), is_clear


def _reversed(traced: edge.Edge) -> edge.Edge:
    return traced[np.arange(len(traced.px))[::-1]]


def _from_base(traced: edge.Edge, base: Array, is_open: bool) -> tuple[edge.Edge, Array, bool]:
    """Return the part of the edge from one end of the base around the tip to the other, the first pixel's end first, where
    it meets the line of the base, shape (2, 2), and whether the frame cuts it."""
    px, along = traced.px, base[1] - base[0]
    length = float(np.linalg.norm(along))
    if length < 3.0:
        raise pictures.Unmeasurable("the two pixels of --base are the same; give those at both ends of the device's base")
    across = np.array([-along[1], along[0]]) / length
    beside = (px - base[0]) @ across
    following = np.r_[np.arange(1, len(px)), 0] if not is_open else np.arange(1, len(px))
    before = np.arange(len(following))
    crossing = np.flatnonzero(np.signbit(beside[before]) != np.signbit(beside[following]))
    chosen = []
    for end in base:
        near = np.linalg.norm(px[crossing] - end, axis=1)
        if not len(crossing) or near.min() > NEAR_BASE * length:
            raise pictures.Unmeasurable(
                f"no edge of the device lies near the pixel {end[0]:.0f},{end[1]:.0f} of --base; give the two pixels at the "
                "ends of the face at which the device begins"
            )
        chosen.append(int(crossing[np.argmin(near)]))
    first, last = chosen
    if first == last:
        raise pictures.Unmeasurable("both pixels of --base lie at one edge of the device; give those at both ends of its base")
    low, high = min(chosen), max(chosen)
    inner = np.arange(low + 1, high + 1)
    outer = np.r_[np.arange(high + 1, len(px)), np.arange(0, low + 1)]
    # The way around the tip stays in the frame; that around the clamp leaves it, or is the shorter one.
    longer = len(inner) >= len(outer)
    way = inner if is_open or longer else outer
    part, pairs = traced[way], np.array([(k, following[k]) for k in chosen])
    share = beside[pairs[:, 0]] / (beside[pairs[:, 0]] - beside[pairs[:, 1]])
    ends = px[pairs[:, 0]] + share[:, None] * (px[pairs[:, 1]] - px[pairs[:, 0]])
    if np.linalg.norm(part.px[0] - ends[0]) > np.linalg.norm(part.px[-1] - ends[0]):
        part = _reversed(part)
    return part, ends, is_open and not longer


def _filled(outline: Array, factor: float, margin: int) -> tuple[Mask, Array]:
    """Return the pixels of the reduced picture inside an outline (n, 2) in px, with a margin, and its points there."""
    low = outline.min(axis=0) - margin * factor
    shape = np.ceil((outline.max(axis=0) - low) / factor).astype(int)[::-1] + margin + 1
    inside, small = np.zeros(shape, dtype=np.uint8), (outline - low) / factor
    cv2.fillPoly(inside, [np.rint(small).astype(np.int32)], 1)
    return inside > 0, small


FOLD_RADIUS, FOLD_DEPTH, FOLD_SHARE = 0.4, 0.03, 0.3
"""Radius of the disk that does not enter a fold and depth below its rims from which it is one, in widths of the base, and
largest share of the outline in a fold: a device that curls up has more between its base and its tip."""


def _folded(outline: Array, factor: float) -> Mask:
    """Return which points of an outline (n, 2) in px, from one end of the base to the other, lie in folds: where a disk that
    rolls around the device does not come."""
    width = float(np.linalg.norm(outline[-1] - outline[0])) / factor
    inside, small = _filled(outline, factor, int(np.ceil(FOLD_RADIUS * width)) + 2)
    away = cv2.distanceTransform((~inside).astype(np.uint8), cv2.DIST_L2, 5)
    closed = cv2.distanceTransform((away < FOLD_RADIUS * width).astype(np.uint8), cv2.DIST_L2, 5) - FOLD_RADIUS * width
    depth = closed[tuple(np.rint(small).astype(int).T[::-1])]
    folded, deep = depth > 1.0, depth > max(2.0, FOLD_DEPTH * width)
    arc = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(small, axis=0), axis=1))]
    starts, stops = (np.flatnonzero(np.diff(np.r_[0, folded, 0]) == step) for step in (1, -1))
    for start, stop in zip(starts, stops, strict=True):
        if not deep[start:stop].any() or arc[stop - 1] - arc[start] > FOLD_SHARE * arc[-1]:
            folded[start:stop] = False
    return np.asarray(folded)


CORNER_REACH, CORNER_TURN = (0.04, 0.25), np.radians(35.0)
"""Distances from a corner, in widths, between which the outline on both sides of it is used, and least angle it turns by."""

FACE_LENGTHS, FACE_TURN, FACE_OFFSET = (0.3, 2.0), np.radians(50.0), 0.4
"""Lengths of a tip's face in widths of the base, largest angle between its normal and the centre line before it, and how far
beside that, as a share of its length, its middle may be."""


NOTCH_REACH, BESIDE_TIP, MIN_NOTCH = (0.04, 0.2), 0.25, np.radians(12.0)
"""Distances in widths of the tip's face between which an outline shows a turn inwards, how far beside the face that is looked
for, and the least angle: clean edges turn by up to 5 degrees, and beside a bead by 18 or more."""


def _turned(outline: Array, width: float, reach: tuple[float, float]) -> tuple[Array, Array]:
    """Return the arc length (n,) in px of an outline (n, 2), and by how much in rad it turns, outwards positive, at each point
    from before it to behind it, between two distances from it in widths."""
    arc = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(outline, axis=0), axis=1))]
    sides = []
    for sign in (-1.0, 1.0):
        near, far = (np.column_stack([np.interp(arc + sign * at * width, arc, along) for along in outline.T]) for at in reach)
        sides.append(sign * (far - near))
    before, after = sides
    turned = np.arctan2(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0], np.sum(before * after, axis=1))
    around = np.sum(outline[:, 0] * np.roll(outline[:, 1], -1) - np.roll(outline[:, 0], -1) * outline[:, 1])
    return arc, turned * np.sign(around)


def _corners(outline: Array, guide: Array, width: float) -> tuple[int, int] | None:
    """Return the numbers of the points of an outline (n, 2) in px at both ends of the tip's face, to which a rough centre line
    (k, 2) leads; None where it has no two corners."""
    arc, turned = _turned(outline, width, CORNER_REACH)
    inside = (arc > CORNER_REACH[1] * width) & (arc < arc[-1] - CORNER_REACH[1] * width)
    step = max(1, round(0.5 * CORNER_REACH[1] * width / float(np.median(np.diff(arc)))))
    peaks = [
        k for k in np.flatnonzero(inside & (turned > CORNER_TURN)) if turned[k] >= turned[max(0, k - step) : k + step + 1].max()
    ]
    end = guide[-1]
    way = end - guide[max(0, len(guide) - 1 - max(3, len(guide) // 6))]
    way, best = way / np.linalg.norm(way), None
    for first, last in itertools.combinations(peaks, 2):
        chord = outline[last] - outline[first]
        size, middle = float(np.linalg.norm(chord)), 0.5 * (outline[first] + outline[last]) - end
        slope = np.arcsin(min(1.0, abs(chord @ way) / max(size, 1e-9)))
        off = abs(middle[0] * way[1] - middle[1] * way[0])
        if (
            FACE_LENGTHS[0] * width < size < FACE_LENGTHS[1] * width
            and slope < FACE_TURN and off < FACE_OFFSET * size and middle @ way > -0.5 * width
        ):  # fmt: skip
            score = turned[first] + turned[last] - slope - off / size
            best = max(best or (score, first, last), (score, first, last))
    return None if best is None else (int(best[1]), int(best[2]))


def _guide(outline: Array, factor: float) -> Array:
    """Return a rough centre line (k, 2) in px of an outline (n, 2) that begins and ends at the base: middles of the places
    that are equally far from the base on ways inside of it."""
    inside, small = _filled(outline, factor, 2)
    low = outline[0] - small[0] * factor
    start = np.zeros(inside.shape, dtype=np.uint8)
    first, last = np.rint(small[[0, -1]]).astype(int).tolist()
    cv2.line(start, first, last, 1, 2)
    begin = np.argwhere((start > 0) & inside)
    ways, _ = MCP_Geometric(np.where(inside, 1.0, -1.0)).find_costs([tuple(place) for place in begin.tolist()])
    reached = np.isfinite(ways)
    if reached.sum() < MIN_AREA:
        raise pictures.Unmeasurable("the device is too small in the picture to be measured; move the camera closer")
    row, column = np.nonzero(reached)
    number = (ways[reached] / GUIDE_STEP).astype(int)
    count = np.bincount(number)
    # Farthest from the base may be one corner of the tip, to which no centre line leads.
    across = np.flatnonzero(count >= ACROSS_SHARE * np.median(count[count > 0]))[-1] + 1
    chosen = np.flatnonzero(count[:across])
    middles = np.column_stack([np.bincount(number, along)[chosen] / count[chosen] for along in (column, row)])
    return np.asarray(middles * factor + low)


GUIDE_STEP, ACROSS_SHARE = 4.0, 0.7
"""Step of the rough centre line in px of the reduced picture, and share of the usual width up to which it goes."""


# ----------------------------------------------------------------------------------------------------------------------
# The shape of an outline: centre line, length, tip and angle, in m in the plane of motion.


@dataclasses.dataclass(frozen=True, eq=False)
class Shape:
    """What an outline in m shows.

    Attributes:
        line: The centre line (k, 2) in m, evenly along its length from the base's middle to the tip.
        width: Width of the device across it in m, shape (k,).
        tip: Where the centre line leaves the device, shape (2,), m.
        angle: Direction in rad in which the tip's face looks, from the x axis to z; of a round tip that of the centre line.
        uneven: How far in rad the tip's face may look elsewhere, for a glint, a nick or a bead on it.
        bulges: Whether the tip's face bulges, so that the line between its corners is taken for it.
        base: Middle of the base (2,) in m.
        direction: Direction in rad from the base into the device, across the base.
        is_round: Whether the tip is a half circle about the centre line.
    """

    line: Array
    width: Array
    tip: Array
    angle: float
    uneven: float
    bulges: bool
    base: Array
    direction: float
    is_round: bool

    @functools.cached_property
    def length(self) -> float:
        """Length of the centre line in m."""
        return float(np.linalg.norm(np.diff(self.line, axis=0), axis=1).sum())

    @functools.cached_property
    def curvature(self) -> Array:
        """Curvature of the centre line in 1/m, shape (k,), positive where it turns from x to z."""
        step = self.length / (len(self.line) - 1)
        first, second = np.gradient(self.line, step, axis=0), np.gradient(np.gradient(self.line, step, axis=0), step, axis=0)
        return np.asarray(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])


MAX_TURN = 1.3
"""Angle in rad by which a device bends within its own width."""

STATION_COUNT = 101
"""Points of a centre line."""

KNOT_COUNT = 7
"""Inner knots of the spline through the middles between both sides."""

MAX_ROUNDS = 6
"""Times that the stations' normals follow the line."""

FACE_SHARE = 0.3
"""Half the width of the tip's face, as a share of the device's width there, that tells its direction."""

SAME_WIDTH = 0.05
"""Difference of the widths at two places before the tip, over the width, up to which the device only bends between them."""

MAX_SLANT, UNCLEAR_TIP = 0.2, 0.5
"""Slope of a round tip's middle across the centre line up to which it is round about it, and angle in rad by which a tip
without any face may look elsewhere."""

SAME_TIP = 0.015
"""Distance between the middle of the tip's corners and that of its face, over its size, and angle in rad between their line and
the face, up to which the face is flat and tells both better."""

FLAT_SHARE = 0.012
"""Root mean square distance, as a share of the width, up to which the tip's face is flat."""


def shape_of(
    outline: Array, base: Array, guide: Array, corners: tuple[int, int] | None = None, strip: float = 0.0,
    rounds: int = MAX_ROUNDS,
) -> Shape:  # fmt: skip
    """Return the shape of an outline (n, 2) in m that begins beside one end of the base (2, 2) and ends beside the other, near
    a rough centre line (k, 2) and with corners of its tip at two points, after so many rounds. ``strip`` is the width in m
    at which a face along the line of sight is seen, by which corners are cut off. Raises `Unmeasurable` where no centre
    line joins base and tip."""
    polygon = np.vstack([base[:1], outline, base[1:]])
    middle = base.mean(axis=0)
    line = _resampled(np.vstack([middle, guide[1:]]), STATION_COUNT)
    size = 0.0 if corners is None else float(np.linalg.norm(np.diff(outline[list(corners)], axis=0)))
    try:
        face = None if corners is None else np.array([_corner(outline, k, size, strip / size) for k in corners])
    except pictures.Unmeasurable:
        face = None
    wide = np.full(STATION_COUNT, np.nan)
    for turn in range(rounds):
        line = _extended(line, polygon) if face is None else _led_to(line, face)
        normal = normals(line)
        left, right = (_reach(polygon, line, sign * normal) for sign in (1.0, -1.0))
        wide = left + right
        good = np.isfinite(wide)
        usual = float(np.median(wide[good])) if good.sum() > STATION_COUNT // 3 else np.nan
        length = float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())
        arc = np.linspace(0.0, length, STATION_COUNT)
        good &= (wide < 2.5 * usual) & (arc < length - 0.5 * usual) & (arc > 0.1 * usual)
        if good.sum() < STATION_COUNT // 3:
            raise pictures.Unmeasurable("the outline has no centre line from its base to its tip; check --base and --roi")
        centres = line + (0.5 * (left - right))[:, None] * normal
        if face is not None:
            good[-1], centres[-1] = True, face.mean(axis=0)
        most = int(np.clip(length / usual, 1, KNOT_COUNT))  # more would follow each fold
        inner = int(np.clip(most if turn or rounds < MAX_ROUNDS else min(3, most), 1, good.sum() // 6))
        line = _smooth_line(arc[good], centres[good], middle, length, inner)
    line = _extended(line, polygon) if face is None else _led_to(line, face)
    wide = np.where(np.isfinite(wide), wide, usual)
    bulges = False
    tip, angle, uneven, flat, even = _tip(polygon, line, float(np.median(wide[-STATION_COUNT // 5 : -STATION_COUNT // 12])))
    if face is not None:
        chord, centre = _looks(face, line), face.mean(axis=0)
        off = float(np.linalg.norm(tip - centre)) / size
        bulges = not flat or off > SAME_TIP or abs(np.angle(np.exp(1j * (angle - chord)))) > SAME_TIP
        if bulges or not even:
            tip, angle, uneven = centre, chord, 0.0
    across = base[1] - base[0]
    way = np.array([-across[1], across[0]])
    way = way * np.sign(way @ (line[STATION_COUNT // 8] - middle))
    end = _round_end(outline, line, wide) if face is None and even and not flat else None
    if end is not None:
        tip, angle, uneven, line = end
    line = _resampled(np.vstack([line[:-1], tip]), STATION_COUNT)
    shape = Shape(line, wide, tip, angle, uneven, bulges, middle, float(np.arctan2(way[1], way[0])), end is not None)
    step = int(np.clip(np.median(wide) / shape.length * STATION_COUNT, 1, STATION_COUNT - 1))
    heading = np.unwrap(np.arctan2(*normals(line).T[::-1]))
    if np.abs(heading[step:] - heading[:-step]).max() > MAX_TURN:
        raise pictures.Unmeasurable(
            "the centre line turns within the device's own width, as where it follows folds or a thing beside it; check --base"
        )
    return shape


def _resampled(line: Array, count: int) -> Array:
    arc = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))]
    at = np.linspace(0.0, arc[-1], count)
    return np.column_stack([np.interp(at, arc, line[:, k]) for k in (0, 1)])


def normals(line: Array) -> Array:
    """Return unit vectors (k, 2) across a line (k, 2), to the left of the way along it."""
    way = np.gradient(line, axis=0)
    way = cv2.blur(way, (1, 5), borderType=cv2.BORDER_REPLICATE)
    way /= np.linalg.norm(way, axis=1)[:, None]
    return np.column_stack([-way[:, 1], way[:, 0]])


def _reach(polygon: Array, points: Array, way: Array) -> Array:
    """Return the distances (k,) in m from points (k, 2) along unit vectors (k, 2) to the polygon (n, 2); NaN for none."""
    across = np.column_stack([-way[:, 1], way[:, 0]])
    side = across @ polygon.T - np.einsum("ki,ki->k", across, points)[:, None]
    rows, at = np.nonzero((side[:, :-1] >= 0.0) != (side[:, 1:] >= 0.0))
    share = side[rows, at] / (side[rows, at] - side[rows, at + 1])
    hit = polygon[at] + share[:, None] * (polygon[at + 1] - polygon[at])
    far, nearest = np.einsum("ki,ki->k", hit - points[rows], way[rows]), np.full(len(points), np.inf)
    np.minimum.at(nearest, rows, np.where(far > 0.0, far, np.inf))
    return np.where(np.isfinite(nearest), nearest, np.nan)


def _extended(line: Array, polygon: Array) -> Array:
    """Return the line with its last part replaced by the straight way on to the polygon, resampled."""
    last = len(line) - max(3, len(line) // 14)
    chord = line[last] - line[last - 5]
    way = chord / np.linalg.norm(chord)
    far = _reach(polygon, line[last : last + 1], way[None])[0]
    if not np.isfinite(far):
        raise pictures.Unmeasurable("the outline has no centre line from its base to its tip; check --base and --roi")
    # The bend goes on to the tip as it was before it.
    earlier = line[last - 5] - line[last - 10]
    turn = float(np.arctan2(earlier[0] * way[1] - earlier[1] * way[0], earlier @ way)) / max(np.linalg.norm(earlier), 1e-12)
    steps = np.linspace(0.0, far, 12)[1:]
    angle = np.arctan2(way[1], way[0]) + 0.5 * turn * (np.linalg.norm(chord) + steps)
    bent = line[last] + steps[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    end = bent[-2]
    on = bent[-1] - end
    size = float(np.linalg.norm(on))
    rest = _reach(polygon, (end - 3.0 * on)[None], (on / size)[None])[0]
    tip = end - 3.0 * on + rest * on / size if np.isfinite(rest) else bent[-1]
    return _resampled(np.vstack([line[: last + 1], bent[:-4], tip]), len(line))


def _looks(face: Array, line: Array) -> float:
    """Return the direction in rad across a tip's face (2, 2) in which a line (k, 2) leaves by it."""
    x, z = face[1] - face[0]
    way = np.array([-z, x])
    return float(np.arctan2(*(way * np.sign(way @ (face.mean(axis=0) - line[-len(line) // 5])))[::-1]))


def _led_to(line: Array, face: Array) -> Array:
    """Return the line with what lies near or behind the tip's face (2, 2) replaced by the way to its middle, resampled."""
    tip, angle = face.mean(axis=0), _looks(face, line)
    size = float(np.linalg.norm(face[1] - face[0]))
    offset = line - tip
    near = (offset @ [np.cos(angle), np.sin(angle)] > -0.3 * size) & (np.linalg.norm(offset, axis=1) < size)
    kept = line[: int(np.argmax(near))] if near.any() else line
    return _resampled(np.vstack([kept, tip]), len(line))


def _corner(outline: Array, number: int, width: float, cut: float) -> Array:
    """Return the corner (2,) in m near a point of an outline (n, 2) of a device so wide, where parabolas through both sides of
    it meet, from a share of the width on. Raises `Unmeasurable` where they do not."""
    first = max(CORNER_REACH[0], cut)
    reach = first + CORNER_REACH[1] - CORNER_REACH[0]
    steps = np.linalg.norm(np.diff(outline, axis=0), axis=1)
    piece = np.r_[0, np.cumsum(steps > 4.0 * np.median(steps))]  # folds lie between them
    corner = outline[number]
    for _ in range(4):
        far = np.linalg.norm(outline - corner, axis=1) / width
        sides = []
        for sign in (-1, 1):
            near = (far > first) & (far < reach) & (sign * (np.arange(len(far)) - number) > 0)
            near &= np.abs(np.arange(len(far)) - number) < 4.0 * reach * width / np.median(steps)
            last = near & (far > 1.5 * first)
            near &= piece == piece[last][0 if sign > 0 else -1] if last.any() else True
            if near.sum() < 3:
                raise pictures.Unmeasurable(UNCLEAR_CORNER)
            sides.append(_parabola(sign * far[near], outline[near] - corner))
        at = np.zeros(2)
        for _ in range(6):
            first_end, second_end = (np.polynomial.polynomial.polyval(t, side) for t, side in zip(at, sides, strict=True))
            missed = first_end - second_end
            ways = [np.polynomial.polynomial.polyval(t, side[1:] * [[1.0], [2.0]]) for t, side in zip(at, sides, strict=True)]
            at = at - np.linalg.lstsq(np.column_stack([ways[0], -ways[1]]), missed)[0]
        if np.abs(at).max() > reach:
            raise pictures.Unmeasurable(UNCLEAR_CORNER)
        corner = corner + np.polynomial.polynomial.polyval(at[0], sides[0])
    return np.asarray(corner)


UNCLEAR_CORNER = "the corners of the tip are not clear; use a background that differs more from the device"


def _parabola(at: Array, points: Array) -> Array:
    """Return the coefficients (3, 2) of a parabola through points (n, 2) at numbers (n,), without those that lie far off."""
    near = np.ones(len(at), dtype=bool)
    for _ in range(3):
        fit = np.polynomial.polynomial.polyfit(at[near], points[near], 2 if near.sum() > 9 else 1)
        missed = np.linalg.norm(points - np.polynomial.polynomial.polyval(at, fit).T, axis=1)
        near = missed <= 3.0 * max(float(np.median(missed)), 1e-12)
    return np.pad(fit, ((0, 3 - len(fit)), (0, 0)))


def _smooth_line(arc: Array, centres: Array, start: Array, length: float, inner: int) -> Array:
    knots = np.linspace(arc[0], arc[-1], inner + 2)[1:-1]
    spline = make_lsq_spline(arc, centres, np.r_[[arc[0]] * 4, knots, [arc[-1]] * 4], k=3)
    # One more pass without what lies far off: a slot between two chambers, a hose.
    missed = np.linalg.norm(centres - spline(arc), axis=1)
    weight = np.minimum(1.0, 2.0 * max(robust.deviation(missed), 1e-9) / np.maximum(missed, 1e-12))
    spline = make_lsq_spline(arc, centres, np.r_[[arc[0]] * 4, knots, [arc[-1]] * 4], k=3, w=np.sqrt(weight))
    at = np.linspace(0.0, length, STATION_COUNT)
    shown = spline(np.clip(at, arc[0], arc[-1]))
    for end, beyond in ((arc[0], at < arc[0]), (arc[-1], at > arc[-1])):
        shown[beyond] = spline(end) + (at[beyond] - end)[:, None] * spline(end, 1)
    shown[at < arc[0]] += (start - spline(arc[0]) + arc[0] * spline(arc[0], 1)) * (1.0 - at[at < arc[0]] / arc[0])[:, None]
    return _resampled(shown, STATION_COUNT)


def _tip(polygon: Array, line: Array, width: float) -> tuple[Array, float, float, bool, bool]:
    """Return the tip (2,) in m, the direction in rad that its face looks in, how `Shape.uneven` it is, whether it has a flat
    one, and whether the device is even there: of the same width before a flat face, or round about its centre line."""
    tip, way = line[-1], line[-1] - line[-8]
    way = way / np.linalg.norm(way)
    across = np.array([-way[1], way[0]])
    face, flat, uneven = tip, False, 0.0
    for _ in range(3):
        offset = polygon[1:-1] - face
        near = (np.abs(offset @ across) < FACE_SHARE * width) & (np.abs(offset @ way) < 0.35 * width)
        if near.sum() < 6:
            return tip, float(np.arctan2(way[1], way[0])), UNCLEAR_TIP, False, False
        at, high = offset[near] @ across, offset[near] @ way
        fit = np.polynomial.polynomial.polyfit(at, high, 1)
        missed = high - np.polynomial.polynomial.polyval(at, fit)
        kept = np.abs(missed) <= 3.0 * max(robust.deviation(missed), 1e-9)
        fit = np.polynomial.polynomial.polyfit(at[kept], high[kept], 1)
        missed = high[kept] - np.polynomial.polynomial.polyval(at[kept], fit)
        flat = float(np.sqrt(np.mean(missed**2))) < FLAT_SHARE * width
        if not flat:
            break
        uneven = _uneven(at[kept] / width, missed / width)
        face = face + fit[0] * way
        way = way - fit[1] * across
        way = way / np.linalg.norm(way)
        across = np.array([-way[1], way[0]])
    if not flat:
        way = line[-1] - line[-8]
        slant, is_even = float(abs(np.arctan(fit[1]))), abs(fit[1]) < MAX_SLANT
        return tip, float(np.arctan2(way[1], way[0])), 0.0 if is_even else slant, False, is_even
    # The middle of the face: between both sides a little before it, and twice as far, for a device that is curved there.
    back = face - np.array([[0.15], [0.3]]) * width * way
    left, right = (_reach(polygon, back, np.tile(sign * across, (2, 1))) for sign in (1.0, -1.0))
    wide, middle = left + right, 0.5 * (left - right)
    even = bool(abs(wide[1] - wide[0]) < SAME_WIDTH * width)
    if wide[0] < 1.5 * width:
        face = face + (middle[0] - (middle[1] - middle[0] if even else 0.0) / 3.0) * across
    return face, float(np.arctan2(way[1], way[0])), uneven, True, even and bool(wide[0] < 1.5 * width)


def _round_end(outline: Array, line: Array, wide: Array) -> tuple[Array, float, float, Array] | None:
    """Return the tip (2,), its direction in rad, the error of that, and the centre line (k, 2) in m of a device that ends in a
    half circle, along which the middles between both sides say nothing; None where the end is of another shape."""
    radius = 0.5 * float(np.median(wide[-STATION_COUNT // 5 : -STATION_COUNT // 12]))
    way = line[-1] - line[-8]
    way = way / np.linalg.norm(way)
    centre = line[-1] - radius * way
    for _ in range(4):
        offset = outline - centre
        near = (offset @ way > END_SHARE * radius) & (np.linalg.norm(offset, axis=1) < 1.5 * radius)
        if near.sum() < 8:
            return None
        terms = np.column_stack([2.0 * offset[near], np.ones(near.sum())])
        fit = np.linalg.lstsq(terms, np.sum(offset[near] ** 2, axis=1))[0]
        centre, radius = centre + fit[:2], float(np.sqrt(max(fit[2] + fit[:2] @ fit[:2], 0.0)))
        before = line[np.linalg.norm(line - centre, axis=1) > END_SHARE * radius]
        before = before[(before - centre) @ way < 0.0]
        far = np.linalg.norm(before - centre, axis=1)
        before, far = before[far < END_REACH * radius], far[far < END_REACH * radius]
        if len(before) < 4:
            return None
        # A cubic through the half circle's centre, from which the line goes straight on, and a parabola, for the error.
        way, other = (
            slope / np.linalg.norm(slope)
            for slope in (np.linalg.lstsq(far[:, None] ** np.arange(1, n), centre - before)[0][0] for n in (4, 3))
        )
    missed = np.linalg.norm(outline[near] - centre, axis=1) - radius
    if float(np.sqrt(np.mean(missed**2))) > ROUND_SHARE * radius:
        return None
    tip = centre + radius * way
    kept = line[: int(np.argmax((np.linalg.norm(line - centre, axis=1) < 0.5 * radius) | ((line - centre) @ way > 0.0)))]
    uneven = BEND_SHARE * float(abs(way[0] * other[1] - way[1] * other[0]))
    return tip, float(np.arctan2(way[1], way[0])), uneven, np.vstack([kept, centre, tip])


END_SHARE, END_REACH, ROUND_SHARE, BEND_SHARE = 0.2, 3.0, 0.01, 0.35
"""Distance along the centre line from a half circle's centre from which its outline is fitted, and the line behind it, up to
which distance that tells its direction, and root mean square misfit up to which it is a circle, all in its radii; share of what
a parabola's slope there differs by from a cubic's that is the direction's error."""


def _uneven(at: Array, high: Array) -> float:
    """Return how far in rad a face of n points, shape (n,), may look elsewhere than its line does, from what a parabola through
    it leaves, if that is more than noise leaves of a clean face."""
    if len(at) < 6:
        return 0.0
    left = high - np.polynomial.polynomial.polyval(at, np.polynomial.polynomial.polyfit(at, high, 2))
    rough = float(np.std(left) / np.std(at))
    return rough / np.sqrt(FACE_PIECES) if rough > MIN_ROUGHNESS else 0.0


MIN_ROUGHNESS, FACE_PIECES = np.radians(0.3), 2
"""Slope in rad of what is left of a face above which something is on it, and how many pieces of the face err independently."""
