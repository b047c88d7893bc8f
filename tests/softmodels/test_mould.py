"""``softmodels mould``: what the bodies leave, how they part, and what is refused."""

from __future__ import annotations

import json

import numpy as np
import pytest

from geometries import HollowDisk, SeminarActuator
from geometries.meshing import private_model
from softmodels.design.mould.asked import asked_of
from softmodels.design.mould.facets import read_step
from softmodels.design.mould.files import write_bodies
from softmodels.design.mould.make import made

SLAB = SeminarActuator(channels=1, fillet=0.0, around=6.0, cell_size=0.008)
BODIES = ("upper-cup", "upper-lid", "lower-cup", "lower-lid")


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
            x, y, low, wide, deep, high = occ.getBoundingBox(*bodies[0])
            low, high = (found.level, high) if half == "upper" else (low, found.level)
            space = occ.addBox(x, y, low, wide - x, deep - y, high - low)
            (piece,) = occ.cut([(3, space)], bodies)[0]
            cast.append(occ.getMass(*piece))
    whole = SLAB.solid_volume * 1e9
    assert sum(cast) / asked.workshop.scale**3 + found.plug * 1e9 == pytest.approx(whole, rel=2e-4)
    assert found.differs < 1e-6 and found.volume * 1e9 == pytest.approx(whole, rel=2e-4)


def test_stl_is_watertight_and_agrees_with_step(slab):
    folder, _, _ = slab
    report = json.loads((folder / "checks.json").read_text())
    for name in BODIES:
        corners = _stl(folder / f"{name}.stl")
        _, index = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
        edges = index.reshape(-1, 3)[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        known = {tuple(edge) for edge in edges.tolist()}
        assert len(known) == len(edges) and all((b, a) in known for a, b in known)
        volume = np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0
        with private_model():
            import gmsh

            exact = gmsh.model.occ.getMass(3, read_step(folder / f"{name}.step"))
        body = report["bodies"][name.replace("-", " ")]
        assert volume == pytest.approx(exact, rel=2e-4) and body["volume_mm3"] == pytest.approx(exact, rel=2e-5)
        assert body["stl_chord_mm"] <= 0.05 and body["least_draft_of_pins_and_holes_deg"] == pytest.approx(
            1.0, abs=1e-3
        )
        assert body["least_lean_of_part_deg"] > -0.1
    # The channel at its beginning is 1.4 mm wide, its silicone 2.1 mm thick at the end, where it is 2 mm wide.
    assert report["smallest_channel_mm"] == pytest.approx(1.4, abs=0.15)
    assert report["smallest_silicone_wall_mm"] == pytest.approx(2.0, abs=0.1)


def test_the_bonded_device_is_in_its_own_size_and_place(slab):
    import gmsh

    folder, _, _ = slab
    with private_model():
        solid = read_step(folder / "device.step")
        box = gmsh.model.occ.getBoundingBox(3, solid)
        volume = gmsh.model.occ.getMass(3, solid)
    assert box == pytest.approx((0, -30, -4, 70, 30, 4), abs=1e-3)
    assert volume == pytest.approx(SLAB.solid_volume * 1e9, rel=2e-4)


def test_a_disk_is_cast_to_its_closed_form():
    disk = HollowDisk.variant("shadow", section="axisymmetric")
    asked = asked_of(disk, chord="0.1 mm")
    found = made(asked.device, asked.workshop)
    assert found.differs < 1e-6 and found.volume == pytest.approx(disk.solid_volume, rel=1e-6)
    assert [body.opens for body in found.bodies] == [1.0, -1.0, -1.0, 1.0]
    assert (found.wall_above, found.wall_below) == pytest.approx((disk.membrane, disk.base), rel=1e-5)
    assert found.thinnest == pytest.approx(disk.membrane, rel=0.1)
