"""Points of a disk's boundary on another disk: on its outline to rounding, smooth in its lengths, corners to corners."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from geometries import GeometryError, HollowDisk
from geometries.actuator import changed, parameter
from geometries.disk import outline
from tests.support.campaigns import sampled

SHADOW = HollowDisk.variant("shadow", section="axisymmetric", support="base")
DISKS = {
    "section": HollowDisk(section="axisymmetric"),
    "section sharp": HollowDisk(section="axisymmetric", support="base", fillet=0, base_fillet=0),
    "section curved": dataclasses.replace(SHADOW, profile=(1.3, 0.6, 1.0)),
    "wedge turned": HollowDisk(angle=30, azimuth=33, cell_size=0.006),
    "wedge curved": HollowDisk(angle=45, profile=(0.5, 1.2, 1.0, 1.4), cell_size=0.006),
    "sharp root straight": HollowDisk(angle=120, azimuth=25, fillet=0, order=1, cell_size=0.009, profile=(1.2, 0.9)),
}
FACTORS = (1.2, 0.85, 1.1, 0.8, 1.3, 0.7, 1.15, 1.05, 0.9, 1.2, 0.95)
NEAR = 1e-12
"""In m."""


@pytest.fixture(
    params=sampled(DISKS.values(), [DISKS[name] for name in DISKS.keys() - {"wedge curved", "sharp root straight"}]),
    ids=DISKS.keys(),
)
def disk(request):
    return request.param


def boundary(disk, mesh):
    """Nodes on the true boundary, shape (n, 3), in device coordinates."""
    facets = disk.dimension - 1
    roles = [role for role in ("cavity", "top", "outer", "support", "axis") if (facets, role) in mesh.groups]
    return disk.device_points(mesh.points[np.unique(np.concatenate([mesh.groups[facets, role].nodes for role in roles]))])


def turned(points):
    """Radius and height."""
    return np.column_stack([np.hypot(points[:, 0], points[:, 1]), points[:, 2]])


def missed(disk, points):
    """Distance of points from the outline, shape (n,)."""
    flat = turned(points)
    return np.min([np.linalg.norm(e.places(e.shares(flat)) - flat, axis=1) for e in outline(disk)], axis=0)


def other_than(disk):
    return changed(disk, {name: by * parameter(disk, name) for name, by in zip(disk.movable, FACTORS, strict=False)})


def test_nodes_of_a_mesh_land_on_the_other_outline(disk, meshed):
    points = boundary(disk, meshed(disk))
    assert len(points) > 50 and missed(disk, points).max() < NEAR
    other = other_than(disk)
    carried = disk.carried(other, points)
    assert missed(other, carried).max() < NEAR
    assert missed(disk, carried).max() > 0.01 * disk.size  # they have moved
    assert np.array_equal(disk.carried(disk, points), points)
    assert np.abs(other.carried(disk, carried) - points).max() < NEAR


def test_corners_and_probes_go_to_corners_and_probes(disk):
    other = other_than(disk)
    for here, there in zip(outline(disk), outline(other), strict=True):
        direction = np.array(disk.radial)
        points = np.array([r * direction + (0.0, 0.0, z) for r, z in (here.start, here.end)])
        assert np.abs(turned(disk.carried(other, points)) - [there.start, there.end]).max() < NEAR
    probes = disk.carried(other, np.array(list(disk.probes.values())))
    assert np.abs(probes - list(other.probes.values())).max() < NEAR


@pytest.mark.parametrize("name", ["wedge turned", "wedge curved"])
def test_points_stay_on_cut_planes_and_on_the_axis(name, meshed):
    disk = DISKS[name]
    points = boundary(disk, meshed(disk))
    carried = disk.carried(other_than(disk), points)
    for plane in disk.cut_planes:
        on_plane = np.abs(points @ plane.normal) < NEAR
        assert on_plane.sum() > 10 and np.abs(carried[on_plane] @ plane.normal).max() < NEAR
    on_axis = np.hypot(points[:, 0], points[:, 1]) == 0.0
    assert on_axis.any() and not carried[on_axis, :2].any()
    if disk.azimuth == 0.0:
        assert not carried[points[:, 1] == 0.0, 1].any()


def test_places_are_linear_in_each_parameter(disk, meshed):
    points = boundary(disk, meshed(disk))
    for name in disk.movable:
        value = parameter(disk, name)
        low, middle, high = (disk.carried(changed(disk, {name: value * by}), points) for by in (0.98, 0.99, 1.0))
        assert np.abs(low - 2 * middle + high).max() < NEAR
        assert np.abs(high - low).max() > 1e-4 * abs(value) * disk.size / max(disk.size, abs(value))


def test_a_steep_top_is_meshed_and_nodes_on_chords_stay_beside_the_outline(meshed):
    """Without cells that follow the curvature some would be turned inside out; a few edges are left straight."""
    shares = (1.7923, 0.3942, 2.567, 0.4812, 0.5906, 1.0914, 0.5934, 0.6938, 0.3788)
    lengths = {"cavity_radius": 0.012276, "membrane": 0.0024119, "base": 0.009154, "wall": 0.0047713}
    disk = HollowDisk(**lengths, cavity_height=0.003223, fillet=0, base_fillet=0, cell_size=0.0030923, angle=30, profile=shares)
    mesh = meshed(disk)
    assert mesh.groups[3, "solid"].measure * disk.copies == pytest.approx(disk.solid_volume, rel=1e-4)
    points = boundary(disk, mesh)
    beside = missed(disk, points)
    assert NEAR < beside.max() < 0.02 * disk.outer_radius and np.median(beside) < NEAR
    other = dataclasses.replace(disk, membrane=1.01 * disk.membrane, wall=1.01 * disk.wall)
    assert missed(other, disk.carried(other, points)).max() < 1.1 * beside.max()
    assert np.array_equal(disk.carried(disk, points), points)


def test_every_rounding_there_is_can_move():
    names = ("cavity_radius", "membrane", "base", "wall", "cavity_height", "fillet", "base_fillet")
    assert HollowDisk().movable == names
    assert HollowDisk(fillet=0, profile=(1, 1)).movable == (*names[:5], "base_fillet", "profile[1]", "profile[2]")


@pytest.mark.parametrize(
    ("other", "words"),
    [
        (HollowDisk(section="axisymmetric"), "section"),
        (HollowDisk(angle=30), "angle"),
        (HollowDisk(support="base"), "support"),
        (HollowDisk(fillet=0), "fillet"),
        (HollowDisk(profile=(1, 1)), "profile has 0 and 2"),
    ],
)
def test_disks_of_another_make_are_refused(other, words):
    with pytest.raises(GeometryError, match=words):
        HollowDisk().carried(other, np.zeros((1, 3)))


def test_points_inside_are_refused_and_cell_sizes_do_not_matter():
    disk = HollowDisk()
    with pytest.raises(GeometryError, match=r"\(15, 0, 8\) mm is .* off the device's boundary"):
        disk.carried(disk, np.array([[0.015, 0.0, 0.008]]))
    finer = HollowDisk(cell_size=0.001, refinement=1.0, order=1)
    assert np.array_equal(disk.carried(finer, np.array([[0.02, 0.0, 0.008]])), [[0.02, 0.0, 0.008]])
    assert disk.carried(finer, np.empty((0, 3))).shape == (0, 3)


def test_clearances_are_positive_where_the_check_passes_and_name_what_is_thin():
    disk = HollowDisk(profile=(1.3, 0.6, 1.0))
    found = disk.clearances
    assert all(value > 0.0 for value in found.values()) and len(found) == 6 + 3 + 6
    assert found["membrane at entry 2 of profile"] == pytest.approx(0.0036)
    assert found["straight part of the cavity's side"] == pytest.approx(0.002)
    assert "membrane" not in found and HollowDisk().clearances["membrane"] == 0.006


def test_the_check_passes_where_clearances_are_positive():
    random = np.random.default_rng(5)
    passed = 0
    for _ in range(300):
        lengths = dict(zip(("fillet", "base_fillet"), random.uniform(1e-4, 3e-3, 2), strict=True))
        shares = tuple(random.uniform(0.1, 3.0, random.integers(2, 13)))
        try:
            HollowDisk(section="axisymmetric", profile=shares, **lengths)
            passed += 1
        except GeometryError:
            loose = object.__new__(HollowDisk)
            for field in dataclasses.fields(HollowDisk):
                object.__setattr__(loose, field.name, {"profile": shares, **lengths}.get(field.name, field.default))
            assert min(loose.clearances.values()) < 0.2 * loose.membrane
    assert 50 < passed < 295
