"""A state between two of a run's: solved for from those two, on the run's own mesh."""

from __future__ import annotations

import dataclasses
import functools
import itertools
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from softmodels.case.case import Case
from softmodels.mechanics.mpi import on_root, start
from softmodels.results.outcomes import RunError
from softmodels.results.resume import recall, stored_point
from softmodels.runs.failures import sentences
from softmodels.runs.simulation import Simulation
from softmodels.runs.states import InMemory, SolvedState, Source, state_of
from softmodels.runs.temporary_folder import temporary_folder

if TYPE_CHECKING:
    from softmodels.path.points import Point
    from softmodels.runs.step import Step

Array = npt.NDArray[np.float64]


def solve_between(source: Source, quantity: str, wanted: float, values: Array) -> SolvedState:
    """The first state of a run's path at a value; all ranks call it.

    The two stored states beside it are what Newton's method starts from, so nothing before them is solved again. Where there
    are no such two, as under a cycle that jumps over the value, the path is followed from rest.

    Args:
        source: The run's states.
        quantity: ``"pressure"``, ``"volume"`` or ``"stroke"``; or a column of ``path.csv``.
        wanted: The value in SI units, or in that column's, between the least and the largest of ``values``.
        values: Of the stored states, likewise, shape (states,).

    Raises:
        RunError: It was not found.
    """
    comm, ends = start(), _bracket(source, values, wanted)
    if ends is None and quantity in source.rows[0]:
        raise RunError(f"no two neighbouring states on one piece of the path have {quantity} {wanted:g} between them")
    case = source.case if ends else _to_one(source.case, quantity, wanted)
    simulation = Simulation(case, comm)
    try:
        with sentences(), temporary_folder(comm) as folder:
            mesh = folder / f"{case.name}.msh"
            on_root(comm, lambda: mesh.write_bytes(source.mesh()))
            simulation.prepare(mesh)
            states = InMemory(simulation, mesh)
            for step in [_between(simulation, source, ends, (quantity, wanted))] if ends else simulation.steps():
                states.add(step)
    finally:
        simulation.release()
    return state_of(states, len(states.rows) - 1)


def _bracket(source: Source, values: Array, wanted: float) -> tuple[int, int] | None:
    """The first two neighbouring states, solved for and on one piece of the path, that a value lies between."""
    # A bifurcation is interpolated, and between a limit and where the device jumped to there is no path.
    solved = [step for step, row in enumerate(source.rows) if not row["bifurcation"]]
    for before, after in itertools.pairwise(solved):
        low, high = sorted(values[[before, after]])
        if low < wanted < high and not source.rows[after]["jump"]:
            return before, after
    if not any(row["jump"] for row in source.rows):  # as on a branch
        raise RunError("the branch has no two neighbouring states with this value between them")
    return None


def _between(simulation: Simulation, source: Source, ends: tuple[int, int], asked: tuple[str, float]) -> Step:
    """The state at a value between two steps of a run."""
    from softmodels.mechanics.newton import NoConvergence
    from softmodels.path.continuation import Continuation

    fields, comm, (quantity, wanted) = simulation.fields, simulation.comm, asked
    stored = _Stored(source)
    passed = [step for step, row in enumerate(source.rows[: ends[0]]) if row["bifurcation"]]
    *points, after = (
        stored_point(stored, fields, comm, step, source.restart(step), step in passed) for step in (*passed, *ends)
    )
    followed = source.case.quantity if quantity in source.rows[0] else quantity
    path = Continuation(simulation.solver, simulation.quantity(followed), start=simulation.beginning.state())
    solved = [step for step in range(ends[0] + 1) if step not in passed]
    path.recall = functools.partial(recall, stored, fields, comm, solved)
    try:
        path.resume([*points[:-1], dataclasses.replace(points[-1], factorised=True)])
        tangent = path.corrector.tangent(after.state)
        before, after = path.last, dataclasses.replace(after, tangent=tangent)
        if quantity in source.rows[0]:
            state = path.corrector.root(before, after, lambda point: _figure(simulation, point, quantity) - wanted)
            found = path.corrector.point(state, requested=True)
        else:
            found = path.between(before, after, wanted / simulation.beginning.unit_of(quantity))
        path.keep(found)
    except NoConvergence as failure:
        raise RunError(f"the state between steps {ends[0]} and {ends[1]} was not found ({failure})") from failure
    return simulation.step_of(found, ends[0])


def _figure(simulation: Simulation, point: Point, column: str) -> float:
    """A figure of ``path.csv`` at a point, on all ranks."""
    return float(simulation.step_of(point, 0).row[column])


class _Stored:
    """The fields of a run's steps, as a folder of results gives them."""

    def __init__(self, source: Source):
        self._source = source

    def has(self, step: int, names: Sequence[str]) -> bool:
        return set(names) <= set(self._source.fields(step))

    def fields(self, step: int, names: tuple[str, ...]) -> Mapping[str, Array]:
        known = self._source.fields(step)
        return {name: known[name] for name in names}


def _to_one(case: Case, quantity: str, wanted: float) -> Case:
    """A case that ends at one value."""
    if case.driven is not None:
        return dataclasses.replace(
            case,
            driven=dataclasses.replace(case.driven, values=(wanted / case.load.scale,)),
            cycle=False,
            control="auto",
        )
    field, scale = {"pressure": ("pressures_cm", 1 / case.cm), "volume": ("volumes_ml", 1e6),
                    "stroke": ("strokes_ml", 1e6)}[quantity]  # fmt: skip
    asked: dict[str, tuple[float, ...]] = {field: (wanted * scale,)}
    pressures, volumes, strokes = (asked.get(name, ()) for name in ("pressures_cm", "volumes_ml", "strokes_ml"))
    return dataclasses.replace(
        case, pressures_cm=pressures, volumes_ml=volumes, strokes_ml=strokes, cycle=False, control="auto",
        supply=case.supply if quantity == "stroke" else None,
    )  # fmt: skip
