"""How large the cells of a hollow disk are, and how many of them to expect.

Three rules give the size at a point: never above the disk's cell size; two cells or more through the membrane, the base
and the wall, however large the cell size; smaller at the membrane's root and along fillets, where the stress
peaks. Away from a thin part or a root the size grows linearly with distance, so neighbours stay alike.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from geometries.disk import HollowDisk

THROUGH = 2
"""Cells through the thickness of each part."""

GROWTH = 0.5
"""Growth of the cell size per distance."""

ALONG_ARC = 2
"""Cells along the fillet's quarter circle; two curved ones follow it within a thousandth of its radius."""

TURN = 1.0
"""Angle in radians by which a curved top may turn along a cell's edge, unless that takes more than `FINEST` of them."""

FINEST = 3
"""Most edges between two entries of a profile that the top's curvature asks for."""

SAMPLES = 257
"""Radii at which the size in a membrane of varying thickness is known; straight lines between them."""

TRIANGLE, TETRAHEDRON = 0.43, 0.12
"""Area and volume of a regular cell with edges of length 1."""


def part_size(disk: HollowDisk, part: str) -> float:
    """Return the cell size in m inside "membrane" (at its root), "base" or "wall"."""
    thickness: float = disk.height - disk.ceiling if part == "membrane" and disk.profile else getattr(disk, part)
    return min(disk.cell_size, thickness / THROUGH)


def membrane_sizes(disk: HollowDisk) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return radii from the axis to the cavity's edge and the cell size in the membrane there, in m.

    There are `THROUGH` cells through the thickness, none longer than the distance of a profile's entries or turning by more
    than `TURN`, and the size grows no faster than `GROWTH` along the radius.
    """
    radii = np.linspace(0.0, disk.cavity_radius, SAMPLES)
    apart = disk.cavity_radius / max(len(disk.profile) - 1, 1)
    longest = min(disk.cell_size, apart)
    top = disk.membrane_top
    turning = np.clip(TURN / np.maximum(top.curvature(radii), TURN / longest), min(apart / FINEST, longest), None)
    sizes = np.minimum(turning, top.thickness(radii) / THROUGH)
    return radii, (sizes + GROWTH * np.abs(radii[:, None] - radii)).min(axis=1)


def roots(disk: HollowDisk) -> list[tuple[float, float, float]]:
    """Return the places with small cells as (height, cell size, distance within which cells have that size), in m.

    They are rings at the cavity's radius: the membrane's root, and the edge of the floor if it is rounded.
    """
    size = min(disk.cell_size / disk.refinement, part_size(disk, "membrane"), part_size(disk, "wall"))
    upper = min(size, _arc_size(disk.fillet)) if disk.fillet > 0.0 else size
    found = [(disk.ceiling, upper, disk.fillet + upper)]
    if disk.base_fillet > 0.0:
        lower = min(disk.cell_size, part_size(disk, "wall"), _arc_size(disk.base_fillet))
        found.append((disk.base, lower, disk.base_fillet + lower))
    return found


def _arc_size(fillet: float) -> float:
    return 0.5 * math.pi * fillet / ALONG_ARC


def size_function(disk: HollowDisk) -> Callable[[float, float], float]:
    """Return the cell size in m as a function of radius and height in m."""
    radius, floor, ceiling, far = disk.cavity_radius, disk.base, disk.ceiling, disk.cell_size
    root, base, wall = (part_size(disk, part) for part in ("membrane", "base", "wall"))
    rings = roots(disk)
    radii, sizes = membrane_sizes(disk)

    def size(r: float, z: float) -> float:
        membrane = float(np.interp(r, radii, sizes)) if disk.profile else root
        return min(
            far,
            membrane + GROWTH * max(0.0, ceiling - z, r - radius),
            base + GROWTH * max(0.0, z - floor),
            wall + GROWTH * max(0.0, radius - r, floor - z),
            *(cell + GROWTH * max(0.0, math.hypot(r - radius, z - height) - core) for height, cell, core in rings),
        )

    return size


def expected_cells(disk: HollowDisk) -> float:
    """Return a rough number of cells (within a factor of about two), from the sizes alone."""
    radius, outer = disk.cavity_radius, disk.outer_radius
    upper = disk.height - disk.base
    if disk.profile:
        radii, sizes = membrane_sizes(disk)
        thickness = disk.membrane_top.thickness(radii)
        around = 2.0 * math.pi * radii if disk.dimension == 3 else 1.0
        membrane = float(np.trapezoid(around * thickness / sizes**disk.dimension, radii))
    else:
        space = math.pi * radius**2 if disk.dimension == 3 else radius
        membrane = space * disk.membrane / part_size(disk, "membrane") ** disk.dimension
    if disk.dimension == 2:
        areas = {"base": outer * disk.base, "wall": disk.wall * upper}
        # Three quarters of a disk around each root, then rings of growing cells.
        rings = sum(
            1.5 * math.pi * (0.5 * (core / cell) ** 2 + math.log(max(disk.cell_size / cell, 1.0)) / GROWTH**2)
            for _, cell, core in roots(disk)
        )
        return (rings + membrane + sum(area / part_size(disk, part) ** 2 for part, area in areas.items())) / TRIANGLE
    share = disk.angle / 360.0
    volumes = {
        "base": math.pi * outer**2 * disk.base,
        "wall": math.pi * (outer**2 - radius**2) * upper,
    }
    bulk = membrane + sum(volume / part_size(disk, part) ** 3 for part, volume in volumes.items())
    ring = sum(
        2.0 * math.pi * radius * 1.5 * math.pi * (0.5 * core**2 / cell**3 + 0.5 / (GROWTH**2 * cell))
        for _, cell, core in roots(disk)
    )
    return share * (bulk + ring) / TETRAHEDRON
