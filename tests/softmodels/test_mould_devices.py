"""Every device has a mould: what its bodies leave, that they come off, and how they lie on the printer's plate."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from geometries import (
    ACTUATORS,
    Balloon,
    Beam,
    Bellows,
    BendingBellows,
    ChannelPlate,
    Cylinder,
    GeometryError,
    HollowDisk,
    ImportedActuator,
    ImportedMesh,
    Membrane,
    PneuNet,
    SuctionCup,
)
from geometries.actuator import Castable
from geometries.meshing import private_model
from softmodels.casting import pictures
from softmodels.casting.bodies import imported, left, recipe_of, tooling
from softmodels.casting.facets import PLATE_GAP, arranged, laid_flat, print_estimate
from softmodels.casting.files import _pour_steps, _steps
from softmodels.casting.make import _difference, _make_pieces, common_thickness, manifold_of
from softmodels.casting.settings import MouldError, MouldRequest, Workshop, asked_of
from tests.support.campaigns import sampled
from tests.support.moments import mirror_gap

COARSE = Workshop(chord=2e-4, least_gap=8e-4, pour=0.002, vents=1, bolt=0.0, shrinkage=0.01)
DEVICES = {
    PneuNet: (PneuNet(chambers=2, base=0.002, paper=0.0002), "chambers inlet pin, chambers lid, chambers cup, base tray"),
    Membrane: (Membrane(plate_radius=0.008, plate_thickness=0.002), "membrane floor, membrane frame"),
    Balloon: (Balloon(radius=0.006, neck_radius=0.002, fillet=0.0005), "upper lid, upper cup, lower lid, lower cup"),
    Bellows: (Bellows(convolutions=1), "wall core cup left, wall core cup right, wall core, wall lid, wall cup left, "
              "wall cup right, plate tray"),
    BendingBellows: (BendingBellows(folds=1, cap=0.003, root=0.004), "folds inlet pin, folds lid, folds cup, base tray"),
    Cylinder: (Cylinder(length=0.012), "tube lid, tube cup left, tube cup right"),
    SuctionCup: (SuctionCup(), "cup lid, cup cup"),
    Beam: (Beam(length=0.03), "beam tray"),
}  # fmt: skip
"""A small one of each class, and the bodies of its mould in the order in which they leave; lost cores are of wax."""
WAX = dataclasses.replace(COARSE, core="wax", wax_shrinkage=0.02)
ELSEWHERE = {"ChannelCell", "ChannelPlate", "HollowDisk", "SeminarActuator", "ImportedActuator", "ImportedMesh"}
"""Devices whose moulds `test_mould` and a test below make, and what has none."""


def test_every_device_is_here():
    """A device of a test or of a user may be registered beside the library's own."""
    own = {name for name, device in ACTUATORS.items() if device.__module__.startswith("geometries.")}
    assert own == {device.__name__ for device in DEVICES} | ELSEWHERE


@pytest.mark.parametrize("kind", sampled(DEVICES, (Membrane,)), ids=lambda kind: kind.__name__)
def test_a_device_is_cast_to_its_closed_form(kind, tmp_path):
    """What the bodies leave, bonded and shrunk, has volume and moments of the device's own mesh; no body meets another or the
    cast as it leaves, by the CAD kernel and by the triangles."""
    device, bodies = DEVICES[kind]
    workshop = WAX if kind is Bellows else COARSE
    _check(device, _make_pieces(device, recipe_of(device, workshop), workshop), bodies, tmp_path)


def _check(device, found, bodies, folder):
    """See the test above."""
    import gmsh

    assert ", ".join(body.name for body in found.bodies) == bodies
    assert found.differs < 1e-6 and abs(found.balance) < 1e-6
    assert found.volume == pytest.approx(device.solid_volume, rel=2e-6)
    assert mirror_gap(device, found.device, folder) < 5e-4
    for body in found.bodies:
        assert body.checked is not None and body.checked.overlap * 1e3 < 0.25 and body.checked.lean > -0.1
        assert manifold_of(body.facets).volume() == pytest.approx(body.facets.polyhedron_volume, rel=1e-9)
    with private_model():
        occ = gmsh.model.occ
        for cast in (found.casts[0], *found.waxes):
            solids = []
            for body in (*(body for body in found.bodies if body.piece == cast.piece and any(body.pull)), cast):
                (folder / "body.step").write_bytes(body.step)
                solids += imported(folder / "body.step")
            pull = next(body.pull for body in found.bodies if body.piece == cast.piece and any(body.pull))
            for way in np.diff((0.0, 0.3, 4.0)):
                occ.translate(solids[:1], *(way * np.array(pull)))
                common = occ.intersect(solids[:1], solids[1:], removeObject=False, removeTool=False)[0]
                assert sum(occ.getMass(*solid) for solid in common) < 1e-6


@pytest.mark.campaign
def test_a_network_is_cast_as_two_halves_with_half_the_channels():
    """The CAD kernel's channels have sharp joints, which are rounded in the mesh: the volumes differ by that."""
    device = ChannelPlate()
    found = _make_pieces(device, recipe_of(device, COARSE), COARSE)
    assert [body.name for body in found.bodies] == ["upper lid", "upper cup", "lower lid", "lower cup"]
    assert found.differs < 1e-6 and abs(found.balance) < 1e-6
    assert found.volume == pytest.approx(device.solid_volume, rel=5e-3)
    assert all(body.checked is not None and body.checked.overlap * 1e3 < 0.25 for body in found.bodies)


@pytest.mark.campaign
def test_a_balloon_is_cast_without_a_seam_around_wax(tmp_path):
    """The wax core is the cavity, larger by both shrinkages, with a peg of 1 degree; it is cast, not printed."""
    device = DEVICES[Balloon][0]
    found = _make_pieces(device, recipe_of(device, WAX), WAX)
    halves = ("balloon core cup left", "balloon core cup right")
    bodies = (*halves, "balloon core", "balloon lid", "balloon cup left", "balloon cup right")
    _check(device, found, ", ".join(bodies), tmp_path)
    assert {body.name for body in found.printed} == {*bodies} - {"balloon core"}
    (wax,) = found.waxes
    points = next(body.facets.points for body in found.bodies if body.name == "balloon core")
    length = 1e3 * WAX.pin_length
    tip = 0.5 * np.ptp(points[points[:, 2] < points[:, 2].min() + 1e-6, 0])
    root = tip + length * WAX.slope
    peg = np.pi / 3 * length * (tip**2 + tip * root + root**2)
    assert points[:, 2].min() == pytest.approx(-length)
    assert wax.facets.volume == pytest.approx((device.cavity_volume * 1e9 / 0.99**3 + peg) / 0.98**3, rel=1e-5)
    steps = " ".join(_steps(MouldRequest(device, WAX, "", "balloon"), found))
    assert steps.index("pour through the open end") < steps.index("Weigh A and B") < steps.index("Melt the wax out")


WOUND = """
name = "wound"
[geometry]
device = "Cylinder"
length = "12 mm"
section = "whole"
[fibres.thread]
on = "outer"
angle = "75 deg"
helices = 1
stiffness = "1 kN/m"
"""
THREAD = {"thread": 8e-4, "chord": 1e-4, "shrinkage": 0.01, "vents": 1, "bolt": 0.0}


@pytest.mark.campaign
def test_grooves_lie_where_the_fibres_are(tmp_path):
    """Small cubes along the model's own direction are in the ridges of the mould's halves, and half-way to the next thread they
    are not; nothing is undercut, nothing collides, and tube, casts and grooves add up."""
    (tmp_path / "case.toml").write_text(WOUND)
    asked = asked_of(tmp_path / "case.toml", **THREAD)
    (tmp_path / "again.toml").write_text(asked.to_toml())
    assert asked_of(tmp_path / "again.toml").workshop == asked.workshop and asked.workshop.angles == (75.0,)
    tube, found = asked.device, _make_pieces(asked.device, recipe_of(asked.device, asked.workshop), asked.workshop)
    assert found.differs < 1e-6 and abs(found.balance) < 1e-6
    assert found.volume == pytest.approx(tube.solid_volume, rel=2e-6)
    assert found.cast_volume * 0.99**3 == pytest.approx(found.volume - found.grooved, rel=2e-6)
    for body in found.bodies:
        assert body.checked.overlap * 1e3 < 0.1 and body.checked.lean > -0.1 and body.facets.open_edges == 0
    (lay,) = found.wound.lays
    assert lay.advance == pytest.approx(2 * np.pi * tube.outer_radius / np.tan(np.radians(75)))
    assert lay.threads == 3 and lay.spacing == pytest.approx(lay.advance / 3)
    square = lay.length(tube.outer_radius - 2e-4, found.wound.end - found.wound.begin) * 8e-4 * 4e-4
    assert square < found.grooved < 1.5 * square

    place, path = np.array([[tube.outer_radius, 0.0, 0.0]]), []
    while place[0, 2] < 8e-3:
        path.append(place[0])
        around = np.cross([0.0, 0.0, 1.0], place) / np.linalg.norm(place[:, :2])
        place = place + 1e-4 * (np.cos(np.radians(75)) * np.array([0.0, 0.0, 1.0]) + np.sin(np.radians(75)) * around)
        place[:, :2] *= tube.outer_radius / np.hypot(*place[0, :2])
    path = np.array([point for point in path if point[2] > 2e-3]) * [1 - 2e-4 / tube.outer_radius] * 1e3 / 0.99
    halves = [manifold_of(body.facets) for body in found.bodies if "cup" in body.name]
    turn = np.degrees(np.arctan2(path[:, 1], path[:, 0])) % 180.0
    between = path[(turn > 30.0) & (turn < 150.0)] + [0.0, 0.0, 0.5e3 / 0.99 * lay.spacing]
    assert _share_inside(path, halves) > 0.99 and _share_inside(between, halves) < 0.01 and len(between) > 100


def _share_inside(points, bodies):
    """Volume of cubes of 0.05 mm around points that is in bodies, as a share."""
    from manifold3d import Manifold, OpType

    cubes = Manifold.batch_boolean([Manifold.cube([0.05] * 3, True).translate(point) for point in points], OpType.Add)
    return sum((cubes ^ body).volume() for body in bodies) / cubes.volume()


def test_rings_are_as_large_as_their_closed_form():
    tube = DEVICES[Cylinder][0]
    workshop = Workshop(thread=6e-4, lay="90 deg", spacing=3e-3, vents=1, bolt=0.0)
    recipe = recipe_of(tube, workshop)
    with private_model():
        tools = tooling(tube, recipe, recipe.pours[0], workshop)
    ring = np.pi * (tube.outer_radius**2 - (tube.outer_radius - 3e-4) ** 2) * 6e-4
    assert tools.grooved * 1e-9 == pytest.approx(3 * ring, rel=1e-9)  # at 3, 6 and 9 mm of 11 mm


@pytest.mark.parametrize(
    ("device", "settings", "told"),
    [
        (Beam, {"lay": "75 deg"}, r"thread is 0.8 mm; grooves for it are made on tubes only"),
        (Cylinder, {}, r"no fibres on the face outer; give the case \[fibres\] there, or the angles"),
        (Cylinder, {"lay": "10 deg"}, r"lay has 10 deg; threads between 20 and 90 deg"),
        (
            Cylinder,
            {"lay": "35 deg"},
            r"at 35 deg lie 3\.\d+ mm apart .* grooves are 5\.\d+ mm wide where the halves part",
        ),
        (
            Cylinder,
            {"lay": "75 deg", "least_wall": 1e-3},
            r"ridges for it must be at least as wide as .* 1 mm \(least_wall\)",
        ),
    ],
)
def test_threads_that_no_mould_can_hold_are_a_sentence(device, settings, told):
    tube = DEVICES[device][0]
    workshop = dataclasses.replace(COARSE, thread=8e-4, **settings)
    with private_model(), pytest.raises(MouldError, match=told):
        tooling(tube, recipe_of(tube, workshop), recipe_of(tube, workshop).pours[0], workshop)


def test_a_lost_core_takes_the_inlet_of_its_lid_with_it():
    disk, workshop = HollowDisk.variant("shadow"), dataclasses.replace(COARSE, core="lost", tube=0.002)
    recipe = recipe_of(disk, workshop)
    with private_model():
        tools = tooling(disk, recipe, recipe.pours[1], workshop)
        assert tools.plugs and _difference(left(tools), tools.target, tools.size) < 1e-6


def test_wax_that_has_no_way_in_is_refused():
    device, workshop = DEVICES[Balloon][0], dataclasses.replace(WAX, least_gap=0.003, pour=0.004, vent=0.003)
    with pytest.raises(MouldError, match=r"peg is 2\.\d+ mm wide, too narrow .* print the core"):
        _make_pieces(device, recipe_of(device, workshop), workshop)


def test_the_lid_of_a_piece_called_cup_is_no_cup():
    (pour,) = recipe_of(SuctionCup(), COARSE).pours
    steps = " ".join(_pour_steps(pour, ["cup lid", "cup cup"], "4 h"))
    assert "Put the cup cup on the cup lid and bolt" in steps


@pytest.mark.campaign
def test_slender_fins_are_named_with_a_remedy_that_cures():
    """Between the chambers of a finger: as thick as the gap, as deep and long as the chambers' outsides; one sentence each."""
    finger = PneuNet(chambers=3)
    found = _make_pieces(finger, recipe_of(finger, COARSE), COARSE)
    cup = next(body for body in found.bodies if body.name == "chambers cup")
    (fin,) = (fin for fin in cup.checked.fins if fin.slender)
    scaled = 1e-3 / (1.0 - COARSE.shrinkage)
    assert (fin.thickness, fin.depth, fin.length) == pytest.approx((0.5 * scaled, 10 * scaled, 16 * scaled), rel=1e-3)
    assert fin.draft == pytest.approx(0.0, abs=1e-3) and fin.alike == 2 and fin.slenderness == pytest.approx(20.0, rel=1e-3)
    (note,) = found.notes
    assert "the chambers cup has 2 fins 0.505 mm thick, 10.1 mm deep and 16.2 mm long without draft (at " in note
    assert "20 times as deep as thick, more than 5" in note and "gap there at least 2 mm wide" in note
    cured = dataclasses.replace(finger, gap=0.002)
    assert _make_pieces(cured, recipe_of(cured, COARSE), COARSE).notes == []


SLOTS = [(1.0, 8.0, 0.0), (1.6, 8.0, 0.0), (1.0, 4.95, 0.0), (0.8, 8.0, 0.6), (0.7, 8.0, 0.6)]
"""Width and depth in mm of a slot at its middle, and draft of its flanks in degrees; the first and the last are slender."""


@pytest.mark.campaign
@pytest.mark.parametrize("slot", sampled(SLOTS, whole=True), ids=str)
def test_slender_fins_of_a_part_are_cured_by_width_depth_or_draft(slot, tmp_path):
    import gmsh

    width, depth, draft = slot
    top, slope = 15.0, math.tan(math.radians(draft)) * depth / 2
    with private_model():
        occ = gmsh.model.occ
        part, hole = (3, occ.addBox(0, -5, -5, 20, 10, 20)), (3, occ.addBox(10, -3, -2, 7, 6, 6))
        ends = [
            (-width / 2 - slope, top),
            (width / 2 + slope, top),
            (width / 2 - slope, top - depth),
            (slope - width / 2, top - depth),
        ]
        points = [occ.addPoint(5.0 + x, -6.0, z) for x, z in ends]
        lines = [occ.addLine(points[k - 1], points[k]) for k in range(4)]
        face = (2, occ.addPlaneSurface([occ.addCurveLoop(lines)]))
        cutter = [solid for solid in occ.extrude([face], 0, 12, 0) if solid[0] == 3]
        occ.cut([part], [hole, *cutter])
        occ.synchronize()
        gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
        gmsh.write(str(tmp_path / "part.step"))
        gmsh.option.setString("Geometry.OCCTargetUnit", "")
    device = ImportedActuator(file=str(tmp_path / "part.step"), cavities=("at 13, 0, 1 mm",), support="x = 20 mm")
    workshop = asked_of(device, pull="0, 0, 1", tube=0.0, bolt=0.0, chord="0.1 mm").workshop
    found = _make_pieces(device, recipe_of(device, workshop), workshop)
    cup = next(body for body in found.bodies if body.name == "upper cup")
    fin = max(cup.checked.fins, key=lambda fin: fin.slenderness)
    expected = (1e-3 * width, 1e-3 * depth, 10e-3)
    assert (fin.thickness, fin.depth, fin.length) == pytest.approx(expected, rel=0.01)
    assert fin.draft == pytest.approx(draft, abs=0.01)
    assert len(found.notes) == (slot in (SLOTS[0], SLOTS[-1]))


@pytest.mark.campaign
@pytest.mark.parametrize("kind", sampled([PneuNet, SuctionCup, Membrane, Bellows]))
def test_the_pictures_of_the_steps_show_the_sheet(kind, monkeypatch):
    """A cup that the sheet fills before the lid comes on is filled in the pictures, and the silicone there is up to the rim; a
    mould that is closed first is drawn so."""
    device, _ = DEVICES[kind]
    found, shots = _make_pieces(device, recipe_of(device, COARSE), COARSE), []
    monkeypatch.setattr(pictures, "_rendered", shots.append)
    for pour in found.recipe.pours:
        names = [text for text, _ in pictures._piece_steps(found, pour)]
        bodies, cast = found.of(pour)
        sheet = " ".join(_pour_steps(pour, [body.name for body in bodies], "4 h"))
        assert names[0].startswith("Fill") == ("Lower the lid" in sheet or not pour.lid)
        assert names[0].startswith("Close") == ("Pour through" in sheet)
        assert names[-1].endswith("dissolve the core") == ("Dissolve the core" in sheet)
        lost = [body for body in bodies if not any(body.pull)]
        assert len(lost) == ("Dissolve the core" in sheet)
        for body in lost:  # still within the piece as the mould opens, and nowhere else
            core, turn = body.facets.points @ pictures.standing(pour).T, [facets.points for facets, _, _ in shots[1]]
            assert any(points.shape == core.shape and np.abs(points - core).max() < 1e-9 for points in turn)
        if "Lower the lid" in sheet:
            assert names == [f"Fill the {pour.name} cup", "Lower the lid, cure", "Open"]
            brim = shots[-1][0][0]
            low, high = cast.facets.points.min(axis=0), cast.facets.points.max(axis=0)
            assert np.ptp(brim.points, axis=0) == pytest.approx(high - low, abs=0.1)
            core = brim.polyhedron_volume - cast.facets.volume
            lid = next(body for body in bodies if body.name.endswith("lid"))
            inside = lid.facets.points[:, 2].max() > low[2] + 1.0
            assert core > 100.0 if inside else core == pytest.approx(0.0, abs=1.0)


def test_a_core_that_cannot_leave_is_refused():
    with pytest.raises(MouldError, match=r"wall lid cannot be demoulded: it is undercut by .* let its core be lost"):
        workshop = dataclasses.replace(COARSE, core="rigid")
        _make_pieces(DEVICES[Bellows][0], recipe_of(DEVICES[Bellows][0], workshop), workshop)


def test_inlets_fit_their_fittings():
    """The hole of a barb grips it; a Luer's is a cone of 6 %, wider outside than at the chamber."""
    import gmsh

    device, holes = PneuNet(chambers=1, root=0.004), {}
    for inlet in ("tube", "barb", "luer"):
        workshop = dataclasses.replace(COARSE, inlet=inlet, shrinkage=0.0)
        recipe = recipe_of(device, workshop)
        with private_model():
            (plug,) = tooling(device, recipe, recipe.pours[0], workshop).plugs
            holes[inlet] = 1e-9 * gmsh.model.occ.getMass(*plug)
    assert holes["tube"] == pytest.approx(np.pi * 0.001**2 * 0.004, rel=1e-6)
    assert holes["barb"] == pytest.approx(0.64 * holes["tube"], rel=1e-6)
    tip, end = 0.5 * 0.00397, 0.5 * (0.00397 + 0.06 * 0.004)
    assert holes["luer"] == pytest.approx(np.pi / 3 * 0.004 * (tip**2 + tip * end + end**2), rel=1e-6)
    with pytest.raises(MouldError, match="inlet is 'luer', a cone that is wide outside"):
        disk = HollowDisk.variant("shadow")
        with private_model():
            tooling(disk, disk.recipe, disk.recipe.pours[1], workshop)


def test_bodies_lie_flat_and_apart_on_plates_of_their_size():
    device = DEVICES[Beam][0]
    found = _make_pieces(device, recipe_of(device, COARSE), COARSE)
    bodies = [(f"{body.name} {k}", body.facets) for k in range(4) for body in (*found.bodies, *found.extras)]
    workshop = dataclasses.replace(COARSE, bed_width=0.11, bed_depth=0.07, layer=1e-4, layer_time=10.0)
    placed = arranged(bodies, workshop)
    assert sorted(one.name for one in placed) == sorted(name for name, _ in bodies) and placed[-1].plate > 1
    boxes = [(one.plate, one.facets.points.min(axis=0), one.facets.points.max(axis=0)) for one in placed]
    for plate, low, high in boxes:
        assert low[2] == 0.0 and (low[:2] >= PLATE_GAP).all() and (high[:2] <= (110.0 - PLATE_GAP, 70.0 - PLATE_GAP)).all()
        for other, lower, upper in boxes:
            same = plate == other and (low == lower).all()
            assert same or plate != other or ((high[:2] < lower[:2]) | (upper[:2] < low[:2])).any()
    for one in placed:
        before = next(facets for name, facets in bodies if name == one.name)
        assert one.facets.polyhedron_volume == pytest.approx(before.polyhedron_volume, rel=1e-9)
    tray = laid_flat(found.bodies[0].facets)
    assert np.ptp(tray.points[:, 2]) == pytest.approx(min(np.ptp(tray.points, axis=0)))  # not on its edge
    times = print_estimate(placed, workshop).times
    assert len(times) == placed[-1].plate and times[0] == pytest.approx(
        10.0 * max(h[2] for p, _, h in boxes if p == 1) / 0.1, abs=10.0
    )


def test_what_two_polyhedra_have_in_common_has_its_thickness():
    from manifold3d import Manifold

    one, other = Manifold.cube((10.0, 10.0, 10.0)), Manifold.cube((10.0, 10.0, 10.0)).translate((0.0, 0.0, 9.0))
    assert common_thickness(one, other) == pytest.approx(2 * 100.0 / 240.0)
    assert common_thickness(one, other.translate((0.0, 0.0, 1.0))) == 0.0


def test_what_has_no_recipe_says_what_to_add():
    class Kite(Castable):
        pass

    with pytest.raises(GeometryError, match=r"a Kite names no casting recipe; give its class a property recipe.*extending\.md"):
        Kite().cast_along(None, None)
    with pytest.raises(GeometryError, match="pull and split apply only to imported parts"):
        Kite().cast_along((0.0, 0.0, 1.0), None)
    assert ImportedMesh.cast_along is not Castable.cast_along
