"""The command line that every actuator shares, made from the fields of its geometry and of the laws."""

from __future__ import annotations

import contextlib
import dataclasses
import gc
import itertools
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NoReturn

import click

from geometries import Actuator
from measurement.ending import STOPPED, asked_to_stop, bounded, stoppable, written
from measurement.output_option import FolderType
from measurement.terminal import say
from softmodels.case.case import Case
from softmodels.case.errors import INPUT_ERRORS, CaseError
from softmodels.case.own_modules import OwnModuleError, import_own_modules
from softmodels.cli.case_options import CaseOptions, taken
from softmodels.cli.ranks import AUTO, RanksType, ranks_for, start_again
from softmodels.mechanics.mpi import StartError, speaks, start
from softmodels.results.outcomes import FAILED, no_memory

HELP = """Inflate {what} and write its whole load path.

Pressures are heights of a water column in cm, as on the bench: {pressures} goes from rest to the end in steps the solver
chooses; 0:177:10 also stops every 10 cm; 0,70,130,177 stops at each. Lengths, angles and stresses carry a unit (20mm,
45deg, 30kPa). Near a limit point, where a pressure has no equilibrium any more, the run follows the cavity's volume by
itself, finds the limit and says so.

\b
Examples:
  python -m {module} --pressure-cm {pressures}
  mpirun -n 2 python -m {module} --pressure-cm {pressures}
{examples}
  python -m {module} --pressure-cm {pressures} -- -snes_monitor -log_view

Words after -- go to PETSc; the factorisation of the tangent, or its multigrid, has the prefix body_.

\b
Exit status: 0 done; 1 failed; 2 bad input; 3 no equilibrium at a requested value (limit point); 130 stopped.
"""


@dataclasses.dataclass(frozen=True)
class RunOptions:
    """The options of how to run, as `run_options` adds them.

    Attributes:
        output: Folder for the results; None for the default.
        resume: Go on from an interrupted run.
        quiet: Report errors alone.
        pictures: How much is drawn: all, few or none.
        no_pictures: Draw nothing.
        branch: Follow the branch at the first bifurcation too.
        ranks: On how many processes; None for as many as pay.
        petsc: Words for PETSc.
    """

    output: Path | None
    resume: bool
    quiet: bool
    pictures: str
    no_pictures: bool
    branch: bool
    ranks: int | None
    petsc: tuple[str, ...]


def run_options[Command: Callable[..., object]](command: Command) -> Command:
    """Options of how to run, without the case: ``--output``, ``--resume``, ``--quiet``, ``--pictures``, ``--ranks``, PETSc."""
    command = click.argument("petsc", nargs=-1, type=click.UNPROCESSED)(command)
    command = click.option("--no-pictures", is_flag=True, help="The same as --pictures none.")(command)
    text = "Pictures, film and report; few: the curves, the stress and the report alone."
    command = click.option(
        "--pictures", type=click.Choice(("all", "few", "none")), default="all", show_default=True, help=text
    )(command)
    text = "Processes to solve on; auto: a core for each 30,000 unknowns of a solid, as far as there are cores."
    command = click.option("--ranks", type=RanksType(), default=AUTO, show_default=True, help=text)(command)
    text = "Follow the branch that leaves the path at its first bifurcation too, into the folder branch."
    command = click.option("--branch", is_flag=True, help=text)(command)
    command = click.option("--quiet", is_flag=True, help="Say nothing but errors.")(command)
    command = click.option("--resume", is_flag=True, help="Go on from where an interrupted run stopped.")(command)
    text = (
        "Folder for the results: empty, not there, or an earlier run's, whose files are replaced.  [default: results/NAME; "
        "results/NAME-2 and so on where that holds another case]"
    )
    return click.option("-o", "--output", type=FolderType(), help=text)(command)


def device_command(
    device: type[Actuator],
    module: str,
    examples: tuple[str, ...],
    pressures: str = "",
) -> click.Command:
    """The click command of one actuator.

    Args:
        device: Its class; where no material is given it is made of its `Actuator.silicone`.
        module: How it is started, such as ``softmodels.disk``.
        examples: Options of further examples in the help.
        pressures: The pressures shown in the help; the device's own if empty.
    """
    options = CaseOptions(device, device.silicone)
    pressures = pressures or device.pressures

    def command(**values: object) -> None:
        how = taken(RunOptions, values)
        execute(lambda: options.case(values), how)

    what = (device.__doc__ or "").strip().split("\n")[0].rstrip(".").lower()
    command.__doc__ = HELP.format(what=what, pressures=pressures, module=module,
                                  examples="\n".join(f"  python -m {module} {words}" for words in examples))  # fmt: skip
    made = options.add(run_options(command))
    return click.command(name=module, context_settings={"help_option_names": ["-h", "--help"]})(made)


def execute(case: Callable[[], Case], how: RunOptions, inputs: Sequence[Path] = ()) -> None:
    """Build a case, run it and exit with its status; see `softmodels.cli.run.run`.

    Args:
        case: Makes it.
        how: The options of the command.
        inputs: Files that the user has given: they are never written.
    """
    try:
        ready = case()
        _check_words(how.petsc)
        if how.branch:
            ready.load.check_branch()
    except INPUT_ERRORS as error:
        fail(str(error))
    with stoppable("softmodels", speaks):
        from softmodels.cli.run import run

    try:
        if (ranks := ranks_for(ready, how.ranks, how.quiet)) > 1:
            sys.exit(start_again(ranks))
        with stoppable("softmodels", speaks):
            start(how.petsc)
        status = run(
            ready, how.output, resume=how.resume, quiet=how.quiet, petsc=how.petsc,
            draw=how.pictures != "none" and not how.no_pictures, few=how.pictures == "few",
            branch=how.branch, inputs=inputs, interrupts=asked_to_stop,
        )  # fmt: skip
    except StartError as error:
        fail(str(error), error.status)
    except ImportError as error:
        fail(f"{error}; the simulation needs FEniCSx (softmodels doctor tells what is missing)", 1)
    sys.exit(status)


def _check_words(petsc: tuple[str, ...]) -> None:
    """Refuse arguments that PETSc would not refuse itself, or only with a page of its own."""
    for word in petsc[:1]:
        if not word.startswith("-"):
            raise CaseError(f"unexpected argument {word!r}; options start with --, and PETSc's follow after a lone --")
    for word, file in itertools.pairwise(petsc):
        if word == "-options_file" and not Path(file).is_file():
            raise CaseError(f"-options_file {file!r} is not a file")


def fail(message: str, status: int = 2) -> NoReturn:
    """Say one sentence, on one rank, and exit."""
    _tell(message)
    sys.exit(status)


def _tell(message: str) -> None:
    if speaks():
        with contextlib.suppress(OSError):  # nobody can be told
            say(f"softmodels: {bounded(message)}", err=True)


def _missing(error: click.MissingParameter) -> str:
    """What to type, where a command was given too little: the examples of its help."""
    context, said = error.ctx, error.format_message().rstrip(".")
    if context is None or context.command.help is None:
        return f"{said} (see --help)"
    lines = [" ".join(line.split()) for line in context.command.help.partition("Examples:")[2].splitlines()]
    examples = [line for line in lines if line.startswith("softmodels ")][:3]
    if not examples:
        return f"{said} (see {context.command_path} --help)"
    return f"{said}; for example: {' | '.join(examples)} (softmodels examples writes files to begin with; see --help)"


def main(command: click.Command) -> None:
    """Run a click command; usage errors are one sentence and exit status 2, on one rank."""
    if not speaks():
        sys.stdout = open(os.devnull, "w")  # noqa: PTH123, SIM115  (help too is said once, and the stream lives on)
    with written(_tell):
        try:
            import_own_modules()
            command.main(standalone_mode=False)
        except OwnModuleError as error:
            fail(str(error))
        except (click.exceptions.Abort, KeyboardInterrupt):
            fail("stopped by the user", STOPPED)
        except StartError as error:
            fail(str(error), error.status)
        except MemoryError as error:
            fail(no_memory(error), FAILED)
        except click.exceptions.NoArgsIsHelpError as error:
            print(error.format_message())
            sys.exit(2)
        except click.MissingParameter as error:
            fail(_missing(error))
        except click.ClickException as error:
            fail(f"{error.format_message()} (see --help)")
        finally:
            gc.unfreeze()  # for callers whose process goes on
