"""Python programs one after another, each in a process forked from one that has imported what takes its time.

Nothing that is imported ahead starts MPI, so that each program starts its own.
"""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
import types
from pathlib import Path

AHEAD = """
import json, os, runpy, sys
import gmsh, h5py, matplotlib.pyplot, pyvista, scipy.interpolate, ufl
import measurement.series.measuring, softmodels.cli.options, softmodels.fitting.outlines.fit, softmodels.runs.simulation

assert "mpi4py.MPI" not in sys.modules
for line in sys.stdin:
    words, folder = json.loads(line)
    if child := os.fork():
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
        continue
    for number, name in enumerate((os.devnull, "out.txt", "err.txt")):
        os.dup2(os.open(os.path.join(folder, name), os.O_RDWR | os.O_CREAT | os.O_TRUNC), number)
    os.chdir(folder)
    if words[0] == "-m":
        sys.argv, sys.path[0] = words[1:], folder
        runpy.run_module(words[1], run_name="__main__", alter_sys=True)
    else:
        sys.argv, sys.path[0] = words, os.path.dirname(words[0])
        runpy.run_path(words[0], run_name="__main__")
    break
"""


@contextlib.contextmanager
def forks():
    """Provide a function that runs Python with these words in a folder: ``status``, ``out`` and ``err``."""
    top = Path(__file__).parents[2]  # where ``python -m`` finds the packages, as the page's reader does by installing them
    process = subprocess.Popen([sys.executable, "-c", AHEAD], cwd=top, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def run(words, folder):
        print(json.dumps([list(map(str, words)), str(folder)]), file=process.stdin, flush=True)
        status = int(process.stdout.readline())
        out, err = ((Path(folder) / name).read_text() for name in ("out.txt", "err.txt"))
        return types.SimpleNamespace(status=status, out=out, err=err)

    try:
        yield run
    finally:
        process.stdin.close()
        process.wait()
