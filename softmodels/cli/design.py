"""``softmodels design``: find the parameters of a device that meet a design problem."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict, Unpack

import click

from geometries import MeshFileError, MeshingError
from softmodels.cli.options import fail
from softmodels.cli.run import end, start_drawing, tell_not_drawn
from softmodels.common.commands import STOPPED, FolderType, asked_to_stop, colormap_option, stoppable
from softmodels.common.folders import OwnFolderError
from softmodels.common.processes import say
from softmodels.design.problem import DesignProblem
from softmodels.design.trials import DesignError
from softmodels.mechanics.mpi import abort_on_error, is_root, on_root, petsc_reason, speaks, start
from softmodels.runs.columns import StateLabels
from softmodels.runs.outcomes import DONE, FAILED, NO_EQUILIBRIUM, Progress, RunError, no_memory

if TYPE_CHECKING:
    from mpi4py import MPI

    from softmodels.design.model import DesignFolder
    from softmodels.design.problem import SearchOptions
    from softmodels.design.result import DesignResult


FINER = 2.0
"""Refinement factor between two mesh levels."""


class DesignArguments(TypedDict):
    """Option values, by name."""

    output: Path | None
    resume: bool
    starts: int
    evaluations: int
    seed: int
    confirm_finer: bool
    no_pictures: bool
    colormap: str
    quiet: bool


@click.command("design")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("-o", "--output", type=FolderType(), help="Folder for the results.  [default: results/NAME; results/NAME-2 "
              "and so on if that holds another problem]")  # fmt: skip
@click.option("--resume", is_flag=True, help="Resume an interrupted run; no design is evaluated again.")
@click.option("--starts", type=click.IntRange(1, 50), default=1, show_default=True, help="Number of searches: the first from "
              "the given device, the others from points spread over the bounds.")  # fmt: skip
@click.option(
    "--evaluations",
    type=click.IntRange(1, 1000),
    default=40,
    show_default=True,
    help="Maximum number of designs per start.",
)
@click.option("--seed", type=click.IntRange(0), default=1, show_default=True, help="Seed of the further starts.")
@click.option("--confirm-finer", is_flag=True, help="Confirm the design on a finer mesh, with cells half as large.")
@click.option("--no-pictures", is_flag=True, help="Skip the runs before and after, the pictures and the report.")
@colormap_option
@click.option("--quiet", is_flag=True, help="Print only errors.")
def design(file: Path, **options: Unpack[DesignArguments]) -> None:
    """Find the device that best meets the objective of a problem FILE, within its limits.

    The file names a case, the parameters that may change with their bounds, an objective (maximise, minimise) or
    a target motion (follow), and limits (keep). Every evaluated design is stored in iterates.csv and
    in the folder iterates, whose cases can be run; design.toml is always the best so far. At the end the
    best design's whole path is solved on a new mesh, and these values are reported.

    \b
    Examples:
      softmodels design more-lift.toml
      softmodels design more-lift.toml --starts 3 --confirm-finer --output results/lift
      mpirun -n 2 softmodels design more-lift.toml --resume
      softmodels run results/lift/design.toml

    \b
    Exit status: 0 done; 1 failed; 2 bad input; 3 the problem is infeasible (the closest design and the incompatible limits
    are reported), or the given device has no state at a required pressure; 130 stopped.
    """
    try:
        problem = DesignProblem.from_file(file)
    except DesignError as error:
        fail(str(error))
    with stoppable("softmodels", speaks):
        from softmodels.design.optimise import open_folder

        comm = start()
    abort_on_error(comm)
    how: SearchOptions = {
        "starts": options["starts"], "evaluations": options["evaluations"], "seed": options["seed"],
        "resume": options["resume"], "finer": FINER if options["confirm_finer"] else 1.0, "inputs": [file],
    }  # fmt: skip
    try:
        folder = open_folder(problem, options["output"], comm, how)
    except DesignError as error:
        fail(str(error))
    try:
        status = _design(problem, folder, comm, how, options)
    finally:
        if folder is not None:
            folder.leave()
    sys.exit(status)


def _design(
    problem: DesignProblem, folder: DesignFolder | None, comm: MPI.Comm, how: SearchOptions, options: DesignArguments
) -> int:
    """Optimise, report, draw; return the exit status."""
    from petsc4py import PETSc

    from softmodels.design.optimise import run_in

    quiet = options["quiet"] or not is_root(comm)
    progress = Progress(1.0, "", StateLabels(""), quiet)
    if folder is not None:
        progress.say(f"writing results to {folder.path}")
    for note in problem.notes:
        progress.say(f"note: {note}")
    try:
        with asked_to_stop() as stopped:
            how["progress"], how["stopped"] = progress.say, stopped
            result = run_in(problem, folder, comm, **how)
    except DesignError as error:
        fail(str(error))
    except RunError as error:
        fail(str(error), error.status)
    except (MeshingError, MeshFileError) as error:
        fail(str(error), FAILED)
    except PETSc.Error as error:
        fail(f"PETSc stopped ({petsc_reason(error)}); the evaluated designs are kept; continue with --resume", FAILED)
    except MemoryError as error:
        fail(no_memory(error), FAILED)
    except (OwnFolderError, OSError) as error:
        fail(f"the designs cannot be written ({error}); continue with --resume", FAILED)
    return _close(result, folder, comm, quiet, None if options["no_pictures"] else options["colormap"])


def _close(result: DesignResult, folder: DesignFolder | None, comm: MPI.Comm, quiet: bool, colormap: str | None) -> int:
    """Write the summary, run the initial and the final device, draw, and print how the search ended."""
    from softmodels.design.result import FILE, notes, summary

    if folder is not None:
        folder.write({FILE: summary(result)})
    drawn = False
    if colormap is not None and not result.stopped:
        drawn = _drawn(result, folder, comm, quiet, colormap)
    status = STOPPED if result.stopped else FAILED if result.trouble else DONE if result.feasible else NO_EQUILIBRIUM
    if not is_root(comm) or folder is None:
        return status
    if result.trouble or not result.feasible:
        say(f"softmodels: {result.trouble or result.reasons[0]}", err=True)
    if not quiet:
        found = result.recovered
        told = [
            *(found.sentences if found else []),
            *result.missed,
            *result.reasons[0 if result.feasible else 1 :],
            *result.margins,
            *result.confirmation,
        ]
        say(result.headline)
        for text in [*told, *filter(None, [result.agreement]), *(f"note: {note}" for note in notes(result))]:
            say(f"  {text}")
        more = "; before/ and after/ are the runs, report.html has the pictures" if drawn else ""
        say(f"{folder.path}: design.toml is the optimised device, iterates.csv lists all designs{more}")
    return status


def _drawn(result: DesignResult, folder: DesignFolder | None, comm: MPI.Comm, quiet: bool, colormap: str) -> bool:
    """Run the initial and the final device and draw both; return whether there are pictures."""
    from softmodels.cli.run import run
    from softmodels.design.result import FILES

    assert result.folder is not None
    if folder is not None:
        folder.own.claim(["before/", "after/", *FILES])
        if not quiet:
            say("running and drawing the initial and the final device (skip with --no-pictures)", err=True)
    for name, case in (("before", result.given), ("after", result.case)):
        status = run(case, result.folder / name, quiet=True, draw=False, interrupts=asked_to_stop)
        if status not in (DONE, NO_EQUILIBRIUM):
            return False
    return bool(on_root(comm, lambda: _draw(result, colormap)))


def _draw(result: DesignResult, colormap: str) -> bool:
    """Return the draw in a separate process, because VTK and DOLFINx each bring their own HDF5."""
    words = str(result.folder), "--colormap", colormap
    process = start_drawing(result.problem.case, "softmodels.pictures.draw_design", *words)
    try:
        out, errors = process.communicate()
    finally:
        end(process)
    if process.returncode == 0:
        return True
    tell_not_drawn(out, errors, process.returncode, "the design is complete")
    return False
