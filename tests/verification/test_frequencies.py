"""Natural frequencies against closed forms: slender beams, spheres at rest and inflated, and the laws of similarity.

A sphere of an incompressible silicone breathes with one unknown c: a point at R moves to r with r^3 = R^3 + c and
dr/dc = 1/(3 r^2). Its mass is m = 4 pi rho int R^2 (dr/dc)^2 dR. At a constant pressure P its potential is E(c) - P V(c),
with dV/dc = 4 pi/3, so that P = E' / (4 pi/3) and m w^2 = E''. For a thin wall that is

    w^2 = 2 mu (7/s^6 - 1) / (rho R^2)

at the stretch s: 12 mu/(rho R^2) at rest, and none at the limit point, s^6 = 7. Closed air adds (P + P0) V'^2 / V to E''.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
import scipy.integrate
import scipy.optimize

import softmodels as sm
from softmodels.case.materials import Region
from softmodels.materials.specimens import sphere_pressure
from tests.support import bodies

MU, DENSITY, AIR = 30e3, 1070.0, 101325.0
LAW = sm.NeoHookean(MU, 0.5)
BEAM = sm.Beam(length=0.2, width=0.005, thickness=0.005, clamp="slip", cell_size=0.005)
SLENDER = "Euler-Bernoulli's beam, 40 times as long as thick, Poisson's ratio 0"
SPHERE = "breathing sphere in closed form"
WEIGHTLESS = sm.Gravity("-z", magnitude=1e-9)
DISK = sm.HollowDisk(section="axisymmetric", cell_size=6e-3, refinement=1.0)


def cantilever(root, load=0.0):
    """Frequency in Hz of the beam with a mass on its tip, in masses of the beam; the root number so and so."""
    young = 2 * MU

    def determinant(b):
        return 1 / np.cosh(b) + np.cos(b) + load * b * (np.cos(b) * np.tanh(b) - np.sin(b))

    near = np.linspace(0.1, 12.0, 2000)
    values = determinant(near)
    (changes,) = np.nonzero(values[:-1] * values[1:] < 0)
    b = scipy.optimize.brentq(determinant, near[changes[root]], near[changes[root] + 1])
    radius = BEAM.thickness / math.sqrt(12)
    return b**2 / (2 * math.pi) * radius / BEAM.length**2 * math.sqrt(young / DENSITY)


def beam(components=(), device=BEAM, count=4):
    return sm.Model(device, sm.NeoHookean(MU, 0.0), components, "displacement").modes(count=count)


def bending(mode, axis):
    return np.abs(mode.displacement[:, axis]).max() > 0.9


def test_a_cantilever_bends(figure):
    found = [mode.frequency for mode in beam() if bending(mode, 2)]
    figure(SLENDER, "first natural frequency", found[0] / cantilever(0) - 1, 1e-3)
    figure(SLENDER, "second natural frequency", found[1] / cantilever(1) - 1, 6e-3)


def test_a_mass_on_the_tip_swings_along(figure):
    own = DENSITY * BEAM.solid_volume
    for name, part in {"mass": sm.Mass("tip", own), "rigid plate": sm.Rigid("tip", mass=own)}.items():
        found = [mode.frequency for mode in beam((WEIGHTLESS, part)) if bending(mode, 2)]
        figure(SLENDER, f"with a {name} as heavy as it on its tip", found[0] / cantilever(0, 1.0) - 1, 6e-4)


def test_equal_modes_are_told_apart():
    """A square beam bends in both directions at the same frequency."""
    whole = dataclasses.replace(BEAM, part="full", clamp="held", length=0.05)
    first, second, third = beam(device=whole, count=3)[:3]
    assert second.frequency == pytest.approx(first.frequency, rel=1e-2) and third.frequency > 4 * first.frequency
    a, b = first.displacement, second.displacement
    assert abs((a * b).sum()) < 0.05 * math.sqrt((a**2).sum() * (b**2).sum())


def breathing(model, state=None, **how):
    """The mode that is like the motion of an incompressible sphere, radial and as 1/r^2."""
    points = model.solve().points + (0.0 if state is None else state.displacement)
    out = points / np.linalg.norm(points, axis=1)[:, None] ** 3

    def likeness(mode):
        return abs((mode.displacement * out).sum()) / math.sqrt((mode.displacement**2).sum() * (out**2).sum())

    best = max(model.modes(state, 24, **how), key=likeness)
    assert likeness(best) > 0.99
    return best


def closed(a, b, stretch, pressure, sealed=False):
    """Square of the angular frequency of a thick sphere whose inner stretch is this; may be negative."""
    c = a**3 * (stretch**3 - 1)
    mass = 4 * math.pi * DENSITY * scipy.integrate.quad(lambda R: R**2 / (9 * (R**3 + c) ** (4 / 3)), a, b)[0]
    step = 1e-4 * a**3
    ahead, behind = (pressure(((c + sign * step) / a**3 + 1) ** (1 / 3)) for sign in (1, -1))
    stiffness = 4 * math.pi / 3 * (ahead - behind) / (2 * step)
    if sealed:
        stiffness += (pressure(stretch) + AIR) * (4 * math.pi / 3) ** 2 / (4 * math.pi / 3 * (a * stretch) ** 3)
    return stiffness / mass


@pytest.mark.parametrize("sealed", [False, True])
def test_a_thick_sphere_breathes(sealed, figure):
    law = sm.NeoHookean(10 * MU, 0.5)
    device = bodies.Sphere(through=4, along=12)
    model, errors = sm.Model(device, law), []

    def pressure(stretch):
        return float(sphere_pressure(law, device.inner, device.outer, np.array([stretch]))[0])

    for stretch in (1.0, 1.2, 1.4):
        state = model.solve(pressure=pressure(stretch)) if stretch > 1 else None
        wanted = closed(device.inner, device.outer, stretch, pressure, sealed) ** 0.5 / (2 * math.pi)
        errors.append(breathing(model, state, sealed=sealed).frequency / wanted - 1)
    figure(SPHERE, f"thick wall, to a stretch of 1.4{', sealed' if sealed else ''}", errors, 3e-4)


def test_a_thin_sphere_breathes(figure):
    """Of 3 MPa, so that closed air does not lift it above all other modes."""
    mu, radius, wall = 100 * MU, 0.010, 1e-4
    device = bodies.Sphere(inner=radius - wall / 2, outer=radius + wall / 2, through=1, along=40)
    model, errors = sm.Model(device, sm.NeoHookean(mu, 0.5)), []
    for stretch in (1.0, 1.2, 1.36):
        pressure = 2 * mu * wall / radius * (1 / stretch - stretch**-7)
        state = model.solve(pressure=pressure) if stretch > 1 else None
        square = 2 * mu * (7 / stretch**6 - 1) / (DENSITY * radius**2)
        closed_air = square + 3 * (pressure + AIR) * stretch / (DENSITY * radius * wall)
        for sealed, wanted in ((False, square), (True, closed_air)):
            found = breathing(model, state, sealed=sealed).frequency
            errors.append(found / (math.sqrt(wanted) / (2 * math.pi)) - 1)
    figure(SPHERE, "wall 1/100 of the radius, at rest and inflated, open and sealed", errors, 1e-2)


BRANCHES = ((0.4, 2e-3), (0.3, 30e-3))


def damped_sphere(device, law, stretch, pressure):
    """Roots of the breathing sphere whose inner stretch is this, with branches of neo-Hookean springs: those of a polynomial.

    About a relaxed state a branch resists by G tau s/(1 + tau s) times 2 e:e of the small strain e = (-2, 1, 1) dc/(3 r^3).
    """
    c = device.inner**3 * (stretch**3 - 1)
    moved, mass = (
        4 * math.pi * scipy.integrate.quad(lambda R, n=n: R**2 / (R**3 + c) ** n, device.inner, device.outer)[0]
        for n in (2, 4 / 3)
    )
    branch, square = (
        2 * law.shear_modulus_0 * 6 / 9 * moved / (DENSITY * mass / 9),
        closed(device.inner, device.outer, stretch, pressure),
    )
    denominators = [np.poly1d([time, 1.0]) for _, time in BRANCHES]
    whole = np.poly1d([1.0, 0.0, square]) * denominators[0] * denominators[1]
    for k, (share, time) in enumerate(BRANCHES):
        whole += branch * share * np.poly1d([time, 0.0]) * denominators[1 - k]
    return whole.roots


@pytest.mark.parametrize("stretch", [1.0, 1.4, 2.0])
def test_a_sphere_with_a_memory_is_damped(stretch, figure):
    """At rest, inflated, and past its limit point, where it grows as fast as it creeps."""
    law = sm.NeoHookean(10 * MU, 0.5)
    device = bodies.Sphere(through=3, along=9)

    def pressure(stretch):
        return float(sphere_pressure(law, device.inner, device.outer, np.array([stretch]))[0])

    model = sm.Model(device, law.with_memory(branches=BRANCHES))
    volume = 4 / 3 * math.pi * device.inner**3 * (stretch**3 - 1)
    state = model.solve(volume=volume / 2) if stretch > 1 else None
    roots = damped_sphere(device, law, stretch, pressure)
    if stretch == 2.0:
        first = model.modes(state)[0]
        (wanted,) = (root.real for root in roots if abs(root.imag) < 1e-9 and root.real > 0.0)
        assert math.isnan(first.frequency) and math.isnan(first.damping)
        figure(SPHERE, "with two branches, past the limit point: rate of growth", first.rate / wanted - 1, 2e-2)
        return
    mode, (wanted,) = breathing(model, state), (root for root in roots if root.imag > 1e-9)
    figure(SPHERE, f"with two branches, stretch {stretch}: frequency", mode.frequency * 2 * math.pi / wanted.imag - 1, 1e-3)
    figure(SPHERE, f"with two branches, stretch {stretch}: damping ratio", mode.damping * abs(wanted) / -wanted.real - 1, 5e-3)


@pytest.mark.parametrize("poisson", [0.0, 0.3])
def test_a_beam_that_is_compressible_is_damped(poisson, figure):
    """Branches hold back its shear, its bulk relaxes at once: Young's modulus is E(s) = 9 K G(s)/(3 K + G(s))."""
    law = sm.NeoHookean(MU, poisson)
    branches = [(share, 30 * time) for share, time in BRANCHES]  # as slow as the beam
    bulk = 2 * MU * (1 + poisson) / (3 * (1 - 2 * poisson))
    relaxed = sm.Model(BEAM, law, (), "displacement").modes(count=1)[0].frequency
    mode = sm.Model(BEAM, law.with_memory(branches=branches), (), "displacement").modes(count=1)[0]
    (first, first_time), (second, second_time) = branches
    whole = np.poly1d([first_time, 1.0]) * np.poly1d([second_time, 1.0])
    shear = MU * (
        whole
        + first * np.poly1d([first_time, 0.0]) * np.poly1d([second_time, 1.0])
        + second * np.poly1d([second_time, 0.0]) * np.poly1d([first_time, 1.0])
    )
    young = 2 * MU * (1 + poisson)
    square = (2 * math.pi * relaxed) ** 2
    roots = (np.poly1d([1.0, 0.0, 0.0]) * (3 * bulk * whole + shear) + square / young * 9 * bulk * shear).roots
    (wanted,) = (root for root in roots if root.imag > 1e-9)
    name = f"{SLENDER.rpartition(',')[0]}, with two branches, Poisson's ratio {poisson}"
    figure(name, "frequency", mode.frequency * 2 * math.pi / wanted.imag - 1, 1e-4)
    figure(name, "damping ratio", mode.damping * abs(wanted) / -wanted.real - 1, 1.5e-3)


def test_an_unstable_state_has_no_frequency():
    device = bodies.Sphere(through=2, along=8)
    model = sm.Model(device, LAW)
    state = model.solve(volume=2 / 3 * math.pi * device.inner**3 * (2.0**3 - 1))
    first = model.modes(state)[0]
    assert state.stable is False and not first.stable and math.isnan(first.frequency) and first.rate > 0.0
    assert all(mode.stable for mode in model.modes(state, sealed=True))


def inflated(device, law, pressure, components=()):
    model = sm.Model(device, law, components)
    return np.array([mode.frequency for mode in model.modes(model.solve(pressure=pressure), 3)][:3])


def test_laws_of_similarity(figure):
    known = inflated(DISK, sm.Yeoh(10e3, 100.0), 1e3)
    stiffer = inflated(DISK, sm.Yeoh(40e3, 400.0), 4e3)
    figure("twice the frequency", "a modulus and a pressure four times as high", stiffer / (2 * known) - 1, 1e-8)
    spheres = [bodies.Sphere(inner=s * 0.01, outer=s * 0.012, through=2, along=8) for s in (1, 2)]
    small, large = (inflated(device, LAW, 1e3) for device in spheres)
    figure("half the frequency", "a device twice as large", 2 * large / small - 1, 1e-8)


def test_density_of_gravity_and_of_regions(figure):
    known, heavy = (beam(dataclasses.replace(WEIGHTLESS, density=density))[0].frequency for density in (1e3, 4e3))
    figure("half the frequency", "a density four times as high", 2 * heavy / known - 1, 1e-8)


@pytest.mark.campaign
def test_mass_of_regions_and_plates(figure):
    """Twice the kinetic energy of a bent finger that moves as it is bent, integrated over each of its materials by itself."""
    import ufl
    from dolfinx import fem

    components = (WEIGHTLESS, Region("ecoflex-00-50", 4000.0, name="base"), sm.Mass("tip", 2e-3))
    model = sm.Model(sm.PneuNet(chambers=2, cell_size=5e-3), "ecoflex-00-30", components)
    system, w = model.system, model.solve(pressure=500.0).state.w
    system.w.x.array[:] = w[: system.dofs]
    u = system.body.displacement(ufl.split(system.w)[0])
    face = system.body.sheet_face("tip")[0]
    parts = [system.integral(fem.form(ufl.dot(u, u) * matter.dx)) for matter in system.matter]
    area, swung = (
        system.integral(fem.form(form)) for form in (fem.Constant(system.body.mesh, 1.0) * face, ufl.dot(u, u) * face)
    )
    density = model.modes(count=1)[0].density
    wanted = parts[0] + 4000.0 / density * parts[1] + 2e-3 / (density * system.volume_unit) / area * swung
    mass = model._stability.mass
    x, y = mass.createVecRight(), mass.createVecLeft()
    x.array_w[:] = w[: system.n]
    mass.mult(x, y)
    figure("integrals over each material and face", "kinetic energy", x.dot(y) / wanted - 1, 1.2e-4)


def test_what_has_no_frequency():
    with pytest.raises(sm.CaseError, match=r"without mass no frequency"):
        beam((sm.Gravity("-z", 0.0), sm.Mass("tip", 1e-3)))
    with pytest.raises(sm.CaseError, match="no cavity to be sealed"):
        sm.Model(BEAM, LAW).modes(sealed=True)
    with pytest.raises(sm.CaseError, match="no cavity for a pressure"):
        sm.Model(BEAM, LAW).solve(pressure=100.0)
