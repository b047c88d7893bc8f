"""Gradients of quantities at states of equilibrium, by adjoints: one back-substitution for each, however many parameters.

A state (w, P) satisfies R(w, P; theta) = 0 and the line a V + b P = d of its load. With

        [ K    a q ] [ lambda ]   [ dj/dw ]
        [ -q^T  b  ] [ eta    ] = [ dj/dP ]

the whole derivative is dj/dtheta - lambda . dR/dtheta - eta d(aV + bP - d)/dtheta (Michaleris, Tortorelli & Vidal 1994, doi
10.1002/nme.1620371408). For shapes theta is the places X of the mesh's nodes: lambda . dR/dX is a covector that one assembly
makes, and its product with each parameter's motion of the mesh is the derivative. At a limit point of the pressure K v = 0,
and dP/dtheta = (v . dR/dtheta) / (v . q).
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from softmodels.design.loads import VOLUME
from softmodels.materials.specimens import nudged
from softmodels.mechanics.mpi import total
from softmodels.mechanics.sensitivity import Sensitivity
from softmodels.mechanics.tangent import Tangent

if TYPE_CHECKING:
    from dolfinx import fem

    from softmodels.design.designed_body import DesignedBody
    from softmodels.design.quantities.base import Measure, Slopes
    from softmodels.mechanics.system import State

Array = npt.NDArray[np.float64]

STEP = 1e-5
"""Of the differences by the material's numbers at fixed unknowns, in shares of each."""
CENTRAL = {1.0: 0.5, -1.0: -0.5}
BACKWARD = {0.0: 1.5, -1.0: -2.0, -2.0: 0.5}
_NONE: Mapping[str, float] = {}


class Adjoint:
    """Whole derivatives of quantities on a meshed device.

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
        self._sensitivity = Sensitivity(self.solver)

    def prepare(self, state: State) -> None:
        """Factorise the tangent at a state; the gradients that follow are of this one."""
        self.solver.factorise(state)
        self._state = state
        self._tangent_load = np.array(self.solver.bordered.q.array_r)
        self._lifted: Array | None = None

    @property
    def _opened(self) -> Array:
        """The prepared state's answer to a unit pressure, which is asked for only where a volume is kept."""
        if self._lifted is None:
            self._lifted = self.design.answer(self._tangent_load)
        return self._lifted

    def multipliers(self, slopes: Slopes, kind: str) -> tuple[Array, float]:
        """lambda (owned entries) and eta of a quantity at the prepared state, for a load of a kind."""
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
        """lambda . dR/dX over the mesh's nodes at the state that is loaded."""
        self._set(lam)
        return sum((self.design.motion.assembled(form) for form in self._forces), np.zeros(self.design.motion.entries))

    def _set(self, lam: Array) -> None:
        x = self._lambda.x
        self.system.unknowns.push(lam, x.array)
        x.scatter_forward()

    def gradient(
        self, slopes: Slopes, kind: str, velocities: Mapping[str, Array], materials: Mapping[str, float] = _NONE
    ) -> tuple[dict[str, float], dict[str, float]]:
        """Whole derivatives of a quantity at the prepared state.

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

    @functools.cached_property
    def _moving(self) -> tuple[fem.Function, list[fem.Form]]:
        """A motion of the mesh's nodes, and the derivatives of the forces along it."""
        import ufl
        from dolfinx import fem

        system, motion = self.system, fem.Function(self.design.motion.space)
        X = ufl.SpatialCoordinate(system.body.mesh)
        return motion, [system.form(ufl.derivative(force, X, motion)) for force in system.potential.forces]

    def rates(self, kind: str, velocity: Array) -> tuple[Array, Array]:
        """How the prepared state follows a parameter: its unknowns, with ghosts, and the mesh's nodes, shape (nodes, d).

        One back-substitution, for quantities with more values than there are parameters.

        Args:
            kind: Of the load that is kept.
            velocity: Motion of the boundary with the parameter, of `MeshMotion.boundary_velocities`.
        """
        moving, forms = self._moving
        nodes = self.design.motion.nodes_rate(velocity)
        moving.x.array[:] = nodes.ravel()
        w = -self.design.answer(self.system.assemble(forms).copy())
        if kind == VOLUME:
            comm, q = self.system.comm, self._tangent_load
            owned = slice(0, self.design.motion.owned_entries)
            opened = float(self.design.motion.assembled(self._volume)[owned] @ nodes.ravel()[owned])
            short = total(comm, opened + float(q @ w))
            w = w - short / total(comm, float(q @ self._opened)) * self._opened
        self._set(w)
        return self._lambda.x.array.copy(), nodes

    def by_material(self, measure: Measure, names: Sequence[str]) -> dict[str, float]:
        """Partial derivatives of a quantity by the material's numbers at the unknowns that are loaded: central differences."""
        system, state = self.system, self._state
        material, found = system.material, {}
        for name in names:
            number = material.poisson if name == "poisson" else material.parameters[name]
            step = STEP * (abs(number) or material.shear_modulus_0)
            weights = BACKWARD if name == "poisson" else CENTRAL  # which may be 0.5, and never more
            found[name] = 0.0
            for shift, weight in weights.items():
                system.set_material(nudged(material, name, shift * step))
                found[name] += weight / step * measure.value(state)
            system.set_material(material)
        return found

    def stress_by(self, name: str) -> float:
        """Derivative of the shear modulus by one of the material's numbers."""
        return self._sensitivity.material_force(name)[1]

    def limit_gradient(
        self, state: State, tangent: Tangent, velocities: Mapping[str, Array], materials: Sequence[str] = ()
    ) -> tuple[dict[str, float], dict[str, float]]:
        """Derivatives in Pa of the pressure at a limit point, whose null vector is the path's own direction there.

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
