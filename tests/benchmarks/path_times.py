"""Time the default disk's path from 0 to 177 cm of water: equations from the cache, then the path itself, warm.

    OMP_NUM_THREADS=1 uv run python tests/benchmarks/path_times.py
    OMP_NUM_THREADS=1 uv run mpirun -n 2 python tests/benchmarks/path_times.py

The figures are the median of several runs in one process; the ratio of the two sections, taken in one run, is what a busy
machine leaves comparable.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from pathlib import Path

from geometries import HollowDisk
from softmodels.case.materials import DEFAULT
from softmodels.common.units import COLUMN
from softmodels.mechanics.body import Body
from softmodels.mechanics.mpi import is_root, on_root, start
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System
from softmodels.path.continuation import Continuation, trace

ROUNDS = 5


def main() -> None:
    comm = start()
    goals = [177 * COLUMN.pascal / DEFAULT.shear_modulus]
    if is_root(comm):
        print(f"{comm.size} rank(s)")
        print("| section | cells | equations, s | path, s | steps | factorisations |\n|---|---|---|---|---|---|")
    for section in ("axisymmetric", "wedge"):
        disk = HollowDisk(section=section)
        with tempfile.TemporaryDirectory() as folder:
            name = comm.bcast(folder)
            path = Path(name) / "disk.msh"
            on_root(comm, lambda disk=disk, path=path: disk.write(path))  # type: ignore[misc]
            body = Body.from_file(disk, path, comm)
        prepared, followed = [], []
        for _ in range(ROUNDS):
            began = time.perf_counter()
            equilibrium = Solver(System(body, DEFAULT))
            ready = time.perf_counter()
            points = list(trace(Continuation(equilibrium), goals))
            prepared.append(ready - began)
            followed.append(time.perf_counter() - ready)
        cells = body.mesh.topology.index_map(body.mesh.topology.dim).size_global
        if is_root(comm):
            print(
                f"| {section} | {cells} | {statistics.median(prepared):.2f} | {statistics.median(followed):.2f} | "
                f"{len(points) - 1} | {equilibrium.bordered.factorisations} |"
            )


if __name__ == "__main__":
    main()
