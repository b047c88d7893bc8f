"""Devices that bend: a tube with an eccentric channel against its cross-section, and what every motion has to balance."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from geometries import BendingBellows, PneuNet
from softmodels.materials.laws import Yeoh
from softmodels.materials.silicones import SILICONES
from softmodels.runs.fields import Fields
from tests.support import bent_tube
from tests.support.campaigns import sampled

TUBE = "cross-section of a long tube with an eccentric channel, bent by pressure"
CLOSED = "Betti's theorem with Saint-Venant's bending, small pressures"
ENERGY = "work of the pressure"
MIRRORED = "fingers of two sides, by symmetry"
LAW = Yeoh(10e3, 0.0, 0.0, 0.45)
TUBES = [
    PneuNet(chambers=1, chamber_length=length, chamber_width=0.006, chamber_height=0.004, side_wall=0.003, top_wall=0.0025,
            base=0.004, root=0.004, cap=0.004, cell_size=0.003)
    for length in (0.020, 0.035)
]  # fmt: skip
SECTION = (0.006, 0.003, (-0.002, 0.002, 0.006, 0.0085))
SILICONE = SILICONES["ecoflex-00-30/marechal-2021"].material
DEVICES = {
    "PneuNet": (PneuNet(chambers=2, cell_size=0.004), 600.0),
    "BendingBellows": (BendingBellows(folds=2, cell_size=0.005), 1500.0),
}


def section_of(law):
    bulk = 2 * law.shear_modulus_0 * (1 + law.poisson) / (3 * (1 - 2 * law.poisson))
    return bent_tube.BentTube(bent_tube.Section(*SECTION), (law.c1, law.c2, law.c3), bulk)


def test_the_walls_of_the_air_are_closed(equilibrium):
    """The cavity's faces enclose its volume; a face that runs under several chambers is among them."""
    device = DEVICES["PneuNet"][0]
    system = equilibrium(device, SILICONE).system
    assert system.rest().V * system.volume_unit == pytest.approx(device.cavity_volume, rel=1e-9)


@pytest.fixture(scope="module")
def inflated(equilibrium, solved):
    """Return a function that inflates a device to some pressures: all points, and the figures at these."""

    def inflate(device, law, *pressures):
        equations = equilibrium(device, law)
        _, points, end = solved(equations, [P / equations.system.stress_unit for P in pressures])
        assert end is None
        fields = Fields(equations)
        return points, [fields.figures(point.state) for point in points if point.requested]

    return inflate


@pytest.mark.parametrize("poisson", sampled([0.3, 0.45]))
def test_section_bends_as_its_closed_form(figure, poisson):
    law = Yeoh(10e3, 0.0, 0.0, poisson)
    k = section_of(law).solve(1e-3)
    young = 2 * law.shear_modulus_0 * (1 + poisson)
    small = bent_tube.Section(*SECTION).small_curvature
    figure(CLOSED, "curvature of the section", k / small(1e-3, young, poisson) - 1, 2.4e-6)
    assert abs(small(1e-3, young, 0.5)) < 1e-12 * small(1e-3, young, poisson)  # an incompressible one is not bent


@pytest.mark.campaign
def test_tube_bends_as_its_section(inflated, figure):
    """Two lengths: what their ends do to the angle is the same. With cells of 2 mm the differences are half of these."""
    pressures = (3000.0, 6000.0)
    section = section_of(LAW)
    angles = [[figures.device["bend_angle_deg"] for figures in inflated(tube, LAW, *pressures)[1]] for tube in TUBES]
    between = np.radians(np.diff(angles, axis=0)[0]) / (TUBES[1].length - TUBES[0].length)
    assert between[1] > 4 * between[0]  # far from straight on: its thin side balloons
    for pressure, k, most in zip(pressures, between, (0.06, 0.12), strict=True):
        figure(TUBE, f"angle per length, {pressure / 1e3:g} kPa", k / section.solve(pressure) - 1, most)


@pytest.mark.parametrize("name", sampled(DEVICES))
def test_work_is_stored(name, inflated, figure):
    """And it bends towards its base, all along its path."""
    device, pressure = DEVICES[name]
    points, figures = inflated(device, SILICONE, *np.linspace(pressure / 3, pressure, 3))
    V, P = (np.array([getattr(point.state, what) for point in points]) for what in ("V", "P"))
    slope = np.array([point.tangent.P / point.tangent.V for point in points])
    step = np.diff(V)
    work = float(np.sum(step * (P[:-1] + P[1:]) / 2 + step**2 * (slope[:-1] - slope[1:]) / 12))
    unit = SILICONE.shear_modulus_0 * device.size**3 * device.copies
    figure(ENERGY, f"stored energy, {name}", figures[-1].stored_energy / (work * unit) - 1, 2.3e-4)
    angles = [figure.device["bend_angle_deg"] for figure in figures]
    assert 2.0 < angles[0] < angles[1] < angles[2] and figures[-1].rises["tip"] < 0.0


def test_two_sides(inflated, figure):
    """Alike pressures bend nothing, for the cells are mirrored too; a side alone bends away from itself."""
    finger = dataclasses.replace(DEVICES["PneuNet"][0], sides=2)
    ((_, (alone,)), (_, (both,))) = (inflated(dataclasses.replace(finger, opposite=o), SILICONE, 400.0) for o in (0.0, 1.0))
    assert alone.device["bend_angle_deg"] > 2.0
    figure(MIRRORED, "bend angle under alike pressures, degrees", both.device["bend_angle_deg"], 1e-9)
    assert both.device["tip_x_mm"] > 1e3 * finger.length  # it grows long
