"""Contact with a rigid plane: a uniform state in closed form, derivatives, balances of force and energy, both slices."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from scipy.optimize import fsolve

from geometries import HollowDisk
from softmodels.case.case import Case
from softmodels.case.entries import CaseError
from softmodels.case.load import steps_of
from softmodels.components.contact import ONSET_DEPTH, Obstacle
from softmodels.materials.laws import HomogeneousStrain, NeoHookean
from softmodels.mechanics.component import ComponentError
from softmodels.mechanics.controls import pressure_control
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System, held_force
from softmodels.runs.fields import Fields
from tests.support import bodies

UNIFORM = "uniform state of a block against a rigid plane"
SOFT = NeoHookean(30e3, 0.3)
RUBBER = NeoHookean(30e3, 0.49)
SECTION = HollowDisk(section="axisymmetric", support="base", fillet=0.0, base_fillet=0.0)
PLATE = Obstacle("top", "z = 17 mm", 300.0)  # 1 mm above the disk
PRESSED = 0.5


@pytest.fixture(scope="module")
def pressed(body_of):
    """The disk's section under a plate: its equations, its path, and its figures at the end."""
    from softmodels.path.continuation import Continuation, trace

    equations = Solver(System(body_of(SECTION), RUBBER, components=[PLATE]))
    points = list(trace(Continuation(equations, largest_step=PRESSED / 25), [PRESSED]))
    return equations, points, Fields(equations).figures(points[-1].state)


@pytest.mark.quick
@pytest.mark.parametrize(("plane", "section"), [("z = 10 mm", "cube"), ("normal 0,0,-2 at -10 mm", "cube"),
                                                ("z = 1 cm", "axisymmetric")])  # fmt: skip
def test_a_block_that_swells_against_a_plane_is_in_a_uniform_state(plane, section, body_of, figure):
    """Tension on all faces but for what the plane presses back: two stretches from two equations."""
    block, k, P = bodies.Block(section=section), 30.0, -0.4
    equations = Solver(System(body_of(block), SOFT, "displacement", components=[Obstacle("cavity", plane, k)]))
    rest = equations.system.rest()
    state = equations.solve(pressure_control(P / 2), rest.w, P / 2)
    state = equations.solve(pressure_control(P), state.w, P)

    def energy(a, b):
        shape = SOFT.shape(HomogeneousStrain((a, a, b)), SOFT) / SOFT.shear_modulus_0
        return shape + SOFT.bulk / SOFT.shear_modulus_0 / 2 * (a * a * b - 1) ** 2

    def out_of_balance(stretches):
        a, b = stretches  # across, along the normal
        across, along = energy(a + 1e-30j, b).imag / 1e-30, energy(a, b + 1e-30j).imag / 1e-30
        return across + 2 * P * a * b, along + P * a * a + k * (b - 1 - ONSET_DEPTH / 2)

    across, along = fsolve(out_of_balance, [1.1, 1.01], xtol=1e-12)
    figures = Fields(equations).figures(state)
    unit = SOFT.shear_modulus_0 * block.edge**2
    area = 1.0 if section == "cube" else math.pi
    assert along - 1 > 5 * ONSET_DEPTH
    depth, force = (figures.device[name] for name in ("contact_depth_mm", "contact_force_N"))
    figure(UNIFORM, "depth", depth / ((along - 1) * block.edge * 1e3) - 1, 1.2e-8)
    figure(UNIFORM, "force", force / (area * k * (along - 1 - ONSET_DEPTH / 2) * unit) - 1, 8e-10)
    figure(UNIFORM, "stretch", figures.max_stretch / across - 1, 5e-11)


def test_derivatives_are_those_of_the_energy(pressed):
    """Taylor: what a difference of the energy leaves of the force, and of the force of the tangent, falls quadratically."""
    equations, points, _ = pressed
    state = points[-1].state
    way = np.random.default_rng(7).standard_normal(equations.system.n) * 0.02
    for bc in equations.system.bcs:
        bc.set(way, alpha=0.0)

    def at(step):
        equations.system.load(state)
        equations.system.w.x.array[: equations.system.n] += step * way
        equations.system.w.x.scatter_forward()
        force = equations.system.internal_forces().copy()
        product = np.empty(equations.system.n)
        equations.system.tangent_product(way, product)
        load = float(equations.system.potential.P.value) * equations.system.pressure_loads()[0].copy()
        return equations.system.stored_energy(), force, force - load, product

    energy, force, residual, product = at(0.0)
    steps = np.array([4e-3, 2e-3, 1e-3])
    first, second = [], []
    for step in steps:
        there = at(step)
        first.append(abs(there[0] - energy - step * force @ way))
        second.append(np.linalg.norm(there[2] - residual - step * product))
    for errors in (first, second):
        assert np.diff(np.log(errors)) / np.diff(np.log(steps)) == pytest.approx(2.0, abs=0.25)


def test_the_base_holds_what_the_plate_presses(pressed, figure):
    """Air pressure in a closed cavity moves nothing as a whole: the plate's force is the support's."""
    equations, points, figures = pressed
    equations.system.load(points[-1].state)
    unit = equations.system.stress_unit * equations.system.length_unit**2
    component = int(np.argmax(equations.system.body.skew @ [0.0, 1.0]))
    held = -held_force(equations.system, "support", component) * unit
    figure("force of a disk's support", "contact force", figures.device["contact_force_N"] / held - 1, 4.5e-12)
    assert figures.device["contact_force_N"] > 0.3 * figures.pressure * math.pi * SECTION.cavity_radius**2
    assert figures.rises["apex"] == pytest.approx(1e-3, rel=0.1) and points[1].state.V > points[0].state.V


def test_works_balance(pressed, figure):
    """What the pressure has done is stored, in the rubber and in the plane that gives way a little."""
    equations, points, _ = pressed
    V, P = np.array([(point.state.V, point.state.P) for point in points]).T
    slope = np.array([point.tangent.P / point.tangent.V for point in points])
    h = np.diff(V)
    work = np.sum(h * (P[1:] + P[:-1]) / 2 - h**2 * np.diff(slope) / 12)
    equations.system.load(points[-1].state)
    figure("work of the pressure under a plate", "stored energy", equations.system.stored_energy() / work - 1, 6e-5)


def test_a_stiffer_plane_is_sunk_into_less_and_presses_as_much(body_of, solved):
    """100 sinks in by less than 1 % of the size at a contact pressure below one shear modulus."""
    found = {}
    for stiffness in (100.0, 400.0):
        equations = Solver(System(body_of(SECTION), RUBBER, components=[Obstacle("top", "z = 17 mm", stiffness)]))
        _, points, end = solved(equations, [PRESSED])
        assert end is None
        found[stiffness] = Fields(equations).figures(points[-1].state).device
    soft, stiff = found[100.0], found[400.0]
    assert soft["contact_depth_mm"] < 0.01 * SECTION.size * 1e3
    assert soft["contact_depth_mm"] / stiff["contact_depth_mm"] == pytest.approx(4.0, rel=0.25)
    assert soft["contact_force_N"] == pytest.approx(stiff["contact_force_N"], rel=0.05)


@pytest.mark.campaign
def test_a_wedge_presses_as_its_section_does(pressed, body_of, solved, figure):
    disk = dataclasses.replace(SECTION, section="wedge", cell_size=0.006, refinement=1.0)
    equations = Solver(System(body_of(disk), RUBBER, components=[PLATE]))
    _, points, end = solved(equations, [PRESSED])
    assert end is None
    force = Fields(equations).figures(points[-1].state).device["contact_force_N"]
    against = "contact force of the axisymmetric section"
    figure(against, "a wedge's, coarse cells", force / pressed[2].device["contact_force_N"] - 1, 0.03)


def test_a_mirror_plane_stops_the_walls_of_two_neighbours(body_of, solved):
    """Two balloons side by side flatten each other: each meets its image in the plane between, which takes no more force
    than the pressure has over the balloon's widest section."""
    shell = bodies.Sphere(through=2, along=24)
    plane = f"z = {shell.outer * 1.02e3} mm"
    equations = Solver(System(body_of(shell), RUBBER, components=[Obstacle("outer", plane)]))
    goal = 0.3 * equations.system.rest().V
    _, free, _ = solved(Solver(System(body_of(shell), RUBBER)), [goal], "volume", "volume")
    _, points, end = solved(equations, [goal], "volume", "volume")
    assert end is None
    figures = Fields(equations).figures(points[-1].state)
    assert figures.device["contact_depth_mm"] < 0.01 * shell.size * 1e3
    assert 0.0 < figures.device["contact_force_N"] < figures.pressure * math.pi * (1.5 * shell.inner) ** 2
    assert points[-1].state.P > free[-1].state.P


def test_a_case_keeps_its_contact_and_refuses_what_makes_none(body_of):
    case = Case("disk", HollowDisk(), RUBBER, steps=steps_of(pressure_cm=(10.0,)), components=[PLATE])
    assert Case.from_toml(case.to_toml()) == case
    for faces, plane, stiffness, words in (
        ("", "z = 9 mm", 100.0, "needs faces and a plane"),
        ("top", "z = 9", 100.0, "'9' has no unit"),
        ("top", "normal 0,0,0 at 9 mm", 100.0, "is not a plane"),
        ("top", "in 0..1, 0..1, 0..1 mm", 100.0, "is not a plane"),
        ("top", "z = 9 mm", 0.0, "shear moduli per size"),
    ):
        with pytest.raises(ComponentError, match=words):
            Obstacle(faces, plane, stiffness)
    for device, obstacle, words in (
        (HollowDisk(), Obstacle("top", "plane7"), "plane0, plane1"),
        (SECTION, Obstacle("top", "x = 3 mm"), "perpendicular to its axis"),
    ):
        with pytest.raises(CaseError, match=words):
            Case("disk", device, RUBBER, steps=steps_of(pressure_cm=(10.0,)), components=[obstacle])
    for obstacle, words in (
        (Obstacle("lid", "z = 17 mm"), "no face 'lid'"),
        (Obstacle("outer", "z = 9 mm"), "both sides"),
    ):
        with pytest.raises(ComponentError, match=words):
            Solver(System(body_of(SECTION), RUBBER, components=[obstacle]))
