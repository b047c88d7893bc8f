"""Bending bellows that cannot be: checked by name and value before the mesher starts."""

from __future__ import annotations

from typing import TYPE_CHECKING

from geometries.bending_bellows_plan import crest, fold_radius, length
from geometries.cell_count import check_cell_count
from geometries.errors import GeometryError
from geometries.fields import LONGEST, shown
from geometries.kinds import ROUNDING

if TYPE_CHECKING:
    from geometries.bending_bellows import BendingBellows

MOST_CELLS = 3_000_000
"""Meshes expected to be larger are refused: they are typing mistakes far more often than wishes."""

COARSEST = 10.0
"""Largest ratio of the cell size to the thinnest part: flatter cells are poor."""

WALLS = ("wall", "base", "root", "cap", "radius", "depth")
"""Dimensions with a least value."""


def check_bellows(bellows: BendingBellows) -> None:
    """Check a bellows' parameters against each other.

    Raises:
        GeometryError: The first parameter found impossible, with its value and the limit.
    """
    for name in WALLS:
        if getattr(bellows, name) < bellows.least_wall * (1 - ROUNDING):
            raise GeometryError(
                f"{name} is {_mm(getattr(bellows, name))}, and least_wall asks for {_mm(bellows.least_wall)}"
            )
    if length(bellows) > 0.1 * LONGEST:
        raise GeometryError(
            f"pitch is {_mm(bellows.pitch)}; with {bellows.folds} folds the bellows is {_mm(length(bellows))} long, and above "
            f"{0.1 * LONGEST:g} m this looks like a mistaken unit"
        )
    if crest(bellows) > 2.0 * length(bellows):
        raise GeometryError(
            f"radius is {_mm(bellows.radius)}; with depth {_mm(bellows.depth)} and wall {_mm(bellows.wall)} the crests are at "
            f"{_mm(crest(bellows))}, more than twice the length, {_mm(length(bellows))}"
        )
    _check_folds(bellows)
    _check_base(bellows)
    _check_cells(bellows)


def _mm(value: float) -> str:
    return shown(value, "m")


def _check_folds(bellows: BendingBellows) -> None:
    rounding = fold_radius(bellows) - 0.5 * bellows.wall
    if rounding < 0.5 * bellows.least_wall * (1 - ROUNDING):
        raise GeometryError(
            f"wall is {_mm(bellows.wall)}; with pitch {_mm(bellows.pitch)} and depth {_mm(bellows.depth)} the folds "
            f"have a radius of {_mm(fold_radius(bellows))}, and least_wall {_mm(bellows.least_wall)} of air is "
            f"left inside them only below {_mm(2.0 * fold_radius(bellows) - bellows.least_wall)}"
        )
    if bellows.depth > 3.0 * bellows.pitch:
        raise GeometryError(
            f"depth is {_mm(bellows.depth)}; folds are at most three pitches ({_mm(bellows.pitch)}) deep"
        )


def _check_base(bellows: BendingBellows) -> None:
    for name in ("base", "rim", "root", "cap"):
        if getattr(bellows, name) > length(bellows) - bellows.root - bellows.cap:
            raise GeometryError(
                f"{name} is {_mm(getattr(bellows, name))}; it must not pass the length of the folds, "
                f"{_mm(bellows.folds * bellows.pitch)}"
            )


def _check_cells(bellows: BendingBellows) -> None:
    thinnest = min(("wall", "base", "root", "cap"), key=lambda name: float(getattr(bellows, name)))
    limit = COARSEST * getattr(bellows, thinnest)
    if bellows.cell_size > limit:
        raise GeometryError(
            f"cell_size is {_mm(bellows.cell_size)}; with {thinnest} {_mm(getattr(bellows, thinnest))} it must not pass "
            f"{_mm(limit)}"
        )
    check_cell_count(bellows.cell_size, bellows.expected_cells, MOST_CELLS)
