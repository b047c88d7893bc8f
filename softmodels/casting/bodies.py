"""The bodies of a mould in the CAD kernel, in mm: for each piece that is cast a cup and a lid with its core.

Every piece has a frame of its own, in which the lid's plane is level and the piece lies above it.
"""

from __future__ import annotations

import dataclasses
import math
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from geometries import Actuator, actuator, meshing
from geometries.actuator import Vector
from geometries.imported import face_names, named_surfaces
from softmodels.casting import grooves, settings
from softmodels.common import schema
from softmodels.common.arrays import Array
from softmodels.common.errors import GeometryError, MeshingError
from softmodels.common.lazy import gmsh

Solid = tuple[int, int]
"""Dimension, which is 3, and tag."""
MM_PER_M = 1e3
POINT_TOLERANCE = 1e-6
FLUSH_TOLERANCE = 1e-4
"""Distance in mm below which two faces are in one plane: boxes of the CAD kernel are a little larger than what is in them."""
LEAST_SILICONE = 0.5e-3
"""Minimum silicone around a tube, m: thinner walls tear when the tube is pushed in."""
JIG_HEIGHT = 5.0
"""Height of the bonding jig above and below the bond, mm."""
UP, DOWN = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -1.0])
HANDLE_THICKNESS = 3.0
"""Thickness in mm of the head by which an inlet pin is pulled, and by how much its radius is larger than the pin's."""


@dataclasses.dataclass(frozen=True)
class Frame:
    """Where a piece stands: the rotation, shape (3, 3), that brings the device there, and the size of what is cast over the
    device's."""

    turn: Array
    scale: float

    def drawn(self, place: Array) -> Array:
        """Return the place in the original device, in mm, of a place in the mould."""
        return np.asarray(self.turn.T @ np.asarray(place) / self.scale)

    def placed(self, place: Vector) -> Array:
        """Return the place in the mould, in mm, of a place in the device, in m."""
        return np.asarray(MM_PER_M * self.scale * (self.turn @ np.asarray(place)))


@dataclasses.dataclass(frozen=True)
class Hole:
    """An opening of a lid or a cup, lengths in mm: a cone about (x, y), wide outside, so that the sprue tears off at its neck
    at the silicone; or the room of a pin. ``neck`` and ``mouth`` are radii at the silicone and outside, ``heights`` where it
    begins and ends."""

    place: tuple[float, float]
    neck: float
    mouth: float
    heights: tuple[float, float]


@dataclasses.dataclass(frozen=True)
class ToolBody:
    """A body of a mould in the current Gmsh model, and the unit vector along which it leaves; zero if it is dissolved."""

    name: str
    solid: Solid
    pull: Array


@dataclasses.dataclass(frozen=True)
class Tooling:
    """The mould of one piece, in the current Gmsh model.

    Attributes:
        bodies: In the order in which they leave.
        target: Shape to be cast, from the device's geometry.
        cores, cavities: The piece's cavities, and all of the device's if they are closed.
        plugs: Silicone that makes room for the tubes.
        openings: What is cut out of the bodies and not filled by the piece: pour opening, vents, slack of pins.
        level, top: Heights where the piece begins and ends, mm.
        low, high: Corners of the block that all bodies make together, mm; only the head of an inlet pin is outside.
        drafted: Pins and holes along the pull.
        jig: A ring around the lid's plane, in which the piece is bonded to others.
        wound: Threads in grooves around the piece.
        grooved: Volume of their grooves, mm3.
    """

    pour: actuator.Pour
    frame: Frame
    bodies: list[ToolBody]
    target: list[Solid]
    cores: list[Solid]
    cavities: list[Solid]
    plugs: list[Solid]
    openings: list[Solid]
    level: float
    top: float
    low: Array
    high: Array
    drafted: list[Hole]
    jig: Solid
    wound: grooves.Winding | None
    grooved: float

    @property
    def size(self) -> float:
        """Diagonal of the block, mm."""
        return float(np.linalg.norm(self.high - self.low))


def recipe_of(device: Actuator, workshop: settings.Workshop) -> actuator.Recipe:
    """Return how a device is cast, along the workshop's pull if it is an imported part; `MouldError` without a recipe, or for
    a pull that it has no use for."""
    try:
        recipe = device.cast_along(workshop.direction, workshop.level)
    except GeometryError as error:
        raise settings.MouldError(str(error)) from None
    if workshop.core != "as needed":
        lost = workshop.core != "rigid"
        recipe = (lost and recipe.seamless) or recipe
        pours = tuple(dataclasses.replace(pour, lost=lost and pour.lid) for pour in recipe.pours)
        recipe = dataclasses.replace(recipe, pours=pours)
    return recipe


class LostCore(actuator.Castable):
    """A lost core as a thing that is cast itself, from a STEP file of it in mm as it stands in its mould."""

    files: Mapping[str, str] = {}

    def __init__(self, file: Path):
        self.file = file

    def build_whole(self) -> None:
        imported(self.file)
        gmsh.model.occ.synchronize()


def imported(file: Path) -> list[Solid]:
    """Read a STEP file into the current Gmsh model, in mm; return its solids."""
    with meshing.drawn_in("MM"):
        return list(gmsh.model.occ.importShapes(str(file), format="step"))


def rotation_up(up: Vector) -> Array:
    """Return the rotation, shape (3, 3), that rotates a unit vector into z by the smallest angle."""
    axis, cosine = np.cross(up, UP), float(up[2])
    if cosine > 1.0 - 1e-12:
        return np.eye(3)
    if cosine < -1.0 + 1e-12:
        return np.diag([1.0, -1.0, -1.0])
    cross = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    return np.asarray(np.eye(3) + cross + cross @ cross / (1.0 + cosine))


def turned(solids: Sequence[Solid], turn: Array) -> None:
    """Turn solids about the origin."""
    angle = math.acos(max(-1.0, min(1.0, 0.5 * (float(np.trace(turn)) - 1.0))))
    if angle == 0.0:
        return
    skew = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    axis = skew / np.linalg.norm(skew) if np.linalg.norm(skew) > 1e-9 else np.array([1.0, 0.0, 0.0])
    gmsh.model.occ.rotate(list(solids), 0, 0, 0, *axis, angle)


def scaled(factor: float) -> None:
    """Scale all of the current Gmsh model about the origin, keeping planes, cylinders and so on exact.

    Gmsh's own `dilate` makes splines of them; the scale of an import does not.
    """
    if factor == 1.0:
        return
    with tempfile.TemporaryDirectory() as folder:
        file = str(Path(folder) / "whole.brep")
        gmsh.model.occ.synchronize()
        gmsh.write(file)
        gmsh.model.occ.remove(gmsh.model.occ.getEntities(3), recursive=True)
        before = gmsh.option.getNumber("Geometry.OCCScaling")
        gmsh.option.setNumber("Geometry.OCCScaling", factor)
        gmsh.model.occ.importShapes(file, format="brep")
        gmsh.option.setNumber("Geometry.OCCScaling", before)
    gmsh.model.occ.synchronize()


# ----------------------------------------------------------------------------------------------------------------------
# From the device to a piece of it: between two planes, with its cavities and the room for its tubes.


def _box(solid: Solid) -> Array:
    """Return the corners of a solid's box, shape (2, 3)."""
    return np.array(gmsh.model.occ.getBoundingBox(*solid)).reshape(2, 3)


def _block(low: Array, high: Array) -> Solid:
    return (3, int(gmsh.model.occ.addBox(*low, *np.subtract(high, low))))


def _copies_in_box(solids: Sequence[Solid], low: Array, high: Array) -> list[Solid]:
    occ = gmsh.model.occ
    return list(occ.intersect(occ.copy(list(solids)), [_block(low, high)])[0]) if solids else []


def merged(solids: Sequence[Solid], unify: bool = True) -> list[Solid]:
    """Return what solids are together; merging their faces across the joint is optional, takes time, and fails at times."""
    if len(solids) < 2:
        return list(solids)
    gmsh.option.setNumber("Geometry.OCCUnionUnify", float(unify))
    try:
        return list(gmsh.model.occ.fuse(list(solids[:1]), list(solids[1:]))[0])
    except Exception:  # Gmsh raises bare Exception
        if not unify:
            raise
        return merged(solids, unify=False)
    finally:
        gmsh.option.setNumber("Geometry.OCCUnionUnify", 1)


def tooling(device: actuator.Castable, recipe: actuator.Recipe, pour: actuator.Pour, workshop: settings.Workshop) -> Tooling:
    """Fill the current Gmsh model with the mould of one piece of a device; `MouldError` if it cannot be made so."""
    return _Maker(device, recipe, pour, workshop).tooling()


class _Maker:
    """Makes the bodies of one piece's mould, step by step."""

    def __init__(self, device: actuator.Castable, recipe: actuator.Recipe, pour: actuator.Pour, workshop: settings.Workshop):
        self.pour, self.workshop, self.occ = pour, workshop, gmsh.model.occ
        device.build_whole()
        solids = gmsh.model.getEntities(3)
        if len(solids) != 1:
            raise settings.MouldError(f"the whole device consists of {len(solids)} solids; a mould needs a single one")
        self.frame = Frame(rotation_up(pour.up), workshop.scale)
        turned(solids, self.frame.turn)
        scaled(workshop.scale)
        self.occ.synchronize()
        (self.whole,) = self.occ.getEntities(3)
        loops, _ = self.occ.getSurfaceLoops(self.whole[1])
        shells = [(3, self.occ.addVolume([loop])) for loop in loops] if len(loops) > 1 else [self.whole]
        boxes = np.array([_box(shell) for shell in shells])
        outer = int(np.prod(np.ptp(boxes, axis=1), axis=1).argmax())
        self.envelope = shells[outer]
        self.cavities = [shell for k, shell in enumerate(shells) if k != outer]
        self.level, self.top = self._heights(boxes, outer)
        low, high = boxes[outer]
        self.low, self.high = np.array([*low[:2], self.level]), np.array([*high[:2], self.top])
        self.bodies: list[ToolBody] = []
        self.openings: list[Solid] = []
        self.plugs: list[Solid] = []
        self.drafted: list[Hole] = []
        self.inlets = [inlet for ends in recipe.inlets if workshop.tube and (inlet := self._inlet(ends))]
        self.wound = None if pour.wax else grooves.winding(workshop, recipe.wound)
        self.grooved = self._groove(self.wound) if self.wound else 0.0

    def _groove(self, wound: grooves.Winding) -> float:
        """Cut the grooves for threads; return their volume."""
        before = self.occ.getMass(*self.whole)
        tools = grooves.groove_solids(wound, self._split[0], self.workshop.scale)
        self.whole = _single_solid(list(self.occ.cut([self.whole], tools)[0]), "the grooved tube")
        self.occ.synchronize()
        return float(before - self.occ.getMass(*self.whole))

    def _heights(self, boxes: Array, outer: int) -> tuple[float, float]:
        """Return the heights between which the piece lies, mm."""
        pour, metre = self.pour, MM_PER_M * self.workshop.scale
        low, high = boxes[outer, :, 2]
        cavities = np.delete(boxes[:, :, 2], outer, axis=0)
        if pour.level is None and not len(cavities):
            raise settings.MouldError("the part has no closed cavity, so it needs no mould with a core")
        level = 0.5 * float(cavities.min() + cavities.max()) if pour.level is None else metre * pour.level
        top = float(high) if pour.end is None else metre * pour.end
        if not low - FLUSH_TOLERANCE < level < high - FLUSH_TOLERANCE:
            asked = self.workshop.level
            value = schema.shown(level / metre if asked is None else asked, "m")
            low, high = (low, high) if asked is None or level == metre * asked else (-high, -low)
            raise settings.MouldError(
                f"split is {value}; along the pull the part extends from {schema.shown(low / metre, 'm')} to "
                f"{schema.shown(high / metre, 'm')}"
            )
        return level, top

    def tooling(self) -> Tooling:
        """Make it; see `Tooling`."""
        occ, workshop = self.occ, self.workshop
        wall, rim = MM_PER_M * workshop.wall, MM_PER_M * workshop.rim
        far = np.array([1.0, 1.0, 0.0]) * (self.high - self.low).max()
        piece = _single_solid(_copies_in_box([self.whole], self.low - far, self.high + far), f"the piece {self.pour.name!r}")
        cut = [inlet.room for inlet in self.inlets]
        target = list(occ.cut([piece], cut, removeObject=False, removeTool=False)[0]) if cut else occ.copy([piece])
        occ.synchronize()
        box = _box(piece)
        self.low[:2], self.high[:2] = box[0, :2] - rim, box[1, :2] + rim
        around, cores, recesses = self._complement(piece)
        jig = self._ring(around)
        floor = _block(np.array([*self.low[:2], self.top]), self.high + wall * UP)
        cup = merged([around, floor, *recesses, *(inlet.core for inlet in self.inlets if inlet.part == "cup")])
        lid = [_block(self.low - wall * UP, np.array([*self.high[:2], self.level]))] if self.pour.lid else []
        cup, lid = self._pierce(cup, lid, target)
        kept = occ.copy(cores) if cores else []
        fused = [*cores, *(inlet.core for inlet in self.inlets if inlet.part == "lid")]
        if self.pour.lost and cores:
            lid = self._peg(merged(fused), lid)
        elif fused:
            lid = self._carry(lid, fused)
        if self.pour.lid:
            cup, lid = self._join(cup, lid)
            self._add("lid", lid, DOWN)
        self._divide(cup)
        low = self.low - (wall if self.pour.lid else 0.0) * UP
        return Tooling(self.pour, self.frame, self.bodies, target, kept, self.cavities, self.plugs, self.openings,
                       self.level, self.top, low, self.high + wall * UP, self.drafted, jig, self.wound,
                       self.grooved)  # fmt: skip

    def _add(self, kind: str, solids: list[Solid], pull: Array) -> None:
        name = f"{self.pour.name} {kind}"
        self.occ.synchronize()
        self.bodies.append(ToolBody(name, _single_solid(solids, f"the {name}"), np.asarray(pull, dtype=float)))

    def _complement(self, piece: Solid) -> tuple[Solid, list[Solid], list[Solid]]:
        """Return what is between the planes beside a piece: around it, cores on the lid, and what belongs to the cup's
        floor."""
        parts = self.occ.cut([_block(self.low, self.high)], [piece], removeTool=False)[0]
        self.occ.synchronize()
        around, cores, recesses = [], [], []
        for part in parts:
            low, high = _box(part)
            if (low[:2] < self.low[:2] + FLUSH_TOLERANCE).any():
                around.append(part)
            elif low[2] < self.level + FLUSH_TOLERANCE and self.pour.lid:
                cores.append(part)
            elif high[2] > self.top - FLUSH_TOLERANCE:
                recesses.append(part)
            else:
                place = self.frame.drawn(np.array(self.occ.getCenterOfMass(*part))).round(3)
                raise settings.MouldError(
                    f"the cavity around {', '.join(f'{value + 0.0:.4g}' for value in place)} mm is entirely in the "
                    f"{self.pour.name} half and does not reach the parting plane, so its core would float; choose another "
                    f"plane (--split) or direction (--pull)"
                )
        return _single_solid(around, f"the cup of the {self.pour.name}"), cores, recesses

    def _ring(self, around: Solid) -> Solid:
        """Return what is around the piece in the lid's plane, as a ring on both sides of it: a jig for the bond."""
        faces = gmsh.model.getBoundary([around], oriented=False)
        flat = [(2, face) for _, face in faces if _box((2, face))[:, 2].max() < self.level + FLUSH_TOLERANCE]
        half = min(JIG_HEIGHT, 0.5 * (self.top - self.level))
        base = self.occ.copy(flat)
        self.occ.translate(base, 0, 0, -half)
        ring = [solid for solid in self.occ.extrude(base, 0, 0, 2.0 * half) if solid[0] == 3]
        return _single_solid(merged(ring), "the jig")

    def _pierce(self, cup: list[Solid], lid: list[Solid], target: list[Solid]) -> tuple[list[Solid], list[Solid]]:
        """Cut the pour opening and the vents, the bolts' holes and the inlet pins' bores."""
        occ, workshop, pour = self.occ, self.workshop, self.pour
        metre, wall = MM_PER_M * workshop.scale, MM_PER_M * workshop.wall
        tools: list[Solid] = []
        if not pour.squeezed and (pour.lid or pour.gate is not None or pour.wax):
            gate = self.level if pour.gate is None else metre * pour.gate
            vented = gate if pour.vented is None else metre * pour.vented
            line = self._split if pour.sideways is not None else None
            places = hole_places(target, (gate, vented), line, workshop, fewer=pour.wax)
            outside = self.top + wall if pour.gate is not None else self.level - (wall if pour.lid else 0.0)
            for place, start, width in zip(
                places,
                (gate, *[vented] * workshop.vents),
                (workshop.pour, *[workshop.vent] * workshop.vents),
                strict=not pour.wax,
            ):
                if start == outside:  # it is open there
                    continue
                neck = 0.5 * MM_PER_M * width
                mouth = neck + abs(outside - start) * workshop.slope
                heights = (min(start, outside), max(start, outside))
                hole = Hole((float(place[0]), float(place[1])), neck, mouth, heights)
                tools.append(_cone(hole.place, start, outside - start, hole.neck, hole.mouth))
                self.drafted.append(hole)
        if workshop.bolt and (pour.lid or pour.sideways is not None):
            tools += self._bolts()
        for inlet in self.inlets:
            if inlet.bore is not None:
                tools.append(inlet.bore)
                self._add("inlet pin", [inlet.core], inlet.outwards)
        self.openings += tools
        if tools:
            cup = occ.cut(cup, tools, removeTool=False)[0]
            lid = occ.cut(lid, tools, removeTool=False)[0] if lid else []
        return cup, lid

    @property
    def _split(self) -> tuple[int, float]:
        """Axis across the plane in which the cup opens, and the plane's place on it, mm."""
        sideways = self.frame.turn @ np.asarray(self.pour.sideways)
        axis = int(np.abs(sideways).argmax())
        return axis, 0.5 * float(self.low[axis] + self.high[axis])

    def _bolts(self) -> list[Solid]:
        """Return the bolts' shanks: upright in the middle of each rim; of a cup in two halves across both."""
        middle = 0.5 * (self.low + self.high)
        half = 0.5 * MM_PER_M * self.workshop.rim
        radius = 0.5 * MM_PER_M * self.workshop.bolt
        begin = self.low - MM_PER_M * self.workshop.wall * UP
        end = self.high + MM_PER_M * self.workshop.wall * UP
        if self.pour.sideways is not None:
            axis, _ = self._split
            starts = [np.where(np.arange(3) == axis, begin, middle) for _ in range(2)]
            starts[0][1 - axis], starts[1][1 - axis] = begin[1 - axis] + half, end[1 - axis] - half
            along = np.where(np.arange(3) == axis, end - begin, 0.0)
        else:
            (x, y), (X, Y) = begin[:2] + half, end[:2] - half
            starts = [np.array([*at, begin[2]]) for at in ((x, middle[1]), (X, middle[1]), (middle[0], y), (middle[0], Y))]
            starts = [self._clear(start, radius) for start in starts]
            along = (end - begin) * UP
        return [(3, int(self.occ.addCylinder(*start, *along, radius))) for start in starts]

    def _clear(self, start: Array, radius: float) -> Array:
        """Return the place of an upright bolt, moved along its rim if an inlet pin would cross it."""
        for inlet in self.inlets:
            across = np.cross(UP, inlet.outwards)
            off = float((start - inlet.begin) @ across)
            needed = radius + inlet.radius + MM_PER_M * self.workshop.least_wall
            if inlet.bore is not None and abs(off) < needed and (start - inlet.begin) @ inlet.outwards > 0.0:
                start = start + (needed + 1.0 - off) * across
        return start

    def _carry(self, lid: list[Solid], cores: list[Solid]) -> list[Solid]:
        """Put cores on the lid."""
        carrier = merged([*lid, *cores])
        if len(carrier) > 1:
            loose = min(carrier, key=lambda solid: float(self.occ.getMass(*solid)))
            place = self.frame.drawn(np.array(self.occ.getCenterOfMass(*loose))).round(3)
            raise settings.MouldError(
                f"a core of the {self.pour.name} around {', '.join(f'{value + 0.0:.4g}' for value in place)} mm does not "
                f"stand on the lid; choose another plane (--split)"
            )
        return carrier

    def _peg(self, cores: list[Solid], lid: list[Solid]) -> list[Solid]:
        """Give the lost core a peg that stands in the lid."""
        workshop = self.workshop
        line = self._split if self.pour.sideways is not None else None
        self.occ.synchronize()
        places, room = _places(_edge(cores, self.level), line)
        radius = min(0.6 * float(room.max()), 1.5 * MM_PER_M * workshop.pin)
        length, gap = MM_PER_M * workshop.pin_length, MM_PER_M * workshop.clearance
        at = (float(places[room.argmax()][0]), float(places[room.argmax()][1]))
        peg = _cone(at, self.level, -length, radius, radius - length * workshop.slope)
        socket = _cone(at, self.level, -length - gap, radius + gap, radius - length * workshop.slope + gap)
        self.openings.append(socket)
        self._add("core", merged([*cores, peg]), np.zeros(3))
        return list(self.occ.cut(lid, [socket], removeTool=False)[0])

    def _join(self, cup: list[Solid], lid: list[Solid]) -> tuple[list[Solid], list[Solid]]:
        """Put the pins on the cup and sink their sockets into the lid."""
        length = MM_PER_M * self.workshop.pin_length
        return self._pinned(cup, lid, self.level, length, length + MM_PER_M * self.workshop.clearance)

    def _pinned(
        self, upper: list[Solid], lower: list[Solid], level: float, length: float, deep: float
    ) -> tuple[list[Solid], list[Solid]]:
        """Put pins down from one body, and sink their sockets into that below; in three corners, so that one way only fits."""
        workshop, half = self.workshop, 0.5 * MM_PER_M * self.workshop.rim
        gap, root = MM_PER_M * workshop.clearance, 0.5 * MM_PER_M * workshop.pin
        (x, y), (X, Y) = self.low[:2] + half, self.high[:2] - half
        tip, places = root - length * workshop.slope, ((x, y), (X, y), (x, Y))
        upper = merged([*upper, *(_cone(place, level, -length, root, tip) for place in places)])
        end = root + gap - deep * workshop.slope
        sockets = [_cone(place, level, -deep, root + gap, end) for place in places]
        self.openings += sockets
        self.drafted += [Hole(place, 0.0, root + 2.0 * gap, (level - deep, level)) for place in places]
        return upper, list(self.occ.cut(lower, sockets, removeTool=False)[0])

    def _divide(self, cup: list[Solid]) -> None:
        """Add the cup in its parts."""
        pour, far = self.pour, np.full(3, 2.0 * float((self.high - self.low).max()) + 100.0)
        if pour.floor is not None:
            height = MM_PER_M * self.workshop.scale * pour.floor
            frame = _copies_in_box(cup, self.low - far, np.array([*self.high[:2], height]) + far * (1.0, 1.0, 0.0))
            floor = _copies_in_box(cup, np.array([*self.low[:2], height]) - far * (1.0, 1.0, 0.0), self.high + far)
            self.occ.remove(cup, recursive=True)
            deep = height - self.level  # the sockets go through the frame, which may be thin
            floor, frame = self._pinned(floor, frame, height, min(MM_PER_M * self.workshop.pin_length, 0.8 * deep), deep)
            self._add("floor", floor, UP)
            self._add("frame", frame, DOWN)
        elif pour.sideways is not None:
            axis, middle = self._split
            half, other = (_copies_in_box(cup, *self._side(far, axis, middle, way)) for way in (-1, 1))
            self.occ.remove(cup, recursive=True)
            half, other = self._doweled(half, other, axis, middle)
            along = np.eye(3)[axis]
            self._add("cup left", half, -along)
            self._add("cup right", other, along)
        else:
            self._add("cup" if pour.lid else "tray", cup, UP)

    def _side(self, far: Array, axis: int, middle: float, way: int) -> tuple[Array, Array]:
        low, high = self.low - far, self.high + far
        (high if way < 0 else low)[axis] = middle
        return low, high

    def _doweled(self, solids: list[Solid], other: list[Solid], axis: int, middle: float) -> tuple[list[Solid], list[Solid]]:
        """Put dowels between the two halves of a cup, two at the bottom and one at the top."""
        workshop, across = self.workshop, 1 - axis
        gap = MM_PER_M * workshop.clearance
        root = 0.5 * MM_PER_M * workshop.pin
        length = MM_PER_M * workshop.pin_length
        tip, half = root - length * workshop.slope, 0.5 * MM_PER_M * workshop.rim
        low, high = self.level + half, self.top + MM_PER_M * workshop.wall - half
        dowels, sockets = [], []
        for edge, height in ((0, low), (1, low), (0, high)):
            at = np.zeros(3)
            at[axis], at[across], at[2] = middle, (self.low[across] + half, self.high[across] - half)[edge], height
            along = np.eye(3)[axis]
            dowels.append((3, int(self.occ.addCone(*at, *(length * along), root, tip))))
            sockets.append((3, int(self.occ.addCone(*at, *((length + gap) * along), root + gap, tip + gap))))
        self.openings += sockets
        return merged([*solids, *dowels]), list(self.occ.cut(other, sockets, removeTool=False)[0])

    def _inlet(self, ends: tuple[Vector, Vector]) -> Inlet | None:
        """Return the inlet if it runs through this piece."""
        begin, end = (self.frame.placed(place) for place in ends)
        along, middle = end - begin, 0.5 * (begin + end)
        length = float(np.linalg.norm(along))
        along /= length
        upright = abs(along[2]) > 1.0 - 1e-9
        in_plane = not upright and max(abs(begin[2] - self.level), abs(end[2] - self.level)) < FLUSH_TOLERANCE
        if not in_plane and not self.level < middle[2] < self.top:
            return None
        part = "pin" if not upright and not in_plane else "lid" if self.pour.lid else "cup"
        return self._make_inlet(part, begin, end, length)

    def _make_inlet(self, part: str, begin: Array, end: Array, length: float) -> Inlet:
        occ, workshop = self.occ, self.workshop
        along, radius = (end - begin) / length, 0.5 * MM_PER_M * workshop.inlet_width
        upright = abs(along[2]) > 1.0 - 1e-9
        self._check_silicone(begin, end - begin, radius)
        outer = radius + (0.5 * LUER_TAPER * length if workshop.inlet == "luer" else 0.0)
        inner = radius
        if upright:
            if workshop.inlet == "luer":
                raise settings.MouldError(
                    "inlet is 'luer', a cone that is wide outside; this device's inlet is cast on the core, which leaves "
                    "inwards: use inlet = tube or barb"
                )
            outer, inner = self._tapered(length, radius, part)
        core = self._rod(begin, end, outer, inner)
        room = _single_solid(list(occ.intersect([core], [self.envelope], removeTool=False)[0]), "the inlet")
        far = np.array([1.0, 1.0, 0.0]) * 2.0 * float((self.high - self.low).max())
        room = _single_solid(_copies_in_box([room], self.low - far, self.high + far), "the inlet")
        self.plugs += occ.intersect([room], [self.whole], removeObject=False, removeTool=False)[0]
        if part != "pin":
            return Inlet(part, room, occ.copy([room])[0], None, -along, begin, outer)
        reach = MM_PER_M * workshop.rim
        pin = self._rod(begin - reach * along, begin, outer + 0.5 * self._cone_of * reach, outer)
        head = self._rod(
            begin - (reach + HANDLE_THICKNESS) * along,
            begin - reach * along,
            outer + HANDLE_THICKNESS,
            outer + HANDLE_THICKNESS,
        )
        gap = MM_PER_M * workshop.clearance
        bore = self._rod(begin - reach * along, begin, outer + 0.5 * self._cone_of * reach + gap, outer + gap)
        core = _single_solid(merged([occ.copy([room])[0], pin, head]), "the inlet pin")
        return Inlet(part, room, core, bore, -along, begin, outer + 0.5 * self._cone_of * reach + gap)

    @property
    def _cone_of(self) -> float:
        return LUER_TAPER if self.workshop.inlet == "luer" else 0.0

    def _rod(self, begin: Array, end: Array, first: float, last: float) -> Solid:
        """Return a cylinder or a cone between two places, by its radii, mm."""
        if abs(first - last) < 1e-9:
            return (3, int(self.occ.addCylinder(*begin, *(end - begin), first)))
        return (3, int(self.occ.addCone(*begin, *(end - begin), first, last)))

    def _check_silicone(self, begin: Array, along: Array, radius: float) -> None:
        occ, workshop = self.occ, self.workshop
        around = (3, occ.addCylinder(*begin, *along, radius + MM_PER_M * LEAST_SILICONE))
        inside = occ.intersect(occ.copy([around]), [self.envelope], removeTool=False)[0]
        volume = sum(occ.getMass(*solid) for solid in inside)
        if volume < (1.0 - POINT_TOLERANCE) * occ.getMass(*around):
            raise settings.MouldError(
                f"tube is {schema.shown(workshop.tube, 'm')}; it would leave less than {schema.shown(LEAST_SILICONE, 'm')} of "
                f"silicone around it"
            )
        occ.remove([*inside, around], recursive=True)

    def _tapered(self, length: float, radius: float, part: str) -> tuple[float, float]:
        """Return the radii of an upright inlet's core outside and inside: thinner away from the body that carries it."""
        workshop = self.workshop
        tip = radius - length * workshop.slope
        if 2.0 * tip < MM_PER_M * workshop.least_wall:
            raise settings.MouldError(
                f"draft is {schema.shown(workshop.draft, 'degree')}; over {schema.shown(length / MM_PER_M, 'm')} it closes the "
                f"inlet: of its core of {schema.shown(workshop.tube, 'm')} {schema.shown(max(2.0 * tip, 0.0) / MM_PER_M, 'm')} "
                f"are left, but the printer's smallest rib is {schema.shown(workshop.least_wall, 'm')}"
            )
        return (tip, radius) if part == "lid" else (radius, tip)


LUER_TAPER = 0.06
"""Change of diameter per length of a Luer cone (ISO 80369-7)."""


@dataclasses.dataclass(frozen=True)
class Inlet:
    """The core of a tube.

    Attributes:
        part: What carries it: ``"lid"``, ``"cup"``, or itself as a ``"pin"``.
        room: What it takes from the piece.
        core: The body, or what is put on the lid or cup.
        bore: The hole for a pin in the cup.
        outwards, begin: Unit vector out of the device, and where it leaves it, mm.
        radius: Of its bore where that is widest, mm.
    """

    part: str
    room: Solid
    core: Solid
    bore: Solid | None
    outwards: Array
    begin: Array
    radius: float


def left(made: Tooling) -> list[Solid]:
    """Return the cast: the free volume of the closed mould, without its openings. The bodies stay."""
    taken = [*(body.solid for body in made.bodies), *made.openings]
    return list(gmsh.model.occ.cut([_block(made.low, made.high)], taken, removeTool=False)[0])


def _cone(place: tuple[float, float], level: float, height: float, begin: float, end: float) -> Solid:
    """Return a cone, or a cylinder, that stands on a level plane; lengths in mm."""
    if abs(begin - end) < 1e-9:
        return (3, int(gmsh.model.occ.addCylinder(*place, level, 0, 0, height, begin)))
    return (3, int(gmsh.model.occ.addCone(*place, level, 0, 0, height, begin, end)))


def _single_solid(solids: list[Solid], what: str) -> Solid:
    if len(solids) != 1 or solids[0][0] != 3:
        raise MeshingError(f"the CAD kernel made {len(solids)} solids of {what} instead of one; change a length slightly")
    return solids[0]


# ----------------------------------------------------------------------------------------------------------------------
# Place the pour opening and the vents on flat faces of the piece, clear of every core.


GRID_PLACES = 120
"""Number of candidate places along the longer side."""
EDGE_POINTS = 60
"""Points on each curve of the face's edge."""


def hole_places(
    cast: list[Solid],
    heights: tuple[float, float],
    line: tuple[int, float] | None,
    workshop: settings.Workshop,
    fewer: bool = False,
) -> list[Array]:
    """Return the places (x, y) in mm of the pour opening, where most room is, and then of the vents, as far from it and from
    each other as can be; `MouldError` without room. There may be ``fewer`` vents in a core's mould, whose peg is the opening.

    ``heights`` are those of the faces of pour opening and vents in mm, ``line`` axis and place of a plane in which all of them
    are.
    """
    places, room = _places(_edge(cast, heights[0]), line)
    needed = 0.5 * MM_PER_M * workshop.least_gap if fewer else 0.5 * MM_PER_M * workshop.pour + MM_PER_M * workshop.least_gap
    best = float(room.max(initial=0.0))
    if best < needed and fewer:
        raise settings.MouldError(
            f"a core's peg is {schema.shown(round(2.0 * best / MM_PER_M, 6), 'm')} wide, too narrow to cast the core of wax "
            "through it; print the core (--core lost)"
        )
    if best < needed:
        raise settings.MouldError(
            f"pour is {schema.shown(workshop.pour, 'm')}; the bonding face has room for "
            f"{schema.shown(round(max(2.0 * (best / MM_PER_M - workshop.least_gap), 0.0), 6), 'm')} beside the cores"
        )
    pour = places[room.argmax()]
    if heights[1] != heights[0]:
        places, room = _places(_edge(cast, heights[1]), line)
    free = places[room >= 0.5 * MM_PER_M * workshop.vent + MM_PER_M * workshop.least_gap]
    apart = 0.5 * MM_PER_M * (workshop.pour + workshop.vent) + MM_PER_M * workshop.least_wall
    hole_places = [pour]
    for _ in range(workshop.vents):
        beside = hole_places[1:] if heights[1] != heights[0] and len(hole_places) > 1 else hole_places
        distance, _ = cKDTree(np.array(beside)).query(free)
        if not len(free) or distance.max() < apart:
            if fewer:
                break
            raise settings.MouldError(
                f"vents is {workshop.vents}; the bonding face has room for {len(hole_places) - 1} beside the cores"
            )
        hole_places.append(free[distance.argmax()])
    return hole_places


def _edge(cast: list[Solid], level: float) -> Array:
    """Return the straight pieces (x, y) of the edge of the faces that lie in the parting plane, shape (n, 2, 2)."""
    near, pieces = 1e-4, []
    for _, face in gmsh.model.getBoundary(cast, combined=True, oriented=False):
        box = gmsh.model.occ.getBoundingBox(2, face)
        if max(abs(box[2] - level), abs(box[5] - level)) > near:
            continue
        for _, curve in gmsh.model.getBoundary([(2, face)], combined=False, oriented=False):
            low, high = (bound[0] for bound in gmsh.model.getParametrizationBounds(1, curve))
            at = np.reshape(gmsh.model.getValue(1, curve, np.linspace(low, high, EDGE_POINTS + 1)), (-1, 3))[:, :2]
            pieces.append(np.stack([at[:-1], at[1:]], axis=1))
    if not pieces:
        raise settings.MouldError("the parting plane leaves no face to bond; choose another (--split)")
    return np.concatenate(pieces)


def _places(segments: Array, line: tuple[int, float] | None = None) -> tuple[Array, Array]:
    """Return the places inside of an edge, shape (n, 2), on a line if there is one, and how far each is from the edge."""
    low, high = segments.min(axis=(0, 1)), segments.max(axis=(0, 1))
    step = float((high - low).max()) / GRID_PLACES
    x, y = np.meshgrid(*(np.arange(a + 0.5 * step, b, step) for a, b in zip(low, high, strict=True)), indexing="ij")
    places = np.column_stack([x.ravel(), y.ravel()])
    if line is not None:
        places[:, line[0]] = line[1]
        places = np.unique(places, axis=0)
    (xa, ya), (xb, yb) = segments[:, 0].T, segments[:, 1].T
    inside = np.zeros(len(places), dtype=bool)
    # A ray along x crosses the edge an odd number of times; beside the place, as an edge ends at its own height.
    for k, (px, py) in enumerate(places + np.array([0.0, 1e-6 * step])):
        crossed = (ya > py) != (yb > py)
        inside[k] = np.count_nonzero(xa[crossed] + (py - ya[crossed]) / (yb - ya)[crossed] * (xb - xa)[crossed] > px) % 2
    places = places[inside]
    fine = np.concatenate([segments[:, 0] + share * (segments[:, 1] - segments[:, 0]) for share in np.linspace(0, 1, 9)])
    return places, cKDTree(fine).query(places)[0] if len(places) else np.zeros(0)


# ----------------------------------------------------------------------------------------------------------------------
# Names of the part's faces for messages: the name in the file, else kind and position.


def face_namer(device: Actuator | LostCore, frame: Frame) -> Callable[[Array], str]:
    """Return a function from a place in the mould (mm) to the clause that names the part's face there."""
    return lambda place: _name(device, frame.drawn(place))


def _name(device: Actuator | LostCore, place: Array) -> str:
    """Return ``at`` the place, with the face nearest to it."""

    where = "at " + ", ".join(f"{value + 0.0:.4g}" for value in np.round(place, 3)) + " mm"
    with meshing.private_model():
        device.build_whole()
        best, face = np.inf, 0
        tags = [tag for _, tag in gmsh.model.getEntities(2)]
        for tag in tags:
            nearest, _ = gmsh.model.getClosestPoint(2, tag, list(place))
            low, high = np.reshape(gmsh.model.getBoundingBox(2, tag), (2, 3))
            if ((low - 1e-3 > nearest) | (nearest > high + 1e-3)).any():
                continue
            if (distance := float(np.linalg.norm(nearest - place))) < best:
                best, face = distance, tag
        if not face:
            return where
        kind, file = gmsh.model.getType(2, face).lower(), device.files.get("file", "")
        names = face_names(file) if file else {}
        label = next((name for name in names if tags.index(face) in named_surfaces(file, name)), "")
    return f"{where}, on the part's face {label!r}" if label else f"{where}, on the part's face {face} (a {kind})"
