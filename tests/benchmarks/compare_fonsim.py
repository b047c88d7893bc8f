"""A thin balloon behind a tube against FONSim (a network of lumped pneumatic parts, which takes the balloon's curve as given).

    LD_LIBRARY_PATH=.venv/lib uv run --with fonsim python tests/benchmarks/compare_fonsim.py

(with the path to MPI's library). FONSim steps by implicit Euler, so the two come together as its step shrinks: 3.3e-2 of the
largest pressure at 1 s, 9.9e-3 at 0.25 s, 4.2e-3 at 0.1 s (FONSim 0.6.0).
"""

from __future__ import annotations

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import fonsim
import numpy as np
from mpi4py import MPI

sys.path.insert(0, str(Path(__file__).parents[2]))

from softmodels.case.load import steps_of
from softmodels.materials.laws import Yeoh
from softmodels.materials.specimens import sphere_pressure
from softmodels.mechanics.body import Body
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System
from softmodels.path.schedule import supply
from softmodels.path.steps import time_at
from softmodels.path.supply import VISCOSITY, Gas, Reservoir
from tests.support.bodies import Sphere

LAW = Yeoh(15e3, 0.0, 20.0, 0.5)
BALLOON = Sphere(inner=0.010, outer=0.0104, through=1, along=24)
SOURCE, SECONDS = 1700.0, 120.0
LENGTH, BORE = 1.0, 0.7e-3
AMBIENT = fonsim.pressure_atmospheric


class Curve:
    """The balloon's closed form with the tube's volume, as FONSim asks for it: absolute pressures and whole volumes."""

    dead = np.pi / 4 * BORE**2 * LENGTH

    def get_initial_volume(self, pressure: float) -> float:
        return BALLOON.cavity_volume + self.dead

    def pressure(self, volume: float) -> float:
        stretch = ((volume - self.dead) / BALLOON.cavity_volume) ** (1 / 3)
        return float(sphere_pressure(LAW, BALLOON.inner, BALLOON.outer, stretch)) + AMBIENT

    def fdf_volume(self, volume: float) -> tuple[float, float]:
        h = 1e-5 * volume
        return self.pressure(volume), (self.pressure(volume + h) - self.pressure(volume - h)) / (2 * h)


def by_fonsim(step: float) -> tuple[np.ndarray, np.ndarray]:
    """Return times in s and gauge pressures in Pa."""
    fonsim.air.mu = VISCOSITY
    system = fonsim.System()
    system.add(fonsim.PressureSource("source", pressure=AMBIENT + SOURCE))
    system.add(fonsim.CircularTube("tube", fluid=fonsim.air, length=LENGTH, diameter=BORE))
    system.add(fonsim.FreeActuator("balloon", fluid=fonsim.air, curve=Curve()))
    system.connect("source", "tube")
    system.connect("tube", "balloon")
    simulation = fonsim.Simulation(system, duration=SECONDS, step=step, relative_solving_tolerance=1e-6)
    simulation.run()
    return np.array(simulation.times), np.array(system.get("balloon").get("pressure")) - AMBIENT


def by_softmodels() -> tuple[np.ndarray, np.ndarray]:
    """Return the same."""
    reservoir = Reservoir(tube_length=LENGTH, tube_bore=BORE, dead_volume=0.0, ambient=AMBIENT)
    with TemporaryDirectory() as folder:
        body = Body.from_file(BALLOON, BALLOON.write(Path(folder) / "balloon.msh"), MPI.COMM_WORLD)
    solver = Solver(System(body, LAW))
    system = solver.system
    gas = Gas(reservoir, system.stress_unit, system.volume_unit)
    program = steps_of(source_pressure=[f"{SOURCE!r} Pa"] * 2, time_s=[0.0, SECONDS])
    path = supply(solver, program, gas)
    rows = [(time_at(program, come), point.state.P * system.stress_unit) for come, point in path]
    return tuple(np.array(rows).T)  # type: ignore[return-value]


if __name__ == "__main__":
    ours = by_softmodels()
    print(f"softmodels: {len(ours[0])} states, largest pressure {ours[1].max():.1f} Pa")
    for step in (1.0, 0.25, 0.1):
        times, pressures = by_fonsim(step)
        apart = np.interp(times, *ours) - pressures
        inside = times > 0.02 * SECONDS
        print(
            f"FONSim, step {step:g} s: apart by {np.abs(apart[inside]).max() / ours[1].max():.2e} of the largest pressure"
        )
