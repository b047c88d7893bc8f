"""Newton's method on the bordered equations, by PETSc's SNES, with a factorisation of the tangent as preconditioner."""

from __future__ import annotations

import abc
import contextlib
import math
import weakref
from collections.abc import Callable, Iterator, Sequence
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from softmodels.common.arrays import Array
from softmodels.common.lazy import PETSc
from softmodels.mechanics import assembly, controls, mpi
from softmodels.mechanics.system import State, System, rounding_of_stress


class Newton:
    """Newton's method for a system on a control's curve; the system's functions hold the iterate. ``snes`` is PETSc's solver,
    with the options that the user has given it, ``x`` its vector of unknowns, ``f`` its residual."""

    def __init__(self, system: System, bordered: Bordered, lagged: LaggedPreconditioner):
        self.system, self.bordered, self.lagged = system, bordered, lagged
        self._first = self._before = self._least = math.inf
        self._least_at = 1  # the iteration of the least residual after the guess's
        self._of_stress, self._of_motion, self._round = 0.0, 0.0, rounding_of_stress(system)
        self._iterate = np.empty(0)
        self._most = bordered.inverse.max_newton_iterations
        self._smallest: float | None = None  # volume ratio of the iterate, where it was a trial
        self._since: Array | None = None
        self._anchor: Array | None = None
        self._force: PETSc.Vec | None = None  # whose path from the anchor on is given
        self.control: controls.Curve = controls.Control(0.0, 1.0, 0.0)
        self.x, self.f, self._y = bordered.vector(), bordered.vector(), system.K.createVecRight()
        snes = self.snes = PETSc.SNES().create(system.comm)
        snes.setType("newtonls")
        snes.setFunction(weakly(self._residual), self.f)
        snes.setJacobian(weakly(self._jacobian), bordered.mat)
        # When friction reverses, full steps oscillate between sliding one way and the other.
        snes.getLineSearch().setType("bt" if system.assembled.remembers else "basic")
        snes.setTolerances(stol=0.0)  # a short step is not an equilibrium state
        snes.setLineSearchPreCheck(weakly(self._guard))
        snes.setConvergenceTest(weakly(self._converged))
        snes.setMaxLinearSolveFailures(3)

    def release(self) -> None:
        """Destroy the PETSc objects; see `Solver.release`."""
        for thing in (self.snes, self.x, self.f, self._y):
            thing.destroy()

    def solve(self, control: controls.Curve, w: Array, P: float, since: Array | None = None, most: int | None = None) -> Array:
        """Solve on a control's curve from a guess; see `Solver.solve`. Returns P and the multipliers."""
        self.control, self._since = control, since
        self._smallest = None
        self._most = most or self.bordered.inverse.max_newton_iterations
        self.bordered.join(self.x, self.system.unknowns.to_reduced(w), [P, *w[self.system.dofs :]])
        self.system.assembled.whole = True
        try:
            self.snes.solve(None, self.x)
        finally:
            self.system.assembled.whole = False
        PETSc.garbage_cleanup(self.system.comm)  # collect dropped vectors: all ranks have to agree on them
        reason: Any = self.snes.getConvergedReason()  # an int, despite its stub
        if reason <= 0:
            self.lagged.invalidate()
            why = _REASONS.get(reason, f"PETSc's reason {reason}")
            raise NoConvergence(why.format(most=self._most, instead=self.bordered.inverse.instead))
        return self._take_iterate(self.x)

    def solve_along(self, force: PETSc.Vec, anchor: Array, amount: float, w: Array, P: float) -> Array:
        """Return the same where ``force . (w - anchor)`` is given; see `Solver.solve_along`."""
        self.bordered.row, self._force, self._anchor = force.copy(), force, anchor
        try:
            return self.solve(controls.Control(1.0, 0.0, amount), w, P)
        finally:
            self.bordered.row = self._force = self._anchor = None

    # -- PETSc calls these ----------------------------------------------------------------------------------------------

    def _take_iterate(self, x: PETSc.Vec) -> Array:
        body, scalars = self.bordered.split(x)
        self.system.set_iterate(body, scalars)
        return scalars

    def _residual(self, snes: PETSc.SNES, x: PETSc.Vec, f: PETSc.Vec) -> None:
        system, control = self.system, self.control
        coupling = system.coupling
        P = float(self._take_iterate(x)[0])
        loads = self.lagged.set_columns()
        inner = system.internal_forces()
        volumes = system.driven() if control.needs_volume or len(coupling.constraints) else np.zeros(len(loads))
        measured = float(coupling.shares @ volumes) if self._anchor is None else self._along()
        gap = control.weight * (control.value(measured, P) - control.target)
        self.bordered.control = control.line(measured, P)  # Newton's matrix at this iterate has the control's tangent
        gaps = [gap, *(coupling.constraints @ volumes - coupling.constrained_volumes)]
        self.bordered.join(f, inner - system.pressures @ loads, gaps)
        norms = np.sqrt([mpi.total(system.comm, float(load @ load)) for load in loads])
        self._load_size = float(np.abs(system.pressures) @ norms)
        if motion := system.potential.motion:
            self._load_size += motion.force
            self._of_motion = motion.rounding
        self._of_stress = float(norms[: len(norms) - len(system.dead.forms)].max(initial=0.0))

    def _along(self) -> float:
        """Return how far the current state has gone from the anchor along its force."""
        assert self._anchor is not None
        n, row = self.system.n, self.bordered.row
        assert row is not None and self._force is not None
        self._y.array_w[:] = self.system.w.x.array[:n] - self._anchor[:n]
        self._force.copy(row)
        self.system.unknowns.restrict(row.array_w)
        return float(self._force.dot(self._y))

    def _jacobian(self, snes: PETSc.SNES, x: PETSc.Vec, J: PETSc.Mat, P: PETSc.Mat) -> None:
        self._take_iterate(x)
        self._predict_stress()
        if self.bordered.factorisations == 0 or self.lagged.exhausted:
            self.lagged.make(None)
        else:
            self.bordered.refresh()
        J.assemble()

    def _predict_stress(self) -> None:
        """Set the stress of sheets and fibres in Newton's matrix: the iterate's, or with `solve`'s ``since`` a predicted
        one."""
        if not self.system.potential.predicted_stiffness:
            return
        here = self.system.w.x.array.copy()
        if self._since is None:
            self.system.potential.predict_stress(here)
        elif self.snes.getIterationNumber():
            self.system.potential.predict_stress(self._iterate)
        else:
            self.system.potential.predict_stress(self._since, ahead=False)
        self._iterate = here

    def _guard(self, x: PETSc.Vec, y: PETSc.Vec) -> bool:
        """Shorten Newton's step y (the next iterate is x - y) until no cell is inverted and nothing passes through a wall."""
        self.lagged.count(self.snes.getKSP())
        self._take_iterate(x)
        system = self.system
        known = None if system.assembled.remembers else self._smallest  # a line search may have taken a shorter step
        least = 0.1 * (system.smallest_J() if known is None else known)
        before = system.w.x.array.copy()
        trial, factor = x.duplicate(), 1.0
        for _ in range(8):
            x.copy(trial)
            trial.axpy(-factor, y)
            self._take_iterate(trial)
            self._smallest = system.smallest_J()
            if self._smallest > least and system.potential.is_admissible(before, system.w.x.array):
                break
            factor /= 2
        else:
            self._smallest = None  # the accepted step is shorter than the last trial
        y.scale(factor)
        return factor < 1.0

    def _converged(self, snes: PETSc.SNES, iteration: int, norms: tuple[float, float, float]) -> int:
        reasons: Any = PETSc.SNES.ConvergedReason
        _, _, residual = norms
        if not math.isfinite(residual):
            return reasons.DIVERGED_FNORM_NAN
        if iteration == 0:
            self._first, self._least, self._least_at = residual, math.inf, 1
        unit_load: Any = self.bordered.q.norm()
        tolerance = RESIDUAL_TOLERANCE * max(self._load_size, MIN_PRESSURE_SCALE * unit_load)
        # Forces in a thin wall cancel to 1e-9 of themselves; Newton cannot reduce their rounding error,
        # nor that of a stiff region, which may exceed a small weight.
        rounding = max(
            STAGNATION_TOLERANCE_FACTOR * max(tolerance, RESIDUAL_TOLERANCE * MIN_PRESSURE_SCALE * self._of_stress),
            ROUNDING_SAFETY_FACTOR * (self._round * self._of_stress + self._of_motion),
        )
        tolerance *= 1.0 if self.bordered.inverse.exact else MULTIGRID_TOLERANCE_FACTOR
        settled = iteration >= 2 and residual > 0.5 * self._before and residual <= rounding
        if residual <= tolerance or settled:
            return reasons.CONVERGED_FNORM_ABS
        if iteration >= self._most:
            return reasons.DIVERGED_MAX_IT
        if iteration == 1 or residual < MIN_DECREASE * self._least:
            self._least, self._least_at = residual, iteration
        if iteration >= self._least_at + MAX_STAGNANT_ITERATIONS:
            return reasons.DIVERGED_LOCAL_MIN
        loosest = self._loosest()
        if iteration >= 3 and residual > 1e3 * MAX_FORCING_TERM / loosest * self._first:
            return reasons.DIVERGED_DTOL
        # Eisenstat & Walker 1996 (doi 10.1137/0917003), choice 2: solve only as accurately as Newton's next step needs.
        forcing = loosest if iteration == 0 else min(loosest, (residual / self._before) ** 2)
        last = min(LAST_SOLVE_FACTOR * tolerance / residual, MAX_LAST_TOLERANCE if self._since is None else loosest)
        snes.getKSP().setTolerances(rtol=max(min(forcing, loosest), last))
        self._before = residual
        return reasons.ITERATING

    def _loosest(self) -> float:
        """Return the tolerance of the first linear solves; a tight one if a stress is predicted: the forces of what is stiff
        make up the residual, and a loose solve would reduce them only."""
        if self._since is None:
            return MAX_FORCING_TERM
        return max(MIN_FORCING_TERM, MAX_FORCING_TERM / max(1.0, self.system.potential.predicted_stiffness))


_REASONS = {
    -3: "the linear solver failed{instead}",
    -4: "the residual is not a number",
    -5: "no convergence in {most} iterations",
    -6: "the line search found no decrease of the residual",
    -8: "the residual no longer decreases",
    -9: "the residual diverged (a thousandfold increase)",
}


class NoConvergence(RuntimeError):
    """Newton's method did not converge; the message gives PETSc's reason."""


# ----------------------------------------------------------------------------------------------------------------------
# Approximate inverse of the tangent K: a factorisation, or a multigrid cycle.


class Preconditioner(abc.ABC):
    """A preconditioner near K^-1 of the K it was set up for, and a measure of its age.

    Attributes:
        exact: Whether it is K^-1 itself, so that K's inertia is available.
        rounded: Whether it is so only in single precision.
        max_solve_iterations: Iterations of the linear solver in one solve after which it is replaced at once.
        max_total_iterations: Wear after which the next state gets one of its own; see `equivalent_iterations`.
        max_newton_iterations: Iterations of Newton's method after which a shorter step costs less.
        restart, max_linear_iterations: Of the linear solver that it preconditions.
        instead: What a user can do where that solver fails with it, words after the failure; empty where nothing.
    """

    exact: ClassVar[bool]
    rounded: bool = False
    max_solve_iterations: ClassVar[int]
    max_total_iterations: ClassVar[int]
    max_newton_iterations: ClassVar[int]
    restart: ClassVar[int]
    max_linear_iterations: ClassVar[int]
    instead: ClassVar[str] = ""

    @abc.abstractmethod
    def set_up(self) -> None:
        """Set up for the current K; `MemoryError` on all ranks, if one has not enough."""

    @abc.abstractmethod
    def apply(self, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Apply it to b; put the result into x."""

    @abc.abstractmethod
    def negative_pivots(self) -> int:
        """Return the number of negative eigenvalues of its K; only for an exact inverse."""

    def equivalent_iterations(self, iterations: int, tolerance: float) -> int:
        """Return by how many iterations a solve to a relative tolerance has aged it."""
        return iterations

    def on_the_right(self, ksp: PETSc.KSP, context: object, tolerance: float, most: int) -> None:
        """Make a linear solver GMRES with a preconditioner based on this, in a PETSc ``context``, to a relative tolerance.

        What is rounded to single precision is not linear to the last digits: the flexible kind adds up its very answers.
        """
        ksp.setType("fgmres" if self.exact else "gmres")
        ksp.setGMRESRestart(self.restart)
        ksp.setPCSide(PETSc.PC.Side.RIGHT)  # type: ignore[arg-type]
        ksp.setTolerances(rtol=tolerance, atol=0.0, max_it=most)
        pc = ksp.getPC()
        pc.setType("python")
        pc.setPythonContext(context)

    @abc.abstractmethod
    def release(self) -> None:
        """Destroy the PETSc objects."""


# ----------------------------------------------------------------------------------------------------------------------
# Callbacks that do not keep their objects alive when PETSc stores them.


type Product[A] = Callable[[A, PETSc.Vec, PETSc.Vec], None]


def weakly[**P, T](method: Callable[P, T]) -> Callable[P, T]:
    """Return a function that calls a bound method without holding its object; `ReferenceError` once that is gone.

    PETSc's objects hold what they call. If that in turn holds them, the two are a cycle that Python's collector cannot see
    through PETSc, and neither memory nor MPI's communicators are ever given back.
    """
    reference = weakref.WeakMethod(method)

    def call(*arguments: P.args, **named: P.kwargs) -> T:
        bound = reference()
        if bound is None:
            raise ReferenceError("the object of this callback has been released")
        return bound(*arguments, **named)

    return call


class Shell:
    """Context of a PETSc shell matrix and shell preconditioner whose products are methods of an object that owns both."""

    def __init__(self, mult: Product[PETSc.Mat], apply: Product[PETSc.PC]):
        self.mult, self.apply = weakly(mult), weakly(apply)


# ----------------------------------------------------------------------------------------------------------------------
# Newton's linear system, bordered by the cavities' pressures, solved with one symmetric factorisation.
#
#         [ K      -q   -H ] [dw]   [ r ]   K: tangent of the body, symmetric, indefinite in the mixed form
#         [ a q^T   b    0 ] [dP] = [ c ]   q: dV/dw, the load of a unit pressure;  a, b: the control's line
#         [ H^T     0    0 ] [dm]   [ g ]   H: the same of each further cavity whose volume is held, by its pressure m
#
# Only K is factorised (LDL^T), for any control; the border is eliminated (Keller 1977; Chan 1984,
# doi 10.1137/0721019). The same factorisation serves as preconditioner of GMRES on the whole system for the Newton
# iterations that follow, and GMRES also recovers the digits that elimination loses if K is nearly singular: at a limit
# point the whole system is regular although K is not. A multigrid cycle instead of the factorisation is bordered in the
# same way, with one more right-hand side per column: it need not be near K^-1 for that.


ITERATIVE_SOLVE_TOLERANCE = 1e-10
"""Tolerance of the iterative solves that replace back-substitutions."""
COLUMN_REUSE_TOLERANCE = 5e-2
"""Relative change of the load of a unit pressure up to which K^-1 times it is reused."""
REFINEMENT_TOLERANCE, MAX_REFINEMENTS = 1e-12, 5
"""Default relative tolerance of refined single-precision back-substitutions, and the maximum number of
refinement steps."""


class Bordered:
    """PETSc contexts for the bordered matrix and its preconditioner.

    Vectors of the whole system hold the body's unknowns, then on the last rank the pressure and those of held volumes. Where K
    was factorised at an earlier state, ``product(x, y)``, which puts the current tangent times x into y (local owned arrays),
    is what makes the solution that of the present one. ``factorisations`` counts how often the inverse was set up.
    """

    def __init__(self, K: PETSc.Mat, inverse: Preconditioner, product: Callable[[Array, Array], None], constraints: int = 0):
        self.K, self.inverse, self.product, self.comm = K, inverse, product, K.comm.tompi4py()
        self.n = K.getLocalSize()[0]
        self.scalars = 1 + constraints
        self.extra = self.scalars if mpi.owns_scalars(self.comm) else 0
        self.columns = [K.createVecRight() for _ in range(self.scalars)]
        self._lifted = [K.createVecRight() for _ in range(self.scalars)]
        self._r, self._y, self._q_lifted = K.createVecRight(), K.createVecRight(), K.createVecRight()
        self.control = controls.Control(0.0, 1.0, 0.0)
        self.row: PETSc.Vec | None = None  # a force instead of q in the control's equation, if that does not involve the volume
        self.compliances = np.zeros((self.scalars, self.scalars))
        self.factorisations = 0
        self.shell = Shell(self.mult, self.apply)
        size = (self.n + self.extra, PETSc.DETERMINE)
        self.mat = PETSc.Mat().createPython((size, size), context=self.shell, comm=K.comm)
        self.mat.setUp()
        self._iterations = self.precondition(PETSc.KSP().create(K.comm), ITERATIVE_SOLVE_TOLERANCE)
        self._right, self._solution = self.vector(), self.vector()

    def precondition(self, ksp: PETSc.KSP, tolerance: float) -> PETSc.KSP:
        """Make a linear solver GMRES with the bordered inverse as preconditioner, to a relative tolerance."""
        self.inverse.on_the_right(ksp, self.shell, tolerance, self.inverse.max_linear_iterations)
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
        """Destroy the PETSc objects; see `Solver.release`."""
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
        """Return the body's part (local array, a view valid until x changes) and the pressures' (on all ranks)."""
        values = x.array_r
        return values[: self.n], mpi.scalars_from_owner(self.comm, np.array(values[self.n :]))

    def factorise(self) -> None:
        """Factorise the current K, or set up the approximate inverse; `MemoryError` on all ranks, if one lacks memory."""
        self.inverse.set_up()
        self.factorisations += 1
        self._lift(0)

    def solve(self, b: PETSc.Vec, x: PETSc.Vec, tolerance: float = REFINEMENT_TOLERANCE) -> None:
        """Solve x = K^-1 b on the motions that keep the held volumes, with the current factorisation or by iterations.

        Iterations solve with the tangent of the state that is loaded; single precision is refined to a relative tolerance.
        """
        if not self.inverse.exact:
            self.iterate(b, x, ITERATIVE_SOLVE_TOLERANCE)
            return
        pressures = self.solve_roughly(b, x)
        if self.inverse.rounded:
            self._refine(b, x, pressures, tolerance)

    def solve_roughly(self, b: PETSc.Vec, x: PETSc.Vec) -> Array:
        """Solve to the factorisation's precision only; return the pressures that keep the held volumes."""
        self.inverse.apply(b, x)
        return self.keep_volumes(x)

    def keep_volumes(self, x: PETSc.Vec) -> Array:
        """Remove from a motion x its change of the held volumes, by the motions of their pressures; return these."""
        if not self.constraint_columns:
            return np.zeros(0)
        return self._close(np.array([column.dot(x) for column in self.constraint_columns]), x)

    def _close(self, opened: Array, x: PETSc.Vec) -> Array:
        """Remove the changes of held volumes from x; return the pressures."""
        pressures: Array = -np.linalg.solve(self.compliances[1:, 1:], opened)
        for pressure, lifted in zip(pressures, self._lifted[1:], strict=True):
            x.axpy(pressure, lifted)
        return pressures

    def _refine(self, b: PETSc.Vec, x: PETSc.Vec, pressures: Array, tolerance: float) -> None:
        """Refine x by its residual on the factorised K until it converges."""
        before = assembly.length(x)
        for _ in range(MAX_REFINEMENTS):
            self.K.mult(x, self._r)
            self._r.aypx(-1.0, b)
            for pressure, column in zip(pressures, self.constraint_columns, strict=True):
                self._r.axpy(pressure, column)
            self.inverse.apply(self._r, self._y)
            if self.constraint_columns:
                opened = [column.dot(x) + column.dot(self._y) for column in self.constraint_columns]
                pressures = pressures + self._close(np.array(opened), self._y)
            x.axpy(1.0, self._y)
            size = assembly.length(self._y)
            # The error decreases by the same factor from correction to correction.
            if size * size <= tolerance * before * assembly.length(x) or size == 0.0:
                return
            before = size

    def iterate(self, b: PETSc.Vec, x: PETSc.Vec, tolerance: float) -> int:
        """Solve by iterations to a relative tolerance; return their number."""
        control, self.control = self.control, controls.pressure_control(0.0)
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
        """Return the number of negative eigenvalues of the factorised K, on the motions that keep the held volumes.

        Its negative pivots (Sylvester's law of inertia), less those that holding the volumes takes away: the negative
        eigenvalues of H^T K^-1 H (Haynsworth 1968, doi 10.1016/0024-3795(68)90050-5).
        """
        constrained = np.linalg.eigvalsh(self.compliances[1:, 1:]) if self.constraint_columns else np.empty(0)
        return self.inverse.negative_pivots() - int(np.count_nonzero(constrained < 0))

    def refresh(self) -> None:
        """Set new columns: K^-1 times each with the current factorisation, and the compliances between them.

        The first column is only part of a preconditioner: if it has hardly changed, its solution is reused.
        """
        self.q.copy(self._y)
        self._y.axpy(-1.0, self._q_lifted)
        self._lift(0 if assembly.length(self._y) > COLUMN_REUSE_TOLERANCE * assembly.length(self.q) else 1)

    def _lift(self, first: int) -> None:
        """K^-1 times the columns from the first one on, and the compliances between all."""
        for column, lifted in zip(self.columns[first:], self._lifted[first:], strict=True):
            self.inverse.apply(column, lifted)
        if first == 0:
            self.q.copy(self._q_lifted)
        self.compliances = np.array([[column.dot(lifted) for lifted in self._lifted] for column in self.columns])

    # PETSc calls these, for the matrix and the preconditioner.

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
        # Most devices have one cavity, and this is called in every iteration.
        pressures = (gaps - opened) / matrix[0] if self.scalars == 1 else np.linalg.solve(matrix, gaps - opened)
        for pressure, lifted in zip(pressures, self._lifted, strict=True):
            self._y.axpy(pressure, lifted)
        self.join(y, self._y.array_r, pressures)


# ----------------------------------------------------------------------------------------------------------------------
# The lagged factorisation of K: kept over several solves, and replaced when it has aged.


class LaggedPreconditioner:
    """Factorised K of an earlier state: preconditioner of later solves.

    Attributes:
        base: The state at which it was made; None if there is none, or it was made at an iterate.
        total_iterations: Iterations of the linear solver since.
        updates: How many states it was made for, or made ready for.
        exhausted: Whether the last solve took so many of them that it is replaced at the next one.
    """

    def __init__(self, system: System, bordered: Bordered):
        self.system, self.bordered = system, bordered
        self.base: State | None = None
        self.total_iterations, self.updates, self.exhausted = 0, 0, False

    def make(self, base: State | None) -> None:
        """Factorise the tangent of the current state, which is ``base`` or an iterate.

        What is no factorisation is set up anew only where it has aged: it knows no more of this state than of others.
        """
        outdated = self.exhausted or self.total_iterations > self.bordered.inverse.max_total_iterations
        if self.bordered.inverse.exact or outdated or not self.bordered.factorisations:
            self.system.assemble_tangent()
            self.bordered.factorise()
            self.total_iterations = 0
        else:
            self.bordered.refresh()
        self.base, self.exhausted = base, False
        self.updates += 1

    def set_columns(self) -> npt.NDArray[np.float64]:
        """Put the current state's loads into the border; each cavity's load of a unit pressure, shape (k, n)."""
        loads = self.system.pressure_loads()
        rows = [self.system.coupling.shares, *self.system.coupling.constraints]
        for column, row in zip(self.bordered.columns, rows, strict=True):
            column.array_w[:] = row @ loads
        return loads

    def count(self, ksp: PETSc.KSP) -> None:
        """Add the age from a linear solve."""
        inverse, iterations = self.bordered.inverse, ksp.getIterationNumber()
        self.total_iterations += inverse.equivalent_iterations(iterations, ksp.getTolerances()[0])
        self.exhausted = iterations > inverse.max_solve_iterations

    def solve(self, ksp: PETSc.KSP, b: PETSc.Vec, x: PETSc.Vec) -> bool:
        """Solve with a linear solver; if a multigrid cycle of an earlier state fails, set it up anew and retry once. Return
        whether it got to its tolerance."""
        ksp.solve(b, x)
        self.count(ksp)
        if not ksp.is_converged and not self.bordered.inverse.exact:
            self.invalidate()
            self.make(None)
            x.set(0.0)
            ksp.solve(b, x)
            self.count(ksp)
        return ksp.is_converged

    def invalidate(self) -> None:
        """Invalidate it, so that the next solve factorises anew."""
        self.total_iterations = self.bordered.inverse.max_total_iterations + 1

    @property
    def needs_update(self) -> bool:
        """Whether it needs an update: it has aged, or was made at an iterate instead of a converged state."""
        return self.base is None or self.total_iterations > self.bordered.inverse.max_total_iterations


RESIDUAL_TOLERANCE = 1e-9  # residual relative to the load of the cavity pressure
MIN_PRESSURE_SCALE = 1e-3  # pressures below this many shear moduli do not tighten the tolerance
STAGNATION_TOLERANCE_FACTOR = 1000.0  # tolerances below which a stagnating residual counts as rounding
ROUNDING_SAFETY_FACTOR = 10.0  # times the predicted rounding error
MIN_DECREASE, MAX_STAGNANT_ITERATIONS = 0.9, 5  # without that decrease of the least residual Newton's method has failed
MAX_FORCING_TERM = 1e-2  # of the linear solves: Newton's first steps are not more accurate anyway
LAST_SOLVE_FACTOR = 0.3  # of Newton's tolerance, left by the last linear solve
MAX_LAST_TOLERANCE = 0.1  # of that solve
MULTIGRID_TOLERANCE_FACTOR = 0.1  # of Newton's tolerance with multigrid: a factorisation is far more accurate anyway
MIN_FORCING_TERM = 1e-7  # of the same with a stiff sheet: GMRES reaches it with any recent factorisation


# ----------------------------------------------------------------------------------------------------------------------
# Factorise K by MUMPS, in single precision where that is accurate enough.
#
# Most back-substitutions precondition GMRES, which works in double precision and recovers the lost digits: they read
# half the memory and take half to two thirds of the time. Solutions with K^-1 itself are refined on K
# (`softmodels.mechanics.newton`). After each factorisation, inverse iteration estimates its error in the softest motions:
# if that is too large, near a critical point or in a very slender device, K is factorised in double precision, so that the
# inertia is right. With much stiffer regions this estimate is unreliable, and double precision is used from the start.


OUT_OF_MEMORY = (-5, -7, -8, -9, -11, -12, -13, -14, -15, -17, -18, -19, -20)
"""MUMPS' INFOG(1) if it could not allocate, or if its workspace was too small (its guide, section 8)."""

MEGA_BYTE = 1e6
ENTRY_BYTES = 16
"""Bytes of an entry and its index."""
COPIES_WHILE_DISTRIBUTED = 3
"""Copies of K while MUMPS distributes entries over ranks: PETSc's, and the send and receive buffers."""
DOUBLE_PRECISION_MEMORY_RATIO = 1.95
"""Memory of double precision relative to single precision: 1.91 on wedges and slabs of 17,502 to 88,570 unknowns."""
ERROR_ESTIMATE_STEPS = 3
"""Steps of inverse iteration towards the softest motions."""
MAX_SINGLE_PRECISION_ERROR = 3e-2
"""Maximum relative error in them for single precision. From 1 on the sign of an eigenvalue is wrong."""


class Factorisation(Preconditioner):
    """LDL^T of K, whose values may change and whose pattern may grow; ``spread`` is how many times stiffer its stiffest
    material is than its softest."""

    exact = True
    max_solve_iterations = 25
    max_total_iterations = 60
    max_newton_iterations = 15
    restart = max_linear_iterations = 60

    def __init__(self, K: PETSc.Mat, spread: float = 1.0):
        self.K, self.spread = K, spread
        self._make(_roundable(K, spread))

    def _make(self, rounded: bool) -> None:
        """Create the factorisation of K, with its current pattern, in single or double precision."""
        self.rounded, self._entries = rounded, entries_in_all(self.K)
        with _precision(rounded):
            self._direct = _mumps(self.K)

    def _factorise(self, rounded: bool) -> None:
        """Factorise the current K; `MemoryError` on all ranks, if one has not enough."""
        # Contact may have added couplings, but PETSc would keep the analysis of the old pattern.
        if self.rounded != rounded or entries_in_all(self.K) != self._entries:
            self._direct.destroy()
            self._make(rounded)
        with _precision(rounded):
            self._direct.setReusePreconditioner(False)
            self._direct.setUp()
        if int(self._direct.getFactorMatrix().getMumpsInfog(1)) in OUT_OF_MEMORY:
            raise MemoryError  # PETSc itself would continue with an invalid preconditioner
        self._direct.setReusePreconditioner(True)

    @staticmethod
    def memory(K: PETSc.Mat, spread: float = 1.0) -> tuple[float, float]:
        """Return the bytes that a factorisation of an assembled K would take on this rank, as predicted by MUMPS' analysis,
        plus PETSc's copy of K: of the precision that is tried, and of double, which a K near a critical point takes.

        Measured on wedges of 37,120, 70,113 and 181,940 unknowns, with the mass matrix and vectors, in single precision: 202,
        388 and 1,241 MB taken, 189, 372 and 1,235 MB predicted; of the last two on two ranks 570 and 1,673, and 523 and 1,621.
        """
        rounded = _roundable(K, spread)
        with _precision(rounded):
            direct = _mumps(K)
            factor = direct.getFactorMatrix()
            # One megabyte is never enough: MUMPS stops after its analysis, before it allocates.
            factor.setMumpsIcntl(23, 1)
            direct.setUp()
        copies = 1 if K.comm.size == 1 else COPIES_WHILE_DISTRIBUTED
        factors, copy = factor.getMumpsInfo(15) * MEGA_BYTE, copies * entries_here(K) / 2 * ENTRY_BYTES
        direct.destroy()
        return factors + copy, (DOUBLE_PRECISION_MEMORY_RATIO if rounded else 1.0) * factors + copy

    def set_up(self) -> None:
        # Decided for every K from K only, so that a resumed path decides the same.
        rounded = _roundable(self.K, self.spread)
        self._factorise(rounded)
        if rounded and not self._error() < MAX_SINGLE_PRECISION_ERROR:
            self._factorise(rounded=False)

    def _error(self) -> float:
        """Return the relative error of the factorisation in the softest motions."""
        b, x, r = (self.K.createVecRight() for _ in range(3))
        x.set(1.0)
        for _ in range(ERROR_ESTIMATE_STEPS):
            x.copy(b)
            b.normalize()
            self.apply(b, x)
        self.K.mult(x, r)
        r.aypx(-1.0, b)
        size = assembly.length(x)
        self.apply(r, x)
        error = assembly.length(x) / size
        for vector in (b, x, r):
            vector.destroy()
        return error

    def apply(self, b: PETSc.Vec, x: PETSc.Vec) -> None:
        self._direct.apply(b, x)

    def negative_pivots(self) -> int:
        return int(self._direct.getFactorMatrix().getMumpsInfog(12))

    def release(self) -> None:
        self._direct.destroy()


MAX_CACHED_UNKNOWNS = 6000
"""Number of unknowns up to which the factors fit into the processor's cache and single precision gains nothing."""
MAX_STIFFNESS_RATIO = 300.0
"""Maximum stiffness ratio of regions for single precision: with stiffer ones the unknowns p hide its error, and signs of
eigenvalues were wrong with sheets of 50 MPa and 1 GPa in a finger."""
OPTIONS_PREFIX = "body_"
PRECISION_OPTION = "pc_precision"
"""PETSc's option, ignored if MUMPS has no single precision."""


def entries_here(K: PETSc.Mat) -> float:
    """Return the entries of a matrix on this rank."""
    return float(K.getInfo(K.InfoType.LOCAL)["nz_used"])  # type: ignore[arg-type]


def entries_in_all(K: PETSc.Mat) -> float:
    """Return the entries of a matrix on all ranks."""
    return float(K.getInfo()["nz_used"])


def _roundable(K: PETSc.Mat, spread: float) -> bool:
    return K.getSize()[0] > MAX_CACHED_UNKNOWNS and spread < MAX_STIFFNESS_RATIO


@contextlib.contextmanager
def _precision(rounded: bool) -> Iterator[None]:
    """Make PETSc factorise in single precision, unless its options set the precision."""
    options = PETSc.Options(OPTIONS_PREFIX)
    if not rounded or options.hasName(PRECISION_OPTION):
        yield
        return
    options.setValue(PRECISION_OPTION, "single")
    try:
        yield
    finally:
        options.delValue(PRECISION_OPTION)


def _mumps(K: PETSc.Mat) -> PETSc.PC:
    """Return PETSc's LDL^T by MUMPS, not yet set up."""
    direct = PETSc.PC().create(K.comm)
    direct.setOptionsPrefix(OPTIONS_PREFIX)
    direct.setOperators(K, K)
    direct.setType("cholesky")
    direct.setFactorSolverType("mumps")
    direct.setFactorSetUpSolverType()
    factor = direct.getFactorMatrix()
    factor.setOptionsPrefix(OPTIONS_PREFIX)  # PETSc does so only when it factorises, after it has read the precision
    factor.setMumpsIcntl(13, 1)  # the last front too counts its negative pivots, on all ranks
    direct.setFromOptions()
    return direct
