"""``--ranks``: the command starts as many processes as pay, and ends as one does."""

from __future__ import annotations

import os
import pty
import signal
import subprocess
import sys
import time

import pytest

from geometries import HollowDisk
from softmodels.case.case import Case
from softmodels.case.load import steps_of
from softmodels.case.materials import DEFAULT
from softmodels.cli import options
from softmodels.common.errors import MeshingError, MeshingStopped
from softmodels.mechanics.mpi import StartError
from tests.support import runs
from tests.support.campaigns import sampled

MPI = options._launcher()
needs_mpirun = pytest.mark.skipif(MPI is None, reason="no mpirun beside this Python or on the path")


@pytest.fixture
def free(monkeypatch):
    """No launcher around, and four cores."""
    for name in ("PMI_RANK", "PMIX_RANK", "OMPI_COMM_WORLD_RANK", "SLURM_PROCID", "PMI_SIZE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(options.processes, "cores", lambda: 4)
    monkeypatch.setattr(options, "_launcher", lambda: "mpirun")
    return monkeypatch


def case_of(**fields):
    return Case("disk", HollowDisk(**fields), DEFAULT, steps=steps_of(pressure_cm=(1.0,)))


@pytest.mark.parametrize(("nodes", "expected"), [(3_000, 1), (18_000, 1), (19_000, 2), (30_000, 3), (300_000, 4)])
def test_as_many_ranks_as_have_enough_unknowns_and_no_more_than_cores(nodes, expected, free):
    text = f"$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n7 {nodes} 1 {nodes}\n"
    free.setattr(HollowDisk, "write", lambda self, file, stopped: file.write_text(text))
    assert options.ranks_for(case_of(), None) == expected
    assert options.ranks_for(case_of(section="axisymmetric"), None) == 1
    free.setattr(options.processes, "cores", lambda: 1)
    assert options.ranks_for(case_of(), None) == 1


def test_the_nodes_of_a_mesh_tell_the_unknowns_of_its_run(tmp_path):
    """3,373 cells with 17,326 unknowns are what a run of this wedge reports."""
    file = tmp_path / "mesh.msh"
    HollowDisk(cell_size=8e-3).write(file)
    assert options.PER_NODE * options._nodes(file) == pytest.approx(17_326, rel=0.03)
    assert options._nodes(tmp_path / "mesh.msh") > 5000


def test_a_launchers_ranks_stand(free):
    free.setenv("PMI_RANK", "1")
    free.setenv("PMI_SIZE", "2")
    assert options.ranks_for(case_of(), None) == options.ranks_for(case_of(), 2) == 1
    with pytest.raises(StartError, match=r"--ranks 3 differs from the 2 ranks that mpirun"):
        options.ranks_for(case_of(), 3)


def test_without_a_launcher_one_rank_is_taken_and_more_are_refused(free):
    free.setattr(options, "_launcher", lambda: None)
    assert options.ranks_for(case_of(), None) == options.ranks_for(case_of(), 1) == 1
    with pytest.raises(StartError, match="--ranks 2 needs mpirun"):
        options.ranks_for(case_of(), 2)


def test_a_mesh_that_cannot_be_made_is_the_runs_to_report(free):
    def fails(self, file, stopped):
        raise MeshingError("no mesh")

    free.setattr(HollowDisk, "write", fails)
    assert options.ranks_for(case_of(), None) == 1

    def stops(self, file, stopped):
        raise MeshingStopped

    free.setattr(HollowDisk, "write", stops)
    with pytest.raises(StartError, match="stopped by the user") as error:
        options.ranks_for(case_of(), None)
    assert error.value.status == 130


@pytest.mark.parametrize("word", ["0", "-1", "many", "1.5"])
def test_other_words_are_refused(word, tmp_path):
    done = runs.disk(tmp_path / "disk", "--pressure-cm", "0:1", f"--ranks={word}")
    assert done.status == 2 and done.err.count("\n") == 1 and f"{word!r} is neither auto nor a number" in done.err
    assert not (tmp_path / "disk").exists()


@needs_mpirun
def test_two_ranks_by_an_option_are_one_rank_in_all_but_the_closing_line(limited, tmp_path):
    words = [word for word in runs.SOFT if word != "--quiet"]
    done = runs.disk(tmp_path / "disk", *words, "--ranks", 2)
    assert done.status == 3 == limited[1].status and limited[1].err.replace(str(limited[0]), "")[:60] in done.err
    assert "2 ranks" in done.err
    runs.same(runs.rows(tmp_path / "disk"), runs.rows(limited[0]), 1e-8)


@needs_mpirun
@pytest.mark.parametrize("number", sampled([signal.SIGINT, signal.SIGTERM]))
def test_ranks_are_stopped_as_one_is(number, tmp_path):
    folder = tmp_path / "disk"
    process = runs.start(*runs.DISK, "--output", folder, "--pressure-cm", "0:177:1", "--quiet", "--ranks", 2)
    while process.poll() is None and not (folder / "path.csv").exists():
        time.sleep(0.005)
    process.send_signal(number)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    assert "Traceback" not in err and err.count("stopped by the user") == 1 and "--resume" in err
    states = len(runs.rows(folder))
    assert 0 < states < 177 and runs.readable(folder) == states


@pytest.mark.campaign
@needs_mpirun
def test_ranks_end_with_a_command_that_is_killed(tmp_path):
    folder = tmp_path / "disk"
    process = runs.start(*runs.DISK, "--output", folder, "--pressure-cm", "0:177:0.1", "--quiet", "--ranks", 2)
    while process.poll() is None and not (folder / "path.csv").exists():
        time.sleep(0.005)
    process.kill()
    process.communicate(timeout=60)  # which waits for the ranks too: they hold its streams
    assert len(runs.rows(folder)) < 1770


@pytest.mark.campaign
@needs_mpirun
def test_the_bar_is_drawn_on_the_terminal_of_the_command(tmp_path):
    master, slave = pty.openpty()
    words = [sys.executable, "-m", "softmodels.disk", "--section", "axisymmetric", "--no-pictures", "--ranks", "2"]
    process = subprocess.Popen(
        [*words, "--pressure-cm", "0:5", "-o", str(tmp_path / "disk")], stderr=slave, stdout=subprocess.DEVNULL
    )
    os.close(slave)
    shown = b""
    while True:
        try:
            piece = os.read(master, 4096)
        except OSError:
            break
        if not piece:
            break
        shown += piece
    os.close(master)
    assert process.wait() == 0 and b"left" in shown and b"\x1b[" in shown
