"""The device in the CAD kernel, in mm, rotated so that the mould opens along z, and split in two."""

from __future__ import annotations

import dataclasses
import math
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from geometries import Actuator
from geometries.actuator import Parting
from softmodels.casting.settings import MouldError, Workshop
from softmodels.common.arrays import Array
from softmodels.common.errors import MeshingError
from softmodels.common.schema import shown

Solid = tuple[int, int]
"""Dimension, which is 3, and tag."""
MM = 1e3
"""Lengths in the model over those in m."""
NEAR = 1e-6
"""Tolerance relative to the part's size."""
LEAST_SILICONE = 0.5e-3
"""Minimum silicone around a tube, m: thinner walls tear when the tube is pushed in."""
OTHER_SIDE = {"upper": -1.0, "lower": 1.0}
"""Halves by name, with the direction of their mould's lid along z."""


@dataclasses.dataclass(frozen=True)
class Parted:
    """The device in the current Gmsh model, in the mould's scale.

    Attributes:
        envelope: The device with its cavities filled.
        cores: Its cavities.
        inlet: The solid that leaves room for the tube; none if there is no inlet.
        level: Height of the parting plane, mm.
        low, high: Corners of the envelope's box, mm.
        turn: The rotation that turned it, shape (3, 3).
        scale: Its size over the device's.
    """

    envelope: Solid
    cores: list[Solid]
    inlet: list[Solid]
    level: float
    low: Array
    high: Array
    turn: Array
    scale: float

    def drawn(self, place: Array) -> Array:
        """Return the place in the original device, in mm, of a place in the mould."""
        return np.asarray(self.turn.T @ np.asarray(place) / self.scale)

    @property
    def size(self) -> float:
        """Diagonal of the box, mm."""
        return float(np.linalg.norm(self.high - self.low))

    def half(self, name: str, solids: Sequence[Solid]) -> list[Solid]:
        """Return the copies of what lies above or below the parting plane, of several solids."""
        import gmsh  # type: ignore[import-untyped]

        occ, far = gmsh.model.occ, 2.0 * self.size
        x, y, _ = self.low - 0.5 * self.size
        begin = self.level if name == "upper" else self.level - far
        if not solids:
            return []
        space = occ.addBox(x, y, begin, far, far, far)
        return list(occ.intersect(occ.copy(list(solids)), [(3, space)])[0])


def placed(parting: Parting, workshop: Workshop) -> Array:
    """Return the rotation, shape (3, 3), that rotates the pull into z by the smallest angle."""
    pull, z = np.asarray(parting.pull), np.array([0.0, 0.0, 1.0])
    axis, cosine = np.cross(pull, z), float(pull @ z)
    if cosine > 1.0 - 1e-12:
        return np.eye(3)
    if cosine < -1.0 + 1e-12:
        return np.diag([1.0, -1.0, -1.0])
    cross = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    return np.asarray(np.eye(3) + cross + cross @ cross / (1.0 + cosine))


def parting_of(device: Actuator, workshop: Workshop) -> Parting | None:
    """Return the parting plane of a device: by its class, else along the given pull, in the middle of the cavities
    (None).

    Raises:
        MouldError: A pull that is missing, or asked of a device that has its own.
    """
    own = device.parting
    if own is not None:
        if workshop.direction is not None or workshop.level is not None:
            raise MouldError(
                f"pull and split apply only to imported parts; a {type(device).__name__} defines its own parting plane"
            )
        return own
    if workshop.direction is None:
        raise MouldError("the mould of this part needs its opening direction, such as --pull '0, 0, 1'")
    return None


def turned(solids: Sequence[Solid], turn: Array) -> None:
    """Turn solids about the origin."""
    import gmsh

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
    import gmsh

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


def part(device: Actuator, workshop: Workshop) -> Parted:
    """Fill the current Gmsh model with a device, ready for its mould.

    Raises:
        MouldError: A device that cannot be parted as asked.
        GeometryError, MeshingError: Its whole cannot be made.
    """
    import gmsh

    parting = parting_of(device, workshop)
    device.build_whole()
    solids = gmsh.model.getEntities(3)
    if len(solids) != 1:
        raise MouldError(f"the whole device consists of {len(solids)} solids; a mould needs a single one")
    turn = placed(parting or Parting(workshop.direction or (0.0, 0.0, 1.0), 0.0, None, ""), workshop)
    turned(solids, turn)
    scaled(workshop.scale)
    occ = gmsh.model.occ
    occ.synchronize()
    solids = occ.getEntities(3)
    loops, _ = occ.getSurfaceLoops(solids[0][1])
    shells = [(3, occ.addVolume([loop])) for loop in loops]
    occ.synchronize()
    boxes = [np.array(occ.getBoundingBox(*shell)).reshape(2, 3) for shell in shells]
    order = np.argsort([-np.prod(np.ptp(box, axis=0)) for box in boxes])
    envelope, cores = shells[order[0]], [shells[k] for k in order[1:]]
    if not cores:
        raise MouldError("the part has no closed cavity, so it needs no mould with a core")
    low, high = boxes[order[0]]
    level = _level(parting, workshop, boxes, order)
    if not low[2] < level < high[2]:
        raise MouldError(
            f"split is {shown(level / MM / workshop.scale, 'm')}; along the pull the part extends from "
            f"{shown(low[2] / MM / workshop.scale, 'm')} to {shown(high[2] / MM / workshop.scale, 'm')}"
        )
    inlet = _inlet(parting, workshop, envelope) if parting and parting.inlet and workshop.tube else []
    return Parted(envelope, cores, inlet, level, low, high, turn, workshop.scale)


def _level(parting: Parting | None, workshop: Workshop, boxes: list[Array], order: npt.NDArray[np.int64]) -> float:
    if parting is not None:
        return MM * workshop.scale * parting.height
    if workshop.level is not None:
        return MM * workshop.scale * workshop.level
    heights = np.array([boxes[k][:, 2] for k in order[1:]])
    return 0.5 * float(heights.min() + heights.max())


def _inlet(parting: Parting, workshop: Workshop, envelope: Solid) -> list[Solid]:
    """Return the core of the tube: straight in the parting plane, else tapered outwards by the draft.

    Raises:
        MouldError: The draft closes it.
    """
    import gmsh

    assert parting.inlet is not None
    begin, end = (MM * workshop.scale * np.asarray(place) for place in parting.inlet)
    along = end - begin
    length, radius = float(np.linalg.norm(along)), 0.5 * MM * workshop.tube
    upright = abs(float(along @ np.asarray(parting.pull))) > 0.5 * length
    around = (3, gmsh.model.occ.addCylinder(*begin, *along, radius + MM * LEAST_SILICONE))
    inside = gmsh.model.occ.intersect(gmsh.model.occ.copy([around]), [envelope], removeTool=False)[0]
    found = sum(gmsh.model.occ.getMass(*solid) for solid in inside)
    if found < (1.0 - NEAR) * gmsh.model.occ.getMass(*around):
        raise MouldError(
            f"tube is {shown(workshop.tube, 'm')}; it would leave less than {shown(LEAST_SILICONE, 'm')} of "
            f"silicone around it"
        )
    gmsh.model.occ.remove([around], recursive=True)
    if not upright:
        core = gmsh.model.occ.addCylinder(*begin, *along, radius)
    else:
        tip = radius - length * workshop.slope
        if 2.0 * tip < MM * workshop.least_wall:
            raise MouldError(
                f"draft is {shown(workshop.draft, 'degree')}; over {shown(length / MM, 'm')} it closes the inlet: of its core "
                f"of {shown(workshop.tube, 'm')} {shown(max(2.0 * tip, 0.0) / MM, 'm')} are left, but the printer's smallest "
                f"rib is {shown(workshop.least_wall, 'm')}"
            )
        same = radius - tip < 1e-9
        core = (
            gmsh.model.occ.addCylinder(*begin, *along, radius)
            if same
            else gmsh.model.occ.addCone(*begin, *along, tip, radius)
        )
    return list(gmsh.model.occ.intersect([(3, core)], [envelope], removeTool=False)[0])


# ----------------------------------------------------------------------------------------------------------------------
# Place the pour opening and the vents on the bonding face, clear of every core.


GRID = 120
"""Number of candidate places along the longer side."""
ALONG = 60
"""Points on each curve of the face's edge."""


def hole_places(cast: list[Solid], level: float, workshop: Workshop) -> tuple[Array, Array]:
    """Return the places (x, y) in mm of the pour opening, shape (2,), and of the vents, shape (n, 2).

    The pour opening is where most room is; the vents are as far from it and from each other as can be.

    Args:
        cast: The half that is cast, in the current Gmsh model.
        level: Height of the parting plane, mm.
        workshop: Sizes of the holes.

    Raises:
        MouldError: There is no room.
    """
    segments = _edge(cast, level)
    places, room = _places(segments)
    needed = 0.5 * MM * workshop.pour + MM * workshop.least_gap
    best = float(room.max(initial=0.0))
    if best < needed:
        raise MouldError(
            f"pour is {shown(workshop.pour, 'm')}; the bonding face has room for "
            f"{shown(round(max(2.0 * (best / MM - workshop.least_gap), 0.0), 6), 'm')} beside the cores"
        )
    pour = places[room.argmax()]
    free = places[room >= 0.5 * MM * workshop.vent + MM * workshop.least_gap]
    apart = 0.5 * MM * (workshop.pour + workshop.vent) + MM * workshop.least_wall
    vents: list[Array] = []
    for _ in range(workshop.vents):
        taken = np.array([pour, *vents])
        distance, _ = cKDTree(taken).query(free)
        if not len(free) or distance.max() < apart:
            raise MouldError(f"vents is {workshop.vents}; the bonding face has room for {len(vents)} beside the cores")
        vents.append(free[distance.argmax()])
    return pour, np.array(vents)


def _edge(cast: list[Solid], level: float) -> Array:
    """Return the straight pieces (x, y) of the edge of the faces that lie in the parting plane, shape (n, 2, 2)."""
    import gmsh  # type: ignore[import-untyped]

    near, pieces = 1e-4, []
    for _, face in gmsh.model.getBoundary(cast, combined=True, oriented=False):
        box = gmsh.model.occ.getBoundingBox(2, face)
        if max(abs(box[2] - level), abs(box[5] - level)) > near:
            continue
        for _, curve in gmsh.model.getBoundary([(2, face)], combined=False, oriented=False):
            low, high = (bound[0] for bound in gmsh.model.getParametrizationBounds(1, curve))
            at = np.reshape(gmsh.model.getValue(1, curve, np.linspace(low, high, ALONG + 1)), (-1, 3))[:, :2]
            pieces.append(np.stack([at[:-1], at[1:]], axis=1))
    if not pieces:
        raise MouldError("the parting plane leaves no face to bond; choose another (--split)")
    return np.concatenate(pieces)


def _places(segments: Array) -> tuple[Array, Array]:
    """Return the places inside of an edge, shape (n, 2), and how far each is from it."""
    low, high = segments.min(axis=(0, 1)), segments.max(axis=(0, 1))
    step = float((high - low).max()) / GRID
    x, y = np.meshgrid(*(np.arange(a + 0.5 * step, b, step) for a, b in zip(low, high, strict=True)), indexing="ij")
    places = np.column_stack([x.ravel(), y.ravel()])
    (xa, ya), (xb, yb) = segments[:, 0].T, segments[:, 1].T
    inside = np.zeros(len(places), dtype=bool)
    for k, (px, py) in enumerate(places):  # a ray along x crosses the edge an odd number of times
        crossed = (ya > py) != (yb > py)
        inside[k] = (
            np.count_nonzero(xa[crossed] + (py - ya[crossed]) / (yb - ya)[crossed] * (xb - xa)[crossed] > px) % 2
        )
    places = places[inside]
    fine = np.concatenate(
        [segments[:, 0] + share * (segments[:, 1] - segments[:, 0]) for share in np.linspace(0, 1, 9)]
    )
    return places, cKDTree(fine).query(places)[0] if len(places) else np.zeros(0)


# ----------------------------------------------------------------------------------------------------------------------
# The four bodies of a mould: per half of the device a cup for its outside, and a lid for the bonding
# face with the cavity's core. Pins on the cup fit into sockets of the lid; pour opening and vents are in the lid,
# so that their marks vanish in the bond.


@dataclasses.dataclass(frozen=True)
class Hole:
    """An opening of a lid: a cone, wide outside, so that the sprue tears off at its neck.

    Attributes:
        place: (x, y) of its axis, mm.
        neck, mouth: Its radii at the silicone and outside, mm.
    """

    place: tuple[float, float]
    neck: float
    mouth: float


@dataclasses.dataclass(frozen=True)
class Tooling:
    """The mould of one half, in the current Gmsh model.

    Attributes:
        half: ``"upper"`` or ``"lower"``.
        cup, lid: The bodies.
        target: Shape to be cast, from the device's geometry.
        level: Height of the parting plane, mm.
        pour: The pour opening.
        vents: The vents.
        pins: (x, y) of the pins, shape (3, 2), mm.
        low, high: Corners of the box of cup and lid together, mm.
    """

    half: str
    cup: Solid
    lid: Solid
    target: list[Solid]
    level: float
    pour: Hole
    vents: list[Hole]
    pins: Array
    low: Array
    high: Array


def tooling(parted: Parted, half: str, workshop: Workshop) -> Tooling:
    """Make the mould of one half.

    Raises:
        MouldError: It cannot be made so.
    """
    import gmsh  # type: ignore[import-untyped]

    occ, towards = gmsh.model.occ, OTHER_SIDE[half]
    outside = _one(parted.half(half, [parted.envelope]), f"the {half} half of the part")
    cores = parted.half(half, [*parted.cores, *parted.inlet])
    if len(cores) > 1:
        cores = list(occ.fuse(cores[:1], cores[1:])[0])
    target = list(occ.cut([outside], cores, removeObject=False, removeTool=False)[0]) if cores else occ.copy([outside])
    occ.synchronize()
    wall, rim, level = MM * workshop.wall, MM * workshop.rim, parted.level
    end = parted.high[2] + wall if half == "upper" else parted.low[2] - wall
    x, y = parted.low[:2] - rim
    wide, deep = np.ptp([parted.low, parted.high], axis=0)[:2] + 2.0 * rim
    cup = occ.cut([(3, occ.addBox(x, y, level, wide, deep, end - level))], [outside])[0]
    plate = (3, occ.addBox(x, y, level, wide, deep, towards * wall))
    lid = occ.fuse([plate], cores)[0] if cores else [plate]
    pour, vents = _holes(target, level, workshop)
    pins = np.array(
        [[x + 0.5 * rim, y + 0.5 * rim], [x + wide - 0.5 * rim, y + 0.5 * rim], [x + 0.5 * rim, y + deep - 0.5 * rim]]
    )
    cup, lid = _joined(cup, lid, pins, level, towards, workshop)
    tools = [_cone(hole.place, level, towards * wall, hole.neck, hole.mouth) for hole in (pour, *vents)]
    lid = occ.cut(lid, tools)[0]
    occ.synchronize()
    back = level + towards * wall
    return Tooling(
        half, _one(cup, f"the cup of the {half} half"), _lid(lid, parted, half), target, level, pour, vents, pins,
        np.array([x, y, min(end, back)]), np.array([x + wide, y + deep, max(end, back)]),
    )  # fmt: skip


def left(parted: Parted, made: Tooling) -> list[Solid]:
    """Return the cast: the free volume of the closed mould on the part's side of the parting plane. Cup and lid stay."""
    import gmsh

    low, high = made.low.copy(), made.high.copy()
    if made.half == "upper":
        low[2] = parted.level
    else:
        high[2] = parted.level
    box = (3, gmsh.model.occ.addBox(*low, *(high - low)))
    return list(gmsh.model.occ.cut([box], [made.cup, made.lid], removeTool=False)[0])


def _holes(target: list[Solid], level: float, workshop: Workshop) -> tuple[Hole, list[Hole]]:
    pour, vents = hole_places(target, level, workshop)
    widening = MM * workshop.wall * workshop.slope

    def hole(place: Array, diameter: float) -> Hole:
        neck = 0.5 * MM * diameter
        return Hole((float(place[0]), float(place[1])), neck, neck + widening)

    return hole(pour, workshop.pour), [hole(place, workshop.vent) for place in vents]


def _joined(
    cup: list[Solid], lid: list[Solid], pins: Array, level: float, towards: float, workshop: Workshop
) -> tuple[list[Solid], list[Solid]]:
    """Put the pins on the cup and sink their sockets into the lid."""
    import gmsh

    occ = gmsh.model.occ
    length, gap = MM * workshop.pin_length, MM * workshop.clearance
    root, tip = 0.5 * MM * workshop.pin, 0.5 * MM * workshop.tip(workshop.pin, workshop.pin_length)
    cup = occ.fuse(cup, [_cone((x, y), level, towards * length, root, tip) for x, y in pins])[0]
    deeper = gap * workshop.slope
    sockets = [_cone((x, y), level, towards * (length + gap), root + gap, tip + gap - deeper) for x, y in pins]
    return cup, occ.cut(lid, sockets)[0]


def _cone(place: tuple[float, float], level: float, height: float, begin: float, end: float) -> Solid:
    """Return a cone, or a cylinder, that stands on the parting plane; lengths in mm."""
    import gmsh

    if abs(begin - end) < 1e-9:
        return (3, int(gmsh.model.occ.addCylinder(*place, level, 0, 0, height, begin)))
    return (3, int(gmsh.model.occ.addCone(*place, level, 0, 0, height, begin, end)))


def _one(solids: list[Solid], what: str) -> Solid:
    if len(solids) != 1 or solids[0][0] != 3:
        raise MeshingError(
            f"the CAD kernel made {len(solids)} solids of {what} instead of one; change a length slightly"
        )
    return solids[0]


def _lid(solids: list[Solid], parted: Parted, half: str) -> Solid:
    import gmsh

    if len(solids) > 1:
        loose = min(solids, key=lambda solid: gmsh.model.occ.getMass(*solid))
        place = ", ".join(
            f"{value + 0.0:.4g}" for value in parted.drawn(gmsh.model.occ.getCenterOfMass(*loose)).round(3)
        )
        raise MouldError(
            f"the cavity around {place} mm is entirely in the {half} half and does not reach the parting plane, "
            f"so its core would float; choose another plane (--split) or direction (--pull)"
        )
    return _one(solids, f"the lid of the {half} half")


# ----------------------------------------------------------------------------------------------------------------------
# Names of the part's faces for messages: the name in the file, else kind and position.


def face_namer(device: Actuator, parted: Parted) -> Callable[[Array], str]:
    """Return a function from a place in the mould (mm) to the clause that names the part's face there.

    Args:
        device: The part.
        parted: How it was turned and scaled.
    """

    def named(place: Array) -> str:
        return _name(device, parted.drawn(place))

    return named


def _name(device: Actuator, place: Array) -> str:
    """Return ``at`` the place, with the face nearest to it."""
    import gmsh  # type: ignore[import-untyped]

    from geometries.imported import face_names, named_surfaces
    from geometries.meshing import private_model

    where = "at " + ", ".join(f"{value + 0.0:.4g}" for value in np.round(place, 3)) + " mm"
    with private_model():
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
