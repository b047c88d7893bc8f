"""How often random designs keep their limits when they are cast with random lengths.

    python -m tests.benchmarks.design_margins --designs 10 --castings 500 --solved 60

Each design is the best disk of a random silicone at a random pressure, with random tolerances, within limits of its stretch and
its mass that hold with 95 %. Of every limit that a design has reached, the castings that keep it are counted: those by the
tangent model, which the design was found with, and the first of them solved, each on its own moved mesh.
"""

from __future__ import annotations

import argparse

import numpy as np

import softmodels as sm
from softmodels.api.calls import case_of
from softmodels.common.arrays import Array
from softmodels.design.model import DesignModel
from softmodels.design.optimise import optimise
from softmodels.design.problem import DesignProblem
from softmodels.design.result import DesignResult
from softmodels.mechanics import mpi

REACHED = 2e-3
"""Distance to a limit, relative to it, below which a design has reached it with its allowance."""


def problem(random: np.random.Generator) -> DesignProblem:
    """Return a random problem."""
    height = f"{random.uniform(40.0, 120.0):.3g} cm"
    law = sm.NeoHookean(random.uniform(20e3, 40e3)) if random.random() < 0.5 else sm.Yeoh(random.uniform(10e3, 18e3), 60.0)
    kept = ({"quantity": "max_stretch", "at": height, "at_most": random.uniform(1.12, 1.3)},
            {"quantity": "mass", "at_most": f"{random.uniform(24.0, 30.0):.4g} g"})  # fmt: skip
    return DesignProblem(
        case_of(sm.HollowDisk(section="axisymmetric", cell_size=4e-3), law, [height]),
        {"membrane": ("2 mm", "9 mm"), "cavity_radius": ("6 mm", "14 mm")},
        maximise={"quantity": "rise", "of": "apex", "at": height},
        keep=kept,
        tolerance={name: f"{random.uniform(0.1, 0.5):.2g} mm" for name in ("membrane", "wall")},
    )


def kept(
    found: DesignResult, spreads: Array, random: np.random.Generator, castings: int, solved: int
) -> list[tuple[str, float, float]]:
    """Return of each limit that a design has reached how many castings keep it: by the tangent model, and solved."""
    best, problem = found.best, found.problem
    moves = spreads * random.standard_normal((castings, len(spreads)))
    rows = [row for row, c in zip(found.form.rows, found.form.violations(best), strict=True) if c > -REACHED]
    model = DesignModel(problem.case, problem.names, problem.quantities, mpi.start(), highest=problem.highest)
    try:
        values = [model.evaluate(np.array(best.theta) + move).values for move in moves[:solved]]
    finally:
        model.release()
    counts = []
    for row in rows:
        slope = np.asarray(best.gradients[row.key])
        tangent = row.sign * (best.values[row.key] + moves @ slope - row.limit) <= 0.0
        own = [row.sign * (value[row.key] - row.limit) <= 0.0 for value in values]
        counts.append((row.words, float(np.mean(tangent)), float(np.mean(own))))
    return counts


def main() -> None:
    """Run it."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--designs", type=int, default=10)
    parser.add_argument("--castings", type=int, default=500)
    parser.add_argument("--solved", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    how = parser.parse_args()
    random, counts = np.random.default_rng(how.seed), []
    for number in range(how.designs):
        found = optimise(problem(random), confirm=False)
        if not found.feasible:
            print(f"problem {number}: no design keeps the limits")
            continue
        for words, tangent, own in kept(found, found.form.spread.spreads, random, how.castings, how.solved):
            print(f"problem {number}: {words}: {tangent:.1%} by the tangent model, {own:.1%} solved", flush=True)
            counts.append((tangent, own))
    tangent, own = np.mean(counts, axis=0)
    print(f"{len(counts)} limits: kept in {tangent:.1%} of {how.castings} castings, solved in {own:.1%} of {how.solved}")


if __name__ == "__main__":
    main()
