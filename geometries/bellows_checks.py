"""Bellows that cannot be: checked by name and value before the mesher starts."""

from __future__ import annotations

from typing import TYPE_CHECKING

from geometries.errors import GeometryError
from geometries.fields import LONGEST, shown
from geometries.kinds import ROUNDING, SHORTEST

if TYPE_CHECKING:
    from geometries.bellows import Bellows

THINNEST = 5e-3
"""Smallest thickness of the wall in outer radii."""

NEEDLE = 20.0
"""Largest ratio of a cell's length to its width through the wall."""

THICKEST = 10.0
"""Largest thickness of a plate in outer radii."""


def check_bellows(bellows: Bellows) -> None:
    """Check a bellows' parameters against each other.

    Raises:
        GeometryError: The first parameter found impossible, with its value and the limit.
    """
    _check_wall(bellows)
    _check_rounding(bellows)
    _check_size(bellows)
    bellows.check_cells()


def _check_wall(bellows: Bellows) -> None:
    wall, pitch = bellows.wall, bellows.pitch
    if bellows.outer_radius <= bellows.inner_radius:
        raise GeometryError(
            f"outer_radius is {shown(bellows.outer_radius, 'm')}; it must be larger than inner_radius, "
            f"{shown(bellows.inner_radius, 'm')}"
        )
    if wall < THINNEST * bellows.outer_radius:
        raise GeometryError(
            f"wall is {shown(wall, 'm')}; it must be at least {THINNEST:g} of outer_radius, "
            f"{shown(bellows.outer_radius, 'm')}"
        )
    if wall > 0.45 * pitch:
        raise GeometryError(
            f"wall is {shown(wall, 'm')}; the flanks are half a pitch apart, and 0.45 times pitch, {shown(pitch, 'm')}, is the "
            "most that leaves air between them"
        )
    if bellows.cap > THICKEST * bellows.outer_radius:
        raise GeometryError(
            f"cap is {shown(bellows.cap, 'm')}; more than {THICKEST:g} times outer_radius, "
            f"{shown(bellows.outer_radius, 'm')}, looks like a mistaken unit"
        )


def _check_rounding(bellows: Bellows) -> None:
    bend, quarter = bellows.bend, 0.25 * bellows.pitch
    least = 0.5 * bellows.wall + SHORTEST
    if bend < least * (1 - ROUNDING):
        raise GeometryError(
            f"rounding is {shown(bend, 'm')}; in the middle of a wall of {shown(bellows.wall, 'm')} it must be at least "
            f"{shown(least, 'm')}"
        )
    if bend > quarter * (1 + ROUNDING):
        raise GeometryError(
            f"rounding is {shown(bend, 'm')}; it must not pass a quarter of pitch, {shown(quarter, 'm')}, with which roots "
            "and crests are half circles"
        )
    depth = bellows.outer_radius - bellows.inner_radius - bellows.wall
    if 2.0 * bend > depth * (1 + ROUNDING):
        raise GeometryError(
            f"rounding is {shown(bend, 'm')}; root and crest together need {shown(2 * bend, 'm')} between inner_radius and "
            f"outer_radius, less the wall, and {shown(max(depth, 0.0), 'm')} are there"
        )


def _check_size(bellows: Bellows) -> None:
    if max(bellows.height, bellows.outer_radius) > LONGEST:
        raise GeometryError(
            f"pitch is {shown(bellows.pitch, 'm')}; with {bellows.convolutions} convolutions the bellows passes {LONGEST:g} m, "
            "which looks like a mistaken unit"
        )
    longest = min(NEEDLE * bellows.wall / max(bellows.through, 1.0), bellows.inner_radius)
    if bellows.cell_size > longest:
        raise GeometryError(
            f"cell_size is {shown(bellows.cell_size, 'm')}; it must not pass {shown(longest, 'm')}: {NEEDLE:g} times a cell's "
            "width through the wall, and inner_radius"
        )
