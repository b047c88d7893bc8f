"""What a design costs: the gradient beside the state's own Newton solve, and a design beside a whole path.

    uv run python tests/benchmarks/design_cost.py --device slab            # the default half of the seminar actuator
    uv run python tests/benchmarks/design_cost.py --device disk            # a section
    mpirun -n 2 .venv/bin/python tests/benchmarks/design_cost.py --device slab

All is measured in one process, one thing after the other: read the ratios.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from softmodels.case.load import steps_of
from softmodels.mechanics.mpi import is_root, start

PRESSURE = 177 * 95.1


def devices(name, coarse):
    from geometries import HollowDisk, SeminarActuator

    if name == "disk":
        return HollowDisk(section="axisymmetric", profile=(1.0,) * 12, cell_size=0.0015)
    return SeminarActuator(cell_size=0.006, around=6.0) if coarse else SeminarActuator()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", choices=("slab", "disk"), default="slab")
    parser.add_argument("--coarse", action="store_true", help="the slab with cells of 6 mm")
    given = parser.parse_args()
    comm = start()

    from softmodels.case.case import Case
    from softmodels.case.materials import DEFAULT
    from softmodels.design.extremes import PeakStretch
    from softmodels.design.model import DesignModel
    from softmodels.design.quantities import AddedVolume, Place, Rise, StoredEnergy
    from softmodels.materials.silicones import silicone_called
    from softmodels.mechanics.controls import pressure_control

    device = devices(given.device, given.coarse)
    quantities = (Rise(at=PRESSURE), Place(at=PRESSURE, axis="x"), AddedVolume(at=PRESSURE), StoredEnergy(at=PRESSURE))
    quantities += (PeakStretch(at=PRESSURE),)
    material = DEFAULT if given.device == "disk" else silicone_called("ecoflex-00-30").material
    case = Case(name="cost", actuator=device, material=material, steps=steps_of(pressure_cm=(177.0,)))
    names = device.movable[:20]
    model = DesignModel(case, names, quantities, comm)
    say = print if is_root(comm) else lambda *words: None

    def timed(task):
        comm.barrier()
        began = time.perf_counter()
        result = task()
        comm.barrier()
        return time.perf_counter() - began, result

    theta = model.start
    model.evaluate(theta)  # compiles
    meshed = model.meshed
    space = meshed.design.system.space.dofmap
    unknowns = space.index_map.size_global * space.index_map_bs
    say(
        f"{type(device).__name__}: {unknowns} unknowns, {comm.size} ranks; "
        f"{len(quantities)} quantities by {len(names)} parameters"
    )
    path, _ = timed(meshed.states.trace)
    ((load, state),) = meshed.states.states.items()
    moved = theta.copy()
    moved[0] *= 1.01
    meshed.design.motion.move(model.device(moved))
    control = pressure_control(load.value / meshed.design.system.stress_unit)

    def newton():
        meshed.solver.factorise(state)
        return meshed.solver.solve(control, state.w, state.P)

    solve, found = timed(newton)
    meshed.states.states[load] = found
    gradient, _ = timed(meshed.judge)
    say(
        f"path from rest {path:.2f} s; Newton solve {solve:.2f} s ({found.iterations} iterations); gradient {gradient:.2f} s"
    )
    say(f"the gradient over the state's Newton solve: {gradient / solve:.2f}")
    rates = []
    for i in range(3):
        change = 1 + 0.01 * np.random.default_rng(i).uniform(-1, 1, len(theta))
        took, design = timed(lambda change=change: model.evaluate(theta * change))
        rates.append(took)
        say(f"design {i + 1}: {took:.2f} s, {design.newton} Newton iterations, remeshed: {design.remeshed}")
    say(f"a design over its path from rest: {np.median(rates) / path:.2f}")
    say(
        f"paths that central differences would have cost for one gradient: {2 * len(names)}, {2 * len(names) * path:.0f} s"
    )


if __name__ == "__main__":
    main()
