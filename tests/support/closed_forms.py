"""Closed forms that only tests need, besides those of `softmodels.materials.specimens`."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from softmodels.common.arrays import Array
from softmodels.materials.laws import Material
from softmodels.materials.specimens import _slope, _wall_pressure, nominal_stress
from softmodels.materials.strain import HomogeneousStrain


def uniaxial_compressible(material: Material, stretch: npt.ArrayLike) -> tuple[Array, Array]:
    """Return the uniaxial tension of a law with its own bulk; at ``poisson = 0.5`` the incompressible result.

    Args:
        material: The law.
        stretch: Imposed stretch, any shape.

    Returns:
        Nominal stress in Pa and the lateral stretch at which the lateral stress vanishes, shapes of ``stretch``.
    """
    from scipy.optimize import brentq

    stretch = np.asarray(stretch, dtype=float)
    if np.isinf(material.bulk):
        return nominal_stress(material, stretch), stretch**-0.5

    def lateral(x: float) -> float:
        def stress(side: float) -> float:
            return float(_slope(lambda s: material.energy(HomogeneousStrain((x, s, s))), np.asarray(side)))

        guess = x**-material.poisson
        low = high = guess
        while stress(low) > 0.0:
            low *= 0.99
        while stress(high) < 0.0:
            high *= 1.01
        # Equal if the guess is the solution, or if the law has no stress (nan).
        return guess if low == high else float(brentq(stress, low, high, xtol=1e-15, rtol=1e-15))

    sides = np.vectorize(lateral, otypes=[float])(stretch)
    return _slope(lambda x: material.energy(HomogeneousStrain((x, sides, sides))), stretch), sides


def tube_pressure(material: Material, inner: float, outer: float, inner_stretch: npt.ArrayLike) -> Array:
    """Return the pressure in Pa inside a thick-walled incompressible tube that keeps its length, none outside.

    P = int W'(l) / (l^2 - 1) dl, W of planar tension (Ogden 1984, section 5.3.3 at axial stretch 1); see `sphere_pressure`,
    whose arguments it takes.
    """
    return _wall_pressure(material, inner, outer, inner_stretch, "planar", 2)
