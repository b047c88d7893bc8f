"""Sensitivity of equilibrium states to material parameters and lengths of the device; the mesh moved to
other lengths.

A state (w, P) satisfies R(w, P; theta) = 0 on the line a V + b P = d of its control, so that

        [ K      -q ] [dw/dtheta]     [ dR/dtheta            ]
        [ a q^T   b ] [dP/dtheta] = - [ a dV/dtheta at rest w ]

which is the matrix of Newton's method: one solve per parameter with the factorisation at hand, no finite differences, and
regular at limit points wherever the line crosses the path (Michaleris, Tortorelli & Vidal 1994, doi 10.1002/nme.1620371408).
dR/dtheta by material parameters is one compiled form per law, for all parameters: the derivative along a direction
whose components are Constants. Of a length it is the derivative by the mesh's coordinates along the motion of its nodes.

Silicone with a memory and friction add dR/dh dh/dtheta, h being what a step has of its beginning. It follows from the step
before by the derivatives of the same update (`InTime`): exact for the discrete steps, one solve per parameter and step.
"""

from __future__ import annotations

import contextlib
import copy
import dataclasses
import functools
import math
import types
from collections.abc import Callable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Protocol

import numpy as np
import numpy.typing as npt

from geometries import Actuator, actuator
from softmodels.common.arrays import Array
from softmodels.common.errors import GeometryError
from softmodels.common.lazy import Expr, PETSc, basix, fem, la, meshes, ufl
from softmodels.materials import laws, specimens
from softmodels.materials.laws import Material
from softmodels.mechanics import assembly, body, compiling, controls, mpi, newton, regions
from softmodels.mechanics.body import Body
from softmodels.mechanics.component import Component
from softmodels.mechanics.controls import Control
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import State, System

type Along = str | tuple[tuple[str, float], ...]
"""What a derivative is by: a parameter's name, or changes of several of `known_parameters`, `memory_parameters` and
`laws.FORM_ENERGIES`."""


class Sensitivity:
    """Derivatives of a device's states; with a ``motion`` of its mesh also by lengths.

    With a tolerance ``aside`` above 0 its linear equations are solved beside a path to it, by what the path has factorised, and
    do not count as the path's: that stays as it is without them.
    """

    def __init__(self, solver: Solver, motion: MeshMotion | None = None, aside: float = 0.0):
        self.solver, self.motion, self.aside, eq = solver, motion, aside, solver.system
        self._along = _Directions(eq)
        test = ufl.TestFunction(eq.space)
        self._material = [eq.form(ufl.derivative(energy, eq.w, test)) for energy in self._along.energies]
        self._of_terms: dict[str, _TermDirection] = {}
        self._by_form: dict[str, list[fem.Form]] = {}

    def _form(self, name: str) -> list[fem.Form]:
        """Return the derivative of the residual by a factor of `laws.FORM_ENERGIES` of the main material."""
        eq = self.solver.system
        energy = laws.FORM_ENERGIES[name](laws.Strain(eq.body.deformation_gradient(eq.potential.displacement)))
        whole = energy * eq.body.hoop * eq.potential.regions[0].dx
        return [eq.form(ufl.derivative(whole, eq.w, ufl.TestFunction(eq.space)))]

    @functools.cached_property
    def histories(self) -> list[HistoryDirection]:
        """Directions in which what the silicone and friction remember changes; none without a memory."""
        eq = self.solver.system
        laws = [LawHistory(eq, law) for law in self._along.laws if law.history is not None]
        return [*laws, *self._frictions]

    @functools.cached_property
    def _frictions(self) -> list[FrictionDirection]:
        terms = self.solver.system.potential.terms.items()
        return [FrictionDirection(self, label, term) for label, term in terms if isinstance(term, assembly.HistoryTerm)]

    @functools.cached_property
    def _moving(self) -> tuple[fem.Function, list[fem.Form], list[list[fem.Form]], fem.Form]:
        """A motion of the mesh's nodes, and the derivatives along it of the forces, of the loads and of the cavity's volume."""
        eq = self.solver.system
        assert self.motion is not None
        X, moving = ufl.SpatialCoordinate(eq.body.mesh), fem.Function(self.motion.space)
        forces = [eq.form(ufl.derivative(force, X, moving)) for force in eq.potential.forces]
        loads = [[eq.form(ufl.derivative(form, X, moving)) for form in forms] for forms in eq.dead.integrals]
        return moving, forces, loads, eq.form(ufl.derivative(eq.potential.cavity_volume, X, moving))

    def rates(self, state: State, control: Control, names: Sequence[str]) -> tuple[controls.Tangent, dict[str, Rate]]:
        """Return the derivatives of the state that stays on one line of pressure and volume (in SI units) as parameters
        change: the direction of the path, for one unit of the control's line, and a rate per name. The tangent matrix is
        factorised at the state.

        Args:
            state: A state of the system's present material and lengths.
            control: The line, dimensionless as for `Solver.solve`.
            names: Of `known_parameters`, or lengths of the device.

        Raises:
            NoConvergence: The linear solver failed: the line touches the path.
        """
        self.solver.factorise(state)
        along = self.solver.tangent(state, control, ADJOINT_TOLERANCE)
        return along, {name: self.rate(state, control, name) for name in names}

    def value(self, name: str) -> float:
        """Return the present value of a parameter; see `force`."""
        eq = self.solver.system
        where, _, own = name.rpartition(".")
        if where == regions.RATIO_PREFIX:
            return eq.ratios[int(own)]
        if (part := self._part(where)) is not None:
            return part.number(own)
        return regions.number_of(eq.material, own)

    def scale(self, name: str) -> float:
        """Return over which change of a parameter forces change by as much as they are: its value, or one like it where that is
        0; of a place the depth of a contact."""
        eq, (where, _, own) = self.solver.system, name.rpartition(".")
        part = self._part(where)
        if part is not None and part.variable.get(own) == "m":
            return CONTACT_DEPTH * eq.length_unit
        return abs(self.value(name)) or (eq.stress_unit if own in eq.material.parameters else 1.0)

    @contextlib.contextmanager
    def shifted(self, name: str, by: float) -> Iterator[None]:
        """Shift a parameter, unchecked, and restore it at the end."""
        eq = self.solver.system
        where, _, own = name.rpartition(".")
        part, material, ratios = self._part(where), eq.material, list(eq.ratios)
        components = [c.nudged(own, by) if c is part else c for c in eq.components]
        if where == regions.RATIO_PREFIX:
            ratios[int(own)] += by
        elif part is None:
            material = specimens.nudged(material, own, by)
        before = eq.material, eq.components, eq.ratios
        eq.take(material, components, ratios)
        try:
            yield
        finally:
            eq.take(*before)

    def _part(self, where: str) -> Component | None:
        """Return the part of a parameter's name; a region also goes by its own name alone."""
        return next((c for c in self.solver.system.components if where in (c.key, c.key.removeprefix("region."))), None)

    def force(self, name: Along) -> Force:
        """Return the derivative of the equations at the loaded state by any parameter: one of `known_parameters`;
        ``part.number`` with a part's `Component.key` and one of its `Component.variable`; or ``ratio.0`` for the ratio of
        the first cavity's pressure."""
        if not isinstance(name, str):
            return Force(*self.material_force(name), 0.0)
        eq = self.solver.system
        where, _, own = name.rpartition(".")
        if where == regions.RATIO_PREFIX:
            share = eq.direction * np.eye(len(eq.ratios))[int(own)]
            change = np.concatenate([share, np.zeros(len(eq.dead.forms))])
            w, here = eq.w.x.array, eq.volumes()
            kept = w.copy()
            w[:] = 0.0
            opened = float(share @ (here - eq.volumes()))
            w[:] = kept
            return Force(-eq.common_pressure() * change @ eq.pressure_loads(), 0.0, opened)
        part = self._part(where)
        if part is None or isinstance(part, regions.RegionPart):
            return Force(*self.material_force(name.removeprefix("region.")), 0.0)
        moved = [c.nudged(own, 1j * _COMPLEX_STEP) if c is part else c for c in eq.components]
        force = self._load_force(moved)
        if part.label in eq.potential.terms:
            force = force + self._terms(part).force(part.nudged(own, 1j * _COMPLEX_STEP))
        if len(self.histories) > len(self._frictions):
            force = force + self.material_force("")[0]  # what the silicone remembers changes with the part
        return Force(force, 0.0, 0.0)

    def _load_force(self, moved: Sequence[Component]) -> Array:
        """Return the residual's derivative along the imaginary parts of the parts' numbers, through the dead loads."""
        eq = self.solver.system
        force, dead = np.zeros(eq.n), eq.dead
        for i, (amount, shares) in enumerate(dead.magnitudes(moved)):
            drive, unit = dead.amounts[i] / dead.units[i], dead.units[i]
            if change := np.imag(amount) / _COMPLEX_STEP / unit:
                force -= change * eq.assemble(dead.forms[i])
            rates = [
                np.imag(share) / _COMPLEX_STEP / float(known.value)
                for share, (known, _) in zip(shares, dead.shares[i], strict=True)
            ]
            for rate, form in zip(rates, dead.forms[i], strict=False):
                if rate:
                    force -= drive * rate * eq.assemble([form])
        return force

    def _terms(self, part: Component) -> _TermDirection:
        if part.label not in self._of_terms:
            self._of_terms[part.label] = _TermDirection(self.solver.system, part)
        return self._of_terms[part.label]

    def turn(self, name: Along) -> None:
        """Point `histories` along a parameter; see `material_force` and `force`."""
        if len(self.histories) > len(self._frictions):
            self._along.turn(self.solver.system.material, name)
        where, _, own = name.rpartition(".") if isinstance(name, str) else ("", "", "")
        part, X = self._part(where), self._velocity(name)
        for friction in self._frictions:
            friction.turn(
                part.nudged(own, 1j * _COMPLEX_STEP) if part is not None and part.label == friction.label else None, X
            )

    def _velocity(self, name: Along) -> Array | None:
        """Return the motion of the mesh's nodes with a length; None of other parameters."""
        if self.motion is None or not isinstance(name, str) or name not in self.motion.device.movable:
            return None
        return self.motion.velocity(name)

    def material_force(self, name: Along) -> tuple[Array, float]:
        """Return the derivative of the residual (owned entries, shape (n,), dimensionless per SI unit) and of the shear
        modulus by one of `known_parameters` or `memory_parameters`, or along changes of them, at the loaded state; an empty
        name for no change of the material.

        Within a step in time it includes the direction in which `histories` say that its beginning changes.
        """
        eq = self.solver.system
        dmu = self._along.turn(eq.material, name)
        force = eq.assemble(self._material).copy()
        for form, factor in self._along.forms.items():
            if form not in self._by_form:
                self._by_form[form] = self._form(form)
            force += factor * eq.assemble(self._by_form[form])
        if eq.dead.forms:  # constant in newtons, so decreasing in shear moduli
            cavities = len(eq.pressures) - len(eq.dead.forms)
            force += dmu / eq.stress_unit * eq.pressures[cavities:] @ eq.pressure_loads()[cavities:]
        if eq.assembled.slack:  # and so are springs and weights in contact
            force -= dmu / eq.stress_unit * eq.by_unknowns(eq.assembled.add_harder(eq.w.x.array, np.zeros(eq.n)))
        return force, dmu

    def motion_force(self, X: Array) -> tuple[Array, float]:
        """Return the derivatives of the residual (owned entries, shape (n,)) and of the cavity's volume by a motion of the
        nodes, see `Rate`, at the loaded state; dimensionless."""
        eq, (moving, forces, loads, volume) = self.solver.system, self._moving
        moving.x.array[:] = X.ravel()
        force = eq.assemble(forces).copy()
        for magnitude, forms in zip(eq.pressures[len(eq.pressures) - len(loads) :], loads, strict=True):
            force -= magnitude * eq.assemble(forms)  # a thicker part is heavier
        for magnitude, own in zip(eq.pressures[len(eq.pressures) - len(loads) :], self.measured, strict=True):
            for slope in own:  # a force stays the same on a face that grows
                force -= magnitude * eq.assemble(slope.turned(moving))
        if eq.assembled.slack:
            moved = np.zeros(eq.n)
            force += eq.by_unknowns(eq.assembled.add_moved(eq.w.x.array, self.motion.at_nodes(X), moved))  # type: ignore[union-attr]
        return force, eq.integral(volume)

    @functools.cached_property
    def measured(self) -> list[list[MeasuredSlope]]:
        """How each load changes with the constants that follow the mesh."""
        eq = self.solver.system
        assert self.motion is not None
        loads = zip(eq.dead.measured, eq.dead.integrals, strict=True)
        return [[MeasuredSlope(eq, self.motion, measured, forms) for measured in own] for own, forms in loads]

    def rate(self, state: State, control: Control, name: Along, rise: float = 0.0) -> Rate:
        """Return one of `rates`, by a length or any parameter of `force`; an empty name for no change of the device. The state
        is loaded, and `rates` has been called at it unless they are ``aside``.

        ``rise`` is the derivative of the line's left side, dimensionless, beside what the line in Pa and m3 has itself.
        """
        eq, X = self.solver.system, self._velocity(name)
        if X is None:
            own = self.force(name)
            force, dmu, opened = own.residual, own.stress, own.opened
        else:
            dmu, (force, opened) = 0.0, self.motion_force(X)
        for friction in self._frictions:
            force = force + friction.force()
        mu = eq.stress_unit
        # The line is fixed in Pa and m3; in shear moduli it moves with the shear modulus.
        gap = rise - control.volume_coefficient * opened - control.pressure_coefficient * state.P * dmu / mu
        # So are pressures beside it, of which `material_force` has those of dead loads, with what P has in them.
        beside, cavities = -state.P * eq.coupling.shares, len(eq.pressures) - len(eq.dead.forms)
        beside[:cavities] += eq.pressures[:cavities]
        if dmu and beside.any():
            force = force + dmu / mu * beside @ eq.pressure_loads()
        eq.assembled.whole = True
        try:
            if self.aside:
                moved = self.solver.aside(state, control, -force, self.aside, gap)
            else:
                moved = self.solver.linear_response(-force, gap, ADJOINT_TOLERANCE)
        finally:
            eq.assembled.whole = False
        return Rate(moved.w, moved.P * mu + state.P * dmu, (moved.V + opened) * eq.volume_unit, X)


def slope_along(form: ufl.Form, turns: Mapping[fem.Constant, fem.Constant]) -> ufl.Form | None:
    """Return the derivative of a form along a direction in the space of constants; None if it has none of them."""
    turns = {constant: turn for constant, turn in turns.items() if constant in form.constants()}
    if not turns:
        return None
    variables = {constant: ufl.variable(constant) for constant in turns}
    integrals = []
    for integral in form.integrals():
        integrand = ufl.replace(integral.integrand(), variables)
        for constant, turn in turns.items():
            slope = ufl.diff(integrand, variables[constant])
            integrals.append(integral.reconstruct(integrand=ufl.dot(slope, turn) if turn.ufl_shape else slope * turn))
    return ufl.Form(integrals)


class _TermDirection:
    """The derivative of a part's energy along a direction in the space of its constants."""

    def __init__(self, eq: System, part: Component):
        self.eq, self.term = eq, eq.potential.terms[part.label]
        self.turns = {
            known: fem.Constant(eq.body.mesh, np.zeros_like(known.value)) for known, _ in self.term.constants_of(part)
        }
        slopes = [slope_along(energy, self.turns) for energy in self.term.energies]
        test = ufl.TestFunction(eq.space)
        self._forms = [eq.form(ufl.derivative(slope, eq.w, test)) for slope in slopes if slope is not None]

    def force(self, moved: Component) -> Array:
        """Return the residual's derivative along the imaginary parts of a nudged part's numbers."""
        eq = self.eq
        for constant, value in self.term.constants_of(moved):
            self.turns[constant].value = np.imag(value) / _COMPLEX_STEP
        force = eq.assemble(self._forms).copy()
        if isinstance(self.term, assembly.AssembledTerm):
            b = self.term.add_relocated(eq.w.x.array, _relocation(moved, eq), np.zeros(eq.n))
            force += eq.by_unknowns(b)
        return force


class MeasuredSlope:
    """How a load changes with one of the constants that follow the mesh (`MeasuredConstant`); ``forms`` are those of its unit
    magnitude."""

    def __init__(self, eq: System, motion: MeshMotion, measured: controls.MeasuredConstant, forms: Sequence[ufl.Form]):
        self.eq, self.motion, self.measured = eq, motion, measured
        self.turn = fem.Constant(eq.body.mesh, np.zeros_like(measured.constant.value))
        slopes = [slope_along(form, {measured.constant: self.turn}) for form in forms]
        self.slopes = [slope for slope in slopes if slope is not None]
        self._compiled = [eq.form(slope) for slope in self.slopes]
        self._values = [eq.form(form) for form in measured.integrals]

    @functools.cached_property
    def _by_nodes(self) -> list[fem.Form]:
        return [self.motion.compiled(form) for form in self.measured.integrals]

    def rates(self) -> Array:
        """Return the constant's derivatives by the integrals, shape (integrals, ...)."""
        here = np.array([self.eq.integral(form) for form in self._values])
        steps = 1j * _COMPLEX_STEP * np.eye(len(here))
        return np.array([np.imag(self.measured.value(here + step)) / _COMPLEX_STEP for step in steps])

    def turned(self, moving: fem.Function) -> list[fem.Form]:
        """Return the forms of the load's change with a motion of the mesh's nodes, in a function of their space."""
        x = moving.x.array
        owned = slice(0, self.motion.owned_entries)
        along = [mpi.total(self.eq.comm, float(self.motion.assembled(form)[owned] @ x[owned])) for form in self._by_nodes]
        self.turn.value = np.tensordot(np.array(along), self.rates(), 1)
        return self._compiled

    def covector(self, work: Callable[[list[ufl.Form]], list[fem.Form]]) -> Array:
        """Return the derivative of the load's work on a displacement by the mesh's nodes; ``work`` compiles it of forms."""
        if not hasattr(self, "_works"):
            self._works = work(self.slopes)
        by_constant = np.zeros(self.turn.value.size)
        for k in range(by_constant.size):
            self.turn.value = np.eye(by_constant.size)[k].reshape(self.turn.value.shape)
            by_constant[k] = sum(self.eq.integral(form) for form in self._works)
        weights = self.rates().reshape(len(self._values), -1) @ by_constant
        return sum(
            (weight * self.motion.assembled(form) for weight, form in zip(weights, self._by_nodes, strict=True)),
            np.zeros(self.motion.entries),
        )


class InTime:
    """Derivatives of a device's states through steps that remember those before, from rest on: of silicone with a memory by
    ``names`` of `known_parameters` or `memory_parameters`, or by name along changes of several, and by numbers of loads, of
    friction by lengths and all parameters of `Sensitivity.force`; and by ``loads``, by which only the control's values change.

    Viscosity that depends on stress has none at rest where its exponent is below 1.
    """

    def __init__(self, sensitivity: Sensitivity, names: Sequence[str] | Mapping[str, Along], loads: Sequence[str] = ()):
        alone: Mapping[str, Along] = names if isinstance(names, Mapping) else {name: name for name in names}
        self.sensitivity = sensitivity
        self._own: dict[str, Along] = {**alone, **dict.fromkeys(loads, "")}
        self.names = tuple(self._own)
        self._values: dict[str, list[Array]] = {}
        for name, own in self._own.items():
            sensitivity.turn(own)
            self._values[name] = [history.at_rest() for history in sensitivity.histories]
        self._before = {name: np.zeros_like(sensitivity.solver.system.w.x.array) for name in self._own}
        self.last: Mapping[str, Rate] | None = {}
        """Of the last state; None from one on that has none, where later ones depend on it."""

    def begin(self, state: State, rates: Mapping[str, Rate]) -> None:
        """Begin in a state that has lasted, with its derivatives, 0 by other parameters: the potential has begun a step there
        that is long beside the relaxation times, and ends in the state too."""
        known, eq = self.sensitivity, self.sensitivity.solver.system
        eq.load(state)
        for name, own in self._own.items():
            before, histories = self._before[name], zip(known.histories, self._values[name], strict=True)
            if name in rates:
                before[:] = rates[name].w[: len(before)]
            known.turn(own)
            for history, values in histories:
                history.begin(before, values)
                values[:] = history.end(before)
        for history in known.histories:
            history.rest()

    def step(
        self, state: State, control: Control, rises: Mapping[str, float] = MappingProxyType({})
    ) -> tuple[controls.Tangent, dict[str, Rate]]:
        """Return the derivatives of a state that ends a step, before the potential keeps it; see `Sensitivity.rates`.
        ``rises`` are derivatives of the line's left side in SI units, where they are not 0."""
        along, _ = self.sensitivity.rates(state, control, ())
        return along, self.advance(state, control, rises)

    def advance(self, state: State, control: Control, rises: Mapping[str, float] = MappingProxyType({})) -> dict[str, Rate]:
        """Return the same of only the state, where `Sensitivity.rates` has been called or they are ``aside``."""
        known, eq = self.sensitivity, self.sensitivity.solver.system
        eq.load(state)
        unit = control.volume_coefficient * eq.volume_unit + control.pressure_coefficient * eq.stress_unit
        rates = {}
        for name, own in self._own.items():
            known.turn(own)
            for history, values in zip(known.histories, self._values[name], strict=True):
                history.begin(self._before[name], values)
            rate = known.rate(state, control, own, rises.get(name, 0.0) / unit)
            for history, values in zip(known.histories, self._values[name], strict=True):
                values[:] = history.end(rate.w)
            self._before[name][:] = rate.w[: len(self._before[name])]
            rates[name] = rate
        for history in known.histories:
            history.rest()
        self.last = rates
        return rates

    def carry(self, state: State, control: Control) -> None:
        """As `advance`, for a path that goes on where a state has no derivatives, as at its limit points."""
        if self.last is None:
            return
        try:
            self.advance(state, control)
        except newton.NoConvergence:
            self.last = None if self.sensitivity.histories else {}

    def save(self) -> tuple[dict[str, list[Array]], dict[str, Array], Mapping[str, Rate] | None]:
        """Return copies of how what is remembered now changes with each parameter, for `FrictionDirection.begin`, and of how
        the last state does; see `component.Checkpoint`."""
        values = {name: [part.copy() for part in own] for name, own in self._values.items()}
        return values, {name: before.copy() for name, before in self._before.items()}, self.last

    def restore(self, saved: tuple[dict[str, list[Array]], dict[str, Array], Mapping[str, Rate] | None]) -> None:
        self._values, self._before, self.last = copy.deepcopy(saved[0]), copy.deepcopy(saved[1]), saved[2]


class _Directions:
    """The stored energy's derivative along a direction in the space of the laws' dimensionless constants: UFL integrals
    ``energies``, that of the main material first."""

    def __init__(self, eq: System):
        mesh = eq.body.mesh
        self.laws = [_LawDirection(eq, region) for region in eq.potential.regions]
        self.mixed, self.forms = eq.mixed, dict[str, float]()
        self.energies = eq.potential.stored([law.slope for law in self.laws])
        # Parts keep their stiffness in Pa, which decreases in shear moduli; their energies are linear in the value of one Pa.
        self.per_pascal = fem.Constant(mesh, 0.0)
        for term in eq.potential.terms.values():
            for energy in term.energies:
                if eq.potential.per_pascal in energy.constants():
                    self.energies.append(ufl.replace(energy, {eq.potential.per_pascal: self.per_pascal}))

    def turn(self, material: Material, name: Along) -> float:
        """Point the direction along one number of the main material, or of a region's with its name in front, as in
        ``base.c1``, or along changes of several of the main one's; return the main shear modulus' derivative by it."""
        where, _, number = name.rpartition(".") if isinstance(name, str) else ("", "", "")
        moved = material
        for parameter, change in ((name, 1.0),) if isinstance(name, str) else name:
            moved = moved if where or not parameter else specimens.nudged(moved, parameter, 1j * _COMPLEX_STEP * change)
        mu = complex(moved.shear_modulus_0)
        for law in self.laws:
            own = law.region.material if law.region.name else moved
            law.turn(
                specimens.nudged(own, number, 1j * _COMPLEX_STEP) if where and law.region.name == where else own,
                mu,
                self.mixed,
            )
        self.per_pascal.value = np.imag(1 / mu) / _COMPLEX_STEP
        self.forms = {form: float(np.imag(factor)) / _COMPLEX_STEP for form, factor in moved.forms.items()}
        return mu.imag / _COMPLEX_STEP


class _LawDirection:
    """One region's share of `_Directions`: a direction in the space of its law's constants, and the density's slope."""

    def __init__(self, eq: System, region: regions.MaterialRegion):
        self.region, mesh = region, eq.body.mesh
        self.history = next((history for history in eq.potential.histories if history.region is region), None)
        names = [field.name for field in laws.parameter_fields(region.material) if field.name != "poisson"]
        constants = {name: getattr(region.parameters, name) for name in names}
        variables = {name: ufl.variable(constant) for name, constant in constants.items()}
        bulk = ufl.variable(region.bulk)
        self.turns = {name: fem.Constant(mesh, np.zeros_like(constant.value)) for name, constant in constants.items()}
        self.bulk = fem.Constant(mesh, 0.0)
        self._numbers = [(constant, variables[name], self.turns[name]) for name, constant in constants.items()]
        shape = None
        if self.history is not None:
            own = [constant for constant, _ in self.history.numbers(region.material, 1.0)]
            self.memory_rates = [fem.Constant(mesh, np.zeros_like(constant.value)) for constant in own]
            self._numbers += [(c, ufl.variable(c), turn) for c, turn in zip(own, self.memory_rates, strict=True)]
            shape = self._in_variables(self.history.density)
        density = eq.potential.density(region.material, types.SimpleNamespace(**variables), bulk, shape)
        self.slope = ufl.diff(density, bulk) * self.bulk
        for slope in self._turned(density):
            self.slope += slope
        if self.history is not None:
            self.begun = fem.Function(self.history.begun.function_space)
            self.slope += ufl.derivative(self.history.density, self.history.begun, self.begun)

    def _in_variables(self, of: Expr) -> Expr:
        return ufl.replace(of, {constant: variable for constant, variable, _ in self._numbers})

    def _turned(self, of: Expr) -> list[Expr]:
        """Return the derivative of an expression in the variables, one summand for each."""
        slopes = [(ufl.diff(of, variable), turn) for _, variable, turn in self._numbers]
        return [ufl.dot(slope, turn) if turn.ufl_shape else slope * turn for slope, turn in slopes]

    def along(self, of: Expr) -> Expr:
        """Return the derivative of an expression along the direction of the constants."""
        return sum(self._turned(self._in_variables(of)))

    def turn(self, moved: Material, mu: complex, mixed: bool) -> None:
        """Point it along the imaginary part of what the constants of a nudged material are, in complex shear moduli."""
        for field, constant in self.turns.items():
            value = np.asarray(getattr(moved, field), dtype=complex)
            unit = type(moved).__dataclass_fields__[field].metadata["unit"]
            constant.value = np.imag(value / mu if unit == "Pa" else value) / _COMPLEX_STEP
        bulk = moved.bulk
        stiff = isinstance(bulk, float) and math.isinf(bulk)
        ratio = (0.0 if stiff else mu / bulk) if mixed else bulk / mu
        self.bulk.value = np.imag(ratio) / _COMPLEX_STEP
        if self.history is not None:
            for constant, (_, value) in zip(self.memory_rates, self.history.numbers(moved, mu), strict=True):
                constant.value = np.imag(value) / _COMPLEX_STEP


class HistoryDirection(Protocol):
    """How what is remembered changes over one step: with where the step begins (dofs ``before``, with ghosts, and remembered
    values), and with the state that ends it."""

    def at_rest(self) -> Array: ...
    def begin(self, before: Array, values: Array) -> None: ...
    def end(self, w: Array) -> Array: ...
    def rest(self) -> None: ...


class LawHistory:
    """How what a region's silicone remembers changes over one step in time, along the direction of its law."""

    def __init__(self, eq: System, law: _LawDirection):
        assert law.history is not None
        self.history, self._start, before = law.history, law.begun, eq.potential.before
        self._before, self._w = fem.Function(eq.space), fem.Function(eq.space)
        self._values = fem.Function(self.history.values.function_space)
        begin, end = self.history.beginning, self.history.ending
        slopes = [
            ufl.derivative(vector, before, self._before)
            + ufl.derivative(vector, self.history.values, self._values)
            + law.along(vector)
            for vector in (begin, end)
        ]
        slopes[1] += ufl.derivative(end, eq.w, self._w) + ufl.derivative(end, self.history.begun, self._start)
        self._begin, self._end = (fem.Expression(slope, self.history.points, jit_options=compiling.JIT) for slope in slopes)

    def at_rest(self) -> Array:
        """Return the derivative of what is remembered at rest."""
        return np.zeros_like(self.history.values.x.array)

    def begin(self, before: Array, values: Array) -> None:
        """Set how the beginning of the step changes: derivatives of the dofs there, with ghosts, and of what is remembered
        there, as `History.values`."""
        history, begun = self.history, self._start.x.array.reshape(-1, self.history.width)
        self._before.x.array[:], self._values.x.array[:] = before, values
        if history.step.value == 0.0:
            begun[:] = history.at_once(values.reshape(-1, history.size))
            return
        begun[history.places] = history.at_points(self._begin, history.width)

    def end(self, w: Array) -> Array:
        """Return the derivative of what is remembered at the end of the step, from that of the dofs there, with ghosts."""
        history, values = self.history, np.zeros_like(self.history.values.x.array)
        self._w.x.array[:] = w[: len(self._w.x.array)]
        values.reshape(-1, history.size)[history.places] = history.at_points(self._end, history.size)
        return values

    def rest(self) -> None:
        """Let the beginning of a step stay as it is, for `Sensitivity.rates`."""
        self._start.x.array[:] = 0.0


class FrictionDirection:
    """The same of friction on a rigid shape: how what its samples remember changes with where they are on the shape."""

    def __init__(self, sensitivity: Sensitivity, label: str, term: assembly.HistoryTerm):
        self.label, self.term, self._known = label, term, sensitivity
        self._values: Array | None = None
        self.turn(None, None)

    def turn(self, part: Component | None, X: Array | None) -> None:
        """Point it along the imaginary place of the nudged shape, or along a motion of the mesh's nodes."""
        nodes, eq = self.term.nodes, self._known.solver.system
        self._motion = np.zeros(nodes.places.shape)
        if part is not None:
            self._motion -= _relocation(part, eq)
        if X is not None and self._known.motion is not None:
            self._motion += nodes.motion(self._known.motion.at_nodes(X))

    def at_rest(self) -> Array:
        return self.term.rest_rates(self._motion)

    def begin(self, before: Array, values: Array) -> None:
        self._values = values

    def force(self) -> Array:
        """Return the derivative of the residual, owned entries; 0 where a step's beginning stays."""
        eq, b = self._known.solver.system, np.zeros(self._known.solver.system.n)
        if self._values is not None:
            self.term.add_rates(self.at_nodes(), b)
        return eq.by_unknowns(b)

    def at_nodes(self) -> Array:
        """Return the derivative of the forces by the nodes' places, shape (n, d)."""
        assert self._values is not None
        return self.term.history_rates(self._known.solver.system.w.x.array, self._values)

    def end(self, w: Array) -> Array:
        assert self._values is not None
        nodes, here = self.term.nodes, self._known.solver.system.w.x.array
        return self.term.kept_rates(here, self._motion + nodes.values(w) @ nodes.skew.T, self._values)

    def rest(self) -> None:
        self._values = None


def _relocation(moved: Component, eq: System) -> Array:
    """Return the motion in sizes of a shape along the imaginary part of a nudged one's place, shape (d,)."""
    along = np.imag(getattr(moved, "at", np.zeros(3))) / _COMPLEX_STEP
    return body.in_section(along / eq.length_unit, eq.body.mesh.topology.dim)


# ----------------------------------------------------------------------------------------------------------------------
# Linear extension of boundary motion to inner mesh nodes by an elastic solid, and its transpose.


SOLID_POISSON = 0.3
"""Poisson's ratio of the solid."""
AXIS = "axis"
"""Role of a section's axis, on which nodes slide as on a cut plane."""


class Extension:
    """The linear operator E from positions of boundary nodes to those of all nodes, and its transpose, in vector functions on
    the nodes of a mesh as it was made. ``boundary`` are the blocks of local dofs (with ghosts) on the true boundary."""

    def __init__(self, body: Body, space: fem.FunctionSpace):
        self.body, self.space = body, space
        mesh, tdim = body.mesh, body.mesh.topology.dim
        self.dimension = mesh.geometry.dim
        free = [plane.name for plane in body.actuator.cut_planes] + ([AXIS] if AXIS in body.entities else [])
        true = body.outer_facets
        if body.actuator.carries_interfaces:
            true = np.union1d(true, _interfaces(body))
        blocks = fem.locate_dofs_topological(space, tdim - 1, true.astype(np.int32))
        self.boundary = np.sort(blocks)
        self._held = fem.Function(space)
        self.bcs = [fem.dirichletbc(self._held, self.boundary)]
        zero = np.array(0.0)
        for component, name in self._sliding(free):
            dofs = fem.locate_dofs_topological(space.sub(component), tdim - 1, body.entities[name][1])
            self.bcs.insert(0, fem.dirichletbc(zero, dofs, space.sub(component)))
        trial, test = ufl.TrialFunction(space), ufl.TestFunction(space)
        weight = _stiffness(body)

        def stress(z: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
            strain = self._strain(z)
            return strain + SOLID_POISSON / (1 - 2 * SOLID_POISSON) * ufl.tr(strain) * ufl.Identity(self.dimension)

        a = weight * ufl.inner(stress(trial), self._strain(test)) * ufl.Measure("dx", mesh, metadata={"quadrature_degree": 2})
        form = fem.form(a, jit_options=compiling.JIT)
        # Both are stored, because a new assembly would use the moved mesh.
        self._free = assembly.assembled_matrix(form)
        self._matrix = assembly.assembled_matrix(form, self.bcs)
        self._matrix.setOption(PETSc.Mat.Option.SPD, True)  # type: ignore[arg-type]
        self._pc = PETSc.PC().create(mesh.comm)
        self._pc.setOperators(self._matrix)
        self._pc.setType("cholesky")
        self._pc.setFactorSolverType("mumps")
        self._pc.setUp()
        self._x, self._b = self._matrix.createVecRight(), self._matrix.createVecLeft()
        self.owned = self._matrix.getLocalSize()[0]

    def _strain(self, z: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
        return ufl.sym(ufl.grad(self.body.displacement(z)))

    def _sliding(self, roles: Sequence[str]) -> list[tuple[int, str]]:
        """Return the component of z = B u that vanishes on each plane of symmetry."""
        return [
            (component, role) for role, components in self.body._held_components() if role in roles for component in components
        ]

    def extend(self, shift: Array) -> Array:
        """Return the displacement of all nodes (n, d) from that of the boundary's, shape (k, d)."""
        z = self._held.x
        z.array[:] = 0.0
        z.array.reshape(-1, self.dimension)[self.boundary] = shift @ self.body.skew.T
        inner = self._solve(-self._product(z.array[: self.owned]))
        z.array[: self.owned] += inner
        z.scatter_forward()
        return z.array.reshape(-1, self.dimension) @ self.body.skew_inverse.T

    def transposed(self, covector: Array) -> Array:
        """Apply the transpose of `extend`: map a covector on all nodes (flat, owners complete) to the boundary's, shape (k,
        d). Rows of ghosts are zero: their owners have them."""
        c = (covector.reshape(-1, self.dimension) @ self.body.skew_inverse).ravel()
        c[: self.owned] -= self._product(self._solve(c[: self.owned]))
        c[self.owned :] = 0.0
        return c.reshape(-1, self.dimension)[self.boundary] @ self.body.skew

    def _product(self, z: Array) -> Array:
        """Return the stiffness without conditions times a vector; owned entries of both."""
        self._x.array_w[:] = z
        self._free.mult(self._x, self._b)
        return np.array(self._b.array_r)

    def _solve(self, force: Array) -> Array:
        """Return the inner nodes' response to a force, zero at conditions; owned entries."""
        force = force.copy()
        force[assembly.held_dofs(self.bcs)] = 0.0
        self._b.array_w[:] = force
        self._pc.apply(self._b, self._x)
        return np.array(self._x.array_r)

    def release(self) -> None:
        for thing in (self._pc, self._matrix, self._free, self._x, self._b):
            thing.destroy()


def _interfaces(body: Body) -> npt.NDArray[np.int32]:
    topology, d = body.mesh.topology, body.mesh.topology.dim
    regions = assembly.numbered(body.mesh, list(body.regions.values()))
    topology.create_connectivity(d - 1, d)
    cells = topology.connectivity(d - 1, d)
    first, count = cells.offsets[:-1], np.diff(cells.offsets)
    inner = np.flatnonzero(count == 2)
    cell, other = cells.array[first[inner]], cells.array[first[inner] + 1]
    return inner[regions[cell] != regions[other]].astype(np.int32)


def _stiffness(body: Body) -> fem.Function:
    """Return the inverse of each cell's volume, relative to the mean, so that small cells keep their shape."""
    space = fem.functionspace(body.mesh, ("DG", 0))
    stiffness = fem.Function(space)
    volume = fem.form(ufl.TestFunction(space) * ufl.Measure("dx", body.mesh, metadata={"quadrature_degree": 2}))
    fem.assemble_vector(stiffness.x.array, volume)
    stiffness.x.scatter_forward()
    count = space.dofmap.index_map.size_global
    owned = stiffness.x.array[: space.dofmap.index_map.size_local]
    mean = mpi.total(body.mesh.comm, float(owned.sum())) / count
    stiffness.x.array[:] = mean / stiffness.x.array
    return stiffness


# ----------------------------------------------------------------------------------------------------------------------
# Mesh motion: boundary nodes map to another device of the class, inner nodes follow like a solid.
#
# Boundary nodes are mapped by the device itself (`Actuator.carried`), from the device b0 that the mesh was made
# of to b(theta). The inner ones follow by one fixed linear operator E, an elastic solid on the initial mesh whose small
# cells are stiffer (Tezduyar, Behr, Mittal, Johnson 1992, New methods in transient analysis, AMD-246):
#
#     x(theta) = x0 + E (b(theta) - b0)
#
# Nodes on a cut plane slide in it. Because E is constant, results on these meshes are smooth functions of theta, and a
# gradient by all parameters costs one transposed E: a boundary covector, and its products with db/dtheta.


SHAPE_STEP = 1e-6
"""Step of the central differences of boundary positions, relative to the device's size (or to 1 for numbers and angles)."""


def coordinates(domain: meshes.Mesh) -> tuple[fem.FunctionSpace, npt.NDArray[np.int64]]:
    """Return the vector functions on a mesh's own nodes, and the node of the geometry that each block of dofs belongs to."""
    space = fem.functionspace(domain, domain.ufl_domain().ufl_coordinate_element())
    nodes = np.empty(len(space.tabulate_dof_coordinates()), dtype=np.int64)
    nodes[space.dofmap.list.ravel()] = domain.geometry.dofmaps[0].ravel()
    return space, nodes


class MeshMotion:
    """Moves a body's mesh to other devices of its class.

    Args:
        body: The device, its mesh as it was read.

    Attributes:
        device: The device that the mesh shows now.
        space: Vector functions on the mesh's own nodes.
        followers: Called when the mesh has moved.
    """

    def __init__(self, body: Body):
        mesh = body.mesh
        self.body, self.base, self.device, self.comm = body, body.actuator, body.actuator, mesh.comm
        self.dimension, self.followers = mesh.geometry.dim, list[Callable[[], None]]()
        self._places = mesh.geometry.x.copy()
        self.space, self._nodes = coordinates(mesh)
        self._extension = Extension(body, self.space)
        self._boundary = self._extension.boundary
        points = self._places[self._nodes[self._boundary]] * body.actuator.size
        self._boundary_points = body.actuator.device_points(points)
        self._volumes = self._cell_volumes()
        self._velocities: dict[str, Array] = {}

    @property
    def entries(self) -> int:
        """Number of local places' components, with ghosts."""
        return len(self._nodes) * self.dimension

    @property
    def owned_entries(self) -> int:
        """Number of the first of them, owned by this rank."""
        return int(self.space.dofmap.index_map.size_local) * self.dimension

    def rest_places(self) -> Array:
        """Return the dimensionless places of the owned nodes on the mesh as it was made, shape (n, 3)."""
        return self._places[self._nodes[: self.space.dofmap.index_map.size_local]]

    def now(self, node: int | npt.NDArray[np.int64]) -> Array:
        """Return the dimensionless places of nodes of `space` on the current mesh, shape (..., d)."""
        return self.body.mesh.geometry.x[self._nodes[node], : self.dimension]

    # -- moving ---------------------------------------------------------------------------------------------------------

    def move(self, device: Actuator) -> None:
        """Move the mesh to a device; `GeometryError` if the mesh as it was made cannot reach its boundary."""
        shift = self._carried(device) - self._in_mesh(self._boundary_points)
        moved = self._places.copy()
        moved[self._nodes, : self.dimension] += self._extension.extend(shift / self.base.size)
        self.body.mesh.geometry.x[:] = moved
        self.device = device
        self._velocities.clear()
        for follow in self.followers:
            follow()

    def quality(self) -> float:
        """Return the least ratio of a cell's Jacobian to its own on the initial mesh, over all ranks; 1 if
        nothing moved."""
        now = self._cell_volumes()
        ratio = float((now / self._volumes).min()) if now.size else np.inf
        return -mpi.largest(self.comm, -ratio)

    def _cell_volumes(self) -> Array:
        """Return the signed Jacobians of the owned cells at some points, shape (cells, points)."""
        mesh = self.body.mesh
        points, _ = basix.make_quadrature(mesh.basix_cell(), 3)
        # Of order 1 or 2, for which all variants of the element are one.
        cells = basix.ufl.element("P", mesh.basix_cell(), mesh.geometry.cmaps[0].degree)
        gradients = cells.tabulate(1, points)[1:]  # (d, points, nodes)
        owned = mesh.topology.index_map(mesh.topology.dim).size_local
        corners = mesh.geometry.x[mesh.geometry.dofmaps[0][:owned]][..., : self.dimension]
        jacobians = np.einsum("dpn,cni->cpid", gradients, corners)
        return np.linalg.det(jacobians)

    def _in_mesh(self, points: Array) -> Array:
        """Return the device coordinates (n, 3) as the mesh has them, (n, d)."""
        return points if self.dimension == 3 else points[:, [0, 2]]

    def _carried(self, device: Actuator) -> Array:
        return self._in_mesh(self.base.carried(device, self._boundary_points))

    # -- derivatives ----------------------------------------------------------------------------------------------------

    def boundary_velocities(self, names: Sequence[str]) -> dict[str, Array]:
        """Return the derivatives of the boundary nodes by each parameter at the current device, in m per SI unit, shape (n,
        d): central differences of `Actuator.carried`, one-sided where the device does not exist on one side.

        Raises:
            GeometryError: The device exists on neither side.
        """
        return {name: self._velocity(name) for name in names}

    def _velocity(self, name: str) -> Array:
        device, value = self.device, actuator.parameter(self.device, name)
        step = SHAPE_STEP * max(abs(value), 0.1 * scale_of(device, name))
        ends = []
        for sign in (1.0, -1.0):
            try:
                ends.append((sign, self._carried(actuator.changed(device, {name: value + sign * step}))))
            except GeometryError as error:
                failure = error
        if not ends:
            raise failure
        if len(ends) == 1:
            ends.append((0.0, self._carried(device)))
        (a, high), (b, low) = ends
        return (high - low) / ((a - b) * step)

    def toward(self, device: Actuator) -> Array:
        """Return how far the boundary nodes of the current device are from those of another, m, shape (n, d)."""
        return self._carried(device) - self._carried(self.device)

    def gradient(self, covector: Array, velocities: dict[str, Array]) -> dict[str, float]:
        """Return the derivatives of a quantity by the parameters, per their SI unit, from `boundary_velocities` and its
        derivative by the dimensionless places of the nodes: dofs of `space`, every owner's complete, ghosts not read."""
        at_boundary = self._extension.transposed(covector)
        return {
            name: mpi.total(self.comm, float(np.sum(at_boundary * velocity))) / self.base.size
            for name, velocity in velocities.items()
        }

    def velocity(self, name: str) -> Array:
        """Return the motion of all dimensionless nodes with a parameter at the current device, per its SI unit; see
        `nodes_rate`."""
        if name not in self._velocities:  # the same in every state of a device
            self._velocities[name] = self.nodes_rate(self._velocity(name))
        return self._velocities[name]

    def nodes_rate(self, velocity: Array) -> Array:
        """Return the motion of all dimensionless nodes with one of `boundary_velocities`, shape (nodes of `space`, d)."""
        return self._extension.extend(velocity / self.base.size)

    def at_nodes(self, motion: Array) -> Array:
        """Return a motion of the nodes of `space`, shape (nodes, d), in the order of the mesh's geometry."""
        shifts = np.zeros((len(self.body.mesh.geometry.x), self.dimension))
        shifts[self._nodes] = motion
        return shifts

    def by_nodes(self, rates: Array) -> Array:
        """Return shares of a derivative by the mesh's own nodes in the order of its geometry as a covector over `space`,
        complete on the owners."""
        b = fem.Function(self.space).x
        b.array[:] = rates[self._nodes].ravel()
        b.scatter_reverse(la.InsertMode.add)
        return np.array(b.array)

    def compiled(self, form: ufl.Form) -> fem.Form:
        """Return the compiled derivative of a form without arguments by the places of the nodes."""
        X = ufl.SpatialCoordinate(self.body.mesh)
        return fem.form(ufl.derivative(form, X, ufl.TestFunction(self.space)), jit_options=compiling.JIT)

    def assembled(self, form: fem.Form) -> Array:
        """Return a form's vector over the dofs of `space`, complete on their owners."""
        return assembly.assembled_vector(fem.Function(self.space).x, [form])

    def release(self) -> None:
        """Release the PETSc objects."""
        self._extension.release()


def scale_of(device: Actuator, name: str) -> float:
    """Return the scale of a parameter: the device's size for lengths, 1 for numbers and angles."""
    return device.size if actuator.is_length(device, name) else 1.0


ADJOINT_TOLERANCE = 1e-10  # of the linear solves
CONTACT_DEPTH = 0.02
"""Of a contact, in sizes."""
_COMPLEX_STEP = 1e-30  # into the complex plane: exact to rounding


@dataclasses.dataclass(frozen=True, eq=False)
class Rate:
    """Derivative of a state by one parameter (per its SI unit) or by its added volume (per m3).

    Attributes:
        w: Derivative of `State.w`, dimensionless, with ghosts; of multipliers that of their pressures in Pa, over the shear
            modulus.
        P: Derivative of the pressure in Pa.
        V: Derivative of the whole device's cavity volume in m3.
        X: Derivative of the mesh's dimensionless nodes, shape (nodes of `MeshMotion.space`, d), with ghosts; None where they
            stay.
    """

    w: Array
    P: float
    V: float
    X: Array | None = None


@dataclasses.dataclass(frozen=True, eq=False)
class Force:
    """Derivative of the equations by a parameter per its SI unit, at fixed unknowns: residual (owned entries, shape (n,)), the
    shear modulus in which stresses are counted, and the dimensionless volume that the control's line has, from the
    undeformed device on."""

    residual: Array
    stress: float
    opened: float


def known_parameters(material: Material) -> tuple[str, ...]:
    """Return the names of the parameters of differentiation: those of the law (``c1``; ``mu1``, ``alpha1`` ...) and
    ``poisson``.

    The numbers of a region in another material have its name in front: ``base.c1``. Those of its memory are
    `memory_parameters`.
    """
    return (*material.parameters, "poisson")


def memory_parameters(material: Material) -> tuple[str, ...]:
    """Return the names of the parameters of a material's memory: ``share1``, ``time1`` and so on, and `SOFTENING`."""
    own = material.memory
    if own is None:
        return ()
    branches = (f"{name}{k}" for k, _ in enumerate(own.branches, 1) for name in ("share", "time"))
    return (*branches, *(specimens.SOFTENING if own.softening else ()))
