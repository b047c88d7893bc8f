"""Davidson's method with a rough inverse."""

from __future__ import annotations

import numpy as np
import pytest

from softmodels.mechanics.newton import NoConvergence
from softmodels.path.stability import Pencil, nearest


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
        PETSc.Mat().createDense((6, 6), array=matrix, comm=PETSc.COMM_SELF)
        for matrix in (Q @ np.diag(values) @ Q.T, np.eye(6))
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
