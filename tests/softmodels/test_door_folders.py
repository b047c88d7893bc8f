"""The door into a folder: states are written while they are solved, resumed after a kill, and solved for in between."""

from __future__ import annotations

import shutil
import signal
from pathlib import Path

import numpy as np
import pytest

import softmodels as sm
from softmodels.runs.simulation import Simulation
from tests.support import runs
from tests.support.campaigns import sampled
from tests.support.ranks import mpirun

LAW = sm.NeoHookean(20e3)
BALLOONS = sm.HollowDisk(membrane=1e-3, section="axisymmetric", cell_size=6e-3, refinement=1.0)
"""Has a limit point near 36 cm."""
TWIN = sm.HollowDisk.variant("shadow", section="axisymmetric", base=2e-3, wall=15e-3, cell_size=3e-3)
"""Two equal membranes, of which one balloons in the end."""
TWIN_LAW = sm.Yeoh(10e3, 20.0, 3.0, 0.495)
HEAD = """
import os, signal
import softmodels as sm

disk = sm.HollowDisk(membrane=1e-3, section="axisymmetric", cell_size=6e-3, refinement=1.0)
law = sm.NeoHookean(20e3)
"""


@pytest.fixture(scope="module")
def in_memory():
    return sm.inflate(BALLOONS, LAW, pressures="0:100 cm")


@pytest.fixture(scope="module")
def twin():
    return sm.inflate(TWIN, TWIN_LAW, volumes="0:90:30 ml", branch=True)


def texts(folder):
    return {name: (folder / name).read_text() for name in ("path.csv", "case.toml", "summary.json", "disk.xdmf")}


def test_states_are_in_the_folder_as_soon_as_they_are_solved(in_memory, tmp_path, capfd):
    folder, lengths = tmp_path / "disk", []

    def look(row):
        lengths.append(len(sm.load(folder)))
        with pytest.raises(sm.InUseError, match="is in use by process"):
            sm.inflate(BALLOONS, LAW, pressures="0:100 cm", folder=folder)

    run = sm.inflate(BALLOONS, LAW, pressures="0:100 cm", folder=folder, progress=look)
    assert lengths == list(range(1, len(run) + 1))
    assert run.limit == in_memory.limit and run.limit.kind == "limit"
    saved = in_memory.save(tmp_path / "saved")
    assert texts(folder) == texts(saved)
    assert {file.name for file in folder.iterdir()} == {file.name for file in saved.iterdir()}
    assert run.save(folder) == folder and texts(folder) == texts(saved)
    assert np.array_equal(run[3].von_mises, in_memory[3].von_mises)
    assert capfd.readouterr() == ("", "")


@pytest.mark.campaign
def test_a_killed_script_leaves_its_states_and_is_resumed(in_memory, tmp_path):
    text = """
def die(row):
    if row["step"] == 4:
        os.kill(os.getpid(), signal.SIGKILL)

sm.inflate(disk, law, pressures="0:100 cm", folder="disk", progress=die)
"""
    done = runs.run("-c", HEAD + text, cwd=tmp_path)
    assert (done.status, done.out, done.err) == (-signal.SIGKILL, "", "")
    left = sm.load(tmp_path / "disk")
    assert len(left) == 5 and np.array_equal(left[4].displacement, in_memory[4].displacement)
    assert left.limit is None
    run = sm.inflate(BALLOONS, LAW, pressures="0:100 cm", folder=tmp_path / "disk", resume=True)
    runs.same(run.rows, in_memory.rows, 1e-6)
    assert run.rows[:5] == in_memory.rows[:5] and run.limit.kind == in_memory.limit.kind
    assert run.limit.pressure == pytest.approx(in_memory.limit.pressure, rel=1e-6)


def test_ones_own_interrupt_lets_go_of_the_folder(tmp_path):
    def interrupt(row):
        if row["step"] == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sm.inflate(BALLOONS, LAW, pressures="0:30 cm", folder=tmp_path / "disk", progress=interrupt)
    assert len(sm.load(tmp_path / "disk")) == 3
    sm.inflate(BALLOONS, LAW, pressures="0:30 cm", folder=tmp_path / "disk", resume=True)


def test_a_case_file_is_run_into_a_folder_and_never_replaced(in_memory, tmp_path):
    file = in_memory.save(tmp_path / "first") / "case.toml"
    assert sm.run(file, folder=tmp_path / "second").rows == in_memory.rows
    file.write_text(file.read_text().replace("control", "# as it was\ncontrol"))
    with pytest.raises(sm.OwnFolderError, match=r"case.toml is an input, and one of the results in"):
        sm.run(file, folder=tmp_path / "first")


def test_whose_folder_it_is_and_what_was_run_there(in_memory, tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("mine")
    with pytest.raises(sm.OwnFolderError, match=r"holds files not written by a run .*'thesis.txt'"):
        sm.inflate(BALLOONS, LAW, pressures="0:30 cm", folder=tmp_path / "mine")
    assert [file.name for file in (tmp_path / "mine").iterdir()] == ["thesis.txt"]
    other = in_memory.save(tmp_path / "other")
    with pytest.raises(sm.RunError, match="holds a run with another material"):
        sm.inflate(BALLOONS, sm.NeoHookean(25e3), pressures="0:100 cm", folder=other, resume=True)
    with pytest.raises(sm.CaseError, match="resuming needs the run's folder"):
        sm.inflate(BALLOONS, LAW, pressures="0:100 cm", resume=True)
    with pytest.raises(sm.CaseError, match="cannot be combined"):
        sm.inflate(BALLOONS, LAW, pressures="0:10 cm", load_unload=True, branch=True)


@pytest.mark.campaign
def test_a_branch_is_a_run_of_its_own(twin, tmp_path):
    at = next(k for k, row in enumerate(twin.rows) if row["bifurcation"])
    assert twin.branch.case == twin.case and twin.branch.limit is None
    away = np.abs(twin.branch.apex - twin.apex[at])
    assert (np.diff(away) > 0).all() and twin.branch.added_volume[-1] >= 90e-6
    assert twin.branch.pressure[-1] < twin.pressure[-1]
    again = sm.load(twin.save(tmp_path / "saved"))
    assert again.branch.rows == twin.branch.rows
    both = [run.branch.at("80 ml").displacement for run in (twin, again)]
    assert np.abs(both[0] - both[1]).max() < 1e-9 * np.abs(both[0]).max()
    assert np.abs(both[0] - twin.at("80 ml").displacement).max() > 1e-3
    with pytest.raises(sm.RunError, match="no state at"):
        twin.branch.at("0.1 ml")


@pytest.mark.campaign
def test_a_branch_is_followed_into_the_folder(twin, tmp_path):
    run = sm.inflate(TWIN, TWIN_LAW, volumes="0:90:30 ml", branch=True, folder=tmp_path / "disk")
    for one, other in zip(map(dict, [*run.rows, *run.branch.rows]), [*twin.rows, *twin.branch.rows], strict=True):
        # To rounding, and not to the last bit: a bifurcation lies where a tangent is singular, and not every processor
        # gives its place twice with the same digits.
        assert one.pop("control") == other["control"]
        assert one == pytest.approx({name: other[name] for name in one}, rel=1e-7, abs=1e-7, nan_ok=True)
    saved = run.save(tmp_path / "saved")
    for place in (".", "branch"):
        assert texts(tmp_path / "disk" / place) == texts(saved / place)
    assert sm.inflate(TWIN, TWIN_LAW, volumes="5 ml", branch=True).branch is None


@pytest.mark.parametrize("share", sampled([0.5, 0.02, 0.98]))
@pytest.mark.parametrize("stored", sampled([False, True]))
def test_a_state_in_between_starts_from_its_neighbours(share, stored, in_memory, tmp_path, monkeypatch):
    """The path from rest to there gives the same to 1e-10 of it; nothing of that is solved here."""
    run = sm.load(in_memory.save(tmp_path / "disk")) if stored else in_memory
    ends = [*in_memory.pressure[[9, 10]], *in_memory.added_volume[[9, 10]]]
    pressure, volume = ((1 - share) * low + share * high for low, high in (ends[:2], ends[2:]))
    straight = [sm.inflate(BALLOONS, LAW, pressures=[pressure]).last, sm.inflate(BALLOONS, LAW, volumes=[volume]).last]

    def from_rest(self, begun=None):
        raise AssertionError("solved from rest")

    monkeypatch.setattr(Simulation, "steps", from_rest)
    monkeypatch.setattr(type(BALLOONS), "write", from_rest)
    for state, wanted in zip((run.at(pressure), run.at(f"{float(volume * 1e6)!r} ml")), straight, strict=True):
        for name, values in wanted.fields.items():
            assert np.abs(state.fields[name] - values).max() < 1e-8 * np.abs(values).max(), name
        assert list(state.row) == list(run.rows[0]) and state.row["requested"] == 1


def test_strokes_in_between(monkeypatch):
    syringe = sm.Syringe(syringe=20e-6, dead_volume=1e-6)
    run, straight = (sm.inflate(BALLOONS, LAW, strokes=strokes, supply=syringe) for strokes in ("0:6 ml", "4.321 ml"))
    monkeypatch.setattr(Simulation, "steps", None)
    state = run.at("4.321 ml")
    assert state.row["stroke_ml"] == pytest.approx(4.321, rel=1e-9)
    assert np.abs(state.displacement - straight.last.displacement).max() < 1e-8 * np.abs(state.displacement).max()
    assert run.at("9 cm").pressure == pytest.approx(9 * run.case.column.pascal, rel=1e-9)


@pytest.mark.quick
@pytest.mark.parametrize("ranks", [2])
def test_several_ranks_write_one_folder(ranks, tmp_path, in_memory):
    text = """
from mpi4py import MPI

short = sm.inflate(disk, law, pressures="0,10 cm", folder="disk")
run = sm.inflate(disk, law, pressures="0,10,30 cm", folder="disk", resume=True)
refused = ""
try:
    sm.inflate(disk, sm.NeoHookean(30e3), pressures="0,10 cm", folder="disk", resume=True)
except sm.RunError as error:
    refused = "another material" in str(error)
state = run.at("25 cm")
limit = sm.limit(disk, law).pressure
found = [len(short), len(run), run.apex[-1], state.von_mises.max(), state.added_volume, limit, refused]
everybodys = MPI.COMM_WORLD.gather([float(one) for one in found])
if MPI.COMM_WORLD.rank == 0:
    assert everybodys[0] == everybodys[1], everybodys
    print(*everybodys[0])
"""
    done = runs.run("-c", HEAD + text, launcher=[mpirun(), "-n", ranks], cwd=tmp_path)
    assert (done.status, done.err) == (0, "")
    lengths, found = np.split(np.array(done.out.split(), dtype=float), [2])
    run = sm.inflate(BALLOONS, LAW, pressures="0,10,30 cm")
    state = run.at("25 cm")
    assert lengths[1] > lengths[0] > 2
    assert found == pytest.approx(
        [run.apex[-1], state.von_mises.max(), state.added_volume, in_memory.limit.pressure, 1.0], rel=1e-6
    )


def block(file):
    """A block with a round hole, 20 x 10 x 8 mm, as Gmsh's mesh of straight cells."""
    import gmsh

    from geometries.meshing import private_model

    with private_model():
        body, hole = gmsh.model.occ.addBox(0, 0, 0, 20, 10, 8), gmsh.model.occ.addCylinder(5, 5, 4, 10, 0, 0, 2.5)
        gmsh.model.occ.cut([(3, body)], [(3, hole)])
        gmsh.model.occ.synchronize()
        gmsh.option.setNumber("Mesh.MeshSizeMax", 4)
        gmsh.model.mesh.generate(3)
        gmsh.write(str(file))


def roof(file):
    """A tetrahedron whose base lies at its origin, as STL in mm, counter-clockwise from outside."""
    corners = [(-4, -4, 0), (4, -4, 0), (0, 4, 0), (0, 0, 6)]
    faces = [(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)]
    lines = ["solid roof"]
    for face in faces:
        lines += ["facet normal 0 0 0", " outer loop"]
        lines += [f"  vertex {corners[k][0]} {corners[k][1]} {corners[k][2]}" for k in face]
        lines += [" endloop", "endfacet"]
    file.write_text("\n".join([*lines, "endsolid roof", ""]))


@pytest.mark.campaign
def test_what_a_folder_needs_lies_in_it(tmp_path, monkeypatch):
    """Its part and its shapes come along: it is read, solved in and run again without the files that it was made from."""
    (tmp_path / "bench").mkdir()
    monkeypatch.chdir(tmp_path / "bench")
    block(Path("pn.msh"))
    roof(Path("roof.stl"))
    part = sm.ImportedMesh(file="pn.msh", cavities=["at 10, 5, 4 mm"], support="x = 0 mm", gauge_point="at 20, 5, 8 mm")
    above = sm.RigidShape(
        shape="stl", file="roof.stl", name="roof", faces="outer", at=["10 mm", "5 mm", "8.3 mm"], rounding="1 mm"
    )
    asked = {"pressures": "0,2 kPa", "components": above}
    into = sm.inflate(part, LAW, **asked, folder="into")
    monkeypatch.chdir(tmp_path)
    saved = into.save("saved")
    shutil.move("bench/into", "moved")
    shutil.rmtree("bench")
    for folder in (saved, Path("moved")):
        monkeypatch.chdir(tmp_path)
        assert sorted(file.name for file in (folder / "files").iterdir()) == ["pn.msh", "roof.stl"]
        text = (folder / "case.toml").read_text()
        assert 'file = "files/pn.msh"' in text and 'file = "files/roof.stl"' in text and "bench" not in text
        again = sm.load(folder)
        assert again.rows == into.rows
        monkeypatch.chdir("/")
        assert sm.load(again.save(tmp_path / "copy")).rows == into.rows
    assert again.at("0.5 kPa").pressure == pytest.approx(500.0, rel=1e-9)
    words = ("-m", "softmodels", "run", "moved/case.toml", "--output", "moved", "--quiet", "--no-pictures")
    done = runs.run(*words, cwd=tmp_path)
    assert (done.status, done.err) == (0, "")
    monkeypatch.chdir(tmp_path)
    assert sm.load("moved").rows == into.rows and (tmp_path / "moved/files/pn.msh").is_file()
    assert 'file = "files/pn.msh"' in Path("moved/case.toml").read_text()
