"""``softmodels mould``: the cast, read back as a STEP part, is the device."""

from __future__ import annotations

import numpy as np
import pytest

import softmodels as sm
from geometries.meshing import private_model


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
    cast, drawn = (sm.inflate(one, sm.Yeoh(8e3, 100.0), "0,20,40 cm") for one in (part, device))
    for pressure in ("20 cm", "40 cm"):
        one, other = cast.at(pressure).row, drawn.at(pressure).row
        assert one["tip_mm"] == pytest.approx(other[gauge], rel=5e-3)
        assert one["added_volume_ml"] == pytest.approx(other["added_volume_ml"], rel=5e-3)


def test_a_cast_imported_as_a_part_goes_the_device_path(tmp_path):
    """The mirror: what the mould leaves, read as a STEP part and inflated, against the device drawn."""
    disk = sm.HollowDisk(section="axisymmetric", support="base")
    wedge = _cast(disk, tmp_path, lambda occ: occ.addCylinder(0, 0, -1, 0, 0, 40, 40, angle=np.pi / 6))
    part = sm.ImportedActuator(
        file=wedge, cavities=("at 5, 1, 8 mm",), support="z = 0 mm", cell_size=0.003,
        planes=("y = 0 mm", "normal 0.5, -0.8660254, 0"), gauge_point="at 0, 0, 16 mm",
    )  # fmt: skip
    _same_path(part, disk, "apex_mm")


def test_a_cast_slab_imported_as_a_part_goes_the_device_path(tmp_path):
    """The same of a slab with its channels, cut in half afterwards."""
    slab = sm.SeminarActuator(
        channels=1, length=0.04, base_width=0.03, manifold_radius=0.01, manifold_bore=0.0018, channel_bore=0.0016,
        end_bore=0.0012, fillet=0.0, offset=-0.001, around=8.0, cell_size=0.006,
    )  # fmt: skip
    half = _cast(slab, tmp_path, lambda occ: occ.addBox(-100, 0, -100, 300, 100, 200))
    part = sm.ImportedActuator(
        file=half, cavities=("at 10, 0.5, -1 mm",), support="x = 0 mm", cell_size=0.0035, curvature=16.0,
        planes=("y = 0 mm",), gauge_point="at 40, 0, 4 mm",
    )  # fmt: skip
    _same_path(part, slab, "tip_mm")
