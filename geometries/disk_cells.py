"""How large the cells of a hollow disk are, and how many of them to expect.

Three rules give the size at a point: never above the disk's cell size; two cells or more through the membrane, the base
and the wall, however large the cell size; smaller at the membrane's root, where the stress peaks. Away from a thin part
or the root the size grows linearly with distance, so neighbours stay alike.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from geometries.disk import HollowDisk

THROUGH = 2
"""Cells through the thickness of each part."""

GROWTH = 0.5
"""Growth of the cell size per distance."""

ALONG_ARC = 2
"""Cells along the fillet's quarter circle; two curved ones follow it within a thousandth of its radius."""


TRIANGLE, TETRAHEDRON = 0.43, 0.12
"""Area and volume of a regular cell with edges of length 1."""


def part_size(disk: HollowDisk, part: str) -> float:
    """Return the cell size in m inside "membrane", "base" or "wall"."""
    thickness: float = getattr(disk, part)
    return min(disk.cell_size, thickness / THROUGH)


def root_size(disk: HollowDisk) -> float:
    """Return the cell size in m at the membrane's root."""
    size = min(disk.cell_size / disk.refinement, part_size(disk, "membrane"), part_size(disk, "wall"))
    return min(size, 0.5 * math.pi * disk.fillet / ALONG_ARC) if disk.fillet > 0.0 else size


def size_function(disk: HollowDisk) -> Callable[[float, float], float]:
    """Return the cell size in m as a function of radius and height in m."""
    radius, floor, ceiling, far = disk.cavity_radius, disk.base, disk.ceiling, disk.cell_size
    membrane, base, wall = (part_size(disk, part) for part in ("membrane", "base", "wall"))
    root, core = root_size(disk), _core(disk)

    def size(r: float, z: float) -> float:
        return min(
            far,
            membrane + GROWTH * max(0.0, ceiling - z, r - radius),
            base + GROWTH * max(0.0, z - floor),
            wall + GROWTH * max(0.0, radius - r, floor - z),
            root + GROWTH * max(0.0, math.hypot(r - radius, z - ceiling) - core),
        )

    return size


def expected_cells(disk: HollowDisk) -> float:
    """Return a rough number of cells (within a factor of about two), from the sizes alone."""
    radius, outer = disk.cavity_radius, disk.outer_radius
    upper = disk.cavity_height + disk.membrane
    root, core = root_size(disk), _core(disk)
    if disk.dimension == 2:
        areas = {"membrane": radius * disk.membrane, "base": outer * disk.base, "wall": disk.wall * upper}
        # Three quarters of a disk around the root, then rings of growing cells.
        rings = 1.5 * math.pi * (0.5 * (core / root) ** 2 + math.log(max(disk.cell_size / root, 1.0)) / GROWTH**2)
        return (rings + sum(area / part_size(disk, part) ** 2 for part, area in areas.items())) / TRIANGLE
    share = disk.angle / 360.0
    volumes = {
        "membrane": math.pi * radius**2 * disk.membrane,
        "base": math.pi * outer**2 * disk.base,
        "wall": math.pi * (outer**2 - radius**2) * upper,
    }
    bulk = sum(volume / part_size(disk, part) ** 3 for part, volume in volumes.items())
    ring = 2.0 * math.pi * radius * 1.5 * math.pi * (0.5 * core**2 / root**3 + 0.5 / (GROWTH**2 * root))
    return share * (bulk + ring) / TETRAHEDRON


def _core(disk: HollowDisk) -> float:
    """Return the distance in m from the root's sharp corner within which cells have the root's size."""
    return disk.fillet + root_size(disk)
