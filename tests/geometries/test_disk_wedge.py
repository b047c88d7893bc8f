"""Slices of the hollow disk: every role where it belongs, every volume what the formula says."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from geometries import HollowDisk
from tests.support.campaigns import sampled

SLICES = {
    "30": HollowDisk(angle=30),
    "45": HollowDisk(),
    "90 base": HollowDisk(angle=90, support="base"),
    "180": HollowDisk(angle=180, fillet=0),
    "180 base turned": HollowDisk(angle=180, azimuth=-70, fillet=0, support="base"),
    "360 turned": HollowDisk(angle=360, azimuth=25, fillet=0),
    "120 turned": HollowDisk(angle=120, azimuth=33, fillet=0),
    "45 turned": HollowDisk(azimuth=100),
    "45 sharp straight": HollowDisk(fillet=0, order=1),
    "thin": HollowDisk.variant("shadow", angle=30),
}


CAMPAIGN_SLICES = "180", "180 base turned", "360 turned", "120 turned", "45 turned"


@pytest.fixture(params=sampled(SLICES.values(), [SLICES[name] for name in SLICES.keys() - CAMPAIGN_SLICES]), ids=SLICES.keys())
def disk(request):
    return request.param


def test_groups_are_the_documented_ones(disk, meshed):
    expected = {(3, "solid"), (2, "cavity"), (2, "top"), (2, "outer")}
    expected |= {(2, plane.name) for plane in disk.cut_planes}
    expected |= {(1, "support")} if disk.support == "rim" else {(2, "support")}
    if disk.support == "rim":
        expected |= {180.0: {(0, "anchor0")}, 360.0: {(0, "anchor0"), (0, "anchor1")}}.get(disk.angle, set())
    assert set(meshed(disk).groups) == expected
    assert len(disk.cut_planes) == (0 if disk.angle == 360.0 else 2)


def test_mesh_is_conforming_and_its_boundary_has_one_role_each(disk, meshed):
    mesh = meshed(disk)
    cells = mesh.groups[3, "solid"].corners
    faces = np.sort(np.concatenate([cells[:, list(three)] for three in itertools.combinations(range(4), 3)]), axis=1)
    faces, shared = np.unique(faces, axis=0, return_counts=True)
    assert set(shared) == {1, 2}
    named = np.concatenate([group.corners for (dimension, _), group in mesh.groups.items() if dimension == 2])
    named = np.sort(named, axis=1)
    assert len(np.unique(named, axis=0)) == len(named)
    assert np.array_equal(np.unique(named, axis=0), faces[shared == 1])


def test_volumes_match_the_closed_forms(disk, meshed):
    mesh = meshed(disk)
    near = {1: 1e-2, 2: 2e-5}[disk.order]
    assert mesh.orders == {disk.order}
    assert mesh.groups[3, "solid"].measure * disk.copies == pytest.approx(disk.solid_volume, rel=near)
    # The facets' normals point out of the solid; the cut planes pass through the origin and add nothing.
    assert -mesh.groups[2, "cavity"].flux / 3 * disk.copies == pytest.approx(disk.cavity_volume, rel=3 * near)


def test_every_cavity_node_is_on_the_cavity(disk, meshed):
    points = meshed(disk).at(2, "cavity")
    r, z = np.hypot(points[:, 0], points[:, 1]), points[:, 2]
    near = 1e-9 * disk.outer_radius
    on_floor, on_ceiling = np.abs(z - disk.base) < near, np.abs(z - disk.ceiling) < near
    on_side = np.abs(r - disk.cavity_radius) < near
    arcs = ((disk.fillet, disk.ceiling - disk.fillet), (disk.base_fillet, disk.base + disk.base_fillet))
    on_arc = [np.abs(np.hypot(r - disk.cavity_radius + a, z - height) - a) < near for a, height in arcs]
    assert np.all(on_floor | on_ceiling | on_side | on_arc[0] | on_arc[1])
    assert np.all((r < disk.cavity_radius + near) & (z > disk.base - near) & (z < disk.ceiling + near))
    assert on_floor.any() and on_ceiling.any() and on_side.any()


def test_every_outer_node_is_on_the_outside(disk, meshed):
    points = np.concatenate([meshed(disk).at(2, "outer"), meshed(disk).at(2, "top")])
    r, z = np.hypot(points[:, 0], points[:, 1]), points[:, 2]
    near = 1e-9 * disk.outer_radius
    bottom, top, side = np.abs(z) < near, np.abs(z - disk.height) < near, np.abs(r - disk.outer_radius) < near
    assert np.all(bottom | top | side)
    # With the whole bottom held, the bottom's inside is no part of the outer surface.
    assert np.any(bottom & ~side) == (disk.support == "rim")


def test_support_is_the_bottom_or_its_edge(disk, meshed):
    mesh = meshed(disk)
    part = disk.angle / 360.0
    near = {1: 1e-2, 2: 1e-4}[disk.order]
    if disk.support == "rim":
        points, measure = mesh.at(1, "support"), mesh.groups[1, "support"].measure
        assert np.hypot(points[:, 0], points[:, 1]) == pytest.approx(disk.outer_radius)
        assert measure == pytest.approx(2 * np.pi * disk.outer_radius * part, rel=near)
    else:
        points, measure = mesh.at(2, "support"), mesh.groups[2, "support"].measure
        assert measure == pytest.approx(np.pi * disk.outer_radius**2 * part, rel=near)
    assert np.abs(points[:, 2]).max() < 1e-12 * disk.outer_radius


def test_plane_nodes_are_exactly_on_the_planes_and_normals_point_out(disk, meshed):
    mesh = meshed(disk)
    inside = mesh.at(3, "solid")
    section = disk.outer_radius * disk.height - disk.cavity_radius * disk.cavity_height
    section += (disk.fillet**2 + disk.base_fillet**2) * (1 - np.pi / 4)
    for plane in disk.cut_planes:
        normal = np.array(plane.normal)
        assert np.linalg.norm(normal) == pytest.approx(1.0, abs=1e-15)
        assert np.abs(mesh.at(2, plane.name) @ normal).max() < 1e-12 * disk.outer_radius
        assert (inside @ normal).max() < 1e-12 * disk.outer_radius
        assert (inside @ normal).min() < -0.1 * disk.cavity_radius
        area = mesh.groups[2, plane.name].measure
        assert area == pytest.approx(section, rel={1: 1e-2, 2: 1e-4}[disk.order])
    if disk.cut_planes:
        along = mesh.at(2, "plane0") @ np.array(disk.radial)
        assert along.min() > -1e-12 * disk.outer_radius


def test_probes_and_anchors_are_vertices(disk, meshed):
    mesh = meshed(disk)
    vertices = mesh.points[np.unique(mesh.groups[3, "solid"].corners)]
    for place in disk.probes.values():
        assert np.linalg.norm(vertices - place, axis=1).min() < 1e-12 * disk.outer_radius
    places = {"anchor0": np.zeros(3), "anchor1": disk.outer_radius * np.array(disk.radial)}
    for hold in disk.holds:
        if hold.point:
            assert mesh.groups[0, hold.role].nodes.size == 1
            assert mesh.at(0, hold.role)[0] == pytest.approx(places[hold.role], abs=1e-12 * disk.outer_radius)


def test_holds_and_planes_leave_no_rigid_motion_and_are_never_redundant_at_points(disk, meshed):
    mesh = meshed(disk)
    rows, at_points = [], 0
    for plane in disk.cut_planes:
        rows += [_work(point, plane.normal) for point in mesh.at(2, plane.name)]
    for hold in disk.holds:
        dimension = 0 if hold.point else 2 if (2, hold.role) in mesh.groups else 1
        for direction in [hold.direction] if hold.direction else np.eye(3):
            found = [_work(point, direction) for point in mesh.at(dimension, hold.role)]
            at_points += len(found) if hold.point else 0
            rows += found
    rows = np.array(rows)
    assert np.linalg.matrix_rank(rows, tol=1e-6) == 6
    # Anchors stand last; without them exactly as many motions are free as they remove.
    assert np.linalg.matrix_rank(rows[: len(rows) - at_points], tol=1e-6) == 6 - at_points


def _work(point, direction):
    """Displacement along a direction for unit translations and for rotations scaled to the disk's size."""
    arm = np.cross(np.asarray(point) / 0.02, direction)
    return np.concatenate([direction, arm])


def test_profile_runs_from_the_centre_to_the_outer_edge(disk, meshed):
    mesh = meshed(disk)
    points = mesh.points[np.unique(mesh.groups[3, "solid"].corners)]
    line = points[disk.on_profile(points)]
    along = np.sort(line @ np.array(disk.radial))
    assert line[:, 2] == pytest.approx(disk.height)
    assert along[0] == pytest.approx(0.0, abs=1e-12) and along[-1] == pytest.approx(disk.outer_radius)
    assert np.diff(along).max() < 1.5 * disk.cell_size and np.diff(along).min() > 0.0


def test_membrane_has_nodes_between_its_faces(disk, meshed):
    mesh = meshed(disk)
    points = mesh.points[np.unique(mesh.groups[3, "solid"].corners)]
    depth = (disk.height - points[:, 2]) / disk.membrane
    over = np.hypot(points[:, 0], points[:, 1]) < disk.cavity_radius
    assert np.count_nonzero(over & (depth > 0.2) & (depth < 0.8)) >= 3
    axis = np.sort(depth[(np.hypot(points[:, 0], points[:, 1]) < 1e-9) & (depth < 1.001)])
    assert len(axis) >= 3
