"""Closed forms that need no mesh: test specimens, balloons, thick-walled spheres and tubes of any law.

Every function takes the law's own energy and differentiates it by a complex step (Squire & Trapp 1998,
doi 10.1137/S003614459631241X), which is exact to rounding, so a new law is covered as soon as it has an energy. Except in
`uniaxial_compressible` the material is taken as incompressible, whatever its Poisson's ratio. Stresses come back in the
unit of the law's parameters (Pa); beyond a stretch that the law does not allow (Gent's chains are taut) they are nan.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from softmodels.materials.material import Material
from softmodels.materials.strain import Expression, HomogeneousStrain

Array = npt.NDArray[np.float64]
_STEP = 1e-30  # so small that its square vanishes beside 1: the difference quotient has no error of its own

MODES: dict[str, tuple[tuple[float, float, float], int]] = {
    "uniaxial": ((1.0, -0.5, -0.5), 1),
    "planar": ((1.0, 0.0, -1.0), 1),
    "equibiaxial": ((1.0, 1.0, -2.0), 2),
}
"""Tests of an incompressible specimen: principal stretches as powers of the imposed one, and how many sides are pulled."""


def energy_slope(material: Material, stretch: npt.ArrayLike, mode: str) -> Array:
    """Rise dW/d(stretch) in Pa of the energy along one of `MODES`; the shape follows ``stretch``."""
    powers = MODES[mode][0]
    stretch = np.asarray(stretch, dtype=float)

    def energy(x: Expression) -> Expression:
        return material.shape(HomogeneousStrain((x ** powers[0], x ** powers[1], x ** powers[2])), material)

    return _slope(energy, stretch)


def _slope(energy: Callable[[Expression], Expression], x: Array) -> Array:
    with np.errstate(invalid="ignore", divide="ignore"):
        # A logarithm of a negative number is nan in reals only; as a complex number it would pass for a stress.
        return np.where(np.isfinite(energy(x)), np.imag(energy(x + 1j * _STEP)) / _STEP, np.nan)


def nominal_stress(material: Material, stretch: npt.ArrayLike, mode: str = "uniaxial") -> Array:
    """Force per undeformed area on a side that is pulled, incompressible.

    Args:
        material: The law.
        stretch: Imposed stretch, any shape.
        mode: ``"uniaxial"`` (strip), ``"planar"`` (wide strip, also called pure shear) or ``"equibiaxial"`` (sheet).

    Returns:
        Nominal stress in Pa, shape of ``stretch``. Two sides share the work in ``"equibiaxial"``.
    """
    if mode not in MODES:
        raise ValueError(f"mode {mode!r} is not one of {', '.join(MODES)}")
    return energy_slope(material, stretch, mode) / MODES[mode][1]


def secant_modulus(material: Material, stretch: float) -> float:
    """Shear modulus in Pa of the neo-Hookean specimen with the same nominal stress at a uniaxial stretch."""
    return float(nominal_stress(material, stretch)) / (stretch - stretch**-2)


def uniaxial_compressible(material: Material, stretch: npt.ArrayLike) -> tuple[Array, Array]:
    """Uniaxial tension of a law with its own bulk; at ``poisson = 0.5`` the incompressible result.

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
        # Equal where the guess is the answer, and where the law has no stress (nan) at all.
        return guess if low == high else float(brentq(stress, low, high, xtol=1e-15, rtol=1e-15))

    sides = np.vectorize(lateral, otypes=[float])(stretch)
    return _slope(lambda x: material.energy(HomogeneousStrain((x, sides, sides))), stretch), sides


def balloon_pressure(material: Material, stretch: npt.ArrayLike, thickness_over_radius: float) -> Array:
    """Pressure in Pa in a thin spherical balloon: P = (t/R) W'(stretch) / stretch^2, W of equibiaxial tension.

    The work P dv on the volume 4/3 pi (stretch R)^3 is the rise of the energy of the volume 4 pi R^2 t. Terms of the order
    (t/R)^2 are dropped if R is the undeformed middle radius.

    Args:
        material: The law.
        stretch: Circumference over undeformed circumference, any shape.
        thickness_over_radius: t/R of the undeformed balloon.
    """
    stretch = np.asarray(stretch, dtype=float)
    return thickness_over_radius * energy_slope(material, stretch, "equibiaxial") / stretch**2


def balloon_limit(material: Material, thickness_over_radius: float, most: float = 10.0) -> tuple[float, float] | None:
    """First maximum of `balloon_pressure` between stretch 1 and ``most``.

    A neo-Hookean balloon has it at 7^(1/6) = 1.383.

    Returns:
        Stretch and pressure in Pa, or None where the pressure only rises.
    """
    from scipy.optimize import brentq

    def rise(stretch: Array | float, h: float = 1e-3) -> Array:
        near, far = (
            balloon_pressure(material, stretch + d, 1.0) - balloon_pressure(material, stretch - d, 1.0)
            for d in (h, 2 * h)
        )
        return (8 * near - far) / material.shear_modulus_0  # an error of h^4, far below what the root is wanted to

    scan = np.linspace(1.0, most, 2000)
    falls = np.flatnonzero(rise(scan) < 0.0)
    if not len(falls) or falls[0] == 0:
        return None
    stretch = float(brentq(rise, scan[falls[0] - 1], scan[falls[0]], xtol=1e-14))
    return stretch, float(balloon_pressure(material, stretch, thickness_over_radius))


def sphere_pressure(material: Material, inner: float, outer: float, inner_stretch: npt.ArrayLike) -> Array:
    """Pressure in Pa inside a thick-walled incompressible sphere, none outside.

    P = int W'(l) / (l^3 - 1) dl from the outer wall's stretch to the inner wall's (Ogden 1984, Non-linear Elastic
    Deformations, section 5.3.2; Green & Zerna 1968, section 3.10), W of equibiaxial tension. With l^3 - 1 falling as the
    cube of the radius R the same integral is int W' / (l^2 R) dR, which has no 0/0 at l = 1.

    Args:
        material: The law.
        inner: Undeformed inner radius in m.
        outer: Undeformed outer radius in m.
        inner_stretch: Inner radius over undeformed inner radius, any shape.
    """
    return _wall_pressure(material, inner, outer, inner_stretch, "equibiaxial", 3)


def tube_pressure(material: Material, inner: float, outer: float, inner_stretch: npt.ArrayLike) -> Array:
    """Pressure in Pa inside a thick-walled incompressible tube that keeps its length, none outside.

    P = int W'(l) / (l^2 - 1) dl, W of planar tension (Ogden 1984, section 5.3.3 at axial stretch 1); see `sphere_pressure`,
    whose arguments it takes.
    """
    return _wall_pressure(material, inner, outer, inner_stretch, "planar", 2)


def _wall_pressure(
    material: Material, inner: float, outer: float, inner_stretch: npt.ArrayLike, mode: str, power: int
) -> Array:
    """Equilibrium through a wall in which stretch^power - 1 falls as 1 / R^power, as incompressibility has it."""
    from scipy.integrate import quad

    def pressure(at_inner: float) -> float:
        def integrand(radius: float) -> float:
            stretch = (1 + (at_inner**power - 1) * (inner / radius) ** power) ** (1 / power)
            return float(energy_slope(material, stretch, mode)) / (stretch ** (power - 1) * radius)

        if not np.isfinite(integrand(inner)):
            return np.nan  # the inner wall is strained most: nothing beyond its limit can be integrated
        return float(quad(integrand, inner, outer, epsabs=1e-12 * material.shear_modulus_0, epsrel=1e-11)[0])

    return np.vectorize(pressure, otypes=[float])(np.asarray(inner_stretch, dtype=float))
