"""A closed form that only tests need, besides those of `softmodels.materials.specimens`."""

from __future__ import annotations

import numpy.typing as npt

from softmodels.common.arrays import Array
from softmodels.materials.laws import Material
from softmodels.materials.specimens import _wall_pressure


def tube_pressure(material: Material, inner: float, outer: float, inner_stretch: npt.ArrayLike) -> Array:
    """Return the pressure in Pa inside a thick-walled incompressible tube that keeps its length, none outside.

    P = int W'(l) / (l^2 - 1) dl, W of planar tension (Ogden 1984, section 5.3.3 at axial stretch 1); see `sphere_pressure`,
    whose arguments it takes.
    """
    return _wall_pressure(material, inner, outer, inner_stretch, "planar", 2)
