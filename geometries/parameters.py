"""The continuous parameters of a device by name: what decides its shape and may be varied by any small amount.

An entry of a list has the field's name and its place, counted from 1: ``profile[2]``. Values are in SI units, angles in
degrees.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from geometries.errors import GeometryError
from geometries.fields import about
from geometries.kinds import Length, Quantity, Several

if TYPE_CHECKING:
    from geometries.actuator import Actuator


def parameter_names(device: Actuator) -> tuple[str, ...]:
    """Names of the continuous parameters that decide a device's shape, in the order of its fields.

    Sizes of cells, limits of the workshop and other fields declared with ``shape=False`` are not among them, nor are fields
    that mean nothing with the others.
    """
    return tuple(name for name, _, _ in _places(device))


def parameter(device: Actuator, name: str) -> float:
    """Value of a continuous parameter.

    Args:
        device: The device.
        name: One of `parameter_names`.

    Returns:
        In m, degrees or as a pure number.

    Raises:
        GeometryError: The device has no such parameter.
    """
    field, place = _place(device, name)
    value = getattr(device, field)
    return float(value if place is None else value[place])


def changed[Device: Actuator](device: Device, values: Mapping[str, float]) -> Device:
    """The device with other values of continuous parameters.

    Args:
        device: The device.
        values: SI values by the names of `parameter_names`; what is left out stays.

    Raises:
        GeometryError: The device has no such parameter, or the values make no device.
    """
    fields: dict[str, object] = {}
    for name, value in values.items():
        field, place = _place(device, name)
        if place is None:
            fields[field] = value
        else:
            entries = list(fields.get(field, getattr(device, field)))  # type: ignore[call-overload]
            entries[place] = value
            fields[field] = tuple(entries)
    return dataclasses.replace(device, **fields)


def _places(device: Actuator) -> Iterator[tuple[str, str, int | None]]:
    """Name, field and place in the field's list of every continuous parameter."""
    for field, known in about(device).items():
        if not known.shape or known.idle(device):
            continue
        if isinstance(known.kind, Quantity):
            yield field, field, None
        elif isinstance(known.kind, Several) and isinstance(known.kind.of, Quantity):
            for place in range(len(getattr(device, field))):
                yield f"{field}[{place + 1}]", field, place


def _place(device: Actuator, name: str) -> tuple[str, int | None]:
    places = {known: (field, place) for known, field, place in _places(device)}
    if name in places:
        return places[name]
    words = f"{name} is no continuous parameter of this {type(device).__name__}"
    if entry := re.fullmatch(r"(\w+)\[\d+\]", name):
        length = sum(field == entry[1] for field, _ in places.values())
        if length:
            raise GeometryError(f"{words}; {entry[1]} has {length} entries, counted from 1")
    raise GeometryError(f"{words}; it has {', '.join(places) or 'none'}")


def is_length(device: Actuator, name: str) -> bool:
    """Whether a continuous parameter is a length in m, and not an angle or a pure number; GeometryError as `parameter`."""
    field, place = _place(device, name)
    kind = about(device)[field].kind
    return isinstance(kind if place is None or not isinstance(kind, Several) else kind.of, Length)
