"""Strain measures: UFL's and numpy's are the same numbers."""

from __future__ import annotations

import numpy as np
import pytest

from softmodels.materials.strain import HomogeneousStrain, Strain, eigenvalues

STRETCHES = (1.3, 0.9, 1.1)
NAMES = ("J", "I1", "I2", "I1_bar", "I2_bar")


@pytest.fixture(scope="module")
def turned():
    """F with the principal stretches `STRETCHES` in slanted directions, then turned."""
    generator = np.random.default_rng(3)
    left, right = (np.linalg.qr(generator.standard_normal((3, 3)))[0] for _ in range(2))
    F = left @ np.diag(STRETCHES) @ right
    return F * np.sign(np.linalg.det(F))


def ufl_value(expression):
    """Number of a UFL expression of constants."""
    return float(expression(()))


@pytest.fixture(scope="module")
def strain(comm, turned):
    import ufl

    return Strain(ufl.as_matrix(turned.tolist()))


@pytest.mark.parametrize("name", NAMES)
def test_invariants_of_a_turned_gradient(name, strain):
    assert ufl_value(getattr(strain, name)) == pytest.approx(getattr(HomogeneousStrain(STRETCHES), name), rel=1e-13)


def test_isochoric_stretches(strain):
    exact = sorted(HomogeneousStrain(STRETCHES).stretches_bar)
    assert sorted(map(ufl_value, strain.stretches_bar)) == pytest.approx(exact, rel=1e-7)
    assert np.prod(exact) == pytest.approx(1.0, rel=1e-14)


@pytest.mark.parametrize(
    "values",
    [(1.0, 1.0, 1.0), (1.5, 1.5, 0.7), (1.5, 0.8, 0.8), (1.0 + 1e-6, 1.0, 1.0), (4.0, 0.5, 0.5), (9.0, 1.0, 0.1)],
)
def test_eigenvalues_where_they_coincide(comm, values):
    """A single one of a repeated pair is off by the gap; sums of powers over all three by its square alone."""
    import ufl

    found = [ufl_value(value) for value in eigenvalues(ufl.as_matrix(np.diag(values).tolist()))]
    assert sum(found) == pytest.approx(sum(values), rel=1e-14)
    assert sorted(found) == pytest.approx(sorted(values), abs=1e-3)
    for power in (0.65, 2.5, -1.0):
        exact = sum(value**power for value in values)
        assert sum(value**power for value in found) == pytest.approx(exact, abs=2e-6 * exact)


def test_homogeneous_strain_takes_arrays_and_complex_numbers():
    stretch = np.array([1.0, 2.0]) + 1e-30j
    strain = HomogeneousStrain((stretch, stretch**-0.5, stretch**-0.5))
    assert np.real(strain.J) == pytest.approx(1.0)
    assert np.imag(strain.I1) / 1e-30 == pytest.approx([0.0, 2 * 2 - 2 / 4])
