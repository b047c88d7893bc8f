"""A thin sheet bonded to a face of the silicone: fabric or film that limits its stretch.

The sheet shares the solid's displacements and resists stretching in its plane, not bending. It is an incompressible
neo-Hookean membrane in plane stress, whose energy per undeformed area is

    W = E t / 6 (I1 + 1/J^2 - 3)

with I1 and J of the surface deformation F (I - N N): the surface's own first invariant and change of area. To first order
this is a sheet of stiffness E t (N/m) and Poisson's ratio 1/2. Holzapfel 2000, Nonlinear Solid Mechanics, section 6.

It is integrated at six points of a facet. Where a stiff sheet bends with a slab that is membrane locking: a curved quadratic
facet cannot keep its lengths at all of them, and stresses between them grow with the stiffness until Newton's method fails
(Stolarski & Belytschko 1982, Membrane locking and reduced integration for curved elements, J. Appl. Mech. 49, 172). With three
points it fails at the same place. One point does not lock, but lets facets bulge between their centres: a closed sphere in a
sheet of 3 kN/m then takes 8 to 19 % less pressure than in closed form, where six points are right to 2e-4. What may serve both
is the mean of the metric over each facet. Lines of an axisymmetric section do not lock: rules of degree 2 and 4 agree to 1e-4.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from geometries import Actuator
from softmodels.common.arrays import Array
from softmodels.common.schema import Quantity, Words, field_of
from softmodels.mechanics.component import (
    Component,
    ComponentError,
    EnergyComponent,
    EnergyTerm,
    FormContext,
    MixedPointStress,
    bases,
    faces_of,
    register_component,
)

if TYPE_CHECKING:
    import ufl
    from dolfinx import fem
    from ufl.core.expr import Expr


SOFTEST, STIFFEST = 1.0, 1e7
"""Accepted stiffnesses in N/m: from 0.1 mm of gel to 1 cm of nylon."""
HARDLY_STRETCHES = 50e3
"""Stiffness in N/m with which the seminar actuator still reaches 177 cm."""


@register_component
@dataclasses.dataclass(frozen=True)
class Sheet(EnergyComponent):
    """A sheet on a face.

    Attributes:
        face: Faces or pieces of faces it is bonded to, such as ``"top"`` or ``"top, side within z > 2 mm"``; see
            `softmodels.mechanics.pieces`.
        stiffness: Young's modulus times thickness in N/m.

    Raises:
        ComponentError: A stiffness that no sheet has.
    """

    face: str = field_of(Words(), "bond a thin sheet to a face of the device, such as top")
    stiffness: float = field_of(
        Quantity("N/m"),
        "Young's modulus times thickness of the sheet, such as 50kN/m; this one is nearly inextensible on silicone",
    )

    table: ClassVar[str] = "sheet"
    optional: ClassVar[bool] = True
    needs: ClassVar[str] = "a sheet needs both its face and its stiffness (--sheet top --sheet-stiffness 50kN/m)"

    def check(self) -> None:
        if not self.face:
            raise ComponentError(self.needs)
        if not SOFTEST <= self.stiffness <= STIFFEST:
            raise ComponentError(
                f"the sheet's stiffness is {self.stiffness:.4g} N/m; it is Young's modulus times thickness, "
                f"{SOFTEST:g} to {STIFFEST:g} N/m (0.1 mm of polyester: about 400 kN/m; 50 kN/m is nearly inextensible on "
                "silicone)"
            )

    def check_on(self, actuator: Actuator) -> None:
        """Raise `ComponentError` if a device has no such face."""
        for face in bases(self.where, [self.face], actuator):
            if face not in faces_of(actuator):
                raise ComponentError(
                    f"sheet {face!r} is not a face of {type(actuator).__name__} for a sheet; use "
                    f"{' or '.join(faces_of(actuator)) or 'none of its faces'}"
                )

    def undesigned(self, actuator: Actuator) -> str:
        return ""

    @property
    def variable(self) -> Mapping[str, str]:
        return {"stiffness": "N/m"}

    def hindrance(self, actuator: Actuator, figure: Callable[[str], float]) -> str:
        return (
            f"a sheet of {self.stiffness / 1e3:.4g} kN/m is bonded to {self.face}: see whether the run goes on with a softer "
            f"one (--sheet-stiffness){locking(self.stiffness, actuator)}"
        )

    def term(self, setting: FormContext) -> SheetTerm:
        return SheetTerm(self, setting)


class SheetTerm(EnergyTerm):
    """A sheet's membrane energy; its stress in Newton's matrix is the one of `MixedPointStress`."""

    def __init__(self, sheet: Sheet, setting: FormContext):
        from dolfinx import fem

        self._setting = setting
        body = setting.body
        self._on_face, self._normal = body.sheet_face(sheet.face)
        self._pa = fem.Constant(body.mesh, 0.0)
        self.take(sheet)
        density = membrane_energy(body.deformation_gradient(setting.displacement), self._normal)
        super().__init__([self._integral(density)])

    def constants_of(self, part: Component) -> list[tuple[fem.Constant, Array]]:
        assert isinstance(part, Sheet)
        return [(self._pa, np.asarray(part.stiffness / self._setting.body.actuator.size))]

    def _integral(self, density: Expr) -> ufl.Form:
        return self._setting.per_pascal * self._pa * density * self._setting.body.hoop * self._on_face

    @property
    def stiffness(self) -> float:
        return float(self._pa.value)

    def tangent(self, foresight: MixedPointStress) -> list[ufl.Form]:
        import ufl

        body, w = self._setting.body, self._setting.w
        displacements = self._setting.displacement, foresight.displacement
        C, known = (surface_metric(body.deformation_gradient(u), self._normal) for u in displacements)
        stress = membrane_stress(known)
        predicted = stress + ufl.derivative(stress, foresight.known, foresight.move)
        return [self._integral(membrane_tangent(C, w, predicted, foresight.test, foresight.trial))]


def surface_metric(F: Expr, N: Expr) -> Expr:
    """Return C of the surface, in UFL: symmetric, with one eigenvalue 0, along the undeformed normal N."""
    import ufl

    surface = F * (ufl.Identity(3) - ufl.outer(N, N))
    return surface.T * surface


def membrane_stress(C: Expr) -> Expr:
    """Return the derivative of `membrane_energy` by C, in UFL."""
    import ufl

    I1 = ufl.tr(C)
    area = (I1**2 - ufl.inner(C, C)) / 2
    return (ufl.Identity(3) - (I1 * ufl.Identity(3) - C) / area**2) / 6


def membrane_tangent(C: Expr, w: fem.Function, predicted: Expr, test: Expr, trial: Expr) -> Expr:
    """Return the second derivative of `membrane_energy`, with predicted instead of current stress, in UFL.

    Args:
        C: `surface_metric` of w.
        w: The unknowns.
        predicted: Stress (`membrane_stress`) that turns with the sheet.
        test, trial: Directions.
    """
    import ufl

    along = ufl.derivative(C, w, test)
    stiffness = ufl.inner(ufl.derivative(membrane_stress(C), w, trial), along)
    return stiffness + ufl.inner(predicted, ufl.derivative(along, w, trial))


def membrane_energy(F: Expr, N: Expr) -> Expr:
    """Return the energy of the sheet per undeformed area and stiffness, in UFL.

    Args:
        F: Deformation gradient of the solid at the face, 3 x 3.
        N: Unit normal of the undeformed face, 3 components.
    """
    import ufl

    C = surface_metric(F, N)
    I1 = ufl.tr(C)
    area = (I1**2 - ufl.inner(C, C)) / 2  # the square of the change of area: C has one eigenvalue 0, along N
    return (I1 + 1 / area - 3) / 6


def locking(stiffness: float, actuator: Actuator) -> str:
    """Return a warning on a face reinforcement, in N/m, that locks: a clause starting with '; ', else empty."""
    if actuator.dimension == 2 or stiffness <= HARDLY_STRETCHES:
        return ""
    return (
        f"; {HARDLY_STRETCHES / 1e3:g} kN/m is nearly inextensible on silicone. On solid meshes a stiffer one locks, "
        "because its facets cannot bend without stretching. Smaller cells lock less"
    )
