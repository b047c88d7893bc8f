"""A program, not a test: figures of a wedge, a slab with channels and a disk past its limit, as one line of JSON on rank 0.

Usage: mpirun -n 2 python figures.py WEDGE.msh SLAB.msh SECTION.msh
"""

from __future__ import annotations

import dataclasses
import json
import sys
from pathlib import Path

from geometries import HollowDisk, SeminarActuator
from softmodels.parallel import abort_on_error, is_root, start

WEDGE = HollowDisk(angle=15.0, cell_size=0.006, fillet=0.0015)
SLAB = SeminarActuator(channels=1, spread=20.0, around=4.0, cell_size=0.006)
SECTION = HollowDisk.variant("shadow", section="axisymmetric", support="base", cell_size=0.003)


def figures(comm, wedge: Path, slab: Path, section: Path) -> dict[str, list[float]]:
    """Key figures by state; the same on every rank."""
    from softmodels.body import Body
    from softmodels.equilibrium import Equilibrium
    from softmodels.fields import Fields
    from softmodels.loading import Path as LoadPath
    from softmodels.loading import PathEnd, trace
    from softmodels.materials import NeoHookean

    found = {}
    for name, device, file in (("wedge", WEDGE, wedge), ("slab", SLAB, slab)):
        equations = Equilibrium(Body.from_file(device, file, comm), NeoHookean(30e3, 0.49))
        fields = Fields(equations)
        for point in trace(LoadPath(equations), [0.1, 0.4]):
            if point.requested:
                values = dataclasses.asdict(fields.figures(point.state))
                values.update(values.pop("rises"), **values.pop("device"))
                found[f"{name} at {point.state.P:g}"] = [*values.pop("max_stretch_at"), *values.values()]
    equations = Equilibrium(Body.from_file(SECTION, section, comm), NeoHookean(20e3, 0.495))
    try:
        list(trace(LoadPath(equations), [1.0]))
    except PathEnd as end:
        found["limit"] = [end.limit.state.P]
    return found


if __name__ == "__main__":
    world = start()
    abort_on_error(world)
    result = figures(world, *map(Path, sys.argv[1:4]))
    if is_root(world):
        print(json.dumps({**result, "ranks": world.size}))
