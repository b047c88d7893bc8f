"""Numbers that carry a derivative: forward differentiation of the energies, exact to rounding.

An energy takes them in place of stretches. Complex values are welcome, so that a complex step through the same energy gives
a second derivative: by another stretch, or by a parameter of the law.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from softmodels.materials.strain import Expression, HomogeneousStrain


@dataclasses.dataclass(frozen=True, eq=False)
class Dual:
    """A value and its slope; numpy arrays of one shape, real or complex."""

    value: Expression
    slope: Expression
    __array_ufunc__ = None  # numpy's arrays leave the operation to this class

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
        lower = self.value ** (power - 1)  # one power for both: powers take most of the time
        return Dual(lower * self.value, power * lower * self.slope)

    def log(self) -> Dual:
        return Dual(np.log(self.value), self.slope / self.value)


class DualStrain(HomogeneousStrain):
    """Strain measures of principal stretches of which some are `Dual`."""

    @staticmethod
    def log(x: Expression) -> Expression:
        return x.log() if isinstance(x, Dual) else np.log(x)
