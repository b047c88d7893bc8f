"""The simulated outline of a device, as in a photograph of its shadow.

For an axisymmetric section it is the deformed outer curve, for a slice the edge between its outer surface and its first cut
plane. Both are chains of second-order edges: places come from the nodes and are exact on the edges between. Nodes are
gathered to all ranks, so that all further computation is plain numpy and identical everywhere.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from softmodels.common.arrays import Array
from softmodels.mechanics.body import Body, BodyError
from softmodels.mechanics.mpi import everywhere
from softmodels.mechanics.sensitivity import coordinates
from softmodels.mechanics.system import State, System
from softmodels.runs.grid import QuadraticCurve, shapes
from softmodels.runs.state_values import Grid, displacement_maps

if TYPE_CHECKING:
    from dolfinx import fem

    from geometries import Actuator


UNEVEN = 1e-3
"""Maximum unevenness of an undeformed top, in widths of the device, for heights to count from it."""

MIDDLE = 0.75
"""Fraction of a device's width within which its top is checked; beyond, edges may be rounded."""

OUTER = "outer"
"""Role of the facets that are neither held nor loaded; faces for sheets have their own roles."""


STRAIGHT = np.array([[1.0, 0.0], [0.0, 1.0], [0.5, 0.5]])
"""An edge's two ends and middle from its two nodes, where the mesh has straight edges."""


class Silhouette:
    """The outer curve of a device in the plane of x (distance from its axis) and z (height above its undeformed apex);
    `BodyError` if the mesh has none.

    The curve runs from the axis outwards and down the side wall; the solid is on its right. Of a half slab it is the edge of
    its top in the mirror plane, from the clamped base to the tip.

    Attributes:
        points: Undeformed nodes in device coordinates, m, shape (n, 3, 3), where the mesh was when `follow` was called last.
        top: The first of them, from which heights count.
    """

    def __init__(self, system: System):
        self.system = eq = system
        body, actuator = eq.body, eq.body.actuator
        edges, grid = outer_edges(body), Grid(eq)
        self._blocks = edge_nodes(eq, coordinates(body.mesh)[0], edges)
        self._mix = np.eye(3) if self._blocks.shape[1] == 3 else STRAIGHT
        self._space, self._nodes = grid.space, edge_nodes(eq, grid.space, edges)
        self._dofs = displacement_maps(eq, grid)[0][self._nodes]
        self._along = _sideways(actuator)
        places = self._everywhere(self._here())
        self._order, self._turned = _chain(places, np.asarray(actuator.lift), self._along, eq.length_unit)
        self.follow()

    def follow(self) -> None:
        """Update the nodes from the current mesh."""
        self.points = self._arranged(self._everywhere(self._here()))
        self.top = self.points[0, 0]

    def _here(self) -> Array:
        """Return the dimensionless places of the edges' ends and middles on the current mesh, shape (m, 3, d)."""
        return self._space.tabulate_dof_coordinates()[self._nodes][..., : self.system.body.mesh.geometry.dim]

    def _everywhere(self, x: Array) -> Array:
        """Return dimensionless vectors of the mesh at the edges' ends and middles, shape (m, 3, d), as those of the edges
        of all ranks in the device, m."""
        local = x * self.system.length_unit
        if local.shape[-1] == 2:
            local = np.stack([local[..., 0], np.zeros(local.shape[:-1]), local[..., 1]], axis=-1)
        return everywhere(self.system.comm, local)

    def _arranged(self, values: Array) -> Array:
        """Return the values of all ranks' edges, shape (m, 3, ...), as those of the chain."""
        chosen = values[self._order]
        chosen[self._turned] = chosen[self._turned][:, [1, 0, 2]]
        return chosen

    def _in_plane(self, vectors: Array) -> Array:
        return np.stack([vectors @ self._along, vectors @ np.asarray(self.system.body.actuator.lift)], axis=-1)

    def _displacement(self, w: Array) -> Array:
        eq = self.system
        u = everywhere(eq.comm, w[self._dofs]) @ eq.body.skew_inverse.T * eq.length_unit
        if u.shape[-1] == 2:
            u = np.stack([u[..., 0], np.zeros(u.shape[:-1]), u[..., 1]], axis=-1)
        return self._arranged(u)

    def curve(self, state: State) -> QuadraticCurve:
        """Return the deformed curve on the current mesh in m."""
        self.follow()
        return QuadraticCurve(self._in_plane(self.points - self.top + self._displacement(state.w)))

    def moved(self, w: Array, X: Array | None = None) -> Array:
        """Return the derivative of the curve's nodes in m, shape (n, 3, 2), from that of the state's dof values and of the
        mesh's dimensionless nodes, shape (nodes of `MeshMotion.space`, d), with ghosts; None where they stay. Heights
        count from the undeformed apex, which moves."""
        moved = self._displacement(w)
        if X is not None:
            rest = self._arranged(self._everywhere(np.einsum("sk,mkd->msd", self._mix, X[self._blocks])))
            moved = moved + rest - rest[0, 0]
        return self._in_plane(moved)

    @property
    def width(self) -> float:
        """Distance of the undeformed curve's farthest node from the axis in m."""
        return float((self.points @ self._along).max())

    @property
    def unevenness(self) -> float:
        """Height of the undeformed top above its apex in m, negative below it, away from the rim; 0 for a flat one."""
        x, z = np.moveaxis(self._in_plane(self.points - self.top), -1, 0)
        # Only up to where the curve leaves the middle: parts that return below are not the top.
        on_top = np.cumprod((x < MIDDLE * self.width).all(axis=1)).astype(bool)
        return float(np.abs(z[on_top]).max(initial=0.0))

    @property
    def flat(self) -> bool:
        """Whether the undeformed top is flat, so that outlines can count their heights from it."""
        return self.unevenness <= UNEVEN * self.width


def outer_edges(body: Body) -> npt.NDArray[np.int32]:
    """Return the local edges of the outer curve: outer facets of a section; edges of both an outer and a cut facet of a
    slice."""
    dim = body.actuator.dimension
    roles = [role for role in (OUTER, *body.actuator.faces) if role in body.entities]
    if not roles:
        raise BodyError(f"the mesh has no facets named {OUTER!r} for the outline")
    facets = np.unique(np.concatenate([body.entities[role][1] for role in roles]))
    if dim == 2:
        return facets
    if not body.actuator.cut_planes:
        raise BodyError("a whole device has no outline edge; use a slice or --section axisymmetric")
    topology = body.mesh.topology
    topology.create_connectivity(2, 1)
    edges_of = topology.connectivity(2, 1)

    def edges(found: Sequence[int] | npt.NDArray[np.int32]) -> npt.NDArray[np.int32]:
        return np.unique(np.concatenate([edges_of.links(facet) for facet in found] or [np.empty(0, dtype=np.int32)]))

    plane = body.entities.get(body.actuator.cut_planes[0].name, (2, ()))[1]
    return np.intersect1d(edges(facets), edges(plane)).astype(np.int32)


def edge_nodes(eq: System, space: fem.FunctionSpace, edges: npt.NDArray[np.int32]) -> npt.NDArray[np.int64]:
    """Return the local nodes of edges in a space of first or second order: both ends, then the middle; shape (m, 2 or 3)."""
    topology = eq.body.mesh.topology
    dim = topology.dim
    topology.create_connectivity(1, dim)
    topology.create_connectivity(dim, 1)
    cells_of, edges_of, layout = topology.connectivity(1, dim), topology.connectivity(dim, 1), space.dofmap.dof_layout
    nodes = np.empty((len(edges), len(layout.entity_closure_dofs(1, 0))), dtype=np.int64)
    for row, edge in enumerate(edges):
        cell = cells_of.links(edge)[0]
        number = int(np.flatnonzero(edges_of.links(cell) == edge)[0])
        found = sorted(layout.entity_closure_dofs(1, number))  # a cell's vertices come first
        nodes[row] = space.dofmap.cell_dofs(cell)[found]
    return nodes


def _sideways(actuator: Actuator) -> Array:
    """Return the unit vector of the outline's plane perpendicular to the lift, from the axis towards the slice."""
    if actuator.dimension == 2:
        return np.array([1.0, 0.0, 0.0])
    along = np.cross(actuator.lift, actuator.cut_planes[0].normal)
    return along / np.linalg.norm(along)


def _chain(edges: Array, lift: Array, along: Array, size: float) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.bool_]]:
    """Return the order of edges (m, 3, 3) from the axis at the top outwards, down to the underside, and which of them to
    reverse."""
    keys = np.round(edges[:, :2] / size * 1e7).astype(np.int64)
    ends = [[tuple(end) for end in pair] for pair in keys.tolist()]
    meeting: dict[tuple[int, ...], list[int]] = {}
    seen: set[frozenset[tuple[int, ...]]] = set()
    for i, pair in enumerate(ends):
        if frozenset(pair) in seen:  # another rank also has this edge
            continue
        seen.add(frozenset(pair))
        for end in pair:
            meeting.setdefault(end, []).append(i)
    height, radius = edges[:, :2] @ lift, edges[:, :2] @ along  # all are the lowest on a flat membrane
    on_axis = np.argwhere(np.abs(radius) < 1e-7 * size)
    if not len(on_axis):
        raise BodyError("the outer surface does not reach the axis, so the device has no outline")
    top = max(on_axis.tolist(), key=lambda place: height[tuple(place)])
    start = ends[top[0]][top[1]]
    i = meeting[start][0]
    floor = height.min() + 1e-7 * size
    order, turned = [], []
    while True:
        flip = ends[i][0] != start
        if (height[i] <= floor).all() and radius[i][int(not flip)] < radius[i][int(flip)]:  # back along the underside
            break
        order.append(i)
        turned.append(flip)
        start = ends[i][0] if flip else ends[i][1]
        following = [j for j in meeting[start] if j != i]
        if not following:
            break
        i = following[0]
    if not order:
        raise BodyError("the outer surface has no top on the axis, so the device has no outline")
    return np.array(order), np.array(turned)


# ----------------------------------------------------------------------------------------------------------------------
# Visible outline of a body of revolution from the side: a trough behind a higher rim is hidden.
#
# The shadow reaches, at each height, as far as the body does: its edge is the curve's upper envelope from outside in. Where the
# curve dips behind something higher and farther out, the edge runs level from that rim to where the curve comes up again.


SAMPLES = 17  # samples per piece at which heights are compared
DEEPEST = 1e-7
"""Depth in m of ignored dips."""


@dataclasses.dataclass(frozen=True, eq=False)
class Shadow:
    """The visible edge as a curve of its own: the piece of the whole curve that each of its pieces is a part of, or hangs
    on, shape (m,), and that piece's shape functions at the new piece's three nodes, shape (m, 3, 3)."""

    curve: QuadraticCurve
    source: npt.NDArray[np.int64]
    weights: Array

    def rate(self, rate: Array) -> Array:
        """Return the derivative of the edge's nodes from that of the whole curve's, shape (n, 3, 2) to (m, 3, 2). Where
        pieces were cut they slide along the curve, and level parts along themselves: neither moves the edge."""
        return np.einsum("mab,mbi->mai", self.weights, rate[self.source])


def shadow_of(curve: QuadraticCurve) -> Shadow:
    """Return the visible edge of a curve that runs from the axis outwards and down."""
    s, count = np.linspace(-1.0, 1.0, SAMPLES), len(curve.nodes)
    places, above = edge_heights(curve)
    hidden = above - places[:, 1] > DEEPEST
    if not hidden.any():
        return _assembled(curve, [_Part(k, -1.0, 1.0) for k in range(count)])
    parts: list[_Part] = []
    for k, seen in enumerate(~hidden.reshape(count, SAMPLES)):
        edges = np.flatnonzero(np.diff(np.r_[False, seen, False].astype(int)))
        for first, end in edges.reshape(-1, 2).tolist():
            place, begin = k * SAMPLES + first, float(s[first])
            if place and hidden[place - 1]:  # going outwards, a trough ends here at its rim
                before = np.flatnonzero(~hidden[:place])
                begin = _summit(curve, k, begin)
                parts.append(_Part(k, begin, begin, float(places[before[-1], 0]) if len(before) else 0.0))
            if s[end - 1] > begin:
                parts.append(_Part(k, begin, float(s[end - 1])))
    return _assembled(curve, parts)


@dataclasses.dataclass(frozen=True)
class _Part:
    """The stretch of a piece between two parameters; or, from the place x in m, the level edge up to one of it, the rim."""

    piece: int
    begin: float
    end: float
    level_from: float | None = None


def edge_heights(curve: QuadraticCurve) -> tuple[Array, Array]:
    """Return the places of a curve, shape (n, 2), `SAMPLES` of each piece, and the height of the visible edge there, shape
    (n,)."""
    s, count = np.linspace(-1.0, 1.0, SAMPLES), len(curve.nodes)
    places = curve.at(np.repeat(np.arange(count), SAMPLES), np.tile(s, count))[0]
    return places, np.maximum.accumulate(places[::-1, 1])[::-1]  # the highest from here outwards


def crest(curve: QuadraticCurve) -> tuple[int, float]:
    """Return the highest place of a curve: its piece and the parameter there."""
    piece, place = divmod(int(np.argmax(edge_heights(curve)[0][:, 1])), SAMPLES)
    return piece, _summit(curve, piece, float(np.linspace(-1.0, 1.0, SAMPLES)[place]))


def _summit(curve: QuadraticCurve, piece: int, s: float) -> float:
    """Return the highest place of a piece near a parameter."""
    slope, bend = (vectors[1] for vectors in curve.at(piece, s)[1:])
    return float(np.clip(s - slope / bend, -1.0, 1.0)) if bend < 0.0 else s


def _assembled(curve: QuadraticCurve, parts: list[_Part]) -> Shadow:
    """Return the edge of its parts in order, from the axis outwards."""
    source = np.array([part.piece for part in parts])
    weights = shapes(np.array([[part.begin, part.end, (part.begin + part.end) / 2] for part in parts]))
    nodes = np.einsum("mab,mbi->mai", weights, curve.nodes[source])
    for row, part in enumerate(parts):
        if part.level_from is not None:
            x = nodes[row, 0, 0]
            nodes[row, :, 0] = part.level_from, x, (part.level_from + x) / 2
    return Shadow(QuadraticCurve(nodes), source, weights)


def half_outline(curve: QuadraticCurve, spacing: float, lowest: float = -5e-5) -> tuple[Array, Array]:
    """Return the places (n, 2) on a curve from the axis on, evenly far apart, as far as it is above ``lowest``, and unit
    normals."""
    s = np.linspace(-1.0, 1.0, 41)
    piece, at = np.repeat(np.arange(len(curve.nodes)), len(s)), np.tile(s, len(curve.nodes))
    dense = curve.at(piece, at)[0]
    length = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(dense, axis=0), axis=1))]
    low = np.flatnonzero(dense[:, 1] < lowest)
    end = length[low[0]] if len(low) else length[-1]
    wanted = np.arange(0.0, end, spacing)
    index = np.clip(np.searchsorted(length, wanted, side="right") - 1, 0, len(length) - 2)
    share = (wanted - length[index]) / np.maximum(length[index + 1] - length[index], 1e-300)
    step = np.where(piece[index + 1] == piece[index], at[index + 1] - at[index], 0.0)
    places, slopes, _ = curve.at(piece[index], at[index] + share * step)
    slopes = slopes / np.linalg.norm(slopes, axis=1)[:, None]
    return places, np.column_stack([-slopes[:, 1], slopes[:, 0]])
