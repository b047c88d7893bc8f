"""Outlines: simulated ones, and measured ones checked, cut to the risen part and averaged for a fit.

Neighbouring points of an outline are correlated by smoothing. The fit uses means over bins of
three correlation lengths (integrated autocorrelation), each with the error of such a mean.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np
import numpy.typing as npt
from scipy.interpolate import make_lsq_spline

from geometries import Actuator, actuator as devices
from measurement.outline.edge import SMOOTHING_POINTS
from measurement.outline.outline import History, Outline, OutlineError, hold_of
from softmodels.common import names, units
from softmodels.common.arrays import Array
from softmodels.fitting import problem
from softmodels.fitting.problem import FitError
from softmodels.mechanics import mpi, sensitivity
from softmodels.mechanics.body import Body, BodyError
from softmodels.mechanics.system import State, System
from softmodels.runs import grid, state_values

if TYPE_CHECKING:
    from dolfinx import fem

    from geometries import Actuator


MOST_SHARED = 0.95
"""Maximum share of a point's error that it shares with all points of its outline."""


@dataclasses.dataclass(frozen=True, eq=False)
class Shape:
    """An outline prepared for the fit.

    Attributes:
        points: Measured points, shape (k, 2), m.
        error: Standard error of each across the outline, shape (k,), m.
        bins: Bin of each point, rising from 0, shape (k,).
        weight: What the mean of a bin's standardised distances is multiplied with to have variance 1, shape (bins,).
        pressure, pressure_error: Reading and its standard error in Pa.
        height: Height of the top in m.
        centre: Where along x the middle of its area is, in m.
        scale_error: Standard error of all lengths together, as a share of them; 0 where none is stated.
        level_error: Standard error in m of all heights together.
        history: Pressures up to the photograph; empty if the times are not known.
        edge_error: The part of ``error`` in m that all points share.
        whole: Whether it is the outline all around a body of revolution, so that nothing of the device's hides another part.
    """

    source: str
    points: Array
    error: Array
    bins: npt.NDArray[np.int64]
    weight: Array
    pressure: float
    pressure_error: float
    height: float
    centre: float
    scale_error: float = 0.0
    level_error: float = 0.0
    history: History = ()
    edge_error: float = 0.0
    whole: bool = False

    def __post_init__(self) -> None:
        names.keep_arrays(self)

    @property
    def hold(self) -> float:
        """How long in s the pressure was held before the photograph; nan if that is not known."""
        return hold_of(self.history)

    @property
    def name(self) -> str:
        """Name of the photograph in messages."""
        held = f", held {self.hold:.4g} s" if self.history else ""
        return f"{units.COLUMN.full(self.pressure)}{held} ({self.source})"

    def mean(self, values: Array) -> Array:
        """Return the means over the bins of values (k, ...) divided by the points' errors, as independent residuals of
        variance 1."""
        return np.tensordot(self._decorrelation, self._means(values), 1)

    def _means(self, values: Array) -> Array:
        count = len(self.weight)
        standard = values / self.error.reshape(-1, *[1] * (values.ndim - 1))
        sums = np.zeros((count, *values.shape[1:]))
        np.add.at(sums, self.bins, standard)
        factor = self.weight / np.bincount(self.bins, minlength=count)
        return sums * factor.reshape(-1, *[1] * (values.ndim - 1))

    @functools.cached_property
    def _decorrelation(self) -> Array:
        """The matrix (bins, bins) that makes the bins' means independent: more points in a bin do not reduce what of their
        error all points share. It is the symmetric root, so that each residual stays that of its bin."""
        shared = np.minimum(self.edge_error, MOST_SHARED * self.error)
        common = self._means(shared)
        own = 1.0 - (common / self.weight) ** 2
        values, vectors = np.linalg.eigh(np.diag(own) + np.outer(common, common))
        return np.asarray(vectors / np.sqrt(values) @ vectors.T)


MIN_HEIGHT = 1e-4
"""Minimum height in m of used points: below, the support and the surrounding flat surface are visible too."""

FLOOR_ERRORS = 5.0
"""The same in standard errors, so that noise is not selected."""

MIN_OUTLINE_POINTS = 12
"""Minimum number of points above the floor of an outline."""

BIN_LENGTH = 3.0
"""Length of a bin in units of the errors' autocorrelation."""

POINTS_PER_KNOT = 60
"""Points per knot of the spline that represents the outline's shape when estimating its noise."""
MAX_CORRELATION_LENGTH = 60.0
"""Maximum autocorrelation length, in points."""

MAX_OUTLINE_HEIGHT = 10.0
"""Maximum height of an outline, in widths of the device."""

MIN_SERIES_HEIGHT = 1e-4
"""Minimum largest height of a series, in widths of the device."""

MAX_PRESSURE = 5e6
"""Maximum pressure in Pa of a silicone device."""

READING_TOLERANCE = 1e-6

HEIGHT_TOLERANCE = 0.1
"""Relative tolerance of equal heights; two states at one pressure past a limit point differ more."""


def prepare(outlines: Sequence[Outline], actuator: Actuator, width: float) -> tuple[list[Shape], list[str]]:
    """Check outlines against each other and the device, whose surface's edge is ``width`` m from its axis, and cut and bin
    them. Return shapes by rising pressure, and a sentence on each outline that was left out; `OutlineFitError` for what
    cannot be fitted."""
    # A bridge over a gap is not measured.
    chosen = sorted((outline.measured() for outline in outlines), key=lambda outline: outline.pressure)
    if from_base := [outline.source for outline in chosen if outline.whole == "base"]:
        raise OutlineFitError(
            f"{from_base[0]}: its heights count from the base, not from the undeformed top; measure the photographs together "
            "with one at zero pressure"
        )
    whole = [outline.source for outline in chosen if outline.whole]
    if whole and not isinstance(actuator, devices.Wedged) and actuator.dimension == 3:
        raise OutlineFitError(
            f"{whole[0]} is the outline of a body of revolution, and a {type(actuator).__name__} is none; measure how it "
            "bends: measure view without --revolved"
        )
    _check_pressures(chosen)
    _check_sizes(chosen, actuator, width)
    cut = [(outline, rising(outline)) for outline in chosen]
    notes = [
        f"{outline.source}: rise below {_floor(outline) * 1e3:.2g} mm: photograph not used"
        for outline, kept in cut
        if kept is None
    ]
    kept = [(outline, part) for outline, part in cut if part is not None]
    if not kept:
        raise OutlineFitError("no outline rises above the undeformed surface; give at least one that does")
    run = correlation([outline for outline, _ in kept])
    shapes = [_shape(outline, part, run) for outline, part in kept]
    _check_place(shapes, width)
    return shapes, notes


def correlation(outlines: Sequence[Outline]) -> float:
    """Return the correlation length of the outlines' residuals in points: the median of integrated autocorrelations.

    The shape is taken out by a spline. Where what is left is far below the stated errors there is no noise to judge by, and
    the measurement's own smoothing span is believed.
    """
    lengths = []
    for outline in outlines:
        part = rising(outline)
        if part is None or part.stop - part.start < 2 * POINTS_PER_KNOT:
            continue
        z, error = outline.z[part], outline.error[part]
        left = z - _spline(z)
        if float(np.sqrt(np.mean(left**2))) > 0.05 * float(np.median(error)):
            lengths.append(problem.autocorrelation_time(left))
    return min(max(float(np.median(lengths)), 1.0), MAX_CORRELATION_LENGTH) if lengths else SMOOTHING_POINTS / 2


def _spline(z: Array) -> Array:
    n = len(z)
    at = np.arange(n, dtype=float)
    inner = np.linspace(0, n - 1, max(n // POINTS_PER_KNOT, 2) + 1)[1:-1]
    knots = np.r_[[0.0] * 4, inner, [n - 1.0] * 4]
    return np.asarray(make_lsq_spline(at, z, knots, k=3)(at))


def _floor(outline: Outline) -> float:
    return max(MIN_HEIGHT, FLOOR_ERRORS * float(np.median(outline.error)))


def rising(outline: Outline) -> slice | None:
    """Return the points between the outermost places at which three neighbours lie above the floor; None if there are too few.

    A cut by place: a cut by each point's own height would keep those whose errors point up. So would the places themselves,
    but for a smoothing span less at both ends. Of a whole outline all points count.
    """
    high = outline.z > _floor(outline)
    if len(high) < MIN_OUTLINE_POINTS:
        return None
    if outline.whole:
        high = np.full(len(high), high.any())
    steady = np.flatnonzero(high[:-2] & high[1:-1] & high[2:])
    if not len(steady):
        return None
    first, last = int(steady[0]), int(steady[-1]) + 3
    spare = min(SMOOTHING_POINTS, (last - first) // 10)
    return slice(first + spare, last - spare) if last - first - 2 * spare >= MIN_OUTLINE_POINTS else None


def _shape(outline: Outline, part: slice, run: float) -> Shape:
    x, z, error = outline.x[part], outline.z[part], outline.error[part]
    count = max(round(len(x) / (BIN_LENGTH * run)), 1)
    # With correlated errors, every few points carry the same information as all.
    stride = max(int(run / 3), 1)
    pick = np.arange(stride // 2, len(x), stride)
    bins = pick * count // len(x)
    bins = np.unique(bins, return_inverse=True)[1]
    weight = np.full(int(bins.max()) + 1, math.sqrt(max(len(x) / count / run, 1.0)))
    above = np.maximum(z, 0.0)
    centre = 0.0 if outline.whole else float(np.trapezoid(x * above, x) / np.trapezoid(above, x))
    return Shape(
        outline.source, np.column_stack([x, z])[pick], error[pick], bins, weight, outline.pressure,
        outline.pressure_error, outline.height, centre, outline.scale_error, outline.level_error, outline.history,
        outline.edge_error, bool(outline.whole),
    )  # fmt: skip


class Reading(Protocol):
    """A measured pressure in Pa, with its standard error, and the photograph of it."""

    @property
    def source(self) -> str: ...

    @property
    def pressure(self) -> float: ...

    @property
    def pressure_error(self) -> float: ...


def check_readings(outlines: Sequence[Reading]) -> None:
    """Raise `OutlineFitError` for nothing to fit to, or a pressure without an error or beyond silicone."""
    if not outlines:
        raise OutlineFitError("nothing to fit to; give outlines that softmodels measure photos has made")
    for outline in outlines:
        if not outline.pressure_error > 0.0:
            raise OutlineFitError(
                f"{outline.source}: its pressure has no standard error, which is needed as a "
                "weight; give one in the list of photographs"
            )
        if outline.pressure > MAX_PRESSURE:
            raise OutlineFitError(
                f"{outline.source}: a pressure of {outline.pressure / 1e3:.4g} kPa is too high for silicone; check its unit"
            )


def _check_pressures(outlines: Sequence[Outline]) -> None:
    check_readings(outlines)
    for earlier, two in itertools.pairwise(outlines):
        same = two.pressure - earlier.pressure <= READING_TOLERANCE * abs(two.pressure)
        if (
            same
            and earlier.history == two.history
            and abs(two.height - earlier.height) <= HEIGHT_TOLERANCE * max(abs(two.height), abs(earlier.height), MIN_HEIGHT)
        ):
            raise OutlineFitError(
                f"{earlier.source} and {two.source} have the same pressure, {two.pressure:.5g} Pa, and the same height: the "
                "measurement would count twice, so give only one of them"
            )


def _check_sizes(outlines: Sequence[Outline], actuator: Actuator, width: float) -> None:
    tallest = max(outlines, key=lambda outline: float(outline.z.max()))
    top, span = float(tallest.z.max()), max(float(np.ptp(outline.x)) for outline in outlines)
    device = f"a {type(actuator).__name__} of {width * 2e3:.4g} mm across"
    if top > MAX_OUTLINE_HEIGHT * width or span > 50 * width:
        raise OutlineFitError(
            f"{tallest.source} is {top * 1e3:.4g} mm high and up to {span * 1e3:.4g} mm wide, which is impossible for "
            f"{device}; outlines are in metres, so check the unit of the photographs' grid and of the device"
        )
    if 0.0 < span < 0.05 * width or 0.0 < top < MIN_SERIES_HEIGHT * width:
        raise OutlineFitError(
            f"the highest outline, {tallest.source}, is {top * 1e3:.4g} mm high and {span * 1e3:.4g} mm wide; for {device} "
            f"this suggests a wrong unit (outlines are in metres)"
        )


def _check_place(shapes: Sequence[Shape], width: float) -> None:
    """Check that the device is as wide as the risen part, and does not move."""
    low = min(shapes, key=lambda shape: shape.height)
    wide = float(np.ptp(low.points[:, 0]))
    if wide > 2.0 * width * 1.05 and not low.whole:
        raise OutlineFitError(
            f"{low.source}: the risen part is {wide * 1e3:.4g} mm wide at a height of {low.height * 1e3:.3g} mm, more "
            f"than the device's {width * 2e3:.4g} mm: this is not the device of the case"
        )
    centres = [shape.centre for shape in shapes]
    if np.ptp(centres) > 0.25 * width:
        raise OutlineFitError(
            f"the outlines' centres are up to {np.ptp(centres) * 1e3:.3g} mm apart: the device or the camera has moved, or "
            "some photographs show only a part of it"
        )


# ----------------------------------------------------------------------------------------------------------------------
# The simulated outline of a device, as in a photograph of its shadow.
#
# For an axisymmetric section it is the deformed outer curve, for a slice the edge between its outer surface and its first cut
# plane. Both are chains of second-order edges: places come from the nodes and are exact on the edges between. Nodes are
# gathered to all ranks, so that all further computation is plain numpy and identical everywhere.


MAX_TOP_UNEVENNESS = 1e-3
"""Maximum unevenness of an undeformed top, in widths of the device, for heights to count from it."""

CHECKED_TOP_SHARE = 0.75
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

    counts_heights = True
    up = np.array([0.0, 1.0])
    """Direction in which heights count, as the last index of the curve's nodes."""

    def __init__(self, system: System):
        self.system = eq = system
        body, actuator = eq.body, eq.body.actuator
        edges, grid = outer_edges(body), state_values.Grid(eq)
        self._blocks = nodes_of(eq, sensitivity.coordinates(body.mesh)[0], edges)
        self._mix = np.eye(3) if self._blocks.shape[1] == 3 else STRAIGHT
        self._space, self._nodes = grid.space, nodes_of(eq, grid.space, edges)
        self._dofs = state_values.displacement_maps(eq, grid)[0][self._nodes]
        self._along = _sideways_vector(actuator)
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
        return mpi.everywhere(self.system.comm, local)

    def _arranged(self, values: Array) -> Array:
        """Return the values of all ranks' edges, shape (m, 3, ...), as those of the chain."""
        chosen = values[self._order]
        chosen[self._turned] = chosen[self._turned][:, [1, 0, 2]]
        return chosen

    @property
    def _plane(self) -> Array:
        """Unit vectors of the outline's plane, shape (2, 3)."""
        return np.array([self._along, self.system.body.actuator.lift])

    def _in_plane(self, vectors: Array) -> Array:
        return np.asarray(vectors @ self._plane.T)

    def _displacement(self, w: Array) -> Array:
        eq = self.system
        u = mpi.everywhere(eq.comm, w[self._dofs]) @ eq.body.skew_inverse.T * eq.length_unit
        if u.shape[-1] == 2:
            u = np.stack([u[..., 0], np.zeros(u.shape[:-1]), u[..., 1]], axis=-1)
        return self._arranged(u)

    def curve(self, state: State) -> grid.QuadraticCurve:
        """Return the deformed curve on the current mesh in m."""
        self.follow()
        return grid.QuadraticCurve(self._in_plane(self.points - self.top + self._displacement(state.w)))

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
    def tall(self) -> float:
        """Height of the undeformed curve in m."""
        return float(np.ptp(self.points @ np.asarray(self.system.body.actuator.lift)))

    @property
    def unevenness(self) -> float:
        """Height of the undeformed top above its apex in m, negative below it, away from the rim; 0 for a flat one."""
        x, z = np.moveaxis(self._in_plane(self.points - self.top), -1, 0)
        # Only up to where the curve leaves the middle: parts that return below are not the top.
        on_top = np.cumprod((x < CHECKED_TOP_SHARE * self.width).all(axis=1)).astype(bool)
        return float(np.abs(z[on_top]).max(initial=0.0))

    @property
    def flat(self) -> bool:
        """Whether the undeformed top is flat, so that outlines can count their heights from it."""
        return self.unevenness <= MAX_TOP_UNEVENNESS * self.width


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

    def edges(outer: Sequence[int] | npt.NDArray[np.int32]) -> npt.NDArray[np.int32]:
        return np.unique(np.concatenate([edges_of.links(facet) for facet in outer] or [np.empty(0, dtype=np.int32)]))

    plane = body.entities.get(body.actuator.cut_planes[0].name, (2, ()))[1]
    return np.intersect1d(edges(facets), edges(plane)).astype(np.int32)


def nodes_of(
    eq: System, space: fem.FunctionSpace, entities: npt.NDArray[np.int32], dimension: int = 1
) -> npt.NDArray[np.int64]:
    """Return the local nodes of edges, or of facets of dimension 2, in a space of first or second order: the corners, then the
    middles of edges; of edges shape (m, 2 or 3), of facets (m, 3 or 6)."""
    topology = eq.body.mesh.topology
    dim = topology.dim
    topology.create_connectivity(dimension, dim)
    topology.create_connectivity(dim, dimension)
    cells_of, entities_of = topology.connectivity(dimension, dim), topology.connectivity(dim, dimension)
    layout = space.dofmap.dof_layout
    nodes = np.empty((len(entities), len(layout.entity_closure_dofs(dimension, 0))), dtype=np.int64)
    for row, entity in enumerate(entities):
        cell = cells_of.links(entity)[0]
        number = int(np.flatnonzero(entities_of.links(cell) == entity)[0])
        corners_first = sorted(layout.entity_closure_dofs(dimension, number))  # as of a cell
        nodes[row] = space.dofmap.cell_dofs(cell)[corners_first]
    return nodes


def _sideways_vector(actuator: Actuator) -> Array:
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


SAMPLES_PER_PIECE = 17  # samples per piece at which heights are compared
MAX_DIP_DEPTH = 1e-7
"""Depth in m of ignored dips."""


@dataclasses.dataclass(frozen=True, eq=False)
class Shadow:
    """The visible edge as a curve of its own: the piece of the whole curve that each of its pieces is a part of, or hangs
    on, shape (m,), and that piece's shape functions at the new piece's three nodes, shape (m, 3, 3)."""

    curve: grid.QuadraticCurve
    source: npt.NDArray[np.int64]
    weights: Array

    def rate(self, rate: Array) -> Array:
        """Return the derivative of the edge's nodes from that of the whole curve's, shape (n, 3, 2) to (m, 3, 2). Where
        pieces were cut they slide along the curve, and level parts along themselves: neither moves the edge."""
        return np.einsum("mab,mbi->mai", self.weights, rate[self.source])


def shadow_of(curve: grid.QuadraticCurve, whole: bool = False) -> Shadow:
    """Return the visible edge of a curve that runs from the axis outwards and down; all of it for a whole outline."""
    s, count = np.linspace(-1.0, 1.0, SAMPLES_PER_PIECE), len(curve.nodes)
    places, above = edge_heights(curve)
    hidden = above - places[:, 1] > MAX_DIP_DEPTH
    if whole or not hidden.any():
        return _assembled_edge(curve, [_Part(k, -1.0, 1.0) for k in range(count)])
    parts: list[_Part] = []
    for k, seen in enumerate(~hidden.reshape(count, SAMPLES_PER_PIECE)):
        edges = np.flatnonzero(np.diff(np.r_[False, seen, False].astype(int)))
        for first, end in edges.reshape(-1, 2).tolist():
            place, begin = k * SAMPLES_PER_PIECE + first, float(s[first])
            if place and hidden[place - 1]:  # going outwards, a trough ends here at its rim
                before = np.flatnonzero(~hidden[:place])
                begin = _summit(curve, k, begin)
                parts.append(_Part(k, begin, begin, float(places[before[-1], 0]) if len(before) else 0.0))
            if s[end - 1] > begin:
                parts.append(_Part(k, begin, float(s[end - 1])))
    return _assembled_edge(curve, parts)


@dataclasses.dataclass(frozen=True)
class _Part:
    """The stretch of a piece between two parameters; or, from the place x in m, the level edge up to one of it, the rim."""

    piece: int
    begin: float
    end: float
    level_from: float | None = None


def edge_heights(curve: grid.QuadraticCurve) -> tuple[Array, Array]:
    """Return places of a curve, shape (n, 2), `SAMPLES_PER_PIECE` a piece, and heights of the visible edge, shape (n,)."""
    s, count = np.linspace(-1.0, 1.0, SAMPLES_PER_PIECE), len(curve.nodes)
    places = curve.at(np.repeat(np.arange(count), SAMPLES_PER_PIECE), np.tile(s, count))[0]
    return places, np.maximum.accumulate(places[::-1, 1])[::-1]  # the highest from here outwards


def crest(curve: grid.QuadraticCurve) -> tuple[int, float]:
    """Return the highest place of a curve: its piece and the parameter there."""
    piece, place = divmod(int(np.argmax(edge_heights(curve)[0][:, 1])), SAMPLES_PER_PIECE)
    return piece, _summit(curve, piece, float(np.linspace(-1.0, 1.0, SAMPLES_PER_PIECE)[place]))


def _summit(curve: grid.QuadraticCurve, piece: int, s: float) -> float:
    """Return the highest place of a piece near a parameter."""
    slope, bend = (vectors[1] for vectors in curve.at(piece, s)[1:])
    return float(np.clip(s - slope / bend, -1.0, 1.0)) if bend < 0.0 else s


def _assembled_edge(curve: grid.QuadraticCurve, parts: list[_Part]) -> Shadow:
    """Return the edge of its parts in order, from the axis outwards."""
    source = np.array([part.piece for part in parts])
    weights = grid.shapes(np.array([[part.begin, part.end, (part.begin + part.end) / 2] for part in parts]))
    nodes = np.einsum("mab,mbi->mai", weights, curve.nodes[source])
    for row, part in enumerate(parts):
        if part.level_from is not None:
            x = nodes[row, 0, 0]
            nodes[row, :, 0] = part.level_from, x, (part.level_from + x) / 2
    return Shadow(grid.QuadraticCurve(nodes), source, weights)


def half_outline(curve: grid.QuadraticCurve, spacing: float, lowest: float = -5e-5) -> tuple[Array, Array]:
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


# ----------------------------------------------------------------------------------------------------------------------
# Read files of outlines, and exclude photographs.


class OutlineFitError(FitError):
    """Outlines cannot be fitted; the message is for the user."""


def read_outlines(files: Sequence[Path], untrusted: bool = False, exclude: Sequence[str] = ()) -> list[Outline]:
    """Read outlines' files, or all in a folder, but for photographs or files excluded by name.

    Raises `OutlineFitError` for no file, one that is no outline, or one that the measurement does not trust, unless
    ``untrusted``.
    """
    names: list[Path] = []
    for file in files:
        outline_files = sorted(p for p in file.glob("*.csv") if p.name != "heights.csv") if file.is_dir() else [file]
        if not outline_files:
            raise OutlineFitError(f"the folder {file} holds no outlines; create them with softmodels measure photos")
        names += outline_files
    if not names:
        raise OutlineFitError("no measurements; give outlines made by softmodels measure photos")
    outlines = []
    for name in names:
        try:
            outlines.append(Outline.from_csv(name))
        except OutlineError as error:
            raise OutlineFitError(str(error)) from None
    keep = kept([(outline.source, name) for name, outline in zip(names, outlines, strict=True)], exclude)
    names, outlines = [names[i] for i in keep], [outlines[i] for i in keep]
    doubted = [(name, outline) for name, outline in zip(names, outlines, strict=True) if outline.trust == "no"]
    if doubted and not untrusted:
        name, outline = doubted[0]
        more = f", and {len(doubted) - 1} more" if len(doubted) > 1 else ""
        raise OutlineFitError(
            f"{name} is untrusted ({'; '.join(outline.reasons)}){more}; exclude it, write anyway "
            "beside it in the column use of the list of photographs and measure again, or use all with --untrusted"
        )
    return outlines


def kept(rows: Sequence[tuple[str, Path | None]], exclude: Sequence[str]) -> list[int]:
    """Return which rows, photographs with their files, are not excluded by name; `OutlineFitError` for a name that is none
    of them, or if nothing is left."""
    left = {}
    for name in exclude:
        places = [
            i for i, (source, file) in enumerate(rows)
            if name in (source, Path(source).stem, *((str(file), file.name, file.stem) if file else ()))
        ]  # fmt: skip
        if not places:
            known = ", ".join(source for source, _ in rows)
            raise OutlineFitError(f"--exclude {name}: there is no such photograph; there are {known}")
        left.update(dict.fromkeys(places))
    keep = [i for i in range(len(rows)) if i not in left]
    if rows and not keep:
        raise OutlineFitError("--exclude removes all measurements; keep at least one")
    return keep
