"""The direction of a path at a state."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True, eq=False)
class Tangent:
    """Direction of the path at a state: changes of w (shape as `State.w`), P and V; P rises where V does and dP > 0.

    The compliance dV/dP is infinite at a limit point and negative past it.
    """

    w: Array
    P: float
    V: float

    @property
    def compliance(self) -> float:
        return self.V / self.P if self.P else math.inf

    def __neg__(self) -> Tangent:
        return Tangent(-self.w, -self.P, -self.V)
