"""Rigid shapes on a spring or with a mass: derivatives, balances of force and energy, a stiff spring against none, fits."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import softmodels as sm
from softmodels.case.case import Case
from softmodels.case.entries import CaseError
from softmodels.case.load import steps_of
from softmodels.components.contact import RigidShape
from softmodels.components.pressing import GivingWay, HardeningPenalty, PressedByDistance, Support, Surface
from softmodels.components.shapes import slopes
from softmodels.materials.laws import NeoHookean
from softmodels.mechanics.component import ComponentError
from softmodels.mechanics.controls import volume_control
from softmodels.mechanics.sensitivity import Sensitivity
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System

BALANCE = "the balance of a shape that gives way"
LAW = NeoHookean(30e3, 0.49)
SECTION = sm.HollowDisk(section="axisymmetric")
BALL = RigidShape("sphere", "top", (0.0, 0.0, 0.0265), 0.010, guide="z", spring=50.0, name="ball")
WEIGHTLESS = sm.Gravity("-z", density=0.0)
"""Gravity that pulls at the shapes alone."""
NUMBERS = (np.zeros(3), np.array([0.0, 0.6, 0.8]), 1.0, 0.3, 1.0)


def _patch(nodes):
    """Two facets that lie across the side of a capsule."""
    x, y = (axis.ravel() for axis in np.meshgrid(*2 * [np.linspace(-0.2, 0.2, 3)], indexing="ij"))
    at = np.arange(9).reshape(3, 3)
    facets = np.array(
        [[at[0, 0], at[2, 0], at[2, 2], at[2, 1], at[1, 1], at[1, 0]],
         [at[0, 0], at[2, 2], at[0, 2], at[1, 2], at[0, 1], at[1, 1]]]
    )  # fmt: skip
    flat = np.column_stack([x, y, np.full(9, 1.23)]) + nodes
    return Surface(flat, facets, np.zeros(2, int), flat[facets[:, :3]].mean(axis=1) + np.array([0, 0, 0.1]))


def test_distances_and_their_slopes():
    places = np.random.default_rng(2).normal(size=(40, 3))
    _, gradient, second = slopes(places, NUMBERS)
    h = 1e-6
    for axis, step in enumerate(h * np.eye(3)):
        (above, up, _), (below, down, _) = slopes(places + step, NUMBERS), slopes(places - step, NUMBERS)
        np.testing.assert_allclose(gradient[:, axis], (above - below) / (2 * h), atol=1e-8)
        np.testing.assert_allclose(second[:, :, axis], (up - down) / (2 * h), atol=1e-6)
    beside = places[np.abs(places @ NUMBERS[1]) < NUMBERS[3]]
    line = beside - np.outer(beside @ NUMBERS[1], NUMBERS[1])
    np.testing.assert_allclose(slopes(beside, NUMBERS)[0], np.linalg.norm(line, axis=1) - 1.0, atol=1e-12)
    section = slopes(places[:, [0, 2]], (np.zeros(3), np.array([0.0, 0.0, 1.0]), 1.0, 0.3, -1.0))
    assert section[1].shape == (40, 2) and section[2].shape == (40, 2, 2)


@pytest.mark.parametrize(
    "stand", [Support(0.5, 0.0, 1e-2), Support(0.0, 0.02, 1e-2), Support(0.3, 0.02, 1e-2), Support(0.5, -2e-3, 1e-2)]
)
def test_forces_and_stiffness_are_derivatives(stand):
    rng = np.random.default_rng(3)
    surface = _patch(0.01 * rng.normal(size=(9, 3)))
    penalty, along = HardeningPenalty(30.0, 1e-3, 0.02, 16.0), np.array([0.0, -0.28, -0.96])

    def at(nodes):
        def pressed(places):
            return PressedByDistance(surface, lambda x: slopes(x, NUMBERS), penalty, 0.1, places)

        return GivingWay(pressed, stand, along, nodes, 0.0)

    here, way = at(surface.nodes), rng.normal(size=surface.nodes.shape)
    assert here.here.touching.any() and here.s > 1e-3
    assert here.push == pytest.approx(stand.force(here.s), rel=1e-10)
    errors = []
    for h in (1e-4, 5e-5):
        after, before = (at(surface.nodes + sign * h * way) for sign in (1, -1))
        rate, curve = (after.energy - before.energy) / (2 * h), (after.forces - before.forces).ravel() / (2 * h)
        product, slope = here.stiffness @ way.ravel(), float((here.forces * way).sum())
        errors.append((abs(rate / slope - 1), np.abs(curve - product).max() / np.abs(product).max()))
    assert max(errors[1]) < 1e-3
    assert (np.array(errors[0]) / errors[1]).min() > 2.5  # of second order but for where the onset ends
    coupled = here.coupled(0.0).toarray()
    blocks = np.abs(here.stiffness.toarray()).reshape(9, 3, 9, 3).max(axis=(1, 3))
    assert not (blocks[~coupled] > 0.0).any()


def test_a_stiff_spring_holds_a_shape_still(figure):
    free, held = (
        sm.inflate(SECTION, LAW, "0,40 cm", components=[part]).path
        for part in (dataclasses.replace(BALL, guide="", spring=0.0), dataclasses.replace(BALL, spring=1e8))
    )
    for column, bound in (("ball_force_z_N", 1e-4), ("apex_mm", 1e-4), ("added_volume_ml", 1e-4)):
        figure(
            "the shape that stands still",
            f"{column} of a shape on a stiff spring",
            held[column][-1] / free[column][-1] - 1,
            bound,
        )


@pytest.mark.campaign
def test_force_is_that_of_the_spring_and_of_the_weight(figure):
    path = sm.inflate(SECTION, LAW, "0,20,60 cm", components=[BALL]).path
    figure(BALANCE, "spring", 50e-3 * path["ball_travel_mm"][-2:] / path["ball_force_z_N"][-2:] - 1, 1e-8)
    assert path["ball_travel_mm"][0] == 0.0 and path["ball_force_z_N"][0] == 0.0
    lifted = dataclasses.replace(BALL, spring=0.0, mass=0.02)
    path = sm.inflate(SECTION, LAW, "0,20,90 cm", components=[lifted, WEIGHTLESS]).path
    figure(BALANCE, "weight that is lifted", path["ball_force_z_N"][-1] / (0.02 * 9.81) - 1, 1e-8)
    assert path["ball_travel_mm"][-1] > 0.4 and path["ball_force_z_N"][1] < 0.02 * 9.81


@pytest.mark.campaign
def test_a_mass_weighs_by_the_gravity_of_its_case(figure):
    """On the Moon a sixth; where gravity pulls it off its stand, the spring holds it and the device pushes from there."""
    section = sm.HollowDisk(section="axisymmetric", cell_size=0.003)
    lifted = dataclasses.replace(BALL, spring=0.0, mass=0.1)
    moon = sm.inflate(section, LAW, "0,60 cm", components=[lifted, sm.Gravity("-z", 0.0, 1.62)]).path
    figure(BALANCE, "weight that is lifted on the Moon", moon["ball_force_z_N"][-1] / (0.1 * 1.62) - 1, 1e-8)
    hanging = dataclasses.replace(BALL, mass=0.001)
    path = sm.inflate(section, LAW, "0,60 cm", components=[hanging, sm.Gravity("z", density=0.0)]).path
    assert path["ball_travel_mm"][0] == pytest.approx(1e3 * 0.001 * 9.81 / 50.0, rel=1e-9)
    pushed = 50e-3 * path["ball_travel_mm"][-1] - 0.001 * 9.81
    figure(BALANCE, "spring that bears a weight", path["ball_force_z_N"][-1] / pushed - 1, 1e-8)


MASSES = (
    ((), r"\[contact.ball\] has a mass, but gravity has no direction; add it"),
    (
        (sm.Gravity("z"),),
        r"gravity along \(0, 0, 9.81\) m/s\^2 does not press the mass against its stand along the guide z",
    ),
)


@pytest.mark.parametrize(("gravity", "said"), MASSES)
def test_masses_that_nothing_holds_are_refused(gravity, said):
    lifted = dataclasses.replace(BALL, spring=0.0, mass=0.02)
    with pytest.raises(CaseError, match=said):
        Case("ball", SECTION, LAW, steps=steps_of(pressure_cm=(40.0,)), components=(lifted, *gravity))
    with pytest.raises(CaseError, match="mass with its full weight, but shares of the weight are requested"):
        Case("ball", SECTION, LAW, steps=steps_of(share=(1.0,)), components=(lifted, sm.Gravity("-z")))


@pytest.mark.campaign
def test_a_wedge_lifts_as_its_section_does(figure):
    """Twelve slices share one spring."""
    both = [
        sm.inflate(device, LAW, "0,40 cm", components=[BALL]).path
        for device in (sm.HollowDisk(section="axisymmetric", cell_size=0.003), sm.HollowDisk(angle=30, cell_size=0.003))
    ]
    for column, bound in (("ball_force_z_N", 0.15), ("ball_travel_mm", 0.15)):
        figure("the section", f"{column} of a wedge", both[1][column][-1] / both[0][column][-1] - 1, bound)


def test_energy_and_the_material_rate(body_of, figure):
    """Volume gives energy as pressure gives work, spring and weight included; and pressure follows the modulus as it should."""
    ball = dataclasses.replace(BALL, mass=0.001)

    def states(law, volumes):
        solver = Solver(System(body_of(SECTION), law, components=[ball, WEIGHTLESS]))
        state, found = solver.system.rest(), []
        for volume in volumes:
            state = solver.solve(volume_control(volume * V0), state.w, state.P)
            found.append((state, solver.system.stored_energy()))
        return solver, found

    V0, h, up = System(body_of(SECTION), LAW).rest().V, 1e-4, (1.03, 1.06, 1.1, 1.15, 1.2)
    solver, found = states(LAW, (*up, 1.25 - h, 1.25, 1.25 + h))
    (_, before), (middle, _), (_, after) = found[-3:]
    figure(BALANCE, "energy given by the volume", (after - before) / (2 * h * V0) / middle.P - 1, 1e-7)
    assert solver.system.potential.terms["ball"].figures(solver.system)["ball_travel_mm"] > 0.02
    line = volume_control(middle.V)
    _, rates = Sensitivity(solver).rates(middle, line, ("shear_modulus",))
    d = 1e-4
    pressures = []
    for share in (1 - d, 1 + d):
        law = NeoHookean(30e3 * share, 0.49)
        pressures.append(states(law, (*up, 1.25))[1][-1][0].P * law.shear_modulus_0)
    numbered = (pressures[1] - pressures[0]) / (2 * d * 30e3)
    figure(
        "differences",
        "pressure's derivative by the modulus, a shape that gives way",
        rates["shear_modulus"].P / numbered - 1,
        1e-8,
    )


def test_what_cannot_be_meant_is_refused():
    with pytest.raises(ComponentError, match="needs a guide"):
        dataclasses.replace(BALL, guide="")
    with pytest.raises(ComponentError, match="needs a spring or a mass"):
        dataclasses.replace(BALL, spring=0.0)
    with pytest.raises(ComponentError, match="not a direction"):
        dataclasses.replace(BALL, guide="upwards")
    with pytest.raises(sm.CaseError, match="guide must be z or -z"):
        sm.inflate(SECTION, LAW, "0,5 cm", components=[dataclasses.replace(BALL, guide="x")])
    with pytest.raises(sm.CaseError, match="would leave its cut plane"):
        sm.inflate(sm.HollowDisk(), LAW, "0,5 cm", components=[dataclasses.replace(BALL, guide="y")])
