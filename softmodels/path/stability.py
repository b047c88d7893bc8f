"""Stability of states: the signature of the tangent, its lowest eigenvalues, and their modes.

A state is stable under a given pressure where the tangent K is positive definite on the displacements, and under a given
volume where it is so on those that keep the volume. Both follow from the inertia of the factorised K (Sylvester's law):

* Mixed form: each of the n_p unknowns of p adds one negative pivot to a stable K, since eliminating them from the bottom
  leaves the displacements' own stiffness (Haynsworth 1968, doi 10.1016/0024-3795(68)90050-5). What is beyond n_p is the
  the number of K's negative eigenvalues: the directions in which the energy falls.
* Holding the volume takes one of them away where the compliance dV/dP = q.K^-1 q is negative.
* Volumes that are held whatever the path follows are taken into account in both (`Bordered.negative_eigenvalues`).

Eigenvalues are of K x = lambda M x with the displacement's mass matrix M (of unit density): they do not depend on the mesh's
cells, and lambda / density is the square of a natural frequency. M has no entries for p, which is then slaved to u.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from softmodels.mechanics.compiling import JIT
from softmodels.mechanics.newton import NoConvergence
from softmodels.mechanics.petsc_matrices import sparse_matrix
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import State
from softmodels.path.modes import Mode
from softmodels.path.spectra import spectrum_of

if TYPE_CHECKING:
    from petsc4py import PETSc

Array = npt.NDArray[np.float64]

ALWAYS = 6000
"""Unknowns up to which every point is factorised: it costs no more there than the iterations it saves."""
NEAR = 0.4
"""Share of the lowest eigenvalue at the last factorised point below which a larger system is factorised too."""
SINGULAR = 1e-6
"""Eigenvalue, in shares of the largest on the path, below which K is singular and the rest is rounding."""

ALIKE = 0.6
"""Cosine of the angle between two modes (in the inner product of M) above which they are one mode at two states."""


@dataclasses.dataclass(frozen=True)
class Signature:
    """How a state stands.

    Attributes:
        negative_eigenvalues: Of the tangent at a given pressure: directions in which the energy falls; 0 if stable.
        lowest: Lowest eigenvalue, dimensionless (shear moduli over squared sizes), to 1e-9 of itself, or to 1e-4 where it is
            not exact; nan if it was not found.
        exact: Whether K was factorised here. Else their number is the last factorised point's, and the eigenvalue has kept
            away from zero since.
    """

    negative_eigenvalues: int = 0
    lowest: float = 0.0
    exact: bool = True


class Stability:
    """Signatures of a device's states. One per `Solver`; see `of`."""

    def __init__(self, solver: Solver):
        import ufl
        from dolfinx import fem

        self.solver = solver
        eq = solver.system
        test, trial = ufl.TestFunction(eq.space), ufl.TrialFunction(eq.space)
        u, v = (ufl.split(f)[0] if eq.mixed else f for f in (trial, test))
        dx = ufl.Measure("dx", eq.body.mesh, metadata={"quadrature_degree": 4})
        mass = ufl.inner(eq.body.displacement(u), eq.body.displacement(v)) * eq.body.hoop * dx
        form = fem.form(mass, jit_options=JIT)
        self.mass = sparse_matrix(form, eq.bcs, 0.0)
        self.M = eq.unknowns.projected(self.mass)
        self.unknowns = eq.K.getSize()[0]
        self.spectrum = spectrum_of(solver, self.M)
        self.start()

    @classmethod
    def of(cls, solver: Solver) -> Stability:
        """The one that belongs to a solver, made at the first call."""
        found = getattr(solver, "_stability", None)
        if found is None:
            found = cls(solver)
            solver._stability = found  # type: ignore[attr-defined]
        return found

    def start(self) -> None:
        """Forget the modes known and take up a shape that has a part of every mode, the same on any ranks.

        Every search for modes begins with it, so that what is found depends on the state alone and not on the way there.
        """
        from dolfinx import fem

        eq = self.solver.system
        seed, d = fem.Function(eq.space), eq.body.mesh.geometry.dim

        def rough(x: Array) -> Array:
            waves = np.array([[1.7, 2.3, 2.9], [3.1, 1.3, 2.1], [2.7, 3.3, 1.9]])
            return np.sin(waves[:d] @ x + 0.5) + 0.3 * np.sin(3.7 * waves[:d] @ x)

        (seed.sub(0) if eq.mixed else seed).interpolate(rough)
        for bc in eq.bcs:
            bc.set(seed.x.array, alpha=0.0)
        self.seed = self.M.createVecRight()
        self.spectrum.seed = self.seed
        self.seed.array_w[:] = eq.unknowns.nearest(seed.x.array)
        self.sense = self.M.createVecLeft()  # tells a mode from its opposite
        self.M.mult(self.seed, self.sense)
        self.reference = self.largest = self._guess = 0.0
        self.modes: Sequence[PETSc.Vec] = []

    # -- along a path -------------------------------------------------------------------------------------------------

    def wants(self, state: State) -> bool:
        """Whether the signature at this state needs a factorisation of its own.

        It does where faces are pressed on: a kept K has other places in contact, and corrections by its inverse creep.
        """
        system = self.solver.system
        if self.unknowns <= ALWAYS or not self.modes or system.unknowns.turns or system.assembled.touches(state.w):
            return True
        try:
            self._guess = self.spectrum.corrected(state, self.modes)
        except NoConvergence:
            return True
        return self._guess < NEAR * self.reference

    def signature(self, exact: bool, known: int = 0) -> Signature:
        """Signature of the state that `wants` was asked of: of K as factorised there, or else with the number known before."""
        if not exact:
            return Signature(known, self._guess, exact=False)
        value = self.lowest()
        return Signature(self.negative_eigenvalues(), value)

    def lowest(self) -> float:
        """Lowest eigenvalue of K as it is factorised; nan if it was not found to within its tolerance."""
        self.solver.system.unknowns.projected(self.mass, self.M)
        try:
            value, self.modes = self.spectrum.lowest(self.modes)
        except NoConvergence:
            self.modes = []
            return math.nan
        self.reference = abs(value)
        self.largest = max(self.largest, self.reference)
        return value

    def critical_lowest(self, state: State, negative: int) -> float:
        """Lowest eigenvalue where K is singular in one mode more than ``negative`` ones; K may be factorised there.

        Zero where none is negative; else that of K with its singular mode, which leaves the others as they are.
        """
        if not negative:
            return 0.0
        self.solver.factorise(state)
        reference, largest = self.reference, self.largest
        value = self.lowest()
        self.reference, self.largest = reference, largest
        return 0.0 if abs(value) < SINGULAR * largest else value

    def negative_eigenvalues(self) -> int:
        """Negative eigenvalues of the factorised K beyond those of a stable one."""
        return self.spectrum.negative_eigenvalues

    # -- at one state -------------------------------------------------------------------------------------------------

    def eigenpairs(self, state: State, count: int = 4) -> list[tuple[float, Array]]:
        """Eigenvalues nearest zero and their modes at a state, rising, by shift and invert through the factorised K.

        Args:
            state: The state; K is factorised there.
            count: How many at least.

        Returns:
            Pairs of eigenvalue (dimensionless) and mode: shape as `State.w`, largest entry 1 or -1.
        """
        self.solver.factorise(state)
        return self._pairs(count)

    def _pairs(self, count: int) -> list[tuple[float, Array]]:
        """`eigenpairs` of K as it is factorised."""
        self.solver.system.unknowns.projected(self.mass, self.M)
        pairs = [(value, self._mode(vector)) for value, vector in self.spectrum.pairs(count)]
        return sorted(pairs, key=lambda pair: pair[0])

    def _mode(self, vector: PETSc.Vec) -> Array:
        from dolfinx import fem

        function = fem.Function(self.solver.system.space)
        self.solver.system.unknowns.push(vector.array_r, function.x.array)
        function.x.scatter_forward()
        # By its largest entry alone, an antisymmetric mode would turn round with the rounding of the day.
        largest = max(vector.max()[1], -vector.min()[1])
        scaled = function.x.array / math.copysign(largest, vector.dot(self.sense))
        return np.concatenate([scaled, np.zeros(len(self.solver.system.coupling.constraints))])

    def critical(self, state: State, index: int) -> tuple[float, Array]:
        """The eigenvalue that is number ``index`` (from 0) in rising order, and its mode; K is factorised at the state."""
        pairs = self.eigenpairs(state)
        negative = self.negative_eigenvalues()
        rank = negative - sum(value < 0 for value, _ in pairs)  # negative ones farther from zero than those found
        chosen = min(max(index - rank, 0), len(pairs) - 1)
        return pairs[chosen]

    def like(self, state: State, shape: Array) -> tuple[float, Array]:
        """The eigenvalue whose mode is most like a shape, and that mode: the same one all along, whatever others it passes.

        Args:
            state: The state; K is factorised there.
            shape: Mode at a neighbouring state, local dofs.

        Raises:
            NoConvergence: No mode is like it.
        """
        measure = Mode(self.mass, shape)
        pairs = [
            (abs(measure.share(mode)) / measure.size(mode), value, mode) for value, mode in self.eigenpairs(state, 8)
        ]
        likeness, value, mode = max(pairs, key=lambda pair: pair[0])
        if likeness < ALIKE:
            raise NoConvergence("its mode was lost between two states")
        return value, mode
