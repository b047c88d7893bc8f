"""Has the surface beside the bulge sunk because the body is soft, or because it was moved?

Under pressure a soft body draws in the rubber beside its bulge. How far grows smoothly with the height and vanishes with it,
from one photograph of a run to the next. A body that was moved after the zero photograph lies off by the same distance at
every height, and one that was moved for a single photograph lies off in that one.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from measurement.outline.outline import Outline
from measurement.outline.shape import ON_SURFACE

Array = npt.NDArray[np.float64]

FEWEST = 4
"""Raised outlines from which their common course can be told from a body that was moved."""

CURVED = 6
"""Raised outlines from which the course may bend."""

LEAST = 5.0
"""Heights below this many times `ON_SURFACE` tell nothing of the course."""

TELLS, TELLS_SHARE = 15e-6, 0.05
"""Distance in m from a common course, and as a share of the deepest sinking, that tells of a body that was moved."""

SHARE = 0.2
"""Share of its own sinking by which an outline may lie off the common course."""


def doubts(outlines: list[Outline]) -> list[str | None]:
    """What speaks against each outline of a run by how far the surface beside its bulge has sunk; None where nothing does.

    Args:
        outlines: All outlines above one zero plane, in any order.
    """
    heights, sunk = (np.array([getattr(outline, name) for outline in outlines]) for name in ("height", "sunk"))
    raised = heights > LEAST * ON_SURFACE
    if not (raised & (np.abs(sunk) > TELLS)).any():
        return [None] * len(outlines)
    if raised.sum() < FEWEST:
        few = (
            "; with fewer than four photographs of the raised part nothing tells whether that is the soft body's own or "
            "whether it was moved since the zero was taken"
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
            f", {_length(off)} {'more' if off > 0.0 else 'less'} than the other photographs lead one to expect: the "
            "part was moved for this one"
        )
        found.append(_sentence(depth) + own if up and abs(off) > max(tells, SHARE * abs(depth)) else None)
    return found


def unknown(outlines: list[Outline]) -> list[float]:
    """How far in m each outline may lie off because too few photographs tell a soft body from one that was moved."""
    raised = [outline.height > LEAST * ON_SURFACE for outline in outlines]
    few = sum(raised) < FEWEST
    return [outline.sunk if few and up else 0.0 for outline, up in zip(outlines, raised, strict=True)]


def _sentence(depth: float) -> str:
    where = f"{_length(depth)} {'below' if depth > 0.0 else 'above'}" if depth else "on"
    return f"beside the bulge the surface lies {where} the zero plane"


def _length(value: float) -> str:
    return f"{abs(value) * 1e3:.2f} mm" if abs(value) >= 95e-6 else f"{abs(value) * 1e6:.0f} um"


def course(heights: Array, values: Array, usual: float) -> np.polynomial.Polynomial:
    """Values (n,) over height (n,): a line, or a parabola where there are points enough, that none of them draws away.

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
