"""An object between equal fingers: its equilibrium, independence of the steps, no friction, force closure."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import softmodels as sm
from geometries import HollowDisk, PneuNet
from softmodels.case.load import steps_of
from softmodels.cli.analyses import told
from softmodels.runs.grasp import GraspError, Held, check_grasp, grasp
from tests.support import runs

FINGER = PneuNet(chambers=2, cell_size=0.01)
RADIUS, DOWN = 0.006, np.array([0.0, 0.0, -1.0])
LOAD = 2e-4


def finger(friction, **changes):
    """A finger over a rod, 0.05 mm away."""
    at = (FINGER.length - 0.004, 0.0, -0.5 * FINGER.base - RADIUS - 5e-5)
    given = {"radius": RADIUS, "along": (0.0, 1.0, 0.0), "friction": friction, "name": "rod", **changes}
    rod = sm.RigidShape("cylinder", "bottom, tip", at=at, **given)
    return sm.Case("finger", FINGER, sm.silicone("ecoflex-00-30"), steps=steps_of(pressure_cm=(2.0,)), components=rod)


@pytest.fixture(scope="module")
def smooth():
    return grasp(finger(0.0), 3, LOAD, DOWN, steps=2)


@pytest.fixture(scope="module")
def rough():
    return grasp(finger(0.5), 3, LOAD, DOWN, steps=2)


@pytest.mark.campaign
def test_forces_and_moments_balance_the_load(smooth, rough, figure):
    wrong = [np.abs(made.imbalance(held)).max() / held.press.sum() for made, found in (smooth, rough) for held in found]
    assert len(wrong) == 6 and all(held.press.min() > 0.0 for held in rough[1])
    figure("the load on it", "forces and moment of three fingers on an object", wrong, 1e-7)
    assert smooth[1][-1].moved[0] > rough[1][-1].moved[0] > 0.0


def test_without_friction_the_steps_do_not_matter(smooth, figure):
    last, here = grasp(finger(0.0), 3, LOAD, DOWN, steps=3)[1][-1], smooth[1][-1]
    apart = np.abs(last.forces - here.forces).max() / here.press.sum()
    figure("two steps", "forces of the fingers after three, without friction", apart, 1e-7)


@pytest.mark.campaign
def test_without_a_load_each_finger_presses_as_on_a_fixed_rod(smooth, figure):
    row = sm.run(finger(0.0)).rows[-1]
    wanted = np.hypot(row["rod_force_x_N"], row["rod_force_z_N"])
    found = np.linalg.norm(smooth[1][0].forces, axis=1)
    figure("a finger on a fixed rod", "force of each of three fingers", found / wanted - 1, 1e-7)


def test_friction_closes_the_grasp_and_bounds_the_load(smooth, rough):
    assert not smooth[1][0].closed(0.0) and rough[1][0].closed(0.5)
    assert smooth[1][-1].bears(0.0) == smooth[1][-1].load
    assert all(held.bears(0.5) >= held.load for held in rough[1]) and rough[1][0].bears(0.5) > 0.0


def test_warnings_about_the_mesh_come_with_the_grasp(rough, monkeypatch):
    made, found = rough
    monkeypatch.setattr(made.system, "body", dataclasses.replace(made.system.body, straight=12))
    assert told(made, found)[0].startswith("note: 12 edges of the mesh on curved faces are straight")


def two(angle):
    """Two points of contact on a circle, opposite but for an angle, each pressed with 1 N towards its centre."""
    arms = np.array([[0.0, 1.0], [np.sin(angle), -np.cos(angle)]])
    none = np.zeros(2)
    return Held(0.0, 0.0, none, 0.0, np.zeros((2, 2)), none, np.ones(2), none, arms, -arms, (), ())


def test_two_points_are_in_closure_while_their_line_lies_in_both_cones():
    """Nguyen 1988, doi 10.1177/027836498800700301: the line between them is off both normals by half the angle."""
    widest = 2 * np.arctan(0.5)
    assert two(0.99 * widest).closed(0.5) and not two(1.01 * widest).closed(0.5)


def test_two_pinching_fingers_bear_twice_their_friction():
    assert two(0.0).bears(0.3) == pytest.approx(0.6)  # the load is square to the line between them


@pytest.mark.parametrize(
    ("changes", "fingers", "direction", "label", "told"),
    [
        ({}, 1, DOWN, "", "1 fingers: a grasp has 2 to 12"),
        ({}, 3, DOWN[[0, 2, 1]], "", "the load must lie in the plane"),
        ({}, 3, DOWN, "ball", "a grasp needs one object"),
        ({"along": (1.0, 0.0, 0.0)}, 3, DOWN, "", "the fingers move in one plane"),
        ({"guide": "z", "spring": 1.0, "friction": 0.0}, 3, DOWN, "", "the object of a grasp is a fixed cylinder"),
    ],
)
def test_grasps_that_cannot_be(changes, fingers, direction, label, told):
    with pytest.raises(GraspError, match=told):
        check_grasp(finger(**{"friction": 0.5, **changes}), label, fingers, direction)


def test_a_grasp_without_a_finger_is_a_sentence_and_status_2(tmp_path):
    case = sm.Case("disk", HollowDisk(), sm.silicone("ecoflex-00-30"), steps=steps_of(pressure_cm=(3.0,)))
    (tmp_path / "case.toml").write_text(case.to_toml())
    done = runs.run("-m", "softmodels", "grasp", tmp_path / "case.toml", "-o", tmp_path / "out")
    assert done.status == 2 and "a grasp needs one object" in done.err and done.err.count("\n") == 1
