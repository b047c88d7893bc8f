"""The PneuNet: a row of air chambers on a base, joined by a channel, that bends towards the base.

Seen from the side, x from the clamp to the tip, the mirror plane y = 0 cut open::

    z   root          gap          cap
    |  _______ _____   _____   _______
    |  |      |     | |     | |      |   top wall
    |  |    __|  _  | |  _  | |  __  |
    |  |    |   | | | | | | | | |  | |   chambers, their walls
    |  |    |   | | |_| | | |_| |  | |
    |  |    |   |  \\bridge/      |  | |
    |  |    |___________________|  | |   channel
    0--|-----------------------------|-- x
       |_____________________________|   base

Chambers grow long, the base does not: the finger bends down, towards its base, and the rise of its tip is negative. With a
thick bridge the gaps are slots, with no gap the chambers share their walls and are divided by ribs. Two sides have one base in
their middle and two cavities. The supply hose is not modelled: the cavity is closed.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from geometries.actuator import Bending, HeldTip, MirroredHalf, Pour, Recipe, part_field, tip_field
from geometries.meshing import (
    Entity,
    Mirror,
    add_block,
    bond,
    check_cell_count,
    corners_of,
    face_block,
    one_solid,
    set_sizes,
)
from geometries.registry import register_device
from softmodels.common.errors import GeometryError
from softmodels.common.names import lazy_module
from softmodels.common.schema import LONGEST, ROUNDING, choice_field, length_field, number_field, shown

gmsh = lazy_module("gmsh")

# ----------------------------------------------------------------------------------------------------------------------
# Where the walls of a PneuNet are: all stand square to the axes, so that a list of positions along each axis defines them.


Vector = tuple[float, float, float]


@dataclasses.dataclass(frozen=True)
class Box:
    """A block with sides along the axes, in m.

    Attributes:
        low: Corner with the smallest coordinates.
        high: Corner with the largest.
    """

    low: Vector
    high: Vector

    @property
    def volume(self) -> float:
        return float(np.prod(np.subtract(self.high, self.low)))

    @property
    def area(self) -> float:
        x, y, z = np.subtract(self.high, self.low)
        return float(2.0 * (x * y + y * z + z * x))

    def holds(self, low: NDArray[np.float64], high: NDArray[np.float64], near: float) -> bool:
        """Return whether another block, given by its corners, lies in this one, to ``near`` (m)."""
        return bool(np.all(low > np.subtract(self.low, near)) and np.all(high < np.add(self.high, near)))


def pitch(finger: PneuNet) -> float:
    """From a chamber to the next one, in m."""
    return finger.chamber_length + (2.0 * finger.wall + finger.gap if finger.gap else finger.wall)


def planned_length(finger: PneuNet) -> float:
    """From the clamp to the tip, in m."""
    return finger.root + (finger.chambers - 1) * pitch(finger) + finger.chamber_length + finger.cap


def half_width(finger: PneuNet) -> float:
    """From the mirror plane to the side, in m."""
    return 0.5 * finger.chamber_width + finger.side_wall


def ceiling(finger: PneuNet) -> float:
    """Return the height of the chambers' ceiling above the middle of the base, in m."""
    return 0.5 * finger.base + finger.chamber_height


def top(finger: PneuNet) -> float:
    """Return the height of the chambers' outside, in m."""
    return ceiling(finger) + finger.top_wall


def gap_floor(finger: PneuNet) -> float:
    """Return the height at which a gap ends, in m."""
    return 0.5 * finger.base + finger.channel_height + finger.bridge


def starts(finger: PneuNet) -> list[float]:
    """Return where the air of each chamber begins along x, in m."""
    return [finger.root + k * pitch(finger) for k in range(finger.chambers)]


def air(finger: PneuNet) -> list[Box]:
    """Return the air above the base, half of it (y > 0): the chambers, then the pieces of the channel between them."""
    floor, half, duct = 0.5 * finger.base, 0.5 * finger.chamber_width, 0.5 * finger.channel_width
    chambers = [Box((x, 0.0, floor), (x + finger.chamber_length, half, ceiling(finger))) for x in starts(finger)]
    pieces = [
        Box((x - pitch(finger) + finger.chamber_length, 0.0, floor), (x, duct, floor + finger.channel_height))
        for x in starts(finger)[1:]
    ]
    return chambers + pieces


def gaps(finger: PneuNet) -> list[Box]:
    """Return the gaps between the chambers above the base, half of each; none between ribs."""
    if not finger.gap:
        return []
    begins = [x + finger.chamber_length + finger.wall for x in starts(finger)[:-1]]
    return [Box((x, 0.0, gap_floor(finger)), (x + finger.gap, half_width(finger), top(finger))) for x in begins]


def upper(finger: PneuNet) -> Box:
    """Return what lies above the base, half of it, without gaps and air."""
    return Box((0.0, 0.0, 0.5 * finger.base), (planned_length(finger), half_width(finger), top(finger)))


def planned_cavity_volume(finger: PneuNet) -> float:
    """Return the volume in m3 of the air on one side of the base."""
    return 2.0 * sum(box.volume for box in air(finger))


def planned_solid_volume(finger: PneuNet) -> float:
    """Return the volume in m3 of the whole solid."""
    above = upper(finger).volume - sum(box.volume for box in air(finger) + gaps(finger))
    return 2.0 * (finger.sides * above + planned_length(finger) * half_width(finger) * finger.base)


def planned_cells(finger: PneuNet) -> float:
    """Return the rough number of cells, within a factor of 1.5 as counted: thin walls have cells by their area, thick ones by
    volume."""
    boxes = [upper(finger), *air(finger), *gaps(finger)]
    by_area = 6.5 * finger.sides * sum(box.area for box in boxes) / finger.cell_size**2
    by_volume = 8.0 * 0.5 * planned_solid_volume(finger) / finger.cell_size**3
    return max(by_area, by_volume) * 2.0 / finger.copies


def places(finger: PneuNet) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return where walls stand along x, y (from the mirror plane) and z (from the middle of the base), rising, in m."""
    ends = [0.0, planned_length(finger)]
    for x in starts(finger):
        ends += [x, x + finger.chamber_length]
    for box in gaps(finger):
        ends += [box.low[0], box.high[0]]
    across = [0.0, 0.5 * finger.channel_width, 0.5 * finger.chamber_width, half_width(finger)]
    up = [0.0, 0.5 * finger.paper, 0.5 * finger.base, ceiling(finger), top(finger)]
    up += [0.5 * finger.base + finger.channel_height] if finger.chambers > 1 else []
    up += [gap_floor(finger)] if gaps(finger) else []
    return np.sort(ends), np.array(across), np.array(up)


def carried_points(finger: PneuNet, other: PneuNet, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return where points on the boundary lie on another finger with as many walls: linear between walls; see
    `Actuator.carried`."""
    points = np.array(points, dtype=float)
    for axis, (mine, theirs) in enumerate(zip(places(finger), places(other), strict=True)):
        order = np.argsort(mine, kind="stable")
        if len(mine) != len(theirs) or np.any(np.diff(theirs[order]) < 0.0) or finger.sides != other.sides:
            raise GeometryError("the mesh of this PneuNet cannot follow: the other one has its walls in another order")
        mine, theirs = mine[order], theirs[order]
        points[:, axis] = np.sign(points[:, axis]) * np.interp(np.abs(points[:, axis]), mine, theirs)
    return points


# ----------------------------------------------------------------------------------------------------------------------
# PneuNets with invalid parameters, detected before meshing.


MOST_CELLS = 3_000_000
"""Maximum expected number of cells; larger meshes are mostly typing errors."""

COARSEST = 10.0
"""Largest ratio of the cell size to the thinnest part: flatter cells are poor."""


SOLID = ("wall", "side_wall", "top_wall", "base", "root", "cap", "bridge")
"""Thicknesses of solid."""


def walls(finger: PneuNet) -> dict[str, float]:
    """Return every dimension in m of the solid and of the air that has a least value, by its parameter."""
    several = finger.chambers > 1
    names = ["chamber_length", "chamber_width", "chamber_height", "wall" if several else "", "side_wall", "top_wall"]
    names += ["base", "root", "cap", *(("channel_width", "channel_height") if several else ())]
    names += ["gap", "bridge"] if several and finger.gap else []
    return {name: getattr(finger, name) for name in names if name}


def check_pneunet(finger: PneuNet) -> None:
    """Check a finger's parameters against each other.

    Raises:
        GeometryError: The first parameter found impossible, with its value and the limit.
    """
    _check_walls(finger)
    if finger.chambers > 1:
        _check_channel(finger)
    _check_base(finger)
    _check_cells(finger)


def _mm(value: float) -> str:
    return shown(value, "m")


def _check_walls(finger: PneuNet) -> None:
    for name, value in walls(finger).items():
        if value < finger.least_wall * (1 - ROUNDING):
            raise GeometryError(f"{name} is {_mm(value)}, but least_wall requires {_mm(finger.least_wall)}")
    if planned_length(finger) > 0.1 * LONGEST:
        raise GeometryError(
            f"chamber_length is {_mm(finger.chamber_length)}; with {finger.chambers} chambers the finger is "
            f"{_mm(planned_length(finger))} long, and above {0.1 * LONGEST:g} m this suggests a wrong unit"
        )
    for name in ("chamber_width", "chamber_height", "side_wall", "top_wall", "base"):
        if getattr(finger, name) > 0.1 * LONGEST:
            raise GeometryError(
                f"{name} is {_mm(getattr(finger, name))}; above {_mm(0.1 * LONGEST)} this suggests a wrong unit"
            )


def _check_channel(finger: PneuNet) -> None:
    for along in ("width", "height"):
        mine, limit = getattr(finger, f"channel_{along}"), getattr(finger, f"chamber_{along}")
        if mine > limit * (1 - ROUNDING):
            raise GeometryError(
                f"channel_{along} is {_mm(mine)}; the channel between chambers is smaller than they are, so that it must be "
                f"below chamber_{along}, {_mm(limit)}"
            )
    if finger.gap and gap_floor(finger) > top(finger) - finger.least_wall:
        raise GeometryError(
            f"bridge is {_mm(finger.bridge)}; with channel_height {_mm(finger.channel_height)} no gap is left below the top at "
            f"{_mm(finger.chamber_height + finger.top_wall)} above the base; with gap 0 the chambers share their walls"
        )


def _check_base(finger: PneuNet) -> None:
    if finger.paper and finger.base - finger.paper < 2.0 * finger.least_wall * (1 - ROUNDING):
        raise GeometryError(
            f"paper is {_mm(finger.paper)}; with base {_mm(finger.base)} less than least_wall {_mm(finger.least_wall)} is "
            "left above and below it"
        )


def _check_cells(finger: PneuNet) -> None:
    solid = {name: value for name, value in walls(finger).items() if name in SOLID}
    thinnest = min(solid, key=solid.__getitem__)
    limit = COARSEST * solid[thinnest]
    if finger.cell_size > limit:
        raise GeometryError(
            f"cell_size is {_mm(finger.cell_size)}; with {thinnest} {_mm(solid[thinnest])} it must be at most {_mm(limit)}"
        )
    check_cell_count(finger.cell_size, finger.expected_cells, MOST_CELLS)


# ----------------------------------------------------------------------------------------------------------------------
# A PneuNet in Gmsh: half of it, of two sides the upper one, in its layers, with a name for every face.


CENTRAL = "middle"
"""Role of the plane z = 0 on which the upper side is mirrored into the lower one."""


def build_finger(finger: PneuNet) -> None:
    """Fill the current Gmsh model (mm) with what is meshed, its roles, its regions and its cell sizes."""
    bond(
        {"solid": [_without(upper(finger), [*air(finger), *gaps(finger)])], **_base(finger)},
        lambda tag: _role(finger, tag),
    )
    set_sizes(lambda x, y, z: finger.cell_size)


def build_whole_finger(finger: PneuNet) -> None:
    """Fill the current Gmsh model (mm) with the whole finger, one solid."""
    body = _whole(upper(finger), finger.sides)
    body = Box((*body.low[:2], body.low[2] if finger.sides == 2 else -0.5 * finger.base), body.high)
    _without(
        body, [_whole(box, finger.sides, below) for box in air(finger) + gaps(finger) for below in range(finger.sides)]
    )
    gmsh.model.occ.synchronize()


def _add(box: Box) -> Entity:
    return add_block(box.low, box.high)


def _whole(box: Box, sides: int, below: int = -1) -> Box:
    """Return a block on both sides of the mirror plane: above the base, below it (1), or from below to above (-1 of two
    sides)."""
    (x0, _, z0), (x1, y1, z1) = box.low, box.high
    if sides == 2 and below < 0:
        z0 = -z1
    elif below > 0:
        z0, z1 = -z1, -z0
    return Box((x0, -y1, z0), (x1, y1, z1))


def _without(body: Box, empty: list[Box]) -> Entity:
    """Return a block with others cut out of it."""
    return one_solid(gmsh.model.occ.cut([_add(body)], [_add(box) for box in empty])[0])


def _base(finger: PneuNet) -> dict[str, list[Entity]]:
    """Return the layers of the base by region."""
    L, w = planned_length(finger), half_width(finger)

    def layer(low: float, high: float) -> Entity:
        return _add(Box((0.0, 0.0, low), (L, w, high)))

    half, paper, lowest = 0.5 * finger.base, 0.5 * finger.paper, 0.0 if finger.sides == 2 else -0.5 * finger.base
    if not paper:
        return {"base": [layer(lowest, half)]}
    if finger.sides == 2:
        return {"base": [layer(paper, half)], "paper": [layer(0.0, paper)]}
    return {"base": [layer(paper, half), layer(lowest, -paper)], "paper": [layer(-paper, paper)]}


def _role(finger: PneuNet, tag: int) -> str:
    """Return the role of a face from the block around it, which is flat."""
    low, high = face_block(tag)
    near = 1e-6  # the kernel's blocks are a little larger than what is in them
    flat = int(np.argmin(high - low))
    at = 0.5 * float(low[flat] + high[flat])
    lowest = (CENTRAL, 0.0) if finger.sides == 2 else ("bottom", -0.5 * finger.base)
    for role, axis, place in (
        ("support", 0, 0.0),
        ("tip", 0, planned_length(finger)),
        ("plane0", 1, 0.0),
        ("top", 2, top(finger)),
        (lowest[0], 2, lowest[1]),
    ):
        if flat == axis and abs(at - place) < near:
            return role
    # One face may run along several boxes, as the base's does under the chambers and the channel.
    if all(any(box.holds(corner, corner, near) for box in air(finger)) for corner in corners_of(tag)):
        return "cavity"
    return "chamber_walls" if flat == 0 else "outer"


@register_device
@dataclasses.dataclass(frozen=True, kw_only=True)
class PneuNet(Bending, MirroredHalf, HeldTip):
    """A finger of air chambers on a base that bends towards the base.

    Lengths are in m. The middle of the base is z = 0, the clamp x = 0. Physical groups: volumes "solid", "base" (the base
    layer) and, if there is one, "paper" (a sheet in the middle of the base); surfaces "cavity" (all walls of the air; of two
    sides that above, "cavity2" below), "support" (the root's end, x = 0, clamped), "tip" (the other end), "top" (the chambers'
    outside), "bottom" (the base's outside, or the lower chambers'), "chamber_walls" (the walls in the gaps, which meet as the
    finger bends), "outer" (the sides, and the gaps' floors) and, of a half, "plane0" (y = 0).
    """

    chambers: int = choice_field(4, tuple(range(1, 31)), "number of chambers")
    sides: int = choice_field(1, (1, 2), "chambers above the base, or above and below it")
    chamber_length: float = length_field(0.005, "length of a chamber's air along the finger")
    chamber_width: float = length_field(0.012, "width of a chamber's air")
    chamber_height: float = length_field(0.012, "height of a chamber's air above the base")
    wall: float = length_field(0.001, "thickness of the walls between a chamber and a gap, or of a rib")
    side_wall: float = length_field(0.002, "thickness of the walls at the sides")
    top_wall: float = length_field(0.002, "thickness of the walls above the chambers")
    gap: float = length_field(0.0005, "gap between chambers; 0 for ribs, one wall between two chambers", zero=True)
    bridge: float = length_field(0.002, "solid between the channel and the floor of a gap", unless=("gap", 0.0))
    channel_width: float = length_field(0.004, "width of the channel that joins the chambers")
    channel_height: float = length_field(0.002, "height of the channel above the base")
    base: float = length_field(0.003, "thickness of the base layer, a region of its own")
    paper: float = length_field(
        0.0, "thickness of a sheet in the middle of the base, a region of its own; 0 for none", zero=True
    )
    root: float = length_field(0.004, "solid between the clamp and the first chamber's air")
    cap: float = length_field(0.002, "solid between the last chamber's air and the tip")
    opposite: float = number_field(
        0.0, "pressure in the chambers below the base over that above it", unless=("sides", 1)
    )
    least_wall: float = length_field(0.0003, "thinnest wall, gap and channel allowed", shape=False)
    cell_size: float = length_field(0.003, "edge length of the cells", shape=False)
    part: str = part_field("finger")
    tip: str = tip_field()

    variants: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "default": {},
        "slotted": {"wall": 0.0015, "bridge": 0.006},
        "ribbed": {"gap": 0.0, "wall": 0.002},
        "two-sided": {"sides": 2},
    }
    stem: ClassVar = "pneunet"
    pressures: ClassVar = "0:12"
    silicone: ClassVar = "ecoflex-00-30"
    faces: ClassVar = ("top", "bottom", "tip", "chamber_walls", "outer")
    unbonded: ClassVar = ()
    stiffer: ClassVar = "thicker walls (--wall, --side-wall, --top-wall), narrower chambers (--chamber-width)"
    examples: ClassVar = (
        "--chambers 6 --gap 1mm",
        "--variant slotted --bridge 5mm",
        "--variant ribbed --wall 2.5mm",
        "--base 2mm --paper 0.2mm --part full",
    )
    mesh_order: ClassVar = 2

    def check(self) -> None:
        check_pneunet(self)

    @property
    def regions(self) -> tuple[str, ...]:  # type: ignore[override]
        return ("base", "paper") if self.paper else ("base",)

    @property
    def meeting(self) -> tuple[str, ...]:
        return ("chamber_walls",) if self.gap and self.chambers > 1 else ()

    @property
    def expected_cells(self) -> float:
        return planned_cells(self)

    @property
    def size(self) -> float:
        return self.chamber_height

    @property
    def mirrors(self) -> tuple[Mirror, ...]:

        # Mirrored cells, not only shapes: nothing of the mesh then bends what symmetry keeps straight.
        below = (Mirror(CENTRAL, 2, {"top": "bottom", "cavity": "cavity2"}),) if self.sides == 2 else ()
        return (*below, *super().mirrors)

    @property
    def length(self) -> float:
        """Length from the clamp to the tip in m."""
        return planned_length(self)

    @property
    def height(self) -> float:
        """Height from the middle of the base to the chambers' outside in m."""
        return top(self)

    @property
    def probes(self) -> dict[str, Vector]:
        low = -top(self) if self.sides == 2 else -0.5 * self.base
        return {"tip": (self.length, 0.0, low), "tip_above": (self.length, 0.0, self.height)}

    @property
    def ratios(self) -> tuple[float, ...]:
        return (1.0,) if self.sides == 1 else (1.0, self.opposite)

    @property
    def cavity_volume(self) -> float:
        """Volume in m3 of the cavity; of two sides, the volume that the pressure works on: each times its ratio."""
        return planned_cavity_volume(self) * sum(self.ratios)

    @property
    def solid_volume(self) -> float:
        return planned_solid_volume(self)

    carries_interfaces: ClassVar = True

    @property
    def ratio_parameters(self) -> tuple[str, ...]:
        return ("opposite",) if self.sides == 2 else ()

    @property
    def movable(self) -> tuple[str, ...]:
        return tuple(name for name in (*walls(self), *(("paper",) if self.paper else ())))

    def carried(self, other: Self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        return carried_points(self, other, points)

    @property
    def clearances(self) -> dict[str, float]:
        return {name.replace("_", " "): value for name, value in walls(self).items()}

    def on_profile(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Report which points lie on the base's lower line in the mirror plane, from the clamp to the tip."""
        points, near = np.asarray(points, dtype=float), 1e-9 * self.length
        return (np.abs(points[:, 2] - self.probes["tip"][2]) < near) & (np.abs(points[:, 1]) < near)

    @property
    def recipe(self) -> Recipe:
        half, up, down = 0.5 * self.base, (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)
        middle = half + 0.5 * self.chamber_height
        inlets = [((0.0, 0.0, z), (self.root, 0.0, z)) for z in (middle, -middle)[: self.sides]]
        chambers = [Pour(name="chambers", up=up, level=half)]
        if self.sides == 2:
            chambers.append(Pour(name="lower chambers", up=down, level=half))
        base = Pour(name="base", up=down, level=-half, end=half, lid=False)
        paper = f"Pour half of the base, lay the sheet ({shown(self.paper, 'm')}) on it, wet it with silicone, pour the rest."
        return Recipe(
            pours=(*chambers, base),
            why="The chambers and the channel are open towards the base, which is a flat layer bonded to them.",
            inlets=tuple(inlets), steps=(paper,) if self.paper else (),
        )  # fmt: skip

    def build_whole(self) -> None:

        build_whole_finger(self)

    def build(self) -> None:

        build_finger(self)
