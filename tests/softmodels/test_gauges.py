"""Named points, angles and a plane's profile of any device: what they are, refused texts, ranks, and going on with --resume."""

from __future__ import annotations

import math

import numpy as np
import pytest

import softmodels as sm
from geometries import HollowDisk
from softmodels.case.case import Case, difference, identity
from softmodels.case.entries import CaseError, ProbeError, Probes, probes_from_tables, probes_to_tables
from softmodels.case.load import steps_of
from tests.support import runs
from tests.support.ranks import mpirun

BLOCK = """
[geometry]
device = "ImportedActuator"
file = "{file}"
cavities = ["at 10, 2, 7 mm"]
support = "x = 0 mm"
planes = ["y = 0 mm"]
cell_size = "6 mm"

[material]
law = "neo-hookean"
poisson = 0.49
shear_modulus = "30 kPa"

[load]
pressure_cm = [{pressures}]
"""
GAUGES = """
[points]
tip = "40, 0, {height} mm"
base = "4, 0, 0 mm"
root = "at 0, 0, 0 mm"

[angles]
bend = "base to tip"
opening = ["base to tip", "base to root"]

[profile]
plane = "y = 0 mm"
"""
TABLES = {
    "points": {"tip": "40, 0, 5 mm", "base": "0, 0, 5 mm"},
    "angles": {"bend": "base to tip"},
    "profile": {"plane": "y = 0 mm"},
}


def figures(now, lines=(("base", "tip"),), lift=(0.0, 0.0, 1.0)):
    """The angle of a line, or of two, whose undeformed ends are at 0, 40 mm along x and 30 mm along y."""
    rest = {"base": (0.0, 0.0, 0.0), "tip": (0.04, 0.0, 0.0), "side": (0.0, 0.03, 0.0)}
    gauges = Probes(tuple((name, "0, 0, 0 mm") for name in rest), (("bend", lines),))
    moved = {name: np.asarray(now.get(name, place)) - np.asarray(place) for name, place in rest.items()}
    return gauges.figures(rest, moved, lift)


@pytest.mark.parametrize("degrees", (0.0, 1e-5, 12.0, -30.0, 90.0, 150.0))
def test_a_line_turns_towards_the_lift(degrees):
    at = math.radians(degrees)
    found = figures({"tip": (0.05 * math.cos(at), 0.0, 0.05 * math.sin(at))})
    assert found["bend_deg"] == pytest.approx(degrees, abs=1e-10)
    assert found["tip_z_mm"] == pytest.approx(50 * math.sin(at), abs=1e-9) and found["base_x_mm"] == 0.0


def test_two_lines_have_an_angle():
    lines = (("base", "tip"), ("base", "side"))
    assert figures({}, lines)["bend_deg"] == pytest.approx(90.0)
    assert figures({"tip": (0.03, 0.03, 0.0)}, lines)["bend_deg"] == pytest.approx(45.0)


def test_tables_come_back():
    gauges = probes_from_tables(TABLES)
    assert probes_from_tables(probes_to_tables(gauges)) == gauges and probes_to_tables(gauges) == TABLES
    case = Case("disk", HollowDisk(), Case.from_toml("[geometry]\ndevice='HollowDisk'\n[load]\npressure_cm=[1]\n").material,
                steps=steps_of(pressure_cm=(1.0,)), gauges=gauges)  # fmt: skip
    assert Case.from_toml(case.to_toml()).gauges == gauges
    assert "[points]" not in Case("disk", HollowDisk(), case.material, steps=steps_of(pressure_cm=(1.0,))).to_toml()


REFUSED = (
    ({"points": {"tip": "40, 0, 5"}}, "point tip"),
    ({"points": {"tip": 40}}, "write a point as"),
    ({"points": {"my tip": "40, 0, 5 mm"}}, "cannot be used as a column name"),
    ({"angles": {"bend": "base to tip"}}, "no point 'base'"),
    ({**TABLES, "angles": {"bend": "tip to tip"}}, "twice"),
    ({**TABLES, "angles": {"bend": "base tip"}}, "from point to point"),
    ({**TABLES, "angles": {"bend": []}}, "two such lines"),
    ({"profile": {"plane": "named lid"}}, "write a plane"),
    ({"profile": {"line": "y = 0 mm"}}, "unknown entry 'line'"),
)


@pytest.mark.parametrize(("tables", "said"), REFUSED)
def test_bad_texts_are_refused(tables, said):
    with pytest.raises(ProbeError, match=said):
        probes_from_tables(tables)


def test_a_device_keeps_its_own_columns():
    text = '[geometry]\ndevice = "SeminarActuator"\n[load]\npressure_cm = [1]\n[points]\ntip = "70, 0, 4 mm"\n'
    with pytest.raises(CaseError, match="tip_x_mm is already a column"):
        Case.from_toml(text)


@pytest.fixture(scope="module")
def block(step_file, tmp_path_factory):
    """Half a block with an eccentric cavity, run to 15 cm with points: its case file, its folder, what it said."""
    folder = tmp_path_factory.mktemp("block")

    def draw(occ):
        occ.cut([(3, occ.addBox(0, 0, 0, 40, 6, 10))], [(3, occ.addBox(4, 0, 6, 32, 4, 2))])

    step_file(folder / "block.step", draw)
    case = folder / "case.toml"
    case.write_text(BLOCK.format(file="block.step", pressures="0, 15") + GAUGES.format(height=4.9))
    return case, folder / "out", run_case(case, folder / "out")


def run_case(case, folder, *words, **options):
    return runs.run("-m", "softmodels", "run", case, "-o", folder, "--no-pictures", *words, **options)


def test_points_and_angles_are_in_the_table(block):
    _, folder, done = block
    assert done.status == 0, done.err
    assert "point tip is tracked at 40, 0, 4.9 mm, on the surface" in done.err and "bend -" in done.out
    rest, *_, last = runs.rows(folder)
    assert (rest["tip_x_mm"], rest["tip_y_mm"], rest["tip_z_mm"]) == pytest.approx((40.0, 0.0, 4.9), abs=1e-9)
    assert rest["bend_deg"] == 0.0 and rest["opening_deg"] == pytest.approx(180 - math.degrees(math.atan2(4.9, 36.0)))
    across, up = ([last[f"tip_{axis}_mm"] - last[f"base_{axis}_mm"] for last in (rest, last)] for axis in "xz")
    turned = [math.degrees(math.atan2(z, x)) for x, z in zip(across, up, strict=True)]
    assert last["bend_deg"] == pytest.approx(turned[1] - turned[0], abs=1e-9) and last["bend_deg"] < -0.02
    assert (last["root_x_mm"], last["root_z_mm"]) == pytest.approx((0.0, 0.0), abs=1e-12)  # held


@pytest.mark.campaign
def test_two_ranks_and_going_on_tell_the_same(block, tmp_path):
    case, folder, _ = block
    shorter = case.with_name("shorter.toml")
    shorter.write_text(case.read_text().replace("pressure_cm = [0, 15]", "pressure_cm = [0, 5]"))
    assert run_case(shorter, tmp_path / "two").status == 0
    longer = case.with_name("longer.toml")
    longer.write_text(case.read_text().replace("pressure_cm = [0, 15]", "pressure_cm = [0, 5, 15]"))
    done = run_case(longer, tmp_path / "two", "--resume", launcher=[mpirun(), "-n", "2"])
    assert done.status == 0, done.err
    one, two = runs.rows(folder)[-1], runs.rows(tmp_path / "two")[-1]
    for column in ("tip_x_mm", "tip_z_mm", "base_z_mm", "bend_deg", "opening_deg"):
        assert two[column] == pytest.approx(one[column], rel=1e-7, abs=1e-9), column
    old, text = Case.from_file(longer), longer.read_text().replace("4.9 mm", "4.5 mm")
    assert difference(identity(old), identity(Case.from_toml(text, case.parent))) == "gauges.points"


def test_a_point_beside_the_part_is_refused(block, tmp_path):
    case, _, _ = block
    far = case.with_name("far.toml")
    far.write_text(case.read_text().replace("40, 0, 4.9 mm", "40, -30, 4.9 mm"))
    done = run_case(far, tmp_path / "far")
    assert done.status == 2 and "point tip is 30 mm off the surface; the nearest surface point is 40, 0, 4.9 mm" in done.err


def test_the_profile_is_the_outside_in_the_plane(block):
    from softmodels.runs.states import FolderStates, axes_of, cut_line

    states = FolderStates(block[1], "part")
    normal, at = states.case.gauges.cut
    size = states.actuator.size
    rest = 1e3 * cut_line(states.skin, states.points, np.zeros_like(states.points), normal, at, size)
    moved = 1e3 * cut_line(states.skin, states.points, states.field(len(states.rows) - 1, "displacement"), normal, at, size)
    lengths = np.linalg.norm(rest[:, 1] - rest[:, 0], axis=1)
    assert lengths.sum() == pytest.approx(100.0, rel=1e-3)  # round the block of 40 x 10 mm, the cavity left out
    assert np.abs(rest[..., 1]).max() < 1e-3 and rest[..., 2].max() == pytest.approx(10.0, abs=1e-6)
    assert moved[..., 2].max() > 10.05
    right, up = axes_of(normal, states.actuator.lift)
    assert right == pytest.approx((1.0, 0.0, 0.0)) and up == pytest.approx((0.0, 0.0, 1.0))


def test_a_point_of_a_section_is_the_apex(tmp_path):
    case = tmp_path / "disk.toml"
    case.write_text(
        '[geometry]\ndevice = "HollowDisk"\nsection = "axisymmetric"\ncell_size = "6 mm"\n[load]\npressure_cm = [50]\n'
        '[points]\ntop = "0, 0, 16 mm"\nrim = "20, 0, 16 mm"\n'
    )
    assert run_case(case, tmp_path / "out").status == 0
    row = runs.rows(tmp_path / "out")[-1]
    assert row["top_z_mm"] == pytest.approx(16.0 + row["apex_mm"], abs=1e-9) and row["top_x_mm"] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.campaign
def test_the_rotation_of_a_face_is_the_bend():
    """The tip of a bent finger turns as far as two probes on it show; the chord to it turns about half as far."""
    finger = sm.PneuNet(chambers=2, cell_size=0.006)
    length = finger.probes["tip"][0]
    tables = {
        "points": {"root": "0, 0, 0 mm", "end": f"{1e3 * length:.9g}, 0, 0 mm"},
        "angles": {"bend": f"face x = {1e3 * length:.9g} mm", "chord": "root to end"},
    }
    gauges = probes_from_tables(tables)
    assert probes_to_tables(gauges) == tables and gauges.columns()[-2:] == ["chord_deg", "bend_deg"]
    case = Case("bent", finger, sm.NeoHookean(30e3), steps=steps_of(pressure_cm=(0.0, 10.0)), gauges=gauges)
    run = sm.run(case)
    bend, chord, probes = (run.path[name][-1] for name in ("bend_deg", "chord_deg", "bend_angle_deg"))
    assert run.path["bend_deg"][0] == pytest.approx(0.0, abs=1e-5)
    # The lift of a finger is upwards, and it bends down.
    assert abs(bend) == pytest.approx(abs(probes), rel=0.05) and abs(probes) > 4.0
    assert 0.4 < chord / bend < 0.75
    with pytest.raises(ProbeError, match="has no face 'face x = 1 mm'"):
        sm.run(Case("bent", finger, sm.NeoHookean(30e3), steps=steps_of(pressure_cm=(0.0, 1.0)),
                    gauges=probes_from_tables({"angles": {"bend": "face x = 1 mm"}})))  # fmt: skip


def test_faces_that_cannot_turn_are_refused():
    with pytest.raises(CaseError, match="faces of an axisymmetric section do not rotate"):
        Case("disk", HollowDisk(section="axisymmetric"), sm.NeoHookean(30e3), steps=steps_of(pressure_cm=(0.0, 1.0)),
             gauges=probes_from_tables({"angles": {"bend": "face z = 16 mm"}}))  # fmt: skip
    with pytest.raises(ProbeError, match="select the face by its position"):
        probes_from_tables({"angles": {"bend": "face named tip"}})


def test_a_point_of_a_device_that_hangs_is_where_it_was_named():
    """A path under gravity begins with a device that sags: where its points are then is not where they were named."""
    membrane, gravity = sm.Membrane(thickness=0.002, cell_size=0.004), sm.Gravity("-z", magnitude=98.1)
    points = Probes((("apex", "0, 0, 2 mm"), ("beside", "0, 0, 3 mm")))
    run = sm.inflate(membrane, sm.NeoHookean(30e3), "0:2 cm", components=[gravity], gauges=points)
    assert run.path["apex_z_mm"][0] < 1.0  # it hangs
    (note,) = [note for note in run.notes if "is tracked at" in note]
    assert note == "point beside is tracked at the nearest surface point of the model, 1 mm away"
