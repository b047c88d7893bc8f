"""Parts from STEP files that Gmsh's own kernel wrote."""

from __future__ import annotations

import math
import re
from pathlib import Path

import gmsh
import numpy as np
import pytest

from geometries import GeometryError, ImportedActuator, imported
from geometries.imported import region_name
from geometries.meshing import private_model, summarize
from geometries.registry import from_table, to_table

CAVITIES = ("at 10, 0, 3 mm", "at 20, 0, 6 mm")
CHOICES = {"cavities": CAVITIES, "support": "x = 0 mm", "planes": ("y = 0 mm",), "cell_size": 0.004}
ROUND, FLAT = math.pi * 2e-3**2 * 8e-3, 8e-3 * 8e-3 * 2e-3
"""Volumes of the whole part's two cavities in m3: a round hole and a flat one."""


def block(unit, scale=None):
    """Half a block of 30 x 20 x 10 mm at y > 0 with a round and a flat cavity, both cut by y = 0, to be drawn in a unit, or at
    a scale of its numbers in mm."""
    scale = scale or {"MM": 1.0, "M": 1e-3, "INCH": 1 / 25.4}[unit]

    def draw(occ):
        whole = occ.addBox(0, 0, 0, 30 * scale, 20 * scale, 10 * scale)
        hole = occ.addCylinder(5 * scale, 0, 3 * scale, 8 * scale, 0, 0, 2 * scale)
        flat = occ.addBox(18 * scale, -4 * scale, 5 * scale, 8 * scale, 8 * scale, 2 * scale)
        occ.cut([(3, whole)], [(3, hole), (3, flat)])

    return draw


@pytest.fixture(scope="module")
def step(step_file, tmp_path_factory):
    return step_file(tmp_path_factory.mktemp("part") / "part.step", block("MM"))


def test_volumes_and_roles(step, tmp_path):
    part = ImportedActuator(file=step, **CHOICES)
    assert part.copies == 2 and part.ratios == (1.0, 1.0)
    assert part.cavity_volume == pytest.approx(ROUND + FLAT, rel=1e-4)
    assert part.solid_volume == pytest.approx(30e-3 * 40e-3 * 10e-3 - ROUND - FLAT, rel=1e-9)
    assert part.cut_planes[0].normal == (0.0, -1.0, 0.0)
    mesh = part.write(tmp_path / "part.msh")
    found = summarize(mesh)
    assert found.quality > 0 and found.measure * part.copies == pytest.approx(part.solid_volume, rel=1e-4)
    with private_model():
        gmsh.merge(str(mesh))
        names = {gmsh.model.getPhysicalName(*group): group for group in gmsh.model.getPhysicalGroups()}
        assert set(names) == {"solid", "cavity", "cavity2", "support", "plane0", "outer"}
        nodes = {name: gmsh.model.mesh.getNodesForPhysicalGroup(*group)[1].reshape(-1, 3) for name, group in names.items()}
    assert np.abs(nodes["support"][:, 0]).max() < 1e-9 and np.abs(nodes["plane0"][:, 1]).max() < 1e-9
    assert nodes["cavity"][:, 0].max() < 0.014 < 0.017 < nodes["cavity2"][:, 0].min()
    assert np.linalg.norm(nodes["solid"] - part.probes["tip"], axis=1).min() < 1e-9


def test_ratios_weigh_the_volumes(step):
    part = ImportedActuator(file=step, pressure_ratios=(1.0, 0.5), **CHOICES)
    assert part.cavity_volume == pytest.approx(ROUND + 0.5 * FLAT, rel=1e-4)


@pytest.mark.parametrize("unit", ["M", "INCH"])
def test_the_files_unit_counts(unit, step, step_file, tmp_path):
    file = step_file(tmp_path / "part.step", block(unit), unit)
    millimetres, other = (ImportedActuator(file=one, **CHOICES) for one in (step, file))
    assert other.solid_volume == pytest.approx(millimetres.solid_volume, rel=1e-9)


MILLIMETRES = re.compile(r"(#\d+) = \( LENGTH_UNIT\(\) NAMED_UNIT\(\*\) SI_UNIT\(\.MILLI\.,\.METRE\.\) \);")


@pytest.mark.parametrize(
    ("prefix", "factor", "scale", "name"),
    [
        ("$", "0.025399999999999998970", 1 / 25.4, "INCH"),  # as SolidWorks writes it
        (".MILLI.", "25.4", 1 / 25.4, "inch"),
        ("$", "0.3048", 1 / 304.8, "FOOT"),
        (".CENTI.", "", 0.1, "CENTIMETRE"),
        ("$", "", 1e-3, "METRE"),
    ],
)
def test_units_as_cad_programs_write_them(prefix, factor, scale, name, step, step_file, tmp_path):
    file = tmp_path / "part.step"
    step_file(file, block("MM", scale))
    based = f"#9001 =( LENGTH_UNIT ( ) NAMED_UNIT ( * ) SI_UNIT ( {prefix}, .METRE. ) );\n"
    if factor:
        based += f"#9002 = LENGTH_MEASURE_WITH_UNIT ( LENGTH_MEASURE( {factor} ), #9001 );\n"
        based += "#9003 = DIMENSIONAL_EXPONENTS(1.,0.,0.,0.,0.,0.,0.);\n"
        based += rf"\1 =( CONVERSION_BASED_UNIT ( '{name}', #9002 ) LENGTH_UNIT ( ) NAMED_UNIT ( #9003 ) );"
    else:
        based = based.replace("#9001", r"\1")
    text, count = MILLIMETRES.subn(based, file.read_text())
    file.write_text(text)
    millimetres, other = (ImportedActuator(file=str(path), **CHOICES) for path in (step, file))
    assert count == 1 and millimetres.remarks == ()
    assert other.solid_volume == pytest.approx(millimetres.solid_volume, rel=1e-9)
    assert other.cavity_volume == pytest.approx(millimetres.cavity_volume, rel=1e-6)
    assert other.probes["tip"] == pytest.approx(millimetres.probes["tip"], rel=1e-9)
    assert other.remarks == (f"the unit of length of {file} is {name.lower()}, as the file states",)


@pytest.mark.parametrize(
    ("unit", "words"),
    [
        ("unassigned", "states no unit of its lengths; export it again"),
        ("", "states no unit of its lengths; export it again"),
        ("nothing", "has no shape: its DATA section is empty; export the part again"),
        ("$", r"spans 37\.\d+ m, because its unit of length is metre; .* export it again"),
        (".MICRO.", r"spans 0\.0377\d+ mm, because its unit of length is micrometre; .* export it again"),
    ],
)
def test_a_unit_that_is_missing_or_wrong(unit, words, step, tmp_path):
    text = Path(step).read_text()
    if unit == "nothing":
        text = re.sub(r"DATA;.*ENDSEC;", "DATA;\nENDSEC;", text, flags=re.DOTALL)
    elif unit == "unassigned":
        text = re.sub(r"GLOBAL_UNIT_ASSIGNED_CONTEXT\s*\(\([^)]*\)\)", "", text)
    elif unit:
        text = text.replace("SI_UNIT(.MILLI.,.METRE.)", f"SI_UNIT({unit},.METRE.)")
    else:
        text = MILLIMETRES.sub(r"\1 = ( NAMED_UNIT(*) SI_UNIT($,.SECOND.) TIME_UNIT() );", text)
    (tmp_path / "part.step").write_text(text)
    with pytest.raises(GeometryError, match=words):
        ImportedActuator(file=str(tmp_path / "part.step"), **CHOICES)


def test_table_gives_the_same_part_back(step):
    part = ImportedActuator(file=step, pressure_ratios=(1.0, 0.5), gauge_point="at 30, 0, 10 mm", **CHOICES)
    assert from_table(to_table(part)) == part


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"file": "missing.step"}, "cannot be read"),
        ({"cavities": ()}, "2 closed inner shells, with air at 9, 1, 3 mm; at 22, 2, 6 mm"),
        ({"cavities": (), "planes": ()}, "no closed inner shell"),
        ({"cavities": ("at 10, 0, 3",)}, "write a point as"),
        ({"cavities": ("at 2, 2, 2 mm",)}, "lies in the solid"),
        ({"cavities": ("at 100, 2, 2 mm",)}, "outside the part"),
        ({"cavities": ("at 10, 0, 3 mm", "at 11, 0, 3 mm")}, "already selected"),
        ({"support": "x = 1 mm"}, "no such face"),
        ({"support": "left"}, "write 'x = 0 mm'"),
        ({"support": "in 3..1, 0..1, 0..1 mm"}, "lower end"),
        ({"planes": ("y = 1 mm",)}, "no such face"),
        ({"planes": ("y = 20 mm",)}, "through the origin: move the part by 0, -20, 0 mm"),
        ({"planes": ("in 0..30, 0..20, 0..10 mm",)}, "do not lie in one plane"),
        ({"planes": ("normal 0, 0, 0",)}, "must not have zero length"),
        ({"planes": ("y = 0 mm", "normal 0, -3, 0")}, "no such face"),  # the same plane again
        ({"planes": ()}, "outside the part"),  # the cavities are open at y = 0 then
        ({"pressure_ratios": (1.0,)}, "1 values for 2 cavities"),
        ({"pressure_ratios": (0.0, 0.0)}, "all 0"),
        ({"gauge_point": "at 15, 0, 10 mm"}, "must be a corner"),
    ],
)
def test_impossible_choices_are_refused(changes, words, step):
    with pytest.raises(GeometryError, match=words):
        ImportedActuator(**{"file": step, **CHOICES, **changes})


@pytest.mark.parametrize("planes", [(), ("y = 0 mm",)])
def test_the_only_inner_shell_is_the_cavity(step_file, tmp_path, planes):
    """Of a whole part, and of one that is cut through its cavity."""

    def draw(occ):
        half = 0 if planes else -5
        block, hole = occ.addBox(0, half, -5, 20, 5 - half, 10), occ.addBox(6, -3, -2, 10, 6, 3)
        occ.cut([(3, block)], [(3, hole)])

    file = step_file(tmp_path / "part.step", draw)
    found = ImportedActuator(file=file, support="x = 0 mm", planes=planes, cell_size=0.004)
    named = ImportedActuator(file=file, support="x = 0 mm", planes=planes, cell_size=0.004, cavities=("at 8, 0, -1 mm",))
    assert found.cavity_volume == pytest.approx(10e-3 * 6e-3 * 3e-3, rel=1e-9)
    assert found.reading == named.reading and found.ratios == (1.0,)
    with pytest.raises(GeometryError, match="2 values for 1 cavity"):
        ImportedActuator(file=file, support="x = 0 mm", planes=planes, pressure_ratios=(1.0, 1.0))


def test_no_step_file(tmp_path):
    file = tmp_path / "part.step"
    file.write_text("solid nonsense")
    with pytest.raises(GeometryError, match="cannot be read as STEP"):
        ImportedActuator(file=str(file), **CHOICES)


def test_faces_in_a_box(step):
    by_plane = ImportedActuator(file=step, **CHOICES)
    by_box = ImportedActuator(file=step, **{**CHOICES, "support": "in 0..0.1, 0..21, -1..11 mm"})
    assert by_box.reading == by_plane.reading


# -- STEP files with several solids: glued, named, and refused where they make no part -------------------------------


LENGTH, WIDTH, BASE, TOP, WALL = 30.0, 12.0, 3.0, 9.0, 2.0  # mm


def write_step(path, base=(0.0, 0.0), names=("Base plate", "Chamber"), lift=0.0):
    """A block with a cavity that is open below, and a plate under it that closes it and may be wider."""
    import gmsh

    with private_model():
        occ = gmsh.model.occ
        occ.addBox(-base[0], -base[1], 0, LENGTH + 2 * base[0], WIDTH + 2 * base[1], BASE)
        block = occ.addBox(0, 0, BASE + lift, LENGTH, WIDTH, TOP)
        air = occ.addBox(WALL, WALL, BASE + lift, LENGTH - 2 * WALL, WIDTH - 2 * WALL, TOP - WALL)
        occ.cut([(3, block)], [(3, air)])
        occ.synchronize()
        gmsh.option.setString("Geometry.OCCTargetUnit", "MM")  # else it is what was written last in this process
        gmsh.write(str(path))
        gmsh.option.setString("Geometry.OCCTargetUnit", "")
    text = path.read_text()
    for name in names:
        text = re.sub(r"MANIFOLD_SOLID_BREP\(''", f"MANIFOLD_SOLID_BREP('{name}'", text, count=1)
    path.write_text(text)
    return path


def part(path, **changes):
    fields = {"cavities": (f"at {LENGTH / 2}, {WIDTH / 2}, {BASE + 2} mm",), "support": "x = 0 mm", "cell_size": 0.004}
    return ImportedActuator(file=str(path), **{**fields, **changes})


def test_two_solids_are_glued(tmp_path):
    """A plate wider than the block: its upper face is partly an interface, partly the cavity's floor, partly outside."""
    device = part(write_step(tmp_path / "two.step", base=(0.0, 4.0)), surfaces=("foot = z = 0 mm",))
    assert device.regions == ("base_plate", "chamber")
    air = (LENGTH - 2 * WALL) * (WIDTH - 2 * WALL) * (TOP - WALL) * 1e-9
    solids = {"base_plate": LENGTH * (WIDTH + 8.0) * BASE * 1e-9, "chamber": LENGTH * WIDTH * TOP * 1e-9 - air}
    assert device.cavity_volume == pytest.approx(air, rel=1e-9)
    assert device.solid_volume == pytest.approx(sum(solids.values()), rel=1e-9)
    found = groups(device.write(tmp_path / "two.msh"))
    for name, volume in solids.items():
        assert found[3, name] == pytest.approx(volume, rel=1e-9)
    walls = 2 * (LENGTH - 2 * WALL + WIDTH - 2 * WALL) * (TOP - WALL) + 2 * (LENGTH - 2 * WALL) * (WIDTH - 2 * WALL)
    assert found[2, "cavity"] == pytest.approx(walls * 1e-6, rel=1e-9)
    assert found[2, "support"] == pytest.approx((WIDTH * TOP + (WIDTH + 8.0) * BASE) * 1e-6, rel=1e-9)
    assert found[2, "foot"] == pytest.approx(LENGTH * (WIDTH + 8.0) * 1e-6, rel=1e-9)


def groups(path):
    """Volumes and areas of the physical groups of a mesh."""
    import gmsh

    with private_model():
        gmsh.merge(str(path))
        found = {}
        for dimension, group in gmsh.model.getPhysicalGroups():
            total = 0.0
            for tag in gmsh.model.getEntitiesForPhysicalGroup(dimension, group):
                for kind in gmsh.model.mesh.getElementTypes(dimension, tag):
                    local, weights = gmsh.model.mesh.getIntegrationPoints(kind, "Gauss4")
                    _, determinants, _ = gmsh.model.mesh.getJacobians(kind, local, tag)
                    total += float((np.reshape(np.abs(determinants), (-1, len(weights))) @ weights).sum())
            found[dimension, gmsh.model.getPhysicalName(dimension, group)] = total
        return found


def test_names(tmp_path):
    same = part(write_step(tmp_path / "same.step", names=("Silicone", "Silicone")))
    assert same.regions == ()  # one region of two solids
    assert part(write_step(tmp_path / "none.step", names=())).regions == ("solid_1", "solid_2")
    with pytest.raises(GeometryError, match=r"'Base' and 'base' both become the region base; .* rename one"):
        part(write_step(tmp_path / "alike.step", names=("Base", "base")))
    assert [region_name(text) for text in ("Ring (2)", "3M tape", "Öse", "%")] == [
        "ring_2",
        "region_3m_tape",
        "ose",
        "region",
    ]


def test_a_sliver_of_overlap_counts_to_the_first_solid(tmp_path):
    """The block stands 10 um in the plate, as rounded drawings do; its air loses as much, and neither is counted twice."""
    device = part(write_step(tmp_path / "sliver.step", lift=-0.01))
    air = (LENGTH - 2 * WALL) * (WIDTH - 2 * WALL) * (TOP - WALL - 0.01) * 1e-9
    assert device.cavity_volume == pytest.approx(air, rel=1e-6)
    assert device.solid_volume == pytest.approx(LENGTH * WIDTH * (BASE + TOP - 0.01) * 1e-9 - air, rel=1e-6)
    (remark,) = device.remarks
    assert re.search(r"base_plate and chamber overlap by \S+ mm3 at .* mm, which counts to base_plate", remark)


def test_solids_that_make_no_part(tmp_path):
    with pytest.raises(GeometryError, match="its cavity is open to the outside"):
        part(write_step(tmp_path / "apart.step", lift=1.0))
    with pytest.raises(GeometryError, match=r"solids base_plate and chamber overlap by \S+ mm3 at .* mm; cut one"):
        part(write_step(tmp_path / "into.step", lift=-1.0))
    with pytest.raises(GeometryError, match="a mould needs a part of a single solid"), private_model():
        part(tmp_path / "two.step" if (tmp_path / "two.step").exists() else write_step(tmp_path / "two.step")).build_whole()


def test_small_roundings_keep_to_a_budget_of_cells(step_file, tmp_path):
    """Narrow holes through a block take fewer cells around a circle than other parts have, as many as asked if asked, and fewer
    for volumes too."""

    def holes(occ):
        tools = [occ.addCylinder(2.0 + 2.0 * i, 2.0 + 2.0 * j, 0.0, 0.0, 0.0, 10.0, 0.3) for i in range(3) for j in range(2)]
        occ.cut([(3, occ.addBox(0.0, 0.0, 0.0, 20.0, 20.0, 10.0))], [(3, tool) for tool in tools])

    file = str(step_file(tmp_path / "holes.step", holes))
    size, asked = imported._usual_cells_of(file, 0.0, 10.0)
    assert asked == 10.0 and imported._usual_cells_of(file, 0.0, 0.0) == (size, 6.0)
    with private_model():
        imported.import_step(file, "M")
        faces = [face for _, face in gmsh.model.getEntities(2)]
        counts = imported.CELLS_PER_TRIANGLE * imported.expected_triangles(faces, size, imported.TRIED_CURVATURES)
        assert counts[1] > imported.MANY_CELLS > counts[2]
        assert imported.cells_around(faces, size, imported.CELLS_PER_CIRCLE, imported.MEASURED_TRIANGLES)[0] == 20.0
        # What is expected of the mesh is what it has, within a factor of two.
        gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 6.0)
        gmsh.option.setNumber("Mesh.MeshSizeMax", size)
        gmsh.model.mesh.generate(3)
        assert 0.5 < counts[2] / gmsh.model.mesh.getElementsByType(4)[0].size < 2.0
