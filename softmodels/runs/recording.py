"""A simulation written into a folder of results as it goes on."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING

from measurement.user_file import file_digest
from softmodels.case.case import Case
from softmodels.mechanics.mpi import on_root
from softmodels.results.notes import notes_of
from softmodels.results.outcomes import DONE
from softmodels.results.resume import last_stop, recall, stopped_at, stored_points
from softmodels.results.row import Row
from softmodels.results.stability_report import unlocated, unseen
from softmodels.results.state_words import state_words
from softmodels.results.store import BRANCH, Results, write_text
from softmodels.runs.folder import mesh_is_known
from softmodels.runs.gathering import gather
from softmodels.runs.simulation import Simulation
from softmodels.runs.sources import solve_sources
from softmodels.runs.step import FROM_REST, Begun, PathEnded, Step

if TYPE_CHECKING:
    from mpi4py import MPI


def record(
    simulation: Simulation,
    results: Results,
    resumed: bool,
    branch: bool,
    begun: Callable[[Results], None] | None = None,
) -> None:
    """Solve a case and store every state at once; all ranks call it.

    Args:
        simulation: The case.
        results: Its folder, prepared by `softmodels.runs.folder.begin`; rank 0 alone writes there.
        resumed: Go on from the states that are there.
        branch: Follow the branch at the first bifurcation too, into a folder of its own.
        begun: Called on rank 0 as soon as the folder holds a state of this run.

    Raises:
        PathEnded: See `Simulation.steps`.
        RunError: It was stopped, or cannot begin.
        ResultsError: The states that are there are of another mesh.
    """
    case, comm = simulation.case, simulation.comm
    mesh = results.folder / f"{case.name}.msh"
    if not (resumed and on_root(comm, lambda: mesh_is_known(results, mesh))):
        simulation.write_mesh(mesh)
        on_root(comm, lambda: results.record(mesh=file_digest(mesh)))
    simulation.prepare(mesh)
    if resumed:
        on_root(comm, lambda: results.check_grid(simulation.fields.grid.points))
    simulation.describe()
    start = _begun(simulation, results) if resumed else FROM_REST
    if not resumed:
        _begin(simulation, results)
    ended: PathEnded | None = None
    try:
        _store(simulation.steps(start), results, comm, begun)
    except PathEnded as end:
        if case.program:
            raise
        ended = end
    if branch:
        _record_branch(simulation, results)
    sources = solve_sources(simulation, results.own.path / mesh.name)  # where it is since the first state
    on_root(comm, lambda: results.write_sources(sources))
    if ended is not None:
        raise ended


def _begin(simulation: Simulation, results: Results) -> None:
    grid = simulation.fields.grid
    on_root(simulation.comm, lambda: results.begin(grid.points, grid.cells, grid.cell_name))


def _store(
    steps: Iterable[Step], results: Results, comm: MPI.Comm, begun: Callable[[Results], None] | None = None
) -> None:
    for number, step in enumerate(steps):

        def add(step: Step = step, first: bool = number == 0) -> None:
            assert step.fields is not None
            results.add(step.row, step.fields, step.restart)
            if first and begun is not None:
                begun(results)

        on_root(comm, add)


def _begun(simulation: Simulation, results: Results) -> Begun:
    """What the stored states are gone on with from."""
    case, fields, comm = simulation.case, simulation.fields, simulation.comm
    rows = on_root(comm, lambda: results.rows)
    if case.cycle:
        return Begun(rows)
    solved = on_root(comm, lambda: [i for i, row in enumerate(results.rows) if not row["bifurcation"]])
    again = functools.partial(recall, results, fields, comm, solved)
    if case.program:
        stop = last_stop(case, results, fields, comm)
        simulation.listener.say(f"going on from step {stop.number} of the program")
        return Begun(rows, stop=stop, recall=again)
    left = on_root(comm, lambda: [not stopped_at(results, case.column, value) for value in case.values])
    points = stored_points(results, fields, comm)
    simulation.listener.say(f"going on from step {len(rows) - 1}")
    return Begun(rows, left, points, recall=again)


def _record_branch(simulation: Simulation, results: Results) -> None:
    """Follow the branch at the first bifurcation into a folder of its own."""
    case, comm = simulation.case, simulation.comm
    if not simulation.bifurcates:
        simulation.listener.say(on_root(comm, lambda: no_branch(case, results.rows)))
        return
    on_root(comm, lambda: begin_branch(results, case))
    aside = results.branch()
    _begin(simulation, aside)
    _store(simulation.branch(), aside, comm)
    on_root(comm, lambda: gather(case, aside, DONE, "", notes_of(case, aside.rows)) if aside.stored else None)


def begin_branch(results: Results, case: Case) -> Results:
    """Make the folder of a branch beside its path, without the states of an earlier one; on rank 0."""
    aside = results.branch()
    results.own.claim([BRANCH])
    aside.clear()
    write_text(aside.folder / "case.toml", case.to_toml())
    return aside


def no_branch(case: Case, rows: Sequence[Row]) -> str:
    """Why a run has no branch to follow."""
    if any(row.get("bifurcation") for row in rows):
        return "the bifurcation was met before the run was gone on with; run it without --resume to follow the branch"
    if text := unlocated(rows, state_words(case)):
        return text
    hidden = unseen(case.actuator)
    return f"no bifurcation on this path, so there is no branch to follow{f'; {hidden}' if hidden else ''}"
