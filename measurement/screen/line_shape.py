"""The grid's lines as the camera blurs them: how wide, how dark and how much out of focus.

The blur of a photograph acts on the product of the shadow and the ink, not on each alone. A line of width L that takes the
share D of the light, under a Gaussian blur s, lets T(d) = 1 - D (Phi((d + L/2) / s) - Phi((d - L/2) / s)) through. The blurred
product of a penumbra S and the sharp line is S T less their covariance under the blur,

    cov = -D (C(z, (d + L/2) / s; r) - C(z, (d - L/2) / s; r)),    C(a, b; r) = integral from 0 to r of phi2(a, b; t) dt,

with z = u / w the place across the edge in its own width and r = s cos(angle) / w the correlation of both blurs, cos(angle)
that of the edge's and the line's normals. What penumbra the lamp itself makes is part of w, not of s, so a sharp photograph
of a soft shadow has nearly none of this, and one out of focus has much.

Source of the bivariate normal integral: Z. Drezner, G. O. Wesolowsky, J. Stat. Comput. Simul. 35 (1990) 101,
doi 10.1080/00949659008811236.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares
from scipy.special import ndtr

Array = npt.NDArray[np.float64]

STRONGEST = 0.97
"""Largest correlation of both blurs: an edge as sharp as the line along which it runs, but for the noise of both widths."""

LEAST_DEPTH = 0.02
"""Least share of the light that a blurred line takes, for its shape to be told."""

DOUBT = 0.005
"""Misfit that a factor of e in the depth makes from halfway between the least that is possible and black."""

NODES = np.polynomial.legendre.leggauss(8)


@dataclasses.dataclass(frozen=True)
class LineShape:
    """A straight line of the grid.

    Attributes:
        width: Its width in m on the screen.
        depth: Share of the light that it takes where it is sharp.
        blur: Standard deviation in m of the picture's blur on the screen.
    """

    width: float
    depth: float
    blur: float

    @classmethod
    def fitted(cls, distance: Array, inks: Array) -> tuple[LineShape | None, LineShape | None]:
        """The lines of both directions, of one ink and one blur; None where there is no line to be seen.

        Args:
            distance: Distances (k,) in m from a line's middle, from 0 to the profiles' end.
            inks: Share of light (2, k) that the lines let through there, relative to that at the profiles' end.
        """
        seen = [axis for axis in (0, 1) if 1.0 - inks[axis].min() > LEAST_DEPTH]
        lines: list[LineShape | None] = [None, None]
        if seen:
            for axis, line in zip(seen, cls._of_one_ink(distance, inks[seen]), strict=True):
                lines[axis] = line
        return lines[0], lines[1]

    @classmethod
    def _of_one_ink(cls, distance: Array, inks: Array) -> list[LineShape]:
        depth, end = float(1.0 - inks.min()), float(distance[-1])
        half = [float(distance[1.0 - ink > 0.5 * (1.0 - ink.min())].max()) for ink in inks]
        far = distance >= end * 2.0 / 3.0  # what a profile is taken relative to
        inked = inks < 1.0  # the faintest ink is left out of it

        def lines(logs: Array) -> list[LineShape]:
            values = np.exp(logs)
            return [cls(float(width), float(values[0]), float(values[1])) for width in values[2:]]

        def missed(logs: Array) -> Array:
            through = np.array([line.through(distance) for line in lines(logs)])
            rest = (through / through[:, far].mean(axis=1, keepdims=True) - inks)[inked]
            # A line much narrower than the blur does not tell whether it is faint and wide or black and thin.
            return np.r_[rest, DOUBT * (logs[0] - 0.5 * np.log(depth))]

        low = np.log([0.5 * depth, 0.003 * end, *[0.02 * end for _ in half]])
        high = np.log([1.0, end, *[2.0 * end for _ in half]])
        starts = (
            [depth, 0.2 * min(half), *(2.0 * value for value in half)],
            [min(1.0, 2.0 * depth), 0.8 * min(half), *half],
        )
        fits = [
            least_squares(missed, np.clip(np.log(np.maximum(start, 1e-9)), low + 1e-6, high - 1e-6), bounds=(low, high))
            for start in starts
        ]
        return lines(min(fits, key=lambda fit: float(fit.cost)).x)

    def through(self, off: Array) -> Array:
        """Share of light that the blurred line lets through at signed distances from its middle in m."""
        upper, lower = (off + 0.5 * self.width) / self.blur, (off - 0.5 * self.width) / self.blur
        return np.asarray(1.0 - self.depth * (ndtr(upper) - ndtr(lower)))

    def covariance(self, off: Array, z: Array, correlation: Array) -> Array:
        """What blurred shadow times blurred line lacks to the blurred product, per unit of the edge's rise.

        Args:
            off: Signed distances (...) in m from the line's middle.
            z: Places (...) across the edge in its widths.
            correlation: Correlation (...) of the edge's and the line's blur, its sign that of d off / d z.
        """
        upper, lower = (off + 0.5 * self.width) / self.blur, (off - 0.5 * self.width) / self.blur
        r = np.clip(correlation, -STRONGEST, STRONGEST)
        # r = sin(t) takes the integrand's steepness near r = 1 away.
        half = 0.5 * np.arcsin(r)
        total = np.zeros(np.broadcast_shapes(off.shape, z.shape))
        for node, weight in zip(*NODES, strict=True):
            t = half * (1.0 + node)
            sine, cosine2 = np.sin(t), np.cos(t) ** 2
            for sign, place in ((1.0, upper), (-1.0, lower)):
                exponent = -0.5 * (z * z - 2.0 * sine * z * place + place * place) / cosine2
                total += sign * weight * np.exp(exponent)
        return np.asarray(-self.depth * total * half / (2.0 * np.pi))
