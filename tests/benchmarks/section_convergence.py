"""Mesh convergence of the axisymmetric devices, for their pages: rise, added volume and limit pressure on finer meshes.

As a program, ``python tests/benchmarks/section_convergence.py [Membrane] [Balloon] [Bellows]``: one line per device and mesh,
half a minute. In each row cells are half as long and twice as many through the wall; the silicone is the default one,
incompressible.
"""

from __future__ import annotations

import dataclasses
import math
import sys
import tempfile
from pathlib import Path

from softmodels.mechanics.mpi import start

LEVELS = (2.0, 1.0, 0.5, 0.25)
"""Cell size over the default one."""


def figures(device, comm, folder: Path):
    """Cells, rise in mm and added volume in ml at 20 cm of water, and the limit pressure in cm; nan if the path stops."""
    from softmodels.common.units import COLUMN
    from softmodels.materials.laws import NeoHookean
    from softmodels.mechanics.body import Body
    from softmodels.mechanics.solver import Solver
    from softmodels.mechanics.system import System
    from softmodels.path.continuation import Continuation, trace
    from softmodels.path.stability import PathEnd
    from softmodels.runs.fields import Fields

    law = NeoHookean(30e3, 0.5)
    solver = Solver(System(Body.from_file(device, device.write(folder / f"{device.name}.msh"), comm), law))
    fields = Fields(solver)
    found = [len(solver.system.cells)]
    try:
        for point in trace(Continuation(solver), [20 * COLUMN.pascal / law.shear_modulus, 0.5]):
            if point.requested:
                one = fields.figures(point.state)
                found += [one.rises["apex"] * 1e3, one.added_volume * 1e6]
    except PathEnd as end:
        found.append(end.limit.state.P * law.shear_modulus / COLUMN.pascal if end.limit else math.nan)
    return found


def main() -> None:
    comm = start()
    from geometries import Balloon, Bellows, Membrane

    with tempfile.TemporaryDirectory() as folder:
        for device in (Membrane(), Balloon(), Bellows()):
            if sys.argv[1:] and type(device).__name__ not in sys.argv[1:]:
                continue
            for size in LEVELS:
                through = max(1, round(device.rows / size))
                finer = dataclasses.replace(device, cell_size=size * device.cell_size, through=through)
                cells, rise, volume, limit = figures(finer, comm, Path(folder))
                print(
                    f"{type(device).__name__:9} {through} through, {cells:6d} cells: {rise:8.4f} mm, {volume:8.4f} ml, limit "
                    f"{limit:8.4f} cm",
                    flush=True,
                )


if __name__ == "__main__":
    main()
