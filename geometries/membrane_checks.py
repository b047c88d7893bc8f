"""Clamped membranes that cannot be: checked by name and value before the mesher starts."""

from __future__ import annotations

from typing import TYPE_CHECKING

from geometries.errors import GeometryError
from geometries.fields import LONGEST, shown

if TYPE_CHECKING:
    from geometries.membrane import Membrane

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
        raise GeometryError(f"thickness is {shown(thickness, 'm')}; it must not pass radius, {shown(radius, 'm')}")
    if thickness < THINNEST * radius:
        raise GeometryError(
            f"thickness is {shown(thickness, 'm')}; it must be at least {THINNEST:g} of radius, {shown(radius, 'm')}"
        )
    if membrane.chamber_depth > DEEPEST * radius:
        raise GeometryError(
            f"chamber_depth is {shown(membrane.chamber_depth, 'm')}; more than {DEEPEST:g} times radius, "
            f"{shown(radius, 'm')}, looks like a mistaken unit"
        )
    if membrane.cell_size > radius:
        raise GeometryError(
            f"cell_size is {shown(membrane.cell_size, 'm')}; it must not pass radius, {shown(radius, 'm')}"
        )


def _check_clamp(membrane: Membrane) -> None:
    if membrane.radius + membrane.clamp_width > LONGEST:
        raise GeometryError(
            f"clamp_width is {shown(membrane.clamp_width, 'm')}; with radius {shown(membrane.radius, 'm')} the membrane passes "
            f"{LONGEST:g} m, which looks like a mistaken unit"
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
                f"{name} is {shown(value, 'm')}; more than {DEEPEST:g} times radius, {shown(membrane.radius, 'm')}, looks "
                "like a mistaken unit"
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
