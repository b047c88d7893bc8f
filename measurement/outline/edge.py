"""The edge of the shadow between the pixels of the raw photograph.

Across the edge the light falls from the lit screen's through the penumbra to the shadow's. At many stations along a coarse
contour a profile across it, averaged over the station's length, gets a step by least squares: middle, width, both levels and
the fall of the lit screen's light. The step is an error function first, and then has the shape that all profiles of the
photograph have in common (`profiles`). Its middle is where half of the lamp is visible. Levels that belong to each profile
make uneven light harmless, and the light is divided by what the grid's ink lets through before.

Photographs are not warped or resampled for this; only the profiles' few samples lie between pixels.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools

import cv2
import numpy as np
import numpy.typing as npt
from scipy.ndimage import binary_propagation, correlate1d, median_filter
from scipy.optimize import least_squares
from skimage.measure import find_contours
from skmisc.loess import loess

from measurement import pictures, robust
from measurement.outline.profiles import (
    CoarseShadow,
    EdgeShape,
    Ink,
    ProfileFit,
    Profiles,
    Shading,
    StoredLight,
    common_shape,
    find_shadow,
    fit_profiles,
    gaussian,
    stations,
    touched_by_thread,
)
from measurement.screen.look import Flatness, GridLook, View, flatness, look_at_grid, movement
from measurement.screen.setup import Setup
from softmodels.common.arrays import Array, Mask


@dataclasses.dataclass(frozen=True, eq=False)
class Edge:
    """An edge in pixels: points in order along it and unit vectors across it from shadow to light, shape (n, 2); by point,
    shape (n,), the standard error along the normal and the standard deviation of penumbra and blur in px, and the share of
    the local light that the shadow takes away. ``shape`` is what the profiles across it have in common; ``by_ink`` (n,) is the
    part of the error by the grid's ink, which neighbours share, None without any."""

    px: Array
    normal: Array
    error: Array
    width: Array
    contrast: Array
    shape: EdgeShape = dataclasses.field(default_factory=gaussian)
    by_ink: Array | None = None

    def __getitem__(self, chosen: Mask | npt.NDArray[np.intp]) -> Edge:
        names = ("px", "normal", "error", "width", "contrast", *(() if self.by_ink is None else ("by_ink",)))
        return dataclasses.replace(self, **{name: getattr(self, name)[chosen] for name in names})


MOST_STATIONS = 1200
"""Stations along an edge; at 10 um per pixel they lie some 50 um apart."""

INTERPOLATION_NOISE = 1.5
"""Values between pixels scatter less than the pixels: bilinear weights leave 2/3 of the variance on average."""

LARGEST_RESIDUAL_RATIO = 4.0
"""Residual of a profile over the usual one from which something lies on the edge."""

NEIGHBOUR_RATIO = 2.0
"""The same beside such a profile: one in a hundred exceeds it by noise."""

WINDOW_STATIONS = 31
"""Stations over which the width's median is taken."""

WHOLE_PROFILE_DEPTH, MIN_PROFILE_DEPTH = 0.85, 0.7
"""Share of the shadow's depth over which light falls in profiles that show all of the edge, and over which it must fall."""

DRAWN_ERROR = 0.5
"""Share of the shift by ink that blurs with the edge by which its correction may be wrong."""


def coarse_contour(mask: Mask, share: Array, factor: float, origin: tuple[int, int]) -> Array:
    """Return the longest contour (n, 2) at half light of the one shadow in a small photograph, in px of the large one; open
    where the shadow leaves the picture.

    ``share``, shape (h, w), goes from 0 in the shadow to 1 on the screen; a pixel of the mask spans ``factor`` pixels of the
    photograph from ``origin`` on.
    """
    near = np.where(mask, np.minimum(share, 0.49), np.maximum(share, 0.51))
    contours = find_contours(np.clip(near, 0.0, 1.0), 0.5)
    if not contours:
        raise pictures.Unmeasurable(
            "there is no shadow on the screen; switch the lamp on, and photograph the body in its light"
        )
    longest = max(contours, key=lambda points: float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum()))
    return (longest[:, ::-1] + 0.5) * factor - 0.5 + np.array(origin)


def refine_edge(
    shading: Shading, contour: Array, factor: float, camera: EdgeShape | None = None, symmetric: bool = False
) -> Edge:
    """Find the edge near a coarse contour (n, 2) in px, good to about ``factor`` px.

    ``camera`` is the shape of a raised body's edge by the same camera, if this may be the edge of a level surface; a symmetric
    edge is an error function, where what is beside it would be taken for the camera's tone curve. Raises
    `Unmeasurable` for an edge that fades over more than the profiles can reach, or is nowhere clear.
    """
    length = float(np.linalg.norm(np.diff(contour, axis=0), axis=1).sum())
    place, normal = stations(contour, 2.0 * factor)
    ahead, behind = (shading.level(place + sign * 2.0 * factor * normal) for sign in (1.0, -1.0))
    if not np.nanmedian(ahead - behind) > 0.0:  # the normals shall point to the light
        contour = contour[::-1]
    spacing, reach = max(2.0 * factor, length / 400.0), 4.0 * factor + 4.0
    for _ in range(4):
        profiles = Profiles.across(shading, contour, spacing, reach)
        edge = _edge_in(profiles)
        width = float(np.median(edge.width)) if len(edge.px) > 10 else np.inf
        # A large lamp's light may fall steeply in one part of its penumbra, which is all that short profiles show.
        if 3.5 * width + factor <= reach and profiles.depth >= WHOLE_PROFILE_DEPTH * shading.colour.depth:
            break
        reach = 2.0 * reach
    if len(edge.px) < 10:
        raise pictures.Unmeasurable("its edge is not clear enough; photograph it again in focus, with more light and contrast")
    # The second look follows the first one's edge, so that its profiles need no room for the contour's error.
    spacing = max(3.0, float(np.linalg.norm(np.diff(edge.px, axis=0), axis=1).sum()) / MOST_STATIONS)
    reach = float(np.clip(4.5 * width + 2.0, 5.0, 250.0))
    return _edge_in(Profiles.across(shading, edge.px, spacing, reach), None if symmetric else shading, camera)


def _edge_in(profiles: Profiles, shading: Shading | None = None, camera: EdgeShape | None = None) -> Edge:
    """Return the edge that profiles show, without the stations where it is not clear or something lies on it. The
    photograph gives the shape of its edge and what ink draws; without it each profile is an error function."""
    shape, value = gaussian(), profiles.value
    fit, drawn = fit_profiles(profiles.offsets, value, profiles.weight), np.zeros(len(value))
    if shading is not None and shading.drawn is not None:
        # What ink draws is taken out before the shape is looked for, which would take it for the lamp's or the camera's.
        ink = fit.top * profiles.drawn(shading.drawn, fit.z, fit.width)
        value, drawn = value - ink, fit.centre_shift(ink)
        inked = ink.any(axis=1)
        again = fit_profiles(profiles.offsets, value[inked], profiles.weight[inked], before=fit.at(inked))
        fit = fit.replaced(inked, again)
    if shading is not None:
        good = _clear_stations(profiles, fit, fit.centre_error(fit.variance))
        if good.sum() >= 10:
            residual = fit.residual / np.maximum(fit.rise, 1e-12)[:, None]
            low, high = float(shading.colour.shadow.mean()), float(shading.colour.lit.mean())
            stored = StoredLight(shading.light.astype(np.float64), low, high, float(np.median(fit.width[good])))
            shape = common_shape(fit.z[good], residual[good], profiles.weight[good] > 0.9, stored, camera)
            fit = fit_profiles(profiles.offsets, value, profiles.weight, shape, fit)
    # Samples closer than a pixel repeat each other's noise.
    repeat = INTERPOLATION_NOISE * max(1.0, 1.0 / (profiles.offsets[1] - profiles.offsets[0]))
    own, centre = fit.variance, fit.centre
    error = np.hypot(fit.centre_error(np.maximum(own, np.median(own)) * repeat), DRAWN_ERROR * drawn)
    good = _clear_stations(profiles, fit, error)
    spoilt = _dusty_stations(own, fit.width, good)
    if (spoilt & good).sum() < 0.2 * good.sum():
        good &= ~spoilt
    px = profiles.place + centre[:, None] * profiles.normal
    by_ink = DRAWN_ERROR * np.abs(drawn[good]) if drawn.any() else None
    return Edge(px[good], profiles.normal[good], error[good], fit.width[good], _contrast(fit)[good], shape, by_ink)


def _contrast(fit: ProfileFit) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(fit.rise / (fit.low + fit.rise + fit.slope * fit.centre))


def _clear_stations(profiles: Profiles, fit: ProfileFit, error: Array) -> Mask:
    """Return the stations (n,) at which the edge is clear, by the standard errors (n,) of their middles."""
    reach = profiles.offsets[-1]
    return np.asarray(
        np.isfinite(error) & (fit.rise > 0.0) & (np.abs(fit.centre) < 0.8 * reach) & (profiles.weight.min(axis=1) > 0.0)
        & (fit.width < 0.7 * reach) & (error < 0.3 * reach) & (_contrast(fit) > 0.2)
    )  # fmt: skip


def _dusty_stations(variance: Array, width: Array, good: Mask) -> Mask:
    """Return the stations (n,) at which something lies on the edge: dust spoils the curve's shape before it moves its middle
    much."""
    usual = np.median(variance[good]) if good.any() else np.inf
    local = median_filter(width, WINDOW_STATIONS, mode="mirror") if len(width) >= WINDOW_STATIONS else np.median(width)
    is_spoilt = (variance > LARGEST_RESIDUAL_RATIO**2 * usual) | (np.abs(np.log(width / local)) > 0.35)
    # It reaches into the stations beside those in which it is plain.
    return np.asarray(binary_propagation(is_spoilt, mask=is_spoilt | (variance > NEIGHBOUR_RATIO**2 * usual)))


# ----------------------------------------------------------------------------------------------------------------------
# Robust loess: local quadratics with weights that ignore what lies far off, as MATLAB's ``smooth(…, 'rloess')`` does.
#
# The regression is Cleveland's own (``skmisc.loess``), asked for what the thesis used: degree 2, symmetric family, a span
# counted in points. Only the cutting into pieces is ours.
#
# Sources: W. S. Cleveland, "Robust locally weighted regression and smoothing scatterplots", J. Am. Stat. Assoc. 74 (1979)
# 829, doi 10.1080/01621459.1979.10481038; W. S. Cleveland, S. J. Devlin, J. Am. Stat. Assoc. 83 (1988) 596,
# doi 10.1080/01621459.1988.10478639.


SMOOTHING_POINTS = 20
"""Points in one local fit; the thesis' value."""

POINTS_PER_CALL = 100
"""Points per call: the direct fit and its standard errors cost the square of the number of points."""

REWEIGHTING_ROUNDS = 5
"""Rounds of reweighting; MATLAB takes five as well."""


@dataclasses.dataclass(frozen=True)
class Smoothed:
    """A smoothed curve: fitted values, their standard errors from the scatter about it, and the residual standard error of
    the points near each place, shape (n,)."""

    value: Array
    error: Array
    scatter: Array


def robust_loess(place: Array, value: Array, span: int = SMOOTHING_POINTS) -> Smoothed:
    """Return values (n,) at rising places (n,), at least 4 different ones in every span of so many points, smoothed by robust
    local quadratics; `ValueError` for fewer, for places that do not rise, and for a span or points below 5.

    Each piece of the curve is fitted together with a whole span of its neighbours on both sides, so the pieces' ends are no
    ends.
    """
    place, value = np.asarray(place, dtype=np.float64), np.asarray(value, dtype=np.float64)
    if place.ndim != 1 or place.shape != value.shape:
        raise ValueError("smoothing needs as many values as places, in one row each")
    if span < 5 or len(place) < 5:
        raise ValueError("smoothing with local quadratics needs at least 5 points and a span of at least 5")
    if (np.diff(place) < 0.0).any():
        raise ValueError("smoothing needs its places in rising order")
    pieces = []
    for start in range(0, len(place), POINTS_PER_CALL):
        stop = min(start + POINTS_PER_CALL, len(place))
        first, last = max(0, start - span), min(len(place), stop + span)
        piece = _smooth_piece(place[first:last], value[first:last], span)
        pieces.append(np.array([piece.value, piece.error, piece.scatter])[:, start - first : stop - first])
    return Smoothed(*np.concatenate(pieces, axis=1))


def _smooth_piece(place: Array, value: Array, span: int) -> Smoothed:
    # Loess solves its local fits in the units it is given; metres squared would sit at the rounding limit.
    origin, width = place[0], (place[-1] - place[0]) or 1.0
    offset, scale = float(np.median(value)), float(np.ptp(value)) or 1.0
    at, target = (place - origin) / width, (value - offset) / scale
    for family in ("symmetric", "gaussian"):
        # Values that lie on a curve but for rounding leave robust weights nothing to tell apart; plain ones serve then.
        model = loess(
            at, target, span=min(1.0, span / len(place)), degree=2, family=family,
            surface="direct", statistics="exact", iterations=REWEIGHTING_ROUNDS,
        )  # fmt: skip
        try:
            model.fit()
            fitted = np.array(model.outputs.fitted_values)
            error = np.array(model.predict(at, stderror=True).stderr, dtype=np.float64)
        except ValueError:
            continue
        if np.isfinite(fitted).all() and np.isfinite(error).all():
            scatter = max(float(model.outputs.residual_scale) * scale, np.finfo(float).tiny)
            return Smoothed(fitted * scale + offset, error * scale, np.full(len(place), scatter))
    raise ValueError("the values cannot be smoothed: several of them lie at one place")


# ----------------------------------------------------------------------------------------------------------------------
# The edge smoothed along its own length where it was measured, and bridged where it was not.
#
# Dust, a glint or a drop of water on the lens hide pieces of an edge. Smoothing over such a gap would draw the points beside it
# into it and call them as good as the others, so each measured stretch is smoothed by itself. Between two of them a cubic goes
# on from both ends in their directions. How far the true edge may lie off it grows with the gap's square: over a gap of the
# length g a curvature that is wrong by k moves the edge by k t (1 - t) g^2 / 2 at the share t of the way.


GAP_RATIO = 6.0
"""Distance of neighbouring points, over the usual one, from which something is missing between them.

Over fewer a smoothed span of points goes on safely: a speck that takes them has been left out with all that it touches.
"""

DROPPED_BESIDE_GAP = 2
"""Points on each side of a gap that what made it has touched as well."""

MIN_STRETCH_POINTS = 12
"""Points of a stretch that can be smoothed by itself; shorter ones belong to the gap."""

BRIDGE_CURVATURE_TOLERANCE = 0.5
"""Share of the outline's greatest curvature by which a bridge's curvature may be wrong."""

MIN_BRIDGE_COSINE = 0.5
"""Cosine of the greatest angle between two ends that a bridge joins."""

SHARED_NOISE_FACTOR = 1.5
"""Neighbouring stations share noise (JPEG's blocks, dust), so a smoothed point is this much worse than if they did not."""

MEDIAN_POINTS, MEDIAN_TOLERANCE = 5, 3.0
"""Points whose median is the edge where a local quadratic lies off it, and the median's standard errors from which it does."""

LEAST_CHORD, BENT_ERROR = 5.0, 0.3
"""Half of the shortest chord that shows the edge's curvature, in usual distances of points; error of the shift by it as a share
of that."""


@dataclasses.dataclass(frozen=True, eq=False)
class BridgedLine:
    """A smoothed edge: points in order along it and unit vectors from shadow to light, shape (n, 2), standard errors
    across it, all in px, and which points lie in a gap, where nothing was measured, shape (n,)."""

    px: Array
    normal: Array
    error: Array
    bridged: Mask


def smoothed(edge: Edge, longest: float) -> BridgedLine:
    """Return the edge as robust loess sees it, gaps bridged up to a longest one in px."""
    step = np.linalg.norm(np.diff(edge.px, axis=0), axis=1)
    usual = float(np.median(step))
    parts = _stretches(step, usual)
    lines = [_stretch(edge, part) for part in parts]
    bend = _curvature(lines)
    joined: list[BridgedLine] = []
    for line in lines:
        if joined:
            bridge = _bridge(joined[-1], line, usual, bend, longest)
            joined += [] if bridge is None else [bridge]
        joined.append(line)
    return BridgedLine(
        *(np.concatenate([getattr(line, name) for line in joined]) for name in ("px", "normal", "error", "bridged"))
    )


def _stretches(step: Array, usual: float) -> list[slice]:
    """Return the pieces without a gap; one that is too short to be smoothed belongs to the gap."""
    breaks = np.flatnonzero(step > GAP_RATIO * usual) + 1
    firsts, lasts = np.r_[0, breaks], np.r_[breaks, len(step) + 1]
    parts = [
        slice(first + (DROPPED_BESIDE_GAP if first else 0), last - (DROPPED_BESIDE_GAP if last <= len(step) else 0))
        for first, last in zip(firsts.tolist(), lasts.tolist(), strict=True)
    ]
    long = [part for part in parts if part.stop - part.start >= MIN_STRETCH_POINTS]
    return long or [slice(0, len(step) + 1)]


def local_polynomial(points: Array, count: int, degree: int) -> Array:
    """Return points (n, 2) smoothed by the polynomial through so many of them (odd, at most n) about each; near an end by that
    through the last ones. Savitzky and Golay 1964, doi 10.1021/ac60214a047; importing SciPy's takes a second."""
    half = count // 2
    basis = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, count), degree + 1))[0]
    smooth = correlate1d(points, basis @ basis[half], axis=0)
    smooth[:half] = basis[:half] @ (basis.T @ points[:count])
    smooth[-half or len(points) :] = basis[half + 1 :] @ (basis.T @ points[-count:])
    return np.asarray(smooth)


def _stretch(edge: Edge, part: slice) -> BridgedLine:
    px = edge.px[part]
    arc = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(px, axis=0), axis=1))]
    arc = arc + np.arange(len(arc)) * 1e-9  # strictly rising even where two points coincide
    # Loess sees distances across a plain local quadratic through the points: along the edge there is nothing to smooth,
    # and an edge that runs along the pixels would leave it nothing but rounding errors.
    guide = local_polynomial(px, min(21, (len(arc) - 1) // 2 * 2 + 1), 2)
    turn = np.gradient(guide, axis=0)
    across = np.column_stack([turn[:, 1], -turn[:, 0]]) / np.maximum(np.linalg.norm(turn, axis=1), 1e-12)[:, None]
    offset = np.einsum("ni,ni->n", px - guide, across)
    smooth = robust_loess(arc, offset)
    rest = offset - smooth.value
    off = np.abs(rest)
    window = min(61, len(off) // 2 * 2 - 1)
    # A local median of what the curve leaves is the scatter that is really there, whatever its cause.
    local = robust.DEVIATION_PER_MEDIAN * median_filter(off, window, mode="mirror")
    gain = smooth.error / smooth.scatter
    gain = np.maximum(gain, float(np.median(gain)))  # the ends of a stretch have neighbours on one side only
    # What values between pixels lose of their scatter is in `SHARED_NOISE_FACTOR` already.
    by_ink = np.zeros(len(px)) if edge.by_ink is None else edge.by_ink[part]
    noise = np.sqrt(np.maximum(edge.error[part] ** 2 - by_ink**2, 0.0))
    own = np.maximum(noise / np.sqrt(INTERPOLATION_NOISE), local)
    # Where the edge turns within a span, as at a bulge's foot in a small picture, no quadratic follows it.
    few, noise = median_filter(rest, MEDIAN_POINTS, mode="mirror"), 1.25 * own / np.sqrt(MEDIAN_POINTS)
    turned = np.abs(few) > MEDIAN_TOLERANCE * noise
    value = smooth.value + np.where(turned, few, 0.0)
    error = SHARED_NOISE_FACTOR * np.where(turned, np.maximum(noise, gain * own), gain * own)
    line, normal = guide + value[:, None] * across, edge.normal[part]
    bent = _edge_offset(line, normal, edge.width[part])
    error = np.linalg.norm([error, BENT_ERROR * bent, by_ink], axis=0)  # smoothing takes nothing of what neighbours share
    return BridgedLine(line + bent[:, None] * normal, normal, error, np.zeros(len(px), dtype=bool))


def _edge_offset(px: Array, normal: Array, width: Array) -> Array:
    """Return how far (n,) in px towards the light the edge lies from where half of the light is.

    A photograph is the silhouette under a blur, by the lamp's own shape and by the lens. On an edge of the curvature k a blur
    of the standard deviation s shifts half of the light by k s^2 / 2 towards the centre of curvature: more than half of the
    surroundings of a convex shadow are lit. With the curvature of chords that reach sqrt(3) s to both sides this is the mean
    of any edge up to the fifth degree under a Gaussian blur (Gauss-Hermite quadrature), and none beyond the blur's reach.
    """
    arc = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(px, axis=0), axis=1))]
    reach = np.maximum(np.sqrt(3.0) * width, LEAST_CHORD * float(np.median(np.diff(arc))))
    inside = (arc >= reach) & (arc <= arc[-1] - reach)
    if not inside.any():
        return np.zeros(len(px))
    near, far = (np.column_stack([np.interp(arc + side * reach, arc, px[:, axis]) for axis in (0, 1)]) for side in (-1.0, 1.0))
    sagitta = np.einsum("ni,ni->n", px - 0.5 * (near + far), normal)
    bend = 8.0 * sagitta / np.maximum(np.sum((far - near) ** 2, axis=1), 1e-9)
    return np.asarray(0.5 * np.interp(arc, arc[inside], bend[inside]) * width**2)


def _curvature(lines: list[BridgedLine]) -> float:
    """Return the greatest curvature of the smoothed edge in 1/px, but for single corners."""
    curvatures = [np.zeros(1)]
    for line in lines:
        if len(line.px) > 4 * SMOOTHING_POINTS:
            # Over two spans of points noise bends nothing any more.
            near = line.px[: -2 * SMOOTHING_POINTS]
            here = line.px[SMOOTHING_POINTS:-SMOOTHING_POINTS]
            far = line.px[2 * SMOOTHING_POINTS :]
            chord = far - near
            length = np.maximum(np.linalg.norm(chord, axis=1), 1e-9)
            sagitta = np.abs(chord[:, 0] * (here - near)[:, 1] - chord[:, 1] * (here - near)[:, 0]) / length
            curvatures.append(8.0 * sagitta / length**2)
    return float(np.percentile(np.concatenate(curvatures), 90))


def _bridge(before: BridgedLine, after: BridgedLine, usual: float, bend: float, longest: float) -> BridgedLine | None:
    """Return a cubic over the gap between two stretches; None where it would be a guess."""
    start, end = before.px[-1], after.px[0]
    gap = float(np.linalg.norm(end - start))
    count = round(gap / usual) - 1
    leave, arrive = _direction(before.px[::-1]) * -1.0, _direction(after.px)
    way = (end - start) / max(gap, 1e-9)
    if count < 1 or gap > longest or min(leave @ way, arrive @ way) < MIN_BRIDGE_COSINE:
        return None
    t = (np.arange(1, count + 1) / (count + 1))[:, None]
    px = (
        (1 + 2 * t) * (1 - t) ** 2 * start + t * (1 - t) ** 2 * gap * leave
        + t**2 * (3 - 2 * t) * end - t**2 * (1 - t) * gap * arrive
    )  # fmt: skip
    normal = (1 - t) * before.normal[-1] + t * after.normal[0]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    share = t[:, 0]
    ends = (1 - share) * before.error[-1] + share * after.error[0]
    # The direction at an end is known from a span of points; it errs by their error over half of the span's length.
    lean = (before.error[-1] + after.error[0]) / (0.5 * SMOOTHING_POINTS * usual) * gap * share * (1 - share)
    error = np.sqrt(ends**2 + lean**2 + (0.5 * BRIDGE_CURVATURE_TOLERANCE * bend * share * (1 - share) * gap**2) ** 2)
    return BridgedLine(px, normal, error, np.ones(count, dtype=bool))


def _direction(px: Array) -> Array:
    """Return the unit vector (2,) along a stretch at its first point, from a quadratic through a span of points."""
    part = px[:SMOOTHING_POINTS]
    at = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(part, axis=0), axis=1))]
    slope = np.polynomial.polynomial.polyfit(at, part, 2)[1]
    return np.asarray(slope / np.linalg.norm(slope))


# ----------------------------------------------------------------------------------------------------------------------
# A patch of the edge that is more blurred than the rest: a drop of water or fat on the lens.
#
# Such a drop is a lens of its own. It moves the edge visible through it by up to some tenths of a millimetre, smoothly, so that
# no corner or bump shows it at a low bulge. But the image through it is out of focus. The width of the edge by itself changes
# only slowly: with the place (a lens' focus, the body's distance) and with the edge's direction (a lamp that is not round).


MIN_WIDTH_RATIO, WIDTH_FITS = 0.05, 3
"""Least square of the expected width over the usual one's, and fits of it, each with the scatter that the last one leaves."""

WIDTH_WINDOW, MIN_WINDOW_POINTS = 1.2e-3, 15
"""Length in m and least number of points over which the width's median is taken: corners and dust are shorter."""


def widest_patch(edge: Edge, scale: float) -> tuple[float, float]:
    """Return the logarithm of the most blurred patch's width over what the rest of the edge leads one to expect, and its
    scatter."""
    if len(edge.px) < 6 * MIN_WINDOW_POINTS:
        return 0.0, 0.0
    place = (edge.px - edge.px.mean(axis=0)) / np.ptp(edge.px, axis=0).max()
    x, z = place.T
    # The normal's doubled angle: an oblong lamp blurs opposite sides alike.
    turn = 2.0 * np.arctan2(edge.normal[:, 1], edge.normal[:, 0])
    terms = np.column_stack([np.ones(len(x)), x, z, x**2, x * z, z**2, np.cos(turn), np.sin(turn)])
    width = np.log(edge.width)
    square = float(np.exp(2.0 * np.median(width)))

    def expected(c: Array) -> Array:
        return square * np.maximum(terms @ c, MIN_WIDTH_RATIO)

    def missed(c: Array) -> Array:
        return np.asarray(0.5 * np.log(expected(c)) - width)

    def slopes(c: Array) -> Array:
        return np.asarray(0.5 * square * terms / expected(c)[:, None])

    coefficients, rest = np.eye(terms.shape[1])[0], np.median(width) - width
    for _ in range(WIDTH_FITS):
        # Of an edge out of focus the first fit leaves most; what a patch leaves is much only beside what the rest does.
        usual = robust.deviation(rest) + 1e-3
        coefficients = least_squares(missed, coefficients, jac=slopes, loss="cauchy", f_scale=usual).x
        rest = -missed(coefficients)
    spacing = float(np.median(np.linalg.norm(np.diff(edge.px, axis=0), axis=1))) * scale
    count = min(max(MIN_WINDOW_POINTS, round(WIDTH_WINDOW / spacing)), len(rest) // 3)
    smooth = np.median(np.lib.stride_tricks.sliding_window_view(rest, count), axis=1)
    return float(smooth.max()), robust.deviation(smooth - np.median(smooth))


# ----------------------------------------------------------------------------------------------------------------------
# From one photograph to the shadow's edge on the screen; whether it can be trusted is asked by `series.checks`.


COARSE_SIDE_PX = 640
"""Longer side in px of the small version in which the shadow is found."""

WIDEST_LINES = (0.1, 0.2)
"""Greatest width of a grid line in pitches that is distinguished from a shadow: as a rule, and where that shows no shadow."""

RIM_SIDE_PX, PENUMBRA_WIDTHS = 9, 3.0
"""Side in px of the square by which a part of the small version is made smaller, and reach of an edge's light in its widths."""

LONGEST_BRIDGE = 10e-3
"""Length in m of the longest gap in an edge that is bridged, so that it can be shown; its points are no measured ones."""


@dataclasses.dataclass(eq=False)
class Traced:
    """A photograph (h, w, 3), and the edge of its shadow on the screen; each step is computed when it is first asked for.

    ``tone`` is how the file stores light, one of `pictures.TONES`, ``tone_error`` the distance in m by which the edge may be
    off because another tone fits as well. ``camera`` is as of `refine_edge`; ``doubts`` are sentences, and ``anyway`` uses it
    in spite of them.
    """

    image: pictures.Pixels
    setup: Setup
    tone: str
    tone_error: float = 0.0
    doubts: tuple[str, ...] = ()
    camera: EdgeShape | None = None
    anyway: bool = False

    def of_level(self, raised: Traced) -> Traced:
        """Return this photograph of a level surface, traced again with what a raised body's shows of the camera."""
        again = dataclasses.replace(self, tone=raised.tone, camera=raised.edge.shape)
        if self.tone == raised.tone:
            kept = ("view", "small", "_closed", "coarse", "look", "ink")
            vars(again).update({name: vars(self)[name] for name in kept if name in vars(self)})
        return again

    @functools.cached_property
    def view(self) -> View:
        """The region of the photograph that is evaluated."""
        return View(self.image, self.setup, _region(self.image, self.setup), pictures.TONES[self.tone])

    @property
    def scale(self) -> float:
        """Length in m of a pixel in the middle."""
        return self.view.pixel

    @functools.cached_property
    def factor(self) -> float:
        """Pixels of the photograph per pixel of the small version."""
        return max(1.0, self.view.size.max() / COARSE_SIDE_PX)

    @functools.cached_property
    def small(self) -> npt.NDArray[np.float32]:
        """Light of the small version, shape (h, w, 3)."""
        x0, y0, x1, y1 = self.view.roi
        size = (max(8, round((x1 - x0) / self.factor)), max(8, round((y1 - y0) / self.factor)))
        reduced = cv2.resize(self.image[y0:y1, x0:x1], size, interpolation=cv2.INTER_AREA)
        return np.asarray(cv2.LUT(reduced, self.view.light))

    @functools.cached_property
    def line_px(self) -> float:
        """Greatest width of a grid line in px of the small version; 0 without a grid."""
        return self._closed[0]

    @functools.cached_property
    def covered(self) -> npt.NDArray[np.bool_]:
        """Pixels of the small version that the setup masks, shape (h, w)."""
        shape = self.small.shape[:2]
        if not self.setup.masks:
            return np.zeros(shape, dtype=bool)
        places = np.moveaxis(np.indices(shape)[::-1], 0, -1).reshape(-1, 2)
        is_masked = self.masked(self.view.enlarged(places.astype(np.float64), shape)).reshape(shape)
        if is_masked.all():
            raise pictures.Unmeasurable("the masks cover everything; give setup --mask smaller ones")
        return is_masked

    @functools.cached_property
    def coarse(self) -> CoarseShadow:
        """The shadow in the small version."""
        return self._closed[1]

    @functools.cached_property
    def _closed(self) -> tuple[float, CoarseShadow]:
        """The greatest width of a grid line in px, and the shadow without them."""
        colour, pitch = self.setup.shadow_colour, self.setup.grid_pitch
        known = None if colour is None else self.view.light[np.rint(np.array(colour)).astype(int)]
        if pitch is None:
            return 0.0, find_shadow(self.small, 0.0, known, self.covered)
        usual, wide = (share * pitch / self.setup.magnification / self.scale / self.factor for share in WIDEST_LINES)
        try:
            return usual, find_shadow(self.small, usual, known, self.covered)
        except pictures.Unmeasurable as why:
            with contextlib.suppress(pictures.Unmeasurable):
                return wide, find_shadow(self.small, wide, known, self.covered)
            raise why

    @functools.cached_property
    def look(self) -> GridLook | None:
        """The screen's grid in the light; None without a grid."""
        pitch = self.setup.grid_pitch
        return None if pitch is None else look_at_grid(self.view, pitch, _well_inside(~(self.coarse.dark | self.covered)))

    @functools.cached_property
    def movement(self) -> tuple[float, float]:
        """Movement of the screen's picture since the setup, and what of the grid's shifts it leaves, both in m in the object's
        plane; NaN without a grid, infinite where too little of it is seen."""
        if self.look is None:
            return np.nan, np.nan
        moved, rest = movement(self.look)
        return moved / self.setup.magnification, rest / self.setup.magnification

    @functools.cached_property
    def ink(self) -> Ink | None:
        """Light through the grid's ink; None without a grid."""
        return None if self.look is None else Ink.of(self.look, self.setup, self.view.roi)

    @functools.cached_property
    def edge(self) -> Edge:
        """The edge as it was found, in px."""
        ink, coarse = self.ink, self.coarse
        shading = Shading(self.image, coarse.colour, ink, None if ink is None else ink.drawn, self.view.light)
        contour = coarse_contour(coarse.mask, coarse.share, self.factor, self.view.roi[:2])
        edge = refine_edge(shading, contour, self.factor, self.camera)
        masked = self.masked(edge.px)
        if masked.all() and len(edge.px):
            raise pictures.Unmeasurable("the masks cover the whole edge; give setup --mask smaller ones")
        return edge[self.view.inside(edge.px) & ~masked]

    def masked(self, px: Array) -> npt.NDArray[np.bool_]:
        """Return which pixels (n, 2) lie in one of the setup's masks."""
        is_masked = np.zeros(len(px), dtype=bool)
        for x0, y0, x1, y1 in self.setup.masks:
            is_masked |= ((px >= [x0, y0]) & (px <= [x1, y1])).all(axis=1)
        return is_masked

    @property
    def touched(self) -> bool:
        """Whether something thin and dark stands out of the shadow."""
        mask, ink = self.coarse.mask, self.ink
        pixels = np.moveaxis(np.indices(mask.shape)[::-1], 0, -1)
        through = np.ones(mask.shape) if ink is None else ink((pixels + 0.5) * self.factor - 0.5 + self.view.roi[:2])
        return touched_by_thread(self.small, self.coarse, through, self.line_px, self.scale * self.factor)

    @functools.cached_property
    def width_px(self) -> float:
        """Usual width of the edge in px."""
        return float(np.median(self.edge.width))

    @property
    def lift(self) -> float:
        """Distance in m by which the half light lies above a surface that is deep along the light; see `EdgeShape`."""
        return self.edge.shape.lift * self.width_px * self.scale

    @property
    def shift_error(self) -> float:
        """Standard error in m of the half light's place, which all points share; part of the line's error too."""
        return self.edge.shape.shift_error * self.width_px * self.scale

    @property
    def model_error(self) -> float:
        """The same by the model of the edge's shape, which all photographs of a run share; no part of the line's error."""
        return self.edge.shape.model_error * self.width_px * self.scale

    @functools.cached_property
    def line(self) -> BridgedLine:
        """The smoothed edge."""
        line = smoothed(self.edge, LONGEST_BRIDGE / self.scale)
        # Where the half light lies in the edge's shape is not known any better than this, along all of the edge.
        return dataclasses.replace(line, error=np.hypot(line.error, self.edge.shape.shift_error * self.width_px))

    @functools.cached_property
    def points(self) -> Array:
        """The smoothed edge on the screen in m, shape (n, 2); NaN where the lens is not known."""
        return self.setup.to_metres(self.line.px)

    @functools.cached_property
    def normals(self) -> Array:
        """Unit vectors across it on the screen, from shadow to light, shape (n, 2)."""
        slope = self.setup.jacobian(self.line.px)
        normals = np.linalg.solve(np.swapaxes(slope, 1, 2), self.line.normal[..., None])[..., 0]
        return np.asarray(normals / np.linalg.norm(normals, axis=1)[:, None])

    @functools.cached_property
    def flatness(self) -> Flatness:
        """What the screen's own shape makes uncertain of the edge."""
        look, coarse = self.look, self.coarse
        if look is None:
            return Flatness(np.zeros(len(self.points)))
        parts = (~(coarse.dark | self.covered), coarse.mask & ~self.covered)
        # The penumbra's own fall of light would draw a line in it aside.
        rim = max(RIM_SIDE_PX, 2 * int(np.ceil(PENUMBRA_WIDTHS * self.width_px / self.factor)) + 1)
        looks = [look_at_grid(self.view, look.pitch, _well_inside(part, rim), look.line_reach) for part in parts]
        return flatness(looks, self.points * self.setup.magnification)

    @property
    def own_error(self) -> Array:
        """Standard errors (n,) in m of the smoothed edge by itself: the edge's and the screen's."""
        edge = self.setup.exact_scale.error(self.line.px, self.line.error, self.normals)
        return np.hypot(edge, self.flatness.error / self.setup.magnification)

    @property
    def rim(self) -> Array:
        """Places in m where the shadow meets the frame or the region of interest, shape (m, 2)."""
        mask = self.coarse.mask
        rim = np.zeros_like(mask)
        rim[[0, -1], :] = mask[[0, -1], :]
        rim[:, [0, -1]] = mask[:, [0, -1]]
        rows, columns = np.nonzero(rim)
        places = self.setup.to_metres(self.view.enlarged(np.column_stack([columns, rows]), mask.shape))
        return places[np.isfinite(places).all(axis=1)]


def _region(image: pictures.Pixels, setup: Setup) -> tuple[int, int, int, int]:
    height, width = image.shape[:2]
    if (width, height) != setup.camera.size:
        raise pictures.Unmeasurable(
            f"it has {width} x {height} pixels where the setup has {setup.camera.width} x {setup.camera.height}; "
            "photograph both with the same settings, uncropped"
        )
    x0, y0, x1, y1 = (0, 0, width, height) if setup.roi is None else (round(value) for value in setup.roi)
    if min(x1 - x0, y1 - y0) < 64:
        raise pictures.Unmeasurable("the region of interest is smaller than 64 pixels; give setup --roi a larger one")
    return x0, y0, x1, y1


def _well_inside(part: Mask, size: int = RIM_SIDE_PX) -> Mask:
    """Return a part (h, w) of the small version without its rim, half of a size in px wide."""
    return np.asarray(cv2.erode(part.astype(np.uint8), np.ones((size, size), np.uint8)) > 0)
