"""What the shape of an edge above the zero plane shows of it: where it lies, how it turns, its bumps and its gaps.

An edge can be found to a hundredth of a pixel and still be something else's: a hair on the membrane, a finger before the
lamp, a drop, a glint that eats into the shadow, or the right actuator in another place. What distinguishes them is known of
every inflated surface: beside the bulge it lies where it lay at zero pressure or a little lower, and above it the membrane
bends alike from one place to the next. A corner there belongs to a second thing. `series.checks` judges by these numbers.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt
from scipy.ndimage import binary_dilation
from scipy.signal import savgol_filter

from measurement.edge.edge import SPAN
from measurement.outline.zero import SIDE_BAND, ZeroLine, sides_of
from measurement.robust import deviation
from softmodels.common.arrays import Array

Mask = npt.NDArray[np.bool_]

ON_SURFACE = 50e-6
"""Distance in m within which an edge counts as the surface itself."""

LEVEL = 0.94
"""Cosine of the steepest angle at which an edge may be the surface beside the bulge."""

ENDS = 0.12
"""Share of the surface's length at each of its ends that stays where it was, however high the middle rises."""

UNCLEAR = 10e-6
"""Distance in m of those ends from the zero plane up to which they show nothing."""

SETTLES = 0.25
"""Share of the height by which a soft body's surface may sink beside its bulge; thick disks have an eighth."""

SIDE = 0.5
"""Cosine of the angle to the surface from which an edge is the body's side."""

WINDOW, WINDOW_SHARE = 0.8e-3, 0.04
"""Length of edge on each side of a place over which its direction is taken: in m at most, and as a share of the bulge's
width; `FEWEST_STATIONS` at least."""

FEWEST_STATIONS = 6


@dataclasses.dataclass(frozen=True)
class Displacement:
    """How far the surface beside the bulge lies from the zero plane.

    A soft body that bulges takes the rubber beside the bulge inwards, so that its surface may sink there by a share of the
    height. That much is no mistake as long as the other photographs of the run agree.

    Attributes:
        off: Distance in m by which it lies off where no soft body does, negative below.
        tolerance: Distance in m up to which that is the edge's own error.
        aslant: Half of what one end lies lower than the other in m; 0 where that cannot be told from none.
        sunk: How far in m it has sunk where a soft body may, negative if it has risen, 0 if that is within the measurement's
            own error.
    """

    off: float
    tolerance: float
    aslant: float
    sunk: float

    @classmethod
    def of(cls, placed: Array, upwards: Array, error: Array, zero: ZeroLine) -> Displacement | None:
        """Return that of an edge; None where it lies beside the surface of the zero photograph.

        Args:
            placed: Edge as x along the surface and z above it in m, in order along the edge, shape (n, 2).
            upwards: Cosine of the angle between the way to the light and the surface's normal, shape (n,).
            error: Standard errors in m, shape (n,).
            zero: The zero plane.
        """
        seen = (placed[:, 0] >= zero.extent[0]) & (placed[:, 0] <= zero.extent[1])
        if not seen.any():
            return None
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
        if abs(worst) > max(UNCLEAR, tolerance) and not sunk:
            # No pressure lifts the surface; a soft body that was lifted sinks back as it rises, and its run shows both.
            sunk = -max(worst, 0.0)
        return cls(worst, tolerance, aslant(placed[seen], upwards[seen], error[seen], zero), sunk)

    @property
    def seen(self) -> bool:
        """Whether it lies off at all, beyond the edge's own error."""
        return abs(self.off) > max(UNCLEAR, self.tolerance)

    @property
    def error(self) -> float:
        """Distance in m by which the outline may lie off."""
        return max(abs(self.off), self.aslant) if self.seen else self.aslant


def aslant(placed: Array, upwards: Array, error: Array, zero: ZeroLine) -> float:
    """Return half of what one end of the surface lies lower than the other in m; 0 where that cannot be told from none.

    A body sinks alike at both of its sides, and by any depth, so that only their difference shows one that was tilted. About
    which of its points is not known, and so by how much its middle was lifted: by no more than its ends.

    Args:
        placed: Edge as in `Displacement.of`, as far as the zero was seen.
        upwards: As in `Displacement.of`.
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


def scale_of(
    placed: Array, upwards: Array, error: Array, bridged: npt.NDArray[np.bool_], zero: ZeroLine
) -> tuple[float, float]:
    """Return the body's width over that at zero pressure, NaN where it is not seen, and the heights' relative error by it."""
    seen = ~bridged
    sides = sides_of(placed[seen], upwards[seen], error[seen])
    if sides is None or zero.sides is None or abs(sides.depth - zero.sides.depth) > SIDE_BAND:
        return np.nan, 0.0
    scale = sides.width_at(zero.sides.depth) / zero.sides.width
    own = np.hypot(sides.error, zero.sides.error) / zero.sides.width
    return scale, float(np.sqrt(max(0.0, (scale - 1.0) ** 2 - (2.0 * own) ** 2)))


def rounded(placed: Array, upwards: Array) -> npt.NDArray[np.bool_]:
    """Return the points (n,) of the surface so near to the body's side that smoothing has rounded the corner between the
    two."""
    side = (upwards < SIDE).astype(np.uint8)
    near = np.convolve(side, np.ones(SPAN + 5, dtype=np.uint8), mode="same") > 0
    return near & (np.abs(placed[:, 1]) < 3.0 * ON_SURFACE)


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

SHORT_AVERAGE_POINTS = 7
"""Points in the short average, and twice as many in the long one, for the two to differ."""


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
