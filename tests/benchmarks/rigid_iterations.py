"""Iterations and set-ups of the iterative solver with rigid parts and without them.

    python tests/benchmarks/rigid_iterations.py

Prints a row per device and formulation: unknowns, iterations of a solve to 1e-7 and seconds of a set-up at rest, both without
and with the parts. Figures of one core of a busy machine (read ratios) are in docs/pages/explanation/solvers.md.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import numpy as np
from mpi4py import MPI

import softmodels as sm
from softmodels.components.rigid import Rigid
from softmodels.mechanics.body import Body
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System

LAW = sm.NeoHookean(30e3, 0.49)
MEMBRANE = sm.Membrane(
    radius=0.02, thickness=0.001, clamp_width=0.0, plate_radius=0.005, rings=(0.008, 0.011), ring_thickness=0.001
)
PLATE = Rigid("plate", name="plate")
CASES = {
    "section of a membrane, plate and ring": (MEMBRANE, (PLATE, Rigid(region="ring1", name="ring"))),
    "section of a disk, plate": (sm.HollowDisk(section="axisymmetric", cell_size=0.002), (Rigid("top", name="plate"),)),
    "wedge of a disk, plate": (sm.HollowDisk(angle=45.0, cell_size=0.004), (Rigid("top", name="plate"),)),
    "wedge of a membrane, plate": (
        sm.Membrane(section="wedge", angle=30.0, radius=0.02, thickness=0.002, plate_radius=0.005), (PLATE,)
    ),
    "whole beam, its tip": (
        sm.Beam(length=0.04, width=0.004, thickness=0.004, part="full", cell_size=0.002), (Rigid("tip", name="plate"),)
    ),
    "half of a PneuNet, its tip": (sm.PneuNet(), (Rigid("tip", name="plate"),)),
}  # fmt: skip


def measured(system: System) -> tuple[int, int, float]:
    """Unknowns, iterations for a rough force, and seconds of a set-up after the first one."""
    solver = Solver(system, "iterative")
    solver.factorise(system.rest())
    solver.lagged.invalidate()
    begun = time.process_time()
    solver.factorise(system.rest())
    seconds = time.process_time() - begun
    force = np.random.default_rng(0).normal(size=system.n)
    b = system.K.createVecRight()
    b.array_w[:] = system.pressure_loads()[0] if system.drives_cavities else system.by_unknowns(force)
    return system.K.getSize()[0], solver.bordered.iterate(b, b.duplicate(), 1e-7), seconds


def main() -> None:
    for name, (device, components) in CASES.items():
        with tempfile.TemporaryDirectory() as folder:
            body = Body.from_file(device, device.write(Path(folder) / "body.msh"), MPI.COMM_SELF)
        for formulation in ("mixed", "displacement"):
            rows = [measured(System(body, LAW, formulation, components=own)) for own in ((), components)]
            told = "; ".join(f"{iterations} iterations, {seconds:.2f} s" for _, iterations, seconds in rows)
            print(f"{name}, {formulation}, {rows[1][0]} unknowns: {told}", flush=True)


if __name__ == "__main__":
    main()
