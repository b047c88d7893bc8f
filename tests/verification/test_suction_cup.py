"""What a suction cup holds: its held lip, and a lip that touches its plane with friction, up to the leak."""

from __future__ import annotations

import math

import numpy as np
import pytest

import softmodels as sm
from geometries import GeometryError, SuctionCup
from softmodels.case.load import steps_of
from softmodels.materials.laws import NeoHookean
from softmodels.mechanics.component import ComponentError

VACUUM = 30.0  # cm
PASCAL = VACUUM * 95.12
AREA = "vacuum times the area within the lip, less the pull"
FINE = SuctionCup(through=12)
"""The sealed radius is known to a sixth of a facet of the lip."""


def pulled(cup, modulus, key="travel_mm", values=(0.0, 6.0), way="z", vacuum=VACUUM, **plane):
    """A cup at a vacuum, whose lip seals on a plane and whose stem is pulled."""
    seal = sm.RigidShape("plane", "lip", at=(0.0, 0.0, 0.0), along=(0.0, 0.0, 1.0), seal=True, name="plane", **plane)
    pull = sm.Force("top", way, name="pull")
    asked = steps_of(**{key: values}, at_pressure_cm=-vacuum)
    return sm.run(sm.Case("cup", cup, NeoHookean(modulus, 0.49), components=(pull, seal), steps=asked))


@pytest.fixture(scope="module")
def run():
    return pulled(SuctionCup(), 200e3)


@pytest.fixture(scope="module")
def fine():
    return pulled(FINE, 200e3)


def test_a_held_lip_bears_the_vacuum_over_its_area(figure):
    """Only the displacement of the rim and the pressure enter; the lip's force is the residual of the equations."""
    row = sm.inflate(SuctionCup(), NeoHookean(200e3, 0.49), f"-{VACUUM:g} cm").rows[-1]
    wanted = -row["pressure_Pa"] * math.pi * (row["sealed_mm"] / 2e3) ** 2
    figure(AREA, "force of a suction cup's held lip", row["lip_force_N"] / wanted - 1, 1e-10)


def test_the_pull_and_the_lip_bear_the_vacuum_inside_the_seal(run, figure):
    """The sealed area, the force of the contact and the load are three sums of their own."""
    held, lip, pull = (
        np.array([row[name] for row in run.rows]) for name in ("plane_hold_N", "plane_force_z_N", "force_pull_N")
    )
    assert lip[0] < -2.0 and (np.diff(lip) > 0.0).all() and (np.diff(pull) > 0.0).all()
    figure(AREA, "force of a suction cup's sealing lip", (pull - lip - held) / held, 1e-8)


@pytest.mark.campaign
def test_the_seal_moves_outwards_and_opens(run, figure):
    area = [row["plane_sealed_mm2"] for row in run.rows]
    assert area[0] < math.pi * 17.0**2 < 0.95 * max(area)  # first on the inner edge, at last on the outer one
    last = run.rows[-1]
    assert last["plane_contact_mm2"] < 50.0 < max(row["plane_contact_mm2"] for row in run.rows)
    assert last["plane_depth_mm"] < 1e-4
    told = run.limit.why
    assert "the seal of [contact.plane] opens" in told and "leak" in told and "radius" in told
    assert run._source.main == len(run.rows) - 1  # what pictures show of a path that was asked for one value, and has none
    by_force = pulled(SuctionCup(), 200e3, "force_N", (0.0, 5.0)).rows[-1]
    found = [by_force[name] / last[name] - 1 for name in ("force_pull_N", "travel_pull_mm", "plane_sealed_mm2")]
    figure("the leak found by pulling with a travel", "force, travel and sealed area at the leak, by a force", found, 1e-7)


@pytest.mark.campaign
def test_a_stiff_cup_holds_vacuum_times_area(figure):
    """Its lip seals on its outer edge at last."""
    row = pulled(SuctionCup(through=16), 5e6, values=(0.0, 0.5), vacuum=10.0).rows[-1]
    found = row["force_pull_N"] / (-row["pressure_Pa"] * math.pi * 0.019**2) - 1
    figure("vacuum times undeformed area", "force held by a stiff cup", found, 1e-2)


@pytest.mark.campaign
def test_the_force_held_converges_with_the_cells_of_the_lip(run, fine, figure):
    middle = pulled(SuctionCup(through=6), 200e3).rows[-1]["force_pull_N"]
    coarse, finest = run.rows[-1]["force_pull_N"], fine.rows[-1]["force_pull_N"]
    figure("four times as many rows of cells", "force held by a suction cup", coarse / finest - 1, 1e-2)
    figure("four times as many rows of cells", "force held by a suction cup with twice as many", middle / finest - 1, 5e-3)


@pytest.mark.campaign
def test_friction_bounds_the_shear_and_not_the_pull(run, figure):
    rubbed = pulled(SuctionCup(), 200e3, friction=0.5)
    found = rubbed.rows[-1]["force_pull_N"] / run.rows[-1]["force_pull_N"] - 1
    figure("no friction", "force held by a suction cup with friction", found, 1e-7)
    for row in rubbed.rows:
        assert row["plane_shear_N"] == pytest.approx(-0.5 * row["plane_force_z_N"], rel=1e-9, abs=1e-12)


@pytest.mark.campaign
def test_a_cup_pushed_aside_slides_at_friction_times_contact_force(figure):
    half = SuctionCup(section="wedge", angle=180.0, cell_size=0.004, through=1)
    rows = pulled(half, 80e3, values=(0.0, 3.0), way="x", vacuum=10.0, friction=0.25).rows
    assert 0.0 < rows[1]["force_pull_N"] < 0.5 * rows[1]["plane_shear_N"] and rows[1]["plane_sliding"] < 1.0
    found = rows[-1]["force_pull_N"] / rows[-1]["plane_shear_N"] - 1
    figure("friction times contact force", "lateral force of a sliding cup", found, 4e-5)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"ceiling": 0.016}, "ceiling is 16 mm; the skirt opens towards the lip"),
        ({"stem_radius": 0.009}, "stem_radius is 9 mm; it must be smaller than ceiling"),
        ({"lip": 0.00005}, "lip is 0.05 mm; it must be at least"),
        ({"depth": 0.001}, "depth is 1 mm; the skirt is flatter"),
        ({"cell_size": 0.02}, "cell_size is 20 mm; it must be at most"),
        ({"stem_height": 9.995}, "the device passes 10 m"),
    ],
)
def test_cups_that_cannot_be(changes, words):
    with pytest.raises(GeometryError, match=words):
        SuctionCup(**changes)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"faces": "top"}, "top shares no edge with the cavity, so it is no rim"),
        ({"at": (0.0, 0.0, -1e-3)}, "lip must lie in the plane at rest to seal on it, and is up to 1 mm off"),
        ({"guide": "z", "spring": 1.0}, "seals only on a fixed plane"),
        ({"shape": "sphere", "radius": 0.01}, "seals only on a fixed plane"),
    ],
)
def test_seals_that_cannot_be(changes, words):
    given = {"shape": "plane", "faces": "lip", "at": (0.0, 0.0, 0.0), "along": (0.0, 0.0, 1.0), "seal": True, **changes}
    with pytest.raises(ComponentError, match=words):
        sm.inflate(SuctionCup(), NeoHookean(200e3, 0.49), "-1 cm", components=[sm.RigidShape(**given)])
