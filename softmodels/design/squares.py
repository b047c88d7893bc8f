"""Residuals of a target that is to be followed, with their derivatives, as small as least squares need them.

Gauss and Newton's method and the covariance of its end know residuals r and their Jacobian J only by J^T J, J^T r and r^T r.
The triangle of the QR decomposition of [J r] has all three, however many residuals there are.
"""

from __future__ import annotations

import dataclasses
from typing import Self

import numpy as np
import numpy.typing as npt

from measurement.read_only import keep_arrays

Array = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True, eq=False)
class Squares:
    """Residuals and their derivatives by the parameters, SI units.

    Attributes:
        count: How many residuals there are.
        run: Over how many of them errors keep together.
        sigma: Standard error of one; 0 where it is not known.
        triangle: Of [J r], shape (m + 1, m + 1).
    """

    count: int
    run: float
    sigma: float
    triangle: Array

    def __post_init__(self) -> None:
        keep_arrays(self)

    @classmethod
    def of(cls, residuals: Array, jacobian: Array, run: float = 1.0, sigma: float = 0.0) -> Self:
        """Of residuals (n,) with their Jacobian (n, m)."""
        both = np.column_stack([jacobian, residuals])
        columns = both.shape[1]
        padded = np.vstack([both, np.zeros((max(columns - len(both), 0), columns))])
        return cls(len(residuals), run, sigma, np.linalg.qr(padded, mode="r"))

    @property
    def residuals(self) -> Array:
        """A vector of the residuals' length, shape (m + 1,)."""
        return self.triangle[:, -1]

    @property
    def jacobian(self) -> Array:
        """Its derivatives, shape (m + 1, m)."""
        return self.triangle[:, :-1]

    def to_table(self) -> dict[str, object]:
        """As plain numbers."""
        return {**dataclasses.asdict(self), "triangle": self.triangle.tolist()}

    @classmethod
    def from_table(cls, table: dict[str, object]) -> Self:
        """What `to_table` gave.

        Raises:
            TypeError, ValueError, KeyError: It is something else.
        """
        return cls(
            int(str(table["count"])), float(str(table["run"])), float(str(table["sigma"])),
            np.array(table["triangle"], dtype=float),
        )  # fmt: skip
