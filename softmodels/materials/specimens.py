"""Test specimens: nominal stress under homogeneous stretch, and its exact slopes by the stretch and by every parameter.

All come from `Material.derivative`, so a new law needs only an energy. Compressible specimens find their free sides from the
condition that these carry no stress; the slopes follow by the implicit function theorem.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from softmodels.common.arrays import Array
from softmodels.materials.laws import Material
from softmodels.materials.strain import Expression

# ----------------------------------------------------------------------------------------------------------------------
# Closed-form solutions without a mesh: test specimens, balloons and thick-walled spheres of any law.
#
# The material is treated as incompressible for any Poisson's ratio, except by `respond`. Stresses come back in the unit of
# the law's parameters (Pa); beyond the locking stretch of a law (Gent) they are nan.


_STEP = 1e-30  # so small that its square vanishes relative to 1: no truncation error

MODES: dict[str, tuple[tuple[float, float, float], int]] = {
    "uniaxial": ((1.0, -0.5, -0.5), 1),
    "planar": ((1.0, 0.0, -1.0), 1),
    "equibiaxial": ((1.0, 1.0, -2.0), 2),
}
"""Tests of an incompressible specimen: principal stretches as powers of the imposed one, and the number of loaded sides."""
MODE_NAMES = tuple(MODES)


def _slope(
    law: Material, stretches: Sequence[Expression], change: Sequence[Expression], compressible: bool = False
) -> Expression:
    """Return `Material.derivative`; nan where the law has no energy. The logarithm of a negative number is that only for
    reals: of complex stretches it would count as a stress."""
    found = law.derivative(stretches, change, compressible)
    return np.where(np.isfinite(found.value), found.slope, np.nan)


def nominal_stress(material: Material, stretch: npt.ArrayLike, mode: str = "uniaxial") -> Array:
    """Return the force per undeformed area on a loaded side, incompressible.

    Args:
        material: The law.
        stretch: Imposed stretch, any shape.
        mode: ``"uniaxial"`` (strip), ``"planar"`` (wide strip, also called pure shear) or ``"equibiaxial"`` (sheet).

    Returns:
        Nominal stress in Pa, shape of ``stretch``. Two sides share the work in ``"equibiaxial"``.
    """
    _check(mode)
    with np.errstate(all="ignore"):
        return np.asarray(_incompressible_stress(material, np.asarray(stretch, dtype=float), mode))


def _check(mode: str) -> None:
    if mode not in MODES:
        raise ValueError(f"mode {mode!r} is not one of {', '.join(MODES)}")


def _incompressible_stress(law: Material, stretch: Expression, mode: str) -> Expression:
    powers, sides = MODES[mode]
    stretches = [stretch**power for power in powers]
    change = [power * side / stretch for power, side in zip(powers, stretches, strict=True)]
    return _slope(law, stretches, change) / sides


def secant_modulus(material: Material, stretch: float) -> float:
    """Return the shear modulus in Pa of the neo-Hookean specimen with the same nominal stress at a uniaxial stretch."""
    return float(nominal_stress(material, stretch)) / (stretch - stretch**-2)


def balloon_pressure(material: Material, stretch: npt.ArrayLike, thickness_over_radius: float) -> Array:
    """Return the pressure in Pa in a thin spherical balloon: P = 2 (t/R) S / stretch^2, S of equibiaxial tension.

    The work P dv on the volume 4/3 pi (stretch R)^3 is the rise of the energy of the volume 4 pi R^2 t. Terms of the order
    (t/R)^2 are dropped if R is the undeformed middle radius.

    Args:
        material: The law.
        stretch: Circumference over undeformed circumference, any shape.
        thickness_over_radius: t/R of the undeformed balloon.
    """
    stretch = np.asarray(stretch, dtype=float)
    return 2 * thickness_over_radius * nominal_stress(material, stretch, "equibiaxial") / stretch**2


def balloon_limit(material: Material, thickness_over_radius: float, most: float = 10.0) -> tuple[float, float] | None:
    """Return the first maximum of `balloon_pressure` between stretch 1 and ``most``.

    A neo-Hookean balloon has it at 7^(1/6) = 1.383.

    Returns:
        Stretch and pressure in Pa, or None where the pressure only rises.
    """
    from scipy.optimize import brentq

    def rise(stretch: Array | float) -> Array:
        with np.errstate(all="ignore"):
            found = _incompressible(material, np.asarray(stretch), "equibiaxial", ())
        return (found.tangent - 2 * found.stress / stretch) / material.shear_modulus_0

    scan = np.linspace(1.0, most, 2000)
    falls = np.flatnonzero(rise(scan) < 0.0)
    if not len(falls) or falls[0] == 0:
        return None
    stretch = float(brentq(rise, scan[falls[0] - 1], scan[falls[0]], xtol=1e-14))
    return stretch, float(balloon_pressure(material, stretch, thickness_over_radius))


def sphere_pressure(material: Material, inner: float, outer: float, inner_stretch: npt.ArrayLike) -> Array:
    """Return the pressure in Pa inside a thick-walled incompressible sphere, none outside.

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


def _wall_pressure(
    material: Material, inner: float, outer: float, inner_stretch: npt.ArrayLike, mode: str, power: int
) -> Array:
    """Return the equilibrium through a wall in which stretch^power - 1 falls as 1 / R^power, as incompressibility has it."""
    from scipy.integrate import quad

    def pressure(at_inner: float) -> float:
        def integrand(radius: float) -> float:
            stretch = (1 + (at_inner**power - 1) * (inner / radius) ** power) ** (1 / power)
            return MODES[mode][1] * float(nominal_stress(material, stretch, mode)) / (stretch ** (power - 1) * radius)

        if not np.isfinite(integrand(inner)):
            return np.nan  # the inner wall has the largest strain, so its limit ends the integration
        return float(quad(integrand, inner, outer, epsabs=1e-12 * material.shear_modulus_0, epsrel=1e-11)[0])

    return np.vectorize(pressure, otypes=[float])(np.asarray(inner_stretch, dtype=float))


_NEWTON = 60


@dataclasses.dataclass(frozen=True, eq=False)
class Response:
    """Stress of a specimen and its slopes; nan beyond what the law allows.

    Attributes:
        stress: Nominal stress in Pa of a pulled side, shape (n,).
        slopes: Its slopes by the parameters asked for, in Pa per their unit, shape (n, m).
        side: Stretch of a free side, shape (n,).
        by_stretch: Computes `tangent`.
    """

    stress: Array
    slopes: Array
    side: Array
    by_stretch: Callable[[], Array]

    @functools.cached_property
    def tangent(self) -> Array:
        """The stress' slope by the stretch in Pa, shape (n,), computed on demand because fits do not need it."""
        with np.errstate(all="ignore"):
            return self.by_stretch()


def respond(
    material: Material, stretch: npt.ArrayLike, mode: str = "uniaxial", parameters: Sequence[str] = ()
) -> Response:
    """Pull a specimen.

    Args:
        material: The law; at ``poisson = 0.5`` the specimen is incompressible.
        stretch: Imposed stretch, shape (n,).
        mode: One of `MODE_NAMES`.
        parameters: Names (see `Material.parameter_names`, or ``poisson``) to differentiate by.
    """
    _check(mode)
    stretch = np.asarray(stretch, dtype=float)
    with np.errstate(all="ignore"):  # beyond a law's locking stretch the numbers are nan on purpose
        if math.isinf(material.bulk):
            return _incompressible(material, stretch, mode, parameters)
        return _compressible(material, stretch, mode, parameters)


def nudged(material: Material, name: str, by: complex) -> Material:
    """Return an unchecked copy with one parameter changed, possibly to a complex value; only for evaluating its energy."""
    copy = object.__new__(type(material))
    for field in dataclasses.fields(material):
        value = getattr(material, field.name)
        if isinstance(value, tuple):
            value = tuple(v + by if name == f"{field.name}{i + 1}" else v for i, v in enumerate(value))
        elif name == field.name:
            value = value + by
        object.__setattr__(copy, field.name, value)
    return copy


def _incompressible(material: Material, stretch: Array, mode: str, parameters: Sequence[str]) -> Response:
    def by_step(law: Material, at: Expression) -> Array:
        return np.asarray(np.imag(_incompressible_stress(law, at, mode)) / _STEP + dead)

    stress = np.asarray(_incompressible_stress(material, stretch, mode))
    dead = 0.0 * stress  # nan where it is
    # The stretch stays real, so that only terms with the nudged parameter are complex: complex powers take most of a fit's
    # time.
    columns = [by_step(nudged(material, name, 1j * _STEP), stretch) for name in parameters]
    side = stretch ** MODES[mode][0][2]
    return Response(stress, _columns(columns, stretch), side, lambda: by_step(material, stretch + 1j * _STEP))


_SIDES = {
    "uniaxial": ((1.0, 0.0, 0.0), (0.0, 1.0, 1.0)),
    "planar": ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
    "equibiaxial": ((1.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
}
"""Which sides are pulled, and which are free; others keep their length."""


def _compressible(material: Material, stretch: Array, mode: str, parameters: Sequence[str]) -> Response:
    pulled, free = _SIDES[mode]

    def slopes(law: Material, a: Expression, s: Expression) -> tuple[Expression, Expression]:
        """Return dW/da and dW/ds of the loaded and the free sides."""
        stretches = [i * a + j * s + (1.0 - i - j) for i, j in zip(pulled, free, strict=True)]
        return _slope(law, stretches, pulled, True), _slope(law, stretches, free, True)

    side = _free_side(material, slopes, stretch, mode)
    stress = slopes(material, stretch, side)[0] / sum(pulled)
    dead = 0.0 * stress
    a, s = stretch.astype(complex), side.astype(complex)
    by_side = slopes(material, a, s + 1j * _STEP)

    def follow(moved: tuple[Expression, Expression]) -> Array:
        """Return the total derivative, with the free side moving so that it stays stress-free."""
        drift = -np.imag(moved[1]) / np.imag(by_side[1])
        total: Array = (np.imag(moved[0]) / _STEP + np.imag(by_side[0]) / _STEP * drift) / sum(pulled) + dead
        return total

    columns = [follow(slopes(nudged(material, name, 1j * _STEP), a, s)) for name in parameters]
    return Response(stress, _columns(columns, stretch), side, lambda: follow(slopes(material, a + 1j * _STEP, s)))


def _free_side(material: Material, slopes: Expression, stretch: Array, mode: str) -> Array:
    """Return the stretch of the free sides at which dW/ds vanishes: Newton from the incompressible side, safeguarded.

    The energy rises on both sides of the root, so that signs of the slope bracket it and a step outside is halved back in.
    """
    nu = material.poisson
    exact = stretch ** MODES[mode][0][2]  # what it would be at nu = 0.5
    side = exact ** (2 * nu if mode == "uniaxial" else nu / (1 - nu))  # Hooke's law in logarithms
    low, high = np.minimum(np.minimum(exact, 1.0), side) / 2, np.maximum(np.maximum(exact, 1.0), side) * 2
    for _ in range(_NEWTON):
        here = slopes(material, stretch, side)[1]
        low, high = np.where(here < 0.0, side, low), np.where(here > 0.0, side, high)
        rise = np.imag(slopes(material, stretch.astype(complex), side + 1j * _STEP)[1]) / _STEP
        step = side - here / rise
        step = np.where((step > low) & (step < high) & (rise > 0.0), step, np.sqrt(low * high))
        moved = np.abs(step - side) > 4e-16 * side
        side = np.where(np.isfinite(here), step, side)
        if not (moved & np.isfinite(here)).any():
            break
    return side


def _columns(columns: list[Array], stretch: Array) -> Array:
    return np.stack(columns, axis=-1) if columns else np.empty((*stretch.shape, 0))


def log_strain_stiffness(material: Material, stretch: npt.ArrayLike, mode: str) -> tuple[Array, Array]:
    """Return the Hessian of the incompressible energy in the logarithms of two principal stretches, the third following.

    It relates increments of Kirchhoff stress in a sheet to increments of logarithmic strain: Drucker's stability wants it
    positive definite.

    Args:
        material: The law.
        stretch: Stretch along a mode, shape (n,).
        mode: One of `MODE_NAMES`.

    Returns:
        The Hessian in Pa, shape (n, 2, 2), and I1 - 3 of the state, shape (n,).
    """
    stretch = np.asarray(stretch, dtype=float)
    e1, e2 = (np.log(stretch) * power for power in MODES[mode][0][:2])

    def gradient(a: Expression, b: Expression) -> list[Expression]:
        sides = np.exp(a), np.exp(b), np.exp(-a - b)
        return [_slope(material, sides, (i * sides[0], j * sides[1], -sides[2])) for i, j in np.eye(2)]

    with np.errstate(all="ignore"):
        first, second = gradient(e1 + 1j * _STEP, e2 + 0j), gradient(e1 + 0j, e2 + 1j * _STEP)
        H = np.moveaxis(np.imag([first, second]), (0, 1), (-2, -1)) / _STEP + 0.0 * gradient(e1, e2)[0][:, None, None]
        k = np.exp(2 * e1) + np.exp(2 * e2) + np.exp(-2 * (e1 + e2)) - 3
    return H, k


def strain_of(mode: str, stretch: npt.ArrayLike) -> Array:
    """Return I1 - 3 of an incompressible specimen, shape of ``stretch``."""
    powers, stretch = MODES[mode][0], np.asarray(stretch)
    return np.asarray(sum(stretch ** (2 * power) for power in powers) - 3)
