"""A guess of a linear answer at one state from the answers at the states before it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from softmodels.mechanics.mpi import summed

if TYPE_CHECKING:
    from mpi4py import MPI

Array = npt.NDArray[np.float64]

MOST = 3
"""Answers that are kept: with three, a path's curve is followed to its bend."""
LIKE = 0.5
"""What the states kept may leave of the way to a new one, in shares of it, for more than the last of them to count."""
ALIKE = 1e-10
"""Shares of the longest way below which two states do not differ in what the others know: their difference is rounding."""


class EarlierAnswers:
    """The answers to one load at the last states of a path.

    Args:
        comm: The ranks that hold a part of each.
    """

    def __init__(self, comm: MPI.Comm):
        self.comm = comm
        self._load: Array | None = None
        self._known: list[tuple[Array, Array]] = []

    def guess(self, load: Array, place: Array) -> Array | None:
        """A guess of the answer at a state; None if nothing is known.

        The sum of states with shares that add up to one that comes nearest to the state: the same sum of their answers.

        Args:
            load: What is answered; asked of another one, what is known of the last is forgotten.
            place: Owned unknowns of the state.
        """
        if load is not self._load:
            self._load, self._known = load, []
        if not self._known:
            return None
        (last, answer), others = self._known[-1], self._known[:-1]
        ways = np.array([place - last, *(w - last for w, _ in others)])
        products = summed(self.comm, ways @ ways.T)
        guess = answer.copy()
        square, right = products[1:, 1:], products[1:, 0]
        shares = np.linalg.lstsq(square, right, rcond=ALIKE)[0]
        left = products[0, 0] - 2.0 * shares @ right + shares @ square @ shares
        if left <= LIKE**2 * products[0, 0]:
            for share, (_, x) in zip(map(float, shares), others, strict=True):
                guess += share * (x - answer)
        return guess

    def keep(self, place: Array, answer: Array) -> None:
        """Remember the answer at a state to the load that was asked of last."""
        self._known = [*self._known[1 - MOST :], (place.copy(), answer.copy())]
