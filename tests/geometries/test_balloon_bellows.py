"""Balloons and round bellows: roles where they belong, volumes as in closed form, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

from geometries import Balloon, Bellows, GeometryError
from geometries.registry import from_table, to_table

DEVICES = {
    "balloon": Balloon(),
    "closed": Balloon(neck_radius=0.0),
    "spheroid, sharp": Balloon(polar_radius=0.03, fillet=0.0, neck_wall=0.002, held="outside"),
    "on a rod": Balloon(rod_radius=0.002),
    "bellows": Bellows(),
    "flat crests": Bellows(convolutions=2, wall=0.001, rounding=0.0012, tip="held"),
}


@pytest.mark.parametrize("device", DEVICES.values(), ids=DEVICES)
def test_a_section_has_its_roles_and_volumes(device, meshed):
    mesh = meshed(device)
    solids = [name for dimension, name in mesh.groups if dimension == 2]
    assert solids == (["solid", "rod"] if "rod" in solids else ["solid"])
    faces = {name for dimension, name in mesh.groups if dimension == 1}
    assert faces >= {"cavity", "axis", *device.faces}
    assert {hold.role for hold in device.holds} <= {name for _, name in mesh.groups}
    # Curved sides are parabolas between the nodes.
    assert sum(mesh.groups[2, name].turned for name in solids) == pytest.approx(device.solid_volume, rel=1e-4)
    lines = np.concatenate([mesh.groups[1, name].corners for name in faces])
    assert len(np.unique(np.sort(lines, axis=1), axis=0)) == len(lines)
    everywhere = mesh.points[np.unique(np.concatenate([group.nodes for group in mesh.groups.values()]))]
    for place in device.probes.values():
        assert np.linalg.norm(device.device_points(everywhere) - place, axis=1).min() < 1e-9
    assert from_table(to_table(device)) == device


@pytest.mark.parametrize("device", DEVICES.values(), ids=DEVICES)
def test_its_outline_is_one_line(device, meshed):
    mesh = meshed(device)
    nodes = np.unique(np.concatenate([mesh.groups[1, role].nodes for role in device.seen]))
    points = device.device_points(mesh.points[nodes])
    assert device.on_profile(points).all()
    line = points[np.argsort(device.along_profile(points))]
    assert np.linalg.norm(np.diff(line, axis=0), axis=1).max() < 1.05 * device.cell_size
    assert line[0] == pytest.approx(device.probes["apex"], abs=1e-9)


def test_volumes_are_those_of_the_formulas():
    closed = Balloon(neck_radius=0.0, polar_radius=0.02)
    assert closed.cavity_volume == pytest.approx(4 / 3 * math.pi * 0.015**2 * 0.02, rel=1e-12)
    assert closed.solid_volume == pytest.approx(4 / 3 * math.pi * (0.016**2 * 0.021 - 0.015**2 * 0.02), rel=1e-12)
    bare = Balloon(fillet=0.0)
    high = bare.meridian.joint[1]
    cap = bare.meridian.height - high
    inside = math.pi * (2 / 3 * 0.015**3 + 0.015**2 * cap - cap**3 / 3 + 0.004**2 * high)
    assert bare.cavity_volume == pytest.approx(inside, rel=1e-12)
    rod = Balloon(fillet=0.0, rod_radius=0.002)
    long = rod.meridian.height + math.sqrt(0.015**2 - 0.002**2)
    assert rod.cavity_volume < bare.cavity_volume - math.pi * 0.002**2 * long
    # Guldin: quarter rings of the wall, their centroids (bend^2 + t^2 / 12) / bend * 2 / pi from their centres.
    bellows = Bellows(convolutions=1)
    root, crest, bend, t = 0.00875, 0.01525, 0.002, 0.0015
    flanks = 2 * math.pi * t * ((crest - bend) ** 2 - (root + bend) ** 2)
    quarter, away = 0.5 * math.pi * bend * t, 2 / math.pi * (bend**2 + t**2 / 12) / bend
    arcs = 2 * 2 * math.pi * quarter * ((root + bend - away) + (crest - bend + away))
    plates = 2 * math.pi * 0.0095**2 * 0.004
    assert bellows.solid_volume == pytest.approx(flanks + arcs + plates, rel=1e-9)


@pytest.mark.campaign
def test_wedges_have_their_roles_and_volumes(meshed):
    for device, tolerance in (
        (Balloon(section="wedge", wall=0.002, through=1, rod_radius=0.002, angle=45.0), 3e-3),
        (Bellows(section="wedge", convolutions=1, through=1, cell_size=0.002, angle=45.0), 3e-3),
    ):
        mesh = meshed(device)
        faces = {name for dimension, name in mesh.groups if dimension == 2}
        assert faces >= {"cavity", "support", "plane0", "plane1", *device.faces}
        solids = [group for (dimension, _), group in mesh.groups.items() if dimension == 3]
        assert device.copies * sum(group.measure for group in solids) == pytest.approx(device.solid_volume, rel=tolerance)


WRONG_BALLOONS = {
    "wall is 20 mm": {"wall": 0.02},
    "wall is 0.01 mm": {"wall": 1e-5},
    "neck_wall is 16 mm": {"neck_wall": 0.016},
    "polar_radius is 1 mm": {"polar_radius": 0.001},
    "neck_radius is 14 mm": {"neck_radius": 0.014},
    "neck_length is 1 m": {"neck_length": 1.0},
    "fillet is 10 mm": {"fillet": 0.01},
    "rod_radius is 4 mm": {"rod_radius": 0.004},
    "rod_radius is 1 mm; a rod needs a neck": {"rod_radius": 0.001, "neck_radius": 0.0},
    "held is 'outside'": {"held": "outside", "neck_radius": 0.0},
    "angle is 180 deg; without a neck": {"section": "wedge", "angle": 180.0, "neck_radius": 0.0},
    "angle is 0 deg; it must be between 5 and 360 deg": {"section": "wedge", "angle": 0.0, "neck_radius": 0.0},
    "cell_size is 16 mm": {"cell_size": 0.016},
    "through is 0": {"through": 0.0},
    "radius is 11 m": {"radius": 11.0},
}
WRONG_BELLOWS = {
    "convolutions is 0": {"convolutions": 0},
    "outer_radius is 8 mm": {"outer_radius": 0.008},
    "wall is 5 mm": {"wall": 0.005},
    "wall is 0.02 mm": {"wall": 2e-5},
    "rounding is 0.5 mm": {"rounding": 0.5e-3},
    "rounding is 3 mm; it must be at most a quarter of pitch": {"rounding": 0.003},
    "rounding is 2 mm; root and crest": {"outer_radius": 0.012},
    "cap is 1 m": {"cap": 1.0},
    "pitch is 1 m": {"pitch": 1.0, "rounding": 0.002, "convolutions": 12},
    "cell_size is 9 mm": {"cell_size": 0.009},
    "tip is 'glued'": {"tip": "glued"},
    "angle is 50 deg": {"section": "wedge", "angle": 50.0},
}


@pytest.mark.parametrize(
    ("device", "words", "changes"),
    [(kind, *one) for kind, wrong in ((Balloon, WRONG_BALLOONS), (Bellows, WRONG_BELLOWS)) for one in wrong.items()],
)
def test_what_cannot_be_is_refused_by_name(device, words, changes):
    with pytest.raises(GeometryError, match=words):
        device(**changes)
