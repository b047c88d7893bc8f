"""Contact of two bodies: points of each surface against the nearest place on the other, with friction.

A point x of one surface has its nearest place y(xi) on a quadratic facet of the other, with the normal n there. Its gap and, of
changes d of all nodes' places, the gap's derivatives are (Wriggers 2006, Computational Contact Mechanics, chapter 6)

    g = n . (x - y)          dg = n . (dx - dy)          (m - g k) dxi = t . (dx - dy) + g w
    ddg = -w dxi' - w' dxi - dxi k dxi' + g q m^-1 q'        w = n . dt,  q = w + k dxi

with the tangents t, the metric m and the curvature k = n . y,,. The energy is A phi(-g) over the undeformed area, half of it
from the points of either surface. So forces balance to rounding. Where surfaces lie on each other at rest, the points are those
of a rule on the intersections of their facets: a uniform pressure is then the same work on both sides, whatever their meshes
(the patch test of Taylor and Papadopoulos 1991). `softmodels.components.pressing` is for walls of one body, which also meet
themselves.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math

import numpy as np
import numpy.typing as npt

from softmodels.common.arrays import Array
from softmodels.common.lazy import basix, scipy
from softmodels.components import pressing

MAX_OUTSIDE = 0.05
"""Distance in facet edges up to which the nearest place may lie outside of a facet: it bridges the kinks between facets."""
MAX_DEPTH = 0.3
"""Penetration in facet edges at which a state is rejected; twice as deep a point is lost."""
CANDIDATE_POINTS = 8
"""Number of nearest points of the other surface whose facets are searched."""
MAX_PROJECTION_STEPS = 8
"""Newton steps to the nearest place on a facet."""
PROJECTION_TOLERANCE = 1e-13
"""Change of that place in the reference cell below which it is found."""
FLUSH_GAP = 0.02
"""Gap at rest in facet edges up to which surfaces lie on each other, and facets are cut by each other."""
BLOCKS_AT_A_TIME = 2000
"""Number of samples whose blocks are in memory at a time."""


def shape_functions(xi: Array) -> tuple[Array, Array, Array]:
    """Return the functions of a quadratic facet's nodes at points of its reference cell, shape (p, d - 1): values (p, k),
    slopes (p, k, d - 1), second derivatives (p, k, d - 1, d - 1)."""
    t = xi.shape[1]
    tables = _element(t).tabulate(2, xi)[..., 0]
    if t == 1:
        return tables[0], tables[1][:, :, None], tables[2][:, :, None, None]
    xx, xy, yy = tables[3:]
    return tables[0], np.stack(tables[1:3], axis=-1), np.stack([np.stack([xx, xy], -1), np.stack([xy, yy], -1)], -1)


@functools.cache
def _element(dimension: int) -> basix.finite_element.FiniteElement:
    cell = basix.CellType.interval if dimension == 1 else basix.CellType.triangle
    return basix.create_element(basix.ElementFamily.P, cell, 2)


@dataclasses.dataclass(frozen=True, eq=False)
class Nearest:
    """The nearest places on facets of some points: numbers of the facets (-1 where none is near), places in their reference
    cells, shape (s, d - 1), and gaps, infinite where there is none, shape (s,)."""

    facet: pressing.Numbers
    xi: Array
    gap: Array


@dataclasses.dataclass(frozen=True, eq=False)
class TwoSurfaces:
    """Two surfaces at rest, the facets of both in one `pressing.Surface`, whose ``walls`` are 0 and 1.

    Attributes:
        surface: The facets.
        owner: Facet of each sample, shape (s,).
        points: Place of each sample in its facet's reference cell, shape (s, d - 1).
        weights: Weight of each sample there, shape (s,).
    """

    surface: pressing.Surface
    owner: pressing.Numbers
    points: Array
    weights: Array

    @classmethod
    def of(cls, surface: pressing.Surface) -> TwoSurfaces:
        """Return the surfaces with the points of the usual rule, cut by each other where they lie on each other."""
        _, _, weights = surface.rule
        points = np.tile(_rule_points(surface.dimension), (len(surface.facets), 1))
        plain = cls(surface, surface.owner, points, np.tile(weights, len(surface.facets)))
        owner, points, weights = _cut(plain)
        return cls(surface, owner, points, weights)

    @functools.cached_property
    def shapes(self) -> Array:
        """Shape functions at each sample, shape (s, k)."""
        return shape_functions(self.points)[0]

    @functools.cached_property
    def measure(self) -> Array:
        """Undeformed area of each sample, of the ring in an axisymmetric section, shape (s,)."""
        nodes = self.surface.nodes[self.surface.facets[self.owner]]
        along = np.einsum("sat,sai->sti", shape_functions(self.points)[1], nodes)
        size = np.sqrt(np.linalg.det(along @ along.transpose(0, 2, 1))) * self.weights
        return size * 2 * math.pi * self.places(self.surface.nodes)[:, 0] if self.surface.axisymmetric else size

    @functools.cached_property
    def edges(self) -> Array:
        """Length of each facet's edge, shape (f,)."""
        return self.surface.edges.reshape(len(self.surface.facets), -1)[:, 0]

    @functools.cached_property
    def side(self) -> pressing.Numbers:
        """Which surface each sample is on, 0 or 1."""
        return np.asarray(self.surface.walls[self.owner])

    def places(self, nodes: Array) -> Array:
        """Return the places of the samples, shape (s, d), where the nodes are at ``nodes``, shape (n, d)."""
        return np.asarray((self.shapes[:, None] @ nodes[self.surface.facets[self.owner]])[:, 0])

    def nearest(self, nodes: Array, places: Array) -> Nearest:
        """Return the nearest places on the other surface of places that belong to the samples, shape (s, d)."""
        count, t = self.points.shape
        facet, xi, gap = np.full(count, -1), np.zeros((count, t)), np.full(count, np.inf)
        marks, owner = self.surface.places(nodes), self.surface.owner
        start = np.tile(_rule_points(self.surface.dimension), (len(self.surface.facets), 1))
        for side in (0, 1):
            own, others = np.flatnonzero(self.side == side), np.flatnonzero(self.surface.walls[owner] != side)
            reach = 1.2 * float(self.edges[owner[others]].max())
            far, index = scipy.spatial.cKDTree(marks[others]).query(places[own], k=CANDIDATE_POINTS, distance_upper_bound=reach)
            # The facet of the nearest point is most often that of the nearest place; else all of the candidates are looked at.
            for some in (slice(0, 1), slice(0, CANDIDATE_POINTS)):
                row, column = np.nonzero(np.isfinite(far[:, some]) & (facet[own] < 0)[:, None])
                marked = others[index[row, column]]
                _, first = np.unique(row * len(self.surface.facets) + owner[marked], return_index=True)
                row, marked = row[first], marked[first]
                candidate = owner[marked]
                at = self._projected(nodes, places[own[row]], candidate, start[marked])
                y, n, _ = self._frames(nodes, candidate, at)
                way = places[own[row]] - y
                outside = -np.minimum(np.column_stack([at, 1 - at.sum(axis=1)]).min(axis=1), 0.0)
                score = np.linalg.norm(way, axis=1) + 2 * outside * self.edges[candidate]
                order = np.lexsort((score, row))
                best = order[np.flatnonzero(np.diff(row[order], prepend=-1))]
                height = np.einsum("pi,pi->p", way[best], n[best])
                most = 0.0 if some.stop == 1 else MAX_OUTSIDE
                chosen = (outside[best] <= most) & (height > -2 * MAX_DEPTH * self.edges[candidate[best]])
                mine, best = own[row[best[chosen]]], best[chosen]
                facet[mine], xi[mine], gap[mine] = candidate[best], at[best], height[chosen]
        return Nearest(facet, xi, gap)

    def _projected(self, nodes: Array, places: Array, facet: pressing.Numbers, xi: Array) -> Array:
        """Return the nearest places on facets, perhaps outside of them, by Newton's method from guesses."""
        xi, left = xi.copy(), np.arange(len(facet))
        for _ in range(MAX_PROJECTION_STEPS):
            N, N1, N2 = shape_functions(xi[left])
            corners = nodes[self.surface.facets[facet[left]]]
            way = places[left] - (N[:, None] @ corners)[:, 0]
            along = N1.transpose(0, 2, 1) @ corners
            metric = along @ along.transpose(0, 2, 1)
            whole = metric - _bent(way, N2, corners)
            safe = np.linalg.det(whole) > 0.1 * np.linalg.det(metric)  # else a step of Gauss and Newton
            step = np.linalg.solve(np.where(safe[:, None, None], whole, metric), along @ way[..., None])[..., 0]
            before = xi[left]
            xi[left] = np.clip(before + np.clip(step, -0.5, 0.5), -0.5, 1.5)
            left = left[np.abs(xi[left] - before).max(axis=1) > PROJECTION_TOLERANCE]
            if not len(left):
                break
        return xi

    def _frames(self, nodes: Array, facet: pressing.Numbers, xi: Array) -> tuple[Array, Array, Array]:
        """Return the places, unit normals out of the solid, shape (p, d), and tangents, shape (p, d - 1, d), on facets."""
        N, N1, _ = shape_functions(xi)
        corners = nodes[self.surface.facets[facet]]
        along = N1.transpose(0, 2, 1) @ corners
        normal = pressing.crossed(along[:, 0], along[:, -1]) * self.surface.turn[facet][:, None]
        return (N[:, None] @ corners)[:, 0], normal / np.linalg.norm(normal, axis=1)[:, None], along

    def clear(self, start: Array, end: Array, rest: Array) -> bool:
        """Return whether nodes can move between positions, shape (n, d) each, without a sample sinking in by `MAX_DEPTH`, the
        gaps at rest ``rest`` not counted."""
        motion = self.places(end) - self.places(start)
        relative = 2 * float(np.linalg.norm(motion - motion.mean(axis=0), axis=1).max(initial=0.0))
        looks = int(np.clip(math.ceil(relative / (MAX_DEPTH * float(self.edges.min()))), 1, MAX_LOOKS))
        for t in np.linspace(0.0, 1.0, looks + 1)[1:]:
            nodes = start + t * (end - start)
            near = self.nearest(nodes, self.places(nodes))
            if (near.gap - rest < -MAX_DEPTH * self.edges[near.facet]).any():
                return False
        return True


MAX_LOOKS = 20
"""Largest number of places on a straight way at which depths are looked at."""


def _rule_points(dimension: int) -> Array:
    cell = basix.CellType.interval if dimension == 2 else basix.CellType.triangle
    return np.asarray(basix.make_quadrature(cell, pressing.RULE_DEGREE)[0])


# ----------------------------------------------------------------------------------------------------------------------
# Rules on the intersections of facets that lie on each other at rest.


def _cut(plain: TwoSurfaces) -> tuple[pressing.Numbers, Array, Array]:
    """Return owners, places and weights of the samples of facets, those that lie on the other surface cut by its facets."""
    surface, nodes, t = plain.surface, plain.surface.nodes, plain.surface.dimension - 1
    near = plain.nearest(nodes, plain.places(nodes))
    rows = len(plain.owner) // len(surface.facets)
    flush = (np.abs(near.gap) < FLUSH_GAP * plain.edges[plain.owner]).reshape(-1, rows).all(axis=1)
    simple, share = basix.make_quadrature(basix.CellType.interval if t == 1 else basix.CellType.triangle, 4 if t == 1 else 2)
    middles = surface.places(nodes).reshape(len(surface.facets), rows, -1).mean(axis=1)
    owners, points, weights = (
        [plain.owner[~flush[plain.owner]]],
        [plain.points[~flush[plain.owner]]],
        [plain.weights[~flush[plain.owner]]],
    )
    for facet in np.flatnonzero(flush):
        corners = nodes[surface.facets[facet, : t + 1]]
        base = corners[1:] - corners[0]
        others = np.flatnonzero(surface.walls != surface.walls[facet])
        away = np.linalg.norm(middles[others] - middles[facet], axis=1)
        others = others[away < plain.edges[facet] + plain.edges[others]]
        pieces = []
        for other in nodes[surface.facets[others][:, : t + 1]]:
            # in the facet's reference cell, seen along its normal
            seen = np.linalg.lstsq(base.T, (other - corners[0]).T, rcond=None)[0].T
            pieces += _common(seen)
        if abs(sum(_size(piece) for piece in pieces) * (2 if t == 2 else 1) - 1.0) > 1e-9:
            pieces = [np.eye(t + 1)[:, 1:]]  # partly covered, as at an edge
            rule, part = _rule_points(t + 1), surface.rule[2]
        else:
            rule, part = simple, share
        for piece in pieces:
            points.append(piece[0] + rule @ (piece[1:] - piece[0]))
            weights.append(part * abs(np.linalg.det(piece[1:] - piece[0])))
            owners.append(np.full(len(part), facet))
    return np.concatenate(owners), np.concatenate(points), np.concatenate(weights)


def _size(piece: Array) -> float:
    return abs(float(np.linalg.det(piece[1:] - piece[0]))) / (1 if piece.shape[1] == 1 else 2)


def _common(seen: Array) -> list[Array]:
    """Return the lines or triangles that a line or triangle, by its corners, shape (t + 1, t), has in common with the reference
    cell."""
    if seen.shape[1] == 1:
        low, high = np.clip([seen.min(), seen.max()], 0.0, 1.0)
        return [np.array([[low], [high]])] if high - low > 1e-12 else []
    polygon = list(seen)
    for normal, level in (((1.0, 0.0), 0.0), ((0.0, 1.0), 0.0), ((-1.0, -1.0), -1.0)):
        kept = []
        heights = [float(np.dot(normal, corner)) - level for corner in polygon]
        for k, corner in enumerate(polygon):
            before, after = heights[k - 1], heights[k]
            if before * after < 0.0:
                kept.append(polygon[k - 1] + before / (before - after) * (corner - polygon[k - 1]))
            if after >= 0.0:
                kept.append(corner)
        polygon = kept
    fans = [np.array([polygon[0], a, b]) for a, b in itertools.pairwise(polygon[1:])] if len(polygon) > 2 else []
    return [fan for fan in fans if _size(fan) > 1e-12]


# ----------------------------------------------------------------------------------------------------------------------
# Energy, forces and stiffness, without friction.


class Touching:
    """Two surfaces in a deformed shape, by their nodes' places, shape (n, d). ``rest`` are the samples' overlaps at rest, zero
    or below, from which their depths count: curved facets that lie on each other cut into each other a little."""

    def __init__(self, surfaces: TwoSurfaces, penalty: pressing.Penalty, rest: Array, nodes: Array):
        self.surfaces, self.penalty, self.rest, self.nodes = surfaces, penalty, rest, nodes
        self.places = surfaces.places(nodes)
        self.near = surfaces.nearest(nodes, self.places)
        self.gaps = self.near.gap - rest
        self.touching = self.gaps < 0.0
        on = np.flatnonzero(self.touching)
        self.on, facets = on, surfaces.surface.facets
        self.area = surfaces.measure[on] / 2  # the other half is the other surface's
        self.phi, self.phi1, self.phi2 = (self.area * rate for rate in penalty.rates(-self.gaps[on]))
        self.facet, self.xi = self.near.facet[on], self.near.xi[on]
        self.N, self.N1, self.N2 = shape_functions(self.xi)
        _, self.normal, self.along = surfaces._frames(nodes, self.facet, self.xi)
        self.between = np.hstack([surfaces.shapes[on], -self.N])
        self.of = np.hstack([facets[surfaces.owner[on]], facets[self.facet]])

    @property
    def energy(self) -> float:
        return float(self.phi.sum())

    @functools.cached_property
    def forces(self) -> Array:
        """Derivative of the energy by the nodes' places, shape (n, d)."""
        return self.summed(self.of, self.between, -self.phi1[:, None] * self.normal)

    def summed(self, of: pressing.Numbers, factors: Array, forces: Array) -> Array:
        """Return forces on samples, shape (p, d), at nodes ``of`` by their factors, shape (p, 2k)."""
        at_nodes = np.zeros_like(self.nodes)
        np.add.at(at_nodes, of, factors[:, :, None] * forces[:, None, :])
        return at_nodes

    @functools.cached_property
    def gap_rates(self) -> Array:
        """Derivative of each touching sample's gap by its nodes ``of``, shape (p, 2k d)."""
        return (self.between[:, :, None] * self.normal[:, None, :]).reshape(
            len(self.on), self.of.shape[1] * self.nodes.shape[1]
        )

    def gap_curvatures(self, chosen: slice) -> Array:
        """Return the second derivative of the gaps of some touching samples, shape (p, 2kd, 2kd)."""
        normal, along, gap = self.normal[chosen], self.along[chosen], self.near.gap[self.on[chosen]]
        p, t = along.shape[:2]
        corners = self.nodes[self.surfaces.surface.facets[self.facet[chosen]]]
        bent = _bent(normal, self.N2[chosen], corners)
        metric = along @ along.transpose(0, 2, 1)
        u = np.einsum("pa,pti->ptai", self.between[chosen], along).reshape(p, t, -1)
        slopes = np.concatenate([np.zeros_like(self.N1[chosen]), self.N1[chosen]], axis=1)
        w = np.einsum("pat,pi->ptai", slopes, normal).reshape(p, t, -1)
        moved = np.linalg.solve(metric - gap[:, None, None] * bent, u + gap[:, None, None] * w)
        q, back = w + bent @ moved, moved.transpose(0, 2, 1)
        mixed = w.transpose(0, 2, 1) @ moved
        tilted = gap[:, None, None] * (q.transpose(0, 2, 1) @ np.linalg.solve(metric, q))
        return np.asarray(tilted - mixed - mixed.transpose(0, 2, 1) - back @ bent @ moved)

    @functools.cached_property
    def stiffness(self) -> scipy.sparse.csr_array:
        """Second derivative of the energy, shape (n d, n d); nodes' components follow each other."""
        size = self.nodes.size
        stiffness = scipy.sparse.csr_array((size, size))
        for chosen in self.chunks():
            g = self.gap_rates[chosen]
            blocks = self.phi2[chosen, None, None] * g[:, :, None] * g[:, None, :]
            blocks -= self.phi1[chosen, None, None] * self.gap_curvatures(chosen)
            dofs = pressing.components_of(self.of[chosen], self.nodes.shape[1])
            stiffness = stiffness + pressing.scattered(blocks, dofs, dofs, size, size)
        return scipy.sparse.csr_array((stiffness + stiffness.T) / 2)

    def chunks(self) -> list[slice]:
        return [slice(start, start + BLOCKS_AT_A_TIME) for start in range(0, len(self.on), BLOCKS_AT_A_TIME)]

    def coupled(self, soon: float) -> scipy.sparse.csr_array:
        """Return which nodes are coupled through a sample nearer than ``soon`` edges, booleans of shape (n, n)."""
        facets, close = self.surfaces.surface.facets, np.flatnonzero(self.gaps < soon * self.surfaces.edges[self.near.facet])
        nodes = np.hstack([facets[self.surfaces.owner[close]], facets[self.near.facet[close]]])
        return pressing.together(np.arange(len(close)), nodes, (len(close), len(self.nodes)))

    def resting(self, depth: float, stiffness: float) -> scipy.sparse.csr_array:
        """Return a stiffness per area of samples that are nearer than a depth, shape (n d, n d)."""
        surfaces, size, matrix = self.surfaces, self.nodes.size, scipy.sparse.csr_array((self.nodes.size, self.nodes.size))
        resting = np.flatnonzero(self.gaps < depth)
        for start in range(0, len(resting), BLOCKS_AT_A_TIME):
            on = resting[start : start + BLOCKS_AT_A_TIME]
            facet, xi = self.near.facet[on], self.near.xi[on]
            between = np.hstack([surfaces.shapes[on], -shape_functions(xi)[0]])
            normal = surfaces._frames(self.nodes, facet, xi)[1] * np.sqrt(stiffness * surfaces.measure[on] / 2)[:, None]
            rates = (between[:, :, None] * normal[:, None, :]).reshape(len(on), -1)
            facets = surfaces.surface.facets
            dofs = pressing.components_of(np.hstack([facets[surfaces.owner[on]], facets[facet]]), self.nodes.shape[1])
            matrix = matrix + pressing.scattered(rates[:, :, None] * rates[:, None, :], dofs, dofs, size, size)
        return matrix

    @property
    def force(self) -> Array:
        """Force of the second body on the first, shape (d,)."""
        return self._on_first(self.phi1[:, None] * self.normal)

    def _on_first(self, forces: Array) -> Array:
        sign = np.where(self.surfaces.side[self.on] == 0, 1.0, -1.0)
        return np.asarray((sign[:, None] * forces).sum(axis=0))


def _bent(along: Array, N2: Array, corners: Array) -> Array:
    """Return the second derivative of facets' places along vectors, shape (p, d - 1, d - 1)."""
    p, k, t = N2.shape[:3]
    return np.asarray((along[:, None] @ corners.transpose(0, 2, 1) @ N2.reshape(p, k, t * t)).reshape(p, t, t))


# ----------------------------------------------------------------------------------------------------------------------
# The same with Coulomb friction; the law is that of `softmodels.components.pressing`.
#
# A sample that touches is anchored to a material point of the other surface, y at its last accepted state, and draws on it with
# t = mu |f| g(|s| / e) s / |s|, where s is the part of x - y in the tangent plane of that state. The force on the other body
# acts in the anchor, so that forces balance and the work is t . ds.


@dataclasses.dataclass(frozen=True, eq=False)
class Anchors:
    """History variables of the samples at the last accepted state, in sizes and shear moduli.

    Attributes:
        near: Where they are anchored on the other surface; its gaps are those of that state.
        normal: Normal there, shape (s, d).
        limits, drawn, slid, lost: As in `pressing.FrictionHistory`.
    """

    near: Nearest
    normal: Array
    limits: Array
    drawn: Array
    slid: Array
    lost: float

    @classmethod
    def of_free(cls, touching: Touching) -> Anchors:
        """Return the history of bodies without contact so far."""
        _, normal, _ = touching.surfaces._frames(touching.nodes, touching.near.facet, touching.near.xi)
        limits, drawn, slid = np.zeros((3, len(touching.gaps)))
        return cls(dataclasses.replace(touching.near, gap=touching.gaps), normal, limits, drawn, slid, 0.0)


class RubbedTouching:
    """Two surfaces in frictional contact: the same without friction, how they rub, and the state that was kept last."""

    def __init__(self, plain: Touching, rubbing: pressing.Rubbing, anchors: Anchors):
        self.plain, self.rubbing, self.anchors, self.nodes = plain, rubbing, anchors, plain.nodes
        surfaces, kept, facets = plain.surfaces, anchors.near, plain.surfaces.surface.facets
        self.rows = np.flatnonzero(kept.facet[plain.on] >= 0)  # of the touching samples, those with an anchor
        on = self.on = plain.on[self.rows]
        self.held = np.hstack([surfaces.shapes[on], -shape_functions(kept.xi[on])[0]])
        self.of = np.hstack([facets[surfaces.owner[on]], facets[kept.facet[on]]])
        n = anchors.normal[on]
        self.flat = np.eye(n.shape[1]) - n[:, :, None] * n[:, None, :]
        self.far = np.einsum("pij,pa,paj->pi", self.flat, self.held, self.nodes[self.of])
        # of one that has come into contact since then, the share of its way on which it touched
        self.gone, self.depth = np.maximum(kept.gap[on], 0.0), -plain.gaps[on]
        self.share = self.depth / (self.gone + self.depth)
        self.s = self.share[:, None] * self.far
        self.size = np.linalg.norm(self.s, axis=1)
        self.way = self.s / (self.size + pressing.SMALLEST_DENOMINATOR)[:, None]
        self.limits = rubbing.coefficient * plain.phi1[self.rows]
        self.grip, self.grip_rate = rubbing.rates(self.size)
        self.pulls = (self.limits * self.grip)[:, None] * self.way

    @property
    def energy(self) -> float:
        """Energy of the contact only, without the dissipation of friction."""
        return self.plain.energy

    @functools.cached_property
    def forces(self) -> Array:
        return self.plain.forces + self.plain.summed(self.of, self.held, self.pulls)

    def _drawn(self) -> Array:
        """Return the derivative of the pulls by s, the limits held, shape (p, d, d)."""
        onset, along = self.rubbing.onset, self.way[:, :, None] * self.way[:, None, :]
        across = 2 / onset - self.size / onset**2
        across = np.where(self.size < onset, across, 1 / (self.size + pressing.SMALLEST_DENOMINATOR))
        drawn = across[:, None, None] * (self.flat - along) + self.grip_rate[:, None, None] * along
        return np.asarray(self.limits[:, None, None] * drawn)

    def _scattered(self, blocks: Array, columns: pressing.Numbers) -> scipy.sparse.csr_array:
        """Return the sum of the derivatives of the pulls, shape (p, d, columns), as those of the forces."""
        p, d, width = blocks.shape
        whole = (self.held[:, :, None, None] * blocks[:, None]).reshape(p, self.of.shape[1] * d, width)
        rows = pressing.components_of(self.of, d)
        return pressing.scattered(whole, rows, columns, self.nodes.size, self.nodes.size)

    @functools.cached_property
    def _by_anchors(self) -> scipy.sparse.csr_array:
        p, d = self.far.shape
        moved = (self.share[:, None, None] * self._drawn())[:, :, None, :] * self.held[:, None, :, None]
        return self._scattered(moved.reshape(p, d, self.of.shape[1] * d), pressing.components_of(self.of, d))

    @functools.cached_property
    def stiffness(self) -> scipy.sparse.csr_array:
        """The derivative of the forces with their limits held, symmetric."""
        return scipy.sparse.csr_array(self.plain.stiffness + self._by_anchors)

    @functools.cached_property
    def whole_stiffness(self) -> scipy.sparse.csr_array:
        """The derivative of the forces, not symmetric."""
        plain, d = self.plain, self.nodes.shape[1]
        sinking = -plain.gap_rates[self.rows]
        harder = (self.rubbing.coefficient * plain.phi2[self.rows] * self.grip)[:, None] * self.way
        whole = self.gone / (self.gone + self.depth) ** 2
        harder = harder + whole[:, None] * np.einsum("pij,pj->pi", self._drawn(), self.far)
        columns = pressing.components_of(plain.of[self.rows], d)
        return scipy.sparse.csr_array(self.stiffness + self._scattered(harder[:, :, None] * sinking[:, None, :], columns))

    def coupled(self, soon: float) -> scipy.sparse.csr_array:
        n = len(self.nodes)
        return scipy.sparse.csr_array(
            self.plain.coupled(soon) + pressing.together(np.arange(len(self.of)), self.of, (len(self.of), n))
        )

    @property
    def slides(self) -> npt.NDArray[np.bool_]:
        return np.asarray(self.size > (1 - pressing.AT_LIMIT) * self.rubbing.onset)

    @property
    def sliding(self) -> float:
        """Share of the normal force at sliding samples; 0 without contact."""
        whole = float(self.plain.phi1.sum())
        return float(self.plain.phi1[self.rows][self.slides].sum()) / whole if whole > 0.0 else 0.0

    @property
    def force(self) -> Array:
        """Force of the second body on the first, shape (d,)."""
        pulls = np.zeros_like(self.plain.normal)
        pulls[self.rows] = self.pulls
        return self.plain._on_first(self.plain.phi1[:, None] * self.plain.normal - pulls)

    def kept(self) -> Anchors:
        """Return the history variables once this state is accepted."""
        plain, surfaces, before = self.plain, self.plain.surfaces, self.anchors
        held, reach = plain.places.copy(), np.minimum(self.size, self.rubbing.onset)
        held[self.on] -= reach[:, None] * self.way
        near = surfaces.nearest(self.nodes, held)
        _, normal, _ = surfaces._frames(self.nodes, near.facet, near.xi)
        limits, drawn, slip = np.zeros((3, len(plain.gaps)))
        limits[self.on], drawn[self.on], slip[self.on] = self.limits, self.rubbing.drawn(self.size), self.size - reach
        lost = float(((before.limits + limits) / 2 * (drawn - before.drawn + slip)).sum())
        near = dataclasses.replace(near, gap=plain.gaps)
        return Anchors(near, normal, limits, drawn, before.slid + slip, before.lost + lost)
