"""Mesh errors that runs state, against the error to a much finer mesh, over all devices; and those of the default meshes.

    python -m tests.benchmarks.mesh_errors --draws 3 --seed 1

Each device is solved on a ladder of meshes: a section with cells 2, 1, 1/2 and 1/4 times as large as by default, a solid with
9/4, 3/2, 1 and 2/3 times (large ones to 1). A mesh's stated half width is that from the next one, of a solid also from the one
before; the true error is that to the last one, at least two refinements finer. A wedge is compared with its section, as a run
does unasked. Prints how often the half width holds the true error, how often it is within a factor of 3 of it, and the default
meshes' errors: of those whose ladder ends there, from the difference to the larger cells. Errors below a millionth of a number
are not counted. Solids are drawn once.
"""

from __future__ import annotations

import argparse
import collections
import dataclasses
import resource
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

import softmodels as sm
from geometries import Actuator, Bellows, ChannelCell, ChannelPlate, SeminarActuator
from softmodels.api.calls import case_of
from softmodels.case.case import Case
from softmodels.case.load import steps_of
from softmodels.components.loads import Gravity
from softmodels.mechanics import mpi
from softmodels.runs import columns, mesh_error, table
from softmodels.runs.simulation import MIN_COMPANION_STEPS, Simulation

LADDER = {2: (0.5, 1.0, 2.0, 4.0), 3: (4 / 9, 2 / 3, 1.0, 1.5)}
"""How many times smaller than by default the cells are, by dimension."""
LARGE = (ChannelPlate, SeminarActuator)
"""Devices whose default mesh is the last one here."""
AT_LIMIT = " at its limit"
"""End of the names of devices that pass a limit point, with a law that has one."""
LEAST_ERROR = 1e-6
MODULUS = 25e3
"""Shear modulus in Pa for which the loads below are meant."""

DEVICES: dict[str, tuple[Callable[[float], Actuator], str, float, float]] = {
    "disk": (lambda scale: sm.HollowDisk(section="axisymmetric", membrane=0.006 * scale), "pressures cm", 30, 90),
    "shadow disk": (lambda scale: sm.HollowDisk.variant("shadow", section="axisymmetric"), "pressures cm", 8, 20),
    "balloon": (lambda scale: sm.Balloon(wall=0.001 * scale), "volumes ml", 20, 40),
    "membrane": (lambda scale: sm.Membrane(thickness=0.001 * scale), "pressures cm", 4, 15),
    "tube": (lambda scale: sm.Cylinder(section="axisymmetric", wall=0.002 * scale), "pressures kPa", 2, 6),
    "bellows": (lambda scale: Bellows(wall=0.0015 * scale), "pressures cm", 3, 10),
    "held bellows": (lambda scale: Bellows(tip="held", wall=0.0015 * scale), "pressures cm", 3, 10),
    "suction cup": (lambda scale: sm.SuctionCup(roof=0.004 * scale), "pressures kPa", -0.5, -0.2),
    "disk's wedge": (lambda scale: sm.HollowDisk(membrane=0.006 * scale), "pressures cm", 30, 60),
    "beam": (lambda scale: sm.Beam(), "weight", 1, 1),
    "channel cell": (lambda scale: ChannelCell(), "pressures kPa", 4, 10),
    "PneuNet": (lambda scale: sm.PneuNet(chambers=2), "pressures kPa", 1, 3),
    "held PneuNet": (lambda scale: sm.PneuNet(chambers=1, tip="held"), "pressures kPa", 1, 3),
    "bending bellows": (lambda scale: sm.BendingBellows(folds=2), "pressures kPa", 1, 3),
    "channel plate": (lambda scale: ChannelPlate(), "pressures kPa", 2, 5),
    "seminar actuator": (lambda scale: SeminarActuator(), "pressures kPa", 3, 8),
    "disk at its limit": (lambda scale: sm.HollowDisk(section="axisymmetric", membrane=0.003 * scale), "volumes ml", 9, 11),
    "thin disk at its limit": (lambda scale: sm.HollowDisk.variant("shadow", section="axisymmetric"), "volumes ml", 40, 45),
    "balloon at its limit": (lambda scale: sm.Balloon(wall=0.001 * scale), "volumes ml", 36, 40),
    "plate at its limit": (lambda scale: sm.Membrane(thickness=0.001 * scale), "volumes ml", 28, 32),
}


def laws(random: np.random.Generator, limited: bool) -> sm.Material:
    """Return a random law; ``limited`` ones have a limit point where membranes grow."""
    mu, poisson = random.uniform(0.6, 1.6) * MODULUS, random.choice([0.5, 0.5, 0.49])
    made = (
        sm.NeoHookean(mu, poisson), sm.Yeoh(mu / 2, 60.0, 0.0, poisson), sm.MooneyRivlin(0.4 * mu, 0.1 * mu, poisson),
        sm.Gent(mu, 60.0, poisson), sm.Ogden((1.4 * mu, -0.02 * mu), (1.3, -2.0), poisson),
        sm.Carroll(0.4 * mu, 0.01, 0.4 * mu, poisson),
    )  # fmt: skip
    chosen = [law for law in made if not limited or isinstance(law, sm.NeoHookean | sm.Ogden | sm.Carroll)]
    return chosen[random.integers(len(chosen))]


def case_at(name: str, random: np.random.Generator) -> Case:
    """Return a random case of a device."""
    device, way, low, high = DEVICES[name]
    law = laws(random, name.endswith(AT_LIMIT))
    if way == "weight":
        return case_of(device(1.0), law, components=[Gravity("-z")], steps=steps_of(share="0:1"))
    argument, unit = way.split()
    amount = random.uniform(low, high) * (law.shear_modulus_0 / MODULUS if argument == "pressures" else 1.0)
    return case_of(device(random.uniform(0.8, 1.25)), law, **{argument: f"0:{amount:.3g} {unit}"})


def on_ladder(case: Case) -> list[Case]:
    """Return the case on smaller and smaller cells; of a wedge the last ones are sections."""
    device, large = case.actuator, isinstance(case.actuator, LARGE)
    if isinstance(device, sm.HollowDisk) and device.dimension == 3:
        section = device.replaced(section="axisymmetric")
        return [dataclasses.replace(case, actuator=made) for made in (device, section.refined(2.0), section.refined(4.0))]
    asked = dataclasses.replace(case, mesh_error=True)
    return [dataclasses.replace(asked, actuator=device.refined(n)) for n in LADDER[device.dimension] if n <= 1.0 or not large]


def solved(case: Case) -> table.PathTable:
    """Return the path of a case in few steps."""
    simulation = Simulation(case, mpi.start())
    simulation.min_steps = MIN_COMPANION_STEPS
    try:
        with tempfile.TemporaryDirectory() as folder:
            simulation.write_mesh(mesh := Path(folder) / "mesh.msh")
            simulation.prepare(mesh)
            return table.PathTable(step.row for step in simulation.steps())
    finally:
        simulation.release()


Numbers = dict[str, tuple[float, float, float]]
"""A mesh's number, its stated half width and its true error, by quantity."""


def of_path(case: Case, rows: table.PathTable, meshes: columns.MeshTables, reference: table.PathTable) -> Numbers:
    """Return the numbers of the last requested state and of the first limit point."""
    stated, truth = mesh_error.MeshErrors(case, rows, meshes), mesh_error.MeshErrors(case, rows, {columns.FINER: reference})
    device, made, probes = case.actuator, {}, set(case.actuator.probes)
    for row in [rows.where("requested")[-1], *rows.where("limit")[:1]]:
        fine = truth.paired(row)
        for name, half in stated.of(row).items() if fine is not None else ():
            if name in probes - {device.gauge} or (row.get("limit") and name != "pressure"):
                continue
            quantity = "limit pressure" if row.get("limit") else "rise" if name == device.gauge else name
            made[quantity] = row[name], half, abs(row[name] - fine[name])
    return made


def of_frequency(case: Case, ladder: Sequence[Case]) -> list[float]:
    """Return the first frequency at rest in Hz on each mesh; none where it does not converge, or takes long."""
    if case.actuator.dimension == 3 and not isinstance(case.actuator, sm.Beam):
        return []
    modes = [sm.modes(each.actuator, case.material, count=1) for each in ladder]
    return [float(each.frequency[0, 0]) for each in modes if each.convergent]


def of_default(case: Case, coarse: table.PathTable, own: table.PathTable, times: float) -> Numbers:
    """Return the numbers of a mesh with half widths from the one with cells so many times larger."""
    larger = of_path(case, own, {columns.FINER: coarse}, coarse)
    return {name: (value, true / (times - 1.0), true) for name, (value, _, true) in larger.items()}


def table_line(name: str, numbers: Numbers) -> str:
    """Return a line of the table of default meshes: of rises, volumes, pressures, forces and frequencies."""
    shares = {what: half / abs(value) for what, (value, half, _) in numbers.items() if value and is_headline(what)}
    return f"| {name} | {', '.join(f'{what} {share:.2%}' for what, share in shares.items())} |"


def is_headline(quantity: str) -> bool:
    """Whether a quantity is in the table of default meshes."""
    return quantity.endswith(("force", "pressure")) or quantity in ("rise", "added_volume", "frequency")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=3)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--devices", default=",".join(DEVICES))
    options = parser.parse_args()
    ratios, lines = collections.defaultdict[str, list[float]](list), list[str]()
    for number, name in enumerate(DEVICES):
        for draw in range(options.draws) if name in options.devices.split(",") else ():
            case = case_at(name, np.random.default_rng([options.seed, number, draw]))
            if draw and case.actuator.dimension == 3:
                continue
            began = resource.getrusage(resource.RUSAGE_SELF).ru_utime
            try:
                meshes = on_meshes(case)
            except RuntimeError as error:
                print(f"{name}: left out ({error})")
                continue
            for finer, numbers, reached in meshes:
                lines += [table_line(name, numbers)] if finer == 1.0 and not draw else []
                for quantity, (value, half, true) in numbers.items() if reached else ():
                    if true > LEAST_ERROR * abs(value):
                        ratios[quantity].append(half / true)
                        print(
                            f"  finer={finer:.3g} {quantity}: stated {half / true:.3g} times the true {true / abs(value):.2%}"
                        )
            seconds = resource.getrusage(resource.RUSAGE_SELF).ru_utime - began
            print(f"{name}, {type(case.material).__name__}: {seconds:.0f} s", flush=True)
    print("\n".join(lines))
    every = [ratio for values in ratios.values() for ratio in values]
    for name, values in [*ratios.items(), ("all", every)]:
        held, near = np.mean(np.asarray(values) >= 1.0), np.mean((np.asarray(values) < 3.0) & (np.asarray(values) > 1 / 3))
        print(f"{name}: {len(values)} numbers, {held:.0%} held, {near:.0%} within a factor of 3")


def on_meshes(case: Case) -> list[tuple[float, Numbers, bool]]:
    """Return for each mesh but the last its ``finer``, its numbers, and whether the last one is at least two refinements finer,
    so that their errors are known; for the last one too if that is the default."""
    ladder = on_ladder(case)
    paths, frequencies, made = [solved(each) for each in ladder], of_frequency(case, ladder), []
    for place, each in enumerate(ladder[:-1]):
        meshes = {columns.FINER: paths[place + 1], **({columns.COARSER: paths[place - 1]} if place else {})}
        numbers = of_path(each, paths[place], meshes, paths[-1])
        if frequencies:
            value, finer = frequencies[place : place + 2]
            half = mesh_error.half_width(value, finer, mesh_error.FINER[each.actuator.dimension])
            numbers["frequency"] = value, half, abs(value - frequencies[-1])
        made.append((each.actuator.finer, numbers, place < len(ladder) - 2))
    if ladder[-1].actuator.finer == 1.0:
        times = 1.0 / ladder[-2].actuator.finer
        made.append((1.0, of_default(ladder[-1], paths[-2], paths[-1], times), False))
    return made


if __name__ == "__main__":
    main()
