"""The command ``softmodels``, and its groups of commands."""

from __future__ import annotations

from softmodels.common import commands
from softmodels.mechanics import mpi

with commands.stoppable("softmodels", mpi.speaks):
    import click

    from softmodels.cli import ending

PLACES = {
    "Simulate": {
        "run": ("softmodels.cli.options", "Run a case FILE, or a device by its options."),
        "import": ("softmodels.cli.exports", "Write the case of an Abaqus or CalculiX deck FILE."),
        "limit": ("softmodels.cli.analyses", "Find the largest pressure a device can take."),
        "modes": ("softmodels.cli.analyses", "Find the natural frequencies and modes of a device."),
        "grasp": ("softmodels.cli.analyses", "Close equal fingers around an object, and load it."),
    },
    "Measure": {
        "measure": ("measurement.__main__", "Measure outlines and bends of devices in photographs."),
    },
    "Fit": {
        "fit": ("softmodels.cli.material_commands", "Fit laws to measurements, with 95 % intervals."),
        "curve": ("softmodels.cli.material_commands", "Show the curves of materials in standard tests."),
        "score": ("softmodels.cli.material_commands", "Score materials against measurements held out of a fit."),
        "silicones": ("softmodels.cli.material_commands", "List the named silicones with all their sources."),
    },
    "Design": {
        "design": ("softmodels.cli.design", "Find the device that best meets the objective in a FILE."),
        "study": ("softmodels.cli.design", "Solve a case many times with some of its fields varied."),
    },
    "Cast": {
        "draw-network": ("softmodels.cli.exports", "Write the network of a ChannelPlate as a drawing."),
        "mould": ("softmodels.cli.exports", "Make the mould of a device, and a sheet for the bench."),
    },
    "Look at results": {
        "open": ("softmodels.cli.results", "Open the report of the results in FOLDER in the browser."),
        "compare": ("softmodels.cli.results", "Compare results with those in the first of the FOLDERS."),
        "draw": ("softmodels.cli.results", "Redraw the pictures and the report of the results in FOLDER."),
        "line": ("softmodels.cli.results", "Take the values along a line through the body."),
        "export": ("softmodels.cli.exports", "Write the case FILE for CalculiX."),
        "reduce": ("softmodels.cli.exports", "Reduce results to the device's tip, for robot simulators."),
    },
    "Check and try": {
        "doctor": ("softmodels.cli.doctor", "Check the installation, and solve a small case."),
        "examples": ("softmodels.cli.examples", "Write small files to try every command with."),
        "demo": ("softmodels.cli.examples", "Run the whole workflow with a known silicone."),
        "app": ("softmodels.cli.doctor", "Open the bench as a page in the browser."),
        "completion": ("softmodels.cli.completion", "Print what a shell needs to complete commands."),
    },
}
"""Module and first sentence of each command, by group and name."""


@click.group(
    cls=commands.LazyGroup, program="softmodels", places=PLACES, speaks=mpi.speaks,
    context_settings={"help_option_names": ["-h", "--help"]},
)  # fmt: skip
@commands.version_option
def softmodels() -> None:
    """Simulate pneumatic soft actuators.

    \b
    Examples:
      softmodels run --device Membrane --pressure-cm 0:20
      softmodels run case.toml --set load.pressure='0:5 kPa'
      softmodels measure photos photos.csv --setup setup.toml -o outlines/
      softmodels fit case.toml outlines/
      python -m softmodels.disk --help

    Words may be completed with Tab: softmodels completion --help.
    """


def main() -> None:
    ending.main(softmodels)


if __name__ == "__main__":
    main()
