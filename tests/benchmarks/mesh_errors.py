"""Mesh errors that runs of random devices state unasked, against the error to a mesh with cells four times smaller.

    python -m tests.benchmarks.mesh_errors --cases 60 --seed 1

Prints for each quantity how often the stated half width holds the true error, and how often it is within a factor of 3 of it.
The reference is a section two refinements finer than the device's own; one kind in eight is a wedge, which is compared with its
section. Errors below a millionth of the number are not counted.
"""

from __future__ import annotations

import argparse
import collections
import dataclasses
import tempfile
from pathlib import Path

import numpy as np

import softmodels as sm
from softmodels.api.calls import case_of
from softmodels.mechanics import mpi
from softmodels.runs import mesh_error, table
from softmodels.runs.simulation import MIN_COMPANION_STEPS, Simulation

REFERENCE = 4.0
LEAST_ERROR = 1e-6


def devices(random: np.random.Generator) -> tuple[sm.Actuator, str]:
    """Return a random device of one of eight kinds and a pressure at which it is well deformed."""
    kind, scale = random.integers(8), random.uniform(0.7, 1.4)
    cells = random.uniform(0.7, 1.3)
    if kind == 0:
        device = sm.HollowDisk(section="axisymmetric", membrane=0.004 * scale, cell_size=0.003 * cells)
        return device, f"{random.uniform(20, 60) * scale:.3g} cm"
    if kind == 1:
        device = sm.HollowDisk.variant("shadow", section="axisymmetric", cell_size=0.003 * cells)
        return device, f"{random.uniform(5, 20):.3g} cm"
    if kind == 2:
        return sm.Balloon(wall=0.002 * scale, cell_size=0.001 * cells), f"{random.uniform(4, 10) * scale:.3g} cm"
    if kind == 3:
        return sm.Membrane(thickness=0.001 * scale, cell_size=0.001 * cells), f"{random.uniform(4, 15) * scale:.3g} cm"
    if kind == 4:
        return sm.Cylinder(section="axisymmetric", cell_size=0.002 * cells), f"{random.uniform(1, 5):.3g} kPa"
    if kind == 5:
        return sm.Bellows(wall=0.0015 * scale), f"{random.uniform(3, 10) * scale:.3g} cm"
    if kind == 6:
        return sm.HollowDisk(membrane=0.004 * scale, cell_size=0.004 * cells), f"{random.uniform(20, 60) * scale:.3g} cm"
    return sm.SuctionCup(cell_size=0.001 * cells), f"-{random.uniform(0.1, 0.6):.3g} kPa"


def laws(random: np.random.Generator) -> sm.Material:
    """Return a random law."""
    modulus = random.uniform(15e3, 40e3)
    made = sm.NeoHookean(modulus), sm.Yeoh(modulus / 2, 60.0), sm.MooneyRivlin(0.4 * modulus, 0.1 * modulus)
    return made[random.integers(3)]


def solved(case: sm.Case) -> table.PathTable:
    """Return the path of a case in few steps."""
    simulation = Simulation(case, mpi.start())
    simulation.min_steps = MIN_COMPANION_STEPS
    try:
        with tempfile.TemporaryDirectory() as folder:
            simulation.write_mesh(mesh := Path(folder) / "mesh.msh")
            simulation.prepare(mesh)
            return table.PathTable(step.row for step in simulation.steps())
    finally:
        simulation.release()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    ratios = collections.defaultdict(list)
    for number in range(options.cases):
        random = np.random.default_rng([options.seed, number])
        device, pressure = devices(random)
        case = case_of(device, laws(random), pressure)
        try:
            other = mesh_error.companion(case, unasked=True)
            finest = other.actuator.refined(REFERENCE / mesh_error.FINER[2])
            coarse, finer, reference = map(solved, (case, other, dataclasses.replace(case, actuator=finest)))
        except RuntimeError as error:
            print(f"{type(device).__name__} at {pressure}: left out ({error})")
            continue
        stated, truth = mesh_error.MeshErrors(case, coarse, finer), mesh_error.MeshErrors(case, coarse, reference)
        last = coarse[-1]
        for name, half in stated.of(last).items():
            true = abs(last[name] - truth.paired(last)[name])
            if true > LEAST_ERROR * abs(last[name]):
                ratios[name].append(half / true)
                where = f"{type(device).__name__} at {pressure}, {name}"
                print(f"{where}: stated {half / true:.3g} times the true {true:.3g}", flush=True)
    every = np.concatenate(list(ratios.values()))
    for name, values in [*ratios.items(), ("all", every)]:
        held, near = np.mean(np.asarray(values) >= 1.0), np.mean((np.asarray(values) < 3.0) & (np.asarray(values) > 1 / 3))
        print(f"{name}: {len(values)} numbers, {held:.0%} held, {near:.0%} within a factor of 3")


if __name__ == "__main__":
    main()
