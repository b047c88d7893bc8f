"""The seminar actuator's boundary carried to another slab: on its walls, smooth in its parameters, no facet turned over."""

from __future__ import annotations

import itertools

import gmsh
import numpy as np
import pytest

from geometries import GeometryError, HollowDisk, SeminarActuator
from geometries.actuator import changed, parameter, parameter_names
from geometries.meshing import private_model
from geometries.seminar import edge_distance, side
from tests.support.campaigns import sampled

COARSE = {"around": 6.0, "channels": 3, "spread": 60.0}
SLABS = {
    "common": SeminarActuator(**COARSE),
    "sharp": SeminarActuator(around=6.0, channels=4, spread=90.0, fillet=0.0, tip_radius=0.0),
    "own": SeminarActuator(
        **COARSE,
        bores=(0.0007, 0.0006),
        middle_bores=(0.0011, 0.0008),
        end_bores=(0.0006, 0.0012),
        angles=(0.0, 35.0),
        reaches=(0.040, 0.028),
    ),
    "level": SeminarActuator(**COARSE, part="full", offset=0.0),
}
PLANE = 1e-12
"""What is left of a coordinate in m on a plane face."""


@pytest.fixture(scope="module")
def boundary(tmp_path_factory):
    """Return a function that gives a slab's boundary nodes by role, and all facets' corners with their role."""
    folder = tmp_path_factory.mktemp("carried")
    known = {}

    def read(name):
        if name not in known:
            with private_model():
                gmsh.merge(str(SLABS[name].write(folder / f"{name}.msh")))
                roles, facets = {}, {}
                for dimension, tag in gmsh.model.getPhysicalGroups(2):
                    role = gmsh.model.getPhysicalName(dimension, tag)
                    roles[role] = gmsh.model.mesh.getNodesForPhysicalGroup(dimension, tag)[1].reshape(-1, 3)
                    facets[role] = np.concatenate([corners(e) for e in gmsh.model.getEntitiesForPhysicalGroup(2, tag)])
            known[name] = roles, facets
        return known[name]

    return read


def corners(entity):
    """Places of the corners of an entity's triangles, shape (n, 3, 3)."""
    tags, places, _ = gmsh.model.mesh.getNodes()
    at = np.zeros((int(tags.max()) + 1, 3))
    at[tags.astype(int)] = places.reshape(-1, 3)
    (nodes,) = gmsh.model.mesh.getElements(2, entity)[2]
    return at[nodes.astype(int).reshape(-1, 6)[:, :3]]


def from_walls(slab, points):
    """Distance in m of points from the walls of pipes around the centre lines, and how much farther the next pipe is."""
    gaps = []
    for channel in slab.drawn.channels:
        least = np.full(len(points), np.inf)
        for (a, p), (b, q) in itertools.pairwise(zip(np.array(channel.points), channel.radii, strict=True)):
            along, slope = np.linalg.norm(b - a), (q - p) / np.linalg.norm(b - a)
            x = (points - a) @ (b - a) / along
            away = np.linalg.norm(points - a - np.outer(x, (b - a) / along), axis=1)
            # The ball on the line whose surface is nearest lies aside of the foot, by the slope of the wall.
            foot = np.clip(x + away * slope / np.sqrt(1.0 - slope**2), 0.0, along)
            least = np.minimum(least, np.hypot(x - foot, away) - p - slope * foot)
        gaps.append(least)
    first, *others = np.sort(gaps, axis=0)
    return np.abs(first), others[0] - first


def all_changed(slab, by, seed=1):
    """The slab with every movable parameter changed by up to a share, the same for lists' neighbours."""
    random = np.random.default_rng(seed)
    for _ in range(50):
        try:
            return changed(slab, {name: parameter(slab, name) * (1 + by * random.uniform(-1, 1)) for name in slab.movable})
        except GeometryError:
            continue
    raise AssertionError


def test_all_lengths_and_angles_of_the_shape_move():
    assert set(SLABS["common"].movable) == set(parameter_names(SLABS["common"]))
    assert set(parameter_names(SLABS["own"])) - set(SLABS["own"].movable) == {"angles[1]"}  # the middle stays there
    assert set(parameter_names(SLABS["sharp"])) - set(SLABS["sharp"].movable) == {"fillet", "tip_radius"}
    assert set(parameter_names(SLABS["level"])) - set(SLABS["level"].movable) == {"offset"}


@pytest.mark.parametrize("by", [0.3])
@pytest.mark.parametrize("name", sampled(SLABS, ("sharp",)))
def test_faces_go_to_faces(name, by, boundary):
    slab, roles = SLABS[name], boundary(name)[0]
    other = all_changed(slab, by)
    found = {role: slab.carried(other, points) for role, points in roles.items()}
    half, middle = 0.5 * other.thickness, other.length - other.tip_radius
    assert np.abs(found["support"][:, 0]).max() < PLANE
    assert np.abs(found["top"][:, 2] - half).max() < PLANE and np.abs(found["bottom"][:, 2] + half).max() < PLANE
    if "plane0" in found:
        assert not found["plane0"][:, 1].any()
    assert max(abs(edge_distance(other, x, y)) for x, y, _ in found["outer"]) < PLANE
    if slab.tip_radius:
        assert np.abs(np.hypot(found["tip"][:, 0] - middle, found["tip"][:, 1]) - other.tip_radius).max() < 1e-6  # a spline's
    ends = [
        (0, sign * 0.5 * device.base_width, z * device.thickness)
        for device in (slab, other)
        for sign, z in ((1, 0.5), (1, -0.5))
    ] + [(*side(device)[1], 0.5 * device.thickness) for device in (slab, other)]
    before, after = [*ends[:2], ends[4]], [*ends[2:4], ends[5]]
    assert slab.carried(other, np.array(before)) == pytest.approx(np.array(after), abs=PLANE)
    probes = slab.carried(other, np.array(list(slab.probes.values())))
    assert probes == pytest.approx(np.array(list(other.probes.values())), abs=PLANE)


@pytest.mark.campaign
@pytest.mark.parametrize("by", [0.1, 0.3])
@pytest.mark.parametrize("name", sampled(SLABS, 3))
def test_walls_go_to_walls(name, by, boundary):
    """Nodes on pipes lie on those of the other, those of roundings between two pipes not farther from them than these reach."""
    slab = SLABS[name]
    points = boundary(name)[0]["cavity"]
    other = all_changed(slab, by)
    found = slab.carried(other, points)
    assert np.abs(found - points).max() > 0.3 * by * slab.manifold_bore
    (away, room), (its_away, its_room) = from_walls(slab, points), from_walls(other, found)
    alone = (room > 1.01 * slab.fillet) & (its_room > 1.01 * other.fillet) & (away < 1e-9)  # no middles of straightened edges
    assert alone.mean() > 0.6
    assert its_away[alone].max() < 1e-8 and its_away[away < 1e-9].max() < max(0.4 * other.fillet, 1e-8)


@pytest.mark.parametrize("name", SLABS)
def test_the_same_device_moves_nothing(name, boundary):
    slab = SLABS[name]
    points = np.concatenate(list(boundary(name)[0].values()))
    assert np.array_equal(slab.carried(slab, points), points)
    step = changed(slab, {"length": slab.length * (1 + 1e-9)})
    assert np.abs(slab.carried(step, points) - points).max() < 2e-9 * slab.length


@pytest.mark.campaign
@pytest.mark.parametrize("name", sampled(SLABS, 3))
def test_places_are_smooth_in_every_parameter(name, boundary):
    """Central differences converge with second order, and steps of 1e-6 have no noise that matters."""
    slab = SLABS[name]
    points = np.concatenate([places[::12] for places in boundary(name)[0].values()])

    def motion(key, step):
        value = parameter(slab, key)
        ends = [changed(slab, {key: value * (1.0 + sign * step)}) for sign in (1, -1)]
        return (slab.carried(ends[0], points) - slab.carried(ends[1], points)) / (2 * step)

    for key in slab.movable:
        wide, less, fine = (motion(key, step) for step in (4e-3, 2e-3, 1e-6))
        size = np.abs(fine).max()
        assert size > 1e-5, key
        assert np.abs(less - fine).max() < 0.3 * np.abs(wide - fine).max() + 1e-6 * size, key


@pytest.mark.parametrize("name", SLABS)
def test_no_facet_turns_over(name, boundary):
    """Volumes between facets and their motion: every facet keeps its side, and none shrinks to a small part of itself."""
    slab, (_, facets) = SLABS[name], boundary(name)
    for by in (0.1, 0.2):
        other = all_changed(slab, by, seed=2)
        steps = [changed(slab, {key: (1 - t) * parameter(slab, key) + t * parameter(other, key) for key in slab.movable})
                 for t in (0.25, 0.5, 0.75, 1.0)]  # fmt: skip
        for role, places in facets.items():
            before = areas(places)
            for step in steps:
                after = areas(slab.carried(step, places.reshape(-1, 3)).reshape(-1, 3, 3))
                cosine = (before * after).sum(axis=1) / np.linalg.norm(before, axis=1) / np.linalg.norm(after, axis=1)
                share = np.linalg.norm(after, axis=1) / np.linalg.norm(before, axis=1)
                assert cosine.min() > 0.2 and share.min() > 0.15, (role, by, cosine.min(), share.min())


def areas(places):
    return np.cross(places[:, 1] - places[:, 0], places[:, 2] - places[:, 0])


@pytest.mark.parametrize(
    ("other", "words"),
    [
        (SeminarActuator(**{**COARSE, "channels": 4}), "channels is 3 and 4"),
        (SeminarActuator(**COARSE, fillet=0.0), "fillet"),
        (SeminarActuator(**COARSE, middle_bores=(0.001, 0.001)), "channels of other lines"),
        (HollowDisk(), "HollowDisk"),
    ],
)
def test_what_a_mesh_cannot_follow(other, words):
    with pytest.raises(GeometryError, match=words):
        SLABS["common"].carried(other, np.zeros((1, 3)))
