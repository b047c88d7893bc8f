"""The penalty energies of contact: smooth gaps of walls, samples on rigid shapes, friction, shapes that give way."""

from __future__ import annotations

import abc
import dataclasses
import functools
import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from softmodels.common.arrays import Array
from softmodels.common.lazy import basix, scipy
from softmodels.mechanics import regions

# ----------------------------------------------------------------------------------------------------------------------
# Surfaces of walls: quadratic facets, sampled at quadrature points, with the derivatives of positions and areas.
#
# A facet is a line of three nodes or a triangle of six. A sample has a place y, which is linear in the nodes' places, and an
# area vector m, normal times deformed area, out of the solid, which is linear in a line's nodes and bilinear in a triangle's.


Numbers = npt.NDArray[np.int64]

RULE_DEGREE = 4
"""Of the rule: three points on a line, six on a triangle."""


@dataclasses.dataclass(frozen=True, eq=False)
class Surface:
    """Walls at rest.

    Attributes:
        nodes: Places at rest, shape (n, d).
        facets: Nodes of each facet: corners, then middles, shape (f, 3 or 6); of triangles each middle opposite to its corner.
        walls: Number of the wall that each facet belongs to, shape (f,).
        inside: A point of the solid behind each facet, shape (f, d).
        axisymmetric: Whether the areas are those of rings around the second axis.
    """

    nodes: Array
    facets: Numbers
    walls: Numbers
    inside: Array
    axisymmetric: bool = False

    @functools.cached_property
    def dimension(self) -> int:
        return int(self.nodes.shape[1])

    @functools.cached_property
    def rule(self) -> tuple[Array, Array, Array]:
        """Shape functions (q, k), their slopes (q, k, d - 1) and weights (q,) at the points of the rule."""
        cell = basix.CellType.interval if self.dimension == 2 else basix.CellType.triangle
        points, weights = basix.make_quadrature(cell, RULE_DEGREE)
        tables = basix.create_element(basix.ElementFamily.P, cell, 2).tabulate(1, points)[..., 0]
        return tables[0], np.moveaxis(tables[1:], 0, -1), weights

    @functools.cached_property
    def turn(self) -> Array:
        """1 or -1 for each facet, so that area vectors point out of the solid, shape (f,)."""
        corners = self.nodes[self.facets[:, : self.dimension]]
        along = np.diff(corners, axis=1)
        normal = crossed(along[:, 0], along[:, -1])
        out = np.einsum("fi,fi->f", normal, corners.mean(axis=1) - self.inside)
        return np.where(out > 0.0, 1.0, -1.0)

    @functools.cached_property
    def owner(self) -> Numbers:
        """The facet of each sample, shape (s,)."""
        return np.repeat(np.arange(len(self.facets)), len(self.rule[2]))

    @functools.cached_property
    def shapes(self) -> Array:
        """Shape functions at each sample, shape (s, k)."""
        return np.tile(self.rule[0], (len(self.facets), 1))

    @functools.cached_property
    def rest(self) -> tuple[Array, Array]:
        """Places and area vectors of the samples at rest, shape (s, d) each."""
        return self.places(self.nodes), self.areas(self.nodes)

    @functools.cached_property
    def measure(self) -> Array:
        """Undeformed area of each sample, of the ring in an axisymmetric section, shape (s,)."""
        places, areas = self.rest
        size = np.linalg.norm(areas, axis=1)
        return size * 2 * math.pi * places[:, 0] if self.axisymmetric else size

    @functools.cached_property
    def edges(self) -> Array:
        """Length of a facet's edge at each sample: of a line, or of the equal-sided triangle of the same area; shape (s,)."""
        sizes = np.linalg.norm(self.rest[1], axis=1).reshape(len(self.facets), -1).sum(axis=1)
        return np.asarray((sizes if self.dimension == 2 else np.sqrt(4 / math.sqrt(3) * sizes))[self.owner])

    def places(self, nodes: Array) -> Array:
        """Return the places of the samples, shape (s, d), where the nodes are at ``nodes``, shape (n, d)."""
        return np.einsum("qa,fai->fqi", self.rule[0], nodes[self.facets]).reshape(-1, self.dimension)

    def _along(self, nodes: Array) -> Array:
        """Return the tangents at the samples, shape (f, q, d - 1, d)."""
        return np.asarray(np.einsum("qat,fai->fqti", self.rule[1], nodes[self.facets]))

    def _factor(self) -> Array:
        return np.asarray(self.turn[:, None] * self.rule[2])

    def areas(self, nodes: Array) -> Array:
        """Area vectors of the samples, shape (s, d)."""
        along = self._along(nodes)
        return (crossed(along[:, :, 0], along[:, :, -1]) * self._factor()[..., None]).reshape(-1, self.dimension)

    def area_rates(self, nodes: Array) -> Array:
        """Return the derivative of each sample's area vector by its facet's nodes, shape (s, d, k, d)."""
        slopes, factor, d = self.rule[1], self._factor(), self.dimension
        if d == 2:
            turned = np.array([[0.0, 1.0], [-1.0, 0.0]])
            rates = np.einsum("fq,qa,ij->fqiaj", factor, slopes[:, :, 0], turned)
            return rates.reshape(-1, 2, self.facets.shape[1], 2)
        along = self._along(nodes)
        first, second = regions.cross(along[:, :, 0]), regions.cross(along[:, :, 1])
        # m = t1 x t2: dm = t1 x dt2 - t2 x dt1
        rates = np.einsum("fq,qa,fqij->fqiaj", factor, slopes[:, :, 1], first)
        rates -= np.einsum("fq,qa,fqij->fqiaj", factor, slopes[:, :, 0], second)
        return rates.reshape(-1, 3, self.facets.shape[1], 3)

    def area_curvatures(self, along: Array, samples: Numbers) -> Array:
        """Return the second derivative of ``along . m``, along of shape (p, 3), by the nodes of a sample's facet, by samples'
        numbers: shape (p, k, d, k, d); of triangles alone."""
        slopes, count = self.rule[1], len(self.rule[2])
        q = samples % count
        first, second = slopes[q, :, 0], slopes[q, :, 1]
        pairs = np.einsum("pa,pb->pab", first, second)
        pairs = (pairs - pairs.transpose(0, 2, 1)) * self._factor().ravel()[samples, None, None]
        # along . (e x f) = e . (f x along) = -e . (along x f)
        return np.asarray(np.einsum("pab,pij->paibj", pairs, -regions.cross(along)))


def crossed(first: Array, second: Array) -> Array:
    """Return the product of two tangents, shape (..., d); in the plane the one tangent turned by a right angle."""
    if first.shape[-1] == 3:
        return np.asarray(np.cross(first, second))
    return np.stack([first[..., 1], -first[..., 0]], axis=-1)


# ----------------------------------------------------------------------------------------------------------------------
# Contact search: which samples of walls may touch, and which of these are near.


SEARCH_RADIUS = 0.9
"""Radius of the kernel in facet edges: two to three times the undeformed distance of samples."""
MAX_NORMAL_PRODUCT = -0.2
"""Largest scalar product of the undeformed normals of neighbours on one wall that may come into contact."""
NEIGHBOUR_DISTANCE = 3.0
"""Distance at rest, in radii, up to which samples are neighbours on one wall."""
MIN_CORNER_SINE = 0.3
"""Minimum sine of the angle under which a chord leaves a wall at both ends, for neighbours that face each other."""
MAX_IMAGES = 100
"""Maximum number of mirror images of a slice; a wedge of 15 degrees has 24."""
SEARCH_MARGIN = 0.4
"""Search margin, so that pairs can be reused for several shapes."""
MIN_FACING_SINE = 0.5
"""Minimum sine of the angle under which a chord leaves facing walls."""
MIN_ENTRY_SINE = 1e-6
"""Sine of the angle under which a chord has to enter the solid at both ends, to run through silicone."""


@dataclasses.dataclass(frozen=True, eq=False)
class Pairs:
    """The search for pairs of samples on all walls of a surface, mirror images of the walls included (orthogonal matrices, the
    identity first, shape (g, d, d)). Sample j of image g has the number g s + j, where there are s samples. ``meets`` says
    whether a wall may press on another, or on itself, shape (walls, walls), symmetric."""

    surface: Surface
    meets: npt.NDArray[np.bool_]
    images: Array
    _last_pairs: _SearchedPairs | None = dataclasses.field(default=None, init=False, repr=False)

    @functools.cached_property
    def radius(self) -> Array:
        """Radius of each sample's kernel, by the edge of its own facet, shape (s,)."""
        return SEARCH_RADIUS * self.surface.edges

    def of_all(self, vectors: Array) -> Array:
        """Return the vectors of all samples of all images, shape (s, d) to (g s, d)."""
        return np.asarray(np.einsum("gij,sj->gsi", self.images, vectors).reshape(-1, vectors.shape[1]))

    @functools.cached_property
    def _rest(self) -> tuple[Array, Array]:
        """Places and unit normals at rest of all samples of all images, shape (g s, d) each."""
        places, areas = self.surface.rest
        return self.of_all(places), self.of_all(areas / np.linalg.norm(areas, axis=1)[:, None])

    def allowed(self, i: Numbers, j: Numbers) -> npt.NDArray[np.bool_]:
        """Return whether samples i may touch samples j of any image.

        It depends only on the undeformed shape, so that the energy is a function of the displacement. Left out are
        neighbours on one wall that do not face each other, as those across a corner do that are farther apart than a kernel
        reaches, and two sides of a wall, between which there is silicone.
        """
        owner, walls, count = self.surface.owner, self.surface.walls, len(self.surface.owner)
        may = self.meets[walls[owner[i]], walls[owner[j % count]]]
        i, j = i[may], j[may]
        X, N = self._rest
        chord = X[j] - X[i]
        length = np.linalg.norm(chord, axis=1)
        out, back = np.einsum("pi,pi->p", chord, N[i]), -np.einsum("pi,pi->p", chord, N[j])
        through = (out < -MIN_ENTRY_SINE * length) & (back < -MIN_ENTRY_SINE * length)
        radius = self.radius[j % count]
        across = (np.minimum(out, back) > MIN_CORNER_SINE * length) & (length > radius)
        across |= np.einsum("pi,pi->p", N[i], N[j]) < MAX_NORMAL_PRODUCT
        may[may] = ~(through | ((length < NEIGHBOUR_DISTANCE * radius) & ~across))
        return may

    def within(self, places: Array, share: float, slack: float = 0.0) -> tuple[Numbers, Numbers, Array]:
        """Return the pairs that may touch and are nearer than ``share`` of the second one's radius plus ``slack`` at samples'
        places, shape (s, d), sorted by the first, and the ways from the second to the first, shape (p, d). They are looked for
        a little farther, and again only once samples have moved by as much; until then only those are measured that may have
        come near enough since."""
        reach, last = share * float(self.radius.max()) + slack, self._last_pairs
        moved = 0.0 if last is None else float(np.sqrt(((places - last.places) ** 2).sum(axis=1).max(initial=0.0)))
        if last is None or reach + 2 * moved > last.far:
            moved, far = 0.0, max(reach, float(self.radius.max())) * (1 + SEARCH_MARGIN)
            i, j = _pairs_within(places, scipy.spatial.cKDTree(self.of_all(places)), far)
            may = self.allowed(i, j)
            i, j = i[may], j[may]
            way = np.take(places, i, axis=0) - np.take(self.of_all(places), j, axis=0)
            last = _SearchedPairs(places.copy(), far, i, j, np.sqrt(squares(way)), self.radius[j % len(places)])
            object.__setattr__(self, "_last_pairs", last)
        chosen = np.flatnonzero(last.distances - share * last.radii < slack + 2 * moved * (1 + 1e-9) + 1e-12)
        i, j = last.i[chosen], last.j[chosen]
        way = np.take(places, i, axis=0) - np.take(self.of_all(places), j, axis=0)
        close = squares(way) < (share * last.radii[chosen] + slack) ** 2
        return i[close], j[close], way[close]


@dataclasses.dataclass(frozen=True, eq=False)
class _SearchedPairs:
    """The result of a search at places, shape (s, d), up to a distance: pairs with their distances and the radii of the second
    ones, shape (p,)."""

    places: Array
    far: float
    i: Numbers
    j: Numbers
    distances: Array
    radii: Array


def squares(vectors: Array) -> Array:
    """Return the squared lengths of vectors, shape (p, d) to (p,)."""
    return np.asarray(np.einsum("pi,pi->p", vectors, vectors))


def _pairs_within(places: Array, others: scipy.spatial.cKDTree, reach: float) -> tuple[Numbers, Numbers]:
    """Return the pairs of places and others in a tree that are nearer than ``reach``, sorted by the first, then the second."""
    pairs = scipy.spatial.cKDTree(places).sparse_distance_matrix(others, reach, output_type="ndarray")
    i, j = np.divmod(np.sort(pairs["i"].astype(np.int64) * others.n + pairs["j"]), max(others.n, 1))
    return i, j


def facing(surface: Surface, images: Array, reach: float) -> npt.NDArray[np.bool_]:
    """Return which facets at rest face another one, or an image of one (orthogonal matrices, the identity first, shape (g, d,
    d)), across air, shape (f,); ``reach`` is the largest distance between their middles."""
    count, d = len(surface.facets), surface.dimension
    places, areas = (values.reshape(count, -1, d) for values in surface.rest)
    middle, normal = places.mean(axis=1), areas.sum(axis=1)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    others, across = (np.einsum("gij,fj->gfi", images, vectors).reshape(-1, d) for vectors in (middle, normal))
    i, j = _pairs_within(middle, scipy.spatial.cKDTree(others), reach)
    chord = others[j] - middle[i]
    least = MIN_FACING_SINE * np.linalg.norm(chord, axis=1)
    faces = np.einsum("pi,pi->p", chord, normal[i]) > least
    faces &= np.einsum("pi,pi->p", chord, across[j]) < -least
    faces &= np.einsum("pi,pi->p", normal[i], across[j]) < MAX_NORMAL_PRODUCT
    mask = np.zeros(count, dtype=np.bool_)
    mask[i[faces]] = True
    mask[j[faces] % count] = True
    return mask


# ----------------------------------------------------------------------------------------------------------------------
# The smooth gap between a point and a wall, its penalty energy, and their derivatives.
#
# With r = x - y_j from a wall's samples to a point x, their area vectors m_j and a kernel K of radius R,
#
#     N = sum_j K(r_j) m_j . r_j      S = sum_j K(r_j) m_j      D = |S|      gap = N / D,
#
# the mean distance to the tangent planes of what is near: implicit moving least squares (Kolluri 2008, Provably good moving
# least squares, ACM Trans. Algorithms 4). It is exact for a flat wall whatever its mesh; it is twice differentiable, also
# across the edges and corners of facets, where the distance to the nearest point has kinks; and it has a sign. D is 1 in front
# of a continuous wall, and falls to 0 at its border. The energy of a point of undeformed area A is A c(D) phi(-gap).


PARTIAL_WALL, WHOLE_WALL = 0.1, 0.4
"""D above which a wall counts partly, and fully; it is 1/2 at a straight border."""


@dataclasses.dataclass(frozen=True)
class Penalty:
    """phi(d) of a penetration d: a pressure per penetration with a smoothed onset, as for a rigid plane.

    It counts from a gap ``ahead``: walls between the points of a rule may stand out by as much.
    """

    stiffness: float
    onset: float
    ahead: float = dataclasses.field(default=0.0, kw_only=True)

    def rates(self, d: Array) -> tuple[Array, Array, Array]:
        """Return phi and its first two derivatives."""
        k, e = self.stiffness, self.onset
        d = np.maximum(d, 0.0)
        early = d < e
        value = np.where(early, d**3 / (6 * e), d**2 / 2 - e * d / 2 + e**2 / 6)
        first = np.where(early, d**2 / (2 * e), d - e / 2)
        return k * value, k * first, k * np.where(early, d / e, 1.0)


def _share(D: Array) -> tuple[Array, Array, Array]:
    """Return how much of a wall's border counts, and the first two derivatives: 0 to 1, twice differentiable."""
    width = WHOLE_WALL - PARTIAL_WALL
    t = np.clip((D - PARTIAL_WALL) / width, 0.0, 1.0)
    value = t**3 * (10 - 15 * t + 6 * t**2)
    return value, 30 * t**2 * (1 - t) ** 2 / width, 60 * t * (1 - t) * (1 - 2 * t) / width**2


def kernels(r: Array, R: Array | float) -> Array:
    """Return K = (1 - r.r/R^2)^3 over its own integral on a plane, and its first two derivatives by r.r, shape (3, p), of r,
    shape (p, d), and the radius of each or of all."""
    s = np.einsum("pi,pi->p", r, r) / R**2
    t = np.maximum(1.0 - s, 0.0)
    unit = 32 / 35 * R if r.shape[1] == 2 else math.pi / 4 * R**2
    return np.stack([t**3, -3 * t**2 / R**2, 6 * t / R**4]) / unit


def gaps_of(N: Array, S: Array) -> Array:
    """Return the gaps of points with these sums, shapes (n,) and (n, d); infinite if no wall is near."""
    D = np.linalg.norm(S, axis=1)
    seen = D > PARTIAL_WALL
    return np.where(seen, N / np.where(seen, D, 1.0), np.inf)


@dataclasses.dataclass(frozen=True, eq=False)
class Near:
    """Pairs of samples with their kernels: i of the points and j of the wall, shape (p,), which image of the wall it is, r =
    x_i - y_j and area vectors m of j, both of the image, shape (p, d), and the kernel K with its first two derivatives by
    r.r, shape (3, p)."""

    i: Numbers
    j: Numbers
    image: Numbers
    r: Array
    m: Array
    K: Array

    @classmethod
    def of(cls, pairs: Pairs, places: Array, areas: Array) -> Near:
        """Return the pairs in a shape of the walls, by places and areas of the samples, shape (s, d) each."""
        i, number, r = pairs.within(places, 1.0)
        image, j = np.divmod(number, len(places))
        return cls(i, j, image, r, np.take(pairs.of_all(areas), number, axis=0), kernels(r, pairs.radius[j]))

    def sums(self, count: int) -> tuple[Array, Array]:
        """Return N, shape (count,), and S, shape (count, d), of each point."""
        along = np.einsum("pi,pi->p", self.m, self.r)
        return np.bincount(self.i, self.K[0] * along, count), _summed(self.i, self.K[0][:, None] * self.m, count)

    def gaps(self, count: int) -> Array:
        """Return the gap of each point, shape (count,); see `gaps_of`."""
        return gaps_of(*self.sums(count))

    def of_points(self, chosen: np.ndarray) -> Near:
        """Return those whose points are chosen, a mask of shape (s,)."""
        which = chosen[self.i]
        return Near(self.i[which], self.j[which], self.image[which], self.r[which], self.m[which], self.K[:, which])


@dataclasses.dataclass(frozen=True, eq=False)
class PointEnergies:
    """Energies of points, shape (n,), as functions of their N and S, with first derivatives, shape (n, 1 + d), and second
    ones, shape (n, 1 + d, 1 + d)."""

    value: Array
    first: Array
    second: Array

    @classmethod
    def of_touching(cls, on: np.ndarray, N: Array, S: Array, area: Array, penalty: Penalty) -> PointEnergies:
        """Return those of the points that touch, a mask of shape (n,); zero of all others. The rest is as for `of`."""
        count, d = S.shape
        value, first, second = np.zeros(count), np.zeros((count, 1 + d)), np.zeros((count, 1 + d, 1 + d))
        energies = cls.of(N[on], S[on], area[on], penalty)
        value[on], first[on], second[on] = energies.value, energies.first, energies.second
        return cls(value, first, second)

    @classmethod
    def of(cls, N: Array, S: Array, area: Array, penalty: Penalty) -> PointEnergies:
        """Return those of points with D above 0, of sums N and S, shapes (n,) and (n, d), and undeformed areas, shape (n,)."""
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
    """Return the derivatives of sum e(N, S) by r and by m of each pair, shape (p, d) each, where e's by N and S are
    ``first``."""
    a, b = first[near.i, 0], first[near.i, 1:]
    v = a[:, None] * near.r + b
    along = np.einsum("pi,pi->p", near.m, v)
    by_r = (2 * near.K[1] * along)[:, None] * near.r + (near.K[0] * a)[:, None] * near.m
    return by_r, near.K[0][:, None] * v


def pair_curvatures(near: Near, first: Array) -> Array:
    """Return the second derivatives of a N + b . S by (r, m) of each pair, a and b held, shape (p, 2d, 2d)."""
    d = near.r.shape[1]
    a, b = first[near.i, 0], first[near.i, 1:]
    r, m, (K, K1, K2), eye = near.r, near.m, near.K, np.eye(d)
    v = a[:, None] * r + b
    along = np.einsum("pi,pi->p", m, v)
    rm = r[:, :, None] * m[:, None, :]
    curvatures = np.zeros((len(a), 2 * d, 2 * d))
    curvatures[:, :d, :d] = (4 * K2 * along)[:, None, None] * r[:, :, None] * r[:, None, :]
    curvatures[:, :d, :d] += (2 * K1 * along)[:, None, None] * eye + (2 * K1 * a)[:, None, None] * (rm + rm.transpose(0, 2, 1))
    mixed = (2 * K1)[:, None, None] * r[:, :, None] * v[:, None, :] + (K * a)[:, None, None] * eye
    curvatures[:, :d, d:], curvatures[:, d:, :d] = mixed, mixed.transpose(0, 2, 1)
    return curvatures


def sum_rates(near: Near) -> Array:
    """Return the derivatives of each pair's share of N and S by (r, m), shape (p, 1 + d, 2d)."""
    d = near.r.shape[1]
    r, m, (K, K1, _) = near.r, near.m, near.K
    along = np.einsum("pi,pi->p", m, r)
    rates = np.zeros((len(along), 1 + d, 2 * d))
    rates[:, 0, :d] = (2 * K1 * along)[:, None] * r + K[:, None] * m
    rates[:, 0, d:] = K[:, None] * r
    rates[:, 1:, :d] = (2 * K1)[:, None, None] * m[:, :, None] * r[:, None, :]
    rates[:, 1:, d:] = K[:, None, None] * np.eye(d)
    return rates


# ----------------------------------------------------------------------------------------------------------------------
# Energy, forces and stiffness of walls in contact, by node positions.


@dataclasses.dataclass(eq=False)
class Pressed:
    """Walls in a deformed shape, by their nodes' places, shape (n, d). Every pair of walls is counted from both sides, with
    half the energy each."""

    pairs: Pairs
    penalty: Penalty
    nodes: Array

    def __post_init__(self) -> None:
        surface = self.pairs.surface
        self.surface = surface
        self.places, self.areas = surface.places(self.nodes), surface.areas(self.nodes)
        near = Near.of(self.pairs, self.places, self.areas)
        self.N, self.S = near.sums(len(self.places))
        self.gaps = gaps_of(self.N, self.S)
        self.touching = self.gaps < self.penalty.ahead
        self._all_near, self.near = near, near.of_points(self.touching)

    @functools.cached_property
    def points(self) -> PointEnergies:
        """Energies of the points that touch; zero of all others."""
        return PointEnergies.of_touching(self.touching, self.N, self.S, self.surface.measure / 2, self.penalty)

    @property
    def energy(self) -> float:
        return float(self.points.value.sum())

    @property
    def depth(self) -> float:
        """Largest penetration; negative if nothing touches."""
        return -float(self.gaps.min(initial=np.inf))

    @property
    def pressed_force(self) -> float:
        """Sum of the force magnitudes between points and walls; a pair of walls counts once."""
        return float(-self.points.first[:, 0] @ np.linalg.norm(self.S, axis=1))

    def coupled(self, soon: float) -> scipy.sparse.csr_array:
        """Return which nodes are coupled through a point that touches or is within ``soon`` radii, booleans of shape (n, n)."""
        surface, near = self.surface, self._all_near
        close = self.gaps < soon * self.pairs.radius
        near = near.of_points(close)
        facets = surface.facets[surface.owner]
        i, nodes = np.concatenate([near.i, near.i]), np.concatenate([facets[near.i], facets[near.j]])
        return together(i, nodes, (len(self.gaps), len(self.nodes)))

    def _by_samples(self) -> tuple[Array, Array]:
        """Return the derivatives of the energy by the samples' places and by their area vectors, shape (s, d) each."""
        by_r, by_m = pair_rates(self.near, self.points.first)
        count = len(self.S)
        i, j, back = self.near.i, self.near.j, self.pairs.images[self.near.image]
        at_wall, by_m = np.einsum("pji,pj->pi", back, by_r), np.einsum("pji,pj->pi", back, by_m)
        return _summed(i, by_r, count) - _summed(j, at_wall, count), _summed(j, by_m, count)

    @functools.cached_property
    def forces(self) -> Array:
        """Derivative of the energy by the nodes' places, shape (n, d)."""
        forces = np.zeros_like(self.nodes)
        if self.touching.any():
            by_places, by_areas = self._by_samples()
            at_nodes = np.einsum("sa,si->sai", self.surface.shapes, by_places)
            at_nodes += np.einsum("si,siaj->saj", by_areas, self.surface.area_rates(self.nodes))
            np.add.at(forces, self.surface.facets[self.surface.owner], at_nodes)
        return forces

    @functools.cached_property
    def stiffness(self) -> scipy.sparse.csr_array:
        """Second derivative of the energy, shape (n d, n d); nodes' components follow each other."""
        n, d = self.nodes.shape
        if not self.touching.any():
            return scipy.sparse.csr_array((n * d, n * d))
        by_samples, by_sums = self._curvatures()
        samples = self._sample_rates()
        sums = by_sums @ samples
        stiffness = samples.T @ (by_samples @ samples) + sums.T @ (_diagonal(self.points.second[self.touching]) @ sums)
        if d == 3:
            facets = self.surface.facets
            pressed = np.unique(self.near.j)
            bent = self.surface.area_curvatures(self._by_samples()[1][pressed], pressed)
            dofs = components_of(facets[self.surface.owner[pressed]], d)
            stiffness = stiffness + scattered(bent.reshape(len(pressed), dofs.shape[1], -1), dofs, dofs, n * d, n * d)
        return scipy.sparse.csr_array((stiffness + stiffness.T) / 2)

    def _sample_rates(self) -> scipy.sparse.bsr_array:
        """Return the derivative of the samples' places, then of their area vectors, by the nodes' places, (2 s d, n d)."""
        surface, (n, d) = self.surface, self.nodes.shape
        at_places = surface.shapes[:, :, None, None] * np.eye(d)
        at_areas = surface.area_rates(self.nodes).transpose(0, 2, 1, 3)
        columns = np.tile(surface.facets[surface.owner], (2, 1))
        return _blocks(np.concatenate([at_places, at_areas]), columns, n)

    def _curvatures(self) -> tuple[scipy.sparse.bsr_array, scipy.sparse.bsr_array]:
        """Return the second derivative of the energy by the samples' places, then area vectors, its derivatives by the sums N
        and S held, shape (2 s d, 2 s d), and the derivative of the sums of points that touch, shape (t (1 + d), 2 s d)."""
        near, d, count, pairs = self.near, self.nodes.shape[1], len(self.S), len(self.near.i)
        turn = self.pairs.images[near.image]
        # of a pair (r, m): r = x_i - Q y_j, m = Q times the area vector of j
        by_samples = np.zeros((pairs, 3, 2, d, d))
        by_samples[:, 0, 0], by_samples[:, 1, 0], by_samples[:, 2, 1] = np.eye(d), -turn, turn
        columns = np.column_stack([near.i, near.j, count + near.j])
        own = _blocks(by_samples.reshape(pairs, 3, 2 * d, d), columns, 2 * count)
        ends = np.searchsorted(near.i, np.flatnonzero(self.touching), side="right")
        shares = (sum_rates(near), np.arange(pairs), np.append(0, ends))
        sums = scipy.sparse.bsr_array(shares, shape=(len(ends) * (1 + d), pairs * 2 * d))
        return own.T @ (_diagonal(pair_curvatures(near, self.points.first)) @ own), sums @ own


def _blocks(blocks: Array, columns: Numbers, width: int) -> scipy.sparse.bsr_array:
    """Return the matrix of rows of k small dense blocks each, shape (rows, k, a, b), by the blocks' ``columns``, shape (rows,
    k), of which there are ``width``."""
    rows, k, a, b = blocks.shape
    entries = (blocks.reshape(-1, a, b), columns.ravel(), k * np.arange(rows + 1))
    return scipy.sparse.bsr_array(entries, shape=(rows * a, width * b))


def _diagonal(blocks: Array) -> scipy.sparse.bsr_array:
    """Return the matrix with small dense blocks, shape (t, a, a), on its diagonal."""
    return _blocks(blocks[:, None], np.arange(len(blocks)), len(blocks))


def _summed(at: Numbers, rows: Array, count: int) -> Array:
    """Return the sums of the rows, shape (p, d), that belong to the same of so many points, shape (count, d)."""
    return np.column_stack([np.bincount(at, column, count) for column in rows.T])


def components_of(nodes: Numbers, d: int) -> Numbers:
    """Return the numbers of the components of nodes, shape (p, a) to (p, a d)."""
    return np.asarray((d * nodes[:, :, None] + np.arange(d)).reshape(len(nodes), d * nodes.shape[1]))


def together(groups: Numbers, nodes: Numbers, shape: tuple[int, int]) -> scipy.sparse.csr_array:
    """Return which pairs of nodes share a group; ``groups``, shape (p,), has that of each row of ``nodes``, shape (p, a), and
    ``shape`` how many groups and nodes there are."""
    at = (np.repeat(groups, nodes.shape[1]), nodes.ravel())
    held = scipy.sparse.csr_array(scipy.sparse.coo_array((np.ones(nodes.size, dtype=np.int32), at), shape=shape))
    return scipy.sparse.csr_array((held.T @ held) > 0)


def scattered(blocks: Array, rows: Numbers, columns: Numbers, height: int, width: int) -> scipy.sparse.csr_array:
    """Return the sum of small dense blocks, shape (p, a, b), in a sparse matrix; ``rows`` (p, a) and ``columns`` (p, b) are
    theirs."""
    _, a, b = blocks.shape
    at = (np.repeat(rows, b, axis=1).ravel(), np.tile(columns, (1, a)).ravel())
    return scipy.sparse.csr_array(scipy.sparse.coo_array((blocks.ravel(), at), shape=(height, width)))


# ----------------------------------------------------------------------------------------------------------------------
# Contact of a device's faces in a deformed shape, as independent sums over their samples.


class PressedSamples(abc.ABC):
    """Sums over samples of faces, by their nodes' places, shape (n, d); each kind defines the energy of a sample. ``gaps`` of
    the samples are below zero where they are pressed on (``touching``), shape (s,)."""

    gaps: Array
    touching: np.ndarray

    def __init__(self, surface: Surface, nodes: Array):
        self.surface, self.nodes = surface, nodes

    @property
    @abc.abstractmethod
    def energy(self) -> float:
        """Energy of all samples."""

    @abc.abstractmethod
    def slopes(self) -> Array:
        """Return the derivative of the energy by the samples' places, shape (s, d)."""

    @abc.abstractmethod
    def curvatures(self) -> Array:
        """Return the second derivative by the place of each sample that touches, shape (t, d, d)."""

    @abc.abstractmethod
    def gap_rates(self, places: Array) -> Array:
        """Return the derivative of the gaps along a motion of the samples, shapes (s,) and (s, d); zero of infinite ones."""

    @abc.abstractmethod
    def soon(self, share: float) -> np.ndarray:
        """Return the samples that touch or soon may, a mask of shape (s,); ``share`` is relative to the kind's near
        distance."""

    @property
    def depth(self) -> float:
        """Largest penetration of a sample; negative if none penetrates."""
        return -float(self.gaps.min(initial=np.inf))

    @functools.cached_property
    def forces(self) -> Array:
        """Derivative of the energy by the nodes' places, shape (n, d)."""
        forces = np.zeros_like(self.nodes)
        at_nodes = np.einsum("sa,si->sai", self.surface.shapes, self.slopes())
        np.add.at(forces, self.surface.facets[self.surface.owner], at_nodes)
        return forces

    @functools.cached_property
    def stiffness(self) -> scipy.sparse.csr_array:
        """Second derivative of the energy, shape (n d, n d); nodes' components follow each other."""
        stiffness = self.scattered(self.curvatures())
        return scipy.sparse.csr_array((stiffness + stiffness.T) / 2)

    def scattered(self, curvatures: Array) -> scipy.sparse.csr_array:
        """Return the matrix, shape (n d, n d), of what is by the place of each sample that touches, shape (t, d, d)."""
        n, d = self.nodes.shape
        touching = np.flatnonzero(self.touching)
        if not len(touching):
            return scipy.sparse.csr_array((n * d, n * d))
        shapes = self.surface.shapes[touching]
        dofs = components_of(self.surface.facets[self.surface.owner[touching]], d)
        blocks = np.einsum("sa,sb,sij->saibj", shapes, shapes, curvatures)
        return scattered(blocks.reshape(len(touching), dofs.shape[1], -1), dofs, dofs, n * d, n * d)

    def near_facets(self, share: float) -> Numbers:
        """Return the nodes of the facets with a sample that touches or soon may, shape (f, k)."""
        return self.surface.facets[np.unique(self.surface.owner[self.soon(share)])]

    def coupled(self, share: float) -> scipy.sparse.csr_array:
        """Return the nodes that share such a facet, true for each two, shape (n, n)."""
        facets = self.near_facets(share)
        return together(np.arange(len(facets)), facets, (len(facets), len(self.nodes)))


# ----------------------------------------------------------------------------------------------------------------------
# Contact of faces with a body of known signed distance, with the energy of rigid shapes.


type Slopes = Callable[[Array], tuple[Array, Array, Array]]
"""Of places, shape (s, d): their distances, the distances' gradients (s, d), and their second derivatives (s, d, d)."""


@dataclasses.dataclass(frozen=True)
class HardeningPenalty(Penalty):
    """The same penalty, stiffening with the penetration: beyond a depth ``soft`` phi gets ``harder / (6 soft) (d - soft)^3``
    more, times the stiffness."""

    soft: float
    harder: float

    def rates(self, d: Array) -> tuple[Array, Array, Array]:
        value, first, second = super().rates(d)
        k, over = self.stiffness * self.harder / self.soft, np.maximum(d - self.soft, 0.0)
        return value + k * over**3 / 6, first + k * over**2 / 2, second + k * over


class PressedByDistance(PressedSamples):
    """A device's faces in a deformed shape, in contact with such a body, whose distance comes with its derivatives; ``near``
    is the distance that counts as near."""

    def __init__(self, surface: Surface, slopes: Slopes, penalty: Penalty, near: float, nodes: Array):
        super().__init__(surface, nodes)
        self._near = near
        self.gaps, gradients, seconds = slopes(surface.places(nodes))
        self.touching = self.gaps < 0.0
        phi, self._first, self._second = (surface.measure * rate for rate in penalty.rates(-self.gaps))
        self._energy = float(phi[self.touching].sum())
        self._gradients, self._seconds = gradients, seconds

    @property
    def energy(self) -> float:
        return self._energy

    def slopes(self) -> Array:
        return np.asarray(-np.where(self.touching, self._first, 0.0)[:, None] * self._gradients)

    def curvatures(self) -> Array:
        on = self.touching
        g = self._gradients[on]
        along = self._second[on, None, None] * g[:, :, None] * g[:, None, :]
        return np.asarray(along - self._first[on, None, None] * self._seconds[on])

    def gap_rates(self, places: Array) -> Array:
        return _dot(self._gradients, places)

    def soon(self, share: float) -> np.ndarray:
        return np.asarray(self.gaps < share * self._near)


# ----------------------------------------------------------------------------------------------------------------------
# Contact with a fixed wall, such as the surface of a rigid body.


MAX_PIECE_EDGE = 0.5
"""Longest edge, in kernel radii, of the pieces of a triangle with one sample each."""
MAX_SAMPLES = 1_000_000


class TooFineError(ValueError):
    """The wall would have too many samples."""


@dataclasses.dataclass(frozen=True, eq=False)
class FixedWall:
    """Samples of a closed surface: places, area vectors out of the body, shape (s, 3) each, and the radius of all kernels."""

    places: Array
    areas: Array
    radius: float

    @classmethod
    def of(cls, points: Array, triangles: Numbers, radius: float) -> FixedWall:
        """Return the samples of triangles, in the middles of pieces that are small against the kernel's radius: corners, shape
        (n, 3), and their numbers, counter-clockwise as seen from outside, shape (t, 3). `TooFineError` if there would be
        more than `MAX_SAMPLES`."""
        corners = _cut(np.asarray(points[triangles], dtype=float), MAX_PIECE_EDGE * radius)
        areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
        return cls(corners.mean(axis=1), areas, radius)

    @functools.cached_property
    def tree(self) -> scipy.spatial.cKDTree:
        return scipy.spatial.cKDTree(self.places)

    def near(self, places: Array) -> Near:
        """Return the pairs of points, shape (n, 3), and samples nearer than the radius."""
        i, j = _pairs_within(places, self.tree, self.radius)
        r = places[i] - self.places[j]
        return Near(i, j, np.zeros_like(i), r, self.areas[j], kernels(r, self.radius))

    def gaps(self, places: Array) -> Array:
        """Return the smooth distance of points, shape (n, 3), from the wall, below zero behind it; infinite where none is
        near."""
        return gaps_of(*self.near(places).sums(len(places)))


def _cut(corners: Array, longest: float) -> Array:
    """Return the triangles, shape (t, 3, 3), halved through their longest edges until none is longer."""
    done: list[Array] = []
    count = 0
    while len(corners):
        edges = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
        short = edges.max(axis=1) <= longest
        done.append(corners[short])
        count += int(short.sum())
        corners, edges = corners[~short], edges[~short]
        if count + 2 * len(corners) > MAX_SAMPLES:
            raise TooFineError
        first = edges.argmax(axis=1)[:, None]  # from the first corner of the longest edge on
        a, b, c = (np.take_along_axis(corners, ((first + k) % 3)[:, :, None], axis=1)[:, 0] for k in range(3))
        middle = (a + b) / 2
        corners = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
    return np.concatenate(done) if done else np.empty((0, 3, 3))


class PressedOn(PressedSamples):
    """A device's faces in a deformed shape, in contact with a fixed wall."""

    def __init__(self, surface: Surface, wall: FixedWall, penalty: Penalty, nodes: Array):
        super().__init__(surface, nodes)
        self.wall, self.penalty = wall, penalty
        places = surface.places(nodes)
        near = wall.near(places)
        self.N, self.S = near.sums(len(places))
        self.gaps = gaps_of(self.N, self.S)
        self.touching = self.gaps < 0.0
        self._all_near, self.near = near, near.of_points(self.touching)

    @functools.cached_property
    def _energies(self) -> PointEnergies:
        """Values of the points in contact; zero for all others."""
        return PointEnergies.of_touching(self.touching, self.N, self.S, self.surface.measure, self.penalty)

    @property
    def energy(self) -> float:
        return float(self._energies.value.sum())

    def slopes(self) -> Array:
        return _summed(self.near.i, pair_rates(self.near, self._energies.first)[0], len(self.S))

    def curvatures(self) -> Array:
        d, touching, near = self.S.shape[1], np.flatnonzero(self.touching), self.near
        points = (np.cumsum(self.touching) - 1)[near.i]
        own, rates = np.zeros((len(touching), d, d)), np.zeros((len(touching), 1 + d, d))
        np.add.at(own, points, pair_curvatures(near, self._energies.first)[:, :d, :d])
        np.add.at(rates, points, sum_rates(near)[:, :, :d])
        return np.asarray(own + np.einsum("sai,sab,sbj->sij", rates, self._energies.second[touching], rates))

    def gap_rates(self, places: Array) -> Array:
        near, D = self._all_near, np.linalg.norm(self.S, axis=1) + SMALLEST_DENOMINATOR
        rates = np.einsum("pai,pi->pa", sum_rates(near)[:, :, : places.shape[1]], places[near.i])
        rates = _summed(near.i, rates, len(D))
        gap_rates = rates[:, 0] / D - self.N / D**3 * _dot(self.S, rates[:, 1:])
        return np.where(np.isfinite(self.gaps), gap_rates, 0.0)

    def soon(self, share: float) -> np.ndarray:
        """Return the samples nearer than ``share`` radii of the kernel."""
        return np.asarray(self.gaps < share * self.wall.radius)


# ----------------------------------------------------------------------------------------------------------------------
# Coulomb friction of faces on a fixed body: history variables of the samples, forces and stiffness.
#
# A sample in contact sticks elastically to its anchor, where it first touched, and slides once displaced by e.
# With the displacement v from the anchor, the surface normal n and the normal force f:
#
#     s = v - n (n . v)       t = mu |f| g(|s| / e) s / |s|       g(y) = 2 y - y^2 below 1, and 1 from there on
#
# If |s| > e it slides, and the anchor follows at a distance e: the return mapping of plasticity (Wriggers 2006,
# Computational Contact Mechanics, doi 10.1007/978-3-540-32609-0, chapter 10), with the smooth onset of Li et al. 2020,
# Incremental Potential Contact, doi 10.1145/3386569.3392425. Between two accepted states the path is a straight line,
# so states depend on the steps to first order. The derivative of t is not symmetric, because the normal force
# changes too. Newton's method uses all of it; the factorised matrix, and with it the path's tangent and stability, uses it at
# constant mu |f|: then t is the derivative of a convex function, and the matrix is symmetric.


AT_LIMIT = 1e-9
"""Tolerance relative to e for sliding, because accepted states reach e only to rounding."""
SMALLEST_DENOMINATOR = 1e-300
"""Added to denominators to avoid division by zero."""


@dataclasses.dataclass(frozen=True)
class Rubbing:
    """A coefficient of friction mu and its elastic slip e, in sizes."""

    coefficient: float
    onset: float

    def rates(self, far: Array) -> tuple[Array, Array]:
        """Return g of slips, shape (t,), and its derivative by the slip."""
        y = np.minimum(far / self.onset, 1.0)
        return y * (2 - y), 2 * (1 - y) / self.onset

    def drawn(self, far: Array) -> Array:
        """Return the integral of g up to ways, shape (t,), and not beyond e."""
        y = np.minimum(far / self.onset, 1.0)
        return self.onset * (y**2 - y**3 / 3)


@dataclasses.dataclass(frozen=True, eq=False)
class FrictionHistory:
    """History variables of the samples at the last accepted state, in sizes and shear moduli, shape (s,) each.

    Attributes:
        held: Where they were held; of those that did not touch, where they were, shape (s, d).
        gaps: Their distances from the body, below zero of those that touched.
        limits: mu times the forces that pressed on them.
        drawn: `Rubbing.drawn` of them.
        slid: How far each has slid so far.
        lost: Work against friction so far; what has drawn those that stick comes back.
    """

    held: Array
    gaps: Array
    limits: Array
    drawn: Array
    slid: Array
    lost: float

    @classmethod
    def of_free(cls, pressed: PressedSamples) -> FrictionHistory:
        """Return the history of faces without contact so far."""
        places = pressed.surface.places(pressed.nodes)
        limits, drawn, slid = np.zeros((3, len(places)))
        return cls(places, pressed.gaps, limits, drawn, slid, 0.0)


# ----------------------------------------------------------------------------------------------------------------------
# Friction of faces on a body: how they rub, and the state that was kept last.


class Rubbed(PressedSamples):
    """A device's faces in a deformed shape, in frictional contact with a body: the same without friction, how they rub, and
    the state that was kept last.

    ``pulls`` are forces of friction on the samples that touch, as derivatives of an energy, shape (t, d); ``slides`` says
    which of these slide.
    """

    def __init__(self, pressed: PressedSamples, rubbing: Rubbing, grip: FrictionHistory):
        super().__init__(pressed.surface, pressed.nodes)
        self.pressed, self.rubbing, self.grip = pressed, rubbing, grip
        self.gaps, self.touching = pressed.gaps, pressed.touching
        on = self.touching
        self._places = self.surface.places(self.nodes)
        push = pressed.slopes()[on]
        self._push = np.linalg.norm(push, axis=1)
        self._normal = push / (self._push + SMALLEST_DENOMINATOR)[:, None]
        self.limits = rubbing.coefficient * self._push
        self._far = (self._places - grip.held)[on]
        # A sample in contact since then is anchored where it touched, after a free motion. For a body from
        # a file its earlier distance is unknown, but at most that motion.
        before, self._moved, self._depth = grip.gaps[on], np.linalg.norm(self._far, axis=1), -self.gaps[on]
        self._gone = np.clip(before, 0.0, self._moved)
        self._new, self._unknown = self._gone > 0.0, before >= self._moved
        self._whole = self._gone + self._depth + SMALLEST_DENOMINATOR
        self._share = np.where(self._new, self._depth / self._whole, 1.0)
        self._way = self._share[:, None] * self._far
        s = self._way - self._normal * _dot(self._normal, self._way)[:, None]
        self._size = np.linalg.norm(s, axis=1)
        self._along = s / (self._size + SMALLEST_DENOMINATOR)[:, None]
        self._grip, self._grip_rate = rubbing.rates(self._size)
        self.slides = self._size > (1 - AT_LIMIT) * rubbing.onset
        self.pulls = (self.limits * self._grip)[:, None] * self._along

    @property
    def energy(self) -> float:
        """Energy of the contact only, without the dissipation of friction."""
        return self.pressed.energy

    def slopes(self) -> Array:
        slopes = np.array(self.pressed.slopes())
        slopes[self.touching] += self.pulls
        return slopes

    def curvatures(self) -> Array:
        """Return the second derivative by the place of each sample that touches, the limits held: symmetric, shape (t, d,
        d)."""
        n, a = self._normal, self._along
        flat = np.eye(n.shape[1]) - _outer(n, n)
        return np.asarray(self._pressing + self._share[:, None, None] * (self._drawn(a) @ flat))

    def gap_rates(self, places: Array) -> Array:
        return self.pressed.gap_rates(places)

    def _drawn(self, a: Array) -> Array:
        """Return the derivative of the pulls by s, the limits held, shape (t, d, d)."""
        eye, along = np.eye(a.shape[1]), _outer(a, a)
        across = 2 / self.rubbing.onset - self._size / self.rubbing.onset**2  # g / |s|, also where that is 0 / 0
        across = np.where(self._size < self.rubbing.onset, across, 1 / (self._size + SMALLEST_DENOMINATOR))
        drawn = across[:, None, None] * (eye - along) + self._grip_rate[:, None, None] * along
        return np.asarray(self.limits[:, None, None] * drawn)

    def whole_curvatures(self) -> Array:
        """Return the derivative of the forces itself, not symmetric, shape (t, d, d)."""
        rest, still = np.zeros_like(self._way), np.zeros(len(self._way))
        ways = (np.broadcast_to(way, rest.shape) for way in np.eye(rest.shape[1]))
        return np.asarray(self._pressing + np.stack([self.pull_rates(way, rest, still) for way in ways], axis=2))

    def pull_rates(self, places: Array, held: Array, gaps: Array) -> Array:
        """Return the derivative of `pulls` along motions against the body of the samples that touch and of where they were
        held, shape (t, d) each, and along changes of their earlier distances, shape (t,)."""
        drawn = np.einsum("tij,tj->ti", self._drawn(self._along), self._way_rates(places, held, gaps))
        harder = self.rubbing.coefficient * _dot(self._normal, self._push_rates(places))
        return np.asarray(drawn + (self._grip * harder)[:, None] * self._along)

    @functools.cached_property
    def _pressing(self) -> Array:
        return self.pressed.curvatures()

    def _push_rates(self, places: Array) -> Array:
        return np.asarray(np.einsum("tij,tj->ti", self._pressing, places))

    def _way_rates(self, places: Array, held: Array, gaps: Array) -> Array:
        """Return the same of s."""
        n, far = self._normal, places - held
        # The normal rotates with the normal force, and the share depends on the penetration, whose gradient is n.
        turn = self._push_rates(places)
        turn = (turn - n * _dot(n, turn)[:, None]) / (self._push + SMALLEST_DENOMINATOR)[:, None]
        gone = np.where(self._unknown, _dot(self._far, far) / (self._moved + SMALLEST_DENOMINATOR), gaps)
        share = np.where(self._new, (self._gone * _dot(n, places) - self._depth * gone) / self._whole**2, 0.0)
        way = self._share[:, None] * far + share[:, None] * self._far
        return np.asarray(way - n * (_dot(n, way) + _dot(turn, self._way))[:, None] - turn * _dot(n, self._way)[:, None])

    def kept_rates(self, places: Array, held: Array, gaps: Array) -> tuple[Array, Array]:
        """Return the derivatives of the `FrictionHistory.held` and ``gaps`` of `kept` along the same, of all samples."""
        on, kept = self.touching, places.copy()
        way, a = self._way_rates(places[on], held[on], gaps[on]), self._along
        across = (way - a * _dot(a, way)[:, None]) * (self.rubbing.onset / (self._size + SMALLEST_DENOMINATOR))[:, None]
        kept[on] -= np.where((self._size < self.rubbing.onset)[:, None], way, across)
        return kept, self.pressed.gap_rates(places)

    @functools.cached_property
    def whole_stiffness(self) -> scipy.sparse.csr_array:
        """The derivative of `forces` itself, not symmetric, shape (n d, n d)."""
        return self.scattered(self.whole_curvatures())

    def soon(self, share: float) -> np.ndarray:
        return self.pressed.soon(share)

    def kept(self) -> FrictionHistory:
        """Return the history variables once this state is accepted."""
        on, grip = self.touching, self.grip
        held = self._places.copy()
        limits, drawn, slip = np.zeros((3, len(held)))
        reach = np.minimum(self._size, self.rubbing.onset)
        held[on] -= reach[:, None] * self._along
        limits[on], drawn[on], slip[on] = self.limits, self.rubbing.drawn(self._size), self._size - reach
        # The normal force changes linearly in between.
        lost = float(((grip.limits + limits) / 2 * (drawn - grip.drawn + slip)).sum())
        return FrictionHistory(held, self.gaps, limits, drawn, grip.slid + slip, grip.lost + lost)

    @property
    def sliding(self) -> float:
        """Share of the normal force at sliding samples; 0 without contact."""
        whole = float(self._push.sum())
        return float(self._push[self.slides].sum()) / whole if whole > 0.0 else 0.0


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("ti,ti->t", a, b))


def _outer(a: Array, b: Array) -> Array:
    return np.asarray(a[:, :, None] * b[:, None, :])


# ----------------------------------------------------------------------------------------------------------------------
# Contact with a body movable along a line: on a spring, or with a weight resting on a stand.
#
# Its position s on the line minimises the energy, so it is not a separate unknown. With the energy phi of the faces against the
# body where it stands, and that of its stand,
#
#     Phi(x) = min over s of phi(x - s a) + e(s),     Phi' = phi',     Phi'' = phi'' - v v^T / k,
#
# where v = phi'' A, A moves all nodes along a, and k = e'' + A.v. Unstable directions of Phi are those of the whole
# system (Haynsworth's inertia theorem, doi 10.1016/0024-3795(68)90050-5), as k is above zero where s is stable.


MAX_STEPS = 80
"""Maximum number of steps to find the position: Newton's, or bisections."""
STEP_TOLERANCE = 1e-14
"""Convergence tolerance of the step, relative to the device's size."""
MAX_STEP = 0.02
"""Maximum step, relative to the size, because a body far from the faces feels no force."""


@dataclasses.dataclass(frozen=True)
class Support:
    """The support of a body: a spring (force per way), and a stand under its weight, a force below zero where it is pulled off
    and only the spring holds it.

    The weight is taken off the stand over a short way, the onset, so that stiffnesses have no jump: the stand's force is
    ``weight * tanh(s / onset)`` above it, and grows as steeply below it.
    """

    spring: float
    weight: float
    onset: float

    def energy(self, s: float) -> float:
        if self.weight <= 0.0:
            return self.spring * s**2 / 2 + self.weight * s
        t = s / self.onset
        above = abs(t) + math.log1p(math.exp(-2 * abs(t))) - math.log(2)
        return self.spring * s**2 / 2 + self.weight * self.onset * (above if t > 0 else t**2 / 2)

    def force(self, s: float) -> float:
        """Return the restoring force."""
        if self.weight <= 0.0:
            return self.spring * s + self.weight
        t = s / self.onset
        return self.spring * s + self.weight * (math.tanh(t) if t > 0 else t)

    def stiffness(self, s: float) -> float:
        if self.weight <= 0.0:
            return self.spring
        t = s / self.onset
        return self.spring + self.weight / self.onset * ((1 - math.tanh(t) ** 2) if t > 0 else 1.0)


class GivingWay:
    """Faces in a deformed shape, in contact with such a body on a line of direction ``along``, looked for from a place on it;
    ``pressed`` gives the faces pressed on by the body in its first place.

    Attributes:
        s: Its place.
        here: The faces, moved to the body.
        v: How the forces change as the faces go along the line as a whole, shape (n d,).
        k: Second derivative of the energy by s.
    """

    def __init__(self, pressed: Callable[[Array], PressedSamples], stand: Support, along: Array, nodes: Array, start: float):
        self.stand, self.along = stand, along
        low, high, s, all_along = -math.inf, math.inf, start, np.tile(along, len(nodes))
        for _ in range(MAX_STEPS):
            self.here, self.s = pressed(nodes - s * along), s
            self.v = np.asarray(self.here.stiffness @ all_along)
            self.k = k = stand.stiffness(s) + float(all_along @ self.v)
            surplus = stand.force(s) - self.push
            low, high = (low, s) if surplus > 0.0 else (s, high)
            step = -surplus / k if k > 0.0 else -math.copysign(MAX_STEP, surplus)
            after = s + float(np.clip(step, -MAX_STEP, MAX_STEP))
            if not low < after < high:
                after = (low + high) / 2 if math.isfinite(high - low) else s
            if surplus == 0.0 or abs(after - s) < STEP_TOLERANCE:
                return
            s = after

    @property
    def push(self) -> float:
        """Force of the faces on the body along its line."""
        return float(self.here.forces.sum(axis=0) @ self.along)

    @property
    def energy(self) -> float:
        return self.here.energy + self.stand.energy(self.s)

    @property
    def forces(self) -> Array:
        return self.here.forces

    @property
    def stiffness(self) -> scipy.sparse.csr_array:
        v = self.v
        at = np.flatnonzero(v)
        rows, columns = (part.ravel() for part in np.meshgrid(at, at, indexing="ij"))
        less = scipy.sparse.coo_array((np.outer(v[at], v[at]).ravel() / self.k, (rows, columns)), shape=(len(v), len(v)))
        return scipy.sparse.csr_array(self.here.stiffness - less)

    def harder(self) -> Array:
        """Return the derivative of the forces by a common factor on spring and weight, shape (n, d)."""
        return np.asarray(self.v * self.stand.force(self.s) / self.k).reshape(self.here.nodes.shape)

    def coupled(self, share: float) -> scipy.sparse.csr_array:
        """Return all nodes near the body are, as it gives way to each of them, true for each two, shape (n, n)."""
        near, n = np.unique(self.here.near_facets(share)), len(self.here.nodes)
        rows, columns = (part.ravel() for part in np.meshgrid(near, near, indexing="ij"))
        ones = np.ones(len(rows), dtype=np.bool_)
        return scipy.sparse.csr_array(scipy.sparse.coo_array((ones, (rows, columns)), shape=(n, n)))
