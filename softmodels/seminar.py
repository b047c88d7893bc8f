"""``python -m softmodels.seminar``: the slab with air channels of the thesis' second half, inflated."""

from softmodels.common import commands
from softmodels.mechanics import mpi

with commands.stoppable("softmodels", mpi.speaks):
    from geometries import SeminarActuator
    from softmodels.cli import ending, options


command = options.device_command(
    SeminarActuator,
    "softmodels.seminar",
    examples=(
        "--pressure-cm 0,70,130,177 --thickness 9mm",
        "--pressure-cm 0:100 --channels 7 --spread 120deg --material dragon-skin-10-medium",
        "--pressure-cm 0:177 --tip held",
    ),
)


if __name__ == "__main__":
    ending.main(command)
