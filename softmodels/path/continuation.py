"""Following a device along its load path: `trace` yields one `Point` after another.

Steps are predicted from the last two states and their tangents (a cubic), corrected by Newton's method, halved on failure
with nothing lost (states are values), and lengthened where Newton is quick. Requested values are hit exactly. A requested
value that the current control's line cannot meet directly is bracketed by two states and solved for in between.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from softmodels.mechanics.controls import Control, Curve, arc_length, pressure_control, volume_control
from softmodels.mechanics.solver import TANGENT_TOLERANCE, Equilibrium, NoConvergence, Tangent
from softmodels.mechanics.system import State
from softmodels.path.critical_points import events
from softmodels.path.points import PathEnd, Point, predict
from softmodels.path.stability import Mode, Signature, Stability
from softmodels.path.syringe import Stroke

CONTROLS = ("auto", "pressure", "volume", "arc-length")
QUANTITIES = ("pressure", "volume", "stroke")
QUICK, SLOW = 3, 6  # Newton iterations up to which a step grows, from which it shrinks
GROWTH = 1.7
SOFTENING = 4.0  # growth of dV/dP (or dV/dS of a stroke) over its least at which `auto` leaves it for the volume
PAST_LIMIT = 0.1  # how far `auto` goes on past a limit point, in volumes added up to it
LARGEST_MODE_SHARE = 0.5
"""Share of a bifurcation's mode in a guess's error, over the step's size, above which the state lies on another branch."""
SHORTEST = 1e-3  # of the first step: a path that needs shorter ones has met something that steps do not mend
LARGEST_GROWTH = 60.0  # cavity volumes at which a path under volume or arc-length control is ended


@dataclasses.dataclass
class Continuation:
    """The state of a trace: its last two points, and the step in use.

    Args:
        equilibrium: The device.
        control: One of `CONTROLS`.
        quantity: What the requested values are: ``"pressure"``, ``"volume"`` (added volume) or ``"stroke"`` (of a
            syringe, a volume), dimensionless.
        largest_step: Longest step in units of the requested quantity, for a curve with enough points to draw.
        supply: The syringe's gas law, where strokes are requested.
        largest_growth: Cavity volumes at which a path to a pressure is given up.
        start: Where the path begins; the undeformed state if None.
    """

    equilibrium: Equilibrium
    control: str = "auto"
    quantity: str = "pressure"
    largest_step: float = math.inf
    supply: Stroke | None = None
    largest_growth: float = LARGEST_GROWTH
    start: State | None = None

    def __post_init__(self) -> None:
        if self.control not in CONTROLS:
            raise ValueError(f"control {self.control!r} is not one of {', '.join(CONTROLS)}")
        if self.quantity not in QUANTITIES or (self.quantity == "stroke") != (self.supply is not None):
            raise ValueError(f"quantity {self.quantity!r} is not one of {', '.join(QUANTITIES)}, or has no supply")
        self.points: list[Point] = []
        self.line = {"auto": self.quantity}.get(self.control, self.control)
        self.report: Callable[[str], None] = lambda text: None
        self.modes: list[Mode] = []
        self.stability = Stability.of(self.equilibrium)

    # -- scales, from the device as it starts ---------------------------------------------------------------------------

    def begin(self) -> Point:
        """The path's first point; sets the scales of the plane in which arc lengths are measured."""
        eq = self.equilibrium
        rest = eq.rest()
        self.V_scale = float(np.abs(eq.coupling.shares) @ eq.volumes())
        start = rest if self.start is None else self.start
        eq.factorise(start)
        self.V0 = start.V
        tangent = eq.tangent(start, Control(1 / self.V_scale, 1.0, 0.0))
        self.P_scale = self.V_scale / abs(tangent.compliance)
        if (tangent.P if self.quantity == "pressure" else tangent.V) < 0.0:  # it starts where the device is unstable
            tangent = -tangent
        self.first_steps = {"pressure": 0.1 * self.P_scale, "volume": 0.1 * self.V_scale, "arc-length": 0.1}
        if self.supply is not None:
            a, b = self.supply.slopes(self.V0, 0.0)
            self.first_steps["stroke"] = 0.1 * (a * self.V_scale + b * self.P_scale)
        step, stiffest = self.first_steps[self.line], abs(tangent.compliance)
        self.stability.start()
        signature = self.stability.signature(exact=True)
        return self.keep(Point(start, tangent, False, False, step, self.line, True, eq.age, stiffest, signature))

    def resume(self, points: Sequence[Point]) -> None:
        """Go on from points of an earlier trace: same predictor, same factorisation, same modes, so the same numbers.

        Args:
            points: In order, the last two, those before them at which the kept factorisation was made, and bifurcations.
        """
        self.begin()
        self.points = []
        for point in points:
            if point.bifurcation:
                self.modes.append(Mode(self.stability, point.mode))
                continue
            if point.factorised:
                self.equilibrium.factorise(point.state)
                self.stability.lowest()
            known = point.tangent.w.any()
            again = point if known else dataclasses.replace(point, tangent=self.tangent(point.state))
            self.points = [*self.points[-1:], again]
        last, eq = self.points[-1], self.equilibrium
        self.line, eq.age, eq.worn, self.stability.largest = last.line, last.age, last.worn, last.largest

    def keep(self, point: Point) -> Point:
        """Make a point the path's last one, with what a restart needs to go on as this path does."""
        eq = self.equilibrium
        point = dataclasses.replace(
            point, factorised=eq.base is point.state, age=eq.age, worn=eq.worn, largest=self.stability.largest
        )
        self.points = [*self.points[-1:], point]
        return point

    @property
    def last(self) -> Point:
        return self.points[-1]

    def value(self, state: State) -> float:
        """The requested quantity at a state."""
        if self.supply is not None:
            return self.supply.value(state.V, state.P)
        return state.P if self.quantity == "pressure" else state.V - self.V0

    def target(self, value: float) -> Curve:
        """The curve on which the requested quantity has this value."""
        if self.supply is not None:
            return self.supply.at(value)
        return pressure_control(value) if self.quantity == "pressure" else volume_control(value + self.V0)

    # -- one step -----------------------------------------------------------------------------------------------------

    def tangent(self, state: State, tolerance: float = TANGENT_TOLERANCE) -> Tangent:
        """Direction at a state, kept pointing forward; measured square to the last direction, so regular at limits."""
        if self.points:
            t = self.last.tangent
            line = arc_length(0.0, 0.0, t.V, t.P, 0.0, self.V_scale, self.P_scale)
        else:
            line = Control(1 / self.V_scale, 1.0, 0.0)
        return self.equilibrium.tangent(state, line, tolerance)

    def ahead(self, step: float) -> Curve:
        """The curve that lies ``step`` ahead of the last point, for what the path is following."""
        s, t = self.last.state, self.last.tangent
        if self.line == "stroke":
            return self.target(self.value(s) + step)
        if self.line == "pressure":
            return pressure_control(s.P + step)
        if self.line == "volume":
            return volume_control(s.V + step)
        return arc_length(s.V, s.P, t.V, t.P, step, self.V_scale, self.P_scale)

    def solve(self, line: Curve, around: Sequence[Point]) -> State:
        """The state on a line, guessed by the cubic through one or two points and their tangents.

        Past a bifurcation there are several. One with much more or less of the mode than foretold lies on another branch.
        """
        w, P = predict(around, line)
        try:
            state = self.equilibrium.solve(line, w, P)
        except NoConvergence:
            if self.equilibrium.sheet is None:
                raise
            state = self.equilibrium.solve(
                line, w, P, since=around[-1].state.w
            )  # a stiff sheet may have been in the way
        for mode in self.modes:
            if abs(mode.share(state.w - w)) > LARGEST_MODE_SHARE * mode.size(w - around[-1].state.w):
                raise NoConvergence("it jumped to another branch")
        return state

    def point(self, state: State, requested: bool = False, limit: bool = False, step: float | None = None) -> Point:
        eq = self.equilibrium
        stale = eq.stale
        # At a limit point K is singular: no preconditioner to go on with, and a signature of rounding errors.
        stale = (stale or self.stability.wants(state)) and not (limit and eq.bordered.factorisations)
        if stale:
            eq.factorise(state)
        tangent, before = self.tangent(state), self.last.tangent
        if limit:
            # Which way the pressure goes there is a matter of rounding; like the signature, it is that of the state before.
            tangent = dataclasses.replace(tangent, P=math.copysign(tangent.P, before.P))
        turned = before.P * tangent.P < 0 or before.V * tangent.V < 0
        if (turned or self.last.signature.negative_eigenvalues) and not stale and not limit:
            stale = True
            eq.factorise(state)
        step = self.last.step if step is None else step
        stiffest = min(self.last.stiffest, abs(tangent.compliance))
        negative = self.last.signature.negative_eigenvalues
        if limit:
            signature = Signature(negative, self.stability.critical_lowest(state, negative))
        else:
            signature = self.stability.signature(stale, negative)
        return Point(state, tangent, requested, limit, step, self.line, stale, eq.age, stiffest, signature)

    def advance(self, step: float, goal: float) -> Point:
        """One step towards the requested value ``goal``; shortened until it succeeds.

        Raises:
            PathEnd: Not even the shortest step succeeded.
        """
        direct = self.line == self.quantity
        step = min(step, self.longest())
        left = goal - self.value(self.last.state)
        while True:
            hit = direct and left <= step * (1 + 1e-9)
            # Equal shares of what is left: no sliver of a step before a requested value.
            share = left if hit else left / math.ceil(left / step - 1e-9) if direct and left < 3 * step else step
            line = self.target(goal) if hit else self.ahead(share)
            try:
                state = self.solve(line, self.points)
                self._check_branch(state)
                if hit and self.quantity == "pressure":
                    state = dataclasses.replace(state, P=goal)  # to the last digit
                change = GROWTH if state.iterations <= QUICK else 1.0 if state.iterations < SLOW else 0.6
                return self.point(
                    state, requested=hit, step=max(step, share) * change if change > 1 else share * change
                )
            except NoConvergence as failure:
                self.report(f"step of {share:.3g} failed ({failure}); halved")
                step = share / 2
                shortest = SHORTEST * self.first_steps[self.line]
                if self.may_follow_volume and direct and step < max(0.02 * self.last.step, shortest):
                    self.follow("volume")  # which passes a limit point, and so tells one from a failure
                    step, direct = self.last.step, False
                elif step < shortest:
                    raise PathEnd(f"no step of any length succeeded ({failure})") from failure

    def _check_branch(self, state: State) -> None:
        """Refuse a state that Newton found somewhere else: behind the last one, or with its cavity turned inside out."""
        s, t = self.last.state, self.last.tangent
        along = self.product((state.V - s.V, state.P - s.P), (t.V, t.P))
        if self.equilibrium.volumes().min() <= 0.0 or along <= 0.0:
            raise NoConvergence("it jumped to another branch")

    def choose(self, past_limit: bool) -> None:
        """Under ``auto``, follow the requested quantity where the device is stiff and the volume where it softens."""
        if self.control != "auto" or self.quantity == "volume" or (past_limit and self.quantity == "pressure"):
            return
        s, t = self.last.state, self.last.tangent
        a, b = (0.0, 1.0) if self.supply is None else self.supply.slopes(s.V, s.P)
        stiffest = (a + b / self.last.stiffest) * t.V
        softened = a * t.V + b * t.P  # the same here; both are how fast the quantity rises with the volume
        if self.line == self.quantity and not stiffest < SOFTENING * softened:
            self.follow("volume")
        elif self.line == "volume" and stiffest < SOFTENING / 2 * softened:
            self.follow(self.quantity)

    @property
    def may_follow_volume(self) -> bool:
        """Whether the volume may be followed where no step of the requested quantity succeeds."""
        return self.control in ("auto", "pressure") and self.quantity != "volume"

    @property
    def ends(self) -> bool:
        """Whether a limit point of the pressure ends the path: a pressure above it has no state, a volume has one."""
        return self.may_follow_volume and self.quantity == "pressure"

    def turn(self, before: Point, after: Point) -> list[Point]:
        """The limit point of the stroke between two points, if there is one: there the gas goes on to push by itself."""
        if self.supply is None or self._stroke_slope(before) <= 0.0 or self._stroke_slope(after) >= 0.0:
            return []
        return [dataclasses.replace(self.point(self._bisect(before, after, self._stroke_slope)), turn=True)]

    def _stroke_slope(self, point: Point) -> float:
        """dS/dV along the path."""
        assert self.supply is not None
        a, b = self.supply.slopes(point.state.V, point.state.P)
        return a + b * point.tangent.P / point.tangent.V

    def rate(self, quantity: str) -> float:
        """How fast a quantity changes along the last point's tangent."""
        s, t = self.last.state, self.last.tangent
        if quantity == "stroke":
            assert self.supply is not None
            a, b = self.supply.slopes(s.V, s.P)
            return a * t.V + b * t.P
        return {"pressure": t.P, "volume": t.V}.get(quantity, self.product((t.V, t.P), (t.V, t.P)) ** 0.5)

    def product(self, a: tuple[float, float], b: tuple[float, float]) -> float:
        """Inner product of two changes (dV, dP) in the plane in which arc lengths are measured."""
        return a[0] * b[0] / self.V_scale**2 + a[1] * b[1] / self.P_scale**2

    def longest(self) -> float:
        """The longest step allowed, in units of what the path is following."""
        per, along = self.rate(self.quantity), self.rate(self.line)
        return self.largest_step * abs(along / per) if per else math.inf

    def follow(self, line: str) -> None:
        """Change what the path follows, with a step of about the same length."""
        if line == self.line:
            return
        self.report(f"following the {line} from here")
        step = abs(self.last.step * self.rate(line) / self.rate(self.line))
        if line == "volume":
            step = min(step, 0.2 * max(self.last.state.V, self.V_scale))
        self.line = line
        self.points[-1] = dataclasses.replace(self.last, step=step, line=line)

    def between(self, before: Point, after: Point, value: float) -> Point:
        """The point with a requested value that lies between two points."""
        try:
            state = self.solve(self.target(value), (before, after))
            low, high = sorted((before.state.V, after.state.V))
            margin = 1e-6 * (high - low)
            if not low - margin <= state.V <= high + margin:
                raise NoConvergence("another branch")
        except NoConvergence:
            state = self._bisect(before, after, lambda p: self.value(p.state) - value)
        return self.point(state, requested=True)

    def on_the_way(self, before: Point, after: Point, share: float) -> Point:
        """A point between two, ``share`` of the way in volume."""
        a, b = before.state, after.state
        state = self.solve(volume_control(a.V + share * (b.V - a.V)), (before, after))
        return dataclasses.replace(after, state=state, tangent=self.tangent(state), requested=False)

    def in_between(self, before: Point, after: Point, share: float) -> Point:
        """A point between two close ones, interpolated and not solved for."""
        a, b = before.state, after.state
        line = volume_control(a.V + share * (b.V - a.V))
        w, P = predict((before, after), line)
        v, r = before.tangent, after.tangent
        tangent = Tangent(
            (1 - share) * v.w + share * r.w, (1 - share) * v.P + share * r.P, (1 - share) * v.V + share * r.V
        )
        return dataclasses.replace(after, state=State(w, P, line.target), tangent=tangent)

    def middle(self, before: Point, after: Point) -> Point:
        """The point half way between two, with its signature."""
        state = self.on_the_way(before, after, 0.5).state
        self.equilibrium.factorise(state)
        return dataclasses.replace(
            after, state=state, tangent=self.tangent(state), requested=False, limit=False,
            signature=self.stability.signature(exact=True),
        )  # fmt: skip

    def events(self, before: Point, after: Point) -> list[Point]:
        """Limit points, bifurcations and turns of the stroke between two neighbouring points, in order.

        The kept factorisation is that of ``after`` then: none of the states solved for in between leaves a trace in what
        follows, which a run that is gone on with could not follow.
        """
        eq, kept = self.equilibrium, (self.equilibrium.base, self.stability.modes)
        found = events(self, before, after)
        if turn := self.turn(before, after):
            found = sorted([*turn, *found], key=lambda point: abs(point.state.V - before.state.V))
        if eq.base is not kept[0] or self.stability.modes is not kept[1]:
            eq.factorise(after.state)
            self.stability.lowest()
        return found

    def limit(self, before: Point, after: Point) -> Point:
        """The limit point of the pressure between two points, to about 1e-10 of the pressure."""
        return self.point(self._bisect(before, after, lambda p: p.tangent.P / p.tangent.V), limit=True)

    def _bisect(self, low: Point, high: Point, f: Callable[[Point], float]) -> State:
        """Root of f between two points by the Illinois variant of the secant, on lines of given volume."""
        f_low, f_high = f(low), f(high)
        scale = max(abs(f_low), abs(f_high))
        best, side = low, 0
        for _ in range(25):
            V = (low.state.V * f_high - high.state.V * f_low) / (f_high - f_low)
            state = self.solve(volume_control(V), (low, high))
            best = dataclasses.replace(high, state=state, tangent=self.tangent(state, 1e-9))
            value = f(best)
            if abs(value) <= 1e-7 * scale or abs(high.state.V - low.state.V) <= 1e-9 * self.V_scale:
                break
            if (value > 0) == (f_high > 0):
                high, f_high = best, value
                f_low /= 2 if side == 1 else 1
                side = 1
            else:
                low, f_low = best, value
                f_high /= 2 if side == -1 else 1
                side = -1
        return best.state


def trace(path: Continuation, goals: Sequence[float], start: Sequence[Point] = ()) -> Iterator[Point]:
    """Follow a device through the requested values, in rising order, and yield every point on the way.

    Args:
        path: What to follow, and how.
        goals: Requested pressures or added volumes (dimensionless), rising, none below 0.
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
        left = left[1:] if requested else left
    met = next((point for point in start if point.limit), None)
    turned = next((point for point in reversed(start) if point.turn), None)
    jumping = turned is not None and path.value(turned.state) > path.value(path.last.state)
    while left:
        _check_end(path, met, turned)
        path.choose(met is not None)
        before = path.last
        step = before.step
        if met is not None and path.ends:
            step = min(step, PAST_LIMIT / 2 * (met.state.V - path.V0))
        try:
            after = path.advance(step, left[0])
        except PathEnd as end:
            raise _ended(str(end), path, met, turned) from end
        passed = before
        for stop in [*path.events(before, after), after]:
            if jumping and turned and path.value(passed.state) < path.value(turned.state) <= path.value(stop.state):
                # On the bench the device jumps at the stroke's limit point to here.
                landed = path.between(passed, stop, path.value(turned.state))
                passed, jumping = path.keep(dataclasses.replace(landed, requested=False, jump=True)), False
                yield passed
            # On its own line the path stops at a goal by itself; on another it has to look back for those it passed.
            while path.line != path.quantity and path.value(passed.state) < left[0] <= path.value(stop.state):
                passed = path.keep(path.between(passed, stop, left[0]))
                left = left[1:]
                yield passed
                if not left:
                    return
            if stop.bifurcation:
                # Interpolated, and where K is singular: nothing to foretell the next state from.
                path.modes.append(Mode(path.stability, stop.mode))
                passed = stop
            else:
                passed = path.keep(dataclasses.replace(stop, step=after.step))
            if met is None and stop.limit and before.tangent.P > 0:
                met = passed
            if stop.turn:
                turned, jumping = passed, True
            yield passed
        left = left[1:] if after.requested else left


def _ended(why: str, path: Continuation, met: Point | None, turned: Point | None) -> PathEnd:
    """The end of a path, with the limit point that the requested quantity has met."""
    if path.quantity == "stroke":
        return PathEnd(why, turned)
    return PathEnd(why, met if path.quantity == "pressure" else None)


def _check_end(path: Continuation, met: Point | None, turned: Point | None) -> None:
    """End a path that has gone far enough past its limit point, or too far altogether."""
    added = path.last.state.V - path.V0
    if met is not None and path.ends and added > (1 + PAST_LIMIT) * (met.state.V - path.V0):
        raise PathEnd("the pressure has a limit point", met)
    if path.quantity != "volume" and added > path.largest_growth * path.V_scale:
        raise _ended(
            f"the cavity has grown {path.largest_growth:g} times and the requested value was not met", path, met, turned
        )
