"""What a case says of the supply that drives the air, where that is neither the pressure nor the volume itself.

A supply is one class below `AirSupply`, also in a file of one's own: its fields, made by `geometries.fields`, are its entries
in a case's table ``[supply]`` and its options, and `AirSupply.control` gives the path what it follows. `register` lets case
files and command lines find it by its name.
"""

from __future__ import annotations

import dataclasses
from typing import ClassVar

from geometries.fields import about, doubt_of, settle
from measurement import wording
from measurement.arguments import checked
from measurement.wording import Spoken
from softmodels.path.quantities import Supply


class SupplyError(Spoken, ValueError):
    """An impossible supply; the message is a sentence for the user."""


@dataclasses.dataclass(frozen=True)
class AirSupply:
    """A supply that is driven by strokes: volumes in m3 that it displaces, or lets in.

    Attributes:
        name: What case files (``kind``) and ``--supply`` call it, and sentences too.
        its_gas: What its gas is called where it has a limit point; the gas of the supply if empty.
        gentler: What else can be taken where its stroke has a limit point, such as "a smaller bottle"; empty if nothing.

    Raises:
        SupplyError: From the constructor, if its fields make no supply.
    """

    name: ClassVar[str]
    its_gas: ClassVar[str] = ""
    gentler: ClassVar[str] = ""

    def __post_init__(self) -> None:
        settle(self, SupplyError)
        self.check()

    @property
    def doubt(self) -> str:
        """Which of its numbers is hardly meant: a sentence, empty if none."""
        return doubt_of(self)

    def check(self) -> None:
        """Raise `SupplyError` for fields that do not go together."""

    def check_strokes(self, largest: float, cavity: float) -> None:
        """Raise `SupplyError` for a stroke that it cannot make.

        Args:
            largest: Largest stroke requested in m3.
            cavity: The whole device's cavity at rest in m3.
        """

    def control(self, cavity: float, pressure_unit: float, volume_unit: float) -> Supply:
        """The stroke as what a path is asked for.

        Args:
            cavity: The whole device's cavity at rest in m3.
            pressure_unit: Pa in one dimensionless pressure.
            volume_unit: m3 of the whole device in one dimensionless volume.
        """
        raise NotImplementedError

    @property
    def stores_energy(self) -> bool:
        """Whether `gas_energy` accounts for the work of the supply's gas."""
        return False

    def gas_energy(self, stroke: float, added: float, pressure: float, cavity: float) -> float:
        """Work in J that the supply's gas has taken up against the surroundings.

        Args:
            stroke, added: Stroke and added volume of the cavity in m3.
            pressure: Gauge pressure in Pa.
            cavity: Cavity at rest in m3.
        """
        raise NotImplementedError


SUPPLIES: dict[str, type[AirSupply]] = {}
"""Every supply by its name."""


def register[Class: type[AirSupply]](supply: Class) -> Class:
    """Let case files and command lines find a supply by its name; a class decorator.

    Raises:
        ValueError: Another supply has this name.
    """
    known = SUPPLIES.get(supply.name, supply)
    if (known.__module__, known.__qualname__) != (supply.__module__, supply.__qualname__):
        raise ValueError(f"there is a supply of the name {supply.name!r} already: {known.__name__}")
    SUPPLIES[supply.name] = checked(supply)
    wording.call(f"supply {supply.name}", f"supply={supply.__name__}(...)")
    for name, field in about(supply).items():
        if field.option:
            wording.call(field.option.replace("_", "-"), name)
    return supply
