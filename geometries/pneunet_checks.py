"""PneuNets that cannot be: checked by name and value before the mesher starts."""

from __future__ import annotations

from typing import TYPE_CHECKING

from geometries.cell_count import check_cell_count
from geometries.errors import GeometryError
from geometries.fields import LONGEST, shown
from geometries.kinds import ROUNDING
from geometries.pneunet_plan import gap_floor, length, top

if TYPE_CHECKING:
    from geometries.pneunet import PneuNet

MOST_CELLS = 3_000_000
"""Meshes expected to be larger are refused: they are typing mistakes far more often than wishes."""

COARSEST = 10.0
"""Largest ratio of the cell size to the thinnest part: flatter cells are poor."""


SOLID = ("wall", "side_wall", "top_wall", "base", "root", "cap", "bridge")
"""Thicknesses of solid."""


def walls(finger: PneuNet) -> dict[str, float]:
    """Every dimension in m of the solid and of the air that has a least value, by its parameter."""
    several = finger.chambers > 1
    names = ["chamber_length", "chamber_width", "chamber_height", "wall" if several else "", "side_wall", "top_wall"]
    names += ["base", "root", "cap", *(("channel_width", "channel_height") if several else ())]
    names += ["gap", "bridge"] if several and finger.gap else []
    return {name: getattr(finger, name) for name in names if name}


def check_pneunet(finger: PneuNet) -> None:
    """Check a finger's parameters against each other.

    Raises:
        GeometryError: The first parameter found impossible, with its value and the limit.
    """
    _check_walls(finger)
    if finger.chambers > 1:
        _check_channel(finger)
    _check_base(finger)
    _check_cells(finger)


def _mm(value: float) -> str:
    return shown(value, "m")


def _check_walls(finger: PneuNet) -> None:
    for name, value in walls(finger).items():
        if value < finger.least_wall * (1 - ROUNDING):
            raise GeometryError(f"{name} is {_mm(value)}, and least_wall asks for {_mm(finger.least_wall)}")
    if length(finger) > 0.1 * LONGEST:
        raise GeometryError(
            f"chamber_length is {_mm(finger.chamber_length)}; with {finger.chambers} chambers the finger is "
            f"{_mm(length(finger))} long, and above {0.1 * LONGEST:g} m this looks like a mistaken unit"
        )
    for name in ("chamber_width", "chamber_height", "side_wall", "top_wall", "base"):
        if getattr(finger, name) > 0.1 * LONGEST:
            raise GeometryError(
                f"{name} is {_mm(getattr(finger, name))}; above {_mm(0.1 * LONGEST)} this looks like a mistaken unit"
            )


def _check_channel(finger: PneuNet) -> None:
    for along in ("width", "height"):
        mine, limit = getattr(finger, f"channel_{along}"), getattr(finger, f"chamber_{along}")
        if mine > limit * (1 - ROUNDING):
            raise GeometryError(
                f"channel_{along} is {_mm(mine)}; the channel between chambers is smaller than they are, so that it must be "
                f"below chamber_{along}, {_mm(limit)}"
            )
    if finger.gap and gap_floor(finger) > top(finger) - finger.least_wall:
        raise GeometryError(
            f"bridge is {_mm(finger.bridge)}; with channel_height {_mm(finger.channel_height)} no gap is left below the top at "
            f"{_mm(finger.chamber_height + finger.top_wall)} above the base; with gap 0 the chambers share their walls"
        )


def _check_base(finger: PneuNet) -> None:
    if finger.opposite < 0.0:
        raise GeometryError(f"opposite is {finger.opposite:g}; it must be 0 or more: suction is not modelled")
    if finger.paper and finger.base - finger.paper < 2.0 * finger.least_wall * (1 - ROUNDING):
        raise GeometryError(
            f"paper is {_mm(finger.paper)}; with base {_mm(finger.base)} less than least_wall {_mm(finger.least_wall)} is "
            "left above and below it"
        )


def _check_cells(finger: PneuNet) -> None:
    solid = {name: value for name, value in walls(finger).items() if name in SOLID}
    thinnest = min(solid, key=solid.__getitem__)
    limit = COARSEST * solid[thinnest]
    if finger.cell_size > limit:
        raise GeometryError(
            f"cell_size is {_mm(finger.cell_size)}; with {thinnest} {_mm(solid[thinnest])} it must not pass {_mm(limit)}"
        )
    check_cell_count(finger.cell_size, finger.expected_cells, MOST_CELLS)
