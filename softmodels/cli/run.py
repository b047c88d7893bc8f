"""From a case to a folder of results: the one way in which every command runs a device.

Exit status: 0 all requested values reached; 1 the run failed; 2 bad input, found before anything was solved; 3 a requested
value is not on the path (a limit point); 130 stopped by the user. Whatever happened, all steps up to it are in the folder.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict, Unpack

from geometries import GeometryError, MeshFileError, MeshingError
from measurement.ending import bounded
from measurement.folder_lock import InUseError
from measurement.own_folder import OwnFolderError
from measurement.terminal import say
from softmodels.case.case import Case, CaseError
from softmodels.case.gauges import GaugeError
from softmodels.cli.closing import close
from softmodels.cli.drawing import Drawing
from softmodels.materials.laws import MaterialError
from softmodels.mechanics.compiling import LONG
from softmodels.mechanics.contact import ObstacleError
from softmodels.mechanics.mpi import abort_on_error, is_root, on_root, petsc_reason, start
from softmodels.mechanics.parts import PartError
from softmodels.results.outcomes import BAD_INPUT, DONE, FAILED, RunError, no_memory
from softmodels.results.state_words import state_words
from softmodels.results.store import Results, ResultsError
from softmodels.runs.failures import unwritten
from softmodels.runs.folder import begin_together
from softmodels.runs.progress import Progress
from softmodels.runs.recording import record
from softmodels.runs.simulation import Simulation

if TYPE_CHECKING:
    pass


def _nobody() -> contextlib.AbstractContextManager[Callable[[], bool]]:
    """Nobody asks to stop, but for exceptions."""
    return contextlib.nullcontext(bool)


class How(TypedDict, total=False):
    """How a case is run; nothing of it changes a number.

    Attributes:
        resume: Go on from what an interrupted run of the same case left in the folder.
        quiet: Only errors are reported.
        petsc: Words for PETSc's option database.
        draw: Make the pictures at the end, which is the default.
        few: Of them the curves, the stress and the report alone.
        branch: Follow the branch that leaves the path at its first bifurcation too, into the folder ``branch``.
        inputs: Files that the user has given: they are never written.
        interrupts: Entered while states are solved; gives whether to stop, asked between them. No signal is handled unless
            here, as a command does by `asked_to_stop`.
    """

    resume: bool
    quiet: bool
    petsc: Sequence[str]
    draw: bool
    few: bool
    branch: bool
    inputs: Sequence[Path]
    interrupts: Callable[[], contextlib.AbstractContextManager[Callable[[], bool]]]


def run(case: Case, folder: Path | None, **how: Unpack[How]) -> int:
    """Run a case and return the exit status; all messages go to standard error, the summary to standard output.

    May be called in any thread.

    Args:
        case: What to run.
        folder: Where the results go; None for the first of ``results/NAME``, ``results/NAME-2`` ... that is free or holds
            a run of this very case.
        how: See `How`.

    Raises:
        StartError: PETSc cannot take the words.
    """
    petsc, quiet, draw = how.get("petsc", ()), how.get("quiet", False), how.get("draw", True)
    comm = start(petsc)
    abort_on_error(comm)
    results: Results | None = None
    progress = Progress(case.values[-1], case.unit, state_words(case), quiet or not is_root(comm))
    status, message = DONE, ""
    drawing = Drawing(case, how.get("few", False)) if draw and is_root(comm) else None
    try:
        with progress, how.get("interrupts", _nobody)() as stopped:
            results, resumed = begin_together(
                case, folder, how.get("resume", False), comm, draw=draw, inputs=how.get("inputs", ())
            )
            progress.say(f"results go to {results.own.path}")
            if drawing is not None:
                drawing.get_ready(comm.size)
            branch, begun = how.get("branch", False), drawing.begin if drawing is not None else None
            record(Simulation(case, comm, progress, stopped), results, resumed, branch, begun)
    except BaseException as error:  # a caller's Ctrl-C among them
        # What PETSc refuses before anything is solved are the words it was given.
        ended = _outcome(error, lambda: bool(petsc) and not on_root(comm, lambda: results and results.stored))
        if ended is None:
            if results is not None and is_root(comm):
                results.own.leave()
            if drawing is not None:
                drawing.leave()
            raise
        status, message = ended
    return on_root(comm, lambda: _end(case, results, status, message, quiet, drawing))


def _outcome(error: BaseException, words: Callable[[], bool]) -> tuple[int, str] | None:
    """Exit status and sentence of what ended a run; None for what no run foresees.

    Args:
        error: What was raised.
        words: Whether it was PETSc's words that PETSc refused; all ranks ask.
    """
    from petsc4py import PETSc

    match error:
        case RunError():
            return error.status, str(error)
        case MeshingError():
            return FAILED, str(error)
        case (
            GaugeError() | GeometryError() | MeshFileError() | CaseError() | MaterialError() | ObstacleError()
            | PartError() | ResultsError() | OwnFolderError() | InUseError()
        ):  # fmt: skip
            return BAD_INPUT, str(error)
        case PETSc.Error():
            refused, reason = words(), petsc_reason(error)
            more = "rerun with -- -snes_monitor -ksp_error_if_not_converged to see more"
            return (
                (BAD_INPUT, f"PETSc stopped ({reason}); check the words after --")
                if refused
                else (FAILED, f"PETSc stopped ({reason}); {more}")
            )
        case TimeoutError():  # of an equation that is compiled late
            return FAILED, LONG
        case OSError():
            return FAILED, unwritten(error)
        case MemoryError():
            return FAILED, no_memory(error)
    return None


def _end(case: Case, results: Results | None, status: int, message: str, quiet: bool, drawing: Drawing | None) -> int:
    """Close the run and let go of its folder."""
    if results is None:
        say(f"softmodels: {bounded(message)}", err=True)
        return status
    try:
        return close(case, results, status, message, quiet, drawing)
    finally:
        if drawing is not None:
            drawing.leave()
        results.own.leave()
