"""Measures of strain under one set of names, for UFL fields and for numpy numbers.

An energy is written once against these names. `Strain` builds them from a deformation gradient in UFL, and
`HomogeneousStrain` from principal stretches in numpy: numbers, or `Dual` numbers, which carry a derivative.
"""

from __future__ import annotations

import dataclasses
import functools
from typing import Any

import numpy as np

from softmodels.common.lazy import ufl

Expression = Any
"""Values of an energy's arguments: UFL expressions (untyped), numpy arrays or numbers, real or complex, or `Dual`."""


class StrainMeasures:
    """Strain measures available to an energy, in UFL and numpy. All dimensionless.

    Attributes:
        J: Volume ratio det F.
        I1: First invariant tr C.
        I2: Second invariant of C.
        I1_bar: First invariant of the isochoric part, J^(-2/3) I1.
        I2_bar: Second invariant of the isochoric part, J^(-4/3) I2.
        stretches_bar: The three isochoric principal stretches J^(-1/3) lambda_i.
        log: The natural logarithm of numbers of this kind.
    """

    J: Expression
    I1: Expression
    I2: Expression
    stretches_bar: Expression
    log: Expression

    @functools.cached_property
    def I1_bar(self) -> Expression:
        return self.J ** (-2 / 3) * self.I1

    @functools.cached_property
    def I2_bar(self) -> Expression:
        return self.J ** (-4 / 3) * self.I2


@dataclasses.dataclass(frozen=True, eq=False)
class Strain(StrainMeasures):
    """Strain measures of a UFL deformation gradient ``F`` (3 x 3)."""

    F: Expression

    @functools.cached_property
    def C(self) -> Expression:
        return self.F.T * self.F

    @functools.cached_property
    def J(self) -> Expression:
        return ufl.det(self.F)

    @functools.cached_property
    def I1(self) -> Expression:
        return ufl.tr(self.C)

    @functools.cached_property
    def I2(self) -> Expression:
        return (self.I1**2 - ufl.inner(self.C, self.C)) / 2

    @functools.cached_property
    def stretches_bar(self) -> tuple[Expression, Expression, Expression]:
        return tuple(ufl.sqrt(value) for value in eigenvalues(self.J ** (-2 / 3) * self.C))  # type: ignore[return-value]

    @staticmethod
    def log(x: Expression) -> Expression:
        return ufl.ln(x)


def eigenvalues(A: Expression, gap: float = 1e-4) -> tuple[Expression, Expression, Expression]:
    """Return the eigenvalues of a symmetric 3 x 3 UFL tensor near the identity's size, differentiable where they coincide.

    The trigonometric closed form (Smith 1961, doi 10.1145/355578.366316) has no derivative at repeated eigenvalues, which
    is where every simulation starts. Its radius and its cosine are kept ``gap`` away from their singular values; since
    they stay isotropic functions of A, sums over the eigenvalues are off by about ``gap**2`` only, and a second derivative
    loses about ``1e-16 / gap**2``: the two meet at the default.
    """
    mean = ufl.tr(A) / 3
    deviator = A - mean * ufl.Identity(3)
    radius = ufl.sqrt(ufl.inner(deviator, deviator) / 6 + gap**2)
    cosine = (1 - gap**2) * ufl.det(deviator) / (2 * radius**3)
    angle = ufl.acos(cosine) / 3
    first, second = (mean + 2 * radius * ufl.cos(angle + shift) for shift in (0.0, 2 * np.pi / 3))
    return first, second, 3 * mean - first - second


@dataclasses.dataclass(frozen=True, eq=False)
class HomogeneousStrain(StrainMeasures):
    """Strain measures of principal stretches: numpy arrays of one shape, real or complex, or `Dual`."""

    stretches: tuple[Expression, Expression, Expression]

    @functools.cached_property
    def J(self) -> Expression:
        a, b, c = self.stretches
        return a * b * c

    @functools.cached_property
    def I1(self) -> Expression:
        a, b, c = self.stretches
        return a * a + b * b + c * c

    @functools.cached_property
    def I2(self) -> Expression:
        a, b, c = self.stretches
        return (a * b) ** 2 + (b * c) ** 2 + (c * a) ** 2

    @functools.cached_property
    def stretches_bar(self) -> tuple[Expression, Expression, Expression]:
        scale = self.J ** (-1 / 3)
        a, b, c = self.stretches
        return scale * a, scale * b, scale * c

    @staticmethod
    def log(x: Expression) -> Expression:
        return x.log() if isinstance(x, Dual) else np.log(x)


# ----------------------------------------------------------------------------------------------------------------------
# Dual numbers: forward differentiation of the energies, exact to rounding.
#
# An energy accepts them instead of stretches. Complex values are allowed, so that a complex step through the same energy gives
# a second derivative: by another stretch, or by a parameter of the law.


@dataclasses.dataclass(frozen=True, eq=False)
class Dual:
    """A value and its slope; numpy arrays of one shape, real or complex."""

    value: Expression
    slope: Expression
    __array_ufunc__ = None  # numpy's arrays defer the operation to this class

    def __add__(self, other: Expression) -> Dual:
        if isinstance(other, Dual):
            return Dual(self.value + other.value, self.slope + other.slope)
        return Dual(self.value + other, self.slope)

    __radd__ = __add__

    def __neg__(self) -> Dual:
        return Dual(-self.value, -self.slope)

    def __sub__(self, other: Expression) -> Dual:
        return self + -other

    def __rsub__(self, other: Expression) -> Dual:
        return -self + other

    def __mul__(self, other: Expression) -> Dual:
        if isinstance(other, Dual):
            return Dual(self.value * other.value, self.slope * other.value + self.value * other.slope)
        return Dual(self.value * other, self.slope * other)

    __rmul__ = __mul__

    def __truediv__(self, other: Expression) -> Dual:
        return self * other**-1.0

    def __rtruediv__(self, other: Expression) -> Dual:
        return self**-1.0 * other

    def __pow__(self, power: Expression) -> Dual:
        lower = self.value ** (power - 1)  # a single power for both, because powers take most of the time
        return Dual(lower * self.value, power * lower * self.slope)

    def log(self) -> Dual:
        return Dual(np.log(self.value), self.slope / self.value)
