"""Follow a device through a load program, step by step, and in time.

Each step changes either pressures, forces and the like, or volumes and travels, and is followed by its own pair (P, V), see
`softmodels.mechanics.controls`.
"""

from __future__ import annotations

import abc
import dataclasses
import itertools
import math
from collections.abc import Callable, Generator, Iterator, Sequence
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from softmodels.common.arrays import Array
from softmodels.mechanics import component, controls, mpi, newton
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import State
from softmodels.path import continuation, stability
from softmodels.path.continuation import Continuation, LoadedState
from softmodels.path.steps import (
    FLOW,
    PRESSURE,
    SOURCE_PRESSURE,
    STRESS_TOLERANCE,
    VALVE,
    VOLUME,
    Steps,
    begins_at_rest,
    courses,
    last_number,
    prescribes,
    time_at,
    value_at,
)
from softmodels.path.supply import Gas, GasStep, Source


class Cycle:
    """The stable parts of a device's curve up to a pressure, in their order, as far as they are known; ``lost`` is what ended
    the curve."""

    def __init__(self, path: Continuation, most: float):
        control, growth = stability.ArcLength.name, continuation.FREE_GROWTH
        path = dataclasses.replace(path, control=control, largest_growth=growth, release=False)
        self.path, self.most = path, most
        self.lost: stability.PathEnd | None = None
        self.parts = _stable_parts(self._curve(path, most), path)
        if not self.parts:
            raise self.lost or stability.PathEnd("there is no stable state")

    def _curve(self, path: Continuation, goal: float) -> list[stability.Point]:
        points: list[stability.Point] = []
        try:
            points.extend(continuation.trace(path, [goal]))
        except stability.PathEnd as end:
            self.lost = end
        return points or list(path.history.points)

    def along(self, here: int, goals: Sequence[float], way: int) -> Generator[stability.Point, None, int]:
        """Yield points from the part ``here`` through the goals, up (1) or down (-1); return the last part."""
        at = self.parts[here].points[0].state.P if way > 0 else math.inf
        left = list(goals)
        landed: stability.Point | None = None
        while True:
            part = self._part(here, way)
            end = part.highest if way > 0 else part.lowest
            if landed is not None:
                yield landed
            reached = [goal for goal in left if (goal - end) * way <= 1e-12]
            last = reached[-1] if len(reached) == len(left) else end
            between = [
                p for p in part.points if not p.requested and (p.state.P - at) * way > 1e-9 and (last - p.state.P) * way > 1e-9
            ]
            stops = [(p.state.P, p) for p in between] + [(goal, None) for goal in reached]
            for P, known in sorted(stops, key=lambda stop: stop[0] * way):
                if known is None or not math.isclose(P, at, rel_tol=1e-9):
                    yield dataclasses.replace(known, jump=False) if known is not None else _state(part, P)
            left = left[len(reached) :]
            if not left:
                return here
            edge = part.points[-1 if way > 0 else 0]
            if landed is None or edge.state is not landed.state:
                yield dataclasses.replace(edge, requested=False)
            ahead = 0.0 if edge.limit else self.path.ahead(end)
            at = end + way * min(ahead, (left[0] - end) * way)
            here = self._snapped(here, edge, at, way)
            landed = dataclasses.replace(_state(self.parts[here], at), requested=False, jump=True)

    def _snapped(self, here: int, edge: stability.Point, P: float, way: int) -> int:
        """Return the part that a device snaps to at a pressure from the end of another, up (1) or down (-1)."""
        options = range(here + way, len(self.parts) if way > 0 else -1, way) if edge.limit else ()
        least = MIN_ADVANCE * self.path.plane.P_scale
        index = next((k for k in options if self._part(k, way).leads_on(P, way, least)), None)
        if index is None and (rest := self._released(edge, P, way)) is not None:
            self.parts.insert(index := here + 1 if way > 0 else here, rest)
        if index is None and edge.limit:
            why = "the pressure has a limit point, and no stable state at that pressure was found beyond it"
            raise stability.PathEnd(why, edge)
        if index is None:
            why = "the curve of its stable states ends"
            if way > 0 and self.parts[here].buckles:
                raise stability.PathEnd(why, cause=DEVICE_BUCKLES)
            raise self.lost or stability.PathEnd(why)
        return index

    def _released(self, edge: stability.Point, P: float, way: int) -> CyclePart | None:
        """Return the stable part on which a device comes to rest that is released at a pressure from the end of another;
        None if it does not."""
        path, state, why = self.path, edge.state, "no stable state was met behind the end of a stable part"
        path.history.add(edge)  # the last state, if this fails
        if edge.limit:
            system, rate = path.solver.system, edge.tangent.w
            push = way * NUDGE_DISPLACEMENT / mpi.largest(system.comm, float(np.abs(rate[: system.n]).max(initial=0.0)))
            state = dataclasses.replace(state, w=state.w + push * rate)
        rest = continuation.come_to_rest(path, controls.pressure_control(P), dataclasses.replace(state, P=P), why)
        if rest is None:
            return None
        part = self._followed(rest, way)
        return dataclasses.replace(part, rest=rest) if way > 0 else part

    def _followed(self, rest: State, way: int) -> CyclePart:
        """Return the stable part that leads up (1) or down (-1) from where the device is at rest."""
        path = self.path
        quantity, goal = (path.requested, self.most) if way > 0 else (Fall(rest.P), rest.P)
        branch = dataclasses.replace(path, quantity=quantity, start=rest, history=continuation.PathHistory())
        points = self._curve(branch, goal)
        if way < 0:
            points = [dataclasses.replace(point, tangent=-point.tangent, requested=False) for point in points[::-1]]
        alone = CyclePart((points[0 if way > 0 else -1],), branch, buckles=False)  # where the curve is lost at once
        return next(
            (part for part in _stable_parts(points, branch) if any(point.state is rest for point in part.points)), alone
        )

    def _part(self, k: int, way: int) -> CyclePart:
        """Return a part, on the way down with what lies below the place where the device came to rest on it."""
        part = self.parts[k]
        if way < 0 and part.rest is not None:
            below = self._followed(part.rest, way)
            self.parts[k] = part = dataclasses.replace(part, points=(*below.points, *part.points[1:]), rest=None)
        return part


def _stable_parts(points: Sequence[stability.Point], path: Continuation) -> list[CyclePart]:
    """Return the curve's stable parts in order; limit points belong to the part they end."""
    parts: list[CyclePart] = []
    current: list[stability.Point] = []
    for point in points:
        if point.limit:
            if current:
                parts.append(CyclePart((*current, point), path, buckles=False))
                current = []
            else:
                current = [point]  # a minimum of the pressure: a stable part may start here
        elif point.stable_under_pressure and point.tangent.P > 0 and not point.bifurcation:
            current.append(point)
        elif current:
            if len(current) > 1:
                parts.append(CyclePart(tuple(current), path, buckles=True))
            current = []
    if len(current) > 1:
        parts.append(CyclePart(tuple(current), path, buckles=False))
    return parts


def _state(part: CyclePart, P: float) -> stability.Point:
    if known := next((point for point in part.points if point.state.P == P and not point.limit), None):
        return dataclasses.replace(known, requested=True)
    for before, after in itertools.pairwise(part.points):
        if before.state.P <= P <= after.state.P:
            part.path.history.points = [before, after]  # the curve's last points predict nothing here
            return part.path.corrector.between(stability.Pressure(), before, after, P)
    nearest = min(part.points, key=lambda point: abs(point.state.P - P))  # rounding puts P beyond the part's end
    return dataclasses.replace(nearest, requested=True)


# ----------------------------------------------------------------------------------------------------------------------
# A device in time: silicone that creeps, under a pressure, a volume or a force that changes at a constant rate or is held; or
# air that comes through a tube.
#
# Each step ends at its own time, on a curve in the plane of volume and pressure: the value that is prescribed then, or the gas
# that has come. Its length follows from the errors of the silicone's memory and of that gas. What the memory remembers moves on
# with every accepted state. With inertia (`softmodels.mechanics.memory`) a lost equilibrium is no end.


MIN_STEPS = 12
"""Usual minimum number of steps of a stage, for smooth curves."""
SAFETY_FACTOR, MIN_CHANGE, MAX_CHANGE = 0.8, 0.2, 2.5
"""Share of the step that would just meet the tolerance, and the least and the most by which a step changes."""
LOSS_TIME_TOLERANCE = 1e-3
"""Error of the time at which an equilibrium is lost, over the time since the stage began; `FIRST_STEP` at least."""
FIRST_STEP = 1e-5
"""Step that is short enough for any memory, over the stage, or over the silicone's shortest relaxation time in a longer one."""
MAX_RELAXATION_TIMES = 10.0
"""First step of a stage, over the shortest relaxation time, unless the step before was longer. Of a stress that fades within a
much longer one nothing is left at its end, where the error is estimated, and what it dissipates would be taken for many times
too much."""
FIRST_GAS_SHARE = 1e-3
"""Gas that comes in the first step, over what brings the largest pressure into a rigid cavity."""
MIN_STEP_RATIO = 1e-9
"""Shortest step with gas that comes, over the stage."""
SNAP_THROUGH_RATE = 0.05
"""Rate of the gas along the path, over its parts, below which a snap-through with that gas is what ends it."""
REFACTOR_CHANGE = 1.25
"""Change of the step from which on K with the mass needs a new factorisation."""
MIN_INERTIA_CHANGE = 1.6
"""With inertia, the change of the step that is not worth it: vibrations keep their energy best in equal steps."""
FIRST_PROBED_GROWTH, MAX_PROBED_GROWTH = 1e-3, 1.0
"""First and last volume, over the cavity's, that a lost equilibrium is looked for at beyond its last state."""


class LostInTime(stability.PathEnd):
    """The device loses its equilibrium at a pressure that is held or raised, at a time in s since the stage began."""

    def __init__(self, time: float, last: stability.Point):
        why = "the silicone has crept so far that the device has no equilibrium at this pressure any more"
        super().__init__(why, last)
        self.time = time


class SnapInTime(stability.PathEnd):
    """The device snaps through with the gas it holds, faster than any gas can come."""


class Drive(abc.ABC):
    """What drives a device through a stage of a duration in s, above 0, in a fewest number of steps; ``recovers`` says
    whether these may grow again after one that failed."""

    duration: float
    fewest = MIN_STEPS
    recovers = False

    @abc.abstractmethod
    def begin(self, path: Continuation, first: stability.Point) -> float:
        """Begin at the first point of a path; return the length of the first step in s."""

    @abc.abstractmethod
    def solved(self, path: Continuation, time: float, step: float, end: bool, earlier: PreviousStep | None) -> State:
        """Return the state at the end of a step that begins at a time, the stage's own end if ``end``."""

    def error(self, state: State) -> float:
        """Return the error of this state by the length of its step, of the drive's own, as `TOLERANCE` counts it."""
        return 0.0

    @abc.abstractmethod
    def check(self, point: stability.Point, first: stability.Point) -> None:
        """Raise `NoConvergence` where a device does not stay in a state."""

    @abc.abstractmethod
    def shortest(self, time: float) -> float:
        """Return the length in s of a step that is not halved any more at a time."""

    def ended(self, path: Continuation, time: float, step: float, failure: newton.NoConvergence) -> stability.PathEnd:
        """Return the end of a path of which not even the shortest step converged."""
        return stability.PathEnd(f"no step in time converged, down to {step:.3g} s ({failure})")


PreviousStep = tuple[float, State]
"""Length of the step before, and the state where it began."""


class Ramp(Drive):
    """A requested quantity that rises by a dimensionless amount at a constant rate, or is held (0), over a duration in s."""

    def __init__(self, rise: float, duration: float, fewest: int = MIN_STEPS):
        self.rise, self.duration, self.fewest = rise, duration, fewest

    def begin(self, path: Continuation, first: stability.Point) -> float:
        self.start, self.by_pressure = path.value(first.state), isinstance(path.requested, stability.Pressure)
        self.first = FIRST_STEP * min(self.duration, path.solver.system.potential.relaxation)
        return self.duration / self.fewest

    def _value(self, time: float) -> float:
        return self.start + self.rise * time / self.duration

    def solved(self, path: Continuation, time: float, step: float, end: bool, earlier: PreviousStep | None) -> State:
        value = self.start + self.rise if end else self._value(time + step)
        last, requested = path.last, path.requested
        w, P = last.state.w, last.state.P
        if earlier is not None:
            ratio = min(step / earlier[0], MAX_CHANGE)
            w, P = w + ratio * (w - earlier[1].w), P + ratio * (P - earlier[1].P)
        elif self.rise:
            ratio = (value - path.value(last.state)) / requested.rate(last.state, last.tangent)
            w, P = w + ratio * last.tangent.w, P + ratio * last.tangent.P
        return requested.exactly(path.corrector.solve_from(requested.curve(value), w, P, last.state), value)

    def check(self, point: stability.Point, first: stability.Point) -> None:
        if self.by_pressure and point.signature.negative_eigenvalues > first.signature.negative_eigenvalues:
            raise newton.NoConvergence("no stable state")

    def shortest(self, time: float) -> float:
        return max(LOSS_TIME_TOLERANCE * time, self.first)

    def ended(self, path: Continuation, time: float, step: float, failure: newton.NoConvergence) -> stability.PathEnd:
        if self.by_pressure and not path.solver.system.potential.motion and _none(path, self._value(time + 2 * step), 2 * step):
            return LostInTime(time, dataclasses.replace(path.last, limit=True))
        return super().ended(path, time, step, failure)


class Filling(Drive):
    """Gas that comes from a source, whose pressure and valve change at constant rates between the stage's beginning and end,
    over a duration in s, and leaks; ``rest`` is gas at rest, dimensionless. The error of the gas counts over what brings the
    largest gauge pressure of the source, in Pa, into a rigid cavity, or over what has come so far, if that is more."""

    recovers = True

    def __init__(self, gas: Gas, sources: tuple[Source, Source], duration: float, rest: float, largest: float):
        self.gas, self.sources, self.duration, self.rest, self.largest = gas, sources, duration, rest, largest
        self.scale = 0.0
        self.curve: GasStep
        self.earlier: PreviousStep | None = None

    def _grow(self, state: State) -> None:
        """Let the scale of the gas grow with what has come."""
        rigid = self.gas.value(state.V, 0.0) * self.largest / self.gas.supply.ambient
        self.scale = max(self.scale, rigid, abs(self.gas.value(state.V, state.P) - self.rest))

    def begin(self, path: Continuation, first: stability.Point) -> float:
        self._grow(first.state)
        inflow = max(abs(self.gas.flow(self._source(t), first.state.P)[0]) for t in (0.0, FIRST_STEP * self.duration))
        return float(min(self.duration / MIN_STEPS, FIRST_GAS_SHARE * self.scale / inflow if inflow else math.inf))

    def _source(self, time: float) -> Source:
        return self.sources[0].toward(self.sources[1], min(time / self.duration, 1.0))

    def solved(self, path: Continuation, time: float, step: float, end: bool, earlier: PreviousStep | None) -> State:
        last = path.last
        sources = self._source(time), self.sources[1] if end else self._source(time + step)
        self.curve, self.earlier = self.gas.step(last, sources, step), earlier
        V, P, t = last.state.V, last.state.P, last.tangent
        a, b = self.curve.slopes(V, P)
        ratio = (self.curve.target - self.curve.value(V, P)) / (a * t.V + b * t.P)
        return path.corrector.solve_from(self.curve, last.state.w + ratio * t.w, P + ratio * t.P, last.state)

    def error(self, state: State) -> float:
        # Rounded, so that the steps do not depend on the rounding errors of a state.
        return float(f"{self.curve.error(state, self.earlier) / self.scale:.2g}")

    def check(self, point: stability.Point, first: stability.Point) -> None:
        a, b = self.curve.slopes(point.state.V, point.state.P)
        if a * point.tangent.V + b * point.tangent.P <= 0.0:
            raise newton.NoConvergence("no stable state with this gas")
        self._grow(point.state)

    def shortest(self, time: float) -> float:
        return MIN_STEP_RATIO * self.duration

    def ended(self, path: Continuation, time: float, step: float, failure: newton.NoConvergence) -> stability.PathEnd:
        t, (a, b) = path.last.tangent, self.gas.slopes(path.last.state.V, path.last.state.P)
        if not path.solver.system.potential.motion and a * t.V + b * t.P <= SNAP_THROUGH_RATE * (abs(a * t.V) + abs(b * t.P)):
            why = (
                "the device snaps through with the gas that tubes and cavity hold, faster than any flow; a smaller dead volume "
                "holds less"
            )
            return SnapInTime(why, dataclasses.replace(path.last, turn=True))
        return super().ended(path, time, step, failure)


def march(path: Continuation, drive: Drive, tolerance: float = STRESS_TOLERANCE) -> Iterator[tuple[float, stability.Point]]:
    """Follow a device through one stage, along a path that begins where the stage does (its own control is not looked at).
    Yield which share of the stage is done, and the point; the first one is its beginning. `LostInTime` or `SnapInTime` if there
    is no equilibrium any more, `PathEnd` if a step failed, however short; the tolerance is as `TOLERANCE`."""
    first = path.begin()
    yield 0.0, first
    potential, corrector, duration = path.solver.system.potential, path.corrector, drive.duration
    carried = [path.solver.carried] if path.solver.carried else []
    motion, first_step = potential.motion, FIRST_STEP * min(duration, potential.relaxation)
    time, step, errors, shrunk = 0.0, drive.begin(path, first), _Errors(path, drive, tolerance), False
    step = min(step, max(MAX_RELAXATION_TIMES * potential.relaxation, potential.last_step))
    step = min(step, motion.first_step(duration)) if motion else step
    earlier: PreviousStep | None = None
    while time < duration:
        left = duration - time
        step = min(step, duration / drive.fewest)
        step = left if step > 0.99 * left else min(step, left / 2) if step > left / 2 else step
        share = 1.0 if step == left else (time + step) / duration
        last = path.last
        checkpoint = potential.checkpoint(*carried)
        try:
            potential.pass_time(step)
            if motion and not motion.last / REFACTOR_CHANGE < step < motion.last * REFACTOR_CHANGE:
                path.solver.lagged.exhausted = True  # K has mass, which a much longer or shorter step changes
            state = drive.solved(path, time, step, share == 1.0, earlier)
            wanted = step * errors.change(state)
            if wanted < SAFETY_FACTOR * step and step > min(first_step, _shortest(path, drive, time)):
                step = wanted
                continue
            corrector.check_whole(state)
            path.accept(state)
            point = corrector.point(state, requested=share == 1.0)
            drive.check(point, first)
        except newton.NoConvergence as failure:
            checkpoint.restore()
            step, shrunk = step / 2, True
            if step < _shortest(path, drive, time):
                raise drive.ended(path, time, step, failure) from failure
            continue
        earlier, time = (step, last.state), duration if share == 1.0 else time + step
        path.history.add(point)
        yield share, point
        _check_growth(path)
        step = min(wanted, step) if shrunk else wanted
        shrunk = shrunk and not (drive.recovers or motion)


class _Errors:
    """Errors of the steps of a stage."""

    def __init__(self, path: Continuation, drive: Drive, tolerance: float):
        self.potential, self.drive, self.tolerance = path.solver.system.potential, drive, tolerance
        self.largest = 0.0

    def change(self, state: State) -> float:
        """Return by how much the step after one that ends in a state should be longer, or this one."""
        error, size = self.potential.memory_error(state.w)
        self.largest = max(self.largest, size)
        change = self._change(max(error / self.largest if self.largest else 0.0, self.drive.error(state)), math.sqrt)
        if motion := self.potential.motion:
            change = min(change, self._change(motion.error(state.w), math.cbrt))
            change = 1.0 if SAFETY_FACTOR <= change < MIN_INERTIA_CHANGE else change
        return change

    def _change(self, error: float, root: Callable[[float], float]) -> float:
        """Return the same for an error, and the root of it that grows as the step."""
        change = MAX_CHANGE if error == 0.0 else SAFETY_FACTOR * root(self.tolerance / error)
        return min(MAX_CHANGE, max(MIN_CHANGE, change))


def _shortest(path: Continuation, drive: Drive, time: float) -> float:
    """Return the length in s of a step that is not halved any more."""
    return MIN_STEP_RATIO * drive.duration if path.solver.system.potential.motion else drive.shortest(time)


def _check_growth(path: Continuation) -> None:
    """Raise `PathEnd` for a moving device that has grown far beyond any stable state."""
    growth = path.last.state.V / path.plane.V_scale
    if growth > continuation.FREE_GROWTH and path.solver.system.potential.motion:
        raise stability.PathEnd(f"the cavity has grown {continuation.FREE_GROWTH:g}-fold and finds no state of rest")


def _none(path: Continuation, pressure: float, step: float) -> bool:
    """Return whether there is no equilibrium at a pressure at the end of a step: over growing volumes the pressure of the
    equilibria has a maximum below it."""
    potential, solver, last = path.solver.system.potential, path.solver, path.last.state
    checkpoint = potential.checkpoint()
    potential.pass_time(step)
    state, growth = last, FIRST_PROBED_GROWTH
    try:
        while growth < MAX_PROBED_GROWTH:
            trial = solver.solve(controls.volume_control(last.V * (1.0 + growth)), state.w, state.P)
            if pressure <= trial.P:
                return False
            if trial.P < state.P and state is not last:
                return True
            state, growth = trial, 1.5 * growth
    except newton.NoConvergence:
        pass
    finally:
        checkpoint.restore()
    return False


# ----------------------------------------------------------------------------------------------------------------------
# Load stages: all drivers change proportionally from one state to another, as one path.
#
# The drivers are the cavities and behind them the dead loads, see `softmodels.mechanics.controls`. A stage changes magnitudes
# (pressures, forces) or their conjugates (volumes, travels). Dead loads are applied first, as a separate stage: the preload.


POINTS_PER_STAGE = 4
"""Minimum number of points per stage, for smooth curves."""


class PreloadFailure(stability.PathEnd):
    """No equilibrium exists under the preload: ``what`` was being applied, a clause, and ``share`` of it was reached."""

    def __init__(self, end: stability.PathEnd, what: str, share: float):
        super().__init__(str(end), end.limit, end.cause)
        self.what, self.share = what, share

    @property
    def sentence(self) -> str:
        """Why the preload has no equilibrium, and what can be done."""
        none = f"the device has no equilibrium under {self.what} (the preload)"
        if self.limit is not None:
            return (
                f"{none}: limit point at {self.share:.3g} of the full load or slightly below; reduce the load, or use a "
                "stiffer silicone or thicker walls"
            )
        if self.cause:
            return f"{none}: at {self.share:.3g} of the full load {self.cause.clause}. {self.cause.advice}"
        return (
            f"{self.what[0].upper()}{self.what[1:]} could be applied only up to {self.share:.3g} of the full load ({self}); "
            "reduce the load, or refine the mesh (--finer 2)"
        )


def at_rest(solver: Solver) -> LoadedState:
    """Return the undeformed state without loads."""
    rest = LoadedState.at(solver.system, solver.system.rest())
    return dataclasses.replace(rest, drives=np.zeros_like(rest.drives))  # independent of the coupling of an earlier path


@dataclasses.dataclass(frozen=True, eq=False)
class Stage:
    """One stage.

    Attributes:
        start: Where it begins.
        coupling: Of the drivers.
        requested: What is asked for: the magnitude, or the volume, that stands for all.
        goal: How far it goes; 0 for a hold.
        duration: Time in s that it takes.
    """

    start: LoadedState
    coupling: controls.Coupling
    requested: stability.PathQuantity
    goal: float
    duration: float = 0.0

    @classmethod
    def between(
        cls, start: LoadedState, change: Array, held: Sequence[int], volumes: Array, duration: float = 0.0,
        before: Array | None = None,
    ) -> Stage:  # fmt: skip
        """Return a stage that changes either magnitudes or, of the drivers ``held``, their conjugates, by ``change``, shape
        (k,), in a time in s.

        ``volumes`` is what is worked on where it begins, shape (k,); ``before`` the last change of a stage that is a hold:
        what that has reached is kept.
        """
        goal = float(np.abs(change).max())
        change = change if goal or before is None else before
        by_volume = any(change[driver] for driver in held)
        make = controls.Coupling.by_volume if by_volume else controls.Coupling.by_pressure
        requested = stability.VolumeGain() if by_volume else stability.Pressure()
        return cls(start, make(start.drives, change, held, volumes), requested, goal, duration)

    def follow(
        self, solver: Solver, control: str, report: Callable[[str], None], tolerance: float = STRESS_TOLERANCE
    ) -> Iterator[tuple[float, stability.Point]]:
        """Follow the stage to its end under a control of `Continuation`; ``tolerance`` is that of steps in time, see `march`.

        Yields:
            Which share of it is done, and the point; the first one is its beginning.

        Raises:
            PathEnd: Its end is not on the path that begins there.
        """
        start = solver.couple(self.coupling, self.start.state, self.start.drives)
        largest = self.goal / POINTS_PER_STAGE
        path = Continuation(solver, self.requested, control, largest, start=start, report=report, release=True)
        if (motion := solver.system.potential.motion) and not self.duration:
            motion.jump()
            first = path.begin()
            yield 0.0, first
            state = self.requested.exactly(start, self.goal)
            yield 1.0, dataclasses.replace(first, state=state, requested=True)
            return
        if self.duration:
            yield from march(path, Ramp(self.goal, self.duration), tolerance)
            return
        for point in continuation.trace(path, [self.goal]):
            yield path.value(point.state) / self.goal, point


def apply_preload(
    solver: Solver,
    targets: Sequence[tuple[str, Array]],
    report: Callable[[str], None] = lambda text: None,
) -> LoadedState:
    """Apply the preload to the undeformed state, one magnitude after the other, such as the dead loads and then a pressure.
    The coupling of the drivers is changed.

    Args:
        solver: The device.
        targets: What is applied, a clause, and the magnitudes of all drivers then, dimensionless, shape (k,).
        report: Takes sentences on what is going on.

    Raises:
        HangingEnd: There is no such state on the path.
    """
    here = at_rest(solver)
    for what, magnitudes in targets:
        change = np.asarray(magnitudes, dtype=float) - here.drives
        if not change.any():
            continue
        stage = Stage.between(here, change, (), here.driven)
        reached: list[tuple[float, stability.Point]] = []
        try:
            reached.extend(stage.follow(solver, "auto", report))
        except (stability.PathEnd, newton.NoConvergence) as failure:
            end = failure if isinstance(failure, stability.PathEnd) else stability.PathEnd(str(failure))
            raise PreloadFailure(end, what, reached[-1][0] if reached else 0.0) from failure
        here = LoadedState.at(solver.system, reached[-1][1].state)
    return here


def inflate_from(solver: Solver, preload: LoadedState) -> State:
    """Couple the cavities by the device's pressure ratios from the preloaded state, with constant dead loads; return the start
    of P."""
    system = solver.system
    cavities = len(system.body.actuator.ratios)
    dead = preload.drives[cavities:]
    return solver.couple(system.inflating(dead), preload.state, preload.drives)


def load_from(solver: Solver, preload: LoadedState, driver: int) -> State:
    """Couple the drivers so that P is one dead load's magnitude, all others constant; return the start of P."""
    change = np.zeros(len(preload.drives))
    change[driver] = 1.0
    coupling = controls.Coupling.by_pressure(preload.drives, change, (), preload.driven)
    return solver.couple(coupling, preload.state, preload.drives)


@dataclasses.dataclass(frozen=True)
class Settings:
    """How a program is followed: what each step follows and how it reports, as in `Continuation`, and the tolerance of steps in
    time, see `softmodels.path.schedule.march`."""

    control: str = "auto"
    report: Callable[[str], None] = lambda text: None
    tolerance: float = STRESS_TOLERANCE


DEFAULT_SETTINGS = Settings()


def follow(
    solver: Solver,
    steps: Steps,
    settings: Settings = DEFAULT_SETTINGS,
    begin: LoadedState | None = None,
    preload: LoadedState | None = None,
) -> Iterator[tuple[float, stability.Point]]:
    """Follow a device at rest through a program, which drives each of its cavities, or none of them, and dead loads. The
    coupling of its cavities is changed.

    Args:
        solver: The device.
        steps: The program.
        settings: How.
        begin: The end of a step to go on from; where it hangs if None.
        preload: Where it hangs under the loads that the program does not change; the undeformed state if None.

    Yields:
        How far the program has come (1.5 is half way through the second step), and its point.

    Raises:
        PathEnd: A step's values are not on the path that leads there.
    """
    eq = solver.system
    preload = preload or at_rest(solver)
    eq.load(eq.rest())
    rest = eq.driven()
    rest[len(eq.volumes()) :] = preload.driven[len(eq.volumes()) :]
    values, held = in_drivers(solver, steps, preload.drives)
    first, here = int(begins_at_rest(steps)), begin or preload
    # A held volume counts from the undeformed cavity, a travel from the preloaded state, and 0 means the preloaded state
    # for both; all other values are magnitudes.
    before = preload.drives.copy()
    before[held] = (preload.driven - rest)[held]
    values[:, held] = np.where(values[:, held] == 0.0, before[held], values[:, held])
    changed = np.ones(len(before))  # a hold before anything changes
    for number, (step, row) in enumerate(zip(steps[first:], values[first:], strict=True), 1):
        last, changed = changed, row - before if (row != before).any() else changed
        if number <= here.number:
            before = row
            continue
        stage = Stage.between(here, row - before, held, rest + before, step.duration or 0.0, last)
        point = yield from _told(
            stage.follow(solver, settings.control, settings.report, settings.tolerance), number, begin, bool(first)
        )
        here = LoadedState.at(solver.system, point.state, number)
        before = row


def _told(
    points: Iterator[tuple[float, stability.Point]], number: int, begin: LoadedState | None, at_rest: bool
) -> Generator[tuple[float, stability.Point], None, stability.Point]:
    """Yield how far a program has come at a stage's points, and these; return the last one.

    The first point is the stage's beginning, which the stage before has given; only the first stage of a program that does not
    go on (``begin``) gives it too, requested if ``at_rest``.
    """
    _, point = next(points)
    if number == 1 and begin is None:
        yield 0.0, dataclasses.replace(point, requested=at_rest)
    for share, point in points:
        yield float(number) if point.requested else number - 1 + share, point
    return point


def supply(
    solver: Solver,
    steps: Steps,
    gas: Gas,
    settings: Settings = DEFAULT_SETTINGS,
    begin: LoadedState | None = None,
    preload: LoadedState | None = None,
) -> Iterator[tuple[float, stability.Point]]:
    """Follow a device that gas is supplied to in time, by the steps of its source, perhaps with those of the valve; see
    `follow`. A jump of the source leaves the device where it is.

    Raises:
        PathEnd: The device snaps through, or no step was found.
    """
    here, first = begin or preload or at_rest(solver), int(begins_at_rest(steps))
    numbers = range(1, last_number(steps) + 1)
    sources = [source_at(steps, float(number)) for number in (0, *numbers)]
    times = [time_at(steps, float(number)) for number in (0, *numbers)]
    inflate_from(solver, here)
    rest = gas.value(solver.system.rest().V, 0.0)
    pumped = np.trapezoid([source.flow or 0.0 for source in sources], times) / (rest * gas.volume_unit) * gas.supply.ambient
    largest = max(1.0, abs(float(pumped)), *(abs(source.pressure) for source in sources))
    point: stability.Point | None = None
    for number in numbers:
        if number <= here.number:
            continue
        duration = steps[number - 1 + first].duration or 0.0
        start = inflate_from(solver, here)
        start = dataclasses.replace(start, P=here.drives[0] / solver.system.body.actuator.ratios[0])
        path = Continuation(solver, gas, start=start, report=settings.report)
        if not duration:
            point = path.begin() if point is None else point
            yield float(number), dataclasses.replace(point, requested=True)
            here = dataclasses.replace(here, number=number)
            continue
        filling = Filling(gas, (sources[number - 1], sources[number]), duration, rest, largest)
        point = yield from _told(march(path, filling, settings.tolerance), number, begin, bool(first))
        here = LoadedState.at(solver.system, point.state, number)


def source_at(steps: Steps, reached: float) -> Source:
    """Return what the source of an air supply does after so many steps of a program."""
    if prescribes(steps, FLOW):
        return Source(flow=value_at(steps, FLOW, reached))
    opening = value_at(steps, VALVE, reached) if prescribes(steps, VALVE) else 1.0
    return Source(value_at(steps, SOURCE_PRESSURE, reached), opening)


def in_drivers(solver: Solver, steps: Steps, kept: npt.NDArray[np.float64]) -> tuple[npt.NDArray[np.float64], list[int]]:
    """Return the values of a program by step and driver, dimensionless, and the drivers with prescribed volume or travel.
    ``kept`` has the magnitudes of all drivers where it begins, shape (k,): those it does not name stay so."""
    eq, cavities = solver.system, len(solver.system.body.actuator.ratios)
    units = {PRESSURE: eq.stress_unit, VOLUME: eq.volume_unit}
    values, held = np.tile(kept, (len(steps), 1)), []
    for course in courses(steps):
        if course.of_cavity:
            place, unit = int(course.of.removeprefix("cavity")) - 1, units[course.quantity]
        else:
            load = eq.dead.index(course.of)
            place, unit = cavities + load, (eq.dead.moved_units if course.held else eq.dead.units)[load]
            unit /= eq.dead.amounts[load] if course.quantity == "share" else 1.0
        values[:, place] = np.array(course.values) / unit
        held += [place] if course.held else []
    return values, sorted(held)


# ----------------------------------------------------------------------------------------------------------------------
# Loading and unloading under pressure control, with snap-through: a water column slowly raised and lowered.
#
# The equilibrium states form one curve with stable and unstable parts. The device stays on a stable part until
# its limit point; there it snaps through, at constant pressure, to the next stable part of the curve. During
# unloading it stays on that part until the part's own limit point: hysteresis.
#
# The curve is computed once under arc-length control; the states of loading and unloading are then solved on it, each at its
# own pressure. Where the curve cannot be followed as far as the part that the device snaps to, as where walls meet in folds,
# the device is released: it creeps against a drag on its mass until it rests, and the curve is followed up from there, and down
# from there on the way back.


NUDGE_DISPLACEMENT = 0.01
"""Largest displacement, in sizes of the device, by which it is pushed off a limit point."""

MIN_ADVANCE = 1e-6
"""Least way on in pressure, in the device's scale, of a part that a device snaps to: one on which it was released may be the
same as the one before, and ends at the same limit point."""

DEVICE_BUCKLES = component.PathFailure(
    "the device buckles: its stable states end at a bifurcation, and none was found in which it would come to rest",
    "Stay below; smaller cells (--cell-size) may resolve the folds into which it collapses",
)


@dataclasses.dataclass(frozen=True)
class CyclePart:
    """A stable part of the curve: points with rising pressure, with limit points at its ends if there are any, and the path
    on which states between them are solved for; ``buckles``: whether unstable states follow on it without a limit point;
    ``rest``: where it begins, if it goes on below and was not followed there."""

    points: tuple[stability.Point, ...]
    path: Continuation
    buckles: bool
    rest: State | None = None

    @property
    def lowest(self) -> float:
        return self.points[0].state.P

    @property
    def highest(self) -> float:
        return self.points[-1].state.P

    def leads_on(self, P: float, way: int, least: float) -> bool:
        """Return whether it leads from a pressure on, up (1) or down (-1), by more than the least."""
        begin, end = (self.lowest, self.highest)[::way]
        return (P - begin) * way >= 0.0 and (end - P) * way > least


@dataclasses.dataclass(frozen=True)
class Fall(stability.Pressure):
    """How far the cavity's pressure has fallen from where a path begins."""

    start: float
    ends_at_pressure_limit: ClassVar[bool] = False

    def value(self, V: float, P: float) -> float:
        return self.start - P

    def slopes(self, V: float, P: float) -> tuple[float, float]:
        return 0.0, -1.0

    def curve(self, value: float) -> controls.Control:
        return controls.pressure_control(self.start - value)

    def exactly(self, state: State, value: float) -> State:
        return dataclasses.replace(state, P=self.start - value)


def cycle(path: Continuation, goals: Sequence[float]) -> Iterator[stability.Point]:
    """Raise the pressure through the goals and lower it again.

    Args:
        path: A new path, its quantity the pressure; what it follows is chosen here.
        goals: Dimensionless pressures, rising.

    Yields:
        Points with only their stable states, in the order in which they happen; the first one after a jump is marked.

    Raises:
        PathEnd: There is no stable state at the highest pressure, or none was found where the device snaps through on its way
            up or down. What can be reached has been yielded.
    """
    whole = Cycle(path, goals[-1])
    here = yield from whole.along(0, goals, 1)
    yield from whole.along(here, [*goals[::-1], *([0.0] if goals[0] > 0 else [])], -1)
