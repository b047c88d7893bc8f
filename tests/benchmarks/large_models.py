"""The thin disk's wedge from rest through its limit point by the iterative solver: iterations, time and memory as it grows.

One model per process, so that the peak of its memory is its own; rows gather in a folder:

    python tests/benchmarks/large_models.py run FOLDER --angle 15 --cell-size 8
    python tests/benchmarks/large_models.py run FOLDER --cell-size 8
    python tests/benchmarks/large_models.py run FOLDER --cell-size 8 --solver direct
    mpirun -n 2 python tests/benchmarks/large_models.py run FOLDER --cell-size 1
    python tests/benchmarks/large_models.py table FOLDER

Cells are in mm. ``--one`` solves one state at 1 cm alone, for models whose whole path takes too long. ``table`` prints a row
per run with the exponents between neighbouring sizes, and draws ``iterations.png``: those of the linear solve for the path's
direction, to 1e-5, against the arc length.

Figures of one machine (read ratios; CPU seconds of a rank), all from rest through the limit point and two states past it:

- One rank, ``--angle 15``: 17,300 unknowns, 1,901 cycles and 10 set-ups in 10.4 s, 54 MB (57 foretold). The whole wedge with
  cells of 3, 1.1 and 0.71 mm: 37,120, 70,113 and 181,940 unknowns, 1,319, 1,493 and 1,544 cycles in 17.6, 42.3 and 121 s,
  107, 188 and 486 MB (107, 189 and 476 foretold).
- The same with ``--solver direct``: 472 to 477 back-substitutions and 7 factorisations in 16.4, 35.3 and 155 s, 202, 388 and
  1,241 MB (189, 372 and 1,235 foretold); the last two on two ranks 23.4 and 111 s, 570 and 1,673 MB (523 and 1,621 foretold).
- A cycle takes 3.3, 7.8 and 18 ms at 17,300, 37,120 and 70,113 unknowns, a set-up 0.08, 0.19 and 0.38 s.
- Two ranks: 70,113, 181,940 and 1,054,962 (0.363 mm) unknowns, limit points at 52.943466, 52.941637 and 52.940303 cm (the
  section's: 52.94014), 1,461, 1,605 and 2,315 cycles, 22.4, 64.9 and 621 s, 0.225, 0.558 and 3.07 GB beside the model (the last
  with ``--one``; 3.17 foretold): exponents 1.23 of time and 0.96 of memory. Iterations 7 to 14, 7 to 14 and 8 to 21; at the
  limit point 7, 7 and 12.
- ``--one --cell-size 2`` on 1, 2, 4 and 8 ranks of two cores: 38,662 unknowns in 25, 24, 24 and 24 iterations, 218, 217, 214
  and 216 cycles.
- GAMG from the quadratic displacements on, which came before: 37,120 unknowns, 1,910 cycles and 83.0 s on one rank; 70,113,
  2,477 cycles and 174 s on two, 0.67 GB; 1,054,962 (0.363 mm), 2,988 cycles and 3,457 s, 10.3 GB, limit point 52.940303 cm.
"""

from __future__ import annotations

import argparse
import csv
import ctypes
import itertools
import math
import resource
import tempfile
import time
from pathlib import Path

PRESSURES_CM = (80.0,)
"""Requested; the limit point lies below."""
STATES_PAST = 2
"""States past the limit point."""
COLUMNS = (
    "unknowns",
    "ranks",
    "solver",
    "states",
    "cycles",
    "set_ups",
    "seconds",
    "cpu_s",
    "first_set_up_s",
    "estimate_GB",
    "taken_GB",
    "peak_GB",
)
STATE_COLUMNS = (
    "arc", "pressure_cm", "volume", "limit", "newton", "iterations", "cycles", "set_ups", "seconds", "negative", "lowest"
)  # fmt: skip


class Counted:
    """Products with what stands for the inverse, counted."""

    def __init__(self, bordered):
        self.count, self._apply = 0, bordered.inverse.apply
        bordered.inverse.apply = self

    def __call__(self, b, x):
        self.count += 1
        self._apply(b, x)


def run(folder: Path, angle: float, cell_mm: float, solver_name: str, one: bool) -> None:
    """Solve one model, and add its row and its states to the folder."""
    from softmodels.mechanics.mpi import start

    comm = start()
    from geometries import HollowDisk
    from softmodels.case.materials import DEFAULT
    from softmodels.mechanics import solver as solver_module
    from softmodels.mechanics.body import Body
    from softmodels.mechanics.mpi import needed, on_root
    from softmodels.mechanics.solver import Solver
    from softmodels.mechanics.system import System
    from softmodels.path.stability import Stability

    disk = HollowDisk.variant("shadow", angle=angle, cell_size=cell_mm * 1e-3)
    with tempfile.TemporaryDirectory() as place:
        file = Path(comm.bcast(place)) / "wedge.msh"
        on_root(comm, lambda: disk.write(file))
        body = Body.from_file(disk, file, comm)
        comm.barrier()
    system = System(body, DEFAULT)
    system.rest()
    system.assemble_tangent()
    unknowns, begun = system.K.getSize()[0], time.perf_counter()
    busy = time.process_time()
    ctypes.CDLL(None).malloc_trim(0)  # what reading the mesh has freed would be taken again, and not be counted
    _, before = needed(comm, _now())
    solver_module.AMPLE_FACTORISATION_BYTES = math.inf
    estimate = solver_module.select_solver(system, solver_name).memory
    solver = Solver(system, solver_name)
    counted = Counted(solver.bordered)
    Stability.of(solver)  # its mass matrix is made first, as at the beginning of a path
    began = time.process_time()
    solver.factorise(system.rest())
    first = time.process_time() - began
    name, rows = f"states-{solver.method.name}-{unknowns}-{comm.size}.csv", []
    for state in [_one(solver, counted)] if one else _states(solver, counted):
        rows.append(state)
        on_root(comm, lambda: _write_states(folder / name, rows))
    _, peak = needed(comm, _peak())
    whole, busy = time.perf_counter() - begun, needed(comm, time.process_time() - busy)[0]
    values = (unknowns, comm.size, solver.method.name, len(rows), counted.count, solver.bordered.factorisations)
    sizes = (estimate, peak - before, peak)
    row = (*values, f"{whole:.1f}", f"{busy:.1f}", f"{first:.2f}", *(f"{size / 1e9:.4f}" for size in sizes))
    on_root(comm, lambda: _write(folder, row))


def _one(solver, counted):
    """The state at 1 cm, with its direction and its lowest eigenvalue, as a row of a path."""
    from softmodels.mechanics.controls import pressure_control
    from softmodels.path.stability import Stability

    system, begun = solver.system, time.perf_counter()
    P = 95.1 / system.stress_unit
    state = solver.solve(pressure_control(P), system.rest().w, P)
    solver.factorise(state)
    solver.tangent(state, pressure_control(P))
    iterations = solver.newton.snes.getKSP().getIterationNumber()
    found = Stability.of(solver).signature(exact=True)
    return (
        0.0, 1.0, state.V, 0, state.iterations, iterations, counted.count, solver.bordered.factorisations,
        f"{time.perf_counter() - begun:.2f}", found.negative_eigenvalues, found.lowest,
    )  # fmt: skip


def _states(solver, counted):
    """A row of each state up to the limit point and a little past it."""
    from softmodels.path.continuation import Continuation, trace
    from softmodels.path.stability import PathEnd

    system = solver.system
    path = Continuation(solver, control="volume")
    goals = [cm * 95.1 / system.stress_unit for cm in PRESSURES_CM]
    arc, last, begun, cycles, past = 0.0, None, time.perf_counter(), counted.count, 0
    try:
        for point in trace(path, goals):
            if last is not None:
                step = (point.state.V - last.V, point.state.P - last.P)
                arc += path.plane.product(step, step) ** 0.5
            last = point.state
            iterations = solver.newton.snes.getKSP().getIterationNumber()
            pressure = f"{last.P * system.stress_unit / 95.1:.8g}"
            yield (
                f"{arc:.6g}", pressure, last.V, int(point.limit), last.iterations, iterations,
                counted.count - cycles, solver.bordered.factorisations, f"{time.perf_counter() - begun:.2f}",
                point.signature.negative_eigenvalues, point.signature.lowest,
            )  # fmt: skip
            cycles = counted.count
            past += int(past > 0 or point.limit)
            if past > STATES_PAST:
                return
    except PathEnd:
        return


def _peak() -> float:
    """Bytes of this process at most so far."""
    return 1024.0 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def _now() -> float:
    """Bytes of this process now; on Linux."""
    return float(next(line for line in Path("/proc/self/status").open() if line.startswith("VmRSS")).split()[1]) * 1024.0


def _write_states(file: Path, rows) -> None:
    """Store all states so far, and show the last."""
    file.parent.mkdir(parents=True, exist_ok=True)
    with file.open("w", newline="") as table:
        csv.writer(table).writerows([STATE_COLUMNS, *rows])
    print(dict(zip(STATE_COLUMNS, rows[-1], strict=True)), flush=True)


def _write(folder: Path, row) -> None:
    table = folder / "runs.csv"
    new = not table.exists()
    with table.open("a", newline="") as file:
        writer = csv.writer(file)
        writer.writerows([COLUMNS, row] if new else [row])
    print(dict(zip(COLUMNS, row, strict=True)))


def table(folder: Path) -> None:
    """Print the runs and the exponents between them; draw iterations against arc length."""
    import matplotlib

    matplotlib.use("agg")
    from matplotlib import pyplot

    with (folder / "runs.csv").open() as file:
        found = sorted(csv.DictReader(file), key=lambda run: (run["solver"], int(run["ranks"]), int(run["unknowns"])))
    print("  ".join(f"{name:>14}" for name in (*COLUMNS, "time_exponent", "memory_exponent")))
    for before, now in itertools.pairwise([None, *found]):
        alike = before is not None and all(before[name] == now[name] for name in ("solver", "ranks"))
        powers = [""] * 2
        if alike and float(now["unknowns"]) > float(before["unknowns"]):
            growth = math.log(float(now["unknowns"]) / float(before["unknowns"]))
            powers = [f"{math.log(float(now[k]) / float(before[k])) / growth:.2f}" for k in ("cpu_s", "taken_GB")]
        print("  ".join(f"{text:>14}" for text in (*(now[name] for name in COLUMNS), *powers)))
    figure, axes = pyplot.subplots(figsize=(7, 4))
    for one in found:
        with (folder / f"states-{one['solver']}-{one['unknowns']}-{one['ranks']}.csv").open() as file:
            states = list(csv.DictReader(file))
        x, y = ([float(state[name]) for state in states] for name in ("arc", "iterations"))
        axes.plot(x, y, ".-", label=f"{one['unknowns']} unknowns, {one['solver']}")
        at = [i for i, state in enumerate(states) if state["limit"] == "1"]
        axes.plot([x[i] for i in at], [y[i] for i in at], "kx")
    axes.set(xlabel="arc length (crosses: limit points)", ylabel="iterations to 1e-5", ylim=(0, None))
    axes.legend()
    figure.savefig(folder / "iterations.png", dpi=150, bbox_inches="tight")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("run", "table"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--angle", type=float, default=45.0, help="of the wedge, degrees")
    parser.add_argument("--cell-size", type=float, default=8.0, help="mm")
    parser.add_argument("--solver", choices=("direct", "iterative"), default="iterative")
    parser.add_argument("--one", action="store_true", help="one state at 1 cm alone")
    given = parser.parse_args()
    if given.what == "table":
        table(given.folder)
    else:
        run(given.folder, given.angle, given.cell_size, given.solver, given.one)


if __name__ == "__main__":
    main()
