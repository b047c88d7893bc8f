"""The pressure at which a device's path bifurcates, carried from design to design, and its exact derivative.

At a bifurcation an eigenvalue of the tangent is zero whose mode leaves the volume as it is. K is singular there in every
control, so neither the state nor an adjoint is asked for at it: four states on both sides at given volumes are, and the
eigenvalue of the same mode at each. The volume at which the cubic through the eigenvalues is zero, and the cubic's pressure
there, are what is reported; both are differentiated as they are computed. An eigenvalue's derivative needs none of its mode,
which makes it stationary.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from softmodels.design.adjoint import Adjoint
from softmodels.design.loads import VOLUME
from softmodels.design.quantities.base import Slopes
from softmodels.design.quantities.forms import FormMeasure
from softmodels.mechanics.controls import volume_control
from softmodels.mechanics.newton import NoConvergence
from softmodels.path.modes import Mode
from softmodels.path.stability import Stability

if TYPE_CHECKING:
    from softmodels.design.designed_body import DesignedBody
    from softmodels.mechanics.system import State

Array = npt.NDArray[np.float64]

SPREADS = np.array([-0.06, -0.025, 0.025, 0.06])
"""Where the states lie around the expected bifurcation, in shares of the volume added up to it. Nearer ones would show an
imperfect mesh's eigenvalue (see `softmodels.path.critical_points.SPREADS`)."""
NEAR = 0.01
"""The same of how far the bifurcation may lie from where it was expected; else the states are taken around it anew."""
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
        """That of the state next to it."""
        return self.modes[int(np.argmin(np.abs(self.eigenvalues)))]


class Bifurcations:
    """Finds a device's bifurcation from where it is expected.

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
        """The bifurcation near a volume.

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
        raise NoConvergence("the bifurcation is not near where it was on the last design")

    def gradient(
        self, found: Bifurcation, velocities: Mapping[str, Array], materials: Sequence[str] = ()
    ) -> tuple[dict[str, float], dict[str, float]]:
        """Derivatives in Pa of its pressure, by the lengths and by the material's numbers; see `Adjoint.gradient`."""
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
        """Partial derivatives of a pressure in Pa by the material's numbers at the same dimensionless pressure."""
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
        """What each value adds to the polynomial's value at a place, and to its slope there."""
        x = (place - self._middle) / self._reach
        powers = np.vander([x], len(self._inverse))[0]
        n = len(self._inverse)
        slopes = np.array([(n - 1 - i) * x ** (n - 2 - i) if i < n - 1 else 0.0 for i in range(n)])
        return powers @ self._inverse, slopes @ self._inverse / self._reach

    def root(self, values: Array, near: float) -> float:
        """The zero nearest to a place, not farther from the middle than twice the reach.

        Raises:
            NoConvergence: There is none.
        """
        roots = np.roots(self._inverse @ values)
        real = roots[np.abs(roots.imag) < 1e-9].real
        real = real[np.abs(real) < 2.0]
        if not len(real):
            raise NoConvergence("the eigenvalue does not change its sign near where it did on the last design")
        return float(self._middle + self._reach * real[np.argmin(np.abs(real - (near - self._middle) / self._reach))])
