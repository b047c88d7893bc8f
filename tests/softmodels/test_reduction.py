"""Reduced models: exact derivatives against finite differences of fresh solves, symmetry, files, and the chain in MuJoCo."""

from __future__ import annotations

import csv
import dataclasses
import io
import json
import math
import re
import types
from concurrent.futures import ThreadPoolExecutor
from xml.etree import ElementTree

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.spatial.transform import Rotation

import softmodels as sm
from softmodels.case.materials import MaterialErrors
from softmodels.cli.exports import reduce_command
from softmodels.decks import chains
from softmodels.decks.reduction import (
    ReducedModel,
    Responses,
    TipFace,
    continued,
    fitted_rotation,
    inverse_left_jacobian,
    usable,
)
from softmodels.runs.table import PathTable, Row
from tests.support.campaigns import sampled

FINGER = sm.BendingBellows(folds=1, cell_size=0.006)
MU, DEVIATION = 30e3, 600.0
SILICONE = sm.NeoHookean(MU)


@pytest.fixture(scope="module")
def run():
    band = MaterialErrors(("shear_modulus",), ((DEVIATION**2,),))
    return sm.inflate(FINGER, SILICONE, pressures="0:3 kPa", band=band, name="finger")


@pytest.fixture(scope="module")
def model(run):
    return run.reduce()


def fresh(pressures, material=SILICONE, parts=(), device=FINGER, spread=False):
    """Position, rotation and added volume at pressures, solved from rest; with the second moments of the tip, if wanted."""
    found, device = [], sm.Model(device, material, parts)
    states = [e for e in device.path(pressures) if e.requested] if any(pressures) else [device.solve()]
    for state in states:
        tip = TipFace(device.system, "tip")
        position, R, _ = tip.pose(state.state)
        found.append((position, R, state.volume, *([tip.at_rest] if spread else [])))
    device.release()
    return found


def between(low, high, step):
    """Derivative of position, rotation vector and volume by central difference."""
    turned = Rotation.from_matrix(high[1] @ low[1].T).as_rotvec()
    return np.concatenate([high[0] - low[0], turned, [high[2] - low[2]]]) / step


def same(found, exact, tolerance):
    """Entries agree in sizes of the largest translation and the largest rotation."""
    for part in (slice(0, 3), slice(3, 6)):
        assert np.abs(found[part] - np.nan_to_num(exact[part])).max() < tolerance * np.nanmax(np.abs(exact[part]))


@pytest.mark.campaign
def test_compliance_and_volume_by_a_force(model):
    """Also the reciprocity of volume and tip: what a force adds to the volume, the pressure adds to the tip's place."""
    state, a = model.states[-1], 1e-3
    low, high = (fresh([state.pressure], parts=[sm.Force(face="tip", direction=way, amount=a)])[-1] for way in ("-z", "z"))
    found = between(low, high, 2 * a)
    same(found, state.compliance[:, 2], 1e-5)
    assert found[6] == pytest.approx(state.rate[2], rel=1e-5)


def test_compliance_by_a_moment_at_rest(model):
    a = 1e-6
    low, high = (fresh([0.0], parts=[sm.Moment(face="tip", axis=way, amount=a)])[-1] for way in ("-y", "y"))
    same(between(low, high, 2 * a), model.states[0].compliance[:, 4], 1e-5)


def test_table_between_its_states_and_jacobian(model):
    """At a pressure that is none of the table's, against fresh solves there."""
    assert all(abs(one.pressure - 1.111e3) > 20.0 for one in model.states)
    low, mid, high = fresh([1.110e3, 1.111e3, 1.112e3])
    at = model(1.111e3)
    assert np.abs(at.position - mid[0]).max() < 1e-5 * model.length
    assert np.abs(at.rotation - mid[1]).max() < 1e-5
    assert at.volume == pytest.approx(mid[2], rel=1e-5)
    same(between(low, high, 2.0), at.rate, 1e-4)
    state = model.states[4]
    low, high = fresh([state.pressure - 2.0, state.pressure + 2.0])
    exact = np.append(state.jacobian[:, 0], state.volume_rate)
    same(between(low, high, 4.0), exact, 1e-5)
    assert between(low, high, 4.0)[6] == pytest.approx(exact[6], rel=1e-5)
    assert state.rate == pytest.approx(state.jacobian[:, 0], rel=1e-8, abs=1e-16)
    assert model.errors["position"] < 1e-4 and model.errors["compliance"] < 0.01


def test_half_a_finger_knows_loads_against_its_symmetry(model):
    """The other half's mesh is the mirror image, so a model of the whole device has nearly the same compliance."""
    whole = sm.Model(dataclasses.replace(FINGER, part="full"), SILICONE)
    rest = Responses(types.SimpleNamespace(solver=whole.solver, fields=whole.fields, case=whole.case), "tip")
    row = {"added_volume_ml": 0.0, "max_stretch": 1.0}
    full, half = rest.at(whole.solve().state, Row(row)).compliance, model.states[0].compliance
    sizes = np.sqrt(np.outer(np.diag(full), np.diag(full)))
    assert np.abs((half - full) / sizes).max() < 1e-3
    assert np.abs(full[[0, 2, 4]][:, [1, 3, 5]]).max() < 1e-9 * sizes.max()
    whole.release()


def test_compliance_is_symmetric_and_positive(model):
    for one in model.states:
        C = one.compliance
        D = np.sqrt(np.diag(C))
        assert np.abs(C - C.T).max() < 1e-8 * np.abs(C).max()
        assert np.linalg.eigvalsh(C / np.outer(D, D)).min() > 0.0


@pytest.mark.campaign
def test_band_of_the_tip(model):
    state = model.states[-1]
    low, high = (fresh([state.pressure], sm.NeoHookean(MU + way))[-1] for way in (-30.0, 30.0))
    moved = between(low, high, 60.0) * 1.959963984540054 * DEVIATION
    same(np.abs(moved[:6]), state.spread[:6], 1e-4)
    assert abs(moved[6]) == pytest.approx(state.spread[6], rel=1e-4)


def test_blocked_wrench_holds_the_tip(model):
    for one in model.states:
        held = one.rate - one.compliance @ model.blocked(one)
        assert np.abs(held).max() < 1e-9 * np.abs(one.rate).max()
    curvature, arc, _ = model.constant_curvature(model.states[-1])
    chord = np.linalg.norm(model.states[-1].position - model.base)
    assert 2 / curvature * math.sin(curvature * arc / 2) == pytest.approx(chord)


@pytest.mark.campaign
def test_round_bellows():
    """A section knows the axial compliance; the effective area is between those of the inner and the outer radius."""
    bellows = sm.Bellows()
    made = sm.inflate(bellows, "ecoflex-00-30", pressures="0:0.3 kPa").reduce()
    assert math.pi * bellows.inner_radius**2 < made.effective_area(made.states[0]) < math.pi * bellows.outer_radius**2
    low, high = made.states[:2]
    slope = (high.position - low.position)[2] / (high.pressure - low.pressure)
    assert min(low.rate[2], high.rate[2]) < slope < max(low.rate[2], high.rate[2])
    assert chains.chain_of(made).error[0] < 0.01


# -- files --------------------------------------------------------------------------------------------------------------


@pytest.mark.campaign
def test_chain_in_mujoco(run, model, tmp_path):
    mujoco = pytest.importorskip("mujoco")
    run.reduce(tmp_path / "finger.xml")
    chain = mujoco.MjModel.from_xml_path(str(tmp_path / "finger.xml"))
    data = mujoco.MjData(chain)
    assert chain.opt.timestep == 0.001
    for pressure in (0.8e3, 2.1e3, 3e3):
        data.ctrl[0] = pressure / 1e3
        mujoco.mj_step(chain, data, 500)
        at, site = model(pressure), data.site("tip")
        assert np.linalg.norm(site.xpos - at.position) < 1e-5 * model.length
        assert np.linalg.norm(Rotation.from_matrix(site.xmat.reshape(3, 3).T @ at.rotation).as_rotvec()) < 1e-4


def settled(mujoco, chain, pressure, wrench, steps=700, spread=None):
    """Place and rotation of the chain's tip at a pressure in Pa, with force (N) and moment (N m) on it; of dead forces, if the
    second moments of the face are given over which they are spread."""
    data = mujoco.MjData(chain)
    data.ctrl[0] = pressure / 1e3
    site = data.site("tip")
    body, moment = chain.site_bodyid[site.id], wrench[3:]
    across = np.cross(np.eye(3), wrench[3:])
    for _ in range(steps):
        lever = site.xpos - data.xipos[body]
        if spread is not None and wrench[3:].any():
            turned = site.xmat.reshape(3, 3) @ spread @ -across / np.trace(across.T @ spread @ across) * (wrench @ wrench)
            moment = np.array([turned[1, 2] - turned[2, 1], turned[2, 0] - turned[0, 2], turned[0, 1] - turned[1, 0]])
        data.xfrc_applied[body] = np.concatenate([wrench[:3], moment + np.cross(lever, wrench[:3])])
        mujoco.mj_step(chain, data)
    assert not data.ncon  # links do not touch each other
    return site.xpos.copy(), site.xmat.reshape(3, 3).copy()


@pytest.mark.parametrize(
    ("load", "share"),
    sampled([("mz", 1), ("fx", 1), ("fx", -0.3), ("fy", 1), ("fz", 1), ("fz", -1), ("mx", 1), ("my", 1), ("my", -1)], 1),
)
def test_chain_yields_as_the_device(model, tmp_path, load, share):
    """At rest and at the highest pressure, by a load that moves the tip by a tenth of the length or turns it by 0.1 rad,
    against the device solved with it. Springs without terms of third order are off by 15 to 18 % (fx, mz)."""
    mujoco = pytest.importorskip("mujoco")
    chain = mujoco.MjModel.from_xml_path(str(chains.write(model, tmp_path / "finger.xml")))
    entry, wrench = chains.LOADS.index(load), np.zeros(6)
    kind, way = (sm.Force, "direction") if entry < 3 else (sm.Moment, "axis")
    for pressure in (0.0, 3e3):
        at = model(pressure)
        wrench[entry] = share * (0.1 * model.length if entry < 3 else 0.1) / at.compliance[entry, entry]
        axis = ("-" if share < 0 else "") + "xyz"[entry % 3]
        part = kind(face="tip", amount=abs(wrench[entry]), **{way: axis})
        device = FINGER if entry in (0, 2, 4) else dataclasses.replace(FINGER, part="full")
        place, R, _, spread = fresh([pressure], parts=[part], device=device, spread=True)[-1]
        moved = [(place, R), settled(mujoco, chain, pressure, wrench, spread=spread)]
        if entry < 3:
            exact, found = ((place - at.position) / model.length for place, _ in moved)
        else:
            exact, found = (Rotation.from_matrix(R @ at.rotation.T).as_rotvec() for _, R in moved)
        assert 0.04 < np.linalg.norm(exact) < 0.12
        assert np.linalg.norm(found - exact) < 0.08 * np.linalg.norm(exact)


def test_straight_chain_bends_and_twists_whatever_the_rounding_of_the_mesh():
    """The compliance of a slender beam with couplings of a millionth, which symmetry excludes."""
    L, EI, C = 0.04, 2e-4, np.zeros((6, 6))
    C[[0, 3], [0, 3]] = 1e-2, 1.3 * L / EI
    for force, moment, sign in (1, 5, 1.0), (2, 4, -1.0):
        C[force, force], C[moment, moment] = L**3 / (3 * EI), L / EI
        C[force, moment] = C[moment, force] = sign * L**2 / (2 * EI)
    sizes = np.sqrt(np.diag(C))
    C = np.where(C == 0.0, 1e-6 * np.outer(sizes, sizes), C)
    places = np.tile([L, 0.0, 0.0], (6, 1))
    path = chains.TipPath(L, False, 3, places, np.tile(np.eye(3), (6, 1, 1)), np.tile(C, (6, 1, 1)))
    springs = chains.springs_of(path, path.kinds())
    drive = chains.Drive(np.zeros(1), np.ones(1), np.array([[[0.0, 1.0, 0.0, 0.0, 0.0]]]))
    _, yielding = chains._stiffnesses(path, springs, drive, drive.terms(np.linspace(0.0, 1.0, 6)[:, None]))
    assert yielding.max() < 0.02


@pytest.mark.campaign
def test_chain_swings_as_the_device(tmp_path):
    """Frequency and damping of the free vibration in MuJoCo, against `sm.modes` of the device with a memory."""
    mujoco = pytest.importorskip("mujoco")
    silicone = SILICONE.with_memory(branches=[(0.2, "5 ms")])
    reduced = sm.inflate(FINGER, silicone, pressures="0:3 kPa").reduce(tmp_path / "finger.xml")
    pressure = reduced.first_mode.pressure
    known = sm.modes(FINGER, silicone, pressures=[pressure])
    chain = mujoco.MjModel.from_xml_path(str(tmp_path / "finger.xml"))
    settled(mujoco, chain, pressure, np.array([0.0, 0.0, 3e-3, 0.0, 0.0, 0.0]))  # also stable at 1 ms
    chain.opt.timestep = 1e-4
    data = mujoco.MjData(chain)
    data.ctrl[0] = pressure / 1e3
    body, tip = chain.site_bodyid[data.site("tip").id], data.site("tip")
    mujoco.mj_step(chain, data, 5000)
    rest, swings = tip.xpos.copy(), []
    data.xfrc_applied[body, 2] = 3e-3
    mujoco.mj_step(chain, data, 5000)
    data.xfrc_applied[:] = 0.0
    way = tip.xpos - rest
    for _ in range(4000):
        mujoco.mj_step(chain, data)
        swings.append(float((tip.xpos - rest) @ way / (way @ way)))
    peaks = [k for k in range(1, 3999) if swings[k - 1] < swings[k] > swings[k + 1]][:3]
    fall = math.log(swings[peaks[0]] / swings[peaks[1]])
    assert 1e4 / (peaks[1] - peaks[0]) == pytest.approx(known.frequency[-1, 0], rel=0.05)
    assert fall / math.hypot(2 * math.pi, fall) == pytest.approx(known.damping[-1, 0], rel=0.2)


def test_chain_touches_other_bodies(model, tmp_path):
    """A plate that reaches 1 mm into the finger at its tip moves the tip aside."""
    mujoco = pytest.importorskip("mujoco")
    scene = mujoco.MjSpec.from_file(str(chains.write(model, tmp_path / "finger.xml")))
    tip = model.states[0].position
    edge = model.points[model.points[:, 0] > tip[0] - 1e-3][:, 2].max()
    scene.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[5e-3, 2e-2, 1e-3], pos=[tip[0], 0.0, edge])
    compiled = scene.compile()
    data = mujoco.MjData(compiled)
    mujoco.mj_step(compiled, data, 500)
    assert data.ncon and 5e-4 < tip[2] - data.site("tip").xpos[2] < 2e-3


WRIST = """
<mujoco>
  <option gravity="0 0 0"/>
  <worldbody>
    <body name="arm" pos="0 0 0.5">
      <joint name="shift" type="slide" axis="1 0 0" damping="60"/>
      <joint name="tilt" axis="0 1 0" damping="0.3"/>
      <geom type="box" size=".02 .02 .02" mass="1"/>
      <site name="wrist" pos="0 0 -0.03" euler="20 90 0"/>
    </body>
  </worldbody>
  <actuator><position name="shift" joint="shift" kp="500"/><position name="tilt" joint="tilt" kp="20"/></actuator>
</mujoco>
"""
"""An arm that shifts and tilts, in MuJoCo's own time step and integrator."""


@pytest.mark.filterwarnings("ignore:Attach conflict")
@pytest.mark.parametrize("whole", sampled([True, False]))
def test_chain_on_a_wrist(model, tmp_path, monkeypatch, whole):
    """Attached as a model or by its base, it weighs what the finger weighs; the moving wrist leaves its pressure alone."""
    mujoco = pytest.importorskip("mujoco")
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its warnings into a file
    arm = mujoco.MjSpec.from_string(WRIST)
    chain = mujoco.MjSpec.from_file(str(chains.write(model, tmp_path / "finger.xml")))
    if whole:
        arm.attach(chain, prefix="finger-", site=arm.site("wrist"))
    else:
        frame = arm.body("arm").add_frame(pos=[0.0, 0.0, -0.03], quat=[math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0])
        frame.attach_body(chain.body("base"), "finger-", "")
    compiled = arm.compile()
    data, base, tip = mujoco.MjData(compiled), "finger-base", "finger-tip"
    finger = FINGER.solid_volume * 1070.0
    assert compiled.body("arm").subtreemass[0] - 1.0 == pytest.approx(finger, rel=2e-3)  # the model's is the mesh's
    assert compiled.body(base).subtreemass[0] == pytest.approx(finger, rel=2e-3)
    assert compiled.body(base).subtreemass[0] == pytest.approx(model.mass, rel=1e-6)
    turned = np.linalg.inv(chains.chain_of(model).axes)
    for share, shift in (0.4, 0.1), (1.0, -0.1):
        data.actuator("finger-pressure_kPa").ctrl = 3.0 * share
        mujoco.mj_step(compiled, data, 100)
        data.actuator("shift").ctrl, data.actuator("tilt").ctrl = shift, 2 * shift
        moved, strayed, rest = 0.0, 0.0, data.body("arm").xpos.copy()
        for _ in range(1000):
            mujoco.mj_step(compiled, data)
            moved = max(moved, float(np.linalg.norm(data.body("arm").xpos - rest)))
            strayed = max(strayed, float(abs(data.joint("finger-pressure").qpos[0] - share)))
        assert moved > 0.09 and strayed < 1e-6
        wrist = data.body(base).xmat.reshape(3, 3) @ turned
        at, site = model(share * 3e3), data.site(tip)
        place = data.body(base).xpos + wrist @ (at.position - model.base)
        assert np.linalg.norm(site.xpos - place) < 1e-3 * model.length
        angle = np.linalg.norm(Rotation.from_matrix(site.xmat.reshape(3, 3).T @ wrist @ at.rotation).as_rotvec())
        assert angle < 1e-3


@pytest.mark.campaign
def test_mass_of_a_device_with_what_is_on_it():
    """Two silicones, a plate and a weight: the mass that gravity pulls at."""
    plate, weight = sm.Rigid("tip", name="plate", mass=5e-3), sm.Mass("bottom", 2e-3)
    run = sm.inflate(
        sm.PneuNet(chambers=2, cell_size=0.008), sm.Yeoh(14e3, 60.0, 0.0, 0.49), pressures="0:0.3 kPa",
        components=(plate, weight, sm.Region(sm.NeoHookean(200e3), 1300.0, name="base"), sm.Gravity("-z"), sm.Walls("none")),
    )  # fmt: skip
    weighs = run.rows[-1]["weight_N"] / sm.Gravity("-z").magnitude
    made = run.reduce()
    assert made.mass == pytest.approx(weighs, rel=1e-9) and weighs > 7e-3
    scene = ElementTree.fromstring(chains.mjcf(made))
    links = [one for one in scene.iter("body") if one.get("name", "").startswith("link")]
    assert len(links) == chains.DEFAULT_SEGMENTS and all(one.get("gravcomp") == "1" for one in links)


@pytest.mark.campaign
def test_chain_out_of_its_plane(model, tmp_path):
    """A finger that also turns about its own axis, by up to 20 degrees, as one with helical fibres does."""
    mujoco = pytest.importorskip("mujoco")
    along, states = (model.states[0].position - model.base) / model.length, []
    twist = math.radians(20.0) / model.states[-1].pressure * along
    for one in model.states:
        Q = Rotation.from_rotvec(one.pressure * twist).as_matrix()
        both, chord = np.kron(np.eye(2), Q), Q @ (one.position - model.base)
        rate = both @ one.rate + np.concatenate([np.cross(twist, chord), twist])
        states.append(dataclasses.replace(
            one, position=model.base + 3.0 * chord - 2.0 * model.length * along, rotation=Q @ one.rotation,
            rate=rate * np.repeat([3.0, 1.0], 3), compliance=both @ one.compliance @ both.T,
        ))  # fmt: skip
    twisted = ReducedModel(model.case, model.face, tuple(states), model.base, "")
    twisted.points = model.points
    made = chains.chain_of(twisted)
    assert made.numbers.shape == (6, 5) and made.error[0] < 1e-3 and made.error[1] < 0.1
    chain = mujoco.MjModel.from_xml_path(str(chains.write(twisted, tmp_path / "chain.xml")))
    data, last = mujoco.MjData(chain), states[-1]
    data.ctrl[0] = last.pressure / 1e3
    mujoco.mj_step(chain, data, 1000)
    assert np.linalg.norm(data.site("tip").xpos - last.position) < 0.001 * model.length
    R = data.site("tip").xmat.reshape(3, 3)
    assert np.linalg.norm(Rotation.from_matrix(R.T @ last.rotation).as_rotvec()) < 0.001
    blind = [dataclasses.replace(one, compliance=one.compliance.copy()) for one in states]
    for one in blind:
        one.compliance[1::2], one.compliance[:, 1::2] = np.nan, np.nan
    with pytest.raises(sm.RunError, match="reduce a model of the whole device"):
        chains.chain_of(ReducedModel(model.case, model.face, tuple(blind), model.base, ""))


def test_unit_for_co_simulation(run, model, tmp_path):
    """Pose and volume at a pressure are the model's; a small load adds what compliance and reciprocity say."""
    fmpy = pytest.importorskip("fmpy", reason="fmpy reads the unit")
    pytest.importorskip("pythonfmu", reason="pythonfmu writes the unit")
    from fmpy.validation import validate_fmu

    file = tmp_path / "finger.fmu"
    run.reduce(file)
    assert chains.is_own(file) and not validate_fmu(str(file))
    load = np.array([0.0, 1e-3, -2e-3, 0.0, 3e-5, 0.0])
    heads = ["pressure_Pa", *(f"force_{x}_N" for x in "xyz"), *(f"moment_{x}_Nm" for x in "xyz")]
    given = np.array(
        [(0.0, 1111.0, *[0.0] * 6), (1.0, 1111.0, *[0.0] * 6), (1.0, 2222.0, *load), (2.0, 2222.0, *load)],
        dtype=[("time", float), *((head, float) for head in heads)],
    )
    variables = fmpy.read_model_description(str(file)).modelVariables
    assert [one.unit for one in variables] == ["Pa", *["N"] * 3, *["N.m"] * 3, *["m"] * 3, *["1"] * 4, "m3"]
    assert all(one.description for one in variables)
    outputs = [variable.name for variable in variables][len(heads) :]
    found = fmpy.simulate_fmu(str(file), stop_time=2.0, output_interval=0.25, input=given, output=outputs)
    plain, loaded = (np.array(found[k].tolist()[1:]) for k in (3, -1))
    at = model(1111.0)
    assert plain == pytest.approx([*at.position, *at.quaternion, at.volume], rel=1e-9, abs=1e-12)
    at = model(2222.0)
    moved = at.compliance @ load
    assert loaded[:3] == pytest.approx(at.position + moved[:3], rel=1e-9)
    turned = Rotation.from_rotvec(moved[3:]) * Rotation.from_matrix(at.rotation)
    assert loaded[3:7] == pytest.approx(turned.as_quat(canonical=True, scalar_first=True), abs=1e-9)
    assert loaded[7] == pytest.approx(at.volume + at.rate @ load, rel=1e-6)


def test_units_share_a_process(model, tmp_path):
    """Two units of one case's name, each several times, one after the other and at once, each by its own table."""
    fmpy = pytest.importorskip("fmpy", reason="fmpy reads the unit")
    pytest.importorskip("pythonfmu", reason="pythonfmu writes the unit")
    doubled = [dataclasses.replace(one, position=2 * one.position, rate=2 * one.rate) for one in model.states]
    models = {"one.fmu": model, "two.fmu": ReducedModel(model.case, model.face, tuple(doubled), model.base, "")}
    for name, made in models.items():
        chains.write(made, tmp_path / name)

    def begun(name):
        """An instance of the unit, and where it lies. FMPy changes the process' folder while it loads: one after the other."""
        folder = fmpy.extract(str(tmp_path / name))
        return folder, fmpy.instantiate_fmu(folder, fmpy.read_model_description(folder))

    def off(name, pressure, begun):
        """Distance in m of the unit's tip from its own table's."""
        folder, unit = begun
        start = {"pressure_Pa": pressure}
        last = fmpy.simulate_fmu(folder, stop_time=0.1, output_interval=0.01, start_values=start, fmu_instance=unit)[-1]
        place = [last[f"tip_{axis}_m"] for axis in "xyz"]
        return float(np.abs(place - models[name](pressure).position).max())

    asked = [(name, pressure) for pressure in (500.0, 1500.0, 2500.0) for name in models]
    assert max(off(*one, begun(one[0])) for one in asked) < 1e-12
    with ThreadPoolExecutor(len(asked)) as threads:
        assert max(threads.map(off, *zip(*asked, strict=True), [begun(name) for name, _ in asked])) < 1e-12


def test_units_refuse_what_they_do_not_know(model, tmp_path):
    """A pressure that is no number or outside the table, at the start or in a step; an instance beside it goes on."""
    fmpy = pytest.importorskip("fmpy", reason="fmpy reads the unit")
    pytest.importorskip("pythonfmu", reason="pythonfmu writes the unit")
    file, told = str(chains.write(model, tmp_path / "finger.fmu")), []

    def simulate(**more):
        return fmpy.simulate_fmu(
            file, stop_time=1.0, output_interval=0.25, debug_logging=True,
            logger=lambda *words: told.append(words[-1].decode()), **more,
        )  # fmt: skip

    for pressure, sentence in (math.nan, "pressure_Pa is nan"), (3.1e3, "the table goes from 0 to 3000 Pa"):
        rising = np.array([(0.0, 0.0), (0.5, pressure)], dtype=[("time", float), ("pressure_Pa", float)])
        for way in {"start_values": {"pressure_Pa": pressure}}, {"input": rising}:
            told.clear()
            with pytest.raises(Exception, match="failed with status"):
                simulate(**way)
            assert sentence in told[-1]
    told.clear()
    assert simulate(start_values={"pressure_Pa": 3e3})["tip_z_m"][-1] == pytest.approx(model(3e3).position[2])
    assert not told


def test_tables(model):
    rows = list(csv.DictReader(io.StringIO(chains.table_csv(model))))
    table = json.loads(chains.table_json(model))["table"]
    assert len(rows) == len(model.states) and set(rows[0]) == set(table)
    last = model.states[-1]
    assert float(rows[-1]["tip_z_m"]) == pytest.approx(last.position[2]) == pytest.approx(table["tip_z_m"][-1])
    assert float(rows[-1]["compliance_turn_y_fz_rad_per_N"]) == pytest.approx(last.compliance[4, 2])


def test_a_chain_warns_where_walls_touch(model):
    """Its springs know no contact, so a load that closes the walls further moves it too far."""
    touching = ReducedModel(model.case, model.face, model.states, model.base, "")
    touching.points, touching.contact = model.points, 1.5e3
    sentence = "in contact from 1.5 kPa on: there a load that presses them together moves the device less"
    for text in chains.mjcf(touching), " ".join(json.loads(chains.table_json(touching))["notes"]):
        assert sentence in text
    assert "in contact" not in chains.mjcf(model)


@pytest.mark.campaign
def test_check_of_a_chain(run, tmp_path, monkeypatch):
    """A chain is the device's; one whose links are twice as heavy is not, and the check says by how much."""
    mujoco = pytest.importorskip("mujoco")
    monkeypatch.chdir(tmp_path)
    run.save("results")
    run.reduce("finger.xml")
    heavy = mujoco.MjSpec.from_file("finger.xml")
    for body in heavy.bodies:
        body.mass *= 4.0
        body.inertia *= 4.0
    for joint in heavy.joints:
        joint.armature *= 4.0
    (tmp_path / "heavy.xml").write_text(heavy.to_xml())
    frequency = run.reduce().first_mode.frequency
    for file, factor in ("finger.xml", 1.0), ("heavy.xml", 0.5):
        done = CliRunner().invoke(reduce_command, ["results", "--quiet", "--check", file])
        assert done.exit_code == 0
        pose, yields, mode = done.stdout.splitlines()
        # MuJoCo writes six digits of each number of the heavy chain, whose pose they change by 0.011 %.
        assert float(re.search(r"within (\S+) % of the length", pose)[1]) < (0.001 if factor == 1.0 else 0.05)
        assert max(float(error) for error in re.findall(r"(\S+) %", yields)) < 8.0
        assert float(re.search(r"kPa: (\S+) Hz", mode)[1]) == pytest.approx(factor * frequency, rel=0.02)


def test_pressures_under_vacuum_are_negative():
    """A table over a vacuum has its signs: pressures, rates, and the pressure of the first mode."""
    model = sm.inflate(FINGER, SILICONE, pressures="-1:-3:1 kPa").reduce()
    assert model.span == pytest.approx((-3e3, 0.0)) and model.first_mode.pressure < 0.0
    assert model.states[-1].volume < 0.0 < model.states[-1].volume_rate
    assert all(state.rate == pytest.approx(state.jacobian[:, 0], rel=1e-9, abs=1e-16) for state in model.states)
    assert (model(-1.4e3).position - model(-1.6e3).position) / 200.0 == pytest.approx(model(-1.5e3).rate[:3], rel=1e-2)


def test_wrong_input(run, tmp_path):
    run.save(tmp_path / "results")
    for words, sentence in [
        ([], "name a file to write"),
        (["--check", "none.xml"], "no chain of softmodels"),
        (["-o", "x.foo"], "no ending of a reduced model"),
        (["-o", "scene.py"], "no ending of a reduced model"),
        (["-o", "x.csv", "--as", "urdf"], "as 'urdf' no reduced model is written"),
        (["-o", "x.csv", "--face", "nose"], "no face 'nose'"),
    ]:
        done = CliRunner().invoke(reduce_command, [str(tmp_path / "results"), *words])
        assert done.exit_code == 2 and sentence in done.stderr
    with pytest.raises(sm.CaseError, match="no ending"):
        run.reduce("finger.inp")


# -- rotations ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("plane", [False, True])
def test_rotation_of_a_face_and_its_derivative(plane):
    rng = np.random.default_rng(3)
    B = rng.normal(size=(3, 3))
    S = B @ B.T
    if plane:  # a plane face: the moments have rank 2
        flat = np.diag([1.0, 1.0, 0.0])
        S = flat @ S @ flat
    R = Rotation.from_rotvec([0.3, -1.2, 0.7]).as_matrix()
    dA, step = rng.normal(size=(3, 3)) @ (np.diag([1.0, 1.0, 0.0]) if plane else np.eye(3)), 1e-6
    found, turn = fitted_rotation(R @ S)
    assert found == pytest.approx(R, abs=1e-12)
    low, high = (fitted_rotation(R @ S + way * step * dA)[0] for way in (-1, 1))
    W = R.T @ dA - dA.T @ R
    rate = turn @ np.array([W[2, 1], W[0, 2], W[1, 0]])
    assert Rotation.from_matrix(high @ low.T).as_rotvec() / (2 * step) == pytest.approx(rate, rel=1e-6, abs=1e-7)


def test_rotations_past_half_a_turn():
    angles = np.linspace(0.0, 5.5, 12)
    turns = continued([Rotation.from_rotvec([0.0, a, 0.0]).as_matrix() for a in angles])
    assert turns[:, 1] == pytest.approx(angles)
    turn, rate, step = np.array([0.4, 2.1, -0.6]), np.array([0.3, 0.2, -0.9]), 1e-6
    low, high = (Rotation.from_rotvec(turn + way * step * rate).as_matrix() for way in (-1, 1))
    omega = Rotation.from_matrix(high @ low.T).as_rotvec() / (2 * step)
    assert inverse_left_jacobian(turn) @ omega == pytest.approx(rate, abs=1e-8)


def test_table_ends_at_the_limit_point():
    plain = {"bifurcation": 0, "jump": 0, "limit": 0}
    rows = [{**plain, "pressure_Pa": p} for p in (0.0, 1.0, 2.0, 2.5)]
    for more, found in (
        (rows, ([0, 1, 2, 3], "")),
        ([*rows, {**plain, "pressure_Pa": 2.4}], ([0, 1, 2, 3], "limit point")),
        ([*rows, {**plain, "pressure_Pa": 2.6, "limit": 1}], ([0, 1, 2, 3], "limit point")),
        ([*rows[:2], {**plain, "pressure_Pa": 2.0, "bifurcation": 1}, *rows[2:]], ([0, 1], "bifurcation")),
    ):
        assert usable(PathTable.read(more)) == found
