"""Bodies of revolution: a half section of panels, meshed flat or turned into a wedge around the axis."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from abc import abstractmethod
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from geometries import actuator, meshing
from geometries.actuator import Actuator, CutPlane, Vector
from softmodels.common import schema
from softmodels.common.arrays import Array
from softmodels.common.errors import GeometryError
from softmodels.common.lazy import gmsh


class Revolved(actuator.Wedged):
    """A body of revolution around z; a device is a dataclass of it with the fields below and its `panels`.

    Fields that a device declares: ``cell_size`` (edge length along its walls), ``through`` (`through_field`), ``section``
    (`section_field`) and ``angle`` (`wedge_field`). A wedge lies between the azimuths 0 and ``angle``, with "plane0" and
    "plane1"; a section has the curve "axis".
    """

    cell_size: float
    through: float

    axial: ClassVar = True
    most_cells: ClassVar = 2_000_000

    loose: ClassVar[tuple[str, ...]] = ()
    """Regions that are not cast with the rest."""

    seen: ClassVar[tuple[str, ...]] = ("outer",)
    """Roles of the sides that a camera sees from the side, from the axis at the top outwards."""

    @property
    @abstractmethod
    def panels(self) -> tuple[Panel, ...]:
        """The half section; its dimensions have been checked."""

    @property
    @abstractmethod
    def thinnest(self) -> float:
        """Thickness in m of its thinnest wall, through which a wedge has `rows` cells."""

    @property
    def rows(self) -> int:
        """Number of cells through a wall."""
        return round(self.through)

    @property
    def cell_length(self) -> float:
        """Edge length in m of the cells along its walls: ``cell_size``, shorter where thin walls would make needles of them."""
        return min(self.cell_size, MAX_CELL_ASPECT_RATIO * self.thinnest / max(self.rows, 1))

    @property
    def remarks(self) -> tuple[str, ...]:  # type: ignore[override]
        if self.dimension == 3 or self.cell_length == self.cell_size:
            return ()
        length, wall = schema.shown(self.cell_length, "m"), schema.shown(self.thinnest, "m")
        return (
            f"cells along the wall of {wall} are at most {length} long instead of {schema.shown(self.cell_size, 'm')}: "
            f"{MAX_CELL_ASPECT_RATIO:g} times their width through it",
        )

    def along(self, length: float) -> int:
        """Return the number of cells along a length in m of its walls."""
        return max(1, math.ceil(length / self.cell_length - 1e-9))

    @functools.cached_property
    def sides(self) -> list[Side]:
        """The sides of its outline."""
        return outline(self.panels)

    @functools.cached_property
    def profile(self) -> list[Side]:
        """The sides that a camera sees, from the axis at the top outwards."""
        return chained(side for side in self.sides if side.role in self.seen)

    @functools.cached_property
    def edges(self) -> list[Side]:
        """Its outline between corners, however its cells cut it."""
        probes = [(float(np.hypot(x, y)), float(z)) for x, y, z in self.probes.values()]
        return whole_edges(self.sides, probes)

    def carried(self, other: Self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the points of the boundary at the same share of the same edge of the other's outline; see
        `Actuator.carried`."""
        if type(other) is not type(self) or [edge.role for edge in self.edges] != [edge.role for edge in other.edges]:
            raise GeometryError(
                f"points can only be mapped between devices whose outlines have the same edges; this {type(self).__name__} has "
                f"{len(self.edges)} and the other {type(other).__name__} {len(other.edges)}, or others"
            )
        if self.dimension != other.dimension or (self.dimension == 3 and self.angle != other.angle):
            raise GeometryError("points can only be mapped between devices of the same section and angle")
        return carried_along(self.edges, other.edges, points, self.size)

    @property
    def anchors(self) -> Mapping[str, Place]:
        """Positions of single supported vertices, as (radius, height) in m by role."""
        return {}

    @property
    def cut_planes(self) -> tuple[CutPlane, ...]:
        if self.dimension == 2 or self.copies == 1:
            return ()
        turn = math.radians(self.angle)
        return (CutPlane("plane0", (0.0, -1.0, 0.0)), CutPlane("plane1", (-math.sin(turn), math.cos(turn), 0.0)))

    @property
    def wedge_size(self) -> float:
        """Edge length in m of a wedge's cells."""
        return min(self.cell_size, self.thinnest / self.rows)

    @property
    def sharp_edges(self) -> tuple[Place, ...]:
        """Edges at which cells are `SHARP_EDGE_REFINEMENT` times smaller, because the strain is unbounded there and changes
        the whole device; a section that has some is not meshed in rows."""
        return ()

    def size_at(self, radius: float, height: float) -> float:
        """Return the edge length in m of cells that do not lie in rows."""
        size = self.wedge_size
        near = (math.hypot(radius - r, height - z) for r, z in self.sharp_edges)
        return min([size, *(size / SHARP_EDGE_REFINEMENT + SHARP_EDGE_GROWTH * distance for distance in near)])

    @property
    def expected_cells(self) -> float:
        if self.dimension == 3:
            return self.solid_volume / self.copies / (TETRAHEDRON_VOLUME * self.wedge_size**3)
        return sum(2.0 * panel.sides[0].cells * panel.sides[1].cells for panel in self.panels)

    @property
    def cavity_volume(self) -> float:
        return abs(sum(side.volume for side in self.sides if side.role == "cavity"))

    @property
    def solid_volume(self) -> float:
        return sum(abs(sum(side.volume for side in panel.sides)) for panel in self.panels)

    def on_profile(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        points = np.asarray(points, dtype=float)
        flat = np.column_stack([np.hypot(points[:, 0], points[:, 1]), points[:, 2]])
        near = ZERO_DISTANCE_TOLERANCE * self.size
        here = (np.abs(points[:, 1]) < near) & (points[:, 0] > -near)
        missed = [side.missed(flat) for side in self.profile]
        return here & (np.min(missed, axis=0) < near)

    def along_profile(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        points = np.asarray(points, dtype=float)
        flat = np.column_stack([np.hypot(points[:, 0], points[:, 1]), points[:, 2]])
        missed = np.array([side.missed(flat) for side in self.profile])
        places = np.array([place + side.shares(flat) for place, side in enumerate(self.profile)])
        return np.asarray(np.take_along_axis(places, missed.argmin(axis=0)[None], axis=0)[0])

    def check_cells(self, *radii: str) -> None:
        """Check what every body of revolution has; called at the end of a device's `check`. The radii, where they are not 0,
        limit the cells' size. GeometryError for the first parameter found impossible, with its value and the limit."""
        for name in radii:
            if getattr(self, name):
                self.check_most("cell_size", 1.0, name)
        if not 1 <= self.rows <= MOST_THROUGH or self.through != round(self.through):
            self.reject("through", f"it must be a whole number from 1 to {MOST_THROUGH}")
        self.check_angle()
        self.check_count(f" with {self.rows} cells through {schema.shown(self.thinnest, 'm')}")

    def build_whole(self) -> None:
        build_full_turn(self)

    def build(self) -> None:
        build_section(self) if self.dimension == 2 else build_wedge(self)


def section_field() -> Any:
    """Return a dataclass field: how much of a body of revolution is modelled."""
    return schema.choice_field("axisymmetric", ("axisymmetric", "wedge"), "profile in radius and height, or solid slice")


def wedge_field() -> Any:
    """Return a dataclass field for the wedge's angle."""
    return schema.angle_field(
        30.0, "angle of the wedge; divides 360 deg evenly", unless=("section", "axisymmetric"), shape=False
    )


def through_field(default: float = 2.0, more: str = "") -> Any:
    """Return a dataclass field for the cells through a wall; ``more`` ends its help."""
    return schema.number_field(default, f"how many cells there are through the wall{more}", shape=False)


# ----------------------------------------------------------------------------------------------------------------------
# Half sections of bodies of revolution as panels: patches with four sides, meshed in rows, that meet side by side.
#
# Places are (radius, height) in m. Rows of cells follow a thin wall where free triangles, all as long as they are wide, would
# need a hundred times as many.


Place = tuple[float, float]

CELL_GROWTH_RATIO = 1.3

SHARP_EDGE_REFINEMENT, SHARP_EDGE_GROWTH = 4.0, 0.3
"""How many times smaller cells are at a sharp edge, and growth of their size with the distance from it."""

ZERO_LENGTH_TOLERANCE = 1e-9

GAUSS_POINTS = 24
"""Points of the rule that integrates over a side; arcs of up to half a circle come out to rounding."""


@dataclasses.dataclass(frozen=True)
class Side:
    """A side of a panel: a line, a piece of an ellipse of less than half its turn (a centre, half axes along the radius and
    the height), or a cubic Bezier curve (inner control points, whose radii are equally spaced).

    A point on it is known by how far along it is: a share of the length, of the angle on arcs, of the radius on a curve. The
    point with the same share of the same side of another device is linear in the lengths. ``role`` is empty between two
    panels; ``growth`` the length of a cell over that of the one before it, from start to end.
    """

    start: Place
    end: Place
    cells: int
    role: str = ""
    centre: Place | None = None
    axes: Place = (1.0, 1.0)
    growth: float = 1.0
    inner: tuple[Place, Place] | None = None

    def places(self, shares: Array) -> Array:
        """Return the places (n, 2) at shares (n,) of a line's length or of an arc's angle."""
        start, end = np.array(self.start), np.array(self.end)
        if self.inner is not None:
            t = shares[:, None]
            first, second = np.array(self.inner)
            return (1 - t) ** 3 * start + 3 * (1 - t) ** 2 * t * first + 3 * (1 - t) * t**2 * second + t**3 * end
        if self.centre is None:
            return start + shares[:, None] * (end - start)
        angle = self._angle(self.start) + shares * self.turn
        return np.array(self.centre) + np.array(self.axes) * np.column_stack([np.cos(angle), np.sin(angle)])

    def shares(self, places: Array) -> Array:
        """Return the shares (n,) at which places (n, 2) on it are; those of places beyond an end are 0 or 1."""
        start, end = np.array(self.start), np.array(self.end)
        if self.inner is not None:
            return np.clip((places[:, 0] - start[0]) / (end[0] - start[0]), 0.0, 1.0)
        if self.centre is None:
            along = end - start
            return np.clip((places - start) @ along / (along @ along), 0.0, 1.0)
        x, y = ((places - self.centre) / self.axes).T
        return np.clip(_wrapped_angles(np.arctan2(y, x) - self._angle(self.start)) / self.turn, 0.0, 1.0)

    def missed(self, places: Array) -> Array:
        """Return how far places (n, 2) are from it, in m; exact for those on it."""
        return np.asarray(np.linalg.norm(self.places(self.shares(places)) - places, axis=1))

    @property
    def volume(self) -> float:
        """Pi times the integral of the squared radius over the height: what it adds to the volume inside a closed outline."""
        nodes, weights = np.polynomial.legendre.leggauss(GAUSS_POINTS)
        shares = 0.5 * (nodes + 1.0)
        if self.centre is None:
            slope = np.full(GAUSS_POINTS, self.end[1] - self.start[1])
        else:
            slope = self.axes[1] * np.cos(self._angle(self.start) + shares * self.turn) * self.turn
        return float(0.5 * math.pi * (self.places(shares)[:, 0] ** 2 * slope) @ weights)

    @property
    def control(self) -> tuple[Place, float]:
        """Point at which the tangents of an arc's ends meet, and the weight with which it makes the arc a rational parabola."""
        assert self.centre is not None
        half = 0.5 * self.turn
        middle = self._angle(self.start) + half
        (r, z), (a, c), weight = self.centre, self.axes, math.cos(half)
        return (r + a * math.cos(middle) / weight, z + c * math.sin(middle) / weight), weight

    @property
    def key(self) -> frozenset[Place]:
        """Key by which two equal sides match: no two sides of a section join the same corners."""
        return frozenset((self.start, self.end))

    @property
    def quarters(self) -> list[Side]:
        """It in pieces of a quarter of a turn at most."""
        count = 1 if self.centre is None else math.ceil(abs(self.turn) / (0.5 * math.pi) - 1e-9)
        inner = [(float(r), float(z)) for r, z in self.places(np.arange(1, count) / count)]
        ends = itertools.pairwise([self.start, *inner, self.end])
        return [dataclasses.replace(self, start=start, end=end) for start, end in ends]

    @property
    def reversed(self) -> Side:
        """The same side from its end to its start."""
        return dataclasses.replace(self, start=self.end, end=self.start, growth=1.0 / self.growth)

    def _angle(self, place: Place) -> float:
        assert self.centre is not None
        return math.atan2((place[1] - self.centre[1]) / self.axes[1], (place[0] - self.centre[0]) / self.axes[0])

    @property
    def turn(self) -> float:
        """Angle of an arc in rad, counter-clockwise."""
        return float(_wrapped_angles(np.array(self._angle(self.end) - self._angle(self.start))))


def _wrapped_angles(angles: Array) -> Array:
    return (angles + np.pi) % (2.0 * np.pi) - np.pi


@dataclasses.dataclass(frozen=True)
class Panel:
    """A patch of a half section, of a region such as ``"solid"``: four sides, each beginning where the one before ends;
    opposite ones have as many cells. A face that is not meshed in rows may have any number of sides."""

    region: str
    sides: Sequence[Side]


def rectangle(low: Place, high: Place, cells: tuple[int, int], roles: tuple[str, str, str, str]) -> Panel:
    """Return a panel of the solid between the corners nearest to and farthest from the axis at the bottom, with cells along
    the radius and along the height, and roles of its sides below, outside, above and inside."""
    (left, down), (right, up) = low, high
    corners = (low, (right, down), high, (left, up))
    ends = (*corners[1:], corners[0])
    a, b, c, d = (Side(*side_data) for side_data in zip(corners, ends, (*cells, *cells), roles, strict=True))
    return Panel("solid", (a, b, c, d))


def outline(panels: Iterable[Panel]) -> list[Side]:
    """Return the sides of panels that have a role, each once."""
    return list({side.key: side for panel in panels for side in panel.sides if side.role}.values())


def chained(sides: Iterable[Side]) -> list[Side]:
    """Return the sides that make one line, in its order and direction: from the axis at the top outwards."""
    left = list(sides)
    at = max((place for side in left for place in (side.start, side.end)), key=lambda place: (-place[0], place[1]))
    ordered: list[Side] = []
    while left:
        met = [side for side in left if at in (side.start, side.end)]
        if not met:
            break
        left.remove(met[0])
        ordered.append(met[0] if met[0].start == at else met[0].reversed)
        at = ordered[-1].end
    return ordered


def graded(length: float, first: float, largest: float) -> list[tuple[float, int, float]]:
    """Cut a length into cells that are small at its beginning (at most ``first``) and grow (to ``largest`` at most), in m.
    Return one or two pieces in order: length, cells, and length of a cell over that of the one before it."""
    growing = max(0, math.ceil(math.log(largest / first) / math.log(CELL_GROWTH_RATIO)))
    sums = first * (CELL_GROWTH_RATIO ** np.arange(1, growing + 1) - 1.0) / (CELL_GROWTH_RATIO - 1.0)
    if growing and sums[-1] >= length * (1.0 - ZERO_LENGTH_TOLERANCE):
        return [(length, int(np.searchsorted(sums, length * (1.0 - ZERO_LENGTH_TOLERANCE))) + 1, CELL_GROWTH_RATIO)]
    near = float(sums[-1]) if growing else 0.0
    pieces = [(near, growing, CELL_GROWTH_RATIO)] if growing else []
    return [*pieces, (length - near, max(1, math.ceil((length - near) / largest - ZERO_LENGTH_TOLERANCE)), 1.0)]


# ----------------------------------------------------------------------------------------------------------------------
# The outline of a body of revolution in whole edges: sides of panels that go on in one line or one arc are put together.
#
# How many panels there are depends on the cells; the edges between corners do not, so points of one device are carried to
# another along them.


AXIS = "axis"
SAME_LINE_TOLERANCE = 1e-9
"""Largest sine between two lines that are one, and largest distance of centres and half axes of one arc, in half axes, and of
places that are one, in their coordinates."""
HALF_TURN = math.pi * (1.0 - 1e-6)
"""Arcs are put together up to this angle: a share of half a turn would not tell which way it goes."""


def whole_edges(sides: Iterable[Side], corners: Sequence[Place]) -> list[Side]:
    """Return sides of an outline, in any order and either way round, put together in order and direction: from the axis at
    the top outwards, and back along the axis. At corners edges end even if they go on: points of the device's own."""
    merged, count = list(sides), math.inf
    while len(merged) < count:  # a side may join two that were found apart
        count, left, merged = len(merged), merged, []
        for side in left:
            joined = ((at, _joined_side(other, side, corners)) for at, other in enumerate(merged) if other.role == side.role)
            place, whole = next(((at, whole) for at, whole in joined if whole), (len(merged), side))
            merged[place : place + 1] = [whole]
    return chained(sorted(merged, key=lambda side: side.role == AXIS))


def _joined_side(first: Side, second: Side, corners: Sequence[Place]) -> Side | None:
    """Return the first of two sides with the other put to one of its ends; None if they do not go on in each other."""
    for other in (second, second.reversed):
        if first.end == other.start and not _is_corner(first.end, corners) and _in_one(first, other):
            return dataclasses.replace(first, end=other.end)
        if other.end == first.start and not _is_corner(first.start, corners) and _in_one(other, first):
            return dataclasses.replace(first, start=other.start)
    return None


def _is_corner(place: Place, corners: Sequence[Place]) -> bool:
    """Return whether a place is one of the corners, which may have been computed in another way, to rounding."""
    return any(math.dist(place, corner) <= SAME_LINE_TOLERANCE * max(map(abs, corner)) for corner in corners)


def _in_one(side: Side, two: Side) -> bool:
    """Return whether a side that begins where the other ends goes on along the same line or arc."""
    if side.centre is not None and two.centre is not None:
        apart = np.abs(np.subtract((*side.centre, *side.axes), (*two.centre, *two.axes))).max()
        same = apart < SAME_LINE_TOLERANCE * max(side.axes)
        return bool(same and abs(side.turn + two.turn) < HALF_TURN and side.turn * two.turn > 0.0)
    if side.centre is not None or two.centre is not None:
        return False
    a, b = np.subtract(side.end, side.start), np.subtract(two.end, two.start)
    size = float(np.linalg.norm(a) * np.linalg.norm(b))
    return bool(abs(a[0] * b[1] - a[1] * b[0]) < SAME_LINE_TOLERANCE * size and a @ b > 0.0)


# ----------------------------------------------------------------------------------------------------------------------
# Bodies of revolution in Gmsh: panels meshed in rows, or turned around the axis and meshed freely.


WIDEST_PIECE = 90.0
"""Largest angle in degrees turned at once: the CAD kernel leaves a seam in a full turn."""


class Drawing:
    """The panels of a half section in the current Gmsh model, by vectors of a metre of the radius and of the height. Circles
    are drawn as such if asked for: the kernel knows their turns. Tags are of faces by region, of curves by what a side joins,
    of points by place."""

    def __init__(self, panels: Iterable[Panel], right: Vector, up: Vector, circles: bool = False):
        self.right, self.up, self.circles, self.occ = right, up, circles, gmsh.model.occ
        self.points: dict[Place, int] = {}
        self.curves: dict[frozenset[Place], int] = {}
        self.sides: dict[frozenset[Place], Side] = {}
        self.faces: dict[str, list[int]] = defaultdict(list)
        for panel in panels:
            loop = self.occ.addCurveLoop([self.curve(side) for side in panel.sides])
            self.faces[panel.region].append(self.occ.addPlaneSurface([loop]))

    def corner(self, place: Place) -> int:
        if place not in self.points:
            self.points[place] = self._point(place)
        return self.points[place]

    def _point(self, place: Place) -> int:
        r, z = place
        return int(self.occ.addPoint(*(r * a + z * b for a, b in zip(self.right, self.up, strict=True))))

    def curve(self, side: Side) -> int:
        if side.key not in self.curves:
            self.sides[side.key] = side
            self.curves[side.key] = self._line(side) if side.centre is None else self._arc(side)
        elif side.role:
            self.sides[side.key] = side
        return self.curves[side.key]

    @property
    def roles(self) -> dict[str, list[int]]:
        """Tags of the curves by their roles; those between panels have none."""
        roles: dict[str, list[int]] = defaultdict(list)
        for key, tag in self.curves.items():
            if self.sides[key].role:
                roles[self.sides[key].role].append(tag)
        return roles

    def _line(self, side: Side) -> int:
        if side.inner is None:
            return int(self.occ.addLine(self.corner(side.start), self.corner(side.end)))
        helpers = [self._point(place) for place in side.inner]
        tag = self.occ.addBezier([self.corner(side.start), *helpers, self.corner(side.end)])
        self.occ.remove([(0, helper) for helper in helpers])  # which would stay as lone nodes of the mesh
        return int(tag)

    def _arc(self, side: Side) -> int:
        """Return a piece of an ellipse as what it is, a rational parabola: the kernel's own ellipses ask for their longer
        axis."""
        if self.circles and side.centre is not None and side.axes[0] == side.axes[1]:
            centre = self._point(side.centre)
            arc = self.occ.addCircleArc(self.corner(side.start), centre, self.corner(side.end))
            self.occ.remove([(0, centre)])
            return int(arc)
        middle, weight = side.control
        helper = self._point(middle)
        points = [self.corner(side.start), helper, self.corner(side.end)]
        tag = self.occ.addBSpline(points, degree=2, weights=[1.0, weight, 1.0], knots=[0.0, 1.0], multiplicities=[3, 3])
        self.occ.remove([(0, helper)])
        return int(tag)


def build_section(device: Revolved) -> None:
    """Fill the current Gmsh model with the axisymmetric profile: x is the radius, y the height (m)."""
    drawing = Drawing(device.panels, (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    gmsh.model.occ.synchronize()
    for region, faces in drawing.faces.items():
        meshing.name_group(2, faces, region)
    if device.sharp_edges:
        gmsh.model.mesh.setSizeCallback(lambda dim, tag, x, y, z, other: device.size_at(x, y))
    else:
        _mesh_in_rows(drawing)
    meshing.name_groups(1, drawing.roles)
    for role, place in device.anchors.items():
        meshing.name_group(0, [drawing.points[place]], role)


def _mesh_in_rows(drawing: Drawing) -> None:
    for face in itertools.chain(*drawing.faces.values()):
        gmsh.model.mesh.setTransfiniteSurface(face)
    for key, tag in drawing.curves.items():
        side = drawing.sides[key]
        cells = meshing.divided(side.cells)
        gmsh.model.mesh.setTransfiniteCurve(tag, cells + 1, "Progression", side.growth ** (side.cells / cells))


def build_full_turn(device: Revolved) -> None:
    """Fill the current Gmsh model (mm) with all of the device that is cast, one solid."""
    panels = [panel for panel in device.panels if panel.region not in device.loose]
    shared = Counter(side.key for panel in panels for side in panel.sides)
    sides = {side.key: side for panel in panels for side in panel.sides if shared[side.key] == 1}
    # A side between what is cast and what is not has no role; one on the axis may have another name inside.
    edges = whole_edges([dataclasses.replace(side, role="") for side in sides.values()], ())
    mm, occ = meshing.MM_PER_M, gmsh.model.occ
    drawing = Drawing((), (mm, 0.0, 0.0), (0.0, 0.0, mm), circles=True)
    face = occ.addPlaneSurface([occ.addCurveLoop([drawing.curve(piece) for edge in edges for piece in edge.quarters])])
    turn_fully(face)


def turn_fully(face: int) -> None:
    """Turn a face of the current Gmsh model all around the axis."""
    occ = gmsh.model.occ
    occ.revolve([(2, face)], 0, 0, 0, 0, 0, 1, 2.0 * math.pi)
    occ.remove([(2, face)], recursive=True)
    occ.synchronize()


def build_wedge(device: Revolved) -> None:
    """Fill the current Gmsh model with the slice from the azimuth 0 to the device's angle (m)."""
    occ = gmsh.model.occ
    drawing = Drawing(device.panels, (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    regions = [region for region, faces in drawing.faces.items() for _ in faces]
    faces = [face for tags in drawing.faces.values() for face in tags]
    pieces = math.ceil(device.angle / WIDEST_PIECE - 1e-9)
    turn, solids = math.radians(device.angle / pieces), []
    owners: list[str] = []
    for piece in range(pieces):
        copies = occ.copy([(2, face) for face in faces]) if piece else [(2, face) for face in faces]
        if piece:
            occ.rotate(copies, 0, 0, 0, 0, 0, 1, piece * turn)
        for region, copy in zip(regions, copies, strict=True):
            solids += [entity for entity in occ.revolve([copy], 0, 0, 0, 0, 0, 1, turn) if entity[0] == 3]
            owners.append(region)
    _, parents = occ.fragment(solids, [])
    occ.synchronize()
    volumes: dict[str, list[int]] = defaultdict(list)
    for region, made in zip(owners, parents, strict=True):
        volumes[region] += [tag for dimension, tag in made if dimension == 3]
    meshing.name_groups(3, volumes)
    sides = [side for side in device.sides if side.role != AXIS]
    meshing.name_boundary(lambda tag: surface_role(device, tag, sides))
    for role, (r, z) in device.anchors.items():
        near = np.linalg.norm([meshing.place_of(tag) - (r, 0.0, z) for _, tag in gmsh.model.getEntities(0)], axis=1)
        meshing.name_group(0, [gmsh.model.getEntities(0)[int(near.argmin())][1]], role)
    gmsh.model.mesh.setSizeCallback(lambda dim, tag, x, y, z, other: device.size_at(math.hypot(x, y), z))


def surface_role(device: actuator.Wedged, tag: int, sides: Sequence[Side]) -> str:
    """Return the role of a face: the cut plane in which it lies, or the side of which it is the turn."""
    near = 1e-7 * device.size
    corners = meshing.corners_of(tag)
    centre = np.array(gmsh.model.occ.getCenterOfMass(2, tag))
    for plane, outward in zip(device.cut_planes, (1.0, -1.0), strict=False):
        normal = np.array(plane.normal)
        # Half a device has both planes in one; the slice's planes are distinguished by the side of the axis they lie on.
        along = outward * np.cross(device.lift, normal)
        if np.abs(corners @ normal).max() < near and abs(centre @ normal) < near and centre @ along > 0.0:
            return plane.name
    ends = np.unique(np.round(np.column_stack([np.hypot(corners[:, 0], corners[:, 1]), corners[:, 2]]) / near), axis=0)

    def apart(side: Side) -> float:
        """Return how far the face is from being the side turned: both have the same ends."""
        distances = np.linalg.norm(ends[:, None] * near - np.array([side.start, side.end]), axis=2)
        return float(max(distances.min(axis=0).max(), distances.min(axis=1).max()))

    return min(sides, key=apart).role


# ----------------------------------------------------------------------------------------------------------------------
# Map points on the outline of a body of revolution to the same relative position on another one's.


OUTLINE_TOLERANCE = 0.05
"""Tolerance of a point on the outline, relative to the size, because nodes on chords are slightly inside."""


def carried_along(edges: Sequence[Side], others: Sequence[Side], points: Array, size: float) -> Array:
    """Return where points on the boundary, device coordinates in m, shape (n, 3), lie on another body of revolution (see
    `geometries.Actuator.carried`), turned by no angle around the axis: from one outline in (radius, height), in m, to the
    other, edge by edge. GeometryError if a point is not on the boundary."""
    points = np.array(points, dtype=float).reshape(-1, 3)
    radii = np.hypot(points[:, 0], points[:, 1])
    flat = np.column_stack([radii, points[:, 2]])
    shares = [edge.shares(flat) for edge in edges]
    at = np.stack([edge.places(share) for edge, share in zip(edges, shares, strict=True)])
    missed = np.linalg.norm(at - flat, axis=2)
    nearest = missed.argmin(axis=0)
    _check_near(points, missed.min(axis=0, initial=np.inf), size)
    # What is added is zero for the same device, whatever the rounding; a node beside the outline stays beside it.
    shift = np.zeros_like(flat)
    for k, (edge, share) in enumerate(zip(others, shares, strict=True)):
        here = nearest == k
        shift[here] = edge.places(share[here]) - at[k, here]
    off_axis = radii > 1e-12 * size
    points[off_axis, :2] *= (1.0 + shift[off_axis, 0] / radii[off_axis])[:, None]
    points[:, 2] += shift[:, 1]
    return points


def check_alike(device: Actuator, other: Actuator, choices: Iterable[str], roundings: Iterable[str]) -> None:
    """Reject devices between which points cannot be carried: GeometryError for the first field in which they differ, of
    choices, or of radii of roundings in whether they are 0, with both values."""
    if type(other) is not type(device):
        raise GeometryError(f"points of {type(device).__name__} cannot be carried to {type(other).__name__}")
    for name in choices:
        here, there = getattr(device, name), getattr(other, name)
        if here != there:
            raise GeometryError(f"{name} is {here} and {there}; points can only be mapped between devices of the same")
    for name in roundings:
        here, there = getattr(device, name), getattr(other, name)
        if (here > 0.0) != (there > 0.0):
            raise GeometryError(
                f"{name} is {schema.shown(here, 'm')} and {schema.shown(there, 'm')}; points of a rounded corner cannot be "
                "mapped to a sharp one"
            )


def rounded_off(radius: float, fillet: float) -> float:
    """Return the volume over pi of the solid of revolution between a sharp corner at a radius and the fillet's arc."""
    inner = radius - fillet  # the corner's square less a quarter circle, each turned around the axis
    return fillet * (radius**2 - inner**2 - 0.5 * math.pi * fillet * inner - 2.0 / 3.0 * fillet**2)


def _check_near(points: Array, missed: Array, size: float) -> None:
    if len(points) and missed.max() > OUTLINE_TOLERANCE * size:
        place = ", ".join(f"{1e3 * value:.4g}" for value in points[missed.argmax()])
        raise GeometryError(
            f"the point ({place}) mm is {schema.shown(float(missed.max()), 'm')} off the device's boundary; "
            f"only boundary points can be mapped"
        )


MOST_THROUGH = 20
"""Most cells through a wall: no result needs them."""

MAX_CELL_ASPECT_RATIO = 20.0
"""Largest ratio of a cell's length to its width through the wall."""

TRIANGLE_AREA, TETRAHEDRON_VOLUME = 0.43, 0.12
"""Area and volume of a regular cell with edges of length 1."""

ZERO_DISTANCE_TOLERANCE = 1e-7
