"""A load program: several cavities, each under pressures or added volumes of its own, step by step.

Each cavity has a series of values, one for each step; from step to step all of them change together, in proportion. A step
changes either pressures or volumes, and is followed by its own pair (P, V), see `softmodels.mechanics.coupling`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from measurement.units import UnitError, brief
from measurement.units import numbers as as_numbers
from measurement.wording import Spoken
from softmodels.mechanics.coupling import Coupling
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import State
from softmodels.path.continuation import Continuation, trace
from softmodels.path.points import Point
from softmodels.path.quantities import AddedVolume, Pressure, Quantity

KEYS = {"pressure_cm": "cm", "volume_ml": "ml"}
"""What can be given of a cavity, as in the case file, with its unit."""
MOST_STEPS = 1000
POINTS_PER_STEP = 4
"""At least this many points in each step of a program, for curves worth drawing."""


class ProgramError(Spoken, ValueError):
    """A program that cannot be meant; the message is a sentence for the user."""


@dataclasses.dataclass(frozen=True)
class Series:
    """What one cavity goes through.

    Attributes:
        key: One of `KEYS`.
        values: Pressures in cm of water, or added volumes in ml, one for each step.
    """

    key: str
    values: tuple[float, ...]

    @property
    def unit(self) -> str:
        return KEYS[self.key]

    @property
    def is_volume(self) -> bool:
        return self.key == "volume_ml"


Program = tuple[Series, ...]


def from_tables(tables: Mapping[str, object]) -> Program:
    """The program of a case file's tables, ``cavity1`` and so on by name.

    Raises:
        ProgramError: Unknown entries, values that are no numbers or below zero, series of unlike lengths, or a step that
            changes nothing or both pressures and volumes.
    """
    names = [f"cavity{i + 1}" for i in range(len(tables))]
    if sorted(tables) != sorted(names):
        raise ProgramError(f"[load] has {', '.join(tables)}; name the cavities {', '.join(names)}, each once")
    given = [_series(name, tables[name]) for name in names]
    count = max(len(series.values) for series in given)
    if count > MOST_STEPS:
        raise ProgramError(f"the program has {count} steps; at most {MOST_STEPS} are taken")
    # One value alone is kept through all steps.
    program = tuple(
        dataclasses.replace(series, values=series.values * count) if len(series.values) == 1 else series
        for series in given
    )
    for name, series in zip(names, program, strict=True):
        if len(series.values) != count:
            raise ProgramError(
                f"{name} has {len(series.values)} values where another cavity has {count}; give one for each step, or one "
                "alone that is kept"
            )
    _check_steps(program)
    return program


def _series(name: str, table: object) -> Series:
    if not isinstance(table, Mapping) or len(table) != 1 or (key := next(iter(table))) not in KEYS:
        raise ProgramError(f"{name} needs one of {' or '.join(KEYS)}, such as {name}.pressure_cm = [20, 40]")
    text = table[key]
    values = text.split(",") if isinstance(text, str) else text if isinstance(text, list | tuple) else [text]
    try:
        numbers = tuple(as_numbers(values))
    except UnitError as error:
        raise ProgramError(
            f"{name}.{key} {brief(text)} is not numbers ({error}); write one for each step, such as [20, 40]"
        ) from None
    if not numbers or min(numbers) < 0.0:
        raise ProgramError(f"{name}.{key} {brief(text)} must be numbers of 0 or more; suction is not modelled")
    return Series(key, numbers)


def _check_steps(program: Program) -> None:
    if not changes(program).any():
        raise ProgramError("the program holds zeros alone, where nothing happens")
    for number, change in enumerate(changes(program), 1 - int(begins_at_rest(program))):
        kinds = {series.is_volume for series, step in zip(program, change, strict=True) if step}
        if not kinds and number > 0:
            raise ProgramError(f"step {number} of the program changes nothing; leave it out, or give other values")
        if len(kinds) == 2:
            raise ProgramError(
                f"step {number} of the program changes pressures and volumes at once; change them in two steps, one after "
                "the other"
            )


def begins_at_rest(program: Program) -> bool:
    """Whether the first values are all zero: the undeformed state, as step 0."""
    return not any(series.values[0] for series in program)


def changes(program: Program) -> npt.NDArray[np.float64]:
    """Changes from step to step from the undeformed state on, in cm and ml, shape (steps, cavities)."""
    values = np.array([series.values for series in program]).T
    return np.diff(values, axis=0, prepend=0.0)


def goes_on(program: Program, old: Program) -> bool:
    """Whether a program is another one, or that and more steps."""
    return len(program) == len(old) and all(
        new.key == before.key and new.values[: len(before.values)] == before.values
        for new, before in zip(program, old, strict=True)
    )


def to_tables(program: Program) -> dict[str, dict[str, list[float]]]:
    return {f"cavity{i + 1}": {series.key: list(series.values)} for i, series in enumerate(program)}


def step_text(program: Program, number: int) -> str:
    """What the cavities have at a step: ``"cavity1 60 cm, cavity2 2 ml added"``."""
    row = number - 1 + int(begins_at_rest(program))
    return ", ".join(
        f"cavity{i + 1} {series.values[row]:g} {series.unit}{' added' if series.is_volume else ''}"
        for i, series in enumerate(program)
    )


@dataclasses.dataclass(frozen=True, eq=False)
class Stop:
    """Where a program has come to the end of a step: its number, the state, and the cavities' pressures (dimensionless)."""

    number: int
    state: State
    pressures: npt.NDArray[np.float64]


def follow(
    solver: Solver,
    program: Program,
    pascal_per_cm: float,
    control: str,
    report: Callable[[str], None],
    begin: Stop | None = None,
) -> Iterator[tuple[float, Point]]:
    """Take a device through a program.

    Args:
        solver: The device, at rest; the coupling of its cavities is changed.
        program: One series for each of its cavities.
        pascal_per_cm: Pa in one cm of the column.
        control: What each step follows, as in `Continuation`.
        report: Takes sentences on what is going on.
        begin: The end of a step to go on from; the undeformed state if None.

    Yields:
        How far the program has come (1.5 is half way through the second step), and its point.

    Raises:
        PathEnd: A step's values are not on the path that leads there.
    """
    eq = solver.system
    state, rest = eq.rest(), eq.volumes()
    values = np.array([series.values for series in program]).T * [
        1e-6 / eq.volume_unit if series.is_volume else pascal_per_cm / eq.stress_unit for series in program
    ]
    held = [i for i, series in enumerate(program) if series.is_volume]
    first, before = int(begins_at_rest(program)), np.zeros(len(program))
    here = begin or Stop(0, state, eq.pressures_at(state))
    for number, row in enumerate(values[first:], 1):
        if number <= here.number:
            before = row
            continue
        coupling, requested, goal = _step(here.pressures, row - before, held, rest + before)
        start = solver.couple(coupling, here.state, here.pressures)
        path = Continuation(solver, requested, control, goal / POINTS_PER_STEP, start=start, report=report)
        for place, point in enumerate(trace(path, [goal])):
            if place:
                come = float(number) if point.requested else number - 1 + path.value(point.state) / goal
                yield come, point
            elif number == 1 and begin is None:
                yield 0.0, dataclasses.replace(point, requested=bool(first))
        before, last = row, path.last.state
        here = Stop(number, last, eq.pressures_at(last))


def _step(
    pressures: npt.NDArray[np.float64], change: npt.NDArray[np.float64], held: Sequence[int],
    volumes: npt.NDArray[np.float64],
) -> tuple[Coupling, Quantity, float]:  # fmt: skip
    """The coupling of one step, what is requested in it, and how far it goes."""
    by_volume = any(change[cavity] for cavity in held)
    make = Coupling.by_volume if by_volume else Coupling.by_pressure
    requested = AddedVolume() if by_volume else Pressure()
    return make(pressures, change, held, volumes), requested, float(np.abs(change).max())
