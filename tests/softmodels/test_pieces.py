"""Pieces of faces, edges and several faces at once, wherever a component names a face."""

from __future__ import annotations

import numpy as np
import pytest

import softmodels as sm
from softmodels.runs.grid import displacement_maps

LAW = sm.NeoHookean(28e3)
DISK = sm.HollowDisk(section="axisymmetric", cell_size=0.005, refinement=1.0)
INNER, OUTER = "top within r < 8 mm", "top within 8 mm < r"
PLANE = ("plane", ("0 mm", "0 mm", "16.1 mm"))
BEAM = sm.Beam(length="40 mm")
WHOLE = {
    "sheet": lambda *faces: (sm.Sheet(", ".join(faces), 800.0),),
    "clamp": lambda *faces: (sm.Clamp(", ".join(faces), along="x"),),
    "plate": lambda *faces: (sm.Rigid(", ".join(faces)),),
    "shape": lambda *faces: (sm.RigidShape("plane", ", ".join(faces), PLANE[1], along=(0.0, 0.0, -1.0)),),
    "mass": lambda *faces: (sm.Gravity("-z"), sm.Mass(", ".join(faces), 0.05)),
}


@pytest.mark.parametrize("kind", WHOLE)
def test_a_face_in_two_pieces_is_the_face(kind):
    whole, both, one = (
        sm.Model(DISK, LAW, WHOLE[kind](*faces)).solve(pressure="10 cm").rises["apex"]
        for faces in (("top",), (INNER, OUTER), (OUTER,))
    )
    assert both == pytest.approx(whole, rel=1e-9)
    assert abs(one - whole) > 1e-3 * abs(whole)


@pytest.mark.parametrize(
    ("face", "centre"),
    [
        ("tip", (40, 2.5, 0)),
        ("edge of tip and top", (40, 2.5, 2.5)),
        ("edge of tip and top within y < 2.5 mm", (40, 1.25, 2.5)),
        ("edge of top and side", (20, 5, 2.5)),
        ("top within x > 20 mm", (30, 2.5, 2.5)),
        ("top within 10 mm < x < 20 mm, top within 30 mm < x", (25, 2.5, 2.5)),
    ],
)
def test_the_centre_of_what_is_loaded(face, centre):
    """Cells are 2.5 mm long, so that pieces end where their bounds are."""
    model = sm.Model(BEAM, LAW, sm.Force(face, "-z", 0.02))
    [form] = model.system.dead.forms[0]
    forces = model.system.assemble([form], held=True)
    nodes = displacement_maps(model.system, model.fields.grid)[0]
    vectors = forces[nodes] @ model.body.skew
    places = model.fields.grid.space.tabulate_dof_coordinates() * BEAM.size * 1e3
    assert vectors.sum(axis=0) == pytest.approx([0.0, 0.0, -1.0], abs=1e-12)
    assert -vectors[:, 2] @ places == pytest.approx(centre, abs=1e-6)


def test_forces_per_area_and_per_length():
    area, length = BEAM.width * BEAM.thickness, BEAM.width
    for load, amount in ((sm.Force("tip", "-z", traction=400.0), 400 * area),
                         (sm.Force("edge of tip and top", "-z", line_load=2.0), 2 * length)):  # fmt: skip
        dead = sm.Model(BEAM, LAW, load).system.dead
        assert dead.amounts == pytest.approx([amount], rel=1e-9)
    circle = sm.Model(DISK, LAW, sm.Force("edge of top and outer", "-z", line_load=2.0)).system.dead
    assert circle.amounts == pytest.approx([2 * 2 * np.pi * DISK.outer_radius], rel=1e-9)


@pytest.mark.parametrize(
    ("face", "sentence"),
    [
        ("top within r < 4", "the length 4 has no unit; write it like 4 mm"),
        ("top within r < 4 apples", "unknown unit, 'apples'"),
        ("top within phi < 4 mm", "uses the coordinate 'phi'; x, y, z, r,"),
        ("top within y < 4 mm", "an axisymmetric section has r and z"),
        ("top within r", "'r' is not a comparison"),
        ("top within", "has no condition"),
        ("top within __import__('os').system('ls')", "is not a comparison"),
        ("rim within r < 4 mm", "no face 'rim'; it has top, cavity"),
        ("top within 40 mm < r", "selects nothing; the middles of the facets of top lie in x"),
        ("edge of top and cavity", "share no edge in the modelled part"),
        ("top, edge of top and outer", "has faces and edges"),
    ],
)
def test_a_piece_that_cannot_be_meant_is_refused(face, sentence):
    with pytest.raises((sm.CaseError, sm.ComponentError), match=r"^") as error:
        sm.inflate(DISK, LAW, pressures="1 cm", components=sm.Force(face, "-z", 0.1))
    assert sentence in str(error.value)


def test_amounts_that_do_not_fit_are_refused(ended, tmp_path):
    for load, sentence in (
        ({"traction": 10.0, "amount": 1.0}, "more than one of amount, traction and line_load"),
        ({"line_load": 10.0}, "line_load needs an edge"),
        ({"traction": -1.0}, "traction is -1; it must be above zero"),
    ):
        with pytest.raises((sm.CaseError, sm.ComponentError), match=sentence):
            sm.inflate(DISK, LAW, pressures="1 cm", components=sm.Force("top", "-z", **load))
    wedge = sm.HollowDisk(cell_size=0.008, refinement=1.0)
    with pytest.raises(sm.CaseError, match=r"\[hold\] on a piece of a face, which decks do not support"):
        sm.export(sm.Case("disk", wedge, LAW, pressures_cm=(5.0,), components=sm.Clamp(INNER)), tmp_path / "disk.inp")
