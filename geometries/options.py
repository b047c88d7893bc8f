"""Command-line options generated from a dataclass's fields."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import click

from geometries.actuator import Actuator
from geometries.registry import device_from, from_table, to_table
from softmodels.common.errors import GeometryError
from softmodels.common.schema import About, Choice, Flag, Kind, Open, Quantity, Several, Words, about, shown
from softmodels.common.units import UnitError, quantity

__all__ = [
    "QuantityType",
    "check_meaning",
    "device_from",
    "device_options",
    "device_told",
    "field_option",
    "flag",
    "from_table",
    "given",
    "to_table",
]

Command = TypeVar("Command", bound=Callable[..., Any])


class QuantityType(click.ParamType):
    """A number with a unit on the command line, such as ``20mm``; its value is in the unit given here."""

    def __init__(self, unit: str) -> None:
        """Args: unit: Unit of the value in Pint's spelling; ``""`` for a pure number."""
        self.unit = unit
        self.name = {"m": "length", "degree": "angle", "m^3": "volume", "Pa": "pressure", "": "number"}.get(unit, unit)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        if isinstance(value, int | float):
            return value
        try:
            return quantity(value, self.unit)
        except UnitError as error:
            self.fail(str(error), param, ctx)


class QuantitiesType(QuantityType):
    """Numbers with units between commas, such as ``0.7mm,0.9mm``; the value is a tuple in the unit given here."""

    def __init__(self, unit: str) -> None:
        """Args: unit: Unit of the values in Pint's spelling."""
        super().__init__(unit)
        self.name = f"{self.name},..."

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        parts = value.split(",") if isinstance(value, str) else value
        return tuple(super(QuantitiesType, self).convert(part, param, ctx) for part in parts)


@functools.singledispatch
def _type(kind: Kind) -> click.ParamType:
    """Return the type that click gives the option of a kind of value."""
    return click.STRING


@_type.register
def _(kind: Quantity) -> click.ParamType:
    return QuantityType(kind.unit)


@_type.register
def _(kind: Open) -> click.ParamType:
    return QuantityType(kind.unit)


@_type.register
def _(kind: Choice) -> click.ParamType:
    return click.IntRange(*kind.ends) if kind.ends else click.Choice([str(known) for known in kind.choices])


@_type.register
def _(kind: Flag) -> click.ParamType:
    return click.BOOL


@_type.register
def _(kind: Several) -> click.ParamType:
    return QuantitiesType(kind.unit) if kind.unit else _type(kind.of)


def flag(name: str) -> str:
    """Return an option as typed."""
    return f"--{name.replace('_', '-')}"


def field_option(
    name: str, field: About, default: object = None, metavar: str | None = None
) -> Callable[[Command], Command]:
    """Return the option of a field; its value is None unless given, in the unit of the field's kind.

    Args:
        name: The option's.
        field: What is known of the field.
        default: What stands in the help as the default; nothing if None.
        metavar: What stands for its value in the help.
    """
    kind, text = field.kind, f"{field.help[0].upper()}{field.help[1:]}."
    if isinstance(kind, Flag):
        return click.option(flag(name), name, is_flag=True, default=None, help=text)
    again = kind.several and not kind.unit  # several quantities stand between commas
    text += "  [may be repeated]" if again else ""
    text += "" if default is None else f"  [default: {_friendly(default, kind.unit)}]"
    return click.option(
        flag(name), name, type=_type(kind), metavar=metavar, default=None, help=text, multiple=again,
        callback=functools.partial(_typed, kind),
    )  # fmt: skip


def device_options(device: type[Actuator]) -> Callable[[Command], Command]:
    """Return a decorator that adds ``--variant`` and one option per field to a click command.

    Every option is None unless given, so that `device_from` can lay the given ones over the variant.

    Args:
        device: The class.
    """

    def default(name: str, kind: Kind) -> object:
        return None if kind.several or isinstance(kind, Words) else getattr(device, name, None)

    options = [
        click.option("--variant", type=click.Choice(list(device.variants)), help=_variant_help(device)),
        *(field_option(name, field, default(name, field.kind)) for name, field in about(device).items()),
    ]

    def decorate(command: Command) -> Command:
        for option in reversed(options):  # click lists the option added last first
            command = option(command)
        return command

    return decorate


def given(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return those of a command's values that were given."""
    return {name: value for name, value in values.items() if value is not None}


def device_told(device: type[Actuator], values: Mapping[str, Any]) -> Actuator:
    """Return the device of a command's options; see `device_from`.

    Raises:
        GeometryError: As there, and for an option that has no effect with the others.
    """
    made = device_from(device, values)
    check_meaning(made, values)
    return made


def check_meaning(made: Actuator, values: Mapping[str, Any]) -> None:
    """Reject options that were given although the device has no use for them.

    Args:
        made: The device.
        values: Options by field name; None where not given.

    Raises:
        GeometryError: The first of them.
    """
    for name, field in about(made).items():
        if values.get(name) is not None and (other := field.idle(made)):
            given = f" {getattr(made, other)}" if field.unless and other == field.unless[0] else ""
            raise GeometryError(f"{flag(name)} has no effect with {flag(other)}{given}; leave one of them out")


def _typed(kind: Kind, ctx: click.Context, param: click.Parameter, value: Any) -> Any:
    """Turn the text of a choice back into the choice, which may be a number; several that are none into None."""
    if isinstance(kind, Choice):
        return next((known for known in kind.choices if str(known) == value), value)
    return (value or None) if kind.several else value


def _variant_help(device: type[Actuator]) -> str:
    units = {name: field.kind.unit for name, field in about(device).items()}
    parts = ["Parameters to start from; the options below change single ones."]
    for name, changes in device.variants.items():
        if changes:
            listed = (f"{key.replace('_', '-')} {_friendly(value, units[key])}" for key, value in changes.items())
            parts.append(f"{name}: {', '.join(listed)}.")
    return " ".join(parts) + "  [default: default]"


def _friendly(value: Any, unit: str) -> str:
    return value if isinstance(value, str) else shown(value, unit)
