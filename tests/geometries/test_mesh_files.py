"""Mesh files from Python and from the command line: complete, repeatable, and clear when they cannot be made."""

from __future__ import annotations

import dataclasses
import os
import subprocess
import sys
import time

import click.testing
import numpy as np
import pytest
import scipy

from geometries import Beam, GeometryError, HollowDisk, MeshingError, meshing
from geometries.__main__ import main
from geometries.actuator import joined, joined_by
from geometries.meshing import summarize

FLAT = HollowDisk(section="axisymmetric", fillet=0)


def test_same_parameters_give_the_same_file(tmp_path):
    disk = HollowDisk(fillet=0, angle=30)
    assert disk.write(tmp_path / "a.msh").read_bytes() == disk.write(str(tmp_path / "b.msh")).read_bytes()
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a.msh", "b.msh"]


@pytest.mark.campaign
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
    code = "import sys, geometries; print([m for m in ('gmsh', 'click', 'pint', 'dolfinx', 'mpi4py') if m in sys.modules])"
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


# -- Meshes that are kept: taken for the same device alone, and no failure where they cannot be ----------------------


SECTION = HollowDisk(section="axisymmetric", cell_size=0.006, refinement=1.0)


@pytest.fixture
def made(monkeypatch, tmp_path):
    """An empty cache, and what was meshed."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    found, make = [], meshing._make

    def counted(actuator, path, *how):
        found.append(actuator)
        make(actuator, path, *how)

    monkeypatch.setattr(meshing, "_make", counted)
    return found


def test_a_device_is_meshed_once(made, tmp_path):
    first = SECTION.write(tmp_path / "one.msh").read_bytes()
    assert SECTION.write(tmp_path / "two.msh").read_bytes() == first
    assert dataclasses.replace(SECTION).write(tmp_path / "two.msh").read_bytes() == first and made == [SECTION]


@pytest.mark.parametrize("change", [{"cell_size": 0.0061}, {"membrane": 0.0071}, {"support": "base"}])
def test_another_device_is_meshed(change, made, tmp_path):
    other = dataclasses.replace(SECTION, **change)
    SECTION.write(tmp_path / "one.msh")
    other.write(tmp_path / "two.msh")
    assert made == [SECTION, other]


def test_what_another_mesher_made_is_not_taken(made, monkeypatch, tmp_path):
    SECTION.write(tmp_path / "one.msh")
    monkeypatch.setattr(meshing, "_mesher_versions", lambda: "another version")
    SECTION.write(tmp_path / "one.msh")
    assert len(made) == 2


def test_a_class_from_elsewhere_is_not_kept(made, tmp_path):
    @dataclasses.dataclass(frozen=True)
    class Own(HollowDisk):
        pass

    own = Own(section="axisymmetric", cell_size=0.006, refinement=1.0)
    for _ in range(2):
        own.write(tmp_path / "own.msh")
    assert len(made) == 2 and not meshing.folder().exists()


def test_a_kept_mesh_that_ends_early_is_made_anew(made, tmp_path):
    whole = SECTION.write(tmp_path / "one.msh").read_bytes()
    (kept,) = meshing.folder().glob("*.msh")
    kept.write_bytes(whole[:5000])
    assert SECTION.write(tmp_path / "two.msh").read_bytes() == whole == kept.read_bytes() and len(made) == 2


def test_a_cache_that_cannot_be_written_is_no_failure(made, monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", "/proc/none")
    for _ in range(2):
        SECTION.write(tmp_path / "one.msh")
    assert len(made) == 2


def test_what_is_unused_for_longest_goes_first(made, monkeypatch, tmp_path):
    others = [dataclasses.replace(SECTION, membrane=0.001 * k) for k in (6, 7, 8)]
    size = others[0].write(tmp_path / "one.msh").stat().st_size
    monkeypatch.setattr(meshing, "MOST_KEPT", int(2.5 * size))
    time.sleep(0.02)
    others[1].write(tmp_path / "one.msh")
    time.sleep(0.02)
    others[0].write(tmp_path / "one.msh")  # used again
    time.sleep(0.02)
    others[2].write(tmp_path / "one.msh")
    made.clear()
    others[0].write(tmp_path / "one.msh")
    assert made == []
    others[1].write(tmp_path / "one.msh")
    assert made == [others[1]]


# -- What hangs together, against SciPy's connected components -------------------------------------------------------


@pytest.mark.parametrize("share", [0.0, 0.2, 0.45, 0.55, 1.0, 3.0])
def test_groups_are_those_of_another_library(share):
    chance, count = np.random.default_rng(7), 400
    pairs = chance.integers(0, count, (int(share * count), 2))
    graph = scipy.sparse.coo_matrix((np.ones(len(pairs)), pairs.T), shape=(count, count))
    assert (joined(pairs, count) == scipy.sparse.csgraph.connected_components(graph, directed=False)[1]).all()


def test_a_long_chain_is_one_group():
    links = np.random.default_rng(7).permutation(np.column_stack([np.arange(999), np.arange(1, 1000)]))
    assert (joined(links, 1001) == np.r_[np.zeros(1000), 1]).all()


def test_rows_that_share_a_value_are_one_group():
    assert list(joined_by(np.array([[7, 3], [9, 1], [3, 20], [5, 5], [20, 8], [1, 2]]))) == [0, 1, 0, 2, 0, 1]
    assert len(joined_by(np.empty((0, 2), dtype=np.int64))) == 0
