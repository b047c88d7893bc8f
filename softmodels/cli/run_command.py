"""``softmodels run``: a case file, or any registered device with options of its own."""

from __future__ import annotations

from pathlib import Path

import click

from geometries import ACTUATORS
from softmodels.case.case import Case
from softmodels.cli.case_options import taken
from softmodels.cli.options import RunOptions, device_command, execute, run_options

DEVICE = "--device"
HELP_OPTIONS = {"help_option_names": ["-h", "--help"]}


class RunCommand(click.Command):
    """The command of case files; with ``--device NAME`` it becomes that device's, which has other options."""

    def make_context(
        self, info_name: str | None, args: list[str], parent: click.Context | None = None, **extra: object
    ) -> click.Context:
        name = _named(args)
        if name is None:
            return super().make_context(info_name, args, parent, **extra)  # type: ignore[arg-type]
        return command_of(name).make_context(info_name, args, parent, **extra)  # type: ignore[arg-type]


def command_of(name: str) -> click.Command:
    """The command that runs a registered device.

    Args:
        name: Of its class, in small or large letters.

    Raises:
        click.UsageError: There is no such device.
    """
    name = next((known for known in ACTUATORS if known.lower() == name.lower()), name)
    if name not in ACTUATORS:
        raise click.UsageError(f"{DEVICE} is {name!r}; it must be one of {', '.join(ACTUATORS)}")
    device = ACTUATORS[name]
    words = tuple(f"--pressure-cm {device.pressures} {options}" for options in device.examples)
    made = device_command(device, f"softmodels run {DEVICE} {name}", words)
    option = click.Option([DEVICE], metavar="NAME", expose_value=False, help=f"The device: {', '.join(ACTUATORS)}.")
    made.params.insert(0, option)
    return made


def _named(args: list[str]) -> str | None:
    """The device that a command's words name, None if they name none; words after -- are PETSc's."""
    words = args[: args.index("--")] if "--" in args else args
    for place, word in enumerate(words, 1):
        if word == DEVICE:
            return "".join(words[place : place + 1])
        if word.startswith(f"{DEVICE}="):
            return word.removeprefix(f"{DEVICE}=")
    return None


@click.command("run", cls=RunCommand, context_settings=HELP_OPTIONS)
@click.argument("file", type=click.Path(path_type=Path))
@click.option(
    DEVICE, metavar="NAME", expose_value=False, help="A device, with options of its own, in place of a FILE: "
    f"{', '.join(ACTUATORS)}. softmodels run {DEVICE} NAME --help shows them.",
)  # fmt: skip
@run_options
def run(file: Path, **values: object) -> None:
    """Run a case FILE, such as the case.toml in a folder of results, or a device by its options.

    The results go where --output says, or to results/NAME with the case's name. Words after -- go to PETSc.

    \b
    Examples:
      softmodels run results/disk/case.toml
      softmodels run --device HollowDisk --pressure-cm 0:177 --section axisymmetric
      softmodels run --device HollowDisk --help
    """
    execute(lambda: Case.from_file(file), taken(RunOptions, values), [file])
