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

from geometries import actuator, meshing, registry
from geometries.actuator import Vector
from softmodels.common import schema
from softmodels.common.lazy import gmsh


@registry.register_device
@dataclasses.dataclass(frozen=True, kw_only=True)
class BendingBellows(actuator.Finger):
    """Half-round folds on a flat base that bend towards the base.

    Lengths are in m. The middle of the base is z = 0, the clamp x = 0. Physical groups: volumes "solid" and "base" (the base
    layer); surfaces "cavity", "support" (the root's end, x = 0, clamped), "tip" (the other end), "folds" (the outside of the
    wavy wall), "bottom" (the base's outside), "outer" (the rest of the outside) and, of a half, "plane0" (y = 0).
    """

    folds: int = schema.choice_field(4, tuple(range(1, 31)), "number of folds")
    pitch: float = schema.length_field(0.008, "length of a fold along the bellows")
    radius: float = schema.length_field(0.006, "radius of the air in the valleys")
    depth: float = schema.length_field(0.0035, "how far the crests stand above the valleys")
    wall: float = schema.length_field(0.0015, "thickness of the wavy wall")
    base: float = schema.length_field(0.003, "thickness of the base layer, a region of its own")
    rim: float = schema.length_field(0.0, "how far the base stands out beyond the crests on each side", zero=True)
    root: float = schema.length_field(0.004, "solid between the clamp and the air")
    cap: float = schema.length_field(0.003, "solid between the air and the tip")
    least_wall: float = schema.length_field(0.0003, "thinnest wall, and thinnest air inside a fold", shape=False)
    cell_size: float = schema.length_field(0.003, "edge length of the cells; smaller ones in narrow folds", shape=False)
    part: str = actuator.part_field("bellows")
    tip: str = actuator.tip_field()

    stem: ClassVar = "bending-bellows"
    pressures: ClassVar = "0:25"
    silicone: ClassVar = "ecoflex-00-30"
    faces: ClassVar = ("folds", "bottom", "tip", "outer")
    unbonded: ClassVar = ()
    regions: ClassVar = ("base",)
    meeting: ClassVar = ("folds",)
    stiffer: ClassVar = "a thicker wall (--wall), a smaller radius (--radius)"
    examples: ClassVar = ("--folds 6 --depth 4mm", "--radius 8mm --wall 2mm --rim 2mm", "--part full")

    def check(self) -> None:
        self.check_walls(("wall", "base", "root", "cap", "radius", "depth"), "pitch", "folds")
        if self.crest > 2.0 * self.length:
            self.reject(
                "radius",
                f"with {self.given('depth', 'wall')} the crests are at {_mm(self.crest)}, more than twice "
                f"{self.told('length')}",
            )
        if self.fold_radius - 0.5 * self.wall < 0.5 * self.least_wall * (1 - schema.BOUND_TOLERANCE):
            self.reject(
                "wall",
                f"with {self.given('pitch', 'depth')} the folds have a radius of {_mm(self.fold_radius)}, and "
                f"{self.given('least_wall')} of air is left inside them only below "
                f"{_mm(2.0 * self.fold_radius - self.least_wall)}",
            )
        self.check_most("depth", 3.0, "pitch", "folds are at most three pitches deep: {}")
        self.check_most("base rim root cap", 1.0, "length_of_the_folds")
        self.check_cells(("wall", "base", "root", "cap"))

    @property
    def half_angle(self) -> float:
        """Angle in rad that the wall turns between the bottom of a valley and its flank: at most a right one."""
        return min(2.0 * math.atan(2.0 * self.depth / self.pitch), 0.5 * math.pi)

    @property
    def fold_radius(self) -> float:
        """Radius in m of the middle of the wall in crests and valleys."""
        return self.pitch / (4.0 * math.sin(self.half_angle))

    @property
    def length_of_the_folds(self) -> float:
        """Length of the folds in m."""
        return self.length - self.root - self.cap

    @property
    def crest(self) -> float:
        """Outer radius of the crests and the end plates in m."""
        return self.radius + self.depth + self.wall

    @property
    def half_width(self) -> float:
        """From the mirror plane to the side of the base in m."""
        return self.crest + self.rim

    def arcs(self, outer: bool) -> list[Arc]:
        """Return the arcs of the wall's inner or outer face from the root to the cap, four a fold."""
        rho, turn, half = self.fold_radius, self.half_angle, 0.5 * self.wall
        side = half if outer else -half
        valley, top = self.radius + half, self.radius + half + self.depth  # of the middle
        low, high = rho - side, rho + side
        arcs = []
        for k in range(self.folds):
            begin = self.root + k * self.pitch
            middle, end = begin + 0.5 * self.pitch, begin + self.pitch
            reach, over = low * math.sin(turn), high * math.sin(turn)
            arcs += [
                Arc((begin, valley + rho), low, False, begin, begin + reach),
                Arc((middle, top - rho), high, True, middle - over, middle),
                Arc((middle, top - rho), high, True, middle, middle + over),
                Arc((end, valley + rho), low, False, end - reach, end),
            ]
        return arcs

    @property
    def fold_size(self) -> float:
        """Size of the cells in the folds in m: an arc has two of them or so."""
        return min(self.cell_size, 1.5 * self.fold_radius)

    @property
    def expected_cells(self) -> float:
        """Rough number of cells: thin walls have cells by their area, thick parts by their volume."""
        rho, turn = self.fold_radius, self.half_angle
        straight = self.depth - 2.0 * rho * (1.0 - math.cos(turn))
        wall = 4.0 * rho * turn + 2.0 * max(0.0, straight)  # length of the middle of one fold's wall
        around = 0.5 * math.pi * (self.radius + 0.5 * self.depth)
        folds = 2.0 * self.folds * wall * around / self.fold_size**2
        through = max(3.0, 1.2 * self.base / self.cell_size)
        base = self.length * self.half_width * through / self.cell_size**2
        return 9.0 * (folds + base) * 2.0 / self.copies

    @property
    def size(self) -> float:
        return self.radius

    @property
    def length(self) -> float:
        """Length from the clamp to the tip in m."""
        return self.root + self.folds * self.pitch + self.cap

    @property
    def probes(self) -> dict[str, Vector]:
        low, high = -0.5 * self.base, 0.5 * self.base + self.crest
        return {"tip": (self.length, 0.0, low), "tip_above": (self.length, 0.0, high)}

    @property
    def cavity_volume(self) -> float:
        return 0.5 * math.pi * sum(arc.square for arc in self.arcs(False))  # flanks across x add nothing

    @property
    def solid_volume(self) -> float:
        ends = (self.root + self.cap) * self.crest**2
        base = 2.0 * self.half_width * self.length * self.base
        return base + 0.5 * math.pi * (sum(arc.square for arc in self.arcs(True)) + ends) - self.cavity_volume

    @property
    def recipe(self) -> actuator.Recipe:
        half, middle = 0.5 * self.base, 0.5 * (self.base + self.radius)
        folds = actuator.Pour(name="folds", up=(0.0, 0.0, 1.0), level=half)
        base = actuator.Pour(name="base", up=(0.0, 0.0, -1.0), level=-half, end=half, lid=False)
        return actuator.Recipe(
            pours=(folds, base),
            why="Wall and air are half round and widest at the base, which is a flat layer bonded to them.",
            inlets=(((0.0, 0.0, middle), (self.root, 0.0, middle)),),
        )

    def build_whole(self) -> None:
        meshing.one_solid(gmsh.model.occ.fuse([_wall(self, whole=True)], [_base(self, -self.half_width)])[0])
        gmsh.model.occ.synchronize()

    def build(self) -> None:
        """Fill the current Gmsh model (mm) with half the bellows, its roles, its regions and its cell sizes."""
        meshing.bond({"solid": [_wall(self)], "base": [_base(self, 0.0)]}, lambda tag: _role(self, tag))
        fold = self.fold_size
        floor, first, last = 0.5 * self.base, self.root, self.length - self.cap
        meshing.set_sizes(lambda x, y, z: fold if z > floor and first < x < last else self.cell_size)


def _mm(value: float) -> str:
    return schema.shown(value, "m")


# ----------------------------------------------------------------------------------------------------------------------
# The wavy wall of a bending bellows: arcs that join smoothly, of the same thickness everywhere, and its volumes.
#
# Along x the middle of the wall goes from a valley to a crest and back: an arc about a centre outside the valley, if the folds
# are deep a straight flank across x, and an arc about a centre inside the crest.


@dataclasses.dataclass(frozen=True)
class Arc:
    """Half a fold's rounding, along x, from the bottom of a valley or up to the top of a crest, which bulges outwards: its
    centre (x, and the radius from the bellows' axis), radius, and the x of its first and last points, in m."""

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


# ----------------------------------------------------------------------------------------------------------------------
# A bending bellows in Gmsh: a quarter turn of its wall on half of its base, with a name for every face.


def _base(bellows: BendingBellows, side: float) -> meshing.Entity:
    half = 0.5 * bellows.base
    return meshing.add_block((0.0, side, -half), (bellows.length, bellows.half_width, half))


def _wall(bellows: BendingBellows, whole: bool = False) -> meshing.Entity:
    """Return the wall and the end plates: their section in the mirror plane, turned down to the base on one side or on both."""
    occ, axis = gmsh.model.occ, 0.5 * meshing.MM_PER_M * bellows.base
    first, last, outside = bellows.root, bellows.length - bellows.cap, bellows.crest
    lines = _Outline(bellows)
    lines.to(0.0, 0.0)
    lines.to(0.0, outside)
    lines.to(first, outside)
    lines.along(bellows.arcs(True))
    lines.to(last, outside)
    lines.to(bellows.length, outside)
    lines.to(bellows.length, 0.0)
    lines.to(last, 0.0)
    lines.along([dataclasses.replace(arc, start=arc.end, end=arc.start) for arc in reversed(bellows.arcs(False))])
    lines.to(first, 0.0)
    section = [(2, occ.addPlaneSurface([occ.addCurveLoop(lines.closed())]))]
    angle = -0.5 * math.pi
    if whole:
        occ.rotate(section, 0, 0, axis, 1, 0, 0, -angle)
        angle *= 2.0
    turned = occ.revolve(section, 0, 0, axis, 1, 0, 0, angle)
    return next(entity for entity in turned if entity[0] == 3)


class _Outline:
    """A closed line in the mirror plane, made of straight pieces and arcs, from x and the distance from the axis in m."""

    def __init__(self, bellows: BendingBellows):
        self.axis, self.near = 0.5 * bellows.base, 1e-9 * bellows.pitch
        self.points: list[tuple[int, float, float]] = []
        self.curves: list[int] = []

    def _point(self, x: float, r: float) -> int:
        return int(gmsh.model.occ.addPoint(meshing.MM_PER_M * x, 0.0, meshing.MM_PER_M * (self.axis + r)))

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
    low, high = meshing.face_block(tag)
    near, half = 1e-6, 0.5 * bellows.base
    planes = (("support", 0, 0.0), ("tip", 0, bellows.length), ("plane0", 1, 0.0), ("bottom", 2, -half))
    for role, axis, place in planes:
        if max(abs(low[axis] - place), abs(high[axis] - place)) < near:
            return role
    if high[2] < half + near:  # the base's side, and its upper face, of which the air's floor reaches the mirror plane
        return "cavity" if low[1] < near else "outer"
    first, last = bellows.root, bellows.length - bellows.cap
    if high[0] < first + near or low[0] > last - near:  # an end plate: its rim, or what it turns to the folds
        floor = high[0] - low[0] < near and high[2] - half < bellows.radius + near
        return "cavity" if floor else "outer"
    inner = bellows.arcs(False)
    if high[0] - low[0] < near:  # a flank across x, where two arcs of its own side of the wall end
        return "cavity" if min(abs(low[0] - x) for arc in inner for x in (arc.start, arc.end)) < near else "folds"
    middle = np.array(gmsh.model.getParametrizationBounds(2, tag)).mean(axis=0)
    x, y, z = np.array(gmsh.model.getValue(2, tag, middle)) / meshing.MM_PER_M
    r = math.hypot(y, z - half)
    on = any(arc.start - near <= x <= arc.end + near and abs(arc.height(x) - r) < near for arc in inner)
    return "cavity" if on else "folds"
