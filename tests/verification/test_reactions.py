"""What a device pushes on its holders with, against its whole load: clamps, rigid parts, planes and shapes at once."""

from __future__ import annotations

import math

import numpy as np
import pytest

import softmodels as sm
from softmodels.components.contact import Obstacle, RigidShape
from softmodels.components.loads import Force, Gravity, Mass
from softmodels.components.rigid import Rigid
from softmodels.mechanics.controls import pressure_control
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System, _nodes_of, held_force
from softmodels.path.schedule import apply_preload, inflate_from
from softmodels.runs.fields import Fields

LAW = sm.NeoHookean(30e3)
WHOLE = "the whole of weight, forces and air"
BEAM = sm.Beam(length=0.03, width=0.006, thickness=0.006, cell_size=0.003)
DOWN = Gravity("-z", density=1000.0)


def hung(body, components):
    """The equations where a device hangs, with the columns of its parts, and N of the device in one of the slice."""
    solver = Solver(System(body, LAW, components=components))
    system = solver.system
    amounts = np.concatenate([np.zeros(len(body.actuator.ratios)), system.dead.amounts / system.dead.units])
    stop = apply_preload(solver, [("its loads", amounts)])
    return solver, stop, system.stress_unit * system.length_unit**2 * body.actuator.copies


def upwards(system):
    return int(np.argmax(system.body.skew @ ([0.0, 1.0] if system.body.actuator.dimension == 2 else [0.0, 0.0, 1.0])))


def test_a_beam_held_at_both_ends_weighs_half_on_each(body_of, figure):
    """The silicone's weight on the nodes of the held end counts, with any mesh; and so do the moments."""
    solver, stop, unit = hung(body_of(BEAM), (DOWN, Rigid("tip", name="far", kind="held")))
    system, z = solver.system, upwards(solver.system)
    far = {name: value for name, value in Fields(solver).figures(stop.state).device.items() if name.startswith("far")}
    weight, near = system.dead.amounts[0], held_force(system, "support", z) * unit
    figure(WHOLE, "two ends of a beam", (near + far["far_force_N"]) / -weight - 1, 1e-8)
    figure(WHOLE, "half of it on either end of a beam", far["far_force_N"] / (-weight / 2) - 1, 1e-3)
    # About the origin the ends' moments are those of the weight where it is now.
    _, dofs, rest = _nodes_of(system.space)
    places = (rest + system.w.x.array[dofs] @ system.body.skew_inverse.T) * system.length_unit
    own = [
        sign * entries[dofs] @ system.body.skew * unit
        for sign, entries in (
            (-1.0, system.surplus()),
            (1.0, system.pressures[0] * system.assemble(system.dead.forms[0], held=True).copy()),
        )
    ]
    whole, heavy = (float(np.cross(places, forces)[:, 1].sum()) for forces in own)
    at_tip = np.isclose(rest[:, 0] * system.length_unit, BEAM.length)
    near = float(np.cross(places, own[0])[~at_tip, 1].sum())
    centre = system.unknowns.moving["far"].freedom.centre * system.length_unit
    push = np.array([far["far_force_x_N"], 0.0, far["far_force_z_N"]])
    moment = far["far_moment_y_Nmm"] * 1e-3 + float(np.cross(centre, push)[1])
    figure(WHOLE, "moments at both ends of a beam", (near + moment) / heavy - 1, 1e-8)
    assert whole == pytest.approx(heavy, rel=1e-8)


PLATED = sm.Membrane(radius=0.020, thickness=0.002, plate_radius=0.008, cell_size=0.002)
BALL = RigidShape("sphere", "plate", (0.0, 0.0, 0.0075), 0.005, guide="z", spring=5.0, mass=0.02, name="ball")
PLANE = Obstacle("top", "z = 6 mm")


@pytest.mark.parametrize("kind", ["free", "held"])
def test_holders_bear_the_whole_load(kind, body_of, figure):
    """A membrane with a plate, a mass beside it, a force, a ball that it lifts and a plane that stops it."""
    plate, push = (
        Rigid("plate", name="plate", kind=kind, mass=0.010),
        Force("plate" if kind == "free" else "top", "-z", 0.05),
    )
    components = (DOWN, plate, Mass("top", 0.004), push, BALL)
    solver, stop, unit = hung(body_of(PLATED), (*components, PLANE))
    system, fields = solver.system, Fields(solver)
    state, pressure = inflate_from(solver, stop), 3000.0
    for share in (0.25, 0.5, 0.75, 1.0):
        solver.factorise(state)
        state = solver.solve(pressure_control(share * pressure / system.stress_unit), state.w, state.P)
    told = fields.figures(state).device
    system.load(state)
    (role,) = {hold.role for hold in system.body.holds if hold.direction is None}
    held = {
        "support": held_force(system, role, upwards(system)) * unit,
        "ball": told["ball_force_z_N"],
        "plane": told["contact_force_N"],
        "plate": told["plate_force_N"]
        - (0.010 * 9.81 + (0.05 if kind == "free" else 0.0)),  # less what it bears itself, which counts below
    }
    weight = 9.81 * (1000.0 * PLATED.solid_volume + 0.010 + 0.004) + 0.05
    air = pressure * math.pi * PLATED.radius**2
    figure(WHOLE, f"holders of a membrane whose plate is {kind}", sum(held.values()) / (air - weight) - 1, 1e-6)
    if kind == "free":  # its own load, and what the ball presses on its nodes, which is the device's
        assert held["ball"] > 0.01 and held["plane"] > 0.01
        figure(WHOLE, "a plate that nothing holds but its own weight", held["plate"] / weight, 1e-8)
    else:
        assert abs(held["plate"]) > 0.01


def test_a_part_that_nothing_weighs_on_is_pushed_by_nothing(body_of, figure):
    solver, stop, _ = hung(body_of(PLATED), (DOWN, Rigid("plate", name="plate")))
    told = Fields(solver).figures(stop.state).device
    figure(WHOLE, "a free plate without weight", told["plate_force_N"] / solver.system.dead.amounts[0], 1e-8)


@pytest.mark.campaign
def test_turned_over_it_is_the_mirror_image(body_of, figure):
    """A beam that sags on a plane, with a weight on a spring below it; and the same turned over, gravity too."""

    def told(sign, way):
        side, surface = ("bottom" if sign < 0 else "top"), 0.5 * BEAM.thickness
        plane = Obstacle(side, f"z = {1e3 * sign * (surface + 0.8e-3):g} mm")
        at, gravity = (0.018, 0.0, sign * (surface + 2.2e-3)), Gravity(way, density=1500.0)
        ball = RigidShape("sphere", side, at, 0.002, guide=way, spring=20.0, mass=1e-4, name="ball")
        solver, stop, _ = hung(body_of(BEAM), (gravity, ball, Rigid("tip", name="head", mass=1e-3), plane))
        return Fields(solver).figures(stop.state).device

    below, above = told(-1.0, "-z"), told(1.0, "z")
    assert below["contact_force_N"] > 1e-3 and below["ball_force_z_N"] < -1e-4
    for name, turned in (
        ("contact_force_N", 1.0),
        ("ball_force_z_N", -1.0),
        ("ball_travel_mm", 1.0),
        ("head_z_mm", -1.0),
    ):
        figure("the device turned over", name, turned * above[name] / below[name] - 1, 0.01)
