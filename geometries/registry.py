"""The table of devices by name, in which settings files and command lines look."""

from __future__ import annotations

import dataclasses
import functools
import inspect
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from geometries import PLACES
from softmodels.common import schema
from softmodels.common.errors import FieldError, GeometryError
from softmodels.common.names import Registry, checked
from softmodels.common.schema import Text, about
from softmodels.common.units import exact_text

if TYPE_CHECKING:
    from geometries.actuator import Actuator


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


ACTUATORS: Registry[type[Actuator]] = Registry("device", lambda device: device.__name__, PLACES, _list_variant_fields)
"""Every device by the name of its class."""
register_device = ACTUATORS.register


# ----------------------------------------------------------------------------------------------------------------------
# A device as a small table of texts with units, for settings files, and back without losing a bit.


def to_table(actuator: Actuator, text: Text = exact_text) -> dict[str, Any]:
    """Return a device's parameters, ready for a TOML table.

    Args:
        actuator: The device.
        text: How quantities are written; `softmodels.common.units.readable` for people.

    Returns:
        The device's name under ``"device"``, then every field: lengths and angles as text with a unit ("20 mm"), pure
        numbers as numbers, choices, texts and lists as they are. `from_table` gives back an equal device.
    """
    return {"device": type(actuator).__name__, **schema.to_table(actuator, text)}


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
