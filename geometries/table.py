"""A device as a small table of texts with units, for settings files, and back without losing a bit."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

from geometries.actuator import Actuator
from geometries.errors import GeometryError
from geometries.registry import ACTUATORS
from measurement.units import UnitError, brief, exact_text, quantity


def to_table(actuator: Actuator, text: Callable[[float, str], str] = exact_text) -> dict[str, Any]:
    """Return a device's parameters, ready for a TOML table.

    Args:
        actuator: The device.
        text: How quantities are written; `measurement.units.readable` for people.

    Returns:
        The device's name under ``"device"``, then every field: lengths and angles as text with a unit ("20 mm"), pure
        numbers as numbers, choices, texts and lists as they are. `from_table` gives back an equal device.
    """
    table: dict[str, Any] = {"device": type(actuator).__name__}
    for field in dataclasses.fields(actuator):
        value = getattr(actuator, field.name)
        unit = field.metadata["unit"]
        if isinstance(value, tuple):
            value = list(value)
        table[field.name] = text(value, unit) if unit else value
    return table


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
    units = {field.name: field.metadata["unit"] for field in dataclasses.fields(device)}
    for key, value in values.items():
        if units.get(key):
            values[key] = _read(key, value, units[key])
    return device_from(device, values)


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
    known = [field.name for field in dataclasses.fields(device)]
    for name in given:
        if name not in known:
            raise GeometryError(f"{name} is not a parameter of {device.__name__}; it has {', '.join(known)}")
    return device.variant(variant, **given)


def _read(name: str, value: Any, unit: str) -> float:
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        raise GeometryError(f"{name} is {brief(value)}; it must be a text with a unit")
    try:
        return quantity(value, unit)
    except UnitError as error:
        raise GeometryError(f"{name}: {error}") from None
