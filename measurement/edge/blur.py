"""A patch of the edge that is more blurred than the rest: a drop of water or fat on the lens.

Such a drop is a lens of its own. It moves the edge that is seen through it by up to some tenths of a millimetre, smoothly, so
that no corner or bump shows it at a low bulge. But what is seen through it is out of focus. The width of the edge by itself
changes only slowly: with the place (a lens' focus, the body's distance) and with the edge's direction (a lamp that is not
round).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from measurement.edge.edge import Edge
from measurement.robust import deviation

Array = npt.NDArray[np.float64]

WINDOW, FEWEST = 1.2e-3, 15
"""Length in m and least number of points over which the width's median is taken: corners and dust are shorter."""

LEAST, NOISES = 0.12, 8.0
"""Logarithm of the width over its smooth course, and the same in its own scatter, from which a patch is blurred."""


def check_blur(edge: Edge, scale: float) -> str | None:
    """What speaks for a drop or fat on the lens before a part of the edge.

    Args:
        edge: The edge as it was found.
        scale: Length in m of a pixel.
    """
    more, scatter = widest_patch(edge, scale)
    if more <= max(LEAST, NOISES * scatter):
        return None
    return (
        f"a part of the edge is {np.expm1(more):.0%} more blurred than the rest: a drop or fat on the lens, which moves it as "
        "well, or something else than the body throws the shadow there"
    )


def widest_patch(edge: Edge, scale: float) -> tuple[float, float]:
    """Logarithm of the most blurred patch's width over what the rest of the edge leads one to expect, and its scatter."""
    if len(edge.px) < 6 * FEWEST:
        return 0.0, 0.0
    place = (edge.px - edge.px.mean(axis=0)) / np.ptp(edge.px, axis=0).max()
    x, z = place.T
    # The normal's doubled angle: an oblong lamp blurs opposite sides alike.
    turn = 2.0 * np.arctan2(edge.normal[:, 1], edge.normal[:, 0])
    terms = np.column_stack([np.ones(len(x)), x, z, x**2, np.cos(turn), np.sin(turn)])
    width = np.log(edge.width)
    usual = deviation(width - np.median(width)) + 1e-3
    start = np.r_[np.median(width), np.zeros(terms.shape[1] - 1)]
    fit = least_squares(lambda c: (terms @ c - width) / usual, start, jac=lambda c: terms / usual, loss="cauchy").x
    rest = width - terms @ fit
    spacing = float(np.median(np.linalg.norm(np.diff(edge.px, axis=0), axis=1))) * scale
    count = min(max(FEWEST, round(WINDOW / spacing)), len(rest) // 3)
    smooth = np.median(np.lib.stride_tricks.sliding_window_view(rest, count), axis=1)
    return float(smooth.max()), deviation(smooth - np.median(smooth))
