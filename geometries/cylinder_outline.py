"""The closed tube's half profile as edges between corners, along which points are carried to another tube."""

from __future__ import annotations

from typing import TYPE_CHECKING

from geometries.errors import GeometryError
from geometries.panels import Side

if TYPE_CHECKING:
    from geometries.cylinder import Cylinder

CHOICES = ("section", "strip", "base", "end")
"""Fields in which two tubes must agree for points to be carried from one to the other."""


def outline(tube: Cylinder) -> list[Side]:
    """The half profile in m, against the clock from the foot of the cavity's wall; without the axis below the ceiling."""
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
    """Refuse tubes between which points cannot be carried.

    Raises:
        GeometryError: The first choice in which they differ, with both values.
    """
    for name in CHOICES:
        here, there = getattr(tube, name), getattr(other, name)
        if here != there:
            raise GeometryError(f"{name} is {here} and {there}; points are carried between tubes of the same")
    if (tube.fillet > 0.0) != (other.fillet > 0.0):
        raise GeometryError(
            "one fillet is 0 and the other is not; points of a rounded corner have no place on a sharp one"
        )
