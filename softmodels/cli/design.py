"""``softmodels design`` and ``study``: the parameters of a device that meet a problem; a case solved many times."""

from __future__ import annotations

import dataclasses
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

import click

from geometries import MeshFileError, MeshingError
from softmodels.cli import ending, options, run
from softmodels.common import commands, errors, files, processes
from softmodels.common.folders import OwnFolderError
from softmodels.common.lazy import MPI, PETSc
from softmodels.design import study
from softmodels.design.problem import DesignProblem, SearchOptions
from softmodels.design.study import Study
from softmodels.design.trials import DesignError
from softmodels.mechanics import mpi
from softmodels.runs import labels, outcomes

if TYPE_CHECKING:
    from softmodels.design import model
    from softmodels.design.result import DesignResult


@dataclasses.dataclass(frozen=True)
class DesignOptions:
    """The options of `design`."""

    changes: tuple[str, ...] = options.set_field()
    output: Path | None = commands.output_option(  # noqa: RUF009
        "Folder for the results.  [default: results/NAME; results/NAME-2 and so on if that holds another problem]"
    )
    resume: bool = commands.flag_option("Resume an interrupted run; no design is evaluated again.")
    starts: int = commands.option(type=click.IntRange(1, 50), default=1, show_default=True,
    help="Number of searches: the first from "
                         "the given device, the others from points spread over the bounds.")  # fmt: skip
    evaluations: int = commands.option(type=click.IntRange(1, 1000), default=40, show_default=True,
                              help="Maximum number of designs per start.")  # fmt: skip
    seed: int = commands.option(type=click.IntRange(0), default=1, show_default=True, help="Seed of the further starts.")
    confirm_finer: bool = commands.flag_option("Confirm the design on a finer mesh, with cells half as large.")
    map: bool = commands.flag_option("Only predict what one more channel of the plate would do, at each place of [grow].")
    no_pictures: bool = commands.flag_option("Skip the runs before and after, the pictures and the report.")
    colormap: str = commands.option(**commands.COLORMAP_OPTION)
    quiet: bool = commands.quiet_option()


@options.command("design")
@click.argument("file", type=click.Path(path_type=Path))
@commands.options(DesignOptions)
def design(file: Path, how: DesignOptions) -> None:
    """Find the device that best meets the objective in a FILE.

    The problem FILE names a case, the parameters that may change with their bounds,
    an objective (maximise, minimise) or a target motion (follow), and limits (keep). Every evaluated design is stored in
    iterates.csv and in the folder iterates, whose cases can be run; design.toml is always the best so far. At the end the best
    design's whole path is solved on a new mesh, and these values are reported.

    \b
    Examples:
      softmodels design more-lift.toml
      softmodels design more-lift.toml --starts 3 --confirm-finer --output results/lift
      mpirun -n 2 softmodels design more-lift.toml --resume
      softmodels design network.toml --map
      softmodels run results/lift/design.toml

    \b
    Exit status: 0 done; 1 failed; 2 bad input; 3 the problem is infeasible (the closest design and the incompatible limits
    are reported), or the given device has no state at a required pressure; 130 stopped.
    """
    try:
        problem = DesignProblem.from_file(file, how.changes)
        with commands.stoppable("softmodels", mpi.speaks):
            from softmodels.design import optimise

            comm = mpi.start()
        search: SearchOptions = {
            "starts": how.starts, "evaluations": how.evaluations, "seed": how.seed, "resume": how.resume,
            "finer": REFINEMENT_FACTOR if how.confirm_finer else 1.0, "inputs": [file],
        }  # fmt: skip
        folder = optimise.open_folder(problem, how.output, comm, search)
    except DesignError as error:
        ending.fail(str(error))
    try:
        status = _map(problem, folder, comm) if how.map else _design(problem, folder, comm, search, how)
    finally:
        if folder is not None:
            folder.leave()
    sys.exit(status)


def _map(problem: DesignProblem, folder: model.DesignFolder | None, comm: MPI.Comm) -> int:
    """Write and print what one more channel would do; return the exit status."""
    from softmodels.design import grow

    try:
        sentences = grow.map_alone(problem, folder, comm)
    except DesignError as error:
        ending.fail(str(error))
    if folder is not None:
        for text in [*sentences, f"{folder.path}: map.csv has all of them, map.svg shows them"]:
            processes.say(text)
    return commands.EXIT_DONE


REFINEMENT_FACTOR = 2.0
"""Refinement factor between two mesh levels."""


def _design(
    problem: DesignProblem, folder: model.DesignFolder | None, comm: MPI.Comm, search: SearchOptions, how: DesignOptions
) -> int:
    """Optimise, report, draw; return the exit status."""
    from softmodels.design import optimise

    quiet = how.quiet or not mpi.is_root(comm)
    progress = outcomes.Progress(labels.StateLabels(""), quiet)
    if folder is not None:
        progress.say(f"writing results to {folder.path}")
    for note in problem.notes:
        progress.say(f"note: {note}")
    try:
        with options.rank_asked_to_stop() as stopped:
            search["progress"], search["stopped"] = progress.say, stopped
            result = optimise.run_in(problem, folder, comm, **search)
    except DesignError as error:
        ending.fail(str(error))
    except (MeshingError, MeshFileError) as error:
        ending.fail(str(error), commands.EXIT_FAILED)
    except PETSc.Error as error:
        ending.fail(
            f"PETSc stopped ({mpi.petsc_reason(error)}); the evaluated designs are kept; continue with --resume",
            commands.EXIT_FAILED,
        )
    except (OwnFolderError, OSError) as error:
        ending.fail(f"the designs cannot be written ({error}); continue with --resume", commands.EXIT_FAILED)
    return _close(result, folder, comm, quiet, None if how.no_pictures else how.colormap)


def _close(result: DesignResult, folder: model.DesignFolder | None, comm: MPI.Comm, quiet: bool, colormap: str | None) -> int:
    """Write the summary, run the initial and the final device, draw, and print how the search ended."""
    from softmodels.design.result import DESIGN_FILE, notes, summary

    if folder is not None:
        folder.write({DESIGN_FILE: summary(result)})
    drawn = colormap is not None and not result.stopped and _drawn(result, folder, comm, quiet, colormap)
    status = (
        commands.EXIT_STOPPED
        if result.stopped
        else commands.EXIT_FAILED
        if result.trouble
        else commands.EXIT_DONE
        if result.feasible
        else commands.EXIT_NO_EQUILIBRIUM
    )
    if not mpi.is_root(comm) or folder is None:
        return status
    if result.trouble or not result.feasible:
        processes.say(f"softmodels: {result.trouble or result.reasons[0]}", err=True)
    if not quiet:
        processes.say(result.headline)
        for text in [
            *(result.recovered.sentences if result.recovered else []), *result.missed,
            *result.reasons[0 if result.feasible else 1 :], *result.margins, *result.confirmation,
            *filter(None, [result.agreement]), *(f"note: {note}" for note in notes(result)),
        ]:  # fmt: skip
            processes.say(f"  {text}")
        more = "; before/ and after/ are the runs, report.html has the pictures" if drawn else ""
        processes.say(f"{folder.path}: design.toml is the optimised device, iterates.csv lists all designs{more}")
    return status


def _drawn(result: DesignResult, folder: model.DesignFolder | None, comm: MPI.Comm, quiet: bool, colormap: str) -> bool:
    """Run the initial and the final device and draw both; return whether there are pictures."""
    from softmodels.design.result import FILES

    assert result.folder is not None
    if folder is not None:
        folder.own.claim(["before/", "after/", *FILES])
        if not quiet:
            processes.say("running and drawing the initial and the final device (skip with --no-pictures)", err=True)
    for name, case in (("before", result.given), ("after", result.case)):
        status = run.run(
            case, result.folder / name, commands.RunOptions(quiet=True, no_pictures=True), interrupts=options.rank_asked_to_stop
        )
        if status not in (commands.EXIT_DONE, commands.EXIT_NO_EQUILIBRIUM):
            return False
    words = "softmodels.pictures.draw_design", str(result.folder), "--colormap", colormap
    return mpi.on_root(comm, lambda: run.drawn_aside(result.problem.case, "the design is complete", *words))


# ----------------------------------------------------------------------------------------------------------------------
# The command ``study``.


@dataclasses.dataclass(frozen=True)
class StudyOptions:
    """The options of `study_command`."""

    changes: tuple[str, ...] = options.set_field()
    output: Path | None = commands.output_option(  # noqa: RUF009
        "Folder for the results.  [default: results/NAME; results/NAME-2 and so on if that holds another study]"
    )
    resume: bool = commands.flag_option("Resume an interrupted study; no sample is solved again.")
    jobs: int | None = commands.option(type=click.IntRange(1, 256),
                              help="Samples solved at a time.  [default: the number of cores]")  # fmt: skip
    scheduler: str = commands.option(default="", metavar="ADDRESS", help="Solve on the workers of a dask scheduler, such as "
                            "tcp://10.0.0.1:8786.")  # fmt: skip
    no_pictures: bool = commands.flag_option("Skip the pictures and the report.")
    quiet: bool = commands.quiet_option()


@options.command("study")
@click.argument("file", type=click.Path(path_type=Path))
@commands.options(StudyOptions)
def study_command(file: Path, how: StudyOptions) -> None:
    """Solve a case many times with some of its fields varied.

    The file names a case, how many samples there are and how they are drawn (latin-hypercube, sobol, saltelli, grid), and
    under [vary] the fields of the case file: "1.8:2.2 mm" (uniform), "2 mm +- 0.2 mm" (normal, 95 %), "1:2:0.25 mm" (steps),
    or a list. Every sample is solved in a process of its own and kept as soon as it is solved; one that fails keeps its
    sentence. Results: study.nc (netCDF: all columns over the samples, with units), study.csv, report.html with response
    surfaces and Sobol indices.

    \b
    Examples:
      softmodels study examples/study.toml
      softmodels study examples/study.toml --resume --jobs 2
      softmodels study examples/study.toml --scheduler tcp://10.0.0.1:8786

    \b
    Exit status: 0 done; 1 failed; 2 bad input; 130 stopped (continue with --resume).
    """
    begun = time.monotonic()
    if (mpi.launched() or 1) > 1:
        ending.fail("a study shares its samples among its own processes (--jobs, --scheduler); start it without mpirun")
    plan = study.StudyPlan.from_file(file, how.changes)
    kept = study.open_folder(plan, how.output, how.resume, [file])
    assert kept.own is not None
    folder = kept.own.path
    try:
        solved = _solved(kept, plan, how, folder)
        try:
            solved.save(folder / study.DATASET)
            if not how.no_pictures:
                _draw_study(solved, folder, time.monotonic() - begun)
        except OSError as error:
            ending.fail(f"the results cannot be written into {folder} ({errors.reason(error)})", commands.status_of(error))
    finally:
        kept.leave()
    if not how.quiet:
        for name, text in solved._figures():
            processes.say(f"{name}: {text}")
        for k, text in list(solved.failures.items())[:5]:
            processes.say(f"sample {k} has no result: {text}")
        processes.say(
            f"{folder}: {study.DATASET} has all results" + ("" if how.no_pictures else f", {study.PAGE} the pictures")
        )
    sys.exit(commands.EXIT_DONE)


def _solved(kept: study.StudyFolder, plan: study.StudyPlan, how: StudyOptions, folder: Path) -> Study:
    """Solve the study; exit with a sentence if that fails."""
    before, started = len(kept.answers), time.monotonic()
    if not how.quiet:
        processes.say(f"writing results to {folder}" + (f"; {before} samples are there" if before else ""), err=True)

    def progress(text: str) -> None:
        done = len(kept.answers) - before
        left = (len(plan.points) - len(kept.answers)) * (time.monotonic() - started) / max(done, 1)
        processes.say(text + processes.time_left(left), err=True)

    try:
        return study.solve_into(kept, plan, how.jobs or 0, how.scheduler, None if how.quiet else progress)
    except OSError as error:
        ending.fail(f"a sample cannot be written ({errors.reason(error)}); continue with --resume", commands.EXIT_FAILED)
    except KeyboardInterrupt:
        ending.fail("stopped by the user; continue with --resume", commands.EXIT_STOPPED)


def _draw_study(solved: Study, folder: Path, seconds: float) -> None:
    """Write the table, the report and its pictures."""
    from softmodels.pictures import analyses, style

    html, figures = analyses.study_page(solved, seconds)
    files.write_text(folder / "study.csv", analyses.study_table(solved))
    files.write_text(folder / study.PAGE, html)
    if "parallel" in figures:
        files.write_bytes(folder / "parallel.png", style.png(figures["parallel"]))
