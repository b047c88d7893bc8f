"""``python -m measurement``: measure outlines in metres from photographs of a shadow."""

from __future__ import annotations

import importlib
from typing import Any

from softmodels.common.commands import stoppable

with stoppable("measurement"):
    import click

    from softmodels.common.commands import CommandGroup, run_command

COMMANDS = {
    "calibrate": "measurement.cli.setup",
    "setup": "measurement.cli.setup",
    "photos": "measurement.cli.photos",
    "demo": "measurement.cli.photos",
}
"""Commands in the order of their use, and the modules that hold them: imported when asked for, so that help is quick."""


class Lazy(CommandGroup):
    """A group whose commands are imported on use."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        module = COMMANDS.get(cmd_name)
        with stoppable("measurement"):
            found: Any = getattr(importlib.import_module(module), cmd_name, None) if module else None
        return found if isinstance(found, click.Command) else None


@click.group(cls=Lazy, context_settings={"help_option_names": ["-h", "--help"]})
def main() -> None:
    """Measure shadow photographs of soft actuators.

    Lengths and pressures are written with their unit, such as 9mm or 20kPa. Exit status: 0 done, 1 nothing could be
    measured, 2 the input cannot be used, 3 some photographs were refused, 130 stopped.

    \b
    Examples:
      python -m measurement calibrate boards/*.jpg --pattern 9x6 --pitch 25mm -o camera.toml
      python -m measurement setup grid.jpg --grid-pitch 9mm --lens camera.toml -o setup.toml
      python -m measurement photos photos.csv --setup setup.toml -o outlines/
    """


if __name__ == "__main__":
    run_command(main, "python -m measurement")
