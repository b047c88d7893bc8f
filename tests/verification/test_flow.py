"""Branches whose viscosity depends on stress and creep, with springs of I1 (Kumar and Lopez-Pamies 2016).

The figures for VHB 4910 are theirs (doi 10.1016/j.crme.2015.11.004): kPa and s.
"""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from softmodels.common.units import HALF_WIDTH_95
from softmodels.fitting.curves.curve import TensileCurve
from softmodels.fitting.curves.fit import fit_curves
from softmodels.fitting.curves.residuals import predicted, slopes_of
from softmodels.fitting.problem import FitOptions
from softmodels.materials import memory
from softmodels.materials.laws import Gent, NeoHookean
from softmodels.materials.memory import InNumpy, Memory
from softmodels.materials.specimens import MODES, branch_stress, respond, stress_in_time
from softmodels.path.steps import STRESS_TOLERANCE
from tests.support import bodies
from tests.support.campaigns import sampled
from tests.verification.test_memory import MU, REST, SPHERE, entries, followed, strain, tensor, unimodular, wall_volume

ODE = "ordinary differential equation of Kumar and Lopez-Pamies' branch"
WALL = "closed integral through the wall of a sphere, with the equation of Kumar and Lopez-Pamies' branch in time"
SET = "closed integral through the wall of a sphere, with the equation of a branch that flows above a stress"
LAW = ((13.54, 1.0), (1.08, -2.474))
SPRING = ((5.42, -10.0), (20.78, 1.948))
G = sum(m for m, _ in SPRING)
ETA0, ETA_INF, BETA1, BETA2, K1, K2 = 7014.0, 0.1, 1.852, 0.26, 3507.0, 1.0
VHB = Memory.of(
    [
        {
            "share": G / 14.62,
            "time": ETA0 / G,
            "onset": K2**-0.5 / G,
            "exponent": BETA2,
            "least": ETA_INF / ETA0,
            "growth": K1 * 3**BETA1 / ETA0,
            "growth_exponent": BETA1,
            "spring": [[m / G, a] for m, a in SPRING],
        }
    ]
).branches[0]


def stiffness(terms, I1):
    return sum(m * (I1 / 3) ** (a - 1) for m, a in terms)


def rate(C, Cv):
    """Rate of Cv, both 3 x 3, as the paper has it."""
    B = C @ np.linalg.inv(Cv)
    I1, I2 = np.trace(B), (np.trace(B) ** 2 - np.trace(B @ B)) / 2
    m = stiffness(SPRING, I1)
    thinned = 1 + (K2 * max(I1**2 / 3 - I2, 0.0) * m**2) ** BETA2
    eta = ETA_INF + (ETA0 - ETA_INF + K1 * (np.trace(Cv) ** BETA1 - 3**BETA1)) / thinned
    return m / eta * (C - I1 / 3 * Cv)


def integrated(C, corners):
    """Cv in time of a history C(t) with kinks at some times."""
    y, pieces = np.array(memory.IDENTITY), []
    for low, high in itertools.pairwise(corners):
        slope = lambda t, y: entries(rate(C(t), tensor(y)))  # noqa: E731
        pieces.append(solve_ivp(slope, (low, high), y, "LSODA", rtol=1e-10, atol=1e-12, dense_output=True))
        y = pieces[-1].y[:, -1]
    return lambda t: tensor(next(p for p in pieces if t <= p.t[-1] + 1e-9).sol(t))


def in_steps(C, count, end):
    """Stress over G of each of so many equal steps, as their energies have it, and Cv at the end."""
    Cv, stresses = np.array(memory.IDENTITY), []
    for t0, t1 in itertools.pairwise(np.linspace(0.0, end, count + 1)):
        C0, C1, x = entries(C(t0)), entries(C(t1)), (t1 - t0) / VHB.time
        H, b = memory.step_of(C0, Cv, x * memory.fluidity(C0, Cv, VHB, InNumpy), InNumpy)
        shift = 3 * memory.growth(C0, memory.crept(C0, H, b)) - memory.step_invariant(C0, H, b)
        g = memory.spring_stiffness(memory.step_invariant(C1, H, b) + shift, VHB.spring)
        stresses.append(g * np.linalg.inv(tensor(memory.crept(C1, H, b))))
        Cv = np.array(memory.crept(C1, *memory.corrected_step(C0, C1, Cv, x, VHB, InNumpy)))
    return np.array(stresses), tensor(Cv)


def test_stress_and_creep_converge_with_the_square_of_the_step(figure):
    """A history in which the axes turn."""

    def C(t):
        return strain(t / 5)

    exact, counts = integrated(C, (0.0, 40.0)), (40, 80, 160, 320)
    stress_errors, creep_errors = [], []
    for count in counts:
        stresses, Cv = in_steps(C, count, 40.0)
        creep_errors.append(np.abs(Cv - exact(40.0)).max())
        off = []
        for t, S in zip(np.linspace(0.0, 40.0, count + 1)[1:], stresses, strict=True):
            inverse = np.linalg.inv(exact(t))
            off.append(np.abs(S - stiffness(VHB.spring, np.trace(C(t) @ inverse)) * inverse).max())
        stress_errors.append(max(off))
    figure(ODE, "Cv after 320 steps", creep_errors[-1], 1e-5)
    figure(ODE, "stress in 320 steps, over G", stress_errors[-1], 1.5e-5)
    for name, errors in (("Cv", creep_errors), ("stress", stress_errors)):
        figure(ODE, f"order of the step, less 2: {name}", np.log2(np.array(errors[:-1]) / errors[1:]) - 2.0, 0.03)


@pytest.mark.parametrize("mode", list(MODES))
def test_pull_and_return_of_vhb(mode, shared_data, figure):
    """Stretch 1 to 3 in 40 s and back: the equation, and the solutions published with the authors' subroutine.

    Those are of a slightly compressible specimen (J to 1.0015), at 41 times.
    """
    powers = np.array(MODES[mode][0])
    bound, published_bound = (1e-4, 6e-3) if mode == "equibiaxial" else (3e-5, 2.5e-3)

    def sides(t):
        return (1 + 0.05 * min(t, 80.0 - t)) ** (2 * powers)

    times = np.linspace(0.0, 80.0, 41)
    stretch = 1 + 0.05 * np.minimum(times, 80.0 - times)
    exact, shares = integrated(lambda t: np.diag(sides(t)), (0.0, 40.0, 80.0)), []
    for t in times:
        C, Cv = sides(t), np.diag(exact(t))
        be = stiffness(SPRING, np.sum(C / Cv)) * C / Cv
        shares.append((be[0] - be[2]) / G)
    found = branch_stress(times, stretch, mode, [VHB])[:, 0] * stretch
    figure(ODE, f"stress of VHB in 40 intervals, {mode}", (found - shares) / np.abs(shares).max(), bound)
    table = np.genfromtxt(shared_data("memory") / f"klp_{mode}.csv", delimiter=",", names=True)
    law = np.array([stiffness(LAW, np.sum(C)) * (C[0] - C[2]) for C in map(sides, times)])
    published = 1e3 * table["S11" if mode == "equibiaxial" else "S22"]
    off = (law + G * found - published) / published.max()
    figure("published solutions of VHB 4910", f"Cauchy stress, {mode}", off, published_bound)


def test_the_spring_of_a_step_is_a_potential(figure):
    generator = np.random.default_rng(5)
    C0, before, C1 = (unimodular(np.eye(3) + 0.3 * (A @ A.T)) for A in generator.normal(size=(3, 3, 3)))
    Cv = memory.crept(entries(before), *memory.step_of(list(memory.IDENTITY), list(memory.IDENTITY), 0.7, InNumpy))
    change, J = np.array([[0.1, 0.2, 0.0], [0.2, -0.05, 0.3], [0.0, 0.3, -0.05]]), 1.3
    C = J ** (2 / 3) * C1
    for x in (0.0, 1e-9, 0.5, 50.0):
        H, b = memory.step_of(entries(C0), Cv, x, InNumpy)
        moved = C + 1e-30j * change
        slope = np.imag(memory.step_invariant(entries(np.linalg.det(moved) ** (-1 / 3) * moved), H, b)) / 1e-30
        inverse = np.linalg.inv(tensor(memory.crept(entries(C1), H, b)))
        isochoric = J ** (-2 / 3) * (change - np.trace(np.linalg.solve(C, change)) / 3 * C)
        off = (slope - np.sum(inverse * isochoric)) / np.abs(inverse).max()
        figure("Cv^-1", "derivative of a step's invariant", off, 1e-12)
        if not x:
            assert memory.step_invariant(entries(C1), H, b) == pytest.approx(3 * memory.growth(entries(C1), Cv))


@pytest.mark.parametrize("x", [0.0, 1e-3, 0.5, 50.0])
def test_the_stiffness_of_a_spring_is_the_derivative_of_its_stress(x, figure):
    """By a complex step along a change that keeps the volume."""
    generator = np.random.default_rng(6)
    C0, before, C = (unimodular(np.eye(3) + 0.3 * (A @ A.T)) for A in generator.normal(size=(3, 3, 3)))
    Cv = memory.crept(entries(before), *memory.step_of(list(memory.IDENTITY), list(memory.IDENTITY), 0.7, InNumpy))
    H, b = memory.step_of(entries(C0), Cv, x, InNumpy)
    change = np.array([[0.1, 0.2, 0.0], [0.2, -0.05, 0.3], [0.0, 0.3, -0.05]])
    change -= np.trace(np.linalg.solve(C, change)) / 3 * C
    spring, shift = ((0.7, 1.4), (0.3, -2.0)), 0.3
    lower = memory.step_stiffness(entries(C), H, b, spring, shift)
    whole = np.array([[lower[max(p, q)][min(p, q)] for q in range(6)] for p in range(6)])
    predicted = [memory.contracted(row, entries(change)) for row in whole]
    moved = memory.step_stress(entries(C + 1e-30j * change), H, b, spring, shift)
    size = np.abs(memory.step_stress(entries(C), H, b, spring, shift)).max()
    figure("derivative of its stress", "stiffness of a branch's spring", (np.imag(moved) / 1e-30 - predicted) / size, 1e-12)


# -- devices ----------------------------------------------------------------------------------------------------------

SOFT = NeoHookean(MU, 0.5).with_memory(branches=[dataclasses.replace(VHB, time=20.0), (0.2, 3.0)])


@pytest.mark.campaign
@pytest.mark.parametrize(("tolerance", "bound"), sampled([(5e-5, 2.5e-4), (1e-6, 8e-5)]), ids=["default", "fine"])
def test_a_thick_sphere_filled_held_and_emptied(tolerance, bound, body_of, figure):
    """Filled in 3 s to 1.8 times its inner radius, held for 7 s and let out in 1 s to 1.3 times."""
    flow, linear = SOFT.memory.branches
    large, small = ((stretch**3 - 1) * REST for stretch in (1.8, 1.3))
    tables = {"cavity1": {"volume_ml": [large * 1e6, large * 1e6, small * 1e6]}, "time_s": [3.0, 10.0, 11.0]}
    (times, pressures, *_), end = followed(body_of(SPHERE), SOFT, tables, tolerance)
    assert end is None and times[-1] == 11.0
    points, weights = np.polynomial.legendre.leggauss(8)
    middle, half = (SPHERE.outer + SPHERE.inner) / 2, (SPHERE.outer - SPHERE.inner) / 2
    pressure = 0.0
    for R, weight in zip(middle + half * points, weights, strict=True):

        def stretch(t, R=R):
            volume = np.interp(t, [0, 3, 10, 11], [0, large, large, small])
            return (1.0 + (volume / REST) * (SPHERE.inner / R) ** 3) ** (1 / 3)

        def sides(t, stretch=stretch):
            return np.array([stretch(t) ** -4, stretch(t) ** 2, stretch(t) ** 2])

        difference = MU * np.array([sides(t)[1] - sides(t)[0] for t in times])
        for branch in (flow, linear):
            Cv = diagonal(branch, sides, (0.0, 3.0, 10.0, 11.0))
            be = np.array([sides(t) / Cv(t) for t in times])
            g = memory.spring_stiffness(be.sum(axis=1), branch.spring)
            difference += branch.share * MU * g * (be[:, 1] - be[:, 0])
        pressure += weight * half * 2 * difference / (R * np.array([stretch(t) ** 3 for t in times]))
    off = (pressures - pressure) / pressure.max()
    figure(WALL, f"pressure in time over the largest, tolerance {tolerance:g}", off, bound)


@pytest.mark.campaign
def test_a_sphere_keeps_a_set(body_of, figure):
    """A branch that flows above a stress: raised in 3 s, held for 2 s, vented in 3 s, at rest for an hour.

    Its relaxation time is 1 s under large stress and 12 days at rest.
    """
    onset, exponent, least = 0.1, 6.0, 1e-6
    flowing = {"share": 0.3, "time": 1e6, "onset": onset, "exponent": exponent, "least": least}
    law = NeoHookean(MU, 0.5).with_memory(branches=[flowing])
    corners, heights = (0.0, 3.0, 5.0, 8.0, 3608.0), (0.0, 400.0, 400.0, 0.0, 0.0)
    tables = {"cavity1": {"pressure_cm": list(heights[1:])}, "time_s": list(corners[1:])}
    (times, _, volumes, *_), end = followed(body_of(SPHERE), law, tables, STRESS_TOLERANCE)
    assert end is None and times[-1] == corners[-1]

    def fluidity(J2):
        return 1 / (least + (1 - least) / (1 + (J2 / onset**2) ** exponent))

    later = times > 0.0
    pressure = lambda t: 95.1 * np.interp(t, corners, heights)  # noqa: E731
    exact = wall_volume(pressure, times[later], corners, [(0.3, 1e6)], fluidity)
    found = volumes[later] - volumes[0]
    vented = found[times[later] <= corners[3]][-1]
    assert 0.03 * found.max() < found[-1] and 0.8 * vented < found[-1] < vented
    figure(SET, "added volume over the largest, through an hour of rest", (found - exact) / exact.max(), 3e-4)


def diagonal(branch, sides, corners):
    """Principal Cv of a branch in time, of a history of Cbar with kinks at some times."""
    y, pieces = np.ones(3), []
    for low, high in itertools.pairwise(corners):

        def slope(t, y):
            C, Cv = [*sides(t), 0.0, 0.0, 0.0], [*y, 0.0, 0.0, 0.0]
            return memory.fluidity(C, Cv, branch, InNumpy) * (sides(t) - np.sum(sides(t) / y) / 3 * y) / branch.time

        pieces.append(solve_ivp(slope, (low, high), y, "LSODA", rtol=1e-9, atol=1e-11, dense_output=True))
        y = pieces[-1].y[:, -1]
    return lambda t: next(p for p in pieces if t <= p.t[-1] + 1e-9).sol(t)


@pytest.mark.campaign
def test_the_area_of_the_loop_is_what_the_branches_dissipate(body_of, figure):
    """Work of the air on a sphere, up and down twice: stored and dissipated energy, at every state."""
    corners = np.linspace(0.0, 8.0, 25)[1:]  # so many that the trapezoids of the work are fine enough
    volumes = REST * 1e6 * (1.5**3 - 1) * np.interp(corners, [0, 2, 4, 6, 8], [0, 1, 0, 1, 0])
    tables = {"cavity1": {"volume_ml": volumes.tolist()}, "time_s": corners.tolist()}
    (_, P, V, stored, lost), _ = followed(body_of(bodies.Sphere(through=2, along=6)), SOFT, tables, 1e-5)
    work = np.concatenate([[0.0], np.cumsum((P[1:] + P[:-1]) / 2 * np.diff(V))])
    assert lost[-1] > 0.02 * work.max() and (np.diff(lost) > -1e-12 * lost[-1]).all()
    off = (stored + lost - work) / work.max()
    figure("work of the air on a cycled sphere", "stored and dissipated energy, viscosity by stress", off, 8e-5)


# -- linear branches published for VHB 4910 ---------------------------------------------------------------------------

ARRUDA_BOYCE, LOCKING = 15.36e3, 5.85
LINEAR = ((26.06e3, 0.6074), (26.53e3, 6.56), (10.83e3, 61.25))
"""Shear modulus in Pa and locking stretch of Wang et al. 2016, with modulus and time of each branch, as Stewart and Anand 2024
(doi 10.1016/j.ijsolstr.2024.113023) use them with the branches of `softmodels.materials.memory`."""


def published(time, stretch):
    """Nominal stress in Pa of that law: with Cohen's approximation Arruda-Boyce is a third neo-Hookean, and Gent."""
    limit = 3 * (LOCKING**2 - 1)
    gent = Gent(2 * ARRUDA_BOYCE * LOCKING**2 / limit, limit, 0.5)
    branches = [(modulus / gent.shear_modulus, tau) for modulus, tau in LINEAR]
    own = stress_in_time(gent.with_memory(branches), time, stretch)[0]
    return own + respond(NeoHookean(ARRUDA_BOYCE / 3, 0.5), stretch).stress


@pytest.mark.parametrize("rate", sampled([0.01, 0.03, 0.05]))
def test_published_branches_as_published(rate, figure):
    """Their algorithm, implicit Euler in 100 steps as they took and in more, without the library's formulas."""
    errors = []
    for count in (100, 200, 400, 800):
        times = np.linspace(0.0, 3.0 / rate, count + 1)
        stretch = 1 + rate * np.minimum(times, times[-1] - times)
        z2 = (stretch**2 + 2 / stretch) / 3 / LOCKING**2
        stress = ARRUDA_BOYCE * (3 - z2) / (1 - z2) / 3 * (stretch - stretch**-2)
        for modulus, tau in LINEAR:
            Cv = np.ones(3)
            for i, x in enumerate(stretch):
                C = np.array([x**2, 1 / x, 1 / x])
                A = Cv + (times[1] / tau if i else 0.0) * C
                Cv = A / np.prod(A) ** (1 / 3)
                stress[i] += modulus * (C[0] / Cv[0] - C[1] / Cv[1]) / x
        found = published(times, stretch)
        errors.append(np.abs(stress - found).max() / found.max())
    against = "implicit Euler of Stewart and Anand's law of VHB 4910"
    figure(against, f"nominal stress in 100 steps of theirs, {rate:g} /s", errors[0], 1.1e-2)
    figure(against, "their error over that in half as many steps, less 1/2", np.array(errors[1:]) / errors[:-1] - 0.5, 0.06)


def measured_at(rate, folder):
    """Times in s from a stretch of 1 on, stretches and nominal stresses in kPa."""
    table = np.genfromtxt(folder / f"vhb_rate_{rate / 10:g}.csv", delimiter=",", names=True)
    stretch, measured = np.append(1.0, table["stretch"]), np.append(0.0, table["nominal_stress_kPa"])
    return np.concatenate([[0.0], np.cumsum(np.abs(np.diff(stretch)))]) / rate, stretch, measured


MISFITS = {0.01: (0.040, 0.020), 0.03: (0.062, 0.105), 0.05: (0.070, 0.110)}
"""Largest rms misfit of loading and unloading over the rms stress, by rate in 1/s."""


@pytest.mark.parametrize("rate", list(MISFITS))
def test_published_branches_on_the_measured_curves(rate, shared_data, figure):
    times, stretch, measured = measured_at(rate, shared_data("memory"))
    off = published(times, stretch) / 1e3 - measured
    turn = int(stretch.argmax()) + 1
    parts = {"loading": slice(None, turn), "unloading": slice(turn, None)}
    for (name, part), bound in zip(parts.items(), MISFITS[rate], strict=True):
        value = np.sqrt(np.mean(off[part] ** 2) / np.mean(measured[part] ** 2))
        figure(
            "VHB 4910, Hossain et al. 2012",
            f"Stewart and Anand's parameters, rms of {name} at {rate:g} /s",
            value,
            bound,
        )


POINTS = {0.01: (0.04, 0.045), 0.03: (0.04, 0.02), 0.05: (0.045, 0.045)}
"""Largest misfit of a single point, loading and unloading, over the largest stress of a test, by rate in 1/s."""


@pytest.mark.parametrize("rate", list(POINTS))
def test_a_third_rate_of_vhb_is_predicted_point_by_point(rate, shared_data, figure):
    """Gent with linear branches, fitted to the two other rates and to equilibrium without factors on the tests."""
    folder = shared_data("memory")
    rest = np.genfromtxt(folder / "vhb_equilibrium.csv", delimiter=",", names=True)[1:]
    curves = [TensileCurve("rest", "uniaxial", rest["stretch"], 1e3 * rest["nominal_stress_kPa"])]
    for other in sorted(set(POINTS) - {rate}):
        times, stretch, measured = (values[1:] for values in measured_at(other, folder))
        curves.append(TensileCurve(f"{other:g}/s", "uniaxial", stretch, 1e3 * measured, time=times))
    found = fit_curves(curves, "gent", FitOptions(memory=True, gauge_error=0.0, profiles=False)).material
    times, stretch, measured = measured_at(rate, folder)
    off = np.abs(stress_in_time(found, times, stretch)[0] / 1e3 - measured) / measured.max()
    turn = int(stretch.argmax()) + 1
    for name, value, bound in zip(("loading", "unloading"), (off[:turn], off[turn:]), POINTS[rate], strict=True):
        figure(
            "VHB 4910, Hossain et al. 2012",
            f"largest misfit over the largest stress, {name} at {rate:g} /s",
            value,
            bound,
        )


@pytest.mark.parametrize("law", ["gent", "yeoh"])
def test_the_band_of_fitted_histories_holds_a_faster_rate_of_vhb(law, shared_data):
    """Predicted at 0.05 /s from two slower rates and equilibrium. Without what the law misses in them the band held 37 %
    of the stresses; Yeoh's law hides a seventh of the curve at equilibrium in that test's factor."""
    folder = shared_data("memory")
    rest = np.genfromtxt(folder / "vhb_equilibrium.csv", delimiter=",", names=True)[1:]
    curves = [TensileCurve("rest", "uniaxial", rest["stretch"], 1e3 * rest["nominal_stress_kPa"])]
    for rate in sorted(POINTS):
        times, stretch, measured = (values[1:] for values in measured_at(rate, folder))
        curves.append(TensileCurve(f"{rate:g}/s", "uniaxial", stretch, 1e3 * measured, time=times))
    *fitted, faster = curves
    chosen = fit_curves(fitted, law, FitOptions(memory=True, profiles=False)).chosen
    half = HALF_WIDTH_95 * np.linalg.norm(slopes_of(chosen.material, faster, chosen.errors.names) @ chosen.errors.roots, axis=1)
    assert np.mean(np.abs(predicted(chosen.material, faster) - faster.stress) <= half) > 0.75
