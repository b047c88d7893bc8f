"""The closed tube: every role where it belongs, every volume what the formula says, impossible ones refused by name."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from geometries import Cylinder, GeometryError

COARSE = {"length": 0.02, "cell_size": 0.004}
TUBES = {
    "section": Cylinder(),
    "section, sharp, straight": Cylinder(fillet=0.0, order=1, base="sliding", end="held"),
    "half": Cylinder(section="half", **COARSE),
    "half with a strip, sliding": Cylinder(section="half", strip=120.0, base="sliding", end="sliding", **COARSE),
    "whole with a strip, sliding": Cylinder(section="whole", strip=240.0, base="sliding", fillet=0.0, **COARSE),
}


@pytest.fixture(params=TUBES.values(), ids=TUBES.keys())
def tube(request):
    return request.param


def test_groups_are_the_documented_ones(tube, meshed):
    d = tube.dimension
    expected = {(d, "wall"), (d, "cap")} | {(d - 1, name) for name in ("cavity", "support", "outer", "side", "end")}
    expected |= {(d - 1, "strip")} if tube.stripped else set()
    expected |= {(1, "axis")} if d == 2 else {(2, plane.name) for plane in tube.cut_planes}
    expected |= {(0, name) for name in tube.anchors}
    assert set(meshed(tube).groups) == expected
    assert set(tube.faces) <= {name for dimension, name in expected if dimension == d - 1}


def test_mesh_is_conforming_and_its_boundary_has_one_role_each(tube, meshed):
    mesh, d = meshed(tube), tube.dimension
    cells = np.concatenate([mesh.groups[d, region].corners for region in ("wall", "cap")])
    facets = np.concatenate([cells[:, list(some)] for some in itertools.combinations(range(d + 1), d)])
    facets, shared = np.unique(np.sort(facets, axis=1), axis=0, return_counts=True)
    assert set(shared) == {1, 2}
    named = np.concatenate([group.corners for (dimension, _), group in mesh.groups.items() if dimension == d - 1])
    named = np.sort(named, axis=1)
    assert len(np.unique(named, axis=0)) == len(named)
    assert np.array_equal(np.unique(named, axis=0), facets[shared == 1])


def test_volumes_match_the_closed_forms(tube, meshed):
    mesh = meshed(tube)
    if tube.dimension == 3:
        solid = sum(mesh.groups[3, region].measure for region in ("wall", "cap"))
        assert solid * tube.copies == pytest.approx(tube.solid_volume, rel=1e-3)
        assert -mesh.groups[2, "cavity"].flux / 3 * tube.copies == pytest.approx(tube.cavity_volume, rel=1e-3)
    else:
        area = sum(mesh.groups[2, region].measure for region in ("wall", "cap"))
        corner = (1 - math.pi / 4) * tube.fillet**2
        flat = tube.outer_radius * tube.height - tube.inner_radius * tube.length + corner
        assert area == pytest.approx(flat, rel=1e-5)


def test_the_rounding_is_what_is_missing_of_the_cavity():
    sharp, round_ = Cylinder(fillet=0.0), Cylinder(fillet=0.002)
    z = np.linspace(0.0, 1.0, 2_000_001) * 0.002  # height above the rounding's foot
    radius = sharp.inner_radius - 0.002 + np.sqrt(0.002**2 - z**2)
    lost = np.trapezoid(math.pi * (sharp.inner_radius**2 - radius**2), z)
    assert sharp.cavity_volume - round_.cavity_volume == pytest.approx(lost, rel=1e-6)
    assert sharp.cavity_volume == pytest.approx(math.pi * 0.006**2 * 0.06)


def test_the_strip_looks_along_x_and_the_wall_ends_where_it_is_straight(meshed):
    tube = TUBES["half with a strip, sliding"]
    mesh = meshed(tube)
    for role, inside in (("strip", True), ("outer", False)):
        x, y, z = mesh.at(2, role).T
        assert np.abs(np.hypot(x, y) - tube.outer_radius).max() < 1e-9 and z.max() == pytest.approx(tube.straight)
        angle = np.degrees(np.arctan2(y, x))
        assert (angle <= 60.0 + 1e-6).all() if inside else (angle >= 60.0 - 1e-6).all()
    assert mesh.at(3, "wall")[:, 2].max() == pytest.approx(tube.straight) == mesh.at(3, "cap")[:, 2].min()
    for role, place in tube.anchors.items():
        assert np.abs(mesh.at(0, role) - place).max() < 1e-9


def test_every_probe_is_a_vertex_and_the_profile_ends_at_the_axis(tube, meshed):
    mesh = meshed(tube)
    points = np.unique(np.concatenate([mesh.groups[tube.dimension, name].corners.ravel() for name in ("wall", "cap")]))
    places = tube.device_points(mesh.points[points])
    for place in tube.probes.values():
        assert np.linalg.norm(places - place, axis=1).min() < 1e-9
    profile = places[tube.on_profile(places)]
    assert profile[:, 0].min() == pytest.approx(0.0, abs=1e-9) and profile[:, 2].min() == pytest.approx(0.0, abs=1e-9)


def test_figures_of_a_turned_and_stretched_tube():
    tube = TUBES["whole with a strip, sliding"]
    c, s = math.cos(math.radians(30.0)), math.sin(math.radians(30.0))
    twisted = {
        name: (c * x - s * y, s * x + c * y, 1.1 * z) if "rim" in name else (x, y, 1.1 * z)
        for name, (x, y, z) in tube.probes.items()
    }
    figures = tube.device_figures(twisted)
    assert figures["elongation_percent"] == pytest.approx(10.0) and figures["twist_deg"] == pytest.approx(30.0)
    assert figures["diameter_mm"] == pytest.approx(16.0) and figures["bend_angle_deg"] == pytest.approx(0.0)
    bent = {name: (c * x + s * z, y, -s * x + c * z) for name, (x, y, z) in tube.probes.items()}
    assert tube.device_figures(bent)["bend_angle_deg"] == pytest.approx(30.0)
    for some in TUBES.values():
        assert set(some.device_figures(some.probes)) <= set(some.figure_texts)


@pytest.mark.parametrize(
    ("values", "name"),
    [
        ({"inner_radius": 0.0}, "inner_radius"),
        ({"inner_radius": 5.0}, "length"),
        ({"wall": -0.001}, "wall"),
        ({"wall": 0.2, "length": 0.1}, "wall"),
        ({"length": 3.0}, "length"),
        ({"length": 0.001}, "length"),
        ({"cap": 1.0}, "cap"),
        ({"cap": 1e-6}, "cap"),
        ({"fillet": 0.006}, "fillet"),
        ({"fillet": 0.0055, "length": 0.01}, "fillet"),
        ({"strip": 90.0}, "strip"),
        ({"strip": 5.0, "section": "half"}, "strip"),
        ({"strip": 360.0, "section": "whole"}, "strip"),
        ({"strip": -60.0, "section": "half"}, "strip"),
        ({"cell_size": 0.05}, "cell_size"),
        ({"cell_size": 1e-5, "section": "half"}, "cell_size"),
        ({"section": "quarter"}, "section"),
        ({"base": "free"}, "base"),
        ({"end": "open"}, "end"),
        ({"length": math.nan}, "length"),
    ],
)
def test_impossible_ones_are_refused_by_name(values, name):
    with pytest.raises(GeometryError, match=rf"^{name} is"):
        Cylinder(**values)
