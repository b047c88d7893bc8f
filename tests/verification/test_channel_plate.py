"""A plate with a channel against the same body drawn by CAD, and the work of the pressure against the energy stored."""

import itertools
import math

import gmsh
import numpy as np
import pytest

import softmodels as sm
from geometries import meshing
from softmodels.case.entries import CaseError
from softmodels.case.load import steps_of
from softmodels.casting.settings import MouldError
from softmodels.components.loads import Gravity
from softmodels.components.rigid import Clamp, Rigid
from softmodels.mechanics.component import ComponentError
from softmodels.mechanics.system import System

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


# -- The cell of a plate with many parallel channels -----------------------------------------------------------------


def _parallel(count, length, ends, **more):
    """Return a plate that the cells of a number of channels of a length (mm) fill, but for what closes their ends."""
    x, y = 2.0 * count, 0.5 * length + ends
    places = np.arange(2.0 - x, x, 4.0)
    channels = tuple(f"{at:g}, {-0.5 * length} to {at:g}, {0.5 * length} mm" for at in places)
    outline = f"{-x}, {-y}, {x}, {-y}, {x}, {y}, {-x}, {y} mm"
    return sm.ChannelPlate(outline=outline, channels=channels, offset=0.0, support="free", around=12, cell_size=0.002, **more)


def _moved(run, at, along):
    """Return the mean displacement in m along an axis of a section of the last state: ``at`` its mean place in m."""
    heights = np.linspace(-0.0026, 0.0026, 9)
    beside = np.roll((0.0005, 0.0, 0.0), 1 - along)  # along the section, which the axis is square to
    lines = [run.last.along(at - beside + (0, 0, z), at + beside + (0, 0, z), points=9) for z in heights]
    return float(np.mean([line["displacement"][:, along] for line in lines]))


@pytest.fixture(scope="module")
def cell():
    return sm.inflate(sm.ChannelCell(around=12), LAW, pressures=[4e3, 8e3])


def test_pressure_on_a_cell_works_as_much_as_is_stored(cell):
    """Also by the planes that travel: the volume that grows with them counts."""
    steps = zip(np.diff(cell.added_volume), itertools.pairwise(cell.pressure), strict=True)
    assert cell.stored_energy[-1] == pytest.approx(sum(dV * (a + b) / 2 for dV, (a, b) in steps), rel=5e-3)
    assert cell.stretch_across[-1] > 1.04 > 1.01 > cell.stretch_along[-1] > 1.005


def test_a_cell_between_held_walls_is_a_plate_between_held_sides(cell):
    """Two channels with closed ends, far from these: another mesh, another volume integral, no plane that travels."""
    plate = _parallel(2, 20.0, 2.3)
    run = sm.inflate(plate, LAW, pressures=[4e3, 8e3], components=[Clamp("edge within |x| > 3.99 mm", along="x")])
    held = sm.inflate(cell.case.actuator, LAW, pressures=[4e3, 8e3], components=[Clamp("wall", along="x")])
    assert held.stretch_across[-1] == pytest.approx(1.0, abs=1e-12) and held.stretch_along[-1] > 1.02
    ends = [np.array([0.0, y, 0.0]) for y in (0.0, 0.005)]
    stretch = 1.0 + (_moved(run, ends[1], 1) - _moved(run, ends[0], 1)) / 0.005
    assert stretch - 1.0 == pytest.approx(held.stretch_along[-1] - 1.0, rel=0.03)


@pytest.mark.campaign
def test_a_cell_tells_the_stretches_of_the_middle_of_a_plate(cell):
    run = sm.inflate(_parallel(8, 32.0, 3.8), LAW, pressures=[4e3, 8e3])
    across = 1.0 + _moved(run, np.array([0.008, 0.0, 0.0]), 0) / 0.008
    along = 1.0 + _moved(run, np.array([0.0, 0.008, 0.0]), 1) / 0.008
    assert across == pytest.approx(cell.stretch_across[-1], rel=0.01)
    assert along == pytest.approx(cell.stretch_along[-1], rel=0.01)
    assert across - 1.0 == pytest.approx(cell.stretch_across[-1] - 1.0, rel=0.1)


def test_a_rigid_plate_cannot_meet_a_plane_that_travels(body_of):
    body = body_of(sm.ChannelCell(around=8))
    with pytest.raises(ComponentError, match=r"\[rigid\] touches another rigid part or a face that travels"):
        System(body, LAW, components=[Rigid("top", "guided")])
    with pytest.raises(ComponentError, match="the face wall, which travels, touches the device's support"):
        System(body, LAW, components=[Clamp("top")])


def test_a_cell_is_not_exported_nor_cast(tmp_path):
    cell = sm.ChannelCell()
    with pytest.raises(
        CaseError, match=r"'wall' stays plane and travels \(together\), which decks do not .* whole device in place"
    ):
        sm.export(sm.Case("cell", cell, LAW, steps_of(pressure="1 kPa")), tmp_path / "cell.inp")
    plate, held = sm.ChannelPlate(symmetry="none"), [Clamp("edge", along="x", together=True)]
    with pytest.raises(CaseError, match=r"the face 'edge' stays plane .* hold it in place, or leave it free"):
        sm.export(sm.Case("plate", plate, LAW, steps_of(pressure="1 kPa"), components=held), tmp_path / "plate.inp")
    with pytest.raises(MouldError, match="make the mould of a ChannelPlate"):
        sm.mould(cell)


@pytest.mark.parametrize(("given", "words"), [
    ({"radius": 0.00197}, "at most 0.98 times half of pitch"), ({"offset": 0.0017}, "it comes out of thickness, 6 mm"),
    ({"pitch": 0.03}, "suggests a wrong unit"), ({"around": 4.0}, "it must be from 8 to 100"),
])  # fmt: skip
def test_what_makes_no_cell(given, words):
    with pytest.raises(sm.GeometryError, match=words):
        sm.ChannelCell(**given)


# -- Plates that leave their plane: growth across the channels is more than along them -------------------------------


def _rings(offset):
    """Return a disk with nine rings of air, each a polygon of 72 sides; channels and walls as of the cell below."""
    turns = np.radians(np.arange(0, 361, 5))
    rings = ((k * 2.4 * np.cos(turns), k * 2.4 * np.sin(turns)) for k in range(1, 10))
    channels = tuple(" to ".join(f"{x:.9f}, {y:.9f}" for x, y in zip(*ring, strict=True)) + " mm" for ring in rings)
    return sm.ChannelPlate(
        channels=channels, outline="circle 45.8 mm", radius=0.00075, support="free", thickness=0.0032, offset=offset,
        around=7, cell_size=0.0015,
    )  # fmt: skip


@pytest.mark.campaign
def test_rings_make_a_cone_on_the_side_of_the_channels():
    """Radii grow more than circles, so the disk becomes a cone, up to its rim's and its apex' rounding."""
    grown = sm.inflate(sm.ChannelCell(radius=0.00075, pitch=0.0024, thickness=0.0032, around=12), LAW, pressures=[12e3])
    cone = np.degrees(np.arccos(grown.stretch_along[-1] / grown.stretch_across[-1]))
    run = sm.inflate(_rings(1e-4), LAW, pressures=[12e3])
    line = run.last.along((0.0138, 4e-6, 0.001599), (0.0206, 4e-6, 0.001599), points=20)
    x, z = np.linspace(0.0138, 0.0206, 20) + line["displacement"][:, 0], line["displacement"][:, 2]
    slope = np.degrees(np.arctan(-np.polyfit(x, z, 1)[0]))
    assert run.rise[-1] > 3e-3 and 0.6 * cone < slope < cone


@pytest.mark.campaign
def test_radial_channels_make_a_saddle():
    """Circles grow more than radii. The outline is an ellipse, so that a quarter is meshed, which leaves the saddle free."""
    turns = [(math.tau * k / 48, 5.0 if k % 4 == 0 else 9.5 if k % 2 == 0 else 17.0) for k in range(48)]
    ends = [(math.cos(a) * r, math.sin(a) * r) for a, low in turns for r in (low, 32.0)]
    channels = tuple(f"{a:.9f}, {b:.9f} to {c:.9f}, {d:.9f} mm" for (a, b), (c, d) in itertools.batched(ends, 2))
    plate = sm.ChannelPlate(
        channels=channels, outline="circle 68 mm", scale_x=1.05, radius=0.00075, support="free", thickness=0.0026,
        offset=3e-5, around=6, cell_size=0.002,
    )  # fmt: skip
    run = sm.inflate(plate, LAW, pressures="0:8:0.5 kPa")

    def rise(x, y):
        line = run.last.along((0.95 * x, 0.95 * y, 0.001298), (x, y, 0.001298), points=3)
        return line["displacement"][-1, 2] - run.rise[-1]

    assert rise(0.0355, 1e-6) > 5e-4 and rise(1e-6, 0.0338) < -1.5e-3
    eigenvalues = run.lowest_eigenvalue
    assert eigenvalues.argmin() < len(eigenvalues) - 3 and abs(eigenvalues.min()) < 0.05 * eigenvalues[0]
