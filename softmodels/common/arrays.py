"""Arrays of numbers, as annotations name them, and vectors as tuples."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def triple(vector: ArrayLike) -> tuple[float, float, float]:
    """Return the three entries of a vector."""
    x, y, z = np.asarray(vector, dtype=float).tolist()
    return x, y, z
