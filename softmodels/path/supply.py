"""Air supply by a syringe on a T-junction with the column and the device, with the compressible gas between them.

The syringe's stroke S is the volume its piston has swept. It pushes the gas that filled syringe, tubes and cavity at ambient
pressure; together they held G = dead + syringe + cavity at rest. With p = (P + ambient) / ambient and the exponent n (1
isothermal, 1.4 adiabatic) the gas law is

    p^(1/n) (G - S + V - V0) = G (1 - leak S)

so S is a function of cavity volume and pressure: a control like any other, whose line in the plane is the gas law's
tangent. A very large G gives pressure control (S/G determines P), an incompressible fluid volume control (S = V - V0).
"""

from __future__ import annotations

import dataclasses
import math
from typing import ClassVar

from softmodels.common import errors
from softmodels.common.errors import Spoken
from softmodels.common.names import Registry
from softmodels.common.schema import Choice, Quantity, about, doubt_of, field_of, settle
from softmodels.path.points import Supply

# ----------------------------------------------------------------------------------------------------------------------
# Air supplies in a case, where neither the pressure nor the volume itself is prescribed.
#
# A supply is a subclass of `AirSupply`, also in a user's file: its fields, made by `softmodels.common.schema`, are its entries
# in a case's table ``[supply]`` and its options, and `AirSupply.control` returns the quantity that the path controls.
# `register` makes it available to case files and command lines by name.


class SupplyError(Spoken, ValueError):
    """An invalid supply; the message is for the user."""


@dataclasses.dataclass(frozen=True)
class AirSupply:
    """A supply driven by strokes: volumes in m3 that it displaces or admits.

    Attributes:
        name: What case files (``kind``) and ``--supply`` call it, and sentences too.
        its_gas: What its gas is called where it has a limit point; the gas of the supply if empty.
        gentler: What else can be taken where its stroke has a limit point, such as "a smaller bottle"; empty if nothing.
        in_time: Whether series in time drive it (`softmodels.path.air_flow`) instead of strokes.

    Raises:
        SupplyError: From the constructor, if its fields make no supply.
    """

    name: ClassVar[str]
    its_gas: ClassVar[str] = ""
    gentler: ClassVar[str] = ""
    in_time: ClassVar[bool] = False

    def __post_init__(self) -> None:
        settle(self, SupplyError)
        self.check()

    @property
    def doubt(self) -> str:
        """Return a sentence on an implausible value; empty if none."""
        return doubt_of(self)

    def check(self) -> None:
        """Raise `SupplyError` for inconsistent fields."""

    def check_strokes(self, largest: float, cavity: float) -> None:
        """Raise `SupplyError` for a stroke that is out of range.

        Args:
            largest: Largest stroke requested in m3.
            cavity: The whole device's cavity at rest in m3.
        """

    def control(self, cavity: float, pressure_unit: float, volume_unit: float) -> Supply:
        """Return the stroke as the requested quantity of a path.

        Args:
            cavity: The whole device's cavity at rest in m3.
            pressure_unit: Pa in one dimensionless pressure.
            volume_unit: m3 of the whole device in one dimensionless volume.
        """
        raise NotImplementedError

    @property
    def stores_energy(self) -> bool:
        """Whether `gas_energy` returns the work done on the supply's gas."""
        return False

    def gas_energy(self, stroke: float, added: float, pressure: float, cavity: float) -> float:
        """Return the work in J stored in the supply's gas, relative to ambient pressure.

        Args:
            stroke, added: Stroke and added volume of the cavity in m3.
            pressure: Gauge pressure in Pa.
            cavity: Cavity at rest in m3.
        """
        raise NotImplementedError


def _name_options(supply: type[AirSupply]) -> None:
    """Say how messages spell the options of a supply."""
    errors.call(f"supply {supply.name}", f"supply={supply.__name__}(...)")
    for name, field in about(supply).items():
        if field.option:
            errors.call(field.option.replace("_", "-"), name)


SUPPLIES: Registry[type[AirSupply]] = Registry("supply", lambda supply: supply.name, made_known=_name_options)
"""Every supply by its name."""
register_supply = SUPPLIES.register


GASES = {"isothermal": 1.0, "adiabatic": 1.4, "liquid": math.inf}
"""Exponent of the gas law by name; a liquid is incompressible."""
AMBIENT = 101.325e3


@register_supply
@dataclasses.dataclass(frozen=True)
class Syringe(AirSupply):
    """A syringe and its tubes; SI units.

    Attributes:
        syringe: Volume of the syringe in m3 when its piston is drawn back, which is the largest stroke.
        dead_volume: Volume of tubes and T-junction in m3.
        ambient: Absolute pressure outside in Pa, at which everything was filled.
        gas: One of `GASES`.
        leak: Share of the gas's mass lost per m3 of stroke, counted from the mass at rest: at the stroke S the mass is
            1 - leak S of what it was. So it is the leak of a piston moved at a steady rate.
    """

    syringe: float = field_of(Quantity("m^3"), "volume of the syringe, the largest stroke", 20e-6, usual=0.01)
    dead_volume: float = field_of(Quantity("m^3"), "volume of tubes and T-junction", 5e-6, usual=0.01)
    ambient: float = field_of(Quantity("Pa"), "absolute ambient pressure, at which everything was filled", AMBIENT)
    gas: str = field_of(Choice(tuple(GASES)), "gas law", "isothermal")
    leak: float = field_of(
        Quantity(), "fraction of the gas's mass lost per volume of stroke, such as 0.002 per ml", 0.0,
        key="leak_per_m3", option="leak_per_ml", per_option=1e6,
    )  # fmt: skip
    name: ClassVar[str] = "syringe"
    its_gas: ClassVar[str] = "the gas in syringe and tubes"
    gentler: ClassVar[str] = "a smaller --dead-volume or --gas liquid"

    def check(self) -> None:
        for name, value, least in (("syringe", self.syringe, True), ("dead volume", self.dead_volume, False),
                                   ("ambient pressure", self.ambient, True), ("leak", self.leak, False)):  # fmt: skip
            if value < 0 or (least and value == 0):
                raise SupplyError(f"the {name} is {value:g}; it must be {'above' if least else 'at least'} zero")
        if self.leak * self.syringe >= 1:
            raise SupplyError(
                f"a leak of {self.leak * 1e-6:g} per ml loses all gas within one stroke; give a smaller one, "
                f"such as 0.002 per ml"
            )
        if self.gas == "liquid" and self.leak:
            raise SupplyError("a leak applies only to a gas; leave it out with a liquid")

    def check_strokes(self, largest: float, cavity: float) -> None:
        if largest > self.syringe * (1 + 1e-9):
            raise SupplyError(
                f"a stroke of {largest * 1e6:g} ml exceeds the volume of the "
                f"syringe, {self.syringe * 1e6:g} ml; use a larger one (--syringe)"
            )
        if self.leak * self.gas_at_rest(cavity) >= 1:
            raise SupplyError(
                "the leak loses all gas before the cavity is filled; it is a fraction per volume of stroke, such as 0.005 per "
                "ml (--leak-per-ml)"
            )

    @property
    def stores_energy(self) -> bool:
        return not self.leak

    def gas_at_rest(self, cavity: float) -> float:
        """Return the volume in m3 of all gas at rest, with a cavity of so many m3."""
        return self.syringe + self.dead_volume + cavity

    def control(self, cavity: float, pressure_unit: float, volume_unit: float) -> Stroke:
        """Return the stroke as what a path is asked for.

        Args:
            cavity: The whole device's cavity at rest in m3.
            pressure_unit: Pa in one dimensionless pressure.
            volume_unit: m3 of the whole device in one dimensionless volume.
        """
        return Stroke(
            cavity / volume_unit, self.gas_at_rest(cavity) / volume_unit, self.ambient / pressure_unit,
            1 / GASES[self.gas], self.leak * volume_unit,
        )  # fmt: skip

    def gas_energy(self, stroke: float, added: float, pressure: float, cavity: float) -> float:
        """Return the work in J stored in the gas relative to ambient pressure, without a leak.

        The piston's work is the integral of P dS; what is not stored in the rubber is here (isothermal: free energy).

        Args:
            stroke, added: Stroke and added volume of the cavity in m3.
            pressure: Gauge pressure in Pa.
            cavity: Cavity at rest in m3.
        """
        if self.gas == "liquid":
            return 0.0
        total = self.gas_at_rest(cavity)
        now = total - stroke + added
        moved = self.ambient * (now - total)
        if self.gas == "isothermal":
            return self.ambient * total * math.log(total / now) + moved
        return ((pressure + self.ambient) * now - self.ambient * total) / (GASES[self.gas] - 1) + moved


@dataclasses.dataclass(frozen=True)
class Stroke(Supply):
    """The syringe's stroke as a function of cavity volume and pressure, dimensionless.

    Attributes:
        rest: Cavity volume at rest.
        gas: All gas at rest.
        ambient: Ambient pressure.
        power: 1/n of the gas law.
        leak: Share of mass lost per unit of stroke.
    """

    rest: float
    gas: float
    ambient: float
    power: float
    leak: float
    name: ClassVar[str] = "stroke"

    def value(self, V: float, P: float) -> float:
        squeezed = max(1 + P / self.ambient, 1e-6) ** self.power
        return (squeezed * (self.gas + V - self.rest) - self.gas) / (squeezed - self.leak * self.gas)

    def slopes(self, V: float, P: float) -> tuple[float, float]:
        ratio = max(1 + P / self.ambient, 1e-6)
        squeezed, lost = ratio**self.power, self.leak * self.gas
        rate = self.power * squeezed / ratio / self.ambient
        left = squeezed - lost
        return squeezed / left, rate * self.gas * (1 - self.leak * (self.gas + V - self.rest)) / left**2

    @property
    def weight(self) -> float:
        """Weight with which an error of the stroke counts as one of pressure or volume, for any amount of gas."""
        return 1 / (1 + self.power * self.gas / self.ambient)
