"""The end of a path: its last two points, from which the next is foretold, and what a restart needs to go on alike."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

from softmodels.mechanics.solver import Solver
from softmodels.mechanics.system import State
from softmodels.mechanics.tangent import Tangent
from softmodels.path.modes import Mode
from softmodels.path.points import Point
from softmodels.path.stability import Stability


class Trail:
    """Last points of a path.

    Args:
        solver: The device.

    Attributes:
        points: The last one or two, in order.
        modes: Those of the bifurcations that the path has passed: a state with much of one lies on another branch.
        line: Name of what the path follows.
        stability: Of the device.
    """

    def __init__(self, solver: Solver):
        self.solver, self.stability = solver, Stability.of(solver)
        self.points: list[Point] = []
        self.modes: list[Mode] = []
        self.line = ""

    @property
    def last(self) -> Point:
        return self.points[-1]

    def keep(self, point: Point) -> Point:
        """Make a point the last one, with what a restart needs to go on as this path does."""
        kept = self.solver.kept
        self.solver.system.potential.keep(point.state.w)
        point = dataclasses.replace(
            point, factorised=kept.base is point.state, age=kept.age, worn=kept.worn,
            largest=self.stability.largest,
        )  # fmt: skip
        self.points = [*self.points[-1:], point]
        return point

    def change_line(self, line: str, step: float) -> None:
        """Follow something else from the last point on, with a step of this length."""
        self.line = line
        self.points[-1] = dataclasses.replace(self.last, step=step, line=line)

    def begin_again(self, line: str) -> None:
        """Forget all points and modes: what comes is another branch."""
        self.points, self.modes, self.line = [], [], line

    def restore(self, points: Sequence[Point], tangent: Callable[[State], Tangent]) -> None:
        """Take up points of an earlier path: same predictor, same factorisation, same modes, so the same numbers.

        Args:
            points: In order, the last two, those before them at which the kept factorisation was made, and bifurcations.
            tangent: Gives the direction at a state for points that were stored without.
        """
        self.points = []
        for point in points:
            if point.mode is not None:
                self.modes.append(Mode(self.stability.mass, point.mode))
                continue
            if point.factorised:
                self.solver.factorise(point.state)
                self.stability.lowest()
            known = point.tangent.w.any()
            again = point if known else dataclasses.replace(point, tangent=tangent(point.state))
            self.points = [*self.points[-1:], again]
        last = self.last
        self.line, self.stability.largest = last.line, last.largest
        self.solver.kept.age, self.solver.kept.worn = last.age, last.worn
