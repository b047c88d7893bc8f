"""Figures of a disk's wedge whose top rubs on a plate as it is pressed on and let off, on any number of ranks."""

from __future__ import annotations

from pathlib import Path


def figures(comm, device, mesh: Path) -> list[float]:
    """Volume, forces, slip and work at the ends of both ways."""
    from softmodels.case.load import steps_of
    from softmodels.components.contact import RigidShape
    from softmodels.materials.laws import NeoHookean
    from softmodels.mechanics.body import Body
    from softmodels.mechanics.solver import Solver
    from softmodels.mechanics.system import System
    from softmodels.path.schedule import follow

    plate = RigidShape(
        "plane", "top", (0.0, 0.0, device.height + 2e-4), along=(0.0, 0.0, -1.0), friction=0.5, slip=5e-5, name="plate"
    )
    solver = Solver(System(Body.from_file(device, mesh, comm), NeoHookean(30e3, 0.49), components=[plate]))
    system, found = solver.system, []
    for come, point in follow(solver, steps_of(cavity1={"pressure_cm": [25, 10]})):
        if point.requested and come >= 1.0:
            system.load(point.state)
            found += [point.state.V, *system.potential.terms["plate"].figures(system).values()]
    return found
