"""Shapes in which a device leaves its path, as measures of other shapes, and the operator whose eigenvectors they are."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from petsc4py import PETSc

    Solve = Callable[[PETSc.Vec, PETSc.Vec], object]

Array = npt.NDArray[np.float64]


class Mode:
    """A shape in which a device leaves its path, as a measure of other shapes.

    Args:
        M: Mass matrix of the device, see `Stability`.
        shape: Local dofs, shape as `State.w`.

    Attributes:
        image: M times the shape over shape.M.shape, a PETSc vector: its product with dofs is what they have of the shape.
    """

    def __init__(self, M: PETSc.Mat, shape: Array):
        self._M = M
        self._vector, self.image = self._M.createVecRight(), self._M.createVecLeft()
        self._size = self._length(shape)
        self._M.mult(self._vector, self.image)
        self.image.scale(1 / self._size**2)

    @property
    def length(self) -> float:
        """That of the shape in the norm of M."""
        return self._size

    def share(self, w: Array) -> float:
        """What dofs (shape as `State.w`) have of the mode."""
        self._vector.array_w[:] = w[: self._vector.getLocalSize()]
        return float(self.image.dot(self._vector))

    def size(self, w: Array) -> float:
        """How large dofs are, with the mode as the unit."""
        return self._length(w) / self._size

    def _length(self, w: Array) -> float:
        self._vector.array_w[:] = w[: self._vector.getLocalSize()]
        pushed = self._M.createVecLeft()
        self._M.mult(self._vector, pushed)
        return float(self._vector.dot(pushed) ** 0.5)


class ShiftInvert:
    """PETSc's context of K^-1 M with a kept factorisation of K."""

    def __init__(self, solve: Solve, M: PETSc.Mat):
        self.solve, self.M, self.image = solve, M, M.createVecLeft()

    @classmethod
    def matrix(cls, solve: Solve, M: PETSc.Mat) -> PETSc.Mat:
        from petsc4py import PETSc

        made = PETSc.Mat().createPython(M.getSizes(), context=cls(solve, M), comm=M.comm)
        made.setUp()
        return made

    def mult(self, mat: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        self.M.mult(x, self.image)
        self.solve(self.image, y)
