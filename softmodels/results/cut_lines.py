"""The outside of a device cut by a plane: the line that was there at rest, and where it has gone."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from geometries.actuator import Vector
from softmodels.results.skin import OUTSIDE, Skin

Array = npt.NDArray[np.float64]

BESIDE = 1e-7
"""The cut is made this share of the device's size beside the plane, so that vertices in it, as of a symmetry, do no harm."""


def cut_line(skin: Skin, points: Array, displacement: Array, normal: Vector, at: float, size: float) -> Array:
    """Pieces of the outside's cut as it has moved, in device coordinates (m), shape (k, 2, 3).

    Args:
        skin: The device's surface.
        points: Undeformed nodes, m, shape (n, 3).
        displacement: Of the nodes, m, shape (n, 3).
        normal: Unit normal of the plane that cuts the undeformed device.
        at: Its distance from the origin in m.
        size: Of the device in m.
    """
    rest, moved = (skin.device(skin.points(nodal)) for nodal in (points, points + displacement))
    triangles = skin.device_triangles(skin.part == OUTSIDE)
    height = rest @ np.asarray(normal) - at - BESIDE * size
    above = height[triangles] > 0.0
    hit = triangles[above.any(axis=1) & ~above.all(axis=1)]
    pieces = np.empty((len(hit), 2, 3))
    count = np.zeros(len(hit), dtype=int)
    for a, b in ((0, 1), (1, 2), (2, 0)):
        one, two = hit[:, a], hit[:, b]
        rows = np.flatnonzero((height[one] > 0.0) != (height[two] > 0.0))
        one, two = one[rows], two[rows]
        share = (height[one] / (height[one] - height[two]))[:, None]
        pieces[rows, count[rows]] = moved[one] + share * (moved[two] - moved[one])
        count[rows] += 1
    return pieces


def axes_of(normal: Vector, lift: Vector) -> Array:
    """Two unit vectors in a plane, shape (2, 3): to the right, mostly along x or y, and upwards along the lift or y."""
    n = np.asarray(normal)
    for up in (np.asarray(lift), np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])):
        across = up - (up @ n) * n
        if np.linalg.norm(across) > 0.1:
            break
    across = across / np.linalg.norm(across)
    right = np.cross(across, n)
    return np.array([right if right[np.argmax(np.abs(right))] > 0.0 else -right, across])
