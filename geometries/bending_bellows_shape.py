"""A bending bellows in Gmsh: a quarter turn of its wall on half of its base, with a name for every face."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from geometries.bending_bellows_plan import Arc, crest, fold_size, half_width, length, profile
from geometries.layers import MM, Entity, add_block, bond, face_block, one_solid, set_sizes

if TYPE_CHECKING:
    from geometries.bending_bellows import BendingBellows


def build_bellows(bellows: BendingBellows) -> None:
    """Fill the current Gmsh model (mm) with half the bellows, its roles, its regions and its cell sizes."""
    bond({"solid": [_wall(bellows)], "base": [_base(bellows, 0.0)]}, lambda tag: _role(bellows, tag))
    fold = fold_size(bellows)
    floor, first, last = 0.5 * bellows.base, bellows.root, length(bellows) - bellows.cap
    set_sizes(lambda x, y, z: fold if z > floor and first < x < last else bellows.cell_size)


def build_whole_bellows(bellows: BendingBellows) -> None:
    """Fill the current Gmsh model (mm) with the whole bellows, one solid."""
    import gmsh  # type: ignore[import-untyped]

    one_solid(gmsh.model.occ.fuse([_wall(bellows, whole=True)], [_base(bellows, -half_width(bellows))])[0])
    gmsh.model.occ.synchronize()


def _base(bellows: BendingBellows, side: float) -> Entity:
    half = 0.5 * bellows.base
    return add_block((0.0, side, -half), (length(bellows), half_width(bellows), half))


def _wall(bellows: BendingBellows, whole: bool = False) -> Entity:
    """The wall and the end plates: their section in the mirror plane, turned down to the base on one side or on both."""
    import gmsh

    occ, axis = gmsh.model.occ, 0.5 * MM * bellows.base
    first, last, outside = bellows.root, length(bellows) - bellows.cap, crest(bellows)
    lines = _Outline(bellows)
    lines.to(0.0, 0.0)
    lines.to(0.0, outside)
    lines.to(first, outside)
    lines.along(profile(bellows, True))
    lines.to(last, outside)
    lines.to(length(bellows), outside)
    lines.to(length(bellows), 0.0)
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
    """The same arc, run through from its end to its start."""
    return Arc(arc.centre, arc.radius, arc.crest, arc.end, arc.start)


class _Outline:
    """A closed line in the mirror plane, made of straight pieces and arcs, from x and the distance from the axis in m."""

    def __init__(self, bellows: BendingBellows):
        self.axis, self.near = 0.5 * bellows.base, 1e-9 * bellows.pitch
        self.points: list[tuple[int, float, float]] = []
        self.curves: list[int] = []

    def _point(self, x: float, r: float) -> int:
        import gmsh

        return int(gmsh.model.occ.addPoint(MM * x, 0.0, MM * (self.axis + r)))

    def to(self, x: float, r: float) -> None:
        """A straight piece to a point, unless the line is there already."""
        import gmsh

        if self.points:
            last, lx, lr = self.points[-1]
            if math.hypot(x - lx, r - lr) < self.near:
                return
        self.points.append((self._point(x, r), x, r))
        if len(self.points) > 1:
            self.curves.append(gmsh.model.occ.addLine(last, self.points[-1][0]))

    def along(self, arcs: list[Arc]) -> None:
        """Arcs, with straight pieces between them where they do not meet."""
        import gmsh

        occ = gmsh.model.occ
        for arc in arcs:
            self.to(arc.start, arc.height(arc.start))
            centre = self._point(*arc.centre)
            end = (self._point(arc.end, arc.height(arc.end)), arc.end, arc.height(arc.end))
            self.curves.append(occ.addCircleArc(self.points[-1][0], centre, end[0]))
            occ.remove([(0, centre)])
            self.points.append(end)

    def closed(self) -> list[int]:
        import gmsh

        return [*self.curves, int(gmsh.model.occ.addLine(self.points[-1][0], self.points[0][0]))]


def _role(bellows: BendingBellows, tag: int) -> str:
    """The role of a face: flat ones by the block around them, curved ones by how far from the axis they are."""
    import gmsh

    low, high = face_block(tag)
    near, half = 1e-6, 0.5 * bellows.base
    planes = (("support", 0, 0.0), ("tip", 0, length(bellows)), ("plane0", 1, 0.0), ("bottom", 2, -half))
    for role, axis, place in planes:
        if max(abs(low[axis] - place), abs(high[axis] - place)) < near:
            return role
    if high[2] < half + near:  # the base's side, and its upper face, of which the air's floor reaches the mirror plane
        return "cavity" if low[1] < near else "outer"
    first, last = bellows.root, length(bellows) - bellows.cap
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
