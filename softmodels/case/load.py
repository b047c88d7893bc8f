"""Load of a case: rising pressures, added volumes, strokes of a supply, or a series for each cavity."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, MutableMapping, Sequence

from geometries import Actuator
from softmodels.case.entries import MISSING, CaseError, Entry, Missing, Option, SeriesKind, Tables, Written, table_of
from softmodels.common.errors import FieldError
from softmodels.common.names import checked
from softmodels.common.schema import About, Quantity, Text, Words
from softmodels.common.units import UnitError, brief, pascal_per_cm, quantity
from softmodels.mechanics.component import Component
from softmodels.mechanics.controls import LoadPart, RequestedValue, requestable
from softmodels.path import program as programs
from softmodels.path.program import SOURCE, TIME_KEY, VALVE, Program, Series, source_key
from softmodels.path.stability import DeadForce, LoadDisplacement
from softmodels.path.supply import AMBIENT, AirSupply, Reservoir

# ----------------------------------------------------------------------------------------------------------------------
# Requests on a dead load: forces, moments, shares of the weight, or the conjugate travels and rotations.


def asked_of_loads() -> dict[str, RequestedValue]:
    """Return the requestable quantities of dead loads, by key."""
    return {key: asked for keys in requestable().values() for key, asked in keys.items()}


OPTIONS = {"share": "weight_share"}
"""Names of the options that differ from the key."""


@checked
@dataclasses.dataclass(frozen=True)
class LoadRequest:
    """Requested values of one dead load, rising, in the unit of the key (one of `asked_of_loads`), all others constant; ``on``
    names the load, where the device has several of the kind. The pressure in cm of the column is applied before and kept."""

    key: str
    values: tuple[float, ...]
    on: str = ""
    at_pressure_cm: float = 0.0

    @property
    def asked(self) -> RequestedValue:
        """The requested quantity."""
        return asked_of_loads()[self.key]

    @property
    def table(self) -> str:
        """The table of the loads it can refer to."""
        return next(table for table, keys in requestable().items() if self.key in keys)

    def of(self, components: tuple[Component, ...]) -> LoadPart:
        """Return the load; `FieldError` if there is none, or several."""
        found = [part for part in components if isinstance(part, LoadPart) and part.table == self.table]
        named = [part for part in found if not self.on or part.name == self.on]
        if len(named) == 1:
            return named[0]
        if not found:
            raise FieldError(
                f"{self.asked.words} are requested ({self.key}), but the device has no [{self.table}]; add one"
                f" (--{self.table})"
            )
        names = ", ".join(part.name or "without a name" for part in found)
        raise FieldError(
            f'{self.key} refers to one {self.table}, but the case has {names}; choose one (on = "{found[0].name}")'
        )

    def column(self, load: LoadPart) -> str:
        """Return the column of ``path.csv`` with the requested values."""
        if self.key == "share":
            return load.share_column
        return load.travel_column if self.asked.held else load.column


class LoadRequestEntry(Entry[LoadRequest | None]):
    """Requested values of a dead load, in the table of the load."""

    tables = ("load",)
    more = ("on", "at_pressure_cm")

    @property
    def keys(self) -> tuple[str, ...]:  # type: ignore[override]
        return *asked_of_loads(), *self.more

    def known(self, key: str) -> bool:
        return key in self.keys

    def read(self, tables: Tables) -> LoadRequest | Missing | None:
        table = table_of(tables, "load")
        return self._made({key: table[key] for key in (*asked_of_loads(), *self.more) if key in table})

    def write(self, value: LoadRequest | None, text: Text) -> Written:
        if value is None:
            return {}
        written: dict[str, object] = {value.key: list(value.values)}
        written |= {"on": value.on} if value.on else {}
        return {"load": {**written, **({"at_pressure_cm": value.at_pressure_cm} if value.at_pressure_cm else {})}}

    def options(self) -> Iterator[Option]:
        for key, asked in asked_of_loads().items():
            yield Option(OPTIONS.get(key, key), About(SeriesKind(), asked.help), metavar="SERIES")
        yield Option("on", About(Words(), "name of the load they refer to, if a case has several"), metavar="NAME")
        text = "pressure in cm of the column, applied first and then constant, for forces on an inflated device"
        yield Option("at_pressure_cm", About(Quantity(), text))

    def arguments(self, field: str) -> dict[str, str]:
        return {
            OPTIONS.get(key, key): f"{field}={LoadRequest.__name__}(...)" for key in (*asked_of_loads(), *self.more)
        }

    def take(self, options: MutableMapping[str, object]) -> LoadRequest | Missing | None:
        given = {key: options.pop(OPTIONS.get(key, key), None) for key in (*asked_of_loads(), *self.more)}
        return self._made({key: value for key, value in given.items() if value is not None})

    def _made(self, given: dict[str, object]) -> LoadRequest | Missing | None:
        asked = [key for key in asked_of_loads() if key in given]
        if not asked:
            if given:
                raise FieldError(f'{next(iter(given))} needs requested forces, such as force_N = "0:10" (--force-N)')
            return MISSING
        if len(asked) > 1:
            raise FieldError(f"request one of {' and '.join(asked)}; for several in sequence write a program")
        values = SeriesKind().read(asked[0], given[asked[0]])
        on = Words().settled("on", given.get("on", ""))
        pressure = Quantity().read("at_pressure_cm", given.get("at_pressure_cm", 0.0))
        return LoadRequest(asked[0], values, on, pressure)


OF_PRESSURE = ("pressure_cm", "source_pressure_cm")
"""Series of pressures."""
STIFFNESS_RANGE = 30.0
"""Maximum pressure in shear moduli; above it a wrong unit is assumed: no silicone device withstands a tenth of it."""
VOLUME_RANGE = 1000.0
"""Maximum added volume in cavity volumes; above it a wrong unit is assumed: silicones tear at a tenth of that stretch."""


@dataclasses.dataclass(frozen=True)
class Requested:
    """A quantity that can be requested: its name and plural for the path and messages, the unit of its values in case files,
    options and tables, and its column of ``path.csv``."""

    name: str
    words: str
    unit: str
    column: str


PRESSURE = Requested("pressure", "pressures", "cm", "pressure_cm")
VOLUME = Requested("volume", "added volumes", "ml", "added_volume_ml")
STROKE = Requested("stroke", "strokes", "ml", "stroke_ml")
STEP = Requested("step", "steps", "", "load_step")


@dataclasses.dataclass(frozen=True)
class Load:
    """The load of a case; see `Case` for its attributes."""

    pressures_cm: tuple[float, ...]
    volumes_ml: tuple[float, ...]
    strokes_ml: tuple[float, ...]
    program: Program
    supply: AirSupply | None
    load_unload: bool
    control: str
    water_density: float
    driven: LoadRequest | None
    components: tuple[Component, ...]

    @property
    def requested(self) -> Requested:
        if self.program:
            return STEP
        if self.driven is not None:
            name = LoadDisplacement.name if self.driven.asked.held else DeadForce.name
            column = self.driven.column(self.driven.of(self.components))
            return Requested(name, self.driven.asked.words, self.driven.asked.unit, column)
        return PRESSURE if self.pressures_cm else VOLUME if self.volumes_ml else STROKE

    @property
    def driver(self) -> str:
        """Name of the air supply, in a word."""
        return "supply" if self.supply is None else self.supply.name

    @property
    def has_pressure(self) -> bool:
        """Whether the device is pressurised; it is not if only weights, forces and moments are requested."""
        of_cavities = any(series.target in ("", SOURCE) for series in self.program)
        kept = self.driven is not None and self.driven.at_pressure_cm > 0.0
        return bool(self.pressures_cm or self.volumes_ml or self.strokes_ml or of_cavities or kept)

    @property
    def direction(self) -> int:
        """1, or -1 if the requested pressures or added volumes fall from 0."""
        return -1 if min([*self.pressures_cm, *self.volumes_ml], default=0.0) < 0.0 else 1

    def lowest_cm(self, ratios: Sequence[float]) -> float:
        """Return the lowest pressure in cm of a cavity, by their ratios to the requested one, or of a supply's source, at most
        0."""
        common = (*self.pressures_cm, *((self.driven.at_pressure_cm,) if self.driven else ()))
        own = (value for one in self.program if one.key in OF_PRESSURE for value in one.values)
        return min([0.0, *(value * ratio for value in common for ratio in ratios), *own])

    def draws(self, ratios: Sequence[float]) -> bool:
        """Return whether air is drawn out: a pressure or an added volume is below 0."""
        volumes = (value for one in self.program if one.key == "volume_ml" for value in one.values)
        return self.lowest_cm(ratios) < 0.0 or min([0.0, *self.volumes_ml, *volumes]) < 0.0

    @property
    def cm(self) -> float:
        """Pa in one cm of the column."""
        return pascal_per_cm(self.water_density)

    @property
    def scale(self) -> float:
        """SI units in one of the requested values'; 1 of a program."""
        if self.driven:
            return self.driven.asked.scale
        return 1.0 if self.program else self.cm if self.pressures_cm else 1e-6

    @property
    def values(self) -> tuple[float, ...]:
        """Requested values in their unit; of a program the numbers of its steps."""
        if self.program:
            rest = programs.begins_at_rest(self.program)
            return tuple(float(k) for k in range(1 - rest, len(self.program[0].values) + 1 - rest))
        return self.pressures_cm or self.volumes_ml or self.strokes_ml or (self.driven.values if self.driven else ())

    @property
    def goals(self) -> tuple[float, ...]:
        """Requested pressures in Pa, added volumes or strokes in m3, forces and travels in SI units; none of a program."""
        return tuple(value * self.scale for value in self.values)

    def check(self, actuator: Actuator) -> None:
        """Raise `CaseError` if no or several quantities are requested, or options contradict each other, and `SupplyError` for
        strokes that the supply cannot make."""
        asked = (self.pressures_cm, self.volumes_ml, self.strokes_ml, self.program, self.driven)
        if sum(map(bool, asked)) != 1:
            raise CaseError(
                "request either pressures (--pressure-cm) or added volumes (--volume-ml), or strokes of a syringe "
                "(--supply syringe with --stroke-ml), or forces on a face (--force-N), or shares of the weight "
                "(--weight-share), or in a case file a series for each cavity (cavity1.pressure_cm); give exactly one of these"
            )
        given = {"pressure": self.pressures_cm, "volume": self.volumes_ml, "stroke": self.strokes_ml}
        given |= {self.driven.key: self.driven.values} if self.driven else {}
        for what, values in given.items():
            if values and not any(values):
                raise CaseError(f"the only {what} requested is 0; add a value above 0")
        if not actuator.ratios and (self.pressures_cm or self.volumes_ml or self.strokes_ml):
            raise CaseError(
                f"{type(actuator).__name__} has no cavity for a pressure or a volume; load it by a force (--force with "
                "--force-N) or by its weight (--gravity with --weight-share 0:1)"
            )
        if (lowest := self.lowest_cm(actuator.ratios)) * self.cm <= -AMBIENT:
            raise CaseError(
                f"a pressure of {lowest:g} cm ({lowest * self.cm / 1e3:.4g} kPa) is below absolute vacuum, "
                f"{-AMBIENT / self.cm:.0f} cm ({-AMBIENT / 1e3:.5g} kPa) at an ambient pressure of {AMBIENT / 1e3:.5g} kPa; "
                "pumps reach about -90 kPa, ejectors -85 kPa"
            )
        if self.program:
            self._check_program(actuator)
        if self.driven is not None:
            self._check_driven(self.driven, actuator)
        if self.load_unload and not (self.pressures_cm or (self.driven and not self.driven.asked.held)):
            raise CaseError(
                "--load-unload needs a pressure or a force to raise and lower; add --pressure-cm or --force-N"
            )
        if self.load_unload and (rubs := self._remembering):
            raise CaseError(
                f"--load-unload reads one equilibrium curve, but with the friction of {rubs} the states depend "
                f"on the loading history; use a series in a case file instead (cavity1.pressure_cm = [40, 0])"
            )
        if self.load_unload and self.control != "auto":
            raise CaseError("--load-unload chooses the control itself; leave out --control")
        self._check_supply(actuator)
        self._check_lifted()
        if (
            self.supply is not None
            and not self.supply.in_time
            and any(isinstance(part, LoadPart) and not part.idle(self.components) for part in self.components)
        ):
            raise CaseError(
                "strokes of a supply count from the undeformed cavity, but a device with weights or forces starts "
                "from a preloaded one; request pressures or added volumes"
            )
        if self.volumes_ml and self.control == "pressure":
            raise CaseError("added volumes cannot be requested under pressure control; use --control auto or volume")
        if not 100.0 <= self.water_density <= 20000.0:
            raise CaseError(
                f"a water density of {self.water_density:g} kg/m^3 is out of range; give 100 to 20000 kg/m^3 (the "
                f"thesis measured 970)"
            )

    @property
    def _remembering(self) -> str:
        """The table of a part whose forces depend on the states before; empty if none do."""
        return next((part.where for part in self.components if part.remembers), "")

    def _check_lifted(self) -> None:
        """Reject shares of gravity if the device lifts a mass, which always has its full weight."""
        lifted = next((part.where for part in self.components if part.lifted and part.weighs), "")
        shared = any(series.target == "gravity" for series in self.program)
        if lifted and (shared or (self.driven is not None and self.driven.key == "share")):
            raise CaseError(
                f"{lifted} has a mass with its full weight, but shares of the weight are requested; "
                "leave out the shares, or the mass"
            )

    def check_band(self) -> None:
        """Raise `CaseError` for loads without a band: a supply, a program, a cycle, or travels."""
        if rubs := self._remembering:
            raise CaseError(f"bands are not available with friction, as at {rubs}: leave out --band, or the friction")
        if (
            self.program
            or self.supply is not None
            or self.load_unload
            or (self.driven is not None and self.driven.asked.held)
        ):
            raise CaseError(
                "bands are available only for requested pressures, volumes, forces or shares of the weight; "
                "leave out --band, or the supply, load_unload, travels or series"
            )

    def check_branch(self) -> None:
        """Raise `CaseError` for loads under which no branch can be followed: a program or a cycle."""
        if rubs := self._remembering:
            raise CaseError(f"--branch is not available with friction, as at {rubs}; leave one of them out")
        if self.program:
            raise CaseError("--branch is not available with a series for each cavity; leave one of them out")
        if self.load_unload:
            raise CaseError("--branch and --load-unload cannot be combined; leave out one of them")

    def _check_supply(self, actuator: Actuator) -> None:
        timed = self.supply is not None and self.supply.in_time
        if timed or source_key(self.program):
            if not timed:
                raise CaseError(
                    f"{source_key(self.program)} is the series of a supply in time; add one (a [supply] of kind "
                    f'"{Reservoir.name}", or supply=Reservoir())'
                )
            if not source_key(self.program):
                raise CaseError(
                    f"a {self.driver} needs its source in time: source_pressure_cm (or flow_ml_per_min) and time_s in [load], "
                    "or --pressure-cm with --rate or --hold"
                )
            if not actuator.ratios:
                raise CaseError(f"{type(actuator).__name__} has no cavity for a {self.driver}; leave out the supply")
            return
        if bool(self.strokes_ml) != (self.supply is not None):
            owner = "syringe" if self.supply is None else self.supply.name
            raise CaseError(f"a {owner} (--supply {owner}) and its strokes (--stroke-ml) belong together")
        if self.supply is not None:
            self.supply.check_strokes(self.strokes_ml[-1] * 1e-6, actuator.cavity_volume)
            if self.control not in ("auto", "arc-length"):
                raise CaseError("strokes need --control auto or arc-length")

    def _check_driven(self, driven: LoadRequest, actuator: Actuator) -> None:
        load = driven.of(self.components)
        if driven.at_pressure_cm and not actuator.ratios:
            raise CaseError(f"at_pressure_cm: {type(actuator).__name__} has no cavity for a pressure; leave it out")
        if load.kept:
            raise CaseError(
                f"{load.where} has a constant amount, but {driven.asked.words} of it are requested; leave one of them out"
            )

    def _check_program(self, actuator: Actuator) -> None:
        count, known = len(actuator.ratios), {part.key: part for part in self.components if isinstance(part, LoadPart)}
        of_cavities = [series for series in self.program if not series.target]
        if of_cavities and len(of_cavities) != count:
            raise CaseError(
                f"[load] has series for {len(of_cavities)} cavities, but the device has {count}; give one for each"
            )
        for series in programs.drivers(self.program):
            if series.target in (SOURCE, VALVE):
                continue
            if series.target and series.target not in known:
                table, _, name = series.target.partition(".")
                raise CaseError(
                    f"[load] has a series for {series.target}, but the case has no [{table}{'.' + name if name else ''}]; the "
                    f"loads it has are {', '.join(known) or 'none'}"
                )
            load = known.get(series.target)
            if load is not None and load.kept:
                raise CaseError(f"{load.where} has a constant amount, and a series in [load]; leave one of them out")
        if of_cavities and actuator.ratios != (1.0,) * count:
            raise CaseError("pressure_ratios cannot be combined with a series for each cavity; leave out the ratios")
        if self.load_unload or self.control not in ("auto", "arc-length"):
            raise CaseError("a series for each cavity needs control auto or arc-length, without load_unload")

    def check_size(self, shear_modulus: float, cavity: float) -> None:
        """Raise `CaseError` for values that suggest a wrong unit, given the material's shear modulus in Pa and the cavity's
        volume in m3."""
        of_cavities = [one for one in self.program if not one.target]
        given = {
            is_volume: [v for one in of_cavities if one.is_volume == is_volume for v in one.values]
            for is_volume in (False, True)
        }
        kept = self.driven.at_pressure_cm if self.driven else 0.0
        highest = max(map(abs, [*self.pressures_cm, *given[False], kept]))
        if (most := highest * self.cm) > STIFFNESS_RANGE * shear_modulus:
            usual_cm, usual_kPa = (f"{float(f'{shear_modulus / unit:.2g}'):g}" for unit in (self.cm, 1e3))
            raise CaseError(
                f"a pressure of {highest:g} cm ({most / 1e3:.4g} kPa) is too much for a shear modulus of "
                f"{shear_modulus / 1e3:.4g} kPa: devices take about {usual_cm} cm ({usual_kPa} kPa), and at most "
                f"{STIFFNESS_RANGE * shear_modulus / self.cm:.0f} cm is accepted; write --pressure '{usual_cm} cm' "
                f"or --pressure '{usual_kPa} kPa' or less, or correct the modulus (silicones have 5 to 500 kPa)"
            )
        volumes = [0.0, *self.volumes_ml, *given[True]]
        if cavity and min(volumes) * 1e-6 <= -cavity:
            raise CaseError(
                f"an added volume of {min(volumes):g} ml empties a cavity of {cavity * 1e6:.4g} ml; give a volume above "
                f"{-cavity * 1e6:.4g} ml"
            )
        largest = max(volumes)
        if largest * 1e-6 > VOLUME_RANGE * cavity:
            raise CaseError(
                f"an added volume of {largest:g} ml against a cavity of {cavity * 1e6:.4g} ml is out of range; "
                f"give at most {VOLUME_RANGE:g} times the cavity volume"
            )


# ----------------------------------------------------------------------------------------------------------------------
# Pressures or volumes in time, from a rate, a hold and a number of cycles.


def in_time(load: Load, rate: str, hold: float, cycles: float, cavities: int) -> Program:
    """Return the program of a load's requested pressures or volumes in time; `CaseError` where nothing changes in time so.

    The rate is such as ``"1 kPa/s"``, empty for at once; the last value is held for ``hold`` s, in each cycle. Cycles go from
    0 and back to 0; 0 of them for once and without the way back. All cavities go through the same.
    """
    values = load.pressures_cm or load.volumes_ml
    if not values or values[-1] == 0.0:
        raise CaseError(
            "--rate, --hold and --cycles need pressures or added volumes that they change (--pressure-cm, --volume-ml)"
        )
    if hold < 0.0:
        raise CaseError(f"hold is {hold:g} s; it must be 0 or more")
    if cycles != round(cycles) or not 0 <= cycles <= programs.MOST_STEPS / 4:
        raise CaseError(f"cycles is {cycles:g}; it must be a whole number from 1 to {programs.MOST_STEPS // 4}")
    if cycles and not rate:
        raise CaseError("--cycles needs the rate at which they go up and down; add --rate, such as --rate 1kPa/s")
    speed = _rate(rate, load) if rate else math.inf
    way = [(0.0, 0.0)]

    def go(value: float, rest: float = 0.0) -> None:
        last, time = way[-1]
        if value != last:
            way.append((value, time + abs(value - last) / speed))
        if rest:
            way.append((value, way[-1][1] + rest))

    for _ in range(max(1, round(cycles))):
        for value in values[:-1]:
            go(value)
        go(values[-1], hold)
        if cycles:
            go(0.0)
    key = "pressure_cm" if load.pressures_cm else "volume_ml"
    series, times = (tuple(one) for one in zip(*way, strict=True))
    return of_cavities(key, series, times, cavities, load.supply)


def of_cavities(
    key: str, values: tuple[float, ...], times: tuple[float, ...], cavities: int, supply: AirSupply | None
) -> Program:
    """Return the program in which all cavities go through the same values, or the source of a supply in time does."""
    if supply is not None and supply.in_time:
        if key != "pressure_cm":
            raise CaseError(
                f"a {supply.name} supplies pressures, not added volumes; request pressures, those of its source"
            )
        driven = [Series("source_pressure_cm", values, SOURCE)]
    else:
        driven = [Series(key, values)] * cavities
    return (*driven, Series(TIME_KEY, times, programs.TIME))


def _rate(text: str, load: Load) -> float:
    """Return a rate in cm/s, or in ml/s of added volumes."""
    kinds = [("Pa/s", load.cm), ("m/s", 1e-2)] if load.pressures_cm else [("m^3/s", 1e-6)]
    for unit, scale in kinds:
        try:
            found = quantity(text, unit) / scale
        except UnitError:
            continue
        if found > 0.0:
            return found
        raise CaseError(f"rate {brief(text)} must be above 0; the way back is --cycles")
    raise CaseError(f"rate {brief(text)} is none; write it like {'1kPa/s or 5cm/s' if load.pressures_cm else '2ml/s'}")
