"""Air supply by a syringe on a T-junction with the column and the device, with the compressible gas between them;
sources behind tubes and valves, in time.

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
import operator
from typing import ClassVar

from softmodels.common import errors, names, schema
from softmodels.common.lazy import scipy
from softmodels.mechanics.controls import Control
from softmodels.mechanics.system import State
from softmodels.path import stability

# ----------------------------------------------------------------------------------------------------------------------
# Air supplies in a case, where neither the pressure nor the volume itself is prescribed.
#
# A supply is a subclass of `AirSupply`, also in a user's file: its fields, made by `softmodels.common.schema`, are its entries
# in a case's table ``[supply]`` and its options, and `AirSupply.control` returns the quantity that the path controls.
# `register` makes it available to case files and command lines by name.


class SupplyError(errors.OptionMessage, ValueError):
    """An invalid supply; the message is for the user."""


@dataclasses.dataclass(frozen=True)
class AirSupply:
    """A supply driven by strokes: volumes in m3 that it displaces or admits.

    Attributes:
        name: What case files (``kind``) and ``--supply`` call it, and sentences too.
        its_gas: What its gas is called where it has a limit point; the gas of the supply if empty.
        gentler: What else can be taken where its stroke has a limit point, such as "a smaller bottle"; empty if nothing.
        in_time: Whether series in time drive it (`Source`) instead of strokes.

    Raises:
        SupplyError: From the constructor, if its fields make no supply.
    """

    name: ClassVar[str]
    its_gas: ClassVar[str] = ""
    gentler: ClassVar[str] = ""
    in_time: ClassVar[bool] = False

    def __post_init__(self) -> None:
        schema.settle(self, SupplyError)
        self.check()

    def check(self) -> None:
        """Raise `SupplyError` for inconsistent fields."""

    def check_strokes(self, largest: float, cavity: float) -> None:
        """Raise `SupplyError` for a largest stroke out of range, beside the whole device's cavity at rest; m3."""

    def control(self, cavity: float, pressure_unit: float, volume_unit: float) -> stability.Supply:
        """Return the stroke as the requested quantity of a path, by the whole device's cavity at rest in m3, Pa in one
        dimensionless pressure, and m3 of the whole device in one dimensionless volume."""
        raise NotImplementedError

    @property
    def stores_energy(self) -> bool:
        """Whether `gas_energy` returns the work done on the supply's gas."""
        return False

    def gas_energy(self, stroke: float, added: float, pressure: float, cavity: float) -> float:
        """Return the work in J stored in the supply's gas, relative to ambient pressure, at a stroke, an added volume and a
        cavity at rest in m3, and a gauge pressure in Pa."""
        raise NotImplementedError


def _name_options(supply: type[AirSupply]) -> None:
    """Say how messages spell the options of a supply, and ``help`` what its fields are."""
    schema.describe_fields(supply)
    errors.call(f"supply {supply.name}", f"supply={supply.__name__}(...)")
    for name, field in schema.about(supply).items():
        if field.option:
            errors.call(field.option.replace("_", "-"), name)


SUPPLIES: names.Registry[type[AirSupply]] = names.Registry("supply", operator.attrgetter("name"), made_known=_name_options)
"""Every supply by its name."""
register_supply = SUPPLIES.register

GASES = {"isothermal": 1.0, "adiabatic": 1.4, "liquid": math.inf}
"""Exponent of the gas law by name; a liquid is incompressible."""
AMBIENT_PRESSURE = 101.325e3


@register_supply
@dataclasses.dataclass(frozen=True)
class Syringe(AirSupply):
    """A syringe and its tubes; SI units. At the stroke S the mass of its gas is 1 - leak S of that at rest, as with a piston
    moved at a steady rate."""

    syringe: float = schema.field_of(schema.Quantity("m^3"), "volume of the syringe, the largest stroke", 20e-6, usual=0.01)
    dead_volume: float = schema.field_of(schema.Quantity("m^3"), "volume of tubes and T-junction", 5e-6, usual=0.01)
    ambient: float = schema.field_of(
        schema.Quantity("Pa"), "absolute ambient pressure, at which everything was filled", AMBIENT_PRESSURE
    )
    gas: str = schema.field_of(schema.Choice(tuple(GASES)), "gas law", "isothermal")
    leak: float = schema.field_of(
        schema.Quantity(), "fraction of the gas's mass lost per volume of stroke, such as 0.002 per ml", 0.0,
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
        return Stroke(
            cavity / volume_unit, self.gas_at_rest(cavity) / volume_unit, self.ambient / pressure_unit,
            1 / GASES[self.gas], self.leak * volume_unit,
        )  # fmt: skip

    def gas_energy(self, stroke: float, added: float, pressure: float, cavity: float) -> float:
        """Return the work in J stored in the gas relative to ambient pressure, without a leak; see `AirSupply.gas_energy`. The
        piston's work is the integral of P dS; what is not stored in the rubber is here (isothermal: free energy)."""
        if self.gas == "liquid":
            return 0.0
        total = self.gas_at_rest(cavity)
        now = total - stroke + added
        moved = self.ambient * (now - total)
        if self.gas == "isothermal":
            return self.ambient * total * math.log(total / now) + moved
        return ((pressure + self.ambient) * now - self.ambient * total) / (GASES[self.gas] - 1) + moved


@dataclasses.dataclass(frozen=True)
class Stroke(stability.Supply):
    """The syringe's stroke as a function of cavity volume and pressure, dimensionless: cavity and all gas at rest, ambient
    pressure, 1/n of the gas law, and the share of mass lost per unit of stroke."""

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


# ----------------------------------------------------------------------------------------------------------------------
# A source of pressure or gas behind valve, tube and leak.


@register_supply
@dataclasses.dataclass(frozen=True)
class Reservoir(AirSupply):
    """A source of pressure, and the valve, tube and leak between it and the device; SI units.

    Its pressure is a series of the load (``source_pressure``), and so is the opening of its valve (``valve``); or the series
    is the flow of a pump (``flow_ml_per_min``). Conductances are sonic conductances of ISO 6358.
    """

    tube_length: float = schema.field_of(
        schema.Length(zero=True), "length of the tube from the source to the device; 0 for none", 1.0
    )
    tube_bore: float = schema.field_of(schema.Length(), "inner diameter of that tube", 1e-3)
    conductance: float = schema.field_of(
        schema.Quantity("m^3/(s*Pa)"),
        "sonic conductance of valve or orifice before the tube, such as 0.1 l/(s*bar); 0 for none", 0.0,
        usual=1e-6,
    )  # fmt: skip
    critical_ratio: float = schema.field_of(schema.Quantity(), "critical pressure ratio of valve, orifice and leak", 0.3)
    max_flow: float = schema.field_of(
        schema.Quantity("m^3/s"), "maximum flow of the source at ambient pressure; 0 for no limit", 0.0, usual=0.1
    )
    dead_volume: float = schema.field_of(
        schema.Quantity("m^3"), "volume of fittings, beside that of the tube", 1e-6, usual=0.01
    )
    leak_conductance: float = schema.field_of(
        schema.Quantity("m^3/(s*Pa)"), "sonic conductance of a leak to the outside", 0.0, usual=1e-6
    )
    leak_length: float = schema.field_of(schema.Length(zero=True), "length of a laminar leak to the outside; 0 for none", 0.0)
    leak_bore: float = schema.field_of(schema.Length(), "inner diameter of the laminar leak", 1e-4)
    ambient: float = schema.field_of(
        schema.Quantity("Pa"), "absolute ambient pressure, at which everything was filled", AMBIENT_PRESSURE
    )
    gas: str = schema.field_of(schema.Choice(("isothermal", "adiabatic")), "gas law", "isothermal")
    name: ClassVar[str] = "reservoir"
    in_time: ClassVar[bool] = True

    def check(self) -> None:
        for name, value in (("conductance", self.conductance), ("leak conductance", self.leak_conductance),
                            ("maximum flow", self.max_flow), ("dead volume", self.dead_volume)):  # fmt: skip
            if value < 0.0:
                raise SupplyError(f"the {name} is {value:g}; it must be at least zero")
        if not self.ambient > 0.0:
            raise SupplyError(f"the ambient pressure is {self.ambient:g}; it must be above zero")
        if not 0.0 <= self.critical_ratio <= 0.9:
            raise SupplyError(f"the critical pressure ratio is {self.critical_ratio:g}; it must be from 0 to 0.9, such as 0.3")
        if self.leak_conductance and self.leak_length:
            raise SupplyError("leak_conductance and leak_length describe the leak twice; leave one of them out")
        if self.between is None:
            raise SupplyError(
                "nothing resists the flow from the source; give a tube (--tube-length, --tube-bore) or an orifice "
                "(--conductance), or request the pressure of the device itself without a supply"
            )

    @property
    def between(self) -> Resistance | None:
        """What is between the source and the device."""
        return resistance((self.tube_length, self.tube_bore), (self.conductance, self.critical_ratio))

    @property
    def leak(self) -> Resistance | None:
        """What is between the device and the outside: a laminar leak, or an orifice's."""
        return resistance((self.leak_length, self.leak_bore), (self.leak_conductance, self.critical_ratio))

    @property
    def tube(self) -> Tube | None:
        return Tube(self.tube_length, self.tube_bore) if self.tube_length else None

    @property
    def dead(self) -> float:
        """Volume in m3 of tube and fittings."""
        return self.dead_volume + math.pi / 4.0 * self.tube_bore**2 * self.tube_length

    def supplied(self, source: Source, pressure: float) -> tuple[float, float]:
        """Return the flow from the source into the device in Pa m3/s at a gauge pressure, and its derivative."""
        if source.flow is not None:
            return source.flow * self.ambient, 0.0
        assert self.between is not None
        flow, _, slope = self.between.flow(source.pressure + self.ambient, pressure + self.ambient)
        most = self.max_flow * self.ambient
        flow, slope = flow * source.opening, slope * source.opening
        return (most, 0.0) if most and flow > most else (flow, slope)

    def lost(self, pressure: float) -> tuple[float, float]:
        """Return the flow of the leak in Pa m3/s at a gauge pressure, and its derivative."""
        if self.leak is None:
            return 0.0, 0.0
        flow, slope, _ = self.leak.flow(pressure + self.ambient, self.ambient)
        return flow, slope

    def control(self, cavity: float, pressure_unit: float, volume_unit: float) -> Gas:
        return Gas(self, pressure_unit, volume_unit)


@dataclasses.dataclass(frozen=True)
class Source:
    """What a source does at a time: its gauge pressure in Pa and the opening of its valve, or its flow in m3/s at ambient."""

    pressure: float = 0.0
    opening: float = 1.0
    flow: float | None = None

    def toward(self, other: Source, share: float) -> Source:
        """Return what it does at a share of the time to another."""
        values = ((a, b) for a, b in zip(dataclasses.astuple(self), dataclasses.astuple(other), strict=True))
        return Source(*(None if a is None or b is None else a + share * (b - a) for a, b in values))  # type: ignore[arg-type]


# ----------------------------------------------------------------------------------------------------------------------
# Resistances: flow in Pa m3/s (pressure times volume, isothermal) between two absolute pressures in Pa, with its derivatives.


AIR_VISCOSITY = 1.81e-5
"""Dynamic viscosity of air at 20 °C in Pa s."""
DENSITY_AT_1_PA = 1.0 / (287.05 * 293.15)
"""Density of air in kg/m3 per Pa at 20 °C."""
REFERENCE_PRESSURE = 100e3
"""Absolute pressure in Pa to which a sonic conductance refers (ISO 6358)."""
MIN_LAMINAR_RATIO = 0.999
"""Ratio of the pressures above which an orifice counts as laminar: its flow is then linear."""
MAX_LAMINAR_REYNOLDS = 2300.0
"""Reynolds number above which Poiseuille's law for a tube is wrong."""
Flow = tuple[float, float, float]
"""Flow, and its derivatives by the pressure upstream and downstream."""


@dataclasses.dataclass(frozen=True)
class Tube:
    """Laminar flow of a gas through a tube (Poiseuille): proportional to the difference of the squares of the pressures."""

    length: float
    bore: float

    @property
    def factor(self) -> float:
        """Flow over the difference of the squares of the pressures."""
        return math.pi * self.bore**4 / (256.0 * AIR_VISCOSITY * self.length)

    def flow(self, p1: float, p2: float) -> Flow:
        k = self.factor
        return k * (p1 - p2) * (p1 + p2), 2.0 * k * p1, -2.0 * k * p2

    def reynolds(self, flow: float) -> float:
        """Return the Reynolds number of a flow in Pa m3/s."""
        return 4.0 * abs(flow) * DENSITY_AT_1_PA / (math.pi * self.bore * AIR_VISCOSITY)


@dataclasses.dataclass(frozen=True)
class Orifice:
    """Flow through an orifice or a valve (ISO 6358) of a sonic conductance C in m3/(s Pa): choked below the critical ratio b
    of the pressures, else an ellipse."""

    conductance: float
    ratio: float

    def flow(self, p1: float, p2: float) -> Flow:
        if p2 > p1:
            back, upstream, downstream = self.flow(p2, p1)
            return -back, -downstream, -upstream
        r, k = p2 / p1, self.conductance * REFERENCE_PRESSURE
        if r <= self.ratio:
            return k * p1, k, 0.0
        at = min(r, MIN_LAMINAR_RATIO)
        share = (at - self.ratio) / (1.0 - self.ratio)
        value = math.sqrt(1.0 - share * share)
        slope = -share / (value * (1.0 - self.ratio))
        if r > MIN_LAMINAR_RATIO:
            slope = -value / (1.0 - MIN_LAMINAR_RATIO)
            value = (1.0 - r) * -slope
        return k * p1 * value, k * (value - r * slope), k * slope


@dataclasses.dataclass(frozen=True)
class InSeries:
    """An orifice and behind it a tube."""

    orifice: Orifice
    tube: Tube

    def flow(self, p1: float, p2: float) -> Flow:
        if p1 == p2:
            between = p1
        else:
            between = scipy.optimize.brentq(
                lambda p: self.orifice.flow(p1, p)[0] - self.tube.flow(p, p2)[0], min(p1, p2), max(p1, p2),
                xtol=1e-10, rtol=1e-15,
            )  # fmt: skip
        _, from_1, o = self.orifice.flow(p1, between)
        flow, t, from_2 = self.tube.flow(between, p2)
        return flow, from_1 * t / (t - o), -from_2 * o / (t - o)


Resistance = Tube | Orifice | InSeries


def resistance(tube: tuple[float, float], orifice: tuple[float, float]) -> Resistance | None:
    """Return a tube (length, bore) and an orifice (conductance, critical ratio) in series; what is 0 is missing."""
    parts = Tube(*tube) if tube[0] and tube[1] else None, Orifice(*orifice) if orifice[0] else None
    return InSeries(parts[1], parts[0]) if parts[0] and parts[1] else parts[0] or parts[1]


# ----------------------------------------------------------------------------------------------------------------------
# The gas as a quantity of a path, and its curve in a step in time; dimensionless but for the time, in s.
#
# Air supply in time: a source of pressure or flow that fills the device through a tube and a valve, and leaks.
#
# Tubes, fittings and cavity hold an amount of gas X, counted as its volume at ambient pressure. With the absolute pressure
# p = (P + ambient) / ambient and the exponent n (1 isothermal, 1.4 adiabatic)
#
#     X = p^(1/n) (V + dead),      dX/dt = Q(source(t), P)
#
# Within a step in time that is one curve in the (V, P) plane: X(V, P) - theta dt Q(P) = X_0 + (1 - theta) dt Q_0. The weight
# theta lies between 1/2 (second order) and 1 (implicit Euler, stable for any step) so that a constant volume behind a linear
# resistance is exact for any dt.


@dataclasses.dataclass(frozen=True)
class Gas(stability.Supply):
    """The gas in tubes, fittings and cavity, as its volume at ambient pressure; units are Pa in one dimensionless pressure and
    m3 of the whole device in one dimensionless volume."""

    supply: Reservoir
    pressure_unit: float
    volume_unit: float
    name: ClassVar[str] = "gas"

    @property
    def ambient(self) -> float:
        return self.supply.ambient / self.pressure_unit

    @property
    def dead(self) -> float:
        return self.supply.dead / self.volume_unit

    @property
    def power(self) -> float:
        return 1.0 / GASES[self.supply.gas]

    def _ratio(self, P: float) -> float:
        return max(1.0 + P / self.ambient, 1e-6)

    def value(self, V: float, P: float) -> float:
        return self._ratio(P) ** self.power * (V + self.dead)

    def slopes(self, V: float, P: float) -> tuple[float, float]:
        ratio = self._ratio(P)
        squeezed = ratio**self.power
        return squeezed, self.power * squeezed / ratio / self.ambient * (V + self.dead)

    @property
    def weight(self) -> float:
        return 1.0 / (1.0 + self.dead / self.ambient)

    def flow(self, source: Source, P: float) -> tuple[float, float]:
        """Return the net flow per s into the device, and its derivative by the pressure."""
        pressure = P * self.pressure_unit
        (inflow, rate), (outflow, loss) = self.supply.supplied(source, pressure), self.supply.lost(pressure)
        unit = 1.0 / (self.supply.ambient * self.volume_unit)
        return (inflow - outflow) * unit, (rate - loss) * unit * self.pressure_unit

    def step(self, last: stability.Point, sources: tuple[Source, Source], step: float) -> GasStep:
        """Return the curve on which a step in time of a length in s ends, from a point, by what the source does at its two
        ends."""
        V, P, t = last.state.V, last.state.P, last.tangent
        flow, slope = self.flow(sources[0], P)
        a, b = self.slopes(V, P)
        along = t.P / (a * t.V + b * t.P)
        z = max(0.0, -slope * along * step)
        theta = end_weight(z)
        target = self.value(V, P) + (1.0 - theta) * step * flow
        return GasStep(self, target, step, theta, sources, P, flow, flow * along, z)


def end_weight(z: float) -> float:
    """Return the weight of the end of a step that makes x' = -z x exact; at least that of the trapezoidal rule."""
    if z < 1e-3:
        return 0.5 + max(z, 0.0) / 12.0
    return -1.0 / math.expm1(-z) - 1.0 / z


@dataclasses.dataclass(frozen=True)
class GasStep:
    """The curve on which a step in time ends: a `controls.Curve`.

    Attributes:
        gas: The gas.
        target: Left side of its equation.
        step: Length of the step in s.
        theta: Weight of the flow at its end.
        sources: What the source does where the step begins, and where it ends.
        P, flow, rate: Where the step begins: pressure, flow, and the pressure's rate per s.
        z: Length of the step over the time in which the gas follows its source.
    """

    gas: Gas
    target: float
    step: float
    theta: float
    sources: tuple[Source, Source]
    P: float
    flow: float
    rate: float
    z: float
    needs_volume: ClassVar[bool] = True

    @property
    def weight(self) -> float:
        resists = -self.theta * self.step * self.gas.flow(self.sources[1], self.P)[1]
        return 1.0 / (1.0 + self.gas.dead / self.gas.ambient + resists)

    def value(self, V: float, P: float) -> float:
        return self.gas.value(V, P) - self.theta * self.step * self.gas.flow(self.sources[1], P)[0]

    def slopes(self, V: float, P: float) -> tuple[float, float]:
        a, b = self.gas.slopes(V, P)
        return a, b - self.theta * self.step * self.gas.flow(self.sources[1], P)[1]

    def line(self, V: float, P: float) -> Control:
        a, b = self.slopes(V, P)
        return Control(self.weight * a, self.weight * b, 0.0)

    def at(self, target: float) -> GasStep:
        return dataclasses.replace(self, target=target)

    def delivered(self, state: State) -> float:
        """Return the gas that has come in the step."""
        return self.step * ((1.0 - self.theta) * self.flow + self.theta * self.gas.flow(self.sources[1], state.P)[0])

    def error(self, state: State, earlier: tuple[float, State] | None) -> float:
        """Return the error of the gas by the step: the difference to Simpson's rule with the pressure on a parabola. In a long
        step the flow makes up for such a difference, so it is divided by 1 + z.

        The parabola goes through where the step before began, ``earlier`` by its length in s; if None, it begins with the rate
        of the gas.
        """
        rate = self.rate
        if earlier is not None:
            before, now = (self.P - earlier[1].P) / earlier[0], (state.P - self.P) / self.step
            rate = (before * self.step + now * earlier[0]) / (self.step + earlier[0])
        middle = self.P + (state.P - self.P + self.step * rate) / 4.0
        flow = self.gas.flow(self.sources[0].toward(self.sources[1], 0.5), middle)[0]
        end = self.gas.flow(self.sources[1], state.P)[0]
        return abs(self.step / 6.0 * (self.flow + 4.0 * flow + end) - self.delivered(state)) / (1.0 + self.z)
