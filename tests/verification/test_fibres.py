"""Fibres and fabrics on a tube, against its closed solution: inflation, elongation and twist; a fabric on a sphere.

An incompressible tube (radii A < B) of neo-Hookean silicone with families of fibres, closed at its ends and free to become
longer and to twist, deforms as r^2 = a^2 + (R^2 - A^2)/l, z = l Z, theta = Theta + t Z, far from its ends. Its energy per
length is one integral E(a, l, t), and at a pressure P the state is where E - P pi a^2 l is stationary: three equations for
scipy, their derivatives by complex steps. Ericksen 1954, doi 10.1007/BF01601214, family 3.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.optimize import brentq, root

import softmodels as sm
from softmodels.components.fibres import ONSET_STRAIN, Fabric, Fibres
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import State, System
from softmodels.path.continuation import Continuation, trace
from softmodels.runs.fields import Fields
from tests.support import bodies
from tests.support.campaigns import sampled

LAW = sm.NeoHookean(30e3, 0.5)
TUBE = sm.Cylinder(length=0.12, fillet=0.0, base="sliding")
THICK = sm.Cylinder(section="whole", inner_radius=0.004, wall=0.004, length=0.04, fillet=0.0, base="sliding", cell_size=0.004)
BRAID = Fibres(on="wall", angle=40.0, modulus=1e6, name="braid")
AXIAL = Fibres(on="wall", angle=0.0, helices=1, modulus=1.0, law="exponential", exponent=20.0, slack=True, name="axial")
NET = Fibres(on="outer", angle=45.0, stiffness=1.0, slack=True, name="net")
SKIN = Fabric(on="outer", along=1.0, across=1.0, name="skin")
PARTS = (BRAID, AXIAL, NET, SKIN)  # all but the first as soft as is taken, until a test makes them stiff
CLOSED = "closed solution of a tube wound with fibres"
NODES, WEIGHTS = np.polynomial.legendre.leggauss(30)


def square(x, slack):
    """The square of a change of squared length, of slack fibres rounded at its onset."""
    if not slack:
        return x * x
    e = 2 * ONSET_STRAIN
    rounded = np.where(x.real < e, x**3 / (3 * e), x**2 - e * x + e**2 / 3)
    return np.where(x.real < 0.0, 0.0, rounded)


def fibre_energy(part, around, shear, along):
    """Per undeformed volume or area, at stretches around and along and the shear that is their product with the twist."""
    cosine, total = np.cos(np.radians(part.angle)), 0.0
    for hand in (1.0, -1.0)[: part.helices]:
        sine = hand * np.sin(np.radians(part.angle))
        q = square(np.asarray((sine * around + cosine * shear) ** 2 + (cosine * along) ** 2 - 1), part.slack)
        exponential = (np.exp(part.exponent * q) - 1) / (8 * part.exponent)
        total = total + (part.stiffness or part.modulus) * (exponential if part.law == "exponential" else q / 8)
    return total


def fabric_energy(part, around, along):
    """Saint-Venant and Kirchhoff's orthotropic membrane, its first direction along the axis."""
    first, second, ratio = (along**2 - 1) / 2, (around**2 - 1) / 2, part.across / part.along
    coupled = part.along * first**2 + 2 * part.poisson * part.across * first * second + part.across * second**2
    return coupled / (2 * (1 - ratio * part.poisson**2))


class Wound:
    """The closed solution of a tube with fibres in its wall, and fibres and fabrics on its outside."""

    def __init__(self, device, components):
        self.A, self.B, self.components = device.inner_radius, device.outer_radius, components

    def energy(self, a, stretch, twist):
        R = np.append(self.A + (NODES + 1) / 2 * (self.B - self.A), self.B)
        h = np.sqrt(a * a + (R**2 - self.A**2) / stretch) / R
        wall = 15e3 * (h**2 + (h * R * twist) ** 2 + stretch**2 + 1 / (h * stretch) ** 2 - 3)
        outside = 0.0
        for part in self.components:
            if isinstance(part, Fabric):
                outside += fabric_energy(part, h[-1], stretch)
            elif part.modulus:
                wall = wall + fibre_energy(part, h, h * R * twist, stretch)
            else:
                outside += fibre_energy(part, h[-1:], h[-1:] * self.B * twist, stretch)[0]
        return 2 * np.pi * (np.sum(WEIGHTS * (self.B - self.A) / 2 * (R * wall)[:-1]) + self.B * outside)

    def at(self, pressure):
        """Outer radius over B, stretch along the axis, and twist in rad/m at a pressure in Pa."""
        scale = np.array([self.A, 1.0, 1 / self.A])

        def slope(x):
            y = (x * scale).astype(complex)
            steps = [np.imag(self.energy(*(y + 1e-30j * unit))) / 1e-30 for unit in np.eye(3)]
            a, stretch, _ = x * scale
            return (np.array(steps) - pressure * np.pi * np.array([2 * a * stretch, a * a, 0.0])) * scale

        found = root(slope, [1.0, 1.0, 0.0], tol=1e-12)
        assert np.abs(slope(found.x)).max() < 1e-8
        a, stretch, twist = found.x * scale
        return np.sqrt(a * a + (self.B**2 - self.A**2) / stretch) / self.B, stretch, twist


@pytest.fixture(scope="module")
def wound(body_of):
    """The section with all kinds of parts; every test sets their values, which compiles nothing."""
    return Solver(System(body_of(TUBE), LAW, components=PARTS))


def with_all(*changed):
    """All parts, with those changed in the place of those of their names."""
    return tuple({part.name: part for part in (*PARTS, *changed)}.values())


def follow(solver, components, pressures):
    """Points at pressures in Pa."""
    for part in components:
        solver.system.potential.terms[part.label].take(part)
    return list(trace(Continuation(solver), [pressure / solver.system.stress_unit for pressure in pressures]))


def figures(solver, point):
    """Outer radius over B and stretch half way up, from the figures that a run reports."""
    found = Fields(solver).figures(point.state)
    device = solver.system.body.actuator
    radius = found.device["diameter_mm"] * 5e-4 / device.outer_radius
    return radius, 1 + found.rises["side"] / (0.5 * device.length)


WIDE = dataclasses.replace(BRAID, angle=65.0)
CASES = {
    "two helices, 40 deg": with_all(),
    "two helices, 65 deg": with_all(WIDE),
    "exponential fibres along, taut": with_all(WIDE, dataclasses.replace(AXIAL, modulus=300e3)),
    "the same, slack": with_all(dataclasses.replace(AXIAL, modulus=300e3)),
    "fabric": with_all(
        dataclasses.replace(BRAID, modulus=1.0), dataclasses.replace(SKIN, along=40.0, across=120.0, poisson=0.3)
    ),
    "a net that hardly stretches": with_all(dataclasses.replace(BRAID, modulus=1.0), dataclasses.replace(NET, stiffness=60e3)),
}


@pytest.mark.parametrize("components", sampled(CASES.values(), whole=True), ids=CASES.keys())
def test_tube_against_its_closed_solution(components, wound, figure):
    last = follow(wound, components, [1e4])[-1]
    radius, stretch, _ = Wound(TUBE, components).at(1e4)
    found = figures(wound, last)
    assert abs(stretch - 1) > 0.005
    figure(CLOSED, "outer radius, section", found[0] / radius - 1, 1e-4)
    figure(CLOSED, "stretch along the axis, section", found[1] / stretch - 1, 1e-4)


def test_the_neutral_angle(wound, figure):
    """The angle whose tube neither lengthens nor shortens at a small pressure: tan^2 = 2."""

    def components(angle):
        return with_all(dataclasses.replace(BRAID, angle=float(angle)))

    def stretch(angle):
        return figures(wound, follow(wound, components(angle), [250.0])[-1])[1] - 1

    neutral = brentq(stretch, 53.5, 56.0, xtol=0.003)
    figure("arctan sqrt 2", "neutral angle at a small pressure", neutral - np.degrees(np.arctan(2**0.5)), 0.1, unit="deg")
    exact = brentq(lambda angle: Wound(TUBE, components(angle)).at(250.0)[1] - 1, 53.5, 56.0)
    figure(CLOSED, "neutral angle", neutral - exact, 0.02, unit="deg")


def test_the_work_of_the_pressure_is_stored(wound, figure):
    components = with_all(WIDE, dataclasses.replace(AXIAL, modulus=300e3))
    points = follow(wound, components, np.linspace(1e3, 1e4, 10))
    V, P = np.array([(p.state.V, p.state.P) for p in points]).T
    slopes, h = np.array([p.tangent.P / p.tangent.V for p in points]), np.diff(V)
    work = np.sum(h * (P[1:] + P[:-1]) / 2 - h**2 * np.diff(slopes) / 12)  # trapezia with their end slopes
    wound.system.load(points[-1].state)
    figure("work of the pressure, tube with fibres", "stored energy", wound.system.stored_energy() / work - 1, 1e-3)
    means = {name: term.figures(wound.system) for name, term in wound.system.potential.terms.items()}
    radius, stretch, _ = Wound(TUBE, components).at(1e4)
    figure(CLOSED, "mean stretch of fibres along", means["axial"]["axial_mean_stretch"] / stretch - 1, 5e-3)
    figure(CLOSED, "mean stretch around", means["skin"]["skin_stretch_across"] / radius - 1, 5e-3)


def test_the_matrix_is_the_derivative_of_the_forces(wound, figure):
    """At a state with all kinds of fibres, taut and slack ones and some on the way between."""
    strong = (
        dataclasses.replace(AXIAL, modulus=1e6),
        dataclasses.replace(NET, stiffness=3e3),
        dataclasses.replace(SKIN, along=4e3, across=9e3, shear=2e3, poisson=0.4),
    )
    for part in with_all(*strong):
        wound.system.potential.terms[part.label].take(part)
    system, rng = wound.system, np.random.default_rng(5)
    w, x = 3e-4 * rng.standard_normal(system.dofs), rng.standard_normal(system.dofs)
    for bc in system.bcs:
        bc.set(x, alpha=0.0)
        bc.set(w, alpha=0.0)

    def energy_and_force(step):
        system.load(State(w + step * x, 0.0, 1.0))
        return system.stored_energy(), system.internal_forces().copy()

    system.load(State(w, 0.0, 1.0))
    force, product = system.internal_forces().copy(), np.zeros(system.n)
    system.tangent_product(x[: system.n], product)
    for bc in system.bcs:
        product[bc.dof_indices()[0]] = 0.0
    h = 1e-7
    (up, forces_up), (down, forces_down) = energy_and_force(h), energy_and_force(-h)
    slope = (forces_up - forces_down) / (2 * h)
    figure("differences of the forces, fibres and fabric", "tangent", (product - slope) / np.abs(slope).max(), 1e-6)
    figure(
        "differences of the energy, fibres and fabric",
        "forces",
        (up - down) / (2 * h) / (force @ x[: system.n]) - 1,
        1e-6,
    )


@pytest.mark.campaign
def test_one_helix_twists_the_tube(body_of, figure):
    helix = Fibres(on="wall", angle=40.0, helices=1, modulus=200e3, name="braid")
    solver = Solver(System(body_of(THICK), LAW, components=(helix,)))
    last = follow(solver, (helix,), [1e4])[-1]
    radius, stretch, twist = Wound(THICK, (helix,)).at(1e4)
    fields = Fields(solver)
    X = fields.grid.points
    x = X + fields.nodal(last.state)["displacement"]
    outside = np.abs(np.hypot(X[:, 0], X[:, 1]) - THICK.outer_radius) < 1e-6 * THICK.outer_radius
    middle = outside & (np.abs(X[:, 2] / THICK.length - 0.45) < 0.2)
    turned = np.angle((x[:, 0] + 1j * x[:, 1]) / (X[:, 0] + 1j * X[:, 1]))
    figure(CLOSED, "twist per length, whole tube", np.polyfit(X[middle, 2], turned[middle], 1)[0] / twist - 1, 0.03)
    figure(CLOSED, "stretch along, whole tube", np.polyfit(X[middle, 2], x[middle, 2], 1)[0] / stretch - 1, 3e-3)
    figure(CLOSED, "outer radius, whole tube", np.hypot(*x[middle, :2].T).mean() / THICK.outer_radius / radius - 1, 3e-3)
    figures_now = fields.figures(last.state).device
    assert np.sign(figures_now["twist_deg"]) == np.sign(twist) and abs(figures_now["bend_angle_deg"]) < 0.1


def test_sphere_in_a_fabric(body_of, solved, figure):
    """Stiffnesses alike in both directions: P = k (h^2 - 1) / ((1 - v) B h) beside the shell's own."""
    from softmodels.materials.specimens import sphere_pressure

    shell, fabric = bodies.Sphere(through=4, along=12), Fabric(on="outer", along=300.0, across=300.0, poisson=0.3)
    solver = Solver(System(body_of(shell), LAW, components=(fabric,)))
    inner = np.array([1.1, 1.4])
    h = np.cbrt(1 + (inner**3 - 1) * (shell.inner / shell.outer) ** 3)
    _, points, end = solved(solver, [(s**3 - 1) * solver.system.rest().V for s in inner], "volume", "volume")
    assert end is None
    found = np.array([p.state.P for p in points if p.requested]) * solver.system.stress_unit
    exact = sphere_pressure(LAW, shell.inner, shell.outer, inner) + 300.0 * (h**2 - 1) / (0.7 * shell.outer * h)
    figure("closed form of a sphere in a fabric", "pressure on the section", found / exact - 1, 5e-4)
