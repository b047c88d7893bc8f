"""Openings of a part's air: bores through which a cavity reaches the outside, found on its surface and closed by plugs.

The part's surface is sampled on a grid of voxels. A ball that rolls over the part from outside reaches all air but what lies
behind a narrower way: what it does not reach is a pocket, and where the pocket meets the reached air is its mouth. A groove is
a pocket too, but its mouth is long; the air behind a bore has mouths that are round and small for its volume.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from geometries import actuator, mesh_arrays
from geometries.actuator import Vector
from geometries.surfaces import turned_outwards
from softmodels.common.arrays import Array
from softmodels.common.errors import GeometryError
from softmodels.common.lazy import pyvista, scipy

VOXEL_COUNT = 800_000
"""Voxels of the grid, about."""
MIN_BALL_VOXELS = 1.4
"""Radius of the smallest ball in voxels."""
BALL_GROWTH = 1.25
MAX_MOUTH_SHARE = 0.45
"""Area of an air space's mouths over its volume to the power 2/3, above which it is a niche of the outside."""
MAX_MOUTH_IN_BALLS = 2.2
"""Area of one mouth over that of the ball's great circle, above which it is a groove's."""
MIN_VOLUME_SHARE = 0.05
"""Volume over that of the largest air space, below which a pocket is a hole for a screw or the like and stays open."""
MIN_VOXELS_IN_POCKET = 60
SECTOR_COUNT, MIN_SECTORS = 12, 10
"""Sectors around a bore's axis, and those of them that show a wall where it is a bore."""
BORE_REACH = 10.0
"""Distance from its mouth, over the ball's radius, up to which a bore is looked at."""
PLUG_LENGTH = 2.0
"""Length of a plug over the bore's radius."""
ON_PLANE = 0.3
"""Distance of a plug's middle from a cut plane, over the bore's radius, up to which the plane halves the bore."""
PLATE_THICKNESS = 0.05
"""Thickness of the plate that a part is held on, over the part's size, where openings are looked for."""
CUT_TOLERANCE = 1e-5
"""Distance of a corner from a cut plane, over the part's size, up to which it is in the plane: files round to seven digits."""


@dataclasses.dataclass(frozen=True)
class Inlet:
    """A bore from the outside to an air space, and the plug in it: the middle of the plug's outer end (m), unit vector along
    the bore's axis inwards, radius of the bore, farthest distance of its wall from the axis, and the plug's length (m)."""

    place: Vector
    axis: Vector
    radius: float
    reach: float
    length: float

    @property
    def row(self) -> list[float]:
        """Its numbers in one row, which `from_row` takes back."""
        return [*self.place, *self.axis, self.radius, self.reach, self.length]

    @classmethod
    def from_row(cls, row: Sequence[float]) -> Inlet:
        """Return the inlet of a row of numbers."""
        return cls(_vector(row[:3]), _vector(row[3:6]), *row[6:])

    @property
    def text(self) -> str:
        """Radius and place, for a message."""
        x, y, z = (round(1e3 * value, 1) + 0.0 for value in self.place)
        return f"of {1e3 * self.radius:.2g} mm radius at ({x:g}, {y:g}, {z:g}) mm"

    @property
    def cylinder(self) -> float:
        """Radius in m of a cylinder along its axis that fills the bore and ends within the wall around it."""
        return 1.05 * self.reach + 0.05 * self.radius

    @property
    def middle(self) -> Vector:
        """Middle of the plug."""
        return _vector(np.asarray(self.place) + 0.5 * self.length * np.asarray(self.axis))

    def within(self, normals: Sequence[Vector]) -> Inlet | None:
        """Return the inlet of a slice of a part, which ends on planes through the origin, by their outward unit normals: one
        that a plane halves has its axis in it. None if it lies beyond one."""
        place, axis = np.array(self.place), np.array(self.axis)
        for normal in np.reshape(normals, (-1, 3)):
            depth = float(normal @ np.array(self.middle))
            if depth > ON_PLANE * self.radius:
                return None
            if depth > -ON_PLANE * self.radius:
                place, axis = place - (place @ normal) * normal, axis - (axis @ normal) * normal
        return dataclasses.replace(self, place=_vector(place), axis=_vector(axis / np.linalg.norm(axis)))


def whole(surface: tuple[Array, NDArray[np.int64]], normals: Sequence[Vector]) -> tuple[Array, NDArray[np.int64]]:
    """Return the closed surface of the whole part of which a slice is given, corners in m (n, 3) and triangles (t, 3), by the
    outward unit normals of its cut planes through the origin."""
    import manifold3d

    if not len(normals):
        return surface
    points, triangles = surface
    size = float(np.ptp(points, axis=0).max())
    points = points / size
    for normal in np.array(normals):
        depth = points @ normal
        points = points - np.where(np.abs(depth) < CUT_TOLERANCE, depth, 0.0)[:, None] * normal
    images = [
        mesh_arrays.manifold(points @ image.T, triangles if np.linalg.det(image) > 0.0 else triangles[:, ::-1])
        for image in actuator.reflected(normals)
    ]
    places, corners = mesh_arrays.surface_of(manifold3d.Manifold.batch_boolean(images, manifold3d.OpType.Add))
    return size * places, corners


def on_plate(surface: tuple[Array, NDArray[np.int64]], normal: Array, at: float) -> tuple[Array, NDArray[np.int64]] | None:
    """Return a closed surface, corners in m (n, 3) and triangles (t, 3), joined with a plate as large as the part on a plane of
    this unit normal and distance (m) from the origin; None where the part does not lie on one side of the plane."""
    import manifold3d

    points, triangles = surface
    size = float(np.ptp(points, axis=0).max())
    depths = (points @ normal - at) / size
    outwards = 1.0 if depths.max() < CUT_TOLERANCE else -1.0
    if (outwards * depths).max() > CUT_TOLERANCE:
        return None
    footprint = points / size - np.outer(depths, normal)
    sides = [footprint + thickness * outwards * normal for thickness in (-CUT_TOLERANCE, PLATE_THICKNESS)]
    part = mesh_arrays.manifold(points / size, turned_outwards(points, triangles))
    if part.is_empty():
        return None
    places, corners = mesh_arrays.surface_of(part + manifold3d.Manifold.hull_points(np.concatenate(sides)))
    return size * places, corners


def plugged(
    surface: tuple[Array, NDArray[np.int64]], plugs: Sequence[Inlet], normals: Sequence[Vector] = ()
) -> tuple[Array, NDArray[np.int64]]:
    """Return a closed surface, corners in m (n, 3) and triangles (t, 3), whose inlets are filled up to its cut planes, of which
    these are the outward unit normals."""
    import manifold3d

    points, triangles = surface
    size = float(np.ptp(points, axis=0).max())
    part = mesh_arrays.manifold(points / size, triangles)
    if part.is_empty():
        raise GeometryError("the part's surface crosses itself, so its inlets cannot be closed; repair it where it was made")
    for inlet in plugs:
        first, second = _across(np.array(inlet.axis))
        place = np.column_stack([first, second, inlet.axis, np.array(inlet.place) / size])
        plug = manifold3d.Manifold.cylinder(inlet.length / size, inlet.cylinder / size, circular_segments=48).transform(place)
        for normal in normals:
            plug = plug.trim_by_plane(tuple(-value for value in normal), 0.0)
        part += plug
    places, corners = mesh_arrays.surface_of(part)
    return size * places, corners


@dataclasses.dataclass(frozen=True, eq=False)
class AirSpace:
    """Air behind one or more openings: its volume in m3 with their bores, measured on voxels, and these."""

    volume: float
    inlets: tuple[Inlet, ...]
    voxels: NDArray[np.bool_]
    grid: Grid

    def holds(self, place: Vector) -> bool:
        """Return whether a point (m) lies in it."""
        at = tuple(np.rint((np.asarray(place) - self.grid.origin) / self.grid.step).astype(int))
        inside = all(0 <= i < n for i, n in zip(at, self.voxels.shape, strict=True))
        return inside and bool(self.voxels[at])


@dataclasses.dataclass(frozen=True, eq=False)
class Grid:
    """Voxels: the middle of the first one, their edge (m), and whether each is air."""

    origin: Array
    step: float
    air: NDArray[np.bool_]

    @classmethod
    def around(cls, points: Array, triangles: NDArray[np.int64], room: float) -> Grid:
        """Return the voxels of a closed surface, with room for a ball of a radius (m) on all sides."""
        low, high = points.min(axis=0), points.max(axis=0)
        step = float(np.cbrt(np.prod(high - low + 2.0 * room) / VOXEL_COUNT))
        room += 3.0 * step
        count = np.ceil((high - low + 2.0 * room) / step).astype(int) + 1
        surface = pyvista.PolyData.from_regular_faces(points, triangles)
        frame = pyvista.ImageData(dimensions=count, spacing=(step,) * 3, origin=low - room)
        inside = surface.voxelize_binary_mask(reference_volume=frame)["mask"]
        return cls(low - room, step, ~np.asarray(inside, dtype=bool).reshape(count, order="F"))

    def at(self, voxels: NDArray[np.int64]) -> Array:
        """Return the middles (n, 3) of voxels (n, 3) in m."""
        return self.origin + self.step * voxels


def air_spaces(points: Array, triangles: NDArray[np.int64]) -> list[AirSpace]:
    """Return the air spaces that bores connect with the outside of a closed surface, the largest one first: corners in m,
    shape (n, 3), and triangles, shape (t, 3). The largest openings have a quarter of the part's least extent as radius;
    where there are none, a quarter of its middle extent: a flat part may have a port as wide as it is thick."""
    least, middle, _ = np.sort(np.ptp(points, axis=0))
    usual, wider = 0.25 * float(least), min(0.25 * float(middle), float(least))
    spaces = _air_spaces(points, triangles, usual)
    return spaces if spaces or wider == usual else _air_spaces(points, triangles, wider)


def _air_spaces(points: Array, triangles: NDArray[np.int64], largest_ball: float) -> list[AirSpace]:
    """Return those with openings of up to a radius (m); see `air_spaces`."""
    grid = Grid.around(points, triangles, largest_ball)
    away = grid.step * scipy.ndimage.distance_transform_edt(grid.air)
    smaller = math.floor(math.log(largest_ball / (MIN_BALL_VOXELS * grid.step), BALL_GROWTH))
    candidates = [p for k in range(smaller, -1, -1) for p in _pockets(grid, away, largest_ball / BALL_GROWTH**k)]
    spaces: list[_Pocket] = []
    candidates.sort(key=lambda pocket: (-pocket.count, pocket.radius))
    while candidates:
        largest = candidates[0]
        own = [other for other in candidates if largest.voxels[other.seed]]
        # The tightest ball that finds all of it shows best where its mouths are.
        spaces.append(min((p for p in own if p.count > 0.9 * largest.count), key=lambda pocket: pocket.radius))
        candidates = [other for other in candidates if not largest.voxels[other.seed]]
    if not spaces:
        return []
    most = spaces[0].count
    wall = _Wall.of(points, turned_outwards(points, triangles), grid.step)
    return [
        AirSpace(p.count * grid.step**3, tuple(wall.inlet(grid, p, mouth) for mouth in p.mouths), p.voxels, grid)
        for p in spaces
        if p.count >= MIN_VOLUME_SHARE * most
    ]


@dataclasses.dataclass(frozen=True, eq=False)
class _Pocket:
    """Air that a ball of a radius (m) does not reach, as voxels, their number and the deepest of them, and the voxels
    (n, 3) at each of its mouths."""

    radius: float
    voxels: NDArray[np.bool_]
    count: int
    seed: tuple[int, ...]
    mouths: list[NDArray[np.int64]]


def _pockets(grid: Grid, away: Array, radius: float) -> list[_Pocket]:
    """Return what a ball of a radius (m) does not reach and looks like an air space; ``away`` is the air's distance from the
    part."""
    label = scipy.ndimage.label
    cores, _ = label(away > radius)
    reached = grid.air & (scipy.ndimage.distance_transform_edt(cores != cores[0, 0, 0]) * grid.step <= radius)
    hidden, count = label(grid.air & ~reached)
    sizes = np.bincount(hidden.ravel(), minlength=count + 1)
    sizes[0] = 0  # what is no pocket
    # Where a voxel of a pocket has a reached one beside it, and how many faces they share.
    touching = np.zeros(grid.air.shape, dtype=np.int8)
    for axis in range(3):
        for way in (1, -1):
            touching += np.roll(reached, way, axis=axis)
    touching[hidden == 0] = 0
    shared = np.bincount(hidden.ravel(), touching.ravel(), minlength=count + 1)
    # A face of voxels that a slanted plane cuts in steps is larger by 3/2 on average.
    share = shared / 1.5 / np.maximum(sizes, 1) ** (2.0 / 3.0)
    pockets = []
    for number in np.flatnonzero((sizes >= MIN_VOXELS_IN_POCKET) & (share < MAX_MOUTH_SHARE) & (shared > 0)):
        voxels = hidden == number
        places, mouths = label(voxels & (touching > 0), structure=np.ones((3, 3, 3)))
        areas = np.bincount(places.ravel(), touching.ravel())[1:] / 1.5 * grid.step**2
        if mouths and areas.max() < MAX_MOUTH_IN_BALLS * np.pi * radius**2:
            deepest = int(np.argmax(np.where(voxels, away, 0.0)))
            seed = tuple(int(i) for i in np.unravel_index(deepest, voxels.shape))
            parts = [np.argwhere(places == mouth) for mouth in range(1, mouths + 1)]
            pockets.append(_Pocket(radius, voxels, int(sizes[number]), seed, parts))
    return pockets


# ----------------------------------------------------------------------------------------------------------------------
# The bore at a mouth: points and normals of the wall around it give its axis, its radius and how far it goes.


@dataclasses.dataclass(frozen=True, eq=False)
class _Wall:
    """Points all over a surface, shape (n, 3), and unit normals there, away from the solid."""

    points: Array
    normals: Array

    @classmethod
    def of(cls, points: Array, triangles: NDArray[np.int64], step: float) -> _Wall:
        """Return points that lie about a step (m) apart."""
        a, b, c = (points[triangles[:, i]] for i in range(3))
        normal = np.cross(b - a, c - a)
        length = np.linalg.norm(normal, axis=1)
        longest = np.max([np.linalg.norm(e, axis=1) for e in (b - a, c - b, a - c)], axis=0)
        pieces = np.maximum(np.ceil(longest / step), 1.0).astype(int)
        places, normals = [], []
        for n in np.unique(pieces):
            own = (pieces == n) & (length > 0.0)
            i, j = (index.ravel() for index in np.meshgrid(np.arange(n), np.arange(n), indexing="ij"))
            u, v = ((index[i + j < n] + 1.0 / 3.0) / n for index in (i, j))
            grid = (1.0 - u - v)[None, :, None] * a[own, None] + u[None, :, None] * b[own, None]
            grid = grid + v[None, :, None] * c[own, None]
            places.append(grid.reshape(-1, 3))
            normals.append(np.repeat(normal[own] / length[own, None], len(u), axis=0))
        return cls(np.concatenate(places), np.concatenate(normals))

    def inlet(self, grid: Grid, pocket: _Pocket, mouth: NDArray[np.int64]) -> Inlet:
        """Return the bore at a mouth (voxels, shape (n, 3)) of a pocket, and its plug."""
        centre, radius = grid.at(mouth).mean(axis=0), pocket.radius
        around = np.linalg.norm(self.points - centre, axis=1) < BORE_REACH * radius
        return _Wall(self.points[around], self.normals[around])._fitted(grid, pocket, centre)

    def _fitted(self, grid: Grid, pocket: _Pocket, centre: Array) -> Inlet:
        """Return the bore of which these are the walls, and parts around it, near its middle (m)."""
        radius = pocket.radius
        inside = grid.at(np.argwhere(pocket.voxels))
        inwards = inside[np.linalg.norm(inside - centre, axis=1) < 3.0 * radius].mean(axis=0) - centre
        axis = inwards / np.linalg.norm(inwards)
        for band, slant in ((0.4, 0.5), (0.3, 0.4), (0.25, 0.3), (0.2, 0.25), (0.2, 0.25), (0.2, 0.25)):
            offset = self.points - centre
            along = offset @ axis
            across = np.linalg.norm(offset - along[:, None] * axis, axis=1)
            # Walls of the bore, not the part's outside around its mouth, nor those of the chamber behind it; at first the
            # middle is known to half a voxel.
            near = (across < (1.0 + band) * radius + (band - 0.2) * 2.5 * grid.step) & (np.abs(along) < 2.5 * radius)
            near &= (np.abs(self.normals @ axis) < slant) & (self._facing(axis, offset) > 0.8)
            if near.sum() < 2 * SECTOR_COUNT:
                break
            axis = _least(self.normals[near], axis)
            plane = offset[near] - np.outer(offset[near] @ axis, axis)
            middle, radius = _circle(plane, axis, radius)
            centre = centre + middle
        start, stop, reach = self._bore(self.points - centre, axis, radius, grid.step)
        inset = min(0.1 * radius, 0.1 * (stop - start))
        length = min(PLUG_LENGTH * radius, stop - start - 2.0 * inset)
        place = centre + (start + inset) * axis
        return Inlet(_vector(place), _vector(axis), float(radius), float(reach), float(length))

    def _facing(self, axis: Array, offset: Array) -> Array:
        """Return the cosine of the angle between each wall's normal and the way to an axis through the place that the points
        are off (n, 3): 1 of a bore around the axis, negative of a nozzle's outside."""
        across = offset - np.outer(offset @ axis, axis)
        return -(self.normals * across).sum(axis=1) / np.maximum(np.linalg.norm(across, axis=1), 1e-300)

    def _bore(self, offset: Array, axis: Array, radius: float, step: float) -> tuple[float, float, float]:
        """Return from where to where along its axis a bore has walls all around, and its farthest wall's distance, m, by
        how far the points are off a place on the axis, shape (n, 3)."""
        along = offset @ axis
        across = offset - np.outer(along, axis)
        away = np.linalg.norm(across, axis=1)
        near = (away < 1.35 * radius + step) & (np.abs(self.normals @ axis) < 0.5) & (np.abs(along) < BORE_REACH * radius)
        near &= self._facing(axis, offset) > 0.0
        first, second = _across(axis)
        sector = ((np.arctan2(across[near] @ second, across[near] @ first) / np.pi + 1.0) * 0.5 * SECTOR_COUNT).astype(int)
        bins = np.floor(along[near] / step).astype(int)
        low = bins.min(initial=0)
        seen = np.zeros((bins.max(initial=0) - low + 2, SECTOR_COUNT), dtype=bool)
        seen[bins - low, np.minimum(sector, SECTOR_COUNT - 1)] = True
        # A long triangle has points on a lattice of its own: a neighbour counts as well.
        padded = np.pad(seen, ((1, 1), (0, 0)))
        whole = (padded[:-2] | padded[1:-1] | padded[2:]).sum(axis=1) >= MIN_SECTORS
        if not whole.any():
            return 0.0, PLUG_LENGTH * radius, 1.3 * radius
        runs, _ = scipy.ndimage.label(whole)
        start_bin = min(np.flatnonzero(whole), key=lambda i: abs(i + low))
        own = np.flatnonzero(runs == runs[start_bin])
        inside = along[near][(bins >= own[0] + low) & (bins <= own[-1] + low)]
        start, stop = float(inside.min()), float(inside.max())
        part = (along[near] >= start) & (along[near] <= min(stop, start + PLUG_LENGTH * radius))
        return start, stop, float(away[near][part].max(initial=radius))


def _vector(values: Sequence[float] | Array) -> Vector:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _least(normals: Array, near: Array) -> Array:
    """Return the direction that some normals (n, 3) are most square to, on the side of another."""
    axis = np.linalg.eigh(normals.T @ normals)[1][:, 0]
    return axis if axis @ near > 0.0 else -axis


def _across(axis: Array) -> tuple[Array, Array]:
    """Return two unit vectors square to an axis and each other."""
    first = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    first /= np.linalg.norm(first)
    return first, np.cross(axis, first)


def _circle(points: Array, axis: Array, radius: float) -> tuple[Array, float]:
    """Return the middle (3,) and radius of the circle nearest to points (n, 3) in the plane square to an axis."""
    first, second = _across(axis)
    x, y = points @ first, points @ second
    terms = np.column_stack([2.0 * x, 2.0 * y, np.ones(len(x))])
    a, b, c = np.linalg.lstsq(terms, x * x + y * y, rcond=None)[0]
    fitted = float(np.sqrt(max(c + a * a + b * b, 0.0)))
    if not 0.3 * radius < fitted < 2.0 * radius or np.hypot(a, b) > radius:
        return np.zeros(3), radius
    return a * first + b * second, fitted
