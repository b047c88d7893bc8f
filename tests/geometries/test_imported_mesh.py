"""Parts meshed elsewhere: Gmsh's and Abaqus' meshes and STL surfaces of one part, against its drawing."""

from __future__ import annotations

import gmsh
import meshio
import numpy as np
import pytest

from geometries import GeometryError, ImportedActuator, ImportedMesh
from geometries.meshing import private_model, summarize
from geometries.registry import from_table, to_table
from tests.support.campaigns import sampled

CHOICES = {
    "cavities": ("at 10, 0, 3 mm", "at 20, 0, 6 mm"),
    "support": "x = 0 mm",
    "planes": ("y = 0 mm",),
    "gauge_point": "at 30, 0, 10 mm",
    "cell_size": 0.004,
}


def draw(occ):
    """Half a block with a round and a flat cavity, both cut by y = 0, in mm."""
    whole = occ.addBox(0, 0, 0, 30, 20, 10)
    hole = occ.addCylinder(5, 0, 3, 8, 0, 0, 2)
    flat = occ.addBox(18, -4, 5, 8, 8, 2)
    occ.cut([(3, whole)], [(3, hole), (3, flat)])


@pytest.fixture(scope="module")
def files(step_file, tmp_path_factory):
    """The part as a drawing, by three writers of meshes, and as surfaces."""
    folder = tmp_path_factory.mktemp("meshes")
    found = {"step": step_file(folder / "part.step", draw)}
    with private_model():
        draw(gmsh.model.occ)
        gmsh.model.occ.synchronize()
        gmsh.option.setNumber("Mesh.MeshSizeMax", 4)
        gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 24)
        gmsh.model.mesh.generate(2)
        gmsh.write(str(folder / "part.stl"))
        at_root = gmsh.model.getEntitiesInBoundingBox(-1, -1, -1, 0.1, 30, 30, 2)
        gmsh.model.addPhysicalGroup(2, [tag for _, tag in at_root], name="root")
        gmsh.model.addPhysicalGroup(3, [1], name="rubber")
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(2)
        gmsh.write(str(folder / "part.msh"))
        gmsh.option.setNumber("Mesh.MshFileVersion", 2.2)
        gmsh.write(str(folder / "old.msh"))
    mesh = meshio.read(folder / "part.msh", "gmsh")
    root = np.flatnonzero(mesh.points[:, 0] < 1e-9)
    cells = mesh.cells_dict["tetra10"]
    right = np.flatnonzero(mesh.points[cells].mean(axis=1)[:, 0] > 15)
    abaqus = meshio.Mesh(mesh.points, [("tetra10", cells)], point_sets={"ROOT": root}, cell_sets={"RIGHT": [right]})
    abaqus.write(folder / "part.inp")
    return found | {name: str(folder / name) for name in ("part.msh", "old.msh", "part.inp", "part.stl")}


def part(files, name, **changes):
    return ImportedMesh(**{"file": files[name], **CHOICES, **changes})


@pytest.mark.parametrize(
    ("name", "error"), sampled([("part.msh", 1e-4), ("old.msh", 1e-4), ("part.inp", 1e-4), ("part.stl", 0.006)], 3)
)
def test_volumes_and_roles(files, tmp_path, name, error):
    """The STL's round hole is a polygon of 24 sides: 1.1 % less of its third of the air."""
    drawn, found = ImportedActuator(file=files["step"], **CHOICES), part(files, name)
    assert found.cavity_volume == pytest.approx(drawn.cavity_volume, rel=error)
    assert found.solid_volume == pytest.approx(drawn.solid_volume, rel=error)
    assert found.cut_planes == drawn.cut_planes and found.copies == 2
    assert found.probes["tip"] == pytest.approx((0.03, 0.0, 0.01), abs=1e-8)
    mesh = found.write(tmp_path / "part.msh")
    made = summarize(mesh)
    assert made.quality > 0 and made.measure * 2 == pytest.approx(found.solid_volume, rel=1e-9)
    with private_model():
        gmsh.merge(str(mesh))
        groups = {gmsh.model.getPhysicalName(*group): group for group in gmsh.model.getPhysicalGroups(2)}
        assert set(groups) == {"cavity", "cavity2", "support", "plane0", "outer"}
        on_plane = gmsh.model.mesh.getNodesForPhysicalGroup(*groups["plane0"])[1].reshape(-1, 3)
    assert np.abs(on_plane[:, 1]).max() == 0.0


def test_faces_and_regions_by_the_files_names(files, tmp_path):
    by_place = part(files, "part.msh")
    for name, face in (("part.msh", "named root"), ("part.inp", "named ROOT")):
        by_name = part(files, name, support=face)
        meshes = [one.write(tmp_path / f"{i}.msh") for i, one in enumerate((by_place, by_name))]
        held = []
        for mesh in meshes:
            with private_model():
                gmsh.merge(str(mesh))
                groups = {gmsh.model.getPhysicalName(*group): group for group in gmsh.model.getPhysicalGroups()}
                held.append(len(gmsh.model.mesh.getNodesForPhysicalGroup(*groups["support"])[0]))
        assert held[0] == held[1] > 10
    assert groups["right"][0] == 3


def test_units_and_case_files(files):
    small = part(files, "part.msh")
    table = to_table(small)
    assert from_table(table) == small
    other = part(files, "part.msh", unit="cm", cavities=("at 100, 0, 30 mm", "at 200, 0, 60 mm"),
                 gauge_point="at 300, 0, 100 mm")  # fmt: skip
    assert other.cavity_volume == pytest.approx(1e3 * small.cavity_volume, rel=1e-9)


def write(path, text):
    path.write_text(text)
    return str(path)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"cavities": ()}, "2 closed inner shells, with air at 9, 1, 3 mm; at 22, 2, 6 mm"),
        ({"cavities": ("at 2, 0, 8 mm",)}, "lies in the solid"),
        ({"cavities": ("at 40, 0, 8 mm",)}, "outside the part, or its cavity is open"),
        ({"cavities": ("named lid",)}, "the names of faces in the file are root"),
        ({"cavities": ("coloured red",)}, "a mesh has no colours"),
        ({"support": "x = 3 mm"}, "no such face"),
        ({"planes": ("y = 20 mm",)}, "cut planes go through the origin"),
        ({"planes": ("normal 1, 1, 0",)}, "no such face"),
        ({"unit": "m"}, "spans .* m with unit 'm'; give the unit of its lengths, such as unit=.mm."),
        ({"unit": "km"}, "unit is 'km'"),
        ({"file": "nowhere.msh"}, "cannot be read"),
        ({"file": "part.obj"}, "cannot be read|meshes are read from"),
    ],
)
def test_what_cannot_be_meant(files, changes, words):
    with pytest.raises(GeometryError, match=words):
        part(files, "part.msh", **changes)


@pytest.mark.filterwarnings("ignore:overflow")  # meshio, of any STL
def test_files_that_are_no_mesh(files, tmp_path, capfd):
    mesh = meshio.read(files["part.msh"], "gmsh")
    (tmp_path / "pyramid.inp").write_text("*NODE\n1, 0, 0, 0\n*ELEMENT, TYPE=C3D5\n1, 1, 1, 1, 1, 1\n")
    open_one = meshio.read(files["part.stl"])
    meshio.Mesh(open_one.points, [("triangle", open_one.cells_dict["triangle"][1:])]).write(tmp_path / "open.stl")
    meshio.Mesh(mesh.points, [("triangle6", mesh.cells_dict["triangle6"])]).write(tmp_path / "skin.inp")
    flat = mesh.points.copy()
    flat[:, 2] = 0
    meshio.Mesh(flat, [("tetra10", mesh.cells_dict["tetra10"])]).write(tmp_path / "flat.inp")
    (tmp_path / "text.stl").write_text("solid a\nendsolid\n")
    (tmp_path / "text.inp").write_text("hello\n")
    (tmp_path / "text.msh").write_text('SystemCall "touch hit";\n')
    for name, words in {
        "pyramid.inp": "cells of type C3D5; tetrahedra .4 or 10 nodes., wedges .6 or 15. and hexahedra .8 or 20. are supported",
        "open.stl": "is not watertight: 3 edges",
        "skin.inp": "has no tetrahedra",
        "flat.inp": "cell without volume",
        "text.stl": "file .*text.stl",
        "text.inp": "file .*text.inp",
        "text.msh": "file .*text.msh",
    }.items():
        with pytest.raises(GeometryError, match=words):
            ImportedMesh(file=str(tmp_path / name), **CHOICES)
    assert not (tmp_path / "hit").exists()
    assert "".join(capfd.readouterr()) == ""
