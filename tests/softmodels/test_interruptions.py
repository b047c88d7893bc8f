"""Runs that are stopped, killed or out of room: their states stay readable, and are gone on from to the same numbers."""

from __future__ import annotations

import errno
import itertools
import os
import random
import shutil
import signal
import time
from xml.etree import ElementTree

import h5py
import numpy as np
import pytest

from softmodels.runs import formats
from softmodels.runs.store import Results, ResultsError
from softmodels.runs.table import Row
from tests.benchmarks import kills
from tests.support import runs
from tests.support.campaigns import sampled

STEPS = ("--pressure-cm", "0:177:5", "--quiet")
LIMITED = """
import resource, signal, sys
from softmodels.mechanics.mpi import start
sys.argv[0] = "disk"  # PETSc takes -c for an option
start()  # MPI makes large files of its own
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
size = int(sys.argv.pop(1))
resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
from softmodels.cli.ending import main
from softmodels.disk import command
main(command)
"""
KILLED = """
import os, signal, sys
from softmodels.runs.store import Results
count, add = int(sys.argv.pop(1)), Results.add
def add_and_die(self, *step):
    add(self, *step)
    if len(self.stored) == count:
        os.kill(os.getpid(), signal.SIGKILL)
Results.add = add_and_die
sys.argv[0] = "disk"
from softmodels.cli.ending import main
from softmodels.disk import command
main(command)
"""


def wait_for_states(process, folder, count):
    """Return as soon as the table of a process under way has this many states."""
    while process.poll() is None:
        if (folder / "path.csv").exists() and len((folder / "path.csv").read_text().splitlines()) > count:
            return
        time.sleep(0.005)


@pytest.mark.parametrize(
    ("number", "states"), sampled([(signal.SIGINT, 2), (signal.SIGTERM, 6)]), ids=["interrupt", "terminate"]
)
def test_a_stopped_run_says_so_and_goes_on_to_the_same_numbers(number, states, whole, tmp_path):
    process = runs.start(*runs.DISK, "--output", tmp_path / "disk", *STEPS)
    wait_for_states(process, tmp_path / "disk", states)
    process.send_signal(number)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130 and out == "" and "Traceback" not in err
    assert err.count("\n") == 1 and "stopped by the user" in err and "--resume" in err and str(tmp_path) in err
    before = runs.rows(tmp_path / "disk")
    assert states <= len(before) < 37 and runs.readable(tmp_path / "disk") == len(before)
    assert f"({len(before)} states)" in err
    done = runs.disk(tmp_path / "disk", *STEPS, "--resume")
    assert (done.status, done.out, done.err) == (0, "", "")
    assert runs.rows(tmp_path / "disk")[: len(before)] == before
    runs.same(runs.rows(tmp_path / "disk"), runs.rows(whole[0]), 1e-9)


@pytest.mark.campaign
def test_a_killed_run_is_readable_every_time_and_goes_on_to_the_same_numbers(whole, tmp_path):
    delay = random.Random(7)
    folder, reached = tmp_path / "disk", 0
    for states in (1, 3, 7, 12, 20):
        # Each of these goes on from where the one before it was killed.
        process = runs.start(*runs.DISK, "--output", folder, *STEPS, "--resume")
        wait_for_states(process, folder, states)
        time.sleep(0.03 * delay.random())
        process.kill()
        process.communicate(timeout=60)
        rows = runs.rows(folder)
        assert len(rows) >= max(states, reached)
        # The XDMF is replaced a moment after the table.
        assert 0 <= len(rows) - runs.readable(folder) <= 1
        reached = len(rows)
    done = runs.disk(folder, *STEPS, "--resume")
    assert (done.status, done.err) == (0, "")
    runs.same(runs.rows(folder), runs.rows(whole[0]), 1e-9)
    assert runs.readable(folder) == 37 and not (folder / "disk.steps").exists()


@pytest.mark.campaign
def test_a_file_that_cannot_grow_ends_the_run_and_loses_nothing(tmp_path):
    """The list of states outgrows the 75 kB that a file may have here; a state of its own takes 66 kB."""
    folder, many = tmp_path / "disk", ("--pressure-cm", "0:177:2", "--quiet")
    done = runs.run("-c", LIMITED, "75000", *runs.DISK[2:], "--output", folder, *many)
    assert done.status == 1 and done.out == "" and done.err.count("\n") == 1, done.err
    assert os.strerror(errno.EFBIG) in done.err and "--resume" in done.err
    before = runs.rows(folder)
    assert 5 < len(before) < 90 and runs.readable(folder) == len(before) - 1
    assert not list(folder.rglob("*.part"))
    assert runs.disk(folder, *many, "--resume").status == 0
    assert runs.disk(tmp_path / "whole", *many).status == 0
    runs.same(runs.rows(folder), runs.rows(tmp_path / "whole"), 1e-9)


@pytest.mark.parametrize("size", sampled([500, 20000]))
def test_a_disk_that_is_full_from_the_start_ends_the_run(size, tmp_path):
    done = runs.run("-c", LIMITED, str(size), *runs.DISK[2:], "--output", tmp_path / "disk", *STEPS)
    assert done.status == 1 and done.out == "" and done.err.count("\n") == 1 and "cannot be written" in done.err
    assert not list(tmp_path.rglob("*.part")) and not list(tmp_path.rglob("*.msh"))


@pytest.mark.campaign
@pytest.mark.parametrize("place", sampled(["requested", "limit"]))
def test_a_run_killed_between_two_steps_goes_on_to_the_same_limit(place, limited, tmp_path):
    rows = runs.rows(limited[0])
    # The last requested pressure is solved for between two steps, and so is the limit point.
    count = 1 + max(i for i, row in enumerate(rows) if row[place])
    assert (
        runs.run("-c", KILLED, str(count), *runs.DISK[2:], "--output", tmp_path / "disk", *runs.SOFT).status == -signal.SIGKILL
    )
    assert runs.rows(tmp_path / "disk") == rows[:count]
    again = runs.disk(tmp_path / "disk", *runs.SOFT, "--resume")
    assert again.status == 3 and again.err == limited[1].err.replace(str(limited[0]), str(tmp_path / "disk"))
    runs.same(runs.rows(tmp_path / "disk"), rows, 1e-9)


@pytest.fixture
def few(tmp_path):
    """Results of three made-up steps, not gathered."""
    results = Results(tmp_path / "few", "few")
    results.clear()
    results.begin(np.zeros((6, 3)), np.arange(6).reshape(1, 6), "Triangle_6")
    for step in range(3):
        fields = {"displacement": np.full((6, 3), step), "p": np.full(6, float(step))}
        results.add(formats.StateRecord(Row({"step": step, "pressure_cm": 10.0 * step}), fields, {"P": step}))
    return results


def again(results):
    """The same results as another process would find them: steps and pressures."""
    other = Results(results.folder, results.name)
    other.load()
    return [row["step"] for row in other.rows], [float(other.fields(i, ("p",))["p"][0]) for i in range(len(other.rows))]


def test_steps_that_cannot_be_gathered_stay_where_they_are(few, monkeypatch):
    before = sorted(few.folder.rglob("*"))
    with monkeypatch.context() as patch:
        patch.setattr(shutil, "disk_usage", lambda path: shutil._ntuple_diskusage(10**6, 10**6, 0))
        with pytest.raises(OSError, match=os.strerror(errno.ENOSPC)):
            few.finish()
    assert sorted(few.folder.rglob("*")) == before and again(few) == ([0, 1, 2], [0.0, 1.0, 2.0])
    few.finish()
    assert again(few) == ([0, 1, 2], [0.0, 1.0, 2.0])


@pytest.mark.parametrize("moment", range(3))
def test_gathering_may_be_cut_off_at_any_replacement(few, moment, monkeypatch):
    counter = itertools.count()
    rename = os.replace

    def cut_off(*paths):
        if next(counter) == moment:
            raise KeyboardInterrupt
        rename(*paths)

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", cut_off)
        with pytest.raises(KeyboardInterrupt):
            few.finish()
    assert again(few) == ([0, 1, 2], [0.0, 1.0, 2.0])
    xdmf = ElementTree.parse(few.folder / "few.xdmf")
    for place in (item.text.split(":") for item in xdmf.iter("DataItem") if item.text.endswith("/p")):
        with h5py.File(few.folder / place[0]) as file:
            assert len(file[place[1]]) == 6


def test_damaged_results_are_not_gone_on_from(few):
    few.heavy.write_bytes(few.heavy.read_bytes()[:100])
    with pytest.raises(ResultsError, match="cannot be read"):
        again(few)


@pytest.mark.parametrize("broken", sampled([lambda mesh, script: script, lambda mesh, script: mesh[: len(mesh) // 2]]))
@pytest.mark.parametrize("ranks", [1, 2])
def test_a_foreign_or_broken_mesh_is_made_anew_and_not_run(broken, ranks, whole, whole_copy, tmp_path):
    mesh, hit = whole_copy / "disk.msh", tmp_path / "hit"
    mesh.write_bytes(broken(mesh.read_bytes(), f'SystemCall "touch {hit}";\n'.encode()))
    launcher = () if ranks == 1 else ("mpirun", "-n", ranks)
    done = runs.disk(whole_copy, *STEPS, "--resume", launcher=launcher)
    assert (done.status, done.err) == (0, "") and not hit.exists()
    runs.same(runs.rows(whole_copy), runs.rows(whole[0]), runs.REPEATED)
    assert mesh.read_bytes() == (whole[0] / "disk.msh").read_bytes()


# -- A few of the random kills of ``tests/benchmarks/kills.py`` ------------------------------------------------------


@pytest.mark.campaign
def test_runs_killed_at_random_end_in_the_numbers_of_those_left_alone(tmp_path):
    count, faults = kills.campaign(["section", "limit", "cycle"], 3, 11, tmp_path)
    assert count == 3 and faults == []


def test_the_comparison_sees_what_it_should(tmp_path):
    one, other = tmp_path / "one.csv", tmp_path / "other.csv"
    one.write_text("step,pressure_cm,control,newton_iterations\n0,0.0,volume,2\n1,100.0,volume,2\n")
    other.write_text(one.read_text().replace("100.0", "100.0000002").replace("volume,2\n1", "volume,3\n1"))
    assert kills.differences(one, one) == {}
    assert list(kills.differences(one, other)) == ["pressure_cm"]
    other.write_text(one.read_text().replace("volume", "pressure"))
    assert list(kills.differences(one, other)) == ["control"]
    other.write_text("\n".join(one.read_text().splitlines()[:2]) + "\n")
    assert list(kills.differences(one, other)) == ["rows (2 against 1)"]


@pytest.mark.parametrize(("text", "alike"), [("1.0000003", True), ("1.0001", False), ('1"\nwall = "1.0', False)])
def test_a_resumed_design_may_differ_in_its_seventh_digit(tmp_path, text, alike):
    files = [tmp_path / name / "design.toml" for name in ("one", "other")]
    for file, number in zip(files, ("1.0", text), strict=True):
        file.parent.mkdir()
        file.write_text(f'rib = "{number} mm"\n')
    assert kills.alike(*files) is alike
