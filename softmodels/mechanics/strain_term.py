"""A term of the potential that is a function of a few strains at every point of faces or regions: fibres, fabrics.

Newton's matrix takes the stress of such a term as it is foreseen from another state, as that of a sheet: see
`softmodels.mechanics.potential.Potential.foresee`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from softmodels.mechanics.body import Body
from softmodels.mechanics.cell_measure import cell_measure
from softmodels.mechanics.foresight import Foresight
from softmodels.mechanics.parts import Equations, PartError, Setting, Term

if TYPE_CHECKING:
    import ufl
    from ufl.core.expr import Expr


NOWHERE = 1e-12
"""Square of a direction's length below which a face has none: it is cut at right angles."""
BARE = 1e-4
"""Mean of that square over a face below which nothing can be laid along the direction there."""


@dataclasses.dataclass(frozen=True, eq=False)
class Place:
    """Where a term is integrated.

    Attributes:
        measure: Of the face or region.
        normal: Unit normal of a face; None in a region.
        name: Of the face or region; empty for the whole body.
    """

    measure: ufl.Measure
    normal: Expr | None
    name: str = ""


def faces(body: Body, names: Sequence[str]) -> list[Place]:
    """The faces of these names, which regions may bear too."""
    return [Place(*body.sheet_face(name), name) for name in names]


def regions(body: Body, names: Sequence[str]) -> list[Place]:
    """The regions of these names; the whole body if there are none."""
    if not names:
        return [Place(body.measures()[0], None)]
    return [Place(cell_measure(body, body.regions[name]), None, name) for name in names]


def change_along(F: Expr, direction: Expr) -> Expr:
    """Change of squared length of a line along a direction, over its squared length: 0 where there is no direction."""
    import ufl

    square, moved = ufl.dot(direction, direction), ufl.dot(F, direction)
    return (ufl.dot(moved, moved) - square) / (square + NOWHERE)


class StrainTerm(Term):
    """An energy per undeformed volume or area that depends on a vector of strains.

    Args:
        setting: The potential it belongs to.
        where: Places that it is integrated over.
        strains: The vector of strains, of the deformation gradient and a place.
        density: The energy, of that vector.
    """

    def __init__(
        self,
        setting: Setting,
        where: Sequence[Place],
        strains: Callable[[Expr, Place], Expr],
        density: Callable[[Expr], Expr],
    ):
        self.setting, self.where, self.strains, self.density = setting, where, strains, density
        super().__init__([self.integral(density(self._strains(setting.displacement, place)), place) for place in where])

    def integral(self, integrand: Expr, place: Place) -> ufl.Form:
        """Integral over a place of the slice, in an axisymmetric section of the device."""
        return integrand * self.setting.body.hoop * place.measure

    def _strains(self, displacement: Expr, place: Place) -> Expr:
        return self.strains(self.setting.body.deformation_gradient(displacement), place)

    def check_laid(self, part: str, direction: Callable[[Expr], Expr], equations: Equations) -> None:
        """Refuse faces that a direction is square to, so that nothing can be laid along it there.

        Args:
            part: What is laid there, for messages.
            direction: Of a face's normal, see `softmodels.mechanics.directions.Helix.field`.
            equations: Compile and integrate.

        Raises:
            PartError: Which face.
        """
        import ufl
        from dolfinx import fem

        one = fem.Constant(self.setting.body.mesh, 1.0)
        for place in self.where:
            if place.normal is None:
                continue
            laid = direction(place.normal)
            integrands = (ufl.dot(laid, laid), one)
            square, area = (equations.integral(equations.form(self.integral(value, place))) for value in integrands)
            if square < BARE * area:
                raise PartError(
                    f"{part}: its direction is square to the face {place.name} and has no line in it; take another angle or "
                    "axis, or another face"
                )

    def stress(self, strains: Expr) -> tuple[Expr, Expr]:
        """Derivative of the energy by the strains, and its derivative."""
        import ufl

        x = ufl.variable(strains)
        first = ufl.diff(self.density(x), x)
        return first, ufl.diff(first, x)

    def tangent(self, foresight: Foresight) -> list[ufl.Form]:
        """Second derivatives of `energies`, their stress foreseen; see `Term.tangent`."""
        import ufl

        w, test, trial = self.setting.w, foresight.test, foresight.trial
        forms = []
        for place in self.where:
            strains = self._strains(self.setting.displacement, place)
            along = ufl.derivative(strains, w, test)
            _, stiffness = self.stress(strains)
            known = self._strains(foresight.displacement, place)
            stress, slope = self.stress(known)
            foreseen = stress + ufl.dot(slope, ufl.derivative(known, foresight.known, foresight.move))
            second = ufl.inner(ufl.dot(stiffness, ufl.derivative(strains, w, trial)), along)
            forms.append(self.integral(second + ufl.inner(foreseen, ufl.derivative(along, w, trial)), place))
        return forms
