"""The table of devices by name, in which settings files and command lines look, and the options of a device."""

from __future__ import annotations

import dataclasses
import functools
import inspect
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, TypeVar

import click

from geometries import PLACES
from softmodels.common import commands, errors, names, schema, units
from softmodels.common.errors import GeometryError
from softmodels.common.names import checked

if TYPE_CHECKING:
    from geometries.actuator import Actuator


def _list_variant_fields(device: type[Actuator]) -> None:
    """Give the device's `Actuator.variant` a signature with its fields, which an editor's Tab completes, and ``help`` their
    meaning."""
    schema.describe_fields(device)
    plain = inspect.unwrap(device.variant.__func__)  # type: ignore[attr-defined]

    @functools.wraps(plain)
    def variant(cls: type[Actuator], name: str = "default", **changes: object) -> Actuator:
        return plain(cls, name, **changes)

    kinds = inspect.Parameter
    given = [kinds("cls", kinds.POSITIONAL_OR_KEYWORD), kinds("name", kinds.POSITIONAL_OR_KEYWORD, default="default")]
    fields = [
        kinds(field.name, kinds.KEYWORD_ONLY, default=field.default) for field in dataclasses.fields(device) if field.init
    ]
    variant.__signature__ = inspect.Signature([*given, *fields])  # type: ignore[attr-defined]
    device.variant = classmethod(checked(variant))  # type: ignore[assignment]


ACTUATORS: names.Registry[type[Actuator]] = names.Registry("device", places=PLACES, made_known=_list_variant_fields)
"""Every device by the name of its class."""
register_device = ACTUATORS.register


# ----------------------------------------------------------------------------------------------------------------------
# A device as a small table of texts with units, for settings files, and back without losing a bit.


def to_table(actuator: Actuator, text: schema.Text = units.exact_text) -> dict[str, Any]:
    """Return a device's parameters, ready for a TOML table: its name under ``"device"``, then every field: lengths and angles
    as text with a unit ("20 mm"), by `softmodels.common.units.readable` for people, pure numbers as numbers, choices, texts
    and lists as they are. `from_table` gives back an equal device."""
    return {"device": type(actuator).__name__, **schema.to_table(actuator, text)}


def from_table(table: Mapping[str, Any]) -> Actuator:
    """Return the device of ``"device"``, optionally ``"variant"``, and any fields; what is missing has the variant's value.
    GeometryError for an unknown device, variant or field, a value without its unit, or parameters that make no device."""
    values = dict(table)
    name = values.pop("device", None)
    if not isinstance(name, str) or name not in ACTUATORS:
        raise GeometryError(f"device is {name!r}; it must be one of {', '.join(ACTUATORS)}")
    device = ACTUATORS[name]
    fields = schema.about(device)
    try:
        read = {key: fields[key].kind.read(key, value) if key in fields else value for key, value in values.items()}
    except errors.FieldError as error:
        raise GeometryError(str(error)) from None
    return device_from(device, read)


def device_from(device: type[Actuator], values: Mapping[str, Any]) -> Actuator:
    """Return a device of a class from SI values by field name, and ``"variant"`` for the set of parameters they change; None
    is "not given". GeometryError for an unknown variant or field, or parameters that make no device."""
    given = {name: value for name, value in values.items() if value is not None}
    variant = given.pop("variant", "default")
    if not isinstance(variant, str) or variant not in device.variants:
        raise GeometryError(f"variant is {variant!r}; it must be one of {', '.join(device.variants)}")
    known = list(schema.about(device))
    for name in given:
        if name not in known:
            raise GeometryError(f"{name} is not a parameter of {device.__name__}; {errors.known_are(name, known)}")
    return device.variant(variant, **given)


# ----------------------------------------------------------------------------------------------------------------------
# Command-line options generated from a dataclass's fields.


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
            return units.quantity(value, self.unit)
        except units.UnitError as error:
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


def _type(kind: schema.Kind) -> click.ParamType:
    """Return the type that click gives the option of a kind of value."""
    match kind:
        case schema.Quantity() | schema.Open():
            return QuantityType(kind.unit)
        case schema.Choice():
            return click.IntRange(*kind.ends) if kind.ends else commands.Choice([str(known) for known in kind.choices])
        case schema.Flag():
            return click.BOOL
        case schema.Several():
            return QuantitiesType(kind.unit) if kind.unit else _type(kind.of)
    return click.STRING


def flag(name: str) -> str:
    """Return an option as typed."""
    return f"--{name.replace('_', '-')}"


def field_option(
    name: str, field: schema.About, default: object = None, metavar: str | None = None
) -> Callable[[Command], Command]:
    """Return the option of a field; its value is None unless given, in the unit of the field's kind. The default and the
    metavar are for the help; no default stands there if None."""
    kind, text = field.kind, f"{field.help[0].upper()}{field.help[1:]}."
    if isinstance(kind, schema.Flag):
        return click.option(flag(name), name, is_flag=True, default=None, help=text)
    again = kind.several and not kind.unit  # several quantities stand between commas
    text += "  [may be repeated]" if again else ""
    text += "" if default is None else f"  [default: {_friendly(default, kind.unit)}]"
    read = functools.partial(_choice_of_text, kind) if kind.several or isinstance(kind, schema.Choice) else None
    return click.option(
        flag(name), name, type=_type(kind), metavar=metavar, default=None, help=text, multiple=again, callback=read,
    )  # fmt: skip


def device_options(device: type[Actuator]) -> Callable[[Command], Command]:
    """Return a decorator that adds ``--variant`` and one option per field to a click command. Every option is None unless
    given, so that `device_from` can lay the given ones over the variant."""

    def default(name: str, kind: schema.Kind) -> object:
        return None if kind.several or isinstance(kind, schema.Words) else getattr(device, name, None)

    options = [
        click.option("--variant", type=commands.Choice(list(device.variants)), help=_variant_help(device)),
        *(field_option(name, field, default(name, field.kind)) for name, field in schema.about(device).items()),
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
    """Return the device of a command's options; GeometryError as of `device_from`, and for an option that has no effect with
    the others."""
    made = device_from(device, values)
    check_meaning(made, values)
    return made


def check_meaning(made: Actuator, values: Mapping[str, Any]) -> None:
    """Reject options, by field name and None where not given, for which the device has no use: GeometryError for the first."""
    for name, field in schema.about(made).items():
        if values.get(name) is not None and (other := field.idle(made)):
            given = f" {getattr(made, other)}" if field.unless and other == field.unless[0] else ""
            raise GeometryError(f"{flag(name)} has no effect with {flag(other)}{given}; leave one of them out")


def _choice_of_text(kind: schema.Kind, ctx: click.Context, param: click.Parameter, value: Any) -> Any:
    """Turn the text of a choice back into the choice, which may be a number; several that are none into None."""
    if isinstance(kind, schema.Choice):
        return next((known for known in kind.choices if str(known) == value), value)
    return value or None


def _variant_help(device: type[Actuator]) -> str:
    units = {name: field.kind.unit for name, field in schema.about(device).items()}
    parts = ["Parameters to start from; the options below change single ones."]
    for name, changes in device.variants.items():
        if changes:
            listed = (f"{key.replace('_', '-')} {_friendly(value, units[key])}" for key, value in changes.items())
            parts.append(f"{name}: {', '.join(listed)}.")
    return " ".join(parts) + "  [default: default]"


def _friendly(value: Any, unit: str) -> str:
    return value if isinstance(value, str) else schema.shown(value, unit)
