"""Called as a library the programs leave the caller's process alone: no signal is handled, and any thread will do."""

from __future__ import annotations

import subprocess
import sys

THREAD = """
import signal, sys, threading
from pathlib import Path

def handlers():
    return [line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith(("SigIgn", "SigCgt"))]

from geometries import HollowDisk
from softmodels.case.case import Case
from softmodels.case.materials import material_from
from softmodels.cli.run import run
from softmodels.common.commands import RunOptions
import dolfinx_solver  # MPI's own handlers are set here

signal.signal(signal.SIGTERM, lambda *_: None)
before, ended = handlers(), []
case = Case(name="disk", actuator=HollowDisk(section="axisymmetric", cell_size=6e-3, refinement=1.0),
            material=material_from(None, {}), pressures_cm=(5.0,))
thread = threading.Thread(target=lambda: ended.append(run(case, Path("out"), RunOptions(quiet=True, no_pictures=True))))
thread.start()
thread.join()
assert ended == [0], ended
assert handlers() == before, (before, handlers())
assert run(case, Path("out"), RunOptions(quiet=True, no_pictures=True)) == 0
assert handlers() == before, (before, handlers())
"""


def test_a_run_in_a_thread_sets_no_signal_handler(tmp_path):
    done = subprocess.run([sys.executable, "-c", THREAD], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out" / "path.csv").exists()


INTERRUPTED = """
from pathlib import Path
from unittest import mock

from geometries import HollowDisk
from softmodels.case.case import Case
from softmodels.case.materials import material_from
from softmodels.cli.run import run
from softmodels.common.commands import RunOptions

case = Case(name="disk", actuator=HollowDisk(section="axisymmetric", cell_size=6e-3, refinement=1.0),
            material=material_from(None, {}), pressures_cm=(5.0,))
with mock.patch("softmodels.runs.recording.record", side_effect=KeyboardInterrupt):
    try:
        run(case, Path("out"), RunOptions(quiet=True, no_pictures=True))
    except KeyboardInterrupt:
        print("interrupted")
assert run(case, Path("out"), RunOptions(quiet=True, no_pictures=True)) == 0
"""


def test_a_callers_interrupt_lets_go_of_the_folder(tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPTED], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout.split()[:1]) == (0, ["interrupted"]), done.stderr
