"""How the commands of ``python -m measurement`` and ``python -m geometries`` are started."""

from __future__ import annotations

import io
import sys

import click

from measurement.ending import FAILED, STOPPED, bounded, written
from measurement.terminal import say
from measurement.wording import meant


class CommandGroup(click.Group):
    """A group that answers a misspelt command with the one that may have been meant."""

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        name, known = args[0], self.list_commands(ctx)
        if not name.startswith("-") and self.get_command(ctx, name) is None:
            near = meant(name, known) or f"; there are {', '.join(known)}"
            raise click.UsageError(f"there is no command {name!r}{near}", ctx)
        return super().resolve_command(ctx, args)


def run_command(command: click.Command, name: str) -> None:
    """Run a click command and exit: usage errors have status 2, Ctrl-C `STOPPED`, output that has nowhere to go 1.

    Args:
        command: The command.
        name: How it is started, for its help.
    """

    def tell(sentence: str) -> None:
        say(f"Error: {bounded(sentence)}", err=True)

    with written(tell):
        try:
            sys.exit(command.main(prog_name=name, standalone_mode=False))
        except click.ClickException as error:
            shown = io.StringIO()
            error.show(shown)
            click.echo(bounded(shown.getvalue()), err=True, nl=False)
            sys.exit(error.exit_code)
        except (click.exceptions.Abort, KeyboardInterrupt):
            tell("stopped by the user")
            sys.exit(STOPPED)
        except MemoryError:
            tell(
                "the machine's memory is full; close other programs, or ask for less (a smaller photograph, larger cells, "
                "fewer --jobs)"
            )
            sys.exit(FAILED)
