"""K factorised by MUMPS."""

from __future__ import annotations

from typing import TYPE_CHECKING

from softmodels.mechanics.inverse import Inverse

if TYPE_CHECKING:
    from petsc4py import PETSc

OUT_OF_MEMORY = (-5, -7, -8, -9, -11, -12, -13, -14, -15, -17, -18, -19, -20)
"""MUMPS' INFOG(1) where it could not allocate, or where what it had allocated was too small (its guide, section 8)."""


MEGA = 1e6
TRIPLET = 16
"""Bytes of an entry and its place."""


class Factorisation(Inverse):
    """LDL^T of K.

    Args:
        K: The matrix; its values may change, its pattern may grow.
    """

    exact = True
    most_of_a_solve = 25
    most_in_all = 60
    most_newton = 15
    restart = most_iterations = 60

    def __init__(self, K: PETSc.Mat):
        self.K = K
        self._make()

    def _make(self) -> None:
        """Make what factorises K with the pattern it has."""
        self._direct = _mumps(self.K)
        self._direct.setFromOptions()
        self._entries = entries_in_all(self.K)

    @staticmethod
    def memory(K: PETSc.Mat) -> float:
        """Bytes that a factorisation of K would take on this rank: what MUMPS' analysis foretells, and PETSc's copy of K.

        Measured on wedges of 9,804, 17,092, 20,542 and 48,563 unknowns, mass matrix included: 50, 129, 112 and 325 MB
        taken, 42, 129, 119 and 340 MB foretold.

        Args:
            K: An assembled matrix.
        """
        direct = _mumps(K)
        factor = direct.getFactorMatrix()
        factor.setMumpsIcntl(23, 1)  # a megabyte is never enough: MUMPS ends after its analysis, before it allocates
        direct.setUp()
        megabytes = factor.getMumpsInfo(15)
        direct.destroy()
        return megabytes * MEGA + entries_here(K) / 2 * TRIPLET

    def set_up(self) -> None:
        # Contact may have coupled more: PETSc would keep the analysis of the old pattern.
        if entries_in_all(self.K) != self._entries:
            self._direct.destroy()
            self._make()
        self._direct.setReusePreconditioner(False)
        self._direct.setUp()
        if int(self._direct.getFactorMatrix().getMumpsInfog(1)) in OUT_OF_MEMORY:
            raise MemoryError  # PETSc itself goes on with a preconditioner that is none
        self._direct.setReusePreconditioner(True)

    def apply(self, b: PETSc.Vec, x: PETSc.Vec) -> None:
        self._direct.apply(b, x)

    def negative_pivots(self) -> int:
        return int(self._direct.getFactorMatrix().getMumpsInfog(12))

    def release(self) -> None:
        self._direct.destroy()


def entries_here(K: PETSc.Mat) -> float:
    """Entries of a matrix on this rank."""
    return float(K.getInfo(K.InfoType.LOCAL)["nz_used"])  # type: ignore[arg-type]


def entries_in_all(K: PETSc.Mat) -> float:
    """Entries of a matrix on all ranks."""
    return float(K.getInfo()["nz_used"])


def _mumps(K: PETSc.Mat) -> PETSc.PC:
    """PETSc's LDL^T by MUMPS, not yet set up."""
    from petsc4py import PETSc

    direct = PETSc.PC().create(K.comm)
    direct.setOptionsPrefix("body_")
    direct.setOperators(K, K)
    direct.setType("cholesky")
    direct.setFactorSolverType("mumps")
    direct.setFactorSetUpSolverType()
    direct.getFactorMatrix().setMumpsIcntl(13, 1)  # the last front too counts its negative pivots, on all ranks
    return direct
