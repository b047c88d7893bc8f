"""Walls that meet are seen, and those with silicone between them are not taken for such."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

from geometries import HollowDisk
from softmodels.materials.laws import NeoHookean
from softmodels.mechanics.body import Body
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System
from softmodels.mechanics.walls.part import Walls as Pressing
from softmodels.results.fields import Fields
from softmodels.results.self_contact import Walls, _near

DISKS = {
    "wedge": HollowDisk(cell_size=0.004, refinement=1.0),
    "section": HollowDisk(section="axisymmetric", cell_size=0.004),
    "thin": HollowDisk.variant("shadow", section="axisymmetric"),
}


@pytest.fixture(params=DISKS)
def made(request, drawings, tmp_path):
    """A device, its nodes and its walls."""
    disk = DISKS[request.param]
    points, cells, name = drawings.grid_of(disk, tmp_path)
    return disk, points, Walls(points, cells, name, [plane.normal for plane in disk.cut_planes])


def sunk(disk, points, share):
    """A displacement that lowers the cavity's ceiling by a share of the cavity's height, and the membrane with it."""
    radius = np.hypot(points[:, 0], points[:, 1])
    over = np.clip((points[:, 2] - disk.base) / disk.cavity_height, 0.0, 1.0)
    dent = np.clip(1.0 - (radius / disk.cavity_radius) ** 2, 0.0, None)
    return np.outer(-share * disk.cavity_height * over * dent, [0.0, 0.0, 1.0])


def test_walls_at_rest_and_under_pressure_are_apart(made):
    disk, points, walls = made
    for share in (0.0, -3.0, 0.9):
        assert walls.met(sunk(disk, points, share)) is None


def test_a_ceiling_that_goes_through_the_floor_is_seen(made):
    disk, points, walls = made
    place = walls.met(sunk(disk, points, 1.1))
    assert place is not None and np.hypot(place[0], place[1]) < 0.5 * disk.cavity_radius
    assert place[2] == pytest.approx(disk.base, abs=0.2 * disk.cavity_height)


def test_a_thin_wall_does_not_face_itself(made):
    """Flattened to a hundredth of its thickness, the membrane's two faces come near each other and stay apart."""
    disk, points, walls = made
    top = disk.base + disk.cavity_height
    squeezed = np.where(points[:, 2] > top, -0.99 * (points[:, 2] - top), 0.0)
    assert walls.met(np.outer(squeezed, [0.0, 0.0, 1.0])) is None


@pytest.mark.parametrize("made", ["wedge"], indirect=True)
def test_a_wall_that_goes_through_its_mirror_plane_is_seen(made):
    disk, points, walls = made
    for plane in disk.cut_planes:
        distance = -(points @ plane.normal)
        shift = np.where(distance > 1e-9, 0.1 * disk.outer_radius, 0.0)  # what lies on the plane stays on it
        place = walls.met(np.outer(shift, plane.normal))
        assert place is not None and 0.0 < place @ plane.normal < 0.1 * disk.outer_radius
        assert walls.met(np.outer(np.minimum(shift, 0.9 * distance), plane.normal)) is None


def test_walls_that_press_on_each_other_are_left_out(made, drawings, tmp_path):
    """Of two that meet, both have to be in one set; what is named alone, or in another set, passes through."""
    disk, points, walls = made
    middles = walls.rest[0]
    ceiling = middles[:, 2] > disk.base + 0.5 * disk.cavity_height
    points, cells, name = drawings.grid_of(disk, tmp_path)
    planes = [plane.normal for plane in disk.cut_planes]
    for sets, met in (([middles], False), ([middles[ceiling]], True), ([middles[ceiling], middles[~ceiling]], True)):
        named = Walls(points, cells, name, planes, sets)
        assert named.resisted.sum() == sum(map(len, sets))
        assert (named.met(sunk(disk, points, 1.1)) is not None) is met


def test_a_run_knows_which_walls_press(comm, tmp_path):
    disk = DISKS["section"]
    body = Body.from_file(disk, disk.write(tmp_path / "disk.msh"), comm)
    walls = Fields(Solver(System(body, NeoHookean(30e3, 0.49), parts=[Pressing("cavity")]))).walls
    assert walls.resisted.shape[0] == 1 and walls.resisted.sum() == len(body.entities["cavity"][1])


@pytest.mark.parametrize("count", [2, 300, 4000])
@pytest.mark.parametrize("flat", [False, True])
def test_near_pairs_are_those_of_a_tree(count, flat):
    places = np.random.default_rng(count).random((count, 3)) - 0.4
    places[:, 1] *= not flat
    reach = 1.7 if count == 2 else count ** (-1 / (2 if flat else 3))
    pairs = np.sort(_near(places, reach), axis=0).T
    expected = scipy.spatial.cKDTree(places).query_pairs(reach, output_type="ndarray")
    assert len(expected) > count / 3
    assert sorted(map(tuple, pairs)) == sorted(map(tuple, expected))


def test_a_single_facet_is_near_none():
    assert not any(len(side) for side in _near(np.zeros((1, 3)), 0.1))
