"""Numbers of the silicone, of parts, loads and pressures as parameters, and quantities of stress, force, work and pose.

Each quantity by each parameter: Taylor's remainder of order 2.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import softmodels as sm
from geometries import Bellows, Cylinder, HollowDisk, PneuNet
from softmodels.case.case import Case
from softmodels.case.load import steps_of
from softmodels.components.contact import RigidShape
from softmodels.components.fibres import Fabric, Fibres, Sheet
from softmodels.components.loads import Mass as Weight
from softmodels.design.extremes import LeastGap, StressDeviation, StressNorm, StressUnevenness, StretchNorm, TopHeight
from softmodels.design.model import DesignModel
from softmodels.design.problem import DesignProblem
from softmodels.design.quantities import (
    AddedVolume,
    DeviceFigure,
    FacePlace,
    ForceOn,
    InflationWork,
    LimitPressure,
    Rise,
    StoredEnergy,
    Turn,
)
from softmodels.design.targets import Pose
from softmodels.design.trials import DesignError, EvaluatedLoad

TAYLOR = "Taylor's remainder of new quantities by numbers of parts, loads and pressures"
LAW = sm.NeoHookean(20e3, 0.49)
SHARE = 0.04
"""First step of Taylor's remainder, relative to the parameter."""
NOISE = 2e-4
"""Remainder over the linear part at the smallest step below which the order says nothing."""


@pytest.fixture
def exact(taylor, figure):
    """Return a function that asserts the order of every quantity of a model by every parameter, by steps of a share of it; of
    some by another ``finer`` one."""

    def check(model, what, share=SHARE, **finer):
        for name in model.names:
            found = taylor(model, name, finer.get(name, share))
            for order, left in found.values():
                if left > NOISE:
                    figure(TAYLOR, f"distance of the order from 2, {what}", order - 2.0, 0.1)
                else:
                    figure(TAYLOR, f"remainder over the linear part at the smallest step, {what}", left, NOISE)
        model.release()

    return check


@pytest.mark.campaign
def test_a_tube_with_all_that_is_no_contact(comm, exact):
    """Weight, a hanging mass, a pull, a cap of its own silicone, fibres in the silicone, cloth and a sheet on its faces."""
    parts = (
        sm.Region(sm.NeoHookean(60e3, 0.49), name="cap"), Fibres(on="wall", angle=60.0, modulus=1e5, name="braid"),
        Fabric(on="outer", along=20.0, across=40.0, shear=5.0, name="cloth"), Sheet("end", 15.0), sm.Gravity("-z"),
        Weight("end", 0.002), sm.Force("end", "z", 0.02, name="pull"),
    )  # fmt: skip
    case = Case(
        "tube",
        Cylinder(length=0.020, cell_size=0.004),
        sm.Yeoh(15e3, 1e3, 0.0, 0.49),
        steps=steps_of(pressure_cm=(30.0,)),
        components=parts,
    )
    names = (
        "material.c1", "region.cap.shear_modulus", "fibres.braid.angle", "fibres.braid.modulus", "fabric.cloth.across",
        "sheet.stiffness", "gravity.magnitude", "mass.amount", "force.pull.amount",
    )  # fmt: skip
    at = {"at": 2000.0}
    quantities = (
        StressDeviation(**at), StressUnevenness(**at, region="wall"), StressNorm(**at), StretchNorm(**at, above=0.012),
        TopHeight(**at), FacePlace(**at, of="end"), AddedVolume(**at), StoredEnergy(**at),
        Rise(at=EvaluatedLoad("volume", 4e-7)),
    )  # fmt: skip
    exact(DesignModel(case, names, quantities, comm), "tube with parts and loads", SHARE / 2)


@pytest.mark.campaign
def test_a_finger_whose_chambers_press_on_each_other(comm, exact):
    """The interface between base and chambers moves with the gap, and contact is of the moved walls."""
    device = PneuNet(chambers=2, chamber_length=0.004, cell_size=0.008, gap=0.0003, wall=0.0008, base=0.002, least_wall=1e-4)
    base = sm.Region(sm.NeoHookean(90e3, 0.49), name="base")
    case = Case("finger", device, sm.NeoHookean(30e3, 0.49), steps=steps_of(pressure_cm=(150.0,)), components=(base,))
    quantities = (Turn(of="tip", at=5000.0), InflationWork(at=5000.0), FacePlace(of="tip", axis="x", at=5000.0))
    model = DesignModel(case, ("gap",), quantities, comm)
    model.evaluate(model.start)
    system = model.meshed.design.system
    assert system.potential.terms["walls"].figures(system)["walls_contact_N"] > 0.01
    exact(model, "finger with walls in contact")


DISK = HollowDisk.variant("shadow", section="axisymmetric", cell_size=0.005)
BALL = RigidShape("sphere", "top", (0.0, 0.0, 0.02702), radius=0.015, name="ball")


@pytest.mark.campaign
def test_a_disk_under_a_ball_that_gives_way(comm, exact):
    """On a spring; the air's work is the integral of p dV."""
    ball = dataclasses.replace(BALL, guide="z", spring=50.0)
    case = Case("disk", DISK, LAW, steps=steps_of(pressure_cm=(20.0,)), components=(ball,))
    quantities = (ForceOn(of="ball", at=1500.0), InflationWork(at=1500.0), TopHeight(at=1500.0))
    model = DesignModel(case, ("membrane",), quantities, comm)
    work = model.evaluate(model.start).values["inflation work at 1.5 kPa"]
    exact(model, "disk under a ball")
    run = sm.inflate(DISK, LAW, pressures="0:1.5:0.1 kPa", components=(ball,))
    assert work == pytest.approx(np.trapezoid(run.pressure, run.added_volume), rel=2e-3)


@pytest.mark.campaign
def test_a_disk_that_slides_on_a_ball(comm, exact):
    """Friction: exact through the steps that lead to the state, most of whose points slide; values nearly as of a run."""
    ball = dataclasses.replace(BALL, friction=0.1)
    case = Case("disk", DISK, LAW, steps=steps_of(pressure_cm=(20.0,)), components=(ball,))
    quantities = (ForceOn(of="ball", at=800.0), StressNorm(at=800.0), AddedVolume(at=800.0))
    names = ("membrane", "material.shear_modulus", "contact.ball.z")
    model = DesignModel(case, names, quantities, comm)
    here, run = (
        model.evaluate(model.start).values,
        sm.run(dataclasses.replace(case, steps=steps_of(pressure_cm=(800.0 / case.column.pascal,)))),
    )
    figures = model.meshed.design.system.potential.terms["ball"].figures(model.meshed.design.system)
    assert 0.3 < figures["ball_sliding"] < 0.99
    assert here["force on ball at 0.8 kPa"] == pytest.approx(run.path["ball_force_z_N"][-1], rel=2e-3)
    assert here["added volume at 0.8 kPa"] == pytest.approx(run.added_volume[-1], rel=2e-4)
    exact(model, "disk that slides on a ball", SHARE / 20, **{"contact.ball.z": 2e-4})  # a gap of 0.02 mm at rest


@pytest.mark.campaign
def test_a_finger_with_everything(comm, exact):
    """Every kind of quantity by every kind of parameter: a length, an angle, stiffnesses of a sheet and of a region, the ratio
    of two pressures (also under a volume) and the place of a shape that the tip presses on."""
    device = PneuNet(
        chambers=2, sides=2, opposite=0.3, chamber_length=0.004, chamber_height=0.006, cell_size=0.01, wall=0.0012,
        gap=0.0006,
    )  # fmt: skip
    ball = RigidShape("sphere", "tip", (device.length + 0.03005, 0.0, 0.001), radius=0.03, stiffness=20.0, name="ball")
    thread = Fibres(on="bottom", angle=40.0, axis=(1.0, 0.0, 0.0), stiffness=30.0)
    parts = (sm.Region(sm.NeoHookean(90e3, 0.49), name="base"), Sheet("top", 20.0), thread, ball)
    case = Case("finger", device, sm.NeoHookean(30e3, 0.49), steps=steps_of(pressure_cm=(40.0,)), components=parts)
    at = {"at": 3000.0}
    quantities = (
        StressDeviation(**at, region="base"), LeastGap(**at), TopHeight(**at), ForceOn(**at, of="ball", along="x"),
        InflationWork(**at), Pose(**at, of="tip", position={"x": "18 mm", "z": "-2 mm"}, turn="10 deg"),
        AddedVolume(**at), Rise(at=EvaluatedLoad("volume", 5e-8)),
    )  # fmt: skip
    names = (
        "base", "fibres.angle", "sheet.stiffness", "region.base.shear_modulus", "opposite", "contact.ball.z",
    )  # fmt: skip
    model = DesignModel(case, names, quantities, comm)
    assert model.evaluate(model.start).values["force on ball along x at 3 kPa"] > 0.01
    exact(model, "finger with everything", SHARE / 2)


@pytest.mark.campaign
def test_a_vacuum(comm, exact):
    """Values as of a run, and derivatives."""
    disk = HollowDisk.variant("shadow", section="axisymmetric", cell_size=0.005)
    case = Case("vacuum", disk, LAW, steps=steps_of(pressure_cm=(-1.0,)))
    quantities = (Rise(at=-80.0), AddedVolume(at=-80.0), StressNorm(at=-80.0), Rise(at=EvaluatedLoad("volume", -4e-7)))
    model = DesignModel(case, ("membrane", "material.shear_modulus"), quantities, comm)
    here = model.evaluate(model.start).values
    exact(model, "vacuum", SHARE / 4)
    run = sm.inflate(disk, LAW, pressures="-0.08 kPa", components=case.components)
    assert here["rise at -0.08 kPa"] == pytest.approx(run.apex[-1], rel=1e-6)
    assert here["added volume at -0.08 kPa"] == pytest.approx(run.added_volume[-1], rel=1e-6)


@pytest.mark.campaign
def test_limit_pressures_by_numbers_of_parts(comm, exact):
    disk = HollowDisk.variant("shadow", section="axisymmetric", cell_size=0.005)
    case = Case("limit", disk, LAW, steps=steps_of(pressure_cm=(20.0,)), components=(Sheet("top", 5.0), sm.Gravity("-z")))
    names = ("sheet.stiffness", "material.shear_modulus")
    exact(DesignModel(case, names, (LimitPressure(), Rise(at=1000.0)), comm, highest=6000.0), "limit point")


@pytest.mark.campaign
def test_the_search_finds_the_angle_of_a_scan(comm, tmp_path):
    """Elongation of a wound tube at a pressure; the design is a case that can be run."""
    case = Case(
        "long",
        Cylinder(length=0.020, cell_size=0.004),
        LAW,
        steps=steps_of(pressure_cm=(20.0,)),
        components=(Fibres(angle=50.0, modulus=3e5),),
    )
    asked = DeviceFigure(of="diameter_mm", at=1500.0)
    problem = DesignProblem(case, {"fibres": {"angle": ("20 deg", "85 deg")}}, maximise=asked)
    found = sm.optimise(problem, tmp_path / "out")
    model = DesignModel(case, ("fibres.angle",), (asked,), comm)
    scan = [model.evaluate(np.array([angle])).values[asked.key] for angle in np.linspace(20.0, 85.0, 14)]
    model.release()
    assert found.values[asked.key] > max(scan) - 0.01 * np.ptp(scan)
    assert Case.from_file(tmp_path / "out" / "design.toml").components[0].angle == found.parameters["fibres.angle"]


def test_whole_numbers(tmp_path):
    """Every number of convolutions is tried, and the best reported."""
    device = Bellows(convolutions=2, cell_size=0.005, through=1.0)
    case = Case("folds", device, LAW, steps=steps_of(pressure_cm=(1.0,)))
    problem = DesignProblem(case, {"convolutions": (1, 3)}, maximise=Rise(at=50.0))
    found = sm.optimise(problem, tmp_path / "out", confirm=False)
    assert found.device.convolutions == 3 and [text.split(":")[0] for text in found.variants] == [
        "convolutions 1", "convolutions 2", "convolutions 3",
    ]  # fmt: skip
    assert (tmp_path / "out" / "variants.csv").read_text().count("\n") == 4
    assert (tmp_path / "out" / "iterates.csv").read_text().count("\n") == 4
    assert Case.from_file(tmp_path / "out" / "design.toml").actuator == found.device
    again = sm.optimise(problem, tmp_path / "out", confirm=False, resume=True)
    assert again.values == found.values and not any(trial.seconds == 0.0 for trial in again.trials)


@pytest.mark.campaign
def test_a_design_that_stretches_far_without_a_limit_point_is_none_that_fails():
    """The problem that the page of designs begins with: it ended unconfirmed where the cavity had grown 60-fold."""
    disk = HollowDisk(section="axisymmetric", cell_size=0.003, cavity_radius=0.0115)
    case = Case("web", disk, sm.silicone("ecoflex-00-30"), steps=steps_of(pressure_cm=(177.0,)))
    limit = {"quantity": "limit_margin", "at_least": 1.25}
    problem = DesignProblem(case, {"cavity_radius": (0.0105, 0.013)}, maximise=Rise(at=177 * case.column.pascal), keep=[limit])
    found = sm.optimise(problem)
    assert found.feasible and not found.trouble and not any(trial.failed for trial in found.trials)
    assert found.parameters["cavity_radius"] == pytest.approx(0.013)


POSE = {"quantity": "pose", "of": "tip", "at": 900.0}
RUBBING = dataclasses.replace(BALL, friction=0.3)


@pytest.mark.parametrize(
    ("device", "parts", "changes", "words"),
    [
        (DISK, (RUBBING, sm.Gravity("-z")), {}, r"contact.ball.*friction.*no loads; leave out \[gravity"),
        (DISK, (RUBBING,), {"maximise": {"quantity": "limit_pressure"}}, "limit_pressure.*with friction.*friction = 0"),
        (DISK, (RUBBING,), {"maximise": Rise(at=EvaluatedLoad("volume", 1e-6))}, "at a volume.*designs need pressures"),
        (Cylinder(), (Fibres(modulus=1e5),), {"parameters": {"fibres.angle": (40.0, 100.0)}}, "between -90 and 90 deg"),
        (Cylinder(), (), {"parameters": {"fibres.angle": (40.0, 80.0)}}, r"no parameter 'fibres.angle'"),
        (Cylinder(), (sm.Region(LAW, name="cap"),), {}, "cannot move the interfaces between regions with wall"),
        (Cylinder(), (sm.Force("end", "z", name="pull"),), {}, "force.pull.*which has no amount"),
        (Cylinder(), (), {"maximise": {"quantity": "force_on", "of": "ball", "at": 900.0}}, "no rigid shape 'ball'"),
        (Cylinder(), (), {"maximise": {"quantity": "turn", "of": "tip", "at": 900.0}}, "no face 'tip'"),
        (Cylinder(), (), {"maximise": {"quantity": "von_mises_norm", "exponent": 1.0, "at": 900.0}}, "must be from 2 to 40"),
        (Cylinder(), (), {"maximise": Rise(at=-900.0)}, "pressures are above ambient"),
        (PneuNet(), (), {"maximise": {**POSE}}, "a pose needs a position.*a turn.*or both"),
        (PneuNet(), (), {"maximise": {**POSE, "position": ["30 mm"]}}, r"by axis, x, y or z, such as \{ x = "),
        (PneuNet(), (), {"maximise": {**POSE, "turn": "200 deg"}}, "turn of a pose is 200 deg.*-180 to 180"),
        (PneuNet(), (), {"maximise": {**POSE, "turn": 9.0, "tolerance": "0 mm"}}, "tolerance of a pose.*above zero"),
        (PneuNet(), (), {"maximise": {**POSE, "turn": "9 mm"}}, "9 mm"),
        (PneuNet(), (), {"parameters": {"chambers": (2.5, 4)}}, "they must be whole numbers"),
        (PneuNet(), (), {"parameters": {"chambers": (0, 4)}}, "chambers = 0 gives an invalid device"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_one_sentence(device, parts, changes, words):
    case = Case("design", device, LAW, steps=steps_of(pressure_cm=(10.0,)), components=parts)
    name = "membrane" if isinstance(device, HollowDisk) else "wall"
    value = getattr(device, name)
    given = {"parameters": {name: (0.9 * value, 1.1 * value)}, "maximise": Rise(at=900.0), **changes}
    with pytest.raises(DesignError, match=words) as error:
        DesignProblem(case, **given)
    assert "\n" not in str(error.value)
