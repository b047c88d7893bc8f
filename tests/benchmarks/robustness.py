"""Random devices, silicones and controls: every path ends in its curve or in a named physical limit.

    OMP_NUM_THREADS=1 uv run python tests/benchmarks/robustness.py --count 200

A quarter of the devices are wedges, the rest sections. Every path is checked against a second one of the same device's
section, under volume control with short steps: a limit point has to be there at the same pressure, a pressure that was
reached must lie on the first branch with the same volume, and one that was refused must have no state below the limit.
"""

from __future__ import annotations

import argparse
import collections
import dataclasses
import gc
import math
import random
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from geometries import GeometryError, HollowDisk
from softmodels.materials import Gent, Material, MooneyRivlin, NeoHookean, Ogden, Yeoh

SAME = {"axisymmetric": 0.002, "wedge": 0.03}
"""How far the check's figures may be off: rounding of steps on one mesh; coarse wedges against a section of equal cells."""


@dataclasses.dataclass(frozen=True)
class Trial:
    """One random case: what is asked is a pressure in shear moduli, or an added volume in cavities."""

    number: int
    disk: HollowDisk
    material: Material
    control: str
    quantity: str
    goal: float


def trials(count: int, seed: int = 2013, wedges: float = 0.25) -> Iterator[Trial]:
    """Random cases, the same for the same seed and the same share of wedges."""
    chance = random.Random(seed)
    number = 0
    while number < count:
        radius = 10 ** chance.uniform(-2.3, -1.3)
        wedge = chance.random() < wedges
        spans = {"membrane": (0.08, 0.8), "base": (0.2, 0.8), "wall": (0.15, 1.0), "cavity_height": (0.1, 0.7)}
        part = {name: radius * chance.uniform(*span) for name, span in spans.items()}
        fillet = chance.choice([0.0, 0.15]) * min(part["cavity_height"], radius)
        try:
            disk = HollowDisk(
                cavity_radius=radius, **part, fillet=fillet, base_fillet=fillet,
                cell_size=radius * (0.5 if wedge else chance.uniform(0.15, 0.3)), refinement=chance.uniform(1.0, 2.5),
                section="wedge" if wedge else "axisymmetric", angle=chance.choice([30.0, 45.0, 90.0]),
                support=chance.choice(["rim", "base"]),
            )  # fmt: skip
        except GeometryError:
            continue
        mu, nu = 10 ** chance.uniform(3.7, 5.3), chance.choice([0.45, 0.49, 0.495, 0.5])
        material = _silicone(chance, mu, nu)
        quantity = chance.choice(["pressure", "pressure", "volume"])
        control = chance.choice(["auto", "auto", "arc-length", "volume"])
        goal = 10 ** chance.uniform(-1.3, 0.2) if quantity == "pressure" else 10 ** chance.uniform(-0.5, 0.9)
        yield Trial(number, disk, material, control, quantity, goal)
        number += 1


def _silicone(chance: random.Random, mu: float, nu: float) -> Material:
    laws: list[Material] = [
        NeoHookean(mu, nu), MooneyRivlin(0.4 * mu, 0.1 * mu, nu), Yeoh(mu / 2, mu / 200, 0.0, nu),
        Yeoh(mu / 2, mu / 50, mu / 2000, nu), Gent(mu, chance.uniform(10, 60), nu),
        Ogden((mu * 1.2, mu * 0.002, -mu * 0.02), (1.3, 5.0, -2.0), nu),
    ]  # fmt: skip
    return chance.choice(laws)


def equations_of(disk: HollowDisk, material: Material, comm: Any) -> Any:
    from softmodels.body import Body
    from softmodels.equilibrium import Equilibrium

    with tempfile.TemporaryDirectory() as folder:
        body = Body.from_file(disk, disk.write(Path(folder) / "disk.msh"), comm)
    return Equilibrium(body, material)


def outcome(trial: Trial, equations: Any) -> tuple[str, list[Any]]:
    """How the path of a trial ends, in a word, and its points."""
    from softmodels.equilibrium import NoConvergence
    from softmodels.loading import Path as LoadPath
    from softmodels.loading import PathEnd, trace

    scale = equations.rest().V if trial.quantity == "volume" else 1.0
    points: list[Any] = []
    try:
        points.extend(_kept(trace(LoadPath(equations, trial.control, trial.quantity), [trial.goal * scale]), points))
        return "reached", points
    except PathEnd as end:
        if end.limit is not None or "the cavity has grown" in str(end):
            return "limit", points
        return f"lost: {end}", points
    except NoConvergence as failure:
        return f"crashed: {failure}", points


def _kept(source: Iterator[Any], points: list[Any]) -> Iterator[Any]:
    for point in source:
        points.append(point)
    return iter(())


def check(trial: Trial, ended: str, points: list[Any], comm: Any) -> str:
    """What is wrong with an outcome by the section's own path under volume control, or an empty text."""
    if ended not in ("reached", "limit"):
        return ended
    equations = equations_of(dataclasses.replace(trial.disk, section="axisymmetric"), trial.material, comm)
    try:
        return _against(trial, ended, points, equations)
    finally:
        equations.release()


def _against(trial: Trial, ended: str, points: list[Any], equations: Any) -> str:
    from softmodels.loading import Path as LoadPath
    from softmodels.loading import PathEnd, trace

    tolerance, V0 = SAME[trial.disk.section], equations.rest().V
    slices = trial.disk.copies if trial.disk.dimension == 3 else 1
    last = max(points[-1].state.V * slices, V0 * 1.001)
    path, known = LoadPath(equations, "volume", "volume", (last - V0) / 25), []
    try:
        known.extend(_kept(trace(path, [last - V0]), known))
    except PathEnd as end:
        return f"the check's path was lost ({end})"
    limits = [point.state.P for point in points if point.limit]
    expected = [point.state.P for point in known if point.limit]
    if limits and not (expected and math.isclose(limits[0], expected[0], rel_tol=tolerance)):
        return f"false limit: {limits[0]:.5g} where the section has {expected[:1]}"
    if not limits and expected and expected[0] < (1 - tolerance) * max(point.state.P for point in points):
        return f"missed limit: the section has one at {expected[0]:.5g}"
    V, P = np.array([(point.state.V, point.state.P) for point in known]).T
    there = np.interp(points[-1].state.V * slices, V, P)
    if abs(there - points[-1].state.P) > max(5 * tolerance * P.max(), 0.01 * P.max()):
        return f"another branch: {points[-1].state.P:.5g} where the section has {there:.5g}"
    return ""


def examine(trial: Trial, comm: Any) -> tuple[str, str]:
    """Outcome and fault of a trial."""
    equations = equations_of(trial.disk, trial.material, comm)
    ended, points = outcome(trial, equations)
    found = ended, check(trial, ended, points, comm)
    equations.release()
    gc.collect()
    return found


def main() -> None:
    from softmodels.parallel import start

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=2013)
    parser.add_argument("--wedges", type=float, default=0.25, help="share of wedges")
    given = parser.parse_args()
    comm = start()
    began, endings, faults = time.perf_counter(), collections.Counter(), []  # type: ignore[var-annotated]
    for trial in trials(given.count, given.seed, given.wedges):
        ended, fault = examine(trial, comm)
        endings[ended.split(":")[0]] += 1
        if fault:
            faults.append(trial)
            print(f"{trial.number}: {fault}\n   {trial}", flush=True)
    took = time.perf_counter() - began
    print(f"{given.count} cases in {took:.0f} s: {dict(endings)}; {len(faults)} at fault")


if __name__ == "__main__":
    main()
