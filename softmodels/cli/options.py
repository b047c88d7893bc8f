"""The command line that every actuator shares, made from the fields of its geometry and of the laws."""

from __future__ import annotations

import contextlib
import itertools
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import click

from geometries import Actuator, GeometryError
from geometries.options import QuantityType, device_options, device_told
from measurement.ending import STOPPED, asked_to_stop, bounded, stoppable, written
from measurement.output_option import FolderType
from measurement.units import WATER_DENSITY
from softmodels.case.case import CONTROLS, FORMULATIONS, Case, CaseError, sheet_from
from softmodels.case.material_table import material_from, material_names, material_options
from softmodels.case.own_modules import OwnModuleError, import_own_modules
from softmodels.case.ranges import SeriesError, series
from softmodels.case.supply_table import supply_from, supply_options
from softmodels.materials.laws import MaterialError
from softmodels.mechanics.contact import STIFFNESS, Obstacle, ObstacleError
from softmodels.mechanics.mpi import StartError, speaks, start
from softmodels.path.syringe import SupplyError
from softmodels.results.outcomes import FAILED, NO_MEMORY

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

Words after -- go to PETSc; the factorisation of the tangent has the prefix body_.

\b
Exit status: 0 done; 1 failed; 2 bad input; 3 no equilibrium at a requested value (limit point); 130 stopped.
"""


def run_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Options of how to run, without the case: ``--output``, ``--resume``, ``--quiet``, ``--no-pictures``, PETSc's words."""
    command = click.argument("petsc", nargs=-1, type=click.UNPROCESSED)(command)
    command = click.option("--no-pictures", is_flag=True, help="Leave pictures, film and report out.")(command)
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
    pressures: str,
    examples: tuple[str, ...],
    default: str | None = None,
) -> click.Command:
    """The click command of one actuator.

    Args:
        device: Its class.
        module: How it is started, such as ``softmodels.disk``.
        pressures: The pressures shown in the help.
        examples: Options of further examples in the help.
        default: The silicone when none is given; None for the default law.
    """
    name = device.stem

    def command(pressure_cm: str | None, volume_ml: str | None, water_density: float, control: str, formulation: str,
                sheet: str | None, sheet_stiffness: str | None, contact: str | None, contact_plane: str | None,
                contact_stiffness: float | None,
                output: Path | None, resume: bool, quiet: bool, no_pictures: bool, branch: bool, petsc: tuple[str, ...],
                **values: Any) -> None:  # fmt: skip
        def case() -> Case:
            law = {key: values.pop(key) for key in material_names()}
            supply, stroke_ml, cycle = supply_from(values), values.pop("stroke_ml"), values.pop("cycle")
            named = values.pop("material")
            material = material_from(default if named is None else named, law)
            return Case(
                name=name, actuator=device_told(device, values), material=material,
                pressures_cm=series(pressure_cm, "pressure") if pressure_cm is not None else (),
                volumes_ml=series(volume_ml, "volume") if volume_ml is not None else (),
                water_density=water_density, control=control, formulation=formulation,
                sheet=sheet_from(sheet, sheet_stiffness) if (sheet, sheet_stiffness) != (None, None) else None,
                strokes_ml=series(stroke_ml, "stroke") if stroke_ml is not None else (), supply=supply,
                cycle=cycle,
                obstacle=obstacle_from(contact, contact_plane, contact_stiffness),
            )  # fmt: skip

        execute(case, output, resume, quiet, no_pictures, petsc, branch)

    what = (device.__doc__ or "").strip().split("\n")[0].rstrip(".").lower()
    command.__doc__ = HELP.format(what=what, pressures=pressures, module=module,
                                  examples="\n".join(f"  python -m {module} {options}" for options in examples))  # fmt: skip
    made: Callable[..., Any] = run_options(command)
    made = click.option("--formulation", type=click.Choice(FORMULATIONS), default="mixed", show_default=True,
                        help="Displacement and pressure, or displacement alone (compressible studies).")(made)  # fmt: skip
    made = click.option("--control", type=click.Choice(CONTROLS), default="auto", show_default=True,
                        help="What the path follows.")(made)  # fmt: skip
    made = click.option("--contact-stiffness", type=QuantityType(""), help="Shear moduli of contact pressure per "
                        f"sinking in by one size of the device.  [default: {STIFFNESS:g}]")(made)  # fmt: skip
    made = click.option("--contact-plane", metavar="PLANE", help="The rigid plane: 'z = 9mm', 'normal 0.6, 0, 0.8 at 9 mm'"
                        ", or a cut plane's name for walls that meet their mirror image.")(made)  # fmt: skip
    made = click.option("--contact", metavar="FACES", help="Faces that a rigid plane without friction stops, such as top; its "
                        "force is in path.csv.")(made)  # fmt: skip
    made = click.option("--sheet-stiffness", metavar="STIFFNESS",
                        help="Young's modulus times thickness of the sheet, such as 50kN/m: on silicone that hardly "
                        "stretches.")(made)  # fmt: skip
    made = click.option("--sheet", metavar="FACE",
                        help=f"Bond a thin sheet to a face of the device: {', '.join(device.faces)}.")(made)  # fmt: skip
    text = f"Density of the column's liquid.  [default: {WATER_DENSITY:g}kg/m^3, as measured in the thesis]"
    made = click.option("--water-density", type=QuantityType("kg/m^3"), default=WATER_DENSITY, help=text)(made)
    text = (
        "Lower the pressure again through the same values; at limit points the device jumps, as under a water column."
    )
    made = click.option("--cycle", is_flag=True, help=text)(made)
    made = supply_options(made)
    made = material_options(made, default)
    made = device_options(device)(made)
    made = click.option(
        "--volume-ml", metavar="SERIES", help="Added volumes of the cavity in ml, in place of pressures."
    )(made)
    made = click.option(
        "--pressure-cm", metavar="SERIES", help="Pressures in cm of water: 0:177, 0:177:10 or 0,70,130,177."
    )(made)
    return click.command(name=module, context_settings={"help_option_names": ["-h", "--help"]})(made)


def obstacle_from(faces: str | None, plane: str | None, stiffness: float | None) -> Obstacle | None:
    """The obstacle of a command's options; None if none is given.

    Raises:
        ObstacleError: One of them without the others.
    """
    if faces is None and plane is None and stiffness is None:
        return None
    return Obstacle(faces or "", plane or "", STIFFNESS if stiffness is None else stiffness)


def execute(
    case: Callable[[], Case],
    output: Path | None,
    resume: bool,
    quiet: bool,
    no_pictures: bool,
    petsc: tuple[str, ...],
    branch: bool = False,
    inputs: Sequence[Path] = (),
) -> None:
    """Build a case, run it and exit with its status; see `softmodels.cli.run.run`."""
    try:
        ready = case()
        _check_words(petsc)
        if branch and ready.program:
            raise CaseError("--branch does not follow a series for each cavity; leave one of them out")
        if branch and ready.cycle:
            raise CaseError(
                "--branch leaves the path where it bifurcates and --cycle jumps there; leave one of them out"
            )
    except (CaseError, GeometryError, MaterialError, ObstacleError, SeriesError, SupplyError) as error:
        fail(str(error))
    with stoppable("softmodels", speaks):
        from softmodels.cli.run import run

    try:
        with stoppable("softmodels", speaks):
            start(petsc)
        status = run(
            ready, output, resume=resume, quiet=quiet, petsc=petsc, draw=not no_pictures, branch=branch, inputs=inputs,
            interrupts=asked_to_stop,
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


def fail(message: str, status: int = 2) -> None:
    """Say one sentence, on one rank, and exit."""
    _tell(message)
    sys.exit(status)


def _tell(message: str) -> None:
    if speaks():
        with contextlib.suppress(OSError):  # nobody can be told
            print(f"softmodels: {bounded(message)}", file=sys.stderr)


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
        except MemoryError:
            fail(NO_MEMORY, FAILED)
        except click.exceptions.NoArgsIsHelpError as error:
            print(error.format_message())
            sys.exit(2)
        except click.ClickException as error:
            fail(f"{error.format_message()} (see --help)")
