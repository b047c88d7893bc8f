"""The smooth gap between a point and a wall, the energy of a negative one, and both's derivatives.

With r = x - y_j from a wall's samples to a point x, their area vectors m_j and a kernel K of radius R,

    N = sum_j K(r_j) m_j . r_j      S = sum_j K(r_j) m_j      D = |S|      gap = N / D,

the mean distance to the tangent planes of what is near: implicit moving least squares (Kolluri 2008, Provably good moving
least squares, ACM Trans. Algorithms 4). It is exact for a flat wall whatever its mesh; it is twice differentiable, also across
the edges and corners of facets, where the distance to the nearest point has kinks; and it has a sign. D is 1 in front of a
wall that is whole, and falls to 0 at its border. The energy of a point of undeformed area A is A c(D) phi(-gap).
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from softmodels.mechanics.walls.pairs import Pairs
from softmodels.mechanics.walls.surface import Array, Numbers

LEAST, WHOLE = 0.1, 0.4
"""D from which a wall counts at all, and from which in full; it is 1/2 at a straight border."""


@dataclasses.dataclass(frozen=True)
class Penalty:
    """phi(d) of a penetration d: a stiffness whose onset is rounded, as against a rigid plane.

    Attributes:
        stiffness: Pressure per penetration.
        onset: Penetration over which it sets in.
        ahead: Gap from which it counts as penetration already; walls between the points of a rule may stand out by as much.
    """

    stiffness: float
    onset: float
    ahead: float = dataclasses.field(default=0.0, kw_only=True)

    def rates(self, d: Array) -> tuple[Array, Array, Array]:
        """phi and its first two derivatives."""
        k, e = self.stiffness, self.onset
        d = np.maximum(d, 0.0)
        early = d < e
        value = np.where(early, d**3 / (6 * e), d**2 / 2 - e * d / 2 + e**2 / 6)
        first = np.where(early, d**2 / (2 * e), d - e / 2)
        return k * value, k * first, k * np.where(early, d / e, 1.0)


def _share(D: Array) -> tuple[Array, Array, Array]:
    """How much of a wall's border counts, and the first two derivatives: 0 to 1, twice differentiable."""
    width = WHOLE - LEAST
    t = np.clip((D - LEAST) / width, 0.0, 1.0)
    value = t**3 * (10 - 15 * t + 6 * t**2)
    return value, 30 * t**2 * (1 - t) ** 2 / width, 60 * t * (1 - t) * (1 - 2 * t) / width**2


def kernels(r: Array, R: Array | float) -> Array:
    """K = (1 - r.r/R^2)^3 over its own integral on a plane, and its first two derivatives by r.r, shape (3, p).

    Args:
        r: Shape (p, d).
        R: Radius of each, shape (p,), or of all.
    """
    s = np.einsum("pi,pi->p", r, r) / R**2
    t = np.maximum(1.0 - s, 0.0)
    unit = 32 / 35 * R if r.shape[1] == 2 else math.pi / 4 * R**2
    return np.stack([t**3, -3 * t**2 / R**2, 6 * t / R**4]) / unit


def gaps_of(N: Array, S: Array) -> Array:
    """Gaps of points with these sums, shapes (n,) and (n, d); infinite where no wall is seen."""
    D = np.linalg.norm(S, axis=1)
    seen = D > LEAST
    return np.where(seen, N / np.where(seen, D, 1.0), np.inf)


@dataclasses.dataclass(frozen=True, eq=False)
class Near:
    """Pairs of samples with their kernels.

    Attributes:
        i, j: Samples, those of the points and those of the wall, shape (p,).
        image: Which image of the wall it is, shape (p,).
        r: x_i - y_j, shape (p, d); y_j is of the image.
        m: Area vectors of j, of the image, shape (p, d).
        K: Kernel and its first two derivatives by r.r, shape (3, p).
    """

    i: Numbers
    j: Numbers
    image: Numbers
    r: Array
    m: Array
    K: Array

    @classmethod
    def of(cls, pairs: Pairs, places: Array, areas: Array) -> Near:
        """Pairs in a shape of the walls.

        Args:
            pairs: The walls and their search.
            places, areas: Of the samples, shape (s, d) each.
        """
        i, number = pairs.near(places)
        image, j = np.divmod(number, len(places))
        r, R = places[i] - pairs.of_all(places)[number], pairs.radius[j]
        return cls(i, j, image, r, pairs.of_all(areas)[number], kernels(r, R))

    def sums(self, count: int) -> tuple[Array, Array]:
        """N, shape (count,), and S, shape (count, d), of each point."""
        d = self.r.shape[1]
        along = np.einsum("pi,pi->p", self.m, self.r)
        N = np.bincount(self.i, self.K[0] * along, count)
        S = np.column_stack([np.bincount(self.i, self.K[0] * self.m[:, c], count) for c in range(d)])
        return N, S

    def gaps(self, count: int) -> Array:
        """Gap of each point, shape (count,); see `gaps_of`."""
        return gaps_of(*self.sums(count))

    def of_points(self, chosen: np.ndarray) -> Near:
        """Those whose points are chosen, a mask of shape (s,)."""
        return self.taken(chosen[self.i])

    def taken(self, which: np.ndarray | slice) -> Near:
        """Some of the pairs, or all in another order."""
        return Near(self.i[which], self.j[which], self.image[which], self.r[which], self.m[which], self.K[:, which])


@dataclasses.dataclass(frozen=True, eq=False)
class PointEnergies:
    """Energies of points as functions of their N and S, with derivatives.

    Attributes:
        value: Shape (n,).
        first: By N and S, shape (n, 1 + d).
        second: Shape (n, 1 + d, 1 + d).
    """

    value: Array
    first: Array
    second: Array

    @classmethod
    def of_touching(cls, on: np.ndarray, N: Array, S: Array, area: Array, penalty: Penalty) -> PointEnergies:
        """Those of the points that touch, a mask of shape (n,); zero of all others. The rest is as for `of`."""
        count, d = S.shape
        value, first, second = np.zeros(count), np.zeros((count, 1 + d)), np.zeros((count, 1 + d, 1 + d))
        found = cls.of(N[on], S[on], area[on], penalty)
        value[on], first[on], second[on] = found.value, found.first, found.second
        return cls(value, first, second)

    @classmethod
    def of(cls, N: Array, S: Array, area: Array, penalty: Penalty) -> PointEnergies:
        """Those of points with D above zero.

        Args:
            N, S: Sums, shapes (n,) and (n, d).
            area: Undeformed area, shape (n,).
            penalty: phi.
        """
        D = np.linalg.norm(S, axis=1)
        depth = -N / D
        phi, phi1, phi2 = (area * rate for rate in penalty.rates(depth + penalty.ahead))
        c, c1, c2 = _share(D)
        # depth = -N/D: its derivatives by N and D are -1/D and -depth/D.
        by_N, by_D = -1 / D, -depth / D
        e_N, e_D = phi1 * c * by_N, phi1 * c * by_D + phi * c1
        e_NN = phi2 * c * by_N**2
        e_ND = phi2 * c * by_N * by_D + phi1 * (c / D**2 + by_N * c1)
        e_DD = phi2 * c * by_D**2 + phi1 * (2 * depth / D**2 * c + 2 * by_D * c1) + phi * c2
        way = S / D[:, None]
        first = np.column_stack([e_N, e_D[:, None] * way])
        second = np.empty((len(N), 1 + S.shape[1], 1 + S.shape[1]))
        second[:, 0, 0] = e_NN
        second[:, 0, 1:] = second[:, 1:, 0] = e_ND[:, None] * way
        outer = way[:, :, None] * way[:, None, :]
        second[:, 1:, 1:] = e_DD[:, None, None] * outer + (e_D / D)[:, None, None] * (np.eye(S.shape[1]) - outer)
        return cls(phi * c, first, second)


def pair_rates(near: Near, first: Array) -> tuple[Array, Array]:
    """Derivatives of sum e(N, S) by r and by m of each pair, shape (p, d) each, where e's by N and S are ``first``."""
    a, b = first[near.i, 0], first[near.i, 1:]
    v = a[:, None] * near.r + b
    along = np.einsum("pi,pi->p", near.m, v)
    by_r = (2 * near.K[1] * along)[:, None] * near.r + (near.K[0] * a)[:, None] * near.m
    return by_r, near.K[0][:, None] * v


def pair_curvatures(near: Near, first: Array) -> Array:
    """Second derivatives of a N + b . S by (r, m) of each pair, a and b held, shape (p, 2d, 2d)."""
    d = near.r.shape[1]
    a, b = first[near.i, 0], first[near.i, 1:]
    r, m, (K, K1, K2), eye = near.r, near.m, near.K, np.eye(d)
    v = a[:, None] * r + b
    along = np.einsum("pi,pi->p", m, v)
    rm = r[:, :, None] * m[:, None, :]
    found = np.zeros((len(a), 2 * d, 2 * d))
    found[:, :d, :d] = (4 * K2 * along)[:, None, None] * r[:, :, None] * r[:, None, :]
    found[:, :d, :d] += (2 * K1 * along)[:, None, None] * eye + (2 * K1 * a)[:, None, None] * (
        rm + rm.transpose(0, 2, 1)
    )
    mixed = (2 * K1)[:, None, None] * r[:, :, None] * v[:, None, :] + (K * a)[:, None, None] * eye
    found[:, :d, d:], found[:, d:, :d] = mixed, mixed.transpose(0, 2, 1)
    return found


def sum_rates(near: Near) -> Array:
    """Derivatives of each pair's share of N and S by (r, m), shape (p, 1 + d, 2d)."""
    d = near.r.shape[1]
    r, m, (K, K1, _) = near.r, near.m, near.K
    along = np.einsum("pi,pi->p", m, r)
    found = np.zeros((len(along), 1 + d, 2 * d))
    found[:, 0, :d] = (2 * K1 * along)[:, None] * r + K[:, None] * m
    found[:, 0, d:] = K[:, None] * r
    found[:, 1:, :d] = (2 * K1)[:, None, None] * m[:, :, None] * r[:, None, :]
    found[:, 1:, d:] = K[:, None, None] * np.eye(d)
    return found
