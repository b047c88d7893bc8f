"""Families of fibres in the silicone or on a face of it: threads wound around a tube, the mesh of a McKibben muscle.

A fibre along a turns with the silicone around it and resists being stretched, nothing else. With x = a.C.a - 1, the change of
its squared length, and q = x^2 (the same of slack fibres, but 0 where they are shortened), the energies per undeformed volume
or area are

    standard       k q / 8                             Qiu & Pence 1997, doi 10.1023/A:1007410321319
    exponential    k (exp(b q) - 1) / (8 b)            Holzapfel, Gasser & Ogden 2000, doi 10.1023/A:1010835316564

so that k is the slope of the force over the strain at rest: Young's modulus times the fibres' share of the section in Pa, or
force per width in N/m on a face. The factor that Qiu & Pence call gamma is k/4; Holzapfel's k1 is k/4, his k2 is b.

Fibres that bear no compression take up their load over a small strain e, ``ONSET``, so that Newton's method sees no jump:
q = x^3 / (6 e) up to x = 2 e, x^2 - 2 e x + 4 e^2 / 3 beyond, whose second derivative is continuous.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import numpy.typing as npt

from geometries import Actuator
from geometries.fields import angle_field, choice_field, field_of, list_field, number_field
from geometries.kinds import Flag, Quantity, Words
from softmodels.materials.strain import Expression
from softmodels.mechanics.causes import Cause
from softmodels.mechanics.directions import Helix, check_axis, check_helix
from softmodels.mechanics.kinking import kinked, worst_kink
from softmodels.mechanics.named_places import check_faces, check_regions, names_in
from softmodels.mechanics.parts import INSIDE, EnergyPart, Equations, PartError, Setting, register_part
from softmodels.mechanics.sheet import locking
from softmodels.mechanics.strain_term import Place, StrainTerm, change_along, faces, regions

if TYPE_CHECKING:
    from ufl.core.expr import Expr

ONSET = 0.002
"""Strain over which fibres without compression take up their load."""
STIFFNESSES, MODULI = (1.0, 1e7), (1.0, 1e12)
"""Stiffnesses in N/m and moduli in Pa that are taken."""
MOST_EXPONENT = 1e4

FibreLaw = Callable[[Expression, Expression, Expression], Expression]
"""Energy of k, q and b; see the head of this file."""
FIBRE_LAWS: dict[str, FibreLaw] = {}


def fibre_law(name: str) -> Callable[[FibreLaw], FibreLaw]:
    """Let parts find a law of fibres by its name; a decorator."""

    def register(law: FibreLaw) -> FibreLaw:
        FIBRE_LAWS[name] = law
        return law

    return register


@fibre_law("standard")
def standard(k: Expr, q: Expr, b: Expr) -> Expr:
    return k * q / 8


@fibre_law("exponential")
def exponential(k: Expr, q: Expr, b: Expr) -> Expr:
    import ufl

    return k * (ufl.exp(b * q) - 1) / (8 * b)


def taut(x: Expr, onset: float = ONSET) -> Expr:
    """The square q of a change of squared length x, in UFL, that vanishes where it is negative; see the head of this file."""
    import ufl

    e = 2 * onset
    square = ufl.conditional(ufl.lt(x, e), x**3 / (3 * e), x**2 - e * x + e**2 / 3)
    return ufl.conditional(ufl.lt(x, 0), 0, square)


def slope_of(law: str, changes: npt.NDArray[np.float64], exponent: float, slack: bool) -> npt.NDArray[np.float64]:
    """Derivative by x of a law's energy over k, at changes x of squared length, as numbers.

    Args:
        law: One of `FIBRE_LAWS`.
        changes: x at which, shape (n,).
        exponent: b.
        slack: Whether fibres bear no compression.
    """
    import ufl
    from ufl.algorithms.apply_algebra_lowering import apply_algebra_lowering
    from ufl.algorithms.apply_derivatives import apply_derivatives

    found = []
    for change in changes:
        x = ufl.variable(ufl.as_ufl(float(change)))
        energy = FIBRE_LAWS[law](ufl.as_ufl(1.0), taut(x) if slack else x**2, ufl.as_ufl(float(exponent)))
        found.append(float(apply_derivatives(apply_algebra_lowering(ufl.diff(energy, x)))(())))
    return np.array(found)


@register_part
@dataclasses.dataclass(frozen=True)
class Fibres(EnergyPart):
    """One family of fibres, or two that cross.

    Attributes:
        on: Names of regions or of faces, with commas between; the whole body if empty.
        angle: Between the fibres and the axis, degrees.
        axis: Through the origin.
        helices: 1: at the angle; 2: at this angle and at its opposite.
        stiffness: On faces: force per width and strain at rest of each family, N/m.
        modulus: In regions: force per undeformed area and strain at rest of each family, Pa.
        law: One of `FIBRE_LAWS`.
        exponent: b of the exponential law.
        slack: Whether they bear no compression.
    """

    on: str = field_of(
        Words(),
        "faces or regions that they are on or in, such as 'outer' or 'outer, strip'; all of the body if empty",
        "",
    )
    angle: float = angle_field(54.7, "between the fibres and the axis: 0 along it, 90 deg around it")
    axis: tuple[float, ...] = list_field((0.0, 0.0, 1.0), "direction of the axis, through the origin", numbers=True)
    helices: int = choice_field(2, (1, 2), "1: wound one way, 2: two families wound both ways")
    stiffness: float = field_of(
        Quantity("N/m"), "of each family on a face: force per width over strain, such as '10 kN/m'", 0.0
    )
    modulus: float = field_of(
        Quantity("Pa"), "of each family in a region: force per area over strain, such as '5 MPa'", 0.0
    )
    law: str = field_of(Words(), "standard, or exponential: stiffer the more they are stretched", "standard")
    exponent: float = number_field(1.0, "how fast the exponential law stiffens (Holzapfel's k2)")
    slack: bool = field_of(Flag(), "whether they go slack in compression", False)

    table: ClassVar[str] = "fibres"
    figure_texts: ClassVar = {
        r"(\w+)_mean_stretch": ("stretch of {0}", "of those fibres, the mean over where they are"),
        r"(\w+)_mean_tension_kPa": ("tension of {0}", "force per undeformed area of each family, its mean"),
        r"(\w+)_mean_tension_N_per_m": ("tension of {0}", "force per undeformed width of each family, its mean"),
    }

    def check(self) -> None:
        check_axis(self.where, self.axis, self.angle)
        if self.law not in FIBRE_LAWS:
            raise PartError(f"{self.where}: law is {self.law!r}; it must be one of {', '.join(FIBRE_LAWS)}")
        if not 0.0 < self.exponent <= MOST_EXPONENT:
            raise PartError(f"{self.where}: exponent is {self.exponent:g}; it lies above 0, up to {MOST_EXPONENT:g}")
        if (self.stiffness == 0.0) == (self.modulus == 0.0):
            raise PartError(
                f"{self.where}: give one of stiffness (N/m, on a face) and modulus (Pa, in a region or the whole body)"
            )
        for value, unit, (least, most) in ((self.stiffness, "N/m", STIFFNESSES), (self.modulus, "Pa", MODULI)):
            if value and not least <= value <= most:
                name = "stiffness" if unit == "N/m" else "modulus"
                raise PartError(f"{self.where}: {name} is {value:g} {unit}; {least:g} to {most:g} {unit} are taken")

    def undesigned(self, actuator: Actuator) -> str:
        return INSIDE if self.modulus and self.on else ""

    @property
    def looked_up(self) -> tuple[object, ...]:
        return (FIBRE_LAWS[self.law],)

    def check_on(self, actuator: Actuator) -> None:
        check_helix(self.where, actuator, self.axis, self.angle, self.helices == 2)
        if self.modulus:
            check_regions(self.where, actuator, names_in(self.on))
        elif self.on:
            check_faces(self.where, actuator, names_in(self.on))
        else:
            raise PartError(
                f"{self.where}: on is empty; a stiffness in N/m is of fibres on a face, name it (on = 'outer')"
            )

    def hindrance(self, actuator: Actuator, figure: Callable[[str], float]) -> str:
        if self.modulus:
            kinks = (
                ""
                if self.slack
                else (
                    "; they bear compression, and where they are shortened with a stress of about the silicone's shear modulus "
                    "they kink it (Rosen 1965): slack = true lets them go slack instead"
                )
            )
            return (
                f"the fibres of {self.where} have a modulus of {self.modulus / 1e6:.4g} MPa: see whether the run goes on with "
                f"a smaller one, or a finer mesh{kinks}"
            )
        return (
            f"the fibres of {self.where} have {self.stiffness / 1e3:.4g} kN/m: see whether the run goes on with softer ones"
            f"{locking(self.stiffness, actuator)}"
        )

    def term(self, setting: Setting) -> FibreTerm:
        return FibreTerm(self, setting)


class FibreTerm(StrainTerm):
    """The term of `Fibres`; the strains are the changes of squared length x of the families."""

    def __init__(self, part: Fibres, setting: Setting):
        from dolfinx import fem

        self.label, self.in_face = part.label, part.stiffness > 0.0
        mesh = setting.body.mesh
        self._helix = Helix(mesh, part.axis, part.angle)
        self._k, self._b = fem.Constant(mesh, 0.0), fem.Constant(mesh, 0.0)
        self._part = part
        self._unit = setting.body.actuator.size if self.in_face else 1.0
        self.take(part)
        where = (faces if self.in_face else regions)(setting.body, names_in(part.on))
        super().__init__(setting, where, self._changes, self._energy)

    def take(self, part: Fibres) -> None:
        """Take another angle, axis, stiffness, modulus and exponent; nothing is compiled again."""
        self._helix.take(part.axis, part.angle)
        self._k.value = (part.stiffness or part.modulus) / self._unit
        self._b.value = part.exponent

    @property
    def stiffness(self) -> float:
        return float(self._k.value)

    def _changes(self, F: Expr, place: Place) -> Expr:
        import ufl

        hands = (1.0, -1.0)[: self._part.helices]
        return ufl.as_vector(
            [change_along(F, self._helix.field(self.setting.body, place.normal, hand)) for hand in hands]
        )

    def _energy(self, x: Expr) -> Expr:
        law, k = FIBRE_LAWS[self._part.law], self.setting.per_pascal * self._k
        squares = [taut(x[i]) if self._part.slack else x[i] ** 2 for i in range(self._part.helices)]
        return sum(law(k, square, self._b) for square in squares)

    def compile(self, equations: Equations) -> None:
        """Compile the means of stretch and tension, which is the energy's derivative by the stretch.

        Raises:
            PartError: A face that has no such direction.
        """
        import ufl
        from dolfinx import fem

        self.check_laid(self._part.where, lambda normal: self._helix.field(self.setting.body, normal), equations)

        one = fem.Constant(self.setting.body.mesh, 1.0)
        self._means = []
        for place in self.where:
            x = self._strains(self.setting.displacement, place)
            stretches = [ufl.sqrt(1 + x[i]) for i in range(self._part.helices)]
            tension = sum(2 * self.stress(x)[0][i] * stretch for i, stretch in enumerate(stretches))
            integrands = (one, sum(stretches), tension)
            self._means.append([equations.form(self.integral(integrand, place)) for integrand in integrands])

    def breakdown(self, equations: Equations) -> Cause | None:
        """Kinks of fibres that are compressed in the silicone; see `softmodels.mechanics.ellipticity`."""
        if self.in_face or self._part.slack:
            return None
        body, u, found = self.setting.body, self.setting.displacement, []
        for place, matter in itertools.product(self.where, equations.matter):
            cells = np.intersect1d(matter.cells, body.regions[place.name]) if place.name else matter.cells
            hands = (1.0, -1.0)[: self._part.helices]
            lines, x = [self._helix.field(body, None, hand) for hand in hands], self._strains(u, place)
            reinforced = (body.deformation_gradient(u), lines, x, self.stress(x))
            found.append(worst_kink(equations, cells.astype(np.int32), matter.material, *reinforced))
        worst = min((kink for kink in found if kink is not None), default=None)
        return None if worst is None or worst[0] >= 0.0 else kinked(self._part.where, worst)

    def figures(self, equations: Equations) -> dict[str, float]:
        integrals = [[equations.integral(form) for form in forms] for forms in self._means]
        size, stretch, tension = np.sum(integrals, axis=0).tolist()
        mean = tension / size / self._part.helices * equations.stress_unit
        name, value = ("N_per_m", mean * self._unit) if self.in_face else ("kPa", mean / 1e3)
        return {
            f"{self.label}_mean_stretch": stretch / size / self._part.helices,
            f"{self.label}_mean_tension_{name}": value,
        }
