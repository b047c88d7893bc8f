"""The peak of a field over a body: its mean over the 0.5 % of the volume where it is largest.

The largest value at a point does not converge where a mesh has a sharp corner or a clamped edge: it grows with every
refinement, and on two meshes of one size it differs by chance. The mean over a share of the volume does converge, because the
singularity can be integrated. It is the conditional value at risk of Rockafellar and Uryasev 2000 (doi 10.21314/JOR.2000.038),

    min over q of  q + 1/(share V) int max(v - q, 0) dV,

whose derivative by the field is taken at fixed q. The kink of max(x, 0) is rounded within `ROUNDED` of q, which raises the
peak by less than that share, so that the derivative is continuous.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from softmodels.mechanics.mpi import largest, total

if TYPE_CHECKING:
    from mpi4py import MPI

Array = npt.NDArray[np.float64]

SHARE = 0.005
"""Share of the volume that the mean is taken over."""
ROUNDED = 2e-3
"""Half width of the rounding of max(x, 0), x = v/q - 1."""
BISECTIONS = 45
"""Halvings of the interval for q, down to 6e-14 of the field's largest value."""
WORDS = f"mean over the {100 * SHARE:g} % of the volume where it is largest"


def excess(x: Array) -> tuple[Array, Array]:
    """max(x, 0), rounded, and its slope."""
    inner = np.clip((x + ROUNDED) / (2 * ROUNDED), 0.0, 1.0)
    return np.where(x > ROUNDED, x, ROUNDED * inner**2), inner


def volume_peak(comm: MPI.Comm, values: Array, volumes: Array) -> tuple[float, float]:
    """The peak of a field, and the value q from which on it counts.

    Args:
        comm: MPI communicator; called on all ranks.
        values: The field at this rank's integration points, none of them negative.
        volumes: Volumes of the points, of the same shape.

    Returns:
        Peak and q, equal on all ranks; 0 and 0 of a field that vanishes.
    """
    top = largest(comm, float(values.max()) if values.size else 0.0)
    whole = SHARE * total(comm, float(volumes.sum()))
    if top <= 0.0:
        return 0.0, 0.0

    def slope(q: float) -> float:
        x = values / q - 1.0
        above, rate = excess(x)
        return 1.0 + total(comm, float((volumes * (above - (x + 1.0) * rate)).sum())) / whole

    low, high = 1e-3 * top, 2.0 * top
    for _ in range(
        BISECTIONS
    ):  # the slope rises with q; SciPy's root finders would take longer to import than this takes
        q = 0.5 * (low + high)
        low, high = (low, q) if slope(q) > 0.0 else (q, high)
    above, _ = excess(values / q - 1.0)
    return q * (1.0 + total(comm, float((volumes * above).sum())) / whole), q
