"""What the search for a slab's lift costs, beside the paths that gradients by differences would have cost.

    uv run python tests/benchmarks/seminar_lift.py --output results/seminar-lift
    mpirun -n 2 .venv/bin/python tests/benchmarks/seminar_lift.py --output results/seminar-lift --resume

Half an hour for each design on one core: 300,000 unknowns. The problem is tests/benchmarks/seminar_lift.toml; every design is
kept in the folder as soon as it is known.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import softmodels as sm

PROBLEM = Path(__file__).with_suffix(".toml")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path("results/seminar-lift"))
    parser.add_argument("--evaluations", type=int, default=40)
    parser.add_argument("--resume", action="store_true")
    given = parser.parse_args()

    def say(*words):
        print(*words, flush=True)

    found = sm.optimise(
        PROBLEM, folder=given.output, evaluations=given.evaluations, resume=given.resume, progress=say, inputs=[PROBLEM]
    )
    judged = [trial for trial in found.trials if not trial.failed]
    seconds = sum(trial.seconds for trial in found.trials)
    paths = 2 * len(found.problem.free) * len(judged)
    say(f"{len(found.trials)} designs, {len(judged)} of them with gradients by {len(found.problem.free)} parameters")
    say(f"{seconds:.0f} s in all; the first one, with its whole path, {found.trials[0].seconds:.0f} s")
    say(f"central differences would have cost {paths} paths, about {paths * found.trials[0].seconds:.0f} s")
    say(*found.reasons, sep="\n")


if __name__ == "__main__":
    main()
