"""Clamped membranes: roles where they belong, volumes as in closed form, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

from geometries import GeometryError, Membrane
from geometries.registry import from_table, to_table

RINGS = (0.011, 0.013, 0.015, 0.017)
SECTIONS = {
    "default": Membrane(),
    "thin, in a clamp": Membrane(thickness=0.1e-3, clamp_width=0.003),
    "plate and rings as faces": Membrane(plate_radius=0.008, rings=RINGS, clamp_width=0.002, clamp="slip"),
    "plate and rings of their own": Membrane(
        plate_radius=0.008, plate_thickness=0.002, rings=RINGS, ring_thickness=0.001
    ),
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


WRONG = {
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
    "cells are expected": {"section": "wedge", "thickness": 0.1e-3, "angle": 360.0},
}


@pytest.mark.parametrize(("words", "changes"), WRONG.items(), ids=WRONG)
def test_what_cannot_be_is_refused_by_name(words, changes):
    with pytest.raises(GeometryError, match=words):
        Membrane(**changes)
