"""The clamped membrane: a flat disk of silicone over an air chamber, as in a bulge test.

The half profile, with the axis of symmetry z on the left; the chamber below z = 0 is rigid and not meshed::

    z
    |    plate        ring            clamp_top
    |____________....._____........._____________   thickness
    |                              |             | rim
    |______________________________|_____________|__ r, z = 0
    |          cavity                   clamp
    |  (air)                       |
    0                           radius    radius + clamp_width

A plate in the middle and rings are faces of the upper side; with a thickness of their own they are regions of cells bonded on
it. Their material, or that they are rigid, is set in the case.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping
from typing import ClassVar, NamedTuple

from geometries.actuator import Hold, Pour, Recipe, Vector
from geometries.registry import register_device
from geometries.revolved import ROUNDING, Panel, Revolved, Side, graded, section_field, through_field, wedge_field
from softmodels.common.errors import GeometryError
from softmodels.common.schema import LONGEST, Length, Open, choice_field, field_of, length_field, lengths_field, shown

# ----------------------------------------------------------------------------------------------------------------------
# Clamped membranes with invalid parameters, detected before meshing.


THINNEST = 1e-3
"""Smallest thickness in radii: thinner ones wrinkle and tear before they are clamped, and their cells become needles."""

ROUNDEST = 0.8
"""Largest depth of the slope at the held edge in thicknesses: some of the edge has to be held."""

DEEPEST = 20.0
"""Largest depth of the chamber, and thickness of plate and rings, in radii."""


def check_membrane(membrane: Membrane) -> None:
    """Check a membrane's parameters against each other.

    Raises:
        GeometryError: The first parameter found impossible, with its value and the limit.
    """
    _check_membrane(membrane)
    _check_clamp(membrane)
    _check_plate(membrane)
    _check_rings(membrane)
    membrane.check_cells()


def _check_membrane(membrane: Membrane) -> None:
    radius, thickness = membrane.radius, membrane.thickness
    if thickness > radius:
        raise GeometryError(f"thickness is {shown(thickness, 'm')}; it must be at most radius, {shown(radius, 'm')}")
    if thickness < THINNEST * radius:
        raise GeometryError(
            f"thickness is {shown(thickness, 'm')}; it must be at least {THINNEST:g} of radius, {shown(radius, 'm')}"
        )
    if membrane.chamber_depth > DEEPEST * radius:
        raise GeometryError(
            f"chamber_depth is {shown(membrane.chamber_depth, 'm')}; more than {DEEPEST:g} times radius, "
            f"{shown(radius, 'm')}, suggests a wrong unit"
        )
    if membrane.cell_size > radius:
        raise GeometryError(
            f"cell_size is {shown(membrane.cell_size, 'm')}; it must be at most radius, {shown(radius, 'm')}"
        )


def _check_clamp(membrane: Membrane) -> None:
    if membrane.radius + membrane.clamp_width > LONGEST:
        raise GeometryError(
            f"clamp_width is {shown(membrane.clamp_width, 'm')}; with radius {shown(membrane.radius, 'm')} the membrane passes "
            f"{LONGEST:g} m, which suggests a wrong unit"
        )
    if membrane.clamp_rounding and membrane.clamp_width:
        raise GeometryError(
            f"clamp_rounding is {shown(membrane.clamp_rounding, 'm')}; it is of a held edge, and with clamp_width "
            f"{shown(membrane.clamp_width, 'm')} the faces of a ring are held: leave one of them out"
        )
    deepest, inside = ROUNDEST * membrane.thickness, membrane.radius - max(membrane.plate_radius, *membrane.rings, 0.0)
    if membrane.slope > deepest or membrane.slope >= inside > 0.0:
        raise GeometryError(
            f"clamp_rounding is {shown(membrane.slope, 'm')}; it must be at most {ROUNDEST:g} of thickness, "
            f"{shown(deepest, 'm')}, and less than what is bare inside the clamp, {shown(inside, 'm')}"
        )
    if membrane.clamp != "both" and not membrane.clamp_width:
        raise GeometryError(f"clamp is {membrane.clamp!r}; it needs a clamp_width, which is 0")
    if membrane.clamp == "slip" and membrane.dimension == 3 and membrane.copies <= 2:
        raise GeometryError(
            f"clamp is 'slip'; with angle {shown(membrane.angle, 'degree')} the membrane could slide away sideways: use 120 "
            "deg or less"
        )


def _check_plate(membrane: Membrane) -> None:
    if membrane.plate_radius >= membrane.radius:
        raise GeometryError(
            f"plate_radius is {shown(membrane.plate_radius, 'm')}; it must be smaller than radius, "
            f"{shown(membrane.radius, 'm')}"
        )
    for name, owner in (("plate_thickness", "plate_radius"), ("ring_thickness", "rings")):
        value = getattr(membrane, name)
        if value and not getattr(membrane, owner):
            raise GeometryError(f"{name} is {shown(value, 'm')}; it needs {owner}")
        if value > DEEPEST * membrane.radius:
            raise GeometryError(
                f"{name} is {shown(value, 'm')}; more than {DEEPEST:g} times radius, {shown(membrane.radius, 'm')}, suggests "
                "a wrong unit"
            )


def _check_rings(membrane: Membrane) -> None:
    if len(membrane.rings) % 2:
        raise GeometryError(
            f"rings has {len(membrane.rings)} entries; it takes pairs, the inner and the outer radius of each ring"
        )
    before, what = membrane.plate_radius, "plate_radius" if membrane.plate_radius else "0"
    for place, radius in enumerate(membrane.rings, 1):
        if radius <= before:
            raise GeometryError(
                f"rings[{place}] is {shown(radius, 'm')}; it must be larger than {what}, {shown(before, 'm')}: radii rise from "
                "the inside out, and rings and plate do not touch"
            )
        before, what = radius, f"rings[{place}]"
    if membrane.rings and before >= membrane.radius:
        raise GeometryError(
            f"rings[{len(membrane.rings)}] is {shown(before, 'm')}; it must be smaller than radius, "
            f"{shown(membrane.radius, 'm')}"
        )


# ----------------------------------------------------------------------------------------------------------------------
# The half section of a clamped membrane: rows of cells along the radius, small where a clamp, a plate or a ring ends.


NEEDLE = 20.0
"""Largest ratio of a cell's length to its width through the membrane."""


class Strip(NamedTuple):
    """A piece of the membrane between two radii, one panel wide.

    Attributes:
        inner: Radius where it begins, m.
        outer: Radius where it ends, m.
        cells: Cells along the radius.
        growth: Length of a cell over that of the one inside of it.
        part: What its upper face is: ``"top"``, ``"plate"``, ``"ring1"`` ... or ``"clamp_top"``.
        height: Thickness in m of what is bonded on it.
        slope: By how much its upper face is lower at its outer end, m.
    """

    inner: float
    outer: float
    cells: int
    growth: float
    part: str
    height: float
    slope: float = 0.0


def parts(membrane: Membrane) -> list[tuple[float, float, str, float]]:
    """Return what covers the membrane from the axis outwards: inner and outer radius, face, thickness in m of what is bonded on
    it."""
    found: list[tuple[float, float, str, float]] = []
    at = membrane.plate_radius
    if at:
        found.append((0.0, at, "plate", membrane.plate_thickness))
    for k, (inner, outer) in enumerate(membrane.ring_pairs, 1):
        found.append((at, inner, "top", 0.0))
        found.append((inner, outer, f"ring{k}", membrane.ring_thickness))
        at = outer
    found.append((at, membrane.radius - membrane.slope, "top", 0.0))
    if membrane.clamp_width:
        found.append((membrane.radius, membrane.radius + membrane.clamp_width, "clamp_top", 0.0))
    return found


def strips(membrane: Membrane) -> list[Strip]:
    """Return the membrane cut at all radii where something begins or its cells change, from the axis outwards."""
    across = membrane.thickness / membrane.rows
    largest = min(membrane.cell_size, NEEDLE * across)
    first = min(largest, across)
    found: list[Strip] = []
    for inner, outer, part, height in parts(membrane):
        pieces: list[tuple[float, int, float]]
        if inner == 0.0:
            pieces = _reversed(graded(outer, first, largest))
        elif part == "clamp_top":
            pieces = graded(outer - inner, first, largest)
        else:
            half = graded(0.5 * (outer - inner), first, largest)
            pieces = [*half, *_reversed(half)]
        begin = inner
        for k, (length, cells, growth) in enumerate(pieces, 1):
            end = outer if k == len(pieces) else begin + length
            found.append(Strip(begin, end, cells, growth, part, height))
            begin = end
    if slope := membrane.slope:
        cells = max(1, math.ceil(slope / across - ROUNDING))
        found.append(Strip(membrane.radius - slope, membrane.radius, cells, 1.0, "top", 0.0, slope))
    return found


def _reversed(pieces: list[tuple[float, int, float]]) -> list[tuple[float, int, float]]:
    return [(length, cells, 1.0 / growth) for length, cells, growth in reversed(pieces)]


def membrane_panels(membrane: Membrane) -> tuple[Panel, ...]:
    """Return the half section; see `Membrane`."""
    through, edge = membrane.rows, membrane.radius + membrane.clamp_width
    found = []
    along = strips(membrane)
    for k, strip in enumerate(along):
        within = "cavity" if strip.inner < membrane.radius else "clamp"
        rim = "rim" if membrane.clamp_width else "clamp"
        ends = ("axis" if strip.inner == 0.0 else "", rim if strip.outer == edge else "")
        bare = strip.height == 0.0
        found.append(
            _panel("solid", strip, (0.0, membrane.thickness), (within, strip.part if bare else ""), ends, through)
        )
        if not bare:
            low, high = membrane.thickness, membrane.thickness + strip.height
            before = along[k - 1].part if k else "axis"
            left = "axis" if k == 0 else strip.part if before != strip.part else ""
            right = strip.part if along[k + 1].part != strip.part else ""
            cells = max(through, round(strip.height / membrane.cell_size))
            found.append(_panel(strip.part, strip, (low, high), ("", strip.part), (left, right), cells))
    return tuple(found)


def _panel(
    region: str, strip: Strip, span: tuple[float, float], faces: tuple[str, str], ends: tuple[str, str], through: int
) -> Panel:
    """Return a rectangle: heights of its span, roles of its lower and upper face and of its ends, cells through it."""
    (low, high), (below, above), (inside, outside) = span, faces, ends
    corners = ((strip.inner, low), (strip.outer, low), (strip.outer, high - strip.slope), (strip.inner, high))
    a, b, c, d = corners
    return Panel(region, (
        Side(a, b, strip.cells, below, growth=strip.growth), Side(b, c, through, outside),
        Side(c, d, strip.cells, above, growth=1.0 / strip.growth), Side(d, a, through, inside),
    ))  # fmt: skip


ROUNDED = 1 / 3
"""Width and depth of the slope at the held edge, in thicknesses, where a plate is bonded on."""


@register_device
@dataclasses.dataclass(frozen=True, kw_only=True)
class Membrane(Revolved):
    """A clamped disk membrane over an air chamber, as an axisymmetric profile or a wedge.

    Lengths are in m, angles in degrees. The membrane lies between z = 0 and its thickness. Physical groups: solid "solid",
    and "plate" and "ring1", "ring2" ... where these have a thickness; faces "cavity" (the lower face inside the clamp), "top",
    "plate" and "ring1" ... (their upper faces and sides), "clamp" and "clamp_top" (the lower and the upper face within the
    clamp) and "rim"; without a width of the clamp "clamp" is the membrane's edge.
    """

    radius: float = length_field(0.020, "radius of the membrane between the clamps")
    thickness: float = length_field(0.001, "thickness of the membrane")
    clamp_width: float = length_field(
        0.0, "width of the ring that is clamped, outside the radius; 0 holds the membrane's edge", zero=True
    )
    clamp: str = choice_field(
        "both", ("both", "below", "slip"), "both faces held in the clamp, only the lower one (glued to the chamber), "
        "or both held across and free to slip inwards"
    )  # fmt: skip
    clamp_rounding: float | None = field_of(
        Open(Length(zero=True)), "width and depth of the slope at the upper edge of the clamp, where the edge is held; "
        "0 for a sharp edge; a third of the thickness with a plate, else 0, if left out", None, shape=False,
    )  # fmt: skip
    plate_radius: float = length_field(0.0, "radius of a plate bonded on the middle; 0 for none", zero=True)
    plate_thickness: float = length_field(
        0.0, "thickness of the plate where it is meshed; 0 makes it a face of the membrane", zero=True
    )
    rings: tuple[float, ...] = lengths_field(
        "inner and outer radius of each ring bonded on the membrane, from the inside out, such as 8mm,10mm,13mm,15mm"
    )
    ring_thickness: float = length_field(
        0.0, "thickness of the rings where they are meshed; 0 makes them faces of the membrane", zero=True
    )
    chamber_depth: float = length_field(0.010, "depth of the rigid chamber below the membrane", shape=False)
    cell_size: float = length_field(0.001, "edge length of the cells along the membrane", shape=False)
    through: float = through_field(0.0, "; 0 for 3 in a section and 2 in a wedge")
    section: str = section_field()
    angle: float = wedge_field()

    stem: ClassVar = "membrane"
    unbonded: ClassVar = ("rim",)
    pressures: ClassVar = "0:25"
    stiffer: ClassVar = "a thicker membrane (--thickness), a smaller one (--radius)"
    examples: ClassVar = (
        "--radius 30mm --thickness 0.5mm",
        "--plate-radius 8mm --plate-thickness 2mm",
        "--clamp-width 5mm --clamp below",
        "--rings 8mm,10mm,13mm,15mm --ring-thickness 1mm",
    )

    def check(self) -> None:
        check_membrane(self)

    @property
    def panels(self) -> tuple[Panel, ...]:
        return membrane_panels(self)

    @property
    def rows(self) -> int:
        """With fewer cells the held edge is too stiff in rotation; with more, its corner may reach a limit point of its own."""
        return round(self.through) or (3 if self.dimension == 2 else 2)

    @property
    def slope(self) -> float:
        """Width and depth in m of the slope at the held edge.

        A membrane with a plate is loaded so far that it turns over its clamp. The silicone at a sharp upper edge is then folded
        against what holds it, in fewer and fewer cells, which ends the path long before the device does.
        """
        if self.clamp_rounding is not None or self.clamp_width:
            return self.clamp_rounding or 0.0
        bare = self.radius - max(self.plate_radius, *self.rings, 0.0)
        return min(ROUNDED * self.thickness, 0.5 * bare) if self.plate_radius else 0.0

    @property
    def thinnest(self) -> float:
        return self.thickness

    @property
    def size(self) -> float:
        return self.radius

    @property
    def ring_pairs(self) -> tuple[tuple[float, float], ...]:
        """Inner and outer radius of each ring in m."""
        return tuple(zip(self.rings[::2], self.rings[1::2], strict=True))

    @property
    def faces(self) -> tuple[str, ...]:  # type: ignore[override]
        """Faces of the upper side, the clamp's last."""
        plate = ("plate",) if self.plate_radius else ()
        rings = tuple(f"ring{k}" for k in range(1, len(self.ring_pairs) + 1))
        return ("top", *plate, *rings, *(("clamp_top",) if self.clamp_width else ()))

    @property
    def regions(self) -> tuple[str, ...]:  # type: ignore[override]
        plate = ("plate",) if self.plate_radius and self.plate_thickness else ()
        return (*plate, *(f"ring{k}" for k in range(1, len(self.ring_pairs) + 1) if self.ring_thickness))

    @property
    def plated(self) -> tuple[str, ...]:  # type: ignore[override]
        """Bonded parts: plate and rings."""
        return tuple(name for name in self.faces if name == "plate" or name.startswith("ring"))

    @property
    def seen(self) -> tuple[str, ...]:  # type: ignore[override]
        return self.faces

    @property
    def holds(self) -> tuple[Hold, ...]:
        if not self.clamp_width:
            return (Hold("clamp", None), *self.axis_holds)
        along = self.lift if self.clamp == "slip" else None
        above = () if self.clamp == "below" else (Hold("clamp_top", along),)
        return (Hold("clamp", along), *above, *self.axis_holds)

    @property
    def clearances(self) -> dict[str, float]:
        bonded = {"plate": self.plate_thickness, "rings": self.ring_thickness}
        edges = [("plate", self.plate_radius)] if self.plate_radius else [("axis", 0.0)]
        for k, (inner, outer) in enumerate(self.ring_pairs, 1):
            edges += [(f"ring{k} inside", inner), (f"ring{k} outside", outer)]
        pairs = itertools.pairwise([*edges, ("clamp", self.radius)]) if self.plate_radius or self.rings else ()
        widths = {f"from {a} to {b}": end - begin for (a, begin), (b, end) in pairs}
        return {"membrane": self.thickness, **{name: value for name, value in bonded.items() if value}, **widths}

    @property
    def apex(self) -> float:
        """Height of the highest point on the axis in m."""
        return self.thickness + (self.plate_thickness if self.plate_radius else 0.0)

    @property
    def probes(self) -> Mapping[str, Vector]:
        edge = {"plate_edge": (self.plate_radius, 0.0, self.apex)} if self.plate_radius else {}
        return {"apex": (0.0, 0.0, self.apex), "ceiling": (0.0, 0.0, 0.0), **edge}

    @property
    def recipe(self) -> Recipe:
        pour = Pour(name="membrane", up=self.lift, level=0.0, lid=False, floor=self.thickness - self.slope)
        bonded = " and ".join(name for name, there in (("plate", self.plate_radius), ("rings", self.rings)) if there)
        meshed = self.plate_thickness or self.ring_thickness
        laid = f"Lay the {bonded} into the pockets of the floor before pouring, unless they are of the same silicone."
        glued = f"Glue the {bonded} on the cured membrane."
        return Recipe(
            pours=(pour,), steps=(laid if meshed else glued,) if bonded else (),
            why="It is cast face down in a frame on a flat floor and scraped flat; the floor comes off first.",
        )  # fmt: skip

    @property
    def chamber_volume(self) -> float:
        return math.pi * self.radius**2 * self.chamber_depth

    @property
    def cavity_volume(self) -> float:
        return self.chamber_volume

    @property
    def solid_volume(self) -> float:
        rings = sum(outer**2 - inner**2 for inner, outer in self.ring_pairs)
        parts = self.plate_radius**2 * self.plate_thickness + rings * self.ring_thickness
        # Pappus: the slope's triangle goes around at its centre of mass.
        off = self.slope**2 * (self.radius - self.slope / 3)
        return math.pi * ((self.radius + self.clamp_width) ** 2 * self.thickness + parts - off)
