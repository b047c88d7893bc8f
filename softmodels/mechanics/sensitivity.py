"""Sensitivity of equilibrium states to material parameters and lengths of the device.

A state (w, P) satisfies R(w, P; theta) = 0 on the line a V + b P = d of its control, so that

        [ K      -q ] [dw/dtheta]     [ dR/dtheta            ]
        [ a q^T   b ] [dP/dtheta] = - [ a dV/dtheta at rest w ]

which is the matrix of Newton's method: one solve per parameter with the factorisation at hand, no finite differences, and
regular at limit points wherever the line crosses the path (Michaleris, Tortorelli & Vidal 1994, doi 10.1002/nme.1620371408).
dR/dtheta by material parameters is one compiled form per law, for all parameters: the derivative along a direction
whose components are Constants. Of a length it is the derivative by the mesh's coordinates along the motion of its nodes.

Silicone with a memory adds dR/dh dh/dtheta, h being what a step in time has of its beginning. It follows from the step before
by the derivatives of the same update (`InTime`): exact for the discrete steps, one solve per parameter and step.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import types
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from softmodels.common.arrays import Array
from softmodels.materials.laws import Material, parameter_fields
from softmodels.materials.specimens import SOFTENING, nudged
from softmodels.mechanics.compiling import JIT
from softmodels.mechanics.controls import Control, Tangent
from softmodels.mechanics.motion import MeshMotion
from softmodels.mechanics.regions import MaterialRegion
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import State, System

if TYPE_CHECKING:
    from dolfinx import fem
    from ufl.core.expr import Expr

TOLERANCE = 1e-10  # of the linear solves
_STEP = 1e-30  # into the complex plane: exact to rounding


@dataclasses.dataclass(frozen=True, eq=False)
class Rate:
    """Derivative of a state by one parameter (per its SI unit) or by its added volume (per m3).

    Attributes:
        w: Derivative of `State.w`, dimensionless, with ghosts.
        P: Derivative of the cavity pressure in Pa.
        V: Derivative of the whole device's cavity volume in m3.
        X: Derivative of the mesh's dimensionless nodes, shape (nodes of `MeshMotion.space`, d), with ghosts; None where they
            stay.
    """

    w: Array
    P: float
    V: float
    X: Array | None = None


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
    return (*branches, *(SOFTENING if own.softening else ()))


class Sensitivity:
    """Derivatives of a device's states.

    Args:
        solver: The device.
        motion: Moves its mesh; None for derivatives by the material only.
    """

    def __init__(self, solver: Solver, motion: MeshMotion | None = None):
        import ufl

        self.solver, self.motion, eq = solver, motion, solver.system
        self._along = _Directions(eq)
        test = ufl.TestFunction(eq.space)
        self._material = [eq.form(ufl.derivative(energy, eq.w, test)) for energy in self._along.energies]

    @functools.cached_property
    def histories(self) -> list[_HistoryDirection]:
        """Directions in which what the silicone remembers changes; none for silicone without a memory."""
        eq = self.solver.system
        return [_HistoryDirection(eq, law) for law in self._along.laws if law.history is not None]

    @functools.cached_property
    def _moving(self) -> tuple[fem.Function, list[fem.Form], list[list[fem.Form]], fem.Form]:
        """A motion of the mesh's nodes, and the derivatives along it of the forces, of the loads and of the cavity's volume."""
        import ufl
        from dolfinx import fem

        eq = self.solver.system
        assert self.motion is not None
        X, moving = ufl.SpatialCoordinate(eq.body.mesh), fem.Function(self.motion.space)
        forces = [eq.form(ufl.derivative(force, X, moving)) for force in eq.potential.forces]
        loads = [[eq.form(ufl.derivative(form, X, moving)) for form in forms] for forms in eq.dead.integrals]
        return moving, forces, loads, eq.form(ufl.derivative(eq.potential.cavity_volume, X, moving))

    def rates(self, state: State, control: Control, names: Sequence[str]) -> tuple[Tangent, dict[str, Rate]]:
        """Return the derivatives of the state that stays on one line of pressure and volume (in SI units) as parameters change.

        The tangent matrix is factorised at the state.

        Args:
            state: A state of the system's present material and lengths.
            control: The line, dimensionless as for `Solver.solve`.
            names: Of `known_parameters`, or lengths of the device.

        Returns:
            Direction of the path, for one unit of the control's line; and a rate per name.

        Raises:
            NoConvergence: The linear solver failed: the line touches the path.
        """
        self.solver.factorise(state)
        along = self.solver.tangent(state, control, TOLERANCE)
        return along, {name: self.rate(state, control, name) for name in names}

    def turn(self, name: str) -> None:
        """Point `histories` along a parameter; see `material_force`."""
        self._along.turn(self.solver.system.material, name)

    def material_force(self, name: str) -> tuple[Array, float]:
        """Return the derivative of the residual by a material parameter at the loaded state.

        Within a step in time it includes the direction in which `histories` say that its beginning changes.

        Args:
            name: Of `known_parameters` or `memory_parameters`; empty for no change of the material.

        Returns:
            Owned entries, shape (n,), dimensionless per SI unit; and the shear modulus' derivative.
        """
        eq = self.solver.system
        dmu = self._along.turn(eq.material, name)
        force = eq.assemble(self._material).copy()
        if eq.dead.forms:  # constant in newtons, so decreasing in shear moduli
            cavities = len(eq.pressures) - len(eq.dead.forms)
            force += dmu / eq.stress_unit * eq.pressures[cavities:] @ eq.pressure_loads()[cavities:]
        if eq.assembled.slack:  # and so are springs and weights in contact
            force -= dmu / eq.stress_unit * eq.by_unknowns(eq.assembled.add_harder(eq.w.x.array, np.zeros(eq.n)))
        return force, dmu

    def motion_force(self, X: Array) -> tuple[Array, float]:
        """Return the derivatives of the residual and of the cavity's volume by a motion of the mesh at the loaded state.

        Args:
            X: Motion of the nodes, see `Rate`.

        Returns:
            Owned entries, shape (n,), and a number; dimensionless.
        """
        eq, (moving, forces, loads, volume) = self.solver.system, self._moving
        moving.x.array[:] = X.ravel()
        force = eq.assemble(forces).copy()
        for magnitude, forms in zip(eq.pressures[len(eq.pressures) - len(loads) :], loads, strict=True):
            force -= magnitude * eq.assemble(forms)  # a thicker part is heavier
        return force, eq.integral(volume)

    def rate(self, state: State, control: Control, name: str, rise: float = 0.0) -> Rate:
        """Return one of `rates`, which must have been called at this state.

        Args:
            state, control: See `rates`.
            name: See `rates`; empty for no change of the device.
            rise: Derivative of the line's left side, dimensionless, beside what the line in Pa and m3 has itself.
        """
        eq = self.solver.system
        mu, dmu, opened, X = eq.stress_unit, 0.0, 0.0, None
        if self.motion is not None and name in self.motion.device.variable:
            X = self.motion.velocity(name)
            force, opened = self.motion_force(X)
        else:
            force, dmu = self.material_force(name)
        # The line is fixed in Pa and m3; in shear moduli it moves with the shear modulus.
        gap = rise - control.volume_coefficient * opened - control.pressure_coefficient * state.P * dmu / mu
        moved = self.solver.linear_response(-force, gap, TOLERANCE)
        return Rate(moved.w, moved.P * mu + state.P * dmu, (moved.V + opened) * eq.volume_unit, X)


class InTime:
    """Derivatives of a device's states through its steps in time, from rest on.

    Viscosity that depends on stress has none at rest where its exponent is below 1.

    Args:
        sensitivity: Of the device, whose silicone has a memory.
        names: Of `known_parameters` or `memory_parameters`.
        loads: Names of further parameters, by which only the control's values change.
    """

    def __init__(self, sensitivity: Sensitivity, names: Sequence[str], loads: Sequence[str] = ()):
        self.sensitivity, self._own = sensitivity, {**{name: name for name in names}, **dict.fromkeys(loads, "")}
        histories = [one.history for one in sensitivity.histories]
        names = tuple(self._own)
        self._values = {name: [np.zeros_like(one.values.x.array) for one in histories] for name in names}
        self._before = {name: np.zeros_like(sensitivity.solver.system.w.x.array) for name in names}

    def begin(self, state: State, rates: Mapping[str, Rate]) -> None:
        """Begin in a state that has lasted: the potential has begun a step there that is long beside the relaxation times.

        Args:
            state: The state, with which the step ends too.
            rates: Its derivatives; 0 by other parameters.
        """
        known, eq = self.sensitivity, self.sensitivity.solver.system
        eq.load(state)
        for name, own in self._own.items():
            before, histories = self._before[name], zip(known.histories, self._values[name], strict=True)
            if name in rates:
                before[:] = rates[name].w[: len(before)]
            known.turn(own)
            for one, values in histories:
                one.begin(before, values)
                values[:] = one.end(before)
        for one in known.histories:
            one.rest()

    def step(
        self, state: State, control: Control, rises: Mapping[str, float] = MappingProxyType({})
    ) -> tuple[Tangent, dict[str, Rate]]:
        """Return the derivatives of a state that ends a step, before the potential keeps it; see `Sensitivity.rates`.

        Args:
            state: The state.
            control: Its line.
            rises: Derivatives of the line's left side in SI units, where they are not 0.

        Raises:
            NoConvergence: The linear solver failed.
        """
        known, eq = self.sensitivity, self.sensitivity.solver.system
        along, _ = known.rates(state, control, ())
        unit = control.volume_coefficient * eq.volume_unit + control.pressure_coefficient * eq.stress_unit
        rates = {}
        for name, own in self._own.items():
            known.turn(own)
            for one, values in zip(known.histories, self._values[name], strict=True):
                one.begin(self._before[name], values)
            rate = known.rate(state, control, own, rises.get(name, 0.0) / unit)
            for one, values in zip(known.histories, self._values[name], strict=True):
                values[:] = one.end(rate.w)
            self._before[name][:] = rate.w[: len(self._before[name])]
            rates[name] = rate
        for one in known.histories:
            one.rest()
        return along, rates


class _Directions:
    """The stored energy's derivative along a direction in the space of the laws' dimensionless constants.

    Attributes:
        energies: UFL integrals, that of the main material first.
    """

    def __init__(self, eq: System):
        import ufl
        from dolfinx import fem

        mesh = eq.body.mesh
        self.laws = [_LawDirection(eq, region) for region in eq.potential.regions]
        self.mixed = eq.mixed
        self.energies = eq.potential.stored([law.slope for law in self.laws])
        # Parts keep their stiffness in Pa, which decreases in shear moduli; their energies are linear in the value of one Pa.
        self.per_pascal = fem.Constant(mesh, 0.0)
        for term in eq.potential.terms.values():
            for energy in term.energies:
                if eq.potential.per_pascal in energy.constants():
                    self.energies.append(ufl.replace(energy, {eq.potential.per_pascal: self.per_pascal}))

    def turn(self, material: Material, name: str) -> float:
        """Point the direction along one parameter of a law; returns the main shear modulus' derivative by it.

        Args:
            material: The main material.
            name: Of its numbers; of a region's with the region's name in front, as in ``base.c1``.
        """
        where, _, number = name.rpartition(".")
        moved = material if where or not name else nudged(material, number, 1j * _STEP)
        mu = complex(moved.shear_modulus_0)
        for law in self.laws:
            own = law.region.material if law.region.name else moved
            law.turn(nudged(own, number, 1j * _STEP) if where and law.region.name == where else own, mu, self.mixed)
        self.per_pascal.value = np.imag(1 / mu) / _STEP
        return mu.imag / _STEP


class _LawDirection:
    """One region's share of `_Directions`: a direction in the space of its law's constants, and the density's slope."""

    def __init__(self, eq: System, region: MaterialRegion):
        import ufl
        from dolfinx import fem

        self.region, mesh = region, eq.body.mesh
        self.history = next((one for one in eq.potential.histories if one.region is region), None)
        names = [field.name for field in parameter_fields(region.material) if field.name != "poisson"]
        constants = {name: getattr(region.parameters, name) for name in names}
        variables = {name: ufl.variable(constant) for name, constant in constants.items()}
        bulk = ufl.variable(region.bulk)
        self.turns = {name: fem.Constant(mesh, np.zeros_like(constant.value)) for name, constant in constants.items()}
        self.bulk = fem.Constant(mesh, 0.0)
        self._numbers = [(constant, variables[name], self.turns[name]) for name, constant in constants.items()]
        shape = None
        if self.history is not None:
            own = [constant for constant, _ in self.history.numbers(region.material, 1.0)]
            self.remembered = [fem.Constant(mesh, np.zeros_like(constant.value)) for constant in own]
            self._numbers += [(c, ufl.variable(c), turn) for c, turn in zip(own, self.remembered, strict=True)]
            shape = self._in_variables(self.history.density)
        density = eq.potential.density(region.material, types.SimpleNamespace(**variables), bulk, shape)
        self.slope = ufl.diff(density, bulk) * self.bulk
        for slope in self._turned(density):
            self.slope += slope
        if self.history is not None:
            self.begun = fem.Function(self.history.begun.function_space)
            self.slope += ufl.derivative(self.history.density, self.history.begun, self.begun)

    def _in_variables(self, of: Expr) -> Expr:
        import ufl

        return ufl.replace(of, {constant: variable for constant, variable, _ in self._numbers})

    def _turned(self, of: Expr) -> list[Expr]:
        """Return the derivative of an expression in the variables, one summand for each."""
        import ufl

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
            constant.value = np.imag(value / mu if unit == "Pa" else value) / _STEP
        bulk = moved.bulk
        stiff = isinstance(bulk, float) and math.isinf(bulk)
        ratio = (0.0 if stiff else mu / bulk) if mixed else bulk / mu
        self.bulk.value = np.imag(ratio) / _STEP
        if self.history is not None:
            for constant, (_, value) in zip(self.remembered, self.history.numbers(moved, mu), strict=True):
                constant.value = np.imag(value) / _STEP


class _HistoryDirection:
    """How what a region's silicone remembers changes over one step in time, along the direction of its law.

    Attributes:
        history: What it remembers.
    """

    def __init__(self, eq: System, law: _LawDirection):
        import ufl
        from dolfinx import fem

        assert law.history is not None
        self.history, self._begun, before = law.history, law.begun, eq.potential.before
        self._before, self._w = fem.Function(eq.space), fem.Function(eq.space)
        self._values = fem.Function(self.history.values.function_space)
        begin, end = self.history.beginning, self.history.ending
        slopes = [
            ufl.derivative(one, before, self._before)
            + ufl.derivative(one, self.history.values, self._values)
            + law.along(one)
            for one in (begin, end)
        ]
        slopes[1] += ufl.derivative(end, eq.w, self._w) + ufl.derivative(end, self.history.begun, self._begun)
        self._begin, self._end = (fem.Expression(one, self.history.points, jit_options=JIT) for one in slopes)

    def begin(self, before: Array, values: Array) -> None:
        """Set how the beginning of the step changes.

        Args:
            before: Derivative of the dofs there, with ghosts.
            values: Derivative of what is remembered there, as `History.values`.
        """
        history, begun = self.history, self._begun.x.array.reshape(-1, self.history.width)
        self._before.x.array[:], self._values.x.array[:] = before, values
        if history.step.value == 0.0:
            begun[:] = history.at_once(values.reshape(-1, history.size))
            return
        begun[history.places] = history.at_points(self._begin, history.width)

    def end(self, w: Array) -> Array:
        """Return the derivative of what is remembered at the end of the step.

        Args:
            w: Derivative of the dofs there, with ghosts.
        """
        history, found = self.history, np.zeros_like(self.history.values.x.array)
        self._w.x.array[:] = w[: len(self._w.x.array)]
        found.reshape(-1, history.size)[history.places] = history.at_points(self._end, history.size)
        return found

    def rest(self) -> None:
        """Let the beginning of a step stay as it is, for `Sensitivity.rates`."""
        self._begun.x.array[:] = 0.0
