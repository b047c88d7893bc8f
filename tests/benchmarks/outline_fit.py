"""How long a fit to outlines takes beside a search, and how often its intervals hold the truth.

    uv run python tests/benchmarks/outline_fit.py [--repeats 200] [--search 40]

The device is the default disk's section, the law Yeoh with two numbers free, the bench's own errors and the membrane
free with their priors. The search follows one path per pair of a 20 x 20 grid about the truth and compares heights; only the
first pairs are timed, and the rest is counted at their mean. The intervals are those of 12 random silicones in turn, each time
cast anew with a membrane that is off by 1 %, and measured on a bench with errors of its own. ``--search 0`` leaves out the
search, ``--fixed`` takes the membrane as exact.
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from geometries import HollowDisk
from softmodels.fitting.outlines.fit import fit_law_to_outlines
from softmodels.fitting.outlines.residuals import LEAK_ERROR, PRESSURE_SCALE_ERROR, SCALE_ERROR, ZERO_ERROR, OutlineResiduals
from softmodels.fitting.outlines.shapes import prepare
from softmodels.fitting.problem import BENCH, FREE, CannotEvaluate, LawChoice
from softmodels.mechanics.mpi import start
from tests.support.simulated import SimulatedCamera, simulated_outlines

TRUTH = {"c1": 14e3, "c2": 600.0, "c3": 0.0}
HOLD = {"c3": {"start": 0.0, "fixed": True}}
PRESSURES = np.linspace(18.0, 177.0, 10) * 95.1
CAMERA = SimulatedCamera(spacing=25e-6, error=8e-6, run=8.0, pressure_error=10.0)
SIDE = 20
TRUTHS, WALL_ERROR = 12, 0.01
"""Number of random silicones, and the standard error of the cast membrane's thickness, as a share of it."""


def device(cell_size: float):
    from softmodels.fitting.outlines.device import DeviceModel
    from softmodels.mechanics.body import Body
    from softmodels.mechanics.solver import Solver
    from softmodels.mechanics.system import System

    comm = start()
    disk = HollowDisk(section="axisymmetric", cell_size=cell_size, fillet=0.0, base_fillet=0.0)
    with tempfile.TemporaryDirectory() as folder:
        body = Body.from_file(disk, disk.write(Path(folder) / "disk.msh"), comm)
    choice = LawChoice.from_text("yeoh")
    return DeviceModel(Solver(System(body, choice.material(TRUTH))), choice)


def fitted(inflation, camera, rng, pressures=PRESSURES, truth=TRUTH, free=FREE):
    outlines = simulated_outlines(inflation, truth, pressures, camera, rng=rng)
    shapes, _ = prepare(outlines, inflation.system.body.actuator, inflation.silhouette.width)
    inflation.paths = 0
    begin = time.perf_counter()
    found = fit_law_to_outlines(OutlineResiduals(inflation, shapes), free=free, changes=HOLD)
    return found, time.perf_counter() - begin


def search(inflation, count: int) -> tuple[float, int]:
    """Seconds per pair of the grid, and how many of the timed pairs had all states."""
    grid = itertools.product(np.linspace(0.8, 1.2, SIDE) * TRUTH["c1"], np.linspace(0.0, 2.0, SIDE) * TRUTH["c2"])
    pairs = np.random.default_rng(0).permutation(np.array(list(grid)))[:count]
    begin, whole = time.perf_counter(), 0
    for c1, c2 in pairs:
        inflation._asked = inflation._base = None
        try:
            inflation.states({"c1": c1, "c2": c2, "c3": 0.0}, PRESSURES, "pressure")
            whole += 1
        except CannotEvaluate:
            pass
    return (time.perf_counter() - begin) / count, whole


def silicones(rng) -> list[dict[str, float]]:
    """Random numbers of the law."""
    stiffness, hardening = np.exp(rng.uniform(np.log(7e3), np.log(40e3), TRUTHS)), rng.uniform(0.02, 0.08, TRUTHS)
    return [{"c1": c1, "c2": share * c1, "c3": 0.0} for c1, share in zip(stiffness, hardening, strict=True)]


def coverage(inflation, repeats: int, free) -> None:
    rng, inside, misses = np.random.default_rng(2026), {}, {}
    sizes = {
        "leak": LEAK_ERROR, "scale": SCALE_ERROR, "zero": ZERO_ERROR, "pressure_offset": 10.0,
        "pressure_scale": PRESSURE_SCALE_ERROR, "centre": 1e-3,
    }  # fmt: skip
    truths, membrane = silicones(rng), inflation.lengths["membrane"]
    for number in range(repeats):
        bench = {name: size * rng.standard_normal() for name, size in sizes.items()}
        law = truths[number % TRUTHS]
        cast = {"membrane": membrane * (1.0 + WALL_ERROR * rng.standard_normal())}
        pressures = PRESSURES[1::2] * law["c1"] / TRUTH["c1"]
        found, _ = fitted(inflation, dataclasses.replace(CAMERA, bench=bench), rng, pressures, law | cast, free)
        for name, value in (law | cast | bench).items():
            if found.error(name) == 0.0:
                continue
            low, high = found.interval(name)
            inside.setdefault(name, []).append(low <= value <= high)
            misses.setdefault(name, []).append((found.values[name] - value) / found.error(name))
    for name, hits in inside.items():
        spread = float(np.std(misses[name]))
        print(f"  {name:16s} {np.mean(hits):6.1%} of {repeats}, misses {np.mean(misses[name]):+.2f} +- {spread:.2f} errors")


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--repeats", type=int, default=200)
    parser.add_argument("--search", type=int, default=40)
    parser.add_argument("--fixed", action="store_true")
    chosen = parser.parse_args()
    if chosen.search:
        compare_with_search(chosen.search)
    begin = time.perf_counter()
    print(f"95 % intervals that hold the truth, {len(PRESSURES[1::2])} outlines each:")
    coverage(device(0.006), chosen.repeats, BENCH if chosen.fixed else FREE)
    print(f"  in {time.perf_counter() - begin:.0f} s")


def compare_with_search(count: int) -> None:
    fine = device(0.003)
    fitted(fine, CAMERA, np.random.default_rng(1))  # warm
    found, seconds = fitted(fine, CAMERA, np.random.default_rng(1))
    paths = fine.paths
    values = ", ".join(f"{name} {found.values[name]:.1f} +- {found.error(name):.1f} Pa" for name in ("c1", "c2"))
    print(f"fit to {len(PRESSURES)} outlines: {seconds:.1f} s, {paths} sets of states; {values}")
    each, whole = search(fine, count)
    print(
        f"search: {SIDE * SIDE} paths, {each:.2f} s each over {count} of them ({whole} reached all pressures), "
        f"so {each * SIDE * SIDE:.0f} s in all: {SIDE * SIDE / paths:.0f} times the paths, "
        f"{each * SIDE * SIDE / seconds:.0f} times the time"
    )
    sys.stdout.flush()


if __name__ == "__main__":
    main()
