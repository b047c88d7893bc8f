"""Points of a membrane's boundary, or another round device's, on another one: corners to corners, nodes to its outline."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from geometries import Balloon, Bellows, Cylinder, GeometryError, Membrane
from geometries.actuator import changed, parameter
from geometries.cylinder import outline

DEVICES = {
    "membrane": Membrane(),
    "with plate and rings": Membrane(plate_radius=0.005, rings=(0.008, 0.011), clamp_width=0.004),
    "of their own": Membrane(plate_radius=0.005, plate_thickness=0.002, rings=(0.008, 0.011), ring_thickness=0.001),
    "wedge": Membrane(
        section="wedge",
        angle=30.0,
        cell_size=0.006,
        through=1.0,
        thickness=0.004,
        plate_radius=0.01,
        plate_thickness=0.004,
    ),
    "balloon": Balloon(),
    "spheroid with a rod": Balloon(polar_radius=0.02, rod_radius=0.002, neck_wall=0.0015),
    "sharp neck": Balloon(fillet=0.0),
    "bellows": Bellows(outer_radius=0.018),
    "upright roots and crests": Bellows(outer_radius=0.018, rounding=0.0015),
    "half circles at any pitch": Bellows(convolutions=2, outer_radius=0.018, rounding=0.0),
    "tube": Cylinder(),
    "sharp half tube": Cylinder(section="half", strip=120.0, length=0.012, fillet=0.0, cell_size=0.004),
    "without a neck": Balloon(neck_radius=0.0),
}
FACTORS = (1.1, 0.9, 1.15, 0.95, 1.05, 0.92, 1.08)
NEAR = 1e-12
"""In m."""


@pytest.fixture(params=DEVICES.values(), ids=DEVICES.keys())
def device(request):
    return request.param


def other_than(device):
    """All lengths changed, each by its own share, and cut into other numbers of cells."""
    values = {name: by * parameter(device, name) for name, by in zip(device.movable, FACTORS, strict=False)}
    return dataclasses.replace(changed(device, values), cell_size=0.7 * device.cell_size)


def edges_of(device):
    return outline(device) if isinstance(device, Cylinder) else device.edges


def turned(points):
    return np.column_stack([np.hypot(points[:, 0], points[:, 1]), points[:, 2]])


def missed(device, points):
    """Distance of points from the outline in m, shape (n,)."""
    return np.min([edge.missed(turned(points)) for edge in edges_of(device)], axis=0)


def test_corners_and_probes_go_to_corners_and_probes(device):
    other = other_than(device)
    assert len(device.movable) >= 2
    for here, there in zip(edges_of(device), edges_of(other), strict=True):
        points = np.array([(r, 0.0, z) for r, z in (here.start, here.end)])
        assert np.abs(turned(device.carried(other, points)) - [there.start, there.end]).max() < NEAR
    probes = device.carried(other, np.array(list(device.probes.values())))
    assert np.abs(probes - list(other.probes.values())).max() < NEAR


def test_nodes_of_a_mesh_land_on_the_other_outline(device, meshed):
    mesh = meshed(device)
    roles = {edge.role for edge in edges_of(device)} & {name for dim, name in mesh.groups if dim == device.dimension - 1}
    nodes = np.unique(np.concatenate([mesh.groups[device.dimension - 1, role].nodes for role in roles]))
    points = device.device_points(mesh.points[nodes])
    here = missed(device, points).max()
    assert len(points) > 50 and here < 1e-3 * device.size  # on a wedge nodes of chords lie a little inside
    other = other_than(device)
    carried = device.carried(other, points)
    assert missed(other, carried).max() < NEAR + 1.2 * here
    assert missed(device, carried).max() > 0.005 * device.size  # they have moved
    assert np.array_equal(device.carried(device, points), points)
    assert np.abs(other.carried(device, carried) - points).max() < NEAR + here


def test_outlines_with_other_edges_are_refused():
    points = np.zeros((1, 3))
    for one, other in ((DEVICES["balloon"], DEVICES["sharp neck"]), (DEVICES["membrane"], DEVICES["balloon"])):
        with pytest.raises(GeometryError, match="outlines have the same edges"):
            one.carried(other, points)
    with pytest.raises(GeometryError, match="same section and angle"):
        DEVICES["wedge"].carried(dataclasses.replace(DEVICES["wedge"], angle=45.0), points)


def test_lines_that_come_and_go_are_not_followed():
    """Half circles stay such at one pitch and rounding, or at any pitch where the rounding is a quarter of it."""
    whole = ("inner_radius", "outer_radius", "wall", "pitch", "rounding", "cap")
    assert Bellows(rounding=0.0015).movable == whole and DEVICES["bellows"].movable == (*whole[:3], "cap")
    assert DEVICES["half circles at any pitch"].movable == (*whole[:4], "cap")
    assert Bellows(outer_radius=0.0135).movable == ("cap",)  # no flanks


def test_clearances_name_what_is_thinnest():
    assert Membrane().clearances == {"membrane": 0.001}
    found = DEVICES["of their own"].clearances
    assert found["plate"] == 0.002 and found["from plate to ring1 inside"] == pytest.approx(0.003)
    assert found["from ring1 outside to clamp"] == pytest.approx(0.009)
    assert DEVICES["spheroid with a rod"].clearances["air in the neck"] == pytest.approx(0.002)
