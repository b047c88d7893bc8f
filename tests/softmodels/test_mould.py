"""``softmodels mould``: what the bodies leave, how they part, and what is refused."""

from __future__ import annotations

import json
import zipfile
from xml.etree import ElementTree

import numpy as np
import pytest

import softmodels as sm
from geometries import HollowDisk, SeminarActuator
from geometries.meshing import private_model
from softmodels.casting.facets import read_step
from softmodels.casting.files import write_bodies
from softmodels.casting.make import made
from softmodels.casting.settings import MouldError, asked_of
from softmodels.pictures.offscreen import can_render
from tests.support import runs
from tests.support.moments import mirror_gap

SLAB = SeminarActuator(channels=1, fillet=0.0, around=6.0, cell_size=0.008)
BODIES = ("upper-cup", "upper-lid", "lower-cup", "lower-lid")
EXTRAS = ("bonding-jig", "coupon", "coupon-pin")


@pytest.fixture(scope="module")
def slab(tmp_path_factory):
    """The folder of a slab's mould, scaled for a silicone that shrinks by 1 %."""
    folder = tmp_path_factory.mktemp("slab")
    asked = asked_of(SLAB, "ecoflex-00-30", shrinkage=0.01, chord="0.05 mm")
    found = made(asked.device, asked.workshop)
    write_bodies(folder, asked, found)
    return folder, asked, found


def _stl(file):
    """Corners of a binary STL's triangles, shape (n, 3, 3)."""
    data = file.read_bytes()
    kind = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("colour", "<u2")])
    table = np.frombuffer(data[84:], dtype=kind)
    assert len(table) == int.from_bytes(data[80:84], "little")
    return table["corners"].astype(float)


@pytest.mark.campaign
def test_files_of_a_slab_leave_the_device(slab):
    """The files' cups and lids, subtracted from their box, against the device's own solid of another model."""
    import gmsh

    folder, asked, found = slab
    with private_model():
        occ = gmsh.model.occ
        cast = []
        for half in ("upper", "lower"):
            gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
            bodies = [body for kind in ("cup", "lid") for body in occ.importShapes(str(folder / f"{half}-{kind}.step"))]
            gmsh.option.setString("Geometry.OCCTargetUnit", "")
            x, y, _, wide, deep, high = occ.getBoundingBox(*bodies[0])
            level = SLAB.offset * 1e3 * asked.workshop.scale * (1 if half == "upper" else -1)  # each with its lid below
            space = occ.addBox(x, y, level, wide - x, deep - y, high - level)
            pieces = [occ.getMass(*piece) for piece in occ.cut([(3, space)], bodies)[0]]
            cast.append(max(pieces))  # without the holes of the bolts
    whole = SLAB.solid_volume * 1e9
    assert sum(cast) / asked.workshop.scale**3 + found.plug * 1e9 == pytest.approx(whole, rel=2e-4)
    assert found.differs < 1e-6 and found.volume * 1e9 == pytest.approx(whole, rel=2e-4)


@pytest.mark.campaign
def test_stl_is_watertight_and_agrees_with_step(slab):
    folder, _, _ = slab
    report = json.loads((folder / "checks.json").read_text())
    space, objects = "{http://schemas.microsoft.com/3dmanufacturing/core/2015/02}", {}
    for plate in sorted(folder.glob("plate-*.3mf")):
        with zipfile.ZipFile(plate) as package:
            assert {"[Content_Types].xml", "_rels/.rels"} <= set(package.namelist())
            model = ElementTree.fromstring(package.read("3D/3dmodel.model"))
        objects |= {one.get("name").replace(" ", "-"): one for one in model.iter(f"{space}object")}
        assert model.get("unit") == "millimeter"
    assert set(objects) == {*BODIES, *EXTRAS}
    for name in BODIES:
        corners = _stl(folder / f"{name}.stl")
        _, index = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
        edges = index.reshape(-1, 3)[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        known = {tuple(edge) for edge in edges.tolist()}
        assert len(known) == len(edges) and all((b, a) in known for a, b in known)
        volume = np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0
        points = np.array([[float(one.get(axis)) for axis in "xyz"] for one in objects[name].iter(f"{space}vertex")])
        faces = [[int(one.get(f"v{k}")) for k in (1, 2, 3)] for one in objects[name].iter(f"{space}triangle")]
        sides, laid = (np.linalg.norm(np.diff(one, axis=1), axis=2) for one in (corners, points[faces]))
        assert laid == pytest.approx(sides, abs=1e-4)  # turned to lie flat
        volumes = (np.einsum("ij,ij->", a, np.cross(b, c)) for a, b, c in (np.moveaxis(points[faces], 1, 0),))
        assert next(volumes) / 6.0 == pytest.approx(volume, rel=1e-5) and points[:, 2].min() == pytest.approx(0.0, abs=1e-6)
        with private_model():
            import gmsh

            exact = gmsh.model.occ.getMass(3, read_step(folder / f"{name}.step"))
        body = report["bodies"][name.replace("-", " ")]
        assert volume == pytest.approx(exact, rel=2e-4) and body["volume_mm3"] == pytest.approx(exact, rel=2e-5)
        assert body["stl_chord_mm"] <= 0.05 and body["least_draft_of_pins_and_holes_deg"] == pytest.approx(1.0, abs=1e-3)
        assert body["least_lean_of_part_deg"] > -0.1
    # The channel at its beginning is 1.4 mm wide, its silicone 2.1 mm thick at the end, where it is 2 mm wide.
    assert report["smallest_channel_mm"] == pytest.approx(1.4, abs=0.15)
    assert report["smallest_silicone_wall_mm"] == pytest.approx(2.0, abs=0.1)


@pytest.mark.campaign
def test_the_bonded_casts_are_the_device_in_its_own_place(slab, tmp_path):
    """The mirror: what the bodies leave, bonded and shrunk, has volume and moments of the device's own mesh."""
    assert mirror_gap(SLAB, slab[2].device, tmp_path) < 2e-3


@pytest.mark.campaign
def test_a_disk_is_cast_to_its_closed_form(tmp_path):
    disk = HollowDisk.variant("shadow", section="axisymmetric")
    asked = asked_of(disk, chord="0.1 mm")
    found = made(asked.device, asked.workshop)
    assert found.differs < 1e-6 and found.volume == pytest.approx(disk.solid_volume, rel=1e-6)
    assert mirror_gap(disk, found.device, tmp_path) < 5e-4
    assert [body.pull[2] for body in found.bodies] == [-1.0, 1.0, -1.0, 1.0]
    assert [cast.beyond for cast in found.casts] == pytest.approx([disk.membrane, disk.base], rel=1e-5)
    assert found.thinnest == pytest.approx(disk.membrane, rel=0.1)


@pytest.fixture(scope="module")
def part_of(tmp_path_factory):
    """A part from boxes (x, y, z, sizes; mm), the first of which is what the others are cut from."""
    import gmsh

    def draw(name, *boxes, **choices):
        file = tmp_path_factory.mktemp("components") / f"{name}.step"
        with private_model():
            solids = [(3, gmsh.model.occ.addBox(*box)) for box in boxes]
            gmsh.model.occ.cut(solids[:1], solids[1:])
            gmsh.model.occ.synchronize()
            gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
            gmsh.write(str(file))
            gmsh.option.setString("Geometry.OCCTargetUnit", "")
        return sm.ImportedActuator(file=str(file), **choices)

    return draw


BLOCK, HOLE = (0, -5, -5, 20, 10, 10), (6, -3, -2, 10, 6, 4)
ONE = {"cavities": ("at 11, 0, 0 mm",), "support": "x = 20 mm"}


@pytest.mark.campaign
def test_an_imported_part_is_parted_along_its_pull(part_of, tmp_path):
    """Any direction will do for a box, and what is bonded lies where it was drawn."""
    part = part_of("box", BLOCK, HOLE, **ONE)
    found = made(part, asked_of(part, pull="0, -2, 0", split="1 mm").workshop)
    assert found.differs < 1e-6 and found.volume == pytest.approx(part.solid_volume, rel=1e-9)
    assert [cast.beyond for cast in found.casts] == pytest.approx([0.002, 0.002])
    assert found.plug == 0.0 and found.channel == pytest.approx(0.004)
    assert mirror_gap(part, found.device, tmp_path) < 1e-6


def test_undercuts_are_refused_by_name(part_of):
    """A groove across the pull, where it is. Two cavities above each other hold a core."""
    part = part_of("groove", BLOCK, HOLE, (-1, -6, 2, 3, 12, 1.5), **ONE)
    with pytest.raises(MouldError, match=r"upper cup .* undercut by 90 deg at .*, 3\.5 mm, on the part's face \d+ \(a plane\)"):
        sm.mould(part, pull="0, 0, 1")
    two = part_of("two", BLOCK, (6, -3, 0.75, 10, 6, 2), (6, -3, -2.75, 10, 6, 2), cavities=("at 11, 0, 2 mm",),
                  support="x = 0 mm")  # fmt: skip
    with pytest.raises(MouldError, match=r"cavity around 11, 0, 1\.75 mm is entirely in the upper half"):
        sm.mould(two, pull="0, 0, 1")


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"draft": "9 deg"}, "it closes the inlet"),
        ({"draft": "20 deg"}, "between 0 and 15 deg"),
        ({"draft": "14 deg", "pin": "1.9 mm"}, "leaves a pin of 1.9 mm a tip"),
        ({"wall": "3 mm", "least_wall": "2 mm"}, "the printer's smallest wall is 2 mm"),
        ({"rim": "4 mm"}, "on both sides needs"),
        ({"vent": "0.2 mm"}, "hole is 0.5 mm"),
        ({"pour": "0.8 mm"}, "must be wider"),
        ({"pour": "12 mm"}, "has room for"),
        ({"tube": "0.4 mm"}, "thinner than the printer"),
        ({"tube": "50 mm"}, "of silicone around it"),
        ({"shrinkage": 0.3}, "silicones shrink by"),
        ({"surplus": -1.0}, "surplus"),
        ({"chord": "1 um"}, "chord"),
        ({"chord": "1 mm"}, "a quarter of the printer's gap"),
        ({"silicone": "rubber"}, "silicone 'rubber' is unknown"),
        ({"pull": "0, 0, 1"}, "apply only to imported parts"),
        ({"pull": "up"}, "three numbers"),
        ({"pull": "0, 0, 0"}, "must not be zero"),
        ({"pull": "0, 0, inf"}, "three numbers"),
        ({"split": "3 pints"}, "split"),
        ({"wal": "3 mm"}, "has no argument 'wal'"),
        ({"wall": "3 kg"}, "wall"),
        ({"wall": True}, "must be a number"),
        ({"clearance": -0.001}, "must not be negative"),
        ({"layer_time": "0 s"}, "layer_time is 0 s; it must be larger than 0"),
        ({"inlet": "hose"}, "tube, barb"),
        ({"bolt": "7.5 mm"}, "leaves walls thinner than the printer"),
    ],
)
def test_what_no_workshop_can_make_is_a_sentence(settings, told):
    with pytest.raises((MouldError, sm.ArgumentError), match=told):
        sm.mould(sm.HollowDisk.variant("shadow"), **settings)


@pytest.mark.campaign
def test_channels_finer_than_the_printer_are_refused():
    with pytest.raises(MouldError, match=r"the printer's smallest rib is 1\.6 mm"):
        sm.mould(SLAB, least_wall="1.6 mm", wall="8 mm", rim="10 mm", chord="0.1 mm")


def test_parts_that_cannot_be_parted_are_refused(part_of):
    part = part_of("plain", BLOCK, HOLE, **ONE)
    for settings, told in (
        ({}, "needs its opening direction"),
        ({"pull": "0 0 1", "split": "9 mm"}, "from -5 mm to 5 mm"),
    ):
        with pytest.raises(MouldError, match=told):
            sm.mould(part, **settings)
    half = part_of("half", BLOCK, HOLE, (-1, -6, -6, 30, 6, 12), planes=("y = 0 mm",), **ONE)
    with pytest.raises(sm.GeometryError, match="one of 2 equal pieces"):
        sm.mould(half, pull="0, 0, 1")
    with pytest.raises(MouldError, match="not 3"):
        sm.mould(3)


CASE = 'name = "disk"\n[geometry]\ndevice = "HollowDisk"\nvariant = "shadow"\n'


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (CASE + '[mould]\nwall = "9 miles"\n', "wall"),
        (CASE + "[mould]\nx = 1\n", "unknown entry 'x'"),
        (CASE + '[mould]\nsilicone = "rubber"\n', "rubber"),
        (CASE.replace("HollowDisk", "Kite"), "Kite"),
        ("mould = 3\n" + CASE, "must be a table"),
        ("", "geometry"),
        (None, "cannot be read"),
    ],
)
def test_files_that_ask_for_no_mould_are_refused_by_name(text, told, tmp_path):
    if text is not None:
        (tmp_path / "case.toml").write_text(text)
    with pytest.raises((MouldError, sm.CaseError), match=f"case.toml.*{told}"):
        asked_of(tmp_path / "case.toml")


@pytest.mark.parametrize(("words", "told"), [(["--draft", "50deg"], "draft"), (["--output", "case"], "not written by a run")])
def test_bad_input_is_a_sentence_and_status_2(words, told, tmp_path):
    (tmp_path / "case").mkdir()
    (tmp_path / "case" / "mine.txt").write_text("mine")
    (tmp_path / "case.toml").write_text(CASE)
    done = runs.run("-m", "softmodels", "mould", "case.toml", *words, cwd=tmp_path)
    assert done.status == 2 and done.out == "" and done.err.count("\n") == 1 and told in done.err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["case", "case.toml"]


def test_the_command_makes_a_small_mould(tmp_path):
    (tmp_path / "case.toml").write_text('name = "membrane"\n[geometry]\ndevice = "Membrane"\n')
    words = ("--silicone", "ecoflex-00-30", "--chord", "0.1mm", "--no-pictures", "--output", "out")
    done = runs.run("-m", "softmodels", "mould", "case.toml", *words, cwd=tmp_path)
    assert done.status == 0 and done.err == "" and "sheet.html" in done.out
    assert "pot life 45 min" in (tmp_path / "out" / "sheet.md").read_text()
    assert {"device.step", "mould.toml", "checks.json"} <= {path.name for path in (tmp_path / "out").iterdir()}


@pytest.mark.campaign
def test_the_command_writes_bodies_pictures_and_a_sheet(tmp_path):
    (tmp_path / "case.toml").write_text(CASE)
    words = ("--silicone", "ecoflex-00-30", "--chord", "0.1mm", "--vents", "2", "--output", "out")
    done = runs.run("-m", "softmodels", "mould", "case.toml", *words, cwd=tmp_path)
    assert done.status == 0 and done.err == "" and "sheet.html" in done.out
    folder = tmp_path / "out"
    sheet = (folder / "sheet.md").read_text()
    mass = 1.07 * sm.HollowDisk.variant("shadow").solid_volume * 1e6
    row = next(line for line in sheet.splitlines() if line.startswith("| all"))
    total, mixed, a, b = (float(cell) for cell in row.split("|")[4:8])
    assert total == pytest.approx(mass, rel=2e-3) and mixed == pytest.approx(1.15 * total, abs=0.06)
    assert a == b == pytest.approx(mixed / 2, abs=0.06)
    assert "pot life 45 min" in sheet and "cure for 4 h" in sheet and "&#" not in sheet
    page = (folder / "sheet.html").read_text()
    assert "<h2>Order of work</h2>" in page and 'src="http' not in page
    names = {f"{body}.{end}" for body in (*BODIES, *EXTRAS, "upper-cast", "lower-cast") for end in ("step", "stl")}
    assert names | {"device.step", "mould.toml", "checks.json", "plate-1.stl", "drawing.svg", "plates.svg"} <= {
        path.name for path in folder.iterdir()
    }
    if can_render():
        for name in ("exploded", "steps", *BODIES):
            assert (folder / f"{name}.png").stat().st_size > 10_000
        assert page.count("data:image/png") == 6 and page.count("data:image/svg+xml") == 2
    again = asked_of(folder / "mould.toml")
    assert again.device == sm.HollowDisk.variant("shadow") and again.workshop.vents == 2
    assert again.silicone == "ecoflex-00-30" and again.workshop.chord == pytest.approx(1e-4)


# -- ``softmodels mould``: the cast, read back as a STEP part, is the device -----------------------------------------


def _cast(device, tmp_path, cut):
    """The file of what a device's mould leaves, shrunk and bonded, and of that the piece inside ``cut`` (mm)."""
    import gmsh

    (tmp_path / "device.step").write_bytes(sm.mould(device, chord="0.1 mm", shrinkage=0.01).device)
    with private_model():
        gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
        whole = gmsh.model.occ.importShapes(str(tmp_path / "device.step"))
        gmsh.model.occ.intersect(whole, [(3, cut(gmsh.model.occ))])
        gmsh.model.occ.synchronize()
        gmsh.write(str(tmp_path / "piece.step"))
        gmsh.option.setString("Geometry.OCCTargetUnit", "")
    return str(tmp_path / "piece.step")


def _same_path(part, device, gauge):
    """That a cast is as large as its device and moves as it does, within 0.5 %."""
    assert part.solid_volume == pytest.approx(device.solid_volume, rel=1e-6)
    assert part.cavity_volume == pytest.approx(device.cavity_volume, rel=1e-5)
    one, other = (sm.inflate(each, sm.Yeoh(8e3, 100.0), "40 cm").last.row for each in (part, device))
    assert one["tip_mm"] == pytest.approx(other[gauge], rel=5e-3)
    assert one["added_volume_ml"] == pytest.approx(other["added_volume_ml"], rel=5e-3)


@pytest.mark.campaign
def test_a_cast_imported_as_a_part_goes_the_device_path(tmp_path):
    """The mirror: what the mould leaves, read as a STEP part and inflated, against the device drawn."""
    disk = sm.HollowDisk(section="axisymmetric", support="base")
    wedge = _cast(disk, tmp_path, lambda occ: occ.addCylinder(0, 0, -1, 0, 0, 40, 40, angle=np.pi / 6))
    part = sm.ImportedActuator(
        file=wedge, cavities=("at 5, 1, 8 mm",), support="z = 0 mm", cell_size=0.003,
        planes=("y = 0 mm", "normal 0.5, -0.8660254, 0"), gauge_point="at 0, 0, 16 mm",
    )  # fmt: skip
    _same_path(part, disk, "apex_mm")
