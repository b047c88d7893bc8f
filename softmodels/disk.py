"""``python -m softmodels.disk``: the hollow disk of the thesis, inflated."""

from softmodels.common.commands import stoppable
from softmodels.mechanics.mpi import speaks

with stoppable("softmodels", speaks):
    from geometries import HollowDisk
    from softmodels.cli.options import device_command, main

command = device_command(
    HollowDisk,
    "softmodels.disk",
    examples=(
        "--pressure-cm 0:177:10 --section axisymmetric",
        "--pressure-cm 0:20 --variant shadow --material ecoflex-00-30",
        "--volume-ml 0:40 --variant shadow --material yeoh --c1 8kPa --c2 90Pa",
    ),
)

if __name__ == "__main__":
    main(command)
