"""Hollow disks that cannot be: checked by name and value before the mesher starts."""

from __future__ import annotations

from typing import TYPE_CHECKING

from geometries.disk_cells import expected_cells
from geometries.errors import GeometryError
from geometries.fields import LONGEST, shown

if TYPE_CHECKING:
    from geometries.disk import HollowDisk

MOST_CELLS = 5_000_000
"""Meshes expected to be larger are refused: they are typing mistakes far more often than wishes."""

TALLEST = 5.0
"""Largest thickness of membrane, base or cavity in radii of the disk."""

NARROWEST = 5.0
"""Smallest angle in degrees; a thinner wedge has needles for cells along the axis."""

COARSEST = 10.0
"""Largest ratio of the cell size to the thinnest part; the size grades too steeply beyond it."""


def check_disk(disk: HollowDisk) -> None:
    """Check a disk's parameters against each other.

    Raises:
        GeometryError: The first parameter found impossible, with its value and the limit.
    """
    _check_shape(disk)
    if disk.dimension == 3:
        _check_slice(disk)
    _check_cells(disk)


def _check_shape(disk: HollowDisk) -> None:
    for fillet in ("fillet", "base_fillet"):
        for name in ("cavity_height", "cavity_radius"):
            radius, limit = getattr(disk, fillet), getattr(disk, name)
            if radius >= limit:
                raise GeometryError(
                    f"{fillet} is {shown(radius, 'm')}; it must be smaller than {name}, {shown(limit, 'm')}"
                )
    if disk.fillet + disk.base_fillet >= disk.cavity_height:
        raise GeometryError(
            f"fillet is {shown(disk.fillet, 'm')}; with base_fillet {shown(disk.base_fillet, 'm')} it leaves nothing of "
            f"cavity_height, {shown(disk.cavity_height, 'm')}"
        )
    for part in ("membrane", "base", "cavity_height"):
        if getattr(disk, part) > TALLEST * disk.outer_radius:
            raise GeometryError(
                f"{part} is {shown(getattr(disk, part), 'm')}; more than {TALLEST:g} times the disk's radius, "
                f"{shown(disk.outer_radius, 'm')}, is no disk and looks like a mistaken unit"
            )
    if disk.outer_radius > LONGEST:
        raise GeometryError(
            f"wall is {shown(disk.wall, 'm')}; with cavity_radius {shown(disk.cavity_radius, 'm')} the disk's radius "
            f"passes {LONGEST:g} m, which looks like a mistaken unit"
        )


def _check_slice(disk: HollowDisk) -> None:
    # Checked before anything divides by the angle.
    if not NARROWEST <= disk.angle <= 360.0:
        raise GeometryError(f"angle is {shown(disk.angle, 'degree')}; it must lie between {NARROWEST:g} and 360 deg")
    turns = 360.0 / disk.angle
    if abs(turns - round(turns)) > 1e-9 * turns:
        raise GeometryError(
            f"angle is {shown(disk.angle, 'degree')}; it must divide 360 deg evenly, such as 30, 45, 90, 180 or 360 deg"
        )
    if abs(disk.azimuth) > 360.0:
        raise GeometryError(f"azimuth is {shown(disk.azimuth, 'degree')}; it must lie between -360 and 360 deg")


def _check_cells(disk: HollowDisk) -> None:
    if disk.refinement < 1.0:
        raise GeometryError(f"refinement is {disk.refinement:g}; it must be 1 (none) or more")
    if disk.cell_size > disk.cavity_radius:
        raise GeometryError(
            f"cell_size is {shown(disk.cell_size, 'm')}; it must not pass cavity_radius, "
            f"{shown(disk.cavity_radius, 'm')}"
        )
    for part in ("membrane", "base", "wall"):
        if disk.cell_size > COARSEST * getattr(disk, part):
            raise GeometryError(
                f"cell_size is {shown(disk.cell_size, 'm')}; it must not pass {COARSEST:g} times {part}, "
                f"{shown(getattr(disk, part), 'm')}"
            )
    expected = expected_cells(disk)
    if expected > MOST_CELLS:
        raise GeometryError(
            f"cell_size is {shown(disk.cell_size, 'm')} with refinement {disk.refinement:g} and fillet "
            f"{shown(disk.fillet, 'm')}; about {expected:.2g} cells are expected and {MOST_CELLS:,} are allowed"
        )
