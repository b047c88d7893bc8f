"""Names in meshes of other programs: what is in several of them belongs to each; assemblies of Abaqus stand where it says."""

from __future__ import annotations

from pathlib import Path

import gmsh
import numpy as np
import pytest

from geometries import GeometryError, ImportedActuator, ImportedMesh
from geometries.imported import read_mesh
from geometries.mesh_arrays import read_arrays
from geometries.meshing import private_model

VERSIONS = {"4.1": (4.1, 0), "4.1 binary": (4.1, 1), "4.0": (4.0, 0), "2.2": (2.2, 0), "2.2 binary": (2.2, 1)}
GROUPS = {"support": 2400.0, "low": 2000.0, "high": 2000.0, "turned": 400.0, "rubber": 2400.0}
"""Areas in mm2 of the faces at x = 0 of a block of 40 x 60 mm: in strips of 400, 1600 and 400."""
CELLS = {"rubber": 3, "insert": 2, "two": 2, "lowest": 1}
"""How many of the three slices of the block each region has."""


@pytest.fixture(scope="module", params=VERSIONS)
def block(request, tmp_path_factory):
    """A block of three slices whose faces at x = 0 and whose volumes are in several groups, of which one bears the name of a
    face; another face is in none but meshed too."""
    version, binary = VERSIONS[request.param]
    file = tmp_path_factory.mktemp("groups") / "part.msh"
    with private_model():
        occ, model = gmsh.model.occ, gmsh.model
        boxes = [(3, occ.addBox(0, 0, z, 20, 40, h)) for z, h in ((0, 10), (10, 40), (50, 10))]
        occ.fragment(boxes[:1], boxes[1:])
        occ.synchronize()
        root = sorted((tag for _, tag in model.getEntitiesInBoundingBox(-1, -1, -1, 0.1, 50, 70, 2)),
                      key=lambda tag: occ.getCenterOfMass(2, tag)[2])  # fmt: skip
        for name, tags in (("support", root), ("low", root[:2]), ("high", root[1:]), ("turned", [-root[2]]),
                           ("rubber", root)):  # fmt: skip
            model.addPhysicalGroup(2, tags, name=name)
        for name, solids in (("rubber", [1, 2, 3]), ("insert", [2, 3]), ("two", [1, 2]), ("lowest", [1])):
            model.addPhysicalGroup(3, solids, name=name)
        gmsh.option.setNumber("Mesh.MeshSizeMax", 15)
        gmsh.option.setNumber("Mesh.MshFileVersion", version)
        gmsh.option.setNumber("Mesh.Binary", binary)
        gmsh.option.setNumber("Mesh.SaveAll", float(version > 4))
        model.mesh.generate(3)
        gmsh.write(str(file))
    return str(file)


def area(mesh, triangles):
    a, b, c = np.moveaxis(mesh.points[triangles[:, :3]], 1, 0)
    return 1e6 * 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()


def volume(mesh, cells):
    a, b, c, d = np.moveaxis(mesh.points[mesh.cells[cells, :4]], 1, 0)
    return 1e9 * np.abs(np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a)).sum() / 6


def test_a_face_and_a_volume_in_several_groups_is_in_each(block):
    mesh = read_mesh(block, 1e-3)
    assert mesh.volume == pytest.approx(48e-6)
    for name, expected in GROUPS.items():
        assert area(mesh, mesh.triangles[mesh.named(name)]) == pytest.approx(expected), name
    sizes = {"rubber": 48e3, "insert": 40e3, "two": 40e3, "lowest": 8e3}
    for name, expected in sizes.items():
        assert volume(mesh, mesh.regions[name]) == pytest.approx(expected), name


def test_named_faces_and_regions_that_overlap_are_whole_in_the_device(block, tmp_path):
    part = ImportedMesh(file=block, cavities=("none",), support="named support",
                        surfaces=("low = named low", "high = named high"))  # fmt: skip
    mesh = read_arrays(part.write(tmp_path / "part.msh"))
    for name in ("support", "low", "high"):
        assert area(mesh, mesh.triangles(name)) == pytest.approx(GROUPS[name]), name
    assert set(part.regions) == {"insert", "two", "lowest"}
    assert [volume(mesh, mesh.regions[name]) for name in ("insert", "two", "lowest")] == pytest.approx([40e3, 40e3, 8e3])
    parted = mesh.parted(["two"]).regions
    assert [volume(mesh, parted[name]) for name in parted] == pytest.approx([8e3, 40e3])  # of insert what two leaves
    assert sum(map(len, parted.values())) == len(mesh.cells)


def test_named_faces_of_a_drawing_may_overlap(step_file, tmp_path):
    file = step_file(tmp_path / "part.step", lambda occ: occ.addBox(0, 0, 0, 20, 40, 60))
    part = ImportedActuator(file=file, cavities=("none",), support="x = 0 mm", cell_size=0.02,
                            surfaces=("near = in -1..1, -1..41, -1..61 mm", "top = z = 60 mm"))  # fmt: skip
    mesh = read_arrays(part.write(tmp_path / "part.msh"))
    assert [area(mesh, mesh.triangles(name)) for name in ("support", "near", "top")] == pytest.approx([2400, 2400, 800])


PART = """*Heading
*Part, name=Finger
*Node
 1, 0., 0., 0.
 2, 10., 0., 0.
*Node, nset=Far
 3, 0., 10., 0.
 4, 0., 0., 10.
 5, 10., 10., 10.
*Element, type=C3D4H
1, 1, 2, 3, 4
*Element, type=C3D4H, elset=Second
2, 2, 3, 4, 5
*Nset, nset=Foot
 1, 2
*Nset, nset=Both
 FOOT, Far
*Nset, nset=FOOT
 3,
*Nset, nset=OfSecond, elset=second
*Elset, elset=Every, generate
 1, 2
*End Part
"""
ASSEMBLY = """*Assembly, name=Assembly
*Instance, name=Finger-1,
 part=Finger
{place}*End Instance
*Node
 1, 500., 0., 0.
*Nset, nset=Foot, instance=Finger-1
 1, 4
*Nset, nset=Mixed
 Finger-1.Far, Finger-1.1
*End Assembly
"""


def read_deck(tmp_path, text):
    file = tmp_path / "deck.inp"
    file.write_text(text)
    return read_mesh(str(file), 1e-3)


@pytest.mark.parametrize(
    ("place", "expected"),
    [
        ("", [[0, 0, 0], [10, 0, 0], [0, 10, 0], [0, 0, 10], [10, 10, 10]]),
        ("100., 20., -5.\n", [[100, 20, -5], [110, 20, -5], [100, 30, -5], [100, 20, 5], [110, 30, 5]]),
        # Moved first, then turned a quarter about the line along z through (100, 0, 0): x - 100 becomes y, y becomes 100 - x.
        ("100., 20., 0.\n100., 0., 0., 100., 0., 7., 90.\n",
         [[80, 0, 0], [80, 10, 0], [70, 0, 0], [80, 0, 10], [70, 10, 10]]),
    ],
)  # fmt: skip
def test_an_instance_stands_where_its_assembly_puts_it(tmp_path, place, expected):
    mesh = read_deck(tmp_path, PART + ASSEMBLY.format(place=place))
    assert np.abs(1e3 * mesh.points - expected).max() < 1e-9
    assert len(mesh.cells) == 2


def test_sets_of_a_deck_are_whole(tmp_path):
    """A set in several statements, of names, of elements' nodes, of one of two blocks, of the part and of the assembly."""
    mesh = read_deck(tmp_path, PART + ASSEMBLY.format(place=""))
    nodes = {name: (found + 1).tolist() for name, found in mesh.faces.items()}
    assert nodes == {"Far": [3, 4, 5], "FINGER-1.Foot": [1, 2, 3], "Both": [1, 2, 3, 4, 5], "OfSecond": [2, 3, 4, 5],
                     "Foot": [1, 4], "Mixed": [1, 3, 4, 5]}  # fmt: skip
    assert {name: cells.tolist() for name, cells in mesh.regions.items()} == {"Second": [1], "Every": [0, 1]}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (PART + ASSEMBLY.format(place="") + "*Instance, name=Finger-2, part=Finger\n20., 0., 0.\n*End Instance\n",
         "2 bodies .FINGER-1, FINGER-2., and no .TIE that bonds them where they touch"),
        (PART.replace("*End Part", "*Nfill\n1, 2\n*End Part"), r"by \*NFILL .line 23., which is not read"),
        (PART.replace("*Node\n", "*Node, system=C\n"), r"\*NODE .line 3., which is not read; write every node in rectangular"),
        (PART.replace("FOOT, Far", "FOOT, Near"), "the set Both has 'Near', which is not defined"),
        (PART.replace("2, 2, 3, 4, 5", "2, 2, 3, 4, 6"), "has cells with undefined nodes .6."),
        (PART + "*Instance, name=A, part=Hand\n*End Instance\n", "line 24, .INSTANCE: 'HAND'"),
    ],
)  # fmt: skip
def test_what_is_not_read_of_a_deck_is_refused(tmp_path, text, words):
    with pytest.raises(GeometryError, match=words):
        read_deck(tmp_path, text)


SURFACES = """*Surface, name=Slanted
Second, S3
*Surface, type=ELEMENT, name=Sides
 1, S1
 Second, S4
*Surface, type=ELEMENT, name=Skin
 Every,
*Surface, type=NODE, name=Nodes
 Far, 1.
 2,
*End Part
"""


def test_surfaces_of_a_deck_are_faces(tmp_path):
    """Sides of elements by Abaqus' numbers, one by one or all, in the part and in the assembly; and surfaces of nodes. Of a
    triangle of Abaqus' S3, nodes 2, 4 and 3 of the element."""
    place = "*Surface, name=Ends\n Finger-1.2, S2\n Tip, S1\n*Elset, elset=Tip, instance=Finger-1\n 1,\n*End Assembly"
    mesh = read_deck(
        tmp_path, PART.replace("*End Part\n", SURFACES) + ASSEMBLY.format(place="").replace("*End Assembly", place)
    )

    def nodes(name):
        return sorted(sorted((triangle + 1).tolist()) for triangle in mesh.triangles[mesh.named(name)][:, :3])

    assert nodes("Slanted") == [[3, 4, 5]]
    assert nodes("Sides") == [[1, 2, 3], [2, 4, 5]]
    assert nodes("Ends") == [[1, 2, 3], [2, 3, 5]]
    assert nodes("Nodes") == [[2, 3, 5], [2, 4, 5], [3, 4, 5]]
    assert len(nodes("Skin")) == len(mesh.triangles) == 6  # without the triangle between both elements


def test_a_face_has_no_triangle_beside_it_whose_corners_it_has(tmp_path):
    """Of two faces of one tetrahedron every corner is theirs, those of its other faces too."""
    mesh = read_deck(tmp_path, PART.replace("*End Part\n", "*Surface, name=Two\n 1, S1\n 1, S2\n*End Part\n"))
    assert len(mesh.named("Two")) == 2


def test_two_names_do_not_become_one_region(tmp_path):
    file = tmp_path / "deck.inp"
    text = PART.replace("elset=Second", "elset=Se_cond").replace("elset=second", "elset=Se_cond")
    file.write_text(text.replace("elset=Every, generate\n 1, 2", "elset=Se-cond\n 1,"))
    with pytest.raises(GeometryError, match=r"'Se_cond' and 'Se-cond' both become the region se_cond; .* rename one"):
        _ = ImportedMesh(file=str(file), cavities=("none",), support="named Foot").regions


@pytest.mark.parametrize("numbers", [(1, 1), (1, 2)])
def test_bodies_of_a_gmsh_mesh_are_regions_as_those_of_a_deck(tmp_path, numbers):
    """Two boxes that touch, each with nodes of its own there; in one group, or each in its own."""
    file = tmp_path / "two.msh"
    with private_model():
        boxes = [gmsh.model.occ.addBox(x, 0, 0, 10, 10, 10) for x in (0, 10)]
        gmsh.model.occ.synchronize()
        for box, number in zip(boxes, numbers, strict=True):
            gmsh.model.addPhysicalGroup(3, boxes if numbers[0] == numbers[1] else [box], number if box == 1 else 3)
        gmsh.option.setNumber("Mesh.MeshSizeMax", 10)
        gmsh.model.mesh.generate(3)
        gmsh.write(str(file))
    mesh = read_mesh(str(file), 1e-3)
    middles = [mesh.points[mesh.cells[mesh.regions[name]]].mean(axis=(0, 1)) for name in ("body1", "body2")]
    assert np.allclose(sorted(x for x, _, _ in middles), [0.005, 0.015], atol=1e-3)
    assert len(ImportedMesh(file=str(file), cavities=("none",), support="x = 0 mm").bodies) == 2


@pytest.mark.parametrize("damage", ["", "1 99999999999 1 1\n", "text\n"])
def test_damaged_entities_are_named(block, tmp_path, damage):
    content = Path(block).read_bytes()
    if b"$Entities" not in content:
        pytest.skip("MSH 2 has none")
    begin, end = content.index(b"$Entities") + len(b"$Entities\n"), content.index(b"$EndEntities")
    (tmp_path / "part.msh").write_bytes(content[:begin] + damage.encode() + content[end:])
    with pytest.raises(GeometryError, match=r"its section .Entities is damaged"):
        read_mesh(str(tmp_path / "part.msh"), 1e-3)
