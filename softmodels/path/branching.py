"""Branch switching at a bifurcation.

If K is singular in a mode, two more branches exist: the path's shape plus or minus a small amount of
the mode. Near the bifurcation the branch, its mirror image and the path have nearly the same volumes
and pressures, so its first states are solved with a prescribed amount of the mode, which stays regular. Once
two states predict the third, arc-length control takes over.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from softmodels.mechanics.newton import NoConvergence
from softmodels.mechanics.system import State
from softmodels.path.continuation import LARGEST_GROWTH, Continuation, predict
from softmodels.path.points import ArcLength, PathEnd, Point
from softmodels.path.stability import Mode

AMOUNTS = (0.05, 0.1, 0.02, 0.2, 0.01)
"""Amounts of the mode tried in turn for the first state, as largest displacement relative to the device's size."""
GROWTH = 1.3
"""Factor between prescribed amounts of the mode."""
MOST_AMOUNTS = 14
"""Maximum number of prescribed amounts before arc-length control takes over."""
FORETOLD = 0.2
"""Relative error of a predicted amount below which arc-length control takes over."""
MOST_POINTS = 60


class Branch:
    """One of the two directions from a bifurcation; reuses the path object, whose last points become the branch's.

    Args:
        path: The path that met it.
        bifurcation: The point.
        sign: 1 or -1: which way along the mode. Where a symmetry of the device maps one to the other, both are the same.
    """

    def __init__(self, path: Continuation, bifurcation: Point, sign: int):
        self.path, self.start, self.sign = path, bifurcation, sign
        assert bifurcation.mode is not None
        self.shape = bifurcation.mode
        self.mode = Mode(path.trail.stability.mass, self.shape)
        path.trail.begin_again(ArcLength.name)

    def amount(self, w: npt.NDArray[np.float64]) -> float:
        """Return the amount of the mode in dofs (shape as `State.w`) relative to the bifurcation, along the chosen
        direction."""
        return self.sign * self.mode.share(w - self.start.state.w)

    def first(self) -> Point:
        """Return the first state on the branch.

        Raises:
            NoConvergence: No amount of the mode led to a state.
        """
        at = self.start.state
        for amount in AMOUNTS:
            try:
                return self._given(amount, at.w + self.sign * amount * self.shape, at.P)
            except NoConvergence as failure:
                self.path.report(f"no converged state with amplitude {amount:g} of the mode ({failure})")
        raise NoConvergence("no converged state on the branch")

    def next(self) -> Point:
        """Return the state with `GROWTH` times as much of the mode as the last."""
        path, last = self.path, self.path.last.state
        points = path.trail.points
        before = points[0].state if len(points) > 1 else self.start.state
        old, new = self.amount(before.w), self.amount(last.w)
        ahead = (GROWTH - 1) * new / (new - old)
        return self._given(GROWTH * new, last.w + ahead * (last.w - before.w), last.P + ahead * (last.P - before.P))

    def _given(self, amount: float, guess: npt.NDArray[np.float64], P: float) -> Point:
        """Return the state with the given amplitude of the mode, its tangent towards larger ones."""
        path, solver, at = self.path, self.path.solver, self.start.state
        solver.factorise(dataclasses.replace(at, w=guess, P=P))
        state = solver.solve_along(self.mode.image, at.w, self.sign * amount, guess, P)
        solver.factorise(state)
        signature = path.trail.stability.signature(exact=True)
        t = path.corrector.tangent(state)
        tangent = t if self.sign * self.mode.share(t.w) > 0 else -t
        step = self._distance(path.last.state, state) if path.trail.points else path.first_step
        return dataclasses.replace(
            self.start, state=state, tangent=tangent, mode=None, line="mode", step=step, signature=signature,
            stiffest=abs(tangent.compliance),
        )  # fmt: skip

    def _distance(self, a: State, b: State) -> float:
        """Return the arc length between two states in the plane of volume and pressure."""
        change = (b.V - a.V, b.P - a.P)
        return self.path.plane.product(change, change) ** 0.5

    def predicted(self, known: list[Point], found: Point) -> bool:
        """Return whether two points predict a third well enough for arc-length control."""
        s, t = known[-1].state, known[-1].tangent
        path, new = self.path, found.state
        line = path.plane.square_to(t, s)
        line = line.at(line.value(new.V, new.P))
        forward = all(path.plane.product((p.tangent.V, p.tangent.P), (t.V, t.P)) > 0 for p in (*known, found))
        if len(known) < 2 or not forward or line.target <= line.value(s.V, s.P):
            return False
        amount = self.amount(new.w)
        error = self.amount(predict(known, line)[0]) - amount
        return abs(error) <= FORETOLD * abs(amount - self.amount(s.w))


def follow(path: Continuation, bifurcation: Point, sign: int = 1, farthest: float = float("inf")) -> Iterator[Point]:
    """Follow the branch away from a bifurcation.

    Args:
        path: The path that met it; taken over.
        bifurcation: Where the branch begins.
        sign: Which way along the mode.
        farthest: Value of the path's quantity at which to end; so does a cavity that has grown or shrunk too far.

    Yields:
        The branch's points, limit points and further bifurcations among them; at most `MOST_POINTS`.

    Raises:
        PathEnd: The branch could be followed no further.
    """

    system = path.solver.system

    def ends(point: Point) -> bool:
        value, growth = path.value(point.state), abs(point.state.V) / path.plane.V_scale
        least = 0.05 if system.drives_cavities else -1.0  # the travel of a dead load may be zero
        return value >= farthest or value <= 0.0 or not least < growth < LARGEST_GROWTH

    branch = Branch(path, bifurcation, sign)
    try:
        yield path.keep(branch.first())
        for _ in range(MOST_AMOUNTS):
            known, found = path.trail.points, branch.next()
            yield path.keep(found)
            if ends(found):
                return
            if branch.predicted(known, found):
                break
    except NoConvergence as failure:
        raise PathEnd(str(failure)) from failure
    path.trail.modes = [branch.mode]
    for _ in range(MOST_POINTS):
        stops, leak = path.stops(min(path.last.step, 0.5), float("inf"))
        for stop in stops:
            yield stop if stop.bifurcation else path.keep(dataclasses.replace(stop, step=stops[-1].step))
        if leak:
            raise leak
        if ends(stops[-1]):
            return
