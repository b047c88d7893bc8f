"""The zero plane, from which heights are counted, and what the shape of an edge above it shows."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from scipy.ndimage import binary_dilation, binary_erosion

from measurement import pictures, robust
from measurement.outline import edge
from measurement.screen.setup import Setup, SetupError
from softmodels.common.arrays import Array, Mask

MAX_TILT = 20.0
"""Largest angle in degrees between the surface and the screen's horizontal."""

STRAIGHT_TOLERANCE = 60e-6
"""Half width in m of the band in which a flat surface's edge must lie."""

MIN_SURFACE_POINTS = 30
CORRELATED_SURFACE_POINTS = 10.0
"""Neighbouring points that err together (dust, ripples of the skin), for the error of the line."""


@dataclasses.dataclass(frozen=True, eq=False)
class ZeroLine:
    """The undeformed surface on the screen, in m.

    Attributes:
        origin: Foot of the screen's origin on it, shape (2,).
        direction: Unit vector along it, to the right, shape (2,).
        centre: x at which it is known best.
        error, slope_error: Standard errors of its height at ``centre``, and of its slope in rad.
        extent: Least and greatest x at which it was seen.
        model_error: Standard error by the model of the edge's shape, shared with the outlines above; see `edge.Traced`.
        tone: How the photograph that shows it stores light, one of `pictures.TONES`; empty without a photograph.
        doubts: What speaks against trusting it, one sentence each.
        sides: The body's sides below it; None where the photograph does not show both.
        level_error: Standard error of all heights above it by a lamp or a body that is not level (see `Bow`), or by a depth
            of the body that its penumbra does not show.
        lift: Distance above it at which a raised body's photograph shows it, because the body is deep along the light.
    """

    origin: Array
    direction: Array
    centre: float = 0.0
    error: float = 0.0
    slope_error: float = 0.0
    extent: tuple[float, float] = (-np.inf, np.inf)
    model_error: float = 0.0
    tone: str = ""
    doubts: tuple[str, ...] = ()
    sides: Sides | None = None
    level_error: float = 0.0
    lift: float = 0.0

    @property
    def normal(self) -> Array:
        """Unit vector that z is counted along, shape (2,)."""
        return np.array([-self.direction[1], self.direction[0]])

    @classmethod
    def through(cls, points: Array) -> ZeroLine:
        """Return the line through two points (2, 2) in m, in any order, taken as exact."""
        first, second = sorted(np.asarray(points, dtype=np.float64).tolist())
        way = np.array(second) - np.array(first)
        if not np.linalg.norm(way) > 0.0:
            raise ValueError("the two points of the zero plane are one and the same")
        direction = way / np.linalg.norm(way)
        origin = np.array(first) - (np.array(first) @ direction) * direction
        return cls(origin, direction)

    @classmethod
    def fit(cls, points: Array, normals: Array, errors: Array) -> ZeroLine:
        """Return the straight upper edge of a shadow by its points (X, Z) in m and unit vectors from shadow to light, shape
        (n, 2), of which only the upper side counts, and errors in m (n,).

        Raises `Unmeasurable` for no upper side, or one that is not straight: the actuator is inflated or is not lying flat.
        """
        level = normals[:, 1] > np.cos(np.radians(MAX_TILT))
        upper = _surface(points, normals, level)
        if upper.sum() < MIN_SURFACE_POINTS:
            raise pictures.Unmeasurable(
                "the shadow has no level upper side as zero of heights; photograph the undeformed body "
                "upright, or give two points of its surface to setup --zero"
            )
        points, errors = points[upper], errors[upper]
        direction, middle = _best_pair(points)
        rest = np.zeros(len(points))
        for _ in range(20):
            normal = np.array([-direction[1], direction[0]])
            rest = (points - middle) @ normal
            scatter = max(robust.deviation(rest), 1e-7)
            weight = 1.0 / (scatter**2 + errors**2) * np.minimum(1.0, 1.5 * scatter / np.maximum(np.abs(rest), 1e-12))
            weight = np.where(np.abs(rest) < max(6.0 * scatter, 1e-5), weight, 0.0)
            middle = weight @ points / weight.sum()
            spread = (points - middle).T @ ((points - middle) * weight[:, None])
            direction = np.linalg.eigh(spread)[1][:, 1]
            direction = direction if direction[0] > 0.0 else -direction
        straight = np.abs(rest) < STRAIGHT_TOLERANCE
        if straight.mean() < 0.8 or scatter > 0.5 * STRAIGHT_TOLERANCE:
            raise pictures.Unmeasurable(
                f"the surface is not straight, so it is not the undeformed one: {1.0 - straight.mean():.0%} of its edge lies "
                f"more than {STRAIGHT_TOLERANCE * 1e6:.0f} um from a line; release the pressure, level body and lamp, exclude "
                "other shadows with setup --roi, or give two points of the surface to setup --zero"
            )
        if abs(direction[1]) > np.sin(np.radians(MAX_TILT)):
            raise pictures.Unmeasurable(
                f"the undeformed surface is inclined by more than {MAX_TILT:.0f} degrees: level the body, or turn the grid "
                "with it"
            )
        along = points[straight] @ direction
        count = max(2.0, straight.sum() / CORRELATED_SURFACE_POINTS)
        typical = float(np.hypot(scatter, np.median(errors)))
        error, slope = typical / np.sqrt(count), typical / (np.sqrt(count) * max(float(along.std()), 1e-6))
        origin = middle - (middle @ direction) * direction
        return cls(origin, direction, float(along.mean()), error, slope, (float(along.min()), float(along.max())))

    def place(self, points: Array) -> Array:
        """Return the points (n, 2) of the screen as x along the surface and z above it, shape (n, 2)."""
        offset = points - self.origin
        return np.column_stack([offset @ self.direction, offset @ self.normal])

    def error_at(self, x: Array) -> Array:
        """Return the standard error in m of the surface's height at x (n,)."""
        return np.hypot(self.error, self.slope_error * (x - self.centre))


SIDE_COSINE, SMALLEST_PIECE = 0.35, 0.25
"""Cosine of the angle between an edge's normal and the screen's vertical from which it is a side, and the share of all level
points that the body's surface has at least."""

SURFACE_BAND, CORNER_SHARE = 250e-6, 0.97
"""Distance in m from the line, and share of the body's radius, within which its edge is looked at for a bow."""

MIN_BOW_ERROR = 1e-6

DEPTH_RATIO = 3.0
"""Mean height of a bow over the lift that the penumbra's shape shows, up to which depth makes both."""

HIDDEN_BOW_RATIO, LAMP_LEVEL_ERROR = 2.0, 0.1
"""Where the body's sides are not in the picture: the true bow over the visible one, and the standard error in degrees by
which the lamp may have been moved, for the body's radius of which at least this much is visible."""


@dataclasses.dataclass(frozen=True)
class Bow:
    """How far the undeformed surface's edge bows up towards its middle, with its error, the body's radius or how much of it
    is visible, and the standard error of all heights that it leaves, in m. The rise is NaN where the surface reaches beyond
    what seem to be the body's sides.

    Light that does not run along the surface of a round body throws the shadow of its rim: the half of an ellipse, whose
    height is the body's radius times the angle between the two. The bulge in the middle is then measured from the rim in
    place of the surface, and seems lower by that height. A body that leans and a lamp above or below the surface do the same.
    """

    rise: float
    error: float
    radius: float
    level_error: float

    @property
    def mean(self) -> float:
        """Mean height in m of the half of an ellipse above its ends."""
        return 0.25 * math.pi * self.rise

    def by_depth(self, lift: float) -> bool:
        """Return whether it is that of a level surface that is deep along the light, whose half light a large lamp and blur
        have lifted so far on the whole, in m."""
        return lift > 0.0 and self.mean < DEPTH_RATIO * lift + 4.0 * self.error

    @classmethod
    def of(cls, line: ZeroLine, placed: Array, upwards: Array) -> Bow | None:
        """Return that of an undeformed surface with its sides by an edge as of `sides_of`; None where too little of it is
        visible."""
        mine = (np.abs(placed[:, 1]) < SURFACE_BAND) & (upwards > np.cos(np.radians(MAX_TILT)))
        mine &= (placed[:, 0] >= line.extent[0]) & (placed[:, 0] <= line.extent[1])
        x, z = placed[mine].T
        middle, half = 0.5 * sum(line.extent), 0.5 * (line.extent[1] - line.extent[0])
        radius = half if line.sides is None else 0.5 * line.sides.width
        away = (x - middle) / radius
        if len(x) < MIN_SURFACE_POINTS:
            return None
        if line.sides is None:
            profile = 1.0 - away**2
        else:
            # At the corners the smoothed edge is round already.
            inner = np.abs(away) < CORNER_SHARE
            if int(inner.sum()) < MIN_SURFACE_POINTS:
                return cls(np.nan, np.nan, radius, 0.0)
            x, z, away = x[inner], z[inner], away[inner]
            profile = np.sqrt(1.0 - away**2)
        terms = np.column_stack([np.ones(len(x)), away, profile])
        fit = robust.robust_fit(terms, z, 8)
        spread = float(np.linalg.inv(terms.T @ terms)[2, 2])
        rise = float(fit.coefficients[2])
        error = float(np.hypot(fit.scatter * np.sqrt(CORRELATED_SURFACE_POINTS * spread), MIN_BOW_ERROR))
        left = float(np.hypot(max(rise, 0.0), error))
        hidden = float(np.hypot(HIDDEN_BOW_RATIO * left, np.radians(LAMP_LEVEL_ERROR) * radius))
        return cls(rise, error, radius, hidden if line.sides is None else left)


def _surface(points: Array, normals: Array, level: Mask) -> Mask:
    """Return which level points (n,) of an edge (n, 2) in m, in order along it, are the body's surface and not what it stands
    on.

    A body on a table has the table's edge on both sides of it, lower, with the body's sides between. So the edge is cut where
    it runs down a side, and the highest piece of some length is the surface, with those that lie on its line.
    """
    steep = normals[:, 1] < SIDE_COSINE
    piece = np.cumsum(np.r_[False, steep[1:] != steep[:-1]])
    sizes = np.bincount(piece[level], minlength=piece[-1] + 1)
    long = np.flatnonzero(sizes >= max(MIN_SURFACE_POINTS, SMALLEST_PIECE * level.sum()))
    if not len(long):
        return level
    heights = [float(np.median(points[level & (piece == number), 1])) for number in long]
    highest = level & (piece == long[int(np.argmax(heights))])
    direction, middle = _best_pair(points[highest])
    off = (points - middle) @ np.array([-direction[1], direction[0]])
    is_level = highest.copy()
    for number in np.flatnonzero(sizes):
        mine = level & (piece == number)
        if np.median(off[mine]) > -STRAIGHT_TOLERANCE:
            is_level |= mine
    return np.asarray(is_level)


def _best_pair(points: Array) -> tuple[Array, Array]:
    """Return the direction and a point of the line through two of the points that most others lie close to."""
    rng = np.random.default_rng(0)  # the same line for the same photograph, always
    pairs = rng.integers(0, len(points), (300, 2))
    way = points[pairs[:, 1]] - points[pairs[:, 0]]
    length = np.linalg.norm(way, axis=1)
    pairs, way, length = pairs[length > 0.0], way[length > 0.0], length[length > 0.0]
    direction = way / length[:, None]
    normal = np.column_stack([-direction[:, 1], direction[:, 0]])
    offset = np.einsum("mi,mni->mn", normal, points[None, :, :] - points[pairs[:, 0]][:, None, :])
    best = int(np.argmax((np.abs(offset) < STRAIGHT_TOLERANCE / 2).sum(axis=1)))
    best_direction = direction[best] if direction[best, 0] > 0.0 else -direction[best]
    return best_direction, points[pairs[best, 0]]


# ----------------------------------------------------------------------------------------------------------------------
# The zero plane: the undeformed surface, from which heights are counted.
#
# Seen from the side it is a straight line on the screen, from the photograph at zero pressure or from two points given in the
# setup. x runs along it from the foot of the screen's origin, z stands on it.
#
# The body's own width below its surface, where no pressure changes it: the scale of each photograph.
#
# A body that comes nearer to the lamp throws a larger shadow, and its bulge seems higher. Its sides tell: their distance is
# measured over the lowest part that the picture shows, nearest to the support and farthest from the bulge.


SIDE_NORMAL_COSINE = 0.35
"""Cosine of the angle between an edge's normal and the surface's up to which the edge is a side of the body."""

MIN_SIDE_DEPTH, SIDE_BAND = 0.3e-3, 2e-3
"""Depth in m below the surface from which a side counts, and the height in m of its lowest part that is taken."""

SIDE_STEP, BULGE_ERRORS = 1e-3, 6.0
"""Height in m of the bands in which sides are looked at for a bulge, and standard errors by which their widths differ then."""

MIN_SIDE_POINTS = 8
"""Points of each side."""

CORRELATED_SIDE_POINTS = 5.0
"""Neighbouring points that err together."""


@dataclasses.dataclass(frozen=True)
class Sides:
    """Both sides of a body as straight lines x = place + lean (z - depth): their distance in m at the depth z, negative,
    how it grows with z, its standard error, and x in m midway between them."""

    depth: float
    width: float
    lean: float
    error: float
    middle: float = 0.0

    def beyond(self, x: Array) -> Array:
        """Return how far in m places x (n,) lie outside of the body, negative inside."""
        return np.abs(x - self.middle) - 0.5 * self.width

    def width_at(self, depth: float) -> float:
        """Return the width in m at another depth nearby."""
        return self.width + self.lean * (depth - self.depth)


def sides_of(placed: Array, upwards: Array, error: Array, band: tuple[float, float] | None = None) -> Sides | None:
    """Return the body's sides in a photograph; None where it does not show both. The edge (n, 2) is x along the surface
    and z above it in m, with the cosines of the angles between the way to the light and the surface's normal, and its
    errors in m, shape (n,). The ``band`` of heights z is the lowest one that both sides show unless given."""
    steep = (np.abs(upwards) < SIDE_NORMAL_COSINE) & (placed[:, 1] < -MIN_SIDE_DEPTH)
    if steep.sum() < 2 * MIN_SIDE_POINTS:
        return None
    # Smoothing rounds the corner between surface and side, over half a span of points on either side of it.
    clear = steep & binary_erosion(np.abs(upwards) < SIDE_NORMAL_COSINE, np.ones(edge.SMOOTHING_POINTS + 1), border_value=1)
    steep = clear if clear.sum() >= 4 * MIN_SIDE_POINTS else steep
    middle = 0.5 * (placed[steep, 0].min() + placed[steep, 0].max())
    halves = [steep & (placed[:, 0] < middle), steep & (placed[:, 0] > middle)]
    if min(half.sum() for half in halves) < MIN_SIDE_POINTS:
        return None
    lowest = max(float(placed[half, 1].min()) for half in halves)
    bottom, top = band or (lowest, min(lowest + SIDE_BAND, -MIN_SIDE_DEPTH))
    depth = 0.5 * (bottom + top)
    lines, variance = [], 0.0
    for half in halves:
        part = half & (placed[:, 1] >= bottom) & (placed[:, 1] <= top)
        if part.sum() < MIN_SIDE_POINTS:
            return None
        terms = np.column_stack([np.ones(int(part.sum())), placed[part, 1] - depth])
        line = robust.robust_fit(terms, placed[part, 0], 6)
        variance += (
            (robust.deviation(line.rest) ** 2 + float(np.median(error[part])) ** 2) * CORRELATED_SIDE_POINTS / float(part.sum())
        )
        lines.append(line.coefficients)
    width, lean = lines[1] - lines[0]
    middle = 0.5 * float(lines[0][0] + lines[1][0])
    return Sides(depth, float(width), float(lean), float(np.sqrt(variance)), middle)


# ----------------------------------------------------------------------------------------------------------------------
# The body's known width as the unit of length.


OTHER_BODY = 0.5
"""Share of its width by which a body's shadow may be larger or smaller."""

MAX_WIDTH_ERRORS = 4.0
"""Standard errors by which the body's width and the setup's own scale may differ."""


def with_known_body(setup: Setup, zero: ZeroLine, width: float, error: float = 0.0) -> Setup:
    """Return the setup with the magnification that gives the body at zero pressure its known width and error in m.

    Raises `SetupError` where the sides are not in the picture, or the width is another body's.
    """
    if zero.sides is None:
        raise SetupError(
            "the photograph at zero pressure does not show both sides of the body below its surface, so its width is "
            "unknown; leave out --body-width, or give the setup --lamp-distance and --screen-distance"
        )
    scale = zero.sides.width / width
    if abs(scale - 1.0) > OTHER_BODY:
        raise SetupError(
            f"the body seems {zero.sides.width * 1e3:.4g} mm wide, but --body-width is {width * 1e3:.4g} mm: this is another "
            "body or another unit, or the setup's magnification is far off"
        )
    # The model of the edge's shape moves both sides outwards, or both inwards.
    spread = math.hypot(error / width, zero.sides.error / zero.sides.width, 2.0 * zero.model_error / zero.sides.width)
    if setup.magnification_error > 0.0 and abs(scale - 1.0) > MAX_WIDTH_ERRORS * math.hypot(spread, setup.scale_error):
        raise SetupError(
            f"the body seems {zero.sides.width * 1e3:.4g} mm wide by the grid's pitch and the lamp's distance, where "
            f"--body-width has {width * 1e3:.4g} mm: they differ by {scale - 1.0:+.2%} and are known to "
            f"{math.hypot(spread, setup.scale_error):.2%}; measure the pitch over many lines, the distances and the width again"
        )
    magnified = setup.magnification * scale
    # The width is the unit of length now: a wrong pitch is in the magnification.
    return dataclasses.replace(setup, magnification=magnified, magnification_error=magnified * spread, pitch_error=0.0)


# ----------------------------------------------------------------------------------------------------------------------
# What the shape of an edge above the zero plane shows of it: where it lies, how it turns, its bumps and its gaps.
#
# An edge can be found to a hundredth of a pixel and still be something else's: a hair on the membrane, a finger before the
# lamp, a drop, a glint that eats into the shadow, or the right actuator in another place. What distinguishes them is known of
# every inflated surface: beside the bulge it lies where it lay at zero pressure or a little lower, and above it the membrane
# bends alike from one place to the next. A corner there belongs to a second thing. `series.checks` judges by these numbers.


ON_SURFACE = 50e-6
"""Distance in m within which an edge counts as the surface itself."""

MIN_COSINE = 0.94
"""Cosine of the steepest angle at which an edge may be the surface beside the bulge."""

END_SHARE = 0.12
"""Share of the surface's length at each of its ends that stays where it was, however high the middle rises."""

MIN_END_DISTANCE = 10e-6
"""Distance in m of those ends from the zero plane up to which they show nothing."""

MAX_SINK_SHARE = 0.25
"""Share of the height by which a soft body's surface may sink beside its bulge; thick disks have an eighth."""

MAX_SIDE_COSINE = 0.5
"""Cosine of the angle to the surface from which an edge is the body's side."""

DIRECTION_WINDOW, DIRECTION_WINDOW_SHARE = 0.8e-3, 0.04
"""Length of edge on each side of a place over which its direction is taken: in m at most, and as a share of the bulge's
width; `FEWEST_STATIONS` at least."""

FEWEST_STATIONS = 4


@dataclasses.dataclass(frozen=True)
class Displacement:
    """How far the surface beside the bulge lies from the zero plane, in m.

    A soft body that bulges takes the rubber beside the bulge inwards, so that its surface may sink there by a share of the
    height. That much is no mistake as long as the other photographs of the run agree.

    Attributes:
        off: By which it lies off where no soft body does, negative below.
        tolerance: Up to which that is the edge's own error.
        aslant: Half of what one end lies lower than the other; 0 where that cannot be told from none.
        sunk: How far it has sunk where a soft body may, negative if it has risen, 0 within the measurement's own error.
    """

    off: float
    tolerance: float
    aslant: float
    sunk: float

    @classmethod
    def of(cls, placed: Array, upwards: Array, error: Array, zero: ZeroLine) -> Displacement | None:
        """Return that of an edge as of `sides_of`, in order along it; None where it lies beside the surface of the zero
        photograph."""
        seen = (placed[:, 0] >= zero.extent[0]) & (placed[:, 0] <= zero.extent[1])
        if not seen.any():
            return None
        low, high = placed[seen, 0].min(), placed[seen, 0].max()
        reach = END_SHARE * (high - low)
        sinks = MAX_SINK_SHARE * max(0.0, float(placed[:, 1].max()))
        worst, tolerance, sunk = 0.0, 0.0, 0.0
        # Where the surface's end is hidden or masked, the last visible point is the bulge's foot.
        hidden = low - zero.extent[0] > reach, zero.extent[1] - high > reach
        ends = placed[:, 0] <= low + reach, placed[:, 0] >= high - reach
        for end in (end for end, gone in zip(ends, hidden, strict=True) if not (gone and np.isfinite(zero.extent).all())):
            # Steep points are the body's sides or a bulge as wide as the picture; they do not lie on the surface anyway.
            mine = seen & end & (upwards > MIN_COSINE)
            if mine.sum() < 5:
                continue
            off, own = float(np.median(placed[mine, 1])), 4.0 * float(np.median(error[mine]))
            if -sinks <= off < -max(MIN_END_DISTANCE, own):
                sunk = max(sunk, -off)
            elif abs(off) > abs(worst):
                worst, tolerance = off, own
        if abs(worst) > max(MIN_END_DISTANCE, tolerance) and not sunk:
            # No pressure lifts the surface; a soft body that was lifted sinks back as it rises, and its run shows both.
            sunk = -max(worst, 0.0)
        return cls(worst, tolerance, aslant(placed[seen], upwards[seen], error[seen], zero), sunk)

    @property
    def seen(self) -> bool:
        """Whether it lies off at all, beyond the edge's own error."""
        return abs(self.off) > max(MIN_END_DISTANCE, self.tolerance)

    @property
    def error(self) -> float:
        """Distance in m by which the outline may lie off."""
        return max(abs(self.off), self.aslant) if self.seen else self.aslant


def aslant(placed: Array, upwards: Array, error: Array, zero: ZeroLine) -> float:
    """Return half of what one end of the surface lies lower than the other in m; 0 where that cannot be told from none. The
    edge is as of `sides_of`, as far as the zero was seen; without the body's sides its middle is unknown.

    A body sinks alike at both of its sides, and by any depth, so that only their difference shows one that was tilted. About
    which of its points is not known, and so by how much its middle was lifted: by no more than its ends.
    """
    if zero.sides is None:
        return 0.0
    half = 0.5 * (zero.extent[1] - zero.extent[0])
    away = placed[:, 0] - 0.5 * (zero.extent[0] + zero.extent[1])
    end = (upwards > MIN_COSINE) & (np.abs(away) > (1.0 - 2.0 * END_SHARE) * half)
    left, right = (np.flatnonzero(end & (side * away > 0.0)) for side in (-1.0, 1.0))
    if min(len(left), len(right)) < 5:
        return 0.0
    left = left[np.argsort(-away[left])]
    right = right[(away[right] >= -away[left[0]]) & (away[right] <= -away[left[-1]])]
    if len(right) < 5:
        return 0.0
    lower = float(np.median(placed[right, 1] - np.interp(away[right], -away[left], placed[left, 1])))
    own = 4.0 * float(np.median(error[np.r_[left, right]]))
    return 0.5 * abs(lower) if abs(lower) > max(MIN_END_DISTANCE, own) else 0.0


def scale_of(placed: Array, upwards: Array, error: Array, bridged: Mask, zero: ZeroLine) -> tuple[float, float]:
    """Return the body's width over that at zero pressure, NaN where it is not seen, and the heights' relative error by it.

    A body that was moved along the light is larger or smaller at all depths alike. Sides that give way bulge, more at one depth
    than at another: then the depth where they have given way least shows how far the body itself may have moved.
    """
    edge = placed[~bridged], upwards[~bridged], error[~bridged]
    sides, own_sides = sides_of(*edge), zero.sides
    if sides is None or own_sides is None or abs(sides.depth - own_sides.depth) > SIDE_BAND:
        return np.nan, 0.0
    scale = sides.width_at(own_sides.depth) / own_sides.width
    own = float(np.hypot(sides.error, own_sides.error)) / own_sides.width
    bands = np.arange(sides.depth - 0.5 * SIDE_BAND, -MIN_SIDE_DEPTH - SIDE_STEP, SIDE_STEP)
    parts = [part for low in bands if (part := sides_of(*edge, (low, low + SIDE_STEP))) is not None]
    ratios = np.array([part.width / own_sides.width_at(part.depth) for part in parts])
    if len(ratios) > 1 and np.ptp(ratios) > BULGE_ERRORS * max(own, *(part.error / own_sides.width for part in parts)):
        least = int(np.argmin(np.abs(ratios - 1.0)))
        scale, own = float(ratios[least]), float(np.hypot(parts[least].error, own_sides.error)) / own_sides.width
    if zero.lift and abs(scale - 1.0) < 2.0 * own:
        scale = 1.0  # a deep body's sides are known no better than its lift, which all photographs of a run share
    return scale, float(np.sqrt(max(0.0, (scale - 1.0) ** 2 - (2.0 * own) ** 2)))


def rounded(placed: Array, upwards: Array) -> Mask:
    """Return the points (n,) of the surface so near to the body's side that smoothing has rounded the corner between the
    two."""
    side = (upwards < MAX_SIDE_COSINE).astype(np.uint8)
    near = np.convolve(side, np.ones(edge.SMOOTHING_POINTS + 5, dtype=np.uint8), mode="same") > 0
    return near & (np.abs(placed[:, 1]) < 3.0 * ON_SURFACE)


def sharpest_turn(placed: Array) -> tuple[int, float]:
    """Return where the edge turns most beyond its neighbourhood, and by how many degrees; 0 where no turn stands out. Only
    turns above the surface count: where a membrane is clamped it may leave the surface at any angle."""
    step = np.linalg.norm(np.diff(placed, axis=0), axis=1)
    arc = np.r_[0.0, np.cumsum(step)]
    raised = placed[placed[:, 1] >= 0.1 * max(placed[:, 1].max(), 0.0), 0]
    if not len(raised):
        return 0, 0.0
    window = max(
        min(DIRECTION_WINDOW, DIRECTION_WINDOW_SHARE * float(np.ptp(raised))), FEWEST_STATIONS * float(np.median(step))
    )
    turn = _turning_angles(placed, arc, window)
    known = np.isfinite(turn)
    if known.sum() < 5 * FEWEST_STATIONS:
        return 0, 0.0
    near, far = (
        [np.interp(arc + side * reach, arc[known], turn[known]) for side in (-1.0, 1.0)]
        for reach in (2.0 * window, 3.0 * window)
    )
    # A parabola through the neighbours tells the turn at a smooth top, where it is greatest.
    smooth = (9.0 * (near[0] + near[1]) - 4.0 * (far[0] + far[1])) / 10.0
    beyond = np.zeros(len(arc))
    for beside in (near, far):
        low, high = np.minimum.reduce([*beside, smooth]), np.maximum.reduce([*beside, smooth])
        beyond = np.maximum(beyond, np.where(known, np.maximum(turn - high, low - turn), 0.0))
    free = known & ~_places_near(arc, np.abs(placed[:, 1]) < 2.0 * ON_SURFACE, window) & (placed[:, 1] > 0.0)
    # One bad point is no corner: the turn must stand over several places.
    lasting = np.min(np.lib.stride_tricks.sliding_window_view(np.pad(beyond * free, 1), 3), axis=1)
    noise = robust.deviation(beyond[known])
    place = int(np.argmax(lasting))
    turned = float(np.degrees(lasting[place]))
    return place, turned if turned > 6.0 * np.degrees(noise) else 0.0


def _turning_angles(placed: Array, arc: Array, window: float) -> Array:
    """Return the angle (n,) in rad between straight lines through the edge within a window behind and before each place."""
    # Counted in points and not in length: where an edge is unclear its points are missing, and it may turn just there.
    count = round(window / float(np.median(np.diff(arc)))) + 1
    here = np.arange(len(arc))
    behind, ahead = np.maximum(here - count + 1, 0), np.minimum(here + count, len(arc))
    directions = []
    for first, last in ((behind, here + 1), (here, ahead)):
        size = (last - first).astype(float)
        sums = [
            np.r_[0.0, np.cumsum(values)][last] - np.r_[0.0, np.cumsum(values)][first]
            for values in (arc, placed[:, 0], placed[:, 1], arc * placed[:, 0], arc * placed[:, 1])
        ]
        slopes = [sums[3 + axis] - sums[0] * sums[1 + axis] / size for axis in (0, 1)]
        directions.append(np.where(size > 0.7 * count, np.arctan2(slopes[1], slopes[0]), np.nan))
    return np.asarray((directions[1] - directions[0] + np.pi) % (2.0 * np.pi) - np.pi)


def _places_near(arc: Array, chosen: Mask, reach: float) -> Mask:
    """Return the places (n,) along the edge within reach of a chosen one."""
    at = arc[chosen]
    if not len(at):
        return np.zeros(len(arc), dtype=bool)
    index = np.searchsorted(at, arc)
    before, after = at[np.clip(index - 1, 0, len(at) - 1)], at[np.clip(index, 0, len(at) - 1)]
    return np.asarray(np.minimum(np.abs(arc - before), np.abs(arc - after)) < reach)


# ----------------------------------------------------------------------------------------------------------------------
# Bumps and steps in an outline that are narrower than a membrane can bend.
#
# A fibre that lies along the top, a grain, a drop on the lens or a bulge of the screen lift a part of the edge by some tens of
# micrometres: too little for a corner, and each point of it is as clear as the others. But an inflated membrane is smooth over
# millimetres. So the edge averaged over half a millimetre must lie where a polynomial through a few millimetres of it lies.


AVERAGED_LENGTH, POLYNOMIAL_LENGTH = 0.5e-3, 4e-3
"""Lengths in m of edge that are averaged, and over which a membrane is a polynomial of the fifth degree, to a micrometre."""

FAR_SHARE = 0.22
"""The latter as a share of the bulge's width, if that is less."""

SHORT_AVERAGE_POINTS = 7
"""Points in the short average, and twice as many in the long one, for the two to differ."""


def highest_ripple(placed: Array) -> tuple[int, float, float]:
    """Return the index of the point where the edge lies farthest off its neighbourhood, how far in m, and the usual
    distance in m. Only what rises counts: where a membrane is clamped, or a body ends, the edge may turn at any angle."""
    step = np.linalg.norm(np.diff(placed, axis=0), axis=1)
    arc, spacing = np.r_[0.0, np.cumsum(step)], float(np.median(step))
    raised = placed[placed[:, 1] >= 0.1 * max(placed[:, 1].max(), 0.0), 0]
    if not len(raised):
        return 0, 0.0, 0.0
    far = _odd_sides(min(POLYNOMIAL_LENGTH, FAR_SHARE * float(np.ptp(raised))) / spacing)
    near = max(SHORT_AVERAGE_POINTS, _odd_sides(min(AVERAGED_LENGTH / spacing, 0.3 * far)))
    if far < 2 * near:
        return 0, 0.0, 0.0
    at = np.arange(0.0, arc[-1], spacing)
    line = np.column_stack([np.interp(at, arc, placed[:, axis]) for axis in (0, 1)])
    if len(at) < 2 * far:
        return 0, 0.0, 0.0
    smooth = edge.local_polynomial(line, far, 5)
    along = np.gradient(smooth, axis=0)
    across = np.column_stack([-along[:, 1], along[:, 0]]) / np.maximum(np.linalg.norm(along, axis=1), 1e-12)[:, None]
    off = np.einsum("ni,ni->n", edge.local_polynomial(line, near, 2) - smooth, across)
    off *= np.sign(float(np.sum(along[:, 0])))  # an edge that runs to the left has its normals downwards
    clamped = binary_dilation(line[:, 1] < 2.0 * ON_SURFACE, np.ones(far | 1))
    clamped[: far // 2] = clamped[-(far // 2) :] = True
    if np.count_nonzero(~clamped) < 2 * far:
        return 0, 0.0, 0.0
    scatter = robust.deviation(off[~clamped])
    worst = int(np.argmax(np.abs(off) * ~clamped))
    return int(np.argmin(np.abs(arc - at[worst]))), float(off[worst]), scatter


def _odd_sides(count: float) -> int:
    return max(3, round(count)) // 2 * 2 + 1
