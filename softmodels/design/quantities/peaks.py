"""Peak stretch and peak von Mises stress of a design, as `softmodels.runs.state_values` has them: means over the 0.5 % of the
volume
where they are largest. The largest value at a point diverges under refinement at a sharp corner, so a limit satisfied
on one mesh is violated on the next; and it is not differentiable where two points are equal.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from softmodels.common.arrays import Array
from softmodels.design.quantities.base import (
    QUANTITIES,
    DesignQuantity,
    FormMeasure,
    Measure,
    Slopes,
    register_quantity,
)
from softmodels.materials.strain import Strain, eigenvalues
from softmodels.mechanics.mpi import largest
from softmodels.runs.state_values import ROUNDED, SHARE, principal_stretches, shape_stresses, volume_peak, von_mises

if TYPE_CHECKING:
    from ufl.core.expr import Expr

    from softmodels.design.body import DesignedBody
    from softmodels.mechanics.system import State


WORTH_A_NOTE = 0.02
"""Relative excess of the largest point value over the peak above which it is reported."""


class PeakMeasure(FormMeasure):
    """The peak of a field over the body; see `softmodels.runs.state_values`.

    The value q from which on the field counts is taken from the values at the integration points. There the peak is least as a
    function of q, so its derivatives are those at fixed q.

    Args:
        design: The meshed device.
        field: UFL expression of the field, differentiable where it counts.
        values_of: Its values at the integration points, from the principal stretches there.
        counted_in_stress: Whether the field is in shear moduli.
        rest: Its value at rest.
    """

    def __init__(
        self, design: DesignedBody, field: Expr, values_of: ValuesOf, counted_in_stress: bool, rest: float = 0.0
    ):
        import ufl
        from dolfinx import fem

        body = design.system.body
        self._q = fem.Constant(body.mesh, 1.0)
        x = (field - rest) / self._q - 1.0
        rounded = ufl.conditional(ufl.gt(x, ROUNDED), x, (x + ROUNDED) ** 2 / (4 * ROUNDED))
        excess = ufl.conditional(ufl.gt(x, -ROUNDED), rounded, 0.0)
        forms = [density * body.hoop * body.measures()[0] for density in (excess, fem.Constant(body.mesh, 1.0))]
        super().__init__(design, forms, self._peak, counted_in_stress=counted_in_stress)
        self._values_of, self._rest, self._top = values_of, rest, rest

    def _peak(self, values: Array) -> tuple[float, Array]:
        q, (above, volume) = float(self._q.value), values
        share = above / (SHARE * volume)
        return self._rest + q * (1.0 + share), q / (SHARE * volume) * np.array([1.0, -above / volume])

    def value(self, state: State | None) -> float:
        self._settle()
        return super().value(state)

    def slopes(self, state: State | None) -> Slopes:
        self._settle()
        return super().slopes(state)

    def _settle(self) -> None:
        """Compute q from the loaded state."""
        design, system = self.design, self.design.system
        values = self._values_of(design, principal_stretches(design.gradients()))
        _, q = volume_peak(system.comm, values, system.point_volumes(), self._rest)
        self._q.value = q - self._rest or 1.0
        self._top = largest(system.comm, float(values.max()) if values.size else 0.0)

    def note(self, value: float) -> str:
        top = self._top * (self.design.system.stress_unit if self.counted_in_stress else 1.0)
        if not value or top < (1.0 + WORTH_A_NOTE) * value:
            return ""
        shown = f"{top / 1e3:.4g} kPa" if self.counted_in_stress else f"{top:.4g}"
        return (
            f"the mean over the {100 * SHARE:g} % of the silicone where it is largest; the largest point value is {shown} "
            f"on this mesh, and grows with refinement at sharp corners and clamped edges"
        )


class ValuesOf:
    """A field at the integration points, from the principal stretches there: (cells, points, 3) to (cells, points)."""

    def __call__(self, design: DesignedBody, stretches: Array) -> Array:
        raise NotImplementedError


class _Stretch(ValuesOf):
    def __call__(self, design: DesignedBody, stretches: Array) -> Array:
        return stretches[..., -1]


class _Mises(ValuesOf):
    def __call__(self, design: DesignedBody, stretches: Array) -> Array:
        return von_mises(shape_stresses(design.system.material, stretches)) / design.system.stress_unit


@register_quantity
@dataclasses.dataclass(frozen=True, kw_only=True)
class PeakStretch(DesignQuantity):
    """Peak of the largest principal stretch: its mean over the 0.5 % of the silicone where it is largest."""

    name: ClassVar = "peak_stretch"
    unit: ClassVar = "1"
    help: ClassVar = (
        "largest principal stretch, the mean over the 0.5 % of the silicone where it is largest (1 is undeformed)"
    )

    def measure(self, design: DesignedBody) -> Measure:
        import ufl

        return PeakMeasure(
            design, ufl.sqrt(eigenvalues(design.strain.C)[0]), _Stretch(), counted_in_stress=False, rest=1.0
        )


@register_quantity
@dataclasses.dataclass(frozen=True, kw_only=True)
class PeakVonMises(DesignQuantity):
    """Peak of the von Mises stress: its mean over the 0.5 % of the silicone where it is largest."""

    name: ClassVar = "peak_von_mises"
    unit: ClassVar = "Pa"
    help: ClassVar = "largest von Mises stress, the mean over the 0.5 % of the silicone where it is largest"

    @property
    def title(self) -> str:
        return "peak von Mises stress"

    def measure(self, design: DesignedBody) -> Measure:
        import ufl

        field = ufl.sqrt(_mises_square(design) + 1e-12)  # the root is not differentiable at zero
        return PeakMeasure(design, field, _Mises(), counted_in_stress=True)


QUANTITIES.update({"max_stretch": PeakStretch, "von_mises": PeakVonMises})
"""Names in problem files of earlier versions, which meant a mean of high powers, fitted to the largest value at a point."""


def _mises_square(design: DesignedBody) -> Expr:
    """Return the square of the von Mises stress in shear moduli: of the deviator of (dW/dF) F^T / J."""
    import ufl

    potential = design.system.potential
    F = ufl.variable(design.system.body.deformation_gradient(potential.displacement))
    strain = Strain(F)
    law = design.system.material
    stress = ufl.diff(law.shape(strain, potential.parameters), F) * F.T / strain.J
    deviator = stress - ufl.tr(stress) / 3 * ufl.Identity(3)
    return 1.5 * ufl.inner(deviator, deviator)
