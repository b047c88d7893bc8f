"""States of a path: solved for on a control's curve from what the last points foretell, and those between two points."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

from softmodels.mechanics.controls import Control, Curve, volume_control
from softmodels.mechanics.newton import NoConvergence
from softmodels.mechanics.solver import TANGENT_TOLERANCE, Solver
from softmodels.mechanics.system import State
from softmodels.mechanics.tangent import Tangent
from softmodels.path.points import Point
from softmodels.path.prediction import predict, predict_direction
from softmodels.path.quantities import Plane, Quantity
from softmodels.path.stability import Signature
from softmodels.path.trail import Trail

LARGEST_MODE_SHARE = 0.5
"""Share of a bifurcation's mode in a guess's error, over the step's size, above which the state lies on another branch."""
FARTHEST = 4.0
"""How far a dead load may move what it acts on in one step, in terms of what the step's beginning foretells."""
MOST_SECANTS = 25
"""Steps of the secant method in which a value between two points is found."""


class Emptied(NoConvergence):
    """A state in which a cavity has less than no volume: its walls have passed through each other."""


class Corrector:
    """Newton's method along a path.

    Args:
        solver: The device.
        trail: The path's last points.
        plane: Scales of volume and pressure.
    """

    def __init__(self, solver: Solver, trail: Trail, plane: Plane):
        self.solver, self.trail, self.plane = solver, trail, plane
        self.stability = trail.stability

    def tangent(self, state: State, tolerance: float = TANGENT_TOLERANCE) -> Tangent:
        """Direction at a state, kept pointing forward; measured square to the last direction, so regular at limits."""
        if not self.trail.points:
            return self.solver.tangent(state, Control(1 / self.plane.V_scale, 1.0, 0.0), tolerance)
        last = self.trail.last
        line = self.plane.stiffened(last.stiffest).square_to(last.tangent, last.state)
        # Where nothing moves, a guess is the states' rounding errors, and the direction has to be without any.
        locked = self.plane.locked(last.tangent.compliance)
        guess = None if locked else predict_direction(self.trail.points, state, line)
        return self.solver.tangent(state, line, tolerance, guess)

    def solve(self, line: Curve, around: Sequence[Point]) -> State:
        """The state on a line, guessed by the cubic through one or two points and their tangents.

        Past a bifurcation there are several. One with much more or less of the mode than foretold lies on another branch.

        Raises:
            NoConvergence: There is none, or it lies on another branch.
        """
        w, P = predict(around, line)
        try:
            state = self.solver.solve(line, w, P)
        except NoConvergence:
            if not self.solver.system.potential.foreseen:
                raise
            # A stiff sheet or stiff fibres may have been in the way.
            state = self.solver.solve(line, w, P, since=around[-1].state.w)
        for mode in self.trail.modes:
            if abs(mode.share(state.w - w)) > LARGEST_MODE_SHARE * mode.size(w - around[-1].state.w):
                raise NoConvergence("it jumped to another branch")
        return state

    def point(self, state: State, requested: bool = False, limit: bool = False, step: float | None = None) -> Point:
        """The point of a state: its tangent and signature, factorised where these need it.

        Args:
            state: A state near the last point.
            requested: Whether it is one of the requested values.
            limit: Whether it is a limit point of the pressure.
            step: Length of the next step; the last point's if None.
        """
        solver, last = self.solver, self.trail.last
        stale = solver.stale
        # At a limit point K is singular: no preconditioner to go on with, and a signature of rounding errors.
        stale = (stale or self.stability.wants(state)) and not (limit and solver.bordered.factorisations)
        if stale:
            solver.factorise(state)
        tangent, before = self.tangent(state), last.tangent
        if limit:
            # Which way the pressure goes there is a matter of rounding; like the signature, it is that of the state before.
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
        return Point(
            state, tangent, requested, limit, step, self.trail.line, stale, solver.kept.age, stiffest, signature
        )

    def check_branch(self, state: State, line: Curve) -> None:
        """Refuse a state that Newton found on a line somewhere else: behind the last one, inside out, or through a wall.

        A dead load's magnitude may be given beyond a limit point and met again far behind it, on a part that stiffens.

        Raises:
            NoConvergence: It lies there.
            Emptied: A cavity's walls have passed through each other, which no short step mends.
        """
        s, t = self.trail.last.state, self.trail.last.tangent
        system, plane = self.solver.system, self.plane.stiffened(self.trail.last.stiffest)
        along = plane.product((state.V - s.V, state.P - s.P), (t.V, t.P))
        if (system.volumes() <= 0.0).any():
            raise Emptied("a cavity would be pressed empty")
        if along <= 0.0:
            raise NoConvergence("it jumped to another branch")
        if not system.potential.admits(s.w, state.w):
            raise NoConvergence("a wall passed through what stops it")
        if not (line.needs_volume or system.drives_cavities):
            foretold = t.V * (state.P - s.P) / t.P if t.P else math.inf
            if abs(state.V - s.V) > FARTHEST * abs(foretold):
                raise NoConvergence("it gave way too far for one step")

    # -- between two points -------------------------------------------------------------------------------------------

    def between(self, quantity: Quantity, before: Point, after: Point, value: float) -> Point:
        """The point between two others at which a quantity has a value."""
        try:
            state = self.solve(quantity.curve(value), (before, after))
            low, high = sorted((before.state.V, after.state.V))
            margin = 1e-6 * (high - low)
            if not low - margin <= state.V <= high + margin:
                raise NoConvergence("another branch")
        except NoConvergence:
            state = self.root(before, after, lambda p: quantity.value(p.state.V, p.state.P) - value)
        return self.point(state, requested=True)

    def on_the_way(self, before: Point, after: Point, share: float) -> Point:
        """A point between two, ``share`` of the way in volume."""
        a, b = before.state, after.state
        state = self.solve(volume_control(a.V + share * (b.V - a.V)), (before, after))
        return dataclasses.replace(after, state=state, tangent=self.tangent(state), requested=False)

    def interpolated(self, before: Point, after: Point, share: float) -> Point:
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
        self.solver.factorise(state)
        return dataclasses.replace(
            after, state=state, tangent=self.tangent(state), requested=False, limit=False,
            signature=self.stability.signature(exact=True),
        )  # fmt: skip

    def root(self, low: Point, high: Point, f: Callable[[Point], float]) -> State:
        """Root of f between two points by the Illinois variant of the secant, on lines of given volume.

        Each value is a solve, started from the bracket's own two points, which a root finder for plain numbers does not
        know; and it ends as soon as f is small beside its ends.
        """
        f_low, f_high = f(low), f(high)
        scale = max(abs(f_low), abs(f_high))
        best, side = low, 0
        for _ in range(MOST_SECANTS):
            V = (low.state.V * f_high - high.state.V * f_low) / (f_high - f_low)
            state = self.solve(volume_control(V), (low, high))
            best = dataclasses.replace(high, state=state, tangent=self.tangent(state, 1e-9))
            value = f(best)
            if abs(value) <= 1e-7 * scale or abs(high.state.V - low.state.V) <= 1e-9 * self.plane.V_scale:
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
