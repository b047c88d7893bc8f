"""Derivatives of a disk's section through its steps in time."""

from __future__ import annotations

import numpy as np

import softmodels as sm
from softmodels.mechanics.body import Body
from softmodels.mechanics.controls import pressure_control
from softmodels.mechanics.sensitivity import InTime, Sensitivity
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import System

LAW = sm.Yeoh(14e3, 300.0).with_memory(branches=[(0.2, 1.0), (0.1, 30.0)], softening=(1.6, "2 kPa", 0.1))
NAMES = ("c1", "c2", "share1", "time1", "share2", "softening", "softening_m", "poisson")
TIMES = np.concatenate([np.linspace(0.2, 1.0, 4), np.geomspace(2.0, 20.0, 4), np.linspace(20.2, 21.0, 4)])


def pressure(time: float) -> float:
    """In Pa."""
    return float(np.interp(time, [0.0, 1.0, 20.0, 21.0], [0.0, 4e3, 4e3, 1e3]))


MESHES = {"creeping": sm.HollowDisk(section="axisymmetric", cell_size=3e-3)}


def figures(comm, folder) -> dict[str, list[float]]:
    """Derivatives of the volume at the ends of the rise, the hold and the fall, by parameter."""
    solver = Solver(System(Body.from_file(MESHES["creeping"], folder / "creeping.msh", comm), LAW, creeping=True))
    eq = solver.system
    state, last, found = eq.rest(), 0.0, dict[str, list[float]]()
    eq.potential.commit(state.w, reset=True)
    in_time = InTime(Sensitivity(solver), NAMES, ["level"])
    for number, time in enumerate(TIMES.tolist(), 1):
        eq.potential.pass_time(time - last)
        line = pressure_control(pressure(time) / eq.stress_unit)
        state, last = solver.solve(line, state.w, line.target), time
        _, rates = in_time.step(state, line, {"level": pressure(time)})
        eq.potential.commit(state.w)
        if number % 4 == 0:
            for name, rate in rates.items():
                found.setdefault(name, []).append(rate.V)
    return found
