"""Is this edge the outline of one inflated surface that stands where the zero plane was taken?

An edge can be found to a hundredth of a pixel and still be something else's: a hair on the membrane, a finger before the
lamp, a drop, a glint that eats into the shadow, or the right actuator in another place. What tells them apart is known of
every inflated surface: beside the bulge it lies where it lay at zero pressure or a little lower, and above it the membrane
bends alike from one place to the next. A corner there belongs to a second thing.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from measurement.camera.pixels import Unmeasurable
from measurement.outline.zero import ZeroLine
from measurement.robust import deviation

Array = npt.NDArray[np.float64]
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
"""Least width at half height of what stands on the surface, as a share of the surface that is seen."""


def check_top(placed: Array, above: Mask, upwards: Array, error: Array) -> None:
    """Refuse an outline whose highest place is none of a surface seen from the side.

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
            "the shadow's highest place is no rounded top: it hangs from above, or something is in the light; clear it "
            "away, turn the picture upright before setup and photos, or leave it out with setup --roi"
        )
    if standing and min(top - kept[0], kept[-1] - top) < 5:
        raise Unmeasurable(
            "the outline ends at its highest point: part of it is hidden or outside of the picture; aim the camera at "
            "all of it, and clear away what hides it"
        )
    if not standing and np.median(upwards[above]) < 0.5:
        raise Unmeasurable(
            "what lies on the surface's line is no level edge: the actuator has moved or is not in the picture; "
            "photograph it at zero pressure again and list that"
        )
    if placed[above, 1].max() - placed[above, 1].min() > 2.0 * np.ptp(placed[above, 0]):
        raise Unmeasurable(
            "the shadow stands more than twice as high as it is wide: this is no inflated surface; leave out what else "
            "throws a shadow with setup --roi"
        )


def displacement(placed: Array, upwards: Array, error: Array, zero: ZeroLine) -> tuple[float, float, str | None]:
    """How far the surface beside the bulge lies from the zero plane.

    A soft body that bulges takes the rubber beside the bulge inwards, so that its surface may sink there by a share of the
    height. That much is no mistake as long as the other photographs of the run agree (`settling.py`).

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
        Unmeasurable: It lies so far off that heights mean nothing.
    """
    seen = (placed[:, 0] >= zero.extent[0]) & (placed[:, 0] <= zero.extent[1])
    if not seen.any():
        raise Unmeasurable(
            "the shadow lies beside the surface at zero pressure: the actuator has moved, or the zero is wrong; "
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
    # No pressure lifts the surface; a soft body that was lifted sinks back as it rises (`settling.py` needs to see both).
    sunk = sunk if sunk > 0.0 else -max(worst, 0.0)
    return sunk, max(abs(worst), aslant), sentence if abs(worst) > max(ON_SURFACE, tolerance) else None


def _aslant(placed: Array, upwards: Array, error: Array, zero: ZeroLine) -> float:
    """Half of what one end of the surface lies lower than the other in m; 0 where that cannot be told from none.

    A body sinks alike at both of its sides, and by any depth, so that only their difference shows one that was tilted. About
    which of its points is not known, and so by how much its middle was lifted: by no more than its ends.

    Args:
        placed: Edge as in `check_top`, as far as the zero was seen.
        upwards: As in `check_top`.
        error: Standard errors in m, shape (n,).
        zero: The zero plane; without the body's sides nothing tells where its middle is.
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
    """What speaks for a second thing in the shadow's edge, by the edge's turns.

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
    """What speaks against a bulge much narrower than the surface it stands on: dust, a drop, a blister.

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
    return f"what stands on the surface is only {width * 1e3:.1f} mm wide at half its height: dust, a drop or another thing"


def check_clear(placed: Array, error: Array) -> str | None:
    """What speaks against a highest place that is much less clear than the rest of the outline.

    Args:
        placed: Edge as x along the surface and z above it in m, shape (n, 2).
        error: Standard errors in m, shape (n,).
    """
    own, usual = float(error[np.argmax(placed[:, 1])]), float(np.median(error))
    if own < max(BLURRED * usual, UNCLEAR):
        return None
    return f"the edge is unclear at its highest place: {own * 1e6:.0f} um there, {usual * 1e6:.0f} um elsewhere"


def sharpest_turn(placed: Array) -> tuple[int, float]:
    """Where the edge turns most beyond its neighbourhood, and by how many degrees; 0 where no turn stands out.

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
    """Angle (n,) in rad between straight lines through the edge within a window behind and before each place."""
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
    """Places (n,) along the edge within reach of a chosen one."""
    at = arc[chosen]
    if not len(at):
        return np.zeros(len(arc), dtype=bool)
    index = np.searchsorted(at, arc)
    before, after = at[np.clip(index - 1, 0, len(at) - 1)], at[np.clip(index, 0, len(at) - 1)]
    return np.asarray(np.minimum(np.abs(arc - before), np.abs(arc - after)) < reach)
