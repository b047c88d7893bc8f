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

from geometries import actuator, registry, revolved
from geometries.actuator import Hold, Vector
from geometries.revolved import Revolved
from softmodels.common import schema
from softmodels.common.errors import GeometryError

MAX_EDGE_SLOPE_DEPTH = 0.8
"""Largest depth of the slope at the held edge in thicknesses: some of the edge has to be held."""
MAX_DEPTH_RATIO = 20.0
"""Largest depth of the chamber, and thickness of plate and rings, in radii."""
BONDED_SLOPE_SIZE = 1 / 3
"""Width and depth of the slope at the held edge, in thicknesses, where a plate is bonded on."""


@registry.register_device
@dataclasses.dataclass(frozen=True, kw_only=True)
class Membrane(Revolved):
    """A clamped disk membrane over an air chamber, as an axisymmetric profile or a wedge.

    Lengths are in m, angles in degrees. The membrane lies between z = 0 and its thickness. Physical groups: solid "solid",
    and "plate" and "ring1", "ring2" ... where these have a thickness; faces "cavity" (the lower face inside the clamp), "top",
    "plate" and "ring1" ... (their upper faces and sides), "clamp" and "clamp_top" (the lower and the upper face within the
    clamp) and "rim"; without a width of the clamp "clamp" is the membrane's edge.
    """

    radius: float = schema.length_field(0.020, "radius of the membrane between the clamps")
    thickness: float = schema.length_field(0.001, "thickness of the membrane")
    clamp_width: float = schema.length_field(
        0.0, "width of the ring that is clamped, outside the radius; 0 holds the membrane's edge", zero=True
    )
    clamp: str = schema.choice_field(
        "both", ("both", "below", "slip"), "both faces held in the clamp, only the lower one (glued to the chamber), "
        "or both held across and free to slip inwards"
    )  # fmt: skip
    clamp_rounding: float | None = schema.field_of(
        schema.Open(schema.Length(zero=True)),
        "width and depth of the slope at the upper edge of the clamp, where the edge is held; "
        "0 for a sharp edge; a third of the thickness with a plate, else 0, if left out", None, shape=False,
    )  # fmt: skip
    plate_radius: float = schema.length_field(0.0, "radius of a plate bonded on the middle; 0 for none", zero=True)
    plate_thickness: float = schema.length_field(
        0.0, "thickness of the plate where it is meshed; 0 makes it a face of the membrane", zero=True
    )
    rings: tuple[float, ...] = schema.lengths_field(
        "inner and outer radius of each ring bonded on the membrane, from the inside out, such as 8mm,10mm,13mm,15mm"
    )
    ring_thickness: float = schema.length_field(
        0.0, "thickness of the rings where they are meshed; 0 makes them faces of the membrane", zero=True
    )
    chamber_depth: float = schema.length_field(0.010, "depth of the rigid chamber below the membrane", shape=False)
    cell_size: float = schema.length_field(0.001, "edge length of the cells along the membrane", shape=False)
    through: float = revolved.through_field(0.0, "; 0 for 3 in a section and 2 in a wedge")
    section: str = revolved.section_field()
    angle: float = revolved.wedge_field()

    stem: ClassVar = "membrane"
    variable: ClassVar = ("thickness",)
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
        self.check_most("thickness", 1.0, "radius")
        self.check_least("thickness", 1e-3, "radius")
        doubtful = "more than {}, suggests a wrong unit"
        self.check_most("chamber_depth", MAX_DEPTH_RATIO, "radius", doubtful)
        self.check_most("cell_size", 1.0, "radius")
        self._check_clamp()
        self.check_below("plate_radius", "radius")
        for name, owner in (("plate_thickness", "plate_radius"), ("ring_thickness", "rings")):
            if getattr(self, name) and not getattr(self, owner):
                self.reject(name, f"it needs {owner}")
            self.check_most(name, MAX_DEPTH_RATIO, "radius", doubtful)
        self._check_rings()
        self.check_cells()

    def _check_clamp(self) -> None:
        given = f"with {self.given('radius')} "
        self.check_size("clamp_width", self.radius + self.clamp_width, given=given)
        deepest, inside = MAX_EDGE_SLOPE_DEPTH * self.thickness, self.radius - max(self.plate_radius, *self.rings, 0.0)
        rounding = f"clamp_rounding is {schema.shown(self.slope, 'm')}"
        if self.clamp_rounding and self.clamp_width:
            raise GeometryError(
                f"{rounding}; it is of a held edge, and with {self.given('clamp_width')} the faces of a ring are held: leave "
                "one of them out"
            )
        if self.slope > deepest or self.slope >= inside > 0.0:
            raise GeometryError(
                f"{rounding}; it must be at most {MAX_EDGE_SLOPE_DEPTH:g} of thickness, {schema.shown(deepest, 'm')}, and less "
                f"than what is bare inside the clamp, {schema.shown(inside, 'm')}"
            )
        if self.clamp != "both" and not self.clamp_width:
            raise GeometryError(f"clamp is {self.clamp!r}; it needs a clamp_width, which is 0")
        if self.clamp == "slip" and self.dimension == 3 and self.angle > 120.0:
            raise GeometryError(
                f"clamp is 'slip'; with angle {schema.shown(self.angle, 'degree')} the membrane could slide away sideways: use "
                "120 deg or less"
            )

    def _check_rings(self) -> None:
        if len(self.rings) % 2:
            raise GeometryError(
                f"rings has {len(self.rings)} entries; it takes pairs, the inner and the outer radius of each ring"
            )
        before, what = self.plate_radius, "plate_radius" if self.plate_radius else "0"
        for place, radius in enumerate(self.rings, 1):
            if radius <= before:
                raise GeometryError(
                    f"rings[{place}] is {schema.shown(radius, 'm')}; it must be larger than {what}, "
                    f"{schema.shown(before, 'm')}: radii rise from the inside out, and rings and plate do not touch"
                )
            before, what = radius, f"rings[{place}]"
        if self.rings and before >= self.radius:
            raise GeometryError(f"{what} is {schema.shown(before, 'm')}; it must be smaller than {self.told('radius')}")

    @property
    def parts(self) -> list[tuple[float, float, str, float]]:
        """What covers it from the axis outwards: inner and outer radius, face, thickness in m of what is bonded on it."""
        parts: list[tuple[float, float, str, float]] = []
        at = self.plate_radius
        if at:
            parts.append((0.0, at, "plate", self.plate_thickness))
        for k, (inner, outer) in enumerate(self.ring_pairs, 1):
            parts += [(at, inner, "top", 0.0), (inner, outer, f"ring{k}", self.ring_thickness)]
            at = outer
        parts.append((at, self.radius - self.slope, "top", 0.0))
        if self.clamp_width:
            parts.append((self.radius, self.radius + self.clamp_width, "clamp_top", 0.0))
        return parts

    @property
    def strips(self) -> list[Strip]:
        """The membrane cut at all radii where something begins or its cells change, from the axis outwards."""
        across = self.thickness / self.rows
        largest, first = self.cell_length, min(self.cell_length, across)
        strips: list[Strip] = []
        for inner, outer, part, height in self.parts:
            if inner == 0.0:
                pieces = _reversed_panel(revolved.graded(outer, first, largest))
            elif part == "clamp_top":
                pieces = revolved.graded(outer - inner, first, largest)
            else:
                half = revolved.graded(0.5 * (outer - inner), first, largest)
                pieces = [*half, *_reversed_panel(half)]
            begin = inner
            for k, (length, cells, growth) in enumerate(pieces, 1):
                end = outer if k == len(pieces) else begin + length
                strips.append(Strip(begin, end, cells, growth, part, height))
                begin = end
        if slope := self.slope:
            cells = max(1, math.ceil(slope / across - revolved.ZERO_LENGTH_TOLERANCE))
            strips.append(Strip(self.radius - slope, self.radius, cells, 1.0, "top", 0.0, slope))
        return strips

    @property
    def panels(self) -> tuple[revolved.Panel, ...]:
        through, edge = self.rows, self.radius + self.clamp_width
        rim, along, panels = "rim" if self.clamp_width else "clamp", self.strips, []
        for k, strip in enumerate(along):
            within = "cavity" if strip.inner < self.radius else "clamp"
            ends = ("axis" if strip.inner == 0.0 else "", rim if strip.outer == edge else "")
            above = "" if strip.height else strip.part
            panels.append(_panel("solid", strip, (0.0, self.thickness), (within, above), ends, through))
            if strip.height:
                span = (self.thickness, self.thickness + strip.height)
                before = along[k - 1].part if k else "axis"
                left = "axis" if k == 0 else strip.part if before != strip.part else ""
                right = strip.part if along[k + 1].part != strip.part else ""
                cells = max(through, round(strip.height / self.cell_size))
                panels.append(_panel(strip.part, strip, span, ("", strip.part), (left, right), cells))
        return tuple(panels)

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
        return min(BONDED_SLOPE_SIZE * self.thickness, 0.5 * bare) if self.plate_radius else 0.0

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
    def recipe(self) -> actuator.Recipe:
        pour = actuator.Pour(name="membrane", up=self.lift, level=0.0, lid=False, floor=self.thickness - self.slope)
        bonded = " and ".join(name for name, there in (("plate", self.plate_radius), ("rings", self.rings)) if there)
        meshed = self.plate_thickness or self.ring_thickness
        laid = f"Lay the {bonded} into the pockets of the floor before pouring, unless they are of the same silicone."
        glued = f"Glue the {bonded} on the cured membrane."
        return actuator.Recipe(
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


# ----------------------------------------------------------------------------------------------------------------------
# The half section of a clamped membrane: rows of cells along the radius, small where a clamp, a plate or a ring ends.


class Strip(NamedTuple):
    """A piece of the membrane between two radii in m, one panel wide, of cells each ``growth`` times as long as the one
    inside of it. ``part`` is what its upper face is: ``"top"``, ``"plate"``, ``"ring1"`` ... or ``"clamp_top"``; ``height``
    the thickness in m of what is bonded on it; ``slope`` by how much the face is lower at its outer end, m."""

    inner: float
    outer: float
    cells: int
    growth: float
    part: str
    height: float
    slope: float = 0.0


def _reversed_panel(pieces: list[tuple[float, int, float]]) -> list[tuple[float, int, float]]:
    return [(length, cells, 1.0 / growth) for length, cells, growth in reversed(pieces)]


def _panel(
    region: str, strip: Strip, span: tuple[float, float], faces: tuple[str, str], ends: tuple[str, str], through: int
) -> revolved.Panel:
    """Return a rectangle: heights of its span, roles of its lower and upper face and of its ends, cells through it."""
    (low, high), (below, above), (inside, outside) = span, faces, ends
    corners = ((strip.inner, low), (strip.outer, low), (strip.outer, high - strip.slope), (strip.inner, high))
    a, b, c, d = corners
    return revolved.Panel(region, (
        revolved.Side(a, b, strip.cells, below, growth=strip.growth), revolved.Side(b, c, through, outside),
        revolved.Side(c, d, strip.cells, above, growth=1.0 / strip.growth), revolved.Side(d, a, through, inside),
    ))  # fmt: skip
