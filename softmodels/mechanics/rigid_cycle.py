"""The cycle of multigrid where rigid parts move: a cycle for the dofs that are left free, and the parts' few unknowns.

        [ K_ff  K_fs ]^-1     [ M  0 ]                            f: what follows no part,  s: the parts' unknowns;
        [ K_sf  K_ss ]     ~  [ 0  0 ] + L (L^T K L)^-1 L^T       L = [ -Y ; 1 ],  Y near K_ff^-1 K_fs

With M = K_ff^-1 and Y = K_ff^-1 K_fs this is the inverse of K by blocks. M takes the parts for held: it is the cycle of a
device that is clamped where they are bonded. L is how the device follows where one part's unknown alone changes, by a few
iterations with M. L^T K L is then K's Schur complement but for the square of L's error, however soft the device is there.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from softmodels.mechanics.callbacks import Shell
from softmodels.mechanics.multigrid import Multigrid

if TYPE_CHECKING:
    from petsc4py import PETSc

    from softmodels.mechanics.system import System

FOLLOWED = 1e-2
"""Relative tolerance of the iterations for L: six for each unknown of a finger's tip."""


class RigidCycle(Multigrid):
    """The map above.

    Args:
        system: Whose K it is for; it has rigid parts.
    """

    def __init__(self, system: System):
        unknowns, comm = system.unknowns, system.comm
        mine = [slots for rank, slots in unknowns.slots if rank == comm.rank]
        self._own = np.concatenate([*mine, unknowns.idle[:0]]).astype(np.int32)
        super().__init__(system, np.concatenate([self._own, unknowns.idle]))
        counts = comm.allgather(len(self._own))
        self._before = sum(counts[: comm.rank])  # unknowns of the ranks before this one
        self._following = [self.K.createVecRight() for _ in range(sum(counts))]
        self._stiffness = np.empty((0, 0))
        self._one, self._force = self.K.createVecRight(), self.K.createVecRight()
        self._shell = Shell(self._free_product, self._free_cycle)
        self._make_solver()

    def _make_solver(self) -> None:
        """Make the iterations for L: on K with the parts held, by the cycle."""
        from petsc4py import PETSc

        self._free = PETSc.Mat().createPython(self.K.getSizes(), context=self._shell, comm=self.K.comm)
        self._free.setUp()
        self._solver = PETSc.KSP().create(self.K.comm)
        self.on_the_right(self._solver, self._shell, FOLLOWED, self.restart)
        self._solver.setOperators(self._free)

    @staticmethod
    def memory(system: System) -> float:
        """See `Multigrid.memory`; a vector for each unknown of a part more."""
        vectors = sum(motion.freedom.count for motion in system.unknowns.moving.values())
        return Multigrid.memory(system) + 8.0 * vectors * system.K.getLocalSize()[0]

    def set_up(self) -> None:
        super().set_up()
        for number, following in enumerate(self._following):
            self._follow(number - self._before, following)
        products = []
        for following in self._following:
            self.K.mult(following, self._force)
            products.append(self._force.mDot(self._following))
        self._stiffness = np.array(products)

    def _follow(self, number: int, following: PETSc.Vec) -> None:
        """Put into ``following`` how the device follows one of this rank's unknowns, by number, or of another rank's."""
        unknown = self._own[number : number + 1] if 0 <= number < len(self._own) else self._own[:0]
        self._one.set(0.0)
        self._one.array_w[unknown] = -1.0
        self.K.mult(self._one, self._force)
        self._force.array_w[self._own] = 0.0
        self._solver.solve(self._force, following)  # what is short of the tolerance costs iterations later, no digits
        following.array_w[self._own] = 0.0
        following.array_w[unknown] = 1.0

    def apply(self, b: PETSc.Vec, x: PETSc.Vec) -> None:
        super().apply(b, x)
        if self._following:
            x.array_w[self._own] = 0.0
            amounts = np.linalg.solve(self._stiffness, b.mDot(self._following))
            x.maxpy(amounts.tolist(), self._following)

    def release(self) -> None:
        super().release()
        for thing in (self._solver, self._free, self._one, self._force, *self._following):
            thing.destroy()

    # PETSc calls these, of K with the parts held and of its preconditioner.

    def _free_product(self, mat: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        x.copy(self._one)
        self._one.array_w[self._own] = 0.0
        self.K.mult(self._one, y)
        y.array_w[self._own] = x.array_r[self._own]

    def _free_cycle(self, pc: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        super().apply(x, y)
