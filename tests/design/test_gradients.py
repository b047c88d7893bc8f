"""Gradients of all quantities by all parameters: Taylor's remainder, differences of located limits, and several ranks."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from geometries import Balloon, Bellows, Cylinder, HollowDisk, Membrane, SeminarActuator
from softmodels.case.case import Case
from softmodels.case.load import steps_of
from softmodels.design import model as model_module
from softmodels.design.extremes import PeakStretch
from softmodels.design.model import DesignModel
from softmodels.design.quantities import AddedVolume, BlockedForce, DeviceFigure, LimitPressure, Mass, Rise, Stiffness
from softmodels.design.states import WorkingStates
from softmodels.design.trials import DesignFailure, EvaluatedLoad
from softmodels.materials.laws import NeoHookean, Yeoh
from tests.support.campaigns import sampled

TAYLOR = "Taylor's remainder of every quantity by every length, before and past a limit point"
LENGTHS = (
    "membrane", "cavity_radius", "wall", "base", "cavity_height", "fillet", "base_fillet",
    "profile[1]", "profile[2]", "profile[3]",
)  # fmt: skip
WORKING = 2000.0
PAST = EvaluatedLoad("volume", 40e-6)


@pytest.mark.parametrize("name", sampled(LENGTHS))
def test_sections(designed, thin_disk, of_all_kinds, second_order, comm, name):
    second_order(designed(thin_disk, LENGTHS, of_all_kinds, comm), name, TAYLOR, "section")


@pytest.mark.parametrize("name", sampled(["radius", "thickness", "plate_radius", "rings[1]", "ring_thickness", "clamp_width"]))
def test_membranes(designed, second_order, comm, name):
    """A plate that is a face, a ring with a thickness, and a clamp that holds a ring from below, so that its width counts."""
    membrane = Membrane(
        cell_size=0.004, through=2.0, plate_radius=0.006, rings=(0.011, 0.014), ring_thickness=0.001, clamp="below",
        clamp_width=0.004,
    )  # fmt: skip
    quantities = (
        Rise(at=1000.0),
        AddedVolume(at=1000.0),
        PeakStretch(at=1000.0),
        Mass(),
        Rise(at=EvaluatedLoad("volume", 3e-6)),
    )
    names = ("radius", "thickness", "clamp_width", "plate_radius", "rings[1]", "ring_thickness")
    # A percent of a ring's radius is four of its width.
    second_order(designed(membrane, names, quantities, comm), name, TAYLOR, "membrane", 0.003 if "ring" in name else 0.01)


@pytest.mark.parametrize("name", sampled(["radius", "wall", "neck_radius", "neck_length", "fillet", "polar_radius"]))
def test_balloons(designed, second_order, comm, name):
    balloon = Balloon(cell_size=0.003, polar_radius=0.018)
    quantities = (
        Rise(at=1000.0),
        DeviceFigure(of="width_mm", at=1000.0),
        AddedVolume(at=1000.0),
        LimitPressure(),
        Mass(),
    )
    names = ("radius", "polar_radius", "wall", "neck_radius", "neck_length", "fillet")
    second_order(designed(balloon, names, quantities, comm), name, TAYLOR, "balloon")


@pytest.mark.parametrize("name", sampled(["inner_radius", "outer_radius", "wall", "pitch", "rounding", "cap"]))
def test_bellows(designed, second_order, comm, name):
    """Roots and crests with upright lines between their arcs, which shift as a pitch or a rounding changes."""
    bellows = Bellows(convolutions=1, rounding=0.0015, cell_size=0.004, through=1.0)
    quantities = (
        Rise(at=1000.0), DeviceFigure(of="width_mm", at=1000.0), AddedVolume(at=1000.0), PeakStretch(at=1000.0), Mass(),
    )  # fmt: skip
    names = ("inner_radius", "outer_radius", "wall", "pitch", "rounding", "cap")
    second_order(designed(bellows, names, quantities, comm), name, TAYLOR, "bellows")


@pytest.mark.parametrize("name", ["inner_radius", "wall", "length", "cap", "fillet"])
def test_tubes(designed, second_order, comm, name):
    tube = Cylinder(length=0.020, cell_size=0.003)
    quantities = (DeviceFigure(of="elongation_percent", at=2000.0), DeviceFigure(of="diameter_mm", at=2000.0),
                  AddedVolume(at=2000.0), Mass(), Stiffness(at=2000.0))  # fmt: skip
    names = ("inner_radius", "wall", "length", "cap", "fillet")
    second_order(designed(tube, names, quantities, comm), name, TAYLOR, "tube")


@pytest.mark.campaign
@pytest.mark.parametrize("name", sampled(["membrane", "profile[1]"]))
def test_wedges(designed, second_order, comm, name):
    wedge = HollowDisk.variant(
        "shadow",
        membrane=0.003,
        fillet=0.0,
        base_fillet=0.0,
        angle=15.0,
        azimuth=20.0,
        cell_size=0.006,
        profile=(1.0, 1.0),
    )
    names = ("membrane", "cavity_radius", "profile[1]")
    quantities = (Rise(at=WORKING), AddedVolume(at=WORKING), LimitPressure())
    second_order(designed(wedge, names, quantities, comm), name, TAYLOR, "wedge")


@pytest.mark.campaign
@pytest.mark.parametrize("name", ["thickness", "offset", "end_bore", "manifold_bore", "length"])
def test_slabs(designed, second_order, comm, name):
    slab = SeminarActuator(channels=1, spread=20.0, around=6.0, cell_size=0.006)
    names = ("thickness", "offset", "end_bore", "manifold_bore", "length")
    quantities = (
        Rise(at=6000.0), AddedVolume(at=6000.0), DeviceFigure(of="lift_angle_deg", at=6000.0), Stiffness(at=6000.0),
    )  # fmt: skip
    second_order(designed(slab, names, quantities, comm), name, TAYLOR, "slab")


@pytest.mark.campaign
@pytest.mark.parametrize("name", sampled(["thickness", "offset"]))
def test_blocked_forces(designed, second_order, comm, name):
    held = SeminarActuator(channels=1, spread=20.0, around=6.0, cell_size=0.006, tip="held")
    model = designed(held, ("thickness", "offset"), (BlockedForce(at=6000.0),), comm)
    second_order(model, name, TAYLOR, "blocked force of a slab")


@pytest.mark.campaign
def test_numbers_of_the_material(of_all_kinds, thin_disk, comm, figure):
    """Against differences of states that were solved for on one mesh with other numbers."""
    law, names = Yeoh(10e3, 100.0, 0.0, 0.49), ("c1", "c2", "poisson")
    case = Case(name="law", actuator=thin_disk, material=law, steps=steps_of(pressure_cm=(20.0,)))
    model = DesignModel(case, ("membrane",), of_all_kinds, comm, materials=names)
    here, meshed = model.evaluate(model.start), model.meshed
    for name in names:
        step, ends = 2.5e-4 * getattr(law, name), []
        for sign in (1, -1):
            meshed.design.system.set_material(dataclasses.replace(law, **{name: getattr(law, name) + sign * step}))
            meshed.states.carry()
            ends.append(meshed.judge(gradients=False)[0])
        for key, rates in here.material_gradients.items():
            difference = (ends[0][key].value - ends[1][key].value) / (2 * step)
            scale = max(abs(difference), 1e-3 * abs(here.values[key] / getattr(law, name)))
            figure("differences on one mesh", f"derivative by {name}", (rates[name] - difference) / scale, 1e-4)
    model.release()


@pytest.mark.parametrize("name", sampled(["membrane", "cavity_radius", "profile[1]"]))
def test_limit_pressures(designed, thin_disk, comm, figure, name):
    """Against differences of limits that were located on the moved meshes."""
    model = designed(thin_disk, LENGTHS, (LimitPressure(at=None), Rise(at=WORKING)), comm)
    i, start = LENGTHS.index(name), model.start
    step = 2e-4 * start[i]
    ends = [model.evaluate(start + sign * step * np.eye(len(start))[i]).values["limit pressure"] for sign in (1, -1)]
    rate = model.evaluate(start).gradients["limit pressure"][i]
    figure(
        "differences of located limits",
        "derivative of the limit pressure",
        (ends[0] - ends[1]) / (2 * step * rate) - 1,
        1e-5,
    )


@pytest.mark.campaign
def test_designs_are_carried(designed, thin_disk, of_all_kinds, comm, figure):
    """A state that was carried through another design is the same again, and nearly that of a fresh mesh there."""
    model = designed(thin_disk, LENGTHS, of_all_kinds, comm)
    start = model.start
    first = model.evaluate(start)
    far = model.evaluate(start * (1 + 0.1 * np.array([1, -1, 1, 0, 0, 0, 0, -1, 1, 0])))
    assert not far.remeshed and far.newton < 100
    back = model.evaluate(start)
    for key, value in first.values.items():
        figure("the same design before", "a design come back to, every quantity", back.values[key] / value - 1, 1e-7)
    fresh = model.confirm(far.theta)
    for key in ("rise at 2 kPa", "added volume at 2 kPa", "limit margin", "mass"):
        figure("a fresh mesh", "a carried mesh with lengths changed by 10 %", far.values[key] / fresh.values[key] - 1, 3e-3)


def test_a_limit_that_comes_into_reach_is_found(thin_disk, comm):
    """A design whose path met no limit point up to the highest pressure is followed to one that has it below."""
    case = Case(name="limits", actuator=thin_disk, material=NeoHookean(20e3, 0.49), steps=steps_of(pressure_cm=(10.0,)))
    model = DesignModel(case, ("membrane",), (Rise(at=1000.0), LimitPressure()), comm, highest=3300.0)
    without = model.evaluate(model.start)
    assert without.values["limit pressure"] == 3300.0 and any("none found up to 3.3 kPa" in note for note in without.notes)
    thinner = model.evaluate(0.9 * model.start)
    fresh = model.confirm(0.9 * model.start)
    model.release()
    assert fresh.values["limit pressure"] < 3200.0
    assert thinner.values["limit pressure"] == pytest.approx(fresh.values["limit pressure"], rel=1e-3)
    assert abs(thinner.gradients["limit pressure"][0]) > 0.0


@pytest.mark.campaign
def test_a_design_that_balloons_below_its_load_is_stepped_back_from(thin_disk, comm):
    case = Case(name="limits", actuator=thin_disk, material=NeoHookean(20e3, 0.49), steps=steps_of(pressure_cm=(20.0,)))
    model = DesignModel(case, ("membrane",), (Rise(at=WORKING), LimitPressure()), comm)
    here = model.evaluate(model.start)
    with pytest.raises(DesignFailure, match=r"limit point at 1\.\d+ kPa, before 2 kPa") as failure:
        model.evaluate(0.5 * model.start)
    again = model.evaluate(model.start)
    model.release()
    assert 1000.0 < failure.value.limit < WORKING
    assert not again.remeshed and again.newton < 80
    assert again.values["rise at 2 kPa"] == pytest.approx(here.values["rise at 2 kPa"], rel=1e-7)


@pytest.mark.campaign
def test_a_poor_mesh_is_made_anew_and_its_states_are_interpolated(comm, monkeypatch, figure):
    """Another length is free too, so that the two meshes have other units of length."""
    disk = HollowDisk.variant("shadow", section="axisymmetric", cell_size=0.004)
    case = Case(name="poor", actuator=disk, material=NeoHookean(20e3, 0.49), steps=steps_of(pressure_cm=(10.0,)))
    quantities = (Rise(at=1000.0), AddedVolume(at=PAST), LimitPressure())
    model = DesignModel(case, ("membrane", "cavity_radius"), quantities, comm, highest=4000.0)
    model.evaluate(model.start * (1.0, 1.05))
    model.evaluate(model.start * (0.75, 1.1))  # a mesh whose unit of length is another than that of the device it shows
    traced = []
    trace = WorkingStates.trace
    monkeypatch.setattr(WorkingStates, "trace", lambda states, *how: traced.append(states) or trace(states, *how))
    monkeypatch.setattr(model_module, "MIN_MESH_QUALITY", 0.55)
    there = model.evaluate(model.start * (0.5, 1.1))
    assert there.remeshed and not traced
    monkeypatch.undo()
    fresh = model.confirm(there.theta)
    assert model.meshed.design.system.length_unit != disk.size
    model.release()
    for key, value in fresh.values.items():
        figure("a fresh mesh", "interpolated to a mesh made anew, then carried on", there.values[key] / value - 1, 3e-3)
