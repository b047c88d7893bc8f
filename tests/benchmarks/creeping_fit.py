"""How often the intervals of a memory that is fitted to photographs hold the truth, and how long a fit takes.

    uv run python tests/benchmarks/creeping_fit.py [--repeats 100]

A disk's section on a finer mesh and with steps in time many times shorter, three levels of pressure with three holds each; the
law Yeoh with two numbers free, two branches, the bench's own errors drawn from their priors and fitted.
"""

from __future__ import annotations

import argparse
import dataclasses
import tempfile
import time
from pathlib import Path

import numpy as np

from geometries import HollowDisk
from softmodels.fitting.curves.residuals import spectrum
from softmodels.fitting.outlines.creeping import CreepingResiduals
from softmodels.fitting.outlines.device import MeasuredDevice
from softmodels.fitting.outlines.fit import fit_law_to_outlines
from softmodels.fitting.outlines.residuals import LEAK_ERROR, PRESSURE_SCALE_ERROR, SCALE_ERROR, ZERO_ERROR
from softmodels.fitting.outlines.shapes import prepare
from softmodels.fitting.problem import LawChoice
from softmodels.materials.laws import Yeoh
from softmodels.mechanics.body import Body
from softmodels.mechanics.mpi import start
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System
from tests.support.simulated import Creeping, SimulatedCamera

TRUTH = {"c1": 14e3, "c2": 600.0, "share_10s": 0.15, "share_100s": 0.1}
LAW = Yeoh(14e3, 600.0, 0.0, 0.5).with_memory(branches=[(0.15, 10.0), (0.1, 100.0)])
LEVELS, RISE, HOLDS = (np.array([40.0, 90.0, 140.0]) * 95.1).tolist(), 2.0, (5.0, 50.0, 500.0)
DISK = HollowDisk(section="axisymmetric", cell_size=0.003, fillet=0.0, base_fillet=0.0)
SIZES = {
    "leak": LEAK_ERROR, "scale": SCALE_ERROR, "zero": ZERO_ERROR, "pressure_offset": 10.0,
    "pressure_scale": PRESSURE_SCALE_ERROR, "centre": 1e-3,
}  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--repeats", type=int, default=100)
    repeats, comm = parser.parse_args().repeats, start()
    with tempfile.TemporaryDirectory() as folder:
        finer = dataclasses.replace(DISK, cell_size=0.002)
        body = Body.from_file(finer, finer.write(Path(folder) / "disk.msh"), comm)
    creeping = Creeping.simulated(Solver(System(body, LAW, creeping=True)), LEVELS, RISE, HOLDS)
    model = MeasuredDevice.of(DISK).model(LawChoice.from_text("yeoh"), comm, spectrum([], HOLDS))
    rng, inside, misses = np.random.default_rng(2026), {}, {}
    begin = time.process_time()
    for _ in range(repeats):
        bench = {name: size * rng.standard_normal() for name, size in SIZES.items()}
        outlines = creeping.outlines(SimulatedCamera(bench=bench), rng)
        shapes, _ = prepare(outlines, DISK, model.silhouette.width)
        changes = {"c3": {"start": 0.0, "fixed": True}}
        found = fit_law_to_outlines(CreepingResiduals(model, shapes), changes=changes)
        for name, value in (TRUTH | bench).items():
            low, high = found.interval(name)
            inside.setdefault(name, []).append(low <= value <= high)
            misses.setdefault(name, []).append((found.values[name] - value) / found.error(name))
    print(f"{(time.process_time() - begin) / repeats:.1f} s of processor time for a fit to {len(creeping.curves)} outlines")
    for name, hits in inside.items():
        spread = float(np.std(misses[name]))
        told = f"misses {np.mean(misses[name]):+.2f} +- {spread:.2f} errors"
        print(f"  {name:16s} {np.mean(hits):6.1%} of {repeats}, {told}")


if __name__ == "__main__":
    main()
