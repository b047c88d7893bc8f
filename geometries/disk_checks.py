"""Hollow disks that cannot be: checked by name and value before the mesher starts."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from geometries.cell_count import check_cell_count
from geometries.disk_cells import expected_cells
from geometries.errors import GeometryError
from geometries.fields import LONGEST, shown
from geometries.kinds import ROUNDING, SHORTEST

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

FEWEST, MOST = 2, 12
"""Entries of a membrane's profile."""

LEAST_SHARE, LARGEST_SHARE = 0.1, 10.0
"""Smallest and largest entry of a membrane's profile."""

PARTS = ("", "a quarter of the way", "half way", "three quarters of the way")
"""Of the way from an entry of a membrane's profile to the next, where its thickness is a clearance."""


def check_disk(disk: HollowDisk) -> None:
    """Check a disk's parameters against each other.

    Raises:
        GeometryError: The first parameter found impossible, with its value and the limit.
    """
    _check_profile(disk)
    _check_shape(disk)
    if disk.dimension == 3:
        _check_slice(disk)
    _check_cells(disk)


def _check_profile(disk: HollowDisk) -> None:
    if disk.profile and not FEWEST <= len(disk.profile) <= MOST:
        raise GeometryError(
            f"profile has {len(disk.profile)} {'entry' if len(disk.profile) == 1 else 'entries'}; it takes {FEWEST} to "
            f"{MOST}, from the axis to the cavity's edge, or none for a uniform membrane"
        )
    for k, share in enumerate(disk.profile):
        if not LEAST_SHARE * (1 - ROUNDING) <= share <= LARGEST_SHARE * (1 + ROUNDING):
            raise GeometryError(
                f"profile[{k + 1}] is {share:g}; it must lie between {LEAST_SHARE:g} and {LARGEST_SHARE:g} times membrane"
            )
    thinnest, _ = disk.membrane_top.extremes
    if thinnest < SHORTEST * (1 - ROUNDING):
        listed = ", ".join(f"{share:g}" for share in disk.profile)
        raise GeometryError(
            f"profile is {listed}; the smooth line through them leaves a membrane of {shown(max(thinnest, 0.0), 'm')} at its "
            f"thinnest, and {shown(SHORTEST, 'm')} is the least: let neighbours differ less"
        )


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
    sizes = {"membrane": disk.membrane_top.extremes[1], "base": disk.base, "cavity_height": disk.cavity_height}
    for part, length in sizes.items():
        if length > TALLEST * disk.outer_radius:
            raise GeometryError(
                f"{part} is {shown(length, 'm')}; more than {TALLEST:g} times the disk's radius, "
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
    sizes = {"membrane": disk.membrane_top.extremes[0], "base": disk.base, "wall": disk.wall}
    for part, length in sizes.items():
        if disk.cell_size > COARSEST * length:
            raise GeometryError(
                f"cell_size is {shown(disk.cell_size, 'm')}; it must not pass {COARSEST:g} times {part}, "
                f"{shown(length, 'm')}"
            )
    more = f" with refinement {disk.refinement:g} and fillet {shown(disk.fillet, 'm')}"
    check_cell_count(disk.cell_size, expected_cells(disk), MOST_CELLS, more)


def clearances(disk: HollowDisk) -> dict[str, float]:
    """Dimensions in m that have a least value; see `geometries.Actuator.clearances`.

    A membrane with a profile has one at each entry and three between neighbours, where the smooth line may dip. Where they
    are a fifth of the membrane or more, none of thousands of random profiles dipped to zero anywhere.
    """
    found = {"base": disk.base, "wall": disk.wall, "height of the cavity": disk.cavity_height}
    return (
        found
        | _membrane_clearances(disk)
        | {
            "straight part of the cavity's side": disk.cavity_height - disk.fillet - disk.base_fillet,
            "flat part of the cavity's ceiling": disk.cavity_radius - disk.fillet,
            "flat part of the cavity's floor": disk.cavity_radius - disk.base_fillet,
        }
    )


def _membrane_clearances(disk: HollowDisk) -> dict[str, float]:
    if not disk.profile:
        return {"membrane": disk.membrane}
    gaps = len(disk.profile) - 1
    thickness = disk.membrane_top.thickness(disk.cavity_radius * np.linspace(0.0, 1.0, len(PARTS) * gaps + 1))
    names = [f"membrane at entry {k} of profile" for k in range(1, gaps + 2)]
    between = [
        f"membrane {part} from entry {k} to entry {k + 1} of profile" for k in range(1, gaps + 1) for part in PARTS[1:]
    ]
    inner = np.delete(thickness, np.s_[:: len(PARTS)])
    return dict(zip([*names, *between], [*thickness[:: len(PARTS)].tolist(), *inner.tolist()], strict=True))
