"""Write a simulation into a results folder while it runs."""

from __future__ import annotations

import contextlib
import functools
import json
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict

from softmodels.case.case import Case
from softmodels.common.errors import Spoken, reason
from softmodels.common.files import file_digest, write_text
from softmodels.common.folders import OwnFolderError
from softmodels.materials.silicones import stretch_at_break
from softmodels.mechanics.mpi import is_root, on_root
from softmodels.runs import resume
from softmodels.runs.columns import state_labels
from softmodels.runs.notes import events, no_branch, notes_of, sentences, stability_text, unwritten
from softmodels.runs.outcomes import BAD_INPUT, DONE, Ended, UnwrittenError
from softmodels.runs.row import Row
from softmodels.runs.simulation import FROM_REST, Begun, Listener, PathEnded, Simulation, Step, solve_sources
from softmodels.runs.store import BRANCH, Results

if TYPE_CHECKING:
    from mpi4py import MPI


class Summary(TypedDict, total=False):
    """What ``summary.json`` holds; nothing where there is none."""

    status: int
    message: str
    steps: int
    last: object
    events: object
    stretch_at_break: float | None
    notes: list[str]
    stability: str


def gather(case: Case, results: Results, ended: Ended) -> Summary:
    """Bring all steps into one file, and write and return the summary; on rank 0. `OSError` if there is no room."""
    results.finish()
    words = state_labels(case)
    summary: Summary = {
        "status": ended.status, "message": ended.message, "steps": len(results.stored), "last": results.rows[-1].cells,
        "events": events(results.rows, words), "stretch_at_break": stretch_at_break(case.material),
        "notes": notes_of(case, results.rows, results.sources(case)),
        "stability": stability_text(results.rows, case.actuator, words, branch_rows(results)),
    }  # fmt: skip
    results.own.claim(["summary.json"])
    write_text(results.folder / "summary.json", json.dumps(summary, indent=2) + "\n")
    return summary


def branch_rows(results: Results) -> list[Row]:
    """Return the rows of the followed branch; empty if there is none."""
    branch = results.branch()
    if branch.heavy.exists():
        branch.load()
    return branch.rows


class Observer:
    """Is told on rank 0 how a folder of results comes about."""

    def opened(self, results: Results) -> None:
        """The folder is taken; nothing is solved yet."""

    def begun(self, results: Results) -> None:
        """The folder holds the first state of this run."""

    def closed(self, results: Results | None, ended: Ended, summary: Summary) -> None:
        """The run has ended and its folder is complete, and still locked; None where no folder could be taken. The summary is
        empty where there are no states, or it could not be written."""


@contextlib.contextmanager
def unstopped() -> Iterator[Callable[[], bool]]:
    """Nobody asks to stop, but for exceptions."""
    yield bool


def solved_into(
    place: resume.ResultsPlace,
    case: Case,
    comm: MPI.Comm,
    listener: Listener | None = None,
    *,
    branch: bool = False,
    observer: Observer | None = None,
    solving: Callable[[], contextlib.AbstractContextManager[Callable[[], bool]]] = unstopped,
) -> tuple[Path | None, bool, Ended]:
    """Solve a case and store each state in a folder at once; all ranks call it.

    Args:
        place, case, comm: The folder, what is run, and on which ranks.
        listener, observer: Are told of each state, and of the folder.
        branch: Follow the branch at the first bifurcation too.
        solving: Entered while states are solved; gives whether to stop, asked between them.

    Returns:
        The folder, None where none could be taken; whether a state that is not at rest is stored; and how the run ended:
        `Ended.error` has the error of the input, PETSc, the memory or the disk.
    """
    results: Results | None = None
    ended, observer = Ended(), observer or Observer()
    try:
        with solving() as stopped:
            simulation = Simulation(case, comm, listener, stopped)
            try:
                with sentences(unwritten):
                    results, resumed = resume.begin_together(case, place, comm)
                    if is_root(comm):
                        observer.opened(results)
                    record(simulation, results, resumed, branch, observer.begun)
            except Exception as error:
                if not isinstance(error, Spoken):
                    raise
                ended = Ended.by(error)
            finally:
                if comm.size == 1 or sys.exception() is None:  # other ranks may not know of an exception that goes on
                    simulation.release()
        failure, loaded = on_root(comm, lambda: _complete(case, results, ended, observer))
        ended = Ended.by(UnwrittenError(failure)) if failure else ended
        return (None if results is None else results.own.path), loaded, ended
    finally:
        if results is not None and is_root(comm):
            results.own.leave()


def _complete(case: Case, results: Results | None, ended: Ended, observer: Observer) -> tuple[str, bool]:
    """Gather the states of a run that has ended, on rank 0; return why only that failed, else "", and whether it is loaded."""
    failure, summary = "", Summary()
    if results is not None and results.stored and ended.status != BAD_INPUT:
        try:
            summary = gather(case, results, ended)
            results.own.forget_unwritten()
        except (OSError, OwnFolderError) as error:
            if ended.status == DONE:
                failure = f"the steps could not be gathered in one file ({reason(error)})"
                ended = Ended.by(UnwrittenError(failure := f"{failure}; make room and run again with --resume"))
    observer.closed(results, ended, summary)
    return failure, results is not None and is_loaded(results.rows)


def is_loaded(rows: Sequence[Row]) -> bool:
    """Whether there is a state that is not at rest."""
    return any(row["pressure_Pa"] or row["max_displacement_mm"] for row in rows)


def record(
    simulation: Simulation, results: Results, resumed: bool, branch: bool, begun: Callable[[Results], None]
) -> None:
    """Solve a case and store every state at once, after those of a ``resumed`` run; all ranks call it, rank 0 writes.

    ``begun`` is called on rank 0 as soon as the folder holds a state of this run.

    Raises:
        PathEnded, RunError, ResultsError: The path ended, or it was stopped, or the states there are of another mesh.
    """
    case, comm = simulation.case, simulation.comm
    mesh = results.folder / f"{case.name}.msh"
    if not (resumed and on_root(comm, lambda: resume.mesh_is_known(results, mesh))):
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
    sources = solve_sources(simulation, results.own.path / mesh.name)  # stored since the first state
    on_root(comm, lambda: results.write_sources(sources))
    if ended is not None:
        raise ended


def _begin(simulation: Simulation, results: Results) -> None:
    grid = simulation.fields.grid
    on_root(simulation.comm, lambda: results.begin(grid.points, grid.cells, grid.cell_name))


def _store(
    steps: Iterable[Step], results: Results, comm: MPI.Comm, begun: Callable[[Results], None] = lambda results: None
) -> None:
    for number, step in enumerate(steps):

        def add(step: Step = step, first: bool = number == 0) -> None:
            assert step.fields is not None
            results.add(step.row, step.fields, step.restart)
            if first:
                begun(results)

        on_root(comm, add)


def _begun(simulation: Simulation, results: Results) -> Begun:
    """Return the state from which a resumed run continues."""
    case, fields, comm = simulation.case, simulation.fields, simulation.comm
    rows = on_root(comm, lambda: results.rows)
    if case.load_unload:
        return Begun(rows)
    solved = on_root(
        comm, lambda: {i: row.get("time_s", 0.0) for i, row in enumerate(results.rows) if not row["bifurcation"]}
    )
    again = functools.partial(resume.recall, results, fields, comm, solved)
    if case.program:
        stop = resume.last_stop(case, results, fields, comm)
        simulation.listener.say(f"resuming from step {stop.number} of the program")
        return Begun(rows, stop=stop, recall=again)
    left = on_root(comm, lambda: [not resume.stopped_at(results, case.column, value) for value in case.values])
    points = resume.stored_points(results, fields, comm)
    simulation.listener.say(f"resuming from step {len(rows) - 1}")
    return Begun(rows, left, points, recall=again)


def _record_branch(simulation: Simulation, results: Results) -> None:
    """Follow the branch at the first bifurcation, into its own folder."""
    case, comm = simulation.case, simulation.comm
    if not simulation.bifurcates:
        simulation.listener.say(on_root(comm, lambda: no_branch(case, results.rows)))
        return
    on_root(comm, lambda: begin_branch(results, case))
    aside = results.branch()
    _begin(simulation, aside)
    _store(simulation.branch(), aside, comm)
    on_root(comm, lambda: gather(case, aside, Ended()) if aside.stored else None)


def begin_branch(results: Results, case: Case) -> Results:
    """Create the folder of a branch beside its path, and remove an earlier branch; on rank 0."""
    aside = results.branch()
    results.own.claim([BRANCH])
    aside.clear()
    copies = {file: f"../{name}" for file, name in results.inputs_of(case.files).items()}
    there = {file: name for file, name in copies.items() if (aside.folder / name).is_file()}
    write_text(aside.folder / "case.toml", case.to_toml(there))
    return aside
