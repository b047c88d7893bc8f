"""``softmodels study``: solve a case many times with some of its fields varied."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import click

from softmodels.cli.options import fail
from softmodels.common.commands import STOPPED, FolderType, status_of
from softmodels.common.errors import MissingPackageError, reason
from softmodels.common.files import write_bytes, write_text
from softmodels.common.processes import say
from softmodels.design.study import DATASET, PAGE, Study, StudyError, StudyFolder, StudyPlan, open_folder, solve_into
from softmodels.mechanics.mpi import launched
from softmodels.runs.outcomes import DONE, FAILED


@click.command("study")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("-o", "--output", type=FolderType(), help="Folder for the results.  [default: results/NAME; results/NAME-2 "
              "and so on if that holds another study]")  # fmt: skip
@click.option("--resume", is_flag=True, help="Resume an interrupted study; no sample is solved again.")
@click.option("--jobs", type=click.IntRange(1, 256), help="Samples solved at a time.  [default: the number of cores]")
@click.option("--scheduler", default="", metavar="ADDRESS", help="Solve on the workers of a dask scheduler, such as "
              "tcp://10.0.0.1:8786.")  # fmt: skip
@click.option("--no-pictures", is_flag=True, help="Skip the pictures and the report.")
@click.option("--quiet", is_flag=True, help="Print only errors.")
def study_command(
    file: Path, output: Path | None, resume: bool, jobs: int | None, scheduler: str, no_pictures: bool, quiet: bool
) -> None:
    """Solve the case of a study FILE many times with some of its fields varied.

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
    if (launched() or 1) > 1:
        fail("a study shares its samples among its own processes (--jobs, --scheduler); start it without mpirun")
    try:
        plan = StudyPlan.from_file(file)
        kept = open_folder(plan, output, resume, [file])
    except StudyError as error:
        fail(str(error))
    try:
        found = _solved(kept, plan, jobs or 0, scheduler, quiet)
        assert kept.own is not None
        folder = kept.own.path
        try:
            found.save(folder / DATASET)
            if not no_pictures:
                _draw(found, folder, time.monotonic() - begun)
        except OSError as error:
            fail(f"the results cannot be written into {folder} ({reason(error)})", status_of(error))
        except MissingPackageError as error:
            fail(str(error))
    finally:
        kept.leave()
    if not quiet:
        for name, text in found._figures():
            say(f"{name}: {text}")
        for k, text in list(found.failures.items())[:5]:
            say(f"sample {k} has no result: {text}")
        say(f"{folder}: {DATASET} has all results" + ("" if no_pictures else f", {PAGE} the pictures"))
    sys.exit(DONE)


def _solved(kept: StudyFolder, plan: StudyPlan, jobs: int, scheduler: str, quiet: bool) -> Study:
    """Solve the study; exit with a sentence if that fails."""
    before = len(kept.answers)
    if not quiet:
        assert kept.own is not None
        say(f"writing results to {kept.own.path}" + (f"; {before} samples are there" if before else ""), err=True)
    started = time.monotonic()

    def progress(text: str) -> None:
        done = len(kept.answers) - before
        left = (len(plan.points) - len(kept.answers)) * (time.monotonic() - started) / max(done, 1)
        say(f"{text}, about {left:.0f} s left", err=True)

    try:
        return solve_into(kept, plan, jobs, scheduler, None if quiet else progress)
    except (StudyError, MissingPackageError) as error:
        fail(str(error))
    except OSError as error:
        fail(f"a sample cannot be written ({reason(error)}); continue with --resume", FAILED)
    except KeyboardInterrupt:
        fail("stopped by the user; continue with --resume", STOPPED)


def _draw(found: Study, folder: Path, seconds: float) -> None:
    """Write the table, the report and its pictures."""
    from softmodels.pictures.study import page, table
    from softmodels.pictures.style import png

    html, figures = page(found, seconds)
    write_text(folder / "study.csv", table(found))
    write_text(folder / PAGE, html)
    for name, figure in figures.items():
        if name == "parallel":
            write_bytes(folder / f"{name}.png", png(figure))
