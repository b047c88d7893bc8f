"""Cost of a memory with three branches on the default disk: CPU time of a step beside that of an elastic one, and bytes.

    OMP_NUM_THREADS=1 uv run python tests/benchmarks/memory_cost.py [--repeat 5] [--profile wedge]

Both silicones take the same twelve steps of a ramp, warm, in turn; the best of several is compared. The cycle goes to 25 cm in
5 s, is held for 5 s and returns, on the section in about a hundred steps. Bytes: of the history, and what a step takes beside
it. `--profile` prints where the CPU time of the branches goes.
"""

from __future__ import annotations

import argparse
import cProfile
import tempfile
import time
from pathlib import Path

from geometries import HollowDisk
from softmodels.case.load import steps_of
from softmodels.materials.laws import Material, Yeoh
from softmodels.mechanics.body import Body
from softmodels.mechanics.mpi import start
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System
from softmodels.path.schedule import Settings, follow

LAW = Yeoh(14e3, 60.0)
BRANCHES = ((0.2, 1.0), (0.1, 10.0), (0.05, 100.0))
STEPS = 12
"""Fewest steps of a stage, which both silicones take at a tolerance that both meet."""


def cpu(solver: Solver, tables: dict[str, object], tolerance: float = 1.0) -> tuple[float, int]:
    """Return the CPU time in s of a path in time and its number of steps."""
    program = steps_of(**tables)
    began = time.process_time()
    points = list(follow(solver, program, Settings(tolerance=tolerance)))
    return time.process_time() - began, len(points) - 1


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--profile", choices=("axisymmetric", "wedge"))
    args = parser.parse_args()
    comm = start()
    remembering = LAW.with_memory(branches=BRANCHES)
    ramp = {"cavity1": {"pressure_cm": [25.0]}, "time_s": [5.0]}
    print("| section | unknowns | elastic step, ms | three branches, ms | ratio | bytes an unknown |")
    print("|---|---|---|---|---|---|")
    for section in ("axisymmetric", "wedge"):
        disk = HollowDisk(section=section)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "disk.msh"
            disk.write(path)
            body = Body.from_file(disk, path, comm)

        def solver(law: Material, body: Body = body) -> Solver:
            return Solver(System(body, law, creeping=True))

        elastic, branches = solver(LAW), solver(remembering)
        if args.profile == section:
            cpu(branches, ramp)
            with cProfile.Profile(time.process_time) as profile:
                cpu(branches, ramp)
            profile.print_stats("tottime")
        if args.profile:
            continue
        rounds = [[cpu(one, ramp)[0] / STEPS for one in (elastic, branches)] for _ in range(args.repeat + 1)]
        best = [min(times) for times in zip(*rounds, strict=True)]
        (history,), unknowns = branches.system.potential.histories, branches.system.dofs
        held = (history.values.x.array.nbytes + history.begun.x.array.nbytes) / unknowns
        print(
            f"| {section} | {unknowns} | {best[0] * 1e3:.1f} | {best[1] * 1e3:.1f} | {best[1] / best[0]:.2f} | "
            f"{held:.0f} and {history.step_bytes / unknowns:.0f} |"
        )
        if section == "axisymmetric":
            times = [5.0 * k / 3 for k in range(1, 10)]
            heights = [min(5.0 * t, 25.0, 5.0 * max(15.0 - t, 0.0)) for t in times]
            taken, steps = cpu(branches, {"cavity1": {"pressure_cm": heights}, "time_s": times}, 5e-5)
            print(f"a cycle of {steps} steps on the section: {taken:.2f} s")


if __name__ == "__main__":
    main()
