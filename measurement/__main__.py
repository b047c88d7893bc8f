"""``python -m measurement``: measure outlines in metres from photographs of a shadow."""

from __future__ import annotations

import click

from softmodels.common import commands

PLACES = {
    "measurement.cli.setup": {
        "calibrate": "Calibrate the camera from PHOTOGRAPHS of a flat chessboard.",
        "setup": "Find the screen's plane in a PHOTOGRAPH of its grid, of a board, or of known points.",
    },
    "measurement.cli.photos": {
        "photos": "Measure the shadow's outline in every photograph of a list.",
        "demo": "Make a set of synthetic photographs, and measure them.",
    },
}
"""The first sentence of each command's help, by its module and its name, in the order of their use."""


@click.group(
    cls=commands.LazyGroup, program="measurement", places=PLACES, order=list,
    context_settings={"help_option_names": ["-h", "--help"]},
)  # fmt: skip
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
    commands.run_command(main, "python -m measurement")
