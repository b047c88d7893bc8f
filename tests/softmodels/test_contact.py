"""Walls that meet press on each other by default, and where they overlap it is seen; silicone between them is no gap."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import scipy

import softmodels as sm
from geometries import Bellows, BendingBellows, HollowDisk, PneuNet
from softmodels.case.case import Case
from softmodels.case.load import steps_of
from softmodels.case.materials import without_walls
from softmodels.components.contact import WallTerm
from softmodels.mechanics.body import Body
from softmodels.mechanics.component import ComponentError
from softmodels.mechanics.system import System
from softmodels.pictures.style import WARNING, title_colour
from softmodels.runs.labels import headline, overlap_text, state_labels
from softmodels.runs.notes import contact_notes, left_out
from softmodels.runs.state_values import FacingWalls, _near
from softmodels.runs.table import PathTable, Row
from tests.support import made_up as drawings, runs
from tests.support.campaigns import sampled

COARSE = PneuNet(chambers=2, cell_size=0.006)

DISKS = {
    "wedge": HollowDisk(cell_size=0.004, refinement=1.0),
    "section": HollowDisk(section="axisymmetric", cell_size=0.004),
    "thin": HollowDisk.variant("shadow", section="axisymmetric"),
}


@pytest.fixture(params=DISKS)
def made(request, tmp_path):
    """A device, its nodes and its walls."""
    disk = DISKS[request.param]
    points, cells, name = drawings.grid_of(disk, tmp_path)
    return disk, points, FacingWalls(points, cells, name, [plane.normal for plane in disk.cut_planes])


def sunk(disk, points, share):
    """A displacement that lowers the cavity's ceiling by a share of the cavity's height, and the membrane with it."""
    radius = np.hypot(points[:, 0], points[:, 1])
    over = np.clip((points[:, 2] - disk.base) / disk.cavity_height, 0.0, 1.0)
    dent = np.clip(1.0 - (radius / disk.cavity_radius) ** 2, 0.0, None)
    return np.outer(-share * disk.cavity_height * over * dent, [0.0, 0.0, 1.0])


def test_walls_at_rest_and_under_pressure_are_apart(made):
    disk, points, walls = made
    assert walls.least(sunk(disk, points, 0.0)) is None and walls.least(sunk(disk, points, -3.0)) is None
    gap = walls.least(sunk(disk, points, 0.9))
    assert gap.value > 0.0 and gap.share == 0.0 and not gap.overlaps


@pytest.mark.parametrize("share", sampled([0.8, 0.99, 1.02, 1.1, 1.5, 2.0], 2))
def test_the_gap_of_a_ceiling_over_a_floor_is_exact_on_both_sides_of_zero(made, share):
    """At the axis both are level, and there the ceiling has come down by the share of the cavity's height."""
    disk, points, walls = made
    gap = walls.least(sunk(disk, points, share), reach=disk.cavity_height)
    assert gap.value == pytest.approx((1.0 - share) * disk.cavity_height, abs=2e-3 * disk.cavity_height)
    assert gap.overlaps is (share > 1.0)
    if share > 1.0:
        assert np.hypot(gap.place[0], gap.place[1]) < 0.1 * disk.cavity_radius


def test_a_gap_knows_its_derivative(made):
    disk, points, walls = made
    rng = np.random.default_rng(7)
    u, way = sunk(disk, points, 1.2), rng.standard_normal(points.shape) * ([1.0, 0.0, 1.0] if walls.flat else 1.0)
    step = 1e-7 * disk.cavity_height
    gap, before, after = (walls.least(u + t * way) for t in (0.0, -step, step))
    assert np.array_equal(before.nodes, after.nodes)
    slope = np.einsum("ki,ki->", gap.rates, way[gap.nodes])
    assert (after.value - before.value) / (2 * step) == pytest.approx(slope, rel=1e-5)


def test_a_thin_wall_does_not_face_itself(made):
    """Flattened to a hundredth of its thickness, the membrane's two faces come near each other and stay apart."""
    disk, points, walls = made
    top = disk.base + disk.cavity_height
    squeezed = np.where(points[:, 2] > top, -0.99 * (points[:, 2] - top), 0.0)
    assert walls.gaps(np.outer(squeezed, [0.0, 0.0, 1.0])).share == 0.0


@pytest.mark.parametrize("device", [COARSE, Bellows()], ids=["finger", "bellows"])
def test_the_least_gap_is_that_of_all_places(device, tmp_path):
    """Walls apart, rough, and some or all far through each other: the search leaves out pairs of facets."""
    points, cells, name = drawings.grid_of(device, tmp_path)
    walls, random = FacingWalls(points, cells, name, [plane.normal for plane in device.cut_planes]), np.random.default_rng(3)
    seen = set()
    for waves, rough in ((0.0, 0.0), (0.003, 1e-5), (0.02, 0.0), (0.06, 1e-5), (0.2, 0.0)):
        shift = device.size * waves * np.sin(points / device.size * 23.0 + 1.0) + rough * random.standard_normal(points.shape)
        gaps, least = walls.gaps(shift), walls.least(shift)
        if least is None:
            assert not len(gaps.values)
            continue
        at = int(np.argmin(gaps.values))
        assert (least.value, least.share) == (gaps.values[at], gaps.share)
        assert np.array_equal(least.place, gaps.places[at])
        assert walls.cross(shift) == (gaps.values < 0.0).any()
        seen.add(least.value < 0.0)
    assert True in seen


def test_a_wall_that_goes_through_its_mirror_plane_is_seen(tmp_path):
    """The side of a chamber, bulged towards the plane that cuts the finger in two."""
    finger = PneuNet(chambers=2, gap=0.0)
    points, cells, name = drawings.grid_of(finger, tmp_path)
    walls = FacingWalls(points, cells, name, [plane.normal for plane in finger.cut_planes])
    half, low = finger.chamber_width / 2, finger.base / 2 + finger.channel_height
    x = (points[:, 0] - finger.root) / finger.chamber_length
    z = (points[:, 2] - low) / (finger.base / 2 + finger.chamber_height - low)
    bulge = np.where(np.abs(points[:, 1] - half) < 1e-9, x * (1 - x) * z * (1 - z) * 16, 0.0)
    bulge[(x < 0) | (x > 1) | (z < 0) | (z > 1)] = 0.0
    assert not walls.least(np.outer(-0.7 * half * bulge, [0.0, 1.0, 0.0])).overlaps
    shift = -1.5 * half * bulge
    gap = walls.least(np.outer(shift, [0.0, 1.0, 0.0]))
    assert gap.overlaps and gap.value == pytest.approx(2 * (half + shift.min()), rel=0.02)
    assert gap.rates[:, 1].sum() == pytest.approx(2.0)


def test_thickness_is_that_of_the_wall(made):
    disk, points, walls = made
    middles = points[walls.facets].mean(axis=1)
    inside = np.hypot(middles[:, 0], middles[:, 1]) < 0.5 * disk.cavity_radius
    ceiling = inside & (np.abs(middles[:, 2] - disk.base - disk.cavity_height) < 1e-9)
    floor = inside & (np.abs(middles[:, 2] - disk.base) < 1e-9)
    assert ceiling.any() and floor.any()
    assert walls.thickness[ceiling] == pytest.approx(disk.membrane) and walls.thickness[floor] == pytest.approx(disk.base)


@pytest.mark.parametrize("decades", [0.0, 1.5])
@pytest.mark.parametrize("count", [2, 300, 4000])
@pytest.mark.parametrize("flat", [False, True])
def test_near_pairs_are_those_of_a_tree(count, flat, decades):
    random = np.random.default_rng(count)
    places = random.random((count, 3)) - 0.4
    places[:, 1] *= not flat
    reach = 1.7 if count == 2 else count ** (-1 / (2 if flat else 3))
    radii = reach / 2 * 10 ** random.uniform(-decades / 2, decades / 2, count)
    pairs = np.sort(_near(places, radii), axis=0).T
    expected = scipy.spatial.cKDTree(places).query_pairs(2 * radii.max(), output_type="ndarray")
    distance = np.linalg.norm(np.diff(places[expected], axis=1)[:, 0], axis=1)
    expected = expected[distance < radii[expected].sum(axis=1)]
    assert len(expected) > count / 4
    assert sorted(map(tuple, pairs)) == sorted(map(tuple, expected))


@pytest.mark.parametrize("count", [0, 1])
def test_a_single_facet_is_near_none(count):
    assert not any(len(side) for side in _near(np.zeros((count, 3)), np.full(count, 0.1)))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Foreign(PneuNet):
    """A finger whose faces say nothing of which may meet, as those of a part from a file."""

    meeting = None


@pytest.mark.parametrize("device", [COARSE, BendingBellows(), Bellows()], ids=lambda device: type(device).__name__)
def test_walls_press_by_default_and_a_stored_case_repeats_it(device):
    case = Case("x", device, sm.NeoHookean(30e3), steps=steps_of(pressure_cm=(1.0,)), components=(sm.Gravity("-z"),))
    walls = [part for part in case.components if isinstance(part, sm.Walls)]
    assert walls == [sm.Walls()] and walls[0].automatic
    text = case.to_toml()
    assert 'faces = "auto"' in text and Case.from_toml(text) == case
    assert sm.Walls("none") in Case.from_toml(text.replace('faces = "auto"', 'faces = "none"')).components
    off = dataclasses.replace(case, components=(sm.Walls("none"),))
    assert off.components == (sm.Walls("none"),) and Case.from_toml(off.to_toml()) == off
    assert [part.off for part in without_walls(walls)] == [True]
    assert "in frictionless contact" in left_out(case) and "other walls may overlap" in left_out(off)


@pytest.mark.parametrize("device", [HollowDisk(), PneuNet(gap=0.0, wall=0.002)], ids=["disk", "ribs"])
def test_devices_whose_walls_never_meet_have_none(device):
    assert Case("x", device, sm.NeoHookean(30e3), steps=steps_of(pressure_cm=(1.0,))).components == ()


@pytest.mark.parametrize("faces", ["", "none, chamber_walls", "auto, auto", "chamber_walls, chamber_walls"])
def test_faces_that_cannot_be_meant_are_refused(faces):
    with pytest.raises(ComponentError):
        sm.Walls(faces)


def test_a_foreign_part_finds_the_walls_that_face_each_other(comm, tmp_path):
    """Those of a finger's gaps; a design's model, or one with walls off, has no such term."""
    foreign = Foreign(**{field.name: getattr(COARSE, field.name) for field in dataclasses.fields(COARSE)})
    file = COARSE.write(tmp_path / "finger.msh")
    terms = []
    for device, walls in ((COARSE, sm.Walls()), (foreign, sm.Walls()), (foreign, sm.Walls("none"))):
        system = System(Body.from_file(device, file, comm), sm.NeoHookean(30e3, 0.49), components=[walls])
        terms.append(system.potential.terms["walls"])
    named, found, off = terms
    assert isinstance(named, WallTerm) and not isinstance(off, WallTerm) and not off.energies
    middles = [term.nodes.places[term.nodes.facets].mean(axis=1) for term in (named, found)]
    assert sorted(map(tuple, np.round(middles[0], 9))) == sorted(map(tuple, np.round(middles[1], 9)))


@pytest.fixture(scope="module")
def fingers():
    """Both ways to 3 cm: as by default, and passing through."""
    return [sm.inflate(COARSE, sm.NeoHookean(16e3), "0,3 cm", components=components) for components in ([], [sm.Walls("none")])]


@pytest.mark.campaign
def test_chambers_do_not_pass_through_each_other_by_default(fingers):
    pressed, passing = (run.path for run in fingers)
    assert not pressed["walls_touch"].any() and pressed["walls_contact_N"][-1] > 0.0
    assert pressed["least_gap_mm"].min() > -0.01 * COARSE.wall * 1e3
    assert passing["walls_touch"][-1] == 1 and passing["least_gap_mm"][-1] < -0.05
    assert pressed["bend_angle_deg"][-1] > 1.05 * passing["bend_angle_deg"][-1]


def test_states_whose_walls_overlap_are_marked_on_pictures_and_in_notes(fingers):
    pressed, passing = (run._source for run in fingers)
    words = state_labels(passing.case)
    title = headline(passing.rows[-1], words)
    assert "WALLS OVERLAP by" in title and title_colour(title) == WARNING
    assert title_colour(headline(pressed.rows[-1], words)) != WARNING
    (note,) = contact_notes(passing.case, passing.rows)
    assert "WALLS OVERLAP" in note and "--walls auto" in note
    assert not list(contact_notes(pressed.case, pressed.rows))


@pytest.mark.parametrize("name", ["Triangle_6", "Tetrahedron_10"])
@pytest.mark.parametrize(
    ("width", "depth", "folded"),
    [(1.0, 0.0, False), (0.5, 0.0, False), (0.3, 0.1, False), (1.0, 1.2, False), (0.2, 0.3, True), (-0.2, 0.3, True)],
)
def test_a_facet_that_is_folded_onto_itself_is_an_invalid_state(name, width, depth, folded, fingers):
    """One that is compressed into a crease deeper than wide, also where its sides have passed each other; not a compressed one
    that is even or hardly bent, nor a groove that is stretched. Turned and scaled alike."""
    corners = np.array([[1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [1.5, 0.3, -3.0], [1.0, 1.0, 0.0]])[: 3 if "gle" in name else 4]
    pairs = [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)][: len(corners) * (len(corners) - 1) // 2]
    points = np.vstack([corners, [(corners[a] + corners[b]) / 2 for a, b in pairs]])
    upper, moved = points[:, 2] == 0.0, np.zeros_like(points)
    moved[upper, 0] = (width - 1.0) * (points[upper, 0] - 1.5)
    moved[upper & (points[:, 0] == 1.5), 2] = -depth
    walls = FacingWalls(points, np.arange(len(points))[None], name)
    assert walls.folded(moved) == folded
    if name == "Tetrahedron_10":
        turn = np.array([[0.0, 0.6, 0.8], [1.0, 0.0, 0.0], [0.0, 0.8, -0.6]])
        assert FacingWalls(3 * points @ turn, np.arange(10)[None], name).folded(3 * moved @ turn) == folded
    row = Row({**fingers[0]._source.rows[-1].cells, "walls_touch": 1})
    assert overlap_text(row) == "SURFACE FOLDED onto itself: invalid state"
    (note,) = contact_notes(fingers[0]._source.case, PathTable([row]))
    assert note.startswith("SURFACE FOLDED: from 3 cm on, in one state, ")


@pytest.mark.campaign
def test_a_state_between_two_is_judged_as_their_rows_are(fingers):
    """Walls that overlap at two states overlap between them, and by an amount between."""
    run = sm.inflate(COARSE, sm.NeoHookean(16e3), "0,3,5 cm", components=[sm.Walls("none")])
    high, low = (row["least_gap_mm"] for row in run.rows[1:] if row["requested"])
    between = run.at("4 cm").row
    assert between["walls_touch"] == 1 and low < between["least_gap_mm"] < high < 0.0
    assert run.at("5 cm").row["least_gap_mm"] == low
    assert high == pytest.approx(fingers[1].path["least_gap_mm"][-1], rel=1e-3)


# -- A plate over the disk, from the command line to the table, and what makes no contact ----------------------------


PLATE = ("--support", "base", "--contact", "top", "--contact-plane", "z = 17mm")


def test_a_plate_stops_the_disk_and_its_force_is_in_the_table(tmp_path):
    done = runs.disk(tmp_path / "a", *PLATE, "--pressure-cm", "0:177:59", "--quiet")
    assert done.status == 0 and done.err == "", done.err
    rows = runs.rows(tmp_path / "a")
    assert rows[0]["contact_force_N"] == 0.0 and rows[0]["contact_depth_mm"] == 0.0
    last = rows[-1]
    assert last["apex_mm"] == pytest.approx(1.0 + last["contact_depth_mm"], rel=0.02)
    assert 0.0 < last["contact_depth_mm"] < 0.1 and 0.5 < last["contact_force_N"] < 20.0
    assert all(row["contact_force_N"] == 0.0 for row in rows if row["apex_mm"] < 1.0)
    again = runs.run("-m", "softmodels", "run", tmp_path / "a" / "case.toml", "--output", tmp_path / "b", "--quiet",
                     "--no-pictures")  # fmt: skip
    assert again.status == 0
    runs.same(runs.rows(tmp_path / "a"), runs.rows(tmp_path / "b"), runs.REPEATED)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--contact", "top"), "--contact-plane"),
        (("--contact", "top", "--contact-plane", "z = 17"), "'17' has no unit"),
        (("--contact", "top", "--contact-plane", "x = 17mm"), "perpendicular to its axis"),
        (("--contact", "lid", "--contact-plane", "z = 17mm"), "no face 'lid'"),
        (("--contact", "outer", "--contact-plane", "z = 9mm"), "both sides"),
        (("--contact", "top", "--contact-plane", "z = 17mm", "--contact-stiffness", "0"), "shear moduli per size"),
    ],
)
def test_what_makes_no_contact_is_a_sentence_and_status_2(words, told, tmp_path):
    done = runs.disk(tmp_path / "disk", "--pressure-cm", "0:10", "--quiet", *words)
    assert done.status == 2 and done.out == "" and done.err.count("\n") == 1 and told in done.err
