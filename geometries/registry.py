"""The table of devices by name, in which settings files and command lines look."""

from __future__ import annotations

import dataclasses
import functools
import importlib
import inspect
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from measurement.arguments import checked

if TYPE_CHECKING:
    from geometries.actuator import Actuator

PLACES = {
    "Balloon": "geometries.balloon",
    "Beam": "geometries.beam",
    "Bellows": "geometries.bellows",
    "BendingBellows": "geometries.bending_bellows",
    "Cylinder": "geometries.cylinder",
    "HollowDisk": "geometries.disk",
    "ImportedActuator": "geometries.imported",
    "ImportedMesh": "geometries.imported_mesh",
    "Membrane": "geometries.membrane",
    "PneuNet": "geometries.pneunet",
    "SeminarActuator": "geometries.seminar",
}
"""The modules of the library's own devices, which register them when they are loaded."""


class Devices(Mapping[str, "type[Actuator]"]):
    """Every device by the name of its class; one of the library's own is loaded when it is looked up."""

    def __init__(self) -> None:
        self.loaded: dict[str, type[Actuator]] = {}

    def __getitem__(self, name: str) -> type[Actuator]:
        if name not in self.loaded and name in PLACES:
            importlib.import_module(PLACES[name])
        return self.loaded[name]

    def __iter__(self) -> Iterator[str]:
        yield from PLACES
        yield from (name for name in list(self.loaded) if name not in PLACES)

    def __contains__(self, name: object) -> bool:
        return name in PLACES or name in self.loaded

    def __len__(self) -> int:
        return len(PLACES.keys() | self.loaded.keys())


ACTUATORS = Devices()
"""Every device by the name of its class."""


def _list_variant_fields(device: type[Actuator]) -> None:
    """Give the device's `Actuator.variant` a signature with its fields, which an editor's Tab completes."""
    plain = inspect.unwrap(device.variant.__func__)  # type: ignore[attr-defined]

    @functools.wraps(plain)
    def variant(cls: type[Actuator], name: str = "default", **changes: object) -> Actuator:
        return plain(cls, name, **changes)

    kinds = inspect.Parameter
    given = [kinds("cls", kinds.POSITIONAL_OR_KEYWORD), kinds("name", kinds.POSITIONAL_OR_KEYWORD, default="default")]
    fields = [
        kinds(one.name, kinds.KEYWORD_ONLY, default=one.default) for one in dataclasses.fields(device) if one.init
    ]
    variant.__signature__ = inspect.Signature([*given, *fields])  # type: ignore[attr-defined]
    device.variant = classmethod(checked(variant))  # type: ignore[assignment]


def register[Device: type[Actuator]](device: Device) -> Device:
    """Let settings files and command lines find a device by the name of its class; a class decorator.

    A class of the same module and name, as a notebook defines it anew, takes the place of the one before.

    Raises:
        ValueError: Another device has this name.
    """
    name = device.__name__
    place = (PLACES.get(name, device.__module__), name if name in PLACES else device.__qualname__)
    if known := ACTUATORS.loaded.get(name):
        place = (known.__module__, known.__qualname__)
    if place != (device.__module__, device.__qualname__):
        raise ValueError(f"there is a device of the name {name!r} already, in {place[0]}")
    ACTUATORS.loaded[name] = checked(device)
    _list_variant_fields(device)
    return device
