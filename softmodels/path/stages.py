"""Stages of a load: all drivers change together from one state to another, in proportion, as one path.

The drivers are the cavities and behind them the dead loads, see `softmodels.mechanics.coupling`. A stage changes magnitudes
(pressures, forces) or what they work on (volumes, travels). A device with dead loads first hangs: a stage of its own.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence

import numpy as np
import numpy.typing as npt

from softmodels.mechanics.coupling import Coupling
from softmodels.mechanics.newton import NoConvergence
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import State
from softmodels.path.continuation import Continuation, trace
from softmodels.path.points import PathEnd, Point
from softmodels.path.quantities import Gained, Pressure, Quantity

Array = npt.NDArray[np.float64]

POINTS_PER_STAGE = 4
"""At least this many points in each stage, for curves worth drawing."""


class HangingEnd(PathEnd):
    """A device does not bear what acts on it before it is inflated.

    Attributes:
        what: What was being applied, a clause.
        share: How much of it was reached.
    """

    def __init__(self, end: PathEnd, what: str, share: float):
        super().__init__(str(end), end.limit, end.cause)
        self.what, self.share = what, share


@dataclasses.dataclass(frozen=True, eq=False)
class Stop:
    """Where a stage has come to its end; dimensionless.

    Attributes:
        number: The stage's.
        state: The state.
        drives: Magnitudes of all drivers there, shape (k,).
        driven: What they work on there, shape (k,).
    """

    number: int
    state: State
    drives: Array
    driven: Array


def at_rest(solver: Solver) -> Stop:
    """The undeformed state under nothing."""
    system = solver.system
    state = system.rest()
    driven = system.driven()
    return Stop(0, state, np.zeros(len(driven)), driven)  # whatever the coupling of an earlier path keeps


@dataclasses.dataclass(frozen=True, eq=False)
class Stage:
    """One stage.

    Attributes:
        start: Where it begins.
        coupling: Of the drivers.
        requested: What is asked for: the magnitude, or the volume, that stands for all.
        goal: How far it goes.
    """

    start: Stop
    coupling: Coupling
    requested: Quantity
    goal: float

    @classmethod
    def between(cls, start: Stop, change: Array, held: Sequence[int], volumes: Array) -> Stage:
        """A stage that changes either magnitudes or what they work on.

        Args:
            start: Where it begins.
            change: By how much each driver changes, shape (k,): of those held what it works on.
            held: Drivers whose volume or travel is given.
            volumes: What is worked on where it begins, shape (k,).
        """
        by_volume = any(change[driver] for driver in held)
        make = Coupling.by_volume if by_volume else Coupling.by_pressure
        requested = Gained() if by_volume else Pressure()
        return cls(start, make(start.drives, change, held, volumes), requested, float(np.abs(change).max()))

    def follow(self, solver: Solver, control: str, report: Callable[[str], None]) -> Iterator[tuple[float, Point]]:
        """Follow the stage to its end.

        Yields:
            Which share of it is done, and the point; the first one is its beginning.

        Raises:
            PathEnd: Its end is not on the path that begins there.
        """
        start = solver.couple(self.coupling, self.start.state, self.start.drives)
        largest = self.goal / POINTS_PER_STAGE
        path = Continuation(solver, self.requested, control, largest, start=start, report=report)
        for point in trace(path, [self.goal]):
            yield path.value(point.state) / self.goal, point

    def stop(self, solver: Solver, point: Point, number: int) -> Stop:
        """Where the path stands, once the stage has been followed to this point."""
        system = solver.system
        system.load(point.state)
        return Stop(number, point.state, system.drives_at(point.state), system.driven())


def hang(
    solver: Solver,
    targets: Sequence[tuple[str, Array]],
    report: Callable[[str], None] = lambda text: None,
    control: str = "auto",
) -> Stop:
    """Apply magnitudes one after the other from the undeformed state on, such as the dead loads and then a pressure.

    Args:
        solver: The device; the coupling of its drivers is changed.
        targets: What is applied, a clause, and the magnitudes of all drivers then, dimensionless, shape (k,).
        report: Takes sentences on what is going on.
        control: What is followed, as in `Continuation`.

    Raises:
        HangingEnd: There is no such state on the path.
    """
    here = at_rest(solver)
    for what, magnitudes in targets:
        change = np.asarray(magnitudes, dtype=float) - here.drives
        if not change.any():
            continue
        stage = Stage.between(here, change, (), here.driven)
        come: list[tuple[float, Point]] = []
        try:
            come.extend(stage.follow(solver, control, report))
        except (PathEnd, NoConvergence) as failure:
            end = failure if isinstance(failure, PathEnd) else PathEnd(str(failure))
            raise HangingEnd(end, what, come[-1][0] if come else 0.0) from failure
        here = stage.stop(solver, come[-1][1], here.number)
    return here


def inflate_from(solver: Solver, hung: Stop) -> State:
    """Couple the cavities by the device's pressure ratios from where it hangs, its dead loads kept; the state P starts from."""
    system = solver.system
    cavities = len(system.body.actuator.ratios)
    dead = hung.drives[cavities:]
    return solver.couple(Coupling.proportional(system.body.actuator.ratios, dead), hung.state, hung.drives)


def load_from(solver: Solver, hung: Stop, driver: int) -> State:
    """Couple the drivers so that P is one dead load's magnitude, all others kept; the state P starts from."""
    change = np.zeros(len(hung.drives))
    change[driver] = 1.0
    return solver.couple(Coupling.by_pressure(hung.drives, change, (), hung.driven), hung.state, hung.drives)
