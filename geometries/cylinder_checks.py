"""Cylinders that cannot be: checked by name and value before the mesher starts; and how many cells to expect."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING

from geometries.cell_count import check_cell_count
from geometries.errors import GeometryError
from geometries.fields import LONGEST, shown

if TYPE_CHECKING:
    from geometries.cylinder import Cylinder

MOST_CELLS = 5_000_000
"""Meshes expected to be larger are refused: they are typing mistakes far more often than wishes."""

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
"""Largest angle in degrees turned at once: the CAD kernel leaves a seam in a full turn, and no vertex at its centre."""

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
            f"strip is {shown(device.strip, 'degree')}; an axisymmetric section is the same all around, take section half"
        )
    if device.strip and not NARROWEST <= device.strip <= WIDEST:
        raise GeometryError(
            f"strip is {shown(device.strip, 'degree')}; it must be 0 (none) or lie between {NARROWEST:g} and {WIDEST:g} deg"
        )
    for part in ("wall", "cap"):
        if device.cell_size > COARSEST * getattr(device, part):
            raise GeometryError(
                f"cell_size is {shown(device.cell_size, 'm')}; it must not pass {COARSEST:g} times {part}, "
                f"{shown(getattr(device, part), 'm')}"
            )
    if device.cell_size > device.length:
        raise GeometryError(
            f"cell_size is {shown(device.cell_size, 'm')}; it must not pass length, {shown(device.length, 'm')}"
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
            f"length is {shown(device.length, 'm')}; it must lie between {FLATTEST:g} and {SLIMMEST:g} times the outer radius, "
            f"{shown(outer, 'm')}"
        )
    if device.fillet > 0.4 * device.length:
        raise GeometryError(
            f"fillet is {shown(device.fillet, 'm')}; it must not pass 0.4 times length, {shown(device.length, 'm')}"
        )
    if device.wall > THICKEST * radius:
        raise GeometryError(
            f"wall is {shown(device.wall, 'm')}; it must not pass {THICKEST:g} times inner_radius, {shown(radius, 'm')}"
        )
    if outer > THINNEST * device.wall:
        raise GeometryError(
            f"wall is {shown(device.wall, 'm')}; it must be at least 1/{THINNEST:g} of the outer radius, {shown(outer, 'm')}"
        )
    if device.cap > THICKEST * outer:
        raise GeometryError(
            f"cap is {shown(device.cap, 'm')}; it must not pass {THICKEST:g} times the outer radius, {shown(outer, 'm')}"
        )
    if max(outer, device.height) > LONGEST:
        raise GeometryError(
            f"length is {shown(device.length, 'm')}; with cap {shown(device.cap, 'm')} or wall {shown(device.wall, 'm')} the "
            f"device passes {LONGEST:g} m, which looks like a mistaken unit"
        )


def azimuths(device: Cylinder, stripped: bool) -> list[float]:
    """Azimuths in degrees between which a face is turned to make the solid.

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
    """Return a rough number of cells (within a factor of about two), from the sizes alone."""
    wall, cap, arc = cell_sizes(device)
    radius, outer = device.inner_radius, device.outer_radius
    if device.dimension == 2:
        return (device.wall * device.length / wall**2 + outer * device.cap / cap**2 + 20.0) / TRIANGLE
    share = math.pi if device.section == "whole" else 0.5 * math.pi
    ring = 2.0 * radius * device.fillet**2 / arc**3 if device.fillet else 0.0
    tube = (outer**2 - radius**2) * device.length / wall**3
    return share * (tube + outer**2 * device.cap / cap**3 + ring) / TETRAHEDRON
