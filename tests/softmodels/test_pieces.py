"""Pieces of faces, edges and several faces at once, wherever a component names a face."""

from __future__ import annotations

import numpy as np
import pytest

import softmodels as sm
from softmodels.case.load import steps_of
from softmodels.runs.state_values import displacement_maps
from tests.support.campaigns import sampled

LAW = sm.NeoHookean(28e3, 0.49)
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


@pytest.mark.parametrize("kind", sampled(WHOLE))
def test_a_face_in_two_pieces_is_the_face(kind):
    whole, both, one = (
        sm.Model(DISK, LAW, WHOLE[kind](*faces)).solve(pressure="10 cm").rises["apex"]
        for faces in (("top",), (INNER, OUTER), (OUTER,))
    )
    assert both == pytest.approx(whole, rel=1e-9)
    assert abs(one - whole) > 1e-3 * abs(whole)


@pytest.mark.parametrize(
    ("face", "centre"),
    sampled([
        ("tip", (40, 2.5, 0)),
        ("edge of tip and top", (40, 2.5, 2.5)),
        ("edge of tip and top within y < 2.5 mm", (40, 1.25, 2.5)),
        ("edge of top and side", (20, 5, 2.5)),
        ("top within x > 20 mm", (30, 2.5, 2.5)),
        ("top within 10 mm < x < 20 mm, top within 30 mm < x", (25, 2.5, 2.5)),
    ], 2),
)  # fmt: skip
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
        ("edge of top and top", "names one face twice; an edge is where two faces meet"),
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
        sm.export(
            sm.Case("disk", wedge, LAW, steps=steps_of(pressure_cm=(5.0,)), components=sm.Clamp(INNER)),
            tmp_path / "disk.inp",
        )


@pytest.mark.campaign
def test_a_ring_within_the_layer_of_a_membrane():
    """With rings of no thickness the cells end at their radii, so that the region is the whole ring of the layer."""
    membrane = sm.Membrane(rings=(0.008, 0.010))
    ring = sm.Region(sm.NeoHookean(3e6, 0.45), within="8 mm < r < 10 mm", name="stiff")
    model = sm.Model(membrane, LAW, [ring])
    region = next(one for one in model.system.potential.regions if one.name == "stiff")
    volume = model.system.point_volumes()[region.cells].sum() * membrane.size**3
    assert volume == pytest.approx(np.pi * (0.010**2 - 0.008**2) * membrane.thickness, rel=1e-6)
    apex = [sm.Model(membrane, LAW, parts).solve(pressure="3 cm").rises["apex"] for parts in ((), [ring])]
    assert 0 < apex[1] < 0.97 * apex[0]
    case = sm.Case("m", membrane, LAW, steps=steps_of(pressure_cm=(3.0,)), components=[ring])
    assert sm.Case.from_toml(case.to_toml()) == case and 'within = "8 mm < r < 10 mm"' in case.to_toml()
    for within, sentence in {
        "r > 90 mm": r"\[region.stiff\]: within = 'r > 90 mm' selects no cells",
        "r > 9": "has no unit",
        "x > 9 mm": "has r and z",
    }.items():
        with pytest.raises((sm.CaseError, sm.ComponentError), match=sentence):
            sm.inflate(membrane, LAW, pressures="3 cm", components=sm.Region(LAW, within=within, name="stiff"))


def test_regions_that_share_cells_are_refused():
    """Whatever their order; those that meet between cells are not."""
    membrane = sm.Membrane(rings=(0.008, 0.010))
    inner, outer = (
        sm.Region(sm.NeoHookean(modulus, 0.45), within=within, name=name)
        for modulus, within, name in ((3e6, "r < 10 mm", "inner"), (3e5, "r > 8 mm", "outer"))
    )
    for one, two in ((inner, outer), (outer, inner)):
        shared = rf"\[region.{two.name}\]: \d+ of its \d+ cells are also among the \d+ of \[region.{one.name}\]"
        with pytest.raises(sm.ComponentError, match=shared):
            sm.Model(membrane, LAW, [one, two])
    beside = sm.Region(outer.material, within="10 mm < r < 12 mm", name="outer")
    heights = [sm.Model(membrane, LAW, list(parts)).solve(pressure="3 cm").rises["apex"]
               for parts in ((inner, beside), (beside, inner))]  # fmt: skip
    assert heights[0] == pytest.approx(heights[1], rel=1e-9)


@pytest.mark.campaign
def test_named_faces_of_a_part_that_overlap(step_file, tmp_path):
    """A force on a face acts on all of it, whatever other names its pieces have; so does what holds the part."""
    file = step_file(tmp_path / "bar.step", lambda occ: occ.fragment(
        [(3, occ.addBox(0, -5, -2.5, 20, 10, 5))], [(3, occ.addBox(20, -5, -2.5, 20, 10, 5))]))  # fmt: skip
    rises = []
    for names in (("roof = z = 2.5 mm",), ("half = in 19..41, -6..6, 2..3 mm", "roof = z = 2.5 mm", "root = x = 0 mm")):
        bar = sm.ImportedActuator(file=file, cavities=("none",), support="x = 0 mm", surfaces=names, cell_size=0.005)
        rises.append(sm.Model(bar, LAW, sm.Force("roof", "-z", 0.005)).solve().rises["tip"])
    assert rises[1] == pytest.approx(rises[0], rel=1e-9)


@pytest.mark.campaign
def test_a_part_without_air(step_file, tmp_path):
    """A bar from a STEP file bends as the library's beam does; its faces have names of the user's."""
    file = step_file(tmp_path / "bar.step", lambda occ: occ.addBox(0, -5, -2.5, 40, 10, 5))
    bar = sm.ImportedActuator(
        file=file, cavities=("none",), support="x = 0 mm", surfaces=("tip = x = 40 mm", "roof = z = 2.5 mm"),
        cell_size=BEAM.cell_size,
    )  # fmt: skip
    assert bar.ratios == () and bar.faces == ("tip", "roof")
    force = sm.Force("tip", "-z", 0.005)
    rises = [sm.Model(device, LAW, force).system.dead for device in (bar, BEAM)]
    assert [one.amounts[0] for one in rises] == [0.005, 0.005]
    tips = [sm.Model(device, LAW, force).solve().rises["tip"] for device in (bar, BEAM)]
    assert tips[0] == pytest.approx(tips[1], rel=0.05)  # one corner of the tip, on two meshes
    for face in ("outer", "outer within y > 0 mm", "edge of tip and roof", "roof, outer"):
        assert sm.Model(bar, LAW, [sm.Sheet(face, 100.0)] if "edge" not in face else [sm.Clamp(face)]).solve().pressure == 0.0
    for surfaces, sentence in {
        ("tip",): "write a name and its faces",
        ("outer = x = 40 mm",): "the name 'outer' is taken",
        ("tip = x = 41 mm",): "no such face",
    }.items():
        with pytest.raises(sm.GeometryError, match=sentence):
            sm.ImportedActuator(file=file, cavities=("none",), support="x = 0 mm", surfaces=surfaces)
    with pytest.raises(sm.CaseError, match="has no cavity for a pressure"):
        sm.inflate(bar, LAW, pressures="1 cm", components=force)
