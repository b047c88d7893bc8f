"""Surfaces of bodies: triangulated to a chord error and measured, and laid on the printer's plates."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from geometries import meshing
from softmodels.casting import settings
from softmodels.casting.bodies import MM_PER_M, Solid, imported
from softmodels.common import names
from softmodels.common.arrays import Array
from softmodels.common.errors import MeshingError
from softmodels.common.lazy import gmsh

Cells = npt.NDArray[np.int64]


@dataclasses.dataclass(frozen=True)
class Facets:
    """A closed surface in mm.

    Attributes:
        points, triangles: Vertices, shape (n, 3), and those of each triangle, counter-clockwise from outside, shape (m, 3).
        face: Which face of the body each triangle lies on, shape (m,).
        normals: Outward unit normals of the exact surface at the corners of each triangle, shape (m, 3, 3).
        chord: Distance in mm that the triangles' middles, and their edges', are from the exact surface at most.
        volume, centre: Of the exact body, mm3, and its centre of mass, mm.
    """

    points: Array
    triangles: Cells
    face: Cells
    normals: Array
    chord: float
    volume: float
    centre: Array

    def __post_init__(self) -> None:
        names.keep_arrays(self)

    @property
    def corners(self) -> Array:
        """Corners of the triangles, shape (m, 3, 3)."""
        return self.points[self.triangles]

    @property
    def polyhedron_volume(self) -> float:
        """Volume within the triangles, mm3."""
        a, b, c = np.moveaxis(self.corners, 1, 0)
        return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)

    @property
    def open_edges(self) -> int:
        """Edges that do not lie between exactly two triangles, consistently oriented: none for a watertight surface."""
        edges = np.concatenate([self.triangles[:, [0, 1]], self.triangles[:, [1, 2]], self.triangles[:, [2, 0]]])
        known, count = np.unique(edges, axis=0, return_counts=True)
        both = {tuple(edge) for edge in known.tolist()}
        return int(np.count_nonzero(count != 1)) + sum((b, a) not in both for a, b in both)


EDGE_SAFETY_FACTOR = 0.72
"""Safety factor of the edge length, because triangles deviate more than their edges."""
MAX_REFINEMENTS = 4
FINE_ENOUGH = 10_000
"""Number of triangles above which second order is accurate for the volume; fewer are curved to fourth order."""
LEAST_COSINE = 0.7
"""Cosine between a surface's normal and a triangle's below which the normal is invalid."""


def facets_of(file: Path, chord: float) -> Facets:
    """Return the surface of the one solid of a STEP file, at most ``chord`` mm from the exact one; `MeshingError` if that
    fails."""
    with meshing.private_model():
        solid = read_step(file)
        surfaces = [tag for _, tag in gmsh.model.getBoundary([(3, solid)], oriented=False)]
        shares = dict.fromkeys(surfaces, EDGE_SAFETY_FACTOR)
        for _ in range(MAX_REFINEMENTS):
            set_sizes(solid, shares, chord)
            gmsh.model.mesh.clear()
            gmsh.model.mesh.generate(2)
            off = {surface: _distance(surface, chord) for surface in surfaces}
            if max(off.values()) <= chord:
                return _oriented_triangles(surfaces, max(off.values()))
            for surface, distance in off.items():
                shares[surface] *= max(0.5, min(1.0, 0.9 * math.sqrt(chord / max(distance, 1e-12))))
    raise MeshingError(
        f"{file.name} cannot be triangulated to {chord:g} mm: {max(off.values()):.3g} mm were reached; use a larger chord"
    )


def read_step(file: Path) -> int:
    """Read a STEP file of one solid into the current Gmsh model, in mm; return the solid's tag."""
    ((_, solid),) = imported(file)
    gmsh.model.occ.synchronize()
    return int(solid)


def _oriented_triangles(surfaces: list[int], chord: float) -> Facets:
    """Read the current mesh, and orient its triangles outwards."""
    tags, places, _ = gmsh.model.mesh.getNodes()
    index = np.full(int(tags.max()) + 1, -1)
    index[tags.astype(int)] = np.arange(len(tags))
    points = places.reshape(-1, 3)
    meshed = {tag: gmsh.model.mesh.getElementsByType(2, tag)[1].astype(int).reshape(-1, 3) for tag in surfaces}
    turns = _turns({tag: index[nodes] for tag, nodes in meshed.items()}, points)
    triangles, normals = [], []
    for surface, nodes in meshed.items():
        own, normal = index[nodes], _normals(surface, nodes)
        if turns[surface] < 0:
            own, normal = own[:, ::-1], normal[:, ::-1]
        flat = np.cross(points[own[:, 1]] - points[own[:, 0]], points[own[:, 2]] - points[own[:, 0]])
        triangles.append(own)
        normals.append(math.copysign(1.0, np.einsum("ij,ij->", normal.mean(axis=1), flat)) * normal)
    face = np.repeat(surfaces, [len(meshed[surface]) for surface in surfaces])
    volume, centre = _volume(turns, points.mean(axis=0), len(face))
    return Facets(points, np.concatenate(triangles), face, np.concatenate(normals), chord, volume, centre)


def _turns(meshed: dict[int, Cells], points: Array) -> dict[int, float]:
    """Return by face 1 if its triangles go counter-clockwise from outside, else -1; `MeshingError` if the faces are not
    connected. Two faces that meet in an edge go along it in opposite directions if they are turned the same way."""
    owners: dict[tuple[int, int], list[tuple[int, float]]] = {}
    for surface, nodes in meshed.items():
        edges = np.concatenate([nodes[:, [0, 1]], nodes[:, [1, 2]], nodes[:, [2, 0]]])
        _, where, count = np.unique(np.sort(edges, axis=1), axis=0, return_index=True, return_counts=True)
        for a, b in edges[where[count == 1]].tolist():  # on the face's own edge
            owners.setdefault((min(a, b), max(a, b)), []).append((surface, math.copysign(1.0, b - a)))
    meets: dict[int, dict[int, float]] = {surface: {} for surface in meshed}
    for pair in owners.values():
        if len(pair) == 2 and pair[0][0] != pair[1][0]:
            (start, way), (other, back) = pair
            meets[start][other] = meets[other][start] = -way * back
    begin = next(iter(meshed))
    turns, queue = {begin: 1.0}, [begin]
    while queue:
        here = queue.pop()
        for other, same in meets[here].items():
            if other not in turns:
                turns[other] = same * turns[here]
                queue.append(other)
    if len(turns) < len(meshed):
        raise MeshingError("the faces of a body are not connected; it has a hollow inside")
    volume = 0.0
    for surface, nodes in meshed.items():
        a, b, c = np.moveaxis(points[nodes], 1, 0)
        volume += turns[surface] * float(np.einsum("ij,ij->", a, np.cross(b, c)))
    return {surface: math.copysign(1.0, volume) * turn for surface, turn in turns.items()}


def _normals(surface: int, corners: Cells) -> Array:
    """Return the normals of a face at the corners of its triangles, shape (m, 3, 3), as Gmsh turns them."""
    tags, places, at = gmsh.model.mesh.getNodes(2, surface, includeBoundary=True, returnParametricCoord=True)
    values = np.reshape(gmsh.model.getNormal(surface, at), (-1, 3))
    index = np.full(int(tags.max()) + 1, -1)
    index[tags.astype(int)] = np.arange(len(tags))
    corner_normals = values[index[corners]]
    a, b, c = np.moveaxis(places.reshape(-1, 3)[index[corners]], 1, 0)
    flat = np.cross(b - a, c - a)
    flat /= np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-300)
    flat *= np.sign(np.einsum("ikj,ij->i", corner_normals, flat))[:, None]
    # At a pole the surface parametrisation has no valid normal; use the triangle's.
    lost = np.einsum("ikj,ij->ik", corner_normals, flat) < LEAST_COSINE
    return np.asarray(np.where(lost[:, :, None], flat[:, None], corner_normals))


def _distance(surface: int, chord: float) -> float:
    """Return the distance in mm that the middles of a face's triangles, and of their edges, are from it at most: from the
    surface's point at the mean of the corners' parameters, and from the nearest one only where that is not enough."""
    if gmsh.model.getType(2, surface) == "Plane":
        return 0.0
    _, nodes = gmsh.model.mesh.getElementsByType(2, surface)
    tags, places, at = gmsh.model.mesh.getNodes(2, surface, includeBoundary=True, returnParametricCoord=True)
    index = np.full(int(tags.max()) + 1, -1)
    index[tags.astype(int)] = np.arange(len(tags))
    own = index[nodes.astype(int).reshape(-1, 3)]

    corners = places.reshape(-1, 3)[own]
    looked = _middles(corners)
    if gmsh.model.getType(2, surface) == "Sphere":
        return float(_off_sphere(corners.reshape(-1, 3), looked).max())
    parameters = at.reshape(-1, 2)[own]
    low, high = (np.array(bound) for bound in gmsh.model.getParametrizationBounds(2, surface))
    half = 0.5 * (high - low)
    # A triangle across the seam of a closed surface is moved to one side of it.
    wide = np.ptp(parameters, axis=1, keepdims=True) > half
    parameters = parameters + np.where(wide & (parameters < low + half), 2.0 * half, 0.0)
    near = np.reshape(gmsh.model.getValue(2, surface, _middles(parameters).ravel()), (-1, 3))
    distance = np.linalg.norm(near - looked, axis=1)
    unsure = distance > chord
    if unsure.any():
        nearest, _ = gmsh.model.getClosestPoint(2, surface, looked[unsure].ravel())
        other = np.linalg.norm(np.reshape(nearest, (-1, 3)) - looked[unsure], axis=1)
        distance[unsure] = np.minimum(distance[unsure], other)
    return float(distance.max())


def _middles(corners: Array) -> Array:
    """Return the means of the corners of triangles, (m, 3, d), and of each two of them, shape (4 m, d)."""
    return np.concatenate([corners.mean(axis=1), *(0.5 * (corners[:, k] + corners[:, k - 1]) for k in range(3))])


def _off_sphere(on: Array, looked: Array) -> Array:
    """Return the distances of points from the sphere through others, because the kernel's nearest point may be on the far
    side."""
    middle = on.mean(axis=0)
    rows = np.column_stack([2.0 * (on - middle), np.ones(len(on))])
    solution = np.linalg.lstsq(rows, ((on - middle) ** 2).sum(axis=1), rcond=None)[0]
    radius = math.sqrt(solution[3] + solution[:3] @ solution[:3])
    return np.asarray(np.abs(np.linalg.norm(looked - middle - solution[:3], axis=1) - radius))


def _volume(turns: dict[int, float], middle: Array, count: int) -> tuple[float, Array]:
    """Return volume and centre of mass by the divergence theorem, on triangles curved to a higher order, with places counted
    from a middle, so that little is lost to rounding. Turns are those of `_turns`."""
    gmsh.model.mesh.setOrder(4 if count < FINE_ENOUGH else 2)
    volume, moment = 0.0, np.zeros(3)
    for surface, turn in turns.items():
        for kind in gmsh.model.mesh.getElementTypes(2, surface):
            local, weights = gmsh.model.mesh.getIntegrationPoints(kind, "Gauss10")
            jacobians, determinants, places = gmsh.model.mesh.getJacobians(kind, local, surface)
            normal, at = jacobians.reshape(-1, 3, 3)[:, 2], places.reshape(-1, 3) - middle
            share = turn * np.tile(weights, len(determinants) // len(weights)) * determinants
            volume += float((np.einsum("ij,ij->i", at, normal) * share).sum()) / 3.0
            moment += 0.5 * np.einsum("ij,ij,i->j", at**2, normal, share)
    return volume, middle + moment / volume


# ----------------------------------------------------------------------------------------------------------------------
# Maximum edge lengths of a body's triangles for a given chord error.


PLANAR_ALGORITHM, DELAUNAY_ALGORITHM = 3, 6
"""Gmsh's algorithms: a plane needs no inner nodes."""


def set_sizes(solid: int, shares: dict[int, float], chord: float) -> None:
    """Edges as long as the curvature allows, times a share for each face, on the face and on the curves around it."""
    low, high = np.reshape(gmsh.model.getBoundingBox(3, solid), (2, 3))
    largest = 0.25 * float(np.linalg.norm(high - low))
    sizes: dict[tuple[int, int], float] = {}
    for surface, share in shares.items():
        plane = gmsh.model.getType(2, surface) == "Plane"
        gmsh.model.mesh.setAlgorithm(2, surface, PLANAR_ALGORITHM if plane else DELAUNAY_ALGORITHM)
        size = largest if plane else min(largest, share * 2.0 * math.sqrt(2.0 * chord / _curvature(surface)))
        sizes[2, surface] = size
        for _, curve in gmsh.model.getBoundary([(2, surface)], combined=False, oriented=False):
            bent = _bend(curve)
            along = min(size, share * 2.0 * math.sqrt(2.0 * chord / bent)) if bent > 0.0 else size
            sizes[1, curve] = min(along, sizes.get((1, curve), largest))
    gmsh.option.setNumber("Mesh.MeshSizeMax", largest)
    gmsh.model.mesh.setSizeCallback(lambda dim, tag, x, y, z, other: sizes.get((dim, tag), largest))


def _curvature(surface: int) -> float:
    """Return the largest principal curvature at some points of a face, 1/mm."""
    low, high = (np.array(bound) for bound in gmsh.model.getParametrizationBounds(2, surface))
    grid = np.array([low + (high - low) * (a, b) for a in np.linspace(0.05, 0.95, 7) for b in np.linspace(0.05, 0.95, 7)])
    most, least, _, _ = gmsh.model.getPrincipalCurvatures(surface, grid.ravel())
    values = np.abs(np.concatenate([most, least]))
    return max(float(values[np.isfinite(values)].max(initial=0.0)), 1e-6)


def _bend(curve: int) -> float:
    """Return the largest curvature of a curve, 1/mm."""
    low, high = (bound[0] for bound in gmsh.model.getParametrizationBounds(1, curve))
    values = np.abs(gmsh.model.getCurvature(1, curve, np.linspace(low, high, 9)[1:-1]))
    return float(values[np.isfinite(values)].max(initial=0.0))


# ----------------------------------------------------------------------------------------------------------------------
# What the printer gets: bodies laid on their flat sides on plates, how long that takes, and a coupon for its clearances.


LOWEST_PLANE_TOLERANCE = 1e-3
"""Distance in mm from the lowest plane below which a triangle lies in it."""
PLATE_GAP = 4.0
"""Gap between bodies on a plate, and to its edge, mm."""
RESIN_DENSITY = 1100.0
"""Density of cured printing resin, kg/m3."""
SIDES = (
    np.eye(3), np.diag([1.0, -1.0, -1.0]),
    np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]),
    np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]), np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]]),
)  # fmt: skip
"""Rotations that lay a body on each of its six sides."""
QUARTER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


@dataclasses.dataclass(frozen=True)
class PlacedBody:
    """A body's surface where it lies on a plate (numbered from 1), in mm from the plate's corner."""

    name: str
    plate: int
    facets: Facets


def moved(facets: Facets, turn: Array, shift: Array) -> Facets:
    """Return a surface turned about the origin and then shifted, in mm."""
    return dataclasses.replace(
        facets, points=facets.points @ turn.T + shift, normals=facets.normals @ turn.T, centre=turn @ facets.centre + shift
    )


def laid_flat(facets: Facets) -> Facets:
    """Return a body on the side on which it has the largest flat area, its lowest point at height 0."""
    a, b, c = np.moveaxis(facets.corners, 1, 0)
    areas = 0.5 * np.cross(b - a, c - a)

    def flat(turn: Array) -> float:
        heights = facets.corners @ turn[2]
        lowest = (heights - heights.min()).max(axis=1) < LOWEST_PLANE_TOLERANCE
        return float(np.linalg.norm(areas[lowest], axis=1).sum())

    turn = max(SIDES, key=flat)
    points = facets.points @ turn.T
    return moved(facets, turn, -points.min(axis=0))


def arranged(bodies: Sequence[tuple[str, Facets]], workshop: settings.Workshop) -> list[PlacedBody]:
    """Return bodies on plates: in rows, the deepest first, and on a further plate where one is full.

    A body that is larger than a plate has one for itself.
    """
    wide, deep = MM_PER_M * workshop.bed_width, MM_PER_M * workshop.bed_depth
    laid = []
    for name, facets in bodies:
        flat = laid_flat(facets)
        x, y, _ = flat.points.max(axis=0)
        if y > x or x > wide - 2.0 * PLATE_GAP:
            flat = moved(flat, QUARTER, np.array([y, 0.0, 0.0])) if x <= deep - 2.0 * PLATE_GAP or y > x else flat
        laid.append((name, flat))
    laid.sort(key=lambda body: -float(body[1].points[:, 1].max()))
    placed, plate, x, y, row = list[PlacedBody](), 1, PLATE_GAP, PLATE_GAP, 0.0
    for name, flat in laid:
        width, depth = (float(value) for value in flat.points[:, :2].max(axis=0))
        if x > PLATE_GAP and x + width > wide - PLATE_GAP:
            x, y, row = PLATE_GAP, y + row + PLATE_GAP, 0.0
        if y > PLATE_GAP and y + depth > deep - PLATE_GAP:
            plate, x, y, row = plate + 1, PLATE_GAP, PLATE_GAP, 0.0
        placed.append(PlacedBody(name, plate, moved(flat, np.eye(3), np.array([x, y, 0.0]))))
        x, row = x + width + PLATE_GAP, max(row, depth)
    return placed


def too_large(placed: Sequence[PlacedBody], workshop: settings.Workshop) -> list[str]:
    """Return the names of the bodies that are larger than a plate."""
    size = MM_PER_M * np.array([workshop.bed_width, workshop.bed_depth])
    return [body.name for body in placed if (body.facets.points[:, :2].max(axis=0) > size).any()]


@dataclasses.dataclass(frozen=True)
class PrintEstimate:
    """What a print takes: the volume of all bodies in m3, and the times in s of each plate, all layers up to its tallest
    body."""

    resin: float
    times: tuple[float, ...]

    @property
    def mass(self) -> float:
        """Mass of the resin, kg."""
        return RESIN_DENSITY * self.resin


def print_estimate(placed: Sequence[PlacedBody], workshop: settings.Workshop) -> PrintEstimate:
    """Return what the bodies on their plates take on a printer that cures a layer at a time."""
    times = []
    for _, group in itertools.groupby(placed, lambda body: body.plate):
        height = max(float(body.facets.points[:, 2].max()) for body in group) / MM_PER_M
        times.append(math.ceil(height / workshop.layer) * workshop.layer_time)
    return PrintEstimate(sum(body.facets.volume for body in placed) / MM_PER_M**3, tuple(times))


# ----------------------------------------------------------------------------------------------------------------------
# The coupon: sockets of several clearances for one pin, and ribs and slots of several widths, to find what a printer can do.


COUPON_CLEARANCES = (0.05, 0.10, 0.15, 0.20, 0.25, 0.30)
"""Clearances of the coupon's sockets, mm, from the marked corner on."""
COUPON_WIDTHS = (0.3, 0.4, 0.5, 0.6, 0.8, 1.0)
"""Widths of the coupon's ribs and slots, mm, in the same order."""


def coupon_solids(workshop: settings.Workshop) -> dict[str, Solid]:
    """Add the coupon to the current Gmsh model: a plate with sockets, ribs and slots, and a pin on a foot."""
    occ = gmsh.model.occ
    pitch, deep = MM_PER_M * workshop.pin + 4.0, MM_PER_M * workshop.pin_length
    root, drop = 0.5 * MM_PER_M * workshop.pin, MM_PER_M * workshop.pin_length * workshop.slope
    plate = (3, occ.addBox(0, 0, 0, pitch * len(COUPON_CLEARANCES), 3.0 * pitch, deep + 2.0))
    top = deep + 2.0
    ribs, tools = list[Solid](), [(3, occ.addBox(-1, -1, -1, 3, 3, top + 2))]  # the corner cut off marks the first one
    for k, (gap, width) in enumerate(zip(COUPON_CLEARANCES, COUPON_WIDTHS, strict=True)):
        x = (k + 0.5) * pitch
        tools.append((3, occ.addCone(x, 0.5 * pitch, top, 0, 0, -deep, root + gap, root + gap - drop)))
        tools.append((3, occ.addBox(x - 0.5 * width, 1.2 * pitch, top - 2.0, width, 0.6 * pitch, 3.0)))
        ribs.append((3, occ.addBox(x - 0.5 * width, 2.2 * pitch, top, width, 0.6 * pitch, 2.0)))
    body = occ.fuse(occ.cut([plate], tools)[0], ribs)[0]
    foot = (3, occ.addBox(0, -2.0 * pitch, 0, pitch, pitch, 2.0))
    pin = (3, occ.addCone(0.5 * pitch, -1.5 * pitch, 2.0, 0, 0, deep, root, root - drop))
    peg = occ.fuse([foot], [pin])[0]
    occ.synchronize()
    return {"coupon": body[0], "coupon pin": peg[0]}


def plate_names(placed: Sequence[PlacedBody]) -> list[str]:
    """Return the names of the plates' files without ending, in their order."""
    count = max(body.plate for body in placed)
    return ["plate"] if count == 1 else [f"plate-{k}" for k in range(1, count + 1)]
