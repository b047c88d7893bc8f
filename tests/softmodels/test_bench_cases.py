"""Experiments of a soft-robotics bench as they are written down: weights on membranes, heights, pressures in kPa."""

from __future__ import annotations

import numpy as np
import pytest

import softmodels as sm
from softmodels.case.case import Case

MEMBRANE = sm.Membrane(plate_radius=0.008, cell_size=0.002, through=2)
LAW = sm.NeoHookean(30e3, 0.49)
PLATE = sm.Rigid("plate", name="plate", mass=0.02)
LIFTED = """
[geometry]
device = "Membrane"
plate_radius = "8 mm"
cell_size = "2 mm"
through = 2

[rigid.plate]
face = "plate"
mass = "20 g"

[gravity]
direction = "-z"

[load]
"""


@pytest.fixture(scope="module")
def lifting():
    """A plate of 20 g on a membrane, to volumes."""
    return sm.inflate(MEMBRANE, LAW, volumes="0,2,5 ml", parts=[PLATE, sm.Gravity("-z")])


def test_a_requested_volume_is_the_one_in_the_table(lifting):
    """Of a device that hangs, too: counted from the undeformed cavity, and 0 is as it hangs."""
    asked = [row["added_volume_ml"] for row in lifting.rows if row["requested"]]
    assert asked[0] < -1.0 and asked[1:] == pytest.approx([2.0, 5.0], rel=1e-9)
    assert lifting.at("3 ml").added_volume == pytest.approx(3e-6, rel=1e-9)


def test_a_program_counts_volumes_alike(lifting):
    run = sm.run(Case.from_toml(f"{LIFTED}cavity1.volume_ml = [0, 2, 5]"))
    asked = [row for row in run.rows if row["requested"]]
    wanted = [row for row in lifting.rows if row["requested"]]
    for name in ("added_volume_ml", "pressure_cm", "plate_z_mm"):
        assert [row[name] for row in asked] == pytest.approx([row[name] for row in wanted], rel=1e-6, abs=1e-9)


def test_a_volume_that_the_weight_has_passed_is_refused():
    with pytest.raises(sm.RunError, match=r"1 ml are not on this path.*has taken 2\.\d+ ml already") as end:
        sm.inflate(MEMBRANE, LAW, volumes="1:5 ml", parts=[PLATE, sm.Gravity("z")])
    assert end.value.status == 3
    run = sm.inflate(MEMBRANE, LAW, volumes="0:5 ml", parts=[PLATE, sm.Gravity("z")])
    assert run.rows[0]["requested"] and np.isclose(run.added_volume[-1], 5e-6)
