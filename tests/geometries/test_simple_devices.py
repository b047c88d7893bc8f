"""Tubes, beams and membranes: roles where they belong, volumes as in closed form, and what is refused."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from geometries import Beam, Cylinder, GeometryError, Membrane
from geometries.registry import from_table, to_table
from tests.support.campaigns import sampled

COARSE = {"length": 0.02, "cell_size": 0.004}
TUBES = {
    "section": Cylinder(),
    "section, sharp, straight": Cylinder(fillet=0.0, order=1, base="sliding", end="held"),
    "half": Cylinder(section="half", **COARSE),
    "half with a strip, sliding": Cylinder(section="half", strip=120.0, base="sliding", end="sliding", **COARSE),
    "whole with a strip, sliding": Cylinder(section="whole", strip=240.0, base="sliding", fillet=0.0, **COARSE),
}


@pytest.fixture(params=sampled(TUBES.values(), 3), ids=TUBES.keys())
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
    assert figures["elongation_percent"] == pytest.approx(10.0) and figures["twist"] == pytest.approx(math.pi / 6)
    assert figures["diameter"] == pytest.approx(0.016) and figures["bend_angle"] == pytest.approx(0.0)
    bent = {name: (c * x + s * z, y, -s * x + c * z) for name, (x, y, z) in tube.probes.items()}
    assert tube.device_figures(bent)["bend_angle"] == pytest.approx(math.pi / 6)
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


# -- Beams: roles where they belong, volumes as in closed form, and what is refused ----------------------------------


COARSE_BEAM = {"length": 0.020, "cell_size": 0.005}
OPEN = {"quarter": ("plane0", "plane1"), "half": ("plane0", "bottom"), "full": ("bottom",)}
"""Faces by the part that is modelled, beyond those that all have."""


@pytest.mark.parametrize("part", sampled(OPEN, 3))
def test_it_has_its_roles_and_volumes(part, meshed):
    beam = Beam(part=part, **COARSE_BEAM)
    mesh = meshed(beam)
    faces = {"support", "tip", "top", "side", *OPEN[part]}
    assert set(mesh.groups) == {(3, "solid"), (1, "edge")} | {(2, name) for name in faces}
    assert beam.copies * mesh.groups[3, "solid"].measure == pytest.approx(beam.solid_volume, rel=1e-12)
    assert np.abs(mesh.at(2, "support")[:, 0]).max() < 1e-12
    assert mesh.at(2, "tip")[:, 0] == pytest.approx(beam.length) and mesh.at(2, "top")[:, 2] == pytest.approx(0.0025)
    for plane in beam.cut_planes:
        assert np.abs(mesh.at(2, plane.name) @ plane.normal).max() < 1e-12
    for place in beam.probes.values():
        assert np.linalg.norm(mesh.points[1:] - place, axis=1).min() < 1e-12
    assert from_table(to_table(beam)) == beam


WRONG = {
    "length is 0": {"length": 0.0},
    "length is 60 m": {"length": 60.0},
    "length is nan": {"length": math.nan},
    "width is -10 mm": {"width": -0.010},
    "width is 2 m; more than 20 times length, 60 mm": {"width": 2.0},
    "thickness is 1 um": {"thickness": 1e-6},
    "thickness is 1.5 m; more than 20 times length, 60 mm": {"thickness": 1.5},
    "cell_size is 8 mm; it must be at most thickness, 5 mm": {"cell_size": 0.008},
    "cell_size is 20 mm; it must be at most width, 10 mm": {"cell_size": 0.020, "thickness": 0.030},
    "cell_size is 0.02 mm; about 9.4e[+]07 cells are expected": {"cell_size": 2e-5, "length": 0.010, "width": 0.005},
    "clamp is 'glued'": {"clamp": "glued"},
    "part is 'third'": {"part": "third"},
    "clamp = slip leaves a whole beam free to slide": {"clamp": "slip", "part": "full"},
}


@pytest.mark.parametrize(("words", "changes"), WRONG.items(), ids=WRONG)
def test_what_cannot_be_is_refused_by_name(words, changes):
    with pytest.raises(GeometryError, match=words):
        Beam(**changes)


# -- Clamped membranes: roles where they belong, volumes as in closed form, and what is refused ----------------------


RINGS = (0.011, 0.013, 0.015, 0.017)
SECTIONS = {
    "default": Membrane(),
    "thin, in a clamp": Membrane(thickness=0.1e-3, clamp_width=0.003),
    "plate and rings as faces": Membrane(plate_radius=0.008, rings=RINGS, clamp_width=0.002, clamp="slip"),
    "plate and rings of their own": Membrane(plate_radius=0.008, plate_thickness=0.002, rings=RINGS, ring_thickness=0.001),
}


@pytest.mark.parametrize("membrane", SECTIONS.values(), ids=SECTIONS)
def test_a_section_has_its_roles_and_volumes(membrane, meshed):
    mesh = meshed(membrane)
    parts = [name for name in ("plate", "ring1", "ring2") if name in membrane.faces]
    solids = ["solid", *(parts if membrane.plate_thickness else [])]
    faces = ["cavity", "clamp", "axis", *membrane.faces, *(["rim"] if membrane.clamp_width else [])]
    assert set(mesh.groups) == {(2, name) for name in solids} | {(1, name) for name in faces}
    turned = {name: mesh.groups[2, name].turned for name in solids}
    assert sum(turned.values()) == pytest.approx(membrane.solid_volume, rel=1e-10)
    edge = membrane.radius + membrane.clamp_width
    off = math.pi * membrane.slope**2 * (membrane.radius - membrane.slope / 3)
    assert turned["solid"] == pytest.approx(math.pi * edge**2 * membrane.thickness - off, rel=1e-10)
    lines = np.concatenate([mesh.groups[1, name].corners for name in faces])
    assert len(np.unique(np.sort(lines, axis=1), axis=0)) == len(lines)
    lower, clamp = mesh.at(1, "cavity"), mesh.at(1, "clamp")
    assert np.abs(lower[:, 1]).max() == 0.0 and lower[:, 0].max() == pytest.approx(membrane.radius)
    assert clamp[:, 0].min() == pytest.approx(membrane.radius)
    assert from_table(to_table(membrane)) == membrane


def test_a_plate_of_its_own_is_bonded_where_it_lies(meshed):
    membrane = SECTIONS["plate and rings of their own"]
    mesh = meshed(membrane)
    plate, solid = mesh.groups[2, "plate"], mesh.groups[2, "solid"]
    shared = mesh.points[np.intersect1d(plate.nodes, solid.nodes)]
    assert shared[:, 1] == pytest.approx(membrane.thickness) and shared[:, 0].max() == pytest.approx(0.008)
    assert plate.turned == pytest.approx(math.pi * 0.008**2 * 0.002, rel=1e-10)
    assert mesh.at(1, "plate")[:, 1].max() == pytest.approx(membrane.probes["apex"][2])
    outside = mesh.points[np.unique(np.concatenate([group.nodes for group in mesh.groups.values()]))]
    seen = membrane.device_points(outside)
    seen = seen[membrane.on_profile(seen)]
    order = seen[np.argsort(membrane.along_profile(seen))]
    steps = np.linalg.norm(np.diff(order, axis=0), axis=1)
    assert steps.max() < membrane.cell_size and order[0, 0] == pytest.approx(0.0, abs=1e-12)


def test_the_held_edge_slopes_off_where_there_is_a_plate(meshed):
    """By a third of the thickness unless told otherwise, and not without a plate or in the clamp of a ring."""
    plated = Membrane(plate_radius=0.008)
    clamp = meshed(plated).at(1, "clamp")
    assert clamp[:, 0] == pytest.approx(plated.radius) and clamp[:, 1].max() == pytest.approx(plated.thickness * 2 / 3)
    sharp = Membrane(plate_radius=0.008, clamp_rounding=0.0)
    assert meshed(sharp).at(1, "clamp")[:, 1].max() == pytest.approx(sharp.thickness)
    assert sharp.slope == Membrane().slope == Membrane(plate_radius=0.008, clamp_width=0.002).slope == 0.0
    assert from_table(to_table(sharp)) == sharp and Membrane(clamp_rounding=1e-4).slope == 1e-4


def test_a_wedge_has_its_roles_and_volumes(meshed):
    membrane = Membrane(
        section="wedge",
        clamp_width=0.003,
        thickness=0.004,
        plate_radius=0.008,
        plate_thickness=0.003,
        cell_size=0.002,
        through=1,
    )
    mesh = meshed(membrane)
    faces = {"cavity", "clamp", "rim", "plane0", "plane1", *membrane.faces}
    assert set(mesh.groups) == {(3, "solid"), (3, "plate")} | {(2, name) for name in faces}
    found = membrane.copies * sum(mesh.groups[3, name].measure for name in ("solid", "plate"))
    assert found == pytest.approx(membrane.solid_volume, rel=2e-3)
    for plane in membrane.cut_planes:
        assert np.abs(mesh.at(2, plane.name) @ plane.normal).max() < 1e-9


WRONG_MEMBRANES = {
    "radius is 0": {"radius": 0.0},
    "thickness is 30 mm": {"thickness": 0.03},
    "thickness is 0.01 mm": {"thickness": 1e-5},
    "thickness is nan": {"thickness": math.nan},
    "clamp_width is 9.99 m": {"clamp_width": 9.99},
    "clamp is 'slip'": {"clamp": "slip", "clamp_width": 0.0},
    "clamp is 'glued'": {"clamp": "glued"},
    "plate_radius is 20 mm": {"plate_radius": 0.02},
    "plate_thickness is 2 mm; it needs plate_radius": {"plate_thickness": 0.002},
    "ring_thickness is 1 mm; it needs rings": {"ring_thickness": 0.001},
    "rings has 3 entries": {"rings": (0.01, 0.012, 0.014)},
    r"rings\[3\] is 11 mm; it must be larger than rings\[2\], 12 mm": {"rings": (0.01, 0.012, 0.011, 0.014)},
    r"rings\[1\] is 7 mm; it must be larger than plate_radius": {"plate_radius": 0.008, "rings": (0.007, 0.01)},
    r"rings\[2\] is 21 mm; it must be smaller than radius": {"rings": (0.01, 0.021)},
    "clamp_rounding is 1 mm; it must be at most 0.8 of thickness": {"clamp_rounding": 1e-3},
    "clamp_rounding is 0.2 mm; it is of a held edge": {"clamp_rounding": 2e-4, "clamp_width": 1e-3},
    "chamber_depth is 5 m": {"chamber_depth": 5.0},
    "cell_size is 25 mm": {"cell_size": 0.025},
    "through is 1.5": {"through": 1.5},
    "angle is 7 deg": {"section": "wedge", "angle": 7.0},
    "angle is 0 deg; it must be": {"section": "wedge", "clamp": "slip", "clamp_width": 1e-3, "angle": 0.0},
    "cells are expected": {"section": "wedge", "thickness": 0.1e-3, "angle": 360.0},
}


@pytest.mark.parametrize(("words", "changes"), WRONG_MEMBRANES.items(), ids=WRONG_MEMBRANES)
def test_wrong_membranes_are_refused_by_name(words, changes):
    with pytest.raises(GeometryError, match=words):
        Membrane(**changes)
