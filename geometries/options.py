"""Command-line options made from a device's fields, so that a new parameter is an option the moment it exists."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import click

from geometries.actuator import Actuator
from geometries.errors import GeometryError
from geometries.fields import shown
from geometries.table import device_from, from_table, to_table
from measurement.units import UnitError, quantity

__all__ = ["QuantityType", "check_meaning", "device_from", "device_options", "device_told", "from_table", "to_table"]

Command = TypeVar("Command", bound=Callable[..., Any])


class QuantityType(click.ParamType):
    """A number with a unit on the command line, such as ``20mm``; its value is in the unit given here."""

    def __init__(self, unit: str) -> None:
        """Args: unit: Unit of the value in Pint's spelling; ``""`` for a pure number."""
        self.unit = unit
        self.name = {"m": "length", "degree": "angle", "": "number"}.get(unit, unit)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        if isinstance(value, int | float):
            return value
        try:
            return quantity(value, self.unit)
        except UnitError as error:
            self.fail(str(error), param, ctx)


def device_options(device: type[Actuator]) -> Callable[[Command], Command]:
    """Return a decorator that adds ``--variant`` and one option per field to a click command.

    Every option is None unless given, so that `device_from` can lay the given ones over the variant.

    Args:
        device: The class, one of `geometries.ACTUATORS`.
    """
    options = [
        click.option("--variant", type=click.Choice(list(device.variants)), help=_variant_help(device)),
        *(_option(field) for field in dataclasses.fields(device)),
    ]

    def decorate(command: Command) -> Command:
        # click lists the option added last first.
        for option in reversed(options):
            command = option(command)
        return command

    return decorate


def device_told(device: type[Actuator], values: Mapping[str, Any]) -> Actuator:
    """The device of a command's options; see `device_from`.

    Raises:
        GeometryError: As there, and for an option that means nothing with the others.
    """
    made = device_from(device, values)
    check_meaning(made, values)
    return made


def check_meaning(made: Actuator, values: Mapping[str, Any]) -> None:
    """Refuse options that were given although the device has no use for them.

    Args:
        made: The device.
        values: Options by field name; None where not given.

    Raises:
        GeometryError: The first of them.
    """
    for field in dataclasses.fields(made):
        other = field.metadata.get("unless")
        if other and values.get(field.name) is not None and getattr(made, other[0]) == other[1]:
            raise GeometryError(
                f"--{field.name.replace('_', '-')} means nothing with --{other[0]} {other[1]}; leave one of them out"
            )


def _option(field: dataclasses.Field[Any]) -> Callable[[Command], Command]:
    meta = field.metadata
    kind: Any = QuantityType(meta["unit"])
    if "choices" in meta:
        kind = click.Choice([str(known) for known in meta["choices"]])
    text = f"{meta['help'][0].upper()}{meta['help'][1:]}."
    flag = f"--{field.name.replace('_', '-')}"
    if "kind" in meta:
        several = meta["kind"] != "text"
        kind = QuantityType("") if meta["kind"] == "numbers" else click.STRING
        text += "  [may be given again]" if several else ""
        return click.option(
            flag,
            field.name,
            type=kind,
            default=None,
            help=text,
            multiple=several,
            callback=lambda ctx, param, v: v or None,
        )
    text += f"  [default: {_friendly(field.default, meta['unit'])}]"
    return click.option(flag, field.name, type=kind, default=None, help=text, callback=functools.partial(_typed, meta))


def _typed(meta: Mapping[str, Any], ctx: click.Context, param: click.Parameter, value: Any) -> Any:
    """Turn the text of a choice back into the choice, which may be a number."""
    return next((known for known in meta.get("choices", ()) if str(known) == value), value)


def _variant_help(device: type[Actuator]) -> str:
    units = {field.name: field.metadata["unit"] for field in dataclasses.fields(device)}
    parts = ["Parameters to start from; the options below change single ones."]
    for name, changes in device.variants.items():
        if changes:
            listed = (f"{key.replace('_', '-')} {_friendly(value, units[key])}" for key, value in changes.items())
            parts.append(f"{name}: {', '.join(listed)}.")
    return " ".join(parts) + "  [default: default]"


def _friendly(value: Any, unit: str) -> str:
    return value if isinstance(value, str) else shown(value, unit)
