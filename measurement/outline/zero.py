"""The zero plane: the undeformed surface, from which heights are counted.

Seen from the side it is a straight line on the screen, from the photograph at zero pressure or from two points given in the
setup. x runs along it from the foot of the screen's origin, z stands on it.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import numpy.typing as npt
from scipy.ndimage import binary_erosion

from measurement.camera.pictures import Unmeasurable
from measurement.edge.edge import SPAN
from measurement.robust import deviation, robust_fit
from measurement.screen.setup import Setup, SetupError
from softmodels.common.arrays import Array

# ----------------------------------------------------------------------------------------------------------------------
# The body's own width below its surface, where no pressure changes it: the scale of each photograph.
#
# A body that comes nearer to the lamp throws a larger shadow, and its bulge seems higher. Its sides tell: their distance is
# measured over the lowest part that the picture shows, nearest to the support and farthest from the bulge.


SIDE_NORMAL_COSINE = 0.35
"""Cosine of the angle between an edge's normal and the surface's up to which the edge is a side of the body."""

DEPTH, SIDE_BAND = 0.3e-3, 2e-3
"""Depth in m below the surface from which a side counts, and the height in m of its lowest part that is taken."""

MIN_SIDE_POINTS = 8
"""Points of each side."""

CORRELATED_SIDE_POINTS = 5.0
"""Neighbouring points that err together."""


@dataclasses.dataclass(frozen=True)
class Sides:
    """Both sides of a body as straight lines x = place + lean (z - depth).

    Attributes:
        depth: z in m at which the width is taken; negative.
        width: Distance of the sides there in m.
        lean: How the width grows with z.
        error: Standard error of the width in m.
    """

    depth: float
    width: float
    lean: float
    error: float

    def width_at(self, depth: float) -> float:
        """Return the width in m at another depth nearby."""
        return self.width + self.lean * (depth - self.depth)


def sides_of(placed: Array, upwards: Array, error: Array) -> Sides | None:
    """Return the body's sides in one photograph; None where it does not show both.

    Args:
        placed: Measured edge as x along the surface and z above it in m, shape (n, 2).
        upwards: Cosine of the angle between the way to the light and the surface's normal, shape (n,).
        error: Standard errors in m, shape (n,).
    """
    steep = (np.abs(upwards) < SIDE_NORMAL_COSINE) & (placed[:, 1] < -DEPTH)
    if steep.sum() < 2 * MIN_SIDE_POINTS:
        return None
    # Smoothing rounds the corner between surface and side, over half a span of points on either side of it.
    clear = steep & binary_erosion(np.abs(upwards) < SIDE_NORMAL_COSINE, np.ones(SPAN + 1), border_value=1)
    steep = clear if clear.sum() >= 4 * MIN_SIDE_POINTS else steep
    middle = 0.5 * (placed[steep, 0].min() + placed[steep, 0].max())
    halves = [steep & (placed[:, 0] < middle), steep & (placed[:, 0] > middle)]
    if min(half.sum() for half in halves) < MIN_SIDE_POINTS:
        return None
    bottom = max(float(placed[half, 1].min()) for half in halves)
    top = min(bottom + SIDE_BAND, -DEPTH)
    depth = 0.5 * (bottom + top)
    lines, variance = [], 0.0
    for half in halves:
        part = half & (placed[:, 1] >= bottom) & (placed[:, 1] <= top)
        if part.sum() < MIN_SIDE_POINTS:
            return None
        terms = np.column_stack([np.ones(int(part.sum())), placed[part, 1] - depth])
        line = robust_fit(terms, placed[part, 0], 6)
        variance += (
            (deviation(line.rest) ** 2 + float(np.median(error[part])) ** 2)
            * CORRELATED_SIDE_POINTS
            / float(part.sum())
        )
        lines.append(line.coefficients)
    width, lean = lines[1] - lines[0]
    return Sides(depth, float(width), float(lean), float(np.sqrt(variance)))


Mask = npt.NDArray[np.bool_]

STEEPEST = 20.0
"""Largest angle in degrees between the surface and the screen's horizontal."""

STRAIGHT = 60e-6
"""Half width in m of the band in which a flat surface's edge must lie."""

MIN_SURFACE_POINTS = 30

SIDE_COSINE, SMALLEST_PIECE = 0.35, 0.25
"""Cosine of the angle between an edge's normal and the screen's vertical from which it is a side, and the share of all level
points that the body's surface has at least."""

SURFACE_BAND, CORNERS = 250e-6, 0.97
"""Distance in m from the line, and share of the body's radius, within which its edge is looked at for a bow."""

FINEST = 1e-6
"""Least error of a bow in m."""

HIDDEN, LEVEL = 2.0, 0.1
"""Where the body's sides are not in the picture: the true bow over the visible one, and the standard error in degrees by
which the lamp may have been moved, for the body's radius of which at least this much is visible."""

CORRELATED_SURFACE_POINTS = 10.0
"""Neighbouring points that err together (dust, ripples of the skin), for the error of the line."""


@dataclasses.dataclass(frozen=True, eq=False)
class ZeroLine:
    """The undeformed surface on the screen.

    Attributes:
        origin: Foot of the screen's origin on it in m, shape (2,).
        direction: Unit vector along it, to the right, shape (2,).
        centre: x at which it is known best, in m.
        error: Standard error of its height at ``centre`` in m.
        slope_error: Standard error of its slope in rad.
        extent: Least and greatest x at which it was seen, in m.
        model_error: Standard error in m by the model of the edge's shape, shared with the outlines above; see `tracing.Traced`.
        tone: How the photograph that shows it stores light, one of `pixels.TONES`; empty without a photograph.
        doubts: What speaks against trusting it, one sentence each.
        sides: The body's sides below it; None where the photograph does not show both.
        level_error: Standard error in m of all heights above it by a lamp or a body that is not level (see `Bow`), or by a
            depth of the body that its penumbra does not show.
        lift: Distance in m above it at which an edge on it is found, because the body is deep along the light; see
            `edge.profiles`.
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
        """Return the straight upper edge of a shadow.

        Args:
            points: Edge in m (X, Z), shape (n, 2).
            normals: Unit vectors from shadow to light on the screen, shape (n, 2); only the upper side counts.
            errors: Standard errors in m, shape (n,).

        Raises:
            Unmeasurable: No upper side, or one that is not straight: the actuator is inflated or is not lying flat.
        """
        level = normals[:, 1] > np.cos(np.radians(STEEPEST))
        upper = _surface(points, normals, level)
        if upper.sum() < MIN_SURFACE_POINTS:
            raise Unmeasurable(
                "the shadow has no level upper side as zero of heights; photograph the undeformed body "
                "upright, or give two points of its surface to setup --zero"
            )
        points, errors = points[upper], errors[upper]
        direction, middle = _best_pair(points)
        rest = np.zeros(len(points))
        for _ in range(20):
            normal = np.array([-direction[1], direction[0]])
            rest = (points - middle) @ normal
            scatter = max(deviation(rest), 1e-7)
            weight = 1.0 / (scatter**2 + errors**2) * np.minimum(1.0, 1.5 * scatter / np.maximum(np.abs(rest), 1e-12))
            weight = np.where(np.abs(rest) < max(6.0 * scatter, 1e-5), weight, 0.0)
            middle = weight @ points / weight.sum()
            spread = (points - middle).T @ ((points - middle) * weight[:, None])
            direction = np.linalg.eigh(spread)[1][:, 1]
            direction = direction if direction[0] > 0.0 else -direction
        straight = np.abs(rest) < STRAIGHT
        if straight.mean() < 0.8 or scatter > 0.5 * STRAIGHT:
            raise Unmeasurable(
                "the surface is not straight, so it is not the undeformed one: "
                f"{1.0 - straight.mean():.0%} of its edge lies more than {STRAIGHT * 1e6:.0f} um from a line; release "
                f"the pressure, level body and lamp, exclude other shadows with setup --roi, or give two points "
                "of the surface to setup --zero"
            )
        if abs(direction[1]) > np.sin(np.radians(STEEPEST)):
            raise Unmeasurable(
                f"the undeformed surface is inclined by more than {STEEPEST:.0f} degrees: level the body, or turn the grid "
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


@dataclasses.dataclass(frozen=True)
class Bow:
    """How far the undeformed surface's edge bows up towards its middle.

    Light that does not run along the surface of a round body throws the shadow of its rim: the half of an ellipse, whose
    height is the body's radius times the angle between the two. The bulge in the middle is then measured from the rim in place
    of the surface, and seems lower by that height. A body that leans and a lamp above or below the surface do the same.

    Attributes:
        rise: Its height in m; NaN where the surface reaches beyond what seem to be the body's sides.
        error: Its standard error in m.
        radius: The body's in m, or how much of it is visible.
        level_error: Standard error in m of all heights that it leaves.
    """

    rise: float
    error: float
    radius: float
    level_error: float

    @classmethod
    def of(cls, line: ZeroLine, placed: Array, upwards: Array) -> Bow | None:
        """Return that of an undeformed surface; None where too little of it is visible.

        Args:
            line: The undeformed surface, with the body's sides.
            placed: Measured edge as x along the surface and z above it in m, shape (n, 2).
            upwards: Cosine of the angle between the way to the light and the surface's normal, shape (n,).
        """
        mine = (np.abs(placed[:, 1]) < SURFACE_BAND) & (upwards > np.cos(np.radians(STEEPEST)))
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
            inner = np.abs(away) < CORNERS
            if int(inner.sum()) < MIN_SURFACE_POINTS:
                return cls(np.nan, np.nan, radius, 0.0)
            x, z, away = x[inner], z[inner], away[inner]
            profile = np.sqrt(1.0 - away**2)
        terms = np.column_stack([np.ones(len(x)), away, profile])
        fit = robust_fit(terms, z, 8)
        spread = float(np.linalg.inv(terms.T @ terms)[2, 2])
        rise = float(fit.coefficients[2])
        error = float(np.hypot(fit.scatter * np.sqrt(CORRELATED_SURFACE_POINTS * spread), FINEST))
        left = float(np.hypot(max(rise, 0.0), error))
        hidden = float(np.hypot(HIDDEN * left, np.radians(LEVEL) * radius))
        return cls(rise, error, radius, hidden if line.sides is None else left)


def _surface(points: Array, normals: Array, level: Mask) -> Mask:
    """Return which level points (n,) are the body's surface and not what it stands on.

    A body on a table has the table's edge on both sides of it, lower, with the body's sides between. So the edge is cut where
    it runs down a side, and the highest piece of some length is the surface, with those that lie on its line.

    Args:
        points: Edge in m, in order along it, shape (n, 2).
        normals: As of `ZeroLine.fit`.
        level: Which points lie on a level edge, shape (n,).
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
    found = highest.copy()
    for number in np.flatnonzero(sizes):
        mine = level & (piece == number)
        if np.median(off[mine]) > -STRAIGHT:
            found |= mine
    return np.asarray(found)


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
    best = int(np.argmax((np.abs(offset) < STRAIGHT / 2).sum(axis=1)))
    found = direction[best] if direction[best, 0] > 0.0 else -direction[best]
    return found, points[pairs[best, 0]]


# ----------------------------------------------------------------------------------------------------------------------
# The body's known width as the unit of length.


OTHER_BODY = 0.5
"""Share of its width by which a body's shadow may be larger or smaller."""

CONTRADICTS = 4.0
"""Standard errors by which the body's width and the setup's own scale may differ."""


def with_known_body(setup: Setup, zero: ZeroLine, width: float, error: float = 0.0) -> Setup:
    """Return the setup with the magnification that gives the body at zero pressure its known width.

    Args:
        setup: Camera and screen.
        zero: The undeformed surface and the body's sides below it, as this setup has them.
        width: True width of the body in m.
        error: Its standard error in m.

    Raises:
        SetupError: The sides are not in the picture, or the width is another body's.
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
    if setup.magnification_error > 0.0 and abs(scale - 1.0) > CONTRADICTS * math.hypot(spread, setup.scale_error):
        raise SetupError(
            f"the body seems {zero.sides.width * 1e3:.4g} mm wide by the grid's pitch and the lamp's distance, where "
            f"--body-width has {width * 1e3:.4g} mm: they differ by {scale - 1.0:+.2%} and are known to "
            f"{math.hypot(spread, setup.scale_error):.2%}; measure the pitch over many lines, the distances and the width again"
        )
    magnified = setup.magnification * scale
    # The width is the unit of length now: a wrong pitch is in the magnification.
    return dataclasses.replace(setup, magnification=magnified, magnification_error=magnified * spread, pitch_error=0.0)
