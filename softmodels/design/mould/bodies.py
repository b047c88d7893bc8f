"""The four bodies of a mould: for each half of the device a cup that forms its outside, and a lid that forms the face which is
bonded, with the cavity's core on it. Pins on the cup fit into sockets of the lid; pour opening and vents go through the lid,
so that their marks vanish in the bond.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from geometries.errors import MeshingError
from softmodels.design.mould.holes import hole_places
from softmodels.design.mould.settings import MouldError, Workshop
from softmodels.design.mould.solids import MM, OTHER_SIDE, Array, Parted, Solid

OVER = 1.0
"""mm by which a tool that cuts reaches beyond what it cuts."""


@dataclasses.dataclass(frozen=True)
class Hole:
    """An opening of a lid, a cone that is wide outside so that what cures in it tears off at its neck.

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
        target: What it is to cast, as the device's own shape says.
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
    """What the closed mould leaves free on the part's side of the parting plane: its cast. Cup and lid stay."""
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
    """A cone, or a cylinder, that stands on the parting plane; lengths in mm."""
    import gmsh

    if abs(begin - end) < 1e-9:
        return (3, int(gmsh.model.occ.addCylinder(*place, level, 0, 0, height, begin)))
    return (3, int(gmsh.model.occ.addCone(*place, level, 0, 0, height, begin, end)))


def _one(solids: list[Solid], what: str) -> Solid:
    if len(solids) != 1 or solids[0][0] != 3:
        raise MeshingError(f"the CAD kernel made {len(solids)} solids of {what}; change a length a little")
    return solids[0]


def _lid(solids: list[Solid], parted: Parted, half: str) -> Solid:
    import gmsh

    if len(solids) > 1:
        loose = min(solids, key=lambda solid: gmsh.model.occ.getMass(*solid))
        place = ", ".join(
            f"{value + 0.0:.4g}" for value in parted.drawn(gmsh.model.occ.getCenterOfMass(*loose)).round(3)
        )
        raise MouldError(
            f"the cavity around {place} mm lies wholly in the {half} half and does not reach the parting plane, so that its "
            "core would float; choose another plane (--split) or another direction (--pull)"
        )
    return _one(solids, f"the lid of the {half} half")
