"""What the linear solves at one state leave for those that follow there.

Newton's iterates at a state have nearly one matrix A, and each iteration of GMRES finds A z of one more direction z. What of a
right side r lies along these is answered by them, and the preconditioner M has the rest: with the columns of Q orthonormal and
Q = A Z, it becomes M (r - Q Q^T r) + Z Q^T r: a deflated preconditioner (Soodhalter, de Sturler, Kilmer 2020, arXiv:2001.10347,
survey what is recycled in this way).
At another state they would be as stale as the factorisation, and mislead.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from softmodels.mechanics.mpi import on_root, summed

if TYPE_CHECKING:
    from mpi4py import MPI

Array = npt.NDArray[np.float64]

MOST = 30
"""Directions that are kept, the last ones."""
INDEPENDENT = 1e-8
"""Eigenvalue of the scaled answers' Gram matrix, in shares of the largest, below which they say no more than the others."""


class Recycled:
    """Directions and what a matrix made of them.

    Args:
        comm: The ranks that hold a part of each.

    Attributes:
        state: Dofs of the state at which they were found, once it is known.
    """

    def __init__(self, comm: MPI.Comm):
        self._comm = comm
        self.forget()

    def belong_to(self, state: Array) -> None:
        """Forget all of other states than that of these very dofs."""
        if state is not self.state:
            self.forget()

    def forget(self) -> None:
        """Forget all: another state follows, or another preconditioner."""
        self.state: Array | None = None
        self._pairs: list[tuple[Array, Array]] = []
        self._answers = self._directions = np.empty((0, 0))

    def note(self, direction: Array, answer: Array) -> None:
        """Keep a direction and its product with the matrix, owned entries."""
        self._pairs = [*self._pairs[1 - MOST :], (direction.copy(), answer.copy())]

    def take_up(self) -> None:
        """Let what has been noted count from here on."""
        if not self._pairs:
            return
        directions, answers = (np.array(rows) for rows in zip(*self._pairs, strict=True))
        products = summed(self._comm, answers @ answers.T)
        shares = on_root(self._comm, lambda: _orthonormal(products))  # the same choice on all ranks
        self._answers, self._directions = shares @ answers, shares @ directions

    def take_out(self, r: Array) -> tuple[Array, Array | None]:
        """What is left of a right side, and the answer to the rest of it if anything is known."""
        if not len(self._answers):
            return r, None
        shares = summed(self._comm, self._answers @ r)
        return r - shares @ self._answers, shares @ self._directions


def _orthonormal(products: Array) -> Array:
    """Shares of vectors in orthonormal ones, as rows, from the vectors' scalar products."""
    lengths = np.sqrt(products.diagonal())
    values, vectors = np.linalg.eigh(products / np.outer(lengths, lengths))
    chosen = values > INDEPENDENT * values[-1]
    return np.asarray((vectors[:, chosen] / np.sqrt(values[chosen])).T / lengths)
