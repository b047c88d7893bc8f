"""``python -m softmodels.disk``: the hollow disk of the thesis, inflated."""

from geometries import HollowDisk
from softmodels.commandline import device_command, main

command = device_command(HollowDisk, "softmodels.disk", "disk", "0:177")

if __name__ == "__main__":
    main(command)
