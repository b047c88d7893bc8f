"""What the last points of a path and their tangents foretell: the next state, and then the direction of the path there."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
import numpy.typing as npt

from softmodels.mechanics.controls import Curve
from softmodels.mechanics.newton import NoConvergence
from softmodels.mechanics.system import State
from softmodels.mechanics.tangent import Tangent

Array = npt.NDArray[np.float64]

LONGEST = 3.0
"""How far ahead, in distances between the last two points, a polynomial through both says more than the last tangent alone."""
SHORTEST = 1e-2
"""The same of a new state that says something about the direction; nearer by, its change is rounding."""


class Foretelling(Protocol):
    """A state of a path and the path's direction there."""

    @property
    def state(self) -> State: ...

    @property
    def tangent(self) -> Tangent: ...


def predict(points: Sequence[Foretelling], line: Curve) -> tuple[Array, float]:
    """Guess (w, P) on a line from one point and its tangent, or from the cubic through two.

    The parameter is the line's own left side; beyond a point where that turns, the tangent alone is used.

    Raises:
        NoConvergence: The path runs along the line.
    """
    places, rates = _along(points, line)
    if 0.0 in rates:
        raise NoConvergence("the path runs along the control's line")
    if not _agree(places, rates, line.target):
        points, places, rates = points[-1:], places[-1:], rates[-1:]
    values, slopes = _weights(places, line.target)[0]
    return _sum(points, values, slopes / rates)


def predict_direction(points: Sequence[Foretelling], state: State, line: Curve) -> Tangent | None:
    """Guess of the direction at a state beyond the last points, per unit of a line's left side; None if they foretell none.

    It is that of the polynomial through the points, their tangents and the state itself.
    """
    if not points:
        return None
    places, rates = _along(points, line)
    here = line.value(state.V, state.P)
    if not _agree(places, rates, here):
        points, places, rates = points[-1:], places[-1:], rates[-1:]
    shortest = SHORTEST * abs(places[-1] - places[0])
    if rates[-1] <= 0.0 or here - places[-1] <= shortest:
        return None
    (values, slopes), (value_rates, slope_rates) = _weights(places, here)
    # The state adds to the polynomial p through the points w - p times a product of squares, of (t - place) / (here - place)
    # for each point. That is 1 here, and this is its slope.
    own = 2.0 * float(np.sum(1.0 / (here - places)))
    w, P = _sum(points, value_rates - own * values, (slope_rates - own * slopes) / rates)
    return Tangent(w + own * state.w, P + own * state.P, 0.0)


def _along(points: Sequence[Foretelling], line: Curve) -> tuple[Array, Array]:
    """A line's left side at points, and its rates along their tangents."""
    slopes = np.array([line.slopes(p.state.V, p.state.P) for p in points])
    rates = np.einsum("pi,pi->p", slopes, [(p.tangent.V, p.tangent.P) for p in points])
    return np.array([line.value(p.state.V, p.state.P) for p in points]), rates


def _agree(places: Array, rates: Array, at: float) -> bool:
    """Whether two points both foretell what is there."""
    if len(places) < 2 or rates[0] * rates[1] <= 0.0:
        return False
    apart = places[1] - places[0]
    return bool(apart != 0.0 and abs(at - places[1]) <= LONGEST * abs(apart))


def _weights(places: Array, at: float) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Shares of the values and slopes at one or two places in the polynomial through them, at another; and their rates."""
    if len(places) == 1:
        one = np.ones(1)
        return (one, one * (at - places[0])), (0.0 * one, one)
    h = places[1] - places[0]
    x = (at - places[0]) / h
    values = np.array([(1 + 2 * x) * (1 - x) ** 2, x * x * (3 - 2 * x)])
    slopes = h * np.array([x * (1 - x) ** 2, x * x * (x - 1)])
    rate = 6 * x * (1 - x) / h
    return (values, slopes), (np.array([-rate, rate]), np.array([(1 - x) * (1 - 3 * x), x * (3 * x - 2)]))


def _sum(points: Sequence[Foretelling], values: Array, slopes: Array) -> tuple[Array, float]:
    """Sum of the points' states and tangents, (w, P), with a share each."""
    w, P = np.zeros_like(points[0].state.w), 0.0
    for p, value, slope in zip(points, map(float, values), map(float, slopes), strict=True):
        w += value * p.state.w
        w += slope * p.tangent.w
        P += value * p.state.P + slope * p.tangent.P
    return w, P
