"""Reduced models over the pressure of each cavity: against fresh solves, on the part of a grid that a run reached, in files."""

from __future__ import annotations

import csv
import dataclasses
import io
import json
import math
import types

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.spatial.transform import Rotation

import softmodels as sm
from softmodels.case.load import steps_of
from softmodels.cli.exports import reduce_command
from softmodels.decks import chain_check, chains
from softmodels.decks.reduction import ReducedModel, TipFace, grid_case, grid_of
from softmodels.path import schedule

SILICONE = sm.NeoHookean(30e3)
LOADS = [*(f"force_{x}_N" for x in "xyz"), *(f"moment_{x}_Nm" for x in "xyz")]


@pytest.fixture(scope="module")
def part(two_cavities):
    return sm.ImportedActuator(
        file=str(two_cavities), cavities=("at 11, 0, 2 mm", "at 11, 0, -2 mm"), support="x = 0 mm",
        surfaces=("tip = x = 20 mm",), cell_size=0.006,
    )  # fmt: skip


@pytest.fixture(scope="module")
def run(part):
    return sm.inflate(part, SILICONE, pressures="0, 6 kPa", name="pair")


@pytest.fixture(scope="module")
def grid(run):
    return sm.run(run.grid(3))


@pytest.fixture(scope="module")
def model(grid):
    return grid.reduce()


def program(*pressures):
    """Steps to pressures in Pa of each cavity, a row for each step."""
    return steps_of(
        **{f"cavity{k}": {"pressure": [f"{p} Pa" for p in course]} for k, course in enumerate(zip(*pressures, strict=True), 1)}
    )


def off(device, model, pressures):
    """Error of a reduced model against a fresh solve: position over the length, angle in degrees, volumes over the largest."""
    *_, (_, point) = schedule.follow(device.solver, program(pressures))
    position, R, _ = TipFace(device.system, model.face).pose(point.state)
    device.system.load(point.state)
    volumes = device.system.volumes()
    device.system.load(device.system.rest())
    added, at = (volumes - device.system.volumes()) * device.system.volume_unit, model(*pressures)
    angle = math.degrees(float(np.linalg.norm(Rotation.from_matrix(at.rotation.T @ R).as_rotvec())))
    largest = np.abs([state.volume for state in model.states]).max()
    return np.linalg.norm(at.position - position) / model.length, angle, np.abs(at.volume - added).max() / largest


def test_between_the_nodes_against_fresh_solves(part, model):
    """Measured with three pressures of each cavity: 7e-7 of the length, 5.5e-5 degrees, 2e-4 of the volume."""
    device = sm.Model(part, SILICONE)
    errors = np.max([off(device, model, at) for at in [(1.3e3, 4.4e3), (5.1e3, 0.4e3), (4.7e3, 5.5e3)]], axis=0)
    device.release()
    assert (errors < [5e-6, 3e-4, 1e-3]).all(), errors
    assert errors[0] <= model.errors["position"] and errors[1] <= model.errors["angle_deg"]


def test_derivatives_and_symmetry(model):
    """The model's rates are the slopes of its own values, exact at the nodes; work makes the volumes' rates symmetric."""
    node, other = model.states[4], model.states[5]
    at = model(*node.pressure)
    assert at.rate == pytest.approx(node.rate, rel=1e-9, abs=1e-16) and at.volume_rate == pytest.approx(
        node.volume_rate, rel=1e-9
    )
    assert node.volume_rate == pytest.approx(node.volume_rate.T, rel=1e-6)
    place, step = np.array([1.7e3, 3.9e3]), np.array([0.0, 1.0])
    low, high = model(*place - step), model(*place + step)
    assert (high.position - low.position) / 2 == pytest.approx(model(*place).rate[:3, 1], rel=1e-5, abs=1e-14)
    assert (high.volume - low.volume) / 2 == pytest.approx(model(*place).volume_rate[:, 1], rel=1e-5)
    assert other.position[2] != pytest.approx(node.position[2], abs=1e-6)


def test_a_program_in_one_ratio_is_the_path(run, model):
    """Where all pressures are the same, path and map solve the same states."""
    path = run.reduce()
    for pressure in (3e3, 6e3):
        along, at = path(pressure), model(pressure, pressure)
        assert at.position == pytest.approx(along.position, rel=1e-7)
        assert at.compliance == pytest.approx(along.compliance, rel=1e-4, abs=1e-6)
        assert sum(at.volume) == pytest.approx(along.volume, rel=1e-6)
        assert at.rate.sum(axis=1)[:3] == pytest.approx(along.rate[:3], rel=1e-5, abs=1e-12)


def test_tables_of_a_map(model):
    rows = list(csv.DictReader(io.StringIO(chains.table_csv(model))))
    assert [(float(row["pressure_cavity1_Pa"]), float(row["pressure_cavity2_Pa"])) for row in rows[:4]] == [
        (0, 0), (0, 3e3), (0, 6e3), (3e3, 0),
    ]  # fmt: skip
    state = model.states[3]
    told = {name: float(value) for name, value in rows[3].items() if value}
    assert told["added_volume_cavity1_m3"] == pytest.approx(state.volume[0], rel=1e-9)
    assert told["volume_rate_cavity1_by_cavity2_m3_per_Pa"] == pytest.approx(state.volume_rate[0, 1], rel=1e-9)
    assert told["rate_z_by_cavity2_m_per_Pa"] == pytest.approx(state.rate[2, 1], rel=1e-9)
    assert told["blocked_fz_by_cavity1_N_per_Pa"] == pytest.approx(model.blocked(state)[2, 0], rel=1e-9)
    about = json.loads(chains.table_json(model))
    assert about["from_Pa"] == [0, 0] and about["to_Pa"] == [6e3, 6e3] and about["not_reached_Pa"] == []


def test_unit_with_a_pressure_for_each_cavity(model, tmp_path):
    fmpy = pytest.importorskip("fmpy", reason="fmpy reads the unit")
    pytest.importorskip("pythonfmu", reason="pythonfmu writes the unit")
    file, load = str(chains.write(model, tmp_path / "pair.fmu")), np.array([0.0, 1e-3, -2e-3, 0.0, 3e-5, 0.0])
    outputs = [*(f"tip_{x}_m" for x in "xyz"), "added_volume_cavity1_m3", "added_volume_cavity2_m3"]
    start = {"pressure_cavity1_Pa": 1.3e3, "pressure_cavity2_Pa": 4.4e3, **dict(zip(LOADS, load, strict=True))}
    last = fmpy.simulate_fmu(file, stop_time=0.1, start_values=start, output=outputs)[-1].tolist()[1:]
    at = model(1.3e3, 4.4e3)
    assert last[:3] == pytest.approx(at.position + (at.compliance @ load)[:3], rel=1e-9)
    assert last[3:] == pytest.approx(at.volume + load @ at.rate, rel=1e-9)
    with pytest.raises(Exception, match="failed with status"):
        fmpy.simulate_fmu(file, stop_time=0.1, start_values=start | {"pressure_cavity2_Pa": 6.1e3})


def in_mujoco(model, file, pressures, load=None):
    """Place and rotation of the tip of a chain at rest at pressures in Pa."""
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo moves the chain")
    chain = chain_check.ChainInMujoco(mujoco, chains.write(model, file))
    chain.damp()
    return chain.tip(np.array(pressures), load)


def test_a_chain_of_two_pressures(model, tmp_path):
    """Pose and compliance at pressures that are no nodes; measured 1.2e-4 of the length, 0.01 degrees and 0.3 %."""
    pressures, load = (5.1e3, 1.4e3), np.array([0.0, 0.0, 1e-3, 0.0, 0.0, 0.0])
    at = model(*pressures)
    place, R = in_mujoco(model, tmp_path / "pair.xml", pressures)
    assert np.linalg.norm(place - at.position) < 3e-4 * model.length
    assert np.linalg.norm(Rotation.from_matrix(R.T @ at.rotation).as_rotvec()) < 5e-4
    yielding = in_mujoco(model, tmp_path / "pair.xml", pressures, load)[0] - place
    assert yielding == pytest.approx((at.compliance @ load)[:3], rel=0.02, abs=0.02 * np.linalg.norm(yielding))
    assert place[2] * in_mujoco(model, tmp_path / "pair.xml", pressures[::-1])[0][2] < 0.0


def test_a_chain_bends_in_all_directions_however_little(model):
    """A pair whose second pressure also turns the direction in which it bends, by up to a quarter of a turn: its tip leaves any
    plane by 0.2 % of its length at most, and does so on the chain."""
    by_pressure, states = np.array([math.pi / 2 / model.span[1][1], 0.0, 0.0]), []
    for state in model.states:
        Q = Rotation.from_rotvec(by_pressure * state.pressure[1]).as_matrix()
        both, chord, R = np.kron(np.eye(2), Q), Q @ (state.position - model.base), Q @ state.rotation @ Q.T
        rate = both @ state.rate
        rate[:, 1] += np.concatenate([np.cross(by_pressure, chord), by_pressure - R @ by_pressure])
        states.append(dataclasses.replace(
            state, position=model.base + chord, rotation=R, rate=rate, compliance=both @ state.compliance @ both.T,
            compliance_rate=None,
        ))  # fmt: skip
    chain = chains.chain_of(ReducedModel(model.case, model.face, tuple(states), model.base, ""))
    assert len(chain.numbers) == 6 and chain.error[0] < 4e-4 and chain.error[1] < 0.05


def test_what_a_chain_of_two_pressures_says(model, grid, tmp_path):
    """Its controls have the cavities' names, also as a finger of a hand, and `check` has a line for each figure."""
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo reads the chain")
    grid.reduce(tmp_path / "hand.xml", fingers=2, radius=0.03)
    hand = mujoco.MjModel.from_xml_path(str(tmp_path / "hand.xml"))
    assert [hand.actuator(k).name for k in range(4)] == [
        f"finger{finger}_pressure_cavity{cavity}_kPa" for finger in (1, 2) for cavity in (1, 2)
    ]
    assert hand.actuator_ctrlrange.tolist() == [[0, 6]] * 4
    said = chain_check.check(model, chains.write(model, tmp_path / "pair.xml"))
    assert said[0].startswith("at 4 pressures from 0, 0 to 6, 6 kPa the tip of the chain is within 0.01")
    assert "first mode at 3, 3 kPa" in said[-1] and model.first_mode.frequency > 0.0


def test_a_map_ends_where_the_run_did(part, run):
    """A program that fails in the outermost box leaves the ones within; what it did not reach is named."""
    ended = sm.inflate(part, SILICONE, steps=(*run.grid(3).steps, *program((24e3, 0.0), (24e3, 24e3))), name="pair")
    assert ended.limit is not None
    model = ended.reduce()
    assert [end.tolist() for end in model.span] == [[0, 0], [6e3, 6e3]]
    assert model.not_reached.tolist() == [[24e3, 0], [24e3, 24e3]]
    assert "the run did not reach 24, 0; 24, 24 kPa" in " ".join(model.notes)
    with pytest.raises(sm.RunError, match=r"13, 1 kPa is outside the reduced model; it goes from 0, 0 to 6, 6 kPa"):
        model(13e3, 1e3)


def test_command_line_solves_the_grid_and_goes_on(run, tmp_path):
    """A grid that is there is not solved again; that of another run is."""
    run.save(tmp_path / "pair")
    words = [str(tmp_path / "pair"), "-o", str(tmp_path / "pair.csv"), "--grid", "3"]
    first = CliRunner().invoke(reduce_command, words)
    assert first.exit_code == 0 and "9 states from 0, 0 to 6, 6 kPa" in first.output, first.output
    table, here = (tmp_path / "pair.csv").read_bytes(), tmp_path / "pair-grid3"
    second = CliRunner().invoke(reduce_command, words)
    assert second.exit_code == 0 and "resuming from step 8 of the program" in second.output, second.output
    assert (tmp_path / "pair.csv").read_bytes() == table and "resuming" not in first.output
    sm.run(dataclasses.replace(run.case, material=sm.NeoHookean(40e3))).save(tmp_path / "pair")
    assert CliRunner().invoke(reduce_command, [*words, "--quiet"]).exit_code == 0
    assert sm.load(here).case.material == sm.NeoHookean(40e3)


def test_what_is_no_map(part, run, grid, model):
    with pytest.raises(sm.CaseError, match="takes 2 pressures, one of each cavity; it got 1"):
        model(3e3)
    with pytest.raises(sm.CaseError, match="must be 3 or more pressures of each cavity"):
        run.grid(2)
    with pytest.raises(sm.CaseError, match="has gone over a grid already; leave out the grid"):
        grid.grid(5)
    plate = sm.RigidShape("plane", "tip", (0.021, 0.0, 0.0), along=(-1.0, 0.0, 0.0), friction=0.5, name="plate")
    with pytest.raises(sm.CaseError, match=r"with the friction of .*plate.* the states depend on the order"):
        grid_case(types.SimpleNamespace(case=dataclasses.replace(run.case, components=(plate,)), rows=run.table), 3)
    with pytest.raises(sm.CaseError, match="leave out the grid"):
        sm.inflate(sm.BendingBellows(folds=1, cell_size=0.006), SILICONE, pressures=[1e3]).grid()
    only = sm.inflate(part, SILICONE, steps=program((1e3, 0.0), (1e3, 1e3)))
    with pytest.raises(sm.RunError, match="a grid of 2 x 1 pressures of its cavities"):
        only.reduce()
    volumes = sm.inflate(part, SILICONE, steps=steps_of(cavity1={"volume_ml": [0.01]}, cavity2={"pressure_cm": [0]}))
    with pytest.raises(sm.CaseError, match="a program of the pressures of all cavities"):
        grid_of(volumes._source)


# ----------------------------------------------------------------------------------------------------------------------
# An arm of three chambers around its axis.


@pytest.fixture(scope="module")
def arm(step_file, tmp_path_factory):
    """A cylinder of 25 mm, 60 mm long, held at its foot, with three chambers at 120 degrees."""
    middles = [(7.0 * math.cos(2 * math.pi * k / 3), 7.0 * math.sin(2 * math.pi * k / 3)) for k in range(3)]

    def draw(occ):
        chambers = [(3, occ.addCylinder(x, y, 4, 0, 0, 52, 3.5)) for x, y in middles]
        occ.cut([(3, occ.addCylinder(0, 0, 0, 0, 0, 60, 12.5))], chambers)

    file = step_file(tmp_path_factory.mktemp("step") / "arm.step", draw)
    return sm.ImportedActuator(
        file=file, cavities=tuple(f"at {x:.4f}, {y:.4f}, 30 mm" for x, y in middles), support="z = 0 mm",
        surfaces=("tip = z = 60 mm",), cell_size=0.009,
    )  # fmt: skip


@pytest.mark.campaign
def test_an_arm_of_three_chambers(arm, tmp_path):
    """Three of each cavity solved. 50 random pressures, of which 16 are held here: 1.0e-3 of the length, 0.11 degrees, 1.1 % of
    the volume, measured; its chain in MuJoCo 0.9e-3 and 0.10 degrees, and in the table's states the tip yields within 3.8 % of
    the device's."""
    model = sm.run(sm.inflate(arm, SILICONE, pressures="0, 12 kPa", name="arm").grid(3)).reduce()
    device = sm.Model(arm, SILICONE)
    asked = np.random.default_rng(1).uniform(*model.span, size=(50, 3))
    errors = np.max([off(device, model, pressures) for pressures in asked[:16]], axis=0)
    device.release()
    assert (errors < [2e-3, 0.2, 0.02]).all(), errors
    for pressures in asked[:5]:
        at, (place, R) = model(*pressures), in_mujoco(model, tmp_path / "arm.xml", pressures)
        assert np.linalg.norm(place - at.position) < 2e-3 * model.length
        assert np.linalg.norm(Rotation.from_matrix(R.T @ at.rotation).as_rotvec()) < math.radians(0.2)
    assert np.nanmax(chains.chain_of(model).yielding) < 0.06
