"""The search for the device that follows a target best: Gauss and Newton's method in a trust region, within the bounds.

The distance from a target that can be met is no smooth function where it is met, and the searches for other objectives end
early there. Its square is a sum of squares whose derivatives are known one by one, so that few evaluations are enough
(SciPy's trust region reflective method: Branch, Coleman and Li 1999, doi 10.1137/S1064827595289108). A trial that fails is
answered with no number, upon which it shrinks its region.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from softmodels.design.formulation import Formulation
from softmodels.design.trials import Trial

Array = npt.NDArray[np.float64]

PRECISION = 1e-6
"""Of the parameters, in widths of their bounds, at which the search ends."""
GAIN = 1e-10
"""Share of the sum of squares that a step has to gain."""
MESHES = 3
"""Meshes on which it begins again, for values of two meshes differ."""


def can_follow(form: Formulation, trial: Trial) -> bool:
    """Whether the problem is one of least squares: a target to follow, and no limits to keep beside the bounds."""
    keys = [term.quantity.key for term in form.problem.terms]
    return form.problem.objective == "follow" and not form.rows and all(key in trial.squares for key in keys)


def followed(judged: Callable[[Array], Trial], form: Formulation, start: Array) -> Array:
    """The end of the search in scaled parameters.

    Args:
        judged: A trial by its scaled parameters; may raise to end the search.
        form: The problem in scaled numbers.
        start: Where to begin; a design that does not fail.
    """
    x, known = start, dict[bytes, Trial]()

    def trial(point: Array) -> Trial:
        key = point.tobytes()
        if key not in known:
            known[key] = judged(point)
        return known[key]

    for _ in range(MESHES):
        known.clear()
        rows = len(distances(form, trial(x)))

        def residuals(point: Array, rows: int = rows) -> Array:
            found = trial(point)
            return np.full(rows, np.nan) if found.failed else distances(form, found)

        x = least_squares(
            residuals, x, lambda point: slopes(form, trial(point)), bounds=(0.0, 1.0), xtol=PRECISION, ftol=GAIN, gtol=1e-15,
        ).x  # fmt: skip
        if not any(one.remeshed for one in list(known.values())[1:]):
            break
    return np.asarray(x)


def distances(form: Formulation, trial: Trial) -> Array:
    """Residuals of all targets of a trial, counted in the first trial's distance, those of a mean by their weights."""
    return _stacked(form, trial)[:, -1]


def slopes(form: Formulation, trial: Trial) -> Array:
    """Their derivatives by the scaled parameters."""
    return _stacked(form, trial)[:, : len(form.problem.free)] * form.width


def _stacked(form: Formulation, trial: Trial) -> Array:
    return np.vstack(
        [
            np.sqrt(term.weight / trial.squares[term.quantity.key].count) / form.size
            * trial.squares[term.quantity.key].triangle
            for term in form.problem.terms
        ]
    )  # fmt: skip
