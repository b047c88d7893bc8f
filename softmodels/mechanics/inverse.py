"""What stands for the inverse of the tangent K: a factorisation, or a cycle of multigrid."""

from __future__ import annotations

import abc
from typing import TYPE_CHECKING, ClassVar

if TYPE_CHECKING:
    from petsc4py import PETSc


class Inverse(abc.ABC):
    """A linear map near K^-1 of the K that it was set up for, and how long it is worth keeping.

    Attributes:
        exact: Whether it is K^-1 itself, and knows K's inertia.
        rounded: Whether it is so in single precision alone.
        most_of_a_solve: Iterations of the linear solver in one solve after which it is replaced at once.
        most_in_all: Wear after which the next state gets one of its own; see `wear`.
        most_newton: Iterations of Newton's method after which a shorter step costs less.
        restart, most_iterations: Of the linear solver that it preconditions.
        instead: What a user can do where that solver fails with it, words after the failure; empty where nothing.
    """

    exact: ClassVar[bool]
    rounded: bool = False
    most_of_a_solve: ClassVar[int]
    most_in_all: ClassVar[int]
    most_newton: ClassVar[int]
    restart: ClassVar[int]
    most_iterations: ClassVar[int]
    instead: ClassVar[str] = ""

    @abc.abstractmethod
    def set_up(self) -> None:
        """Take K as it is now.

        Raises:
            MemoryError: On all ranks, if one has not enough.
        """

    @abc.abstractmethod
    def apply(self, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Put its product with b into x."""

    @abc.abstractmethod
    def negative_pivots(self) -> int:
        """Negative eigenvalues of the K that it was set up for; of an exact one alone."""

    def wear(self, iterations: int, tolerance: float) -> int:
        """How much older a solve to a relative tolerance has made it, in iterations."""
        return iterations

    def on_the_right(self, ksp: PETSc.KSP, context: object, tolerance: float, most: int) -> None:
        """Make a linear solver GMRES with a preconditioner that is made with this.

        What is rounded to single precision is not linear to the last digits: the flexible kind adds up its very answers.

        Args:
            ksp: The linear solver.
            context: PETSc's, of the preconditioner.
            tolerance: Relative.
            most: Iterations.
        """
        from petsc4py import PETSc

        ksp.setType("fgmres" if self.exact else "gmres")
        ksp.setGMRESRestart(self.restart)
        ksp.setPCSide(PETSc.PC.Side.RIGHT)  # type: ignore[arg-type]
        ksp.setTolerances(rtol=tolerance, atol=0.0, max_it=most)
        pc = ksp.getPC()
        pc.setType("python")
        pc.setPythonContext(context)

    @abc.abstractmethod
    def release(self) -> None:
        """Destroy what PETSc holds."""
