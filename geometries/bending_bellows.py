"""A bellows that bends: half-round folds on a flat base, which pressure draws apart while the base keeps its length.

Seen from the side, x from the clamp to the tip, the mirror plane y = 0 cut open::

    z
    |  ____   _     _     _   ____
    |  |  |  / \\   / \\   / \\  |  |    folds: arcs of one wall
    |  |  |_/   \\_/   \\_/   \\_|  |
    |  |root        air       cap|
    |  |_________________________|    z = base / 2, the axis of the folds
    0--|-------------------------|--- x
       |_________________________|    base

Seen along x, wall and air are half rings and half disks on the base. The bellows bends down, towards its base: the rise of its
tip is negative. The supply hose is not modelled: the cavity is closed.
"""

from __future__ import annotations

import dataclasses
import math
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from geometries.actuator import Bending, HeldTip, MirroredHalf, Pour, Recipe, Vector, part_field, tip_field
from geometries.meshing import MM, Entity, add_block, bond, check_cell_count, face_block, one_solid, set_sizes
from geometries.registry import register_device
from softmodels.common.errors import GeometryError
from softmodels.common.names import lazy_module
from softmodels.common.schema import LONGEST, ROUNDING, choice_field, length_field, shown

gmsh = lazy_module("gmsh")

# ----------------------------------------------------------------------------------------------------------------------
# The wavy wall of a bending bellows: arcs that join smoothly, of the same thickness everywhere, and its volumes.
#
# Along x the middle of the wall goes from a valley to a crest and back: an arc about a centre outside the valley, if the folds
# are deep a straight flank across x, and an arc about a centre inside the crest.


@dataclasses.dataclass(frozen=True)
class Arc:
    """Half a fold's rounding, along x, from the bottom of a valley or up to the top of a crest.

    Attributes:
        centre: Its centre: x, and the radius from the bellows' axis, in m.
        radius: Of the arc in m.
        crest: Whether it bulges outwards.
        start: x of its first point in m.
        end: x of its last point in m.
    """

    centre: tuple[float, float]
    radius: float
    crest: bool
    start: float
    end: float

    def height(self, x: float) -> float:
        """Return the radius from the bellows' axis at x, in m."""
        up = math.sqrt(max(0.0, self.radius**2 - (x - self.centre[0]) ** 2))
        return self.centre[1] + (up if self.crest else -up)

    @property
    def square(self) -> float:
        """Integral along x of the squared distance from the axis, in m3."""
        a, c, sign = self.radius, self.centre[1], 1.0 if self.crest else -1.0

        def until(x: float) -> float:
            t = math.asin(max(-1.0, min(1.0, (x - self.centre[0]) / a)))
            first = c * c * a * math.sin(t)
            second = sign * c * a * a * (t + 0.5 * math.sin(2.0 * t))
            return first + second + a**3 * (math.sin(t) - math.sin(t) ** 3 / 3.0)

        return until(self.end) - until(self.start)


def half_angle(bellows: BendingBellows) -> float:
    """Return the angle in rad that the wall turns between the bottom of a valley and its flank: at most a right one."""
    return min(2.0 * math.atan(2.0 * bellows.depth / bellows.pitch), 0.5 * math.pi)


def fold_radius(bellows: BendingBellows) -> float:
    """Return the radius in m of the middle of the wall in crests and valleys."""
    return bellows.pitch / (4.0 * math.sin(half_angle(bellows)))


def planned_length(bellows: BendingBellows) -> float:
    """From the clamp to the tip, in m."""
    return bellows.root + bellows.folds * bellows.pitch + bellows.cap


def crest(bellows: BendingBellows) -> float:
    """Return the outer radius of the crests and the end plates, in m."""
    return bellows.radius + bellows.depth + bellows.wall


def half_width(bellows: BendingBellows) -> float:
    """From the mirror plane to the side of the base, in m."""
    return crest(bellows) + bellows.rim


def profile(bellows: BendingBellows, outer: bool) -> list[Arc]:
    """Return the arcs of the wall's inner or outer face from the root to the cap, four a fold."""
    rho, turn, half = fold_radius(bellows), half_angle(bellows), 0.5 * bellows.wall
    side = half if outer else -half
    valley, top = bellows.radius + half, bellows.radius + half + bellows.depth  # of the middle
    low, high = rho - side, rho + side
    arcs = []
    for k in range(bellows.folds):
        begin = bellows.root + k * bellows.pitch
        middle, end = begin + 0.5 * bellows.pitch, begin + bellows.pitch
        reach, over = low * math.sin(turn), high * math.sin(turn)
        arcs += [
            Arc((begin, valley + rho), low, False, begin, begin + reach),
            Arc((middle, top - rho), high, True, middle - over, middle),
            Arc((middle, top - rho), high, True, middle, middle + over),
            Arc((end, valley + rho), low, False, end - reach, end),
        ]
    return arcs


def planned_cavity_volume(bellows: BendingBellows) -> float:
    """Return the volume in m3 of the half-round air; flanks across x add nothing."""
    return 0.5 * math.pi * sum(arc.square for arc in profile(bellows, False))


def planned_solid_volume(bellows: BendingBellows) -> float:
    """Return the volume in m3 of the whole solid: base, end plates and wavy wall."""
    outside = sum(arc.square for arc in profile(bellows, True))
    ends = (bellows.root + bellows.cap) * crest(bellows) ** 2
    base = 2.0 * half_width(bellows) * planned_length(bellows) * bellows.base
    return base + 0.5 * math.pi * (outside + ends) - planned_cavity_volume(bellows)


def wall_length(bellows: BendingBellows) -> float:
    """Return the length in m of the middle of the wall of one fold."""
    rho, turn = fold_radius(bellows), half_angle(bellows)
    straight = bellows.depth - 2.0 * rho * (1.0 - math.cos(turn))
    return 4.0 * rho * turn + 2.0 * max(0.0, straight)


def fold_size(bellows: BendingBellows) -> float:
    """Return the size of the cells in the folds in m: an arc has two of them or so."""
    return min(bellows.cell_size, 1.5 * fold_radius(bellows))


def planned_cells(bellows: BendingBellows) -> float:
    """Return the rough number of cells: thin walls have cells by their area, thick parts by their volume."""
    around = 0.5 * math.pi * (bellows.radius + 0.5 * bellows.depth)
    folds = 2.0 * bellows.folds * wall_length(bellows) * around / fold_size(bellows) ** 2
    base = (
        planned_length(bellows)
        * half_width(bellows)
        * max(3.0, 1.2 * bellows.base / bellows.cell_size)
        / bellows.cell_size**2
    )
    return 9.0 * (folds + base) * 2.0 / bellows.copies


# ----------------------------------------------------------------------------------------------------------------------
# Bending bellows with invalid parameters, detected before meshing.


MOST_CELLS = 3_000_000
"""Maximum expected number of cells; larger meshes are mostly typing errors."""

COARSEST = 10.0
"""Largest ratio of the cell size to the thinnest part: flatter cells are poor."""

WALLS = ("wall", "base", "root", "cap", "radius", "depth")
"""Dimensions with a minimum."""


def check_bellows(bellows: BendingBellows) -> None:
    """Check a bellows' parameters against each other.

    Raises:
        GeometryError: The first parameter found impossible, with its value and the limit.
    """
    for name in WALLS:
        if getattr(bellows, name) < bellows.least_wall * (1 - ROUNDING):
            raise GeometryError(
                f"{name} is {_mm(getattr(bellows, name))}, but least_wall requires {_mm(bellows.least_wall)}"
            )
    if planned_length(bellows) > 0.1 * LONGEST:
        raise GeometryError(
            f"pitch is {_mm(bellows.pitch)}; with {bellows.folds} folds the bellows is "
            f"{_mm(planned_length(bellows))} long, and above "
            f"{0.1 * LONGEST:g} m this suggests a wrong unit"
        )
    if crest(bellows) > 2.0 * planned_length(bellows):
        raise GeometryError(
            f"radius is {_mm(bellows.radius)}; with depth {_mm(bellows.depth)} and wall {_mm(bellows.wall)} the crests are at "
            f"{_mm(crest(bellows))}, more than twice the length, {_mm(planned_length(bellows))}"
        )
    _check_folds(bellows)
    _check_base(bellows)
    _check_cells(bellows)


def _mm(value: float) -> str:
    return shown(value, "m")


def _check_folds(bellows: BendingBellows) -> None:
    rounding = fold_radius(bellows) - 0.5 * bellows.wall
    if rounding < 0.5 * bellows.least_wall * (1 - ROUNDING):
        raise GeometryError(
            f"wall is {_mm(bellows.wall)}; with pitch {_mm(bellows.pitch)} and depth {_mm(bellows.depth)} the folds "
            f"have a radius of {_mm(fold_radius(bellows))}, and least_wall {_mm(bellows.least_wall)} of air is "
            f"left inside them only below {_mm(2.0 * fold_radius(bellows) - bellows.least_wall)}"
        )
    if bellows.depth > 3.0 * bellows.pitch:
        raise GeometryError(
            f"depth is {_mm(bellows.depth)}; folds are at most three pitches ({_mm(bellows.pitch)}) deep"
        )


def _check_base(bellows: BendingBellows) -> None:
    for name in ("base", "rim", "root", "cap"):
        if getattr(bellows, name) > planned_length(bellows) - bellows.root - bellows.cap:
            raise GeometryError(
                f"{name} is {_mm(getattr(bellows, name))}; it must be at most the length of the folds, "
                f"{_mm(bellows.folds * bellows.pitch)}"
            )


def _check_cells(bellows: BendingBellows) -> None:
    thinnest = min(("wall", "base", "root", "cap"), key=lambda name: float(getattr(bellows, name)))
    limit = COARSEST * getattr(bellows, thinnest)
    if bellows.cell_size > limit:
        raise GeometryError(
            f"cell_size is {_mm(bellows.cell_size)}; with {thinnest} {_mm(getattr(bellows, thinnest))} it must be at most "
            f"{_mm(limit)}"
        )
    check_cell_count(bellows.cell_size, bellows.expected_cells, MOST_CELLS)


# ----------------------------------------------------------------------------------------------------------------------
# A bending bellows in Gmsh: a quarter turn of its wall on half of its base, with a name for every face.


def build_bellows(bellows: BendingBellows) -> None:
    """Fill the current Gmsh model (mm) with half the bellows, its roles, its regions and its cell sizes."""
    bond({"solid": [_wall(bellows)], "base": [_base(bellows, 0.0)]}, lambda tag: _role(bellows, tag))
    fold = fold_size(bellows)
    floor, first, last = 0.5 * bellows.base, bellows.root, planned_length(bellows) - bellows.cap
    set_sizes(lambda x, y, z: fold if z > floor and first < x < last else bellows.cell_size)


def build_whole_bellows(bellows: BendingBellows) -> None:
    """Fill the current Gmsh model (mm) with the whole bellows, one solid."""
    one_solid(gmsh.model.occ.fuse([_wall(bellows, whole=True)], [_base(bellows, -half_width(bellows))])[0])
    gmsh.model.occ.synchronize()


def _base(bellows: BendingBellows, side: float) -> Entity:
    half = 0.5 * bellows.base
    return add_block((0.0, side, -half), (planned_length(bellows), half_width(bellows), half))


def _wall(bellows: BendingBellows, whole: bool = False) -> Entity:
    """Return the wall and the end plates: their section in the mirror plane, turned down to the base on one side or on both."""
    occ, axis = gmsh.model.occ, 0.5 * MM * bellows.base
    first, last, outside = bellows.root, planned_length(bellows) - bellows.cap, crest(bellows)
    lines = _Outline(bellows)
    lines.to(0.0, 0.0)
    lines.to(0.0, outside)
    lines.to(first, outside)
    lines.along(profile(bellows, True))
    lines.to(last, outside)
    lines.to(planned_length(bellows), outside)
    lines.to(planned_length(bellows), 0.0)
    lines.to(last, 0.0)
    lines.along([_turned(arc) for arc in reversed(profile(bellows, False))])
    lines.to(first, 0.0)
    section = [(2, occ.addPlaneSurface([occ.addCurveLoop(lines.closed())]))]
    angle = -0.5 * math.pi
    if whole:
        occ.rotate(section, 0, 0, axis, 1, 0, 0, -angle)
        angle *= 2.0
    turned = occ.revolve(section, 0, 0, axis, 1, 0, 0, angle)
    return next(entity for entity in turned if entity[0] == 3)


def _turned(arc: Arc) -> Arc:
    """Return the same arc, run through from its end to its start."""
    return Arc(arc.centre, arc.radius, arc.crest, arc.end, arc.start)


class _Outline:
    """A closed line in the mirror plane, made of straight pieces and arcs, from x and the distance from the axis in m."""

    def __init__(self, bellows: BendingBellows):
        self.axis, self.near = 0.5 * bellows.base, 1e-9 * bellows.pitch
        self.points: list[tuple[int, float, float]] = []
        self.curves: list[int] = []

    def _point(self, x: float, r: float) -> int:
        return int(gmsh.model.occ.addPoint(MM * x, 0.0, MM * (self.axis + r)))

    def to(self, x: float, r: float) -> None:
        """A straight piece to a point, unless the line is there already."""
        if self.points:
            last, lx, lr = self.points[-1]
            if math.hypot(x - lx, r - lr) < self.near:
                return
        self.points.append((self._point(x, r), x, r))
        if len(self.points) > 1:
            self.curves.append(gmsh.model.occ.addLine(last, self.points[-1][0]))

    def along(self, arcs: list[Arc]) -> None:
        """Arcs, with straight pieces between them where they do not meet."""
        occ = gmsh.model.occ
        for arc in arcs:
            self.to(arc.start, arc.height(arc.start))
            centre = self._point(*arc.centre)
            end = (self._point(arc.end, arc.height(arc.end)), arc.end, arc.height(arc.end))
            self.curves.append(occ.addCircleArc(self.points[-1][0], centre, end[0]))
            occ.remove([(0, centre)])
            self.points.append(end)

    def closed(self) -> list[int]:
        return [*self.curves, int(gmsh.model.occ.addLine(self.points[-1][0], self.points[0][0]))]


def _role(bellows: BendingBellows, tag: int) -> str:
    """Return the role of a face: flat ones by the block around them, curved ones by how far from the axis they are."""
    low, high = face_block(tag)
    near, half = 1e-6, 0.5 * bellows.base
    planes = (("support", 0, 0.0), ("tip", 0, planned_length(bellows)), ("plane0", 1, 0.0), ("bottom", 2, -half))
    for role, axis, place in planes:
        if max(abs(low[axis] - place), abs(high[axis] - place)) < near:
            return role
    if high[2] < half + near:  # the base's side, and its upper face, of which the air's floor reaches the mirror plane
        return "cavity" if low[1] < near else "outer"
    first, last = bellows.root, planned_length(bellows) - bellows.cap
    if high[0] < first + near or low[0] > last - near:  # an end plate: its rim, or what it turns to the folds
        floor = high[0] - low[0] < near and high[2] - half < bellows.radius + near
        return "cavity" if floor else "outer"
    inner = profile(bellows, False)
    if high[0] - low[0] < near:  # a flank across x, where two arcs of its own side of the wall end
        return "cavity" if min(abs(low[0] - x) for arc in inner for x in (arc.start, arc.end)) < near else "folds"
    middle = np.array(gmsh.model.getParametrizationBounds(2, tag)).mean(axis=0)
    x, y, z = np.array(gmsh.model.getValue(2, tag, middle)) / MM
    r = math.hypot(y, z - half)
    on = any(arc.start - near <= x <= arc.end + near and abs(arc.height(x) - r) < near for arc in inner)
    return "cavity" if on else "folds"


@register_device
@dataclasses.dataclass(frozen=True, kw_only=True)
class BendingBellows(Bending, MirroredHalf, HeldTip):
    """Half-round folds on a flat base that bend towards the base.

    Lengths are in m. The middle of the base is z = 0, the clamp x = 0. Physical groups: volumes "solid" and "base" (the base
    layer); surfaces "cavity", "support" (the root's end, x = 0, clamped), "tip" (the other end), "folds" (the outside of the
    wavy wall), "bottom" (the base's outside), "outer" (the rest of the outside) and, of a half, "plane0" (y = 0).
    """

    folds: int = choice_field(4, tuple(range(1, 31)), "number of folds")
    pitch: float = length_field(0.008, "length of a fold along the bellows")
    radius: float = length_field(0.006, "radius of the air in the valleys")
    depth: float = length_field(0.0035, "how far the crests stand above the valleys")
    wall: float = length_field(0.0015, "thickness of the wavy wall")
    base: float = length_field(0.003, "thickness of the base layer, a region of its own")
    rim: float = length_field(0.0, "how far the base stands out beyond the crests on each side", zero=True)
    root: float = length_field(0.004, "solid between the clamp and the air")
    cap: float = length_field(0.003, "solid between the air and the tip")
    least_wall: float = length_field(0.0003, "thinnest wall, and thinnest air inside a fold", shape=False)
    cell_size: float = length_field(0.003, "edge length of the cells; smaller ones in narrow folds", shape=False)
    part: str = part_field("bellows")
    tip: str = tip_field()

    stem: ClassVar = "bending-bellows"
    pressures: ClassVar = "0:25"
    silicone: ClassVar = "ecoflex-00-30"
    faces: ClassVar = ("folds", "bottom", "tip", "outer")
    unbonded: ClassVar = ()
    regions: ClassVar = ("base",)
    meeting: ClassVar = ("folds",)
    stiffer: ClassVar = "a thicker wall (--wall), a smaller radius (--radius)"
    examples: ClassVar = ("--folds 6 --depth 4mm", "--radius 8mm --wall 2mm --rim 2mm", "--part full")
    mesh_order: ClassVar = 2

    def check(self) -> None:
        check_bellows(self)

    @property
    def expected_cells(self) -> float:
        return planned_cells(self)

    @property
    def size(self) -> float:
        return self.radius

    @property
    def length(self) -> float:
        """Length from the clamp to the tip in m."""
        return planned_length(self)

    @property
    def probes(self) -> dict[str, Vector]:
        low, high = -0.5 * self.base, 0.5 * self.base + crest(self)
        return {"tip": (self.length, 0.0, low), "tip_above": (self.length, 0.0, high)}

    @property
    def cavity_volume(self) -> float:
        return planned_cavity_volume(self)

    @property
    def solid_volume(self) -> float:
        return planned_solid_volume(self)

    def on_profile(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Report which points lie on the base's lower line in the mirror plane, from the clamp to the tip."""
        points, near = np.asarray(points, dtype=float), 1e-9 * self.length
        return (np.abs(points[:, 2] + 0.5 * self.base) < near) & (np.abs(points[:, 1]) < near)

    @property
    def recipe(self) -> Recipe:
        half, middle = 0.5 * self.base, 0.5 * (self.base + self.radius)
        folds = Pour(name="folds", up=(0.0, 0.0, 1.0), level=half)
        base = Pour(name="base", up=(0.0, 0.0, -1.0), level=-half, end=half, lid=False)
        return Recipe(
            pours=(folds, base),
            why="Wall and air are half round and widest at the base, which is a flat layer bonded to them.",
            inlets=(((0.0, 0.0, middle), (self.root, 0.0, middle)),),
        )

    def build_whole(self) -> None:

        build_whole_bellows(self)

    def build(self) -> None:

        build_bellows(self)
