"""``softmodels measure`` and ``python -m measurement``: measure outlines and bending from photographs."""

from __future__ import annotations

import click

from softmodels.common import commands

PLACES = {
    "Commands": {
        "calibrate": ("measurement.cli.setup", "Calibrate the camera from PHOTOGRAPHS of a flat chessboard."),
        "setup": ("measurement.cli.setup", "Find the screen's plane in a PHOTOGRAPH."),
        "photos": ("measurement.cli.photos", "Measure the shadow's outline in every photograph of a list."),
        "view": ("measurement.cli.views", "Measure how a device bends, in listed photographs or a film."),
        "join": ("measurement.cli.space", "Join two views of a device in space."),
        "demo": ("measurement.cli.photos", "Make a set of synthetic photographs, and measure them."),
    }
}
"""Module and first sentence of each command, by group and name, in the order of their use."""


@click.group(
    "measure", cls=commands.LazyGroup, program="softmodels", places=PLACES,
    context_settings={"help_option_names": ["-h", "--help"]},
)  # fmt: skip
@commands.version_option
def main() -> None:
    """Measure outlines and bends of devices in photographs.

    Lengths and pressures are written with their unit, such as 9mm or 20kPa. Exit status: 0 done, 1 nothing could be
    measured, 2 the input cannot be used, 3 some photographs were refused, 130 stopped.

    \b
    Examples:
      softmodels measure calibrate boards/*.jpg --pattern 9x6 --pitch 25mm -o camera.toml
      softmodels measure setup grid.jpg --grid-pitch 9mm --lens camera.toml -o setup.toml
      softmodels measure photos photos.csv --setup setup.toml -o outlines/
    """


if __name__ == "__main__":
    commands.run_command(main, "python -m measurement")
