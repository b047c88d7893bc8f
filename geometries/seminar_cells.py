"""How large the cells of a seminar actuator are, and how many of them to expect.

On a channel's wall the size follows its curvature (`around` cells on the section) and the solid between it and the nearest
face (`THROUGH` cells); away from the wall it grows linearly with distance up to the slab's cell size.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

from geometries.seminar_plan import fan, spread

if TYPE_CHECKING:
    from geometries.seminar import SeminarActuator

THROUGH = 1.5
"""Cells between a channel and the nearest face."""

CREASE = 1.5
"""Size of the cells on a rounded crease over that on a channel with the crease's radius."""

GROWTH = 0.55
"""Growth of the cell size per distance."""

TETRAHEDRON = 0.12
"""Volume of a regular cell with edges of length 1."""


def wall_size(slab: SeminarActuator, radius: float) -> float:
    """Cell size in m on the wall of a channel of a radius in m."""
    thin = 0.5 * slab.thickness - abs(slab.offset) - radius
    return min(slab.cell_size, 2.0 * math.pi * radius / slab.around, thin / THROUGH)


def size_function(slab: SeminarActuator) -> Callable[[float, float, float], float]:
    """Return the cell size in m as a function of the place in m."""
    half, arc, bore = 0.5 * spread(slab), slab.manifold_radius, slab.manifold_bore
    on_arc, far, level = wall_size(slab, bore), slab.cell_size, slab.offset
    # The creases, or their roundings, are rings around the rays, near the manifold's outer wall.
    crease, fillet = min(CREASE * 2.0 * math.pi * slab.fillet / slab.around or far, on_arc), slab.fillet
    ring = arc + 0.85 * bore
    around, middle = 2.0 * math.pi / slab.around, 0.5 * slab.thickness - abs(slab.offset)
    ends = [(arc * math.cos(end), arc * math.sin(end)) for end in (-half, half)]
    rays = []
    for line in fan(slab):
        if line is None or (slab.part == "half" and line.angle < -1e-9):
            continue
        for number, cone in enumerate(line.cones, 1):
            end = cone.end if number < len(line.cones) else line.centre
            rays.append((math.cos(line.angle), math.sin(line.angle), cone.start, end, cone.bore, cone.slope, line.bore))

    # Gmsh asks a million times: plain arithmetic, nothing looked up twice.
    def size(x: float, y: float, z: float) -> float:
        z -= level
        if abs(math.atan2(y, x)) <= half:
            away = math.hypot(math.hypot(x, y) - arc, z)
        else:
            ex, ey = ends[y > 0.0]
            away = math.hypot(x - ex, y - ey, z)
        best = min(far, on_arc + GROWTH * max(0.0, away - bore))
        for c, s, start, end, first, slope, mouth in rays:
            along = min(max(c * x + s * y, start), end)
            radius = first + slope * (along - start)
            away = math.hypot(x - c * along, y - s * along, z) - radius
            wall = min(around * radius, (middle - radius) / THROUGH)
            best = min(best, wall + GROWTH * away if away > 0.0 else wall)
            apart = math.hypot(c * x + s * y - ring, math.hypot(s * x - c * y, z) - mouth) - fillet
            best = min(best, crease + GROWTH * apart if apart > 0.0 else crease)
        return best

    return size


def expected_cells(slab: SeminarActuator) -> float:
    """Return a rough number of cells (within a factor of about two), from the sizes alone."""
    share = 0.5 if slab.part == "half" else 1.0
    total = 0.5 * slab.base_width * slab.length * slab.thickness / slab.cell_size**3
    lines = [(slab.manifold_radius * spread(slab), slab.manifold_bore)]
    lines += [
        (cone.end - cone.start, max(cone.bore, line.radius(cone.end)))
        for line in fan(slab)
        if line is not None
        for cone in line.cones
    ]
    for length, radius in lines:
        h = wall_size(slab, radius)
        # Rings of cells that grow with distance r from the wall: int 2 pi (radius + r) / (h + g r)^3 dr.
        total += length * 2.0 * math.pi * (0.5 * radius / (GROWTH * h**2) + 0.5 / (GROWTH**2 * h))
    return share * total / TETRAHEDRON
