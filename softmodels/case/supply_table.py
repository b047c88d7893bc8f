"""The syringe as a TOML table and as options of the command line."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import click

from geometries.options import QuantityType
from measurement.units import UnitError, exact_text, number, quantity
from softmodels.path.syringe import AMBIENT, GASES, SupplyError, Syringe

UNITS = {"syringe": "m^3", "dead_volume": "m^3", "ambient": "Pa"}


MEANINGS = {
    "syringe": "volume of the syringe, which is the largest stroke",
    "dead_volume": "volume of tubes and T-junction",
    "ambient": "absolute pressure around, at which everything was filled",
    "gas": "how the gas is squeezed",
    "leak_per_m3": "share of the gas's mass lost per m^3 of stroke",
}
"""What the entries of a syringe's table are."""


def to_table(supply: Syringe, text: Callable[[float, str], str] = exact_text) -> dict[str, Any]:
    """A syringe as a TOML table; `from_table` gives back an equal one.

    ``text`` writes the quantities; `measurement.units.readable` is for people.
    """
    table: dict[str, Any] = {key: text(getattr(supply, key), unit) for key, unit in UNITS.items()}
    return {"kind": "syringe", **table, "gas": supply.gas, "leak_per_m3": supply.leak}


def from_table(table: Mapping[str, Any]) -> Syringe:
    """The syringe of a TOML table or of the command line's values; what is None or left out has its default.

    Raises:
        SupplyError: Unknown entries, wrong units or an impossible supply.
    """
    values = {key: value for key, value in table.items() if value is not None}
    if values.pop("kind", "syringe") != "syringe":
        raise SupplyError("the only supply with a table of its own is the syringe")
    if "leak_per_ml" in values:
        values["leak_per_m3"] = _number(values.pop("leak_per_ml")) * 1e6
    made: dict[str, Any] = {}
    for key, value in values.items():
        if key in UNITS:
            try:
                made[key] = quantity(value, UNITS[key])
            except UnitError as error:
                raise SupplyError(f"{key.replace('_', ' ')}: {error}") from None
        elif key == "leak_per_m3":
            made["leak"] = _number(value)
        elif key == "gas":
            made["gas"] = value
        else:
            raise SupplyError(f"the supply has an unknown entry {key!r}; known are {', '.join(to_table(Syringe()))}")
    return Syringe(**made)


def _number(value: Any) -> float:
    try:
        return number(value)
    except UnitError as error:
        raise SupplyError(f"the leak: {error}; it is the share of the gas lost per volume of stroke") from None


NAMES = ("syringe", "dead_volume", "ambient", "gas", "leak_per_ml")


def supply_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add ``--supply`` and the syringe's own options to a click command; all are None unless given."""
    default = Syringe()
    for flag, text in (
        ("--leak-per-ml", "Share of the gas's mass lost per ml of stroke, such as 0.002.  [default: 0]"),
        ("--gas", f"How the gas is squeezed: {', '.join(GASES)}.  [default: {default.gas}]"),
        ("--ambient", f"Absolute pressure around.  [default: {exact_text(AMBIENT, 'Pa')}]"),
        ("--dead-volume", "Volume of tubes and T-junction.  [default: 5ml]"),
        ("--syringe", "Volume of the syringe.  [default: 20ml]"),
    ):
        kind: Any = {"--leak-per-ml": QuantityType(""), "--gas": click.Choice(list(GASES))}.get(flag, str)
        command = click.option(flag, type=kind, help=text)(command)
    text = "Strokes of the syringe's piston in ml, in place of pressures, such as 0:20."
    command = click.option("--stroke-ml", metavar="SERIES", help=text)(command)
    text = "What drives the air: the pressure (or volume) itself, or a syringe on a T-junction."
    return click.option("--supply", type=click.Choice(["direct", "syringe"]), default=None, help=text)(command)


def supply_from(values: dict[str, Any]) -> Syringe | None:
    """Take the supply's values out of a command's and make it.

    Raises:
        SupplyError: Options of a syringe without one, or an impossible one.
    """
    kind, own = values.pop("supply"), {name: values.pop(name) for name in NAMES}
    given = [name for name, value in own.items() if value is not None]
    if kind != "syringe":
        if given:
            raise SupplyError(f"--{given[0].replace('_', '-')} belongs to a syringe; add --supply syringe")
        return None
    return from_table(own)
