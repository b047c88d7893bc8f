"""Random devices of every kind with random loads, parts and silicones: each ends in its value or in a named physical limit.

    OMP_NUM_THREADS=1 uv run python tests/benchmarks/random_cases.py --count 100
    OMP_NUM_THREADS=1 uv run python tests/benchmarks/random_cases.py --count 20 --solid

Devices are those that are registered, with every length up to a third off its default; sections unless ``--solid``. A case at
fault is one that crashed, was lost without a physical reason, or whose work by the air and by the loads is not what is stored:
the trapezoidal rule over the path's own steps, within `BALANCE`.

A case that its own checks refuse is drawn anew and counted; it is a sentence and not a fault.
"""

from __future__ import annotations

import argparse
import collections
import dataclasses
import random
import time
from typing import Any

import numpy as np

import softmodels as sm
from geometries import ACTUATORS, Actuator, GeometryError
from geometries.fields import about
from geometries.kinds import Length
from softmodels.case.case import Case, CaseError
from softmodels.mechanics.parts import Part, PartError
from softmodels.results.outcomes import DONE, NO_EQUILIBRIUM

BALANCE = 0.05
"""Share of the largest energy by which work and stored energy may differ: paths have twelve steps or more."""
IMPORTED = ("ImportedActuator", "ImportedMesh")


def device_of(chance: random.Random, solid: bool) -> Actuator:
    """A device with lengths of its own; GeometryError where they make none."""
    names = sorted(
        name for name, kind in ACTUATORS.items() if name not in IMPORTED and kind.__module__.startswith("geom")
    )
    while True:
        kind = ACTUATORS[chance.choice(names)]
        base = kind()
        if solid == (base.dimension == 3):
            break
        if "section" in about(kind) and not solid:
            base = dataclasses.replace(base, section="axisymmetric")  # type: ignore[call-arg]
            break
        if "section" in about(kind) and chance.random() < 0.5:
            base = dataclasses.replace(base, section="wedge")  # type: ignore[call-arg]
            break
    scale = 10 ** chance.uniform(-0.3, 0.3)
    changes = {}
    for name, field in about(base).items():
        value = getattr(base, name)
        if isinstance(field.kind, Length) and isinstance(value, float) and value > 0.0:
            coarse = 1.5 if name == "cell_size" and solid else 1.0
            changes[name] = value * scale * (coarse if not field.shape else chance.uniform(0.7, 1.33))
    return dataclasses.replace(base, **changes)


def material_of(chance: random.Random) -> Any:
    mu, nu = 10 ** chance.uniform(4.0, 5.2), chance.choice([0.49, 0.495, 0.5])
    laws = [
        sm.NeoHookean(mu, nu), sm.MooneyRivlin(0.4 * mu, 0.1 * mu, nu), sm.Yeoh(mu / 2, mu / 100, mu / 5000, nu),
        sm.Gent(mu, chance.uniform(10, 60), nu),
    ]  # fmt: skip
    return chance.choice(laws)


def parts_of(chance: random.Random, device: Actuator, mu: float) -> list[Part]:
    """Up to two of gravity, a force, a rigid plate, and, in a solid, a sphere in the way."""
    from softmodels.mechanics.loads import Force, Gravity
    from softmodels.mechanics.rigid import Rigid
    from softmodels.mechanics.rigid_shapes import RigidShape

    lift = np.asarray(device.lift)
    up, down = (", ".join(f"{value:g}" for value in sign * lift) for sign in (1, -1))
    faces = list(device.faces) or ["outer"]
    newtons = mu * device.size**2 * 10 ** chance.uniform(-3.0, -1.0)
    tip = np.asarray(next(iter(device.probes.values())))
    radius = device.size * chance.uniform(0.2, 1.0)
    place = tip + lift * (radius + device.size * chance.uniform(0.02, 0.2))
    makers: list[Any] = [
        lambda: Gravity(density=1070.0, direction=chance.choice([up, down])),
        lambda: Force(chance.choice(faces), chance.choice([up, down]), newtons, name="pull"),
        lambda: Rigid(face=chance.choice(faces), name="plate"),
        lambda: RigidShape(shape="sphere", faces=chance.choice(faces), at=tuple(place), radius=radius, name="ball"),
    ]
    return [maker() for maker in chance.sample(makers, chance.choice([0, 1, 1, 2]))]


def case_of(number: int, seed: int, solid: bool) -> tuple[Case, collections.Counter[str]]:
    """A case that can be meant, and what was refused before it was drawn."""
    chance, refused = random.Random(f"{seed} {number} {solid}"), collections.Counter[str]()
    while True:
        try:
            device, material = device_of(chance, solid), material_of(chance)
            mu = material.shear_modulus_0
            parts = tuple(parts_of(chance, device, mu))
            if chance.random() < 0.6:
                goal: dict[str, tuple[float, ...]] = {
                    "pressures_cm": (0.0, mu * 10 ** chance.uniform(-1.5, 0.3) / 95.1)
                }
            else:
                goal = {"volumes_ml": (0.0, 1e6 * device.cavity_volume * 10 ** chance.uniform(-0.7, 0.6))}
            return Case(f"case{number}", device, material, parts=parts, **goal), refused  # type: ignore[arg-type]
        except (GeometryError, CaseError, ValueError) as error:
            refused[str(error)[:80]] += 1


def fault_of(run: Any) -> tuple[str, str]:
    """How a run ended, in a word, and what is wrong with that, or nothing."""
    status, message = run._ended.status, run._ended.message
    if status not in (DONE, NO_EQUILIBRIUM) and "the cavity has grown" not in message:
        return "lost", message
    rows = run.rows
    P, V, stored = (np.array([row[c] for row in rows]) for c in ("pressure_Pa", "added_volume_ml", "stored_energy_mJ"))
    loads = np.array([row.get("loads_energy_mJ", 0.0) for row in rows])
    work = np.concatenate([[0.0], np.cumsum((P[1:] + P[:-1]) / 2 * np.diff(V))]) * 1e-3
    gained = stored + loads - (stored + loads)[0]
    off = float(np.abs(gained - work).max() / max(np.abs(gained).max(), np.abs(work).max(), np.abs(loads).max(), 1e-12))
    ended = "reached" if status == DONE else "limit"
    return ended, f"work and energy differ by {off:.1%}" if off > BALANCE else ""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=14)
    parser.add_argument("--first", type=int, default=0, help="number of the case to begin with")
    parser.add_argument("--solid", action="store_true", help="solid slices in place of sections")
    given = parser.parse_args()
    endings: collections.Counter[str] = collections.Counter()
    refused: collections.Counter[str] = collections.Counter()
    began, faults = time.perf_counter(), 0
    for number in range(given.first, given.first + given.count):
        case, sentences = case_of(number, given.seed, given.solid)
        refused += sentences
        told = f"{number}: {type(case.actuator).__name__}, {', '.join(part.where for part in case.parts) or 'alone'}"
        try:
            ended, fault = fault_of(sm.run(case))
        except PartError as error:  # only the mesh shows that it cannot be there
            ended, fault = "refused", ""
            refused[str(error)[:80]] += 1
        except sm.RunError as error:
            ended, fault = "lost", str(error)
        except Exception as error:
            ended, fault = "crashed", f"{type(error).__name__}: {error}"
        endings[ended] += 1
        print(f"{told}, {case.quantity} to {case.values[-1]:.4g} {case.unit}: {ended}", flush=True)
        if fault:
            faults += 1
            print(f"FAULT {fault}\n{case.to_toml()}", flush=True)
    took = time.perf_counter() - began
    print(
        f"{given.count} cases in {took:.0f} s: {dict(endings)}; {faults} at fault; {sum(refused.values())} draws refused:"
    )
    for sentence, count in refused.most_common(12):
        print(f"  {count:4d}  {sentence}")


if __name__ == "__main__":
    main()
