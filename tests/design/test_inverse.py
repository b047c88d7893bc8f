"""Devices recovered from what they did: from an outline with noise, from a tip path alone, from a pose."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import softmodels as sm
from geometries import HollowDisk, PneuNet, SeminarActuator
from softmodels.case.case import Case
from softmodels.case.load import steps_of
from softmodels.design.model import DesignModel
from softmodels.design.optimise import optimise
from softmodels.design.problem import DesignProblem
from softmodels.design.quantities import FacePlace, Place, Turn
from softmodels.design.targets import Outline, TipPath
from softmodels.design.trials import EvaluatedLoad
from softmodels.materials.laws import NeoHookean

RECOVERED = "parameters of known devices, recovered from what they did"
AT = 2000.0
NOISE = 20e-6
DISK = HollowDisk.variant("shadow", section="axisymmetric", cell_size=0.004)
BOUNDS = {
    "membrane": (0.8 * DISK.membrane, 1.25 * DISK.membrane),
    "cavity_radius": (0.9 * DISK.cavity_radius, 1.06 * DISK.cavity_radius),
}
TRUTH = {"membrane": 1.07 * DISK.membrane, "cavity_radius": 0.97 * DISK.cavity_radius}


def case_of(device):
    return Case(name="known", actuator=device, material=NeoHookean(20e3, 0.49), steps=steps_of(pressure_cm=(40.0,)))


@pytest.fixture(scope="module")
def shadow(comm):
    """Points on the outline of the known disk, on both sides, and the direction across it there."""
    return outline_of(DISK, comm)


def outline_of(disk, comm):
    names, asked = tuple(TRUTH), Outline(points=((0.0, 0.0),) * 3, at=AT)
    model = DesignModel(case_of(disk), names, (asked,), comm)
    model.evaluate(np.array(list(TRUTH.values())))
    measure, state = model.meshed.measures[asked], model.meshed.states.states[EvaluatedLoad.of(AT)]
    measure.silhouette.follow()
    curve = measure.silhouette.curve(state)
    s = np.linspace(-0.9, 0.9, 5)
    pieces = np.arange(len(curve.nodes))
    places, slopes, _ = curve.at(np.repeat(pieces, 5), np.tile(s, len(pieces)))
    places, slopes = places[places[:, 1] > 3e-4], slopes[places[:, 1] > 3e-4]
    across = np.column_stack([-slopes[:, 1], slopes[:, 0]]) / np.linalg.norm(slopes, axis=1)[:, None]
    model.release()
    return places, across


def problem_of(shadow, seed, **more):
    places, across = shadow
    noise = np.random.default_rng(seed).normal(0.0, NOISE, len(places))
    points = places + noise[:, None] * across
    return DesignProblem(case_of(DISK), BOUNDS, follow=Outline(points=tuple(map(tuple, points)), at=AT, **more))


@pytest.mark.campaign
def test_a_disk_from_its_outline_with_noise(shadow, figure):
    """Over seeds the truth lies in the stated 95 % intervals, and its distances are as large as the stated errors."""
    inside, apart = [], []
    for seed in range(8):
        result = optimise(problem_of(shadow, seed), confirm=False)
        for one in result.recovered.intervals:
            truth = TRUTH[one.parameter.name]
            inside.append(one.low <= truth <= one.high)
            apart.append((one.value - truth) / one.error)
    rms = float(np.sqrt(np.mean(np.square(apart))))
    figure(RECOVERED, "root mean square of a disk's errors over the stated ones, less 1", rms - 1.0, 1.0)
    assert sum(inside) >= len(inside) - 3  # of 16, 0.8 are outside on average
    assert 0.4 < rms < 2.0
    assert "final residuals" in result.recovered.source


def test_a_disk_from_the_outline_of_another_mesh(comm, figure):
    """What made the target is a mesh with cells of half the size."""
    target, _ = outline_of(dataclasses.replace(DISK, cell_size=0.002), comm)
    asked = Outline(points=tuple(map(tuple, target)), at=AT)
    result = optimise(DesignProblem(case_of(DISK), BOUNDS, follow=asked), confirm=False)
    for name, truth in TRUTH.items():
        apart = result.parameters[name] / truth - 1.0
        figure(RECOVERED, f"{name} of a disk from the outline of a mesh with smaller cells, share", apart, 1e-2)


@pytest.mark.campaign
def test_from_several_starts(shadow):
    result = optimise(problem_of(shadow, 1, sigma=NOISE), confirm=False, starts=3)
    assert result.agreement == "the 3 starts agree"
    ends = np.array([end.best.theta for end in result.ends])
    assert ends == pytest.approx(np.tile(ends[0], (3, 1)), rel=1e-3)
    assert "given" in result.recovered.source and "least determined" in result.recovered.weakest


SLAB = SeminarActuator(channels=1, spread=20.0, around=6.0, cell_size=0.006)
KNOWN = {"thickness": 1.08 * SLAB.thickness, "end_bore": 1.12 * SLAB.end_bore, "offset": 0.9 * SLAB.offset}


@pytest.mark.campaign
def test_a_slab_from_its_tip_path_alone(comm, figure):
    """Two coordinates of the tip at three pressures give three lengths."""
    pressures, names = (2e3, 5e3, 8e3), tuple(KNOWN)
    case = Case(name="slab", actuator=SLAB, material=NeoHookean(20e3, 0.49), steps=steps_of(pressure_cm=(90.0,)))
    asked = [Place(at=P, of="tip", axis=axis) for P in pressures for axis in "xz"]
    model = DesignModel(case, names, asked, comm)
    model.evaluate(model.start)
    values = model.evaluate(np.array(list(KNOWN.values()))).values
    model.release()
    rows = [(P, values[x.key], np.nan, values[z.key]) for P, x, z in zip(pressures, asked[::2], asked[1::2], strict=True)]
    bounds = {
        "thickness": (0.9 * SLAB.thickness, 1.2 * SLAB.thickness), "end_bore": (0.8 * SLAB.end_bore, 1.3 * SLAB.end_bore),
        "offset": (1.2 * SLAB.offset, 0.8 * SLAB.offset),
    }  # fmt: skip
    problem = DesignProblem(case, bounds, follow=TipPath(of="tip", target=tuple(rows), sigma="10 um"))
    result = optimise(problem, confirm=False)
    for name, truth in KNOWN.items():
        figure(RECOVERED, f"{name} of a slab from its tip path alone, share", result.parameters[name] / truth - 1.0, 1e-2)
        assert result.parameters[name] == pytest.approx(truth, rel=1e-2)


@pytest.mark.campaign
def test_a_finger_from_the_pose_of_its_tip(comm, figure):
    """Two coordinates and an angle at one pressure give three lengths, in a few steps of Gauss and Newton's method."""
    finger, known = PneuNet(chambers=2, chamber_length=0.004, cell_size=0.008), {"base": 3.4, "root": 4.5, "wall": 1.1}
    case = Case(name="finger", actuator=finger, material=sm.silicone("ecoflex-00-30"), steps=steps_of(pressure_cm=(43.0,)))
    asked = [*(FacePlace(at=4e3, of="tip", axis=axis) for axis in "xz"), Turn(at=4e3, of="tip")]
    model = DesignModel(case, tuple(known), asked, comm)
    model.evaluate(model.start)
    x, z, turn = model.evaluate(1e-3 * np.array(list(known.values()))).values.values()
    model.release()
    bounds = {"base": ("2 mm", "4 mm"), "root": ("3 mm", "6 mm"), "wall": ("0.8 mm", "1.5 mm")}
    pose = {"quantity": "pose", "of": "tip", "at": 4e3, "position": {"x": x, "z": z}, "turn": turn}
    result = optimise(DesignProblem(case, bounds, follow={**pose, "tolerance": "0.1 mm"}), confirm=False)
    for name, truth in known.items():
        apart = result.parameters[name] / (1e-3 * truth) - 1.0
        figure(RECOVERED, f"{name} of a finger from the pose of its tip, share", apart, 1e-4)
    assert len(result.trials) < 12 and result.headline.count("tolerances") == 2
    assert any(f"x {1e3 * x:.4g} mm, z {1e3 * z:.4g} mm, turned by" in note for note in result.best.notes)
    assert "given" in result.recovered.source
