"""Cases solved by CalculiX from the decks that are exported: rigid parts, clamps, cavities, dead loads.

Both programs have the same coarse mesh with displacements alone and the same energies; the rest is their own. The tests need
`ccx` (apt-get install calculix-ccx) and are skipped without it.
"""

from __future__ import annotations

import math
import shutil
import subprocess

import numpy as np
import pytest

import softmodels as sm
from softmodels.case.load import steps_of

pytestmark = pytest.mark.skipif(shutil.which("ccx") is None, reason="needs CalculiX (apt-get install calculix-ccx)")

CALCULIX = "CalculiX 2.20 of the exported deck, same mesh"
LAW = sm.Yeoh(14e3, 60.0, 0.0, 0.49)
FINGER = sm.PneuNet(chambers=2, cell_size=0.008)


def solved(folder, name, pressure, device=FINGER, **more):
    """The case's last row by softmodels; by CalculiX displacements in mm of the nodes that the deck names, at its last step."""
    components = (*more.pop("components", ()), sm.Walls("none"))  # a deck has no contact of walls
    case = sm.Case(
        name,
        device,
        more.pop("law", LAW),
        steps=steps_of(pressure_cm=(pressure,)),
        formulation="displacement",
        components=components,
        **more,
    )
    deck = sm.export(case, folder / "deck.inp")
    subprocess.run(["ccx", "deck"], cwd=folder, capture_output=True, check=True, timeout=600)
    *_, last = (folder / "deck.dat").read_text().split("displacements")
    words = [line.split() for line in last.splitlines()]
    found = {int(one[0]) - 1: np.array(one[1:], dtype=float) for one in words if len(one) == 4 and one[0].isdigit()}
    return sm.run(case).rows[-1], {name: found[node] for name, node in deck.watched.items()}


def probes_off(row, found, device=FINGER):
    """Shares by which CalculiX' rises of the device's probes differ."""
    lift = np.array(device.lift)
    return [found[probe] @ lift / row[f"{probe}_mm"] - 1 for probe in device.probes]


@pytest.mark.campaign
def test_the_polynomial_of_second_order(tmp_path, figure):
    """With c11 and c02 exchanged the rises differ by 1e-3."""
    law = sm.Polynomial(7e3, 3e3, 6e3, -2e3, 1.5e3, 0.49)
    row, found = solved(tmp_path, "polynomial", 40.0, law=law)
    figure(CALCULIX, "rises of a finger in the polynomial of second order", probes_off(row, found), 3e-4)


@pytest.mark.campaign
def test_a_plate_that_turns_under_its_weight(tmp_path, figure):
    """A rigid tip of its own mass, free in the half: it sags, and the air bends it further."""
    plate, weight = sm.Rigid("tip", name="plate", mass=5e-3), sm.Gravity("0.6, 0, -0.8")
    row, found = solved(tmp_path, "plate", 6.0, components=(plate, weight))
    assert row["plate_turn_y_deg"] > 5.0
    moved = found["centre of plate"] / [row["plate_x_mm"], np.inf, row["plate_z_mm"]]
    figure(CALCULIX, "way of a free rigid plate's centre", moved[[0, 2]] - 1, 8e-6)
    turned = math.degrees(found["rotation vector of plate in rad"][1])
    figure(CALCULIX, "turn of a free rigid plate", turned / row["plate_turn_y_deg"] - 1, 8e-6)


@pytest.mark.campaign
def test_a_guided_plate(tmp_path, figure):
    """A tip guided askew to the axes."""
    plate = sm.Rigid("tip", kind="guided", direction=(0.28, 0.0, -0.96), name="plate")
    row, found = solved(tmp_path, "guided", 12.0, components=(plate,))
    moved = found["centre of plate"] / [row["plate_x_mm"], np.inf, row["plate_z_mm"]]
    figure(CALCULIX, "way of a guided rigid plate", moved[[0, 2]] - 1, 1e-4)


@pytest.mark.campaign
def test_a_clamp_that_slips(tmp_path, figure):
    """A tip that slips only along z."""
    row, found = solved(tmp_path, "clamped", 20.0, components=(sm.Clamp("tip", slip="z"),))
    figure(CALCULIX, "rise of a clamped tip", probes_off(row, found), 8e-5)


@pytest.mark.campaign
def test_a_membrane_with_a_plate(tmp_path, figure):
    """A wedge whose plate and rigid collar rise."""
    device = sm.Membrane(
        radius=0.02, thickness=0.003, plate_radius=0.006, rings=(0.010, 0.013), ring_thickness=0.002, section="wedge",
        angle=30.0, cell_size=0.012,
    )  # fmt: skip
    components = (sm.Rigid("plate", name="plate"), sm.Rigid(region="ring1", name="collar"))
    row, found = solved(tmp_path, "plated", 25.0, device, components=components)
    for name in ("plate", "collar"):
        rise = found[f"centre of {name}"][2] / row[f"{name}_z_mm"] - 1
        figure(CALCULIX, f"rise of a rigid {name}", rise, 5e-6)
    figure(CALCULIX, "rise of a membrane with rigid parts", probes_off(row, found, device), 1e-5)


@pytest.mark.campaign
def test_two_cavities(tmp_path, figure):
    device = sm.PneuNet(chambers=2, cell_size=0.008, sides=2, opposite=0.25)
    row, found = solved(tmp_path, "two", 12.0, device)
    figure(CALCULIX, "rise of a finger with two pressures", probes_off(row, found, device), 2e-4)
