"""Load programs: values of cavities and dead loads, step by step.

Each cavity, and each dead load that changes, has a series of values, one for each step; from step to step all of them change
together, in proportion. A step changes either pressures, forces and the like, or volumes and travels. A series of times says
when; a step between equal values is then a hold, and one between equal times a jump. With an air supply in time
(`softmodels.path.supply`) the series is that of its source, not of the cavities. A device is taken through it by
`softmodels.path.schedule`.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from softmodels.common.errors import Spoken
from softmodels.common.names import checked
from softmodels.common.units import (
    WATER_DENSITY,
    UnitError,
    brief,
    column_unit,
    numbers as as_numbers,
    pascal_per_cm,
    quantity,
)
from softmodels.mechanics.controls import RequestedValue, requestable

KEYS = {"pressure_cm": RequestedValue("cm"), "volume_ml": RequestedValue("ml", True, 1e-6)}
"""Quantities of a cavity, as in the case file."""
TIME, TIME_KEY = "time", "time_s"
"""Target and key of the series of times, which drives nothing."""
TIME_VALUE = RequestedValue("s")
SOURCE, VALVE = "source", "valve"
"""Targets of the series of an air supply's source and of its valve."""
SOURCE_KEYS = {
    "source_pressure_cm": RequestedValue("cm"),
    "flow_ml_per_min": RequestedValue("ml/min", scale=1e-6 / 60.0),
}
"""Quantities of a source: one of them is given."""
SUPPLY_KEYS = {**SOURCE_KEYS, VALVE: RequestedValue("open")}
"""Quantities of an air supply in time."""
MOST_STEPS = 1000
TOLERANCE = 5e-5
"""Maximum error of the silicone's stress by one step in time, over the largest stress so far."""
LEAST_TOLERANCE = 1e-8
"""The least that may be asked for: ten times the tolerance of Newton's method."""


def every_key() -> dict[str, RequestedValue]:
    """Return the quantities that series may prescribe, of cavities, dead loads and air supplies, and the time."""
    known = {key: asked for keys in (KEYS, *requestable().values()) for key, asked in keys.items()}
    return {**known, TIME_KEY: TIME_VALUE, **SUPPLY_KEYS}


class ProgramError(Spoken, ValueError):
    """An invalid program; the message is for the user."""


@checked
@dataclasses.dataclass(frozen=True)
class Series:
    """The values of a cavity or a dead load, step by step.

    Attributes:
        key: One of `every_key`.
        values: Pressures in cm of the column, added volumes in ml and so on, one for each step.
        target: The dead load, such as ``"force.tip"``; empty for a cavity, whose place among these counts; `TIME` for times;
            `SOURCE` and `VALVE` for an air supply.
    """

    key: str
    values: tuple[float, ...]
    target: str = ""

    @property
    def unit(self) -> str:
        return every_key()[self.key].unit

    @property
    def is_volume(self) -> bool:
        """Whether volumes or travels are prescribed instead of pressures or forces."""
        return every_key()[self.key].held

    @property
    def scale(self) -> float:
        return every_key()[self.key].scale


Program = tuple[Series, ...]


def from_tables(tables: Mapping[str, object]) -> Program:
    """Return the program of a case file's tables: ``cavity1`` and so on by name, ``gravity``, ``force.NAME``,
    ``moment.NAME``, or ``source_pressure_cm`` or ``flow_ml_per_min``, with ``valve``; and ``time_s``.

    Raises:
        ProgramError: Unknown entries, values that are no numbers, pressures below zero, series of unlike lengths, times that
            run backwards, or a step that changes nothing or both pressures and volumes.
    """
    keys, tables = requestable(), dict(tables)
    times = tables.pop(TIME_KEY, None)
    if times is not None and not tables:
        raise ProgramError(f"{TIME_KEY} needs a series that changes in time, such as cavity1.pressure_cm = [0, 40, 0]")
    supplied = _of_supply({key: tables.pop(key) for key in SUPPLY_KEYS if key in tables}, tables, times is not None)
    cavities = [name for name in tables if name not in keys]
    names = [f"cavity{i + 1}" for i in range(len(cavities))]
    if sorted(cavities) != sorted(names):
        raise ProgramError(f"[load] has {', '.join(cavities)}; name the cavities {', '.join(names)}, each once")
    loads = {target: table for kind in keys if kind in tables for target, table in _of_loads(kind, tables[kind])}
    given = {name: _series(name, tables[name], KEYS) for name in names}
    for target, table in loads.items():
        given[target] = dataclasses.replace(_series(target, table, keys[target.partition(".")[0]]), target=target)
    given |= supplied
    if times is not None:
        given[TIME] = dataclasses.replace(_series(TIME, {TIME_KEY: times}, {TIME_KEY: TIME_VALUE}), target=TIME)
    count = max(len(series.values) for series in given.values())
    if count > MOST_STEPS:
        raise ProgramError(f"the program has {count} steps; at most {MOST_STEPS} are allowed")
    # A single value is constant over all steps.
    program = tuple(
        dataclasses.replace(series, values=series.values * count)
        if len(series.values) == 1 and series.target != TIME
        else series
        for series in given.values()
    )
    for name, series in zip(given, program, strict=True):
        if len(series.values) != count:
            raise ProgramError(
                f"{name} has {len(series.values)} values but another series has {count}; give one for each "
                f"step, or a single constant one"
            )
    _check_steps(program)
    return program


def _of_supply(given: Mapping[str, object], others: Mapping[str, object], timed: bool) -> dict[str, Series]:
    """Return the series of an air supply in time, none unless there are any."""
    if not given:
        return {}
    sources = [key for key in SOURCE_KEYS if key in given]
    if len(sources) != 1:
        raise ProgramError(
            f"[load] needs one of {' and '.join(SOURCE_KEYS)} for its supply; it has {' and '.join(given)}"
        )
    if others:
        raise ProgramError(f"{sources[0]} is that of the whole load; leave out {' and '.join(others)}")
    if not timed:
        raise ProgramError(f"{sources[0]} needs the times of its values, such as {TIME_KEY} = [0, 0.5, 20]")
    if VALVE in given and sources[0] not in ("source_pressure_cm",):
        raise ProgramError(
            f"a valve belongs to a source of pressure (source_pressure_cm); leave it out with {sources[0]}"
        )
    found = {}
    for target, key in ((SOURCE, sources[0]), (VALVE, VALVE)):
        if key in given:
            found[target] = dataclasses.replace(_series(key, {key: given[key]}, {key: SUPPLY_KEYS[key]}), target=target)
    if VALVE in found and not all(0.0 <= value <= 1.0 for value in found[VALVE].values):
        raise ProgramError(f"valve {brief(given[VALVE])} must be between 0 (closed) and 1 (open)")
    return found


def _of_loads(kind: str, table: object) -> list[tuple[str, object]]:
    """Return the series of one kind of load by key: ``gravity = [...]``, ``force.force_N = [...]``, ``force.tip.force_N =
    [...]``."""
    keys = requestable()[kind]
    if len(keys) == 1 and not isinstance(table, Mapping):
        return [(kind, dict.fromkeys(keys, table))]
    if not isinstance(table, Mapping):
        raise ProgramError(f"{kind} needs one of {' or '.join(keys)}, such as {kind}.tip.{next(iter(keys))} = [0, 2]")
    if any(key in keys for key in table):
        return [(kind, table)]
    return [(f"{kind}.{name}", entries) for name, entries in table.items()]


def _in_cm(name: str, table: object) -> str:
    """Return the end of a sentence: what a pressure with a unit is in cm of the usual column."""
    text = table.get("pressure") if isinstance(table, Mapping) else None
    try:
        height = quantity(text, "Pa") / pascal_per_cm(WATER_DENSITY) if isinstance(text, str) else 0.0
    except UnitError:
        height = 0.0
    return f"; {text} are {height:.5g} {column_unit()}: {name}.pressure_cm = {height:.5g}" if height else ""


def _series(name: str, table: object, keys: Mapping[str, RequestedValue]) -> Series:
    if not isinstance(table, Mapping) or len(table) != 1 or (key := next(iter(table))) not in keys:
        raise ProgramError(
            f"{name} needs one of {' or '.join(keys)}, such as {name}.{next(iter(keys))} = [20, 40]{_in_cm(name, table)}"
        )
    text, where = table[key], name if name == key else f"{name}.{key}"
    values = text.split(",") if isinstance(text, str) else text if isinstance(text, list | tuple) else [text]
    try:
        numbers = tuple(as_numbers(values))
    except UnitError as error:
        raise ProgramError(
            f"{where} {brief(text)} is not numbers ({error}); write one for each step, such as [20, 40]"
        ) from None
    if not numbers:
        raise ProgramError(f"{where} {brief(text)} has no values; write one for each step, such as [20, 40]")
    return Series(key, numbers)


def _check_steps(program: Program) -> None:
    if not changes(tuple(series for series in drivers(program) if series.target != VALVE)).any():
        raise ProgramError("the program contains only zeros; add a value above 0")
    times = times_of(program)
    if times is not None and (times[0] < 0.0 or (np.diff(times) < 0.0).any()):
        raise ProgramError(
            f"{TIME_KEY} {brief(times.tolist())} runs backwards; give times from 0 on, none before the last one"
        )
    for number, change in enumerate(changes(program), 1 - int(begins_at_rest(program))):
        kinds = {
            series.is_volume for series, step in zip(program, change, strict=True) if step and series.target != TIME
        }
        if not change.any() and number > 0:
            raise ProgramError(f"step {number} of the program changes nothing; leave it out, or give other values")
        if len(kinds) == 2:
            raise ProgramError(
                f"step {number} of the program changes pressures and volumes at once; change them in two steps, one after "
                "the other"
            )


def drivers(program: Program) -> Program:
    """Return a program without its times."""
    return tuple(series for series in program if series.target != TIME)


def times_of(program: Program) -> npt.NDArray[np.float64] | None:
    """Return the times in s of a program's values; None for one without."""
    return next((np.array(series.values) for series in program if series.target == TIME), None)


def timed(program: Program) -> bool:
    """Return whether a program has times."""
    return times_of(program) is not None


def time_at(program: Program, come: float) -> float:
    """Return the time in s after so many steps, 1.5 for half of the second."""
    return value_at(program, TIME, come)


def value_at(program: Program, target: str, come: float) -> float:
    """Return the value of a target's series after so many steps; before the first one it is 0, a valve's as there."""
    values = next(series.values for series in program if series.target == target)
    ends = values if begins_at_rest(program) else (values[0] if target == VALVE else 0.0, *values)
    return float(np.interp(come, np.arange(len(ends)), ends))


def source_key(program: Program) -> str:
    """Return the key of the series of an air supply's source; empty if there is none."""
    return next((series.key for series in program if series.target == SOURCE), "")


def begins_at_rest(program: Program) -> bool:
    """Return whether the first values are all zero: the undeformed state, as step 0; a valve may be open."""
    return not any(series.values[0] for series in program if series.target != VALVE)


def changes(program: Program) -> npt.NDArray[np.float64]:
    """Return the changes from step to step from the undeformed state on, in cm and ml, shape (steps, cavities)."""
    values = np.array([series.values for series in program]).T
    return np.diff(values, axis=0, prepend=0.0)


def goes_on(program: Program, old: Program) -> bool:
    """Return whether a program equals another one, or extends it by more steps."""
    return len(program) == len(old) and all(
        (new.key, new.target) == (before.key, before.target) and new.values[: len(before.values)] == before.values
        for new, before in zip(program, old, strict=True)
    )


def to_tables(program: Program) -> dict[str, object]:
    """Return the tables that `from_tables` takes back."""
    written: dict[str, dict[str, object]] = {}
    flat: dict[str, object] = {}
    for name, series in named(drivers(program)).items():
        kind, _, own = name.partition(".")
        if series.target in (SOURCE, VALVE):
            flat[series.key] = list(series.values)
            continue
        table = written.setdefault(kind, {})
        (table if not own else table.setdefault(own, {})).update({series.key: list(series.values)})  # type: ignore[attr-defined]
    times = times_of(program)
    return {**written, **flat, **({} if times is None else {TIME_KEY: times.tolist()})}


def named(program: Program) -> dict[str, Series]:
    """Return the series by the names of their cavities and loads: ``cavity1``, ``force.tip``."""
    names = (f"cavity{i}" for i in itertools.count(1))
    return {series.target or next(names): series for series in program}


def step_text(program: Program, number: int) -> str:
    """Return the values of the cavities and loads at a step: ``"cavity1 60 cm, cavity2 2 ml added"``."""
    row = number - 1 + int(begins_at_rest(program))
    added = {key: " added" if key in KEYS and given.held else "" for key, given in every_key().items()}
    return ", ".join(
        f"{name} {series.values[row]:g} {series.unit}{added[series.key]}" for name, series in named(program).items()
    )
