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

from geometries.actuator import Halved, Hold, Pour, Recipe, Sectioned, Vector, parameter, parameter_names
from geometries.meshing import MM, check_cell_count, place_of
from geometries.registry import register_device
from geometries.revolved import Side, carried_along
from softmodels.common.errors import GeometryError, MeshingError
from softmodels.common.names import lazy_module
from softmodels.common.schema import LONGEST, angle_field, choice_field, length_field, shown

gmsh = lazy_module("gmsh")

# ----------------------------------------------------------------------------------------------------------------------
# Cylinders with invalid parameters, detected before meshing; and how many cells to expect.


MOST_CELLS = 5_000_000
"""Maximum expected number of cells; larger meshes are mostly typing errors."""

SLIMMEST, FLATTEST = 200.0, 0.2
"""Largest and smallest length of the cavity in outer radii."""

THINNEST = 500.0
"""Largest outer radius in walls; a thinner one is a membrane and needs cells as small."""

THICKEST = 20.0
"""Largest wall in inner radii, and cap in outer ones."""

COARSEST = 10.0
"""Largest ratio of the cell size to the wall or the cap; the size grades too steeply beyond it."""

NARROWEST, WIDEST = 30.0, 330.0
"""Least and largest angle of the strip in degrees: what is left of the circle on either side needs cells of its own."""

WIDEST_PIECE = 90.0
"""Largest angle in degrees of one revolution step: the CAD kernel leaves a seam in a full turn, without a vertex at its
centre."""

THROUGH = {2: 2, 3: 1}
"""Cells through the wall and the cap, by dimension; they are quadratic."""

ALONG_ARC = 2
"""Cells along the fillet's quarter circle."""

ACROSS_PIECE = 0.6
"""Largest cell size in the wall, in arcs of the narrowest piece that the strip's edges cut out of it."""

TRIANGLE, TETRAHEDRON = 0.43, 0.12
"""Area and volume of a regular cell with edges of length 1."""


def check_cylinder(device: Cylinder) -> None:
    """Check a cylinder's parameters against each other.

    Raises:
        GeometryError: The first parameter found impossible, with its value and the limit.
    """
    _check_shape(device)
    if device.section == "axisymmetric" and device.strip:
        raise GeometryError(
            f"strip is {shown(device.strip, 'degree')}; an axisymmetric section cannot have a strip; use section half"
        )
    if device.strip and not NARROWEST <= device.strip <= WIDEST:
        raise GeometryError(
            f"strip is {shown(device.strip, 'degree')}; it must be 0 (none) or lie between {NARROWEST:g} and {WIDEST:g} deg"
        )
    for part in ("wall", "cap"):
        if device.cell_size > COARSEST * getattr(device, part):
            raise GeometryError(
                f"cell_size is {shown(device.cell_size, 'm')}; it must be at most {COARSEST:g} times {part}, "
                f"{shown(getattr(device, part), 'm')}"
            )
    if device.cell_size > device.length:
        raise GeometryError(
            f"cell_size is {shown(device.cell_size, 'm')}; it must be at most length, {shown(device.length, 'm')}"
        )
    more = f" with wall {shown(device.wall, 'm')} and fillet {shown(device.fillet, 'm')}"
    check_cell_count(device.cell_size, expected_cells(device), MOST_CELLS, more)


def _check_shape(device: Cylinder) -> None:
    radius, outer = device.inner_radius, device.outer_radius
    if device.fillet >= radius:
        raise GeometryError(
            f"fillet is {shown(device.fillet, 'm')}; it must be smaller than inner_radius, {shown(radius, 'm')}"
        )
    if not FLATTEST * outer <= device.length <= SLIMMEST * outer:
        raise GeometryError(
            f"length is {shown(device.length, 'm')}; it must be between {FLATTEST:g} and {SLIMMEST:g} times the outer radius, "
            f"{shown(outer, 'm')}"
        )
    if device.fillet > 0.4 * device.length:
        raise GeometryError(
            f"fillet is {shown(device.fillet, 'm')}; it must be at most 0.4 times length, {shown(device.length, 'm')}"
        )
    if device.wall > THICKEST * radius:
        raise GeometryError(
            f"wall is {shown(device.wall, 'm')}; it must be at most {THICKEST:g} times inner_radius, {shown(radius, 'm')}"
        )
    if outer > THINNEST * device.wall:
        raise GeometryError(
            f"wall is {shown(device.wall, 'm')}; it must be at least 1/{THINNEST:g} of the outer radius, {shown(outer, 'm')}"
        )
    if device.cap > THICKEST * outer:
        raise GeometryError(
            f"cap is {shown(device.cap, 'm')}; it must be at most {THICKEST:g} times the outer radius, {shown(outer, 'm')}"
        )
    if max(outer, device.height) > LONGEST:
        raise GeometryError(
            f"length is {shown(device.length, 'm')}; with cap {shown(device.cap, 'm')} or wall {shown(device.wall, 'm')} the "
            f"device passes {LONGEST:g} m, which suggests a wrong unit"
        )


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
    through = THROUGH[device.dimension]
    wall, cap = (min(device.cell_size, part / through) for part in (device.wall, device.cap))
    if device.stripped:  # cells as wide as a piece of the wall come out flat
        narrowest = min(b - a for a, b in itertools.pairwise(azimuths(device, True)))
        wall = min(wall, ACROSS_PIECE * math.radians(narrowest) * device.inner_radius)
    arc = 0.5 * math.pi * device.fillet / ALONG_ARC if device.fillet else math.inf
    return wall, cap, min(wall, cap, arc)


def expected_cells(device: Cylinder) -> float:
    """Estimate the number of cells (within a factor of about two) from the sizes."""
    wall, cap, arc = cell_sizes(device)
    radius, outer = device.inner_radius, device.outer_radius
    if device.dimension == 2:
        return (device.wall * device.length / wall**2 + outer * device.cap / cap**2 + 20.0) / TRIANGLE
    share = math.pi if device.section == "whole" else 0.5 * math.pi
    ring = 2.0 * radius * device.fillet**2 / arc**3 if device.fillet else 0.0
    tube = (outer**2 - radius**2) * device.length / wall**3
    return share * (tube + outer**2 * device.cap / cap**3 + ring) / TETRAHEDRON


# ----------------------------------------------------------------------------------------------------------------------
# The closed tube's half profile as edges between corners, along which points are carried to another tube.


CHOICES = ("section", "strip", "base", "end")
"""Fields in which two tubes must agree for points to be carried from one to the other."""


def outline(tube: Cylinder) -> list[Side]:
    """Return the half profile in m, against the clock from the foot of the cavity's wall; without the axis below the
    ceiling."""
    inner, outer, fillet = tube.inner_radius, tube.outer_radius, tube.fillet
    straight, length, height = tube.straight, tube.length, tube.height
    corner, root = (inner - fillet, length), (inner, straight)
    arc = [Side(corner, root, 1, "cavity", (inner - fillet, straight), (fillet, fillet))] if fillet else []
    return [
        Side((inner, 0.0), (outer, 0.0), 1, "support"),
        Side((outer, 0.0), (outer, 0.5 * length), 1, "outer"),
        Side((outer, 0.5 * length), (outer, straight), 1, "outer"),
        Side((outer, straight), (outer, height), 1, "side"),
        Side((outer, height), (0.0, height), 1, "end"),
        Side((0.0, height), (0.0, length), 1, "axis"),
        Side((0.0, length), corner, 1, "cavity"),
        *arc,
        Side(root, (inner, 0.0), 1, "cavity"),
    ]


def check_alike(tube: Cylinder, other: Cylinder) -> None:
    """Reject tubes between which points cannot be carried.

    Raises:
        GeometryError: The first choice in which they differ, with both values.
    """
    for name in CHOICES:
        here, there = getattr(tube, name), getattr(other, name)
        if here != there:
            raise GeometryError(f"{name} is {here} and {there}; points can only be mapped between tubes of the same")
    if (tube.fillet > 0.0) != (other.fillet > 0.0):
        raise GeometryError(
            "one fillet is 0 and the other is not; points of a rounded corner cannot be mapped to a sharp one"
        )


# ----------------------------------------------------------------------------------------------------------------------
# The closed tube in Gmsh: one profile of two faces, meshed flat or turned around the axis.


GROWTH = 0.5
"""Growth of the cell size per distance from the fillet and the cap."""

Edges = list[tuple[int, str]]


def build_section(device: Cylinder) -> None:
    """Fill the current Gmsh model with the axisymmetric profile: x is the radius, y the height (m)."""
    (wall, cap), edges = _profile(device, lambda r, z: (r, z, 0.0))
    gmsh.model.occ.synchronize()
    roles: dict[str, list[int]] = defaultdict(list)
    for tag, role in edges:
        roles[role].append(tag)
    _name(2, {"wall": [wall], "cap": [cap]})
    _name(1, roles)
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
    _name_solids(device)
    _name_faces(device)
    for role, place in device.anchors.items():
        near = 1e-7 * device.outer_radius
        found = [tag for _, tag in gmsh.model.getEntities(0) if np.abs(place_of(tag) - place).max() < near]
        _name(0, {role: found})
    size = _size(device)
    gmsh.model.mesh.setSizeCallback(lambda dim, tag, x, y, z, other: size(math.hypot(x, y), z))


def build_full_turn(device: Cylinder) -> None:
    """Fill the current Gmsh model with the whole tube (mm), one solid."""
    occ = gmsh.model.occ
    (wall, cap), _ = _profile(device, lambda r, z: (MM * r, 0.0, MM * z))
    ((_, face),) = occ.fuse([(2, wall)], [(2, cap)])[0]
    occ.revolve([(2, face)], 0, 0, 0, 0, 0, 1, 2.0 * math.pi)
    occ.remove([(2, face)], recursive=True)
    occ.synchronize()


def _profile(
    device: Cylinder, at: Callable[[float, float], tuple[float, float, float]]
) -> tuple[tuple[int, int], Edges]:
    """Add the wall's and the cap's face; return their tags, and the edges on the boundary with their roles.

    Args:
        device: The tube.
        at: Makes a point in space of radius and height.
    """
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
    upper: Edges = [
        (occ.addLine(shoulder, rim), "side"),
        (occ.addLine(rim, apex), "end"),
        (occ.addLine(apex, ceiling), "axis"),
    ]
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
            wall + GROWTH * above,
            cap + GROWTH * max(0.0, device.length - z),
            arc + GROWTH * max(0.0, math.hypot(r - ring[0], z - ring[1]) - device.fillet),
        )

    return size


def _name_solids(device: Cylinder) -> None:
    regions: dict[str, list[int]] = defaultdict(list)
    for _, tag in gmsh.model.getEntities(3):
        above = gmsh.model.occ.getCenterOfMass(3, tag)[2] > device.straight
        regions["cap" if above else "wall"].append(tag)
    _name(3, regions)


def _name_faces(device: Cylinder) -> None:
    """Assign a role to every boundary face of the solid; inner faces get none."""
    roles: dict[str, list[int]] = defaultdict(list)
    for _, tag in gmsh.model.getEntities(2):
        if len(gmsh.model.getAdjacencies(2, tag)[0]) == 1:
            roles[_role(device, tag)].append(tag)
    _name(2, roles)


def _role(device: Cylinder, tag: int) -> str:
    """Return the role of a face from where its corners and its centre of mass are."""
    near = 1e-7 * device.outer_radius
    corners = gmsh.model.getBoundary([(2, tag)], combined=False, oriented=False, recursive=True)
    x, y, z = np.array([place_of(point) for _, point in corners]).T
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


def _name(dimension: int, roles: dict[str, list[int]]) -> None:
    for role, tags in roles.items():
        if not tags:
            raise MeshingError(f"The shape has no place for {role!r}; please report this with the parameters")
        gmsh.model.addPhysicalGroup(dimension, tags, name=role)


@register_device
@dataclasses.dataclass(frozen=True, kw_only=True)
class Cylinder(Sectioned, Halved):
    """A tube closed by a cap: straight as an axisymmetric section, bending as half of it, twisting as the whole.

    Lengths are in m, angles in degrees. Physical groups: cells "wall" (the straight tube) and "cap"; facets "cavity",
    "support" (the bottom ring), "outer" (around the wall), "strip" (the part of it that looks along x, if it has one), "side"
    (around the cap) and "end" (the cap's top); "plane0" (y = 0) in a half, the curve "axis" in a section. Where nothing else
    holds them, a half has the point "anchor0" (on y, at the bottom), the whole also "anchor1" (across) and "anchor2" (on x).
    """

    inner_radius: float = length_field(0.006, "radius of the cavity")
    wall: float = length_field(0.002, "thickness of the wall")
    length: float = length_field(0.060, "length of the cavity, from the base to the cap")
    cap: float = length_field(0.004, "thickness of the cap")
    fillet: float = length_field(0.001, "radius of the rounding where the wall meets the cap; 0 for none", zero=True)
    section: str = choice_field(
        "axisymmetric",
        ("axisymmetric", "half", "whole"),
        "profile in radius and height, solid half (y > 0), or all of it",
    )
    strip: float = angle_field(
        0.0,
        "angle around the axis of the strip along the wall, about the x axis, to which a sheet can be bonded; 0 for none",
        unless=("section", "axisymmetric"),
    )
    base: str = choice_field(
        "held", ("held", "sliding"), "bottom ring clamped, or held only along z: half of a tube with two caps"
    )
    end: str = choice_field("free", ("free", "sliding", "held"), "cap's top free, held only along z, or clamped")
    cell_size: float = length_field(0.002, "edge length of the cells", shape=False)
    order: int = choice_field(2, (1, 2), "order of the cells' geometry: 1 straight, 2 curved edges")

    stem: ClassVar = "cylinder"
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

    def check(self) -> None:
        check_cylinder(self)

    @property
    def faces(self) -> tuple[str, ...]:  # type: ignore[override]
        """See `Actuator.faces`; a sheet around a device without a strip is bonded to all of the wall."""
        return ("outer", "strip", "side", "end") if self.stripped else ("outer", "side", "end")

    @property
    def stripped(self) -> bool:
        """Whether part of the outside is a strip."""
        return self.dimension == 3 and self.strip > 0.0

    @property
    def mesh_order(self) -> int:
        return self.order

    @property
    def expected_cells(self) -> float:
        return expected_cells(self)

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

    figure_texts: ClassVar[Mapping[str, tuple[str, str]]] = {
        "elongation_percent": (
            "elongation", "rise of the end's rim over the device's height; the mean of two sides in a solid model",
        ),
        "diameter_mm": ("diameter", "of the outside half way up the cavity"),
        "bend_angle_deg": ("bend", "angle by which the end has turned towards x, in the plane y = 0"),
        "twist_deg": ("twist", "angle by which the end has turned about the axis"),
        "tip_x_mm": ("tip place x", "x of the middle of the end, from the axis as cast"),
    }  # fmt: skip

    def device_figures(self, places: Mapping[str, Vector]) -> dict[str, float]:
        """Return the elongation and diameter; bend of a half, twist of a whole tube; see `Actuator.device_figures`.

        Angles are known up to half a turn.
        """
        now = {name: np.asarray(place, dtype=float) for name, place in places.items()}
        if self.dimension == 2:
            rise, diameter = now["rim"][2] - self.height, 2.0 * now["side"][0]
            return {"elongation_percent": 100.0 * rise / self.height, "diameter_mm": diameter * 1e3}
        rise = 0.5 * (now["rim"][2] + now["far_rim"][2]) - self.height
        across = now["rim"] - now["far_rim"]
        figures = {
            "elongation_percent": 100.0 * rise / self.height,
            "diameter_mm": float(np.linalg.norm(now["side"] - now["far_side"])) * 1e3,
            "bend_angle_deg": math.degrees(math.atan2(-across[2], across[0])),
        }
        if self.section == "whole":
            figures["twist_deg"] = math.degrees(math.atan2(across[1], across[0]))
        return figures | {"tip_x_mm": now["end"][0] * 1e3}

    @property
    def movable(self) -> tuple[str, ...]:
        return tuple(name for name in parameter_names(self) if name != "strip" and parameter(self, name) != 0.0)

    def carried(self, other: Self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the points of the boundary at the same share of the same edge of the other's outline; see
        `Actuator.carried`."""
        check_alike(self, other)
        return carried_along(outline(self), outline(other), points, self.outer_radius)

    @property
    def clearances(self) -> dict[str, float]:
        flat, upright = self.inner_radius - self.fillet, self.straight
        return {
            "wall": self.wall,
            "cap": self.cap,
            "flat part of the ceiling": flat,
            "straight part of the wall": upright,
        }

    @property
    def cavity_volume(self) -> float:
        # The rounding is the corner's square less a quarter circle, each turned around the axis.
        inner, fillet = self.inner_radius - self.fillet, self.fillet
        rounded = fillet * (self.inner_radius**2 - inner**2 - 0.5 * math.pi * fillet * inner - 2.0 / 3.0 * fillet**2)
        return math.pi * (self.inner_radius**2 * self.length - rounded)

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
    def recipe(self) -> Recipe:
        tube = Pour(name="tube", up=self.lift, level=0.0, sideways=(0.0, 1.0, 0.0), gate=self.height)
        return Recipe(
            pours=(tube,),
            why="The outside opens in two halves; the cavity's rod stands on the lid and leaves through the open end.",
        )  # fmt: skip

    def build_whole(self) -> None:

        build_full_turn(self)

    def build(self) -> None:

        build_section(self) if self.dimension == 2 else build_solid(self)
