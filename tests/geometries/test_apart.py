"""Gmsh in a process of its own: results and errors come back, an end is heard, a crash is a sentence."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from geometries import GeometryError, HollowDisk, ImportedActuator, MeshingError, MeshingStopped
from geometries.meshing import MAX_CELLS_IN_PROCESS, apart, ended_after, summarize
from tests.support.campaigns import sampled

FINE = HollowDisk(fillet=0, cell_size=0.0008, refinement=2)


def test_results_and_errors_come_back():
    assert apart(divmod, 7, 2) == (3, 1)
    with pytest.raises(ZeroDivisionError):
        apart(divmod, 1, 0)
    with pytest.raises(GeometryError, match="fillet"):
        apart(_bad_disk)


def _bad_disk():
    return HollowDisk(fillet=1.0)


def test_what_no_other_process_can_import_runs_here():
    assert apart(lambda: os.getpid()) == os.getpid()
    assert apart(os.getpid) != os.getpid()


@pytest.mark.parametrize(("number", "words"), [(signal.SIGKILL, "memory"), (signal.SIGSEGV, "crashed .SIGSEGV")])
def test_a_death_is_a_sentence(number, words):
    with pytest.raises(MeshingError, match=words):
        apart(signal.raise_signal, number)


@pytest.mark.campaign
def test_a_signal_to_both_processes_is_no_crash():
    """A batch queue ends all processes of a job at once."""
    asked = []

    def stopped():
        asked.append(True)
        if len(asked) == 1:
            time.sleep(3.0)  # the other one has ended meanwhile
        return len(asked) > 1

    with pytest.raises(MeshingStopped):
        apart(signal.raise_signal, signal.SIGTERM, stopped=stopped)


def test_an_end_is_heard_and_leaves_nothing(tmp_path):
    assert FINE.expected_cells > MAX_CELLS_IN_PROCESS
    looks = iter([False, False, True])
    with pytest.raises(MeshingStopped):
        FINE.write(tmp_path / "disk.msh", lambda: next(looks))
    assert not list(tmp_path.iterdir())


def _never_ends():
    with ended_after(1.0):
        pass
    with ended_after(1.0):
        while True:
            pass


@pytest.mark.skipif(sys.platform == "win32", reason="needs a limit of CPU time")
def test_what_does_not_come_back_is_ended():
    with pytest.raises(MeshingError, match="does not come back"):
        apart(_never_ends)


def _wait_long(place):
    Path(place).write_text(str(os.getpid()))
    time.sleep(600.0)


@pytest.mark.skipif(sys.platform != "linux", reason="needs Linux")
def test_a_killed_caller_leaves_no_process(tmp_path):
    """One such process meshed on for an hour."""
    code = "import sys\nfrom geometries import meshing\nfrom tests.geometries import test_apart as here\n"
    place = tmp_path / "process"
    caller = subprocess.Popen([sys.executable, "-c", f"{code}meshing.apart(here._wait_long, {str(place)!r})"])
    until = time.monotonic() + 120.0
    while not (place.exists() and place.read_text()) and time.monotonic() < until:
        time.sleep(0.05)
    caller.kill()
    caller.wait()
    status = Path("/proc") / place.read_text() / "stat"
    # Where nobody waits for it, the process that has ended stays as a zombie.
    while status.exists() and status.read_text().rpartition(")")[2].split()[0] != "Z" and time.monotonic() < until:
        time.sleep(0.05)
    assert time.monotonic() < until


def test_both_ways_make_the_same_mesh(tmp_path, monkeypatch):
    disk = HollowDisk(fillet=0, angle=30)
    here = disk.write(tmp_path / "here.msh")
    monkeypatch.setattr("geometries.meshing.MAX_CELLS_IN_PROCESS", 0)
    assert disk.write(tmp_path / "apart.msh").read_bytes() == here.read_bytes()


@pytest.mark.parametrize("number", sampled([signal.SIGINT, signal.SIGTERM]))
def test_a_run_is_stopped_while_its_mesh_is_made(number, tmp_path):
    words = ["--pressure-cm", "0:177", "--cell-size", "0.5mm", "--refinement", "3", "--no-pictures", "--output"]
    process = subprocess.Popen(
        [sys.executable, "-m", "softmodels.disk", *words, str(tmp_path / "out")], stderr=subprocess.PIPE, text=True
    )
    said = ""
    for line in process.stderr:
        said += line
        if "meshing" in line:
            break
    time.sleep(1.0)  # the mesh takes half a minute
    process.send_signal(number)
    said += process.communicate(timeout=20)[1]
    assert process.returncode == 130 and "during meshing" in said and "Traceback" not in said


def test_a_part_with_too_many_cells_is_refused(step_file, tmp_path, monkeypatch):
    def rounded(occ):
        box = occ.addBox(0, 0, 0, 40, 20, 12)
        occ.fillet([box], [edge for _, edge in occ.getEntities(1)], [3.0])
        occ.cut([(3, box)], [(3, occ.addBox(6, 4, 4, 28, 12, 4))])

    file = step_file(tmp_path / "part.step", rounded)
    chosen = {"file": file, "cavities": ("at 10, 10, 6 mm",), "support": "x = 0 mm"}
    with pytest.raises(GeometryError, match=r"triangles are expected on the part's faces"):
        ImportedActuator(cell_size=2e-5, **chosen)
    coarse = ImportedActuator(cell_size=4e-3, **chosen)
    cells = summarize(coarse.write(tmp_path / "part.msh")).cells
    monkeypatch.setattr("geometries.meshing.apart", lambda task, *words, stopped: task(*words))
    monkeypatch.setattr("geometries.meshing.MOST_CELLS", 2 * cells)
    coarse.write(tmp_path / "part.msh")
    monkeypatch.setattr("geometries.meshing.MOST_CELLS", cells // 2)
    with pytest.raises(GeometryError, match=r"cells are expected, but .* use a larger cell_size"):
        coarse.write(tmp_path / "part.msh")
