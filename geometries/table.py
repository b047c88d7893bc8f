"""A device as a small table of texts with units, for settings files, and back without losing a bit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from geometries import codec
from geometries.actuator import Actuator
from geometries.errors import FieldError, GeometryError
from geometries.fields import about
from geometries.kinds import Text
from geometries.registry import ACTUATORS
from measurement.units import exact_text


def to_table(actuator: Actuator, text: Text = exact_text) -> dict[str, Any]:
    """Return a device's parameters, ready for a TOML table.

    Args:
        actuator: The device.
        text: How quantities are written; `measurement.units.readable` for people.

    Returns:
        The device's name under ``"device"``, then every field: lengths and angles as text with a unit ("20 mm"), pure
        numbers as numbers, choices, texts and lists as they are. `from_table` gives back an equal device.
    """
    return {"device": type(actuator).__name__, **codec.to_table(actuator, text)}


def from_table(table: Mapping[str, Any]) -> Actuator:
    """Return the device that a table describes.

    Args:
        table: ``"device"``, optionally ``"variant"``, and any fields; what is missing has the variant's value.

    Raises:
        GeometryError: An unknown device, variant or field, a value without its unit, or parameters that make no device.
    """
    values = dict(table)
    name = values.pop("device", None)
    if not isinstance(name, str) or name not in ACTUATORS:
        raise GeometryError(f"device is {name!r}; it must be one of {', '.join(ACTUATORS)}")
    device = ACTUATORS[name]
    fields = about(device)
    try:
        read = {key: fields[key].kind.read(key, value) if key in fields else value for key, value in values.items()}
    except FieldError as error:
        raise GeometryError(str(error)) from None
    return device_from(device, read)


def device_from(device: type[Actuator], values: Mapping[str, Any]) -> Actuator:
    """Return a device from values where None means "not given".

    Args:
        device: The class, one of `geometries.ACTUATORS`.
        values: SI values by field name, and ``"variant"`` for the set of parameters they change.

    Raises:
        GeometryError: An unknown variant or field, or parameters that make no device.
    """
    given = {name: value for name, value in values.items() if value is not None}
    variant = given.pop("variant", "default")
    if not isinstance(variant, str) or variant not in device.variants:
        raise GeometryError(f"variant is {variant!r}; it must be one of {', '.join(device.variants)}")
    known = list(about(device))
    for name in given:
        if name not in known:
            raise GeometryError(f"{name} is not a parameter of {device.__name__}; it has {', '.join(known)}")
    return device.variant(variant, **given)
