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
it. What they are made of, or that they are rigid, the case says.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping
from typing import ClassVar

from geometries.actuator import Hold, Vector
from geometries.fields import choice_field, field_of, length_field, lengths_field
from geometries.kinds import Length, Open
from geometries.membrane_checks import check_membrane
from geometries.membrane_panels import membrane_panels
from geometries.panels import Panel
from geometries.registry import register
from geometries.revolved import Revolved, section_field, through_field, wedge_field

ROUNDED = 1 / 3
"""Width and depth of the slope at the held edge, in thicknesses, where a plate is bonded on."""


@register
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
        "both", ("both", "below", "slip"), "both faces held in the clamp, the lower one alone (glued to the chamber), or both "
        "held across and free to slip inwards"
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
        """Fewer turn more stiffly at the held edge; of more, that corner may have a limit of its own before the membrane's."""
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
        """What is bonded on: plate and rings."""
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
