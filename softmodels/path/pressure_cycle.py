"""Up and down under a dead pressure: what a water column does that is slowly raised and lowered again.

The states of equilibrium form one curve through stable and unstable parts. A given pressure holds the device on a stable
part until that ends at a limit point; there it jumps, at that pressure, to the next stable part the curve leads to. On
the way down it stays on that part until its own limit point, so the way back is another: hysteresis.

The curve is followed once by arc length; both ways are then read off it, every state solved for at its own pressure.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence

from softmodels.path.continuation import Continuation, trace
from softmodels.path.points import PathEnd, Point
from softmodels.path.quantities import ArcLength

LARGEST_GROWTH_OF_CYCLE = 500.0
"""Cavity volumes up to which a second stable part is looked for: a balloon of eight times its radius."""


@dataclasses.dataclass(frozen=True)
class Part:
    """A stable part of the curve: points with rising pressure, limit points at ends where there are any."""

    points: tuple[Point, ...]

    @property
    def lowest(self) -> float:
        return self.points[0].state.P

    @property
    def highest(self) -> float:
        return self.points[-1].state.P


def cycle(path: Continuation, goals: Sequence[float]) -> Iterator[Point]:
    """Raise the pressure through the goals and lower it through them again.

    Args:
        path: A new path, its quantity the pressure; what it follows is chosen here.
        goals: Dimensionless pressures, rising.

    Yields:
        Points with their stable states alone, in the order in which they happen; the first one after a jump is marked.

    Raises:
        PathEnd: There is no stable state at the highest pressure. What can be reached has been yielded.
    """
    path.control, path.largest_growth = ArcLength.name, LARGEST_GROWTH_OF_CYCLE
    points: list[Point] = []
    lost = None
    try:
        points.extend(trace(path, [goals[-1]]))
    except PathEnd as end:
        points, lost = points or list(path.trail.points), end
    parts = _stable_parts(points)
    here = yield from _along(path, parts, 0, goals, 1)
    if here is None:
        limit = next((point for point in points if point.limit), None)
        if len(parts) > 1 or limit is None:
            why = f"past the jumps so far, {lost}" if len(parts) > 1 else str(lost)
            raise PathEnd(why, cause=None if lost is None else lost.cause)
        raise PathEnd("the pressure has a limit point, and no stable state was found at that pressure beyond it", limit)
    yield from _along(path, parts, here, [*goals[::-1], *([0.0] if goals[0] > 0 else [])], -1)


def _stable_parts(points: Sequence[Point]) -> list[Part]:
    """The curve's stable parts in order; limit points belong to the part they end."""
    parts: list[list[Point]] = []
    current: list[Point] = []
    for point in points:
        if point.limit:
            if current:
                parts.append([*current, point])
                current = []
            else:
                current = [point]  # a least pressure: a stable part may begin here
        elif point.stable_under_pressure and point.tangent.P > 0 and not point.bifurcation:
            current.append(point)
        elif current:
            if len(current) > 1:
                parts.append(current)
            current = []
    if len(current) > 1:
        parts.append(current)
    return [Part(tuple(part)) for part in parts]


def _along(path: Continuation, parts: list[Part], here: int, goals: Sequence[float], way: int):  # type: ignore[no-untyped-def]
    """Points from the part ``here`` through the goals, up (1) or down (-1); returns the last part, or None if stuck."""
    at = parts[here].points[0].state.P if way > 0 else math.inf
    left = list(goals)
    landed: Point | None = None
    while True:
        part = parts[here]
        end = part.highest if way > 0 else part.lowest
        if landed is not None:
            yield landed
        reached = [goal for goal in left if (goal - end) * way <= 1e-12]
        last = reached[-1] if len(reached) == len(left) else end
        between = [
            p
            for p in part.points
            if not p.requested and (p.state.P - at) * way > 1e-9 and (last - p.state.P) * way > 1e-9
        ]
        stops = [(p.state.P, p) for p in between] + [(goal, None) for goal in reached]
        for P, known in sorted(stops, key=lambda stop: stop[0] * way):
            if known is None or not math.isclose(P, at, rel_tol=1e-9):
                yield dataclasses.replace(known, jump=False) if known is not None else _state(path, part, P)
        left = left[len(reached) :]
        if not left:
            return here
        edge = part.points[-1 if way > 0 else 0]
        yield dataclasses.replace(edge, requested=False)
        options = range(here + way, len(parts) if way > 0 else -1, way)
        found = next((k for k in options if parts[k].lowest <= end <= parts[k].highest), None)
        if found is None or not edge.limit:
            return None
        here, at = found, end
        landed = dataclasses.replace(_state(path, parts[here], end), requested=False, jump=True)


def _state(path: Continuation, part: Part, P: float) -> Point:
    """The state of a stable part at a pressure."""
    for before, after in zip(part.points, part.points[1:], strict=False):
        if before.state.P <= P <= after.state.P:
            if P == before.state.P and not before.limit:
                return dataclasses.replace(before, requested=True)
            return path.between(before, after, P)
    return dataclasses.replace(part.points[-1], requested=True)
