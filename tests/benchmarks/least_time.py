"""Where the CPU time of a path goes, and the least that its linear algebra needs on this machine.

    OMP_NUM_THREADS=1 uv run python tests/benchmarks/least_time.py [section] [wedge] [finger] [half]

The least is what a path's own solves need at the limits of the machine, which are measured first, on one core:

- a back-substitution or a product reads the factors twice or the matrix once, at the memory's bandwidth;
- a factorisation does its multiplications at the rate of a dense product in its precision;
- each state costs one residual, each factorisation one tangent, both by compiled forms.

Everything is warm, and meshing, imports and files are left out; rows and fields of each state are in.
"""

from __future__ import annotations

import collections
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest import mock

import numpy as np

from geometries import Actuator, HollowDisk, PneuNet, SeminarActuator
from softmodels.case.case import Case
from softmodels.case.materials import DEFAULT
from softmodels.common import units
from softmodels.mechanics import newton, solver, system
from softmodels.mechanics.mpi import start
from softmodels.path import stability, steps
from softmodels.runs.simulation import Simulation

MODELS: dict[str, tuple[Callable[[], Actuator], float]] = {
    "section": (lambda: HollowDisk(section="axisymmetric"), 177.0),
    "wedge": (HollowDisk, 177.0),
    "finger": (PneuNet, 12.0),
    "half": (SeminarActuator, 177.0),
}
"""Devices, and the heights in cm of water that their paths go to."""
TIMED = {
    "back-substitutions": (newton.Factorisation, "apply"),
    "products": (system.System, "tangent_product"),
    "tangents": (system.System, "assemble_tangent"),
    "factorisations": (newton.Factorisation, "_factorise"),
    "residuals": (newton.Newton, "_residual"),
    "rows and fields": (Simulation, "step_of"),
}
"""What a path consists of; none calls another."""
WHOLE = {
    "Newton's method": (solver.Solver, "solve"),
    "tangents of the path": (solver.Solver, "tangent"),
    "eigenvalues": (stability.Stability, "wants"),
}
"""What these are for."""


class Clock:
    """Calls and CPU seconds by name."""

    def __init__(self) -> None:
        self.calls, self.seconds = collections.Counter[str](), collections.Counter[str]()

    @contextmanager
    def on(self, places: dict[str, tuple[type, str]]) -> Iterator[None]:
        """Time methods of classes in here."""
        with ExitStack() as stack:
            for name, (kind, method) in places.items():
                stack.enter_context(mock.patch.object(kind, method, self._timed(name, getattr(kind, method))))
            yield

    def _timed(self, name: str, method: Callable[..., Any]) -> Callable[..., Any]:
        def call(*args: Any, **values: Any) -> Any:
            began = time.process_time()
            try:
                return method(*args, **values)
            finally:
                self.calls[name] += 1
                self.seconds[name] += time.process_time() - began

        return call


def fastest(work: Callable[[], object], rounds: int = 5) -> float:
    """Return the least CPU seconds of some rounds."""
    times = []
    for _ in range(rounds):
        began = time.process_time()
        work()
        times.append(time.process_time() - began)
    return min(times)


def limits() -> tuple[float, dict[bool, float]]:
    """Return the bytes a second that one core reads, and its operations a second in a dense product, by whether in single
    precision."""
    values = np.ones(1 << 25)
    bandwidth = values.nbytes / fastest(values.sum)
    rates = {}
    for single in (False, True):
        matrix = np.ones((1500, 1500), dtype=np.float32 if single else np.float64)
        rates[single] = 2 * 1500**3 / fastest(lambda matrix=matrix: matrix @ matrix)  # type: ignore[misc]
    return bandwidth, rates


def measured(name: str, bandwidth: float, rates: dict[bool, float]) -> None:
    """Follow a model's path twice, and print the second one's times and its least."""
    made, height = MODELS[name]
    case = Case(name, made(), DEFAULT, steps.one_step(steps.PRESSURE, [height * units.COLUMN.pascal]))
    with TemporaryDirectory() as folder:
        mesh = Path(folder) / "device.msh"
        for _ in range(2):
            run, clock = Simulation(case, start()), Clock()
            run.write_mesh(mesh)
            with clock.on(TIMED), clock.on(WHOLE):
                run.prepare(mesh)
                clock.calls.clear(), clock.seconds.clear()
                began = time.process_time()
                count = sum(1 for _ in run.steps())
                whole = time.process_time() - began
    inverse, K = run.solver.bordered.inverse, run.solver.system.K
    if not isinstance(inverse, newton.Factorisation):
        print(f"{name}: solved by iterations, which have no factors")
        return
    factor = inverse._direct.getFactorMatrix()
    entries = float(factor.getMumpsInfog(29))
    entries = entries if entries > 0 else -1e6 * entries
    calls, each = clock.calls, {part: clock.seconds[part] / max(clock.calls[part], 1) for part in TIMED}
    least = {
        "back-substitutions": calls["back-substitutions"] * 2 * entries * (4 if inverse.rounded else 8) / bandwidth,
        "products": calls["products"] * 12 * float(K.getInfo()["nz_used"]) / bandwidth,
        "factorisations": calls["factorisations"] * factor.getMumpsRinfog(3) / rates[inverse.rounded],
        "residuals": count * each["residuals"],
        "tangents": calls["factorisations"] * each["tangents"],
    }
    print(f"\n{name}: {K.getSize()[0]} unknowns, {count} states, {entries / 1e6:.2f} million entries of the factors\n")
    print("| part | calls | CPU, s | the least, s |\n|---|---|---|---|")
    for part in TIMED:
        print(f"| {part} | {calls[part]} | {clock.seconds[part]:.2f} | {f'{least[part]:.2f}' if part in least else ''} |")
    rest = whole - sum(clock.seconds[part] for part in TIMED)
    print(f"| all else | | {rest:.2f} | |\n| **path** | | {whole:.2f} | {sum(least.values()):.2f} |")
    uses = ", ".join(f"{part} {clock.seconds[part]:.2f} s" for part in WHOLE)
    print(f"\nratio {whole / sum(least.values()):.2f}; of the path: {uses}")
    run.release()


def main() -> None:
    bandwidth, rates = limits()
    single, double = rates[True] / 1e9, rates[False] / 1e9
    print(f"one core reads {bandwidth / 1e9:.1f} GB/s, multiplies at {single:.0f} (single) and {double:.0f} Gflop/s (double)")
    for name in sys.argv[1:] or MODELS:
        measured(name, bandwidth, rates)


if __name__ == "__main__":
    main()
