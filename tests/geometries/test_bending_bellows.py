"""The bending bellows: what can be built, what is refused by name, and whether the mesh is the shape."""

from __future__ import annotations

import math

import numpy as np
import pytest

from geometries import BendingBellows, GeometryError
from geometries.meshing import private_model, summarize
from geometries.registry import from_table, to_table
from tests.support.campaigns import sampled

SHAPES = {
    "default": BendingBellows(folds=2),
    "deep": BendingBellows(folds=2, depth=0.006),
    "flat, with a rim": BendingBellows(folds=2, depth=0.002, rim=0.002, part="full"),
}


@pytest.mark.parametrize("name", sampled(SHAPES, 3))
def test_volumes_are_those_of_the_kernel(name):
    """The integral over the arcs against the CAD kernel's solid, to rounding; the cavity by summing circles along x."""
    import gmsh

    bellows = SHAPES[name]
    with private_model():
        bellows.build_whole()
        ((_, tag),) = gmsh.model.occ.getEntities(3)
        assert gmsh.model.occ.getMass(3, tag) * 1e-9 == pytest.approx(bellows.solid_volume, rel=1e-9)
    summed = 0.0
    for arc in bellows.arcs(False):
        x = arc.start + (arc.end - arc.start) * (np.arange(4000) + 0.5) / 4000
        summed += np.mean([arc.height(at) ** 2 for at in x]) * (arc.end - arc.start)
    assert bellows.cavity_volume == pytest.approx(0.5 * math.pi * summed, rel=1e-5)


@pytest.mark.parametrize("name", sampled(SHAPES, ("flat, with a rim",)))
def test_mesh_is_the_shape(meshed, name):
    bellows, mesh = SHAPES[name], meshed(SHAPES[name])
    volumes = {role: part.measure * bellows.copies for (dimension, role), part in mesh.groups.items() if dimension == 3}
    assert set(volumes) == {"solid", "base"}
    assert volumes["base"] == pytest.approx(2 * bellows.length * bellows.half_width * bellows.base, rel=1e-9)
    assert sum(volumes.values()) == pytest.approx(bellows.solid_volume, rel=1e-2)
    faces = {role for dimension, role in mesh.groups if dimension == 2}
    cut = {"plane0"} if bellows.copies == 2 else set()
    assert faces == {"cavity", "support", "tip", "folds", "bottom", "outer"} | cut
    for role, outer in (("cavity", False), ("folds", True)):
        x, y, z = mesh.at(2, role).T
        r = np.hypot(y, z - bellows.base / 2)
        heights = [arc.height(at) for arc in bellows.arcs(outer) for at in (arc.start, arc.end)]
        assert r.max() == pytest.approx(max(heights), rel=1e-6)
        if outer:
            assert r.min() == pytest.approx(min(heights), rel=1e-6)
        assert x.min() == pytest.approx(bellows.root) and x.max() == pytest.approx(bellows.length - bellows.cap)
    solid = np.concatenate([mesh.at(3, role) for role in volumes])
    for place in bellows.probes.values():
        assert np.linalg.norm(solid - place, axis=1).min() < 1e-9


def test_wall_has_one_thickness():
    """Arcs of both faces have common centres; flanks of deep folds stand across x."""
    for bellows in SHAPES.values():
        for inside, outside in zip(bellows.arcs(False), bellows.arcs(True), strict=True):
            assert inside.centre == pytest.approx(outside.centre)
            assert abs(inside.radius - outside.radius) == pytest.approx(bellows.wall)
    assert SHAPES["deep"].half_angle == pytest.approx(math.pi / 2)
    assert SHAPES["deep"].crest == pytest.approx(max(arc.height(arc.end) for arc in SHAPES["deep"].arcs(True)))


@pytest.mark.campaign
def test_default_mesh_is_small_and_sound(tmp_path):
    bellows = BendingBellows()
    found = summarize(bellows.write(tmp_path / "bellows.msh"))
    assert found.cells < 6000 and found.quality > 0.05
    assert 0.5 < bellows.expected_cells / found.cells < 2.0


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"wall": 0.0045}, ("wall is 4.5 mm", "pitch 8 mm", "inside them")),
        ({"wall": 0.0001}, ("wall is 0.1 mm", "least_wall requires 0.3 mm")),
        ({"pitch": 0.3}, ("pitch is 300 mm", "wrong unit")),
        ({"radius": 0.09}, ("radius is 90 mm", "twice the length, 39 mm")),
        ({"depth": 0.025}, ("depth is 25 mm", "three pitches")),
        ({"depth": 0.0001}, ("depth is 0.1 mm", "least_wall")),
        ({"base": 0.033}, ("base is 33 mm", "the folds, 32 mm")),
        ({"rim": 0.04}, ("rim is 40 mm", "32 mm")),
        ({"root": 0.05}, ("root is 50 mm", "32 mm")),
        ({"cap": 0.0001}, ("cap is 0.1 mm", "least_wall")),
        ({"cell_size": 0.016}, ("cell_size is 16 mm", "wall 1.5 mm")),
        ({"cell_size": 0.00005}, ("cell_size is 0.05 mm", "3,000,000")),
        ({"folds": 0}, ("folds is 0",)),
        ({"radius": math.inf}, ("radius",)),
    ],
)
def test_impossible_bellows_are_refused_by_name(changes, words):
    with pytest.raises(GeometryError) as refused:
        BendingBellows(**changes)
    assert all(word in str(refused.value) for word in words), refused.value


def test_table_gives_the_same_device_back():
    bellows = BendingBellows(depth=0.004, rim=0.001, part="full")
    assert from_table(to_table(bellows)) == bellows
