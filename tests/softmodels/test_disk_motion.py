"""The mesh of a disk that follows its parameters: cells stay good, the volume is right, the way there is forgotten."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from geometries import HollowDisk
from geometries.actuator import changed, parameter

DISKS = {
    "section": HollowDisk.variant("shadow", section="axisymmetric", profile=(1.0,) * 5),
    "wedge": HollowDisk(angle=30.0, azimuth=10.0, cell_size=0.006, profile=(1.0, 1.2, 1.0)),
}


@pytest.fixture(scope="module", params=DISKS.values(), ids=DISKS.keys())
def motion(request, comm, tmp_path_factory):
    from softmodels.mechanics.body import Body
    from softmodels.mechanics.sensitivity import MeshMotion

    disk = request.param
    path = disk.write(tmp_path_factory.mktemp("motion") / "disk.msh")
    made = MeshMotion(Body.from_file(disk, path, comm))
    yield made
    made.release()


def volume(body):
    """Of the whole device in m3."""
    import ufl
    from dolfinx import fem

    dx = ufl.Measure("dx", body.mesh, metadata={"quadrature_degree": 6})
    whole = fem.assemble_scalar(fem.form(fem.Constant(body.mesh, 1.0) * body.hoop * dx))
    return whole * body.actuator.copies * body.actuator.size**3


def test_cells_stay_good_and_the_volume_is_the_others(motion):
    for name in motion.base.movable:
        for share in (0.8, 1.2):
            device = changed(motion.base, {name: share * parameter(motion.base, name)})
            motion.move(device)
            assert motion.quality() > 0.4, (name, share)
            assert volume(motion.body) == pytest.approx(device.solid_volume, rel=1e-4), (name, share)


def test_a_mesh_does_not_remember_where_it_has_been(motion):
    mesh, base = motion.body.mesh, motion.base
    motion.move(base)
    rest = mesh.geometry.x.copy()
    there = dataclasses.replace(base, membrane=1.3 * base.membrane, cavity_radius=0.9 * base.cavity_radius)
    motion.move(there)
    first = mesh.geometry.x.copy()
    motion.move(dataclasses.replace(base, wall=0.7 * base.wall))
    motion.move(there)
    assert np.abs(mesh.geometry.x - first).max() < 1e-12
    motion.move(base)
    assert np.abs(mesh.geometry.x - rest).max() < 1e-13
