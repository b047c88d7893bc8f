"""Largest stretch and largest von Mises stress, as smooth functions of the design.

The largest of many values has no derivative where two of them are equal. The mean of their p-th powers has, and its p-th root
lies below the largest; the factor between them, taken where the mesh was made, brings it there (Le, Norato, Bruns, Ha,
Tortorelli 2010, doi 10.1007/s00158-009-0440-y). How far it is off at another design is stated with each value.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import numpy.typing as npt

from softmodels.design.quantities.base import Measure, Quantity, Slopes, quantity
from softmodels.design.quantities.forms import FormMeasure
from softmodels.materials.strain import Strain, eigenvalues
from softmodels.mechanics.mpi import largest
from softmodels.results.stresses import principal_stretches, shape_stresses, von_mises

if TYPE_CHECKING:
    from ufl.core.expr import Expr

    from softmodels.design.designed_body import DesignedBody
    from softmodels.mechanics.system import State

Array = npt.NDArray[np.float64]

POWER = 16
"""p, even: the p/2-th power of the squares, which are smooth where the values vanish."""
WORTH_A_NOTE = 0.01
"""Share of the largest value from which a smooth one's distance is reported."""


class PeakMeasure(FormMeasure):
    """The largest of squares over the body, smoothly.

    Args:
        design: The meshed device.
        square: UFL expression of the squared value.
        largest_value: Gives the largest value at the integration points of the state that is loaded, over all ranks.
        counted_in_stress: Whether the value is in shear moduli.
    """

    def __init__(self, design: DesignedBody, square: Expr, largest_value: PeakOf, counted_in_stress: bool):
        from dolfinx import fem

        body = design.system.body
        forms = [
            density * body.hoop * body.measures()[0]
            for density in (square ** (POWER // 2), fem.Constant(body.mesh, 1.0))
        ]
        super().__init__(design, forms, self._root, counted_in_stress=counted_in_stress)
        self._largest, self._factor = largest_value, 0.0
        self._found = 0.0

    def _root(self, values: Array) -> tuple[float, Array]:
        value = self._factor * (values[0] / values[1]) ** (1 / POWER)
        return value, value / POWER * np.array([1 / values[0] if values[0] else 0.0, -1 / values[1]])

    def slopes(self, state: State | None) -> Slopes:
        self._found = self._largest(self.design)
        if self._factor == 0.0:
            self._factor = 1.0
            smooth = self.value(state)
            self._factor = self._found / smooth if smooth > 0.0 else 1.0
        return super().slopes(state)

    def note(self, value: float) -> str:
        apart = value / self._found - 1 if self._found else 0.0
        if abs(apart) < WORTH_A_NOTE:
            return ""
        side = "above" if apart > 0 else "below"
        return f"the smooth largest value lies {100 * abs(apart):.1f} % {side} the largest at the integration points"


class PeakOf:
    """The largest value at the integration points."""

    def __call__(self, design: DesignedBody) -> float:
        values = self.values(design, principal_stretches(design.gradients()))
        return float(largest(design.system.comm, float(values.max()) if values.size else -np.inf))

    def values(self, design: DesignedBody, stretches: Array) -> Array:
        raise NotImplementedError


class _Stretch(PeakOf):
    def values(self, design: DesignedBody, stretches: Array) -> Array:
        return stretches[..., -1]


class _Mises(PeakOf):
    def values(self, design: DesignedBody, stretches: Array) -> Array:
        return von_mises(shape_stresses(design.system.material, stretches))


@quantity
@dataclasses.dataclass(frozen=True, kw_only=True)
class MaxStretch(Quantity):
    """Largest principal stretch anywhere in the silicone."""

    name: ClassVar = "max_stretch"
    unit: ClassVar = "1"
    help: ClassVar = "largest principal stretch in the silicone (1 is undeformed)"

    def measure(self, design: DesignedBody) -> Measure:
        strain = design.strain
        return PeakMeasure(design, eigenvalues(strain.C)[0], _Stretch(), counted_in_stress=False)


@quantity
@dataclasses.dataclass(frozen=True, kw_only=True)
class VonMises(Quantity):
    """Largest von Mises stress anywhere in the silicone."""

    name: ClassVar = "von_mises"
    unit: ClassVar = "Pa"
    help: ClassVar = "largest von Mises stress in the silicone"

    def measure(self, design: DesignedBody) -> Measure:
        return PeakMeasure(design, _mises_square(design), _Mises(), counted_in_stress=True)


def _mises_square(design: DesignedBody) -> Expr:
    """Square of the von Mises stress in shear moduli: of the deviator of (dW/dF) F^T / J."""
    import ufl

    potential = design.system.potential
    F = ufl.variable(design.system.body.deformation_gradient(potential.displacement))
    strain = Strain(F)
    law = design.system.material
    stress = ufl.diff(law.shape(strain, potential.parameters), F) * F.T / strain.J
    deviator = stress - ufl.tr(stress) / 3 * ufl.Identity(3)
    return 1.5 * ufl.inner(deviator, deviator)
