"""Time the default seminar actuator's path from 0 to 177 cm of water and say what it is spent on.

    OMP_NUM_THREADS=1 uv run python tests/benchmarks/seminar.py
    OMP_NUM_THREADS=1 uv run mpirun -n 2 python tests/benchmarks/seminar.py

Equations come from the cache (run once before to fill it). The split is PETSc's own log, as -log_view prints it, with the
assembly in events of its own; events overlap where one calls another, and "other" is what is left. The largest rank counts.

Measured on two cores (88,570 unknowns, 8 states, 20 Newton iterations, tip 14.842 mm): the path takes 37 s on one rank, with
factors in single precision. Back-substitutions take 44 % of path and figures, products with the tangent and vectors 31 %,
factorisations 15 %, the figures of the states 13 % (the tip's stiffness is a solve of its own). A factorisation with its
assembly costs about as much as 30 iterations of GMRES.

The whole command is timed by `tests/benchmarks/waiting.py`.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from geometries import SeminarActuator
from softmodels.common.units import pascal_per_cm
from softmodels.materials.silicones import SILICONES
from softmodels.mechanics.body import Body
from softmodels.mechanics.mpi import is_root, largest, on_root, start
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System
from softmodels.path.continuation import Continuation, trace
from softmodels.runs.fields import Fields

PETSC_EVENTS = {"factorisation": ("MatCholFctrSym", "MatCholFctrNum"), "solves with the factors": ("MatSolve",)}
OWN_EVENTS = {
    "assembly of the tangent": "assemble_tangent",
    "assembly of vectors and products": "assemble",
    "search for cells turned inside out": "smallest_J",
}


def timed(event: Any, task: Callable[..., Any]) -> Callable[..., Any]:
    """The task within a PETSc event."""

    def run(*args: Any, **named: Any) -> Any:
        event.begin()
        try:
            return task(*args, **named)
        finally:
            event.end()

    return run


def main() -> None:
    comm = start()
    from petsc4py import PETSc

    PETSc.Log.begin()
    slab, law = SeminarActuator(), SILICONES["ecoflex-00-30"].material
    with tempfile.TemporaryDirectory() as folder:
        mesh = Path(comm.bcast(folder)) / "slab.msh"
        began = time.perf_counter()
        on_root(comm, lambda: slab.write(mesh))
        meshed = time.perf_counter() - began
        body = Body.from_file(slab, mesh, comm)
    began = time.perf_counter()
    equations = Solver(System(body, law))
    fields = Fields(equations)
    prepared = time.perf_counter() - began
    events = {label: PETSc.Log.Event(label) for label in OWN_EVENTS}
    for label, name in OWN_EVENTS.items():
        setattr(equations.system, name, timed(events[label], getattr(equations.system, name)))

    began, told = time.perf_counter(), 0.0
    count = iterations = 0
    for point in trace(Continuation(equations), [177 * pascal_per_cm() / equations.system.stress_unit]):
        count, iterations = count + 1, iterations + point.state.iterations
        at = time.perf_counter()
        figures = fields.figures(point.state)
        told += time.perf_counter() - at
    path = time.perf_counter() - began - told

    parts = {label: event.getPerfInfo()["time"] for label, event in events.items()}
    for label, names in PETSC_EVENTS.items():
        parts[label] = sum(PETSc.Log.Event(name).getPerfInfo()["time"] for name in names)
    parts = {label: largest(comm, seconds) for label, seconds in parts.items()}
    parts["figures of the states"] = largest(comm, told)
    dofs = equations.system.space.dofmap.index_map.size_global * equations.system.space.dofmap.index_map_bs
    if not is_root(comm):
        return
    print(f"{comm.size} rank(s), {dofs:,} unknowns, {count} states, {iterations} Newton iterations")
    print(
        f"tip {figures.device['tip_z_mm']:.3f} mm; mesh {meshed:.1f} s, equations {prepared:.1f} s, path {path:.1f} s"
    )
    print("| part | seconds | share of path and figures |\n|---|---|---|")
    whole = path + told
    parts["other"] = whole - sum(parts.values())
    for label, seconds in sorted(parts.items(), key=lambda part: -part[1]):
        print(f"| {label} | {seconds:.1f} | {100 * seconds / whole:.0f} % |")


if __name__ == "__main__":
    main()
