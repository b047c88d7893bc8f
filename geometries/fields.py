"""Parameters that know their unit, so that checks, command lines and settings files need no list of their own.

A device declares ``membrane: float = length_field(0.006, "thickness of the membrane")``. The kind and the help text travel in
the dataclass field's metadata, and `settle` checks every field of every device the same way. A case's supply, sheet and
contact do the same.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

from geometries.errors import FieldError, GeometryError
from geometries.kinds import LONGEST, Choice, Kind, Length, Quantity, Several, Words, shown

__all__ = ["LONGEST", "About", "about", "angle_field", "angles_field", "choice_field", "field_of", "length_field",
           "lengths_field", "list_field", "number_field", "settle", "shown", "text_field"]  # fmt: skip


@dataclasses.dataclass(frozen=True)
class About:
    """What a field's metadata hold.

    Attributes:
        kind: Of its values.
        help: What it is, a clause.
        unless: Name and value of another field with which it means nothing.
        key: Its name in settings files; the field's if empty.
        option: Its name on command lines; the key if empty.
        per_option: Value in the file's unit of an option's 1, where the two are counted in different units.
        instead: Name of a list that takes its place once it has entries.
        shape: Whether it decides a device's shape, so that a design may vary it; cell sizes and the like do not.
        usual: Largest number in the field's unit that is likely to be meant.
    """

    kind: Kind
    help: str
    unless: tuple[str, str] | None = None
    key: str = ""
    option: str = ""
    per_option: float = 1.0
    instead: str = ""
    shape: bool = True
    usual: float = math.inf

    def idle(self, thing: Any) -> str:
        """Name of the field that makes this one mean nothing in a value of the dataclass; empty if it means something."""
        if self.unless and getattr(thing, self.unless[0]) == self.unless[1]:
            return self.unless[0]
        return self.instead if self.instead and getattr(thing, self.instead) else ""


def field_of(kind: Kind, text: str, default: Any = dataclasses.MISSING, **more: Any) -> Any:
    """Return a dataclass field; ``more`` are further attributes of `About`."""
    return dataclasses.field(default=default, metadata={"about": About(kind, text, **more)})


def about(thing: Any) -> Mapping[str, About]:
    """What is known of the fields of a dataclass or of a value of one, by name."""
    return {field.name: field.metadata["about"] for field in dataclasses.fields(thing) if "about" in field.metadata}


def doubt_of(thing: Any) -> str:
    """Which number of a value of a dataclass is hardly meant: a sentence, empty if none."""
    from measurement.units import example

    for name, field in about(thing).items():
        value, unit = getattr(thing, name), field.kind.unit
        if isinstance(value, float) and abs(value) > field.usual:
            of = f"{type(thing).__name__}: {name.replace('_', ' ')}"
            return f"{of} is {value:g} {unit}; numbers are in {unit}, so write another unit as a text such as '{example(unit)}'"
    return ""


def length_field(default: float, text: str, *, zero: bool = False, signed: bool = False, **more: Any) -> Any:
    """Return a dataclass field for a length in m; ``zero`` allows the value 0, ``signed`` negative ones.

    Args:
        default: Its value if not given.
        text: What it is.
        zero: Whether it may be 0.
        signed: Whether it may be negative.
        more: Further attributes of `About`.
    """
    return field_of(Length(zero=zero, signed=signed), text, default, **more)


def angle_field(default: float, text: str, **more: Any) -> Any:
    """Return a dataclass field for an angle in degrees; ``more`` are further attributes of `About`."""
    return field_of(Quantity("degree"), text, default, **more)


def number_field(default: float, text: str, **more: Any) -> Any:
    """Return a dataclass field for a pure number; ``more`` are further attributes of `About`."""
    return field_of(Quantity(), text, default, **more)


def choice_field(default: str | int, choices: tuple[str | int, ...], text: str) -> Any:
    """Return a dataclass field that takes one of ``choices`` (all of one type)."""
    return field_of(Choice(choices), text, default)


def text_field(default: str, text: str) -> Any:
    """Return a dataclass field for a text."""
    return field_of(Words(), text, default)


def list_field(
    default: tuple[str, ...] | tuple[float, ...], text: str, *, numbers: bool = False, shape: bool = True
) -> Any:
    """Return a dataclass field for any number of texts, or of pure numbers; see `About.shape`."""
    return field_of(Several(Quantity() if numbers else Words()), text, default, shape=shape)


def lengths_field(text: str) -> Any:
    """Return a dataclass field for any number of lengths in m, none unless given."""
    return field_of(Several(Length()), text, ())


def angles_field(text: str) -> Any:
    """Return a dataclass field for any number of angles in degrees, none unless given."""
    return field_of(Several(Quantity("degree")), text, ())


def settle(thing: Any, error: type[ValueError] = GeometryError) -> None:
    """Turn every field of a frozen dataclass into a plain float, int, str or tuple of them and check what needs no other field.

    Plain types make equal devices compare, print and hash equally whether a caller wrote 45, 45.0 or a NumPy scalar.

    Args:
        thing: The value.
        error: What is raised.

    Raises:
        ValueError: Of the class ``error``: wrong type, not finite, not one of the choices, or a length that none can have.
    """
    for name, field in about(thing).items():
        try:
            object.__setattr__(thing, name, field.kind.settled(name, getattr(thing, name)))
        except FieldError as wrong:
            raise error(str(wrong)) from None
