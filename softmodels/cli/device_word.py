"""``--device NAME``: a command that becomes that of a registered device, with options of its own."""

from __future__ import annotations

from collections.abc import Callable

import click

from geometries import ACTUATORS, Actuator
from measurement.wording import meant

DEVICE = "--device"


def device_named(name: str) -> type[Actuator]:
    """A registered device.

    Args:
        name: Of its class, in small or large letters.

    Raises:
        click.UsageError: There is no such device.
    """
    name = next((known for known in ACTUATORS if known.lower() == name.lower()), name)
    if name not in ACTUATORS:
        raise click.UsageError(
            f"{DEVICE} is {name!r}; it must be one of {', '.join(ACTUATORS)}{meant(name, ACTUATORS)}"
        )
    return ACTUATORS[name]


def by_device(made_for: Callable[[type[Actuator]], click.Command]) -> type[click.Command]:
    """A class of commands; one whose words hold ``--device NAME`` becomes what ``made_for`` makes for that device."""

    class ByDevice(click.Command):
        def make_context(
            self, info_name: str | None, args: list[str], parent: click.Context | None = None, **extra: object
        ) -> click.Context:
            name = _named(args)
            if name is None:
                return super().make_context(info_name, args, parent, **extra)  # type: ignore[arg-type]
            made = made_for(device_named(name))
            word = click.Option(
                [DEVICE], metavar="NAME", expose_value=False, help=f"The device: {', '.join(ACTUATORS)}."
            )
            made.params.insert(0, word)
            return made.make_context(info_name, args, parent, **extra)  # type: ignore[arg-type]

    return ByDevice


def _named(args: list[str]) -> str | None:
    """The device that a command's words name, None if they name none; words after -- are PETSc's."""
    words = args[: args.index("--")] if "--" in args else args
    for place, word in enumerate(words, 1):
        if word == DEVICE:
            return "".join(words[place : place + 1])
        if word.startswith(f"{DEVICE}="):
            return word.removeprefix(f"{DEVICE}=")
    return None
