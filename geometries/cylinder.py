"""A tube closed by a cap, as fibre-reinforced actuators and McKibben muscles are cast before they are wound.

The half profile, with the axis of symmetry z on the left::

    z
    |______________   height = length + cap
    |     cap      |
    |________      |  length
    |        |     |
    | cavity | wall|
    |        |     |
    |________|_____|__ r
    0  inner radius  outer radius = inner radius + wall

The cavity is open at the bottom, where a fitting closes it. The wall is a straight tube as far as its inner corner is not
rounded; what is above belongs to the cap.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections import defaultdict
from collections.abc import Callable, Mapping
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from geometries import actuator, meshing, registry, revolved
from geometries.actuator import Hold, Vector
from softmodels.common import schema
from softmodels.common.lazy import gmsh


@registry.register_device
@dataclasses.dataclass(frozen=True, kw_only=True)
class Cylinder(actuator.Sectioned, actuator.Halved):
    """A tube closed by a cap: straight as an axisymmetric section, bending as half of it, twisting as the whole.

    Lengths are in m, angles in degrees. Physical groups: cells "wall" (the straight tube) and "cap"; facets "cavity",
    "support" (the bottom ring), "outer" (around the wall), "strip" (the part of it that looks along x, if it has one), "side"
    (around the cap) and "end" (the cap's top); "plane0" (y = 0) in a half, the curve "axis" in a section. Where nothing else
    holds them, a half has the point "anchor0" (on y, at the bottom), the whole also "anchor1" (across) and "anchor2" (on x).
    """

    inner_radius: float = schema.length_field(0.006, "radius of the cavity")
    wall: float = schema.length_field(0.002, "thickness of the wall")
    length: float = schema.length_field(0.060, "length of the cavity, from the base to the cap")
    cap: float = schema.length_field(0.004, "thickness of the cap")
    fillet: float = schema.length_field(0.001, "radius of the rounding where the wall meets the cap; 0 for none", zero=True)
    section: str = schema.choice_field(
        "axisymmetric", ("axisymmetric", "half", "whole"), "profile in radius and height, solid half (y > 0), or all of it"
    )
    strip: float = schema.angle_field(
        0.0,
        "angle around the axis of the strip along the wall, about the x axis, to which a sheet can be bonded; 0 for none",
        unless=("section", "axisymmetric"),
    )
    base: str = schema.choice_field(
        "held", ("held", "sliding"), "bottom ring clamped, or held only along z: half of a tube with two caps"
    )
    end: str = schema.choice_field("free", ("free", "sliding", "held"), "cap's top free, held only along z, or clamped")
    cell_size: float = schema.length_field(0.002, "edge length of the cells", shape=False)
    order: int = schema.choice_field(2, (1, 2), "order of the cells' geometry: 1 straight, 2 curved edges")

    stem: ClassVar = "cylinder"
    variable: ClassVar = ("wall",)
    unbonded: ClassVar = ()
    axial: ClassVar = True
    regions: ClassVar = ("wall", "cap")
    pressures: ClassVar = "0:60"
    stiffer: ClassVar = "a thicker wall (--wall), a smaller cavity (--inner-radius)"
    examples: ClassVar = ("--wall 3mm --length 80mm", "--variant bending", "--section whole --base sliding")
    variants: ClassVar = {
        "default": {},
        "bending": {"section": "half", "strip": 120.0},
        "twisting": {"section": "whole", "length": 0.040, "cell_size": 0.004},
    }

    most_cells: ClassVar = 5_000_000

    def check(self) -> None:
        self.check_below("fillet", "inner_radius")
        if not 0.2 * self.outer_radius <= self.length <= 200.0 * self.outer_radius:
            self.reject("length", f"it must be between 0.2 and 200 times {self.told('outer_radius')}")
        self.check_most("fillet", 0.4, "length")
        self.check_most("wall", 20.0, "inner_radius")
        if self.outer_radius > 500.0 * self.wall:
            self.reject("wall", f"it must be at least 1/500 of {self.told('outer_radius')}")
        self.check_most("cap", 20.0, "outer_radius")
        given = f"with {self.given('cap')} or {self.given('wall')} "
        self.check_size("length", self.outer_radius, self.height, given=given)
        if self.section == "axisymmetric" and self.strip:
            self.reject("strip", "an axisymmetric section cannot have a strip; use section half")
        if self.strip and not MIN_STRIP_ANGLE <= self.strip <= MAX_STRIP_ANGLE:
            self.reject("strip", f"it must be 0 (none) or lie between {MIN_STRIP_ANGLE:g} and {MAX_STRIP_ANGLE:g} deg")
        self.check_most("cell_size", actuator.MAX_CELL_SIZE_RATIO, "wall")
        self.check_most("cell_size", actuator.MAX_CELL_SIZE_RATIO, "cap")
        self.check_most("cell_size", 1.0, "length")
        self.check_count(f" with {self.given('wall', 'fillet')}")

    @property
    def faces(self) -> tuple[str, ...]:  # type: ignore[override]
        """See `Actuator.faces`; a sheet around a device without a strip is bonded to all of the wall."""
        return ("outer", "strip", "side", "end") if self.stripped else ("outer", "side", "end")

    @property
    def stripped(self) -> bool:
        """Whether part of the outside is a strip."""
        return self.dimension == 3 and self.strip > 0.0

    @property
    def expected_cells(self) -> float:
        wall, cap, arc = cell_sizes(self)
        radius, outer = self.inner_radius, self.outer_radius
        if self.dimension == 2:
            return (self.wall * self.length / wall**2 + outer * self.cap / cap**2 + 20.0) / revolved.TRIANGLE_AREA
        share = math.pi if self.section == "whole" else 0.5 * math.pi
        ring = 2.0 * radius * self.fillet**2 / arc**3 if self.fillet else 0.0
        tube = (outer**2 - radius**2) * self.length / wall**3
        return share * (tube + outer**2 * self.cap / cap**3 + ring) / revolved.TETRAHEDRON_VOLUME

    @property
    def halved(self) -> bool:
        return self.section == "half"

    @property
    def fuller(self) -> str:
        return "--section whole"

    @property
    def size(self) -> float:
        return self.inner_radius

    @property
    def outer_radius(self) -> float:
        """Radius of the outside in m."""
        return self.inner_radius + self.wall

    @property
    def straight(self) -> float:
        """Height in m up to which the wall is a straight tube."""
        return self.length - self.fillet

    @property
    def height(self) -> float:
        """Height of the end in m."""
        return self.length + self.cap

    @property
    def holds(self) -> tuple[Hold, ...]:
        held = Hold("support", None if self.base == "held" else self.lift)
        ends = () if self.end == "free" else (Hold("end", None if self.end == "held" else self.lift),)
        if self.dimension == 2:
            return (held, *self.axis_holds, *ends)
        if self.base == "held" or self.end == "held":
            return (held, *ends)
        # What slides still moves as a whole along x, and in the whole tube along y and about z.
        x, y = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
        anchors = {"anchor0": x} if self.section == "half" else {"anchor0": x, "anchor1": x, "anchor2": y}
        return (held, *ends, *(Hold(name, along, point=True) for name, along in anchors.items()))

    @property
    def anchors(self) -> dict[str, Vector]:
        """Coordinates of the points of `holds` in m."""
        radius = self.outer_radius
        places = {"anchor0": (0.0, radius, 0.0), "anchor1": (0.0, -radius, 0.0), "anchor2": (radius, 0.0, 0.0)}
        return {hold.role: places[hold.role] for hold in self.holds if hold.point}

    @property
    def probes(self) -> dict[str, Vector]:
        radius, middle, height = self.outer_radius, 0.5 * self.length, self.height
        near = {"end": (0.0, 0.0, height), "rim": (radius, 0.0, height), "side": (radius, 0.0, middle)}
        if self.dimension == 2:
            return near
        return {**near, "far_rim": (-radius, 0.0, height), "far_side": (-radius, 0.0, middle)}

    @property
    def blocked(self) -> str | None:
        return None if self.end == "free" else "end"

    @property
    def pushed(self) -> str | None:
        return "end" if self.end == "free" else None

    figure_texts: ClassVar[Mapping[str, tuple[str, str, str]]] = {
        "elongation_percent": (
            "", "elongation", "rise of the end's rim over the device's height; the mean of two sides in a solid model",
        ),
        "diameter": ("mm", "diameter", "of the outside half way up the cavity"),
        "bend_angle": ("deg", "bend", "angle by which the end has turned towards x, in the plane y = 0"),
        "twist": ("deg", "twist", "angle by which the end has turned about the axis"),
        "tip_x": ("mm", "tip place x", "x of the middle of the end, from the axis as cast"),
    }  # fmt: skip

    def device_figures(self, places: Mapping[str, Vector]) -> dict[str, float]:
        """Return the elongation and diameter; bend of a half, twist of a whole tube; see `Actuator.device_figures`.

        Angles are known up to half a turn.
        """
        now = {name: np.asarray(place, dtype=float) for name, place in places.items()}
        if self.dimension == 2:
            rise, diameter = now["rim"][2] - self.height, 2.0 * now["side"][0]
            return {"elongation_percent": 100.0 * rise / self.height, "diameter": diameter}
        rise = 0.5 * (now["rim"][2] + now["far_rim"][2]) - self.height
        across = now["rim"] - now["far_rim"]
        figures = {
            "elongation_percent": 100.0 * rise / self.height,
            "diameter": float(np.linalg.norm(now["side"] - now["far_side"])),
            "bend_angle": math.atan2(-across[2], across[0]),
        }
        if self.section == "whole":
            figures["twist"] = math.atan2(across[1], across[0])
        return figures | {"tip_x": now["end"][0]}

    @property
    def movable(self) -> tuple[str, ...]:
        return tuple(name for name in super().movable if name != "strip")

    def carried(self, other: Self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the points of the boundary at the same share of the same edge of the other's outline; see
        `Actuator.carried`."""
        revolved.check_alike(self, other, ("section", "strip", "base", "end"), ("fillet",))
        return revolved.carried_along(outline(self), outline(other), points, self.outer_radius)

    @property
    def clearances(self) -> dict[str, float]:
        flat, upright = self.inner_radius - self.fillet, self.straight
        return {"wall": self.wall, "cap": self.cap, "flat part of the ceiling": flat, "straight part of the wall": upright}

    @property
    def cavity_volume(self) -> float:
        return math.pi * (self.inner_radius**2 * self.length - revolved.rounded_off(self.inner_radius, self.fillet))

    @property
    def solid_volume(self) -> float:
        return math.pi * self.outer_radius**2 * self.height - self.cavity_volume

    def on_profile(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Report which points lie on the outline from the base up the side at +x and over the end to the axis."""
        points = np.asarray(points, dtype=float)
        near = 1e-9 * self.height
        x, y, z = points.T
        side, top = np.abs(x - self.outer_radius) < near, np.abs(z - self.height) < near
        return (np.abs(y) < near) & (side | (top & (x > -near)))

    def along_profile(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(np.hypot(points[:, 0], points[:, 1]) + self.height - points[:, 2])

    @property
    def recipe(self) -> actuator.Recipe:
        tube = actuator.Pour(name="tube", up=self.lift, level=0.0, sideways=(0.0, 1.0, 0.0), gate=self.height)
        return actuator.Recipe(
            pours=(tube,),
            wound=(self.outer_radius, 0.0, self.straight),
            why="The outside opens in two halves; the cavity's rod stands on the lid and leaves through the open end.",
        )

    def build_whole(self) -> None:
        occ = gmsh.model.occ
        (wall, cap), _ = _profile(self, lambda r, z: (meshing.MM_PER_M * r, 0.0, meshing.MM_PER_M * z))
        revolved.turn_fully(occ.fuse([(2, wall)], [(2, cap)])[0][0][1])

    def build(self) -> None:
        build_section(self) if self.dimension == 2 else build_solid(self)


# ----------------------------------------------------------------------------------------------------------------------
# How large the cells of a cylinder are.


MIN_STRIP_ANGLE, MAX_STRIP_ANGLE = 30.0, 330.0
"""Least and largest angle of the strip in degrees: what is left of the circle on either side needs cells of its own."""

WIDEST_PIECE = 90.0
"""Largest angle in degrees of one revolution step: the CAD kernel leaves a seam in a full turn, without a vertex at its
centre."""

CELLS_THROUGH_WALL = {2: 2, 3: 1}
"""Cells through the wall and the cap, by dimension; they are quadratic."""

ALONG_ARC = 2
"""Cells along the fillet's quarter circle."""

ACROSS_PIECE = 0.6
"""Largest cell size in the wall, in arcs of the narrowest piece that the strip's edges cut out of it."""


def azimuths(device: Cylinder, stripped: bool) -> list[float]:
    """Return the azimuths in degrees between which a face is turned to make the solid.

    They are the x axis, where probes are, the y axis, if points are held on it, and the strip's edges, if they are asked for.
    """
    marks = sorted({0.0, 180.0, *([0.5 * device.strip] if stripped else []), *([90.0] if device.anchors else [])})
    half = [0.0]
    for mark in marks[1:]:
        pieces = math.ceil((mark - half[-1]) / WIDEST_PIECE)
        half += [half[-1] + (mark - half[-1]) * k / pieces for k in range(1, pieces + 1)]
    return half if device.section == "half" else [*half, *(360.0 - angle for angle in half[-2::-1])]


def cell_sizes(device: Cylinder) -> tuple[float, float, float]:
    """Cell sizes in m in the wall, in the cap and along the fillet."""
    through = CELLS_THROUGH_WALL[device.dimension]
    wall, cap = (min(device.cell_size, part / through) for part in (device.wall, device.cap))
    if device.stripped:  # cells as wide as a piece of the wall come out flat
        narrowest = min(b - a for a, b in itertools.pairwise(azimuths(device, True)))
        wall = min(wall, ACROSS_PIECE * math.radians(narrowest) * device.inner_radius)
    arc = 0.5 * math.pi * device.fillet / ALONG_ARC if device.fillet else math.inf
    return wall, cap, min(wall, cap, arc)


# ----------------------------------------------------------------------------------------------------------------------
# The closed tube's half profile as edges between corners, along which points are carried to another tube.


def outline(tube: Cylinder) -> list[revolved.Side]:
    """Return the half profile in m, against the clock from the foot of the cavity's wall; without the axis below the
    ceiling."""
    inner, outer, fillet = tube.inner_radius, tube.outer_radius, tube.fillet
    straight, length, height = tube.straight, tube.length, tube.height
    corner, root = (inner - fillet, length), (inner, straight)
    arc = [revolved.Side(corner, root, 1, "cavity", (inner - fillet, straight), (fillet, fillet))] if fillet else []
    return [
        revolved.Side((inner, 0.0), (outer, 0.0), 1, "support"),
        revolved.Side((outer, 0.0), (outer, 0.5 * length), 1, "outer"),
        revolved.Side((outer, 0.5 * length), (outer, straight), 1, "outer"),
        revolved.Side((outer, straight), (outer, height), 1, "side"),
        revolved.Side((outer, height), (0.0, height), 1, "end"),
        revolved.Side((0.0, height), (0.0, length), 1, "axis"),
        revolved.Side((0.0, length), corner, 1, "cavity"),
        *arc,
        revolved.Side(root, (inner, 0.0), 1, "cavity"),
    ]


# ----------------------------------------------------------------------------------------------------------------------
# The closed tube in Gmsh: one profile of two faces, meshed flat or turned around the axis.


CELL_SIZE_GROWTH = 0.5
"""Growth of the cell size per distance from the fillet and the cap."""

Edges = list[tuple[int, str]]


def build_section(device: Cylinder) -> None:
    """Fill the current Gmsh model with the axisymmetric profile: x is the radius, y the height (m)."""
    (wall, cap), edges = _profile(device, lambda r, z: (r, z, 0.0))
    gmsh.model.occ.synchronize()
    roles: dict[str, list[int]] = defaultdict(list)
    for tag, role in edges:
        roles[role].append(tag)
    meshing.name_groups(2, {"wall": [wall], "cap": [cap]})
    meshing.name_groups(1, roles)
    size = _size(device)
    gmsh.model.mesh.setSizeCallback(lambda dim, tag, x, y, z, other: size(x, y))


def build_solid(device: Cylinder) -> None:
    """Fill the current Gmsh model with half of the tube (y > 0) or all of it (m)."""
    occ = gmsh.model.occ
    (wall, cap), _ = _profile(device, lambda r, z: (r, 0.0, z))
    volumes = []
    # The strip's edges cut only the wall: wedges of the cap would have needles for cells along the axis.
    for face, cuts in ((wall, azimuths(device, device.stripped)), (cap, azimuths(device, False))):
        for start, stop in itertools.pairwise(cuts):
            copy = occ.copy([(2, face)])
            occ.rotate(copy, 0, 0, 0, 0, 0, 1, math.radians(start))
            turned = occ.revolve(copy, 0, 0, 0, 0, 0, 1, math.radians(stop - start))
            volumes += [entity for entity in turned if entity[0] == 3]
    occ.fragment(volumes[:1], volumes[1:])
    occ.remove([(2, wall), (2, cap)], recursive=True)
    occ.synchronize()
    regions: dict[str, list[int]] = defaultdict(list)
    for _, tag in gmsh.model.getEntities(3):
        regions["cap" if occ.getCenterOfMass(3, tag)[2] > device.straight else "wall"].append(tag)
    meshing.name_groups(3, regions)
    meshing.name_boundary(lambda tag: _role(device, tag))
    for role, place in device.anchors.items():
        meshing.name_groups(0, {role: meshing.points_at(place, 1e-7 * device.outer_radius)})
    size = _size(device)
    gmsh.model.mesh.setSizeCallback(lambda dim, tag, x, y, z, other: size(math.hypot(x, y), z))


def _profile(device: Cylinder, at: Callable[[float, float], tuple[float, float, float]]) -> tuple[tuple[int, int], Edges]:
    """Add the wall's and the cap's face; return their tags, and the edges on the boundary with their roles. ``at`` makes a
    point in space of radius and height."""
    occ = gmsh.model.occ
    inner, outer, fillet = device.inner_radius, device.outer_radius, device.fillet
    straight, length, height = device.straight, device.length, device.height

    def point(r: float, z: float) -> int:
        return int(occ.addPoint(*at(r, z)))

    foot, toe, middle = point(inner, 0.0), point(outer, 0.0), point(outer, 0.5 * length)
    shoulder, root = point(outer, straight), point(inner, straight)
    rim, apex, ceiling = point(outer, height), point(0.0, height), point(0.0, length)
    joint = occ.addLine(shoulder, root)
    edges: Edges = [
        (occ.addLine(foot, toe), "support"),
        (occ.addLine(toe, middle), "outer"),
        (occ.addLine(middle, shoulder), "outer"),
        (occ.addLine(root, foot), "cavity"),
    ]
    wall = occ.addPlaneSurface([occ.addCurveLoop([*(tag for tag, _ in edges[:3]), joint, edges[3][0]])])
    upper: Edges = [(occ.addLine(shoulder, rim), "side"), (occ.addLine(rim, apex), "end"), (occ.addLine(apex, ceiling), "axis")]
    corner = root
    if fillet:
        corner, centre = point(inner - fillet, length), point(inner - fillet, straight)
        arc = [(occ.addCircleArc(corner, centre, root), "cavity")]
        occ.remove([(0, centre)])
    else:
        arc = []
    upper += [(occ.addLine(ceiling, corner), "cavity"), *arc]
    cap = occ.addPlaneSurface([occ.addCurveLoop([-joint, *(tag for tag, _ in upper)])])
    return (wall, cap), [*edges, *upper]


def _size(device: Cylinder) -> Callable[[float, float], float]:
    """Return the cell size in m as a function of radius and height in m."""
    wall, cap, arc = cell_sizes(device)
    ring = (device.inner_radius - 0.3 * device.fillet, device.length - 0.3 * device.fillet)

    def size(r: float, z: float) -> float:
        above = max(0.0, z - device.straight)
        return min(
            wall + CELL_SIZE_GROWTH * above,
            cap + CELL_SIZE_GROWTH * max(0.0, device.length - z),
            arc + CELL_SIZE_GROWTH * max(0.0, math.hypot(r - ring[0], z - ring[1]) - device.fillet),
        )

    return size


def _role(device: Cylinder, tag: int) -> str:
    """Return the role of a face from where its corners and its centre of mass are."""
    near = 1e-7 * device.outer_radius
    x, y, z = meshing.corners_of(tag).T
    centre = np.array(gmsh.model.occ.getCenterOfMass(2, tag))
    if device.section == "half" and max(np.abs(y).max(), abs(centre[1])) < near:
        return "plane0"
    for role, height in (("support", 0.0), ("end", device.height)):
        if np.abs(z - height).max() < near:
            return role
    if np.abs(np.hypot(x, y) - device.outer_radius).max() > near:
        return "cavity"
    if centre[2] > device.straight:
        return "side"
    azimuth = math.degrees(math.atan2(centre[1], centre[0]))
    return "strip" if device.stripped and abs(azimuth) < 0.5 * device.strip else "outer"
