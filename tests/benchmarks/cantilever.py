"""Beams under their weight and a force on the tip against a geometrically exact beam, on finer and finer cells.

Usage: OMP_NUM_THREADS=1 python tests/benchmarks/cantilever.py [CELL in mm ...]

The beam is that of `tests/verification/test_loads.py`: 60 x 6 x 3 mm, 60 kPa, its clamped end free to thin. Printed is the
distance of the tip from the exact beam's in its deflections. Measured on cells of 3 mm: 3.0e-3 (weight), 4.0e-3 (force), 2.0e-3
(both); on 2 mm, two across the thickness: 3.2e-4, 1.8e-3, 4.6e-4, in 15 s of one core.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

from geometries import Beam
from tests.support.exact_beam import STIFF, elastica


def main(cells: list[float]) -> None:
    from softmodels.components.loads import Force, Gravity
    from softmodels.mechanics.body import Body
    from softmodels.mechanics.mpi import start
    from softmodels.mechanics.solver import Solver
    from softmodels.mechanics.system import System
    from softmodels.path.schedule import apply_preload
    from softmodels.runs.fields import Fields

    comm = start()
    for cell in cells:
        beam = Beam(length=0.060, width=0.006, thickness=0.003, cell_size=cell * 1e-3, clamp="slip")
        with tempfile.TemporaryDirectory() as folder:
            body = Body.from_file(beam, beam.write(Path(folder) / "beam.msh"), comm)
        components = (Gravity(direction="-z", density=1000.0), Force(face="tip", direction="-z", name="tip"))
        solver = Solver(System(body, STIFF, components=components))
        fields, weight = Fields(solver), float(solver.system.dead.amounts[0])
        for heavy, pulled in ((weight, 0.0), (0.0, 0.3 * weight), (weight, 0.3 * weight)):
            hung = apply_preload(solver, [("the loads", np.array([heavy, pulled]) / solver.system.dead.units)])
            device = fields.figures(hung.state).device
            wanted = elastica(heavy, pulled)
            apart = np.array([device["tip_x_mm"], device["tip_z_mm"]]) * 1e-3 - wanted
            print(
                f"{cell:g} mm, {solver.system.n} unknowns, weight {heavy:.4g} N, force {pulled:.4g} N: tip "
                f"{wanted[1] * 1e3:.2f} mm, {np.linalg.norm(apart) / -wanted[1]:.2g} of that away"
            )


if __name__ == "__main__":
    main([float(text) for text in sys.argv[1:]] or [3.0, 2.0])
