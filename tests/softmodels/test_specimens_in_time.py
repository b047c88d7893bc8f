"""Specimens of silicone with a memory: against ordinary differential equations in time, and slopes by Taylor's rule."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import erf

from softmodels.materials.laws import Gent, NeoHookean, Ogden, Yeoh
from softmodels.materials.memory import Branch, Memory, Softening
from softmodels.materials.specimens import MODE_NAMES, MODES, nominal_stress, respond, stress_in_time

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
    assert held[3] == pytest.approx(
        (1 - erf(above / (2e3 + 0.1 * Wm)) / 1.6) * float(nominal_stress(law, 1.5)), rel=1e-12
    )


LAWS = (NeoHookean(30e3, 0.5), Yeoh(8e3, 90.0, 0.5, 0.5), Gent(30e3, 40.0, 0.5), Ogden((20e3, 100.0), (1.3, 5.0), 0.5))


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
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
