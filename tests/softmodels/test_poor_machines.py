"""Machines that lack something: what is missing is named, and nothing else is blamed for it."""

from __future__ import annotations

import sys

import pytest

RUN = """
import sys
from pathlib import Path
import softmodels.mechanics.direct, softmodels.mechanics.mpi
{change}
from softmodels.{module} import {names}
{main}
"""
DISK = {"module": "disk", "names": "command, main", "main": "main(command)"}
WHOLE = {"module": "__main__", "names": "main", "main": "main()"}
SMALL = ("--pressure-cm", "0:20", "--section", "axisymmetric", "--no-pictures")
NO_MEMORY = "softmodels.mechanics.direct.OUT_OF_MEMORY = (0,)"  # what MUMPS reports where all is well
NO_SHARED_MEMORY = "softmodels.mechanics.mpi.SHARED_MEMORY = Path('/proc/none')"


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="/proc and /dev/shm are Linux's")
@pytest.mark.parametrize(
    ("program", "words", "change", "told"),
    [
        (DISK, SMALL, NO_MEMORY, "memory is full; use a larger --cell-size"),
        (WHOLE, ("limit", "--variant", "shadow"), NO_MEMORY, "memory is full; use a larger --cell-size"),
        (DISK, SMALL, NO_SHARED_MEMORY, "needs shared memory, and /proc/none cannot be written"),
        (WHOLE, ("limit", "--variant", "shadow"), "", "cache of compiled equations, /proc/none/fenics, cannot be used"),
    ],
)
def test_what_is_missing_is_named(program, words, change, told, runs, tmp_path, monkeypatch):
    if not change:
        monkeypatch.setenv("XDG_CACHE_HOME", "/proc/none")
    done = runs.run("-c", RUN.format(change=change, **program), *words, cwd=tmp_path)
    last = done.err.strip().splitlines()[-1]
    assert done.status == 1 and told in last and "Traceback" not in done.err, done.err
    assert "refine the mesh" not in last and "make room for them" not in last
