"""What a suction cup holds: balance with the vacuum over its sealed area, the stiff limit, refinement, and its lift-off."""

from __future__ import annotations

import math

import numpy as np
import pytest

import softmodels as sm
from geometries import GeometryError, SuctionCup
from softmodels.case.load import LoadRequest
from softmodels.materials.laws import NeoHookean

VACUUM = 30.0  # cm
AREA = "vacuum times the area within the lip, less the pull"


def pulled(cup, modulus, forces=(0.0, 2.5)):
    """A cup at a vacuum whose stem is pulled."""
    asked = LoadRequest("force_N", forces, at_pressure_cm=-VACUUM)
    return sm.run(
        sm.Case("cup", cup, NeoHookean(modulus, 0.49), components=sm.Force("top", "z", name="pull"), driven=asked)
    )


@pytest.fixture(scope="module")
def run():
    return pulled(SuctionCup(), 200e3)


@pytest.fixture(scope="module")
def held(run):
    """The state in which the lip lifts off."""
    return run.where("lip_force_N", 0.0)


def test_the_lip_bears_the_vacuum_over_its_area(run, figure):
    """Only the displacement of the rim and the pressure enter; the lip's force is the residual of the equations."""
    wanted = [-row["pressure_Pa"] * math.pi * (row["sealed_mm"] / 2e3) ** 2 - row["force_pull_N"] for row in run.rows]
    found = np.array([row["lip_force_N"] for row in run.rows])
    assert found[0] > 1.0 and found[-1] < 0.0 and (np.diff(found) < 0.0).all()
    figure(AREA, "force of a suction cup's lip", (found - wanted) / found[0], 1e-10)


def test_lift_off_is_located_and_named(run, held):
    force = held.row["force_pull_N"]
    assert abs(held.row["lip_force_N"]) < 1e-6 * force
    (told,) = (note for note in run.notes if "LIFTS OFF" in note)
    assert f"{force:.2f}"[:3] in told and "lip_force_N" in told
    # What is held pulls the lip together: less than vacuum times undeformed area.
    assert 0.8 < force / (VACUUM * 95.12 * math.pi * 0.015**2) < 0.98


def test_a_stiff_cup_holds_vacuum_times_area(figure):
    row = pulled(SuctionCup(), 5e6).where("lip_force_N", 0.0).row
    found = row["force_pull_N"] / (-row["pressure_Pa"] * math.pi * 0.015**2) - 1
    figure("vacuum times undeformed area", "force held by a stiff cup", found, 1e-2)


def test_the_force_held_hardly_depends_on_the_cells(held, figure):
    fine = pulled(SuctionCup(cell_size=0.0005, through=6), 200e3).where("lip_force_N", 0.0)
    found = held.row["force_pull_N"] / fine.row["force_pull_N"] - 1
    figure("cells of half the size", "force held by a suction cup", found, 2e-3)


def test_a_wedge_stands_as_the_section_does(run, figure):
    wedge = SuctionCup(section="wedge", angle=45.0, cell_size=0.002, through=1)
    row = sm.inflate(wedge, NeoHookean(200e3, 0.49), f"-{VACUUM:g} cm").rows[-1]
    found = row["lip_force_N"] / run.rows[0]["lip_force_N"] - 1
    figure("section of the same suction cup", "force of the lip of a wedge", found, 2e-2)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"ceiling": 0.016}, "ceiling is 16 mm; the skirt opens towards the lip"),
        ({"stem_radius": 0.009}, "stem_radius is 9 mm; it must be smaller than ceiling"),
        ({"lip": 0.00005}, "lip is 0.05 mm; it must be at least"),
        ({"depth": 0.001}, "depth is 1 mm; the skirt is flatter"),
        ({"cell_size": 0.02}, "cell_size is 20 mm; it must be at most"),
        ({"stem_height": 9.995}, "the cup passes 10 m"),
    ],
)
def test_cups_that_cannot_be(changes, words):
    with pytest.raises(GeometryError, match=words):
        SuctionCup(**changes)
