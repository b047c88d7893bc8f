"""A notebook: run by an environment that uv lays over the project's own; interrupted, and going on. Another MPI is refused."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from softmodels.mechanics import mpi

TOP = Path(__file__).resolve().parents[2]
EXECUTE = """
import json, sys
import nbclient, nbformat

cells = json.loads(sys.stdin.read())
book = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(cell) for cell in cells])
nbclient.NotebookClient(book, timeout=300, kernel_name="python3", allow_errors=True).execute()
print(json.dumps([cell.outputs for cell in book.cells]))
"""
"""Executes cells in a kernel of the Python that it runs in, and prints their outputs."""
SETUP = """
import os, signal
import softmodels as sm
disk = sm.HollowDisk(section="axisymmetric", cell_size="6 mm", refinement=1.0)
"""
INTERRUPTED = """
def interrupt(row):
    if row["step"] == 2:
        os.kill(os.getpid(), signal.SIGINT)  # what the notebook's stop button sends
run = sm.inflate(disk, "ecoflex-00-30", "0:100 cm", progress=interrupt)
"""
CELLS = [
    SETUP,
    INTERRUPTED,
    'run = sm.inflate(disk, "ecoflex-00-30", "0:30 cm")\nprint(len(run), run.apex[-1] > 1e-4)\nrun.plot()',
]


def executed(launcher, folder):
    """Outputs of the cells, each a list."""
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("PYTHON", "VIRTUAL_ENV"))}
    environment |= {"OMP_NUM_THREADS": "1", "JUPYTER_PLATFORM_DIRS": "1", "IPYTHONDIR": str(folder / "ipython")}
    done = subprocess.run(
        [*launcher, "-c", EXECUTE], input=json.dumps(CELLS), capture_output=True, text=True, timeout=400, cwd=folder,
        env=environment, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def check(outputs):
    first, interrupted, last = outputs
    assert first == []
    assert [output["ename"] for output in interrupted if output["output_type"] == "error"] == ["KeyboardInterrupt"]
    errors = [output for output in last if output["output_type"] == "error"]
    assert not errors, errors
    words = "".join(output.get("text", "") for output in last)
    assert words.split()[1] == "True" and int(words.split()[0]) > 3
    assert any("image/png" in output.get("data", {}) for output in last)


def overlay():
    """How uv runs Python with two more packages laid over the environment; skips where it cannot."""
    uv = shutil.which("uv")
    if uv is None or not (TOP / ".venv").is_dir() or not Path(sys.executable).is_relative_to(TOP):
        pytest.skip("the environment is not uv's")
    # The last one is in no environment of the project's: with the other two alone uv would take that as it is.
    more = [word for name in ("nbclient", "ipykernel", "jupyter-console") for word in ("--with", name)]
    launcher = [uv, "run", "--quiet", "--project", str(TOP), "--no-sync", *more, "python"]
    look = [*launcher, "-c", "import nbclient, ipykernel, sys; print(sys.prefix)"]
    done = subprocess.run(look, capture_output=True, text=True, timeout=120, check=False)
    if done.returncode:
        pytest.skip(f"uv cannot lay nbclient over the environment: {done.stderr.strip()[:200]}")
    assert not Path(done.stdout.strip()).is_relative_to(TOP)
    return launcher


@pytest.mark.campaign
def test_a_notebook_in_an_environment_laid_over(tmp_path):
    check(executed(overlay(), tmp_path))


def test_mpich_is_found_by_its_own_record():
    library = mpi.mpich_file("libmpi.so.12")
    if library is None:
        pytest.skip("MPICH is no package of this Python")
    assert library.is_file() and mpi.mpich_file("mpirun").is_file() and mpi.mpich_file("no such file") is None


START = """
from softmodels.mechanics.mpi import StartError, start
try:
    start()
except StartError as error:
    print(error)
"""


@pytest.mark.parametrize("how", ["loaded", "MPI4PY_LIBMPI", "MPI4PY_MPIABI"])
def test_another_mpi_is_refused_by_a_sentence(how, tmp_path):
    library = mpi.mpich_file("libmpi.so.12")
    if library is None:
        pytest.skip("MPICH is no package of this Python")
    other = tmp_path / "libmpi.so.40"
    subprocess.run(["cc", "-shared", "-x", "c", os.devnull, "-o", str(other)], check=True)
    environment, text = dict(os.environ), START
    if how == "loaded":
        text = f"import ctypes\nctypes.CDLL({str(other)!r})\n" + START
    else:
        environment[how] = str(other) if how == "MPI4PY_LIBMPI" else "openmpi"
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, env=environment, check=False)
    words = "another MPI is loaded in this process" if how == "loaded" else f"the variable {how} selects another MPI"
    assert (done.returncode, done.stderr) == (0, "") and words in done.stdout and str(library) in done.stdout
