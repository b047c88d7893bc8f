"""Small symmetric eigenproblems, against SciPy's."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

from softmodels.mechanics.newton import NoConvergence
from softmodels.path.stability import Pencil, generalised, lowest, nearest


@pytest.mark.parametrize("size", [1, 2, 7])
def test_a_pair_of_matrices_has_the_values_of_another_library(size):
    chance = np.random.default_rng(size)
    A, B = chance.normal(size=(2, size, size))
    A, C = A + A.T, B @ B.T + np.eye(size)
    values, vectors = generalised(A, C)
    assert values == pytest.approx(scipy.linalg.eigh(A, C, eigvals_only=True), rel=1e-12, abs=1e-12)
    assert np.allclose(A @ vectors, C @ vectors * values, atol=1e-12)
    assert np.allclose(vectors.T @ C @ vectors, np.eye(size), atol=1e-12)


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
    rough, found = lowest(inverse(error), M, start, 0, 2, 1e-3)
    if error > 1e-5:
        assert rough != pytest.approx(values[0], rel=1e-7)  # by itself it is not good enough
    corrected = nearest(Pencil(K.mult, M, inverse(error)), found, [1e-5, np.inf], most=4)
    assert corrected.values[0] == pytest.approx(values[0], rel=1e-9)
    assert abs(corrected.vectors[0].array_r @ Q[:, 0]) == pytest.approx(1.0, rel=1e-9)


def test_what_is_no_mode_takes_more_corrections_than_it_is_given(pencil):
    inverse, K, M, start, Q, values = pencil
    start.array_w[:] = Q[:, 5] + 1e-3 * Q[:, 4] + 1e-9 * Q[:, 0]
    with pytest.raises(NoConvergence, match="did not converge"):
        nearest(Pencil(K.mult, M, inverse(0.0)), [start], [1e-5], most=3)
    assert nearest(Pencil(K.mult, M, inverse(1e-4)), [start], [1e-5]).values[0] == pytest.approx(values[0], rel=1e-9)
