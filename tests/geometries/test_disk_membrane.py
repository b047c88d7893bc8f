"""A membrane whose thickness varies along the radius: a smooth top, volumes in closed form, cells that follow it."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.integrate import quad

from geometries import HollowDisk
from geometries.disk import MembraneTop, membrane_sizes
from geometries.meshing import private_model
from geometries.registry import from_table, to_table
from tests.support.campaigns import sampled

WAVY = (0.5, 2.0, 0.7, 1.4)
DISKS = {
    "section": HollowDisk(section="axisymmetric", profile=(1.3, 0.6, 1.0)),
    "section wavy": HollowDisk.variant("shadow", section="axisymmetric", support="base", fillet=0, profile=WAVY),
    "wedge": HollowDisk(angle=30, profile=(0.6, 1.0), cell_size=0.005),
    "wedge straight": HollowDisk(azimuth=33, order=1, profile=(1.3, 0.6, 1.0), cell_size=0.005),
    "half wavy": HollowDisk(angle=180, azimuth=-70, fillet=0, base_fillet=0, profile=WAVY, cell_size=0.01),
}


@pytest.fixture(params=sampled(DISKS.values(), [disk for name, disk in DISKS.items() if name != "half wavy"]), ids=DISKS.keys())
def disk(request):
    return request.param


def test_the_top_passes_through_its_entries_level_at_both_ends():
    top = MembraneTop(0.02, 0.01, 0.002, WAVY)
    radii = np.linspace(0.0, 0.02, len(WAVY))
    assert top.thickness(radii) == pytest.approx(0.002 * np.array(WAVY), rel=1e-14)
    step = 1e-7
    for end in (0.0, 0.02):
        slope = (top.height(end + step) - top.height(end - step)) / step
        assert abs(slope) < 1e-4  # its curvature; between the entries the slope is some 0.1
    assert top.height([0.02, 0.03, 1.0]) == pytest.approx(0.01 + 0.002 * WAVY[-1], rel=1e-15)
    fine = top.thickness(np.linspace(0.0, 0.02, 100_001))
    assert top.extremes == pytest.approx((fine.min(), fine.max()), rel=1e-9)
    assert top.extremes[1] > 0.002 * 1.002 * max(WAVY)  # it is highest between the entries


def test_curvature_is_that_of_the_line():
    top = MembraneTop(0.02, 0.01, 0.002, WAVY)
    radii, step = np.linspace(0.001, 0.019, 30), 1e-5
    low, here, high = (top.height(radii + by) for by in (-step, 0.0, step))
    bend = (low - 2 * here + high) / step**2 / (1 + ((high - low) / (2 * step)) ** 2) ** 1.5
    assert top.curvature(radii) == pytest.approx(np.abs(bend), rel=1e-2, abs=0.2)
    assert not MembraneTop(0.02, 0.01, 0.002, (1.0,)).curvature(radii).any()


def test_the_top_is_linear_in_its_entries():
    first, second = np.array(WAVY), np.array([1.0, 1.2, 0.9, 0.8])
    radii = np.linspace(0.0, 0.02, 41)
    one, two, mean = (
        MembraneTop(0.02, 0.01, 0.002, tuple(shares)).height(radii) for shares in (first, second, 0.5 * (first + second))
    )
    assert mean == pytest.approx(0.5 * (one + two), rel=1e-14)


def test_pieces_are_the_spline():
    top = MembraneTop(0.02, 0.01, 0.002, WAVY)
    t = np.linspace(0.0, 1.0, 21)[:, None]
    for points in top.pieces():
        curve = (1 - t) ** 3 * points[0] + 3 * (1 - t) ** 2 * t * points[1] + 3 * (1 - t) * t**2 * points[2] + t**3 * points[3]
        assert top.height(curve[:, 0]) == pytest.approx(curve[:, 1], rel=1e-14)


@pytest.mark.parametrize(
    "shares",
    [(1.0, 1.0), (0.5, 1.8), WAVY, tuple(1 + 0.5 * (-1) ** k for k in range(12))],
)
def test_volumes_are_closed_forms(shares):
    disk = HollowDisk(profile=shares)
    top = disk.membrane_top
    knots = np.linspace(0.0, disk.cavity_radius, len(shares))
    pieces = [quad(lambda r: 2 * np.pi * r * top.thickness(r), a, b, epsrel=1e-13)[0] for a, b in itertools.pairwise(knots)]
    assert top.volume == pytest.approx(sum(pieces), rel=1e-12)
    with private_model():
        import gmsh

        disk.build()
        solid = sum(gmsh.model.occ.getMass(*entity) for entity in gmsh.model.occ.getEntities(3))
    assert solid * disk.copies == pytest.approx(disk.solid_volume, rel=1e-10)
    assert disk.cavity_volume == HollowDisk().cavity_volume


def test_a_uniform_profile_is_the_same_body():
    plain, uniform = HollowDisk(), HollowDisk(profile=(1, 1, 1))
    assert uniform.probes == plain.probes and uniform.height == plain.height
    assert uniform.solid_volume == pytest.approx(plain.solid_volume, rel=1e-14)
    assert HollowDisk(membrane=0.003, profile=(2, 2)).solid_volume == pytest.approx(plain.solid_volume, rel=1e-14)


def test_meshes_have_the_volume_the_roles_and_the_probes(disk, meshed):
    mesh, dim = meshed(disk), disk.dimension
    near = {1: 1e-2, 2: 2e-5}[disk.order]
    if dim == 3:
        assert mesh.groups[3, "solid"].measure * disk.copies == pytest.approx(disk.solid_volume, rel=near)
        assert -mesh.groups[2, "cavity"].flux / 3 * disk.copies == pytest.approx(disk.cavity_volume, rel=3 * near)
    top = disk.device_points(mesh.at(dim - 1, "top"))
    radii = np.hypot(top[:, 0], top[:, 1])
    assert np.abs(top[:, 2] - disk.membrane_top.height(radii)).max() < 1e-12 * disk.outer_radius
    assert radii.min() < 1e-12 and radii.max() == pytest.approx(disk.outer_radius)
    points = disk.device_points(mesh.at(dim, "solid"))
    assert disk.probes["apex"][2] == pytest.approx(disk.ceiling + disk.membrane * disk.profile[0], rel=1e-15)
    for place in disk.probes.values():
        assert np.linalg.norm(points - place, axis=1).min() < 1e-12 * disk.outer_radius
    line = points[disk.on_profile(points)]
    along = np.sort(line @ np.array(disk.radial))
    assert along[0] == pytest.approx(0.0, abs=1e-12) and along[-1] == pytest.approx(disk.outer_radius)
    assert np.ptp(line[:, 2]) > 0.1 * disk.membrane and np.diff(along).max() < 1.5 * disk.cell_size
    assert len(line) % 2 == 1 if disk.order == 2 else len(line) > 5
    cells = len(mesh.groups[dim, "solid"].corners)
    assert 0.5 < disk.expected_cells / cells < 2.5


def test_cells_are_small_where_the_membrane_is_thin():
    disk = HollowDisk(section="axisymmetric", profile=(0.3, 1.0, 2.0))
    radii, sizes = membrane_sizes(disk)
    assert (sizes <= np.minimum(disk.membrane_top.thickness(radii) / 2, disk.cell_size) + 1e-15).all()
    assert np.abs(np.diff(sizes) / np.diff(radii)).max() < 0.5 + 1e-9
    assert sizes[0] < 0.0011 and sizes[-1] > 1.5 * sizes[0]
    curved = HollowDisk(section="axisymmetric", profile=WAVY)
    radii, sizes = membrane_sizes(curved)
    turns = sizes * curved.membrane_top.curvature(radii)  # in radians along an edge
    finest = curved.cavity_radius / 3 / 3  # a third of the distance between entries
    assert (turns[sizes > finest] <= 1.0 + 1e-9).all() and sizes.min() == pytest.approx(finest)
    _, crowded = membrane_sizes(HollowDisk(profile=(1.0,) * 12))
    assert crowded.max() == pytest.approx(0.01 / 11)


def test_a_cavity_that_sits_too_high_leaves_the_top_where_it_is():
    disk = HollowDisk(profile=(1.3, 0.6, 1.0))
    made = disk.made({"offset": 0.001, "wall": 0.012})
    radii = np.linspace(0.0, 0.02, 50)
    assert made.ceiling == pytest.approx(disk.ceiling + 0.001) and made.wall == 0.012
    assert made.membrane_top.height(radii) == pytest.approx(disk.membrane_top.height(radii), rel=1e-14)


def test_profiles_are_read_from_tables():
    disk = HollowDisk(profile=(1.3, 0.6, 1))
    assert to_table(disk)["profile"] == [1.3, 0.6, 1.0] and from_table(to_table(disk)) == disk
    assert from_table({"device": "HollowDisk", "profile": [1.3, 0.6, 1]}) == disk
    assert disk.key != HollowDisk().key
