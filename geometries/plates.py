"""Plates with a network of round channels: their walls from the network's signed distance, in Gmsh a prism around these, and
where their boundary lies on another plate.

A plate lies between z = -thickness/2 and thickness/2. Its device says what is drawn in the plane (x, y): an outline and
channels.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from abc import abstractmethod
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from geometries import actuator, mesh_arrays, meshing, network, revolved, slices
from geometries.actuator import Vector
from geometries.network import Network, Place
from softmodels.common.arrays import Array
from softmodels.common.errors import GeometryError
from softmodels.common.lazy import gmsh, scipy


class NetworkPlate(actuator.Actuator):
    """A plate of an outline with a network of channels in it; a device is a dataclass of it with these fields, in m.

    Physical groups: volume "solid"; surfaces "cavity", "cavity2", ... (the walls of the channels), "top", "bottom", what
    `side_roles` says of the sides, and the cut planes "plane0" and "plane1" of a half or a wedge.
    """

    thickness: float
    fillet: float
    least_wall: float
    cell_size: float
    around: float

    alike: ClassVar[tuple[str, ...]]
    """Parameters that a mesh cannot follow."""
    rounded: ClassVar[tuple[str, ...]] = ("fillet",)
    """Radii of roundings, which are both 0 or both above."""

    @property
    @abstractmethod
    def drawn(self) -> Network:
        """The network, with the outline of the plate."""

    @property
    @abstractmethod
    def normals(self) -> tuple[Vector, ...]:
        """Outward unit normals of the slice that is meshed: of a half or a wedge, and (0, 0, -1) of what lies above the middle;
        none of the whole plate."""

    @abstractmethod
    def side_roles(self, corners: Sequence[Place]) -> list[str]:
        """Return the roles of the plate's sides from each corner of a closed path of the outline to the next."""

    def flat_role(self, name: str) -> str:
        """Return the role of the face "top" or "bottom"."""
        return name

    def vertices(self) -> set[Place]:
        """Return places on the outline that have to be vertices of the mesh."""
        return {(x, y) for x, y, _ in self.probes.values()}

    def anchors(self, ends: Sequence[Place]) -> Mapping[str, Place]:
        """Return points of the lower face that hold the plate, by name; the outline meets cut planes at ``ends``."""
        return {}

    def check_around(self) -> None:
        """Reject numbers of cells around a channel with which its walls are lost, or too many."""
        if not 6.0 <= self.around <= 40.0:
            self.reject("around", "it must be from 6 to 40")

    @property
    def paths(self) -> tuple[tuple[Place, ...], ...]:
        """Closed paths of the outline in m, holes behind it."""
        return self.drawn.outline

    @property
    def box(self) -> tuple[Array, Array]:
        """Lowest and highest corner of the outline in m."""
        return np.min(self.paths[0], axis=0), np.max(self.paths[0], axis=0)

    @property
    def images(self) -> int:
        """Number of slices as `build` meshes them in the plate."""
        return len(actuator.reflected(self.normals))

    @property
    def expected_cells(self) -> float:
        area, volume = 0.0, outline_area(self.paths) * self.thickness
        for each in self.drawn.channels:
            for (a, p), (b, q) in itertools.pairwise(zip(each.points, each.radii, strict=True)):
                area += math.pi * (p + q) * math.dist(a, b)
        edge = min(self.edges.values())
        return 10.0 * area / edge**2 + volume / self.cell_size**3 / revolved.TETRAHEDRON_VOLUME

    @property
    def edges(self) -> dict[str, float]:
        """Length in m of the cells' edges on the walls of each cavity, by its name."""
        least: dict[str, float] = {}
        for each in self.drawn.channels:
            least[each.cavity] = min(least.get(each.cavity, math.inf), *each.radii)
        return {name: math.tau * radius / self.around for name, radius in least.items()}

    @property
    def size(self) -> float:
        return self.thickness

    @property
    def cavity_volume(self) -> float:
        """Sum of the cavities in m3, each times its pressure ratio, within the walls of the mesh."""
        volumes = (volume(*air) for air in self.air.values())
        return self.images * sum(ratio * air for ratio, air in zip(self.ratios, volumes, strict=True))

    @property
    def solid_volume(self) -> float:
        return outline_area(self.paths) * self.thickness - self.images * sum(volume(*air) for air in self.air.values())

    @property
    def air(self) -> dict[str, tuple[Array, mesh_arrays.Ints]]:
        """Curved walls of each cavity in the slice by its role: nodes in m, and triangles of six turned out of the air."""
        return _air(self, self.digest())

    def carried(self, other: Self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        return carried(self, other, np.asarray(points, dtype=float))

    def build_whole(self) -> None:
        """Fill the current Gmsh model (mm) with the plate as the CAD kernel draws it, without roundings where channels meet."""
        whole_plate(self)

    def build(self) -> None:
        """Fill the current Gmsh model (mm) with the plate, its roles and its cell sizes."""
        build_plate(self)

    def curve(self) -> None:
        """Move the nodes inside the edges on the channels' walls onto them, and back those that spoil cells in creases."""
        if self.mesh_order == 1:
            return
        groups = {gmsh.model.getPhysicalName(*group): group for group in gmsh.model.getPhysicalGroups(2)}
        planes = [gmsh.model.mesh.getNodesForPhysicalGroup(*groups[name])[0] for name in slice_roles(self.normals)]
        normals = np.array(self.normals).reshape(-1, 3)
        curved = []
        for name, role in zip(self.drawn.cavities, actuator.cavity_roles(self), strict=True):
            tags, places = gmsh.model.mesh.getNodesForPhysicalGroup(*groups[role])
            distance = network.Distance(self.drawn.channels_of(name), self.fillet)
            on = np.array([np.isin(tags, own) for own in planes], dtype=bool).reshape(-1, len(tags)).T
            moved = slices.projected(distance, places.reshape(-1, 3) / meshing.MM_PER_M, normals, on) * meshing.MM_PER_M
            curved += list(zip(tags.tolist(), moved, strict=True))
        _set_nodes(curved)
        try:
            gmsh.model.mesh.optimize("HighOrderElastic")
        except Exception:  # bare: its solver gave up, and has put walls back on straight edges
            _set_nodes(curved)
        meshing.straighten(3, EASED_SHARES)


def _set_nodes(places: Sequence[tuple[int, Array]]) -> None:
    """Move nodes of the mesh in the current Gmsh model to places in mm."""
    for tag, place in places:
        gmsh.model.mesh.setNode(tag, place, [])


CELL_SIZE_GROWTH = 0.5
EASED_SHARES = (0.75, 0.5, 0.25)
"""How much of the way to the wall is left to edges that spoil cells, in the order tried."""
MIDDLE = "middle"
"""Role of the cut plane z = 0."""


def slice_roles(normals: Sequence[Vector]) -> list[str]:
    """Return the roles of the planes that bound a slice."""
    return [MIDDLE if z else f"plane{k}" for k, (_, _, z) in enumerate(normals)]


def outline_area(paths: tuple[tuple[Place, ...], ...]) -> float:
    """Return the area in m2 within an outline and outside of its holes."""
    first, *holes = (abs(network.signed_area(path)) for path in paths)
    return first - sum(holes)


def on_side(path: tuple[Place, ...], place: Array) -> bool:
    """Return whether a place lies on a piece of a closed path."""
    for a, b in itertools.pairwise((*path, path[0])):
        if abs(math.dist(a, place) + math.dist(place, b) - math.dist(a, b)) < 1e-9 * math.dist(a, b):
            return True
    return False


@functools.lru_cache(maxsize=8)
def _air(plate: NetworkPlate, digest: str) -> dict[str, tuple[Array, mesh_arrays.Ints]]:
    walls, normals = {}, np.array(plate.normals).reshape(-1, 3)
    finer = plate.replaced(finer=1.0) if plate.finer != 1.0 else plate
    for (name, edge), role in zip(finer.edges.items(), actuator.cavity_roles(plate), strict=True):
        own = plate.drawn.channels_of(name)
        corners, triangles = slices.air_surface(own, plate.fillet, edge / plate.finer, normals)
        ends = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        edges, number, count = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
        on = slices.on_mirrors(corners, normals, slices.ON_MIRROR * edge)[edges].all(axis=1) & (count == 1)[:, None]
        middles = corners[edges].mean(axis=1)
        if plate.mesh_order > 1:
            middles = slices.projected(network.Distance(own, plate.fillet), middles, normals, on)
        walls[role] = np.concatenate([corners, middles]), np.hstack([triangles, len(corners) + number.reshape(-1, 3)])
    return walls


def volume(nodes: Array, triangles: mesh_arrays.Ints) -> float:
    """Return the volume in m3 within closed walls of triangles of six nodes."""
    x, a, b = (np.einsum("qn,kni->kqi", table, nodes[triangles]) for table in mesh_arrays.triangle_tables(6))
    return float(np.einsum("q,kqi,kqi->", mesh_arrays.WEIGHTS, x, np.cross(a, b)) / 6.0)


# ----------------------------------------------------------------------------------------------------------------------
# Where a plate's boundary lies on another one.


def carried(plate: NetworkPlate, other: NetworkPlate, points: Array) -> Array:
    """Return where points on the boundary of a plate lie on another; see `Actuator.carried`."""
    revolved.check_alike(plate, other, plate.alike, plate.rounded)
    here, there, normals = plate.drawn, other.drawn, np.array(plate.normals).reshape(-1, 3)
    if plate.normals != other.normals:
        raise GeometryError("two plates have other mirrors, so that another part is meshed; give symmetry = none")
    if [(len(c.points), c.cavity) for c in here.channels] != [(len(c.points), c.cavity) for c in there.channels]:
        raise GeometryError("two plates have channels of other lines or cavities; a mesh cannot follow that, make a new one")
    if [len(path) for path in here.outline] != [len(path) for path in there.outline]:
        raise GeometryError("two plates have outlines of other corners; make a new mesh")
    if plate == other:
        return points.copy()
    probes, its_probes = (np.array(list(device.probes.values())) for device in (plate, other))
    moved = _moved(plate, other, np.concatenate([points, probes]))
    moved, off = moved[: len(points)], its_probes - moved[len(points) :]
    for probe, missed, deep in zip(probes, off, network.depths(probes[:, :2], here.outline), strict=True):
        if deep > ON_WALL * plate.thickness:  # within a face, which follows the channels elsewhere
            near = np.linalg.norm(points - probe, axis=1) / min(plate.thickness, deep)
            near[np.abs(points[:, 2] - probe[2]) > ON_WALL * plate.thickness] = 1.0
            moved += np.outer(np.clip(1.0 - near**2, 0.0, None) ** 2, missed)
    for normal, near in zip(normals, slices.on_mirrors(points, normals, 1e-9 * plate.size).T, strict=True):
        moved[near] -= np.outer(moved[near] @ normal, normal)
    return moved


def _moved(plate: NetworkPlate, other: NetworkPlate, points: Array) -> Array:
    """Return where points go by the motion of the outline and of the network: on sides and walls by one of them, on a face and
    a cut plane by both, more by the nearer one."""
    here, there, half = plate.drawn, other.drawn, 0.5 * plate.thickness
    total, by_network, gap = np.zeros(len(points)), np.zeros_like(points), np.full(len(points), np.inf)
    for name in here.cavities:
        mine, its = (network.Distance(each.drawn.channels_of(name), each.fillet) for each in (plate, other))
        away = np.maximum(np.abs(mine.distances(points)), ON_FACE * plate.thickness)
        gap = np.minimum(gap, away)
        total += away**-2
        by_network += away[:, None] ** -2 * mine.carried(its, points)
    by_network /= total[:, None]
    by_outline = np.column_stack(
        [network.moved_with(points[:, :2], here.outline, there.outline), points[:, 2] * (other.thickness / plate.thickness)]
    )
    gap[gap <= ON_WALL * plate.thickness] = 0.0
    deep = np.maximum(network.depths(points[:, :2], here.outline), ON_FACE * plate.thickness)
    under = np.maximum(half - np.abs(points[:, 2]), ON_FACE * plate.thickness)
    shares = [gap / (gap + room) for room in (deep, deep, under)]
    weight = np.stack([share**2 * (3.0 - 2.0 * share) for share in shares], axis=1)
    return (1.0 - weight) * by_network + weight * by_outline


ON_FACE, ON_WALL = 1e-15, 1e-8
"""How near a place is to a face, and to a wall, in the thickness, to lie on it."""


# ----------------------------------------------------------------------------------------------------------------------
# The plate in Gmsh: a prism of its outline, or the slice of it between mirrors, and the channels' walls as triangles that stay.


def build_plate(plate: NetworkPlate) -> None:
    """Fill the current Gmsh model (mm) with a plate or its slice, its roles and its cell sizes."""
    geo, sketch, half = gmsh.model.geo, Sketch(), 0.5 * plate.thickness
    above = (0.0, 0.0, -1.0) in plate.normals
    heights = (0.0 if above else -half, half)
    roles: dict[str, list[int]] = defaultdict(list)
    rims: tuple[list[Line], list[Line]] = ([], [])
    ends: list[Place] = []
    for run, role in (each for path in outline_sides(plate) for each in _runs(path)):
        if not _inside(plate, run):
            continue
        low, high = (sketch.line(*((*place, z) for place in run)) for z in heights)
        first, last = (sketch.line(*((*place, z) for z in heights)) for place in (run[0], run[-1]))
        around = geo.addCurveLoop([low.tag, last.tag, -high.tag, -first.tag])
        roles[role].append(geo.addSurfaceFilling([around]))
        rims[0].append(low)
        rims[1].append(high)
        ends += [run[0], run[-1]]
    walls = {role: [Wall(sketch, *shell) for shell in _shells(*air)] for role, air in plate.air.items()}
    pieces = [wall for shells in walls.values() for wall in shells]
    top_place = max(plate.probes.values(), key=lambda place: place[2])
    for plane, name in zip(np.array(plate.normals).reshape(-1, 3), slice_roles(plate.normals), strict=True):
        lines = [line for wall in pieces for line in wall.rim if line.lies_on(plane)]
        if name == MIDDLE:
            rims[0].extend(lines)
            continue
        for k, line in _cut_lines(sketch, plane, heights, ends, _wall_ends(plate, pieces, plane), top_place):
            lines.append(line)
            if k is not None:
                rims[k].append(line)
        roles[name] += sketch.faces(lines, np.array([-plane[1], plane[0], 0.0]))
    (bottom,), (top,) = (sketch.faces(rim, np.array([1.0, 0.0, 0.0])) for rim in rims)
    for name, tag in ((MIDDLE if above else plate.flat_role("bottom"), bottom), (plate.flat_role("top"), top)):
        roles[name].append(tag)
    named = {name: sketch.point((*place, -half)) for name, place in plate.anchors(ends).items()}
    on_line = sketch.has(top_place)
    gauge = sketch.point(top_place)
    open_pieces = [wall for wall in pieces if wall.rim]
    geo.synchronize()
    if not on_line:
        gmsh.model.mesh.embed(0, [gauge], 2, top)
    _set_sizes(plate)
    gmsh.option.setNumber("Mesh.MeshOnlyEmpty", 1)  # the ends of walls on the cut planes stay as they are
    for line in (line for wall in open_pieces for line in wall.rim):
        gmsh.model.mesh.setTransfiniteCurve(line.tag, 2)
    gmsh.model.mesh.generate(1)
    outside = [tag for tags in roles.values() for tag in tags]
    for role, shells in walls.items():
        roles[role] = [wall.add() for wall in shells]
    outside += [wall.tag for wall in open_pieces]
    loops = [geo.addSurfaceLoop(outside), *(geo.addSurfaceLoop([wall.tag]) for wall in pieces if not wall.rim)]
    solid = geo.addVolume(loops)
    geo.synchronize()
    meshing.name_group(3, [solid], "solid")
    meshing.name_groups(2, roles)
    meshing.name_groups(0, {name: [tag] for name, tag in named.items()})


@dataclasses.dataclass(frozen=True, eq=False)
class Line:
    """A line of the Gmsh model, a spline through more than two places (m): its tag, and the tags of its ends."""

    tag: int
    ends: tuple[int, int]
    places: Array

    def lies_on(self, normal: Array) -> bool:
        """Return whether it lies in a plane through the origin."""
        return bool(np.abs(self.places @ normal).max() < SAME_PLACE)


class Sketch:
    """Points and lines of the current Gmsh model (mm), each once, by their places in m; and the plane faces between lines."""

    def __init__(self) -> None:
        self.points: dict[tuple[int, ...], int] = {}
        self.lines: dict[tuple[int, ...], Line] = {}

    def has(self, place: Sequence[float]) -> bool:
        return self._key(place) in self.points

    def point(self, place: Sequence[float]) -> int:
        if not self.has(place):
            self.points[self._key(place)] = gmsh.model.geo.addPoint(*(meshing.MM_PER_M * np.array(place)))
        return self.points[self._key(place)]

    @staticmethod
    def _key(place: Sequence[float]) -> tuple[int, ...]:
        return tuple(round(value / SAME_PLACE) for value in place)

    def line(self, *places: Sequence[float]) -> Line:
        tags = tuple(self.point(place) for place in places)
        if tags not in self.lines:
            add = gmsh.model.geo.addSpline(tags) if len(tags) > 2 else gmsh.model.geo.addLine(*tags)
            self.lines[tags] = Line(add, (tags[0], tags[-1]), np.array(places))
        return self.lines[tags]

    def faces(self, lines: Sequence[Line], along: Array) -> list[int]:
        """Return the plane faces between closed loops of lines: one whose extent along a direction lies within that of another
        is a hole in it."""
        at: dict[int, list[Line]] = defaultdict(list)
        for line in lines:
            for end in line.ends:
                at[end].append(line)
        left = dict.fromkeys(lines)
        faces: list[tuple[float, float, list[int]]] = []
        loops = []
        while left:
            line = next(iter(left))
            end, tags, extent = line.ends[0], [], []
            while line in left:
                del left[line]
                forward = line.ends[0] == end
                tags.append(line.tag if forward else -line.tag)
                extent += (line.places @ along).tolist()
                end = line.ends[forward]
                line = next((other for other in at[end] if other in left), line)
            loops.append((min(extent), max(extent), gmsh.model.geo.addCurveLoop(tags)))
        for low, high, tag in sorted(loops):
            around = next((holes for start, stop, holes in faces if start < low and high < stop), None)
            if around is None:
                faces.append((low, high, [tag]))
            else:
                around.append(tag)
        return [gmsh.model.geo.addPlaneSurface(tags) for *_, tags in faces]


class Wall:
    """A connected piece of the channels' walls, corners (m) and triangles: the lines where it ends on cut planes, and its
    surface in the Gmsh model."""

    def __init__(self, sketch: Sketch, corners: Array, triangles: mesh_arrays.Ints):
        ends = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        edges, count = np.unique(ends, axis=0, return_counts=True)
        self.corners, self.triangles = corners, triangles
        self.rim = [sketch.line(*corners[edge]) for edge in edges[count == 1]]
        self.points = {int(node): sketch.point(corners[node]) for node in np.unique(edges[count == 1])}

    def add(self) -> int:
        """Return the tag of its surface, added once the ends of its lines have nodes."""
        self.tag: int = gmsh.model.addDiscreteEntity(2, boundary=[line.tag for line in self.rim])
        number = int(gmsh.model.mesh.getMaxNodeTag()) + 1 + np.arange(len(self.corners))
        inner = np.ones(len(number), dtype=bool)
        for node, point in self.points.items():
            number[node], inner[node] = gmsh.model.mesh.getNodes(0, point)[0][0], False
        gmsh.model.mesh.addNodes(2, self.tag, number[inner], (meshing.MM_PER_M * self.corners[inner]).ravel())
        gmsh.model.mesh.addElementsByType(self.tag, 2, [], number[self.triangles].ravel())
        return self.tag


def _shells(nodes: Array, triangles: mesh_arrays.Ints) -> Iterator[tuple[Array, mesh_arrays.Ints]]:
    """Yield corners and triangles of the connected pieces of walls of triangles of six nodes."""
    corners = triangles[:, :3]
    shell = mesh_arrays.shells(corners, len(nodes))
    for number in np.unique(shell):
        used, own = np.unique(corners[shell == number], return_inverse=True)
        yield nodes[used], own.reshape(-1, 3)


def _wall_ends(plate: NetworkPlate, walls: Sequence[Wall], normal: Array) -> Array:
    """Return the places, shape (n, 3), where walls end on the line in which an upright cut plane meets the other one."""
    others = [np.array(each) for each in plate.normals if not np.array_equal(each, normal)]
    rims = np.array([wall.corners[node] for wall in walls for node in wall.points]).reshape(-1, 3)
    if not others:
        return rims[:0]
    return rims[(np.abs(rims @ normal) < SAME_PLACE) & (np.abs(rims @ others[0]) < SAME_PLACE)]


def _cut_lines(
    sketch: Sketch, normal: Array, heights: tuple[float, float], ends: Sequence[Place], walls: Array, gauge: Vector
) -> Iterator[tuple[int | None, Line]]:
    """Yield the lines around an upright cut plane of a plate between two heights, without those of walls; with 0 those below,
    with 1 those on top.

    Args:
        ends: Places where the outline ends on cut planes.
        walls: Places where walls end on another cut plane too, shape (n, 3).
        gauge: A place that a line on top has to pass through, if it lies in the plane.
    """
    along = np.array([-normal[1], normal[0]])

    def order(place: Place) -> float:
        return float(np.dot(place, along))

    own = sorted(dict.fromkeys(place for place in ends if abs(np.dot(place, normal[:2])) < SAME_PLACE), key=order)
    if len(own) % 2:
        own = sorted((*own, (0.0, 0.0)), key=order)
    below = [(x, y) for x, y, z in walls.tolist() if heights[0] == 0.0]
    for a, b in itertools.batched(own, 2):
        stops = sorted((a, b, *(place for place in below if order(a) < order(place) < order(b))), key=order)
        for p, q in itertools.batched(stops, 2):
            yield 0, sketch.line((*p, heights[0]), (*q, heights[0]))
        between = on_side((a, b), np.array(gauge[:2])) and gauge[:2] not in (a, b)
        for p, q in itertools.pairwise((a, gauge[:2], b) if between else (a, b)):
            yield 1, sketch.line((*p, heights[1]), (*q, heights[1]))
        for place in (a, b):
            levels = sorted((*heights, *(walls[:, 2].tolist() if place == (0.0, 0.0) and not below else ())))
            yield from ((None, sketch.line((*place, low), (*place, high))) for low, high in itertools.batched(levels, 2))


SAME_PLACE = 1e-9
"""Places nearer than this (m) are one."""


def _inside(plate: NetworkPlate, run: Sequence[Place]) -> bool:
    """Return whether a piece of the outline lies in the slice that is meshed."""
    k = (len(run) - 1) // 2
    middle = 0.5 * np.add(run[k], run[k + 1])
    return all(float(middle @ normal[:2]) < 0.0 for normal in upright(plate.normals))


def upright(normals: Sequence[Vector]) -> Array:
    """Return the normals of upright planes, shape (n, 3)."""
    table = np.array(normals).reshape(-1, 3)
    return table[table[:, 2] == 0.0]


def whole_plate(plate: NetworkPlate) -> None:
    """Fill the current Gmsh model (mm) with a plate as one solid: a prism without cones and balls."""
    occ, mm, half = gmsh.model.occ, meshing.MM_PER_M, 0.5 * plate.thickness
    loops = []
    for path in plate.paths:
        places = {place: occ.addPoint(mm * place[0], mm * place[1], -mm * half) for place in path}
        lines = [[places[place] for place in run] for run, _ in _runs([(place, False, "") for place in path])]
        loops.append(occ.addCurveLoop([occ.addSpline(line) if len(line) > 2 else occ.addLine(*line) for line in lines]))
    face = occ.addPlaneSurface(loops)
    prism = [entity for entity in occ.extrude([(2, face)], 0, 0, mm * plate.thickness) if entity[0] == 3]
    balls: dict[Vector, float] = {}
    cones = []
    for each in plate.drawn.channels:
        for (a, p), (b, q) in itertools.pairwise(zip(each.points, each.radii, strict=True)):
            place, along = mm * np.array(a), mm * np.subtract(b, a)
            cones.append(
                (3, occ.addCylinder(*place, *along, mm * p) if p == q else occ.addCone(*place, *along, mm * p, mm * q))
            )
        for corner, radius in zip(each.points, each.radii, strict=True):
            balls[corner] = max(balls.get(corner, 0.0), radius)
    parts = cones + [(3, occ.addSphere(*(mm * np.array(corner)), mm * radius)) for corner, radius in balls.items()]
    air = occ.fuse(parts[:1], parts[1:])[0]
    meshing.one_solid(occ.cut(prism, air)[0])
    occ.remove([(2, face)], recursive=True)
    occ.synchronize()


def outline_sides(plate: NetworkPlate) -> list[list[tuple[Place, bool, str]]]:
    """Return the closed paths of the outline, with the gauge's place and those on cut planes among their corners: of each
    corner its place, whether it has to be a vertex of the mesh, and the role of the side behind it."""
    marks = plate.vertices()
    normals = upright(plate.normals)[:, :2]
    near = slices.SYMMETRY_TOLERANCE * float(np.ptp(plate.paths[0], axis=0).max())
    paths = []
    for path in plate.paths:
        corners = []
        for a, b, role in zip(path, (*path[1:], path[0]), plate.side_roles(path), strict=True):
            shares = {0.0: a in marks}
            for mark in marks:
                if a != mark != b and on_side((a, b), np.array(mark)):
                    shares[math.dist(a, mark) / math.dist(a, b)] = True
            for p, q in zip(normals @ a, normals @ b, strict=True):
                if p * q < 0.0 and min(abs(p), abs(q)) > near:
                    shares[float(p / (p - q))] = True
            for share in sorted(shares):
                place = np.array(a) + share * np.subtract(b, a)
                on = np.abs(normals @ place) < near
                for normal in normals[on]:
                    place -= (place @ normal) * normal
                corners.append(((float(place[0]), float(place[1])), shares[share] or bool(on.any()), role))
        paths.append(corners)
    return paths


def _runs(path: Sequence[tuple[Place, bool, str]]) -> list[tuple[list[Place], str]]:
    """Return the smooth pieces of a closed path between its corners, two or more, and the role of each; a path as of
    `outline_sides`."""
    places = np.array([place for place, _, _ in path])
    along = np.roll(places, -1, axis=0) - places
    before = np.roll(along, 1, axis=0)
    turn = np.abs(np.arctan2(before[:, 0] * along[:, 1] - before[:, 1] * along[:, 0], (before * along).sum(axis=1)))
    uneven = np.abs(np.log(np.linalg.norm(along, axis=1) / np.linalg.norm(before, axis=1)))
    sharp = (turn > network.MIN_CORNER_TURN) | (uneven > math.log(MAX_UNEVEN_SIDES))
    breaks = {k for k, (_, vertex, role) in enumerate(path) if sharp[k] or vertex or role != path[k - 1][2]}
    while len(breaks) < 2:
        breaks.add(0 if not breaks else (min(breaks) + len(path) // 2) % len(path))
    ordered = sorted(breaks)
    return [
        ([path[k % len(path)][0] for k in range(start, end + 1)], path[start][2])
        for start, end in itertools.pairwise([*ordered, ordered[0] + len(path)])
    ]


MAX_UNEVEN_SIDES = 3.0
"""Ratio of two sides' lengths up to which a spline passes through both: it swings out where a straight side meets an arc."""


def _set_sizes(plate: NetworkPlate) -> None:
    """Let cells grow away from the channels' walls: sizes on a grid, since Gmsh asks a million times."""
    nodes = [(plate.air[role][0], edge) for role, edge in zip(plate.air, plate.edges.values(), strict=True)]
    low, high = plate.box
    low, high = np.array([*low, -0.5 * plate.thickness]), np.array([*high, 0.5 * plate.thickness])
    step = max(0.7 * min(plate.edges.values()), float(np.cbrt(np.prod(high - low) / 1e6)))
    count = np.ceil((high - low) / step).astype(int) + 1
    grid = np.stack(np.meshgrid(*(low[i] + step * np.arange(count[i]) for i in range(3)), indexing="ij"), axis=-1)
    size = np.full(count, plate.cell_size)
    for places, edge in nodes:
        away, _ = scipy.spatial.cKDTree(places).query(grid.reshape(-1, 3))
        size = np.minimum(size, edge + CELL_SIZE_GROWTH * np.maximum(away.reshape(count) - 0.5 * edge, 0.0))
    (x0, y0, z0), (nx, ny, nz), table = low.tolist(), (count - 1).tolist(), size.tolist()

    def at(x: float, y: float, z: float) -> float:
        i, j, k = round((x - x0) / step), round((y - y0) / step), round((z - z0) / step)
        return float(table[min(max(i, 0), nx)][min(max(j, 0), ny)][min(max(k, 0), nz)])

    meshing.set_sizes(at)
