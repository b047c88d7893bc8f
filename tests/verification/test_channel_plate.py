"""A plate with a channel against the same body drawn by CAD, and the work of the pressure against the energy stored."""

import gmsh
import numpy as np
import pytest

import softmodels as sm
from geometries import meshing
from softmodels.components.loads import Gravity

LAW = sm.NeoHookean(30e3, 0.49)


def _drawn(file):
    """Write the block of 25 x 10 x 6 mm with a capsule of air as STEP, by the CAD kernel."""
    with meshing.private_model():
        occ = gmsh.model.occ
        block = (3, occ.addBox(0, -5, -3, 25, 10, 6))
        parts = [(3, occ.addCylinder(5, 0, -0.5, 15, 0, 0, 1.3)), *((3, occ.addSphere(x, 0, -0.5, 1.3)) for x in (5, 20))]
        air, _ = occ.fuse(parts[:1], parts[1:])
        occ.cut([block], air)
        occ.synchronize()
        meshing.write_step(file)


@pytest.mark.campaign
def test_one_channel_as_drawn_by_cad(tmp_path):
    _drawn(tmp_path / "one.step")
    drawn = sm.ImportedActuator(
        file=str(tmp_path / "one.step"), support="x = 0 mm", gauge_point="at 25, 5, 3 mm", cell_size=0.0015
    )
    plate = sm.ChannelPlate(
        outline="rectangle 25 x 10 mm", channels=("5, 0 to 20, 0 mm",), gauge_point="at 25, 5 mm", cell_size=0.002, around=11
    )
    assert plate.cavity_volume == pytest.approx(drawn.cavity_volume, rel=3e-3)
    by_cad, by_distance = (sm.inflate(device, LAW, pressures=[3e3, 6e3, 9e3]) for device in (drawn, plate))
    assert by_distance.added_volume[1:] == pytest.approx(by_cad.added_volume[1:], rel=0.01)
    assert by_distance.rise[1:] == pytest.approx(by_cad.rise[1:], rel=0.02)
    volume, pressure = by_distance.added_volume, by_distance.pressure
    work = float(np.sum(np.diff(volume) * (pressure[1:] + pressure[:-1]) / 2))
    assert by_distance.stored_energy[-1] == pytest.approx(work, rel=5e-3)  # of the trapezoids


HALF = {}
WEDGE = {
    "channels": ("6, 0 to 13, 0 mm", "0, 6 to 0, 13 mm", "-6, 0 to -13, 0 mm", "0, -6 to 0, -13 mm"),
    "outline": "circle 32 mm", "support": "free",
}  # fmt: skip


@pytest.mark.parametrize(
    ("given", "around", "tolerance"),
    [
        pytest.param(HALF, 12, 3e-3, marks=pytest.mark.campaign, id="half"),
        pytest.param(WEDGE, 12, 3e-3, marks=pytest.mark.campaign, id="wedge"),
        pytest.param(WEDGE, 6, 0.06, id="coarse wedge"),
    ],
)
def test_a_slice_inflates_as_the_whole(given, around, tolerance):
    part, whole = (
        sm.inflate(sm.ChannelPlate(**given, around=around, symmetry=symmetry), LAW, pressures=[1500.0, 3000.0])
        for symmetry in ("auto", "none")
    )
    assert part.rise[1:] == pytest.approx(whole.rise[1:], rel=tolerance)
    assert part.added_volume[1:] == pytest.approx(whole.added_volume[1:], rel=tolerance)
    assert part.stored_energy[1:] == pytest.approx(whole.stored_energy[1:], rel=tolerance)


def test_gravity_that_breaks_the_mirror_is_refused():
    plate = sm.ChannelPlate(outline="rectangle 25 x 10 mm", channels=("5, 0 to 20, 0 mm",), around=6, cell_size=4e-3)
    with pytest.raises(ValueError, match="or symmetry="):
        sm.inflate(plate, LAW, pressures=[1000.0], components=[Gravity("y")])
