"""Random devices, silicones and controls: every path ends in its curve or in a named physical limit.

    OMP_NUM_THREADS=1 uv run python tests/benchmarks/robustness.py --count 200
    OMP_NUM_THREADS=1 uv run python tests/benchmarks/robustness.py --count 200 --kind wedge
    OMP_NUM_THREADS=1 uv run python tests/benchmarks/robustness.py --count 8 --kind seminar

Every path is checked against a second one under volume control with short steps: of the disk's section, or of the same
mesh of a seminar actuator, which has none. A limit point has to be there at the same pressure, what was reached must lie on
the first branch, and what was refused must not be on it below the limit.

Found with the commands above, none at fault, whether driven by pressure, volume, arc length, `auto` or a syringe; memory stays
that of the largest mesh (under 510 MB after the wedges):

| kind | cases | reached | limit | limits within | last states within (of the largest pressure) |
|---|---|---|---|---|---|
| sections | 200 in 150 s | 164 | 36 | 5e-10 | 6e-8 |
| wedges | 200 in 23 min | 164 | 36 | 2.5e-3 | 1.5 % |
| seminar actuators | 8 | 8 | 0 | | 4e-11 |
"""

from __future__ import annotations

import argparse
import collections
import dataclasses
import gc
import math
import random
import resource
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from geometries import Actuator, GeometryError, HollowDisk, SeminarActuator
from softmodels.materials.laws import Gent, Material, MooneyRivlin, NeoHookean, Ogden, Yeoh
from softmodels.path.supply import AMBIENT_PRESSURE, GASES, Syringe

KINDS = ("section", "wedge", "seminar")
SAME = {"section": 0.002, "wedge": 0.03, "seminar": 0.002}
"""How far limits may be apart, relative: rounding of steps on one mesh; coarse wedges against a section of equal cells."""
ON_CURVE = {"section": 0.01, "wedge": 0.05, "seminar": 0.01}
"""How far the last state's pressure may be off the check's curve, in shares of that curve's largest."""
STEPS = 25
"""Steps of the check's path at least."""


@dataclasses.dataclass(frozen=True)
class Trial:
    """One random case: what is asked is a pressure in shear moduli, or an added volume or stroke in cavities."""

    number: int
    kind: str
    device: Actuator
    material: Material
    control: str
    quantity: str
    goal: float
    syringe: Syringe | None = None


@dataclasses.dataclass(frozen=True)
class Found:
    """How a trial ended, what is wrong with that (or nothing), and how far limit and last state are off the check's."""

    ended: str
    fault: str
    limit_off: float = math.nan
    state_off: float = math.nan


def trials(count: int, seed: int = 2013, kind: str = "section") -> Iterator[Trial]:
    """Random cases, the same for the same seed and kind."""
    chance = random.Random(f"{seed} {kind}")
    number = 0
    while number < count:
        try:
            device = _seminar(chance) if kind == "seminar" else _disk(chance, kind)
            cavity = device.cavity_volume
        except GeometryError:
            continue
        mu, nu = 10 ** chance.uniform(3.7, 5.3), chance.choice([0.45, 0.49, 0.495, 0.5])
        material = _silicone(chance, mu, nu)
        quantity = chance.choice(["pressure", "pressure", "volume", "stroke"])
        goal = 10 ** (chance.uniform(-1.3, 0.2) if quantity == "pressure" else chance.uniform(-0.5, 0.9))
        syringe = None
        if quantity == "stroke":
            gas, dead = chance.choice(list(GASES)), 10 ** chance.uniform(-1, 3)
            goal *= 1 + 0.3 * dead * mu / AMBIENT_PRESSURE  # some of the stroke goes into squeezing what the tubes hold
            syringe = Syringe(goal * cavity, dead * cavity, gas=gas)
        controls = {"pressure": ("auto", "pressure", "volume", "arc-length"), "volume": ("auto", "volume", "arc-length"),
                    "stroke": ("auto", "arc-length")}  # fmt: skip
        control = chance.choice(controls[quantity])
        yield Trial(number, kind, device, material, control, quantity, goal, syringe)
        number += 1


def _disk(chance: random.Random, kind: str) -> HollowDisk:
    radius = 10 ** chance.uniform(-2.3, -1.3)
    spans = {"membrane": (0.08, 0.8), "base": (0.2, 0.8), "wall": (0.15, 1.0), "cavity_height": (0.1, 0.7)}
    part = {name: radius * chance.uniform(*span) for name, span in spans.items()}
    # A fillet makes a wedge's mesh five times larger, and is in the sections.
    fillet = chance.choice([0.0, 0.15] if kind == "section" else [0.0] * 10) * min(part["cavity_height"], radius)
    coarse = 0.5 if kind == "wedge" else chance.uniform(0.15, 0.3)
    return HollowDisk(
        cavity_radius=radius, **part, fillet=fillet, base_fillet=fillet, cell_size=radius * coarse,
        refinement=chance.uniform(1.0, 2.5 if kind == "section" else 1.3),
        section="wedge" if kind == "wedge" else "axisymmetric", angle=chance.choice([30.0, 45.0, 90.0]),
        support=chance.choice(["rim", "base"]),
    )  # fmt: skip


def _seminar(chance: random.Random) -> SeminarActuator:
    scale = 10 ** chance.uniform(-0.3, 0.3)
    spans = {"length": (50, 90), "base_width": (40, 80), "thickness": (6, 10), "offset": (-1.5, 1.5),
             "manifold_bore": (0.8, 1.2), "channel_bore": (0.5, 0.8), "end_bore": (0.8, 1.3)}  # fmt: skip
    part = {name: scale * 1e-3 * chance.uniform(*span) for name, span in spans.items()}
    return SeminarActuator(
        **part, channels=chance.choice([1, 2, 3, 5]), spread=chance.uniform(60, 110), manifold_radius=0.012 * scale,
        edge=0.004 * scale, tip_radius=0.004 * scale, fillet=0.0004 * scale, least_wall=0.0005 * scale,
        tip=chance.choice(["free", "free", "held"]), around=6, cell_size=0.008 * scale,
    )  # fmt: skip


def _silicone(chance: random.Random, mu: float, nu: float) -> Material:
    laws: list[Material] = [
        NeoHookean(mu, nu), MooneyRivlin(0.4 * mu, 0.1 * mu, nu), Yeoh(mu / 2, mu / 200, 0.0, nu),
        Yeoh(mu / 2, mu / 50, mu / 2000, nu), Gent(mu, chance.uniform(10, 60), nu),
        Ogden((mu * 1.2, mu * 0.002, -mu * 0.02), (1.3, 5.0, -2.0), nu),
    ]  # fmt: skip
    return chance.choice(laws)


def equations_of(device: Actuator, material: Material, comm: Any) -> Any:
    from softmodels.mechanics.body import Body
    from softmodels.mechanics.solver import Solver
    from softmodels.mechanics.system import System

    with tempfile.TemporaryDirectory() as folder:
        body = Body.from_file(device, device.write(Path(folder) / "device.msh"), comm)
    return Solver(System(body, material))


def follow(equations: Any, goal: float, *settings: Any) -> tuple[list[Any], Exception | None]:
    """All points of a path to a goal, and what ended it before that."""
    from softmodels.mechanics.newton import NoConvergence
    from softmodels.path.continuation import Continuation, trace
    from softmodels.path.stability import PathEnd

    points: list[Any] = []
    try:
        for point in trace(Continuation(equations, *settings), [goal]):
            points.append(point)
    except (PathEnd, NoConvergence) as end:
        return points, end
    return points, None


def supply_of(trial: Trial, equations: Any) -> Any:
    if trial.syringe is None:
        return None
    cavity = equations.system.rest().V * equations.system.volume_unit
    return trial.syringe.control(cavity, equations.system.stress_unit, equations.system.volume_unit)


def outcome(trial: Trial, equations: Any) -> tuple[str, list[Any]]:
    """How the path of a trial ends, in a word, and its points."""
    from softmodels.path.stability import QUANTITIES, PathEnd

    goal = trial.goal * (1.0 if trial.quantity == "pressure" else equations.system.rest().V)
    requested = supply_of(trial, equations) or QUANTITIES[trial.quantity]
    settings = requested, trial.control, math.inf
    points, end = follow(equations, goal, *settings)
    if end is None:
        return "reached", points
    if not isinstance(end, PathEnd):
        return f"crashed: {end}", points
    named = end.limit is not None or "the cavity has grown" in str(end)
    return ("limit" if named else f"lost: {end}"), points


def check(trial: Trial, ended: str, points: list[Any], equations: Any) -> Found:
    """What is wrong with an outcome by a second path, of the section or of the same device, under volume control."""
    from softmodels.path.stability import AddedVolume

    V0 = equations.system.rest().V
    slices = trial.device.copies if trial.kind == "wedge" else 1
    last = max(points[-1].state.V * slices, V0 * 1.001)
    known, end = follow(equations, last - V0, AddedVolume(), "volume", (last - V0) / STEPS)
    if end is not None:
        return Found(ended, f"the check's path was lost ({end})")
    V, P = np.array([(point.state.V, point.state.P) for point in known]).T
    there = float(np.interp(points[-1].state.V * slices, V, P))
    state_off = abs(there - points[-1].state.P) / float(P.max())
    limits = [point.state.P for point in points if point.limit]
    expected = [point.state.P for point in known if point.limit]
    limit_off = abs(limits[0] / expected[0] - 1) if limits and expected else math.nan
    fault, tolerance = "", SAME[trial.kind]
    if limits and not (expected and limit_off < tolerance):
        fault = f"false limit: {limits[0]:.5g} where the check has {expected[:1]}"
    elif not limits and expected and expected[0] < (1 - tolerance) * max(point.state.P for point in points):
        fault = f"missed limit: the check has one at {expected[0]:.5g}"
    elif state_off > ON_CURVE[trial.kind]:
        fault = f"another branch: {points[-1].state.P:.5g} where the check has {there:.5g}"
    elif ended == "limit" and float(quantity(trial, equations, V, P).max()) > trial.goal * (1 + tolerance):
        fault = "false limit: the check reaches more than was asked for"
    return Found(ended, fault, limit_off, state_off)


def quantity(trial: Trial, equations: Any, V: Any, P: Any) -> Any:
    """What was asked for, as `Trial.goal`, at states of the check."""
    V0 = equations.system.rest().V
    if trial.quantity == "pressure":
        return P
    if trial.quantity == "volume":
        return V / V0 - 1
    supply = supply_of(trial, equations)
    return np.array([supply.value(volume, pressure) for volume, pressure in zip(V, P, strict=True)]) / V0


def examine(trial: Trial, comm: Any) -> Found:
    """How a trial ends, and whether that is right."""
    equations = equations_of(trial.device, trial.material, comm)
    ended, points = outcome(trial, equations)
    equations.release()
    if ended not in ("reached", "limit"):
        return Found(ended, ended)
    device = dataclasses.replace(trial.device, section="axisymmetric") if trial.kind != "seminar" else trial.device
    second = equations_of(device, trial.material, comm)
    try:
        return check(trial, ended, points, second)
    finally:
        second.release()
        gc.collect()


def main() -> None:
    from softmodels.mechanics.mpi import start

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=2013)
    parser.add_argument("--kind", choices=KINDS, default="section")
    parser.add_argument("--first", type=int, default=0, help="number of the case to begin with")
    given = parser.parse_args()
    comm = start()
    began, found = time.perf_counter(), []
    for trial in trials(given.count, given.seed, given.kind):
        if trial.number < given.first:
            continue
        found.append(examine(trial, comm))
        one = found[-1]
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        print(f"{trial.number}: {trial.quantity} by {trial.control}: {one.ended}, limit {one.limit_off:.1e}, state "
              f"{one.state_off:.1e} off; {memory:.0f} MB", flush=True)  # fmt: skip
        if one.fault:
            print(f"FAULT {one.fault}\n   {trial}", flush=True)
    took = time.perf_counter() - began
    endings = collections.Counter(one.ended.split(":")[0] for one in found)
    limit_off, state_off = (np.nanmax([getattr(one, name) for one in found] + [0.0]) for name in ("limit_off", "state_off"))
    print(
        f"{len(found)} cases in {took:.0f} s: {dict(endings)}; {sum(bool(one.fault) for one in found)} at fault; limits "
        f"within {limit_off:.1e}, last states within {state_off:.1e}"
    )


if __name__ == "__main__":
    main()
