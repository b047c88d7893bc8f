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
from softmodels.materials.material import LAWS, Material, MaterialError, parameter_fields
from softmodels.materials.silicones import PRODUCTS, silicone_called

DEFAULT = NeoHookean(shear_modulus=30e3)
CONVENTION = "convention"
"""Key that says how a law's parameters are meant, where there are several ways."""
FITTED = "fitted_stretch"
"""Key of the range of stretch that a law was fitted over."""


def material_options_of() -> dict[str, tuple[str, list[str]]]:
    """Help and laws of everything that a material's table may hold, by name: fields first, then what stands in for them."""
    entries: dict[str, tuple[str, list[str]]] = {}
    for law in LAWS.values():
        for field in parameter_fields(law):
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
        if mixed := _mixed(given):
            flags = " and ".join(map(_flag, mixed))
            raise MaterialError(
                f"the silicone {law} has a law and parameters of its own, and {flags} would mix another with them; leave out "
                f"{flags}, or name a law in place of the silicone, such as --material yeoh"
            )
    elif law.endswith(".toml") or Path(law).is_file():
        return _from_file(law, given)
    else:
        known = known_are(law, [*LAWS, *PRODUCTS])
        raise MaterialError(f"material {law!r} is neither a law, a silicone nor a TOML file; {known}")
    return from_table({**table, **given})


def _from_file(file: object, changes: Mapping[str, object]) -> Material:
    """The material of a TOML file, such as ``fitted.toml``, perhaps with another Poisson's ratio."""
    if not isinstance(file, str) or not file:
        raise MaterialError(f"material file {file!r} is no file's name; write it like file = 'results/fit/fitted.toml'")
    if mixed := _mixed(changes):
        raise MaterialError(
            f"material file {file}: it holds the law and its parameters already; delete {' and '.join(mixed)} beside it, or "
            "delete the file and name a law"
        )
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
    for field in parameter_fields(material):
        value, unit = getattr(material, field.name), field.metadata["unit"]
        if isinstance(value, tuple):
            table[field.name] = [text(v, unit) if unit else v for v in value]
        else:
            table[field.name] = text(value, unit) if unit else value
    if material.conventions:
        table[CONVENTION] = material.conventions[0]  # the same numbers read in the other way are another rubber
    if material.fitted_stretch is not None:
        table[FITTED] = list(material.fitted_stretch)
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
        if mixed := _mixed(values):
            names = " and ".join(mixed)
            raise MaterialError(
                f"silicone = {silicone!r} has a law and parameters of its own, and {names} would mix another with them; delete "
                f"{names} for the silicone, or delete silicone for a law of your own"
            )
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
    fitted = _range(name, values.pop(FITTED, None))
    fields = {field.name: field for field in parameter_fields(law)}
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
    made = law.from_values(parameters, convention)
    return made if fitted is None else dataclasses.replace(made, fitted_stretch=fitted)


def _range(law: str, value: object) -> tuple[float, float] | None:
    if value is None:
        return None
    if not isinstance(value, list | tuple) or len(value) != 2 or not all(isinstance(v, int | float) for v in value):
        raise MaterialError(f"{law}: {FITTED} = {value!r} is no range of stretch; write it like {FITTED} = [1.02, 3.0]")
    return float(value[0]), float(value[1])


def _mixed(beside: Mapping[str, object]) -> list[str]:
    """What beside a silicone's name or a material's file would make a mixture of two materials: all but Poisson's ratio."""
    return [name for name in beside if name != "poisson"]


def _many(law: str, key: str, value: object, unit: str) -> tuple[float, ...]:
    parts = value.split(",") if isinstance(value, str) else value
    return tuple(_number(law, key, part, unit) for part in (parts if isinstance(parts, list | tuple) else [parts]))


def _number(law: str, key: str, value: object, unit: str) -> float:
    try:
        return Quantity(unit).read(f"{law}: {key}", value)
    except FieldError as error:
        raise MaterialError(str(error)) from None
