"""Newton's method on the bordered equations: PETSc's SNES with what it is to call."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from softmodels.mechanics.bordered import Bordered
from softmodels.mechanics.callbacks import weakly
from softmodels.mechanics.controls import Control, Curve
from softmodels.mechanics.kept_factorisation import KeptFactorisation
from softmodels.mechanics.mpi import total
from softmodels.mechanics.stiffest import rounding_of_stress
from softmodels.mechanics.system import System

if TYPE_CHECKING:
    from petsc4py import PETSc

Array = npt.NDArray[np.float64]

TOLERANCE = 1e-9  # residual against the load of the cavity pressure
FLOOR = 1e-3  # pressures below this many shear moduli do not make the tolerance any finer
ROUNDING = 1000.0  # tolerances at which a residual that falls no further is taken for rounding
SAFE = 10.0  # times what rounding is foretold to leave
LOOSEST = 1e-2  # of the linear solves: Newton's first steps are no better than that anyway
ENOUGH, LAST = 0.3, 0.1  # of Newton's tolerance, left by them; and their tolerance at most where that is enough
CLOSER = 0.1  # of Newton's tolerance where a cycle of multigrid solves: a factorisation leaves far less than asked for anyway
TIGHTEST = 1e-7  # of the same with a stiff sheet: GMRES gets there with any factorisation that is not worn


class NoConvergence(RuntimeError):
    """Newton's method found no state; the message says how it ended."""


class Newton:
    """Newton's method for a system on a control's curve.

    Args:
        system: The equations; its functions hold the iterate.
        bordered: The linear system.
        kept: The factorisation that preconditions it.

    Attributes:
        snes: PETSc's solver, with the options that the user has given it.
        x: Its vector of unknowns, ``f`` its residual.
    """

    def __init__(self, system: System, bordered: Bordered, kept: KeptFactorisation):
        from petsc4py import PETSc

        self.system, self.bordered, self.kept = system, bordered, kept
        self._first = self._before = math.inf
        self._of_stress, self._round = 0.0, rounding_of_stress(system)
        self._iterate = np.empty(0)
        self._most = bordered.inverse.most_newton
        self._smallest: float | None = None  # volume ratio of the iterate, where it was a trial
        self._since: Array | None = None
        self._anchor: Array | None = None
        self._force: PETSc.Vec | None = None  # whose path from the anchor on is given
        self.control: Curve = Control(0.0, 1.0, 0.0)
        self.x, self.f, self._y = bordered.vector(), bordered.vector(), system.K.createVecRight()
        snes = self.snes = PETSc.SNES().create(system.comm)
        snes.setType("newtonls")
        snes.setFunction(weakly(self._residual), self.f)
        snes.setJacobian(weakly(self._jacobian), bordered.mat)
        # Where friction turns round, a whole step goes from sliding one way to sliding the other, and back again.
        snes.getLineSearch().setType("bt" if system.assembled.remembers else "basic")
        snes.setTolerances(stol=0.0)  # a short step is no state of equilibrium
        snes.setLineSearchPreCheck(weakly(self._guard))
        snes.setConvergenceTest(weakly(self._converged))
        snes.setMaxLinearSolveFailures(3)

    def release(self) -> None:
        """Destroy what PETSc holds; see `Solver.release`."""
        for thing in (self.snes, self.x, self.f, self._y):
            thing.destroy()

    def solve(self, control: Curve, w: Array, P: float, since: Array | None = None, most: int | None = None) -> Array:
        """Solve on a control's curve from a guess; see `Solver.solve`. Returns P and the multipliers.

        Raises:
            NoConvergence: Newton's method did not get there. The functions hold its last iterate.
        """
        from petsc4py import PETSc

        self.control, self._since = control, since
        self._smallest = None
        self._most = most or self.bordered.inverse.most_newton
        self.bordered.join(self.x, self.system.unknowns.begin(w), [P, *w[self.system.dofs :]])
        self.system.assembled.whole = True
        try:
            self.snes.solve(None, self.x)
        finally:
            self.system.assembled.whole = False
        PETSc.garbage_cleanup(self.system.comm)  # vectors that were dropped since: several ranks have to agree on them
        reason: Any = self.snes.getConvergedReason()  # an int, whatever its stub has
        if reason <= 0:
            self.kept.spoil()
            why = _REASONS.get(reason, f"PETSc's reason {reason}")
            raise NoConvergence(why.format(most=self._most, instead=self.bordered.inverse.instead))
        return self._take_iterate(self.x)

    def solve_along(self, force: PETSc.Vec, anchor: Array, amount: float, w: Array, P: float) -> Array:
        """The same where ``force . (w - anchor)`` is given; see `Solver.solve_along`."""
        self.bordered.row, self._force, self._anchor = force.copy(), force, anchor
        try:
            return self.solve(Control(1.0, 0.0, amount), w, P)
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
        loads = self.kept.set_columns()
        inner = system.internal_forces()
        volumes = system.driven() if control.needs_volume or len(coupling.constraints) else np.zeros(len(loads))
        measured = float(coupling.shares @ volumes) if self._anchor is None else self._along()
        gap = control.weight * (control.value(measured, P) - control.target)
        self.bordered.control = control.line(measured, P)  # Newton's matrix at this iterate has the control's tangent
        gaps = [gap, *(coupling.constraints @ volumes - coupling.constrained_volumes)]
        self.bordered.join(f, inner - system.pressures @ loads, gaps)
        norms = np.sqrt([total(system.comm, float(load @ load)) for load in loads])
        self._load_size = float(np.abs(system.pressures) @ norms)
        self._of_stress = float(norms[: len(norms) - len(system.dead.forms)].max(initial=0.0))

    def _along(self) -> float:
        """How far the current state has gone from the anchor along its force."""
        assert self._anchor is not None
        n, row = self.system.n, self.bordered.row
        assert row is not None and self._force is not None
        self._y.array_w[:] = self.system.w.x.array[:n] - self._anchor[:n]
        self._force.copy(row)
        self.system.unknowns.pull(row.array_w)
        return float(self._force.dot(self._y))

    def _jacobian(self, snes: PETSc.SNES, x: PETSc.Vec, J: PETSc.Mat, P: PETSc.Mat) -> None:
        self._take_iterate(x)
        self._foresee_stress()
        if self.bordered.factorisations == 0 or self.kept.worn:
            self.kept.make(None)
        else:
            self.bordered.refresh()
        J.assemble()

    def _foresee_stress(self) -> None:
        """Set the stress of sheets and fibres in Newton's matrix: the iterate's, or with `solve`'s ``since`` a foreseen one."""
        if not self.system.potential.foreseen:
            return
        here = self.system.w.x.array.copy()
        if self._since is None:
            self.system.potential.foresee(here)
        elif self.snes.getIterationNumber():
            self.system.potential.foresee(self._iterate)
        else:
            self.system.potential.foresee(self._since, ahead=False)
        self._iterate = here

    def _guard(self, x: PETSc.Vec, y: PETSc.Vec) -> bool:
        """Shorten Newton's step y (the next iterate is x - y) until nothing turns inside out or passes through a wall."""
        self.kept.count(self.snes.getKSP())
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
            if self._smallest > least and system.potential.admits(before, system.w.x.array):
                break
            factor /= 2
        else:
            self._smallest = None  # the step that is taken is shorter than the last trial
        y.scale(factor)
        return factor < 1.0

    def _converged(self, snes: PETSc.SNES, iteration: int, norms: tuple[float, float, float]) -> int:
        from petsc4py import PETSc

        reasons: Any = PETSc.SNES.ConvergedReason
        _, _, residual = norms
        if not math.isfinite(residual):
            return reasons.DIVERGED_FNORM_NAN
        if iteration == 0:
            self._first = residual
        unit_load: Any = self.bordered.q.norm()
        tolerance = TOLERANCE * max(self._load_size, FLOOR * unit_load)
        # Forces in a thin wall cancel to a part in 1e9 of themselves; what rounding leaves of them Newton cannot mend, nor what
        # it leaves of a stiff region's, which a small weight is far below.
        rounding = max(
            ROUNDING * max(tolerance, TOLERANCE * FLOOR * self._of_stress), SAFE * self._round * self._of_stress
        )
        tolerance *= 1.0 if self.bordered.inverse.exact else CLOSER
        settled = iteration >= 2 and residual > 0.5 * self._before and residual <= rounding
        if residual <= tolerance or settled:
            return reasons.CONVERGED_FNORM_ABS
        if iteration >= self._most:
            return reasons.DIVERGED_MAX_IT
        loosest = self._loosest()
        if iteration >= 3 and residual > 1e3 * LOOSEST / loosest * self._first:
            return reasons.DIVERGED_DTOL
        # Eisenstat & Walker 1996 (doi 10.1137/0917003), choice 2: solve as well as Newton's next step can make use of.
        forcing = loosest if iteration == 0 else min(loosest, (residual / self._before) ** 2)
        last = min(ENOUGH * tolerance / residual, LAST if self._since is None else loosest)
        snes.getKSP().setTolerances(rtol=max(min(forcing, loosest), last))
        self._before = residual
        return reasons.ITERATING

    def _loosest(self) -> float:
        """Tolerance of the first linear solves; a tight one where a stress is foreseen.

        The forces of what is stiff make up the residual: a loose solve would see to them and leave the silicone as it is.
        """
        if self._since is None:
            return LOOSEST
        return max(TIGHTEST, LOOSEST / max(1.0, self.system.potential.foreseen))


_REASONS = {
    -3: "the linear solver failed{instead}",
    -4: "the residual is not a number",
    -5: "no convergence in {most} iterations",
    -6: "no step made the residual smaller",
    -9: "the residual grew a thousandfold",
}
