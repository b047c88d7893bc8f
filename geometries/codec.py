"""Between dataclasses whose fields know their kind and tables of a settings file, without losing a bit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from geometries.errors import FieldError
from geometries.fields import about
from geometries.kinds import Text
from measurement.units import exact_text
from measurement.wording import known_are


def to_table(thing: Any, text: Text = exact_text) -> dict[str, Any]:
    """The fields of a value for a TOML table.

    Args:
        thing: A value of a dataclass whose fields come from `geometries.fields`.
        text: How quantities are written: `measurement.units.exact_text`, so that `from_table` gives back the same numbers to
            the last bit, unless another is given, such as `readable` for people.

    Returns:
        Lengths and the like as texts with a unit ("20 mm"); pure numbers, choices, texts and lists as they are. What is left
        open is left out.
    """
    written = {field.key or name: field.kind.write(getattr(thing, name), text) for name, field in about(thing).items()}
    return {name: value for name, value in written.items() if value is not None}


def from_table(kind: type, table: Mapping[str, Any], where: str, what: str = "") -> dict[str, Any]:
    """The values of a table by the names of a dataclass's fields; what is None is left out.

    Args:
        kind: The dataclass.
        table: Values by the names that `to_table` writes, or by those of the options.
        where: What the table is called, such as ``"[sheet]"``.
        what: What is put before the name of an entry in messages, such as ``"sheet "``.

    Raises:
        FieldError: An unknown entry, or a value that is not of its field's kind.
    """
    fields = about(kind)
    names = {field.key or name: (name, 1.0) for name, field in fields.items()}
    names |= {field.option: (name, field.per_option) for name, field in fields.items() if field.option}
    values = {}
    for key, value in table.items():
        if key not in names:
            known = known_are(key, (field.key or name for name, field in fields.items()))
            raise FieldError(f"{where} has an unknown entry {key!r}; {known}")
        if value is not None:
            name, factor = names[key]
            read = fields[name].kind.read(what + key.replace("_", " ") if what else key, value)
            values[name] = read * factor if isinstance(read, float) and factor != 1.0 else read
    return values


def from_options(kind: type, values: Mapping[str, Any]) -> dict[str, Any]:
    """The values of options, which are numbers in their units already, by the names of a dataclass's fields.

    Args:
        kind: The dataclass.
        values: By the names of the options; what is None is left out.
    """
    fields = {field.option or name: (name, field.per_option) for name, field in about(kind).items()}
    given = {option: value for option, value in values.items() if value is not None}
    return {
        fields[option][0]: value * fields[option][1] if isinstance(value, float) else value
        for option, value in given.items()
    }
