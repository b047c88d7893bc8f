"""A plate pushed together in its plane between lubricated platens, against the exact small motions on the pushed state.

The plate of thickness 2h and length L keeps its width (plane strain). At the stretch s its nominal stress is
P = mu (s^-3 - s), in which Mooney-Rivlin and neo-Hookean agree. Platens that slide and stay upright let small motions
v = f(Y) cos(K X), K = n pi / L, grow exactly, for any thickness: equilibrium and incompressibility leave
f = A cosh(K Y) + B cosh(K Y / s^2) for modes that bend the plate, and with faces free of stress they exist where

    tanh(K h / s^2) / tanh(K h) = 4 s^2 / (1 + s^4)^2

(Biot 1965, Mechanics of Incremental Deformations; Ogden & Roxburgh 1993, Int. J. Engng Sci. 31, 1611).
A slender plate has Euler's load with the modulus 4 mu of plane strain, a thick one the surface's own instability at
s = 0.544. Modes that thicken and thin it (the two tanh change places) come later.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from softmodels.materials.laws import MooneyRivlin, NeoHookean
from softmodels.mechanics.potential import Potential
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System
from softmodels.runs.fields import Fields
from tests.support import bodies
from tests.support.campaigns import sampled
from tests.support.cavities import PushedBody

THEORY = "exact incremental theory of a plate pushed together, lengths of 5 and 2 thicknesses"
PLATES = [(5.0, 2, NeoHookean(50e3, 0.5)), (2.0, 1, MooneyRivlin(20e3, 5e3, 0.5))]
"""Length over thickness, largest number of half waves looked at, and law."""
UPRIGHT = 1e6
"""Stiffness that keeps the platen upright, in shear moduli times lengths; nothing is stored in it on the way."""


def critical_stretch(Kh: float) -> float:
    """Stretch at which a plate bends into waves whose number K times half the thickness is ``Kh``."""

    def gap(s: float) -> float:
        return math.tanh(Kh / s**2) * (1 + s**4) ** 2 - 4 * s**2 * math.tanh(Kh)

    return brentq(gap, 0.4, 1 - 1e-4 * Kh**2, xtol=1e-14)


def nominal_stress(mu: float, s: float) -> float:
    return mu * (s**-3 - s)


def test_the_exact_answer_has_its_two_ends():
    slender = 0.01
    assert nominal_stress(1.0, critical_stretch(slender)) == pytest.approx(4 * slender**2 / 3, rel=1e-3)
    surface = brentq(lambda s: s**4 - 2 * s + 1, 0.4, 0.8)
    assert critical_stretch(20.0) == pytest.approx(surface, rel=1e-6)


class BetweenPlatens(Potential):
    """A stiffness against any slope of the platen's displacement: it moves as one and stays upright."""

    def stored(self, densities):
        import ufl

        on_face, N = self.body.sheet_face("cavity")
        slope = ufl.grad(self.displacement[0])
        across = slope - ufl.dot(slope, N) * N
        return [*super().stored(densities), UPRIGHT / 2 * ufl.inner(across, across) * on_face]


class Press(System):
    potential_class = BetweenPlatens


@pytest.fixture(scope="module")
def pushed(body_of, solved):
    """Return a function that pushes a plate past its critical loads, once: its equations, all points, its bifurcations."""
    known = {}

    def push(slenderness, waves, material, **options):
        key = (slenderness, *options.items())
        if key not in known:
            equations = Solver(Press(body_of(bodies.Plate(length=0.01 * slenderness), PushedBody), material))
            goal = 1.05 * wanted(slenderness, waves, material) / material.shear_modulus_0
            _, points, end = solved(equations, [goal], **options)
            assert end is None
            known[key] = equations, points, [point for point in points if point.bifurcation]
        return known[key]

    return push


def wanted(slenderness, waves, material):
    """Nominal stress in Pa at which a plate bends into so many half waves."""
    return nominal_stress(material.shear_modulus_0, critical_stretch(waves * math.pi / 2 / slenderness))


@pytest.mark.campaign
@pytest.mark.parametrize(("slenderness", "waves", "material"), sampled(PLATES))
def test_plate_bends_at_its_critical_loads(pushed, slenderness, waves, material, figure):
    loads = [wanted(slenderness, n + 1, material) for n in range(waves)]
    equations, points, found = pushed(slenderness, waves, material)
    assert len(found) == waves
    apart = np.array([point.state.P * equations.system.stress_unit for point in found]) / loads - 1
    figure(THEORY, f"loads at which one of {slenderness:g} bends", apart, {5.0: 6e-4, 2.0: 1.5e-3}[slenderness])
    first = points.index(found[0])
    assert all(point.stable_under_pressure and point.stable_under_volume for point in points[:first])
    beyond = points[first + 1 :]
    assert not any(point.stable_under_pressure for point in beyond)
    assert not any(point.stable_under_volume for point in beyond)
    assert points[-1].signature.negative_eigenvalues == waves


@pytest.mark.parametrize(("slenderness", "waves", "material"), sampled(PLATES, [PLATES[1]]))
def test_modes_bend_the_plate_into_half_waves(pushed, slenderness, waves, material, figure):
    equations, _, found = pushed(slenderness, waves, material)
    fields, plate = Fields(equations), equations.system.body.actuator
    X = fields.grid.points
    for n, point in enumerate(found, 1):
        rise = fields.shape(point.mode)[:, 1]
        amplitudes = []
        for face in (0.0, plate.thickness):
            here = np.abs(X[:, 1] - face) < 1e-9
            wave = np.column_stack([np.cos(n * math.pi * X[here, 0] / plate.length), np.ones(here.sum())])
            fit, *_ = np.linalg.lstsq(wave, rise[here])
            left = np.linalg.norm(rise[here] - wave @ fit) / np.linalg.norm(rise[here])
            figure(THEORY, "what a mode differs from half waves by", left, 0.003)
            amplitudes.append(fit[0])
        assert amplitudes[0] == pytest.approx(amplitudes[1], rel=0.01)  # both faces go the same way: it bends


@pytest.mark.campaign
def test_steps_do_not_move_the_plates_load(pushed, figure):
    """Steps of a tenth of the load and of a third against one of all of it."""
    _, _, (usual,) = pushed(*PLATES[1])
    for share in (0.1, 0.3):
        _, _, (again,) = pushed(*PLATES[1], control="pressure", largest_step=share * usual.state.P)
        figure("the plate's load met by other steps", "load", again.state.P / usual.state.P - 1, 2.5e-6)
