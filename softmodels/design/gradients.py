"""Adjoint gradients of quantities at equilibrium states: one back-substitution each, for any number of parameters.

A state (w, P) satisfies R(w, P; theta) = 0 and the line a V + b P = d of its load. With

        [ K    a q ] [ lambda ]   [ dj/dw ]
        [ -q^T  b  ] [ eta    ] = [ dj/dP ]

the whole derivative is dj/dtheta - lambda . dR/dtheta - eta d(aV + bP - d)/dtheta (Michaleris, Tortorelli & Vidal 1994, doi
10.1002/nme.1620371408). For shapes theta is the places X of the mesh's nodes: lambda . dR/dX is a covector from one
assembly, whose product with each parameter's mesh motion is the derivative. At a limit point of the pressure K v = 0,
and dP/dtheta = (v . dR/dtheta) / (v . q).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from softmodels.common.arrays import Array
from softmodels.design.loads import VOLUME
from softmodels.design.quantities.base import FormMeasure, Slopes
from softmodels.materials.specimens import nudged
from softmodels.mechanics.controls import Tangent, volume_control
from softmodels.mechanics.mpi import total
from softmodels.mechanics.newton import NoConvergence
from softmodels.mechanics.sensitivity import Sensitivity
from softmodels.path.stability import Mode, Stability

if TYPE_CHECKING:
    from softmodels.design.body import DesignedBody
    from softmodels.design.quantities.base import Measure
    from softmodels.mechanics.system import State


STEP = 1e-5
"""Relative step of the differences by material parameters at fixed unknowns."""
CENTRAL = {1.0: 0.5, -1.0: -0.5}
BACKWARD = {0.0: 1.5, -1.0: -2.0, -2.0: 0.5}
_NONE: Mapping[str, float] = {}


class Adjoint:
    """Total derivatives of quantities on a meshed device.

    Args:
        design: The device.
    """

    def __init__(self, design: DesignedBody):
        import ufl
        from dolfinx import fem

        self.design, self.system, self.solver = design, design.system, design.solver
        system, potential, compiled = self.system, self.system.potential, design.motion.compiled
        self._lambda = fem.Function(system.space)
        self._forces = [compiled(ufl.action(force, self._lambda)) for force in potential.forces]
        self._volume = compiled(potential.cavity_volume - design.rest_volume)
        self._sensitivity = Sensitivity(self.solver, design.motion)

    def prepare(self, state: State) -> None:
        """Factorise the tangent at a state, for the following gradients."""
        self.solver.factorise(state)
        self._state = state
        self._tangent_load = np.array(self.solver.bordered.q.array_r)
        self._lifted: Array | None = None

    @property
    def _opened(self) -> Array:
        """The prepared state's response to a unit pressure, needed only at constant volume."""
        if self._lifted is None:
            self._lifted = self.design.answer(self._tangent_load)
        return self._lifted

    def multipliers(self, slopes: Slopes, kind: str) -> tuple[Array, float]:
        """Return lambda (owned entries) and eta of a quantity at the prepared state, for a load of a kind."""
        if slopes.w is None and not slopes.P:
            return np.zeros(self.system.n), 0.0
        q, comm = self._tangent_load, self.system.comm
        by_w = np.zeros(self.system.n) if slopes.w is None else slopes.w
        lam = self.design.answer(by_w) if slopes.w is not None else by_w
        if kind == VOLUME:
            compliance = total(comm, float(q @ self._opened))
            eta = (total(comm, float(q @ lam)) + slopes.P) / compliance
            return lam - eta * self._opened, eta
        return lam, slopes.P + total(comm, float(q @ lam))

    def covector(self, lam: Array) -> Array:
        """Return lambda . dR/dX over the mesh's nodes at the loaded state."""
        self._set(lam)
        return sum((self.design.motion.assembled(form) for form in self._forces), np.zeros(self.design.motion.entries))

    def _set(self, lam: Array) -> None:
        x = self._lambda.x
        self.system.unknowns.push(lam, x.array)
        x.scatter_forward()

    def gradient(
        self, slopes: Slopes, kind: str, velocities: Mapping[str, Array], materials: Mapping[str, float] = _NONE
    ) -> tuple[dict[str, float], dict[str, float]]:
        """Return the whole derivatives of a quantity at the prepared state.

        Args:
            slopes: Its partial ones.
            kind: Of the load that is kept: "pressure" (in Pa) or "volume" (added).
            velocities: Motion of the boundary with each length, of `MeshMotion.boundary_velocities`.
            materials: Numbers of the material, see `known_parameters`, with the partial derivatives by them at fixed unknowns;
                of `by_material`.

        Returns:
            By the lengths and by the material's numbers, per their SI units.
        """
        motion = self.design.motion
        by_X = np.zeros(motion.entries) if slopes.X is None else slopes.X.copy()
        lam, eta = self.multipliers(slopes, kind)
        if slopes.w is not None or eta:
            by_X -= self.covector(lam)
        if kind == VOLUME:
            by_X -= eta * motion.assembled(self._volume)
        by_material = {}
        for name, direct in materials.items():
            force, stress = self._sensitivity.material_force(name)
            kept = 0.0 if kind == VOLUME else self._state.P * stress / self.system.stress_unit
            inner = total(self.system.comm, float(lam @ force))
            by_material[name] = direct - inner - eta * kept
        return motion.gradient(by_X, dict(velocities)), by_material

    def rates(self, kind: str, velocity: Array) -> tuple[Array, Array]:
        """Return the derivative of the prepared state by a parameter: its unknowns, with ghosts, and the mesh's nodes, shape
        (nodes, d).

        One back-substitution, for quantities with more values than there are parameters.

        Args:
            kind: Of the load that is kept.
            velocity: Motion of the boundary with the parameter, of `MeshMotion.boundary_velocities`.
        """
        nodes = self.design.motion.nodes_rate(velocity)
        w = -self.design.answer(self._sensitivity.motion_force(nodes)[0])
        if kind == VOLUME:
            comm, q = self.system.comm, self._tangent_load
            owned = slice(0, self.design.motion.owned_entries)
            opened = float(self.design.motion.assembled(self._volume)[owned] @ nodes.ravel()[owned])
            short = total(comm, opened + float(q @ w))
            w = w - short / total(comm, float(q @ self._opened)) * self._opened
        self._set(w)
        return self._lambda.x.array.copy(), nodes

    def by_material(self, measure: Measure, names: Sequence[str]) -> dict[str, float]:
        """Return the partial derivatives of a quantity by the material parameters at the loaded unknowns, by
        central differences."""
        system, state = self.system, self._state
        material, found = system.material, {}
        for name in names:
            number = material.poisson if name == "poisson" else material.parameters[name]
            step = STEP * (abs(number) or material.shear_modulus_0)
            weights = BACKWARD if name == "poisson" else CENTRAL  # which must not exceed 0.5
            found[name] = 0.0
            for shift, weight in weights.items():
                system.set_material(nudged(material, name, shift * step))
                found[name] += weight / step * measure.value(state)
            system.set_material(material)
        return found

    def stress_by(self, name: str) -> float:
        """Return the derivative of the shear modulus by a material parameter."""
        return self._sensitivity.material_force(name)[1]

    def limit_gradient(
        self, state: State, tangent: Tangent, velocities: Mapping[str, Array], materials: Sequence[str] = ()
    ) -> tuple[dict[str, float], dict[str, float]]:
        """Return the derivatives in Pa of the pressure at a limit point, whose null vector is the path's own direction there.

        Args:
            state: The limit point.
            tangent: Direction of the path.
            velocities, materials: As for `gradient`.
        """
        system = self.system
        system.load(state)
        v = system.unknowns.nearest(tangent.w) / tangent.V  # v . q = 1
        by_X = self.covector(v)
        lengths = self.design.motion.gradient(system.stress_unit * by_X, dict(velocities))
        by_material = {}
        for name in materials:
            force, stress = self._sensitivity.material_force(name)
            by_material[name] = system.stress_unit * total(system.comm, float(v @ force)) + state.P * stress
        return lengths, by_material


# ----------------------------------------------------------------------------------------------------------------------
# The bifurcation pressure of a device, tracked from design to design, and its exact derivative.
#
# At a bifurcation an eigenvalue of the tangent is zero whose mode does not change the volume. K is singular there under every
# control, so neither the state nor an adjoint is computed there; instead, four states at given volumes on both sides, and the
# eigenvalue of the same mode at each. The reported values are the volume at which the cubic through the eigenvalues is zero,
# and the cubic's pressure there; both are differentiated exactly. An eigenvalue's derivative does not need that of its mode,
# because it is stationary.


SPREADS = np.array([-0.06, -0.025, 0.025, 0.06])
"""Positions of the states around the expected bifurcation, relative to the volume added up to it. Nearer ones would show an
imperfect mesh's eigenvalue (see `softmodels.path.continuation.SPREADS`)."""
NEAR = 0.01
"""Maximum relative distance of the bifurcation from the expected place; otherwise the states are recomputed around it."""
MOST_TRIES = 6


@dataclasses.dataclass(frozen=True, eq=False)
class Bifurcation:
    """A bifurcation, by the states around it.

    Attributes:
        V: Its dimensionless volume, ``P`` its pressure.
        states: On both sides, in order of their volumes.
        modes: Their modes, each of length 1 in the norm of `Stability.mass`; local dofs.
        eigenvalues: Theirs.
    """

    V: float
    P: float
    states: tuple[State, ...]
    modes: tuple[Array, ...]
    eigenvalues: Array

    @property
    def mode(self) -> Array:
        """Mode of the state closest to it."""
        return self.modes[int(np.argmin(np.abs(self.eigenvalues)))]


class Bifurcations:
    """Finds a device's bifurcation near an expected volume.

    Args:
        design: The meshed device.
        adjoint: Of the same.
    """

    def __init__(self, design: DesignedBody, adjoint: Adjoint):
        import ufl
        from dolfinx import fem

        self.design, self.adjoint, self.solver = design, adjoint, design.solver
        system, potential = design.system, design.system.potential
        self._mode = fem.Function(system.space)
        forms = [ufl.action(ufl.derivative(force, system.w, self._mode), self._mode) for force in potential.forces]
        turned = [-ufl.action(ufl.derivative(load, system.w, self._mode), self._mode) for load in potential.loads]
        self._eigenvalue = FormMeasure(
            design, forms, lambda values: (float(values.sum()), np.ones(len(values))), by_pressure=turned
        )

    def near(self, state: State, V: float, mode: Array, rest: float) -> Bifurcation:
        """Return the bifurcation near a volume.

        Args:
            state: A state near it, the first guess.
            V: Where it is expected.
            mode: Its mode, local dofs.
            rest: Volume of the undeformed cavity.

        Raises:
            NoConvergence: A state around it was not found, or the eigenvalue has no zero near.
        """
        for _ in range(MOST_TRIES):
            added = V - rest
            states, modes, values = [], [], []
            for spread in SPREADS:
                found = self.solver.solve(volume_control(V + spread * added), state.w, state.P)
                state = found
                value, shape = Stability.of(self.solver).like(found, mode)
                states.append(found)
                modes.append(shape / Mode(Stability.of(self.solver).mass, shape).length)
                values.append(value)
            cubic = Cubic([found.V for found in states])
            root = cubic.root(np.array(values), V)
            if abs(root - V) < NEAR * added:
                P = float(cubic.weights(root)[0] @ np.array([found.P for found in states]))
                return Bifurcation(root, P, tuple(states), tuple(modes), np.array(values))
            V = root
        raise NoConvergence("the bifurcation is not near that of the last design")

    def gradient(
        self, found: Bifurcation, velocities: Mapping[str, Array], materials: Sequence[str] = ()
    ) -> tuple[dict[str, float], dict[str, float]]:
        """Return the derivatives in Pa of its pressure, by the lengths and by the material parameters; see
        `Adjoint.gradient`."""
        unit = self.design.system.stress_unit
        cubic = Cubic([state.V for state in found.states])
        weights, slopes = cubic.weights(found.V)
        steepness = float(slopes @ found.eigenvalues)
        rise = float(slopes @ np.array([state.P for state in found.states]))
        lengths = dict.fromkeys(velocities, 0.0)
        numbers = dict.fromkeys(materials, 0.0)
        for state, mode, weight in zip(found.states, found.modes, weights, strict=True):
            self.adjoint.prepare(state)
            self._mode.x.array[:] = mode[: len(self._mode.x.array)]
            direct = self.adjoint.by_material(self._eigenvalue, materials)
            by_eigenvalue = self.adjoint.gradient(self._eigenvalue.slopes(state), VOLUME, velocities, direct)
            pressure = Slopes(state.P * unit, P=unit)
            by_pressure = self.adjoint.gradient(pressure, VOLUME, velocities, self._pressure_by(state, materials))
            for sums, of_value, of_pressure in zip((lengths, numbers), by_eigenvalue, by_pressure, strict=True):
                for name in sums:
                    sums[name] += weight * (of_pressure[name] - unit * rise / steepness * of_value[name])
        return lengths, numbers

    def _pressure_by(self, state: State, materials: Sequence[str]) -> dict[str, float]:
        """Return the partial derivatives of a pressure in Pa by the material parameters at the same dimensionless pressure."""
        return {name: state.P * self.adjoint.stress_by(name) for name in materials}


class Cubic:
    """Polynomials through values at given places.

    Args:
        places: Where, four of them.
    """

    def __init__(self, places: Sequence[float]):
        self._middle, self._reach = float(np.mean(places)), float(np.ptp(places)) / 2
        x = (np.array(places) - self._middle) / self._reach
        self._inverse = np.linalg.inv(np.vander(x))

    def weights(self, place: float) -> tuple[Array, Array]:
        """Return the weights of the values in the polynomial's value at a place, and in its slope there."""
        x = (place - self._middle) / self._reach
        powers = np.vander([x], len(self._inverse))[0]
        n = len(self._inverse)
        slopes = np.array([(n - 1 - i) * x ** (n - 2 - i) if i < n - 1 else 0.0 for i in range(n)])
        return powers @ self._inverse, slopes @ self._inverse / self._reach

    def root(self, values: Array, near: float) -> float:
        """Return the zero nearest to a place, not farther from the middle than twice the reach.

        Raises:
            NoConvergence: There is none.
        """
        roots = np.roots(self._inverse @ values)
        real = roots[np.abs(roots.imag) < 1e-9].real
        real = real[np.abs(real) < 2.0]
        if not len(real):
            raise NoConvergence("the eigenvalue does not change sign near that of the last design")
        return float(self._middle + self._reach * real[np.argmin(np.abs(real - (near - self._middle) / self._reach))])
