"""Points on the outline of a body of revolution, at the same share of the same edge of another one's."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from geometries.errors import GeometryError
from geometries.fields import shown

Array = NDArray[np.float64]

FARTHEST = 0.05
"""How far from the outline a point may be in sizes of the device: nodes that a mesher put on chords are a little inside."""


class Edge(Protocol):
    """A piece of an outline."""

    def places(self, shares: Array) -> Array:
        """Places (n, 2) at shares (n,) of it."""

    def shares(self, points: Array) -> Array:
        """Shares (n,) at which places (n, 2) on it are; those of places beyond an end are 0 or 1."""


def carried_along(edges: Sequence[Edge], others: Sequence[Edge], points: Array, size: float) -> Array:
    """Where points on the boundary lie on another body of revolution; see `geometries.Actuator.carried`.

    Args:
        edges: The outline in (radius, height), in m.
        others: The other one's, edge by edge.
        points: Device coordinates in m, shape (n, 3).
        size: Of the device, m.

    Returns:
        Shape (n, 3): turned by no angle around the axis.

    Raises:
        GeometryError: A point is not on the boundary.
    """
    points = np.array(points, dtype=float).reshape(-1, 3)
    radii = np.hypot(points[:, 0], points[:, 1])
    flat = np.column_stack([radii, points[:, 2]])
    shares = [edge.shares(flat) for edge in edges]
    at = np.stack([edge.places(share) for edge, share in zip(edges, shares, strict=True)])
    missed = np.linalg.norm(at - flat, axis=2)
    nearest = missed.argmin(axis=0)
    _check_near(points, missed.min(axis=0, initial=np.inf), size)
    # What is added is zero for the same device, whatever the rounding; a node beside the outline stays beside it.
    shift = np.zeros_like(flat)
    for k, (edge, share) in enumerate(zip(others, shares, strict=True)):
        here = nearest == k
        shift[here] = edge.places(share[here]) - at[k, here]
    off_axis = radii > 1e-12 * size
    points[off_axis, :2] *= (1.0 + shift[off_axis, 0] / radii[off_axis])[:, None]
    points[:, 2] += shift[:, 1]
    return points


def _check_near(points: Array, missed: Array, size: float) -> None:
    if len(points) and missed.max() > FARTHEST * size:
        place = ", ".join(f"{1e3 * value:.4g}" for value in points[missed.argmax()])
        raise GeometryError(
            f"the point ({place}) mm is not on the device's boundary but {shown(float(missed.max()), 'm')} from it; only "
            "points of the boundary can be carried"
        )
