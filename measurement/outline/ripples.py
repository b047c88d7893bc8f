"""Bumps and steps in an outline that are narrower than a membrane can bend.

A fibre that lies along the top, a grain, a drop on the lens or a bulge of the screen lift a part of the edge by some tens of
micrometres: too little for a corner, and each point of it is as clear as the others. But an inflated membrane is smooth over
millimetres. So the edge averaged over half a millimetre must lie where a polynomial through a few millimetres of it lies.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.ndimage import binary_dilation
from scipy.signal import savgol_filter

from measurement.outline.shape import ON_SURFACE
from measurement.robust import deviation

Array = npt.NDArray[np.float64]

NEAR, FAR = 0.5e-3, 4e-3
"""Lengths in m of edge that are averaged, and over which a membrane is a polynomial of the fifth degree, to a micrometre."""

FAR_SHARE = 0.22
"""The latter as a share of the bulge's width, if that is less."""

LEAST, NOISES = 15e-6, 8.0
"""Distance in m between the two, and the same in its own scatter, from which something else than a membrane is seen."""

STATED = 4.5
"""Such a distance in its own scatter from which the stated error has to carry it: the largest of good outlines reach 4."""

FEWEST = 7
"""Points in the short average, and twice as many in the long one, for the two to differ."""


def check_ripples(placed: Array) -> str | None:
    """What speaks for a second thing on the outline by its bumps.

    Args:
        placed: Edge as x along the surface and z above it in m, as found and not smoothed, in order, shape (n, 2).
    """
    place, height, scatter = highest_ripple(placed)
    if abs(height) <= max(LEAST, NOISES * scatter):
        return None
    return (
        f"{placed[place, 1] * 1e3:.1f} mm above the surface the outline has a {'bump' if height > 0.0 else 'hollow'} of "
        f"{abs(height) * 1e6:.0f} um that is narrower than a membrane bends: a fibre, a grain or a drop lies on it or on the "
        "lens, or the screen is not flat"
    )


def unsure(placed: Array) -> float:
    """Error in m that a bump too low for `check_ripples` leaves: a thing of that height may lie on any length of the outline.

    Args:
        placed: Edge as in `check_ripples`.
    """
    _, height, scatter = highest_ripple(placed)
    return abs(height) if abs(height) > STATED * scatter else 0.0


def highest_ripple(placed: Array) -> tuple[int, float, float]:
    """Index of the point where the edge lies farthest off its neighbourhood, how far in m, and the usual distance in m.

    Only what rises counts: where a membrane is clamped, or a body ends, the edge may turn at any angle.
    """
    step = np.linalg.norm(np.diff(placed, axis=0), axis=1)
    arc, spacing = np.r_[0.0, np.cumsum(step)], float(np.median(step))
    raised = placed[placed[:, 1] >= 0.1 * max(placed[:, 1].max(), 0.0), 0]
    if not len(raised):
        return 0, 0.0, 0.0
    far = _odd(min(FAR, FAR_SHARE * float(np.ptp(raised))) / spacing)
    near = max(FEWEST, _odd(min(NEAR / spacing, 0.3 * far)))
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
