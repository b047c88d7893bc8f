"""A program, not a test: a finger that bends onto a rigid rod, by cell size, and one whose chambers meet.

    uv run python tests/benchmarks/finger_on_rod.py

Force on the rod in mN at 600 and 900 Pa (halves of 4,327, 7,451 and 11,754 unknowns): 1.219 and 8.26, 1.184 and 7.73, 1.183
and 7.89. It takes about a quarter of a minute on a free core.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from softmodels.mechanics.mpi import is_root, start

PRESSURES = (300.0, 600.0, 900.0)


def main() -> None:
    """Print the forces."""
    comm = start()
    from geometries import PneuNet
    from softmodels.components.contact import RigidShape, Walls
    from softmodels.materials.silicones import SILICONES
    from softmodels.mechanics.body import Body
    from softmodels.mechanics.component import EnergyComponent
    from softmodels.mechanics.solver import Solver
    from softmodels.mechanics.system import System
    from softmodels.path.continuation import Continuation, trace

    def follow(device: PneuNet, part: EnergyComponent) -> None:
        with tempfile.TemporaryDirectory() as folder:
            name = comm.bcast(str(Path(folder) / "finger.msh"))
            if is_root(comm):
                device.write(Path(name))
            comm.barrier()
            body = Body.from_file(device, Path(name), comm)
        solver = Solver(System(body, SILICONES["ecoflex-00-30"].material, components=[part]))
        system = solver.system
        for point in trace(Continuation(solver), [P / system.stress_unit for P in PRESSURES]):
            if point.requested:
                system.load(point.state)
                figures = system.potential.terms[part.label].figures(system)
                if is_root(comm):
                    print(device.cell_size, system.n, f"{point.state.P * system.stress_unit:.0f} Pa", figures, flush=True)

    for cell_size in (0.005, 0.0035, 0.0025):
        finger = PneuNet(chambers=2, cell_size=cell_size)
        radius = 0.006
        place = (finger.length - 0.004, 0.0, -0.5 * finger.base - radius - 0.0005)
        follow(finger, RigidShape("cylinder", "bottom", place, radius, (0.0, 1.0, 0.0), name="rod"))
    follow(PneuNet(chambers=2, cell_size=0.0035), Walls("chamber_walls"))


if __name__ == "__main__":
    main()
