"""Run a case into a results folder, for every command that runs a device.

Exit status: 0 all requested values reached; 1 the run failed; 2 bad input, found before anything was solved; 3 a requested
value is not on the path (a limit point); 130 stopped by the user. In every case all steps so far are in the folder.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypedDict, Unpack

from geometries import GeometryError, MeshFileError, MeshingError
from softmodels.case.case import Case
from softmodels.case.entries import CaseError
from softmodels.case.requests import ProbeError
from softmodels.cli.drawing import DrawingProcess
from softmodels.common.commands import bounded
from softmodels.common.folders import InUseError, OwnFolderError
from softmodels.common.terminal import say
from softmodels.materials.laws import MaterialError
from softmodels.materials.silicones import stretch_at_break
from softmodels.mechanics.compiling import LONG
from softmodels.mechanics.component import ComponentError
from softmodels.mechanics.mpi import (
    abort_on_error,
    is_root,
    on_root,
    petsc_reason,
    start,
)
from softmodels.runs.columns import (
    StateLabels,
    overlap_text,
    state_labels,
    term,
)
from softmodels.runs.notes import notes_of, stability_text, unwritten
from softmodels.runs.outcomes import (
    BAD_INPUT,
    DONE,
    FAILED,
    NO_EQUILIBRIUM,
    RunError,
    no_memory,
)
from softmodels.runs.recording import (
    Progress,
    branch_rows,
    gather,
    not_gathered,
    record,
)
from softmodels.runs.resume import begin_together
from softmodels.runs.row import Row, at_rise, split
from softmodels.runs.simulation import Simulation
from softmodels.runs.store import Results, ResultsError

# ----------------------------------------------------------------------------------------------------------------------
# The end of a run: finalise the results, draw the pictures, print a summary.


def close(case: Case, results: Results, status: int, message: str, quiet: bool, drawing: DrawingProcess | None) -> int:
    """Finalise the results, draw them if ``drawing`` is given, and print how the run ended."""
    stored, took = results.stored, None
    notes = notes_of(case, results.rows, results.sources(case)) if stored and status != BAD_INPUT else []
    if stored and status != BAD_INPUT:
        try:
            gather(case, results, status, message, notes)
            results.own.forget_unwritten()
            if drawing is not None and status in (DONE, NO_EQUILIBRIUM):
                if not quiet:
                    say(drawing.begins, err=True)
                took = drawing.draw(results, quiet)
        except (OSError, OwnFolderError) as error:
            status = status or FAILED
            message = message or not_gathered(error)
    if message:
        states = "1 state" if len(stored) == 1 else f"{len(stored)} states"
        where = (
            f". The results up to this point ({states}) are in {results.own.path}"
            if stored and status != BAD_INPUT
            else ""
        )
        if drawing is not None and took is not None and not quiet:
            where += f": {drawing.made}, in {took:.1f} s"
        say(f"softmodels: {message}{where}", err=True)
    for note in notes if not quiet else []:
        say(f"softmodels: note: {note}", err=True)
    if not message and not quiet:
        row, words = results.rows[-1], state_labels(case)
        gauge = words.gauge
        volume = (
            f"added volume {row['added_volume_ml']:.5g}{_band(row, 'added_volume_ci95_ml')} ml" if words.volume else ""
        )
        say(
            f"{_loaded(row, words)}: {gauge} rise {row[f'{gauge}_mm']:+.5g}{_band(row, f'{gauge}_ci95_mm')} mm"
            f"{f', {volume}' if volume else ''}{pressed(row)}, "
            f"largest stretch {row['max_stretch']:.4g}{_bears(case)} and von Mises stress {row['max_von_mises_kPa']:.4g} kPa "
            f"(at integration points), J {row['J_min']:.4f} to {row['J_max']:.4f} (at vertices)"
            f"{f'; {overlap}' if (overlap := overlap_text(row)) else ''}"
        )
        if text := _sideways(row, gauge):
            print(text)
        if case.gauges.columns():
            say(", ".join(_gauge(name, row) for name in case.gauges.columns()))
        if told := stability_text(results.rows, case.actuator, words, branch_rows(results)):
            say(told)
        pictures = "" if drawing is None or took is None else f"; {drawing.made}, in {took:.1f} s"
        say(
            f"{len(stored)} states in {results.folder}: path.csv, {results.name}.vtkhdf for ParaView{pictures}{_solved_on()}"
        )
    return status


def _solved_on() -> str:
    """Return the number of ranks in words, if there are several."""
    from mpi4py import MPI

    ranks = MPI.COMM_WORLD.size
    return f"; solved on {ranks} ranks" if ranks > 1 else ""


def _gauge(column: str, row: Row) -> str:
    """Return a named point or angle with its value and unit."""
    name, unit = split(column)
    return f"{name.replace('_', ' ')} {row[column]:.5g}{unit if unit == '°' else f' {unit}'}"


def _band(row: Row, column: str) -> str:
    """Return half the 95 % interval due to the material's errors, to print after a value; empty if unknown."""
    width = row.get(column, math.nan)
    return "" if math.isnan(width) or not width else f" +- {width:.3g} (95 %)"


def _sideways(row: Row, gauge: str) -> str:
    """Return what the intervals mean, and the pressure's own, which differs at equal rise and at equal volume."""
    at_volume, rising = (row.get(column, math.nan) for column in ("pressure_ci95_cm", at_rise(gauge)))
    if math.isnan(at_volume) or not at_volume:
        return ""
    same = "" if math.isnan(rising) else f"+- {rising:.3g} cm at equal rise of the {gauge}, "
    return (
        f"95 % intervals from the material's errors: rise and volume at the requested value; pressure {same}+- "
        f"{at_volume:.3g} cm at equal added volume"
    )


def _loaded(row: Row, words: StateLabels) -> str:
    cavities, pressure = words.pressures(row), f"{row['pressure_cm']:.6g} cm ({row['pressure_Pa'] / 1e3:.5g} kPa)"
    if "load_step" in row and len(cavities) > 1:
        pressure = ", ".join(f"cavity{i} {row[name]:.6g} cm" for i, name in enumerate(cavities, 1))
    return words.under(row, pressure)


def pressed(row: Row) -> str:
    """Return the contact forces of the device, for the closing line."""
    forces = ("blocked_force_N", "contact_force_N")
    return "".join(f", {term(name).name} {row[name]:.4g} N" for name in forces if name in row)


def _bears(case: Case) -> str:
    breaks = stretch_at_break(case.material)
    return "" if breaks is None else f" (broke at {breaks:.4g})"


def _nobody() -> contextlib.AbstractContextManager[Callable[[], bool]]:
    """Return a context in which nothing asks to stop."""
    return contextlib.nullcontext(bool)


class RunOptions(TypedDict, total=False):
    """Options of a run; none changes a number.

    Attributes:
        resume: Resume an interrupted run of the same case in the folder.
        quiet: Only errors are reported.
        petsc: Words for PETSc's option database.
        draw: Make the pictures at the end, which is the default.
        few: Only the curves, the stress and the report of them.
        branch: Also follow the branch at the first bifurcation, into the folder ``branch``.
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


def run(case: Case, folder: Path | None, **how: Unpack[RunOptions]) -> int:
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
    progress = Progress(case.values[-1], case.unit, state_labels(case), quiet or not is_root(comm))
    status, message = DONE, ""
    drawing = DrawingProcess(case, how.get("few", False)) if draw and is_root(comm) else None
    try:
        with progress, how.get("interrupts", _nobody)() as stopped:
            results, resumed = begin_together(
                case, folder, how.get("resume", False), comm, draw=draw, inputs=how.get("inputs", ())
            )
            progress.say(f"writing results to {results.own.path}")
            if drawing is not None:
                drawing.get_ready(comm.size)
            branch, begun = how.get("branch", False), drawing.begin if drawing is not None else None
            record(Simulation(case, comm, progress, stopped), results, resumed, branch, begun)
    except BaseException as error:  # a caller's Ctrl-C among them
        # What PETSc rejects before the first solve are its options.
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
    """Return exit status and message of the error that ended a run; None for an unexpected one.

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
            ProbeError() | GeometryError() | MeshFileError() | CaseError() | MaterialError()
            | ComponentError() | ResultsError() | OwnFolderError() | InUseError()
        ):  # fmt: skip
            return BAD_INPUT, str(error)
        case PETSc.Error():
            refused, reason = words(), petsc_reason(error)
            more = "rerun with -- -snes_monitor -ksp_error_if_not_converged for details"
            return (
                (BAD_INPUT, f"PETSc stopped ({reason}); check the options after --")
                if refused
                else (FAILED, f"PETSc stopped ({reason}); {more}")
            )
        case TimeoutError():  # of a form that is compiled late
            return FAILED, LONG
        case OSError():
            return FAILED, unwritten(error)
        case MemoryError():
            return FAILED, no_memory(error)
    return None


def _end(
    case: Case, results: Results | None, status: int, message: str, quiet: bool, drawing: DrawingProcess | None
) -> int:
    """Close the run and release its folder."""
    if results is None:
        say(f"softmodels: {bounded(message)}", err=True)
        return status
    try:
        return close(case, results, status, message, quiet, drawing)
    finally:
        if drawing is not None:
            drawing.leave()
        results.own.leave()
