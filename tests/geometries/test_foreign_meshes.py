"""Mesh files from elsewhere: read if they are meshes, refused if not, and never run as scripts of Gmsh's."""

from __future__ import annotations

import os

import meshio
import numpy as np
import pytest

from geometries import GeometryError, HollowDisk, MeshFileError
from geometries.imported import read_mesh, read_surfaces
from geometries.meshing import load_mesh, private_model, summarize

SCRIPT = 'SystemCall "touch {}";\n'


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return HollowDisk(section="axisymmetric", fillet=0).write(tmp_path_factory.mktemp("mesh") / "disk.msh").read_bytes()


def between(mesh, name, text):
    """The mesh with something put after one of its sections."""
    end = f"$End{name}\n".encode()
    return mesh.replace(end, end + text.encode())


@pytest.mark.parametrize(
    "broken",
    [
        lambda mesh, script: script.encode(),
        lambda mesh, script: (script * 20).encode() + mesh,
        lambda mesh, script: mesh + script.encode(),
        lambda mesh, script: between(mesh, "MeshFormat", script),
        lambda mesh, script: between(mesh, "Nodes", script),
        lambda mesh, script: mesh.replace(b"$MeshFormat\n4.1 0 8", b"$MeshFormat\n2.2 0 8"),
        lambda mesh, script: mesh[: len(mesh) // 2],
        lambda mesh, script: mesh[: mesh.index(b"$Elements")],
        lambda mesh, script: mesh.replace(b"$Nodes", b"$Nodes\0"),
        lambda mesh, script: b"",
        lambda mesh, script: b"solid a\nendsolid\n",
    ],
    ids=[
        "script",
        "before",
        "behind",
        "after the head",
        "between",
        "older",
        "half",
        "no cells",
        "zero",
        "empty",
        "stl",
    ],
)
def test_what_is_no_mesh_is_refused_and_nothing_runs(broken, whole, tmp_path):
    file, hit = tmp_path / "disk.msh", tmp_path / "hit"
    file.write_bytes(broken(whole, SCRIPT.format(hit)))
    with pytest.raises(MeshFileError, match=r"disk\.msh is"):
        summarize(file)
    assert not hit.exists()


@pytest.mark.parametrize("name", ["disk.msh.opt", "disk.opt", "disk.geo"])
def test_nothing_beside_a_mesh_is_run(name, whole, tmp_path):
    file, hit = tmp_path / "disk.msh", tmp_path / "hit"
    file.write_bytes(whole)
    (tmp_path / name).write_text(SCRIPT.format(hit))
    assert summarize(file).cells > 100
    assert not hit.exists()


def test_a_mesh_of_other_cells_is_refused(whole, tmp_path):
    file = tmp_path / "disk.msh"
    file.write_bytes(whole)
    with private_model():
        load_mesh(file, 2)
    with private_model(), pytest.raises(MeshFileError, match="another device"):
        load_mesh(file, 3)


def test_only_the_checked_way_leads_to_gmsh(request):
    """No other module of the library lets Gmsh open a file whose kind Gmsh guesses."""
    root = request.config.rootpath
    calls = [
        f"{file.relative_to(root)}:{number}"
        for room in ("geometries", "softmodels", "measurement")
        for file in sorted((root / room).rglob("*.py"))
        for number, line in enumerate(file.read_text().splitlines(), 1)
        if "gmsh.merge(" in line or "gmsh.open(" in line or ("importShapes(" in line and "format=" not in line)
    ]
    assert [call.split(":")[0] for call in calls] == ["geometries/meshing.py"]


DECK = """*NODE
1, 0, 0, 0
2, 1, 0, 0
3, 0, 1, 0
4, 0, 0, 1
** *INCLUDE, INPUT=comment.inp
*ELEMENT, TYPE=C3D4, ELSET=ALL
1, 1, 2, 3, 4
*NSET, NSET=root, GENERATE
1, 3, 1
"""


@pytest.mark.parametrize(
    "line", ["*INCLUDE, INPUT={}", "*include,input = {}", "  *Include, INPUT={}", "*NODE, INPUT={}",
             "*ELEMENT, TYPE=C3D4, INPUT={}"],
)  # fmt: skip
def test_a_deck_opens_no_other_file(tmp_path, monkeypatch, line):
    secret, file = tmp_path / "secret.inp", tmp_path / "deck.inp"
    secret.write_text(DECK.replace("*ELEMENT", "*NODE"))
    file.write_text(DECK)
    assert len(read_mesh(str(file), 1e-3).points) == 4
    file.write_text(DECK + line.format(secret) + "\n")
    monkeypatch.setattr(meshio, "read", lambda *_: pytest.fail("meshio has been given it"))
    with pytest.raises(GeometryError, match=r"includes another file .line 1[12]: .* into one file"):
        read_mesh(str(file), 1e-3)


def test_a_set_is_no_longer_than_its_deck(tmp_path):
    file = tmp_path / "deck.inp"
    file.write_text(DECK.replace("1, 3, 1", "1, 100000000000, 1"))
    with pytest.raises(GeometryError, match="more than the file has characters"):
        read_mesh(str(file), 1e-3)


@pytest.mark.parametrize("ending", [".inp", ".msh", ".stl"])
def test_a_pipe_is_not_waited_for(tmp_path, ending):
    file = tmp_path / f"part{ending}"
    os.mkfifo(file)
    with pytest.raises(GeometryError, match="it is a named pipe, not a regular file"):
        read_mesh(str(file), 1e-3)
    if ending == ".stl":
        with pytest.raises(GeometryError, match="it is a named pipe"):
            read_surfaces(str(file), 1e-3)


def test_a_binary_surface_may_begin_like_a_text(tmp_path):
    """Its header of 80 bytes often says "solid"; the length of the file tells."""
    corners = [[0, 0, 0], [10, 0, 0], [0, 10, 0], [0, 0, 10]]
    sides = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]
    facets = np.zeros(4, dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    facets["corners"] = np.array(corners)[np.array(sides)]
    header = b"solid Brazo_20cm".ljust(80, b"\xe0") + (4).to_bytes(4, "little")
    (tmp_path / "arm.stl").write_bytes(header + facets.tobytes())
    (points, triangles), _ = read_surfaces(str(tmp_path / "arm.stl"), 1e-3)
    assert len(points) == 4 and len(triangles) == 4 and np.ptp(points) == pytest.approx(0.01)


@pytest.mark.parametrize("ending", ["vtk", "vtu"])
def test_meshes_of_vtk_are_read(tmp_path, ending):
    """As robot simulators have them: tetrahedra beside the triangles and lines of their surface."""
    points = np.array([[0, 0, 0], [10, 0, 0], [0, 10, 0], [0, 0, 10], [10, 10, 10]], dtype=float)
    cells = [("line", [[0, 1]]), ("triangle", [[0, 1, 2]]), ("tetra", [[0, 1, 2, 3], [1, 2, 3, 4]])]
    meshio.Mesh(points, cells).write(tmp_path / f"part.{ending}")
    mesh = read_mesh(str(tmp_path / f"part.{ending}"), 1e-3)
    assert len(mesh.cells) == 2 and mesh.volume == pytest.approx(0.5e-6, rel=1e-6)
