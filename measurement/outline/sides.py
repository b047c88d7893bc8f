"""The body's own width below its surface, where no pressure changes it: the scale of each photograph.

A body that comes nearer to the lamp throws a larger shadow, and its bulge seems higher. Its sides tell: their distance is
measured over the lowest part that the picture shows, nearest to the support and farthest from the bulge.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt
from scipy.ndimage import binary_erosion

from measurement.edge.smoothing import SPAN
from measurement.robust import deviation, robust_fit

Array = npt.NDArray[np.float64]

STEEP = 0.35
"""Cosine of the angle between an edge's normal and the surface's up to which the edge is a side of the body."""

DEPTH, BAND = 0.3e-3, 2e-3
"""Depth in m below the surface from which a side counts, and the height in m of its lowest part that is taken."""

FEWEST = 8
"""Points of each side."""

KIN = 5.0
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
        """Width in m at another depth nearby."""
        return self.width + self.lean * (depth - self.depth)


def sides_of(placed: Array, upwards: Array, error: Array) -> Sides | None:
    """The body's sides in one photograph; None where it does not show both.

    Args:
        placed: Measured edge as x along the surface and z above it in m, shape (n, 2).
        upwards: Cosine of the angle between the way to the light and the surface's normal, shape (n,).
        error: Standard errors in m, shape (n,).
    """
    steep = (np.abs(upwards) < STEEP) & (placed[:, 1] < -DEPTH)
    if steep.sum() < 2 * FEWEST:
        return None
    # Smoothing rounds the corner between surface and side, over half a span of points on either side of it.
    clear = steep & binary_erosion(np.abs(upwards) < STEEP, np.ones(SPAN + 1), border_value=1)
    steep = clear if clear.sum() >= 4 * FEWEST else steep
    middle = 0.5 * (placed[steep, 0].min() + placed[steep, 0].max())
    halves = [steep & (placed[:, 0] < middle), steep & (placed[:, 0] > middle)]
    if min(half.sum() for half in halves) < FEWEST:
        return None
    bottom = max(float(placed[half, 1].min()) for half in halves)
    top = min(bottom + BAND, -DEPTH)
    depth = 0.5 * (bottom + top)
    lines, variance = [], 0.0
    for half in halves:
        part = half & (placed[:, 1] >= bottom) & (placed[:, 1] <= top)
        if part.sum() < FEWEST:
            return None
        terms = np.column_stack([np.ones(int(part.sum())), placed[part, 1] - depth])
        line = robust_fit(terms, placed[part, 0], 6)
        variance += (deviation(line.rest) ** 2 + float(np.median(error[part])) ** 2) * KIN / float(part.sum())
        lines.append(line.coefficients)
    width, lean = lines[1] - lines[0]
    return Sides(depth, float(width), float(lean), float(np.sqrt(variance)))
