"""Families of fibres in the silicone or on its faces: threads wound around a tube, the braid of a McKibben muscle;
thin sheets and fabrics bonded to faces.

A fibre along a rotates with the silicone around it and resists only stretching. With x = a.C.a - 1, the change of
its squared length, and q = x^2 (the same of slack fibres, but 0 where they are shortened), the energies per undeformed volume
or area are

    standard       k q / 8                             Qiu & Pence 1997, doi 10.1023/A:1007410321319
    exponential    k (exp(b q) - 1) / (8 b)            Holzapfel, Gasser & Ogden 2000, doi 10.1023/A:1010835316564

so that k is the slope of the force over the strain at rest: Young's modulus times the fibres' share of the section in Pa, or
force per width in N/m on a face. The factor that Qiu & Pence call gamma is k/4; Holzapfel's k1 is k/4, his k2 is b.

Fibres without compression take up load over a small strain e, ``ONSET_STRAIN``, so that Newton's method meets no jump:
q = x^3 / (6 e) up to x = 2 e, x^2 - 2 e x + 4 e^2 / 3 beyond, whose second derivative is continuous.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from geometries import Actuator
from softmodels.common import names, schema
from softmodels.common.arrays import Array
from softmodels.common.lazy import Expr, fem, meshes, ufl
from softmodels.materials import laws, memory
from softmodels.materials.laws import Material
from softmodels.mechanics import compiling, component
from softmodels.mechanics.body import Body, cell_measure
from softmodels.mechanics.component import Component, ComponentError

# ----------------------------------------------------------------------------------------------------------------------
# A thin sheet bonded to a face of the silicone: fabric or film that limits its stretch.
#
# The sheet shares the solid's displacements and resists stretching in its plane, not bending. It is an incompressible
# neo-Hookean membrane in plane stress, whose energy per undeformed area is
#
#     W = E t / 6 (I1 + 1/J^2 - 3)
#
# with I1 and J of the surface deformation F (I - N N): the surface's own first invariant and change of area. To first order
# this is a sheet of stiffness E t (N/m) and Poisson's ratio 1/2. Holzapfel 2000, Nonlinear Solid Mechanics, section 6.
#
# It is integrated at six points of a facet. Where a stiff sheet bends with a slab that is membrane locking: a curved quadratic
# facet cannot keep its lengths at all of them, and stresses between them grow with the stiffness until Newton's method fails
# (Stolarski & Belytschko 1982, Membrane locking and reduced integration for curved elements, J. Appl. Mech. 49, 172). With
# three points it fails at the same place. One point does not lock, but lets facets bulge between their centres: a closed sphere
# in a sheet of 3 kN/m then takes 8 to 19 % less pressure than in closed form, where six points are right to 2e-4. What may
# serve both is the mean of the metric over each facet. Lines of an axisymmetric section do not lock: rules of degree 2 and 4
# agree to 1e-4.


MIN_STIFFNESS, MAX_STIFFNESS = 1.0, 1e7
"""Accepted stiffnesses in N/m: from 0.1 mm of gel to 10 mm of nylon."""
STIFF_SHEET = 50e3
"""Stiffness in N/m with which the seminar actuator still reaches 177 cm."""


@component.register_component
@dataclasses.dataclass(frozen=True)
class Sheet(component.EnergyComponent):
    """A sheet on faces or pieces of faces, such as ``"top, side within z > 2 mm"``; see `softmodels.mechanics.body`.

    Raises:
        ComponentError: A stiffness that no sheet has.
    """

    face: str = schema.field_of(schema.Words(), "bond a thin sheet to a face of the device, such as top")
    stiffness: float = schema.field_of(
        schema.Quantity("N/m"),
        "Young's modulus times thickness of the sheet, such as 50kN/m; this one is nearly inextensible on silicone",
    )

    table: ClassVar[str] = "sheet"
    differentiable: ClassVar[bool] = True
    optional: ClassVar[bool] = True
    needs: ClassVar[str] = "a sheet needs both its face and its stiffness (--sheet top --sheet-stiffness 50kN/m)"

    def check(self) -> None:
        if not self.face:
            raise ComponentError(self.needs)
        if not MIN_STIFFNESS <= self.stiffness <= MAX_STIFFNESS:
            raise ComponentError(
                f"the sheet's stiffness is {self.stiffness:.4g} N/m; it is Young's modulus times thickness, "
                f"{MIN_STIFFNESS:g} to {MAX_STIFFNESS:g} N/m (0.1 mm of polyester: about 400 kN/m; 50 kN/m is nearly "
                "inextensible on silicone)"
            )

    def check_on(self, actuator: Actuator) -> None:
        """Raise `ComponentError` if a device has no such face."""
        component.check_faces(self.where, actuator, [self.face])

    @property
    def variable(self) -> Mapping[str, str]:
        return {"stiffness": "N/m"}

    def hindrance(self, actuator: Actuator, figure: Callable[[str], float]) -> str:
        return (
            f"a sheet of {self.stiffness / 1e3:.4g} kN/m is bonded to {self.face}: see whether the run goes on with a softer "
            f"one (--sheet-stiffness){locking(self.stiffness, actuator)}"
        )

    def term(self, setting: component.FormContext) -> SheetTerm:
        return SheetTerm(self, setting)


class SheetTerm(component.EnergyTerm):
    """A sheet's membrane energy; its stress in Newton's matrix is the one of `MixedPointStress`."""

    def __init__(self, sheet: Sheet, setting: component.FormContext):
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

    def tangent(self, mixed_points: component.MixedPointStress) -> list[ufl.Form]:
        body, w = self._setting.body, self._setting.w
        displacements = self._setting.displacement, mixed_points.displacement
        C, known = (surface_metric(body.deformation_gradient(u), self._normal) for u in displacements)
        stress = membrane_stress(known)
        predicted = stress + ufl.derivative(stress, mixed_points.known, mixed_points.move)
        return [self._integral(membrane_tangent(C, w, predicted, mixed_points.test, mixed_points.trial))]


def surface_metric(F: Expr, N: Expr) -> Expr:
    """Return C of the surface, in UFL: symmetric, with one eigenvalue 0, along the undeformed normal N."""
    surface = F * (ufl.Identity(3) - ufl.outer(N, N))
    return surface.T * surface


def membrane_stress(C: Expr) -> Expr:
    """Return the derivative of `membrane_energy` by C, in UFL."""
    I1 = ufl.tr(C)
    area = (I1**2 - ufl.inner(C, C)) / 2
    return (ufl.Identity(3) - (I1 * ufl.Identity(3) - C) / area**2) / 6


def membrane_tangent(C: Expr, w: fem.Function, predicted: Expr, test: Expr, trial: Expr) -> Expr:
    """Return the second derivative of `membrane_energy` along two directions, in UFL, with ``predicted`` instead of current
    stress (`membrane_stress`), which turns with the sheet; C is `surface_metric` of w."""
    along = ufl.derivative(C, w, test)
    stiffness = ufl.inner(ufl.derivative(membrane_stress(C), w, trial), along)
    return stiffness + ufl.inner(predicted, ufl.derivative(along, w, trial))


def membrane_energy(F: Expr, N: Expr) -> Expr:
    """Return the energy of the sheet per undeformed area and stiffness, in UFL, by the solid's deformation gradient (3 x 3)
    and the undeformed face's unit normal."""
    C = surface_metric(F, N)
    I1 = ufl.tr(C)
    area = (I1**2 - ufl.inner(C, C)) / 2  # the square of the change of area: C has one eigenvalue 0, along N
    return (I1 + 1 / area - 3) / 6


def locking(stiffness: float, actuator: Actuator) -> str:
    """Return a warning on a face reinforcement, in N/m, that locks: a clause starting with '; ', else empty."""
    if actuator.dimension == 2 or stiffness <= STIFF_SHEET:
        return ""
    return (
        f"; {STIFF_SHEET / 1e3:g} kN/m is nearly inextensible on silicone. On solid meshes a stiffer one locks, "
        "because its facets cannot bend without stretching. Smaller cells lock less"
    )


# ----------------------------------------------------------------------------------------------------------------------
# A term of the potential that is a function of a few strains at every point of faces or regions: fibres, fabrics.
#
# Newton's matrix uses the stress of such a term as predicted from another state, like that of a sheet: see
# `softmodels.mechanics.potential.Potential.predict_stress`.


MIN_SQUARED_LENGTH = 1e-12
"""Squared length of a direction below which it counts as normal to the face."""
MIN_MEAN_SQUARE = 1e-4
"""Mean of that square over a face below which the direction is not usable there."""


@dataclasses.dataclass(frozen=True, eq=False)
class StrainSite:
    """Domain of integration of a term: a face with its unit normal, or a region; the name is empty for the whole body."""

    measure: ufl.Measure
    normal: Expr | None
    name: str = ""


def faces(body: Body, names: Sequence[str]) -> list[StrainSite]:
    """Return the faces of these names, which regions may bear too."""
    return [StrainSite(*body.sheet_face(name), name) for name in names]


def regions(body: Body, names: Sequence[str]) -> list[StrainSite]:
    """Return the regions of these names; the whole body if there are none."""
    if not names:
        return [StrainSite(body.measures()[0], None)]
    return [StrainSite(cell_measure(body, body.regions[name]), None, name) for name in names]


def change_along(F: Expr, direction: Expr) -> Expr:
    """Return the change of squared length of a line along a direction, over its squared length: 0 where there is no
    direction."""
    square, moved = ufl.dot(direction, direction), ufl.dot(F, direction)
    return (ufl.dot(moved, moved) - square) / (square + MIN_SQUARED_LENGTH)


class StrainTerm(component.EnergyTerm):
    """An energy per undeformed volume or area, ``density`` of a vector of ``strains`` of the deformation gradient and a place,
    integrated over places."""

    def __init__(
        self,
        setting: component.FormContext,
        where: Sequence[StrainSite],
        strains: Callable[[Expr, StrainSite], Expr],
        density: Callable[[Expr], Expr],
    ):
        self.setting, self.where, self.strains, self.density = setting, where, strains, density
        super().__init__([self.integral(density(self._strains(setting.displacement, place)), place) for place in where])

    def integral(self, integrand: Expr, place: StrainSite) -> ufl.Form:
        """Return the integral over a place of the slice, in an axisymmetric section of the device."""
        return integrand * self.setting.body.hoop * place.measure

    def _strains(self, displacement: Expr, place: StrainSite) -> Expr:
        return self.strains(self.setting.body.deformation_gradient(displacement), place)

    def compile_means(
        self, part: str, helix: Helix, of: Callable[[Expr], Sequence[Expr]], equations: component.Equations
    ) -> None:
        """Compile the integrals of functions of the strains for `means`.

        Raises:
            ComponentError: A face normal to the helix, along which the part cannot be laid.
        """
        body, constant = self.setting.body, fem.Constant(self.setting.body.mesh, 1.0)
        self._means = []
        for place in self.where:
            integrands = (constant, *of(self._strains(self.setting.displacement, place)))
            self._means.append([equations.form(self.integral(integrand, place)) for integrand in integrands])
            if place.normal is None:
                continue
            laid = helix.field(body, place.normal)
            square = equations.integral(equations.form(self.integral(ufl.dot(laid, laid), place)))
            if square < MIN_MEAN_SQUARE * equations.integral(self._means[-1][0]):
                raise ComponentError(
                    f"{part}: its direction is normal to the face {place.name}; use another angle or axis, or another face"
                )

    def means(self, equations: component.Equations) -> Array:
        """Return the means over all places of what `compile_means` has compiled."""
        size, *sums = np.sum([[equations.integral(form) for form in forms] for forms in self._means], axis=0)
        return np.array(sums) / size

    def stress(self, strains: Expr) -> tuple[Expr, Expr]:
        """Return the derivative of the energy by the strains, and its derivative."""
        x = ufl.variable(strains)
        first = ufl.diff(self.density(x), x)
        return first, ufl.diff(first, x)

    def tangent(self, mixed_points: component.MixedPointStress) -> list[ufl.Form]:
        """Return the second derivatives of `energies`, with predicted stress; see `EnergyTerm.tangent`."""
        w, test, trial = self.setting.w, mixed_points.test, mixed_points.trial
        forms = []
        for place in self.where:
            strains = self._strains(self.setting.displacement, place)
            along = ufl.derivative(strains, w, test)
            _, stiffness = self.stress(strains)
            known = self._strains(mixed_points.displacement, place)
            stress, slope = self.stress(known)
            predicted = stress + ufl.dot(slope, ufl.derivative(known, mixed_points.known, mixed_points.move))
            second = ufl.inner(ufl.dot(stiffness, ufl.derivative(strains, w, trial)), along)
            forms.append(self.integral(second + ufl.inner(predicted, ufl.derivative(along, w, trial)), place))
        return forms


# ----------------------------------------------------------------------------------------------------------------------
# Directions of reinforcement: along a line, around it, or in helices about it.
#
# A direction is given by an axis through the origin and an angle from it: 0 runs along the axis, 90 degrees around it (the hoop
# of a tube), angles in between give a helix. Both are constants of the forms. On a face the direction is projected into the
# face.


MIN_SQUARED_LENGTH = 1e-20
"""Squared length relative to the size below which no direction is defined: there is no hoop on the axis."""
MAX_SCALAR_PRODUCT = 1e-9
"""Largest scalar product of unit vectors that count as perpendicular."""


class Helix:
    """A field of directions in UFL, at an angle in degrees from an axis through the origin, three numbers of any length; its
    constants live on the mesh."""

    def __init__(self, mesh: meshes.Mesh, axis: Sequence[float], angle: float):
        self._axis: fem.Constant = fem.Constant(mesh, np.zeros(3))
        self._slopes: fem.Constant = fem.Constant(mesh, np.zeros(2))
        for constant, value in self.numbers(axis, angle):
            constant.value = value

    def numbers(self, axis: Sequence[float], angle: float) -> list[tuple[fem.Constant, Array]]:
        """Return its constants and their values for an axis and an angle, which may be complex."""
        unit, turn = np.asarray(axis, dtype=float), np.asarray(angle) * (math.pi / 180.0)
        return [(self._axis, unit / np.linalg.norm(unit)), (self._slopes, np.array([np.cos(turn), np.sin(turn)]))]

    def field(self, body: Body, normal: Expr | None, hand: float = 1.0) -> Expr:
        """Return the direction at every undeformed point, three components; laid into a face with a unit ``normal``, not of
        unit length where the face cuts through it. A ``hand`` of -1 is the helix that winds the other way."""
        X = ufl.SpatialCoordinate(body.mesh)
        place = ufl.as_vector([X[0], 0, X[1]]) if body.axisymmetric else X
        axis, (cosine, sine) = self._axis, (self._slopes[0], self._slopes[1])
        arm = ufl.cross(axis, place)
        direction = cosine * axis + hand * sine * arm / ufl.sqrt(ufl.dot(arm, arm) + MIN_SQUARED_LENGTH)
        if normal is None:
            return direction
        return direction - ufl.dot(direction, normal) * normal


def check_axis(where: str, axis: Sequence[float], angle: float) -> None:
    """Raise `ComponentError` for an invalid axis, or an angle out of range."""
    if len(axis) != 3 or not np.linalg.norm(axis) > 0.0:
        raise ComponentError(f"{where}: axis is {', '.join(f'{a:g}' for a in axis)}; it needs three numbers, not all zero")
    if abs(angle) > 90.0:
        raise ComponentError(f"{where}: angle is {schema.shown(angle, 'degree')}; it must be between -90 and 90 deg")


def check_helix(where: str, actuator: Actuator, axis: Sequence[float], angle: float, mirrored: bool) -> None:
    """Raise `ComponentError` for a direction that does not have the device's symmetry; axis and angle as of `Helix`. What is
    ``mirrored`` is its own mirror image, as two families at both angles are."""
    unit = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    crooked = min(abs(math.sin(math.radians(angle))), abs(math.cos(math.radians(angle)))) > MAX_SCALAR_PRODUCT
    if actuator.dimension == 2:
        if np.hypot(unit[0], unit[1]) > MAX_SCALAR_PRODUCT:
            raise ComponentError(
                f"{where}: in an axisymmetric section the axis must be 0, 0, 1; use a solid section for another"
            )
        if crooked and not mirrored:
            raise ComponentError(
                f"{where}: one helix at {schema.shown(angle, 'degree')} twists the device, but an axisymmetric "
                "section cannot twist; use a full solid, or both helices"
            )
    for plane in actuator.cut_planes:
        across = abs(float(unit @ np.asarray(plane.normal)))
        if actuator.dimension == 3 and MAX_SCALAR_PRODUCT < across < 1.0 - MAX_SCALAR_PRODUCT:
            raise ComponentError(f"{where}: the axis must lie in the plane of symmetry {plane.name} or be perpendicular to it")
        if actuator.dimension == 3 and crooked and not mirrored:
            raise ComponentError(
                f"{where}: one helix at {schema.shown(angle, 'degree')} is not symmetric about the plane "
                f"{plane.name}; model the whole device, or use both helices"
            )


# ----------------------------------------------------------------------------------------------------------------------
# Strong ellipticity of a reinforced silicone: whether it resists waves of any wavelength.
#
# Along a change m n^T of the deformation gradient, m any direction and n the wave's normal in the undeformed body, the energy
# has the second derivative m . Q(n) m, Q being the acoustic tensor. Waves that keep the volume (m square to F^-T n) feel
# neither the bulk modulus nor p, as J is linear along m n^T. If one of these second derivatives is negative, a state is not a
# minimum of the energy in any neighbourhood (Hadamard): the body forms localised bands as thin as the mesh allows.
# Compressed fibres do that, which then kink: Merodio & Ogden 2002, Material instabilities in fiber-reinforced nonlinearly
# elastic solids under plane deformation, Arch. Mech. 54; El Hamdaoui, Merodio & Ogden 2018, J. Eng. Math. 109.


WAVE_DIRECTIONS = 300
"""Wave directions in the solid, evenly over the half sphere; the energy's second derivative is smooth in them."""
SECTION_DIRECTIONS = 36
"""Wave directions in the plane of a section, whose waves stay in it."""
DIFFERENCE_STEP = 1e-3
"""Step of the second difference: its error is about the square, and rounding 1e-10."""


@dataclasses.dataclass(frozen=True, eq=False)
class Reinforced:
    """States of a silicone with k families of fibres at n points: deformation gradients, shape (n, 3, 3), undeformed
    directions of the fibres, unit vectors, shape (n, k, 3), and the first two derivatives of the fibres' energy by their
    change of squared length, over a stress unit, shape (n, k)."""

    gradients: Array
    lines: Array
    stresses: Array
    slopes: Array


def least_resistance(material: Material, unit: float, state: Reinforced, section: bool) -> Array:
    """Return the least second derivative of the energy along any wave that keeps the volume, with m and n of unit length,
    shape (n,): one shear modulus of the undeformed silicone, below 0 where ellipticity is lost.

    ``unit`` is Pa in one stress; the law may be a millionfold stiffer in bulk than in shear. Waves in an axisymmetric
    ``section`` stay in it, its second direction is the hoop.
    """
    least = np.full(len(state.gradients), math.inf)
    for normal in _normals(section):
        kept = np.linalg.solve(state.gradients.transpose(0, 2, 1), np.broadcast_to(normal, (len(least), 3))[..., None])[..., 0]
        kept /= np.linalg.norm(kept, axis=1)[:, None]
        if section:
            resistance = _along(material, unit, state, normal, np.cross(kept, (0.0, 1.0, 0.0)))
        else:
            resistance = _least_across(material, unit, state, normal, kept)
        least = np.fmin(least, resistance)
    return least


def _normals(section: bool) -> Array:
    if section:
        angle = np.linspace(0.0, math.pi, SECTION_DIRECTIONS, endpoint=False)
        return np.stack([np.cos(angle), np.zeros_like(angle), np.sin(angle)], axis=1)
    number = np.arange(WAVE_DIRECTIONS)
    height, turn = (number + 0.5) / WAVE_DIRECTIONS, number * math.pi * (1 + math.sqrt(5))
    radius = np.sqrt(1 - height**2)
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), height], axis=1)


def _least_across(material: Material, unit: float, state: Reinforced, normal: Array, kept: Array) -> Array:
    """Return the least over all m square to ``kept``: the lower eigenvalue of the acoustic tensor in that plane."""
    other = np.where(np.abs(kept[:, :1]) < 0.7, (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    first = np.cross(kept, other)
    first /= np.linalg.norm(first, axis=1)[:, None]
    second = np.cross(kept, first)
    a, b, both = (_along(material, unit, state, normal, m) for m in (first, second, first + second))
    mixed = (both - a - b) / 2
    lower: Array = (a + b) / 2 - np.hypot((a - b) / 2, mixed)
    return lower


def _along(material: Material, unit: float, state: Reinforced, normal: Array, m: Array) -> Array:
    """Return the second derivative of the energy along m normal^T; nan where the law has no energy (chains locked)."""
    F = state.gradients
    wave = DIFFERENCE_STEP * m[:, :, None] * normal[None, None, :]
    with np.errstate(invalid="ignore", divide="ignore"):
        energies = [_energy(material, F + sign * wave) for sign in (-1, 0, 1)]
    silicone = (energies[0] - 2 * energies[1] + energies[2]) / DIFFERENCE_STEP**2 / unit
    crossed = (state.lines @ normal) ** 2
    moved = np.einsum("pij,pkj->pki", F, state.lines)
    stretched = np.einsum("pki,pi->pk", moved, m) ** 2
    turned = (m**2).sum(axis=1)[:, None]
    fibres: Array = (crossed * (4 * state.slopes * stretched + 2 * state.stresses * turned)).sum(axis=1)
    return np.asarray(silicone) + fibres


def _energy(material: Material, F: Array) -> Array:
    a, b, c = np.linalg.svd(F, compute_uv=False).T
    return np.asarray(material.shape(laws.HomogeneousStrain((a, b, c)), material))


# ----------------------------------------------------------------------------------------------------------------------
# Kinking of the silicone by compressed fibres, in the loaded state.


MAX_POINTS = 300
"""Number of points checked, those with the most compressed fibres."""

Kink = tuple[float, float, tuple[float, float, float]]
"""Least resistance to a wave, in shear moduli, the change of squared length of the fibres there, and the place in m."""


def worst_kink(
    equations: component.Equations,
    cells: npt.NDArray[np.int32],
    material: Material,
    F: Expr,
    lines: Sequence[Expr],
    change: Expr,
    stress: tuple[Expr, Expr],
) -> Kink | None:
    """Return the point where the silicone with its fibres resists some wave least in the loaded state, the same on all ranks;
    None if no fibre is compressed.

    Args:
        equations: The state is loaded.
        cells: Owned local cells in which the fibres are in this silicone.
        material: The silicone.
        F: The deformation gradient.
        lines: Their directions, one of each family.
        change: Their changes of squared length, a vector.
        stress: Derivative of their energy by that, and the second.
    """
    body, families = equations.body, len(lines)
    parts = [F[i, j] for i in range(3) for j in range(3)]
    parts += [line[i] for line in lines for i in range(3)]
    parts += [change[k] for k in range(families)] + [stress[0][k] for k in range(families)]
    parts += [stress[1][k, k] for k in range(families)]
    place = ufl.SpatialCoordinate(body.mesh)
    parts += [place[i] for i in range(len(place))]
    table = fem.Expression(ufl.as_vector(parts), equations.points, jit_options=compiling.JIT)
    values = np.asarray(table.eval(body.mesh, cells)).reshape(-1, len(parts))  # no cells of this rank: no rows
    ends = np.cumsum([9, 3 * families, families, families, families])
    gradients, directions, changes, stresses, slopes, places = np.split(values, ends, axis=1)
    low = stresses.min(axis=1, initial=0.0)
    chosen = [i for i in np.argsort(low)[:MAX_POINTS] if low[i] < 0.0]
    kink = (math.inf, 0.0, (0.0, 0.0, 0.0))
    if chosen:
        lines_there = directions[chosen].reshape(-1, families, 3)
        state = Reinforced(gradients[chosen].reshape(-1, 3, 3), lines_there, stresses[chosen], slopes[chosen])
        resistance = least_resistance(material, equations.stress_unit, state, body.axisymmetric)
        i = int(np.argmin(resistance))
        flat = np.zeros((1, 3))
        flat[0, : places.shape[1]] = places[chosen[i]] * equations.length_unit
        x, y, z = (float(value) for value in body.actuator.device_points(flat)[0])
        kink = (float(resistance[i]), float(changes[chosen[i]].min()), (x, y, z))
    worst: Kink = min(equations.comm.allgather(kink))
    return worst if math.isfinite(worst[0]) else None


def kinked(where: str, kink: Kink) -> component.PathFailure:
    """Return the message on kinking fibres of a part."""
    place = ", ".join(f"{1e3 * x:.3g}" for x in kink[2])
    shortened = 1.0 - math.sqrt(1.0 + kink[1])
    return component.PathFailure(
        f"the fibres of {where} kink: near {place} mm they are shortened by {shortened:.1%}, and the "
        f"reinforced silicone has lost ellipticity, so the fibres fold in bands as thin as the mesh allows",
        "Let them go slack like threads (slack = true), use softer fibres or a stiffer silicone, or stay below",
    )


ONSET_STRAIN = 0.002
"""Strain over which fibres without compression take up load."""
STIFFNESSES, MODULI = (1.0, 1e7), (1.0, 1e12)
"""Accepted stiffnesses in N/m and moduli in Pa."""
MAX_EXPONENT = 1e4

FibreLaw = Callable[[memory.Expression, memory.Expression, memory.Expression], memory.Expression]
"""Energy as a function of k, q and b; see the module docstring."""
FIBRE_LAWS: names.Registry[FibreLaw] = names.Registry("fibre law")
"""By the name of the function."""
register_fibre_law = FIBRE_LAWS.register


@register_fibre_law
def standard(k: Expr, q: Expr, b: Expr) -> Expr:
    return k * q / 8


@register_fibre_law
def exponential(k: Expr, q: Expr, b: Expr) -> Expr:
    return k * (ufl.exp(b * q) - 1) / (8 * b)


def taut(x: Expr) -> Expr:
    """Return the square q of a change of squared length x, in UFL, that vanishes where it is negative; see the module
    docstring."""
    e = 2 * ONSET_STRAIN
    square = ufl.conditional(ufl.lt(x, e), x**3 / (3 * e), x**2 - e * x + e**2 / 3)
    return ufl.conditional(ufl.lt(x, 0), 0, square)


# ----------------------------------------------------------------------------------------------------------------------
# One family of fibres, or two that cross.


@component.register_component
@dataclasses.dataclass(frozen=True)
class Fibres(component.EnergyComponent):
    """One family of fibres, or two that cross."""

    on: str = schema.field_of(
        schema.Words(),
        "faces or regions with the fibres, such as 'outer' or 'outer, strip'; the whole body if empty",
        "",
    )
    angle: float = schema.angle_field(54.7, "angle between the fibres and the axis: 0 along it, 90 deg around it")
    axis: tuple[float, ...] = schema.list_field((0.0, 0.0, 1.0), "direction of the axis, through the origin", numbers=True)
    helices: int = schema.choice_field(2, (1, 2), "1: a single helix, 2: two families of opposite helices")
    stiffness: float = schema.field_of(
        schema.Quantity("N/m"),
        "stiffness of each family on a face: force per width over strain, such as '10 kN/m'",
        0.0,
    )
    modulus: float = schema.field_of(
        schema.Quantity("Pa"), "modulus of each family in a region: force per area over strain, such as '5 MPa'", 0.0
    )
    law: str = schema.field_of(schema.Words(), "fibre law: standard, or exponential (stiffening with stretch)", "standard")
    exponent: float = schema.number_field(1.0, "exponent of the exponential law (Holzapfel's k2)")
    slack: bool = schema.field_of(schema.Flag(), "whether they go slack in compression", False)

    table: ClassVar[str] = "fibres"
    differentiable: ClassVar[bool] = True
    figure_texts: ClassVar = {
        r"(\w+)_mean_stretch": ("stretch of {0}", "of those fibres, mean over their faces or regions"),
        r"(\w+)_mean_tension_kPa": ("tension of {0}", "force per undeformed area of each family, its mean"),
        r"(\w+)_mean_tension_N_per_m": ("tension of {0}", "force per undeformed width of each family, its mean"),
    }

    def check(self) -> None:
        check_axis(self.where, self.axis, self.angle)
        if self.law not in FIBRE_LAWS:
            raise self.error(f"law is {self.law!r}; it must be one of {', '.join(FIBRE_LAWS)}")
        if not 0.0 < self.exponent <= MAX_EXPONENT:
            raise self.error(f"exponent is {self.exponent:g}; it must be above 0 and at most {MAX_EXPONENT:g}")
        if (self.stiffness == 0.0) == (self.modulus == 0.0):
            raise self.error("give one of stiffness (N/m, on a face) and modulus (Pa, in a region or the whole body)")
        for value, unit, (least, most) in ((self.stiffness, "N/m", STIFFNESSES), (self.modulus, "Pa", MODULI)):
            if value and not least <= value <= most:
                name = "stiffness" if unit == "N/m" else "modulus"
                raise self.error(f"{name} is {value:g} {unit}; {least:g} to {most:g} {unit} are accepted")

    def inside(self, actuator: Actuator) -> tuple[str, ...]:
        return tuple(component.names_in(self.on)) if self.modulus else ()

    @property
    def variable(self) -> Mapping[str, str]:
        stiffness = {"modulus": "Pa"} if self.modulus else {"stiffness": "N/m"}
        return {"angle": "degree", **stiffness, **({"exponent": ""} if self.law == "exponential" else {})}

    @property
    def looked_up(self) -> tuple[object, ...]:
        return (FIBRE_LAWS[self.law],)

    def check_on(self, actuator: Actuator) -> None:
        check_helix(self.where, actuator, self.axis, self.angle, self.helices == 2)
        if self.modulus:
            component.check_regions(self.where, actuator, component.names_in(self.on))
        elif self.on:
            component.check_faces(self.where, actuator, component.names_in(self.on))
        else:
            raise self.error("on is empty; a stiffness in N/m needs a face (on = 'outer')")

    def hindrance(self, actuator: Actuator, figure: Callable[[str], float]) -> str:
        if self.modulus:
            kinks = (
                ""
                if self.slack
                else (
                    "; they take compression, and kink the silicone at a compressive stress of about its "
                    "shear modulus (Rosen 1965): with slack = true they go slack instead"
                )
            )
            return (
                f"the fibres of {self.where} have a modulus of {self.modulus / 1e6:.4g} MPa: try a smaller "
                f"one, or a finer mesh{kinks}"
            )
        return (
            f"the fibres of {self.where} have {self.stiffness / 1e3:.4g} kN/m: try softer ones"
            f"{locking(self.stiffness, actuator)}"
        )

    def term(self, setting: component.FormContext) -> FibreTerm:
        return FibreTerm(self, setting)


class FibreTerm(StrainTerm):
    """The term of `Fibres`; the strains are the changes of squared length x of the families."""

    def __init__(self, part: Fibres, setting: component.FormContext):
        self.label, self.in_face = part.label, part.stiffness > 0.0
        mesh = setting.body.mesh
        self._helix = Helix(mesh, part.axis, part.angle)
        self._k, self._b = fem.Constant(mesh, 0.0), fem.Constant(mesh, 0.0)
        self._part = part
        self._unit = setting.body.actuator.size if self.in_face else 1.0
        self.take(part)
        where = (faces if self.in_face else regions)(setting.body, component.names_in(part.on))
        super().__init__(setting, where, self._changes, self._energy)

    def constants_of(self, part: Component) -> list[tuple[fem.Constant, Array]]:
        assert isinstance(part, Fibres)
        stiffness = np.asarray((part.stiffness or part.modulus) / self._unit)
        return [*self._helix.numbers(part.axis, part.angle), (self._k, stiffness), (self._b, np.asarray(part.exponent))]

    @property
    def stiffness(self) -> float:
        return float(self._k.value)

    def _changes(self, F: Expr, place: StrainSite) -> Expr:
        hands = (1.0, -1.0)[: self._part.helices]
        return ufl.as_vector([change_along(F, self._helix.field(self.setting.body, place.normal, hand)) for hand in hands])

    def _energy(self, x: Expr) -> Expr:
        law, k = FIBRE_LAWS[self._part.law], self.setting.per_pascal * self._k
        squares = [taut(x[i]) if self._part.slack else x[i] ** 2 for i in range(self._part.helices)]
        return sum(law(k, square, self._b) for square in squares)

    def compile(self, equations: component.Equations) -> None:
        """Compile the means of stretch and tension, which is the energy's derivative by the stretch; `ComponentError` for a
        face that has no such direction."""

        def of(x: Expr) -> list[Expr]:
            stretches = [ufl.sqrt(1 + x[i]) for i in range(self._part.helices)]
            return [sum(stretches), sum(2 * self.stress(x)[0][i] * stretch for i, stretch in enumerate(stretches))]

        self.compile_means(self._part.where, self._helix, of, equations)

    def breakdown(self, equations: component.Equations) -> component.PathFailure | None:
        """Return the kinks of fibres that are compressed in the silicone."""
        if self.in_face or self._part.slack:
            return None
        body, u, kinks = self.setting.body, self.setting.displacement, []
        for place, matter in itertools.product(self.where, equations.matter):
            cells = np.intersect1d(matter.cells, body.regions[place.name]) if place.name else matter.cells
            hands = (1.0, -1.0)[: self._part.helices]
            lines, x = [self._helix.field(body, None, hand) for hand in hands], self._strains(u, place)
            reinforced = (body.deformation_gradient(u), lines, x, self.stress(x))
            kinks.append(worst_kink(equations, cells.astype(np.int32), matter.material, *reinforced))
        worst = min((kink for kink in kinks if kink is not None), default=None)
        return None if worst is None or worst[0] >= 0.0 else kinked(self._part.where, worst)

    def figures(self, equations: component.Equations) -> dict[str, float]:
        stretch, tension = (self.means(equations) / self._part.helices).tolist()
        mean = tension * equations.stress_unit
        name, value = ("N_per_m", mean * self._unit) if self.in_face else ("kPa", mean / 1e3)
        return {
            f"{self.label}_mean_stretch": stretch,
            f"{self.label}_mean_tension_{name}": value,
        }


# ----------------------------------------------------------------------------------------------------------------------
# A woven fabric bonded to a face: two stiffnesses, along and across a direction, and little resistance to shear.
#
# With E the Green strain of the face in the directions along (1) and across (2), and r = k2/k1, its energy per undeformed area
# is
#
#     W = (k1 E11^2 + 2 v k2 E11 E22 + k2 E22^2) / (2 (1 - r v^2)) + 2 g E12^2
#
# (Saint-Venant and Kirchhoff's orthotropic membrane; v is the contraction across for a pull along). A fabric without
# compression lets each yarn go slack separately, over a small strain as fibres do; v is 0 then. It has
# no bending stiffness, like a sheet, and locks like one on solid meshes: see the sheet above.


@component.register_component
@dataclasses.dataclass(frozen=True)
class Fabric(component.EnergyComponent):
    """An orthotropic sheet."""

    on: str = schema.field_of(schema.Words(), "faces to which it is bonded, such as 'outer' or 'outer, strip'")
    along: float = schema.field_of(schema.Quantity("N/m"), "force per width over strain along its direction, such as '50 kN/m'")
    across: float = schema.field_of(schema.Quantity("N/m"), "force per width over strain across its direction")
    shear: float = schema.field_of(schema.Quantity("N/m"), "force per width over shear angle; 0 for loose yarns", 0.0)
    poisson: float = schema.number_field(0.0, "contraction across over extension along; 0 for yarns that slide on each other")
    angle: float = schema.angle_field(0.0, "angle between its direction and the axis: 0 along it, 90 deg around it")
    axis: tuple[float, ...] = schema.list_field((0.0, 0.0, 1.0), "direction of the axis, through the origin", numbers=True)
    slack: bool = schema.field_of(schema.Flag(), "whether its yarns go slack in compression", False)

    table: ClassVar[str] = "fabric"
    differentiable: ClassVar[bool] = True
    needs: ClassVar[str] = "a fabric needs its faces (on) and its stiffnesses along and across"
    figure_texts: ClassVar = {
        r"(\w+)_stretch_(along|across)": ("stretch of {0} {1}", "of that fabric's yarns, the mean over its face"),
    }

    def check(self) -> None:
        check_axis(self.where, self.axis, self.angle)
        for name in ("along", "across"):
            value, (least, most) = getattr(self, name), STIFFNESSES
            if not least <= value <= most:
                raise self.error(f"{name} is {value:g} N/m; {least:g} to {most:g} N/m are accepted")
        if not 0.0 <= self.shear <= STIFFNESSES[1]:
            raise self.error(f"shear is {self.shear:g} N/m; 0 to {STIFFNESSES[1]:g} N/m are accepted")
        most = (self.along / self.across) ** 0.5
        if abs(self.poisson) >= most:
            raise self.error(
                f"poisson is {self.poisson:g}; with these stiffnesses it must be below {most:.3g}, "
                f"or stretching would release energy"
            )
        if self.slack and self.poisson:
            raise self.error("yarns that go slack do not contract each other; leave out poisson or slack")

    @property
    def variable(self) -> Mapping[str, str]:
        shear = {"shear": "N/m"} if self.shear else {}
        return {"along": "N/m", "across": "N/m", **shear, "angle": "degree"}

    def check_on(self, actuator: Actuator) -> None:
        names = component.names_in(self.on)
        if not names:
            raise self.error("on is empty; name the face to which the fabric is bonded")
        component.check_faces(self.where, actuator, names)
        check_helix(self.where, actuator, self.axis, self.angle, False)

    def hindrance(self, actuator: Actuator, figure: Callable[[str], float]) -> str:
        stiffest = max(self.along, self.across)
        return f"the fabric of {self.where} has up to {stiffest / 1e3:.4g} kN/m: try a softer one{locking(stiffest, actuator)}"

    def term(self, setting: component.FormContext) -> FabricTerm:
        return FabricTerm(self, setting)


class FabricTerm(StrainTerm):
    """The term of a `Fabric`; its strains are 2 E11, 2 E22 and 2 E12."""

    def __init__(self, part: Fabric, setting: component.FormContext):
        mesh = setting.body.mesh
        self.label, self._slack, self._called = part.label, part.slack, part.where
        self._size = setting.body.actuator.size
        self._helix = Helix(mesh, part.axis, part.angle)
        self._k: fem.Constant = fem.Constant(mesh, np.zeros(4))
        self.take(part)
        super().__init__(setting, faces(setting.body, component.names_in(part.on)), self._changes, self._energy)

    def constants_of(self, part: Component) -> list[tuple[fem.Constant, Array]]:
        assert isinstance(part, Fabric)
        coupled = part.poisson * part.across
        share = 1.0 - coupled * part.poisson / part.along
        stiffnesses = np.array([part.along / share, part.across / share, coupled / share, part.shear])
        return [*self._helix.numbers(part.axis, part.angle), (self._k, stiffnesses / self._size)]

    @property
    def stiffness(self) -> float:
        return float(self._k.value.max())

    def _changes(self, F: Expr, place: StrainSite) -> Expr:
        assert place.normal is not None
        along = self._helix.field(self.setting.body, place.normal)
        across = ufl.cross(place.normal, along)
        shear = ufl.dot(ufl.dot(F, along), ufl.dot(F, across)) / (ufl.dot(along, along) + MIN_SQUARED_LENGTH)
        return ufl.as_vector([change_along(F, along), change_along(F, across), shear])

    def _energy(self, x: Expr) -> Expr:
        k = self._k
        first, second = (taut(x[i]) if self._slack else x[i] ** 2 for i in range(2))
        pulled = (k[0] * first + 2 * k[2] * x[0] * x[1] + k[1] * second) / 8
        return self.setting.per_pascal * (pulled + k[3] * x[2] ** 2 / 2)

    def compile(self, equations: component.Equations) -> None:
        """Compile the mean stretches; raise `ComponentError` for a face without such a direction."""
        self.compile_means(self._called, self._helix, lambda x: [ufl.sqrt(1 + x[0]), ufl.sqrt(1 + x[1])], equations)

    def figures(self, equations: component.Equations) -> dict[str, float]:
        along, across = self.means(equations).tolist()
        return {f"{self.label}_stretch_along": along, f"{self.label}_stretch_across": across}
