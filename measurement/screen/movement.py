"""Has the camera or the screen moved since the setup?

The printed grid tells: an affine movement of its lines is the camera's or the screen's, and what it leaves of their shifts is
noise, dust, or another setup.
"""

from __future__ import annotations

import numpy as np

from measurement.camera.pixels import Unmeasurable
from measurement.robust import robust_fit
from measurement.screen.grid_look import GridLook

MOVED = 15e-6
"""Movement of the screen's picture in m since the setup from which a photograph is refused, or `MOVED_PX` if that is more."""

MOVED_PX = 0.5

GRID_SEEN, FEWEST = 0.4, 24
"""Least share of the grid's expected lines that must be visible, and least number of places where one was seen."""

GRID_REST = 60e-6
"""Greatest scatter in m of the grid's lines about where they should be, or `GRID_REST_PX` if that is more."""

GRID_REST_PX = 1.5


def movement(look: GridLook) -> tuple[float, float]:
    """How far the picture of the screen has moved since the setup, and what of the shifts that leaves, both in m.

    Returns:
        Root mean square of the affine movement that fits the shifts best, over the places where lines were seen, and
        the root mean square of the rest; infinite where too few lines were seen.
    """
    moved2, rest2 = 0.0, 0.0
    for axis in (0, 1):
        mine = look.axis == axis
        if mine.sum() < FEWEST // 2:
            return np.inf, np.inf
        fit = robust_fit(look.affine_terms(mine), look.shift[mine], 6)
        moved2 += float(np.mean(fit.value**2))
        rest2 += float(np.mean(np.minimum(fit.rest, 5.0 * fit.scatter) ** 2))
    return np.sqrt(moved2), np.sqrt(rest2)


def check_movement(look: GridLook, magnification: float, pixel: float) -> float:
    """Refuse a photograph whose grid is not where the setup has it.

    Args:
        look: What it shows of the grid.
        magnification: The shadow's.
        pixel: Length in m of a pixel in the object's plane.

    Returns:
        The movement in m, in the object's plane.

    Raises:
        Unmeasurable: With the reason.
    """
    if look.seen < GRID_SEEN or len(look.shift) < FEWEST:
        raise Unmeasurable(
            f"the grid is not where the setup has it ({look.seen:.0%} of its lines are seen): the camera or the screen has "
            "moved, the picture is turned or mirrored, or the grid cannot be seen; photograph the grid again and run setup anew"
        )
    moved, rest = (value / magnification for value in movement(look))
    if not np.isfinite(moved):
        raise Unmeasurable(
            "too few of the grid's lines are seen beside the shadow, along one of their two directions, to check whether the "
            "camera has moved; show more of the grid, or take one with a smaller pitch"
        )
    if not moved <= max(MOVED, MOVED_PX * pixel):
        raise Unmeasurable(
            f"the camera or the screen has moved by {moved * 1e6:.0f} um since the setup or during the exposure, or the "
            "picture is turned, mirrored, cropped or too noisy; photograph the grid again from where the camera stands "
            "now and run setup anew"
        )
    if not rest <= max(GRID_REST, GRID_REST_PX * pixel):
        raise Unmeasurable(
            f"the grid's lines lie {rest * 1e6:.0f} um off: the picture is too noisy, too much compressed or too dusty to "
            "see them, the screen has bent, or this is another setup; clean and flatten the screen, and photograph "
            "grid and body again"
        )
    return moved
