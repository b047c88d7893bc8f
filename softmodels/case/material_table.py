"""Materials as text: values of a command line, tables of a TOML file, names of the library."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path

from geometries.errors import FieldError
from geometries.kinds import Quantity, Text
from measurement.toml_file import TomlError, read_toml
from measurement.units import exact_text
from measurement.wording import known_are
from softmodels.materials.laws import NeoHookean
from softmodels.materials.material import LAWS, Material, MaterialError
from softmodels.materials.silicones import PRODUCTS, silicone_called

DEFAULT = NeoHookean(shear_modulus=30e3)
CONVENTION = "convention"
"""Key that says how a law's parameters are meant, where there are several ways."""


def material_options_of() -> dict[str, tuple[str, list[str]]]:
    """Help and laws of everything that a material's table may hold, by name: fields first, then what stands in for them."""
    entries: dict[str, tuple[str, list[str]]] = {}
    for law in LAWS.values():
        for field in dataclasses.fields(law):
            entries.setdefault(field.name, (field.metadata["help"], []))[1].append(law.name)
    for law in LAWS.values():
        for name, (_, text) in law.alternatives.items():
            entries.setdefault(name, (text, []))[1].append(law.name)
    for law in LAWS.values():
        if law.conventions:
            entries.setdefault(CONVENTION, (law.convention_help, []))[1].append(law.name)
    return entries


def _flag(name: str) -> str:
    return f"--{name.replace('_', '-')}"


def material_from(name: str | None, values: Mapping[str, object]) -> Material:
    """The material of a command line.

    Args:
        name: A law, a silicone, a TOML file, or None for the default law.
        values: Parameters as texts with units by name; None where not given.

    Raises:
        MaterialError: An unknown name, a parameter that is missing, foreign or impossible.
    """
    given = {key: value for key, value in values.items() if value is not None}
    if name is None and not given:
        return DEFAULT
    law = DEFAULT.name if name is None else name
    if law in LAWS:
        if law == DEFAULT.name and not {*DEFAULT.parameters, *DEFAULT.alternatives} & set(given):
            given["shear_modulus"] = exact_text(DEFAULT.shear_modulus, "Pa")
        return from_table({"law": law, **given})
    if silicone := silicone_called(law):
        table = to_table(silicone.material)
    elif law.endswith(".toml") or Path(law).is_file():
        return _from_file(law, given)
    else:
        known = known_are(law, [*LAWS, *PRODUCTS])
        raise MaterialError(f"material {law!r} is neither a law, a silicone nor a TOML file; {known}")
    return from_table({**table, **given})


def _from_file(file: object, changes: Mapping[str, object]) -> Material:
    """The material of a TOML file, such as ``fitted.toml``, with some of its parameters changed."""
    if not isinstance(file, str) or not file:
        raise MaterialError(f"material file {file!r} is no file's name; write it like file = 'results/fit/fitted.toml'")
    if changes.keys() & {"law", "silicone"}:
        raise MaterialError(f"material file {file}: it names the law already; leave out law and silicone beside it")
    try:
        return from_table({**_read_file(Path(file)), **changes})
    except MaterialError as error:
        raise MaterialError(f"material file {file}: {error}") from None


def _read_file(path: Path) -> dict[str, object]:
    try:
        table = read_toml(path)
    except TomlError as error:
        raise MaterialError(f"it {error}") from None
    if not isinstance(table.get("material"), dict):
        raise MaterialError("it has no [material] table")
    return dict(table["material"])


def to_table(material: Material, text: Text = exact_text) -> dict[str, object]:
    """A material as a TOML table: its law and parameters with units. `from_table` gives back an equal one.

    ``text`` writes the quantities; `measurement.units.readable` is for people.
    """
    table: dict[str, object] = {"law": material.name}
    for field in dataclasses.fields(material):
        value, unit = getattr(material, field.name), field.metadata["unit"]
        if isinstance(value, tuple):
            table[field.name] = [text(v, unit) if unit else v for v in value]
        else:
            table[field.name] = text(value, unit) if unit else value
    if material.conventions:
        table[CONVENTION] = material.conventions[0]  # the same numbers read in the other way are another rubber
    return table


def from_table(table: Mapping[str, object]) -> Material:
    """The material of a TOML table: ``law`` (or ``silicone``, or the ``file`` of a fitted one) and its parameters.

    Raises:
        MaterialError: See `material_from`.
    """
    values = dict(table)
    if "file" in values:
        return _from_file(values.pop("file"), values)
    if "silicone" in values:
        silicone = values.pop("silicone")
        found = silicone_called(silicone) if isinstance(silicone, str) else None
        if found is None:
            known = known_are(silicone, PRODUCTS, ", and their sources (softmodels silicones)")
            raise MaterialError(f"silicone {silicone!r} is unknown; {known}")
        return from_table({**to_table(found.material), **values})
    if "law" not in values:
        known = f"a law (law = one of {', '.join(LAWS)})"
        raise MaterialError(
            f"the material names neither a silicone (silicone = '{next(iter(PRODUCTS))}') nor {known} nor a fitted one "
            "(file = 'fitted.toml')"
        )
    name = values.pop("law")
    if not isinstance(name, str) or name not in LAWS:
        raise MaterialError(f"law {name!r} is unknown; {known_are(name, LAWS)}")
    law = LAWS[name]
    fields = {field.name: field for field in dataclasses.fields(law)}
    convention = values.pop(CONVENTION, law.conventions[0]) if law.conventions else ""
    if not isinstance(convention, str) or (convention and convention not in law.conventions):
        raise MaterialError(f"{name}: convention {convention!r} is not one of {', '.join(law.conventions)}")
    parameters: dict[str, float | tuple[float, ...]] = {}
    for key, value in values.items():
        if key in fields:
            about = fields[key].metadata
            parameters[key] = (_many if about["many"] else _number)(name, key, value, about["unit"])
        elif key in law.alternatives:
            parameters[key] = _number(name, key, value, law.alternatives[key][0])
        else:
            raise MaterialError(f"{name} has no parameter {key!r}; it has {', '.join(fields)}")
    if not parameters.keys() & law.alternatives.keys():
        for key, field in fields.items():
            if key not in parameters and field.default is dataclasses.MISSING:
                raise MaterialError(f"{name} needs {key} ({field.metadata['help']}); give it with {_flag(key)}")
    return law.from_values(parameters, convention)


def _many(law: str, key: str, value: object, unit: str) -> tuple[float, ...]:
    parts = value.split(",") if isinstance(value, str) else value
    return tuple(_number(law, key, part, unit) for part in (parts if isinstance(parts, list | tuple) else [parts]))


def _number(law: str, key: str, value: object, unit: str) -> float:
    try:
        return Quantity(unit).read(f"{law}: {key}", value)
    except FieldError as error:
        raise MaterialError(str(error)) from None
