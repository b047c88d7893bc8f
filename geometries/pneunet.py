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

from geometries import actuator, meshing, registry
from softmodels.common import schema
from softmodels.common.errors import GeometryError
from softmodels.common.lazy import gmsh


@registry.register_device
@dataclasses.dataclass(frozen=True, kw_only=True)
class PneuNet(actuator.Finger):
    """A finger of air chambers on a base that bends towards the base.

    Lengths are in m. The middle of the base is z = 0, the clamp x = 0. Physical groups: volumes "solid", "base" (the base
    layer) and, if there is one, "paper" (a sheet in the middle of the base); surfaces "cavity" (all walls of the air; of two
    sides that above, "cavity2" below), "support" (the root's end, x = 0, clamped), "tip" (the other end), "top" (the chambers'
    outside), "bottom" (the base's outside, or the lower chambers'), "chamber_walls" (the walls in the gaps, which meet as the
    finger bends), "outer" (the sides, and the gaps' floors) and, of a half, "plane0" (y = 0).
    """

    chambers: int = schema.choice_field(4, tuple(range(1, 31)), "number of chambers")
    sides: int = schema.choice_field(1, (1, 2), "chambers above the base, or above and below it")
    chamber_length: float = schema.length_field(0.005, "length of a chamber's air along the finger")
    chamber_width: float = schema.length_field(0.012, "width of a chamber's air")
    chamber_height: float = schema.length_field(0.012, "height of a chamber's air above the base")
    wall: float = schema.length_field(0.001, "thickness of the walls between a chamber and a gap, or of a rib")
    side_wall: float = schema.length_field(0.002, "thickness of the walls at the sides")
    top_wall: float = schema.length_field(0.002, "thickness of the walls above the chambers")
    gap: float = schema.length_field(0.0005, "gap between chambers; 0 for ribs, one wall between two chambers", zero=True)
    bridge: float = schema.length_field(0.002, "solid between the channel and the floor of a gap", unless=("gap", 0.0))
    channel_width: float = schema.length_field(0.004, "width of the channel that joins the chambers")
    channel_height: float = schema.length_field(0.002, "height of the channel above the base")
    base: float = schema.length_field(0.003, "thickness of the base layer, a region of its own")
    paper: float = schema.length_field(
        0.0, "thickness of a sheet in the middle of the base, a region of its own; 0 for none", zero=True
    )
    root: float = schema.length_field(0.004, "solid between the clamp and the first chamber's air")
    cap: float = schema.length_field(0.002, "solid between the last chamber's air and the tip")
    opposite: float = schema.number_field(
        0.0, "pressure in the chambers below the base over that above it", unless=("sides", 1)
    )
    least_wall: float = schema.length_field(0.0003, "thinnest wall, gap and channel allowed", shape=False)
    cell_size: float = schema.length_field(0.003, "edge length of the cells", shape=False)
    part: str = actuator.part_field("finger")
    tip: str = actuator.tip_field()

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

    def check(self) -> None:
        self.check_walls(self.walls, "chamber_length", "chambers")
        for name in ("chamber_width", "chamber_height", "side_wall", "top_wall", "base"):
            if getattr(self, name) > 0.1 * schema.MAX_LENGTH:
                self.reject(name, f"above {schema.shown(0.1 * schema.MAX_LENGTH, 'm')} this suggests a wrong unit")
        for along in ("width", "height") if self.chambers > 1 else ():
            if getattr(self, f"channel_{along}") > getattr(self, f"chamber_{along}") * (1 - schema.BOUND_TOLERANCE):
                chamber = self.told(f"chamber_{along}")
                why = "the channel between chambers is smaller than they are, so that it must be below"
                self.reject(f"channel_{along}", f"{why} {chamber}")
        if self.gaps and self.gap_floor > self.height - self.least_wall:
            self.reject(
                "bridge",
                f"with {self.given('channel_height')} no gap is left below the top at "
                f"{schema.shown(self.chamber_height + self.top_wall, 'm')} above the base; with gap 0 the chambers "
                "share their walls",
            )
        if self.paper and self.base - self.paper < 2.0 * self.least_wall * (1 - schema.BOUND_TOLERANCE):
            self.reject("paper", f"with {self.given('base')} less than {self.given('least_wall')} is left above and below it")
        self.check_cells(name for name in self.walls if name in SOLID)

    @property
    def walls(self) -> dict[str, float]:
        """Every dimension in m of the solid and of the air that has a least value, by its parameter."""
        several = self.chambers > 1
        names = ["chamber_length", "chamber_width", "chamber_height", "wall" if several else "", "side_wall", "top_wall"]
        names += ["base", "root", "cap", *(("channel_width", "channel_height") if several else ())]
        names += ["gap", "bridge"] if several and self.gap else []
        return {name: getattr(self, name) for name in names if name}

    @property
    def pitch(self) -> float:
        """From a chamber to the next one in m."""
        return self.chamber_length + (2.0 * self.wall + self.gap if self.gap else self.wall)

    @property
    def half_width(self) -> float:
        """From the mirror plane to the side in m."""
        return 0.5 * self.chamber_width + self.side_wall

    @property
    def gap_floor(self) -> float:
        """Height at which a gap ends in m."""
        return 0.5 * self.base + self.channel_height + self.bridge

    @property
    def starts(self) -> list[float]:
        """Where the air of each chamber begins along x in m."""
        return [self.root + k * self.pitch for k in range(self.chambers)]

    @property
    def air(self) -> list[Box]:
        """The air above the base, half of it (y > 0): the chambers, then the pieces of the channel between them."""
        floor, half, duct = 0.5 * self.base, 0.5 * self.chamber_width, 0.5 * self.channel_width
        ceiling, starts, wide = floor + self.chamber_height, self.starts, self.chamber_length
        chambers = [Box((x, 0.0, floor), (x + wide, half, ceiling)) for x in starts]
        rise = floor + self.channel_height
        return chambers + [Box((x - self.pitch + wide, 0.0, floor), (x, duct, rise)) for x in starts[1:]]

    @property
    def gaps(self) -> list[Box]:
        """The gaps between the chambers above the base, half of each; none between ribs."""
        begins = [x + self.chamber_length + self.wall for x in self.starts[:-1]] if self.gap else []
        return [Box((x, 0.0, self.gap_floor), (x + self.gap, self.half_width, self.height)) for x in begins]

    @property
    def upper(self) -> Box:
        """What lies above the base, half of it, without gaps and air."""
        return Box((0.0, 0.0, 0.5 * self.base), (self.length, self.half_width, self.height))

    @property
    def places(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Where walls stand along x, y (from the mirror plane) and z (from the middle of the base), rising, in m."""
        ends = [0.0, self.length]
        for x in self.starts:
            ends += [x, x + self.chamber_length]
        for box in self.gaps:
            ends += [box.low[0], box.high[0]]
        half = 0.5 * self.base
        across = [0.0, 0.5 * self.channel_width, 0.5 * self.chamber_width, self.half_width]
        up = [0.0, 0.5 * self.paper, half, half + self.chamber_height, self.height]
        up += [half + self.channel_height] if self.chambers > 1 else []
        up += [self.gap_floor] if self.gaps else []
        return np.sort(ends), np.array(across), np.array(up)

    @property
    def regions(self) -> tuple[str, ...]:  # type: ignore[override]
        return ("base", "paper") if self.paper else ("base",)

    @property
    def meeting(self) -> tuple[str, ...]:
        return ("chamber_walls",) if self.gap and self.chambers > 1 else ()

    @property
    def expected_cells(self) -> float:
        by_area = 6.5 * self.sides * sum(box.area for box in (self.upper, *self.air, *self.gaps)) / self.cell_size**2
        by_volume = 8.0 * 0.5 * self.solid_volume / self.cell_size**3  # thick walls have cells by their volume
        return max(by_area, by_volume) * 2.0 / self.copies

    @property
    def size(self) -> float:
        return self.chamber_height

    @property
    def mirrors(self) -> tuple[meshing.Mirror, ...]:
        # Mirrored cells, not only shapes: nothing of the mesh then bends what symmetry keeps straight.
        below = (meshing.Mirror(CENTRAL, 2, {"top": "bottom", "cavity": "cavity2"}),) if self.sides == 2 else ()
        return (*below, *super().mirrors)

    @property
    def length(self) -> float:
        """Length from the clamp to the tip in m."""
        return self.root + (self.chambers - 1) * self.pitch + self.chamber_length + self.cap

    @property
    def height(self) -> float:
        """Height from the middle of the base to the chambers' outside in m."""
        return 0.5 * self.base + self.chamber_height + self.top_wall

    @property
    def probes(self) -> dict[str, Vector]:
        low = -self.height if self.sides == 2 else -0.5 * self.base
        return {"tip": (self.length, 0.0, low), "tip_above": (self.length, 0.0, self.height)}

    @property
    def ratios(self) -> tuple[float, ...]:
        return (1.0,) if self.sides == 1 else (1.0, self.opposite)

    @property
    def cavity_volume(self) -> float:
        """Volume in m3 of the cavity; of two sides, the volume that the pressure works on: each times its ratio."""
        return 2.0 * sum(box.volume for box in self.air) * sum(self.ratios)

    @property
    def solid_volume(self) -> float:
        above = self.upper.volume - sum(box.volume for box in self.air + self.gaps)
        return 2.0 * (self.sides * above + self.length * self.half_width * self.base)

    carries_interfaces: ClassVar = True

    @property
    def ratio_parameters(self) -> tuple[str, ...]:
        return ("opposite",) if self.sides == 2 else ()

    @property
    def movable(self) -> tuple[str, ...]:
        return (*self.walls, *(("paper",) if self.paper else ()))

    def carried(self, other: Self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        points = np.array(points, dtype=float)
        for axis, (mine, theirs) in enumerate(zip(self.places, other.places, strict=True)):  # linear between walls
            order = np.argsort(mine, kind="stable")
            if len(mine) != len(theirs) or np.any(np.diff(theirs[order]) < 0.0) or self.sides != other.sides:
                raise GeometryError("the mesh of this PneuNet cannot follow: the other one has its walls in another order")
            points[:, axis] = np.sign(points[:, axis]) * np.interp(np.abs(points[:, axis]), mine[order], theirs[order])
        return points

    @property
    def clearances(self) -> dict[str, float]:
        return {name.replace("_", " "): value for name, value in self.walls.items()}

    @property
    def recipe(self) -> actuator.Recipe:
        half, up, down = 0.5 * self.base, (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)
        middle = half + 0.5 * self.chamber_height
        inlets = [((0.0, 0.0, z), (self.root, 0.0, z)) for z in (middle, -middle)[: self.sides]]
        chambers = [actuator.Pour(name="chambers", up=up, level=half)]
        if self.sides == 2:
            chambers.append(actuator.Pour(name="lower chambers", up=down, level=half))
        base = actuator.Pour(name="base", up=down, level=-half, end=half, lid=False)
        paper = (
            f"Pour half of the base, lay the sheet ({schema.shown(self.paper, 'm')}) on it, wet it with silicone, "
            "pour the rest."
        )
        return actuator.Recipe(
            pours=(*chambers, base),
            why="The chambers and the channel are open towards the base, which is a flat layer bonded to them.",
            inlets=tuple(inlets), steps=(paper,) if self.paper else (),
        )  # fmt: skip

    def build_whole(self) -> None:
        body = _mirrored_block(self.upper, self.sides)
        body = Box((*body.low[:2], body.low[2] if self.sides == 2 else -0.5 * self.base), body.high)
        _cut_block(
            body, [_mirrored_block(box, self.sides, below) for box in self.air + self.gaps for below in range(self.sides)]
        )
        gmsh.model.occ.synchronize()

    def build(self) -> None:
        """Fill the current Gmsh model (mm) with what is meshed, its roles, its regions and its cell sizes."""
        solid = _cut_block(self.upper, [*self.air, *self.gaps])
        meshing.bond({"solid": [solid], **_base(self)}, lambda tag: _role(self, tag))
        meshing.set_sizes(lambda x, y, z: self.cell_size)


# ----------------------------------------------------------------------------------------------------------------------
# Where the walls of a PneuNet are: all stand square to the axes, so that a list of positions along each axis defines them.


Vector = tuple[float, float, float]


@dataclasses.dataclass(frozen=True)
class Box:
    """A block with sides along the axes, in m, by its corners with the smallest and the largest coordinates."""

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


# ----------------------------------------------------------------------------------------------------------------------
# A PneuNet in Gmsh: half of it, of two sides the upper one, in its layers, with a name for every face.


SOLID = ("wall", "side_wall", "top_wall", "base", "root", "cap", "bridge")
"""Thicknesses of solid."""

CENTRAL = "middle"
"""Role of the plane z = 0 on which the upper side is mirrored into the lower one."""


def _add(box: Box) -> meshing.Entity:
    return meshing.add_block(box.low, box.high)


def _mirrored_block(box: Box, sides: int, below: int = -1) -> Box:
    """Return a block on both sides of the mirror plane: above the base, below it (1), or from below to above (-1 of two
    sides)."""
    (x0, _, z0), (x1, y1, z1) = box.low, box.high
    if sides == 2 and below < 0:
        z0 = -z1
    elif below > 0:
        z0, z1 = -z1, -z0
    return Box((x0, -y1, z0), (x1, y1, z1))


def _cut_block(body: Box, empty: list[Box]) -> meshing.Entity:
    return meshing.one_solid(gmsh.model.occ.cut([_add(body)], [_add(box) for box in empty])[0])


def _base(finger: PneuNet) -> dict[str, list[meshing.Entity]]:
    """Return the layers of the base by region."""
    L, w = finger.length, finger.half_width

    def layer(low: float, high: float) -> meshing.Entity:
        return _add(Box((0.0, 0.0, low), (L, w, high)))

    half, paper, lowest = 0.5 * finger.base, 0.5 * finger.paper, 0.0 if finger.sides == 2 else -0.5 * finger.base
    if not paper:
        return {"base": [layer(lowest, half)]}
    if finger.sides == 2:
        return {"base": [layer(paper, half)], "paper": [layer(0.0, paper)]}
    return {"base": [layer(paper, half), layer(lowest, -paper)], "paper": [layer(-paper, paper)]}


def _role(finger: PneuNet, tag: int) -> str:
    """Return the role of a face from the block around it, which is flat."""
    low, high = meshing.face_block(tag)
    near = 1e-6  # the kernel's blocks are a little larger than what is in them
    flat = int(np.argmin(high - low))
    at = 0.5 * float(low[flat] + high[flat])
    lowest = (CENTRAL, 0.0) if finger.sides == 2 else ("bottom", -0.5 * finger.base)
    for role, axis, place in (
        ("support", 0, 0.0),
        ("tip", 0, finger.length),
        ("plane0", 1, 0.0),
        ("top", 2, finger.height),
        (lowest[0], 2, lowest[1]),
    ):
        if flat == axis and abs(at - place) < near:
            return role
    # One face may run along several boxes, as the base's does under the chambers and the channel.
    if all(any(box.holds(corner, corner, near) for box in finger.air) for corner in meshing.corners_of(tag) / meshing.MM_PER_M):
        return "cavity"
    return "chamber_walls" if flat == 0 else "outer"
