"""A device taken through a load program, step by step.

Each step changes either pressures, forces and the like, or volumes and travels, and is followed by its own pair (P, V), see
`softmodels.mechanics.coupling`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator

import numpy as np
import numpy.typing as npt

from softmodels.mechanics.solver import Solver
from softmodels.path.points import Point
from softmodels.path.program import Program, begins_at_rest
from softmodels.path.stages import Stage, Stop, at_rest


def follow(
    solver: Solver,
    program: Program,
    pascal_per_cm: float,
    control: str,
    report: Callable[[str], None],
    begin: Stop | None = None,
    hung: Stop | None = None,
) -> Iterator[tuple[float, Point]]:
    """Take a device through a program.

    Args:
        solver: The device, at rest; the coupling of its cavities is changed.
        program: One series for each of its cavities, or none for them, and series for dead loads.
        pascal_per_cm: Pa in one cm of the column.
        control: What each step follows, as in `Continuation`.
        report: Takes sentences on what is going on.
        begin: The end of a step to go on from; where it hangs if None.
        hung: Where it hangs under the loads that the program does not change; the undeformed state if None.

    Yields:
        How far the program has come (1.5 is half way through the second step), and its point.

    Raises:
        PathEnd: A step's values are not on the path that leads there.
    """
    eq = solver.system
    hung = hung or at_rest(solver)
    eq.load(eq.rest())
    rest = eq.driven()
    rest[len(eq.volumes()) :] = hung.driven[len(eq.volumes()) :]
    values, held = in_drivers(solver, program, pascal_per_cm, hung.drives)
    first, here = int(begins_at_rest(program)), begin or hung
    # A volume that is held counts from the undeformed cavity, a travel from where the device hangs, and 0 is either as it
    # hangs; what is given is a magnitude.
    before = hung.drives.copy()
    before[held] = (hung.driven - rest)[held]
    values[:, held] = np.where(values[:, held] == 0.0, before[held], values[:, held])
    for number, row in enumerate(values[first:], 1):
        if number <= here.number:
            before = row
            continue
        stage = Stage.between(here, row - before, held, rest + before)
        for place, (come, point) in enumerate(stage.follow(solver, control, report)):
            if place:
                yield float(number) if point.requested else number - 1 + come, point
            elif number == 1 and begin is None:
                yield 0.0, dataclasses.replace(point, requested=bool(first))
            here = stage.stop(solver, point, number)
        before = row


def in_drivers(
    solver: Solver, program: Program, pascal_per_cm: float, kept: npt.NDArray[np.float64]
) -> tuple[npt.NDArray[np.float64], list[int]]:
    """The values of a program by step and driver, dimensionless, and the drivers whose volume or travel is given.

    Args:
        solver: The device.
        program: The program.
        pascal_per_cm: Pa in one cm of the column.
        kept: Magnitudes of all drivers where the program begins, shape (k,): those it does not tell of stay so.
    """
    eq, cavities = solver.system, len(solver.system.body.actuator.ratios)
    units = {
        "pressure_cm": [pascal_per_cm / eq.stress_unit] * cavities,
        "volume_ml": [1e-6 / eq.volume_unit] * cavities,
    }
    values, held, unnamed = np.tile(kept, (len(program[0].values), 1)), [], iter(range(cavities))
    for series in program:
        place = cavities + eq.dead.index(series.target) if series.target else next(unnamed)
        if series.target:
            unit = series.scale * (eq.dead.amounts[place - cavities] if series.key == "share" else 1.0)
            unit /= (eq.dead.moved_units if series.is_volume else eq.dead.units)[place - cavities]
        else:
            unit = units[series.key][place]
        values[:, place] = np.array(series.values) * unit
        held += [place] if series.is_volume else []
    return values, sorted(held)
