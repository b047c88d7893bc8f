"""What the search for a slab's lift costs, beside the paths that gradients by differences would have cost.

    uv run python tests/benchmarks/seminar_lift.py --output results/seminar-lift
    mpirun -n 2 .venv/bin/python tests/benchmarks/seminar_lift.py --output results/seminar-lift --resume
    mpirun -n 2 .venv/bin/python tests/benchmarks/seminar_lift.py --compare 1.25
    mpirun -n 2 .venv/bin/python tests/benchmarks/seminar_lift.py --problem tests/benchmarks/seminar_fan.toml --evaluations 5

Three quarters of an hour for each design on one core: 350,000 unknowns. The problem is seminar_lift.toml beside this file;
every design is kept in the folder as soon as it is known. With --compare nothing is searched: the device as given is solved
along its whole path on its own mesh and on one with cells so many times smaller.

With seminar_fan.toml on two ranks, 348,744 unknowns, four parameters: designs of 26.58, 27.25, 29.03 and 31.39 mm (twice
the default slab's rise is 29.0 mm), limit margins of 1.344, 1.337, 1.319 and 1.301 where 1.302 was asked, largest stretches
of 3.62 to 3.68. They took 831, 888, 779 and 896 s, 3,393 s in all with 258 Newton iterations; central differences would
have taken 32 paths of some 830 s, 26,600 s. Most of a design's time goes where a channel bulges all at once, in steps that
Newton's method passes with trouble. The best that keeps all limits, 29.03 mm, was then solved on a fresh mesh with cells a
fifth smaller, limit point included, in half an hour. It rises 29.56 mm
there, with a largest stretch of 3.40.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

import softmodels as sm
from geometries.actuator import parameter
from softmodels.design.model import evaluator
from softmodels.design.problem import DesignProblem
from softmodels.mechanics.mpi import start

PROBLEM = Path(__file__).with_suffix(".toml")
"""All radii of all channels; ``seminar_fan.toml`` beside it has four parameters that act on all channels at once."""


def compare(problem, comm, finer, say):
    """The device as given on two meshes."""
    theta = np.array([parameter(problem.case.actuator, name) for name in problem.names])
    model = evaluator(problem, comm, {})
    for times in (1.0, finer):
        begun = time.monotonic()
        found = model.confirm(theta, times)
        values = ", ".join(f"{name} {value:.6g}" for name, value in found.values.items())
        say(f"cells {times:g} times smaller: {values}; {time.monotonic() - begun:.0f} s")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--problem", type=Path, default=PROBLEM)
    parser.add_argument("--output", type=Path, default=Path("results/seminar-lift"))
    parser.add_argument("--evaluations", type=int, default=40)
    parser.add_argument("--finer", type=float, default=1.0, help="how many times smaller the cells of the confirmation are")
    parser.add_argument("--resume", action="store_true")
    parser.add_argument("--compare", type=float, help="solve the device as given on its mesh and on one so much finer")
    given = parser.parse_args()

    def say(*words):
        if comm.rank == 0:
            print(*words, flush=True)

    comm = start()
    if given.compare:
        compare(DesignProblem.from_file(given.problem), comm, given.compare, say)
        return
    found = sm.optimise(
        given.problem, folder=given.output, evaluations=given.evaluations, resume=given.resume, finer=given.finer,
        progress=say, inputs=[given.problem],
    )  # fmt: skip
    judged = [trial for trial in found.trials if not trial.failed]
    seconds = sum(trial.seconds for trial in found.trials)
    paths = 2 * len(found.problem.free) * len(judged)
    say(f"{len(found.trials)} designs, {len(judged)} of them with gradients by {len(found.problem.free)} parameters")
    say(f"{seconds:.0f} s in all; the first one, with its whole path, {found.trials[0].seconds:.0f} s")
    say(f"central differences would have cost {paths} paths, about {paths * found.trials[0].seconds:.0f} s")
    say(*found.confirmation)
    for reason in found.reasons:
        say(reason)


if __name__ == "__main__":
    main()
