"""Continuation of equilibrium states: `trace` yields one `Point` of the load path after another.

Steps are predicted from the last two states and their tangents (a cubic), corrected by Newton's method, halved on failure,
and lengthened if Newton converges quickly. Requested values that the control cannot prescribe are solved for between two
states.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np
import numpy.typing as npt

from softmodels.common.arrays import Array
from softmodels.common.lazy import scipy
from softmodels.components import creases
from softmodels.mechanics import assembly, component, controls, memory, mpi, newton
from softmodels.mechanics.solver import TANGENT_TOLERANCE, Solver
from softmodels.mechanics.system import State, System
from softmodels.path.stability import (
    AddedVolume,
    ArcLength,
    ArcLengthMetric,
    ContinuationParameter,
    Mode,
    PathEnd,
    PathQuantity,
    Point,
    Pressure,
    Signature,
    Stability,
)

CONTROLS = ("auto", "pressure", "volume", "arc-length")
FAST_ITERATIONS, SLOW_ITERATIONS = 3, 6  # Newton iterations up to which steps grow, above which they shrink
STEP_GROWTH = 1.7
VOLUME_CONTROL_SOFTENING = 4.0  # growth of dV/dP (or dV/dS) over its minimum at which `auto` switches to volume control
OPENING_STEP = 0.05  # relative to the first step tried: a seal that opens in a longer one is approached in shorter ones
MIN_STEP_RATIO = 1e-3  # relative to the first step: shorter steps do not fix the cause of failure
MAX_GROWTH = 60.0  # cavity volumes at which a path under volume or arc-length control ends


@dataclasses.dataclass(frozen=True, eq=False)
class Continuation:
    """Continuation of a load path: its settings, which never change, and with ``history`` all that changes along the path.

    Args:
        solver: The device.
        quantity: What the requested values are of.
        control: What is followed, one of `CONTROLS`; "auto" follows what is requested, and the volume where it softens.
        largest_step: Longest step in units of the requested quantity, for a curve with enough points to draw.
        largest_growth: Cavity volumes at which a path to a pressure is given up.
        start: Where the path begins; the undeformed state if None.
        report: Takes sentences on what is going on.
        release: Whether a device that is lost is released, to go on from where it comes to rest; see `come_to_rest`.
    """

    solver: Solver
    quantity: PathQuantity = dataclasses.field(default_factory=Pressure)
    control: str = "auto"
    largest_step: float = math.inf
    largest_growth: float = MAX_GROWTH
    start: State | None = None
    report: Callable[[str], None] = lambda text: None
    release: bool = False
    history: PathHistory = dataclasses.field(default_factory=lambda: PathHistory())

    def __post_init__(self) -> None:
        if self.control not in CONTROLS:
            raise ValueError(f"control {self.control!r} is not one of {', '.join(CONTROLS)}")

    def begin(self) -> Point:
        """Return the path's first point; sets the scales of the plane in which arc lengths are measured."""
        solver, history = self.solver, self.history
        rest = solver.system.rest()
        V_scale = float(np.abs(solver.system.coupling.shares) @ solver.system.scales())
        start = rest if self.start is None else self.start
        solver.system.potential.commit(start.w, reset=self.start is None)
        stability = self.stability  # before factorising, because making the mass matrix takes memory
        moves = solver.system.potential.motion is not None
        if moves:
            tangent = at_once(start)
        else:
            solver.factorise(start)
            tangent = solver.tangent(start, controls.Control(1 / V_scale, 1.0, 0.0), tight(solver))
        history.V0, history.plane = start.V, ArcLengthMetric.of(V_scale, tangent.compliance)
        history.requested = requested = self.quantity.counted(start.V, rest.V)
        known = (Pressure(), AddedVolume(rest.V), ArcLength(self.plane), requested)
        history.parameters = {parameter.name: parameter for parameter in known}
        history.points, history.modes, history.line = [], [], self.first_line
        history.limit, history.turn, history.level = None, None, math.nan
        if not requested.starts_forward(start, tangent):  # the path starts at an unstable state
            tangent = -tangent
        stability.start()
        signature = Signature() if moves else stability.signature(exact=True)
        step, stiffest = self.first_step, self.plane.felt(tangent.compliance)
        first = Point(start, tangent, False, False, step, history.line, stiffest, signature)
        return self.commit(first)

    def resume(self, points: Sequence[Point], replay: Callable[[], None]) -> None:
        """Go on from points of an earlier trace, in order: bifurcations, and behind others the last one or two that were
        solved for; ``replay`` restores the histories there. Of their tangents the changes of P and V count, the rest is found
        again; so is the last state, from what was stored of it."""
        self.begin()
        replay()
        self.history.limit = next((point for point in points if point.limit), None)
        for point in points:
            self.history.pass_limits(point, self.value(point.state), rising=False)
        landed = max((k for k, point in enumerate(points) if point.jump), default=0)
        points = points[landed:]  # what lies before a jump predicts nothing behind it
        solver, history, stability = self.solver, self.history, self.stability
        history.modes = [Mode(stability.mass, point.mode) for point in points if point.mode is not None]
        last = [point for point in points if point.mode is None][-2:]
        history.line = last[-1].line
        lines = [self.plane.stiffened(p.stiffest).square_to(p.tangent, p.state) for p in last]
        solved = solver.solve(lines[-1], last[-1].state.w, last[-1].state.P)
        last[-1] = dataclasses.replace(last[-1], state=dataclasses.replace(last[-1].state, w=solved.w))
        solver.factorise(last[-1].state)
        stability.lowest()
        eigenvalues = (abs(point.signature.lowest) for point in points)
        stability.largest = max([stability.largest, *(value for value in eigenvalues if math.isfinite(value))])
        history.points = [
            dataclasses.replace(p, tangent=solver.tangent(p.state, line)) for p, line in zip(last, lines, strict=True)
        ]

    def commit(self, point: Point) -> Point:
        """Make a point the last one, which friction and silicone remember."""
        self.accept(point.state)
        return self.history.add(point)

    def accept(self, state: State) -> None:
        """Let friction and silicone remember a state, and carry the derivatives at its requested value to it."""
        if self.solver.carried is not None:
            line = self.requested.curve(self.value(state)).line(state.V, state.P)
            self.solver.carried.carry(state, line)
        self.solver.system.potential.commit(state.w)

    @property
    def stability(self) -> Stability:
        return Stability.of(self.solver)

    @functools.cached_property
    def corrector(self) -> Corrector:
        """What finds its states, once it has begun."""
        return Corrector(self.solver, self.history)

    @property
    def requested(self) -> PathQuantity:
        """The requested quantity, counted from the path's beginning."""
        return self.history.requested

    @property
    def plane(self) -> ArcLengthMetric:
        return self.history.plane

    @property
    def last(self) -> Point:
        return self.history.last

    @property
    def first_line(self) -> str:
        """Name of what a path follows where it begins."""
        return self.quantity.name if self.control == "auto" else self.control

    @property
    def followed(self) -> ContinuationParameter:
        return self.history.parameters[self.history.line]

    @property
    def direct(self) -> bool:
        """Whether the requested quantity is the control itself, so that the path stops exactly at its values."""
        return self.followed is self.requested

    @property
    def first_step(self) -> float:
        """Length of the first step in the control."""
        return self.followed.first_step(self.plane, self.history.V0)

    def value(self, state: State) -> float:
        """Return the requested quantity at a state."""
        return self.requested.value(state.V, state.P)

    def between(self, before: Point, after: Point, value: float) -> Point:
        """Return the point with a requested value that lies between two points."""
        return self.corrector.between(self.requested, before, after, value)

    def stops(self, step: float, goals: Sequence[float] = ()) -> tuple[list[Point], PathEnd | None]:
        """Take a step towards the first of the requested values ``goals``, shortened until all that lies on it is located.

        Args:
            step: Its length.
            goals: Requested values ahead, rising; none if the path is followed as far as it leads.

        Returns:
            Points on the step, in order: limit points, bifurcations, requested values, where the device lands, and the step's
            end unless a last requested value lies before it; and what ends the path there, if a seal opens.

        Raises:
            PathEnd: Not even the shortest step succeeded.
        """
        before = self.last
        while True:
            after, end = self.advance(step, goals[0] if goals else math.inf), None
            if leak := self.opened(before, after):
                after, end = leak
            try:
                points = [*events(self.corrector, self.requested, before, after, self.report), after]
                return self._with_values(before, points, goals), end
            except newton.NoConvergence as failure:
                what = f"what lies on a step of at most {step:.3g}"
                self.report(f"{what} was not located ({failure}); halving the step")
                step = min(step, self._longest()) / 2
                if step < MIN_STEP_RATIO * self.first_step:
                    why = "a limit point or a requested value on the way was not located"
                    raise failed_path(self.corrector, self.requested, why, failure) from failure

    def _with_values(self, here: Point, stops: list[Point], goals: Sequence[float]) -> list[Point]:
        """Return the points of a step with those where the device lands and has requested values, up to the last value; the
        rest is as for `stops`."""
        points, left, level = list[Point](), list(goals), self.history.level
        for stop in stops:
            if self.value(here.state) < level <= self.value(stop.state):
                # A real device snaps through from the limit point of the requested quantity to here.
                here, level = dataclasses.replace(self.between(here, stop, level), requested=False, jump=True), math.nan
                points.append(here)
            # Under its own control the path stops at a value; under another it has to locate those that it passed.
            while left and not self.direct and self.value(here.state) < left[0] <= self.value(stop.state):
                here = self.between(here, stop, left.pop(0))
                points.append(here)
                if not left:
                    return points
            here, level = stop, self.value(stop.state) if stop.turn else level
            points.append(here)
        return points

    def _open_terms(self, state: State) -> list[component.EnergyTerm]:
        """Return the terms whose seal is open at a state with a pressure."""
        system = self.solver.system
        if not system.body.seal:
            return []
        system.load(state)
        return [term for term in system.potential.terms.values() if system.pressures[0] and term.margin(system) <= 0.0]

    def opened(self, before: Point, after: Point) -> tuple[Point, PathEnd] | None:
        """Return where a seal opens between two neighbouring points, and the end of the path there; None if it does not."""
        system = self.solver.system
        for term in self._open_terms(after.state):

            def margin(point: Point, term: component.EnergyTerm = term) -> float:
                system.load(point.state)
                return term.margin(system)

            state = self.corrector.root(before, after, margin, 1e-9) if margin(before) > 0.0 else before.state
            system.load(state)
            end = PathEnd("a seal opens", cause=term.opened(system))
            return dataclasses.replace(self.corrector.point(state), requested=False), end
        return None

    def at(self, state: State) -> Point:
        """Return the point of a state that no other leads to; the tangent there is factorised."""
        self.solver.factorise(state)
        tangent = self.solver.tangent(state, controls.Control(1 / self.plane.V_scale, 1.0, 0.0))
        if not self.requested.starts_forward(state, tangent):
            tangent = -tangent
        stiffest = min(self.last.stiffest, self.plane.felt(tangent.compliance))
        signature = self.stability.signature(exact=True)
        return Point(state, tangent, False, False, self.first_step, self.history.line, stiffest, signature)

    def ahead(self, value: float) -> float:
        """Return how far beyond a requested value, at which it is lost, a device is released: ten times as far as the last time
        where it has come less far since then, else a tenth."""
        unit, history = self.requested.first_step(self.plane, self.history.V0), self.history
        slow = abs(value - history.released_at) < 10.0 * history.ahead * unit
        history.released_at = value
        history.ahead = 10.0 * history.ahead if slow else max(history.ahead / 10.0, MIN_RELEASE)
        return history.ahead * unit

    def release_device(self, goal: float, end: PathEnd) -> Point:
        """Let the device go at its last point, where the path was lost for a reason; return where it comes to rest.

        Raises:
            PathEnd: It does not; the reason stays, but where it collapses or crumples.
        """
        last = self.last
        value = self.value(last.state)
        value = min(value + self.ahead(value), goal)
        state = come_to_rest(self, self.requested.curve(value), last.state, end.cause.clause if end.cause else str(end))
        if state is None:
            raise end
        self.history.line = self.first_line
        landed = self.at(self.requested.exactly(state, value))
        return dataclasses.replace(landed, requested=value == goal, jump=True)

    def ended(self, end: PathEnd) -> PathEnd:
        """Return the end of the path, with the limit point of the requested quantity."""
        limit = self.requested.limit_met(self.history.limit, self.history.turn)
        return PathEnd(str(end), limit, end.cause if limit is None else None)

    def advance(self, step: float, goal: float) -> Point:
        """Take a step towards the requested value ``goal``, shortened until it converges; `PathEnd` if not even the shortest
        one did."""
        direct = self.direct
        begun = step = min(step, self._longest())
        left = goal - self.value(self.last.state)
        while True:
            hit = direct and left <= step * (1 + 1e-9)
            # Equal parts of the remainder avoid a tiny step before a requested value.
            share = left if hit else left / math.ceil(left / step - 1e-9) if direct and left < 3 * step else step
            try:
                point = self._stepped(share, goal if hit else None, step)
                closest = max(OPENING_STEP * begun, 2 * MIN_STEP_RATIO * self.first_step)
                if share > closest and self._open_terms(point.state):
                    raise newton.NoConvergence("a seal opens")  # perhaps only because its place was that of the last state
                return point
            except newton.NoConvergence as failure:
                self.report(f"no convergence with step {share:.3g} ({failure}); halving the step")
                step = share / 2
                shortest = MIN_STEP_RATIO * self.first_step
                if self.may_follow_volume and direct and step < max(0.02 * self.last.step, shortest):
                    self.follow(AddedVolume.name)  # which passes a limit point: that distinguishes it from a failure
                    step, direct = self.last.step, False
                elif step < shortest:
                    why = "no step converged, down to a thousandth of the first one"
                    raise failed_path(self.corrector, self.requested, why, failure) from failure

    def _stepped(self, share: float, goal: float | None, step: float) -> Point:
        """Return the point a ``share`` ahead, or at the value ``goal`` if given; `NoConvergence` if this branch has none."""
        last = self.last
        line = self.followed.ahead(last.state, last.tangent, share) if goal is None else self.requested.curve(goal)
        state = self.corrector.solve(line, self.history.points)
        self.corrector.check_branch(state, line)
        state = state if goal is None else self.requested.exactly(state, goal)
        count = state.iterations - self.solver.system.assembled.slack
        change = STEP_GROWTH if count <= FAST_ITERATIONS else 1.0 if count < SLOW_ITERATIONS else 0.6
        following = max(step, share) * change if change > 1 else share * change
        point = self.corrector.point(state, requested=goal is not None, step=following)
        self.corrector.check_work(point)
        return point

    def _longest(self) -> float:
        s, t = self.last.state, self.last.tangent
        per, along = self.requested.rate(s, t), self.followed.rate(s, t)
        return self.largest_step * abs(along / per) if per else math.inf

    def choose(self) -> None:
        """Under ``auto``, control the requested quantity while the device is stiff, and the volume where it softens."""
        if self.control != "auto" or self.by_volume or self.last_limit is not None:
            return
        s, t = self.last.state, self.last.tangent
        a, b = self.requested.slopes(s.V, s.P)
        stiffest = (a + b / self.last.stiffest) * t.V
        softened = a * t.V + b * t.P  # the same here; both are the derivative of the quantity by the volume
        if self.direct and not stiffest < VOLUME_CONTROL_SOFTENING * softened:
            self.follow(AddedVolume.name)
        elif self.history.line == AddedVolume.name and stiffest < VOLUME_CONTROL_SOFTENING / 2 * softened:
            self.follow(self.requested.name)

    def follow(self, line: str) -> None:
        """Switch the control, by its name, with a step of about the same length."""
        if line == self.history.line:
            return
        self.report(f"control switched to {line}")
        s, t, now, new = self.last.state, self.last.tangent, self.followed, self.history.parameters[line]
        step = abs(self.last.step * new.rate(s, t) / now.rate(s, t))
        self.history.line, step = line, min(step, new.largest_step(s, self.plane))
        self.history.points[-1] = dataclasses.replace(self.last, step=step, line=line)

    @property
    def by_volume(self) -> bool:
        """Whether volumes are requested, which exist beyond every limit point of the pressure."""
        return isinstance(self.requested, AddedVolume)

    @property
    def may_follow_volume(self) -> bool:
        """Whether volume control may be used if no step in the requested quantity converges."""
        return self.control in ("auto", Pressure.name) and not self.by_volume

    @property
    def last_limit(self) -> Point | None:
        """The limit point of the pressure that has been passed, if it ends the path: no state has a higher pressure."""
        return self.history.limit if self.may_follow_volume and self.requested.ends_at_pressure_limit else None


PAST_LIMIT = 0.1  # how far `auto` continues past a limit point, relative to the volume added up to it


def trace(
    path: Continuation,
    goals: Sequence[float],
    start: Sequence[Point] = (),
    replay: Callable[[], None] = lambda: None,
) -> Iterator[Point]:
    """Follow a device through the requested values, in rising order, and yield every point of the path.

    Args:
        path: What to follow, and how.
        goals: Requested values (dimensionless), rising, none below 0.
        start: The last points of an interrupted trace, to go on from; goals at or below them are taken as done.
        replay: Restores the histories at these points; see `Continuation.resume`.

    Yields:
        Points along the path; those requested are marked, and so are limit points.

    Raises:
        PathEnd: A requested value is not on this path.
    """
    left = list(goals)
    if start:
        path.resume(start, replay)
        done = path.value(path.last.state)
        left = [goal for goal in left if goal > done * (1 + 1e-12)]
    else:
        first = path.begin()
        requested = bool(left) and left[0] == 0.0
        yield dataclasses.replace(first, requested=requested)
        by_volume = any(isinstance(quantity, AddedVolume) for quantity in (path.requested, path.followed))
        if by_volume and first.stiffest <= path.plane.felt(0.0):
            raise PathEnd("the supports prevent any change", cause=DEVICE_LOCKED)
        left = left[1:] if requested else left
    history = path.history
    while left:
        _check_end(path)
        path.choose()
        before = path.last
        step = before.step
        if path.last_limit is not None:
            step = min(step, PAST_LIMIT / 2 * (path.last_limit.state.V - history.V0))
        try:
            stops, leak = path.stops(step, left)
        except PathEnd as lost_there:
            end = path.ended(lost_there)
            if not (path.release and end.snaps):
                raise end from lost_there
            stops, leak = [path.release_device(left[0], end)], None
        for stop in stops:
            if stop.mode is not None:
                # Interpolated, and K is singular: not used to predict the next state.
                path.history.modes.append(Mode(path.stability.mass, stop.mode))
                yield stop
                continue
            here = path.commit(dataclasses.replace(stop, step=stops[-1].step))
            history.pass_limits(here, path.value(here.state), rising=before.tangent.P > 0)
            yield here
        left = left[sum(stop.requested for stop in stops) :]
        if leak and left:
            raise leak


def _check_end(path: Continuation) -> None:
    """Raise `PathEnd` if the path is far enough past its limit point, or has grown too large."""
    added = path.last.state.V - path.history.V0
    limit = path.last_limit
    if limit is not None and added > (1 + PAST_LIMIT) * (limit.state.V - path.history.V0):
        raise PathEnd("the pressure has a limit point", limit)
    if not path.by_volume and added > path.largest_growth * path.plane.V_scale:
        why = f"the cavity has grown {path.largest_growth:g}-fold without reaching the requested value"
        raise path.ended(PathEnd(why))


# ----------------------------------------------------------------------------------------------------------------------
# Predictor of the continuation: the next state and the tangent there, from the last points and their tangents.


MAX_PREDICTION_RATIO = 3.0
"""Maximum prediction distance, in distances between the last two points, for the cubic rather than the last tangent."""
MIN_RELATIVE_DISTANCE = 1e-2
"""Minimum distance of a new state for predicting the tangent; closer, its change is rounding."""


def predict(points: Sequence[Point], line: controls.Curve) -> tuple[Array, float]:
    """Guess (w, P) on a line from one point and its tangent, or from the cubic through two. The parameter is the line's own
    left side; beyond a point where that turns, only the tangent is used.

    Raises:
        NoConvergence: The path runs along the line.
    """
    places, rates = _along(points, line)
    if 0.0 in rates:
        raise newton.NoConvergence("the path runs along the control's line")
    if not _agree(places, rates, line.target):
        points, places, rates = points[-1:], places[-1:], rates[-1:]
    values, slopes = _weights(places, line.target)[0]
    return _sum(points, values, slopes / rates)


def predict_direction(
    points: Sequence[Point], state: State, line: controls.Curve, creeping: bool = False
) -> controls.Tangent | None:
    """Predict the tangent at a state beyond the last points, per unit of a line's left side; None if not possible.

    It is that of the polynomial through the points, their tangents and the state itself. Where silicone creeps between the
    states they do not follow their tangents, which alone are then extrapolated.
    """
    if not points:
        return None
    places, rates = _along(points, line)
    here = line.value(state.V, state.P)
    if not _agree(places, rates, here):
        points, places, rates = points[-1:], places[-1:], rates[-1:]
    if creeping and rates[-1] > 0.0:
        beyond = (here - places[-1]) / (places[-1] - places[0]) if len(places) > 1 else 0.0
        weights = np.array([-beyond, 1.0 + beyond])[-len(places) :]
        return controls.Tangent(*_sum(points, 0.0 * places, weights / rates), 0.0)
    shortest = MIN_RELATIVE_DISTANCE * abs(places[-1] - places[0])
    if rates[-1] <= 0.0 or here - places[-1] <= shortest:
        return None
    (values, slopes), (value_rates, slope_rates) = _weights(places, here)
    # The state adds to the polynomial p through the points w - p times a product of squares, of (t - place) / (here - place)
    # for each point. That is 1 here, and this is its slope.
    own = 2.0 * float(np.sum(1.0 / (here - places)))
    w, P = _sum(points, value_rates - own * values, (slope_rates - own * slopes) / rates)
    return controls.Tangent(w + own * state.w, P + own * state.P, 0.0)


def _along(points: Sequence[Point], line: controls.Curve) -> tuple[Array, Array]:
    """Return a line's left side at points, and its rates along their tangents."""
    slopes = np.array([line.slopes(p.state.V, p.state.P) for p in points])
    rates = np.einsum("pi,pi->p", slopes, [(p.tangent.V, p.tangent.P) for p in points])
    return np.array([line.value(p.state.V, p.state.P) for p in points]), rates


def _agree(places: Array, rates: Array, at: float) -> bool:
    """Return whether two points agree in their predictions."""
    if len(places) < 2 or rates[0] * rates[1] <= 0.0:
        return False
    apart = places[1] - places[0]
    return bool(apart != 0.0 and abs(at - places[1]) <= MAX_PREDICTION_RATIO * abs(apart))


def _weights(places: Array, at: float) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Return the weights of values and slopes at one or two places in the interpolating polynomial at another, and
    their rates."""
    if len(places) == 1:
        ones = np.ones(1)
        return (ones, ones * (at - places[0])), (0.0 * ones, ones)
    h = places[1] - places[0]
    x = (at - places[0]) / h
    values = np.array([(1 + 2 * x) * (1 - x) ** 2, x * x * (3 - 2 * x)])
    slopes = h * np.array([x * (1 - x) ** 2, x * x * (x - 1)])
    rate = 6 * x * (1 - x) / h
    return (values, slopes), (np.array([-rate, rate]), np.array([(1 - x) * (1 - 3 * x), x * (3 * x - 2)]))


def _sum(points: Sequence[Point], values: Array, slopes: Array) -> tuple[Array, float]:
    w, P = np.zeros_like(points[0].state.w), 0.0
    for p, value, slope in zip(points, map(float, values), map(float, slopes), strict=True):
        w += value * p.state.w
        w += slope * p.tangent.w
        P += value * p.state.P + slope * p.tangent.P
    return w, P


# ----------------------------------------------------------------------------------------------------------------------
# The end of a path: its last two points, from which the next is predicted.

MIN_RELEASE = 0.01
"""How far beyond the last state a device is released at least, in first steps."""


@dataclasses.dataclass
class PathHistory:
    """All that changes along a path.

    Attributes:
        points: The last one or two, in order.
        modes: Those of the bifurcations that the path has passed: a state with much of one lies on another branch.
        line: Name of what the path follows.
        limit, turn: The first limit point of the pressure passed so far, and the last one of the requested quantity itself.
        level: The value at that one if the path has not come to where the device lands yet, else nan.
        snaps: How often the device has been released.
        released_at, ahead: The value at which it was released last, and how far beyond it, in first steps.
        V0, plane: Set where the path begins: the volume there, and the scales of arc lengths.
        requested, parameters: Set there too: the requested quantity, and what may be followed, by name.
    """

    points: list[Point] = dataclasses.field(default_factory=list)
    modes: list[Mode] = dataclasses.field(default_factory=list)
    line: str = ""
    limit: Point | None = None
    turn: Point | None = None
    level: float = math.nan
    snaps: int = 0
    released_at: float = math.inf
    ahead: float = MIN_RELEASE
    V0: float = dataclasses.field(init=False)
    plane: ArcLengthMetric = dataclasses.field(init=False)
    requested: PathQuantity = dataclasses.field(init=False)
    parameters: dict[str, ContinuationParameter] = dataclasses.field(init=False)

    @property
    def last(self) -> Point:
        return self.points[-1]

    def add(self, point: Point) -> Point:
        """Make a point the last one; what lies before a jump predicts nothing behind it."""
        if point.jump:
            self.points, self.modes = [], []
        self.points = [*self.points[-1:], point]
        return point

    def pass_limits(self, point: Point, value: float, rising: bool) -> None:
        """Pass a point with a value of the requested quantity, on a step that begins at a rising pressure or not."""
        if self.limit is None and point.limit and rising:
            self.limit = point
        if point.turn:
            self.turn, self.level = point, value
        elif not value < self.level:
            self.level = math.nan


# ----------------------------------------------------------------------------------------------------------------------
# Corrector of the continuation: solve for states on a control's curve from the predictor, and between two points.


MAX_MODE_SHARE = 0.5
"""Amplitude of a bifurcation's mode in the predictor's error, relative to the step, above which the state is on another
branch."""
MAX_TRAVEL_RATIO = 4.0
"""Maximum travel of a dead load in one step, relative to the predicted one."""
MAX_MISSING_WORK, ENERGY_ROUNDING = 0.25, 1e-9
"""Share of a step's work that may be missing in the stored energy, and rounding of that energy."""
MAX_CUBIC_SLOPE = 3.0
"""Slope at the ends of a cubic, over its chord's, up to which it rises throughout (Fritsch and Carlson 1980, doi
10.1137/0717021)."""
MAX_SECANTS = 25
"""Maximum secant iterations to locate a value between two points."""
MIN_DIRECTION_COSINE = 0.9
"""Cosine between a motion and a tangent from which the motion is along the path."""


def tight(solver: Solver) -> float:
    """Return the tolerance of tangents that decide more than where to look for the next state: the first one, whose compliance
    is the scale of all arc lengths (every step ends where that leads), those by which a limit point is located, and the one
    there, which is K's null vector: the limit pressure's derivatives come from it. A multigrid cycle's residual says less."""
    return 1e-10 if solver.bordered.inverse.exact else 1e-11


def at_once(state: State) -> controls.Tangent:
    """Return the direction of a device with mass at a state: in no time the air's pressure changes, but no volume."""
    return controls.Tangent(np.zeros_like(state.w), 1.0, 0.0)


class CavityCollapsed(newton.NoConvergence):
    """A cavity has negative volume: its walls have passed through each other."""


@dataclasses.dataclass(frozen=True, eq=False)
class LoadedState:
    """A state with its loads, dimensionless: magnitudes of all drivers there and what they work on, shape (k,), and the stored
    energy; ``number`` counts the program's steps up to it."""

    state: State
    drives: Array
    driven: Array
    energy: float = math.nan
    number: int = 0

    @classmethod
    def at(cls, system: System, state: State, number: int = 0) -> LoadedState:
        system.load(state)
        return cls(state, system.drives_at(state), system.driven(), system.stored_energy(), number)


class Corrector:
    """Newton's method along a path, from its last points."""

    def __init__(self, solver: Solver, history: PathHistory):
        self.solver, self.history, self.stability = solver, history, Stability.of(solver)
        self._loaded: LoadedState | None = None

    @property
    def plane(self) -> ArcLengthMetric:
        return self.history.plane

    def tangent(self, state: State, tolerance: float = TANGENT_TOLERANCE) -> controls.Tangent:
        """Return the tangent at a state, oriented forwards; scaled along the last direction, so it is regular at
        limit points."""
        if not self.history.points:
            return self.solver.tangent(state, controls.Control(1 / self.plane.V_scale, 1.0, 0.0), tolerance)
        last = self.history.last
        line = self.plane.stiffened(last.stiffest).square_to(last.tangent, last.state)
        # If nothing moves, a guess would consist of rounding errors, so solve without one.
        locked = self.plane.locked(last.tangent.compliance)
        creeping = bool(self.solver.system.potential.histories)
        guess = None if locked else predict_direction(self.history.points, state, line, creeping)
        tangent = self.solver.tangent(state, line, tolerance, guess)
        if locked or creeping or self.solver.system.direction > 0:
            return tangent
        return -tangent if self._turns_back(state, tangent) else tangent

    def _turns_back(self, state: State, tangent: controls.Tangent) -> bool:
        """Return whether a tangent clearly leads back the way that the whole device has come.

        Where a shell snaps back, pressure and volume turn back at nearly the same state: their plane shows a cusp, and orients
        the tangent wrongly. Motions from one branch to another, or back to where an event is located, are not along the path.
        """
        step = state.w - self.history.last.state.w
        if not mpi.largest(self.solver.system.comm, float(np.abs(step).max(initial=0.0))):
            return False
        motion = Mode(self.stability.mass, step)

        def cosine(w: Array) -> float:
            size = motion.size(w)
            return motion.share(w) / size if size > 0.0 else 0.0

        return cosine(tangent.w) < -MIN_DIRECTION_COSINE and cosine(self.history.last.tangent.w) > MIN_DIRECTION_COSINE

    def solve(self, line: controls.Curve, around: Sequence[Point]) -> State:
        """Return the state on a line, guessed by the cubic through one or two points and their tangents. Past a bifurcation
        there are several: one with much more or less of the mode than predicted lies on another branch.

        Raises:
            NoConvergence: There is none, or it lies on another branch.
        """
        w, P = predict(around, line)
        state = self.solve_from(line, w, P, around[-1].state)
        for mode in self.history.modes:
            if abs(mode.share(state.w - w)) > MAX_MODE_SHARE * mode.size(w - around[-1].state.w):
                raise newton.NoConvergence("Newton converged to another branch")
        return state

    def solve_from(self, line: controls.Curve, w: Array, P: float, last: State) -> State:
        """Return the state on a line from a guess, and from the last state too where stiff sheets or fibres prevent that."""
        motion = self.solver.system.potential.motion
        w = motion.predicted(w) if motion else w
        try:
            return self.solver.solve(line, w, P)
        except newton.NoConvergence:
            if not self.solver.system.potential.predicted_stiffness:
                raise
            try:
                return self.solver.solve(line, w, P, since=last.w)
            except newton.NoConvergence:
                return self.solver.solve(line, last.w, last.P, since=last.w)

    def point(self, state: State, requested: bool = False, limit: bool = False, step: float | None = None) -> Point:
        """Return the point of a state near the last one, with tangent and signature, factorised if these need it, and with the
        last point's ``step`` if None is given."""
        solver, last = self.solver, self.history.last
        if solver.system.potential.motion:
            return dataclasses.replace(last, state=state, tangent=at_once(state), requested=requested)
        stale = solver.lagged.needs_update
        # At a limit point K is singular: no usable preconditioner, and a signature of rounding errors.
        stale = (stale or self.stability.wants(state)) and not (limit and solver.bordered.factorisations)
        if stale:
            solver.factorise(state)
        tangent, before = self.tangent(state, tight(solver) if limit else TANGENT_TOLERANCE), last.tangent
        if limit:
            # The sign of the pressure's rate is rounding there; like the signature, take it from the state before.
            tangent = dataclasses.replace(tangent, P=math.copysign(tangent.P, before.P))
        turned = before.P * tangent.P < 0 or before.V * tangent.V < 0
        negative = last.signature.negative_eigenvalues
        if (turned or negative) and not stale and not limit:
            stale = True
            solver.factorise(state)
        step = last.step if step is None else step
        stiffest = min(last.stiffest, self.plane.felt(tangent.compliance))
        if limit:
            signature = Signature(negative, self.stability.critical_lowest(state, negative))
        else:
            signature = self.stability.signature(stale, negative)
        return Point(state, tangent, requested, limit, step, self.history.line, stiffest, signature)

    def check_whole(self, state: State, since: State | None = None) -> None:
        """Reject a converged state that is inverted, or behind a wall as seen from another one, by default the last; see
        `check_branch`."""
        system = self.solver.system
        if (system.volumes() <= 0.0).any():
            raise CavityCollapsed("a cavity would collapse to zero volume")
        if not system.potential.is_admissible((since or self.history.last.state).w, state.w):
            raise newton.NoConvergence("a wall passed through an obstacle")

    def check_branch(self, state: State, line: controls.Curve) -> None:
        """Reject a converged state on the wrong branch: behind the last one, inverted, or through a wall.

        A dead load's magnitude may be given beyond a limit point and met again far behind it, on a part that stiffens.

        Raises:
            NoConvergence: It lies there.
            Emptied: A cavity's walls have passed through each other, which no short step mends.
        """
        s, t = self.history.last.state, self.history.last.tangent
        system, plane = self.solver.system, self.plane.stiffened(self.history.last.stiffest)
        self.check_whole(state)
        if plane.product((state.V - s.V, state.P - s.P), (t.V, t.P)) <= 0.0:
            raise newton.NoConvergence("Newton converged to another branch")
        if not (line.needs_volume or system.drives_cavities):
            predicted = t.V * (state.P - s.P) / t.P if t.P else math.inf
            if abs(state.V - s.V) > MAX_TRAVEL_RATIO * abs(predicted):
                raise newton.NoConvergence("the travel was too large for one step")

    def check_work(self, point: Point) -> None:
        """Reject a point whose stored energy has not grown from the last one by the work done: on a curve of equilibrium states
        it does (the cubic through both and their tangents is taken for the curve), and a leap to another part of the curve, or
        to another curve, loses some. A short step follows the curve, or finds that it leads elsewhere.

        Raises:
            NoConvergence: It lost some.
        """
        system, last = self.solver.system, self.history.last
        if system.potential.remembers or system.body.seal:
            return
        known = self._loaded
        before = known if known is not None and known.state is last.state else LoadedState.at(system, last.state)
        after = self._loaded = LoadedState.at(system, point.state)
        moved, gained = after.driven - before.driven, after.energy - before.energy
        chord = 0.5 * float((before.drives + after.drives) @ moved)
        scale = 0.5 * float((np.abs(before.drives) + np.abs(after.drives)) @ np.abs(moved))
        scale = max(scale, abs(gained), ENERGY_ROUNDING * max(abs(after.energy), self.plane.V_scale))
        missing = [abs(gained - chord - bulge) for bulge in self._bulges(last, point)]
        if missing and min(missing) > MAX_MISSING_WORK * scale:
            raise newton.NoConvergence("the stored energy has not changed by the work done: the state has leapt")

    def _bulges(self, before: Point, after: Point) -> list[float]:
        """Return the areas between a curve through two points in the volume-pressure plane and its chord: of the pressure as a
        cubic of the volume, and of the volume as one of the pressure, where it can be that and the cubic does not turn back."""
        s, t, a, b = before.state, after.state, before.tangent, after.tangent
        dV, dP, bulges = t.V - s.V, t.P - s.P, []
        if dV * a.V > 0.0 and dV * b.V > 0.0:
            bulges.append(dV**2 * (a.P / a.V - b.P / b.V) / 12)
        if dP * a.P > 0.0 and dP * b.P > 0.0 and max(abs(a.V / a.P), abs(b.V / b.P)) * abs(dP) <= MAX_CUBIC_SLOPE * abs(dV):
            bulges.append(dP**2 * (b.V / b.P - a.V / a.P) / 12)
        return bulges

    # -- between two points -------------------------------------------------------------------------------------------

    def between(self, quantity: PathQuantity, before: Point, after: Point, value: float) -> Point:
        """Return the point between two others at which a quantity has a value."""
        try:
            state = self.solve(quantity.curve(value), (before, after))
            low, high = sorted((before.state.V, after.state.V))
            margin = 1e-6 * (high - low)
            if not low - margin <= state.V <= high + margin:
                raise newton.NoConvergence("another branch")
        except newton.NoConvergence:
            state = self.root(before, after, lambda p: quantity.value(p.state.V, p.state.P) - value)
        return self.point(quantity.exactly(state, value), requested=True)

    def on_the_way(self, before: Point, after: Point, share: float) -> Point:
        """Return a point between two, ``share`` of the way in volume."""
        a, b = before.state, after.state
        state = self.solve(controls.volume_control(a.V + share * (b.V - a.V)), (before, after))
        return dataclasses.replace(after, state=state, tangent=self.tangent(state), requested=False)

    def interpolated(self, before: Point, after: Point, share: float) -> Point:
        """Return a point between two close ones, interpolated rather than solved."""
        a, b = before.state, after.state
        line = controls.volume_control(a.V + share * (b.V - a.V))
        w, P = predict((before, after), line)
        v, r = before.tangent, after.tangent
        tangent = controls.Tangent(
            (1 - share) * v.w + share * r.w, (1 - share) * v.P + share * r.P, (1 - share) * v.V + share * r.V
        )
        return dataclasses.replace(after, state=State(w, P, line.target), tangent=tangent)

    def middle(self, before: Point, after: Point) -> Point:
        """Return the point half way between two, with its signature."""
        middle = self.on_the_way(before, after, 0.5)
        self.solver.factorise(middle.state)
        signature, tangent = self.stability.signature(exact=True), self.tangent(middle.state)
        return dataclasses.replace(middle, tangent=tangent, limit=False, signature=signature)

    def root(self, low: Point, high: Point, f: Callable[[Point], float], tolerance: float = 1e-9) -> State:
        """Return the root of f between two points by the Illinois variant of the secant, on lines of given volume.

        Each value is a solve, started from the bracket's own two points, which a root finder for plain numbers does not know;
        and it ends as soon as f is small beside its ends, by the tolerance.
        """
        f_low, f_high = f(low), f(high)
        scale = max(abs(f_low), abs(f_high))
        best, side = low, 0
        for _ in range(MAX_SECANTS):
            V = (low.state.V * f_high - high.state.V * f_low) / (f_high - f_low)
            state = self.solve(controls.volume_control(V), (low, high))
            best = dataclasses.replace(high, state=state, tangent=self.tangent(state, tight(self.solver)))
            value = f(best)
            if abs(value) <= tolerance * scale or abs(high.state.V - low.state.V) <= 1e-9 * self.plane.V_scale:
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


# ----------------------------------------------------------------------------------------------------------------------
# Physical ends of a path besides limit points: no equilibrium exists beyond them.


CAVITY_COLLAPSES = component.PathFailure(
    "a cavity collapses to zero volume, so that its walls would pass through each other",
    "Reduce the load, or use a stiffer silicone or thicker walls; where the cavity's walls are not in contact yet, enable that "
    "([walls] with faces = 'cavity')",
)
DEVICE_LOCKED = component.PathFailure(
    "the requested volume or travel cannot change at any pressure or force: the supports prevent any change",
    "Support less of the device; a fully supported cavity in incompressible silicone (poisson = 0.5) keeps its volume "
    "and takes only a pressure",
)
DEVICE_SNAPS_BACK = component.PathFailure(
    "the device snaps back: pressures and forces have a limit point, and their volumes and travels turn "
    "back there too, so neither can be raised further",
    "Stay below, or remove the cause of the snap-back",
    snaps=True,
)


# ----------------------------------------------------------------------------------------------------------------------
# Diagnose a path on which no step converges: the device is locked, snaps back, or fails locally.
#
# Pressure and volume may both turn back at once, if a small part of the device snaps with little change of volume. Then no line
# in their plane leads further, however short the step. The states beyond are found by prescribing the motion of that
# part, which is regular there, as near a bifurcation (`Branch`).


MAX_DIAGNOSIS_STATES = 24
"""Number of states computed beyond the last one."""
SNAP_STEP_GROWTH = 1.5
"""Growth factor from one step to the next."""
MAX_HALVINGS = 10
"""Reduction factor of a failed step."""
MAX_STEP_OVERSHOOT = 2.0
"""Step length relative to the predicted one above which Newton has converged to another branch."""
DIRECTION_TOLERANCE = 1e-10
"""Relative tolerance of the directions, whose local part may be a thousandth of the whole motion."""
DECREASES_PAST_TURN = 2
"""Consecutive decreases after which the requested quantity counts as turned back."""


def failed_path(corrector: Corrector, requested: PathQuantity, why: str, failure: newton.NoConvergence) -> PathEnd:
    """Return the end of a path that could not be continued from its last point, with its cause if that is physical; the path's
    factorisation is not kept."""
    return PathEnd(f"{why} ({failure})", cause=_cause_of(corrector, requested, failure))


def _cause_of(corrector: Corrector, requested: PathQuantity, failure: newton.NoConvergence) -> component.PathFailure | None:
    if isinstance(failure, CavityCollapsed):
        return CAVITY_COLLAPSES
    system = corrector.solver.system
    system.load(corrector.history.last.state)
    for term in system.potential.terms.values():
        if cause := term.breakdown(system):
            return cause
    try:
        part = snapping(corrector, requested)
    except newton.NoConvergence:
        part = None
    system.load(corrector.history.last.state)
    if part is None:
        return creases.find_crease(system)
    fold = creases.MotionConcentration(system, part)
    if not fold.local:
        return DEVICE_SNAPS_BACK
    system.load(corrector.history.last.state)
    return creases.find_crease(system, fold.part) or creases.fold_failure(fold.cells, *fold.place)


def snapping(corrector: Corrector, requested: PathQuantity) -> Array | None:
    """Return the snapping motion (local dofs) if the requested quantity turns back just beyond the last point, because the
    device loses its stability there; else None. The path's factorisation is not kept.

    Raises:
        NoConvergence: There are no states near beyond it.
    """
    last, points = corrector.history.last, corrector.history.points
    value = requested.value(last.state.V, last.state.P)
    if len(points) < 2 or not requested.rate(last.state, last.tangent) > 0.0:  # the first point has no predecessor
        return None
    ahead, fallen, unstable = StatesBeyond(corrector), 0, _unstable(requested, last)
    for _ in range(MAX_DIAGNOSIS_STATES):
        ahead.step()
        now = requested.value(ahead.state.V, ahead.state.P)
        fallen = fallen + 1 if now < value else 0
        value = now
        if fallen == DECREASES_PAST_TURN:
            # If Newton has only converged to another branch, no direction is unstable.
            corrector.solver.factorise(ahead.state)
            signature = corrector.stability.signature(exact=True)
            beyond = dataclasses.replace(last, state=ahead.state, tangent=ahead.tangent, signature=signature)
            return ahead.part if _unstable(requested, beyond) != unstable else None
    return None


def _unstable(requested: PathQuantity, point: Point) -> int:
    """Return the directions in which the energy falls at a constant requested quantity; see `Point.stable_under`."""
    return point.signature.negative_eigenvalues - int(requested.rate(point.state, point.tangent) * point.tangent.P < 0)


class StatesBeyond:
    """States beyond a path's last two points, controlled by the motion of the snapping part; `NoConvergence` if the path has
    no direction there.

    The whole device moves on as it did before, and turns back with pressure and volume. What the motion has beyond that is the
    part's: it grows without bound as the path nears the state where it snaps, and leads on through it. It may be so little
    beside the whole that no measure of the whole shows it. ``state`` is the last state found, ``tangent`` the direction of the
    path there, its dofs of unit length.
    """

    def __init__(self, corrector: Corrector):
        self.solver, self._mass = corrector.solver, corrector.stability.mass
        before, last = corrector.history.points
        self._whole = self._direction(before.state, self._measure(before.tangent.w))
        self.state, self.tangent = last.state, self._direction(last.state, self._measure(last.tangent.w))
        self._amount = abs(self._part().share(last.state.w - before.state.w))

    def step(self) -> None:
        """Solve for the next state; `NoConvergence` if there is none near."""
        state, rate, part = self.state, self.tangent, self._part()
        for _ in range(MAX_HALVINGS):
            far = self._amount / part.share(rate.w)
            try:
                beyond = self.solver.solve_along(
                    part.image, state.w, self._amount, state.w + far * rate.w, state.P + far * rate.P
                )
                near = self._measure(beyond.w - state.w).length < MAX_STEP_OVERSHOOT * far
                if near and (self.solver.system.volumes() > 0.0).all():
                    self.state, self.tangent = beyond, self._direction(beyond, part)
                    self._amount *= SNAP_STEP_GROWTH
                    return
            except newton.NoConvergence:
                pass
            self._amount /= 2
            self.solver.factorise(state)
        raise newton.NoConvergence("no nearby state beyond the last one")

    @property
    def part(self) -> Array:
        """The local part of the motion, local dofs."""
        whole, w = self._measure(self._whole.w), self.tangent.w
        return np.asarray(w - whole.share(w) * self._whole.w)

    def _part(self) -> Mode:
        """Return the same as a measure of unit length."""
        beyond = self.part
        length = self._measure(beyond).length
        if not length:
            raise newton.NoConvergence("the whole device moves as before")
        return self._measure(beyond / length)

    def _measure(self, w: Array) -> Mode:
        return Mode(self._mass, w)

    def _direction(self, state: State, along: Mode) -> controls.Tangent:
        """Return the path's direction at a state, towards more of a measure, its dofs of unit length."""
        self.solver.factorise(state)
        rate = self.solver.tangent_along(state, along.image, DIRECTION_TOLERANCE)
        length = self._measure(rate.w).length
        return controls.Tangent(rate.w / length, rate.P / length, rate.V / length)


# ----------------------------------------------------------------------------------------------------------------------
# Locate limit points and bifurcations: every change of the tangent's signature between two points.
#
# Two things change the number of negative eigenvalues along a path. At a limit point the pressure has an extremum and K's
# singular mode is the path's tangent. At a bifurcation K is singular in a mode that does not change the volume (q . mode = 0),
# the path continues smoothly, and another branch crosses it. At an extremum of the volume K is regular.


EigenvalueSample = tuple[float, Point]
"""An eigenvalue and its state."""

MAX_BISECTIONS = 10
"""Maximum bisections of an interval with several events; closer ones are reported as one."""
EIGENVALUE_SAMPLE_POSITIONS = (0.5, 0.2, 0.08)
"""Sampling positions of the eigenvalue around its expected root, relative to the interval's farther end.

Not closer: a mesh without the device's symmetry bends the path towards the branch where K is nearly singular, and a nearby
state would contain some of the mode and give the imperfect mesh's eigenvalue instead of the device's. The eigenvalue is a
smooth function of the volume, so the rest is interpolated."""
MIN_EIGENVALUE_RATIO = 3e-3
"""Eigenvalue, relative to the largest on the path, below which a state is not used for the interpolation."""
MAX_INTERPOLATION_POINTS = 4
"""Number of states whose eigenvalues are interpolated."""


def unexplained(before: Point, after: Point) -> int:
    """Return the negative eigenvalues gained between two points, minus those explained by limit points."""
    gained = after.signature.negative_eigenvalues - before.signature.negative_eigenvalues
    turned_P, turned_V = before.tangent.P * after.tangent.P < 0, before.tangent.V * after.tangent.V < 0
    if turned_P and turned_V:
        return 0 if abs(gained) == 1 else gained
    if turned_P:
        return gained - (int(after.tangent.compliance < 0) - int(before.tangent.compliance < 0))
    return gained


def events(
    corrector: Corrector, requested: PathQuantity, before: Point, after: Point, report: Callable[[str], None]
) -> list[Point]:
    """Return the limit points, of the pressure and of the requested quantity, and bifurcations between the path's last point
    and the next, in order; ``report`` takes a sentence on a bifurcation that cannot be located.

    The kept factorisation is that of ``after`` then: none of the states solved for in between leaves a trace in what follows,
    which a run that is resumed could not follow.
    """
    solver, stability = corrector.solver, corrector.stability
    kept = solver.lagged.base, stability.modes
    points = changes(corrector, before, after, report)
    if turn := own_limit(corrector, requested, before, after):
        points = sorted([*turn, *points], key=lambda point: abs(point.state.V - before.state.V))
    if solver.lagged.base is not kept[0] or stability.modes is not kept[1]:
        solver.factorise(after.state)
        stability.lowest()
    return points


def own_limit(corrector: Corrector, requested: PathQuantity, before: Point, after: Point) -> list[Point]:
    """Return the limit point of the requested quantity between two points, if any: of a stroke, where the gas keeps
    expanding."""
    if not requested.has_limits or requested.slope(before) <= 0.0 or requested.slope(after) >= 0.0:
        return []
    return [dataclasses.replace(corrector.point(corrector.root(before, after, requested.slope)), turn=True)]


def limit(corrector: Corrector, before: Point, after: Point) -> Point:
    """Return the limit point of the pressure between two points, to about 1e-10 of the pressure."""
    state = corrector.root(before, after, lambda point: point.tangent.P / point.tangent.V)
    return corrector.point(state, limit=True)


def changes(corrector: Corrector, before: Point, after: Point, report: Callable[[str], None], depth: int = 0) -> list[Point]:
    """Return the changes of the signature between two neighbouring points: limit points of the pressure and bifurcations, in
    order."""
    turned = before.tangent.P * after.tangent.P < 0
    gained = unexplained(before, after)
    if gained == 0:
        return [limit(corrector, before, after)] if turned else []
    if (turned or abs(gained) > 1) and depth < MAX_BISECTIONS:
        try:
            middle = corrector.middle(before, after)
        except newton.NoConvergence as failure:
            report(f"several changes of stability between two points could not be separated ({failure})")
            return [limit(corrector, before, after)] if turned else []
        return [
            *changes(corrector, before, middle, report, depth + 1),
            *changes(corrector, middle, after, report, depth + 1),
        ]
    try:
        return [bifurcation(corrector, before, after)]
    except newton.NoConvergence as failure:
        # The signature shows one; the signatures of the next points will still show it.
        report(f"a bifurcation between two points could not be located ({failure})")
        corrector.solver.factorise(after.state)
        return []


def bifurcation(corrector: Corrector, before: Point, after: Point) -> Point:
    """Return the bifurcation between two points: the root of the eigenvalue that changes its sign there. `NoConvergence` if no
    state in between could be solved for."""
    stability = corrector.stability
    # The negative eigenvalue nearest to zero is the one that has just changed its sign, or is about to.
    fewer, more = sorted((before, after), key=lambda point: point.signature.negative_eigenvalues)
    _, mode = stability.critical(more.state, fewer.signature.negative_eigenvalues)
    f_low, f_high = (stability.like(point.state, mode)[0] for point in (before, after))
    if f_low * f_high > 0:
        raise newton.NoConvergence("the eigenvalue that changes sign did not converge")
    known = [(f_low, before), (f_high, after)]
    scale = max(stability.largest, abs(f_low), abs(f_high))
    start, width = before.state.V, after.state.V - before.state.V
    for spread in EIGENVALUE_SAMPLE_POSITIONS:
        root = _root(known, scale)
        reach = max(abs(root - start), abs(root - after.state.V))
        for V in (root - spread * reach, root + spread * reach):
            corrector.solver.factorise(before.state)
            try:
                point = corrector.on_the_way(before, after, min(max((V - start) / width, -1.0), 2.0))
                known.append((stability.like(point.state, mode)[0], point))
            except newton.NoConvergence:  # too near: K is singular there under every control
                continue
    low, high = _around(_far(known, scale))
    root = _root(known, scale)
    point = corrector.interpolated(low[1], high[1], (root - low[1].state.V) / (high[1].state.V - low[1].state.V))
    _, mode = stability.like(point.state, mode)
    lowest = stability.critical_lowest(
        point.state, min(before.signature.negative_eigenvalues, after.signature.negative_eigenvalues)
    )
    corrector.solver.factorise(after.state)  # the singular K just factorised is no usable preconditioner
    signature = Signature(before.signature.negative_eigenvalues, lowest)
    return dataclasses.replace(point, mode=mode, limit=False, requested=False, signature=signature)


def _root(known: list[EigenvalueSample], scale: float) -> float:
    """Return the volume at which the eigenvalue is zero, by interpolation through the states far enough
    from it."""
    far = _far(known, scale)
    (_, low), (_, high) = _around(far)
    middle = (low.state.V + high.state.V) / 2
    used = sorted(far, key=lambda entry: abs(entry[1].state.V - middle))[:MAX_INTERPOLATION_POINTS]
    through = scipy.interpolate.BarycentricInterpolator([point.state.V for _, point in used], [value for value, _ in used])
    return float(scipy.optimize.brentq(through, low.state.V, high.state.V, xtol=1e-13 * abs(middle)))


def _around(known: list[EigenvalueSample]) -> tuple[EigenvalueSample, EigenvalueSample]:
    return next((a, b) for a, b in itertools.pairwise(known) if a[0] * b[0] <= 0)


def _far(known: list[EigenvalueSample], scale: float) -> list[EigenvalueSample]:
    """Return the states, by rising volume, that are far enough from the singular one; all of them, if these lie on
    one side."""
    every = sorted({point.state.V: (value, point) for value, point in known}.values(), key=lambda entry: entry[1].state.V)
    far = [entry for entry in every if abs(entry[0]) > MIN_EIGENVALUE_RATIO * scale]
    return far if len({value > 0 for value, _ in far}) == 2 else every


# ----------------------------------------------------------------------------------------------------------------------
# Let a device go: from a state that is none of equilibrium it creeps against a drag on its mass until it rests.
#
# A small part of a device may snap where neither its pressure nor its volume show it: a compressed surface creases, a stiff
# sheet wrinkles, walls that meet slide off an edge. The curve of equilibrium states turns back there in all that is controlled,
# perhaps more sharply than any step follows, but a real device jumps to the next stable state and goes on from it.


MAX_SNAPS = 30
"""Maximum number of times that a device is released on one path."""
DEVICE_CRUMPLES = component.PathFailure(
    f"the device crumples: it has snapped {MAX_SNAPS} times, each time into further folds",
    "Stay below, or use smaller cells (--cell-size), which resolve the folds; the device came to rest in each state up to here",
    of_mesh=True,
)
FIRST_CREEP_STEP, LAST_CREEP_STEP, MIN_CREEP_STEP = 0.3, 1e4, 1e-4
"""First step of a device that is released, the one from which on it rests, and the shortest, in times that a shear wave takes
to cross the device."""
MAX_CREEP_STEPS = 1000
"""Maximum number of steps until it rests."""
FREE_GROWTH = 500.0
"""Cavity volumes at which a device that moves freely has burst, and at which the search for another stable part ends: a balloon
of eight times its radius."""


def come_to_rest(path: Continuation, curve: controls.Curve, state: State, why: str) -> State | None:
    """Return the stable state on a control's curve in which a device comes to rest that is released in a state near it; None if
    it does not, or has inertia of its own.

    Args:
        path: The path that was lost there; it counts how often.
        curve: What is controlled, and where.
        state: Where the device is released.
        why: The reason, a clause, for the report.

    Raises:
        PathEnd: A cavity collapses, or the device has been released too often.
    """
    if path.solver.system.potential.motion:
        return None
    if path.history.snaps == MAX_SNAPS:
        raise PathEnd(why, cause=DEVICE_CRUMPLES)
    path.history.snaps += 1
    path.report(f"{why}; letting the device go there")
    try:
        return creep(path, curve, state)
    except newton.NoConvergence as failure:
        path.report(f"it finds no state of rest ({failure})")
        if isinstance(failure, CavityCollapsed):
            raise PathEnd(why, cause=CAVITY_COLLAPSES) from failure
        return None


def creep(path: Continuation, curve: controls.Curve, state: State) -> State:
    """Return the stable state on a control's curve to which a device creeps from a state near it.

    It moves against a drag, M w' = -dPi/dw, by implicit Euler's steps: each is a minimum of the potential with one more term,
    the inertia of a step from rest, and its length grows until that term is nothing (pseudo-transient continuation, Kelley and
    Keyes 1998, doi 10.1137/S0036142996304796). A step to a saddle is too long. What silicone remembers stays, as a snap takes
    no time.

    Raises:
        NoConvergence: It does not come to rest; `CavityCollapsed` if a cavity collapses.
    """
    system, potential = path.solver.system, path.solver.system.potential
    motion = memory.Motion(system, assembly.Inertia((1.0,) * len(system.matter)), system.stress_unit / system.length_unit**2)
    potential.motion, step = motion, FIRST_CREEP_STEP
    try:
        for _ in range(MAX_CREEP_STEPS):
            motion.commit(state.w, reset=True)
            motion.begin(step if step < LAST_CREEP_STEP else 0.0)
            try:
                crept = path.corrector.solve_from(curve, state.w, state.P, state)
                path.corrector.check_whole(crept, state)
                if not path.at(crept).stable_under(curve.line(crept.V, crept.P)):
                    raise newton.NoConvergence("a saddle")
            except newton.NoConvergence:
                step /= 2.0
                if step < MIN_CREEP_STEP:
                    raise
                continue
            state = crept
            potential.commit(state.w)
            if step >= LAST_CREEP_STEP:
                return state
            if abs(state.V) > FREE_GROWTH * path.plane.V_scale:
                break
            quick, slow = crept.iterations <= FAST_ITERATIONS, crept.iterations >= SLOW_ITERATIONS
            step = LAST_CREEP_STEP if not crept.iterations else step * (2.0 if quick else 1.0 if slow else 1.3)
    finally:
        potential.motion = None
    raise newton.NoConvergence("the device did not come to rest")


# ----------------------------------------------------------------------------------------------------------------------
# Branch switching at a bifurcation.
#
# If K is singular in a mode, two more branches exist: the path's shape plus or minus a small amount of
# the mode. Near the bifurcation the branch, its mirror image and the path have nearly the same volumes
# and pressures, so its first states are solved with a prescribed amount of the mode, which stays regular. Once
# two states predict the third, arc-length control takes over.


MODE_AMPLITUDES = (0.05, 0.1, 0.02, 0.2, 0.01)
"""Amounts of the mode tried in turn for the first state, as largest displacement relative to the device's size."""
MODE_GROWTH = 1.3
"""Factor between prescribed amounts of the mode."""
MAX_AMPLITUDES = 14
"""Maximum number of prescribed amounts before arc-length control takes over."""
MAX_PREDICTION_ERROR = 0.2
"""Relative error of a predicted amount below which arc-length control takes over."""
MAX_BRANCH_POINTS = 60


class Branch:
    """One of the two directions from a bifurcation, by a sign: 1 or -1 along the mode. Where a symmetry of the device maps one
    to the other, both are the same. The path that met it is taken over: its last points become the branch's."""

    def __init__(self, path: Continuation, bifurcation: Point, sign: int):
        self.path, self.start, self.sign = path, bifurcation, sign
        assert bifurcation.mode is not None
        self.shape = bifurcation.mode
        self.mode = Mode(path.stability.mass, self.shape)
        path.history.points, path.history.modes, path.history.line = [], [], ArcLength.name
        path.history.level = math.nan  # a branch has passed no limit

    def amount(self, w: npt.NDArray[np.float64]) -> float:
        """Return the amount of the mode in dofs (shape as `State.w`) relative to the bifurcation, along the chosen
        direction."""
        return self.sign * self.mode.share(w - self.start.state.w)

    def first(self) -> Point:
        """Return the first state on the branch; `NoConvergence` if no amount of the mode led to one."""
        at = self.start.state
        for amount in MODE_AMPLITUDES:
            try:
                return self._given(amount, at.w + self.sign * amount * self.shape, at.P)
            except newton.NoConvergence as failure:
                self.path.report(f"no converged state with amplitude {amount:g} of the mode ({failure})")
        raise newton.NoConvergence("no converged state on the branch")

    def next(self) -> Point:
        """Return the state with `MODE_GROWTH` times as much of the mode as the last."""
        path, last = self.path, self.path.last.state
        points = path.history.points
        before = points[0].state if len(points) > 1 else self.start.state
        old, new = self.amount(before.w), self.amount(last.w)
        ahead = (MODE_GROWTH - 1) * new / (new - old)
        w, P = last.w + ahead * (last.w - before.w), last.P + ahead * (last.P - before.P)
        return self._given(MODE_GROWTH * new, w, P)

    def _given(self, amount: float, guess: npt.NDArray[np.float64], P: float) -> Point:
        """Return the state with the given amplitude of the mode, its tangent towards larger ones."""
        path, solver, at = self.path, self.path.solver, self.start.state
        solver.factorise(dataclasses.replace(at, w=guess, P=P))
        state = solver.solve_along(self.mode.image, at.w, self.sign * amount, guess, P)
        solver.factorise(state)
        signature = path.stability.signature(exact=True)
        t = path.corrector.tangent(state)
        tangent = t if self.sign * self.mode.share(t.w) > 0 else -t
        step = self._distance(path.last.state, state) if path.history.points else path.first_step
        return dataclasses.replace(
            self.start, state=state, tangent=tangent, mode=None, line="mode", step=step, signature=signature,
            stiffest=abs(tangent.compliance),
        )  # fmt: skip

    def _distance(self, a: State, b: State) -> float:
        change = (b.V - a.V, b.P - a.P)
        return self.path.plane.product(change, change) ** 0.5

    def predicted(self, known: list[Point], point: Point) -> bool:
        """Return whether two points predict a third well enough for arc-length control."""
        s, t = known[-1].state, known[-1].tangent
        path, new = self.path, point.state
        line = path.plane.square_to(t, s)
        line = line.at(line.value(new.V, new.P))
        forward = all(path.plane.product((p.tangent.V, p.tangent.P), (t.V, t.P)) > 0 for p in (*known, point))
        if len(known) < 2 or not forward or line.target <= line.value(s.V, s.P):
            return False
        amount = self.amount(new.w)
        error = self.amount(predict(known, line)[0]) - amount
        return abs(error) <= MAX_PREDICTION_ERROR * abs(amount - self.amount(s.w))


def follow(path: Continuation, bifurcation: Point, sign: int = 1, farthest: float = float("inf")) -> Iterator[Point]:
    """Follow the branch away from a bifurcation, by a sign along its mode; the path that met it is taken over.

    It ends at the value ``farthest`` of the path's quantity, and where a cavity has grown or shrunk too far.

    Yields:
        The branch's points, limit points and further bifurcations among them; at most `MAX_BRANCH_POINTS`.

    Raises:
        PathEnd: The branch could be followed no further.
    """
    system = path.solver.system

    def ends(point: Point) -> bool:
        value, growth = path.value(point.state), abs(point.state.V) / path.plane.V_scale
        least = 0.05 if system.drives_cavities else -1.0  # the travel of a dead load may be zero
        return value >= farthest or value <= 0.0 or not least < growth < MAX_GROWTH

    branch = Branch(path, bifurcation, sign)
    try:
        yield path.commit(branch.first())
        for _ in range(MAX_AMPLITUDES):
            known, new = path.history.points, branch.next()
            yield path.commit(new)
            if ends(new):
                return
            if branch.predicted(known, new):
                break
    except newton.NoConvergence as failure:
        raise PathEnd(str(failure)) from failure
    path.history.modes = [branch.mode]
    for _ in range(MAX_BRANCH_POINTS):
        stops, leak = path.stops(min(path.last.step, 0.5))
        for stop in stops:
            yield stop if stop.bifurcation else path.commit(dataclasses.replace(stop, step=stops[-1].step))
        if leak:
            raise leak
        if ends(stops[-1]):
            return
