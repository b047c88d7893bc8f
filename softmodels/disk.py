"""``python -m softmodels.disk``: the hollow disk of the thesis, inflated."""

from softmodels.common import commands
from softmodels.mechanics import mpi

with commands.stoppable("softmodels", mpi.speaks):
    from geometries import HollowDisk
    from softmodels.cli import ending, options


command = options.device_command(
    HollowDisk,
    "softmodels.disk",
    examples=(
        "--pressure-cm 0:177:10 --section axisymmetric",
        "--pressure-cm 0:20 --variant shadow --material ecoflex-00-30",
        "--volume-ml 0:40 --variant shadow --material yeoh --c1 8kPa --c2 90Pa",
    ),
)


if __name__ == "__main__":
    ending.main(command)
