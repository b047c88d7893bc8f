"""Equilibrium of a pressurised body: one solver for every control, and the linear answers around its states."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import numpy.typing as npt

from softmodels.materials.laws import Material
from softmodels.mechanics.body import Body
from softmodels.mechanics.bordered import Bordered
from softmodels.mechanics.callbacks import weakly
from softmodels.mechanics.contact import Obstacle
from softmodels.mechanics.controls import Control, Curve, pressure_control
from softmodels.mechanics.coupling import Coupling
from softmodels.mechanics.mpi import total
from softmodels.mechanics.sheet import Sheet
from softmodels.mechanics.system import Discrete, State

TOLERANCE = 1e-9  # residual against the load of the cavity pressure
FLOOR = 1e-3  # pressures below this many shear moduli do not make the tolerance any finer
ROUNDING = 1000.0  # tolerances at which a residual that falls no further is taken for rounding
MOST_ITERATIONS = 15
LOOSEST = 1e-2  # of the linear solves: Newton's first steps are no better than that anyway
TIGHTEST = 1e-7  # of the same with a stiff sheet: GMRES gets there with any factorisation that is not worn
TANGENT_TOLERANCE = 1e-5
MOST_ITERATIONS_OF_A_SOLVE = 25
"""GMRES iterations in one solve after which the kept factorisation is replaced at once."""
MOST_ITERATIONS_OF_A_FACTORISATION = 60
"""GMRES iterations in all after which the next state gets a factorisation of its own."""


class NoConvergence(RuntimeError):
    """Newton's method found no state; the message says how it ended."""


@dataclasses.dataclass(frozen=True, eq=False)
class Tangent:
    """Direction of the path at a state: changes of w (shape as `State.w`), P and V; P rises where V does and dP > 0.

    The compliance dV/dP is infinite at a limit point and negative past it.
    """

    w: npt.NDArray[np.float64]
    P: float
    V: float

    @property
    def compliance(self) -> float:
        return self.V / self.P if self.P else math.inf

    def __neg__(self) -> Tangent:
        return Tangent(-self.w, -self.P, -self.V)


class Equilibrium(Discrete):
    """A body of one material, to be solved for; see `Discrete` for what it is made of.

    Attributes:
        base: The state at which the kept factorisation was made; None if there is none, or it was made at an iterate.
        age: Iterations of the linear solver since.
        worn: Whether the last solve took so many of them that the factorisation is replaced at the next one.
    """

    def __init__(
        self,
        body: Body,
        material: Material,
        formulation: str = "mixed",
        sheet: Sheet | None = None,
        obstacle: Obstacle | None = None,
    ):
        super().__init__(body, material, formulation, sheet, obstacle)
        self.base: State | None = None
        self.worn = False
        self._iterate = np.empty(0)
        self._since: npt.NDArray[np.float64] | None = None
        self.bordered = Bordered(self.K, weakly(self._multiply))
        self.snes: Any = None
        self.anchor: Any = None
        self._make_solver()

    def _set_iterate(self, x: Any) -> npt.NDArray[np.float64]:
        body, scalars = self.bordered.split(x)
        self.w.x.array[: self.n] = body
        self.w.x.scatter_forward()
        self._set_pressures(float(scalars[0]), scalars[1:])
        return scalars

    def couple(self, coupling: Coupling, state: State, pressures: npt.NDArray[np.float64]) -> State:
        """Couple the cavities in another way from a state on.

        Args:
            coupling: The new coupling.
            state: The state; its pressures are not read.
            pressures: Those of the cavities there, shape (k,).

        Returns:
            The same state in the new coupling, with P = 0.
        """
        constraints = len(self.coupling.constraints)
        self.coupling = coupling
        if len(coupling.constraints) != constraints:
            self._drop_solver()
            self.bordered = Bordered(self.K, weakly(self._multiply), len(coupling.constraints))
            self._make_solver()
        start = State(np.concatenate([state.w[: self.dofs], coupling.multipliers(pressures)]), 0.0, 0.0)
        self.load(start)
        return dataclasses.replace(start, V=self.volume())

    def _residual(self, snes: Any, x: Any, f: Any) -> None:
        P = float(self._set_iterate(x)[0])
        loads, coupling, control = self._set_columns(), self.coupling, self.control
        inner = self._assemble(self._inner)
        volumes = self.volumes() if control.needs_volume or len(coupling.constraints) else np.zeros(len(loads))
        measured = float(coupling.shares @ volumes) if self.anchor is None else self._along()
        gap = control.weight * (control.value(measured, P) - control.target)
        self.bordered.control = control.line(measured, P)  # Newton's matrix at this iterate has the control's tangent
        self.bordered.join(
            f, inner - self.pressures @ loads, [gap, *(coupling.constraints @ volumes - coupling.constrained_volumes)]
        )
        self._load_size = float(np.abs(self.pressures) @ self._norms(loads))

    def _set_columns(self) -> npt.NDArray[np.float64]:
        """Put the current state's loads in the system's border; each cavity's load of a unit pressure, shape (k, n)."""
        loads = np.array([self._assemble([load]).copy() for load in self._loads])
        rows = [self.coupling.shares, *self.coupling.constraints]
        for column, row in zip(self.bordered.columns, rows, strict=True):
            column.array_w[:] = row @ loads
        return loads

    def _norms(self, loads: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        return np.sqrt([total(self.comm, float(load @ load)) for load in loads])

    def _along(self) -> float:
        """How far the current state has gone from the anchor along its force."""
        self._y.array_w[:] = self.w.x.array[: self.n] - self.anchor[: self.n]
        return float(self.bordered.row.dot(self._y))

    def solve_along(
        self, force: Any, anchor: npt.NDArray[np.float64], amount: float, w: npt.NDArray[np.float64], P: float
    ) -> State:
        """Find the state with ``force . (w - anchor) = amount`` at whatever pressure, starting from the guess (w, P).

        Args:
            force: PETSc vector of the body's unknowns.
            anchor: Dofs from which the amount is counted, shape as `State.w`.
            amount: What the equation asks for; takes the volume's place in a control.

        Raises:
            NoConvergence: Newton's method did not get there.
        """
        self.bordered.row, self.anchor = force, anchor
        try:
            return self.solve(Control(1.0, 0.0, amount), w, P)
        finally:
            self.bordered.row = self.anchor = None

    def _jacobian(self, snes: Any, x: Any, J: Any, P: Any) -> None:
        self._set_iterate(x)
        self._foresee_stress()
        if self.bordered.factorisations == 0 or self.worn:
            self._assemble_tangent()
            self.bordered.factorise()
            self.age, self.base, self.worn = 0, None, False
        else:
            self.bordered.refresh()
        J.assemble()

    def _foresee_stress(self) -> None:
        """Set the stress of a sheet in Newton's matrix: this iterate's own, or with `solve`'s ``since`` the foreseen one."""
        if self.sheet is None:
            return
        here = self.w.x.array.copy()
        if self._since is None:
            self.foresee(here)
        elif self.snes.getIterationNumber():
            self.foresee(self._iterate)
        else:
            self._known.x.array[:] = self._since[: self.dofs]
            self._move.x.array[:] = 0.0
        self._iterate = here

    def _make_solver(self) -> None:
        from petsc4py import PETSc

        self.age, self.base, self.worn = 0, None, False
        self._first = self._before = math.inf
        self._x, self._f, self._y = self.bordered.vector(), self.bordered.vector(), self.K.createVecRight()
        snes = self.snes = PETSc.SNES().create(self.comm)
        snes.setType("newtonls")
        snes.setFunction(weakly(self._residual), self._f)
        snes.setJacobian(weakly(self._jacobian), self.bordered.mat)
        snes.getLineSearch().setType("basic")
        snes.setLineSearchPreCheck(weakly(self._guard))
        snes.setConvergenceTest(weakly(self._converged))
        snes.setMaxLinearSolveFailures(3)
        # Questions aside of the path have a solver of their own: its iterations do not count as the path's.
        self._side = PETSc.KSP().create(self.comm)
        solvers: list[tuple[Any, float]] = [(snes.getKSP(), LOOSEST), (self._side, TANGENT_TOLERANCE)]
        for ksp, tolerance in solvers:
            ksp.setType("gmres")
            ksp.setGMRESRestart(60)
            ksp.setPCSide(PETSc.PC.Side.RIGHT)
            ksp.setTolerances(rtol=tolerance, atol=0.0, max_it=60)
            pc = ksp.getPC()
            pc.setType("python")
            pc.setPythonContext(self.bordered.shell)
        snes.setFromOptions()

    def _guard(self, x: Any, y: Any) -> bool:
        """Shorten Newton's step y (the next iterate is x - y) until no integration point turns inside out."""
        self._count(self.snes.getKSP())
        self._set_iterate(x)
        least = 0.1 * self.smallest_J()
        trial, factor = x.duplicate(), 1.0
        for _ in range(8):
            x.copy(trial)
            trial.axpy(-factor, y)
            self._set_iterate(trial)
            if self.smallest_J() > least:
                break
            factor /= 2
        y.scale(factor)
        return factor < 1.0

    def _converged(self, snes: Any, iteration: int, norms: tuple[float, float, float]) -> Any:
        from petsc4py import PETSc

        reasons: Any = PETSc.SNES.ConvergedReason
        _, _, residual = norms
        if not math.isfinite(residual):
            return reasons.DIVERGED_FNORM_NAN
        if iteration == 0:
            self._first = residual
        tolerance = TOLERANCE * max(self._load_size, FLOOR * self.bordered.q.norm())
        # Forces in a thin wall cancel to a part in 1e9 of themselves; what rounding leaves of them Newton cannot mend.
        settled = iteration >= 2 and residual > 0.5 * self._before and residual <= ROUNDING * tolerance
        if residual <= tolerance or settled:
            return reasons.CONVERGED_FNORM_ABS
        if iteration >= MOST_ITERATIONS:
            return reasons.DIVERGED_MAX_IT
        if iteration >= 3 and residual > 1e3 * LOOSEST / self._loosest() * self._first:
            return reasons.DIVERGED_DTOL
        # Eisenstat & Walker 1996 (doi 10.1137/0917003), choice 2: solve as well as Newton's next step can make use of.
        loosest = self._loosest()
        forcing = loosest if iteration == 0 else min(loosest, (residual / self._before) ** 2)
        snes.getKSP().setTolerances(rtol=min(max(forcing, 0.3 * tolerance / residual), loosest))
        self._before = residual
        return reasons.ITERATING

    def _loosest(self) -> float:
        """Tolerance of the first linear solves; a tight one where a sheet's stress is foreseen.

        The forces of a stiff sheet make up the residual: a loose solve would see to them and leave the silicone as it is.
        """
        if self.sheet is None or self._since is None:
            return LOOSEST
        return max(TIGHTEST, LOOSEST / max(1.0, float(self._stiffness.value)))

    def solve(
        self, control: Curve, w: npt.NDArray[np.float64], P: float, since: npt.NDArray[np.float64] | None = None
    ) -> State:
        """Find the state on the control's curve, starting from the guess (w, P).

        Args:
            control: The curve.
            w: Guess of the dofs, shape as `State.w`.
            P: Guess of the pressure.
            since: If given, a sheet's stress in Newton's matrix is the foreseen one (`Discrete.foresee`), at first that of
                this state's dofs.

        Raises:
            NoConvergence: Newton's method did not get there. The functions hold its last iterate.
        """
        self.control, self._since = control, since
        self.bordered.join(self._x, w[: self.n], [P, *w[self.dofs :]])
        self.snes.solve(None, self._x)
        reason = self.snes.getConvergedReason()
        if reason <= 0:
            self.age = MOST_ITERATIONS_OF_A_FACTORISATION + 1  # what led here is no preconditioner to go on with
            raise NoConvergence(_REASONS.get(reason, f"PETSc's reason {reason}"))
        scalars = self._set_iterate(self._x)
        w = np.concatenate([self.w.x.array, scalars[1:]])
        return State(w, float(scalars[0]), self.volume(), self.snes.getIterationNumber())

    def factorise(self, state: State) -> None:
        """Factorise the tangent at ``state``, to be kept for the solves that follow; it becomes their ``base``."""
        self.load(state)
        self._set_columns()
        self._assemble_tangent()
        self.bordered.factorise()
        self.age, self.base, self.worn = 0, state, False

    def _count(self, ksp: Any) -> None:
        """How much older a linear solve has made the kept factorisation."""
        self.age += ksp.getIterationNumber()
        self.worn = ksp.getIterationNumber() > MOST_ITERATIONS_OF_A_SOLVE

    @property
    def stale(self) -> bool:
        """Whether a new factorisation is due: the kept one has aged, or was made at an iterate and not at a state."""
        return self.base is None or self.age > MOST_ITERATIONS_OF_A_FACTORISATION

    def tangent(self, state: State, control: Control, tolerance: float = TANGENT_TOLERANCE) -> Tangent:
        """Direction of the path at a state, scaled to one unit of the control's line, to a relative tolerance.

        Raises:
            NoConvergence: The linear solver did not get there (the line runs along the path, say).
        """
        self._border(state, control)
        return self.linear_response(0.0, 1.0, tolerance)

    def _border(self, state: State, control: Control) -> None:
        """Set the system's border for linear answers at a state, the control's line held."""
        self.load(state)
        self._set_columns()
        self.bordered.control = control
        self.bordered.refresh()

    def linear_response(self, force: Any, gap: float, tolerance: float) -> Tangent:
        """Answer of the current state, linearised, to a ``force`` on the body and a ``gap`` of the control's line.

        `tangent` has to have been called at this state: it sets the border of the system.

        Args:
            force: Owned entries, shape (n,), zero at held dofs; or 0.
            gap: Change of the line's left side.
            tolerance: Of the linear solver, relative.

        Raises:
            NoConvergence: The linear solver did not get there.
        """
        bordered, ksp = self.bordered, self.snes.getKSP()
        rhs, x = self._f, self._x
        bordered.join(rhs, force, [gap, *np.zeros(len(bordered.constraint_columns))])
        bordered.mat.assemble()
        ksp.setOperators(bordered.mat)
        ksp.setTolerances(rtol=tolerance)
        ksp.solve(rhs, x)
        self._count(ksp)
        if ksp.getConvergedReason() <= 0:
            raise NoConvergence("the linear solver failed on the state's linear response")
        body, pressures = bordered.split(x)
        direction = self._direction.x
        direction.array[: self.n] = body
        direction.scatter_forward()
        self._y.array_w[:] = body
        w = np.concatenate([direction.array, pressures[1:]])
        return Tangent(w, float(pressures[0]), bordered.q.dot(self._y))

    def dead_load_compliance(self, state: State, load: npt.NDArray[np.float64]) -> float:
        """Work of a dead load (owned entries, shape (n,)) on the motion it causes at a state, the cavity pressure kept.

        One more back-substitution with the factorisation at hand and a few iterations; infinite where the tangent has no
        solution.
        """
        self.load(state)
        bordered, rhs, x = self.bordered, self._f, self._x
        ksp: Any = self._side
        bordered.control = pressure_control(0.0)
        bordered.join(rhs, load, np.zeros(bordered.scalars))
        bordered.mat.assemble()
        ksp.setOperators(bordered.mat)
        ksp.solve(rhs, x)
        if ksp.getConvergedReason() <= 0:
            return math.inf
        return total(self.comm, float(load @ bordered.split(x)[0]))

    def inverse_tangent(
        self, state: State, force: npt.NDArray[np.float64], tolerance: float
    ) -> npt.NDArray[np.float64]:
        """K^-1 ``force`` at a state and a given pressure (local owned arrays), to a relative tolerance.

        Raises:
            NoConvergence: The linear solver did not get there.
        """
        self._border(state, pressure_control(state.P))
        return self.linear_response(force, 0.0, tolerance).w[: self.n]

    def release(self) -> None:
        """Give back what PETSc and MPI hold for this device; it cannot be solved any more.

        What is merely dropped is given back too on one rank; on several, PETSc waits until all ranks agree, so long-lived
        processes call this.
        """
        self._drop_solver()
        self.K.destroy()

    def _drop_solver(self) -> None:
        self.snes.destroy()
        self._side.destroy()
        self.bordered.release()
        for thing in (self._x, self._f, self._y):
            thing.destroy()


_REASONS = {
    -3: "the linear solver failed",
    -4: "the residual is not a number",
    -5: f"no convergence in {MOST_ITERATIONS} iterations",
    -9: "the residual grew a thousandfold",
}
