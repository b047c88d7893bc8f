"""The axisymmetric hollow disk: roles on the right lines, volumes by turning the profile."""

from __future__ import annotations

import numpy as np
import pytest

from geometries import Hold, HollowDisk

PROFILES = {
    "rim": HollowDisk(section="axisymmetric"),
    "base": HollowDisk(section="axisymmetric", support="base", fillet=0),
    "straight": HollowDisk(section="axisymmetric", order=1),
    "thin": HollowDisk.variant("shadow", section="axisymmetric"),
}


@pytest.fixture(params=PROFILES.values(), ids=PROFILES.keys())
def disk(request):
    return request.param


def test_groups_and_symmetry(disk, meshed):
    support = (0, "support") if disk.support == "rim" else (1, "support")
    assert set(meshed(disk).groups) == {(2, "solid"), (1, "cavity"), (1, "top"), (1, "outer"), (1, "axis"), support}
    assert (disk.dimension, disk.copies, disk.cut_planes) == (2, 1, ())
    held = Hold("support", (0, 0, 1), point=True) if disk.support == "rim" else Hold("support", None)
    assert disk.holds == (held, Hold("axis", (1, 0, 0)))


def test_lines_are_where_their_roles_say(disk, meshed):
    mesh = meshed(disk)
    near = 1e-12 * disk.outer_radius
    assert np.abs(mesh.at(1, "axis")[:, 0]).max() < near
    assert mesh.groups[1, "axis"].measure == pytest.approx(disk.base + disk.membrane)
    r, z = mesh.at(1, "outer")[:, :2].T
    bottom = np.abs(z) < near
    assert np.all(bottom | (np.abs(z - disk.height) < near) | (np.abs(r - disk.outer_radius) < near))
    assert np.count_nonzero(bottom) > 1 if disk.support == "rim" else np.count_nonzero(bottom) == 1
    cavity = 2 * disk.cavity_radius + disk.cavity_height
    cavity -= (2 - np.pi / 2) * (disk.fillet + disk.base_fillet)
    assert mesh.groups[1, "cavity"].measure == pytest.approx(cavity, rel={1: 1e-2, 2: 1e-4}[disk.order])
    if disk.support == "rim":
        assert mesh.at(0, "support") == pytest.approx(np.array([[disk.outer_radius, 0, 0]]))
    else:
        assert mesh.groups[1, "support"].measure == pytest.approx(disk.outer_radius)


def test_area_and_flatness(disk, meshed):
    mesh = meshed(disk)
    assert np.abs(mesh.at(2, "solid")[:, 2]).max() == 0.0
    area = disk.outer_radius * disk.height - disk.cavity_radius * disk.cavity_height
    area += (disk.fillet**2 + disk.base_fillet**2) * (1 - np.pi / 4)
    assert mesh.groups[2, "solid"].measure == pytest.approx(area, rel={1: 1e-3, 2: 1e-5}[disk.order])


def test_every_edge_on_the_boundary_has_one_role(disk, meshed):
    mesh = meshed(disk)
    cells = mesh.groups[2, "solid"].corners
    edges = np.sort(np.concatenate([cells[:, list(two)] for two in ((0, 1), (1, 2), (2, 0))]), axis=1)
    edges, shared = np.unique(edges, axis=0, return_counts=True)
    named = np.sort(np.concatenate([group.corners for (dim, _), group in mesh.groups.items() if dim == 1]), axis=1)
    assert set(shared) == {1, 2}
    assert np.array_equal(np.unique(named, axis=0), edges[shared == 1]) and len(named) == np.sum(shared == 1)


def test_probes_and_profile_in_device_coordinates(disk, meshed):
    mesh = meshed(disk)
    points = disk.device_points(mesh.at(2, "solid"))
    for place in disk.probes.values():
        assert np.linalg.norm(points - place, axis=1).min() < 1e-12
    line = points[disk.on_profile(points)]
    assert np.all(line[:, 1] == 0.0) and line[:, 2] == pytest.approx(disk.height)
    assert line[:, 0].min() == pytest.approx(0.0, abs=1e-12) and line[:, 0].max() == pytest.approx(disk.outer_radius)


def test_closed_volumes_agree_with_turning_the_outline():
    disk = HollowDisk(fillet=0.0025, base_fillet=0.0012)
    z = np.linspace(disk.base, disk.ceiling, 200_001)
    over = np.maximum(z - (disk.ceiling - disk.fillet), 0.0)
    under = np.maximum(disk.base + disk.base_fillet - z, 0.0)
    upper = disk.fillet - np.sqrt(np.maximum(disk.fillet**2 - over**2, 0.0))
    lower = disk.base_fillet - np.sqrt(np.maximum(disk.base_fillet**2 - under**2, 0.0))
    r = disk.cavity_radius - upper - lower
    assert disk.cavity_volume == pytest.approx(np.trapezoid(np.pi * r**2, z), rel=1e-7)
    assert disk.cavity_volume + disk.solid_volume == pytest.approx(np.pi * disk.outer_radius**2 * disk.height)
