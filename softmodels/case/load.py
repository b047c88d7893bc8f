"""The load of a case: load steps from each way in which they are written, and what they say.

Texts, heights of a column, millilitres and degrees end here: `steps_of` takes the keys of ``[load]``, of case files and of
options; `prescribed` and `at_times` take the arguments of the Python calls. Below, values are SI.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Collection, Iterator, Mapping, MutableMapping, Sequence
from typing import Protocol

import numpy as np
import numpy.typing as npt

from geometries import Actuator
from softmodels.case import entries, materials
from softmodels.case.entries import CaseError, Entry
from softmodels.common import errors, schema, units
from softmodels.common.names import checked
from softmodels.mechanics import controls
from softmodels.mechanics.component import Component
from softmodels.path import stability
from softmodels.path.steps import (
    FLOW,
    MAX_STEPS,
    PRESSURE,
    SOURCE_PRESSURE,
    STROKE,
    VALVE,
    VOLUME,
    Prescribed,
    Step,
    StepError,
    Steps,
    check_steps,
    courses,
    durations_of,
    is_program,
    last_number,
    load_quantities,
    prescribes,
    timed,
    times_of,
)
from softmodels.path.supply import AMBIENT_PRESSURE, AirSupply, Reservoir


class Load:
    """What the steps of a case say."""

    def __init__(self, case: Loaded):
        self.case, self.steps = case, case.steps

    @functools.cached_property
    def program(self) -> bool:
        """Whether the steps are a program, and not values of one quantity."""
        return is_program(self.steps)

    @functools.cached_property
    def asked(self) -> Prescribed | None:
        """The values of one quantity that are requested; None for a program."""
        return None if self.program or not self.steps else self.steps[-1].prescribed[0]

    @property
    def driven(self) -> Prescribed | None:
        """The same, of a dead load; None for others."""
        return self.asked if self.asked is not None and self.asked.of_load else None

    @property
    def driven_part(self) -> controls.LoadPart:
        """The dead load whose values are requested."""
        assert self.driven is not None
        return load_part(self.driven, self.case.components)

    @property
    def preload(self) -> float:
        """Pressure in Pa that is applied before the values of a dead load, and kept."""
        return self.steps[0].prescribed[0].values[0] if self.driven is not None and len(self.steps) > 1 else 0.0

    def of(self, quantity: str) -> tuple[float, ...]:
        """Return the requested values of a quantity, SI; empty where another one, or a program, is requested."""
        return self.asked.values if self.asked is not None and self.asked.quantity == quantity else ()

    @property
    def doubts(self) -> list[str]:
        """A sentence on each ambiguous text of requested values."""
        return [driver.doubt for step in self.steps for driver in step.prescribed if driver.doubt]

    @property
    def requested(self) -> Requested:
        if self.asked is None:
            return STEP if self.program else REQUESTED[STROKE]
        if not self.asked.of_load:
            return REQUESTED[self.asked.quantity]
        asked, part = load_quantities()[self.asked.quantity][2], self.driven_part
        variable = part.variables[2 if asked.held else 0]
        return Requested(
            stability.LoadDisplacement.name if asked.held else stability.DeadForce.name,
            asked.words,
            part.share_column if self.asked.quantity == "share" else variable,
        )

    @property
    def driver(self) -> str:
        """Name of the air supply, in a word."""
        return "supply" if self.case.supply is None else self.case.supply.name

    @property
    def has_pressure(self) -> bool:
        """Whether the device is pressurised; it is not if only weights, forces and moments are requested."""
        of_loads = [driver.of_load for step in self.steps for driver in step.prescribed]
        return not all(of_loads) and (self.driven is None or self.preload > 0.0)

    @property
    def direction(self) -> int:
        """1, or -1 if the requested pressures or added volumes fall from 0."""
        return -1 if min([*self.of(PRESSURE), *self.of(VOLUME)], default=0.0) < 0.0 else 1

    def lowest(self) -> float:
        """Return the lowest pressure in Pa of a cavity, or of a supply's source, at most 0."""
        common = (*self.of(PRESSURE), self.preload)
        own = self._in_program(PRESSURE, SOURCE_PRESSURE)
        return min([0.0, *(value * ratio for value in common for ratio in self.case.actuator.ratios), *own])

    def draws(self) -> bool:
        """Return whether air is drawn out: a pressure or an added volume is below 0."""
        return self.lowest() < 0.0 or min([0.0, *self.of(VOLUME), *self._in_program(VOLUME)]) < 0.0

    def _in_program(self, *quantities: str) -> list[float]:
        """Return the values of quantities in a program."""
        steps = self.steps if self.program else ()
        return [driver.values[0] for step in steps for driver in step.prescribed if driver.quantity in quantities]

    @property
    def values(self) -> tuple[float, ...]:
        """Requested values in SI units, with their texts; of a program the numbers of its steps."""
        if self.asked is not None:
            return self.asked.values
        last = last_number(self.steps) if self.program else 0
        return tuple(float(k) for k in range(last - len(self.steps) + 1, last + 1))

    def told(self, value: float, form: str = ".4g") -> str:
        """Return a value of the requested quantity, SI, in the unit of its key in case files, such as ``"177 cm"``."""
        if self.asked is None:
            return f"{value:{form}}"
        amount = _amount(1.0, self.asked.quantity, self.case.column.pascal)
        as_typed = isinstance(value, units.Amount) and value.unit == amount.unit
        number = units.as_amount(value).number if as_typed else value / amount
        return f"{number:{form}} {amount.unit}"

    def check(self) -> None:
        """Raise `CaseError` if nothing is requested, or options contradict each other, and `SupplyError` for strokes that the
        supply cannot make."""
        case, actuator, asked = self.case, self.case.actuator, self.asked
        if not self.steps:
            raise CaseError(ONE_REQUEST)
        if asked is not None:
            key = load_quantities()[asked.quantity][1] if asked.of_load else asked.quantity
            if not any(asked.values):
                raise CaseError(f"the only {key} requested is 0; add a value above 0")
            entries.check_order(asked.values, key)
        if not actuator.ratios and asked is not None and not asked.of_load:
            raise CaseError(
                f"{type(actuator).__name__} has no cavity for a pressure or a volume; load it by a force (--force with "
                "--force-N) or by its weight (--gravity with --weight-share 0:1)"
            )
        if (lowest := self.lowest()) <= -AMBIENT_PRESSURE:
            raise CaseError(
                f"a pressure of {case.column.text(lowest, 'g')} ({lowest / 1e3:.4g} kPa) is below absolute vacuum, "
                f"{case.column.text(-AMBIENT_PRESSURE, '.0f')} ({-AMBIENT_PRESSURE / 1e3:.5g} kPa) at an ambient pressure of "
                f"{AMBIENT_PRESSURE / 1e3:.5g} kPa; "
                "pumps reach about -90 kPa, ejectors -85 kPa"
            )
        if self.program:
            check_steps(self.steps)
            self._check_program()
        if self.driven is not None:
            self._check_driven(self.driven)
        held = asked is not None and (asked.held or asked.quantity == STROKE)
        if case.load_unload and (asked is None or held):
            raise CaseError("--load-unload needs a pressure or a force to raise and lower; add --pressure-cm or --force-N")
        if case.load_unload and (rubs := self._remembering):
            raise CaseError(
                f"--load-unload reads one equilibrium curve, but with the friction of {rubs} the states depend "
                f"on the loading history; use a series in a case file instead (cavity1.pressure_cm = [40, 0])"
            )
        if case.load_unload and case.control != "auto":
            raise CaseError("--load-unload chooses the control itself; leave out --control")
        self._check_supply()
        self._check_lifted()
        if (
            case.supply is not None
            and not case.supply.in_time
            and any(isinstance(part, controls.LoadPart) and not part.idle(case.components) for part in case.components)
        ):
            raise CaseError(
                "strokes of a supply count from the undeformed cavity, but a device with weights or forces starts "
                "from a preloaded one; request pressures or added volumes"
            )
        if self.of(VOLUME) and case.control == "pressure":
            raise CaseError("added volumes cannot be requested under pressure control; use --control auto or volume")
        if not 100.0 <= case.water_density <= 20000.0:
            raise CaseError(
                f"a water density of {case.water_density:g} kg/m^3 is out of range; give 100 to 20000 kg/m^3 (the "
                f"thesis measured 970)"
            )

    @property
    def _remembering(self) -> str:
        """The table of a part whose forces depend on the states before; empty if none do."""
        return next((part.where for part in self.case.components if part.remembers), "")

    def _check_lifted(self) -> None:
        """Reject shares of gravity if the device lifts a mass, which always has its full weight."""
        lifted = next((part.where for part in self.case.components if part.lifted and part.weighs), "")
        if lifted and prescribes(self.steps, "share"):
            raise CaseError(
                f"{lifted} has a mass with its full weight, but shares of the weight are requested; "
                "leave out the shares, or the mass"
            )

    def check_band(self) -> None:
        """Raise `CaseError` for loads without a band: a supply, inertia, a cycle, travels, or a program of several sources."""
        if rubs := self._remembering:
            raise CaseError(f"bands are not available with friction, as at {rubs}: leave out --band, or the friction")
        travels = self.driven is not None and self.driven.held
        sources = self.program and isinstance(self.case.band, materials.SourceBand)
        if self.case.supply is not None or self.case.load_unload or self.case.inertia or travels or sources:
            raise CaseError(
                "bands are available only for requested pressures, volumes, forces or shares of the weight, and with a fit's "
                "errors for programs and loads in time; leave out --band, or the supply, load_unload, inertia or travels"
            )

    def check_branch(self) -> None:
        """Raise `CaseError` for loads under which no branch can be followed: a program or a cycle."""
        if rubs := self._remembering:
            raise CaseError(f"--branch is not available with friction, as at {rubs}; leave one of them out")
        if self.program:
            raise CaseError("--branch is not available with a series for each cavity; leave one of them out")
        if self.case.load_unload:
            raise CaseError("--branch and --load-unload cannot be combined; leave out one of them")

    def _check_supply(self) -> None:
        case, strokes = self.case, self.of(STROKE)
        supply, actuator = case.supply, case.actuator
        in_time = supply is not None and supply.in_time
        source = next((q for q in (SOURCE_PRESSURE, FLOW) if prescribes(self.steps, q)), "")
        if in_time or source:
            if not in_time:
                key = next(key for key, quantity in SOURCE_KEYS.items() if quantity == source)
                raise CaseError(
                    f"{key} is the series of a supply in time; add one (a [supply] of kind "
                    f'"{Reservoir.name}", or supply=Reservoir())'
                )
            if not source:
                raise CaseError(
                    f"a {self.driver} needs its source in time: source_pressure_cm (or flow_ml_per_min) and time_s in [load], "
                    "or --pressure-cm with --rate or --hold"
                )
            if not actuator.ratios:
                raise CaseError(f"{type(actuator).__name__} has no cavity for a {self.driver}; leave out the supply")
            return
        if bool(strokes) != (supply is not None):
            owner = "syringe" if supply is None else supply.name
            raise CaseError(f"a {owner} (--supply {owner}) and its strokes (--stroke-ml) belong together")
        if supply is not None:
            supply.check_strokes(strokes[-1], actuator.cavity_volume)
            if case.control not in ("auto", "arc-length"):
                raise CaseError("strokes need --control auto or arc-length")

    def _check_driven(self, driven: Prescribed) -> None:
        load, actuator = self.driven_part, self.case.actuator
        if self.preload and not actuator.ratios:
            raise CaseError(f"at_pressure_cm: {type(actuator).__name__} has no cavity for a pressure; leave it out")
        if load.kept:
            raise CaseError(
                f"{load.where} has a constant amount, but {load_quantities()[driven.quantity][2].words} of it are requested; "
                "leave one of them out"
            )

    def _check_program(self) -> None:
        case, actuator = self.case, self.case.actuator
        count, known = (
            len(actuator.ratios),
            {part.key: part for part in case.components if isinstance(part, controls.LoadPart)},
        )
        drivers = courses(self.steps)
        cavities = [driver.of for driver in drivers if driver.of_cavity]
        if cavities and sorted(cavities) != sorted(f"cavity{i + 1}" for i in range(count)):
            raise CaseError(f"[load] has series for {len(cavities)} cavities, but the device has {count}; give one for each")
        for driver in drivers:
            if driver.of_load and driver.of not in known:
                table, _, name = driver.of.partition(".")
                raise CaseError(
                    f"[load] has a series for {driver.of}, but the case has no [{table}{'.' + name if name else ''}]; the "
                    f"loads it has are {', '.join(known) or 'none'}"
                )
            if driver.of_load and known[driver.of].kept:
                raise CaseError(
                    f"{known[driver.of].where} has a constant amount, and a series in [load]; leave one of them out"
                )
        if cavities and actuator.ratios != (1.0,) * count:
            raise CaseError("pressure_ratios cannot be combined with a series for each cavity; leave out the ratios")
        if case.load_unload or case.control not in ("auto", "arc-length"):
            raise CaseError("a series for each cavity needs control auto or arc-length, without load_unload")

    def check_size(self, shear_modulus: float, cavity: float) -> None:
        """Raise `CaseError` for values that suggest a wrong unit, given the material's shear modulus in Pa and the cavity's
        volume in m3."""
        cm = self.case.column.pascal
        highest = max(map(abs, [*self.of(PRESSURE), *self._in_program(PRESSURE), self.preload]))
        if highest > STIFFNESS_RANGE * shear_modulus:
            usual_cm, usual_kPa = (f"{float(f'{shear_modulus / unit:.2g}'):g}" for unit in (cm, 1e3))
            raise CaseError(
                f"a pressure of {highest / cm:g} cm ({highest / 1e3:.4g} kPa) is too much for a shear modulus of "
                f"{shear_modulus / 1e3:.4g} kPa: devices take about {usual_cm} cm ({usual_kPa} kPa), and at most "
                f"{STIFFNESS_RANGE * shear_modulus / cm:.0f} cm is accepted; write --pressure '{usual_cm} cm' "
                f"or --pressure '{usual_kPa} kPa' or less, or correct the modulus (silicones have 5 to 500 kPa)"
            )
        volumes = [0.0, *self.of(VOLUME), *self._in_program(VOLUME)]
        if cavity and min(volumes) <= -cavity:
            raise CaseError(
                f"an added volume of {min(volumes) / entries.M3_PER_ML:g} ml empties a cavity of {cavity * 1e6:.4g} ml; "
                "give a volume above "
                f"{-cavity * 1e6:.4g} ml"
            )
        largest = max(volumes)
        if largest > VOLUME_RANGE * cavity:
            raise CaseError(
                f"an added volume of {largest / entries.M3_PER_ML:g} ml against a cavity of {cavity * 1e6:.4g} ml "
                f"is out of range; "
                f"give at most {VOLUME_RANGE:g} times the cavity volume"
            )


# ----------------------------------------------------------------------------------------------------------------------
# Load steps from the keys of ``[load]``.


CM = "cm"
"""Unit of the heights of a column: the key of a pressure has it at its end, or none where the values carry their own."""
CAVITY_KEYS = {"pressure_cm": PRESSURE, PRESSURE: PRESSURE, "volume_ml": VOLUME}
SOURCE_KEYS = {"source_pressure_cm": SOURCE_PRESSURE, SOURCE_PRESSURE: SOURCE_PRESSURE, "flow_ml_per_min": FLOW}
"""Quantities of a source by key: one of them is given."""
SUPPLY_KEYS = {**SOURCE_KEYS, VALVE: VALVE}
TIME_KEY = "time_s"
"""Key of the times at which the steps of a program end."""
STROKE_KEY, PRELOAD = "stroke_ml", "at_pressure"
_UNITS = {
    VOLUME: (entries.M3_PER_ML, "ml"),
    STROKE: (entries.M3_PER_ML, "ml"),
    FLOW: (entries.M3_PER_ML / 60.0, "ml/min"),
    VALVE: (1.0, "open"),
}
"""SI units in one of what case files have, and its name."""
DENSITY = "water_density"
"""Key and option of the density of the column's liquid."""
ONE_REQUEST = (
    "request either pressures (--pressure-cm) or added volumes (--volume-ml), or strokes of a syringe "
    "(--supply syringe with --stroke-ml), or forces on a face (--force-N), or shares of the weight "
    "(--weight-share), or in a case file a series for each cavity (cavity1.pressure_cm); give exactly one of these"
)


def load_keys() -> dict[str, controls.RequestedValue]:
    """Return the descriptions of what may be requested of dead loads by key, such as ``"force_N"``."""
    return {key: asked for _, key, asked in load_quantities().values()}


def request_keys() -> tuple[str, ...]:
    """Return the keys of which a load has one."""
    return ("pressure_cm", PRESSURE, "volume_ml", STROKE_KEY, *load_keys())


def kept_with(key: str) -> tuple[str, ...]:
    """Return the keys of a load that may stay where another request takes the place of its own."""
    preload = ("on", PRELOAD, f"{PRELOAD}_{CM}") if key in load_keys() else ()
    return (key, "rate", "hold", "cycles", DENSITY, "control", "load_unload", "inertia", *preload)


def quantities() -> dict[str, str]:
    """Return the quantity of each key."""
    dead = {key: quantity for quantity, (_, key, _) in load_quantities().items()}
    return {**SUPPLY_KEYS, **CAVITY_KEYS, STROKE_KEY: STROKE, **dead}


def _amount(number: float, quantity: str, cm: float) -> units.Amount:
    """Return an amount of a number in the unit of a quantity's key."""
    scale, unit = (cm, CM) if quantity in (PRESSURE, SOURCE_PRESSURE) else _unit(quantity)
    return units.Amount(number * scale, number, unit)


def _unit(quantity: str) -> tuple[float, str]:
    if quantity in _UNITS:
        return _UNITS[quantity]
    asked = load_quantities()[quantity][2]
    return asked.scale, asked.unit


@checked
def steps_of(*, water_density: float | str = units.WATER_DENSITY, **load: object) -> Steps:
    """Return the load steps of ``[load]``, by its keys.

    Args:
        water_density: Density of the column's liquid in kg/m3, or a text.
        load: Values of one quantity (``pressure_cm="0:177"``, ``pressure="0:4 kPa"``, ``volume_ml=[0, 30]``, ``stroke_ml``,
            ``force_N`` with ``on`` and ``at_pressure_cm``), perhaps with ``rate``, ``hold`` and ``cycles``; or a program
            (``cavity1={"pressure_cm": [10, 20]}``, ``gravity=[0, 1]``, ``source_pressure_cm``, with ``time_s``).

    Raises:
        CaseError: Several quantities, or what belongs to another one.
        SeriesError, FieldError, StepError: Invalid values.
    """
    cm = units.Column(schema.Quantity("kg/m^3").settled(DENSITY, water_density)).pascal
    given = {key: value for key, value in load.items() if value is not None and not _empty(value)}
    in_time = {key: given.pop(key) for key in ("rate", "hold", "cycles") if key in given}
    own = [key for key in request_keys() if key in given]
    if {"pressure_cm", PRESSURE} <= set(own):
        raise errors.FieldError("pressures are requested twice, as pressure and as pressure_cm; leave one of them out")
    dead = [key for key in load_keys() if key in own]
    if len(dead) > 1:
        raise errors.FieldError(f"request one of {' and '.join(dead)}; for several in sequence write a program")
    preload = {key: given.pop(key) for key in ("on", PRELOAD, f"{PRELOAD}_{CM}") if key in given}
    if preload and not dead:
        raise errors.FieldError(f'{next(iter(preload))} needs requested forces, such as force_N = "0:10" (--force-N)')
    if len(own) + bool(set(given) - set(own)) > 1:
        raise CaseError(ONE_REQUEST)
    if not own:
        steps = _program(given, cm) if given else ()
    elif dead:
        steps = _of_load(dead[0], given[dead[0]], cm, **preload)
    else:
        steps = (Step((_series(own[0], given[own[0]], cm),)),)
    if any(in_time.values()):
        return steps_in_time(steps, cm, **in_time)  # type: ignore[arg-type]
    return steps


def _empty(value: object) -> bool:
    return isinstance(value, list | tuple) and not value


def _series(key: str, value: object, cm: float) -> Prescribed:
    """Return the values of a key that rise, or all fall from 0."""
    if key != PRESSURE:
        name = quantities()[key]
        read = entries.series(value, key if key in load_keys() else name)
        return Prescribed(name, tuple(_amount(number, name, cm) for number in read), doubt=read.doubt)
    if not _have_units(value):
        raise entries.SeriesError(
            f'{PRESSURE} {units.brief(value)} has no unit; write it like "0:4 kPa" or ["1 kPa", "2 kPa"], or give pressure_cm'
        )
    return prescribed(PRESSURE, value, cm)  # type: ignore[arg-type]


def _of_load(key: str, value: object, cm: float, on: object = "", **kept: object) -> Steps:
    """Return the steps to values of a dead load, perhaps at a pressure that is applied first and kept."""
    asked = dataclasses.replace(_series(key, value, cm), of=schema.Words().settled("on", on))
    if PRELOAD in kept:
        pressure = entries.one_of_text(CM, schema.Words().settled(PRELOAD, kept[PRELOAD]), PRELOAD, cm)
    else:
        pressure = _amount(schema.Quantity().settled(f"{PRELOAD}_{CM}", kept.get(f"{PRELOAD}_{CM}", 0.0)), PRESSURE, cm)
    before = (Step((Prescribed(PRESSURE, (pressure,)),)),) if pressure else ()
    return *before, Step((asked,))


# ----------------------------------------------------------------------------------------------------------------------
# Programs: a series for each cavity, for dead loads, or for the source of a supply.


def _program(tables: Mapping[str, object], cm: float) -> Steps:
    """Return the steps of a case file's tables: ``cavity1`` and so on by name, ``gravity``, ``force.NAME``, ``moment.NAME``, or
    ``source_pressure_cm`` or ``flow_ml_per_min``, with ``valve``; and ``time_s``.

    Raises:
        StepError: Unknown entries, values that are no numbers, series of unlike lengths, times that run backwards, or as
            `check_steps`.
    """
    keys, tables = controls.requestable(), dict(tables)
    times = tables.pop(TIME_KEY, None)
    if times is not None and not tables:
        raise StepError(f"{TIME_KEY} needs a series that changes in time, such as cavity1.pressure_cm = [0, 40, 0]")
    supplied = _of_supply({key: tables.pop(key) for key in SUPPLY_KEYS if key in tables}, tables, times is not None, cm)
    cavities = [name for name in tables if name not in keys]
    names = [f"cavity{i + 1}" for i in range(len(cavities))]
    if sorted(cavities) != sorted(names):
        raise StepError(f"[load] has {', '.join(cavities)}; name the cavities {', '.join(names)}, each once")
    loads = {target: table for kind in keys if kind in tables for target, table in _of_loads(kind, tables[kind])}
    series = [_one_series(name, tables[name], CAVITY_KEYS, cm) for name in names]
    series += [_one_series(target, table, keys[target.partition(".")[0]], cm) for target, table in loads.items()]
    return _in_steps([*series, *supplied], None if times is None else _numbers(f"time.{TIME_KEY}", times))


def _in_steps(series: Sequence[Prescribed], ends: Sequence[float] | None) -> Steps:
    """Return the steps of series with a value for each, or a constant one; they end at times in s, if these are given."""
    lengths = {driver.name: len(driver.values) for driver in series}
    count = max([*lengths.values(), 0 if ends is None else len(ends)])
    wrong = {name: length for name, length in lengths.items() if length not in (1, count)}
    wrong |= {} if ends is None or len(ends) == count else {"time": len(ends)}
    for name, length in wrong.items():
        raise StepError(
            f"{name} has {length} values but another series has {count}; give one for each step, or a single constant one"
        )
    if ends is not None and (ends[0] < 0.0 or (np.diff(ends) < 0.0).any()):
        raise StepError(f"{TIME_KEY} {units.brief(list(ends))} runs backwards; give times from 0 on, none before the last one")
    rows = zip(*(driver.values * (count if len(driver.values) == 1 else 1) for driver in series), strict=True)
    made = [tuple(Prescribed(p.quantity, (v,), p.of) for p, v in zip(series, row, strict=True)) for row in rows]
    durations = [None] * count if ends is None else durations_of(ends)
    steps = tuple(Step(row, duration) for row, duration in zip(made, durations, strict=True))
    check_steps(steps)
    return steps


def _of_supply(given: Mapping[str, object], others: Mapping[str, object], timed: bool, cm: float) -> list[Prescribed]:
    """Return the series of an air supply in time, none unless there are any."""
    if not given:
        return []
    sources = [key for key in SOURCE_KEYS if key in given]
    if len(sources) != 1:
        raise StepError(
            f"[load] needs one of source_pressure_cm and flow_ml_per_min for its supply; it has {' and '.join(given)}"
        )
    if others:
        raise StepError(f"{sources[0]} is that of the whole load; leave out {' and '.join(others)}")
    if not timed:
        raise StepError(f"{sources[0]} needs the times of its values, such as {TIME_KEY} = [0, 0.5, 20]")
    if VALVE in given and SOURCE_KEYS[sources[0]] != SOURCE_PRESSURE:
        raise StepError(f"a valve belongs to a source of pressure (source_pressure_cm); leave it out with {sources[0]}")
    drivers = [_one_series(key, {key: given[key]}, SUPPLY_KEYS, cm) for key in (*sources, VALVE) if key in given]
    return [dataclasses.replace(driver, of="") for driver in drivers]


def _of_loads(kind: str, table: object) -> list[tuple[str, object]]:
    """Return the series of one kind of load by key: ``gravity = [...]``, ``force.force_N = [...]``, ``force.tip.force_N =
    [...]``."""
    keys = controls.requestable()[kind]
    if len(keys) == 1 and not isinstance(table, Mapping):
        return [(kind, dict.fromkeys(keys, table))]
    if not isinstance(table, Mapping):
        raise StepError(f"{kind} needs one of {' or '.join(keys)}, such as {kind}.tip.{next(iter(keys))} = [0, 2]")
    if any(key in keys for key in table):
        return [(kind, table)]
    return [(f"{kind}.{name}", own) for name, own in table.items()]


def _one_series(name: str, table: object, keys: Collection[str], cm: float) -> Prescribed:
    """Return the values, one for each step, of what a name of a program drives."""
    if not isinstance(table, Mapping) or len(table) != 1 or (key := next(iter(table))) not in keys:
        known = [key for key in keys if key != PRESSURE]
        raise StepError(f"{name} needs one of {' or '.join(known)}, such as {name}.{known[0]} = [20, 40]")
    where, text, quantity = name if name == key else f"{name}.{key}", table[key], quantities()[key]
    if key not in (PRESSURE, SOURCE_PRESSURE):
        return Prescribed(quantity, tuple(_amount(number, quantity, cm) for number in _numbers(where, text)), name)
    if not _have_units(text):
        raise StepError(f'{where} {units.brief(text)} has no unit; write one for each step, such as ["0 kPa", "4 kPa"]')
    if isinstance(text, str):
        return Prescribed(quantity, tuple(entries.of_text(CM, text, where, cm, ordered=False)), name)
    return Prescribed(quantity, tuple(entries.one_of_text(CM, word, where, cm) for word in text), name)


def _have_units(value: object) -> bool:
    """Return whether values are texts, of which each may have its unit."""
    several = isinstance(value, list | tuple) and bool(value) and all(isinstance(text, str) for text in value)
    return isinstance(value, str) or several


def _numbers(where: str, text: object) -> tuple[float, ...]:
    try:
        numbers = tuple(entries.series(text, where, ordered=False))
    except entries.SeriesError as error:
        raise StepError(str(error)) from None
    if not numbers:
        raise StepError(f"{where} {units.brief(text)} has no values; write one for each step, such as [20, 40]")
    return numbers


# ----------------------------------------------------------------------------------------------------------------------
# Steps in time: by a rate, a hold and a number of cycles, or by the times at which values are reached.


def steps_in_time(steps: Steps, cm: float, rate: str = "", hold: float | str = 0.0, cycles: float = 0.0) -> Steps:
    """Return the steps to pressures or volumes at a rate; `CaseError` where nothing changes in time so.

    The rate is such as ``"1 kPa/s"``, empty for at once; the last value is held for ``hold`` s, in each cycle. Cycles go from
    0 and back to 0; 0 of them for once and without the way back.
    """
    rate, hold = schema.Words().settled("rate", rate), schema.Quantity("s").settled("hold", hold)
    cycles = schema.Quantity().settled("cycles", cycles)
    driver = steps[0].prescribed[0] if steps and not is_program(steps) else None
    if driver is None or not driver.of_cavity or driver.values[-1] == 0.0:
        raise CaseError(
            "--rate, --hold and --cycles need pressures or added volumes that they change (--pressure-cm, --volume-ml)"
        )
    if hold < 0.0:
        raise CaseError(f"hold is {hold:g} s; it must be 0 or more")
    if cycles != round(cycles) or not 0 <= cycles <= MAX_STEPS / 4:
        raise CaseError(f"cycles is {cycles:g}; it must be a whole number from 1 to {MAX_STEPS // 4}")
    if cycles and not rate:
        raise CaseError("--cycles needs the rate at which they go up and down; add --rate, such as --rate 1kPa/s")
    speed, rest = _rate(rate, driver, cm) if rate else math.inf, _amount(0.0, driver.quantity, cm)
    way = [Step((Prescribed(driver.quantity, (rest,)),), 0.0)]

    def go(value: float, held: float = 0.0) -> None:
        last = way[-1].prescribed[0].values[0]
        if value != last:
            way.append(Step((Prescribed(driver.quantity, (value,)),), abs(value - last) / speed))
        if held:
            way.append(Step((Prescribed(driver.quantity, (value,)),), held))

    for _ in range(max(1, round(cycles))):
        for value in driver.values[:-1]:
            go(value)
        go(driver.values[-1], hold)
        if cycles:
            go(rest)
    return tuple(way)


def _rate(text: str, driver: Prescribed, cm: float) -> float:
    """Return a rate in Pa/s, or in m3/s of added volumes."""
    kinds = [("Pa/s", 1.0), ("m/s", 100.0 * cm)] if driver.quantity == PRESSURE else [("m^3/s", 1.0)]
    for unit, scale in kinds:
        try:
            rate = units.quantity(text, unit) * scale
        except units.UnitError:
            continue
        if rate > 0.0:
            return rate
        raise CaseError(f"rate {units.brief(text)} must be above 0; the way back is --cycles")
    raise CaseError(
        f"rate {units.brief(text)} is none; write it like {'1kPa/s or 5cm/s' if driver.quantity == PRESSURE else '2ml/s'}"
    )


type Values = str | float | Sequence[float | str] | npt.NDArray[np.float64]
"""Requested values: a text with a unit such as ``"0:177 cm"``, texts such as ``["1 kPa", "2 kPa"]``, or numbers in SI units."""
SECONDS = schema.Quantity("s")
EXAMPLES = {PRESSURE: "'0:177 cm'", VOLUME: "'0:60 ml'", STROKE: "'0:20 ml'"}


def prescribed(quantity: str, values: Values, cm: float, falls: bool = False) -> Prescribed:
    """Return requested pressures, volumes or strokes as a call of the library has them, texts with units or SI numbers; a list
    may fall if ``falls``. `CaseError` for invalid ones."""
    unit = CM if quantity == PRESSURE else "ml"
    try:
        if isinstance(values, str):
            read = entries.of_text(unit, values, quantity, cm, ordered=not falls)
            return Prescribed(quantity, tuple(read), doubt=read.doubt)
        amounts = [
            entries.one_of_text(unit, value, quantity, cm)
            if isinstance(value, str)
            else as_written(units.number(value), quantity, cm)
            for value in listed(values, quantity)
        ]
        if not amounts:
            raise CaseError(f"the list of {quantity}s is empty; give at least one value, such as {EXAMPLES[quantity]}")
        if not falls:
            entries.check_order(amounts, quantity)
        return Prescribed(quantity, tuple(amounts))
    except (entries.SeriesError, units.UnitError) as error:
        raise CaseError(str(error)) from None


def as_written(value: float, quantity: str, cm: float) -> units.Amount:
    """Return a value in SI with its text: its own; or that of case files, Pa of a pressure, so that a file with it is read as
    exactly this value."""
    of_column = quantity in (PRESSURE, SOURCE_PRESSURE)
    if isinstance(value, units.Amount) and (value.unit != CM or value == value.number * cm):
        return value
    if of_column:
        return units.Amount(value, float(value), "Pa")
    return _amount(value / _unit(quantity)[0], quantity, cm)


def listed(values: object, what: str) -> list[float | str]:
    """Return requested values as a list of Python's numbers and texts; else `CaseError`."""
    try:
        given = units.plain(values)
        each = [units.plain(value) for value in (given if isinstance(given, list | tuple) else [given])]
    except units.UnitError as error:
        raise CaseError(f"{what} {error}") from None
    if not all(isinstance(value, int | float | str) and not isinstance(value, bool) for value in each):
        raise CaseError(f"{what} {units.brief(values)} is neither numbers nor a text with a unit")
    return each


def at_times(asked: Sequence[Prescribed], times: Values, supply: AirSupply | None, valve: Values | None) -> Steps:
    """Return the steps to requested pressures or volumes at their times, with the opening of a supply's valve."""
    if len(asked) != 1:
        raise CaseError("times belong to requested pressures or to added volumes; give one of these")
    ends = [SECONDS.settled("times", time) for time in listed(times, "times")]
    if len(ends) != len(asked[0].values):
        raise CaseError(f"there are {len(asked[0].values)} values but {len(ends)} times; give one for each")
    if valve is None:
        return _in_steps(asked, ends)
    if supply is None or not supply.in_time:
        raise CaseError("a valve belongs to a supply in time; add supply=Reservoir()")
    opening = tuple(_amount(number, VALVE, 1.0) for number in _numbers(VALVE, listed(valve, VALVE)))
    return _in_steps([*asked, Prescribed(VALVE, opening)], ends)


# ----------------------------------------------------------------------------------------------------------------------
# The field `Case.steps`: in the table ``[load]`` of case files, and as options.


OPTIONS = {"share": "weight_share"}
"""Names of the options that differ from the key."""
PRESSURE_TEXT = "pressures in cm of the column (of --water-density): 0:177, 0:177:10 or 0,70,130,177"
IN_TIME = (
    entries.Value("load", schema.About(schema.Words(),
    "rate of pressure or added volume, of a silicone with a memory: 1kPa/s, 5cm/s of the "
          "column or 2ml/s; without it they are applied at once"), "", "rate", hidden=True, metavar="RATE"),
    entries.Value("load", schema.About(SECONDS,
    "time for which the last pressure or volume is held, such as 60s"), 0.0, "hold", hidden=True),
    entries.Value("load", schema.About(schema.Quantity(),
    "number of times the pressure or volume goes up, and down to 0 again, at the "
          "rate"), 0.0, "cycles", hidden=True),
)  # fmt: skip


class StepsEntry(Entry[Steps]):
    """The load steps, in the table of the load."""

    tables = ("load",)

    @property
    def keys(self) -> tuple[str, ...]:  # type: ignore[override]
        own = [option.name for option in self.options()]
        return *own, *load_keys(), PRELOAD, "cavity1", *controls.requestable(), TIME_KEY, *SUPPLY_KEYS

    def known(self, key: str) -> bool:
        return key.startswith("cavity") or key in self.keys

    def read(self, tables: entries.Tables) -> Steps | entries.Missing:
        table = {key: value for key, value in entries.table_of(tables, "load").items() if self.known(key)}
        table |= {time_entry.key: time_entry.read(tables) for time_entry in IN_TIME if time_entry.key in table}
        return self._made(table, entries.table_of(tables, "load").get(DENSITY))

    def write(self, value: Steps, text: schema.Text) -> entries.Written:
        return {"load": load_table(value)} if value else {}

    def options(self) -> Iterator[entries.Option]:
        yield entries.Option("pressure_cm", schema.About(schema.Words(), PRESSURE_TEXT), metavar="SERIES")
        text = "pressures with a unit, instead of heights of a column: 0:4kPa or 0,1,2kPa"
        yield entries.Option(PRESSURE, schema.About(schema.Words(), text), metavar="SERIES")
        text = "added volumes of the cavity in ml, instead of pressures"
        yield entries.Option("volume_ml", schema.About(schema.Words(), text), metavar="SERIES")
        text = "strokes of the supply, such as a syringe's piston, in ml, instead of pressures, such as 0:20"
        yield entries.Option(STROKE_KEY, schema.About(schema.Words(), text), metavar="SERIES")
        for key, asked in load_keys().items():
            yield entries.Option(OPTIONS.get(key, key), schema.About(schema.Words(), asked.help), metavar="SERIES")
        yield entries.Option(
            "on", schema.About(schema.Words(), "name of the load they refer to, if a case has several"), metavar="NAME"
        )
        text = "pressure in cm of the column, applied first and then constant, for forces on an inflated device"
        yield entries.Option(f"{PRELOAD}_{CM}", schema.About(schema.Quantity(), text))
        for time_entry in IN_TIME:
            yield from time_entry.options()

    def arguments(self, field: str) -> dict[str, str]:
        texts = {"pressure_cm": "pressures", PRESSURE: "pressures", "volume_ml": "volumes", STROKE_KEY: "strokes"}
        dead = {OPTIONS.get(key, key): f"{field}=steps_of({key}=...)" for key in (*load_keys(), "on", f"{PRELOAD}_{CM}")}
        return {**texts, **dead}

    def take(self, options: MutableMapping[str, object]) -> Steps | entries.Missing:
        keys = {name: key for key, name in OPTIONS.items()}
        given = {keys.get(option.name, option.name): options.pop(option.name, None) for option in self.options()}
        return self._made(given, options.get(DENSITY))

    def _made(self, given: Mapping[str, object], density: object) -> Steps | entries.Missing:
        if density is not None and not isinstance(density, float):
            density = schema.Quantity("kg/m^3").read(DENSITY, density)
        made = steps_of(**{DENSITY: units.WATER_DENSITY if density is None else density, **given})  # type: ignore[arg-type]
        return made or entries.MISSING


def load_table(steps: Steps) -> dict[str, object]:
    """Return the entries of ``[load]`` that `steps_of` takes back."""
    if not is_program(steps):
        *before, last = (step.prescribed[0] for step in steps)
        written: dict[str, object] = {**_entry(last), **({"on": last.of} if last.of else {})}
        for driver in before:
            ((key, (value,)),) = _entry(driver).items()
            written[f"{PRELOAD}{key.removeprefix(PRESSURE)}"] = value
        return written
    tables: dict[str, dict[str, object]] = {}
    flat: dict[str, object] = {}
    for driver in courses(steps):
        kind, _, own = driver.of.partition(".")
        if not kind:
            flat |= _entry(driver)
            continue
        table = tables.setdefault(kind, {})
        (table if not own else table.setdefault(own, {})).update(_entry(driver))  # type: ignore[attr-defined]
    return {**tables, **flat, **({TIME_KEY: list(times_of(steps))} if timed(steps) else {})}


def _entry(driver: Prescribed) -> dict[str, list[float | str]]:
    """Return the key of a quantity, with its values as written."""
    values = [units.as_amount(value) for value in driver.values]
    if driver.quantity in (PRESSURE, SOURCE_PRESSURE) and any(value.unit != CM for value in values):
        return {driver.quantity: [value.text for value in values]}
    key = next(key for key, quantity in quantities().items() if quantity == driver.quantity)
    return {key: [value.number for value in values]}


# ----------------------------------------------------------------------------------------------------------------------
# What the load steps of a case say.


STIFFNESS_RANGE = 30.0
"""Maximum pressure in shear moduli; above it a wrong unit is assumed: no silicone device withstands a tenth of it."""
VOLUME_RANGE = 1000.0
"""Maximum added volume in cavity volumes; above it a wrong unit is assumed: silicones tear at a tenth of that stretch."""


@dataclasses.dataclass(frozen=True)
class Requested:
    """A quantity that can be requested: its name and plural for the path and messages, and its variable of a run's table."""

    name: str
    words: str
    variable: str


REQUESTED = {
    PRESSURE: Requested("pressure", "pressures", "pressure"),
    VOLUME: Requested("volume", "added volumes", "added_volume"),
    STROKE: Requested("stroke", "strokes", "stroke"),
}
STEP = Requested("step", "steps", "load_step")


def load_part(asked: Prescribed, components: Sequence[Component]) -> controls.LoadPart:
    """Return the dead load that values are requested of; `FieldError` if there is none, or several."""
    table, key, of = load_quantities()[asked.quantity]
    loads = [part for part in components if isinstance(part, controls.LoadPart) and part.table == table]
    named = [part for part in loads if not asked.of or asked.of in (part.name, part.key)]
    if len(named) == 1:
        return named[0]
    if not loads:
        raise errors.FieldError(f"{of.words} are requested ({key}), but the device has no [{table}]; add one (--{table})")
    names = ", ".join(part.name or "without a name" for part in loads)
    raise errors.FieldError(f'{key} refers to one {table}, but the case has {names}; choose one (on = "{loads[0].name}")')


class Loaded(Protocol):
    """The fields of a case that its load steps depend on."""

    @property
    def actuator(self) -> Actuator: ...
    @property
    def steps(self) -> Steps: ...
    @property
    def components(self) -> tuple[Component, ...]: ...
    @property
    def supply(self) -> AirSupply | None: ...
    @property
    def control(self) -> str: ...
    @property
    def load_unload(self) -> bool: ...
    @property
    def inertia(self) -> bool: ...
    @property
    def band(self) -> materials.AnyBand | None: ...
    @property
    def water_density(self) -> float: ...
    @property
    def column(self) -> units.Column: ...


def settled(case: Loaded) -> Steps:
    """Return the steps of a case, each of a program with what it drives, all values with their texts, and durations that the
    times of a case file give too."""
    steps = tuple(_driving(step, case) for step in case.steps) if is_program(case.steps) else case.steps
    if all(step.duration is not None for step in steps):
        durations = durations_of(times_of(steps))
        steps = tuple(dataclasses.replace(step, duration=span) for step, span in zip(steps, durations, strict=True))
    return tuple(
        dataclasses.replace(
            step,
            prescribed=tuple(
                dataclasses.replace(p, values=tuple(as_written(v, p.quantity, case.column.pascal) for v in p.values))
                for p in step.prescribed
            ),
        )
        for step in steps
    )


def _driving(step: Step, case: Loaded) -> Step:
    """Return a step of a program whose values are of all cavities, or of the source of a supply in time, as theirs."""
    drivers: list[Prescribed] = []
    for driver in step.prescribed:
        if len(driver.values) != 1:
            raise CaseError(f"{driver.name} has {len(driver.values)} values in one of several steps; give one value in each")
        if driver.named:
            drivers.append(driver)
        elif driver.of_load:
            drivers.append(dataclasses.replace(driver, of=load_part(driver, case.components).key))
        elif driver.quantity == STROKE:
            raise CaseError("strokes are requested in a single step; leave out the others, and the durations")
        elif case.supply is None or not case.supply.in_time:
            drivers += [dataclasses.replace(driver, of=f"cavity{i + 1}") for i in range(len(case.actuator.ratios))]
        elif driver.quantity == PRESSURE:
            drivers.append(dataclasses.replace(driver, quantity=SOURCE_PRESSURE))
        else:
            raise CaseError(
                f"a {case.supply.name} supplies pressures, not added volumes; request pressures, those of its source"
            )
    return dataclasses.replace(step, prescribed=tuple(drivers))
