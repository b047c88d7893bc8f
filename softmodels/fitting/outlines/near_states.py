"""A state found by Newton's method from a guess, without a path: only what it finds at once counts."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from softmodels.mechanics.newton import NoConvergence

if TYPE_CHECKING:
    from softmodels.mechanics.controls import Control
    from softmodels.mechanics.solver import Solver
    from softmodels.mechanics.system import State

Array = npt.NDArray[np.float64]

AT_ONCE = 6
"""Newton iterations in which a state has to be found from a guess, or else the path is followed."""
LARGEST_CORRECTION = 0.5
"""How far from the guess such a state may lie, as a share of its change: further, it may be another branch."""


def near(solver: Solver, base: State, line: Control, w: Array, P: float) -> State | None:
    """The state on a line next to a guess; None if it is not found at once, or lies elsewhere.

    Args:
        solver: The device.
        base: The state that the guess was made from, of other parameters.
        line: What is asked for.
        w: Guess of the dofs, shape as `State.w`.
        P: Guess of the pressure, dimensionless.
    """
    try:
        if solver.stale:
            solver.factorise(base)
        found = solver.solve(line, w, P)
    except NoConvergence:
        return None
    off, change = float(np.linalg.norm(found.w - w)), float(np.linalg.norm(found.w - base.w))
    sure = off < LARGEST_CORRECTION * max(change, 1e-300) or off < 1e-3 * float(np.linalg.norm(w))
    return found if found.V > 0.0 and found.iterations <= AT_ONCE and sure else None
