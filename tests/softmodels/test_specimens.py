"""Stress of specimens and its slopes: by hand, by Taylor's rule for every parameter of every law, and at the limits."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import erf

from softmodels.materials.laws import (
    LAWS,
    Carroll,
    FungDemiray,
    Gent,
    HomogeneousStrain,
    MooneyRivlin,
    NeoHookean,
    Ogden,
    Polynomial,
    Yeoh,
)
from softmodels.materials.memory import Branch, Memory, Softening
from softmodels.materials.specimens import (
    MODE_NAMES,
    MODES,
    log_strain_stiffness,
    nominal_stress,
    nudged,
    respond,
    stress_in_time,
)

L = np.array([0.6, 0.9, 1.0, 1.3, 2.0, 3.0])
EXAMPLES = {
    "neo-hookean": NeoHookean(30e3, 0.5),
    "mooney-rivlin": MooneyRivlin(10e3, 5e3, 0.5),
    "yeoh": Yeoh(15e3, 1e3, 50.0, 0.5),
    "ogden": Ogden((0.63e6, 1.2e3, -10e3), (1.3, 5.0, -2.0), 0.5),
    "carroll": Carroll(10e3, 0.02, 9e3, 0.5),
    "gent": Gent(30e3, 40.0, 0.5),
    "polynomial": Polynomial(10e3, 5e3, 300.0, -50.0, 20.0, 0.5),
    "fung-demiray": FungDemiray(30e3, 0.05, 0.5),
}
modes = pytest.mark.parametrize("mode", MODES)
every = pytest.mark.parametrize(("name", "parameter"), [(name, p) for name, law in EXAMPLES.items() for p in law.parameters])


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
    if parameter.startswith(("alpha", "limit", "stiffening")) or (poisson < 0.5 and parameter != "shear_modulus"):
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
    assert respond(Yeoh(1e4, 50.0, 3.0, 0.5), L, "uniaxial", ("c1", "c2", "c3")).slopes == pytest.approx(by_hand, abs=1e-9)
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


# -- Specimens of silicone with a memory: against ordinary differential equations in time, and slopes by Taylor's ru--


PULL = (np.linspace(0.0, 80.0, 51), 1.0 + 0.05 * (40.0 - np.abs(np.linspace(-40.0, 40.0, 51))))
HOLD = (
    np.r_[np.linspace(0.0, 2.0, 11), 2.0 + np.geomspace(0.1, 200.0, 40)],
    np.r_[np.linspace(1.0, 2.5, 11), np.full(40, 2.5)],
)
CYCLES = (np.linspace(0.0, 12.0, 51), 1.5 - 0.5 * np.cos(np.linspace(0.0, 6 * np.pi, 51)))
HISTORIES = {"pull and return": PULL, "hold": HOLD, "cycles": CYCLES}


def by_equations(law, shares, taus, time, stretch, mode):
    """The law's stress, and that of branches by a stiff solver at tight tolerance, corner by corner."""
    powers, sides = np.array(MODES[mode][0]), MODES[mode][1]
    total = nominal_stress(law, stretch, mode)
    for share, tau in zip(shares, taus, strict=True):
        Cv, found = np.ones(3), [0.0]
        for (t0, t1), (x0, x1) in zip(itertools.pairwise(time), itertools.pairwise(stretch), strict=True):

            def slope(t, y, t0=t0, t1=t1, x0=x0, x1=x1, tau=tau):
                C = (x0 + (x1 - x0) * (t - t0) / (t1 - t0)) ** (2 * powers)
                return (C - np.sum(C / y) / 3 * y) / tau

            Cv = solve_ivp(slope, (t0, t1), Cv, rtol=1e-9, atol=1e-10, method="LSODA").y[:, -1]
            found.append(np.sum(powers * x1 ** (2 * powers - 1) / Cv) / sides)
        total = total + share * law.shear_modulus_0 * np.array(found)
    return total


@pytest.mark.parametrize("mode", MODE_NAMES)
@pytest.mark.parametrize("history", HISTORIES)
def test_stress_within_1e_4_of_an_ode_solver(history, mode, figure):
    law, shares, taus = Yeoh(8e3, 90.0, 0.5, 0.5), (0.5, 0.3, 0.2), (0.3, 5.0, 60.0)
    time, stretch = HISTORIES[history]
    stress, _ = stress_in_time(law.with_memory(list(zip(shares, taus, strict=True))), time, stretch, mode)
    exact = by_equations(law, shares, taus, time, stretch, mode)
    figure("solve_ivp", f"{mode} stress through a {history}, over the largest", (stress - exact) / exact.max(), 1e-4)


def test_the_limits_are_the_law_and_its_springs():
    """No time: every branch is relaxed. A jump: none is."""
    law = NeoHookean(30e3, 0.5)
    remembering, stretch = law.with_memory([(0.4, 1.0), (0.2, 30.0)]), np.linspace(0.7, 3.0, 20)
    for mode in MODE_NAMES:
        static = respond(law, stretch, mode).stress
        assert stress_in_time(remembering, None, stretch, mode)[0] == pytest.approx(static, rel=1e-14)
        assert stress_in_time(law, np.arange(20.0), stretch, mode)[0] == pytest.approx(static, rel=1e-14)
        jump = stress_in_time(remembering, [0.0, 0.0, 1e6], [1.0, 2.0, 2.0], mode)[0]
        at = respond(law, [2.0], mode).stress[0]
        assert jump == pytest.approx([0.0, 1.6 * at, at], rel=1e-9, abs=1e-8)
        begun = stress_in_time(remembering, [0.0, 1e6], [2.0, 2.0], mode)[0]
        assert begun == pytest.approx([1.6 * at, at], rel=1e-9)


def test_softening_is_what_ogden_and_roxburgh_write():
    """Second loading on the path of the unloading, and the largest energy recovers with the equation of its decay."""
    law, stretch = (
        NeoHookean(30e3, 0.5),
        np.r_[np.linspace(1, 2, 11), np.linspace(1.9, 1, 10), np.linspace(1.1, 2.5, 15)],
    )
    plain = law.with_memory(softening=(1.6, 2e3, 0.1))
    time = np.arange(float(len(stretch)))
    stress, _ = stress_in_time(plain, time, stretch)
    assert stress[:11] == pytest.approx(nominal_stress(law, stretch[:11]), rel=1e-14)
    assert stress[21:30] == pytest.approx(stress[19:10:-1], rel=1e-12)
    assert stress[31:] == pytest.approx(nominal_stress(law, stretch[31:]), rel=1e-12)

    def W(x):
        return 15e3 * (x**2 + 2 / x - 3)

    left = 1 - erf((W(2.0) - W(1.5)) / (2e3 + 0.1 * W(2.0))) / 1.6
    assert stress[15] == pytest.approx(left * float(nominal_stress(law, 1.5)), rel=1e-12)
    recovering = law.with_memory(softening=(1.6, 2e3, 0.1, 50.0))
    held = stress_in_time(recovering, [0.0, 1.0, 2.0, 102.0], [1.0, 2.0, 1.5, 1.5])[0]
    rise = W(1.5) - W(2.0)
    above = -rise * (1 - np.exp(-1 / 50.0)) * 50.0 * np.exp(-2.0)
    Wm = W(1.5) + above
    assert held[3] == pytest.approx((1 - erf(above / (2e3 + 0.1 * Wm)) / 1.6) * float(nominal_stress(law, 1.5)), rel=1e-12)


EQUILIBRIUM_LAWS = (
    NeoHookean(30e3, 0.5),
    Yeoh(8e3, 90.0, 0.5, 0.5),
    Gent(30e3, 40.0, 0.5),
    Ogden((20e3, 100.0), (1.3, 5.0), 0.5),
)


@pytest.mark.parametrize("law", EQUILIBRIUM_LAWS, ids=lambda law: law.name)
@pytest.mark.parametrize("recovery", [np.inf, 20.0])
def test_slopes_by_taylors_rule(law, recovery):
    """The rest after the slope falls as the square of the step, for every parameter of law, branches and softening."""
    time, stretch = CYCLES
    soft = {"softening": 0.5, "softening_m": 2e3, "softening_beta": 0.1}
    values = {**law.parameters, "share1": 0.3, "share2": 0.1, **soft}

    def stress(v):
        made = type(law).from_parameters(v, law.terms)
        branches = (Branch(v["share1"], 0.4), Branch(v["share2"], 7.0))
        softening = Softening(1 / v["softening"], v["softening_m"], v["softening_beta"], recovery)
        return stress_in_time(
            dataclasses.replace(made, memory=Memory(branches, softening)), time, stretch, parameters=list(values)
        )

    base, slopes = stress(values)
    for i, name in enumerate(values):
        rests = []
        for step in (4e-3, 2e-3):
            by = step * values[name]
            rests.append(np.abs(stress({**values, name: values[name] + by})[0] - base - by * slopes[:, i]).max())
        assert rests[0] < 1e-9 * np.abs(base).max() or rests[0] / rests[1] == pytest.approx(4.0, rel=0.1), name
