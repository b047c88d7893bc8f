"""What the printer gets: bodies laid on their flat sides on plates, how long that takes, and a coupon for its clearances."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence

import numpy as np

from softmodels.casting.bodies import MM, Solid
from softmodels.casting.facets import Facets
from softmodels.casting.settings import Workshop
from softmodels.common.arrays import Array
from softmodels.common.names import lazy_module

gmsh = lazy_module("gmsh")

FLAT = 1e-3
"""Distance in mm from the lowest plane below which a triangle lies in it."""
BETWEEN = 4.0
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
class Placed:
    """A body on a plate.

    Attributes:
        name: Of the body.
        plate: Number of the plate, from 1.
        facets: Its surface where it lies, in mm from the plate's corner.
    """

    name: str
    plate: int
    facets: Facets


def moved(facets: Facets, turn: Array, shift: Array) -> Facets:
    """Return a surface turned about the origin and then shifted, in mm."""
    return dataclasses.replace(
        facets,
        points=facets.points @ turn.T + shift,
        normals=facets.normals @ turn.T,
        centre=turn @ facets.centre + shift,
    )


def laid_flat(facets: Facets) -> Facets:
    """Return a body on the side on which it has the largest flat area, its lowest point at height 0."""
    a, b, c = np.moveaxis(facets.corners, 1, 0)
    areas = 0.5 * np.cross(b - a, c - a)

    def flat(turn: Array) -> float:
        heights = facets.corners @ turn[2]
        lowest = (heights - heights.min()).max(axis=1) < FLAT
        return float(np.linalg.norm(areas[lowest], axis=1).sum())

    turn = max(SIDES, key=flat)
    points = facets.points @ turn.T
    return moved(facets, turn, -points.min(axis=0))


def arranged(bodies: Sequence[tuple[str, Facets]], workshop: Workshop) -> list[Placed]:
    """Return bodies on plates: in rows, the deepest first, and on a further plate where one is full.

    A body that is larger than a plate has one for itself.
    """
    wide, deep = MM * workshop.bed_width, MM * workshop.bed_depth
    laid = []
    for name, facets in bodies:
        flat = laid_flat(facets)
        x, y, _ = flat.points.max(axis=0)
        if y > x or x > wide - 2.0 * BETWEEN:
            flat = moved(flat, QUARTER, np.array([y, 0.0, 0.0])) if x <= deep - 2.0 * BETWEEN or y > x else flat
        laid.append((name, flat))
    laid.sort(key=lambda one: -float(one[1].points[:, 1].max()))
    found, plate, x, y, row = list[Placed](), 1, BETWEEN, BETWEEN, 0.0
    for name, flat in laid:
        width, depth = (float(value) for value in flat.points[:, :2].max(axis=0))
        if x > BETWEEN and x + width > wide - BETWEEN:
            x, y, row = BETWEEN, y + row + BETWEEN, 0.0
        if y > BETWEEN and y + depth > deep - BETWEEN:
            plate, x, y, row = plate + 1, BETWEEN, BETWEEN, 0.0
        found.append(Placed(name, plate, moved(flat, np.eye(3), np.array([x, y, 0.0]))))
        x, row = x + width + BETWEEN, max(row, depth)
    return found


def too_large(placed: Sequence[Placed], workshop: Workshop) -> list[str]:
    """Return the names of the bodies that are larger than a plate."""
    size = MM * np.array([workshop.bed_width, workshop.bed_depth])
    return [one.name for one in placed if (one.facets.points[:, :2].max(axis=0) > size).any()]


@dataclasses.dataclass(frozen=True)
class PrintEstimate:
    """What a print takes.

    Attributes:
        resin: Volume of all bodies, m3.
        times: Of each plate, s: all layers up to its tallest body.
    """

    resin: float
    times: tuple[float, ...]

    @property
    def mass(self) -> float:
        """Mass of the resin, kg."""
        return RESIN_DENSITY * self.resin


def print_estimate(placed: Sequence[Placed], workshop: Workshop) -> PrintEstimate:
    """Return what the bodies on their plates take on a printer that cures a layer at a time."""
    times = []
    for _, group in itertools.groupby(placed, lambda one: one.plate):
        height = max(float(one.facets.points[:, 2].max()) for one in group) / MM
        times.append(math.ceil(height / workshop.layer) * workshop.layer_time)
    return PrintEstimate(sum(one.facets.volume for one in placed) / MM**3, tuple(times))


# ----------------------------------------------------------------------------------------------------------------------
# The coupon: sockets of several clearances for one pin, and ribs and slots of several widths, to find what a printer can do.


CLEARANCES = (0.05, 0.10, 0.15, 0.20, 0.25, 0.30)
"""Clearances of the coupon's sockets, mm, from the marked corner on."""
WIDTHS = (0.3, 0.4, 0.5, 0.6, 0.8, 1.0)
"""Widths of the coupon's ribs and slots, mm, in the same order."""


def coupon_solids(workshop: Workshop) -> dict[str, Solid]:
    """Add the coupon to the current Gmsh model: a plate with sockets, ribs and slots, and a pin on a foot."""
    occ = gmsh.model.occ
    pitch, deep = MM * workshop.pin + 4.0, MM * workshop.pin_length
    root, drop = 0.5 * MM * workshop.pin, MM * workshop.pin_length * workshop.slope
    plate = (3, occ.addBox(0, 0, 0, pitch * len(CLEARANCES), 3.0 * pitch, deep + 2.0))
    top = deep + 2.0
    ribs, tools = list[Solid](), [(3, occ.addBox(-1, -1, -1, 3, 3, top + 2))]  # the corner cut off marks the first one
    for k, (gap, width) in enumerate(zip(CLEARANCES, WIDTHS, strict=True)):
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


def plate_names(placed: Sequence[Placed]) -> list[str]:
    """Return the names of the plates' files without ending, in their order."""
    count = max(one.plate for one in placed)
    return ["plate"] if count == 1 else [f"plate-{k}" for k in range(1, count + 1)]
