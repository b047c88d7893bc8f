"""The distance from a sphere, a cylinder or a capsule: the places nearer than a radius to a point, a line, a piece of one.

A plane's is along its normal.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from softmodels.mechanics.section_axes import in_space

Array = npt.NDArray[np.float64]

type Numbers = tuple[Array, Array, float | None, float, float]
"""Place of its middle, direction of its line, radius, half the line's length, and 1 or, of a hollow one, -1; in sizes.

Of a plane a point, its normal, and no radius.
"""

SPECK = 1e-20
"""Added to squared distances, in squared sizes: the distance from a line has no slope on the line itself."""


def distance(x: Sequence[Array], numbers: Numbers) -> Array:
    """Signed distance of a place in sizes, from components of NumPy or of UFL alike; below zero where it is stopped.

    Args:
        x: Three components in sizes.
        numbers: Of the shape, or UFL constants in their place.
    """
    at, along, radius, half, sign = numbers
    v = [x[i] - at[i] for i in range(3)]
    t = v[0] * along[0] + v[1] * along[1] + v[2] * along[2]
    if radius is None:
        return sign * t
    t = (abs(t + half) - abs(t - half)) / 2  # no further than its ends
    v = [v[i] - t * along[i] for i in range(3)]
    return sign * ((v[0] ** 2 + v[1] ** 2 + v[2] ** 2 + SPECK) ** 0.5 - radius)


def distances(places: Array, numbers: Numbers) -> Array:
    """`distance` of places in sizes, shape (n, d)."""
    return np.asarray(distance(list(in_space(places).T), numbers))


def slopes(places: Array, numbers: Numbers) -> tuple[Array, Array, Array]:
    """Distances of places in sizes, shape (n, d), their gradients (n, d), and their second derivatives (n, d, d)."""
    at, along, radius, half, sign = numbers
    v = in_space(places) - at
    t = v @ along
    shown = [0, 1, 2] if places.shape[1] == 3 else [0, 2]
    if radius is None:
        count, d = places.shape
        return sign * t, np.tile(sign * along[shown], (count, 1)), np.zeros((count, d, d))
    beside = np.abs(t) < half
    v = v - np.clip(t, -half, half)[:, None] * along
    far = np.sqrt((v**2).sum(axis=1) + SPECK)
    way = v / far[:, None]
    square = np.eye(3) - np.where(beside[:, None, None], np.outer(along, along), 0.0)
    second = (square - way[:, :, None] * way[:, None, :]) / far[:, None, None]
    return sign * (far - radius), sign * way[:, shown], sign * second[:, shown][:, :, shown]
