"""A device in time: silicone that creeps, under a pressure, a volume or a force that changes at a constant rate or is held.

Each step ends at its own time, at the value that is prescribed then; how long it is, the error of the silicone's memory says.
What the memory remembers moves on with every accepted state.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from softmodels.mechanics.controls import volume_control
from softmodels.mechanics.newton import NoConvergence
from softmodels.path.points import PathEnd, Point, Pressure
from softmodels.path.program import TOLERANCE

if TYPE_CHECKING:
    from softmodels.common.arrays import Array
    from softmodels.mechanics.system import State
    from softmodels.path.continuation import Continuation

FEWEST_STEPS = 12
"""Minimum number of steps of a stage, for smooth curves."""
SAFETY, SHORTER, LONGER = 0.8, 0.2, 2.5
"""Share of the step that would just meet the tolerance, and the least and the most by which a step changes."""
LOCATED = 1e-3
"""Error of the time at which an equilibrium is lost, over the time since the stage began; `FIRST` of the stage at least."""
FIRST = 1e-5
GROWTH, MOST_GROWTH = 1e-3, 1.0
"""First and last volume, over the cavity's, that a lost equilibrium is looked for at beyond its last state."""


class LostInTime(PathEnd):
    """The device loses its equilibrium at a pressure that is held or raised.

    Attributes:
        time: When, in s since the stage began.
    """

    def __init__(self, time: float, last: Point):
        why = "the silicone has crept so far that the device has no equilibrium at this pressure any more"
        super().__init__(why, last)
        self.time = time


def march(
    path: Continuation, rise: float, duration: float, tolerance: float = TOLERANCE
) -> Iterator[tuple[float, Point]]:
    """Follow a device through one stage.

    Args:
        path: A path that begins where the stage does; its own control is not looked at.
        rise: By how much the requested quantity rises, at a constant rate, dimensionless; 0 holds it.
        duration: In s, above 0.
        tolerance: See `TOLERANCE`.

    Yields:
        Which share of the stage is done, and the point; the first one is its beginning.

    Raises:
        LostInTime: There is no equilibrium any more.
        PathEnd: A step failed, however short.
    """
    first = path.begin()
    yield 0.0, first
    potential, corrector = path.solver.system.potential, path.corrector
    begin, by_pressure = path.value(first.state), isinstance(path.requested, Pressure)
    time, step, largest, shrunk = 0.0, duration / FEWEST_STEPS, 0.0, False
    earlier: tuple[float, State] | None = None
    while time < duration:
        left = duration - time
        step = min(step, duration / FEWEST_STEPS)
        step = left if step > 0.99 * left else min(step, left / 2) if step > left / 2 else step
        share = 1.0 if step == left else (time + step) / duration
        last = path.last
        since = potential.remembered()
        try:
            potential.pass_time(step)
            state = _solved(path, begin + rise * share, rise, step, earlier)
            error, size = potential.memory_error(state.w)
            largest = max(largest, size)
            wanted = step * _change(error / largest if largest else 0.0, tolerance)
            if wanted < SAFETY * step and step > FIRST * duration:
                step = wanted
                continue
            corrector.check_whole(state)
            potential.keep(state.w)
            point = corrector.point(state, requested=share == 1.0)
            if by_pressure and point.signature.negative_eigenvalues > first.signature.negative_eigenvalues:
                raise NoConvergence("no stable state")
        except NoConvergence as failure:
            potential.forget(since)
            step, shrunk = step / 2, True
            if step < max(LOCATED * time, FIRST * duration):
                if by_pressure and _none(path, begin + rise * share, 2 * step):
                    raise LostInTime(time, dataclasses.replace(last, limit=True)) from failure
                raise PathEnd(f"no step in time converged, down to {step:.3g} s ({failure})") from failure
            continue
        earlier, time = (step, last.state), duration if share == 1.0 else time + step
        path.trail.add(point)
        yield share, point
        step = min(wanted, step) if shrunk else wanted


def _change(error: float, tolerance: float) -> float:
    """Return by how much the next step should be longer; its error grows as its square."""
    return LONGER if error == 0.0 else min(LONGER, max(SHORTER, SAFETY * math.sqrt(tolerance / error)))


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


def _solved(path: Continuation, value: float, rise: float, step: float, earlier: tuple[float, State] | None) -> State:
    """Return the state at a value and the end of a step, guessed along the last step, or else the tangent."""
    last, corrector = path.last, path.corrector
    line, w, P = path.requested.curve(value), last.state.w, last.state.P
    if earlier is not None:
        ratio = min(step / earlier[0], LONGER)
        w, P = w + ratio * (w - earlier[1].w), P + ratio * (P - earlier[1].P)
    elif rise:
        ratio = (value - path.value(last.state)) / path.requested.rate(last.state, last.tangent)
        w, P = w + ratio * last.tangent.w, P + ratio * last.tangent.P
    guess: Array = w
    return path.requested.exactly(corrector.solve_from(line, guess, P, last.state), value)
