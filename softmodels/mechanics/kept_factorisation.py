"""The factorisation of K that is kept over several solves, and when it has aged enough to be replaced."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from softmodels.mechanics.bordered import Bordered
from softmodels.mechanics.system import State, System

if TYPE_CHECKING:
    from petsc4py import PETSc


class KeptFactorisation:
    """K of an earlier state, factorised: preconditioner of what is solved since.

    Attributes:
        base: The state at which it was made; None if there is none, or it was made at an iterate.
        age: Iterations of the linear solver since.
        made: How many states it was made for, or made ready for.
        worn: Whether the last solve took so many of them that it is replaced at the next one.
    """

    def __init__(self, system: System, bordered: Bordered):
        self.system, self.bordered = system, bordered
        self.base: State | None = None
        self.age, self.made, self.worn = 0, 0, False

    def make(self, base: State | None) -> None:
        """Factorise the tangent of the current state, which is ``base`` or an iterate.

        What is no factorisation is set up anew only where it has aged: it knows no more of this state than of others.
        """
        if self.bordered.inverse.exact or self._aged or not self.bordered.factorisations:
            self.system.assemble_tangent()
            self.bordered.factorise()
            self.age = 0
        else:
            self.bordered.refresh()
        self.base, self.worn = base, False
        self.made += 1

    def set_columns(self) -> npt.NDArray[np.float64]:
        """Put the current state's loads in the border; each cavity's load of a unit pressure, shape (k, n)."""
        loads = self.system.pressure_loads()
        rows = [self.system.coupling.shares, *self.system.coupling.constraints]
        for column, row in zip(self.bordered.columns, rows, strict=True):
            column.array_w[:] = row @ loads
        return loads

    def count(self, ksp: PETSc.KSP) -> None:
        """Take note of how much older a linear solve has made it."""
        inverse, iterations = self.bordered.inverse, ksp.getIterationNumber()
        self.age += inverse.wear(iterations, ksp.getTolerances()[0])
        self.worn = iterations > inverse.most_of_a_solve

    def solve(self, ksp: PETSc.KSP, b: PETSc.Vec, x: PETSc.Vec) -> bool:
        """Solve with a linear solver, and once more with a set-up of this state where a cycle of another led nowhere.

        Returns:
            Whether it got to its tolerance.
        """
        ksp.solve(b, x)
        self.count(ksp)
        if not ksp.is_converged and not self.bordered.inverse.exact:
            self.spoil()
            self.make(None)
            x.set(0.0)
            ksp.solve(b, x)
            self.count(ksp)
        return ksp.is_converged

    def spoil(self) -> None:
        """Make it stale: what led here is no preconditioner to go on with."""
        self.age = self.bordered.inverse.most_in_all + 1

    @property
    def _aged(self) -> bool:
        return self.worn or self.age > self.bordered.inverse.most_in_all

    @property
    def stale(self) -> bool:
        """Whether a new one is due: it has aged, or was made at an iterate and not at a state."""
        return self.base is None or self.age > self.bordered.inverse.most_in_all
