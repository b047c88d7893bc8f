"""Materials as text: options of a command line, tables of a TOML file, names of the library."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import click

from measurement.toml_file import TomlError, read_toml
from measurement.units import UnitError, brief, exact_text, quantity
from softmodels.materials.laws import LAWS, Material, MaterialError, NeoHookean, Ogden
from softmodels.materials.silicones import PRODUCTS, silicone_called

DEFAULT = NeoHookean(shear_modulus=30e3)
CONVENTIONS = ("mu/alpha", "2mu/alpha^2")
# Names that stand in for a law's own parameters: law, unit, help.
ALIASES = {
    "young": ("neo-hookean", "Pa", "Young's modulus, in place of the shear modulus"),
    "d1": ("neo-hookean", "Pa", "the thesis' D1 = lambda/2, with --c1 = mu/2, in place of modulus and Poisson's ratio"),
    "convention": ("ogden", "", "how mu and alpha are meant: W = sum mu/alpha (...) or sum 2mu/alpha^2 (...)"),
}


def material_options(command: Callable[..., Any], default: str | None = None) -> Callable[..., Any]:
    """Add ``--material`` and an option for every parameter of every law to a click command.

    Args:
        command: The function or command.
        default: The silicone that stands in the help as the default; None for `DEFAULT`.
    """
    owners: dict[str, list[str]] = {}
    texts: dict[str, str] = {}
    for law in LAWS.values():
        for field in dataclasses.fields(law):
            owners.setdefault(field.name, []).append(law.name)
            texts.setdefault(field.name, field.metadata["help"])
    for name, (owner, _, text) in ALIASES.items():
        owners.setdefault(name, []).append(owner)
        texts.setdefault(name, text)
    for name in reversed(owners):
        of = "all laws" if len(owners[name]) == len(LAWS) else ", ".join(owners[name])
        command = click.option(_flag(name), name, help=f"{texts[name][0].upper()}{texts[name][1:]} ({of}).")(command)
    text = (
        f"A law ({', '.join(LAWS)}), a silicone ({', '.join(PRODUCTS)}; perhaps with its source, such as "
        "ecoflex-00-30/liao-2021: see softmodels silicones) or a TOML file with a [material] table.  "
        f"[default: {default or f'neo-hookean, shear modulus {exact_text(DEFAULT.shear_modulus, "Pa")}'}]"
    )
    return click.option("--material", "material", metavar="NAME", help=text)(command)


def material_names() -> list[str]:
    """Names of the parameters that `material_options` adds."""
    return [*dict.fromkeys(field.name for law in LAWS.values() for field in dataclasses.fields(law)), *ALIASES]


def _flag(name: str) -> str:
    return f"--{name.replace('_', '-')}"


def material_from(name: str | None, values: Mapping[str, Any]) -> Material:
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
    law = "neo-hookean" if name is None else name
    if law in LAWS:
        if law == "neo-hookean" and not {"shear_modulus", "young", "c1", "d1"} & set(given):
            given["shear_modulus"] = exact_text(DEFAULT.shear_modulus, "Pa")
        return from_table({"law": law, **given})
    if silicone := silicone_called(law):
        table = to_table(silicone.material)
    elif law.endswith(".toml") or Path(law).is_file():
        try:
            return from_table({**_read_file(Path(law)), **given})
        except MaterialError as error:
            raise MaterialError(f"material file {law}: {error}") from None
    else:
        known = ", ".join([*LAWS, *PRODUCTS])
        raise MaterialError(f"material {law!r} is neither a law, a silicone nor a TOML file; known are {known}")
    return from_table({**table, **given})


def _read_file(path: Path) -> dict[str, Any]:
    try:
        table = read_toml(path)
    except TomlError as error:
        raise MaterialError(f"it {error}") from None
    if not isinstance(table.get("material"), dict):
        raise MaterialError("it has no [material] table")
    return dict(table["material"])


def to_table(material: Material, text: Callable[[float, str], str] = exact_text) -> dict[str, Any]:
    """A material as a TOML table: its law and parameters with units. `from_table` gives back an equal one.

    ``text`` writes the quantities; `measurement.units.readable` is for people.
    """
    table: dict[str, Any] = {"law": material.name}
    for field in dataclasses.fields(material):
        value, unit = getattr(material, field.name), field.metadata["unit"]
        if isinstance(value, tuple):
            table[field.name] = [text(v, unit) if unit else v for v in value]
        else:
            table[field.name] = text(value, unit) if unit else value
    if isinstance(material, Ogden):
        table["convention"] = CONVENTIONS[0]  # the same numbers read in the other way are another rubber
    return table


def from_table(table: Mapping[str, Any]) -> Material:
    """The material of a TOML table: ``law`` (or ``silicone``) and its parameters.

    Raises:
        MaterialError: See `material_from`.
    """
    values = dict(table)
    if "silicone" in values:
        silicone = values.pop("silicone")
        found = silicone_called(silicone) if isinstance(silicone, str) else None
        if found is None:
            known = ", ".join(PRODUCTS)
            raise MaterialError(
                f"silicone {silicone!r} is unknown; known are {known}, and their sources (softmodels silicones)"
            )
        return from_table({**to_table(found.material), **values})
    name = values.pop("law", None)
    if not isinstance(name, str) or name not in LAWS:
        raise MaterialError(f"law {name!r} is unknown; known are {', '.join(LAWS)}")
    law = LAWS[name]
    fields = {field.name: field for field in dataclasses.fields(law)}
    if law is NeoHookean and values.keys() & {"young", "c1", "d1"}:
        return _neo_hookean(values)
    convention = values.pop("convention", CONVENTIONS[0]) if law is Ogden else CONVENTIONS[0]
    if convention not in CONVENTIONS:
        raise MaterialError(f"ogden: convention {convention!r} is not one of {', '.join(CONVENTIONS)}")
    parameters = {}
    for key, value in values.items():
        if key not in fields:
            raise MaterialError(f"{name} has no parameter {key!r}; it has {', '.join(fields)}")
        parameters[key] = _read(name, key, value, fields[key].metadata["unit"], many=law is Ogden and key != "poisson")
    for key, field in fields.items():
        if key not in parameters and field.default is dataclasses.MISSING:
            raise MaterialError(f"{name} needs {key} ({field.metadata['help']}); give it with {_flag(key)}")
    if convention == CONVENTIONS[1]:
        return Ogden.from_two_mu(**parameters)
    return law(**parameters)


def _neo_hookean(values: Mapping[str, Any]) -> NeoHookean:
    """From Young's modulus, or from the thesis' C1 and D1."""
    read = {key: _read("neo-hookean", key, value, "" if key == "poisson" else "Pa") for key, value in values.items()}
    if read.keys() <= {"young", "poisson"} and "young" in read:
        if read.get("poisson") == -1.0:
            raise MaterialError("neo-hookean: poisson = -1 is outside -1 to 0.5")  # ahead of a division by zero
        return NeoHookean.from_young(**read)
    if read.keys() == {"c1", "d1"}:
        return NeoHookean.from_c1_d1(**read)
    raise MaterialError(
        f"neo-hookean takes shear_modulus and poisson, or young and poisson, or c1 and d1; got {', '.join(sorted(read))}"
    )


def _read(law: str, key: str, value: Any, unit: str, many: bool = False) -> Any:
    if many:
        parts = value.split(",") if isinstance(value, str) else value
        if not isinstance(parts, list | tuple):
            parts = [parts]
        return tuple(_read(law, key, part, unit) for part in parts)
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        raise MaterialError(f"{law}: {key} is {brief(value)}; it must be a number" + (" with a unit" if unit else ""))
    try:
        return quantity(value, unit)
    except UnitError as error:
        raise MaterialError(f"{law}: {key}: {error}") from None
