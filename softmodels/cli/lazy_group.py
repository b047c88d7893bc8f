"""A group of commands that are imported when they are called: help, and each command, need not wait for all others."""

from __future__ import annotations

import dataclasses
import importlib
from collections.abc import Callable, Mapping
from typing import Any

import click

from measurement.ending import stoppable
from measurement.running import CommandGroup

FOREIGN = (".step", ".stp", ".msh", ".inp", ".stl")
"""Endings of drawings and meshes."""


@dataclasses.dataclass(frozen=True)
class Place:
    """Where a command is.

    Attributes:
        module: Its module.
        name: The command's name in there.
        text: The first sentence of its help.
    """

    module: str
    name: str
    text: str


class LazyGroup(CommandGroup):
    """A group whose commands are named by `Place`.

    Args:
        places: By the commands' names.
        speaks: Whether this process may print, where it is stopped while a command is imported.
        given: What click's own group takes.
    """

    def __init__(self, *, places: Mapping[str, Place], speaks: Callable[[], bool], **given: Any):
        super().__init__(**given)
        self.places, self.speaks = places, speaks

    def list_commands(self, ctx: click.Context) -> list[str]:
        return sorted({*self.commands, *self.places})

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in self.commands and cmd_name in self.places:
            place = self.places[cmd_name]
            with stoppable("softmodels", self.speaks):
                self.add_command(getattr(importlib.import_module(place.module), place.name), cmd_name)
        return super().get_command(ctx, cmd_name)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        if args[0].lower().endswith((".toml", *FOREIGN)) and "run" in self.list_commands(ctx):
            raise click.UsageError(f"{args[0]!r} is no command; did you mean softmodels run {args[0]}?", ctx)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The list of commands in the group's help, without importing them."""
        names = self.list_commands(ctx)
        limit = formatter.width - 6 - max(map(len, names))
        texts = {name: place.text for name, place in self.places.items()}
        rows = [(name, click.Command(None, help=texts[name]).get_short_help_str(limit)) if name in texts
                else (name, self.commands[name].get_short_help_str(limit)) for name in names]  # fmt: skip
        with formatter.section("Commands"):
            formatter.write_dl(rows)
