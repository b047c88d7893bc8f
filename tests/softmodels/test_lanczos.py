"""Small symmetric eigenproblems, against SciPy's."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

from softmodels.path.lanczos import generalised


@pytest.mark.parametrize("size", [1, 2, 7])
def test_a_pair_of_matrices_has_the_values_of_another_library(size):
    chance = np.random.default_rng(size)
    A, B = chance.normal(size=(2, size, size))
    A, C = A + A.T, B @ B.T + np.eye(size)
    values, vectors = generalised(A, C)
    assert values == pytest.approx(scipy.linalg.eigh(A, C, eigvals_only=True), rel=1e-12, abs=1e-12)
    assert np.allclose(A @ vectors, C @ vectors * values, atol=1e-12)
    assert np.allclose(vectors.T @ C @ vectors, np.eye(size), atol=1e-12)
