"""Load steps: what is prescribed of a device, one step after the other, in SI units.

A step prescribes a pressure, an added volume, a stroke of the supply, or a force, a travel or a share of the weight; everything
that it does not name stays as it was. Most runs are a single step of one quantity, whose values the path stops at. A program
has several steps, of one value each, and names what it drives: each cavity (``cavity1``), each dead load (``force.tip``), or
the source of a supply in time (`softmodels.path.supply`). Its steps may have durations: a step between equal values is then a
hold, and one without duration a jump. `softmodels.path.schedule` takes a device through it.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence

import numpy as np

from softmodels.common import errors, units
from softmodels.common.names import checked
from softmodels.mechanics import controls


@checked
@dataclasses.dataclass(frozen=True)
class Step:
    """One load step.

    Attributes:
        prescribed: What is prescribed; everything else stays as it was.
        duration: Time in s that it takes; None for equilibrium, after a long time.
    """

    prescribed: tuple[Prescribed, ...]
    duration: float | None = None


PRESSURE, VOLUME, STROKE = "pressure", "volume", "stroke"
"""Quantities of the cavities (Pa; m3 added), and of a supply driven by strokes (m3)."""
SOURCE_PRESSURE, FLOW, VALVE = "source_pressure", "flow", "valve"
"""Quantities of a supply in time: Pa, m3/s at ambient pressure, and 0 (closed) to 1 (open)."""
OF_SUPPLY = (SOURCE_PRESSURE, FLOW, VALVE)
MAX_STEPS = 1000
STRESS_TOLERANCE = 5e-5
"""Maximum error of the silicone's stress by one step in time, over the largest stress so far."""
MIN_STRESS_TOLERANCE = 1e-8
"""The least that may be asked for: ten times the tolerance of Newton's method."""


class StepError(errors.OptionMessage, ValueError):
    """Invalid load steps; the message is for the user."""


def load_quantities() -> dict[str, tuple[str, str, controls.RequestedValue]]:
    """Return what may be requested of dead loads by its name, such as ``"force"``: table, key in case files, description."""
    return {
        key.rpartition("_")[0] or key: (table, key, asked)
        for table, keys in controls.requestable().items()
        for key, asked in keys.items()
    }


@checked
@dataclasses.dataclass(frozen=True)
class Prescribed:
    """Values of one quantity.

    Attributes:
        quantity: `PRESSURE`, `VOLUME` and so on, or one of `load_quantities`.
        values: SI units; `Amount` where they reached from a text. They rise, or all fall from 0; of a program it is one.
        of: The cavity (``"cavity1"``) or the dead load (``"force.tip"``, ``"gravity"``) of a program. Otherwise empty for all
            cavities together, or the only dead load of its kind; or that load's own name.
        doubt: A sentence where the text is ambiguous.
    """

    quantity: str
    values: tuple[float, ...]
    of: str = ""
    doubt: str = dataclasses.field(default="", compare=False, repr=False)

    def __post_init__(self) -> None:
        known = (PRESSURE, VOLUME, STROKE, *OF_SUPPLY, *load_quantities())
        if self.quantity not in known:
            raise StepError(f"quantity {self.quantity!r} of a step is unknown; {errors.known_are(self.quantity, known)}")
        try:
            given = units.plain(self.values)
            each = given if isinstance(given, list | tuple) else [given]
            values = tuple(value if isinstance(value, units.Amount) else units.number(value) for value in each)
        except units.UnitError as error:
            raise StepError(f"{self.quantity} {units.brief(self.values)} of a step: {error}") from None
        object.__setattr__(self, "values", values)

    @property
    def held(self) -> bool:
        """Whether it is what a driver works on, a volume or a travel, and not its magnitude."""
        return self.quantity == VOLUME or (self.of_load and load_quantities()[self.quantity][2].held)

    @property
    def of_cavity(self) -> bool:
        return self.quantity in (PRESSURE, VOLUME)

    @property
    def of_load(self) -> bool:
        return self.quantity in load_quantities()

    @property
    def named(self) -> bool:
        """Whether it says what it drives, as those of a program do."""
        of_driver = self.of_cavity or self.of.partition(".")[0] in controls.requestable()
        return self.quantity in OF_SUPPLY or bool(self.of and of_driver)

    @property
    def name(self) -> str:
        """What it drives: ``"cavity1"``, ``"force.tip"``, ``"source"`` or ``"valve"``."""
        return self.of or ("source" if self.quantity in (SOURCE_PRESSURE, FLOW) else self.quantity)


Steps = tuple[Step, ...]


def one_step(quantity: str, values: Sequence[float]) -> Steps:
    """Return the single step to values of one quantity."""
    return (Step((Prescribed(quantity, tuple(values)),)),)


def is_program(steps: Steps) -> bool:
    """Return whether steps are a program, and not the values of one quantity, perhaps of a dead load at a pressure before."""
    if any(p.named for step in steps for p in step.prescribed) or any(step.duration is not None for step in steps):
        return True
    if not steps or any(len(step.prescribed) != 1 for step in steps):
        return bool(steps)
    *before, last = (step.prescribed[0] for step in steps)
    kept = [driver.quantity == PRESSURE and len(driver.values) == 1 for driver in before]
    return len(before) > 1 or not all(kept) or bool(before and not last.of_load)


def courses(steps: Steps) -> tuple[Prescribed, ...]:
    """Return the values of each driver of a program, one for each step. What a step does not name stays as it was, from 0 on,
    or from an open valve."""
    series: dict[tuple[str, str], list[float]] = {}
    for place, step in enumerate(steps):
        for driver in step.prescribed:
            before = 1.0 if driver.quantity == VALVE else 0.0
            series.setdefault((driver.quantity, driver.of), [before] * place).append(driver.values[0])
        for values in series.values():
            values += values[-1:] * (place + 1 - len(values))
    return tuple(Prescribed(quantity, tuple(values), of) for (quantity, of), values in series.items())


def check_steps(steps: Steps) -> None:
    """Raise `StepError` for a program that changes nothing, in a step or at all, changes pressures and volumes at once, or has
    durations of some steps only."""
    if len(steps) > MAX_STEPS:
        raise StepError(f"the program has {len(steps)} steps; at most {MAX_STEPS} are allowed")
    drivers = courses(steps)
    changes = np.diff(np.array([driver.values for driver in drivers]).T, axis=0, prepend=0.0)
    if not changes[:, [driver.quantity != VALVE for driver in drivers]].any():
        raise StepError("the program contains only zeros; add a value above 0")
    for opening in (value for driver in drivers if driver.quantity == VALVE for value in driver.values):
        if not 0.0 <= opening <= 1.0:
            raise StepError(f"valve {opening:g} must be between 0 (closed) and 1 (open)")
    durations = [step.duration for step in steps]
    if None in durations and any(duration is not None for duration in durations):
        raise StepError("some steps have a duration and others none; give it for all of them, 0 for a jump, or for none")
    if (shortest := min(duration or 0.0 for duration in durations)) < 0.0:
        raise StepError(f"a step has a duration of {shortest:g} s; it must be 0 or more")
    for name in {driver.name for driver in drivers}:
        if len(several := [driver.quantity for driver in drivers if driver.name == name]) > 1:
            raise StepError(f"{name} has {' and '.join(several)} prescribed; prescribe one of them in all steps")
    for place, (step, change) in enumerate(zip(steps, changes, strict=True), 1 - int(begins_at_rest(steps))):
        if not change.any() and not step.duration and place > 0:
            raise StepError(f"step {place} of the program changes nothing; leave it out, or give other values")
        if len({driver.held for driver, changed in zip(drivers, change, strict=True) if changed}) == 2:
            raise StepError(
                f"step {place} of the program changes pressures and volumes at once; change them in two steps, one after "
                "the other"
            )


def timed(steps: Steps) -> bool:
    """Return whether steps take time."""
    return any(step.duration is not None for step in steps)


def times_of(steps: Steps) -> tuple[float, ...]:
    """Return the times in s at which the steps of a timed program end."""
    return tuple(itertools.accumulate(step.duration or 0.0 for step in steps))


def durations_of(times: Sequence[float]) -> list[float]:
    """Return the durations of steps that end at times in s, from which `times_of` makes the same floats."""
    durations, now = [], 0.0
    for time in times:
        durations.append(time - now)
        now += durations[-1]
    return durations


def time_at(steps: Steps, reached: float) -> float:
    """Return the time in s after so many steps, 1.5 for half of the second."""
    return _between(steps, times_of(steps), 0.0, reached)


def value_at(steps: Steps, quantity: str, reached: float) -> float:
    """Return the value of a supply's quantity after so many steps; before the first one it is 0, a valve's as there."""
    values = next(course.values for course in courses(steps) if course.quantity == quantity)
    return _between(steps, values, values[0] if quantity == VALVE else 0.0, reached)


def _between(steps: Steps, values: Sequence[float], first: float, reached: float) -> float:
    """Return the value after so many steps; at the end of one, and where it stays, as it was written."""
    ends = values if begins_at_rest(steps) else (first, *values)
    step = int(reached)
    if reached == step or ends[step] == ends[step + 1]:
        return ends[step]
    return float(np.interp(reached, np.arange(len(ends)), ends))


def prescribes(steps: Steps, quantity: str) -> bool:
    """Return whether any step prescribes a quantity."""
    return any(driver.quantity == quantity for step in steps for driver in step.prescribed)


def begins_at_rest(steps: Steps) -> bool:
    """Return whether the first values are all zero: the undeformed state, as step 0; a valve may be open."""
    return not any(driver.values[0] for driver in steps[0].prescribed if driver.quantity != VALVE)


def last_number(steps: Steps) -> int:
    """Return the number of the last step of a program."""
    return len(steps) - int(begins_at_rest(steps))


def goes_on(steps: Steps, old: Steps) -> bool:
    """Return whether a program equals another one, or extends it by more steps."""
    return steps[: len(old)] == old


def step_text(steps: Steps, number: int) -> str:
    """Return the values of the cavities and loads at a step, as written: ``"cavity1 6 kPa, cavity2 2 ml added"``."""
    row = number - 1 + int(begins_at_rest(steps))
    texts = [
        f"{course.name} {units.written(course.values[row])}{' added' if course.quantity == VOLUME else ''}"
        for course in courses(steps)
    ]
    return ", ".join([*texts, *([f"time {times_of(steps)[row]:g} s"] if timed(steps) else [])])
