"""Vectors of a mesh and of its device: an axisymmetric section has radius and height alone."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def in_section(direction: npt.ArrayLike, dimension: int) -> Array:
    """A direction of device coordinates in those of the mesh."""
    d = np.asarray(direction, dtype=float)
    return d if dimension == 3 else d[[0, 2]]


def in_space(vectors: Array) -> Array:
    """Vectors of the mesh, shape (..., d), in device coordinates, shape (..., 3)."""
    if vectors.shape[-1] == 3:
        return vectors
    return np.stack([vectors[..., 0], np.zeros(vectors.shape[:-1]), vectors[..., 1]], axis=-1)
