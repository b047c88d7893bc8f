"""Quantities that are functions of integrals over the body: values and derivatives from UFL forms alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from softmodels.design.quantities.base import Measure, Slopes

if TYPE_CHECKING:
    import ufl

    from softmodels.design.designed_body import DesignedBody
    from softmodels.mechanics.system import State

Array = npt.NDArray[np.float64]
Combine = Callable[[Array], tuple[float, Array]]
"""Value of a function of integrals, and its slopes by them."""


class FormMeasure(Measure):
    """A function of integrals.

    Args:
        design: The meshed device.
        forms: UFL forms without arguments; those of the state are functions of `System.w`.
        combine: The function, and its slopes.
        counted_in_stress: Whether the function is in shear moduli.
        by_pressure: Derivatives of the last forms' sum by the pressures of the cavities, dimensionless.
    """

    def __init__(
        self, design: DesignedBody, forms: Sequence[ufl.Form], combine: Combine, *,
        counted_in_stress: bool = False, by_pressure: Sequence[ufl.Form] = (),
    ):  # fmt: skip
        import ufl

        self.design, self.combine, self.counted_in_stress = design, combine, counted_in_stress
        system, form = design.system, design.system.form
        self._forms = [form(one) for one in forms]
        test = ufl.TestFunction(system.space)
        self._slopes = [
            form(ufl.derivative(one, system.w, test)) if system.w in one.coefficients() else None for one in forms
        ]
        self._by_pressure = [form(one) for one in by_pressure]
        self._covectors = [design.motion.compiled(one) for one in forms]

    def _combined(self) -> tuple[float, Array]:
        """The value in SI units and its slopes by the integrals."""
        system = self.design.system
        unit = system.stress_unit if self.counted_in_stress else 1.0
        value, rates = self.combine(np.array([system.integral(form) for form in self._forms]))
        return unit * value, unit * rates

    def value(self, state: State | None) -> float:
        return self._combined()[0]

    def slopes(self, state: State | None) -> Slopes:
        system = self.design.system
        value, rates = self._combined()
        by_w: Array | None = None
        by_X = np.zeros(self.design.motion.entries)
        for rate, slope, covector in zip(rates, self._slopes, self._covectors, strict=True):
            if slope is not None:
                part = rate * system.assemble([slope])
                by_w = part if by_w is None else by_w + part
            by_X += rate * self.design.motion.assembled(covector)
        by_P = sum(
            (
                share * system.integral(form)
                for share, form in zip(system.coupling.shares, self._by_pressure, strict=False)
            ),
            0.0,
        )
        return Slopes(value, by_w, float(rates[-1] * by_P), by_X, self.note(value))

    def note(self, value: float) -> str:
        """A sentence on how far the value can be trusted."""
        return ""


def scaled(factor: float) -> Combine:
    """The sum of the integrals times a factor."""
    return lambda values: (factor * float(values.sum()), np.full(len(values), factor))
