"""The solver where there is nothing left to solve."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

from geometries import HollowDisk
from softmodels.materials.laws import Yeoh
from softmodels.mechanics.body import Body
from softmodels.mechanics.controls import volume_control
from softmodels.mechanics.newton import NoConvergence
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System
from softmodels.path.stability import Pencil, nearest


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
        solver.lagged.set_columns()
        solver.bordered.refresh()
        asked.append(len(applied))
        tangent = solver.tangent(state, volume_control(state.V), 1e-10)
        solver.factorise(state)
        exact = solver.tangent(state, volume_control(state.V), 1e-10)
        assert np.allclose(tangent.w, exact.w, rtol=0.0, atol=1e-7 * np.abs(exact.w).max())
        assert pytest.approx(exact.P, rel=1e-7) == tangent.P
    assert asked == [0, 1]


# -- Davidson's method with a rough inverse --------------------------------------------------------------------------


@pytest.fixture
def pencil(comm):
    """K^-1 with a relative error in what it answers, K with known eigenvalues and vectors, and M = 1."""
    from petsc4py import PETSc

    chance = np.random.default_rng(3)
    values = np.array([2.0, 6.1, 17.0, 20.0, 50.0, 90.0])
    Q = np.linalg.qr(chance.normal(size=(6, 6)))[0]
    noise = chance.normal(size=(6, 6))

    def inverse(error):
        rough = np.eye(6) + error * (noise + noise.T) / np.linalg.norm(noise + noise.T, 2)
        A = Q @ np.diag(values**-0.5) @ rough @ np.diag(values**-0.5) @ Q.T

        def solve(b, x, tolerance=0.0):
            x.array_w[:] = A @ b.array_r

        return solve

    K, M = (
        PETSc.Mat().createDense((6, 6), array=matrix, comm=PETSc.COMM_SELF) for matrix in (Q @ np.diag(values) @ Q.T, np.eye(6))
    )
    start = M.createVecRight()
    start.set(1.0)
    return inverse, K, M, start, Q, values


@pytest.mark.parametrize("error", [1e-6, 1e-4, 1e-3])
def test_corrections_by_a_rough_inverse_find_the_lowest_to_1e_9(pencil, error):
    inverse, K, M, start, Q, values = pencil
    found = nearest(Pencil(K.mult, M, inverse(error)), [start], [1e-5, np.inf])
    assert found.values[0] == pytest.approx(values[0], rel=1e-9)
    assert abs(found.vectors[0].array_r @ Q[:, 0]) == pytest.approx(1.0, rel=1e-9)


def test_what_is_no_mode_takes_more_corrections_than_it_is_given(pencil):
    inverse, K, M, start, Q, values = pencil
    start.array_w[:] = Q[:, 5] + 1e-3 * Q[:, 4] + 1e-9 * Q[:, 0]
    with pytest.raises(NoConvergence, match="did not converge"):
        nearest(Pencil(K.mult, M, inverse(0.0)), [start], [1e-5], most=3)
    assert nearest(Pencil(K.mult, M, inverse(1e-4)), [start], [1e-5]).values[0] == pytest.approx(values[0], rel=1e-9)
