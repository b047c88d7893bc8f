"""The command line common to all actuators, generated from the fields of their geometry and of the laws; ``softmodels run``."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import itertools
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, MutableMapping, Sequence
from pathlib import Path
from types import FrameType
from typing import Any

import click

from geometries import ACTUATORS, Actuator, GeometryError, MeshFileError, MeshingError, MeshingStopped, meshing, registry
from softmodels.case import case, entries, materials
from softmodels.case.case import Case
from softmodels.case.entries import CaseError
from softmodels.cli import ending
from softmodels.common import commands, errors, processes, units
from softmodels.materials import silicones
from softmodels.materials.laws import LAWS
from softmodels.mechanics import mpi
from softmodels.mechanics.mpi import StartError
from softmodels.runs import outcomes

HELP = """Inflate {what} and write its whole load path.

Pressures are heights of a column in cm, as on the bench (0.97 g/ml, or --water-density): {pressures} goes from rest to the
end in steps chosen by the solver; 0:177:10 also stops every 10 cm; 0,70,130,177 stops at each. Lengths, angles and stresses
carry a unit (20mm, 45deg, 30kPa). Near a limit point, beyond which no equilibrium exists at that pressure, the run switches
to volume control, finds the limit and reports it.

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


def device_command(device: type[Actuator], module: str, examples: tuple[str, ...], pressures: str = "") -> click.Command:
    """Return the click command of one actuator; ``module`` is how it is started, such as ``softmodels.disk``, and examples and
    pressures are those of the help."""
    given = CaseOptions(device, device.silicone)

    @commands.version_option
    @commands.options(commands.RunOptions)
    def run_device(how: commands.RunOptions, **values: object) -> None:
        execute(lambda: given.case(values), how)

    what = (device.__doc__ or "").strip().split("\n")[0].rstrip(".").lower()
    text = HELP.format(what=what, pressures=pressures or device.pressures, module=module,
                       examples="\n".join(f"  python -m {module} {words}" for words in examples))  # fmt: skip
    return command(module, help=text, context_settings={"help_option_names": ["-h", "--help"]})(given.add(run_device))


def command_of(device: type[Actuator]) -> click.Command:
    """Return the command that runs a registered device."""
    words = tuple(f"--pressure-cm {device.pressures} {words}" for words in device.examples)
    return device_command(device, f"softmodels run {DEVICE} {device.__name__}", words)


SET: dict[str, Any] = {
    "multiple": True, "metavar": "FIELD=VALUE",
    "help": "Change a field of the case file, such as load.pressure='0:5 kPa' or geometry.membrane=2mm; may be repeated.",
}  # fmt: skip
set_option = click.option("--set", "changes", **SET)


def set_field() -> Any:
    """Return the field of ``--set``."""
    return commands.option("--set", **SET)


def case_of_file(
    file: Path,
    material: str | None,
    changes: Sequence[str],
    band: str | None = None,
    kind: type[Case] = Case,
    **fields: object,
) -> Case:
    """Return a case file's case, as the class given, with changed entries, the given material and band, and other fields of
    `Case` that are not None."""
    more: dict[str, Mapping[str, object]] = {}
    if material is not None:
        more["material"] = materials.to_table(materials.material_from(material, {}))
    if band is not None:
        product = silicones.product_of(band) if silicones.silicone_called(band) else ""
        more["band"] = {"silicone": product} if product else {"file": str(Path(band).absolute())}
    case = kind.from_file(file, more, changes)
    return dataclasses.replace(case, **{name: value for name, value in fields.items() if value is not None})  # type: ignore[arg-type]


def execute(case: Callable[[], Case], how: commands.RunOptions, inputs: Sequence[Path] = ()) -> None:
    """Build a case, run it and exit with its status; see `softmodels.cli.run.run`."""
    ready = case()
    _check_words(how.petsc)
    if how.branch:
        ready.load.check_branch()
    if how.film and not how.draws:
        raise CaseError("--film has no effect without pictures; leave out --no-pictures and --pictures none")
    try:
        with commands.stoppable("softmodels", mpi.speaks):
            from softmodels.cli import run

        if (ranks := ranks_for(ready, how.ranks, how.quiet)) > 1:
            sys.exit(start_again(ranks))
        drawing = run.DrawingProcess.of(ready, how)
        with commands.stoppable("softmodels", mpi.speaks):
            mpi.start(how.petsc)
        sys.exit(run.run(ready, how.output, how, inputs, rank_asked_to_stop, drawing))
    except ImportError as error:
        ending.fail(f"{error}; the simulation needs FEniCSx (softmodels doctor lists what is missing)", 1)


def _check_words(petsc: tuple[str, ...]) -> None:
    """Reject arguments that PETSc would accept silently, or reject with a page of text."""
    for word in petsc[:1]:
        if not word.startswith("-"):
            raise CaseError(f"unexpected argument {word!r}; options start with --, and PETSc's follow after a lone --")
    for word, file in itertools.pairwise(petsc):
        if word == "-options_file" and not Path(file).is_file():
            raise CaseError(f"-options_file {file!r} is not a file")


class Command(click.Command):
    """A command that ends with a sentence and a status where an error has a sentence for the user."""

    def invoke(self, ctx: click.Context) -> object:
        try:
            return super().invoke(ctx)
        except MemoryError as error:
            ending.fail(outcomes.no_memory(error), commands.EXIT_FAILED)
        except (StartError, materials.OwnModuleError) as error:
            ending.fail(str(error), getattr(error, "status", 2))
        except Exception as error:
            if not isinstance(error, errors.OptionMessage | units.UnitError):
                raise
            ending.fail(str(error), outcomes.Ended.by(error).status)


command = functools.partial(click.command, cls=Command)
"""As `click.command`."""


# ----------------------------------------------------------------------------------------------------------------------
# Command-line options of a case, generated from the entries of its fields.


type Values = MutableMapping[str, object]
"""Option values as click passes them, by name."""


def material_options[Command: Callable[..., object]](
    command: Command, default: str | None = None, several: bool = False
) -> Command:
    """Add ``--material``, perhaps several times, and an option for every parameter of every law to a click command;
    ``default`` is the silicone in the help, None for the default law."""
    for name, (text, laws) in reversed(materials.material_options_of().items()):
        of = "all laws" if len(laws) == len(LAWS) else ", ".join(laws)
        command = click.option(registry.flag(name), name, help=f"{text[0].upper()}{text[1:]} ({of}).")(command)
    text = (
        f"A law ({', '.join(LAWS)}), perhaps with its numbers (yeoh:c1=8kPa,c2=90Pa), a silicone "
        f"({', '.join(silicones.PRODUCTS)}; perhaps with its source, such as "
        "ecoflex-00-30/liao-2021: see softmodels silicones) or a TOML file with a [material] table.  "
        f"[default: {default or f'neo-hookean, shear modulus {units.exact_text(materials.DEFAULT.shear_modulus, "Pa")}'}]"
    )
    return click.option("--material", "material", metavar="NAME", multiple=several, help=text)(command)


def law_taken(values: Values) -> dict[str, object]:
    """Pop the material parameters from a command's values; None where not given."""
    return {name: values.pop(name) for name in materials.material_options_of()}


def case_option[Command: Callable[..., object]](option: entries.Option) -> Callable[[Command], Command]:
    """Return an option of a field of a case."""
    return registry.field_option(option.name, option.about, option.default, option.metavar)


@dataclasses.dataclass(frozen=True)
class CaseOptions:
    """The options that define a case of one device, and its silicone when none is given; None for the default law."""

    device: type[Actuator]
    silicone: str | None = None

    def add[Command: Callable[..., object]](self, command: Command) -> Command:
        """Add to a click command the options of the load, the device, its material and all other fields of a case."""
        groups = {name: list(entry.options()) for name, entry in case.entries().items()}
        first = groups.pop("steps")
        for option in reversed([option for group in groups.values() for option in group]):
            command = case_option(option)(command)
        command = registry.device_options(self.device)(material_options(command, self.silicone))
        for option in reversed(first):
            command = case_option(option)(command)
        return command

    def case(self, values: Values, kind: type[Case] = Case) -> Case:
        """Return the case defined by a command's values, as the class given; an error of
        `softmodels.case.entries.INPUT_ERRORS` for invalid ones."""
        law, named = law_taken(values), values.pop("material")
        assert named is None or isinstance(named, str)
        read = {name: entry.take(values) for name, entry in case.entries().items()}
        given = {name: value for name, value in read.items() if value is not entries.MISSING}
        return kind(
            name=self.device.stem,
            actuator=registry.device_told(self.device, values),
            material=materials.material_from(self.silicone if named is None else named, law),
            **given,
        )


# ----------------------------------------------------------------------------------------------------------------------
# Number of processes for a case, chosen by its size; the command starts them under MPI's launcher itself.
#
# A command that wants several ranks starts itself again under ``mpirun``. That runs in a separate session, because MPICH's
# launcher ends its processes on Ctrl-C before they can close their files; here the signal goes to the ranks, which end as a
# single process does.


UNKNOWNS_PER_RANK = 30_000
"""Unknowns per rank above which another rank pays off: on two cores, a path with 25,000 unknowns is as fast on one core while
the other draws; one with 88,000 takes two thirds of the time on two."""
PER_NODE = 3.2
"""Unknowns per node of a solid mesh: three displacements, and the pressure at its corners."""


def ranks_for(case: Case, wanted: int | None, quiet: bool = False) -> int:
    """Return the number of ranks for a case, unless a launcher has decided it: as wanted, or as many of the cores as have
    `UNKNOWNS_PER_RANK` unknowns or more. `StartError` if a launcher has started another number, or there is
    none to start them."""
    if (size := mpi.launched()) is not None:
        if wanted and size and wanted != size:
            raise StartError(f"--ranks {wanted} differs from the {size} ranks that mpirun has started; leave it out")
        return 1
    if wanted is None:
        paying = _unknowns(case, quiet) // UNKNOWNS_PER_RANK if processes.cores() > 1 and _launcher() else 1
        return max(1, min(processes.cores(), paying))
    if wanted > 1 and not _launcher():
        raise StartError(f"--ranks {wanted} needs mpirun, which was not found beside {sys.executable} or on the PATH", 1)
    return wanted


def _unknowns(case: Case, quiet: bool) -> int:
    """Estimate the number of unknowns of a case; 0 if it does not matter or an error is reported later.

    The mesh is made for that, and kept: the ranks find it in the cache.
    """
    device = case.actuator
    if device.dimension != 3:
        return 0
    if not quiet and not meshing.is_mesh_cached(device):
        processes.say(meshing.mesh_label(device), err=True)
    with tempfile.TemporaryDirectory() as folder, commands.asked_to_stop() as stopped:
        file = Path(folder) / "mesh.msh"
        try:
            device.write(file, stopped)
            return int(PER_NODE * _nodes(file))
        except MeshingStopped:
            raise StartError("stopped by the user during meshing; nothing was solved", commands.EXIT_STOPPED) from None
        except (GeometryError, MeshingError, MeshFileError, OSError):
            return 0  # occurs again in the run, which reports it


def _nodes(file: Path) -> int:
    with file.open("rb") as lines:
        for line in lines:
            if line.strip() == b"$Nodes":
                return int(next(lines).split()[1])
    return 0


def _launcher() -> str | None:
    """Return the launcher of the MPI in use: the wheel's is beside Python."""
    own = mpi.mpich_file("mpirun")
    beside = shutil.which("mpirun", path=str(Path(sys.executable).parent))
    return beside or (str(own) if own else None) or shutil.which("mpirun")


def start_again(ranks: int) -> int:
    """Run this command again on several ranks; return its exit status, or raise `StartError`."""
    environment = dict(os.environ)
    for stream, variable in processes.COLUMNS.items():  # the ranks see pipes of the launcher's
        if (width := processes.columns(stream)) is not None:
            environment[variable] = str(width)
    try:
        process = subprocess.Popen(
            [str(_launcher()), "-n", str(ranks), sys.executable, *sys.orig_argv[1:]],
            env=environment,
            start_new_session=True,
            preexec_fn=processes.end_with_parent,
        )
    except OSError as error:
        raise StartError(f"mpirun cannot be started ({error.strerror or error}); use --ranks 1", 1) from None

    def forward(number: int, frame: FrameType | None) -> None:
        ranks = processes.children(processes.children([process.pid]))  # of the launcher's proxies
        for receiver in ranks or [process.pid]:  # or of the launcher, which has started none yet
            with contextlib.suppress(OSError):
                os.kill(receiver, number)

    before = {number: signal.signal(number, forward) for number in commands.STOP_SIGNALS}
    try:
        returned = process.wait()
        return 128 - returned if returned < 0 else returned
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def rank_asked_to_stop() -> contextlib.AbstractContextManager[Callable[[], bool]]:
    """As `asked_to_stop`, in a process that may be one of several ranks, which wait for each other."""
    return commands.asked_to_stop(mpi.launched() not in (None, 1), mpi.speaks())


# ----------------------------------------------------------------------------------------------------------------------
# ``--device NAME``: replace a command by that of a registered device, with the device's options.


DEVICE = "--device"


def device_named(name: str) -> type[Actuator]:
    """Return a registered device by name, in small or large letters; `click.UsageError` if there is none."""
    known = _known_device(name)
    if known is None:
        raise click.UsageError(f"{DEVICE} is {name!r}; it must be one of {', '.join(ACTUATORS)}{errors.meant(name, ACTUATORS)}")
    return ACTUATORS[known]


def _known_device(name: str) -> str | None:
    """Return a device's name from one in small or large letters; None if there is none."""
    return next((known for known in ACTUATORS if known.lower() == name.lower()), None)


def by_device(made_for: Callable[[type[Actuator]], click.Command], text: str) -> type[click.Command]:
    """Return a class of commands with an option ``--device NAME``, whose help has the names for ``{}``; with it a command
    delegates to ``made_for(device)``."""

    def option(text: str) -> click.Option:
        return click.Option(
            [DEVICE], metavar="NAME", expose_value=False, help=text.format(", ".join(ACTUATORS)),
            shell_complete=lambda ctx, param, begun: [
                name for name in ACTUATORS if name.lower().startswith(begun.lower())
            ],
        )  # fmt: skip

    class ByDevice(Command):
        def __init__(self, *args: Any, **given: Any):
            super().__init__(*args, **given)
            self.params.insert(0, option(text))

        def make_context(
            self, info_name: str | None, args: list[str], parent: click.Context | None = None, **extra: object
        ) -> click.Context:
            name = _named(args)
            if name is None or (extra.get("resilient_parsing") and not _known_device(name)):
                return self._of_file(info_name, args, parent, **extra)
            made = made_for(device_named(name))
            made.params.insert(0, option("The device: {}."))
            return made.make_context(info_name, args, parent, **extra)  # type: ignore[arg-type]

        def device_params(self) -> list[click.Parameter]:
            """Return the parameters of all devices."""
            return [param for kind in ACTUATORS.values() for param in made_for(kind).params]

        def _of_file(
            self, info_name: str | None, args: list[str], parent: click.Context | None = None, **extra: object
        ) -> click.Context:
            try:
                return super().make_context(info_name, args, parent, **extra)  # type: ignore[arg-type]
            except click.NoSuchOption as error:
                given = error.option_name
                if not any(given in param.opts for param in self.device_params()):
                    raise
                raise click.UsageError(
                    f"{given} goes with {DEVICE} NAME; what a case FILE requests and consists of stands in the file", error.ctx
                ) from None

    return ByDevice


def _named(args: list[str]) -> str | None:
    """Return the device named in a command's arguments, or None; arguments after -- are PETSc's."""
    words = args[: args.index("--")] if "--" in args else args
    for place, word in enumerate(words, 1):
        if word == DEVICE:
            return "".join(words[place : place + 1])
        if word.startswith(f"{DEVICE}="):
            return word.removeprefix(f"{DEVICE}=")
    return None


@command("run", cls=by_device(command_of, "A device with its own options, instead of a FILE: {}. softmodels run --device "
                              "NAME --help shows them."))  # fmt: skip
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--material", metavar="NAME", help="Material, instead of the case's [material]: a silicone, "
              "a law with its numbers (yeoh:c1=8kPa,c2=90Pa), or a TOML file such as fitted.toml.")  # fmt: skip
@click.option("--band", metavar="FILE|NAME", help="fitted.toml of a fitted material, instead of the case's [band]: "
              "adds the 95 % band from its errors to path.csv and the curves. Or a silicone's name: each of its sources "
              "is solved, and the curves show the band they span.")  # fmt: skip
@case_option(next(case.entries()["solver"].options()))
@case_option(next(case.entries()["mesh_error"].options()))
@case_option(next(case.entries()["accuracy"].options()))
@set_option
@commands.options(commands.RunOptions)
def run(
    file: Path,
    how: commands.RunOptions,
    material: str | None,
    band: str | None,
    changes: tuple[str, ...],
    **asked: object,
) -> None:
    """Run a case FILE, or a device by its options.

    A case FILE is, for example, the case.toml in a folder of results. Results are written to --output, by default results/NAME
    with the case's name. Words after -- go to PETSc.

    \b
    Examples:
      softmodels run results/disk/case.toml
      softmodels run results/disk/case.toml --set load.pressure='0:5 kPa' --set geometry.membrane=2mm
      softmodels run lifted.toml --material results/fit/fitted.toml --band results/fit/fitted.toml
      softmodels run --device HollowDisk --pressure-cm 0:177 --section axisymmetric
      softmodels run --device HollowDisk --help
    """
    execute(lambda: case_of_file(file, material, changes, band, Case, **asked), how, [file])
