"""Closed forms without a mesh, against formulas written out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from softmodels.materials.laws import Carroll, FungDemiray, Gent, MooneyRivlin, NeoHookean, Ogden, Polynomial, Yeoh
from softmodels.materials.specimens import balloon_limit, balloon_pressure, nominal_stress, respond, sphere_pressure
from tests.support.closed_forms import tube_pressure

L = np.array([0.6, 0.9, 1.0, 1.3, 2.0, 3.0])
MU, C10, C01, C1, C2, C3, JM = 100e3, 30e3, 10e3, 40e3, 2e3, 150.0, 40.0
OGDEN = ((0.63e6, 1.2e3, -10e3), (1.3, 5.0, -2.0))

I1 = {"uniaxial": L**2 + 2 / L, "planar": L**2 + 1 + L**-2, "equibiaxial": 2 * L**2 + L**-4}
I1_SLOPE = {"uniaxial": 2 * (L - L**-2), "planar": 2 * (L - L**-3), "equibiaxial": 2 * (L - L**-5)}
"""Rise of I1 with the stretch of one pulled side (half of the whole rise where two sides are pulled)."""
I2_SLOPE = {"uniaxial": 2 * (1 - L**-3), "planar": 2 * (L - L**-3), "equibiaxial": 2 * (L**3 - L**-3)}
LAST = {"uniaxial": -0.5, "planar": -1.0, "equibiaxial": -2.0}
"""Power of the stretch of a free side."""

modes = pytest.mark.parametrize("mode", LAST)


@modes
def test_neo_hookean(mode):
    assert nominal_stress(NeoHookean(MU), L, mode) == pytest.approx(MU / 2 * I1_SLOPE[mode], abs=1e-9 * MU)


@modes
def test_mooney_rivlin(mode):
    by_hand = C10 * I1_SLOPE[mode] + C01 * I2_SLOPE[mode]
    assert nominal_stress(MooneyRivlin(C10, C01), L, mode) == pytest.approx(by_hand, abs=1e-9 * MU)


@modes
def test_yeoh(mode):
    k = I1[mode] - 3
    by_hand = (C1 + 2 * C2 * k + 3 * C3 * k**2) * I1_SLOPE[mode]
    assert nominal_stress(Yeoh(C1, C2, C3), L, mode) == pytest.approx(by_hand, abs=1e-9 * MU)


@modes
def test_ogden(mode):
    by_hand = sum(mu * (L ** (alpha - 1) - L ** (LAST[mode] * alpha - 1)) for mu, alpha in zip(*OGDEN, strict=True))
    assert nominal_stress(Ogden(*OGDEN), L, mode) == pytest.approx(by_hand, abs=1e-9 * MU)


@modes
def test_gent(mode):
    by_hand = MU / 2 * JM / (JM - I1[mode] + 3) * I1_SLOPE[mode]
    assert nominal_stress(Gent(MU, JM), L, mode) == pytest.approx(by_hand, abs=1e-9 * MU)


def test_stress_beyond_taut_chains_is_no_number():
    assert np.isnan(nominal_stress(Gent(MU, 3.0), 3.0))
    assert np.isnan(sphere_pressure(Gent(MU, 3.0), 0.010, 0.015, 3.0))


def test_unknown_mode():
    with pytest.raises(ValueError, match="'shear' is not one of uniaxial"):
        nominal_stress(NeoHookean(MU), 1.1, "shear")


def test_uniaxial_compressible_neo_hookean():
    """The lateral stress mu (b - 1/b) + lambda (J - 1) a b of the sides b under a stretch a vanishes."""
    law = NeoHookean(MU, 0.3)
    found = respond(law, L)
    stress, side = found.stress, found.side
    J, slope = L * side**2, law.bulk * (L * side**2 - 1)
    assert MU * (side - 1 / side) + slope * L * side == pytest.approx(0.0, abs=1e-9 * MU)
    assert stress == pytest.approx(MU * (L - 1 / L) + slope * J / L, abs=1e-9 * MU)


@pytest.mark.parametrize("law", [MooneyRivlin(C10, C01, 0.3), Yeoh(C1, C2, C3, 0.45), Ogden(*OGDEN, 0.4), Gent(MU, JM, 0.2)])
def test_uniaxial_compressible_at_small_strain(law):
    found = respond(law, [1 + 1e-6])
    stress, side = found.stress, found.side
    assert stress / 1e-6 == pytest.approx(2 * law.shear_modulus_0 * (1 + law.poisson), rel=1e-4)
    assert (1 - side) / 1e-6 == pytest.approx(law.poisson, rel=1e-4)


def test_uniaxial_compressible_meets_the_incompressible_limit():
    near, limit = (respond(NeoHookean(MU, poisson), L) for poisson in (0.49999, 0.5))
    assert near.stress == pytest.approx(limit.stress, abs=2e-3 * MU)
    assert near.side == pytest.approx(limit.side, rel=1e-3)
    assert limit.stress == pytest.approx(nominal_stress(NeoHookean(MU), L))


@pytest.mark.parametrize("mode", LAST)
def test_polynomial_exponential_and_root_in_closed_form(mode):
    """S = dW/dI1 dI1/dl + dW/dI2 dI2/dl, by hand."""
    second = {"uniaxial": 2 * L + L**-2, "planar": I1["planar"], "equibiaxial": L**4 + 2 * L**-2}
    a, b, c20, c11, c02 = I1[mode] - 3, second[mode] - 3, 300.0, -50.0, 20.0
    stress = (C10 + 2 * c20 * a + c11 * b) * I1_SLOPE[mode] + (C01 + c11 * a + 2 * c02 * b) * I2_SLOPE[mode]
    assert nominal_stress(Polynomial(C10, C01, c20, c11, c02), L, mode) == pytest.approx(stress, abs=1e-9 * C10)
    stress = MU / 2 * np.exp(0.05 * a) * I1_SLOPE[mode]
    assert nominal_stress(FungDemiray(MU, 0.05), L, mode) == pytest.approx(stress, abs=1e-9 * MU)
    stress = (C10 + 4 * 0.02 * (a + 3) ** 3) * I1_SLOPE[mode] + C01 / (2 * np.sqrt(b + 3)) * I2_SLOPE[mode]
    assert nominal_stress(Carroll(C10, 0.02, C01), L, mode) == pytest.approx(stress, abs=1e-9 * C10)


# -- balloons ---------------------------------------------------------------------------------------------------------


def test_balloon_of_neo_hookean():
    assert balloon_pressure(NeoHookean(MU), L, 0.01) == pytest.approx(2 * MU * 0.01 * (L**-1 - L**-7), abs=1e-9 * MU)


def test_balloon_limit_of_neo_hookean():
    stretch, pressure = balloon_limit(NeoHookean(MU), 0.01)
    assert stretch == pytest.approx(7 ** (1 / 6), rel=1e-9)
    assert pressure == pytest.approx(2 * MU * 0.01 * (7 ** (-1 / 6) - 7 ** (-7 / 6)), rel=1e-12)


def test_balloon_limit_of_mooney_rivlin():
    """The pressure 4 t/R (l^-1 - l^-7) (c10 + c01 l^2) has a maximum only while c01/c10 is below 0.2145."""
    assert balloon_limit(MooneyRivlin(C10, 0.21 * C10), 0.01) is not None
    assert balloon_limit(MooneyRivlin(C10, 0.22 * C10), 0.01) is None


def test_balloon_limit_is_a_maximum():
    law = Ogden(*OGDEN)
    stretch, pressure = balloon_limit(law, 0.02)
    assert (balloon_pressure(law, stretch * np.array([0.99, 1.01]), 0.02) < pressure).all()


# -- thick walls ------------------------------------------------------------------------------------------------------

INNER, OUTER = 0.010, 0.015
STRETCH = np.array([0.8, 1.0, 1.05, 1.5, 2.5])


def outer_stretch(power):
    return (1 + (STRETCH**power - 1) * (INNER / OUTER) ** power) ** (1 / power)


def test_sphere_of_neo_hookean():
    """The integral of 2 mu (l^3 + 1) / l^5 has the antiderivative -mu (2/l + 1/(2 l^4))."""

    def upper(stretch):
        return -MU * (2 / stretch + 1 / (2 * stretch**4))

    by_hand = upper(STRETCH) - upper(outer_stretch(3))
    assert sphere_pressure(NeoHookean(MU), INNER, OUTER, STRETCH) == pytest.approx(by_hand, abs=1e-9 * MU)


def test_tube_of_neo_hookean():
    """The integral of mu (l^2 + 1) / l^3 has the antiderivative mu (ln l - 1/(2 l^2))."""

    def upper(stretch):
        return MU * (np.log(stretch) - 1 / (2 * stretch**2))

    by_hand = upper(STRETCH) - upper(outer_stretch(2))
    assert tube_pressure(NeoHookean(MU), INNER, OUTER, STRETCH) == pytest.approx(by_hand, abs=1e-9 * MU)


@pytest.mark.parametrize("law", [Yeoh(C1, C2, C3), Ogden(*OGDEN), Gent(MU, JM), MooneyRivlin(C10, C01)])
def test_small_strain_is_lame(law):
    """Sphere: P = 4 mu e (1 - A^3/B^3); tube: P = 2 mu e (1 - A^2/B^2), with e the inner wall's hoop strain."""
    e, mu, ratio = 1e-7, law.shear_modulus_0, INNER / OUTER
    assert sphere_pressure(law, INNER, OUTER, 1 + e) == pytest.approx(4 * mu * e * (1 - ratio**3), rel=1e-5)
    assert tube_pressure(law, INNER, OUTER, 1 + e) == pytest.approx(2 * mu * e * (1 - ratio**2), rel=1e-5)


@pytest.mark.parametrize("thin", [0.02, 0.01])
def test_thin_sphere_is_a_balloon(thin):
    """At the same stretch of the middle surface the two differ by a term of (t/R)^2."""
    law, middle = NeoHookean(MU), 1.4
    inner, outer = 1 - thin / 2, 1 + thin / 2
    at_inner = (1 + (middle**3 - 1) / inner**3) ** (1 / 3)
    thick, membrane = sphere_pressure(law, inner, outer, at_inner), balloon_pressure(law, middle, thin)
    assert thick == pytest.approx(float(membrane), rel=0.2 * thin**2)


def test_no_stretch_needs_no_pressure():
    assert math.isclose(float(sphere_pressure(NeoHookean(MU), INNER, OUTER, 1.0)), 0.0, abs_tol=1e-9)
