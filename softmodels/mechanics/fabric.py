"""A woven fabric bonded to a face: two stiffnesses, along and across a direction, and little resistance to shear.

With E the Green strain of the face in the directions along (1) and across (2), and r = k2/k1, its energy per undeformed area is

    W = (k1 E11^2 + 2 v k2 E11 E22 + k2 E22^2) / (2 (1 - r v^2)) + 2 g E12^2

(Saint-Venant and Kirchhoff's orthotropic membrane; v is the contraction across for a pull along). A fabric that bears no
compression lets each yarn go slack by itself, over a small strain as `softmodels.mechanics.fibres` has it; v is 0 then. It
bends as freely as a sheet does, and locks as one on solid meshes: see `softmodels.mechanics.sheet`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from geometries import Actuator
from geometries.fields import angle_field, field_of, list_field, number_field
from geometries.kinds import Flag, Quantity, Words
from softmodels.mechanics.directions import Helix, check_axis, check_helix
from softmodels.mechanics.fibres import STIFFNESSES, taut
from softmodels.mechanics.named_places import check_faces, names_in
from softmodels.mechanics.parts import EnergyPart, Equations, PartError, Setting, register_part
from softmodels.mechanics.sheet import locking
from softmodels.mechanics.strain_term import NOWHERE, Place, StrainTerm, change_along, faces

if TYPE_CHECKING:
    from ufl.core.expr import Expr


@register_part
@dataclasses.dataclass(frozen=True)
class Fabric(EnergyPart):
    """An orthotropic sheet.

    Attributes:
        on: Names of faces, with commas between.
        along: Force per width over strain along the direction, N/m.
        across: The same across it.
        shear: Force per width over shear angle, N/m.
        poisson: Contraction across over extension along, pulled along.
        angle: Between the direction and the axis, degrees.
        axis: Through the origin.
        slack: Whether its yarns bear no compression.
    """

    on: str = field_of(Words(), "faces that it is bonded to, such as 'outer' or 'outer, strip'")
    along: float = field_of(Quantity("N/m"), "force per width over strain along its direction, such as '50 kN/m'")
    across: float = field_of(Quantity("N/m"), "force per width over strain across its direction")
    shear: float = field_of(Quantity("N/m"), "force per width over shear angle; 0 for loose yarns", 0.0)
    poisson: float = number_field(0.0, "contraction across over extension along; 0 of yarns that slide on each other")
    angle: float = angle_field(0.0, "between its direction and the axis: 0 along it, 90 deg around it")
    axis: tuple[float, ...] = list_field((0.0, 0.0, 1.0), "direction of the axis, through the origin", numbers=True)
    slack: bool = field_of(Flag(), "whether its yarns go slack in compression", False)

    table: ClassVar[str] = "fabric"
    needs: ClassVar[str] = "a fabric needs its face (on) and its stiffnesses along and across"
    figure_texts: ClassVar = {
        r"(\w+)_stretch_(along|across)": ("stretch of {0} {1}", "of that fabric's yarns, the mean over its face"),
    }

    def check(self) -> None:
        check_axis(self.where, self.axis, self.angle)
        for name in ("along", "across"):
            value, (least, most) = getattr(self, name), STIFFNESSES
            if not least <= value <= most:
                raise PartError(f"{self.where}: {name} is {value:g} N/m; {least:g} to {most:g} N/m are taken")
        if not 0.0 <= self.shear <= STIFFNESSES[1]:
            raise PartError(f"{self.where}: shear is {self.shear:g} N/m; 0 to {STIFFNESSES[1]:g} N/m are taken")
        most = (self.along / self.across) ** 0.5
        if abs(self.poisson) >= most:
            raise PartError(
                f"{self.where}: poisson is {self.poisson:g}; with these stiffnesses it stays below {most:.3g}, or the fabric "
                "would gain energy by being stretched"
            )
        if self.slack and self.poisson:
            raise PartError(f"{self.where}: yarns that go slack do not contract each other; leave out poisson or slack")

    def undesigned(self, actuator: Actuator) -> str:
        return ""

    def check_on(self, actuator: Actuator) -> None:
        names = names_in(self.on)
        if not names:
            raise PartError(f"{self.where}: on is empty; name the face that the fabric is bonded to")
        check_faces(self.where, actuator, names)
        check_helix(self.where, actuator, self.axis, self.angle, False)

    def hindrance(self, actuator: Actuator, figure: Callable[[str], float]) -> str:
        stiffest = max(self.along, self.across)
        return (
            f"the fabric of {self.where} has up to {stiffest / 1e3:.4g} kN/m: see whether the run goes on with a softer one"
            f"{locking(stiffest, actuator)}"
        )

    def term(self, setting: Setting) -> FabricTerm:
        return FabricTerm(self, setting)


class FabricTerm(StrainTerm):
    """The term of a `Fabric`; its strains are 2 E11, 2 E22 and 2 E12."""

    def __init__(self, part: Fabric, setting: Setting):
        from dolfinx import fem

        mesh = setting.body.mesh
        self.label, self._slack, self._called = part.label, part.slack, part.where
        self._size = setting.body.actuator.size
        self._helix = Helix(mesh, part.axis, part.angle)
        self._k: fem.Constant = fem.Constant(mesh, np.zeros(4))
        self.take(part)
        super().__init__(setting, faces(setting.body, names_in(part.on)), self._changes, self._energy)

    def take(self, part: Fabric) -> None:
        """Take other stiffnesses, another angle and axis; nothing is compiled again."""
        self._helix.take(part.axis, part.angle)
        coupled = part.poisson * part.across
        share = 1.0 - coupled * part.poisson / part.along
        self._k.value[:] = part.along / share, part.across / share, coupled / share, part.shear
        self._k.value[:] /= self._size

    @property
    def stiffness(self) -> float:
        return float(self._k.value.max())

    def _changes(self, F: Expr, place: Place) -> Expr:
        import ufl

        assert place.normal is not None
        along = self._helix.field(self.setting.body, place.normal)
        across = ufl.cross(place.normal, along)
        shear = ufl.dot(ufl.dot(F, along), ufl.dot(F, across)) / (ufl.dot(along, along) + NOWHERE)
        return ufl.as_vector([change_along(F, along), change_along(F, across), shear])

    def _energy(self, x: Expr) -> Expr:
        k = self._k
        first, second = (taut(x[i]) if self._slack else x[i] ** 2 for i in range(2))
        pulled = (k[0] * first + 2 * k[2] * x[0] * x[1] + k[1] * second) / 8
        return self.setting.per_pascal * (pulled + k[3] * x[2] ** 2 / 2)

    def compile(self, equations: Equations) -> None:
        """Compile the mean stretches; `PartError` for a face that has no such direction."""
        import ufl
        from dolfinx import fem

        self.check_laid(self._called, lambda normal: self._helix.field(self.setting.body, normal), equations)

        one = fem.Constant(self.setting.body.mesh, 1.0)
        self._means = []
        for place in self.where:
            x = self._strains(self.setting.displacement, place)
            integrands = (one, ufl.sqrt(1 + x[0]), ufl.sqrt(1 + x[1]))
            self._means.append([equations.form(self.integral(integrand, place)) for integrand in integrands])

    def figures(self, equations: Equations) -> dict[str, float]:
        integrals = [[equations.integral(form) for form in forms] for forms in self._means]
        area, *stretches = np.sum(integrals, axis=0).tolist()
        return {
            f"{self.label}_stretch_{name}": stretch / area
            for name, stretch in zip(("along", "across"), stretches, strict=True)
        }
