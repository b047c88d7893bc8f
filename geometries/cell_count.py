"""How many cells a mesh may have: the check that every device's own checks end with."""

from __future__ import annotations

from geometries.errors import GeometryError
from geometries.fields import shown


def check_cell_count(cell_size: float, expected: float, most: int, more: str = "") -> None:
    """Refuse a mesh that is larger than anyone means: a typing mistake far more often than a wish.

    Args:
        cell_size: The device's, in m.
        expected: Number of cells, roughly.
        most: Largest number that is taken.
        more: What else decides it, a clause behind the cell size.

    Raises:
        GeometryError: There are more.
    """
    if expected > most:
        raise GeometryError(
            f"cell_size is {shown(cell_size, 'm')}{more}; about {expected:.2g} cells are expected and {most:,} are allowed"
        )
