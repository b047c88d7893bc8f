"""A hand of several fingers in MuJoCo: each is the chain of one, and it lifts what friction holds."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.spatial.transform import Rotation

import softmodels as sm
from softmodels.case.entries import CaseError
from softmodels.case.load import steps_of
from softmodels.cli.exports import reduce_command
from softmodels.common import units
from softmodels.decks import chains
from softmodels.decks.hand import Hand
from softmodels.runs.grasp import grasp
from tests.softmodels.test_reduction import model, run, settled  # noqa: F401

mujoco = pytest.importorskip("mujoco")

RADIUS = 15e-3
CAN = 8.4e-3
"""Radius in m of a cylinder that the fingers reach by bending by half a millimetre."""


@pytest.fixture(scope="module")
def hand(model, tmp_path_factory):  # noqa: F811
    return Hand(3, RADIUS).write(model, tmp_path_factory.mktemp("hand") / "hand.xml")


@pytest.mark.parametrize("bent", [0, 2])
def test_each_finger_is_the_chain_of_one(model, hand, tmp_path, bent):  # noqa: F811
    """At its place, by its own pressure, while the others stay as they are."""
    alone = mujoco.MjModel.from_xml_path(str(chains.write(model, tmp_path / "finger.xml")))
    (place, R), (rest, unturned) = (settled(mujoco, alone, pressure, np.zeros(6)) for pressure in (3e3, 0.0))
    compiled = mujoco.MjModel.from_xml_path(str(hand))
    data = mujoco.MjData(compiled)
    data.actuator(f"finger{bent + 1}_pressure_kPa").ctrl = 3.0
    mujoco.mj_step(compiled, data, 2000)
    chain = chains.chain_of(model)
    for number in range(3):
        at, turned = (place, R) if number == bent else (rest, unturned)
        angle = math.tau * number / 3
        outwards, up = np.array([math.cos(angle), math.sin(angle), 0.0]), np.array([0.0, 0.0, 1.0])
        moved = np.column_stack([up, -outwards, np.cross(up, -outwards)]) @ chain.axes.T
        tip = data.site(f"finger{number + 1}_tip")
        assert tip.xpos == pytest.approx(RADIUS * outwards + moved @ (at - chain.base), abs=1e-7)
        assert tip.xmat.reshape(3, 3) == pytest.approx(moved @ turned, abs=1e-5)
    assert compiled.body("wrist").subtreemass[0] == pytest.approx(3 * model.mass, rel=1e-5)


ARM = """
<mujoco>
  <option timestep="0.001" integrator="implicitfast" cone="elliptic"/>
  <worldbody>
    <geom type="plane" size="1 1 .1"/>
    <body name="arm" pos="0 0 0.027">
      <joint name="lift" type="slide" axis="0 0 1" damping="5"/>
      <geom type="box" size=".01 .01 .003" pos="0 0 .02" mass=".1"/>
      <site name="wrist" euler="180 0 0"/>
    </body>
    <body name="can" pos="0 0 .01"><freejoint/><geom name="can" type="cylinder" mass="0.001"/></body>
  </worldbody>
  <actuator><position name="lift" joint="lift" kp="500"/></actuator>
</mujoco>
"""


@pytest.mark.filterwarnings("ignore:Attach conflict")
def test_it_lifts_what_friction_holds_and_drops_what_it_does_not(hand, tmp_path, monkeypatch):
    """A cylinder of less and of more than the weight that the sum of the fingers' forces holds by friction."""
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its warnings into a file

    def gripped(mass):
        arm, fingers = mujoco.MjSpec.from_string(ARM), mujoco.MjSpec.from_file(str(hand))
        arm.geom("can").size, arm.geom("can").mass = [CAN, 0.01, 0.0], mass
        arm.attach(fingers, prefix="hand-", site=arm.site("wrist"))
        compiled = arm.compile()
        data = mujoco.MjData(compiled)
        for number in range(3):
            data.actuator(f"hand-finger{number + 1}_pressure_kPa").ctrl = 3.0
        mujoco.mj_step(compiled, data, 600)
        return compiled, data

    compiled, data = gripped(1e-3)
    can, force, forces = compiled.geom("can").id, np.zeros(6), []
    for number, contact in enumerate(data.contact):
        if can in contact.geom and compiled.geom_type[contact.geom].max() == mujoco.mjtGeom.mjGEOM_MESH:
            mujoco.mj_contactForce(compiled, data, number, force)
            forces.append(force[0])
    held = sum(forces) / 9.81  # friction 1
    assert 10e-3 < held < 20e-3
    for share, lifted in ((0.7, True), (1.15, False)):
        compiled, data = gripped(share * held)
        for step in range(1000):
            data.actuator("lift").ctrl = 0.015 * (1.0 - math.cos(math.pi * step / 1000))
            mujoco.mj_step(compiled, data)
        assert (data.body("can").xpos[2] > 0.025) == lifted, share


ROD, GAP, FRICTION = 6e-3, 2e-4, 0.5
"""Radius of a rod and its distance from the fingers at rest, m, and the friction between them."""


@pytest.mark.campaign
@pytest.mark.filterwarnings("ignore:Attach conflict")
def test_fingers_press_and_hold_as_those_of_a_grasp(tmp_path, monkeypatch):
    """Three chains around a rod, whose axis is across the plane in which they bend, against `softmodels grasp`: the force of
    each, and the load across the rod that friction balances."""
    monkeypatch.chdir(tmp_path)
    finger, silicone = sm.BendingBellows(folds=2, cell_size=0.006), sm.silicone("dragon-skin-20")
    place = np.array([finger.length - 4e-3, 0.0, -0.5 * finger.base - ROD - GAP])
    rod = sm.RigidShape(
        "cylinder", "bottom, tip", at=tuple(place), radius=ROD, along=(0.0, 1.0, 0.0), friction=FRICTION, name="rod"
    )
    case = sm.Case("finger", finger, silicone, steps=steps_of(pressure="6 kPa"), components=rod)
    wanted = grasp(case, 3, 0.0, np.array([0.0, 0.0, -1.0]), steps=3)[1][-1]
    sm.inflate(finger, silicone, pressures="0:15 kPa").reduce(tmp_path / "finger.xml")
    scene = mujoco.MjSpec.from_string(
        f"""<mujoco>
        <option timestep="0.001" integrator="implicitfast" cone="elliptic" gravity="0 0 0"/>
        <worldbody><body name="rod">
          <joint type="slide" axis="1 0 0" damping=".5"/><joint type="slide" axis="0 0 1" damping=".5"/>
          <joint axis="0 1 0" damping="1e-5"/>
          <geom name="rod" type="cylinder" size="{ROD} .02" euler="90 0 0" mass=".005"/>
        </body></worldbody></mujoco>"""
    )
    for number in range(3):
        turn = Rotation.from_rotvec([0.0, math.tau * number / 3, 0.0])
        chain = mujoco.MjSpec.from_file("finger.xml")
        for geom in chain.geoms:
            geom.friction, geom.contype, geom.conaffinity = [FRICTION, 0.0, 0.0], 0, 1  # fingers do not touch each other
        frame = scene.worldbody.add_frame(pos=turn.apply(-place), quat=turn.as_quat(scalar_first=True))
        frame.attach_body(chain.body("base"), f"finger{number}-", "")
    compiled = scene.compile()
    data = mujoco.MjData(compiled)
    for step in range(1500):
        data.ctrl[:] = 6.0 * min(step / 750, 1.0)
        mujoco.mj_step(compiled, data)
    arms, pressing, force = [], [], np.zeros(6)
    for number, contact in enumerate(data.contact):
        mujoco.mj_contactForce(compiled, data, number, force)
        towards = 1.0 if contact.geom[1] == compiled.geom("rod").id else -1.0
        arms.append(contact.pos - data.body("rod").xpos)
        pressing.append(towards * force[0] * contact.frame[:3])
    plane = np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])  # along the load, and across it
    found = dataclasses.replace(wanted, arms=np.array(arms) @ plane.T, pressing=np.array(pressing) @ plane.T)
    assert np.linalg.norm(found.pressing, axis=1).sum() == pytest.approx(wanted.press.sum(), rel=0.1)
    assert found.bears(FRICTION) == pytest.approx(wanted.bears(FRICTION), rel=0.15)


def test_what_is_no_hand_is_a_sentence(model, run, hand, tmp_path):  # noqa: F811
    with pytest.raises(CaseError, match="from 2 to 12 fingers, not 1"):
        Hand(1, RADIUS)
    with pytest.raises(CaseError, match="give its radius"):
        Hand(3, 0.0)
    with pytest.raises(CaseError, match="several fingers are written as chains for MuJoCo"):
        run.reduce(tmp_path / "hand.csv", fingers=3, radius="15 mm")
    with pytest.raises(CaseError, match="need a file to be written to"):
        run.reduce(fingers=3, radius="15 mm")
    with pytest.raises(CaseError, match=r"would stand in each other; their radius is .* at least") as caught:
        Hand(6, RADIUS).write(model, tmp_path / "hand.xml")
    least = units.quantity(caught.value.args[0].split("radius is ")[1].split(" at")[0], "m")
    Hand(6, least).write(model, tmp_path / "hand.xml")
    run.save(tmp_path / "results")
    for words, said in ((["--fingers", "3"], "give its radius"), (["--fingers", "3", "--radius", "15"], "15")):
        done = CliRunner().invoke(reduce_command, [str(tmp_path / "results"), "-o", str(tmp_path / "new.xml"), *words])
        assert done.exit_code == 2 and said in done.output, done.output
    done = CliRunner().invoke(reduce_command, [str(tmp_path / "results"), "--check", str(hand)])
    assert done.exit_code == 2 and "has several fingers" in done.output
