"""Following a device along its load path: `trace` yields one `Point` after another.

Steps are predicted from the last two states and their tangents (a cubic), corrected by Newton's method, halved on failure,
and lengthened where Newton is quick. A requested value that the control's line cannot meet is solved for between two states.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from softmodels.mechanics.controls import Control
from softmodels.mechanics.newton import NoConvergence
from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import State
from softmodels.path.corrector import Corrector
from softmodels.path.critical_points import events
from softmodels.path.modes import Mode
from softmodels.path.passed_limits import PassedLimits
from softmodels.path.points import PathEnd, Point
from softmodels.path.quantities import AddedVolume, ArcLength, Followed, Plane, Pressure, Quantity
from softmodels.path.snapping import check_yields, lost
from softmodels.path.trail import Trail

CONTROLS = ("auto", "pressure", "volume", "arc-length")
QUICK, SLOW = 3, 6  # Newton iterations up to which a step grows, from which it shrinks
GROWTH = 1.7
SOFTENING = 4.0  # growth of dV/dP (or dV/dS of a stroke) over its least at which `auto` leaves it for the volume
PAST_LIMIT = 0.1  # how far `auto` goes on past a limit point, in volumes added up to it
SHORTEST = 1e-3  # of the first step: a path that needs shorter ones has met something that steps do not mend
LARGEST_GROWTH = 60.0  # cavity volumes at which a path under volume or arc-length control is ended


@dataclasses.dataclass
class Continuation:
    """A load path in the making: what is asked of it, what it follows, and the length of its steps.

    Args:
        solver: The device.
        requested: What the requested values are of.
        control: What is followed, one of `CONTROLS`; "auto" follows what is requested, and the volume where it softens.
        largest_step: Longest step in units of the requested quantity, for a curve with enough points to draw.
        largest_growth: Cavity volumes at which a path to a pressure is given up.
        start: Where the path begins; the undeformed state if None.
        report: Takes sentences on what is going on.
        recall: Lets parts remember what they do where a path goes on.

    Attributes:
        trail: Its last points, once it has begun; with it ``plane``, its scales, and ``corrector``, which finds its states.
    """

    solver: Solver
    requested: Quantity = dataclasses.field(default_factory=Pressure)
    control: str = "auto"
    largest_step: float = math.inf
    largest_growth: float = LARGEST_GROWTH
    start: State | None = None
    report: Callable[[str], None] = lambda text: None
    recall: Callable[[], None] = lambda: None

    def __post_init__(self) -> None:
        if self.control not in CONTROLS:
            raise ValueError(f"control {self.control!r} is not one of {', '.join(CONTROLS)}")

    def begin(self) -> Point:
        """The path's first point; sets the scales of the plane in which arc lengths are measured."""
        solver = self.solver
        rest = solver.system.rest()
        V_scale = float(np.abs(solver.system.coupling.shares) @ solver.system.scales())
        start = rest if self.start is None else self.start
        solver.system.potential.keep(start.w, anew=self.start is None)
        self.trail = Trail(solver)  # before there are factors: to make its mass matrix takes memory
        solver.factorise(start)
        tangent = solver.tangent(start, Control(1 / V_scale, 1.0, 0.0))
        self.V0, self.plane = start.V, Plane.of(V_scale, tangent.compliance)
        self.requested = self.requested.counted(self.V0, rest.V)
        known = (Pressure(), AddedVolume(rest.V), ArcLength(self.plane), self.requested)
        self._known: dict[str, Followed] = {one.name: one for one in known}
        self.trail.line = self.requested.name if self.control == "auto" else self.control
        self.corrector = Corrector(solver, self.trail, self.plane)
        if not self.requested.starts_forward(start, tangent):  # it starts where the device is unstable
            tangent = -tangent
        self.trail.stability.start()
        signature = self.trail.stability.signature(exact=True)
        step, stiffest = self.first_step, self.plane.felt(tangent.compliance)
        first = Point(start, tangent, False, False, step, self.trail.line, True, solver.kept.age, stiffest, signature)
        return self.keep(first)

    def resume(self, points: Sequence[Point]) -> None:
        """Go on from points of an earlier trace; see `Trail.restore`."""
        self.begin()
        self.recall()
        self.trail.restore(points, self.corrector.tangent)

    def keep(self, point: Point) -> Point:
        return self.trail.keep(point)

    @property
    def last(self) -> Point:
        return self.trail.last

    @property
    def followed(self) -> Followed:
        return self._known[self.trail.line]

    @property
    def direct(self) -> bool:
        """Whether the requested quantity is followed itself, so that the path stops at its values without looking back."""
        return self.followed is self.requested

    @property
    def first_step(self) -> float:
        """Length of a first step in what is followed."""
        return self.followed.first_step(self.plane, self.V0)

    def value(self, state: State) -> float:
        """The requested quantity at a state."""
        return self.requested.value(state.V, state.P)

    def between(self, before: Point, after: Point, value: float) -> Point:
        """The point with a requested value that lies between two points."""
        return self.corrector.between(self.requested, before, after, value)

    def events(self, before: Point, after: Point) -> list[Point]:
        """Limit points and bifurcations between two neighbouring points, in order."""
        try:
            return events(self.corrector, self.requested, before, after, self.report)
        except NoConvergence as failure:
            raise lost(self.corrector, self.requested, "a limit point on the way was not found", failure) from failure

    def advance(self, step: float, goal: float) -> Point:
        """One step towards the requested value ``goal``; shortened until it succeeds.

        Raises:
            PathEnd: Not even the shortest step succeeded.
        """
        direct = self.direct
        step = min(step, self._longest())
        left = goal - self.value(self.last.state)
        while True:
            hit = direct and left <= step * (1 + 1e-9)
            # Equal shares of what is left: no sliver of a step before a requested value.
            share = left if hit else left / math.ceil(left / step - 1e-9) if direct and left < 3 * step else step
            try:
                return self._stepped(share, goal if hit else None, step)
            except NoConvergence as failure:
                self.report(f"step of {share:.3g} failed ({failure}); halved")
                step = share / 2
                shortest = SHORTEST * self.first_step
                if self.may_follow_volume and direct and step < max(0.02 * self.last.step, shortest):
                    self.follow(AddedVolume.name)  # which passes a limit point, and so tells one from a failure
                    step, direct = self.last.step, False
                elif step < shortest:
                    why = "no step succeeded, down to a thousandth of the first one"
                    raise lost(self.corrector, self.requested, why, failure) from failure

    def _stepped(self, share: float, goal: float | None, step: float) -> Point:
        """The point a ``share`` ahead, or at the value ``goal`` if given; `NoConvergence` if this branch has none."""
        last = self.last
        line = self.followed.ahead(last.state, last.tangent, share) if goal is None else self.requested.curve(goal)
        state = self.corrector.solve(line, self.trail.points)
        self.corrector.check_branch(state, line)
        state = state if goal is None else self.requested.exactly(state, goal)
        count = state.iterations - self.solver.system.assembled.slack
        change = GROWTH if count <= QUICK else 1.0 if count < SLOW else 0.6
        following = max(step, share) * change if change > 1 else share * change
        return self.corrector.point(state, requested=goal is not None, step=following)

    def _longest(self) -> float:
        """The longest step allowed, in units of what the path is following."""
        s, t = self.last.state, self.last.tangent
        per, along = self.requested.rate(s, t), self.followed.rate(s, t)
        return self.largest_step * abs(along / per) if per else math.inf

    def choose(self, past_limit: bool) -> None:
        """Under ``auto``, follow the requested quantity where the device is stiff and the volume where it softens."""
        if self.control != "auto" or self.by_volume or (past_limit and self.requested.ends_at_pressure_limit):
            return
        s, t = self.last.state, self.last.tangent
        a, b = self.requested.slopes(s.V, s.P)
        stiffest = (a + b / self.last.stiffest) * t.V
        softened = a * t.V + b * t.P  # the same here; both are how fast the quantity rises with the volume
        if self.direct and not stiffest < SOFTENING * softened:
            self.follow(AddedVolume.name)
        elif self.trail.line == AddedVolume.name and stiffest < SOFTENING / 2 * softened:
            self.follow(self.requested.name)

    def follow(self, line: str) -> None:
        """Change what the path follows, by its name, with a step of about the same length."""
        if line == self.trail.line:
            return
        self.report(f"following the {line} from here")
        s, t, now, new = self.last.state, self.last.tangent, self.followed, self._known[line]
        step = abs(self.last.step * new.rate(s, t) / now.rate(s, t))
        self.trail.change_line(line, min(step, new.largest_step(s, self.plane)))

    @property
    def by_volume(self) -> bool:
        """Whether volumes are requested, of which there is one beyond every limit point of the pressure."""
        return isinstance(self.requested, AddedVolume)

    @property
    def may_follow_volume(self) -> bool:
        """Whether the volume may be followed where no step of the requested quantity succeeds."""
        return self.control in ("auto", Pressure.name) and not self.by_volume

    @property
    def ends_at_limit(self) -> bool:
        """Whether a limit point of the pressure ends the path: a pressure above it has no state, a volume has one."""
        return self.may_follow_volume and self.requested.ends_at_pressure_limit


def trace(path: Continuation, goals: Sequence[float], start: Sequence[Point] = ()) -> Iterator[Point]:
    """Follow a device through the requested values, in rising order, and yield every point on the way.

    Args:
        path: What to follow, and how.
        goals: Requested values (dimensionless), rising, none below 0.
        start: The last points of an interrupted trace, to go on from; goals at or below them are taken as done.

    Yields:
        Points along the path; those requested are marked, and so are limit points.

    Raises:
        PathEnd: A requested value is not on this path.
    """
    left = list(goals)
    if start:
        path.resume(start)
        done = path.value(path.last.state)
        left = [goal for goal in left if goal > done * (1 + 1e-12)]
    else:
        first = path.begin()
        requested = bool(left) and left[0] == 0.0
        yield dataclasses.replace(first, requested=requested)
        check_yields(first, path.plane, path.requested, path.followed)
        left = left[1:] if requested else left
    passed = PassedLimits.among(start, path.requested)
    while left:
        _check_end(path, passed)
        path.choose(passed.limit is not None)
        before = path.last
        step = before.step
        if passed.limit is not None and path.ends_at_limit:
            step = min(step, PAST_LIMIT / 2 * (passed.limit.state.V - path.V0))
        try:
            after = path.advance(step, left[0])
            stops = [*path.events(before, after), after]
        except PathEnd as end:
            raise passed.ended(end, path.requested) from end
        yield from _up_to(path, before, stops, left, passed)
        left = left[1:] if left and after.requested else left


def _up_to(
    path: Continuation, before: Point, stops: list[Point], left: list[float], passed: PassedLimits
) -> Iterator[Point]:
    """Points from one up to its neighbour, the last stop, in order; goals that are met are taken from ``left``."""
    here, after = before, stops[-1]
    for stop in stops:
        if passed.jumping and passed.turn:
            level = path.value(passed.turn.state)
            if path.value(here.state) < level <= path.value(stop.state):
                # On the bench the device jumps at the limit point of what is requested to here.
                landed = path.between(here, stop, level)
                here, passed.jumping = path.keep(dataclasses.replace(landed, requested=False, jump=True)), False
                yield here
        # On its own line the path stops at a goal by itself; on another it has to look back for those it passed.
        while not path.direct and path.value(here.state) < left[0] <= path.value(stop.state):
            here = path.keep(path.between(here, stop, left[0]))
            del left[0]
            yield here
            if not left:
                return
        if stop.mode is not None:
            # Interpolated, and where K is singular: nothing to foretell the next state from.
            path.trail.modes.append(Mode(path.trail.stability.mass, stop.mode))
            here = stop
        else:
            here = path.keep(dataclasses.replace(stop, step=after.step))
        if passed.limit is None and stop.limit and before.tangent.P > 0:
            passed.limit = here
        if stop.turn:
            passed.turn, passed.jumping = here, True
        yield here


def _check_end(path: Continuation, passed: PassedLimits) -> None:
    """Raise the `PathEnd` of a path that has gone far enough past its limit point, or too far altogether."""
    added = path.last.state.V - path.V0
    limit = passed.limit
    if limit is not None and path.ends_at_limit and added > (1 + PAST_LIMIT) * (limit.state.V - path.V0):
        raise PathEnd("the pressure has a limit point", limit)
    if not path.by_volume and added > path.largest_growth * path.plane.V_scale:
        why = f"the cavity has grown {path.largest_growth:g} times and the requested value was not met"
        raise passed.ended(PathEnd(why), path.requested)
