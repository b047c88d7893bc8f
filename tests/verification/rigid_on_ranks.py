"""Figures of rigid parts, as JSON from rank 0: a plate on a membrane, a rigid ring, and a plate that turns on a slab.

mpiexec -n 2 python rigid_on_ranks.py MEMBRANE.msh BEAM.msh
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from softmodels.mechanics.mpi import is_root, start

COMM = start()

import numpy as np  # noqa: E402

import softmodels as sm  # noqa: E402
from softmodels.mechanics.body import Body  # noqa: E402
from softmodels.mechanics.controls import pressure_control  # noqa: E402
from softmodels.mechanics.rigid import Rigid  # noqa: E402
from softmodels.mechanics.solver import Solver  # noqa: E402
from softmodels.mechanics.system import System  # noqa: E402
from softmodels.path.stability import Stability  # noqa: E402

MEMBRANE = sm.Membrane(
    radius=0.02, thickness=0.001, clamp_width=0.0, plate_radius=0.005, rings=(0.008, 0.011), ring_thickness=0.001
)
DISK = sm.HollowDisk(section="wedge", angle=90.0, cell_size=0.006)


def figures(system, pressures):
    """Volume, the plate's motion, and the lowest eigenvalue at the last of some pressures."""
    solver, state = Solver(system), system.rest()
    for pressure in pressures:
        solver.factorise(state)
        state = solver.solve(pressure_control(pressure), state.w, pressure)
    solver.factorise(state)
    stability = Stability.of(solver)
    system.load(state)
    residual = system.residual()
    moved = [
        value for motion in system.unknowns.moving.values() for value in (*motion.values, *motion.wrench(residual)[0])
    ]
    return [state.V, stability.negative_eigenvalues(), stability.lowest(), *moved]


def main():
    law = sm.NeoHookean(30e3)
    membrane, disk = (
        Body.from_file(device, Path(file), COMM) for device, file in zip((MEMBRANE, DISK), sys.argv[1:], strict=True)
    )
    parts = [Rigid("plate", name="plate"), Rigid(region="ring1", name="ring")]
    found = {
        "plate and rigid ring": figures(System(membrane, law, parts=parts), (0.01, 0.02)),
        "wedge with a plate": figures(System(disk, law, parts=[Rigid("top", name="plate")]), (0.1,)),
    }
    if is_root(COMM):
        print(json.dumps({name: list(map(float, np.asarray(values))) for name, values in found.items()}))


if __name__ == "__main__":
    main()
