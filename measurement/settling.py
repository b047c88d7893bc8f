"""Has the surface beside the bulge sunk because the body is soft, or because it was moved?

Under pressure a soft body draws in the rubber beside its bulge. How far grows smoothly with the height and vanishes with it,
from one photograph of a run to the next. A body that was moved after the zero photograph lies off by the same distance at
every height, and one that was moved for a single photograph lies off in that one.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from measurement.outline import Outline
from measurement.shape import ON_SURFACE

Array = npt.NDArray[np.float64]

FEWEST = 4
"""Raised outlines from which their common course can be told from a body that was moved."""

CURVED = 6
"""Raised outlines from which the course may bend."""

LEAST = 5.0
"""Heights below this many times `ON_SURFACE` tell nothing of the course."""

SHARE = 0.2
"""Share of its own sinking by which an outline may lie off the common course."""


def doubts(outlines: list[Outline]) -> list[str | None]:
    """What speaks against each outline of a run by how far the surface beside its bulge has sunk; None where nothing does.

    Args:
        outlines: All outlines above one zero plane, in any order.
    """
    heights, sunk = (np.array([getattr(outline, name) for outline in outlines]) for name in ("height", "sunk"))
    raised = heights > LEAST * ON_SURFACE
    if not (raised & (sunk > ON_SURFACE)).any():
        return [None] * len(outlines)
    if raised.sum() < FEWEST:
        few = (
            "; with fewer than four photographs of the raised part nothing tells whether that is the soft body's own or "
            "whether it was moved since the zero was taken"
        )
        return [_sentence(depth) + few if depth > ON_SURFACE else None for depth in sunk]
    course = _course(heights[raised], sunk[raised])
    start = float(course(0.0))
    if abs(start) > ON_SURFACE:
        moved = (
            f"; by the other photographs it would lie {abs(start) * 1e3:.2f} mm {'below' if start > 0.0 else 'above'} the "
            "plane without any pressure: the part, the lamp or the camera has moved since the zero was taken"
        )
        return [_sentence(depth) + moved if up else None for depth, up in zip(sunk, raised, strict=True)]
    found: list[str | None] = []
    for height, depth, up in zip(heights, sunk, raised, strict=True):
        off = depth - float(course(height))
        own = (
            f", {abs(off) * 1e3:.2f} mm {'more' if off > 0.0 else 'less'} than the other photographs lead one to expect: the "
            "part was moved for this one"
        )
        found.append(_sentence(depth) + own if up and abs(off) > max(ON_SURFACE, SHARE * depth) else None)
    return found


def _sentence(depth: float) -> str:
    return f"beside the bulge the surface lies {depth * 1e3:.2f} mm below the zero plane"


def _course(heights: Array, sunk: Array) -> np.polynomial.Polynomial:
    """Sinking over height: a line, or a parabola where there are points enough, that single outlines do not draw away."""
    scale = float(heights.max())
    terms = np.vander(heights / scale, 3 if len(heights) >= CURVED else 2, increasing=True)
    fit = least_squares(
        lambda c: (terms @ c - sunk) / (0.2 * ON_SURFACE),
        np.zeros(terms.shape[1]),
        loss="soft_l1",
        jac=lambda c: terms / (0.2 * ON_SURFACE),
    )
    return np.polynomial.Polynomial(fit.x / scale ** np.arange(terms.shape[1]))
