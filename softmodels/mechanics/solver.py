"""Equilibrium of a pressurised body: one solver for every control, and linear responses around its states."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Protocol

import numpy as np

from softmodels.common import errors
from softmodels.common.arrays import Array
from softmodels.common.lazy import PETSc
from softmodels.mechanics import component, controls, mpi
from softmodels.mechanics.controls import Control
from softmodels.mechanics.newton import (
    MAX_FORCING_TERM,
    Bordered,
    Factorisation,
    LaggedPreconditioner,
    Newton,
    NoConvergence,
    Preconditioner,
    entries_here,
    weakly,
)
from softmodels.mechanics.system import State, System, spread

if TYPE_CHECKING:
    from softmodels.mechanics.iterative import Multigrid


MAX_LAGGED_UPDATES = 30
"""Solves of one state, until what each of them takes as given is that state's; see `Potential.update_lagged`."""
TANGENT_TOLERANCE = 1e-7
"""Tolerance of the linear solver for a path's tangent, which affects the step length: at 1e-5 single-precision rounding
shows."""
ENERGY_TOLERANCE, MULTIGRID_ENERGY_TOLERANCE = 1e-4, 1e-5
"""The same for the work of a solution on its own load: its error is the square of that with a factorisation, and a
hundred times the square with multigrid, whose residual is less informative."""


class Solver:
    """Solves a system for its equilibrium states.

    Args:
        system: The discrete equations. Its functions hold the state that was solved for or asked about last.
        method: One of `METHODS`, how its linear systems are solved.

    Attributes:
        method: The method that was taken.
        bordered: The linear system of Newton's method.
        lagged: The factorisation that is kept over several solves.
        carried: Derivatives of the states that a path accepts, from each to the next; None for none.
    """

    def __init__(self, system: System, method: str = "auto"):
        self.system, self.method = system, select_solver(system, method)
        self.carried: Carried | None = None
        self._make()

    def _make(self) -> None:
        system = self.system
        constraints = len(system.coupling.constraints)
        self.bordered = Bordered(system.K, self.method.inverse(system), weakly(system.tangent_product), constraints)
        self.lagged = LaggedPreconditioner(system, self.bordered)
        self.newton = Newton(system, self.bordered, self.lagged)
        self.bordered.precondition(self.newton.snes.getKSP(), MAX_FORCING_TERM)
        self.newton.snes.setFromOptions()
        self._y = system.K.createVecRight()

    def couple(self, coupling: controls.Coupling, state: State, pressures: Array) -> State:
        """Change the coupling of the cavities at a state with these pressures, shape (k,); return the same state in the new
        coupling, with P = 0."""
        system = self.system
        constraints = len(system.coupling.constraints)
        system.coupling = coupling
        if len(coupling.constraints) != constraints:
            self._drop()
            self._make()
        start = State(np.concatenate([state.w[: system.dofs], coupling.multipliers(pressures)]), 0.0, 0.0)
        system.load(start)
        return dataclasses.replace(start, V=system.volume())

    # -- states -------------------------------------------------------------------------------------------------------

    def solve(self, control: controls.Curve, w: Array, P: float, since: Array | None = None, most: int | None = None) -> State:
        """Find the state on the control's curve from the guess (w, P), w of the shape of `State.w`, by at most ``most``
        iterations.

        With ``since``, stress in Newton's matrix is predicted (`Potential.predict_stress`), at first that of these dofs.

        Raises:
            NoConvergence: Newton's method did not get there. The functions hold its last iterate.
        """
        state = self._state(self.newton.solve(control, w, P, since, most))
        for _ in range(MAX_LAGGED_UPDATES):
            if not self.system.potential.update_lagged(state.w):
                return state
            again = self._state(self.newton.solve(control, state.w, state.P, since, most))
            state = dataclasses.replace(again, iterations=state.iterations)  # which say how long a step may be
        raise NoConvergence("the pressure on the sealing faces did not settle")

    def solve_along(self, force: PETSc.Vec, anchor: Array, amount: float, w: Array, P: float) -> State:
        """Find the state with ``force . (w - anchor) = amount`` at whatever pressure, from the guess (w, P); see `solve`.

        The force is a PETSc vector of the body's owned dofs; the equation takes the volume's place in a control.
        """
        return self._state(self.newton.solve_along(force, anchor, amount, w, P))

    def _state(self, scalars: Array) -> State:
        w = np.concatenate([self.system.w.x.array, scalars[1:]])
        return State(w, float(scalars[0]), self.system.volume(), self.newton.snes.getIterationNumber())

    def factorise(self, state: State) -> None:
        """Factorise the tangent at ``state``, to be kept for the solves that follow; it becomes their base."""
        self.system.load(state)
        self.lagged.set_columns()
        self.lagged.make(state)

    # -- linear responses ----------------------------------------------------------------------------------------------

    def tangent(
        self,
        state: State,
        control: Control,
        tolerance: float = TANGENT_TOLERANCE,
        guess: controls.Tangent | None = None,
    ) -> controls.Tangent:
        """Return the direction of the path at a state, scaled to one unit of the control's line, to a relative tolerance.

        Raises:
            NoConvergence: The linear solver did not get there (the line runs along the path, say).
        """
        self._border(state, control)
        return self.linear_response(0.0, 1.0, tolerance, guess)

    def tangent_along(self, state: State, force: PETSc.Vec, tolerance: float = TANGENT_TOLERANCE) -> controls.Tangent:
        """Return the same scaled to ``force . dw = 1``, as `solve_along` goes: regular even if pressure and volume both turn
        back."""
        row = force.copy()
        self.system.load(state)
        self.system.unknowns.restrict(row.array_w)
        self.bordered.row = row
        try:
            return self.tangent(state, Control(1.0, 0.0, 0.0), tolerance)
        finally:
            self.bordered.row = None

    def _border(self, state: State, control: Control) -> None:
        """Set the border for linear responses at a state, on the control's line."""
        self.system.load(state)
        self.lagged.set_columns()
        self.bordered.control = control
        if self.bordered.factorisations == 0:  # the guess was the state: Newton's method took no step
            self.lagged.make(state)
        self.bordered.refresh()

    def linear_response(
        self, force: Array | float, gap: float, tolerance: float, guess: controls.Tangent | None = None
    ) -> controls.Tangent:
        """Answer of the current state, linearised, to a ``force`` on the body and a ``gap`` of the control's line.

        `tangent` has to have been called at this state: it sets the border.

        Args:
            force: Owned entries, shape (n,), zero at held dofs; or 0.
            gap: Change of the line's left side.
            tolerance: Of the linear solver, relative to the force and the gap.
            guess: Of the answer; its V is not read.
        """
        if guess is not None:
            body = self.system.unknowns.project(guess.w)
            self.bordered.join(self.newton.x, body, [guess.P, *guess.w[self.system.dofs :]])
        constraints = np.zeros(len(self.bordered.constraint_columns))
        self._solve(force, [gap, *constraints], tolerance, self.lagged.solve, guess is not None)
        return self._answer()

    def _solve(
        self,
        force: Array | float,
        gaps: Sequence[float] | Array,
        tolerance: float,
        by: Callable[[PETSc.KSP, PETSc.Vec, PETSc.Vec], object] = lambda ksp, b, x: ksp.solve(b, x),
        guessed: bool = False,
    ) -> None:
        """Solve the bordered equations for a force and gaps to a relative tolerance; ``by`` calls the linear solver, whose
        iterations otherwise do not count as the path's. `NoConvergence` if it did not get there."""
        bordered, newton, ksp = self.bordered, self.newton, self.newton.snes.getKSP()
        bordered.join(newton.f, force, gaps)
        bordered.mat.assemble()
        ksp.setOperators(bordered.mat)
        ksp.setTolerances(rtol=tolerance)
        ksp.setInitialGuessNonzero(guessed)
        by(ksp, newton.f, newton.x)
        ksp.setInitialGuessNonzero(False)
        if not ksp.is_converged:
            raise NoConvergence(f"the linear solver failed on a linear response{bordered.inverse.instead}")

    def _answer(self) -> controls.Tangent:
        bordered = self.bordered
        body, pressures = bordered.split(self.newton.x)
        direction = self.system.potential.direction.x
        self.system.unknowns.to_dofs(body, direction.array)
        direction.scatter_forward()
        self._y.array_w[:] = body
        w = np.concatenate([direction.array, pressures[1:]])
        return controls.Tangent(w, float(pressures[0]), bordered.q.dot(self._y))

    def aside(self, state: State, control: Control, force: Array, tolerance: float, gap: float = 0.0) -> controls.Tangent:
        """Return the response of a state to a ``force`` on the body (owned entries, shape (n,)) and a ``gap`` of a control's
        line; see `linear_response`. It does not count as the path's."""
        self._border(state, control)
        self._solve(force, [gap, *np.zeros(self.bordered.scalars - 1)], tolerance)
        return self._answer()

    def dead_load_compliance(self, state: State, load: Array) -> float:
        """Return the work of a dead load (entries of owned dofs, shape (n,)) on the motion it causes at constant cavity
        pressure, to 1e-8; infinite where the tangent has no solution."""
        self.system.load(state)
        bordered, newton = self.bordered, self.newton
        bordered.control = controls.pressure_control(0.0)
        if bordered.constraint_columns:  # for the held volumes, because the border may belong to another state
            self._border(state, bordered.control)
        pulled = self.system.by_unknowns(load).copy()
        try:
            tolerance = ENERGY_TOLERANCE if bordered.inverse.exact else MULTIGRID_ENERGY_TOLERANCE
            self._solve(pulled, np.zeros(bordered.scalars), tolerance)
        except NoConvergence:
            return math.inf
        moved, pressures = bordered.split(newton.x)
        # Twice the load's work minus that of all forces in the solution has a second-order error.
        bordered.mat.mult(newton.x, newton.f)
        forces, opened = bordered.split(newton.f)
        return mpi.total(self.system.comm, float((2.0 * pulled - forces) @ moved)) + float(pressures[1:] @ opened[1:])

    def release(self) -> None:
        """Release the PETSc and MPI objects of this device, which cannot be solved afterwards. What is merely dropped is
        released on only one rank: on several PETSc waits until all agree."""
        self._drop()
        self.system.K.destroy()

    def _drop(self) -> None:
        self.newton.release()
        self.bordered.release()
        self._y.destroy()


class Carried(component.HistoryDependent, Protocol):
    """Derivatives of states, as of `sensitivity.InTime`, from each state that a path accepts to the next."""

    def carry(self, state: State, control: Control) -> None:
        """Carry them to a state that is not remembered yet, at a fixed value of the control's line."""


# ----------------------------------------------------------------------------------------------------------------------
# Selection of the linear solver: a factorisation, or iterations with multigrid.
#
# A factorisation takes memory that grows faster than the model (as n^(4/3) in three dimensions), iterations what grows as it
# does. Both are known before they are allocated: the first from MUMPS' analysis, the second from the matrix' entries.


METHODS = ("auto", "direct", "iterative")


errors.choices(METHODS)


AMPLE_FACTORISATION_BYTES = 1e3
"""Bytes times the unknowns to the power 4/3 that are always enough for a factorisation: three times what a cube's takes in
double precision (307, 297 and 295 at 15,468, 49,072 and 93,469 unknowns), and ten times a slab's. If that much is free, the
exact need is not computed, which takes an assembly and an analysis."""
MASS_BYTES_PER_ENTRY = 6
"""Bytes of the mass matrix of the modes per entry of K: it has two fifths of these."""


@dataclasses.dataclass(frozen=True)
class SolverMethod:
    """The selected method, ``"direct"`` or ``"iterative"``.

    Attributes:
        memory: Estimate of what it takes beside the model itself, bytes on all ranks; 0 if it was not looked at.
        why: Why it is not the other one, a clause; empty where that was not asked.
    """

    name: str
    memory: float = 0.0
    why: str = ""

    @property
    def description(self) -> str:
        """A message on the selection; empty if nothing was decided."""
        if not self.memory:
            return ""
        how = "iterations with multigrid" if self.name == "iterative" else "a factorisation"
        return f"linear equations: {how}, about {self.memory / mpi.GIGA_BYTE:.2g} GB" + (f" ({self.why})" if self.why else "")

    def inverse(self, system: System) -> Preconditioner:
        """Return the preconditioner of a system's tangent."""
        return cycle_of(system)(system) if self.name == "iterative" else Factorisation(system.K, spread(system.matter))


def cycle_of(system: System) -> type[Multigrid]:
    """Return the kind of cycle that a system takes."""
    from softmodels.mechanics.iterative import Multigrid, RigidCycle  # most models are factorised

    return RigidCycle if system.unknowns.moving else Multigrid


def select_solver(system: System, method: str) -> SolverMethod:
    """Return the method to use for the requested one of `METHODS`; the system is assembled at rest and analysed where memory
    could be short.

    Raises:
        TooLargeError: The machine's memory holds neither, or not the one asked for.
        ValueError: No such method.
    """
    if method not in METHODS:
        raise ValueError(f"solver {method!r} is not one of {', '.join(METHODS)}")
    unknowns, room = system.K.getSize()[0], mpi.available(system.comm)
    if AMPLE_FACTORISATION_BYTES * unknowns ** (4 / 3) < room * system.comm.size:
        return SolverMethod("direct" if method == "auto" else method)
    from softmodels.mechanics.iterative import PER_UNKNOWN

    system.rest()
    system.assemble_tangent()
    remembered = sum(history.step_bytes for history in system.potential.histories)
    both = MASS_BYTES_PER_ENTRY * entries_here(system.K) + remembered
    iterative = mpi.needed(system.comm, both + cycle_of(system).memory(system))
    fits = iterative[0] <= room
    if fits and method == "iterative":  # the analysis of a factorisation takes time and memory of its own
        return SolverMethod("iterative", iterative[1])
    usual, most = Factorisation.memory(system.K, spread(system.matter))
    beside = both + 8 * PER_UNKNOWN * system.n  # GMRES and modes have as many vectors
    direct = mpi.needed(system.comm, beside + most)
    if direct[0] <= room and method != "iterative":
        return SolverMethod("direct", mpi.needed(system.comm, beside + usual)[1])
    if fits and method == "auto":
        told = f"about {direct[1] / mpi.GIGA_BYTE:.2g} GB of {room * system.comm.size / mpi.GIGA_BYTE:.2g} GB free"
        return SolverMethod("iterative", iterative[1], f"a factorisation would take {told}")
    least = iterative if method == "iterative" else direct
    advice = ", or --solver iterative" if fits else ""
    raise mpi.TooLargeError(
        f"the model has {unknowns} unknowns, and its solution needs about {least[1] / mpi.GIGA_BYTE:.2g} GB "
        f"of memory, where {room * system.comm.size / mpi.GIGA_BYTE:.2g} GB are free; use a larger --cell-size, a smaller "
        f"slice of the device{advice}"
    )
