"""Beams: roles where they belong, volumes as in closed form, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

from geometries import Beam, GeometryError
from geometries.registry import from_table, to_table

COARSE = {"length": 0.020, "cell_size": 0.005}
OPEN = {"quarter": ("plane0", "plane1"), "half": ("plane0", "bottom"), "full": ("bottom",)}
"""Faces by the part that is modelled, beyond those that all have."""


@pytest.mark.parametrize("part", OPEN)
def test_it_has_its_roles_and_volumes(part, meshed):
    beam = Beam(part=part, **COARSE)
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
