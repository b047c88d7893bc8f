"""Time studies of axisymmetric sections: CPU time of a warm process for each sample, and what 1,000 take on two cores.

    uv run python tests/benchmarks/study_throughput.py 24

Every sample is another disk, so that each is meshed too.
"""

from __future__ import annotations

import os
import sys
import time

import softmodels as sm
from softmodels.case.load import steps_of
from softmodels.design.study import Input, StudyPlan, solved


def cpu() -> float:
    """CPU time in s of this process and of those that it has waited for."""
    return sum(os.times()[:4])


def main(count: int) -> None:
    disk = sm.HollowDisk(section="axisymmetric", cell_size=0.004)
    case = sm.Case("disk", disk, sm.Yeoh(14e3, 60.0), steps=steps_of(pressure_cm=(20.0, 40.0, 60.0)))
    inputs = (Input.parse("geometry.membrane", "1.8:2.2 mm"), Input.parse("material.c1", "12:16 kPa"))
    for answer in ("path", "limit"):
        seed = time.time_ns() % 2**31  # meshes of an earlier run are cached
        plan = StudyPlan("throughput", case, inputs, samples=count + 1, seed=seed, answer=answer)
        cases, _ = plan.cases
        solved((cases[count], answer))  # warm
        before = cpu()
        for k in range(count):
            solved((cases[k], answer))
        each = (cpu() - before) / count
        print(f"{answer}: {each:.3f} s CPU for each of {count} samples; 1,000 on two cores: {each * 500 / 60:.2f} min")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 24)
