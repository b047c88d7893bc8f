"""The first part of a search: linear programs within move limits that grow where a step was foreseen well.

Sequential linear programming with a trust region (Fletcher and Sainz de la Maza 1989, doi 10.1007/BF01582299), in the elastic
form of `softmodels.design.search`. Every parameter moves at once, and none by much, so that meshes and states follow; where
such steps gain little any more, second derivatives matter and the search goes on with SLSQP.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from scipy.optimize import linprog

from softmodels.design.formulation import Scaled

Array = npt.NDArray[np.float64]

FIRST_REACH = 0.1
"""Farthest that a parameter moves in the first step, in widths of its bounds."""
FARTHEST_REACH = 0.4
SHORTEST_REACH = 0.05
"""From which on SLSQP goes on."""
WORTH_IT = 0.05
"""Gain in objectives that is still to be expected of a step; SLSQP goes on where it is less."""
GOOD, POOR = 0.6, 0.1
"""Shares of the foreseen gain from which the move limits grow, and below which a step is not taken."""


def approached(evaluate: Callable[[Array], Scaled | None], start: Array, price: float) -> tuple[Array, float]:
    """The last design that linear steps have led to, and the move limits there.

    Args:
        evaluate: A design in scaled numbers by its scaled parameters; None if it fails.
        start: A design that does not fail, each value from 0 to 1.
        price: Of the largest violation.
    """
    x, reach = start, FIRST_REACH
    here = evaluate(x)
    assert here is not None
    while reach >= SHORTEST_REACH:
        step, foreseen = _step(here, x, reach, price)
        if foreseen < WORTH_IT:
            break
        trial = np.clip(x + step, 0.0, 1.0)
        there = evaluate(trial)
        gain = -np.inf if there is None else _merit(here, price) - _merit(there, price)
        if there is not None and (
            gain > POOR * foreseen or there.fresh
        ):  # values of another mesh are not to be compared
            x, here = trial, there
        if gain < POOR * foreseen:
            reach = min(reach, float(np.abs(step).max())) / 2
        elif gain > GOOD * foreseen:
            reach = min(2 * reach, FARTHEST_REACH)
    return x, reach


def _merit(found: Scaled, price: float) -> float:
    return found.f + price * float(found.c.max(initial=0.0))


def _step(here: Scaled, x: Array, reach: float, price: float) -> tuple[Array, float]:
    """The best step within the move limits as the slopes foresee it, and what it gains."""
    n, count = len(x), len(here.c)
    bounds = [(max(-reach, -value), min(reach, 1.0 - value)) for value in x] + [(0.0, None)]
    rows = np.column_stack([here.dc, -np.ones(count)]) if count else None
    found = linprog(np.append(here.df, price), rows, -here.c if count else None, bounds=bounds, method="highs")
    if found.x is None:  # HiGHS met numbers that it cannot deal with
        return np.zeros(n), 0.0
    return found.x[:n], price * float(here.c.max(initial=0.0)) - float(found.fun)
