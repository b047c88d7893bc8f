"""Mesh files from Python and from the command line: complete, repeatable, and clear when they cannot be made."""

from __future__ import annotations

import os
import subprocess
import sys

import click.testing
import pytest

from geometries import Beam, GeometryError, HollowDisk, MeshingError
from geometries.__main__ import main
from geometries.meshing import summarize

FLAT = HollowDisk(section="axisymmetric", fillet=0)


def test_same_parameters_give_the_same_file(tmp_path):
    disk = HollowDisk(fillet=0, angle=30)
    assert disk.write(tmp_path / "a.msh").read_bytes() == disk.write(str(tmp_path / "b.msh")).read_bytes()
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a.msh", "b.msh"]


def test_order_two_cells_are_valid_and_order_one_has_the_same_cells(tmp_path):
    second = summarize(HollowDisk().write(tmp_path / "2.msh"))
    first = summarize(HollowDisk(order=1).write(tmp_path / "1.msh"))
    assert second.quality > 0.05 and first.cells == second.cells and first.nodes < second.nodes
    assert "4.1 0 8" in (tmp_path / "2.msh").read_text()[:40]


def test_nothing_of_netgens_is_printed(tmp_path, monkeypatch, capfd):
    """Netgen writes to the terminal by itself where it cannot improve a flat cell; other words are kept."""
    import gmsh

    def optimize(method):
        if method == "Netgen":
            os.write(2, b"ERROR: BFGS update error1!!!!\n")
            os.write(1, b"BFGS update error2\nanother thread's\n")

    monkeypatch.setattr(gmsh.model.mesh, "optimize", optimize)
    Beam(length=0.02, cell_size=0.005).write(tmp_path / "beam.msh")
    seen = capfd.readouterr()
    assert seen.out == "another thread's\n" and seen.err == ""


def test_callers_gmsh_session_is_left_alone(tmp_path):
    import gmsh

    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("Mesh.Algorithm", 5)
        gmsh.model.add("mine")
        gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
        gmsh.model.occ.synchronize()
        FLAT.write(tmp_path / "flat.msh")
        assert gmsh.isInitialized() and gmsh.model.getCurrent() == "mine"
        assert len(gmsh.model.getEntities(3)) == 1 and gmsh.option.getNumber("Mesh.Algorithm") == 5
        assert sorted(gmsh.model.list()) == ["", "mine"]
    finally:
        gmsh.finalize()


def test_gmsh_failure_becomes_a_sentence_and_leaves_no_file(tmp_path, monkeypatch):
    import gmsh

    def broken(dimension):
        raise Exception("PLC Error: a segment and a facet intersect")

    monkeypatch.setattr(gmsh.model.mesh, "generate", broken)
    (tmp_path / "flat.msh").write_text("an older mesh")
    with pytest.raises(MeshingError, match=r"HollowDisk.*PLC Error.*fillet.*cell size"):
        FLAT.write(tmp_path / "flat.msh")
    assert not gmsh.isInitialized()
    assert [file.name for file in tmp_path.iterdir()] == ["flat.msh"]
    assert (tmp_path / "flat.msh").read_text() == "an older mesh"


def test_wrong_paths_are_refused(tmp_path):
    with pytest.raises(GeometryError, match=r"flat\.txt.*\.msh"):
        FLAT.write(tmp_path / "flat.txt")
    with pytest.raises(FileNotFoundError, match="missing"):
        FLAT.write(tmp_path / "missing" / "flat.msh")
    (tmp_path / "folder.msh").mkdir()
    with pytest.raises(IsADirectoryError, match=r"folder\.msh"):
        FLAT.write(tmp_path / "folder.msh")
    with pytest.raises(FileNotFoundError, match="none"):
        summarize(tmp_path / "none.msh")


def test_importing_the_package_loads_no_mesher():
    code = (
        "import sys, geometries; print([m for m in ('gmsh', 'click', 'pint', 'dolfinx', 'mpi4py') if m in sys.modules])"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"


def _run(*arguments):
    command = [sys.executable, "-m", "geometries", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_command_line_makes_the_mesh_it_is_asked_for(tmp_path):
    done = _run("HollowDisk", "--variant", "shadow", "--membrane", "3mm", "--order", "1", "--section", "axisymmetric",
                "-o", tmp_path / "a.msh")  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "triangles of order 1" in done.stdout and "ml" in done.stdout and str(tmp_path / "a.msh") in done.stdout
    HollowDisk.variant("shadow", membrane=0.003, order=1, section="axisymmetric").write(tmp_path / "b.msh")
    assert (tmp_path / "a.msh").read_bytes() == (tmp_path / "b.msh").read_bytes()


def test_command_line_lists_devices_and_teaches():
    assert "HollowDisk" in _run().stdout
    taught = _run("HollowDisk", "--help").stdout
    assert "--cavity-radius" in taught and "[default: 10 mm]" in taught and "-o disk.msh" in taught


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--membrane", "3"], ["--membrane", "no unit"]),
        (["--membrane=-3mm"], ["membrane", "-3 mm"]),
        (["--angle", "50deg"], ["angle", "50 deg"]),
        (["-o", "missing/folder/a.msh"], ["missing/folder"]),
        (["-o", "a.txt"], ["a.txt", ".msh"]),
    ],
)
def test_command_line_refuses_with_one_sentence(arguments, words):
    done = _run("HollowDisk", *arguments)
    assert done.returncode == 2 and "Traceback" not in done.stderr
    assert all(word in done.stderr.splitlines()[-1] for word in words)


def test_command_line_tells_a_failed_mesher_from_wrong_input(tmp_path, monkeypatch):
    import gmsh

    monkeypatch.setattr(gmsh.model.mesh, "generate", lambda dimension: None)
    done = click.testing.CliRunner().invoke(main, ["HollowDisk", "-o", str(tmp_path / "a.msh")])
    assert done.exit_code == 1 and "no cells" in done.output and list(tmp_path.iterdir()) == []
