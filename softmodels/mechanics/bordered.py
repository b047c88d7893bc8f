"""Newton's linear system with the cavities' pressures as more unknowns, by one symmetric factorisation.

        [ K      -q   -H ] [dw]   [ r ]   K: tangent of the body, symmetric, indefinite in the mixed form
        [ a q^T   b    0 ] [dP] = [ c ]   q: dV/dw, the load of a unit pressure;  a, b: the control's line
        [ H^T     0    0 ] [dm]   [ g ]   H: the same of each further cavity whose volume is held, by its pressure m

K alone is factorised (LDL^T), whatever the control; the border is eliminated (Keller 1977; Chan 1984,
doi 10.1137/0721019). The same factorisation serves as preconditioner of GMRES on the whole system for the Newton
iterations that follow, and GMRES also returns the digits that elimination loses where K is nearly singular: at a limit
point the whole system is regular although K is not. A cycle of multigrid in the factorisation's place is bordered in the
same way, with one more right side for each column: it need not be near K^-1 for that.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from softmodels.mechanics.callbacks import Shell
from softmodels.mechanics.controls import Control, pressure_control
from softmodels.mechanics.inverse import Inverse
from softmodels.mechanics.mpi import owns_scalars, scalars_from_owner
from softmodels.mechanics.petsc_matrices import length

if TYPE_CHECKING:
    from petsc4py import PETSc

Array = npt.NDArray[np.float64]


ITERATED = 1e-10
"""Tolerance of the solves that stand for back-substitutions."""
ALIKE = 5e-2
"""Change of the load of a unit pressure, in shares of it, up to which K^-1 times it is kept."""
REFINED, MOST_REFINEMENTS = 1e-12, 5
"""What back-substitutions in single precision are refined to, in shares of the answer, if nothing else is asked for; and in how
many steps at most."""


class Bordered:
    """PETSc contexts for the bordered matrix and its preconditioner.

    Vectors of the whole system hold the body's unknowns, then on the last rank the pressure and those of held volumes.

    Args:
        K: Tangent matrix (PETSc Mat, symmetric).
        inverse: What stands for its inverse.
        product: ``product(x, y)`` puts the current tangent times x into y (local owned arrays). Where K was factorised at
            an earlier state, this is what makes the solution that of the present one.
        constraints: Number of held volumes.

    Attributes:
        factorisations: How often the inverse was set up.
    """

    def __init__(self, K: PETSc.Mat, inverse: Inverse, product: Callable[[Array, Array], None], constraints: int = 0):
        from petsc4py import PETSc

        self.K, self.inverse, self.product, self.comm = K, inverse, product, K.comm.tompi4py()
        self.n = K.getLocalSize()[0]
        self.scalars = 1 + constraints
        self.extra = self.scalars if owns_scalars(self.comm) else 0
        self.columns = [K.createVecRight() for _ in range(self.scalars)]
        self._lifted = [K.createVecRight() for _ in range(self.scalars)]
        self._r, self._y, self._q_lifted = K.createVecRight(), K.createVecRight(), K.createVecRight()
        self.control = Control(0.0, 1.0, 0.0)
        self.row: PETSc.Vec | None = (
            None  # a force in q's place in the control's equation, where that is not of the volume
        )
        self.compliances = np.zeros((self.scalars, self.scalars))
        self.factorisations = 0
        self.shell = Shell(self.mult, self.apply)
        size = (self.n + self.extra, PETSc.DETERMINE)
        self.mat = PETSc.Mat().createPython((size, size), context=self.shell, comm=K.comm)
        self.mat.setUp()
        self._iterations = self.precondition(PETSc.KSP().create(K.comm), ITERATED)
        self._right, self._solution = self.vector(), self.vector()

    def precondition(self, ksp: PETSc.KSP, tolerance: float) -> PETSc.KSP:
        """Make a linear solver GMRES with the bordered inverse as preconditioner, to a relative tolerance."""
        self.inverse.on_the_right(ksp, self.shell, tolerance, self.inverse.most_iterations)
        return ksp

    @property
    def q(self) -> PETSc.Vec:
        """The load of a unit pressure."""
        return self.columns[0]

    @property
    def constraint_columns(self) -> list[PETSc.Vec]:
        """The loads of unit pressures in the cavities whose volumes are held."""
        return self.columns[1:]

    def release(self) -> None:
        """Destroy what PETSc holds; see `Solver.release`."""
        self.inverse.release()
        of_all = (self._iterations, self._right, self._solution, self.mat)
        for thing in (*of_all, *self.columns, *self._lifted, self._r, self._y, self._q_lifted):
            thing.destroy()

    def vector(self) -> PETSc.Vec:
        return self.mat.createVecRight()

    def join(self, x: Any, body: Array | float, scalars: Sequence[float] | Array) -> None:
        """Fill ``x`` from the body's part (an array) and the pressures'."""
        with x as values:
            values[: self.n] = body
            if self.extra:
                values[self.n :] = scalars

    def split(self, x: PETSc.Vec) -> tuple[Array, Array]:
        """The body's part (local array, a view valid until x changes) and the pressures' (on all ranks)."""
        values = x.array_r
        return values[: self.n], scalars_from_owner(self.comm, np.array(values[self.n :]))

    def factorise(self) -> None:
        """Factorise K as it is now, or set up what stands for its inverse.

        Raises:
            MemoryError: On all ranks, if one has not enough.
        """
        self.inverse.set_up()
        self.factorisations += 1
        self._lift(0)

    def solve(self, b: PETSc.Vec, x: PETSc.Vec, tolerance: float = REFINED) -> None:
        """x = K^-1 b among the motions that keep the held volumes: with the factorisation at hand, or by iterations.

        Iterations solve with the tangent of the state that is loaded; single precision is refined to a relative tolerance.
        """
        if not self.inverse.exact:
            self.iterate(b, x, ITERATED)
            return
        pressures = self.solve_roughly(b, x)
        if self.inverse.rounded:
            self._refine(b, x, pressures, tolerance)

    def solve_roughly(self, b: PETSc.Vec, x: PETSc.Vec) -> Array:
        """The same to the factorisation's own precision; returns the pressures that keep the held volumes."""
        self.inverse.apply(b, x)
        return self.keep_volumes(x)

    def keep_volumes(self, x: PETSc.Vec) -> Array:
        """Take what a motion x changes of the held volumes out of it, by the motions of their pressures; returns these."""
        if not self.constraint_columns:
            return np.zeros(0)
        return self._close(np.array([column.dot(x) for column in self.constraint_columns]), x)

    def _close(self, opened: Array, x: PETSc.Vec) -> Array:
        """Take held volumes' changes out of x; returns the pressures that do it."""
        pressures: Array = -np.linalg.solve(self.compliances[1:, 1:], opened)
        for pressure, lifted in zip(pressures, self._lifted[1:], strict=True):
            x.axpy(pressure, lifted)
        return pressures

    def _refine(self, b: PETSc.Vec, x: PETSc.Vec, pressures: Array, tolerance: float) -> None:
        """Correct x by what it leaves of b, with the K that was factorised, until it keeps its digits."""
        before = length(x)
        for _ in range(MOST_REFINEMENTS):
            self.K.mult(x, self._r)
            self._r.aypx(-1.0, b)
            for pressure, column in zip(pressures, self.constraint_columns, strict=True):
                self._r.axpy(pressure, column)
            self.inverse.apply(self._r, self._y)
            if self.constraint_columns:
                opened = [column.dot(x) + column.dot(self._y) for column in self.constraint_columns]
                pressures = pressures + self._close(np.array(opened), self._y)
            x.axpy(1.0, self._y)
            size = length(self._y)
            # What is left is as much smaller than this correction as this one is than the last.
            if size * size <= tolerance * before * length(x) or size == 0.0:
                return
            before = size

    def iterate(self, b: PETSc.Vec, x: PETSc.Vec, tolerance: float) -> int:
        """The same by iterations to a relative tolerance; returns how many there were."""
        control, self.control = self.control, pressure_control(0.0)
        try:
            self.join(self._right, b.array_r, np.zeros(self.scalars))
            self.mat.assemble()
            self._iterations.setOperators(self.mat)
            self._iterations.setTolerances(rtol=tolerance)
            self._iterations.solve(self._right, self._solution)
        finally:
            self.control = control
        x.array_w[:] = self.split(self._solution)[0]
        return self._iterations.getIterationNumber()

    def negative_eigenvalues(self) -> int:
        """Negative eigenvalues of the K that was factorised, on the motions that keep the held volumes.

        Its negative pivots (Sylvester's law of inertia), less those that holding the volumes takes away: the negative
        eigenvalues of H^T K^-1 H (Haynsworth 1968, doi 10.1016/0024-3795(68)90050-5).
        """
        constrained = np.linalg.eigvalsh(self.compliances[1:, 1:]) if self.constraint_columns else np.empty(0)
        return self.inverse.negative_pivots() - int(np.count_nonzero(constrained < 0))

    def refresh(self) -> None:
        """Take up new columns: K^-1 times each with the factorisation at hand, and the compliances between them.

        The first column is a part of a preconditioner alone: where it has hardly changed, the answer to it is kept.
        """
        self.q.copy(self._y)
        self._y.axpy(-1.0, self._q_lifted)
        self._lift(0 if length(self._y) > ALIKE * length(self.q) else 1)

    def _lift(self, first: int) -> None:
        """K^-1 times the columns from the first one on, and the compliances between all."""
        for column, lifted in zip(self.columns[first:], self._lifted[first:], strict=True):
            self.inverse.apply(column, lifted)
        if first == 0:
            self.q.copy(self._q_lifted)
        self.compliances = np.array([[column.dot(lifted) for lifted in self._lifted] for column in self.columns])

    # PETSc calls these: of the matrix, and of the preconditioner.

    def mult(self, mat: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        body, pressures = self.split(x)
        self._r.array_w[:] = body
        self.product(body, self._y.array_w)
        for pressure, column in zip(pressures, self.columns, strict=True):
            self._y.axpy(-pressure, column)
        a, b = self.control.volume_coefficient, self.control.pressure_coefficient
        gap = a * (self.row or self.q).dot(self._r) + b * pressures[0]
        self.join(y, self._y.array_r, [gap, *(column.dot(self._r) for column in self.constraint_columns)])

    def apply(self, pc: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        body, gaps = self.split(x)
        self._r.array_w[:] = body
        self.inverse.apply(self._r, self._y)
        a, rows = self.control.volume_coefficient, [self.row or self.q, *self.constraint_columns]
        matrix = self.compliances.copy()
        if self.row:
            matrix[0] = [self.row.dot(lifted) for lifted in self._lifted]
        matrix[0] *= a
        matrix[0, 0] += self.control.pressure_coefficient
        opened = np.array([row.dot(self._y) for row in rows])
        opened[0] *= a
        # Most devices have one cavity, and this is called for every iteration.
        pressures = (gaps - opened) / matrix[0] if self.scalars == 1 else np.linalg.solve(matrix, gaps - opened)
        for pressure, lifted in zip(pressures, self._lifted, strict=True):
            self._y.axpy(pressure, lifted)
        self.join(y, self._y.array_r, pressures)
