"""Where searches begin: the device as given, then points spread over the bounds."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt
from scipy.stats import qmc

from geometries import GeometryError
from geometries.parameters import changed
from softmodels.design.asked import CLEARANCES
from softmodels.design.problem import DesignProblem

Array = npt.NDArray[np.float64]
DRAWN = 64
"""Points that are drawn in all; those that are no device, or have too thin a wall, are left out."""


def further_starts(problem: DesignProblem, seed: int) -> Iterator[Array]:
    """Scaled parameters of devices spread over the bounds: a Latin hypercube (McKay, Beckman and Conover 1979).

    Args:
        problem: The problem.
        seed: The same seed gives the same points.
    """
    for x in qmc.LatinHypercube(len(problem.free), rng=np.random.default_rng(seed)).random(DRAWN):
        if _is_device(problem, x):
            yield x


def _is_device(problem: DesignProblem, x: Array) -> bool:
    values = {one.name: one.low + share * one.width for one, share in zip(problem.free, x, strict=True)}
    try:
        device = changed(problem.case.actuator, values)
    except GeometryError:
        return False
    least = max([keep.at_least or 0.0 for keep in problem.limits if keep.quantity.name == CLEARANCES], default=0.0)
    return min(device.clearances.values(), default=least) >= least
