"""A device in time: silicone that creeps, under a pressure, a volume or a force that changes at a constant rate or is held; or
air that comes through a tube.

Each step ends at its own time, on a curve in the plane of volume and pressure: the value that is prescribed then, or the gas
that has come. Its length follows from the errors of the silicone's memory and of that gas. What the memory remembers moves on
with every accepted state. With inertia (`softmodels.mechanics.inertia`) a lost equilibrium is no end.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator
from typing import Protocol

from softmodels.mechanics.controls import volume_control
from softmodels.mechanics.newton import NoConvergence
from softmodels.mechanics.system import State
from softmodels.path.continuation import Continuation
from softmodels.path.points import PathEnd, Point, Pressure
from softmodels.path.program import TOLERANCE
from softmodels.path.supply import Gas, GasStep, Source

FEWEST_STEPS = 12
"""Usual minimum number of steps of a stage, for smooth curves."""
SAFETY, SHORTER, LONGER = 0.8, 0.2, 2.5
"""Share of the step that would just meet the tolerance, and the least and the most by which a step changes."""
LOCATED = 1e-3
"""Error of the time at which an equilibrium is lost, over the time since the stage began; `FIRST` of the stage at least."""
FIRST = 1e-5
FIRST_CHANGE = 1e-3
"""Gas that comes in the first step, over what brings the largest pressure into a rigid cavity."""
SHORTEST = 1e-9
"""Shortest step with gas that comes, over the stage."""
SNAPPING = 0.05
"""Rate of the gas along the path, over its parts, below which a snap-through with that gas is what ends it."""
SHAKEN = 1.25
"""Change of the step from which on K with the mass needs a new factorisation."""
KEPT = 1.6
"""With inertia, the change of the step that is not worth it: vibrations keep their energy best in equal steps."""
LARGEST_GROWTH = 500.0
"""Cavity volumes at which a moving device has burst."""
GROWTH, MOST_GROWTH = 1e-3, 1.0
"""First and last volume, over the cavity's, that a lost equilibrium is looked for at beyond its last state."""


class LostInTime(PathEnd):
    """The device loses its equilibrium at a pressure that is held or raised, at a time in s since the stage began."""

    def __init__(self, time: float, last: Point):
        why = "the silicone has crept so far that the device has no equilibrium at this pressure any more"
        super().__init__(why, last)
        self.time = time


class SnapInTime(PathEnd):
    """The device snaps through with the gas it holds, faster than any gas can come."""


class Drive(Protocol):
    """What drives a device through a stage of a duration in s, above 0, in a fewest number of steps; ``recovers`` says
    whether these may grow again after one that failed."""

    duration: float
    fewest: int
    recovers: bool

    def begin(self, path: Continuation, first: Point) -> float:
        """Begin at the first point of a path; return the length of the first step in s."""

    def solved(self, path: Continuation, time: float, step: float, end: bool, earlier: Earlier | None) -> State:
        """Return the state at the end of a step that begins at a time, the stage's own end if ``end``."""

    def error(self, state: State) -> float:
        """Return the error of this state by the length of its step, of the drive's own, as `TOLERANCE` counts it."""

    def check(self, point: Point, first: Point) -> None:
        """Raise `NoConvergence` where a device does not stay in a state."""

    def shortest(self, time: float) -> float:
        """Return the length in s of a step that is not halved any more at a time."""

    def ended(self, path: Continuation, time: float, step: float, failure: NoConvergence) -> PathEnd:
        """Return the end of a path of which not even the shortest step converged."""


Earlier = tuple[float, State]
"""Length of the step before, and the state where it began."""


class Ramp:
    """A requested quantity that rises by a dimensionless amount at a constant rate, or is held (0), over a duration in s."""

    recovers = False

    def __init__(self, rise: float, duration: float, fewest: int = FEWEST_STEPS):
        self.rise, self.duration, self.fewest = rise, duration, fewest

    def begin(self, path: Continuation, first: Point) -> float:
        self.start, self.by_pressure = path.value(first.state), isinstance(path.requested, Pressure)
        return self.duration / self.fewest

    def _value(self, time: float) -> float:
        return self.start + self.rise * time / self.duration

    def solved(self, path: Continuation, time: float, step: float, end: bool, earlier: Earlier | None) -> State:
        value = self.start + self.rise if end else self._value(time + step)
        last, requested = path.last, path.requested
        w, P = last.state.w, last.state.P
        if earlier is not None:
            ratio = min(step / earlier[0], LONGER)
            w, P = w + ratio * (w - earlier[1].w), P + ratio * (P - earlier[1].P)
        elif self.rise:
            ratio = (value - path.value(last.state)) / requested.rate(last.state, last.tangent)
            w, P = w + ratio * last.tangent.w, P + ratio * last.tangent.P
        return requested.exactly(path.corrector.solve_from(requested.curve(value), w, P, last.state), value)

    def error(self, state: State) -> float:
        return 0.0

    def check(self, point: Point, first: Point) -> None:
        if self.by_pressure and point.signature.negative_eigenvalues > first.signature.negative_eigenvalues:
            raise NoConvergence("no stable state")

    def shortest(self, time: float) -> float:
        return max(LOCATED * time, FIRST * self.duration)

    def ended(self, path: Continuation, time: float, step: float, failure: NoConvergence) -> PathEnd:
        if (
            self.by_pressure
            and not path.solver.system.potential.motion
            and _none(path, self._value(time + 2 * step), 2 * step)
        ):
            return LostInTime(time, dataclasses.replace(path.last, limit=True))
        return PathEnd(f"no step in time converged, down to {step:.3g} s ({failure})")


class Filling:
    """Gas that comes from a source, whose pressure and valve change at constant rates between the stage's beginning and end,
    over a duration in s, and leaks; ``rest`` is gas at rest, dimensionless. The error of the gas counts over what brings the
    largest gauge pressure of the source, in Pa, into a rigid cavity, or over what has come so far, if that is more."""

    recovers, fewest = True, FEWEST_STEPS

    def __init__(self, gas: Gas, sources: tuple[Source, Source], duration: float, rest: float, largest: float):
        self.gas, self.sources, self.duration, self.rest, self.largest = gas, sources, duration, rest, largest
        self.scale = 0.0
        self.curve: GasStep
        self.earlier: Earlier | None = None

    def _grow(self, state: State) -> None:
        """Let the scale of the gas grow with what has come."""
        rigid = self.gas.value(state.V, 0.0) * self.largest / self.gas.supply.ambient
        self.scale = max(self.scale, rigid, abs(self.gas.value(state.V, state.P) - self.rest))

    def begin(self, path: Continuation, first: Point) -> float:
        self._grow(first.state)
        come = max(abs(self.gas.flow(self._source(t), first.state.P)[0]) for t in (0.0, FIRST * self.duration))
        return float(min(self.duration / FEWEST_STEPS, FIRST_CHANGE * self.scale / come if come else math.inf))

    def _source(self, time: float) -> Source:
        return self.sources[0].toward(self.sources[1], min(time / self.duration, 1.0))

    def solved(self, path: Continuation, time: float, step: float, end: bool, earlier: Earlier | None) -> State:
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

    def check(self, point: Point, first: Point) -> None:
        a, b = self.curve.slopes(point.state.V, point.state.P)
        if a * point.tangent.V + b * point.tangent.P <= 0.0:
            raise NoConvergence("no stable state with this gas")
        self._grow(point.state)

    def shortest(self, time: float) -> float:
        return SHORTEST * self.duration

    def ended(self, path: Continuation, time: float, step: float, failure: NoConvergence) -> PathEnd:
        t, (a, b) = path.last.tangent, self.gas.slopes(path.last.state.V, path.last.state.P)
        if not path.solver.system.potential.motion and a * t.V + b * t.P <= SNAPPING * (abs(a * t.V) + abs(b * t.P)):
            why = (
                "the device snaps through with the gas that tubes and cavity hold, faster than any flow; a smaller dead volume "
                "holds less"
            )
            return SnapInTime(why, dataclasses.replace(path.last, turn=True))
        return PathEnd(f"no step in time converged, down to {step:.3g} s ({failure})")


def march(path: Continuation, drive: Drive, tolerance: float = TOLERANCE) -> Iterator[tuple[float, Point]]:
    """Follow a device through one stage, along a path that begins where the stage does (its own control is not looked at).
    Yield which share of the stage is done, and the point; the first one is its beginning. `LostInTime` or `SnapInTime` if there
    is no equilibrium any more, `PathEnd` if a step failed, however short; the tolerance is as `TOLERANCE`."""
    first = path.begin()
    yield 0.0, first
    potential, corrector, duration = path.solver.system.potential, path.corrector, drive.duration
    motion = potential.motion
    time, step, errors, shrunk = 0.0, drive.begin(path, first), _Errors(path, drive, tolerance), False
    step = min(step, motion.first_step(duration)) if motion else step
    earlier: Earlier | None = None
    while time < duration:
        left = duration - time
        step = min(step, duration / drive.fewest)
        step = left if step > 0.99 * left else min(step, left / 2) if step > left / 2 else step
        share = 1.0 if step == left else (time + step) / duration
        last = path.last
        since = potential.remembered()
        try:
            potential.pass_time(step)
            if motion and not motion.last / SHAKEN < step < motion.last * SHAKEN:
                path.solver.kept.worn = True  # K has mass: it is factorised anew for a much longer or shorter step
            state = drive.solved(path, time, step, share == 1.0, earlier)
            wanted = step * errors.change(state)
            if wanted < SAFETY * step and step > min(FIRST * duration, _shortest(path, drive, time)):
                step = wanted
                continue
            corrector.check_whole(state)
            potential.keep(state.w)
            point = corrector.point(state, requested=share == 1.0)
            drive.check(point, first)
        except NoConvergence as failure:
            potential.forget(since)
            step, shrunk = step / 2, True
            if step < _shortest(path, drive, time):
                raise drive.ended(path, time, step, failure) from failure
            continue
        earlier, time = (step, last.state), duration if share == 1.0 else time + step
        path.trail.add(point)
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
        found = self._change(max(error / self.largest if self.largest else 0.0, self.drive.error(state)), math.sqrt)
        if motion := self.potential.motion:
            found = min(found, self._change(motion.error(state.w), math.cbrt))
            found = 1.0 if SAFETY <= found < KEPT else found
        return found

    def _change(self, error: float, root: Callable[[float], float]) -> float:
        """Return the same for an error, and the root of it that grows as the step."""
        return LONGER if error == 0.0 else min(LONGER, max(SHORTER, SAFETY * root(self.tolerance / error)))


def _shortest(path: Continuation, drive: Drive, time: float) -> float:
    """Return the length in s of a step that is not halved any more."""
    return SHORTEST * drive.duration if path.solver.system.potential.motion else drive.shortest(time)


def _check_growth(path: Continuation) -> None:
    """Raise `PathEnd` for a moving device that has grown far beyond any stable state."""
    growth = path.last.state.V / path.plane.V_scale
    if growth > LARGEST_GROWTH and path.solver.system.potential.motion:
        raise PathEnd(f"the cavity has grown {LARGEST_GROWTH:g}-fold and finds no state of rest")


def _none(path: Continuation, pressure: float, step: float) -> bool:
    """Return whether there is no equilibrium at a pressure at the end of a step: over growing volumes the pressure of the
    equilibria has a maximum below it."""
    potential, solver, last = path.solver.system.potential, path.solver, path.last.state
    since = potential.remembered()
    potential.pass_time(step)
    state, growth = last, GROWTH
    try:
        while growth < MOST_GROWTH:
            found = solver.solve(volume_control(last.V * (1.0 + growth)), state.w, state.P)
            if pressure <= found.P:
                return False
            if found.P < state.P and state is not last:
                return True
            state, growth = found, 1.5 * growth
    except NoConvergence:
        pass
    finally:
        potential.forget(since)
    return False
