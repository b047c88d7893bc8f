"""Going on from an interrupted run: may this case continue those results, and from which states."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np
import numpy.typing as npt

from softmodels.case.case import Case
from softmodels.case.identity import difference
from softmodels.mechanics.mpi import is_root, largest, on_root
from softmodels.path.program import goes_on
from softmodels.path.stages import Stop
from softmodels.results.columns import cavity_columns
from softmodels.results.outcomes import BAD_INPUT, RunError
from softmodels.results.store import Results

if TYPE_CHECKING:
    from mpi4py import MPI

    from softmodels.mechanics.system import State
    from softmodels.path.points import Point
    from softmodels.results.fields import Fields
    from softmodels.results.restart import Restart

Array = npt.NDArray[np.float64]


def check_same(case: Case, old: Case, known: Mapping[str, str], wanted: Mapping[str, str], folder: Path) -> None:
    """Refuse to go on from a run whose numbers would not be this case's.

    Args:
        case: What is run.
        old: What the folder's case file says.
        known: `identity` of the case that the stored states are of.
        wanted: `identity` of this case.
        folder: For the message.

    Raises:
        RunError: They differ in more than the requested values, with the first that differs.
    """
    if (name := difference(known, wanted)) is not None:
        raise RunError(
            f"{folder} holds a run with another {name.split('.')[0]} ({name} is {known.get(name, 'not given')} there, "
            f"{wanted.get(name, 'not given')} here); resume with its options, or run without --resume",
            BAD_INPUT,
        )
    if case.cycle and case.values != old.values:
        raise RunError(f"{folder} holds a run with --cycle through other pressures; resume with those", BAD_INPUT)
    if not goes_on(case.program, old.program):
        raise RunError(
            f"{folder} holds a run of other steps; resume with those, more after them if need be, or run without --resume",
            BAD_INPUT,
        )
    if old.quantity != case.quantity:
        raise RunError(
            f"{folder} holds a run to requested {old.quantity}s; resume with those, or run without --resume", BAD_INPUT
        )


def drop_between(case: Case, results: Results) -> None:
    """Forget the last states if they were solved for between two steps of which the second is missing.

    They are found again, with that step. Going on from one of them would cut the path into other steps.
    """
    quantity = case.quantity
    if case.program:  # a step of a program is gone on with from its beginning
        while results.stored and not results.stored[-1].row["requested"]:
            results.stored.pop()
        return
    while results.stored:
        row = results.stored[-1].row
        if not (
            row["limit"]
            or row["bifurcation"]
            or row.get("stroke_limit")
            or row["jump"]
            or (row["requested"] and row["step"] and row["following"] != quantity)
        ):
            return
        results.stored.pop()


def check_values(case: Case, results: Results) -> None:
    """Refuse requested values that the stored states have passed without stopping there."""
    key, unit = case.column, case.unit
    reached = max((row[key] for row in results.rows), default=0.0)
    for value in case.values:
        if 0.0 < value < reached * (1 - 1e-9) and not stopped_at(results, key, value):
            raise RunError(
                f"{results.folder} holds a run that has passed {value:g} {unit} without stopping there; "
                "resume with its values, or run without --resume",
                BAD_INPUT,
            )


def last_stop(case: Case, results: Results, fields: Fields, comm: MPI.Comm) -> Stop:
    """The end of a program's step that the stored states end with."""
    row, record = on_root(comm, lambda: (results.rows[-1], results.stored[-1].restart))
    last = on_root(comm, lambda: len(results.stored) - 1)
    state, _ = stored_state(results, fields, comm, last, record["P"], record["V"])
    system = fields.system
    pressures = [row[name] * case.cm / system.stress_unit for name in cavity_columns(row, "pressure", "cm")]
    dead = [row[load.column] * load.column_unit for load in system.dead.loads] / system.dead.units
    system.load(state)
    drives = np.concatenate([pressures[: len(system.body.actuator.ratios)], dead])
    return Stop(round(row["load_step"]), state, drives, system.driven())


def stopped_at(results: Results, key: str, value: float) -> bool:
    """Whether a requested value, by its column of ``path.csv``, is among the stored states."""
    return any(row["requested"] and math.isclose(row[key], value, rel_tol=1e-6) for row in results.rows)


def stored_points(results: Results, fields: Fields, comm: MPI.Comm) -> list[Point]:
    """The points a trace goes on from: bifurcations, the first limit point, the last one factorised at, and the last two."""
    records = on_root(comm, lambda: [stored.restart for stored in results.stored])
    # A bifurcation is interpolated: the path did not go on from it.
    branching = on_root(comm, lambda: [i for i, row in enumerate(results.rows) if row["bifurcation"]])
    solved = [i for i in range(len(records)) if i not in branching]
    factorised = max(i for i in solved if records[i]["factorised"])
    limits = [i for i, record in enumerate(records) if record["limit"]][:1]
    turns = [i for i, record in enumerate(records) if record["turn"]][-1:]
    chosen = sorted({*limits, *turns, factorised, *solved[-2:], *branching})
    return [stored_point(results, fields, comm, i, records[i], i in branching) for i in chosen]


def recall(results: Stored, fields: Fields, comm: MPI.Comm, steps: Sequence[int]) -> None:
    """Let what parts remember, such as where friction holds their faces, be as after stored steps, through which it goes."""
    potential = fields.system.potential
    for step in steps if fields.system.assembled.remembers else ():
        potential.keep(stored_state(results, fields, comm, step, 0.0, 0.0)[0].w)


class Stored(Protocol):
    """Where the fields of stored steps are, such as a `Results`."""

    def has(self, step: int, names: Sequence[str]) -> bool: ...
    def fields(self, step: int, names: tuple[str, ...]) -> Mapping[str, Array]: ...


def stored_point(
    results: Stored, fields: Fields, comm: MPI.Comm, step: int, restart: Restart, branching: bool
) -> Point:
    """The point of a stored step; its tangent is zero where none was stored, and none is needed at a bifurcation."""
    from softmodels.mechanics.tangent import Tangent
    from softmodels.path.points import Point
    from softmodels.path.stability import Signature

    state, rate = stored_state(results, fields, comm, step, restart["P"], restart["V"])
    state = dataclasses.replace(state, iterations=restart["iterations"])
    dP, dV = restart.get("tangent", (0.0, 0.0))
    mode = None
    if branching:
        nodal = results.fields(step, ("mode",)) if is_root(comm) else None
        shape = None if nodal is None else {"displacement": nodal["mode"], "p": np.zeros(len(nodal["mode"]))}
        mode = fields.state(shape, 0.0, 0.0).w
        mode /= largest(comm, float(np.abs(mode).max()))
    return Point(
        state, Tangent(rate, dP, dV), signature=Signature(**restart["signature"]), mode=mode,
        requested=restart["requested"], limit=restart["limit"], jump=restart["jump"], turn=restart["turn"],
        step=restart["step"], line=restart["line"], factorised=restart["factorised"], age=restart["age"],
        stiffest=restart["stiffest"], worn=restart["worn"], largest=restart["largest"],
    )  # fmt: skip


def stored_state(results: Stored, fields: Fields, comm: MPI.Comm, step: int, P: float, V: float) -> tuple[State, Array]:
    """A stored step's state, and the dofs of the path's direction there; zeros where they were not stored."""
    from softmodels.mechanics.system import State
    from softmodels.results.state_dofs import RAW

    names = [name for pair in RAW for name in pair]
    if on_root(comm, lambda: results.has(step, names)):
        raw: Mapping[str, Array | None] = results.fields(step, tuple(names)) if is_root(comm) else dict.fromkeys(names)
        w, rate = (fields.dofs(raw[u], raw[p]) for u, p in RAW)
        return State(w, P, V), rate
    nodal = results.fields(step, ("displacement", "p")) if is_root(comm) else None
    state = fields.state(nodal, P, V)
    return state, np.zeros_like(state.w)
