"""What points of a path foretell, against paths that are polynomials, and how much less a solver has to do with it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from geometries import HollowDisk
from softmodels.materials.laws import NeoHookean
from softmodels.mechanics.body import Body
from softmodels.mechanics.controls import Control, Tangent, pressure_control
from softmodels.mechanics.newton import NoConvergence
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import State, System
from softmodels.path.continuation import Continuation, predict, predict_direction, trace


@dataclasses.dataclass(frozen=True)
class Known:
    state: State
    tangent: Tangent


@pytest.fixture
def path_of():
    """Return a function that gives the points of a random polynomial path of a degree, P = t along it."""

    def made(degree):
        w = [np.polynomial.Polynomial(row) for row in np.random.default_rng(degree).normal(size=(5, degree + 1))]

        def point(t, scale=1.0):
            slopes = np.array([row.deriv()(t) for row in w])
            state = State(np.array([row(t) for row in w]), t, 3.0 * t)
            return Known(state, Tangent(scale * slopes, scale, 3.0 * scale))

        return point

    return made


LINES = (pressure_control(0.0), Control(0.2, 0.4, 0.0))
"""Under both the left side is P."""


@pytest.mark.parametrize("line", LINES)
@pytest.mark.parametrize(("places", "degree"), [((0.3,), 1), ((0.3, 0.5), 3), ((0.3, 1.0), 3)])
def test_a_state_is_foretold_by_the_polynomial(path_of, line, places, degree):
    point = path_of(degree)
    w, P = predict([point(t, 1.0 + t) for t in places], line.at(1.1))
    assert pytest.approx(1.1) == P
    assert np.allclose(w, point(1.1).state.w, rtol=1e-12)


@pytest.mark.parametrize("line", LINES)
@pytest.mark.parametrize(("places", "degree"), [((0.3,), 2), ((0.3, 0.5), 4), ((0.3, 1.0), 4)])
def test_the_direction_is_foretold_by_the_polynomial_through_the_state_too(path_of, line, places, degree):
    point = path_of(degree)
    here = point(1.1)
    found = predict_direction([point(t, 1.0 + t) for t in places], here.state, line)
    assert pytest.approx(1.0) == found.P
    assert np.allclose(found.w, here.tangent.w, rtol=1e-10)
    worse = predict_direction([point(t, 1.0 + t) for t in places], point(1.2).state, line)
    assert not np.allclose(worse.w, here.tangent.w, rtol=1e-3)


def test_two_points_that_do_not_agree_leave_the_word_to_the_last(path_of):
    point = path_of(2)
    last = point(0.5)
    for first in (point(0.3, -1.0), point(0.499)):  # the path turned between them; too near for so far ahead
        assert np.allclose(predict([first, last], LINES[0].at(1.0))[0], last.state.w + 0.5 * last.tangent.w)
        assert np.allclose(predict_direction([first, last], point(1.0).state, LINES[0]).w, point(1.0).tangent.w)


def test_nothing_is_foretold_of_a_direction_behind_or_at_the_last_point(path_of):
    point = path_of(3)
    points = [point(0.3), point(0.5)]
    for t in (0.4, 0.5, 0.5 + 1e-6):
        assert predict_direction(points, point(t).state, LINES[0]) is None
    assert predict_direction([point(0.3), point(0.5, -1.0)], point(0.7).state, LINES[0]) is None
    assert predict_direction([], point(0.7).state, LINES[0]) is None


def test_a_path_along_the_line_is_refused(path_of):
    along = Control(1.0, -3.0, 1.0)
    with pytest.raises(NoConvergence, match="runs along"):
        predict([path_of(2)(0.3)], along)


def test_a_foretold_direction_is_found_in_fewer_iterations(comm, tmp_path):
    disk = HollowDisk(section="axisymmetric", cell_size=0.003)
    disk.write(tmp_path / "disk.msh")
    solver = Solver(System(Body.from_file(disk, tmp_path / "disk.msh", comm), NeoHookean(30e3, 0.49)))
    points = list(trace(Continuation(solver), [0.1, 0.15, 0.2, 0.25]))
    *known, at = points[-3:]
    line = pressure_control(at.state.P)
    guess = predict_direction(known, at.state, line)
    solver.factorise(known[0].state)
    found, iterations = [], []
    for start in (None, guess):
        found.append(solver.tangent(at.state, line, 1e-7, start))
        iterations.append(solver.newton.snes.getKSP().getIterationNumber())
    assert iterations[1] <= iterations[0] / 2
    assert 1e-7 < np.abs(guess.w - found[0].w).max() / np.abs(found[0].w).max() < 1e-2
    assert np.allclose(found[1].w, found[0].w, rtol=0.0, atol=1e-6 * np.abs(found[0].w).max())
    assert pytest.approx((found[0].P, found[0].V), rel=1e-6) == (found[1].P, found[1].V)
