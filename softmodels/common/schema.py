"""Dataclass fields with unit and help, used by checks, command lines and settings files.

A device declares ``membrane: float = length_field(0.006, "thickness of the membrane")``. The kind and the help text travel in
the dataclass field's metadata, and `settle` checks every field of every device the same way. A case's supply, sheet and
contact do the same.
"""

from __future__ import annotations

import abc
import dataclasses
import inspect
import math
import numbers
from collections.abc import Callable, Mapping
from typing import Any, ClassVar

from softmodels.common import errors, units
from softmodels.common.errors import GeometryError

__all__ = ["MAX_LENGTH", "About", "about", "angle_field", "angles_field", "choice_field", "field_of", "length_field",
           "lengths_field", "list_field", "number_field", "settle", "shown", "text_field"]  # fmt: skip


@dataclasses.dataclass(frozen=True)
class About:
    """Metadata of a field.

    Attributes:
        help: What it is, a clause.
        unless: Name and value of another field with which it means nothing.
        key, option: Its name in settings files, the field's if empty, and on command lines, the key if empty.
        per_option: Value in the file's unit of an option's 1, where the two are counted in different units.
        instead: Name of a list that takes its place once it has entries.
        shape: Whether it decides a device's shape, so that a design may vary it; cell sizes and the like do not.
        usual: Largest number in the field's unit that is likely to be meant.
        last: Whether it stands behind the others, though a base class declares it.
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
    last: bool = False

    @property
    def text(self) -> str:
        """What it is as a sentence without its stop, with its choices."""
        of = f"; one of {', '.join(map(str, self.kind.choices))}" if isinstance(self.kind, Choice) else ""
        return f"{self.help[0].upper()}{self.help[1:]}{of}"

    def idle(self, thing: Any) -> str:
        """Return the name of the field that makes this one ineffective in a value of the dataclass; empty if it is
        effective."""
        if self.unless and getattr(thing, self.unless[0]) == self.unless[1]:
            return self.unless[0]
        return self.instead if self.instead and getattr(thing, self.instead) else ""


def field_of(kind: Kind, text: str, default: Any = dataclasses.MISSING, **more: Any) -> Any:
    """Return a dataclass field; ``more`` are further attributes of `About`."""
    return dataclasses.field(default=default, metadata={"about": About(kind, text, **more)})


def about(thing: Any) -> Mapping[str, About]:
    """Return the metadata of the fields of a dataclass or its instance, by name."""
    abouts = {field.name: field.metadata["about"] for field in dataclasses.fields(thing) if "about" in field.metadata}
    return dict(sorted(abouts.items(), key=lambda item: item[1].last))


def describe_fields(kind: type) -> None:
    """Add to a dataclass's docstring what its fields are and their units."""
    described = about(kind).items()
    lines = [f"    {name}: {field.text}{f' ({field.kind.unit})' if field.kind.unit else ''}." for name, field in described]
    kind.__doc__ = "\n".join([inspect.getdoc(kind) or "", "", "Attributes:", *lines])


def doubt_of(thing: Any) -> str:
    """Return a sentence on an implausible value of a dataclass; empty if none."""
    for name, field in about(thing).items():
        value, unit = getattr(thing, name), field.kind.unit
        if isinstance(value, float) and abs(value) > field.usual:
            of = f"{type(thing).__name__}: {name.replace('_', ' ')}"
            return (
                f"{of} is {value:g} {unit}; numbers are in {unit}, so write another unit as a text such as "
                f"'{units.example(unit)}'"
            )
    return ""


def length_field(default: float, text: str, *, zero: bool = False, signed: bool = False, **more: Any) -> Any:
    """Return a dataclass field for a length in m, which may be 0 (``zero``) or negative (``signed``)."""
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


def list_field(default: tuple[str, ...] | tuple[float, ...], text: str, *, numbers: bool = False, shape: bool = True) -> Any:
    """Return a dataclass field for any number of texts, or of pure numbers; see `About.shape`."""
    return field_of(Several(Quantity() if numbers else Words()), text, default, shape=shape)


def lengths_field(text: str) -> Any:
    """Return a dataclass field for any number of lengths in m, none unless given."""
    return field_of(Several(Length()), text, ())


def places_field(text: str) -> Any:
    """Return a dataclass field for any number of coordinates in m, none unless given."""
    return field_of(Several(Coordinate()), text, ())


def angles_field(text: str) -> Any:
    """Return a dataclass field for any number of angles in degrees, none unless given."""
    return field_of(Several(Quantity("degree")), text, ())


def settle(thing: Any, error: type[ValueError] = GeometryError) -> None:
    """Turn every field of a frozen dataclass into a plain float, int, str or tuple of them and check what needs no other
    field; raise ``error`` for a wrong type, or what is not finite, not one of the choices, or a length that none can have.

    Plain types make equal devices compare, print and hash equally whether a caller wrote 45, 45.0 or a NumPy scalar.
    """
    for name, field in about(thing).items():
        try:
            object.__setattr__(thing, name, field.kind.settled(name, getattr(thing, name)))
        except errors.FieldError as wrong:
            raise error(str(wrong)) from None


# ----------------------------------------------------------------------------------------------------------------------
# Kinds of values: reading from text or tables, writing, and checking.
#
# A field of a dataclass names its kind; from that come its entry in a settings file, its option
# on a command line (`geometries.registry`) and the messages on invalid input.


Text = Callable[[float, str], str]
"""Writes a number of a unit, as `softmodels.common.units.exact_text` does for files and `readable` for people."""
Scalar = str | int | float | bool
Entry = Scalar | list[Scalar]
"""What a settings file holds."""

MIN_LENGTH = 1e-5
"""Shortest length in m: the CAD kernel merges points closer than about 0.1 micrometre."""

MAX_LENGTH = 10.0
"""Longest length in m; above it a wrong unit is assumed."""

MAX_LISTED_NUMBERS = 4
"""Up to so many whole numbers are listed one by one in messages; of more their least and largest are."""

BOUND_TOLERANCE = 1e-9
"""Relative tolerance of bounds: 10 um is 9.999999999999999e-06 m."""


def shown(value: object, unit: str) -> str:
    """Return a value as a person would write it, for example ``"20 mm"`` for 0.02 in ``"m"``."""
    if not isinstance(value, int | float):
        return repr(value)
    return units.readable(value, unit)


def _plain(name: str, value: object) -> Any:
    """Return NumPy's numbers and arrays as Python's; `FieldError` for masked values."""
    try:
        return units.plain(value)
    except units.UnitError as error:
        raise errors.FieldError(f"{name}: {error}") from None


def _invalid_text(value: object) -> str:
    """Return an invalid value's text for its message."""
    return units.brief(value)


class Kind(abc.ABC):
    """A kind of value, or of tuples of ``several``; the unit in Pint's spelling, ``""`` for pure numbers and for what is no
    number."""

    unit: str = ""
    several: ClassVar[bool] = False

    @abc.abstractmethod
    def settled(self, name: str, value: object) -> object:
        """Return a value that code gives, as a plain float, int, str, bool or tuple; `FieldError` if it is not of this kind."""

    def read(self, name: str, value: object) -> object:
        """Return a value from a settings file or from the text of an option; see `settled`."""
        return self.settled(name, value)

    def write(self, value: object, text: Text) -> object:
        """Return a value for a settings file, which `read` takes back."""
        return list(value) if isinstance(value, tuple) else value


@dataclasses.dataclass(frozen=True)
class Quantity(Kind):
    """A number with a unit, or a pure number."""

    unit: str = ""

    def settled(self, name: str, value: object) -> float:
        value = _plain(name, value)
        if isinstance(value, str):
            return Quantity.read(self, name, value)
        if not isinstance(value, numbers.Real) or isinstance(value, bool):
            raise errors.FieldError(f"{name} is {_invalid_text(value)}; it must be {self._wanted}")
        try:
            finite = float(value)
        except OverflowError:
            finite = math.inf
        if not math.isfinite(finite):
            raise errors.FieldError(f"{name} is {_invalid_text(value)}; it must be a finite number")
        return finite

    @property
    def _wanted(self) -> str:
        if not self.unit:
            return "a number"
        return f"a number in {self.unit}, or a text with a unit such as '{units.example(self.unit)}'"

    def read(self, name: str, value: object) -> float:
        value = _plain(name, value)
        if isinstance(value, bool) or not isinstance(value, str | int | float):
            raise errors.FieldError(
                f"{name} is {units.brief(value)}; it must be a {'text with a unit' if self.unit else 'number'}"
            )
        try:
            return units.quantity(value, self.unit)
        except units.UnitError as error:
            raise errors.FieldError(f"{name}: {error}") from None

    def write(self, value: object, text: Text) -> object:
        return text(value, self.unit) if self.unit and isinstance(value, int | float) else value


@dataclasses.dataclass(frozen=True)
class Length(Quantity):
    """A length in m that a device can have; ``zero`` allows the value 0, ``signed`` negative ones."""

    unit: str = "m"
    zero: bool = False
    signed: bool = False

    def settled(self, name: str, value: object) -> float:
        length = super().settled(name, value)
        size = abs(length) if self.signed else length
        if self.zero and size == 0.0:
            return length
        if size <= 0.0:
            raise errors.FieldError(
                f"{name} is {shown(size, 'm')}; it must {'not be negative' if self.zero else 'be larger than 0'}"
            )
        if size < MIN_LENGTH * (1 - BOUND_TOLERANCE):
            raise errors.FieldError(f"{name} is {size * 1e6:.6g} um; lengths below {MIN_LENGTH * 1e6:g} um cannot be modelled")
        if size > MAX_LENGTH * (1 + BOUND_TOLERANCE):
            raise errors.FieldError(f"{name} is {shown(size, 'm')}; above {MAX_LENGTH:g} m this suggests a wrong unit")
        return length


@dataclasses.dataclass(frozen=True)
class Coordinate(Length):
    """A place along an axis in m, which may be any small number."""

    signed: bool = True

    def settled(self, name: str, value: object) -> float:
        return place if abs(place := Quantity.settled(self, name, value)) < MIN_LENGTH else super().settled(name, place)


@dataclasses.dataclass(frozen=True)
class Open(Kind):
    """A quantity that may be left open: None where it follows from something else."""

    of: Quantity
    unit: str = dataclasses.field(init=False, default="")

    def __post_init__(self) -> None:
        object.__setattr__(self, "unit", self.of.unit)

    def settled(self, name: str, value: object) -> float | None:
        return None if value is None else self.of.settled(name, value)

    def read(self, name: str, value: object) -> float | None:
        return None if value is None else self.of.read(name, value)

    def write(self, value: object, text: Text) -> object:
        return None if value is None else self.of.write(value, text)


@dataclasses.dataclass(frozen=True)
class Choice(Kind):
    """One of some values, all of one type."""

    choices: tuple[str | int | float, ...]

    def __post_init__(self) -> None:
        errors.choices(self.choices)

    def settled(self, name: str, value: object) -> str | int | float:
        value = _plain(name, value)
        for known in self.choices:
            if isinstance(value, str | numbers.Real) and value == known and not isinstance(value, bool):
                return known
        if ends := self.ends:
            raise errors.FieldError(f"{name} is {_invalid_text(value)}; it must be a whole number from {ends[0]} to {ends[1]}")
        names = [str(known) for known in self.choices]
        more = errors.meant(value, names) if isinstance(value, str) else ""
        raise errors.FieldError(f"{name} is {_invalid_text(value)}; it must be one of {', '.join(names)}{more}")

    @property
    def ends(self) -> tuple[int, int] | None:
        """The least and the largest of whole numbers without gaps, if they are more than `MAX_LISTED_NUMBERS`."""
        whole = [known for known in self.choices if isinstance(known, int)]
        if len(whole) <= MAX_LISTED_NUMBERS or whole != list(range(whole[0], whole[0] + len(self.choices))):
            return None
        return whole[0], whole[-1]


@dataclasses.dataclass(frozen=True)
class Words(Kind):
    """A text."""

    def settled(self, name: str, value: object) -> str:
        if not isinstance(value, str):
            raise errors.FieldError(f"{name} is {_invalid_text(value)}; it must be a text")
        return value


@dataclasses.dataclass(frozen=True)
class Flag(Kind):
    """Yes or no."""

    def settled(self, name: str, value: object) -> bool:
        value = _plain(name, value)
        if not isinstance(value, bool):
            raise errors.FieldError(f"{name} is {_invalid_text(value)}; it must be true or false")
        return value


@dataclasses.dataclass(frozen=True)
class Several(Kind):
    """Any number of texts, or of numbers of one kind; a single text needs no list."""

    of: Quantity | Words
    unit: str = dataclasses.field(init=False, default="")
    several: ClassVar[bool] = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "unit", self.of.unit)

    def settled(self, name: str, value: object) -> tuple[object, ...]:
        value = _plain(name, value)
        if isinstance(value, str) and isinstance(self.of, Words):
            value = [value] if value else []
        if isinstance(value, list | tuple):
            value = [_plain(name, item) for item in value]
        if not isinstance(value, list | tuple) or not all(isinstance(item, self._wanted) for item in value):
            raise self._refused(name, value)
        if any(isinstance(item, bool) for item in value):
            raise self._refused(name, value)
        if isinstance(self.of, Words):
            return tuple(value)
        return tuple(self.of.settled(f"{name}[{place}]", item) for place, item in enumerate(value, 1))

    def read(self, name: str, value: object) -> object:
        if not self.unit:
            return self.settled(name, value)
        value = _plain(name, value)
        if not isinstance(value, list | tuple):
            raise self._refused(name, value)
        return tuple(self.of.read(f"{name}[{place}]", item) for place, item in enumerate(value, 1))

    def write(self, value: object, text: Text) -> object:
        return [self.of.write(item, text) for item in value] if isinstance(value, tuple) else value

    @property
    def _wanted(self) -> tuple[type, ...]:
        return (str,) if isinstance(self.of, Words) else (numbers.Real, str)

    def _refused(self, name: str, value: object) -> errors.FieldError:
        what = "texts" if isinstance(self.of, Words) else f"numbers in {self.unit}" if self.unit else "numbers"
        return errors.FieldError(f"{name} is {_invalid_text(value)}; it must be a list of {what}, such as [...]")


# ----------------------------------------------------------------------------------------------------------------------
# Lossless conversion between dataclasses and tables of a settings file.


def to_table(thing: Any, text: Text = units.exact_text) -> dict[str, Any]:
    """Return the fields of a value for a TOML table: lengths and the like as texts with a unit ("20 mm"), pure numbers,
    choices, texts and lists as they are. What is left open is left out.

    Quantities are written as exact texts, so that `from_table` gives back the same numbers to the last bit, unless ``text`` is
    another function, such as `readable` for people.
    """
    written = {field.key or name: field.kind.write(getattr(thing, name), text) for name, field in about(thing).items()}
    return {name: value for name, value in written.items() if value is not None}


def from_table(kind: type, table: Mapping[str, Any], where: str, what: str = "") -> dict[str, Any]:
    """Return the values of a table, by the names that `to_table` writes or by those of the options, by the names of a
    dataclass's fields; what is None is left out. `FieldError` for an unknown entry or a value of another kind.

    ``where`` is what the table is called, such as ``"[sheet]"``, and ``what`` what is put before the name of an entry in
    messages.
    """
    fields = about(kind)
    names = {field.key or name: (name, 1.0) for name, field in fields.items()}
    names |= {field.option: (name, field.per_option) for name, field in fields.items() if field.option}
    values = {}
    for key, value in table.items():
        if key not in names:
            known = errors.known_are(key, (field.key or name for name, field in fields.items()))
            raise errors.FieldError(f"{where} has an unknown entry {key!r}; {known}")
        if value is not None:
            name, factor = names[key]
            read = fields[name].kind.read(what + key.replace("_", " ") if what else key, value)
            values[name] = read * factor if isinstance(read, float) and factor != 1.0 else read
    return values


def from_options(kind: type, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of options, which are numbers in their units already, by the names of a dataclass's fields; what is
    None is left out."""
    fields = {field.option or name: (name, field.per_option) for name, field in about(kind).items()}
    given = {option: value for option, value in values.items() if value is not None}
    return {
        fields[option][0]: value * fields[option][1] if isinstance(value, float) else value for option, value in given.items()
    }
