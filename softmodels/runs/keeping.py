"""A case solved into a `Run`: its states kept in memory, or written into a folder of results as they are solved."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from softmodels.case.case import Case
from softmodels.mechanics.mpi import is_root, on_root
from softmodels.results.notes import notes_of
from softmodels.results.outcomes import BAD_INPUT, RunError
from softmodels.results.row import Row
from softmodels.results.store import Results
from softmodels.runs.failures import sentences, unwritten
from softmodels.runs.folder import begin_together
from softmodels.runs.gathering import gather, not_gathered
from softmodels.runs.recording import no_branch, record
from softmodels.runs.run import Ended, Run
from softmodels.runs.simulation import Simulation
from softmodels.runs.sources import solve_sources
from softmodels.runs.states import InFolder, InMemory
from softmodels.runs.step import PathEnded
from softmodels.runs.temporary_folder import temporary_folder

if TYPE_CHECKING:
    from mpi4py import MPI


@dataclasses.dataclass(frozen=True)
class Place:
    """A folder to solve into.

    Attributes:
        folder: Empty, not there, or an earlier run's; all ranks see it.
        resume: Go on from what an interrupted run of the same case has left.
        inputs: Files that the user has given: they are never written.
    """

    folder: Path
    resume: bool = False
    inputs: tuple[Path, ...] = ()


def solve_in_memory(simulation: Simulation, branch: bool) -> Run:
    """Solve a case and keep its states; all ranks call it.

    Args:
        simulation: The case, not prepared yet.
        branch: Follow the branch at the first bifurcation too.

    Raises:
        RunError: No state under load was found.
    """
    case, comm, ended = simulation.case, simulation.comm, Ended()
    states: InMemory | None = None
    aside: InMemory | None = None
    try:
        with sentences(), temporary_folder(comm) as folder:
            mesh = folder / f"{case.name}.msh"
            simulation.write_mesh(mesh)
            simulation.prepare(mesh)
            states = InMemory(simulation, mesh)
            try:
                for step in simulation.steps():
                    states.add(step)
            except PathEnded as end:
                ended = Ended.by(end)
                if case.program:
                    raise
            aside = _branch(simulation, states, mesh) if branch else None
            states.others = solve_sources(simulation, mesh)
    except RunError as error:
        ended = Ended.by(error)
        if states is None:
            raise
    finally:
        simulation.release()
    if ended.error is not None and not _loaded(states.rows):
        raise ended.error
    return Run(states, ended, comm, None if aside is None else Run(aside, Ended(), comm))


def _branch(simulation: Simulation, states: InMemory, mesh: Path) -> InMemory | None:
    """The states of the branch at the first bifurcation; None if there is none to be found."""
    if not simulation.bifurcates:
        simulation.listener.say(no_branch(simulation.case, states.rows))
        return None
    aside = InMemory(simulation, mesh)
    for step in simulation.branch():
        aside.add(step)
    return aside if aside.rows else None


def solve_into(place: Place, simulation: Simulation, branch: bool) -> Run:
    """Solve a case and write each state into a folder at once, as the command line does; all ranks call it.

    Args:
        place: The folder.
        simulation: The case, not prepared yet.
        branch: Follow the branch at the first bifurcation too.

    Raises:
        RunError: No state under load was found, or states could not be written.
        ResultsError, OwnFolderError, InUseError, CaseError: The folder, or what is in it, cannot be used.
    """
    comm, ended = simulation.comm, Ended()
    results, resumed = begin_together(
        simulation.case, place.folder, place.resume, comm, draw=False, inputs=place.inputs
    )
    try:
        try:
            with sentences(unwritten):
                record(simulation, results, resumed, branch)
        except RunError as error:
            if error.status == BAD_INPUT or isinstance(error.__cause__, OSError):
                raise
            ended = Ended.by(error)
        finally:
            simulation.release()
        on_root(comm, lambda: _close(results, simulation.case, ended))
        if ended.error is not None and not on_root(comm, lambda: _loaded(results.rows)):
            raise ended.error
    finally:
        if is_root(comm):
            results.own.leave()
    return run_of(place.folder, ended, comm)


def run_of(folder: Path, ended: Ended, comm: MPI.Comm | None = None) -> Run:
    """The run in a folder, with the branch that leaves it.

    Raises:
        ResultsError: No results, or none that can be read.
        CaseError: No case file, or a wrong one.
    """
    source = InFolder(folder)
    aside = source.branch()
    return Run(source, ended, comm, None if aside is None else Run(aside, Ended(), comm))


def _close(results: Results, case: Case, ended: Ended) -> None:
    """Bring the steps into one file; on rank 0."""
    if not results.stored:
        return
    try:
        gather(case, results, ended.status, ended.message, notes_of(case, results.rows, results.sources(case)))
    except OSError as error:
        raise RunError(not_gathered(error)) from error
    results.own.forget_unwritten()


def _loaded(rows: Sequence[Row]) -> bool:
    """Whether there is a state that is not at rest."""
    return any(row["pressure_Pa"] or row["max_displacement_mm"] for row in rows)
