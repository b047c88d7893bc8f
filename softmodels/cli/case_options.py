"""Options of a command line that make a case, from the entries of its fields."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, MutableMapping
from typing import TYPE_CHECKING

import click

from geometries import Actuator
from geometries.options import device_options, device_told, field_option, flag
from measurement.units import exact_text
from softmodels.case.case import Case, entries
from softmodels.case.entries import MISSING
from softmodels.case.material_table import DEFAULT, material_from, material_options_of
from softmodels.materials.material import LAWS
from softmodels.materials.silicones import PRODUCTS

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

type Values = MutableMapping[str, object]
"""What click gives a command, by the names of the options."""


def material_options[Command: Callable[..., object]](
    command: Command, default: str | None = None, several: bool = False
) -> Command:
    """Add ``--material`` and an option for every parameter of every law to a click command.

    Args:
        command: The function or command.
        default: The silicone that stands in the help as the default; None for the default law.
        several: Whether ``--material`` may be given again.
    """
    for name, (text, laws) in reversed(material_options_of().items()):
        of = "all laws" if len(laws) == len(LAWS) else ", ".join(laws)
        command = click.option(flag(name), name, help=f"{text[0].upper()}{text[1:]} ({of}).")(command)
    text = (
        f"A law ({', '.join(LAWS)}), a silicone ({', '.join(PRODUCTS)}; perhaps with its source, such as "
        "ecoflex-00-30/liao-2021: see softmodels silicones) or a TOML file with a [material] table.  "
        f"[default: {default or f'neo-hookean, shear modulus {exact_text(DEFAULT.shear_modulus, "Pa")}'}]"
    )
    return click.option("--material", "material", metavar="NAME", multiple=several, help=text)(command)


def taken[Given: DataclassInstance](given: type[Given], values: Values) -> Given:
    """Take the options that a dataclass has as its fields out of a command's values."""
    return given(**{field.name: values.pop(field.name) for field in dataclasses.fields(given)})


def law_taken(values: Values) -> dict[str, object]:
    """Take the parameters of laws out of a command's values; None where not given."""
    return {name: values.pop(name) for name in material_options_of()}


@dataclasses.dataclass(frozen=True)
class CaseOptions:
    """The options with which one device's case is made.

    Attributes:
        device: Its class.
        silicone: The silicone when none is given; None for the default law.
    """

    device: type[Actuator]
    silicone: str | None = None

    def add[Command: Callable[..., object]](self, command: Command) -> Command:
        """Add them to a click command: the requested values, the device, its material, and all else a case has."""
        options = {name: list(entry.options()) for name, entry in entries().items()}
        first = [*options.pop("pressures_cm"), *options.pop("volumes_ml")]
        for option in reversed([option for group in options.values() for option in group]):
            command = field_option(option.name, option.about, option.default, option.metavar)(command)
        command = device_options(self.device)(material_options(command, self.silicone))
        for option in reversed(first):
            command = field_option(option.name, option.about, option.default, option.metavar)(command)
        return command

    def case(self, values: Values) -> Case:
        """The case of a command's values.

        Raises:
            CaseError and what else is in `softmodels.case.errors.INPUT_ERRORS`: Values that make no case.
        """
        law, named = law_taken(values), values.pop("material")
        assert named is None or isinstance(named, str)
        read = {name: entry.take(values) for name, entry in entries().items()}
        given = {name: value for name, value in read.items() if value is not MISSING}
        return Case(
            name=self.device.stem,
            actuator=device_told(self.device, values),
            material=material_from(self.silicone if named is None else named, law),
            **given,
        )
