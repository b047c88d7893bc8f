"""The search for the best design: sequential quadratic programming on an elastic problem that steps back from failures.

Chosen among SciPy's SLSQP and trust-constr and NLopt's MMA and CCSA (cyipopt has no wheel), on membranes with 3 to 20
parameters in closed form (tests/benchmarks/optimisers.py): evaluations to the end, and what happened.

| problem | SLSQP, elastic | SLSQP | MMA | CCSA | trust-constr |
|---|---|---|---|---|---|
| limits inactive at the start | 12, 11, 12 | 8, 9, 10 | 17, 21, 22 | 28, 27, 27 | 29, 18, 13 |
| trial points without a state | 8, 12, 14 | 10, 12, 16 | 17, 20, 22 | 34, 31, 32 | 43, 23, 19 |
| limits broken at the start | 10, 11, 12 | 5, 6, 7 | 6, 10, 81 | 9, 11, 11 | 25, 11, 11 |
| limits that exclude each other | 14, 25, 19 | 100, 100, 98 | 10, 13, 11 | 9, 41, 72 | 100, 100, 100 |

In the last row only the elastic form came near the least violation (0.200 of a limit; MMA ended at 0.250, SLSQP at 0.464).
Elastic means: one more variable t >= 0 by which all limits may be passed, at a price. So the quadratic problem of each step
has a solution, and a request that cannot be met ends where the largest violation is least.

The search begins with short steps of all parameters at once (`softmodels.design.approach`), so that meshes and states follow,
and SLSQP goes on where those gain little any more. A trial that fails (no state there, no device) counts as if nothing had been
gained on the last point: SLSQP then halves its step. So does, without an evaluation, a step longer than the first part's last
ones or twice the last good one, and one that goes the way of a failure. Where the device had to be meshed anew the search
begins again from there, because values of two meshes differ by more than what the last steps gain.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize

from softmodels.design.approach import FARTHEST_REACH, approached
from softmodels.design.formulation import Scaled

Array = npt.NDArray[np.float64]
Evaluate = Callable[[Array], Scaled | None]
"""A design in scaled numbers by its scaled parameters; None if it fails."""

PRICES = (10.0, 100.0)
"""Of a violation of all of a limit, in objectives; the second if the first was too small."""
PRECISION = 1e-4
"""The search ends where a step gains less than this share of the objective, or no step gains."""
SAME_DIRECTION = 0.98
"""Cosine of the angle within which two steps go the same way."""
MOST_MESHES = 8
"""Meshes of one pass."""
MOST_STEPS = 60
"""Steps of one pass; the number of evaluations ends it before."""


def search(evaluate: Evaluate, start: Array) -> Array:
    """The end of the search, in scaled parameters.

    Args:
        evaluate: A design in scaled numbers; every c at most zero is wanted. May raise to end the search.
        start: A design that does not fail, each value from 0 to 1.
    """
    x, reach = approached(evaluate, start, PRICES[0])
    for price in PRICES:
        x = _pass(evaluate, x, price, reach)
        if _violation(evaluate, x) <= PRECISION:
            return x
        x = _pass(evaluate, x, 1.0, reach, objective=False)
        if _violation(evaluate, x) > PRECISION:
            return x  # the least violation there is
    return x


def _violation(evaluate: Evaluate, x: Array) -> float:
    found = evaluate(x)
    assert found is not None  # a search ends where it has been
    return float(found.c.max(initial=0.0))


class _OtherMeshError(Exception):
    """A trial has a mesh of its own: values before and after are not to be compared to the last digit."""

    def __init__(self, x: Array):
        super().__init__()
        self.x = x


def _pass(evaluate: Evaluate, start: Array, price: float, reach: float, objective: bool = True) -> Array:
    """Runs of SLSQP over the parameters and t, each on one mesh."""
    for _ in range(MOST_MESHES):
        steps = _Steps(evaluate, start, price, reach, objective)
        bounds = [(0.0, 1.0)] * len(start) + [(0.0, None)]
        limits = [{"type": "ineq", "fun": steps.limits, "jac": steps.limit_slopes}] if steps.count else []
        try:
            minimize(
                steps.value, np.append(start, steps.elastic), jac=steps.slope, method="SLSQP", bounds=bounds,
                constraints=limits, options={"maxiter": MOST_STEPS, "ftol": PRECISION},
            )  # fmt: skip
        except _OtherMeshError as other:
            start = other.x
        else:
            break
    return steps.best


class _Steps:
    """What SLSQP asks; it asks for slopes only at points that it goes on from."""

    def __init__(self, evaluate: Evaluate, start: Array, price: float, reach: float, objective: bool):
        self._evaluate, self.price, self.weight = evaluate, price, float(objective)
        found = evaluate(start)
        assert found is not None
        self.count = len(found.c)
        self.elastic = float(found.c.max(initial=0.0))
        self.at, self.reach, self.failed = start, reach, list[Array]()
        self.best, self._merit = start, self._worth(found)
        self.slope(np.append(start, self.elastic))

    def _worth(self, found: Scaled) -> float:
        return self.weight * found.f + self.price * float(found.c.max(initial=0.0))

    def _found(self, z: Array) -> Scaled | None:
        x = np.clip(z[:-1], 0.0, 1.0)
        step = float(np.abs(x - self.at).max())
        if step > self.reach * (1 + 1e-9) or self._behind_a_failure(x):
            return None
        found = self._evaluate(x)
        if found is None:
            self.failed.append(x)
            self.reach = step / 2
        elif found.fresh:
            raise _OtherMeshError(x)
        if found is not None and self._worth(found) < self._merit:
            self.best, self._merit = x, self._worth(found)
        return found

    def _behind_a_failure(self, x: Array) -> bool:
        """Whether a point lies about in the direction of one that failed, and as far away."""
        d = x - self.at
        length = float(np.linalg.norm(d))
        for known in self.failed:
            f = known - self.at
            far = float(np.linalg.norm(f))
            if length >= 0.9 * far and float(d @ f) >= SAME_DIRECTION * length * far:
                return True
        return False

    def value(self, z: Array) -> float:
        found = self._found(z)
        return self._base_value if found is None else self.weight * found.f + self.price * float(z[-1])

    def slope(self, z: Array) -> Array:
        before, self.at = self.at, np.clip(z[:-1], 0.0, 1.0)
        if not np.array_equal(before, self.at):
            self.reach = min(2 * self.reach, FARTHEST_REACH)
        found = self._evaluate(self.at)
        if found is None:  # SLSQP gave up where the last step failed
            return np.zeros(len(z))
        self._base_value = self.weight * found.f + self.price * float(z[-1])
        self._base_limits = z[-1] - found.c
        return np.append(self.weight * found.df, self.price)

    def limits(self, z: Array) -> Array:
        found = self._found(z)
        return self._base_limits if found is None else np.asarray(z[-1] - found.c)

    def limit_slopes(self, z: Array) -> Array:
        found = self._evaluate(np.clip(z[:-1], 0.0, 1.0))
        if found is None:
            return np.zeros((self.count, len(z)))
        return np.column_stack([-found.dc, np.ones(self.count)])
