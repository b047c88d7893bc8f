"""Check that an edge is the outline of a single inflated surface on the zero plane.

An edge can be found to a hundredth of a pixel and still be something else's: a hair on the membrane, a finger before the
lamp, a drop, a glint that eats into the shadow, or the right actuator in another place. What tells them apart is known of
every inflated surface: beside the bulge it lies where it lay at zero pressure or a little lower, and above it the membrane
bends alike from one place to the next. A corner there belongs to a second thing.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import numpy.typing as npt
from scipy.ndimage import binary_dilation
from scipy.optimize import least_squares
from scipy.signal import savgol_filter

from measurement.camera.pictures import Unmeasurable
from measurement.outline.outline import Outline
from measurement.outline.zero import ZeroLine
from measurement.robust import deviation
from measurement.screen.setup import Setup, SetupError
from softmodels.common.arrays import Array

Mask = npt.NDArray[np.bool_]

ON_SURFACE = 50e-6
"""Distance in m within which an edge counts as the surface itself."""

LEVEL = 0.94
"""Cosine of the steepest angle at which an edge may be the surface beside the bulge."""

ENDS = 0.12
"""Share of the surface's length at each of its ends that stays where it was, however high the middle rises."""

UNCLEAR, DISPLACED = 10e-6, 200e-6
"""Distance in m of those ends from the zero plane up to which they tell nothing, and from which nothing is measured."""

SETTLES = 0.25
"""Share of the height by which a soft body's surface may sink beside its bulge; thick disks have an eighth."""

WINDOW, WINDOW_SHARE = 0.8e-3, 0.04
"""Length of edge on each side of a place over which its direction is taken: in m at most, and as a share of the bulge's
width; `FEWEST_STATIONS` at least."""

FEWEST_STATIONS = 6

CREASE, CORNER = 8.0, 25.0
"""Turn in degrees, beyond that of the neighbouring edge, which no membrane makes by itself, and which is another thing."""

BLURRED = 5.0
"""Standard error of the highest place over the outline's usual one from which something must be wrong there."""

NARROWEST = 0.08
"""Least width at half height of what stands on the surface, as a share of the surface that is visible."""


def check_top(placed: Array, above: Mask, upwards: Array, error: Array) -> None:
    """Reject an outline whose highest place is none of a surface seen from the side.

    Args:
        placed: Edge as x along the surface and z above it in m, in order along the edge, shape (n, 2).
        above: Which points do not lie below the surface, shape (n,).
        upwards: Cosine of the angle between the way to the light and the surface's normal, shape (n,).
        error: Standard errors in m, shape (n,).

    Raises:
        Unmeasurable: With the reason.
    """
    top = int(np.argmax(np.where(above, placed[:, 1], -np.inf)))
    kept = np.nonzero(above)[0]
    standing = placed[top, 1] > max(10.0 * error[top], 3.0 * ON_SURFACE)
    if standing and upwards[max(0, top - 3) : top + 4].mean() < 0.5:
        raise Unmeasurable(
            "the shadow's highest point is not a rounded top: it hangs from above, or an object is in the light; "
            "remove it, turn the picture upright before setup and photos, or exclude it with setup --roi"
        )
    if standing and min(top - kept[0], kept[-1] - top) < 5:
        raise Unmeasurable(
            "the outline ends at its highest point: part of it is hidden or outside of the picture; aim the camera at "
            "all of it, and clear away what hides it"
        )
    if not standing and np.median(upwards[above]) < 0.5:
        raise Unmeasurable(
            "the edge on the surface's line is not level: the actuator has moved or is not in the picture; "
            "photograph it at zero pressure again and list that"
        )
    if placed[above, 1].max() - placed[above, 1].min() > 2.0 * np.ptp(placed[above, 0]):
        raise Unmeasurable(
            "the shadow stands more than twice as high as it is wide, so it is not an inflated surface; "
            "exclude other shadows with setup --roi"
        )


def displacement(placed: Array, upwards: Array, error: Array, zero: ZeroLine) -> tuple[float, float, str | None]:
    """Return how far the surface beside the bulge lies from the zero plane.

    A soft body that bulges takes the rubber beside the bulge inwards, so that its surface may sink there by a share of the
    height. That much is no mistake as long as the other photographs of the run agree (`settling_doubts`).

    Args:
        placed: Edge as in `check_top`.
        upwards: As in `check_top`.
        error: Standard errors in m, shape (n,).
        zero: The zero plane.

    Returns:
        How far in m it has sunk where a soft body may, negative if it has risen, 0 if that is within the measurement's own
        error; distance in m by which it may lie off, be it that its ends do not lie at one level, 0 if there is none; and
        what speaks against the outline, if anything does.

    Raises:
        Unmeasurable: It is so far off that heights have no meaning.
    """
    seen = (placed[:, 0] >= zero.extent[0]) & (placed[:, 0] <= zero.extent[1])
    if not seen.any():
        raise Unmeasurable(
            "the shadow is beside the surface at zero pressure: the actuator has moved, or the zero is wrong; "
            "photograph it at zero pressure again and list that"
        )
    low, high = placed[seen, 0].min(), placed[seen, 0].max()
    reach = ENDS * (high - low)
    sinks = SETTLES * max(0.0, float(placed[:, 1].max()))
    worst, tolerance, sunk = 0.0, 0.0, 0.0
    for end in (placed[:, 0] <= low + reach, placed[:, 0] >= high - reach):
        # Steep points are the body's sides or a bulge as wide as the picture; they do not lie on the surface anyway.
        mine = seen & end & (upwards > LEVEL)
        if mine.sum() < 5:
            continue
        off, own = float(np.median(placed[mine, 1])), 4.0 * float(np.median(error[mine]))
        if -sinks <= off < -max(UNCLEAR, own):
            sunk = max(sunk, -off)
        elif abs(off) > abs(worst):
            worst, tolerance = off, own
    aslant = _aslant(placed[seen], upwards[seen], error[seen], zero)
    if abs(worst) <= max(UNCLEAR, tolerance):
        if aslant <= ON_SURFACE:
            return sunk, aslant, None
        tilted = (
            f"one end of the surface lies {2e3 * aslant:.2f} mm lower than the other: the actuator, the lamp or the camera "
            "was tilted since the zero was taken; photograph it at zero pressure again"
        )
        return sunk, aslant, tilted
    sentence = (
        f"beside the bulge the surface lies {abs(worst) * 1e3:.2f} mm {'above' if worst > 0.0 else 'below'} the zero plane: "
        "the actuator, the lamp or the camera has moved since the zero was taken; photograph it at zero pressure again"
    )
    if abs(worst) > max(DISPLACED, tolerance):
        raise Unmeasurable(sentence)
    # No pressure lifts the surface; a soft body that was lifted sinks back as it rises (`settling_doubts` needs to see both).
    sunk = sunk if sunk > 0.0 else -max(worst, 0.0)
    return sunk, max(abs(worst), aslant), sentence if abs(worst) > max(ON_SURFACE, tolerance) else None


def _aslant(placed: Array, upwards: Array, error: Array, zero: ZeroLine) -> float:
    """Return half of what one end of the surface lies lower than the other in m; 0 where that cannot be told from none.

    A body sinks alike at both of its sides, and by any depth, so that only their difference shows one that was tilted. About
    which of its points is not known, and so by how much its middle was lifted: by no more than its ends.

    Args:
        placed: Edge as in `check_top`, as far as the zero was seen.
        upwards: As in `check_top`.
        error: Standard errors in m, shape (n,).
        zero: The zero plane; without the body's sides it is unknown where its middle is.
    """
    if zero.sides is None:
        return 0.0
    half = 0.5 * (zero.extent[1] - zero.extent[0])
    away = placed[:, 0] - 0.5 * (zero.extent[0] + zero.extent[1])
    end = (upwards > LEVEL) & (np.abs(away) > (1.0 - 2.0 * ENDS) * half)
    left, right = (np.flatnonzero(end & (side * away > 0.0)) for side in (-1.0, 1.0))
    if min(len(left), len(right)) < 5:
        return 0.0
    left = left[np.argsort(-away[left])]
    right = right[(away[right] >= -away[left[0]]) & (away[right] <= -away[left[-1]])]
    if len(right) < 5:
        return 0.0
    lower = float(np.median(placed[right, 1] - np.interp(away[right], -away[left], placed[left, 1])))
    own = 4.0 * float(np.median(error[np.r_[left, right]]))
    return 0.5 * abs(lower) if abs(lower) > max(UNCLEAR, own) else 0.0


def check_corners(placed: Array) -> str | None:
    """Return what speaks for a second thing in the shadow's edge, by the edge's turns.

    Args:
        placed: Edge as x along the surface and z above it in m, as found and not smoothed, in order, shape (n, 2).

    Raises:
        Unmeasurable: The edge has a corner that no membrane has.
    """
    place, turn = sharpest_turn(placed)
    if turn > CORNER:
        raise Unmeasurable(
            f"the edge has a corner of {turn:.0f} degrees {placed[place, 1] * 1e3:.1f} mm above the surface: a second thing "
            "(hair, tube, drop, finger) merges with the shadow, or hides part of it; take it away and photograph it again"
        )
    if turn > CREASE:
        return (
            f"the edge bends sharply by {turn:.0f} degrees {placed[place, 1] * 1e3:.1f} mm above the surface: something lies "
            "on it or hides part of it, or it is creased"
        )
    return None


def check_width(placed: Array, error: Array, zero: ZeroLine) -> str | None:
    """Return what speaks against a bulge much narrower than the surface it stands on: dust, a drop, a blister.

    Args:
        placed: Edge as x along the surface and z above it in m, shape (n, 2).
        error: Standard errors in m, shape (n,).
        zero: The zero plane.
    """
    top = int(np.argmax(placed[:, 1]))
    if placed[top, 1] < max(10.0 * error[top], ON_SURFACE):
        return None
    width = float(np.ptp(placed[placed[:, 1] > 0.5 * placed[top, 1], 0]))
    seen = min(zero.extent[1] - zero.extent[0], float(np.ptp(placed[:, 0])))
    if width >= NARROWEST * seen:
        return None
    return f"the object on the surface is only {width * 1e3:.1f} mm wide at half its height: dust, a drop or another object"


def check_clear(placed: Array, error: Array) -> str | None:
    """Return what speaks against a highest place that is much less clear than the rest of the outline.

    Args:
        placed: Edge as x along the surface and z above it in m, shape (n, 2).
        error: Standard errors in m, shape (n,).
    """
    own, usual = float(error[np.argmax(placed[:, 1])]), float(np.median(error))
    if own < max(BLURRED * usual, UNCLEAR):
        return None
    return f"the edge is unclear at its highest place: {own * 1e6:.0f} um there, {usual * 1e6:.0f} um elsewhere"


def sharpest_turn(placed: Array) -> tuple[int, float]:
    """Return where the edge turns most beyond its neighbourhood, and by how many degrees; 0 where no turn stands out.

    Only turns above the surface count: where a membrane is clamped it may leave the surface at any angle.
    """
    step = np.linalg.norm(np.diff(placed, axis=0), axis=1)
    arc = np.r_[0.0, np.cumsum(step)]
    raised = placed[placed[:, 1] >= 0.1 * max(placed[:, 1].max(), 0.0), 0]
    if not len(raised):
        return 0, 0.0
    window = max(min(WINDOW, WINDOW_SHARE * float(np.ptp(raised))), FEWEST_STATIONS * float(np.median(step)))
    turn = _turns(placed, arc, window)
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
    free = known & ~_near(arc, np.abs(placed[:, 1]) < 2.0 * ON_SURFACE, window) & (placed[:, 1] > 0.0)
    # One bad point is no corner: the turn must stand over several places.
    lasting = np.min(np.lib.stride_tricks.sliding_window_view(np.pad(beyond * free, 1), 3), axis=1)
    noise = deviation(beyond[known])
    place = int(np.argmax(lasting))
    turned = float(np.degrees(lasting[place]))
    return place, turned if turned > 6.0 * np.degrees(noise) else 0.0


def _turns(placed: Array, arc: Array, window: float) -> Array:
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


def _near(arc: Array, chosen: Mask, reach: float) -> Mask:
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


NEAR, FAR = 0.5e-3, 4e-3
"""Lengths in m of edge that are averaged, and over which a membrane is a polynomial of the fifth degree, to a micrometre."""

FAR_SHARE = 0.22
"""The latter as a share of the bulge's width, if that is less."""

MIN_RIPPLE, NOISES = 15e-6, 8.0
"""Distance in m between the two, and the same in its own scatter, from which the outline is not that of a membrane."""

STATED = 4.5
"""Such a distance in its own scatter from which the stated error has to carry it: the largest of good outlines reach 4."""

SHORT_AVERAGE_POINTS = 7
"""Points in the short average, and twice as many in the long one, for the two to differ."""


def check_ripples(placed: Array) -> str | None:
    """Return what speaks for a second thing on the outline by its bumps.

    Args:
        placed: Edge as x along the surface and z above it in m, as found and not smoothed, in order, shape (n, 2).
    """
    place, height, scatter = highest_ripple(placed)
    if abs(height) <= max(MIN_RIPPLE, NOISES * scatter):
        return None
    return (
        f"{placed[place, 1] * 1e3:.1f} mm above the surface the outline has a {'bump' if height > 0.0 else 'hollow'} of "
        f"{abs(height) * 1e6:.0f} um that is narrower than a membrane can bend: a fibre, a grain or a drop on it or "
        "on the lens, or the screen is not flat"
    )


def unsure(placed: Array) -> float:
    """Return the error in m that a bump too low for `check_ripples` leaves: a thing of that height may lie on any length of the
    outline.

    Args:
        placed: Edge as in `check_ripples`.
    """
    _, height, scatter = highest_ripple(placed)
    return abs(height) if abs(height) > STATED * scatter else 0.0


def highest_ripple(placed: Array) -> tuple[int, float, float]:
    """Return the index of the point where the edge lies farthest off its neighbourhood, how far in m, and the usual distance in
    m.

    Only what rises counts: where a membrane is clamped, or a body ends, the edge may turn at any angle.
    """
    step = np.linalg.norm(np.diff(placed, axis=0), axis=1)
    arc, spacing = np.r_[0.0, np.cumsum(step)], float(np.median(step))
    raised = placed[placed[:, 1] >= 0.1 * max(placed[:, 1].max(), 0.0), 0]
    if not len(raised):
        return 0, 0.0, 0.0
    far = _odd(min(FAR, FAR_SHARE * float(np.ptp(raised))) / spacing)
    near = max(SHORT_AVERAGE_POINTS, _odd(min(NEAR / spacing, 0.3 * far)))
    if far < 2 * near:
        return 0, 0.0, 0.0
    at = np.arange(0.0, arc[-1], spacing)
    line = np.column_stack([np.interp(at, arc, placed[:, axis]) for axis in (0, 1)])
    if len(at) < 2 * far:
        return 0, 0.0, 0.0
    smooth = savgol_filter(line, far, 5, axis=0)
    along = np.gradient(smooth, axis=0)
    across = np.column_stack([-along[:, 1], along[:, 0]]) / np.maximum(np.linalg.norm(along, axis=1), 1e-12)[:, None]
    off = np.einsum("ni,ni->n", savgol_filter(line, near, 2, axis=0) - smooth, across)
    off *= np.sign(float(np.sum(along[:, 0])))  # an edge that runs to the left has its normals downwards
    clamped = binary_dilation(line[:, 1] < 2.0 * ON_SURFACE, np.ones(far | 1))
    clamped[: far // 2] = clamped[-(far // 2) :] = True
    if np.count_nonzero(~clamped) < 2 * far:
        return 0, 0.0, 0.0
    scatter = deviation(off[~clamped])
    worst = int(np.argmax(np.abs(off) * ~clamped))
    return int(np.argmin(np.abs(arc - at[worst]))), float(off[worst]), scatter


def _odd(count: float) -> int:
    return max(3, round(count)) // 2 * 2 + 1


# ----------------------------------------------------------------------------------------------------------------------
# Distinguish sinking of the surface beside the bulge from motion of the body.
#
# Under pressure a soft body draws in the rubber beside its bulge. How far grows smoothly with the height and vanishes with it,
# from one photograph of a run to the next. A body that was moved after the zero photograph lies off by the same distance at
# every height, and one that was moved for a single photograph lies off in that one.


MIN_RAISED_OUTLINES = 4
"""Raised outlines from which their common course can be told from a body that was moved."""

CURVED = 6
"""Raised outlines from which the course may bend."""

MIN_HEIGHT_RATIO = 5.0
"""Heights below this many times `ON_SURFACE` tell nothing of the course."""

TELLS, TELLS_SHARE = 15e-6, 0.05
"""Distance in m from a common course, and as a share of the deepest sinking, that tells of a body that was moved."""

SHARE = 0.2
"""Share of its own sinking by which an outline may lie off the common course."""


def settling_doubts(outlines: list[Outline]) -> list[str | None]:
    """Return what speaks against each outline of a run by how far the surface beside its bulge has sunk; None where nothing
    does.

    Args:
        outlines: All outlines above one zero plane, in any order.
    """
    heights, sunk = (np.array([getattr(outline, name) for outline in outlines]) for name in ("height", "sunk"))
    raised = heights > MIN_HEIGHT_RATIO * ON_SURFACE
    if not (raised & (np.abs(sunk) > TELLS)).any():
        return [None] * len(outlines)
    if raised.sum() < MIN_RAISED_OUTLINES:
        few = (
            "; with fewer than four photographs of the raised part, a soft body cannot be "
            "distinguished from one moved since the zero was taken"
        )
        return [_sentence(depth) + few if depth > ON_SURFACE else None for depth in sunk]
    common = course(heights[raised], sunk[raised], 0.2 * ON_SURFACE)
    start, tells = float(common(0.0)), max(TELLS, TELLS_SHARE * float(np.abs(sunk).max()))
    if abs(start) > tells:
        moved = (
            f"; by the other photographs it would lie {_length(start)} {'below' if start > 0.0 else 'above'} the "
            "plane without any pressure: the part, the lamp or the camera has moved since the zero was taken"
        )
        return [_sentence(depth) + moved if up else None for depth, up in zip(sunk, raised, strict=True)]
    found: list[str | None] = []
    for height, depth, up in zip(heights, sunk, raised, strict=True):
        off = depth - float(common(height))
        own = (
            f", {_length(off)} {'more' if off > 0.0 else 'less'} than expected from the other photographs: "
            f"the part was moved for this one"
        )
        found.append(_sentence(depth) + own if up and abs(off) > max(tells, SHARE * abs(depth)) else None)
    return found


def unknown(outlines: list[Outline]) -> list[float]:
    """Return how far in m each outline may lie off because too few photographs tell a soft body from one that was moved."""
    raised = [outline.height > MIN_HEIGHT_RATIO * ON_SURFACE for outline in outlines]
    few = sum(raised) < MIN_RAISED_OUTLINES
    return [outline.sunk if few and up else 0.0 for outline, up in zip(outlines, raised, strict=True)]


def _sentence(depth: float) -> str:
    where = f"{_length(depth)} {'below' if depth > 0.0 else 'above'}" if depth else "on"
    return f"beside the bulge the surface lies {where} the zero plane"


def _length(value: float) -> str:
    return f"{abs(value) * 1e3:.2f} mm" if abs(value) >= 95e-6 else f"{abs(value) * 1e6:.0f} um"


def course(heights: Array, values: Array, usual: float) -> np.polynomial.Polynomial:
    """Return the values (n,) over height (n,): a line, or a parabola where there are points enough, that none of them draws
    away.

    Args:
        heights: Heights in m.
        values: What follows them.
        usual: How far a value may lie off the course before it counts less.
    """
    scale = float(heights.max())
    terms = np.vander(heights / scale, 3 if len(heights) >= CURVED else 2, increasing=True)
    fit = least_squares(
        lambda c: (terms @ c - values) / usual,
        np.zeros(terms.shape[1]),
        loss="soft_l1",
        jac=lambda c: terms / usual,
    )
    return np.polynomial.Polynomial(fit.x / scale ** np.arange(terms.shape[1]))


# ----------------------------------------------------------------------------------------------------------------------
# Detect motion of the body along the light between the photographs of a run.
#
# Its shadow is then larger or smaller as a whole: its sides, which no pressure moves, lie farther apart or nearer than at zero
# pressure (`sides.py`). A soft body's sides may give way with the pressure, smoothly and in proportion; one that was moved
# after the zero photograph is larger by the same share at every height, and one that was moved once is larger that once.


BOUND = 10e-6
"""Error of the height in m that a change of scale may make unnoticed."""

OTHER_BODY = 0.5
"""Share of its width by which a body's shadow may be larger or smaller."""

CONTRADICTS = 4.0
"""Standard errors by which the body's width and the setup's own scale may differ."""


def scaling_doubts(outlines: list[Outline]) -> list[str | None]:
    """Return what speaks against each outline of a run by the width of the body; None where nothing does.

    Args:
        outlines: All outlines above one zero plane, in any order.
    """
    heights = np.array([outline.height for outline in outlines])
    larger = np.array([outline.scale - 1.0 for outline in outlines])
    told = (heights > MIN_HEIGHT_RATIO * ON_SURFACE) & np.isfinite(larger)
    found: list[str | None] = [None] * len(outlines)
    if not (np.abs(larger[told]) * heights[told] > BOUND).any():
        return found
    common = course(heights[told], larger[told], 1e-4) if told.sum() >= MIN_RAISED_OUTLINES else None
    start = 0.0 if common is None else float(common(0.0))
    for number in np.flatnonzero(told):
        own, high = float(larger[number]), float(heights[number])
        sentence = (
            f"the body's sides lie {abs(own):.2%} {'farther apart' if own > 0.0 else 'nearer'} than at zero pressure"
        )
        if common is None:
            if abs(own) * high > BOUND:
                found[number] = f"{sentence}: it was moved along the light, or its sides deform"
            continue
        off = own - float(common(high))
        if abs(start) * float(heights.max()) > BOUND and abs(start) > 0.1 * float(np.abs(larger[told]).max()):
            found[number] = (
                f"{sentence}, and by the other photographs they would do so without any pressure: the body, the lamp or the "
                "screen was moved along the light since the zero was taken"
            )
        elif abs(off) * high > max(BOUND, SHARE * abs(own) * high):
            found[number] = (
                f"{sentence}, unlike in the other photographs: the body was moved along the light for this one"
            )
    return found


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
