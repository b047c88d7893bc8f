"""The surface that pictures are made of, against the devices' closed-form volumes."""

from __future__ import annotations

import types

import numpy as np
import pytest

import softmodels as sm
from geometries import Balloon, Bellows, HollowDisk, Membrane, SeminarActuator
from softmodels.components.contact import RigidShape
from softmodels.pictures.offscreen import look, shape_layers, shape_surface, shapes_of, way
from softmodels.pictures.solid import best_plane
from softmodels.runs.grid import CUT_LABEL, OUTSIDE_LABEL, surface_of
from softmodels.runs.states import FolderStates
from softmodels.runs.table import PathTable
from tests.support import made_up as drawings
from tests.support.campaigns import sampled

SHARP_DISK = {"cell_size": 0.004, "refinement": 1.0}
SLAB = {"channels": 2, "spread": 40.0, "around": 8.0, "cell_size": 0.008}
DEVICES = {
    "wedge": HollowDisk(**SHARP_DISK),
    "turned": HollowDisk(**SHARP_DISK, angle=90.0, azimuth=20.0),
    "odd": HollowDisk(**SHARP_DISK, angle=120.0, azimuth=30.0),
    "half disk": HollowDisk(**SHARP_DISK, angle=180.0),
    "section": HollowDisk(**SHARP_DISK, section="axisymmetric"),
    "half slab": SeminarActuator(**SLAB),
    "full slab": SeminarActuator(**SLAB, part="full"),
}


PARTS = (("can", 45), ("can", 180), ("ball", 60), ("ball", 90))
"""Wedges from STEP files, and their angles."""


@pytest.fixture(scope="module", params=[*DEVICES, *sampled(PARTS, whole=True)], ids=str)
def surface(request, wedge_part, tmp_path_factory):
    device = DEVICES[request.param] if request.param in DEVICES else wedge_part(*request.param)
    points, cells, kind = drawings.grid_of(device, tmp_path_factory.mktemp("skin"))
    return device, points, surface_of(points, cells, kind, device)


def volume(corners):
    """Enclosed by triangles that point outwards, shape (t, 3, 3)."""
    return np.einsum("ti,ti->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6


def test_the_images_close_around_the_solid_and_its_cavity(surface):
    device, points, skin = surface
    whole = skin.device(skin.points(points))
    solid = volume(whole[skin.device_triangles(skin.part != CUT_LABEL)])
    cavity = -volume(whole[skin.device_triangles(skin.part > OUTSIDE_LABEL)])
    assert skin.cavities == 1
    # Flat triangles on round walls lack a little: two to an edge, 8 edges around a channel.
    assert solid == pytest.approx(device.solid_volume, rel=0.01)
    assert cavity == pytest.approx(device.cavity_volume, rel=0.06)


def test_the_slice_is_closed_by_its_cuts(surface):
    device, points, skin = surface
    corners = skin.points(points)[skin.triangles]
    assert len(skin.images) * volume(corners) == pytest.approx(device.solid_volume, rel=0.01)
    # Closed: each place's edges come once in either direction.
    rounded = np.round(skin.points(points) / device.size * 1e6).astype(int)
    names = np.unique(rounded, axis=0, return_inverse=True)[1].reshape(-1)[skin.triangles]
    edges = np.concatenate([names[:, [0, 1]], names[:, [1, 2]], names[:, [2, 0]]])
    there = {tuple(edge) for edge in edges.tolist()}
    assert all((b, a) in there for a, b in there)


def test_normals_point_out_and_are_smooth_over_the_cuts(surface):
    _, points, skin = surface
    places = skin.points(points)
    normals = skin.normals(places)
    assert np.linalg.norm(normals, axis=1) == pytest.approx(1.0)
    for normal, here in zip(skin.planes, skin.on_plane, strict=True):
        assert here.any() and np.abs(normals[here] @ normal).max() < 1e-9
    a, b, c = (places[skin.triangles[:, k]] for k in range(3))
    faces = np.cross(b - a, c - a)
    assert ((faces * normals[skin.triangles[:, 0]]).sum(axis=1) > 0).mean() > 0.99


def test_the_cut_of_a_slab_runs_through_its_channels(surface):
    device, points, skin = surface
    normal, place = best_plane(skin, points, np.array([0.0, 0.0, 1.0]), device.axial)
    if device.axial:
        assert normal[2] == 0.0
    elif isinstance(device, SeminarActuator):
        assert normal.tolist() == [0.0, 0.0, 1.0] and place[2] == pytest.approx(device.offset, abs=1e-4)


@pytest.mark.parametrize(
    "device",
    [
        Membrane(plate_radius=0.008, plate_thickness=0.002, rings=(0.011, 0.013), ring_thickness=0.001),
        Balloon(rod_radius=0.002),
        Bellows(),
    ],
    ids=lambda device: type(device).__name__,
)
def test_a_section_of_several_parts_points_outwards_everywhere(device, tmp_path):
    """Cells of what is bonded on may be numbered the other way round: its faces would be seen from inside alone."""
    skin = surface_of(*drawings.grid_of(device, tmp_path), device)
    points, _, _ = drawings.grid_of(device, tmp_path)
    corners = skin.points(points)[skin.triangles]
    assert len(skin.images) * volume(corners) == pytest.approx(device.solid_volume, rel=0.01)
    whole = skin.device(skin.points(points))[skin.device_triangles(skin.part != CUT_LABEL)]
    up = np.cross(whole[:, 1] - whole[:, 0], whole[:, 2] - whole[:, 0])[:, 2]
    top = whole[:, :, 2].min(axis=1) > device.apex - 1e-9 if isinstance(device, Membrane) else np.zeros(len(up), dtype=bool)
    assert (up[top] > 0.0).all()


# -- Rigid shapes in pictures: their surfaces, and where they have moved to ------------------------------------------


BALL = RigidShape("sphere", "top", (0.0, 0.001, 0.03), 0.01, guide="0.6, 0, 0.8", spring=50.0, name="ball")
ROD = RigidShape("cylinder", "top", (0.0, 0.0, 0.03), 0.01, name="rod")


@pytest.fixture
def states():
    rows = PathTable.read({"ball_travel_mm": way} for way in (0.0, 2.0, 5.0))
    return types.SimpleNamespace(case=types.SimpleNamespace(components=(BALL, ROD)), rows=rows)


def test_a_shape_is_drawn_where_it_has_given_way(states):
    assert shapes_of(states) == [BALL, ROD]
    np.testing.assert_allclose(way(states, BALL, 2), [0.003, 0.0, 0.004], atol=1e-15)
    np.testing.assert_allclose(way(states, BALL, 1.5), 3.5e-3 * np.array([0.6, 0.0, 0.8]), atol=1e-15)
    np.testing.assert_array_equal(way(states, ROD, 2), np.zeros(3))


def test_surfaces_lie_on_their_shapes():
    ball = shape_surface(BALL, 1.0)
    np.testing.assert_allclose(np.linalg.norm(ball.points - BALL.at, axis=1), 0.01, rtol=1e-6)
    assert ball.is_all_triangles and ball.n_cells > 2000
    points = shape_surface(ROD, 0.05).points
    np.testing.assert_allclose(np.hypot(points[:, 0], points[:, 2] - 0.03), 0.01, rtol=1e-6)
    assert np.abs(points[:, 1]).max() == pytest.approx(0.05)


@pytest.mark.campaign
def test_a_ball_that_is_lifted_stays_in_the_picture(tmp_path):
    ball = sm.RigidShape("sphere", "top", (0.0, 0.0, 0.0265), 0.01, guide="z", spring=20.0, name="ball")
    disk = sm.HollowDisk.variant("shadow", section="axisymmetric", cell_size=0.004)
    sm.inflate(disk, sm.NeoHookean(30e3), "0,40 cm", components=[ball], folder=tmp_path / "disk")
    shown = look(FolderStates(tmp_path / "disk", "disk"))
    steps = [0, shown.states.main]
    camera = shown.camera(steps)
    direction, up = np.array(camera.direction), np.array(camera.up)
    right = np.cross(up, direction) / np.linalg.norm(np.cross(up, direction))
    axes = np.array([right, np.cross(direction, right)])
    half = camera.scale * np.array([camera.size[0] / camera.size[1], 1.0])
    for step in steps:
        (layer,) = shape_layers(shown.states, step)
        placed = (np.asarray(layer[0].points) - camera.focus) @ axes.T
        assert (np.abs(placed) <= half).all()
    assert way(shown.states, ball, steps[-1])[2] > 0.002
