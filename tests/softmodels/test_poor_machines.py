"""Machines that lack something: what is missing is named, and nothing else is blamed for it."""

from __future__ import annotations

import sys

import pytest

from tests.support import runs

RUN = """
import sys
from pathlib import Path
import softmodels.mechanics.iterative, softmodels.mechanics.mpi
{change}
from softmodels.{module} import {names}
{main}
"""
DISK = {"module": "disk", "names": "command, main", "main": "main(command)"}
WHOLE = {"module": "__main__", "names": "main", "main": "main()"}
SMALL = ("--pressure-cm", "0:20", "--section", "axisymmetric", "--no-pictures")
NO_MEMORY = "softmodels.mechanics.iterative.OUT_OF_MEMORY = (0,)"  # what MUMPS reports where all is well
NO_SHARED_MEMORY = "softmodels.mechanics.mpi.SHARED_MEMORY = Path('/proc/none')"


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="/proc and /dev/shm are Linux's")
@pytest.mark.parametrize(
    ("program", "words", "change", "told"),
    [
        (DISK, SMALL, NO_MEMORY, "out of memory; use a larger --cell-size"),
        (WHOLE, ("limit", "--variant", "shadow"), NO_MEMORY, "out of memory; use a larger --cell-size"),
        (DISK, SMALL, NO_SHARED_MEMORY, "needs shared memory, and /proc/none cannot be written"),
        (WHOLE, ("limit", "--variant", "shadow"), "", "kernel cache /proc/none/fenics cannot be used"),
    ],
)
def test_what_is_missing_is_named(program, words, change, told, tmp_path, monkeypatch):
    if not change:
        monkeypatch.setenv("XDG_CACHE_HOME", "/proc/none")
    done = runs.run("-c", RUN.format(change=change, **program), *words, cwd=tmp_path)
    last = done.err.strip().splitlines()[-1]
    assert done.status == 1 and told in last and "Traceback" not in done.err, done.err
    assert "refine the mesh" not in last and "free some disk space" not in last


BLOCKED = """
import runpy, sys
class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("dolfinx", "dolfinx_solver", "petsc4py", "slepc4py", "mpi4py", "ufl", "basix", "ffcx"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Missing())
sys.argv = sys.argv[1:]
runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
"""


def test_photographs_curves_and_meshes_need_no_fenicsx(tmp_path):
    (tmp_path / "pull.csv").write_text("stretch,stress_kPa\n" + "".join(
        f"{1 + k / 10:.1f},{28 * (1 + k / 10 - (1 + k / 10) ** -2):.4f}\n" for k in range(1, 15)
    ))  # fmt: skip
    fit = ("softmodels", "fit", "--tensile", "pull.csv", "--material", "yeoh", "--no-pictures", "-o", "fit")
    for words in (fit, ("geometries", "HollowDisk", "-o", "disk.msh"), ("measurement", "--help")):
        done = runs.run("-c", BLOCKED, *words, cwd=tmp_path)
        assert done.status == 0, done.err
    assert (tmp_path / "fit" / "fitted.toml").is_file() and (tmp_path / "disk.msh").is_file()
    done = runs.run("-c", BLOCKED, "softmodels", "run", "--device", "Balloon", "--pressure-cm", "0:2", cwd=tmp_path)
    assert done.status == 1 and "the simulation needs FEniCSx (softmodels doctor lists what is missing)" in done.err
