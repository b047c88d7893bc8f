"""A program, not a test: figures of a wedge and of a disk past its limit point, as one line of JSON on rank 0.

Usage: mpirun -n 2 python figures.py WEDGE.msh SECTION.msh
"""

from __future__ import annotations

import dataclasses
import json
import sys
from pathlib import Path

from geometries import HollowDisk
from softmodels.parallel import abort_on_error, is_root, start

WEDGE = HollowDisk(angle=15.0, cell_size=0.006, fillet=0.0015)
SECTION = HollowDisk.variant("shadow", section="axisymmetric", support="base", cell_size=0.003)


def figures(comm, wedge: Path, section: Path) -> dict[str, list[float]]:
    """Key figures by state; the same on every rank."""
    from softmodels.body import Body
    from softmodels.equilibrium import Equilibrium
    from softmodels.fields import Fields
    from softmodels.loading import Path as LoadPath
    from softmodels.loading import PathEnd, trace
    from softmodels.materials import NeoHookean

    found = {}
    wedge_equations = Equilibrium(Body.from_file(WEDGE, wedge, comm), NeoHookean(30e3, 0.49))
    fields = Fields(wedge_equations)
    for point in trace(LoadPath(wedge_equations), [0.1, 0.4]):
        if point.requested:
            values = dataclasses.asdict(fields.figures(point.state))
            values.update(values.pop("rises"))
            found[f"wedge at {point.state.P:g}"] = list(values.values())
    equations = Equilibrium(Body.from_file(SECTION, section, comm), NeoHookean(20e3, 0.495))
    points = []
    try:
        for point in trace(LoadPath(equations), [1.0]):
            points.append(point)
    except PathEnd as end:
        found["limit"] = [end.limit.state.P]
    found["falling directions"] = [float(point.signature.excess) for point in points]
    found["lowest eigenvalue"] = [points[0].signature.lowest, points[-1].signature.lowest]
    return found


if __name__ == "__main__":
    world = start()
    abort_on_error(world)
    result = figures(world, Path(sys.argv[1]), Path(sys.argv[2]))
    if is_root(world):
        print(json.dumps({**result, "ranks": world.size}))
