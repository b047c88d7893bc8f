"""An error on one rank ends them all with its sentence, and a signal ends ranks that wait for each other for ever."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import pytest

from tests.support.campaigns import sampled
from tests.support.ranks import PATIENT, mpirun

RUN = """
import sys
from softmodels.common import processes
from softmodels.mechanics import mpi
from softmodels.runs.fields import Fields
comm = mpi.start()
figures = Fields.figures
processes.GRACE_SECONDS = 1
def fails(self, state, values):
    if comm.rank == LAST:
        ERROR
    return figures(self, state, values)
Fields.figures = fails
sys.argv[1:] = ["--section", "axisymmetric", "--no-pictures", "--pressure-cm", "0:2", "-o", FOLDER, "--quiet"]
from softmodels.cli.ending import main
from softmodels.disk import command
main(command)
"""
ERRORS = {
    "not expected": ("raise ValueError('no such thing')", 1, "ValueError: no such thing"),
    "of the run": ("raise RunError('the bench is gone', 3)", 3, "softmodels: the bench is gone"),
    "of the memory": ("raise MemoryError", 1, "out of memory"),
    "of the disk": ("raise OSError(28, 'No space left on device')", 1, "No space left on device"),
    "an exit": ("sys.exit(5)", 5, ""),
}
WAITS = "Path(FOLDER).with_name('waits').touch(); time.sleep(3600)"


@pytest.fixture
def on_ranks(tmp_path):
    """A function that starts a disk's run on two ranks, of which one does something else than the other."""
    started = []

    def start(does, rank=1):
        words = RUN.replace("LAST", str(rank)).replace("ERROR", does).replace("FOLDER", repr(str(tmp_path / "disk")))
        program = tmp_path / "program.py"
        program.write_text(f"import time\nfrom pathlib import Path\nfrom softmodels.runs.outcomes import RunError\n{words}")
        environment = {**os.environ, **PATIENT, "OMP_NUM_THREADS": "1"}
        process = subprocess.Popen(
            [mpirun(), "-n", "2", sys.executable, str(program)], env=environment, start_new_session=True,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        started.append(process)
        return process

    yield start
    for process in started:
        if process.poll() is None:
            process.kill()  # with it its ranks


@pytest.mark.parametrize(("name", "rank"), sampled([("not expected", 0), *((name, 1) for name in ERRORS)]))
def test_an_error_on_one_rank_ends_all_with_its_sentence(name, rank, on_ranks):
    does, status, sentence = ERRORS[name]
    process = on_ranks(does, rank)
    _, err = process.communicate(timeout=120)
    assert process.returncode == status, err
    assert err.count(sentence) == 1 or not sentence, err
    assert ("Traceback" in err) == (name == "not expected")


def ranks_of(process):
    """The processes of the ranks."""
    found = subprocess.run(["ps", "-eo", "pid,ppid"], capture_output=True, text=True, check=True).stdout.split()[2:]
    parents = {int(own): int(parent) for own, parent in zip(found[::2], found[1::2], strict=True)}
    return [own for own, parent in parents.items() if parents.get(parent) == process.pid]


@pytest.mark.parametrize("receiver", sampled(["rank", "launcher"]))
def test_a_signal_ends_ranks_that_wait_for_ever(receiver, on_ranks, tmp_path):
    process, until = on_ranks(WAITS), time.monotonic() + 120.0
    while not (tmp_path / "waits").exists():
        assert process.poll() is None and time.monotonic() < until
        time.sleep(0.05)
    time.sleep(1.0)  # the other one waits too, in compiled code
    os.kill(process.pid if receiver == "launcher" else min(ranks_of(process)), signal.SIGTERM)
    _, err = process.communicate(timeout=60)
    assert process.returncode != 0 and err.count("stopped by the user") == 1, err
