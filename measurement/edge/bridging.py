"""The edge smoothed along its own length where it was measured, and bridged where it was not.

Dust, a glint or a drop of water on the lens hide pieces of an edge. Smoothing over such a gap would draw the points beside it
into it and call them as good as the others, so each measured stretch is smoothed by itself. Between two of them a cubic goes
on from both ends in their directions. How far the true edge may lie off it grows with the gap's square: over a gap of the
length g a curvature that is wrong by k moves the edge by k t (1 - t) g^2 / 2 at the share t of the way.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt
from scipy.ndimage import binary_dilation
from scipy.signal import savgol_filter

from measurement.edge.edge import BETWEEN, Edge
from measurement.edge.smoothing import SPAN, robust_loess
from measurement.robust import deviations

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

MISSING = 6.0
"""Distance of neighbouring points, over the usual one, from which something is missing between them.

Over fewer a smoothed span of points goes on safely: a speck that takes them has been left out with all that it touches.
"""

DROPPED_BESIDE_GAP = 2
"""Points on each side of a gap that what made it has touched as well."""

SHORTEST = 12
"""Points of a stretch that can be smoothed by itself; shorter ones belong to the gap."""

BENDS = 0.5
"""Share of the outline's greatest curvature by which a bridge's curvature may be wrong."""

TURNS = 0.5
"""Cosine of the greatest angle between two ends that a bridge joins."""

REPEATED = 1.5
"""Neighbouring stations share noise (JPEG's blocks, dust), so a smoothed point is this much worse than if they did not."""

SHARPEST, BENT_ERROR = 0.08, 0.3
"""Curvature times width from which an edge has a corner and not a circle's penumbra; error of the shift as a share of it."""


@dataclasses.dataclass(frozen=True, eq=False)
class Line:
    """A smoothed edge.

    Attributes:
        px: Its points in order along it, shape (n, 2).
        normal: Unit vectors across it, from shadow to light, shape (n, 2).
        error: Standard error of each point across the edge in px, shape (n,).
        bridged: Which points lie in a gap, where nothing was measured, shape (n,).
    """

    px: Array
    normal: Array
    error: Array
    bridged: Mask


def smoothed(edge: Edge, longest: float) -> Line:
    """The edge as robust loess sees it, gaps bridged.

    Args:
        edge: The edge as it was found.
        longest: Length in px of the longest gap that is bridged; a longer one stays open.
    """
    step = np.linalg.norm(np.diff(edge.px, axis=0), axis=1)
    usual = float(np.median(step))
    parts = _stretches(step, usual)
    lines = [_stretch(edge, part) for part in parts]
    bend = _curvature(lines)
    joined: list[Line] = []
    for line in lines:
        if joined:
            bridge = _bridge(joined[-1], line, usual, bend, longest)
            joined += [] if bridge is None else [bridge]
        joined.append(line)
    return Line(
        *(np.concatenate([getattr(line, name) for line in joined]) for name in ("px", "normal", "error", "bridged"))
    )


def _stretches(step: Array, usual: float) -> list[slice]:
    """The pieces without a gap; one that is too short to be smoothed belongs to the gap."""
    breaks = np.flatnonzero(step > MISSING * usual) + 1
    firsts, lasts = np.r_[0, breaks], np.r_[breaks, len(step) + 1]
    parts = [
        slice(first + (DROPPED_BESIDE_GAP if first else 0), last - (DROPPED_BESIDE_GAP if last <= len(step) else 0))
        for first, last in zip(firsts.tolist(), lasts.tolist(), strict=True)
    ]
    long = [part for part in parts if part.stop - part.start >= SHORTEST]
    return long or [slice(0, len(step) + 1)]


def _stretch(edge: Edge, part: slice) -> Line:
    px = edge.px[part]
    arc = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(px, axis=0), axis=1))]
    arc = arc + np.arange(len(arc)) * 1e-9  # strictly rising even where two points coincide
    # Loess sees distances across a plain local quadratic through the points: along the edge there is nothing to smooth,
    # and an edge that runs along the pixels would leave it nothing but rounding errors.
    guide = savgol_filter(px, min(21, (len(arc) - 1) // 2 * 2 + 1), 2, axis=0)
    turn = np.gradient(guide, axis=0)
    across = np.column_stack([turn[:, 1], -turn[:, 0]]) / np.maximum(np.linalg.norm(turn, axis=1), 1e-12)[:, None]
    offset = np.einsum("ni,ni->n", px - guide, across)
    smooth = robust_loess(arc, offset)
    off = np.abs(offset - smooth.value)
    window = min(61, len(off) // 2 * 2 - 1)
    padded = np.pad(off, window // 2, mode="reflect")
    # A local median of what the curve leaves is the scatter that is really there, whatever its cause.
    local = deviations(np.lib.stride_tricks.sliding_window_view(padded, window), 1)
    gain = smooth.error / smooth.scatter
    gain = np.maximum(gain, float(np.median(gain)))  # the ends of a stretch have neighbours on one side only
    # What values between pixels lose of their scatter is in `REPEATED` already.
    error = REPEATED * gain * np.maximum(edge.error[part] / np.sqrt(BETWEEN), local)
    line, normal = guide + smooth.value[:, None] * across, edge.normal[part]
    bent = _bent(line, normal, edge.width[part])
    return Line(
        line + bent[:, None] * normal, normal, np.hypot(error, BENT_ERROR * bent), np.zeros(len(px), dtype=bool)
    )


def _bent(px: Array, normal: Array, width: Array) -> Array:
    """How far (n,) in px towards the light the edge lies from where half of the light is.

    A photograph is the silhouette under a blur, by the lamp's own shape and by the lens. On an edge of the curvature k a blur
    of the standard deviation s shifts half of the light by k s^2 / 2 towards the centre of curvature: more than half of the
    surroundings of a convex shadow are lit.
    """
    reach = SPAN // 2
    if len(px) < 4 * reach:
        return np.zeros(len(px))
    near, here, far = px[: -2 * reach], px[reach:-reach], px[2 * reach :]
    sagitta = np.einsum("ni,ni->n", here - 0.5 * (near + far), normal[reach:-reach])
    bend = np.pad(8.0 * sagitta / np.maximum(np.sum((far - near) ** 2, axis=1), 1e-9), reach, mode="edge")
    # Chords that reach over a corner do not show the curvature beside it.
    corner = binary_dilation(np.abs(bend) * width > SHARPEST, np.ones(2 * reach + 1))
    return np.where(corner, 0.0, 0.5 * bend * width**2)


def _curvature(lines: list[Line]) -> float:
    """The greatest curvature of the smoothed edge in 1/px, but for single corners."""
    found = [np.zeros(1)]
    for line in lines:
        if len(line.px) > 4 * SPAN:
            # Over two spans of points noise bends nothing any more.
            near, here, far = line.px[: -2 * SPAN], line.px[SPAN:-SPAN], line.px[2 * SPAN :]
            chord = far - near
            length = np.maximum(np.linalg.norm(chord, axis=1), 1e-9)
            sagitta = np.abs(chord[:, 0] * (here - near)[:, 1] - chord[:, 1] * (here - near)[:, 0]) / length
            found.append(8.0 * sagitta / length**2)
    return float(np.percentile(np.concatenate(found), 90))


def _bridge(before: Line, after: Line, usual: float, bend: float, longest: float) -> Line | None:
    """A cubic over the gap between two stretches; None where it would be a guess."""
    start, end = before.px[-1], after.px[0]
    gap = float(np.linalg.norm(end - start))
    count = round(gap / usual) - 1
    leave, arrive = _direction(before.px[::-1]) * -1.0, _direction(after.px)
    way = (end - start) / max(gap, 1e-9)
    if count < 1 or gap > longest or min(leave @ way, arrive @ way) < TURNS:
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
    lean = (before.error[-1] + after.error[0]) / (0.5 * SPAN * usual) * gap * share * (1 - share)
    error = np.sqrt(ends**2 + lean**2 + (0.5 * BENDS * bend * share * (1 - share) * gap**2) ** 2)
    return Line(px, normal, error, np.ones(count, dtype=bool))


def _direction(px: Array) -> Array:
    """Unit vector (2,) along a stretch at its first point, from a quadratic through a span of points."""
    part = px[:SPAN]
    at = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(part, axis=0), axis=1))]
    slope = np.polynomial.polynomial.polyfit(at, part, 2)[1]
    return np.asarray(slope / np.linalg.norm(slope))
