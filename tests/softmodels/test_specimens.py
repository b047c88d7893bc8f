"""Stress of specimens and its slopes: by hand, by Taylor's rule for every parameter of every law, and at the limits."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from softmodels.materials.laws import LAWS, Gent, MooneyRivlin, NeoHookean, Ogden, Yeoh
from softmodels.materials.specimens import MODES, log_strain_stiffness, nominal_stress, nudged, respond
from softmodels.materials.strain import HomogeneousStrain

L = np.array([0.6, 0.9, 1.0, 1.3, 2.0, 3.0])
EXAMPLES = {
    "neo-hookean": NeoHookean(30e3, 0.5),
    "mooney-rivlin": MooneyRivlin(10e3, 5e3, 0.5),
    "yeoh": Yeoh(15e3, 1e3, 50.0, 0.5),
    "ogden": Ogden((0.63e6, 1.2e3, -10e3), (1.3, 5.0, -2.0), 0.5),
    "gent": Gent(30e3, 40.0, 0.5),
}
modes = pytest.mark.parametrize("mode", MODES)
every = pytest.mark.parametrize(
    ("name", "parameter"), [(name, p) for name, law in EXAMPLES.items() for p in law.parameters]
)


def test_every_law_is_here():
    assert set(EXAMPLES) == set(LAWS)


@modes
@pytest.mark.parametrize("name", EXAMPLES)
def test_stress_is_that_of_the_closed_forms(name, mode):
    law = EXAMPLES[name]
    assert respond(law, L, mode).stress == pytest.approx(nominal_stress(law, L, mode), abs=1e-9 * law.shear_modulus_0)


@pytest.mark.parametrize("name", EXAMPLES)
def test_compressible_stress_is_that_of_the_closed_forms(name):
    """By a complex step through the energy: of the pulled side, and nothing of the free ones."""
    law, h = dataclasses.replace(EXAMPLES[name], poisson=0.4), 1e-30
    found = respond(law, L)
    pulled = np.imag(law.energy(HomogeneousStrain((L + 1j * h, found.side, found.side)))) / h
    free = np.imag(law.energy(HomogeneousStrain((L, found.side + 1j * h, found.side)))) / h
    assert found.stress == pytest.approx(pulled, abs=1e-9 * law.shear_modulus_0)
    assert free == pytest.approx(0.0, abs=1e-9 * law.shear_modulus_0)


def remainders(law, mode, parameter, sizes):
    """Largest remainder of the first-order Taylor expansion, relative to the stress, at each size of step."""
    here = respond(law, L, mode, (parameter,))
    value = getattr(law, parameter, None)
    if value is None:
        value = getattr(law, parameter.rstrip("123"))[int(parameter[-1]) - 1]
    found = []
    for size in sizes:
        step = size * abs(value)
        there = respond(nudged(law, parameter, step), L, mode)
        left = there.stress - here.stress - step * here.slopes[:, 0]
        found.append(np.abs(left).max() / np.abs(here.stress).max())
    return np.array(found), np.abs(here.slopes[:, 0]).max() * abs(value) / np.abs(here.stress).max()


@modes
@pytest.mark.parametrize("poisson", [0.5, 0.4])
@every
def test_slopes_follow_taylor(name, parameter, poisson, mode):
    """The remainder falls with the square of the step, or is rounding where the law is linear in the parameter."""
    law = dataclasses.replace(EXAMPLES[name], poisson=poisson)
    left, first = remainders(law, mode, parameter, (4e-3, 2e-3, 1e-3))
    assert first > 1e-4, "the parameter must matter for the test to mean anything"
    rates = np.log2(left[:-1] / left[1:])
    # A side's stretch of a compressible law depends on each of several parameters.
    if parameter.startswith(("alpha", "limit")) or (poisson < 0.5 and parameter != "shear_modulus"):
        assert rates == pytest.approx(2.0, abs=0.05), (left, rates)
    else:
        assert (left < 1e-11).all(), left


@pytest.mark.parametrize("name", EXAMPLES)
def test_slope_by_poisson_follows_taylor(name):
    law = dataclasses.replace(EXAMPLES[name], poisson=0.4)
    left, _ = remainders(law, "planar", "poisson", (4e-3, 2e-3, 1e-3))
    assert np.log2(left[:-1] / left[1:]) == pytest.approx(2.0, abs=0.05)


@modes
@pytest.mark.parametrize("poisson", [0.5, 0.45])
@pytest.mark.parametrize("name", EXAMPLES)
def test_tangent_follows_taylor(name, poisson, mode):
    law = dataclasses.replace(EXAMPLES[name], poisson=poisson)
    here = respond(law, L, mode)
    left = [np.abs(respond(law, L + h, mode).stress - here.stress - h * here.tangent).max() for h in (2e-3, 1e-3)]
    assert np.log2(left[0] / left[1]) == pytest.approx(2.0, abs=0.05)


def test_slopes_by_hand():
    """Yeoh: dS/dc_i = i k^(i-1) 2 (l - 1/l^2); Ogden: dS/dmu = l^(a-1) - l^(-a/2-1), dS/dalpha by the product rule."""
    k = L**2 + 2 / L - 3
    by_hand = np.column_stack([i * k ** (i - 1) * 2 * (L - L**-2) for i in (1, 2, 3)])
    assert respond(Yeoh(1e4, 50.0, 3.0, 0.5), L, "uniaxial", ("c1", "c2", "c3")).slopes == pytest.approx(
        by_hand, abs=1e-9
    )
    a, mu = 1.7, 2e4
    by_mu = L ** (a - 1) - L ** (-a / 2 - 1)
    by_alpha = mu * np.log(L) * (L ** (a - 1) + L ** (-a / 2 - 1) / 2)
    found = respond(Ogden((mu,), (a,), 0.5), L, "uniaxial", ("mu1", "alpha1")).slopes
    assert found == pytest.approx(np.column_stack([by_mu, by_alpha]), abs=1e-8)


@pytest.mark.parametrize("poisson", [0.5, 0.45])
def test_beyond_taut_chains_nothing_is_a_number(poisson):
    found = respond(Gent(30e3, 3.0, poisson), np.array([1.5, 3.0]), "uniaxial", ("limit",))
    for part in (found.stress, found.tangent, found.slopes[:, 0]):
        assert np.isfinite(part[0]) and np.isnan(part[1])


@modes
def test_compressible_meets_the_incompressible_limit(mode):
    near = respond(NeoHookean(30e3, 0.49999), L, mode)
    limit = respond(NeoHookean(30e3, 0.5), L, mode)
    assert near.stress == pytest.approx(limit.stress, rel=1e-3, abs=1e-9 * 30e3)
    assert near.tangent == pytest.approx(limit.tangent, rel=2e-3)


def test_stiffness_of_neo_hookean():
    """W = mu/2 (e^2a + e^2b + e^-2(a+b)): its Hessian is 2 mu (e^2a + e^-2(a+b)) and so on, off the diagonal 2 mu e^-2(a+b)."""
    H, k = log_strain_stiffness(NeoHookean(30e3, 0.5), L, "equibiaxial")
    by_hand = 2 * 30e3 * (L**2 + L**-4)
    assert H[:, 0, 0] == pytest.approx(by_hand) and H[:, 1, 1] == pytest.approx(by_hand)
    assert H[:, 0, 1] == pytest.approx(2 * 30e3 * L**-4)
    assert k == pytest.approx(2 * L**2 + L**-4 - 3)


def test_unknown_mode():
    with pytest.raises(ValueError, match="'shear' is not one of uniaxial"):
        respond(NeoHookean(30e3), 1.1, "shear")


def test_a_stress_alone_asks_for_one_real_energy(monkeypatch):
    """A fit asks for stresses thousands of times: no second energy for a slope that nobody wants, and no complex stretches."""
    asked = []

    def shape(strain, m):
        asked.append([np.iscomplexobj(side.value) for side in strain.stretches])
        return original(strain, m)

    original = Ogden.shape
    monkeypatch.setattr(Ogden, "shape", staticmethod(shape))
    law, stretch = Ogden((15e3, 30.0), (1.4, 5.5), 0.5), np.linspace(1.0, 4.0, 20)
    assert np.isfinite(respond(law, stretch).stress).all()
    assert asked == [[False] * 3]
    asked.clear()
    assert np.isfinite(respond(law, stretch, "uniaxial", ("mu1", "alpha1", "mu2", "alpha2")).slopes).all()
    assert asked == [[False] * 3] * 5
