"""STEP files with several solids: glued, named, and refused where they make no part."""

from __future__ import annotations

import re

import numpy as np
import pytest

from geometries import GeometryError, ImportedActuator
from geometries.imported import region_name
from geometries.meshing import private_model

LENGTH, WIDTH, BASE, TOP, WALL = 30.0, 12.0, 3.0, 9.0, 2.0  # mm


def write_step(path, base=(0.0, 0.0), names=("Base plate", "Chamber"), lift=0.0):
    """A block with a cavity that is open below, and a plate under it that closes it and may be wider."""
    import gmsh

    with private_model():
        occ = gmsh.model.occ
        occ.addBox(-base[0], -base[1], 0, LENGTH + 2 * base[0], WIDTH + 2 * base[1], BASE)
        block = occ.addBox(0, 0, BASE + lift, LENGTH, WIDTH, TOP)
        air = occ.addBox(WALL, WALL, BASE + lift, LENGTH - 2 * WALL, WIDTH - 2 * WALL, TOP - WALL)
        occ.cut([(3, block)], [(3, air)])
        occ.synchronize()
        gmsh.option.setString("Geometry.OCCTargetUnit", "MM")  # else it is what was written last in this process
        gmsh.write(str(path))
        gmsh.option.setString("Geometry.OCCTargetUnit", "")
    text = path.read_text()
    for name in names:
        text = re.sub(r"MANIFOLD_SOLID_BREP\(''", f"MANIFOLD_SOLID_BREP('{name}'", text, count=1)
    path.write_text(text)
    return path


def part(path, **changes):
    fields = {"cavities": (f"at {LENGTH / 2}, {WIDTH / 2}, {BASE + 2} mm",), "support": "x = 0 mm", "cell_size": 0.004}
    return ImportedActuator(file=str(path), **{**fields, **changes})


def test_two_solids_are_glued(tmp_path):
    """A plate wider than the block: its upper face is partly an interface, partly the cavity's floor, partly outside."""
    device = part(write_step(tmp_path / "two.step", base=(0.0, 4.0)), surfaces=("foot = z = 0 mm",))
    assert device.regions == ("base_plate", "chamber")
    air = (LENGTH - 2 * WALL) * (WIDTH - 2 * WALL) * (TOP - WALL) * 1e-9
    solids = {"base_plate": LENGTH * (WIDTH + 8.0) * BASE * 1e-9, "chamber": LENGTH * WIDTH * TOP * 1e-9 - air}
    assert device.cavity_volume == pytest.approx(air, rel=1e-9)
    assert device.solid_volume == pytest.approx(sum(solids.values()), rel=1e-9)
    found = groups(device.write(tmp_path / "two.msh"))
    for name, volume in solids.items():
        assert found[3, name] == pytest.approx(volume, rel=1e-9)
    walls = 2 * (LENGTH - 2 * WALL + WIDTH - 2 * WALL) * (TOP - WALL) + 2 * (LENGTH - 2 * WALL) * (WIDTH - 2 * WALL)
    assert found[2, "cavity"] == pytest.approx(walls * 1e-6, rel=1e-9)
    assert found[2, "support"] == pytest.approx((WIDTH * TOP + (WIDTH + 8.0) * BASE) * 1e-6, rel=1e-9)
    assert found[2, "foot"] == pytest.approx(LENGTH * (WIDTH + 8.0) * 1e-6, rel=1e-9)


def groups(path):
    """Volumes and areas of the physical groups of a mesh."""
    import gmsh

    with private_model():
        gmsh.merge(str(path))
        found = {}
        for dimension, group in gmsh.model.getPhysicalGroups():
            total = 0.0
            for tag in gmsh.model.getEntitiesForPhysicalGroup(dimension, group):
                for kind in gmsh.model.mesh.getElementTypes(dimension, tag):
                    local, weights = gmsh.model.mesh.getIntegrationPoints(kind, "Gauss4")
                    _, determinants, _ = gmsh.model.mesh.getJacobians(kind, local, tag)
                    total += float((np.reshape(np.abs(determinants), (-1, len(weights))) @ weights).sum())
            found[dimension, gmsh.model.getPhysicalName(dimension, group)] = total
        return found


def test_names(tmp_path):
    same = part(write_step(tmp_path / "same.step", names=("Silicone", "Silicone")))
    assert same.regions == ()  # one region of two solids
    assert part(write_step(tmp_path / "none.step", names=())).regions == ("solid_1", "solid_2")
    assert [region_name(text) for text in ("Ring (2)", "3M tape", "Öse", "%")] == [
        "ring_2",
        "region_3m_tape",
        "ose",
        "region",
    ]


def test_solids_that_make_no_part(tmp_path):
    with pytest.raises(GeometryError, match="shares no face with"):
        part(write_step(tmp_path / "apart.step", lift=1.0))
    with pytest.raises(GeometryError, match="the solids base_plate and chamber overlap"):
        part(write_step(tmp_path / "into.step", lift=-1.0))
    with pytest.raises(GeometryError, match="a mould needs a part of a single solid"), private_model():
        part(
            tmp_path / "two.step" if (tmp_path / "two.step").exists() else write_step(tmp_path / "two.step")
        ).build_whole()
