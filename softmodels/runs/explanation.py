"""Why a path ended, where, and what can be done about it: sentences for the user."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from geometries import Actuator
from softmodels.case.case import Case
from softmodels.mechanics.causes import Cause
from softmodels.path.program import LOAD_KEYS, step_text
from softmodels.results.columns import loads_words
from softmodels.results.lost_path import advice, mended
from softmodels.results.row import Row
from softmodels.results.state_words import state_words
from softmodels.results.terms import split

if TYPE_CHECKING:
    from softmodels.path.continuation import Continuation
    from softmodels.path.points import PathEnd
    from softmodels.results.fields import Fields


def explain(case: Case, end: PathEnd, fields: Fields, path: Continuation, petsc: bool = False) -> str:
    """Why the path ended, where, and what can be done about it; ``petsc`` is whether PETSc had options of its own."""
    asked = f"{case.values[-1]:g} {case.unit}"
    device, last = case.actuator, fields.figures(path.last.state)
    pressure = f"{last.pressure / case.cm:.4g} cm ({last.pressure:.4g} Pa)"
    where = (
        f"The last state is at {state_words(case).under(Row(last.device), pressure)}, {device.gauge} rise "
        f"{last.rises[device.gauge] * 1e3:+.4g} mm, largest stretch {last.max_stretch:.3g}. "
    )
    if end.cause:
        return f"{_not_met(asked, end.cause)}: {end.cause.clause}. {where}" + mended(case, end.cause, last.max_stretch)
    if end.limit is None:
        return f"{asked} was not reached: {end}. {where}" + advice(
            case,
            {"pressure_Pa": last.pressure, "max_stretch": last.max_stretch, "J_min": last.J_min, **last.device},
            petsc,
        )
    at = fields.figures(end.limit.state)
    if case.driven is not None:
        load = case.driven.of(case.parts)
        most = at.device[load.column]
        return (
            f"no equilibrium at {asked} on this path: the {load.table} has a limit point at {most:.5g} "
            f"{split(load.column)[1]}, where {_risen(device, at.rises)}; beyond it the device gives way. Stay below, take "
            f"{device.stiffer} or a stiffer silicone{_or_its_travel(load.table)}"
        )
    if case.supply is not None:
        stroke = path.value(end.limit.state) * fields.system.volume_unit * 1e6
        supply = case.supply
        gas = supply.its_gas or f"the gas of the {supply.name}"
        return (
            f"a stroke of {asked} was not reached: {end}. The stroke has a limit point at {stroke:.4g} ml "
            f"({at.pressure / case.cm:.4g} cm), where {_risen(device, at.rises)} and the cavity has taken "
            f"{at.added_volume * 1e6:.4g} ml; beyond it {gas} expands by itself and the device jumps. "
            f"Stay below{f', or take {supply.gentler}' if supply.gentler else ''}"
        )
    return (
        f"no equilibrium at {asked} on this path: the pressure has a limit point at {at.pressure / case.cm:.4g} cm "
        f"({at.pressure:.5g} Pa), where {_risen(device, at.rises)} and the cavity has taken "
        f"{at.added_volume * 1e6:.4g} ml; beyond it the device balloons. Stay below (with 25 % margin: "
        f"{0.8 * at.pressure / case.cm:.4g} cm), take {device.stiffer} or a stiffer silicone, or drive it by volume past "
        "the limit (--volume-ml, or --control volume)"
    )


def explain_step(case: Case, end: PathEnd, rows: Sequence[Row], come: float, petsc: bool = False) -> str:
    """The same of a program's step."""
    number = math.floor(come) + 1
    at = next((row for row in reversed(rows) if row["limit"]), rows[-1]) if end.limit else rows[-1]
    words = state_words(case)
    pressures, volumes = words.pressures(at), words.volumes(at) if words.pressure else []
    names = [f"cavity{i} at " for i in range(1, len(pressures) + 1)] if len(pressures) > 1 else [""]
    cavities = [
        f"{name}{at[pressure]:.4g} cm with {at[volume]:.4g} ml added"
        for name, pressure, volume in zip(names, pressures, volumes, strict=True)
    ]
    place = ", ".join([*cavities, *loads_words(at)])
    asked = f"step {number} of the program ({step_text(case.program, number)})"
    gauge = case.actuator.gauge
    moved = f"the {gauge} has moved {at[f'{gauge}_mm']:+.4g} mm"
    if end.cause:
        return (
            f"{_not_met(asked, end.cause)}: {end.cause.clause}. The last state has {place}, and {moved}. "
            f"{mended(case, end.cause, float(at['max_stretch']))}"
        )
    if end.limit is None:
        return f"{asked} was not reached: {end}. The last state has {place}, and {moved}. {advice(case, at, petsc)}"
    beyond, instead = "a cavity balloons", "that cavity's added volume (volume_ml) in place of its pressure"
    if any(series.target for series in case.program):
        beyond, instead = (
            "the device gives way",
            "volumes and travels (volume_ml, travel_mm) in place of pressures and forces",
        )
    return (
        f"no equilibrium at {asked} on this path: its loads have a limit point with {place}, where {moved}; beyond it {beyond}."
        f" Stay below, take {case.actuator.stiffer} or a stiffer silicone, or give {instead}"
    )


def _not_met(asked: str, cause: Cause) -> str:
    """That what was asked for was not met: there is none, or the mesh does not lead there."""
    return f"{asked} was not reached" if cause.of_mesh else f"no equilibrium at {asked} on this path"


def _or_its_travel(table: str) -> str:
    """What passes a load's limit point: how far it moves what it acts on, if a case can request that."""
    options = (f"--{key.replace('_', '-')}" for key, given in LOAD_KEYS[table].items() if given.held)
    option = next(options, None)
    return f", or ask for how far it moves ({option}), which passes the limit" if option else ""


def _risen(device: Actuator, rises: dict[str, float]) -> str:
    """How far the device has moved: its gauge, and the other probes in brackets."""
    others = ", ".join(f"{name} {rise * 1e3:.4g} mm" for name, rise in rises.items() if name != device.gauge)
    return f"the {device.gauge} has risen {rises[device.gauge] * 1e3:.4g} mm" + (f" ({others})" if others else "")


def explain_failure(case: Case, failure: Exception, last: Row | None, petsc: bool = False) -> str:
    """The same where no state was found at the beginning or at a limit point, where there is no step to shorten.

    Args:
        case: The case.
        failure: What the solver reported.
        last: The last row of ``path.csv``, if there is one.
        petsc: Whether PETSc had options of its own.
    """
    words = "leave out PETSc's options (what follows --), " if petsc else ""
    told = f"{words}refine the mesh (--cell-size), or use another --control"
    return f"the path could not be followed ({failure})" + (f"; {told}" if last is None else f". {advice(case, last)}")
