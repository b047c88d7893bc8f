"""The solver where there is nothing left to solve."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

from geometries import HollowDisk
from softmodels.materials.laws import Yeoh
from softmodels.mechanics.body import Body
from softmodels.mechanics.controls import volume_control
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System


@pytest.fixture
def solvers(tmp_path):
    disk = HollowDisk.variant("shadow", section="axisymmetric", cell_size=0.004)
    file = tmp_path / "disk.msh"
    disk.write(file)
    made = [Solver(System(Body.from_file(disk, file, MPI.COMM_SELF), Yeoh(10e3, 20.0, 0.0, 0.495))) for _ in range(2)]
    yield made
    for solver in made:
        solver.release()


def test_a_guess_that_is_the_state_has_its_tangent(solvers):
    """Newton's method makes no step then, and so has factorised nothing yet."""
    first, second = solvers
    rest = first.system.rest()
    line = volume_control(1.1 * rest.V)
    found = first.solve(line, rest.w, 0.0)
    again = second.solve(line, found.w, found.P)
    assert found.iterations > 0 and again.iterations == 0
    one, other = first.tangent(found, line, 1e-10), second.tangent(again, line, 1e-10)
    assert np.allclose(other.w, one.w, rtol=0.0, atol=1e-8 * np.abs(one.w).max())
    assert np.allclose([other.P, other.V], [one.P, 1.0], rtol=1e-8)


def test_the_answer_to_a_load_that_has_hardly_changed_is_kept(solvers):
    first, second = solvers
    rest = first.system.rest()
    asked = []
    for solver, share in ((first, 1.001), (second, 1.3)):
        solver.factorise(rest)
        state = solver.solve(volume_control(share * rest.V), rest.w, 0.0)
        solver.factorise(rest)
        applied, apply = [], solver.bordered.inverse.apply
        solver.bordered.inverse.apply = lambda b, x, applied=applied, apply=apply: (applied.append(1), apply(b, x))
        solver.system.load(state)
        solver.kept.set_columns()
        solver.bordered.refresh()
        asked.append(len(applied))
        tangent = solver.tangent(state, volume_control(state.V), 1e-10)
        solver.factorise(state)
        exact = solver.tangent(state, volume_control(state.V), 1e-10)
        assert np.allclose(tangent.w, exact.w, rtol=0.0, atol=1e-7 * np.abs(exact.w).max())
        assert pytest.approx(exact.P, rel=1e-7) == tangent.P
    assert asked == [0, 1]
