"""Figures of rigid parts: plate and ring on a membrane, a plate on a wedge, one that turns on a beam."""

from __future__ import annotations

import numpy as np

import softmodels as sm
from softmodels.components.loads import Force
from softmodels.components.rigid import Rigid
from softmodels.mechanics.body import Body
from softmodels.mechanics.controls import pressure_control
from softmodels.mechanics.regions import rotation_vector
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System
from softmodels.path.schedule import apply_preload
from softmodels.path.stability import Stability

MEMBRANE = sm.Membrane(
    radius=0.02, thickness=0.001, clamp_width=0.0, plate_radius=0.005, rings=(0.008, 0.011), ring_thickness=0.001
)
DISK = sm.HollowDisk(section="wedge", angle=15.0, cell_size=0.006, fillet=0.0015)
BEAM = sm.Beam(length=0.020, width=0.004, thickness=0.004, part="full", cell_size=0.004)
CELL = sm.ChannelCell(around=8)
MESHES = {"membrane": MEMBRANE, "plated": DISK, "beam": BEAM, "cell": CELL}
LAW = sm.NeoHookean(30e3)


def inflated(system, pressures, method):
    """Volume, the plate's motion, and the lowest eigenvalue at the last of some pressures."""
    solver, state = Solver(system, method), system.rest()
    for pressure in pressures:
        solver.factorise(state)
        state = solver.solve(pressure_control(pressure), state.w, pressure)
    solver.factorise(state)
    stability = Stability.of(solver)
    system.load(state)
    residual = system.residual()
    moved = [value for motion in system.unknowns.moving.values() for value in (*motion.values, *motion.wrench(residual)[0])]
    return [state.V, stability.negative_eigenvalues(), stability.lowest(), *moved]


def turned(system, method):
    """Motion of a plate that dead forces turn, the energy stored, and the lowest eigenvalue."""
    solver = Solver(system, method)
    state = apply_preload(solver, [("the forces", system.dead.amounts / system.dead.units)], lambda text: None).state
    solver.factorise(state)
    stability = Stability.of(solver)
    system.load(state)
    plate = system.unknowns.moving["plate"]
    motion = [*plate.translation, *rotation_vector(plate.rotation)]
    return [*motion, system.stored_energy(), stability.negative_eigenvalues(), stability.lowest()]


def figures(comm, folder, method="direct"):
    """Lists of numbers by what they are of, the same on all ranks; ``method`` is of the linear solver."""
    membrane, disk, beam, cell = (Body.from_file(device, folder / f"{name}.msh", comm) for name, device in MESHES.items())
    components = [Rigid("plate", name="plate"), Rigid(region="ring1", name="ring")]
    pushed = [Rigid("tip", name="plate"), Force("tip", "-z", 0.02, name="down"), Force("tip", "y", 0.01, name="aside")]
    values = {
        "wedge with a plate": inflated(System(disk, LAW, components=[Rigid("top", name="plate")]), (0.1,), method),
        "plate that turns": turned(System(beam, LAW, components=pushed), method),
        "planes that travel": inflated(System(cell, LAW), (0.1,), method),
    }
    if method == "direct":
        values["plate and rigid ring"] = inflated(System(membrane, LAW, components=components), (0.01, 0.02), method)
    return {name: list(map(float, np.asarray(one))) for name, one in values.items()}
