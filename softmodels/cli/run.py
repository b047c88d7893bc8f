"""From a case to a folder of results: the one way in which every command runs a device.

Exit status: 0 all requested values reached; 1 the run failed; 2 bad input, found before anything was solved; 3 a requested
value is not on the path (a limit point); 130 stopped by the user. Whatever happened, all steps up to it are in the folder.
"""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from geometries import GeometryError, MeshFileError, MeshingError
from measurement.ending import bounded
from measurement.folder_lock import InUseError
from measurement.output_place import FULL
from measurement.own_folder import OwnFolderError
from softmodels.case.case import Case, CaseError
from softmodels.case.gauges import GaugeError
from softmodels.cli.closing import close
from softmodels.materials.laws import MaterialError
from softmodels.mechanics.contact import ObstacleError
from softmodels.mechanics.mpi import abort_on_error, is_root, on_root, petsc_reason, start
from softmodels.results.outcomes import BAD_INPUT, DONE, FAILED, NO_MEMORY, RunError
from softmodels.results.store import Results, ResultsError
from softmodels.runs.folder import begin
from softmodels.runs.progress import Progress
from softmodels.runs.recording import record
from softmodels.runs.simulation import Simulation


def _nobody() -> contextlib.AbstractContextManager[Callable[[], bool]]:
    """Nobody asks to stop, but for exceptions."""
    return contextlib.nullcontext(bool)


def run(
    case: Case,
    folder: Path | None,
    *,
    resume: bool = False,
    quiet: bool = False,
    petsc: Sequence[str] = (),
    draw: bool = True,
    branch: bool = False,
    inputs: Sequence[Path] = (),
    interrupts: Callable[[], contextlib.AbstractContextManager[Callable[[], bool]]] = _nobody,
) -> int:
    """Run a case and return the exit status; all messages go to standard error, the summary to standard output.

    Args:
        case: What to run.
        folder: Where the results go; None for the first of ``results/NAME``, ``results/NAME-2`` ... that is free or holds
            a run of this very case.
        resume: Go on from what an interrupted run of the same case left there.
        quiet: Only errors are said.
        petsc: Words for PETSc's option database.
        draw: Make the pictures at the end.
        branch: Follow the branch that leaves the path at its first bifurcation too, into the folder ``branch``.
        inputs: Files that the user has given: they are never written.
        interrupts: Entered while states are solved; gives whether to stop, asked between them. No signal is handled unless
            here, as a command does by `asked_to_stop`; may be called in any thread.

    Raises:
        StartError: PETSc cannot take the words.
    """
    comm = start(petsc)
    abort_on_error(comm)
    from petsc4py import PETSc

    results: Results | None = None
    progress = Progress(case.values[-1], case.unit, case.actuator.gauge, quiet or not is_root(comm))
    status, message = DONE, ""
    try:
        with progress, interrupts() as stopped:
            results, resumed = _begin(case, folder, resume, draw, inputs, comm)
            progress.say(f"results go to {results.own.path}")
            record(Simulation(case, comm, progress, stopped), results, resumed, branch)
    except RunError as error:
        status, message = error.status, str(error)
    except (
        GaugeError, GeometryError, MeshFileError, MeshingError, CaseError, MaterialError, ObstacleError, ResultsError,
        OwnFolderError, InUseError,
    ) as error:  # fmt: skip
        status, message = FAILED if isinstance(error, MeshingError) else BAD_INPUT, str(error)
    except PETSc.Error as error:
        # What PETSc refuses before anything is solved are the words it was given.
        words = bool(petsc) and not on_root(comm, lambda: results and results.stored)
        advice = (
            "check the words after --"
            if words
            else "rerun with -- -snes_monitor -ksp_error_if_not_converged to see more"
        )
        status, message = BAD_INPUT if words else FAILED, f"PETSc stopped ({petsc_reason(error)}); {advice}"
    except OSError as error:
        advice = "make room for them" if error.errno in FULL else "see that they can"
        status, message = FAILED, f"{_unwritten(error)}; {advice} and go on with --resume"
    except MemoryError:
        status, message = FAILED, NO_MEMORY
    except BaseException:  # a caller's Ctrl-C among them
        if results is not None and is_root(comm):
            results.own.leave()
        raise
    return on_root(comm, lambda: _end(case, results, status, message, quiet, draw))


def _begin(
    case: Case, folder: Path | None, resume: bool, draw: bool, inputs: Sequence[Path], comm: Any
) -> tuple[Results, bool]:
    """The results on every rank (rank 0 alone writes them), and whether there are states to go on from."""
    begun: list[Results] = []

    def on_rank_0() -> tuple[Path, Path, bool]:
        results, resumed = begin(case, folder, resume, draw, inputs)
        begun.append(results)
        return results.own.path, results.folder, resumed

    home, at, resumed = on_root(comm, on_rank_0)
    results = begun[0] if begun else Results(home, case.name, case.actuator.gauge)
    results.folder = at
    return results, resumed


def _end(case: Case, results: Results | None, status: int, message: str, quiet: bool, draw: bool) -> int:
    """Close the run and let go of its folder."""
    if results is None:
        print(f"softmodels: {bounded(message)}", file=sys.stderr)
        return status
    try:
        return close(case, results, status, message, quiet, draw)
    finally:
        results.own.leave()


def _unwritten(error: OSError) -> str:
    place = f" into {Path(error.filename).parent}" if isinstance(error.filename, str) else ""
    return f"the results cannot be written{place} ({error.strerror or error})"
