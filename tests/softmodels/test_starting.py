"""What a command does before it solves: what it loads, and how ranks wait for each other."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
from pathlib import Path

import pytest

from softmodels.cli.ending import main
from softmodels.common.commands import unswept
from softmodels.disk import command
from softmodels.mechanics import mpi
from tests.support.campaigns import sampled

LOOKS = "MPIR_CVAR_CH4_PROGRESS_THROTTLE_NO_PROGRESS_COUNT"
HOOKS, LOCAL = "UCX_MEM_MMAP_HOOK_MODE", "MPI_LOCALNRANKS"


@pytest.fixture
def looks(monkeypatch):
    """Return a function that gives how often a waiting rank of some looks for messages, on some cores."""

    def found(ranks, cores, before=None):
        monkeypatch.setattr(mpi.processes, "cores", lambda: cores)
        for name, value in (("MPI_LOCALNRANKS", ranks), (LOOKS, before)):
            if value is None:
                monkeypatch.delenv(name, raising=False)
            else:
                monkeypatch.setenv(name, value)
        mpi.start()
        return int(os.environ[LOOKS])

    monkeypatch.setenv(LOOKS, "64")  # put back after the test
    return found


@pytest.mark.parametrize(
    ("ranks", "cores", "wanted"),
    [("2", 2, 16384), ("2", 8, 16384), ("3", 2, 64), ("2", 1, 64), (None, 8, 64), ("two", 8, 64)],
)
def test_ranks_with_a_core_each_look_often_for_messages(looks, ranks, cores, wanted):
    """Another launcher than MPICH's does not tell how many there are on this machine."""
    assert looks(ranks, cores) == wanted


def test_a_users_own_choice_of_how_ranks_wait_stands(looks):
    assert looks("2", 8, before="7") == 7


@pytest.mark.parametrize(
    ("ranks", "beside", "wanted"),
    [(None, None, True), ("2", "2", True), ("1", None, True), ("4", "2", False), ("2", None, False)],
    ids=["alone", "one machine", "one rank", "several machines", "another launcher"],
)
def test_mpi_uses_a_network_only_where_its_ranks_may_be_on_several_machines(monkeypatch, ranks, beside, wanted):
    for name, value in (("PMI_RANK", "0" if ranks else None), ("PMI_SIZE", ranks), (LOCAL, beside)):
        monkeypatch.delenv(name, raising=False)
        if value is not None:
            monkeypatch.setenv(name, value)
    for name in mpi.ONE_MACHINE:
        monkeypatch.delenv(name, raising=False)
    with mpi._no_network():
        assert all(os.environ.get(name) == (value if wanted else None) for name, value in mpi.ONE_MACHINE.items())
    assert not set(mpi.ONE_MACHINE) & set(os.environ)  # a program that this one starts may span several machines
    monkeypatch.setenv(HOOKS, "bistro")
    with mpi._no_network():
        assert os.environ[HOOKS] == "bistro"  # a user's own choice
    assert os.environ[HOOKS] == "bistro"


LISTENING = """
import os
from pathlib import Path
from softmodels.mechanics.mpi import start
start().barrier()

def sockets(process):
    found = set()
    for handle in Path(f"/proc/{process}/fd").iterdir():
        if handle.is_symlink() and (target := os.readlink(handle)).startswith("socket:["):
            found.add(target[8:-1])
    return found

own = sockets(os.getpid()) - sockets(os.getppid())  # a launcher's are its own, and this process has copies of them
for kind in ("tcp", "tcp6", "udp", "udp6"):
    for line in Path(f"/proc/net/{kind}").read_text().splitlines()[1:]:
        place, state, number = (line.split()[column] for column in (1, 3, 9))
        if number in own and state in ("0A", "07") and not place.startswith(("0100007F", "0" * 24 + "01000000")):
            print("listens on", kind, place)
print("looked at", len(own))
"""
"""Prints where a process listens beyond this machine once MPI has started; 0A and 07 are Linux' states of such sockets."""


@pytest.mark.skipif(not Path("/proc/net/tcp").exists(), reason="needs Linux' list of sockets")
@pytest.mark.parametrize("network", ["ucx", "ofi"])
@pytest.mark.parametrize("ranks", sampled([2, 1]))
def test_no_solver_process_listens_beyond_this_machine(ranks, network):
    """Both libraries that MPICH sends by: the wheel's choice, and that of conda-forge's build."""
    words = [sys.executable, "-c", LISTENING]
    launcher = ["mpirun", "-n", str(ranks)] if ranks > 1 else []
    environment = {**os.environ, "MPIR_CVAR_CH4_NETMOD": network}
    done = subprocess.run([*launcher, *words], capture_output=True, text=True, check=True, env=environment)
    assert done.stdout.count("looked at") == ranks and "listens" not in done.stdout, done.stdout


SMALL = ("--section=axisymmetric", "--cell-size=6mm", "--pressure-cm=0,5", "--no-pictures", "--quiet")
LOADED = """
import sys
from softmodels.cli.ending import main
from softmodels.disk import command
try:
    main(command)
finally:
    print(*sys.modules)
"""


@pytest.mark.campaign
def test_a_section_is_solved_without_what_it_has_no_use_for(tmp_path):
    words = [sys.executable, "-c", LOADED, *SMALL, "--output", str(tmp_path / "disk")]
    subprocess.run(words, capture_output=True, check=True)  # the first may have to compile the equations
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    loaded = set(done.stdout.split())
    assert {"dolfinx", "h5py", "softmodels.path.stability"} <= loaded
    assert not loaded & {"dolfinx_solver", "dolfinx.fem.petsc", "pycparser", "pint", "matplotlib", "pyvista", "scipy"}
    assert not loaded & {"geometries.seminar", "geometries.balloon"}


def test_the_list_of_commands_needs_no_numbers():
    """Help is asked for more often than anything else: no numpy, no case, no device."""
    program = "import sys; from softmodels.__main__ import main\ntry: main()\nfinally: print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", program, "--help"], capture_output=True, text=True, check=True)
    assert "Simulate:" in done.stdout and "softmodels.cli.ending" in done.stdout
    assert not {"numpy", "softmodels.case.case", "geometries.disk", "softmodels.cli.options"} & set(done.stdout.split())


def test_photographs_and_designs_start_without_statistics():
    """SciPy's statistics, which its signal processing imports too, take as long as half a photograph."""
    program = (
        "import sys, measurement.series.measuring, softmodels.design.optimise, softmodels.design.study\nprint(*sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    loaded = set(done.stdout.split())
    assert "scipy.optimize" in loaded and not {"scipy.stats", "scipy.signal"} & loaded


@pytest.mark.parametrize("name", ["petsc4py-3.22.1.dist-info", "dolfinx_solver_complex-0.11.0.dist-info"])
def test_another_petsc_beside_the_wheels_is_refused_by_name(name, tmp_path):
    """The wheel's own check is asked where the name of a folder is a reason to."""
    pytest.importorskip("dolfinx_solver")
    about = tmp_path / "packages" / name
    about.mkdir(parents=True)
    (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name.split('-')[0]}\nVersion: 1\n")
    words = [sys.executable, "-m", "softmodels.disk", *SMALL, "--output", str(tmp_path / "disk")]
    found = {**os.environ, "PYTHONPATH": os.pathsep.join([str(about.parent), *sys.path])}
    done = subprocess.run(words, capture_output=True, text=True, check=False, env=found, cwd=tmp_path)
    assert done.returncode == 1 and name.split("-")[0].replace("_", "-") in done.stderr, done.stderr
    assert "ninstall" in done.stderr and "Traceback" not in done.stderr and not (tmp_path / "disk").exists()


@pytest.mark.campaign
def test_equations_are_compiled_without_what_debuggers_read(tmp_path, monkeypatch):
    """That took two thirds of the compiler's time, and says nothing of the numbers."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    words = [sys.executable, "-m", "softmodels.disk", *SMALL, "--output", str(tmp_path / "disk")]
    subprocess.run(words, capture_output=True, check=True)
    modules = list((tmp_path / "fenics").glob("*.so"))
    assert len(modules) > 8 and not [file.name for file in modules if b".debug_info" in file.read_bytes()]


def test_the_collector_spares_what_is_loaded_and_no_more(monkeypatch, capsys):
    with unswept():
        assert not gc.isenabled()
    assert gc.isenabled() and gc.get_freeze_count() > 0
    monkeypatch.setattr(sys, "argv", ["softmodels.disk", "--help"])
    main(command)
    assert "--pressure-cm" in capsys.readouterr().out and gc.get_freeze_count() == 0


# -- Called as a library the programs leave the caller's process alone: no signal is handled, and any thread will do--


THREAD = """
import signal, sys, threading
from pathlib import Path

def handlers():
    return [line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith(("SigIgn", "SigCgt"))]

from geometries import HollowDisk
from softmodels.case.case import Case
from softmodels.case.load import steps_of
from softmodels.case.materials import material_from
from softmodels.cli.run import run
from softmodels.common.commands import RunOptions
import dolfinx_solver  # MPI's own handlers are set here

signal.signal(signal.SIGTERM, lambda *_: None)
before, ended = handlers(), []
case = Case(name="disk", actuator=HollowDisk(section="axisymmetric", cell_size=6e-3, refinement=1.0),
            material=material_from(None, {}), steps=steps_of(pressure_cm=(5.0,)))
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
from softmodels.case.load import steps_of
from softmodels.case.materials import material_from
from softmodels.cli.run import run
from softmodels.common.commands import RunOptions

case = Case(name="disk", actuator=HollowDisk(section="axisymmetric", cell_size=6e-3, refinement=1.0),
            material=material_from(None, {}), steps=steps_of(pressure_cm=(5.0,)))
with mock.patch("softmodels.runs.recording.record", side_effect=KeyboardInterrupt):
    try:
        run(case, Path("out"), RunOptions(quiet=True, no_pictures=True))
    except KeyboardInterrupt:
        print("interrupted")
assert run(case, Path("out"), RunOptions(quiet=True, no_pictures=True)) == 0
"""


def test_a_callers_interrupt_lets_go_of_the_folder(tmp_path):
    done = subprocess.run([sys.executable, "-c", INTERRUPTED], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout.split()[:1]) == (0, ["interrupted"]), done.stderr
