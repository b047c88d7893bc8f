"""The table of devices by name, in which settings files and command lines look."""

from __future__ import annotations

from geometries.actuator import Actuator

ACTUATORS: dict[str, type[Actuator]] = {}
"""Every device by the name of its class."""


def register[Device: type[Actuator]](device: Device) -> Device:
    """Let settings files and command lines find a device by the name of its class; a class decorator.

    A class of the same module and name, as a notebook defines it anew, takes the place of the one before.

    Raises:
        ValueError: Another device has this name.
    """
    name = device.__name__
    known = ACTUATORS.get(name, device)
    if (known.__module__, known.__qualname__) != (device.__module__, device.__qualname__):
        raise ValueError(f"there is a device of the name {name!r} already, in {known.__module__}")
    ACTUATORS[name] = device
    return device
