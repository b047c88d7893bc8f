"""Figures of a disk's wedge that lifts a ball of triangles, on any number of ranks."""

from __future__ import annotations

import tempfile
from pathlib import Path

from geometries import HollowDisk
from softmodels.components.contact import RigidShape
from softmodels.components.loads import Gravity
from softmodels.materials.laws import NeoHookean
from softmodels.mechanics.body import Body
from softmodels.mechanics.controls import volume_control
from softmodels.mechanics.mpi import on_root
from softmodels.mechanics.sensitivity import Sensitivity
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System
from tests.support import stl_files


def figures(comm, device: HollowDisk, mesh: Path) -> list[float]:
    """State, energy, the pressure's derivative by the modulus, the ball's columns, and the inertia; on every rank.

    The ball is from an STL file, with a mass and on a spring.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(comm.bcast(folder)) / "ball.stl"
        on_root(comm, lambda: stl_files.write_stl(file, *stl_files.ball(0.01)))
        at = (0.0, 0.0, device.height + 0.011)
        ball = RigidShape("stl", "top", at, file=str(file), guide="z", spring=20.0, mass=0.001, name="ball")
        solver = Solver(
            System(
                Body.from_file(device, mesh, comm),
                NeoHookean(30e3, 0.49),
                components=[ball, Gravity("-z", density=0.0)],
            )
        )
        comm.barrier()
    system = solver.system
    state = rest = system.rest()
    for share in (1.1, 1.2, 1.3, 1.4, 1.5):
        state = solver.solve(volume_control(share * rest.V), state.w, state.P)
    _, rates = Sensitivity(solver).rates(state, volume_control(state.V), ("shear_modulus",))
    system.load(state)
    shown = system.potential.terms["ball"].figures(system).values()
    negative = float(solver.bordered.negative_eigenvalues())
    return [state.P, system.stored_energy(), rates["shear_modulus"].P, *shown, negative]
