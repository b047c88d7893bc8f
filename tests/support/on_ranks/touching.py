"""Figures of two blocks that rub on each other, on any number of ranks."""

from __future__ import annotations

from pathlib import Path

from tests.support.bodies import TwoBlocks

MESHES = {"blocks": TwoBlocks(wide=0.006, below=0.005, above=0.004)}


def figures(comm, folder: Path) -> list[float]:
    """Travel, forces, area and work of the blocks under a force that comes and partly goes."""
    import softmodels as sm
    from softmodels.case.load import steps_of
    from softmodels.mechanics.body import Body
    from softmodels.mechanics.solver import Solver
    from softmodels.mechanics.system import System
    from softmodels.path.schedule import follow

    joint = sm.BodyContact(("lower", "upper"), name="joint", friction=0.3)
    stiff = sm.Region(sm.NeoHookean(90e3, 0.45), name="upper")
    parts = [joint, stiff, sm.Force("lid", "-z"), sm.Spring("upper", 1e-3, name="weak")]
    body = Body.from_file(MESHES["blocks"], folder / "blocks.msh", comm)
    solver = Solver(System(body, sm.NeoHookean(30e3, 0.3), components=parts))
    system, found = solver.system, []
    for come, point in follow(solver, steps_of(force={"force_N": [3.0, 1.5]})):
        if point.requested and come >= 1.0:
            system.load(point.state)
            found += [point.state.V, *system.potential.terms["joint"].figures(system).values()]
    return found
