"""A membrane whose thickness varies along the radius: one cubic spline from the axis to the cavity's edge.

Its values are given at equally spaced radii, in shares of the disk's `membrane`; its slope is zero on the axis, where the top
would have a tip, and at the cavity's edge, beyond which the thickness stays. The spline is linear in its values.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from scipy.interpolate import PPoly

Array = NDArray[np.float64]


@functools.lru_cache(maxsize=256)
def _spline(shares: tuple[float, ...]) -> PPoly:
    """Shares of the thickness over shares of the radius, from 0 to 1."""
    from scipy.interpolate import CubicSpline

    return CubicSpline(np.linspace(0.0, 1.0, len(shares)), shares, bc_type="clamped")


@dataclasses.dataclass(frozen=True)
class MembraneTop:
    """The top face of a membrane over a flat ceiling, as height over radius.

    Attributes:
        radius: Of the cavity in m, where the spline ends.
        ceiling: Height of the membrane's lower face in m.
        membrane: Thickness in m that the shares are of.
        shares: Thickness at equally spaced radii from the axis to the cavity's edge, in shares of ``membrane``; two or more,
            or one for a flat top.
    """

    radius: float
    ceiling: float
    membrane: float
    shares: tuple[float, ...]

    def thickness(self, radii: ArrayLike) -> Array:
        """Thickness in m at radii in m; beyond the cavity's edge that of the edge."""
        within = np.clip(np.abs(radii) / self.radius, 0.0, 1.0)
        if len(self.shares) == 1:
            return np.full_like(within, self.membrane * self.shares[0])
        return np.asarray(self.membrane * _spline(self.shares)(within))

    def height(self, radii: ArrayLike) -> Array:
        """Height of the top face in m at radii in m."""
        return self.ceiling + self.thickness(radii)

    def curvature(self, radii: ArrayLike) -> Array:
        """Curvature in 1/m of the top's line at radii in m up to the cavity's edge, either way counted positive."""
        within = np.asarray(radii) / self.radius
        if len(self.shares) == 1:
            return np.zeros_like(within)
        slope, bend = (self.membrane * _spline(self.shares)(within, k) / self.radius**k for k in (1, 2))
        return np.asarray(np.abs(bend) / (1.0 + slope**2) ** 1.5)

    @property
    def extremes(self) -> tuple[float, float]:
        """Smallest and largest thickness in m, between the given radii too."""
        if len(self.shares) == 1:
            return self.membrane * self.shares[0], self.membrane * self.shares[0]
        turns = _spline(self.shares).derivative().roots(extrapolate=False)
        values = [*self.shares, *_spline(self.shares)(turns[np.isfinite(turns)])]
        return self.membrane * float(min(values)), self.membrane * float(max(values))

    @property
    def volume(self) -> float:
        """Volume in m3 of the membrane above the cavity, turned around the axis: 2 pi times the integral of t r dr."""
        if len(self.shares) == 1:
            return math.pi * self.radius**2 * self.membrane * self.shares[0]
        spline = _spline(self.shares)
        total = 0.0
        for start, width, cubic in zip(spline.x[:-1], np.diff(spline.x), spline.c.T, strict=True):
            # cubic[k] belongs to (s - start)^(3 - k).
            powers = 3 - np.arange(4)
            total += float(np.sum(cubic * width ** (powers + 1) * (start / (powers + 1) + width / (powers + 2))))
        return 2.0 * math.pi * self.radius**2 * self.membrane * total

    def pieces(self) -> list[Array]:
        """The same curve as cubic Bezier pieces between the given radii, from the cavity's edge to the axis.

        Pieces, because the CAD kernel integrates over one polynomial exactly and over a spline of several it does not (0.1 %).

        Returns:
            Control points (radius, height) in m of each piece, shape (4, 2), whose radii are equally spaced.
        """
        from scipy.interpolate import BPoly, PPoly

        spline = _spline(self.shares)
        shares = BPoly.from_power_basis(PPoly(spline.c, spline.x)).c
        shares[0], shares[-1] = self.shares[:-1], self.shares[1:]  # to the last bit, for neighbours to meet
        radii = self.radius * np.linspace(spline.x[:-1], spline.x[1:], 4)
        points = np.stack([radii, self.ceiling + self.membrane * shares], axis=-1)
        return [points[::-1, k] for k in reversed(range(points.shape[1]))]
