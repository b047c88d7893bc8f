"""Gradients of devices with rigid parts, fibres, fabrics and clamps on their boundary, and which parts are refused."""

from __future__ import annotations

import pytest

import softmodels as sm
from geometries import Cylinder, HollowDisk, Membrane
from geometries.actuator import parameter
from softmodels.case.case import Case
from softmodels.case.load import steps_of
from softmodels.components.fibres import Fabric, Fibres
from softmodels.design.problem import DesignProblem
from softmodels.design.quantities import AddedVolume, DeviceFigure, LimitPressure, Rise, Stiffness, StoredEnergy
from softmodels.design.trials import DesignError, EvaluatedLoad
from tests.support.campaigns import sampled

TAYLOR = "Taylor's remainder with parts on the boundary"
LAW = sm.NeoHookean(20e3, 0.49)


@pytest.mark.parametrize("name", sampled(["radius", "thickness", "plate_radius"]))
def test_a_plate_on_a_membrane(designed, second_order, comm, name):
    """Free to rise: under pressures, under a volume, and at the limit point."""
    membrane = Membrane(cell_size=0.004, through=2.0, plate_radius=0.006)
    quantities = (
        Rise(at=1000.0), AddedVolume(at=1000.0), StoredEnergy(at=1000.0), Rise(at=EvaluatedLoad("volume", 3e-6)),
        LimitPressure(),
    )  # fmt: skip
    components = (sm.Rigid("plate", name="plate"),)
    model = designed(membrane, ("radius", "thickness", "plate_radius"), quantities, comm, components)
    second_order(model, name, TAYLOR, "membrane with a rigid plate")


@pytest.mark.parametrize("name", sampled(["inner_radius", "wall", "length"]))
def test_a_reinforced_tube(designed, second_order, comm, name):
    """Two families of fibres in the silicone, cloth on its outside, and a rigid plate on its end."""
    tube = Cylinder(length=0.020, cell_size=0.004)
    braid = Fibres(angle=60.0, modulus=1e5, name="braid")
    cloth = Fabric(on="outer", along=20.0, across=40.0, shear=5.0, name="cloth")
    quantities = (
        DeviceFigure(of="elongation_percent", at=2000.0), DeviceFigure(of="diameter_mm", at=2000.0),
        AddedVolume(at=2000.0), StoredEnergy(at=2000.0), Stiffness(at=2000.0),
    )  # fmt: skip
    components = (braid, cloth, sm.Rigid("end", name="plate"))
    model = designed(tube, ("inner_radius", "wall", "length"), quantities, comm, components)
    second_order(model, name, TAYLOR, "reinforced tube")


@pytest.mark.parametrize(
    ("device", "part", "words"),
    [
        (Cylinder(), sm.Rigid(region="cap", name="plate"), "rigid.plate.* of a region.*cannot move the interfaces"),
        (Cylinder(), Fibres(on="wall", modulus=1e5), "fibres.* of a region"),
        (Cylinder(), sm.Clamp("cap", name="grip"), "hold.grip.* of a region"),
        (HollowDisk(angle=180.0), sm.Rigid("top", name="plate"), "rigid.plate.* can rotate"),
    ],
)
def test_what_no_gradient_knows_is_refused(device, part, words):
    case = Case("design", device, LAW, steps=steps_of(pressure_cm=(10.0,)), components=(part,))
    name = device.movable[0]
    value = parameter(device, name)
    with pytest.raises(DesignError, match=words):
        DesignProblem(case, {name: (0.95 * value, 1.05 * value)}, maximise=Rise(at=900.0))
