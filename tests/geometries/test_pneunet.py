"""The PneuNet: what can be built, what is refused by name, and whether the mesh is the shape."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from geometries import GeometryError, PneuNet
from geometries.actuator import changed
from geometries.meshing import private_model, summarize
from geometries.registry import from_table, to_table
from tests.support.campaigns import sampled

SHAPES = {
    "default": PneuNet(),
    "slotted": PneuNet.variant("slotted", chambers=3),
    "ribbed": PneuNet.variant("ribbed", chambers=3),
    "two-sided": PneuNet.variant("two-sided", chambers=2, opposite=0.5, part="full", paper=0.0004),
    "one chamber": PneuNet(chambers=1, chamber_length=0.03),
    "paper": PneuNet(chambers=2, paper=0.0006),
}
FACES = {"cavity", "support", "tip", "top", "bottom", "chamber_walls", "outer", "plane0"}


@pytest.mark.parametrize("name", sampled(SHAPES))
def test_mesh_is_the_shape(meshed, name):
    """Volumes of the regions and areas of the faces in closed form; probes are vertices."""
    finger, mesh = SHAPES[name], meshed(SHAPES[name])
    regions = {role: part.measure * finger.copies for (dimension, role), part in mesh.groups.items() if dimension == 3}
    assert sum(regions.values()) == pytest.approx(finger.solid_volume, rel=1e-9)
    width, base = 2 * finger.half_width, finger.base - finger.paper
    assert regions["base"] == pytest.approx(finger.length * width * base, rel=1e-9)
    assert regions.get("paper", 0.0) == pytest.approx(finger.length * width * finger.paper, rel=1e-9)
    box = finger.sides * (finger.height - finger.base / 2) * width * finger.length
    gaps = max(0, finger.chambers - 1) * finger.gap * width * finger.sides
    depth = finger.height - finger.gap_floor
    both = PneuNet.cavity_volume.fget(dataclasses.replace(finger, opposite=1.0)) if finger.sides == 2 else finger.cavity_volume
    assert both == pytest.approx(box - gaps * depth - regions["solid"], rel=1e-9)

    areas = {role: part.measure * finger.copies for (dimension, role), part in mesh.groups.items() if dimension == 2}
    walled = finger.chambers > 1 and finger.gap > 0.0
    expected = FACES - (set() if walled else {"chamber_walls"}) - ({"plane0"} if finger.copies == 1 else set())
    assert set(areas) == expected | ({"cavity2"} if finger.sides == 2 else set())
    if walled:
        assert areas["chamber_walls"] == pytest.approx(2 * gaps * depth / finger.gap, rel=1e-9)
    if finger.sides == 2:
        assert areas["cavity2"] == pytest.approx(areas["cavity"], rel=1e-9)
        assert areas["bottom"] == pytest.approx(areas["top"], rel=1e-9)
    ends = width * (finger.height - finger.probes["tip"][2])
    assert areas["support"] == pytest.approx(ends, rel=1e-9) and areas["tip"] == pytest.approx(ends, rel=1e-9)
    solid = np.concatenate([mesh.at(3, role) for role in regions])
    for place in finger.probes.values():
        assert np.linalg.norm(solid - place, axis=1).min() < 1e-9


def test_regions_share_their_nodes(meshed):
    """Layers of the base are bonded: no node lies twice in one place."""
    points = meshed(SHAPES["paper"]).points[1:]
    assert len(np.unique(np.round(points * 1e8).astype(np.int64), axis=0)) == len(points)


def test_default_mesh_is_small_and_sound(tmp_path):
    finger = PneuNet()
    found = summarize(finger.write(tmp_path / "finger.msh"))
    assert found.cells < 6000 and found.quality > 0.1
    assert 0.5 < finger.expected_cells / found.cells < 2.0


@pytest.mark.parametrize("name", ["default", "ribbed", "two-sided"])
def test_whole_is_one_solid(name):
    import gmsh

    finger = SHAPES[name]
    with private_model():
        finger.build_whole()
        ((_, tag),) = gmsh.model.occ.getEntities(3)
        assert gmsh.model.occ.getMass(3, tag) * 1e-9 == pytest.approx(finger.solid_volume, rel=1e-9)


def test_faces_follow_every_parameter(meshed):
    """Each length alone: points of the boundary lie on the other finger's walls, and probes go to probes."""
    finger = SHAPES["paper"]
    mesh = meshed(finger)
    cavity = mesh.at(2, "cavity")
    assert finger.carried(finger, cavity) == pytest.approx(cavity, abs=1e-12)
    for name in finger.movable:
        other = changed(finger, {name: 1.07 * getattr(finger, name)})
        moved = finger.carried(other, np.array(list(finger.probes.values())))
        assert moved == pytest.approx(np.array(list(other.probes.values())), abs=1e-12)
        inside = finger.carried(other, cavity)
        assert inside[:, 2].min() == pytest.approx(other.base / 2) and inside[:, 0].min() == pytest.approx(other.root)
        assert inside[:, 2].max() == pytest.approx(other.base / 2 + other.chamber_height)
        assert inside[:, 1].max() == pytest.approx(other.chamber_width / 2)
    assert min(finger.clearances.values()) == finger.gap
    with pytest.raises(GeometryError, match="another order"):
        finger.carried(dataclasses.replace(finger, chambers=3), cavity)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"channel_width": 0.013}, ("channel_width is 13 mm", "chamber_width, 12 mm")),
        ({"channel_height": 0.012}, ("channel_height is 12 mm", "chamber_height, 12 mm")),
        ({"bridge": 0.012}, ("bridge is 12 mm", "no gap is left")),
        ({"wall": 0.0001}, ("wall is 0.1 mm", "least_wall requires 0.3 mm")),
        ({"gap": 0.0002}, ("gap is 0.2 mm", "least_wall")),
        ({"cap": 0.0002}, ("cap is 0.2 mm", "least_wall")),
        ({"paper": 0.0025}, ("paper is 2.5 mm", "base 3 mm")),
        ({"chamber_length": 0.4}, ("chamber_length is 400 mm", "wrong unit")),
        ({"chamber_height": 1.4}, ("chamber_height is 1.4 m", "wrong unit")),
        ({"cell_size": 0.015}, ("cell_size is 15 mm", "wall 1 mm")),
        ({"cell_size": 0.00008}, ("cell_size is 0.08 mm", "3,000,000")),
        ({"chambers": 31}, ("chambers is 31",)),
        ({"sides": 3}, ("sides is 3",)),
        ({"base": 0.0}, ("base is 0 m", "larger than 0")),
        ({"top_wall": math.nan}, ("top_wall",)),
    ],
)
def test_impossible_fingers_are_refused_by_name(changes, words):
    with pytest.raises(GeometryError) as refused:
        PneuNet(**changes)
    assert all(word in str(refused.value) for word in words), refused.value


def test_table_gives_the_same_device_back():
    finger = PneuNet.variant("slotted", paper=0.0002, tip="held")
    assert from_table(to_table(finger)) == finger


@pytest.mark.parametrize("turned", [-60.0, 0.0, 75.0, 170.0, 190.0, 330.0])
def test_figures_of_a_bent_finger(turned):
    """A finger bent to a circle: the angle of the arc, beyond half a turn too."""
    finger = PneuNet()
    angle = math.radians(turned)
    radius = finger.length / angle if angle else math.inf
    x, z = (radius * math.sin(angle), -radius * (1 - math.cos(angle))) if angle else (finger.length, 0.0)
    height = 0.01
    places = {"tip": (x, 0.0, z), "tip_above": (x + height * math.sin(angle), 0.0, z + height * math.cos(angle))}
    figures = finger.device_figures(places)
    assert math.degrees(figures["bend_angle"]) == pytest.approx(turned, abs=1e-9)
    assert figures["tip_x"] == pytest.approx(x) and figures["tip_z"] == pytest.approx(z)


def test_a_finger_may_be_wider_than_long(tmp_path):
    """A pouch of one chamber is; only what suggests a wrong unit is refused."""
    pouch = PneuNet(chambers=1, chamber_width=0.030, cell_size=0.004)
    assert pouch.probes["tip"][0] < pouch.chamber_width
    assert pouch.write(tmp_path / "pouch.msh").is_file()
    with pytest.raises(GeometryError, match="suggests a wrong unit"):
        PneuNet(chamber_width=12.0)
