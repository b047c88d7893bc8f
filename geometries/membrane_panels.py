"""The half section of a clamped membrane: rows of cells along the radius, small where a clamp, a plate or a ring ends."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from geometries.panels import ROUNDING, Panel, Side, graded

if TYPE_CHECKING:
    from geometries.membrane import Membrane

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
    """What covers the membrane from the axis outwards: inner and outer radius, face, thickness in m of what is bonded on it."""
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
    """The membrane cut at all radii where something begins or its cells change, from the axis outwards."""
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
    """The half section; see `Membrane`."""
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
    """A rectangle: heights of its span, roles of its lower and upper face and of its ends, cells through it."""
    (low, high), (below, above), (inside, outside) = span, faces, ends
    corners = ((strip.inner, low), (strip.outer, low), (strip.outer, high - strip.slope), (strip.inner, high))
    a, b, c, d = corners
    return Panel(region, (
        Side(a, b, strip.cells, below, growth=strip.growth), Side(b, c, through, outside),
        Side(c, d, strip.cells, above, growth=1.0 / strip.growth), Side(d, a, through, inside),
    ))  # fmt: skip
