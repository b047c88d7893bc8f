"""The standard error of measured stresses: as stated, or from the curve's own noise."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import numpy.typing as npt

from measurement.units import UnitError, brief, quantity
from softmodels.fitting.curves.curve import TensileCurve, TensileError

Array = npt.NDArray[np.float64]

RELATIVE = 0.02
"""Share of the stress that a test is off by if nobody says: cross-section, load cell, crosshead strain."""

LEAST_ABSOLUTE = 0.003
"""Least absolute error, as a share of the largest stress: a load cell's resolution."""

DENSE = 30
"""From this many points on, the noise of a curve can be told from its bend."""


@dataclasses.dataclass(frozen=True)
class StressError:
    """Standard error of a measured stress.

    Attributes:
        relative: Share of the stress.
        absolute: In Pa; None to estimate it from the curve's own noise.
        stated: Whether its size is known; else only the ratios count and the size follows from the scatter.
    """

    relative: float
    absolute: float | None
    stated: bool

    @classmethod
    def from_text(cls, text: str) -> StressError:
        """Read ``"2%+0.5kPa"``, ``"0.5kPa"``, ``"auto"``, or ``"constant"``: unweighted least squares on nominal stress."""
        if not isinstance(text, str):
            raise TensileError(f"stress error is {brief(text)}; it is a text such as '2%+0.5kPa', 'auto' or 'constant'")
        if text == "auto":
            return cls(RELATIVE, None, False)
        if text == "constant":
            return cls(0.0, 1e3, False)
        relative, absolute = 0.0, 0.0
        try:
            for part in text.split("+"):
                if part.strip().endswith("%"):
                    relative = quantity(part, "")
                else:
                    absolute = quantity(part, "Pa")
        except UnitError as error:
            raise TensileError(f"stress error {text!r}: {error}; or write 2%+0.5kPa, auto or constant") from None
        if relative < 0.0 or absolute < 0.0 or relative + absolute == 0.0:
            raise TensileError(f"stress error {text!r} must be above zero")
        if absolute == 0.0:
            raise TensileError(f"stress error {text!r} vanishes at rest; add an absolute part, such as {text}+0.1kPa")
        return cls(relative, absolute, True)

    def of(self, curve: TensileCurve) -> Array:
        """Error in Pa of each point of a curve."""
        absolute = self.absolute
        if absolute is None:
            absolute = max(noise(curve), LEAST_ABSOLUTE * float(np.abs(curve.stress).max()))
        return np.hypot(self.relative * curve.stress, absolute)


def noise(curve: TensileCurve) -> float:
    """Standard deviation in Pa of a dense curve's noise, from third differences, which a smooth bend leaves small.

    The median makes jumps count little. 0 where the points are too few to tell noise from the bend. Averaged curves carry
    that of their readings.
    """
    if curve.noise is not None:
        return curve.noise
    if len(curve.stress) < DENSE:
        return 0.0
    return float(np.median(np.abs(np.diff(curve.stress, 3)))) / 0.6745 / math.sqrt(20)
